"""Before takeoff: all checks and their limits; the watchdog's fixes; Ready taken back; what forbids a takeoff."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from engine_beginnings import at
from engine_peers import CHECKS, COMPONENTS, MISSION, SHIPPED, S
from engine_story import Story

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import RunCheck
from amaze_autonomy.engine.events import Check, CheckName, Mission, Verdict
from amaze_autonomy.engine.rules import Code, Rules
from amaze_autonomy.engine.state import State, put

# --- the checks -------------------------------------------------------------------------------------------------------


def test_the_checks_of_the_design_are_there_in_its_order():
    of_the_design = ["watchdog", "battery", "autopilot", "on_ground", "state_estimation"]
    assert [name for name in CHECKS if name in of_the_design] == of_the_design, "others may stand beside them"


def test_all_checks_are_asked_in_their_order():
    story = at("MISSION_INPUT").select()
    asked = [c for c in story.since if isinstance(c, RunCheck)]
    assert [c.check.value for c in asked] == list(CHECKS)
    others = len(CHECKS) - 2
    assert [c.startup_time_ns // S for c in asked] == [10, 0, *[0] * others]
    assert [c.limit_ns // S for c in asked] == [13, 3, *[3] * others]
    assert [c.required_fraction for c in asked] == [None, 0.4, *[None] * others]
    assert {c.mission_id for c in asked} == {"1"}


def test_those_that_the_rules_name_are_asked_and_enough():
    story = Story(replace(SHIPPED, checks=("watchdog", "battery", "on_ground")), MISSION).start().after(0.5).select()
    assert [c.check.value for c in story.since if isinstance(c, RunCheck)] == ["watchdog", "battery", "on_ground"]
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "COMPLETE"


def test_the_watchdog_alone_is_told_which_components_the_mission_requires():
    story = Story(SHIPPED, Mission(id="1", required=("gps", "lrf"))).start().after(0.5).select()
    asked = {c.check.value: c.required for c in story.since if isinstance(c, RunCheck)}
    assert asked == {**dict.fromkeys(CHECKS, ()), "watchdog": ("gps", "lrf")}


def test_the_second_start_of_the_watchdog_is_answered_at_once():
    story = at("MISSION_ENDED").select()
    asked = [c for c in story.since if isinstance(c, RunCheck)]
    assert [(c.startup_time_ns, c.limit_ns // S) for c in asked] == [(0, 3)] * len(CHECKS)


@pytest.mark.parametrize("check", CHECKS)
def test_each_failed_check_calls_for_a_person_and_all_are_shown(check):
    story = at("MISSION_INPUT")
    story.check_says[check] = {"ok": False, "message": f"{check} is bad"}
    story.select().after(0.3).expect("OUTREACH")
    assert [r.check.value for r in story.state.preflight.checks] == list(CHECKS)
    assert [r.check.value for r in story.state.preflight.checks if not r.ok] == [check]
    assert all(r.rows for r in story.state.preflight.checks)
    assert f"{check} is bad" in story.state.shown.text
    assert story.motions == []


@pytest.mark.parametrize("check", CHECKS)
def test_each_silent_check_runs_out(check):
    story = at("MISSION_INPUT")
    story.answers[f"check:{check}"] = None
    limit_s = 13.0 if check == "watchdog" else 3.0
    story.select().after_ns(round(limit_s * S) - 1).expect("PREFLIGHT")
    story.after_ns(1).expect("OUTREACH")
    assert f"the {check} check got no answer in time" in story.state.shown.text


@pytest.mark.parametrize("check", CHECKS)
def test_a_check_with_a_limit_of_its_own_is_waited_for_so_long_and_the_others_are_not(check):
    story = Story(replace(SHIPPED, reply_limits_ns=((check, 7 * S),))).start().after(0.5)
    story.answers[f"check:{check}"] = None
    story.select()
    startup_s = {"watchdog": 10}
    asked = {c.check.value: c.limit_ns // S for c in story.since if isinstance(c, RunCheck)}
    assert asked == {each: (7 if each == check else 3) + startup_s.get(each, 0) for each in CHECKS}
    story.after_ns((7 + startup_s.get(check, 0)) * S - 1).expect("PREFLIGHT")
    story.after_ns(1).expect("OUTREACH")
    assert f"the {check} check got no answer in time" in story.state.shown.text


def test_a_watchdog_that_has_never_beaten_is_no_takeoff_however_patient_the_limit():
    patient = replace(SHIPPED.limits, watchdog_heartbeat_limit_ns=600 * S)
    story = Story(replace(SHIPPED, limits=patient)).start().after(0.5)
    story.silent.append("watchdog")
    story.state = put(story.state, "peers.heartbeat_ns", None)
    story.select().until("OUTREACH")
    assert "TAKEOFF" not in story.motions
    assert "no heartbeat from the watchdog since it was started" in story.state.cause


def test_checks_run_out_although_another_answer_comes_before_the_engine_is_woken():
    """An answer that comes late closes the others: their limit is over, nobody would wake the engine for it again."""
    story = at("MISSION_INPUT")
    for check in CHECKS:
        story.answers[f"check:{check}"] = None
    story.select()
    asked = {r.check: r.command_id for r in story.state.preflight.checks}
    late = story.state.t_ns + 14 * S
    event = ev.CheckReply(
        t_ns=late, command_id=asked[CheckName.BATTERY], check=CheckName.BATTERY, outcome=ev.Outcome.ACCEPTED, ok=True
    )
    state, _ = engine.decide(story.state, event, story.rules)
    outcomes = {r.check: r.outcome for r in state.preflight.checks}
    assert outcomes.pop(CheckName.BATTERY) is ev.Outcome.ACCEPTED
    assert set(outcomes.values()) == {ev.Outcome.TIMED_OUT}
    assert state.state is State.OUTREACH


@pytest.mark.parametrize("check", CHECKS)
def test_retry_after_it_was_mended_flies(check):
    story = at("MISSION_INPUT")
    story.check_says[check] = {"ok": False}
    story.select().until("OUTREACH")
    story.check_says.clear()
    assert story.user("retry")[0] == "DONE"
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "COMPLETE"


def test_two_failed_checks_are_both_named():
    story = at("MISSION_INPUT")
    story.check_says.update(battery={"ok": False, "message": "low"}, on_ground={"ok": False, "message": "in the air"})
    story.select().until("OUTREACH")
    assert "battery: low" in story.state.shown.text
    assert "on_ground: in the air" in story.state.shown.text


# --- the watchdog's fixes ---------------------------------------------------------------------------------------------

FIXING = {"ok": False, "fixable": True, "being_fixed": True}


def test_what_the_watchdog_fixes_is_asked_again_each_second():
    story = at("MISSION_INPUT")
    story.check_says["watchdog"] = FIXING
    story.select().after(5.0).expect("PREFLIGHT")
    assert 4 <= story.rules_fired.count("checks_repeated") <= 5
    story.check_says.clear()
    story.until("MISSION", "flying")


def test_the_fix_has_a_limit():
    """60 s, and the 10 s of the first start of the watchdog."""
    story = at("MISSION_INPUT")
    story.check_says["watchdog"] = FIXING
    story.select().after_ns(70 * S - 1).expect("PREFLIGHT")
    story.after(3.1).expect("OUTREACH")


def test_the_fix_of_the_second_start_has_60_s():
    story = at("MISSION_ENDED")
    story.check_says["watchdog"] = FIXING
    story.select().after_ns(60 * S - 1).expect("PREFLIGHT")
    story.after(3.1).expect("OUTREACH")


def test_a_fix_that_never_answers_has_a_limit_too():
    story = at("MISSION_INPUT")
    story.check_says["watchdog"] = FIXING
    story.select().after(1.5)
    story.answers["check:watchdog"] = None
    story.after(80.0).expect("OUTREACH")


def test_what_is_not_fixable_is_not_waited_for():
    story = at("MISSION_INPUT")
    story.check_says["watchdog"] = {"ok": False, "fixable": False}
    story.select().after(0.1).expect("OUTREACH")


def test_another_failed_check_is_not_waited_for():
    story = at("MISSION_INPUT")
    story.check_says["watchdog"] = FIXING
    story.check_says["battery"] = {"ok": False}
    story.select().after(0.1).expect("OUTREACH")


def test_ready_is_not_believed_when_the_list_says_otherwise():
    story = at("MISSION_INPUT")
    story.check_says["watchdog"] = {"ok": True, "components": (ev.ComponentStatus("lrf", Code.HOLD),)}
    story.select().after(0.1).expect("OUTREACH")
    assert "lrf is at code 8" in story.state.shown.text


# --- required and tolerated -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code, flies", [(2, True), (4, False), (8, False), (16, False)])
def test_a_tolerated_component_may_be_at_code_2(code, flies):
    story = Story(SHIPPED, Mission(id="1", tolerated=("gps",))).start().after(0.5).fail("gps", code)
    story.select().after(8.0)
    assert ("TAKEOFF" in story.motions) == flies


@pytest.mark.parametrize("name", [rule.name for rule in COMPONENTS])
def test_by_default_every_listed_component_is_required(name):
    story = at("MISSION_INPUT").fail(name, 2).select().after(8.0).expect("OUTREACH")
    assert story.motions == []


@pytest.mark.parametrize("name, code", [("gps", 2), ("realsense_camera", 4)])
def test_what_is_not_required_is_flown_without(name, code):
    story = Story(SHIPPED, Mission(id="1", required=("lrf",))).start().after(0.5).fail(name, code)
    story.select().until("MISSION_ENDED")
    assert story.motions == ["TAKEOFF"]
    assert story.state.session.result.value == "COMPLETE"


@pytest.mark.parametrize("listed", ["components", "checks"])
def test_what_is_required_must_be_listed_by_a_watchdog_that_says_ready(listed):
    """One of another make calls it by another name, or has never heard of it."""
    story = Story(SHIPPED, Mission(id="1", required=("mission_camera", "lrf"))).start().after(0.5)
    kinds = {
        "components": lambda name: ev.ComponentStatus(name, Code.NOMINAL),
        "checks": lambda name: Check(name, Verdict.PASS),
    }
    story.check_says["watchdog"] = {
        "components": (),
        "checks": (),
        listed: tuple(map(kinds[listed], ("lrf", "camera"))),
    }
    story.select().until("OUTREACH")
    assert "mission_camera: required, and not among what the watchdog lists" in story.state.shown.text
    story.check_says["watchdog"][listed] += (kinds[listed]("mission_camera"),)
    story.user("retry")
    story.until("TAKEOFF")


@pytest.mark.parametrize("name, code", [("imu", 16), ("barometer", 16)])
def test_nothing_takes_off_with_what_it_would_land_for_even_if_it_is_not_required(name, code):
    story = Story(SHIPPED, Mission(id="1", required=("lrf",))).start().after(0.5).fail(name, code)
    story.select().until("OUTREACH")
    assert story.motions == []
    assert name in story.state.shown.text


# --- what forbids a takeoff although every check passes ---------------------------------------------------------------


def _loaded(story: Story) -> None:
    """Let the planner say LOADED, which is all that was missing."""
    story.planner.session, story.planner.mission = story.state.session.id, "1"
    story.planner.phase = ev.MissionPhase.LOADED


FORBIDDING = {
    "autopilot silent": lambda story: story.silent.append("autopilot"),
    "link old": lambda story: story.vehicle.says.update(link_age_s=5.0),
    "link unknown": lambda story: story.vehicle.says.update(link_age_s=None),
    "armed unknown": lambda story: story.vehicle.says.update(armed=None),
    "landed unknown": lambda story: story.vehicle.says.update(landed=ev.VehicleLanded.UNKNOWN),
    "battery critical": lambda story: story.vehicle.says.update(battery_fraction=0.1),
    "planner silent": lambda story: (story.report(), story.silent.append("planner")),
    "recorder failed": lambda story: setattr(story.recorder, "phase", ev.RecordingPhase.FAILED),
    "recorder does not grow": lambda story: setattr(story.recorder, "growing", (True, False)),
    "height beyond the limit": lambda story: story.vehicle.says.update(height_m=99.0),
    "distance beyond the limit": lambda story: story.vehicle.says.update(position_x_m=500.0),
}


@pytest.mark.parametrize("happens", FORBIDDING.values(), ids=FORBIDDING)
def test_nothing_takes_off_to_land_at_once(happens):
    story = at("START_RECORDING")
    story.answers["LoadMission"] = ev.Outcome.ACCEPTED
    story.answers["check:battery"] = None
    story.disobeyed.append("LoadMission")
    story.until("LOAD_MISSION")
    _loaded(story)
    happens(story)
    story.after(1.1)
    story.answers.clear()
    for record in story.state.preflight.checks:
        if record.outcome is None:
            story.feed(
                ev.CheckReply, command_id=record.command_id, check=record.check, outcome=ev.Outcome.ACCEPTED, ok=True
            )
    story.expect("LOAD_MISSION").after(10.0).expect("OUTREACH")
    assert story.motions == []


def test_what_forbade_it_for_a_moment_does_not_hinder():
    story = at("START_RECORDING")
    story.disobeyed.append("LoadMission")
    story.until("LOAD_MISSION")
    _loaded(story)
    story.say(armed=None).after(1.0).expect("LOAD_MISSION")
    story.vehicle.says.clear()
    story.after(0.3).expect("TAKEOFF")


def test_a_loaded_of_long_ago_does_not_confirm_a_retry():
    story = at("OUTREACH recorded")
    _loaded(story)
    story.report()
    story.silent.append("planner")
    story.after(20.0)
    story.answers.clear()
    story.disobeyed.append("LoadMission")
    story.user("retry")
    story.until("OUTREACH", limit_s=30.0)
    assert "TAKEOFF" not in story.motions


def test_takeoff_and_landing_never_in_one_breath():
    """The last reply and the loss come in one event: nothing is commanded at all."""
    story = at("START_RECORDING")
    story.disobeyed.append("LoadMission")
    story.answers["check:battery"] = None
    story.until("LOAD_MISSION")
    _loaded(story)
    story.after(0.3)
    battery = next(r for r in story.state.preflight.checks if r.check is CheckName.BATTERY)
    story.now += 2 * S
    commands = story.feed(
        ev.CheckReply, command_id=battery.command_id, check=CheckName.BATTERY, outcome=ev.Outcome.ACCEPTED, ok=True
    )
    assert [c for c in commands if type(c).__name__ in ("MissionCommand", "AutopilotLand")] == []


@pytest.mark.parametrize(
    "said",
    [
        {"mission_id": "2"},
        {"file_index": 1},
        {"repetition": 1},
        {"session_id": "test-000"},
        {"phase": ev.MissionPhase.IDLE},
        {"phase": ev.MissionPhase.FLYING},
    ],
)
def test_a_planner_that_has_loaded_something_else_confirms_nothing(said):
    story = at("LOAD_MISSION")
    _loaded(story)
    story.planner.says.update(said)
    story.after(9.0)
    assert story.motions == []


def test_loaded_without_accepted_confirms_nothing():
    story = at("START_RECORDING")
    story.answers["LoadMission"] = ev.Outcome.TIMED_OUT
    story.until("OUTREACH", limit_s=20.0)
    assert story.motions == []


# --- freshness --------------------------------------------------------------------------------------------------------


def _waiting_to_load(max_age_s: float, **own: Any) -> Story:
    limits = replace(SHIPPED.limits, check_max_age_ns=round(max_age_s * S), load_limit_ns=60 * S)
    story = Story(Rules(components=COMPONENTS, limits=limits, **own)).start().after(0.5).select()
    story.disobeyed.append("LoadMission")
    story.until("LOAD_MISSION").after(0.1)
    story.planner.session, story.planner.mission = story.state.session.id, "1"
    return story


def test_checks_at_their_greatest_age_let_it_take_off():
    story = _waiting_to_load(5.0)
    asked_ns = min(r.replied_ns for r in story.state.preflight.checks)
    story.after_ns(asked_ns + 5 * S - story.now - S // 10)
    story.silent.append("planner")
    story.now = asked_ns + 5 * S
    story.beat = story.now + 1
    story._decide(story.vehicle.status(story.now))
    _loaded(story)
    story._decide(story.planner.status(story.now))
    assert story.motions == ["TAKEOFF"]


def test_checks_one_nanosecond_older_do_not():
    story = _waiting_to_load(5.0)
    asked_ns = min(r.replied_ns for r in story.state.preflight.checks)
    story.after_ns(asked_ns + 5 * S - story.now - S // 10)
    story.now = asked_ns + 5 * S + 1
    _loaded(story)
    story._decide(story.planner.status(story.now))
    assert story.motions == []
    story.expect("PREFLIGHT")


@pytest.mark.parametrize("check", CHECKS)
def test_a_check_with_an_age_of_its_own_is_good_for_so_long_and_the_others_are_not(check):
    longer = tuple((each, 5 * S) for each in CHECKS if each != check)
    for own, motions in ((longer, []), ((*longer, (check, 5 * S)), ["TAKEOFF"])):
        story = _waiting_to_load(4.0, max_ages_ns=own)
        (replied_ns,) = (r.replied_ns for r in story.state.preflight.checks if r.check.value == check)
        story.after_ns(replied_ns + 4 * S - story.now - S // 10)
        story.silent.append("planner")
        story.now = replied_ns + 4 * S + 1
        story.beat = story.now + 1
        story._decide(story.vehicle.status(story.now))
        _loaded(story)
        story._decide(story.planner.status(story.now))
        assert story.motions == motions


# --- ready ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place", ["READY", "START_RECORDING", "LOAD_MISSION"])
@pytest.mark.parametrize("code", [2, 4, 8, 16])
def test_a_component_that_fails_between_ready_and_takeoff_takes_it_back_and_may_return(place, code):
    story = at(place)
    story.fail("lrf", code).expect("PREFLIGHT")
    assert story.told[0] == "ready_revoked"
    story.disobeyed.clear()
    story.back("lrf").after(0.5)
    assert story.place[0] in ("READY", "START_RECORDING", "LOAD_MISSION", "TAKEOFF")


def test_checks_that_pass_while_the_heartbeat_is_lost_wait_for_it():
    story = at("READY")
    story.silent.append("watchdog")
    story.after(3.0).expect("PREFLIGHT")
    assert story.rules_fired.count("ready_revoked") == 1
    story.silent.remove("watchdog")
    story.after(0.5)
    assert story.place[0] in ("READY", "START_RECORDING", "LOAD_MISSION", "TAKEOFF")
    assert story.state.preflight.rounds == 2


def test_a_retry_counts_the_rounds_of_checks_afresh():
    story = at("READY")
    rounds = story.rules.limits.preflight_rounds_limit
    for _ in range(2):
        for _ in range(rounds):
            story.expect("READY").fail("lrf", 8).expect("PREFLIGHT").back("lrf").after(0.5)
        story.expect("OUTREACH")
        assert story.rules_fired[-1] == "checks_passed_too_often"
        story.user("retry")
        story.after(0.5)
    story.expect("READY")


def test_checks_that_pass_while_the_heartbeat_stays_lost_end_with_a_person():
    story = at("READY")
    story.silent.append("watchdog")
    story.after(61.0).expect("OUTREACH")
    assert story.rules_fired[-1] == "checks_not_kept"
    assert "no heartbeat from the watchdog" in str(story.decisions[-1])


def test_ready_that_is_taken_back_again_and_again_calls_for_a_person():
    story = at("READY")
    for _ in range(30):
        story.fail("lrf", 8).back("lrf").after(0.1)
    story.expect("OUTREACH")
    story.user("retry")
    story.after(0.3).expect("READY")


def test_the_go_of_before_does_not_count_after_ready_was_taken_back():
    story = at("READY")
    story.user("go")
    story.expect("START_RECORDING").fail("lrf", 8).back("lrf").after(10.0).expect("READY")
    assert story.motions == []


def test_a_go_that_never_comes_ends_with_a_person():
    at("READY").after(400.0).expect("OUTREACH")


def test_a_running_recording_is_kept_when_ready_is_revoked():
    story = at("LOAD_MISSION")
    story.disobeyed.clear()
    story.fail("lrf", 8).back("lrf").until("TAKEOFF")
    assert "StartRecording" not in story.requests
    assert "StopRecording" not in story.requests


def test_a_running_recording_is_kept_over_outreach_and_retry():
    story = at("OUTREACH recorded")
    story.after(60.0)
    story.answers.clear()
    story.user("retry")
    story.until("MISSION_ENDED")
    assert story.requests.count("StartRecording") == 0
    assert story.requests.count("StopRecording") == 1


def test_a_recording_that_died_meanwhile_is_started_again():
    story = at("OUTREACH recorded")
    story.silent.append("recorder")
    story.after(20.0)
    story.answers.clear()
    story.look().user("retry")
    story.after(1.0).expect("START_RECORDING")
    assert "StartRecording" in story.requests
    story.silent.clear()
    story.until("MISSION", "flying")


def test_a_check_row_shows_value_limit_and_advice():
    story = at("MISSION_INPUT")
    row = Check(
        name="fraction", verdict=Verdict.FAIL, value=0.3, limit=0.6, unit="fraction", age_s=0.2, advice="charge"
    )
    story.check_says["battery"] = {"ok": False, "checks": (row,)}
    story.select().until("OUTREACH")
    battery = next(r for r in story.state.preflight.checks if r.check is CheckName.BATTERY)
    assert battery.rows == (row,)
    assert "fraction: charge" in story.state.shown.text


def test_the_lead_time_passes_before_the_mission_is_loaded():
    story = at("START_RECORDING")
    story.until("LOAD_MISSION")
    assert story.now - story.state.recording.since_ns == 3 * S


def test_the_lead_begins_anew_when_the_files_stop_growing():
    story = at("START_RECORDING").after(1.0)
    story.recorder.growing = (True, False)
    story.after(0.3)
    story.recorder.growing = (True, True)
    story.after(2.9).expect("START_RECORDING")
    story.until("LOAD_MISSION")


def test_one_platform_is_not_both():
    story = Story().start().after(0.5)
    story.recorder.growing = (True, False)
    story.select().until("OUTREACH", limit_s=20.0)
    assert "recording_refused" in story.told


@pytest.mark.parametrize("outcome", [ev.Outcome.REFUSED, ev.Outcome.UNAVAILABLE])
def test_a_recorder_that_refuses_calls_for_a_person_at_once(outcome):
    story = at("MISSION_INPUT")
    story.answers["StartRecording"] = outcome
    story.select().after(0.2).expect("OUTREACH")


@pytest.mark.parametrize("outcome", [ev.Outcome.TIMED_OUT, ev.Outcome.BROKEN, None])
def test_a_recorder_that_gives_no_answer_is_waited_for_up_to_its_limit(outcome):
    story = at("MISSION_INPUT")
    story.answers["StartRecording"] = outcome
    story.disobeyed.append("StartRecording")
    story.select().until("START_RECORDING").after_ns(15 * S - 1).expect("START_RECORDING")
    story.after_ns(1).expect("OUTREACH")


def test_the_mission_needs_are_asked_of_the_next_mission():
    story = Story(SHIPPED, MISSION, Mission(id="2", battery_needed_fraction=0.7)).start().after(0.5)
    story.select().until("MISSION_ENDED")
    asked = [c.required_fraction for c in story.since if isinstance(c, RunCheck) and c.check is CheckName.BATTERY]
    assert asked == [0.4, 0.4, 0.7, 0.7]
