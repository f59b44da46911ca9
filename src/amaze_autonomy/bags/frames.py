"""lz4 frames decompressed into memory that is already there.

The `lz4` package has no function for that: it makes new memory for each frame, grows it, and copies the result once
more. The library that the package is made of has one, and is found in the package itself, or where that found it.
"""

from __future__ import annotations

import ctypes
import threading
from typing import Any, Optional

import lz4.frame

__all__ = ["decompress_frame", "lz4_library"]

_VERSION = 100  # of the library's interface, unchanged since 2014
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
        library.LZ4F_createDecompressionContext(ctypes.byref(self._context), _VERSION)

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
