"""The process is told to end, and starts again: in every state. Nothing is sent twice, nothing takes off by itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Dict, NamedTuple, Tuple

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import MISSION, SHIPPED, S
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.events import Mission, MissionPhase, VehicleLanded
from amaze_autonomy.engine.failsafe import wait_limit_ns
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.engine.state import evolve

BOTH = ("LAND", "AutopilotLand")


class End(NamedTuple):
    """Where the engine is right after it was told to end, and what it sent."""

    place: str
    requests: Tuple[str, ...] = ()


_STOP = ("StopRecording",)
TOLD_TO_END: Dict[str, End] = {
    "MISSION_INPUT": End("MISSION_INPUT"),
    "PREFLIGHT": End("MISSION_INPUT"),
    "OUTREACH": End("MISSION_INPUT"),
    "OUTREACH recorded": End("DATA_CLEANUP", _STOP),
    "OUTREACH data": End("OUTREACH"),
    "OUTREACH data queued": End("OUTREACH"),
    "READY": End("MISSION_INPUT"),
    "START_RECORDING": End("DATA_CLEANUP", _STOP),
    "LOAD_MISSION": End("DATA_CLEANUP", _STOP),
    "TAKEOFF arming": End("LAND descending", BOTH),
    "TAKEOFF lifting_off": End("LAND commanding", BOTH),
    "TAKEOFF cancelling": End("LAND commanding", BOTH),
    "TAKEOFF climbing": End("LAND commanding", BOTH),
    "MISSION flying": End("LAND commanding", BOTH),
    "MISSION touchdown": End("DATA_CLEANUP", _STOP),
    "HOLD confirming": End("LAND commanding", BOTH),
    "HOLD holding": End("LAND commanding", BOTH),
    "HOLD holding takeoff": End("LAND commanding", BOTH),
    "HOLD resuming": End("LAND commanding", BOTH),
    "LAND commanding": End("LAND commanding", BOTH),
    "LAND descending": End("LAND descending", BOTH),
    "PILOT": End("PILOT"),
    "PILOT landed": End("PILOT"),
    "DATA_CLEANUP": End("DATA_CLEANUP"),
    "DATA_CLEANUP queued": End("DATA_CLEANUP"),
    "MISSION_ENDED": End("MISSION_ENDED"),
}


@pytest.mark.parametrize("signal", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("place", TOLD_TO_END)
def test_told_to_end(place, signal):
    story, expected = at(place), TOLD_TO_END[place]
    story.feed(ev.Shutdown, signal=signal)
    state, _, step = expected.place.partition(" ")
    story.expect(state, step)
    assert tuple(story.requests) == expected.requests
    assert story.state.shutting_down
    if expected.requests == BOTH:
        assert any(signal in c.text for c in story.since if getattr(c, "key", "") == "shutdown")
        assert type(story.since[0]).__name__ == "MissionCommand"


def test_every_place_was_told_to_end():
    assert sorted(TOLD_TO_END) == sorted(BEGINNINGS)


@pytest.mark.parametrize("place", BEGINNINGS)
def test_after_it_was_told_to_end_nothing_takes_off(place):
    story = at(place)
    story.disobeyed.clear()
    story.answers.clear()
    story.feed(ev.Shutdown)
    story.look().after(30.0)
    assert not {"TAKEOFF", "HOLD", "RESUME"} & set(story.motions)
    assert "StartRecording" not in story.requests


def test_the_next_mission_does_not_begin_after_it_was_told_to_end():
    story = Story(SHIPPED, MISSION, Mission(id="2")).start().after(0.5).select().until("DATA_CLEANUP")
    story.feed(ev.Shutdown)
    story.until("MISSION_ENDED").after(5.0).expect("MISSION_ENDED")
    assert story.requests.count("StartRecording") == 1


@pytest.mark.parametrize("place", ["OUTREACH data", "DATA_CLEANUP", "MISSION_ENDED"])
def test_the_result_of_a_flight_is_not_changed_by_the_end_of_the_process(place):
    story = at(place)
    before = story.state.session.result
    story.feed(ev.Shutdown)
    assert story.state.session.result is before


def test_told_twice_lands_on():
    story = at("MISSION flying")
    story.feed(ev.Shutdown)
    story.feed(ev.Shutdown)
    story.expect("LAND")
    assert story.motions == [*BOTH, *BOTH]


# --- start ------------------------------------------------------------------------------------------------------------


def test_started_on_the_ground_waits_for_a_mission():
    story = Story().start().after(30.0).expect("MISSION_INPUT")
    assert story.requests == []


def test_started_while_armed_lands_by_both_routes():
    story = Story()
    story.vehicle.armed, story.vehicle.height = True, 10.0
    story.vehicle.landed, story.vehicle.mode = ev.VehicleLanded.IN_AIR, "AUTO.MISSION"
    story.start().after(0.3).expect("LAND")
    assert story.motions[:2] == [*BOTH]
    story.until("MISSION_ENDED", limit_s=30.0)


def test_started_while_armed_lands_although_the_mode_of_before_goes_on():
    """The mode that it was in when it was found is no takeover: LAND is repeated until the vehicle shows it."""
    story = Story()
    story.vehicle.armed, story.vehicle.height = True, 10.0
    story.vehicle.landed, story.vehicle.mode = ev.VehicleLanded.IN_AIR, "AUTO.MISSION"
    story.disobeyed += ["LAND", "AutopilotLand"]
    story.start().after(5.0).expect("LAND", "commanding")
    assert story.motions.count("LAND") >= 9
    assert story.motions.count("AutopilotLand") >= 9


def test_started_while_armed_and_the_pilot_flies_commands_nothing():
    story = Story()
    story.vehicle.says.update(armed=True, landed=ev.VehicleLanded.IN_AIR, pilot_in_control=True)
    story.start().after(30.0).expect("PILOT")
    assert story.motions == []


def test_started_without_knowing_whether_it_is_armed_waits_until_it_knows():
    story = Story()
    story.vehicle.says.update(armed=None, landed=ev.VehicleLanded.UNKNOWN)
    story.start().after(5.0).expect("MISSION_INPUT")
    story.say(armed=True, landed=ev.VehicleLanded.IN_AIR).expect("MISSION_INPUT")
    story.after(0.25).expect("LAND")


@pytest.mark.parametrize("lies", [0, 1, 2])
def test_one_wrong_status_does_not_tell_whether_it_was_armed_at_the_start(lies):
    """As seen: the first status after the start of an engine said disarmed, and a flying vehicle was a pilot's."""
    story = Story()
    story.silent.append("autopilot")
    story.start()
    for number in range(5):
        down = {"armed": False, "landed": ev.VehicleLanded.ON_GROUND}
        story.say(**down if number == lies else {"armed": True, "landed": ev.VehicleLanded.IN_AIR}).after(0.2)
    story.expect("LAND")


