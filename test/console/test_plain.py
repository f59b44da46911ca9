"""The lines of the plain mode: one for each change, none without one."""

from __future__ import annotations

from dataclasses import replace

from console_scenes import CAMERA, CHECKS, GPS, LRF, MISSIONS, NOW_S, SCENES

from amaze_autonomy.console.model import Answer, Desk, Note, Question, Request, RequestKind, Verdict
from amaze_autonomy.console.plain import changes
from amaze_autonomy.engine.events import UserCommand

HOLDING = SCENES["hold"].snapshot.message
START = Desk(started_s=NOW_S, received_s=NOW_S)


def lines(before, after, before_s=NOW_S, after_s=NOW_S):
    return changes(before, before_s, after, after_s)


def test_of_several_messages_at_once_none_is_left_out():
    notes = tuple(Note("10:00:00", 1, f"message {number}", "", number) for number in range(1, 6))
    before = replace(SCENES["hold"], run="r-1", notes=notes[:2])
    assert lines(before, replace(before, notes=notes)) == [f"WARNING   message {number}" for number in (3, 4, 5)]
    anew = replace(before, run="r-2", notes=notes[:3])
    assert lines(replace(before, run="r-1"), anew) == [f"WARNING   message {number}" for number in (1, 2, 3)]


def test_of_the_messages_before_this_console_was_there_the_last_one_is_shown():
    note = Note("10:00:00", 0, SCENES["hold"].snapshot.message, "", 1)
    last = Note("10:00:01", 0, "Landing.", "", 2)
    before = replace(SCENES["hold"], notes=())
    assert lines(before, replace(before, run="r", notes=(note, last))) == ["INFO      Landing."]
    assert lines(before, replace(before, run="r", notes=(last, note))) == []


def test_nothing_new_is_no_line():
    for desk in SCENES.values():
        assert lines(desk, desk) == []


def test_time_that_passes_is_no_line():
    hold = SCENES["hold"]
    shorter = tuple(
        replace(each, time_left_s=each.time_left_s and each.time_left_s - 1.0) for each in hold.snapshot.failures
    )
    later = replace(hold, snapshot=replace(hold.snapshot, time_left_s=11.4, failures=shorter), received_s=NOW_S + 0.8)
    assert lines(hold, later) == []


def test_the_first_state_is_told_whole():
    assert lines(START, SCENES["hold"]) == [
        "STATE     HOLD (holding), IN FLIGHT, mission 1 Short square, less than a minute, 8 s left",
        f"WARNING   {HOLDING}",
        "FAULT     gps code 2: continue: 3.1 Hz, expected 5 Hz",
        "FAULT     realsense_camera code 4: wait, then continue, 21 s left (wait limit): "
        "node /realsense: connection refused",
        "FAULT     lrf code 8: wait, then land, 8 s left (restart limit): "
        "no message on /lrf/range for longer than 0.3 s",
        "PROGRESS  waypoint 3 of 8, 2 reached",
        "RECORDING recording",
        "WAIT      lrf, realsense_camera",
        "ADVICE    Wait, or land.",
        "COMMANDS  hold, land, abort",
        "MISSION   1: Short square, less than a minute (42 s, battery needed 30 %)",
        "MISSION   2: Survey of 20 m x 10 m (6 min 52 s, battery needed 71 %)",
        "MISSION   wall: Along the north wall (CANNOT BE FLOWN: wall.csv line 7: z is -1.5 m, must be at least 0.5 m)",
    ]


def test_a_failure_that_turns_into_a_landing_and_others_that_clear():
    hold = SCENES["hold"]
    land = replace(
        hold, snapshot=replace(hold.snapshot, state="LAND", failures=(replace(LRF, action="land", fallback=""), CAMERA))
    )
    assert lines(hold, land) == [
        "STATE     LAND (holding), IN FLIGHT, mission 1 Short square, less than a minute, 8 s left",
        f"WARNING   {HOLDING}",
        "FAULT     lrf code 8: land, 8 s left (restart limit): no message on /lrf/range for longer than 0.3 s",
        "FAULT     mission_camera code 16: land: no message on /camera/image for longer than 0.3 s",
        "CLEARED   gps",
        "CLEARED   realsense_camera",
        "ADVICE    Wait, or land.",
    ]


def test_checks_are_told_when_their_verdict_changes():
    preflight = SCENES["preflight"]
    before = replace(preflight, snapshot=replace(preflight.snapshot, checks=CHECKS[:4]))
    after = replace(
        preflight, snapshot=replace(preflight.snapshot, checks=(replace(CHECKS[0], value=4.0), *CHECKS[4:]))
    )
    assert lines(before, after) == [
        "CHECK     FAIL    battery fraction 25 %, limit 30 %, age 0.07 s: "
        "25% is left, no mission starts below 30%: change or charge the battery",
        "CHECK     PASS    on ground: distance to ground 0.002 m, limit 0.1 m, age 0.10 s",
        "CHECK     UNKNOWN state estimation -: asked, no answer yet",
    ]


def test_rows_of_the_same_name_are_told_apart():
    preflight = SCENES["preflight"]
    twins = (CHECKS[0], replace(CHECKS[4], name=CHECKS[0].name))
    before = replace(preflight, snapshot=replace(preflight.snapshot, checks=twins))
    assert lines(before, replace(before, snapshot=replace(before.snapshot, checks=(*twins[:1], twins[1])))) == []
    both = replace(before, snapshot=replace(before.snapshot, checks=(twins[0], twins[0])))
    assert lines(before, both) == ["CHECK     PASS    watchdog: gps 5 Hz, limit 3.5 ... 6.5 Hz, age 0.19 s"]


