"""Triggers: when a fault begins and ends, and when the user's requests are due."""

from simulation_tools import S, scenario

from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.simulation.faults import Faults
from amaze_autonomy.simulation.scenario import Subject


def told(changes):
    return [(change.t_ns / S, str(getattr(change.what, "command", change.what)), change.begins) for change in changes]


def test_begins_at_a_time_after_the_start_of_the_world():
    faults = Faults(scenario("component: lrf, fault: silent, at_s: 2"), start_ns=100 * S)
    assert faults.next_ns == 102 * S
    assert faults.advance(102 * S - 1) == ()
    assert told(faults.advance(102 * S)) == [(102.0, "lrf silent", True)]
    assert faults.next_ns is None


def test_without_a_trigger_it_acts_from_the_start():
    assert told(Faults(scenario("fault: does_not_arm")).advance(0)) == [(0.0, "does_not_arm", True)]


def test_begins_some_time_after_an_event():
    faults = Faults(scenario("component: lrf, fault: silent, after: {event: airborne, delay_s: 3}"))
    assert faults.next_ns is None
    faults.observe(10 * S, event="takeoff")
    assert faults.next_ns is None
    faults.observe(11 * S, event="airborne")
    assert told(faults.advance(20 * S)) == [(14.0, "lrf silent", True)]


def test_an_event_that_happens_again_does_not_begin_it_again():
    faults = Faults(scenario("component: lrf, fault: silent, after: {event: airborne}, for_s: 1"))
    faults.observe(1 * S, event="airborne")
    faults.advance(5 * S)
    faults.observe(6 * S, event="airborne")
    assert faults.next_ns is None


def test_waits_for_the_occurrence_that_is_named():
    faults = Faults(scenario("component: lrf, fault: silent, after: {event: airborne, occurrence: 2}"))
    faults.observe(1 * S, event="airborne")
    assert faults.next_ns is None
    faults.observe(2 * S, event="airborne")
    assert faults.next_ns == 2 * S


def test_waits_for_the_waypoint_that_is_named():
    faults = Faults(scenario("component: lrf, fault: silent, after: {event: waypoint, number: 2}"))
    faults.observe(1 * S, event="waypoint", number=1)
    assert faults.next_ns is None
    faults.observe(2 * S, event="waypoint", number=2)
    assert faults.next_ns == 2 * S


def test_a_state_of_the_engine_is_not_an_event_of_the_same_name():
    faults = Faults(scenario(requests="request: retry, after: {state: OUTREACH, delay_s: 1}"))
    faults.observe(1 * S, event="OUTREACH")
    assert not faults.requests_to_come
    faults.observe(2 * S, state="OUTREACH")
    assert faults.requests_to_come
    assert [change.what.command for change in faults.advance(3 * S)] == [UserCommand.RETRY]
    assert not faults.requests_to_come


def test_ends_after_its_time():
    faults = Faults(scenario("component: lrf, fault: silent, at_s: 1, for_s: 2"))
    assert told(faults.advance(10 * S)) == [(1.0, "lrf silent", True), (3.0, "lrf silent", False)]
    assert faults.on(Subject.COMPONENT, "lrf") == ()


def test_acts_between_beginning_and_end_on_its_own_target_alone():
    faults = Faults(scenario("component: lrf, fault: silent, at_s: 1"))
    assert faults.active(Subject.COMPONENT, "silent", "lrf") is None
    faults.advance(1 * S)
    ((fault, since),) = faults.on(Subject.COMPONENT, "lrf")
    assert (str(fault), since) == ("lrf silent", 1 * S)
    assert faults.active(Subject.COMPONENT, "silent", "lrf") is fault
    assert faults.active(Subject.COMPONENT, "killed", "lrf") is None
    assert faults.on(Subject.COMPONENT, "camera") == ()
    assert faults.on(Subject.PROCESS, "lrf") == ()


def test_a_fault_that_was_ended_early_does_not_end_again():
    faults = Faults(scenario("component: lrf, fault: silent, at_s: 1, for_s: 10"))
    faults.advance(1 * S)
    ((fault, _),) = faults.on(Subject.COMPONENT, "lrf")
    faults.end(2 * S, fault)
    assert told(faults.advance(20 * S)) == [(2.0, "lrf silent", False)]


def test_ending_a_fault_that_does_not_act_changes_nothing():
    story = scenario("component: lrf, fault: silent, at_s: 1")
    faults = Faults(story)
    faults.end(0, story.faults[0])
    assert told(faults.advance(0)) == []


def test_of_changes_at_the_same_time_the_first_in_the_file_comes_first():
    faults = Faults(
        scenario(
            "component: lrf, fault: silent, at_s: 1\ncomponent: camera, fault: killed, at_s: 1", "request: go, at_s: 1"
        )
    )
    assert [str(getattr(change.what, "command", change.what)) for change in faults.advance(S)] == [
        "lrf silent",
        "camera killed",
        "UserCommand.GO",
    ]
