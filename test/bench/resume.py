#!/usr/bin/env python3
"""How long a killed autonomy node takes in flight until it decides again; beside the start of a bare rospy node.

    resume.py [--samples 10] [--json FILE]

From the birth of the new process to its first decision, both on the monotonic clock: Python, imports, configuration,
journal, connections. The bare node: until the master knows it. The status is 1 when the target is missed.
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
from typing import List, Optional

import rosgraph
import rospy

from amaze_autonomy.engine.events import EngineStarted
from amaze_autonomy.journal.journal import decode

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from latency import NODE, Node  # noqa: E402
from roscore import Roscore  # noqa: E402

TARGET_S, LIMIT_S = 2.0, 20.0


def birth_s(process: subprocess.Popen[bytes]) -> float:
    """Return when a process began, in seconds of the monotonic clock (starttime, proc(5))."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[19]) / os.sysconf("SC_CLK_TCK")


def starts(journal: Path) -> List[EngineStarted]:
    """Return every start of the engine that is on the disk."""
    text = journal.read_text()
    lines = text[: text.rfind("\n") + 1].splitlines()
    found = [decode(line).payload for line in lines if '"event":"EngineStarted","kind":"event"' in line]
    return [event for event in found if isinstance(event, EngineStarted)]


def resumed_s(node: Node, journal: Path) -> float:
    """Kill the engine, start it again, return the seconds from its birth to its first decision."""
    known = len(starts(journal))
    node.process.kill()
    node.process.wait()
    node.start()
    born_s, deadline_s = birth_s(node.process), time.monotonic() + LIMIT_S
    while len(starts(journal)) == known:
        if time.monotonic() > deadline_s:
            raise SystemExit(f"resume: the engine was not there again after {LIMIT_S:g} s")
        time.sleep(0.02)
    started = starts(journal)[-1]
    if not started.resumed:
        raise SystemExit("resume: the engine did not find its journal")
    return started.t_ns / 1e9 - born_s


def known_s(number: int) -> float:
    """Start a bare node of a new name, return the seconds from its birth until the master knows it."""
    command = [sys.executable, str(HERE / "bare_node.py"), NODE, f"__name:=bare{number}"]
    process = subprocess.Popen(command, start_new_session=True)
    try:
        master, there = rosgraph.Master("/bench"), False
        while not there:
            there = any(f"/bare{number}" in nodes for kind in master.getSystemState() for _, nodes in kind)
        return time.monotonic() - birth_s(process)
    finally:
        process.kill()  # rospy hears no signal while it registers
        process.wait()


def main(arguments: Optional[List[str]] = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=10)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    with Roscore() as home:
        rospy.init_node("bench", disable_signals=True)
        node, journal = Node(Path(home)), Path(home) / "run" / "journal.jsonl"
        try:
            node.take_off()
            pairs = [(resumed_s(node, journal), known_s(number)) for number in range(options.samples)]
            node.land()
        finally:
            node.process.send_signal(signal.SIGINT)
            node.process.wait(LIMIT_S)
        rospy.signal_shutdown("done")
    engine, bare = (sorted(column) for column in zip(*pairs))
    middle = len(engine) // 2
    print(f"autonomy  median {engine[middle]:.2f} s   slowest {engine[-1]:.2f} s   target {TARGET_S:.1f} s")
    print(
        f"bare      median {bare[middle]:.2f} s   slowest {bare[-1]:.2f} s   ratio {engine[middle] / bare[middle]:.1f}"
    )
    if options.json:
        options.json.write_text(json.dumps({"autonomy_s": engine, "bare_s": bare}, indent=1) + "\n")
    return 0 if engine[-1] <= TARGET_S else 1


if __name__ == "__main__":
    sys.exit(main())
