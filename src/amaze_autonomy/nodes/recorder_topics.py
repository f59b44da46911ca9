"""Names of the topics that are recorded, and what the master says about who publishes and subscribes to them."""

from __future__ import annotations

import time
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import rosgraph
import rospy

from .clock import MonotonicClock
from .periodic import Periodic

__all__ = ["MasterView", "resolved"]

_PERIOD_NS = 500_000_000
_FRESH_S = 5.0


def resolved(topics: Sequence[str]) -> Tuple[str, ...]:
    """Return names as the recorder takes them; ~ is the autonomy node's private namespace."""
    names = [rospy.resolve_name(name.replace("~", "autonomy/", 1)) for name in topics]
    return tuple(dict.fromkeys(names))


class MasterView:
    """Asks the master, again and again, on a thread of its own: a master that hangs makes nobody wait."""

    def __init__(self) -> None:
        self._master = rosgraph.Master(rospy.get_name())
        self._seen: Tuple[Mapping[str, Sequence[str]], List[str]] = ({}, [])
        self._at_s: Optional[float] = None
        self._periodic = Periodic("master", self._ask, _PERIOD_NS, MonotonicClock())

    def start(self) -> None:
        """Begin to ask."""
        self._periodic.start()

    def _ask(self) -> None:
        publishers, subscribers, _ = self._master.getSystemState()
        found: Dict[str, Sequence[str]] = dict(subscribers)
        self._seen = found, [topic for topic, nodes in publishers if nodes]
        self._at_s = time.monotonic()

    def seen(self) -> Tuple[Optional[Mapping[str, Sequence[str]]], List[str]]:
        """Return subscribers by topic and topics that are published; None when that is not known any more."""
        if self._at_s is None or time.monotonic() - self._at_s > _FRESH_S:
            return None, []
        return self._seen
