#!/usr/bin/env python3
"""What the autonomy node costs in flight: processor and memory, beside a bare rospy node that listens to the same.

    load.py [--seconds 20] [--json FILE]

All statuses come at their usual rates; ~state and ~journal are listened to, as by a recorder. The status is 1 when a
target is missed.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict

import rospy

from amaze_autonomy import msg

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from latency import NODE, Node  # noqa: E402
from roscore import Roscore  # noqa: E402

CPU_PERCENT, MEMORY_MB = 2.0, 60.0
_TICKS = os.sysconf("SC_CLK_TCK")


def processor_s(pid: int) -> float:
    """Return the processor time that a process has used, user and system, in seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def memory_mb(pid: int) -> float:
    """Return the memory of a process that is in use (resident), in MB of 10^6 bytes."""
    line = next(line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) * 1024 / 1e6


def measure(processes: Dict[str, int], seconds: float) -> Dict[str, Dict[str, float]]:
    before = {name: processor_s(pid) for name, pid in processes.items()}
    began = time.monotonic()
    time.sleep(seconds)
    took = time.monotonic() - began
    return {
        name: {"cpu_percent": 100.0 * (processor_s(pid) - before[name]) / took, "memory_mb": memory_mb(pid)}
        for name, pid in processes.items()
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with Roscore() as home:
        rospy.init_node("bench", disable_signals=True)
        node = Node(Path(home))
        bare = subprocess.Popen([sys.executable, str(HERE / "bare_node.py"), NODE], start_new_session=True)
        for name, kind in (("state", msg.AutonomyState), ("journal", msg.JournalEntry)):
            rospy.Subscriber(f"{NODE}/autonomy/{name}", kind, lambda _: None)
        try:
            node.peers.wait_for_listeners(2)
            node.take_off()
            found = measure({"autonomy": node.process.pid, "bare": bare.pid}, options.seconds)
            node.land()
        finally:
            for process in (node.process, bare):
                process.send_signal(signal.SIGINT)
                process.wait(20.0)
        rospy.signal_shutdown("done")
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    print(f"in flight, {options.seconds:.0f} s{'':12}{'CPU, % of a core':>18}{'memory, MB':>14}")
    for name, numbers in found.items():
        print(f"{name:28}{numbers['cpu_percent']:18.2f}{numbers['memory_mb']:14.1f}")
    ours = found["autonomy"]
    good = ours["cpu_percent"] < CPU_PERCENT and ours["memory_mb"] < MEMORY_MB
    print(f"targets: {CPU_PERCENT} %, {MEMORY_MB} MB: {'met' if good else 'MISSED'}")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
