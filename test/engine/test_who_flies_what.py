"""Orders of events that no single rule shows: a flag in our mode, an early landing, another flight, a second alarm."""

from __future__ import annotations

from dataclasses import replace

import pytest
from engine_beginnings import at
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.state import Result, evolve

AIR, GROUND = ev.VehicleLanded.IN_AIR, ev.VehicleLanded.ON_GROUND


def in_mission():
    """Return a mission under way, on its second waypoint, for as long as a test needs."""
    story = at("MISSION flying")
    story.planner.flown_ns = -(10**12)
    return story


# --- a failsafe's flag in our own mode --------------------------------------------------------------------------------


@pytest.fixture
def flagged():
    """Return a mission that is flown under the flag of a failsafe that does nothing."""
    story = in_mission()
    story.vehicle.mode = "AUTO.MISSION"
    story.after(1.0)
    story.say(failsafe=True)
    story.vehicle.says["mode"] = "AUTO.MISSION"
    story.after(2.0)
    assert story.place == ("MISSION", "flying")
    return story.look()


@pytest.mark.parametrize("late_s", [0.15, 0.5, 0.8])
def test_a_landing_of_ours_shows_late_under_the_flag_of_a_failsafe(flagged, late_s):
    flagged.fail("imu", 16)
    flagged.after(late_s)
    del flagged.vehicle.says["mode"]
    flagged.until("DATA_CLEANUP")
    assert flagged.state.session.result is Result.LANDED_EARLY


def test_a_landing_that_is_lost_under_the_flag_of_a_failsafe_is_repeated_by_both_routes(flagged):
    flagged.vehicle.obeys = False
    flagged.vehicle.says["battery_fraction"] = 0.1
    flagged.after(10.0)
    assert flagged.place == ("LAND", "commanding")
    assert flagged.motions.count("LAND") > 10
    assert flagged.motions.count("AutopilotLand") > 5
    assert "land_alarm" in flagged.told


def test_a_hold_that_shows_late_under_the_flag_of_a_failsafe_is_none_of_a_pilot(flagged):
    flagged.fail("lrf", 8)
    flagged.after(0.5)
    del flagged.vehicle.says["mode"]
    flagged.after(1.0)
    assert flagged.place == ("HOLD", "holding")


def test_a_failsafe_that_leaves_our_modes_has_control(flagged):
    flagged.vehicle.says["mode"] = "AUTO.RTL"
    flagged.after(1.0)
    assert flagged.place[0] == "PILOT"


def test_the_planners_own_landing_under_the_flag_of_a_failsafe_is_ours(flagged):
    flagged.vehicle.says["mode"] = "AUTO.LAND"
    flagged.planner.says.update(waypoint=3)
    flagged.planner.phase = ev.MissionPhase.LANDING
    flagged.after(2.0).expect("MISSION", "flying").fail("imu", 16)
    assert flagged.motions == ["LAND"]
    del flagged.vehicle.says["mode"]
    flagged.vehicle.land()
    flagged.until("MISSION_ENDED", limit_s=60)
    assert flagged.state.session.result is Result.COMPLETE


@pytest.mark.parametrize("phase", [ev.MissionPhase.FLYING, ev.MissionPhase.HOLDING])
def test_a_landing_under_the_flag_of_a_failsafe_is_its_own_where_the_planner_does_not_land(flagged, phase):
    flagged.vehicle.says["mode"] = "AUTO.LAND"
    flagged.planner.phase = phase
    flagged.after(1.0).expect("PILOT")
    assert flagged.motions == []


@pytest.mark.parametrize("mode", ["AUTO.MISSION", "AUTO.TAKEOFF", "OFFBOARD"])
def test_a_vehicle_in_the_air_at_the_start_is_landed_whatever_flag_is_up_in_a_mode_that_no_failsafe_chooses(mode):
    story = Story().say(armed=True, landed=AIR, height_m=10.0, mode=mode, failsafe=True).start()
    story.until("LAND", limit_s=5.0)
    assert story.motions[:1] == ["LAND"]


@pytest.mark.parametrize("mode", ["AUTO.LOITER", "AUTO.RTL", "AUTO.LAND"])
def test_a_failsafe_that_acts_at_the_start_keeps_the_vehicle(mode):
    story = Story().say(armed=True, landed=AIR, height_m=10.0, mode=mode, failsafe=True).start()
    story.until("PILOT", limit_s=5.0)
    assert story.motions == []


