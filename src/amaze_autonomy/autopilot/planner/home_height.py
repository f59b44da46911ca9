"""Whether home is set anew in the air: the heights of a mission count from home, so all that are left would move. Pure.

Home, as what the vehicle says of itself has it: its local height less its height above home, and its height above the
sea less that. A reset or a drift of its estimate moves all of them alike. Both must say that home has moved: an
autopilot may take its height above the sea from another sensor, and two messages are of two moments. Behind mavros no
height above the sea comes.

A PX4 sets home once more when it notices that it has left the ground, so it is kept from what comes after that. For two
minutes from there it may correct its height by itself where its GPS drifts (its `HomePosition`): nobody's doing, if its
place stays. What that has moved is not gone on with after a hold, and not given up in flight; likewise where no height
above the sea comes, and nothing says that its place has moved as well.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Optional, Tuple

from amaze_autonomy.engine.events import VehicleLanded

from ..vehicle.agreement import Agreement
from .mission_upload import Dialect
from .mission_vehicle import Pose, VehicleWatch

_S = 1_000_000_000
HOME_TOLERANCE_M = 1.0  # of its height: as far as an estimate of height may be off
_AGREE_NS = _S  # so long messages must say the same height of home
_APART_S = 0.25  # between what is said of the two heights
_CLIMB_M_S = 1.0  # where no message says when it was so: faster than that the two are not compared
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
        self._place: Optional[Tuple[float, float]] = None
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
        place, was = self._watch.home, self._place
        away = place is not None and was is not None and math.dist(place, was) > _PLACE_M
        return self._sure or away

    def look(self, pose: Optional[Pose]) -> None:
        """Look at what the vehicle says of its heights, with a local position that is fresh; None: there is none."""
        watch = self._watch
        if watch.landed is VehicleLanded.ON_GROUND or watch.power_on.starts != self._starts:
            self._begin()
            return
        if not watch.is_aloft:
            return
        self._aloft_ns = self._aloft_ns or watch.place_ns
        if self._place is None and watch.home_ns > self._aloft_ns:
            self._place = watch.home
        if watch.place_ns in (self._said_ns, self._aloft_ns) or pose is None or self.moved_m is not None:
            return
        self._said_ns = watch.place_ns
        height = self._said(pose)
        if height is not None:
            self._take(height)

    def _said(self, pose: Pose) -> Optional[_Height]:
        """Return where home is by what was said of both heights at the same moment; None: nobody knows."""
        watch = self._watch
        if watch.place_on_ms and pose.on_ms:
            apart_s = (watch.place_on_ms - pose.on_ms) / 1e3
        else:
            apart_s = (watch.place_ns - pose.t_ns) / _S
            if abs(pose.velocity_m_s[2]) > _CLIMB_M_S:
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
        if not self._same.lasts(_AGREE_NS):
            return
        if self._height is None:
            self._height, self._new = self._new, None
        else:
            self.moved_m = height.away_m(self._height)
            patient = self._watch.dialect is Dialect.ARDUPILOT or self._said_ns - self._aloft_ns > _CORRECTS_NS
            self._sure = patient and height.sea_m is not None
