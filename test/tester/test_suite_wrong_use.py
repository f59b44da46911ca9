"""Wrong use of the tester's verbs: one line, exit status 2, and no result that could be taken for one that passed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from amaze_autonomy.paths import config_folder
from amaze_autonomy.tester.command import main

LRF = "suite/lrf.scenario.yaml"
MATRIX = "matrix: {seed: [1, 2]}\n"
WRONG = [
    (["test", "suite", "--tag", "none"], "no scenario was chosen"),
    (["test", "suite", "--variant", "seed=3"], "no scenario was chosen; the variants are 'seed=1', 'seed=2'"),
    (["corpus", "suite", "--tag", "none"], "no scenario was chosen"),
    (["what-if", "suite", "--tag", "none", "--against", "autonomy.require_go=true"], "no scenario was chosen"),
    (["sweep", LRF, "--variant", "seed=3", "--to", "4"], "there is no variant 'seed=3'; there is seed=1, seed=2"),
    (["shrink", LRF, "--variant", "seed=3"], "there is no variant 'seed=3'; there is seed=1, seed=2"),
    (["sweep", LRF, "--to", "4", "--step", "0"], "a sweep needs two times at least"),
    (["sweep", LRF, "--to", "1e7", "--step", "0.001"], "must be at most 10000; take a larger --step"),
    (
        ["test", "suite", "--set", "sensors.components.lrf.severty=low"],
        "severty: is an unknown key; did you mean sever",
    ),
    (["test", "suite", "--config", "nowhere"], "nowhere: is not a folder"),
    (
        ["what-if", "suite", "--against", "autonomy.requir_go=true"],
        "requir_go: is an unknown key; did you mean require",
    ),
    (["what-if", "suite", "--against", "nowhere"], "nowhere: is not a folder"),
    (["accept", "suite", "--reason", "so"], "in a sentence of 10 letters or more"),
]


@pytest.mark.parametrize("words, said", WRONG, ids=[" ".join(words) for words, _ in WRONG])
def test_wrong_use_is_one_line(folder, capsys, words, said):
    (folder / "lrf.scenario.yaml").open("a").write(MATRIX)
    assert main(words) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n"), said in printed.err) == ("", 1, True), printed


@pytest.mark.parametrize("number", ["nan", "inf", "-inf"])
@pytest.mark.parametrize("option", ["--from", "--to", "--step", "--resolution"])
@pytest.mark.usefixtures("folder")
def test_what_is_no_number_is_no_time(capsys, option, number):
    with pytest.raises(SystemExit) as ended:
        main(["sweep", LRF, "--to", "4", f"{option}={number}"])
    assert ended.value.code == 2
    assert f"argument {option}: {number} is no number of seconds" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["test", "corpus"])
@pytest.mark.usefixtures("folder")
def test_a_run_of_nothing_has_not_passed(verb):
    assert main([verb, "suite", "--tag", "none", "--json", "r.json"]) == 2
    assert json.loads(Path("r.json").read_text())["verdict"] == "ERROR"


@pytest.mark.parametrize("verb", ["test", "corpus"])
def test_a_key_that_only_a_teams_own_configuration_has_is_no_wrong_use(folder, capsys, verb):
    own = folder / "own"
    shutil.copytree(config_folder(), own)
    sensors = (own / "sensors.yaml").read_text()
    (own / "sensors.yaml").write_text(sensors.replace("\n  lrf:", "\n  range_finder:"))
    (folder / "lrf.scenario.yaml").write_text(
        "version: 1\ndescription: x\nconfiguration: {folder: own}\n"
        "expectations:\n  - {expect: never, of: {failure: range_finder}}\n"
    )
    assert main([verb, "suite", "-j1", "--set", "sensors.components.range_finder.severity=moderate"]) == 0
    assert (
        capsys.readouterr()
        .out.splitlines()[-1]
        .endswith("; goldens not compared: they are of each scenario's own configuration")
    )


def test_what_if_without_the_recordings_says_so(folder, capsys):
    (folder / "lrf.scenario.yaml").write_text(
        "version: 1\ndescription: x\nbags: [{path: no.bag}]\nmap: crazyflie_sine\n"
    )
    assert main(["what-if", "suite", "--against", "autonomy.require_go=true"]) == 3
    assert capsys.readouterr().out.splitlines() == [
        "CANNOT       lrf: suite/no.bag: is not there; the scenario needs it",
        "1 flights: 0 end otherwise, 0 decide otherwise and end alike, 1 cannot be run",
    ]
