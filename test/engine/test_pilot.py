"""Never fight the pilot or the autopilot: takeover by flag, by failsafe, by foreign mode; late effects are ours."""

from __future__ import annotations

import pytest
from engine_beginnings import at
from engine_peers import S

from amaze_autonomy.engine import events as ev

IN_FLIGHT = (
    "TAKEOFF lifting_off",
    "TAKEOFF cancelling",
    "TAKEOFF climbing",
    "MISSION flying",
    "HOLD confirming",
    "HOLD holding",
    "HOLD resuming",
    "LAND commanding",
    "LAND descending",
)
TAKEOVERS = {
    "flag": {"pilot_in_control": True},
    "failsafe": {"failsafe": True, "mode": "AUTO.RTL"},
    "foreign mode": {"mode": "POSCTL"},
    "foreign automatic mode": {"mode": "AUTO.RTL"},
    "mode that nobody knows": {"mode": "CMODE(7)"},
}


def test_what_was_told_of_a_suspicion_is_forgotten_in_the_pilots_hands():
    """So that the next one of the same flight is told again."""
    story = at("MISSION flying")
    story.say(pilot_in_control=True).after(0.2)
    assert story.state.flight.takeover_noted
    story.until("PILOT", limit_s=1.0)
    assert not story.state.flight.takeover_noted


@pytest.mark.parametrize("claims", TAKEOVERS.values(), ids=TAKEOVERS)
@pytest.mark.parametrize("place", IN_FLIGHT)
def test_takeover_in_every_phase_stops_commanding(place, claims):
    story = at(place)
    story.say(**claims).until("PILOT", limit_s=0.5)
    assert story.motions == []
    story.after(30.0).expect("PILOT")
    assert story.motions == []
    assert story.requests == [], "it keeps recording"


@pytest.mark.parametrize(
    "place", ["MISSION_INPUT", "PREFLIGHT", "OUTREACH", "READY", "START_RECORDING", "LOAD_MISSION", "MISSION touchdown"]
)
def test_arming_by_anybody_else_is_the_pilot(place):
    story = at(place)
    story.say(armed=True).until("PILOT", limit_s=0.5)
    assert story.motions == []


@pytest.mark.parametrize("name, code", [("gps", 2), ("realsense_camera", 4), ("lrf", 8), ("imu", 16)])
def test_whatever_fails_in_the_pilots_hands_is_told_and_not_acted_on(name, code):
    story = at("PILOT")
    story.fail(name, code).after(30.0).expect("PILOT")
    assert story.motions == []
    assert story.told


@pytest.mark.parametrize("command", ["hold", "resume", "land", "abort", "go", "retry", "give_up"])
def test_no_command_of_the_user_moves_it_either(command):
    story = at("PILOT")
    assert story.user(command)[0] == "REFUSED"
    assert story.requests == []


def test_the_pilot_lands_and_acknowledges():
    story = at("PILOT landed")
    assert story.user("acknowledge")[0] == "DONE"
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "PILOT"


def test_in_the_pilots_hands_no_mode_is_ours_that_of_before_the_takeoff_neither():
    story = at("MISSION flying")
    before = story.state.flight.mode_before
    story.say(mode="POSCTL").after(0.35).expect("PILOT")
    story.say(mode=before).after(0.35).expect("PILOT")
    assert story.state.vehicle.takeover is not None, f"{before} counts as ours"


def test_on_ground_and_disarmed_without_acknowledgement_stays():
    at("PILOT landed").after(600.0).expect("PILOT")


def test_the_pilot_gives_back_without_landing_and_nothing_is_taken():
    story = at("PILOT")
    story.vehicle.says.clear()
    story.vehicle.mode = "AUTO.MISSION"
    story.after(10.0).expect("PILOT")
    assert story.motions == []


def test_the_flag_while_disarmed_on_the_ground_is_no_takeover():
    story = at("TAKEOFF arming")
    story.say(pilot_in_control=True, armed=False).expect("TAKEOFF", "arming")


def test_the_flag_before_takeoff_does_not_disturb_the_ground():
    story = at("READY")
    story.say(pilot_in_control=True).expect("READY")


# --- what is ours -----------------------------------------------------------------------------------------------------


def test_modes_of_a_nominal_mission_are_ours():
    story = at("MISSION_INPUT").select().until("MISSION_ENDED")
    assert "pilot_took_over" not in story.rules_fired
    assert story.state.session.result.value == "COMPLETE"


def test_the_mode_of_before_the_takeoff_is_not_foreign_until_it_changes():
    """The vehicle stood in POSCTL; TAKEOFF was commanded and the mode did not change yet."""
    story = at("READY")
    story.say(mode="POSCTL")
    story.user("go")
    story.until("TAKEOFF", "arming").after(0.5).expect("TAKEOFF")
    assert "pilot_took_over" not in story.rules_fired


