"""Several files, repetitions, several missions in one run; the data: complete, incomplete, retried, given up."""

from __future__ import annotations

from typing import List, Tuple

import pytest
from engine_beginnings import at
from engine_peers import CHECKS, MISSION, SHIPPED, S
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import Level, LoadMission, Notify, RunCheck, StopRecording
from amaze_autonomy.engine.events import CheckName, Mission
from amaze_autonomy.engine.guards import lost_of


def legs(story: Story) -> List[Tuple[str, int, int]]:
    return [(c.mission_id, c.file_index, c.repetition) for c in story.since if isinstance(c, LoadMission)]


# --- several legs -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "files, repetitions, expected",
    [
        (1, 1, [(0, 0)]),
        (2, 1, [(0, 0), (1, 0)]),
        (1, 3, [(0, 0), (0, 1), (0, 2)]),
        (2, 2, [(0, 0), (1, 0), (0, 1), (1, 1)]),
    ],
)
def test_files_and_repetitions_are_flown_in_their_order(files, repetitions, expected):
    mission = Mission(id="m", files=files, repetitions=repetitions)
    story = Story(SHIPPED, mission).start().after(0.5).select().until("MISSION_ENDED", limit_s=120.0)
    assert [(file, repetition) for _, file, repetition in legs(story)] == expected
    assert story.motions == ["TAKEOFF"] * len(expected)
    assert (story.requests.count("StartRecording"), story.requests.count("StopRecording")) == (1, 1)
    asked = sum(name.startswith("check:") for name in story.requests)
    assert asked == len(CHECKS) * (1 + len(expected)), "each takeoff passes the checks"
    assert story.state.session.result.value == "COMPLETE"


def test_each_takeoff_is_asked_for_what_of_the_battery_is_still_needed():
    mission = Mission(id="3", files=3, battery_needed_fraction=0.8, still_needed=(1.0, 0.75, 0.25))
    story = Story(SHIPPED, mission).start().after(0.5).select().until("MISSION_ENDED", limit_s=400.0)
    asked = [c.required_fraction for _, c in story.sent if isinstance(c, RunCheck) and c.check is CheckName.BATTERY]
    assert list(dict.fromkeys(asked)) == [0.8, 0.65, 0.35]
    assert story.motions.count("TAKEOFF") == 3


def test_touchdown_is_not_in_flight():
    story = at("MISSION touchdown")
    assert not story.state.flight.active


@pytest.mark.parametrize("check", CHECKS)
def test_a_check_that_fails_between_two_files_ends_the_mission(check):
    story = Story(SHIPPED, Mission(id="2", files=2)).start().after(0.5).select().until("MISSION", "flying").look()
    story.check_says[check] = {"ok": False, "message": "not good"}
    story.until("MISSION_ENDED")
    assert story.motions == []
    assert "next_takeoff_failed" in story.told
    assert story.state.session.result.value == "LANDED_EARLY"


def test_a_planner_that_does_not_load_the_next_file_ends_the_mission():
    story = at("MISSION touchdown")
    story.after(10.0).expect("DATA_CLEANUP")
    assert story.motions == []


def test_a_planner_that_refuses_the_next_file_ends_the_mission():
    story = at("MISSION touchdown")
    story.feed(ev.Reply, command_id=story.state.preflight.load.id, outcome=ev.Outcome.REFUSED, message="no file")
    story.expect("DATA_CLEANUP")


def test_a_battery_that_gets_critical_between_two_files_ends_the_mission():
    story = at("MISSION touchdown")
    story.say(battery_fraction=0.1)
    story.disobeyed.clear()
    story.later(0, "_effect", next(c for _, c in reversed(story.sent) if isinstance(c, LoadMission)))
    story.after(10.0).expect("DATA_CLEANUP")
    assert story.motions == []


def test_the_landed_of_the_first_file_does_not_end_the_second():
    story = Story(SHIPPED, Mission(id="2", files=2)).start().after(0.5).select()
    story.until("MISSION", "touchdown").until("MISSION", "flying").look()
    story.after(1.0).expect("MISSION", "flying")


