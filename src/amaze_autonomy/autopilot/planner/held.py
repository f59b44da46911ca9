"""What somebody else may have changed in the hold or in the air: the mission, where it goes on, home. Pure.

Looked at while it holds by our command: is the mission ours, and are both where they were? And all the time in the air:
do heights still count from the same home? (below)

A PX4 tells a checksum of its mission in MISSION_CURRENT, an ArduPilot the number of its items alone, mavros neither. So
it is read, and nothing but read, again and again while it is held, and once more when it is to go on: that waits for
this reading. Where the reading takes too long for that (many items, a slow way), one in the hold must do, and what was
changed after it is found out in flight. Another mission is believed when two readings in a row differ.

"Go to location" of a ground station (DO_REPOSITION) leaves a PX4 in AUTO.LOITER. From the new place the mission would
go on over a way that nobody has checked. So it would from another item ("set current waypoint", MISSION_SET_CURRENT): a
mission that is held does not advance by itself.
"""

from __future__ import annotations

import math
from typing import Callable, Dict, List, NamedTuple, Optional, Tuple

from ..link.dialect import Message
from ..vehicle.agreement import Agreement
from ..vehicle.modes import HOLD
from .mission_upload import Dialect, MissionUpload, UploadPhase, waypoint_index
from .mission_vehicle import HomePlace, Pose, VehicleWatch

_S = 1_000_000_000
_PAUSE_NS = 2_000_000_000  # between two readings in a hold: others may want to read as well
_IN_A_ROW = 2
MOVED = "somebody else has moved it in the hold"
_MOVED_M = 5.0  # further than a gust pushes, and than a hold drifts; where one may take off says nothing of it
CHOSEN = "somebody else has chosen another item of the mission in the hold"
_STANDS_NS, _CHOSEN_NS = 1_500_000_000, 1_000_000_000  # so long messages agree; one may be late, from before the hold
_AGREE_NS = 500_000_000
_SLOW_M_S, _SLOW_NS = 1.0, 1_000_000_000  # it comes to rest; a vehicle that swings back is slow for a moment only


class HeldMission:
    """The readings of one hold.

    Args:
        begin: returns what reads the mission once; called with the time.
        patience_ns: how long going on waits for a first reading that agrees.
        t_ns: now.
        agreed_patience_ns: the same for the reading that begins then, where one in the hold has agreed.
    """

    def __init__(
        self, begin: Callable[[int], MissionUpload], patience_ns: int, t_ns: int, *, agreed_patience_ns: int
    ) -> None:
        self._begin, self._patience_ns, self._agreed_patience_ns = begin, patience_ns, agreed_patience_ns
        self._reading: Optional[MissionUpload] = None
        self._given_up: List[Message] = []  # says that the reading before was given up: what answers it is old
        self._begun_ns = self._due_ns = t_ns
        self._agreed_ns: Optional[int] = None  # when the last one that agreed was begun
        self._resumed_ns: Optional[int] = None
        self._others = 0
        self.difference = ""  # of somebody else's mission, in words; empty: none was found

    def hold(self) -> None:
        """Take that the mission is held; what was read before it went on counts no more."""
        self._agreed_ns = None if self.over else self._agreed_ns
        self._resumed_ns = None

    def resume(self, t_ns: int) -> None:
        """Take that the mission is to go on: it is read anew, except where none has agreed yet."""
        self._resumed_ns = self._due_ns = t_ns
        if self._agreed_ns is not None and self._reading is not None:
            self._given_up, self._reading = self._reading.cancel(), None

    def may_go_on(self, t_ns: int) -> bool:
        """Return whether the mission is ours, as far as that is known in time."""
        if self._resumed_ns is None or self._agreed_ns is None or self._others:
            return False
        return self.over or t_ns - self._resumed_ns >= self._agreed_patience_ns

    def is_late(self, t_ns: int) -> bool:
        """Return whether it is not known in time."""
        late = self._resumed_ns is not None and t_ns - self._resumed_ns >= self._patience_ns
        return late and not self.may_go_on(t_ns)

    @property
    def over(self) -> bool:
        """True once it was read, and is ours, since it was to go on."""
        return self._resumed_ns is not None and self._agreed_ns is not None and self._agreed_ns >= self._resumed_ns

    def receive(self, t_ns: int, message: Message) -> List[Message]:
        """Take a message of the vehicle."""
        reading = self._reading
        return [] if reading is None else self._after(t_ns, reading, reading.receive(t_ns, message))

    def wake(self, t_ns: int) -> List[Message]:
        """Look at the time, where something may be sent."""
        reading = self._reading
        if reading is not None:
            return self._after(t_ns, reading, reading.wake(t_ns))
        if self.over or self.difference or t_ns < self._due_ns:
            return []
        self._reading, self._begun_ns = self._begin(t_ns), t_ns
        given_up, self._given_up = self._given_up, []
        return [*given_up, *self._reading.start(t_ns)]

    def _after(self, t_ns: int, reading: MissionUpload, sent: List[Message]) -> List[Message]:
        if not reading.over:
            return sent
        self._reading, self._due_ns = None, t_ns
        if reading.phase is UploadPhase.DONE:
            self._agreed_ns, self._others = self._begun_ns, 0
            self._due_ns += _PAUSE_NS if self._resumed_ns is None else 0
        elif reading.differs:
            self._others += 1
            self.difference = reading.reason if self._others >= _IN_A_ROW else ""
        return sent


