"""The journal of a recording is the same bytes whenever, wherever and from whatever packing it is made."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest
from replay_bags import ROOT, flight_rows, rewrite, write_bag
from replay_runs import replay

SRC = str(ROOT / "src")


def digest(outcome):
    return hashlib.sha256("\n".join(outcome.journal).encode()).hexdigest()


def replayed_by(python, bag, topic_map, out, seed="0"):
    """Replay in a process of its own; return the bytes of journal, timeline and result."""
    environment = {**os.environ, "PYTHONPATH": SRC, "PYTHONHASHSEED": seed}
    command = [
        str(python),
        "-m",
        "amaze_autonomy.tester.command",
        "run",
        str(bag),
        "--map",
        topic_map,
        "--out",
        str(out),
    ]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return tuple((out / name).read_bytes() for name in ("journal.jsonl", "timeline.txt", "result.json"))


def tied_rows():
    """A flight in which messages of all topics come at exactly the same times."""
    return [(t - t % 100_000_000, topic, message) for t, topic, message in flight_rows()]


def test_two_runs_are_the_same(flight_bag, flight_map):
    assert replay(flight_bag, flight_map)[0].journal == replay(flight_bag, flight_map)[0].journal


def test_the_hash_seed_does_not_matter(tmp_path, flight_bag, flight_map):
    runs = [replayed_by(sys.executable, flight_bag, flight_map, tmp_path / seed, seed) for seed in ("0", "1", "4242")]
    assert runs[0] == runs[1] == runs[2]


@pytest.mark.parametrize("rows", [flight_rows, tied_rows])
def test_the_compression_does_not_matter_nor_the_order_of_connections(tmp_path, flight_map, rows):
    source = write_bag(tmp_path / "source.bag", rows())
    expected = digest(replay(source, flight_map)[0])
    for compression in ("none", "lz4", "bz2"):
        again = rewrite(source, tmp_path / f"{compression}.bag", compression)
        assert digest(replay(again, flight_map)[0]) == expected, compression


def test_the_size_of_chunks_does_not_matter(tmp_path, flight_map):
    bags = [write_bag(tmp_path / f"{size}.bag", tied_rows(), chunk_bytes=size) for size in (2_000, 10_000_000)]
    assert len({digest(replay(bag, flight_map)[0]) for bag in bags}) == 1


def other_python():
    """Return a Python of the other end of our range that has what the replay needs; None: there is none."""
    if sys.version_info < (3, 9):
        candidates = [ROOT / ".venv" / "bin" / "python"]
    else:
        candidates = [Path(p) for p in (os.environ.get("AMAZE_PYTHON38", ""),) if p] + [
            ROOT / "build" / ".venv-py38" / "bin" / "python"
        ]
    for python in candidates:
        command = [str(python), "-c", "import rosbags.rosbag1, rich, yaml, sys; print(sys.version_info[:2])"]
        if python.is_file() and subprocess.run(command, capture_output=True, check=False, timeout=60).returncode == 0:
            return python
    return None


def test_the_version_of_python_and_of_the_library_does_not_matter(tmp_path, flight_map):
    python = other_python()
    if python is None:
        pytest.skip("no second Python with rosbags: run the tests by `./run test`, or set AMAZE_PYTHON38")
    bag = write_bag(tmp_path / "x.bag", tied_rows(), "lz4")
    mine = replayed_by(sys.executable, bag, flight_map, tmp_path / "mine")
    assert replayed_by(python, bag, flight_map, tmp_path / "other") == mine


@pytest.mark.slow_rows
@pytest.mark.parametrize("topic", ["/imu", "/range", "/mag", "/battery", "/armed", "/landed"])
def test_muting_any_topic_of_the_map_changes_the_journal(flight_bag, flight_map, topic):
    whole, muted = replay(flight_bag, flight_map)[0], replay(flight_bag, flight_map, muted=[topic])[0]
    assert whole.decisions != muted.decisions
    assert [line for line in whole.journal if '"kind":"event"' in line] != [
        line for line in muted.journal if '"kind":"event"' in line
    ]
    assert any(line.text == f"{topic} is muted" for line in muted.timeline)
