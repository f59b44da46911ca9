"""A line that loses, delays and cuts, as a bad radio does to datagrams: in virtual time, and as a relay on UDP."""

from __future__ import annotations

import contextlib
import heapq
import random
import select
import socket
import threading
import time
from dataclasses import dataclass
from typing import List, Optional, Tuple

_BYTES = 65536
_RELAY_SLICE_S = 0.005


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
        self._chance = random.Random(seed)
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


class BadRelay:
    """Relays datagrams between one client and one server, both ways, on a thread of its own.

    The client speaks to `port` of this relay on loopback. Times of the cuts count from `start`.

    Args:
        server: where the datagrams of the client go.
        quality: of both directions.
        seed: of loss and jitter.
    """

    def __init__(self, server: Tuple[str, int], quality: Quality, seed: int = 0) -> None:
        self._server = server
        self._client: Optional[Tuple[str, int]] = None
        self._up, self._down = BadLine(quality, 2 * seed), BadLine(quality, 2 * seed + 1)
        self._near, self._far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._near.bind(("127.0.0.1", 0))
        self._far.bind(("127.0.0.1", 0))
        for each in (self._near, self._far):
            each.setblocking(False)
        self._begin_ns = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bad relay", daemon=True)

    @property
    def port(self) -> int:
        """Port at which the client finds the server."""
        return int(self._near.getsockname()[1])

    @property
    def lost(self) -> int:
        """How many datagrams were lost."""
        return self._up.lost + self._down.lost

    def start(self) -> None:
        """Relay from now on."""
        self._begin_ns = time.monotonic_ns()
        self._thread.start()

    def cut(self, after_ns: int, lasts_ns: int) -> None:
        """Let nothing through in either direction, some time from now on."""
        begin_ns = time.monotonic_ns() - self._begin_ns + after_ns
        for line in (self._up, self._down):
            line.cut(begin_ns, begin_ns + lasts_ns)

    def stop(self) -> None:
        """Stop, and close the sockets."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        self._near.close()
        self._far.close()

    def _run(self) -> None:
        while not self._stopped.is_set():
            readable, _, _ = select.select([self._near, self._far], [], [], _RELAY_SLICE_S)
            t_ns = time.monotonic_ns() - self._begin_ns
            for port in readable:
                self._take(t_ns, port)
            for data in self._up.due(t_ns):
                self._pass_on(self._far, data, self._server)
            for data in self._down.due(t_ns):
                self._pass_on(self._near, data, self._client)

    def _take(self, t_ns: int, port: socket.socket) -> None:
        with contextlib.suppress(OSError):  # nothing more is there, or the other end is gone
            while True:
                data, place = port.recvfrom(_BYTES)
                if port is self._near:
                    self._client = place
                (self._up if port is self._near else self._down).send(t_ns, data)

    @staticmethod
    def _pass_on(port: socket.socket, data: bytes, place: Optional[Tuple[str, int]]) -> None:
        if place is not None:
            with contextlib.suppress(OSError):
                port.sendto(data, place)
