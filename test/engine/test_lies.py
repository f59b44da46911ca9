"""No single wrong status ends the care for a flying vehicle: what ends or takes over a flight needs several that agree.

Each story tells a lie once, then the truth again, and asks that whatever fails afterwards is still answered.
"""

from __future__ import annotations

import pytest
from engine_beginnings import at
from engine_peers import S
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import RunCheck
from amaze_autonomy.engine.events import Check, Verdict
from amaze_autonomy.engine.rules import Code

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
AIRBORNE = tuple(place for place in IN_FLIGHT if place not in ("TAKEOFF lifting_off", "TAKEOFF cancelling"))
LIES = {
    "disarmed on the ground": {"armed": False, "landed": ev.VehicleLanded.ON_GROUND, "height_m": 0.0},
    "disarmed": {"armed": False},
    "on the ground": {"landed": ev.VehicleLanded.ON_GROUND},
    "everything unknown": {"armed": None, "landed": ev.VehicleLanded.UNKNOWN, "mode": "", "height_m": None},
    "the pilot": {"pilot_in_control": True},
    "a failsafe": {"failsafe": True, "mode": "AUTO.RTL"},
    "a foreign mode": {"mode": "POSCTL"},
    "the pilot's landing": {"mode": "AUTO.LAND"},
    "in the air": {"landed": ev.VehicleLanded.IN_AIR, "armed": True},
}


def lie(story: Story, **claims) -> Story:
    """Let one status of the autopilot be wrong, and the next one, a beat later, be true again."""
    story.say(**claims)
    for name in claims:
        del story.vehicle.says[name]
    return story


def test_nothing_is_resumed_while_a_status_says_it_stands_on_the_ground():
    """Whether it is true shows the next one; until then nothing is sent to what may stand there."""
    story = at("HOLD holding").say(landed=ev.VehicleLanded.ON_GROUND, height_m=0.0).look()
    story.user("resume")
    assert story.motions == []


def test_a_hold_is_not_repeated_while_a_status_says_it_stands_on_the_ground():
    story = at("HOLD confirming")
    repeated_ns = story.state.step_ns + story.rules.limits.hold_repeat_after_ns
    story.after_ns(repeated_ns - story.now - 1).say(landed=ev.VehicleLanded.ON_GROUND, height_m=0.0).look()
    story.after_ns(1)
    assert story.motions == []


@pytest.mark.parametrize("claims", LIES.values(), ids=LIES)
@pytest.mark.parametrize("place", IN_FLIGHT)
def test_code_16_lands_after_any_one_wrong_status(place, claims):
    story = lie(at(place), **claims).after(0.25)
    assert story.state.flight.active
    landed_for = story.is_in("LAND")
    story.look().fail("imu", 16)
    assert story.is_in("LAND")
    if not landed_for:
        assert story.motions[0] == "LAND"


@pytest.mark.parametrize("claims", LIES.values(), ids=LIES)
@pytest.mark.parametrize("place", AIRBORNE)
def test_what_failed_during_a_lie_is_answered_when_the_truth_is_back(place, claims):
    story = at(place)
    lie(story, **claims)
    story.fail("imu", 16).after(0.25)
    assert story.is_in("LAND")


@pytest.mark.parametrize("place", ["PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION", "DATA_CLEANUP"])
def test_one_status_that_says_armed_is_no_pilot(place):
    story = lie(at(place), armed=True)
    assert not story.is_in("PILOT")
    story.after(0.25)
    assert not story.is_in("PILOT")
    assert story.motions == []


def test_a_flight_ends_after_statuses_that_agree_for_half_a_second():
    story = at("LAND descending").until("LAND", limit_s=1.0)
    while story.vehicle.height > 0:
        story.after(0.01)
    down_ns = story.now
    story.until("DATA_CLEANUP")
    assert 0.5 <= (story.now - down_ns) / S <= 0.85


def test_two_wrong_statuses_in_half_a_second_end_no_flight():
    story = at("MISSION flying")
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND)
    story.after(0.3)
    story.vehicle.says.clear()
    story.after(0.3)
    assert story.state.flight.active
    story.expect("MISSION", "flying")


