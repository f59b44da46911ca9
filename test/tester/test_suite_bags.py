"""Scenarios on a real recording: what it must offer, and faults of peers, engine and clock in it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from amaze_autonomy.tester import Options, run_task, tasks_of

DATA = Path(os.environ.get("AMAZE_DATA", Path(__file__).parents[3] / "shared" / "data"))
BAG = DATA / "crazyflie_sine.bag"
pytestmark = pytest.mark.skipif(not BAG.is_file(), reason="no recordings: set AMAZE_DATA")
SMALL = "configuration: {set: {autonomy.takeoff.takeoff_height_m: 0.3}}\n"
FAULT = "faults:\n  - {%s}\n"


def result(more, bag=f"{{path: {BAG}}}", small=SMALL):
    text = f"version: 1\ndescription: x\nbags: [{bag}]\nmap: crazyflie_sine\n{small}{more}"
    Path("x.scenario.yaml").write_text(text)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    return run_task(task)


def rules(found):
    return [line.split('"rule":"')[1].split('"')[0] for line in found.lines]


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


INCONCLUSIVE = {
    "needs: [{topic: /cf1/imu, rate_hz: 150.0}]\n": "/cf1/imu: ",
    "needs: [{topic: /cf1/imu, gap_s: 0.001}]\n": "/cf1/imu: silent for ",
    "needs: [{topic: /nothing}]\n": "/nothing: is needed, and the map does not read it",
}


@pytest.mark.parametrize("more", INCONCLUSIVE)
def test_a_recording_that_does_not_offer_what_is_needed_is_inconclusive(more):
    found = result(more + "expectations:\n  - {expect: exists, of: {state: PILOT}}\n")
    assert found.verdict.value == "INCONCLUSIVE"
    assert found.headline.startswith(INCONCLUSIVE[more])


def test_another_file_than_the_scenario_was_written_for_is_inconclusive():
    found = result("", f"{{path: {BAG}, sha256: '{'0' * 64}'}}")
    assert (found.verdict.value, found.headline.split(": ")[1]) == (
        "INCONCLUSIVE",
        "is another file than the scenario was written for (sha256 differs)",
    )


def test_a_recording_without_a_message_is_inconclusive():
    found = result("", f"{{path: {DATA / 'no_messages.bag'}}}")
    assert (found.verdict.value, found.headline) == ("INCONCLUSIVE", "no_messages.bag: there is no message in it")


SEEN = {
    "service: mission_planner/load, fault: refuses": ["planner_refused"],
    "service: mission_planner/load, fault: hangs": ["planner_silent"],
    "process: mission_planner, fault: silent, after: {state: MISSION}": ["land_by_both_routes"],
    "process: autonomy, fault: interrupted, after: {state: MISSION}": ["shutdown_in_flight"],
    "process: autonomy, fault: restarted, journal: lost, for_s: 1.0, after: {state: MISSION}": ["started_armed"],
    "fault: storage_full, after: {state: MISSION}": ["failure_continue"],
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("fault", SEEN)
def test_peers_and_engine_fail_in_a_recording(fault):
    flies = "mission_planner/load" not in fault  # else nothing asks how high a takeoff is
    found = result(FAULT % fault + "to_s: 22.0\n", small=SMALL if flies else "")
    assert found.problems == ()
    assert set(SEEN[fault]) <= set(rules(found))


EMPTY = {
    "service: autopilot/disarm, fault: refuses": "autopilot/disarm refuses touched nothing",
    "component: lrf, fault: silent, after: {state: PILOT}": "lrf silent never began",
    "topic: /cf1/imu, fault: stamped, to: zero, at_s: 25.9": "/cf1/imu stamped touched nothing",
}


@pytest.mark.parametrize("fault", EMPTY)
def test_a_fault_that_touches_nothing_is_vacuous(fault):
    found = result(FAULT % fault)
    assert (found.verdict.value, found.headline) == ("VACUOUS", EMPTY[fault])


WRONG = {
    "topic: /imu, fault: silent": "the map reads no topic /imu; did you mean /cf1/imu?",
    "component: gps, fault: silent": "the map has no component gps; it has imu, lrf",
    "component: lrf, fault: silent, after: {event: airborne}": "a recording has no events; use at_s, or after",
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_fault_that_cannot_be_is_an_error(fault):
    found = result(FAULT % fault)
    assert found.verdict.value == "ERROR"
    assert WRONG[fault] in found.headline


def test_the_user_asks_in_a_recording():
    found = result("requests:\n  - {request: land, after: {state: MISSION, delay_s: 1.0}}\n")
    assert "user_land" in rules(found)
