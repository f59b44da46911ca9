"""Every wait runs out: not a nanosecond before its limit, and then into its named next state. None is unbounded."""

from __future__ import annotations

from dataclasses import replace
from typing import Callable, NamedTuple, Optional

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import S
from engine_story import Story

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine import timers
from amaze_autonomy.engine.context import Context
from amaze_autonomy.engine.failsafe import values_of
from amaze_autonomy.engine.rules import Code, Restart
from amaze_autonomy.engine.state import EngineState, State, Step, evolve

FOR_A_PERSON = ("MISSION_INPUT", "OUTREACH", "PILOT", "MISSION_ENDED")


class Wait(NamedTuple):
    """One wait: where, since when (ns), how long (s), and the rule and the state when it has run out."""

    timer: str
    place: str
    since: Callable[[Story], int]
    limit_s: float
    rule: str
    leads: str
    prepare: Optional[Callable[[Story], object]] = None
    lost: bool = False  # silence of exactly the limit is not lost yet


def entered(story: Story) -> int:
    return story.state.entered_ns


def stepped(story: Story) -> int:
    return story.state.step_ns


def limits(**changes: int) -> Callable[[Story], object]:
    def prepare(story: Story) -> None:
        story.rules = replace(story.rules, limits=replace(story.rules.limits, **changes))

    return prepare


def silent(*streams: str) -> Callable[[Story], object]:
    return lambda story: story.silent.extend(streams)


def one_platform_only(story: Story) -> None:
    story.recorder.growing = (True, False)
    story.report()


def on_ground_armed(story: Story) -> None:
    story.vehicle.auto_disarm = False
    while story.state.flight.grounded_ns is None:
        story.after(0.1)


def says_armed(story: Story) -> None:
    story.vehicle.says["armed"] = True


def planner_idles(story: Story) -> None:
    story.planner.says["phase"] = ev.MissionPhase.LOADED
    story.report()


def landing_stalls(story: Story) -> None:
    flies_long(story)
    story.planner.says["phase"] = ev.MissionPhase.LANDING
    story.say(vertical_speed_m_s=0.1, horizontal_speed_m_s=0.2)
    story.report()


def put_down(story: Story) -> None:
    story.planner.says["phase"] = ev.MissionPhase.FLYING
    story.landing_says = ev.Landed.ON_GROUND
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND, height_m=0.0)
    while story.state.flight.active:
        story.after(0.1)


def flies_on(story: Story) -> None:
    story.say(mode="OFFBOARD", horizontal_speed_m_s=2.0)


def taken(story: Story) -> None:
    story.say(pilot_in_control=True)


def armed_once_and_silent(story: Story) -> None:
    """One status says that somebody has armed it, then no other one comes; meanwhile a component fails."""
    story.say(armed=True)
    story.silent.append("autopilot")
    story.fail("lrf", 8)


def flies_long(story: Story) -> None:
    story.planner.flown_ns = -2000 * S


def fixing(story: Story) -> None:
    story.check_says["watchdog"] = {"ok": False, "fixable": True}
    story.answers.clear()
    story.select().after(0.1).expect("PREFLIGHT")


def both(*prepares: Callable[[Story], object]) -> Callable[[Story], object]:
    return lambda story: [prepare(story) for prepare in prepares]


def never_armed(story: Story) -> None:
    story.answers["LAND"] = ev.Outcome.TIMED_OUT
    story.disobeyed.append("LAND")
    story.user("land")


