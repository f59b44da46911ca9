"""Compressed chunks that are almost all one message: brought into a buffer for a merge without being decompressed."""

from __future__ import annotations

import os
import struct
from typing import Any, Dict, List, NamedTuple, Optional

import numpy as np

from .errors import BagError, RecordError
from .index import ChunkHead, Index
from .loading import Block, Pool
from .table import Span, Table, relabel, tabulate
from .wrapping import HIDDEN, LARGE, ROOM, Message, Wrapped, wrapped

__all__ = ["Carriers"]

_SMALL = 1024  # bytes per message, on average, of which there may be many beside a large one
_BROKEN = (RecordError, struct.error, ValueError, IndexError)


class _Carrier(NamedTuple):
    """One such chunk: its number and header, and times, connections and offsets of its messages, the large one last."""

    number: int
    head: ChunkHead
    t_ns: Any
    connection: Any
    offset: Any

    @property
    def before(self) -> int:
        """Return how many bytes stand before the large message."""
        return int(self.offset[-1])

    def large(self) -> Message:
        """Return the large message."""
        return Message(int(self.t_ns[-1]), int(self.connection[-1]), self.before)


class Carriers:
    """Loads such chunks of an input; their messages get other connections and times at once.

    Args:
        index: of the bag.
        number: of the input.
        target: the connection's number in the output, by its number here.
        shift_ns: added to record times.
        unseen: for each connection here, whether the bytes of its messages need not be seen.
    """

    def __init__(self, index: Index, number: int, target: Any, shift_ns: int, unseen: Any) -> None:
        self._index, self._number, self._target, self._shift_ns = index, number, target, shift_ns
        self._unseen = unseen
        self._found: Dict[int, Optional[_Carrier]] = {}

    def maybe(self, number: int) -> bool:
        """Return whether a chunk could be one, by what is known of it without reading its index."""
        head, chunk = self._index.head(number), self._index.chunks[number]
        if head.compression != "lz4" or head.size < max(LARGE, _SMALL * chunk.messages):
            return False
        return any(self._unseen[connection] for connection, _ in chunk.counts)

    def has(self, number: int) -> bool:
        """Return whether a chunk is one, by its index."""
        if number not in self._found:
            self._found[number] = self._looked_at(number) if self.maybe(number) else None
        return self._found[number] is not None

    def _looked_at(self, number: int) -> Optional[_Carrier]:
        try:
            columns = self._index.entries(number)
        except BagError:
            return None  # to be said by those who decompress it
        order = np.argsort(columns[2], kind="stable")
        carrier = _Carrier(number, self._index.head(number), *(column[order] for column in columns))
        size, before = carrier.head.size, carrier.before
        fits = size - before >= LARGE and before * HIDDEN <= size and self._unseen[carrier.connection[-1]]
        return carrier if fits else None

    def load(self, numbers: List[int], pool: Pool) -> Optional[Block]:
        """Return the messages of such chunks; None when one of them has to be decompressed after all."""
        carriers = [carrier for carrier in (self._found.pop(number) for number in numbers) if carrier]
        sizes = [carrier.before + ROOM + carrier.head.stored for carrier in carriers]
        places = np.cumsum([0, *sizes]).tolist()
        buffer = pool.get(places[-1])
        jobs = [pool.workers.submit(self._wrap, *job, buffer) for job in zip(carriers, places)]
        frames = [job.result() for job in jobs]
        try:
            small = self._small(buffer, carriers, places)
        except _BROKEN:
            small = None
        if small is None or None in frames:
            pool.put(buffer)
            return None
        ends = [place + size for place, size in zip(places, sizes)]
        return self._together(buffer, small, carriers, [frame for frame in frames if frame], ends)

    def _wrap(self, carrier: _Carrier, place: int, buffer: bytearray) -> Optional[Wrapped]:
        head, start = carrier.head, place + carrier.before + ROOM
        end = start + head.stored
        if os.preadv(self._index.file, [memoryview(buffer)[start:end]], head.data) != head.stored:
            return None
        large = carrier.large()
        target = self._new(large)
        alone = len(carrier.t_ns) == 1 and target[:2] == large[:2]
        frame = wrapped(buffer, start, end, head.size, large, None if alone else target)
        if frame is not None:
            buffer[place : place + len(frame.hidden)] = frame.hidden
        return frame

    def _new(self, message: Message) -> Message:
        return Message(message.t_ns + self._shift_ns, int(self._target[message.connection]), 0)

    def _small(self, buffer: bytearray, carriers: List[_Carrier], places: List[int]) -> Table:
        """Return what stands before the large messages."""
        spans = [Span(place, place + carrier.before) for carrier, place in zip(carriers, places)]
        columns = (
            np.concatenate([carrier.t_ns[:-1] for carrier in carriers]),
            np.concatenate([carrier.connection[:-1] for carrier in carriers]),
            np.concatenate([carrier.offset[:-1] + place for carrier, place in zip(carriers, places)]),
        )
        table = tabulate(buffer, spans, *columns)
        return relabel(buffer, table, self._target[table.connection], self._shift_ns)

    def _together(
        self, buffer: bytearray, small: Table, carriers: List[_Carrier], frames: List[Wrapped], ends: List[int]
    ) -> Block:
        large = [self._new(carrier.large()) for carrier in carriers]
        start = [frame.start for frame in frames]
        rows = [message.t_ns for message in large], [message.connection for message in large], start, start, ends
        columns: List[Any] = [np.append(few, np.array(more, np.int64)) for few, more in zip(small, rows)]
        whole = np.append(np.zeros(len(small.start), np.int64), [frame.size for frame in frames])
        order = np.argsort(columns[2], kind="stable")
        t_ns, connection, begin, payload, end = (column[order] for column in columns)
        table = Table(t_ns, connection, begin, payload, end, (-1, -1))
        return Block(buffer, table, self._number, np.full(len(order), -1), whole[order])
