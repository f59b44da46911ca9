#!/usr/bin/env python3
"""A sensor's node on another computer whose network cable is pulled, and plugged in again.

The other computer is a network namespace; its cable is a pair of virtual interfaces, of which the far end goes down, so
that the near end loses its carrier. Needs the right to make one (root).
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path
from urllib.parse import urlparse

import rosgraph
import rospy
import rostest
from hitches import allowed_s
from one_node import OneNode, wait_for, wait_for_service

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

SENSORS = """
components:
  camera:
    group: other
    severity: moderate
    wait_limit_s: 5.0
    topics:
      /far/data: {rate_hz: 30.0, age_limit_s: 0.3, tolerance_fraction: 0.3}
  computer:
    group: other
    severity: low
    node: /far
landing_detection: {topic: /range}
state_estimation: {topic: /odometry, imu_topic: /imu}
"""
MISSIONS = """
missions:
  "1":
    description: nothing in particular
    files: [trajectories/hop.csv]
"""
NEAR, FAR = "10.213.47.1", "10.213.47.2"
INTERFACE = f"amaze{os.getpid() % 100000}"
NOMINAL, NON_CRITICAL, INCONVENIENT = 1, 2, 4


class FarComputer:
    """A network namespace, kept by a process that sleeps; its cable; and the master, which listens on loopback only."""

    def __init__(self):
        self.keeper = subprocess.Popen(["unshare", "--net", "sleep", "1000"])
        here, there = Path("/proc/self/ns/net"), Path(f"/proc/{self.keeper.pid}/ns/net")
        wait_for(lambda: not here.samefile(there), "a network namespace")
        self._do("ip", "link", "add", INTERFACE, "type", "veth", "peer", "name", "cable", "netns", str(self.keeper.pid))
        self._do("ip", "address", "add", f"{NEAR}/30", "dev", INTERFACE)
        self._do("ip", "link", "set", INTERFACE, "up")
        self._far("ip", "address", "add", f"{FAR}/30", "dev", "cable")
        self._far("ip", "link", "set", "lo", "up")
        self.plug()
        self.master = socket.create_server((NEAR, 0))
        threading.Thread(target=self._forward, daemon=True).start()

    def pull(self) -> float:
        """Pull the cable; return when."""
        self._far("ip", "link", "set", "cable", "down")
        return time.monotonic()

    def plug(self) -> float:
        """Plug the cable in; return when."""
        self._far("ip", "link", "set", "cable", "up")
        return time.monotonic()

    def start(self, *command):
        uri = f"http://{NEAR}:{self.master.getsockname()[1]}/"
        environment = {**os.environ, "ROS_MASTER_URI": uri, "ROS_IP": FAR}
        return subprocess.Popen(self._there(*command), env=environment)

    def end(self):
        self.master.close()
        self.keeper.kill()
        self.keeper.wait()

    def _there(self, *command):
        return ["nsenter", "--target", str(self.keeper.pid), "--net", *command]

    def _far(self, *command):
        self._do(*self._there(*command))

    def _do(self, *command):
        subprocess.run(command, check=True, timeout=60)

    def _forward(self):
        uri = urlparse(rosgraph.get_master_uri())
        while True:
            try:
                near, _ = self.master.accept()
            except OSError:
                return
            far = socket.create_connection((uri.hostname, uri.port), timeout=10.0)
            far.settimeout(None)  # nothing may be said on it for long
            for source, sink in ((near, far), (far, near)):
                threading.Thread(target=_copy, args=(source, sink), daemon=True).start()


def _copy(source, sink):
    try:
        while True:
            data = source.recv(65536)
            if not data:
                sink.shutdown(socket.SHUT_WR)
                return
            sink.sendall(data)
    except OSError:
        return


class TestCable(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if subprocess.run(["unshare", "--net", "true"], check=False, stderr=subprocess.DEVNULL, timeout=60).returncode:
            raise unittest.SkipTest("NOT RUN: making a network namespace is not permitted here")
        cls.actions, cls.infos = [], []
        rospy.Subscriber(
            "watchdog/action",
            msg.WatchdogAction,
            lambda each: cls.actions.append((time.monotonic(), each)),
            tcp_nodelay=True,
        )
        rospy.Subscriber("watchdog/info", msg.WatchdogInfo, cls.infos.append)
        cls.far = FarComputer()
        rospy.set_param("/far/kind", "image")
        rospy.set_param("/far/rate", 30)
        sensor = Path(__file__).resolve().parent / "fake_sensor.py"
        cls.sensor = cls.far.start(sys.executable, str(sensor), "__name:=far")
        cls.node = OneNode("watchdog", sensors=SENSORS, missions=MISSIONS)
        wait_for_service("watchdog/start")
        cls.answer = rospy.ServiceProxy("watchdog/start", srv.StartWatchdog)(startup_time=15.0, mission_id="1")

    @classmethod
    def tearDownClass(cls):
        cls.sensor.kill()
        cls.sensor.wait()
        cls.far.end()
        assert cls.node.end() == 0

    def first(self, code, after_s):
        """When the first action after a time came that has a code."""
        return next((at_s for at_s, each in list(self.actions) if at_s > after_s and each.code == code), None)

    def code(self, name):
        """What the last info says of a component."""
        return next((each.code for each in self.infos[-1].components if each.name == name), None)

    def reason(self, name):
        return next(each.reason for each in self.infos[-1].components if each.name == name)

    def test_a_pulled_cable_is_seen_within_the_limits_and_so_is_its_return(self):
        self.assertTrue(self.answer.ready, self.answer.message)
        pulled_s = self.far.pull()
        at_s, _ = wait_for(
            lambda: next(
                (each for each in list(self.actions) if each[0] > pulled_s and each[1].code == INCONVENIENT), 0
            ),
            "the camera at 4",
        )
        self.assertLess(at_s - pulled_s, allowed_s(0.3 + 0.05, pulled_s, at_s))
        wait_for(lambda: self.code("computer") == NON_CRITICAL, "the computer at 2")
        self.assertLess(time.monotonic() - pulled_s, allowed_s(1.5 + 0.5 + 0.3, pulled_s))
        self.assertEqual(self.reason("camera"), "no message on /far/data for longer than 0.3 s")
        self.assertEqual(self.reason("computer"), "node /far: no answer for longer than 1.5 s")
        beats = [each for each, _ in self.actions if pulled_s < each]
        for before_s, after_s in zip(beats, beats[1:]):
            self.assertLess(after_s - before_s, allowed_s(0.3, before_s, after_s), "the heartbeat goes on")
        self.far.plug()
        wait_for(lambda: self.code("camera") == self.code("computer") == NOMINAL, "both nominal", 20.0)


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_cable")
    rostest.rosrun("amaze_autonomy", "cable", TestCable)
