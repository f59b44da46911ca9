"""The deciding clock: monotonic whatever /clock does."""

from __future__ import annotations

import time

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.nodes.clock import MonotonicClock, SimulatedClock


class Ros:
    """ROS time that a test sets."""

    def __init__(self, ns):
        self.ns = ns

    def __call__(self):
        return self.ns


def test_simulated_time_is_ros_time():
    ros = Ros(100)
    clock = SimulatedClock(ros)
    assert clock.now_ns() == 100
    ros.ns = 250
    assert (clock.now_ns(), clock.ros_ns()) == (250, 250)


def test_simulated_time_stands_still_where_ros_time_jumps_back_and_goes_on_from_there():
    ros = Ros(1000)
    clock = SimulatedClock(ros)
    clock.now_ns()
    ros.ns = 300
    assert (clock.now_ns(), clock.ros_ns()) == (1000, 300)
    ros.ns = 350
    assert clock.now_ns() == 1050
    ros.ns = 0
    assert clock.now_ns() == 1050
    ros.ns = 10
    assert clock.now_ns() == 1060


def test_simulated_time_goes_on_after_a_resumed_journal():
    ros = Ros(50)
    clock = SimulatedClock(ros, start_ns=5000)
    assert clock.now_ns() == 5000
    ros.ns = 60
    assert clock.now_ns() == 5010


def test_simulated_time_is_looked_at_often_while_waiting():
    clock = SimulatedClock(Ros(100), poll_s=0.02)
    assert clock.wall_wait_s(200) == 0.02
    assert clock.wall_wait_s(100) == 0.0


def test_real_time_is_the_systems_monotonic_clock():
    clock = MonotonicClock()
    before = time.monotonic_ns()
    assert before <= clock.now_ns() <= time.monotonic_ns()
    assert abs(clock.ros_ns() - time.time_ns()) < 1_000_000_000
    assert clock.wall_wait_s(before - 1) == 0.0
    assert 900.0 < clock.wall_wait_s(time.monotonic_ns() + 1_000_000_000_000) <= 1000.0
