"""Commands to the simulated ArduCopter: what each does, and its one acknowledgement."""

from __future__ import annotations

import math
from typing import Any, Callable, List, Mapping

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.simulation.flight import Mode
from amaze_autonomy.simulation.px4.commands import Order

from .modes import BLIND, GUIDED, mode_of

__all__ = ["carry_out", "enter"]

_OK, _DENIED, _UNSUPPORTED, _FAILED = 0, 2, 3, 4  # MAV_RESULT
_CRITICAL, _INFO = 2, 6
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
    if craft.airborne and order.params[1] != _FORCE:
        return _FAILED
    return _FAILED if craft.armed and craft.disarm() else _OK


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
    craft.climb_to(order.params[6])
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
