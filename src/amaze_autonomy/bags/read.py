"""The messages of chunks brought into buffers, and checked there as arrays (`arrays`).

Messages are never decoded and, in a good chunk, never touched one by one.

Of large messages in chunks that are not compressed only the beginning is read: their header, which says whose they are
and how long. The rest goes from file to file without coming here, unless somebody has to see it.
"""

from __future__ import annotations

import ctypes
import mmap
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any, List, NamedTuple, Optional, Tuple

import lz4.frame
import numpy as np

from .arrays import Span, Table, distinct, joined_parts, tabulate, words
from .errors import BagError, RecordError
from .format import (
    Buffer,
    decompressed,
    read_at,
    read_into,
)
from .index import (
    ChunkHead,
    Index,
    IndexPart,
    Messages,
    index_entries,
    index_parts,
    require,
    unusable,
)

# --- memory and threads -----------------------------------------------------------------------------------------------


GROUP_BYTES = 4 << 20  # that much is loaded together
_KEPT = 16
_DECOMPRESSORS = 2


class Pool:
    """Buffers that are used again, because new memory costs as much as reading into it; and threads that fill them.

    Args:
        largest: bytes of a buffer that is worth keeping.
    """

    def __init__(self, largest: int = 4 * GROUP_BYTES) -> None:
        self._free: List[bytearray] = []
        self._largest = largest
        self.workers = ThreadPoolExecutor(_DECOMPRESSORS)

    def __enter__(self) -> Pool:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.workers.shutdown()

    def get(self, size: int) -> bytearray:
        """Return a buffer of at least this size."""
        for place, buffer in enumerate(self._free):
            if len(buffer) >= size:
                return self._free.pop(place)
        return bytearray(max(size + (size >> 3), GROUP_BYTES))

    @staticmethod
    def sparse(size: int) -> Any:
        """Return a new buffer of which only the pages take memory that are written to."""
        buffer = mmap.mmap(-1, size)
        if hasattr(mmap, "MADV_NOHUGEPAGE"):
            buffer.madvise(mmap.MADV_NOHUGEPAGE)
        return buffer

    def put(self, buffer: bytearray) -> None:
        """Take a buffer back."""
        if isinstance(buffer, bytearray) and len(self._free) < _KEPT and len(buffer) <= self._largest:
            self._free.append(buffer)


# --- lz4 frames decompressed into memory that is already there --------------------------------------------------------
# The `lz4` package makes new memory for each frame, grows it, and copies the result once more. The library that it is
# made of has a function for it, and is found in the package itself.

_FRAME_VERSION = 100  # of the library's interface, unchanged since 2014
_CREATE, _DECOMPRESS = "LZ4F_createDecompressionContext", "LZ4F_decompress"
_FREE, _RESET = "LZ4F_freeDecompressionContext", "LZ4F_resetDecompressionContext"


def decompress_frame(data: bytes, size: int, target: bytearray, place: int) -> bool:
    """Decompress one frame into a buffer; return whether it is whole, good, and of this size.

    The buffer must reach to `place + size` at least. Other threads run meanwhile; each has a context of its own.
    """
    context = _contexts.get()
    return context is not None and context.decompress(data, size, target, place)


def lz4_library() -> Optional[Any]:
    """Return the library; None where it is not found."""
    try:
        return ctypes.CDLL(lz4.frame._frame.__file__)  # noqa: SLF001  (nothing public tells where it is)
    except (AttributeError, OSError):
        return None


def _library() -> Optional[Any]:
    library = lz4_library()
    try:
        create, decompress = getattr(library, _CREATE), getattr(library, _DECOMPRESS)
        free, reset = getattr(library, _FREE), getattr(library, _RESET)
    except AttributeError:
        return None
    size = ctypes.c_size_t
    create.argtypes, create.restype = [ctypes.POINTER(ctypes.c_void_p), ctypes.c_uint], size
    free.argtypes, free.restype = [ctypes.c_void_p], size
    reset.argtypes, reset.restype = [ctypes.c_void_p], None
    amount = ctypes.POINTER(size)
    decompress.argtypes = [ctypes.c_void_p, ctypes.c_void_p, amount, ctypes.c_char_p, amount, ctypes.c_void_p]
    decompress.restype = size
    return library


