"""Landing: sticky, repeated, by the second route, loudly; over when the autopilot says so; disarm on the ground."""

from __future__ import annotations

from dataclasses import replace

import pytest
from engine_beginnings import at
from engine_peers import S

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import MESSAGES, AutopilotDisarm, Level, Notify
from amaze_autonomy.engine.flight_guards import ALARM_STANDS
from amaze_autonomy.engine.state import State, Step
from amaze_autonomy.engine.transitions import TRANSITIONS
from amaze_autonomy.monitoring.land_switch import LandRequests


def test_repeated_at_2_hz_until_it_is_shown():
    story = at("MISSION flying")
    story.vehicle.obeys = False
    start = story.now / S
    story.user("land")
    story.after(2.9)
    assert story.times_of("LAND") == [round(start + 0.5 * n, 6) for n in range(6)]
    assert story.times_of("AutopilotLand") == []
    story.say(mode="AUTO.LAND").look().after(1.0)
    assert story.motions == []


def test_what_asks_in_the_place_of_a_person_is_the_cause_of_the_landing():
    story = at("MISSION flying")
    story.feed(ev.UserRequest, command=ev.UserCommand.LAND, by="the transmitter's land switch")
    (decision,) = [each for each in story.decisions if each.rule == "user_land"]
    assert [(each.name, each.value) for each in decision.values] == [
        ("user", "land"),
        ("by", "the transmitter's land switch"),
    ]
    assert story.state.landing.cause == "the transmitter's land switch"
    told = [each.text for each in story.since if isinstance(each, Notify)]
    assert told == ["Landing as the transmitter's land switch says."]


@pytest.mark.parametrize("place", ["START_RECORDING", "LOAD_MISSION", "MISSION touchdown"])
def test_nothing_takes_off_against_a_switch_that_says_land(place):
    story = at(place)
    request = LandRequests(frozenset()).answer(story.state, story.now, on=True)
    story.look().feed(ev.UserRequest, command=request.command, by=request.by)
    story.until("MISSION_ENDED").after(10.0)
    assert "TAKEOFF" not in story.motions
    (told,) = [each.text for each in story.since if isinstance(each, Notify) and each.key == "called_off"]
    assert told == "No further takeoff: the transmitter's land switch says land."
    assert ("by", request.by) in [(each.name, each.value) for decision in story.decisions for each in decision.values]


def test_second_route_after_3_s_alarm_after_6_s_and_again_at_the_limit():
    story = at("MISSION flying")
    story.vehicle.obeys = False
    start = story.now
    story.user("land")
    story.after(125.0).expect("LAND", "commanding")
    assert story.times_of("AutopilotLand")[0] == round((start + 3 * S) / S, 6)
    told = [(round((t - start) / S, 6), c.key) for t, c in story.sent if isinstance(c, Notify) and t >= start]
    stands = (60.2, "failure_land")  # for a minute the planner has said that it lands
    alarms = (3.0, "land_second_route"), (6.0, "land_alarm"), stands, (120.0, "land_limit")
    assert told == [(0.0, "land_user"), *alarms]
    alarms = [c.key for c in story.since if isinstance(c, Notify) and c.level is Level.ALARM]
    assert alarms == ["land_alarm", "land_limit"]
    assert "PILOT: NOT LANDED AFTER 120 s. TAKE OVER." in [c.text for c in story.since if isinstance(c, Notify)]
    assert story.motions[-4:] == ["LAND", "AutopilotLand", "LAND", "AutopilotLand"]
    assert story.state.landing.both_routes


@pytest.mark.parametrize(
    "claims",
    [
        {"mode": "AUTO.LAND"},
        {"mode": "AUTO.PRECLAND"},
        {"landed": ev.VehicleLanded.LANDING},
        {"landed": ev.VehicleLanded.ON_GROUND, "height_m": 0.0},
    ],
)
def test_what_shows_a_landing(claims):
    story = at("LAND commanding")
    story.landing_says = ev.Landed.UNKNOWN
    story.vehicle.says.update(height_m=0.5)
    story.after(4.2).expect("LAND", "commanding").say(**claims).expect("LAND", "descending")


def test_a_sustained_descent_shows_it_a_short_one_does_not():
    story = at("LAND commanding")
    story.say(vertical_speed_m_s=-0.3).after(0.9).expect("LAND", "commanding")
    story.after(0.3).expect("LAND", "descending")


