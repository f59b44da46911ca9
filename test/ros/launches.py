#!/usr/bin/env python3
"""The whole launch file: ends by itself after a mission, and lands when roslaunch is told to end in flight.

Several fly at the same time. Simulated sensors are nodes and topics without a namespace, as real ones are: each launch
has others in its configuration, but for the one whose bag is replayed by the names that ship.
"""

from __future__ import annotations

import fcntl
import itertools
import json
import os
import pty
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path
from typing import Any, Callable, Optional, Sequence, Tuple

from behaviours import Behaviours
from hitches import allowed_s
from stack import HERE, QUICK, Stack

from amaze_autonomy.config import load_configuration
from amaze_autonomy.interface import SERVICES
from amaze_autonomy.tester.command import main as replay

AT_ONCE, LIMIT_S = 3, 90.0  # each starts a dozen processes
#: what a machine that starts others meanwhile may take
PATIENT = (
    *QUICK,
    "autonomy.losses.watchdog_heartbeat_limit_s=5.0",
    "autonomy.losses.planner_status_limit_s=5.0",
    "autonomy.losses.autopilot_status_limit_s=5.0",
)
launches = Behaviours()
_number = itertools.count()


def free_ports() -> int:
    """Return a UDP port that is free, as is the one after it: for the links of autopilot and planner."""
    while True:
        with socket.socket(type=socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as other:
            one.bind(("127.0.0.1", 0))
            port = int(one.getsockname()[1])
            try:
                other.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


def own_sensors(stack: Stack) -> Path:
    """Return the configuration of a stack with names of its own for every sensor."""
    folder, first = stack.folder / "config", f"/n{next(_number)}/"
    shutil.copytree(stack.config, folder)
    path = folder / "sensors.yaml"
    text = re.sub(r"(?m)^([^#\n]*?) /(?=\w)", rf"\1 {first}", path.read_text())
    # Many launches start at once here: a sensor whose process has to wait for the machine has not failed.
    patient = "age_limit_s: 5.0, tolerance_fraction: 0.65}"
    path.write_text(re.sub(r"age_limit_s: [\d.]+(, tolerance_fraction: [\d.]+)?}", patient, text))
    return folder


class Terminal:
    """A terminal of its own, whose text goes to the log of a stack until it is closed."""

    def __init__(self, stack: Stack) -> None:
        self._master, self.slave = pty.openpty()
        self._log = (stack.folder / "autonomy.log").open("ab")
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._copy, daemon=True)
        self._thread.start()

    def _copy(self) -> None:
        while not self._closing.is_set():
            if select.select([self._master], [], [], 0.1)[0]:
                self._log.write(os.read(self._master, 65536))
                self._log.flush()

    def take(self) -> None:
        """Become the controlling terminal of the calling process, the leader of a new session."""
        fcntl.ioctl(self.slave, termios.TIOCSCTTY, 0)

    def close(self) -> None:
        """Hang up."""
        self._closing.set()
        self._thread.join()
        os.close(self.slave)
        os.close(self._master)


LAUNCH = HERE.parents[1] / "launch" / "autonomy.launch"
GROUP = '<launch><group ns="{}"><include file="{}" pass_all_args="true">{}</include></group></launch>'
FOREIGN = """\
import rospy, std_msgs.msg, std_srvs.srv
rospy.init_node("{0}")
said = rospy.Publisher("~state", std_msgs.msg.String, latch=True, queue_size=1)
said.publish("of another stack")
rospy.Service("~start", std_srvs.srv.Trigger, lambda _: std_srvs.srv.TriggerResponse())
rospy.spin()
"""


def in_group(stack: Stack, arguments: Sequence[str]) -> Path:
    """Return a launch file that includes ours in a group, as a stack that exists would."""
    given = "".join('<arg name="{}" value="{}"/>'.format(*word.split(":=", 1)) for word in arguments)
    path = stack.folder / "group.launch"
    path.write_text(GROUP.format(stack.name, LAUNCH, given))
    return path


def roslaunch(
    stack: Stack, *arguments: str, terminal: Optional[Terminal] = None, group: bool = False
) -> subprocess.Popen[bytes]:
    """Start the launch file of the package in the namespace of a stack."""
    command = ["roslaunch", "--screen", str(LAUNCH), "simulation:=true", "console:=false"]
    config = stack.config
    if "record:=true" not in arguments:
        config, arguments = own_sensors(stack), ("record:=false", *arguments)
    command += [f"output:={stack.output}", f"config:={config}", f"overrides:={'; '.join(PATIENT)}", *arguments]
    environment = {**os.environ, "ROS_NAMESPACE": f"/{stack.name}"}
    if group:
        command, environment = ["roslaunch", "--screen", str(in_group(stack, command[3:]))], dict(os.environ)
    if terminal is not None:
        out = terminal.slave
        process = subprocess.Popen(
            command,
            env=environment,
            stdin=out,
            stdout=out,
            stderr=out,
            start_new_session=True,
            preexec_fn=terminal.take,  # noqa: PLW1509
        )
    else:
        with (stack.folder / "autonomy.log").open("ab") as log:
            process = subprocess.Popen(command, env=environment, stdout=log, stderr=log, start_new_session=True)
    stack.engine, stack.launched = process, True
    return process