def test_landed_without_the_last_waypoint_is_not_complete():
    story = at("MISSION flying")
    story.planner.says.update(waypoint=2)
    story.until("DATA_CLEANUP", limit_s=40.0)
    assert story.state.session.result.value == "LANDED_EARLY"


@pytest.mark.parametrize("files", [1, 2])
@pytest.mark.parametrize("says", [{"waypoints": 0}, {"waypoint": 0, "waypoints": 0}])
def test_a_planner_that_does_not_count_its_waypoints_has_flown_none(says, files):
    """Zero is what a message says whose author has filled nothing in: no mission is complete, no other file taken."""
    story = Story(SHIPPED, Mission(id="1", files=files)).start().after(0.5)
    story.planner.says.update(says)
    story.select().until("MISSION", "flying").after(0.5)
    story.planner.phase = ev.MissionPhase.LANDING
    story.vehicle.land()
    story.until("MISSION_ENDED")
    assert (story.state.session.result.value, story.motions.count("TAKEOFF")) == ("LANDED_EARLY", 1)


def test_landed_of_the_planner_alone_is_not_landed():
    story = at("MISSION flying")
    story.planner.says.update(phase=ev.MissionPhase.LANDED, waypoint=3)
    story.after(0.9).expect("MISSION", "flying")


def test_a_flight_that_was_flown_without_a_component_does_not_take_off_again_without_it():
    """Every takeoff passes the checks: what did not come back is found by the next ones."""
    story = Story(SHIPPED, Mission(id="2", files=2)).start().after(0.5).select().until("MISSION", "flying")
    story.fail("realsense_camera", 4).look().until("MISSION_ENDED")
    assert "TAKEOFF" not in story.motions
    assert story.state.session.result.value == "LANDED_EARLY"


def _second_takeoff_refused() -> Story:
    story = at("MISSION touchdown")
    story.disobeyed = ["TAKEOFF"]
    story.answers["TAKEOFF"] = ev.Outcome.REFUSED
    story.later(0, "_effect", next(c for _, c in reversed(story.sent) if isinstance(c, LoadMission)))
    return story.until("OUTREACH").look()


def test_given_up_after_the_first_file_is_not_unflown():
    story = _second_takeoff_refused()
    story.user("give_up")
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "LANDED_EARLY"


def test_retried_after_the_first_file_goes_on_with_the_second():
    story = _second_takeoff_refused()
    story.disobeyed, story.answers = [], {}
    story.user("retry")
    story.until("MISSION_ENDED", limit_s=120.0)
    assert [(file, repetition) for _, file, repetition in legs(story)] == [(1, 0), (0, 1), (1, 1)]
    assert story.state.session.result.value == "COMPLETE"


# --- several missions -------------------------------------------------------------------------------------------------


def test_several_missions_without_a_restart():
    story = Story(SHIPPED, MISSION, Mission(id="2"), MISSION).start().after(0.5)
    story.select().until("MISSION_ENDED", limit_s=120.0)
    assert [mission for mission, _, _ in legs(story)] == ["1", "2", "1"]
    assert story.told.count("mission_ended") == 3
    sessions = [c.session_id for c in story.since if isinstance(c, StopRecording)]
    assert sessions == ["test-001", "test-002", "test-003"]


@pytest.mark.parametrize("ended_by", ["", "land"])
def test_what_is_said_at_the_end_is_to_select_a_mission_only_where_none_follows(ended_by):
    story = Story(SHIPPED, MISSION, Mission(id="2")).start().after(0.5).select().until("MISSION", "flying").look()
    if ended_by:
        story.user(ended_by)
    story.until("MISSION_ENDED").after(200.0)
    said = [c.advice for c in story.since if getattr(c, "key", "") == "mission_ended"]
    assert said == (["Select the next mission."] if ended_by else ["Mission 2 follows.", "Select the next mission."])


def test_the_next_mission_can_be_selected_after_the_first():
    story = at("MISSION_ENDED").select().until("MISSION_ENDED")
    assert story.state.session.result.value == "COMPLETE"


