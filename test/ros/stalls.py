#!/usr/bin/env python3
"""The engine's process does not run for a while in flight: what came meanwhile is read before anything is judged."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import time
from typing import Any, List
from urllib.parse import urlparse

import rosgraph
import rospy
from amaze_autonomy.srv import UserCommand
from behaviours import Behaviours
from hitches import allowed_s
from stack import Stack

from amaze_autonomy import msg
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import UserRequest
from amaze_autonomy.ros.errors import CallTimeoutError
from amaze_autonomy.ros.service_client import ServiceClient

stalls = Behaviours()
FLIES_ON_NS = 2_000_000_000


def stop_for(stack: Stack, seconds: float) -> int:
    """Stop the engine's process alone for a time; return when it went on (monotonic, ns)."""
    stack.signal_engine(signal.SIGSTOP)
    time.sleep(seconds)
    return stack.signal_engine(signal.SIGCONT)


def decisions_after(stack: Stack, t_ns: int) -> List[Decision]:
    return [each for each in stack.decisions() if each.t_ns > t_ns]


def flies_on(stack: Stack, seconds: float) -> None:
    stack.wait_state("MISSION")
    stopped_ns = time.monotonic_ns()
    went_on_ns = stop_for(stack, seconds)
    stack.wait(lambda: "The engine did not run for" in stack.log(), "what is said of the stall")
    stack.wait(lambda: stack.journal()[-1].t_ns > went_on_ns + FLIES_ON_NS, "two seconds more of the flight")
    assert stack.state == "MISSION"
    assert [each.rule for each in decisions_after(stack, stopped_ns)] == []
    assert stack.ask("land")[0] == 1
    stack.wait_state("MISSION_ENDED")
    times = [event.t_ns for event in stack.journal() if hasattr(event, "t_ns")]
    assert times == sorted(times), "time runs back in the journal"


@stalls.add(mission="long", overrides=("autonomy.failsafe.watchdog_heartbeat_limit_s=0.6",))
def engine_that_is_stopped_for_longer_than_the_limit_of_a_heartbeat_flies_on(stack: Stack) -> None:
    flies_on(stack, 0.7)  # as it ships; on waking it used to take it for lost before it read what lay there


@stalls.add(mission="long")
def engine_that_is_stopped_for_longer_than_every_limit_flies_on(stack: Stack) -> None:
    flies_on(stack, 4.0)


@stalls.add("land", mission="long")
def code_16_while_the_engine_is_stopped_lands_when_it_goes_on(stack: Stack) -> None:
    publisher: Any = rospy.Publisher(f"/{stack.name}/watchdog/action", msg.WatchdogAction, queue_size=1)
    stack.wait_state("MISSION")
    stack.wait(publisher.get_num_connections, "the engine to listen to the test")
    stopped_ns = stack.signal_engine(signal.SIGSTOP)
    time.sleep(0.3)
    imu = msg.ComponentState(name="imu", code=16, until=float("nan"))
    action = msg.WatchdogAction(sequence=1, loop_counter=1, code=16, latest_component="imu", components=[imu])
    action.header.stamp = rospy.Time.now()
    publisher.publish(action)
    time.sleep(1.7)  # its own watchdog says meanwhile that all is well
    went_on_ns = stack.signal_engine(signal.SIGCONT)
    landed = stack.wait_received("LAND")
    assert 0.0 <= (landed.t_ns - went_on_ns) / 1e9 <= allowed_s(0.2, went_on_ns / 1e9)
    stack.wait(lambda: decisions_after(stack, stopped_ns), "the decision in the journal")
    first = decisions_after(stack, stopped_ns)[0]
    assert "imu" in [value.value for value in first.values], first
    assert stopped_ns + 250_000_000 <= first.t_ns <= stopped_ns + 1_000_000_000, "not stamped with when it came"


@stalls.add(overrides=("autonomy.require_go=true",))
def takeoff_that_nobody_waits_for_any_more_is_not_carried_out_when_the_engine_goes_on(stack: Stack) -> None:
    """Neither that of a console, which gave up, nor that of a call from a terminal, which gives up as well."""
    stack.wait_state("READY")
    service = f"/{stack.name}/autonomy"
    console = ServiceClient(f"{service}/command", UserCommand, rosgraph.get_master_uri(), "/operator")
    stack.wait(lambda: console.keep(5.0) or console._idle, "a connection of the console")
    stack.signal_engine(signal.SIGSTOP)
    words = ["rosservice", "call", f"{service}/go"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as terminal:
        try:
            console.ask(10.0, expires=True, command="go")
        except CallTimeoutError:
            time.sleep(10.0)
        else:
            raise AssertionError("an engine that is stopped has answered")
        finally:
            stack.signal_engine(signal.SIGCONT)
        said = terminal.communicate(timeout=stack.patience_s)[0]
    assert "Unable to communicate with service" in said, said
    stack.wait(lambda: "go: it came" in stack.log(), "what is said of the request of the console")
    assert stack.events(UserRequest) == []
    assert "TAKEOFF" not in stack.commands()
    stack.wait_state("READY")
    assert stack.ask("go")[0] == 1
    stack.wait_state("MISSION")


@stalls.add("land", mission="long")
def connections_that_say_nothing_keep_no_command_out(stack: Stack) -> None:
    stack.wait_state("MISSION")
    place = urlparse(rosgraph.Master("/test").lookupService(f"/{stack.name}/autonomy/command"))
    assert place.hostname is not None
    with contextlib.ExitStack() as opened:
        for _ in range(3):
            opened.enter_context(socket.create_connection((place.hostname, place.port or 0), timeout=5.0))
        asked_ns = time.monotonic_ns()
        assert stack.ask("land")[0] == 1
        assert time.monotonic_ns() - asked_ns < allowed_s(1.0, asked_ns / 1e9) * 1e9
    stack.wait_state("MISSION_ENDED")


if __name__ == "__main__":
    stalls.main("amaze_autonomy", "stalls")