# --- by set-points, or by a mission of the autopilot ------------------------------------------------------------------


def by_set_points(*, failed=False):
    """Return a mission that is flown by set-points, and held by them where a component has failed."""
    story = at("MISSION flying")
    story.planner.flown_ns = -(10**12)
    story.state = evolve(
        story.state, session=evolve(story.state.session, mission=evolve(story.state.session.mission, set_points=True))
    )
    story.vehicle.says["mode"] = "OFFBOARD"
    story.after(1.5).expect("MISSION", "flying")
    if failed:
        story.vehicle.says["horizontal_speed_m_s"] = 0.1
        story.fail("lrf", 8).until("HOLD", "holding").after(1.2)
    return story.look()


@pytest.mark.parametrize("failed", [False, True], ids=["in the mission", "while it holds"])
@pytest.mark.parametrize("mode", ["AUTO.MISSION", "AUTO.LOITER"])
def test_a_mission_or_a_hold_of_the_autopilot_is_somebody_elses_in_a_mission_by_set_points(mode, failed):
    story = by_set_points(failed=failed)
    story.say(mode=mode)
    assert story.motions == []
    story.after(1.0).expect("PILOT").back("lrf").after(2.0).fail("imu", 16).after(1.0)
    assert story.motions == []


def test_a_mission_by_set_points_holds_and_goes_on_by_them():
    story = by_set_points(failed=True).back("lrf").until("HOLD", "resuming").after(2.0).expect("MISSION", "flying")
    story.fail("lrf", 8).until("HOLD", "holding").after(1.0).expect("HOLD", "holding")
    assert story.motions == ["RESUME", "HOLD"]


@pytest.mark.parametrize("step", ["holding", "resuming"])
def test_fly_here_of_a_ground_station_is_somebody_elses_where_a_mission_of_the_autopilot_is_held(step):
    story = in_mission()
    story.vehicle.mode = "AUTO.MISSION"
    story.after(1.0).fail("lrf", 8).until("HOLD", "holding").after(0.5)
    if step == "resuming":
        story.vehicle.obeys = False
        story.back("lrf").until("HOLD", "resuming")
    story.look()
    story.say(mode="OFFBOARD", horizontal_speed_m_s=3.0)
    story.after(1.0).expect("PILOT")
    assert story.motions == []


# --- a planner of somebody else (docs/integrator.md: flight modes, phases in the air) ---------------------------------


@pytest.mark.parametrize(
    "phase, mode", [("FLYING", "AUTO.LOITER"), ("FLYING", "AUTO.LAND"), ("FLYING", "AUTO.RTL"), ("LANDING", "AUTO.RTL")]
)
def test_a_mission_that_ends_in_a_hold_or_in_a_landing_that_the_planner_does_not_tell_is_a_pilots(phase, mode):
    story = in_mission()
    story.vehicle.mode = "AUTO.MISSION"
    story.after(1.5)
    story.planner.phase = ev.MissionPhase[phase]
    story.vehicle.mode = mode
    story.after(1.0).expect("PILOT").fail("imu", 16).after(1.0)
    assert story.motions == []


@pytest.mark.parametrize("phase", ["HOLDING", "IDLE", "LOADED", "LANDED"])
def test_a_planner_that_leads_nothing_in_the_air_is_landed_for_and_a_wait_at_a_waypoint_is_flying(phase):
    story = in_mission()
    story.vehicle.mode = "AUTO.MISSION"
    story.say(horizontal_speed_m_s=0.0).after(5.0).expect("MISSION", "flying")
    story.planner.phase = ev.MissionPhase[phase]
    story.after(story.rules.limits.planner_idle_limit_ns / 10**9 + 0.5)
    assert story.place[0] == "LAND"


# --- a mission behind the pilot ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", ["DATA_CLEANUP", "OUTREACH data"])
def test_no_further_mission_takes_off_behind_a_pilot_who_flew_by_hand(place):
    story = at(place)
    result = story.state.session.result
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    story.say(armed=True, mode="POSCTL", pilot_in_control=True)
    story.after(0.5).expect("PILOT")
    assert story.state.queue == ()
    assert "queue_dropped" in story.told
    assert story.state.session.result is result


# --- who lands before the last waypoint -------------------------------------------------------------------------------


def nobody(_story):
    """Leave it to the planner."""


