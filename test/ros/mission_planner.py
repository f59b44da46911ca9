#!/usr/bin/env python3
"""The mission planner node with the simulated PX4 over UDP: flown, held, resumed, landed early, taken over, stopped."""

from __future__ import annotations

import math
import os
import signal
import socket
import time
import unittest

import rospy
import rostest
from at_once import at_once
from documented import calls
from hitches import allowed_s
from one_node import OneNode, wait_for, wait_for_end, wait_for_service
from px4_vehicle import MISSIONS, Px4Vehicle, forged
from std_msgs.msg import String
from std_srvs.srv import Trigger

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy
from amaze_autonomy.simulation.ardupilot import ArduCraft, ArduPilot
from amaze_autonomy.simulation.px4 import Craft, Px4

STATUS, COMMAND = msg.MissionStatus, srv.MissionCommandRequest
TAKEOFF, HOLD, RESUME, LAND = COMMAND.TAKEOFF, COMMAND.HOLD, COMMAND.RESUME, COMMAND.LAND


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@at_once(6)
class TestMissionPlanner(unittest.TestCase):
    """Each test has a vehicle and nodes of its own."""

    def setUp(self):
        self.space = f"/{self._testMethodName[:30]}"
        self.statuses, self.session = [], 0
        planner, autopilot = free_port(), free_port()
        self.overrides = [
            f"autopilot.planner_link.url=udpin:127.0.0.1:{planner}",
            f"autopilot.link.url=udpin:127.0.0.1:{autopilot}",
        ]
        kind = (ArduCraft, ArduPilot) if "ardupilot" in self._testMethodName else (Craft, Px4)
        self.vehicle = Px4Vehicle(f"udpout:127.0.0.1:{planner}", f"udpout:127.0.0.1:{autopilot}", kind=kind)
        rospy.Subscriber(f"{self.space}/mission_planner/status", STATUS, self.statuses.append)
        self.planner = OneNode("mission_planner", self.space, self.overrides, missions=MISSIONS)
        self.nodes = [self.planner]
        self.load = self.service("load", srv.LoadMission)
        self.order = self.service("command", srv.MissionCommand)

    def tearDown(self):
        for node in self.nodes:
            if node.process.poll() is None:
                node.process.send_signal(signal.SIGCONT)
                node.process.kill()
                node.process.wait()
        self.vehicle.stop()

    def service(self, name, kind):
        name = f"{self.space}/mission_planner/{name}"
        wait_for_service(name)
        return rospy.ServiceProxy(name, kind)

    # --- in words -------------------------------------------------------------------------------------------------

    @property
    def status(self):
        return self.statuses[-1] if self.statuses else STATUS()

    def wait_phase(self, phase, limit_s=40.0):
        words = lambda: f"phase {phase} (now {self.status}): {self.planner.log}"  # noqa: E731
        wait_for(lambda: self.status.phase == phase, words, limit_s)

    def command(self, action):
        answer = self.order("s1", action)
        self.assertTrue(answer.accepted, answer.message)

    def take_off(self, mission):
        def loaded():
            answer = self.load("s1", mission, 0, 0)
            return answer if answer.accepted else None

        wait_for(lambda: self.statuses and not self.status.message, "a vehicle that speaks")
        answer = wait_for(loaded, "a loaded mission")  # its position takes a moment
        self.assertEqual(answer.waypoints, 4)
        self.assertGreater(answer.estimated_duration, 5.0)
        self.wait_phase(STATUS.LOADED)
        self.command(TAKEOFF)
        self.wait_phase(STATUS.FLYING)

    def assert_flown(self):
        self.wait_phase(STATUS.LANDED)
        self.assertEqual((self.status.waypoint, self.status.waypoints, self.status.session_id), (4, 4, "s1"))
        self.assertFalse(self.vehicle.craft.armed)

    # --- stories --------------------------------------------------------------------------------------------------

    def test_held_and_resumed_it_is_flown_to_the_end(self):
        self.take_off("hop")
        self.assertFalse(math.isnan(self.status.distance_left))
        self.command(HOLD)
        self.wait_phase(STATUS.HOLDING)
        self.command(RESUME)
        self.wait_phase(STATUS.FLYING)
        self.assert_flown()
        ahead_s = time.time() - time.monotonic()
        stamps_s = [status.header.stamp.to_sec() - ahead_s for status in self.statuses]
        for before_s, after_s in zip(stamps_s, stamps_s[1:]):
            self.assertLess(after_s - before_s, allowed_s(0.5, before_s, after_s))  # 5 Hz

    def test_an_ardupilot_is_flown_held_and_landed_as_well(self):
        self.take_off("hop")
        self.command(HOLD)
        self.wait_phase(STATUS.HOLDING)
        self.command(RESUME)
        self.assert_flown()

    def test_started_again_between_two_flights_it_goes_on_with_the_session(self):
        self.take_off("twice")
        self.command(LAND)
        self.wait_phase(STATUS.LANDED)
        self.planner.process.kill()
        self.planner.process.wait()
        self.nodes.append(OneNode("mission_planner", self.space, self.overrides, missions=MISSIONS))
        said = []

        def loaded():
            wait_for_service(f"{self.space}/mission_planner/load")
            said.append(self.load("s1", "twice", 0, 1))
            return said[-1].accepted

        wait_for(loaded, lambda: f"the second flight {said[-1:]}")

    def test_without_gps_it_is_flown_by_set_points(self):
        self.take_off("indoors")
        self.assertEqual(self.vehicle.craft.mode, "OFFBOARD")
        self.command(HOLD)
        self.wait_phase(STATUS.HOLDING)
        self.command(RESUME)
        self.assert_flown()

    def test_landed_early_it_says_so(self):
        self.take_off("hop")
        self.command(LAND)
        self.wait_phase(STATUS.LANDED)
        self.assertLess(self.status.waypoint, 4)

    def test_a_pilot_who_takes_over_is_left_alone(self):
        self.take_off("hop")
        with self.vehicle.lock:
            self.vehicle.craft.pilot_takes_over("POSCTL", 4_000_000_000)
        wait_for(lambda: "the pilot has control" in self.status.message, "the pilot's name in the status")
        for action in (LAND, HOLD, RESUME):
            answer = self.order("s1", action)
            self.assertEqual((answer.accepted, answer.message), (False, "the pilot has control (mode POSCTL)"))
        self.assertEqual(self.vehicle.craft.mode, "POSCTL")

    def test_datagrams_that_say_down_end_no_flight_and_no_landing(self):
        self.take_off("indoors")
        seen = len(self.statuses)
        for _ in range(3):
            self.vehicle.say(*forged("OFFBOARD"))
            time.sleep(0.3)
        self.assertEqual({each.phase for each in self.statuses[seen:]}, {STATUS.FLYING})
        with self.vehicle.lock:
            self.vehicle.craft.flags.ignores = ("AUTO.LAND",)
        self.command(LAND)
        self.vehicle.say(*forged("OFFBOARD"))
        time.sleep(0.6)
        with self.vehicle.lock:
            self.vehicle.craft.flags.ignores = ()
        wait_for(lambda: self.vehicle.craft.mode == "AUTO.LAND", "the landing mode", 5.0)
        self.wait_phase(STATUS.LANDED)
        self.assertEqual(self.vehicle.modes, ["", "OFFBOARD", "AUTO.LAND"])

    def test_told_to_end_in_flight_it_lands(self):
        self.take_off("indoors")
        self.planner.process.send_signal(signal.SIGHUP)
        self.assertEqual(wait_for_end(self.planner.process), 0)
        self.assertIn("ended in flight: the vehicle lands", self.planner.log)
        self.assertEqual(self.vehicle.craft.mode, "AUTO.LAND")

    def test_while_it_hangs_the_autopilot_node_lands(self):
        self.nodes.append(OneNode("autopilot", self.space, self.overrides))
        land = f"{self.space}/autopilot/land"
        wait_for_service(land)
        self.take_off("hop")
        os.kill(self.planner.process.pid, signal.SIGSTOP)
        wait_for(lambda: rospy.ServiceProxy(land, Trigger)().success, "an accepted landing")
        wait_for(lambda: self.vehicle.craft.mode == "AUTO.LAND", "the landing mode")
        wait_for(lambda: not self.vehicle.craft.armed, "the landing")
        os.kill(self.planner.process.pid, signal.SIGCONT)
        self.wait_phase(STATUS.LANDED)  # it knows the present as soon as it is back

    def test_a_landing_by_the_autopilot_node_stands_in_the_planner_as_well(self):
        self.nodes.append(OneNode("autopilot", self.space, self.overrides))
        said, words = [], "the autopilot node commands AUTO.LAND"
        rospy.Subscriber(f"{self.space}/autopilot/commanding", String, lambda message: said.append(message.data))
        land = f"{self.space}/autopilot/land"
        wait_for_service(land)
        self.take_off("hop")
        wait_for(lambda: said and not said[-1], "an autopilot node that commands nothing")
        with self.vehicle.lock:
            self.vehicle.craft.flags.ignores = ("AUTO.LAND",)
        wait_for(lambda: rospy.ServiceProxy(land, Trigger)().success, "an accepted landing")
        wait_for(lambda: words in self.order("s1", HOLD).message, "a hold that is refused")
        self.assertEqual(self.order("s1", RESUME).message, f"{words}: it stands until the vehicle is disarmed")
        with self.vehicle.lock:
            self.vehicle.craft.flags.ignores = ()
        self.wait_phase(STATUS.LANDED)
        wait_for(lambda: not said[-1], "an autopilot node that commands nothing any more")
        self.assertIn("AUTO.LAND", said)

    def test_a_landing_is_taken_of_a_vehicle_that_is_silent_and_repetitions_are_not_logged(self):
        wait_for(lambda: self.statuses and not self.status.message, "a vehicle that speaks")
        self.vehicle.stop()
        wait_for(lambda: self.status.message == "the vehicle is silent", "a silent vehicle")
        for _ in range(6):
            self.assertTrue(self.order("s1", LAND).accepted)
        for _ in range(6):
            self.assertEqual(self.order("s1", HOLD).message, "the vehicle is silent")
        logged = self.planner.log.splitlines()
        self.assertEqual(sum("HOLD: the vehicle is silent" in line for line in logged), 1, logged)
        self.assertEqual(sum("LAND: accepted" in line for line in logged), 1, logged)

    def test_waypoints_of_somebody_who_plans_elsewhere_are_flown_and_checked_as_files_are(self):
        load = self.service("load_waypoints", srv.LoadWaypoints)
        points = [msg.Waypoint(x=x, z=2.0, hold=0.5) for x in (0.0, 1.0, 2.0, 1.0)]

        def answer(mission_id="elsewhere", frame=0, waypoints=points):
            return load("s1", mission_id, frame, waypoints)

        refusals = {
            "is that of a configured mission": answer("hop"),
            "must be 1 to 32 letters": answer("../etc"),
            "frame: is none; must be east_north or start_heading": answer(frame=7),
            "has no waypoints": answer(waypoints=[]),
            ":1: x,y,z,yaw,hold: is (nan": answer(waypoints=[msg.Waypoint(x=math.nan, z=2.0)]),
            ":2: z: is 400; must be at least": answer(waypoints=[points[0], msg.Waypoint(z=400.0)]),
        }
        for words, refused in refusals.items():
            self.assertEqual((refused.accepted, refused.waypoints), (False, 0))
            self.assertIn(words, refused.message)
        wait_for(lambda: self.statuses and not self.status.message, "a vehicle that speaks")
        loaded = wait_for(lambda: answer(frame=1) if answer(frame=1).accepted else None, "loaded waypoints")
        self.assertEqual((loaded.waypoints, loaded.estimated_duration > 5.0), (4, True))
        self.wait_phase(STATUS.LOADED)
        self.assertEqual(self.status.mission_id, "elsewhere")
        self.command(TAKEOFF)
        self.wait_phase(STATUS.FLYING)
        self.assertIn("the vehicle is armed", answer().message)
        self.assert_flown()

    def test_waypoints_are_loaded_and_flown_as_the_documentation_says(self):
        (call,) = [each for each in calls() if each.word == "load_waypoints"]
        wait_for(lambda: self.statuses and not self.status.message, "a vehicle that speaks")
        wait_for(lambda: call.ask(self.space).accepted, "loaded waypoints", period_s=1.0)
        self.wait_phase(STATUS.LOADED)
        given = call.given[0]
        self.assertEqual((self.status.session_id, self.status.mission_id), (given["session_id"], given["mission_id"]))
        self.assertEqual(self.status.waypoints, len(given["waypoints"]))
        (command,) = [each for each in calls() if each.name == "/mission_planner/command"]
        self.assertTrue(command.ask(self.space).accepted)
        self.wait_phase(STATUS.LANDED)
        self.assertEqual(self.status.waypoint, self.status.waypoints)

    def test_requests_that_cannot_be_are_refused_with_the_reason(self):
        answer = self.load("s1", "9", 0, 0)
        self.assertEqual((answer.accepted, answer.message), (False, "there is no mission '9'"))
        answer = self.order("s1", 17)
        self.assertEqual((answer.accepted, answer.message), (False, "there is no command 17"))
        wait_for(lambda: self.status.message != "the vehicle is silent" and self.statuses, "the vehicle")
        answer = self.order("s1", TAKEOFF)
        self.assertEqual(answer.message, "session 's1' is not the one that is loaded")


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_mission_planner")
    rostest.rosrun("amaze_autonomy", "test_mission_planner", TestMissionPlanner)