def test_a_late_effect_of_the_last_hold_is_not_the_pilot():
    """LAND is commanded while the second HOLD is still on its way; AUTO.LOITER comes late, and then AUTO.LAND.

    After a RESUME: AUTO.LOITER is no answer to it, where it is one to the TAKEOFF before.
    """
    story = at("HOLD holding")
    story.user("resume")
    story.until("MISSION", "flying").after(1.0)
    story.disobeyed += ["HOLD", "LAND"]
    story.fail("lrf", 8).expect("HOLD", "confirming")
    story.fail("imu", 16).expect("LAND")
    story.say(mode="AUTO.LOITER").after(1.0).expect("LAND")
    story.say(mode="AUTO.LAND").expect("LAND", "descending")
    assert "pilot_took_over" not in story.rules_fired


def test_a_late_effect_of_the_resume_is_not_the_pilot():
    story = at("HOLD resuming")
    story.disobeyed.append("LAND")
    story.fail("imu", 16).expect("LAND")
    story.say(mode="AUTO.MISSION").expect("LAND")


def test_the_old_mode_goes_on_until_the_command_takes_effect():
    story = at("MISSION flying")
    story.disobeyed.append("LAND")
    story.user("land")
    story.after(2.0).expect("LAND", "commanding")


def test_back_to_the_old_mode_after_the_command_took_effect_is_the_pilot():
    story = at("LAND descending").after(0.5)
    story.say(mode="AUTO.LOITER").until("PILOT", limit_s=0.5)
    assert (story.place[0], story.motions) == ("PILOT", [])


def test_resume_after_a_hold_is_ours():
    story = at("HOLD holding")
    story.user("resume")
    story.until("MISSION", "flying").after(1.0).expect("MISSION")


def test_an_unknown_mode_is_nobodys():
    story = at("MISSION flying")
    story.say(mode="").expect("MISSION", "flying")


def test_offboard_planners_hold_and_resume_in_one_mode():
    story = at("TAKEOFF climbing")
    story.vehicle.says["mode"] = "OFFBOARD"
    story.until("MISSION", "flying")
    story.user("hold")
    story.until("HOLD", "holding")
    story.user("resume")
    story.until("MISSION", "flying").after(1.0)
    assert "pilot_took_over" not in story.rules_fired


def test_a_foreign_mode_in_the_status_that_also_brings_the_landing_is_the_pilot():
    story = at("MISSION flying")
    story.vehicle.says.update(mode="POSCTL", battery_fraction=0.05)
    story.report()
    story.until("PILOT", limit_s=0.5)
    assert story.motions == []


def test_a_takeover_that_is_not_fresh_is_not_believed_and_the_silence_lands():
    story = at("MISSION flying")
    story.silent.append("autopilot")
    story.feed(
        ev.AutopilotStatus,
        armed=True,
        landed=ev.VehicleLanded.IN_AIR,
        pilot_in_control=True,
        link_age_s=0.0,
        age_ns=2 * S,
    )
    story.expect("MISSION", "flying")
    story.after(1.3).expect("LAND")


def test_takeover_after_touchdown_while_still_armed():
    story = at("LAND descending")
    story.vehicle.auto_disarm = False
    story.after(3.0).look()
    story.say(pilot_in_control=True).until("PILOT", limit_s=0.5)
    story.after(10.0)
    assert story.motions == []


def test_armed_again_in_the_air_after_it_had_said_that_it_was_down_is_our_flight():
    """Nobody arms a vehicle in the air."""
    story = at("HOLD holding")
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND)
    story.say(armed=True, landed=ev.VehicleLanded.IN_AIR).after(1.0).expect("HOLD", "holding")
    assert story.state.flight.active
    assert story.motions == []


@pytest.mark.parametrize("mode", ["AUTO.MISSION", "AUTO.TAKEOFF", "OFFBOARD"])
def test_a_failsafe_that_leaves_the_vehicle_in_our_mode_has_no_control(mode):
    """A status CRITICAL alone (ArduCopter whose battery failsafe is off) hands the vehicle to nobody."""
    story = at("MISSION flying")
    story.say(failsafe=True, mode=mode).after(1.0).expect("MISSION", "flying")
    assert story.told == []
    story.fail("imu", 16).expect("LAND")


def test_a_failsafe_that_holds_by_itself_has_control():
    """AUTO.LOITER may follow a takeoff of ours; with the failsafe's flag it is the autopilot's own."""
    story = at("MISSION flying").say(failsafe=True, mode="AUTO.LOITER").until("PILOT", limit_s=0.5)
    assert (story.place[0], story.motions) == ("PILOT", [])


