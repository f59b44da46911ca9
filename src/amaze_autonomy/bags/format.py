"""The bytes of the ROS bag format, version 2.0 (wiki.ros.org/Bags/Format/2.0): how records are read and written.

A bag is a line of magic and then records. A record is a header and data, each behind its length; a header is fields
`name=value`, each behind its length, in any order. Numbers are little-endian. In the file lie, one after another:

    BAG          where the index is (0 while the bag is being recorded), padded so that it can be written again
    CHUNK        records CONNECTION and MESSAGE, compressed together
    INDEX ...    behind each chunk, for each connection in it: times and offsets of its messages in the chunk
    CONNECTION   all of them once more  } this is
    CHUNK_INFO   one for each chunk     } the index

The format has no checksums. We write fields in the order of the C++ library. Nothing here needs numpy, which takes
longer to load than many a command takes.
"""

from __future__ import annotations

import bz2
import os
import re
import struct
from contextlib import contextmanager, suppress
from functools import lru_cache
from typing import Any, Dict, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple, Union

import lz4.frame

from amaze_autonomy.units import MB, SECOND

from .errors import BagError, RecordError

# --- records ----------------------------------------------------------------------------------------------------------


MAGIC = b"#ROSBAG V2.0\n"
_FOREIGN: Tuple[Tuple[bytes, str], ...] = (
    (b"ULog\x01\x12\x35", "a ULog of PX4; amaze-bag info and amaze-replay read it"),
    (b"\xa3\x95", "a DataFlash log of ArduPilot; of the same flight, a telemetry log (.tlog) or a bag can be read"),
    (
        b"\x89MCAP0\r\n",
        "an MCAP file; amaze-bag info and amaze-replay read it, amaze-replay export writes a whole one",
    ),
    (
        b"SQLite format 3\x00",
        "an SQLite file; amaze-bag info and amaze-replay read it where it is a ROS 2 bag",
    ),
    (b"version https://git-lfs", "a pointer of Git LFS, not the file itself; git lfs pull fetches that"),
    (b"\x1f\x8b", "compressed with gzip; unpack it first"),
    (b"BZh", "compressed with bzip2; unpack it first"),
    (b"\xfd7zXZ\x00", "compressed with xz; unpack it first"),
    (b"\x28\xb5\x2f\xfd", "compressed with zstd; unpack it first"),
    (b"PK\x03\x04", "a zip archive; unpack it first"),
    (b"<!DOCTYPE", "a web page; the download has not given the file"),
    (b"<html", "a web page; the download has not given the file"),
)
MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = 2, 3, 4, 5, 6, 7
FIRST_RECORD = 4117  # where rosbag puts it
LARGEST_HEADER = 1 << 22  # what is larger is no header
INDEX_ENTRY = 12  # bytes of a message in an index record: time and offset
INDEX_FIELDS = (b"conn", b"count", b"op", b"ver")  # of an index record, in our order

Buffer = Union[bytes, bytearray, memoryview]

_U32, _U64, _TIME = struct.Struct("<L"), struct.Struct("<Q"), struct.Struct("<LL")


class Record(NamedTuple):
    """One record: its fields, where its data starts, and the length of the data."""

    fields: Dict[bytes, bytes]
    data: int
    size: int

    @property
    def op(self) -> int:
        """Say what kind of record it is."""
        return self.fields[b"op"][0]

    @property
    def end(self) -> int:
        """Say where it ends."""
        return self.data + self.size

    def number(self, name: bytes) -> int:
        """Return a field of four or eight bytes."""
        value = self.fields.get(name, b"")
        if len(value) not in (4, 8):
            raise RecordError(f"the field {name.decode()} is missing or no number")
        return int.from_bytes(value, "little")

    def time_ns(self, name: bytes) -> int:
        """Return a field that is a time."""
        value = self.fields.get(name, b"")
        if len(value) != _TIME.size:
            raise RecordError(f"the field {name.decode()} is missing or no time")
        return nanoseconds(*_TIME.unpack(value))


def u32(buffer: Buffer, position: int) -> int:
    """Return the number at a position."""
    value: int = _U32.unpack_from(buffer, position)[0]
    return value


