#!/usr/bin/env python3
"""The whole launch file: ends by itself after a mission, and lands when roslaunch is told to end in flight.

Several fly at the same time (`launching.py`).
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
import xmlrpc.client
from pathlib import Path
from typing import Any, Callable, Tuple

import rosgraph
from behaviours import Behaviours
from cns_stand_ins import MODULES, StandIns
from hitches import allowed_s
from launching import (
    AT_ONCE,
    LIMIT_S,
    PATIENT,
    Terminal,
    back,
    ended,
    flown,
    free_ports,
    go_at_the_page,
    in_flight,
    names_outside,
    pid_of,
    process,
    roslaunch,
    rows,
    wait,
)
from pymavlink.dialects.v20 import common as mavlink
from stack import Stack
from stand_ins import Watchdog

from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.events import UserCommand, UserRequest
from amaze_autonomy.interface import SERVICES
from amaze_autonomy.tester.command import main as replay

launches = Behaviours()
OF_A_FLIGHT = ("autonomy", "watchdog", "landing_detection", "state_estimation", "autopilot", "mission_planner")
WRITTEN = {"journal.jsonl", "report.txt", "result.json", "flight.html", "parts.json", "effective.json"}
WRITTEN |= {"NAME.bag", "NAME.manifest.json", "states-01.bag", "states.log", "sensors.yaml"}
FOREIGN = """\
import rospy, std_msgs.msg, std_srvs.srv
rospy.init_node("{0}")
said = rospy.Publisher("~state", std_msgs.msg.String, latch=True, queue_size=1)
said.publish("of another stack")
rospy.Service("~start", std_srvs.srv.Trigger, lambda _: std_srvs.srv.TriggerResponse())
rospy.spin()
"""


def whole_launch_lands(stack: Stack, number: int) -> None:
    launch = roslaunch(stack, "mission:=long", "flight:=simulated", f"received:={stack.folder / 'received.jsonl'}")
    in_flight(stack)
    told_ns = time.monotonic_ns()
    launch.send_signal(number)
    ended(stack)
    delays = stack.routes_after(told_ns)
    assert set(delays) == {"LAND", "autopilot/land"}, f"landing was sent by {set(delays)} only"
    assert all(delay < allowed_s(1.0, told_ns / 1e9) for delay in delays.values()), f"landing was sent after {delays}"
    assert stack.result()["exit_status"] == 8
    assert "LAND was sent" in stack.log()


@launches.add(processes=(), start=False, night=True)
def sigint_to_the_whole_launch_in_flight_lands(stack: Stack) -> None:
    whole_launch_lands(stack, signal.SIGINT)


@launches.add(processes=(), start=False, night=True)
def sigterm_to_the_whole_launch_in_flight_lands(stack: Stack) -> None:
    whole_launch_lands(stack, signal.SIGTERM)


@launches.add(processes=(), start=False, night=True)
def sighup_to_the_whole_launch_in_flight_lands(stack: Stack) -> None:
    whole_launch_lands(stack, signal.SIGHUP)


@launches.add(processes=(), start=False)
def terminal_that_is_closed_in_flight_lands(stack: Stack) -> None:
    """The kernel sends SIGHUP, and nobody can write a word to people any more."""
    terminal = Terminal(stack)
    roslaunch(
        stack, "mission:=long", "flight:=simulated", f"received:={stack.folder / 'received.jsonl'}", terminal=terminal
    )
    in_flight(stack)
    told_ns = time.monotonic_ns()
    terminal.close()
    ended(stack)
    assert set(stack.routes_after(told_ns)) == {"LAND", "autopilot/land"}
    assert stack.result()["exit_status"] == 8


@launches.add(processes=(), start=False, night=True)
def terminal_whose_output_is_held_in_flight_holds_up_nothing_else(stack: Stack) -> None:
    """Ctrl-S, or a connection that hangs: every node that writes a line to it waits, until Ctrl-Q."""
    terminal = Terminal(stack)
    with flown(stack, "mission:=long", terminal=terminal) as vehicle:
        in_flight(stack)
        terminal.hold()
        vehicle.say(mavlink.MAVLink_statustext_message(mavlink.MAV_SEVERITY_WARNING, b"Compass needs calibration"))
        for command, state in (("hold", "HOLD"), ("resume", "MISSION"), ("land", "LAND")):
            stack.ask(command)
            stack.wait_state(state, limit_s=LIMIT_S)
        stack.wait_state("MISSION_ENDED", limit_s=LIMIT_S)
        assert vehicle.modes[-1] == "AUTO.LAND"
        terminal.go_on()
    assert "PILOT" not in stack.passed, stack.passed
    assert {each.name for each in stack.states[-1].failures} == set()


@launches.add(processes=(), start=False)
def autopilot_and_planner_land_when_the_whole_launch_is_told_to_end_in_flight(stack: Stack) -> None:
    launch = roslaunch(stack, "mission:=long", f"mavlink_port:={free_ports()}")
    in_flight(stack)
    launch.send_signal(signal.SIGINT)
    ended(stack)
    assert stack.result()["exit_status"] == 8
    assert "mission_planner: ended in flight" in stack.log()
    assert "autopilot: ended in flight" in stack.log()


@launches.add(processes=(), start=False, night=True)
def launch_with_the_watchdog_of_cns_ends_by_itself_after_the_mission(stack: Stack) -> None:
    """That one is in a namespace of its own; all other nodes are ours, forked."""
    components = tuple(each.name for each in load_configuration(stack.config).components)
    watchdog = Watchdog(None, components, startup_s=2.0)
    theirs = StandIns([watchdog], f"/cns_of_{stack.name}")
    theirs.start()
    cns = ("cns_peers:=watchdog", f"cns_namespace:=/cns_of_{stack.name}")
    nodes = (*cns, "processes:=forked", f"mavlink_port:={free_ports()}")
    roslaunch(stack, "mission:=hop", "exit_when_ended:=true", *nodes, modules=MODULES)
    ended(stack)
    theirs.end()
    assert [key for key, _ in watchdog.calls] == ["watchdog_start"]
    assert "nodes of the CNS Flight Stack are the engine's watchdog" in stack.log()
    result = stack.result()
    assert (result["exit_status"], result["result"], result["state"]) == (0, "COMPLETE", "MISSION_ENDED")
    assert result["data"] == "", "a simulated recorder has no file"
    assert "MISSION_ENDED" in (stack.output / "report.txt").read_text()
    for name in ("bag", "journal", "report"):
        assert f"autonomy: {name}" in stack.log()


@launches.add(processes=(), start=False, night=True)
def sighup_to_the_engine_in_flight_lands(stack: Stack) -> None:
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        os.kill(pid_of(stack, "autonomy"), signal.SIGHUP)
        ended(stack)
        assert stack.result()["exit_status"] == 8
        assert "ended by SIGHUP IN FLIGHT" in stack.log()
        assert vehicle.modes[-1] == "AUTO.LAND"


@launches.add(processes=(), start=False)
def mission_selected_at_once_waits_for_its_nodes_and_for_the_vehicle(stack: Stack) -> None:
    patient = ("autonomy.checks.watchdog_startup_time_s=30.0",)
    with flown(stack, "require_go:=true", overrides=patient, on=False) as vehicle:
        stack.select("hop")
        stack.wait(lambda: "no vehicle heard yet" in stack.log(), "an autopilot node without a vehicle", LIMIT_S)
        stack.wait_state("PREFLIGHT")
        vehicle.switch_on()
        stack.wait_state("READY", "OUTREACH", limit_s=LIMIT_S)
        assert "OUTREACH" not in stack.passed, stack.states[-1].message


@launches.add(processes=(), start=False)
def node_group_that_is_killed_in_flight_costs_the_mission_not_the_landing(stack: Stack) -> None:
    """Its nodes fly on; the group that roslaunch starts then replaces each, and an autopilot node that ends lands."""
    with flown(stack, "mission:=long", "exit_when_ended:=true", "processes:=forked") as vehicle:
        in_flight(stack)
        group = parent_of(pid_of(stack, "watchdog"))
        assert group == parent_of(pid_of(stack, "autopilot")), "a fork has another parent"
        os.kill(group, signal.SIGKILL)
        ended(stack)
        assert vehicle.modes[-1] == "AUTO.LAND"
        assert (stack.result()["state"], stack.result()["in_flight"]) == ("MISSION_ENDED", False)


@launches.add(processes=(), start=False, night=True)
def checks_that_are_killed_in_flight_come_back_alone_and_the_mission_goes_on(stack: Stack) -> None:
    with flown(stack, "mission:=long"):
        in_flight(stack)
        for node in ("landing_detection", "state_estimation"):
            before = {each: pid_of(stack, each) for each in OF_A_FLIGHT}
            os.kill(before[node], signal.SIGKILL)
            stack.wait(lambda name=node, was=before[node]: back(stack, name, was), f"{node} again", LIMIT_S)
            after = {each: pid_of(stack, each) for each in OF_A_FLIGHT}
            assert [each for each in OF_A_FLIGHT if after[each] != before[each]] == [node]
        assert stack.state == "MISSION", [each.rule for each in stack.decisions()]


@launches.add(processes=(), start=False, night=True)
def watchdog_that_is_killed_in_flight_ends_the_mission_with_a_landing(stack: Stack) -> None:
    landed_after_a_kill(stack, "watchdog")


@launches.add(processes=(), start=False)
def planner_that_is_killed_in_flight_ends_the_mission_with_a_landing(stack: Stack) -> None:
    landed_after_a_kill(stack, "mission_planner")


@launches.add(processes=(), start=False)
def autopilot_node_that_is_killed_in_flight_ends_the_mission_with_a_landing(stack: Stack) -> None:
    landed_after_a_kill(stack, "autopilot")


def landed_after_a_kill(stack: Stack, node: str) -> None:
    """Kill a node: it is started again, and our engine lands the vehicle, which is not left to a pilot."""
    with flown(stack, "mission:=long") as vehicle:
        in_flight(stack)
        was = pid_of(stack, node)
        os.kill(was, signal.SIGKILL)
        stack.wait(lambda: back(stack, node, was), f"{node} again", LIMIT_S)
        stack.wait_state("MISSION_ENDED", limit_s=LIMIT_S)
        assert vehicle.modes[-1] == "AUTO.LAND"
    assert "PILOT" not in stack.passed, stack.passed
    assert not stack.states[-1].in_flight


@launches.add(processes=(), start=False)
def planner_and_autopilot_node_land_when_the_engine_is_killed_in_flight_and_the_launch_ends(stack: Stack) -> None:
    """The engine is required: roslaunch ends all others with it, as it does when the engine hangs for good."""
    with flown(stack, "mission:=long", "exit_when_ended:=true") as vehicle:
        in_flight(stack)
        os.kill(pid_of(stack, "autonomy"), signal.SIGKILL)
        ended(stack)
        assert vehicle.modes[-1] == "AUTO.LAND"
    assert "mission_planner: ended in flight" in stack.log()
    assert "autopilot: ended in flight" in stack.log()


@launches.add(processes=(), start=False, night=True)
def planner_that_the_master_ends_in_flight_lands_and_is_not_taken_for_a_pilot(stack: Stack) -> None:
    """As `rosnode kill`, or a node that takes its name."""

    def end(uri: str) -> None:
        with contextlib.suppress(OSError):  # it may end before it answers
            xmlrpc.client.ServerProxy(uri).shutdown("/test", "another node has its name")

    lands_by_itself(stack, "mission_planner", end)


@launches.add(processes=(), start=False, night=True)
def autopilot_node_that_is_told_to_end_in_flight_lands_and_is_not_taken_for_a_pilot(stack: Stack) -> None:
    lands_by_itself(stack, "autopilot", lambda _: os.kill(pid_of(stack, "autopilot"), signal.SIGTERM))


def lands_by_itself(stack: Stack, node: str, end: Callable[[str], None]) -> None:
    """Have a node end in flight: the landing that it begins is ours, and nobody is told to fly."""
    with flown(stack, "mission:=long", "exit_when_ended:=true") as vehicle:
        in_flight(stack)
        end(rosgraph.Master("/test").lookupNode(f"/{stack.name}/{node}"))
        ended(stack)
        assert vehicle.modes[-1] == "AUTO.LAND"
    assert f"{node}: ended in flight: the vehicle" in stack.log()
    assert "PILOT" not in stack.passed, stack.passed
    assert stack.result()["state"] == "MISSION_ENDED"


NODES = ("autonomy", "watchdog", "autopilot", "mission_planner")
PROBE = """\
import contextlib, os
with contextlib.suppress(OSError):
    os.setpriority(os.PRIO_PROCESS, 0, -10)
