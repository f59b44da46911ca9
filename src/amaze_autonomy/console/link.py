"""The seam between the console and the engine: what comes in, what goes out. `ros_link` is the real one.

A link posts what happens into a mailbox, from any thread; the console's one thread empties it.
"""

from __future__ import annotations

import abc
import queue
from dataclasses import dataclass
from typing import List, Optional, Tuple, Union

from .model import Collecting, MissionRow, Note, Request, Snapshot, Verdict
from .terminal import Wake


@dataclass(frozen=True)
class StateCame:
    """The engine's state."""

    snapshot: Snapshot


@dataclass(frozen=True)
class CollectingCame:
    """What the recorder says of its phase."""

    collecting: Collecting


@dataclass(frozen=True)
class MessagesCame:
    """The engine's last messages, of one run of it."""

    run: str
    notes: Tuple[Note, ...]


@dataclass(frozen=True)
class MissionsCame:
    """The list of missions, as the answer to a request."""

    request_id: int
    missions: Tuple[MissionRow, ...]


@dataclass(frozen=True)
class AnswerCame:
    """The answer to a request, or why there is none."""

    request_id: int
    verdict: Verdict
    message: str = ""


@dataclass(frozen=True)
class MissionWanted:
    """Missions were named by a parameter."""

    missions: Tuple[str, ...]


@dataclass(frozen=True)
class LinkSays:
    """What the connection waits for, in words; empty when nothing; `engine` is the name space it looks in."""

    text: str
    engine: Optional[str] = None


@dataclass(frozen=True)
class LinkClosed:
    """The connection was closed from outside, or `failed`; the console ends."""

    reason: str
    failed: bool = False


Happening = Union[
    StateCame, CollectingCame, MessagesCame, MissionsCame, AnswerCame, MissionWanted, LinkSays, LinkClosed
]


class Mailbox:
    """Where happenings wait for the console's thread."""

    def __init__(self, wake: Wake) -> None:
        self._queue: queue.SimpleQueue[Happening] = queue.SimpleQueue()
        self._wake = wake

    def post(self, happening: Happening) -> None:
        """Add a happening; from any thread."""
        self._queue.put(happening)
        self._wake.set()

    def empty(self) -> List[Happening]:
        """Take out all that has happened, oldest first."""
        happenings: List[Happening] = []
        while not self._queue.empty():  # one thread alone takes out
            happenings.append(self._queue.get_nowait())
        return happenings


class Link(abc.ABC):
    """What the console needs of a connection to the engine."""

    @abc.abstractmethod
    def start(self) -> None:
        """Connect; return at once and go on in the background."""

    @abc.abstractmethod
    def send(self, request: Request) -> None:
        """Send a request; return at once. Its answer is posted."""

    @abc.abstractmethod
    def close(self) -> None:
        """Disconnect."""
