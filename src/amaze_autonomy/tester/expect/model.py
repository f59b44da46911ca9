"""The closed set of expectations, as a table; the patterns that they look for, and what came of one."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import List, Mapping, Optional, Tuple, Union

from amaze_autonomy.engine.commands import Decision

from ...journal.trace import Span, Trace

__all__ = [
    "EXPECTATIONS",
    "Expectation",
    "ExpectationKind",
    "Finding",
    "Grade",
    "Instant",
    "Pattern",
    "about",
    "instants",
    "spans",
]

# --- patterns ---------------------------------------------------------------------------------------------------------
# A pattern is matched at instants (a state is entered, a command is sent) and, where it is a condition, over time
# (while the state is LAND). Only a state and a code last.


@dataclass(frozen=True)
class Pattern:
    """Exactly one of state, rule, command, failure, component.

    Args:
        states: of the engine, any of them.
        step: within the state; empty: any.
        rule: that fired.
        command: e.g. "LAND", "AutopilotLand", "RunCheck(BATTERY)".
        failure: name of the component or loss that a decision was about.
        component: whose code is looked at.
        code: at least so high.
    """

    states: Tuple[str, ...] = ()
    step: str = ""
    rule: str = ""
    command: str = ""
    failure: str = ""
    component: str = ""
    code: int = 0

    @property
    def lasts(self) -> bool:
        """True when it is a condition that holds for a time."""
        return bool(self.states or self.component)

    def __str__(self) -> str:
        if self.states:
            return "/".join(("|".join(self.states), *([self.step] if self.step else [])))
        if self.component:
            return f"{self.component} at code {self.code} or above"
        kinds = (("rule", self.rule), ("command", self.command), ("failure of", self.failure))
        return next(f"{word} {value}" for word, value in kinds if value)


def instants(pattern: Pattern, trace: Trace) -> Tuple[int, ...]:
    """Return when a pattern happens, in order: a condition happens when it begins."""
    if pattern.lasts:
        return tuple(span.begin_ns for span in spans(pattern, trace))
    found: List[int] = []
    for decision in trace.decisions:
        found += [decision.t_ns] * _times(pattern, decision)
    return tuple(found)


def spans(pattern: Pattern, trace: Trace) -> Tuple[Span, ...]:
    """Return while when a condition holds; spans in a row are one."""
    joined: List[Span] = []
    held = False
    for span in trace.codes.get(pattern.component, ()) if pattern.component else trace.states:
        holds = int(span.value) >= pattern.code if pattern.component else _in_state(pattern, span.value)
        if holds and held:
            joined[-1] = Span(joined[-1].begin_ns, span.end_ns, joined[-1].value)
        elif holds:
            joined.append(span)
        held = holds
    return tuple(joined)


def _in_state(pattern: Pattern, value: str) -> bool:
    state, _, step = value.partition("/")
    return state in pattern.states and pattern.step in ("", step)


def _times(pattern: Pattern, decision: Decision) -> int:
    if pattern.rule:
        return int(decision.rule == pattern.rule)
    if pattern.failure:
        return int(about(decision) == pattern.failure)
    return sum(_is_command(pattern.command, text) for text in decision.commands)


def about(decision: Decision) -> Optional[str]:
    """Return the name of the failure that a decision is about; None: of none."""
    return next((str(value.value) for value in decision.values if value.name == "failure"), None)


def _is_command(wanted: str, text: str) -> bool:
    """Tell whether "MissionCommand(LAND)#12" is the command "LAND", "MissionCommand" or "MissionCommand(LAND)"."""
    name = text.partition("#")[0]
    kind, _, detail = name.partition("(")
    return wanted in (name, kind, detail[:-1])


# --- expectations -----------------------------------------------------------------------------------------------------


Instant = Union[int, str]
"""Nanoseconds from the start, or the name of an anchor."""


@dataclass(frozen=True)
class ExpectationKind:
    """One kind of expectation.

    Args:
        name: as in the file.
        words: what it means.
        patterns: keys that take a pattern, in the order of the file.
        numbers: keys that take a number.
        needs: those of the numbers of which at least one must be given.
        lasting: its patterns must be conditions that last: a state or a component's code.
        many: its one pattern is a list.
    """

    name: str
    words: str
    patterns: Tuple[str, ...]
    numbers: Tuple[str, ...] = ()
    needs: Tuple[str, ...] = ()
    lasting: bool = False
    many: bool = False


_TIMES = ("at_least_s", "at_most_s")
_COUNTS = ("at_least", "at_most")
_SHARES = ("at_least_fraction", "at_most_fraction")
_KINDS = (
    ExpectationKind("exists", "it happens, within a time of `from`", ("of",), ("within_s",)),
    ExpectationKind("never", "it does not happen, and does not last into the window", ("of",)),
    ExpectationKind("always", "it holds all the time", ("of",), lasting=True),
    ExpectationKind(
        "response", "after each `when` comes a `then`, within a time", ("when", "then"), ("within_s",), ("within_s",)
    ),
    ExpectationKind("precedence", "no `then` comes without a `first` before it", ("first", "then")),
    ExpectationKind(
        "sequence", "they happen in this order; others may come between", ("of",), ("within_s",), many=True
    ),
    ExpectationKind("count", "it happens so often", ("of",), _COUNTS, _COUNTS),
    ExpectationKind("duration", "each time it holds for so long", ("of",), _TIMES, _TIMES, lasting=True),
    ExpectationKind("share", "it holds for such a part of the window", ("of",), _SHARES, _SHARES, lasting=True),
)
EXPECTATIONS: Mapping[str, ExpectationKind] = {kind.name: kind for kind in _KINDS}
"""By name, in the order of the documentation."""


@dataclass(frozen=True)
class Expectation:
    """One expectation of a scenario.

    Args:
        kind: of it.
        patterns: (key, pattern) of each pattern that was given.
        numbers: (key, value) of each number that was given.
        begin: of the window.
        end: of the window; None: the end of the run.
        where: file and line.
    """

    kind: ExpectationKind
    patterns: Tuple[Tuple[str, Pattern], ...]
    numbers: Tuple[Tuple[str, float], ...] = ()
    begin: Instant = 0
    end: Optional[Instant] = None
    where: str = ""

    def pattern(self, key: str) -> Pattern:
        """Return one of its patterns."""
        return dict(self.patterns)[key]

    def number(self, key: str) -> Optional[float]:
        """Return one of its numbers; None when it was not given."""
        return dict(self.numbers).get(key)

    def __str__(self) -> str:
        said = f"{self.kind.name} " + ", ".join(
            f"{pattern}" if key == "of" else f"{key} {pattern}" for key, pattern in self.patterns
        )
        said += "".join(f", {key} {value:g}" for key, value in self.numbers)
        begin = f", from {_said(self.begin)}" if self.begin != 0 else ""
        return said + begin + (f", to {_said(self.end)}" if self.end is not None else "")


def _said(instant: Instant) -> str:
    return instant if isinstance(instant, str) else f"{instant / 1e9:g} s"


class Grade(enum.Enum):
    """What came of one expectation."""

    PASS = "PASS"  # noqa: S105
    FAIL = "FAIL"
    VACUOUS = "VACUOUS"  # it evaluated nothing


@dataclass(frozen=True)
class Finding:
    """What came of one expectation.

    Args:
        expectation: in words.
        grade: of it.
        text: what was found, one line.
        margin: what is left to the limit, in its unit; negative: by how much it was missed; None: it has no limit.
        limit: that the margin is a part of.
        unit: of both.
        begin_s: of the window that was looked at, from the start.
        end_s: of the window.
        where: file and line of the expectation.
    """

    expectation: str
    grade: Grade
    text: str
    margin: Optional[float] = None
    limit: Optional[float] = None
    unit: str = ""
    begin_s: Optional[float] = None
    end_s: Optional[float] = None
    where: str = ""

    @property
    def margin_text(self) -> str:
        """The margin in words, e.g. "0.04 s of 0.40 s left"; empty when there is none."""
        if self.margin is None:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        of = f" of {self.limit:.4g}{unit}" if self.limit is not None else ""
        return f"{self.margin:.4g}{unit}{of} left" if self.margin >= 0 else f"missed by {-self.margin:.4g}{unit}{of}"
