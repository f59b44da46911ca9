"""Threads that wait for peers, so that nobody else has to."""

from __future__ import annotations

import logging
import threading
from queue import SimpleQueue
from typing import Callable

from .clock import Clock

__all__ = ["Periodic", "Workers"]

_log = logging.getLogger(__name__)


class Workers:
    """Run jobs at once, each on a thread of its own; threads are kept and used again.

    Unlike `concurrent.futures`, its threads are daemons: a job that hangs does not keep the process from ending. Jobs
    have time limits of their own, so there are never more threads than calls that are open at the same time.

    Args:
        name: prefix of the names of its threads.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._jobs: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._lock = threading.Lock()
        self._free = 0
        self._threads = 0

    def submit(self, job: Callable[[], None]) -> None:
        """Run a job now."""
        with self._lock:
            start = self._free == 0
            if start:
                self._threads += 1
            else:
                self._free -= 1
            number = self._threads
        self._jobs.put(job)
        if start:
            threading.Thread(target=self._work, name=f"{self._name}-{number}", daemon=True).start()

    def prepare(self, count: int) -> None:
        """Start threads ahead of the first jobs."""
        with self._lock:
            first = self._threads
            self._threads += count
        for number in range(first, first + count):
            threading.Thread(target=self._wait_first, name=f"{self._name}-{number + 1}", daemon=True).start()

    def _wait_first(self) -> None:
        with self._lock:
            self._free += 1
        self._work()

    def _work(self) -> None:
        while True:
            job = self._jobs.get()
            try:
                job()
            except Exception:
                _log.exception("a job of %s failed", self._name)
            with self._lock:
                self._free += 1


# --- periodic ---------------------------------------------------------------------------------------------------------
# Do something again and again on a thread of its own: what waits there makes nobody else wait.


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
