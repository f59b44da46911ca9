"""The closed loop in virtual time: the world and the engine, event by event, as fast as they compute."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.commands import Command, Decision, Level, Notify, Request, Value
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, Event, MissionSelected, Tick
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import DataResult, EngineState, Result, State
from amaze_autonomy.engine.timers import next_deadline
from amaze_autonomy.monitoring.land_switch import LandRequests

from ..engine.events import Mission
from ..journal import journal
from ..journal.report import mission_end
from .scenario import Scenario
from .world import Happened, World

_S = 1_000_000_000
_WAITING = (State.MISSION_INPUT, State.OUTREACH, State.PILOT, State.MISSION_ENDED)
_SELECT_NS = 5 * _S


@dataclass(frozen=True)
class Run:
    """What came of a simulated run.

    Args:
        lines: of the journal, header first.
        commands: (time, command) of everything that the engine asked for, decisions left out.
        decisions: in order.
        history: of what happened in the world: faults that began and ended, what the user asked.
        results: (mission, result, what became of its data) of every mission that has ended.
        state: the engine's last state.
        finished: it ended by itself; false: the limit of simulated time was reached.
    """

    lines: Tuple[str, ...]
    commands: Tuple[Tuple[int, Command], ...]
    decisions: Tuple[Decision, ...]
    history: Tuple[Happened, ...]
    results: Tuple[Tuple[str, Result, DataResult], ...]
    state: EngineState
    finished: bool


def run(
    configuration: Configuration,
    missions: Tuple[Mission, ...],
    scenario: Optional[Scenario] = None,
    *,
    seed: int = 0,
    limit_ns: int = 7200 * _S,
    rules: Optional[Rules] = None,
    watch: Optional[Callable[[Rules], Rules]] = None,
) -> Run:
    """Fly missions in a simulated world until the engine has nothing more to do.

    It ends when all missions have ended, or when the engine waits for a person who, by the scenario, will not come.

    Args:
        configuration: of the engine and of the world.
        missions: as selected by the user, five seconds after the start.
        scenario: what goes wrong, and what the user does.
        seed: of the world.
        limit_ns: of simulated time.
        rules: to decide by in the place of the configuration's; the world stays as it is.
        watch: makes of the rules those that note which of them are asked for; None: as they are.
    """
    return _Loop(configuration, scenario or Scenario(), seed, rules, watch).run(missions, limit_ns)


class _Loop:
    """One run."""

    def __init__(
        self,
        configuration: Configuration,
        scenario: Scenario,
        seed: int,
        rules: Optional[Rules],
        watch: Optional[Callable[[Rules], Rules]],
    ) -> None:
        self._rules = configuration.rules if rules is None else rules
        self._world = World(configuration, seed, scenario)
        self._state = EngineState()
        self._switch = LandRequests(configuration.without_land_switch)
        header = journal.make_header(
            self._rules,
            configuration.effective,
            configuration.hash,
            writer="simulate",
            seed=seed,
            scenario=scenario.description,
        )
        self._lines: List[str] = [journal.encode_header(header)]
        self._rules = self._rules if watch is None else watch(self._rules)
        self._commands: List[Tuple[int, Command]] = []
        self._decisions: List[Decision] = []
        self._results: List[Tuple[str, Result, DataResult]] = []

    def run(self, missions: Tuple[Mission, ...], limit_ns: int) -> Run:
        self._take(EngineStarted(t_ns=0, label="simulation"))
        selected = False
        finished = False
        while not finished and self._world.now_ns <= limit_ns:
            waits = selected or self._world.engine_down
            t_ns = self._next_ns() if waits else min(self._next_ns(), max(_SELECT_NS, self._world.now_ns))
            for event in self._world.advance(t_ns):
                self._take(event)
            if not selected and t_ns >= _SELECT_NS and not self._world.engine_down:
                selected = True
                self._take(MissionSelected(t_ns=t_ns, missions=missions))
            self._look_at_switch(t_ns)
            deadline_ns = None if self._world.engine_down else next_deadline(self._state, self._rules)
            if deadline_ns is not None and deadline_ns <= t_ns:
                self._take(Tick(t_ns=t_ns))
            finished = selected and self._over()
        return Run(
            lines=tuple(self._lines),
            commands=tuple(self._commands),
            decisions=tuple(self._decisions),
            history=self._world.history,
            results=tuple(self._results),
            state=self._state,
            finished=finished,
        )

    def _next_ns(self) -> int:
        deadline_ns = None if self._world.engine_down else next_deadline(self._state, self._rules)
        return self._world.next_ns if deadline_ns is None else min(self._world.next_ns, deadline_ns)

    def _look_at_switch(self, t_ns: int) -> None:
        """Ask for a landing where the switch of the transmitter says so, as the node does while it lives."""
        if self._world.engine_down:
            return
        request = self._switch.answer(self._state, t_ns, on=bool(self._world.land_switch))
        if request is not None:
            self._take(request)

    def _take(self, event: Event) -> None:
        """Let the engine decide about an event, write it down, and carry out what it asks for."""
        if isinstance(event, EngineStarted) and not event.resumed:
            self._state = EngineState()  # a process that found no journal
        before = self._state
        self._lines.append(journal.encode_event(event))
        self._state, commands = decide(self._state, event, self._rules)
        for command in commands:
            if isinstance(command, Decision):
                self._lines.append(journal.encode_decision(command))
                self._decisions.append(command)
            else:
                self._commands.append((event.t_ns, command))
                self._world.handle(max(event.t_ns, self._world.now_ns), command)
        self._note_result(before, event)
        if self._state.state is not before.state:
            self._world.observe_state(self._world.now_ns, self._state.state.value)

    def _note_result(self, before: EngineState, event: Event) -> None:
        """Note the result of a mission that has just ended; the next one may have begun with the same event."""
        ended = mission_end(before, event, self._state, self._rules)
        session = None if ended is None else ended.session
        if session is not None and session.mission is not None:
            self._results.append((session.mission.id, session.result, session.data_result))

    def _over(self) -> bool:
        """Tell whether nothing more will happen without a person."""
        waits = self._state.state in _WAITING and not self._state.queue
        world = self._world
        return waits and not world.vehicle.armed and not world.requests_to_come and not world.engine_down


# --- story ------------------------------------------------------------------------------------------------------------
# What is told of a simulated run: as a story for a person, as a summary for a program.


_NS = 1e9


def story(scenario: Scenario, result: Run) -> str:
    """Return the story of a run: decisions, messages to the user, and what the scenario did, in order of time."""
    told: List[Tuple[int, int, str]] = [(t_ns, 0, f"* {text}") for t_ns, text, _ in result.history]
    told += [(decision.t_ns, 1, text) for decision, text in _joined(result.decisions)]
    told += _messages(result.commands)
    lines = [f"scenario: {scenario.description}", ""]
    lines += [f"{t_ns / _NS:10.3f}  {text}" for t_ns, _, text in sorted(told, key=lambda line: line[:2])]
    lines += ["", *(_ended(*each) for each in result.results)]
    if not result.finished:
        lines.append(f"{result.state.state.value}: not finished within the limit of simulated time")
    elif result.state.state is not State.MISSION_ENDED:
        lines.append(f"{result.state.state.value}: waits for a person")
    return "\n".join(lines)


def _ended(mission: str, result: Result, data: DataResult) -> str:
    return f"mission {mission}: {result.value}" + (", data INCOMPLETE" if data is DataResult.INCOMPLETE else "")


def _joined(decisions: Sequence[Decision]) -> List[Tuple[Decision, str]]:
    """Return each decision with its text; the same rule over and over within a state is told once."""
    told: List[Tuple[Decision, str]] = []
    times = 0
    for number, decision in enumerate(decisions):
        following = decisions[number + 1] if number + 1 < len(decisions) else None
        last = decisions[number - 1] if number else None
        if last is None or not _same(last, decision):
            told.append((decision, _decision(decision)))
            times = 0
            continue
        times += 1
        if following is None or not _same(decision, following):
            told.append((decision, f"  ... {decision.rule}, {times} more times until here"))
    return told


def _same(one: Decision, other: Decision) -> bool:
    return one.rule == other.rule and (one.before, one.after) == (other.before, other.after) == (one.after, one.before)


def _decision(decision: Decision) -> str:
    after = f"{decision.after}/{decision.step}" if decision.step else decision.after
    moved = after if decision.before == decision.after else f"{decision.before} -> {after}"
    values = "; ".join(_value(value) for value in decision.values)
    commands = f"  => {', '.join(decision.commands)}" if decision.commands else ""
    return f"{moved}  by {decision.rule}" + (f" ({values})" if values else "") + commands


def _value(value: Value) -> str:
    said = f"{value.value:.6g}" if isinstance(value.value, float) else str(value.value)
    text = " ".join(part for part in (value.name, said or "-", value.unit) if part)
    return text if value.limit is None else f"{text}, limit {value.limit}"


def _messages(commands: Sequence[Tuple[int, Command]]) -> List[Tuple[int, int, str]]:
    """Return the messages to the user; one that is said again and again is told once."""
    told: List[Tuple[int, int, str]] = []
    for t_ns, each in commands:
        if isinstance(each, Notify):
            loud = f"{each.level.name}: " if each.level > Level.INFO else ""
            text = f"  {loud}{each.text}" + (f" {each.advice}" if each.advice else "")
            if not told or told[-1][2] != text:
                told.append((t_ns, 2, text))
    return told


def summary(result: Run) -> Dict[str, Any]:
    """Return what came of a run as plain values."""
    return {
        "commands": [
            {"command": type(each).__name__, "t_s": t_ns / _NS, **_action(each)}
            for t_ns, each in result.commands
            if isinstance(each, Request)
        ],
        "decisions": [
            {
                "after": decision.after,
                "before": decision.before,
                "commands": list(decision.commands),
                "rule": decision.rule,
                "step": decision.step,
                "t_s": decision.t_ns / _NS,
            }
            for decision in result.decisions
        ],
        "finished": result.finished,
        "results": [
            {"mission": name, "result": each.value, "data_result": data.value} for name, each, data in result.results
        ],
        "simulated_s": result.state.t_ns / _NS,
        "state": result.state.state.value,
        "world": [{"t_s": t_ns / _NS, "text": text} for t_ns, text, _ in result.history],
    }


def _action(request: Request) -> Dict[str, str]:
    """Return which of its kind a request is."""
    for name in ("action", "check"):
        if hasattr(request, name):
            return {name: getattr(request, name).name}
    return {}
