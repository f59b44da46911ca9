"""What else can be lost: every row of the second part of the decision table, in every phase of flight, at its limit."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from typing import Callable, Dict, NamedTuple, Tuple

import pytest
from engine_beginnings import at
from engine_peers import SHIPPED, S
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    Answer,
    AnswerKind,
    AutopilotDisarm,
    AutopilotLand,
    Level,
    MissionAction,
    MissionCommand,
    Notify,
    StopRecording,
)
from amaze_autonomy.engine.decide import _rank
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.failsafe import FAILSAFE_CONDITIONS
from amaze_autonomy.laws.flight import BOUNDS, Bound

AIRBORNE = (
    "TAKEOFF climbing",
    "MISSION flying",
    "HOLD confirming",
    "HOLD holding",
    "HOLD holding takeoff",
    "HOLD resuming",
)
LANDING = ("LAND commanding", "LAND descending")
ONE, BOTH = ("LAND",), ("LAND", "AutopilotLand")


class Loss(NamedTuple):
    """A row by hand: what is lost how, after how long it is noticed at most, and what the vehicle's side is told."""

    happens: Callable[[Story], object]
    limit_s: float
    action: str
    motions: Tuple[str, ...] = ()
    alarm: bool = False


def silent(stream: str) -> Callable[[Story], object]:
    return lambda story: story.silent.append(stream)


def says(**claims: object) -> Callable[[Story], object]:
    return lambda story: story.say(**claims)


def planner_failed(story: Story) -> None:
    story.planner.says["phase"] = ev.MissionPhase.FAILED


def planner_says_nothing_is_flown(story: Story) -> None:
    """As after a lie of the vehicle to the planner alone: it has landed, for the planner."""
    story.planner.says["phase"] = ev.MissionPhase.LANDED


