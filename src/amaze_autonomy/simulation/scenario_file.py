"""Reads scenarios from YAML, as strictly as every other file of the package.

```yaml
description: The laser range finder dies in flight and comes back when it is restarted.
faults:
  - component: lrf                              # or `process:`, `service:`, or none of them
    fault: silent                               # a row of `scenario.KINDS`
    after: {event: airborne, delay_s: 3.0}      # or `at_s:`; neither: from the start
    for_s: 5.0                                  # left out: until a restart ends it, or for ever
    restart: succeeds                           # parameters of the kind
requests:
  - request: retry                              # what a user asks, by the names of the engine's services
    after: {state: OUTREACH, delay_s: 2.0}
```
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple, Union

from amaze_autonomy.config.document import Entry, Scalar, Table, parse, read
from amaze_autonomy.config.kinds import Address, Choice, Kind, ListOf, Number, Places, Text, Whole, described, refuse
from amaze_autonomy.config.schema import Group, Key
from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.engine.state import State
from amaze_autonomy.interface import PEERS, SERVICES

from .scenario import EVENTS, KINDS, Fault, FaultKind, Parameter, Request, Scenario, Subject, Trigger

_S = 1_000_000_000
_TIME = Number(minimum=0.0, maximum=86_400.0)
_LASTING = Number(above=0.0, maximum=86_400.0)
_SELECT = "select"
_MISSION = Text("the id of a mission", r"[A-Za-z0-9_.-]+", numbers=True)
SUBJECTS: Mapping[str, Tuple[Kind, str]] = {
    Subject.COMPONENT: (Text("the name of a component of sensors.yaml", r"[A-Za-z][A-Za-z0-9_]*"), "what fails"),
    Subject.PROCESS: (Choice(PEERS), "which node fails"),
    Subject.SERVICE: (Choice(tuple(SERVICES)), "which service fails"),
}


class After(Kind):
    """An event or a state, and how long after it."""

    _group = Group(
        "an event or a state",
        (
            Key("event", Choice(tuple(EVENTS)), "what has to happen", "", None),
            Key("state", Choice(tuple(state.value for state in State)), "state the engine has to enter", "", None),
            Key("number", Whole(1, 100_000), "of the waypoint; left out: any", "", None),
            Key("occurrence", Whole(1, 1000), "which time it happens", "", 1),
            Key("delay_s", _TIME, "how long after that", "", 0.0),
        ),
    )

    def words(self, unit: str = "") -> str:
        """Say what it is."""
        return self._group.words(unit)

    def read(self, entry: Entry, address: Address, places: Places) -> Trigger:
        """Return the trigger."""
        values = self._group.read(entry, address, places)
        if (values["event"] is None) == (values["state"] is None):
            wrong = "has neither event nor state" if values["event"] is None else "has both event and state"
            refuse(entry, address, wrong, "must have one of them")
        if values["number"] is not None and values["event"] != "waypoint":
            refuse(entry, (*address, "number"), "is given", "must be given with the event waypoint only")
        return Trigger(
            event=values["event"] or "",
            state=values["state"] or "",
            number=values["number"] or 0,
            occurrence=values["occurrence"],
            delay_ns=round(values["delay_s"] * _S),
        )


WHEN = (
    Key("at_s", _TIME, "seconds since the start of the world", "", None),
    Key("after", After(), "or after something", "", None),
)


def trigger_of(values: Mapping[str, Any], entry: Entry, address: Address) -> Trigger:
    """Return the trigger of an entry that has the keys WHEN."""
    if values["at_s"] is not None and values["after"] is not None:
        refuse(entry, address, "has both at_s and after", "must have one of them, or neither: from the start")
    after: Optional[Trigger] = values["after"]
    return after if after is not None else Trigger(at_ns=round((values["at_s"] or 0.0) * _S))


@dataclass(frozen=True)
class FaultEntry(Kind):
    """One fault; which keys it may have depends on its subject and its kind.

    Args:
        kinds: rows that there are, by subject and name.
        subjects: what a target of each subject may be, and what it is in words.
    """

    kinds: Mapping[Tuple[str, str], FaultKind]
    subjects: Mapping[str, Tuple[Kind, str]]

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what it is."""
        return "a fault: its subject (component, process, service, or none), its kind, and when"

    def read(self, entry: Entry, address: Address, places: Places) -> Fault:
        """Return the fault."""
        if not isinstance(entry, Table):
            refuse(entry, address, described(entry), "must be " + self.words())
        subject = self._subject(entry, address)
        kind = self._kind(entry, address, subject, places)
        keys: List[Key] = []
        if subject:
            target, words = self.subjects[subject]
            keys.append(Key(subject, Choice(kind.targets) if kind.targets else target, words))
        keys += [Key("fault", Choice((kind.name,)), kind.words), *WHEN]
        keys.append(Key("for_s", _LASTING, "how long it lasts", "", None))
        keys += [Key(each.name, _kind_of(each), each.words, "", _default(each)) for each in kind.parameters]
        values = Group(f"fault {kind.name}", tuple(keys)).read(entry, address, places)
        return Fault(
            kind=kind,
            target=values[subject] if subject else "",
            trigger=trigger_of(values, entry, address),
            for_ns=None if values["for_s"] is None else round(values["for_s"] * _S),
            parameters=tuple(
                (each.name, values[each.name]) for each in kind.parameters if values[each.name] is not None
            ),
            where=str(entry.place),
        )

    def _subject(self, entry: Table, address: Address) -> str:
        given = [subject for subject in self.subjects if subject in entry.entries]
        if len(given) > 1:
            refuse(entry, address, f"has both {given[0]} and {given[1]}", "must be about one thing")
        return given[0] if given else Subject.WORLD

    def _kind(self, entry: Table, address: Address, subject: str, places: Places) -> FaultKind:
        names = tuple(kind.name for kind in self.kinds.values() if kind.subject == subject)
        here = (*address, "fault")
        if "fault" not in entry.entries:
            refuse(entry, here, "is missing", "must be given: " + Choice(names).words())
        value = entry.entries["fault"][1]
        if isinstance(value, Scalar) and value.text not in names:
            others = sorted({kind.subject for kind in self.kinds.values() if kind.name == value.text})
            if others:
                about = others[0] or "no component, process or service"
                refuse(value, here, f"is {value.text}", f"must be given with {about}")
        return self.kinds[subject, Choice(names).read(value, here, places)]