@pytest.mark.parametrize("speed", [-0.19, 0.0, 0.5, float("nan"), None])
def test_no_descent_shows_nothing(speed):
    at("LAND commanding").say(vertical_speed_m_s=speed).after(2.0).expect("LAND", "commanding")


def test_what_was_shown_and_stops_is_commanded_again_at_once():
    story = at("LAND commanding")
    story.say(landed=ev.VehicleLanded.LANDING).expect("LAND", "descending").look()
    story.say(landed=ev.VehicleLanded.IN_AIR).expect("LAND", "commanding")
    assert story.motions == ["LAND"]


def test_not_landed_at_the_limit_both_routes_repeat_although_it_shows_a_landing():
    story = at("LAND descending")
    story.vehicle.speed, story.vehicle.obeys = 0.0, False
    story.after(130.0).expect("LAND", "commanding")
    assert "land_limit" in story.told
    assert story.motions[-2:] == ["LAND", "AutopilotLand"]


def test_landed_is_disarmed_and_on_ground_both():
    story = at("LAND descending")
    story.say(landed=ev.VehicleLanded.ON_GROUND).expect("LAND")
    story.say(landed=ev.VehicleLanded.LANDING, armed=False).expect("LAND")
    story.landing_says = ev.Landed.ON_GROUND
    story.report()
    story.say(landed=ev.VehicleLanded.ON_GROUND, armed=False).until("DATA_CLEANUP", limit_s=0.7)


def test_landed_must_be_fresh():
    story = at("LAND descending")
    story.silent.append("autopilot")
    story.after(10.0).expect("LAND")


# --- the landing detection --------------------------------------------------------------------------------------------


def test_the_landing_detection_confirms():
    story = at("LAND descending").until("DATA_CLEANUP")
    assert "landing_unconfirmed" not in story.told


@pytest.mark.parametrize("happens", ["unknown", "silent"])
def test_an_unknown_landing_detection_is_reported_and_not_waited_for(happens):
    story = at("LAND descending")
    if happens == "unknown":
        story.landing_says = ev.Landed.UNKNOWN
    else:
        story.silent.append("landing")
    story.until("DATA_CLEANUP")
    down_ns = next(t for t, c in story.sent if getattr(c, "rule", "") == "landed")
    assert story.now == down_ns
    assert story.vehicle.armed is False
    assert "landing_unconfirmed" in story.told
    assert story.now - story.state.flight.grounded_ns < S


def test_a_landing_detection_that_contradicts_is_waited_for_up_to_its_limit():
    story = at("LAND descending")
    story.landing_says = ev.Landed.AIRBORNE
    story.after(2.5).expect("LAND")
    down_ns = story.state.flight.grounded_ns
    story.after_ns(down_ns + 10 * S - story.now - 1).expect("LAND")
    story.after_ns(1).expect("DATA_CLEANUP")
    assert "landing_unconfirmed" in story.told


def test_nothing_is_commanded_while_the_confirmation_is_waited_for():
    story = at("LAND descending")
    story.landing_says = ev.Landed.AIRBORNE
    story.until("DATA_CLEANUP")
    assert story.motions == []


def test_down_and_then_silent_is_landed():
    """The autopilot said that it is down and is switched off: nothing else can come."""
    story = at("LAND descending")
    while story.vehicle.armed:
        story.after(0.1)
    story.after(0.7)
    story.silent.append("autopilot")
    story.after(20.0)
    assert story.place[0] in ("DATA_CLEANUP", "MISSION_ENDED")


@pytest.mark.parametrize("place", ["MISSION flying", "HOLD holding"])
def test_an_unknown_landed_state_says_nothing_of_a_flight_that_seems_over(place):
    """Found by steps from states that nobody has reached: it was forgotten that the vehicle had come down."""
    story = at(place)
    flight = replace(story.state.flight, active=False, grounded_ns=story.now)
    landing = replace(story.state.landing, disarm_sent_ns=story.now)
    story.state = replace(story.state, flight=flight, landing=landing)
    story.say(armed=True, landed=ev.VehicleLanded.UNKNOWN)
    assert story.state.flight.grounded_ns == flight.grounded_ns
    assert story.state.landing.disarm_sent_ns is None, "what was sent before says nothing of the next contact"
    story.say(armed=True, landed=ev.VehicleLanded.IN_AIR)
    assert story.state.flight.grounded_ns is None


# --- disarm -----------------------------------------------------------------------------------------------------------


def _on_ground_armed():
    story = at("LAND descending")
    story.vehicle.auto_disarm = False
    story.disobeyed.append("AutopilotDisarm")
    return story


