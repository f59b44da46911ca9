"""A bag that was opened for decoding: by our own index, which is fast; by the rosbags library where that refuses.

What our index is strict about the library may still read; what neither reads the library has the words for.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from .compression import decompressed
from .errors import BagError
from .index import Index, Messages
from .layout import fields_of

__all__ = ["Indexed", "Library", "Link", "opened"]

_Place = Tuple[Any, Any, Any]
_NO_ROWS: Any = np.zeros(0, np.int64)


class Link(NamedTuple):
    """A connection: its number, topic, publisher ("" when unknown), type as ROS 1 names it, and definition."""

    number: int
    topic: str
    caller: str
    kind: str
    definition: str


class Indexed:
    """A bag by its index.

    Args:
        path: of the bag.

    Raises:
        BagError: the index is not as it should be.
    """

    def __init__(self, path: Path) -> None:
        self.index = Index(path)
        try:
            self.messages: Messages = self.index.messages()
        except BagError:
            self.index.close()
            raise
        self._rows = _by_connection(self.messages.connection)
        self._places: Dict[int, _Place] = {}
        self._chunk_positions: Any = np.array([chunk.position for chunk in self.index.chunks], np.int64)
        self._numbers = {chunk.position: number for number, chunk in enumerate(self.index.chunks)}
        self.links: Tuple[Link, ...] = tuple(
            Link(each.number, each.topic, each.caller, each.kind, _definition(each.header))
            for each in self.index.connections.values()
        )

    def rows(self, number: int) -> Any:
        """Return the places of a connection's messages in `messages`."""
        return self._rows.get(number, _NO_ROWS)

    def places(self, number: int) -> _Place:
        """Return times, positions of chunks, and offsets in them of a connection's messages."""
        if number not in self._places:
            rows, found = self.rows(number), self.messages
            self._places[number] = found.t_ns[rows], self._chunk_positions[found.chunk[rows]], found.offset[rows]
        return self._places[number]

    def load(self, position: int) -> bytes:
        """Return the data of a chunk, decompressed."""
        head = self.index.head(self._numbers[position])
        stored = os.pread(self.index.file, head.stored, head.data)
        if len(stored) != head.stored:
            raise EOFError(f"{len(stored)} bytes of {head.stored}")
        return bytes(decompressed(head.compression, stored, head.size))

    def peek(self, position: int, offset: int, size: int) -> Optional[bytes]:
        """Return up to some bytes from an offset in the data of a chunk on; None when it is compressed."""
        head = self.index.head(self._numbers[position])
        if head.compression != "none" or head.stored != head.size:
            return None
        return os.pread(self.index.file, max(0, min(size, head.stored - offset)), head.data + offset)

    def close(self) -> None:
        """Close the file."""
        self.index.close()


class Library:
    """A bag by the rosbags library.

    Args:
        path: of the bag.

    Raises:
        BagError: the library cannot read it either.
    """

    def __init__(self, path: Path) -> None:
        self._reader = _reader(path)
        self.links: Tuple[Link, ...] = tuple(
            Link(
                each.id,
                each.topic,
                each.ext.callerid or "",
                each.msgtype.replace("/msg/", "/"),
                getattr(each.msgdef, "data", each.msgdef),  # a str in 0.9, an object in 0.11
            )
            for each in self._reader.connections
        )

    def places(self, number: int) -> _Place:
        """Return times, positions of chunks, and offsets in them of a connection's messages."""
        entries: List[Tuple[int, int, int]] = [tuple(each) for each in self._reader.indexes.get(number, ())]
        columns: Any = np.array(entries, np.int64).reshape(-1, 3)
        return columns[:, 0], columns[:, 1], columns[:, 2]

    def load(self, position: int) -> bytes:
        """Return the data of a chunk, decompressed."""
        chunk, file = self._reader.chunks[position], self._reader.bio
        file.seek(chunk.datapos)
        stored = file.read(chunk.datasize)
        if len(stored) != chunk.datasize:
            raise EOFError(f"{len(stored)} bytes of {chunk.datasize}")
        return bytes(chunk.decompressor(stored))

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def _by_connection(connection: Any) -> Dict[int, Any]:
    """Return the places of each number in an array."""
    small = connection.astype(np.uint16) if len(connection) and connection.max() < 1 << 16 else connection
    order = np.argsort(small, kind="stable")  # of small numbers in no time
    ordered = connection[order]
    firsts = np.flatnonzero(np.diff(ordered, prepend=-1))
    return dict(zip(ordered[firsts].tolist(), np.split(order, firsts[1:])))


def opened(path: Path) -> Any:
    """Open a bag: `Indexed` where that can be, else `Library`.

    Raises:
        BagError: it is no bag, not indexed, encrypted, of another version, or its index is damaged.
    """
    if not path.is_file():
        raise BagError(str(path), "is no file", "name a bag")
    try:
        return Indexed(path)
    except BagError:
        return Library(path)


def _definition(header: bytes) -> str:
    fields: Dict[bytes, bytes] = fields_of(header, 0, len(header))
    return fields.get(b"message_definition", b"").decode("utf-8", "replace")


def _reader(path: Path) -> Any:
    from rosbags.rosbag1 import Reader, ReaderError  # noqa: PLC0415  (slow to load, and seldom wanted)

    try:
        reader = Reader(path)
        reader.open()
    except OSError as error:
        raise BagError(str(path), f"cannot be read ({error.strerror})", "name a bag that you may read") from error
    except ReaderError as error:
        raise BagError(str(path), _without_dot(str(error)), _remedy(str(error))) from error
    except Exception as error:  # a damaged index may raise anything, bare AssertionError included
        words = f"the index is damaged ({type(error).__name__}{': ' if str(error) else ''}{error})"
        raise BagError(str(path), words, "make a new one with `rosbag reindex`") from error
    return reader


def _without_dot(text: str) -> str:
    return text[:1].lower() + text[1:].rstrip(".")


def _remedy(text: str) -> str:
    if "not indexed" in text or "index" in text:
        return "make a new index with `rosbag reindex`"
    if "version" in text:
        return "convert it with `rosbag fix` or `rosbag migrate`"
    if "encrypt" in text:
        return "decrypt it with `rosbag decompress` and its key"
    return "name a ROS 1 bag of version 2.0"
