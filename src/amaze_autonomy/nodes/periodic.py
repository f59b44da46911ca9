"""Do something again and again on a thread of its own: what waits there makes nobody else wait."""

from __future__ import annotations

import logging
import threading
from typing import Callable

from .clock import Clock

__all__ = ["Periodic"]

_log = logging.getLogger(__name__)
_LONGEST_S = 0.5  # between two looks at the clock


class Periodic:
    """One job at a period of the deciding clock; a run that takes longer delays the next one, and nothing piles up.

    Args:
        name: of its thread.
        job: what is done.
        period_ns: from one beginning to the next.
        clock: the node's.
    """

    def __init__(self, name: str, job: Callable[[], None], period_ns: int, clock: Clock) -> None:
        self._job, self._period_ns, self._clock = job, period_ns, clock
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin, with the first run at once."""
        self._thread.start()

    def stop(self) -> None:
        """Begin no more runs; one that is under way goes on."""
        self._stopped.set()

    def _run(self) -> None:
        while not self._stopped.is_set():
            due_ns = self._clock.now_ns() + self._period_ns
            try:
                self._job()
            except Exception:
                _log.exception("%s failed", self._thread.name)
            while not self._stopped.is_set() and self._clock.now_ns() < due_ns:
                self._stopped.wait(min(_LONGEST_S, self._clock.wall_wait_s(due_ns)))
