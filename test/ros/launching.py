"""The whole launch file, started by a test in a namespace, with ports and sensors of its own; as its operator sees it.

Simulated sensors are nodes and topics without a namespace, as real ones are: each launch has others in its
configuration, but for the one whose bag is replayed by the names that ship.
"""

from __future__ import annotations

import asyncio
import contextlib
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
import termios
import threading
import uuid
import xmlrpc.client
from pathlib import Path
from typing import Any, Callable, Iterator, List, NamedTuple, Optional, Sequence, Set

import rosgraph
from modes import PERMISSIVE, started_under
from px4_vehicle import Px4Vehicle
from stack import HERE, QUICK, Stack
from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import websocket_connect

AT_ONCE, LIMIT_S = 3, 90.0  # each starts a dozen processes
#: what a machine that starts others meanwhile may take
PATIENT = (
    *QUICK,
    "autonomy.checks.watchdog_startup_time_s=30.0",
    "autonomy.failsafe.watchdog_heartbeat_limit_s=5.0",
    "autonomy.failsafe.planner_status_limit_s=5.0",
    "autonomy.failsafe.autopilot_status_limit_s=5.0",
)
LAUNCH = HERE.parents[1] / "launch" / "autonomy.launch"
ARRANGEMENT = f"processes:={os.environ.get('AMAZE_PROCESSES', 'separate')}"
"""Of each launch that does not name one: launches.test has a process for each node, lies.test forks of one process, and
`./run test-ros swapped` the other way round."""
GROUP = '<launch><group ns="{}"><include file="{}" pass_all_args="true">{}</include></group></launch>'
_number = itertools.count()


# --- what is its own --------------------------------------------------------------------------------------------------


def free_ports() -> int:
    """Return a UDP port that is free, as are the two after it: for autopilot, planner, and who only looks."""
    while True:
        with contextlib.ExitStack() as opened:
            first = 0
            try:
                for number in range(3):
                    one = opened.enter_context(socket.socket(type=socket.SOCK_DGRAM))
                    one.bind(("127.0.0.1", first + number if first else 0))
                    first = first or int(one.getsockname()[1])
            except OSError:
                continue
            return first


def own_configuration(stack: Stack, *, sensors: bool) -> Path:
    """Return the configuration of a stack, patient; `sensors`: with names of its own for every sensor."""
    folder, first = stack.folder / "config", f"/n{next(_number)}/"
    shutil.copytree(stack.config, folder)
    path = folder / "sensors.yaml"
    if sensors:
        path.write_text(re.sub(r"(?m)^([^#\n]*?) /(?=\w)", rf"\1 {first}", path.read_text()))
    make_patient(path)
    return folder


def make_patient(sensors: Path) -> None:
    """Have no sensor fail whose process waits for the machine, where a dozen processes start at once."""
    patient = "age_limit_s: 5.0, tolerance_fraction: 0.65}"
    sensors.write_text(re.sub(r"age_limit_s: [\d.]+(, tolerance_fraction: [\d.]+)?}", patient, sensors.read_text()))


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

    def hold(self) -> None:
        """Press Ctrl-S: whoever writes to it waits."""
        termios.tcflow(self.slave, termios.TCOOFF)

    def go_on(self) -> None:
        """Press Ctrl-Q."""
        termios.tcflow(self.slave, termios.TCOON)

    def close(self) -> None:
        """Hang up."""
        self._closing.set()
        self._thread.join(10.0)
        os.close(self.slave)
        os.close(self._master)


# --- start ------------------------------------------------------------------------------------------------------------


def _in_group(stack: Stack, arguments: Sequence[str]) -> Path:
    """Return a launch file that includes ours in a group, as a stack that exists would."""
    given = "".join('<arg name="{}" value="{}"/>'.format(*word.split(":=", 1)) for word in arguments)
    path = stack.folder / "group.launch"
    path.write_text(GROUP.format(stack.name, LAUNCH, given))
    return path


def roslaunch(
    stack: Stack,
    *arguments: str,
    overrides: Sequence[str] = (),
    terminal: Optional[Terminal] = None,
    group: bool = False,
    modules: str = "",
) -> subprocess.Popen[bytes]:
    """Start the launch file of the package in the namespace of a stack; `modules` is put in front of its PYTHONPATH."""
    command = ["roslaunch", "--screen", str(LAUNCH), "simulation:=true", "console:=false"]
    recorded = "record:=true" in arguments
    stack.config = own_configuration(stack, sensors=not recorded)
    if not recorded:
        arguments = ("record:=false", *arguments)
    command += [f"output:={stack.output}", f"config:={stack.config}", f"overrides:={'; '.join((*PATIENT, *overrides))}"]
    command += [] if any(word.startswith("processes:=") for word in arguments) else [ARRANGEMENT]
    command += arguments
    path = os.pathsep.join(filter(None, (modules, os.environ.get("PYTHONPATH", ""))))
    environment = {**os.environ, "PYTHONPATH": path, "ROS_NAMESPACE": f"/{stack.name}"}
    if group:
        command = ["roslaunch", "--screen", str(_in_group(stack, command[3:]))]
        del environment["ROS_NAMESPACE"]
    command = started_under(PERMISSIVE, command)
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


