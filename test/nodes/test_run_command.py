"""Commands of the configuration: no shell, their status, their limit, and nothing left behind."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.nodes.watchdog.restarter import Outcome, run_command


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


def test_a_daemon_that_it_leaves_behind_is_not_waited_for():
    code = "import subprocess, sys; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(20)'])"
    assert run_command(python(code), 15.0).good is True