def test_on_ground_but_armed_is_disarmed_after_a_while_and_again():
    story = _on_ground_armed()
    story.after(3.0)
    grounded_ns = story.state.flight.grounded_ns
    story.after(8.0)
    expected = [round((grounded_ns + n * S) / S, 6) for n in (4, 6, 8)]
    assert story.times_of("AutopilotDisarm") == expected


@pytest.mark.parametrize(
    "claims",
    [
        {"landed": ev.VehicleLanded.UNKNOWN},
        {"landed": ev.VehicleLanded.IN_AIR},
        {"landed": ev.VehicleLanded.LANDING},
        {"armed": None},
        {"link_age_s": None},
    ],
)
def test_never_disarmed_while_airborne_or_unknown(claims):
    story = _on_ground_armed()
    story.disobeyed += ["LAND", "AutopilotLand"]
    story.say(**claims).after(30.0).expect("LAND")
    assert "AutopilotDisarm" not in story.motions


def test_never_disarmed_while_the_landing_detection_says_airborne():
    story = _on_ground_armed()
    story.landing_says = ev.Landed.AIRBORNE
    story.after(30.0).expect("LAND")
    assert "AutopilotDisarm" not in story.motions


def test_a_landing_detection_that_fell_silent_in_the_air_does_not_forbid_to_disarm():
    story = _on_ground_armed()
    story.silent.append("landing")
    story.disobeyed.clear()
    story.until("DATA_CLEANUP")
    assert story.motions == ["AutopilotDisarm"]


@pytest.mark.parametrize("outcome", [ev.Outcome.REFUSED, ev.Outcome.TIMED_OUT])
@pytest.mark.parametrize("says", ["landing detection", "height"])
def test_a_vehicle_that_hovers_and_says_that_it_stands_is_commanded_to_land_all_the_same(says, outcome):
    story = at("MISSION flying")
    story.vehicle.obeys, story.planner.flown_ns = False, -(10**13)
    story.answers.update(LAND=outcome)
    story.vehicle.says.update(landed=ev.VehicleLanded.ON_GROUND, height_m=2.6, vertical_speed_m_s=0.0)
    story.vehicle.speed = 0.0
    story.landing_says = ev.Landed.AIRBORNE if says == "landing detection" else ev.Landed.UNKNOWN
    story.after(0.4).look().fail("imu", 16)
    story.after(30.0).expect("LAND", "commanding")
    assert story.motions.count("LAND") > 10
    assert story.motions.count("AutopilotLand") > 10
    assert "AutopilotDisarm" not in story.requests
    assert "land_alarm" in story.told
    assert "stays_armed" not in story.told
    assert story.state.shown.key == "land_alarm"


@pytest.mark.parametrize("lapse", [ev.Landed.UNKNOWN, ev.Landed.ON_GROUND])
def test_a_landing_detection_with_gaps_hides_no_hovering_vehicle(lapse):
    story = at("MISSION flying")
    story.vehicle.obeys, story.planner.flown_ns = False, -(10**13)
    story.vehicle.says.update(landed=ev.VehicleLanded.ON_GROUND, height_m=0.8, vertical_speed_m_s=0.0)
    story.vehicle.speed = 0.0
    story.landing_says = ev.Landed.AIRBORNE
    story.after(0.4).look().fail("imu", 16)
    for _ in range(6):
        story.landing_says = lapse
        story.after(0.8)
        story.landing_says = ev.Landed.AIRBORNE
        story.after(4.2)
    story.expect("LAND", "commanding")
    assert "AutopilotDisarm" not in story.requests
    assert ("land_shown" in story.told, "stays_armed" in story.told) == (False, False)
    assert story.state.shown.key == "land_alarm"


def test_a_landing_detection_that_flickers_floods_nobody_with_landings():
    story = at("MISSION flying")
    story.vehicle.obeys, story.planner.flown_ns = False, -(10**13)
    story.vehicle.says.update(landed=ev.VehicleLanded.ON_GROUND, height_m=0.8, vertical_speed_m_s=0.0)
    story.vehicle.speed = 0.0
    story.user("land")
    story.look()
    for number in range(200):
        story.feed(ev.LandedStatus, landed=ev.Landed.AIRBORNE if number % 2 else ev.Landed.ON_GROUND)
        story.after(0.05)
    assert story.motions.count("LAND") <= 22


