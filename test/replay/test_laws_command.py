"""`amaze-replay laws`: what holds is counted, what is broken is named with its moment, in words, status and JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.journal.journal import JournalError
from amaze_autonomy.laws import LAWS
from amaze_autonomy.replay.compare import laws_of_lines
from amaze_autonomy.tester import Options, Task, Verdict, run_task
from amaze_autonomy.tester.command import main

ROOT = Path(__file__).parents[2]
FLIGHT = ROOT / "test" / "proof" / "found" / "the_most_needed_goes_first-1.jsonl"


def without(monkeypatch, rule):
    rows = {place: tuple(row for row in found if row.rule != rule) for place, found in engine.ROWS_AT.items()}
    monkeypatch.setattr(engine, "ROWS_AT", rows)


def test_a_flight_that_keeps_every_law_is_counted(capsys):
    assert main(["laws", str(FLIGHT)]) == 0
    said = capsys.readouterr().out
    events = FLIGHT.read_text().count('"kind":"event"')
    assert said.startswith(f"{events} events, ")
    assert f" of {len(LAWS)} laws applied " in said
    assert said.endswith(" times: none broken\n")


def test_a_broken_law_is_named_with_its_moment_and_is_the_exit_status(monkeypatch, capsys):
    without(monkeypatch, "land")
    assert main(["laws", str(FLIGHT)]) == 1
    first, *others, last = capsys.readouterr().out.splitlines()
    assert first.startswith("law broken: ")
    assert "The law: " in first
    assert " s, after event " in first
    assert "decisions differ from the recorded ones" in others[-1]
    assert last.endswith(" broken")


def test_what_was_decided_by_another_engine_is_judged_and_said(monkeypatch, capsys):
    without(monkeypatch, "mission_selected")
    assert main(["laws", str(FLIGHT)]) == 3
    assert "the laws were checked on what is decided now" in capsys.readouterr().out


def test_a_journal_that_is_cut_off_is_judged_to_its_end(tmp_path, capsys):
    text = FLIGHT.read_text()
    path = tmp_path / "journal.jsonl"
    path.write_text(text[: text.rindex('"kind"') + 8])
    assert main(["laws", str(path)]) == 3
    assert "the end of the journal is cut off" in capsys.readouterr().out


def test_a_journal_without_an_event_is_no_success(tmp_path, capsys):
    path = tmp_path / "journal.jsonl"
    path.write_text(FLIGHT.read_text().splitlines(keepends=True)[0])
    assert main(["laws", str(path)]) == 3
    assert "there is no event in the journal: nothing was checked\n" in capsys.readouterr().out


def test_the_result_as_json(capsys):
    assert main(["laws", "--json", str(FLIGHT)]) == 0
    (result,) = json.loads(capsys.readouterr().out)
    assert sorted(result["applied"]) == sorted(LAWS)
    assert (result["broken"], result["different_decisions"], result["truncated"]) == ([], 0, False)
    assert result["events"] > 0


def test_other_rules_may_be_given(capsys):
    assert main(["laws", "--set", "autonomy.flight.max_height_m=20.0", str(FLIGHT)]) == 0
    said = capsys.readouterr().out
    assert "none broken" in said
    assert "VACUOUS" not in said


UNREAD = [
    ("sensors.landing_detection.ground_distance_m", "0.12", "a journal holds what the nodes said"),
    ("sensors.components.imu.topics./px4/imu.rate_hz", "90.0", "a journal holds what the nodes said"),
    ("sensors.components.imu.severity", "low", "the codes in a journal are those that its watchdog gave"),
]


@pytest.mark.parametrize("key, value, reason", UNREAD, ids=[key for key, _, _ in UNREAD])
def test_a_key_that_a_journal_cannot_look_at_is_named_and_is_the_exit_status(capsys, key, value, reason):
    change = ["--set", f"{key}={value}"]
    assert main(["laws", *change, str(FLIGHT)]) == 4
    *_, vacuous, last = capsys.readouterr().out.splitlines()
    assert vacuous.startswith(f"VACUOUS: {key} was not looked at: {reason}")
    assert last.endswith(" times: none broken")
    assert main(["laws", "--json", *change, str(FLIGHT)]) == 4
    (result,) = json.loads(capsys.readouterr().out)
    assert [each["key"] for each in result["not_looked_at"]] == [key]


def test_lines_without_rules_are_refused():
    with pytest.raises(JournalError, match="no rules here"):
        laws_of_lines(['{"kind":"header","version":1}'])


def test_a_scenario_fails_when_a_law_is_broken_although_its_expectations_hold(monkeypatch, tmp_path):
    path = tmp_path / "flight.scenario.yaml"
    path.write_text(
        "version: 1\ndescription: a flight\n"
        f"journal: {FLIGHT}\n"
        "expectations:\n  - {expect: exists, of: {command: TAKEOFF}}\n"
    )
    task = Task(str(path), "", Options(goldens=False))
    assert run_task(task).verdict is Verdict.PASS
    without(monkeypatch, "land")
    result = run_task(task)
    assert result.verdict is Verdict.FAIL
    assert result.headline.startswith("law broken: ")
    assert result.problems[0] == result.headline
