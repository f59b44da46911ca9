"""The mission sequencer of the CNS Flight Stack as our mission planner. Pure.

Our commands become its requests, its pairs (response, completed) become our phases; `_TAKEN` is the table. Its traps:

* ARM is never refused, a refusing autopilot is asked for ever: our limit ends it with DISARM.
* ABORT does nothing in flight: it is never sent; DISARM before its takeoff, LAND after it.
* Waypoints out of its bounds are skipped without a word: they are checked before they are sent, and counted on the way.
* After the last waypoint it hovers: LAND is sent, once more where it does not begin, and on the ground DISARM.
* A list of waypoints is not answered: where nothing new is said for the duration of the mission, that is FAILED.
* HOLD would interrupt its landing: it is not sent once a landing was asked for.
* Taken over by a pilot, or failed, it stays in its mission, also on the ground: the next load ends that first.
* A request with another id than the mission's is answered to nobody: the id is that of the loaded mission.
* It says nothing when it has died: in flight that is FAILED at once, so that the autopilot lands.
"""

from __future__ import annotations

from math import cos, degrees, dist, inf, radians, remainder, sin
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import LoadMission, MissionAction, MissionCommand
from amaze_autonomy.engine.commands import Request as Command
from amaze_autonomy.engine.events import Event, MissionPhase, MissionStatus
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import Frame, MissionPlan, Trajectory

from .peers import GONE_NS, Peer, Publish, Rhythm, replied
from .tables import Answer, Reference, Request, WaypointAction

_S = 1_000_000_000
_REPLY_EARLY = 0.8
_SAME_M = 0.05
_HEADING_AGE_NS = _S
_LEAST_FLIGHT_NS = 60 * _S
_SLOWER = 2  # so many times as long as was estimated a leg, or a landing, may take
_COMES_NS = 3 * _S  # without a publisher of answers, after this process has begun
_NOT_HEARD = ((0.0, 0.0, 0.0), 0.0, 0.0)  # all waypoints of a recording, as one
_SAYS_NS = _S  # after an answer of its sequencer what that has changed is in a status of the vehicle
_LAST_ID = 255
_P = MissionPhase
_IN_FLIGHT = (_P.TAKING_OFF, _P.FLYING, _P.HOLDING, _P.LANDING)
Point = Tuple[float, float, float]


class Bounds(NamedTuple):
    """What its sequencer takes: waypoints between two corners, ahead, left and up of its start; else it skips them."""

    least: Point = (-inf, -inf, -inf)
    most: Point = (inf, inf, inf)


ANYWHERE = Bounds()


