"""What mavros says, as the MAVLink messages that it was made of; by the fields of its messages alone, without ROS.

So one client serves both ways to the vehicle. `SOURCES` is the table: topic below mavros' namespace, type, function.
PX4 only: the names of modes are turned back into PX4's numbers.
"""

from __future__ import annotations

from math import isfinite, nan
from typing import Any, Callable, Dict, NamedTuple, Optional, Tuple

from .dialect import Message, mavlink
from .modes import mode_name, px4_number

__all__ = ["SOURCES", "VEHICLE", "VELOCITY", "Converter", "Request", "Source", "request_of"]

VEHICLE = (1, 1)
_UNKNOWN_MV, _UNKNOWN = 65535, -1


class Source(NamedTuple):
    """One topic of mavros.

    Args:
        topic: below the namespace.
        kind: package and type.
        make: returns the MAVLink message; None: it says nothing.
    """

    topic: str
    kind: str
    make: Callable[[Any], Optional[Message]]


def _state(message: Any) -> Optional[Message]:
    """Return the HEARTBEAT of a mavros_msgs/State; None while mavros is not connected to the vehicle."""
    if not message.connected:
        return None
    main, sub = px4_number(message.mode) or (0, 0)
    base = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if message.armed:
        base |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, base, sub << 24 | main << 16, message.system_status, 3
    )


def _extended_state(message: Any) -> Message:
    return mavlink.MAVLink_extended_sys_state_message(message.vtol_state, message.landed_state)


def _sys_status(message: Any) -> Message:
    return mavlink.MAVLink_sys_status_message(
        message.sensors_present,
        message.sensors_enabled,
        message.sensors_health,
        message.load,
        message.voltage_battery,
        message.current_battery,
        message.battery_remaining,
        0,
        0,
        0,
        0,
        0,
        0,
    )


def _battery(message: Any) -> Message:
    """Return a BATTERY_STATUS; sensor_msgs/BatteryState has NaN for unknown, and negative currents for discharging."""
    cells = [_millivolts(volts) for volts in list(message.cell_voltage)[:10]]
    cells = cells or [_millivolts(message.voltage)]
    cells += [_UNKNOWN_MV] * (10 - len(cells))
    percent = round(100 * message.percentage) if isfinite(message.percentage) else _UNKNOWN
    current = round(-100 * message.current) if isfinite(message.current) else _UNKNOWN
    return mavlink.MAVLink_battery_status_message(
        0,
        0,
        0,
        32767,
        cells,
        current,
        _UNKNOWN,
        _UNKNOWN,
        percent if 0 <= percent <= 100 else _UNKNOWN,  # noqa: PLR2004
    )


def _millivolts(volts: float) -> int:
    return round(1000 * volts) if isfinite(volts) and 0 < volts < 65 else _UNKNOWN_MV  # noqa: PLR2004 - of 16 bits


def _text(message: Any) -> Message:
    """Return a STATUSTEXT; mavros has put its chunks together already."""
    return mavlink.MAVLink_statustext_message(message.severity, message.text.encode("utf-8", "replace"))


def _estimator(message: Any) -> Message:
    flags = sum(bit for name, bit in _FLAGS if getattr(message, name))
    return mavlink.MAVLink_estimator_status_message(0, flags, 0, 0, 0, 0, 0, 0, 0, 0)


_FLAGS: Tuple[Tuple[str, int], ...] = (
    ("attitude_status_flag", 1),
    ("velocity_horiz_status_flag", 2),
    ("velocity_vert_status_flag", 4),
    ("pos_horiz_rel_status_flag", 8),
    ("pos_horiz_abs_status_flag", 16),
    ("pos_vert_abs_status_flag", 32),
    ("pos_vert_agl_status_flag", 64),
    ("const_pos_mode_status_flag", 128),
    ("pred_pos_horiz_rel_status_flag", 256),
    ("pred_pos_horiz_abs_status_flag", 512),
    ("gps_glitch_status_flag", 1024),
    ("accel_error_status_flag", 2048),
)


def _gps(message: Any) -> Message:
    stamp = message.header.stamp
    return mavlink.MAVLink_gps_raw_int_message(
        stamp.secs * 1_000_000 + stamp.nsecs // 1000,
        message.fix_type,
        message.lat,
        message.lon,
        message.alt,
        message.eph,
        message.epv,
        message.vel,
        message.cog,
        message.satellites_visible,
    )


def _pose(message: Any) -> Message:
    """Return a LOCAL_POSITION_NED of mavros' local position, which is east, north, up; its velocity comes apart."""
    where = message.pose.position
    return mavlink.MAVLink_local_position_ned_message(0, where.y, where.x, -where.z, nan, nan, nan)


def _home(message: Any) -> Message:
    where = message.position
    return mavlink.MAVLink_home_position_message(0, 0, 0, where.y, where.x, -where.z, [1, 0, 0, 0], 0, 0, 0)


SOURCES: Tuple[Source, ...] = (
    Source("state", "mavros_msgs/State", _state),
    Source("extended_state", "mavros_msgs/ExtendedState", _extended_state),
    Source("sys_status", "mavros_msgs/SysStatus", _sys_status),
    Source("battery", "sensor_msgs/BatteryState", _battery),
    Source("statustext/recv", "mavros_msgs/StatusText", _text),
    Source("estimator_status", "mavros_msgs/EstimatorStatus", _estimator),
    Source("gpsstatus/gps1/raw", "mavros_msgs/GPSRAW", _gps),
    Source("local_position/pose", "geometry_msgs/PoseStamped", _pose),
    Source("home_position/home", "mavros_msgs/HomePosition", _home),
)
VELOCITY = Source("local_position/velocity_local", "geometry_msgs/TwistStamped", lambda _: None)


class Converter:
    """Makes MAVLink messages of mavros' topics; puts velocity and position, which come apart, together."""

    def __init__(self) -> None:
        self._sinking = nan

    def convert(self, source: Source, message: Any) -> Optional[Message]:
        """Return the MAVLink message of a message on a topic; None: it says nothing by itself."""
        if source is VELOCITY:
            self._sinking = -message.twist.linear.z
            return None
        made = source.make(message)
        if made is not None and made.get_type() == "LOCAL_POSITION_NED":
            made.vz = self._sinking
        return made


class Request(NamedTuple):
    """A service of mavros to call.

    Args:
        service: below the namespace.
        kind: type of it in mavros_msgs.
        fields: of the request.
        command: MAV_CMD that the answer acknowledges; 0: none.
    """

    service: str
    kind: str
    fields: Dict[str, Any]
    command: int = 0


def request_of(message: Message) -> Optional[Request]:
    """Return the service of mavros that does what a message asks for; None: mavros does it by itself, or cannot."""
    name = message.get_type()
    if name == "PARAM_REQUEST_READ":
        return Request("param/get", "ParamGet", {"param_id": message.param_id})
    if name != "COMMAND_LONG":
        return None
    if message.command == mavlink.MAV_CMD_DO_SET_MODE:
        number = int(message.param3) << 24 | int(message.param2) << 16
        mode = mode_name(mavlink.MAV_AUTOPILOT_PX4, number)
        return Request("set_mode", "SetMode", {"base_mode": 0, "custom_mode": mode}, message.command)
    parameters = {f"param{number}": getattr(message, f"param{number}") for number in range(1, 8)}
    fields = {"broadcast": False, "command": message.command, "confirmation": 0, **parameters}
    return Request("cmd/command", "CommandLong", fields, message.command)
