"""Chunks that are not compressed, many in one buffer, without what is large in them and nobody wants.

Where each message begins is in the index, so it is known beforehand what has to be read of the file: all that lies
between large messages, and of these the beginning, which says whose they are and how long. What was read stands in the
buffer one piece behind the other.
"""

from __future__ import annotations

import os
import struct
from typing import Any, Iterator, List, Tuple

import numpy as np

from .arrays import words
from .errors import BagError, RecordError
from .index import Index, Messages, require, unusable
from .loading import BEGINNING
from .pool import GROUP_BYTES, Pool
from .table import Table, tabulated

__all__ = ["PlainChunks", "grouped"]

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
        piece = np.searchsorted(begins, start, "right") - 1
        start = places[piece] + start - begins[piece]
        stops = places + sizes
        stops[piece[large]] = start[large] + follows - self._start[rows][large]  # as if all of it were there
        require(_are_whole(buffer, start[large], stops[piece[large]]), "there is more in it than messages")
        return tabulated(buffer, places, stops, self._t_ns[rows], self._connection[rows], start)

    def _read(self, buffer: bytearray, places: Any, sizes: Any, begins: Any) -> None:
        """Read pieces of the file into a buffer."""
        file, view = self._index.file, memoryview(buffer)
        for place, size, begin in zip(places.tolist(), sizes.tolist(), begins.tolist()):
            if size and os.preadv(file, [view[place : place + size]], begin) != size:
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