def test_armed_after_the_start_is_somebody_else():
    story = Story().start().after(1.0)
    story.say(armed=True).until("PILOT", limit_s=0.5)
    assert story.motions == []


#: Where a limit passes while nobody decides: no answer to a check. In flight it is heard first who has control.
AFTER_3_S = {"PREFLIGHT": "OUTREACH"}


@pytest.mark.parametrize("gap_s", [0.1, 3.0])
@pytest.mark.parametrize("place", BEGINNINGS)
def test_a_restart_resumes_where_it_was_and_sends_nothing_twice(place, gap_s):
    story = at(place)
    was = story.place[0]
    story.ticking = False
    story.now += round(gap_s * S)
    story.moved = story.beat = story.now
    story.feed(ev.EngineStarted, label="again", resumed=True)
    assert story.place[0] == (AFTER_3_S.get(place, was) if gap_s == 3.0 else was)
    assert story.state.peers.autopilot is None, "what was said before the restart is not known any more"
    forbidden = {"TAKEOFF", "LoadMission", "StartRecording", "StopRecording", "HOLD", "RESUME"}
    assert not forbidden & set(story.requests)
    assert story.state.session.id == at(place).state.session.id


RESTARTS = {
    "a limit passed": lambda _: None,
    "a code 16 comes first": lambda story: story.fail("imu", 16),
    "the user lands": lambda story: story.user("land"),
}