WAITS = (
    Wait("check_reply_limit", "PREFLIGHT", entered, 3.0, "checks_failed", "OUTREACH"),
    Wait(
        "preflight_fix_poll",
        "MISSION_INPUT",
        lambda s: max(r.replied_ns for r in s.state.preflight.checks),
        1.0,
        "checks_repeated",
        "PREFLIGHT",
        fixing,
    ),
    Wait(
        "preflight_fix_limit",
        "MISSION_ENDED",
        lambda s: s.state.entered_ns,
        60.0,
        "checks_failed",
        "OUTREACH",
        both(limits(preflight_fix_poll_ns=100 * S), fixing),
    ),
    Wait(
        "check_max_age",
        "LOAD_MISSION",
        lambda s: min(r.replied_ns for r in s.state.preflight.checks),
        10.0,
        "checks_expired",
        "PREFLIGHT",
        limits(load_limit_ns=60 * S),
        lost=True,
    ),
    Wait("ready_limit", "READY", entered, 60.0, "ready_too_old", "PREFLIGHT"),
    Wait(
        "recording_lead",
        "START_RECORDING",
        lambda s: s.state.recording.since_ns,
        3.0,
        "recording_proven",
        "LOAD_MISSION",
    ),
    Wait(
        "recording_start_limit", "START_RECORDING", entered, 15.0, "recording_not_proven", "OUTREACH", one_platform_only
    ),
    Wait("load_limit", "LOAD_MISSION", entered, 10.0, "planner_silent", "OUTREACH"),
    Wait("arm_limit", "TAKEOFF arming", stepped, 10.0, "not_armed", "TAKEOFF"),
    Wait("lift_off_limit", "TAKEOFF lifting_off", stepped, 10.0, "no_lift_off", "TAKEOFF"),
    Wait(
        "takeoff_limit",
        "TAKEOFF climbing",
        stepped,
        30.0,
        "takeoff_height_not_reached",
        "LAND",
        lambda s: setattr(s.vehicle, "speed", 0.0),
    ),
    Wait("cancel_limit", "TAKEOFF cancelling", stepped, 10.0, "cancel_unconfirmed", "LAND"),
    Wait("hold_confirm_limit", "HOLD confirming", stepped, 3.0, "hold_unconfirmed", "LAND"),
    Wait("resume_confirm_limit", "HOLD resuming", stepped, 5.0, "resume_unconfirmed", "LAND"),
    Wait(
        "wait_limit",
        "MISSION flying",
        lambda s: s.failure("lrf").since_ns,
        5.0,
        "land",
        "LAND",
        lambda s: s.fail("lrf", 8),
    ),
    Wait("user_hold_limit", "HOLD holding", lambda s: s.state.flight.user_hold_ns, 120.0, "land", "LAND"),
    Wait("flight_time", "MISSION flying", lambda s: s.state.flight.started_ns, 900.0, "land", "LAND", flies_long),
    Wait(
        "watchdog_heartbeat_limit",
        "HOLD holding",
        lambda s: s.state.peers.heartbeat_ns,
        0.6,
        "land",
        "LAND",
        silent("watchdog"),
        lost=True,
    ),
    Wait(
        "planner_status_limit",
        "TAKEOFF climbing",
        lambda s: s.state.peers.planner_ns,
        1.0,
        "land_by_both_routes",
        "LAND",
        silent("planner"),
        lost=True,
    ),
    Wait(
        "autopilot_status_limit",
        "MISSION flying",
        lambda s: s.state.peers.autopilot_ns,
        1.0,
        "land_by_both_routes",
        "LAND",
        silent("autopilot"),
        lost=True,
    ),
    Wait(
        "autopilot_link_limit",
        "MISSION flying",
        lambda s: s.now,
        0.5,
        "land_by_both_routes",
        "LAND",
        both(lambda s: s.say(link_age_s=2.5), silent("autopilot")),
        lost=True,
    ),
    Wait(
        "battery_age_limit",
        "HOLD holding",
        lambda s: s.state.peers.battery_ns,
        10.0,
        "land",
        "LAND",
        lambda s: s.say(battery_fraction=None),
        lost=True,
    ),
    Wait(
        "planner_idle_limit",
        "MISSION flying",
        lambda s: s.state.peers.planner_idle_ns,
        1.0,
        "failure_land",
        "LAND",
        planner_idles,
        lost=True,
    ),
    Wait(
        "landing_stall_limit",
        "MISSION flying",
        lambda s: s.state.peers.landing_stalled_ns,
        60.0,
        "failure_land",
        "LAND",
        landing_stalls,
        lost=True,
    ),
    Wait(
        "vehicle_unknown_limit",
        "HOLD holding",
        lambda s: s.state.peers.vehicle_unknown_ns,
        5.0,
        "failure_land",
        "LAND",
        lambda s: s.say(armed=None),
        lost=True,
    ),
    Wait(
        "position_age_limit",
        "HOLD holding",
        lambda s: s.state.peers.position_ns,
        10.0,
        "failure_continue",
        "HOLD",
        lambda s: s.say(height_m=None),
        lost=True,
    ),
    Wait(
        "recorder_status_limit",
        "HOLD holding",
        lambda s: s.state.peers.recorder_ns,
        5.0,
        "failure_continue",
        "HOLD",
        silent("recorder"),
        lost=True,
    ),
    Wait(
        "landing_detection_limit",
        "HOLD holding",
        lambda s: s.state.peers.landing_ns,
        1.0,
        "failure_continue",
        "HOLD",
        silent("landing"),
        lost=True,
    ),
    Wait(
        "confirm_limit",
        "MISSION flying",
        lambda s: s.state.flight.grounded_ns,
        10.0,
        "landed_unexpectedly",
        "DATA_CLEANUP",
        put_down,
    ),
    Wait("hold_repeat_after", "HOLD confirming", stepped, 1.5, "hold_repeated", "HOLD"),
    Wait("moving", "HOLD holding", lambda s: s.state.vehicle.adrift_ns, 1.0, "hold_flown_on", "HOLD", flies_on),
    Wait(
        "pilot_confirm",
        "MISSION flying",
        lambda s: s.state.vehicle.takeover.since_ns,
        0.3,
        "pilot_took_over",
        "PILOT",
        taken,
    ),
    Wait(
        "takeover_silent",
        "READY",
        lambda s: s.state.peers.autopilot_ns,
        1.0,
        "ready_revoked",
        "PREFLIGHT",
        armed_once_and_silent,
        lost=True,
    ),
    Wait("land_repeat_period", "LAND commanding", lambda s: s.state.landing.sent_ns, 0.5, "land_repeat", "LAND"),
    Wait(
        "land_second_route_after",
        "LAND commanding",
        lambda s: s.state.landing.since_ns,
        3.0,
        "land_second_route",
        "LAND",
    ),
    Wait("land_alarm_after", "LAND commanding", lambda s: s.state.step_ns, 6.0, "land_alarm", "LAND"),
    Wait(
        "descent_time",
        "LAND commanding",
        lambda s: s.state.vehicle.descending_ns,
        1.0,
        "landing_shown",
        "LAND",
        lambda s: s.say(vertical_speed_m_s=-0.5),
    ),
    Wait("land_limit", "LAND commanding", lambda s: s.state.landing.since_ns, 120.0, "land_limit", "LAND"),
    Wait(
        "stays_armed",
        "LAND descending",
        lambda s: s.state.vehicle.spinning.since_ns,
        10.0,
        "stays_armed_alarm",
        "LAND",
        both(on_ground_armed, says_armed),
    ),
    Wait(
        "ground_disarm_after",
        "LAND descending",
        lambda s: s.state.flight.grounded_ns,
        4.0,
        "disarm_on_ground",
        "LAND",
        on_ground_armed,
    ),
    Wait(
        "never_armed",
        "TAKEOFF arming",
        lambda s: s.state.landing.since_ns,
        10.0,
        "cancelled_by_landing",
        "DATA_CLEANUP",
        never_armed,
    ),
    Wait(
        "recorder_silent",
        "DATA_CLEANUP",
        lambda s: max(s.state.peers.recorder_ns, s.state.entered_ns),
        5.0,
        "data_incomplete",
        "OUTREACH",
        silent("recorder"),
        lost=True,
    ),
    Wait("data_cleanup_limit", "DATA_CLEANUP", entered, 1800.0, "data_limit", "OUTREACH", lambda s: s.agenda.clear()),
)