def test_progress_in_steps_of_ten_percent():
    desk = SCENES["data-cleanup"]
    told = []
    for percent in range(43, 64):
        after = replace(desk, snapshot=replace(desk.snapshot, recording_progress=percent / 100))
        told += lines(desk, after)
        desk = after
    assert told == ["RECORDING transferring 50 %", "RECORDING transferring 60 %"]


def test_progress_of_a_merge_names_the_time_that_it_still_takes():
    desk = SCENES["data-cleanup-merging"]
    after = replace(desk, snapshot=replace(desk.snapshot, recording_progress=0.4))
    assert lines(desk, after) == ["RECORDING merging 40 %, about 1 min 12 s left"]


def test_what_is_wrong_with_a_recording_is_told_once_and_only_of_this_one():
    before, after = SCENES["data-cleanup-merging"], SCENES["data-cleanup-trouble"]
    trouble = "RECORDER  second: the cable is cut: tried again for 20 s"
    assert trouble in changes(before, NOW_S, after, NOW_S)
    assert trouble not in changes(after, NOW_S, after, NOW_S + 0.1)
    other = replace(after, collecting=replace(after.collecting, session_id="another"))
    assert trouble not in changes(before, NOW_S, other, NOW_S)


def test_the_end_names_result_and_data():
    assert lines(SCENES["data-cleanup"], replace(SCENES["mission-ended"], interactive=False)) == [
        "STATE     MISSION_ENDED, mission 1 Short square, less than a minute",
        "INFO      Mission ended: COMPLETE. The data is at /data/20261121T101431-001.bag.",
        "RECORDING complete 100 %",
        "ADVICE    Select the next mission.",
        "DATA      /data/20261121T101431-001.bag",
        "RESULT    COMPLETE",
    ]


def test_lost_contact_is_told_once_and_so_is_its_return():
    hold = replace(SCENES["hold"], received_s=NOW_S)
    assert lines(hold, hold, NOW_S + 2.9, NOW_S + 3.2) == [
        "CONTACT   LOST: the engine (/autonomy) has been silent for 3 s. Watch the vehicle."
    ]
    assert lines(hold, hold, NOW_S + 3.2, NOW_S + 60.0) == []
    assert lines(hold, replace(hold, received_s=NOW_S + 60.0), NOW_S + 60.0, NOW_S + 60.1) == [
        "CONTACT   the engine is heard again"
    ]


def test_waiting_for_the_link():
    assert lines(START, replace(START, link="Waiting for the ROS master")) == ["WAIT      Waiting for the ROS master"]


def test_requests_answers_questions_and_errors():
    hold = SCENES["hold"]
    request = Request(RequestKind.COMMAND, 1, UserCommand.LAND, sent_s=NOW_S)
    asked = replace(hold, requests=(request,))
    assert lines(asked, asked, NOW_S + 2.9, NOW_S + 3.1) == ["ANSWER    land: none for 3 s"]
    assert lines(asked, replace(hold, answer=Answer("land", Verdict.DONE, "Landing.", NOW_S))) == [
        "ANSWER    land: DONE Landing."
    ]
    assert lines(hold, replace(hold, error="Not sent: land.")) == ["INPUT     Not sent: land."]
    assert lines(hold, replace(hold, question=Question("LAND?", request))) == [
        "QUESTION  LAND? Type y and Enter for yes, anything else for no."
    ]


def test_somebody_who_can_type_is_asked_for_a_mission_and_nobody_else():
    asked = "QUESTION  Which mission? Type its id and Enter; several: 1 2 3."
    unlisted = replace(SCENES["mission-input"], missions=None)
    assert lines(unlisted, SCENES["mission-input"])[-1] == asked
    alone = replace(SCENES["mission-input"], interactive=False)
    assert asked not in lines(replace(alone, missions=None), alone)


def test_who_has_selected_is_not_asked_again_but_who_was_refused_is():
    asked = "QUESTION  Which mission? Type its id and Enter; several: 1 2 3."
    waiting = replace(
        SCENES["mission-input"], requests=(Request(RequestKind.SELECT, 1, missions=("1",), sent_s=NOW_S),)
    )
    for verdict, again in ((Verdict.DONE, []), (Verdict.REFUSED, [asked])):
        answer = Answer("mission 1", verdict, "because", NOW_S)
        after = replace(SCENES["mission-input"], answer=answer)
        assert lines(waiting, after) == [f"ANSWER    mission 1: {verdict.value} because", *again]


def test_an_engine_without_missions():
    empty = replace(SCENES["mission-input"], missions=())
    assert lines(replace(empty, missions=None), empty) == ["MISSION   none: look at the engine's missions.yaml"]


def test_files_and_repetitions():
    mission = replace(SCENES["mission"], missions=MISSIONS)
    next_file = replace(
        mission, snapshot=replace(mission.snapshot, file_index=1, files=2, repetitions=3, failures=(GPS,))
    )
    assert lines(mission, next_file) == ["PROGRESS  file 2 of 2, repetition 1 of 3"]