class HeldPlace:
    """Where it came to rest in a hold.

    Args:
        watch: the vehicle.
    """

    def __init__(self, watch: VehicleWatch) -> None:
        self._watch = watch
        self.moved = False  # in this flight
        self._place: Optional[Tuple[float, float, float]] = None
        self._slow, self._far = Agreement(), Agreement()
        self._said_ns = 0
        self._left_ns = -1

    @property
    def words(self) -> str:
        """What somebody else has done, in words; empty: nothing."""
        return MOVED if self.moved else ""

    def leave(self, t_ns: int) -> None:
        """Take that the vehicle is told to go on: where it was counts no more, and no mode that it has told so far."""
        self._place, self._slow, self._left_ns = None, Agreement(), t_ns

    def look(self, pose: Optional[Pose]) -> None:
        """Look at a position that is fresh, while the vehicle is not told to go on; None: there is none."""
        if (self._watch.mode_ns or 0) <= self._left_ns:
            return
        if self._watch.mode != HOLD:
            if self._watch.keeps_mode:  # the next hold is another one
                self._place, self._slow = None, Agreement()
            return
        if pose is None or pose.t_ns == self._said_ns:
            return
        self._said_ns = pose.t_ns
        if self._place is None:
            self._slow.add(pose.t_ns, so=pose.speed_m_s < _SLOW_M_S)
            if self._slow.lasts(_SLOW_NS):
                self._place, self._far = pose.position_m, Agreement()
            return
        self._far.add(pose.t_ns, so=math.dist(self._place, pose.position_m) > _MOVED_M)
        self.moved = self.moved or self._far.lasts(_AGREE_NS)


class HeldItem:
    """At which waypoint its mission stands in a hold.

    Behind mavros it is told on a change, and with each pull of the mission: more seldom than any stream comes.

    Args:
        watch: the vehicle.
    """

    def __init__(self, watch: VehicleWatch) -> None:
        self._watch = watch
        self.chosen = False  # another one, in this flight
        self._left_ns = -1
        self._forget()

    def _forget(self) -> None:
        self.item: Optional[int] = None  # at which it stands, once messages agree
        self._waypoints: Tuple[int, ...] = ()
        self._same, self._other = Agreement(gap_ns=None), Agreement(gap_ns=None)

    @property
    def words(self) -> str:
        """What somebody else has done, in words; empty: nothing."""
        return CHOSEN if self.chosen else ""

    def leave(self, t_ns: int) -> None:
        """Take that the vehicle is told to go on: nothing counts any more of what it has told so far."""
        self._forget()
        self._left_ns = t_ns

    def expect(self, item: int) -> None:
        """Take that it is sent to an item by us."""
        self._waypoints += (waypoint_index(item, self._watch.dialect),) if self.item is not None else ()

    def look(self) -> None:
        """Take a MISSION_CURRENT; of an ArduPilot, a turn and its waypoint are the same."""
        watch = self._watch
        if watch.current is None or watch.current_ns is None or (watch.mode_ns or 0) <= self._left_ns:
            return
        if watch.mode != HOLD:
            if watch.keeps_mode:  # the next hold is another one
                self._forget()
            return
        if not watch.keeps_mode:
            return
        waypoint = waypoint_index(watch.current, watch.dialect)
        if self.item is None:
            if self._waypoints != (waypoint,):
                self._waypoints, self._same = (waypoint,), Agreement(gap_ns=None)
            self._same.add(watch.current_ns, so=True)
            self.item = watch.current if self._same.lasts(_STANDS_NS) else None
            return
        self._other.add(watch.current_ns, so=waypoint not in self._waypoints)
        self.chosen = self.chosen or self._other.lasts(_CHOSEN_NS)


# --- home set anew in the air -----------------------------------------------------------------------------------------
# The heights of a mission count from home, so all that are left would move.
#
# Home, as what the vehicle says of itself has it: its local height less its height above home, and its height above the
# sea less that. A reset or a drift of its estimate moves all of them alike. Both must say that home has moved: an
# autopilot may take its height above the sea from another sensor, and two messages are of two moments. Behind mavros no
# height above the sea comes.
#
# A PX4 sets home once more when it notices that it has left the ground, so it is kept from what comes after that. For
# two minutes from there it may correct its height by itself where its GPS drifts (its `HomePosition`): nobody's doing,
# if its place stays. What that has moved is not gone on with after a hold, and not given up in flight; likewise where
# no height above the sea comes, and nothing says that its place has moved as well.


HOME_TOLERANCE_M = 1.0  # of its height: as far as an estimate of height may be off
_HOME_AGREE_NS = _S  # so long messages must say the same height of home
_APART_S = 0.25  # between what is said of the two heights
_CLIMB_M_S, _CLIMB_M = 1.0, 0.25  # where no message says when it was so: above that the two are not compared
_FOLLOWS = 0.05  # of the difference, with each message: a drift is no home that somebody has set
_CORRECTS_NS = 130 * _S  # after its takeoff; of a PX4: 120 s
_PLACE_M = 1.0