@pytest.mark.parametrize("wait", WAITS, ids=[wait.timer for wait in WAITS])
def test_a_wait_runs_out_at_its_limit_and_not_before(wait):
    story = at(wait.place)
    if wait.prepare is not None:
        wait.prepare(story)
    story.look()
    end_ns = wait.since(story) + round(wait.limit_s * S) + (1 if wait.lost else 0)
    if end_ns - story.now > 600 * S:  # skip the middle: statuses of half an hour say nothing new
        story.silent += ["autopilot", "recorder"]
        limits(recorder_status_limit_ns=4000 * S, autopilot_status_limit_ns=4000 * S, autopilot_link_limit_ns=4000 * S)(
            story
        )
        limits(battery_age_limit_ns=4000 * S)(story)
    story.after_ns(end_ns - story.now - 1)
    assert wait.rule not in story.rules_fired, f"{story.place}"
    assert timers.next_deadline(story.state, story.rules) == end_ns, "the shell wakes the engine for it"
    story.after_ns(1)
    assert wait.rule in story.rules_fired, f"{story.place}: {story.rules_fired}"
    assert story.place[0] == wait.leads


def test_every_wait_of_the_engine_runs_out_here():
    assert sorted(wait.timer for wait in WAITS) == sorted(timer.name for timer in timers.TIMERS)


