"""The mission planner and sequencer: loads files, takes off, holds, resumes, lands; a client of a link, without I/O.

Everything it says is read from the vehicle: a file is loaded when it reads back the same, a flight is over when the
vehicle is disarmed on the ground. Commands are tables of steps (`mission_steps.py`); which command is good in which
phase is a table in `admission.py`. It never commands a vehicle that a pilot flies, and never sends what nobody asked
for, with two exceptions that the offboard flight needs: it lands after the last waypoint, and when the pose stays away;
never without having heard just before that it flies in our mode (`own_landing.py`).

A landing, commanded here or to the autopilot node, stands until the vehicle is disarmed: it replaces whatever runs, and
nothing else is taken or sent. What else runs ends with a silence of the vehicle, and is not taken up again by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, Iterable, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, MissionStatus, VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Controller, FlightModel, MissionPlan, PlannerSpec

from ..link.dialect import Message
from ..vehicle.agreement import GROUND_NS, Attention
from ..vehicle.asked import Rates
from ..vehicle.modes import LAND, LANDING_MODES
from .flight_progress import IN_FLIGHT, FlightProgress, FlightRecord
from .guidance import Guidance
from .loading import Loading, LoadRequest, Origin, Readiness, climb_of, frame_begun_anew
from .mission_upload import UPLOAD_MESSAGES, Dialect, MissionUpload, UploadPhase, beginning
from .mission_vehicle import MODE_LATE_NS, OFFBOARD, STREAMS, TAKEN, Pose, VehicleWatch
from .own_landing import ENDS, OwnLanding, Questions
from .procedure import Means, Procedure, Progress, Standing, refusal, steps_of

PLANNER_MESSAGES = (*STREAMS, *TAKEN, *UPLOAD_MESSAGES)
"""Names of the messages that a planner wants to be given."""

_S = 1_000_000_000
_BLIND_PAUSES = 4  # of pose_age_limit without a pose, then it lands
_LATE_NS = 3 * _S  # within which a command of ours may still take effect, on a slow way
_GUARD_NS = _LATE_NS - _S // 5  # so long it stays for one where it is told to end
GUARD_S = _LATE_NS / _S
"""So long its node stays at least while `guards` is true: a little longer than that takes."""
_OTHER_NS = _S  # how long the autopilot node's word counts; it repeats it at 5 Hz
_STATUS_NS = _S // 5  # between two statuses of this node: the last one may be so old when it stops
_LANDINGS = (MissionAction.LAND, MissionAction.ABORT)
_ASKED, _FLOWN, _NO_TAKEOFF = "a landing was commanded", "the last waypoint is done with", "the takeoff failed"
_TAKEN_OVER = "somebody else chose the flight mode before the takeoff"
_P, _A = MissionPhase, MissionAction


@dataclass(frozen=True)
class SequencerSettings:
    """What the planner knows.

    Args:
        plans: every mission.
        spec: limits.
        model: how the vehicle flies.
        limits: of the engine: the height of each climb, and for how long messages must agree.
        streams_hz: what is asked for, and at which rates.
    """

    plans: Tuple[MissionPlan, ...]
    spec: PlannerSpec
    model: FlightModel
    limits: Limits
    streams_hz: Mapping[str, float] = field(default_factory=lambda: STREAMS)


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
        self.watch = VehicleWatch(settings.limits, self._spec.vehicle_age_limit_ns)
        self._means = Means(self.watch, self._spec.setpoint_lead_ns, settings.limits.takeoff_height_m)
        self._phase, self._message = _P.IDLE, ""
        self._loading: Optional[Loading] = None
        self._loaded: Optional[LoadRequest] = None
        self._origin = origin
        self._procedure: Optional[Procedure] = None
        self._flight = FlightRecord(self.watch)
        self._setpoint_ns = 0
        self._rates, self._asked_since = Rates(settings.streams_hz), (0, 0)
        self._verification: Optional[MissionUpload] = None
        self._verified_id = 0  # by which the vehicle called its mission when that reading began
        self._landing = ""  # why it is landed, whatever else is asked for
        self._unasked = OwnLanding(self.watch, self._spec.vehicle_age_limit_ns)
        self._commanded_ns = -_LATE_NS  # when something else than a landing was sent last
        self._other, self._other_ns = "", -_OTHER_NS
        self.guards = False  # told to end, it stays: what was commanded may still arm the vehicle
        self._ends_on_ground = False  # it was told to end so, whatever has become of that
        self._attention = Attention()
        self._questions = Questions(self.watch)

    # --- the link -------------------------------------------------------------------------------------------------

    def receive(self, t_ns: int, message: Message, *, heard: bool = True) -> Iterable[Message]:
        """Take a message of the vehicle; not heard: another one's answer in its place."""
        self._look(t_ns)
        self.watch.take(t_ns, message, heard=heard)
        self._ask_anew()
        self._rates.heard(t_ns, message.get_type())
        if message.get_type() == "MISSION_CURRENT":
            self._look_at_mission()
            self._look_at_resume()
            self._flight.look_at_item()
        sent: List[Message] = []
        if self._loading is not None and not self._loading.over:
            sent += self._loading.receive(t_ns, message)
            self._finish_loading()
        if self._verification is not None:
            sent += self._verification.receive(t_ns, message)
        sent += self._look_at_held(t_ns, message)
        sent = sent if self._knows_the_vehicle else []
        if message.get_type() in ("HEARTBEAT", "EXTENDED_SYS_STATE", "MISSION_CURRENT", "MISSION_ITEM_REACHED"):
            self._follow(t_ns)
            sent += self._proceed(t_ns)
        return sent

    def wake(self, t_ns: int, *, read: bool = True) -> Iterable[Message]:
        """Look at the time; called at least as often as set-points are sent."""
        self._look(t_ns, read=read)
        sent: List[Message] = []
        if self._loading is not None and not self._loading.over:
            sent += self._loading.wake(t_ns)
            self._finish_loading()
        if self._verification is not None:
            sent += self._verification.wake(t_ns)
        sent += self._look_at_held(t_ns)
        sent = sent if self._knows_the_vehicle else []
        self.watch.texts.wake(t_ns)
        self._follow(t_ns)
        sent += self._proceed(t_ns) + self._stream(t_ns) + self._land_unasked(t_ns)
        self.guards = self.guards and t_ns - self._commanded_ns <= _GUARD_NS
        if not self.watch.known(t_ns, self._spec.vehicle_age_limit_ns):
            return sent
        asked = self._rates.wake(t_ns, *self.watch.target, self.watch.unknown_streams)
        return [*sent, *self._ask(t_ns), *asked]

    def _ask_anew(self) -> None:
        """Forget how often its messages were asked for, where it was silent or has started: it may have forgotten."""
        since = self.watch.speaks_since_ns, self.watch.power_on.starts
        if since != self._asked_since:
            self._asked_since = since
            self._rates.forget()

    def _ask(self, t_ns: int) -> List[Message]:
        """Ask for what the vehicle has not said and must."""
        unsure = self.watch.control.unexplained or self._unasked.wants_beat(t_ns)
        flies = self._loading is not None and self._controller is not Controller.OFFBOARD and self._knows_the_vehicle
        return [*self._questions.beat(t_ns, unsure=unsure), *self._questions.restart(t_ns, flies_a_mission=flies)]

    def _look(self, t_ns: int, *, read: bool = False) -> None:
        """Notice that this process stood still."""
        stood_ns = self._attention.look(t_ns, read=read)
        self.watch.stood_still(stood_ns)
        if stood_ns and self._procedure is not None:
            self._procedure.stood_still(stood_ns)

    @property
    def _knows_the_vehicle(self) -> bool:
        """Whether its mode was heard since this process stood still: until then nothing but a landing is sent."""
        return self._attention.commands(self.watch.mode_ns)

    def _grounded(self, t_ns: int) -> bool:
        """Return whether the vehicle has said for a while, and just now, that it is on the ground."""
        watch = self.watch
        stands = watch.ground.stands(t_ns, GROUND_NS)
        return stands and watch.landed_ns is not None and watch.landed_ns >= self._attention.awake_ns

    def _is_down(self, t_ns: int) -> bool:
        """Return whether several messages agree that it is disarmed and on the ground."""
        return self.watch.ground.is_down(t_ns, self._spec.vehicle_age_limit_ns)

    # --- requests -------------------------------------------------------------------------------------------------

    def load(
        self, t_ns: int, request: LoadRequest, given: Optional[MissionPlan] = None
    ) -> Tuple[Loading, Sequence[Message]]:
        """Begin to send a waypoint file; the loading says when it is over, and how it ended.

        Args:
            t_ns: now.
            request: which file.
            given: a mission that is not configured; it is known from then on, where it is not refused.
        """
        self._look(t_ns)
        plan = given or self._plans.get(request.mission_id)
        in_flight = self._phase in IN_FLIGHT and not self._is_down(t_ns)
        disarming = self._landing if self._procedure is not None and self._procedure.running else ""
        readiness = Readiness(self.watch, self._spec, in_flight, self._wall(), disarming, self._may_be_late(t_ns))
        origin = self._origin if self._origin and self._origin.session_id == request.session_id else None
        loading = Loading(request, plan, origin, readiness, self._settings.limits, t_ns)
        if loading.refused:
            return loading, ()
        if given is not None:
            self._plans[request.mission_id] = given
        if self._loading is not None:
            self._loading.end("another file was loaded meanwhile")
        self._loading = loading
        self._phase, self._message, self._loaded, self._procedure = _P.IDLE, "", request, None
        self._landing, self._verification = "", None
        self._flight, self.watch.restarts = FlightRecord(self.watch), None
        self._questions.forget(t_ns)
        messages = loading.start(t_ns)
        self._finish_loading()
        return loading, messages if self._knows_the_vehicle else ()

    def _may_be_late(self, t_ns: int) -> str:
        """Return what was commanded and may still arm the vehicle: nothing would look after it then; empty: nothing."""
        if self._doing(_A.TAKEOFF) and self._procedure is not None and self._procedure.running:
            return "a takeoff is under way: ABORT cancels it"
        late = t_ns - self._commanded_ns <= _LATE_NS
        return f"what was commanded less than {_LATE_NS / _S:g} s ago may still take effect: load again" if late else ""

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
        self._look(t_ns)
        problem = refusal(self._standing(t_ns), session_id, action)
        if problem:
            return problem, ()
        return "", self._land(t_ns, _ASKED) if action in _LANDINGS else self._start(t_ns, action)

    def other_commands(self, t_ns: int, what: str) -> Sequence[Message]:
        """Take what the autopilot node commands: a landing or disarming then stands here as well; empty: nothing."""
        self._look(t_ns)
        self._other, self._other_ns = what, t_ns
        busy = self._phase in IN_FLIGHT or (self._procedure is not None and self._procedure.running)
        down = self._is_down(t_ns)
        if not what or not busy or self._landing or (down and not self._doing(_A.TAKEOFF)):
            return ()
        return self._land(t_ns, f"the autopilot node commands {what}")

    def _start(self, t_ns: int, action: MissionAction) -> List[Message]:
        """Begin a command that is no landing."""
        self._begin(t_ns, action)
        return [*(self._verification.start(t_ns) if self._verification else ()), *self._proceed(t_ns)]

    def _land(self, t_ns: int, why: str) -> List[Message]:
        """Land, or on the ground disarm: in place of whatever runs, until the vehicle is disarmed."""
        self._landing = why if why == _ASKED else self._landing or why
        if self._loading is not None and not self._loading.over:
            self._loading.end(why)
            self._finish_loading()
        self._begin(t_ns, self._meant(t_ns))
        if self._begins_to_land(t_ns):
            self._flight.look()  # what was reached by now counts
            self._phase = _P.LANDING
        return self._proceed(t_ns)

    def _begins_to_land(self, t_ns: int) -> bool:
        """Return whether a landing that nobody asked for may show at any moment: told before, it is no pilot's."""
        procedure, unasked = self._procedure, self._landing not in ("", _ASKED)
        if procedure is None or not unasked or not self._flight.airborne or not self._lands():
            return False
        return t_ns - procedure.begun_ns <= MODE_LATE_NS

    def _land_unasked(self, t_ns: int) -> List[Message]:
        """Land as nobody has asked to, once the mode is heard; in vain: end what we send, and have failed."""
        own = self._unasked
        if self._landing or self._phase not in (*IN_FLIGHT, _P.FAILED):
            own.drop()
        if own.is_due(t_ns):
            return self._land(t_ns, own.drop())
        if own.gives_up(t_ns):
            self._means.stream_ns = None
            self._fail(own.words)
        return []

    def _standing(self, t_ns: int) -> Standing:
        offboard = self._controller is Controller.OFFBOARD
        return Standing(
            watch=self.watch,
            tells_mode=self.watch.tells_mode(t_ns, self._spec.vehicle_age_limit_ns),
            unknown=self.watch.unknown(t_ns, self._spec.vehicle_age_limit_ns),
            phase=self._phase,
            session_id=self._loaded.session_id if self._loaded else None,
            lost=offboard and self._pose(t_ns) is None,
            landing=self._landing,
            other=self._other if t_ns - self._other_ns < _OTHER_NS else "",
            restarts=bool(self.watch.restarts) and self._controller is Controller.MISSION,
            steered=self._flight.agreed_steered_by_others,
            moved=self._flight.not_to_go_on,
            begun_anew=frame_begun_anew(self._origin, self.watch, self._wall()) if offboard else "",
            misplaced=self._loading.problem_of_takeoff(t_ns) if self._loading is not None else "",
        )

    @property
    def _why_landed(self) -> str:
        """Why it is landed without a command of the mission, in words; empty: it is not, or its file is flown."""
        return "" if self._landing in (_ASKED, _FLOWN) else self._landing

    def _meant(self, t_ns: int) -> MissionAction:
        """Return what a landing is: disarming, before lift-off with the ground shown freshly; else the landing mode."""
        if self._landing == _TAKEN_OVER and not self._flight.airborne:
            return _A.ABORT  # never a mode of ours: a disarming is sent on the ground alone
        heard = self.watch.known(t_ns, self._spec.vehicle_age_limit_ns)
        down = heard and self._grounded(t_ns)
        if self._doing(_A.ABORT):  # once it is that, a landed state that is a little late does not end it
            down = heard and self.watch.on_ground(t_ns, self._spec.vehicle_age_limit_ns)
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
        if action in (_A.HOLD, _A.RESUME) and self._means.stream_ns is None and self._flight.guidance is not None:
            self._means.stream_ns = t_ns
        if action is _A.RESUME and self._means.resume_item is not None:
            self._means.resume_item = max(self._means.resume_item, self._flight.passed)  # told late, it was passed
            self._flight.held_item.expect(self._means.resume_item)
        if action in (_A.HOLD, _A.RESUME) and self._controller is Controller.MISSION:
            held = self._flight.item if self._means.resume_item is None else self._means.resume_item
            begun = None if held is None or action is _A.HOLD else beginning(held, self.watch.dialect)
            self._flight.goes_on_from(begun)
            self._means.verified = self._flight.told_of_mission(t_ns, self._loading, goes_on=action is _A.RESUME)
        if action in _LANDINGS:
            self._landing, self._verification = self._landing or _ASKED, None
        persistent = action in _LANDINGS
        steps = steps_of(self._controller, action, self.watch.dialect)
        self._procedure = Procedure(action, steps, self._means, self._spec, t_ns, persistent=persistent)
        self._message = self._flight.hands_off() or self._why_landed

    def _take_off(self, t_ns: int) -> None:
        self._phase, self._flight = _P.TAKING_OFF, FlightRecord(self.watch, self._flight.waypoints)
        self._means.resume_item = self._means.stream_ns = None
        self._means.lifted = self._means.verified = False
        self._means.commanded.clear()
        self._begin_verification(t_ns)
        pose, origin, loading = self._pose(t_ns), self._origin, self._loading
        if self._controller is Controller.OFFBOARD and pose and origin and origin.local and loading:
            self._flight.guidance = Guidance(
                loading.trajectory.waypoints,
                origin.local,
                climb_of(self._plans[loading.request.mission_id], self._settings.limits),
                self._settings.model,
                self._spec,
                pose,
                self.watch.heading(t_ns, self._spec.vehicle_age_limit_ns),
                self.watch.target,
            )
            self._means.stream_ns = t_ns

    def shutdown(self, t_ns: int) -> Tuple[bool, Sequence[Message]]:
        """Land before the process ends, unless it is on the ground, or somebody else flies; return whether it lands.

        Where it has failed, and lands as soon as the flight mode is heard, it is in flight still. On the ground it
        disarms, and stays, for as long as an arming of ours may take effect: nobody would look after the vehicle.
        """
        self._look(t_ns)
        flies = self._phase in IN_FLIGHT or (self._phase is _P.FAILED and bool(self._unasked.why))
        may_arm = bool(self._may_be_late(t_ns)) and not self._flight.airborne
        leaves = not may_arm and (not flies or self._is_down(t_ns))
        if leaves or (self.watch.armed and self.watch.others_fly):
            return False, ()
        self.guards = may_arm
        messages: Sequence[Message] = ()
        if not may_arm or (not self._landing and self._meant(t_ns) is not _A.ABORT):
            self._unasked.want(t_ns, ENDS)
            messages = self._land_unasked(t_ns)
        elif not self._landing:
            messages = self._land(t_ns, ENDS)
        self._ends_on_ground = may_arm or self._doing(_A.ABORT)
        return True, messages

    @property
    def takes_back(self) -> bool:
        """True where it is told to end on the ground and takes an arming of ours back, until it turns out to fly."""
        lands = bool(self._unasked.why) or self._doing(_A.LAND) or self._flight.airborne
        return self._ends_on_ground and not lands

    @property
    def landing_shown(self) -> bool:
        """True once the vehicle lands, has landed, or is somebody else's: messages agree on it."""
        running, lands = self._procedure is not None and self._procedure.running, self._doing(*_LANDINGS)
        over = self._phase not in IN_FLIGHT and not self._unasked.why and not (lands and running)
        shown = over or (lands and not running)
        return (shown and (not self.guards or bool(self.landing_taken))) or self._unasked.left

    @property
    def landing_waits(self) -> bool:
        """True while the landing is not commanded, because the flight mode is not heard."""
        return bool(self._unasked.why)

    @property
    def landing_taken(self) -> str:
        """Who has taken the vehicle from its landing, or why none was sent, in words; empty: neither."""
        if self._unasked.why or self._unasked.left:
            return self._unasked.not_sent
        procedure = self._procedure
        taken = procedure is not None and procedure.progress is Progress.TAKEN and self._doing(*_LANDINGS)
        return procedure.reason if procedure is not None and taken else ""

    # --- what the vehicle does ------------------------------------------------------------------------------------

    @property
    def _controller(self) -> Controller:
        plan = self._plans.get(self._loaded.mission_id) if self._loaded else None
        return plan.controller if plan else Controller.MISSION

    def _pose(self, t_ns: int) -> Optional[Pose]:
        return self.watch.local(t_ns, self._spec.pose_age_limit_ns)

    def _follow(self, t_ns: int) -> None:
        """Read the phase from the vehicle."""
        watch, flight = self.watch, self._flight
        if self._phase is _P.LANDED:
            self._follow_landed(t_ns)
        if not watch.known(t_ns, self._spec.vehicle_age_limit_ns):
            return
        if self._landing and self._phase not in IN_FLIGHT:
            flight.look()
        if self._phase not in (*IN_FLIGHT, _P.FAILED) or self._never_flew(t_ns):
            return
        flight.look()
        self._means.lifted = flight.lifted
        if not flight.armed and self._phase is _P.FAILED:
            flight.guidance = None
        if not flight.armed and not self._doing(_A.LAND):
            return  # mode and landed state are still those of the flight before
        if flight.seems_down:
            counted = flight.is_counted(t_ns, asked=self._doing(_A.LAND, _A.ABORT))
            if counted and self._is_down(t_ns):
                self._end()
        elif watch.armed and watch.tells_mode(t_ns, self._spec.vehicle_age_limit_ns):
            self._follow_armed(t_ns)

    def _never_flew(self, t_ns: int) -> bool:
        """Return whether a takeoff has failed, and the vehicle has stood since: who arms it later flies his own."""
        flight = self._flight
        if self._phase is _P.FAILED and not flight.armed:
            down = self._is_down(t_ns) and t_ns - self._commanded_ns > _LATE_NS
            flight.stays_down(t_ns, self._settings.limits.confirm_limit_ns, down=down)
        return self._phase is _P.FAILED and flight.is_over

    def _follow_landed(self, t_ns: int) -> None:
        """Look whether the flight that was over goes on, as long as it may."""
        flight = self._flight
        flight.stays_down(t_ns, self._settings.limits.confirm_limit_ns, down=self._is_down(t_ns))
        if self.watch.known(t_ns, self._spec.vehicle_age_limit_ns) and flight.goes_on():
            self._go_on(t_ns)

    def _go_on(self, t_ns: int) -> None:
        """Take back that the flight is over; what was commanded last is so still: it lands, or flies on."""
        self._phase = _P.FLYING
        if self._flight.guidance is not None:
            self._means.stream_ns = t_ns
        if self._flight.landing:
            self._landing = self._flight.landing
            self._begin(t_ns, _A.LAND)

    def _follow_armed(self, t_ns: int) -> None:
        """Read the phase of a vehicle that is armed; LANDING is ours: the engine takes its mode for ours then."""
        watch, flight, procedure = self.watch, self._flight, self._procedure
        others = watch.mode in LANDING_MODES and not self._landing and LAND not in self._means.commanded
        if not others:
            self._phase = _P.LANDING if self._begins_to_land(t_ns) else flight.phase(self._phase)
        elif self._phase is _P.LANDING:
            self._phase = _P.FLYING
        lands = f"somebody else lands the vehicle (mode {watch.mode})" if others else ""
        resume = procedure if procedure is not None and procedure.running and self._doing(_A.RESUME) else None
        if resume is None or not resume.changes_mode:
            flight.look_at_the_hold(self._pose(t_ns))
        flight.look_at_home(self._pose(t_ns))
        if resume is not None and flight.not_to_go_on and not resume.changes_mode:
            resume.fail(flight.not_to_go_on)
        if self._flies_ours and flight.flies_from_another_home():
            self._give_up(flight.home_height.words)
        others_fly = lands or flight.hands_off() or flight.steered_by_others
        stays = "" if self._landing or flight.failure else flight.not_to_go_on  # then it would not go on anyway
        reason = procedure.reason if procedure else ""
        self._message = others_fly or stays or reason or flight.failure or self._why_landed

    def _doing(self, *actions: MissionAction) -> bool:
        """Return whether one of these was commanded last."""
        procedure = self._procedure  # once: the node asks from another thread
        return procedure is not None and procedure.action in actions

    def _end(self) -> None:
        """Be on the ground, disarmed."""
        if not self._flight.airborne and not self._flight.failure and not self._doing(_A.LAND, _A.ABORT):
            self._flight.failure = "disarmed before it lifted off"
        self._message = self._flight.failure or self._why_landed
        if self._phase in (*IN_FLIGHT, _P.LOADED, _P.FAILED):
            never_armed = self._landing in (_NO_TAKEOFF, _TAKEN_OVER) and not self._flight.armed
            self._phase = _P.FAILED if never_armed else _P.LANDED
        self._flight.landing = self._landing
        self._procedure = self._verification = self._means.stream_ns = None

    def _uphold(self, t_ns: int) -> None:
        """Keep a landing up until the vehicle is disarmed, and nothing of ours that is late can arm it again."""
        watch, procedure = self.watch, self._procedure
        if not self._landing or not watch.known(t_ns, self._spec.vehicle_age_limit_ns):
            return
        late, down = t_ns - self._commanded_ns <= _LATE_NS, self._is_down(t_ns)
        if procedure is not None and procedure.running:
            meant = self._meant(t_ns)
            if down and procedure.action is _A.LAND and meant is _A.LAND and self._flight.airborne:
                self._procedure = None
            elif meant is not procedure.action:
                self._begin(t_ns, meant)
        elif watch.armed is False:
            self._landing = "" if down and not late else self._landing
        elif self._is_done() and not self._flight.hands_off():
            late = late and watch.mode in self._means.commanded - {LAND}  # an older command of ours came last
            if late or self._meant(t_ns) is _A.ABORT:
                self._begin(t_ns, self._meant(t_ns))

    def _is_done(self) -> bool:
        """Return whether nothing runs because it is done, not because somebody else has control."""
        return self._procedure is None or self._procedure.progress is Progress.DONE

    # --- what is sent ---------------------------------------------------------------------------------------------

    def _proceed(self, t_ns: int) -> List[Message]:
        age_limit_ns = self._spec.vehicle_age_limit_ns
        self._means.grounded = not self._flight.airborne and self._grounded(t_ns)
        self._uphold(t_ns)
        self._end_upload_of_armed(t_ns)
        procedure = self._procedure
        if procedure is None or not procedure.running:
            return []
        lands = procedure.action in _LANDINGS
        if not lands and t_ns < self._attention.awake_ns and self.watch.unknown(t_ns, age_limit_ns):
            return []  # not silent: not read yet
        read_again = self._verify(t_ns)
        self._give_up_late_takeoff(procedure)
        flight = self._flight
        if not lands and flight.agreed_steered_by_others and not self.watch.control.unexplained:
            procedure.fail(flight.agreed_steered_by_others)
        commands = self._knows_the_vehicle and not flight.steered_by_others
        sends = self._attention.lands(t_ns, self.watch.mode_ns) if lands else commands
        sent = [*read_again, *procedure.wake(t_ns, sends=sends)]
        self._note(t_ns, procedure, sent)
        if procedure.action is _A.TAKEOFF and procedure.progress is Progress.FAILED:
            sent += self._cancel(t_ns, procedure.reason)
        elif procedure.action is _A.TAKEOFF and procedure.progress is Progress.TAKEN and not self._flight.airborne:
            sent += self._recall(t_ns, procedure.reason)
        elif procedure.action is _A.TAKEOFF and procedure.progress is Progress.SILENT:
            self._fail(procedure.reason)
        elif procedure.progress is Progress.DONE and procedure.action is _A.ABORT:
            self._end()
        elif procedure.reason:
            self._message = self._flight.hands_off() or procedure.reason
        return sent

    def _note(self, t_ns: int, procedure: Procedure, sent: Sequence[Message]) -> None:
        """Take notice of what was sent: what is no landing may take effect late, a RESUME ends the hold."""
        if sent and procedure.action not in _LANDINGS:
            self._commanded_ns = t_ns
        if procedure.action is _A.RESUME and procedure.changes_mode:
            self._flight.leave_the_hold(t_ns)

    def _begin_verification(self, t_ns: int) -> None:
        self._verified_id = self.watch.mission_id
        self._verification = self._loading.verification(t_ns) if self._loading else None

    def _verify(self, t_ns: int) -> Sequence[Message]:
        """Look whether the mission on the vehicle is still the one that was sent; return what is sent for that."""
        reading = self._verification
        read = reading is not None and reading.phase is UploadPhase.DONE
        if read and self.watch.mission_id != self._verified_id and self._controller is Controller.MISSION:
            self._begin_verification(t_ns)  # another one came meanwhile: what was read may have been the one before
            return self._verification.start(t_ns) if self._verification is not None else ()
        if self._controller is Controller.OFFBOARD or read:
            self._means.verified, self._verification = True, None
            self._flight.mission_id = self.watch.mission_id if read else self._flight.mission_id
        elif reading is not None and reading.over and self._procedure is not None:
            self._procedure.fail(f"the mission did not read back as it was sent: {reading.reason}")
            self._verification = None
        return ()

    def _give_up_late_takeoff(self, takeoff: Procedure) -> None:
        """Give a takeoff up, on the ground, in which this process stood still so long that the engine has landed."""
        late = takeoff.longest_pause_ns > self._settings.limits.planner_status_limit_ns - _STATUS_NS
        if late and takeoff.action is _A.TAKEOFF and not self._flight.airborne and self._knows_the_vehicle:
            takeoff.fail(f"the planner stood still for {takeoff.longest_pause_ns / _S:.1f} s")

    def _look_at_mission(self) -> None:
        """Look whether the vehicle says that it has the mission that was read back at the takeoff."""
        loading, flight, procedure = self._loading, self._flight, self._procedure
        if self._landing or flight.replaced or self._phase not in (_P.TAKING_OFF, _P.FLYING, _P.HOLDING):
            return
        total = loading.total if loading is not None else None
        other = flight.is_replaced(total)
        if not other:
            return
        reason = f"somebody else has replaced the mission on the vehicle: {other}"
        if self._doing(_A.TAKEOFF) and procedure is not None and procedure.running and not flight.airborne:
            procedure.fail(reason)
        else:
            self._procedure = None  # nothing of ours may go on with that mission
            self._fail(reason)

    def _look_at_held(self, t_ns: int, message: Optional[Message] = None) -> List[Message]:
        """Look whether a mission that is held is still ours, where the vehicle does not tell it by itself."""
        flight, held, resume = self._flight, self._flight.held, self._procedure if self._doing(_A.RESUME) else None
        away = self._landing or self._phase not in (_P.TAKING_OFF, _P.FLYING, _P.HOLDING)
        if held is None or held.over or away or flight.hands_off():
            return []
        if message is not None:
            sent = held.receive(t_ns, message)
        else:
            sent = held.wake(t_ns) if self._knows_the_vehicle else []
        self._means.verified = held.may_go_on(t_ns)
        if held.difference:
            flight.replaced, self._procedure = True, None
            self._fail(f"somebody else has replaced the mission on the vehicle: {held.difference}")
        elif resume is not None and held.is_late(t_ns):
            resume.fail("the mission was not read back in time to go on")
        return sent

    def _look_at_resume(self) -> None:
        """Look whether a mission that was held goes on, and does not begin anew (ArduPilot with MIS_RESTART)."""
        if self._landing or self._flight.replaced or self._phase not in (_P.FLYING, _P.HOLDING, _P.TAKING_OFF):
            return
        if self._flight.begins_anew():
            self._procedure = None  # it flies to where it was, on a way that nobody has checked
            self._fail(f"the mission began anew when it was to go on: it is at item {self.watch.current}")

    @property
    def _flies_ours(self) -> bool:
        """Whether the vehicle flies, or holds, a mission that is ours so far, and that nobody has ended."""
        return not self._landing and not self._flight.replaced and self._phase in (_P.TAKING_OFF, _P.FLYING, _P.HOLDING)

    def _give_up(self, reason: str) -> None:
        """Give up a mission that is flown otherwise than it was checked."""
        self._flight.replaced, self._procedure = True, None
        self._fail(reason)

    def _cancel(self, t_ns: int, reason: str) -> List[Message]:
        """Give a takeoff up that did not begin: disarm; an arming may be under way, unseen."""
        sent = self._land(t_ns, _NO_TAKEOFF)
        self._flight.failure = self._message = reason
        return sent

    def _recall(self, t_ns: int, reason: str) -> List[Message]:
        """Give a takeoff up that somebody else came before: their mode stands, our ARM is taken back on the ground."""
        self._means.stream_ns = None
        sent = self._land(t_ns, _TAKEN_OVER)
        self._flight.failure = self._message = reason
        return sent

    def _fail(self, reason: str) -> None:
        """Have failed to take off, with what the vehicle does now unknown: whoever commanded it says what is next."""
        self._phase, self._flight.failure, self._message, self._verification = _P.FAILED, reason, reason, None
        if self._flight.guidance is not None:
            self._flight.guidance.stand()

    def _end_upload_of_armed(self, t_ns: int) -> None:
        """End an upload into a vehicle that somebody else arms."""
        loading, watch = self._loading, self.watch
        armed = watch.armed is not False and watch.known(t_ns, self._spec.vehicle_age_limit_ns)
        if armed and loading is not None and not loading.over:
            loading.end("the vehicle was armed meanwhile")
            self._finish_loading()

    def _stream(self, t_ns: int) -> List[Message]:
        """Return the next set-point, as long as there is a flight by set-points that nobody else has taken over."""
        guidance = self._flight.guidance
        pose = self._pose(t_ns)
        if guidance is not None and pose is not None and self._may_begin_anew():
            guidance.stands_at(pose)
        if self._flight.airborne and self.watch.off_setpoints and not self._wants_offboard():
            self._means.stream_ns = None  # for good: whoever chooses OFFBOARD now was not asked to by the engine
        if (
            guidance is None
            or self._means.stream_ns is None
            or not self._means.streams
            or not self._attention.streams(t_ns)
            or t_ns - self._setpoint_ns < _S / self._spec.setpoint_rate_hz * 0.9
        ):
            return []
        self._setpoint_ns = t_ns
        guidance.flying = bool(self.watch.armed) and self.watch.mode == OFFBOARD and not self._flight.down
        sent = [guidance.step(t_ns, pose, self.watch.heading(t_ns, self._spec.vehicle_age_limit_ns))]
        self._means.still = guidance.still
        blind = guidance.blind_ns(t_ns) > _BLIND_PAUSES * self._spec.pose_age_limit_ns
        blind = blind and t_ns >= self._attention.awake_ns
        if guidance.flying and (guidance.finished or blind) and not self._lands():
            self._unasked.want(t_ns, "the local position stays away" if blind else _FLOWN)
        return sent

    def _may_begin_anew(self) -> bool:
        """Return whether the height may still do so: an ArduPilot without a home sets it to 0 as it arms."""
        watch = self.watch
        waits = watch.armed and watch.landed is VehicleLanded.ON_GROUND and not self._flight.airborne
        return bool(waits) and watch.dialect is Dialect.ARDUPILOT

    def _wants_offboard(self) -> bool:
        procedure = self._procedure
        return procedure is not None and procedure.running and procedure.action in (_A.TAKEOFF, _A.HOLD, _A.RESUME)

    def _lands(self) -> bool:
        procedure = self._procedure
        return procedure is not None and procedure.running and procedure.action is _A.LAND

    # --- what is told ---------------------------------------------------------------------------------------------

    def status(self, t_ns: int) -> MissionStatus:
        """Return what is to be known of it, level-based."""
        return self._progress().status(t_ns, self._loaded)

    def last_status(self, t_ns: int) -> MissionStatus:
        """Return what is told last, where it lands or disarms as it ends: a landing mode that shows now is no pilot's.

        Also on the ground it is LANDING: the vehicle may have lifted off, unseen, and the landing mode follow. What has
        failed there stays so, with its reason.
        """
        if self._phase not in IN_FLIGHT and not self._doing(_A.LAND):
            return self.status(t_ns)
        words = f"the planner ends: it {'disarms' if self.takes_back else 'lands'}"
        return self._progress()._replace(phase=_P.LANDING, message=words).status(t_ns, self._loaded)

    def level(self, t_ns: int) -> Tuple[object, ...]:
        """Return what of its status is told at once when it changes."""
        return (*self._progress().level(t_ns), self._loaded)

    def _progress(self) -> FlightProgress:
        return FlightProgress(
            watch=self.watch,
            age_limit_ns=self._spec.vehicle_age_limit_ns,
            model=self._settings.model,
            loading=self._loading,
            origin=self._origin,
            flight=self._flight,
            phase=self._phase,
            message=self._unasked.words or self._message,
        )
