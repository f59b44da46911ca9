"""Sends a mission, reads it back, compares it, and sets its first item: the MAVLink mission protocol without I/O.

Times and messages go in, messages to send come out. No acknowledgement is believed: the mission is there when it reads
back as it was sent, and it begins at its beginning when MISSION_CURRENT says so. What is lost is sent again; a transfer
that gets stuck begins anew, reading back by itself, until its time is over.

    COUNT      we say how many items        until the vehicle asks for one
    ITEMS      we answer what it asks for   until the last one was sent, and acknowledged or not
    LIST       we ask how many it has       until it says so
    READ       we ask for each              until all came back, the same
    CURRENT    we set the first item        until MISSION_CURRENT says that
    DONE

Traps: PX4 first asks with MISSION_REQUEST, then with MISSION_REQUEST_INT, and takes MISSION_ITEM_INT for both. With no
item marked as current it keeps the number of the mission before, and "finishes" on the ground: the first is marked, and
MISSION_SET_CURRENT is sent and confirmed as well; ArduPilot, told 0, which is home, says 1. An acknowledgement may be
late, doubled, or of the transfer before.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.missions import Home, Place, Trajectory

from ..link.dialect import Message, mavlink

# --- items ------------------------------------------------------------------------------------------------------------
# Autopilots keep items in types of their own, so what is read back may be rounded; what may differ by how much is one
# table below. ArduPilot's item 0 is home: a place holder that it overwrites, sent and never compared. It flies no yaw
# of a waypoint: before each stands a turn (CONDITION_YAW), which it begins when it sets out for that waypoint. It
# forgets a turn when it leaves AUTO, so that it is sent back to the turn (`beginning`) to go on.


_FRAME = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
_FRAMES = {_FRAME: 3, 3: 3}  # with and without _INT in its name is the same
_DEGREES = 1e7
_TAKEOFF, _WAYPOINT, _LAND = mavlink.MAV_CMD_NAV_TAKEOFF, mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_LAND
_TURN = mavlink.MAV_CMD_CONDITION_YAW
_NOWHERE = (_LAND, _TURN)  # commands whose frame ArduPilot may forget


class Dialect(enum.Enum):
    """How an autopilot speaks the mission protocol; the value is what its missions begin with before our items."""

    PX4 = 0
    ARDUPILOT = 1


#: items of each waypoint
_EACH: Mapping[Dialect, int] = {Dialect.PX4: 1, Dialect.ARDUPILOT: 2}


@dataclass(frozen=True)
class MissionItem:
    """One item; places in 1e-7 degrees, height in metres above home, yaw in degrees clockwise from north.

    Args:
        command: MAV_CMD.
        latitude_e7: north.
        longitude_e7: east.
        height_m: above home.
        hold_s: how long to stay.
        radius_m: nearer than this it is reached.
        heading_deg: 0..360; None: the autopilot's choice.
    """

    command: int
    latitude_e7: int
    longitude_e7: int
    height_m: float
    hold_s: float = 0.0
    radius_m: float = 0.0
    heading_deg: Optional[float] = None

    def message(self, number: int, target: Tuple[int, int]) -> Message:
        """Return it as MISSION_ITEM_INT; the first one is marked as the current one."""
        heading = math.nan if self.heading_deg is None else self.heading_deg
        return mavlink.MAVLink_mission_item_int_message(
            *target,
            number,
            _FRAME,
            self.command,
            int(number == 0),
            1,
            self.hold_s,
            self.radius_m,
            0.0,
            heading,
            self.latitude_e7,
            self.longitude_e7,
            self.height_m,
        )


def mission_items(
    trajectory: Trajectory, home: Home, start: Place, climb_m: float, radius_m: float, dialect: Dialect
) -> Tuple[MissionItem, ...]:
    """Return the items of one flight.

    Args:
        trajectory: its waypoints.
        home: origin of the waypoints.
        start: where it takes off.
        climb_m: height of the takeoff item.
        radius_m: of acceptance.
        dialect: of the autopilot.
    """
    places = trajectory.places or tuple(home.to_global(each.x_m, each.y_m) for each in trajectory.waypoints)
    waypoints = tuple(
        MissionItem(
            _WAYPOINT,
            *_integers(place),
            waypoint.z_m,
            _hold_s(waypoint.hold_s, dialect),
            radius_m,
            (90.0 - math.degrees(waypoint.yaw_rad)) % 360.0,
        )
        for place, waypoint in zip(places, trajectory.waypoints)
    )
    if dialect is Dialect.ARDUPILOT:
        waypoints = tuple(item for waypoint in waypoints for item in (_turn(waypoint), waypoint))
    takeoff = MissionItem(_TAKEOFF, *_integers(start), climb_m)
    land = MissionItem(_LAND, *_integers(places[-1]), 0.0)
    place_holder = MissionItem(_WAYPOINT, *_integers(start), 0.0)
    return (*(place_holder,) * dialect.value, takeoff, *waypoints, land)


def _turn(waypoint: MissionItem) -> MissionItem:
    """Return the turn before a waypoint: param1 is the heading, param4 that it is none relative to the present one."""
    return MissionItem(_TURN, 0, 0, 0.0, hold_s=waypoint.heading_deg or 0.0, heading_deg=0.0)


def _hold_s(hold_s: float, dialect: Dialect) -> float:
    """Return a hold as an autopilot keeps it: ArduPilot cuts parts of a second off, so it is told the next one."""
    return float(math.ceil(hold_s)) if dialect is Dialect.ARDUPILOT else hold_s


def _integers(place: Place) -> Tuple[int, int]:
    return round(place.latitude_deg * _DEGREES), round(place.longitude_deg * _DEGREES)


def waypoint_index(number: int, dialect: Dialect) -> int:
    """Return which waypoint an item is, from 0; negative before the first, their count for the landing."""
    return (number - dialect.value - 1) // _EACH[dialect]


def beginning(number: int, dialect: Dialect) -> int:
    """Return the item with which a waypoint begins: the turn before it, where there is one."""
    after_takeoff = number - dialect.value
    return number - 1 if dialect is Dialect.ARDUPILOT and after_takeoff > 1 and after_takeoff % 2 == 0 else number


_Same = Callable[[float, float], bool]


def _within(tolerance: float) -> _Same:
    return lambda sent, read: abs(sent - read) <= tolerance


def _anything(_sent: float, _read: float) -> bool:
    return True


def _whole(sent: float, read: float) -> bool:
    return sent == read


#: field, how much of it each autopilot keeps
_KEPT: Tuple[Tuple[str, Mapping[Dialect, _Same]], ...] = (
    ("command", {Dialect.PX4: _whole, Dialect.ARDUPILOT: _whole}),
    ("x", {Dialect.PX4: _within(2), Dialect.ARDUPILOT: _within(2)}),  # a double of degrees
    ("y", {Dialect.PX4: _within(2), Dialect.ARDUPILOT: _within(2)}),
    ("z", {Dialect.PX4: _within(0.01), Dialect.ARDUPILOT: _within(0.011)}),  # a float; centimetres
    ("autocontinue", {Dialect.PX4: _whole, Dialect.ARDUPILOT: _anything}),
    ("param1", {Dialect.PX4: _within(0.01), Dialect.ARDUPILOT: _within(0.01)}),
    ("param2", {Dialect.PX4: _within(0.01), Dialect.ARDUPILOT: _anything}),
    ("param3", {Dialect.PX4: _within(0.01), Dialect.ARDUPILOT: _anything}),
    ("param4", {Dialect.PX4: lambda sent, read: _turned(sent, read) <= 0.1, Dialect.ARDUPILOT: _anything}),  # noqa: PLR2004 - degrees; not kept
)


_KEPT_OF_TURN = (*_KEPT[:-1], ("param4", dict.fromkeys(Dialect, _whole)))  # param4 is no yaw there


def _turned(sent: float, read: float) -> float:
    """Return the angle between two headings; no heading differs from none."""
    if math.isnan(sent):
        return 0.0
    return abs((read - sent + 180.0) % 360.0 - 180.0) if math.isfinite(read) else math.inf


def difference(items: Sequence[MissionItem], number: int, read: Message, dialect: Dialect) -> str:
    """Return how an item that was read back differs from what was sent; empty when it does not."""
    if number < dialect.value:
        return ""
    forgets = dialect is Dialect.ARDUPILOT and read.command in _NOWHERE
    if _FRAMES.get(read.frame) is None and not forgets:
        return f"item {number} came back in frame {read.frame}"
    sent = items[number].message(number, (0, 0))
    for field, kept in _KEPT_OF_TURN if sent.command == _TURN else _KEPT:
        before, after = getattr(sent, field), getattr(read, field)
        if not kept[dialect](before, after):
            return f"item {number} came back with {field} {_shown(after)} instead of {_shown(before)}"
    return ""


def _shown(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.6g}"


# --- the protocol -----------------------------------------------------------------------------------------------------


_MISSION = mavlink.MAV_MISSION_TYPE_MISSION
_ACCEPTED = mavlink.MAV_MISSION_ACCEPTED
_RESENDS = 9  # of one message, before the transfer begins anew: PX4 forgets one after 5 s without a word
_ACK_PATIENCE = 2  # how long the acknowledgement is waited for, in pauses


class UploadPhase(enum.Enum):
    """How far a transfer is."""

    COUNT = "announcing"
    ITEMS = "sending"
    LIST = "asking back"
    READ = "reading back"
    CURRENT = "setting the first item"
    DONE = "done"
    FAILED = "failed"


_OVER = (UploadPhase.DONE, UploadPhase.FAILED)


class MissionUpload:
    """One transfer.

    Args:
        items: of the mission.
        target: system and component of the vehicle.
        t_ns: now.
        retry_ns: time without an answer after which a message is sent again.
        limit_ns: time for the whole.
        dialect: of the autopilot.
        reads_only: the mission is there, and is only read and compared; another one is not replaced.
        sets_current: its first item is set in the end; False: it is being flown.
    """

    def __init__(
        self,
        items: Sequence[MissionItem],
        target: Tuple[int, int],
        t_ns: int,
        retry_ns: int,
        limit_ns: int,
        dialect: Dialect = Dialect.PX4,
        *,
        reads_only: bool = False,
        sets_current: bool = True,
    ) -> None:
        self._items, self._target, self._dialect = tuple(items), target, dialect
        self._retry_ns, self._deadline_ns = retry_ns, t_ns + limit_ns
        self._reads_only, self._sets_current = reads_only, sets_current
        self.differs = False  # another mission was read
        self.phase = UploadPhase.LIST if reads_only else UploadPhase.COUNT
        self.reason = ""
        self._sent_ns, self._resends = t_ns, 0
        self._asked = -1  # the highest item that the vehicle asked for
        self._last: Optional[int] = None  # the one that was sent last
        self._read: Dict[int, Message] = {}

    @property
    def total(self) -> int:
        """How many items MISSION_CURRENT says that the vehicle has then: ArduPilot's first, home, is not counted."""
        return len(self._items) - self._dialect.value

    @property
    def over(self) -> bool:
        """True when it has ended, well or not."""
        return self.phase in _OVER

    def verification(self, t_ns: int, limit_ns: int, *, sets_current: bool = True) -> MissionUpload:
        """Return what reads the same mission once more: somebody else may have changed it meanwhile."""
        same = (self._items, self._target, t_ns, self._retry_ns, limit_ns, self._dialect)
        return MissionUpload(*same, reads_only=True, sets_current=sets_current)

    def start(self, t_ns: int) -> List[Message]:
        """Return the first message."""
        return self._send(t_ns)

    def cancel(self) -> List[Message]:
        """Return what tells the vehicle that it is given up, and that another transfer may begin."""
        cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
        return [] if self.over else [mavlink.MAVLink_mission_ack_message(*self._target, cancelled)]

    def receive(self, t_ns: int, message: Message) -> List[Message]:
        """Take a message of the vehicle."""
        take = None if self.over else _TAKES.get((self.phase, message.get_type()))
        if take is None or getattr(message, "mission_type", _MISSION) != _MISSION:
            return []
        return take(self, t_ns, message)

    def wake(self, t_ns: int) -> List[Message]:
        """Look at the time: give up, send again, or begin anew."""
        if self.over:
            return []
        if t_ns >= self._deadline_ns:
            return self._fail(f"{self.phase.value}: no end within the limit{self._because()}")
        if t_ns < self._sent_ns + self._retry_ns:
            return []
        self._resends += 1
        if self.phase is UploadPhase.ITEMS and self._last == len(self._items) - 1 and self._resends >= _ACK_PATIENCE:
            return self._enter(t_ns, UploadPhase.LIST)  # the acknowledgement may be lost: look what is there
        stuck = self._resends > _RESENDS  # the vehicle may have forgotten the transfer
        if stuck and self.phase is UploadPhase.ITEMS:
            return self._again(t_ns, "no answer")
        if stuck and self.phase is UploadPhase.READ:
            self.reason = "no answer"
            return self._enter(t_ns, UploadPhase.LIST)
        return self._send(t_ns)

    # --- what comes -----------------------------------------------------------------------------------------------

    def _take_request(self, t_ns: int, message: Message) -> List[Message]:
        number = message.seq
        if not 0 <= number < len(self._items):
            return []
        self.phase, self._last = UploadPhase.ITEMS, number
        self._asked = max(self._asked, number)
        self._sent_ns, self._resends = t_ns, 0
        return [self._items[number].message(number, self._target)]

    def _take_ack(self, t_ns: int, message: Message) -> List[Message]:
        """Take the end of the upload; an early "accepted" is of another transfer."""
        if message.type != _ACCEPTED:
            return self._again(t_ns, f"the autopilot says {_result(message.type)}", wait=True)
        if self._asked == len(self._items) - 1:
            return self._enter(t_ns, UploadPhase.LIST)
        return []

    def _take_count(self, t_ns: int, message: Message) -> List[Message]:
        if message.count != len(self._items):
            return self._again(t_ns, f"it has {message.count} items instead of {len(self._items)}")
        self._read.clear()
        return self._enter(t_ns, UploadPhase.READ)

    def _take_item(self, t_ns: int, message: Message) -> List[Message]:
        number = message.seq
        if number != len(self._read):
            return []  # doubled, or late
        wrong = difference(self._items, number, message, self._dialect)
        if wrong:
            return self._again(t_ns, wrong)
        self._read[number] = message
        if len(self._read) < len(self._items):
            return self._enter(t_ns, UploadPhase.READ)
        ack = mavlink.MAVLink_mission_ack_message(*self._target, _ACCEPTED)
        if not self._sets_current:
            self.phase = UploadPhase.DONE
            return [ack]
        return [ack, *self._enter(t_ns, UploadPhase.CURRENT)]

    def _take_refusal(self, t_ns: int, message: Message) -> List[Message]:
        """Take an acknowledgement while reading back: an error, or a late one of the upload."""
        if message.type == _ACCEPTED:
            return []
        if self._reads_only:  # it is busy with somebody else's transfer: asked again after a pause
            self.reason = f"the autopilot says {_result(message.type)}"
            return []
        return self._again(t_ns, f"the autopilot says {_result(message.type)}", wait=True)

    def _take_current(self, _: int, message: Message) -> List[Message]:
        if message.seq <= self._dialect.value:  # ArduPilot begins at 1: its item 0 is home
            self.phase = UploadPhase.DONE
        return []

    # --- what goes ------------------------------------------------------------------------------------------------

    def _send(self, t_ns: int) -> List[Message]:
        self._sent_ns = t_ns
        return [_SENDS[self.phase](self)]

    def _enter(self, t_ns: int, phase: UploadPhase) -> List[Message]:
        self.phase, self._resends = phase, 0
        return self._send(t_ns)

    def _again(self, t_ns: int, reason: str, *, wait: bool = False) -> List[Message]:
        """Begin anew, at once or after a pause; what is only read is another mission, then."""
        if self._reads_only:
            self.differs = True
            return self._fail(reason)
        self.reason = reason
        self._asked, self._last = -1, None
        self._read.clear()
        self.phase, self._resends, self._sent_ns = UploadPhase.COUNT, 0, t_ns
        return [] if wait else self._send(t_ns)

    def _fail(self, reason: str) -> List[Message]:
        self.phase, self.reason = UploadPhase.FAILED, reason
        return []

    def _because(self) -> str:
        return f" ({self.reason})" if self.reason else ""

    def _count(self) -> Message:
        return mavlink.MAVLink_mission_count_message(*self._target, len(self._items))

    def _item(self) -> Message:
        number = self._last or 0
        return self._items[number].message(number, self._target)

    def _list(self) -> Message:
        return mavlink.MAVLink_mission_request_list_message(*self._target)

    def _request(self) -> Message:
        return mavlink.MAVLink_mission_request_int_message(*self._target, len(self._read))

    def _current(self) -> Message:
        return mavlink.MAVLink_mission_set_current_message(*self._target, 0)


