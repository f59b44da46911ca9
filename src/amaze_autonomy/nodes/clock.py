"""The clocks of a node: the one that decides, and ROS time for the age of messages.

Without `use_sim_time` the deciding clock is the monotonic one, which no time server steps. With `use_sim_time` it is
ROS time, made monotonic: where `/clock` jumps back (a bag that is played again) it stands still and goes on from there.
"""

from __future__ import annotations

import threading
import time
from typing import Callable, Optional

import rospy

__all__ = ["Clock", "MonotonicClock", "SimulatedClock", "make_clock", "wait_for_time"]


class Clock:
    """What the nodes need of a clock; nanoseconds."""

    def now_ns(self) -> int:
        """Return the time on the clock that decides; never less than before."""
        raise NotImplementedError

    def ros_ns(self) -> int:
        """Return ROS time, which the stamps of messages are on."""
        raise NotImplementedError

    def wall_wait_s(self, until_ns: int) -> float:
        """Return how many seconds of wall time a thread may sleep until the deciding clock could reach a time."""
        raise NotImplementedError


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

    Args:
        read: returns ROS time in nanoseconds.
        poll_s: how often a waiting thread looks at the clock again (it may run faster than real time).
        start_ns: the deciding clock is never below this (a resumed journal).
    """

    def __init__(self, read: Callable[[], int], poll_s: float = 0.02, start_ns: int = 0) -> None:
        self._read, self._poll_s = read, poll_s
        self._lock = threading.Lock()
        self._raw_ns: Optional[int] = None
        self._offset_ns, self._start_ns = 0, start_ns

    def now_ns(self) -> int:
        """Return ROS time plus all its jumps backwards."""
        with self._lock:
            raw_ns = self._read()
            before_ns = self._start_ns if self._raw_ns is None else self._raw_ns + self._offset_ns
            self._raw_ns = raw_ns
            self._offset_ns = max(self._offset_ns, before_ns - raw_ns)
            return raw_ns + self._offset_ns

    def ros_ns(self) -> int:
        """Return ROS time as `/clock` says it."""
        return self._read()

    def wall_wait_s(self, until_ns: int) -> float:
        """Return the time to the next look at the clock."""
        return self._poll_s if until_ns > self.now_ns() else 0.0


def make_clock(start_ns: int = 0) -> Clock:
    """Return the clock that `use_sim_time` asks for. Call it after `rospy.init_node`."""
    if rospy.rostime.is_wallclock():
        return MonotonicClock()
    return SimulatedClock(lambda: int(rospy.rostime.get_rostime().to_nsec()), start_ns=start_ns)


def wait_for_time(stopped: threading.Event) -> None:
    """Wait for the first message on `/clock`, without which there is no time to decide by, or until `stopped`."""
    while not rospy.rostime.is_wallclock() and not rospy.rostime.get_rostime() and not stopped.wait(0.05):
        rospy.logwarn_throttle(10, "use_sim_time is set: waiting for /clock")
