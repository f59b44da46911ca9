#!/usr/bin/env python3
"""The watchdog over real processes under roslaunch: killed, stopped, slowed, frozen, talking nonsense, coming back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from hitches import allowed_s
from one_node import OneNode, wait_for, wait_for_service
from std_msgs.msg import String

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

FILE = "/tmp/amaze_watchdog_test_driver"
SENSORS = f"""
components:
  fast:
    group: other
    severity: high
    wait_limit_s: 20.0
    node: /fast
    topics:
      /fast/data: {{rate_hz: 200.0, age_limit_s: 0.3, tolerance_fraction: 0.3, finite: true, stamp_tolerance_s: 0.5}}
    restart: {{policy: node, attempts: 3, backoff_s: 0.5, attempt_limit_s: 5.0, forget_after_s: 0.2}}
  camera:
    group: other
    severity: moderate
    wait_limit_s: 20.0
    node: /camera
    topics:
      /camera/data: {{rate_hz: 30.0, age_limit_s: 0.3, tolerance_fraction: 0.3, unchanged_limit_s: 1.0}}
    restart: {{policy: node, attempts: 3, backoff_s: 0.5, attempt_limit_s: 5.0, forget_after_s: 0.2}}
  slow:
    group: other
    severity: low
    node: /slow
    topics:
      /slow/data: {{rate_hz: 1.0, age_limit_s: 3.0}}
  lost:
    group: other
    severity: high
    wait_limit_s: 20.0
    node: /lost
    restart: {{policy: node, attempts: 2, backoff_s: 0.2, attempt_limit_s: 0.8, total_limit_s: 3.0}}
  disk:
    group: other
    severity: moderate
    wait_limit_s: 5.0
    driver: [test, -e, {FILE}]
    restart: {{policy: command, command: [touch, {FILE}], attempts: 2, attempt_limit_s: 3.0, total_limit_s: 9.0}}
  imu:
    group: px4
    severity: highest
    autopilot: imu
polling: {{driver_period_s: 0.5, driver_run_limit_s: 0.4, driver_age_limit_s: 2.0}}
landing_detection: {{topic: /range}}
state_estimation: {{topic: /odometry, imu_topic: /fast/data}}
"""
MISSIONS = """
missions:
  "1":
    description: nothing in particular
    files: [trajectories/hop.csv]
  "low":
    description: the fast sensor hardly matters
    files: [trajectories/hop.csv]
    severities: {fast: low}
    required: [camera]
"""
STRANGER = """
import sys, rospy
from std_msgs.msg import String
rospy.init_node("stranger")
said, rate = rospy.Publisher(sys.argv[1], String, queue_size=1), rospy.Rate(20)
while not rospy.is_shutdown():
    said.publish("x" * 7)
    rate.sleep()
