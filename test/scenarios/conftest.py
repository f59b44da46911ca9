"""Where the real recordings are, and what is run on Noetic's Python: a few scenarios, the rest is run once."""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ.setdefault("AMAZE_DATA", str(Path(__file__).resolve().parents[3] / "shared" / "data"))

_ON_OLD_PYTHON = ("nominal", "lrf", "engine_restarted_journal_lost", "takeoff_refused", "ardrone_imu_dies")


def pytest_ignore_collect(collection_path):
    name = collection_path.name
    if sys.version_info >= (3, 9) or not name.endswith(".scenario.yaml"):
        return None
    return name.partition(".")[0] not in _ON_OLD_PYTHON or None