class Sequencer(Peer):
    """One mission at a time.

    Args:
        plans: every mission.
        limits: of the engine.
        rate_hz: of our status.
        bounds: of its sequencer, as its parameters say.
    """

    def __init__(
        self,
        plans: Sequence[MissionPlan],
        limits: Limits,
        rate_hz: float,
        bounds: Bounds = ANYWHERE,
    ) -> None:
        super().__init__()
        self._plans = {plan.mission.id: plan for plan in plans}
        self._limits, self._bounds = limits, bounds
        self._phase, self._message = _P.IDLE, ""
        self._loaded: Optional[LoadMission] = None
        self._id = 0
        self._points: Tuple[Tuple[Point, float, float], ...] = ()
        self._reached = 0
        self._skipped: List[int] = []  # numbers of waypoints
        self._flown_out = False  # it has said that its mission is over
        self._before_hold = _P.FLYING
        self._sent_in_hold = False  # waypoints, while a hold was under way
        self._arming_ns: Optional[int] = None
        self._asked: Optional[Request] = None  # ARM, then TAKEOFF: which of them its sequencer was asked for last
        self._landing = False
        self._ending = False  # its last mission, for a load
        self._waiting: List[Tuple[Request, Command, int]] = []
        self._ended: List[Event] = []
        self._rhythm = Rhythm(rate_hz)
        self._heading: Optional[Tuple[int, float]] = None
        self._vehicle: Tuple[int, Optional[bool]] = (0, None)  # when its status came, whether it is armed
        self._restored = False
        self._quiet_ns, self._counted_ns = 0, 0  # of a flight, in which nothing new was said; counted up to then
        self._heard_ns = 0
        self._land_until_ns: Optional[int] = None  # the LAND after the last waypoint must have begun
        self._land_repeated = self._land_refused_once = False
        self._gone_ns: Optional[int] = None  # when it counts as gone unless it is there again
        self.alive = True

    def kept(self) -> Dict[str, Any]:
        """Return the mission that is loaded, what was asked, and how far it has come."""
        if self._loaded is None:
            return {}
        loaded, asked = self._loaded, self._asked
        return {
            "loaded": [loaded.session_id, loaded.mission_id, loaded.file_index, loaded.repetition],
            "points": self._points,
            "phase": [self._phase.name, self._before_hold.name, self._message],
            "reached": self._reached,
            "skipped": self._skipped,
            "asked": None if asked is None else asked.name,
            "arming_ns": self._arming_ns,
            "landing": self._landing,
        }

    def restore(self, t_ns: int, kept: Mapping[str, Any]) -> None:
        """Go on with the mission; what its sequencer has answered meanwhile is not known any more."""
        session_id, mission_id, file_index, repetition = kept["loaded"]
        if mission_id not in self._plans:
            raise ValueError(f"there is no mission {mission_id!r} any more")
        points = tuple(((float(x), float(y), float(z)), yaw, hold_s) for (x, y, z), yaw, hold_s in kept["points"])
        asked, arming_ns = kept["asked"], kept["arming_ns"]
        self._counted_ns = t_ns
        name, before_hold, message = kept["phase"]
        loaded = LoadMission(
            id=0,
            limit_ns=1,
            session_id=session_id,
            mission_id=mission_id,
            file_index=file_index,
            repetition=repetition,
        )
        self._phase, self._before_hold, self._message = MissionPhase[name], MissionPhase[before_hold], str(message)
        self._loaded, self._id, self._points, self._reached = loaded, int(mission_id), points, int(kept["reached"])
        self._asked = None if asked is None else Request[asked]
        self._arming_ns = None if arming_ns is None else int(arming_ns)
        self._landing, self._gone_ns = bool(kept["landing"]), t_ns + _COMES_NS
        self._skipped = [int(number) for number in kept.get("skipped", ())]
        self._restored = True
        if self._landing and self._phase in (_P.FLYING, _P.HOLDING):  # whether it has begun was not heard
            self._land_until_ns = t_ns + _COMES_NS
        if self._phase is _P.TAKING_OFF and self._asked is Request.TAKEOFF:
            self._fail("started again during the takeoff, whose end its sequencer says once")

    def adopt(self, session_id: str, mission_id: int, phase: MissionPhase) -> None:
        """Begin with a mission that another engine flies, of which only the answers are heard: in a recording."""
        self._loaded = LoadMission(
            id=0, limit_ns=1, session_id=session_id, mission_id=str(mission_id), file_index=0, repetition=0
        )
        self._id, self._phase, self._message = mission_id, phase, ""
        self._points, self._reached = (_NOT_HEARD,), 0

    def turn(self, t_ns: int, heading_rad: float) -> None:
        """Take the vehicle's heading, counter-clockwise from east."""
        self._heading = (t_ns, heading_rad)

    def see_vehicle(self, t_ns: int, *, armed: Optional[bool]) -> None:
        """Take whether the vehicle is armed, as our autopilot node says; None: it does not know."""
        self._vehicle = (t_ns, armed)

    # --- commands -------------------------------------------------------------------------------------------------

    def answer(self, t_ns: int, command: Command) -> Optional[Event]:
        """Load a file, or ask for what a command means; its answer is the reply."""
        if isinstance(command, LoadMission):
            problem = self._load(t_ns, command)
            return replied(command, t_ns, problem)
        assert isinstance(command, MissionCommand)  # noqa: S101 - the rows of the services say so
        problem = self._refusal(command)
        if not problem and command.action is MissionAction.TAKEOFF and self._loaded is not None:
            problem = self._aim(t_ns, self._loaded)  # it may have been turned since it was loaded
        if problem:
            return replied(command, t_ns, problem)
        request = self._meant(t_ns, command.action)
        if request is None:
            return replied(command, t_ns)
        self._ask(request)
        self._waiting.append((request, command, t_ns + self._reply_ns()))
        return None

    def _refusal(self, command: MissionCommand) -> str:
        if command.action in (MissionAction.LAND, MissionAction.ABORT):
            return ""
        if not self.alive:
            return "its sequencer is not there"
        if self._loaded is None or command.session_id != self._loaded.session_id:
            return f"session {command.session_id!r} is not the one that is loaded"
        if self._landing and command.action is not MissionAction.TAKEOFF:
            return f"it lands: there is nothing to {command.action.name}"
        good = (_P.LOADED,) if command.action is MissionAction.TAKEOFF else (_P.TAKING_OFF, _P.FLYING, _P.HOLDING)
        return "" if self._phase in good else f"there is nothing to {command.action.name} in phase {self._phase.name}"

    def _meant(self, t_ns: int, action: MissionAction) -> Optional[Request]:
        """Return what a command is for its sequencer; None: nothing is to be asked."""
        if action in (MissionAction.LAND, MissionAction.ABORT):
            self._landing, self._ending = True, False
            return self._down()
        if action is MissionAction.TAKEOFF:
            self._phase, self._message, self._arming_ns = _P.TAKING_OFF, "", t_ns
            self._asked = Request.ARM
            return Request.ARM
        asked = [request for request, _, _ in self._waiting if request in (Request.HOLD, Request.RESUME)]
        if action is MissionAction.HOLD:
            return Request.HOLD if asked or self._phase is not _P.HOLDING else None
        return Request.RESUME if asked or self._phase is _P.HOLDING else None

    def _down(self) -> Optional[Request]:
        """Return what ends a flight: DISARM while it is known that it was asked to arm and no more; else LAND."""
        if self._loaded is not None and self._phase is _P.LOADED:
            return None  # it was asked nothing
        return Request.DISARM if self._asked is Request.ARM else Request.LAND

    def _ask(self, request: Request) -> None:
        self.outbox.append(Publish("request", {"id": self._id, "request": int(request)}))

    # --- loading --------------------------------------------------------------------------------------------------

    def _load(self, t_ns: int, command: LoadMission) -> str:
        plan = self._plans.get(command.mission_id)
        if plan is None:
            return f"there is no mission {command.mission_id!r}"
        if not command.mission_id.isdigit() or not 1 <= int(command.mission_id) <= _LAST_ID:
            return f"its sequencer knows missions 1 to {_LAST_ID} alone, and none {command.mission_id!r}"
        if not self.alive:
            return "its sequencer is not there"
        problem = self._under_way(t_ns)
        if problem:
            return problem
        if self._may_be_in_its_last():
            return self._end_last(command)
        problem = self._aim(t_ns, command)
        if problem:
            return problem
        if self._phase in _IN_FLIGHT:  # no more than DISARM was missed: the vehicle is disarmed
            self._ask(Request.DISARM)
        self._restored, self._land_until_ns, self._quiet_ns = False, None, 0
        self._loaded, self._id = command, int(command.mission_id)
        self._phase, self._message, self._reached = _P.LOADED, "", 0
        self._asked = self._arming_ns = None
        self._landing = self._sent_in_hold = self._ending = self._flown_out = False
        self._skipped = []
        return ""

    def _under_way(self, t_ns: int) -> str:
        """Return why a load, of whichever session, must not touch the mission; empty: the vehicle is disarmed."""
        if self._phase not in _IN_FLIGHT and not self._may_be_in_its_last():
            return ""
        said_ns, armed = self._vehicle
        words = f"its sequencer is in a mission (phase {self._phase.name})"
        if armed is None or t_ns - said_ns > self._limits.status_max_age_ns:
            return f"{words}, and it is not known whether the vehicle is armed"
        if armed or self._arming_ns is not None or said_ns - self._heard_ns < _SAYS_NS:
            return f"{words}, and the vehicle is armed, or was just asked for something"
        return ""

    def _may_be_in_its_last(self) -> bool:
        """Return whether its sequencer may still be in a mission that LAND has to end."""
        if self._phase is _P.FAILED:
            return self._asked is Request.TAKEOFF
        return self._phase in ((_P.FLYING, _P.HOLDING) if self._restored else _IN_FLIGHT)

    def _end_last(self, command: LoadMission) -> str:
        """End a mission that is over, since the vehicle is disarmed; return why it waits."""
        known = self._phase is not _P.FAILED and not self._restored
        if known and self._loaded is not None and self._loaded.session_id == command.session_id:
            return f"its sequencer flies (phase {self._phase.name})"
        self._landing = self._ending = True
        request = self._down()
        if request is not None:
            self._ask(request)
        return "its sequencer is still in its last mission, which is being ended: try again"

    def _aim(self, t_ns: int, command: LoadMission) -> str:
        """Place the waypoints by the heading of now; return why they cannot be flown, or nothing."""
        files = self._plans[command.mission_id].trajectories
        if not 0 <= command.file_index < len(files):  # also of what was loaded before the configuration changed
            return f"mission {command.mission_id} has {len(files)} waypoint files"
        points, problem = self._points_of(t_ns, files[command.file_index], command)
        problem = problem or self._out_of_bounds(points)
        if not problem:
            self._points = points
        return problem

    def _points_of(
        self, t_ns: int, trajectory: Trajectory, command: LoadMission
    ) -> Tuple[Tuple[Tuple[Point, float, float], ...], str]:
        """Return waypoints ahead, left and up of its start with yaw in degrees and hold; or why they cannot be."""
        heading = 0.0
        if trajectory.frame is Frame.EAST_NORTH:
            if command.file_index or command.repetition:
                return (), "its sequencer counts from each takeoff: only the first file may be east_north"
            if self._heading is None or t_ns - self._heading[0] > _HEADING_AGE_NS:
                return (), "there is no fresh heading, and its sequencer counts from it: use the frame start_heading"
            heading = self._heading[1]
        cosine, sine = cos(heading), sin(heading)
        points = []
        for each in trajectory.waypoints:
            place = (cosine * each.x_m + sine * each.y_m, cosine * each.y_m - sine * each.x_m, each.z_m)
            yaw = degrees(remainder(each.yaw_rad - heading, 2 * radians(180.0)))
            points.append((place, yaw, each.hold_s))
        return tuple(points), ""

    def _out_of_bounds(self, points: Sequence[Tuple[Point, float, float]]) -> str:
        for number, (place, _, _) in enumerate(points, start=1):
            for axis, value, least, most in zip("xyz", place, *self._bounds):
                if not least <= value <= most:
                    return (
                        f"waypoint {number}: {axis} is {value:.2f} m from its start; its sequencer would skip what is "
                        f"not within {least:g} to {most:g}"
                    )
        return ""

    # --- what it says ---------------------------------------------------------------------------------------------

    def hear(self, t_ns: int, key: str, message: Any) -> None:
        """Take an answer, or a waypoint that was reached."""
        self._heard_ns = t_ns
        if key == "waypoint_reached":
            self._reach(message.waypoint)
            return
        if message.request.id != self._id or self._loaded is None:
            return
        answer = Answer((bool(message.response), bool(message.completed)))
        if message.request.request not in list(Request):
            return
        request = Request(message.request.request)
        landing = request is Request.LAND and self._phase is _P.LANDING  # asked again: it lands already
        why = f"its sequencer refuses {request.name}" if answer is Answer.REFUSED and not landing else ""
        self._ended += [replied(command, t_ns, why) for asked, command, _ in self._waiting if asked is request]
        self._waiting = [each for each in self._waiting if each[0] is not request]
        take = _TAKEN.get((request, answer))
        if take is not None:
            take(self)

    def _reach(self, waypoint: Any) -> None:
        place = (waypoint.x, waypoint.y, waypoint.z)
        ahead = enumerate(self._points[self._reached :], start=self._reached)
        found = next((number for number, point in ahead if dist(point[0], place) <= _SAME_M), None)
        if found is None or self._phase not in _IN_FLIGHT:
            return
        self._restored, self._quiet_ns = False, 0  # what comes after this is heard
        # A last one may be heard on its own topic after the end of the mission: it was not skipped.
        self._skip([number for number in self._skipped if number <= self._reached], self._reached, found)
        self._reached = found + 1

    def _skip(self, before: List[int], begin: int, end: int) -> None:
        """Say which waypoints were skipped: those of before, and those between two."""
        skipped = [*before, *range(begin + 1, end + 1)]
        if skipped != self._skipped:
            many = "waypoints" if len(skipped) > 1 else "waypoint"
            numbers = ", ".join(map(str, skipped))
            self._skipped, self._message = skipped, f"its sequencer has skipped {many} {numbers}" if skipped else ""

    def _armed(self) -> None:
        self._arming_ns = None
        if self._landing:
            self._ask(Request.DISARM)
            return
        self._asked, self._quiet_ns = Request.TAKEOFF, 0
        self._ask(Request.TAKEOFF)

    def _not_armed(self) -> None:
        self._arming_ns = None
        self._fail("its sequencer does not arm")

    def _at_height(self) -> None:
        if self._landing:
            return
        self._phase, self._quiet_ns = _P.FLYING, 0
        self._sent_in_hold = any(request is Request.HOLD for request, _, _ in self._waiting)
        self._send_waypoints()

    def _send_waypoints(self) -> None:
        waypoints = [
            {"x": place[0], "y": place[1], "z": place[2], "yaw": yaw, "holdtime": hold_s}
            for place, yaw, hold_s in self._points
        ]
        fields = {"waypoints": waypoints, "action": int(WaypointAction.CLEAR), "reference": int(Reference.LOCAL)}
        self.outbox.append(Publish("waypoint_list", fields))

    def _no_takeoff(self) -> None:
        self._asked = Request.ARM
        self._ask(Request.DISARM)
        self._fail("its sequencer refuses the takeoff")

    def _flown(self) -> None:
        """Land after the last waypoint: it would hover."""
        if self._phase is _P.FLYING:
            self._landing = self._flown_out = True
            self._ask(Request.LAND)
            if self._plan() is not None:  # in a recording others ask
                self._land_until_ns = self._heard_ns + self._reply_ns()
                self._land_repeated = self._land_refused_once = False
            else:
                self._reached = len(self._points)

    def _held(self) -> None:
        if self._phase in (_P.TAKING_OFF, _P.FLYING):
            self._before_hold, self._phase = self._phase, _P.HOLDING

    def _resumed(self) -> None:
        if self._phase is not _P.HOLDING:
            return
        self._phase = self._before_hold
        if self._sent_in_hold and self._phase is _P.FLYING and not self._reached:  # it may not have taken them there
            self._send_waypoints()
        self._sent_in_hold = False

    def _lands(self) -> None:
        self._enter(_P.LANDING)
        if self._flown_out and self._phase is _P.LANDING:  # not before: the last one may be heard after the end
            self._skip(self._skipped, self._reached, len(self._points))
            self._flown_out = False
        self._restored, self._land_until_ns, self._quiet_ns = False, None, 0

    def _land_refused(self) -> None:
        if self._ending and self._phase is not _P.LANDING:  # it has landed already, or was started again
            self._ask(Request.DISARM)
        elif self._land_until_ns is None:
            return
        elif self._land_repeated and not self._land_refused_once:  # it may be landing: the first was not answered
            self._lands()
        else:
            self._land_until_ns, self._land_refused_once = self._heard_ns, True

    def _down_there(self) -> None:
        self._lands()
        self._ask(Request.DISARM)

    def _disarmed(self) -> None:
        self._arming_ns = None
        self._enter(_P.LANDED)
        self._ending = False
        if self._asked is Request.TAKEOFF:  # of which nothing is left to be ended
            self._asked = None

    def _disarm_refused(self) -> None:
        if self._ending or self._phase in (_P.LANDING, _P.FAILED):  # the autopilot was faster, or it was idle
            self._disarmed()

    def _enter(self, phase: MissionPhase) -> None:
        """Go on to a phase of a landing; what has failed stays so until it is ended for another mission."""
        if self._phase in _IN_FLIGHT:
            self._phase = phase
        elif self._ending:
            self._phase, self._message = phase, ""

    def _fail(self, message: str) -> None:
        self._phase, self._message, self._land_until_ns = _P.FAILED, message, None

    def _plan(self) -> Optional[MissionPlan]:
        """Return the mission that is loaded; None: none, or that of a recording."""
        return None if self._loaded is None else self._plans.get(self._loaded.mission_id)

    def _reply_ns(self) -> int:
        return round(self._limits.command_reply_limit_ns * _REPLY_EARLY)

    # --- time -----------------------------------------------------------------------------------------------------

    def step(self, t_ns: int) -> List[Event]:
        """Return replies and the status; on the ground none of a sequencer that is not there."""
        self._miss(t_ns)
        for request, command, until_ns in self._waiting:
            if t_ns >= until_ns:
                self._ended.append(replied(command, t_ns, f"its sequencer does not answer {request.name}"))
        self._waiting = [each for each in self._waiting if t_ns < each[2]]
        if self._arming_ns is not None and t_ns - self._arming_ns >= self._limits.arm_limit_ns:
            self._not_armed()
            self._ask(Request.DISARM)
        ended, self._ended = self._ended, []
        key = (self._phase, self._message, self._reached, self._loaded)
        if (self.alive or self._phase is _P.FAILED) and self._rhythm.due(t_ns, key):
            ended.append(self._status(t_ns))
        return ended

    def _miss(self, t_ns: int) -> None:
        """Notice in flight that nobody says what comes next: nobody is there, or it was said while we were not."""
        self._repeat_landing(t_ns)
        limit_ns = self._quiet_limit_ns()
        if limit_ns is not None:
            self._quiet_ns += t_ns - self._counted_ns
            if self._quiet_ns >= limit_ns:
                again = "since this node was started again" if self._restored else f"new for {limit_ns / _S:.0f} s"
                self._fail(f"its sequencer has said nothing {again}")
        self._counted_ns = t_ns
        if self.alive:
            self._gone_ns = None
        elif self._gone_ns is None:
            self._gone_ns = t_ns + GONE_NS
        elif t_ns >= self._gone_ns and self._phase in _IN_FLIGHT:
            self._fail("its sequencer is gone")

    def _repeat_landing(self, t_ns: int) -> None:
        """Ask once more for the landing after the last waypoint; then somebody else has to land."""
        if self._land_until_ns is None or t_ns < self._land_until_ns:
            return
        if self._land_repeated:
            self._fail("its sequencer does not land")
            return
        self._land_until_ns, self._land_repeated = t_ns + self._reply_ns(), True
        self._ask(Request.LAND)

    def _quiet_limit_ns(self) -> Optional[int]:
        """Return how long it may say nothing new; None: for as long as it likes, as in a hold: that has an end."""
        plan = self._plan()
        if plan is None:
            return None
        if self._phase is _P.LANDING:
            return _SLOWER * self._limits.land_limit_ns
        if self._phase is _P.FLYING or (self._phase is _P.TAKING_OFF and self._asked is Request.TAKEOFF):
            return max(_LEAST_FLIGHT_NS, _SLOWER * round((plan.mission.estimated_duration_s or 0.0) * _S))
        return None

    def _status(self, t_ns: int) -> MissionStatus:
        loaded, many = self._loaded, len(self._points)
        flying = self._phase in (_P.FLYING, _P.HOLDING)
        return MissionStatus(
            t_ns=t_ns,
            session_id=loaded.session_id if loaded else "",
            mission_id=loaded.mission_id if loaded else "",
            phase=self._phase,
            waypoint=min(self._reached + 1, many) if flying else self._reached,
            waypoints=many,
            file_index=loaded.file_index if loaded else 0,
            repetition=loaded.repetition if loaded else 0,
            message=self._message,
        )


