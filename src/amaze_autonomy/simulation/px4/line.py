"""A line that loses, delays and cuts: what a bad radio does to datagrams. Pure: times and bytes in, bytes out."""

from __future__ import annotations

import heapq
import random
from dataclasses import dataclass
from typing import List, Tuple

__all__ = ["BadLine", "Quality"]


@dataclass(frozen=True)
class Quality:
    """How bad a line is.

    Args:
        loss: part of the datagrams that are lost, 0..1.
        jitter_ns: each is late by something between 0 and this, so that they overtake each other.
        cuts: (from, to) in ns, when nothing gets through.
    """

    loss: float = 0.0
    jitter_ns: int = 0
    cuts: Tuple[Tuple[int, int], ...] = ()


class BadLine:
    """One direction of a line; the same seed loses and delays the same.

    Args:
        quality: of the line.
        seed: of loss and jitter.
    """

    def __init__(self, quality: Quality, seed: int) -> None:
        self._quality = quality
        self._chance = random.Random(seed)  # noqa: S311 - weather, not a secret
        self._flying: List[Tuple[int, int, bytes]] = []
        self._cuts = list(quality.cuts)
        self._number = 0
        self.lost = 0

    def cut(self, begin_ns: int, end_ns: int) -> None:
        """Let nothing through between two times."""
        self._cuts.append((begin_ns, end_ns))

    def send(self, t_ns: int, data: bytes) -> None:
        """Put a datagram on the line."""
        lost, late = self._chance.random() < self._quality.loss, self._chance.random()
        if lost or any(begin <= t_ns < end for begin, end in self._cuts):
            self.lost += 1
            return
        self._number += 1
        heapq.heappush(self._flying, (t_ns + round(late * self._quality.jitter_ns), self._number, data))

    def due(self, t_ns: int) -> List[bytes]:
        """Return what has arrived, in the order of its arrival."""
        arrived: List[bytes] = []
        while self._flying and self._flying[0][0] <= t_ns:
            arrived.append(heapq.heappop(self._flying)[2])
        return arrived
