"""Stories for the engine in virtual time: a scripted vehicle, planner, recorder and watchdog that answer nominally.

A story reads as it is told: `flight.fail("lrf", 8); flight.after(5.0); flight.expect("LAND")`. Time is virtual. Between
two sentences every status is sent at 5 Hz, commands are answered after 20 ms and carried out after 100 ms, and the
engine is woken at each of its deadlines, unless the story says otherwise. `fork` makes a second, independent story.
"""

from __future__ import annotations

import copy
import heapq
from typing import Any, Callable, Dict, List, Optional, Tuple

from engine_peers import CRUISE_M, MISSION, SHIPPED, Planner, Recorder, S, Vehicle, Watchdog

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine import timers
from amaze_autonomy.engine.commands import (
    Answer,
    AutopilotDisarm,
    AutopilotLand,
    Decision,
    LoadMission,
    MissionCommand,
    Notify,
    Request,
    RunCheck,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.events import Check, CheckName, Mission, Verdict
from amaze_autonomy.engine.rules import Code, Restart, Rules
from amaze_autonomy.engine.state import EngineState

BEAT = S // 5
REPLY_AFTER = S // 50
EFFECT_AFTER = S // 10
ALWAYS: List[Callable[..., None]] = []
"""Observers of every story: conftest puts the laws here, so that each story is also a test of them."""


class Story:
    """One story; see the module. Peers may be changed directly; `answers`, `disobeyed` and `silent` script them."""

    def __init__(self, rules: Rules = SHIPPED, *missions: Mission) -> None:
        self.rules = rules
        self.missions = missions or (MISSION,)
        self.state = EngineState()
        self.now = 0
        self.beat = 0
        self.moved = 0
        self.number = 0
        self.agenda: List[Tuple[int, int, str, Tuple[Any, ...]]] = []
        self.vehicle, self.planner, self.recorder, self.watchdog = Vehicle(), Planner(), Recorder(), Watchdog()
        self.landing_says: Optional[ev.Landed] = None
        self.answers: Dict[str, Optional[ev.Outcome]] = {}
        self.check_says: Dict[str, Dict[str, Any]] = {}
        self.disobeyed: List[str] = []
        self.silent: List[str] = []
        self.sent: List[Tuple[int, Any]] = []
        self.decisions: List[Decision] = []
        self.mark = 0
        self.ticks = 0
        self.ticking = True
        self._dead = False
        self.watch: List[Callable[[Story, EngineState, ev.Event, Tuple[Any, ...]], None]] = []

    def fork(self) -> Story:
        """Return an independent copy of this story as it stands."""
        other = copy.copy(self)
        for name, value in vars(self).items():
            if isinstance(value, (list, dict)):
                setattr(other, name, copy.copy(value))
            elif isinstance(value, (Vehicle, Planner, Recorder, Watchdog)):
                twin = copy.copy(value)
                for key, inner in vars(value).items():
                    if isinstance(inner, dict):
                        setattr(twin, key, dict(inner))
                setattr(other, name, twin)
        return other

    # --- telling ------------------------------------------------------------------------------------------------------

    def feed(self, event_class: Any, **fields: Any) -> Tuple[Any, ...]:
        """Give the engine one event now (or at `t_ns`), carry out what it commands, and return the commands."""
        event = event_class(t_ns=fields.pop("t_ns", self.now), **fields)
        return self._decide(event)

    def _decide(self, event: ev.Event) -> Tuple[Any, ...]:
        if self._dead:
            return ()
        before = self.state
        self.state, commands = engine.decide(before, event, self.rules)
        for observer in (*ALWAYS, *self.watch):
            observer(self, before, event, commands)
        for command in commands:
            if isinstance(command, Decision):
                self.decisions.append(command)
            self.sent.append((self.now, command))
            if isinstance(command, Request):
                self._carry_out(command)
        return commands

    def after(self, seconds: float) -> Story:
        """Let time pass."""
        return self.after_ns(round(seconds * S))

    def after_ns(self, nanoseconds: int) -> Story:
        end = self.now + nanoseconds
        while True:
            t_ns = self._next()
            if t_ns > end:
                break
            self._step(t_ns)
        self.now = end
        return self

    def pass_dead(self, seconds: float) -> Story:
        """Let time pass for everybody but the engine, which is dead, and hears nothing."""
        self._dead, self.ticking = True, False
        self.after(seconds)
        self._dead, self.ticking = False, True
        return self

    def until(self, state: str, step: Optional[str] = None, limit_s: float = 60.0) -> Story:
        """Let time pass until the engine is there."""
        end = self.now + round(limit_s * S)
        while not self.is_in(state, step):
            t_ns = self._next()
            assert t_ns <= end, f"not in {state} {step or ''} in {limit_s} s but in {self.place}: {self.rules_fired}"
            self._step(t_ns)
        return self

    def start(self) -> Story:
        self.feed(ev.EngineStarted, label="test")
        return self

    def select(self, *missions: Mission) -> Story:
        self.feed(ev.MissionSelected, missions=missions or self.missions)
        return self

    def user(self, command: str) -> Tuple[str, str]:
        """Let the user ask for something; return answer and sentence."""
        number = self.number = self.number + 1
        commands = self.feed(ev.UserRequest, command=ev.UserCommand(command), request_id=number)
        answers = [c for c in commands if isinstance(c, Answer)]
        assert [a.request_id for a in answers] == [number]
        return answers[0].answer.name, answers[0].message

    def fail(self, name: str, code: int, restart: str = "none", *, reason: str = "", tell: bool = True) -> Story:
        """Let a component get a code; the watchdog says so at once."""
        why = (reason or f"{name} at code {code}") if code > 1 else ""
        self.watchdog.components[name] = ev.ComponentStatus(name, Code(code), Restart(restart), reason=why)
        self.watchdog.latest = name
        return self.tell() if tell else self

    def back(self, *names: str) -> Story:
        for name in names:
            self.fail(name, 1, tell=False)
        return self.tell()

    def tell(self) -> Story:
        """Let the watchdog say what it knows, now."""
        if "watchdog" not in self.silent:
            self._decide(self.watchdog.action(self.now))
            self._decide(self.watchdog.info(self.now))
        return self

    def say(self, **claims: Any) -> Story:
        """Let the autopilot claim something from now on, and say so at once."""
        self.vehicle.says.update(claims)
        self._decide(self.vehicle.status(self.now))
        return self

    def report(self) -> Story:
        """Let every peer say its status now."""
        self._statuses()
        return self

    def look(self) -> Story:
        """Forget what was sent up to here: `motions`, `told` and `rules_fired` begin anew."""
        self.mark = len(self.sent)
        return self

    # --- what was seen ------------------------------------------------------------------------------------------------

    @property
    def place(self) -> Tuple[str, str]:
        return self.state.state.value, self.state.step.value

    def is_in(self, state: str, step: Optional[str] = None) -> bool:
        return self.place[0] == state and (step is None or self.place[1] == step)

    def expect(self, state: str, step: Optional[str] = None) -> Story:
        assert self.is_in(state, step), f"expected {state} {step or ''}, is {self.place}: {self.rules_fired}"
        return self

    @property
    def since(self) -> List[Any]:
        return [command for _, command in self.sent[self.mark :]]

    @property
    def requests(self) -> List[str]:
        return [name_of(command) for command in self.since if isinstance(command, Request)]

    @property
    def motions(self) -> List[str]:
        """What the vehicle's side was told, in order."""
        return [name for name in self.requests if name in MOTIONS]

    @property
    def told(self) -> List[str]:
        return [command.key for command in self.since if isinstance(command, Notify)]

    @property
    def rules_fired(self) -> List[str]:
        return [command.rule for command in self.since if isinstance(command, Decision)]

    def times_of(self, name: str) -> List[float]:
        """Return when a request was sent since the last look, in seconds."""
        return [
            round(t_ns / S, 6)
            for t_ns, command in self.sent[self.mark :]
            if isinstance(command, Request) and name_of(command) == name
        ]

    def failure(self, name: str) -> Any:
        found = [f for f in self.state.failures if f.name == name]
        return found[0] if found else None

    # --- the peers ----------------------------------------------------------------------------------------------------

    def _next(self) -> int:
        soonest = self.beat
        if self.agenda:
            soonest = min(soonest, self.agenda[0][0])
        deadline = timers.next_deadline(self.state, self.rules) if self.ticking else None
        return soonest if deadline is None else min(soonest, max(deadline, self.now))

    def _step(self, t_ns: int) -> None:
        self.now = t_ns
        passed = t_ns - self.moved
        self.moved = t_ns
        self.vehicle.move(passed / S)
        self.planner.move(passed, self.vehicle)
        if self.agenda and self.agenda[0][0] <= t_ns:
            _, _, name, arguments = heapq.heappop(self.agenda)
            getattr(self, name)(*arguments)
        elif self.beat <= t_ns:
            self.beat += BEAT
            self._statuses()
        else:
            self.ticks += 1
            self.feed(ev.Tick)

    def _statuses(self) -> None:
        if "watchdog" not in self.silent:
            self._decide(self.watchdog.action(self.now))
            self._decide(self.watchdog.info(self.now))
        if "planner" not in self.silent and self.planner.session:  # it says what it does before the vehicle shows it
            self._decide(self.planner.status(self.now))
        if "autopilot" not in self.silent:
            self._decide(self.vehicle.status(self.now))
        if "recorder" not in self.silent and self.recorder.session:
            self._decide(self.recorder.status(self.now))
        if "landing" not in self.silent:
            truth = ev.Landed.ON_GROUND if self.vehicle.height < 0.1 else ev.Landed.AIRBORNE
            self.feed(ev.LandedStatus, landed=self.landing_says or truth)

    def later(self, after_ns: int, name: str, *arguments: Any) -> None:
        self.number += 1
        heapq.heappush(self.agenda, (self.now + after_ns, self.number, name, arguments))

    def _carry_out(self, command: Request) -> None:
        name = name_of(command)
        if isinstance(command, RunCheck):
            if self.answers.get(name, ev.Outcome.ACCEPTED) is not None:
                self.later(REPLY_AFTER, "_check", command)
            return
        outcome = self.answers.get(name, ev.Outcome.ACCEPTED)
        if outcome is not None:
            self.later(REPLY_AFTER, "_reply", command.id, outcome, name)
        if outcome in (ev.Outcome.ACCEPTED, None) and name not in self.disobeyed:
            self.later(EFFECT_AFTER, "_effect", command)

    def _reply(self, identity: int, outcome: ev.Outcome, name: str) -> None:
        message = "" if outcome is ev.Outcome.ACCEPTED else f"{name}: {outcome.value}"
        self.feed(ev.Reply, command_id=identity, outcome=outcome, message=message)

    def _check(self, command: RunCheck) -> None:
        says = self.check_says.get(command.check.value, {})
        outcome = self.answers.get(name_of(command)) or ev.Outcome.ACCEPTED
        failed = [s for s in self.watchdog.components.values() if s.code > Code.NOMINAL and self._needed(s)]
        good = command.check is not CheckName.WATCHDOG or not failed
        row = Check(name=command.check.value, verdict=Verdict.PASS if good else Verdict.FAIL, advice="look at it")
        listed = tuple(self.watchdog.components.values()) if command.check is CheckName.WATCHDOG else ()
        said = {"outcome": outcome, "ok": good, "checks": (row,), "components": listed, **says}
        self.feed(ev.CheckReply, command_id=command.id, check=command.check, **said)

    def _needed(self, status: ev.ComponentStatus) -> bool:
        mission = self.missions[0]
        tolerated = status.code == Code.NON_CRITICAL and status.name in mission.tolerated
        return not tolerated and (not mission.required or status.name in mission.required)

    def _effect(self, command: Request) -> None:
        """Carry a command out, a while after it was sent."""
        getattr(self, f"_on_{name_of(command).lower()}")(command)

    def _on_loadmission(self, command: LoadMission) -> None:
        planner = self.planner
        planner.session, planner.mission = command.session_id, command.mission_id
        planner.file_index, planner.repetition = command.file_index, command.repetition
        planner.phase, planner.waypoint, planner.flown_ns = ev.MissionPhase.LOADED, 0, 0

    def _on_startrecording(self, command: StartRecording) -> None:
        self.recorder.session, self.recorder.phase = command.session_id, ev.RecordingPhase.STARTING
        self.later(S // 2, "_record", ev.RecordingPhase.RECORDING)

    def _on_stoprecording(self, _: StopRecording) -> None:
        last = "FAILED" if self.recorder.fails else "COMPLETE"
        for number, phase in enumerate(("STOPPING", "RECOVERING", "TRANSFERRING", "MERGING", "VERIFYING", last)):
            self.later(number * BEAT, "_record", ev.RecordingPhase[phase])

    def _on_takeoff(self, _: Request) -> None:
        self.planner.phase, self.vehicle.armed = ev.MissionPhase.TAKING_OFF, True
        self.later(S, "_lift_off")

    def _on_hold(self, _: Request) -> None:
        self.planner.phase, self.vehicle.mode, self.vehicle.speed = ev.MissionPhase.HOLDING, "AUTO.LOITER", 0.0

    def _on_resume(self, _: Request) -> None:
        if self.vehicle.height < CRUISE_M:
            self.planner.phase, self.vehicle.mode, self.vehicle.speed = ev.MissionPhase.TAKING_OFF, "AUTO.TAKEOFF", 1.0
        else:
            self.planner.phase, self.vehicle.mode = ev.MissionPhase.FLYING, "AUTO.MISSION"

    def _on_land(self, _: Request) -> None:
        self.planner.phase = ev.MissionPhase.LANDING
        self.vehicle.land()

    def _on_abort(self, _: Request) -> None:
        self.planner.phase = ev.MissionPhase.IDLE if self.vehicle.height <= 0 else ev.MissionPhase.LANDING
        self.vehicle.land()

    def _on_autopilotland(self, _: AutopilotLand) -> None:
        self.vehicle.land()

    def _on_autopilotdisarm(self, _: AutopilotDisarm) -> None:
        self.vehicle.armed = False

    def _lift_off(self) -> None:
        if self.vehicle.armed and self.planner.phase is ev.MissionPhase.TAKING_OFF and "lift_off" not in self.disobeyed:
            self.vehicle.take_off()

    def _record(self, phase: ev.RecordingPhase) -> None:
        self.recorder.phase = phase


MOTIONS = ("TAKEOFF", "HOLD", "RESUME", "LAND", "ABORT", "AutopilotLand", "AutopilotDisarm")


def name_of(command: Request) -> str:
    """Return how stories call a request: TAKEOFF ... ABORT, check:battery, or its class."""
    if isinstance(command, MissionCommand):
        return command.action.name
    if isinstance(command, RunCheck):
        return f"check:{command.check.value}"
    if isinstance(command, (LoadMission, StartRecording, StopRecording, AutopilotLand, AutopilotDisarm)):
        return type(command).__name__
    raise AssertionError(command)
