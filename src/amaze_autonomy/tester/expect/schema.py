"""Reads patterns and expectations from YAML, in the same manner as faults: a kind, and the keys of its row."""

from __future__ import annotations

from typing import Any, List, Mapping, Optional, Tuple

from amaze_autonomy.config.document import Entry, Items, Scalar, Table
from amaze_autonomy.config.kinds import Address, Choice, Kind, ListOf, Number, Places, Text, Whole, described, refuse
from amaze_autonomy.config.schema import REQUIRED, Group, Key
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.state import State, Step
from amaze_autonomy.engine.transitions import TRANSITIONS

from ...config.schemas.sensors import COMPONENT_NAME
from ...engine.events import CheckName
from ...engine.rules import Code
from .model import EXPECTATIONS, Expectation, ExpectationKind, Instant, Pattern

__all__ = ["COMMANDS", "RULES", "ExpectationEntry", "InstantEntry", "PatternEntry"]

_S = 1_000_000_000
_FAILURES = ("failure_continue", "failure_wait", "failure_land", "failure_pilot", "failure_back", "flown_without")
RULES = (*(row.rule for row in TRANSITIONS), *_FAILURES)
"""Every rule that a decision can name."""
_REQUESTS = (
    *("MissionCommand", "AutopilotLand", "AutopilotDisarm", "StartRecording", "StopRecording"),
    *("LoadMission", "RunCheck"),
)
COMMANDS = (*_REQUESTS, *(each.name for each in MissionAction), *(f"RunCheck({each.name})" for each in CheckName))
"""Every command that a pattern can name."""
_TIME = Number(minimum=0.0, maximum=86_400.0)
_NUMBERS: Mapping[str, Kind] = {
    "within_s": Number(minimum=0.0, maximum=86_400.0),
    "at_least_s": _TIME,
    "at_most_s": _TIME,
    "at_least": Whole(0, 1_000_000),
    "at_most": Whole(0, 1_000_000),
    "at_least_fraction": Number(minimum=0.0, maximum=1.0),
    "at_most_fraction": Number(minimum=0.0, maximum=1.0),
}


class _States(Kind):
    """One state, or a list of them."""

    _one = Choice(tuple(state.value for state in State))
    _many = ListOf(_one, "states", at_least=1, unique=True)

    def words(self, unit: str = "") -> str:
        """Say what it is."""
        return f"{self._one.words(unit)}, or a list of them"

    def read(self, entry: Entry, address: Address, places: Places) -> Tuple[str, ...]:
        """Return the states."""
        if isinstance(entry, Items):
            return tuple(self._many.read(entry, address, places))
        return (self._one.read(entry, address, places),)


class PatternEntry(Kind):
    """What is looked for: exactly one of state, rule, command, failure, component with code."""

    _group = Group(
        "what is looked for",
        (
            Key("state", _States(), "the engine enters it, or is in it", "", None),
            Key("step", Choice(tuple(step.value for step in Step if step.value)), "within the state", "", None),
            Key("rule", Choice(RULES), "it fires", "", None),
            Key("command", Choice(COMMANDS), "it is sent", "", None),
            Key("failure", Text("a component or a loss", COMPONENT_NAME), "a decision is about it", "", None),
            Key("component", Text("a component", COMPONENT_NAME), "its code is looked at", "", None),
            Key("code", Choice(tuple(str(int(code)) for code in Code)), "at least so high", "", None),
        ),
    )
    _heads = ("state", "rule", "command", "failure", "component")

    def words(self, unit: str = "") -> str:
        """Say what it is."""
        return self._group.words(unit)

    def read(self, entry: Entry, address: Address, places: Places) -> Pattern:
        """Return the pattern."""
        values = self._group.read(_quoted(entry), address, places)
        given = [name for name in self._heads if values[name] is not None]
        if len(given) != 1:
            wrong = f"has {' and '.join(given)}" if given else "is empty"
            refuse(entry, address, wrong, f"must have one of {', '.join(self._heads)}")
        for name, head in (("step", "state"), ("code", "component")):
            if values[name] is not None and given != [head]:
                refuse(entry, (*address, name), "is given", f"goes with {head} only")
        if given == ["component"] and values["code"] is None:
            refuse(entry, (*address, "code"), "is missing", "must be given with component: 1, 2, 4, 8 or 16")
        return Pattern(
            states=values["state"] or (),
            step=values["step"] or "",
            rule=values["rule"] or "",
            command=values["command"] or "",
            failure=values["failure"] or "",
            component=values["component"] or "",
            code=int(values["code"] or 0),
        )


