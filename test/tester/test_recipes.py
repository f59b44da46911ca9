"""The recipes for a team's continuous integration: their own shell lines, run here in a repository of such a team."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml
from replay_demo import demo_bag, simulated

RECIPES = Path(__file__).parents[2] / "docs" / "recipes"
SCENARIO = """\
version: 1
description: "The flight of the demo, as it was recorded."
bags: [{path: "${AMAZE_DATA}/flight.bag"}]
map: amaze_demo
expectations:
  - {expect: exists, of: {state: %s}}
"""


def github():
    """Return the lines that a runner runs, the last of them also after a failure."""
    (job,) = yaml.safe_load((RECIPES / "github-actions.yml").read_text())["jobs"].values()
    steps = [step for step in job["steps"] if "run" in step and step.get("name") != "install"]
    assert [step["name"] for step in steps] == ["fetch", "replay", "summary", "pages"]
    return job["env"], [(step["run"], step.get("if") == "always()") for step in steps]


def gitlab():
    """Return the lines that a runner runs."""
    job = yaml.safe_load((RECIPES / "gitlab-ci.yml").read_text())["flights"]
    return job["variables"], [(line, False) for line in job["script"]]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return demo_bag(tmp_path_factory.mktemp("kept") / "flight.bag", simulated())


@pytest.fixture(scope="module")
def golden(tmp_path_factory, recording):
    """The golden of the scenario, as the team has looked at it and accepted it."""
    folder = tmp_path_factory.mktemp("accepted")
    (folder / "demo.scenario.yaml").write_text(SCENARIO % "MISSION")
    program = str(Path(sys.executable).parent / "amaze-replay")
    environment = {**os.environ, "AMAZE_DATA": str(recording.parent)}
    command = [program, "accept", str(folder), "--reason", "the demo, seen and right"]
    subprocess.run(command, env=environment, check=True, capture_output=True, timeout=600)
    (golden,) = folder.rglob("*.golden.jsonl")
    return golden


@pytest.fixture
def team(tmp_path, recording, golden):
    flights = tmp_path / "team" / "flights"
    flights.mkdir(parents=True)
    (flights / "fetch_recordings.sh").write_bytes((RECIPES / "fetch_recordings.sh").read_bytes())
    (flights / "demo.scenario.yaml").write_text(SCENARIO % "MISSION")
    (flights / "goldens").mkdir()
    (flights / "goldens" / golden.name).write_bytes(golden.read_bytes())
    total = hashlib.sha256(recording.read_bytes()).hexdigest()
    (flights / "recordings.sha256").write_text(f"# what is replayed\n\n{total}  file://{recording}\n")
    return flights.parent


def run(team, recipe):
    """Run a recipe as its runner does; return its status, and what it said."""
    variables, lines = recipe()
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = {**os.environ, **variables, "PATH": path, "GITHUB_STEP_SUMMARY": str(team / "step_summary")}
    status, said = 0, ""
    for line, always in lines:
        if status and not always:
            continue
        command = ["bash", "-e", "-o", "pipefail", "-c", line]
        done = subprocess.run(
            command, cwd=team, env=environment, capture_output=True, text=True, check=False, timeout=600
        )
        status, said = status or done.returncode, said + done.stdout + done.stderr
    return status, said


@pytest.mark.night
@pytest.mark.parametrize("recipe", [github, gitlab])
def test_a_recipe_fetches_once_replays_and_shows(team, recipe):
    status, said = run(team, recipe)
    assert (status, "fetched recordings/flight.bag" in said) == (0, True), said
    (suite,) = ET.parse(team / "flights.xml").getroot().iter("testsuite")
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("1", "0", "0")
    assert "demo" in (team / "flights.md").read_text()
    assert "<html" in (team / "flights.html").read_text()
    assert "<html" in (team / "pages" / "flight.bag.html").read_text()
    again = run(team, recipe)
    assert again[0] == 0
    assert "fetched" not in again[1]
    assert (team / "step_summary").exists() == (recipe is github)


@pytest.mark.night
@pytest.mark.parametrize("recipe", [github, gitlab])
def test_a_scenario_that_fails_fails_the_job_and_is_shown_all_the_same(team, recipe):
    (team / "flights" / "demo.scenario.yaml").write_text(SCENARIO % "PILOT")
    status, said = run(team, recipe)
    assert status == 1, said
    assert re.search(r'failures="1"', (team / "flights.xml").read_text())
    assert "FAIL" in (team / "flights.md").read_text()
    assert (team / "pages" / "flight.bag.html").is_file()
    if recipe is github:
        assert "FAIL" in (team / "step_summary").read_text()


def test_another_recording_than_the_listed_one_is_not_replayed(team):
    listed = team / "flights" / "recordings.sha256"
    listed.write_text(re.sub("[0-9a-f]{64}", "0" * 64, listed.read_text()))
    status, said = run(team, gitlab)
    assert status == 1
    assert "is not the recording of flights/recordings.sha256: its sum is another one" in said
    assert list((team / "recordings").iterdir()) == []


def test_a_recording_that_was_damaged_where_it_is_kept_is_fetched_again(team):
    (team / "recordings").mkdir()
    (team / "recordings" / "flight.bag").write_bytes(b"half")
    assert run(team, gitlab)[0] == 0


@pytest.mark.parametrize("end", ["\n", ""], ids=["with an end of line", "without one"])
def test_the_last_line_of_a_list_is_fetched_too(tmp_path, end):
    (tmp_path / "flight.bag").write_bytes(b"a flight")
    total = hashlib.sha256(b"a flight").hexdigest()
    (tmp_path / "list").write_text(f"# one\n{total}  file://{tmp_path}/flight.bag{end}")
    script = [str(RECIPES / "fetch_recordings.sh"), "list", "bags"]
    done = subprocess.run(["bash", *script], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, (tmp_path / "bags" / "flight.bag").read_bytes()) == (0, b"a flight")
