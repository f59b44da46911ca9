"""The messages that the simulated PX4 streams, made from a look at the vehicle: one function for each in the table.

Those about its motion are in `motion.py`.
"""

from __future__ import annotations

from typing import Any, Callable, Dict, Mapping, Optional

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.engine.events import VehicleLanded

from .failsafes import BATTERY_LEVELS
from .modes import base_mode, custom_mode
from .motion import MOTION
from .view import View
from .wire import current_mode, sequence

__all__ = ["MESSAGES", "View", "make", "numbers"]

_UNKNOWN_16 = 0xFFFF
_CHARGE = dict(
    zip(
        BATTERY_LEVELS,
        (
            mavlink.MAV_BATTERY_CHARGE_STATE_OK,
            mavlink.MAV_BATTERY_CHARGE_STATE_LOW,
            mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL,
            mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
        ),
    )
)
_LANDED = {
    VehicleLanded.UNKNOWN: mavlink.MAV_LANDED_STATE_UNDEFINED,
    VehicleLanded.ON_GROUND: mavlink.MAV_LANDED_STATE_ON_GROUND,
    VehicleLanded.TAKING_OFF: mavlink.MAV_LANDED_STATE_TAKEOFF,
    VehicleLanded.IN_AIR: mavlink.MAV_LANDED_STATE_IN_AIR,
    VehicleLanded.LANDING: mavlink.MAV_LANDED_STATE_LANDING,
}

_Maker = Callable[[View], Any]


def _heartbeat(view: View) -> Any:
    craft = view.craft
    if craft.armed:
        status = mavlink.MAV_STATE_CRITICAL if craft.failsafe else mavlink.MAV_STATE_ACTIVE
    else:
        status = mavlink.MAV_STATE_STANDBY if view.ready else mavlink.MAV_STATE_UNINIT
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        base_mode(craft.mode, armed=craft.armed),
        custom_mode(craft.mode),
        status,
        3,
    )


def _current_mode(view: View) -> Any:
    return current_mode(custom_mode(view.craft.mode), custom_mode(view.craft.intended))


def _sys_status(view: View) -> Any:
    known = view.fraction is not None and view.voltage_v is not None
    return mavlink.MAVLink_sys_status_message(
        view.sensors.present,
        view.sensors.enabled,
        view.sensors.health,
        200,
        round((view.voltage_v or 0.0) * 1000) if known else _UNKNOWN_16,
        round(_current_a(view) * 100) if known else -1,
        round((view.fraction or 0.0) * 100) if known else -1,
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def _battery_status(view: View) -> Any:
    known = view.fraction is not None and view.voltage_v is not None
    cell = round((view.voltage_v or 0.0) / view.cells * 1000) if known else _UNKNOWN_16
    volts = [cell] * min(10, view.cells) + [_UNKNOWN_16] * (10 - min(10, view.cells))
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        volts,
        round(_current_a(view) * 100) if known else -1,
        -1,
        -1,
        round((view.fraction or 0.0) * 100) if known else -1,
        0,
        _CHARGE[BATTERY_LEVELS[view.level]] if known else mavlink.MAV_BATTERY_CHARGE_STATE_UNDEFINED,
    )


def _current_a(view: View) -> float:
    return 18.0 if view.craft.airborne else 1.0


def _extended_sys_state(view: View) -> Any:
    landed = view.craft.landed if view.wrong.landed is None else view.wrong.landed
    return mavlink.MAVLink_extended_sys_state_message(0, _LANDED[landed])


def _mission_current(view: View) -> Any:
    total = len(view.craft.items) or _UNKNOWN_16
    return mavlink.MAVLink_mission_current_message(view.craft.current, total)


def _servo_output_raw(view: View) -> Any:
    turns = [1500 if view.craft.airborne else 1100 if view.craft.armed else 900] * 4
    return mavlink.MAVLink_servo_output_raw_message(view.t_us & 0xFFFFFFFF, 0, *turns, 900, 900, 900, 900)


def _rc_channels(view: View) -> Any:
    if not view.transmitter:
        return None
    sticks = [1500, 1500, 1500 if view.craft.airborne else 1100, 1500, *[1000] * 4]
    return mavlink.MAVLink_rc_channels_message(view.t_ms, 8, *sticks, *[_UNKNOWN_16] * 10, 90)


def _system_time(view: View) -> Any:
    return mavlink.MAVLink_system_time_message(view.unix_ns // 1000, view.t_ms)


def _timesync(view: View) -> Any:
    return mavlink.MAVLink_timesync_message(0, view.t_ns)


def _ping(view: View) -> Any:
    return mavlink.MAVLink_ping_message(view.t_us, view.t_ms // 1000, 0, 0)


def _current_event_sequence(view: View) -> Any:
    return sequence(view.events)


MESSAGES: Mapping[str, _Maker] = {
    **MOTION,
    "HEARTBEAT": _heartbeat,
    "BATTERY_STATUS": _battery_status,
    "CURRENT_EVENT_SEQUENCE": _current_event_sequence,
    "CURRENT_MODE": _current_mode,
    "EXTENDED_SYS_STATE": _extended_sys_state,
    "MISSION_CURRENT": _mission_current,
    "PING": _ping,
    "RC_CHANNELS": _rc_channels,
    "SERVO_OUTPUT_RAW": _servo_output_raw,
    "SYSTEM_TIME": _system_time,
    "SYS_STATUS": _sys_status,
    "TIMESYNC": _timesync,
}


def make(name: str, view: View) -> Any:
    """Make a message; None when there is nothing to tell."""
    maker: Optional[_Maker] = MESSAGES.get(name)
    return None if maker is None else maker(view)


def numbers() -> Dict[int, str]:
    """Return message number -> name of all that can be asked for."""
    known = {getattr(mavlink, f"MAVLINK_MSG_ID_{name}", 0): name for name in MESSAGES}
    return {**known, 0: "HEARTBEAT", 411: "CURRENT_EVENT_SEQUENCE", 436: "CURRENT_MODE"}
