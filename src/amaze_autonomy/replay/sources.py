"""The messages of all bags in one total order that is ours.

The order is (time, rank of the topic in the map, bag, publisher, position in the file). Bags rank by their beginning
and then by name, not by their place on the command line. Nothing in it depends on the library, on the numbers of the
connections, on the compression or on the order of a hash table.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.bags import Entry, Recording
from amaze_autonomy.bags.errors import MessageError

from .errors import NoMessagesError, TimeJumpError, UnknownTopicError
from .telemetry import recordings_of

__all__ = ["Damage", "Recordings", "Sample", "TopicFigures"]

_S = 1_000_000_000
_JUMP_NS = 3600 * _S
_Rows = Sequence[Optional[Tuple[Any, ...]]]


class Sample(NamedTuple):
    """One message in the total order.

    `rank` is that of its topic, `bag` that of its bag, `row` its number among those of its topic there; the rest is
    `Entry`'s.
    """

    t_ns: int
    rank: int
    bag: int
    publisher: int
    chunk: int
    offset: int
    connection: int
    row: int = 0


@dataclass
class Damage:
    """What of one topic could not be read.

    Args:
        topic: whose messages.
        reason: of the first one.
        count: of messages.
        first_ns: time of the first one.
        last_ns: time of the last one.
    """

    topic: str
    reason: str
    first_ns: int
    last_ns: int
    count: int = 1


@dataclass(frozen=True)
class TopicFigures:
    """What the index says of one topic.

    Args:
        topic: its name.
        messages: how many.
        rate_hz: over all of it; None for fewer than two messages.
        longest_gap_s: between two messages; None for fewer than two.
        longest_gap_at_ns: when that gap began.
    """

    topic: str
    messages: int
    rate_hz: Optional[float] = None
    longest_gap_s: Optional[float] = None
    longest_gap_at_ns: Optional[int] = None


class Recordings:
    """Several bags of one flight, read as one.

    Args:
        paths: of the bags.
        topics: that are wanted; the place of a topic is its rank.
        muted: topics that are read as if they were not there.

    Raises:
        BagError: A bag cannot be read.
        UnknownTopicError: A muted topic is in none of them.
        NoMessagesError: There is no message of any wanted topic.
        TimeJumpError: There is nothing for an hour between two messages.
    """

    def __init__(self, paths: Sequence[Path], topics: Sequence[str], muted: Sequence[str] = ()) -> None:
        self.bags: List[Any] = []  # bags, and telemetry logs with the face of bags
        self.topics, self.muted = tuple(topics), tuple(muted)
        self.damage: Dict[str, Damage] = {}
        self._columns: Dict[Tuple[int, int], _Rows] = {}
        self._read: Dict[int, Tuple[str, ...]] = {}
        try:
            self._open(paths)
        except BaseException:
            self.close()
            raise

    def _open(self, paths: Sequence[Path]) -> None:
        for path in paths:
            self.bags.extend(recordings_of(path))
        self.bags.sort(key=lambda bag: (bag.start_ns or 0, bag.path.name))
        known = tuple(sorted({topic.name for bag in self.bags for topic in bag.topics}))
        for topic in self.muted:
            if topic not in known:
                raise UnknownTopicError(topic, known)
        self.missing = tuple(topic for topic in self.topics if topic not in known or topic in self.muted)
        self.samples: List[Sample] = self._ordered()
        if not self.samples:
            raise self._nothing()
        self._check_times()

    _figures: Optional[Tuple[List[Sample], Tuple[TopicFigures, ...]]] = None

    def __enter__(self) -> Recordings:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all bags."""
        for bag in self.bags:
            bag.close()

    @property
    def start_ns(self) -> int:
        """Time of the first message of any topic, wanted or not."""
        first: int = min(bag.start_ns for bag in self.bags if bag.start_ns is not None)
        return first

    @property
    def end_ns(self) -> int:
        """Time of the last message of any topic, wanted or not."""
        last: int = max(bag.end_ns for bag in self.bags if bag.end_ns is not None)
        return last

    def topic(self, sample: Sample) -> str:
        """Return the topic of a sample."""
        return self.topics[sample.rank]

    def message(self, sample: Sample) -> Optional[Any]:
        """Return the decoded message; None when it is damaged, which is noted."""
        entry = Entry(sample.t_ns, sample.publisher, sample.chunk, sample.offset, sample.connection)
        try:
            return self.bags[sample.bag].message(entry)
        except MessageError as error:
            self.note(self.topic(sample), sample.t_ns, str(error))
            return None

    def read(self, wanted: Mapping[int, Tuple[str, ...]]) -> None:
        """Read numbers of all messages of some topics, by rank the paths; `values` gives them afterwards."""
        new = {rank: paths for rank, paths in wanted.items() if self._read.get(rank) != paths}
        self._read.update(new)
        for number, bag in enumerate(self.bags):
            if isinstance(bag, Recording):
                found = bag.columns({self.topics[rank]: paths for rank, paths in new.items()})
                for rank in new:
                    self._columns[number, rank] = found.get(self.topics[rank], [])

    def keep(self, topics: Sequence[str]) -> None:
        """Make whole messages of some topics fast, where tapes are wanted."""
        for bag in self.bags:
            if isinstance(bag, Recording):
                bag.keep(topics)

    def values(self, sample: Sample) -> Optional[Tuple[Any, ...]]:
        """Return the numbers of a message; None when `message` must be asked."""
        rows = self._columns.get((sample.bag, sample.rank))
        return rows[sample.row] if rows else None

    def figures(self) -> Tuple[TopicFigures, ...]:
        """Return what the index says of each wanted topic."""
        known = self._figures
        if known is None or known[0] is not self.samples:
            t_ns, ranks = _times(self.samples), np.fromiter((each[1] for each in self.samples), np.int64)
            found = tuple(_figures(topic, t_ns[ranks == rank]) for rank, topic in enumerate(self.topics))
            self._figures = known = (self.samples, found)
        return known[1]

    def _ordered(self) -> List[Sample]:
        parts = [
            self._part(number, rank)
            for number in range(len(self.bags))
            for rank, topic in enumerate(self.topics)
            if topic not in self.muted
        ]
        if not parts:
            return []
        columns = [np.concatenate(column) for column in zip(*parts)]
        order = np.lexsort(tuple(reversed(columns)))
        return list(map(partial(tuple.__new__, Sample), zip(*(column[order].tolist() for column in columns))))

    def _part(self, number: int, rank: int) -> Sequence[Any]:
        """Return the samples of a topic in a bag, as columns."""
        bag, topic = self.bags[number], self.topics[rank]
        t_ns, *rest = (
            bag.table(topic) if isinstance(bag, Recording) else np.array(bag.entries(topic), np.int64).reshape(-1, 5).T
        )
        count = len(t_ns)
        return t_ns, np.full(count, rank), np.full(count, number), *rest, np.arange(count)

    def _check_times(self) -> None:
        """Refuse a recording in which a clock was set: virtual time would go through all the years between."""
        times = np.concatenate(([self.start_ns], _times(self.samples), [self.end_ns]))
        jumps = np.flatnonzero(np.diff(times) > _JUMP_NS)
        if len(jumps):
            raise TimeJumpError(self._names(), *times[jumps[0] : jumps[0] + 2].tolist())

    def _names(self) -> str:
        return ", ".join(bag.path.name for bag in self.bags)

    def _nothing(self) -> NoMessagesError:
        names = self._names()
        if all(bag.start_ns is None for bag in self.bags):
            return NoMessagesError(f"{names}: there is no message in it")
        there = ", ".join(topic.name for bag in self.bags for topic in bag.topics)
        return NoMessagesError(
            f"{names}: no message of {', '.join(self.topics)}; there are {there}: is it another map?"
        )

    def note(self, topic: str, t_ns: int, reason: str) -> None:
        """Note that one message could not be read, and why."""
        damage = self.damage.get(topic)
        if damage is None:
            self.damage[topic] = Damage(topic, reason, t_ns, t_ns)
        else:
            damage.count, damage.last_ns = damage.count + 1, t_ns


def _times(samples: List[Sample]) -> Any:
    return np.fromiter((each[0] for each in samples), np.int64, len(samples))


def _figures(topic: str, times: Any) -> TopicFigures:
    if len(times) < 2 or times[-1] == times[0]:  # noqa: PLR2004
        return TopicFigures(topic, len(times))
    gaps = np.diff(times)
    longest = int(gaps.argmax())
    rate = (len(times) - 1) * _S / (int(times[-1]) - int(times[0]))
    return TopicFigures(topic, len(times), rate, int(gaps[longest]) / _S, int(times[longest]))