@contextlib.contextmanager
def flown(
    stack: Stack,
    *arguments: str,
    overrides: Sequence[str] = (),
    on: bool = True,
    key: bytes = b"",
    terminal: Optional[Terminal] = None,
) -> Iterator[Px4Vehicle]:
    """Start it with every real node and a PX4 that the test holds; `on`: that one speaks from the beginning.

    With a key for signing, both sides have it.
    """
    port = free_ports()
    vehicle = Px4Vehicle(*(f"udpout:127.0.0.1:{port + number}" for number in range(3)), on=on, key=key)
    links = ("vehicle:=external", f"vehicle_url:=udpin:127.0.0.1:{port + 2}", f"mavlink_port:={port}")
    if key:
        path = stack.folder / "mavlink.key"
        path.touch(0o600)
        path.write_text(key.hex())
        overrides = (*overrides, *(f"autopilot.{link}.key_file={path}" for link in ("link", "planner_link")))
    received = f"received:={stack.folder / 'received.jsonl'}"
    overrides = ("sensors.battery.cells=6", *overrides)
    roslaunch(stack, *links, received, *arguments, overrides=overrides, terminal=terminal)
    try:
        yield vehicle
    finally:
        vehicle.stop()


# --- as its operator --------------------------------------------------------------------------------------------------


def wait(stack: Stack, condition: Callable[[], Any], what: str) -> Any:
    """Wait as an operator does: checks that fail while the machine is busy are asked for again."""

    def look() -> Any:
        found = condition()
        if not found:
            stack.retry()
        return found

    return stack.wait(look, what, LIMIT_S, alive=False)


def in_flight(stack: Stack) -> None:
    wait(stack, lambda: stack.state == "MISSION" or not stack.engine_lives, "MISSION")
    assert stack.engine_lives, "it ended before"


def ended(stack: Stack) -> None:
    wait(stack, lambda: not stack.engine_lives, "the end of the launch")


def pid_of(stack: Stack, node: str) -> int:
    """Return the process of a node of the launch."""
    uri = rosgraph.Master("/test").lookupNode(f"/{stack.name}/{node}")
    return int(xmlrpc.client.ServerProxy(uri).getPid("/test")[2])


def back(stack: Stack, node: str, was: int) -> bool:
    """Tell whether a node is another process than before."""
    with contextlib.suppress(OSError, xmlrpc.client.Error, rosgraph.MasterException):
        return pid_of(stack, node) != was
    return False


def names_outside(stack: Stack) -> Set[str]:
    """Return topics and services out of the namespace of a stack that its nodes publish, hear or offer."""
    inside = f"/{stack.name}/"
    every = [row for kind in rosgraph.Master("/test").getSystemState() for row in kind]
    return {
        name for name, nodes in every if not name.startswith(inside) and any(each.startswith(inside) for each in nodes)
    }


@contextlib.contextmanager
def stopped(stack: Stack, node: str) -> Iterator[None]:
    """Stop the process of a node: it does not run, and roslaunch does not start it again."""
    pid = pid_of(stack, node)
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


def rows(stack: Stack, name: str) -> List[Any]:
    """Return the rows of the checks with a name, as they are shown now."""
    return [row for row in (stack.states[-1].checks if stack.states else []) if row.name.endswith(name)]


@contextlib.contextmanager
def process(*command: str, **environment: str) -> Iterator[None]:
    """Run a process beside the launch."""
    started = subprocess.Popen(command, env={**os.environ, **environment})
    try:
        yield
    finally:
        started.kill()
        started.wait()


# --- at its page ------------------------------------------------------------------------------------------------------

_ADDRESS = re.compile(r"the operator's page: (http://127\.0\.0\.1:\d+)/#(\S+)")


class Viewed(NamedTuple):
    """What a viewer was told: whether the token is the vehicle's, the answer to its command, the states one by one."""

    known: bool
    verdict: str
    states: List[str]


def go_at_the_page(stack: Stack) -> int:
    """Give the go at the operator's page; return how often somebody with the token has given it."""
    address, token = wait(stack, lambda: _ADDRESS.search(stack.log()), "the page's address").groups()
    guest = _view(address, "a guessed token", "go")
    assert (guest.known, guest.verdict) == (False, "REFUSED")
    given: List[Viewed] = []

    def gone() -> bool:
        if stack.state == "READY":
            given.append(_view(address, token, "go"))
            assert given[-1].known
        return given != [] and given[-1].verdict == "DONE"

    wait(stack, gone, "the go")
    return len(given)


def _view(address: str, token: str, command: str) -> Viewed:
    return asyncio.run(asyncio.wait_for(_opened(address, token, command), LIMIT_S))


async def _opened(address: str, token: str, command: str) -> Viewed:
    """Load the page, send a command three times under one id, as over a bad link; what is done changes the state."""
    for part in ("", "page.js", "page.css"):
        await AsyncHTTPClient().fetch(f"{address}/{part}")
    socket = await websocket_connect(f"{address.replace('http', 'ws')}/stream")
    await socket.write_message(json.dumps({"have": {}, "token": token}))
    known, verdict, states = False, "", []
    while not verdict or (verdict == "DONE" and states[-1] == states[0]):
        text = await socket.read_message()
        assert text is not None, "the page's server has gone"
        news = json.loads(text)
        known = news.get("token", known)
        verdict = "".join(each["verdict"] for each in news.get("answers", ())) or verdict
        if "state" in news.get("parts", ()):
            states.append(news["parts"]["state"]["name"])
            if len(states) == 1:
                order = {"id": uuid.uuid4().hex, "token": token, "board": news["board"], "beat": news["beat"]}
                for _ in range(3):
                    await socket.write_message(json.dumps({"order": {**order, "seen": states[0], "command": command}}))
    socket.close()
    return Viewed(known, verdict, states)
