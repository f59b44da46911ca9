"""Chunks compressed and decompressed: none, lz4, bz2."""

from __future__ import annotations

import bz2
from contextlib import suppress
from typing import Any, Union

import lz4.frame

from .errors import RecordError

__all__ = ["COMPRESSIONS", "compressed", "decompress_into", "decompressed", "salvaged"]

COMPRESSIONS = ("none", "lz4", "bz2")
_STEP = 1 << 14
_BROKEN = (RuntimeError, OSError, EOFError, ValueError)  # what the two decompressors raise

Buffer = Union[bytes, bytearray, memoryview]


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


def decompressed(kind: str, data: Buffer, size: int) -> Buffer:
    """Return the data of a chunk, writable unless it was not compressed.

    Raises:
        RecordError: It is damaged, or not of this size.
    """
    if kind not in COMPRESSIONS:
        raise RecordError(f"compressed by {kind}, which is not known")
    try:
        plain: Any = data if kind == "none" else _decompress(kind, data)
    except _BROKEN as error:
        raise RecordError(f"its {kind} data is damaged ({error})") from error
    if len(plain) != size:
        raise RecordError(f"it has {len(plain)} bytes instead of {size}")
    return plain  # type: ignore[no-any-return]


def decompress_into(target: bytearray, place: int, kind: str, data: bytes, size: int) -> None:
    """Decompress the data of a chunk to a place in a buffer that has room for it.

    Raises:
        RecordError: It is damaged, or not of this size.
    """
    if kind == "lz4":
        from .frames import decompress_frame  # noqa: PLC0415  (ctypes is slow to load and seldom wanted)

        if decompress_frame(data, size, target, place):
            return  # else the usual way, which says what is wrong
    target[place : place + size] = decompressed(kind, data, size)


def _decompress(kind: str, data: Buffer) -> Any:
    if kind == "lz4":
        return lz4.frame.decompress(data, return_bytearray=True)
    return bytearray(bz2.decompress(data))


def salvaged(kind: str, data: Buffer) -> Buffer:
    """Return as much of a damaged or cut chunk as can be decompressed."""
    if kind == "none":
        return data
    decompressor: Any = lz4.frame.LZ4FrameDecompressor() if kind == "lz4" else bz2.BZ2Decompressor()
    plain = bytearray()
    with suppress(*_BROKEN):  # behind it nothing is good
        for start in range(0, len(data), _STEP):
            plain += decompressor.decompress(data[start : start + _STEP])
            if decompressor.eof:
                break
    return plain
