"""The laws are checked on the very decisions that a test judges: those by the rules of the run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from amaze_autonomy.journal.journal import decode, rules_of
from amaze_autonomy.replay.compare import laws_of_lines
from amaze_autonomy.simulation.run import run
from amaze_autonomy.tester import Options, run_task, tasks_of
from amaze_autonomy.tester import run as tester_run
from amaze_autonomy.tester.play import configuration_of, play
from amaze_autonomy.tester.scenario import load_cases

HEAD = "version: 1\ndescription: x\n"
SETS = "configuration: {set: {autonomy.takeoff.takeoff_height_m: 1.4}}\n"
EXPECTS = "expectations: [{expect: exists, of: {rule: at_takeoff_height}}]\n"
OTHER = Options(goldens=False, overrides=("autonomy.takeoff.takeoff_height_m=1.3",))


@pytest.fixture(scope="module")
def flown(configuration):
    return run(configuration, configuration.missions[:1], limit_ns=400 * 10**9).lines


@pytest.fixture
def written(tmp_path, monkeypatch, flown):
    monkeypatch.chdir(tmp_path)
    Path("j.jsonl").write_text("".join(f"{line}\n" for line in flown))
    events = "".join(f"  - '{line}'\n" for line in flown if '"kind":"event"' in line)
    return {"journal": HEAD + "journal: j.jsonl\n", "events": f"{HEAD}events:\n{events}"}


@pytest.mark.slow_rows
@pytest.mark.parametrize("source", ["journal", "events"])
@pytest.mark.parametrize("sets, options, height_m", [(SETS, Options(goldens=False), 1.4), ("", OTHER, 1.3)])
def test_the_header_of_what_is_decided_again_carries_the_rules_of_the_run(written, source, sets, options, height_m):
    Path("x.scenario.yaml").write_text(written[source] + sets + EXPECTS)
    (case,) = load_cases(Path("x.scenario.yaml"))
    played, configuration = play(case, options), configuration_of(case, options)
    header = decode(played.lines[0])
    assert header.payload["hash"] == configuration.hash
    assert rules_of(header).limits.takeoff_height_m == height_m
    assert laws_of_lines(played.lines).different == 0
    assert run_task(tasks_of([Path("x.scenario.yaml")], options)[0]).verdict.value == "PASS"


def test_a_journal_that_nothing_is_changed_of_keeps_its_header(written, flown):
    Path("x.scenario.yaml").write_text(written["journal"] + EXPECTS)
    (case,) = load_cases(Path("x.scenario.yaml"))
    assert play(case, Options()).lines == tuple(flown)


def test_laws_that_were_checked_on_other_decisions_are_an_error(written, monkeypatch):
    Path("x.scenario.yaml").write_text(written["journal"] + EXPECTS)
    monkeypatch.setattr(tester_run, "laws_of_lines", lambda lines: replace(laws_of_lines(lines), different=2))
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    result = run_task(task)
    assert (result.verdict.value, result.headline) == (
        "ERROR",
        "the laws were checked on other decisions than the test judges: 2 are different when the run's journal is "
        "decided again",
    )
