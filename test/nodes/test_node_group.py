"""Nodes as forks of one process: each with its own name and log, killed alone, started again, ended together."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import termios
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from waiting import wait_for

pytest.importorskip("rospy")

from amaze_autonomy.nodes.autonomy import node
from amaze_autonomy.nodes.node_group import NODES, arguments_of

LIMIT_S = 60.0
PROGRAM = """
import os, signal, sys, threading, types
from pathlib import Path
from amaze_autonomy.nodes import node_group
from amaze_autonomy.ros import node_main

def stand_in(node):
    def main():
        told = threading.Event()
        signal.signal(signal.SIGINT, lambda *_: told.set())
        path = Path(sys.argv[-1]) / f"{node}.{os.getpid()}"
        path.with_suffix(path.suffix + ".words").write_text(str(len(node_main._waiting)))
        path.write_text(" ".join(sys.argv[1:-1]))
        while not told.wait(0.05):
            pass
        path.with_suffix(".ended").touch()
        return 0
    module = types.ModuleType(node)
    module.main = main
    sys.modules[f"amaze_autonomy.nodes.{node_group.NODES[node]}"] = module

folder = sys.argv.pop()
for node in node_group.NODES:
    stand_in(node)
arguments_of = node_group.arguments_of
node_group.arguments_of = lambda *given: [*arguments_of(*given), folder]
raise SystemExit(node_group.main())
"""


def test_a_node_has_a_name_and_a_log_of_its_own_and_everything_else_of_the_group():
    words = ["--config", "/home/Jörg/a b", "--folder", "/data"]
    own = ["a:=b", "__name:=node_group", "__log:=/var/log/node_group-3.log", "_nice:=0"]
    given = ["watchdog", "r=data_recorder", *words, *own]
    assert arguments_of("watchdog", "watchdog", given) == [
        "--config=/home/Jörg/a b",
        "__name:=watchdog",
        "a:=b",
        "__log:=/var/log/watchdog-node_group-3.log",
        "_nice:=0",
    ]
    assert arguments_of("r", "data_recorder", given)[:3] == ["--config=/home/Jörg/a b", "--folder=/data", "__name:=r"]


def test_the_launch_file_forks_every_node_that_may_be_in_a_group():
    folder = Path(__file__).parents[2]
    launch = ET.parse(folder / "launch" / "autonomy.launch").getroot()
    (forked,) = [arg.get("value") for arg in launch.iter("arg") if arg.get("name") == "_forked"]
    assert set(re.findall(r"'(\w+) '", forked)) | {"data_recorder"} == set(NODES)
    assert "'=data_recorder'" in forked
    assert {name for name in NODES if (folder / "scripts" / name).exists()} == set(NODES)


@pytest.mark.parametrize("processes, memory, said", [("separate", 1e9, 1), ("separate", 4e9, 0), ("forked", 1e9, 0)])
def test_forks_are_proposed_where_memory_is_little(monkeypatch, processes, memory, said):
    warnings = []
    monkeypatch.setattr(node.rospy, "get_param", lambda _name, _default: processes)
    monkeypatch.setattr(node.rospy, "logwarn", lambda *words: warnings.append(words))
    monkeypatch.setattr(node.os, "sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": memory / 4096}.__getitem__)
    node._propose_forks()
    assert len(warnings) == said


def test_what_is_no_node_is_said():
    for arguments, status, words in (
        (["steering"], 2, "there is no node steering; name some of autopilot"),
        ([], 2, "no node is named"),
        (["watchdog", "--folder", "/data"], 2, "no node of it takes --folder"),
        (["watchdog", "--help"], 0, "--word value"),
        (["watchdog", "--help"], 0, "Nodes: autopilot"),
    ):
        code = "from amaze_autonomy.nodes.node_group import main; raise SystemExit(main())"
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, timeout=120
        )
        assert (done.returncode, words in (done.stderr or done.stdout)) == (status, True)


@pytest.fixture
def group(tmp_path):
    """Start a group of two stand-ins that leave their traces in a folder; return its process."""
    groups = []

    def start(stderr):
        arguments = ["watchdog", "autopilot", "__name:=node_group", str(tmp_path)]
        command = [sys.executable, "-c", PROGRAM, *arguments]
        groups.append(subprocess.Popen(command, stderr=stderr, start_new_session=True))
        wait_for(lambda: started(tmp_path, "watchdog") and started(tmp_path, "autopilot"))
        return groups[-1]

    yield start
    for each in groups:
        if each.poll() is None:
            os.killpg(each.pid, signal.SIGKILL)
            each.wait()


def started(folder, node):
    return {int(path.suffix[1:]) for path in folder.glob(f"{node}.*[0-9]") if path.read_text()}


def kill_watchdog(folder):
    """Kill the one that runs; return its process once it is started again."""
    before = started(folder, "watchdog")
    os.kill(max(before, key=lambda pid: (folder / f"watchdog.{pid}").stat().st_mtime_ns), signal.SIGKILL)
    wait_for(lambda: started(folder, "watchdog") > before)
    (again,) = started(folder, "watchdog") - before
    return again


ENDED = ["autopilot.ended", "watchdog.ended"]


@pytest.mark.live
def test_a_node_that_is_killed_is_started_again_alone_and_all_end_together(tmp_path, group):
    with (tmp_path / "said").open("wb") as said:
        running = group(said)
    autopilot = started(tmp_path, "autopilot")
    again = kill_watchdog(tmp_path)
    assert started(tmp_path, "autopilot") == autopilot, "it goes on"
    assert (tmp_path / f"watchdog.{again}").read_text() == "__name:=watchdog"
    running.send_signal(signal.SIGINT)
    assert running.wait(LIMIT_S) == 0
    assert sorted(path.name for path in tmp_path.glob("*.ended")) == ENDED
    assert (tmp_path / "said").read_text() == "node_group: watchdog has ended (signal 9); it is started again\n"


@pytest.mark.live
def test_a_terminal_that_is_held_keeps_no_node_from_being_started_again_and_the_group_from_no_end(tmp_path, group):
    """By Ctrl-S: who writes to it waits until it is let go on."""
    outside, inside = os.openpty()
    termios.tcflow(inside, termios.TCOOFF)
    running = group(inside)
    for _ in range(2):
        kill_watchdog(tmp_path)
    running.send_signal(signal.SIGINT)
    assert running.wait(LIMIT_S) == 0
    assert sorted(path.name for path in tmp_path.glob("*.ended")) == ENDED
    os.close(inside)
    os.close(outside)


@pytest.mark.live
def test_what_was_not_said_to_a_terminal_that_was_held_is_said_when_it_is_let_go_on(tmp_path, group):
    outside, inside = os.openpty()
    termios.tcflow(inside, termios.TCOOFF)
    group(inside)
    kill_watchdog(tmp_path)
    termios.tcflow(inside, termios.TCOON)
    assert os.read(outside, 1000) == b"node_group: watchdog has ended (signal 9); it is started again\r\n"
    os.close(inside)
    os.close(outside)


@pytest.mark.live
def test_a_terminal_that_is_closed_ends_no_group(tmp_path, group):
    outside, inside = os.openpty()
    running = group(inside)
    os.close(inside)
    os.close(outside)
    for _ in range(2):
        kill_watchdog(tmp_path)
    running.send_signal(signal.SIGINT)
    assert running.wait(LIMIT_S) == 0
    assert sorted(path.name for path in tmp_path.glob("*.ended")) == ENDED


@pytest.mark.live
def test_a_node_of_a_group_has_words_of_its_own(tmp_path, group):
    """What the group has still to say is not what its fork waits for at its end: who writes that is not in it."""
    outside, inside = os.openpty()
    termios.tcflow(inside, termios.TCOOFF)
    group(inside)
    again = kill_watchdog(tmp_path)
    assert (tmp_path / f"watchdog.{again}.words").read_text() == "0"
    os.close(inside)
    os.close(outside)
