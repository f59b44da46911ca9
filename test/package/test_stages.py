"""A job that failed before this pytest run is a failed test in its summary, so that its last line tells the truth."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

NOT_RUN = 77
STAGES = os.environ.get("AMAZE_STAGES")


@pytest.mark.skipif(STAGES is None, reason="only ./run test runs other jobs before")
@pytest.mark.parametrize("stage", ["lint", "test-py38", "test-proof", "test-builds", "test-ros", "test-sitl"])
def test_the_job_that_ran_before_passed(stage):
    log = Path(STAGES) / f"{stage}.log"
    status = int(log.with_suffix(".status").read_text())
    if status == NOT_RUN:
        pytest.skip(f"{stage} was not run: {log.read_text().strip()}")
    assert status == 0, f"./run {stage} failed: see {log}"
