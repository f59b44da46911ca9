"""What comes late, twice, from elsewhere, from the past, from the future, or as nonsense, changes no decision."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import S
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.events import Check, CheckName, Verdict
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.engine.state import evolve

REFUSED, ACCEPTED = ev.Outcome.REFUSED, ev.Outcome.ACCEPTED


def unchanged(story: Story, before) -> bool:
    return evolve(story.state, t_ns=0) == evolve(before, t_ns=0)


# --- replies ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", BEGINNINGS)
@pytest.mark.parametrize("identity", [-1, 1, 999_999])
def test_a_reply_to_nothing_that_is_open_changes_nothing(place, identity):
    story = at(place)
    before = story.state
    story.feed(ev.Reply, command_id=identity, outcome=REFUSED)
    for check in CheckName:
        story.feed(ev.CheckReply, command_id=identity, check=check, outcome=ACCEPTED, ok=False)
    assert unchanged(story, before)
    assert story.since == []


def test_a_late_refusal_of_an_earlier_command_changes_nothing():
    """The TAKEOFF's refusal comes when the hold is on its way."""
    story = at("MISSION flying")
    takeoff_id = story.state.flight.motion.id
    story.user("hold")
    story.feed(ev.Reply, command_id=takeoff_id, outcome=REFUSED)
    story.expect("HOLD", "confirming").until("HOLD", "holding")


def test_a_duplicated_reply_changes_nothing():
    story = at("HOLD confirming")
    for _ in range(3):
        story.feed(ev.Reply, command_id=story.state.flight.motion.id, outcome=ACCEPTED)
    story.expect("HOLD", "confirming")
    assert story.since == []


def test_a_duplicated_refusal_of_a_landing_lands_on():
    story = at("LAND commanding")
    for _ in range(3):
        story.feed(ev.Reply, command_id=story.state.flight.motion.id, outcome=REFUSED)
    story.expect("LAND", "commanding").after(4.0)
    assert "AutopilotLand" in story.motions


