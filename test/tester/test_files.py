"""Scenario files: what they mean, and the one line for each mistake."""

from __future__ import annotations

from pathlib import Path

import pytest

from amaze_autonomy.config import ConfigError
from amaze_autonomy.replay.errors import ReplayError
from amaze_autonomy.tester.expect import Pattern
from amaze_autonomy.tester.expect.model import RULES
from amaze_autonomy.tester.scenario import Anchor, Bag, Need, find_files, load_cases, parse_cases

HERE = Path("folder/x.scenario.yaml")
S = 1_000_000_000

WHOLE = """\
version: 1
description: everything
tags: [hold, night]
requirements: [R-4.2]
bags: [{path: flight.bag}]
from_s: 1.0
to_s: 9.0
map: ardrone_indoor_flight
missions: ["2"]
seed: 7
configuration: {folder: mine, set: {sensors.components.lrf.severity: low}}
needs: [{topic: /imu, rate_hz: 100.0, gap_s: 0.5}]
anchors:
  high: {value: height_m, above: 2.0, occurrence: 2, delay_s: 1.0}
  held: {happens: {state: HOLD}}
faults:
  - {topic: /imu, fault: biased, field: linear_acceleration.z, by: -2.0, at_s: 3.0, for_s: 1.0}
requests:
  - {request: land, at_s: 5.0}
expectations:
  - {expect: never, of: {component: imu, code: 16}, from: high, to: held}
"""


def cases(text):
    return parse_cases(text, HERE)


def simulation(more):
    return cases("version: 1\ndescription: x\n" + more)


