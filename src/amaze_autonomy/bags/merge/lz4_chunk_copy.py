"""A compressed chunk that is almost all one image goes into a merge as it is, without being decompressed.

Why: a camera's recording in lz4 would else be decompressed and written at twice its size; copied like this a merge is
2.5 times as fast as librosbag, into a bag of half the size (docs/bags.md has the figures, and the trade: damage in the
image is copied, and stays visible by the checksum).

Recorders close a chunk with the message that fills it, so a chunk of a camera is a few small messages and one image. A
merge has to put the small ones elsewhere, and to write another connection into the image's header. But lz4 refers back:
nothing in a compressed block can be changed or taken out. It can be hidden. A header may have fields that nobody
knows, and so the frame gets one more block in front, with the beginning of a new header:

    length, conn=, op=, time=, pad=<some bytes>, was=     the new block
    the small messages and the image's old header          } the old blocks:
    the image's length, the image                          } not a byte of them is changed

All that stood before the image's length is now the value of `was`, and the image is the only message of its chunk.
Where frame or chunk are not just so, nothing is done, and the chunk has to be decompressed.

The checksum of the whole content is told from the old one. XXH32 (github.com/Cyan4973/xxHash, doc/xxhash_spec.md) goes
through stripes of 16 bytes, four numbers each: for every one of these there is an accumulator. A step can be gone
backwards, and for any two values of an accumulator there is one number that leads from one to the other. So a stripe
can be found, and put into `pad`, behind which the accumulators are as they were at the beginning; what follows it then
comes to the same. Only the length, and the bytes behind the last stripe, are mixed in later: the last bytes of a block,
which the `lz4` package cannot decompress alone, and the library that it is made of can.
"""

from __future__ import annotations

import ctypes
import struct
import threading
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ..arrays import Span, Table, relabel, tabulate
from ..errors import BagError, RecordError
from ..format import MESSAGE, Record, message_fields, pack_field, read_into, record_at, u32
from ..index import ChunkHead, Index
from ..read import Block, Pool, lz4_library

# --- the checksum of a longer content ---------------------------------------------------------------------------------


STRIPE = 16
_MASK = 0xFFFFFFFF
_P1, _P2, _P3, _P4, _P5 = 2654435761, 2246822519, 3266489917, 668265263, 374761393
_Q1, _Q2, _Q3, _Q4 = (pow(prime, (1 << 31) - 1, 1 << 32) for prime in (_P1, _P2, _P3, _P4))  # times them it is 1
_BEGINNING = ((_P1 + _P2) & _MASK, _P2, 0, -_P1 & _MASK)


def neutral_stripe(before: bytes, behind: bytes) -> bytes:
    """Return the stripe that makes a beginning of a content invisible to what follows.

    Args:
        before: whole stripes, from the first byte of the content on.
        behind: whole stripes that follow the one that is returned.
    """
    first, last = struct.unpack(f"<{len(before) // 4}L", before), struct.unpack(f"<{len(behind) // 4}L", behind)
    words = []
    for lane, beginning in enumerate(_BEGINNING):
        there, back = _forward(beginning, first[lane::4]), _backward(beginning, last[lane::4])
        words.append((_backward(back, (0,)) - there) * _Q2 & _MASK)
    return struct.pack("<4L", *words)


def _forward(value: int, words: Sequence[int]) -> int:
    for word in words:
        value = (value + word * _P2) & _MASK
        value = ((value << 13 | value >> 19) & _MASK) * _P1 & _MASK
    return value


def _backward(value: int, words: Sequence[int]) -> int:
    for word in reversed(words):
        value = value * _Q1 & _MASK
        value = ((value >> 13 | value << 19) - word * _P2) & _MASK
    return value


def lengthened(checksum: int, by: int, end: bytes) -> int:
    """Return the checksum of a content, of at least one stripe, behind a beginning that is invisible to it.

    Args:
        checksum: of the content.
        by: bytes of the beginning, whole stripes.
        end: last bytes of the content: those behind its last whole stripe.
    """
    steps = _steps(end)
    value = _unavalanched(checksum)
    for number, _, rotation, inverse in reversed(steps):
        value = value * inverse & _MASK
        value = ((value >> rotation | value << 32 - rotation) - number) & _MASK
    value += by
    for number, factor, rotation, _ in steps:
        value = (value + number) & _MASK
        value = ((value << rotation | value >> 32 - rotation) & _MASK) * factor & _MASK
    return _avalanched(value & _MASK)


def _steps(end: bytes) -> List[Tuple[int, int, int, int]]:
    """Return what is done with each number of the end: (added, factor, rotation before, inverse of the factor)."""
    whole = len(end) // 4
    words = [(word * _P3, _P4, 17, _Q4) for word in struct.unpack_from(f"<{whole}L", end)]
    return words + [(byte * _P5, _P1, 11, _Q1) for byte in end[4 * whole :]]


