"""The simulated world in real time: requests in from service threads, everything it does out on one thread.

And the faults of processes that are real nodes beside it.
"""

from __future__ import annotations

import itertools
import json
import logging
import os
import signal
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Callable, Dict, Mapping, Optional, Tuple, TypeVar

import rosgraph
import rospy

from amaze_autonomy.engine.commands import MissionCommand, Request
from amaze_autonomy.engine.events import Event
from amaze_autonomy.ros.clock import Clock, Workers
from amaze_autonomy.ros.liveness import LocalProcess, NodeLiveness, find
from amaze_autonomy.simulation import World
from amaze_autonomy.simulation.sensors import Sample

_SLICE_S = 0.01
T = TypeVar("T")
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Turn:
    """What came of one turn of the world.

    Args:
        events: all that are no replies, in order.
        services: that are there now.
        samples: of the sensors since the last turn.
        health: of the PX4's sensors, by name.
        troubles: kinds of the faults that act on each component and process.
        land_switch: the simulated autopilot node says that the transmitter's switch means land; None: it says nothing.
    """

    events: Tuple[Event, ...]
    services: Tuple[str, ...]
    samples: Tuple[Sample, ...]
    health: Mapping[str, Optional[bool]]
    troubles: Mapping[str, Tuple[str, ...]]
    land_switch: Optional[bool]


class Received:
    """Writes down each request that reached a simulated service: one JSON line with its time.

    Args:
        path: of the file; empty: nothing is written.
    """

    def __init__(self, path: str) -> None:
        self._file = Path(path).open("a", buffering=1, encoding="ascii") if path else None  # noqa: SIM115
        self._lock = threading.Lock()

    def note(self, t_ns: int, service: str, command: Request) -> None:
        """Write down a request; `t_ns` is its arrival on the node's clock, `monotonic_ns` on the system's."""
        if self._file is None:
            return
        line: Dict[str, Any] = {"monotonic_ns": time.monotonic_ns(), "service": service, "t_ns": t_ns}
        if isinstance(command, MissionCommand):
            line["command"] = command.action.name
        for name in ("session_id", "mission_id", "file_index", "repetition"):
            if hasattr(command, name):
                line[name] = getattr(command, name)
        with self._lock:
            self._file.write(json.dumps(line, sort_keys=True) + "\n")


class LiveWorld:
    """Drives a world with a clock.

    Args:
        world: made with `live=True`.
        clock: the node's.
        take: gets every turn; on the world's thread.
        received: writes down what came.
    """

    def __init__(
        self,
        world: World,
        clock: Clock,
        take: Callable[[Turn], None],
        received: Received,
    ) -> None:
        self._world, self._clock, self._take, self._received = world, clock, take, received
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        self._waiting: Dict[int, SimpleQueue[Event]] = {}
        self._wake, self._stopped = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="world", daemon=True)

    def start(self) -> None:
        """Let time pass."""
        self._thread.start()

    def stop(self) -> None:
        """Stop time; requests that still wait get no answer."""
        self._stopped.set()
        self._wake.set()
        self._thread.join(5.0)

    @property
    def in_the_air(self) -> bool:
        """True while the simulated vehicle flies."""
        with self._lock:
            return bool(self._world.vehicle.airborne)

    def observe_state(self, state: str) -> None:
        """Take notice of the engine's state."""
        with self._lock:
            self._world.observe_state(self._now_ns(), state)
        self._wake.set()

    def restart(self, component: str) -> None:
        """Restart a sensor: its driver was restarted."""
        with self._lock:
            self._world.restart(component)

    def initialise(self) -> Optional[str]:
        """Tell the estimator to begin; return why it does not, or nothing; None: there is no answer."""
        return self.exchange(lambda _: self._world.initialise())

    def exchange(self, act: Callable[[int], T]) -> T:
        """Bring the world to the present time and call a function with it, while nobody else touches the world."""
        with self._lock:
            self._world.catch_up(self._now_ns())
            return act(self._world.now_ns)

    def note(self, event: str) -> None:
        """Take notice of something that happened outside of this world."""
        with self._lock:
            self._world.note(event)

    def ask(self, service: str, make: Callable[[int], Request]) -> Optional[Event]:
        """Hand a request to the world and wait for its answer, for ever if need be; None when the node ends."""
        slot: SimpleQueue[Event] = SimpleQueue()
        number = next(self._numbers)
        command = make(number)
        with self._lock:
            self._waiting[number] = slot
            now_ns = self._now_ns()
            self._received.note(now_ns, service, command)
            self._world.handle(now_ns, command)
        self._wake.set()
        while not self._stopped.is_set():
            try:
                return slot.get(timeout=0.5)
            except Empty:
                continue
        return None

    def _now_ns(self) -> int:
        return max(self._clock.now_ns(), self._world.now_ns)

    def _run(self) -> None:
        while not self._stopped.is_set():
            self._wake.clear()
            turn = self._turn()
            try:
                self._take(turn)
            except Exception:
                _log.exception("the world's shell failed")
            self._wake.wait(min(_SLICE_S, self._clock.wall_wait_s(self._world.next_ns)))

    def _turn(self) -> Turn:
        """Let time pass until now; hand replies to those who wait for them."""
        with self._lock:
            events = self._world.advance(self._now_ns())
            services, samples = self._world.services(), tuple(self._world.samples())
            health, troubles = self._world.sensor_health(), self._world.troubles()
            switch = self._world.land_switch
            slots = [(self._waiting.pop(_number(event), None), event) for event in events]
        for slot, event in slots:
            if slot is not None:
                slot.put(event)
        told = tuple(event for event in events if not _number(event))
        return Turn(told, services, samples, health, troubles, switch)


