"""Commands of the configuration: no shell, their status, their limit, and nothing left behind."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.nodes.watchdog import node
from amaze_autonomy.nodes.watchdog.node import Outcome, run_command


def python(code):
    return [sys.executable, "-c", code]


def test_status_0_is_good_with_its_last_line():
    assert run_command(python("print('one'); print('two')"), 10.0) == Outcome(good=True, message="two")


def test_another_status_is_not():
    outcome = run_command(python("import sys; print('no device', file=sys.stderr); sys.exit(3)"), 10.0)
    assert outcome == Outcome(good=False, message=f"{sys.executable} ended with status 3: no device")


def test_a_signal_is_not():
    outcome = run_command(python("import os; os.kill(os.getpid(), 9)"), 10.0)
    assert outcome == Outcome(good=False, message=f"{sys.executable} ended with signal 9")


def test_no_shell_looks_at_the_arguments():
    assert run_command(["echo", "$HOME;", "a", "|", "cat"], 10.0) == Outcome(good=True, message="$HOME; a | cat")


def test_what_does_not_exist_cannot_be_run():
    outcome = run_command(["/no/such/program"], 10.0)
    assert outcome == Outcome(good=False, message="/no/such/program cannot be run: No such file or directory")


def lives(pid):
    try:
        return "State:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def test_what_takes_too_long_ends_with_its_children(tmp_path):
    number = tmp_path / "child"
    began_s = time.monotonic()
    outcome = run_command(["/bin/sh", "-c", f"sleep 60 & echo $! >'{number}'; wait"], 1.0)
    assert outcome == Outcome(good=False, message="/bin/sh took longer than 1 s")
    assert time.monotonic() - began_s < 30.0
    child = int(number.read_text())
    while lives(child):
        assert time.monotonic() - began_s < 30.0, "a child goes on"
        time.sleep(0.01)


@pytest.mark.parametrize("code", ["while True: print('x' * 1000)", "import time; time.sleep(60)"])
def test_the_limit_holds_however_much_it_says(code):
    began_s = time.monotonic()
    assert run_command(python(code), 0.3).good is False
    assert time.monotonic() - began_s < 10.0


DAEMON = """
import subprocess, sys
print("begun", flush=True)
subprocess.Popen([sys.executable, "-c", '''
import pathlib, time
while not pathlib.Path("go").exists():
    time.sleep(0.01)
print("x" * 1000000, flush=True)
pathlib.Path("said").touch()
'''])
"""
"""A command that leaves a daemon behind, which says more than a pipe holds when it is told to go on."""


def test_what_a_daemon_that_it_leaves_behind_says_is_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_command(python(DAEMON), 15.0) == Outcome(good=True, message="begun")
    go_on(tmp_path)


def test_a_daemon_that_it_leaves_behind_goes_on_when_the_watchdog_has_ended(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = "import sys; from amaze_autonomy.nodes.watchdog.node import run_command; run_command(sys.argv[1:], 15)"
    subprocess.run([*python(code), *python(DAEMON)], check=True, timeout=60)
    go_on(tmp_path)


def go_on(folder):
    """Tell the daemon to say much, and wait until it has said it."""
    (folder / "go").touch()
    began_s = time.monotonic()
    while not (folder / "said").exists():
        assert time.monotonic() - began_s < 30.0, "the daemon has died of what it said"
        time.sleep(0.01)


def test_who_read_a_daemon_that_has_ended_is_no_zombie_for_ever(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_command(python(DAEMON), 15.0)
    reader = node._READERS[-1]
    go_on(tmp_path)
    assert reader.wait(30.0) == 0
    run_command(["/bin/sh", "-c", "sleep 0.5 &"], 10.0)
    assert reader not in node._READERS


def test_a_daemon_that_nobody_can_read_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(node, "_READER", ("/no/such/program",))
    told = "begun; what it left running may end with its next output: nobody reads it"
    assert run_command(python(DAEMON), 15.0) == Outcome(good=True, message=told)
    (tmp_path / "go").touch()


def test_a_daemon_that_it_leaves_behind_is_not_waited_for():
    code = "import subprocess, sys; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(20)'])"
    assert run_command(python(code), 15.0).good is True
