"""The mission planner and sequencer: loads files, takes off, holds, resumes, lands; a client of a link, without I/O.

Everything it says is read from the vehicle: a file is loaded when it reads back the same, a flight is over when the
vehicle is disarmed on the ground. Commands are tables of steps (`mission_steps.py`); which command is good in which
phase is a table in `admission.py`. It never commands a vehicle that a pilot flies, and never sends what nobody asked
for, with two exceptions that the offboard flight needs: it lands after the last waypoint, and when the pose stays away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Iterable, List, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, MissionStatus
from amaze_autonomy.missions import Controller, FlightModel, MissionPlan, PlannerSpec

from .admission import Standing, refusal
from .dialect import Message
from .flight_record import FlightRecord
from .guidance import Guidance
from .loading import Loading, LoadRequest, Origin, Readiness
from .mission_steps import Means, steps_of
from .mission_upload import UPLOAD_MESSAGES
from .mission_vehicle import LAND, OFFBOARD, STREAMS, TAKEN, Pose, VehicleWatch
from .modes import is_foreign
from .outlook import IN_FLIGHT, Outlook
from .procedure import Procedure, Progress
from .rates import Rates

__all__ = ["PLANNER_MESSAGES", "Sequencer", "SequencerSettings"]

PLANNER_MESSAGES = (*STREAMS, *TAKEN, *UPLOAD_MESSAGES)
"""Names of the messages that a planner wants to be given."""

_S = 1_000_000_000
_BLIND_PAUSES = 4  # of pose_age_limit without a pose, then it lands
_P, _A = MissionPhase, MissionAction


@dataclass(frozen=True)
class SequencerSettings:
    """What the planner knows.

    Args:
        plans: every mission.
        spec: limits.
        model: how the vehicle flies.
        takeoff_height_m: of each climb.
    """

    plans: Tuple[MissionPlan, ...]
    spec: PlannerSpec
    model: FlightModel
    takeoff_height_m: float


class Sequencer:
    """One planner on one link.

    Args:
        settings: what it knows.
        origin: of the last session, kept from before a restart.
        wall_minus_clock_ns: wall time minus the clock of the messages.
    """

    def __init__(
        self,
        settings: SequencerSettings,
        origin: Optional[Origin] = None,
        wall_minus_clock_ns: Callable[[], int] = lambda: 0,
    ) -> None:
        self._settings, self._spec, self._wall = settings, settings.spec, wall_minus_clock_ns
        self._plans = {plan.mission.id: plan for plan in settings.plans}
        self.watch = VehicleWatch()
        self._means = Means(self.watch, self._spec.setpoint_lead_ns, settings.takeoff_height_m)
        self._phase, self._message = _P.IDLE, ""
        self._loading: Optional[Loading] = None
        self._loaded: Optional[LoadRequest] = None
        self._origin = origin
        self._procedure: Optional[Procedure] = None
        self._flight = FlightRecord(self.watch)
        self._setpoint_ns = 0
        self._rates = Rates(STREAMS)

    # --- the link -------------------------------------------------------------------------------------------------

    def receive(self, t_ns: int, message: Message) -> Iterable[Message]:
        """Take a message of the vehicle."""
        self.watch.take(t_ns, message)
        self._rates.heard(t_ns, message.get_type())
        sent: List[Message] = []
        if self._loading is not None and not self._loading.over:
            sent += self._loading.receive(t_ns, message)
            self._finish_loading()
        if message.get_type() in ("HEARTBEAT", "EXTENDED_SYS_STATE", "MISSION_CURRENT", "MISSION_ITEM_REACHED"):
            self._follow(t_ns)
            sent += self._proceed(t_ns)
        return sent

    def wake(self, t_ns: int) -> Iterable[Message]:
        """Look at the time; called at least as often as set-points are sent."""
        sent: List[Message] = []
        if self._loading is not None and not self._loading.over:
            sent += self._loading.wake(t_ns)
            self._finish_loading()
        self._follow(t_ns)
        sent += self._proceed(t_ns) + self._stream(t_ns)
        asks = self.watch.known(t_ns, self._spec.vehicle_age_limit_ns)
        return [*sent, *self._rates.wake(t_ns, *self.watch.target, self.watch.unknown_streams)] if asks else sent

    # --- requests -------------------------------------------------------------------------------------------------

    def load(self, t_ns: int, request: LoadRequest) -> Tuple[Loading, Sequence[Message]]:
        """Begin to send a waypoint file; the loading says when it is over, and how it ended."""
        plan = self._plans.get(request.mission_id)
        in_flight = self._phase in IN_FLIGHT and bool(self.watch.armed)
        readiness = Readiness(self.watch, self._spec, in_flight, self._wall())
        origin = self._origin if self._origin and self._origin.session_id == request.session_id else None
        loading = Loading(request, plan, origin, readiness, self._settings.takeoff_height_m, t_ns)
        if loading.refused:
            return loading, ()
        if self._loading is not None:
            self._loading.supersede()
        self._loading = loading
        self._phase, self._message, self._loaded, self._procedure = _P.IDLE, "", request, None
        self._flight = FlightRecord(self.watch)
        messages = loading.start(t_ns)
        self._finish_loading()
        return loading, messages

    def _finish_loading(self) -> None:
        loading = self._loading
        if loading is None or not loading.over or loading.seen:
            return
        loading.seen = True
        self._phase, self._message = (_P.LOADED, "") if loading.accepted else (_P.IDLE, loading.reason)
        if loading.accepted:
            self._origin = loading.origin
            self._flight = FlightRecord(self.watch, len(loading.trajectory.waypoints))

    def command(self, t_ns: int, session_id: str, action: MissionAction) -> Tuple[str, Sequence[Message]]:
        """Begin to carry out a command; return why it is refused, empty when it is taken."""
        problem = refusal(self._standing(t_ns), session_id, action)
        if problem:
            return problem, ()
        self._begin(t_ns, self._meant(t_ns, action))
        return "", self._proceed(t_ns)

    def _standing(self, t_ns: int) -> Standing:
        return Standing(
            watch=self.watch,
            known=self.watch.known(t_ns, self._spec.vehicle_age_limit_ns),
            phase=self._phase,
            session_id=self._loaded.session_id if self._loaded else None,
            lost=self._controller is Controller.OFFBOARD and self._pose(t_ns) is None,
        )

    def _meant(self, t_ns: int, action: MissionAction) -> MissionAction:
        """Return what is done: before lift-off landing and aborting disarm; in flight, or where unknown, they land."""
        if action not in (_A.LAND, _A.ABORT):
            return action
        down = self.watch.on_ground(t_ns, self._spec.vehicle_age_limit_ns) or self.watch.armed is False
        return _A.ABORT if down and not self._flight.airborne else _A.LAND

    def _begin(self, t_ns: int, action: MissionAction) -> None:
        running = self._procedure
        if running is not None and running.running and running.action is action:
            return  # it is being done already
        if action is _A.TAKEOFF:
            self._take_off(t_ns)
        if action is _A.HOLD and self._flight.guidance is not None:
            self._flight.guidance.stand()
        if action is _A.HOLD and self._controller is Controller.MISSION and self._phase is not _P.HOLDING:
            self._means.resume_item = self._flight.item
        if action is _A.RESUME and self._flight.guidance is not None:
            self._flight.guidance.go_on()
        if action is _A.RESUME and self._means.resume_item is not None:
            self._means.resume_item = max(self._means.resume_item, self._flight.item or 0)  # told late, it was passed
        persistent = action in (_A.LAND, _A.ABORT)
        steps = steps_of(self._controller, action, self.watch.dialect)
        self._procedure = Procedure(action, steps, self._means, self._spec, t_ns, persistent=persistent)
        self._message = self._flight.hands_off()

    def _take_off(self, t_ns: int) -> None:
        self._phase, self._flight = _P.TAKING_OFF, FlightRecord(self.watch, self._flight.waypoints)
        self._means.resume_item = self._means.stream_ns = None
        self._means.lifted = False
        pose, origin, loading = self._pose(t_ns), self._origin, self._loading
        if self._controller is Controller.OFFBOARD and pose and origin and origin.local and loading:
            waypoints, height = loading.trajectory.waypoints, self._settings.takeoff_height_m
            self._flight.guidance = Guidance(
                waypoints,
                origin.local,
                height,
                self._settings.model,
                self._spec,
                pose,
                self.watch.yaw_rad,
                self.watch.target,
            )
            self._means.stream_ns = t_ns

    def shutdown(self, t_ns: int) -> Tuple[bool, Sequence[Message]]:
        """Land before the process ends, unless it is on the ground, or a pilot flies; return whether it lands."""
        if self._phase not in IN_FLIGHT or not self.watch.armed or self.watch.pilot:
            return False, ()
        self._begin(t_ns, self._meant(t_ns, _A.LAND))
        return True, self._proceed(t_ns)

    @property
    def landing_shown(self) -> bool:
        """True once the vehicle lands, has landed, or is somebody else's."""
        over = self._phase not in IN_FLIGHT or not self.watch.armed
        return over or self.watch.mode == LAND or is_foreign(self.watch.mode)

    # --- what the vehicle does ------------------------------------------------------------------------------------

    @property
    def _controller(self) -> Controller:
        plan = self._plans.get(self._loaded.mission_id) if self._loaded else None
        return plan.controller if plan else Controller.MISSION

    def _pose(self, t_ns: int) -> Optional[Pose]:
        return self.watch.local(t_ns, self._spec.pose_age_limit_ns)

    def _follow(self, t_ns: int) -> None:
        """Read the phase from the vehicle."""
        watch, flight, procedure = self.watch, self._flight, self._procedure
        if self._phase not in IN_FLIGHT or not watch.known(t_ns, self._spec.vehicle_age_limit_ns):
            return
        flight.look()
        self._means.lifted = flight.lifted
        if not flight.armed and not self._doing(_A.LAND):
            return  # mode and landed state are still those of the flight before
        if watch.armed is False and watch.on_ground(t_ns, self._spec.vehicle_age_limit_ns):
            if flight.is_counted(t_ns, asked=self._doing(_A.LAND, _A.ABORT)):
                self._end()
        elif watch.armed:
            self._phase = flight.phase(self._phase)
            self._message = flight.hands_off() or (procedure.reason if procedure else "") or flight.failure

    def _doing(self, *actions: MissionAction) -> bool:
        """Return whether one of these was commanded last."""
        return self._procedure is not None and self._procedure.action in actions

    def _end(self) -> None:
        """Be on the ground, disarmed."""
        if not self._flight.airborne and not self._doing(_A.LAND, _A.ABORT):
            self._flight.failure = "disarmed before it lifted off"
        self._message = self._flight.failure
        if self._phase in (*IN_FLIGHT, _P.LOADED):
            self._phase = _P.LANDED
        self._procedure = self._flight.guidance = None
        self._means.stream_ns = None

    # --- what is sent ---------------------------------------------------------------------------------------------

    def _proceed(self, t_ns: int) -> List[Message]:
        procedure = self._procedure
        if procedure is None:
            return []
        if procedure.action is _A.ABORT and procedure.running and self._flight.airborne:
            self._begin(t_ns, _A.LAND)  # it has lifted off meanwhile
            return self._proceed(t_ns)
        sent = procedure.wake(t_ns)
        if procedure.progress is Progress.FAILED and procedure.action is _A.TAKEOFF:
            self._cancel(t_ns, procedure.reason)
        elif procedure.progress is Progress.DONE and procedure.action is _A.ABORT:
            self._end()
        elif procedure.reason:
            self._message = self._flight.hands_off() or procedure.reason
        return sent

    def _cancel(self, t_ns: int, reason: str) -> None:
        """Give a takeoff up that did not begin: disarm; an arming may be under way, unseen."""
        self._begin(t_ns, _A.LAND if self._flight.airborne else _A.ABORT)
        self._flight.failure = self._message = reason

    def _stream(self, t_ns: int) -> List[Message]:
        """Return the next set-point, as long as there is a flight by set-points that nobody else has taken over."""
        guidance = self._flight.guidance
        if (
            guidance is None
            or not self._means.streams
            or t_ns - self._setpoint_ns < _S / self._spec.setpoint_rate_hz * 0.9
        ):
            return []
        if self._flight.airborne and self.watch.mode != OFFBOARD and not self._wants_offboard():
            return []
        self._setpoint_ns = t_ns
        guidance.flying = bool(self.watch.armed) and self.watch.mode == OFFBOARD
        sent = [guidance.step(t_ns, self._pose(t_ns), self.watch.heading(t_ns, self._spec.vehicle_age_limit_ns))]
        self._means.still = guidance.still
        blind = guidance.blind_ns(t_ns) > _BLIND_PAUSES * self._spec.pose_age_limit_ns
        if guidance.flying and (guidance.finished or blind) and not self._lands():
            self._begin(t_ns, _A.LAND)
            self._message = "the local position stays away: landing" if blind else ""
            sent += self._proceed(t_ns)
        return sent

    def _wants_offboard(self) -> bool:
        procedure = self._procedure
        return procedure is not None and procedure.running and procedure.action in (_A.TAKEOFF, _A.HOLD, _A.RESUME)

    def _lands(self) -> bool:
        procedure = self._procedure
        return procedure is not None and procedure.running and procedure.action is _A.LAND

    # --- what is told ---------------------------------------------------------------------------------------------

    def status(self, t_ns: int) -> MissionStatus:
        """Return what is to be known of it, level-based."""
        outlook = Outlook(
            watch=self.watch,
            age_limit_ns=self._spec.vehicle_age_limit_ns,
            model=self._settings.model,
            loading=self._loading,
            origin=self._origin,
            flight=self._flight,
            phase=self._phase,
            message=self._message,
        )
        return outlook.status(t_ns, self._loaded)
