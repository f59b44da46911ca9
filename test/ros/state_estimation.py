#!/usr/bin/env python3
"""The state estimation node over each kind of estimate: valid at rest; every way of not being so has its row."""

from __future__ import annotations

import math
import threading
import unittest

import rospy
import rostest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from one_node import OneNode, wait_for, wait_for_service
from sensor_msgs.msg import Imu
from std_msgs.msg import String
from std_srvs.srv import Empty, EmptyResponse, SetBool, SetBoolResponse, Trigger, TriggerResponse

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

G = 9.80665
KINDS = {"odometry": Odometry, "pose": PoseStamped, "pose_with_covariance": PoseWithCovarianceStamped}


class World:
    """The vehicle as estimator and IMU tell it."""

    def __init__(self):
        self.reset()
        self.estimates = {
            kind: rospy.Publisher(f"/{kind}/data", message, queue_size=5) for kind, message in KINDS.items()
        }
        self.imu = rospy.Publisher("/imu", Imu, queue_size=5)
        self.ended = threading.Event()
        threading.Thread(target=self.run, daemon=True).start()

    def reset(self):
        self.roll_rad = self.imu_roll_rad = self.x = self.drift = 0.0
        self.g, self.talks, self.norm, self.age_s = G, True, 1.0, 0.0

    def run(self):
        number = 0
        while not self.ended.wait(1 / 30):
            number += 1
            self.x += self.drift / 30
            for kind, publisher in self.estimates.items() if self.talks else ():
                publisher.publish(self.estimate(kind))
            for _ in range(2):
                imu = Imu()
                imu.linear_acceleration.y = self.g * math.sin(self.imu_roll_rad)
                imu.linear_acceleration.z = self.g * math.cos(self.imu_roll_rad)
                self.imu.publish(imu)

    def estimate(self, kind):
        message = KINDS.get(kind, Odometry)()
        message.header.stamp = rospy.Time.now() - rospy.Duration(self.age_s)
        pose = message.pose if kind == "pose" else message.pose.pose
        pose.position.x = self.x
        pose.orientation.x = self.norm * math.sin(self.roll_rad / 2)
        pose.orientation.w = self.norm * math.cos(self.roll_rad / 2)
        if kind != "pose":
            message.pose.covariance = [0.0025 if row == column else 0.0 for row in range(6) for column in range(6)]
        return message


class Estimator:
    """One that is silent until it is told to begin; it refuses the first time."""

    def __init__(self, world):
        self.calls = []
        self.world = world
        self.world.estimates["odometry_when_told"] = self
        self.publisher = rospy.Publisher("/told/data", Odometry, queue_size=5)
        self.status = rospy.Publisher("/told/autopilot/status", msg.AutopilotStatus, queue_size=5)
        self.state = rospy.Publisher("/told/autonomy/state_name", String, queue_size=5)
        rospy.Service("/told/estimator/initialise", SetBool, self.begin)
        rospy.Service("/told/second/initialise", Empty, self.second)
        self.always_calls = 0
        self.always_status = rospy.Publisher("/always/autopilot/status", msg.AutopilotStatus, queue_size=5)
        self.always_state = rospy.Publisher("/always/autonomy/state_name", String, queue_size=5)
        rospy.Service("/always/estimator/initialise", Trigger, self.begin_always)

    def begin(self, request):
        self.calls.append(request.data)
        return SetBoolResponse(success=len(self.calls) > 1, message="no GPS yet")

    def second(self, _):
        self.calls.append("in flight")
        return EmptyResponse()

    def begin_always(self, _):
        self.always_calls += 1
        return TriggerResponse(success=True)

    def publish(self, message):
        if self.calls.count(True) > 1:
            self.publisher.publish(message)

    def fly(self, *states, armed=False):
        self.status.publish(msg.AutopilotStatus(armed_known=True, armed=armed))
        for state in states:
            self.state.publish(String(data=state))


