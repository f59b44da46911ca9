"""Indexes and buffers of bags as arrays: what needs numpy, which takes longer to load than many a command takes.

The rosbags library reads all index records of a bag by the layout of the first: they must not be mixed with others.
"""

from __future__ import annotations

from typing import Any, List, Tuple

import numpy as np

from .layout import INDEX_ENTRY, SECOND, index_header

__all__ = ["distinct", "index_data", "index_records", "joined_parts", "repeated", "words"]


def words(buffer: Any) -> Any:
    """Return the four-byte numbers that start at *every* byte of a buffer, writable if the buffer is."""
    return np.ndarray((max(len(buffer) - 3, 0),), "<u4", buffer, 0, (1,))


def distinct(numbers: Any) -> List[int]:
    """Return the different ones of an array, in order; np.unique would load numpy.ma, a fifth of a short run."""
    ordered = np.sort(numbers)
    found: List[int] = ordered[:1].tolist() + ordered[1:][ordered[1:] != ordered[:-1]].tolist()
    return found


def index_data(connection: int, t_ns: Any, offsets: Any) -> bytes:
    """Return the index of one connection's messages in one chunk."""
    entries: Any = np.empty((len(t_ns), 3), "<u4")
    entries[:, 0], entries[:, 1] = np.divmod(t_ns, SECOND)
    entries[:, 2] = offsets
    return index_header(connection, len(t_ns)) + bytes(entries.tobytes())


def index_records(t_ns: Any, connection: Any, offsets: Any) -> bytes:
    """Return the index of all messages of one chunk, given as arrays in any order."""
    order = np.lexsort((offsets, t_ns, connection))
    numbers: Any = connection[order]
    firsts = np.flatnonzero(numbers[1:] != numbers[:-1]) + 1
    parts = np.split(order, firsts) if len(order) else []
    parts_of = zip(distinct(numbers), parts)
    return b"".join([index_data(number, t_ns[each], offsets[each]) for number, each in parts_of])


def joined_parts(parts: List[Tuple[int, Any]]) -> Tuple[Any, Any, Any]:
    """Return times, connections and offsets of entries."""
    entries: Any = np.frombuffer(b"".join([part for _, part in parts]), "<u4").reshape(-1, 3).astype(np.int64)
    numbers: Any = np.array([connection for connection, _ in parts], np.int64)
    return (
        entries[:, 0] * SECOND + entries[:, 1],
        np.repeat(numbers, [len(part) // INDEX_ENTRY for _, part in parts]),
        entries[:, 2],
    )


def repeated(numbers: List[int], counts: List[int]) -> Any:
    """Return an array that has each number as often as its count says."""
    return np.repeat(np.array(numbers, np.int64), counts)
