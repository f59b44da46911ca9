"""The index of a bag: topics, times and places of all messages, without reading the messages.

What stands behind each chunk can be told without numpy, so that a recovery starts at once; arrays are in `read`.
"""

from __future__ import annotations

import os
import shlex
import struct
import sys
from array import array
from pathlib import Path
from typing import Any, Container, Dict, Iterator, List, NamedTuple, Optional, Tuple

from amaze_autonomy.units import SECOND

from .errors import BagError, NotABagError, NotClosedError, OtherBagError, RecordError
from .format import (
    BAG,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX,
    INDEX_ENTRY,
    LARGEST_HEADER,
    MAGIC,
    MEMORY,
    Buffer,
    Connection,
    Name,
    Record,
    check_memory,
    connection_of,
    foreign,
    index_record_at,
    read_at,
    record_at,
)
from .recover.salvage import Row, headers

# --- index records behind a chunk -------------------------------------------------------------------------------------


class Entries(NamedTuple):
    """Times and offsets of messages, as index records have them.

    Args:
        parts: connection and bytes of each record.
        end: where the last one ends in the file.
        trusted: whether it is certain that they are all.
        foreign: whether one has fields in another order than ours.
    """

    parts: Tuple[Tuple[int, bytes], ...]
    end: int
    trusted: bool
    foreign: bool

    @property
    def messages(self) -> int:
        """Count the messages."""
        return sum(len(data) for _, data in self.parts) // INDEX_ENTRY

    def counts(self) -> Tuple[Tuple[int, int], ...]:
        """Count messages by connection."""
        counts: Dict[int, int] = {}
        for number, data in self.parts:
            if data:
                counts[number] = counts.get(number, 0) + len(data) // INDEX_ENTRY
        return tuple(sorted(counts.items()))

    def times(self) -> Tuple[int, int]:
        """Return the earliest and the latest time; only when there is a message."""
        words = [_words(data) for _, data in self.parts if data]
        earliest = min(_edge(each[0::3], each[1::3], min) for each in words)
        latest = max(_edge(each[0::3], each[1::3], max) for each in words)
        return earliest, latest

    def rows(self) -> Iterator[Row]:
        """Return (time, connection, offset) of each message."""
        for number, data in self.parts:
            for seconds, fraction, offset in struct.iter_unpack("<3L", data):
                yield seconds * SECOND + fraction, number, offset

    def columns(self) -> Tuple[Any, Any, Any]:
        """Return times, connections and offsets as arrays."""
        from .arrays import joined_parts  # noqa: PLC0415  (needs numpy)

        return joined_parts(list(self.parts))


def _words(data: bytes) -> Any:
    found = array("I", data)
    if sys.byteorder == "big":
        found.byteswap()
    return found


def _edge(seconds: Any, fractions: Any, choose: Any) -> int:
    """Return the earliest or the latest time: in a good index one of a few that lie side by side."""
    second = choose(seconds)
    first, count = seconds.index(second), seconds.count(second)
    if seconds[first : first + count].count(second) == count:
        return int(second * SECOND + choose(fractions[first : first + count]))
    return int(second * SECOND + choose(part for each, part in zip(seconds, fractions) if each == second))


# --- the index of a bag -----------------------------------------------------------------------------------------------


_HEAD_BYTES = 4096  # of a chunk's header and of the bag's: more than any writer's
LARGEST_NUMBER = 1 << 20  # of a connection: recorders count from 0; we have tables by number
KEEP_GOOD = "keep what is good with `amaze-bag recover --check-data`"
_PIECE = 1 << 20
_LARGE_INDEX = 64 << 20  # bytes: a hundred for each chunk, so that hardly one has as many
_BEHIND = (INDEX, CHUNK, CHUNK_INFO)  # what a chunk's data, or an index record's, is followed by
LOST_RETURNS = (
    "git's conversion of line endings made every CR LF an LF: where bytes were lost cannot be told for certain"
)
_FETCH = "put `*.bag binary` into .gitattributes and get the original again (`amaze-bag recover` keeps what is whole)"