@pytest.mark.parametrize("place", ["PREFLIGHT", "READY", "DATA_CLEANUP"])
def test_the_engine_is_not_woken_for_a_silence_that_leaves_nothing_in_doubt(place):
    story = at(place)
    assert story.state.peers.autopilot_ns is not None
    assert timers.time_of("takeover_silent", story.state, story.rules) is None


# --- nothing waits for ever -------------------------------------------------------------------------------------------


def _ticked(state: EngineState, rules, limit: int):
    """Wake the engine at its own deadlines alone, as when every peer is dead."""
    for number in range(limit):
        deadline = timers.next_deadline(state, rules)
        if deadline is None:
            return state, number
        assert deadline > state.t_ns
        state, _ = engine.decide(state, ev.Tick(t_ns=deadline), rules)
        assert state.t_ns == deadline
    return state, limit


@pytest.mark.parametrize("place", BEGINNINGS)
def test_when_nobody_answers_it_ends_with_a_person(place):
    """In flight that is LAND: it stays, both routes repeat, and the pilot was alarmed."""
    story = at(place)
    state, number = _ticked(story.state, story.rules, 400)
    if number == 400:
        assert (state.state, state.landing.alarmed, state.landing.overdue_alarmed) == (State.LAND, True, True)
        assert state.t_ns - story.now > 150 * S, "it does not spin: 2 Hz"
    else:
        assert state.state.value in FOR_A_PERSON
        assert number < 50


@pytest.mark.parametrize(
    "place", [p for p in BEGINNINGS if p.split()[0] in ("TAKEOFF", "MISSION", "HOLD", "LAND") and "touch" not in p]
)
def test_when_everybody_falls_silent_and_the_ground_was_reached_it_ends_with_a_person(place):
    story = at(place)
    story.landing_says = ev.Landed.ON_GROUND
    story.report()
    story.say(armed=True).after(0.25)
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND, height_m=0.0).after(0.7)
    state, number = _ticked(story.state, story.rules, 400)
    assert state.state.value in FOR_A_PERSON, state.step
    assert number < 100


@pytest.mark.parametrize("place", BEGINNINGS)
def test_every_state_but_four_shows_a_deadline(place):
    story = at(place)
    shown = timers.state_deadline(story.state, story.rules)
    if story.place[0] in FOR_A_PERSON:
        assert shown is None
        assert timers.next_deadline(story.state, story.rules) is None
    else:
        assert shown is not None
        assert shown[1] > story.now


