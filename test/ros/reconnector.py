#!/usr/bin/env python3
"""A subscription whose publishers rospy has lost from its list is connected all the same."""

from __future__ import annotations

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
        reconnector.look()
        self.assertEqual(subscriber.get_num_connections(), 1, "what is connected is left alone")
        reconnector.stop()

    def published(self):
        publishers, _, _ = rosgraph.Master("/test").getSystemState()
        return any(topic == "/fast/data" for topic, _ in publishers)


if __name__ == "__main__":
    rospy.init_node("test_reconnector")
    rostest.rosrun("amaze_autonomy", "reconnector", TestReconnector, sys.argv)
