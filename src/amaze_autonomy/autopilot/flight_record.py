"""What a flight has shown so far: armed, airborne, how far along its file; and which phase that is. Pure.

Level-based: any heartbeat, landed state and MISSION_CURRENT are enough to know the present. What the flight before left
behind (its mode, a MISSION_ITEM_REACHED that repeats at 1 Hz, its number) counts nothing.
"""

from __future__ import annotations

from typing import Optional

from amaze_autonomy.engine.events import MissionPhase, VehicleLanded

from .guidance import Guidance
from .mission_items import waypoint_index
from .mission_vehicle import AIRBORNE, HOLD, LAND, MISSION, OFFBOARD, VehicleWatch
from .modes import is_foreign

__all__ = ["FlightRecord"]

_COUNT_NS = 2_500_000_000  # within which an autopilot tells again at which item of the mission it is
_COUNT_BEATS = 3  # that must be heard meanwhile: a silent vehicle may still tell
_P = MissionPhase


class FlightRecord:
    """One flight of one file.

    Args:
        watch: the vehicle.
        waypoints: how many the file has.
    """

    def __init__(self, watch: VehicleWatch, waypoints: int = 0) -> None:
        self._watch, self.waypoints = watch, waypoints
        self.guidance: Optional[Guidance] = None
        self.armed = self.airborne = self.lifted = False
        self.failure = ""
        self.reached = 0
        self._highest = 0
        self._ground_ns: Optional[int] = None
        self._beat_ns: Optional[int] = None
        self._beats = 0

    @property
    def item(self) -> Optional[int]:
        """The item of its mission that the vehicle is at; None: unknown, or one that the mission does not have."""
        current = self._watch.current
        is_there = current is not None and waypoint_index(current, self._watch.dialect) <= self.waypoints
        return current if is_there else None

    def look(self) -> None:
        """Take notice of what the vehicle shows now."""
        watch = self._watch
        self.armed = self.armed or bool(watch.armed)
        self.airborne = self.airborne or (self.armed and bool(watch.armed) and watch.landed in AIRBORNE)
        self.lifted = self.lifted or (self.airborne and watch.landed is VehicleLanded.IN_AIR)
        if self.armed:
            self._count()

    def _count(self) -> None:
        """Count waypoints that are done with."""
        watch, item = self._watch, self.item
        if self.guidance is not None:
            self.reached = self.guidance.reached
            return
        if watch.mode != MISSION or not self.airborne or item is None:
            return
        self._highest = max(self._highest, item)
        done = self._highest
        if watch.reached is not None and watch.reached == self._highest:
            done = watch.reached + 1
        self.reached = max(self.reached, min(waypoint_index(done, watch.dialect), self.waypoints))

    def is_counted(self, t_ns: int, *, asked: bool) -> bool:
        """Return whether it is known how far a mission came that ended by itself: the last item may have been lost.

        Args:
            t_ns: now.
            asked: the landing was commanded.
        """
        if asked or self.guidance is not None or not self.airborne or self.reached >= self.waypoints:
            return True
        if self._ground_ns is None:
            self._ground_ns = t_ns
        heard_ns = self._watch.current_ns
        if self.item is not None and heard_ns is not None and heard_ns > self._ground_ns:
            return True
        self._beats += self._watch.heartbeat_ns != self._beat_ns
        self._beat_ns = self._watch.heartbeat_ns
        return t_ns - self._ground_ns > _COUNT_NS and self._beats > _COUNT_BEATS

    @property
    def down(self) -> bool:
        """True when it has touched down again: PX4 shows the mode before the landing, and disarms a moment later."""
        return self.airborne and self._watch.landed is VehicleLanded.ON_GROUND

    def phase(self, before: MissionPhase) -> MissionPhase:
        """Return the phase that the vehicle shows while it is armed; the one before where it shows none of ours."""
        watch = self._watch
        landing = watch.mode == LAND or watch.landed is VehicleLanded.LANDING
        if landing or (before is _P.LANDING and self.down):
            return _P.LANDING
        if watch.mode == HOLD and self.airborne:
            return _P.HOLDING
        if watch.mode == MISSION and self.airborne:
            return self._by_mission(before)
        if watch.mode == OFFBOARD and self.guidance is not None:
            return self._by_setpoints(before, self.guidance)
        return before

    def _by_mission(self, before: MissionPhase) -> MissionPhase:
        if waypoint_index(self._highest, self._watch.dialect) >= self.waypoints:
            return _P.LANDING
        climbs = before is _P.TAKING_OFF and self._watch.landed is not VehicleLanded.IN_AIR
        return _P.TAKING_OFF if climbs else _P.FLYING

    @staticmethod
    def _by_setpoints(before: MissionPhase, guidance: Guidance) -> MissionPhase:
        if guidance.still:
            return _P.HOLDING
        if guidance.standing:
            return before
        return _P.TAKING_OFF if guidance.climbing else _P.FLYING

    def hands_off(self) -> str:
        """Return who else flies, in words; empty when nobody does."""
        watch = self._watch
        if watch.armed and watch.pilot:
            return f"the pilot has control (mode {watch.mode})"
        return f"the autopilot flies by itself (mode {watch.mode})" if watch.armed and is_foreign(watch.mode) else ""
