"""A scenario is decided in one way: in two processes with two hash seeds, and from a pickled task."""

from __future__ import annotations

import os
import pickle
import random
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from amaze_autonomy.tester import Task, Verdict, run_task, tasks_of
from amaze_autonomy.tester.scenario import find_files

SUITE = Path(__file__).parents[1] / "scenarios"
PROGRAM = """
import sys
from pathlib import Path
from amaze_autonomy.tester import run_task, tasks_of
for task in tasks_of([Path(sys.argv[1])]):
    result = run_task(task)
    print(result.id, result.verdict.value, result.digest)
"""


@pytest.fixture(scope="module")
def chosen(tmp_path_factory):
    """Some shipped scenarios, drawn by a seed: another one for each Python. Both run all of them with a hash seed."""
    folder = tmp_path_factory.mktemp("some")
    (folder / "goldens").mkdir()
    names = sorted(path.name[: -len(".scenario.yaml")] for path in find_files([SUITE]))
    for name in random.Random(sys.version_info[1]).sample(names, 20):
        shutil.copy(SUITE / f"{name}.scenario.yaml", folder)
        for golden in (SUITE / "goldens").glob(f"{name}*.golden.jsonl"):
            shutil.copy(golden, folder / "goldens")
    return folder


@pytest.mark.night
@pytest.mark.long
def test_another_process_with_another_hash_seed_decides_the_same_to_the_byte(chosen, monkeypatch):
    data = os.environ.get("AMAZE_DATA", str(Path(__file__).parents[3] / "shared" / "data"))
    process = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(chosen)],
        env={**os.environ, "PYTHONHASHSEED": "4242", "AMAZE_DATA": data},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=600,
    )
    monkeypatch.setenv("AMAZE_DATA", data)
    there = [tuple(line.rsplit(" ", 2)) for line in process.stdout.splitlines()]
    results = [run_task(task) for task in tasks_of([chosen])]
    here = [(result.id, result.verdict.value, result.digest) for result in results]
    assert there == here
    assert sum(verdict == "PASS" for _, verdict, _ in here) >= 15


def test_a_task_and_its_result_can_be_pickled():
    task = pickle.loads(pickle.dumps(tasks_of([SUITE / "nominal.scenario.yaml"])[0]))
    result = pickle.loads(pickle.dumps(run_task(task)))
    assert (result.id, result.verdict, result.headline) == (
        "nominal",
        Verdict.PASS,
        "10 decisions, 4 expectations hold; closest 0 of 1 left: count command TAKEOFF, at_least 1, at_most 1",
    )


def test_a_variant_that_is_not_there_is_an_error():
    result = run_task(Task(str(SUITE / "nominal.scenario.yaml"), "x=1"))
    assert (result.verdict, result.id) == (Verdict.ERROR, "nominal[x=1]")
    assert result.headline.endswith("there is no variant 'x=1'; there is the only one")