@pytest.mark.parametrize("who", ["the flight time", "the user"])
def test_a_landing_shows_the_time_by_which_it_must_be_down_and_not_that_of_the_flight(who):
    story = at("MISSION flying")
    story.vehicle.obeys = False
    if who == "the user":
        story.user("land")
    flown_ns = story.now - story.state.flight.started_ns
    limit_ns = flown_ns + (S // 5 if who == "the flight time" else 30 * S)
    story.rules = replace(story.rules, limits=replace(story.rules.limits, max_flight_time_ns=limit_ns))
    story.after(1.0).expect("LAND")
    name, at_ns = timers.state_deadline(story.state, story.rules)
    assert (name, at_ns > story.now) == ("land_limit", True)


@pytest.mark.parametrize(
    "place",
    ["TAKEOFF climbing", "MISSION flying", "HOLD holding", "HOLD confirming", "HOLD resuming", "LAND descending"],
)
def test_down_but_not_confirmed_still_has_a_deadline(place):
    story = at(place)
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND)
    story.expect(place.split()[0])
    assert timers.state_deadline(story.state, story.rules) is not None


AFTER_AN_HOUR = {
    "PREFLIGHT": "OUTREACH",
    "READY": "PREFLIGHT",
    "START_RECORDING": "PREFLIGHT",
    "LOAD_MISSION": "PREFLIGHT",
    "TAKEOFF arming": "LAND",
    "TAKEOFF lifting_off": "LAND",
    "TAKEOFF cancelling": "LAND",
    "TAKEOFF climbing": "LAND",
    "MISSION flying": "LAND",
    "MISSION touchdown": "DATA_CLEANUP",
    "HOLD confirming": "LAND",
    "HOLD holding": "LAND",
    "HOLD holding takeoff": "LAND",
    "HOLD resuming": "LAND",
    "LAND commanding": "LAND",
    "LAND descending": "LAND",
    "DATA_CLEANUP": "OUTREACH",
    "DATA_CLEANUP queued": "OUTREACH",
}


@pytest.mark.parametrize("place", BEGINNINGS)
def test_a_story_that_only_ticks_late_still_moves(place):
    """A shell that was busy for an hour gives one tick; what flies is landed by both routes then, or again."""
    story = at(place)
    before = story.place
    story.feed(ev.Tick, t_ns=story.now + 3600 * S)
    if before[0] in FOR_A_PERSON:
        assert (story.place, story.requests) == (before, [])
    elif AFTER_AN_HOUR[place] == "LAND":
        assert (story.place, story.requests) == (("LAND", "commanding"), ["LAND", "AutopilotLand"])
    else:
        assert story.place == (AFTER_AN_HOUR[place], "")


def test_ticks_that_come_too_often_do_nothing():
    for place in BEGINNINGS:
        story = at(place)
        story.feed(ev.Tick)
        story.look()
        for _ in range(5):
            assert story.feed(ev.Tick) == (), place


def test_there_is_a_beginning_for_every_state_and_step():
    seen = {at(place).place for place in BEGINNINGS}
    assert {state for state, _ in seen} == {state.value for state in State}
    assert {step for _, step in seen} == {step.value for step in Step}


@pytest.mark.parametrize("until_s, words", [(5.0, "waits at most (restart limit)"), (None, "waits at most")])
def test_a_decision_names_the_limit_by_which_a_wait_ends(until_s, words):
    story = at("MISSION flying").fail("lrf", 8, "trying")
    failure = story.failure("lrf")
    until_ns = None if until_s is None else story.now + round(until_s * S / 10)
    status = ev.ComponentStatus("lrf", Code(8), Restart.TRYING, until_ns=until_ns)
    state = evolve(story.state, peers=evolve(story.state.peers, components=(status,)))
    values = values_of(failure, Context(state, ev.Tick(t_ns=story.now), story.rules))
    assert words in [value.name for value in values]
