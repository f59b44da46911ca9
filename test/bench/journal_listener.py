#!/usr/bin/env python3
"""What a new listener of `~journal` costs an engine with a long journal: `~state` meanwhile, and memory.

    journal_listener.py [--megabytes 80] [--json FILE]

The engine resumes a journal that was filled up with statuses. Then `~state` is listened to for ten seconds without, and
until a new listener has the whole journal with it: the longest silence of either, the engine's memory before and after.
The status is 1 when a target is missed.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from pathlib import Path
from typing import Dict, List, Optional

import rospy

from amaze_autonomy.engine.events import AutopilotStatus
from amaze_autonomy.journal.journal import encode_event, read

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from latency import NODE, Node  # noqa: E402
from roscore import Roscore  # noqa: E402

from amaze_autonomy import msg  # noqa: E402

SILENCE_TARGET_S, MEMORY_TARGET_MB, QUIET_S, LIMIT_S = 1.0, 30.0, 10.0, 600.0


class States:
    """Notes when each `~state` came."""

    def __init__(self) -> None:
        self.came_s: List[float] = []
        rospy.Subscriber(f"{NODE}/autonomy/state", msg.AutonomyState, self._note, tcp_nodelay=True)

    def _note(self, _: object) -> None:
        self.came_s.append(time.monotonic())

    def longest_s(self, since_s: float) -> float:
        """Return the longest silence since then, and until now."""
        times = [since_s, *(at_s for at_s in self.came_s if at_s > since_s), time.monotonic()]
        return max(after - before for before, after in zip(times, times[1:]))


def fill(journal: Path, megabytes: int) -> int:
    """Append statuses to a journal until it is so long; return how many lines it has then."""
    text = journal.read_text(encoding="utf-8")
    found = (line.payload for line in reversed(read(text[: text.rfind("\n") + 1]).lines))
    status = next(payload for payload in found if isinstance(payload, AutopilotStatus))
    line = encode_event(status) + "\n"
    with journal.open("a", encoding="utf-8") as out:
        for _ in range((megabytes << 20) // len(line)):
            out.write(line)
    with journal.open("rb") as file:
        return sum(1 for _ in file)


def memory_mb(process: int) -> float:
    """Return what a process has in memory."""
    fields = dict(line.split(":", 1) for line in Path(f"/proc/{process}/status").read_text().splitlines())
    return int(fields["VmRSS"].split()[0]) / 1024


def measure(node: Node, journal: Path, megabytes: int) -> Dict[str, float]:
    """Fill the journal of a killed engine, start it again, and listen."""
    node.peers.wait(lambda: '"event":"AutopilotStatus"' in journal.read_text(encoding="utf-8"), "a status")
    node.process.kill()
    node.process.wait()
    lines = fill(journal, megabytes)
    began_s = time.monotonic()
    states = States()
    node.start()
    node.peers.wait(lambda: bool(states.came_s) and states.came_s[-1] > began_s, "the first ~state", LIMIT_S)
    found = {"lines": float(lines), "resumed_s": time.monotonic() - began_s}
    since_s = time.monotonic()
    time.sleep(QUIET_S)
    found.update(alone_silence_s=states.longest_s(since_s), alone_mb=memory_mb(node.process.pid))
    entries = 0

    def count(_: object) -> None:
        nonlocal entries
        entries += 1

    since_s, most_mb = time.monotonic(), 0.0
    rospy.Subscriber(f"{NODE}/autonomy/journal", msg.JournalEntry, count)
    while entries < lines:
        if time.monotonic() > since_s + LIMIT_S:
            raise SystemExit(f"journal_listener: {entries} of {lines} lines had come after {LIMIT_S:g} s")
        time.sleep(0.2)
        most_mb = max(most_mb, memory_mb(node.process.pid))
    found.update(listening_silence_s=states.longest_s(since_s), listening_mb=most_mb, took_s=time.monotonic() - since_s)
    return found


def main(arguments: Optional[List[str]] = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megabytes", type=int, default=80)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    with Roscore() as home:
        rospy.init_node("bench", disable_signals=True)
        node = Node(Path(home))
        try:
            found = measure(node, Path(home) / "run" / "journal.jsonl", options.megabytes)
        finally:
            node.process.send_signal(signal.SIGINT)
            node.process.wait(LIMIT_S)
        rospy.signal_shutdown("done")
    print(f"journal   {options.megabytes} MB, {found['lines']:.0f} lines, decided again in {found['resumed_s']:.1f} s")
    print(f"alone     longest silence of ~state {found['alone_silence_s']:.2f} s   memory {found['alone_mb']:.0f} MB")
    print(f"listener  longest silence of ~state {found['listening_silence_s']:.2f} s   memory", end=" ")
    print(f"{found['listening_mb']:.0f} MB   whole after {found['took_s']:.0f} s", end="   ")
    print(f"targets {SILENCE_TARGET_S:g} s, {MEMORY_TARGET_MB:g} MB more")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    more_mb = found["listening_mb"] - found["alone_mb"]
    return 0 if found["listening_silence_s"] <= SILENCE_TARGET_S and more_mb <= MEMORY_TARGET_MB else 1


if __name__ == "__main__":
    sys.exit(main())
