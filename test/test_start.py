"""How a command and a node are started, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"


def run(folder, main, start="start_command", *, ignored=False):
    """Start the main of a module; `interrupt` is there for it."""
    interrupt = "import os, signal\ndef interrupt(): os.kill(os.getpid(), signal.SIGINT)\n"
    (folder / "started.py").write_text(interrupt + main)
    code = f"from amaze_autonomy.start import {start} as start; raise SystemExit(start('started'))"
    return subprocess.run(
        ["env", f"--{'ignore' if ignored else 'default'}-signal=INT", sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{SOURCE}"},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.parametrize("start, status", [("start_command", 130), ("start_node", 0)])
@pytest.mark.parametrize(
    "main",
    [
        "interrupt()",
        "try:\n    interrupt()\nexcept BaseException: pass\ndef main(): return 5",
        "def main():\n    interrupt()",
    ],
    ids=["loaded", "lost", "begun"],
)
def test_ctrl_c_ends_it_quietly(tmp_path, main, start, status):
    done = run(tmp_path, main, start)
    assert (done.returncode, done.stdout, done.stderr) == (status, "", "")


def test_what_ignores_ctrl_c_goes_on(tmp_path):
    done = run(tmp_path, "interrupt()\ndef main():\n    interrupt()\n    return 5", ignored=True)
    assert (done.returncode, done.stderr) == (5, "")


def test_the_main_hears_it_as_always_and_its_status_is_that_of_the_process(tmp_path):
    main = "def main():\n    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler\n    return 3"
    assert run(tmp_path, main).returncode == 3


def test_a_mistake_is_no_end(tmp_path):
    done = run(tmp_path, "import nothing_of_that_name")
    assert done.returncode == 1
    assert "ModuleNotFoundError" in done.stderr