IndexPart = Tuple[int, memoryview]  # connection, entries of it


class ChunkInfo(NamedTuple):
    """What the index says of a chunk: bytes of the file from `position` to `end`, times, messages by connection."""

    position: int
    end: int
    start_ns: int
    end_ns: int
    counts: Tuple[Tuple[int, int], ...]

    @property
    def messages(self) -> int:
        """Count all of them."""
        return sum(count for _, count in self.counts)


class ChunkHead(NamedTuple):
    """What a chunk says of itself; `data` is where its data starts: `stored` bytes that decompress to `size`."""

    compression: str
    data: int
    stored: int
    size: int


class Messages(NamedTuple):
    """Messages as arrays of one length: record time, connection, number of the chunk, offset in it."""

    t_ns: Any
    connection: Any
    chunk: Any
    offset: Any


class Index:
    """A closed bag that is open for reading at the level of chunks.

    Args:
        path: of the bag.
        memory: bytes that the data of a chunk may take when it is decompressed.

    Raises:
        BagError: It cannot be read, was not closed, or its index is damaged.
    """

    def __init__(self, path: Path, memory: int = MEMORY) -> None:
        self.path, self.memory = path, memory
        self.file, self.size, header = read_head(path)
        try:
            self._read(header)
        except (RecordError, struct.error, MemoryError, OverflowError) as error:
            wrong, remedy = f"the index is damaged ({error})", recovering(path)
            if has_lost_returns(self.file, self.size, header.end):
                wrong, remedy = LOST_RETURNS, _FETCH
            os.close(self.file)
            raise BagError(str(path), wrong, remedy) from error
        except BagError:
            os.close(self.file)
            raise

    def __enter__(self) -> Index:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        os.close(self.file)

    def _read(self, header: Record) -> None:
        self.position = header.number(b"index_pos")
        if self.position == 0:
            raise NotClosedError(str(self.path), "was not closed, so it has no index", recovering(self.path))
        if not header.end <= self.position <= self.size:
            raise RecordError(f"it should be at byte {self.position} of {self.size}")
        tail = read_at(self.file, self._length(header), self.position)
        self.connections: Dict[int, Connection] = {}
        place = self._read_connections(tail, header.number(b"conn_count"))
        self.chunks, place = self._read_chunks(tail, place, header.number(b"chunk_count"))
        require(not _goes_on(tail, place), "it has more records than the header counts")
        first = self.chunks[0].position if self.chunks else self.position
        begin = read_at(self.file, min(first - header.end, _HEAD_BYTES), header.end) if first > header.end else b""
        require(not _is_chunk(begin, 0, len(begin)), f"it does not name the chunk at byte {header.end}")
        self._heads: Dict[int, ChunkHead] = {}

    def _length(self, header: Record) -> int:
        """Return how many bytes are worth reading: where more follow than an index has, those of its records.

        A wrong place of it would otherwise bring a whole recording into memory.
        """
        length = self.size - self.position
        if length <= _LARGE_INDEX:
            return length
        window, begin, place = b"", 0, 0  # places in the index
        for _ in range(header.number(b"conn_count") + header.number(b"chunk_count")):
            if place + _HEAD_BYTES > begin + len(window):
                window, begin = read_at(self.file, _PIECE, self.position + place), place
            try:
                record = record_at(window, place - begin, len(window))
            except RecordError:  # its header may be longer than any that we know
                window, begin = read_at(self.file, LARGEST_HEADER + 8, self.position + place), place
                record = record_at(window, 0, len(window))
            place = begin + record.end
            if record.op not in (CONNECTION, CHUNK_INFO) or place > length:
                raise RecordError("it ends too early")
        return min(length, place + _HEAD_BYTES)

    def _read_connections(self, tail: bytes, count: int) -> int:
        place = 0
        for _ in range(count):
            record = _expected(tail, place, CONNECTION)
            connection = connection_of(record, tail[record.data : record.end])
            require(connection.number <= LARGEST_NUMBER, f"a connection has the number {connection.number}")
            other = self.connections.setdefault(connection.number, connection)
            if other != connection:
                topics = f"{other.topic} and {connection.topic}"
                raise RecordError(f"two connections have the number {connection.number}, {topics}")
            place = record.end
        return place

    def _read_chunks(self, tail: bytes, place: int, count: int) -> Tuple[List[ChunkInfo], int]:
        found = []
        for _ in range(count):
            record = _expected(tail, place, CHUNK_INFO)
            require(record.size == 8 * record.number(b"count"), "what it says of a chunk contradicts itself")
            flat = struct.unpack_from(f"<{record.size // 4}L", tail, record.data)
            found.append((record, tuple((number, count) for number, count in zip(flat[::2], flat[1::2]) if count)))
            place = record.end
        if any(connection not in self.connections for _, counts in found for connection, _ in counts):
            raise RecordError("it counts messages of a connection that it does not describe")
        if any(len(dict(counts)) < len(counts) for _, counts in found):
            raise RecordError("it counts the messages of a connection twice")
        return self._placed(found), place

    def _placed(self, found: List[Tuple[Record, Tuple[Tuple[int, int], ...]]]) -> List[ChunkInfo]:
        positions = sorted(record.number(b"chunk_pos") for record, _ in found)
        if positions and positions[-1] >= self.position:
            raise RecordError("it names a chunk behind itself")
        for one, other in zip(positions, positions[1:]):
            if one == other:
                raise RecordError(f"it names the chunk at byte {one} twice")
        ends = dict(zip(positions, [*positions[1:], self.position]))
        return sorted(
            ChunkInfo(
                record.number(b"chunk_pos"),
                ends[record.number(b"chunk_pos")],
                record.time_ns(b"start_time"),
                record.time_ns(b"end_time"),
                counts,
            )
            for record, counts in found
        )

    def head(self, number: int) -> ChunkHead:
        """Return the header of a chunk.

        Raises:
            BagError: There is none where the index says.
        """
        if number in self._heads:
            return self._heads[number]
        chunk = self.chunks[number]
        begin = read_at(self.file, _HEAD_BYTES, chunk.position)
        try:
            head = chunk_head(record_at(begin, 0, len(begin)))
            head = head._replace(data=chunk.position + head.data)
            require(head.data + head.stored <= chunk.end, "it overlaps the next one")
        except (RecordError, struct.error) as error:
            raise unusable(self.path, chunk.position, error) from error
        self._heads[number] = head
        return head

    def compressed_head(self, number: int) -> ChunkHead:
        """Return the header of a chunk whose data is going to be in memory, decompressed where it is compressed.

        Raises:
            BagError: There is none, or it takes more memory than may be.
        """
        head = self.head(number)
        try:
            check_memory(0 if head.compression == "none" else head.size, self.memory)
        except RecordError as error:
            wrong = f"the chunk at byte {self.chunks[number].position} is too large: {error}"
            raise BagError(str(self.path), wrong, "see whether it is what you expect") from error
        return head

    def messages(self) -> Messages:
        """Return all messages in the order of chunks, connections and times; reads no chunk's data.

        Raises:
            BagError: The index behind a chunk is damaged.
        """
        every = list(range(len(self.chunks)))
        parts = [part for number in every for part in self._entries(number)]
        from .arrays import repeated  # noqa: PLC0415  (see below)

        t_ns, connection, offset = _joined(parts)
        numbers = repeated(every, [chunk.messages for chunk in self.chunks])
        return Messages(t_ns, connection, numbers, offset)

    def entries(self, number: int) -> Tuple[Any, Any, Any]:
        """Return times, connections and offsets of the messages of a chunk.

        Raises:
            BagError: The index behind the chunk is damaged.
        """
        return _joined(self._entries(number))

    def check_empty(self) -> None:
        """Check that chunks that have no message by the bag's index have none by the index behind them either.

        Raises:
            BagError: One has: who loads only chunks with messages would pass it over.
        """
        for number, chunk in enumerate(self.chunks):
            if not chunk.counts:
                self._entries(number)

    def _entries(self, number: int) -> List[IndexPart]:
        chunk, head = self.chunks[number], self.head(number)
        begin = head.data + head.stored
        raw = read_at(self.file, chunk.end - begin, begin)
        try:
            return index_parts(raw, 0, len(raw), dict(chunk.counts))[0]
        except (RecordError, struct.error, ValueError) as error:
            raise unusable(self.path, chunk.position, error) from error


