"""A check that is asked while its node starts: what is unknown comes by itself, what failed does not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rospy")

import rospy

from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.events import Check, Verdict
from amaze_autonomy.paths import config_folder
from amaze_autonomy.ros.clock import SimulatedClock
from amaze_autonomy.ros.errors import StartError
from amaze_autonomy.ros.node_main import Startup, flag, seconds, whole_number

S = 1_000_000_000
ROWS = (Check("age", Verdict.UNKNOWN), Check("tilt", Verdict.FAIL), Check("rate", Verdict.PASS))
COMING = (Check("age", Verdict.UNKNOWN, heals=True), *ROWS[1:])


@pytest.fixture
def startup(monkeypatch):
    def make(given=None):
        monkeypatch.setattr(rospy, "get_param", lambda _name, otherwise: otherwise if given is None else given)
        configuration = load_configuration(Path(config_folder()), ("autonomy.checks.watchdog_startup_time_s=7.0",))
        return Startup(configuration, SimulatedClock(lambda: 100 * S))

    return make


def test_what_is_unknown_comes_by_itself_for_the_configured_time(startup):
    assert startup().rows(107 * S - 1, ROWS) == COMING
    assert startup().rows(107 * S, ROWS) == ROWS


def test_the_parameter_is_before_the_configuration(startup):
    assert startup(2).rows(102 * S - 1, ROWS) == COMING
    assert startup(2.0).rows(102 * S, ROWS) == ROWS


@pytest.mark.parametrize("nonsense", [-1.0, True, "soon", float("nan"), 1e9])
def test_what_is_no_time_does_not_start(startup, nonsense):
    with pytest.raises(StartError, match="startup_time"):
        startup(nonsense)


@pytest.mark.parametrize(
    "read, good, nonsense",
    [
        (lambda: flag("drivers", default=False), True, ["yes", 1, None, [True]]),
        (lambda: seconds("hover", 1.0, 60.0), 60, [60.1, -1, "soon", True, float("nan"), None]),
        (lambda: whole_number("seed", 0), -3, ["abc", 1.5, True, None]),
    ],
)
def test_a_parameter_that_is_not_of_its_kind_is_refused_by_its_name(monkeypatch, read, good, nonsense):
    monkeypatch.setattr(rospy, "get_param", lambda _name, _otherwise: good)
    assert read() == good
    for value in nonsense:
        monkeypatch.setattr(rospy, "get_param", lambda _name, _otherwise, value=value: value)
        with pytest.raises(StartError, match=r"^~(drivers|hover|seed) is .*, must be "):
            read()


@pytest.mark.live
@pytest.mark.parametrize("node", ["autonomy", "watchdog", "simulation", "recorded_peers"])
def test_an_address_that_no_master_can_have_is_refused_at_once(node, tmp_path):
    program = Path(__file__).parents[2] / "scripts" / node
    environment = {**os.environ, "ROS_MASTER_URI": "127.0.0.1:11977", "ROS_HOME": str(tmp_path)}
    ended = subprocess.run(
        [sys.executable, str(program)], env=environment, capture_output=True, text=True, timeout=60.0, check=False
    )
    said = f"{node}: ROS_MASTER_URI is '127.0.0.1:11977'; must be http://HOST:PORT\n"
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", said)


@pytest.mark.live
@pytest.mark.parametrize("node", ["autonomy", "watchdog", "simulation"])
def test_ctrl_c_in_the_wait_for_a_master_ends_a_node_without_a_traceback(node, tmp_path):
    program = Path(__file__).parents[2] / "scripts" / node
    environment = {**os.environ, "ROS_MASTER_URI": "http://localhost:1", "ROS_HOME": str(tmp_path)}
    with (tmp_path / "said").open("wb") as said:
        started = subprocess.Popen([sys.executable, "-u", str(program)], env=environment, stdout=said, stderr=said)
    try:
        until = time.monotonic() + 60.0
        while b"register with master node" not in (tmp_path / "said").read_bytes() and time.monotonic() < until:
            time.sleep(0.05)
        started.send_signal(signal.SIGINT)
        status = started.wait(60.0)
    finally:
        started.kill()
        started.wait()
    lines = (tmp_path / "said").read_text().splitlines()
    assert (status, len(lines)) == (0, 1), lines
    assert "register with master node" in lines[0]
