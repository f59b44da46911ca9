"""Mistakes that only show when a scenario is run: one line each, with the line of the file, and what was meant."""

from __future__ import annotations

import shutil

import pytest

from amaze_autonomy.tester.command import main
from amaze_autonomy.tester.run import run_task
from amaze_autonomy.tester.task import Options, Task

HEAD = "version: 1\ndescription: x\n"
NAMED_WRONGLY = [
    (
        "expectations:\n  - {expect: never, of: {component: lfr, code: 8}}\n",
        "x.scenario.yaml:4: there is no component lfr; did you mean lrf?",
    ),
    (
        "expectations:\n  - {expect: sequence, of: [{state: MISSION}, {failure: hight}]}\n",
        "x.scenario.yaml:4: there is no component and no loss hight; did you mean height?",
    ),
    (
        "expectations:\n  - {expect: never, of: {state: HOLD}, to: gone}\n"
        "anchors:\n  gone: {happens: {failure: user_hld}}\n",
        "x.scenario.yaml:6: there is no component and no loss user_hld; did you mean user_hold?",
    ),
    (
        "configuration: {set: {sensors.components.lrf.severty: low}}\n",
        "x.scenario.yaml:3: sensors.components.lrf.severty: is an unknown key; did you mean severity?",
    ),
    (
        "expectations:\n  - {expect: never, of: {state: LAND, step: flying}}\n",
        "x.scenario.yaml:4: expectations.0.of.step: is flying; must be a step of LAND: commanding, descending",
    ),
    (
        "expectations:\n  - {expect: never, of: {state: [MISSION, READY], step: flying}}\n",
        "x.scenario.yaml:4: expectations.0.of.step: is flying; must be left out: READY has no steps",
    ),
    ("missions: ['11']\n", "x.scenario.yaml:3: there is no mission '11'; did you mean 1?"),
    (
        "bags: [{path: no.bag}]\nmap: crazyflie_sin\n",
        "x.scenario.yaml:4: map: crazyflie_sin is no topic map and no file; did you mean crazyflie_sine?",
    ),
]


@pytest.mark.parametrize("text, line", NAMED_WRONGLY)
def test_what_there_is_not_is_an_error_with_what_was_meant(tmp_path, monkeypatch, text, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.scenario.yaml").write_text(HEAD + text)
    result = run_task(Task("x.scenario.yaml", options=Options(goldens=False)))
    assert (result.verdict.value, result.headline) == ("ERROR", line)


@pytest.mark.parametrize(
    "options", [Options(goldens=False), Options(goldens=False, overrides=("autonomy.require_go=no",))]
)
def test_a_matrix_that_gives_a_value_that_cannot_be_is_named_as_its_line(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.scenario.yaml").write_text(HEAD + "matrix:\n  sensors.components.lrf.severity: [high, lowish]\n")
    assert run_task(Task("x.scenario.yaml", "severity=lowish", options)).headline == (
        "x.scenario.yaml:4: sensors.components.lrf.severity: is the text 'lowish'; "
        "must be one of low, moderate, high, highest; did you mean low?"
    )


@pytest.mark.parametrize("verb", ["test", "corpus"])
def test_a_file_with_a_mistake_is_an_error_whatever_variant_is_wanted(folder, capsys, verb):
    """Nobody knows whether it has that variant."""
    path = folder / "lrf.scenario.yaml"
    path.write_text(path.read_text() + "matrix: {sensors.components.lrf.severity: [high, moderate]}\n")
    (folder / "bad.scenario.yaml").write_text("version: 1\nwhat: 3\n")
    assert main([verb, str(folder), "--no-goldens", "--variant", "severity=high"]) == 1
    assert capsys.readouterr().out.startswith("ERROR        bad: suite/bad.scenario.yaml:2: what: is an unknown key")


def test_a_mistake_in_a_file_is_no_reason_to_delete_its_goldens(folder, capsys):
    goldens = folder / "goldens"
    path = folder / "lrf.scenario.yaml"
    (folder / "other.scenario.yaml").write_text(path.read_text())
    assert main(["accept", str(folder), "--reason=the first run, and it is right"]) == 0
    for name in ("lrf@severity=low", "lrfs", "lrfs@severity=low"):  # a variant of it, and two of no scenario
        shutil.copy(goldens / "lrf.golden.jsonl", goldens / f"{name}.golden.jsonl")
    path.write_text(path.read_text().replace("faults:", "fault:"))
    capsys.readouterr()
    assert main(["test", str(folder)]) == 1
    lines = [line for line in capsys.readouterr().out.splitlines() if not line.startswith(" ")]
    assert [line.split(": ")[0].split() for line in lines[:-1]] == [
        ["ERROR", "lrf"],
        ["PASS", "other"],
        ["FAIL", "lrfs.golden.jsonl"],
        ["FAIL", "lrfs@severity=low.golden.jsonl"],
    ]


def test_an_override_of_the_command_line_is_named_as_it_was_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.scenario.yaml").write_text(HEAD)
    result = run_task(Task("x.scenario.yaml", options=Options(overrides=("autonomy.requir_go=no",))))
    assert result.headline.startswith("override autonomy.requir_go=no: requir_go: is an unknown key")


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "known",
    [
        "{expect: never, of: {failure: battery_critical}}",
        "{expect: never, of: {failure: user_hold}}",
        "{expect: never, of: {failure: lrf}}",
        "{expect: never, of: {component: lrf, code: 2}}",
    ],
)
def test_what_could_happen_but_does_not_is_no_mistake(tmp_path, monkeypatch, known):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.scenario.yaml").write_text(HEAD + f"expectations:\n  - {known}\n")
    assert run_task(Task("x.scenario.yaml", options=Options(goldens=False))).verdict.value == "PASS"
