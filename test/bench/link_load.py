"""CPU of the link at 450 messages a second: a connection and its client on UDP, fed a recorded PX4's mix of messages.

    python test/bench/link_load.py [--rate 450] [--seconds 20] [--all]

--all decodes every message. Needs the recordings (AMAZE_DATA).
"""

from __future__ import annotations

import argparse
import os
import resource
import socket
import subprocess
import sys
import time
from pathlib import Path

from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.autopilot.link.framing import read_tlog
from amaze_autonomy.autopilot.vehicle.client import CLIENT_MESSAGES, AutopilotClient
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.monitoring.specs import BatterySpec

DATA = Path(os.environ.get("AMAZE_DATA", Path(__file__).parents[3] / "shared" / "data"))
LOG = DATA / "px4_normal_mission.tlog"


def feed(port: int, rate: float) -> None:
    """Send the recorded frames of the vehicle, each as a datagram, again and again."""
    frames = [frame.raw for _, frame in read_tlog(LOG)[0] if (frame.system, frame.component) == (1, 1)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        began, sent = time.monotonic(), 0
        while True:
            due = int((time.monotonic() - began) * rate)
            for number in range(sent, due):
                sender.sendto(frames[number % len(frames)], ("127.0.0.1", port))
            sent = due
            time.sleep(0.001)


def measure(rate: float, seconds: float, *, everything: bool) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    client = AutopilotClient(AutopilotSettings(), BatterySpec(cells=4), lambda: (1, 1))
    wanted = None if everything else CLIENT_MESSAGES
    link = Connection(f"udpin:127.0.0.1:{port}", Identity(1, 191), client, wanted=wanted)
    link.start()
    feeder = subprocess.Popen([sys.executable, __file__, "--feed", str(port), "--rate", str(rate)])
    try:
        deadline_s = time.monotonic() + 60.0  # the recording is read first
        while link.state.heartbeat_ns is None:
            if time.monotonic() > deadline_s:
                raise SystemExit("link_load: no heartbeat came")
            time.sleep(0.05)
        before, frames, wall = _cpu_s(), link.state.frames, time.monotonic()
        time.sleep(seconds)
        took, frames, wall = _cpu_s() - before, link.state.frames - frames, time.monotonic() - wall
    finally:
        feeder.kill()
        feeder.wait()
        link.close()
    size_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{frames / wall:.0f} messages/s, {'all' if everything else 'wanted ones'} decoded: "
        f"{100 * took / wall:.1f} % of one core, {1e6 * took / max(frames, 1):.0f} us each, {size_mb:.0f} MB"
    )


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--rate", type=float, default=450.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--feed", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.feed is not None:
        feed(options.feed, options.rate)
    measure(options.rate, options.seconds, everything=options.all)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