class TestStateEstimation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.world, cls.nodes, cls.checks = World(), [], {}
        for kind in KINDS:
            overrides = [
                f"sensors.state_estimation.source={kind}",
                f"sensors.state_estimation.topic=/{kind}/data",
                "sensors.state_estimation.imu_topic=/imu",
            ]
            cls.nodes.append(OneNode("state_estimation", f"/{kind}", overrides))
        overrides = [
            "sensors.state_estimation.topic=/told/data",
            "sensors.state_estimation.imu_topic=/imu",
            "sensors.initialisation.service=/told/estimator/initialise",
            "sensors.initialisation.type=set_bool",
            "sensors.initialisation.in_flight_service=/told/second/initialise",
            "sensors.initialisation.in_flight_type=empty",
        ]
        cls.estimator = Estimator(cls.world)
        cls.nodes.append(OneNode("state_estimation", "/told", overrides, parameters={"startup_time": 0.0}))
        overrides = [
            "sensors.state_estimation.topic=/odometry/data",
            "sensors.state_estimation.imu_topic=/imu",
            "sensors.initialisation.service=/always/estimator/initialise",
            "sensors.initialisation.always=true",
        ]
        cls.nodes.append(OneNode("state_estimation", "/always", overrides, parameters={"startup_time": 0.0}))
        overrides = [
            "sensors.state_estimation.topic=/simulated/odometry",
            "sensors.state_estimation.imu_topic=/simulated/imu",
            "sensors.initialisation.service=/simulated/estimator/initialise",
            "sensors.initialisation.type=set_bool",
        ]
        cls.begun = []
        rospy.Subscriber("/simulated/odometry", Odometry, cls.begun.append)
        for name, parameters in (
            ("simulation", {"peers": "autopilot,mission_planner"}),
            ("state_estimation", {"startup_time": 0.0}),
        ):
            cls.nodes.append(OneNode(name, "/simulated", overrides, parameters=parameters))
        for kind in KINDS:
            wait_for_service(f"/{kind}/state_estimation/check")
            cls.checks[kind] = rospy.ServiceProxy(f"/{kind}/state_estimation/check", srv.CheckState)

    @classmethod
    def tearDownClass(cls):
        cls.world.ended.set()
        assert [node.end() for node in cls.nodes] == [0] * len(cls.nodes)

    def setUp(self):
        self.world.reset()
        try:
            wait_for(lambda: all(check().valid for check in self.checks.values()), "valid by all")
        except AssertionError as error:
            raise AssertionError(f"{error}: {[check() for check in self.checks.values()]}") from None

    def failed(self, row, words=""):
        """Wait until all nodes have a row that did not pass, with these words; return the row of each."""

        def bad(each):
            return each is not None and each.verdict in (msg.Check.FAIL, msg.Check.UNKNOWN) and words in each.advice

        def rows():
            found = [
                next((each for each in check().checks if each.name == row), None) for check in self.checks.values()
            ]
            return found if all(bad(each) for each in found) else None

        found = wait_for(rows, f"{row} fails: {words}")
        self.assertEqual([check().valid for check in self.checks.values()], [False] * len(KINDS))
        return found

    def test_at_rest_the_states_are_valid_and_gravity_points_down(self):
        self.assertEqual(sorted(self.checks), sorted(KINDS))
        for kind, check in self.checks.items():
            expected = ["position deviation", "orientation deviation"] if kind == "pose" else []

            def at_rest(check=check, expected=expected):  # on a busy computer the rate is another one for a moment
                answer = check()
                warned = [row.name for row in answer.checks if row.verdict == msg.Check.WARN]
                return answer if warned == expected else None

            answer = wait_for(at_rest, f"{kind} warns of {expected} alone")
            self.assertAlmostEqual(answer.gravity.z, -G, places=3)
            self.assertAlmostEqual(answer.tilt, 0.0, places=3)
            bad = [row.name for row in answer.checks if row.verdict not in (msg.Check.PASS, msg.Check.WARN)]
            self.assertEqual(bad, [])

    def test_a_tilted_vehicle_is_told_where_to(self):
        self.world.roll_rad, self.world.imu_roll_rad = -math.radians(14.0), -math.radians(14.0)
        for row in self.failed("tilt", "vehicle is tilted 14 deg to the left, limit 10 deg"):
            self.assertAlmostEqual(math.degrees(row.value), 14.0, delta=0.6)
        self.failed("estimated tilt")

    def test_an_imu_in_units_of_g_is_recognised(self):
        self.world.g = 1.0
        self.failed("gravity magnitude", "it looks like g: the driver must publish m/s^2")

    def test_estimate_and_imu_must_agree(self):
        self.world.roll_rad = math.radians(8.0)
        self.failed("tilt agreement")

    def test_numbers_that_are_none_fail(self):
        self.world.x = math.nan
        self.failed("estimate finite")

    def test_a_quaternion_that_is_none_fails(self):
        self.world.norm = 0.9
        self.failed("quaternion norm")

    def test_a_drifting_estimate_fails(self):
        self.world.drift = 0.2
        self.failed("estimate drift")

    def test_silence_fails(self):
        self.world.talks = False
        self.failed("estimate age")

    def test_an_old_stamp_fails_though_messages_come(self):
        self.world.age_s = 2.0
        self.failed("estimate age")

    def test_an_estimator_that_must_be_told_to_begin_is_told_on_the_ground_once_a_check_and_in_flight(self):
        wait_for_service("/told/state_estimation/check")
        check = rospy.ServiceProxy("/told/state_estimation/check", srv.CheckState)
        row = "estimator initialisation"

        def said(words, **flown):
            self.estimator.fly(**flown)
            rows = {each.name: each for each in check().checks}
            return row in rows and words in rows[row].advice and rows[row]

        wait_for(lambda: said("the vehicle is armed", armed=True), "armed: refused")
        self.assertEqual(self.estimator.calls, [])
        refused = wait_for(lambda: said("/told/estimator/initialise: no GPS yet"), "its refusal")
        self.assertEqual((refused.verdict, self.estimator.calls), (msg.Check.FAIL, [True]))
        wait_for(lambda: (said(""), check().valid)[1], "valid")
        self.assertEqual(self.estimator.calls, [True, True])
        wait_for(
            lambda: (self.estimator.fly("TAKEOFF", "MISSION", "HOLD", "MISSION"), self.estimator.calls[2:])[1],
            "in flight",
        )
        self.assertEqual(self.estimator.calls[2], "in flight")

    def test_the_simulated_estimator_is_silent_until_it_is_told_to_begin(self):
        wait_for_service("/simulated/state_estimation/check")
        wait_for_service("/simulated/estimator/initialise")
        check = rospy.ServiceProxy("/simulated/state_estimation/check", srv.CheckState)
        self.assertEqual(self.begun, [])
        wait_for(lambda: check().valid, "valid states", period_s=0.2)
        self.assertNotEqual(self.begun, [])

    def test_an_estimator_whose_states_are_valid_is_told_to_begin_anew_once_in_each_pre_flight(self):
        wait_for_service("/always/state_estimation/check")
        check = rospy.ServiceProxy("/always/state_estimation/check", srv.CheckState)
        begun = []

        def valid():
            self.estimator.always_status.publish(msg.AutopilotStatus(armed_known=True, armed=False))
            answer = check()
            begun.append((self.estimator.always_calls, answer.valid))
            return answer.valid

        for told in (1, 2):
            wait_for(valid, f"valid after initialisation {told}")
            check()
            self.assertEqual(self.estimator.always_calls, told, "once")
            for state in ("OUTREACH", "PREFLIGHT"):
                self.estimator.always_state.publish(String(data=state))
            wait_for(lambda: not check().valid, "a retry begins anew")
        self.assertNotIn((0, True), begun)


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_state_estimation")
    rostest.rosrun("amaze_autonomy", "state_estimation", TestStateEstimation)
