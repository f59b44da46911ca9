"""Our mission planner as the mission sequencer of the CNS Flight Stack. Pure.

`REQUESTS` is the table: in which stages a request fits, what our planner is told, and the pairs (response, completed)
that answer it. What is not as with its sequencer, since our planner does it so, or for safety:

* Waypoints are loaded on the ground: those that came before TAKEOFF, else those of the mission with the request's id in
  missions.yaml. With the latter it hovers at its takeoff height until a list comes that says the same.
* ARM is noted: our planner arms a vehicle that is about to take off, and no other. TAKEOFF arms.
* LAND is never refused in flight, whatever its id, and has the autopilot node as its second route. No other request
  does anything with another id than the current one.
* A landing stands: HOLD does not interrupt it. ABORT lands, and before lift-off disarms.
* A takeoff whose answer is lost is refused and aborted: it may have begun.
* After the last waypoint it hovers for a time, and then lands though nobody asks.
* HOVER ends a mission in the air: what was left of it is not flown any more.
* What was loaded is not known to a process that is started again: a mission of missions.yaml that may still wait for
  its list hovers then until LAND.
* A planner that is started again in flight has lost its mission: that counts as one that has failed.
"""

from __future__ import annotations

import enum
import re
from dataclasses import dataclass, replace
from math import degrees, dist, isfinite, pi, radians, remainder
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from amaze_autonomy.engine.commands import AutopilotLand, MissionAction, MissionCommand
from amaze_autonomy.engine.commands import Request as Command
from amaze_autonomy.engine.events import (
    AutopilotStatus,
    CheckReply,
    Event,
    MissionPhase,
    MissionStatus,
    Outcome,
    Reply,
    VehicleLanded,
)
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Controller, Frame, MissionPlan, Waypoint

from .peers import Publish
from .served import Notice, Served, why_not
from .tables import Answer, Reference, Request, WaypointAction

_S = 1_000_000_000
_LIST_NS = _S  # a list may come on its topic a little after the TAKEOFF that was sent behind it
_NEAR_M = 0.3  # of its takeoff height, as its sequencer sees it
_SAME_M, _SAME_RAD = 0.05, 0.02
_MISSION = re.compile(r"cns_(\d+)(_\d+)?")  # id of its mission; of a file of missions.yaml, which one
_P = MissionPhase
_NOT_DONE = (Outcome.REFUSED, Outcome.UNAVAILABLE)  # of other outcomes than these nobody knows
_FLIES = (_P.TAKING_OFF, _P.FLYING, _P.HOLDING, _P.LANDING)


class Stage(enum.Enum):
    """How far its engine's mission has come, as its sequencer would have it."""

    IDLE = 0
    ARMED = 1  # noted, no more
    TAKEOFF = 2
    HOVER = 3
    MISSION = 4
    HOLD = 5
    LAND = 6
    LANDED = 7


class Row(NamedTuple):
    """One row of the table.

    Args:
        fits: stages in which a request fits.
        action: what our planner is told; None: nothing.
        first: the answer at once; None: none before it is done.
        last: the answer when it is done.
        limit: of `Limits`: the time in which it must be done, or, of a landing, shown; empty: our planner has its own.
    """

    fits: Tuple[Stage, ...]
    action: Optional[MissionAction]
    first: Optional[Answer]
    last: Answer
    limit: str = ""


_T, _A = Stage, MissionAction
_IN_AIR = (_T.TAKEOFF, _T.HOVER, _T.MISSION, _T.HOLD, _T.LAND)
_TAKEN = Answer.ACCEPTED
REQUESTS: Mapping[Request, Row] = {
    Request.ARM: Row((_T.IDLE,), None, _TAKEN, Answer.COMPLETED),
    Request.TAKEOFF: Row((_T.ARMED,), _A.TAKEOFF, _TAKEN, Answer.COMPLETED),
    Request.HOLD: Row((_T.TAKEOFF, _T.HOVER, _T.MISSION), _A.HOLD, None, Answer.DONE, "hold_confirm_limit_ns"),
    Request.RESUME: Row((_T.HOLD,), _A.RESUME, None, Answer.DONE, "resume_confirm_limit_ns"),
    Request.LAND: Row((*_IN_AIR, _T.LANDED), _A.LAND, _TAKEN, Answer.COMPLETED, "land_second_route_after_ns"),
    Request.HOVER: Row((_T.MISSION, _T.HOLD), _A.HOLD, _TAKEN, Answer.COMPLETED, "hold_confirm_limit_ns"),
    Request.ABORT: Row(_IN_AIR, _A.ABORT, None, Answer.DONE),
    Request.DISARM: Row((_T.ARMED, _T.LANDED), _A.ABORT, _TAKEN, Answer.COMPLETED, "cancel_limit_ns"),
}
"""Its requests; any other, and one that does not fit, is refused."""

