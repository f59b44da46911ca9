#!/usr/bin/env python3
"""How long a killed autonomy node takes in flight until it decides again; beside the start of a bare rospy node.

    resume.py [--samples 10] [--hours 3] [--json FILE]

From the birth of the new process to its first decision, both on the monotonic clock: Python, imports, configuration,
journal, connections. The bare node: until the master knows it. At last once more with a journal that was filled up with
statuses, as of so many hours of flight. The status is 1 when the target is missed, which is for a short journal.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Dict, List, Optional

import rosgraph
import rospy

from amaze_autonomy.engine.events import EngineStarted, Event
from amaze_autonomy.journal.journal import DELTA_LETTERS, DeltaEncoder, decode, read

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from latency import NODE, Node  # noqa: E402
from roscore import Roscore  # noqa: E402

TARGET_S, LIMIT_S, LIMIT_PER_HOUR_S = 2.0, 20.0, 20.0
ROUNDS_PER_HOUR = 5 * 3600
EACH_ROUNDS = {"RecordingStatus": 2, "WatchdogInfo": 5}  # all others in every round


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


def fill(journal: Path, hours: float) -> None:
    """Append to a journal the statuses of so many hours, as they were last, all within its last moment."""
    text = journal.read_text()
    events = [line.payload for line in read(text[: text.rfind("\n") + 1]).lines if isinstance(line.payload, Event)]
    last: Dict[str, Event] = {type(event).__name__: event for event in events}
    statuses, encoder = [last[name] for name in DELTA_LETTERS.values() if name in last], DeltaEncoder()
    with journal.open("a") as out:
        for number in range(int(hours * ROUNDS_PER_HOUR)):
            for status in statuses:
                if number % EACH_ROUNDS.get(type(status).__name__, 1) == 0:
                    out.write(encoder.encode(replace(status, t_ns=events[-1].t_ns + number)) + "\n")


def resumed_s(node: Node, journal: Path, hours: float = 0.0) -> float:
    """Kill the engine, start it again, return the seconds from its birth to its first decision.

    Args:
        node: the engine.
        journal: of it.
        hours: of flight that are put into it meanwhile.
    """
    known = len(starts(journal))
    node.process.kill()
    node.process.wait()
    if hours:
        fill(journal, hours)
    node.start()
    limit_s = LIMIT_S + hours * LIMIT_PER_HOUR_S
    born_s, deadline_s = birth_s(node.process), time.monotonic() + limit_s
    while len(starts(journal)) == known:
        if time.monotonic() > deadline_s:
            raise SystemExit(f"resume: the engine was not there again after {limit_s:g} s")
        time.sleep(0.5 if hours else 0.02)
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
    parser.add_argument("--hours", type=float, default=3.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    with Roscore() as home:
        rospy.init_node("bench", disable_signals=True)
        node, journal = Node(Path(home)), Path(home) / "run" / "journal.jsonl"
        try:
            node.take_off()
            pairs = [(resumed_s(node, journal), known_s(number)) for number in range(options.samples)]
            long_s = resumed_s(node, journal, options.hours) if options.hours else None
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
    found = {"autonomy_s": engine, "bare_s": bare, "hours": options.hours, "long_s": long_s}
    if long_s is not None:
        per_hour_s = (long_s - engine[middle]) / options.hours
        print(f"journal of {options.hours:g} h more   {long_s:.2f} s   for each hour {per_hour_s:.2f} s")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0 if engine[-1] <= TARGET_S else 1


if __name__ == "__main__":
    sys.exit(main())
