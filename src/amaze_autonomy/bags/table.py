"""Message records of whole chunks as arrays, checked against the index; checked.

Messages are never decoded and, in a good chunk, never touched one by one: where a record starts is in the index, its
lengths are gathered from all places at once. Every byte of the chunk must then belong to a message of the index or to a
connection, and each message must say the connection and time that the index says.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any, List, NamedTuple, Optional, Tuple

import numpy as np

from .arrays import words
from .errors import RecordError
from .layout import CONNECTION, MESSAGE, Buffer, record_at, u32

__all__ = ["Span", "Table", "columns", "relabel", "tabulate", "tabulated"]

_WORD = 4
_LONGEST = 128  # bytes of a header; what recorders write has 50


class Table(NamedTuple):
    """Messages in the order of a buffer, as arrays of one length.

    Args:
        t_ns: record times.
        connection: numbers.
        start: of the record in the buffer.
        payload: where its data starts.
        end: of the record.
        fields: where in the header the values of connection and time are, the same for all; or -1, -1.
    """

    t_ns: Any
    connection: Any
    start: Any
    payload: Any
    end: Any
    fields: Tuple[int, int]


class Span(NamedTuple):
    """The data of a chunk in a buffer."""

    start: int
    end: int


def tabulate(buffer: Buffer, spans: List[Span], t_ns: Any, connection: Any, start: Any) -> Table:
    """Return the messages of chunks in a buffer; `start` are their places in the buffer.

    Raises:
        RecordError: Index and data contradict each other.
    """
    order = np.argsort(start, kind="stable")
    begins, ends = (np.array(each, np.int64) for each in ([span.start for span in spans], [span.end for span in spans]))
    return tabulated(buffer, begins, ends, t_ns[order], connection[order], start[order])


def tabulated(buffer: Buffer, begins: Any, ends: Any, t_ns: Any, connection: Any, start: Any) -> Table:
    """Return the same of stretches given by where they begin and end; messages in the order of their places.

    Raises:
        RecordError: Index and data contradict each other.
    """
    table = columns(buffer, t_ns, connection, start)
    _check_tiling(buffer, begins, ends, table)
    return table


def columns(buffer: Buffer, t_ns: Any, connection: Any, start: Any) -> Table:
    """Return the table of messages that start at these places.

    Raises:
        RecordError: One does not, or is another one than the index says.
    """
    if not len(start):
        return Table(t_ns, connection, start, start, start, (-1, -1))
    found = _alike(buffer, t_ns, connection, start)
    return _each(buffer, t_ns, connection, start) if found is None else found


def _alike(buffer: Buffer, t_ns: Any, connection: Any, start: Any) -> Optional[Table]:
    """Return the table of messages whose headers are the same but for connection and time, as the index says them.

    Returns:
        None when something is otherwise.
    """
    try:
        fields, fixed, size = _layout(buffer, int(start[0]))
        at_each_byte: Any = np.ndarray((max(0, len(buffer) - size + 1),), f"V{size}", buffer, 0, (1,))
        header = at_each_byte[start].view(_header_type(fields, tuple(place for place, _ in fixed), size))
    except (RecordError, struct.error, IndexError):
        return None
    if not fixed or not all((header[f"at {place}"] == value).all() for place, value in fixed):
        return None
    said_ns = header["seconds"].astype(np.int64) * 1_000_000_000 + header["fraction"]
    if not ((header["connection"] == connection).all() and (said_ns == t_ns).all()):
        return None
    payload = start + size
    return Table(t_ns, connection, start, payload, payload + header["size"], fields)


@lru_cache(maxsize=16)
def _header_type(fields: Tuple[int, int], places: Tuple[int, ...], size: int) -> Any:
    """Return numpy's type of a header with the length of the data behind it."""
    connection, time = fields
    offsets = {"connection": connection, "seconds": time, "fraction": time + 4, "size": size - 4}
    offsets.update({f"at {place}": place for place in places})
    names, formats = list(offsets), ["<u4"] * len(offsets)
    return np.dtype({"names": names, "formats": formats, "offsets": list(offsets.values()), "itemsize": size})


