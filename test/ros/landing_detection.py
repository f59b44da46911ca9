#!/usr/bin/env python3
"""The landing detection node over each kind of message: on the ground, flown, low passes, nonsense, landed."""

from __future__ import annotations

import math
import threading
import unittest

import rospy
import rostest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from one_node import OneNode, wait_for, wait_for_service
from sensor_msgs.msg import LaserScan, Range
from std_msgs.msg import Float32

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

MOUNTED_M = 0.1
UNKNOWN, ON_GROUND, AIRBORNE = msg.Landed.UNKNOWN, msg.Landed.ON_GROUND, msg.Landed.AIRBORNE
KINDS = {"range": Range, "scan": LaserScan, "float": Float32, "pose": PoseStamped}


def reading(kind, value):
    if kind == "range":
        return Range(min_range=0.02, max_range=40.0, range=value)
    if kind == "scan":
        return LaserScan(range_min=0.02, range_max=40.0, ranges=[math.inf, value, 41.0, math.nan])
    if kind == "float":
        return Float32(value)
    message = PoseStamped()
    message.pose.position.z = value
    return message


class World:
    """The vehicle as its sensors tell it, 50 times a second, to all nodes."""

    def __init__(self):
        self.value = MOUNTED_M
        self.tilt_rad, self.speed, self.landed, self.talks = 0.0, 0.0, msg.AutopilotStatus.ON_GROUND, True
        self.sensors = {
            kind: rospy.Publisher(f"/{kind}/data", message, queue_size=5) for kind, message in KINDS.items()
        }
        self.status = [
            rospy.Publisher(f"/{kind}/autopilot/status", msg.AutopilotStatus, queue_size=5) for kind in KINDS
        ]
        self.odometry = rospy.Publisher("/odometry", Odometry, queue_size=5)
        self.ended = threading.Event()
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        while not self.ended.wait(0.02):
            for kind, publisher in self.sensors.items() if self.talks else ():
                upright = self.value * (math.cos(self.tilt_rad) if kind == "pose" else 1.0)
                publisher.publish(reading(kind, upright))
            for publisher in self.status:
                publisher.publish(msg.AutopilotStatus(link_age=0.0, landed=self.landed, vertical_speed=self.speed))
            odometry = Odometry()
            odometry.pose.pose.orientation.x = math.sin(self.tilt_rad / 2)
            odometry.pose.pose.orientation.w = math.cos(self.tilt_rad / 2)
            self.odometry.publish(odometry)


