"""The seam between the console and the engine: what comes in, what goes out. `ros_link` is the real one.

A link posts what happens into a mailbox, from any thread; the console's one thread empties it.
"""

from __future__ import annotations

import abc
import queue
from collections import deque
from dataclasses import dataclass
from typing import Deque, List, Optional, Tuple, Union

from .model import Collecting, MissionRow, Note, Request, Snapshot, Verdict
from .terminal import Wake

_LATELY = 20  # messages: a clock that was set is believed after so many


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
    under way than the others lately is that much older than they were. The clock of the stamps may be apart from ours,
    and may be set: only what the stamps of several messages differ by is used. So the first one counts as new.
    """

    def __init__(self) -> None:
        self._took_s: Deque[float] = deque(maxlen=_LATELY)
        self._stamp_s = self._sent_s = 0.0

    def age_s(self, stamp_s: float, now_s: float) -> float:
        """Return how old a message is that comes now.

        Args:
            stamp_s: of it, on the clock of whoever sent it; 0: it has none.
            now_s: on a clock of ours that is never set.
        """
        if stamp_s <= 0.0:
            return 0.0
        if stamp_s != self._stamp_s:
            if stamp_s < self._stamp_s:
                self._took_s.clear()  # that clock was set
            self._took_s.append(now_s - stamp_s)
            self._stamp_s, self._sent_s = stamp_s, stamp_s + min(self._took_s)
        return max(0.0, now_s - self._sent_s)


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