def nanoseconds(seconds: int, fraction: int) -> int:
    """Return a time of the bag as one number."""
    return seconds * SECOND + fraction


def pack_time(t_ns: int) -> bytes:
    """Return a time as the bag has it."""
    return _TIME.pack(*divmod(t_ns, SECOND))


def fields_of(buffer: Buffer, start: int, end: int) -> Dict[bytes, bytes]:
    """Return the fields of a header.

    Raises:
        RecordError: These bytes are no header.
    """
    fields = {}
    while start < end:
        if start + 4 > end:
            raise RecordError("a header ends within a field")
        size = u32(buffer, start)
        start += 4
        name, equals, value = bytes(buffer[start : start + size]).partition(b"=")
        if not equals or start + size > end:
            raise RecordError("a header has a field that is none")
        fields[name] = value
        start += size
    return fields


def record_at(buffer: Buffer, position: int, limit: int) -> Record:
    """Read the header of a record and the length of its data, which may end beyond the limit.

    Raises:
        RecordError: There is no record, or its header ends beyond the limit.
    """
    if position + 4 > limit:
        raise RecordError("the file ends within a record")
    size = u32(buffer, position)
    data = position + size + 8
    if not 0 < size <= LARGEST_HEADER:
        raise RecordError(f"a header of {size} bytes is none")
    if data > limit:
        raise RecordError("the file ends within a header")
    shape = _shapes.get(size)
    if shape is not None:
        values = shape.packed.unpack_from(buffer, position + 4)
        if values[:-1:2] == shape.fixed:
            return Record(dict(zip(shape.names, values[1::2])), data, values[-1])
    fields = fields_of(buffer, position + 4, data - 4)
    if len(fields.get(b"op", b"")) != 1:
        raise RecordError("a header does not say of what")
    if size <= _LARGEST_SHAPE:
        _shapes[size] = _shape(fields, bytes(buffer[position + 4 : data - 4]))
    return Record(fields, data, u32(buffer, data - 4))


def index_record_at(buffer: Buffer, position: int, limit: int) -> Tuple[int, int, int]:
    """Read the header of an index record: whose it is, where its data starts, and the length of the data.

    Raises:
        RecordError: There is no such record.
    """
    for shape in _index_shapes:
        data = position + shape.packed.size
        if data <= limit:
            values = shape.packed.unpack_from(buffer, position)
            if values[::2] == shape.fixed:
                return values[shape.place], data, values[-1]
    record = record_at(buffer, position, limit)
    if record.op != INDEX:
        raise RecordError("the index behind it ends too early")
    if not _index_shapes:
        _index_shapes.extend(_index_shape(bytes(buffer[position : record.data - 4])))
    return record.number(b"conn"), record.data, record.size


class _IndexShape(NamedTuple):
    """How the first index record looked, nearly all do: there is one for each connection and chunk."""

    packed: struct.Struct
    fixed: Tuple[bytes, ...]  # all but numbers, which lie between
    place: int  # of the connection among the parts


_index_shapes: List[_IndexShape] = []


def _index_shape(header: bytes) -> List[_IndexShape]:
    """Return the shape of a header, its length before it; nothing when it has not each number once."""
    values = sorted((header.find(name) + len(name), name) for name in (b"\x09\0\0\0conn=", b"\x0a\0\0\0count="))
    (first, name), (second, _) = values
    fixed = (header[:first], header[first + 4 : second], header[second + 4 :])
    if sorted(fields_of(header, 4, len(header))) != [b"conn", b"count", b"op", b"ver"] or first < 13:  # noqa: PLR2004
        return []
    packed = struct.Struct("<{}sL{}sL{}sL".format(*map(len, fixed)))
    return [_IndexShape(packed, fixed, 1 if b"conn" in name else 3)]


class _Shape(NamedTuple):
    """How headers of one size looked last, most of a bag do: five times faster than field by field."""

    packed: struct.Struct
    fixed: Tuple[bytes, ...]  # all but values, which lie between
    names: Tuple[bytes, ...]


_LARGEST_SHAPE = 128  # longer ones have names of topics
_shapes: Dict[int, _Shape] = {}


