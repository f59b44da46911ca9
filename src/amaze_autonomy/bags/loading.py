"""The messages of a few chunks brought into one buffer, and checked there.

Of large messages in chunks that are not compressed only the beginning is read: their header, which says whose they are
and how long. The rest goes from file to file without coming here, unless somebody has to see it.
"""

from __future__ import annotations

import os
import struct
from concurrent.futures import ThreadPoolExecutor
from typing import Any, List, NamedTuple, Optional, Tuple

import numpy as np

from .compression import decompress_into
from .errors import BagError, RecordError
from .index import ChunkHead, Index, Messages, index_entries, require, unusable
from .layout import Buffer, words
from .table import Span, Table, tabulate

__all__ = ["BEGINNING", "GROUP_BYTES", "Block", "Loader", "Pool"]

GROUP_BYTES = 4 << 20  # that much is loaded together
BEGINNING = 512  # bytes of a large message that are read; its header has about 50
_LARGE = 64 << 10  # what is worth a copy by the system
_COARSE = 16 << 10  # bytes per message that make it worth looking for large ones
_SPARSE = 2  # times as much room is taken for chunks of which little is read
_KEPT = 16
_DECOMPRESSORS = 2
_BROKEN = (RecordError, struct.error, ValueError)

_Entries = Tuple[Any, Any, Any]


class Block(NamedTuple):
    """Loaded messages.

    Args:
        buffer: where they are.
        table: of them.
        source: number of the input.
        origin: where in its file a large one begins that is not all in the buffer; else -1.
        whole: size of what is not a record but a compressed chunk with just this message; else 0.
    """

    buffer: bytearray
    table: Table
    source: int
    origin: Any
    whole: Any


class Pool:
    """Buffers that are used again, because new memory costs as much as reading into it; and threads that fill them.

    Args:
        largest: bytes of a buffer that is worth keeping.
    """

    def __init__(self, largest: int = 2 * _SPARSE * GROUP_BYTES) -> None:
        self._free: List[bytearray] = []
        self._largest = largest
        self.workers = ThreadPoolExecutor(_DECOMPRESSORS)

    def __enter__(self) -> Pool:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.workers.shutdown()

    def get(self, size: int) -> bytearray:
        """Return a buffer of at least this size."""
        for place, buffer in enumerate(self._free):
            if len(buffer) >= size:
                return self._free.pop(place)
        return bytearray(max(size + (size >> 3), GROUP_BYTES))

    def put(self, buffer: bytearray) -> None:
        """Take a buffer back."""
        if len(self._free) < _KEPT and len(buffer) <= self._largest:
            self._free.append(buffer)


