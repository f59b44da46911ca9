"""One input of a merge: its chunks in order of time, loaded a few megabytes at a time."""

from __future__ import annotations

import os
import struct
from itertools import groupby
from typing import Any, List, NamedTuple, Set, Tuple

import numpy as np

from .compression import decompressed
from .errors import BagError, RecordError
from .index import ChunkHead, Index, index_entries, require, unusable
from .table import Span, Table, relabel, tabulate

__all__ = ["Block", "Group", "Pool", "Source"]

_GROUP_BYTES = 4 << 20
_KEPT = 16


class Block(NamedTuple):
    """Loaded messages, with their numbers and times in the output: a buffer, its table, and where it came from."""

    buffer: Any
    table: Table
    source: int
    poolable: bool


class Group(NamedTuple):
    """Chunks to be loaded together, or one to be copied as it is."""

    source: Source
    chunks: List[int]
    verbatim: bool

    @property
    def size(self) -> int:
        """Return its bytes in the input."""
        chunks = self.source.index.chunks
        return sum(chunks[number].end - chunks[number].position for number in self.chunks)

    @property
    def first_ns(self) -> int:
        """Return the time of its first message."""
        return self.source.start_ns(self.chunks[0])

    def load(self, pool: Pool) -> List[Block]:
        """Read, check and relabel the messages."""
        return self.source.load(self.chunks, pool)


class Pool:
    """Buffers that are used again, because new memory costs as much as reading into it."""

    def __init__(self) -> None:
        self._free: List[bytearray] = []

    def get(self, size: int) -> bytearray:
        """Return a buffer of at least this size."""
        for place, buffer in enumerate(self._free):
            if len(buffer) >= size:
                return self._free.pop(place)
        return bytearray(max(size + (size >> 3), _GROUP_BYTES))

    def put(self, buffer: bytearray) -> None:
        """Take a buffer back."""
        if len(self._free) < _KEPT and len(buffer) <= 2 * _GROUP_BYTES:
            self._free.append(buffer)


class Source:
    """Reads a bag's chunks in order of their first messages.

    Args:
        index: of the bag.
        number: of the input.
        target: the connection's number in the output, by its number here.
        shift_ns: added to record times.
        verbatim: chunks that are copied as they are.
    """

    def __init__(self, index: Index, number: int, target: Any, shift_ns: int, verbatim: Set[int]) -> None:
        self.index, self.number = index, number
        self._target, self._shift_ns, self._verbatim = target, shift_ns, verbatim
        chunks = index.chunks
        self._order = [
            each
            for each in sorted(range(len(chunks)), key=lambda each: (chunks[each].start_ns, each))
            if chunks[each].counts
        ]
        self._next = 0

    @property
    def next_ns(self) -> int:
        """Return the time before which nothing more will come; only when there is more."""
        return self.start_ns(self._order[self._next])

    def start_ns(self, chunk: int) -> int:
        """Return the time of a chunk's first message in the output."""
        return self.index.chunks[chunk].start_ns + self._shift_ns

    @property
    def more(self) -> bool:
        """Return whether something will come."""
        return self._next < len(self._order)

    def take(self) -> Group:
        """Return the next chunks, about as many as are worth a read."""
        if self._order[self._next] in self._verbatim:
            self._next += 1
            return Group(self, [self._order[self._next - 1]], verbatim=True)
        taken, size = [], 0
        while self.more and size < _GROUP_BYTES and self._order[self._next] not in self._verbatim:
            number = self._order[self._next]
            chunk = self.index.chunks[number]
            taken.append(number)
            size += chunk.end - chunk.position
            self._next += 1
        return Group(self, taken, verbatim=False)

    def load(self, numbers: List[int], pool: Pool) -> List[Block]:
        """Return the messages of chunks.

        Raises:
            BagError: A chunk is damaged.
        """
        chunks = [(number, self.index.head(number)) for number in numbers]
        blocks: List[Block] = []
        for plain, run in groupby(chunks, key=lambda chunk: chunk[1].compression == "none"):
            if plain:
                blocks.append(self._load_plain(list(run), pool))
            else:
                blocks += [self._load_compressed(number, head) for number, head in run]
        return blocks

    def _load_compressed(self, number: int, head: ChunkHead) -> Block:
        chunk = self.index.chunks[number]
        raw = os.pread(self.index.file, chunk.end - head.data, head.data)
        try:
            buffer = decompressed(head.compression, memoryview(raw)[: head.stored], head.size)
            t_ns, connection, start, _ = index_entries(raw, head.stored, len(raw), dict(chunk.counts))
            table = tabulate(buffer, [Span(0, head.size)], t_ns, connection, start)
        except (RecordError, struct.error, ValueError) as error:
            raise unusable(self.index.path, chunk.position, error) from error
        return self._block(buffer, table, poolable=False)

    def _load_plain(self, chunks: List[Tuple[int, ChunkHead]], pool: Pool) -> Block:
        buffer, places = self._read_plain([number for number, _ in chunks], pool)
        spans, parts = [], []
        for (number, head), place in zip(chunks, places):
            chunk = self.index.chunks[number]
            start = place + head.data - chunk.position
            limit = place + chunk.end - chunk.position
            try:
                require(head.size == head.stored, "its sizes differ although it is not compressed")
                t_ns, connection, offset, _ = index_entries(buffer, start + head.stored, limit, dict(chunk.counts))
                require(not len(offset) or int(offset.max()) < head.stored, "the index points behind its end")
            except (RecordError, struct.error, ValueError) as error:
                raise unusable(self.index.path, chunk.position, error) from error
            spans.append(Span(start, start + head.stored))
            parts.append((t_ns, connection, offset + start))
        try:
            table = tabulate(buffer, spans, *(np.concatenate(each) for each in zip(*parts)))
        except (RecordError, struct.error, ValueError) as error:
            raise self._damaged(chunks, buffer, spans, parts, error) from error
        return self._block(buffer, table, poolable=True)

    def _damaged(self, chunks: Any, buffer: Any, spans: Any, parts: Any, error: Exception) -> BagError:
        """Return the error for the first of some chunks that is damaged."""
        for (number, _), span, part in zip(chunks, spans, parts):
            try:
                tabulate(buffer, [span], *part)
            except (RecordError, struct.error, ValueError) as found:
                return unusable(self.index.path, self.index.chunks[number].position, found)
        return unusable(self.index.path, self.index.chunks[chunks[0][0]].position, error)

    def _read_plain(self, numbers: List[int], pool: Pool) -> Tuple[bytearray, List[int]]:
        """Return a buffer with chunks and where they are in it; chunks that are neighbours come in one read."""
        chunks = [self.index.chunks[number] for number in numbers]
        sizes = [chunk.end - chunk.position for chunk in chunks]
        places = np.cumsum([0, *sizes[:-1]]).tolist()
        buffer = pool.get(sum(sizes))
        view = memoryview(buffer)
        first = 0
        for each in range(len(chunks)):
            if each + 1 < len(chunks) and chunks[each].end == chunks[each + 1].position:
                continue
            begin, end = places[first], places[each] + sizes[each]
            if os.preadv(self.index.file, [view[begin:end]], chunks[first].position) != end - begin:
                raise BagError(str(self.index.path), "became shorter while it was read", "try again")
            first = each + 1
        return buffer, places

    def _block(self, buffer: Any, table: Table, *, poolable: bool) -> Block:
        connection = self._target[table.connection]
        return Block(buffer, relabel(buffer, table, connection, self._shift_ns), self.number, poolable)