_TAKEN: Mapping[Tuple[Request, Answer], Callable[[Sequencer], None]] = {
    (Request.ARM, Answer.COMPLETED): Sequencer._armed,  # noqa: SLF001 - the table of this class
    (Request.ARM, Answer.REFUSED): Sequencer._not_armed,  # noqa: SLF001
    (Request.TAKEOFF, Answer.COMPLETED): Sequencer._at_height,  # noqa: SLF001
    (Request.TAKEOFF, Answer.REFUSED): Sequencer._no_takeoff,  # noqa: SLF001
    (Request.UNDEF, Answer.COMPLETED): Sequencer._flown,  # noqa: SLF001
    (Request.HOLD, Answer.DONE): Sequencer._held,  # noqa: SLF001
    (Request.RESUME, Answer.DONE): Sequencer._resumed,  # noqa: SLF001
    (Request.LAND, Answer.ACCEPTED): Sequencer._lands,  # noqa: SLF001
    (Request.LAND, Answer.COMPLETED): Sequencer._down_there,  # noqa: SLF001
    (Request.LAND, Answer.REFUSED): Sequencer._land_refused,  # noqa: SLF001
    (Request.DISARM, Answer.COMPLETED): Sequencer._disarmed,  # noqa: SLF001
    (Request.DISARM, Answer.REFUSED): Sequencer._disarm_refused,  # noqa: SLF001
}
"""What each of its answers does; any other changes nothing."""
