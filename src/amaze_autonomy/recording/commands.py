"""What the machines of the recorder ask of their shell, and how they answer a request."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Union

__all__ = [
    "Answer",
    "Ask",
    "Collect",
    "Command",
    "CopyJournal",
    "MeasureClock",
    "Recover",
    "Signal",
    "StartChild",
    "Transfer",
]


class Answer(NamedTuple):
    """The answer to a request: it was understood, or why not. That it is done is told by the status."""

    accepted: bool
    message: str = ""


@dataclass(frozen=True)
class StartChild:
    """Start a recorder for a group into the file with this number."""

    group: str
    number: int


@dataclass(frozen=True)
class Signal:
    """Send a signal to the recorder of a group: INT, TERM or KILL."""

    group: str
    name: str


@dataclass(frozen=True)
class Recover:
    """Make whole what was not closed, and list the parts of the session."""


@dataclass(frozen=True)
class Ask:
    """Ask a platform's recorder to `start`, `stop` or `remove` its part."""

    platform: str
    verb: str


@dataclass(frozen=True)
class MeasureClock:
    """Measure the offset of a platform's clock, at the `start` or at the `stop` of the recording."""

    platform: str
    when: str


@dataclass(frozen=True)
class Transfer:
    """Fetch a platform's part from where it says that it lies."""

    platform: str
    location: str


@dataclass(frozen=True)
class Collect:
    """Merge and verify all parts, in a process of its own."""


@dataclass(frozen=True)
class CopyJournal:
    """Copy the engine's journal and configuration into the session."""


Command = Union[StartChild, Signal, Recover, Ask, MeasureClock, Transfer, Collect, CopyJournal]