def test_missions_to_come_are_dropped_when_one_ends_early_and_it_is_said():
    story = Story(SHIPPED, MISSION, Mission(id="2")).start().after(0.5).select().until("MISSION", "flying").look()
    story.user("land")
    story.until("MISSION_ENDED").after(5.0).expect("MISSION_ENDED")
    assert "queue_dropped" in story.told
    assert "2" in next(c.text for c in story.since if getattr(c, "key", "") == "queue_dropped")


@pytest.mark.parametrize("how", ["give_up", "abort"])
def test_giving_up_before_a_recording_does_not_start_the_next_mission(how):
    story = Story(SHIPPED, MISSION, Mission(id="2")).start().after(0.5)
    story.answers["check:battery"] = None
    story.select().look()
    story.user(how)
    story.expect("MISSION_INPUT").after(5.0).expect("MISSION_INPUT")
    assert story.requests == []
    assert "queue_dropped" in story.told


def test_giving_up_in_outreach_does_not_start_the_next_mission():
    story = Story(SHIPPED, MISSION, Mission(id="2")).start().after(0.5)
    story.check_says["battery"] = {"ok": False}
    story.select().until("OUTREACH").look()
    story.user("give_up")
    story.expect("MISSION_INPUT").after(5.0).expect("MISSION_INPUT")


def test_nothing_of_the_last_mission_remains():
    story = at("MISSION_ENDED")
    story.select()
    state = story.state
    assert (state.session.result.value, state.recording.asked, state.recording.location, state.flight.was_armed) == (
        "",
        False,
        "",
        False,
    )
    assert (state.peers.planner, state.peers.recorder, state.flight.active, state.landing.since_ns) == (
        None,
        None,
        False,
        None,
    )


def test_a_vehicle_that_others_arm_between_missions_sends_nothing_to_the_recorder():
    story = at("MISSION_ENDED")
    story.select()
    story.answers["check:battery"] = None
    story.user("give_up")
    story.expect("MISSION_INPUT")
    story.say(armed=True).until("PILOT", limit_s=0.5)
    story.say(armed=False).look()
    story.user("acknowledge")
    story.expect("MISSION_ENDED")
    assert story.requests == []


# --- the data ---------------------------------------------------------------------------------------------------------


def test_the_recording_is_stopped_once_and_followed_to_its_end():
    story = at("LAND descending").until("MISSION_ENDED")
    assert story.requests == ["StopRecording"]
    assert story.state.recording.location == "/data/test-001"
    assert "/data/test-001" in story.state.shown.text


@pytest.mark.parametrize("outcome", [ev.Outcome.REFUSED, ev.Outcome.UNAVAILABLE])
def test_a_recorder_that_refuses_to_stop_calls_for_a_person(outcome):
    story = at("LAND descending")
    story.answers["StopRecording"] = outcome
    story.until("OUTREACH")
    assert "data_incomplete" in story.told


@pytest.mark.parametrize("outcome", [ev.Outcome.TIMED_OUT, ev.Outcome.BROKEN, None])
def test_a_stop_that_is_not_answered_is_followed_by_the_status(outcome):
    story = at("LAND descending")
    story.answers["StopRecording"] = outcome
    story.until("DATA_CLEANUP")
    if outcome is not None:
        story.later(S, "_effect", next(c for c in story.since if isinstance(c, StopRecording)))
    story.until("MISSION_ENDED")
    assert (story.state.session.data_result.value, "data_incomplete" in story.told) == ("COMPLETE", False)


@pytest.mark.parametrize("outcome", [ev.Outcome.TIMED_OUT, ev.Outcome.BROKEN, ev.Outcome.ACCEPTED])
def test_a_recorder_that_goes_on_recording_after_its_stop_calls_for_a_person_who_asks_it_again(outcome):
    story = at("LAND descending")
    story.answers["StopRecording"] = outcome
    story.disobeyed.append("StopRecording")
    story.until("DATA_CLEANUP")
    story.after(5.5).expect("DATA_CLEANUP")
    story.after(1.0).expect("OUTREACH")
    story.answers.clear()
    story.disobeyed.clear()
    story.user("retry")
    story.until("MISSION_ENDED")
    assert story.requests.count("StopRecording") == 2
    assert story.state.session.data_result.value == "COMPLETE"


