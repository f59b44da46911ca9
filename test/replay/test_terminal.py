"""At a terminal: colours and a progress bar. Everywhere else: plain text."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys

from replay_bags import ROOT, flight_rows, write_bag


def at_a_terminal(arguments):
    """Run `amaze-replay` at a terminal of its own; return exit status and what it printed there."""
    main, other = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "TERM": "xterm-256color", "COLUMNS": "200"}
    command = [sys.executable, "-m", "amaze_autonomy.tester.command", *arguments]
    process = subprocess.Popen(command, env=environment, stdin=other, stdout=other, stderr=other)
    os.close(other)
    printed = b""
    while True:
        try:
            part = os.read(main, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        printed += part
    os.close(main)
    return process.wait(timeout=60), printed.decode()


def test_a_terminal_shows_colours_progress_and_speed(tmp_path, flight_map):
    bag = write_bag(tmp_path / "x.bag", flight_rows(silent={"/imu": (20.0, 20.6)}))
    status, printed = at_a_terminal(["run", str(bag), "--map", flight_map])
    assert status == 0
    assert "replaying" in printed
    assert re.search(r"replayed in \d+\.\d\d s, \d+ x real time", printed)
    land = next(line for line in printed.splitlines() if "MISSION -> LAND" in line)
    assert "\x1b[1;31m" in land
    after = next(line for line in printed.splitlines() if "LAND/descending" in line)
    assert "\x1b[2" in after


def test_plain_text_has_no_escape_sequences(tmp_path, flight_map):
    bag = write_bag(tmp_path / "x.bag", flight_rows(4.0))
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "FORCE_COLOR": "1"}
    command = [sys.executable, "-m", "amaze_autonomy.tester.command", "run", str(bag), "--map", flight_map]
    done = subprocess.run(command, env=environment, capture_output=True, timeout=60, check=True)
    assert b"\x1b" not in done.stdout + done.stderr
