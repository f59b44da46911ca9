"""Every way from one state to another: one story for each row, with what it commands, written by hand.

A story begins somewhere, something happens, and the row fires: from where, to where, commanding what, telling what.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Callable, NamedTuple, Tuple

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import CHECKS, MISSION, SHIPPED, S
from engine_story import Story
from expected_values import VALUES

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine import transitions
from amaze_autonomy.engine.commands import Value
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.rules import Severity

ASKED = tuple(f"check:{name}" for name in CHECKS)
GROUND, AIR, LANDING = ev.VehicleLanded.ON_GROUND, ev.VehicleLanded.IN_AIR, ev.VehicleLanded.LANDING
UNKNOWN = ev.VehicleLanded.UNKNOWN
REFUSED, ACCEPTED = ev.Outcome.REFUSED, ev.Outcome.ACCEPTED
BOTH = ("LAND", "AutopilotLand")
GIVEN_UP = ("StopRecording",)


class Row(NamedTuple):
    """A row of the transition table in a story."""

    rule: str
    begins: str
    happens: Callable[[Story], object]
    target: str
    commands: Tuple[str, ...] = ()
    tells: str = ""


# --- what happens -----------------------------------------------------------------------------------------------------


def user(command: str) -> Callable[[Story], object]:
    def happens(story: Story) -> None:
        assert story.user(command)[0] == "DONE"

    return happens


def fails(name: str, code: int, restart: str = "none") -> Callable[[Story], object]:
    return lambda story: story.fail(name, code, restart)


def says(**claims: object) -> Callable[[Story], object]:
    return lambda story: story.say(**claims)


def keeps_saying(seconds: float = 0.35, **claims: object) -> Callable[[Story], object]:
    """Let several statuses agree."""
    return lambda story: story.say(**claims).after(seconds)


def seems_taken_twice(story: Story) -> None:
    story.say(mode="POSCTL").after(0.1).say(mode="POSCTL")


def seems_taken(story: Story) -> None:
    seems_taken_twice(story)
    story.vehicle.says.clear()
    story.report()


def is_in_the_air(story: Story) -> None:
    story.vehicle.says.update(armed=True, landed=AIR)
    story.report()
    story.after(0.2)


def arms_late(story: Story) -> None:
    story.user("abort")
    story.after(0.4).expect("OUTREACH").look()
    story.say(armed=True).after(0.2)


def flew_unheard(story: Story) -> None:
    story.planner.says.update(phase=ev.MissionPhase.LANDED, waypoint=3)
    story.report()
    story.say(armed=False).after(0.65)


def takeoff_fails(story: Story) -> None:
    story.planner.says.update(phase=ev.MissionPhase.FAILED, message="arm: refused: no GPS")
    story.report()


def flies_on(story: Story) -> None:
    story.say(mode="OFFBOARD", horizontal_speed_m_s=2.0).after(1.05)


def nobody_answers(story: Story) -> None:
    story.silent += ["autopilot", "planner"]
    story.after(6.5).look()
    user("acknowledge")(story)


def told_to_end(story: Story) -> None:
    story.feed(ev.Shutdown, signal="SIGTERM")


def waits(seconds: float) -> Callable[[Story], object]:
    return lambda story: story.after(seconds)


def refuses(name: str, outcome: ev.Outcome = REFUSED) -> Callable[[Story], object]:
    """Let the reply to the last command be a refusal."""

    def happens(story: Story) -> None:
        state = story.state
        identity = {
            "load": state.preflight.load.id,
            "record": state.recording.request.id,
            "motion": state.flight.motion.id,
        }[name]
        story.feed(ev.Reply, command_id=identity, outcome=outcome, message="no")

    return happens


def started_armed(**claims: object) -> Callable[[Story], object]:
    def happens(story: Story) -> None:
        story.vehicle.says.update(armed=True, landed=AIR, height_m=9.0, **claims)
        story.start().report()
        story.after(0.45 if claims else 0.0)

    return happens


def recorder(phase: str, after_s: float = 0.0) -> Callable[[Story], object]:
    def happens(story: Story) -> None:
        story.agenda.clear()
        story.recorder.phase = ev.RecordingPhase[phase]
        story.after_ns(1).report()  # what is said in the very moment of the stop was said before it
        story.after(after_s)

    return happens


def recorder_lost(story: Story) -> None:
    """The recording is complete, and lacks something of the flight."""
    story.recorder.says["lost"] = "second: 37.9 s"
    recorder("COMPLETE")(story)


def vehicle_is_put_down(story: Story) -> None:
    """The vehicle lands and disarms by itself, the planner does not know."""
    story.planner.says["phase"] = ev.MissionPhase.FLYING
    story.vehicle.land()
    story.vehicle.mode = "AUTO.MISSION"
    story.after(14.0)


def loaded_again(story: Story) -> None:
    story.disobeyed.clear()
    story.later(0, "_effect", story_load(story))
    story.after(1.0)


def story_load(story: Story) -> object:
    return next(c for _, c in reversed(story.sent) if type(c).__name__ == "LoadMission")


def climbs_slowly(story: Story) -> None:
    story.vehicle.speed = 0.0
    story.after(30.0)


def stays_armed_after_mission(story: Story) -> None:
    story.vehicle.auto_disarm = False
    story.until("MISSION", "flying")
    story.after(15.0)


def stays_armed_after_mission_whatever_it_is_told(story: Story) -> None:
    story.vehicle.auto_disarm = False
    story.until("MISSION", "flying")
    story.vehicle.says["armed"] = True
    story.until("LAND")


def stays_armed_while_landing(story: Story) -> None:
    story.vehicle.auto_disarm = False
    while story.state.flight.grounded_ns is None:
        story.after(0.1)
    story.vehicle.says["armed"] = True
    story.after(9.0).look().after(1.2)


def put_down_armed(story: Story) -> None:
    """As by a gust or a wrong height, while the planner flies on."""
    story.planner.says["phase"] = ev.MissionPhase.FLYING
    story.landing_says = ev.Landed.ON_GROUND
    story.say(landed=GROUND, height_m=0.0).after(4.2)


def holding_for(story: Story) -> None:
    story.fail("lrf", 8)
    story.until("HOLD", "holding")
    story.look()
    story.back("lrf")


def started_again_after_an_hour(story):
    return story.pass_dead(3600.0).look().feed(ev.EngineStarted, label="again", resumed=True)


def taken_back_again_and_again(story: Story) -> None:
    """A required component comes and goes."""
    story.select()
    for _ in range(30):
        story.after(0.1).fail("gps", 2).back("gps")


def taken_back_for_good(story: Story) -> None:
    """The watchdog's check passes, but the info stream says code 2 of a required component."""
    story.check_says["watchdog"] = {"ok": True, "checks": (), "components": ()}
    story.fail("gps", 2)
    story.select().after(70.0)


