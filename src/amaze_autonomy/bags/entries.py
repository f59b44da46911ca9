"""The index records behind one chunk, as they are in the file, and what can be told of them without numpy."""

from __future__ import annotations

import struct
import sys
from array import array
from typing import Any, Dict, Iterator, NamedTuple, Tuple

from .layout import INDEX_ENTRY, SECOND
from .salvage import Row

__all__ = ["Entries"]


class Entries(NamedTuple):
    """Times and offsets of messages, as index records have them.

    Args:
        parts: connection and bytes of each record.
        end: where the last one ends in the file.
        trusted: whether it is certain that they are all.
        foreign: whether one has fields in another order than ours.
    """

    parts: Tuple[Tuple[int, bytes], ...]
    end: int
    trusted: bool
    foreign: bool

    @property
    def messages(self) -> int:
        """Count the messages."""
        return sum(len(data) for _, data in self.parts) // INDEX_ENTRY

    def counts(self) -> Tuple[Tuple[int, int], ...]:
        """Count messages by connection."""
        counts: Dict[int, int] = {}
        for number, data in self.parts:
            if data:
                counts[number] = counts.get(number, 0) + len(data) // INDEX_ENTRY
        return tuple(sorted(counts.items()))

    def times(self) -> Tuple[int, int]:
        """Return the earliest and the latest time; only when there is a message."""
        words = [_words(data) for _, data in self.parts if data]
        earliest = min(_edge(each[0::3], each[1::3], min) for each in words)
        latest = max(_edge(each[0::3], each[1::3], max) for each in words)
        return earliest, latest

    def rows(self) -> Iterator[Row]:
        """Return (time, connection, offset) of each message."""
        for number, data in self.parts:
            for seconds, fraction, offset in struct.iter_unpack("<3L", data):
                yield seconds * SECOND + fraction, number, offset

    def columns(self) -> Tuple[Any, Any, Any]:
        """Return times, connections and offsets as arrays."""
        from .arrays import joined_parts  # noqa: PLC0415  (needs numpy)

        return joined_parts(list(self.parts))


def _words(data: bytes) -> Any:
    found = array("I", data)
    if sys.byteorder == "big":
        found.byteswap()
    return found


def _edge(seconds: Any, fractions: Any, choose: Any) -> int:
    """Return the earliest or the latest time: in a good index one of a few that lie side by side."""
    second = choose(seconds)
    first, count = seconds.index(second), seconds.count(second)
    if seconds[first : first + count].count(second) == count:
        return int(second * SECOND + choose(fractions[first : first + count]))
    return int(second * SECOND + choose(part for each, part in zip(seconds, fractions) if each == second))
