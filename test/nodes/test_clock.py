"""The deciding clock: monotonic whatever /clock does."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

pytest.importorskip("rospy")

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.autopilot.vehicle.client import AutopilotClient
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.monitoring.battery import BatterySpec
from amaze_autonomy.nodes.vehicle.vehicle_link import make_link
from amaze_autonomy.ros.clock import MonotonicClock, SimulatedClock
from amaze_autonomy.ros.errors import StartError

S = 1_000_000_000


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


class Wall:
    """Wall time that a test sets, and /clock with it."""

    def __init__(self, *, goes_on=False, limit_s=1.0):
        self.ros, self.ns = Ros(100 * S), 0
        self.clock = SimulatedClock(self.ros, stall_limit_ns=round(limit_s * S), wall_ns=lambda: self.ns)
        self.clock.goes_on = goes_on
        self.clock.now_ns()

    def passes(self, seconds, *, speed=0.0, looks=0.05):
        """Let wall time pass while /clock runs at a speed; return the deciding time since the beginning, in s."""
        for _ in range(round(seconds / looks)):
            self.ns += round(looks * S)
            self.ros.ns += round(looks * speed * S)
            self.clock.now_ns()
        return round(self.clock.now_ns() / S - 100.0, 6)


def test_a_clock_that_stands_for_longer_than_its_limit_is_stalled_until_it_runs():
    wall = Wall()
    assert wall.passes(1.0) == 0.0
    assert wall.clock.stalled_s() == 0.0
    assert wall.passes(0.5) == 0.0
    assert wall.clock.stalled_s() == pytest.approx(1.5)
    assert wall.passes(0.1, speed=1.0) == 0.1
    assert wall.clock.stalled_s() == 0.0


@pytest.mark.parametrize("speed", [0.001, 0.1, 1.0, 20.0])
def test_a_clock_that_is_slow_but_runs_is_not_stalled(speed):
    wall = Wall(goes_on=True)
    assert wall.passes(30.0, speed=speed) == pytest.approx(30.0 * speed)
    assert wall.clock.stalled_s() == 0.0


def test_in_flight_the_deciding_clock_goes_on_by_wall_time_after_the_limit():
    wall = Wall(goes_on=True)
    assert wall.passes(1.0) == 0.0
    assert wall.passes(5.0) == pytest.approx(5.0)
    assert wall.passes(0.5, speed=1.0) == pytest.approx(5.5), "and from there with /clock when that runs again"
    assert wall.clock.stalled_s() == 0.0


def test_a_process_that_was_stopped_does_not_take_itself_for_a_clock_that_stands():
    wall = Wall(goes_on=True)
    wall.passes(1.0, speed=1.0)
    wall.ns += 30 * S
    assert wall.clock.now_ns() == 101 * S
    assert wall.clock.stalled_s() == 0.0


def test_a_key_in_a_home_that_nobody_has_is_a_key_that_is_not_there():
    client = AutopilotClient(AutopilotSettings(), BatterySpec(cells=4), lambda: (1, 1))
    link = replace(client.settings.link, key_file="~nobody_of_this_name/key")
    with pytest.raises(StartError, match=r"^~nobody_of_this_name/key: "):
        make_link(client.settings, link, client, (), Wall().clock)


def test_a_landing_is_sent_again_while_the_clock_stands():
    wall = Wall()
    client = AutopilotClient(AutopilotSettings(), BatterySpec(cells=4), lambda: (1, 1))
    make_link(client.settings, client.settings.link, client, (), wall.clock)
    mode = 4 << 16 | 4 << 24  # AUTO.MISSION of a PX4
    for _ in range(20):
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 0x81, mode, 4, 3
        )
        beat._header = mavlink.MAVLink_header(0, srcSystem=1, srcComponent=1)
        client.receive(wall.clock.now_ns(), beat)
        client.wake(wall.clock.now_ns())
        wall.passes(0.05, speed=1.0)
    sent = list(client.land(wall.clock.now_ns())[1])
    for _ in range(100):
        wall.passes(0.05)
        sent += client.wake(wall.clock.now_ns())
    commands = [each.command for each in sent if each.get_type() == "COMMAND_LONG"]
    assert commands.count(mavlink.MAV_CMD_DO_SET_MODE) > 5