def planner_lands_and_it_stands(story: Story) -> None:
    """As a vehicle whose landing mode finds no ground: here it is noticed soon, while everything else still waits."""
    story.rules = replace(story.rules, limits=replace(story.rules.limits, landing_stall_limit_ns=3 * S // 10))
    story.planner.says["phase"] = ev.MissionPhase.LANDING
    story.say(vertical_speed_m_s=0.0, horizontal_speed_m_s=0.1)


def flight_time(story: Story) -> None:
    """Let the limit be 0.3 s from now."""
    so_far = story.now - story.state.flight.started_ns
    story.rules = replace(story.rules, limits=replace(story.rules.limits, max_flight_time_ns=so_far + 3 * S // 10))


def recorder_failed(story: Story) -> None:
    story.recorder.phase = ev.RecordingPhase.FAILED


def recorder_does_not_grow(story: Story) -> None:
    story.recorder.growing = (True, False)


def at_bound(bound: Bound, beyond: float = 0.0) -> float:
    """Return the value at its limit, or beyond it by a part of it."""
    return float(getattr(SHIPPED.limits, bound.limit)) * (1.0 + beyond)


EXPECTED: Dict[str, Loss] = {
    "watchdog_heartbeat": Loss(silent("watchdog"), 0.6, "LAND", ONE),
    "planner_status": Loss(silent("planner"), 1.0, "LAND", BOTH),
    "planner_idle": Loss(planner_says_nothing_is_flown, 1.2, "LAND", BOTH),
    "landing_stalled": Loss(planner_lands_and_it_stands, 0.5, "LAND", BOTH),
    "planner_failed": Loss(planner_failed, 0.2, "LAND", BOTH),
    "autopilot_status": Loss(silent("autopilot"), 1.0, "LAND", BOTH, alarm=True),
    "vehicle_unknown": Loss(says(armed=None, landed=ev.VehicleLanded.UNKNOWN), 5.0, "LAND", BOTH, alarm=True),
    "clock": Loss(lambda story: story.feed(ev.ClockStatus, stalled_s=1.01), 0.0, "LAND", BOTH),
    "battery_unknown": Loss(says(battery_fraction=nan), 10.0, "LAND", ONE),
    "battery_critical": Loss(says(battery_fraction=0.15), 0.0, "LAND", ONE),
    "flight_time": Loss(flight_time, 0.3, "LAND", ONE),
    "distance": Loss(says(position_x_m=80.0, position_y_m=-60.1), 0.0, "LAND", ONE),
    "tilt_warning": Loss(says(tilt_deg=45.1), 0.0, "CONTINUE"),
    "position_unknown": Loss(says(position_x_m=nan), 10.0, "CONTINUE"),
    "recorder_dead": Loss(recorder_failed, 0.2, "CONTINUE"),
    "landing_detection": Loss(silent("landing"), 1.0, "CONTINUE"),
    **{name: Loss(says(**{bound.field: at_bound(bound, 0.001)}), 0.0, "LAND", ONE) for name, bound in BOUNDS.items()},
}
"""Heartbeat -> land; planner, a landing that stands in the air, clock -> both routes; autopilot, vehicle unknown ->
both, alarm; battery unknown or critical, flight time, distance -> land, and so do the bounds of the laws; tilt beyond
the warning, position unknown, recorder dead, landing detection silent -> continue, warned."""


def test_the_table_has_these_rows_and_no_others():
    shipped = {
        row.name: (row.action.name, ("LAND", "AutopilotLand") if row.both_routes else ("LAND",), row.alarm)
        for row in FAILSAFE_CONDITIONS
    }
    assert shipped == {name: (row.action, row.motions or ONE, row.alarm) for name, row in EXPECTED.items()}


def _patient(place: str) -> Story:
    """Return a story at a place that does not leave it by itself for long enough."""
    story = at(place)
    limits = story.rules.limits
    story.rules = replace(
        story.rules,
        limits=replace(
            limits,
            hold_confirm_limit_ns=60 * S,
            hold_repeat_after_ns=60 * S,
            resume_confirm_limit_ns=60 * S,
            takeoff_limit_ns=90 * S,
        ),
    )
    story.planner.flown_ns = -60 * S
    if place == "TAKEOFF climbing":
        story.vehicle.speed = 0.0
    return story


@pytest.mark.parametrize("place", AIRBORNE)
@pytest.mark.parametrize("name", EXPECTED)
def test_lost_in_flight(name, place):
    row = EXPECTED[name]
    story = _patient(place)
    row.happens(story)
    story.after(row.limit_s + 0.25)
    failure = story.failure(name)
    assert failure is not None
    assert failure.action.name == row.action
    if row.action == "CONTINUE":
        state, _, step = place.partition(" ")
        story.expect(state, step.replace(" takeoff", ""))
        assert (story.motions, story.told[:1]) == ([], ["failure_continue"])
    else:
        assert story.place[0] == "LAND"
        assert story.motions[: len(row.motions)] == list(row.motions)
        assert ("AutopilotLand" in story.motions) == (row.motions == BOTH)
        alarms = [c.key for c in story.since if isinstance(c, Notify) and c.level is Level.ALARM]
        assert alarms == (["autopilot_lost"] if row.alarm else [])


@pytest.mark.parametrize("place", AIRBORNE)
@pytest.mark.parametrize("landed", [each for each in ev.VehicleLanded if each is not ev.VehicleLanded.ON_GROUND])
def test_a_vehicle_that_says_that_it_is_disarmed_in_the_air_is_landed_for_and_the_pilot_is_alarmed(landed, place):
    story = _patient(place)
    story.say(armed=False, landed=landed)
    story.after(4.9)
    assert story.place[0] != "LAND"
    story.after(0.35).expect("LAND")
    assert (story.motions[:2], "autopilot_lost" in story.told) == (["LAND", "AutopilotLand"], True)


def test_a_landing_for_a_vehicle_that_says_that_it_is_disarmed_in_the_air_ends_by_a_person_after_half_a_minute():
    story = at("LAND descending")
    story.vehicle.speed = 0.0
    story.say(armed=False, landed=ev.VehicleLanded.IN_AIR)
    story.after(29.9)
    assert ("autopilot_lost" in story.told, story.user("acknowledge")[0]) == (True, "REFUSED")
    story.expect("LAND").after(0.2)
    assert story.user("acknowledge")[0] == "DONE"
    story.expect("DATA_CLEANUP")


def test_disarmed_just_before_it_says_that_it_stands_on_the_ground_alarms_nobody():
    story = at("LAND descending")
    story.say(armed=False)
    story.after(3.0)
    story.say(landed=ev.VehicleLanded.ON_GROUND)
    story.until("DATA_CLEANUP")
    assert "autopilot_lost" not in story.told


@pytest.mark.parametrize("unknown", ["height_m", "position_x_m", "position_y_m", "tilt_deg"])
def test_each_value_that_has_a_limit_is_missed_when_it_is_not_known(unknown):
    story = _patient("MISSION flying")
    story.say(**{unknown: None})
    story.after(10.25).expect("MISSION", "flying")
    assert story.failure("position_unknown") is not None


@pytest.mark.parametrize("place", LANDING)
@pytest.mark.parametrize("name", EXPECTED)
def test_lost_while_landing_goes_on_landing(name, place):
    row = EXPECTED[name]
    story = at(place)
    story.vehicle.speed = 0.0
    row.happens(story)
    story.after(row.limit_s + 0.25).expect("LAND")
    assert not {"HOLD", "RESUME", "TAKEOFF", "ABORT", "AutopilotDisarm"} & set(story.motions)
    assert ("AutopilotLand" in story.motions) == (
        row.motions == BOTH or (place == "LAND commanding" and row.limit_s > 2)
    )


@pytest.mark.parametrize("name", EXPECTED)
def test_lost_while_the_pilot_flies_commands_nothing(name):
    row = EXPECTED[name]
    story = at("PILOT")
    row.happens(story)
    story.after(row.limit_s + 0.5).expect("PILOT")
    assert story.motions == []
    assert "failure_land" not in story.told, "it does not say that it lands"


@pytest.mark.parametrize("place", ["READY", "START_RECORDING", "LOAD_MISSION"])
def test_heartbeat_lost_before_takeoff_takes_ready_back(place):
    story = at(place)
    story.silent.append("watchdog")
    story.check_says["watchdog"] = {"ok": False}
    story.after(0.9).expect("OUTREACH")
    assert story.rules_fired[:2] == ["ready_revoked", "checks_failed"]
    assert story.motions == []


def test_heartbeat_lost_between_two_files_ends_the_mission():
    story = at("MISSION touchdown")
    story.silent.append("watchdog")
    story.after(0.9).expect("DATA_CLEANUP")
    assert story.motions == []


@pytest.mark.parametrize("name", BOUNDS)
def test_a_bound_is_kept_at_its_limit_and_landed_for_beyond_it(name):
    bound = BOUNDS[name]
    story = at("MISSION flying")
    story.say(**{bound.field: at_bound(bound)})
    story.expect("MISSION", "flying")
    story.say(**{bound.field: at_bound(bound, 0.001)}).expect("LAND")
    assert story.failure(name) is not None


# --- the limits -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "stream, limit_s",
    [("watchdog", 0.6), ("planner", 1.0), ("autopilot", 1.0)],
)
def test_a_stream_may_be_silent_up_to_its_limit(stream, limit_s):
    story = at("MISSION flying")
    story.until("MISSION", "flying")
    story.after_ns(-story.now % (S // 5))  # the statuses of this very moment are the last
    story.silent.append(stream)
    story.after(limit_s).expect("MISSION", "flying")
    story.after_ns(1).expect("LAND")


def test_the_heartbeat_counts_from_the_accepted_start():
    """A watchdog that is not started yet is not missed."""
    story = Story().start()
    story.silent.append("watchdog")
    story.after(20.0).expect("MISSION_INPUT")
    story.select().after(0.5).expect("START_RECORDING")
    story.after(0.2)
    assert "ready_revoked" in story.rules_fired


def test_a_loop_counter_that_stands_still_is_no_heartbeat():
    story = at("MISSION flying")
    story.watchdog.stuck = True
    story.after(0.85).expect("LAND")
    assert story.failure("watchdog_heartbeat") is not None
    assert story.motions[0] == "LAND"


@pytest.mark.parametrize("link_age_s", [3.1, nan, inf, -inf, None, -5.0, 1e300, -1e300])
def test_a_link_that_is_old_or_unknown_is_a_lost_autopilot(link_age_s):
    story = at("MISSION flying")
    story.say(link_age_s=link_age_s)
    assert (story.place[0], story.motions[:2]) == ("LAND", ["LAND", "AutopilotLand"])
    assert "autopilot_lost" in story.told


@pytest.mark.parametrize("link_age_s", [0.0, 2.9, -0.1])
def test_a_link_that_is_young_enough_is_not(link_age_s):
    story = at("MISSION flying")
    story.say(link_age_s=link_age_s)
    story.expect("MISSION", "flying")


def test_the_link_gets_old_between_two_statuses():
    story = at("MISSION flying")
    story.rules = replace(story.rules, limits=replace(story.rules.limits, autopilot_status_limit_ns=60 * S))
    story.say(link_age_s=2.5)
    story.silent.append("autopilot")
    story.after_ns(S // 2).expect("MISSION", "flying")
    story.after_ns(1).expect("LAND")


@pytest.mark.parametrize("claims", [{"battery_age_s": 100.0}, {"battery_age_s": None}, {"battery_age_s": -5.0}])
def test_a_battery_level_without_a_credible_age_is_unknown(claims):
    story = _patient("MISSION flying")
    story.say(**claims).until("LAND", limit_s=10.3)
    assert story.rules_fired[:2] == ["failure_land", "land"]


@pytest.mark.parametrize("fraction", [0.87, None])
def test_a_battery_that_the_autopilot_calls_critical_lands_whatever_its_level(fraction):
    """ArduPilot counts its level from the current alone: 9 V of three cells were 87 %, and it hovered on for 62 s."""
    story = at("MISSION flying")
    story.say(battery_critical=True, battery_fraction=fraction).expect("LAND")
    assert story.rules_fired[:2] == ["failure_land", "land"]


@pytest.mark.parametrize("fraction", [-0.53, 1.5, nan, inf, None])
def test_an_impossible_battery_level_is_unknown_and_not_critical(fraction):
    story = _patient("MISSION flying")
    story.say(battery_fraction=fraction)
    story.after(9.0).expect("MISSION", "flying")
    story.after(1.5).expect("LAND")
    assert story.failure("battery_unknown") is not None


@pytest.mark.parametrize("fraction, lands", [(0.150001, False), (0.15, True), (0.0, True)])
def test_critical_is_at_the_limit_and_below(fraction, lands):
    story = at("MISSION flying")
    story.say(battery_fraction=fraction)
    assert story.is_in("LAND") == lands


@pytest.mark.parametrize(
    "tilt_deg, lands, warns", [(45.0, 0, 0), (45.1, 0, 1), (70.0, 0, 1), (70.1, 1, 1), (nan, 0, 0), (180.1, 0, 0)]
)
def test_a_tilt_warns_above_the_one_limit_and_lands_above_the_other(tilt_deg, lands, warns):
    story = at("MISSION flying")
    story.say(tilt_deg=tilt_deg)
    assert (story.is_in("LAND"), story.failure("tilt_warning") is not None) == (lands, warns)


def test_a_tilt_of_180_deg_as_its_limit_is_never():
    story = at("MISSION flying")
    never = replace(story.rules.limits, max_tilt_deg=180.0, tilt_warning_deg=180.0)
    story.rules = replace(story.rules, limits=never)
    story.say(tilt_deg=180.0).expect("MISSION", "flying")
    assert story.state.failures == ()


def test_a_vehicle_that_leans_once_is_warned_of_and_flies_to_its_end():
    story = at("MISSION flying")
    story.say(tilt_deg=50.0).expect("MISSION", "flying")
    assert story.told == ["failure_continue"]
    story.say(tilt_deg=3.0)
    assert (story.told, story.state.failures) == (["failure_continue", "condition_cleared"], ())
    story.until("MISSION_ENDED")
    assert (story.motions, story.state.session.result.value) == ([], "COMPLETE")


def test_a_vehicle_that_falls_over_is_landed_and_its_data_is_collected():
    story = at("MISSION flying")
    story.say(tilt_deg=88.0).expect("LAND")
    assert "tilt 88.0 deg, limit 70.0" in story.failure("tilt").reason
    assert (story.told[0], "failure_continue" in story.told) == ("failure_while_landing", False)
    story.say(tilt_deg=5.0).expect("LAND")
    story.until("MISSION_ENDED")
    assert not {"HOLD", "RESUME"} & set(story.motions)
    assert story.state.session.result.value == "LANDED_EARLY"


def test_flight_time_counts_from_the_takeoff_command():
    mission = Mission(id="1", max_flight_time_ns=5 * S)
    story = Story(SHIPPED, mission).start().after(0.5).select().until("TAKEOFF")
    story.after_ns(5 * S - 1).expect("MISSION", "flying")
    story.after_ns(1).expect("LAND")
    assert story.failure("flight_time") is not None


@pytest.mark.parametrize(
    "mission, claims",
    [
        (Mission(id="1", max_height_m=3.0), {"height_m": 3.01}),
        (Mission(id="1", max_distance_m=4.0), {"position_x_m": 0.0, "position_y_m": -4.01}),
    ],
)
def test_a_mission_has_its_own_limits(mission, claims):
    story = Story(SHIPPED, mission).start().after(0.5).select().until("MISSION", "flying").look()
    story.say(**{key: value - 0.02 if value > 0 else value + 0.02 for key, value in claims.items()})
    story.expect("MISSION", "flying")
    story.say(**claims).expect("LAND")


def test_the_recorder_dead_in_flight_only_warns_and_the_mission_ends():
    story = at("MISSION flying")
    story.recorder.phase = ev.RecordingPhase.FAILED
    story.recorder.fails = True
    story.until("DATA_CLEANUP")
    assert story.motions == []
    assert story.state.session.result.value == "COMPLETE"
    story.until("OUTREACH")
    assert "data_incomplete" in story.told


@pytest.mark.parametrize("happens", [recorder_failed, recorder_does_not_grow, silent("recorder")])
def test_a_recorder_that_does_not_record_only_warns(happens):
    story = _patient("MISSION flying")
    happens(story)
    story.after(5.5).expect("MISSION", "flying")
    assert (story.motions, story.told) == ([], ["failure_continue"])
    assert story.failure("recorder_dead").action.name == "CONTINUE"


def test_what_is_lost_and_comes_back_does_not_end_a_landing():
    story = at("MISSION flying")
    story.silent.append("planner")
    story.until("LAND")
    story.silent.clear()
    story.until("MISSION_ENDED")
    assert not {"HOLD", "RESUME"} & set(story.motions)
    assert story.state.session.result.value == "LANDED_EARLY"


def test_the_land_command_comes_before_every_message():
    story = at("MISSION flying")
    story.silent.append("autopilot")
    story.until("LAND")
    assert [type(c).__name__ for c in story.since][:2] == ["MissionCommand", "AutopilotLand"]


def test_commands_go_out_by_how_much_a_vehicle_needs_them():
    asked = {"id": 1, "limit_ns": S}
    commands = [
        MissionCommand(**asked, session_id="s", action=MissionAction.LAND),
        AutopilotLand(**asked),
        AutopilotDisarm(**asked),
        MissionCommand(**asked, session_id="s", action=MissionAction.HOLD),
        StopRecording(**asked, session_id="s"),
        Answer(request_id=1, answer=AnswerKind.DONE),
        Notify(level=Level.INFO, key="x", text="x"),
    ]
    backwards = list(reversed(commands))
    assert sorted(backwards, key=_rank) == commands


def test_one_status_in_the_air_is_no_takeoff_where_nothing_says_so_again():
    """The whole mission would be flown with nobody who minds that it is not known whether it flies."""
    story = at("TAKEOFF lifting_off")
    story.vehicle.take_off()
    story.vehicle.height = 2.0
    story.say(landed=ev.VehicleLanded.IN_AIR).expect("TAKEOFF", "climbing")
    story.say(landed=ev.VehicleLanded.UNKNOWN).after(5.0).expect("TAKEOFF", "climbing")
    story.until("LAND", limit_s=60.0)


def _lands_by_planner(**says: object) -> Story:
    """Return a story whose planner says that it lands, for two seconds so far."""
    story = at("MISSION flying")
    story.rules = replace(story.rules, limits=replace(story.rules.limits, landing_stall_limit_ns=3 * S))
    story.planner.says["phase"] = ev.MissionPhase.LANDING
    story.say(**says).after(2.9).expect("MISSION")
    return story


@pytest.mark.parametrize("mode", ["AUTO.MISSION", "AUTO.LAND"])
@pytest.mark.parametrize("climb_m_s", [0.0, 3.0])
def test_a_landing_of_the_planners_that_stands_or_climbs_is_landed_for(mode, climb_m_s):
    story = _lands_by_planner(mode=mode, vertical_speed_m_s=climb_m_s)
    story.after(0.5).expect("LAND")
    assert story.motions[:2] == ["LAND", "AutopilotLand"]


@pytest.mark.parametrize("speeds", [{"horizontal_speed_m_s": 2.0}, {"vertical_speed_m_s": -0.4}])
def test_a_landing_of_the_planners_that_moves_on_or_sinks_is_left_to_it(speeds):
    _lands_by_planner(mode="AUTO.MISSION", **speeds).after(2.0).expect("MISSION")


@pytest.mark.parametrize("speeds", [{"horizontal_speed_m_s": 2.0}, {"vertical_speed_m_s": -0.4}])
def test_a_gust_begins_the_wait_for_a_landing_that_stands_no_second_time(speeds):
    story = _lands_by_planner(mode="AUTO.MISSION")
    still = dict.fromkeys(speeds, 0.0)
    story.rules = replace(story.rules, limits=replace(story.rules.limits, landing_stall_limit_ns=5 * S))
    story.vehicle.says.update(speeds)
    story.after(0.6)
    story.vehicle.says.update(still)
    story.after(1.0).expect("MISSION")
    story.after(1.0).expect("LAND")


def test_nor_do_gusts_where_it_climbs():
    story = _lands_by_planner(mode="AUTO.MISSION", vertical_speed_m_s=3.0)
    story.rules = replace(story.rules, limits=replace(story.rules.limits, landing_stall_limit_ns=5 * S))
    story.vehicle.says.update(horizontal_speed_m_s=0.6)
    story.after(0.2)
    story.vehicle.says.update(horizontal_speed_m_s=0.1)
    story.after(2.2).expect("LAND")