def watchdog_answers_late(*after_s: float) -> Callable[[Story], object]:
    """Let the watchdog answer when the answers of the other checks are too old already; its first start takes long."""

    def happens(story: Story) -> None:
        story.rules = replace(
            story.rules, limits=replace(story.rules.limits, check_reply_limit_ns=40 * S, preflight_fix_limit_ns=30 * S)
        )
        story.answers["check:watchdog"] = None
        story.select()
        for seconds in after_s:
            story.after(seconds)
            record = next(r for r in story.state.preflight.checks if r.check is ev.CheckName.WATCHDOG)
            story.feed(ev.CheckReply, command_id=record.command_id, check=record.check, outcome=ACCEPTED, ok=True)

    return happens


def checks_get_old(story: Story) -> None:
    """All checks passed at once; the planner confirms nothing, and the load limit is longer than checks are fresh."""
    story.rules = replace(story.rules, limits=replace(story.rules.limits, load_limit_ns=60 * S))
    story.answers.pop("check:battery", None)
    story.after(10.5)


def next_leg_loaded(story: Story) -> None:
    story.disobeyed.clear()
    story.later(0, "_effect", story_load(story))
    story.after(1.0)


def lands_and_flies_on(story: Story) -> None:
    """It shows that it lands, and then it does not any more."""
    story.say(landed=LANDING).expect("LAND", "descending").look()
    story.say(landed=AIR)


def mission_of_two_is_flown(story: Story) -> None:
    story.select(MISSION, Mission(id="2")).until("MISSION_ENDED")