@pytest.mark.parametrize("seen", ["landing detection", "height"])
def test_what_contradicts_the_end_of_a_flight_outweighs_it_for_the_confirm_limit(seen):
    story = at("MISSION flying")
    claims = {"armed": False, "landed": ev.VehicleLanded.ON_GROUND}
    if seen == "height":
        story.landing_says = ev.Landed.UNKNOWN
        claims["height_m"] = 2.0
    else:
        story.landing_says = ev.Landed.AIRBORNE
        claims["height_m"] = 0.0
    story.planner.says["phase"] = ev.MissionPhase.FLYING
    story.say(**claims).after(9.0)
    assert story.state.flight.active
    story.after(2.0)
    assert not story.state.flight.active, "the autopilot alone is believed in the end"


def test_a_takeover_stops_commanding_at_once_and_is_believed_when_it_lasts():
    story = at("MISSION flying")
    story.say(mode="POSCTL")
    story.expect("MISSION", "flying")
    assert story.told == [], "one status may be a moment ahead of the planner's word"
    story.fail("imu", 16)
    assert story.motions == [], "nothing is commanded while it is not clear"
    story.after(0.2).expect("MISSION", "flying")
    assert story.told == ["takeover_suspected"]
    story.after(0.35).expect("PILOT")
    assert story.motions == []


def hovering(mode):
    """Return a story in which the mission was flown in a mode for a second, and the planner flies for long."""
    story = at("MISSION flying")
    story.planner.flown_ns = -(10**12)
    story.vehicle.mode = mode
    return story.after(1.0).look()


@pytest.mark.parametrize(
    "flown, then",
    [
        ("AUTO.MISSION", "AUTO.LOITER"),  # Pause of a ground station, a switch of the transmitter
        ("AUTO.MISSION", "OFFBOARD"),  # "fly here" of a ground station, as ArduPilot's GUIDED
        ("AUTO.MISSION", "AUTO.TAKEOFF"),
        ("OFFBOARD", "AUTO.LOITER"),
    ],
)
def test_a_mode_that_lies_behind_the_mission_is_somebody_elses(flown, then):
    story = hovering(flown)
    story.vehicle.mode = then
    story.after(1.0).expect("PILOT").fail("imu", 16)
    assert story.motions == []


@pytest.mark.parametrize("planner", [ev.MissionPhase.HOLDING, ev.MissionPhase.FLYING])
def test_the_pilots_hold_is_not_resumed_by_what_fails_and_comes_back(planner):
    story = hovering("AUTO.MISSION")
    story.vehicle.mode, story.planner.phase = "AUTO.LOITER", planner
    story.after(2.0).fail("lrf", 8).after(1.0).back("lrf").after(2.0).expect("PILOT")
    assert story.motions == []


def test_one_status_in_a_mode_that_lies_behind_the_mission_takes_nothing_over():
    story = lie(hovering("AUTO.MISSION"), mode="AUTO.LOITER").after(2.0).expect("MISSION")
    story.fail("imu", 16)
    assert story.motions == ["LAND"]


@pytest.mark.parametrize(
    "modes",
    [("AUTO.TAKEOFF", "AUTO.LOITER", "OFFBOARD"), ("OFFBOARD", "AUTO.MISSION"), ("AUTO.LOITER", "AUTO.MISSION")],
)
def test_a_takeoff_goes_through_its_modes_as_ours(modes):
    story = at("TAKEOFF climbing")
    story.planner.flown_ns, story.vehicle.says["mode"] = -(10**12), modes[0]
    story.until("MISSION", "flying")
    for mode in modes:
        story.vehicle.says["mode"] = mode
        story.after(1.5).expect("MISSION", "flying")


def test_set_points_of_a_takeoff_are_somebody_elses_once_the_mission_is_flown():
    story = at("TAKEOFF climbing")
    story.planner.flown_ns, story.vehicle.says["mode"] = -(10**12), "OFFBOARD"  # ArduPilot takes off in its GUIDED
    story.until("MISSION", "flying")
    for mode in ("OFFBOARD", "AUTO.MISSION"):
        story.vehicle.says["mode"] = mode
        story.after(1.5).expect("MISSION", "flying")
    story.vehicle.says["mode"] = "OFFBOARD"
    story.after(1.0).expect("PILOT")


def test_after_our_own_hold_the_mission_goes_through_its_modes_again():
    story = hovering("AUTO.MISSION")
    story.fail("lrf", 8).until("HOLD", "holding").back("lrf").until("HOLD", "resuming")
    story.vehicle.mode = "AUTO.LOITER"  # the hold of before, for a while
    story.after(0.4).expect("MISSION", "flying")
    story.vehicle.mode = "AUTO.MISSION"
    story.after(2.0).expect("MISSION", "flying")
    story.vehicle.mode = "AUTO.LOITER"
    story.after(1.0).expect("PILOT")


