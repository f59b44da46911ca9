"""A vehicle that takes missions, behind a channel that loses, doubles and delays; virtual time."""

from __future__ import annotations

import heapq
from typing import Any, Callable, Iterable, List, Optional, Tuple

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.link.wire import Wire
from amaze_autonomy.simulation.px4.missions import MissionServer

MS = 1_000_000
S = 1000 * MS
TARGET = (1, 1)
Fate = Callable[[], Tuple[int, ...]]  # delays in ns of the copies that arrive; none: lost


def good() -> Tuple[int, ...]:
    return (5 * MS,)


class Vehicle:
    """The mission protocol of PX4 with its `current` trap; MISSION_CURRENT comes once a second."""

    def __init__(self, current: int = 0) -> None:
        self.server = MissionServer(capacity=200)
        self.current = current
        self._said_ns = 0

    def take(self, t_ns: int, message: Any) -> List[Any]:
        if message.get_type() == "MISSION_SET_CURRENT":
            if message.seq < len(self.server.items):
                self.current = message.seq
            return []
        answers = self.server.take(t_ns, "link", message)
        if self.server.uploaded is not None:
            upload, self.server.uploaded = self.server.uploaded, None
            if upload.current is not None:
                self.current = upload.current
        return answers

    def wake(self, t_ns: int) -> List[Any]:
        told = [message for _, message in self.server.advance(t_ns)]
        if t_ns - self._said_ns >= S:
            self._said_ns = t_ns
            told.append(mavlink.MAVLink_mission_current_message(self.current))
        return told


class Channel:
    """Carries packed messages both ways.

    Args:
        client: of ours.
        vehicle: at the other end.
        fate: of each message.
        wanted: names of what the client is given, as by a `Connection`; None: all.
    """

    def __init__(self, client: Any, vehicle: Any, fate: Fate = good, wanted: Optional[Iterable[str]] = None) -> None:
        self.client, self.vehicle, self.fate = client, vehicle, fate
        self._wanted = None if wanted is None else frozenset(wanted)
        self.sent: List[str] = []
        self._ours, self._theirs = Wire(1, 191), Wire(*TARGET)
        self._queue: List[Tuple[int, int, bool, bytes]] = []
        self._number = 0
        self.t_ns = 0

    def ours(self, messages: Any) -> None:
        """Send messages of the client."""
        self.sent.extend(message.get_type() for message in messages)
        self._put(self._ours, messages, to_vehicle=True)

    def _put(self, wire: Wire, messages: Any, *, to_vehicle: bool) -> None:
        for message in messages:
            data = wire.send(message)
            for delay_ns in self.fate():
                self._number += 1
                heapq.heappush(self._queue, (self.t_ns + delay_ns, self._number, to_vehicle, data))

    def run(self, over: Callable[[], bool], limit_ns: int) -> None:
        """Let time pass in steps of 50 ms until it is over, or the limit has passed."""
        end_ns = self.t_ns + limit_ns
        while not over() and self.t_ns < end_ns:
            next_ns = self.t_ns + 50 * MS
            while self._queue and self._queue[0][0] <= next_ns:
                self.t_ns, _, to_vehicle, data = heapq.heappop(self._queue)
                self._deliver(data, to_vehicle=to_vehicle)
            self.t_ns = next_ns
            self.ours(self.client.wake(self.t_ns))
            self._say(self.vehicle.wake(self.t_ns))

    def _say(self, messages: Any) -> None:
        """Send what the client wants of the vehicle's messages; the others, two of three, have a fate as well."""
        for message in messages:
            if self._wanted is None or message.get_type() in self._wanted:
                self._put(self._theirs, (message,), to_vehicle=False)
            else:
                self.fate()

    def _deliver(self, data: bytes, *, to_vehicle: bool) -> None:
        receiver = self._theirs if to_vehicle else self._ours
        for message in receiver.receive(data):
            if to_vehicle:
                self._say(self.vehicle.take(self.t_ns, message))
            else:
                self.ours(self.client.receive(self.t_ns, message))