def _avalanched(value: int) -> int:
    value = (value ^ value >> 15) * _P2 & _MASK
    value = (value ^ value >> 13) * _P3 & _MASK
    return value ^ value >> 16


def _unavalanched(value: int) -> int:
    value = (value ^ value >> 16) * _Q3 & _MASK
    value = (value ^ value >> 13 ^ value >> 26) * _Q2 & _MASK
    return value ^ value >> 15 ^ value >> 30


# --- the two ends of lz4 blocks ---------------------------------------------------------------------------------------


_LARGEST = 4 << 20  # content of a block in a frame
_LITERALS = 5  # the last bytes of a block are stored as they are (lz4_Block_format.md, end of block conditions)
_LONGEST = 15  # a run of literals that long says its length in further bytes


def block_beginning(stored: memoryview, size: int) -> bytes:
    """Return the first bytes of a block's content; fewer where it has no more, none when it is damaged."""
    if _LIBRARY is None or not len(stored):
        return b""
    target = ctypes.create_string_buffer(size)
    decompress = _LIBRARY.LZ4_decompress_safe_partial
    found = decompress(_address(stored), target, len(stored), size, size)
    return target.raw[: max(found, 0)]


def block_end(stored: memoryview, size: int) -> Optional[bytes]:
    """Return the last bytes of a block's content, at most 15; None when it is damaged or has fewer.

    They are often the last bytes of the block itself: always up to five of them, and more unless a byte before them
    could be the beginning of a shorter run of literals. Else all of the block is decompressed.
    """
    if size < len(stored) and size <= _LONGEST and not _may_be_short(stored, size):
        return bytes(stored[len(stored) - size :])
    if _LIBRARY is None or not len(stored):
        return None
    target = _scratch.get()
    found = _LIBRARY.LZ4_decompress_safe(_address(stored), target, len(stored), _LARGEST)
    return None if found < size else ctypes.string_at(ctypes.addressof(target) + found - size, size)


def _may_be_short(stored: memoryview, size: int) -> bool:
    """Return whether the last run of literals may be shorter; its length is in the upper half of the byte before it."""
    return any(stored[-1 - length] >> 4 == length for length in range(_LITERALS, size))


def _address(stored: memoryview) -> int:
    return ctypes.addressof(ctypes.c_char.from_buffer(stored))


def _prepared() -> Optional[Any]:
    library = lz4_library()
    try:
        for name, numbers in (("LZ4_decompress_safe_partial", 3), ("LZ4_decompress_safe", 2)):
            function = getattr(library, name)
            function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, *[ctypes.c_int] * numbers]
            function.restype = ctypes.c_int
    except AttributeError:
        return None
    return library


class _Scratch(threading.local):
    """Memory for a block that is decompressed for its end alone; each thread has its own."""

    _memory: Any = None

    def get(self) -> Any:
        if self._memory is None:
            self._memory = ctypes.create_string_buffer(_LARGEST)
        return self._memory


_LIBRARY = _prepared()
_scratch = _Scratch()


# --- a chunk gets another beginning -----------------------------------------------------------------------------------


LARGE = 64 << 10  # bytes of a message that are worth it
HIDDEN = 16  # times less is hidden at most
_HEADER = 512  # bytes of a message's header, mostly
_FRAME = b"\x04\x22\x4d\x18\x64"  # what roslz4 reads: independent blocks, a checksum of the content, nothing else
_FRAME_HEADER = 7
_PLAIN = 1 << 31  # set in the size of a block that is not compressed
_PREFIX = 96  # bytes of the new beginning
_STRIPE_AT = 64
ROOM = _PREFIX + 4  # bytes that are needed in front of a frame


class Message(NamedTuple):
    """What an index says of a message."""

    t_ns: int
    connection: int
    offset: int


class Wrapped(NamedTuple):
    """A frame with a new beginning.

    Args:
        start: where it begins in the buffer; where it ends has not changed.
        size: of its content.
        hidden: the old content up to the large message.
    """

    start: int
    size: int
    hidden: bytes


_Blocks = List[Tuple[memoryview, bool]]  # what is stored of each, and whether it is compressed


