"""Services that refuse, hang, vanish, break, answer late or lie; processes that die in mid-call."""

import pytest
from simulation_tools import Driver, S

from amaze_autonomy.engine.commands import LoadMission, RunCheck
from amaze_autonomy.engine.events import CheckName, CheckReply, MissionPhase, Outcome, Reply, Verdict

LOAD = {"session_id": "a", "mission_id": "1", "file_index": 0, "repetition": 0}


def load(faults, limit_s=1.0, wait_s=5.0, **more):
    """Ask the planner to load; return the driver, and (seconds after, outcome, message) of every reply."""
    driver = Driver(faults, **more)
    driver.go_on(1.0)
    asked_ns = driver.world.now_ns
    driver.send(LoadMission, limit_s=limit_s, **LOAD)
    replies = [event for event in driver.go_on(wait_s) if isinstance(event, Reply)]
    return driver, [((reply.t_ns - asked_ns) / S, reply.outcome, reply.message) for reply in replies]


def test_a_service_that_works_answers_within_milliseconds():
    driver, ((after_s, outcome, _),) = load("")
    assert outcome is Outcome.ACCEPTED
    assert 0.001 < after_s < 0.02
    assert driver.planner.phase is MissionPhase.LOADED


SPOILT = (
    ("refuses", 0.02, Outcome.REFUSED, MissionPhase.IDLE),
    ("hangs", 1.0, Outcome.TIMED_OUT, MissionPhase.IDLE),
    ("vanishes", 0.001, Outcome.UNAVAILABLE, MissionPhase.IDLE),
    ("breaks", 0.02, Outcome.BROKEN, MissionPhase.IDLE),
    ("lies", 0.02, Outcome.ACCEPTED, MissionPhase.IDLE),
)


@pytest.mark.parametrize("kind, at_most_s, outcome, phase", SPOILT, ids=[case[0] for case in SPOILT])
def test_a_service_that_does_not_work_answers_so_and_does_nothing(kind, at_most_s, outcome, phase):
    driver, ((after_s, told, _),) = load(f"service: mission_planner/load, fault: {kind}")
    assert told is outcome
    assert after_s <= at_most_s
    assert driver.planner.phase is phase


@pytest.mark.parametrize("kind", [case[0] for case in SPOILT])
def test_once_the_fault_is_over_it_works_again(kind):
    driver = Driver(f"service: mission_planner/load, fault: {kind}, for_s: 2")
    driver.go_on(3.0)
    assert driver.load().outcome is Outcome.ACCEPTED
    driver.go_on(1.0)
    assert driver.planner.phase is MissionPhase.LOADED


def test_another_service_of_the_same_peer_is_not_touched():
    driver = Driver("service: mission_planner/command, fault: hangs")
    driver.go_on(1.0)
    assert driver.load().outcome is Outcome.ACCEPTED


def test_a_slow_service_does_it_at_once_and_answers_late():
    driver, ((after_s, outcome, _),) = load("service: mission_planner/load, fault: slow, delay_s: 0.8")
    assert outcome is Outcome.ACCEPTED
    assert 0.8 < after_s < 0.82
    assert driver.planner.phase is MissionPhase.LOADED


def test_an_answer_that_comes_after_the_limit_comes_too():
    _, replies = load("service: mission_planner/load, fault: slow, delay_s: 3")
    assert [outcome for _, outcome, _ in replies] == [Outcome.TIMED_OUT, Outcome.ACCEPTED]
    assert replies[0][0] == pytest.approx(1.0, abs=0.001)
    assert replies[1][0] == pytest.approx(3.0, abs=0.02)


def test_live_a_service_that_hangs_never_answers():
    _, replies = load("service: mission_planner/load, fault: hangs", wait_s=60.0, live=True)
    assert replies == []


def test_live_an_answer_has_no_limit():
    _, replies = load("service: mission_planner/load, fault: slow, delay_s: 3", live=True)
    assert [outcome for _, outcome, _ in replies] == [Outcome.ACCEPTED]


def test_a_process_that_dies_breaks_the_calls_to_it():
    faults = "service: mission_planner/load, fault: hangs\nprocess: mission_planner, fault: killed, at_s: 1.5"
    _, ((after_s, outcome, message),) = load(faults)
    assert (outcome, message) == (Outcome.BROKEN, "mission_planner has died in mid-call")
    assert after_s == pytest.approx(0.5)


def test_the_services_of_a_dead_process_are_not_there():
    driver = Driver("process: autopilot, fault: killed, at_s: 1, for_s: 2\nservice: watchdog/start, fault: vanishes")
    driver.go_on(0.5)
    there = set(driver.world.services())
    driver.go_on(1.0)
    assert there - set(driver.world.services()) == {
        "autopilot/check",
        "autopilot/check_battery",
        "autopilot/land",
        "autopilot/disarm",
    }
    assert "watchdog/start" not in there
    driver.go_on(2.0)
    assert set(driver.world.services()) == there


def checked(kind):
    driver = Driver(f"service: autopilot/check, fault: {kind}")
    driver.go_on(1.0)
    return driver.ask(RunCheck, check=CheckName.AUTOPILOT)


def test_a_check_that_refuses_has_a_row_that_failed():
    reply = checked("refuses")
    assert isinstance(reply, CheckReply)
    assert (reply.outcome, reply.ok) == (Outcome.ACCEPTED, False)
    assert [(row.name, row.verdict) for row in reply.checks] == [("autopilot", Verdict.FAIL)]


def test_a_check_that_lies_says_that_all_is_well_and_shows_nothing():
    reply = checked("lies")
    assert (reply.outcome, reply.ok, reply.checks) == (Outcome.ACCEPTED, True, ())


def test_a_check_that_hangs_times_out_as_a_check():
    reply = checked("hangs")
    assert isinstance(reply, CheckReply)
    assert (reply.check, reply.outcome, reply.ok) == (CheckName.AUTOPILOT, Outcome.TIMED_OUT, False)
