"""What a scenario file of the tester says: one test, or one for each combination of its matrix."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Mapping, Optional, Tuple

from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.simulation import Fault, Request

from ..expect.model import Expectation
from ..expect.pattern import Pattern

__all__ = ["Anchor", "Bag", "Case", "Need", "SourceKind"]

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