def read_head(path: Path) -> Tuple[int, int, Record]:
    """Open a bag; return its file descriptor, its size, and its header.

    Raises:
        BagError: It is no bag of version 2.0 that can be read.
    """
    refuse_pipe(path)
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise BagError(str(path), f"cannot be read ({error.strerror})", "name a bag that you may read") from error
    try:
        size = os.fstat(file).st_size
        return file, size, _bag_record(os.pread(file, 2 * _HEAD_BYTES, 0))
    except (RecordError, struct.error) as error:
        os.close(file)
        raise BagError(str(path), str(error), "name a ROS 1 bag of version 2.0") from error
    except OSError as error:
        os.close(file)
        raise BagError(str(path), f"cannot be read ({error.strerror})", "name a bag that you may read") from error


def refuse_pipe(path: Path) -> None:
    """Refuse a pipe before it is opened, which waits for who writes into it: a bag is read at many places.

    Raises:
        BagError: It is one.
    """
    if path.is_fifo():
        raise BagError(str(path), "is a pipe", "copy it into a file first")


def _bag_record(begin: bytes) -> Record:
    if begin.startswith(MAGIC[:-1] + b"\r\n"):
        raise OtherBagError("its line endings were converted (git does that unless .gitattributes says `*.bag -text`)")
    if begin.startswith(b"#ROS") and not begin.startswith(MAGIC):
        line = begin.split(b"\n", 1)[0][:40].decode("ascii", "replace")
        raise OtherBagError(f"its version is not 2.0 ({line}); older ones are converted with `rosbag fix`")
    if not begin.startswith(MAGIC):
        raise NotABagError(foreign(begin), empty=not begin)
    record = record_at(begin, len(MAGIC), len(begin))
    if record.op != BAG:
        raise RecordError("has no header of a bag")
    if record.fields.get(b"encryptor"):
        raise OtherBagError("is encrypted; decrypt it with `rosbag decompress` and its key")
    return record


