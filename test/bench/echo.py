#!/usr/bin/env python3
"""The least that rospy can do: a subscriber whose callback calls a persistent service. echo.py NAMESPACE NICENESS"""

from __future__ import annotations

import sys

import rospy

from amaze_autonomy import msg, srv
from amaze_autonomy.ros.node_main import take_precedence


def main(namespace: str, nice: int) -> None:
    take_precedence(nice)  # as the node beside it
    rospy.init_node("echo")
    service = f"{namespace}/command"
    rospy.wait_for_service(service)
    land = rospy.ServiceProxy(service, srv.MissionCommand, persistent=True)
    rospy.Subscriber(f"{namespace}/action", msg.WatchdogAction, lambda _: land("", 4), tcp_nodelay=True)
    rospy.spin()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
