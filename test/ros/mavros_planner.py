#!/usr/bin/env python3
"""The mission planner node through mavros, of a PX4 and of an ArduPilot: sent, compared, flown, held, landed."""

from __future__ import annotations

import sys
import tempfile
import unittest
from pathlib import Path

import rospy
import rostest
from at_once import at_once
from mavros_definitions import install
from mavros_vehicle import MavrosVehicle
from one_node import OneNode, wait_for, wait_for_service
from px4_vehicle import MISSIONS, QUICK

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

FOLDER = Path(tempfile.mkdtemp(prefix="amaze_mavros_"))
PATH = install(FOLDER)
sys.path[:0] = PATH.split(":")
from mavros_msgs import msg as messages  # noqa: E402
from mavros_msgs import srv as services  # noqa: E402

STATUS, COMMAND = msg.MissionStatus, srv.MissionCommandRequest


@at_once(4)
class TestMavrosPlanner(unittest.TestCase):
    def setUp(self):
        self.space, self.statuses = f"/{self._testMethodName[:34]}", []
        self.vehicle = MavrosVehicle(
            f"{self.space}/mavros", QUICK, messages, services, ardupilot="ardupilot" in self._testMethodName
        )
        rospy.Subscriber(f"{self.space}/mission_planner/status", STATUS, self.statuses.append)
        overrides = ["autopilot.backend=mavros", f"autopilot.mavros={self.space}/mavros"]
        self.node = OneNode("mission_planner", self.space, overrides, missions=MISSIONS, modules=PATH)
        self.load = self.service("load", srv.LoadMission)
        self.order = self.service("command", srv.MissionCommand)

    def tearDown(self):
        self.node.process.kill()
        self.node.process.wait()
        self.vehicle.stop()

    def service(self, name, kind):
        name = f"{self.space}/mission_planner/{name}"
        wait_for_service(name)
        return rospy.ServiceProxy(name, kind)

    def wait_phase(self, phase, limit_s=40.0):
        words = lambda: f"phase {phase}: {self.statuses[-1:]} {self.vehicle.called} {self.node.log}"  # noqa: E731
        wait_for(lambda: self.statuses and self.statuses[-1].phase == phase, words, limit_s)

    def command(self, action):
        answer = self.order("s1", action)
        self.assertTrue(answer.accepted, answer.message)

    def take_off(self, mission):
        wait_for(lambda: self.statuses and not self.statuses[-1].message, "a vehicle that speaks")
        self.accepted(lambda: self.load("s1", mission, 0, 0))
        self.wait_phase(STATUS.LOADED)
        self.accepted(lambda: self.order("s1", COMMAND.TAKEOFF))
        self.wait_phase(STATUS.FLYING)

    def accepted(self, ask):
        """Ask again until it is: a position takes a moment, and on a busy computer the last one may be old."""
        said = []

        def asked():
            said.append(ask())
            return said[-1].accepted

        wait_for(asked, lambda: f"what is asked is accepted: {said[-1:]} {self.node.log}")

    def test_a_mission_is_sent_compared_flown_held_resumed_and_landed(self):
        self.vehicle.spoils = 1
        self.take_off("hop")
        transfers = [name for name in self.vehicle.called if name in ("push", "pull")]
        # the first came back changed; it is read once more before the takeoff
        self.assertEqual(transfers, [*["push", "pull"] * 2, "pull"])
        self.command(COMMAND.HOLD)
        self.wait_phase(STATUS.HOLDING)
        self.command(COMMAND.RESUME)
        self.wait_phase(STATUS.FLYING)
        self.wait_phase(STATUS.LANDED)
        self.assertEqual((self.statuses[-1].waypoint, self.statuses[-1].waypoints), (4, 4))
        self.assertFalse(self.vehicle.craft.armed)

    def test_by_set_points_it_is_flown_and_landed_early(self):
        self.take_off("indoors")
        self.assertEqual(self.vehicle.craft.mode, "OFFBOARD")
        self.command(COMMAND.LAND)
        self.wait_phase(STATUS.LANDED)
        self.assertLess(self.statuses[-1].waypoint, 4)

    def test_an_ardupilot_s_mission_is_sent_compared_flown_held_resumed_and_landed(self):
        self.vehicle.spoils = 1
        self.take_off("hop")
        transfers = [name for name in self.vehicle.called if name in ("push", "pull")]
        self.assertEqual(transfers, [*["push", "pull"] * 2, "pull"])
        self.command(COMMAND.HOLD)
        self.wait_phase(STATUS.HOLDING)
        self.assertEqual([name for name in self.vehicle.called if name != "pull"][-1], "BRAKE")  # it is read in a hold
        self.command(COMMAND.RESUME)
        self.wait_phase(STATUS.LANDED)
        self.assertEqual((self.statuses[-1].waypoint, self.statuses[-1].waypoints), (4, 4))
        self.assertFalse(self.vehicle.craft.armed)
        self.assertLess({"GUIDED", "BRAKE", "AUTO"}, {*self.vehicle.called})

    def test_an_ardupilot_whose_pilot_switches_to_loiter_is_left_alone(self):
        self.take_off("hop")
        with self.vehicle.lock:
            self.vehicle.craft.pilot_takes_over("POSCTL", 4_000_000_000)
        wait_for(lambda: "the pilot has control" in self.statuses[-1].message, lambda: f"a pilot: {self.statuses[-1:]}")
        asked = list(self.vehicle.called)
        for action in (COMMAND.LAND, COMMAND.HOLD, COMMAND.RESUME):
            answer = self.order("s1", action)
            self.assertEqual((answer.accepted, answer.message), (False, "the pilot has control (mode POSCTL)"))
        self.assertEqual((self.vehicle.craft.mode, self.vehicle.called), ("POSCTL", asked))

    def test_an_ardupilot_by_set_points_is_landed_early(self):
        self.take_off("indoors")
        self.assertEqual(self.vehicle.craft.mode, "OFFBOARD")
        self.command(COMMAND.LAND)
        self.wait_phase(STATUS.LANDED)
        self.assertEqual([name for name in self.vehicle.called if name == "LAND"][:1], ["LAND"])
        self.assertLess(self.statuses[-1].waypoint, 4)


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_mavros_planner")
    rostest.rosrun("amaze_autonomy", "mavros_planner", TestMavrosPlanner)
