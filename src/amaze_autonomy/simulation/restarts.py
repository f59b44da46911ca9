"""What comes of restarting a simulated component: what its faults say. Who asks is the watchdog, simulated or real."""

from __future__ import annotations

from typing import Dict, List, NamedTuple, Tuple

from .faults import Faults
from .scenario import Fault, Subject

__all__ = ["Restarts"]

_S = 1_000_000_000
_QUICK_NS = 2 * _S


class _Running(NamedTuple):
    """A restart under way: when it ends, and the faults that it ends; none when it fails."""

    ends_ns: int
    good: bool
    cures: Tuple[Fault, ...]


class Restarts:
    """The restarts that are under way; a component has one at most, a second one begins it anew."""

    def __init__(self, faults: Faults) -> None:
        self._faults = faults
        self._running: Dict[str, _Running] = {}

    def begin(self, t_ns: int, component: str) -> None:
        """Restart a component."""
        acting = [fault for fault, _ in self._faults.on(Subject.COMPONENT, component) if fault.has("restart")]
        good = all(fault.word("restart") == "succeeds" for fault in acting)
        takes_ns = max((round(fault.number("restart_takes_s") * _S) for fault in acting), default=_QUICK_NS)
        self._running[component] = _Running(t_ns + takes_ns, good, tuple(acting) if good else ())

    def step(self, t_ns: int) -> List[Tuple[str, bool]]:
        """Return (component, whether it came up) of the restarts that have ended."""
        ended: List[Tuple[str, bool]] = []
        for component, running in list(self._running.items()):
            if running.ends_ns > t_ns:
                continue
            del self._running[component]
            for fault in running.cures:
                self._faults.end(t_ns, fault)
            ended.append((component, running.good))
        return ended
