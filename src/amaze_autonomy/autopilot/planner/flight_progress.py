"""What a flight has shown so far: armed, airborne, how far along its file; and which phase that is. Pure.

Level-based: any heartbeat, landed state and MISSION_CURRENT are enough to know the present. What the flight before left
behind (its mode, a MISSION_ITEM_REACHED that repeats at 1 Hz, its number) counts nothing.
"""

from __future__ import annotations

from typing import NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.engine.events import MissionPhase, MissionStatus, VehicleLanded
from amaze_autonomy.missions import FlightModel, Waypoint, distance_m, leg_s

from ..vehicle.modes import HOLD, LANDING_MODES, is_foreign
from .guidance import Guidance
from .held import HeldItem, HeldMission, HeldPlace, HomeHeight
from .loading import Loading, LoadRequest, Origin
from .mission_upload import waypoint_index
from .mission_vehicle import AIRBORNE, MISSION, OFFBOARD, SILENT, Pose, VehicleWatch

_COUNT_NS = 2_500_000_000  # within which an autopilot tells again at which item of the mission it is
_COUNT_BEATS = 3  # that must be heard meanwhile: a silent vehicle may still tell
_IN_A_ROW = 2  # one wrong message is not believed
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
        self.held_place, self.held_item, self.home_height = HeldPlace(watch), HeldItem(watch), HomeHeight(watch)
        self.armed = self.airborne = self.lifted = False
        self._flown = False  # it was seen in the mode that this flight is flown in
        self.failure = ""
        self.replaced = False  # what the vehicle flies is somebody else's mission, or begins anew
        self.mission_id = 0  # by which the vehicle calls its mission, once that was read back as ours; 0: it has none
        self.held: Optional[HeldMission] = None  # where it is held, and has no such id
        self.landing = ""  # why it was landed, where it was
        self._resumed_item = 0  # from which the mission goes on that was held
        self._another = False  # armed on the ground again, or long down: what flies next is somebody else's
        self._down_ns: Optional[int] = None  # since when messages agree that it is down, and it was heard
        self.reached = self._others = self._fallen_back = 0
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
        self.lifted = self.lifted or (self.airborne and watch.is_up)
        own = MISSION if self.guidance is None else OFFBOARD
        self._flown = self._flown or (self.airborne and watch.mode == own)
        if not self.seems_down:
            self._ground_ns, self._beats = None, 0
        if self.armed:
            self._count()

    def look_at_the_hold(self, pose: Optional[Pose]) -> None:
        """Look whether it is moved in a hold of a mission; by set-points it is not led far from where it stands."""
        if self.guidance is None and self.airborne:
            self.held_place.look(pose)

    def look_at_item(self) -> None:
        """Take a MISSION_CURRENT: look whether the mission stands where it did, in a hold."""
        if self.guidance is None and self.airborne:
            self.held_item.look()

    def leave_the_hold(self, t_ns: int) -> None:
        """Take that the vehicle is told to go on."""
        self.held_place.leave(t_ns)
        self.held_item.leave(t_ns)

    @property
    def passed(self) -> int:
        """The item that it is at in a hold, as messages agree; where they do not yet, as the last one says."""
        return (self.item if self.held_item.item is None else self.held_item.item) or 0

    def look_at_home(self, pose: Optional[Pose]) -> None:
        """Look whether home is set anew in the air: heights by set-points do not count from it."""
        if self.guidance is None and self.airborne:
            self.home_height.look(pose)

    @property
    def not_to_go_on(self) -> str:
        """Why a mission that is held is not gone on with in this flight, in words; empty: it may be."""
        return self.held_place.words or self.held_item.words or self.home_height.words

    def flies_from_another_home(self) -> bool:
        """Return whether it flies, by messages that agree, heights of the mission that are not ours."""
        flies = self._watch.mode == MISSION and self._watch.keeps_mode
        return flies and self.guidance is None and self.home_height.is_set_by_others

    @property
    def seems_down(self) -> bool:
        """True when the last that it said is disarmed and on the ground; whether that is so, others must agree."""
        return self._watch.armed is False and self._watch.landed is VehicleLanded.ON_GROUND

    @property
    def steered_by_others(self) -> str:
        """Who has chosen a mode of the other way to fly, once it was flown in its own, in words; empty: nobody has.

        By set-points no mission of the autopilot is ours, by one no set-points. A hold of the autopilot is looked at by
        the engine: it asks for nothing over one that is not its own.
        """
        other = MISSION if self.guidance is not None else OFFBOARD
        steered = self._flown and self.airborne and self._watch.armed and self._watch.mode == other
        return f"somebody else has chosen the flight mode (mode {self._watch.mode})" if steered else ""

    @property
    def agreed_steered_by_others(self) -> str:
        """The same, once messages agree on that mode: until then nothing is sent, and nothing is refused or ended."""
        return self.steered_by_others if self._watch.keeps_mode else ""

    def stays_down(self, t_ns: int, limit_ns: int, *, down: bool) -> None:
        """Take whether messages agree that it is down: once it has stood for long, its flight is over for good."""
        self._down_ns = None if not down else t_ns if self._down_ns is None else self._down_ns
        self._another = self._another or (self._down_ns is not None and t_ns - self._down_ns >= limit_ns)

    @property
    def is_over(self) -> bool:
        """True once it has stood for long: whoever flies then flies another flight."""
        return self._another

    def goes_on(self) -> bool:
        """Return whether a flight that was over goes on: it is armed in the air, where nobody arms a vehicle."""
        watch, armed_ns = self._watch, self._watch.ground.armed_ns
        if watch.landed is VehicleLanded.ON_GROUND and armed_ns is not None:
            self._another = self._another or (watch.landed_ns or 0) > armed_ns
        return self.airborne and not self._another and bool(watch.armed) and watch.landed in AIRBORNE

    def is_replaced(self, total: Optional[int]) -> str:
        """Take a MISSION_CURRENT; return, once the vehicle has said twice in a row that it has another mission, which.

        Args:
            total: how many items ours has; None: it is not flown by one.
        """
        watch, other = self._watch, ""
        if None not in (watch.total, total) and watch.total != total:
            other = f"it has {watch.total} items, ours {total}"
        elif total is not None and 0 not in (watch.mission_id, self.mission_id) and watch.mission_id != self.mission_id:
            other = f"its id is {watch.mission_id}, ours {self.mission_id}"
        self._others = self._others + 1 if other else 0
        self.replaced = self.replaced or self._others >= _IN_A_ROW
        return other if self._others >= _IN_A_ROW else ""

    def told_of_mission(self, t_ns: int, loading: Optional[Loading], *, goes_on: bool) -> bool:
        """Take a hold, or that it goes on; return whether the vehicle itself tells another mission from ours.

        Where it does not, ours is read while it is held, and when it goes on.
        """
        if self.held is None:
            self.held = None if self.mission_id or loading is None else loading.held(t_ns)
        if self.held is None:
            return True
        if goes_on:
            self.held.resume(t_ns)
        else:
            self.held.hold()
        return False

    def goes_on_from(self, item: Optional[int]) -> None:
        """Take from which item the mission is told to go on; None: it is not, or nobody knows."""
        self._resumed_item, self._fallen_back = item or 0, 0

    def begins_anew(self) -> bool:
        """Take a MISSION_CURRENT; return True once the vehicle has said twice in a row that it flies what was flown."""
        current = self._watch.current
        back = current is not None and current < self._resumed_item and self._watch.mode == MISSION
        self._fallen_back = self._fallen_back + 1 if back else 0
        self.replaced = self.replaced or self._fallen_back >= _IN_A_ROW
        return self._fallen_back >= _IN_A_ROW

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
        landing = watch.mode in LANDING_MODES or watch.descends
        if landing or (before is _P.LANDING and self.down):
            return _P.LANDING
        if self.replaced:
            return _P.FAILED
        if self.steered_by_others:
            return before
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


