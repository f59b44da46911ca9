"""Reads scenario files of the tester, as strictly as every other file of the package.

They say what scenarios of the simulated world say (`simulation.scenario_file`: description, faults, requests), in the
same words, and beyond that where the events come from and what must come of them:

```yaml
version: 1
description: The laser range finder dies in flight: hold, then land.
tags: [hold, lrf]
requirements: [DESIGN-4-high]
anchors:
  fails: {fault: 1}
faults:
  - {component: lrf, fault: killed, after: {event: airborne, delay_s: 10.0}, restart: fails}
expectations:
  - {expect: response, when: {component: lrf, code: 8}, then: {command: HOLD}, within_s: 0.4}
  - {expect: never, of: {rule: mission_complete}, from: fails}
```
"""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Tuple

from amaze_autonomy.config.document import Entry, Items, Scalar, Table
from amaze_autonomy.config.kinds import Address, Choice, Kind, ListOf, Number, Places, Text, Whole, described, refuse
from amaze_autonomy.config.schema import Group, Key, Named
from amaze_autonomy.simulation.scenario_file import FAULT, REQUEST

from ...config.schemas.sensors import COMPONENT_NAME, TOPIC_NAME
from ...journal.trace import READINGS
from ...replay.faults.kinds import RECORDED_FAULT
from ..expect.schema import ExpectationEntry, PatternEntry
from .model import Anchor, SourceKind

__all__ = ["CONFIGURATION", "OVERRIDE", "VERSION", "schema_of"]

VERSION = 1
OVERRIDE = r"(autonomy|autopilot|sensors|missions|recording)(\.[A-Za-z0-9_/-]+)+"
_S = 1_000_000_000
_TIME = Number(minimum=0.0, maximum=86_400.0)
_FILE = Text("a path, from the folder of this file", longest=500)
_WORD = r"[A-Za-z0-9][A-Za-z0-9_./-]*"


