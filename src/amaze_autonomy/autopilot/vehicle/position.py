"""Where the vehicle is above and beside its takeoff place, and whether that is so.

Position messages stay fresh and come at full rate while the estimate is lost (it once ran 134 km away). Whether it is
valid is in the flags of ESTIMATOR_STATUS (PX4) or EKF_STATUS_REPORT (ArduPilot) alone; without them nothing is valid.
The takeoff place is where it stood when it was last on the ground; a link that begins in flight takes HOME_POSITION.

An ArduPilot of before 4.4 says there that the local place of home is 0, 0, 0 wherever it is, a newer one where home is
the origin of its local frame, or while it has none. There zeros count as where home and origin are on the earth.
"""

from __future__ import annotations

from math import cos, isfinite, radians, sqrt
from typing import Any, List, NamedTuple, Optional, Tuple

from ..link.dialect import mavlink

Vector = Tuple[float, float, float]

_VELOCITY_VERTICAL = mavlink.ESTIMATOR_VELOCITY_VERT
_HORIZONTAL = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS
_VELOCITY_HORIZONTAL = mavlink.ESTIMATOR_VELOCITY_HORIZ
_VERTICAL = mavlink.ESTIMATOR_POS_VERT_ABS
_ARDUPILOT_BAD = mavlink.EKF_CONST_POS_MODE | mavlink.EKF_UNINITIALIZED
_APART_NS = 50_000_000  # of what comes in less behind a stall nobody knows the order
_JUMP_M = 1.0  # between two positions, beyond what their speed explains: the frame was set anew
_S = 1_000_000_000
_FARTHEST_M = 1e6  # of what is believed to be a number at all
_NOWHERE: Vector = (0.0, 0.0, 0.0)
_ARDUPILOT_M = 0.011131884502145034  # of 1e-7 degrees of latitude, on the sphere of which its local frame is made
_DEG7, _MM = 1e-7, 1e-3
_TURN = 3_600_000_000  # in 1e-7 degrees


class OnEarth(NamedTuple):
    """A place on the earth as MAVLink says it: 1e-7 degrees, and mm above the sea."""

    latitude: int
    longitude: int
    altitude: int


class Place(NamedTuple):
    """East, north and up of the takeoff place in m, m/s upwards and over ground; None is unknown."""

    east_m: Optional[float] = None
    north_m: Optional[float] = None
    up_m: Optional[float] = None
    climb_m_s: Optional[float] = None
    ground_m_s: Optional[float] = None