def _number(event: Event) -> int:
    """Return the number of the request that an event answers; 0 when it is no reply."""
    return int(getattr(event, "command_id", 0))


# --- faults of processes that are real nodes here ---------------------------------------------------------------------
# Killed is SIGKILL, and what roslaunch starts in its place is stopped as soon as it can be found; silent and stuck are
# SIGSTOP; until the fault ends.


_LIMIT_S = 1.0
_PERIOD_S = 0.1
_STOPS = ("silent", "stuck")


class RealPeers:
    """The peers of the engine that real nodes are, and the simulated world does not play.

    Args:
        nodes: name of the node that each peer is.
    """

    def __init__(self, nodes: Mapping[str, str]) -> None:
        self._nodes = dict(nodes)
        self._acting: Dict[str, Tuple[str, ...]] = {}
        self._stopped: Dict[str, LocalProcess] = {}
        self._lock = threading.Lock()
        self._workers = Workers("real peer")

    def look_after(self, troubles: Mapping[str, Tuple[str, ...]]) -> None:
        """Do to each what its faults say, once; returns at once.

        Args:
            troubles: kinds of the faults that act on each process.
        """
        for name in self._nodes:
            before, now = self._acting.get(name, ()), troubles.get(name, ())
            if before != now:
                self._acting[name] = now
                self._workers.submit(partial(self._act, name, now))

    def end(self) -> None:
        """Let go on whatever is stopped: it is to end now, and cannot while it is."""
        for name in self._nodes:
            self._acting[name] = ()
            self._go_on(name)

    def _act(self, name: str, kinds: Tuple[str, ...]) -> None:
        if "killed" in kinds:
            dead = _find(self._nodes[name])
            _send(name, dead, signal.SIGKILL)
            self._keep_down(name, kinds, dead)
        elif any(kind in _STOPS for kind in kinds):
            self._stop(name, kinds, _find(self._nodes[name]))
        elif kinds:
            rospy.logwarn("%s is a real node: its fault %s does nothing", name, ", ".join(kinds))
        else:
            self._go_on(name)

    def _keep_down(self, name: str, kinds: Tuple[str, ...], dead: Optional[LocalProcess]) -> None:
        while dead is not None and self._acting[name] == kinds and not rospy.is_shutdown():
            time.sleep(_PERIOD_S)
            process = _find(self._nodes[name])
            if process is not None and process.pid != dead.pid:
                self._stop(name, kinds, process)
                return

    def _stop(self, name: str, kinds: Tuple[str, ...], process: Optional[LocalProcess]) -> None:
        with self._lock:
            if self._acting[name] == kinds:
                _send(name, process, signal.SIGSTOP)
                if process is not None:
                    self._stopped[name] = process

    def _go_on(self, name: str) -> None:
        with self._lock:
            if name in self._stopped:
                _send(name, self._stopped.pop(name), signal.SIGCONT)


def _send(name: str, process: Optional[LocalProcess], number: signal.Signals) -> None:
    if process is None or not process.alive:
        rospy.logwarn("%s is no node of this computer: its fault does nothing", name)
        return
    rospy.logwarn("%s, process %d, gets %s", name, process.pid, number.name)
    with suppress(ProcessLookupError):
        os.kill(process.pid, number)


def _find(name: str) -> Optional[LocalProcess]:
    node = NodeLiveness(rospy.resolve_name(name), rosgraph.get_master_uri(), rospy.get_name(), _LIMIT_S)
    node.ask()
    return find(node.place.uri, node.place.pid) if node.place is not None else None