def selects_and_fails(name: str, **said: object) -> Callable[[Story], object]:
    def happens(story: Story) -> None:
        story.check_says[name] = {"ok": False, **said}
        story.select().after(1.5)

    return happens


ROWS = (
    # the pilot
    Row("takeover_suspected", "MISSION flying", seems_taken_twice, "MISSION flying", (), "takeover_suspected"),
    Row("takeover_denied", "MISSION flying", seems_taken, "MISSION flying", (), "takeover_denied"),
    Row("still_flying", "DATA_CLEANUP", is_in_the_air, "LAND commanding", BOTH, "land"),
    Row("armed_late", "TAKEOFF arming", arms_late, "LAND commanding", BOTH, "land"),
    Row("pilot_took_over", "MISSION flying", keeps_saying(pilot_in_control=True), "PILOT", (), "pilot"),
    Row("pilot_had_control_at_start", "nowhere", started_armed(pilot_in_control=True), "PILOT", (), "pilot"),
    Row("started_armed", "nowhere", started_armed(), "LAND commanding", BOTH, "land"),
    Row("armed_by_others", "READY", keeps_saying(armed=True), "PILOT", (), "pilot"),
    Row("armed_after_flight", "DATA_CLEANUP", keeps_saying(armed=True), "PILOT", (), "pilot"),
    Row("armed_before_data_is_complete", "OUTREACH data", keeps_saying(0.5, armed=True), "PILOT", (), "pilot"),
    # the end of the process
    Row("shutdown_in_flight", "HOLD holding", told_to_end, "LAND commanding", BOTH, "shutdown"),
    Row("shutdown_while_landing", "LAND descending", told_to_end, "LAND descending", BOTH, "shutdown"),
    Row("shutdown_before_takeoff", "LOAD_MISSION", told_to_end, "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row("shutdown_in_outreach", "OUTREACH recorded", told_to_end, "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row("shutdown_unrecorded", "READY", told_to_end, "MISSION_INPUT", (), "mission_input"),
    Row("shutdown_between_files", "MISSION touchdown", told_to_end, "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    # what is complete
    Row(
        "disarm_after_mission",
        "TAKEOFF climbing",
        stays_armed_after_mission,
        "MISSION flying",
        ("AutopilotDisarm",),
        "disarm",
    ),
    Row(
        "grounded_in_mission",
        "MISSION flying",
        put_down_armed,
        "LAND commanding",
        ("LAND",),
        "land_on_ground",
    ),
    Row(
        "not_disarmed",
        "TAKEOFF climbing",
        stays_armed_after_mission_whatever_it_is_told,
        "LAND commanding",
        ("LAND",),
        "land_on_ground",
    ),
    Row(
        "stays_armed_alarm",
        "LAND descending",
        stays_armed_while_landing,
        "LAND descending",
        (),
        "stays_armed",
    ),
    Row("mission_complete", "MISSION flying", waits(12.0), "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row(
        "touchdown",
        "two files",
        lambda story: story.until("MISSION", "touchdown"),
        "MISSION touchdown",
        ("LoadMission", *ASKED),
        "touchdown",
    ),
    Row("landed", "LAND descending", waits(4.0), "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row(
        "cancelled_by_landing",
        "TAKEOFF arming",
        lambda story: (story.user("land"), story.after(1.0)),
        "DATA_CLEANUP",
        ("StopRecording",),
        "data_cleanup",
    ),
    Row(
        "landed_unexpectedly", "MISSION flying", vehicle_is_put_down, "DATA_CLEANUP", ("StopRecording",), "data_cleanup"
    ),
    # land
    Row(
        "land_by_both_routes",
        "MISSION flying",
        lambda story: (story.silent.append("planner"), story.after(1.5)),
        "LAND commanding",
        BOTH,
        "land",
    ),
    Row("land", "TAKEOFF climbing", fails("imu", 16), "LAND commanding", ("LAND",), "land"),
    Row("user_land", "HOLD resuming", user("land"), "LAND commanding", ("LAND",), "land_user"),
    Row("user_abort_in_flight", "MISSION flying", user("abort"), "LAND commanding", ("LAND",), "land_user"),
    Row(
        "takeoff_not_cancelled",
        "TAKEOFF cancelling",
        says(landed=AIR, height_m=0.5),
        "LAND commanding",
        ("LAND",),
        "land",
    ),
    Row("cancel_unconfirmed", "TAKEOFF cancelling", waits(10.0), "LAND commanding", ("LAND",), "land"),
    Row(
        "lift_off_unknown",
        "TAKEOFF lifting_off",
        lambda story: (story.say(landed=UNKNOWN), story.after(10.0)),
        "LAND commanding",
        ("LAND",),
        "land",
    ),
    Row("takeoff_height_not_reached", "TAKEOFF climbing", climbs_slowly, "LAND commanding", ("LAND",), "land"),
    Row("hold_refused", "HOLD confirming", refuses("motion"), "LAND commanding", ("LAND",), "land"),
    Row("hold_unconfirmed", "HOLD confirming", waits(3.0), "LAND commanding", ("LAND",), "land"),
    Row(
        "resume_refused",
        "HOLD resuming",
        refuses("motion", ev.Outcome.UNAVAILABLE),
        "LAND commanding",
        ("LAND",),
        "land",
    ),
    Row("resume_unconfirmed", "HOLD resuming", waits(5.0), "LAND commanding", ("LAND",), "land"),
    Row("takeoff_failed", "TAKEOFF arming", takeoff_fails, "OUTREACH", (), "takeoff_refused"),
    Row("hold_repeated", "HOLD confirming", waits(1.3), "HOLD confirming", ("HOLD",)),
    Row("hold_flown_on", "HOLD holding", flies_on, "HOLD confirming", ("HOLD",), "hold_not_kept"),
    Row("landing_given_up", "LAND commanding", nobody_answers, "DATA_CLEANUP", GIVEN_UP, "landing_given_up"),
    Row(
        "grounded_while_holding",
        "HOLD holding",
        keeps_saying(0.65, landed=GROUND),
        "LAND commanding",
        ("LAND",),
        "land_on_ground",
    ),
    # while landing
    Row(
        "autopilot_lost_alarm",
        "LAND commanding",
        lambda story: (story.silent.append("autopilot"), story.after(1.5)),
        "LAND commanding",
        (),
        "autopilot_lost",
    ),
    Row(
        "both_routes_needed",
        "LAND descending",
        lambda story: (story.silent.append("planner"), story.after(1.2)),
        "LAND descending",
        BOTH,
        "land_both_routes",
    ),
    Row(
        "disarm_on_ground",
        "LAND descending",
        lambda story: (setattr(story.vehicle, "auto_disarm", False), story.after(7.0)),
        "LAND descending",
        ("AutopilotDisarm",),
        "disarm",
    ),
    Row("landing_not_shown", "LAND commanding", lands_and_flies_on, "LAND commanding", ("LAND",)),
    Row("landing_shown", "LAND commanding", says(mode="AUTO.LAND"), "LAND descending", (), "land_shown"),
    Row("land_limit", "LAND commanding", waits(120.0), "LAND commanding", (), "land_limit"),
    Row("land_alarm", "LAND commanding", waits(6.0), "LAND commanding", (), "land_alarm"),
    Row("land_second_route", "LAND commanding", waits(3.0), "LAND commanding", BOTH, "land_second_route"),
    Row("land_repeat", "LAND commanding", waits(0.5), "LAND commanding", ("LAND",)),
    # before lift-off
    Row("takeoff_refused", "TAKEOFF arming", refuses("motion"), "OUTREACH", (), "takeoff_refused"),
    Row(
        "takeoff_refused_unclear",
        "TAKEOFF arming",
        lambda story: (story.say(armed=None), refuses("motion")(story)),
        "TAKEOFF cancelling",
        ("ABORT",),
        "takeoff_cancelled",
    ),
    Row("landed_unheard", "TAKEOFF lifting_off", flew_unheard, "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row("cancelled", "TAKEOFF cancelling", keeps_saying(0.65, armed=False), "OUTREACH", (), "takeoff_refused"),
    Row(
        "cancelled_late",
        "TAKEOFF arming",
        lambda story: (story.answers.update(ABORT=ev.Outcome.TIMED_OUT), story.user("abort"), story.after(10.0)),
        "OUTREACH",
        (),
        "takeoff_refused",
    ),
    Row(
        "failure_before_lift_off",
        "TAKEOFF lifting_off",
        fails("lrf", 8),
        "TAKEOFF cancelling",
        ("ABORT",),
        "takeoff_cancelled",
    ),
    Row(
        "user_abort_before_lift_off",
        "TAKEOFF arming",
        user("abort"),
        "TAKEOFF cancelling",
        ("ABORT",),
        "takeoff_cancelled",
    ),
    Row("lifted_off", "TAKEOFF lifting_off", says(landed=ev.VehicleLanded.TAKING_OFF), "TAKEOFF climbing"),
    Row("armed", "TAKEOFF arming", says(armed=True), "TAKEOFF lifting_off"),
    Row("not_armed", "TAKEOFF arming", waits(10.0), "TAKEOFF cancelling", ("ABORT",), "takeoff_cancelled"),
    Row(
        "disarmed_before_lift_off",
        "TAKEOFF lifting_off",
        keeps_saying(0.65, armed=False),
        "TAKEOFF cancelling",
        ("ABORT",),
        "takeoff_cancelled",
    ),
    Row("no_lift_off", "TAKEOFF lifting_off", waits(10.0), "TAKEOFF cancelling", ("ABORT",), "takeoff_cancelled"),
    # hold
    Row("user_hold", "TAKEOFF climbing", user("hold"), "HOLD confirming", ("HOLD",), "user_hold"),
    Row(
        "user_hold_too",
        "MISSION flying",
        lambda story: (story.fail("lrf", 8), story.look(), user("hold")(story)),
        "HOLD confirming",
        (),
        "user_hold",
    ),
    Row("user_resume", "HOLD holding", user("resume"), "HOLD holding"),
    Row("hold", "MISSION flying", fails("realsense_camera", 4), "HOLD confirming", ("HOLD",), "hold"),
    Row("hold_again", "HOLD resuming", fails("lrf", 8), "HOLD confirming", ("HOLD",), "hold"),
    Row("hold_confirmed", "HOLD confirming", lambda story: _planner_says(story, "HOLDING"), "HOLD holding"),
    Row(
        "hold_not_kept",
        "HOLD holding",
        lambda story: _planner_says(story, "FLYING"),
        "HOLD confirming",
        ("HOLD",),
        "hold_not_kept",
    ),
    Row("resume", "MISSION flying", holding_for, "HOLD resuming", ("RESUME",), "resuming"),
    Row(
        "takeoff_resumed",
        "HOLD holding takeoff",
        lambda story: (user("resume")(story), story.after(0.5)),
        "TAKEOFF climbing",
        (),
        "resumed_flight",
    ),
    Row(
        "mission_resumed",
        "HOLD resuming",
        lambda story: _planner_says(story, "FLYING"),
        "MISSION flying",
        (),
        "resumed_flight",
    ),
    # the way of a nominal mission
    Row("mission_selected", "MISSION_INPUT", lambda story: story.select(), "PREFLIGHT", ASKED, "preflight"),
    Row(
        "next_mission",
        "MISSION_INPUT",
        lambda story: (mission_of_two_is_flown(story), story.after(0.0)),
        "PREFLIGHT",
        ASKED,
        "preflight",
    ),
    Row("user_give_up_before_recording", "PREFLIGHT", user("give_up"), "MISSION_INPUT", (), "mission_input"),
    Row("user_give_up", "START_RECORDING", user("abort"), "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row("was_away", "LOAD_MISSION", started_again_after_an_hour, "OUTREACH", (), "was_away"),
    Row("checks_passed_too_often", "MISSION_INPUT", taken_back_again_and_again, "OUTREACH", (), "no_takeoff"),
    Row("checks_not_kept", "MISSION_INPUT", taken_back_for_good, "OUTREACH", (), "checks_failed"),
    Row("checks_passed", "MISSION_INPUT", lambda story: story.select().after(0.1), "READY", (), "ready"),
    Row(
        "checks_failed",
        "MISSION_INPUT",
        selects_and_fails("battery", message="0.30, needed 0.60"),
        "OUTREACH",
        (),
        "checks_failed",
    ),
    Row(
        "checks_repeated",
        "MISSION_INPUT",
        selects_and_fails("watchdog", fixable=True, being_fixed=True),
        "PREFLIGHT",
        ASKED,
        "preflight_fixing",
    ),
    Row("checks_asked_again", "MISSION_INPUT", watchdog_answers_late(11.0), "PREFLIGHT", ASKED),
    Row("checks_too_old", "MISSION_INPUT", watchdog_answers_late(11.0, 15.0, 16.0), "OUTREACH", (), "checks_failed"),
    Row("ready_revoked", "START_RECORDING", fails("gps", 2), "PREFLIGHT", ASKED, "ready_revoked"),
    Row("go", "READY", user("go"), "START_RECORDING", ("StartRecording",), "start_recording"),
    Row(
        "go_not_required",
        "MISSION_INPUT",
        lambda story: story.select().after(0.1),
        "START_RECORDING",
        ("StartRecording",),
        "start_recording",
    ),
    Row("ready_too_old", "READY", waits(60.0), "PREFLIGHT", ASKED, "ready_old"),
    Row("recording_refused", "START_RECORDING", refuses("record"), "OUTREACH", (), "recording_refused"),
    Row("recording_proven", "START_RECORDING", waits(4.0), "LOAD_MISSION", ("LoadMission", *ASKED), "load_mission"),
    Row(
        "recording_not_proven",
        "START_RECORDING",
        lambda story: (setattr(story.recorder, "growing", (True, False)), story.after(15.0)),
        "OUTREACH",
        (),
        "recording_refused",
    ),
    Row("planner_refused", "LOAD_MISSION", refuses("load"), "OUTREACH", (), "planner_refused"),
    Row(
        "check_failed_before_takeoff",
        "START_RECORDING",
        lambda story: (story.check_says.update(on_ground={"ok": False}), story.after(4.0)),
        "PREFLIGHT",
        ASKED,
        "check_failed",
    ),
    Row("takeoff", "LOAD_MISSION", loaded_again, "TAKEOFF arming", ("TAKEOFF",), "takeoff"),
    Row(
        "not_ready_to_take_off",
        "LOAD_MISSION",
        lambda story: (story.say(battery_fraction=0.1), loaded_again(story), story.after(10.0)),
        "OUTREACH",
        (),
        "takeoff_refused",
    ),
    Row("checks_expired", "LOAD_MISSION", checks_get_old, "PREFLIGHT", ASKED, "check_failed"),
    Row("planner_silent", "LOAD_MISSION", waits(10.0), "OUTREACH", (), "planner_refused"),
    Row("user_ends_touchdown", "MISSION touchdown", user("land"), "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row(
        "next_takeoff_failed",
        "MISSION touchdown",
        fails("lrf", 8),
        "DATA_CLEANUP",
        ("StopRecording",),
        "next_takeoff_failed",
    ),
    Row("next_takeoff", "MISSION touchdown", next_leg_loaded, "TAKEOFF arming", ("TAKEOFF",), "takeoff"),
    Row("at_takeoff_height", "TAKEOFF climbing", waits(2.0), "MISSION flying", (), "mission"),
    # after the flight
    Row("acknowledged", "PILOT landed", user("acknowledge"), "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row(
        "acknowledged_unknown",
        "PILOT",
        lambda story: (story.silent.append("autopilot"), story.after(31.0), user("acknowledge")(story)),
        "DATA_CLEANUP",
        ("StopRecording",),
        "landing_given_up",
    ),
    Row(
        "nothing_to_collect",
        "MISSION_INPUT",
        lambda story: (
            story.say(armed=True).after(0.5),
            story.say(armed=False).after(0.1),
            user("acknowledge")(story),
        ),
        "MISSION_ENDED",
        (),
        "mission_ended",
    ),
    Row("data_complete", "DATA_CLEANUP", recorder("COMPLETE"), "MISSION_ENDED", (), "mission_ended"),
    Row("data_lost", "DATA_CLEANUP", recorder_lost, "MISSION_ENDED", (), "mission_ended_incomplete"),
    Row("data_incomplete", "DATA_CLEANUP", recorder("FAILED"), "OUTREACH", (), "data_incomplete"),
    Row("data_limit", "DATA_CLEANUP", recorder("MERGING", 1800.0), "OUTREACH", (), "data_incomplete"),
    Row("user_calls_off", "DATA_CLEANUP queued", user("land"), "DATA_CLEANUP", (), "queue_dropped"),
    Row("retry_data", "OUTREACH data", user("retry"), "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row("give_up_data", "OUTREACH data", user("give_up"), "MISSION_ENDED", (), "mission_ended_incomplete"),
    Row("retry", "OUTREACH recorded", user("retry"), "PREFLIGHT", ASKED, "preflight"),
    Row("give_up_unrecorded", "OUTREACH", user("give_up"), "MISSION_INPUT", (), "mission_input"),
    Row("give_up", "OUTREACH recorded", user("give_up"), "DATA_CLEANUP", ("StopRecording",), "data_cleanup"),
    Row("select_next", "MISSION_ENDED", lambda story: story.select(), "MISSION_INPUT"),
    Row("next_in_queue", "MISSION_INPUT", mission_of_two_is_flown, "MISSION_INPUT"),
)


def _planner_says(story: Story, phase: str) -> None:
    story.after_ns(1)
    story.planner.says["phase"] = ev.MissionPhase[phase]
    story.report()


def _two_files() -> Story:
    mission = Mission(id="2", files=2, battery_needed_fraction=0.4)
    return Story(SHIPPED, mission).start().after(0.5).select().until("MISSION", "flying").look()


ELSEWHERE = {"nowhere": Story, "two files": _two_files}


def _names(commands: Tuple[str, ...]) -> Tuple[str, ...]:
    """Return the commands of a decision as stories call them."""
    names = [re.sub(r"#\d+$", "", command) for command in commands]
    names = [re.sub(r"^MissionCommand\((\w+)\)$", r"\1", name) for name in names]
    names = [re.sub(r"^RunCheck\((\w+)\)$", lambda m: f"check:{m[1].lower()}", name) for name in names]
    return tuple(re.sub(r"\(.*\)$", "", name) for name in names)


@pytest.mark.parametrize("row", ROWS, ids=[row.rule for row in ROWS])
def test_row(row):
    story = ELSEWHERE[row.begins]() if row.begins in ELSEWHERE else at(row.begins)
    row.happens(story)
    fired = [d for d in story.decisions if d.rule == row.rule and d in story.since]
    assert fired, f"{row.rule} did not fire but {story.rules_fired}; now {story.place}"
    decision = fired[-1] if row.rule == "next_mission" else fired[0]
    where = f"{decision.after} {decision.step}".strip()
    assert (where, _names(decision.commands)) == (row.target, row.commands)
    assert _worded(decision.values) == VALUES[row.rule]
    if row.tells:
        assert row.tells in story.told


def _worded(values: Tuple[Value, ...]) -> Tuple[str, ...]:
    """Return what a decision looked at as `expected_values` says it: name, value, limit and unit."""
    return tuple(
        f"{value.name}: {value.value!r}"
        + (f" of {value.limit!r}" if value.limit is not None else "")
        + (f" {value.unit}" if value.unit else "")
        for value in values
    )


def test_the_time_of_a_state_begins_with_it_and_not_with_each_of_its_steps():
    story = at("TAKEOFF climbing")
    (began,) = {decision.t_ns for decision in story.decisions if decision.rule == "takeoff"}
    assert story.state.entered_ns == began < story.state.step_ns


def test_every_row_has_its_story():
    assert sorted(VALUES) == sorted(row.rule for row in transitions.TRANSITIONS)
    assert sorted(row.rule for row in ROWS) == sorted(row.rule for row in transitions.TRANSITIONS)


def test_every_place_can_be_a_beginning():
    places = {tuple(place.split(" ")[:2]) for place in BEGINNINGS}
    assert transitions.ROWS_AT
    for state, step in transitions.ROWS_AT:
        assert any(p[0] == state.value and (not step.value or p[-1] == step.value) for p in places), (state, step)


def test_the_row_of_the_severity_of_a_mission_fires_the_same():
    story = Story(SHIPPED, Mission(id="1", severities=(("gps", Severity.HIGHEST),))).start().after(0.5).select()
    story.until("MISSION", "flying").look().fail("gps", 16)
    assert story.rules_fired[:2] == ["failure_land", "land"]
