"""The shipped suite: its goldens say how much of the engine's tables it covers; each file has a story of its own."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from amaze_autonomy.config import ConfigError
from amaze_autonomy.tester import Result, Verdict
from amaze_autonomy.tester.coverage import (
    Hunt,
    Survival,
    coverage_lines,
    coverage_of,
    mutants_of,
    mutated,
    mutation_lines,
    mutation_passed,
    read_waivers,
    run_hunt,
)
from amaze_autonomy.tester.golden import golden_path, read_golden
from amaze_autonomy.tester.run import run_task
from amaze_autonomy.tester.scenario import find_files, load_cases
from amaze_autonomy.tester.task import Task

SUITE = Path(__file__).parents[1] / "scenarios"
WAIVERS = SUITE / "waivers.yaml"


@pytest.fixture(scope="module")
def results():
    cases = [case for path in find_files([SUITE]) for case in load_cases(path)]
    return [
        Result(
            case.id,
            str(case.path),
            case.variant,
            case.description,
            Verdict.PASS,
            "",
            lines=read_golden(golden_path(case)).lines,
        )
        for case in cases
    ]


def test_every_row_fires_or_has_a_reason_not_to_and_no_two_files_tell_one_story(results):
    coverage = coverage_of(results, read_waivers(WAIVERS))
    assert coverage_lines(coverage)[:-1] == []
    assert coverage.passed


def test_there_are_more_than_sixty_files(results):
    assert len({result.path for result in results}) >= 60


def test_two_files_of_one_story_are_twins_and_two_variants_of_one_file_are_not(results):
    lrf = next(result for result in results if result.id == "lrf")
    variant = replace(lrf, id="lrf[seed=2]", variant="seed=2")
    twin = replace(lrf, id="twin", path="twin.scenario.yaml")
    assert coverage_of([lrf, variant]).twins == ()
    coverage = coverage_of([lrf, variant, twin], {item.name: "elsewhere" for item in coverage_of([lrf]).missing})
    assert (coverage.twins, coverage.missing, coverage.passed) == ((("lrf", "twin"),), (), False)
    assert [line for line in coverage_lines(coverage) if "lrf" in line and "twin" in line]


def test_times_and_numbers_make_no_story_of_their_own_but_commands_do(results):
    lrf = next(result for result in results if result.id == "lrf")
    later = tuple(re.sub(r'"t_ns":(\d+)', lambda found: f'"t_ns":{int(found[1]) + 1}', line) for line in lrf.lines)
    other = tuple(line.replace('"MissionCommand(HOLD)', '"MissionCommand(LAND)') for line in lrf.lines)
    for lines, same in ((later, True), (other, False)):
        assert lines != lrf.lines
        assert bool(coverage_of([lrf, replace(lrf, path="other.scenario.yaml", lines=lines)]).twins) is same


def test_what_is_left_out_is_missing_and_a_waiver_that_is_not_needed_is_stale(results):
    few = [result for result in results if "handheld" not in result.id and result.id != "lrf"]
    coverage = coverage_of(few[:3], {"rule mission_selected": "for the test", "rule land": "for the test"})
    assert "rule pilot_took_over" in [item.name for item in coverage.missing]
    assert [item.name for item in coverage.stale] == ["rule land", "rule mission_selected"]
    assert not coverage.passed


def test_a_waiver_for_what_there_is_not_is_a_mistake(tmp_path):
    path = tmp_path / "w.yaml"
    path.write_text("waivers:\n  - {item: rule lands, reason: none}\n")
    with pytest.raises(
        ConfigError, match=r"w.yaml:2: waivers.0.item: is the text 'rule lands'.*did you mean rule land"
    ):
        read_waivers(path)


# The restarts of lrf end before its wait does: demo_flight notices that one.
SOME = {"deleted row landing_shown": "lrf", "longer wait for lrf": "", "shifted limit descent_time_ns": ""}


@pytest.mark.parametrize("mutant", SOME)
def test_a_mutant_is_noticed_where_its_row_matters(mutant):
    task = Task(str(SUITE / "lrf.scenario.yaml"))
    assert run_hunt(Hunt(mutant, (task,), (run_task(task).digest,))).caught_by == SOME[mutant]


def test_a_mutant_survives_with_a_waiver_only_and_a_waiver_that_is_not_needed_is_stale():
    caught, alive = Survival("one", "lrf", 3), Survival("two", "", 7)
    assert mutation_passed([caught, alive], {"mutant two": "for the test"})
    assert mutation_lines([caught, alive], {"mutant two": "for the test"}) == [
        "1 of 2 mutants caught, 1 waived, 0 survive"
    ]
    assert not mutation_passed([alive], {})
    assert not mutation_passed([caught], {"mutant one": "for the test"})
    assert mutation_lines([caught, alive], {"mutant one": "for the test"}) == [
        "SURVIVED  two: none of 7 scenarios decides otherwise",
        "STALE     one: a waiver says that it survives, and lrf catches it",
        "1 of 2 mutants caught, 0 waived, 1 survive",
    ]


@pytest.mark.parametrize(
    "name", ["swapped action of loss tilt", "swapped alarm of loss tilt", "lowered limit max_tilt_deg"]
)
def test_a_bound_of_the_laws_needs_no_scenario_and_no_waiver(name):
    assert [item.waiver[:21] for item in coverage_of([]).items if item.name == "loss tilt"] == ["a bound of the laws: "]
    alive, caught = Survival(name, "", 3), Survival(name, "tilt", 3)
    assert mutation_passed([alive], {})
    assert mutation_passed([caught], {})
    assert mutation_lines([alive], {}) == ["0 of 1 mutants caught, 1 waived, 0 survive"]
    assert not mutation_passed([replace(alive, mutant=name.replace("tilt", "nobodys"))], {})


def test_tables_are_put_back(configuration):
    task = Task(str(SUITE / "lrf.scenario.yaml"))
    before = run_task(task).digest
    for mutant in mutants_of(configuration.rules):
        with mutated(mutant, configuration.rules) as rules:
            changed = rules != configuration.rules
        assert changed == (mutant.kind in ("component", "wait", "limit", "lower")), mutant
    assert run_task(task).digest == before
