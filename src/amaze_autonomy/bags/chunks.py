"""The bytes of single messages, out of chunks that are decompressed once and kept for a while."""

from __future__ import annotations

import struct
from collections import OrderedDict
from typing import Callable, Dict, Optional, Tuple

from .errors import MessageError

__all__ = ["ChunkCache"]

_UINT32 = struct.Struct("<L")
_CONNECTION, _MESSAGE = 7, 2
_SMALL = 2048
_KEPT_BYTES = (
    64_000_000  # decompressed; recordings whose chunks overlap in time would else be decompressed over and over
)


class ChunkCache:
    """Reads messages by the position of their chunk and their offset in it.

    Args:
        load: returns the data of the chunk at a position, decompressed; raises what it likes.
        peek: returns some bytes from an offset in the data of a chunk on, without loading all of it; None where that
            cannot be, and it must be loaded.
    """

    def __init__(
        self, load: Callable[[int], bytes], peek: Callable[[int, int, int], Optional[bytes]] = lambda *_: None
    ) -> None:
        self._load, self._peek = load, peek
        self._kept: OrderedDict[int, bytes] = OrderedDict()
        self._size = 0
        self._damaged: Dict[int, str] = {}

    def message(self, chunk: int, offset: int) -> bytes:
        """Return the bytes of one message.

        Raises:
            MessageError: The chunk or the record is damaged.
        """
        if chunk not in self._kept:
            found = self._peeked(chunk, offset)
            if found is not None:
                return found
        data = self._chunk(chunk)
        try:
            op, offset = _skip_header(data, offset)
            while op == _CONNECTION:
                op, offset = _skip_header(data, offset + 4 + _size(data, offset))
            start, size = offset + 4, _size(data, offset)
        except (struct.error, ValueError) as error:
            raise MessageError(f"record at {chunk}+{offset} is damaged: {error}") from error
        if op != _MESSAGE or start + size > len(data):
            raise MessageError(f"record at {chunk}+{offset} is no whole message")
        return data[start : start + size]

    def _peeked(self, chunk: int, offset: int) -> Optional[bytes]:
        """Return the bytes of a small message without its chunk; None when that is not to be had, or not good."""
        data = self._peek(chunk, offset, _SMALL)
        if data is None:
            return None
        try:
            op, place = _skip_header(data, 0)
            start, size = place + 4, _size(data, place)
        except (struct.error, ValueError, IndexError):
            return None
        return data[start : start + size] if op == _MESSAGE and start + size <= len(data) else None

    def _chunk(self, position: int) -> bytes:
        data = self._kept.get(position)
        if data is not None:
            self._kept.move_to_end(position)
            return data
        if position in self._damaged:
            raise MessageError(self._damaged[position])
        try:
            data = self._load(position)
        except Exception as error:  # the decompressors raise what they like
            self._damaged[position] = f"chunk at byte {position} is damaged: {error or type(error).__name__}"
            raise MessageError(self._damaged[position]) from error
        self._keep(position, data)
        return data

    def _keep(self, position: int, data: bytes) -> None:
        self._kept[position] = data
        self._size += len(data)
        while self._size > _KEPT_BYTES and len(self._kept) > 1:
            _, dropped = self._kept.popitem(last=False)
            self._size -= len(dropped)


def _size(data: bytes, offset: int) -> int:
    size: int = _UINT32.unpack_from(data, offset)[0]
    return size


def _skip_header(data: bytes, offset: int) -> Tuple[int, int]:
    """Return the kind of a record and where its data starts."""
    end = offset + 4 + _size(data, offset)
    offset += 4
    op = -1
    while offset < end:
        size = _size(data, offset)
        if data[offset + 4 : offset + 7] == b"op=":
            op = data[offset + 7]
        offset += 4 + size
    if offset != end:
        raise ValueError("header fields do not fit the header")
    return op, end
