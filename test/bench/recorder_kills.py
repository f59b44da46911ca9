"""Kill recorders and their nodes at random moments of one recording, and count what is lost in the end.

    python test/bench/recorder_kills.py [--kills 20] [--seed 1]

Two platforms record 200 numbered messages a second each. Every kill is a SIGKILL of a recorder, or of a node with half
a second without it, at a random moment and on a random platform. Then the recording is collected; every number that is
missing is known.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "ros")]

import rospy  # noqa: E402
from one_node import wait_for  # noqa: E402
from recorder import PHASE, PLATFORMS, RATE_HZ, Recorders, holes  # noqa: E402
from roscore import Roscore  # noqa: E402

GROUPS = {"main": "one", "second": "two"}


def grow(recorders: Recorders) -> None:
    """Wait until every platform records again."""
    seen = len(recorders.statuses)
    wait_for(lambda: len(recorders.statuses) > seen + 2, "a status")
    wait_for(lambda: all(each.growing for each in recorders.status.platforms), "growth on all platforms")


def kill(recorders: Recorders, what: str, platform: str) -> None:
    """Kill a recorder or a node; wait for nothing."""
    if what == "recorder":
        os.kill(recorders.process(platform, GROUPS[platform]), signal.SIGKILL)
        return
    recorders.nodes[platform].kill()
    recorders.nodes[platform].wait()
    time.sleep(0.5)
    recorders.start_node(platform)
    rospy.wait_for_service(f"/{recorders.name}/{platform}/data_recorder/stop", 20.0)


def main() -> int:
    """Run it; 1 when more was lost than the recorders that were killed did not write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance, killed = random.Random(options.seed), {"recorder": 0, "node": 0}
    with Roscore():
        rospy.init_node("recorder_kills", disable_signals=True)
        recorders = Recorders("kills")
        try:
            for platform in PLATFORMS:
                recorders.start_node(platform)
            assert recorders.ask("start").accepted
            recorders.wait_phase(PHASE.RECORDING)
            for _ in range(options.kills):
                time.sleep(chance.uniform(0.2, 2.0))
                what, platform = chance.choice(("recorder", "node")), chance.choice(PLATFORMS)
                kill(recorders, what, platform)
                killed[what] += 1
                grow(recorders)
            assert recorders.ask("stop").accepted
            status = recorders.wait_phase(PHASE.COMPLETE, 60.0)
            lost = {platform: holes(recorders.received(platform)) for platform in PLATFORMS}
        finally:
            recorders.close()
    gaps = [gap for platform in PLATFORMS for gap in lost[platform]]
    print(
        f"killed: {killed['recorder']} recorders, {killed['node']} nodes; {RATE_HZ} messages/s on each of 2 platforms"
    )
    print(f"gaps: {len(gaps)}, of {sorted(gaps)} messages; {status.message}")
    return 0 if len(gaps) <= killed["recorder"] else 1


if __name__ == "__main__":
    sys.exit(main())
