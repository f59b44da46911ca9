"""The writing half of a merge: messages in order of time become chunks of the output.

Two messages are the same one when they come from inputs of different origins, on the same connection but for its
publisher if one of the inputs does not know it, have the same bytes, and were recorded within a window of time. Each
message is the partner of one other at most of each origin, so that a publisher that repeats itself keeps as many
messages as the recording with the most of them. The files of one recorder have one origin: it wrote each message once.
"""

from __future__ import annotations

import zlib
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Deque, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple
from zlib import crc32

import numpy as np

from amaze_autonomy.units import SECOND

from ..arrays import distinct, index_data, index_records
from ..errors import BagError, RecordError
from ..format import Connection, compressed, connection_record, decompressed
from ..index import KEEP_GOOD, Index
from ..read import BEGINNING, Block, Pool
from ..write import Output, Stretch
from .manifest import Tallies, Tally, checksums

# --- messages cut into chunks -----------------------------------------------------------------------------------------


CHUNK_BYTES = 768 * 1024  # the recorder's; readers keep one chunk, so larger ones cost them memory and time

_HEADER = 55  # bytes of an index record before its entries
_TEMPLATE: Any = np.frombuffer(index_data(0, np.zeros(0, np.int64), np.zeros(0, np.int64)), np.uint8)
_AT_CONNECTION, _AT_COUNT, _AT_SIZE = 13, 27, 51


class Cut(NamedTuple):
    """One chunk to be written: messages from `first` to `last`, its data's size, and what its index says.

    Args:
        first: number of its first message.
        last: number behind its last message.
        size: of its messages in bytes.
        records: the index to be written behind it.
        start_ns: earliest time.
        end_ns: latest time.
        counts: messages by connection.
    """

    first: int
    last: int
    size: int
    records: Any
    start_ns: int
    end_ns: int
    counts: Tuple[Tuple[int, int], ...]


def cuts(t_ns: Any, connection: Any, length: Any, alone: Any, *, before: int, final: bool) -> Iterator[Cut]:
    """Cut messages into chunks; the last ones are left over unless `final`.

    Args:
        t_ns: times, ascending.
        connection: numbers.
        length: bytes of the records.
        alone: messages that have a chunk of their own.
        before: bytes that will stand before the first message of the first chunk.
        final: whether nothing will follow.
    """
    behind = np.cumsum(length)
    bounds: Any = _bounds(behind, alone, before, final=final)
    if len(bounds) < 2:  # noqa: PLR2004  (no whole chunk)
        return
    total = bounds[-1]
    sizes: Any = np.diff(bounds)
    starts = (behind - length)[bounds[:-1]]
    offsets = (behind - length)[:total] - np.repeat(starts, sizes)
    offsets[: sizes[0]] += before
    blob, records = _index_records(np.repeat(np.arange(len(sizes)), sizes), t_ns[:total], connection[:total], offsets)
    chunk_of, number_of, count_of, place_of = records
    edges: Any = np.searchsorted(chunk_of, np.arange(len(sizes) + 1))
    places = np.append(place_of, len(blob))[edges].tolist()
    counts = list(zip(number_of.tolist(), count_of.tolist()))
    edges = edges.tolist()
    view = memoryview(blob)
    for each, (first, last) in enumerate(zip(bounds[:-1], bounds[1:])):
        yield Cut(
            first,
            last,
            int(behind[last - 1] - starts[each]),
            view[places[each] : places[each + 1]],
            int(t_ns[first]),
            int(t_ns[last - 1]),
            tuple(counts[edges[each] : edges[each + 1]]),
        )


def _bounds(behind: Any, alone: Any, before: int, *, final: bool) -> List[int]:
    """Return where chunks begin and end, as numbers of messages: a chunk ends with the message that fills it."""
    bounds = [0]
    for place in np.flatnonzero(alone).tolist():
        _fill(bounds, behind[:place], before, final=True)
        bounds.append(place + 1)
        before = 0
    _fill(bounds, behind, before, final=final)
    return bounds