def test_one_status_that_says_disarmed_takes_no_vehicle_back_from_its_pilot():
    story = at("MISSION flying")
    story.vehicle.obeys = False
    story.say(pilot_in_control=True, mode="POSCTL").after(0.2).fail("imu", 16).look()
    story.say(armed=False)
    assert story.motions == []
    story.vehicle.says["armed"] = True
    story.after(0.5).expect("PILOT")
    assert story.motions == []


def test_a_landing_that_was_due_in_that_moment_goes_out_when_the_vehicle_is_ours():
    story = at("MISSION flying")
    lie(story, mode="POSCTL")
    story.fail("imu", 16)
    assert story.motions == []
    story.after(0.25).expect("LAND")
    assert story.motions[0] == "LAND"


@pytest.mark.parametrize("command", ["land", "abort"])
@pytest.mark.parametrize("place", ["TAKEOFF climbing", "MISSION flying", "HOLD holding"])
def test_a_landing_that_the_user_asks_for_in_that_moment_is_not_forgotten(place, command):
    story = at(place)
    lie(story, mode="POSCTL").look()
    assert story.user(command) == ("DONE", "Landing as soon as it is clear who has control of the vehicle.")
    assert story.motions == []
    story.after(0.25).expect("LAND")
    assert story.motions[0] == "LAND"


def test_nothing_is_landed_for_a_user_where_it_was_the_pilot():
    story = at("MISSION flying").say(mode="POSCTL").look()
    assert story.user("land")[0] == "DONE"
    story.after(0.35).expect("PILOT")
    story.vehicle.says.clear()
    story.after(2.0).expect("PILOT")
    assert story.motions == []


def test_what_else_a_user_asks_for_in_that_moment_is_asked_again():
    story = at("MISSION flying")
    lie(story, mode="POSCTL").look()
    assert story.user("hold")[0] == "REFUSED"
    story.after(0.25).expect("MISSION")
    assert story.user("hold")[0] == "DONE"


def test_a_landing_that_was_asked_for_outweighs_what_is_asked_for_later():
    """The doubt ends by time alone, with the very request."""
    story = at("MISSION flying").say(mode="POSCTL").look()
    story.silent.append("autopilot")
    story.user("land")
    story.ticking = False
    story.after(0.1)
    silent_ns = story.state.peers.autopilot_ns + story.rules.limits.autopilot_status_limit_ns + 1
    story.feed(ev.Tick, t_ns=silent_ns)
    story.expect("LAND")


def test_the_end_of_the_process_in_that_moment_still_lands():
    story = at("MISSION flying")
    lie(story, mode="POSCTL")
    story.feed(ev.Shutdown, signal="SIGTERM")
    assert story.motions == []
    story.after(0.25).expect("LAND")
    assert story.motions[:2] == ["LAND", "AutopilotLand"]


def test_armed_and_airborne_again_after_a_believed_end_is_still_our_flight():
    story = at("MISSION flying")
    story.landing_says = ev.Landed.UNKNOWN
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND, height_m=None).after(0.9)
    assert not story.state.flight.active
    story.vehicle.says.clear()
    story.after(0.5)
    assert story.state.flight.active
    story.fail("imu", 16).expect("LAND")


def _seems_down(story: Story) -> Story:
    """Let the autopilot say for a second that it is down, where nothing else knows better."""
    story.landing_says = ev.Landed.UNKNOWN
    return story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND, height_m=None)


def _is_back(story: Story) -> Story:
    """Let the truth be back: it is in the air, armed, in a mode of ours."""
    story.look().vehicle.says.clear()
    story.vehicle.says.update(armed=True, landed=ev.VehicleLanded.IN_AIR, height_m=2.0, mode="AUTO.MISSION")
    story.landing_says = ev.Landed.AIRBORNE
    return story.after(0.5)


def test_a_vehicle_that_is_in_the_air_between_two_files_is_landed():
    story = at("MISSION touchdown")
    story.state.flight.was_airborne or pytest.fail("it has flown the first file")
    _is_back(story).expect("LAND")
    assert story.motions[:2] == ["LAND", "AutopilotLand"]


