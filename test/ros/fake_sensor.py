#!/usr/bin/env python3
"""A sensor's node that fails in the ways that a test asks for; restarted, it works again.

~kind   imu or image
~rate   Hz
~data   what it publishes
~mode   std_msgs/String: good, half, fast, silent, freeze, nan
"""

from __future__ import annotations

import time

import rospy
from sensor_msgs.msg import Image, Imu
from std_msgs.msg import String

from amaze_autonomy.ros.rospy_flaws import mend_rospy

RATES = {"half": 0.5, "fast": 2.0}


class FakeSensor:
    def __init__(self):
        self.mode, self.number = "good", 0
        kind = {"imu": Imu, "image": Image}[rospy.get_param("~kind")]
        self.rate_hz = float(rospy.get_param("~rate"))
        self.publisher = rospy.Publisher("~data", kind, queue_size=10, tcp_nodelay=True)
        rospy.Subscriber("~mode", String, self.set_mode)

    def set_mode(self, message):
        self.mode = message.data

    def message(self):
        if self.mode != "freeze":
            self.number += 1
        message = self.publisher.data_class()
        message.header.stamp = rospy.Time.now()
        if isinstance(message, Image):
            message.height, message.width, message.step, message.encoding = 48, 64, 64, "mono8"
            message.data = bytes([self.number % 256]) * (48 * 64)
        else:
            message.linear_acceleration.z = float("nan") if self.mode == "nan" else 9.8 + 0.001 * (self.number % 7)
        return message

    def run(self):
        due_s = time.monotonic()
        while not rospy.is_shutdown():
            if self.mode != "silent":
                self.publisher.publish(self.message())
            due_s = max(due_s, time.monotonic() - 0.1) + 1.0 / (self.rate_hz * RATES.get(self.mode, 1.0))
            time.sleep(max(0.0, due_s - time.monotonic()))


mend_rospy()
rospy.init_node("fake_sensor")
FakeSensor().run()
