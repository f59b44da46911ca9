"""Checksums of many messages that can be added and subtracted, whatever their order."""

from __future__ import annotations

import zlib
from typing import Any, Dict, List, NamedTuple, Tuple

import numpy as np

__all__ = ["Tallies", "Tally", "checksums", "payload_checksums"]

_MASK = (1 << 64) - 1


class Tally(NamedTuple):
    """How many messages, and the sum of their checksums (modulo 2**64)."""

    messages: int = 0
    checksum: int = 0

    def plus(self, other: Tally) -> Tally:
        """Return both together."""
        return Tally(self.messages + other.messages, (self.checksum + other.checksum) & _MASK)

    def minus(self, other: Tally) -> Tally:
        """Return this without the other."""
        return Tally(self.messages - other.messages, (self.checksum - other.checksum) & _MASK)


TopicKey = Tuple[str, str, str]  # topic, type, md5


class Tallies:
    """A tally for each topic, type and definition."""

    def __init__(self) -> None:
        self.by_topic: Dict[TopicKey, Tally] = {}

    def add(self, key: TopicKey, tally: Tally) -> None:
        """Add messages of a topic."""
        self.by_topic[key] = self.by_topic.get(key, Tally()).plus(tally)


def payload_checksums(buffer: Any, payload: List[int], end: List[int]) -> Any:
    """Return the CRC-32 of each message's bytes."""
    view, crc32 = memoryview(buffer), zlib.crc32
    return np.array([crc32(view[start:stop]) for start, stop in zip(payload, end)], np.uint64)


def checksums(crc: Any, length: Any, t_ns: Any) -> Any:
    """Return a 64-bit checksum of each message: its bytes, their number, and its record time.

    The mixing is that of SplitMix64, so that sums of them do not cancel out as sums of CRCs would.
    """
    mixed = crc | (length.astype(np.uint64) << np.uint64(32))
    return _mix(_mix(mixed) ^ t_ns.astype(np.uint64))


def _mix(value: Any) -> Any:
    value = value + np.uint64(0x9E3779B97F4A7C15)
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))