class _Plain(Kind):
    """A single value of any type, as plain Python."""

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what it is."""
        return "a single value"

    def read(self, entry: Entry, address: Address, places: Places) -> Any:
        """Return the value."""
        if not isinstance(entry, (Scalar, Items)):
            refuse(entry, address, described(entry), "must be a single value, or a list of them")
        if isinstance(entry, Items):
            return [self.read(item, address, places) for item in entry.items]
        if entry.tag == "bool":
            return entry.text.lower() in ("yes", "true", "on")
        if entry.tag in ("int", "float"):
            return (
                Number().read(entry, address, places)
                if entry.tag == "float"
                else Whole(-(10**9), 10**9).read(entry, address, places)
            )
        return None if entry.tag == "null" else entry.text


class _Raw(Kind):
    """A list of entries that stay as they are, for the matrix."""

    def words(self, unit: str = "") -> str:  # noqa: ARG002
        """Say what it is."""
        return "a list of at least two values"

    def read(self, entry: Entry, address: Address, places: Places) -> Tuple[Entry, ...]:  # noqa: ARG002
        """Return the entries."""
        if not isinstance(entry, Items) or len(entry.items) < 2:  # noqa: PLR2004
            self._refuse(entry, address)
        return entry.items


class _AnchorEntry(Kind):
    """A named instant."""

    _group = Group(
        "an instant",
        (
            Key("at_s", _TIME, "seconds from the start", "", None),
            Key("happens", PatternEntry(), "what happens", "", None),
            Key("fault", Whole(1, 1000), "number of the fault that begins, from 1", "", None),
            Key("value", Choice(READINGS), "value that crosses a level", "", None),
            Key("above", Number(), "level that it rises above", "", None),
            Key("below", Number(), "level that it falls below", "", None),
            Key("occurrence", Whole(1, 1000), "which time", "", 1),
            Key("delay_s", _TIME, "how long after that", "", 0.0),
        ),
    )
    _heads = ("at_s", "happens", "fault", "value")

    def words(self, unit: str = "") -> str:
        """Say what it is."""
        return self._group.words(unit)

    def read(self, entry: Entry, address: Address, places: Places) -> Anchor:
        """Return the anchor."""
        values = self._group.read(entry, address, places)
        given = [name for name in self._heads if values[name] is not None]
        if len(given) != 1:
            refuse(
                entry, address, f"has {' and '.join(given) or 'nothing'}", f"must have one of {', '.join(self._heads)}"
            )
        levels = [name for name in ("above", "below") if values[name] is not None]
        if len(levels) != (1 if given == ["value"] else 0):
            refuse(
                entry, address, f"has {' and '.join(levels) or 'no level'}", "must have above or below with value only"
            )
        return Anchor(
            name=address[-1],
            at_ns=None if values["at_s"] is None else round(values["at_s"] * _S),
            what=values["happens"],
            value=values["value"] or "",
            above=values["above"],
            below=values["below"],
            fault=values["fault"] or 0,
            occurrence=values["occurrence"],
            delay_ns=round(values["delay_s"] * _S),
        )


CONFIGURATION = Group(
    "the configuration to decide by",
    (
        Key("folder", _FILE, "with its files; left out: the one that ships with the package", "", None),
        Key("set", Named("keys to replace", OVERRIDE, _Plain()), "replaced values", "", None),
    ),
)
_NEED = Group(
    "what a recording must offer",
    (
        Key("topic", Text("the name of a topic", TOPIC_NAME), "which"),
        Key("rate_hz", Number(minimum=0.0, maximum=1e6), "at least so often", "", 0.0),
        Key("gap_s", Number(above=0.0, maximum=86_400.0), "no silence longer than this", "", None),
    ),
)
_BAG = Group(
    "a bag",
    (
        Key("path", _FILE, "where it lies"),
        Key("sha256", Text("64 hexadecimal digits", r"[0-9a-f]{64}", numbers=True), "of its content", "", None),
    ),
)
_HEAD = (
    Key("version", Choice((str(VERSION),)), "of this format"),
    Key("description", Text("one line", longest=200), "what happens"),
    Key("tags", ListOf(Text("a word", _WORD), "words", unique=True), "to choose by", "", []),
    Key("requirements", ListOf(Text("an id", _WORD), "ids", unique=True), "what it proves", "", []),
    Key("configuration", CONFIGURATION, "to decide by", "", None),
)
_TAIL = (
    Key("anchors", Named("instants", COMPONENT_NAME, _AnchorEntry()), "named instants", "", None),
    Key("expectations", ListOf(ExpectationEntry(), "expectations"), "what must come of it", "", []),
    Key("matrix", Named("addresses to vary", r".+", _Raw()), "a test for each combination", "", None),
)
_MISSIONS = Key(
    "missions", ListOf(Text("the id of a mission", _WORD, numbers=True), "ids", 1), "flown in turn", "", None
)
_SEED = Key("seed", Whole(0, 2**31), "of noise and latencies", "", 0)
_REQUESTS = Key("requests", ListOf(REQUEST, "requests"), "what the user asks", "", [])
_SIMULATION = (
    _MISSIONS,
    _SEED,
    Key("limit_s", Number(above=0.0, maximum=86_400.0), "of simulated time", "", 7200.0),
    Key("faults", ListOf(FAULT, "faults"), "what goes wrong", "", []),
    _REQUESTS,
)
_BAGS = (
    Key("bags", ListOf(_BAG, "bags", 1), "of one flight"),
    Key("from_s", _TIME, "where the test begins, from the start of the bags", "", 0.0),
    Key("to_s", _TIME, "where it ends", "", None),
    Key("map", Text("a topic map: its name, or a path from the folder of this file", longest=500), "topics", "", None),
    _MISSIONS,
    _SEED,
    Key("needs", ListOf(_NEED, "needs"), "what the recording must offer", "", []),
    Key("faults", ListOf(RECORDED_FAULT, "faults"), "what goes wrong", "", []),
    _REQUESTS,
)
_JOURNAL = (Key("journal", _FILE, "of a flight, to be decided again"),)
_EVENTS = (
    Key("events", ListOf(Text("an event, as a line of a journal", longest=20_000), "events", 1), "to be decided"),
)
_SOURCES: Mapping[str, Tuple[Key, ...]] = {
    SourceKind.BAGS: _BAGS,
    SourceKind.JOURNAL: _JOURNAL,
    SourceKind.EVENTS: _EVENTS,
    SourceKind.SIMULATION: _SIMULATION,
}


def schema_of(tree: Entry) -> Group:
    """Return the keys that a scenario may have: they depend on where its events come from."""
    entries: Dict[str, Any] = dict(tree.entries) if isinstance(tree, Table) else {}
    given: List[str] = [kind for kind in (SourceKind.BAGS, SourceKind.JOURNAL, SourceKind.EVENTS) if kind in entries]
    if len(given) > 1:
        refuse(tree, (), f"has both {given[0]} and {given[1]}", "must have one of them, or neither: a simulation")
    return Group("a scenario", (*_HEAD, *_SOURCES[given[0] if given else SourceKind.SIMULATION], *_TAIL))
