"""The verbs about scenarios replace what they wrote themselves, and nothing else, wherever their outputs are to go."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from amaze_autonomy.tester.command import main

SWEEP = ("sweep", "suite/lrf.scenario.yaml", "--from", "1", "--to", "2")
SHRINK = ("shrink", "suite/lrf.scenario.yaml", "--rule", "hold")
OUTPUTS = {
    "test --json": (("test", "suite"), "result of scenarios"),
    "test --junit": (("test", "suite"), "JUnit file of amaze-replay"),
    "test --markdown": (("test", "suite"), "summary of scenarios"),
    "test --html": (("test", "suite"), "report of scenarios"),
    "corpus --json": (("corpus", "suite", "-j1"), "result of scenarios"),
    "sweep --json": (SWEEP, "map of a sweep"),
    "sweep --html": (SWEEP, "page of a sweep of lrf"),
    "shrink --out": (SHRINK, "shrunk scenario"),
}
"""By verb and option: the command, and what it writes there."""

OTHERS = {
    "flight.bag": b"#ROSBAG V2.0\nE\0\0\0",
    "journal.jsonl": b'{"kind":"header","version":3,"writer":"engine"}\n',
    "flight.html": b"<!DOCTYPE html>\n<title>Flight 20261121T010929-001</title>\n",
    "result.json": b'{"verdict": "PASS"}\n',
    "other.xml": b'<?xml version="1.0" encoding="utf-8"?>\n<testsuites><testsuite name="pytest" />\n',
    "README.md": b"# Flights\n",
    "mine.scenario.yaml": b"version: 1\ndescription: mine\n",
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("name", OUTPUTS)
def test_an_output_replaces_one_of_its_kind_and_nothing_else(folder, capsys, name):
    words, kind = OUTPUTS[name]
    option = name.split()[1]
    scenario = folder / "lrf.scenario.yaml"
    for other, content in OTHERS.items():
        Path(other).write_bytes(content)
        assert main([*words, option, other]) == 2
        said = f"{other}: is no {kind}, and would be replaced; name another file with {option}"
        assert capsys.readouterr() == ("", f"amaze-replay: {said}\n")
        assert Path(other).read_bytes() == content
    before = scenario.read_bytes()
    assert main([*words, option, str(scenario)]) == 2
    assert f"amaze-replay: {scenario}: is " in capsys.readouterr().err
    assert main([*words, option, str(folder)]) == 2
    assert capsys.readouterr().err == f"amaze-replay: {folder}: is a folder; name a file with {option}\n"
    assert scenario.read_bytes() == before
    Path("own").write_text("")
    for _ in range(2):
        assert main([*words, option, "own"]) in (0, 1)
        assert Path("own").stat().st_size > 0


def test_a_run_that_was_ended_leaves_what_the_next_one_replaces(folder):
    assert main(["test", str(folder), "--tag", "none", "--json", "r.json"]) == 2
    assert main(["test", str(folder), "--json", "r.json"]) == 1


@pytest.mark.usefixtures("folder")
def test_a_shrunk_scenario_does_not_take_the_place_of_what_it_is_shrunk_from(capsys):
    assert main([*SHRINK, "--out", "small.scenario.yaml"]) == 0
    shutil.copy("small.scenario.yaml", "before")
    capsys.readouterr()
    assert main(["shrink", "small.scenario.yaml", "--rule", "hold", "--out", "small.scenario.yaml"]) == 2
    words = "is one of the inputs, which are never changed; name another file with --out"
    assert capsys.readouterr().err == f"amaze-replay: small.scenario.yaml: {words}\n"
    assert Path("small.scenario.yaml").read_bytes() == Path("before").read_bytes()
