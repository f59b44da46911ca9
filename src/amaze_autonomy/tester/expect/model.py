"""The closed set of expectations, as a table; the patterns that they look for; what came of one; how they are read."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from itertools import repeat
from typing import Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from amaze_autonomy.config.document import Entry, Items, Scalar, Table
from amaze_autonomy.config.kinds import Address, Choice, Kind, ListOf, Number, Places, Text, Whole, described, refuse
from amaze_autonomy.config.schema import REQUIRED, Group, Key
from amaze_autonomy.engine.commands import Decision, MissionAction
from amaze_autonomy.engine.failsafe import FAILSAFE_CONDITIONS, USER_HOLD, Bound
from amaze_autonomy.engine.state import State, Step
from amaze_autonomy.engine.transitions import TRANSITIONS

from ...config.schemas.sensors import COMPONENT_NAME
from ...engine.events import CheckName
from ...engine.rules import Code
from ...journal.trace import Span, Trace

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


_STATUS = "autopilot."
LOSSES = (*(row.name for row in FAILSAFE_CONDITIONS), USER_HOLD)
"""What the engine itself looks at in every run, so that a decision can be about it."""
PILOT = State.PILOT.value
_TO_PILOT = frozenset(row.rule for row in TRANSITIONS if row.target is not None and row.target[0] is State.PILOT)


def unseen(pattern: Pattern, trace: Trace) -> str:
    """Return why what a pattern is about cannot happen in a run; empty: it can.

    A component of which no watchdog said a word never fails, whatever the rules are; nor does what a loss, or a pilot
    who takes over, looks like come where nothing tells it.
    """
    if pattern.states == (PILOT,) or pattern.rule in _TO_PILOT:
        there = any(decision.after == PILOT for decision in trace.decisions)
        return f"nothing shows a pilot in this run: {trace.blind[PILOT]}" if PILOT in trace.blind and not there else ""
    name = pattern.component or pattern.failure
    if not name or (pattern.failure and name in map(about, trace.decisions)):
        return ""
    if pattern.failure in LOSSES:
        reason = trace.blind.get(name) or _unknown(name, trace)
        return f"nothing shows {name} in this run: {reason}" if reason else ""
    return "" if name in trace.codes else f"nobody watched {name} in this run"


def _unknown(loss: str, trace: Trace) -> str:
    """Return that every value which a loss compares with a limit is unknown all along; empty: it can be seen."""
    conditions = [when for row in FAILSAFE_CONDITIONS if row.name == loss for when in row.when]
    bounds = [when for when in conditions if isinstance(when, Bound) and when.field.startswith(_STATUS)]
    values = (trace.readings.get(when.field[len(_STATUS) :], ()) for when in bounds)
    if (
        not bounds
        or len(bounds) < len(conditions)
        or any(t_ns >= trace.begin_ns for each in values for t_ns, _ in each)
    ):
        return ""
    return f"{bounds[0].words} is unknown all along"


class Moment(NamedTuple):
    """When something happens, and its place among what happens at one time: one event makes several decisions.

    Args:
        t_ns: of it.
        decision: its number in the run; -1: none made it so, e.g. a code, which comes before what is decided then.
        command: its place among the commands of the decision; -1: the decision itself, which comes before them.
    """

    t_ns: int
    decision: int = -1
    command: int = -1


def moments(pattern: Pattern, trace: Trace) -> Tuple[Moment, ...]:
    """Return when a pattern happens, in order: a condition happens when it begins, by the decision that began it."""
    if pattern.lasts:
        return tuple(Moment(span.begin_ns, number) for span, number in _joined(pattern, trace))
    return tuple(
        Moment(decision.t_ns, number, place)
        for number, decision in enumerate(trace.decisions)
        for place in _places(pattern, decision)
    )


def instants(pattern: Pattern, trace: Trace) -> Tuple[int, ...]:
    """Return the times at which a pattern happens, in order."""
    return tuple(moment.t_ns for moment in moments(pattern, trace))


def spans(pattern: Pattern, trace: Trace) -> Tuple[Span, ...]:
    """Return while when a condition holds; spans in a row are one."""
    return tuple(span for span, _ in _joined(pattern, trace))


def _joined(pattern: Pattern, trace: Trace) -> List[Tuple[Span, int]]:
    """Return the spans of a condition, each with the number of the decision that began it, -1: none did."""
    codes = trace.codes.get(pattern.component, ())
    begun = zip(codes, repeat(-1)) if pattern.component else zip(trace.states, _begun(trace))
    joined: List[Tuple[Span, int]] = []
    held = False
    for span, number in begun:
        holds = int(span.value) >= pattern.code if pattern.component else _in_state(pattern, span.value)
        if holds and held:
            (first, place) = joined[-1]
            joined[-1] = (Span(first.begin_ns, span.end_ns, first.value), place)
        elif holds:
            joined.append((span, number))
        held = holds
    return joined


def _begun(trace: Trace) -> Iterator[int]:
    """Return for each state of a run the number of the decision that entered it; -1: the run began in it."""
    left = 0
    for span in trace.states:
        rest = enumerate(trace.decisions[left:], left)
        number = next((number for number, decision in rest if _enters(decision, span)), -1)
        left = max(left, number + 1)
        yield number


def _in_state(pattern: Pattern, value: str) -> bool:
    state, _, step = value.partition("/")
    return state in pattern.states and pattern.step in ("", step)


def _enters(decision: Decision, span: Span) -> bool:
    return decision.t_ns == span.begin_ns and f"{decision.after}/{decision.step}" == span.value


def _places(pattern: Pattern, decision: Decision) -> List[int]:
    """Return where a pattern happens in a decision: -1 for the decision itself, else the places of its commands."""
    if pattern.command:
        return [place for place, text in enumerate(decision.commands) if _is_command(pattern.command, text)]
    happens = decision.rule == pattern.rule if pattern.rule else about(decision) == pattern.failure
    return [-1] if happens else []


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
        idle: numbers that every run holds.
        lasting: its patterns must be conditions that last: a state or a component's code.
        many: its one pattern is a list.
    """

    name: str
    words: str
    patterns: Tuple[str, ...]
    numbers: Tuple[str, ...] = ()
    needs: Tuple[str, ...] = ()
    idle: Tuple[Tuple[str, float], ...] = ()
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
    ExpectationKind("count", "it happens so often", ("of",), _COUNTS, _COUNTS, (("at_least", 0),)),
    ExpectationKind(
        "duration", "each time it holds for so long", ("of",), _TIMES, _TIMES, (("at_least_s", 0),), lasting=True
    ),
    ExpectationKind(
        "share",
        "it holds for such a part of the window",
        ("of",),
        _SHARES,
        _SHARES,
        (("at_least_fraction", 0), ("at_most_fraction", 1)),
        lasting=True,
    ),
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


