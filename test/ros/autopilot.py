#!/usr/bin/env python3
"""The autopilot node with the simulated PX4 over UDP: what it says, its checks, landing, disarming, and how it ends."""

from __future__ import annotations

import math
import signal
import socket
import time
import unittest

import rospy
import rostest
from at_once import at_once
from hitches import allowed_s
from one_node import OneNode, wait_for, wait_for_end, wait_for_service
from px4_vehicle import Px4Vehicle, forged
from std_srvs.srv import Trigger

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

STATUS, CHECK = msg.AutopilotStatus, msg.Check


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def says_all(status) -> bool:
    """Return whether a message of each kind has come."""
    numbers = (status.battery_fraction, status.battery_cell_voltage, status.clock_offset)
    known = status.armed_known and status.landed and status.height_valid and status.position_valid
    health = (status.gps, status.imu, status.magnetometer, status.barometer, status.rc, status.prearm)
    return bool(known) and all(health) and all(map(math.isfinite, numbers))


@at_once(4)
class TestAutopilot(unittest.TestCase):
    """Each test has a vehicle and a node of its own."""

    def setUp(self):
        self.space = f"/{self._testMethodName[:30]}"
        self.statuses = []
        self.url = f"127.0.0.1:{free_port()}"
        self.vehicle = Px4Vehicle(f"udpout:{self.url}")
        rospy.Subscriber(f"{self.space}/autopilot/status", STATUS, self.statuses.append)
        overrides = [f"autopilot.link.url=udpin:{self.url}", "autopilot.parameters.COM_LOW_BAT_ACT=0"]
        overrides += ["sensors.battery.cells=6", "missions.missions.5.controller=mission"]
        self.node = OneNode("autopilot", self.space, overrides)

    def tearDown(self):
        if self.node.process.poll() is None:
            self.node.process.kill()
            self.node.process.wait()
        self.vehicle.stop()

    @property
    def status(self):
        return self.statuses[-1] if self.statuses else STATUS()

    def call(self, name, kind=Trigger, *arguments):
        name = f"{self.space}/autopilot/{name}"
        wait_for_service(name)
        return rospy.ServiceProxy(name, kind)(*arguments)

    def wait(self, condition, what, limit_s=40.0):
        wait_for(lambda: condition(self.status), lambda: f"{what} (now {self.status}): {self.node.log}", limit_s)

    def fly(self):
        self.wait(says_all, "a vehicle at rest")
        with self.vehicle.lock:
            self.assertEqual(self.vehicle.craft.arm(), "")
            self.vehicle.craft.command_mode("AUTO.TAKEOFF")
        self.wait(lambda status: status.landed == STATUS.IN_AIR and status.armed, "a vehicle in the air")

    # --- stories --------------------------------------------------------------------------------------------------

    def test_what_a_vehicle_at_rest_says(self):
        self.wait(says_all, "a vehicle that says all")
        said = self.status
        self.assertEqual(
            (said.armed_known, said.armed, said.landed, said.mode, said.pilot_in_control, said.failsafe),
            (True, False, STATUS.ON_GROUND, "AUTO.LOITER", False, False),
        )
        self.assertEqual(
            (said.gps, said.imu, said.magnetometer, said.barometer, said.rc, said.prearm), (STATUS.SENSOR_HEALTHY,) * 6
        )
        self.assertLess(abs(said.height), 0.5)
        self.assertGreater(said.battery_fraction, 0.9)
        self.assertGreater(said.battery_cell_voltage, 3.5)
        self.assertLess(abs(said.clock_offset), 0.5)
        advice = {"landed state": "the range finder cannot confirm it"}
        answers = []

        def passed():
            answers.append(self.call("check", srv.CheckAutopilot))
            return {row.name: row.advice for row in answers[-1].checks if row.verdict != CHECK.PASS} == advice

        wait_for(passed, lambda: f"a check with all parameters read: {answers[-1:]}")
        self.assertTrue(answers[-1].ok)
        battery = self.call("check_battery", srv.CheckBattery, 0.5)
        self.assertTrue(battery.ok, battery.checks)
        self.assertEqual(
            [row.name for row in battery.checks],
            ["battery age", "battery fraction", "battery cell voltage", "battery state"],
        )
        self.assertFalse(self.call("check_battery", srv.CheckBattery, 1.1).ok)

    def test_it_lands_and_disarms_on_the_ground_only(self):
        self.wait(lambda status: status.armed_known, "a vehicle")
        self.assertEqual(self.call("disarm").message, "the vehicle is disarmed")
        self.fly()
        refused = self.call("disarm")
        self.assertEqual((refused.success, refused.message), (False, "not on the ground: the vehicle says IN_AIR"))
        began_s = time.monotonic()
        answer = self.call("land")
        self.assertTrue(answer.success, answer.message)
        self.assertLess(time.monotonic() - began_s, allowed_s(1.0, began_s))
        self.wait(lambda status: status.mode == "AUTO.LAND", "the landing mode")
        self.wait(lambda status: status.landed == STATUS.ON_GROUND, "the ground")
        self.assertFalse(self.status.pilot_in_control)
        answers = []
        disarmed = lambda: answers.append(self.call("disarm")) or answers[-1].success  # noqa: E731
        wait_for(disarmed, lambda: f"a disarmed vehicle: {answers}", period_s=1.0)
        self.wait(lambda status: not status.armed, "a disarmed vehicle")

    def test_a_pilot_is_seen_at_once_where_heartbeats_are_lost_and_is_not_fought(self):
        self.fly()
        with self.vehicle.lock:
            self.vehicle.unsaid = {"HEARTBEAT"}  # CURRENT_MODE shows it, and the link is heard by anything
        seen, lossy_s = len(self.statuses), time.monotonic()
        wait_for(lambda: time.monotonic() - lossy_s > 3.5, "more than its limit without a heartbeat")
        oldest_s = max(each.link_age for each in self.statuses[seen:])
        self.assertLess(oldest_s, allowed_s(0.7, lossy_s))
        self.assertFalse(any(each.pilot_in_control for each in self.statuses[seen:]))
        began_s = time.monotonic()
        with self.vehicle.lock:
            self.vehicle.craft.pilot_takes_over("POSCTL", 60_000_000_000)
        self.wait(lambda status: status.pilot_in_control, "the pilot")
        self.assertLess(time.monotonic() - began_s, allowed_s(0.4, began_s))
        refused = self.call("land")
        self.assertEqual((refused.success, refused.message), (False, "the pilot has control, in POSCTL"))
        self.assertEqual(self.node.end(), 0)
        self.assertEqual(self.vehicle.craft.mode, "POSCTL")

    def test_a_landing_stands_whatever_one_datagram_says(self):
        self.fly()
        with self.vehicle.lock:
            self.vehicle.craft.flags.ignores = ("AUTO.LAND",)
        seen = len(self.statuses)

        def lied_to():  # a starved node reads the truth behind it before it tells: said again then
            self.vehicle.say(*forged("AUTO.TAKEOFF"))
            return any(not each.armed for each in self.statuses[seen:])

        wait_for(lied_to, "the forged status", period_s=0.3)
        self.assertNotIn("disarmed", self.call("land").message)
        self.vehicle.say(*forged("AUTO.TAKEOFF"))
        time.sleep(0.6)
        with self.vehicle.lock:
            self.vehicle.craft.flags.ignores = ()
        wait_for(lambda: self.vehicle.craft.mode == "AUTO.LAND", "the landing mode", 5.0)

    def test_told_to_end_in_flight_it_commands_the_landing_mode_first(self):
        self.fly()
        self.node.process.send_signal(signal.SIGTERM)
        self.assertEqual(wait_for_end(self.node.process), 0)
        self.assertEqual(self.vehicle.craft.mode, "AUTO.LAND")
        self.assertIn("autopilot: ended in flight: the vehicle is in its landing mode", self.node.log)

    def test_told_to_end_on_the_ground_it_just_ends(self):
        self.wait(lambda status: status.armed_known, "a vehicle")
        self.node.process.send_signal(signal.SIGTERM)
        self.assertEqual(wait_for_end(self.node.process), 0)
        self.assertNotIn("ended in flight", self.node.log)

    def test_a_vehicle_that_falls_silent_is_old_and_comes_back(self):
        self.wait(says_all, "a vehicle")
        self.vehicle.stop()
        self.wait(lambda status: status.link_age > 2.5 and status.landed == STATUS.UNKNOWN, "silence")
        answer = self.call("check", srv.CheckAutopilot)
        self.assertFalse(answer.ok)
        self.assertEqual((answer.checks[0].name, answer.checks[0].verdict), ("autopilot link", CHECK.FAIL))
        self.vehicle = Px4Vehicle(f"udpout:{self.url}")
        self.wait(lambda status: status.link_age < 1.5 and status.landed == STATUS.ON_GROUND, "its return")

    def test_a_link_that_cannot_be_is_one_line(self):
        keys = [f"autopilot.{link}.key_file=/no/such/key" for link in ("link", "planner_link")]
        node = OneNode("autopilot", f"{self.space}/bad", keys)
        self.assertEqual(wait_for_end(node.process), 2)
        self.assertEqual(node.log, "autopilot: /no/such/key: No such file or directory; must be a file with the key\n")


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_autopilot")
    rostest.rosrun("amaze_autonomy", "autopilot", TestAutopilot)