def has_lost_returns(file: int, size: int, place: int) -> bool:
    """Return whether every CR LF of a closed bag with a wrong index became LF, as git does with what it takes for text.

    There is no CR LF in it, and the first record that does not end where it says ends before that, by no more bytes
    than there are LF in it.

    Args:
        file: descriptor of the bag.
        size: of it.
        place: of its first record.
    """
    if any(b"\r\n" in read_at(file, _PIECE + 1, at) for at in range(0, size, _PIECE)):
        return False
    while place < size:
        try:
            record = record_at(read_at(file, _HEAD_BYTES, place), 0, min(_HEAD_BYTES, size - place))
        except RecordError:
            return False
        data, place = place + record.data, place + record.end
        if not _is_record(file, size, place):
            return _is_shorter(read_at(file, min(record.size, MEMORY) + _HEAD_BYTES, data), record.size)
    return False


def _is_record(file: int, size: int, place: int) -> bool:
    try:
        return place == size or record_at(read_at(file, _HEAD_BYTES, place), 0, min(_HEAD_BYTES, size - place)).op > 0
    except RecordError:
        return False


def _is_shorter(data: bytes, said: int) -> bool:
    """Return whether the record that begins with some data is shorter than it says, by at most a byte for each LF."""
    end = next(headers(data, 0, _BEHIND), said)
    return 0 < said - end <= data.count(b"\n", 0, end)


def _goes_on(tail: bytes, place: int) -> bool:
    """Return whether another record of an index stands at a place; anything else may be behind the last one."""
    try:
        return record_at(tail, place, len(tail)).op in (CONNECTION, CHUNK_INFO)
    except RecordError:
        return False


