"""All messages of a bag read and counted, with checksums of their bytes and times."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Dict, NamedTuple, Optional

import numpy as np

from .arrays import distinct
from .index import Index
from .loading import Block, Pool
from .source import Source
from .tally import Tallies, Tally, TopicKey, checksums, payload_checksums

__all__ = ["Counted", "count"]

Progress = Callable[[int, int], None]


class Counted(NamedTuple):
    """What a bag has.

    Args:
        path: of the bag.
        size: in bytes.
        messages: all of them.
        start_ns: time of the first; None when there is none.
        end_ns: time of the last; None when there is none.
        ordered: whether they lie in the file in order of time.
        topics: tallies by topic, type and md5; times are shifted as asked.
        crc_sums: the sum of the CRC-32 of all messages, by topic.
    """

    path: Path
    size: int
    messages: int
    start_ns: Optional[int]
    end_ns: Optional[int]
    ordered: bool
    topics: Dict[TopicKey, Tally]
    crc_sums: Dict[str, int]


class _Counter:
    def __init__(self, index: Index) -> None:
        self._connections = index.connections
        self.tallies = Tallies()
        self.crc_sums: Dict[str, int] = {}
        self.first: Optional[int] = None
        self.last: Optional[int] = None
        self.ordered = True

    def add(self, block: Block) -> None:
        table = block.table
        if not len(table.t_ns):
            return
        crc = payload_checksums(block.buffer, table.payload.tolist(), table.end.tolist())
        sums = checksums(crc, table.end - table.payload, table.t_ns)
        for number in distinct(table.connection):
            which = table.connection == number
            self._add(number, int(which.sum()), int(sums[which].sum(dtype=np.uint64)), int(crc[which].sum()))
        self._follow(table.t_ns)

    def _add(self, number: int, messages: int, checksum: int, crc_sum: int) -> None:
        each = self._connections[number]
        self.tallies.add((each.topic, each.kind, each.md5), Tally(messages, checksum))
        self.crc_sums[each.topic] = self.crc_sums.get(each.topic, 0) + crc_sum

    def _follow(self, t_ns: Any) -> None:
        if bool((np.diff(t_ns) < 0).any()) or (self.last is not None and int(t_ns[0]) < self.last):
            self.ordered = False
        first, last = int(t_ns.min()), int(t_ns.max())
        self.first = first if self.first is None else min(self.first, first)
        self.last = last if self.last is None else max(self.last, last)


def count(path: Path, shift_ns: int = 0, progress: Optional[Progress] = None) -> Counted:
    """Read all of a bag; check every chunk against its index.

    Raises:
        BagError: It is damaged.
    """
    with Index(path) as index, Pool() as pool:
        counter = _Counter(index)
        target = np.arange(max(index.connections, default=0) + 1)
        source = Source(index, 0, target, shift_ns, set(), np.zeros(len(target), bool))
        total, done = sum(chunk.end - chunk.position for chunk in index.chunks), 0
        counter.ordered = _chunks_in_order(index)
        while source.more:
            group = source.take()
            for block in group.load(pool):
                counter.add(block)
                pool.put(block.buffer)
            done += group.size
            if progress:
                progress(done, total)
        messages = sum(tally.messages for tally in counter.tallies.by_topic.values())
        return Counted(
            path,
            index.size,
            messages,
            counter.first,
            counter.last,
            counter.ordered,
            counter.tallies.by_topic,
            counter.crc_sums,
        )


def _chunks_in_order(index: Index) -> bool:
    filled = [chunk.start_ns for chunk in index.chunks if chunk.counts]
    return filled == sorted(filled)