def _shape(fields: Dict[bytes, bytes], header: bytes) -> _Shape:
    fixed = tuple(_U32.pack(len(name) + 1 + len(value)) + name + b"=" for name, value in fields.items())
    parts = "".join(f"{len(name)}s{len(value)}s" for name, value in zip(fixed, fields.values()))
    if b"".join(name + value for name, value in zip(fixed, fields.values())) != header:  # one name twice
        return _Shape(struct.Struct(f"<{len(header)}sL"), (b"",), ())
    return _Shape(struct.Struct(f"<{parts}L"), fixed, tuple(fields))


def pack_field(name: bytes, value: bytes) -> bytes:
    """Return a field of a header."""
    return _U32.pack(len(name) + 1 + len(value)) + name + b"=" + value


def message_fields(connection: int, t_ns: int) -> bytes:
    """Return the fields of a message's header, without their length."""
    fields = (b"conn", _U32.pack(connection)), (b"op", bytes([MESSAGE])), (b"time", pack_time(t_ns))
    return b"".join(pack_field(*each) for each in fields)


def _packed(fields: Iterable[Tuple[bytes, bytes]]) -> bytes:
    parts = b"".join(pack_field(*each) for each in fields)
    return _U32.pack(len(parts)) + parts


def bag_header(index: int, connections: int, chunks: int) -> bytes:
    """Return everything before the first chunk; `index` is where the index starts."""
    header = MAGIC + _packed(
        (
            (b"chunk_count", _U32.pack(chunks)),
            (b"conn_count", _U32.pack(connections)),
            (b"index_pos", _U64.pack(index)),
            (b"op", bytes([BAG])),
        )
    )
    padding = FIRST_RECORD - len(header) - 4
    return header + _U32.pack(padding) + b" " * padding


def connection_record(number: int, topic: bytes, header: bytes) -> bytes:
    """Return a connection; `header` is its data, as it was recorded: what nobody could read of it is made text."""
    fields = ((b"conn", _U32.pack(number)), (b"op", bytes([CONNECTION])), (b"topic", topic))
    header = _readable(header)
    return _packed(fields) + _U32.pack(len(header)) + header


def chunk_header(compression: str, size: int, stored: int) -> bytes:
    """Return what stands before the data of a chunk: `size` bytes, `stored` when compressed."""
    return b"".join((_head_fields(compression), _U32.pack(size), _U32.pack(stored)))


@lru_cache(maxsize=None)
def _head_fields(compression: str) -> bytes:
    """Return all of a chunk's header but the two sizes at its end."""
    fields = ((b"compression", compression.encode()), (b"op", bytes([CHUNK])), (b"size", _U32.pack(0)))
    return _packed(fields)[:-4]


def index_header(connection: int, count: int) -> bytes:
    """Return what stands before the times and offsets of one connection's messages in one chunk."""
    fields = (
        (b"conn", _U32.pack(connection)),
        (b"count", _U32.pack(count)),
        (b"op", bytes([INDEX])),
        (b"ver", _U32.pack(1)),
    )
    return _packed(fields) + _U32.pack(INDEX_ENTRY * count)


_OUR_INDEX = index_header(0, 0)
_OUR_INDEX_FIXED = (_OUR_INDEX[:13], _OUR_INDEX[17:27], _OUR_INDEX[31:51])  # all but numbers, which lie between
_OUR_INDEX_STRUCT = struct.Struct("<13sL10sL20sL")


def our_index_record(buffer: Buffer, place: int) -> Optional[Tuple[int, int, int]]:
    """Return whose an index record is, where its data starts, and its length; None where it is not just like ours."""
    if not 0 <= place <= len(buffer) - _OUR_INDEX_STRUCT.size:
        return None
    first, connection, second, count, third, size = _OUR_INDEX_STRUCT.unpack_from(buffer, place)
    if (first, second, third) != _OUR_INDEX_FIXED or size != INDEX_ENTRY * count:
        return None
    return connection, place + _OUR_INDEX_STRUCT.size, size