@pytest.mark.parametrize("meanwhile", RESTARTS)
@pytest.mark.parametrize("mode", ["AUTO.RTL", "POSCTL"])
def test_a_restart_in_flight_commands_nothing_before_it_has_heard_who_has_control(mode, meanwhile):
    story = at("HOLD confirming")
    story.vehicle.says["mode"] = mode
    story.now += 6 * S
    story.moved = story.beat = story.now
    story.look().feed(ev.EngineStarted, label="again", resumed=True)
    RESTARTS[meanwhile](story)
    story.after(1.0).expect("PILOT")
    assert story.motions == []


def test_a_restart_in_flight_lands_at_once_when_the_first_status_is_ours():
    story = at("HOLD confirming")
    story.now += 6 * S
    story.moved = story.beat = story.now
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.fail("imu", 16)
    story.after(0.5).expect("LAND")
    assert "LAND" in story.motions


def test_a_restart_in_flight_lands_when_nobody_says_who_has_control():
    story = at("MISSION flying")
    story.silent.append("autopilot")
    story.now += 1 * S
    story.moved = story.beat = story.now
    story.feed(ev.EngineStarted, label="again", resumed=True)
    limit_s = story.rules.limits.autopilot_status_limit_ns / S
    story.after(limit_s - 0.2)
    assert story.motions == []
    story.after(0.5).expect("LAND")
    assert "AutopilotLand" in story.motions


def test_a_takeover_that_was_in_doubt_is_not_denied_by_a_restart():
    story = at("MISSION flying")
    story.say(mode="POSCTL").after(0.2)
    story.fail("imu", 16)
    assert story.motions == []
    story.look().feed(ev.EngineStarted, label="again", resumed=True)
    story.after(1.0).expect("PILOT")
    assert ("takeover_denied" in story.told, story.motions) == (False, [])


@pytest.mark.parametrize("place", ["TAKEOFF climbing", "MISSION flying", "HOLD holding"])
def test_a_restart_in_flight_flies_on_when_its_peers_speak(place):
    story = at(place)
    story.now += 2 * S
    story.moved = story.beat = story.now
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.after(0.5)
    assert story.place[0] == place.split()[0]
    if place == "HOLD holding":
        story.user("resume")
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "COMPLETE"


def _waits_for_lrf():
    story = at("MISSION flying").fail("lrf", 8, "trying").until("HOLD", "holding")
    return story, wait_limit_ns("lrf", story.rules) / S


def test_what_came_back_while_the_engine_was_dead_is_heard_before_its_wait_ends():
    story, limit_s = _waits_for_lrf()
    story.watchdog.components["lrf"] = ev.ComponentStatus("lrf", Code.NOMINAL)
    story.pass_dead(limit_s + 3.0).look().feed(ev.EngineStarted, label="again", resumed=True)
    story.silent.append("watchdog")
    story.after(0.4).expect("HOLD")
    story.silent.remove("watchdog")
    story.until("MISSION_ENDED")
    assert (story.state.session.result.value, story.motions) == ("COMPLETE", ["RESUME"])


def test_what_did_not_come_back_while_the_engine_was_dead_ends_the_flight_at_the_next_word():
    story, limit_s = _waits_for_lrf()
    story.pass_dead(limit_s + 3.0).feed(ev.EngineStarted, label="again", resumed=True)
    story.silent.append("watchdog")
    word_s = story.rules.limits.watchdog_heartbeat_limit_ns / S
    story.after(word_s - 0.1).expect("HOLD").after(0.2).expect("LAND")


