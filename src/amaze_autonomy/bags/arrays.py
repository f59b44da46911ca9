"""Index entries and message records of chunks as arrays, checked as a whole.

Messages are never decoded and, in a good chunk, never touched one by one: where a record starts is in the index, its
lengths are gathered from all places at once. Every byte of the chunk must then belong to a message of the index or to a
connection, and each message must say the connection and time that the index says.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from functools import lru_cache
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Tuple

import numpy as np

from amaze_autonomy.units import SECOND

from .errors import RecordError
from .format import (
    CONNECTION,
    INDEX_ENTRY,
    MESSAGE,
    Buffer,
    Connection,
    connection_of,
    index_header,
    record_at,
    u32,
)
from .index import (
    OTHERWISE,
    Index,
    Messages,
    contradicts,
    require,
    unusable,
)

# --- index and buffers as arrays --------------------------------------------------------------------------------------


def words(buffer: Any) -> Any:
    """Return the four-byte numbers that start at *every* byte of a buffer, writable if the buffer is."""
    return np.ndarray((max(len(buffer) - 3, 0),), "<u4", buffer, 0, (1,))


def distinct(numbers: Any) -> List[int]:
    """Return the different ones of an array, in order; np.unique would load numpy.ma, a fifth of a short run."""
    ordered = np.sort(numbers)
    found: List[int] = ordered[:1].tolist() + ordered[1:][ordered[1:] != ordered[:-1]].tolist()
    return found


def index_data(connection: int, t_ns: Any, offsets: Any) -> bytes:
    """Return the index of one connection's messages in one chunk."""
    entries: Any = np.empty((len(t_ns), 3), "<u4")
    entries[:, 0], entries[:, 1] = np.divmod(t_ns, SECOND)
    entries[:, 2] = offsets
    return index_header(connection, len(t_ns)) + bytes(entries.tobytes())


def index_records(t_ns: Any, connection: Any, offsets: Any) -> bytes:
    """Return the index of all messages of one chunk, given as arrays in any order."""
    order = np.lexsort((offsets, t_ns, connection))
    numbers: Any = connection[order]
    firsts = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
    parts = np.split(order, firsts) if len(order) else []
    parts_of = zip(distinct(numbers), parts)
    return b"".join([index_data(number, t_ns[each], offsets[each]) for number, each in parts_of])


