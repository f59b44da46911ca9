"""MCAP files, by their index; one without an index, as a killed recorder leaves it, by what stands in its chunks.

A file that was not closed is read to its last whole message, also in a chunk that was cut: what is missing is said in
the part's `problem`.
"""

from __future__ import annotations

import struct
import zlib
from collections import OrderedDict
from io import BytesIO
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from .errors import BagError, MessageError, RecordError
from .format import MEMORY, check_memory, decompressed
from .index import ChunkHead

MCAP = b"\x89MCAP0\r\n"
Places = Tuple[Any, Any, Any]
NONE: Any = np.zeros(0, np.int64)
_CACHED = 8
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _DATA_END = 1, 2, 3, 4, 5, 6, 7, 15
_RECORD, _OF_MESSAGE, _OF_CHUNK = struct.Struct("<BQ"), struct.Struct("<HLQ"), struct.Struct("<QQQLL")
_TO_DATA = _RECORD.size + 22  # from a message's record to its data
_UNCHUNKED = -1


class Channel(NamedTuple):
    """What `Connection` is in a bag.

    Args:
        topic: its name.
        kind: type as ROS 1 names it, e.g. sensor_msgs/Imu.
        md5: of its definition; empty where the format has none.
        encoding: of its messages: cdr, ros1, ulog, or one that is not read.
        schema: how its definition is written: ros2msg, ros2idl, ros1msg, or empty.
        definition: of its type; empty: not in the file.
    """

    topic: str
    kind: str
    md5: str = ""
    encoding: str = ""
    schema: str = ""
    definition: str = ""


class Part(NamedTuple):
    """One file of a recording.

    Args:
        version: what it is, for people.
        channels: by their own numbers.
        places: by number, times, chunks, and offsets in them of its messages.
        raw: returns a message by chunk and offset; raises `MessageError`.
        heads: of its chunks.
        close: closes it.
        problem: what of it is missing, and what to do; empty: nothing.
    """

    version: str
    channels: Mapping[int, Channel]
    places: Mapping[int, Places]
    raw: Callable[[int, int], bytes]
    heads: Sequence[ChunkHead]
    close: Callable[[], None]
    problem: str = ""


class _Chunk(NamedTuple):
    """A chunk: where its record begins, and how long that is; `whole`: to its end."""

    position: int
    length: int
    whole: bool = True


class _Found(NamedTuple):
    """What an index, or a look through the file, says of it: places of messages by channel, in parts."""

    profile: str
    schemas: Mapping[int, Any]
    channels: Mapping[int, Any]
    chunks: Sequence[_Chunk]
    heads: Sequence[ChunkHead]
    places: Mapping[int, Sequence[Places]]
    problem: str = ""


def lacking(path: Path, what: str, extra: str) -> BagError:
    """Return the error for a format of which the library is not installed."""
    return BagError(str(path), f"is {what}, for which a library lacks", f"pip install 'amaze_autonomy[{extra}]'")


def mcap_part(path: Path, memory: int) -> Part:
    """Open an MCAP file.

    Raises:
        BagError: It cannot be read.
    """
    try:
        from mcap.exceptions import McapError  # noqa: PLC0415  (an extra)
    except ImportError as error:
        raise lacking(path, "an MCAP file", "mcap") from error
    file = path.open("rb")
    wrong = (McapError, OSError, struct.error, ValueError, EOFError)
    try:
        try:
            found = _by_index(file, memory)
        except wrong:
            found = None
        found = found or _Scan(file, path, memory).found()
    except wrong as error:
        file.close()
        raise BagError(
            str(path), f"is a damaged MCAP file ({error or type(error).__name__})", "name another"
        ) from error
    channels = {number: _channel(each, found.schemas.get(each.schema_id)) for number, each in found.channels.items()}
    places: Dict[int, Places] = {}
    for number, parts in found.places.items():
        times, chunks, offsets = (np.concatenate(column).astype(np.int64) for column in zip(*parts))
        places[number] = times, chunks, offsets
    version = f"MCAP{f' of {found.profile}' if found.profile else ''}"
    message = _Chunks(file, found.chunks, memory).message
    return Part(version, channels, places, message, found.heads, file.close, found.problem)


def _channel(each: Any, schema: Any) -> Channel:
    name, encoding, data = (schema.name, schema.encoding, schema.data) if schema else ("", "", b"")
    text = data.decode("utf-8", "replace") if encoding in ("ros1msg", "ros2msg", "ros2idl") else ""
    return Channel(each.topic, ros1_name(name), each.metadata.get("md5sum", ""), each.message_encoding, encoding, text)


# --- by the index -----------------------------------------------------------------------------------------------------


