"""From a request to load a file to the file on the vehicle, or to the reason why it is not.

The origin of local waypoints is where the first file of a session takes off; later files of the session keep it. Files
that count from their own takeoffs have another one each, and are turned by the heading that the vehicle has there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import List, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Controller, Frame, Home, MissionPlan, Place, PlannerSpec, Trajectory

from ..link.dialect import Message
from .guidance import Climb
from .held import HeldMission
from .mission_upload import Dialect, MissionUpload, UploadPhase, mission_items
from .mission_vehicle import RESTART, VehicleWatch

BEGINS_ANEW = f"{RESTART} of the ArduPilot is 1: a mission that is held would begin anew; set it to 0"
"""Why no mission is flown by such an autopilot."""
NO_POSE = "there is no fresh local position"
"""Why no file is flown by set-points."""
_NO_HEADING = "there is no fresh heading, and the waypoints count from it"
_NO_PLACE = "there is no fresh and valid position on the earth"
_NO_ORIGIN = "the place of the session's first takeoff is not known"
_STARTED_AGAIN = "the autopilot was started again"
_WAS_SILENT = "the vehicle was silent, and may have been started again"
_ABOVE_M = 0.2  # of the height that is waited for: no vehicle hovers exactly
#: so far below the height of a takeoff item it is done with: PX4 by NAV_MC_ALT_RAD, ArduPilot still climbing slowly
_DONE_BELOW_M = {Dialect.PX4: 0.8, Dialect.ARDUPILOT: 0.3}
# of the engine's patience with a resume, for the change of mode: two heartbeats and a retry; where going on needs the
# reading, that has more of it
_TO_GO_ON_NS, _TO_GO_ON_UNREAD_NS = 2_800_000_000, 1_500_000_000
_SAME_BOOT_NS = 5_000_000_000  # how far two readings of the same start may lie apart, of two processes


def climb_of(plan: MissionPlan, limits: Limits) -> Climb:
    """Return the climb of a takeoff by set-points: it passes the height that the engine waits for."""
    goal_m = _passing_m(plan, limits, _ABOVE_M)
    return Climb(goal_m, (goal_m + limits.takeoff_height_m) / 2.0)


def takeoff_item_m(plan: MissionPlan, limits: Limits, dialect: Dialect) -> float:
    """Return the height of a takeoff item with which the autopilot is done above the one that the engine waits for."""
    return _passing_m(plan, limits, _ABOVE_M + _DONE_BELOW_M[dialect])


def _passing_m(plan: MissionPlan, limits: Limits, above_m: float) -> float:
    """Return the takeoff height and so much more, at most half way to the height at which the flight is ended."""
    most_m = limits.max_height_m if plan.mission.max_height_m is None else plan.mission.max_height_m
    lowest_m = limits.takeoff_height_m
    return lowest_m + max(0.0, min(above_m, (most_m - lowest_m) / 2.0))


class LoadRequest(NamedTuple):
    """Which file of which mission of which session; indices from 0."""

    session_id: str
    mission_id: str
    file_index: int
    repetition: int


@dataclass(frozen=True)
class Origin:
    """Where a session's waypoints are measured from.

    Args:
        session_id: its session.
        home: on the earth; None for a flight by set-points.
        local: in the estimator's frame (ENU); None for a mission of the autopilot.
        boot_ns: wall time at which the autopilot was switched on, which made that frame; None: unknown.
        starts: how often the autopilot was seen to start again before that; None: another process found the origin.
        speaks_since_ns: end of the vehicle's last silence before it was found; None: another process found it.
    """

    session_id: str
    home: Optional[Home] = None
    local: Optional[Tuple[float, float, float]] = None
    boot_ns: Optional[int] = None
    starts: Optional[int] = field(default=None, compare=False)
    speaks_since_ns: Optional[int] = field(default=None, compare=False)


class Readiness(NamedTuple):
    """The vehicle, and what it must be like.

    Args:
        watch: the vehicle.
        spec: what it must be like.
        in_flight: the planner's phase is one of a flight.
        wall_ns: wall time minus the clock of the messages.
        landing: why it is being landed, in words; empty: it is not.
        late: what was commanded and may still take effect, in words; empty: nothing.
    """

    watch: VehicleWatch
    spec: PlannerSpec
    in_flight: bool
    wall_ns: int = 0
    landing: str = ""
    late: str = ""


class Loading:
    """One request to load.

    Args:
        request: what is to be loaded.
        plan: the mission; None: there is none.
        origin: of the session, where it is known.
        readiness: of the vehicle.
        limits: of the engine: the height of the climb.
        t_ns: now.
    """

    def __init__(
        self,
        request: LoadRequest,
        plan: Optional[MissionPlan],
        origin: Optional[Origin],
        readiness: Readiness,
        limits: Limits,
        t_ns: int,
    ) -> None:
        self.request, self.origin, self.seen = request, origin, False
        self._plan, self._readiness, self._limits = plan, readiness, limits
        self._upload: Optional[MissionUpload] = None
        self._accepted = False
        self._heading_rad = 0.0  # at the takeoff, for a file that counts from it
        self._stood: Optional[Tuple[float, float]] = None  # east and north in the local frame, where it is flown by it
        self._stood_at: Optional[Place] = None  # likewise on the earth
        self._reason = self._problem(t_ns)
        self.refused = bool(self._reason)

    @property
    def over(self) -> bool:
        """True when it has ended, well or not."""
        return self._accepted or bool(self._reason)

    @property
    def accepted(self) -> bool:
        """True when the file is there."""
        return self._accepted

    @property
    def reason(self) -> str:
        """Why it is not."""
        return self._reason

    @property
    def trajectory(self) -> Trajectory:
        """Return the file, east and north of the origin."""
        assert self._plan is not None  # noqa: S101 - a refused request has none, and nobody asks it
        return self._plan.trajectories[self.request.file_index].from_start(self._heading_rad)

    @property
    def duration_s(self) -> float:
        """How long its flight takes, as estimated; not a number when there is no such flight."""
        known = self._plan is not None and not self.refused
        plan = self._plan
        return plan.flight(self.request.file_index, self.request.repetition).duration_s if known and plan else math.nan

    @property
    def total(self) -> Optional[int]:
        """How many items the vehicle says that it has of it; None: it has none of it."""
        return None if self._upload is None or not self.accepted else self._upload.total

    def end(self, reason: str) -> None:
        """Give it up."""
        if not self.over:
            self._reason = reason

    def problem_of_takeoff(self, t_ns: int) -> str:
        """Return why its flight does not begin as and where the vehicle stands now; empty when it does.

        It was checked for a vehicle that stood disarmed where it was loaded.
        """
        watch, spec = self._readiness.watch, self._readiness.spec
        not_ready = not_down(watch, t_ns, spec.vehicle_age_limit_ns) or watch.kind_problem
        return not_ready or self._carried(t_ns) or self._turned(t_ns)

    def _turned(self, t_ns: int) -> str:
        if self._plan is None or self._plan.frame is not Frame.START_HEADING:
            return ""
        spec = self._readiness.spec
        heading_rad = self._readiness.watch.heading(t_ns, spec.vehicle_age_limit_ns)
        if heading_rad is None:
            return _NO_HEADING
        turned_rad = abs(math.remainder(heading_rad - self._heading_rad, math.tau))
        if turned_rad <= spec.heading_tolerance_rad:
            return ""
        return f"load it again: it was turned by {math.degrees(turned_rad):.0f} degrees since"

    def _carried(self, t_ns: int) -> str:
        watch, spec = self._readiness.watch, self._readiness.spec
        away_m = 0.0
        if self._stood is not None:
            pose = watch.local(t_ns, spec.pose_age_limit_ns)
            if pose is None:
                return NO_POSE
            away_m = math.hypot(pose.position_m[0] - self._stood[0], pose.position_m[1] - self._stood[1])
        elif self._stood_at is not None:
            place = watch.somewhere(t_ns, spec.vehicle_age_limit_ns)
            if place is None:
                return _NO_PLACE
            away_m = math.hypot(*Home(*self._stood_at).to_local(place))
        far = self._far_from("where it stood when the file was loaded", away_m)
        return f"load it again: {far}" if far else ""

    def verification(self, t_ns: int) -> Optional[MissionUpload]:
        """Return what reads the mission on the vehicle again, and compares it; None: there is none on it."""
        return None if self._upload is None else self._upload.verification(t_ns, self._readiness.spec.transfer_limit_ns)

    def held(self, t_ns: int) -> Optional[HeldMission]:
        """Return what looks whether the mission is the one that was sent, while it is held; None: there is none."""
        upload, limit_ns = self._upload, self._readiness.spec.transfer_limit_ns
        if upload is None:
            return None
        confirm_ns = self._limits.resume_confirm_limit_ns
        patience_ns, agreed_ns = (max(0, confirm_ns - each) for each in (_TO_GO_ON_UNREAD_NS, _TO_GO_ON_NS))

        def begin(at_ns: int) -> MissionUpload:
            return upload.verification(at_ns, limit_ns, sets_current=False)

        return HeldMission(begin, patience_ns, t_ns, agreed_patience_ns=agreed_ns)

    def start(self, t_ns: int) -> List[Message]:
        """Return the first messages."""
        watch, spec = self._readiness.watch, self._readiness.spec
        assert self._plan is not None  # noqa: S101 - see above
        if self._plan.controller is Controller.OFFBOARD:
            self._accepted = True
            return []
        place = watch.somewhere(t_ns, spec.vehicle_age_limit_ns)
        home = self.origin.home if self.origin else None
        assert place is not None  # noqa: S101 - both were looked at
        assert home is not None  # noqa: S101
        climb_m = takeoff_item_m(self._plan, self._limits, watch.dialect)
        items = mission_items(self.trajectory, home, place, climb_m, spec.acceptance_radius_m, watch.dialect)
        self._upload = MissionUpload(
            items, watch.target, t_ns, spec.message_retry_ns, spec.transfer_limit_ns, watch.dialect
        )
        return self._upload.start(t_ns)

    def receive(self, t_ns: int, message: Message) -> List[Message]:
        """Take a message of the vehicle."""
        return self._after(self._upload.receive(t_ns, message) if self._upload else [])

    def wake(self, t_ns: int) -> List[Message]:
        """Look at the time."""
        return self._after(self._upload.wake(t_ns) if self._upload else [])

    def _after(self, messages: List[Message]) -> List[Message]:
        upload = self._upload
        if upload is not None and upload.over:
            restarts = bool(self._readiness.watch.restarts)
            self._accepted = upload.phase is UploadPhase.DONE and not restarts
            not_sent = BEGINS_ANEW if restarts else f"sending {self.trajectory.file}: {upload.reason}"
            self._reason = "" if self._accepted else not_sent
        return messages

    # --- before anything is sent ----------------------------------------------------------------------------------

    def _problem(self, t_ns: int) -> str:
        """Return why nothing can be loaded; empty when it can, with the origin known."""
        return self._problem_of_request() or self._problem_of_vehicle(t_ns) or self._problem_of_place(t_ns)

    def _problem_of_request(self) -> str:
        plan, request = self._plan, self.request
        if plan is None:
            return f"there is no mission {request.mission_id!r}"
        if not request.session_id:
            return "there is no session id"
        files, repetitions = len(plan.trajectories), plan.mission.repetitions
        if not 0 <= request.file_index < files:
            number = request.file_index + 1
            return f"mission {request.mission_id} has {files} waypoint files, there is no {number}"
        if not 0 <= request.repetition < repetitions:
            return f"mission {request.mission_id} is flown {repetitions} times, there is no {request.repetition + 1}"
        return ""

    def _problem_of_vehicle(self, t_ns: int) -> str:
        watch, limit_ns = self._readiness.watch, self._readiness.spec.vehicle_age_limit_ns
        if not watch.known(t_ns, limit_ns):
            return "the vehicle is silent"
        if watch.armed is not False or self._readiness.in_flight:
            return "the vehicle is armed"
        if self._readiness.landing:
            return f"{self._readiness.landing}: the vehicle is being disarmed"
        if self._readiness.late:
            return self._readiness.late
        return not_down(watch, t_ns, limit_ns) or watch.kind_problem

    def _problem_of_place(self, t_ns: int) -> str:
        plan = self._plan
        assert plan is not None  # noqa: S101 - looked at before
        offboard = plan.controller is Controller.OFFBOARD
        problem = self._find_local(t_ns, plan) if offboard else self._find_home(t_ns, plan)
        return problem or self._find_heading(t_ns, plan)

    def _find_heading(self, t_ns: int, plan: MissionPlan) -> str:
        if plan.frame is not Frame.START_HEADING:
            return ""
        heading = self._readiness.watch.heading(t_ns, self._readiness.spec.vehicle_age_limit_ns)
        self._heading_rad = heading or 0.0
        return "" if heading is not None else _NO_HEADING

    def _begins(self) -> bool:
        """Return whether waypoints are measured from this takeoff: the session's first, or each."""
        own = self._plan is not None and self._plan.frame is Frame.START_HEADING
        return own or (self.request.file_index == 0 and self.request.repetition == 0)

    def _far_from(self, where: str, away_m: float) -> str:
        """Return why nothing takes off so far from where it should; empty when that is near enough."""
        most_m = self._readiness.spec.home_tolerance_m
        if away_m <= most_m:
            return ""
        return f"the vehicle stands {away_m:.1f} m from {where}, at most {most_m:g} m are good"

    def _far_from_file_before(self, plan: MissionPlan, east_m: float, north_m: float) -> str:
        """Return why a later file does not take off here: its way was checked from where the file before ends."""
        before = plan.trajectories[self.request.file_index - 1].waypoints[-1]  # before a repetition: of the last file
        return self._far_from("where the file before ends", math.hypot(east_m - before.x_m, north_m - before.y_m))

    def _find_local(self, t_ns: int, plan: MissionPlan) -> str:
        pose = self._readiness.watch.local(t_ns, self._readiness.spec.pose_age_limit_ns)
        if pose is None:
            return "there is no fresh and valid local position"
        self._stood = pose.position_m[:2]
        watch, wall_ns = self._readiness.watch, self._readiness.wall_ns
        if self._begins():
            boot_ns = None if watch.power_on.since_ns is None else watch.power_on.since_ns + wall_ns
            session, since_ns = self.request.session_id, watch.speaks_since_ns
            self.origin = Origin(session, None, pose.position_m, boot_ns, watch.power_on.starts, since_ns)
            return ""
        if self.origin is None or self.origin.local is None:
            return _NO_ORIGIN
        begun_anew = frame_begun_anew(self.origin, watch, wall_ns)
        if begun_anew:
            return f"{begun_anew} since the session's first takeoff: its local frame counts no more"
        (x, y, _), (origin_x, origin_y, _) = pose.position_m, self.origin.local
        return self._far_from_file_before(plan, x - origin_x, y - origin_y)

    def _find_home(self, t_ns: int, plan: MissionPlan) -> str:
        place = self._readiness.watch.somewhere(t_ns, self._readiness.spec.vehicle_age_limit_ns)
        if place is None:
            return _NO_PLACE
        self._stood_at = place
        if not self._begins():
            home = self.origin.home if self.origin else None
            return _NO_ORIGIN if home is None else self._far_from_file_before(plan, *home.to_local(place))
        home = plan.home or Home(*place)
        problem = self._far_from("the mission's home", math.hypot(*home.to_local(place)))
        self.origin = self.origin if problem else Origin(self.request.session_id, home=home)
        return problem


def not_down(watch: VehicleWatch, t_ns: int, limit_ns: int) -> str:
    """Return why a vehicle is not taken to stand disarmed on the ground; empty: messages agree that it does."""
    if watch.armed is not False:
        return "the vehicle is armed"
    return "" if watch.ground.is_down(t_ns, limit_ns) else "the vehicle does not say that it is on the ground"


def frame_begun_anew(origin: Optional[Origin], watch: VehicleWatch, wall_ns: int) -> str:
    """Return why the local frame is not the one of an origin any more, in words; empty: it is, or there is no origin.

    Where nothing says when the autopilot was switched on (behind mavros), one that was silent may have begun anew.

    Args:
        origin: looked at by wall time only where another process found it.
        watch: the vehicle.
        wall_ns: wall time minus the clock of the messages.
    """
    if origin is None:
        return ""
    if origin.boot_ns is None or watch.power_on.since_ns is None:
        return "" if origin.speaks_since_ns == watch.speaks_since_ns else _WAS_SILENT
    if origin.starts is not None:
        return _STARTED_AGAIN if watch.power_on.starts != origin.starts else ""
    return _STARTED_AGAIN if abs(watch.power_on.since_ns + wall_ns - origin.boot_ns) > _SAME_BOOT_NS else ""