ENDS = {
    "nobody": nobody,
    "the user": lambda story: story.user("land"),
    "a failure": lambda story: story.fail("imu", 16),
    "a silent planner": lambda story: story.silent.append("planner"),
}


@pytest.mark.parametrize("end", ENDS)
def test_a_planner_that_lands_on_the_way_to_the_last_waypoint_has_not_completed_the_mission(end):
    story = in_mission()
    story.planner.says.update(waypoint=2)  # the last that was reached, of three
    story.planner.phase = ev.MissionPhase.LANDING
    story.vehicle.land()
    story.after(0.5)
    ENDS[end](story)
    story.until("DATA_CLEANUP", limit_s=60)
    assert story.state.session.result is Result.LANDED_EARLY


@pytest.mark.parametrize("command", ["land", "abort"])
@pytest.mark.parametrize("landing", [False, True], ids=["in the mission", "while it lands"])
def test_who_has_it_landed_has_no_other_mission_flown_for_him(command, landing):
    story = in_mission()
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    if landing:
        story.fail("imu", 16)
        story.after(0.5)
    story.user(command)
    story.after(0.1)
    assert story.state.queue == ()
    assert "queue_dropped" in story.told


def lands_for_a_component(story):
    story.fail("imu", 16).after(1.0).back("imu")


def lands_what_seemed_over(story):
    story.say(armed=False, landed=GROUND)
    story.landing_says = ev.Landed.ON_GROUND
    story.planner.says.update(phase=ev.MissionPhase.LANDED)
    story.until("DATA_CLEANUP", limit_s=15.0)
    story.landing_says, story.vehicle.height = None, 1.5
    story.vehicle.says.clear()
    story.planner.says.clear()
    story.vehicle.armed, story.vehicle.landed, story.vehicle.mode = True, AIR, "AUTO.LAND"


def lands_after_its_alarms(story):
    story.vehicle.obeys, story.vehicle.speed = False, 0.0
    story.silent.append("autopilot")
    story.after(130.0).silent.clear()
    story.vehicle.obeys = True


@pytest.mark.parametrize("how", [lands_for_a_component, lands_what_seemed_over, lands_after_its_alarms])
def test_behind_a_landing_of_ours_nothing_takes_off_though_the_mission_was_flown(how):
    """At the last waypoint: the mission is complete, and whoever walks to the vehicle knows of no other one."""
    story = at("MISSION flying")
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    while story.planner.phase is not ev.MissionPhase.LANDING:
        story.after(0.1)
    how(story.look())
    story.after(150.0).expect("MISSION_ENDED")
    assert story.state.session.result is Result.COMPLETE
    assert "TAKEOFF" not in story.motions
    assert "queue_dropped" in story.told


# --- somebody else's flight after ours --------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", ["silence", "armed unknown", "an old link"])
def test_who_arms_it_on_the_ground_after_the_mission_flies_it_through_a_gap_of_its_statuses(gap):
    story = at("MISSION_INPUT").select().until("MISSION_ENDED").after(20.0)
    story.say(armed=True, mode="AUTO.MISSION")
    story.after(1.0)
    story.say(landed=AIR, height_m=20.0)
    story.after(5.0)
    story.look()
    if gap == "silence":
        story.silent.append("autopilot")
        story.after(1.3)
        story.silent.clear()
    else:
        told = {"armed": None} if gap == "armed unknown" else {"link_age_s": 3.5}
        before = {name: story.vehicle.says.get(name) for name in told}
        story.say(**told)
        story.after(0.15)
        for name, value in before.items():
            if value is None:
                del story.vehicle.says[name]
            else:
                story.vehicle.says[name] = value
    story.after(2.0)
    assert story.motions == []


# --- alarms -----------------------------------------------------------------------------------------------------------


def test_an_alarm_about_a_silent_vehicle_does_not_stand_for_one_that_does_not_land():
    story = in_mission()
    story.silent.append("autopilot")
    story.vehicle.obeys = False
    story.after(2.5)
    assert "autopilot_lost" in story.told
    story.silent.clear()
    story.after(10.0)
    assert story.told.count("land_alarm") == 1


