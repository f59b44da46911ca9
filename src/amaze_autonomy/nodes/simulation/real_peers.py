"""Faults of processes that are real nodes here.

Killed is SIGKILL, and what roslaunch starts in its place is stopped as soon as it can be found; silent and stuck are
SIGSTOP; until the fault ends.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import suppress
from functools import partial
from typing import Dict, Mapping, Optional, Tuple

import rosgraph
import rospy

from ...ros.liveness import NodeLiveness
from ...ros.local_process import LocalProcess, find
from ...ros.threads import Workers

__all__ = ["RealPeers"]

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