def test_never_disarmed_when_ground_is_a_blink():
    story = _on_ground_armed()
    for _ in range(10):
        story.say(landed=ev.VehicleLanded.ON_GROUND).after(1.9)
        story.say(landed=ev.VehicleLanded.IN_AIR).after(0.2)
    assert "AutopilotDisarm" not in story.motions


def test_the_disarm_is_never_first_in_front_of_a_landing():
    story = _on_ground_armed()
    story.after(6.9)
    for commands in [story.feed(ev.Tick, t_ns=story.now + n * S) for n in range(20)]:
        names = [type(c).__name__ for c in commands]
        if "AutopilotDisarm" in names and "MissionCommand" in names:
            assert names.index("MissionCommand") < names.index("AutopilotDisarm")


def test_on_the_ground_and_armed_at_the_limit_the_pilot_is_alarmed():
    story = _on_ground_armed()
    story.after(125.0).expect("LAND")
    alarms = [c.key for c in story.since if isinstance(c, Notify) and c.level is Level.ALARM]
    assert alarms == ["stays_armed", "land_limit"]


def test_after_the_planners_own_landing_it_is_disarmed_too():
    story = at("MISSION flying")
    story.vehicle.auto_disarm = False
    story.until("DATA_CLEANUP")
    assert [c for c in story.since if isinstance(c, AutopilotDisarm)]
    assert story.state.session.result.value == "COMPLETE"


# --- an alarm ---------------------------------------------------------------------------------------------------------


def test_an_alarm_is_shown_until_it_is_over_whatever_else_is_said():
    story = at("MISSION flying")
    story.vehicle.obeys = False
    story.user("land")
    story.after(10.0).fail("realsense_imu", 8)
    story.after(1.0).back("realsense_imu")
    story.after(5.0)
    assert story.told[-1] != "land_alarm"
    assert story.state.shown.key == "land_alarm"
    story.vehicle.obeys = True
    story.after(1.0)
    assert story.state.shown.key == "land_shown"


@pytest.mark.parametrize("alarm", ["stays_armed", "land_limit"])
def test_an_alarm_that_no_sign_of_a_landing_ends_is_shown_until_it_has_landed(alarm):
    story = _on_ground_armed()
    story.after(125.0 if alarm == "land_limit" else 45.0)
    assert story.state.shown.key == alarm
    story.fail("realsense_imu", 8).after(1.0)
    assert story.state.shown.key == alarm
    story.disobeyed.clear()
    story.until("DATA_CLEANUP")
    assert story.state.shown.key == "data_cleanup"


def test_an_alarm_that_stands_is_shown_again_when_another_one_is_over():
    story = _on_ground_armed()
    story.disobeyed += ["LAND", "AutopilotLand"]
    story.after(45.0)
    assert story.state.shown.key == "stays_armed"
    story.silent.append("autopilot")
    story.after(2.0)
    assert story.state.shown.key == "autopilot_lost"
    story.silent.clear()
    story.after(2.0)
    assert story.state.shown.key == "stays_armed"


def test_on_the_ground_and_armed_is_not_shown_of_a_vehicle_in_the_air():
    story = _on_ground_armed()
    story.after(45.0)
    story.vehicle.height, story.vehicle.landed, story.vehicle.speed = 15.0, ev.VehicleLanded.IN_AIR, 0.0
    story.landing_says = ev.Landed.AIRBORNE
    story.after(5.0)
    assert story.state.shown.key != "stays_armed"


def test_a_vehicle_that_is_heard_again_is_not_to_be_taken_over_while_it_lands():
    story = at("LAND descending")
    story.vehicle.speed = 0.0
    story.vehicle.says["landed"] = ev.VehicleLanded.UNKNOWN
    story.after(12.0)
    assert story.state.shown.key == "autopilot_lost"
    story.vehicle.says.clear()
    story.after(2.0)
    assert story.state.shown.level is not Level.ALARM


def test_the_alarm_of_a_landing_that_was_given_up_is_not_shown_of_the_next_one():
    story = at("MISSION flying")
    story.vehicle.height, story.planner.flown_ns, story.vehicle.obeys = 25.0, -(10**18), False
    story.silent.append("autopilot")
    story.after(9.0).user("acknowledge")
    story.until("MISSION_ENDED").silent.clear()
    story.vehicle.obeys = True
    story.after(3.0).expect("LAND")
    assert story.state.shown.level is not Level.ALARM


