"""Shrinks a failing run to the few events that lead to its first different decision: a scenario without bag or world.

Events are left out, half of them, then a quarter, and so on down to single ones (delta debugging), and the time between
them is taken out, as long as the engine still makes that decision, with the same values.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, List, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.events import EngineStarted, Event, checks_of
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, evolve

from ..journal.journal import decode, encode_event, rules_of
from ..replay.errors import ReplayError
from .difference import align, first_difference, key_of
from .golden import golden_path, read_golden
from .play import configuration_of, play
from .scenario import Case
from .task import Options

MOST_LINES = 50
_MS = 1_000_000


@dataclass(frozen=True)
class Shrunk:
    """What is left of a run.

    Args:
        events: in order.
        decision: that they still lead to: the first different one.
        before: how many events there were.
        text: of the scenario.
    """

    events: Tuple[Event, ...]
    decision: Decision
    before: int
    text: str


def shrink(case: Case, rule: str = "", folder: Path = Path()) -> Shrunk:
    """Shrink a case to the events that lead to its first different decision.

    Args:
        case: that differs from its golden.
        rule: take the first decision by this rule instead; needs no golden.
        folder: in which the scenario will lie: paths in it begin there.

    Raises:
        ReplayError: it does not differ, or not by a decision that is made.
    """
    played = play(case, Options())
    try:
        wanted = _wanted(case, played.trace.decisions, rule)
    except ReplayError as error:
        raise ReplayError("; ".join([str(error), *played.broken])) from error
    decoded = [decode(line, number) for number, line in enumerate(played.lines, 1)]
    events: List[Event] = []
    for line in decoded:
        if isinstance(line.payload, Event):
            events.append(line.payload)
        elif line.payload == wanted:
            break
    rules = rules_of(decoded[0], replace(configuration_of(case, Options()).rules, checks=case.checks))
    wants = _Wants(wanted, rules)
    if not wants(events):
        if case.journal is not None and _Wants(wanted, rules_of(decoded[0]))(events):
            words = "was decided by other rules than the configuration's, and what is shrunk to is decided by these"
            raise ReplayError(f"{case.path}: {case.journal} {words}; name its configuration in the scenario")
        raise ReplayError(f"{case.path}: the decision by {wanted.rule} depends on more than the events and the rules")
    left = _fewest(_closer(_fewest(events, wants), wants), wants)
    return Shrunk(tuple(left), wanted, len(events), _written(case, left, wanted, rules, folder))


def _wanted(case: Case, decisions: Sequence[Decision], rule: str) -> Decision:
    if rule:
        found = next((decision for decision in decisions if decision.rule == rule), None)
        if found is None:
            raise ReplayError(f"{case.path}: no decision by {rule} is made")
        return found
    golden = read_golden(golden_path(case))
    if golden is None:
        raise ReplayError(f"{case.path}: there is no golden to differ from; name a decision with --rule")
    changes = align(golden.decisions, decisions)
    first = first_difference(changes)
    if first is None:
        raise ReplayError(f"{case.path}: it decides as its golden says; name a decision with --rule")
    after = next((each.after for each in changes[changes.index(first) :] if each.after is not None), None)
    if after is None:
        raise ReplayError(
            f"{case.path}: the first difference is a decision that is not made any more; there is no event"
        )
    return after


class _Wants:
    """Does a list of events still lead to the decision?"""

    def __init__(self, wanted: Decision, rules: Rules) -> None:
        self._key, self._values, self._rules = key_of(wanted), wanted.values, rules

    def __call__(self, events: Sequence[Event]) -> bool:
        state = EngineState()
        for event in events:
            if isinstance(event, EngineStarted) and not event.resumed:
                state = EngineState()
            state, commands = decide(state, event, self._rules)
            for each in commands:
                if isinstance(each, Decision) and key_of(each) == self._key and each.values == self._values:
                    return True
        return False


def _fewest(events: Sequence[Event], wants: Callable[[Sequence[Event]], bool]) -> List[Event]:
    left = list(events)
    size = max(1, len(left) // 2)
    while True:
        place, smaller = 0, False
        while place < len(left):
            without = left[:place] + left[place + size :]
            if wants(without):
                left, smaller = without, True
            else:
                place += size
        if size == 1 and not smaller:
            return left
        size = max(1, size // 2)


def _closer(events: Sequence[Event], wants: Callable[[Sequence[Event]], bool]) -> List[Event]:
    """Take the time out between events where it does not matter: then fewer statuses are needed to fill it."""
    left = list(events)
    for place in range(1, len(left)):
        gap_ns = left[place].t_ns - left[place - 1].t_ns
        for part_ns in (gap_ns - _MS, gap_ns // 2):
            if part_ns > 0:
                nearer = left[:place] + [evolve(each, t_ns=each.t_ns - part_ns) for each in left[place:]]
                if wants(nearer):
                    left = nearer
                    break
    return left


def _written(case: Case, events: Sequence[Event], wanted: Decision, rules: Rules, folder: Path) -> str:
    words = f"Shrunk from {case.id}: {wanted.before} -> {wanted.after} by {wanted.rule}"
    lines = ["version: 1", f"description: {json.dumps(words)}"]
    if case.overrides or case.configuration is not None:
        lines.append("configuration:")
        if case.configuration is not None:
            lines.append(f"  folder: {json.dumps(os.path.relpath(case.configuration.resolve(), folder.resolve()))}")
        if case.overrides:
            lines += ["  set:", *(f"    {key}: {json.dumps(value)}" for key, value in case.overrides.items())]
    lines += [f"checks: [{', '.join(check.value for check in checks_of(rules))}]", "events:"]
    lines += ["  - '{}'".format(encode_event(event).replace("'", "''")) for event in events]
    lines += ["expectations:", f"  - {{expect: never, of: {{rule: {wanted.rule}}}}}"]
    return "".join(f"{line}\n" for line in lines)
