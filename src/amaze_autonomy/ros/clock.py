"""The clocks of a node, the one that decides, and ROS time for the age of messages; and threads that wait by them.

Without `use_sim_time` the deciding clock is the monotonic one, which no time server steps. With `use_sim_time` it is
ROS time, made monotonic: where `/clock` jumps back (a bag that is played again) it stands still and goes on from there.
"""

from __future__ import annotations

import abc
import logging
import threading
import time
from queue import SimpleQueue
from typing import Callable, Optional

import rospy

from .errors import report

# --- clocks -----------------------------------------------------------------------------------------------------------


_FOREVER_NS = 1 << 62
_LONGEST_LOOK_NS = 150_000_000
_CATCH_UP_S, _CATCH_UP_LIMIT_S = 0.01, 0.05


class Clock(abc.ABC):
    """What the nodes need of a clock; nanoseconds."""

    goes_on = True  # where the source of time stands still for too long

    @abc.abstractmethod
    def now_ns(self) -> int:
        """Return the time on the clock that decides; never less than before."""

    @abc.abstractmethod
    def ros_ns(self) -> int:
        """Return ROS time, which the stamps of messages are on."""

    @abc.abstractmethod
    def wall_wait_s(self, until_ns: int) -> float:
        """Return how many seconds of wall time a thread may sleep until the deciding clock could reach a time."""

    def stalled_s(self) -> float:
        """Return for how many seconds of wall time the deciding clock has stood, when that is too long; else 0."""
        return 0.0

    def catch_up(self) -> None:
        """Show the present after the process did not run; may wait for tens of milliseconds."""


def boot_ns() -> int:
    """Return nanoseconds since the system started, the time in which it slept included."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class MonotonicClock(Clock):
    """The system's monotonic clock decides; the system's wall clock stamps."""

    def now_ns(self) -> int:
        """Return nanoseconds since the system started."""
        return time.monotonic_ns()

    def ros_ns(self) -> int:
        """Return nanoseconds since 1970."""
        return time.time_ns()

    def wall_wait_s(self, until_ns: int) -> float:
        """Return the time left, never negative."""
        return max(0.0, (until_ns - time.monotonic_ns()) * 1e-9)


class SimulatedClock(Clock):
    """ROS time decides and stamps.

    Where `/clock` stands still, so does the deciding clock; with `goes_on`, only until the stall limit: from then on it
    goes by wall time, and it never runs back when `/clock` moves again.

    Args:
        read: returns ROS time in nanoseconds.
        poll_s: how often a waiting thread looks at the clock again (it may run faster than real time).
        start_ns: the deciding clock is never below this (a resumed journal).
        stall_limit_ns: wall time for which `/clock` may stand.
        wall_ns: the wall time.
    """

    def __init__(
        self,
        read: Callable[[], int],
        poll_s: float = 0.02,
        start_ns: int = 0,
        stall_limit_ns: int = _FOREVER_NS,
        wall_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._read, self._poll_s, self._stall_limit_ns, self._wall_ns = read, poll_s, stall_limit_ns, wall_ns
        self._lock = threading.Lock()
        self._raw_ns: Optional[int] = None
        self._now_ns, self._offset_ns = start_ns, 0
        self._looked_ns, self._stood_ns = wall_ns(), 0
        self.goes_on = False

    def now_ns(self) -> int:
        """Return ROS time plus all its jumps backwards, and the wall time for which it went on by itself."""
        with self._lock:
            raw_ns, wall_ns = self._read(), self._wall_ns()
            passed_ns, self._looked_ns = wall_ns - self._looked_ns, wall_ns
            if raw_ns != self._raw_ns:
                self._raw_ns, self._stood_ns = raw_ns, 0
            else:  # a time in which nobody looked is one in which this process, not the clock, may have stood
                self._stood_ns += min(passed_ns, _LONGEST_LOOK_NS)
            going_on_ns = passed_ns if self.goes_on and self._stood_ns > self._stall_limit_ns else 0
            self._now_ns = max(raw_ns + self._offset_ns, self._now_ns + going_on_ns)
            self._offset_ns = self._now_ns - raw_ns
            return self._now_ns

    def ros_ns(self) -> int:
        """Return ROS time as `/clock` says it."""
        return self._read()

    def wall_wait_s(self, until_ns: int) -> float:
        """Return the time to the next look at the clock."""
        return self._poll_s if until_ns > self.now_ns() else 0.0

    def stalled_s(self) -> float:
        """Return for how much wall time `/clock` has stood, when it is longer than the limit; else 0."""
        self.now_ns()
        return self._stood_ns * 1e-9 if self._stood_ns > self._stall_limit_ns else 0.0

    def catch_up(self) -> None:
        """Wait until rospy's thread has read what came on `/clock` while this process did not run."""
        until_s, raw_ns = time.monotonic() + _CATCH_UP_LIMIT_S, -1
        while raw_ns != self._read() and time.monotonic() < until_s:
            raw_ns = self._read()
            time.sleep(_CATCH_UP_S)