def test_a_flight_that_was_never_ours_and_seemed_over_is_landed_again():
    """An engine that was started in the air has nothing to collect: its mission ends at once."""
    story = Story()
    story.vehicle.says.update(armed=True, landed=ev.VehicleLanded.IN_AIR, height_m=2.0, mode="AUTO.MISSION")
    story.start()
    story.disobeyed += ["LAND", "AutopilotLand"]
    story.after(2.0).expect("LAND")
    _seems_down(story).until("MISSION_ENDED")
    _is_back(story).expect("LAND")
    assert story.motions[:2] == ["LAND", "AutopilotLand"]


@pytest.mark.parametrize("statuses", [0, 1])
@pytest.mark.parametrize("pilot", [False, True])
def test_a_mission_selected_before_anybody_knows_that_it_flies_takes_no_care_from_it(statuses, pilot):
    """An engine that was started in the air, and an operator, or a parameter, that is quicker than two statuses."""
    story = Story()
    story.vehicle.says.update(armed=True, landed=ev.VehicleLanded.IN_AIR, height_m=2.0, pilot_in_control=pilot)
    story.start()
    for _ in range(statuses):
        story.say()
    story.select().after(1.0)
    story.expect("PILOT" if pilot else "LAND")
    assert story.motions[:2] == ([] if pilot else ["LAND", "AutopilotLand"])


def test_who_arms_it_after_a_start_in_the_air_and_its_landing_is_somebody_else():
    story = Story()
    story.vehicle.says.update(armed=True, landed=ev.VehicleLanded.IN_AIR, height_m=2.0)
    story.start().until("LAND").after(1.0)
    story.vehicle.says.clear()
    story.until("MISSION_ENDED")
    story.select().until("PREFLIGHT").look()
    story.say(armed=True).after(0.5).expect("PILOT")
    assert story.motions == []


def test_who_arms_it_on_the_ground_after_the_mission_may_fly_it():
    story = at("MISSION_ENDED")
    story.say(armed=True).after(1.0)
    story.say(landed=ev.VehicleLanded.IN_AIR, height_m=2.0, mode="AUTO.MISSION").after(5.0).expect("MISSION_ENDED")
    assert story.motions == []


def test_a_vehicle_that_is_in_the_air_while_its_data_is_collected_is_landed():
    story = at("MISSION flying")
    story.user("land")
    story.landing_says = ev.Landed.UNKNOWN
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND, height_m=None).until("DATA_CLEANUP")
    story.look()
    story.vehicle.says.clear()
    story.after(0.5).expect("LAND")
    assert story.motions[:2] == ["LAND", "AutopilotLand"]


# --- a hold never interrupts a landing --------------------------------------------------------------------------------


def _planner_lands() -> Story:
    story = at("MISSION flying")
    while story.planner.phase is not ev.MissionPhase.LANDING:
        story.after(0.1)
    return story.after(0.3).look()


@pytest.mark.parametrize("name, code", [("lrf", 8), ("realsense_camera", 4)])
def test_what_fails_during_the_planners_own_landing_holds_nothing(name, code):
    story = _planner_lands()
    story.fail(name, code)
    assert "HOLD" not in story.motions
    assert story.told == ["failure_while_landing"]
    story.until("DATA_CLEANUP")
    assert "HOLD" not in story.motions


def test_nor_does_the_operator():
    story = _planner_lands()
    assert story.user("hold") == ("REFUSED", "It is landing: a hold never interrupts that.")
    assert story.motions == []


@pytest.mark.parametrize(
    "claims",
    [{"landed": ev.VehicleLanded.LANDING}, {"vertical_speed_m_s": -0.5, "height_m": 1.3}],
    ids=["landed state", "sinks near the ground"],
)
def test_sinking_near_the_ground_is_a_landing_whatever_the_planner_says(claims):
    story = at("MISSION flying")
    story.say(**claims).after(1.3).look()
    story.fail("lrf", 8)
    assert story.motions == []


@pytest.mark.parametrize("height_m", [12.0, 2.5], ids=["a leg", "the overshoot of a takeoff"])
def test_sinking_high_up_is_none(height_m):
    story = at("MISSION flying")
    story.say(vertical_speed_m_s=-0.5, height_m=height_m).after(1.3).look()
    story.fail("lrf", 8)
    assert story.motions == ["HOLD"]


def test_what_is_flown_on_without_does_not_say_so_while_it_lands():
    """As seen live: the autopilot was lost and is back, it lands all the same, and the GPS fails."""
    story = at("LAND commanding").fail("gps", 2)
    assert story.told == ["failure_while_landing"]


