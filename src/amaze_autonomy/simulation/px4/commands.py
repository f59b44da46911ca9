"""Commands to the simulated PX4: what each does, and with what result it is acknowledged.

DO_SET_MODE is acknowledged twice: ACCEPTED when it is understood, then with what came of it. So a mode that PX4 cannot
enter is first accepted, then TEMPORARILY_REJECTED. Only HEARTBEAT tells the mode.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable, List, Mapping, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.simulation.vehicle.flight import Mode

from .craft import Craft
from .health import Failsafes, Health
from .telemetry import numbers
from .wire import OFFBOARD, Link, Parameters, mode_of

_OK = mavlink.MAV_RESULT_ACCEPTED
_LATER = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
_DENIED = mavlink.MAV_RESULT_DENIED
_UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
_FAILED = mavlink.MAV_RESULT_FAILED
_CRITICAL, _INFO = 2, 6
_FORCE = 21196.0
_NUMBERS = numbers()
_WITH_POSITION = (Mode.TAKEOFF, Mode.LOITER, Mode.MISSION, Mode.RTL, Mode.POSITION)

_Params = Tuple[float, ...]


@dataclass(frozen=True)
class Order:
    """A command that has come.

    Args:
        command: MAV_CMD.
        params: its seven parameters, places in degrees.
        link: it came on.
    """

    command: int
    params: _Params
    link: Link


@dataclass(frozen=True)
class Orders:
    """All that commands act on.

    Args:
        craft: the vehicle.
        health: of its sensors.
        failsafes: its failsafes.
        parameters: its parameters.
        say: tells a text: (severity, text).
        tell: streams a message once: (link, name) -> it could.
    """

    craft: Craft
    health: Health
    failsafes: Failsafes
    parameters: Parameters
    say: Callable[[int, str], None]
    tell: Callable[[Link, str], bool]


def results(orders: Orders, t_ns: int, order: Order) -> List[int]:
    """Carry a command out; return the results with which it is acknowledged, in order."""
    handler = _HANDLERS.get(order.command)
    return [_UNSUPPORTED] if handler is None else handler(orders, t_ns, order)


def enter(orders: Orders, t_ns: int, mode: str) -> bool:
    """Enter a mode if that can be; on the ground with the motors off everything can be chosen."""
    craft = orders.craft
    if craft.armed and not _can_run(orders, t_ns, mode):
        return False
    craft.command_mode(mode)
    if mode == Mode.MISSION and craft.armed and craft.mode == Mode.MISSION:
        orders.say(_INFO, "Executing Mission\t")
    return True


def _can_run(orders: Orders, t_ns: int, mode: str) -> bool:
    if mode == OFFBOARD:
        return orders.failsafes.offboard_ready(t_ns)
    if mode == Mode.MISSION and not orders.craft.items:
        return False
    return not (mode in _WITH_POSITION and orders.health.position_lost)


def _set_mode(orders: Orders, t_ns: int, order: Order) -> List[int]:
    flags, main, sub = (round(value) if math.isfinite(value) else 0 for value in order.params[:3])
    mode = mode_of(main, sub if main == 4 else 0)  # noqa: PLR2004 - only "auto" has sub-modes
    if not flags & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED or mode is None:
        return [_UNSUPPORTED]
    return [_OK, _OK if enter(orders, t_ns, mode) else _LATER]


def _mode(mode: str) -> Callable[[Orders, int, Order], List[int]]:
    def handler(orders: Orders, t_ns: int, _order: Order) -> List[int]:
        return [_OK if enter(orders, t_ns, mode) else _LATER]

    return handler


def _arm(orders: Orders, t_ns: int, order: Order) -> List[int]:
    craft = orders.craft
    if round(order.params[0]) == 1:
        if craft.armed:
            return [_OK]
        problem = craft.flags.not_ready and ", ".join(sorted(craft.flags.not_ready.values()))
        problem = problem or ("GPS fix too low" if orders.health.position_lost else "")
        problem = problem or ("" if _can_run(orders, t_ns, craft.mode) else f"{craft.mode} is not available")
        problem = problem or craft.arm()
        if problem:
            orders.say(_CRITICAL, f"Arming denied: {problem}\t")
            return [_LATER]
        return [_OK]
    if round(order.params[0]) != 0:
        return [_UNSUPPORTED]
    if not craft.armed:
        return [_OK]
    if order.params[1] == _FORCE:
        return [_LATER if craft.cut_motors() else _OK]
    if craft.airborne:
        orders.say(_CRITICAL, "Disarming denied: not landed\t")
        return [_LATER]
    return [_LATER if craft.disarm() else _OK]


def _take_off(orders: Orders, t_ns: int, order: Order) -> List[int]:
    craft = orders.craft
    if craft.airborne or not _can_run(orders, t_ns, Mode.TAKEOFF):
        return [_LATER]
    altitude = order.params[6]
    up = float(orders.parameters["MIS_TAKEOFF_ALT"])
    if math.isfinite(altitude):
        up = altitude - craft.geography.origin.altitude_m
    craft.climb_to(up)
    return [_OK]


def _pause(orders: Orders, t_ns: int, order: Order) -> List[int]:
    return _mode(Mode.LOITER if round(order.params[0]) == 0 else Mode.MISSION)(orders, t_ns, order)


def _start_mission(orders: Orders, t_ns: int, order: Order) -> List[int]:
    craft = orders.craft
    if not craft.items:
        return [_DENIED]
    first = round(order.params[0])
    if 0 <= first < len(craft.items):
        craft.set_current(first)
    if not craft.armed and _arm(orders, t_ns, Order(order.command, (1.0, *order.params[1:]), order.link)) != [_OK]:
        return [_LATER]
    return [_OK if enter(orders, t_ns, Mode.MISSION) else _LATER]


def _set_current(orders: Orders, _t_ns: int, order: Order) -> List[int]:
    number = round(order.params[0])
    if not 0 <= number < len(orders.craft.items):
        return [_DENIED]
    orders.craft.set_current(number)
    return [_OK]


def _set_interval(_orders: Orders, t_ns: int, order: Order) -> List[int]:
    name = _NUMBERS.get(round(order.params[0]))
    if name is None:
        return [_DENIED]
    if name == "HEARTBEAT":
        return [_FAILED]  # its rate is constant
    order.link.set_interval(t_ns, name, order.params[1])
    return [_OK]


def _tell(orders: Orders, _t_ns: int, order: Order) -> List[int]:
    number = round(order.params[0])
    name = _ONCE.get(number) or _NUMBERS.get(number)
    return [_OK if name is not None and orders.tell(order.link, name) else _DENIED]


def _tell_one(name: str) -> Callable[[Orders, int, Order], List[int]]:
    def handler(orders: Orders, _t_ns: int, order: Order) -> List[int]:
        return [_OK if orders.tell(order.link, name) else _DENIED]

    return handler


def _accept(_orders: Orders, _t_ns: int, _order: Order) -> List[int]:
    return [_OK]


_ONCE: Mapping[int, str] = {
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: "AUTOPILOT_VERSION",
}
_HANDLERS: Mapping[int, Callable[[Orders, int, Order], List[int]]] = {
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: _mode(Mode.LOITER),
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: _mode(Mode.RTL),
    mavlink.MAV_CMD_NAV_LAND: _mode(Mode.LAND),
    mavlink.MAV_CMD_NAV_TAKEOFF: _take_off,
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _accept,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE: _pause,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _set_current,
    mavlink.MAV_CMD_MISSION_START: _start_mission,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    mavlink.MAV_CMD_REQUEST_MESSAGE: _tell,
    mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: _tell_one("AUTOPILOT_VERSION"),
}
