"""The command `amaze-autonomy vehicle`: serves until it is told to end; a mistake is one line."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from udp_tools import Client, free_port

pytestmark = pytest.mark.live

COMMAND = [sys.executable, "-m", "amaze_autonomy.simulation.px4_udp"]


@pytest.mark.parametrize(
    "number, autopilot", [(signal.SIGINT, "px4"), (signal.SIGTERM, "px4"), (signal.SIGTERM, "ardupilot")]
)
def test_it_serves_until_it_is_told_to_end(number, autopilot):
    port = free_port()
    arguments = ["--link", f"udpin:127.0.0.1:{port}", "--system", "7", "--no-transmitter", "--autopilot", autopilot]
    process = subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == f"vehicle: system 7, udpin:127.0.0.1:{port}\n"
        with Client(port) as client:
            heartbeat = client.hear("HEARTBEAT")
            assert (heartbeat.get_srcSystem(), heartbeat.autopilot) == (7, {"px4": 12, "ardupilot": 3}[autopilot])
    finally:
        process.send_signal(number)
        assert process.wait(10) == 0
        process.stdout.close()


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--link", "udpin:nowhere"], "names no host and port"),
        (["--home", "47"], "must be latitude,longitude,altitude"),
        (["--home", "nan,8,400"], "must be latitude,longitude,altitude"),
        (["--system", "0"], "--system 0: must be 1 to 255"),
        (["--faults", "gsp"], "did you mean gps?"),
        (["--set", "autopilot.nonsense=1"], "nonsense"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(arguments, words):
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=20, check=False)
    assert (done.returncode, len(done.stderr.splitlines()), done.stdout) == (2, 1, ""), done.stderr
    assert words in done.stderr
