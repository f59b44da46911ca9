#!/usr/bin/env python3
"""The autopilot node through mavros' topics and services, played by the test; and without mavros_msgs."""

from __future__ import annotations

import signal
import struct
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

import rospy
import rostest
from at_once import at_once
from geometry_msgs.msg import PoseStamped, TwistStamped
from mavros_definitions import MD5, install, made
from one_node import OneNode, wait_for, wait_for_end, wait_for_service
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.rospy_flaws import mend_rospy

STATUS, CHECK = msg.AutopilotStatus, msg.Check
FOLDER = Path(tempfile.mkdtemp(prefix="amaze_mavros_"))
PATH = install(FOLDER)
sys.path[:0] = PATH.split(":")
from mavros_msgs import msg as mavros  # noqa: E402
from mavros_msgs import srv as services  # noqa: E402

HEALTHY = 1 | 2 | 4 | 8 | 32 | 65536
PREARM = 1 << 28
SILENT = -1


class FakeMavros:
    """A mavros with a vehicle behind it, in a namespace."""

    def __init__(self, namespace):
        self.mode, self.armed, self.landed, self.height_m, self.fixed = "AUTO.LOITER", False, 1, 0.0, 3
        self.asked, self.ended = [], threading.Event()
        self.batteries = [("", 0.9)]
        self.counts = []  # of the messages of each vehicle that mavros receives beside those of an ArduPilot
        self.charge_state = 0  # of the battery among them
        self.publishers = {
            topic: rospy.Publisher(f"{namespace}/{topic}", kind, queue_size=5)
            for topic, kind in (
                ("state", mavros.State),
                ("extended_state", mavros.ExtendedState),
                ("sys_status", mavros.SysStatus),
                ("battery", BatteryState),
                ("statustext/recv", mavros.StatusText),
                ("estimator_status", mavros.EstimatorStatus),
                ("gpsstatus/gps1/raw", mavros.GPSRAW),
                ("local_position/pose", PoseStamped),
                ("local_position/velocity_local", TwistStamped),
                ("home_position/home", mavros.HomePosition),
            )
        }
        beside = namespace.rpartition("/")[0]
        self.ekf = None  # flags of ArduPilot; None: those of PX4 are said, SILENT: none
        self.publishers["received"] = rospy.Publisher(f"{beside}/mavlink/from", mavros.Mavlink, queue_size=5)
        self.services = [
            rospy.Service(f"{namespace}/set_mode", services.SetMode, self.set_mode),
            rospy.Service(f"{namespace}/cmd/command", services.CommandLong, self.command),
            rospy.Service(f"{namespace}/param/get", services.ParamGet, self.parameter),
        ]
        threading.Thread(target=self.run, daemon=True).start()

    def set_mode(self, request):
        self.asked.append(request.custom_mode)
        self.mode = request.custom_mode
        return services.SetModeResponse(mode_sent=True)

    def command(self, request):
        self.asked.append(request.command)
        if request.command == 400 and request.param1 == 0.0:
            self.armed = False
        return services.CommandLongResponse(success=True, result=0)

    def parameter(self, request):
        value = mavros.ParamValue(integer=3 if request.param_id == "COM_LOW_BAT_ACT" else 0, real=0.0)
        return services.ParamGetResponse(success=True, value=value)

    def run(self):
        number = 0
        while not self.ended.wait(0.1):
            number += 1
            for topic, message in self.messages(number).items():
                self.publishers[topic].publish(message)
            for count in self.counts:
                self.publishers["received"].publish(self.pack(count + number))
            location, level = self.batteries[number % len(self.batteries)]
            battery = BatteryState(location=location, voltage=15.8, current=-1.0, percentage=level)
            self.publishers["battery"].publish(battery)

    def pack(self, count):
        """Return the BATTERY_STATUS of a PX4 among what mavros receives, with the charge state, which no topic has."""
        data = struct.pack(
            "<iihH9HhBBBbiB", -1, -1, 32767, 15800, *[65535] * 9, -100, 0, 0, 0, 90, 0, self.charge_state
        )
        words = struct.unpack("<6Q", data.ljust(48, b"\0"))
        found = {"framing_status": 1, "magic": 253, "len": len(data), "msgid": 147, "payload64": words}
        return mavros.Mavlink(sysid=1, compid=1, seq=count % 256, **found)

    def messages(self, number):
        """Return what is published, by topic; the estimator's flags as PX4 or as ArduPilot says them."""
        all_of_them = self.messages_but_flags(number)
        if self.ekf == SILENT:
            return all_of_them
        if self.ekf is None:
            flags = {name: True for name in mavros.EstimatorStatus.__slots__ if name.endswith("flag")}
            return {**all_of_them, "estimator_status": mavros.EstimatorStatus(**flags)}
        data = struct.pack("<5fH10x", 0.1, 0.1, 0.1, 0.1, 0.1, self.ekf)
        words = struct.unpack("<4Q", data)
        received = mavros.Mavlink(framing_status=1, magic=253, len=22, sysid=1, compid=1, msgid=193, payload64=words)
        return {**all_of_them, "received": received}

    def messages_but_flags(self, number):
        pose, speed = PoseStamped(), TwistStamped()
        pose.pose.position.x, pose.pose.position.z = 2.0, self.height_m
        speed.twist.linear.z = 0.5
        raw = mavros.GPSRAW(fix_type=self.fixed, lat=number, alt=489000)
        raw.header.stamp = rospy.Time.now()
        return {
            "state": mavros.State(connected=True, armed=self.armed, mode=self.mode, system_status=3 + self.armed),
            "extended_state": mavros.ExtendedState(landed_state=self.landed),
            "sys_status": mavros.SysStatus(
                sensors_present=HEALTHY,
                sensors_enabled=HEALTHY,
                sensors_health=HEALTHY | PREARM,
                voltage_battery=15800,
                current_battery=100,
                battery_remaining=90,
            ),
            "gpsstatus/gps1/raw": raw,
            "local_position/pose": pose,
            "local_position/velocity_local": speed,
            "home_position/home": mavros.HomePosition(),
        }