# --- progress ---------------------------------------------------------------------------------------------------------
# What is to be known of a flight, level-based: phase, waypoint of how many, distance and time that are left. Pure.


IN_FLIGHT = (_P.TAKING_OFF, _P.FLYING, _P.HOLDING, _P.LANDING)


class FlightProgress(NamedTuple):
    """All that it is read from.

    Args:
        watch: the vehicle.
        age_limit_ns: of what it says.
        model: how it flies.
        loading: of the file; None: nothing was loaded.
        origin: of the session.
        flight: what it has shown.
        phase: of the planner.
        message: of the planner.
    """

    watch: VehicleWatch
    age_limit_ns: int
    model: FlightModel
    loading: Optional[Loading]
    origin: Optional[Origin]
    flight: FlightRecord
    phase: MissionPhase
    message: str

    def status(self, t_ns: int, loaded: Optional[LoadRequest]) -> MissionStatus:
        """Return it for a file."""
        distance, seconds = self._left(t_ns)
        return MissionStatus(
            t_ns=t_ns,
            session_id=loaded.session_id if loaded else "",
            mission_id=loaded.mission_id if loaded else "",
            phase=self.phase,
            waypoint=self._waypoint(),
            waypoints=self.flight.waypoints,
            file_index=loaded.file_index if loaded else 0,
            repetition=loaded.repetition if loaded else 0,
            distance_left_m=distance,
            time_left_s=seconds,
            message=self._words(t_ns),
        )

    def level(self, t_ns: int) -> Tuple[MissionPhase, int, int, str]:
        """Return what is told at once when it changes; asked for often, it computes no distance."""
        return self.phase, self._waypoint(), self.flight.waypoints, self._words(t_ns)

    def _words(self, t_ns: int) -> str:
        unknown = self.watch.unknown(t_ns, self.age_limit_ns)
        said = "" if unknown == SILENT else self.message  # what its mode was is said as well, for the reasons in it
        return "; ".join(filter(None, (unknown, said)))

    def _waypoint(self) -> int:
        """Return the waypoint it flies to, from 1; from the landing on the last one that was reached."""
        if self.phase in (_P.LANDING, _P.LANDED):
            return self.flight.reached
        return min(self.flight.reached + 1, self.flight.waypoints) if self.phase in IN_FLIGHT else 0

    def _left(self, t_ns: int) -> Tuple[Optional[float], Optional[float]]:
        loading, origin = self.loading, self.origin
        if loading is None or origin is None or not loading.accepted:
            return None, None
        waypoints = loading.trajectory.waypoints[self.flight.reached :]
        return remaining(self._here(t_ns, origin), () if self.phase is _P.LANDED else waypoints, self.model)

    def _here(self, t_ns: int, origin: Origin) -> Optional[Here]:
        watch, yaw = self.watch, self.watch.yaw_rad or 0.0
        if origin.local is not None:
            pose = watch.local(t_ns, self.age_limit_ns)
            if pose is None:
                return None
            guidance, (x, y, z) = self.flight.guidance, pose.position_m
            start_m = z if guidance is None else guidance.origin[2]  # heights are above the takeoff of each file
            return Here(x - origin.local[0], y - origin.local[1], z - start_m, yaw)
        place = watch.somewhere(t_ns, self.age_limit_ns)
        return None if place is None or origin.home is None else Here(*origin.home.to_local(place), watch.height_m, yaw)


# --- remaining --------------------------------------------------------------------------------------------------------
# How far it is still, and how long it takes: along the waypoints that are left, and their holds.


class Here(NamedTuple):
    """Where the vehicle is, relative to the origin of the waypoints."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


def remaining(
    here: Optional[Here], waypoints: Sequence[Waypoint], model: FlightModel
) -> Tuple[Optional[float], Optional[float]]:
    """Return metres and seconds that are left; None where nobody knows where the vehicle is."""
    if here is None and waypoints:
        return None, None
    metres = seconds = 0.0
    last = None if here is None else Waypoint(*here, 0.0)
    for waypoint in waypoints:
        if last is not None:
            metres += distance_m(last, waypoint)
            seconds += leg_s(last, waypoint, model) + waypoint.hold_s
        last = waypoint
    return round(metres, 3), round(seconds, 3)