def _each(buffer: Buffer, t_ns: Any, connection: Any, start: Any) -> Table:
    """Return the table of messages of several writers, header by header."""
    numbers = words(buffer)
    try:
        payload = start + 8 + numbers[start].astype(np.int64)
        end = payload + numbers[payload - 4]
    except IndexError:
        raise RecordError("the index points behind its end") from None
    said = _said_one_by_one(buffer, start.tolist())
    if not ((said[0] == connection).all() and (said[1].astype(np.int64) * 1_000_000_000 + said[2] == t_ns).all()):
        raise RecordError("a message is another one than the index says")
    return Table(t_ns, connection, start, payload, end, (-1, -1))


def _layout(buffer: Buffer, start: int) -> Tuple[Tuple[int, int], List[Tuple[int, int]], int]:
    """Return where connection and time are in a message, all four-byte numbers of the rest of its header, its size.

    None of them of a long header, which is never that of all messages (wrapping.py writes such).
    """
    record = record_at(buffer, start, len(buffer))
    header = bytes(buffer[start : record.data - 4])
    fields = header.find(b"\x09\0\0\0conn=") + 9, header.find(b"\x0d\0\0\0time=") + 9
    if record.op != MESSAGE or min(fields) < 9:  # noqa: PLR2004  (not found)
        raise RecordError("the index points at a record that is no message")
    if len(header) > _LONGEST:
        return fields, [], len(header) + _WORD
    connection, time = fields
    first, second = sorted(((connection, connection + 4), (time, time + 8)))
    places: List[int] = []
    for begin, end in ((0, first[0]), (first[1], second[0]), (second[1], len(header))):
        if end - begin >= _WORD:
            places += [*range(begin, end - 3, 4), end - 4]
    return fields, [(place, u32(header, place)) for place in places], len(header) + _WORD


def _said_one_by_one(buffer: Buffer, starts: List[int]) -> Tuple[Any, Any, Any]:
    rows = []
    for start in starts:
        record = record_at(buffer, start, len(buffer))
        if record.op != MESSAGE:
            raise RecordError("the index points at a record that is no message")
        seconds, fraction = divmod(record.time_ns(b"time"), 1_000_000_000)
        rows.append((record.number(b"conn"), seconds, fraction))
    said = np.array(rows, np.int64)
    return said[:, 0], said[:, 1], said[:, 2]


def _check_tiling(buffer: Buffer, begins: Any, ends: Any, table: Table) -> None:
    """Check that messages and connections fill the chunks, and that no message is missing from the index."""
    place: Any = np.append(np.searchsorted(table.start, begins), len(table.start))  # of each chunk's first message
    filled = np.flatnonzero(place[1:] > place[:-1])
    follows: Any = np.append(table.start[1:], 0)  # a message ends where the next begins, or with its chunk
    follows[place[1:][filled] - 1] = ends[filled]
    for gap in np.flatnonzero(table.end != follows).tolist():
        _check_connections(buffer, int(table.end[gap]), int(follows[gap]))
    begun = ends.copy()
    begun[filled] = table.start[place[:-1][filled]]
    for each in np.flatnonzero(begun != begins).tolist():
        _check_connections(buffer, int(begins[each]), int(begun[each]))


def _check_connections(buffer: Buffer, start: int, end: int) -> None:
    while start < end:
        record = record_at(buffer, start, end)
        if record.op != CONNECTION:
            raise RecordError("a message in it is missing from the index")
        start = record.end
    if start != end:
        raise RecordError("its records overlap")


def relabel(buffer: Any, table: Table, connection: Any, shift_ns: int) -> Table:
    """Write other connection numbers, and times shifted, into the messages of a writable buffer; return their table."""
    t_ns = table.t_ns + shift_ns
    if table.fields[0] >= 0:
        numbers = words(buffer)
        numbers[table.start + table.fields[0]] = connection
        if shift_ns:
            numbers[table.start + table.fields[1]], numbers[table.start + table.fields[1] + 4] = np.divmod(
                t_ns, 1_000_000_000
            )
    else:
        for start, number, time in zip(table.start.tolist(), connection.tolist(), t_ns.tolist()):
            at = _layout(buffer, start)[0]
            struct.pack_into("<L", buffer, start + at[0], number)
            struct.pack_into("<LL", buffer, start + at[1], *divmod(time, 1_000_000_000))
    return table._replace(t_ns=t_ns, connection=connection)
