"""Each kind of expectation: met, missed with its margin, and vacuous."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from amaze_autonomy.engine.commands import Decision, Value
from amaze_autonomy.tester.expect import Finding, Grade, Span, Trace, judge
from amaze_autonomy.tester.scenario import parse_cases

S = 1_000_000_000


def decision(t_s, before, after, rule, *, step="", commands=(), values=()):
    return Decision(
        t_ns=round(t_s * S),
        sequence=0,
        event="Tick",
        before=before,
        after=after,
        step=step,
        rule=rule,
        values=values,
        commands=commands,
    )


FAILS = decision(10, "MISSION", "MISSION", "failure_wait", values=(Value("failure", "lrf"),))
HOLDS = decision(10.36, "MISSION", "HOLD", "hold", step="confirming", commands=("MissionCommand(HOLD)#9",))
LANDS = decision(14, "HOLD", "LAND", "land", step="commanding", commands=("MissionCommand(LAND)#10",))
TRACE = Trace(
    start_ns=0,
    end_ns=20 * S,
    decisions=(decision(5, "TAKEOFF", "MISSION", "at_takeoff_height", step="flying"), FAILS, HOLDS, LANDS),
    states=(
        Span(0, 5 * S, "MISSION_INPUT/"),
        Span(5 * S, 10_360_000_000, "MISSION/flying"),
        Span(10_360_000_000, 14 * S, "HOLD/confirming"),
        Span(14 * S, 20 * S + 1, "LAND/commanding"),
    ),
    codes={"lrf": (Span(0, 10 * S, "1"), Span(10 * S, 20 * S + 1, "8"))},
)


def found(expectation, anchors=None, trace=TRACE):
    head = "version: 1\ndescription: x\nanchors: {fails: {at_s: 10.0}, gone: {at_s: 1.0}}\n"
    text = f"{head}expectations:\n  - {expectation}\n"
    (case,) = parse_cases(text, Path("x.scenario.yaml"))
    return judge(case.expectations[0], trace, anchors or {"fails": 10 * S, "gone": None})


def test_a_finding_says_everything():
    assert found("{expect: exists, of: {command: HOLD}, from: fails, within_s: 0.4}") == Finding(
        expectation="exists command HOLD, within_s 0.4, from fails",
        grade=Grade.PASS,
        text="at +10.360 s, 0.360 s after",
        margin=0.04,
        limit=0.4,
        unit="s",
        begin_s=10.0,
        end_s=20.0,
        where="x.scenario.yaml:5",
    )


CASES = {
    "{expect: exists, of: {command: HOLD}, from: fails, within_s: 0.4}": ("PASS", "0.04 s of 0.4 s left"),
    "{expect: exists, of: {command: HOLD}, from: fails, within_s: 0.3}": ("FAIL", "missed by 0.06 s of 0.3 s"),
    "{expect: exists, of: {state: PILOT}}": ("FAIL", ""),
    "{expect: exists, of: {state: HOLD}, from: 12.0}": ("PASS", ""),  # it is in it
    "{expect: exists, of: {failure: lrf}}": ("PASS", ""),
    "{expect: exists, of: {command: HOLD}, from: gone}": ("VACUOUS", ""),
    "{expect: never, of: {state: PILOT}}": ("PASS", ""),
    "{expect: never, of: {state: HOLD}, from: 12.0}": ("FAIL", ""),  # it lasts into the window
    "{expect: never, of: {rule: land}, to: 13.0}": ("PASS", ""),
    "{expect: never, of: {rule: land}, from: 25.0}": ("VACUOUS", ""),
    "{expect: always, of: {state: [HOLD, LAND]}, from: 10.4}": ("PASS", ""),
    "{expect: always, of: {state: MISSION, step: flying}, from: 5.0}": ("FAIL", ""),
    "{expect: response, when: {component: lrf, code: 8}, then: {command: HOLD}, within_s: 0.4}": (
        "PASS",
        "0.04 s of 0.4 s left",
    ),
    "{expect: response, when: {component: lrf, code: 8}, then: {command: RESUME}, within_s: 9.0}": ("FAIL", ""),
    "{expect: response, when: {component: lrf, code: 16}, then: {command: LAND}, within_s: 9.0}": ("VACUOUS", ""),
    "{expect: precedence, first: {command: HOLD}, then: {command: LAND}}": ("PASS", "3.64 s left"),
    "{expect: precedence, first: {command: LAND}, then: {command: HOLD}}": ("FAIL", ""),
    "{expect: precedence, first: {command: LAND}, then: {state: PILOT}}": ("VACUOUS", ""),
    "{expect: sequence, of: [{state: MISSION}, {rule: hold}, {command: LAND}]}": ("PASS", ""),
    "{expect: sequence, of: [{command: LAND}, {rule: hold}]}": ("FAIL", ""),
    "{expect: sequence, of: [{rule: hold}, {rule: hold}]}": ("FAIL", ""),  # it happened once
    "{expect: count, of: {command: LAND}, at_least: 1, at_most: 3}": ("PASS", "0 of 1 left"),
    "{expect: count, of: {command: LAND}, at_least: 2}": ("FAIL", "missed by 1 of 2"),
    "{expect: duration, of: {state: HOLD}, at_most_s: 4.0}": ("PASS", "0.36 s of 4 s left"),
    "{expect: duration, of: {state: HOLD}, at_least_s: 4.0}": ("FAIL", "missed by 0.36 s of 4 s"),
    "{expect: duration, of: {state: PILOT}, at_most_s: 4.0}": ("VACUOUS", ""),
    "{expect: share, of: {state: LAND}, at_least_fraction: 0.25}": ("PASS", "0.05 of 0.25 left"),
    "{expect: share, of: {state: LAND}, at_most_fraction: 0.25}": ("FAIL", "missed by 0.05 of 0.25"),
}

UNFINISHED = {
    "{expect: never, of: {state: PILOT}, to: 30.0}": (
        "VACUOUS",
        "not between +0.000 s and +20.000 s, and the run ends there, before +30.000 s",
    ),
    "{expect: never, of: {state: PILOT}, to: 20.9}": ("PASS", "not between +0.000 s and +20.000 s"),  # it is rounded
    "{expect: never, of: {state: LAND}, to: 30.0}": ("FAIL", "LAND at +14.000 s"),
    "{expect: always, of: {state: [HOLD, LAND]}, from: 10.4, to: 30.0}": (
        "VACUOUS",
        "between +10.400 s and +20.000 s, and the run ends there, before +30.000 s",
    ),
    "{expect: count, of: {command: LAND}, at_most: 3, to: 30.0}": (
        "VACUOUS",
        "1 times between +0.000 s and +20.000 s, and the run ends there, before +30.000 s",
    ),
    "{expect: count, of: {command: LAND}, at_least: 1, to: 30.0}": ("PASS", "1 times between +0.000 s and +20.000 s"),
    "{expect: count, of: {command: LAND}, at_most: 0, to: 30.0}": ("FAIL", "1 times between +0.000 s and +20.000 s"),
    "{expect: duration, of: {state: HOLD}, at_most_s: 4.0, to: 13.0}": (
        "VACUOUS",
        "2.640 s from +10.360 s, and had not ended at +13.000 s",
    ),
    "{expect: duration, of: {state: LAND}, at_most_s: 7.0}": (
        "VACUOUS",
        "6.000 s from +14.000 s, and had not ended at +20.000 s",
    ),
    "{expect: duration, of: {state: LAND}, at_least_s: 1.0, at_most_s: 7.0}": (
        "VACUOUS",
        "6.000 s from +14.000 s, and had not ended at +20.000 s",
    ),
    "{expect: duration, of: {state: HOLD}, at_most_s: 2.0, to: 13.0}": ("FAIL", "2.640 s from +10.360 s"),
    "{expect: duration, of: {state: HOLD}, at_most_s: 2.0, from: 13.0}": (
        "VACUOUS",
        "1.000 s from +13.000 s, and had begun before",
    ),
    "{expect: duration, of: {state: HOLD}, at_most_s: 2.0, from: 12.0, to: 13.0}": (
        "VACUOUS",
        "1.000 s from +12.000 s, and had begun before, and had not ended at +13.000 s",
    ),
    "{expect: duration, of: {state: HOLD}, at_most_s: 0.5, from: 13.0}": ("FAIL", "1.000 s from +13.000 s"),
    "{expect: duration, of: {state: HOLD}, at_least_s: 0.5, from: 13.0}": ("PASS", "1.000 s from +13.000 s"),
    "{expect: duration, of: {state: MISSION}, at_most_s: 5.5, from: 5.0}": (
        "PASS",
        "5.360 s from +5.000 s",
    ),  # it begins
    "{expect: share, of: {state: LAND}, from: 14.0, to: 60.0, at_least_fraction: 0.9}": (
        "VACUOUS",
        "1.000 of the time between +14.000 s and +20.000 s, and the run ends there, before +60.000 s",
    ),
    "{expect: share, of: {state: HOLD}, from: 14.0, to: 60.0, at_most_fraction: 0.1}": (
        "VACUOUS",
        "0.000 of the time between +14.000 s and +20.000 s, and the run ends there, before +60.000 s",
    ),
    "{expect: share, of: {state: LAND}, from: 14.0, to: 20.9, at_least_fraction: 0.9}": (
        "PASS",
        "1.000 of the time between +14.000 s and +20.000 s",
    ),
    "{expect: duration, of: {state: [MISSION, LAND]}, at_most_s: 5.5}": ("FAIL", "6.000 s from +14.000 s"),
    "{expect: duration, of: {state: [MISSION, LAND]}, at_most_s: 5.2}": ("FAIL", "6.000 s from +14.000 s"),
    "{expect: duration, of: {state: LAND}, at_least_s: 5.0}": ("PASS", "6.000 s from +14.000 s"),
    "{expect: duration, of: {state: HOLD}, at_most_s: 4.0, to: 14.0}": ("PASS", "3.640 s from +10.360 s"),  # it ends
}


@pytest.mark.parametrize("expectation", UNFINISHED)
def test_how_long_something_is_that_has_not_ended_is_not_known(expectation):
    finding = found(expectation)
    assert (finding.grade.value, finding.text) == UNFINISHED[expectation]


BEHIND = {
    "{expect: never, of: {state: PILOT}, to: fails}": (
        "VACUOUS",
        "not between +0.000 s and +20.000 s, and the run ends there, before +30.000 s",
    ),
    "{expect: always, of: {state: LAND}, from: 14.0, to: fails}": (
        "VACUOUS",
        "between +14.000 s and +20.000 s, and the run ends there, before +30.000 s",
    ),
    "{expect: count, of: {command: LAND}, to: fails, at_most: 1}": (
        "VACUOUS",
        "1 times between +0.000 s and +20.000 s, and the run ends there, before +30.000 s",
    ),
    "{expect: never, of: {state: LAND}, to: fails}": ("FAIL", "LAND at +14.000 s"),
    "{expect: count, of: {command: LAND}, to: fails, at_least: 1}": (
        "PASS",
        "1 times between +0.000 s and +20.000 s",
    ),
}


@pytest.mark.parametrize("expectation", BEHIND)
def test_an_anchor_behind_the_end_of_the_run_is_as_a_time_there(expectation):
    finding = found(expectation, {"fails": 30 * S})
    assert (finding.grade.value, finding.text) == BEHIND[expectation]
    assert found("{expect: never, of: {state: PILOT}, to: fails}", {"fails": 20 * S + S // 2}).grade is Grade.PASS


@pytest.mark.parametrize("expectation", CASES)
def test_grade_and_margin(expectation):
    finding = found(expectation)
    assert (finding.grade.value, finding.margin_text) == CASES[expectation]


NOBODY = {
    "{expect: never, of: {component: gps, code: 2}}": "nobody watched gps in this run",
    "{expect: exists, of: {component: gps, code: 2}}": "nobody watched gps in this run",
    "{expect: count, of: {component: gps, code: 2}, at_most: 0}": "nobody watched gps in this run",
    "{expect: share, of: {component: gps, code: 2}, at_most_fraction: 0.0}": "nobody watched gps in this run",
    "{expect: never, of: {failure: gps}}": "nobody watched gps in this run",
    "{expect: sequence, of: [{rule: hold}, {failure: gps}]}": "nobody watched gps in this run",
}


@pytest.mark.parametrize("expectation", NOBODY)
def test_what_nobody_watched_is_vacuous(expectation):
    finding = found(expectation)
    assert (finding.grade, finding.text) == (Grade.VACUOUS, NOBODY[expectation])


@pytest.mark.parametrize("name", ["lrf", "battery_critical", "user_hold"])
def test_what_was_watched_and_every_loss_can_fail_so_that_never_is_judged(name):
    assert found(f"{{expect: never, of: {{failure: {name}}}, from: 12.0}}").grade is Grade.PASS


def test_a_loss_whose_value_is_unknown_all_along_cannot_be_seen():
    never = "{expect: never, of: {failure: %s}}"
    assert found(never % "tilt").text == "nothing shows tilt in this run: tilt is unknown all along"
    assert found(never % "battery_critical").grade is Grade.PASS  # the autopilot can say so itself
    known = replace(TRACE, readings={"tilt_deg": ((3 * S, 1.0),)})
    assert found(never % "tilt", trace=known).grade is Grade.PASS
    later = replace(known, begin_ns=4 * S)  # it was the script's, before the recording
    assert found(never % "tilt", trace=later).grade is Grade.VACUOUS
    blind = replace(known, blind={"tilt": "autopilot: scripted, not recorded"})
    words = "nothing shows tilt in this run: autopilot: scripted, not recorded"
    assert found(never % "tilt", trace=blind).text == words
    tilted = decision(12, "HOLD", "HOLD", "failure_land", values=(Value("failure", "tilt"),))
    assert found(never % "tilt", trace=replace(blind, decisions=(*TRACE.decisions, tilted))).grade is Grade.FAIL


def test_a_pilot_whom_nothing_can_show_is_judged_where_one_is_there():
    never = "{expect: never, of: {state: PILOT}}"
    blind = replace(TRACE, blind={"PILOT": "scripted, not recorded"})
    assert found(never, trace=blind).text == "nothing shows a pilot in this run: scripted, not recorded"
    taken = decision(12, "MISSION", "PILOT", "pilot_took_over")
    assert found("{expect: exists, of: {rule: pilot_took_over}}", trace=replace(blind, decisions=(taken,))).grade is (
        Grade.PASS
    )


AT_ONCE = Trace(
    start_ns=0,
    end_ns=20 * S,
    decisions=(
        decision(10, "MISSION", "MISSION", "failure_land", step="flying", values=(Value("failure", "lrf"),)),
        decision(
            10,
            "MISSION",
            "LAND",
            "land",
            step="commanding",
            commands=("MissionCommand(LAND)#9", "StopRecording#10"),
        ),
    ),
    states=(Span(0, 10 * S, "MISSION/flying"), Span(10 * S, 20 * S + 1, "LAND/commanding")),
    codes={"lrf": (Span(0, 10 * S, "1"), Span(10 * S, 20 * S + 1, "16"))},
)
"""One event makes two decisions, the second with two commands."""
IN_ORDER = {
    "{expect: sequence, of: [{rule: failure_land}, {rule: land}]}": "PASS",
    "{expect: sequence, of: [{rule: land}, {rule: failure_land}]}": "FAIL",
    "{expect: sequence, of: [{state: LAND}, {command: LAND}]}": "PASS",
    "{expect: sequence, of: [{rule: land}, {state: LAND}, {command: LAND}]}": "PASS",
    "{expect: sequence, of: [{state: LAND}, {failure: lrf}]}": "FAIL",
    "{expect: sequence, of: [{command: LAND}, {command: StopRecording}]}": "PASS",
    "{expect: sequence, of: [{command: StopRecording}, {command: LAND}]}": "FAIL",
    "{expect: sequence, of: [{component: lrf, code: 16}, {failure: lrf}, {command: LAND}]}": "PASS",
    "{expect: sequence, of: [{command: LAND}, {component: lrf, code: 16}]}": "FAIL",
    "{expect: sequence, of: [{state: MISSION}, {state: LAND}], from: 5.0}": "PASS",
    "{expect: sequence, of: [{state: LAND}, {rule: failure_land}], from: 10.0}": "FAIL",
    "{expect: precedence, first: {rule: failure_land}, then: {command: LAND}}": "PASS",
    "{expect: precedence, first: {rule: land}, then: {rule: failure_land}}": "FAIL",
    "{expect: precedence, first: {command: LAND}, then: {rule: failure_land}}": "FAIL",
    "{expect: precedence, first: {command: LAND}, then: {command: StopRecording}}": "PASS",
    "{expect: precedence, first: {command: StopRecording}, then: {command: LAND}}": "FAIL",
}


@pytest.mark.parametrize("expectation", IN_ORDER)
def test_what_happens_at_one_moment_has_an_order(expectation):
    assert found(expectation, trace=AT_ONCE).grade.value == IN_ORDER[expectation]
