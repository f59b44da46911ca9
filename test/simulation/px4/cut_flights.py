"""Flights with all that decides, in virtual time: engine, planner, autopilot client, and the simulated PX4 they fly.

The links of both nodes are cut at random moments, each by itself; at another random moment the flight must land: by a
code 16, or because the user asks. What an outsider can see is looked at: what either node sends, when the engine's LAND
leaves after its cause, and the laws at every event.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, List, NamedTuple, Optional

from bad_line import Quality
from soak import MS, S, Soak, _plans

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.planner.loading import LoadRequest
from amaze_autonomy.engine import commands, events
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import Event, Landed, Outcome, RecordingPhase, UserCommand
from amaze_autonomy.engine.rules import Code, Limits, Rules
from amaze_autonomy.engine.state import EngineState, State
from amaze_autonomy.engine.timers import next_deadline
from amaze_autonomy.laws import Judge

_STATUS_NS, _BEAT_NS = 100 * MS, 200 * MS
_FLIGHT_S, _LIMIT_NS = 10.0, 240 * S
_ROUNDING_NS = 2 * 20 * MS  # two steps of the simulated time
_SET_MODE, _ARM = mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_COMPONENT_ARM_DISARM
_MOTION = (_SET_MODE, _ARM, mavlink.MAV_CMD_MISSION_START, mavlink.MAV_CMD_NAV_TAKEOFF)
_OVER = (State.MISSION_ENDED, State.MISSION_INPUT)
_CAUSES = ("code 16", "user", "")


class CutFlight(NamedTuple):
    """What came of one flight.

    Args:
        number: of the flight, from 0.
        cause: why it had to land; empty: nothing but the cuts.
        cuts: how many there were.
        problems: what must never be; empty when nothing was.
        delay_ns: from the cause until LAND left the engine; None: it had no cause in flight, or landed before.
        result: the engine's word for it.
    """

    number: int
    cause: str
    cuts: int
    problems: List[str]
    delay_ns: Optional[int]
    result: str


class CutFlights(Soak):
    """An engine over both nodes; every other peer is well.

    Args:
        seed: of losses, delays, cuts and causes.
    """

    def __init__(self, seed: int = 1) -> None:
        self.seed = seed
        self.rules = Rules(limits=Limits(recording_lead_ns=S // 10))
        self.state, self.judge = EngineState(), Judge(self.rules)
        self._coming: Deque[Event] = deque()
        self._loading = self._load_id = None
        self._code, self._beats, self._phase_of_data = Code.NOMINAL, 0, RecordingPhase.IDLE
        self._told_ns = self._beaten_ns = self._quiet_ns = 0
        self._landing, self._land_ns = False, None
        self.problems: List[str] = []
        super().__init__(Quality(loss=0.02, jitter_ns=20 * MS), seed)
        for radio in self._radios:
            radio.send = self._watched(radio, radio.send)
        self._coming.append(events.EngineStarted(t_ns=self.t_ns))

    def fly_once(self, number: int) -> CutFlight:
        """Fly one mission, cut its links, land it; say what came of it."""
        mission, cause = _plans()[number % 2].mission, self._chance.choice(_CAUSES)
        self.problems, self._landing, self._land_ns, self._code = [], False, None, Code.NOMINAL
        self._until(lambda: self.t_ns >= self._quiet_ns, _LIMIT_NS)
        self.happened.clear()
        if not self._takes_off(mission):
            self.problems.append(f"no takeoff: {self.state.state.value}, {self.state.cause or self.state.shown.text}")
            return self._flown(number, cause, 0, None)
        begin_ns, cuts = self.t_ns, self._cuts()
        caused_ns = self._fail(begin_ns, cause)
        if not self._until(self._ended, _LIMIT_NS):
            self.problems.append(f"stuck in {self.state.state.value}, {self.planner.status(self.t_ns)}")
        if not self._until(lambda: not self.craft.armed, 60 * S):
            self.problems.append(f"still armed, in {self.craft.mode}")
        delay_ns = None if caused_ns is None or self._land_ns is None else self._land_ns - caused_ns
        if caused_ns is not None and delay_ns is None:
            self.problems.append(f"{cause} in flight, and LAND never left")
        elif delay_ns is not None and delay_ns > self.rules.limits.pilot_confirm_ns + _ROUNDING_NS:
            self.problems.append(f"LAND left {delay_ns / S:.3f} s after {cause}")
        return self._flown(number, cause, cuts, delay_ns)

    def _takes_off(self, mission):
        """Select a mission until it takes off, as an operator does whose planner has not heard the last disarming."""
        for _ in range(3):
            self._coming.append(events.MissionSelected(t_ns=self.t_ns, missions=(mission,)))
            if self._until(lambda: self.state.state is State.TAKEOFF, 20 * S):
                return True
        return False

    def _flown(self, number, cause, cuts, delay_ns):
        broken = [f"{each.law.name}: {each.why}" for each in self.judge.judged().broken]
        return CutFlight(number, cause, cuts, self.problems + broken, delay_ns, self.state.session.result.value)

    # --- chance ---------------------------------------------------------------------------------------------------

    def _cuts(self):
        """Cut the links, each by itself, at random moments of the flight; return how often."""
        times = self._chance.randrange(1, 4)
        for _ in range(times):
            begin_ns = self.t_ns + round(self._chance.uniform(0.0, _FLIGHT_S) * S)
            end_ns = begin_ns + round(self._chance.choice((0.3, 1.2, 3.5, 6.0)) * S)
            self._quiet_ns = max(self._quiet_ns, end_ns + 3 * S)  # then the next one may begin
            for radio in self._chance.choice((self._radios, self._radios[:1], self._radios[1:])):
                radio.up.cut(begin_ns, end_ns)
                radio.down.cut(begin_ns, end_ns)
        return times

    def _fail(self, begin_ns, cause):
        """Let a moment pass, then have a cause to land; return when, None where it did not command any more."""
        at_ns = begin_ns + round(self._chance.uniform(0.0, _FLIGHT_S) * S)
        self._until(lambda: self.t_ns >= at_ns or self._ended(), _LIMIT_NS)
        commands_it = self.state.flight.active and self.state.state not in (State.LAND, State.PILOT)
        if not cause or not commands_it or self.state.vehicle.takeover is not None:
            return None  # a user is told to ask again while it is not clear who has control
        if cause == "user":
            self._coming.append(events.UserRequest(t_ns=self.t_ns, command=UserCommand.LAND))
        else:
            self._code = Code.ABORT
        self._beaten_ns = 0  # the watchdog says it at once
        return self.t_ns

    def _ended(self):
        return self.state.state in (*_OVER, State.OUTREACH) and not self.state.flight.active

    # --- what the nodes send --------------------------------------------------------------------------------------

    def _watched(self, radio, send):
        """Look at everything that a node sends: once LAND was commanded, nothing but landing and disarming."""

        def watched(t_ns, messages):
            messages = list(messages)
            for message in messages:
                meant = self._meant(message)
                if self._landing and meant not in ("", "land", "disarm"):
                    self.problems.append(f"{radio.name} sends {meant} at {t_ns / S:.2f} s, after LAND")
            send(t_ns, messages)

        return watched

    def _meant(self, message):
        """Return what a message commands; empty: nothing that moves the vehicle."""
        if message.get_type() != "COMMAND_LONG" or message.command not in _MOTION:
            return ""
        if message.command == _ARM:
            return "arm" if message.param1 == 1.0 else "disarm"
        land = self.planner.watch.numbers("AUTO.LAND")
        lands = message.command == _SET_MODE and (message.param2, message.param3) == land
        return "land" if lands else f"command {message.command}"

    # --- the engine's shell ---------------------------------------------------------------------------------------

    def _step(self, t_ns):
        super()._step(t_ns)
        if not self.craft.armed and not self.state.flight.active:
            self._landing = False
        self._radios[0].send(t_ns, self.planner.other_commands(t_ns, self.autopilot.commanding))
        if self._loading is not None and self._loading.over:
            self._reply(self._load_id, "" if self._loading.accepted else self._loading.reason)
            self._loading = None
        self._tell(t_ns)
        while self._coming:
            self._decide(self._coming.popleft())
        deadline_ns = next_deadline(self.state, self.rules)
        if deadline_ns is not None and t_ns >= deadline_ns:
            self._decide(events.Tick(t_ns=t_ns))

    def _tell(self, t_ns):
        """Have every peer say its status when it is due."""
        if t_ns - self._told_ns >= _STATUS_NS:
            self._told_ns = t_ns
            growing = (events.PlatformRecording(platform="one", growing=True),)
            landed = Landed.AIRBORNE if self.craft.airborne else Landed.ON_GROUND
            self._coming += (
                self.autopilot.vehicle.status(t_ns),
                self.planner.status(t_ns),
                events.LandedStatus(t_ns=t_ns, landed=landed),
                events.RecordingStatus(
                    t_ns=t_ns, session_id=self.state.session.id, phase=self._phase_of_data, platforms=growing
                ),
            )
        if t_ns - self._beaten_ns >= _BEAT_NS:
            self._beaten_ns, self._beats = t_ns, self._beats + 1
            bad = (events.ComponentStatus(name="mission_camera", code=Code.ABORT),) if self._code > 1 else ()
            self._coming.append(
                events.WatchdogAction(
                    t_ns=t_ns, sequence=self._beats, loop_counter=self._beats, code=self._code, components=bad
                )
            )

    def _decide(self, event):
        before = self.state
        self.state, answer = decide(before, event, self.rules)
        self.judge.watch(before, event, answer, self.state)
        for command in answer:
            if isinstance(command, commands.Request):
                self._carry_out(command)
        if self.state.state is State.OUTREACH and before.state is not State.OUTREACH:
            self._coming.append(events.UserRequest(t_ns=self.t_ns, command=UserCommand.GIVE_UP))
        if self.state.state is State.PILOT and before.state is not State.PILOT:
            self.problems.append(f"taken for a pilot's: {self.state.vehicle.takeover_reason}")

    def _carry_out(self, command):
        t_ns, problem = self.t_ns, ""
        if isinstance(command, commands.RunCheck):
            self._coming.append(
                events.CheckReply(
                    t_ns=t_ns, command_id=command.id, check=command.check, outcome=Outcome.ACCEPTED, ok=True
                )
            )
            return
        if isinstance(command, commands.LoadMission):
            wanted = LoadRequest(command.session_id, command.mission_id, command.file_index, command.repetition)
            self._loading, messages = self.planner.load(t_ns, wanted)
            self._load_id = command.id
            self._radios[0].send(t_ns, messages)
            return
        if isinstance(command, commands.MissionCommand):
            self._note(lands=command.action is MissionAction.LAND)
            problem, messages = self.planner.command(t_ns, command.session_id, command.action)
            self._radios[0].send(t_ns, messages)
            if problem and command.action is MissionAction.LAND:
                self.problems.append(f"the planner refuses LAND: {problem}")
        elif isinstance(command, (commands.AutopilotLand, commands.AutopilotDisarm)):
            lands = isinstance(command, commands.AutopilotLand)
            self._note(lands=lands)
            reply, messages = (self.autopilot.land if lands else self.autopilot.disarm)(t_ns)
            self._radios[1].send(t_ns, messages)
            problem = "" if reply.accepted else reply.message
        elif isinstance(command, commands.StartRecording):
            self._phase_of_data = RecordingPhase.RECORDING
        elif isinstance(command, commands.StopRecording):
            self._phase_of_data = RecordingPhase.COMPLETE
        self._reply(command.id, problem)

    def _note(self, *, lands):
        if lands:
            self._landing = True
            self._land_ns = self.t_ns if self._land_ns is None else self._land_ns

    def _reply(self, number, problem):
        outcome = Outcome.REFUSED if problem else Outcome.ACCEPTED
        self._coming.append(events.Reply(t_ns=self.t_ns, command_id=number, outcome=outcome, message=problem))
