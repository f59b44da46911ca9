"""Makes the helpers of this folder importable, and the bags and settings that several tests share."""

import sys
from pathlib import Path

import pytest

sys.path += [
    str(Path(__file__).parents[1] / folder) for folder in ("replay", "replay/maps", "replay/recordings", "cns")
]

from replay_bags import flight_rows, write_bag

MAP = Path(__file__).parent / "flight.yaml"


@pytest.fixture
def flight_map():
    return str(MAP)


@pytest.fixture
def flight_bag(tmp_path):
    return write_bag(tmp_path / "flight.bag", flight_rows())


@pytest.fixture
def range_map(tmp_path):
    """The same recording, of which only the range tells whether the vehicle flies."""
    lines = MAP.read_text().splitlines(keepends=True)
    path = tmp_path / "range.yaml"
    path.write_text("".join(line for line in lines if "armed:" not in line and "landed:" not in line))
    return str(path)