class _Context:
    def __init__(self, library: Any) -> None:
        self._library, self._context = library, ctypes.c_void_p()
        library.LZ4F_createDecompressionContext(ctypes.byref(self._context), _FRAME_VERSION)

    def __del__(self) -> None:
        self._library.LZ4F_freeDecompressionContext(self._context)

    def decompress(self, data: bytes, size: int, target: bytearray, place: int) -> bool:
        if not self._context or not size or place + size > len(target):
            return False
        address = ctypes.addressof(ctypes.c_char.from_buffer(target, place))
        written, taken = ctypes.c_size_t(size), ctypes.c_size_t(len(data))
        left = self._library.LZ4F_decompress(
            self._context, address, ctypes.byref(written), data, ctypes.byref(taken), None
        )
        if left:  # bytes that are still missing, or an error
            self._library.LZ4F_resetDecompressionContext(self._context)
        return not left and written.value == size


class _Contexts(threading.local):
    def __init__(self) -> None:
        library = _LIBRARY
        self._context = None if library is None else _Context(library)

    def get(self) -> Optional[_Context]:
        return self._context


_LIBRARY = _library()
_contexts = _Contexts()


def decompress_into(target: bytearray, place: int, kind: str, data: bytes, size: int) -> None:
    """Decompress the data of a chunk to a place in a buffer that has room for it.

    Raises:
        RecordError: It is damaged, or not of this size.
    """
    if kind == "lz4" and decompress_frame(data, size, target, place):
        return  # else the usual way, which says what is wrong
    target[place : place + size] = decompressed(kind, data, size, size)


# --- chunks loaded ----------------------------------------------------------------------------------------------------


BEGINNING = 512  # bytes of a large message that are read; its header has about 50
_LARGE = 64 << 10  # what is worth a copy by the system
_COARSE = 16 << 10  # bytes per message that make it worth looking for large ones
_SPARSE = 6  # times as much is loaded together, at most, of chunks of which little is read
_BROKEN = (RecordError, struct.error, ValueError)

_Entries = Tuple[Any, Any, Any]


class Block(NamedTuple):
    """Loaded messages.

    Args:
        buffer: where they are.
        table: of them.
        source: number of the input.
        origin: where in its file a large one begins that is not all in the buffer; else -1.
        whole: size of what is not a record but a compressed chunk with just this message; else 0.
    """

    buffer: bytearray
    table: Table
    source: int
    origin: Any
    whole: Any


