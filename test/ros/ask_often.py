#!/usr/bin/env python3
"""Ask a user command again and again: ask_often.py SERVICE COMMAND SECONDS. Prints how often, and the slowest answer.

Says "ready" once it is connected, and begins when it gets a line. By how much this process was late is taken off.
"""

from __future__ import annotations

import json
import sys
import time

import rospy
from hitches import allowed_s

from amaze_autonomy import srv
from amaze_autonomy.ros.node_main import take_precedence

PAUSE_S = 0.01  # asked without a pause, several of these would measure each other


def main(name: str, command: str, seconds: float) -> None:
    take_precedence(-10)  # as the autonomy node does: the other tests' processes shall not be measured
    rospy.wait_for_service(name)
    ask = rospy.ServiceProxy(name, srv.UserCommand, persistent=True)
    ask(command)
    print("ready", flush=True)
    sys.stdin.readline()
    times = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        time.sleep(PAUSE_S)
        before = time.monotonic()
        answer = ask(command)
        took_s = time.monotonic() - before
        times.append(took_s - allowed_s(0.0, before))
        if answer.answer != srv.UserCommandResponse.REFUSED:
            raise SystemExit(f"answered {answer}")
    print(json.dumps({"count": len(times), "slowest_s": max(times)}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
