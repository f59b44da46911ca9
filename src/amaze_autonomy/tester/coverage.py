"""Which rows of the engine's tables fired in a suite, where, and with which values; and which never did.

An item is one row: a rule of the transition table (or of the failures), a component of the decision table that failed
in flight, a loss, or a check that failed. A gate wants each, but for those with a waiver, which carries a reason.
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import (
    Any,
    Callable,
    Dict,
    Iterable,
    Iterator,
    List,
    Mapping,
    MutableMapping,
    Optional,
    Sequence,
    Tuple,
    cast,
)

from amaze_autonomy.config.document import read
from amaze_autonomy.config.kinds import Choice, ListOf, Text
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.config.schema import Group, Key
from amaze_autonomy.engine import failsafe, flight_guards, guards, transitions
from amaze_autonomy.engine import rules as severities
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import CheckName
from amaze_autonomy.engine.failsafe import FAILSAFE_CONDITIONS
from amaze_autonomy.engine.rules import SEVERITIES, Action, Limits, Rules, Severity
from amaze_autonomy.journal.journal import encode_decision
from amaze_autonomy.laws.flight import BOUNDS
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.errors import ReplayError
from amaze_autonomy.replay.timeline import value_text

from .difference import without_numbers
from .expect.model import RULES
from .golden import decisions_of
from .play import configuration_of, play
from .run import DIED, case_of, digest_of, spread
from .scenario import Case, SourceKind
from .task import Options, Result, Task

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
    items = []
    for name in item_names():
        without = "" if name in seen else _BOUNDED.get(name, "")
        items.append(Item(name, tuple(seen.get(name, ())), values.get(name, ""), reasons.get(name, without)))
    return Coverage(tuple(items), tuple(twins))


_ANY_FLIGHT = "a bound of the laws: test/engine/test_losses.py flies it, at its limit and beyond, in every phase"
_BOUNDED = {f"loss {name}": _ANY_FLIGHT for name in BOUNDS}
"""Rows that differ from one another in a field and a number alone: a scenario of each would tell nothing new."""


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


# --- mutants ----------------------------------------------------------------------------------------------------------
# Mutants of the engine's tables: a row deleted, an action, a severity or a flag swapped, a threshold off by a little.
#
# Each is made by name, so that a name is all that is sent to another process. Tables are put back when the run
# has ended.


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


# --- who notices a mutant ---------------------------------------------------------------------------------------------
# Runs a suite against each mutant until a scenario decides otherwise: is every row of the tables really tested?


@dataclass(frozen=True)
class Hunt:
    """One mutant, and the tests that may notice it, the likeliest first; with the digest of each as it should be."""

    mutant: str
    tasks: Tuple[Task, ...]
    digests: Tuple[str, ...]


@dataclass(frozen=True)
class Survival:
    """What became of a mutant.

    Args:
        mutant: its name.
        caught_by: id of the first scenario that decided otherwise; empty: none did.
        tried: how many scenarios were run.
        unknown: why nobody knows; empty: it was tried.
    """

    mutant: str
    caught_by: str
    tried: int
    unknown: str = ""


def check_only(only: str) -> None:
    """Refuse a text that no mutant's name holds.

    Raises:
        ReplayError: there is none.
    """
    if not any(only in str(mutant) for mutant in mutants_of(load_configuration(config_folder()).rules)):
        raise ReplayError(f"no mutant is called so: its name would hold {only!r}")


def hunts_of(tasks: Sequence[Task], results: Sequence[Result], coverage: Coverage, only: str = "") -> Tuple[Hunt, ...]:
    """Return a hunt for each mutant of the shipped rules.

    Args:
        tasks: of the suite; journals are left out, they are decided by rules of their own.
        results: of the same tasks, on the rules as they are.
        coverage: of the results.
        only: kinds or names that hold this text; empty: all.
    """
    pairs = [(t, r) for t, r in zip(tasks, results) if r.lines and case_of(t).source != SourceKind.JOURNAL]
    pairs.sort(key=lambda pair: pair[1].figures.flown_s)
    fired: Dict[str, Tuple[str, ...]] = {item.name: item.scenarios for item in coverage.items}
    hunts: List[Hunt] = []
    for mutant in mutants_of(load_configuration(config_folder()).rules):
        if only in str(mutant):
            likely = fired.get(mutant.item, ())
            ordered = sorted(pairs, key=lambda pair: pair[1].id not in likely)
            if mutant.kind == "row":
                ordered = [pair for pair in ordered if pair[1].id in likely]  # elsewhere it changes nothing
            hunts.append(Hunt(str(mutant), tuple(t for t, _ in ordered), tuple(r.digest for _, r in ordered)))
    return tuple(hunts)


def run_hunt(hunt: Hunt) -> Survival:
    """Run tests until one decides otherwise.

    Raises:
        ReplayError: there is no such mutant.
    """
    for number, (task, digest) in enumerate(zip(hunt.tasks, hunt.digests), 1):
        case = case_of(replace(task, options=Options(memory=task.options.memory)))
        rules = configuration_of(case, Options()).rules
        mutant = mutant_of(hunt.mutant, rules)
        if mutant is None:
            raise ReplayError(f"there is no mutant {hunt.mutant!r}")
        if _decided(case, mutant) != digest:
            return Survival(hunt.mutant, case.id, number)
    return Survival(hunt.mutant, "", len(hunt.tasks))


def _decided(case: Case, mutant: Mutant) -> str:
    """Return the digest of what a mutant decides; empty when it cannot even be run."""
    rules = configuration_of(case, Options()).rules
    with mutated(mutant, rules) as changed:
        limited = replace(case, limit_ns=min(case.limit_ns, _LIMIT_NS))
        try:
            trace = play(limited, Options(), changed).trace
        except (ValueError, KeyError, RuntimeError):
            return ""
    return digest_of([encode_decision(decision) for decision in trace.decisions])


_LIMIT_NS = 900_000_000_000


def run_hunts(
    hunts: Sequence[Hunt], jobs: int = 1, told: Optional[Callable[[Survival], None]] = None
) -> Tuple[Survival, ...]:
    """Run all hunts, in processes; the results are in their order."""
    tell = told or (lambda _: None)
    if jobs > 1:
        return spread(run_hunt, hunts, jobs, _lost, tell)
    found: List[Survival] = []
    for hunt in hunts:
        found.append(run_hunt(hunt))
        tell(found[-1])
    return tuple(found)


def _lost(hunt: Hunt) -> Survival:
    return Survival(hunt.mutant, "", 0, f"the process that hunted it {DIED}")


def mutation_lines(survivals: Sequence[Survival], waivers: Mapping[str, str]) -> List[str]:
    """Return what survived, and the score."""
    alive = [each for each in survivals if not each.caught_by and not each.unknown]
    unknown = [each for each in survivals if each.unknown]
    open_ = [each for each in alive if not _may_survive(each, waivers)]
    lines = [f"SURVIVED  {each.mutant}: none of {each.tried} scenarios decides otherwise" for each in open_]
    lines += [f"UNKNOWN   {each.mutant}: {each.unknown}" for each in unknown]
    lines += [
        f"STALE     {each.mutant}: a waiver says that it survives, and {each.caught_by} catches it"
        for each in survivals
        if each.caught_by and _waived(each, waivers)
    ]
    caught = len(survivals) - len(alive) - len(unknown)
    said = f"{caught} of {len(survivals)} mutants caught, {len(alive) - len(open_)} waived, {len(open_)} survive"
    return [*lines, said + (f", {len(unknown)} unknown" if unknown else "")]


def mutation_passed(survivals: Sequence[Survival], waivers: Mapping[str, str]) -> bool:
    """Return True when each mutant is caught or has a waiver, none has both, and of each it is known."""
    return all(
        not each.unknown and (not _waived(each, waivers) if each.caught_by else _may_survive(each, waivers))
        for each in survivals
    )


def _waived(survival: Survival, waivers: Mapping[str, str]) -> bool:
    return f"mutant {survival.mutant}" in waivers


def _may_survive(survival: Survival, waivers: Mapping[str, str]) -> bool:
    return _waived(survival, waivers) or survival.mutant in _BOUNDED_MUTANTS


_BOUNDED_MUTANTS = {
    *(str(Mutant(kind, name)) for kind in ("loss", *_FLAGS) for name in BOUNDS),
    *(str(Mutant(kind, bound.limit)) for kind in ("limit", "lower") for bound in BOUNDS.values()),
}
