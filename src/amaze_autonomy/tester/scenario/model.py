"""What a scenario file of the tester says: one test, or one for each combination of its matrix; and how it is read.

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

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple

from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.config.document import Entry, Items, Scalar, Table
from amaze_autonomy.config.kinds import Address, Choice, Kind, ListOf, Number, Places, Text, Whole, described, refuse
from amaze_autonomy.config.schema import Group, Key, Named
from amaze_autonomy.engine.events import CheckName
from amaze_autonomy.simulation import Fault, Request
from amaze_autonomy.simulation.scenario_file import FAULT, REQUEST

from ...config.schemas.sensors import COMPONENT_NAME, TOPIC_NAME
from ...journal.trace import READINGS
from ...replay.faults.kinds import RECORDED_FAULT
from ..expect.model import Expectation, ExpectationEntry, Pattern, PatternEntry

_S = 1_000_000_000


class SourceKind:
    """Where the events of a test come from."""

    BAGS = "bags"
    JOURNAL = "journal"
    EVENTS = "events"
    SIMULATION = "simulation"


@dataclass(frozen=True)
class Bag:
    """One bag of a flight.

    Args:
        path: relative to the scenario file; of a file, or of the folder of a ROS 2 bag.
        sha256: of its content (`bags.other_formats.content_files`, one after the other); empty: not checked.
    """

    path: Path
    sha256: str = ""


@dataclass(frozen=True)
class Need:
    """What a recording must offer, else the test says nothing about the rules.

    Args:
        topic: of it.
        rate_hz: over the whole range, at least; 0: any.
        gap_ns: the longest silence that is allowed; None: any.
    """

    topic: str
    rate_hz: float = 0.0
    gap_ns: Optional[int] = None


@dataclass(frozen=True)
class Anchor:
    """A named instant.

    Args:
        name: of it.
        at_ns: from the start; None: it is where something happens.
        what: that happens; None: a value crosses a level.
        value: field of the autopilot's status, e.g. "height_m".
        above: level that the value rises above.
        below: level that the value falls below.
        fault: number of a fault, from 1, which begins; 0: none.
        occurrence: which time, from 1.
        delay_ns: after that.
    """

    name: str
    at_ns: Optional[int] = None
    what: Optional[Pattern] = None
    value: str = ""
    above: Optional[float] = None
    below: Optional[float] = None
    fault: int = 0
    occurrence: int = 1
    delay_ns: int = 0


@dataclass(frozen=True)
class Case:
    """One test: a scenario file with one combination of its matrix.

    Args:
        path: of the file.
        name: of the file, without its ending.
        variant: its combination, e.g. "severity=low,seed=2"; empty: the file has no matrix.
        description: one line.
        bags: of one flight; empty: a journal or a simulation.
        journal: a recorded one; None: bags or a simulation.
        events: of the engine, as lines of a journal; empty: one of the others.
        checks: names of the checks that there were when the events were written; empty: all there are.
        from_ns: where the test begins in the bags, from their start.
        to_ns: where it ends; None: at the end.
        topic_map: name or file; empty: the one named as the first bag.
        missions: ids, flown one after the other; empty: the first of the configuration.
        configuration: folder; None: the one that ships with the package.
        overrides: of the configuration.
        seed: of the simulated world, and of the faults on recorded data.
        limit_ns: of simulated time.
        needs: of the recording.
        anchors: named instants.
        faults: what goes wrong.
        requests: what the user asks.
        expectations: what must come of it.
        tags: to choose by.
        requirements: ids of what it proves.
        memory: bytes that a chunk of a bag may take, decompressed; of the run, not of the file.
    """

    path: Path
    name: str
    variant: str
    description: str
    bags: Tuple[Bag, ...] = ()
    journal: Optional[Path] = None
    events: Tuple[str, ...] = ()
    checks: Tuple[str, ...] = ()
    from_ns: int = 0
    to_ns: Optional[int] = None
    topic_map: str = ""
    missions: Tuple[str, ...] = ()
    configuration: Optional[Path] = None
    overrides: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0
    limit_ns: int = 7200 * _S
    needs: Tuple[Need, ...] = ()
    anchors: Tuple[Anchor, ...] = ()
    faults: Tuple[Fault, ...] = ()
    requests: Tuple[Request, ...] = ()
    expectations: Tuple[Expectation, ...] = ()
    tags: Tuple[str, ...] = ()
    requirements: Tuple[str, ...] = ()
    memory: int = MEMORY

    @property
    def source(self) -> str:
        """Where its events come from."""
        if self.bags:
            return SourceKind.BAGS
        if self.events:
            return SourceKind.EVENTS
        return SourceKind.JOURNAL if self.journal is not None else SourceKind.SIMULATION

    @property
    def id(self) -> str:
        """Its name, unique in a folder: "lrf" or "lrf[severity=low]"."""
        return f"{self.name}[{self.variant}]" if self.variant else self.name


# --- how it is read ---------------------------------------------------------------------------------------------------


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
_IDS = ListOf(Text("the id of a mission", _WORD, numbers=True), "ids", 1)
_MISSIONS = Key("missions", _IDS, "flown in turn", "", None)
_MISSION = Key("missions", _IDS, "one; left out: that of the journal in the bags, else the first configured", "", None)
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
    _MISSION,
    _SEED,
    Key("needs", ListOf(_NEED, "needs"), "what the recording must offer", "", []),
    Key("faults", ListOf(RECORDED_FAULT, "faults"), "what goes wrong", "", []),
    _REQUESTS,
)
_JOURNAL = (Key("journal", _FILE, "of a flight, to be decided again"),)
_CHECK = Choice(tuple(check.value for check in CheckName))
_EVENTS = (
    Key("events", ListOf(Text("an event, as a line of a journal", longest=20_000), "events", 1), "to be decided"),
    Key("checks", ListOf(_CHECK, "checks", 1), "those that there were when the events were written", "", None),
)
IN_EVERY = (*_HEAD, *_TAIL)
SOURCES: Mapping[str, Tuple[Key, ...]] = {
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
    return Group("a scenario", (*_HEAD, *SOURCES[given[0] if given else SourceKind.SIMULATION], *_TAIL))
