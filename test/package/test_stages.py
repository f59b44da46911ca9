"""A job that ran before or beside this run, and failed, is a failed test in its summary: its last line is true."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

NOT_RUN, LIMIT_S = 77, 3600
STAGES = os.environ.get("AMAZE_STAGES")


@pytest.mark.skipif(STAGES is None, reason="only ./run test runs other jobs")
@pytest.mark.parametrize("stage", ["test-ros", "test-sitl", "lint", "test-py38", "test-proof", "test-builds"])
def test_the_job_that_ran_before_or_beside_passed(stage):
    log = Path(STAGES) / f"{stage}.log"
    status = ended(log.with_suffix(".status"), Path("/proc", (Path(STAGES) / "beside.pid").read_text().strip()))
    if status == NOT_RUN:
        pytest.skip(f"{stage} was not run: {log.read_text().strip()}")
    print(log.read_text())
    assert status == 0, f"./run {stage} failed: see {log}"


def ended(status, beside):
    """Return the status of a job: the last tests wait for it, for as long as something can still write it."""
    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        is_over = not beside.exists()  # looked at first: it writes, and then ends
        if status.exists() and status.read_text().strip():
            return int(status.read_text())
        assert not is_over, f"it ended without a status: {status}"
        time.sleep(0.5)
    raise AssertionError(f"it has not ended within {LIMIT_S} s: {status}")


def test_a_job_that_is_at_work_is_waited_for_and_one_that_ended_without_a_word_is_said(tmp_path):
    (tmp_path / "lint.status").write_text("1\n")
    assert ended(tmp_path / "lint.status", tmp_path / "beside") == 1
    with pytest.raises(AssertionError, match="ended without a status"):
        ended(tmp_path / "test-proof.status", tmp_path / "beside")