def _by_index(file: Any, memory: int) -> Optional[_Found]:
    """Return what the index says; None where there is none, or not of all messages."""
    from mcap.reader import SeekingReader  # noqa: PLC0415

    reader: Any = SeekingReader(file, record_size_limit=memory)
    profile, summary = reader.get_header().profile, reader.get_summary()
    if summary is None or summary.statistics is None:
        return None
    chunks = sorted(summary.chunk_indexes, key=lambda each: each.chunk_start_offset)
    places: Dict[int, List[Places]] = {}
    count = 0
    for number, chunk in enumerate(chunks):
        for channel, found in _message_indexes(file, chunk):
            count += len(found)
            places.setdefault(channel, []).append((found[:, 0], np.full(len(found), number), found[:, 1]))
    if count != summary.statistics.message_count or places.keys() - summary.channels.keys():
        return None
    heads = [
        ChunkHead(each.compression or "none", each.chunk_start_offset, each.compressed_size, each.uncompressed_size)
        for each in chunks
    ]
    known = [_Chunk(each.chunk_start_offset, each.chunk_length) for each in chunks]
    return _Found(profile, summary.schemas, summary.channels, known, heads, places)


def _message_indexes(file: Any, chunk: Any) -> Iterator[Tuple[int, Any]]:
    """Yield the channels of a chunk, each with the times and offsets of its messages."""
    file.seek(chunk.chunk_start_offset + chunk.chunk_length)
    data = file.read(chunk.message_index_length)
    place = 0
    while place + 15 <= len(data):
        op, length, channel, size = struct.unpack_from("<BQHL", data, place)
        if op == _MESSAGE_INDEX and size:
            yield channel, np.frombuffer(data, "<u8", size // 8, place + 15).reshape(-1, 2)
        place += 9 + length


# --- without an index -------------------------------------------------------------------------------------------------


class _Scan:
    """Looks through a file from its beginning.

    Args:
        file: open.
        path: of it, for what is said.
        memory: bytes that a chunk may take, decompressed.
    """

    def __init__(self, file: Any, path: Path, memory: int) -> None:
        self._file, self._path, self._memory = file, path, memory
        self._size = file.seek(0, 2)
        self._profile = ""
        self._schemas: Dict[int, Any] = {}
        self._channels: Dict[int, Any] = {}
        self._chunks: List[_Chunk] = []
        self._heads: List[ChunkHead] = []
        self._rows: Dict[int, List[Tuple[int, int, int]]] = {}
        self._damages: List[str] = []
        self._closed = False

    def found(self) -> _Found:
        """Return what is in it."""
        place = len(MCAP)
        while place + _RECORD.size <= self._size and not self._closed:
            self._file.seek(place)
            op, length = _RECORD.unpack(self._file.read(_RECORD.size))
            self._record(place, op, length)
            place += _RECORD.size + length
        places: Dict[int, List[Places]] = {}
        for number, rows in self._rows.items():
            times, chunks, offsets = np.array(rows, np.int64).T
            places[number] = [(times, chunks, offsets)]
        known = self._schemas, self._channels
        return _Found(self._profile, *known, self._chunks, self._heads, places, self._problem(place))

    def _problem(self, end: int) -> str:
        """Return what is missing of the file, and what to do; empty where all is there but an index."""
        self._file.seek(self._size - len(MCAP))
        ended = self._closed and self._file.read() == MCAP
        if ended and not self._damages:
            return ""
        count = sum(map(len, self._rows.values()))
        cut = "" if end <= self._size else f", cut at byte {self._size}"
        wrong = "; ".join([*([] if ended else [f"was not closed{cut}"]), *self._damages])
        return (
            f"{self._path.name}: {wrong}: {count} messages are read, what came after them is missing; "
            f"`amaze-replay export {self._path.name} -o WHOLE.mcap` or `mcap recover` writes a whole file"
        )

    def _record(self, place: int, op: int, length: int) -> None:
        if op == _CHUNK:
            self._chunk(place, length)
        elif op in (_DATA_END, _FOOTER):
            self._closed = True
        elif op in (_HEADER, _SCHEMA, _CHANNEL, _MESSAGE) and place + _RECORD.size + length <= self._size:
            check_memory(length, self._memory)
            self._take(op, self._file.read(length), _UNCHUNKED, place)

    def _chunk(self, place: int, length: int) -> None:
        """Take what is in a chunk, of one that was cut its beginning."""
        whole = place + _RECORD.size + length <= self._size
        chunk = _Chunk(place, min(_RECORD.size + length, self._size - place), whole)
        number = len(self._chunks)
        try:
            data, head = _unpacked(self._file, chunk, self._memory)
        except Exception as error:  # noqa: BLE001  (the decompressors raise what they like)
            if whole:
                self._damages.append(f"chunk at byte {place} cannot be read ({error or type(error).__name__})")
            return
        self._chunks.append(chunk)
        self._heads.append(head)
        at = 0
        while at + _RECORD.size <= len(data):
            op, size = _RECORD.unpack_from(data, at)
            begin = at + _RECORD.size
            if begin + size > len(data):
                break
            self._take(op, data[begin : begin + size], number, at)
            at = begin + size

    def _take(self, op: int, data: bytes, chunk: int, offset: int) -> None:
        from mcap import records  # noqa: PLC0415
        from mcap.data_stream import ReadDataStream  # noqa: PLC0415

        if op == _MESSAGE:
            channel, _, t_ns = _OF_MESSAGE.unpack_from(data)
            if channel in self._channels:
                self._rows.setdefault(channel, []).append((t_ns, chunk, offset))
        elif op == _SCHEMA:
            schema: Any = records.Schema.read(ReadDataStream(BytesIO(data)))
            self._schemas[schema.id] = schema
        elif op == _CHANNEL:
            found: Any = records.Channel.read(ReadDataStream(BytesIO(data)))
            self._channels[found.id] = found
        elif op == _HEADER:
            self._profile = records.Header.read(ReadDataStream(BytesIO(data))).profile


# --- messages ---------------------------------------------------------------------------------------------------------


class _Chunks:
    """Messages out of the chunks of an MCAP file, the last few kept; and those that are in none."""

    def __init__(self, file: Any, chunks: Sequence[_Chunk], memory: int) -> None:
        self._file, self._chunks, self._memory = file, chunks, memory
        self._kept: OrderedDict[int, Any] = OrderedDict()

    def message(self, number: int, offset: int) -> bytes:
        """Return the data of the message at an offset of a chunk.

        Raises:
            MessageError: It is damaged.
        """
        if number == _UNCHUNKED:
            self._file.seek(offset)
            _, length = _RECORD.unpack(self._file.read(_RECORD.size))
            return bytes(self._file.read(length)[_TO_DATA - _RECORD.size :])
        data = self._chunk(number)
        op, length = _RECORD.unpack_from(data, offset)
        if op != _MESSAGE or offset + _RECORD.size + length > len(data):
            raise MessageError(f"there is no whole message at {offset} of chunk {number}")
        return bytes(data[offset + _TO_DATA : offset + _RECORD.size + length])

    def _chunk(self, number: int) -> Any:
        if number not in self._kept:
            try:
                self._kept[number], _ = _unpacked(self._file, self._chunks[number], self._memory)
            except Exception as error:  # the decompressors raise what they like
                at = self._chunks[number].position
                raise MessageError(f"chunk at byte {at} is damaged: {error or type(error).__name__}") from error
            while len(self._kept) > _CACHED:
                self._kept.popitem(last=False)
        self._kept.move_to_end(number)
        return self._kept[number]


def _unpacked(file: Any, chunk: _Chunk, memory: int) -> Tuple[Any, ChunkHead]:
    """Return the data of a chunk, of one that was cut as far as it goes, and its header.

    Raises:
        RecordError: It is damaged, or takes too much memory.
    """
    check_memory(chunk.length, memory)
    file.seek(chunk.position)
    record = file.read(chunk.length)
    _, _, size, crc, name = _OF_CHUNK.unpack_from(record, _RECORD.size)
    begin = _RECORD.size + _OF_CHUNK.size + name + 8
    compression = record[begin - 8 - name : begin - 8].decode("ascii") or "none"
    stored = memoryview(record)[begin:]
    head = ChunkHead(compression, chunk.position, len(stored), size)
    if not chunk.whole:
        check_memory(size, memory)
        return _begun(compression, bytes(stored), size), head
    if compression == "zstd":
        check_memory(size, memory)
        data: Any = unzstd(bytes(stored), size)
    else:
        data = decompressed(compression, stored, size, memory)
    if len(data) != size or (crc and zlib.crc32(data) != crc):
        raise RecordError("it is not what its checksum says")
    return data, head


def _begun(compression: str, stored: bytes, size: int) -> bytes:
    """Return the data of the beginning of a chunk."""
    if compression == "lz4":
        import lz4.frame  # noqa: PLC0415

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(stored, max_length=size))
    return unzstd(stored, size) if compression == "zstd" else stored


def unzstd(data: bytes, size: int = MEMORY) -> bytes:
    """Decompress, at most to a size."""
    import zstandard  # noqa: PLC0415  (comes with mcap)

    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        plain: bytes = reader.read(size + 1)
    if len(plain) > size:
        raise RecordError(f"it has more than {size} bytes")
    return plain


def ros1_name(kind: str) -> str:
    """Return a type's name as ROS 1 has it."""
    return kind.replace("/msg/", "/")
