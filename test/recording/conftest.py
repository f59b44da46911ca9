"""Makes the bag-writing helpers importable; asks other readers of bags in processes of their own only."""

import sys
from pathlib import Path

import pytest

from amaze_autonomy.bags.merge import verify

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "bags"), str(HERE.parent / "replay")]


@pytest.fixture(autouse=True)
def no_other_readers(monkeypatch):
    """Start no interpreters for each of hundreds of recordings: test_job.py and test/bags have them read by others."""
    monkeypatch.setattr(verify, "_READERS", ())
