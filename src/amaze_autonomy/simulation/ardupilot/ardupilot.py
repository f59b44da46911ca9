"""The simulated ArduCopter: messages and times in, messages out, like `Px4`, whose links, craft and clock it uses.

It streams its heartbeat and nothing else until asked, tells its texts to everybody, leaves a lost GPS healthy in
SYS_STATUS, says pre-arm ok in STABILIZE and refuses in GUIDED, and counts its battery's fraction from what flowed, so
that only the charge state tells the voltage.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable, List, Mapping, Optional, Tuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.simulation.px4 import telemetry
from amaze_autonomy.simulation.px4.commands import Order
from amaze_autonomy.simulation.px4.health import Failsafes, Sensors
from amaze_autonomy.simulation.px4.missions import MissionServer
from amaze_autonomy.simulation.px4.px4 import Px4
from amaze_autonomy.simulation.px4.wire import DESCEND, Link, Parameters
from amaze_autonomy.simulation.vehicle.flight import Mode

from .craft import BLIND, GUIDED, ArduCraft, ArduMissions, ArduParameters, base_mode, custom_mode, mode_of

_PARAMETERS = {
    "ARMING_CHECK": 1,
    "BATT_LOW_VOLT": 10.5,
    "DISARM_DELAY": 10,
    "FS_EKF_ACTION": 1,
    "FS_THR_ENABLE": 1,
    "MIS_RESTART": 0,
    "SIM_GPS_DISABLE": 0,
}
_EKF_GOOD, _EKF_LOST = 0x33F, 0xA7  # attitude, velocity, position; constant position
_FLOWN = 0.5  # how much too full it says that its battery is
_SENSORS = 0x0120802F | mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER | mavlink.MAV_SYS_STATUS_SENSOR_BATTERY
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
_CRITICAL = 2
#: what PX4 says in its words, and ArduPilot in others or not at all
_WORDS: Mapping[str, str] = {
    "Armed by external command": "Arming motors",
    "Disarmed by landing": "Disarming motors",
    **dict.fromkeys(("Executing Mission", "Takeoff detected", "Landing detected"), ""),
    **dict.fromkeys(("Mission finished, loitering", "Mission finished, landed"), ""),
}


class ArduPilot(Px4):
    """One autopilot; its craft is an `ArduCraft`."""

    craft: ArduCraft
    _shown = ""

    def connect(self, name: str, preset: str = "silent") -> Link:
        """Have a connection: whatever rates are wished for, it begins silent."""
        del preset
        return super().connect(name, "silent")

    def say(self, severity: int, text: str) -> None:
        """Tell a text to everybody; there are no events."""
        for name in self._links:
            self._out.extend((name, chunk) for chunk in self._texts.chunks(severity, text))

    def tell_problems(self, _t_ns: int) -> None:
        """Say what stands against arming in this mode."""
        for problem in sorted(self.craft.flags.not_ready.values()):
            self.say(_CRITICAL, f"PreArm: {problem}")

    def advance(self, t_ns: int) -> List[Tuple[str, Any]]:
        """As PX4, and with each change of the mode a heartbeat."""
        self.craft.restarts = int(self.parameters["MIS_RESTART"]) != 0
        if self._shown != self.craft.mode:
            changed, self._shown = bool(self._shown), self.craft.mode
            for link in self._links.values() if changed else ():
                link.hasten(t_ns, "HEARTBEAT")
        return super().advance(t_ns)

    # --- what it does in another way than PX4 ---------------------------------------------------------------------

    def _make_parameters(self) -> Parameters:
        given = {name: value for name, value in self.settings.parameters.items() if name in _PARAMETERS}
        return ArduParameters({**_PARAMETERS, **given})

    def _make_missions(self) -> MissionServer:
        return ArduMissions(self.settings.mission_capacity, lambda: self.craft.home)

    def _make_failsafes(self) -> Failsafes:
        return _Failsafes(self.craft, self.health, self.parameters, self._say)

    @property
    def _has_gps(self) -> bool:
        return int(self.parameters["SIM_GPS_DISABLE"]) == 0

    def _results(self, t_ns: int, order: Order) -> List[int]:
        return carry_out(self, t_ns, order)

    def _say(self, severity: int, text: str) -> None:
        words = _WORDS.get(text.rstrip("\t"), text.rstrip("\t"))
        if words:
            self.say(severity, words)

    def _take_set_mode(self, _t_ns: int, _link: Link, message: Any) -> None:
        if message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            enter(self, message.custom_mode)

    def _take_current(self, t_ns: int, link: Link, message: Any) -> None:
        """Say once the very number that it was told, as if it were at it."""
        said = len(self._out)
        super()._take_current(t_ns, link, message)
        for _, answer in self._out[said:]:
            answer.seq = message.seq

    def _take_set_point(self, t_ns: int, link: Link, message: Any) -> None:
        self.craft.interrupt_takeoff()
        super()._take_set_point(t_ns, link, message)

    @property
    def _ready(self) -> bool:
        blind = self.craft.mode in BLIND or not self.health.position_lost
        return not self.craft.flags.not_ready and blind

    def _view(self, t_ns: int) -> telemetry.View:
        view = super()._view(t_ns)
        bits = _SENSORS | _PREARM
        health = bits & ~(0 if self._ready else _PREARM) & ~(0 if self._transmitter else _RC)
        fraction = None if view.fraction is None else min(1.0, view.fraction + _FLOWN)
        return dataclasses.replace(view, sensors=Sensors(bits, bits, health), fraction=fraction)

    def _message(self, name: str, view: telemetry.View) -> Any:
        own = _MESSAGES.get(name)
        return telemetry.make(name, view) if own is None else own(view)


_RC = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER


class _Failsafes(Failsafes):
    """A lost position lands it; a low battery is told; a stream of set-points may stop as it likes."""

    def advance(self, t_ns: int, fraction: Optional[float], *, transmitter: bool) -> None:
        """Look at everything, and act."""
        del t_ns, transmitter
        craft = self._craft
        if fraction is not None:
            self.level = sum(fraction < limit for limit in (0.15, 0.07, 0.05))
        if craft.armed and craft.airborne and self._health.position_lost and craft.mode not in (*BLIND, DESCEND):
            self._act(DESCEND, "EKF Failsafe: changed to LAND Mode")


def _heartbeat(view: telemetry.View) -> Any:
    craft = view.craft
    status = mavlink.MAV_STATE_ACTIVE if craft.airborne else mavlink.MAV_STATE_STANDBY
    if craft.failsafe or view.level:  # also when nothing is done about it, and after it has landed
        status = mavlink.MAV_STATE_CRITICAL
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        base_mode(armed=craft.armed),
        custom_mode(craft.mode),
        status,
        3,
    )


def _ekf(view: telemetry.View) -> Any:
    flags = _EKF_LOST if view.health.position_lost else _EKF_GOOD
    return mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.0)


def _nothing(_: telemetry.View) -> None:
    """Have no such message."""


_MESSAGES: Mapping[str, Callable[[telemetry.View], Any]] = {
    "HEARTBEAT": _heartbeat,
    "EKF_STATUS_REPORT": _ekf,
    "ESTIMATOR_STATUS": _nothing,
    "CURRENT_MODE": _nothing,
    "CURRENT_EVENT_SEQUENCE": _nothing,
}
ArduPilot._takers = {  # noqa: SLF001 - a table of its own methods
    **Px4._takers,  # noqa: SLF001
    "SET_MODE": ArduPilot._take_set_mode,  # noqa: SLF001
    "MISSION_SET_CURRENT": ArduPilot._take_current,  # noqa: SLF001
    "SET_POSITION_TARGET_LOCAL_NED": ArduPilot._take_set_point,  # noqa: SLF001
}


# --- orders -----------------------------------------------------------------------------------------------------------
# Commands to the simulated ArduCopter: what each does, and its one acknowledgement.


_OK, _DENIED, _UNSUPPORTED, _FAILED = 0, 2, 3, 4  # MAV_RESULT
_INFO = 6
_FORCE = 21196.0
_UNKNOWN = ("CURRENT_MODE", "EVENT", "ESTIMATOR_STATUS")
_NAMES = {number: kind.msgname for number, kind in mavlink.mavlink_map.items()}


def carry_out(vehicle: Any, t_ns: int, order: Order) -> List[int]:
    """Carry a command out; return the result with which it is acknowledged."""
    handler = _HANDLERS.get(order.command)
    return [_UNSUPPORTED if handler is None else handler(vehicle, t_ns, order)]


def enter(vehicle: Any, number: int) -> bool:
    """Enter a mode if that can be; also with the motors off it needs what the mode needs."""
    mode, craft = mode_of(number), vehicle.craft
    if mode is None:
        return False
    if mode not in BLIND and vehicle.health.position_lost:
        vehicle.say(_CRITICAL, "Mode change failed: requires position")
        return False
    if mode == Mode.MISSION and len(craft.items) <= 1:
        vehicle.say(_CRITICAL, "Mode change to AUTO failed: missing mission")
        return False
    if mode != craft.mode and not (mode == GUIDED and craft.mode == Mode.TAKEOFF):
        craft.command_mode(mode)
    return True


def _set_mode(vehicle: Any, _t_ns: int, order: Order) -> int:
    flags, number = (round(value) if math.isfinite(value) else 0 for value in order.params[:2])
    if not flags & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return _DENIED
    return _OK if enter(vehicle, number) else _FAILED


def _arm(vehicle: Any, _t_ns: int, order: Order) -> int:
    craft = vehicle.craft
    if round(order.params[0]) == 1:
        problem = "" if craft.armed else _why_not(vehicle) or craft.arm()
        if problem:
            vehicle.say(_CRITICAL, f"Arm: {problem}")
        return _FAILED if problem else _OK
    if not craft.armed:
        return _OK
    return _FAILED if (craft.cut_motors() if order.params[1] == _FORCE else craft.disarm()) else _OK


def _why_not(vehicle: Any) -> str:
    """Return why it does not arm in its mode."""
    if vehicle.craft.flags.not_ready:
        return ", ".join(sorted(vehicle.craft.flags.not_ready.values()))
    lost = vehicle.health.position_lost and vehicle.craft.mode not in BLIND
    return "Need Position Estimate" if lost else ""


def _take_off(vehicle: Any, _t_ns: int, order: Order) -> int:
    """Climb in GUIDED, armed, from the ground only; the height is above home."""
    craft = vehicle.craft
    if craft.mode != GUIDED or not craft.armed or craft.airborne or not math.isfinite(order.params[6]):
        return _FAILED
    up_m = order.params[6] + craft.home.altitude_m - craft.geography.origin.altitude_m
    if up_m <= craft.position_m[2]:  # it takes off upwards
        return _FAILED
    craft.climb_to(up_m)
    return _OK


def _start_mission(vehicle: Any, _t_ns: int, _order: Order) -> int:
    if not vehicle.craft.armed or not enter(vehicle, 3):
        return _FAILED
    vehicle.craft.start_mission()
    return _OK


def _set_interval(vehicle: Any, t_ns: int, order: Order) -> int:
    number = round(order.params[0])
    name = _NAMES.get(number)
    if name is None or name in _UNKNOWN:
        vehicle.say(_INFO, f"No ap_message for mavlink id ({number})")
        return _DENIED
    order.link.set_interval(t_ns, name, order.params[1])
    return _OK


def _check(vehicle: Any, t_ns: int, _order: Order) -> int:
    vehicle.tell_problems(t_ns)
    return _OK


def _land(vehicle: Any, _t_ns: int, _order: Order) -> int:
    return _OK if enter(vehicle, 9) else _FAILED


_HANDLERS: Mapping[int, Callable[[Any, int, Order], int]] = {
    mavlink.MAV_CMD_NAV_TAKEOFF: _take_off,
    mavlink.MAV_CMD_NAV_LAND: _land,
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_MISSION_START: _start_mission,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    mavlink.MAV_CMD_RUN_PREARM_CHECKS: _check,
}
