#!/usr/bin/env python3
"""Publishes many topics at their rates, and falls silent on one when it is told to.

    many_topics.py '[["/imu", "imu", 200.0], ...]'

Kinds: imu, image (640x480 mono8), range. Commands on standard input, a line each: `stop TOPIC`, `go TOPIC`. For each
stop it prints a line: the topic and the system's monotonic time, in ns, just before its last message was published.
"""

from __future__ import annotations

import json
import sys
import threading
import time

import rospy
from sensor_msgs.msg import Image, Imu, Range


def picture():
    return Image(height=480, width=640, encoding="mono8", step=640, data=bytes(640 * 480))


KINDS = {"imu": (Imu, Imu), "image": (Image, picture), "range": (Range, Range)}
output = threading.Lock()


class Sensor:
    """One topic."""

    def __init__(self, topic, kind, rate_hz):
        message, make = KINDS[kind]
        self.topic, self._period_s, self._message = topic, 1.0 / rate_hz, make()
        self._publisher = rospy.Publisher(topic, message, queue_size=10, tcp_nodelay=True)
        self._going, self._stop = threading.Event(), threading.Event()
        self._going.set()
        threading.Thread(target=self._run, daemon=True).start()

    def command(self, word):
        if word == "stop":
            self._stop.set()
        else:
            self._going.set()

    def _run(self):
        due_s = time.monotonic()
        while True:
            self._message.header.stamp = rospy.Time.now()
            last_ns = time.monotonic_ns()
            self._publisher.publish(self._message)
            if self._stop.is_set():
                self._stop.clear()
                self._going.clear()
                with output:
                    print(self.topic, last_ns, flush=True)
                self._going.wait()  # hollow: a thread; the bench kills its process
                due_s = time.monotonic()
            due_s += self._period_s
            time.sleep(max(0.0, due_s - time.monotonic()))


def main():
    rospy.init_node("many_topics", disable_signals=True)
    sensors = {each[0]: Sensor(*each) for each in json.loads(sys.argv[1])}
    for line in sys.stdin:
        word, topic = line.split()
        sensors[topic].command(word)


main()