def joined_parts(parts: List[Tuple[int, Any]]) -> Tuple[Any, Any, Any]:
    """Return times, connections and offsets of entries."""
    entries: Any = np.frombuffer(b"".join([part for _, part in parts]), "<u4").reshape(-1, 3).astype(np.int64)
    numbers: Any = np.array([connection for connection, _ in parts], np.int64)
    return (
        entries[:, 0] * SECOND + entries[:, 1],
        np.repeat(numbers, [len(part) // INDEX_ENTRY for _, part in parts]),
        entries[:, 2],
    )


def by_connection(connection: Any) -> Dict[int, Any]:
    """Return the places of each number in an array."""
    small = connection.astype(np.uint16) if len(connection) and connection.max() < 1 << 16 else connection
    order = np.argsort(small, kind="stable")  # of small numbers in no time
    ordered = connection[order]
    firsts = np.flatnonzero(np.diff(ordered, prepend=-1))
    return dict(zip(ordered[firsts].tolist(), np.split(order, firsts[1:])))


def repeated(numbers: List[int], counts: List[int]) -> Any:
    """Return an array that has each number as often as its count says."""
    return np.repeat(np.array(numbers, np.int64), counts)


def check_times(index: Index, numbers: List[int], t_ns: Any) -> None:
    """Check that messages lie in the time that the bag's index says of their chunk; a longer one passes nothing over.

    Args:
        index: of the bag.
        numbers: of chunks.
        t_ns: times of all their messages, chunk by chunk.

    Raises:
        BagError: One does not: who goes by the times of chunks would miss it, or come to it too late.
    """
    chunks = [index.chunks[number] for number in numbers]
    counts = [chunk.messages for chunk in chunks]
    first = repeated([chunk.start_ns for chunk in chunks], counts)
    last = repeated([chunk.end_ns for chunk in chunks], counts)
    outside = np.flatnonzero((t_ns < first) | (t_ns > last))
    if len(outside):
        wrong = RecordError("it has a message outside of the time that the bag's index says")
        position = chunks[int(np.searchsorted(np.cumsum(counts), outside[0], "right"))].position
        raise unusable(index.path, position, wrong)


def check_index(index: Index) -> Messages:
    """Return all messages, as `Index.messages` does, and check their times.

    Raises:
        BagError: The index behind a chunk is damaged, or says other times than the bag's.
    """
    messages = index.messages()
    if len(messages.t_ns):
        check_times(index, distinct(messages.chunk), messages.t_ns)
    return messages


# --- message records as arrays ----------------------------------------------------------------------------------------


_WORD = 4
_LONGEST = 128  # bytes of a header; what recorders write has 50

Connections = Dict[int, Connection]  # by number, as the bag's index has them


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


def tabulate(
    buffer: Buffer, spans: List[Span], t_ns: Any, connection: Any, start: Any, known: Optional[Connections] = None
) -> Table:
    """Return the messages of chunks in a buffer; `start` are their places in the buffer.

    Raises:
        RecordError: Index and data contradict each other.
    """
    order = np.argsort(start, kind="stable")
    begins: Any
    ends: Any
    begins, ends = (np.array(each, np.int64) for each in ([span.start for span in spans], [span.end for span in spans]))
    return tabulated(buffer, begins, ends, t_ns[order], connection[order], start[order], known)


def tabulated(
    buffer: Buffer, begins: Any, ends: Any, t_ns: Any, connection: Any, start: Any, known: Optional[Connections] = None
) -> Table:
    """Return the same of stretches given by where they begin and end; messages in the order of their places.

    Raises:
        RecordError: Index and data contradict each other.
    """
    table = columns(buffer, t_ns, connection, start)
    _check_tiling(buffer, begins, ends, table, known or {})
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
    said_ns = header["seconds"].astype(np.int64) * SECOND + header["fraction"]
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
    if not ((said[0] == connection).all() and (said[1].astype(np.int64) * SECOND + said[2] == t_ns).all()):
        raise RecordError("a message is another one than the index says")
    return Table(t_ns, connection, start, payload, end, (-1, -1))


def _layout(buffer: Buffer, start: int) -> Tuple[Tuple[int, int], List[Tuple[int, int]], int]:
    """Return where connection and time are in a message, all four-byte numbers of the rest of its header, its size.

    None of them of a long header, which is never that of all messages (merge/lz4_chunk_copy.py writes such).
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
        seconds, fraction = divmod(record.time_ns(b"time"), SECOND)
        rows.append((record.number(b"conn"), seconds, fraction))
    said: Any = np.array(rows, np.int64)
    return said[:, 0], said[:, 1], said[:, 2]


def _check_tiling(buffer: Buffer, begins: Any, ends: Any, table: Table, known: Connections) -> None:
    """Check that messages and connections fill the chunks, and that no message is missing from the index."""
    place: Any = np.append(np.searchsorted(table.start, begins), len(table.start))  # of each chunk's first message
    filled = np.flatnonzero(place[1:] > place[:-1])
    follows: Any = np.append(table.start[1:], 0)  # a message ends where the next begins, or with its chunk
    follows[place[1:][filled] - 1] = ends[filled]
    otherwise: List[Tuple[int, Connection]] = []
    for gap in np.flatnonzero(table.end != follows).tolist():
        otherwise += _check_connections(buffer, int(table.end[gap]), int(follows[gap]), known)
    begun = ends.copy()
    begun[filled] = table.start[place[:-1][filled]]
    for each in np.flatnonzero(begun != begins).tolist():
        otherwise += _check_connections(buffer, int(begins[each]), int(begun[each]), known)
    _check_described(otherwise, begins, place, table, known)


def _check_connections(buffer: Buffer, start: int, end: int, known: Connections) -> List[Tuple[int, Connection]]:
    """Check that nothing but connections is there; return those that the index has otherwise, and their places."""
    otherwise = []
    while start < end:
        record = record_at(buffer, start, end)
        if record.op != CONNECTION:
            raise RecordError("a message in it is missing from the index")
        if known:
            with suppress(RecordError):  # what cannot be read contradicts nothing
                number, header = record.number(b"conn"), bytes(buffer[record.data : record.end])
                if number in known and not known[number].is_of(record, header):
                    otherwise.append((start, connection_of(record, header)))
        start = record.end
    if start != end:
        raise RecordError("its records overlap")
    return otherwise


def _check_described(
    otherwise: List[Tuple[int, Connection]], begins: Any, place: Any, table: Table, known: Connections
) -> None:
    """Check what chunks say of connections in other words than the bag's index: the same ones must be meant."""
    names = {each.name for each in known.values()} if otherwise else set()
    used: Dict[int, List[int]] = {}
    for at, described in otherwise:
        chunk = int(np.searchsorted(begins, at, "right")) - 1
        if chunk not in used:
            used[chunk] = distinct(table.connection[place[chunk] : place[chunk + 1]])
        require(not contradicts(described, known[described.number], names, used[chunk]), OTHERWISE)


def relabel(buffer: Any, table: Table, connection: Any, shift_ns: int) -> Table:
    """Write other connection numbers, and times shifted, into the messages of a writable buffer; return their table."""
    t_ns = table.t_ns + shift_ns
    if table.fields[0] >= 0:
        numbers = words(buffer)
        numbers[table.start + table.fields[0]] = connection
        if shift_ns:
            numbers[table.start + table.fields[1]], numbers[table.start + table.fields[1] + 4] = np.divmod(t_ns, SECOND)
    else:
        for start, number, time in zip(table.start.tolist(), connection.tolist(), t_ns.tolist()):
            at = _layout(buffer, start)[0]
            struct.pack_into("<L", buffer, start + at[0], number)
            struct.pack_into("<LL", buffer, start + at[1], *divmod(time, SECOND))
    return table._replace(t_ns=t_ns, connection=connection)


# --- a clock that was set back ----------------------------------------------------------------------------------------
# A recorder writes messages as they come. Where a later one has an earlier time its clock was set, and what readers put
# in order of time lies one over the other. Each connection is looked at alone: a converter may write topic by topic.


UNSET_NS = SECOND // 10  # writers with several threads are not late by as much


class SetBack(NamedTuple):
    """A recorder's clock that was set back.

    Args:
        by_ns: how far at least: from a message to the next one of its connection.
        from_ns: first time at which there are messages of before and of after it.
        to_ns: last such time: that of the last message before it.
    """

    by_ns: int
    from_ns: int
    to_ns: int

    def words(self, start_ns: int) -> str:
        """Return it as a sentence; times count from `start_ns`."""
        from_s, to_s = ((t_ns - start_ns) / SECOND for t_ns in (self.from_ns, self.to_ns))
        return (
            f"its clock was set back by {self.by_ns / SECOND:.3f} s or more at {to_s:+.3f} s: what was recorded before "
            f"and after lies at the same times, from {from_s:+.3f} s on, where no silence can be seen"
        )


def set_back(connections: Iterable[Tuple[Any, Any, Any]]) -> Optional[SetBack]:
    """Return whether a clock was set back while a file was recorded; no data is read.

    Args:
        connections: of each the times of its messages, their chunks (in the order of the file), and offsets in them.
    """
    steps = [step for step in (_step(*each) for each in connections if len(each[0]) > 1) if step is not None]
    if not steps:
        return None
    by_ns, from_ns, to_ns = zip(*steps)
    return SetBack(max(by_ns), min(from_ns), max(to_ns))


def _step(t_ns: Any, chunk: Any, offset: Any) -> Optional[SetBack]:
    far = np.diff(chunk)
    if bool(((far < 0) | ((far == 0) & (np.diff(offset) < 0))).any()):
        t_ns = t_ns[np.lexsort((offset, chunk))]
    if bool((np.diff(t_ns) >= 0).all()):
        return None
    latest = np.maximum.accumulate(t_ns)
    late = np.flatnonzero(latest - t_ns > UNSET_NS)
    if not len(late):
        return None
    return SetBack(int((latest - t_ns).max()), int(t_ns[late].min()), int(latest[late].max()))