class Loader:
    """Loads chunks of a bag.

    Args:
        index: of the bag.
        number: of the input.
        unseen: for each connection of the bag, whether the bytes of its messages need not be seen.
        coarse: bytes per message of a chunk that make it worth looking for large ones.
        messages: all of the index, where they were read before; else a chunk's are read with it.
    """

    def __init__(
        self, index: Index, number: int, unseen: Any, coarse: int = _COARSE, messages: Optional[Messages] = None
    ) -> None:
        self._index, self._number, self._unseen, self._coarse = index, number, unseen, coarse
        self._messages = messages
        if messages is not None:
            bounds: Any = np.searchsorted(messages.chunk, np.arange(len(index.chunks) + 1))
            self._bounds: List[int] = bounds.tolist()

    def size_of(self, number: int) -> int:
        """Return about how many bytes a chunk brings along: less than it has, where not all of it is read."""
        size = self._index.head(number).size
        return size // _SPARSE if self.is_coarse(number) else size

    def compressed(self, numbers: List[int], pool: Pool) -> Block:
        """Return the messages of compressed chunks.

        Raises:
            BagError: One is damaged.
        """
        heads = [self._index.head(number) for number in numbers]
        places = np.cumsum([0, *(head.size for head in heads)]).tolist()
        buffer = pool.get(places[-1])
        jobs = [pool.workers.submit(self._decompress, *job, buffer) for job in zip(numbers, heads, places)]
        parts = [job.result() for job in jobs]
        spans = [Span(place, place + head.size) for place, head in zip(places, heads)]
        return self._block(numbers, buffer, spans, parts, np.zeros((0, 2), np.int64))

    def _decompress(self, number: int, head: ChunkHead, place: int, buffer: bytearray) -> _Entries:
        chunk = self._index.chunks[number]
        raw = os.pread(self._index.file, chunk.end - head.data, head.data)
        try:
            decompress_into(buffer, place, head.compression, raw[: head.stored], head.size)
            t_ns, connection, offset = self._entries(number, raw, head.stored, len(raw))
            require(not len(offset) or int(offset.max()) < head.size, "the index points behind its end")
        except _BROKEN as error:
            raise unusable(self._index.path, chunk.position, error) from error
        return t_ns, connection, offset + place

    def plain(self, numbers: List[int], pool: Pool) -> Block:
        """Return the messages of chunks that are not compressed.

        Raises:
            BagError: One is damaged.
        """
        chunks = [self._index.chunks[number] for number in numbers]
        heads = [self._index.head(number) for number in numbers]
        places = np.cumsum([0, *(chunk.end - chunk.position for chunk in chunks)]).tolist()
        buffer = pool.get(places[-1])
        apart = {each for each, number in enumerate(numbers) if self.is_coarse(number)}
        self._read_all(buffer, [each for each in range(len(chunks)) if each not in apart], numbers, places)
        spans, parts, cut = [], [], []
        for each, (chunk, head, place) in enumerate(zip(chunks, heads, places)):
            span = Span(place + head.data - chunk.position, place + head.data - chunk.position + head.stored)
            try:
                require(head.size == head.stored, "its sizes differ although it is not compressed")
                if each in apart and self._messages is None:
                    self._read(buffer, span.end, head.data + head.stored, chunk.end - head.data - head.stored)
                limit = place + chunk.end - chunk.position
                t_ns, connection, offset = self._entries(numbers[each], buffer, span.end, limit)
                require(not len(offset) or int(offset.max()) < head.stored, "the index points behind its end")
            except _BROKEN as error:
                raise unusable(self._index.path, chunk.position, error) from error
            spans.append(span)
            parts.append((t_ns, connection, offset + span.start))
            if each in apart:
                large = self._read_coarse(buffer, span, head.data, connection, offset)
                cut.append(np.stack((large + span.start, large + head.data), 1))
        return self._block(numbers, buffer, spans, parts, np.concatenate([*cut, np.zeros((0, 2), np.int64)]))

    def _entries(self, number: int, buffer: Buffer, place: int, limit: int) -> _Entries:
        """Return times, connections and offsets of a chunk's messages; what is behind the chunk lies in a buffer."""
        if self._messages is None:
            return index_entries(buffer, place, limit, dict(self._index.chunks[number].counts))[:3]
        rows = slice(*self._bounds[number : number + 2])
        return self._messages.t_ns[rows], self._messages.connection[rows], self._messages.offset[rows]

    def is_coarse(self, number: int) -> bool:
        """Return True when of a chunk only what lies between large messages is read."""
        chunk, head = self._index.chunks[number], self._index.head(number)
        large = head.compression == "none" and head.stored >= max(_LARGE, self._coarse * chunk.messages)
        return large and any(self._unseen[connection] for connection, _ in chunk.counts)

    def _read_coarse(self, buffer: bytearray, span: Span, data: int, connection: Any, offset: Any) -> Any:
        """Read a chunk without what is large in it; return the offsets of the messages of which that is missing."""
        order = np.argsort(offset)
        start: Any = offset[order]
        follows: Any = np.append(start[1:], span.end - span.start)
        large = np.flatnonzero((follows - start >= _LARGE) & self._unseen[connection[order]])
        stops = [*(start[large] + BEGINNING).tolist(), span.end - span.start]
        for begin, stop in zip([0, *follows[large].tolist()], stops):
            self._read(buffer, span.start + begin, data + begin, stop - begin)
        if _are_whole(buffer, span.start + start[large], span.start + follows[large]):
            return start[large]
        self._read(buffer, span.start, data, span.end - span.start)  # there is more in it than messages, or damage
        return start[:0]

    def _read_all(self, buffer: bytearray, which: List[int], numbers: List[int], places: List[int]) -> None:
        """Read chunks as they are, neighbours in one go."""
        chunks = self._index.chunks
        first = 0
        for last, each in enumerate(which):
            following = which[last + 1] if last + 1 < len(which) else -1
            if following == each + 1 and chunks[numbers[each]].end == chunks[numbers[following]].position:
                continue
            begin = which[first]
            self._read(buffer, places[begin], chunks[numbers[begin]].position, places[each + 1] - places[begin])
            first = last + 1

    def _read(self, buffer: bytearray, place: int, position: int, size: int) -> None:
        if size and os.preadv(self._index.file, [memoryview(buffer)[place : place + size]], position) != size:
            raise BagError(str(self._index.path), "became shorter while it was read", "try again")

    def _block(
        self, numbers: List[int], buffer: bytearray, spans: List[Span], parts: List[_Entries], cut: Any
    ) -> Block:
        """Check the messages in a buffer; `cut` are places of those that are not all there, and those in the file."""
        try:
            table = tabulate(buffer, spans, *(np.concatenate(each) for each in zip(*parts)))
        except (*_BROKEN, IndexError) as error:
            raise self._damaged(numbers, buffer, spans, parts, error) from error
        origin: Any = np.full(len(table.start), -1)
        origin[np.searchsorted(table.start, cut[:, 0])] = cut[:, 1]
        return Block(buffer, table, self._number, origin, np.zeros(len(table.start), np.int64))

    def _damaged(self, numbers: List[int], buffer: Any, spans: Any, parts: Any, error: Exception) -> BagError:
        """Return the error for the first of some chunks that is damaged."""
        for number, span, part in zip(numbers, spans, parts):
            try:
                tabulate(buffer, [span], *part)
            except (*_BROKEN, IndexError) as found:
                return unusable(self._index.path, self._index.chunks[number].position, found)
        return unusable(self._index.path, self._index.chunks[numbers[0]].position, error)


def _are_whole(buffer: bytearray, start: Any, follows: Any) -> bool:
    """Return whether messages end where the next begin, by what stands in their beginnings."""
    numbers = words(buffer)
    header = numbers[start].astype(np.int64)
    if (header > BEGINNING - 8).any():
        return False
    return bool((start + 8 + header + numbers[start + 4 + header] == follows).all())