_LANDS = (Request.LAND, Request.ABORT)
_FRAMES: Mapping[Reference, Optional[Frame]] = {
    Reference.GLOBAL: None,
    Reference.LOCAL: Frame.START_HEADING,
    Reference.CUR_POS: None,
    Reference.CUR_POSE: Frame.START_HEADING,  # before the takeoff: where it stands, as it stands
}
"""Ours by their reference; None: along axes of the estimator's frame, which need not be east and north."""
_STAGES: Mapping[MissionPhase, Stage] = {
    _P.TAKING_OFF: _T.TAKEOFF,
    _P.FLYING: _T.MISSION,
    _P.HOLDING: _T.HOLD,
    _P.LANDING: _T.LAND,
    _P.LANDED: _T.LANDED,
}
"""By the phase of our planner; where it says another one, the stage stays."""


@dataclass(frozen=True)
class LoadWaypoints(Command):
    """Ask our planner to load waypoints that no file has."""

    session_id: str
    mission_id: str
    frame: Frame
    waypoints: Tuple[Waypoint, ...]


class PlannerSettings(NamedTuple):
    """What it knows of our planner.

    Args:
        plans: the missions that are configured.
        limits: of the engine.
        begin: what the ids of its sessions begin with.
        radius_m: nearer than this a waypoint is reached.
        hover_ns: after the last waypoint, before it lands by itself.
        max_hold_ns: that our planner takes.
    """

    plans: Sequence[MissionPlan]
    limits: Limits
    begin: str
    radius_m: float
    hover_ns: int
    max_hold_ns: int


@dataclass(eq=False)
class _Pending:
    """A request that is being carried out.

    Args:
        request: which one; UNDEF: a list that is flown.
        number: id that it came with.
        command: the request to our nodes whose answer it waits for; None: that was accepted.
        limit_ns: time from then on in which it must be done; 0: our planner has its own.
        until_ns: when that is over.
        loading: waypoints are being loaded, the takeoff itself comes behind.
        second: the autopilot node was asked to land.
    """

    request: Request
    number: int
    command: Optional[int] = None
    limit_ns: int = 0
    until_ns: Optional[int] = None
    loading: bool = False
    second: bool = False


