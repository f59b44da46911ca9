"""The seam between the console and the engine: what comes in, what goes out. `ros_link` is the real one.

A link posts what happens into a mailbox, from any thread; the console's one thread empties it.
"""

from __future__ import annotations

import abc
import queue
from dataclasses import dataclass
from math import inf
from typing import List, Optional, Tuple, Union

from .model import STALE_AFTER_S, Collecting, MissionRow, Note, Request, Snapshot, Verdict
from .terminal import Wake

_DRIFT = 0.0005  # by which two clocks may go apart
_ENOUGH = 20  # messages after a gap: a clock that was set back in it is believed after so many


@dataclass(frozen=True)
class StateCame:
    """The engine's state; `age_s` when it came."""

    snapshot: Snapshot
    age_s: float = 0.0


@dataclass(frozen=True)
class CollectingCame:
    """What the recorder says of its phase; `age_s` when it came."""

    collecting: Collecting
    age_s: float = 0.0


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


class Arrivals:
    """How old the messages of one topic are when they come, by their stamps.

    A message that comes once more (a latched one, after a connection broke) is as old as it is; one that was longer
    under way than the fastest is that much older. The clock of the stamps may be apart from ours, and may be set: only
    what the stamps of several messages differ by is used. So the first one counts as new. A link on which all is late
    from now on makes nothing new: the fastest is forgotten only where a stamp goes back, or where enough messages have
    come since a gap between two, in which that clock may have been set back.
    """

    def __init__(self) -> None:
        self._stamp_s = self._sent_s = self._came_s = 0.0
        self._way_s = inf
        self._since_gap_s: Optional[List[float]] = None

    def age_s(self, stamp_s: float, now_s: float) -> float:
        """Return how old a message is that comes now.

        Args:
            stamp_s: of it, on the clock of whoever sent it; 0: it has none.
            now_s: on a clock of ours that is never set.
        """
        if stamp_s <= 0.0:
            return 0.0
        if stamp_s != self._stamp_s:
            self._measure_the_way(stamp_s, now_s)
            self._stamp_s, self._came_s, self._sent_s = stamp_s, now_s, stamp_s + self._way_s
        return max(0.0, now_s - self._sent_s)

    def _measure_the_way(self, stamp_s: float, now_s: float) -> None:
        """Learn how long the fastest message is under way, by both clocks."""
        way_s = now_s - stamp_s
        if stamp_s < self._stamp_s:
            self._way_s = inf
        self._way_s = min(way_s, self._way_s + (now_s - self._came_s) * _DRIFT)
        if stamp_s - self._stamp_s > STALE_AFTER_S:
            self._since_gap_s = []
        if self._since_gap_s is None:
            return
        self._since_gap_s.append(way_s)
        if len(self._since_gap_s) == _ENOUGH:
            self._way_s, self._since_gap_s = min(self._since_gap_s), None


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
