"""Whether somebody else moves a vehicle that holds by our command, in the same mode as ours. Pure.

"Go to location" of a ground station (DO_REPOSITION) leaves a PX4 in AUTO.LOITER. From the new place the mission would
go on over a way that nobody has checked.
"""

from __future__ import annotations

import math
from typing import Optional, Tuple

from ..vehicle.agreement import Agreement
from ..vehicle.modes import HOLD
from .mission_vehicle import Pose, VehicleWatch

MOVED = "somebody else has moved it in the hold"
_MOVED_M = (
    5.0  # further than a gust pushes, and than a hold drifts; a tolerance of places to take off says nothing of it
)
_AGREE_NS = 500_000_000
_SLOW_M_S, _SLOW_NS = 1.0, 1_000_000_000  # it comes to rest; a vehicle that swings back is slow for a moment only


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

    @property
    def words(self) -> str:
        """What somebody else has done, in words; empty: nothing."""
        return MOVED if self.moved else ""

    def look(self, pose: Optional[Pose]) -> None:
        """Look at a position that is fresh, while the vehicle is not told to go on; None: there is none."""
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
