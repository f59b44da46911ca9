"""Fly the fault scenarios that ship with the package live, with all real nodes, and compare each with virtual time.

    ./run live                     # all of config/faults, one after the other: about 40 minutes
    ./run live lrf gps -j 2

Each is one `./run demo faults:=NAME` and one `amaze-autonomy simulate --faults NAME`; what is compared is the way
through the states (equal states in a row count as one). A flight that waits for a person who does not come is ended
after --limit-s seconds by SIGINT, as a person would. Exit status 0: all the same; 1: some differ.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import List

ROOT = Path(__file__).resolve().parents[2]
_PORT = 15000


def main() -> int:
    """Fly, print one row for each as it ends, and count."""
    options = _options()
    names = options.names or sorted(path.stem for path in (ROOT / "config" / "faults").glob("*.yaml"))
    folder = Path(options.output or tempfile.mkdtemp(prefix="live-faults-"))
    print(f"{'scenario':<28} {'':<6} {'result':<14} {'wall':>5}   way", flush=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        ports = range(_PORT, _PORT + 10 * len(names), 10)
        same = list(pool.map(lambda name, port: _fly(name, folder / name, port, options.limit_s), names, ports))
    print(f"{sum(same)} of {len(same)} live as in virtual time; everything is in {folder}")
    return 0 if all(same) else 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a file in config/faults (default: all of them)")
    parser.add_argument("-j", "--jobs", type=int, default=1, help="flights at the same time")
    parser.add_argument("--limit-s", type=float, default=150.0, help="after that a flight is told to end")
    parser.add_argument("--output", help="folder for what they write (default: a temporary one)")
    options = parser.parse_args()
    unknown = [name for name in options.names if not (ROOT / "config" / "faults" / f"{name}.yaml").exists()]
    if unknown:
        parser.error(f"not in config/faults: {', '.join(unknown)}")
    return options


def _fly(name: str, folder: Path, port: int, limit_s: float) -> bool:
    folder.mkdir(parents=True, exist_ok=True)
    offline, live = folder / "offline.jsonl", folder / "live" / "journal.jsonl"
    command = [str(ROOT / ".venv/bin/amaze-autonomy"), "simulate", "--faults", name, "--journal", str(offline)]
    subprocess.run(command, stdout=subprocess.DEVNULL, check=False, timeout=600)
    began = time.monotonic()
    told_to_end = _demo(name, folder, port, limit_s)
    wall = time.monotonic() - began
    should, did = _way(offline), _way(live)
    same = did == should or (told_to_end and did[: len(should)] == should)
    result = json.loads((live.parent / "result.json").read_text()) if (live.parent / "result.json").exists() else {}
    print(f"{name:<28} {'same' if same else 'OTHER':<6} {result.get('result', '?'):<14} {wall:4.0f} s  {_words(did)}")
    if not same:
        print(f"{'':<28} {'':<6} {'virtual time':<14} {'':>6}  {_words(should)}")
    sys.stdout.flush()
    return same


def _demo(name: str, folder: Path, port: int, limit_s: float) -> bool:
    """Fly one; return True when it had to be told to end."""
    with (folder / "demo.txt").open("w", encoding="utf-8") as log:
        arguments = [f"faults:={name}", f"output:={folder / 'live'}", f"mavlink_port:={port}"]
        command = ["bash", str(ROOT / "run"), "demo", *arguments]
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
        try:
            process.wait(limit_s)
        except subprocess.TimeoutExpired:
            os.kill(process.pid, signal.SIGINT)
            process.wait(60.0)
            return True
        return False


def _way(journal: Path) -> List[str]:
    """Return the states of a journal, in their order."""
    if not journal.exists():
        return []
    lines = journal.read_text(encoding="utf-8").splitlines()
    rows = [json.loads(line) for line in lines if '"kind":"decision"' in line]
    steps = [row for row in rows if row["before"] != row["after"]]
    return [key for key, _ in itertools.groupby(row["after"] for row in steps)]


def _words(way: List[str]) -> str:
    return " ".join(state.lower() for state in way if state not in ("PREFLIGHT", "READY", "START_RECORDING"))


if __name__ == "__main__":
    sys.exit(main())
