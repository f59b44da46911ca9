"""The writing half of a merge: messages in order of time become chunks of the output."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, Deque, Dict, List, Optional, Sequence, Tuple
from zlib import crc32

import numpy as np

from .arrays import distinct, index_records
from .chunking import Cut, cuts
from .compression import compressed, decompressed
from .connections import Connection
from .duplicates import Duplicates
from .errors import BagError, RecordError
from .index import KEEP_GOOD, Index
from .layout import connection_record
from .loading import BEGINNING, Block, Pool
from .output import Output, Stretch
from .pending import Pending, Rows, joined, nothing
from .tally import Tallies, Tally, checksums
from .unify import Unified

__all__ = ["Writing"]

_COMPRESSORS = 2
_AHEAD = 1  # jobs in line behind the one that is written, while the next one is put together

_Chunk = Tuple[Cut, int, List[Any], int]  # with its size, its records in pieces, and what it is whole


class Writing:
    """Puts blocks of messages in order and writes them.

    Args:
        out: the new bag.
        inputs: open.
        unified: its connections.
        compression: of its chunks.
        duplicates: count, drop or ignore.
        window_ns: in which duplicates lie.
    """

    def __init__(
        self,
        out: Output,
        inputs: Sequence[Index],
        unified: Unified,
        compression: str,
        duplicates: str,
        window_ns: int,
    ) -> None:
        self._out, self._inputs = out, inputs
        self._connections, self._compression = unified.connections, compression
        self._drop = duplicates == "drop"
        self._finder = None
        if duplicates != "ignore" and unified.comparable:
            self._finder = Duplicates(unified.comparable, window_ns)
        self._pending, self._rows = Pending(), nothing()
        self._found = Tallies()
        self._prefix = _connection_records(unified.connections)  # once in a chunk, for those who rebuild an index
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
            return decompressed("lz4", b"".join(frame), int(rows.whole[0]))
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
        crc = np.array([crc32(memoryview(buffers[block])[begin:end]) for block, begin, end in pieces], np.uint64)
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
        finder, buffers = self._finder, self._pending.buffers
        if finder is None:
            return []
        candidates = finder.candidates(rows.connection)
        picked = rows.where(candidates)
        columns = (column.tolist() for column in (candidates, *picked))
        return [
            place
            for place, t_ns, connection, _, payload, end, block, source, *_ in zip(*columns)
            if finder.known(t_ns, connection, source, memoryview(buffers[block])[payload:end])
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
