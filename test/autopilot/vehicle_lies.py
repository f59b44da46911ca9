"""A vehicle that is heard to say what is not so, for one message or for a while: between it and whoever listens."""

from __future__ import annotations

from copy import copy
from typing import Any, Callable, Dict, List, Mapping, Tuple

from amaze_autonomy.autopilot.link.dialect import mavlink

Lie = Tuple[str, Any]
"""What is said wrongly, and what it is said to be."""

ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
ON_GROUND, IN_AIR = mavlink.MAV_LANDED_STATE_ON_GROUND, mavlink.MAV_LANDED_STATE_IN_AIR
CLIMBING, LANDING = mavlink.MAV_LANDED_STATE_TAKEOFF, mavlink.MAV_LANDED_STATE_LANDING
CRITICAL = mavlink.MAV_STATE_CRITICAL
DOWN: Tuple[Lie, ...] = (("armed", False), ("landed", ON_GROUND))
"""What a vehicle says that stands on the ground, disarmed."""

PX4_MODES = {
    "AUTO.MISSION": (4, 4),
    "AUTO.LOITER": (4, 3),
    "AUTO.LAND": (4, 6),
    "AUTO.PRECLAND": (4, 9),
    "AUTO.RTL": (4, 5),
    "OFFBOARD": (6, 0),
    "POSCTL": (3, 0),
}
COPTER_MODES = {"AUTO.MISSION": 3, "AUTO.LOITER": 17, "AUTO.LAND": 9, "AUTO.RTL": 6, "OFFBOARD": 4, "POSCTL": 5}


def number(mode: str, *, copter: bool = False) -> int:
    """Return `custom_mode` of a flight mode."""
    if copter:
        return COPTER_MODES[mode]
    main, sub = PX4_MODES[mode]
    return main << 16 | sub << 24


def _arm(message: Any, armed: bool, _: bool) -> None:  # noqa: FBT001
    message.base_mode = message.base_mode | ARMED if armed else message.base_mode & ~ARMED


def _mode(message: Any, mode: str, copter: bool) -> None:  # noqa: FBT001
    message.custom_mode = number(mode, copter=copter)


def _set(field: str) -> Callable[[Any, Any, bool], None]:
    return lambda message, value, _: setattr(message, field, value)


_LIES: Mapping[str, Tuple[str, Callable[[Any, Any, bool], None]]] = {
    "armed": ("HEARTBEAT", _arm),
    "mode": ("HEARTBEAT", _mode),
    "status": ("HEARTBEAT", _set("system_status")),
    "landed": ("EXTENDED_SYS_STATE", _set("landed_state")),
    "current mode": ("CURRENT_MODE", _mode),
}
"""What can be said wrongly: in which message, and how."""


class Liar:
    """Gives a client of a link what the vehicle says, and now and then something else.

    Args:
        client: planner or autopilot node's client.
        copter: the vehicle is an ArduCopter.
    """

    def __init__(self, client: Any, *, copter: bool = False) -> None:
        self._receive, client.receive = client.receive, self._take
        self._copter = copter
        self._last: Dict[str, Any] = {}
        self._once: List[Lie] = []
        self._always: Tuple[Lie, ...] = ()

    def once(self, *lies: Lie) -> None:
        """Have the next message of each kind say this."""
        self._once += lies

    def always(self, *lies: Lie) -> None:
        """Have all messages say this from now on; nothing: the truth."""
        self._always = lies

    def datagram(self, t_ns: int, *lies: Lie) -> List[Any]:
        """Give it messages that nobody sent, all at once; return what it sends."""
        kinds = dict.fromkeys(_LIES[what][0] for what, _ in lies)
        forged = [self._changed(self._last[kind], lies) for kind in kinds]
        return [sent for message in forged for sent in self._receive(t_ns, message)]

    def _take(self, t_ns: int, message: Any) -> Any:
        kind = message.get_type()
        self._last[kind] = message
        told = [each for each in self._once if _LIES[each[0]][0] == kind]
        self._once = [each for each in self._once if each not in told]
        return self._receive(t_ns, self._changed(message, (*self._always, *told)))

    def _changed(self, message: Any, lies: Tuple[Lie, ...]) -> Any:
        changed = copy(message)
        for what, value in lies:
            kind, change = _LIES[what]
            if kind == message.get_type():
                change(changed, value, self._copter)
        return changed
