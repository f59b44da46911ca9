"""What can be kept of one chunk whose index or data cannot be trusted."""

from __future__ import annotations

import struct
from itertools import groupby
from operator import itemgetter
from typing import Dict, Iterable, List, NamedTuple, Sequence, Tuple

from .errors import RecordError
from .format import (
    CONNECTION,
    LARGEST_HEADER,
    MESSAGE,
    Buffer,
    Connection,
    Record,
    connection_of,
    connection_record,
    index_header,
    pack_time,
    record_at,
)

__all__ = ["Kept", "Row", "Walk", "kept_by_index", "kept_by_walk", "rewritten", "walk"]

# --- records in a row -------------------------------------------------------------------------------------------------


class Walk(NamedTuple):
    """What was found in a chunk without its index.

    Args:
        messages: (time, connection, offset) in the order of the chunk.
        connections: by number.
        end: of the last whole record.
    """

    messages: List[Tuple[int, int, int]]
    connections: Dict[int, Connection]
    end: int


def walk(buffer: Buffer) -> Walk:
    """Return the records at the beginning of a chunk, up to the first that is cut or none."""
    found = Walk([], {}, 0)
    position, limit = 0, len(buffer)
    while position < limit:
        try:
            record = record_at(buffer, position, limit)
            if record.end > limit or not _taken(found, record, position, buffer):
                break
        except RecordError:
            break
        position = record.end
    return found._replace(end=position)


def _taken(found: Walk, record: Record, position: int, buffer: Buffer) -> bool:
    if record.op == MESSAGE:
        found.messages.append((record.time_ns(b"time"), record.number(b"conn"), position))
    elif record.op == CONNECTION and record.size <= LARGEST_HEADER:
        connection = connection_of(record, bytes(buffer[record.data : record.end]))
        found.connections.setdefault(connection.number, connection)
    else:
        return False
    return True


# --- what can be kept -------------------------------------------------------------------------------------------------


_ZEROS = 16  # that many at the end of a message before a run of zeros: it may not be whole
_RUN = 4096

_OFFSET = struct.Struct("<L")

Row = Tuple[int, int, int]  # time, connection, offset


class Kept(NamedTuple):
    """Messages that are good, in the order of the chunk, and connections that the chunk describes.

    Args:
        rows: (time, connection, offset).
        connections: by number.
        end: of the last whole record; all of the chunk's size when nothing is missing.
    """

    rows: List[Row]
    connections: Dict[int, Connection]
    end: int

    def counts(self) -> Tuple[Tuple[int, int], ...]:
        """Count messages by connection."""
        counts: Dict[int, int] = {}
        for _, connection, _ in self.rows:
            counts[connection] = counts.get(connection, 0) + 1
        return tuple(sorted(counts.items()))

    def times(self) -> Tuple[int, int]:
        """Return the earliest and the latest time."""
        times = [row[0] for row in self.rows]
        return min(times), max(times)

    def index_bytes(self) -> bytes:
        """Return the index records of the chunk."""
        ordered = sorted((connection, t_ns, offset) for t_ns, connection, offset in self.rows)
        parts: List[bytes] = []
        for number, group in groupby(ordered, key=itemgetter(0)):
            entries = [pack_time(t_ns) + _OFFSET.pack(offset) for _, t_ns, offset in group]
            parts += [index_header(number, len(entries)), *entries]
        return b"".join(parts)

    def without(self, unknown: Iterable[int]) -> Kept:
        """Return this without the messages of some connections."""
        numbers = set(unknown)
        return self._replace(rows=[row for row in self.rows if row[1] not in numbers])


def kept_by_walk(data: Buffer) -> Kept:
    """Return what lies at the beginning of a chunk, up to the first record that is cut or none."""
    found = walk(data)
    kept = Kept(found.messages, found.connections, found.end)
    return _without_suspect(kept, data)


def _without_suspect(kept: Kept, data: Buffer) -> Kept:
    """Drop a last message that ends in zeros before zeros: it may not have been written before a power loss."""
    rest = bytes(data[kept.end : kept.end + _RUN])
    if not kept.rows or len(rest) < 4 or any(rest) or any(bytes(data[kept.end - _ZEROS : kept.end])):  # noqa: PLR2004
        return kept
    return kept._replace(rows=kept.rows[:-1], end=kept.rows[-1][2])


def kept_by_index(data: Buffer, rows: Sequence[Row]) -> Kept:
    """Return the messages of an index that are really there, each judged by itself."""
    rows = sorted(rows, key=itemgetter(2))
    limits = [*(row[2] for row in rows[1:]), len(data)]
    good = [row for row, limit in zip(rows, limits) if _is_good(data, row, limit)]
    return Kept(good, walk(data).connections, len(data))


def _is_good(data: Buffer, row: Row, limit: int) -> bool:
    t_ns, connection, offset = row
    try:
        record = record_at(data, offset, min(limit, len(data)))
        said = record.op, record.number(b"conn"), record.time_ns(b"time")
    except (RecordError, struct.error):
        return False
    return said == (MESSAGE, connection, t_ns) and record.end <= limit


def rewritten(data: Buffer, kept: Kept) -> Tuple[bytes, Kept]:
    """Return the data of a new chunk with these messages alone, and what is where in it."""
    parts = [
        connection_record(number, each.topic.encode("utf-8", "surrogateescape"), each.header)
        for number, each in sorted(kept.connections.items())
    ]
    size = sum(len(part) for part in parts)
    rows = []
    for t_ns, connection, offset in kept.rows:
        part = bytes(data[offset : record_at(data, offset, len(data)).end])
        rows.append((t_ns, connection, size))
        parts.append(part)
        size += len(part)
    return b"".join(parts), Kept(rows, kept.connections, size)
