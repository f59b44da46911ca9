"""Numbers and texts out of many messages at once, as columns, without making an object of any message.

The value of each is bit for bit what the rosbags library says. What that library would refuse - a message of a wrong
size, a text that may not be UTF-8 - has no row here, so that whoever asks can let the library say what is wrong.
Messages that are wanted as a whole, because they hold lists, are a column of objects.

Where each message begins is in the index, so it is known beforehand what has to be read of a chunk that is not
compressed: all that lies between large messages that nobody wants, and of these the beginning. What was read stands in
the buffer one piece behind the other.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from typing import Any, Callable, Dict, Iterable, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from .arrays import Table, tabulated, words
from .definitions import TEXT, Layout, Read, layout_of, reader_of
from .errors import BagError, RecordError
from .format import read_into
from .index import Index, Messages, require, unusable
from .read import BEGINNING, GROUP_BYTES, Loader, Pool

# --- chunks that are not compressed, without what nobody wants --------------------------------------------------------


_LARGE = 64 << 10  # bytes of a message that are worth a read of their own
_BROKEN = (RecordError, struct.error, ValueError, IndexError)


class PlainChunks:
    """Reads such chunks of a bag.

    Args:
        index: of the bag.
        messages: all of the index.
        order: places in `messages` in the order of the file.
        unseen: for each connection of the bag, whether the bytes of its messages need not be seen.
    """

    def __init__(self, index: Index, messages: Messages, order: Any, unseen: Any) -> None:
        self._index = index
        self._t_ns, self._connection = messages.t_ns[order], messages.connection[order]
        chunk = messages.chunk[order]
        heads = [index.head(number) if each.counts else None for number, each in enumerate(index.chunks)]
        self._begin: Any = np.array([head.data if head else 0 for head in heads], np.int64)  # of each chunk's data
        self._end: Any = self._begin + [head.stored if head else 0 for head in heads]
        self._bounds: Any = np.searchsorted(chunk, np.arange(len(heads) + 1))
        self._start = self._begin[chunk] + messages.offset[order]  # of each message in the file
        sizes: Any = np.array([head.size if head else 0 for head in heads], np.int64)
        self._inside = (self._start < self._end[chunk]) & (sizes == self._end - self._begin)[chunk]
        self._follows: Any = np.append(self._start[1:], 0)
        last = self._bounds[1:][np.diff(self._bounds) > 0] - 1
        self._follows[last] = self._end[chunk[last]]
        size = self._follows - self._start
        self._large = (size >= _LARGE) & unseen[self._connection]
        left_out = np.bincount(chunk, np.where(self._large, size - BEGINNING, 0), len(heads))
        self._sizes: List[int] = (self._end - self._begin - left_out.astype(np.int64)).tolist()

    def groups(self, numbers: List[int]) -> Iterator[List[int]]:
        """Return chunks, those together that are worth a buffer."""
        return grouped([(number, self._sizes[number]) for number in numbers])

    def rows(self, numbers: List[int]) -> Any:
        """Return places in `order` of the messages of some chunks."""
        return np.concatenate([np.arange(*self._bounds[number : number + 2].tolist()) for number in numbers])

    def load(self, numbers: List[int], pool: Pool) -> Tuple[bytearray, Table]:
        """Return the messages of some chunks, in the order of the file.

        Raises:
            BagError: One is damaged, or has more in it than messages.
        """
        buffer = pool.get(sum(self._sizes[number] for number in numbers))
        try:
            return buffer, self._table(buffer, np.array(numbers))
        except _BROKEN as error:
            raise unusable(self._index.path, self._index.chunks[numbers[0]].position, error) from error

    def _table(self, buffer: bytearray, numbers: Any) -> Table:
        rows = self.rows(numbers)
        start, large = self._start[rows], np.flatnonzero(self._large[rows])
        follows = self._follows[rows][large]
        begins: Any = np.sort(np.concatenate((self._begin[numbers], follows)))
        ends: Any = np.sort(np.concatenate((start[large] + BEGINNING, self._end[numbers])))
        sizes: Any = ends - begins
        require(bool(self._inside[rows].all()) and bool((sizes >= 0).all()), "the index points behind its end")
        places: Any = np.cumsum(sizes) - sizes
        self._read(buffer, places, sizes, begins)
        piece: Any = np.searchsorted(begins, start, "right") - 1
        start = places[piece] + start - begins[piece]
        stops = places + sizes
        stops[piece[large]] = start[large] + follows - self._start[rows][large]  # as if all of it were there
        require(_are_whole(buffer, start[large], stops[piece[large]]), "there is more in it than messages")
        return tabulated(buffer, places, stops, self._t_ns[rows], self._connection[rows], start)

    def _read(self, buffer: bytearray, places: Any, sizes: Any, begins: Any) -> None:
        """Read pieces of the file into a buffer."""
        file, view = self._index.file, memoryview(buffer)
        for place, size, begin in zip(places.tolist(), sizes.tolist(), begins.tolist()):
            if size and read_into(file, [view[place : place + size]], begin) != size:
                raise BagError(str(self._index.path), "became shorter while it was read", "try again")


def grouped(sizes: List[Tuple[int, int]]) -> Iterator[List[int]]:
    """Return the numbers of chunks in groups, by their sizes."""
    group: List[int] = []
    whole = 0
    for number, size in sizes:
        group.append(number)
        whole += size
        if whole >= GROUP_BYTES:
            yield group
            group, whole = [], 0
    if group:
        yield group


def _are_whole(buffer: bytearray, start: Any, follows: Any) -> bool:
    """Return whether messages end where the next begin, by what stands in their beginnings."""
    numbers = words(buffer)
    header = numbers[start].astype(np.int64)
    if (header > BEGINNING - 8).any():
        return False
    return bool((start + 8 + header + numbers[start + 4 + header] == follows).all())


# --- columns ----------------------------------------------------------------------------------------------------------


_WORD = 4
_OFFSET_BITS = 32  # of an offset in a chunk, as the index has it
_LARGEST_TEXT = 256  # longer ones are left to the library

_Loaded = Tuple[Any, Table]  # a buffer, and the messages in it in the order of the file
_Load = Callable[[List[int]], _Loaded]

WHOLE = ("",)
"""The path of a message as a whole."""


class Wanted(NamedTuple):
    """What is wanted of the messages of a connection: its layout, and paths in it; or what reads them as a whole."""

    layout: Layout
    paths: Tuple[str, ...]
    read: Optional[Read] = None


def read_columns(index: Index, messages: Any, wanted: Dict[int, Wanted]) -> Dict[int, Tuple[Any, List[Any]]]:
    """Read columns of some connections.

    Args:
        index: of the bag, open.
        messages: all messages of the index.
        wanted: by connection.

    Returns:
        By connection: the places in `messages` that have a row, and a column for each path.
    """
    order = np.argsort((messages.chunk << _OFFSET_BITS) + messages.offset, kind="stable")  # chunks in turn: nearly so
    unseen: Any = np.ones(max(index.connections, default=0) + 1, bool)
    unseen[list(wanted)] = False
    parts: Dict[int, List[Tuple[Any, List[Any]]]] = {number: [] for number in wanted}
    chunks = [number for number, each in enumerate(index.chunks) if any(of in wanted for of, _ in each.counts)]
    plain = PlainChunks(index, messages, order, unseen)
    with Pool() as pool:
        for load, groups in _loads(index, messages, plain, chunks, pool):
            for numbers, (buffer, table) in (found for group in groups for found in _loaded(load, group)):
                for number, part in _columns(buffer, table, order[plain.rows(numbers)], wanted):
                    parts[number].append(part)
                pool.put(buffer)
    return {number: _joined(parts[number], wanted[number]) for number in wanted}


def _loads(
    index: Index, messages: Any, plain: PlainChunks, chunks: List[int], pool: Pool
) -> List[Tuple[_Load, Iterable[List[int]]]]:
    """Return what loads chunks, and which of them together: those that are not compressed, and the others."""
    loader = Loader(index, 0, np.zeros(max(index.connections, default=0) + 1, bool), messages=messages)

    def compressed(numbers: List[int]) -> _Loaded:
        block = loader.compressed(numbers, pool)
        return block.buffer, block.table

    def not_compressed(numbers: List[int]) -> _Loaded:
        try:
            return plain.load(numbers, pool)
        except BagError:
            if len(numbers) > 1:
                raise
        block = loader.plain(numbers, pool)  # the whole of it
        return block.buffer, block.table

    heads = [(number, index.head(number)) for number in chunks]
    small = [number for number, head in heads if head.compression == "none"]
    others = [(number, head.size) for number, head in heads if head.compression != "none"]
    return [(not_compressed, plain.groups(small)), (compressed, grouped(others))]


def _loaded(load: _Load, numbers: List[int]) -> List[Tuple[List[int], _Loaded]]:
    """Return chunks that were loaded; damaged ones are left out."""
    try:
        return [(numbers, load(numbers))]
    except BagError:
        if len(numbers) == 1:
            return []
    return [found for number in numbers for found in _loaded(load, [number])]


def _columns(
    buffer: Any, table: Table, places: Any, wanted: Dict[int, Wanted]
) -> List[Tuple[int, Tuple[Any, List[Any]]]]:
    found = []
    for number, what in wanted.items():
        rows = np.flatnonzero(table.connection == number)
        if len(rows):
            good, columns = _decoded(buffer, table.payload[rows], table.end[rows], what)
            found.append((number, (places[rows[good]], columns)))
    return found


def _read(buffer: Any, start: Any, end: Any, read: Read) -> Tuple[Any, List[Any]]:
    """Return which messages can be read, and a column of them."""
    good, found, view = [], [], memoryview(buffer)
    for place, bounds in enumerate(zip(start.tolist(), end.tolist())):
        with suppress(ValueError, struct.error):
            found.append(read(bytes(view[slice(*bounds)])))
            good.append(place)
    return np.array(good, np.int64), [np.array([*found, None], object)[:-1]]


def _decoded(buffer: Any, start: Any, end: Any, wanted: Wanted) -> Tuple[Any, List[Any]]:
    """Return which messages are as their layout says, and their columns."""
    if wanted.read is not None:
        return _read(buffer, start, end, wanted.read)
    numbers = words(buffer)
    good: Any = np.arange(len(start))
    begins: List[Any] = []
    place = start
    for piece in wanted.layout.pieces:
        begins.append(place)
        place = place + piece.size
        if piece.element:
            kept = np.flatnonzero(place + _WORD <= end)
            place, end, good, begins = place[kept], end[kept], good[kept], [each[kept] for each in begins]
            count = numbers[place].astype(np.int64)
            place = place + _WORD
            whole = place + count * piece.element <= end
            if piece.text:
                whole &= _is_plain(buffer, place, np.where(whole, count, 0))
            kept = np.flatnonzero(whole)
            place, end, good, begins = place[kept], end[kept], good[kept], [each[kept] for each in begins]
            place = place + count[kept] * piece.element
    leaves = [wanted.layout.leaves[path] for path in wanted.paths]
    whole = place == end
    for leaf in leaves:
        if leaf.dtype == TEXT:  # numpy's would lose zeros at the end
            place = begins[leaf.piece] + leaf.offset
            count = numbers[place].astype(np.int64)
            whole &= (count == 0) | (np.frombuffer(buffer, np.uint8)[place + _WORD + count - 1] != 0)
    kept = np.flatnonzero(whole)
    read = ((_texts if leaf.dtype == TEXT else _gathered, leaf) for leaf in leaves)
    return good[kept], [take(buffer, begins[leaf.piece][kept] + leaf.offset, leaf.dtype) for take, leaf in read]


def _texts(buffer: Any, places: Any, _: str) -> Any:
    """Return texts by the places of their lengths."""
    count = words(buffer)[places].astype(np.int64)
    size = max(1, int(count.max()) if len(count) else 1)
    if len(count) and int(count.min()) == size:
        return _bytes(buffer, places + _WORD, size).view(f"S{size}")
    column: Any = np.arange(size)
    view: Any = np.frombuffer(buffer, np.uint8)
    inside = np.minimum(places[:, None] + _WORD + column, len(view) - 1)
    found: Any = np.where(column < count[:, None], view[inside], 0).astype(np.uint8)
    return found.view(f"S{size}").reshape(len(places))


def _gathered(buffer: Any, places: Any, dtype: str) -> Any:
    return _bytes(buffer, places, np.dtype(dtype).itemsize).view(dtype)


def _bytes(buffer: Any, places: Any, size: int) -> Any:
    """Return so many bytes from each place."""
    raw: Any = np.ndarray((max(len(buffer) - size + 1, 0),), f"V{size}", buffer, 0, (1,))
    return raw[places]


def _is_plain(buffer: Any, place: Any, count: Any) -> Any:
    """Return which texts are ASCII and not long."""
    found = count <= _LARGEST_TEXT
    size = int(count[found].max()) if found.any() else 0
    if size and int(count.min()) == size == int(count.max()) and _is_ascii(_bytes(buffer, place, size)):
        return found
    view: Any = np.frombuffer(buffer, np.uint8)
    for each in range(size):
        inside = np.flatnonzero(found & (count > each))
        found[inside[view[place[inside] + each] > 0x7F]] = False  # noqa: PLR2004
    return found


def _is_ascii(texts: Any) -> bool:
    return bool(texts.view(np.uint8).max() < 0x80)  # noqa: PLR2004


def _joined(parts: Sequence[Tuple[Any, List[Any]]], wanted: Wanted) -> Tuple[Any, List[Any]]:
    if not parts:
        empty: Any = np.zeros(0, np.int64)
        kinds = [wanted.layout.leaves[path].dtype if path else "O" for path in wanted.paths]
        return empty, [np.zeros(0, kind) for kind in kinds]
    places = np.concatenate([each for each, _ in parts])
    return places, [np.concatenate(columns) for columns in zip(*(columns for _, columns in parts))]


def wanted_of(definition: str, kind: str, paths: Sequence[str], *, texts: bool = False) -> Optional[Wanted]:
    """Return what is wanted of a type; None when it does not have it, or has a text where none is expected."""
    if paths == WHOLE:
        read = reader_of(definition, kind)
        return None if read is None else Wanted(Layout((), {}), WHOLE, read)
    layout = layout_of(definition, kind)
    if layout is None or any(path not in layout.leaves for path in paths):
        return None
    if not texts and any(layout.leaves[path].dtype == TEXT for path in paths):
        return None
    return Wanted(layout, tuple(paths))