class _Height(NamedTuple):
    """Height of home: in the local frame, and above the sea; None: that is not said."""

    local_m: float
    sea_m: Optional[float]

    def away_m(self, other: _Height) -> float:
        """Return how much higher this is than another one, as far as both agree on it."""
        local_m = self.local_m - other.local_m
        if self.sea_m is None or other.sea_m is None:
            return local_m
        sea_m = self.sea_m - other.sea_m
        return min(local_m, sea_m, key=abs) if local_m * sea_m > 0.0 else 0.0

    def nearer(self, other: _Height) -> _Height:
        """Return it a little nearer to another one."""
        sea_m = None if self.sea_m is None or other.sea_m is None else _part(self.sea_m, other.sea_m)
        return _Height(_part(self.local_m, other.local_m), sea_m)


def _part(old_m: float, new_m: float) -> float:
    return old_m + _FOLLOWS * (new_m - old_m)


class HomeHeight:
    """The height of home in one flight.

    Args:
        watch: the vehicle.
    """

    def __init__(self, watch: VehicleWatch) -> None:
        self._watch = watch
        self.moved_m: Optional[float] = None  # so much higher it was set in the air; None: it was not
        self._sure = False  # no autopilot sets it so by itself
        self._begin()

    def _begin(self) -> None:
        """Begin anew: what was home is set by the takeoff."""
        self._height: Optional[_Height] = None
        self._new: Optional[_Height] = None  # what the last messages say
        self._same = Agreement()
        self._places: Dict[bool, HomePlace] = {}
        self._starts, self._aloft_ns, self._said_ns = self._watch.power_on.starts, 0, 0

    @property
    def words(self) -> str:
        """What has happened, in words; empty: nothing."""
        if self.moved_m is None:
            return ""
        where = "higher" if self.moved_m > 0.0 else "lower"
        return f"home was set anew in the air: heights count from {abs(self.moved_m):.1f} m {where}"

    @property
    def is_set_by_others(self) -> bool:
        """Return whether it has moved as no autopilot moves it by itself."""
        if self.moved_m is None:
            return False
        pairs = [(was, self._watch.homes[kind]) for kind, was in self._places.items()]
        return self._sure or any(math.dist(was.where_m, now.where_m) > _PLACE_M for was, now in pairs)

    def look(self, pose: Optional[Pose]) -> None:
        """Look at what the vehicle says of its heights, with a local position that is fresh; None: there is none."""
        watch = self._watch
        on_ground = watch.ground.stands(watch.landed_ns or 0, 0)  # one message that says so may be wrong
        if on_ground or watch.power_on.starts != self._starts:
            self._begin()
            return
        if not watch.is_aloft:
            return
        self._aloft_ns = self._aloft_ns or watch.place_ns
        for kind, home in watch.homes.items():
            if home.t_ns > self._aloft_ns:
                self._places.setdefault(kind, home)
        if watch.place_ns in (self._said_ns, self._aloft_ns) or pose is None or self.moved_m is not None:
            return
        before_ns, self._said_ns = self._said_ns, watch.place_ns
        height = self._said(pose, (self._said_ns - before_ns) / _S)
        if height is not None:
            self._take(height)

    def _said(self, pose: Pose, pause_s: float) -> Optional[_Height]:
        """Return where home is by what was said of both heights at the same moment; None: nobody knows.

        Behind mavros, where no message says when it was, the height above home is that of a pause ago.
        """
        watch = self._watch
        if watch.place_on_ms and pose.on_ms:
            apart_s = (watch.place_on_ms - pose.on_ms) / 1e3
        else:
            apart_s = (watch.place_ns - pose.t_ns) / _S
            climb_m_s = abs(pose.velocity_m_s[2])
            if climb_m_s > _CLIMB_M_S or climb_m_s * pause_s > _CLIMB_M:
                return None
        if abs(apart_s) > _APART_S or not watch.has_height(pose.t_ns):
            return None
        up_m = pose.position_m[2] + pose.velocity_m_s[2] * apart_s
        return _Height(up_m - watch.height_m, watch.sea_m - watch.height_m if watch.sea_m else None)

    def _take(self, height: _Height) -> None:
        if self._height is not None and abs(height.away_m(self._height)) <= HOME_TOLERANCE_M:
            self._height, self._new = self._height.nearer(height), None
            return
        if self._new is None or abs(height.away_m(self._new)) > HOME_TOLERANCE_M / 2:
            self._new, self._same = height, Agreement()
        self._same.add(self._said_ns, so=True)
        if not self._same.lasts(_HOME_AGREE_NS):
            return
        if self._height is None:
            self._height, self._new = self._new, None
        else:
            self.moved_m = height.away_m(self._height)
            patient = self._watch.dialect is Dialect.ARDUPILOT or self._said_ns - self._aloft_ns > _CORRECTS_NS
            self._sure = patient and height.sea_m is not None
