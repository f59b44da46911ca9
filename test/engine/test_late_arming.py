"""An ARM of ours that takes effect after its takeoff was called off: whoever sent it stays responsible.

PX4 tells once a second whether it is armed, and the planner's order may be on its way when the takeoff is cancelled.
"""

from __future__ import annotations

import pytest
from engine_beginnings import at
from engine_peers import S
from engine_story import Story

from amaze_autonomy.engine import events as ev


def called_off(how: str) -> Story:
    """Tell a takeoff that is called off before the vehicle shows that it is armed, and believed to be over."""
    story = at("TAKEOFF arming")
    if how == "failed":
        story.planner.phase, story.planner.says["message"] = ev.MissionPhase.FAILED, "arm: not shown within 4 s"
    elif how == "failure":
        story.fail("lrf", 8)
    else:
        story.user(how)
    story.after(0.4)
    assert not story.state.flight.active
    assert not story.state.flight.was_armed
    return story.look()


HOW = pytest.mark.parametrize("how", ["abort", "land", "failure", "failed"])


@HOW
@pytest.mark.parametrize("after_s", [0.1, 0.9, 5.0])
def test_it_is_disarmed_by_us_on_the_ground(how, after_s):
    story = called_off(how).after(after_s)
    story.vehicle.armed = True
    story.after(0.5)
    assert story.motions[:1] == ["LAND"]
    assert "pilot" not in story.told
    story.after(2.0)
    assert story.vehicle.armed is False
    assert not story.is_in("PILOT")


@HOW
def test_it_is_landed_by_us_when_it_has_lifted_off(how):
    story = called_off(how).after(0.9)
    story.vehicle.armed = True
    story.vehicle.take_off()
    story.until("LAND", limit_s=0.5)
    assert story.motions[:1] == ["LAND"]
    story.until("DATA_CLEANUP", limit_s=30.0)
    assert story.state.session.flown


def test_a_retry_meanwhile_does_not_change_whose_it_is():
    story = called_off("abort")
    assert story.user("retry")[0] == "DONE"
    story.expect("PREFLIGHT").look()
    story.vehicle.armed = True
    story.until("LAND", limit_s=0.5)


def test_it_was_not_flown_when_it_never_lifted_off():
    story = called_off("land").after(0.5)
    story.vehicle.armed = True
    story.until("LAND", limit_s=0.5).until("MISSION_ENDED")
    assert story.state.session.result.value == "NOT_FLOWN"


@pytest.mark.parametrize("claims", [{"mode": "POSCTL"}, {"pilot_in_control": True}, {"mode": "AUTO.RTL"}])
def test_in_the_hands_of_somebody_else_it_is_theirs(claims):
    story = called_off("abort").after(0.9)
    story.say(armed=True, **claims).until("PILOT", limit_s=0.5)
    assert story.motions == []


@pytest.mark.parametrize("how", ["abort", "land", "failed"])
def test_the_flag_of_a_failsafe_does_not_make_it_somebody_elses_on_the_ground(how):
    story = called_off(how).after(0.9)
    story.vehicle.armed = True
    story.vehicle.says.update(failsafe=True, mode="AUTO.LOITER")
    story.after(0.5)
    assert story.motions[:1] == ["LAND"]
    assert "pilot" not in story.told


def test_armed_long_after_that_is_somebody_elses():
    story = called_off("abort").after(story_limit_s() + 0.5)
    story.say(armed=True).until("PILOT", limit_s=0.5)
    assert story.motions == []


def test_one_status_that_says_armed_is_not_believed():
    story = called_off("abort").after(0.9)
    story.say(armed=True)
    story.vehicle.says.clear()
    story.after(2.0)
    assert story.motions == []


def story_limit_s() -> float:
    """Return how long an ARM of ours may take: as long as a takeoff may take to arm."""
    return at("TAKEOFF arming").rules.limits.arm_limit_ns / S


def test_a_flight_that_was_armed_and_never_lifted_off_was_armed():
    story = at("TAKEOFF arming")
    story.planner.phase = ev.MissionPhase.TAKING_OFF
    assert not story.state.flight.was_armed
    story.say(armed=True).after(0.3).say(armed=True).after(0.3)
    assert (story.state.flight.was_armed, story.state.flight.was_airborne) == (True, False)
