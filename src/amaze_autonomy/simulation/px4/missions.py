"""Missions of the simulated PX4: their items, what the vehicle makes of them, and its side of the mission protocol."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, FrozenSet, List, NamedTuple, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from .settings import Geography, Place

# --- items ------------------------------------------------------------------------------------------------------------


_NOWHERE = 2**31 - 1  # of MISSION_ITEM_INT: NaN
_DEG_OF_DEG7 = 1e-7

_ABSOLUTE = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_RELATIVE = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
_MISSION_FRAME = mavlink.MAV_FRAME_MISSION

_TASKS = {
    mavlink.MAV_CMD_NAV_TAKEOFF: "takeoff",
    mavlink.MAV_CMD_NAV_WAYPOINT: "waypoint",
    mavlink.MAV_CMD_NAV_LOITER_TIME: "waypoint",
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: "stay",
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: "return",
    mavlink.MAV_CMD_NAV_LAND: "land",
    mavlink.MAV_CMD_NAV_DELAY: "delay",
}
# Taken and passed over: cameras, gimbals and servos are not simulated.
_PASSED: FrozenSet[int] = frozenset(
    (
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_SET_SERVO,
        mavlink.MAV_CMD_DO_SET_ROI,
        mavlink.MAV_CMD_DO_SET_ROI_LOCATION,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_SET_CAM_TRIGG_DIST,
        mavlink.MAV_CMD_DO_TRIGGER_CONTROL,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
        mavlink.MAV_CMD_VIDEO_START_CAPTURE,
        mavlink.MAV_CMD_VIDEO_STOP_CAPTURE,
        mavlink.MAV_CMD_SET_CAMERA_MODE,
    )
)


@dataclass(frozen=True)
class Item:
    """One item as it was uploaded; it is handed out again unchanged.

    Args:
        frame: MAV_FRAME.
        command: MAV_CMD.
        autocontinue: as given.
        params: the first four.
        x: latitude in 1e-7 degrees.
        y: longitude in 1e-7 degrees.
        z: altitude in m.
        kind: MAV_MISSION_TYPE.
    """

    frame: int
    command: int
    autocontinue: int
    params: Tuple[float, float, float, float]
    x: int
    y: int
    z: float
    kind: int = 0


@dataclass(frozen=True)
class Task:
    """What the vehicle does for an item; what is None stays as it is.

    Args:
        what: takeoff, waypoint, stay, return, land, delay or pass.
        across: metres east and north of the origin.
        up_m: above the origin.
        yaw_rad: counter-clockwise from east.
        hold_s: how long it stays there.
    """

    what: str
    across: Optional[Tuple[float, float]] = None
    up_m: Optional[float] = None
    yaw_rad: Optional[float] = None
    hold_s: float = 0.0


def problem_of(item: Item) -> int:
    """Return the MAV_MISSION_RESULT with which PX4 refuses an item; 0 when it takes it."""
    if item.command not in _TASKS and item.command not in _PASSED:
        return int(mavlink.MAV_MISSION_UNSUPPORTED)
    if item.frame not in (*_ABSOLUTE, *_RELATIVE, _MISSION_FRAME):
        return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
    if not math.isfinite(item.z) and _TASKS.get(item.command) in ("takeoff", "waypoint"):
        return int(mavlink.MAV_MISSION_INVALID_PARAM7)
    return 0


def task_of(item: Item, home: Place, geography: Geography) -> Task:
    """Return what to do for an item, with the home of this moment."""
    what = _TASKS.get(item.command, "pass")
    if what in ("pass", "return"):
        return Task(what)
    if what == "delay":
        return Task(what, hold_s=max(0.0, item.params[0]))
    return Task(
        what=what,
        across=_across(item, geography),
        up_m=item.z + (home.altitude_m if item.frame in _RELATIVE else 0.0) - geography.origin.altitude_m,
        yaw_rad=None if math.isnan(item.params[3]) else math.pi / 2 - math.radians(item.params[3]),
        hold_s=max(0.0, item.params[0]) if what == "waypoint" else 0.0,
    )


def _across(item: Item, geography: Geography) -> Optional[Tuple[float, float]]:
    if _NOWHERE in (item.x, item.y) or (item.x, item.y) == (0, 0):
        return None
    return geography.local(item.x * _DEG_OF_DEG7, item.y * _DEG_OF_DEG7)


# --- the protocol -----------------------------------------------------------------------------------------------------
# The first item of an upload is asked for with MISSION_REQUEST, and once it came as MISSION_ITEM_INT the others with
# MISSION_REQUEST_INT; a sender that acknowledges a request as unsupported is asked the other way. An item is asked for
# again every 250 ms, for five seconds. A last item that comes again, because its sender did not get the MISSION_ACK, is
# acknowledged again.


_RETRY_NS = 250_000_000
_LIMIT_NS = 5_000_000_000
_MISSION = mavlink.MAV_MISSION_TYPE_MISSION
_KINDS = (_MISSION, mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY)
_DEG7 = 1e7

Partner = Tuple[str, int, int]


class Upload(NamedTuple):
    """A mission that has come.

    Args:
        items: of it.
        current: item that was marked as the current one; None: none was.
    """

    items: Tuple[Item, ...]
    current: Optional[int]


class MissionServer:
    """Takes, keeps and hands out missions; one transfer at a time. `current` is the item that the vehicle is at.

    Args:
        capacity: items that can be kept.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._stores: Dict[int, Tuple[Item, ...]] = dict.fromkeys(_KINDS, ())
        self._partner: Optional[Partner] = None
        self._kind, self._count, self._seq = _MISSION, 0, 0
        self._items: List[Item] = []
        self._current: Optional[int] = None
        self._done: Optional[Tuple[Partner, int, int]] = None
        self._in_ints = False
        self._asked_ns = self._heard_ns = 0
        self.uploaded: Optional[Upload] = None
        self.current = 0

    @property
    def items(self) -> Tuple[Item, ...]:
        """The mission that is kept."""
        return self._stores[_MISSION]

    def take(self, t_ns: int, link: str, message: Any) -> List[Any]:
        """Answer a message of the protocol; one that is none of it gets no answer. `uploaded` holds what has come."""
        partner = (link, message.get_srcSystem(), message.get_srcComponent())
        handler = _HANDLERS.get(message.get_type())
        return handler(self, t_ns, partner, message) if handler is not None else []

    def advance(self, t_ns: int) -> List[Tuple[str, Any]]:
        """Ask again for an item that does not come; give up after five seconds. Returns (link, message)."""
        if self._partner is None:
            return []
        if t_ns - self._heard_ns >= _LIMIT_NS:
            self._partner = None
            return []
        if t_ns - self._asked_ns < _RETRY_NS:
            return []
        return [(self._partner[0], self._ask(t_ns))]

    # --- upload ---------------------------------------------------------------------------------------------------

    def _begin(self, t_ns: int, partner: Partner, message: Any) -> List[Any]:
        kind = message.mission_type
        if self._partner is not None and self._partner != partner:
            return [_ack(partner, mavlink.MAV_MISSION_ERROR, kind)]
        if kind not in _KINDS:
            return [_ack(partner, mavlink.MAV_MISSION_UNSUPPORTED, kind)]
        if message.count > self._capacity:
            return [_ack(partner, mavlink.MAV_MISSION_NO_SPACE, kind)]
        if message.count == 0:
            self._store(kind, (), 0)
            return [_ack(partner, mavlink.MAV_MISSION_ACCEPTED, kind)]
        self._partner, self._kind, self._count, self._seq = partner, kind, message.count, 0
        self._items, self._current, self._in_ints, self._done = [], None, False, None
        self._heard_ns = t_ns
        return [self._ask(t_ns)]

    def _ask(self, t_ns: int) -> Any:
        self._asked_ns = t_ns
        _, system, component = self._partner or ("", 0, 0)
        make = mavlink.MAVLink_mission_request_int_message if self._in_ints else mavlink.MAVLink_mission_request_message
        return make(system, component, self._seq, self._kind)

    def _item(self, t_ns: int, partner: Partner, message: Any) -> List[Any]:
        kind = message.mission_type
        if self._partner is None:
            again = self._done == (partner, kind, message.seq)
            return [_ack(partner, mavlink.MAV_MISSION_ACCEPTED if again else mavlink.MAV_MISSION_ERROR, kind)]
        if partner != self._partner or kind != self._kind:
            return []
        self._heard_ns = t_ns
        if message.seq != self._seq:
            return [self._ask(t_ns)] if message.seq > self._seq else []
        self._in_ints = message.get_type() == "MISSION_ITEM_INT"
        item = _item_of(message)
        problem = self._problem(item) if kind == _MISSION else 0
        if problem:
            self._partner = None
            return [_ack(partner, problem, kind)]
        self._items.append(item)
        if message.current:
            self._current = message.seq
        self._seq += 1
        return [self._ask(t_ns)] if self._seq < self._count else self._end(partner)

    def _problem(self, item: Item) -> int:
        """Return the MAV_MISSION_RESULT with which an item is refused; 0 when it is taken."""
        return problem_of(item)

    def _end(self, partner: Partner) -> List[Any]:
        self._store(self._kind, tuple(self._items), self._current)
        self._partner, self._done = None, (partner, self._kind, self._count - 1)
        return [_ack(partner, mavlink.MAV_MISSION_ACCEPTED, self._kind)]

    def _store(self, kind: int, items: Tuple[Item, ...], current: Optional[int]) -> None:
        self._stores[kind] = items
        if kind == _MISSION:
            self.uploaded = Upload(items, current)

    # --- download, clear ------------------------------------------------------------------------------------------

    def _list(self, _t_ns: int, partner: Partner, message: Any) -> List[Any]:
        kind = message.mission_type
        count = len(self._stores.get(kind, ()))
        return [mavlink.MAVLink_mission_count_message(partner[1], partner[2], count, kind)]

    def _hand_out(self, _t_ns: int, partner: Partner, message: Any) -> List[Any]:
        kind = message.mission_type
        items = self._stores.get(kind, ())
        if message.seq >= len(items):
            return [_ack(partner, mavlink.MAV_MISSION_INVALID_SEQUENCE, kind)]
        in_ints = message.get_type() == "MISSION_REQUEST_INT"
        is_current = kind == _MISSION and message.seq == self.current
        return [_message_of(items[message.seq], partner, message.seq, is_current=is_current, in_ints=in_ints)]

    def _clear(self, _t_ns: int, partner: Partner, message: Any) -> List[Any]:
        kinds = _KINDS if message.mission_type == mavlink.MAV_MISSION_TYPE_ALL else (message.mission_type,)
        for kind in kinds:
            if kind in _KINDS:
                self._store(kind, (), 0)
        return [_ack(partner, mavlink.MAV_MISSION_ACCEPTED, message.mission_type)]

    def _partner_acks(self, t_ns: int, partner: Partner, message: Any) -> List[Any]:
        """Ask in the other way when the sender of an upload cannot do it in this one; end it when it cancels."""
        if partner != self._partner:
            return []  # the end of a download
        if message.type == mavlink.MAV_MISSION_UNSUPPORTED:
            self._in_ints = not self._in_ints
            return [self._ask(t_ns)]
        if message.type == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            self._partner = None
        return []


