"""Decides every event of a journal again, compares decision by decision, byte by byte, and judges it by the laws.

The journal's own header carries the rules it was decided by; other rules may be given. After the first difference the
two go different ways: what follows is counted, not explained.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, Event, Shutdown
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.laws import LAWS, Broken, Judge, Judged

from ..journal.journal import Journal, JournalLine, decode, encode_decision, rules_of
from .changed_keys import Unread

# --- compared with what was recorded ----------------------------------------------------------------------------------


Progress = Callable[[int], None]
Watch = Callable[[Rules], Rules]  # returns rules that note what is asked of them


def _unwatched(rules: Rules) -> Rules:
    return rules


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
        unread: changed keys of the configuration that nothing looked at.
    """

    events: int
    decisions: int
    differences: int
    first: Optional[Difference]
    start_ns: int
    final: EngineState
    truncated: bool
    unread: Tuple[Unread, ...] = ()


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


def compare(
    journal: Journal, rules: Optional[Rules] = None, progress: Optional[Progress] = None, watch: Watch = _unwatched
) -> Comparison:
    """Decide every event of a journal again.

    Args:
        journal: whole.
        rules: to decide by; None: those of the journal's header.
        progress: called with the number of lines that are done, now and then.
        watch: called with the rules that are decided by.

    Raises:
        JournalError: The header carries no rules, and none are given.
    """
    run = _Run(rules)
    for number, line in enumerate(journal.lines):
        _take(run, line, given=rules, watch=watch)
        if progress is not None and number % 256 == 0:
            progress(number)
    # By the rules that flew, what the last event lacks was decided and not written: the process was killed between.
    ended = run.event is None or isinstance(run.event.payload, Shutdown) or run.first is not None
    truncated = journal.truncated or (rules is None and bool(run.expected) and not ended)
    if not truncated:
        _missing(run)
    return Comparison(run.events, run.decisions, run.differences, run.first, run.start_ns, run.state, truncated)


def _take(run: _Run, line: JournalLine, given: Optional[Rules], watch: Watch) -> None:
    payload = line.payload
    if isinstance(payload, Event):
        _missing(run)
        _decide(run, line, payload)
    elif isinstance(payload, Decision):
        run.decisions += 1
        _match(run, payload)
    else:
        run.rules = watch(rules_of(line, given))


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


# --- judged by the laws -----------------------------------------------------------------------------------------------
# A journal holds events and decisions, not the contents of each request; so its events are decided again. Where today's
# engine decides otherwise than the one that flew, it is today's that is judged, and this is said.


_NS = 1e9


@dataclass(frozen=True)
class Lawful:
    """What came of a journal.

    Args:
        judged: by the laws.
        start_ns: time of its first event.
        different: how many decisions are not those of the journal.
        truncated: its last line is cut off.
        unread: changed keys of the configuration that nothing looked at.
    """

    judged: Judged
    start_ns: int
    different: int
    truncated: bool = False
    unread: Tuple[Unread, ...] = ()


def check_laws(
    journal: Journal,
    rules: Optional[Rules] = None,
    progress: Progress = lambda _: None,
    watch: Watch = _unwatched,
) -> Lawful:
    """Decide a journal again under all laws.

    Args:
        journal: whole.
        rules: to decide by; None: those of its header.
        progress: called with the number of lines that are done, now and then.
        watch: called with the rules that are decided and judged by.

    Raises:
        JournalError: The header carries no rules, and none are given.
    """
    payloads: List[Any] = []
    for line in journal.lines:
        if line.kind != "header":
            payloads.append(line.payload)
        else:
            rules = rules_of(line, rules)
    return _check(payloads, watch(rules or Rules()), truncated=journal.truncated, progress=progress)


def laws_of_lines(lines: Iterable[str]) -> Lawful:
    """Decide the lines of a journal, header first, again under all laws."""
    return check_laws(Journal(tuple(decode(text, number) for number, text in enumerate(lines, 1)), truncated=False))


def _check(
    payloads: List[Any], rules: Rules, *, truncated: bool = False, progress: Progress = lambda _: None
) -> Lawful:
    state, judge = EngineState(), Judge(rules)
    recorded: List[Decision] = []
    decided: List[Decision] = []
    for number, payload in enumerate(payloads):
        if isinstance(payload, Decision):
            recorded.append(payload)
        elif isinstance(payload, Event):
            if isinstance(payload, EngineStarted) and not payload.resumed:
                state = EngineState()
                judge.begin()
            after, commands = decide(state, payload, rules)
            judge.watch(state, payload, commands, after)
            decided += [command for command in commands if isinstance(command, Decision)]
            state = after
        if number % 256 == 0:
            progress(number)
    start_ns = next((payload.t_ns for payload in payloads if isinstance(payload, Event)), 0)
    return Lawful(judge.judged(), start_ns, _different(recorded, decided), truncated)


def _different(recorded: List[Decision], decided: List[Decision]) -> int:
    pairs = zip(recorded, decided)
    return abs(len(recorded) - len(decided)) + sum(encode_decision(a) != encode_decision(b) for a, b in pairs)


def broken_words(broken: Broken, start_ns: int) -> str:
    """Return a broken law as one sentence."""
    times = "" if broken.times == 1 else f", and after {broken.times - 1} more events"
    when = f"at {(broken.t_ns - start_ns) / _NS:.3f} s, after event {broken.number} ({broken.event}){times}"
    return f"law broken: {broken.law.name}: {broken.why}; {when}. The law: {broken.law.words}"


def law_lines(lawful: Lawful) -> Tuple[str, ...]:
    """Return what is printed of it: every broken law, then one line of all."""
    judged = lawful.judged
    lines = [broken_words(each, lawful.start_ns) for each in judged.broken]
    if lawful.different:
        lines.append(
            f"{lawful.different} decisions differ from the recorded ones (amaze-replay journal shows the first): the "
            "laws were checked on what is decided now"
        )
    if lawful.truncated:
        lines.append("the end of the journal is cut off")
    if not judged.events:
        lines.append("there is no event in the journal: nothing was checked")
    lines += [f"VACUOUS: {each}" for each in lawful.unread]
    spoke = len(set(judged.applied) | {each.law.name for each in judged.broken})
    found = f"{len(judged.broken)} broken" if judged.broken else "none broken"
    checked = f"{judged.events:,} events, {spoke} of {len(LAWS)} laws applied {sum(judged.applied.values()):,} times"
    return (*lines, f"{checked}: {found}")


def laws_result(lawful: Lawful) -> Dict[str, Any]:
    """Return it as JSON values."""
    judged = lawful.judged
    return {
        "events": judged.events,
        "applied": {name: judged.applied.get(name, 0) for name in LAWS},
        "broken": [
            {
                "law": each.law.name,
                "words": each.law.words,
                "source": each.law.source,
                "why": each.why,
                "t_ns": each.t_ns,
                "event": each.event,
                "number": each.number,
                "times": each.times,
            }
            for each in judged.broken
        ],
        "different_decisions": lawful.different,
        "truncated": lawful.truncated,
        "not_looked_at": [{"key": each.key, "reason": each.reason} for each in lawful.unread],
    }