def test_each_alarm_of_a_landing_says_until_when_it_stands():
    told = {
        row.message for row in TRANSITIONS if State.LAND in row.sources or (State.LAND, Step.COMMANDING) in row.sources
    }
    alarms = {key for key in told if key and MESSAGES[key].level is Level.ALARM} - {"landing_given_up"}
    assert alarms == set(ALARM_STANDS)


# --- sticky -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("phase", list(ev.MissionPhase))
def test_whatever_the_planner_says_a_landing_goes_on(phase):
    story = at("LAND commanding")
    story.planner.says["phase"] = phase
    story.after(5.0).expect("LAND")
    assert set(story.motions) <= {"LAND", "AutopilotLand"}


def test_a_landing_before_lift_off_is_repeated_until_it_is_disarmed():
    story = at("TAKEOFF lifting_off")
    story.disobeyed.append("LAND")
    story.vehicle.obeys = False
    story.user("land")
    story.after(1.1).expect("LAND", "commanding")
    assert story.motions == ["LAND", "LAND", "LAND"]


def test_a_takeoff_that_comes_late_during_the_landing_is_landed():
    """LAND came before it was armed; the planner lost it and takes off."""
    story = at("TAKEOFF arming")
    story.disobeyed.append("LAND")
    story.user("land")
    story.look().say(armed=True).expect("LAND", "commanding")
    story.say(landed=ev.VehicleLanded.TAKING_OFF, mode="AUTO.TAKEOFF").after(1.0).expect("LAND", "commanding")
    assert story.motions.count("LAND") >= 2


def test_landed_by_itself_in_a_hold_is_not_resumed():
    story = at("HOLD holding")
    story.planner.says["phase"] = ev.MissionPhase.HOLDING
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND)
    story.landing_says = ev.Landed.ON_GROUND
    story.after(12.0)
    assert story.motions == []
    assert story.place[0] in ("DATA_CLEANUP", "MISSION_ENDED")
    assert story.state.session.result.value == "LANDED_EARLY"


@pytest.mark.parametrize(
    "place", ["MISSION flying", "HOLD holding", "HOLD confirming", "HOLD resuming", "TAKEOFF climbing"]
)
def test_down_and_then_silence_does_not_stay_for_ever(place):
    story = at(place)
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND)
    story.silent += ["autopilot", "planner", "landing", "watchdog", "recorder"]
    story.after(100.0).expect("LAND")
    assert story.state.landing.alarmed, "one status is not believed: the pilot is alarmed, and a person ends it"
    assert story.user("acknowledge")[0] == "DONE"
    story.after(100.0)
    assert story.place[0] in ("OUTREACH", "MISSION_ENDED")


def test_flight_time_does_not_end_on_the_ground():
    story = at("MISSION touchdown")
    limits = replace(story.rules.limits, max_flight_time_ns=1 * S)
    story.rules = replace(story.rules, limits=limits)
    story.after(2.0).expect("MISSION", "touchdown")


UNKNOWN = {
    "armed": {"armed": None},
    "landed": {"landed": ev.VehicleLanded.UNKNOWN},
    "link": {"link_age_s": None},
    "everything": {"armed": None, "landed": ev.VehicleLanded.UNKNOWN, "link_age_s": None},
    "in the air but disarmed": {"landed": ev.VehicleLanded.IN_AIR},
}


@pytest.mark.parametrize("claims", UNKNOWN.values(), ids=UNKNOWN)
@pytest.mark.parametrize(
    "place", ["TAKEOFF climbing", "MISSION flying", "HOLD holding", "HOLD confirming", "HOLD resuming"]
)
def test_down_and_then_unknown_still_has_an_end(place, claims):
    """Found by trying every three things in a row: the end of the confirmation was forgotten."""
    story = at(place)
    story.planner.flown_ns = -60 * S
    story.landing_says = ev.Landed.ON_GROUND
    story.report()
    story.vehicle.speed = 0.0
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND).after(0.7).expect(place.split()[0])
    assert not story.state.flight.active
    story.say(**claims)
    story.after(100.0)
    assert story.place[0] in ("LAND", "DATA_CLEANUP", "MISSION_ENDED")


@pytest.mark.parametrize("place", ["TAKEOFF climbing", "MISSION flying", "HOLD holding"])
def test_down_and_then_in_the_air_without_knowing_whether_it_is_armed_is_in_flight(place):
    story = at(place)
    story.landing_says = ev.Landed.ON_GROUND
    story.report()
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND).after(0.7)
    assert not story.state.flight.active
    story.say(armed=None, landed=ev.VehicleLanded.IN_AIR)
    assert story.state.flight.active
    story.fail("imu", 16).expect("LAND")