def wrapped(
    buffer: bytearray, start: int, end: int, size: int, message: Message, target: Optional[Message]
) -> Optional[Wrapped]:
    """Give a frame a new beginning in place; None where that is not possible, and nothing was changed.

    Args:
        buffer: with the frame, and ROOM bytes before it.
        start: where the frame begins.
        end: where it ends.
        size: of its content.
        message: the large one, last of the chunk, as the index says.
        target: as it is to be; None to leave the frame as it is, when nothing else is in it.
    """
    blocks = _blocks(buffer, start, end)
    if not blocks:
        return None
    content = _beginning(blocks, message.offset, size // HIDDEN)
    record = _record(content, message)
    if record is None or record.end != size or record.size < LARGE:
        return None
    if target is None and message.offset == 0:
        return Wrapped(start, size, b"")
    tail = _tail(blocks, size % STRIPE)
    if tail is None:
        return None
    checksum = lengthened(u32(buffer, end - 4), _PREFIX, tail)
    prefix = _prefix(target or message, record.data - 4)
    head = bytes(buffer[start : start + _FRAME_HEADER]) + struct.pack("<L", _PREFIX | _PLAIN) + prefix
    buffer[start - ROOM : start + _FRAME_HEADER] = head
    buffer[end - 4 : end] = struct.pack("<L", checksum)
    return Wrapped(start - ROOM, size + _PREFIX, content[: message.offset])


def _blocks(buffer: bytearray, start: int, end: int) -> _Blocks:
    """Return the blocks of a frame of the expected kind; none of any other."""
    found: _Blocks = []
    place, view = start + _FRAME_HEADER, memoryview(buffer)
    if view[start : start + len(_FRAME)] != _FRAME:
        return found
    while place <= end - 8:
        size = u32(buffer, place) & ~_PLAIN
        if not size:
            break
        found.append((view[place + 4 : place + 4 + size], size == u32(buffer, place)))
        place += 4 + size
    return found if place == end - 8 else []


def _beginning(blocks: _Blocks, offset: int, most: int) -> bytes:
    """Return the first bytes of the content, with the header at an offset; nothing when that is too far away."""
    content = _first(blocks, offset + _HEADER)
    if offset + 4 > len(content):
        return b""
    end = offset + 8 + u32(content, offset)
    if max(offset, end) > most:
        return b""
    return content if end <= len(content) else _first(blocks, end)


def _first(blocks: _Blocks, size: int) -> bytes:
    """Return so many bytes, fewer where there are no more."""
    content = b""
    for stored, is_compressed in blocks:
        missing = size - len(content)
        if missing <= 0:
            break
        content += block_beginning(stored, missing) if is_compressed else bytes(stored[:missing])
    return content


def _tail(blocks: _Blocks, size: int) -> Optional[bytes]:
    stored, is_compressed = blocks[-1]
    tail = block_end(stored, size) if is_compressed else bytes(stored[len(stored) - size :])
    return tail if tail is not None and len(tail) == size else None


def _record(content: bytes, message: Message) -> Optional[Record]:
    try:
        record = record_at(content, message.offset, len(content))
        said = record.op, record.number(b"conn"), record.time_ns(b"time")
    except (RecordError, struct.error):
        return None
    return record if said == (MESSAGE, message.connection, message.t_ns) else None


def _prefix(message: Message, hidden: int) -> bytes:
    """Return the beginning of a record whose header goes on for some bytes."""
    fields = message_fields(message.connection, message.t_ns)
    length = struct.pack("<L", _PREFIX - 4 + hidden)
    was = struct.pack("<L", len(b"was=") + hidden) + b"was="
    pad = _PREFIX - len(length) - len(fields) - len(was) - len(pack_field(b"pad", b""))
    whole = length + fields + pack_field(b"pad", bytes(pad)) + was
    before, behind = whole[:_STRIPE_AT], whole[_STRIPE_AT + STRIPE :]
    return before + neutral_stripe(before, behind) + behind


# --- such chunks of an input ------------------------------------------------------------------------------------------


_SMALL = 1024  # bytes per message, on average, of which there may be many beside a large one
_BROKEN = (RecordError, struct.error, ValueError, IndexError)


class _ChunkCopy(NamedTuple):
    """One such chunk: its number and header, and times, connections and offsets of its messages, the large one last."""

    number: int
    head: ChunkHead
    t_ns: Any
    connection: Any
    offset: Any

    @property
    def before(self) -> int:
        """Return how many bytes stand before the large message."""
        return int(self.offset[-1])

    def large(self) -> Message:
        """Return the large message."""
        return Message(int(self.t_ns[-1]), int(self.connection[-1]), self.before)


class ChunkCopies:
    """Loads such chunks of an input; their messages get other connections and times at once.

    Args:
        index: of the bag.
        number: of the input.
        target: the connection's number in the output, by its number here.
        shift_ns: added to record times.
        unseen: for each connection here, whether the bytes of its messages need not be seen.
    """

    def __init__(self, index: Index, number: int, target: Any, shift_ns: int, unseen: Any) -> None:
        self._index, self._number, self._target, self._shift_ns = index, number, target, shift_ns
        self._unseen = unseen
        self._found: Dict[int, Optional[_ChunkCopy]] = {}

    def maybe(self, number: int) -> bool:
        """Return whether a chunk could be one, by what is known of it without reading its index."""
        head, chunk = self._index.head(number), self._index.chunks[number]
        if head.compression != "lz4" or head.size < max(LARGE, _SMALL * chunk.messages):
            return False
        return any(self._unseen[connection] for connection, _ in chunk.counts)

    def has(self, number: int) -> bool:
        """Return whether a chunk is one, by its index."""
        if number not in self._found:
            self._found[number] = self._looked_at(number) if self.maybe(number) else None
        return self._found[number] is not None

    def _looked_at(self, number: int) -> Optional[_ChunkCopy]:
        try:
            columns = self._index.entries(number)
        except BagError:
            return None  # to be said by those who decompress it
        order = np.argsort(columns[2], kind="stable")
        chunk_copy = _ChunkCopy(number, self._index.head(number), *(column[order] for column in columns))
        size, before = chunk_copy.head.size, chunk_copy.before
        fits = size - before >= LARGE and before * HIDDEN <= size and self._unseen[chunk_copy.connection[-1]]
        return chunk_copy if fits else None

    def load(self, numbers: List[int], pool: Pool) -> Optional[Block]:
        """Return the messages of such chunks; None when one of them has to be decompressed after all."""
        chunk_copies = [chunk_copy for chunk_copy in (self._found.pop(number) for number in numbers) if chunk_copy]
        sizes = [chunk_copy.before + ROOM + chunk_copy.head.stored for chunk_copy in chunk_copies]
        places = np.cumsum([0, *sizes]).tolist()
        buffer = pool.get(places[-1])
        jobs = [pool.workers.submit(self._wrap, *job, buffer) for job in zip(chunk_copies, places)]
        frames = [job.result() for job in jobs]
        try:
            small = self._small(buffer, chunk_copies, places)
        except _BROKEN:
            small = None
        if small is None or None in frames:
            pool.put(buffer)
            return None
        ends = [place + size for place, size in zip(places, sizes)]
        return self._together(buffer, small, chunk_copies, [frame for frame in frames if frame], ends)

    def _wrap(self, chunk_copy: _ChunkCopy, place: int, buffer: bytearray) -> Optional[Wrapped]:
        head, start = chunk_copy.head, place + chunk_copy.before + ROOM
        end = start + head.stored
        if read_into(self._index.file, [memoryview(buffer)[start:end]], head.data) != head.stored:
            return None
        large = chunk_copy.large()
        target = self._new(large)
        alone = len(chunk_copy.t_ns) == 1 and target[:2] == large[:2]
        frame = wrapped(buffer, start, end, head.size, large, None if alone else target)
        if frame is not None:
            buffer[place : place + len(frame.hidden)] = frame.hidden
        return frame

    def _new(self, message: Message) -> Message:
        return Message(message.t_ns + self._shift_ns, int(self._target[message.connection]), 0)

    def _small(self, buffer: bytearray, chunk_copies: List[_ChunkCopy], places: List[int]) -> Table:
        """Return what stands before the large messages."""
        spans = [Span(place, place + chunk_copy.before) for chunk_copy, place in zip(chunk_copies, places)]
        columns = (
            np.concatenate([chunk_copy.t_ns[:-1] for chunk_copy in chunk_copies]),
            np.concatenate([chunk_copy.connection[:-1] for chunk_copy in chunk_copies]),
            np.concatenate([chunk_copy.offset[:-1] + place for chunk_copy, place in zip(chunk_copies, places)]),
        )
        table = tabulate(buffer, spans, *columns, known=self._index.connections)
        return relabel(buffer, table, self._target[table.connection], self._shift_ns)

    def _together(
        self, buffer: bytearray, small: Table, chunk_copies: List[_ChunkCopy], frames: List[Wrapped], ends: List[int]
    ) -> Block:
        large = [self._new(chunk_copy.large()) for chunk_copy in chunk_copies]
        start = [frame.start for frame in frames]
        rows = [message.t_ns for message in large], [message.connection for message in large], start, start, ends
        columns: List[Any] = [np.append(few, np.array(more, np.int64)) for few, more in zip(small, rows)]
        whole = np.append(np.zeros(len(small.start), np.int64), [frame.size for frame in frames])
        order = np.argsort(columns[2], kind="stable")
        t_ns, connection, begin, payload, end = (column[order] for column in columns)
        table = Table(t_ns, connection, begin, payload, end, (-1, -1))
        return Block(buffer, table, self._number, np.full(len(order), -1), whole[order])