class Position:
    """The local position, what its flags say, and the takeoff place.

    Args:
        age_limit_ns: older than this, position and flags say nothing.
        speed_age_limit_ns: older than this, the speeds of a position say nothing.
    """

    def __init__(self, age_limit_ns: int, speed_age_limit_ns: int) -> None:
        self._age_limit_ns, self._speed_age_limit_ns = age_limit_ns, speed_age_limit_ns
        self._local: Optional[Tuple[int, Vector, Vector]] = None
        self._flags: Optional[Tuple[int, int]] = None
        self._good: List[Tuple[int, Vector]] = []  # the last two with a valid height, that did not come at once
        self._takeoff: Optional[Vector] = None
        self._stood: Optional[Vector] = None  # what it is when it has lifted off
        self._at_rest = False
        self._home: Optional[Vector] = None
        self._home_on_earth: Optional[OnEarth] = None
        self._origin: Optional[OnEarth] = None
        self.home_ns: Optional[int] = None
        self._bad = 0

    def add_local(self, t_ns: int, message: Any) -> None:
        """Take a LOCAL_POSITION_NED."""
        where = (message.x, message.y, message.z)
        if not all(isfinite(value) and abs(value) < _FARTHEST_M for value in where):
            self._local = None
            return
        speed = (message.vx, message.vy, message.vz)
        if self._stood is not None and self._at_rest:
            step = self._jump(t_ns, where, speed)
            self._stood = (self._stood[0] + step[0], self._stood[1] + step[1], self._stood[2] + step[2])
        self._local = (t_ns, where, speed)
        if self._has(t_ns, _VERTICAL) and (not self._good or t_ns - self._good[-1][0] >= _APART_NS):
            self._good = [*self._good[-1:], (t_ns, where)]

    def _jump(self, t_ns: int, where: Vector, speed: Vector) -> Vector:
        """Return how far the frame has jumped since the last position: what the vehicle's speed does not explain."""
        if self._local is None or t_ns - self._local[0] > self._speed_age_limit_ns:
            return _NOWHERE
        passed_s, before = (t_ns - self._local[0]) / _S, self._local[1]
        step = (where[0] - before[0], where[1] - before[1], where[2] - before[2])
        return step if any(abs(way - v * passed_s) > _JUMP_M for way, v in zip(step, speed)) else _NOWHERE

    def rest(self, t_ns: int, *, final: bool) -> None:
        """Take a position that comes at rest: heights count from it at once, whatever its frame did.

        Args:
            t_ns: when it came.
            final: whether they do after the lift-off, too; else from what came before ON_GROUND was said last.
        """
        if self._local is not None and self._has(t_ns, _VERTICAL):
            self._takeoff = self._local[1]
            self._stood = self._takeoff if final else self._stood if self._at_rest else None
            self._at_rest = True

    def stand(self, t_ns: int) -> None:
        """Remember the last position of before ON_GROUND was said: behind mavros what comes at once has no order."""
        before = [each for each in self._good if _APART_NS <= t_ns - each[0] <= self._speed_age_limit_ns]
        if before:
            self._stood = before[-1][1]

    def leave(self) -> None:
        """Count from where it was known to stand: it does not rest any more, and lifted off before that was said."""
        self._at_rest = False
        self._takeoff = self._stood = self._stood or self._takeoff

    def add_px4_flags(self, t_ns: int, message: Any) -> None:
        """Take an ESTIMATOR_STATUS; PX4 also sets CONST_POS_MODE at rest on the ground, where it says nothing."""
        self._flags, self._bad = (t_ns, message.flags), 0

    def add_ardupilot_flags(self, t_ns: int, message: Any) -> None:
        """Take an EKF_STATUS_REPORT."""
        self._flags, self._bad = (t_ns, message.flags), _ARDUPILOT_BAD

    def add_home(self, t_ns: int, message: Any) -> None:
        """Take a HOME_POSITION, which moves by half a metre after arming."""
        self.home_ns = t_ns
        where = (message.x, message.y, message.z)
        if all(isfinite(value) and abs(value) < _FARTHEST_M for value in where):
            self._home = where
        if message.latitude or message.longitude:  # made of mavros' topic it has none
            self._home_on_earth = OnEarth(message.latitude, message.longitude, message.altitude)

    def add_origin(self, _t_ns: int, message: Any) -> None:
        """Take a GPS_GLOBAL_ORIGIN: where the local frame begins."""
        self._origin = OnEarth(message.latitude, message.longitude, message.altitude)

    @property
    def judged(self) -> bool:
        """Whether its estimator ever said how good its estimate is."""
        return self._flags is not None

    def valid(self, t_ns: int) -> bool:
        """Return whether the estimator stands by its horizontal position."""
        return self._has(t_ns, _HORIZONTAL) and self._has(t_ns, _VELOCITY_HORIZONTAL)

    def place(self, t_ns: int) -> Place:
        """Return where the vehicle is, as far as the estimator stands by it."""
        start = self._takeoff or self._local_home
        if self._local is None or t_ns - self._local[0] > self._age_limit_ns:
            return Place()
        told_ns, (north, east, down), (vx, vy, sinking) = self._local
        moves = t_ns - told_ns <= self._speed_age_limit_ns
        climb = -sinking if moves and self._has(t_ns, _VELOCITY_VERTICAL) and isfinite(sinking) else None
        speed = sqrt(vx * vx + vy * vy) if moves and self._has(t_ns, _VELOCITY_HORIZONTAL) else None
        if start is None:
            return Place(climb_m_s=climb, ground_m_s=speed)
        up = start[2] - down if self._has(t_ns, _VERTICAL) else None
        if not self.valid(t_ns):
            return Place(up_m=up, climb_m_s=climb, ground_m_s=speed)
        return Place(east - start[1], north - start[0], up, climb, speed)

    def forget_takeoff(self) -> None:
        """Forget the takeoff place: the autopilot has started again, and its origin with it."""
        self._local, self._good = None, []  # of the frame before
        self._takeoff = self._stood = self._home = self._home_on_earth = self._origin = self.home_ns = None

    @property
    def _local_home(self) -> Optional[Vector]:
        """The local place of home; None: unknown. Whose flags came tells whose zeros they are."""
        if self._home != _NOWHERE or not self._bad:
            return self._home
        home, origin = self._home_on_earth, self._origin
        return None if home is None or origin is None else _local(home, origin)

    def _has(self, t_ns: int, bits: int) -> bool:
        """Return whether any of these flags is set, freshly."""
        if self._flags is None or t_ns - self._flags[0] > self._age_limit_ns:
            return False
        flags = self._flags[1]
        if bits & (_HORIZONTAL | _VELOCITY_HORIZONTAL) and flags & self._bad:
            return False
        return bool(flags & bits)


def _local(place: OnEarth, origin: OnEarth) -> Vector:
    """Return north, east and down of the origin in m, as ArduPilot makes them."""
    half_way = radians((place.latitude + origin.latitude) / 2 * _DEG7)
    eastwards = (place.longitude - origin.longitude + _TURN // 2) % _TURN - _TURN // 2
    north, east = (place.latitude - origin.latitude) * _ARDUPILOT_M, eastwards * _ARDUPILOT_M * cos(half_way)
    return north, east, (origin.altitude - place.altitude) * _MM
