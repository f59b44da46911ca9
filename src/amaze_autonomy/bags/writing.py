"""The writing half of a merge: messages in order of time become chunks of the output."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any, Dict, List, Optional, Tuple
from zlib import crc32

import numpy as np

from .chunking import Cut, cuts
from .compression import compressed
from .connections import Connection
from .duplicates import Duplicates
from .index import Index
from .layout import connection_record, index_records
from .output import Output
from .pending import Pending, Rows, joined, nothing
from .source import Block, Pool
from .tally import Tallies, Tally, checksums
from .unify import Unified

__all__ = ["Writing"]

_COMPRESSORS = 2


class Writing:
    """Puts blocks of messages in order and writes them.

    Args:
        out: the new bag.
        unified: its connections.
        compression: of its chunks.
        duplicates: count, drop or ignore.
        window_ns: in which duplicates lie.
    """

    def __init__(self, out: Output, unified: Unified, compression: str, duplicates: str, window_ns: int) -> None:
        self._out, self._connections, self._compression = out, unified.connections, compression
        self._drop = duplicates == "drop"
        self._finder = None
        if duplicates != "ignore" and unified.comparable:
            self._finder = Duplicates(unified.comparable, window_ns)
        self._pending, self._rows = Pending(), nothing()
        self._found = Tallies()
        self._prefix = _connection_records(unified.connections)  # once in a chunk, for those who rebuild an index
        self._compressors = ThreadPoolExecutor(_COMPRESSORS)
        self.messages = self.copied = 0

    @property
    def duplicates(self) -> Dict[Tuple[str, str, str], Tally]:
        """Return how many messages were found to be in several inputs."""
        return self._found.by_topic

    def stop(self) -> None:
        """End the threads."""
        self._compressors.shutdown()

    def add(self, blocks: List[Block], limit_ns: Optional[int], pool: Pool) -> None:
        """Take messages; write those before which nothing more will come."""
        for block in blocks:
            self._pending.add(block)
        self._write(limit_ns, final=limit_ns is None)
        self._pending.release(set(np.unique(self._rows.block).tolist()), pool)

    def copy(self, index: Index, number: int) -> None:
        """Copy a chunk behind everything that was added."""
        self._write(None, final=True)
        chunk = index.chunks[number]
        head, times = index.head(number), (chunk.start_ns, chunk.end_ns)
        records = index_records(*index.entries(number))
        end = head.data + head.stored
        self._out.copy_chunk(index.file, chunk.position, end, times=times, counts=chunk.counts, index=records)
        self.messages += chunk.messages
        self.copied += 1

    def finish(self, pool: Pool) -> None:
        """Write what is left."""
        self.add([], None, pool)

    def _write(self, limit_ns: Optional[int], *, final: bool) -> None:
        rows = self._pending.ready(limit_ns)
        if self._finder and len(rows.t_ns):
            rows = self._without_duplicates(rows)
        self._rows = joined([self._rows, rows]) if len(rows.t_ns) else self._rows
        rows, done = self._rows, 0
        waiting: List[Tuple[Cut, int, Any]] = []
        prefix = self._prefix
        for cut in cuts(rows.t_ns, rows.connection, rows.end - rows.start, before=len(prefix), final=final):
            parts = [*([prefix] if prefix else []), *_slices(rows, cut, self._pending.buffers)]
            self._write_chunk(cut, cut.size + len(prefix), parts, waiting)
            prefix, self._prefix = b"", b""
            done = cut.last
        self._drain(waiting, 0)
        self.messages += done
        self._rows = rows.where(slice(done, None))

    def _write_chunk(self, cut: Cut, size: int, parts: List[Any], waiting: List[Tuple[Cut, int, Any]]) -> None:
        if self._compression == "none":
            self._out.chunk("none", size, parts, cut.records, times=(cut.start_ns, cut.end_ns), counts=cut.counts)
            return
        waiting.append((cut, size, self._compressors.submit(compressed, self._compression, b"".join(parts))))
        self._drain(waiting, 2 * _COMPRESSORS)

    def _drain(self, waiting: List[Tuple[Cut, int, Any]], left: int) -> None:
        while len(waiting) > left:
            cut, size, data = waiting.pop(0)
            times = (cut.start_ns, cut.end_ns)
            self._out.chunk(self._compression, size, [data.result()], cut.records, times=times, counts=cut.counts)

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
            for place, t_ns, connection, _, payload, end, block, source in zip(*columns)
            if finder.known(t_ns, connection, source, memoryview(buffers[block])[payload:end])
        ]


def _connection_records(connections: Dict[int, Connection]) -> bytes:
    return b"".join(
        connection_record(number, each.topic.encode("utf-8", "surrogateescape"), each.header)
        for number, each in sorted(connections.items())
    )


def _slices(rows: Rows, cut: Cut, buffers: Dict[int, Any]) -> List[memoryview]:
    """Return the records of a chunk, neighbours in a buffer in one piece."""
    chosen = slice(cut.first, cut.last)
    start, end, block = rows.start[chosen], rows.end[chosen], rows.block[chosen]
    breaks = np.flatnonzero((start[1:] != end[:-1]) | (block[1:] != block[:-1])) + 1
    first = np.concatenate(([0], breaks))
    last = np.append(breaks, len(start)) - 1
    views = {number: memoryview(buffers[number]) for number in np.unique(block).tolist()}
    pieces = zip(start[first].tolist(), end[last].tolist(), block[first].tolist())
    return [views[number][begin:stop] for begin, stop, number in pieces]
