#!/usr/bin/env python3
"""How long `amaze-bag info` takes of a bag with very many connections: it must grow with their number, not its square.

    ./run bench many_connections [CONNECTIONS]      default: 65,536

Writes bags of a quarter, a half and all of them into memory, a message on each, and prints a table in Markdown: whole
processes, the best of three rounds. Exit status 1 when the computing for one connection grows by more than half.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

import numpy as np

from amaze_autonomy.bags.arrays import index_records
from amaze_autonomy.bags.format import Connection, connection_record, message_fields, pack_field
from amaze_autonomy.bags.write import Output

START_NS, ROUNDS = 1_600_000_000_000_000_000, 3
TYPE = ((b"type", b"a/B"), (b"md5sum", b"0" * 32), (b"message_definition", b"x"))


def write(path: Path, many: int) -> None:
    """Write a bag of one chunk with so many connections, each with a topic of its own and a message."""
    header = b"".join(pack_field(*each) for each in TYPE)
    connections = {n: Connection(n, f"/topic_{n}", "a/B", "0" * 32, "", False, header) for n in range(many)}
    records, offsets, size = [], [], 0
    for number in range(many):
        fields = message_fields(number, START_NS + number)
        described = connection_record(number, f"/topic_{number}".encode(), header)
        records += [described, len(fields).to_bytes(4, "little") + fields + bytes(4)]
        offsets.append(size + len(described))
        size += len(described) + len(records[-1])
    numbers = np.arange(many)
    with Output(path) as out:
        index = index_records(START_NS + numbers, numbers, np.array(offsets))
        counts = [(number, 1) for number in range(many)]
        out.chunk("none", size, [b"".join(records)], index, times=(START_NS, START_NS + many - 1), counts=counts)
        out.close(connections)


def info_s(path: Path, many: int) -> tuple[float, float]:
    """Return how long the command takes, and computes; it must find them all."""
    took_s, computing_s = [], []
    for _ in range(ROUNDS):
        began, before = time.perf_counter(), os.times()
        command = [sys.executable, "-m", "amaze_autonomy.bags.cli", "info", str(path)]
        said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=600).stdout
        after = os.times()
        took_s.append(time.perf_counter() - began)
        computing_s.append(after[2] + after[3] - before[2] - before[3])  # of processes that have ended
        if said.count("/topic_") != many:
            raise SystemExit(f"{said.count('/topic_'):,} of {many:,} topics were found")
    return min(took_s), min(computing_s)


def main(most: int = 65_536) -> int:
    """Measure, print, return the exit status."""
    print("| Connections | Size | `amaze-bag info` | Computing | For one |\n|---|---|---|---|---|")
    each: list[float] = []
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        for many in (most // 4, most // 2, most):
            path = Path(folder) / f"{many}.bag"
            write(path, many)
            took_s, computing_s = info_s(path, many)
            each.append(computing_s / many)
            size = f"{path.stat().st_size / 1e6:.1f} MB"
            print(f"| {many:,} | {size} | {took_s:.2f} s | {computing_s:.2f} s | {1e6 * each[-1]:.1f} us |")
    return 1 if each[-1] > 1.5 * each[0] else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
