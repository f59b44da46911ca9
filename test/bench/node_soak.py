#!/usr/bin/env python3
"""What do live nodes take, and do they grow? Memory, processor, threads and descriptors while the demo's vehicle flies.

    node_soak.py [--minutes 15] [--times 10] [--processes separate|forked] [--json FILE]

All statuses come so many times as often as usual, so that what leaks with a message is seen so many times as soon; what
leaks with time alone is not. The simulated vehicle flies mission 4 again and again. The first third of the time is not
counted. The status is 1 when a node grows by more than a tenth in twelve hours at the usual rates, or does not keep to
its threads and descriptors. rosbag's `record` is shown and not judged: there is a new one for each mission, and it
keeps an index of all that it has recorded. Below stands what our nodes take
on the first of two computers: of memory as `Pss` counts it (what is shared once) and as `Rss` does, and of one core;
that holds with --times 1.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Dict, List, NamedTuple, Tuple
from xmlrpc.client import Error, ServerProxy

import numpy as np

from amaze_autonomy.nodes.node_group import NODES

ROOT = Path(__file__).resolve().parents[2]
RATES_HZ = {
    "watchdog_action": 5,
    "planner_status": 5,
    "autopilot_status": 5,
    "landing_detection": 5,
    "recorder_status": 2,
}
BATTERY = "missions.flight.endurance_s=86400"  # nobody is there to change it between two flights
HOURS, GROWTH_FRACTION, SPARE = 12.0, 0.1, 8
NOT_OURS = "/record_"
ONE_COMPUTER = ("/autonomy", "node_group", "/data_recorder_main", *(f"/{name}" for name in NODES))
"""What flies on the first computer: its drivers are simulated here, and who looks at it sits elsewhere."""
PERIOD_S = 5.0
END_LIMIT_S = 900.0  # it lands, merges, and decides the journal of all flights again under the laws


class Sample(NamedTuple):
    """One look at a process."""

    t_s: float
    memory_mb: float
    threads: int
    descriptors: int
    shared_mb: float
    resident_mb: float
    worked_s: float


def look(pid: int, t_s: float) -> Sample:
    """Return what a process holds: memory that no file stands behind, its own and its part of what forks share."""
    folder = Path("/proc") / str(pid)
    sizes = dict(line.split()[:2] for line in (folder / "smaps_rollup").read_text().splitlines()[1:])
    # Files' pages would shrink when another program maps the same file. A kernel before 5.4 counts them all together.
    memory_kb = int(sizes.get("Pss_Anon:", sizes["Pss:"]))
    ticks = (folder / "stat").read_text().rpartition(")")[2].split()[11:13]  # utime, stime: proc(5)
    return Sample(
        t_s,
        memory_kb * 1024 / 1e6,
        len(list((folder / "task").iterdir())),
        len(list((folder / "fd").iterdir())),
        int(sizes["Pss:"]) * 1024 / 1e6,
        int(sizes["Rss:"]) * 1024 / 1e6,
        sum(int(each) for each in ticks) / os.sysconf("SC_CLK_TCK"),
    )


def nodes_of(uri: str) -> Dict[str, int]:
    """Return the process of each node that the master knows; those that do not answer are left out."""
    master, found = ServerProxy(uri), {}
    for name in sorted({node for kind in master.getSystemState("/soak")[2] for _, nodes in kind for node in nodes}):
        try:
            found[name] = int(ServerProxy(master.lookupNode("/soak", name)[2]).getPid("/soak")[2])
        except (OSError, Error):
            continue
    if "/watchdog" in found:
        parent = int(Path(f"/proc/{found['/watchdog']}/stat").read_text().rpartition(")")[2].split()[1])
        if b"node_group" in Path(f"/proc/{parent}/cmdline").read_bytes():
            found["node_group"] = parent  # no node of its own: the master does not know it
    return found


def fly(options: argparse.Namespace, folder: Path) -> Dict[Tuple[str, int], List[Sample]]:
    """Fly for the time, and look at every node now and then."""
    rates = "; ".join(f"autonomy.streams.{name}_rate_hz={hz * options.times}" for name, hz in RATES_HZ.items())
    overrides = f"{rates}; {BATTERY}"
    missions = ",".join(["4"] * (1 + int(options.minutes / 4.0)))
    arguments = [
        f"mission:={missions}",
        f"output:={folder}",
        f"overrides:={overrides}",
        f"processes:={options.processes}",
    ]
    (ROOT / "build/demo/master").unlink(missing_ok=True)
    with (folder / "demo.log").open("wb") as log:
        command = ["bash", str(ROOT / "run"), "demo", *arguments]
        environment = {**os.environ, "AMAZE_COMPUTERS": "1"}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # what compiles its modules holds 90 MB more
        demo = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
    seen: Dict[Tuple[str, int], List[Sample]] = {}
    began_s = time.monotonic()
    while time.monotonic() - began_s < options.minutes * 60.0 and demo.poll() is None:
        time.sleep(PERIOD_S)
        try:
            uri = (ROOT / "build/demo/master").read_text().strip()
            for name, pid in nodes_of(uri).items():
                seen.setdefault((name, pid), []).append(look(pid, time.monotonic() - began_s))
        except OSError:
            continue  # not yet, or just gone
    if demo.poll() is not None:
        raise SystemExit(f"node_soak: the demo has ended: {(folder / 'demo.log').read_text()[-2000:]}")
    demo.send_signal(signal.SIGTERM)  # a shell in the background ignores SIGINT
    try:
        demo.wait(END_LIMIT_S)
    except subprocess.TimeoutExpired:  # what was seen counts all the same
        sys.stderr.write(f"node_soak: process {demo.pid} has not ended within {END_LIMIT_S:g} s of being told to\n")
    return seen


def grown(samples: List[Sample], times: float) -> Tuple[float, float, int, int]:
    """Return memory in MB, its growth in 12 hours at the usual rates, and by how much threads and descriptors vary."""
    t_s, memory = np.array([each.t_s for each in samples]), np.array([each.memory_mb for each in samples])
    slope = float(np.polyfit(t_s, memory, 1)[0])
    threads, descriptors = [each.threads for each in samples], [each.descriptors for each in samples]
    growth_mb = slope * HOURS * 3600.0 / times
    return float(memory[-1]), growth_mb, max(threads) - min(threads), max(descriptors) - min(descriptors)


def taken(samples: List[Sample]) -> Tuple[float, float, float]:
    """Return what a process has of memory, shared once and resident (MB), and of one core (%)."""
    first, last = samples[0], samples[-1]
    return last.shared_mb, last.resident_mb, 100.0 * (last.worked_s - first.worked_s) / (last.t_s - first.t_s)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=15.0)
    parser.add_argument("--times", type=float, default=10.0)
    parser.add_argument("--processes", choices=("separate", "forked"), default="separate")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    socket.setdefaulttimeout(3.0)
    with TemporaryDirectory(prefix="amaze_soak_") as name:
        seen = fly(options, Path(name))
    first_s = options.minutes * 60.0 / 3.0
    late = {key: [each for each in samples if each.t_s >= first_s] for key, samples in seen.items()}
    late = {key: samples for key, samples in late.items() if len(samples) > 10}
    rows = {key: grown(samples, options.times) for key, samples in late.items()}
    if options.json:
        options.json.write_text(
            json.dumps({f"{name} {pid}": row for (name, pid), row in rows.items()}, indent=2) + "\n"
        )
    print(f"{options.minutes:g} minutes at {options.times:g} times the usual rates, {options.processes}")
    print(f"{'':28}{'MB':>9}{'growth in 12 h, MB':>20}{'threads +-':>12}{'descriptors +-':>16}")
    good = bool(rows)
    for (node, _), (memory, growth, threads, descriptors) in sorted(rows.items()):
        flat = growth < GROWTH_FRACTION * memory and threads <= SPARE and descriptors <= SPARE
        flat = flat or node.startswith(NOT_OURS)
        good = good and flat
        print(f"{node:28}{memory:9.1f}{growth:20.1f}{threads:12}{descriptors:16}{'' if flat else '  GROWS'}")
    print(f"\n{'':28}{'Pss, MB':>9}{'Rss, MB':>9}{'of a core, %':>14}")
    ours = {node: taken(samples) for (node, _), samples in sorted(late.items()) if node in ONE_COMPUTER}
    for node, (shared, resident, core) in (*ours.items(), ("together", map(sum, zip(*ours.values())))):
        print(f"{node:28}{shared:9.1f}{resident:9.1f}{core:14.1f}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
