"""The watchdog's one thread: it counts what comes, judges it, and says so. Nothing that can wait happens here.

All else (questions to nodes, looks at drivers, restarts, service calls) runs elsewhere and hands in its results as
jobs. If this loop is stuck, so is the loop counter of the heartbeat, and the engine notices.
"""

from __future__ import annotations

import logging
from queue import Empty, SimpleQueue
from typing import Callable, Optional, Tuple

from amaze_autonomy.engine.events import WatchdogAction, WatchdogInfo
from amaze_autonomy.monitoring.restart import RestartRequest
from amaze_autonomy.monitoring.streams import Streams
from amaze_autonomy.monitoring.watchdog import Watchdog

from .clock import Clock
from .takeoff_desk import TakeoffDesk
from .topic_reader import TopicReader
from .topic_watch import TopicWatch

__all__ = ["Job", "WatchLoop"]

_log = logging.getLogger(__name__)
_S = 1_000_000_000
_IDLE_S = 1.0
_STALL_NS = _S // 10

#: Something for the watchdog's thread; gets the present time.
Job = Callable[[int], None]
Tell = Callable[[Optional[WatchdogAction], Optional[WatchdogInfo], int], None]


class WatchLoop:
    """Turns over and over.

    Args:
        watchdog: that judges; nobody else may touch it.
        streams: its messages.
        reader: of all topics.
        watches: the topics.
        desk: take-off checks that wait for an answer.
        clock: the node's.
        tell: publishes what is due.
        restart: begins a restart.
        stalled: gets how long this thread did not run though it should have, and the time, before anything is judged.
    """

    def __init__(
        self,
        watchdog: Watchdog,
        streams: Streams,
        reader: TopicReader,
        watches: Tuple[TopicWatch, ...],
        desk: TakeoffDesk,
        clock: Clock,
        tell: Tell,
        restart: Callable[[RestartRequest], None],
        stalled: Callable[[int, int], None],
    ) -> None:
        self._watchdog, self._streams, self._reader, self._watches = watchdog, streams, reader, watches
        self._desk, self._clock, self._tell = desk, clock, tell
        self._restart, self._stalled = restart, stalled
        self._jobs: SimpleQueue[Job] = SimpleQueue()
        self._stopped = False

    def put(self, job: Job) -> None:
        """Have a job done at the next turn; from any thread."""
        self._jobs.put(job)
        self._reader.wake()

    def stop(self) -> None:
        """End; from any thread, and from signal handlers."""
        self._stopped = True
        self._reader.wake()

    def run(self) -> None:
        """Turn until it is stopped."""
        now_ns = self._clock.now_ns()
        while not self._stopped:
            limit_s = self._limit_s()
            due_ns = now_ns + round(limit_s * _S)  # from the last turn on: it may have been stopped within that, too
            self._reader.wait(limit_s)
            now_ns = self._clock.now_ns()
            if now_ns - due_ns > _STALL_NS:
                self._stalled(now_ns - due_ns, now_ns)
            self._turn(now_ns)

    def _limit_s(self) -> float:
        """Return how long nothing has to be done unless something comes."""
        if not self._watchdog.started:
            return _IDLE_S
        return min(_IDLE_S, self._clock.wall_wait_s(min(self._streams.next_ns, self._desk.next_ns)))

    def _turn(self, now_ns: int) -> None:
        """Take in all that came before judging: what waited here while this process did not run is no silence."""
        for watch in self._watches:
            watch.flush(now_ns)
        self._do_jobs(now_ns)
        if not self._watchdog.started:
            return
        action, info = self._streams.poll(now_ns)
        if action is not None or info is not None:
            self._tell(action, info, now_ns)
        for request in self._watchdog.restart_requests():
            self._restart(request)
        self._desk.turn(now_ns)

    def _do_jobs(self, now_ns: int) -> None:
        while True:
            try:
                job = self._jobs.get_nowait()
            except Empty:
                return
            try:
                job(now_ns)
            except Exception:
                _log.exception("a job of the watchdog failed")
