#!/usr/bin/env python3
"""A rospy node that listens to every status and does nothing. bare_node.py NAMESPACE"""

from __future__ import annotations

import sys

import rospy

from amaze_autonomy.interface import STATUSES
from amaze_autonomy.ros.interface import message_class


def main(namespace: str) -> None:
    rospy.init_node("bare")
    for status in STATUSES:
        rospy.Subscriber(f"{namespace}/{status.topic}", message_class(status), lambda _: None, tcp_nodelay=True)
    rospy.spin()


if __name__ == "__main__":
    main(sys.argv[1])