class ServedPlanner(Served):
    """One mission at a time; after a start of this process in flight it goes on with the one that our planner names.

    Args:
        ids: of the requests to our nodes.
        settings: what it knows.
    """

    def __init__(self, ids: Iterator[int], settings: PlannerSettings) -> None:
        super().__init__(ids)
        self._settings, self._limits = settings, settings.limits
        self._plans = {plan.mission.id: plan for plan in settings.plans}
        self.stage = Stage.IDLE
        self._id, self._session, self._sessions = 0, "", 0
        self._list: Tuple[Waypoint, ...] = ()
        self._flown: Tuple[Waypoint, ...] = ()  # what was loaded, with the holds that its engine gave
        self._takeoffs: Dict[int, int] = {}  # with files of missions.yaml, by the mission's id
        self._pending: List[_Pending] = []
        self._list_until_ns: Optional[int] = None  # a takeoff waits for its waypoints
        self._planner_ns: Optional[int] = None
        self._status: Optional[MissionStatus] = None  # of this session
        self._vehicle: Optional[AutopilotStatus] = None
        self._reset()

    def _reset(self) -> None:
        """Forget what is known of a flight."""
        self._expects = False  # it hovers, or will, for the list that says what was loaded
        self._hovers = False  # held for its engine's hover
        self._held = False  # held for its HOLD
        self._lands = False
        self._reached = 0
        self._last_ns: Optional[int] = None  # since when it has been at the last waypoint
        self._ended = False  # its engine was told that all were reached

    # --- requests of its engine -----------------------------------------------------------------------------------

    def heard(self, t_ns: int, key: str, message: Any) -> None:
        """Take a request, or a list of waypoints."""
        if key == "waypoint_list":
            problem = self._take_list(t_ns, message)
            if problem:
                self.outbox.append(Notice(f"waypoints are not taken: {problem}"))
            return
        number, asked = int(message.id), int(message.request)
        problem = self._problem(t_ns, number, asked)
        if problem:
            self._answer(number, asked, Answer.REFUSED, problem)
        else:
            self._take(t_ns, number, Request(asked))
            self._look(t_ns)

    def _problem(self, t_ns: int, number: int, asked: int) -> str:
        """Return why a request is refused; empty when it is not."""
        if asked not in list(REQUESTS):
            return "our planner has no counterpart"
        if asked == Request.LAND and not self._on_ground(t_ns):
            return ""
        if self.stage is not Stage.IDLE and number != self._id:
            return f"its id is {number}, that of the mission is {self._id}"
        if self.stage not in REQUESTS[Request(asked)].fits:
            return f"it does not fit in stage {self.stage.name}"
        if asked == Request.ARM and not self._is_fresh(t_ns, self._planner_ns):
            return "our planner says nothing"
        if asked == Request.DISARM and not self._on_ground(t_ns):
            return "the vehicle does not say that it is on the ground"
        return ""

    def _take(self, t_ns: int, number: int, request: Request) -> None:
        row = REQUESTS[request]
        if row.first is not None:
            self._answer(number, request, row.first)
        if request is Request.ARM:
            self._id, self._sessions, self.stage = number, self._sessions + 1, Stage.ARMED
            self._session, self._status = f"{self._settings.begin}_{self._sessions}", None
            self._reset()
            self.outbox.append(Notice("ARM is noted: our planner arms with TAKEOFF, when it is about to take off"))
            self._answer(number, request, row.last)
        elif request is Request.TAKEOFF:
            self.stage, self._list_until_ns = Stage.TAKEOFF, t_ns + _LIST_NS
            self._pending.append(_Pending(request, number, loading=True, command=0))
            self._load(t_ns)
        elif request is Request.RESUME and self._hovers:  # its hover is a hold of our planner, which stays
            self._held, self.stage = False, Stage.HOVER
            self._answer(number, request, row.last)
        elif self.stage not in _IN_AIR and self._is_down(t_ns):  # it is so already
            self._pending.append(_Pending(request, number))
        else:
            self._command(number, request, row)

    def _command(self, number: int, request: Request, row: Row) -> None:
        """Tell our planner; a landing is in the place of all that is under way, and of itself."""
        for each in [each for each in self._pending if request in _LANDS or each.request is request]:
            self._pending.remove(each)
            if each.request not in (*_LANDS, request, Request.UNDEF):
                self._answer(each.number, each.request, Answer.REFUSED, f"{request.name} was asked")
        if request in _LANDS:
            self._list_until_ns, self._lands = None, True
        if request is Request.HOVER:
            self._hovers, self._held = True, False
        assert row.action is not None  # noqa: S101 - ARM has none, and was taken before
        limit_ns = getattr(self._limits, row.limit) if row.limit else 0
        self._pending.append(_Pending(request, number, self._send(row.action), limit_ns))

    def _send(self, action: MissionAction) -> int:
        command, limit_ns = next(self._ids), self._limits.command_reply_limit_ns
        self.outbox.append(MissionCommand(id=command, limit_ns=limit_ns, session_id=self._session, action=action))
        return command

    def _answer(self, number: int, asked: int, answer: Answer, why: str = "") -> None:
        response, completed = answer.value
        fields = {"request": {"id": number, "request": int(asked)}, "response": response, "completed": completed}
        self.outbox.append(Publish("response", fields))
        if why:
            name = Request(asked).name if asked in list(Request) else f"request {asked}"
            self.outbox.append(Notice(f"{name} is refused: {why}"))

    # --- waypoints of its engine ----------------------------------------------------------------------------------

    def _take_list(self, t_ns: int, message: Any) -> str:
        """Take a list; return why it is not taken, empty when it is."""
        known = message.reference in list(Reference) and not message.is_global
        reference = Reference(message.reference) if known else Reference.GLOBAL
        if _FRAMES[reference] is None:
            return f"{reference.name} is along axes of the estimator, which need not be east and north; LOCAL is taken"
        given = tuple(Waypoint(each.x, each.y, each.z, radians(each.yaw), each.holdtime) for each in message.waypoints)
        for number, each in enumerate(given, start=1):
            if not all(map(isfinite, (each.x_m, each.y_m, each.z_m, each.yaw_rad, each.hold_s))):
                return f"waypoint {number} has a number that is not finite"
        if self.stage in _IN_AIR and self._list_until_ns is None:
            return self._fly_list(given)
        idx, many = int(message.idx), len(self._list)
        begin = {WaypointAction.CLEAR: 0, WaypointAction.APPEND: many, WaypointAction.INSERT: idx}.get(message.action)
        if begin is None or begin > many:
            return f"action {message.action} at {idx} of {many} waypoints is none"
        old = () if message.action == WaypointAction.CLEAR else self._list
        self._list = (*old[:begin], *given, *old[begin:])
        self._load(t_ns)
        return ""

    def _fly_list(self, given: Tuple[Waypoint, ...]) -> str:
        """Fly what was loaded, where it hovers for a list that says the same."""
        if not (self._expects and self._hovers and self.stage is Stage.HOVER):
            return "our planner loads on the ground alone: send them before TAKEOFF"
        if not self._flown:
            return "what is loaded is not known since this node was started again; it hovers until LAND"
        if len(given) != len(self._flown) or not all(map(_is_same, given, self._flown)):
            return f"they are not those of mission {self._id} in missions.yaml, which are loaded; it hovers on"
        self._hovers = self._expects = False
        limit_ns = self._limits.resume_confirm_limit_ns
        self._pending.append(_Pending(Request.UNDEF, self._id, self._send(_A.RESUME), limit_ns))
        return ""

    def _load(self, t_ns: int) -> None:
        """Load what is to be flown once it is known: the list, else a file of the mission that has the id."""
        if self._list_until_ns is None or not (self._list or t_ns >= self._list_until_ns):
            return
        self._list_until_ns, self._expects = None, not self._list
        mission_id, hover_s = f"cns_{self._id}", self._settings.hover_ns / _S
        self._flown = self._list
        if not self._list:
            plan = self._plans.get(str(self._id))
            problem = self._problem_of_plan(plan)
            if plan is None or problem:
                self._fail_takeoff(problem)
                return
            file = self._takeoffs.get(self._id, 0) % len(plan.trajectories)
            mission_id, self._flown = f"{mission_id}_{file + 1}", plan.as_drawn(file).waypoints
            hover_s = max(hover_s, plan.trajectories[file].waypoints[-1].hold_s - self._flown[-1].hold_s)
        last = self._flown[-1]
        hold_s = min(last.hold_s + hover_s, self._settings.max_hold_ns / _S)
        waypoints = (*self._flown[:-1], replace(last, hold_s=max(last.hold_s, hold_s)))
        waypoints = tuple(replace(each, yaw_rad=remainder(each.yaw_rad, 2 * pi)) for each in waypoints)
        command = next(self._ids)
        for each in self._pending:
            each.command = command if each.loading else each.command
        self.outbox.append(
            LoadWaypoints(
                id=command,
                limit_ns=self._limits.load_limit_ns,
                session_id=self._session,
                mission_id=mission_id,
                frame=Frame.START_HEADING,
                waypoints=waypoints,
            )
        )

    def _problem_of_plan(self, plan: Optional[MissionPlan]) -> str:
        """Return why a mission of missions.yaml is not flown: otherwise than it says, or its engine; empty: it is."""
        if plan is None or any(each.places for each in plan.trajectories):
            return f"no waypoints have come, and missions.yaml has no local mission {self._id}"
        if plan.frame is not Frame.START_HEADING:
            right = "its engine's waypoints count from each takeoff and its heading: start_heading is taken"
            return f"mission {self._id} is in the frame {plan.frame.value}, and {right}"
        if plan.controller is not Controller.MISSION:
            return (
                f"mission {self._id} is flown by set-points (controller: offboard): missions of the autopilot are taken"
            )
        return ""

    # --- answers of our services ----------------------------------------------------------------------------------

    def replied(self, t_ns: int, reply: Union[Reply, CheckReply]) -> None:
        """Take the answer of our planner, or of the second route of a landing."""
        each = next((each for each in self._pending if each.command == reply.command_id), None)
        if each is None:
            return
        problem = why_not(reply)
        if not problem:
            self._accepted(t_ns, each)
        elif each.request in _LANDS and not each.second:
            self._take_second_route(each, problem)
        elif each.loading or (each.request is Request.TAKEOFF and not self._hovers):
            self._fail_takeoff(problem, begun=not each.loading and reply.outcome not in _NOT_DONE)
        else:
            self._give_up(each, problem)
        self._look(t_ns)

    def _accepted(self, t_ns: int, each: _Pending) -> None:
        """Wait for it to show."""
        each.command = None
        each.until_ns = t_ns + each.limit_ns if each.limit_ns else None
        if each.loading:
            each.loading, each.command = False, self._send(_A.TAKEOFF)
        elif each.request is Request.TAKEOFF and not self._hovers:
            self._takeoffs[self._id] = self._takeoffs.get(self._id, 0) + self._expects
            self._list = ()

    def _take_second_route(self, each: _Pending, why: str) -> None:
        """Have the autopilot node land."""
        each.second, each.until_ns, each.command = True, None, next(self._ids)
        self.outbox.append(Notice(f"{each.request.name}: {why}; the autopilot node is asked to land"))
        self.outbox.append(AutopilotLand(id=each.command, limit_ns=self._limits.command_reply_limit_ns))

    def _fail_takeoff(self, why: str, *, begun: bool = False) -> None:
        """Refuse a takeoff that did not begin: all is as it was before. One that may have begun is called off."""
        self.stage = Stage.TAKEOFF if begun else Stage.ARMED
        for each in [each for each in self._pending if each.request is Request.TAKEOFF]:
            self._give_up(each, why)
        if begun:
            self._command(self._id, Request.ABORT, REQUESTS[Request.ABORT])

    def _give_up(self, each: _Pending, why: str) -> None:
        """Refuse what was not done."""
        self._pending.remove(each)
        if each.request is Request.UNDEF:
            self._expects = self._hovers = True
            self.outbox.append(Notice(f"waypoints are not taken: {why}; it hovers on"))
            return
        self._answer(each.number, each.request, Answer.REFUSED, why)
        if each.request is Request.TAKEOFF and self._hovers and self.stage in _IN_AIR:
            # what is loaded would be flown without its list
            self._command(each.number, Request.LAND, REQUESTS[Request.LAND])
        self._hovers = self._hovers and each.request is not Request.HOVER

    # --- what our nodes say ---------------------------------------------------------------------------------------

    def told(self, t_ns: int, event: Event) -> None:
        """Take the status of our planner, or of the vehicle."""
        if isinstance(event, AutopilotStatus):
            self._vehicle = event
        elif isinstance(event, MissionStatus):
            self._planner_ns = event.t_ns - event.age_ns
            self._adopt(event)
            if self._session and event.session_id == self._session:
                self._status = event
            elif self._status is not None and self.stage in _IN_AIR:  # it was ours before
                event = replace(event, phase=_P.FAILED, message="it was started again, and knows the mission no more")
                self._status = event
            if event.phase is _P.FAILED:
                self.outbox.append(Notice(f"our planner has failed: {event.message}; LAND is taken"))
        self._look(t_ns)

    def step(self, t_ns: int) -> None:
        """Look at the time."""
        self._load(t_ns)
        self._look(t_ns)
        if self.stage in _IN_AIR and not self._is_fresh(t_ns, self._planner_ns):
            self.outbox.append(Notice("our planner is silent in flight; LAND is taken, by the autopilot node"))

    def _adopt(self, status: MissionStatus) -> None:
        """Go on with a mission of a process before this one."""
        found = _MISSION.fullmatch(status.mission_id)
        if found is None or self._session or status.phase not in _FLIES:
            return
        self._id, self._session, self.stage = int(found.group(1)), status.session_id, _STAGES[status.phase]
        self._reset()
        self._reached, self._flown = max(0, status.waypoint - 1), ()
        self._lands = status.phase is _P.LANDING
        asked = {_P.TAKING_OFF: Request.TAKEOFF, _P.LANDING: Request.LAND}.get(status.phase)
        if found.group(2) and not self._lands and status.waypoint <= 1:  # its list may not have come
            self._expects, self._hovers = True, status.phase is _P.HOLDING
            self.stage, asked = (Stage.HOVER, None) if self._hovers else (Stage.TAKEOFF, Request.TAKEOFF)
        if asked is not None:
            self._pending.append(_Pending(asked, self._id))
        self.outbox.append(Notice(f"started again in flight: mission {self._id} is in stage {self.stage.name}"))

    def _is_fresh(self, t_ns: int, made_ns: Optional[int]) -> bool:
        return made_ns is not None and t_ns - made_ns <= self._limits.status_max_age_ns

    def _on_ground(self, t_ns: int) -> bool:
        """Return whether the vehicle says, freshly, that it is on the ground; unknown counts as in the air."""
        vehicle = self._vehicle
        fresh = vehicle is not None and self._is_fresh(t_ns, vehicle.t_ns - vehicle.age_ns)
        return fresh and vehicle is not None and vehicle.landed is VehicleLanded.ON_GROUND

    def _is_down(self, t_ns: int) -> bool:
        return self._on_ground(t_ns) and self._vehicle is not None and self._vehicle.armed is False

    def _phase(self) -> Optional[MissionPhase]:
        return self._status.phase if self._status is not None else None

    def _look(self, t_ns: int) -> None:
        """Answer what is done or too late, and follow the flight."""
        for each in list(self._pending):
            if each in self._pending and each.command is None:
                self._look_at(t_ns, each)
        if self.stage in (*_IN_AIR, Stage.LANDED):
            self._follow(t_ns)
        if self._status is not None and self.stage in (*_IN_AIR[1:], Stage.LANDED):
            self._tell_progress(t_ns, self._status)

    def _look_at(self, t_ns: int, each: _Pending) -> None:
        if _DONE[each.request](self, t_ns):
            self._pending.remove(each)
            if each.request is not Request.UNDEF:
                self._answer(each.number, each.request, REQUESTS[each.request].last)
            _THEN.get(each.request, ServedPlanner._nothing)(self)
        elif each.until_ns is None or t_ns < each.until_ns:
            return
        elif each.request not in _LANDS:
            self._give_up(each, "it has not shown within its limit")
        elif not each.second and self._phase() not in (_P.LANDING, _P.LANDED):
            self._take_second_route(each, "no sign of a landing")

    def _follow(self, t_ns: int) -> None:
        """Know the stage by the phase."""
        phase = self._phase()
        waits = any(each.request is Request.TAKEOFF for each in self._pending)
        stage = self.stage if phase is None else _STAGES.get(phase, self.stage)
        if phase is _P.FLYING and (waits or self._ended):
            stage = Stage.TAKEOFF if waits else Stage.HOVER
        if phase is _P.HOLDING and not self._held and (self._hovers or self._ended):
            stage = Stage.HOVER
        if (phase is _P.FAILED or self._lands) and phase not in _FLIES and self._is_down(t_ns):
            stage = Stage.LANDED
        self.stage = Stage.LAND if self._lands and stage in _IN_AIR else stage
        if self.stage is Stage.LANDED:
            for each in [each for each in self._pending if each.request not in (*_LANDS, Request.DISARM)]:
                self._give_up(each, (self._status.message if self._status else "") or "the flight is over")
        elif self._expects and not self._hovers and self._at_height(t_ns):
            self._hover_for_list()

    def _hover_for_list(self) -> None:
        self._hovers = True
        for each in self._pending:
            if each.request is Request.TAKEOFF:
                each.command, each.limit_ns = self._send(_A.HOLD), self._limits.hold_confirm_limit_ns

    def _tell_progress(self, t_ns: int, status: MissionStatus) -> None:
        """Tell each waypoint that is done with, and the end."""
        many, phase = status.waypoints, status.phase
        lands = phase in (_P.LANDING, _P.LANDED)  # then its status names the last that was reached, else the next
        by_itself = lands and not self._lands and status.waypoint >= many
        done = many if by_itself else max(0, status.waypoint - (not lands))
        left = status.distance_left_m
        if phase is _P.FLYING and status.waypoint == many and left is not None and left <= self._settings.radius_m:
            self._last_ns = t_ns if self._last_ns is None else self._last_ns
        done = many if self._last_ns is not None else done
        for waypoint in self._flown[self._reached : done]:
            self.outbox.append(Publish("waypoint_reached", {"waypoint": _fields(waypoint)}))
        self._reached = max(self._reached, done)
        hold_ns = round(self._flown[-1].hold_s * _S) if self._flown else 0
        held = self._last_ns is not None and t_ns - self._last_ns >= hold_ns
        if not self._ended and not self._lands and many and (held or by_itself):
            self._ended = True
            self._answer(self._id, Request.UNDEF, Answer.COMPLETED)

    # --- when it is done ------------------------------------------------------------------------------------------

    def _at_height(self, t_ns: int) -> bool:  # noqa: ARG002
        status, vehicle = self._status, self._vehicle
        if status is None or status.phase is not _P.FLYING:
            return False
        height_m = None if vehicle is None else vehicle.height_m
        near = height_m is not None and height_m >= self._limits.takeoff_height_m - _NEAR_M
        return near or status.waypoint > 1

    def _taken_off(self, t_ns: int) -> bool:
        return self._hovers and self._holds(t_ns) if self._expects else self._at_height(t_ns)

    def _holds(self, t_ns: int) -> bool:  # noqa: ARG002
        return self._phase() is _P.HOLDING

    def _flies(self, t_ns: int) -> bool:  # noqa: ARG002
        return self._phase() in (_P.TAKING_OFF, _P.FLYING)

    def _has_landed(self, t_ns: int) -> bool:
        flies = self._phase() in _FLIES and self._is_fresh(t_ns, self._planner_ns)
        return self._phase() is _P.LANDED or (self._is_down(t_ns) and not flies)

    def _nothing(self) -> None:
        pass

    def _after_hold(self) -> None:
        self._held = True

    def _after_resume(self) -> None:
        self._held = False

    def _after_landing(self) -> None:
        self.stage = self.stage if self.stage is Stage.IDLE else Stage.LANDED

    def _after_disarming(self) -> None:
        self.stage, self._session, self._status = Stage.IDLE, "", None
        self._list = ()  # what was not flown is not the next mission's


