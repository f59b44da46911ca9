"""The one command for every job, from the outside."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(*arguments: str, folder: Path) -> subprocess.CompletedProcess:
    command = [str(ROOT / "run"), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=600)


def test_without_a_job_it_lists_them_all(tmp_path):
    result = run(folder=tmp_path)

    listed = [line.split()[0] for line in result.stdout.splitlines()[1:]]
    assert listed == [
        *("build", "demo", "demo-two-computers", "console", "replay", "test", "test-py38", "test-ros", "lint"),
        *("proof", "mutate", "soak", "live", "bench", "test-bare", "test-arm64", "clean"),
    ]
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("job", ["tests", "setup", "-h"])
def test_what_is_no_job_is_refused_with_the_list(tmp_path, job):
    result = run(job, folder=tmp_path)

    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == run(folder=tmp_path).stdout


@pytest.mark.builds
def test_a_demo_whose_engine_does_not_start_fails_and_says_so(tmp_path):
    pytest.importorskip("rospy", reason="needs ROS")
    (tmp_path / "empty").mkdir()

    result = run("demo", "config:=empty", "output:=out", folder=tmp_path)

    assert result.returncode == 1
    assert result.stderr.splitlines()[-1] == (
        f"no {tmp_path}/out/result.json: the autonomy node ended before its mission did"
    )