def chunk_info(position: int, start_ns: int, end_ns: int, counts: Iterable[Tuple[int, int]]) -> bytes:
    """Return what the index says of a chunk; `counts` are messages by connection."""
    flat = [number for each in counts for number in each]
    start, end = divmod(start_ns, SECOND), divmod(end_ns, SECOND)
    one, two, three, four, five = _INFO
    pack = _info_struct(len(flat)).pack
    return pack(one, position, two, len(flat) // 2, three, *end, four, *start, five, 4 * len(flat), *flat)


@lru_cache(maxsize=64)
def _info_struct(numbers: int) -> struct.Struct:
    sizes = "{}sQ{}sL{}sLL{}sLL{}sL".format(*map(len, _INFO))
    return struct.Struct(f"<{sizes}{numbers}L")


def _info_parts() -> List[bytes]:
    """Return what stands before each value of a chunk's record in the index, which is always the same."""
    values = (b"<<<0>>>>", b"<<1>", b"<<<2>>>>", b"<<<3>>>>")
    fields = (
        (b"chunk_pos", values[0]),
        (b"count", values[1]),
        (b"end_time", values[2]),
        (b"op", bytes([CHUNK_INFO])),
        (b"start_time", values[3]),
        (b"ver", _U32.pack(1)),
    )
    parts, rest = [], _packed(fields)
    for value in values:
        part, _, rest = rest.partition(value)
        parts.append(part)
    return [*parts, rest]


_INFO = _info_parts()


# --- connections ------------------------------------------------------------------------------------------------------


Identity = Tuple[str, str, str, bool, str]
Name = Tuple[str, str, str]


class Connection(NamedTuple):
    """One publisher of a topic, as a recorder saw it.

    Args:
        number: in its bag.
        topic: its name; bytes that are not UTF-8 are written as _xe9 in it, as in the other texts.
        kind: the type of its messages, e.g. "sensor_msgs/Imu".
        md5: of the type's definition.
        caller: name of the publishing node; "" when the bag does not say.
        latching: whether late subscribers get its last message.
        header: all that was recorded about it, the definition included.
        garbled: bytes of its topic are not UTF-8.
    """

    number: int
    topic: str
    kind: str
    md5: str
    caller: str
    latching: bool
    header: bytes
    garbled: bool = False

    @property
    def plausible(self) -> bool:
        """Return whether nothing in it looks damaged."""
        texts = (self.topic, self.kind, self.caller)
        damaged = any(not text.isprintable() for text in texts) or (self.garbled and not self.agrees)
        complete = self.is_readable and "/" in self.kind
        return complete and not damaged and re.fullmatch("[0-9a-f]{32}", self.md5) is not None

    @property
    def is_readable(self) -> bool:
        """Return whether others can read what was recorded about it."""
        return _readable(self.header) == self.header

    @property
    def definition(self) -> bytes:
        """Return the text that defines the type; empty when it is not told, or damaged."""
        try:
            return fields_of(self.header, 0, len(self.header)).get(_DEFINITION, b"").strip()
        except RecordError:
            return b""

    @property
    def is_damaged(self) -> bool:
        """Return whether its definition is damaged elsewhere than in a comment, so that nobody can decode a message."""
        return self.definition.endswith(_NOTE) or _is_code_damaged(self.definition)

    def defined_by(self, other: Connection) -> Connection:
        """Return it with the definition of another one, which has the same type and md5."""
        fields = {**fields_of(self.header, 0, len(self.header)), _DEFINITION: other.definition}
        return self._replace(header=b"".join(pack_field(*each) for each in fields.items()))

    @property
    def name(self) -> Name:
        """Return what everybody knows its messages by: topic, type, and md5."""
        return self.topic, self.kind, self.md5

    def is_of(self, record: Record, header: bytes) -> bool:
        """Return whether a record describes it byte by byte as this does."""
        return header == self.header and record.fields.get(b"topic") == self.topic.encode("utf-8", "surrogateescape")

    @property
    def agrees(self) -> bool:
        """Return whether its topic is the one that was recorded about it, if there is one."""
        topic = fields_of(self.header, 0, len(self.header)).get(b"topic")
        return topic is None or _text(topic) == self.topic

    def identity(self, *, publishers_apart: bool = True) -> Identity:
        """Return what two connections have in common when they are the same one."""
        return self.topic, self.kind, self.md5, self.latching, self.caller if publishers_apart else ""


def connection_of(record: Record, header: bytes) -> Connection:
    """Return the connection that a record describes.

    Raises:
        RecordError: It does not say which type on which topic.
    """
    fields = fields_of(header, 0, len(header))
    topic = record.fields.get(b"topic", fields.get(b"topic"))
    if topic is None or b"type" not in fields or b"md5sum" not in fields:
        raise RecordError("a connection does not say its topic and type")
    return Connection(
        number=record.number(b"conn"),
        topic=_text(topic),
        kind=_text(fields[b"type"]),
        md5=_text(fields[b"md5sum"]),
        caller=_text(fields.get(b"callerid", b"")),
        latching=fields.get(b"latching") == b"1",
        header=header,
        garbled=not _is_text(topic),
    )


UNREADABLE = "others cannot read what describes it (not UTF-8, or no definition)"
UNDECODABLE = "its definition is damaged, its messages cannot be decoded"
_DEFINITION = b"message_definition"
_NOTE = b"# damaged: bytes in it that were no text are written as _xNN"  # as text it does not show any more
_ODD_LATCHING = re.compile(rb"latching=[^01]")


def _readable(header: bytes) -> bytes:
    """Return what was recorded about a connection as others can read it.

    The rosbags library and rosbag refuse a whole bag for one byte there that is not UTF-8, be it in a comment of the
    definition, for a definition that is missing, or for `latching` that is no number. Where it is in no comment the
    library still refuses to decode any topic of the bag, as the md5 is that of another text: that is noted in it.
    """
    if header.isascii() and _DEFINITION + b"=" in header and _ODD_LATCHING.search(header) is None:
        return header
    fields = fields_of(header, 0, len(header))
    texts = {_text(name).encode(): _text(value).encode() for name, value in fields.items()}
    texts.setdefault(_DEFINITION, b"")
    if _is_code_damaged(fields.get(_DEFINITION, b"")):
        texts[_DEFINITION] = texts[_DEFINITION].rstrip() + b"\n" + _NOTE
    if texts.get(b"latching") and not texts[b"latching"].isdigit():
        texts[b"latching"] = b"0"
    return header if texts == fields else b"".join(pack_field(*each) for each in texts.items())


def _is_code_damaged(definition: bytes) -> bool:
    """Return whether bytes of a definition that are in no comment are not UTF-8."""
    code = (line.split(b"#", 1)[0] for line in definition.splitlines())
    return not definition.isascii() and not all(map(_is_text, code))


def _is_text(value: bytes) -> bool:
    return _text(value).encode() == value


def _text(value: bytes) -> str:
    """Return a text; bytes in it that are not UTF-8 as _xe9, which is good in names of topics, types and fields."""
    try:
        return value.decode()
    except UnicodeDecodeError:
        return value.decode("utf-8", "backslashreplace").replace("\\x", "_x")


# --- bytes of a file --------------------------------------------------------------------------------------------------


def read_at(file: int, size: int, place: int) -> bytes:
    """Return bytes of an open file, as os.pread does.

    Raises:
        BagError: Its storage does not give them.
    """
    with _naming(file, place):
        return os.pread(file, size, place)


def read_into(file: int, buffers: Sequence[Any], place: int) -> int:
    """Read bytes of an open file into buffers, as os.preadv does, and return how many.

    Raises:
        BagError: Its storage does not give them.
    """
    with _naming(file, place):
        return os.preadv(file, buffers, place)


@contextmanager
def _naming(file: int, place: int) -> Iterator[None]:
    """Say of which file, and where, a read has failed."""
    try:
        yield
    except OSError as error:
        path = os.readlink(f"/proc/self/fd/{file}")
        wrong = f"cannot be read at byte {place:,} ({error.strerror})"
        raise BagError(path, wrong, "copy the disk and try there") from error


# --- the data of chunks -----------------------------------------------------------------------------------------------


COMPRESSIONS = ("none", "lz4", "bz2")
MEMORY = 256 * MB  # bytes that the data of a chunk may take; recorders write less than one megabyte, or one message
_PACKED_STEP = 1 << 16
_UNPACKING = (RuntimeError, OSError, EOFError, ValueError, MemoryError)  # what the two decompressors raise


def compressed(kind: str, data: Buffer) -> Buffer:
    """Return the data of a chunk as it is stored."""
    if kind == "none":
        return data
    if kind == "bz2":
        return bz2.compress(data)
    # What roslz4 can read: blocks that do not refer to each other, and a checksum of the content.
    packed: bytes = lz4.frame.compress(
        data,
        compression_level=0,
        block_size=lz4.frame.BLOCKSIZE_MAX1MB,
        block_linked=False,
        content_checksum=True,
        store_size=False,
    )
    return packed


def decompressed(kind: str, data: Buffer, size: int, memory: int = MEMORY) -> Buffer:
    """Return the data of a chunk, writable unless it was not compressed; takes no more memory than is said.

    Args:
        kind: of compression.
        data: as stored.
        size: that the chunk says that it has.
        memory: bytes that may be taken.

    Raises:
        RecordError: It is damaged, not of this size, or larger than may be.
    """
    if kind == "none":
        plain: Any = data
    else:
        check_memory(size, memory)
        plain = _unpacked(kind, data, size + 1)
    if len(plain) != size:
        more = "more than " if len(plain) > size else f"{len(plain)} bytes instead of "
        raise RecordError(f"it has {more}{size}")
    return plain  # type: ignore[no-any-return]


def foreign(begin: Buffer) -> str:
    """Return what a file is that is no bag, and what can be done with it, by its first bytes; empty: nobody knows."""
    first = bytes(begin[:32])
    if is_log(first):
        return "a telemetry log of MAVLink; amaze-replay reads it"
    return next((words for magic, words in _FOREIGN if first.startswith(magic)), "")


def is_log(begin: Buffer) -> bool:
    """Return whether a file is a telemetry log: behind a time in microseconds, of this century, begins a frame."""
    year_2000, year_2100 = 946_684_800_000_000, 4_102_444_800_000_000
    stamped = len(begin) > 8 and year_2000 < int.from_bytes(begin[:8], "big") < year_2100  # noqa: PLR2004
    return stamped and begin[8] in (0xFE, 0xFD)


def check_memory(size: int, memory: int) -> None:
    """Check that a chunk may be decompressed: a few bytes of bz2 can become gigabytes.

    Raises:
        RecordError: It may not.
    """
    if size > memory:
        needed = -(-size // MB)
        raise RecordError(f"it takes {needed} MB of memory, {memory // MB} may be taken (--memory {needed} permits it)")


def _unpacked(kind: str, data: Buffer, most: int) -> bytearray:
    """Decompress a chunk; stop at so many bytes."""
    decompressor = _decompressor(kind)
    try:
        plain = decompressor.decompress(data, most)
    except _UNPACKING as error:
        raise RecordError(f"its {kind} data is damaged ({error})") from error
    if len(plain) < most and not decompressor.eof:
        raise RecordError(f"its {kind} data is cut")
    return plain if isinstance(plain, bytearray) else bytearray(plain)


def unpacked(kind: str, data: Buffer, memory: int = MEMORY) -> Tuple[Buffer, bool]:
    """Return the data of a chunk whatever its size, as far as it can be decompressed, and whether that is all of it."""
    if kind == "none":
        return data, True
    decompressor = _decompressor(kind)
    plain, view, place = bytearray(), memoryview(data), 0
    with suppress(*_UNPACKING):  # behind it nothing is good
        while len(plain) < memory and not decompressor.eof:
            piece = view[place : place + _PACKED_STEP] if decompressor.needs_input else b""
            if decompressor.needs_input and not len(piece):
                break
            place += len(piece)
            plain += decompressor.decompress(piece, memory - len(plain))
    return plain, bool(decompressor.eof)


def _decompressor(kind: str) -> Any:
    if kind not in COMPRESSIONS:
        raise RecordError(f"compressed by {kind}, which is not known")
    return lz4.frame.LZ4FrameDecompressor(return_bytearray=True) if kind == "lz4" else bz2.BZ2Decompressor()
