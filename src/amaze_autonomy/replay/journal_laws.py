"""Checks the laws on a journal: every event is decided again, and judged by what an outsider saw.

A journal holds events and decisions, not the contents of each request; so its events are decided again. Where today's
engine decides otherwise than the one that flew, it is today's that is judged, and this is said.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Optional, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, Event
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.laws import LAWS, Broken, Judge, Judged

from ..journal.journal import Journal, decode, encode_decision, rules_of

__all__ = ["Lawful", "broken_words", "check_laws", "law_lines", "laws_of_lines", "laws_result"]

_NS = 1e9


@dataclass(frozen=True)
class Lawful:
    """What came of a journal.

    Args:
        judged: by the laws.
        start_ns: time of its first event.
        different: how many decisions are not those of the journal.
        truncated: its last line is cut off.
    """

    judged: Judged
    start_ns: int
    different: int
    truncated: bool = False


def check_laws(
    journal: Journal, rules: Optional[Rules] = None, progress: Callable[[int], None] = lambda _: None
) -> Lawful:
    """Decide a journal again under all laws.

    Args:
        journal: whole.
        rules: to decide by; None: those of its header.
        progress: called with the number of lines that are done, now and then.

    Raises:
        JournalError: The header carries no rules, and none are given.
    """
    payloads: List[Any] = []
    for line in journal.lines:
        if line.kind != "header":
            payloads.append(line.payload)
        elif rules is None:
            rules = rules_of(line)
    return _check(payloads, rules or Rules(), truncated=journal.truncated, progress=progress)


def laws_of_lines(lines: Iterable[str]) -> Lawful:
    """Decide the lines of a journal, header first, again under all laws."""
    return check_laws(Journal(tuple(decode(text, number) for number, text in enumerate(lines, 1)), truncated=False))


def _check(
    payloads: List[Any], rules: Rules, *, truncated: bool = False, progress: Callable[[int], None] = lambda _: None
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
    }