def _kind_of(parameter: Parameter) -> Kind:
    if parameter.is_number:
        return Number(minimum=parameter.low, maximum=parameter.high)
    if parameter.choices:
        return Choice(parameter.choices)
    return Text(parameter.words, parameter.pattern) if parameter.pattern else Text("a name", r"[A-Za-z0-9_]*")


def _default(parameter: Parameter) -> Any:
    """Return the default as the schema wants it: a parameter that must be given has none."""
    if parameter.default is None:
        return Key("", Number(), "").default
    return parameter.default if parameter.default != "" else None


class RequestEntry(Kind):
    """What a user asks, and when."""

    _group = Group(
        "a request",
        (
            Key("request", Choice((*(each.value for each in UserCommand), _SELECT)), "what the user asks"),
            Key(
                "missions", ListOf(_MISSION, "ids of missions", 1), "which, with select; in virtual time only", "", None
            ),
            *WHEN,
        ),
    )

    def words(self, unit: str = "") -> str:
        """Say what it is."""
        return self._group.words(unit)

    def read(self, entry: Entry, address: Address, places: Places) -> Request:
        """Return the request."""
        values = self._group.read(entry, address, places)
        selects = values["request"] == _SELECT
        if selects != (values["missions"] is not None):
            refuse(entry, (*address, "missions"), "is missing" if selects else "is given", f"goes with {_SELECT} only")
        command = None if selects else UserCommand(values["request"])
        return Request(command, trigger_of(values, entry, address), tuple(values["missions"] or ()))


FAULT = FaultEntry(KINDS, SUBJECTS)
REQUEST = RequestEntry()

SCENARIO = Group(
    "a scenario",
    (
        Key("description", Text("one line", longest=200), "what happens", "shown when it runs"),
        Key("faults", ListOf(FAULT, "faults"), "what goes wrong", "", []),
        Key("requests", ListOf(REQUEST, "requests"), "what the user asks", "", []),
    ),
)


def load_scenario(path: Union[str, Path]) -> Scenario:
    """Read a scenario.

    Raises:
        ConfigError: the first mistake in it, with file and line.
    """
    return _scenario(read(Path(path)))


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Read a scenario from a text; `source` is its name in errors.

    Raises:
        ConfigError: the first mistake in it, with line.
    """
    return _scenario(parse(text, source))


def _scenario(tree: Entry) -> Scenario:
    values: Dict[str, Any] = SCENARIO.read(tree, (), {})
    return Scenario(values["description"], tuple(values["faults"]), tuple(values["requests"]))
