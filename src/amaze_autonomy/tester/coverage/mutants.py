"""Mutants of the engine's tables: a row deleted, an action, a severity or a flag swapped, a threshold off by a little.

Each is made by name, so that a name is all that is sent to another process. Tables are put back when the run has ended.
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from typing import Any, Dict, Iterator, List, MutableMapping, Optional, Tuple, cast

from amaze_autonomy.engine.rules import Limits, Rules

from ...engine import failsafe, flight_guards, guards, transitions
from ...engine import rules as severities
from ...engine.failsafe import FAILSAFE_CONDITIONS
from ...engine.rules import SEVERITIES, Action, Severity

__all__ = ["Mutant", "mutant_of", "mutants_of", "mutated"]

_TURN_NS = 100_000_000
_LITTLE = 1.02
_OTHER_VERB = {
    Action.CONTINUE: Action.LAND,
    Action.WAIT: Action.CONTINUE,
    Action.LAND: Action.CONTINUE,
    Action.PILOT: Action.LAND,
}
_OTHER_SEVERITY = {
    Severity.LOW: Severity.HIGH,
    Severity.MODERATE: Severity.HIGH,
    Severity.HIGH: Severity.MODERATE,
    Severity.HIGHEST: Severity.LOW,
}


_FLAGS = {"routes": "_BOTH_ROUTES", "alarm": "_ALARM"}


@dataclass(frozen=True)
class Mutant:
    """One change of one row.

    Args:
        kind: row, loss, routes, alarm, severity, component, wait, limit or lower.
        name: of the row.
        item: of the coverage, whose scenarios may notice; empty: any may.
    """

    kind: str
    name: str
    item: str = ""

    def __str__(self) -> str:
        return f"{_WORDS[self.kind]} {self.name}"


_WORDS = {
    "row": "deleted row",
    "loss": "swapped action of loss",
    "routes": "swapped routes of loss",
    "alarm": "swapped alarm of loss",
    "severity": "swapped action of severity",
    "component": "swapped severity of",
    "wait": "longer wait for",
    "limit": "shifted limit",
    "lower": "lowered limit",
}


def mutants_of(rules: Rules) -> Tuple[Mutant, ...]:
    """Return all mutants for some rules, in the order of the tables."""
    found: List[Mutant] = [Mutant("row", each.rule, f"rule {each.rule}") for each in transitions.TRANSITIONS]
    for kind in ("loss", "routes", "alarm"):
        found += [Mutant(kind, row.name, f"loss {row.name}") for row in FAILSAFE_CONDITIONS]
    found += [Mutant("severity", severity.value) for severity in SEVERITIES]
    for component in rules.components:
        found.append(Mutant("component", component.name, f"component {component.name}"))
        if component.severity in (Severity.MODERATE, Severity.HIGH):
            found.append(Mutant("wait", component.name, f"component {component.name}"))
    for kind in ("limit", "lower"):
        found += [Mutant(kind, each.name) for each in fields(Limits)]
    return tuple(found)


def mutant_of(text: str, rules: Rules) -> Optional[Mutant]:
    """Return the mutant of a name; None: there is none."""
    return next((mutant for mutant in mutants_of(rules) if str(mutant) == text), None)


@contextmanager
def mutated(mutant: Mutant, rules: Rules) -> Iterator[Rules]:
    """Change the tables of this process, and put them back; gives the rules to decide by."""
    if mutant.kind == "row":
        with _patched(cast(Dict[Any, Any], transitions.ROWS_AT), _without(mutant.name)):
            yield rules
    elif mutant.kind == "loss":
        changed = tuple(
            replace(x, action=_OTHER_VERB[x.action]) if x.name == mutant.name else x for x in FAILSAFE_CONDITIONS
        )
        with _set(failsafe, "FAILSAFE_CONDITIONS", changed):
            yield rules
    elif mutant.kind in _FLAGS:
        names = getattr(flight_guards, _FLAGS[mutant.kind])
        with _set(flight_guards, _FLAGS[mutant.kind], names ^ {mutant.name}):
            yield rules
    elif mutant.kind == "severity":
        severity = Severity(mutant.name)
        row = SEVERITIES[severity]
        other = replace(
            row, action=_OTHER_VERB[row.action], fallback=None if row.fallback is None else _OTHER_VERB[row.fallback]
        )
        with ExitStack() as stack:  # for what decides; the configuration is checked by the table as it is
            for module in (severities, failsafe, guards):
                stack.enter_context(_set(module, "SEVERITIES", {**SEVERITIES, severity: other}))
            yield rules
    else:
        yield _changed_rules(mutant, rules)


def _changed_rules(mutant: Mutant, rules: Rules) -> Rules:
    if mutant.kind in ("limit", "lower"):
        value, up = getattr(rules.limits, mutant.name), mutant.kind == "limit"
        if mutant.name.endswith("_ns"):
            other = value + (_TURN_NS if up else -_TURN_NS)
        elif isinstance(value, int):
            other = value + (1 if up else -1)
        else:
            other = value * _LITTLE if up else value / _LITTLE
        return replace(rules, limits=replace(rules.limits, **{mutant.name: other}))
    rows = []
    for row in rules.components:
        if row.name != mutant.name:
            rows.append(row)
        elif mutant.kind == "wait":
            rows.append(replace(row, wait_limit_ns=row.wait_limit_ns + _TURN_NS))
        else:
            rows.append(replace(row, severity=_OTHER_SEVERITY[row.severity]))
    return replace(rules, components=tuple(rows))


def _without(rule: str) -> Dict[Any, Any]:
    return {
        place: tuple(row for row in rows if row.rule != rule)
        for place, rows in transitions.ROWS_AT.items()
        if any(row.rule == rule for row in rows)
    }


@contextmanager
def _patched(table: MutableMapping[Any, Any], changes: Dict[Any, Any]) -> Iterator[None]:
    old = {key: table[key] for key in changes}
    table.update(changes)
    try:
        yield
    finally:
        table.update(old)


@contextmanager
def _set(module: Any, name: str, value: Any) -> Iterator[None]:
    old = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, old)