def test_a_moment_that_shows_no_landing_spends_no_alarm():
    """A mode that is not said late in the descent: it lands on, and nobody is alarmed until it does not."""
    story = in_mission()
    story.vehicle.obeys = False
    story.user("land")
    lands = {"mode": "AUTO.LAND", "landed": AIR, "vertical_speed_m_s": -0.5}
    flies = {"mode": "", "landed": AIR, "vertical_speed_m_s": 0.0}
    story.vehicle.says.update(lands)
    story.after(8.0).expect("LAND", "descending")
    story.vehicle.says.update(flies)
    story.after(0.3).expect("LAND", "commanding")
    story.vehicle.says.update(lands)
    story.after(1.0).expect("LAND", "descending")
    assert "land_alarm" not in story.told
    story.vehicle.says.update(flies)
    story.after(6.5).expect("LAND", "commanding")
    assert story.told.count("land_alarm") == 1


def test_an_alarm_about_a_landing_does_not_stand_for_a_silent_vehicle():
    story = in_mission()
    story.vehicle.obeys = False
    story.fail("imu", 16)
    story.after(8.0)
    assert "land_alarm" in story.told
    story.look()
    story.silent.append("autopilot")
    story.after(2.5)
    assert story.told.count("autopilot_lost") == 1


# --- a planner that holds unasked, a vehicle that stands, a signal in doubt -------------------------------------------


def test_a_planner_that_holds_unasked_is_landed_for():
    story = in_mission()
    story.vehicle.says["mode"] = "OFFBOARD"
    story.after(0.5)
    story.planner.phase = ev.MissionPhase.HOLDING
    story.planner.says["phase"] = ev.MissionPhase.HOLDING
    story.after(3.0)
    assert story.place[0] == "LAND"


def seems_over(height_m=0.9):
    """Return a mission whose vehicle says that it has landed; the landing detection says nothing of it."""
    story = in_mission()
    story.silent.append("landing")
    story.after(1.2)
    story.say(armed=False, landed=GROUND, height_m=height_m)
    story.after(0.7)
    assert not story.state.flight.active
    return story


def test_a_signal_to_end_while_a_flight_only_seems_over_is_answered_when_it_goes_on():
    story = seems_over()
    story.feed(ev.Shutdown, signal="SIGTERM")
    assert story.motions == []
    story.vehicle.says.clear()
    story.after(1.0)
    assert story.place[0] == "LAND"
    assert "AutopilotLand" in story.motions


@pytest.mark.parametrize("command", ["land", "abort"])
def test_a_landing_that_the_user_asks_for_while_a_flight_only_seems_over_is_answered_when_it_goes_on(command):
    story = seems_over()
    assert story.user(command) == ("ALREADY", "It seems to have landed; it is landed if it has not.")
    assert story.motions == []
    story.vehicle.says.clear()
    story.after(1.0)
    assert story.place[0] == "LAND"
    assert "LAND" in story.motions


def test_a_landing_that_was_asked_for_while_a_flight_seemed_over_is_no_matter_after_it():
    story = seems_over(height_m=0.0)
    story.user("land")
    story.after(12.0)
    assert story.place[0] not in ("MISSION", "LAND")
    assert (story.motions, story.state.land_deferred) == ([], None)


def test_a_landing_that_is_asked_for_as_the_flight_is_found_to_be_over_is_not_put_off():
    story = seems_over(height_m=0.0)
    long_ago = story.now - 60 * 10**9
    vehicle = evolve(story.state.vehicle, down=evolve(story.state.vehicle.down, since_ns=long_ago))
    state = evolve(story.state, flight=evolve(story.state.flight, grounded_ns=long_ago), vehicle=vehicle)
    state, _ = decide(state, ev.UserRequest(t_ns=story.now, command=ev.UserCommand.LAND, request_id=9), story.rules)
    assert (state.state.value, state.land_deferred) == ("DATA_CLEANUP", None)


@pytest.mark.parametrize("why", ["the user", "a component"])
def test_what_lands_while_it_holds_is_not_resumed(why):
    """The planner ends its hold with a landing of its own."""
    story = at("HOLD holding")
    if why == "the user":
        story = in_mission()
        story.user("hold")
        story.until("HOLD", "holding", limit_s=5.0)
    story.planner.phase = ev.MissionPhase.LANDING
    story.planner.says["phase"] = ev.MissionPhase.LANDING
    story.say(mode="AUTO.LAND", landed=ev.VehicleLanded.LANDING)
    story.after(0.5).look()
    if why == "the user":
        assert story.user("resume") == ("REFUSED", "A landing is not interrupted.")
    else:
        story.fail("lrf", 1)
        story.after(1.0)
    assert "RESUME" not in story.motions
