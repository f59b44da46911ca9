#!/usr/bin/env python3
"""The ROS master answers nobody any more in flight: what flies needs it no longer; all nodes are real.

Alone in its file, since the master of a test is everybody's.
"""

from __future__ import annotations

import contextlib
import os
import signal
from typing import Iterator

import rosgraph
from amaze_autonomy.srv import UserCommand
from behaviours import Behaviours
from hitches import PATIENCE
from launching import flown, in_flight, wait
from lies import DONE, code_16_of_imu_lands
from stack import Stack

from amaze_autonomy.ros.service_client import ServiceClient

LIMIT_S = PATIENCE * 10.0
master = Behaviours()


@contextlib.contextmanager
def stopped_master() -> Iterator[None]:
    """Stop it: it takes every connection, and says nothing."""
    pid = rosgraph.Master("/test").getPid()
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def said(operator: ServiceClient, command: str) -> int:
    """Be the user, whose console is connected."""
    answer: int = operator.ask(LIMIT_S, command=command).answer
    return answer


@master.add(processes=(), start=False)
def flight_goes_on_and_a_code_16_lands_while_the_master_is_stopped(stack: Stack) -> None:
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        operator = ServiceClient(f"/{stack.name}/autonomy/command", UserCommand, rosgraph.get_master_uri(), "/operator")
        operator.keep(LIMIT_S)  # as the console does
        with stopped_master():
            assert said(operator, "hold") == DONE
            stack.wait(lambda: "hold_confirmed" in [each.rule for each in stack.decisions()], "the hold")
            assert said(operator, "resume") == DONE
            stack.wait(lambda: stack.state == "MISSION", "the mission again")
            code_16_of_imu_lands(stack, vehicle)
        wait(stack, lambda: stack.state == "MISSION_ENDED", "the data")
        assert stack.states[-1].result == "LANDED_EARLY"


if __name__ == "__main__":
    master.main("amaze_autonomy", "master", at_once=1)