def _fill(bounds: List[int], behind: Any, before: int, *, final: bool) -> None:
    """Add bounds up to the last message."""
    count = len(behind)
    written = int(behind[bounds[-1] - 1]) if bounds[-1] else 0
    while bounds[-1] < count and behind[-1] - written + before >= CHUNK_BYTES:
        last = int(np.searchsorted(behind, written + CHUNK_BYTES - before, "left")) + 1
        before = 0
        bounds.append(last)
        written = int(behind[last - 1])
    if final and bounds[-1] != count:
        bounds.append(count)


def _index_records(chunk: Any, t_ns: Any, connection: Any, offsets: Any) -> Tuple[Any, Tuple[Any, Any, Any, Any]]:
    """Return the index records of all chunks as bytes, and for each of them chunk, connection, count, and place."""
    kinds = int(connection.max()) + 1
    key = chunk * kinds + connection
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.flatnonzero(np.concatenate(([True], key[1:] != key[:-1])))
    count = np.diff(np.append(first, len(key)))
    size = _HEADER + 12 * count
    place = np.cumsum(size) - size
    blob: Any = np.empty(int(size.sum()), np.uint8)
    blob[place[:, None] + np.arange(_HEADER)] = _TEMPLATE
    numbers: Any = np.ndarray((len(blob) - 3,), "<u4", blob, 0, (1,))
    numbers[place + _AT_CONNECTION] = key[first] % kinds
    numbers[place + _AT_COUNT] = count
    numbers[place + _AT_SIZE] = 12 * count
    entries: Any = np.empty((len(key), 3), "<u4")
    entries[:, 0], entries[:, 1] = np.divmod(t_ns[order], SECOND)
    entries[:, 2] = offsets[order]
    targets = np.repeat(place + _HEADER - 12 * first, count) + 12 * np.arange(len(key))
    np.ndarray((len(blob) - 11,), "V12", blob, 0, (1,))[targets] = entries.view("V12")[:, 0]
    return blob, (key[first] // kinds, key[first] % kinds, count, place)


# --- messages that wait for their turn --------------------------------------------------------------------------------


class Rows(NamedTuple):
    """Messages as arrays of one length: time, connection, record and payload in the buffer of a block, input.

    `origin` is where a record begins in the file of its input, when only its beginning is in the buffer; else -1.
    `whole` is the size of a compressed chunk that is in the buffer instead of a record; else 0.
    """

    t_ns: Any
    connection: Any
    start: Any
    payload: Any
    end: Any
    block: Any
    source: Any
    origin: Any
    whole: Any

    def where(self, which: Any) -> Rows:
        """Return some of them."""
        return Rows(*(column[which] for column in self))


def nothing() -> Rows:
    """Return no messages."""
    return Rows(*(np.zeros(0, np.int64) for _ in Rows._fields))


def joined(parts: List[Rows]) -> Rows:
    """Return messages one after another."""
    return Rows(*(np.concatenate(columns) for columns in zip(*parts))) if len(parts) > 1 else parts[0]


class Pending:
    """Loaded messages and their buffers. Ready are those before which nothing more can come."""

    def __init__(self) -> None:
        self.buffers: Dict[int, Any] = {}
        self._blocks: Dict[int, Block] = {}
        self._waiting: Dict[int, List[Rows]] = {}  # by input
        self._count = 0

    def add(self, block: Block) -> None:
        """Take the messages of a block."""
        table, number = block.table, self._count
        self._count += 1
        self._blocks[number], self.buffers[number] = block, block.buffer
        count = len(table.t_ns)
        rows = Rows(
            table.t_ns,
            table.connection,
            table.start,
            table.payload,
            table.end,
            np.full(count, number),
            np.full(count, block.source),
            block.origin,
            block.whole,
        )
        self._waiting.setdefault(block.source, []).append(rows)

    def ready(self, limit_ns: Optional[int]) -> Rows:
        """Return the messages before a time in order of time, then input, then file; all when there is no limit."""
        parts = [rows for source in sorted(self._waiting) for rows in self._waiting[source]]
        if not parts:
            return nothing()
        rows = joined(parts)
        rows = rows.where(np.argsort(rows.t_ns, kind="stable"))
        count = len(rows.t_ns) if limit_ns is None else int(np.searchsorted(rows.t_ns, limit_ns, "left"))
        self._waiting = _by_source(rows.where(slice(count, None)))
        return rows.where(slice(0, count))

    def release(self, held: Set[int], pool: Pool) -> None:
        """Give back the buffers of which no message is waiting or held."""
        for parts in self._waiting.values():
            for rows in parts:
                held.update(distinct(rows.block))
        for number in [number for number in self.buffers if number not in held]:
            del self.buffers[number]
            block = self._blocks.pop(number)
            pool.put(block.buffer)


def _by_source(rows: Rows) -> Dict[int, List[Rows]]:
    return {source: [rows.where(rows.source == source)] for source in distinct(rows.source)}


# --- messages that several computers recorded -------------------------------------------------------------------------


_Key = Tuple[int, int, int, bytes]


class _Seen(NamedTuple):
    t_ns: int
    origins: Set[int]


class Duplicates:
    """Finds messages that were seen before in an input of another origin; they come in order of time.

    Args:
        shared: connections of the output that come from several origins; the same number for those that are to be
            compared with each other.
        window_ns: how far apart in time two records of one message are.
    """

    def __init__(self, shared: Dict[int, int], window_ns: int) -> None:
        self._shared, self._window_ns = shared, window_ns
        self._seen: Dict[_Key, Deque[_Seen]] = {}
        self._order: Deque[Tuple[int, _Key]] = deque()
        self._compared: Any = np.array(sorted(shared), np.int64)

    def candidates(self, connection: Any) -> Any:
        """Return the places of messages that could be duplicates."""
        return np.flatnonzero(np.isin(connection, self._compared)) if len(self._compared) else np.zeros(0, np.int64)

    def known(self, t_ns: int, connection: int, origin: int, payload: Any) -> bool:
        """Return whether a message was seen before, recorded elsewhere; remember it. Times ascend."""
        self._forget(t_ns - self._window_ns)
        key = (self._shared[connection], len(payload), zlib.crc32(payload), bytes(payload[:16]))
        seen = self._seen.setdefault(key, deque())
        for each in seen:
            if origin not in each.origins:
                each.origins.add(origin)
                return True
        seen.append(_Seen(t_ns, {origin}))
        self._order.append((t_ns, key))
        return False

    def _forget(self, before_ns: int) -> None:
        while self._order and self._order[0][0] < before_ns:
            _, key = self._order.popleft()
            seen = self._seen[key]
            seen.popleft()
            if not seen:
                del self._seen[key]


# --- the writing half -------------------------------------------------------------------------------------------------


_COMPRESSORS = 2
_AHEAD = 1  # jobs in line behind the one that is written, while the next one is put together

_Chunk = Tuple[Cut, int, List[Any], int]  # with its size, its records in pieces, and what it is whole


class Writing:
    """Puts blocks of messages in order and writes them.

    Args:
        out: the new bag.
        inputs: open.
        connections: of the new bag, by number.
        comparable: those whose messages may be the same ones, by number; the same value for these.
        compression: of its chunks.
        duplicates: count, drop or ignore.
        window_ns: in which duplicates lie.
        origins: where each input was recorded.
    """

    def __init__(
        self,
        out: Output,
        inputs: Sequence[Index],
        connections: Dict[int, Connection],
        comparable: Dict[int, int],
        compression: str,
        duplicates: str,
        window_ns: int,
        origins: Sequence[int],
    ) -> None:
        self._out, self._inputs, self._origins = out, inputs, origins
        self._connections, self._compression = connections, compression
        self._drop = duplicates == "drop"
        self._finder = None
        if duplicates != "ignore" and comparable:
            self._finder = Duplicates(comparable, window_ns)
        self._pending, self._rows = Pending(), nothing()
        self._found = Tallies()
        self._prefix = _connection_records(connections)  # once in a chunk, for those who rebuild an index
        self._compressors, self._writer = ThreadPoolExecutor(_COMPRESSORS), ThreadPoolExecutor(1)
        self._jobs: Deque[Tuple[Future[None], List[int]]] = deque()  # what is being written, and the blocks it needs
        self.messages = self.copied = 0

    @property
    def duplicates(self) -> Dict[Tuple[str, str, str], Tally]:
        """Return how many messages were found to be in several inputs."""
        return self._found.by_topic

    def stop(self) -> None:
        """End the threads."""
        self._writer.shutdown()
        self._compressors.shutdown()

    def add(self, blocks: List[Block], limit_ns: Optional[int], pool: Pool) -> None:
        """Take messages; write those before which nothing more will come, while the next ones are taken."""
        for block in blocks:
            self._pending.add(block)
        self._write(limit_ns, final=limit_ns is None)
        written = [number for _, blocks in self._jobs for number in blocks]
        self._pending.release({*distinct(self._rows.block), *written}, pool)

    def copy(self, index: Index, number: int) -> None:
        """Copy a chunk that overlaps nothing behind all that comes before it."""
        chunk = index.chunks[number]
        self._write(chunk.start_ns, final=True)
        self._wait(0)
        head, times = index.head(number), (chunk.start_ns, chunk.end_ns)
        records = index_records(*index.entries(number))
        end = head.data + head.stored
        self._out.copy_chunk(index.file, chunk.position, end, times=times, counts=chunk.counts, index=records)
        self.messages += chunk.messages
        self.copied += 1

    def finish(self, pool: Pool) -> None:
        """Write what is left."""
        self.add([], None, pool)
        self._wait(0)

    def _wait(self, most: int) -> None:
        """Wait until no more than so many jobs are left."""
        while len(self._jobs) > most:
            self._jobs.popleft()[0].result()

    def _write(self, limit_ns: Optional[int], *, final: bool) -> None:
        """Begin to write what can be."""
        rows = self._pending.ready(limit_ns)
        if self._finder and len(rows.t_ns):
            rows = self._without_duplicates(rows)
        self._rows = joined([self._rows, rows]) if len(rows.t_ns) else self._rows
        rows, length = self._rows, self._rows.end - self._rows.start
        self._wait(_AHEAD)
        alone = rows.whole > 0
        chunks = list(cuts(rows.t_ns, rows.connection, length, alone, before=len(self._prefix), final=final))
        if not chunks:
            return
        bounds = [0, *(cut.last for cut in chunks)]
        pieces = _pieces(rows, bounds, self._pending.buffers, [index.file for index in self._inputs])
        sizes, whole = [cut.size for cut in chunks], rows.whole[bounds[:-1]].tolist()
        if self._prefix:
            if whole[0]:
                pieces[0], sizes[0], whole[0] = [self._opened(pieces[0], rows)], whole[0], 0
            pieces[0].insert(0, self._prefix)
            sizes[0], self._prefix = sizes[0] + len(self._prefix), b""
        job = self._writer.submit(self._put, list(zip(chunks, sizes, pieces, whole)))
        self._jobs.append((job, distinct(rows.block[: bounds[-1]])))
        self.messages += bounds[-1]
        self._rows = rows.where(slice(bounds[-1], None))

    def _opened(self, frame: List[Any], rows: Rows) -> Any:
        """Return the record in the finished chunk that is to be the first, where connections have to be described."""
        try:
            return decompressed("lz4", b"".join(frame), int(rows.whole[0]), self._inputs[0].memory)
        except RecordError as error:
            path = self._inputs[int(rows.source[0])].path
            raise BagError(str(path), f"its first chunk is damaged: {error}", KEEP_GOOD) from error

    def _put(self, chunks: List[_Chunk]) -> None:
        waiting: Deque[Tuple[Cut, int, Any, str]] = deque()
        self._out.expect(part for _, _, parts, _ in chunks for part in parts if isinstance(part, Stretch))
        for cut, size, parts, whole in chunks:
            if whole or self._compression == "none":
                waiting.append((cut, whole or size, parts, "lz4" if whole else "none"))
            else:
                data = self._compressors.submit(compressed, self._compression, b"".join(parts))
                waiting.append((cut, size, data, self._compression))
            if len(waiting) > 2 * _COMPRESSORS:
                self._put_chunk(*waiting.popleft())
        while waiting:
            self._put_chunk(*waiting.popleft())
        self._out.flush()

    def _put_chunk(self, cut: Cut, size: int, data: Any, compression: str) -> None:
        parts = data if isinstance(data, list) else [data.result()]
        times = (cut.start_ns, cut.end_ns)
        self._out.chunk(compression, size, parts, cut.records, times=times, counts=cut.counts)

    def _without_duplicates(self, rows: Rows) -> Rows:
        places = self._duplicates_in(rows)
        if not places:
            return rows
        found = rows.where(np.array(places))
        pieces = zip(found.block.tolist(), found.payload.tolist(), found.end.tolist())
        buffers = self._pending.buffers
        crc: Any = np.array([crc32(memoryview(buffers[block])[begin:end]) for block, begin, end in pieces], np.uint64)
        sums = checksums(crc, found.end - found.payload, found.t_ns)
        for number, checksum in zip(found.connection.tolist(), sums.tolist()):
            each = self._connections[number]
            self._found.add((each.topic, each.kind, each.md5), Tally(1, checksum))
        if not self._drop:
            return rows
        keep: Any = np.ones(len(rows.t_ns), bool)
        keep[places] = False
        return rows.where(keep)

    def _duplicates_in(self, rows: Rows) -> List[int]:
        finder, buffers, origins = self._finder, self._pending.buffers, self._origins
        if finder is None:
            return []
        candidates = finder.candidates(rows.connection)
        picked = rows.where(candidates)
        columns = (column.tolist() for column in (candidates, *picked))
        return [
            place
            for place, t_ns, connection, _, payload, end, block, source, *_ in zip(*columns)
            if finder.known(t_ns, connection, origins[source], memoryview(buffers[block])[payload:end])
        ]


def _connection_records(connections: Dict[int, Connection]) -> bytes:
    return b"".join(
        connection_record(number, each.topic.encode("utf-8", "surrogateescape"), each.header)
        for number, each in sorted(connections.items())
    )


def _pieces(rows: Rows, bounds: List[int], buffers: Dict[int, Any], files: List[int]) -> List[List[Any]]:
    """Return the records of each chunk, neighbours in a buffer in one piece; large ones end with bytes of their file.

    Args:
        rows: messages.
        bounds: where chunks begin, and where the last ends.
        buffers: by block.
        files: descriptors of the inputs.
    """
    some = rows.where(slice(bounds[0], bounds[-1]))
    start, end, block, origin = some.start, some.end, some.block, some.origin
    apart: Any = (start[1:] != end[:-1]) | (block[1:] != block[:-1]) | (origin[:-1] >= 0)
    apart[np.array(bounds[1:-1], np.int64) - 1] = True
    first: Any = np.concatenate(([0], np.flatnonzero(apart) + 1))
    last: Any = np.append(first[1:], len(start)) - 1
    stop: Any = np.where(origin[last] >= 0, start[last] + BEGINNING, end[last])
    views = {number: memoryview(buffers[number]) for number in distinct(block)}
    pieces: List[Any] = [
        views[number][begin:until]
        for begin, until, number in zip(start[first].tolist(), stop.tolist(), block[first].tolist())
    ]
    found: Any = np.searchsorted(first, np.array(bounds))
    places: List[int] = found.tolist()
    cut: List[List[Any]] = [pieces[place:following] for place, following in zip(places, places[1:])]
    short = np.flatnonzero(origin[last] >= 0)
    chunk_of: Any = np.searchsorted(places, short, "right") - 1
    large: Any = last[short]
    columns = (short, chunk_of, some.source[large], origin[large], end[large] - stop[short])
    for piece, chunk, source, at, size in reversed(list(zip(*(column.tolist() for column in columns)))):
        cut[chunk].insert(piece - places[chunk] + 1, Stretch(files[source], at + BEGINNING, size))
    return cut