@pytest.mark.parametrize("outcome", [ev.Outcome.TIMED_OUT, ev.Outcome.BROKEN])
@pytest.mark.parametrize(
    "command, place", [("HOLD", "HOLD holding"), ("RESUME", "MISSION flying"), ("LAND", "LAND descending")]
)
def test_an_unclear_answer_waits_for_what_the_state_says(command, place, outcome):
    """Level, not edge: the planner holds, although its answer was lost."""
    story = at("HOLD resuming" if command == "RESUME" else "MISSION flying")
    story.disobeyed.clear()
    story.answers[command] = outcome
    if command == "RESUME":
        story.user("hold")
        story.until("HOLD", "holding")
    story.user(command.lower())
    story.later(S // 10, "_effect", next(c for _, c in reversed(story.sent) if type(c).__name__ == "MissionCommand"))
    state, _, step = place.partition(" ")
    story.until(state, step, limit_s=2.0)


def test_accepted_alone_is_no_hold():
    story = at("HOLD confirming")
    story.feed(ev.Reply, command_id=story.state.flight.motion.id, outcome=ACCEPTED)
    story.after(3.0).expect("LAND")


def test_a_check_reply_that_comes_twice_counts_once():
    story = at("PREFLIGHT")
    record = next(r for r in story.state.preflight.checks if r.check is CheckName.ON_GROUND)
    assert record.ok
    story.feed(ev.CheckReply, command_id=record.command_id, check=CheckName.ON_GROUND, outcome=ACCEPTED, ok=False)
    assert next(r for r in story.state.preflight.checks if r.check is CheckName.ON_GROUND).ok


def test_a_check_reply_that_comes_too_late_is_dropped():
    story = at("PREFLIGHT")
    record = next(r for r in story.state.preflight.checks if r.check is CheckName.BATTERY)
    story.after(3.0).expect("OUTREACH")
    before = story.state
    story.feed(ev.CheckReply, command_id=record.command_id, check=CheckName.BATTERY, outcome=ACCEPTED, ok=True)
    assert unchanged(story, before)


def test_a_check_reply_of_the_round_before_is_dropped():
    story = at("PREFLIGHT")
    old = next(r for r in story.state.preflight.checks if r.check is CheckName.BATTERY)
    story.after(3.0).expect("OUTREACH")
    story.user("retry")
    story.feed(ev.CheckReply, command_id=old.command_id, check=CheckName.BATTERY, outcome=ACCEPTED, ok=True)
    story.after(0.3).expect("PREFLIGHT")


def test_a_check_reply_with_the_id_of_another_check_is_dropped():
    story = at("PREFLIGHT")
    battery = next(r for r in story.state.preflight.checks if r.check is CheckName.BATTERY)
    story.feed(ev.CheckReply, command_id=battery.command_id, check=CheckName.ON_GROUND, outcome=ACCEPTED, ok=True)
    story.after(0.3).expect("PREFLIGHT")


@pytest.mark.parametrize("verdict", [Verdict.FAIL, Verdict.UNKNOWN])
def test_ok_is_believed_only_when_every_row_passed(verdict):
    story = at("MISSION_INPUT").after(11.0)  # while the stack starts, what was never heard is waited for
    story.answers["check:battery"] = None
    story.select().after(0.3)
    battery = next(r for r in story.state.preflight.checks if r.check is CheckName.BATTERY)
    rows = (Check(name="fraction", verdict=Verdict.PASS), Check(name="cell voltage", verdict=verdict, value=nan))
    story.feed(
        ev.CheckReply,
        command_id=battery.command_id,
        check=CheckName.BATTERY,
        outcome=ACCEPTED,
        ok=True,
        checks=rows,
    )
    story.expect("OUTREACH")


@pytest.mark.parametrize("outcome", [o for o in ev.Outcome if o is not ACCEPTED])
@pytest.mark.parametrize("check", CheckName)
def test_a_check_that_is_not_answered_is_not_passed(check, outcome):
    story = at("MISSION_INPUT")
    story.check_says[check.value] = {"outcome": outcome, "ok": True, "checks": ()}
    story.select().after(0.5).expect("PREFLIGHT" if outcome is ev.Outcome.UNAVAILABLE else "OUTREACH")
    story.until("OUTREACH", limit_s=12.0)  # a node that is not there yet may still be starting
    assert story.motions == []


@pytest.mark.parametrize("since_start_ns, place", [(0, "PREFLIGHT"), (10 * S - 1, "PREFLIGHT"), (10 * S, "OUTREACH")])
def test_a_node_may_be_starting_from_the_engines_own_start_as_long_as_the_watchdog_may(since_start_ns, place):
    story = at("MISSION_INPUT")
    story.answers["check:battery"] = None
    story.select().after(0.3)
    battery = next(r for r in story.state.preflight.checks if r.check is CheckName.BATTERY)
    story.state = evolve(story.state, started_ns=story.now - since_start_ns)
    story.feed(
        ev.CheckReply, command_id=battery.command_id, check=CheckName.BATTERY, outcome=ev.Outcome.UNAVAILABLE, ok=False
    )
    story.expect(place)


# --- sessions ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("session", ["", "test-000", "other"])
def test_complete_of_another_session_ends_nothing(session):
    story = at("DATA_CLEANUP")
    story.feed(ev.RecordingStatus, session_id=session, phase=ev.RecordingPhase.COMPLETE)
    story.expect("DATA_CLEANUP")


@pytest.mark.parametrize("session", ["", "test-000", "other"])
def test_a_planner_of_another_session_confirms_nothing(session):
    story = at("HOLD confirming")
    story.silent.append("planner")
    story.planner.says.update(session_id=session, phase=ev.MissionPhase.HOLDING)
    for _ in range(5):
        story.now += S // 10
        story._decide(story.planner.status(story.now))
    story.expect("HOLD", "confirming")
    story.after(1.5).expect("LAND")


def test_landed_of_the_last_mission_does_not_end_the_next():
    story = at("MISSION_ENDED")
    last = story.planner.session
    story.select().until("MISSION", "flying")
    story.planner.says.update(session_id=last, phase=ev.MissionPhase.LANDED, waypoint=3)
    story.report()
    story.expect("MISSION", "flying")
    assert story.state.session.id != last


def test_each_mission_start_has_its_own_session():
    story = at("MISSION_ENDED")
    first = story.state.session.id
    story.select()
    assert story.state.session.id not in ("", first)


# --- ages -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("age_ns", [S + 1, 10 * S, -S // 5 - 1, -100 * S])
def test_a_stale_or_future_status_is_no_sign_of_life(age_ns):
    story = at("MISSION flying")
    story.silent.append("planner")
    for _ in range(6):
        story.feed(ev.MissionStatus, **vars_of(story.planner.status(story.now), age_ns=age_ns))
        story.after(0.2)
    story.expect("LAND")


@pytest.mark.parametrize("age_ns", [S, -S // 5, 0])
def test_a_status_within_the_limits_is(age_ns):
    story = at("MISSION flying")
    story.planner.says["age_ns"] = age_ns
    story.vehicle.says["age_ns"] = age_ns
    story.after(2.0).expect("MISSION", "flying")


def vars_of(event: ev.Event, **changes):
    return {key: value for key, value in vars(replace(event, **changes)).items() if key != "t_ns"}


@pytest.mark.parametrize("age_ns", [S + 1, -S // 5 - 1])
def test_stale_or_future_says_nothing_of_the_vehicle(age_ns):
    story = at("LAND descending")
    said = story.vehicle.status(story.now)
    story.feed(
        ev.AutopilotStatus,
        **vars_of(said, age_ns=age_ns, armed=False, landed=ev.VehicleLanded.ON_GROUND),
    )
    story.expect("LAND")


@pytest.mark.parametrize("age_ns", [S + 1, -S // 5 - 1])
def test_a_stale_action_is_no_heartbeat_and_no_failure(age_ns):
    story = at("MISSION flying")
    status = ev.ComponentStatus("imu", Code.ABORT)
    story.feed(ev.WatchdogAction, sequence=9, loop_counter=999, code=Code.ABORT, components=(status,), age_ns=age_ns)
    story.expect("MISSION", "flying")
    assert story.motions == []


def test_time_that_runs_back_counts_as_now():
    story = at("MISSION flying")
    story.feed(ev.Tick, t_ns=0)
    assert story.state.t_ns == story.now
    story.feed(ev.WatchdogAction, t_ns=5, sequence=1, loop_counter=1, code=Code.ABORT, latest_component="imu")
    assert (story.place[0], story.motions, story.state.t_ns) == ("LAND", ["LAND"], story.now)


# --- watchdogs of old -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "code, name, place",
    [
        (16, "imu", "LAND"),
        (16, "", "LAND"),
        (8, "lrf", "HOLD"),
        (4, "realsense_camera", "HOLD"),
        (8, "", "HOLD"),
        (2, "gps", "MISSION"),
        (1, "", "MISSION"),
    ],
)
def test_a_legacy_watchdog_says_only_a_code_and_the_latest_component(code, name, place):
    story = at("MISSION flying")
    story.silent.append("watchdog")
    story.feed(ev.WatchdogAction, sequence=1, loop_counter=10_000, code=Code(code), latest_component=name)
    assert story.place[0] == place


def test_a_legacy_watchdog_takes_its_code_back():
    story = at("MISSION flying")
    story.silent.append("watchdog")
    for number, code in enumerate((8, 8, 1, 1, 1)):
        story.feed(
            ev.WatchdogAction, sequence=number, loop_counter=10_000 + number, code=Code(code), latest_component="lrf"
        )
        story.after(0.3)
    story.expect("MISSION", "flying")
    assert story.motions == ["HOLD", "RESUME"]


def test_a_code_that_the_list_does_not_explain_is_not_ignored():
    story = at("MISSION flying")
    listed = (ev.ComponentStatus("realsense_camera", Code.INCONVENIENT),)
    story.feed(
        ev.WatchdogAction, sequence=1, loop_counter=9999, code=Code.ABORT, latest_component="imu", components=listed
    )
    story.expect("LAND")
    assert [f.name for f in story.state.failures] == ["imu", "realsense_camera"]


def test_a_list_that_says_more_than_the_code_is_not_ignored():
    story = at("MISSION flying")
    listed = (ev.ComponentStatus("imu", Code.ABORT),)
    story.feed(ev.WatchdogAction, sequence=1, loop_counter=9999, code=Code.NOMINAL, components=listed)
    story.expect("LAND")


def test_a_code_that_is_milder_than_the_list_does_not_make_the_list_milder():
    story = at("MISSION flying")
    listed = (ev.ComponentStatus("magnetometer", Code.ABORT),)
    story.feed(
        ev.WatchdogAction,
        sequence=1,
        loop_counter=9999,
        code=Code.INCONVENIENT,
        latest_component="magnetometer",
        components=listed,
    )
    story.expect("LAND")


@pytest.mark.parametrize("codes", [(16, 1), (1, 16), (16, 2), (4, 16)])
def test_of_a_component_that_is_listed_twice_the_worst_counts(codes):
    story = at("MISSION flying")
    listed = tuple(ev.ComponentStatus("lrf", Code(code)) for code in codes)
    story.feed(ev.WatchdogAction, sequence=1, loop_counter=9999, code=Code.ABORT, components=listed)
    story.expect("LAND")
    assert [f.name for f in story.state.failures] == ["lrf"]


def test_one_lost_message_loses_nothing():
    """Level-based: the next heartbeat says the same."""
    story = at("MISSION flying")
    story.fail("lrf", 8, tell=False).after(0.25).expect("HOLD")


def test_a_component_of_the_info_stream_at_code_2_is_shown_and_flown_with():
    story = at("MISSION flying")
    story.fail("gps", 2)
    assert (story.told, story.failure("gps").action.name) == (["failure_continue"], "CONTINUE")
    story.back("gps")
    assert story.failure("gps") is None


# --- unknown and nonsense ---------------------------------------------------------------------------------------------

NUMBERS = (
    "height_m",
    "position_x_m",
    "position_y_m",
    "vertical_speed_m_s",
    "horizontal_speed_m_s",
    "battery_voltage_v",
    "battery_fraction",
)
AGES = ("link_age_s", "battery_age_s")


@pytest.mark.parametrize("place", BEGINNINGS)
@pytest.mark.parametrize("value", [nan, inf, -inf, None, 1e308, -1e308])
def test_nonsense_everywhere_in_the_autopilots_status_is_survived(place, value):
    story = at(place)
    was = story.place
    story.say(**dict.fromkeys((*NUMBERS, *AGES), value))
    story.after(0.4)
    assert "TAKEOFF" not in story.motions
    if was[0] in ("TAKEOFF", "MISSION", "HOLD", "LAND") and was[1] != "touchdown":
        story.expect("LAND")


@pytest.mark.parametrize("value", [nan, inf, -inf, None])
def test_unknown_height_in_the_climb_is_not_takeoff_height(value):
    story = at("TAKEOFF climbing")
    story.say(height_m=value)
    story.after(9.0).expect("TAKEOFF", "climbing")


@pytest.mark.parametrize("claims", [{"armed": None}, {"landed": ev.VehicleLanded.UNKNOWN}, {"armed": None, "mode": ""}])
@pytest.mark.parametrize("place", ["MISSION flying", "HOLD holding", "LAND descending"])
def test_unknown_is_still_in_flight(place, claims):
    story = at(place)
    story.say(**claims)
    story.after(0.5)
    assert story.state.flight.active
    assert story.place[0] == place.split()[0]


@pytest.mark.parametrize("claims", [{"armed": None}, {"landed": ev.VehicleLanded.UNKNOWN}])
def test_unknown_is_not_landed(claims):
    story = at("LAND descending")
    story.say(**claims)
    story.after(20.0).expect("LAND")


@pytest.mark.parametrize("phase", [ev.MissionPhase.IDLE, ev.MissionPhase.LOADED])
def test_a_planner_that_lost_its_mission_in_flight_does_not_hold_up_a_landing(phase):
    story = at("MISSION flying")
    story.planner.says["phase"] = phase
    story.fail("imu", 16).expect("LAND")
    story.until("MISSION_ENDED")
