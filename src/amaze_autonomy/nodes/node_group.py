"""Several nodes as forks of one process: each a process of its own, all with one copy of what they have imported.

A node of ours is a Python of 55 MB, of which rospy, numpy and our modules are more than 40 that hardly change. Here
they are imported once, and each node is a fork: its name, parameters, topics and log are its own, it can be killed
alone, and none holds another one up. What they share is counted once by the kernel (PSS), by `ps` in each (RSS).

    node_group NODE | NAME=NODE [...] [--word value ...] [name:=value ...]

Words are those of `arguments.py`: each node is given those that it takes.

The group is no node itself. It starts a node again a second after its end, as `respawn` does, and within a tenth of the
time, since nothing has to be imported; when it is told to end, its nodes are told, and waited for. What it says of that
waits for no terminal: see "words to people" in `node_main.py`.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Dict, Iterator, List, Mapping, Optional, Sequence

from ..ros import node_main
from ..ros.arguments import NODES as TAKEN
from ..ros.arguments import option, split_words
from ..ros.errors import StartError

NODES: Mapping[str, str] = {
    "autopilot": "vehicle.autopilot_node",
    "data_recorder": "recorder.node",
    "landing_detection": "checks.landing_detection_node",
    "mission_planner": "vehicle.mission_planner_node",
    "state_estimation": "checks.state_estimation_node",
    "watchdog": "watchdog.node",
}
"""The nodes that may be in a group, and where they are."""

_NICE = -10  # as the nodes ask for
_RESPAWN_S = 1.0
_END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_START_ERROR = 2


def arguments_of(name: str, node: str, given: Sequence[str]) -> List[str]:
    """Return the arguments of a node: those of the group that it takes, with a name and a log of its own."""
    named, _ = split_words(given)
    own = [f"{option(word)}={value}" for word, value in named.items() if word in TAKEN[node]]
    own.append(f"__name:={name}")
    for each in given:
        key, mark, value = each.partition(":=")
        if key == "__log" and mark:
            log = Path(value)
            own.append(f"__log:={log.with_name(f'{name}-{log.name}')}")
        elif mark and key != "__name":
            own.append(each)
    return own


class NodeGroup:
    """The processes.

    Args:
        nodes: which, by their names.
        given: the arguments of the group.
    """

    def __init__(self, nodes: Mapping[str, str], given: Sequence[str]) -> None:
        self._nodes, self._given = dict(nodes), tuple(given)
        self._running: Dict[int, str] = {}
        self._due_s: Dict[str, float] = dict.fromkeys(nodes, 0.0)
        self._ending = False
        with _no_signal():
            self._words = node_main.Outlet(sys.stderr)

    def run(self) -> int:
        """Start the nodes, start them again, until told to end; return the exit status, in each node its own."""
        with _no_signal():
            mains = {
                name: importlib.import_module(f"{__package__}.{NODES[node]}").main for name, node in self._nodes.items()
            }
        node_main.take_precedence(_NICE)  # of the session, which its nodes are in; what is refused, each of them says
        gc.collect()
        gc.freeze()  # what is shared is not searched for garbage, which would write to it
        for number in _END_SIGNALS:
            signal.signal(number, self._end)
        while not self._ending or self._running:
            for name in self._due():
                if self._start(name) is None:
                    return int(mains[name]())
            self._wait()
        node_main.say_last_words()
        return 0

    def _due(self) -> List[str]:
        now_s = time.monotonic()
        return [] if self._ending else [name for name, due_s in self._due_s.items() if now_s >= due_s]

    def _start(self, name: str) -> Optional[int]:
        """Start a node; return its process, in that process None."""
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError):
                stream.flush()
        with _no_signal():
            pid = os.fork()
            if pid == 0:
                for number in _END_SIGNALS:
                    signal.signal(number, signal.SIG_DFL)
                node_main.forget_words()
                sys.argv[1:] = arguments_of(name, self._nodes[name], self._given)
                return None
            self._running[pid] = name
            del self._due_s[name]
        return pid

    def _wait(self) -> None:
        """Wait for the end of a node, at most until one is due."""
        pid, status = 0, 0
        with suppress(ChildProcessError):
            pid, status = os.waitpid(-1, os.WNOHANG)
        if not pid:
            time.sleep(0.05)
            return
        name = self._running.pop(pid, None)
        if name is not None and not self._ending:
            self._due_s[name] = time.monotonic() + _RESPAWN_S
            words = f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else f"status {os.WEXITSTATUS(status)}"
            self._words.write(f"node_group: {name} has ended ({words}); it is started again\n")

    def _end(self, number: int, _: object) -> None:
        self._ending = True
        for pid in tuple(self._running):
            with suppress(ProcessLookupError):
                os.kill(pid, number)


@contextmanager
def _no_signal() -> Iterator[None]:
    """Let no signal come between a fork and what must be known of it; threads that are begun meanwhile never get one.

    A signal that any thread takes is handled by the main one, whatever that has blocked.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, _END_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _END_SIGNALS)


def main() -> int:
    """Run the group that the arguments name; return its exit status."""
    if {"-h", "--help"}.intersection(sys.argv[1:]):
        print(f"{__doc__}\nNodes: {', '.join(NODES)}")
        return 0
    try:
        nodes = _nodes(sys.argv[1:])
    except StartError as error:
        print(f"node_group: {error}", file=sys.stderr)
        return _START_ERROR
    return NodeGroup(nodes, sys.argv[1:]).run()


def _nodes(given: Sequence[str]) -> Dict[str, str]:
    """Return the nodes that the arguments name, by their own names.

    Raises:
        StartError: There is no such node, or none takes a word.
    """
    words, named = split_words(given)
    nodes = {name or node: node for name, _, node in (each.rpartition("=") for each in named)}
    unknown = [node for node in nodes.values() if node not in NODES]
    if unknown or not nodes:
        wrong = f"there is no node {', '.join(unknown)}" if unknown else "no node is named"
        raise StartError(f"{wrong}; name some of {', '.join(NODES)}")
    for word in words:
        if not any(word in TAKEN[node] for node in nodes.values()):
            raise StartError(f"no node of it takes {option(word)}")
    return nodes