class TestLandingDetection(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.world, cls.now, cls.nodes = World(), {}, []
        for kind in KINDS:
            rospy.Subscriber(f"/{kind}/landing_detection/landed", msg.Landed, cls.see, callback_args=kind)
            overrides = [f"sensors.landing_detection.source={kind}", f"sensors.landing_detection.topic=/{kind}/data"]
            cls.nodes.append(OneNode("landing_detection", f"/{kind}", overrides))
        cls.checks = {}
        for kind in KINDS:
            wait_for_service(f"/{kind}/landing_detection/check")
            cls.checks[kind] = rospy.ServiceProxy(f"/{kind}/landing_detection/check", srv.CheckLanded)

    @classmethod
    def see(cls, message, kind):
        cls.now[kind] = message

    @classmethod
    def tearDownClass(cls):
        cls.world.ended.set()
        assert [node.end() for node in cls.nodes] == [0] * len(KINDS)

    def all_at(self, landed, kinds=KINDS):
        return len(self.now) == len(KINDS) and all(self.now[kind].landed == landed for kind in kinds)

    def wait(self, landed, limit_s=6.0, kinds=KINDS):
        try:
            wait_for(lambda: self.all_at(landed, kinds), f"{kinds} at {landed}", limit_s)
        except AssertionError as error:
            raise AssertionError(f"{error}: {self.now}") from None

    def stays(self, landed, time_s):
        """Every message for a time says the same."""
        until = rospy.Time.now() + rospy.Duration(time_s)
        while rospy.Time.now() < until:
            self.assertTrue(self.all_at(landed), self.now)
            rospy.sleep(0.02)

    def fly(self, value, landed=msg.AutopilotStatus.IN_AIR, speed=0.0):
        self.world.value, self.world.landed, self.world.speed = value, landed, speed

    def setUp(self):
        """Stand on the ground; after a flight that takes the dwell."""
        self.world.talks, self.world.tilt_rad = True, 0.0
        self.fly(MOUNTED_M, msg.AutopilotStatus.ON_GROUND)
        self.wait(ON_GROUND)

    def test_on_the_ground_the_check_passes(self):
        self.assertEqual(sorted(self.checks), sorted(KINDS))
        for kind, check in self.checks.items():
            answer = check()
            self.assertTrue(answer.on_ground, (kind, answer))
            self.assertAlmostEqual(answer.distance, 0.0, places=3)
            self.assertEqual([row.name for row in answer.checks], ["range age", "distance to ground"])

    def test_in_the_air_the_check_fails_with_its_height(self):
        self.fly(1.1)
        self.wait(AIRBORNE)
        for check in self.checks.values():
            answer = check()
            self.assertFalse(answer.on_ground)
            self.assertAlmostEqual(answer.distance, 1.0, places=3)
            self.assertEqual(
                answer.checks[1].advice,
                "the feet are 1.00 m above the ground, limit 0.10 m: place the vehicle on the ground",
            )

    def test_a_low_pass_a_bounce_and_a_moving_vehicle_are_no_landing(self):
        self.fly(1.1)
        self.wait(AIRBORNE)
        self.fly(0.15)  # low over the pad, the autopilot flies
        self.stays(AIRBORNE, 2.5)
        self.fly(0.12, msg.AutopilotStatus.ON_GROUND, speed=-0.5)  # near, and still sinking
        self.stays(AIRBORNE, 2.5)
        self.fly(0.12, msg.AutopilotStatus.ON_GROUND)  # touches, and bounces before the dwell is over
        self.stays(AIRBORNE, 1.0)
        self.fly(0.8)
        self.stays(AIRBORNE, 0.5)
        self.fly(MOUNTED_M, msg.AutopilotStatus.ON_GROUND)
        self.wait(ON_GROUND)

    def test_nothing_seen_is_unknown_and_unknown_is_not_on_the_ground(self):
        ranges = [kind for kind in KINDS if kind != "pose"]  # a range of 0 is nothing seen, a height of 0 is the ground
        for nothing, kinds in (
            *((each, KINDS) for each in (math.nan, math.inf, -math.inf, -1.0, 8191.0, 40.0)),
            (0.0, ranges),
        ):
            self.world.value = nothing
            self.wait(UNKNOWN, kinds=kinds)
            for kind in kinds:
                self.assertFalse(self.checks[kind]().on_ground, (kind, nothing))
            self.setUp()

    def test_silence_is_unknown(self):
        self.world.talks = False
        self.wait(UNKNOWN, 1.0)
        self.assertFalse(self.checks["range"]().on_ground)

    def test_what_was_not_heard_yet_comes_by_itself_until_the_node_has_had_the_time_to_start(self):
        for name, startup_s in (("starting", 600.0), ("started", 0.0)):
            node = OneNode(
                "landing_detection",
                f"/{name}",
                ["sensors.landing_detection.topic=/nothing"],
                parameters={"startup_time": startup_s},
            )
            try:
                wait_for_service(f"/{name}/landing_detection/check")
                answer = rospy.ServiceProxy(f"/{name}/landing_detection/check", srv.CheckLanded)()
            finally:
                self.assertEqual(node.end(), 0)
            self.assertEqual([row.verdict for row in answer.checks], [msg.Check.UNKNOWN] * 2)
            self.assertEqual([row.heals for row in answer.checks], [startup_s > 0] * 2)

    def test_a_tilted_range_is_corrected(self):
        self.world.tilt_rad = math.radians(30.0)
        self.fly(2.1 / math.cos(self.world.tilt_rad))
        self.wait(AIRBORNE)
        wait_for(lambda: all(abs(check().distance - 2.0) < 0.02 for check in self.checks.values()), "2 m by all")


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_landing_detection")
    rostest.rosrun("amaze_autonomy", "landing_detection", TestLandingDetection)
