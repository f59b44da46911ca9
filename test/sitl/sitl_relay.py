"""A UDP relay between a real autopilot and those who speak with it: it loses, it cuts, and it writes down the wire.

Each link is `autopilot -> relay -> node`, on loopback. What came through is written as a telemetry log, both ways, with
the time at which it passed; what was lost is not in it.
"""

from __future__ import annotations

import random
import select
import socket
import threading
import time
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Optional, Tuple

from amaze_autonomy.autopilot.link.framing import frame_at

_BYTES = 65536
_SLICE_S = 0.02
Listener = Callable[[int, bytes], None]


class Link:
    """One link of the relay.

    Args:
        far: port at which the autopilot finds it.
        near: port of the node; None: nobody but the listeners.
        log: telemetry log that it writes.
        seed: of what is lost.

    `listeners` are given what the autopilot says, `overhear` what it is told.
    """

    def __init__(self, far: int, near: Optional[int], log: Path, seed: int) -> None:
        self.far, self.near = _bound(far), _bound(0)
        self.cut, self.loss = False, 0.0
        self.passed = self.lost = 0
        self.listeners: List[Listener] = []
        self.overhear: Optional[Listener] = None
        self._node = None if near is None else ("127.0.0.1", near)
        self._autopilot: Optional[Tuple[str, int]] = None
        self._chance = random.Random(seed)
        self._log = log.open("wb")
        self._lock = threading.Lock()

    def take(self, port: socket.socket) -> None:
        """Pass on what one side sent."""
        data, place = port.recvfrom(_BYTES)
        from_autopilot = port is self.far
        if from_autopilot:
            self._autopilot = place
        if self.cut or (self.loss > 0.0 and self._chance.random() < self.loss):
            self.lost += 1
            return
        self._pass(data, from_autopilot=from_autopilot)

    def send(self, data: bytes) -> None:
        """Say something to the autopilot, on this link, as a node does."""
        if not self.cut:
            self._pass(data, from_autopilot=False)

    def _pass(self, data: bytes, *, from_autopilot: bool) -> None:
        t_ns = time.time_ns()
        self.passed += 1
        goal, port = (self._node, self.near) if from_autopilot else (self._autopilot, self.far)
        if goal is not None:
            try:
                port.sendto(data, goal)
            except OSError:
                return  # nobody is there, as on a cable
        stamp = (t_ns // 1000).to_bytes(8, "big")
        with self._lock:  # a listener speaks from threads of its own
            for frame in _frames(data):
                self._log.write(stamp + frame)
        if from_autopilot:
            for listener in self.listeners:
                listener(t_ns, data)
        elif self.overhear is not None:
            self.overhear(t_ns, data)

    def close(self) -> None:
        """Close it; the log is whole."""
        self.far.close()
        self.near.close()
        self._log.close()


class Relay:
    """All links of one flight, on one thread.

    Args:
        links: name -> (port that the autopilot speaks to, port of the node).
        folder: for the logs.
        seed: of what is lost.
    """

    def __init__(self, links: Dict[str, Tuple[int, Optional[int]]], folder: Path, seed: int = 0) -> None:
        self.links = {
            name: Link(far, near, folder / f"{name}.tlog", seed + number)
            for number, (name, (far, near)) in enumerate(links.items())
        }
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)

    def start(self) -> None:
        """Relay from now on."""
        self._thread.start()

    def stop(self) -> None:
        """Stop; the logs are whole."""
        self._stopped.set()
        self._thread.join(5.0)
        for link in self.links.values():
            link.close()

    def _run(self) -> None:
        owners = {port: link for link in self.links.values() for port in (link.far, link.near)}
        while not self._stopped.is_set():
            for port in select.select(list(owners), [], [], _SLICE_S)[0]:
                try:
                    owners[port].take(port)
                except OSError:
                    continue  # the other end was not there when it was last spoken to


def _frames(data: bytes) -> Iterator[bytes]:
    """Return the frames of a datagram, which holds whole ones, those of ids that no dialect knows as well."""
    at = 0
    while at < len(data):
        found = frame_at(data, at)
        if found is None:
            return
        yield data[at : at + found.length]
        at += found.length


def _bound(port: int) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", port))
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    made.setblocking(False)
    return made
