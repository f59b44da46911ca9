"""How fast recordings are replayed and journals decided again, as a person would time it: the whole process.

    python test/bench/replay_speed.py [BAG ...]

Without arguments: the real recordings in AMAZE_DATA (else ../shared/data from the root) that have a map, and a
flight that the tests write. Prints seconds of recording per second of computing; asserts nothing.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "test" / "replay")]

from replay_bags import flight_rows, write_bag  # noqa: E402

from amaze_autonomy.replay.maps.topic_map import map_names  # noqa: E402

ROUNDS = 3
LIMIT_S = 1800.0  # of one run: what takes longer hangs


def fastest(arguments: list) -> float:
    """Return the shortest of some runs of `amaze-replay` in seconds."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "amaze_autonomy.tester.command", *arguments],
            env=environment,
            stdout=subprocess.DEVNULL,
            check=True,
            timeout=LIMIT_S,
        )
        times.append(time.perf_counter() - began)
    return min(times)


def measure(bag: Path, topic_map: str, folder: Path) -> str:
    """Return a row of the table for one bag."""
    run_s = fastest(["run", str(bag), "--map", topic_map, "--no-html", "--out", str(folder)])
    journal_s = fastest(["journal", str(folder / "journal.jsonl")])
    result = json.loads((folder / "result.json").read_text())
    length_s = (result["end_ns"] - result["start_ns"]) / 1e9
    messages = sum(topic["messages"] for topic in result["topics"])
    return (
        f"{bag.name:<30} {length_s:8.1f} s {messages:8d} messages   run {run_s:5.2f} s = {length_s / run_s:5.0f} x"
        f"   journal {journal_s:5.2f} s = {length_s / journal_s:5.0f} x real time"
    )


def main() -> None:
    """Print a row per recording."""
    data = Path(os.environ.get("AMAZE_DATA", ROOT.parent / "shared" / "data"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written = write_bag(folder / "written_by_the_tests.bag", flight_rows())
        bags = [Path(argument) for argument in sys.argv[1:]] or [data / f"{name}.bag" for name in map_names()]
        for bag in bags:
            if bag.is_file():
                print(measure(bag, bag.stem, folder / "out"), flush=True)
        print(measure(written, str(ROOT / "test" / "replay" / "flight.yaml"), folder / "out"))


if __name__ == "__main__":
    main()
