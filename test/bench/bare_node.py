#!/usr/bin/env python3
"""A rospy node that listens to every status and does nothing. bare_node.py NAMESPACE"""

from __future__ import annotations

import sys

import rospy

from amaze_autonomy.nodes.interface import STATUS_TOPICS


def main(namespace: str) -> None:
    rospy.init_node("bare")
    for topic in STATUS_TOPICS:
        rospy.Subscriber(f"{namespace}/{topic.name}", topic.message, lambda _: None, tcp_nodelay=True)
    rospy.spin()


if __name__ == "__main__":
    main(sys.argv[1])
