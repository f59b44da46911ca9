"""The two ends of lz4 blocks, without decompressing what is between them.

The `lz4` package cannot do that; the library that it is made of can, see frames.py.
"""

from __future__ import annotations

import ctypes
import threading
from typing import Any, Optional

from .frames import lz4_library

__all__ = ["block_beginning", "block_end"]

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