def test_what_is_heard_to_be_bad_still_is_not_waited_for_longer():
    story, limit_s = _waits_for_lrf()
    limits = replace(story.rules.limits, watchdog_heartbeat_limit_ns=10 * S)
    story.rules = replace(story.rules, limits=limits)
    story.pass_dead(limit_s + 3.0).feed(ev.EngineStarted, label="again", resumed=True)
    story.after(0.5).expect("LAND")


def test_a_restart_leaves_a_wait_that_ends_later_as_it_is():
    story, _ = _waits_for_lrf()
    before = story.failure("lrf").deadline_ns
    story.feed(ev.EngineStarted, label="again", resumed=True)
    assert story.failure("lrf").deadline_ns == before


def test_a_mission_that_ended_while_the_engine_was_dead_is_complete_as_soon_as_the_planner_says_so():
    story = at("MISSION flying")
    story.planner.says["phase"] = MissionPhase.FLYING
    story.say(armed=False, landed=VehicleLanded.ON_GROUND, height_m=0.0)
    while story.state.flight.active:
        story.after(0.1)
    story.pass_dead(story.rules.limits.confirm_limit_ns / S + 1.0)
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.vehicle.says.update(armed=False, landed=VehicleLanded.ON_GROUND)
    story.say()
    story.planner.says["phase"] = MissionPhase.LANDED
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "COMPLETE"


def test_a_restart_in_flight_without_peers_lands():
    story = at("MISSION flying")
    story.silent += ["autopilot", "planner", "watchdog", "recorder", "landing"]
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.after(2.0).expect("LAND")


def test_a_restart_before_takeoff_asks_again_and_flies():
    story = at("LOAD_MISSION")
    story.disobeyed.clear()
    story.agenda.clear()
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.after(12.0)
    assert story.place[0] in ("OUTREACH", "PREFLIGHT", "TAKEOFF", "MISSION")


def test_a_restart_while_landing_goes_on_commanding():
    story = at("LAND commanding")
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.look().after(1.0).expect("LAND", "commanding")
    assert "LAND" in story.motions


def test_a_restart_while_the_pilot_flies_commands_nothing():
    story = at("PILOT")
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.after(10.0).expect("PILOT")
    assert story.motions == []


def test_a_restart_after_the_end_of_a_process_takes_missions_again():
    story = at("MISSION_ENDED")
    story.feed(ev.Shutdown)
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.select().until("MISSION", "flying")
    assert story.place == ("MISSION", "flying")


def test_a_restart_says_so():
    story = at("MISSION flying")
    story.feed(ev.EngineStarted, label="again", resumed=True)
    assert story.told == ["resumed"]
    assert evolve(story.state, label="", started_ns=0).state.value == "MISSION"


IN_TIME = {
    "TAKEOFF lifting_off": 12.0,
    "TAKEOFF climbing": 35.0,
    "HOLD confirming": 3.2,
    "HOLD resuming": 5.2,
}


@pytest.mark.parametrize("place", IN_TIME)
def test_a_limit_that_passed_while_the_engine_was_dead_ends_no_flight_that_goes_well(place):
    story = at(place)
    story.planner.flown_ns = -(10**13)
    story.disobeyed.clear()
    effect = {"TAKEOFF lifting_off": "_lift_off", "HOLD confirming": "_on_hold", "HOLD resuming": "_on_resume"}.get(
        place
    )
    if effect is not None:
        getattr(story, effect)(*(() if effect == "_lift_off" else (None,)))
    story.pass_dead(IN_TIME[place])
    story.look().feed(ev.EngineStarted, label="again", resumed=True)
    story.after(3.0)
    assert not story.is_in("LAND"), story.told
    assert "LAND" not in story.motions