with contextlib.suppress(OSError), open("/proc/self/autogroup", "w") as group:
    group.write("-10")
print(os.getpid(), flush=True)
input()
"""


def niceness(pid: int) -> str:
    """Return that of a process, and that of its session where the kernel groups by it."""
    try:
        session = Path(f"/proc/{pid}/autogroup").read_text(encoding="ascii").split()[-1:]
    except OSError:
        session = []
    return f"{os.getpriority(os.PRIO_PROCESS, pid)} {session}"


def permitted() -> str:
    """Return what this platform lets a process with a session of its own have of -10."""
    probe = subprocess.Popen(
        [sys.executable, "-c", PROBE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    )
    assert probe.stdout is not None
    pid = int(probe.stdout.readline())
    try:
        return niceness(pid)
    finally:
        probe.communicate(b"\n")


@launches.add(processes=(), start=False, night=True)
def nodes_that_decide_take_the_precedence_that_is_permitted(stack: Stack) -> None:
    with flown(stack):
        stack.wait_state("MISSION_INPUT", limit_s=LIMIT_S)
        wanted = permitted()
        for node in NODES:
            stack.wait(lambda name=node: niceness_of(stack, name) == wanted, f"{node} at {wanted}", LIMIT_S)
        assert wanted.startswith("-10") or "was not permitted" in stack.log()


def parent_of(pid: int) -> int:
    """Return the process that started another."""
    return int(Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[1])


def niceness_of(stack: Stack, node: str) -> str:
    with contextlib.suppress(Exception):  # it is not there yet
        return niceness(pid_of(stack, node))
    return ""


AHEAD = "import time\nwall, wall_ns = time.time, time.time_ns\n"
AHEAD += "time.time = lambda: wall() + 1.0\ntime.time_ns = lambda: wall_ns() + 1_000_000_000\n"


@launches.add(processes=(), start=False, night=True)
def clock_of_another_computer_that_is_a_second_ahead_is_named_before_takeoff(stack: Stack) -> None:
    """The watchdog runs elsewhere: a process beside the launch, whose wall clock is moved as it starts."""
    (stack.folder / "sitecustomize.py").write_text(AHEAD)
    path = f"{stack.folder}:{os.environ['PYTHONPATH']}"
    words = ("--config", str(stack.folder / "config"), "--overrides", "; ".join(PATIENT))
    watchdog = ("rosrun", "amaze_autonomy", "watchdog", "__name:=watchdog", *words)
    with flown(stack, "watchdog:=false", "mission:=hop", "require_go:=true"):
        with process(*watchdog, ROS_NAMESPACE=f"/{stack.name}", PYTHONPATH=path):
            apart = lambda: [row for row in rows(stack, "clocks: watchdog") if row.verdict == row.FAIL]  # noqa: E731
            row = wait(stack, apart, "the row")[0]
            assert (round(row.value), row.advice) == (-1, "set the clocks of both computers by chrony")
            wait(stack, lambda: "clocks: stamps of the watchdog are" in stack.log(), "why it is not ready")
            assert stack.commands() == []
        with process(*watchdog, ROS_NAMESPACE=f"/{stack.name}"):
            wait(stack, lambda: stack.state == "READY", "READY")
            assert apart() == []


def told(stack: Stack, namespace: str, *words: str) -> Tuple[int, str]:
    """Run a command of the package in a namespace; return its exit status and what it printed."""
    command = ["amaze-autonomy", *words]
    environment = {**os.environ, "ROS_NAMESPACE": namespace}
    done = subprocess.run(
        command, env=environment, cwd=stack.folder, capture_output=True, text=True, check=False, timeout=120
    )
    return done.returncode, done.stdout or done.stderr


def looked_at(stack: Stack) -> None:
    """What the doctor says of the stack, and of the other one; a configuration of what runs is good."""
    files = [re.sub("#.*", "", path.read_text()) for path in stack.config.glob("*.yaml")]
    configured = {name for text in files for name in re.findall(r"/[\w/]+", text)}
    outside = names_outside(stack)
    assert {"/rosout"} <= outside <= configured, outside - configured
    doctor = ("doctor", str(stack.config), "--for", "3", "--json")
    _, text = told(stack, f"/{stack.name}", *doctor)
    found = [(each["about"], each["said"]) for each in json.loads(text)["findings"]]
    for name, service in SERVICES.items():
        words = (
            f"/{stack.name}/{name} is offered by /{stack.name}/{service.peer}"  # the recorder's has its platform, too
        )
        assert any(about == service.peer and said.startswith(words) for about, said in found), found
    said = [words for about, words in found if about == "imu"]
    assert all(words.startswith("/px4/imu of /") for words in said), said
    status, text = told(stack, "/", *doctor)
    wrong = [each["said"] for each in json.loads(text)["findings"] if each["level"] == "wrong"]
    assert "/watchdog/start of /watchdog is std_srvs/Trigger, asked is amaze_autonomy/StartWatchdog" in wrong, wrong
    assert status == 1
    status, text = told(stack, "/", "propose-config", "--live", "--for", "3", "--output", "proposed")
    assert status == 0, text
    assert {"imu", "gps", "lrf"} <= set(
        load_configuration(stack.folder / "proposed").effective["sensors"]["components"]
    )


@launches.add(processes=(), start=False)
def every_node_in_a_group_beside_another_stack_flies_two_missions_with_a_verified_bag_each(stack: Stack) -> None:
    """The other stack has nodes /autonomy and /watchdog, with topics and services of other types."""
    others = [subprocess.Popen([sys.executable, "-c", FOREIGN.format(name)]) for name in ("autonomy", "watchdog")]
    try:
        page = ("web:=true", "web_port:=0", f"web_token_file:={stack.folder / 'web_token'}")
        nodes = (*page, "record:=true", "processes:=forked", f"mavlink_port:={free_ports()}")
        roslaunch(stack, "mission:=hop,hop", "exit_when_ended:=true", "require_go:=true", *nodes, group=True)
        wait(stack, lambda: stack.state == "READY", "READY")
        looked_at(stack)
        given = go_at_the_page(stack)
        wait(stack, lambda: stack.state == "READY" and stack.states[-1].session_id.endswith("-002"), "READY again")
        given += go_at_the_page(stack)
        ended(stack)
        assert [each.poll() for each in others] == [None, None], "another stack's node was taken over"
    finally:
        for each in others:
            each.kill()
            each.wait()
    heard = [each for each in stack.events(UserRequest) if each.command is UserCommand.GO]
    assert 2 <= len(heard) <= given, "each was sent three times"
    result = stack.result()
    bag = Path(result["data"])
    assert (result["exit_status"], result["result"]) == (0, "COMPLETE")
    assert result["data_summary"].endswith(" messages of main and second, verified; nothing was lost"), result
    assert f"The data is at {bag} ({result['data_summary']})." in stack.log()
    manifest = json.loads(bag.with_suffix(".manifest.json").read_text())
    assert manifest["verified"]["ok"] is True
    assert sorted(manifest["platforms"]) == ["main", "second"]
    assert (bag.parent / "journal.jsonl").read_bytes() == (stack.output / "journal.jsonl").read_bytes()
    assert (bag.parent / "configuration" / "effective.json").is_file()
    assert replay(["run", str(bag), "--map", "amaze_demo", "--config", str(stack.config)]) == 0
    each_has_its_page_and_its_journal(stack, bag.parent.parent)
    first = next(bag.parent.parent.glob("*-001_hop/*.bag"))  # the next begins with what the recorder must catch up with
    assert replay(["journal", str(first)]) == 0, "the recorder was starved, and has lost lines of the journal"


def each_has_its_page_and_its_journal(stack: Stack, recordings: Path) -> None:
    """Of two missions the first, which was followed by the other at once, has all that it has when it is alone."""
    whole = (stack.output / "journal.jsonl").read_bytes()
    folders = sorted(path.parent for path in recordings.glob("*/*.manifest.json"))
    assert len(folders) == 2, folders
    for number, folder in enumerate(folders, 1):
        journal = (folder / "journal.jsonl").read_bytes()
        assert whole.startswith(journal), "it is another one's"
        assert replay(["journal", str(folder / "journal.jsonl")]) == 0
        assert journal.count(b'"after":"MISSION_ENDED"') == number, "its end is missing"
        stack.wait(
            lambda folder=folder: (folder / "flight.html").is_file(), f"the page of {folder}", 120.0, alive=False
        )
    shown = [state.result for before, state in zip(stack.states, stack.states[1:]) if ends(before, state)]
    assert shown == ["COMPLETE", "COMPLETE"], "who looked has not seen each result"
    written = {re.sub(r"\d{8}T\d+-\d+_hop", "NAME", path.name) for path in stack.check_modes()}
    assert written >= WRITTEN, WRITTEN - written


def ends(before: Any, state: Any) -> bool:
    """Tell whether a mission ended between two states that were published."""
    return bool(state.state == "MISSION_ENDED" and before.state != state.state)


if __name__ == "__main__":
    launches.main("amaze_autonomy", "launches", at_once=AT_ONCE)