def _quoted(entry: Entry) -> Entry:
    """Let `code: 8` be written without quotes."""
    if not isinstance(entry, Table) or "code" not in entry.entries:
        return entry
    place, code = entry.entries["code"]
    if not isinstance(code, Scalar) or code.tag != "int":
        return entry
    return Table(entry.place, {**entry.entries, "code": (place, Scalar(code.place, code.text, "str"))})


class InstantEntry(Kind):
    """Seconds from the start, or the name of an anchor."""

    _name = Text("the name of an anchor", COMPONENT_NAME)

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what it is."""
        return "seconds from the start, or the name of an anchor"

    def read(self, entry: Entry, address: Address, places: Places) -> Instant:
        """Return nanoseconds or the name."""
        if isinstance(entry, Scalar) and entry.tag == "str":
            return self._name.read(entry, address, places)
        return round(_TIME.read(entry, address, places) * _S)


class ExpectationEntry(Kind):
    """One expectation; which keys it may have depends on its kind."""

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what it is."""
        return "an expectation: its kind, what it looks for, and the window"

    def read(self, entry: Entry, address: Address, places: Places) -> Expectation:
        """Return the expectation."""
        if not isinstance(entry, Table):
            refuse(entry, address, described(entry), "must be " + self.words())
        kind = self._kind(entry, address, places)
        values = Group(f"expectation {kind.name}", _keys(kind)).read(entry, address, places)
        patterns: List[Tuple[str, Pattern]] = []
        for key in kind.patterns:
            for pattern in values[key] if kind.many else (values[key],):
                if kind.lasting and not pattern.lasts:
                    refuse(entry, (*address, key), f"is {pattern}", "must be what lasts: a state or a component's code")
                patterns.append((key, pattern))
        numbers = tuple((key, float(values[key])) for key in kind.numbers if values[key] is not None)
        if kind.needs and not any(key in kind.needs for key, _ in numbers):
            refuse(entry, address, "has no limit", f"must have {' or '.join(kind.needs)}")
        if len(kind.needs) > 1 and len(numbers) > 1 and numbers[0][1] > numbers[1][1]:
            (least, low), (most, high) = numbers
            refuse(entry, address, f"has {least} {low:g} and {most} {high:g}", "no run can hold it: must leave room")
        end: Optional[Instant] = values["to"]
        return Expectation(kind, tuple(patterns), numbers, values["from"], end, str(entry.place))

    @staticmethod
    def _kind(entry: Table, address: Address, places: Places) -> ExpectationKind:
        choice = Choice(tuple(EXPECTATIONS))
        here = (*address, "expect")
        if "expect" not in entry.entries:
            refuse(entry, here, "is missing", "must be given: " + choice.words())
        return EXPECTATIONS[choice.read(entry.entries["expect"][1], here, places)]


def _keys(kind: ExpectationKind) -> Tuple[Key, ...]:
    pattern: Kind = PatternEntry()
    if kind.many:
        pattern = ListOf(pattern, "patterns", at_least=2)
    keys: List[Key] = [Key("expect", Choice((kind.name,)), kind.words)]
    keys += [Key(name, pattern, "what is looked for") for name in kind.patterns]
    keys += [
        Key(name, _NUMBERS[name], "limit", "", REQUIRED if kind.needs == (name,) else None) for name in kind.numbers
    ]
    keys += [
        Key("from", InstantEntry(), "where the window begins", "", 0.0),
        Key("to", InstantEntry(), "where it ends; left out: at the end of the run", "", None),
    ]
    return tuple(keys)


def instants_of(expectation: Expectation) -> Tuple[str, ...]:
    """Return the names of the anchors that an expectation needs."""
    ends: Tuple[Any, ...] = (expectation.begin, expectation.end)
    return tuple(end for end in ends if isinstance(end, str))