def test_a_recorder_that_said_complete_before_it_was_asked_to_stop_is_not_believed():
    story = at("LAND descending")
    story.disobeyed.append("StopRecording")
    story.recorder.phase = ev.RecordingPhase.COMPLETE
    story.until("DATA_CLEANUP")
    story.silent.append("recorder")
    story.after(5.3).expect("OUTREACH")
    assert story.told == ["failure_while_landing", "data_cleanup", "data_incomplete"]


def test_a_recorder_that_falls_silent_calls_for_a_person():
    story = at("DATA_CLEANUP")
    story.silent.append("recorder")
    story.after(5.3).expect("OUTREACH")


def test_a_flight_is_complete_and_its_data_is_not_when_something_of_it_was_not_recorded():
    story = at("DATA_CLEANUP")
    story.recorder.says["lost"] = "second/cameras: 37.9 s, in which nothing was recorded (the storage was full)"
    story.until("MISSION_ENDED")
    assert (story.state.session.result.value, story.state.session.data_result.value) == ("LANDED_EARLY", "INCOMPLETE")
    assert story.state.shown.level is Level.ERROR
    assert "its data is INCOMPLETE" in story.state.shown.text
    assert story.told[-1] == "mission_ended_incomplete"


def flies_on_behind_the_end(story):
    story.vehicle.height, story.planner.flown_ns = 20.0, -(10**18)
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND)
    story.landing_says = ev.Landed.ON_GROUND
    story.planner.says.update(phase=ev.MissionPhase.LANDED, waypoint=3)
    story.until("DATA_CLEANUP", limit_s=15.0)
    story.landing_says = None
    for each in (story.vehicle.says, story.planner.says):
        each.clear()


def is_given_up(story):
    story.vehicle.height, story.planner.flown_ns, story.vehicle.obeys = 25.0, -(10**18), False
    story.silent.append("autopilot")
    story.after(9.0).user("acknowledge")
    story.expect("DATA_CLEANUP")


def is_given_up_and_heard_again(story):
    is_given_up(story)
    story.until("MISSION_ENDED").after(5.0).silent.clear()
    story.vehicle.obeys = True
    story.after(2.0).expect("LAND")


def is_disarmed_after_it_flew_on(story):
    flies_on_behind_the_end(story)
    story.after(2.0).expect("LAND")
    story.vehicle.obeys, story.vehicle.speed = False, 0.0
    story.after(60.0)
    story.vehicle.says.update(armed=False, landed=ev.VehicleLanded.UNKNOWN)
    story.after(90.0).user("acknowledge")


def is_acknowledged_unheard(story):
    story.vehicle.height = 25.0
    story.say(mode="POSCTL", pilot_in_control=True).after(2.0).expect("PILOT")
    story.silent.append("autopilot")
    story.after(40.0).user("acknowledge")


@pytest.mark.parametrize(
    "how",
    [
        flies_on_behind_the_end,
        is_given_up,
        is_given_up_and_heard_again,
        is_disarmed_after_it_flew_on,
        is_acknowledged_unheard,
    ],
)
def test_data_that_ends_before_the_flight_is_not_complete_whatever_the_recorder_says(how):
    story = at("MISSION flying").look()
    how(story)
    story.until("MISSION_ENDED", limit_s=100.0)
    assert story.state.session.data_result.value == "INCOMPLETE"
    assert story.told[-1] == "mission_ended_incomplete"
    assert lost_of(story.state) == "what the vehicle flew on behind the end of the recording"


def test_what_is_said_to_be_lost_before_the_data_is_complete_decides_nothing():
    story = at("DATA_CLEANUP")
    story.recorder.phase, story.recorder.says["lost"] = ev.RecordingPhase.MERGING, "something"
    story.report()
    story.expect("DATA_CLEANUP")


def test_the_data_of_the_last_mission_is_forgotten_with_it():
    story = at("MISSION_ENDED")
    assert story.state.session.data_result.value == "COMPLETE"
    story.select()
    assert story.state.session.data_result.value == ""