def make_clock(start_ns: int = 0, stall_limit_ns: int = _FOREVER_NS) -> Clock:
    """Return the clock that `use_sim_time` asks for. Call it after `rospy.init_node`.

    Args:
        start_ns: the clock is never below this.
        stall_limit_ns: wall time for which `/clock` may stand.
    """
    if rospy.rostime.is_wallclock():
        return MonotonicClock()
    return SimulatedClock(
        lambda: int(rospy.rostime.get_rostime().to_nsec()), start_ns=start_ns, stall_limit_ns=stall_limit_ns
    )


def wait_for_time(stopped: threading.Event) -> None:
    """Wait for the first message on `/clock`, without which there is no time to decide by, or until `stopped`."""
    while not rospy.rostime.is_wallclock() and not rospy.rostime.get_rostime() and not stopped.wait(0.05):
        rospy.logwarn_throttle(10, "use_sim_time is set: waiting for /clock")


# --- threads that wait ------------------------------------------------------------------------------------------------


Job = Callable[[], None]
_log = logging.getLogger(__name__)


class Workers:
    """Run jobs at once, each on a thread of its own; threads are kept and used again.

    Unlike `concurrent.futures`, its threads are daemons: a job that hangs does not keep the process from ending. Jobs
    have time limits of their own, so there are never more threads than calls that are open at the same time.

    Where the system gives no new thread (a limit of processes, or of memory), those that there are go on.

    Args:
        name: prefix of the names of its threads.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._jobs: SimpleQueue[Job] = SimpleQueue()
        self._lock = threading.Lock()
        self._free = 0
        self._threads = 0

    def submit(self, job: Job) -> None:
        """Run a job now.

        Raises:
            RuntimeError: No thread is free, and no new one can be had; the job is not run. Likewise MemoryError.
        """
        with self._lock:
            if self._free > 0:
                self._jobs.put(job)
                self._free -= 1
                return
        self._start(job)

    def prepare(self, count: int) -> None:
        """Start threads ahead of the first jobs; where not so many can be had, that is said, and fewer must do."""
        for number in range(count):
            try:
                self._start(None)
            except (RuntimeError, MemoryError):
                report(_log, "no more than %d of %d threads of %s can be had", number, count, self._name)
                return

    def _start(self, first: Optional[Job]) -> None:
        with self._lock:
            self._threads += 1
            name = f"{self._name}-{self._threads}"
        try:
            threading.Thread(target=self._work, args=(first,), name=name, daemon=True).start()
        except BaseException:
            with self._lock:
                self._threads -= 1
            raise

    def _work(self, job: Optional[Job]) -> None:
        while True:
            if job is not None:
                self._do(job)
            with self._lock:
                self._free += 1
            job = self._jobs.get()

    def _do(self, job: Job) -> None:
        try:
            job()
        except Exception:
            report(_log, "a job of %s failed", self._name)


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
                report(_log, "%s failed", self._thread.name)
            while not self._stopped.is_set() and self._clock.now_ns() < due_ns:
                self._stopped.wait(min(_LONGEST_S, self._clock.wall_wait_s(due_ns)))