def _expected(buffer: Buffer, place: int, op: int) -> Record:
    record = record_at(buffer, place, len(buffer))
    if record.op != op or record.end > len(buffer):
        raise RecordError("it ends too early")
    return record


def chunk_head(record: Record) -> ChunkHead:
    """Return what the record of a chunk says.

    Raises:
        RecordError: It is no chunk.
    """
    if record.op != CHUNK or b"compression" not in record.fields:
        raise RecordError("there is no chunk")
    compression = record.fields[b"compression"].decode("ascii", "replace")
    return ChunkHead(compression, record.data, record.size, record.number(b"size"))


def index_entries(buffer: Buffer, place: int, limit: int, counts: Dict[int, int]) -> Tuple[Any, Any, Any, int]:
    """Return times, connections and offsets from the index records behind a chunk, and where these end.

    Raises:
        RecordError: They do not have these numbers of messages by connection.
    """
    parts, place = index_parts(buffer, place, limit, counts)
    return (*_joined(parts), place)


def index_parts(buffer: Buffer, place: int, limit: int, counts: Dict[int, int]) -> Tuple[List[IndexPart], int]:
    """Return connection and entries of each index record behind a chunk, and where these end."""
    parts: List[IndexPart] = []
    missing, view = dict(counts), memoryview(buffer)
    while missing:
        connection, data, size = index_record_at(buffer, place, limit)
        if data + size > limit:
            raise RecordError("the index behind it ends too early")
        count = size // INDEX_ENTRY
        if count and missing.pop(connection, None) != count:
            raise RecordError("the index behind it is not what the bag's index says")
        parts.append((connection, view[data : data + INDEX_ENTRY * count]))
        place = data + size
    wrong = _wrong_behind(buffer, place, limit)
    require(not wrong, wrong)
    return parts, place


def _wrong_behind(buffer: Buffer, place: int, limit: int) -> str:
    """Return what is wrong where the index behind a chunk should have ended; it may go on with empty records."""
    while place < limit:
        try:
            _, data, size = index_record_at(buffer, place, limit)
        except RecordError:  # a record of another kind: the index records end there
            return "the one behind it is not named by the bag's index" if _is_chunk(buffer, place, limit) else ""
        if size:
            return "the index behind it is not what the bag's index says"
        place = data
    return ""


def _is_chunk(buffer: Buffer, place: int, limit: int) -> bool:
    try:
        return record_at(buffer, place, limit).op == CHUNK
    except RecordError:
        return False


OTHERWISE = "it describes a connection otherwise than the bag's index"


def contradicts(
    described: Connection, known: Optional[Connection], names: Container[Name], used: Container[int]
) -> bool:
    """Return whether a description in a chunk and that of the bag's index cannot both be right.

    Where a chunk was copied as it is into a bag of several, a connection of which it has no message may be described by
    the number that it had, which is another one's now; it has its own in the index.

    Args:
        described: in the chunk.
        known: what the index has by its number, if it has it.
        names: of all connections of the index.
        used: numbers of which the chunk has messages.
    """
    if known is None or known.name == described.name:
        return False
    return described.number in used or described.name not in names


def _joined(parts: List[IndexPart]) -> Tuple[Any, Any, Any]:
    from .arrays import joined_parts  # noqa: PLC0415  (needs numpy, which to open a bag does not)

    return joined_parts(parts)


def require(good: bool, otherwise: str) -> None:  # noqa: FBT001
    """Raise a RecordError unless something is as it should be."""
    if not good:
        raise RecordError(otherwise)


def recovering(path: Path) -> str:
    """Return what to do with a bag whose index is missing or damaged; nothing that is whole is lost by it."""
    return f"make a whole one with `amaze-bag recover {shlex.quote(str(path))}`"


def unusable(path: Path, position: int, error: Exception) -> BagError:
    """Return the error for a damaged chunk."""
    wrong = f"the chunk at byte {position} is damaged: {error}"
    return BagError(str(path), wrong, KEEP_GOOD)
