"""A flight that a person has given up, or that is over: whose is it when it is heard in the air again?"""

from __future__ import annotations

import pytest
from engine_beginnings import at
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.state import Result

ENDED = ("DATA_CLEANUP", "MISSION_ENDED")
HEARD = {"at once": {}, "as armed before as in the air": {"landed": ev.VehicleLanded.UNKNOWN}}


def given_up(state: str, place: str = "MISSION flying") -> Story:
    """Tell a flight that nobody hears any more, up to where its data is gathered, or was."""
    story = at(place)
    story.vehicle.obeys, story.planner.flown_ns = False, -(10**13)
    story.silent += ["autopilot", "planner"]
    story.until("LAND").after(8.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.until(state)
    if state == "DATA_CLEANUP":  # the recorder takes its time
        story.agenda = [each for each in story.agenda if each[2] != "_record"]
    return story.look()


def heard_in_the_air(story: Story, mode: str, **says: object) -> Story:
    story.vehicle.speed, story.vehicle.height, story.vehicle.mode = 0.0, 2.0, mode
    story.vehicle.armed, story.vehicle.landed = True, ev.VehicleLanded.IN_AIR
    story.vehicle.says.update(says)
    story.silent.clear()
    return story


@pytest.mark.parametrize("first", HEARD)
@pytest.mark.parametrize("waits_s", [1.0, 30.0])
@pytest.mark.parametrize("place", ["MISSION flying", "TAKEOFF lifting_off"])
@pytest.mark.parametrize("state", ENDED)
def test_it_is_landed_when_it_is_heard_in_the_air(state, place, waits_s, first):
    story = given_up(state, place).after(waits_s)
    heard_in_the_air(story, "AUTO.LOITER" if place.startswith("TAKEOFF") else "AUTO.MISSION", **HEARD[first])
    story.say()
    story.vehicle.says.clear()
    story.after(1.0).expect("LAND")
    assert story.motions[0] == "LAND"


@pytest.mark.parametrize("state", ENDED)
def test_it_is_the_pilots_when_he_flies_it_and_stays_his_in_a_mode_of_ours(state):
    story = heard_in_the_air(given_up(state), "POSCTL", pilot_in_control=True).after(30.0).expect("PILOT")
    story.vehicle.says.clear()
    story.vehicle.mode = "AUTO.LOITER"
    story.after(3.0).expect("PILOT")
    assert story.motions == []


def test_what_a_pilot_flew_before_the_engine_was_started_is_not_landed_after_a_silence():
    story = heard_in_the_air(Story(), "POSCTL", pilot_in_control=True).start().after(2.0).expect("PILOT")
    story.silent.append("autopilot")
    story.after(40.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.until("MISSION_ENDED").silent.clear()
    story.after(10.0)
    story.vehicle.says.clear()
    story.vehicle.mode = "AUTO.LOITER"
    story.after(3.0)
    assert (story.motions, story.told[-1]) == ([], "mission_ended")


@pytest.mark.parametrize("mode", ["AUTO.MISSION", "AUTO.LOITER", "OFFBOARD", "AUTO.TAKEOFF"])
@pytest.mark.parametrize("unheard", ["node", "link"])
def test_somebody_elses_flight_long_after_ours_is_left_alone_where_nobody_heard_its_arming(mode, unheard):
    story = at("MISSION flying").until("MISSION_ENDED", limit_s=120.0)
    assert story.state.session.result is Result.COMPLETE
    story.after(12.0).look()
    if unheard == "node":
        story.silent.append("autopilot")
    else:
        story.vehicle.says["link_age_s"] = 20.0
    story.after(5.0).vehicle.says.clear()
    heard_in_the_air(story, mode).after(5.0)
    assert story.motions == []


def test_what_only_seemed_over_is_ours_where_it_is_heard_armed_before_in_the_air():
    story = heard_in_the_air(at("MISSION touchdown").look(), "AUTO.MISSION", landed=ev.VehicleLanded.UNKNOWN).say()
    story.vehicle.says.clear()
    story.after(1.0).expect("LAND")


@pytest.mark.parametrize("landed", [ev.VehicleLanded.IN_AIR, ev.VehicleLanded.UNKNOWN])
def test_a_landing_of_what_is_disarmed_and_does_not_say_that_it_is_down_can_be_ended(landed):
    """As after a crash, or a kill switch: it goes on to say that it flies, and LAND had no way out."""
    story = at("MISSION flying")
    story.planner.flown_ns = -(10**13)
    story.user("land")
    story.after(1.0).say(armed=False, landed=landed)
    assert story.after(2.0).user("acknowledge") == ("REFUSED", "It is landing.")
    answer = story.after(120.0).user("acknowledge")  # the limit of a landing has passed, the pilot was alarmed
    assert answer == ("DONE", "Acknowledged; it is disarmed, and does not say that it has landed.")
    story.expect("DATA_CLEANUP").look().until("MISSION_ENDED")
    assert story.motions == []


def test_a_landing_of_what_is_armed_and_never_says_where_it_stands_can_be_ended():
    """It cannot be disarmed, for that needs ON_GROUND; it was landed again a moment after each acknowledgement."""
    story = at("MISSION flying")
    story.planner.flown_ns = -(10**13)
    story.vehicle.obeys = False
    story.say(landed=ev.VehicleLanded.UNKNOWN).until("LAND").after(8.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.look().until("MISSION_ENDED").after(5.0)
    assert story.motions == []


@pytest.mark.parametrize("state", ENDED)
@pytest.mark.parametrize("mode", ["AUTO.LAND", ""])
def test_what_a_person_acknowledged_in_the_pilots_hands_is_not_taken_back(state, mode):
    story = at("PILOT")
    story.silent.append("autopilot")
    story.after(40.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.until(state)
    heard_in_the_air(story.look(), mode).after(1.0)
    assert (story.motions, story.state.session.result) == ([], Result.PILOT)


@pytest.mark.parametrize("lands_first", [False, True])
def test_a_restart_makes_a_pilots_flight_of_before_the_start_no_flight_of_ours(lands_first):
    story = heard_in_the_air(Story(), "POSCTL", pilot_in_control=True).start().after(2.0).expect("PILOT")
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.after(2.0).expect("PILOT")
    if lands_first:
        story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND).after(1.0)
    else:
        story.silent.append("autopilot")
        story.after(40.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.until("MISSION_ENDED").feed(ev.EngineStarted, label="again", resumed=True)
    story.vehicle.says.clear()
    heard_in_the_air(story.look(), "AUTO.LOITER").after(3.0)
    assert (story.motions, story.state.session.result) == ([], Result.PILOT)


def test_between_two_files_the_user_may_end_the_mission_whoever_seems_to_have_control():
    story = at("MISSION touchdown")
    story.say(armed=None, pilot_in_control=True).after(1.0).expect("MISSION", "touchdown")
    assert story.user("land")[0] == "DONE"


def test_two_statuses_say_that_it_was_armed_on_the_ground_after_our_flight():
    story = at("MISSION_ENDED")
    assert not story.state.flight.another
    story.say(armed=True, landed=ev.VehicleLanded.ON_GROUND)
    assert not story.state.flight.another
    story.after(0.2).say()
    assert story.state.flight.another