def test_a_landing_that_nobody_of_us_commanded_is_somebody_elses():
    story = at("MISSION flying")
    story.say(mode="AUTO.LAND").after(0.35).expect("PILOT")
    story.fail("lrf", 8)
    assert story.motions == []


def test_a_landing_that_the_planner_says_before_it_is_believed_to_be_another_s_is_ours():
    """The mode comes first, in two statuses; the planner's word between them and the next one ends the suspicion."""
    story = at("MISSION flying")
    story.silent += ["autopilot", "planner"]
    story.say(mode="AUTO.LAND").after(0.15).say(mode="AUTO.LAND")
    assert story.state.vehicle.takeover is not None
    said = story.state.peers.planner
    landing = {"phase": ev.MissionPhase.LANDING, "waypoint": said.waypoint, "waypoints": said.waypoints}
    story.feed(ev.MissionStatus, session_id=said.session_id, mission_id=said.mission_id, **landing)
    assert story.state.vehicle.takeover is None
    story.after(0.3).expect("MISSION")


def test_a_planner_that_lands_and_ends_is_landed_for():
    """Its last word is that it lands: the mode is no pilot's, and its silence afterwards is a loss like any."""
    story = at("MISSION flying")
    said = story.state.peers.planner
    story.silent.append("planner")
    landing = {"phase": ev.MissionPhase.LANDING, "waypoint": said.waypoint, "waypoints": said.waypoints}
    story.feed(ev.MissionStatus, session_id=said.session_id, mission_id=said.mission_id, **landing)
    story.say(mode="AUTO.LAND").until("LAND", limit_s=3.0)
    assert {"planner_status"} == {failure.name for failure in story.state.failures}
    assert "pilot_took_over" not in story.rules_fired
    assert "takeover_suspected" not in story.rules_fired


def test_a_mission_flown_to_its_end_is_complete_whatever_fails_in_the_last_metres():
    story = _planner_lands()
    story.fail("imu", 16).expect("LAND")
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "COMPLETE"
    assert "imu" in story.state.shown.text


def test_a_mission_that_lands_before_its_last_waypoint_is_landed_early():
    story = at("MISSION flying")
    story.fail("imu", 16).until("MISSION_ENDED")
    assert story.state.session.result.value == "LANDED_EARLY"


# --- a hold is shown by the vehicle -----------------------------------------------------------------------------------


def test_the_planners_word_alone_shows_no_hold():
    story = at("MISSION flying")
    story.say(mode="AUTO.MISSION", horizontal_speed_m_s=2.0)
    story.user("hold")
    story.after(1.4).expect("HOLD", "confirming")
    assert story.planner.phase is ev.MissionPhase.HOLDING
    story.after(0.2)
    assert story.motions == ["HOLD", "HOLD"], "asked again, once"
    story.after(1.5).expect("LAND")
    assert story.motions[:3] == ["HOLD", "HOLD", "LAND"]


@pytest.mark.parametrize(
    "claims",
    [
        {"mode": "AUTO.LOITER"},
        {"mode": "OFFBOARD", "horizontal_speed_m_s": 0.2},
        {"mode": "OFFBOARD", "horizontal_speed_m_s": 0.5, "vertical_speed_m_s": -0.5},
    ],
)
def test_flight_mode_or_standing_still_shows_it(claims):
    story = at("MISSION flying")
    story.user("hold")
    story.vehicle.says.update(claims)
    story.after(0.5).expect("HOLD", "holding")
    assert story.motions == ["HOLD"]


@pytest.mark.parametrize("told_before_s, later_s, where", [(0.3, 0.1, "holding"), (0.6, 0.3, "confirming")])
def test_that_it_stood_still_a_while_ago_shows_no_hold(told_before_s, later_s, where):
    story = at("MISSION flying")
    story.say(mode="OFFBOARD", horizontal_speed_m_s=0.1)
    story.silent.append("autopilot")
    story.after(told_before_s)
    story.user("hold")
    story.after(later_s).expect("HOLD", where)
    assert story.state.peers.planner.phase is ev.MissionPhase.HOLDING, "it was heard that it holds"


@pytest.mark.parametrize("speed", [{"horizontal_speed_m_s": 2.0}, {"vertical_speed_m_s": 1.5}])
def test_a_vehicle_that_flies_on_or_climbs_away_while_it_should_hold_is_told_again_and_landed(speed):
    story = at("HOLD holding")
    story.vehicle.says.update(mode="OFFBOARD", **speed)
    story.after(1.3).expect("HOLD", "confirming")
    assert story.motions == ["HOLD"]
    story.after(3.2).expect("LAND")


