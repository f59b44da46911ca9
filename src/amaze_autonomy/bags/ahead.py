"""Reads from files what is going to be written, while what comes before it is written: two processors copy, not one."""

from __future__ import annotations

import os
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Deque, Iterable, Iterator, List, NamedTuple, Optional, Tuple

from .errors import BagError

if TYPE_CHECKING:
    from concurrent.futures import Future, ThreadPoolExecutor

__all__ = ["Ahead", "Stretch"]

_PIECE = 1 << 20  # an image at once; a copy by the system costs ext4 a third more, where nothing can be shared
_BUFFERS = 3  # one is written, one is read, one is ready


class Stretch(NamedTuple):
    """Bytes of an open file, from `start` on."""

    file: int
    start: int
    size: int


class Ahead:
    """Stretches of files, read in the order in which they are wanted.

    Args:
        path: of what is written; errors name it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reader: Optional[ThreadPoolExecutor] = None
        self._free: List[bytearray] = []
        self._made = 0
        self._planned: Deque[Stretch] = deque()
        self._jobs: Deque[Tuple[Stretch, bytearray, Future[None]]] = deque()

    def stop(self) -> None:
        """End the thread; nothing is read any more."""
        if self._reader is not None:
            self._reader.shutdown()

    def expect(self, stretches: Iterable[Stretch]) -> None:
        """Say what will be wanted next, behind all that was said before."""
        self._planned.extend(piece for stretch in stretches for piece in _pieces(stretch))
        self._begin()

    def bytes_of(self, stretch: Stretch) -> Iterator[memoryview]:
        """Return the next stretch in pieces; each is good until the following one is asked for.

        Raises:
            BagError: The file has become shorter.
            ValueError: Another stretch was said to be next.
        """
        if not self._jobs:
            self.expect([stretch])
        for wanted in _pieces(stretch):
            piece, buffer, job = self._jobs.popleft()
            if piece != wanted:
                raise ValueError(f"{piece} was said to be next, not {wanted}")
            job.result()
            yield memoryview(buffer)[: piece.size]
            self._free.append(buffer)
            self._begin()

    def _begin(self) -> None:
        """Begin to read, as far as there are buffers."""
        while self._planned and (self._free or self._made < _BUFFERS):
            if not self._free:
                self._free.append(bytearray(_PIECE))
                self._made += 1
            piece, buffer = self._planned.popleft(), self._free.pop()
            self._jobs.append((piece, buffer, self._thread().submit(self._read, piece, buffer)))

    def _thread(self) -> ThreadPoolExecutor:
        if self._reader is None:
            from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415  (slow to load)

            self._reader = ThreadPoolExecutor(1)
        return self._reader

    def _read(self, piece: Stretch, buffer: bytearray) -> None:
        view, done = memoryview(buffer)[: piece.size], 0
        while done < piece.size:
            read = os.preadv(piece.file, [view[done:]], piece.start + done)
            if not read:
                raise BagError(str(self._path), "an input became shorter while it was read", "try again")
            done += read


def _pieces(stretch: Stretch) -> Iterator[Stretch]:
    for place in range(0, stretch.size, _PIECE):
        yield Stretch(stretch.file, stretch.start + place, min(_PIECE, stretch.size - place))
