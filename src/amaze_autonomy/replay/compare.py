"""Decides every event of a journal again and compares decision by decision, byte by byte.

The journal's own header carries the rules it was decided by; other rules may be given. After the first difference the
two go different ways: what follows is counted, not explained.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, List, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, Event
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState

from ..journal.journal import Journal, JournalLine, encode_decision, rules_of

__all__ = ["Comparison", "Difference", "compare"]

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Difference:
    """One decision that is not the recorded one.

    Args:
        event: that led to it.
        event_line: of the event in the journal.
        recorded: what the journal says; None: nothing.
        decided: what is decided now; None: nothing.
    """

    event: Event
    event_line: int
    recorded: Optional[Decision]
    decided: Optional[Decision]


@dataclass(frozen=True)
class Comparison:
    """What came of it.

    Args:
        events: that were decided again.
        decisions: in the journal.
        differences: how many decisions differ, missing and additional ones included.
        first: the first difference; None: there is none.
        start_ns: time of the first event.
        final: state at the end.
        truncated: the journal's last line was cut off, or decisions of its last event are missing with it.
    """

    events: int
    decisions: int
    differences: int
    first: Optional[Difference]
    start_ns: int
    final: EngineState
    truncated: bool


@dataclass
class _Run:
    """A comparison in the making: what is decided for the last event and not yet found in the journal."""

    rules: Optional[Rules]
    state: EngineState = field(default_factory=EngineState)
    event: Optional[JournalLine] = None
    expected: List[Decision] = field(default_factory=list)
    differences: int = 0
    first: Optional[Difference] = None
    events: int = 0
    decisions: int = 0
    start_ns: int = 0

    def differ(self, recorded: Optional[Decision], decided: Optional[Decision]) -> None:
        """Count a difference, and keep the first."""
        self.differences += 1
        if self.first is None and self.event is not None and isinstance(self.event.payload, Event):
            self.first = Difference(self.event.payload, self.event.line_number, recorded, decided)


def compare(journal: Journal, rules: Optional[Rules] = None, progress: Optional[Progress] = None) -> Comparison:
    """Decide every event of a journal again.

    Args:
        journal: whole.
        rules: to decide by; None: those of the journal's header.
        progress: called with the number of lines that are done, now and then.

    Raises:
        JournalError: The header carries no rules, and none are given.
    """
    run = _Run(rules)
    for number, line in enumerate(journal.lines):
        _take(run, line, given=rules)
        if progress is not None and number % 256 == 0:
            progress(number)
    if not journal.truncated:
        _missing(run)
    elif run.expected:
        run.expected.clear()
    return Comparison(run.events, run.decisions, run.differences, run.first, run.start_ns, run.state, journal.truncated)


def _take(run: _Run, line: JournalLine, given: Optional[Rules]) -> None:
    payload = line.payload
    if isinstance(payload, Event):
        _missing(run)
        _decide(run, line, payload)
    elif isinstance(payload, Decision):
        run.decisions += 1
        _match(run, payload)
    elif given is None:
        run.rules = rules_of(line)


def _decide(run: _Run, line: JournalLine, event: Event) -> None:
    if isinstance(event, EngineStarted) and not event.resumed:
        run.state = EngineState()
    if run.events == 0:
        run.start_ns = event.t_ns
    run.event, run.events = line, run.events + 1
    run.state, commands = decide(run.state, event, run.rules or Rules())
    run.expected = [command for command in commands if isinstance(command, Decision)]


def _match(run: _Run, recorded: Decision) -> None:
    decided = run.expected.pop(0) if run.expected else None
    if decided is None or encode_decision(decided) != encode_decision(recorded):
        run.differ(recorded, decided)


def _missing(run: _Run) -> None:
    """Count the decisions of the last event that the journal lacks."""
    remaining: Sequence[Decision] = tuple(run.expected)
    for decided in remaining:
        run.differ(None, decided)
    run.expected = []


def changed_fields(recorded: Decision, decided: Decision) -> Tuple[str, ...]:
    """Return the names of the fields in which two decisions differ."""
    return tuple(name for name in Decision.__dataclass_fields__ if getattr(recorded, name) != getattr(decided, name))