def says_all(said) -> bool:
    """Return whether a message of each topic has come."""
    known = said.armed_known and said.landed and said.position_valid and said.gps and said.prearm and said.rc
    return bool(known) and said.vertical_speed > 0 and said.battery_fraction > 0  # not a number is neither


@at_once(8)
class TestMavros(unittest.TestCase):
    def setUp(self):
        self.space, self.statuses = f"/{self._testMethodName[:24]}", []
        self.mavros = FakeMavros(f"{self.space}/mavros")
        rospy.Subscriber(f"{self.space}/autopilot/status", STATUS, self.statuses.append)
        overrides = ["autopilot.backend=mavros", f"autopilot.mavros={self.space}/mavros"]
        self.node = OneNode("autopilot", self.space, overrides, modules=PATH)

    def tearDown(self):
        self.mavros.ended.set()
        if self.node.process.poll() is None:
            self.node.process.kill()
            self.node.process.wait()

    def wait(self, condition, what):
        words = lambda: f"{what}: {self.statuses[-1:]} {self.node.log}"  # noqa: E731
        wait_for(lambda: self.statuses and condition(self.statuses[-1]), words, 40.0)

    def call(self, name, kind=Trigger, *arguments):
        name = f"{self.space}/autopilot/{name}"
        wait_for_service(name)
        return rospy.ServiceProxy(name, kind)(*arguments)

    def assert_asked_until_now(self, mode):
        """A mode, and no other, was asked for until it showed, and is not any more: how often is a matter of load."""
        modes = lambda: [name for name in self.mavros.asked if isinstance(name, str)]  # noqa: E731
        time.sleep(1.0)  # what was on its way
        asked = modes()
        self.assertEqual(set(asked), {mode})
        time.sleep(1.0)
        self.assertEqual(modes(), asked)

    def fly(self):
        self.wait(says_all, "a vehicle at rest")
        self.mavros.__dict__.update(armed=True, landed=2, mode="AUTO.MISSION")
        self.wait(lambda said: said.landed == STATUS.IN_AIR, "a vehicle that takes off")
        self.mavros.height_m = 5.0
        self.wait(
            lambda said: said.landed == STATUS.IN_AIR and said.height > 4.9 and said.armed, "a vehicle in the air"
        )

    def test_what_it_says(self):
        self.wait(says_all, "all")
        said = self.statuses[-1]
        self.assertEqual(
            (said.armed_known, said.armed, said.landed, said.mode), (True, False, STATUS.ON_GROUND, "AUTO.LOITER")
        )
        self.assertAlmostEqual(said.battery_fraction, 0.9)
        self.assertAlmostEqual(said.battery_voltage, 15.8, 3)
        self.assertAlmostEqual(said.vertical_speed, 0.5)
        self.assertEqual((said.rc, said.prearm), (STATUS.SENSOR_HEALTHY,) * 2)
        self.mavros.fixed = 0
        self.wait(lambda said: said.gps == STATUS.SENSOR_FAILED, "a lost GPS")
        rows = {row.name: row.verdict for row in self.call("check", srv.CheckAutopilot).checks}
        self.assertEqual({rows[name] for name in ("autopilot link", "not armed", "pre-arm check", "RC receiver")}, {1})

    def test_of_two_batteries_on_one_topic_the_worst_counts_and_nothing_jumps(self):
        self.mavros.batteries = [("id0", 0.9), ("id1", 0.3)]
        self.wait(lambda said: abs(said.battery_fraction - 0.3) < 0.01, "the worst of both")
        first = len(self.statuses)
        wait_for(lambda: len(self.statuses) > first + 10, "two seconds of statuses")
        levels = {round(said.battery_fraction, 2) for said in self.statuses[first:]}
        self.assertEqual(levels, {0.3})

    def test_a_px4_judges_its_battery_and_a_second_vehicle_of_its_id_forbids_takeoff(self):
        """Both are in what mavros receives alone."""
        row = lambda name: next(row for row in self.call("check", srv.CheckAutopilot).checks if row.name == name)  # noqa: E731
        self.mavros.__dict__.update(counts=[0], charge_state=1)
        self.wait(says_all, "all")
        battery = lambda: self.call("check_battery", srv.CheckBattery, 0.5).checks[-1]  # noqa: E731
        wait_for(lambda: battery().verdict == CHECK.PASS, lambda: f"a judged battery: {battery()}", period_s=0.5)
        self.assertEqual((battery().name, row("one vehicle").verdict), ("battery state", CHECK.PASS))
        self.mavros.counts = [0, 120]
        wait_for(lambda: row("one vehicle").verdict == CHECK.FAIL, "a second vehicle", period_s=0.5)
        self.assertIn("another vehicle into ours (mavros, where ours is, too)", row("one vehicle").advice)
        wait_for(lambda: "it is taken for ours" in self.node.log, lambda: self.node.log)
        self.mavros.counts = [0]
        passes = lambda: row("one vehicle").verdict == CHECK.PASS  # noqa: E731
        wait_for(passes, "one that was switched off for half a minute", limit_s=60.0, period_s=0.5)
        self.mavros.charge_state = 3
        self.wait(lambda said: said.battery_critical, "a critical battery")

    def test_what_is_written_here_is_what_mavros_has(self):
        written = {**made("msg"), **made("srv")}
        self.assertEqual({name: written[name]._md5sum for name in MD5}, MD5)

    def test_an_ardupilot_is_one_by_its_modes_and_its_pilot_by_loiter(self):
        self.mavros.__dict__.update(mode="STABILIZE", ekf=0x33F)
        self.wait(lambda said: said.mode == "STABILIZED" and said.position_valid, "an ArduPilot with a position")
        self.mavros.__dict__.update(armed=True, landed=2, mode="AUTO")
        self.wait(lambda said: said.mode == "AUTO.MISSION" and said.landed == STATUS.IN_AIR, "its takeoff")
        self.mavros.height_m = 5.0  # above where it was armed
        self.wait(lambda said: said.height > 4.9, "its mission")
        self.assertFalse(self.statuses[-1].pilot_in_control)
        self.mavros.mode = "LOITER"
        self.wait(lambda said: said.mode == "POSCTL" and said.pilot_in_control, "its pilot")
        self.assertIn("the pilot has control", self.call("land").message)
        self.mavros.mode = "CMODE(25)"
        self.wait(lambda said: said.mode == "MODE.25" and said.pilot_in_control, "a mode that has a number alone")
        self.mavros.mode = "SURFACE"
        self.wait(lambda said: said.mode == "MODE.255" and said.pilot_in_control, "a mode that is nobody's")
        wait_for(lambda: "mavros says mode 'SURFACE', which is none of ArduPilot's" in self.node.log, "the words")
        self.assertEqual(self.node.log.count("mavros says"), 1)
        self.assertEqual([name for name in self.mavros.asked if isinstance(name, str)], [])

    def test_an_ardupilot_is_landed_by_its_own_name_of_the_mode(self):
        self.mavros.__dict__.update(mode="STABILIZE", ekf=0x33F)
        self.wait(lambda said: said.mode == "STABILIZED" and said.position_valid, "an ArduPilot with a position")
        self.mavros.__dict__.update(armed=True, landed=2, mode="AUTO")
        self.wait(lambda said: said.mode == "AUTO.MISSION" and said.armed, "its mission")
        self.assertTrue(self.call("land").success)
        self.wait(lambda said: said.mode == "AUTO.LAND", "the landing mode")
        self.assert_asked_until_now("LAND")
        self.mavros.ekf = 0xA7  # its position is lost
        self.wait(lambda said: not said.position_valid, "no position")

    def test_an_ardupilot_without_its_flags_is_not_ready_and_says_why(self):
        self.mavros.__dict__.update(mode="STABILIZE", ekf=SILENT)
        self.wait(lambda said: said.mode == "STABILIZED" and said.gps, "an ArduPilot")
        rows = {row.name: row for row in self.call("check", srv.CheckAutopilot).checks}
        self.assertIn("mavros hands on no EKF_STATUS_REPORT", rows["pre-arm check"].advice)
        self.assertNotEqual(rows["pre-arm check"].verdict, CHECK.PASS)
        self.assertFalse(self.statuses[-1].position_valid)

    def test_it_lands_through_set_mode_and_disarms_by_command(self):
        self.fly()
        self.assertFalse(self.call("disarm").success)
        self.assertTrue(self.call("land").success)
        self.wait(lambda said: said.mode == "AUTO.LAND", "the landing mode")
        self.assert_asked_until_now("AUTO.LAND")
        self.mavros.landed = 1
        self.wait(lambda said: said.landed == STATUS.ON_GROUND, "the ground")
        answers = []
        disarmed = lambda: answers.append(self.call("disarm")) or answers[-1].success  # noqa: E731
        wait_for(disarmed, lambda: f"a disarmed vehicle: {answers}", period_s=1.0)
        self.wait(lambda said: not said.armed, "a disarmed vehicle")

    def test_told_to_end_in_flight_it_lands(self):
        self.fly()
        self.node.process.send_signal(signal.SIGHUP)
        self.assertEqual(wait_for_end(self.node.process), 0)
        self.assertEqual(self.mavros.mode, "AUTO.LAND")

    def test_without_mavros_msgs_it_says_what_to_do(self):
        node = OneNode("autopilot", f"{self.space}/bare", ["autopilot.backend=mavros"])
        self.assertEqual(wait_for_end(node.process), 2)
        begins = "autopilot: backend mavros: No module named 'mavros_msgs'; install"
        self.assertTrue(node.log.startswith(begins), node.log)


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_mavros")
    rostest.rosrun("amaze_autonomy", "mavros", TestMavros)