@pytest.mark.parametrize("climb_m_s", [2.0, 0.6, -0.6])
@pytest.mark.parametrize("mode", ["AUTO.MISSION", "AUTO.TAKEOFF", "OFFBOARD"])
def test_what_climbs_or_sinks_does_not_hold(mode, climb_m_s):
    story = at("MISSION flying")
    story.say(mode=mode, horizontal_speed_m_s=0.0, vertical_speed_m_s=climb_m_s, height_m=9.0)
    story.user("hold")
    story.after(1.6)
    assert story.motions == ["HOLD", "HOLD"], "asked again, once"
    story.after(1.5).expect("LAND")


@pytest.mark.parametrize("speeds", [{"vertical_speed_m_s": None}, {"horizontal_speed_m_s": None}])
def test_one_speed_alone_shows_no_standing_still(speeds):
    story = at("MISSION flying")
    story.say(mode="OFFBOARD", **{"horizontal_speed_m_s": 0.0, "vertical_speed_m_s": 0.0, **speeds})
    story.user("hold")
    story.after(3.2).expect("LAND")


def test_a_gust_does_not_end_a_hold():
    story = at("HOLD holding")
    story.vehicle.says.update(mode="OFFBOARD", horizontal_speed_m_s=0.9)
    story.after(0.7)
    story.vehicle.says.update(horizontal_speed_m_s=0.1)
    story.after(2.0).expect("HOLD", "holding")
    assert story.motions == []


# --- heartbeat, clocks ------------------------------------------------------------------------------------------------


def test_two_publishers_whose_counters_stand_are_no_heartbeat():
    story = at("MISSION flying")
    story.silent.append("watchdog")
    for beat in range(8):
        name, counter = (("/watchdog", 7), ("/watchdog_of_others", 900))[beat % 2]
        story.feed(ev.WatchdogAction, sequence=beat, loop_counter=counter, code=Code.NOMINAL, publisher=name)
        story.after(0.1)
    story.expect("LAND")


def test_each_publishers_counter_beats_by_itself():
    story = at("MISSION flying")
    story.silent.append("watchdog")
    for beat in range(20):
        story.feed(ev.WatchdogAction, sequence=1, loop_counter=900, code=Code.NOMINAL, publisher="/stuck")
        story.feed(ev.WatchdogAction, sequence=1, loop_counter=5 + beat, code=Code.NOMINAL, publisher="/alive")
        story.after(0.1)
    story.expect("MISSION", "flying")


def test_two_standing_counters_behind_one_name_are_no_heartbeat():
    """As a relay of two watchdogs shows them: what falls has to grow twice in a row."""
    story = at("MISSION flying")
    story.silent.append("watchdog")
    for beat in range(8):
        story.feed(ev.WatchdogAction, sequence=beat, loop_counter=900 + beat % 2, code=Code.NOMINAL)
        story.after(0.1)
    story.expect("LAND")


def test_a_watchdog_that_was_restarted_beats_on_from_its_second_message():
    story = at("MISSION flying")
    story.watchdog.loop = 0
    story.after(3.0).expect("MISSION", "flying")


@pytest.mark.parametrize("place", AIRBORNE)
def test_a_clock_that_stands_lands_on_both_routes(place):
    story = at(place)
    story.feed(ev.ClockStatus, stalled_s=1.2)
    story.expect("LAND")
    if not place.startswith("LAND"):
        assert story.motions[:2] == ["LAND", "AutopilotLand"]


def test_a_clock_that_stands_is_said_before_takeoff_and_forbids_it():
    story = at("START_RECORDING")
    story.feed(ev.ClockStatus, stalled_s=5.0)
    assert story.told == ["clock_stands"]
    story.after(30.0)
    assert story.motions == []
    story.expect("OUTREACH")


def test_a_clock_that_runs_again_in_time_is_no_reason():
    story = at("START_RECORDING")
    story.feed(ev.ClockStatus, stalled_s=5.0)
    story.feed(ev.ClockStatus, stalled_s=0.0)
    assert story.told == ["clock_stands", "clock_runs"]
    story.until("TAKEOFF")


