#!/usr/bin/env python3
"""What the watchdog costs over twenty topics: CPU, memory, and where the time goes.

    watchdog_load.py [--seconds 20] [--json FILE]

Two IMUs at 200 Hz, two cameras 640x480 (300 kB) at 20 Hz, sixteen topics of 1 to 100 Hz. Measured on the running node
from outside; parts by leaving them out; beside it what rospy's own subscribers of AnyMsg take for the same topics, and
what it costs to look at all stamps, and at the content of every picture. The status is 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

import rospy

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from roscore import Roscore  # noqa: E402
from watchdog_bench import Topic, WatchdogBench, usage  # noqa: E402

CPU_PERCENT, MEMORY_MB = 10.0, 65.0
SETTLE_S = 2.0
IMUS: List[Topic] = [(f"/imu{number}", "imu", 200.0) for number in range(2)]
CAMERAS: List[Topic] = [(f"/camera{number}", "image", 20.0) for number in range(2)]
RATES = (1.0, 1.0, 2.0, 5.0, 5.0, 10.0, 10.0, 20.0, 20.0, 25.0, 30.0, 50.0, 50.0, 50.0, 100.0, 100.0)
OTHERS: List[Topic] = [(f"/sensor{number}", "range", rate_hz) for number, rate_hz in enumerate(RATES)]
ALL = IMUS + CAMERAS + OTHERS

_ROSPY = """
import sys, rospy
rospy.init_node("bare", disable_signals=True)
def count(message): pass
for topic in sys.argv[1:]: rospy.Subscriber(topic, rospy.AnyMsg, count, tcp_nodelay=True)
rospy.spin()
"""


def measure(pid: int, seconds: float) -> Tuple[float, float]:
    """Return (percent of a core, resident MB) of a process over a time."""
    time.sleep(SETTLE_S)
    began_s, (before, _) = time.monotonic(), usage(pid)
    time.sleep(seconds)
    after, memory_mb = usage(pid)
    return 100.0 * (after - before) / (time.monotonic() - began_s), memory_mb


def watchdog(topics: Sequence[Topic], seconds: float, more: Optional[Dict[str, str]] = None) -> Tuple[float, float]:
    with WatchdogBench(topics, more) as bench:
        return measure(bench.watchdog.pid, seconds)


def with_rospy(topics: Sequence[Topic], seconds: float) -> Tuple[float, float]:
    """Return what bare rospy takes that only counts."""
    with WatchdogBench(topics) as bench:
        bare = subprocess.Popen([sys.executable, "-c", _ROSPY, *(topic for topic, _, _ in topics)])
        bench.processes.append(bare)
        return measure(bare.pid, seconds)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    stamps = {topic: ", stamp_tolerance_s: 0.5" for topic, _, _ in ALL}
    pictures = {topic: ", unchanged_limit_s: 30.0" for topic, _, _ in CAMERAS}
    numbers = {topic: ", finite: true" for topic, _, _ in IMUS}
    cases: List[Tuple[str, Any]] = [
        ("all twenty topics", lambda: watchdog(ALL, options.seconds)),
        ("one topic at 1 Hz: the node itself", lambda: watchdog(OTHERS[:1], options.seconds)),
        ("the two IMUs", lambda: watchdog(IMUS, options.seconds)),
        ("the two cameras", lambda: watchdog(CAMERAS, options.seconds)),
        ("the sixteen others", lambda: watchdog(OTHERS, options.seconds)),
        ("all, every stamp looked at", lambda: watchdog(ALL, options.seconds, stamps)),
        ("all, every picture compared", lambda: watchdog(ALL, options.seconds, pictures)),
        ("all, numbers of the IMUs finite", lambda: watchdog(ALL, options.seconds, numbers)),
        ("bare rospy, AnyMsg, all", lambda: with_rospy(ALL, options.seconds)),
        ("bare rospy, AnyMsg, the two cameras", lambda: with_rospy(CAMERAS, options.seconds)),
    ]
    results: Dict[str, Any] = {}
    with Roscore():
        rospy.init_node("bench", disable_signals=True)
        for name, case in cases:
            cpu, memory_mb = case()
            results[name] = {"cpu_percent": round(cpu, 2), "memory_mb": round(memory_mb, 1)}
            print(f"{name:38} {cpu:6.2f} % of a core  {memory_mb:5.1f} MB", flush=True)
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n")
    whole = results["all twenty topics"]
    return 0 if whole["cpu_percent"] < CPU_PERCENT and whole["memory_mb"] < MEMORY_MB else 1


if __name__ == "__main__":
    sys.exit(main())