# fmt: off
_DONE: Mapping[Request, Callable[[ServedPlanner, int], bool]] = {
    Request.TAKEOFF: ServedPlanner._taken_off,  # noqa: SLF001 - the tables of this class
    Request.HOLD: ServedPlanner._holds,  # noqa: SLF001
    Request.RESUME: ServedPlanner._flies,  # noqa: SLF001
    Request.HOVER: ServedPlanner._holds,  # noqa: SLF001
    Request.LAND: ServedPlanner._has_landed,  # noqa: SLF001
    Request.ABORT: lambda *_: True,
    Request.DISARM: ServedPlanner._is_down,  # noqa: SLF001
    Request.UNDEF: ServedPlanner._flies,  # noqa: SLF001
}
"""When a request that was accepted is done."""
_THEN: Mapping[Request, Callable[[ServedPlanner], None]] = {
    Request.HOLD: ServedPlanner._after_hold,  # noqa: SLF001
    Request.RESUME: ServedPlanner._after_resume,  # noqa: SLF001
    Request.LAND: ServedPlanner._after_landing,  # noqa: SLF001
    Request.DISARM: ServedPlanner._after_disarming,  # noqa: SLF001
}
"""What is known then."""
# fmt: on


def _is_same(one: Waypoint, other: Waypoint) -> bool:
    near = dist((one.x_m, one.y_m, one.z_m), (other.x_m, other.y_m, other.z_m)) <= _SAME_M
    turned = abs(remainder(one.yaw_rad - other.yaw_rad, 2 * pi)) <= _SAME_RAD
    return near and turned and abs(one.hold_s - other.hold_s) <= _SAME_M


def _fields(waypoint: Waypoint) -> Mapping[str, float]:
    """Return a waypoint as its engine gave it."""
    yaw = degrees(waypoint.yaw_rad)
    return {"x": waypoint.x_m, "y": waypoint.y_m, "z": waypoint.z_m, "yaw": yaw, "holdtime": waypoint.hold_s}
