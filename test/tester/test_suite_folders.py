"""Scenarios on the bag of ROS 2, which is a folder: its sum is that of its files in their order."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from other_recordings import write_ros2
from replay_bags import flight_rows

from amaze_autonomy.tester import Options, run_task, tasks_of


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def ros2(tmp_path_factory):
    """The bag of ROS 2 of a flight, in two files."""
    folder = write_ros2(tmp_path_factory.mktemp("ros2") / "flight", flight_rows())
    second = write_ros2(folder.parent / "more", [row for row in flight_rows(1.0) if row[1] == "/mag"])
    (second / "more.db3").rename(folder / "afterwards.db3")
    about = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(about.replace("- flight.db3\n", "- flight.db3\n  - afterwards.db3\n", 1))
    return folder


def of_folder(folder, sha256):
    more = f"map: {Path(__file__).parents[1] / 'replay' / 'flight.yaml'}\n"
    expected = "expectations:\n  - {expect: exists, of: {state: MISSION}}\n"
    Path("x.scenario.yaml").write_text(
        f"version: 1\ndescription: x\nbags: [{{path: {folder}, sha256: '{sha256}'}}]\n{more}{expected}"
    )
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    return run_task(task)


def test_the_sum_of_a_folder_is_that_of_its_files_in_the_order_of_its_metadata(ros2):
    data = b"".join((ros2 / name).read_bytes() for name in ("flight.db3", "afterwards.db3"))
    assert of_folder(ros2, hashlib.sha256(data).hexdigest()).verdict.value == "PASS"


def test_another_folder_than_the_scenario_was_written_for_is_inconclusive(ros2):
    data = b"".join((ros2 / name).read_bytes() for name in ("afterwards.db3", "flight.db3"))
    found = of_folder(ros2, hashlib.sha256(data).hexdigest())
    assert (found.verdict.value, found.headline) == (
        "INCONCLUSIVE",
        f"{ros2}: is another file than the scenario was written for (sha256 differs)",
    )


def test_a_folder_without_a_recording_is_inconclusive(tmp_path):
    (tmp_path / "empty").mkdir()
    found = of_folder(tmp_path / "empty", "0" * 64)
    assert (found.verdict.value, found.headline) == (
        "INCONCLUSIVE",
        f"{tmp_path / 'empty'}: is a folder without a recording; name a bag, or the folder of a ROS 2 bag",
    )
