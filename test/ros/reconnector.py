#!/usr/bin/env python3
"""A subscription whose publishers rospy has lost from its list is connected all the same."""

from __future__ import annotations

import subprocess
import sys
import unittest
from unittest import mock

import rosgraph
import rospy
import rostest
from one_node import wait_for
from rospy.impl.registration import RegManager
from sensor_msgs.msg import Imu

from amaze_autonomy.ros.reconnector import Reconnector, subscriptions
from amaze_autonomy.ros.rospy_flaws import mend_rospy


class TestReconnector(unittest.TestCase):
    def test_a_lost_word_of_the_master_is_made_good(self):
        wait_for(self.published, "/fast/data is published")
        heard = []
        with mock.patch.object(RegManager, "publisher_update") as lost:
            subscriber = rospy.Subscriber("/fast/data", Imu, heard.append)
            wait_for(lambda: lost.call_count, "the word that is lost")
        self.assertIn("/fast/data", [each.resolved_name for each in subscriptions()])
        rospy.sleep(1.0)
        self.assertEqual((subscriber.get_num_connections(), heard), (0, []), "rospy does not mend it by itself")

        reconnector = Reconnector()
        reconnector.start()

        wait_for(lambda: heard, "a message", 10.0)
        self.assertEqual(subscriber.get_num_connections(), 1)
        reconnector.stop()
        (connection,) = subscriber.impl.connections
        again = Reconnector()
        for _ in range(10):  # the last one is at everything
            again.look()
        self.assertEqual(again.foreign, ())
        count = len(heard)
        wait_for(lambda: len(heard) > count + 10, "further messages")
        self.assertEqual(subscriber.impl.connections, [connection], "what is connected is left alone")
        self.assertFalse(connection.done)

    def test_a_publisher_of_another_type_is_named_with_both_types(self):
        command = ["rostopic", "pub", "-r", "5", "/odd", "std_msgs/String", "data: odd"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        rospy.Subscriber("/odd", Imu, lambda _: None)
        reconnector = Reconnector()
        try:
            found = wait_for(lambda: reconnector.look() or reconnector.foreign, "the other type")
            self.assertRegex(
                str(found[0]),
                r"^/odd: /rostopic_\S+ publishes std_msgs/String \(md5 992ce8a1687cec8c8bd883ec73ca41d1\), read here "
                r"is sensor_msgs/Imu \(md5 6a62c6daae103f4ff57a132d6f95cec2\): rename or remap one of them$",
            )
        finally:
            process.kill()  # told to end, it takes its time where the machine is busy
            process.wait()
        wait_for(lambda: reconnector.look() or not reconnector.foreign, "its end")

    def published(self):
        publishers, _, _ = rosgraph.Master("/test").getSystemState()
        return any(topic == "/fast/data" for topic, _ in publishers)


if __name__ == "__main__":
    mend_rospy()
    rospy.init_node("test_reconnector")
    rostest.rosrun("amaze_autonomy", "reconnector", TestReconnector, sys.argv)
