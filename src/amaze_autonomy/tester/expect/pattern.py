"""What an expectation or an anchor looks for in a run: a state, a rule, a command, a failure, a component's code.

A pattern is matched at instants (a state is entered, a command is sent) and, where it is a condition, over time (while
the state is LAND). Only a state and a code last.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional, Tuple

from amaze_autonomy.engine.commands import Decision

from ...journal.trace import Span, Trace

__all__ = ["Pattern", "about", "instants", "spans"]


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
