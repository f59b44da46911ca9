"""What can be kept of bytes that are, or were, the data of a chunk: records are found again behind what is damaged.

Each record stands behind the length of the one before it, so that one wrong byte hides all that follow. They are found
again by what a header looks like. A header is believed when another record, or the end, stands where its record ends;
or when the index, where there is one, has a message of its time and connection. It is then known of the message before
the damage whether it is whole:

    the next header stands inside of it            bytes are missing, or its length is wrong: it is dropped
    the index says that one begins where it ends   it is whole, and what follows is damaged
    what follows it looks like no header           its length is wrong: it is dropped
    it ends in zeros, and zeros follow             a page was lost: it is dropped

So damage costs the messages that it touches. The format has no checksums: a wrong byte in the payload of a message that
is not compressed cannot be seen by anybody.
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_left, bisect_right
from collections import Counter
from itertools import groupby
from operator import itemgetter
from typing import Dict, FrozenSet, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

from ..errors import RecordError
from ..format import (
    CONNECTION,
    MESSAGE,
    Buffer,
    Connection,
    Record,
    connection_of,
    connection_record,
    index_header,
    pack_time,
    record_at,
    u32,
)

_ZEROS = 16  # that many at the end of a message before zeros: it may not be whole
_HEADER = 64  # bytes in which a message's header has all its fields
_BEFORE = 300  # bytes of a header before the field that says what it is: a topic may stand there
_SHORTEST, _LONGEST = 8, 4096  # bytes of a header that is searched for
_WITNESSES = 2  # records in a row that are believed without an index
_FIELDS = re.compile(rb"(conn|time|op|topic)=")
_OFFSET = struct.Struct("<L")
_BROKEN = (RecordError, struct.error, ValueError, IndexError)

Row = Tuple[int, int, int]  # time, connection, offset


class Kept(NamedTuple):
    """Messages that are good, in their order, and connections that are described among them.

    Args:
        rows: (time, connection, offset).
        connections: by number.
        end: of the last whole record; all of the data when nothing is missing.
        gaps: where nothing good was found: beginnings and ends.
        others: connections that are described with the number of another one before them.
    """

    rows: List[Row]
    connections: Dict[int, Connection]
    end: int
    gaps: Sequence[Tuple[int, int]] = ()
    others: Tuple[Connection, ...] = ()

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


def salvaged(data: Buffer, rows: Optional[Sequence[Row]] = None) -> Kept:
    """Return what is good in the data of a chunk.

    Args:
        data: of it; what is behind the last whole record is no gap when nothing good follows.
        rows: what the index says of its messages; None when nobody knows.
    """
    return _Salvage(data, rows).run()


class _Salvage:
    def __init__(self, data: Buffer, rows: Optional[Sequence[Row]]) -> None:
        self._data, self._limit, self._index = data, len(data), rows or ()
        self._starts: FrozenSet[int] = frozenset(row[2] for row in rows or ())
        self._order = sorted(self._starts)
        self._said = frozenset(row[:2] for row in rows or ())
        self._connections: Dict[int, Connection] = {}
        self._others: List[Connection] = []
        self._gaps: List[Tuple[int, int]] = []
        self._rows: List[Row] = []
        self._ends: List[int] = []  # of the messages

    def run(self) -> Kept:
        position = self._walked(0)
        while position < self._limit:
            begin, found = self._next(position)
            self._gaps.append((begin, found))
            position = self._walked(found)
        end = self._gaps[-1][0] if self._gaps and self._gaps[-1][1] == self._limit else self._limit
        self._drop_contradictions()
        return Kept(self._rows, self._connections, end, sorted(self._gaps), tuple(self._others))

    def _drop_contradictions(self) -> None:
        """Drop messages whose header is damaged, by what the index says of the same place.

        An index record has one connection for many messages: where one of them says another, it is the one that is
        wrong. A time out of all times of the index is wrong; another one may as well be that of the index.
        """
        said = {offset: (t_ns, connection) for t_ns, connection, offset in self._index}
        pairs = [(row, said[row[2]]) for row in self._rows if row[:2] not in self._said and row[2] in said]
        agreeing = sum(said.get(offset) == (t_ns, connection) for t_ns, connection, offset in self._rows)
        if agreeing <= len(pairs):  # there are none, or the index is that of other data
            return
        members = Counter(connection for _, connection, _ in self._index)
        other = Counter(there[1] for row, there in pairs if row[1] != there[1])
        first, last = min(self._index)[0], max(self._index)[0]
        dropped = {
            row
            for row, there in pairs
            if (row[1] != there[1] and 2 * other[there[1]] < members[there[1]]) or not first <= row[0] <= last
        }
        self._gaps += [(row[2], row[2]) for row in dropped]
        self._rows = [row for row in self._rows if row not in dropped]

    def _walked(self, position: int) -> int:
        """Take records one after another; return where the first one begins that is none."""
        while position < self._limit:
            record = self._record(position)
            if record is None or self._swallows(position, record.end):
                break
            self._take(record, position)
            position = record.end
        return position

    def _record(self, position: int) -> Optional[Record]:
        """Return the message or the connection at a place; None when there is no whole one."""
        try:
            record = record_at(self._data, position, self._limit)
            if record.end > self._limit or record.op not in (MESSAGE, CONNECTION):
                return None
            record.number(b"conn")
            if record.op == MESSAGE:
                record.time_ns(b"time")
        except _BROKEN:
            return None
        return record

    def _swallows(self, position: int, end: int) -> bool:
        """Return whether a record reaches over another one that the index knows of, so that its length is wrong."""
        first, last = bisect_right(self._order, position), bisect_left(self._order, end)
        return any(self._record(start) for start in self._order[first:last])

    def _take(self, record: Record, position: int) -> None:
        if record.op == MESSAGE:
            self._rows.append((record.time_ns(b"time"), record.number(b"conn"), position))
            self._ends.append(record.end)
            return
        try:
            connection = connection_of(record, bytes(self._data[record.data : record.end]))
        except RecordError:
            return  # it may be described elsewhere
        if self._connections.setdefault(connection.number, connection).name != connection.name:
            self._others.append(connection)

    def _next(self, position: int) -> Tuple[int, int]:
        """Return where, at a place that is no good record, nothing good begins, and where it ends; drop what is torn.

        It ends behind the place, or a message that was taken is dropped: else the search would not end.
        """
        last = self._rows[-1][2] if self._ends and self._ends[-1] == position else None
        if last is None:
            return position, self._search(position + 1)
        found = self._search(record_at(self._data, last, self._limit).data)
        if found == position:  # a message with a wrong length, that the index knows
            found = self._search(position + 1)
        if found < position or not self._is_whole(last, position, found):
            self._rows.pop()
            self._ends.pop()
            return last, found
        return position, found

    def _is_whole(self, start: int, end: int, found: int) -> bool:
        """Return whether the message that ends before damage has the right length."""
        if end in self._starts:
            return True
        behind = bytes(self._data[end : min(found, end + _HEADER)])
        if not any(behind[:4]):
            return len(behind) < 4 or any(bytes(self._data[end - _ZEROS : end]))  # noqa: PLR2004
        if found == self._limit and self._limit - end < _HEADER:
            return True  # the beginning of a header, or of nothing
        return behind[:4] == self._data[start : start + 4] or _FIELDS.search(behind) is not None

    def _search(self, begin: int) -> int:
        """Return where the next record begins, or the end."""
        for start in headers(self._data, begin, (MESSAGE, CONNECTION)):
            if self._is_believed(start):
                return start
        return self._limit

    def _is_believed(self, start: int) -> bool:
        for _ in range(_WITNESSES):
            record = self._record(start)
            if record is None:
                return False
            if record.op == MESSAGE and (record.time_ns(b"time"), record.number(b"conn")) in self._said:
                return True
            if record.end == self._limit:
                return True
            start = record.end
        return True


def headers(data: Buffer, begin: int, kinds: Sequence[int]) -> Iterator[int]:
    """Yield the places, from one on, at which a header of some kinds of records may stand."""
    fields = re.compile(rb"\x04\0\0\0op=[" + b"".join(re.escape(bytes([kind])) for kind in kinds) + b"]")
    last = begin - 1
    for match in fields.finditer(data, begin):
        for start in range(match.start() - 4, max(last, match.start() - 4 - _BEFORE, -1), -1):
            size = u32(data, start)
            if _SHORTEST <= size <= _LONGEST and start + 4 + size >= match.end() and _is_header(data, start, size):
                yield start
                last = start
                break


def _is_header(data: Buffer, start: int, size: int) -> bool:
    """Return whether the lengths of fields fill a header."""
    place, end = start + 4, start + 4 + size
    if end + 4 > len(data):
        return False
    while place + 4 <= end:
        place += 4 + u32(data, place)
    return place == end


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
