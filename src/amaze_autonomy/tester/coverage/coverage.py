"""Which rows of the engine's tables fired in a suite, where, and with which values; and which never did.

An item is one row: a rule of the transition table (or of the failures), a component of the decision table that failed
in flight, a loss, or a check that failed. A gate wants each, but for those with a waiver, which carries a reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.config.document import read
from amaze_autonomy.config.kinds import Choice, ListOf, Text
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.config.schema import Group, Key
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.paths import config_folder

from ...engine.events import CheckName
from ...engine.failsafe import FAILSAFE_CONDITIONS
from ...replay.timeline import value_text
from ..expect.schema import RULES
from ..golden import decisions_of
from ..golden.align import without_numbers
from ..result import Result
from .mutants import mutants_of

__all__ = ["Coverage", "Item", "coverage_lines", "coverage_of", "read_waivers"]

_CHECK = "check "


@dataclass(frozen=True)
class Item:
    """One row.

    Args:
        name: e.g. "rule land", "component lrf", "loss height", "check battery".
        scenarios: ids of those in which it fired, in order.
        values: what its guard looked at when it first fired.
        waiver: why it need not fire; empty: it must.
    """

    name: str
    scenarios: Tuple[str, ...] = ()
    values: str = ""
    waiver: str = ""


@dataclass(frozen=True)
class Coverage:
    """All rows, and what is wrong with the suite.

    Args:
        items: in the order of the tables.
        twins: pairs of scenario files with one ordered list of (state, rule, commands).
    """

    items: Tuple[Item, ...]
    twins: Tuple[Tuple[str, str], ...]

    @property
    def missing(self) -> Tuple[Item, ...]:
        """Rows that never fired and have no waiver."""
        return tuple(item for item in self.items if not item.scenarios and not item.waiver)

    @property
    def stale(self) -> Tuple[Item, ...]:
        """Rows that fired although a waiver says that they need not."""
        return tuple(item for item in self.items if item.scenarios and item.waiver)

    @property
    def passed(self) -> bool:
        """True when nothing is missing, stale or twice."""
        return not (self.missing or self.stale or self.twins)


def coverage_of(results: Iterable[Result], waivers: Optional[Mapping[str, str]] = None) -> Coverage:
    """Return what a suite covers.

    Args:
        results: of its scenarios.
        waivers: reason by name of the item.
    """
    seen: Dict[str, List[str]] = {}
    values: Dict[str, str] = {}
    stories: Dict[Tuple[object, ...], Result] = {}
    twins: List[Tuple[str, str]] = []
    for result in results:
        decisions = decisions_of(result.lines)
        for decision in decisions:
            for name in _items(decision):
                places = seen.setdefault(name, [])
                if result.id not in places:
                    places.append(result.id)
                values.setdefault(name, _looked_at(decision, result.start_ns))
        story = _story(decisions)
        first = stories.setdefault(story, result)
        if decisions and first.path != result.path:
            twins.append((first.id, result.id))
    reasons = waivers or {}
    items = (
        Item(name, tuple(seen.get(name, ())), values.get(name, ""), reasons.get(name, "")) for name in item_names()
    )
    return Coverage(tuple(items), tuple(twins))


def item_names() -> Tuple[str, ...]:
    """Return the names of all rows, in the order of the tables."""
    components = load_configuration(config_folder()).components
    return (
        *(f"rule {name}" for name in dict.fromkeys(RULES)),
        *(f"component {component.name}" for component in components),
        *(f"loss {row.name}" for row in FAILSAFE_CONDITIONS),
        *(f"check {check.value}" for check in CheckName),
    )


def _known() -> Tuple[str, ...]:
    """Return everything that can have a waiver: rows, and mutants of them."""
    mutants = mutants_of(load_configuration(config_folder()).rules)
    return (*item_names(), *(f"mutant {mutant}" for mutant in mutants))


def _items(decision: Decision) -> Tuple[str, ...]:
    names = [f"rule {decision.rule}"]
    for value in decision.values:
        if value.name == "failure":
            names += [f"component {value.value}", f"loss {value.value}"]
        elif value.name.startswith(_CHECK):
            names.append(f"check {value.name[len(_CHECK) :].split(' ')[0]}")
    return tuple(names)


def _looked_at(decision: Decision, start_ns: int) -> str:
    return "; ".join(value_text(value, start_ns) for value in decision.values)


def _story(decisions: Sequence[Decision]) -> Tuple[object, ...]:
    return tuple((each.after, each.rule, without_numbers(each.commands)) for each in decisions)


def read_waivers(path: Path) -> Mapping[str, str]:
    """Read waivers: the reason of each, by the item's name.

    Raises:
        ConfigError: the first mistake in the file.
    """
    keys = (
        Key("item", Choice(_known()), "what need not be covered"),
        Key("reason", Text("a sentence", longest=300), "why not"),
    )
    waivers = Key("waivers", ListOf(Group("a waiver", keys), "waivers"), "what need not be covered")
    entries = Group("waivers", (waivers,)).read(read(path), (), {})["waivers"]
    return {entry["item"]: entry["reason"] for entry in entries}


def coverage_lines(coverage: Coverage, *, verbose: bool = False) -> List[str]:
    """Return the coverage for a person: what is wrong, with `verbose` every item, and the share."""
    lines = [f"NOT COVERED  {item.name}" for item in coverage.missing]
    lines += [f"STALE        {item.name}: fired in {item.scenarios[0]}, its waiver can go" for item in coverage.stale]
    lines += [f"TWINS        {one} and {other}: the same states, rules and commands" for one, other in coverage.twins]
    for item in coverage.items if verbose else ():
        where = f"{len(item.scenarios)} scenarios, first {item.scenarios[0]}" if item.scenarios else "none"
        lines.append(f"{item.name}: {where}{f' ({item.values})' if item.values else ''}")
    fired = sum(bool(item.scenarios) for item in coverage.items)
    waived = sum(bool(item.waiver) and not item.scenarios for item in coverage.items)
    return [*lines, f"{fired} of {len(coverage.items)} rows fired, {waived} waived, {len(coverage.missing)} missing"]
