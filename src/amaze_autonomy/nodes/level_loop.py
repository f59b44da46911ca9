"""Tells a level at its rate, and at once when it changes: the loop of the autopilot node and of the planner."""

from __future__ import annotations

from typing import Any, Callable

from .clock import Clock
from .vehicle_link import Link

__all__ = ["LevelLoop"]


class LevelLoop:
    """Tells a level: at its rate, and at once when it changes.

    Args:
        link: on which changes come.
        clock: of the node.
        period_ns: between two that change nothing.
        key: returns what is told at once when it changes, at a time; called under the link's lock.
        tell: tells it.
    """

    def __init__(
        self, link: Link, clock: Clock, period_ns: int, key: Callable[[int], Any], tell: Callable[[int], None]
    ) -> None:
        self._link, self._clock, self._period_ns, self._key, self._tell = link, clock, period_ns, key, tell
        self.ended = False

    def run(self) -> None:
        """Tell until `end`."""
        said: Any = None
        due_ns = 0
        while not self.ended:
            now_ns = self._clock.now_ns()
            key = self._link.ask(lambda t_ns: (self._key(t_ns), ()))
            if now_ns >= due_ns or key != said:
                said, due_ns = key, now_ns + self._period_ns
                self._tell(now_ns)
            self._wait_for_news(said, self._clock.wall_wait_s(due_ns))

    def _wait_for_news(self, said: Any, limit_s: float) -> None:
        self._link.wait_for(lambda: self.ended or self._key(self._clock.now_ns()) != said, limit_s)

    def end(self) -> None:
        """End; from any thread and from signal handlers."""
        self.ended = True
