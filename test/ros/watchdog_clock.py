#!/usr/bin/env python3
"""The watchdog on simulated time: twice as fast as real, jumping back as a bag does that is played again."""

from __future__ import annotations

import threading
import time
import unittest
from statistics import median

import rospy
import rostest
from hitches import PATIENCE
from one_node import OneNode, wait_for, wait_for_service
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

SENSORS = """
components:
  imu:
    group: other
    severity: high
    wait_limit_s: 5.0
    topics:
      /imu: {rate_hz: 50.0, age_limit_s: 0.5, tolerance_fraction: 0.4, stamp_tolerance_s: 0.5}
landing_detection: {topic: /range}
state_estimation: {topic: /odometry, imu_topic: /imu}
"""
MISSIONS = """
missions:
  "1":
    description: nothing in particular
    files: [trajectories/hop.csv]
"""
SPEED = 2.0
STEP_S = 0.01  # of simulated time
START_S = 1000.0


class Time:
    """Publishes /clock, and an IMU at 50 Hz of that time."""

    def __init__(self):
        self.now_s, self.sends = START_S, True
        self.clock = rospy.Publisher("/clock", Clock, queue_size=10)
        self.imu = rospy.Publisher("/imu", Imu, queue_size=10)
        self.ended = threading.Event()
        threading.Thread(target=self.run, daemon=True).start()

    def run(self):
        due_s, number = time.monotonic(), 0
        while not self.ended.is_set():
            self.now_s += STEP_S
            number += 1
            stamp = rospy.Time.from_sec(self.now_s)
            self.clock.publish(Clock(stamp))
            if self.sends and number % 2 == 0:
                message = Imu()
                message.header.stamp = stamp
                self.imu.publish(message)
            due_s += STEP_S / SPEED
            time.sleep(max(0.0, due_s - time.monotonic()))


class TestWatchdogClock(unittest.TestCase):
    def test_it_lives_on_simulated_time_and_survives_a_jump_back(self):
        world, actions = Time(), []
        rospy.Subscriber("watchdog/action", msg.WatchdogAction, actions.append, tcp_nodelay=True)
        node = OneNode("watchdog", sensors=SENSORS, missions=MISSIONS)
        wait_for_service("watchdog/start")
        answer = rospy.ServiceProxy("watchdog/start", srv.StartWatchdog)(startup_time=15.0, mission_id="1")
        self.assertTrue(answer.ready, answer)

        def quiet(count):
            """A number of heartbeats come, and none has an issue."""
            before = len(actions)
            wait_for(lambda: len(actions) >= before + count, f"{count} heartbeats", 10.0)
            self.assertEqual([each.code for each in actions[before:]], [1] * len(actions[before:]))
            return actions[before:]

        beats = quiet(10)
        gaps = [(after.header.stamp - before.header.stamp).to_sec() for before, after in zip(beats, beats[1:])]
        self.assertTrue(0.15 < median(gaps) < 0.25, gaps)  # one may be late where others want the processor
        world.now_s -= 500.0
        beats = quiet(10)
        self.assertLess(beats[-1].header.stamp.to_sec(), START_S)
        self.assertGreater(beats[-1].loop_counter, beats[0].loop_counter)
        world.sends, stopped_s = False, world.now_s
        failed = wait_for(lambda: next((each for each in actions if each.code == 8), None), "silence is seen", 10.0)
        delay_s = failed.header.stamp.to_sec() - stopped_s
        self.assertTrue(0.45 < delay_s < 0.5 + 0.1 * PATIENCE, delay_s)
        self.assertEqual(failed.components[0].reason, "no message on /imu for longer than 0.5 s")
        world.sends = True
        wait_for(lambda: actions[-1].code == 1, "it is back", 10.0)
        self.assertEqual(node.end(), 0)
        world.ended.set()


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_watchdog_clock")
    rostest.rosrun("amaze_autonomy", "watchdog_clock", TestWatchdogClock)