def wait(stack: Stack, condition: Callable[[], Any], what: str) -> None:
    """Wait as an operator does: checks that fail while the machine is busy are asked for again."""

    def look() -> Any:
        found = condition()
        if not found:
            stack.retry()
        return found

    stack.wait(look, what, LIMIT_S, alive=False)


def in_flight(stack: Stack) -> None:
    wait(stack, lambda: stack.state == "MISSION" or not stack.engine_lives, "MISSION")
    assert stack.engine_lives, "it ended before"


def ended(stack: Stack) -> None:
    wait(stack, lambda: not stack.engine_lives, "the end of the launch")


def whole_launch_lands(stack: Stack, number: int) -> None:
    process = roslaunch(stack, "mission:=long", "flight:=simulated", f"received:={stack.folder / 'received.jsonl'}")
    in_flight(stack)
    told_ns = time.monotonic_ns()
    process.send_signal(number)
    ended(stack)
    delays = stack.routes_after(told_ns)
    assert set(delays) == {"LAND", "autopilot/land"}, f"landing was sent by {set(delays)} only"
    assert all(delay < allowed_s(1.0, told_ns / 1e9) for delay in delays.values()), f"landing was sent after {delays}"
    assert stack.result()["exit_status"] == 8
    assert "LAND was sent" in stack.log()


@launches.add(processes=(), start=False)
def sigint_to_the_whole_launch_in_flight_lands(stack: Stack) -> None:
    whole_launch_lands(stack, signal.SIGINT)


@launches.add(processes=(), start=False)
def sigterm_to_the_whole_launch_in_flight_lands(stack: Stack) -> None:
    whole_launch_lands(stack, signal.SIGTERM)


@launches.add(processes=(), start=False)
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


@launches.add(processes=(), start=False)
def autopilot_and_planner_land_when_the_whole_launch_is_told_to_end_in_flight(stack: Stack) -> None:
    process = roslaunch(stack, "mission:=long", f"mavlink_port:={free_ports()}")
    in_flight(stack)
    process.send_signal(signal.SIGINT)
    ended(stack)
    assert stack.result()["exit_status"] == 8
    assert "mission_planner: ended in flight" in stack.log()
    assert "autopilot: ended in flight" in stack.log()


@launches.add(processes=(), start=False)
def launch_ends_by_itself_after_the_mission(stack: Stack) -> None:
    ports = f"mavlink_port:={free_ports()}"
    roslaunch(stack, "mission:=hop", "exit_when_ended:=true", "processes:=forked", ports)
    ended(stack)
    result = stack.result()
    assert (result["exit_status"], result["result"], result["state"]) == (0, "COMPLETE", "MISSION_ENDED")
    assert result["data"]
    assert "MISSION_ENDED" in (stack.output / "report.txt").read_text()
    for name in ("bag", "journal", "report"):
        assert f"autonomy: {name}" in stack.log()


def told(stack: Stack, namespace: str, *words: str) -> Tuple[int, str]:
    """Run a command of the package in a namespace; return its exit status and what it printed."""
    command = ["amaze-autonomy", *words]
    environment = {**os.environ, "ROS_NAMESPACE": namespace}
    done = subprocess.run(command, env=environment, cwd=stack.folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout or done.stderr


def looked_at(stack: Stack) -> None:
    """What the doctor says of the stack, and of the other one; a configuration of what runs is good."""
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
def every_node_in_a_group_beside_another_stack_ends_with_one_verified_bag_that_replays(stack: Stack) -> None:
    """The other stack has nodes /autonomy and /watchdog, with topics and services of other types."""
    others = [subprocess.Popen([sys.executable, "-c", FOREIGN.format(name)]) for name in ("autonomy", "watchdog")]
    try:
        port = f"mavlink_port:={free_ports()}"
        roslaunch(stack, "mission:=hop", "exit_when_ended:=true", "record:=true", "require_go:=true", port, group=True)
        wait(stack, lambda: stack.state == "READY", "READY")
        looked_at(stack)
        wait(stack, lambda: stack.state == "READY" and stack.ask("go")[0] == 1, "the go")
        ended(stack)
        assert [process.poll() for process in others] == [None, None], "another stack's node was taken over"
    finally:
        for process in others:
            process.kill()
            process.wait()
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
    assert replay(["journal", str(bag)]) == 0
    assert replay(["run", str(bag), "--map", "amaze_demo", "--config", str(stack.config)]) == 0


if __name__ == "__main__":
    launches.main("amaze_autonomy", "launches", at_once=AT_ONCE)