class Loader:
    """Loads chunks of a bag.

    Args:
        index: of the bag.
        number: of the input.
        unseen: for each connection of the bag, whether the bytes of its messages need not be seen.
        messages: all of the index, where they were read before; else a chunk's are read with it.
    """

    def __init__(self, index: Index, number: int, unseen: Any, messages: Optional[Messages] = None) -> None:
        self._index, self._number, self._unseen = index, number, unseen
        self._messages = messages
        self._share = 0.5  # of the last coarse chunks, that was read; where that is not known, not little
        self._passed = frozenset(np.flatnonzero(unseen).tolist())
        if messages is not None:
            bounds: Any = np.searchsorted(messages.chunk, np.arange(len(index.chunks) + 1))
            self._bounds: List[int] = bounds.tolist()

    def size_of(self, number: int) -> int:
        """Return about how many bytes a chunk brings along: less than it has, where not all of it is read."""
        size = self._index.head(number).size
        return int(size * self._share) if self.is_coarse(number) else size

    def compressed(self, numbers: List[int], pool: Pool) -> Block:
        """Return the messages of compressed chunks.

        Raises:
            BagError: One is damaged, or takes more memory than may be.
        """
        heads = [self._index.compressed_head(number) for number in numbers]
        places = np.cumsum([0, *(head.size for head in heads)]).tolist()
        buffer = pool.get(places[-1])
        jobs = [pool.workers.submit(self._decompress, *job, buffer) for job in zip(numbers, heads, places)]
        parts = [job.result() for job in jobs]
        spans = [Span(place, place + head.size) for place, head in zip(places, heads)]
        entries: Any = tuple(np.concatenate(each) for each in zip(*parts))
        return self._block(numbers, buffer, spans, entries, np.zeros((0, 2), np.int64))

    def _decompress(self, number: int, head: ChunkHead, place: int, buffer: bytearray) -> _Entries:
        chunk = self._index.chunks[number]
        raw = read_at(self._index.file, chunk.end - head.data, head.data)
        try:
            decompress_into(buffer, place, head.compression, raw[: head.stored], head.size)
            t_ns, connection, offset = self._entries(number, raw, head.stored, len(raw))
            require(not len(offset) or int(offset.max()) < head.size, "the index points behind its end")
        except _BROKEN as error:
            raise unusable(self._index.path, chunk.position, error) from error
        return t_ns, connection, offset + place

    def plain(self, numbers: List[int], pool: Pool) -> Block:
        """Return the messages of chunks that are not compressed.

        Raises:
            BagError: One is damaged.
        """
        chunks = [self._index.chunks[number] for number in numbers]
        heads = [self._index.head(number) for number in numbers]
        places = np.cumsum([0, *(chunk.end - chunk.position for chunk in chunks)]).tolist()
        coarse = [self.is_coarse(number) for number in numbers]
        buffer = pool.sparse(places[-1]) if any(coarse) else pool.get(places[-1])
        self._read_all(buffer, [each for each, few in enumerate(coarse) if not few], numbers, places)
        begins = [place + head.data - chunk.position for chunk, head, place in zip(chunks, heads, places)]
        spans = [Span(begin, begin + head.stored) for begin, head in zip(begins, heads)]
        entries = self._plain_entries(numbers, buffer, spans, coarse)
        cut: Any = np.zeros((0, 2), np.int64)
        if any(coarse):
            shifts: Any = np.array([head.data - begin for begin, head in zip(begins, heads)])
            cut = self._read_coarse(buffer, spans, shifts, np.array(coarse), entries)
        return self._block(numbers, buffer, spans, entries, cut)

    def _plain_entries(self, numbers: List[int], buffer: Any, spans: List[Span], coarse: List[bool]) -> _Entries:
        """Return times, connections and places in the buffer of all messages; of coarse chunks their index is read."""
        parts: List[IndexPart] = []
        for number, span, few in zip(numbers, spans, coarse):
            chunk, head = self._index.chunks[number], self._index.head(number)
            behind = chunk.end - head.data - head.stored
            try:
                require(head.size == head.stored, "its sizes differ although it is not compressed")
                if self._messages is None:
                    if few:
                        self._read(buffer, span.end, head.data + head.stored, behind)
                    parts += index_parts(buffer, span.end, span.end + behind, dict(chunk.counts))[0]
            except _BROKEN as error:
                raise unusable(self._index.path, chunk.position, error) from error
        t_ns, connection, offset = joined_parts(parts) if self._messages is None else self._known(numbers)
        counts = [self._index.chunks[number].messages for number in numbers]
        begin: Any = np.repeat([span.start for span in spans], counts)
        beyond = np.flatnonzero(begin + offset >= np.repeat([span.end for span in spans], counts))
        if len(beyond):
            number = numbers[int(np.searchsorted(np.cumsum(counts), beyond[0], "right"))]
            wrong = RecordError("the index points behind its end")
            raise unusable(self._index.path, self._index.chunks[number].position, wrong)
        return t_ns, connection, offset + begin

    def _known(self, numbers: List[int]) -> _Entries:
        """Return times, connections and offsets of the messages of chunks, all of which were read before."""
        parts = [self._entries(number, b"", 0, 0) for number in numbers]
        return tuple(np.concatenate(each) for each in zip(*parts))

    def _entries(self, number: int, buffer: Buffer, place: int, limit: int) -> _Entries:
        """Return times, connections and offsets of a chunk's messages; what is behind the chunk lies in a buffer."""
        if self._messages is None:
            return index_entries(buffer, place, limit, dict(self._index.chunks[number].counts))[:3]
        rows = slice(*self._bounds[number : number + 2])
        return self._messages.t_ns[rows], self._messages.connection[rows], self._messages.offset[rows]

    def is_coarse(self, number: int) -> bool:
        """Return True when of a chunk only what lies between large messages is read."""
        chunk, head = self._index.chunks[number], self._index.head(number)
        if head.compression != "none" or head.stored < max(_LARGE, _COARSE * chunk.messages):
            return False
        return any(connection in self._passed for connection, _ in chunk.counts)

    def _read_coarse(self, buffer: Any, spans: List[Span], shifts: Any, coarse: Any, entries: _Entries) -> Any:
        """Read coarse chunks without what is large in them; return where in the buffer and the file that begins."""
        begins: Any = np.array([span.start for span in spans])
        ends: Any = np.array([span.end for span in spans])
        order = np.argsort(entries[2])
        start, connection = entries[2][order], entries[1][order]
        chunk: Any = np.searchsorted(begins, start, "right") - 1
        follows: Any = np.minimum(np.append(start[1:], ends[-1]), ends[chunk])
        large = np.flatnonzero((follows - start >= _LARGE) & self._unseen[connection] & coarse[chunk])
        start, follows, chunk = start[large], follows[large], chunk[large]
        bounds = np.append(begins[coarse], follows), np.append(start + BEGINNING, ends[coarse])
        self._read_between(buffer, *bounds, begins, shifts)
        torn = distinct(chunk[~_are_whole(buffer, start, follows)])
        for each in torn:  # there is more in it than messages, or damage
            begin, size = int(begins[each]), int(ends[each] - begins[each])
            self._read(buffer, begin, begin + int(shifts[each]), size)
        read = (bounds[1].sum() - bounds[0].sum()) / (ends[coarse] - begins[coarse]).sum()
        self._share = 1.0 if torn else min(1.0, max(float(read), 1 / _SPARSE))
        good = ~np.isin(chunk, torn)
        return np.stack((start[good], start[good] + shifts[chunk[good]]), 1)

    def _read_between(self, buffer: Any, first: Any, last: Any, begins: Any, shifts: Any) -> None:
        """Read what lies between places of a buffer; `shifts` is how far behind them it lies in the file, by chunk."""
        first, last = np.sort(first), np.sort(last)
        file, view = self._index.file, memoryview(buffer)
        position = first + shifts[np.searchsorted(begins, first, "right") - 1]
        for begin, end, at in zip(first.tolist(), last.tolist(), position.tolist()):
            if begin < end and read_into(file, [view[begin:end]], at) != end - begin:
                raise self._shorter()

    def _read_all(self, buffer: bytearray, which: List[int], numbers: List[int], places: List[int]) -> None:
        """Read chunks as they are, neighbours in one go."""
        chunks = self._index.chunks
        first = 0
        for last, each in enumerate(which):
            following = which[last + 1] if last + 1 < len(which) else -1
            if following == each + 1 and chunks[numbers[each]].end == chunks[numbers[following]].position:
                continue
            begin = which[first]
            self._read(buffer, places[begin], chunks[numbers[begin]].position, places[each + 1] - places[begin])
            first = last + 1

    def _read(self, buffer: bytearray, place: int, position: int, size: int) -> None:
        if size and read_into(self._index.file, [memoryview(buffer)[place : place + size]], position) != size:
            raise self._shorter()

    def _shorter(self) -> BagError:
        return BagError(str(self._index.path), "became shorter while it was read", "try again")

    def _block(self, numbers: List[int], buffer: bytearray, spans: List[Span], entries: _Entries, cut: Any) -> Block:
        """Check the messages in a buffer; `cut` are places of those that are not all there, and those in the file."""
        try:
            table = tabulate(buffer, spans, *entries, known=self._index.connections)
        except (*_BROKEN, IndexError) as error:
            raise self._damaged(numbers, buffer, spans, entries, error) from error
        origin: Any = np.full(len(table.start), -1)
        origin[np.searchsorted(table.start, cut[:, 0])] = cut[:, 1]
        return Block(buffer, table, self._number, origin, np.zeros(len(table.start), np.int64))

    def _damaged(self, numbers: List[int], buffer: Any, spans: Any, entries: _Entries, error: Exception) -> BagError:
        """Return the error for the first of some chunks that is damaged."""
        first = 0
        for number, span in zip(numbers, spans):
            chunk = self._index.chunks[number]
            rows = slice(first, first + chunk.messages)
            first += chunk.messages
            try:
                t_ns, connection, start = (column[rows] for column in entries)
                tabulate(buffer, [span], t_ns, connection, start, self._index.connections)
            except (*_BROKEN, IndexError) as found:
                return unusable(self._index.path, chunk.position, found)
        return unusable(self._index.path, self._index.chunks[numbers[0]].position, error)


def _are_whole(buffer: bytearray, start: Any, follows: Any) -> Any:
    """Return for each message whether it ends where the next begins, by what stands in its beginning."""
    numbers = words(buffer)
    header = numbers[start].astype(np.int64)
    short = header <= BEGINNING - 8
    return short & (start + 8 + header + numbers[np.where(short, start + 4 + header, start)] == follows)