"""
NOMINAL, NON_CRITICAL, INCONVENIENT, HOLD, ABORT = 1, 2, 4, 8, 16
NONE, TRYING, GIVEN_UP = 0, 1, 2


class Listener:
    """What the watchdog says, and when the last message of each sensor came."""

    def __init__(self):
        self.actions, self.infos, self.last_s = [], [], {}
        self.diagnostics = []
        rospy.Subscriber("watchdog/action", msg.WatchdogAction, self.see_action, tcp_nodelay=True)
        rospy.Subscriber("watchdog/info", msg.WatchdogInfo, lambda each: self.infos.append((time.monotonic(), each)))
        rospy.Subscriber("/diagnostics", DiagnosticArray, self.diagnostics.append)
        for name in ("fast", "camera", "slow"):
            rospy.Subscriber(f"/{name}/data", rospy.AnyMsg, self.note, callback_args=name, tcp_nodelay=True)

    def see_action(self, message):
        self.actions.append((time.monotonic(), message))

    def note(self, _, name):
        self.last_s[name] = time.monotonic()

    def now(self, name):
        """What the last info says of a component."""
        if not self.infos:
            return None
        return next(each for each in self.infos[-1][1].components if each.name == name)

    def told(self, name, code, after_s):
        """Whether an info after a time had a component at a code."""
        infos = [info for at_s, info in list(self.infos) if at_s > after_s]
        return any((each.name, each.code) == (name, code) for info in infos for each in info.components)

    def first(self, name, code, after_s, restart=None):
        """The first action after a time that has a component at a code: (when, the component)."""
        for at_s, action in list(self.actions):
            for each in action.components if at_s > after_s else ():
                if each.name == name and each.code == code and restart in (None, each.restart):
                    return at_s, each
        return None


class TestWatchdog(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        Path(FILE).touch()
        cls.healthy = msg.AutopilotStatus.SENSOR_HEALTHY
        cls.imu = cls.healthy
        cls.ended = threading.Event()
        cls.status = rospy.Publisher("autopilot/status", msg.AutopilotStatus, queue_size=5)
        threading.Thread(target=cls.autopilot, daemon=True).start()
        cls.modes = {
            name: rospy.Publisher(f"/{name}/mode", String, queue_size=5) for name in ("fast", "camera", "slow")
        }
        cls.listener = Listener()
        cls.node = OneNode("watchdog", sensors=SENSORS, missions=MISSIONS)
        wait_for_service("watchdog/start")
        cls.start = rospy.ServiceProxy("watchdog/start", srv.StartWatchdog)
        began_s = time.monotonic()
        cls.answer = cls.start(startup_time=15.0, mission_id="1")
        cls.took_s = time.monotonic() - began_s

    @classmethod
    def tearDownClass(cls):
        cls.ended.set()
        Path(FILE).unlink()
        assert cls.node.end() == 0

    @classmethod
    def autopilot(cls):
        while not cls.ended.wait(0.1):
            cls.status.publish(msg.AutopilotStatus(link_age=0.0, imu=cls.imu))

    def setUp(self):
        self.wait_nominal()

    def wait_nominal(self, but=()):
        names = [
            name for name in ("fast", "camera", "slow", "disk", "imu", "lost") if name not in but and name not in gone
        ]
        try:
            wait_for(
                lambda: self.listener.infos and all(self.listener.now(name).code == NOMINAL for name in names),
                f"{names} nominal",
                30.0,
            )
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.listener.infos[-1]}\n{self.node.log}") from None

    def pid(self, node):
        uri = ServerProxy(rosgraph.get_master_uri()).lookupNode("/test", node)[2]
        return ServerProxy(uri).getPid("/test")[2]

    def set_mode(self, name, mode):
        wait_for(lambda: self.modes[name].get_num_connections(), f"{name} listens")
        self.modes[name].publish(mode)
        return time.monotonic()

    def failed(self, name, code, after_s, restart=None, limit_s=10.0):
        """Wait until the action says so, and the info too: what is nominal again is read from the info."""
        try:
            found = wait_for(lambda: self.listener.first(name, code, after_s, restart), f"{name} at {code}", limit_s)
            wait_for(lambda: self.listener.told(name, code, after_s), f"info of {name} at {code}", limit_s)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.node.log}") from None
        return found

    def test_01_the_first_take_off_check_waits_until_everything_has_come_up(self):
        self.assertTrue(self.answer.ready, self.answer.message)
        self.assertEqual(
            [each.name for each in self.answer.components], ["fast", "camera", "slow", "lost", "disk", "imu"]
        )
        self.assertEqual([each.code for each in self.answer.components], [NOMINAL] * 6)
        self.assertEqual([row.verdict for row in self.answer.checks], [msg.Check.PASS] * 6)
        self.assertLess(self.took_s, 15.0, "it answers when they are there, not at the end of its time")

    def test_02_the_heartbeat_comes_at_5_hz_from_the_loop_that_watches(self):
        count = len(self.listener.actions)
        wait_for(lambda: len(self.listener.actions) >= count + 6, "six heartbeats", 5.0)
        beats = self.listener.actions[count : count + 6]
        for (before_s, _), (after_s, _) in zip(beats, beats[1:]):
            self.assertLess(abs(after_s - before_s - 0.2), allowed_s(0.1, before_s - 0.2, after_s))
        for (_, before), (_, after) in zip(beats, beats[1:]):
            self.assertEqual(after.sequence, before.sequence + 1)
            self.assertGreater(after.loop_counter, before.loop_counter)
            self.assertEqual((after.code, after.components), (NOMINAL, []))

    def test_03_later_checks_are_answered_at_once_and_know_the_mission(self):
        began_s = time.monotonic()
        answer = self.start(startup_time=15.0, mission_id="low", required=["camera"])
        self.assertLess(time.monotonic() - began_s, allowed_s(0.5, began_s))
        self.assertTrue(answer.ready)
        stopped_s = self.set_mode("fast", "silent")
        wait_for(lambda: self.listener.now("fast").code == NON_CRITICAL, "fast at 2, as the mission wants it")
        self.assertIsNone(self.listener.first("fast", HOLD, stopped_s))
        self.wait_nominal()  # it was restarted nevertheless
        unknown = self.start(startup_time=1.0, mission_id="", required=["nobody"])
        self.assertFalse(unknown.ready)
        self.assertIn("nobody", unknown.message)
        self.assertTrue(self.start(startup_time=15.0, mission_id="1").ready)

    def test_04_a_killed_node_is_seen_and_comes_back_by_roslaunch(self):
        before = self.pid("/fast")
        os.kill(before, signal.SIGKILL)
        killed_s = time.monotonic()
        at_s, component = self.failed("fast", HOLD, killed_s)
        self.assertLess(at_s - killed_s, allowed_s(0.3 + 0.05 + 0.05, killed_s, at_s))
        self.assertEqual(component.restart, TRYING)
        self.wait_nominal()
        self.assertNotEqual(self.pid("/fast"), before)

    def test_05_a_stopped_node_is_seen_killed_and_started_again(self):
        before = self.pid("/camera")
        os.kill(before, signal.SIGSTOP)
        at_s, component = self.failed("camera", INCONVENIENT, time.monotonic())
        last_s = self.listener.last_s["camera"]
        self.assertLess(at_s - last_s, allowed_s(0.3 + 0.05, last_s, at_s))
        self.assertEqual(component.reason, "no message on /camera/data for longer than 0.3 s")
        self.wait_nominal()
        self.assertNotEqual(self.pid("/camera"), before)
        self.assertFalse(Path(f"/proc/{before}").exists())

    def test_06_a_stopped_node_without_a_topic_of_interest_is_seen_by_its_silence(self):
        pid = self.pid("/slow")
        os.kill(pid, signal.SIGSTOP)
        stopped_s = time.monotonic()
        wait_for(lambda: self.listener.now("slow").code == NON_CRITICAL, "slow at 2")
        self.assertIn("node /slow: no answer for longer than 1.5 s", self.listener.now("slow").reason)
        self.assertLess(time.monotonic() - stopped_s, allowed_s(1.5 + 0.5 + 0.3, stopped_s))
        os.kill(pid, signal.SIGCONT)

    def test_07_half_and_double_the_rate_are_not_critical(self):
        half_s = self.set_mode("camera", "half")
        wait_for(lambda: self.listener.now("camera").code == NON_CRITICAL, "camera at 2")
        self.assertIn("too slow, expected 30 Hz", self.listener.now("camera").reason)
        self.assertIsNone(self.listener.first("camera", INCONVENIENT, half_s))
        self.set_mode("camera", "good")
        self.wait_nominal()
        self.set_mode("camera", "fast")
        wait_for(lambda: "too fast" in self.listener.now("camera").reason, "camera too fast")
        self.set_mode("camera", "good")

    def test_08_a_picture_that_never_changes_is_a_failure(self):
        frozen_s = self.set_mode("camera", "freeze")
        at_s, component = self.failed("camera", INCONVENIENT, frozen_s)
        self.assertEqual(component.reason, "the content of /camera/data has not changed for longer than 1 s")
        self.assertLess(at_s - frozen_s, allowed_s(1.0 + 0.2, frozen_s, at_s))
        self.wait_nominal()  # restarted, it works again

    def test_09_numbers_that_are_none_are_a_failure(self):
        nan_s = self.set_mode("fast", "nan")
        at_s, component = self.failed("fast", HOLD, nan_s)
        self.assertEqual(component.reason, "nothing but NaN or infinity on /fast/data for longer than 0.3 s")
        self.assertLess(at_s - nan_s, allowed_s(0.3 + 0.1, nan_s, at_s))

    def test_10_a_silent_topic_is_seen_within_its_limit(self):
        for name, code in (("fast", HOLD), ("camera", INCONVENIENT)):
            stopped_s = self.set_mode(name, "silent")
            at_s, _ = self.failed(name, code, stopped_s)
            last_s = self.listener.last_s[name]
            self.assertGreater(at_s - last_s, 0.3 - allowed_s(0.01, last_s - 0.1, last_s))
            self.assertLess(at_s - last_s, allowed_s(0.3 + 0.05, last_s, at_s))
            self.wait_nominal()

    def test_11_the_autopilots_word_counts_and_nothing_of_the_px4_is_restarted(self):
        type(self).imu = msg.AutopilotStatus.SENSOR_FAILED
        _, component = self.failed("imu", ABORT, 0.0)
        self.assertEqual(component.restart, NONE)
        self.assertEqual(component.reason, "the autopilot's imu: the autopilot says that it has failed")
        type(self).imu = self.healthy

    def test_12_a_driver_is_looked_at_and_restarted_by_its_command(self):
        Path(FILE).unlink()
        removed_s = time.monotonic()
        at_s, component = self.failed("disk", INCONVENIENT, removed_s)
        self.assertEqual(component.reason, "driver check test: test ended with status 1")
        self.assertLess(at_s - removed_s, allowed_s(1.0, removed_s, at_s))
        self.wait_nominal()
        self.assertTrue(Path(FILE).exists())

    def test_13_what_waited_while_the_watchdog_did_not_run_is_no_silence(self):
        self.node.process.send_signal(signal.SIGSTOP)
        stopped_s = time.monotonic()
        time.sleep(2.0)
        self.assertLess(
            self.listener.actions[-1][0] - stopped_s, allowed_s(0.25, stopped_s), "a stopped watchdog has no heartbeat"
        )
        self.node.process.send_signal(signal.SIGCONT)
        count = len(self.listener.actions)
        wait_for(lambda: len(self.listener.actions) >= count + 5, "five heartbeats", 5.0)
        self.assertEqual(
            [each.code for _, each in self.listener.actions[count:]], [NOMINAL] * len(self.listener.actions[count:])
        )

    def test_14_another_publishers_message_ends_nothing_and_is_named(self):
        stranger = subprocess.Popen([sys.executable, "-c", STRANGER, rospy.resolve_name("autopilot/status")])
        try:
            wait_for(lambda: "/stranger says there is not read: std_msgs/String" in self.node.log, "the word", 30.0)
            count = len(self.listener.actions)
            wait_for(lambda: len(self.listener.actions) >= count + 10, "ten heartbeats")
        finally:
            stranger.kill()
            stranger.wait()
        self.assertEqual({each.code for _, each in self.listener.actions[count:]}, {NOMINAL})
        self.assertIsNone(self.node.process.poll())

    def test_14_diagnostics_have_a_row_for_each_component(self):
        rows = [row for message in self.listener.diagnostics[-3:] for row in message.status]
        names = {row.name for row in rows}
        self.assertEqual(names, {f"watchdog: {name}" for name in ("fast", "camera", "slow", "lost", "disk", "imu")})

    def test_15_what_does_not_come_back_is_given_up_while_the_heartbeat_goes_on(self):
        killed_s = time.monotonic()
        os.kill(self.pid("/lost"), signal.SIGKILL)
        gone.add("lost")
        self.failed("lost", HOLD, killed_s, TRYING)
        at_s, component = self.failed("lost", ABORT, killed_s)
        self.assertEqual(component.restart, GIVEN_UP)
        self.assertLess(at_s - killed_s, allowed_s(3.0 + 0.6, killed_s, at_s))
        beats = [each for each, _ in self.listener.actions if killed_s < each < at_s]
        for before_s, after_s in zip(beats, beats[1:]):
            self.assertLess(after_s - before_s, allowed_s(0.3, before_s, after_s))
        self.assertIn("restart 2 of lost", self.node.log)
        answer = self.start(startup_time=1.0, mission_id="1")  # a new take-off check: new attempts
        self.assertEqual((answer.ready, answer.fixable, answer.being_fixed), (False, True, True))
        self.assertLess(answer.until, 3.0)


gone: set = set()

if __name__ == "__main__":
    only = [word.split("=", 1)[1] for word in sys.argv if word.startswith("--only=")]
    for name in [name for name in vars(TestWatchdog) if name.startswith("test_") and only and name[5:7] not in only]:
        delattr(TestWatchdog, name)
    mend_rospy()
    rospy.init_node("test_watchdog")
    rostest.rosrun("amaze_autonomy", "watchdog", TestWatchdog)