def _result(number: int) -> str:
    found = mavlink.enums["MAV_MISSION_RESULT"].get(number)
    return str(found.name) if found else f"result {number}"


_Take = Callable[[MissionUpload, int, Message], List[Message]]
_P = UploadPhase
_TAKES: Mapping[Tuple[UploadPhase, str], _Take] = {
    (_P.COUNT, "MISSION_REQUEST"): MissionUpload._take_request,  # noqa: SLF001 - the table of this class
    (_P.COUNT, "MISSION_REQUEST_INT"): MissionUpload._take_request,  # noqa: SLF001
    (_P.COUNT, "MISSION_ACK"): MissionUpload._take_ack,  # noqa: SLF001
    (_P.ITEMS, "MISSION_REQUEST"): MissionUpload._take_request,  # noqa: SLF001
    (_P.ITEMS, "MISSION_REQUEST_INT"): MissionUpload._take_request,  # noqa: SLF001
    (_P.ITEMS, "MISSION_ACK"): MissionUpload._take_ack,  # noqa: SLF001
    (_P.LIST, "MISSION_COUNT"): MissionUpload._take_count,  # noqa: SLF001
    (_P.LIST, "MISSION_ACK"): MissionUpload._take_refusal,  # noqa: SLF001
    (_P.READ, "MISSION_ITEM_INT"): MissionUpload._take_item,  # noqa: SLF001
    (_P.READ, "MISSION_ACK"): MissionUpload._take_refusal,  # noqa: SLF001
    (_P.CURRENT, "MISSION_CURRENT"): MissionUpload._take_current,  # noqa: SLF001
}
UPLOAD_MESSAGES = tuple(sorted({name for _, name in _TAKES}))
"""Names of the messages that are looked at."""
_SENDS: Mapping[UploadPhase, Callable[[MissionUpload], Message]] = {
    _P.COUNT: MissionUpload._count,  # noqa: SLF001
    _P.ITEMS: MissionUpload._item,  # noqa: SLF001
    _P.LIST: MissionUpload._list,  # noqa: SLF001
    _P.READ: MissionUpload._request,  # noqa: SLF001
    _P.CURRENT: MissionUpload._current,  # noqa: SLF001
}