def test_stamps_of_another_clock_are_named_as_clocks():
    story = at("MISSION flying")
    story.silent.append("watchdog")
    for beat in range(5):
        story.feed(ev.WatchdogAction, sequence=1, loop_counter=999 + beat, code=Code.NOMINAL, age_ns=3 * S // 2)
        story.after(0.2)
    story.expect("LAND")
    assert story.state.failures[-1].reason.startswith(
        "stamps of the watchdog are 1.500 s old (limit 1 s): old statuses, or clocks that differ"
    )


def test_clocks_apart_forbid_a_takeoff_and_say_so():
    story = at("PREFLIGHT")
    story.answers.clear()
    story.silent.append("autopilot")
    for _ in range(400):
        story.feed(ev.AutopilotStatus, armed=False, landed=ev.VehicleLanded.ON_GROUND, age_ns=-S)
        story.after(0.2)
        if story.is_in("OUTREACH"):
            break
    story.expect("OUTREACH")
    assert "stamps of the autopilot are 1.000 s in the future" in story.state.shown.text


def test_clocks_apart_are_looked_at_again_in_the_rhythm_of_a_fix_and_not_as_fast_as_checks_answer():
    story = at("MISSION_INPUT")
    story.silent.append("autopilot")
    for number in range(100):
        story.feed(ev.AutopilotStatus, armed=False, landed=ev.VehicleLanded.ON_GROUND, age_ns=-S)
        story.after(0.2)
        if number == 10:
            story.select()
    story.expect("PREFLIGHT")
    rounds = sum(isinstance(command, RunCheck) for _, command in story.sent) / len(ev.CheckName)
    assert 2 <= rounds <= 20.0 / (story.rules.limits.preflight_fix_poll_ns / S) + 3
    assert "Not ready yet" in story.state.shown.text


@pytest.mark.parametrize("peer", ["planner", "recorder"])
def test_a_clock_that_was_set_right_after_the_mission_forbids_no_other_one(peer):
    """A peer speaks for the session that it knows; for the next one only after the takeoff that would be forbidden."""
    story = at("MISSION_ENDED")
    getattr(story, peer).says["age_ns"] = 2 * S
    story.after(3.0).select().after(70.0)
    story.expect("OUTREACH")
    assert f"stamps of the {peer} are 2.000 s old" in story.state.shown.text
    del getattr(story, peer).says["age_ns"]
    story.after(2.0)
    assert story.user("retry")[0] == "DONE"
    story.until("TAKEOFF", limit_s=120.0)


# --- nobody answers any more ------------------------------------------------------------------------------------------


def test_after_the_alarm_a_person_may_end_a_mission_whose_vehicle_is_silent():
    story = at("LAND commanding")
    story.silent += ["autopilot", "planner"]
    assert story.user("acknowledge") == ("REFUSED", "It is landing.")
    story.after(10.0).expect("LAND")
    assert story.state.landing.alarmed
    assert story.user("acknowledge")[0] == "DONE"
    story.expect("DATA_CLEANUP")
    assert "StopRecording" in story.requests
    story.until("MISSION_ENDED")


@pytest.mark.parametrize("state", ["DATA_CLEANUP", "MISSION_ENDED"])
def test_a_landing_that_was_given_up_is_taken_up_when_the_vehicle_is_heard_in_the_air(state):
    story = at("MISSION flying")
    story.vehicle.obeys, story.planner.flown_ns = False, -(10**12)
    story.silent += ["autopilot", "planner"]
    story.after(10.0).user("acknowledge")
    story.until(state)
    story.vehicle.speed, story.vehicle.height, story.vehicle.mode = 0.0, 2.0, "AUTO.MISSION"
    story.vehicle.armed, story.vehicle.landed = True, ev.VehicleLanded.IN_AIR
    story.silent.clear()
    story.look().after(1.0).expect("LAND")
    assert story.motions[0] == "LAND"


def test_a_vehicle_that_is_heard_cannot_be_given_up():
    story = at("LAND commanding").after(10.0)
    assert story.state.landing.alarmed
    assert story.user("acknowledge") == ("REFUSED", "It is landing.")


# --- before takeoff ---------------------------------------------------------------------------------------------------


def test_rows_that_come_by_themselves_are_waited_for():
    story = at("MISSION_INPUT")
    row = Check(name="home position", verdict=Verdict.FAIL, advice="wait", heals=True)
    story.check_says["autopilot"] = {"ok": False, "checks": (row,)}
    story.select().after(30.0).expect("PREFLIGHT")
    del story.check_says["autopilot"]
    story.until("START_RECORDING", limit_s=3.0)


def test_but_not_for_ever():
    story = at("MISSION_INPUT")
    row = Check(name="home position", verdict=Verdict.FAIL, advice="wait", heals=True)
    story.check_says["autopilot"] = {"ok": False, "checks": (row,)}
    story.select().until("OUTREACH", limit_s=80.0)
    assert story.now / S > 60.0


@pytest.mark.parametrize(
    "verdict,age_s,state",
    [(Verdict.UNKNOWN, None, "PREFLIGHT"), (Verdict.UNKNOWN, 0.1, "OUTREACH"), (Verdict.FAIL, None, "OUTREACH")],
)
def test_what_nobody_has_heard_yet_is_waited_for_while_the_stack_starts(verdict, age_s, state):
    """A check node that came up long before the drivers did no longer takes it for a start."""
    story = at("MISSION_INPUT")
    row = Check(name="range age", verdict=verdict, age_s=age_s, advice="no range yet")
    story.check_says["on_ground"] = {"ok": False, "checks": (row,)}
    story.select().after(8.0).expect(state)


def test_what_nobody_has_heard_after_the_start_is_not():
    story = at("MISSION_INPUT")
    row = Check(name="range age", verdict=Verdict.UNKNOWN, advice="no range yet")
    story.check_says["on_ground"] = {"ok": False, "checks": (row,)}
    story.after(11.0).select().after(1.0).expect("OUTREACH")


def test_a_peer_that_is_not_there_yet_is_waited_for_while_the_stack_starts():
    story = at("MISSION_INPUT")
    story.answers["check:on_ground"] = ev.Outcome.UNAVAILABLE
    story.select().after(5.0).expect("PREFLIGHT")
    story.after(8.0).expect("OUTREACH")


def test_a_peer_that_was_not_there_is_asked_again_however_long_the_other_checks_took():
    """The watchdog answers when every component has come up, at last after its start-up time: a slow camera."""
    story = at("MISSION_INPUT")
    story.answers["check:on_ground"] = ev.Outcome.UNAVAILABLE
    story.answers["check:watchdog"] = None
    story.select().after(11.0)
    story.answers.clear()
    watchdog = next(record for record in story.state.preflight.checks if record.outcome is None)
    said = {"outcome": ev.Outcome.ACCEPTED, "ok": True, "checks": (Check(name="watchdog", verdict=Verdict.PASS),)}
    story.feed(ev.CheckReply, command_id=watchdog.command_id, check=watchdog.check, **said)
    story.expect("PREFLIGHT").until("START_RECORDING", limit_s=3.0)


# --- a restart in flight ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("asked", ["failure", "user"])
def test_a_restart_during_the_planners_own_landing_holds_nothing(asked):
    story = at("MISSION flying").until("MISSION", "flying")
    while story.planner.phase is not ev.MissionPhase.LANDING:
        story.after(0.1)
    story.after(0.3).look().feed(ev.EngineStarted, label="x", resumed=True)
    _ = story.fail("lrf", 8) if asked == "failure" else story.user("hold")
    story.after(1.0)
    assert story.motions == []


def test_what_fails_right_after_a_restart_is_answered_once_the_planner_is_heard():
    story = at("MISSION flying")
    story.planner.flown_ns = -(10**12)
    story.feed(ev.EngineStarted, label="x", resumed=True)
    story.look().fail("lrf", 8)
    assert story.motions == []
    story.after(0.3)
    assert story.motions == ["HOLD"]


@pytest.mark.parametrize("place", ["LAND commanding", "LAND descending"])
def test_a_restart_while_landing_hears_who_has_control_before_it_lands_again(place):
    story = at(place)
    story.vehicle.obeys, story.vehicle.speed = False, 0.0
    story.vehicle.landed, story.vehicle.mode = ev.VehicleLanded.IN_AIR, "AUTO.RTL"
    story.look().feed(ev.EngineStarted, label="x", resumed=True)
    story.after(1.0).expect("PILOT")
    assert story.motions == []


@pytest.mark.parametrize("place", ["LAND commanding", "LAND descending"])
def test_a_restart_while_landing_lands_again_when_nobody_is_heard(place):
    story = at(place)
    story.silent += ["autopilot", "planner"]
    story.look().feed(ev.EngineStarted, label="x", resumed=True)
    story.after(4.0).expect("LAND", "commanding")
    assert "LAND" in story.motions
    assert "AutopilotLand" in story.requests
