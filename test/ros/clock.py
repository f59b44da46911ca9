#!/usr/bin/env python3
"""With use_sim_time the engine decides on /clock: it runs at another speed here, and jumps back in flight."""

from __future__ import annotations

import math
import threading
import time

import rospy
from behaviours import Behaviours
from launching import LIMIT_S, flown, in_flight
from one_node import wait_for
from rosgraph_msgs.msg import Clock
from stack import Stack

from amaze_autonomy.engine.events import EngineStarted

SPEED = 1.5
START_S = 1000.0
JUMP_S = 400.0
NODES = 3  # this one, autonomy and simulation: both must wait for their first word of time
clocks = Behaviours()


class FastClock:
    """Publishes /clock, from when the nodes are there on, faster than real time; can be set back."""

    def __init__(self) -> None:
        self._began_s = time.monotonic()
        self._back_s, self._stands_s = 0.0, math.nan

    def start(self) -> None:
        self._publisher = rospy.Publisher("/clock", Clock, queue_size=1)
        threading.Thread(target=self._run, daemon=True).start()

    def now_s(self) -> float:
        return START_S + SPEED * (time.monotonic() - self._began_s) - self._back_s

    def said_s(self) -> float:
        return self.now_s() if math.isnan(self._stands_s) else self._stands_s

    def jump_back(self) -> None:
        self._back_s += JUMP_S

    def stand(self) -> None:
        """Say the same time again and again."""
        self._stands_s = self.now_s()

    def go_on(self) -> None:
        self._back_s += self.now_s() - self._stands_s
        self._stands_s = math.nan

    def _run(self) -> None:
        tick = threading.Event()
        while self._publisher.get_num_connections() < NODES and not rospy.is_shutdown():  # hollow: a thread
            tick.wait(0.05)
        self._began_s = time.monotonic()
        while not tick.wait(0.005) and not rospy.is_shutdown():
            self._publisher.publish(Clock(clock=rospy.Time.from_sec(self.said_s())))


FAST = FastClock()


@clocks.add(
    mission="hop",
    overrides=("autonomy.recording.recording_lead_s=3.0", "autonomy.failsafe.watchdog_heartbeat_limit_s=5.0"),
)
def mission_flies_in_simulated_time(stack: Stack) -> None:
    stack.wait_state("MISSION_ENDED")
    assert stack.states[-1].result == "COMPLETE"
    started = stack.events(EngineStarted)[0].t_ns / 1e9
    assert START_S <= started <= START_S + 120.0, "the engine does not decide on /clock"
    times = {each.name: each.t_ns / 1e9 for each in stack.received()}
    lead_s = times["TAKEOFF"] - times["data_recorder/start"]
    assert 3.0 / SPEED <= lead_s < 3.0, f"the lead of 3 s took {lead_s:.2f} s of real time at {SPEED} times its speed"


@clocks.add(mission="long")
def clock_that_jumps_back_in_flight_is_survived(stack: Stack) -> None:
    stack.wait_state("MISSION")
    FAST.jump_back()
    seen = stack.states[-1].waypoint
    stack.wait(lambda: stack.states[-1].waypoint > seen, "the next waypoint")
    assert stack.state == "MISSION"
    assert stack.ask("land")[0] == 1
    stack.wait_state("MISSION_ENDED")
    journal = [event.t_ns for event in stack.journal() if hasattr(event, "t_ns")]
    assert journal == sorted(journal), "time runs back in the journal"
    assert stack.states[-1].result == "LANDED_EARLY"


@clocks.add(mission="long")
def clock_that_stands_in_flight_is_landed_for_by_both_routes(stack: Stack) -> None:
    """All simulated peers stand with it, so that the vehicle shows nothing: the landing is repeated by wall time."""
    stack.wait_state("MISSION")
    FAST.stand()
    try:
        stack.wait_received("autopilot/land")
        stack.wait_received("LAND", 3)
        assert stack.states[-1].state == "LAND"
        assert any(each.name == "clock" for each in stack.states[-1].failures), stack.states[-1]
    finally:
        FAST.go_on()
    stack.wait_state("MISSION_ENDED")
    assert stack.states[-1].result == "LANDED_EARLY"


@clocks.add(processes=(), start=False)
def real_nodes_land_a_vehicle_by_mavlink_while_the_clock_stands(stack: Stack) -> None:
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        FAST.stand()
        try:
            wait_for(lambda: vehicle.modes[-1] == "AUTO.LAND", "the landing mode", LIMIT_S)
            wait_for(lambda: not vehicle.craft.armed, "the ground", LIMIT_S)
            assert any(each.name == "clock" for each in stack.states[-1].failures), stack.states[-1]
        finally:
            FAST.go_on()
        stack.wait_over()
        assert stack.states[-1].result == "LANDED_EARLY"


@clocks.add(mission="")
def clock_that_stands_on_the_ground_is_warned_of(stack: Stack) -> None:
    stack.wait_state("MISSION_INPUT")
    FAST.stand()
    try:
        stack.wait(lambda: "clock" in stack.states[-1].message, "the warning")
    finally:
        FAST.go_on()


if __name__ == "__main__":
    clocks.main("amaze_autonomy", "clock", FAST.start, at_once=1)  # one clock for all, and one of them sets it back
