"""Plays one case: a simulation, a journal or bags become one journal and its trace."""

from __future__ import annotations

from typing import Callable, Dict, Iterable, List, Mapping, Optional, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, Event
from amaze_autonomy.engine.journal import JournalError, decode, encode_decision, encode_event, encode_header, rules_of
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.simulation import Scenario
from amaze_autonomy.simulation.run import run

from ..errors import ReplayError
from ..expect.trace import trace_of
from ..journal_source import read_journals
from ..scenario.model import Case, SourceKind
from .bags import replay_case
from .played import Mark, Played, configuration_of, missions_of
from .task import Options

__all__ = ["play"]


def play(case: Case, options: Options, rules: Optional[Rules] = None) -> Played:
    """Run a case.

    Args:
        case: of a scenario.
        options: of the run.
        rules: to decide by instead of the configuration's, for mutations of the table.

    Raises:
        ConfigError: the configuration has a mistake.
        ReplayError: it cannot be run.
        BagError: a bag cannot be read.
        SimulationError: the scenario does not fit the simulated world.
        JournalError: a journal is damaged.
    """
    return _PLAYERS[case.source](case, options, rules)


def _simulate(case: Case, options: Options, rules: Optional[Rules]) -> Played:
    configuration = configuration_of(case, options)
    missions = missions_of(case, configuration)
    scenario = Scenario(case.description, case.faults, case.requests)
    result = run(configuration, missions, scenario, seed=case.seed, limit_ns=case.limit_ns, rules=rules)
    began = _beginnings(case, result.history)
    vacuous = [f"{fault} did nothing: it never began" for fault, t in zip(case.faults, began) if t is None]
    asked = [text for _, text in result.history]
    vacuous += [f"{each} was never asked" for each in case.requests if f"the user asks: {each}" not in asked]
    if not result.finished:
        vacuous.append(f"the run had not ended after {case.limit_ns / 1e9:g} s of simulated time")
    return Played(result.lines, trace_of(result.lines, 0, None, began), tuple(vacuous), (), _marks(result.history))


def _beginnings(case: Case, history: Tuple[Tuple[int, str], ...]) -> Tuple[Optional[int], ...]:
    """Return when each fault began; two that are the same in words begin in their order."""
    times: Dict[str, List[int]] = {}
    for t_ns, text in history:
        times.setdefault(text, []).append(t_ns)
    found: List[Optional[int]] = []
    for fault in case.faults:
        left = times.get(f"fault begins: {fault}", [])
        found.append(left.pop(0) if left else None)
    return tuple(found)


def _marks(history: Tuple[Tuple[int, str], ...]) -> Tuple[Mark, ...]:
    marks: List[Mark] = []
    for number, (t_ns, text) in enumerate(history):
        kind, _, what = text.partition(": ")
        if kind == "fault begins":
            ends = (end for end, other in history[number:] if other == f"fault ends: {what}")
            end_ns = next(ends, None)
            marks.append(("fault", t_ns / 1e9, None if end_ns is None else end_ns / 1e9, what))
        elif kind == "the user asks":
            marks.append(("user", t_ns / 1e9, t_ns / 1e9, what))
    return tuple(marks)


def _decide_again(case: Case, options: Options, rules: Optional[Rules]) -> Played:
    """Decide a journal again, by its own rules unless the scenario or the run names a configuration."""
    (journal, *more) = read_journals(case.journal) if case.journal is not None else ()
    if more:
        raise ReplayError(f"{case.journal}: holds several journals; take one of them")
    named = options.configuration or options.overrides or case.configuration is not None or case.overrides
    if rules is None:
        rules = configuration_of(case, options).rules if named else rules_of(journal.lines[0])
    header = journal.lines[0].payload
    lines = _decided((line.payload for line in journal.lines), rules)
    lines = [encode_header(header), *lines] if isinstance(header, dict) else lines
    broken = (f"{case.journal}: the end of the journal is cut off",) if journal.truncated else ()
    return Played(tuple(lines), trace_of(lines), (), broken)


def _decide_events(case: Case, options: Options, rules: Optional[Rules]) -> Played:
    """Decide the events that stand in the scenario itself."""
    try:
        payloads = [decode(text, number).payload for number, text in enumerate(case.events, 1)]
    except JournalError as error:
        raise ReplayError(f"{case.path}: events, {error}") from error
    lines = _decided(payloads, configuration_of(case, options).rules if rules is None else rules)
    return Played(tuple(lines), trace_of(lines))


def _decided(payloads: Iterable[object], rules: Rules) -> List[str]:
    """Return the lines of events and of what is decided about them; decisions among them are left out."""
    state = EngineState()
    lines: List[str] = []
    for event in payloads:
        if isinstance(event, Event):
            if isinstance(event, EngineStarted) and not event.resumed:
                state = EngineState()
            lines.append(encode_event(event))
            state, commands = decide(state, event, rules)
            lines += [encode_decision(each) for each in commands if isinstance(each, Decision)]
    return lines


_Player = Callable[[Case, Options, Optional[Rules]], Played]
_PLAYERS: Mapping[str, _Player] = {
    SourceKind.SIMULATION: _simulate,
    SourceKind.JOURNAL: _decide_again,
    SourceKind.EVENTS: _decide_events,
    SourceKind.BAGS: replay_case,
}