def test_a_failsafes_flag_in_our_hold_hands_the_vehicle_to_nobody():
    """ArduCopter says CRITICAL of a battery while it holds for us: what fails then is answered."""
    story = at("HOLD holding").say(failsafe=True, mode="AUTO.LOITER").after(1.0).expect("HOLD", "holding")
    story.fail("imu", 16).expect("LAND")


def test_a_pilots_hold_in_the_climb_is_not_taken_for_ours_and_nothing_is_resumed_over_it():
    """Once it climbs in its mission, AUTO.LOITER answers no takeoff of ours any more."""
    story = at("MISSION_INPUT").select().until("TAKEOFF", "climbing")
    story.vehicle.says["mode"] = "AUTO.MISSION"
    story.after(0.5).expect("TAKEOFF", "climbing")
    story.vehicle.says["mode"], story.vehicle.speed = "AUTO.LOITER", 0.0
    story.planner.phase = ev.MissionPhase.HOLDING  # as our planner says of what it sees
    story.look().until("PILOT", limit_s=0.6)
    story.fail("barometer", 4).after(2.0).back("barometer").after(2.0).expect("PILOT")
    assert story.motions == []


def test_an_autopilot_that_loiters_between_its_takeoff_and_its_mission_is_ours():
    story = at("MISSION_INPUT").select().until("TAKEOFF", "climbing")
    for mode in ("AUTO.TAKEOFF", "AUTO.LOITER", "AUTO.MISSION"):
        story.vehicle.says["mode"] = mode
        story.after(0.4)
        assert story.place[0] in ("TAKEOFF", "MISSION")


def test_a_landing_that_only_seemed_over_goes_on():
    """Landing is sticky: one status said down, the landing detection did not, the next says airborne again."""
    story = at("LAND commanding")
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND)
    story.expect("LAND")
    story.say(armed=True, landed=ev.VehicleLanded.IN_AIR)
    story.silent.append("landing")
    story.after(5.0).expect("LAND", "commanding")
    assert story.state.flight.active
    assert story.motions[:1] == ["LAND"]


@pytest.mark.parametrize("place", ["DATA_CLEANUP", "OUTREACH data"])
def test_arming_after_the_flight_keeps_its_result_and_the_data_is_followed_to_its_end(place):
    story = at(place)
    story.recorder.fails = False
    story.say(armed=True, landed=ev.VehicleLanded.ON_GROUND).until("PILOT", limit_s=0.5)
    story.fail("imu", 16).after(2.0).expect("PILOT")
    story.vehicle.says.clear()
    story.after(0.3)
    assert story.user("acknowledge")[0] == "DONE"
    story.until("MISSION_ENDED")
    assert story.motions == []
    assert story.state.session.result.value == "LANDED_EARLY"


def test_a_takeoff_that_comes_after_it_was_cancelled_is_landed():
    """LAND was accepted before it was armed, the data is collected, and then it takes off all the same: by our ARM."""
    story = at("TAKEOFF arming")
    story.user("land")
    story.after(0.3).expect("DATA_CLEANUP").look()
    story.say(armed=True, landed=ev.VehicleLanded.TAKING_OFF).until("LAND", limit_s=0.5)
    assert story.motions[:1] == ["LAND"]


@pytest.mark.parametrize("heard", ["the node is dead", "the link is dead", "the node is new"])
def test_a_vehicle_that_fell_silent_in_the_pilots_hands_may_be_given_up(heard):
    """As after a crash: its last word was that it flies, and there will be no other one."""
    story = at("PILOT")
    story.say(armed=True, landed=ev.VehicleLanded.IN_AIR).look()
    if heard == "the node is dead":
        story.silent.append("autopilot")
        story.after(29.0)
    elif heard == "the node is new":
        story.say(armed=None, landed=ev.VehicleLanded.UNKNOWN, mode="", link_age_s=None)
        story.after(29.0)
    else:
        story.say(link_age_s=29.0)
        story.silent.append("autopilot")
    assert story.user("acknowledge")[0] == "REFUSED"
    story.after(1.5)
    words = "Acknowledged; whether it has landed and is disarmed is not known."
    assert story.user("acknowledge") == ("DONE", words)
    story.expect("DATA_CLEANUP")
    assert ("landing_given_up" in story.told, story.motions) == (True, [])
    assert "data_cleanup" not in story.told


def test_a_mode_that_two_statuses_show_confirms_the_last_of_several_commands():
    story = at("HOLD confirming")
    assert len(story.state.flight.commanded) > 1
    story.say(mode="AUTO.LOITER").say()
    hold = story.state.flight.confirmed
    assert (hold.name, story.state.flight.commanded) == ("HOLD", (hold,))


def test_a_failsafes_flag_in_the_mode_that_was_asked_for_last_is_no_takeover():
    story = at("HOLD resuming").say(mode="AUTO.MISSION", failsafe=True)
    assert story.state.vehicle.takeover is None