def test_control_is_not_said_to_be_back_over_a_vehicle_that_nobody_hears():
    story = at("MISSION flying").say(mode="POSCTL", pilot_in_control=True)
    story.after(0.1).say()
    assert story.state.flight.takeover_noted
    story.silent.append("autopilot")
    story.look().feed(ev.EngineStarted, label="again", resumed=True)
    story.after(3.0)
    assert "takeover_denied" not in story.told


def test_a_landing_is_repeated_a_period_after_a_restart_and_not_at_once():
    story = at("LAND commanding").after(0.1)
    story.feed(ev.EngineStarted, label="again", resumed=True)
    assert story.state.landing.sent_ns == story.now


# --- what a person had in mind ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dead_s", [0.5, 20.0])
def test_what_was_queued_is_not_flown_by_an_engine_that_was_told_to_end_and_is_started_again(dead_s):
    """Ctrl-C in the landing behind the last waypoint: the mission is complete, and nobody has selected another one."""
    story = at("MISSION flying")
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    while story.planner.phase is not ev.MissionPhase.LANDING:
        story.after(0.1)
    story.look().feed(ev.Shutdown, signal="SIGINT")
    story.after(0.2).pass_dead(dead_s).feed(ev.EngineStarted, label="again", resumed=True)
    assert "queue_dropped" in story.told
    story.until("MISSION_ENDED", limit_s=60.0).after(5.0)
    assert (story.state.session.result.value, story.state.queue) == ("COMPLETE", ())
    assert story.place[0] == "MISSION_ENDED"


@pytest.mark.parametrize("place", ["PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION"])
def test_what_an_engine_goes_on_with_after_long_a_person_is_asked_about(place):
    story = at(place)
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    story.pass_dead(SHIPPED.limits.ready_limit_ns / S + 1.0)
    story.look().feed(ev.EngineStarted, label="again", resumed=True)
    assert (story.place[0], story.state.queue) == ("OUTREACH", ())
    assert "was_away" in story.told
    story.answers.clear()
    story.disobeyed.clear()
    story.look().after(60.0)
    assert (story.place[0], story.motions) == ("OUTREACH", [])
    assert story.user("retry")[0] == "DONE"
    story.after(30.0)
    assert "checks_passed" in story.rules_fired


FOR_LONG = round(SHIPPED.limits.ready_limit_ns + S)
AWAY = {
    "its process stood": lambda story: story.feed(ev.Tick, away_ns=FOR_LONG),
    "its simulation began anew": lambda story: story.feed(
        ev.EngineStarted, label="again", resumed=True, away_ns=FOR_LONG
    ),
}


@pytest.mark.parametrize("how", AWAY)
@pytest.mark.parametrize("place", ["PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION"])
def test_it_is_asked_about_too_where_the_clock_that_decides_has_not_seen_it(place, how):
    """What came in meanwhile is read behind it, so no time is missing between two events."""
    story = at(place)
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    AWAY[how](story.look())
    assert (story.place[0], story.state.queue) == ("OUTREACH", ())
    story.look().after(60.0)
    assert (story.place[0], story.motions) == ("OUTREACH", [])


def test_a_flight_goes_on_that_an_engine_has_not_seen_for_long_and_nothing_behind_it():
    story = Story(SHIPPED, Mission(id="1", files=2), Mission(id="2")).start().after(0.5).select()
    story.until("MISSION", "flying").look()
    story.feed(ev.Tick, away_ns=FOR_LONG)
    story.expect("MISSION", "flying").until("MISSION_ENDED")
    assert story.motions == []
    assert "queue_dropped" in story.told


@pytest.mark.parametrize("place", ["READY", "LOAD_MISSION"])
def test_what_it_goes_on_with_after_a_moment_nobody_is_asked_about(place):
    story = at(place)
    story.state = replace(story.state, queue=(ev.Mission(id="2"),))
    story.pass_dead(3.0).look().feed(ev.EngineStarted, label="again", resumed=True)
    assert (story.place[0], len(story.state.queue), story.told) == (place, 1, ["resumed"])


