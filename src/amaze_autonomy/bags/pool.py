"""Memory into which chunks are loaded, and threads that fill it."""

from __future__ import annotations

import mmap
from concurrent.futures import ThreadPoolExecutor
from typing import Any, List

__all__ = ["GROUP_BYTES", "Pool"]

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