def test_a_file_says_all_of_a_case():
    (case,) = cases(WHOLE)
    assert (case.id, case.source, case.seed, case.from_ns, case.to_ns) == ("x", "bags", 7, 1 * S, 9 * S)
    assert case.bags == (Bag(Path("folder/flight.bag")),)
    assert case.configuration == Path("folder/mine")
    assert case.overrides == {"sensors.components.lrf.severity": "low"}
    assert case.needs == (Need("/imu", 100.0, S // 2),)
    assert case.anchors == (
        Anchor("high", value="height_m", above=2.0, occurrence=2, delay_ns=S),
        Anchor("held", what=Pattern(states=("HOLD",))),
    )
    assert (case.tags, case.requirements, case.missions) == (("hold", "night"), ("R-4.2",), ("2",))
    assert str(case.faults[0]) == "/imu biased"
    assert str(case.expectations[0]) == "never imu at code 16 or above, from high, to held"


def test_a_matrix_is_a_case_for_each_combination():
    found = simulation(
        "faults: [{component: lrf, fault: silent, at_s: 1.0}]\n"
        "matrix:\n  seed: [1, 2]\n  faults.0.at_s: [5.0, 6.5]\n  sensors.components.lrf.severity: [low, high]\n"
    )
    assert [case.variant for case in found[:3]] == [
        "seed=1,at_s=5.0,severity=low",
        "seed=1,at_s=5.0,severity=high",
        "seed=1,at_s=6.5,severity=low",
    ]
    assert len(found) == 8
    assert (found[-1].seed, found[-1].faults[0].trigger.at_ns) == (2, 6_500_000_000)
    assert found[-1].overrides == {"sensors.components.lrf.severity": "high"}


MISTAKES = {
    "expectation: []": "expectation: is an unknown key; did you mean expectations?",
    "expectations: [{expect: exist, of: {state: HOLD}}]": "expectations.0.expect: is the text 'exist'; must be one of "
    "exists, never, always, response, precedence, sequence, count, duration, share; did you mean exists?",
    "expectations: [{expect: exists, of: {state: HOLDS}}]": "did you mean HOLD?",
    "expectations: [{expect: exists, of: {rule: landd}}]": "did you mean landed?",
    "expectations: [{expect: exists, of: {state: HOLD, rule: hold}}]": "has state and rule; must have one of",
    "expectations: [{expect: exists, of: {}}]": "is empty; must have one of state, rule, command, failure, component",
    "expectations: [{expect: exists, of: {component: lrf}}]": "code: is missing",
    "expectations: [{expect: count, of: {state: HOLD}, at_least: 5, at_most: 2}]": "expectations.0: has at_least 5 and "
    "at_most 2; no run can hold it",
    "expectations: [{expect: count, of: {state: HOLD}, at_least: 0}]": "expectations.0: has at_least 0; every run",
    "expectations: [{expect: duration, of: {state: HOLD}, at_least_s: 0.0}]": "has at_least_s 0; every run holds it",
    "expectations: [{expect: share, of: {state: HOLD}, at_least_fraction: 0}]": "has at_least_fraction 0; every run",
    "expectations: [{expect: share, of: {state: HOLD}, at_most_fraction: 1}]": "has at_most_fraction 1; every run",
    "expectations: [{expect: share, of: {state: HOLD}, at_least_fraction: 0, at_most_fraction: 1}]": "has "
    "at_least_fraction 0 and at_most_fraction 1; every run holds it: must be able to fail",
    "expectations: [{expect: response, when: {state: HOLD}, then: {state: HOLD}, within_s: 1}]": "0.then: is HOLD, as "
    "when is; every run holds it: must be another",
    "expectations: [{expect: precedence, first: {rule: hold}, then: {rule: hold}}]": "expectations.0.then: is rule "
    "hold, as first is; every run holds it: must be another",
    "expectations: [{expect: always, of: {component: lrf, code: 1}}]": "0.of.code: is the lowest, at or above "
    "which every code is; must be 2, 4, 8 or 16",
    "anchors: {one: {happens: {component: lrf, code: 1}}}": "anchors.one.happens.code: is the lowest, at or above "
    "which every code is; must be 2, 4, 8 or 16",
    "matrix: {seed: [1, 2, 1]}": "matrix.seed: has 1 twice; must have each value once",
    "matrix: {faults.3.at_s: [1.0, 2.0]}": "matrix.faults.3.at_s: addresses nothing; must be a key of the scenario",
    "expectations: [{expect: always, of: {rule: hold}}]": "must be what lasts: a state or a component's code",
    "expectations: [{expect: count, of: {rule: hold}}]": "has no limit; must have at_least or at_most",
    "expectations: [{expect: response, when: {rule: hold}, then: {rule: land}}]": "within_s: is missing",
    "expectations: [{expect: exists, of: {rule: hold}, from: nowhere}]": "nowhere is no anchor; must be one of none",
    "anchors: {one: {fault: 1}}": "anchors.one.fault: is 1; there is no fault",
    "bags: [{path: a.bag}]\nfrom_s: 6\nto_s: 3": "to_s: is 3; must be above from_s (6)",
    "bags: [{path: a.bag}]\nmissions: [1, 2]": "missions: has 2; must be one with bags: a recording is of one mission",
    "anchors: {one: {value: height_m}}": "has no level; must have above or below with value only",
    "anchors: {one: {}}": "has nothing; must have one of at_s, happens, fault, value",
    "matrix: {seed: [1]}": "must be a list of at least two values",
    "matrix: {description: [a, b]}": "cannot vary",
    "bags: [{path: a.bag}]\njournal: b.jsonl": "has both bags and journal",
    "configuration: {set: {sensor.x: 1}}": "is not a good name",
    "map: x": "map: is an unknown key",
    "faults: [{component: lrf, fault: silnt}]": "did you mean silent?",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_one_line(text):
    with pytest.raises(ConfigError) as error:
        simulation(text)
    assert MISTAKES[text] in str(error.value)
    assert str(error.value).startswith("folder/x.scenario.yaml:")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "limits",
    [
        "expect: count, of: {state: HOLD}, at_least: 0, at_most: 3",
        "expect: count, of: {state: HOLD}, at_most: 0",
        "expect: duration, of: {state: HOLD}, at_least_s: 0.0, at_most_s: 3.0",
        "expect: share, of: {state: HOLD}, at_least_fraction: 0.0, at_most_fraction: 0.5",
        "expect: share, of: {state: HOLD}, at_most_fraction: 0.0",
    ],
)
def test_a_limit_that_every_run_holds_may_stand_beside_one_that_can_fail(limits):
    (case,) = simulation(f"expectations: [{{{limits}}}]")
    assert len(case.expectations) == 1


def test_the_line_of_an_anchor_that_is_not_there_is_said():
    with pytest.raises(ConfigError, match=r"yaml:5: expectations.0.from: fail is no anchor; did you mean fails"):
        simulation("anchors: {fails: {at_s: 1.0}}\nexpectations:\n  - {expect: never, of: {rule: hold}, from: fail}")


def test_two_values_of_a_matrix_that_would_have_one_name_are_two_cases():
    found = simulation(
        "matrix:\n  faults:\n    - [{component: lrf, fault: silent, at_s: 1.0}]\n    - []\n"
        "    - [{component: lrf, fault: silent, at_s: 2.0}]\n    - [{component: lrf, fault: silent, at_s: 3.0}]\n"
    )
    assert [case.variant for case in found] == [
        "faults=lrf-silent",
        "faults=",
        "faults=lrf-silent-2",
        "faults=lrf-silent-3",
    ]
    assert [case.faults[0].trigger.at_ns for case in found if case.faults] == [S, 2 * S, 3 * S]
    assert len({case.id for case in found}) == 4


PLACED = {
    "bags: [{path: a.bag}]\nfrom_s: 9.0\nto_s: 5.0\n": "yaml:5: to_s: is 5; must be above from_s \\(9\\)",
    "bags:\n  - {path: a.bag}\n  - {path: a.bag}\n": "yaml:5: bags.1.path: is a.bag again; must name each bag once",
    "anchors:\n  one: {at_s: 1.0}\n  two: {fault: 2}\n": "yaml:5: anchors.two.fault: is 2; there is no fault",
}


@pytest.mark.parametrize("text", PLACED)
def test_a_mistake_between_two_keys_has_the_line_of_one(text):
    with pytest.raises(ConfigError, match=PLACED[text]):
        simulation(text)


def test_a_word_that_is_meant_is_named_instead_of_a_hundred():
    with pytest.raises(ConfigError) as error:
        simulation("expectations: [{expect: exists, of: {rule: landd}}]")
    assert str(error.value) == (
        "folder/x.scenario.yaml:3: expectations.0.of.rule: is the text 'landd'; "
        f"must be one of {len(RULES)} words; did you mean landed?"
    )


def test_a_version_that_is_not_known_is_refused():
    with pytest.raises(ConfigError, match="version: is the text '2'; must be one of 1"):
        cases("version: 2\ndescription: x\n")


def test_files_are_found_in_folders_in_order(tmp_path):
    for name in ("b/two.scenario.yaml", "a.scenario.yaml", "faults.yaml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("version: 1\ndescription: x\n")
    assert [path.name for path in find_files([tmp_path])] == ["a.scenario.yaml", "two.scenario.yaml"]
    assert load_cases(tmp_path / "a.scenario.yaml")[0].name == "a"
    with pytest.raises(ReplayError, match="there is no scenario; name a folder"):
        find_files([tmp_path / "nothing"])