def test_incomplete_data_retried_and_complete():
    story = at("OUTREACH data")
    assert "module2: no space left" in story.state.shown.text
    story.recorder.fails = False
    story.user("retry")
    story.until("MISSION_ENDED")
    assert story.requests == ["StopRecording"]
    assert story.state.session.result.value == "LANDED_EARLY", "the flight's own result"


def test_the_failure_of_before_does_not_end_the_retry_at_once():
    story = at("OUTREACH data")
    story.user("retry")
    story.report()
    story.expect("DATA_CLEANUP")


def test_a_retry_that_fails_again_calls_again():
    story = at("OUTREACH data")
    story.user("retry")
    story.until("OUTREACH")
    story.user("give_up")
    story.expect("MISSION_ENDED")
    said = story.state.session
    assert (said.result.value, said.data_result.value) == ("LANDED_EARLY", "INCOMPLETE"), "said apart"


def test_a_retry_of_a_recorder_that_stays_failed_calls_again():
    story = at("OUTREACH data")
    story.disobeyed.append("StopRecording")
    story.look().user("retry")
    assert story.expect("DATA_CLEANUP").requests == ["StopRecording"]
    story.until("OUTREACH", limit_s=10.0)


def test_given_up_data_says_where_it_lies_and_nothing_more_is_sent():
    story = at("OUTREACH data")
    story.recorder.says["location"] = "/data/test-001/partial"
    story.report()
    story.user("give_up")
    assert story.requests == []
    assert "/data/test-001/partial" in story.state.shown.text


def test_outreach_waits_for_a_person_for_ever():
    at("OUTREACH data").after(500.0).expect("OUTREACH")


@pytest.mark.parametrize("place", ["OUTREACH recorded", "START_RECORDING", "LOAD_MISSION"])
def test_given_up_before_takeoff_the_recording_is_stopped_and_merged(place):
    story = at(place)
    story.user("give_up")
    story.until("MISSION_ENDED")
    assert story.requests == ["StopRecording"]
    assert story.state.session.result.value == "NOT_FLOWN"


@pytest.mark.parametrize(
    "place, command, result",
    [
        ("MISSION flying", "land", "LANDED_EARLY"),
        ("MISSION touchdown", "give_up", "LANDED_EARLY"),
        ("PILOT landed", "acknowledge", "PILOT"),
        ("TAKEOFF arming", "land", "NOT_FLOWN"),
        ("LOAD_MISSION", "abort", "NOT_FLOWN"),
    ],
)
def test_every_way_to_the_end_has_its_result(place, command, result):
    story = at(place)
    assert story.user(command)[0] == "DONE"
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == result
    assert result in story.state.shown.text


def test_a_planner_that_lands_before_its_last_waypoint_has_not_flown_the_mission():
    story = at("MISSION flying")
    story.planner.says.update(phase=ev.MissionPhase.LANDING, waypoint=2, waypoints=3)
    story.report()
    story.fail("imu", 16).until("MISSION_ENDED")
    assert story.state.session.result.value == "LANDED_EARLY"


@pytest.mark.parametrize("message,said", [("2.1 GB, nothing was lost", " (2.1 GB, nothing was lost)."), ("", ".")])
def test_where_the_data_is_comes_with_what_the_recorder_says_of_it(message, said):
    story = at("DATA_CLEANUP")
    story.recorder.says["message"] = message
    story.until("MISSION_ENDED")
    (text,) = [c.text for _, c in story.sent if isinstance(c, Notify) and c.key == "mission_ended"]
    assert text.endswith(f"The data is at {story.state.recording.location}{said}")


def test_a_mission_that_was_never_begun_leaves_the_recording_of_the_last_one_alone():
    """A pilot arms after the end, and a mission is selected all the same: that one recorded nothing."""
    story = at("MISSION_ENDED")
    story.say(armed=True, mode="STABILIZED").after(1.0).look().select()
    story.expect("PILOT")
    story.vehicle.says.clear()
    story.after(2.0)
    story.user("acknowledge")
    story.expect("MISSION_ENDED")
    assert "StopRecording" not in story.requests