@pytest.mark.parametrize("between", ["a silence", "a restart of the engine"])
def test_two_wrong_statuses_far_apart_disarm_nothing(between):
    """One before, one after: nothing is known of what was meanwhile."""
    story = at("LAND descending")
    story.vehicle.height, story.vehicle.speed, story.vehicle.obeys = 5.0, 0.0, False
    story.silent += ["landing", "autopilot"]
    lie = {"landed": ev.VehicleLanded.ON_GROUND, "height_m": 0.0}
    story.say(**lie).after(4.5)
    if between == "a restart of the engine":
        story.feed(ev.EngineStarted, label="again", resumed=True)
    story.look().say(**lie)
    assert story.vehicle.armed
    assert "AutopilotDisarm" not in story.requests


def test_a_landing_that_was_given_up_is_not_complete_and_nothing_else_is_flown():
    """Its last waypoint was flown, and whether it has landed nobody knows."""
    story = at("MISSION flying")
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    while story.planner.phase is not ev.MissionPhase.LANDING:
        story.after(0.1)
    story.say(landed=ev.VehicleLanded.IN_AIR, height_m=2.0).silent.append("autopilot")
    story.after(9.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.after(8.0)
    assert (story.state.session.result.value, story.state.session.id) == ("LANDED_EARLY", "test-001")


def test_a_vehicle_that_was_given_up_and_is_heard_again_in_the_air_is_landed():
    story = at("LAND commanding")
    story.say(landed=ev.VehicleLanded.IN_AIR, height_m=2.0).silent.append("autopilot")
    story.after(9.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.until("MISSION_ENDED", limit_s=20.0).select()
    story.after(1.0).look()
    story.silent.remove("autopilot")
    story.say(armed=True, landed=ev.VehicleLanded.IN_AIR, height_m=2.0)
    story.until("LAND", limit_s=2.0)
    assert story.motions[:1] == ["LAND"]


def test_a_landing_of_which_nothing_is_known_any_more_may_be_given_up():
    """The link lives, but whether it is armed and has landed never comes again."""
    story = at("LAND commanding")
    story.say(armed=None, landed=ev.VehicleLanded.UNKNOWN, mode="", height_m=None).after(4.0)
    assert story.user("acknowledge")[0] == "REFUSED"
    story.after(2.5)
    assert story.user("acknowledge")[0] == "DONE"
    story.expect("DATA_CLEANUP")
    assert "landing_given_up" in story.told
    assert "data_cleanup" not in story.told


def test_a_given_up_landing_stays_so_when_the_vehicle_is_heard_again_and_nothing_else_is_flown():
    """The link comes back while the data is collected: it is landed, and its mission no more complete than before."""
    story = at("MISSION flying")
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    while story.planner.phase is not ev.MissionPhase.LANDING:
        story.after(0.1)
    story.vehicle.obeys, story.vehicle.speed = False, 0.0
    story.after(0.3).silent.append("autopilot")
    story.after(9.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.after(0.4)
    story.silent.clear()
    story.look().until("LAND", limit_s=2.0)
    story.vehicle.obeys = True
    story.vehicle.land()
    story.until("MISSION_ENDED", limit_s=60.0).after(5.0)
    assert (story.place[0], story.state.session.result.value) == ("MISSION_ENDED", "LANDED_EARLY")
    assert story.state.queue == ()


def test_a_flight_that_goes_on_behind_its_first_file_is_not_complete_with_that():
    """It says for a moment too early that it is down; the planner says that its file is flown, and the next is not."""
    story = at("MISSION flying")
    mission = replace(story.state.session.mission, files=2)
    story.state = replace(story.state, session=replace(story.state.session, mission=mission))
    while story.planner.phase is not ev.MissionPhase.LANDING:
        story.after(0.1)
    story.after(0.8).landing_says = ev.Landed.ON_GROUND
    story.planner.phase = ev.MissionPhase.LANDED
    story.answers["LoadMission"] = None
    story.disobeyed.append("LoadMission")
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND, height_m=0.0).until("MISSION", "touchdown", limit_s=2.0)
    story.vehicle.says.clear()
    story.vehicle.armed, story.vehicle.height, story.vehicle.speed = True, 1.5, -0.5
    story.vehicle.landed = ev.VehicleLanded.LANDING
    story.look().until("MISSION_ENDED", limit_s=60.0)
    assert story.state.session.result.value == "LANDED_EARLY"