# --- how they are read ------------------------------------------------------------------------------------------------


_S = 1_000_000_000
_FAILURES = ("failure_continue", "failure_wait", "failure_land", "failure_pilot", "failure_back", "flown_without")
RULES = (*(row.rule for row in TRANSITIONS), *_FAILURES)
"""Every rule that a decision can name."""
_REQUESTS = (
    *("MissionCommand", "AutopilotLand", "AutopilotDisarm", "StartRecording", "StopRecording"),
    *("LoadMission", "RunCheck"),
)
_PLACES = tuple(dict.fromkeys(row.target for row in TRANSITIONS if row.target is not None))
STEPS: Mapping[str, Tuple[str, ...]] = {
    state.value: tuple(step.value for there, step in _PLACES if there is state and step.value) for state in State
}
"""The steps of each state; a state of one step has none."""
COMMANDS = (*_REQUESTS, *(each.name for each in MissionAction), *(f"RunCheck({each.name})" for each in CheckName))
"""Every command that a pattern can name."""
_CODES = "2, 4, 8 or 16"
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
            refuse(entry, (*address, "code"), "is missing", f"must be given with component: {_CODES}")
        if values["code"] == str(int(Code.NOMINAL)):
            refuse(entry, (*address, "code"), "is the lowest, at or above which every code is", f"must be {_CODES}")
        if values["step"] is not None:
            _check_step(values["state"], values["step"], entry, address)
        return Pattern(
            states=values["state"] or (),
            step=values["step"] or "",
            rule=values["rule"] or "",
            command=values["command"] or "",
            failure=values["failure"] or "",
            component=values["component"] or "",
            code=int(values["code"] or 0),
        )


def _check_step(states: Tuple[str, ...], step: str, entry: Entry, address: Address) -> None:
    """Refuse a step in which a state never is: what cannot happen would always pass as `never`."""
    for state in states:
        if step not in STEPS[state]:
            steps = ", ".join(STEPS[state])
            right = f"must be a step of {state}: {steps}" if steps else f"must be left out: {state} has no steps"
            refuse(entry, (*address, "step"), f"is {step}", right)


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
        _check_can_fail(kind, patterns, numbers, entry, address)
        end: Optional[Instant] = values["to"]
        return Expectation(kind, tuple(patterns), numbers, values["from"], end, str(entry.place))

    @staticmethod
    def _kind(entry: Table, address: Address, places: Places) -> ExpectationKind:
        choice = Choice(tuple(EXPECTATIONS))
        here = (*address, "expect")
        if "expect" not in entry.entries:
            refuse(entry, here, "is missing", "must be given: " + choice.words())
        return EXPECTATIONS[choice.read(entry.entries["expect"][1], here, places)]


def _check_can_fail(
    kind: ExpectationKind,
    patterns: Sequence[Tuple[str, Pattern]],
    numbers: Sequence[Tuple[str, float]],
    entry: Entry,
    address: Address,
) -> None:
    """Refuse what every run holds: nothing would be tested."""
    if numbers and all(number in kind.idle for number in numbers):
        limits = " and ".join(f"{key} {value:g}" for key, value in numbers)
        refuse(entry, address, f"has {limits}", "every run holds it: must be able to fail")
    if not kind.many and len(patterns) > 1 and patterns[0][1] == patterns[1][1]:
        (first, _), (then, pattern) = patterns
        refuse(entry, (*address, then), f"is {pattern}, as {first} is", "every run holds it: must be another")


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