def test_a_signal_that_nobody_has_answered_lands_after_a_restart_and_is_forgotten_then():
    """It came in a moment of doubt, and the process was killed in it: it was meant for that one."""
    story = at("MISSION flying").say(mode="POSCTL")
    story.vehicle.says.clear()
    story.feed(ev.Shutdown, signal="SIGTERM")
    story.pass_dead(0.5).feed(ev.EngineStarted, label="again", resumed=True)
    story.look().until("MISSION_ENDED", limit_s=60.0)
    assert "LAND" in story.motions
    story.select().until("TAKEOFF", limit_s=120.0)


def test_before_a_takeoff_such_a_signal_is_forgotten_with_the_process():
    story = at("PREFLIGHT")
    story.state = replace(story.state, signal="SIGTERM", shutting_down=True)
    story.feed(ev.EngineStarted, label="again", resumed=True)
    assert (story.state.signal, story.state.shutting_down) == ("", False)
    story.expect("OUTREACH")  # whoever told it to end may say that it goes on


# --- what flew unheard ------------------------------------------------------------------------------------------------


def dead_over_a_flight(place: str, dead_s: float) -> Story:
    """Tell a flight that begins and ends while the engine is dead."""
    story = at(place)
    story.disobeyed.clear()
    if place == "TAKEOFF lifting_off":
        story.vehicle.height, story.vehicle.landed = 0.5, ev.VehicleLanded.TAKING_OFF
        story.planner.phase = ev.MissionPhase.TAKING_OFF
        story.vehicle.take_off()
    return story.pass_dead(dead_s).look()


@pytest.mark.parametrize("planner_says", [True, False])
def test_a_flight_that_nobody_heard_is_never_called_not_flown(planner_says):
    story = dead_over_a_flight("TAKEOFF lifting_off", 40.0)
    assert story.vehicle.armed is False
    assert story.planner.phase is ev.MissionPhase.LANDED
    if not planner_says:  # it was started again, too
        story.planner.phase, story.planner.waypoint = ev.MissionPhase.IDLE, 0
    story.feed(ev.EngineStarted, label="again", resumed=True)
    story.until("MISSION_ENDED" if planner_says else "OUTREACH")
    assert ("landed_unheard" in story.rules_fired) is planner_says
    if not planner_says:
        story.user("give_up")
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "LANDED_EARLY"


@pytest.mark.parametrize("unheard", ["node", "link", "all unknown"])
def test_an_armed_vehicle_that_was_not_heard_for_long_may_have_flown(unheard):
    story = at("TAKEOFF lifting_off")
    story.vehicle.obeys = False
    if unheard == "node":
        story.silent.append("autopilot")
    for second in range(40):
        if unheard != "node":
            story.vehicle.says.update(link_age_s=float(second))
        if unheard == "all unknown":
            story.vehicle.says.update(armed=None, landed=ev.VehicleLanded.UNKNOWN, link_age_s=None)
        story.after(1.0)
    story.expect("LAND")
    story.vehicle.armed, story.vehicle.landed = False, ev.VehicleLanded.ON_GROUND
    story.silent.clear()
    story.vehicle.says.clear()
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "LANDED_EARLY"


def test_what_was_heard_on_the_ground_all_the_time_is_not_flown():
    story = at("TAKEOFF lifting_off")
    story.user("abort")
    story.until("OUTREACH").user("give_up")
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "NOT_FLOWN"


@pytest.mark.parametrize("phase", ["STOPPING", "MERGING", "COMPLETE"])
def test_a_recording_that_somebody_else_ended_in_flight_is_not_complete(phase):
    story = at("MISSION flying")
    story.recorder.says.update(phase=ev.RecordingPhase[phase])
    story.after(0.6)
    story.recorder.says.clear()
    story.until("MISSION_ENDED", limit_s=60.0)
    assert story.state.session.data_result.value == "INCOMPLETE"
    assert story.told[-1] == "mission_ended_incomplete"