_HANDLERS = {
    "MISSION_COUNT": MissionServer._begin,  # noqa: SLF001 - a table of its own methods
    "MISSION_ITEM": MissionServer._item,  # noqa: SLF001
    "MISSION_ITEM_INT": MissionServer._item,  # noqa: SLF001
    "MISSION_REQUEST_LIST": MissionServer._list,  # noqa: SLF001
    "MISSION_REQUEST": MissionServer._hand_out,  # noqa: SLF001
    "MISSION_REQUEST_INT": MissionServer._hand_out,  # noqa: SLF001
    "MISSION_CLEAR_ALL": MissionServer._clear,  # noqa: SLF001
    "MISSION_ACK": MissionServer._partner_acks,  # noqa: SLF001
}


def _ack(partner: Partner, result: int, kind: int) -> Any:
    return mavlink.MAVLink_mission_ack_message(partner[1], partner[2], result, kind)


def _item_of(message: Any) -> Item:
    """Read an item; PX4 keeps places as integers, however they came."""
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        x, y = round(x * _DEG7), round(y * _DEG7)
    return Item(
        frame=message.frame,
        command=message.command,
        autocontinue=message.autocontinue,
        params=(message.param1, message.param2, message.param3, message.param4),
        x=x,
        y=y,
        z=message.z,
        kind=message.mission_type,
    )


def _message_of(item: Item, partner: Partner, seq: int, *, is_current: bool, in_ints: bool) -> Any:
    head = (partner[1], partner[2], seq, item.frame, item.command, int(is_current), item.autocontinue, *item.params)
    if in_ints:
        return mavlink.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, item.kind)
    return mavlink.MAVLink_mission_item_message(*head, item.x / _DEG7, item.y / _DEG7, item.z, item.kind)
