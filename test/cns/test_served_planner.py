"""Our planner in the place of the mission sequencer: what is answered, what is flown, what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from serving import BACK, EAST_LINE, LINE, MS, POINTS, S, Serving, turned

from amaze_autonomy.cns import tables
from amaze_autonomy.cns.served_planner import REQUESTS, Stage
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase
from amaze_autonomy.missions import Controller, Frame, Place

pytestmark = pytest.mark.long

P = MissionPhase
A, R = tables.Answer, tables.Request
NO, YES, DONE, BOTH = A.REFUSED.name, A.ACCEPTED.name, A.COMPLETED.name, A.DONE.name
WHOLE = [
    ("ARM", YES),
    ("ARM", DONE),
    ("TAKEOFF", YES),
    ("TAKEOFF", DONE),
    ("UNDEF", DONE),
    ("LAND", YES),
    ("LAND", DONE),
    ("DISARM", YES),
    ("DISARM", DONE),
]


def test_a_whole_mission_is_flown_and_answered_in_pairs():
    serving = Serving()
    serving.fly()
    assert serving.craft.height_m == pytest.approx(1.2, abs=0.35)  # it passes the height by 0.2 m
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert (serving.stage, serving.flying.phase) == ("HOVER", P.FLYING)
    serving.ask(R.LAND)
    serving.until_answer(R.LAND, A.COMPLETED)
    assert (serving.stage, serving.craft.armed) == ("LANDED", False)
    serving.ask(R.DISARM)
    assert serving.answers == WHOLE
    assert serving.reached == pytest.approx([tuple(each) for each in POINTS])
    assert (serving.stage, serving.commands) == ("IDLE", ["TAKEOFF", "LAND"])
    (load,) = serving.loads
    assert (load.session_id, load.mission_id, load.frame) == ("begin_1", "cns_7", Frame.START_HEADING)
    assert turned(load.waypoints)[:2] == pytest.approx(POINTS[:2])
    assert load.waypoints[-1].hold_s == 60.5  # the hover, which ends by itself


def test_a_second_mission_has_another_session_and_another_id_and_needs_its_own_waypoints():
    serving = Serving()
    serving.fly()
    serving.ask(R.LAND)
    serving.until_answer(R.LAND, A.COMPLETED)
    assert serving.ask(R.ARM, 8) == (("ARM", NO),)  # not before DISARM
    serving.ask(R.DISARM)
    serving.ask(R.ARM, 8)
    serving.ask(R.TAKEOFF, 8)
    serving.until_answer(R.TAKEOFF, A.REFUSED)
    serving.give(POINTS[:2])
    serving.ask(R.TAKEOFF, 8)
    serving.until(lambda: serving.stage == "MISSION")
    assert [(each.session_id, each.mission_id, len(each.waypoints)) for each in serving.loads] == [
        ("begin_1", "cns_7", 3),
        ("begin_2", "cns_8", 2),
    ]


def test_arm_moves_nothing_and_is_said_once():
    serving = Serving()
    assert serving.ask(R.ARM) == (("ARM", YES), ("ARM", DONE))
    serving.run(5 * S)
    assert (serving.craft.armed, serving.commands, serving.loads) == (False, [], [])
    assert serving.ask(R.DISARM) == (("DISARM", YES), ("DISARM", DONE))
    assert serving.stage == "IDLE"


def test_what_may_be_in_the_air_is_not_disarmed():
    serving = Serving()
    serving.ask(R.ARM)
    serving.silent = ("autopilot",)
    serving.run(2 * S)
    assert serving.ask(R.DISARM) == (("DISARM", NO),)
    assert serving.commands == []


def test_arm_is_refused_of_a_planner_that_says_nothing():
    serving = Serving()
    serving.silent = ("planner",)
    serving.run(2 * S)
    assert serving.ask(R.ARM) == (("ARM", NO),)
    assert serving.notices == ["ARM is refused: our planner says nothing"]


STAGES = {
    Stage.IDLE: lambda _: None,
    Stage.ARMED: lambda serving: serving.ask(R.ARM),
    Stage.TAKEOFF: lambda serving: (serving.take_off(), serving.until(lambda: serving.craft.armed)),
    Stage.HOVER: lambda serving: (serving.fly(), serving.until_answer(R.UNDEF, A.COMPLETED)),
    Stage.MISSION: lambda serving: serving.fly(),
    Stage.HOLD: lambda serving: (serving.fly(), serving.ask(R.HOLD), serving.until_answer(R.HOLD, A.DONE)),
    Stage.LAND: lambda serving: (serving.fly(), serving.ask(R.LAND), serving.run(S // 2)),
    Stage.LANDED: lambda serving: (serving.fly(), serving.ask(R.LAND), serving.until_answer(R.LAND, A.COMPLETED)),
}


def in_stage(stage):
    serving = Serving()
    STAGES[stage](serving)
    assert serving.stage == stage.name
    return serving


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.name)
def test_what_does_not_fit_and_what_has_no_counterpart_is_refused_and_changes_nothing(stage):
    serving = in_stage(stage)
    before = list(serving.commands), len(serving.loads), serving.craft.mode
    unfit = [request for request, row in REQUESTS.items() if stage not in row.fits]
    for request in (*unfit, R.UNDEF, 101):
        at = len(serving.answers)
        if request == 101:  # READ
            serving.served.heard(serving.t_ns, "request", type("Message", (), {"id": 7, "request": 101}))
            assert serving.served.outbox[0].fields["response"] is serving.served.outbox[0].fields["completed"] is False
            assert serving.served.outbox[1].text == "request 101 is refused: our planner has no counterpart"
            serving.served.outbox.clear()
        else:
            assert serving.ask(request) == ((request.name, NO),), request
            assert len(serving.answers) == at + 1
    assert (list(serving.commands), len(serving.loads), serving.craft.mode) == before
    assert serving.stage == stage.name


@pytest.mark.parametrize("stage", [each for each in STAGES if each is not Stage.IDLE], ids=lambda stage: stage.name)
def test_with_another_id_nothing_arms_flies_or_disarms(stage):
    serving = in_stage(stage)
    before = list(serving.commands), len(serving.loads)
    airborne = serving.craft.landed.name != "ON_GROUND"
    for request in REQUESTS:
        if request is not R.LAND or not airborne:
            assert serving.ask(request, 8) == ((request.name, NO),), request
    assert (list(serving.commands), len(serving.loads)) == before
    assert set(serving.numbers[-7:]) == {8}  # who asked is answered


@pytest.mark.parametrize("stage", [Stage.HOVER, Stage.MISSION, Stage.HOLD], ids=lambda stage: stage.name)
def test_a_landing_is_never_refused_in_flight_whatever_its_id(stage):
    serving = in_stage(stage)
    assert serving.ask(R.LAND, 8) == (("LAND", YES),)
    serving.until_answer(R.LAND, A.COMPLETED)
    assert not serving.craft.armed


def test_a_landing_of_a_vehicle_that_says_nothing_is_not_refused_either():
    serving = Serving()
    serving.silent = ("autopilot",)
    serving.run(3 * S)
    assert serving.ask(R.LAND, 9) == (("LAND", YES),)
    assert serving.commands == ["LAND"]


def test_a_hold_and_a_resume_are_answered_when_they_show():
    serving = in_stage(Stage.MISSION)
    assert serving.ask(R.HOLD) == ()
    serving.until_answer(R.HOLD, A.DONE)
    assert (serving.stage, serving.flying.phase) == ("HOLD", P.HOLDING)
    assert serving.ask(R.HOLD) == (("HOLD", NO),)
    assert serving.ask(R.RESUME) == ()
    serving.until_answer(R.RESUME, A.DONE)
    assert serving.stage == "MISSION"
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert len(serving.reached) == 3


@pytest.mark.parametrize("files", [(), (LINE,)], ids=["given", "configured"])
def test_a_hold_during_the_takeoff_puts_its_end_off(files):
    serving = Serving(*files)
    if not files:
        serving.give()
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until(lambda: serving.flying.phase is P.TAKING_OFF and serving.craft.height_m > 0.2)
    serving.ask(R.HOLD)
    serving.until_answer(R.HOLD, A.DONE)
    serving.run(5 * S)
    assert ("TAKEOFF", DONE) not in serving.answers
    serving.ask(R.RESUME)
    serving.until_answer(R.TAKEOFF, A.COMPLETED)
    assert serving.craft.height_m > 0.6


@pytest.mark.parametrize("request_", [R.HOLD, R.HOVER], ids=lambda request: request.name)
def test_a_hold_that_does_not_show_is_refused_within_its_limit(request_):
    serving = in_stage(Stage.MISSION)
    serving.flying.command = lambda *_: ""  # accepted, and nothing comes of it
    began_ns = serving.t_ns
    serving.ask(request_)
    serving.until_answer(request_, A.REFUSED)
    assert serving.t_ns - began_ns == pytest.approx(3 * S, abs=100 * MS)
    assert serving.stage == "MISSION"
    del serving.flying.command
    serving.ask(R.HOLD)
    serving.until_answer(R.HOLD, A.DONE)
    serving.ask(R.RESUME)
    serving.until(lambda: serving.stage == "MISSION")


def test_hover_ends_the_mission_in_the_air_and_stands():
    serving = in_stage(Stage.MISSION)
    assert serving.ask(R.HOVER) == (("HOVER", YES),)
    serving.until_answer(R.HOVER, A.COMPLETED)
    assert (serving.stage, serving.flying.phase) == ("HOVER", P.HOLDING)
    assert serving.ask(R.RESUME) == (("RESUME", NO),)
    serving.ask(R.HOLD)
    serving.until_answer(R.HOLD, A.DONE)
    assert serving.ask(R.RESUME) == (("RESUME", BOTH),)  # back to its hover
    serving.give()
    serving.run(30 * S)
    assert (serving.stage, serving.flying.phase) == ("HOVER", P.HOLDING)
    assert serving.notices[-1] == (
        "waypoints are not taken: our planner loads on the ground alone: send them before TAKEOFF"
    )
    assert len(serving.reached) < 3


@pytest.mark.parametrize("stage", [Stage.MISSION, Stage.HOLD], ids=lambda stage: stage.name)
def test_an_abort_in_flight_lands(stage):
    serving = in_stage(stage)
    assert serving.ask(R.ABORT) == (("ABORT", BOTH),)
    assert serving.ask(R.HOLD) == (("HOLD", NO),)
    serving.until(lambda: serving.stage == "LANDED")
    assert serving.ask(R.DISARM) == (("DISARM", YES), ("DISARM", DONE))
    assert ("UNDEF", DONE) not in serving.answers


def test_an_abort_before_lift_off_ends_the_takeoff():
    serving = Serving()
    serving.take_off()
    serving.run(100 * MS)
    serving.ask(R.ABORT)
    assert serving.answers[-2:] == [("TAKEOFF", NO), ("ABORT", BOTH)]
    serving.until(lambda: serving.stage == "LANDED")
    serving.run(10 * S)
    assert not serving.craft.armed
    assert serving.craft.height_m == 0.0
    assert "TAKEOFF" not in serving.commands


def test_a_takeoff_that_our_planner_still_makes_is_not_over_though_it_is_not_armed_yet():
    serving = Serving()
    serving.take_off()
    serving.until(lambda: serving.flying.phase is P.TAKING_OFF)
    serving.run(50 * MS)
    assert not serving.craft.armed
    serving.flying.command = lambda *_: ""  # late
    serving.ask(R.ABORT)
    assert serving.stage == "LAND"
    assert serving.ask(R.DISARM) == (("DISARM", NO),)


def test_a_landing_while_waypoints_are_awaited_ends_the_takeoff():
    serving = Serving()
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.ask(R.LAND)
    serving.give()
    serving.run(3 * S)
    assert serving.answers[2:] == [("TAKEOFF", YES), ("LAND", YES), ("TAKEOFF", NO), ("LAND", DONE)]
    assert (serving.loads, serving.stage) == ([], "LANDED")


def test_after_the_last_waypoint_it_lands_by_itself_when_nobody_asks():
    serving = Serving(hover_s=5.0)
    serving.fly()
    serving.until_answer(R.UNDEF, A.COMPLETED)
    ended_ns = serving.t_ns
    serving.until(lambda: serving.flying.phase is P.LANDING)
    assert (serving.t_ns - ended_ns) / S == pytest.approx(5.0, abs=0.5)
    serving.until(lambda: serving.stage == "LANDED")
    assert serving.ask(R.LAND) == (("LAND", YES), ("LAND", DONE))  # it is so already
    assert serving.commands == ["TAKEOFF"]
    assert serving.answers.count(("UNDEF", DONE)) == 1


def test_a_landing_at_the_last_waypoint_is_no_end_of_the_mission():
    serving = in_stage(Stage.MISSION)
    serving.until(lambda: len(serving.reached) == 3)
    serving.ask(R.LAND)
    serving.until_answer(R.LAND, A.COMPLETED)
    assert ("UNDEF", DONE) not in serving.answers


def test_a_waypoint_is_told_once():
    serving = in_stage(Stage.MISSION)
    serving.until(lambda: len(serving.reached) == 2)
    serving.served.told(serving.t_ns, replace(serving.flying.status, waypoint=1))
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert serving.reached == pytest.approx([tuple(each) for each in POINTS])


@pytest.mark.parametrize("phase", [P.LANDING, P.LANDED], ids=lambda phase: phase.name)
def test_the_end_is_told_of_a_flight_whose_last_hold_was_missed(phase):
    serving = Serving(hover_s=0.0)
    serving.fly()
    serving.until(lambda: serving.flying.status.waypoint == 3)
    serving.silent = ("planner",)
    serving.flying.until(lambda: serving.flying.phase is phase)
    serving.silent = ()
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert len(serving.reached) == 3


# --- waypoints --------------------------------------------------------------------------------------------------------


def test_waypoints_are_cleared_appended_and_inserted():
    serving = Serving()
    serving.give(POINTS[2:], action=1)
    serving.give(POINTS[:2], action=0)
    serving.give(POINTS[2:], action=1)
    serving.give([(1.0, 2.0, 3.0, -270.0, 4.0)], action=2, idx=1)
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    wanted = [POINTS[0], (1.0, 2.0, 3.0, 90.0, 4.0), *POINTS[1:]]
    assert turned(serving.loads[0].waypoints)[:-1] == pytest.approx(wanted[:-1])
    assert len(serving.loads[0].waypoints) == 4


@pytest.mark.parametrize(
    "more, why",
    [
        ({"action": 2, "idx": 4}, "action 2 at 4 of 3 waypoints is none"),
        ({"action": 9}, "action 9 at 0 of 3 waypoints is none"),
        ({"reference": 0}, "GLOBAL is along axes of the estimator"),
        ({"reference": 2}, "CUR_POS is along axes of the estimator"),
        ({"reference": 9}, "GLOBAL is along axes of the estimator"),
        ({"is_global": True}, "GLOBAL is along axes of the estimator"),
    ],
)
def test_a_list_that_cannot_be_taken_changes_nothing_and_is_named(more, why):
    serving = Serving()
    serving.give()
    serving.give([(9.0, 9.0, 9.0, 0.0, 0.0)], **more)
    assert why in serving.notices[-1]
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    assert turned(serving.loads[0].waypoints)[:2] == pytest.approx(POINTS[:2])
    assert len(serving.loads[0].waypoints) == 3


@pytest.mark.parametrize("given_s, taken_s", [(0.5, 60.5), (100.0, 120.0), (200.0, 200.0)])
def test_the_last_hold_is_longer_by_the_hover_as_far_as_our_planner_takes_it(given_s, taken_s):
    serving = Serving()
    serving.give([*POINTS[:2], (*POINTS[2][:4], given_s)])
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    assert serving.loads[0].waypoints[-1].hold_s == taken_s


def test_where_it_stands_is_where_it_starts():
    serving = Serving()
    serving.give(reference=3)
    serving.fly()
    assert serving.loads[0].frame is Frame.START_HEADING


def test_a_takeoff_waits_a_second_for_its_waypoints_and_is_refused_without():
    serving = Serving()
    serving.ask(R.ARM)
    assert serving.ask(R.TAKEOFF) == (("TAKEOFF", YES),)
    serving.run(1500 * MS)
    assert serving.answers[-1] == ("TAKEOFF", NO)
    assert serving.notices[-1] == (
        "TAKEOFF is refused: no waypoints have come, and missions.yaml has no local mission 7"
    )
    assert serving.stage == "ARMED"
    serving.ask(R.TAKEOFF)
    serving.run(500 * MS)
    serving.give()
    serving.until_answer(R.TAKEOFF, A.COMPLETED)


@pytest.mark.parametrize("refused", ["load", "TAKEOFF"])
def test_a_takeoff_that_our_planner_refuses_is_refused_with_its_reason_and_may_be_asked_again(refused):
    serving = Serving()
    serving.refusing[refused] = "the vehicle is armed"
    serving.take_off()
    serving.run(3 * S)
    assert serving.answers[2:] == [("TAKEOFF", YES), ("TAKEOFF", NO)]
    assert serving.notices[-1] == "TAKEOFF is refused: the vehicle is armed"
    serving.refusing.clear()
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.COMPLETED)


@pytest.mark.parametrize("refused", ["load", "TAKEOFF", ""])
def test_waypoints_that_were_not_flown_are_none_of_the_next_mission(refused):
    serving = Serving()
    serving.give()
    serving.ask(R.ARM)
    if refused:
        serving.refusing[refused] = "no fresh and valid position"
        serving.ask(R.TAKEOFF)
        serving.until_answer(R.TAKEOFF, A.REFUSED)
        serving.refusing.clear()
    assert serving.ask(R.DISARM) == (("DISARM", YES), ("DISARM", DONE))
    loads = len(serving.loads)
    serving.ask(R.ARM, 8)
    serving.ask(R.TAKEOFF, 8)
    serving.run(2 * S)
    assert serving.answers[-1] == ("TAKEOFF", NO)
    assert serving.notices[-1] == (
        "TAKEOFF is refused: no waypoints have come, and missions.yaml has no local mission 8"
    )
    assert (len(serving.loads), serving.craft.armed, serving.craft.height_m) == (loads, False, 0.0)
    serving.give(POINTS[:2])
    serving.ask(R.TAKEOFF, 8)
    serving.until(lambda: serving.stage == "MISSION")
    assert len(serving.loads[-1].waypoints) == 2


def test_a_takeoff_whose_answer_is_lost_is_refused_and_called_off_though_it_may_have_begun():
    serving = Serving()
    serving.lost = ("TAKEOFF",)
    serving.take_off()
    serving.until_answer(R.TAKEOFF, A.REFUSED)
    serving.until_answer(R.ABORT, A.DONE)
    serving.until(lambda: serving.stage == "LANDED")
    assert serving.commands == ["TAKEOFF", "ABORT"]
    assert (serving.craft.armed, serving.craft.height_m) == (False, 0.0)
    assert serving.ask(R.DISARM) == (("DISARM", YES), ("DISARM", DONE))


def test_a_takeoff_whose_vehicle_does_not_arm_is_refused_and_ends():
    serving = Serving()
    serving.craft.flags.not_ready["rc"] = "no RC"
    serving.take_off()
    serving.until_answer(R.TAKEOFF, A.REFUSED)
    assert any(each.startswith("TAKEOFF is refused: arm: not shown within 4 s") for each in serving.notices)
    assert any(each.startswith("our planner has failed: arm: not shown within 4 s") for each in serving.notices)
    assert serving.stage == "LANDED"
    assert serving.ask(R.DISARM)[-1] == ("DISARM", DONE)


def test_a_vehicle_that_does_not_lift_off_is_disarmed_by_an_abort():
    serving = Serving()
    serving.craft.flags.does_not_lift_off = True
    serving.take_off()
    serving.until(lambda: serving.craft.armed)
    assert serving.ask(R.ABORT) == (("TAKEOFF", NO), ("ABORT", BOTH))
    serving.until(lambda: serving.stage == "LANDED")
    assert not serving.craft.armed


# --- the mission of missions.yaml -------------------------------------------------------------------------------------


def configured(**more):
    serving = Serving(LINE, **more)
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.COMPLETED)
    return serving


def test_without_waypoints_it_hovers_at_its_height_until_the_list_says_what_is_loaded():
    serving = configured()
    assert (serving.stage, serving.flying.phase) == ("HOVER", P.HOLDING)
    serving.run(20 * S)
    assert serving.craft.height_m == pytest.approx(1.0, abs=0.4)
    assert math.hypot(*serving.craft.position_m[:2]) < 0.3
    serving.give(POINTS[:2])
    assert serving.notices[-1] == (
        "waypoints are not taken: they are not those of mission 7 in missions.yaml, which are loaded; it hovers on"
    )
    assert serving.flying.phase is P.HOLDING
    serving.give()
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert (len(serving.reached), serving.commands) == (3, ["TAKEOFF", "HOLD", "RESUME"])


def test_its_hover_is_held_and_resumed_without_flying_the_mission():
    serving = configured()
    serving.ask(R.HOLD)
    serving.until_answer(R.HOLD, A.DONE)
    assert serving.stage == "HOLD"
    serving.give()  # not while it is held
    assert serving.ask(R.RESUME) == (("RESUME", BOTH),)
    serving.run(10 * S)
    assert (serving.stage, serving.flying.phase) == ("HOVER", P.HOLDING)
    serving.give()
    serving.until(lambda: serving.stage == "MISSION")


def test_a_list_that_our_planner_does_not_fly_may_be_sent_again():
    serving = configured()
    serving.refusing["RESUME"] = "no"
    serving.give()
    assert serving.notices[-1] == "waypoints are not taken: no; it hovers on"
    serving.refusing.clear()
    serving.give()
    serving.until_answer(R.UNDEF, A.COMPLETED)


def test_what_cannot_hover_for_its_list_lands():
    serving = Serving(LINE)
    serving.refusing["HOLD"] = "no"
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.REFUSED)
    assert serving.commands == ["TAKEOFF", "HOLD", "LAND"]
    serving.until_answer(R.LAND, A.COMPLETED)
    assert serving.reached == []


def test_each_takeoff_has_the_next_file():
    serving = Serving(LINE, replace(BACK, frame=Frame.START_HEADING))
    for _ in range(3):
        serving.answers.clear()
        serving.ask(R.ARM)
        serving.ask(R.TAKEOFF)
        serving.until_answer(R.TAKEOFF, A.COMPLETED)
        serving.ask(R.LAND)
        serving.until_answer(R.LAND, A.COMPLETED)
        serving.ask(R.DISARM)
    assert [len(load.waypoints) for load in serving.loads] == [3, 2, 3]


def test_a_mission_in_latitude_and_longitude_is_none_of_its():
    serving = Serving(replace(LINE, places=(Place(47.0, 8.0),) * 3))
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.REFUSED)
    assert serving.loads == []


@pytest.mark.parametrize(
    "files, more, why",
    [
        ((EAST_LINE, BACK), {}, "mission 7 is in the frame east_north, and its engine's waypoints count from each"),
        ((EAST_LINE,), {}, "mission 7 is in the frame east_north, and its engine's waypoints count from each"),
        ((LINE,), {"controller": Controller.OFFBOARD}, "mission 7 is flown by set-points (controller: offboard)"),
    ],
)
def test_a_configured_mission_that_would_be_flown_otherwise_than_it_says_is_refused(files, more, why):
    serving = Serving(*files, **more)
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.REFUSED)
    assert serving.notices[-1].startswith(f"TAKEOFF is refused: {why}")
    assert (serving.loads, serving.stage) == ([], "ARMED")
    serving.give()
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.COMPLETED)


@pytest.mark.parametrize("hover_at_end_s, taken_s", [(60.0, 60.5), (90.0, 90.5), (300.0, 120.0)])
def test_the_hover_at_the_end_of_a_mission_is_no_hold_of_its_list(hover_at_end_s, taken_s):
    serving = Serving(LINE.hovering(hover_at_end_s), hover_at_end_s=hover_at_end_s)
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.COMPLETED)
    assert serving.loads[0].waypoints[-1].hold_s == taken_s
    serving.give()
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert serving.reached == pytest.approx(turned(LINE.waypoints))


@pytest.mark.slow_rows
@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(5))
def test_a_list_with_a_number_that_is_none_is_not_taken_and_said(number, place):
    wrong = list(POINTS[1])
    wrong[place] = number
    serving = Serving()
    serving.give([POINTS[0], wrong])
    assert serving.notices == ["waypoints are not taken: waypoint 2 has a number that is not finite"]
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.REFUSED)
    assert serving.loads == []
    serving.give()
    serving.give([wrong], action=1)  # what was given before stays
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.TAKEOFF, A.COMPLETED)
    assert len(serving.loads[0].waypoints) == len(POINTS)


def test_a_list_before_the_takeoff_is_flown_in_the_place_of_the_configured_mission():
    serving = Serving(LINE)
    serving.give(POINTS[:2])
    serving.ask(R.ARM)
    serving.ask(R.TAKEOFF)
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert len(serving.loads[0].waypoints) == 2
    assert serving.commands == ["TAKEOFF"]


# --- a landing has two routes, and a process an end -------------------------------------------------------------------


def test_a_landing_that_our_planner_refuses_goes_to_the_autopilot_node():
    serving = in_stage(Stage.MISSION)
    serving.refusing["LAND"] = "it did not answer"
    serving.ask(R.LAND)
    assert len(serving.second) == 1
    assert serving.notices[-1] == "LAND: it did not answer; the autopilot node is asked to land"


def test_a_landing_that_does_not_show_goes_to_the_autopilot_node_once():
    serving = in_stage(Stage.MISSION)
    serving.flying.command = lambda *_: ""
    serving.ask(R.LAND)
    began_ns = serving.t_ns
    serving.until(lambda: serving.second)
    assert serving.t_ns - began_ns == pytest.approx(3 * S, abs=100 * MS)
    serving.run(10 * S)
    assert len(serving.second) == 1


def test_a_landing_that_both_refuse_says_so():
    serving = in_stage(Stage.MISSION)
    serving.refusing.update(LAND="the pilot has control", second="the pilot has control")
    assert serving.ask(R.LAND) == (("LAND", YES), ("LAND", NO))


@pytest.mark.parametrize("stage", [Stage.TAKEOFF, Stage.MISSION, Stage.HOLD, Stage.LAND], ids=lambda stage: stage.name)
def test_a_process_that_is_started_again_in_flight_goes_on_with_the_mission(stage):
    serving = in_stage(stage)
    serving.restart()
    serving.answers.clear()
    serving.run(S // 2)
    assert serving.ask(R.ARM, 8) == (("ARM", NO),)
    assert serving.ask(R.DISARM) == (("DISARM", NO),)
    if stage is Stage.HOLD:
        serving.ask(R.RESUME)
        serving.until_answer(R.RESUME, A.DONE)
    if stage is Stage.TAKEOFF:
        serving.until_answer(R.TAKEOFF, A.COMPLETED)
    if stage is not Stage.LAND:
        serving.until_answer(R.UNDEF, A.COMPLETED)
        serving.ask(R.LAND)
    serving.until_answer(R.LAND, A.COMPLETED)
    serving.ask(R.DISARM)
    assert serving.stage == "IDLE"


@pytest.mark.slow_rows
@pytest.mark.parametrize("height_m", [0.0, 0.1, 0.5, None])
def test_a_process_that_is_started_again_before_the_list_came_does_not_fly_the_mission_unasked(height_m):
    serving = configured() if height_m is None else Serving(LINE)
    if height_m is not None:
        serving.ask(R.ARM)
        serving.ask(R.TAKEOFF)
        serving.until(lambda: serving.craft.armed and serving.craft.height_m >= height_m)
    serving.restart()
    serving.run(20 * S)
    assert (serving.stage, serving.flying.phase) == ("HOVER", P.HOLDING)
    assert serving.answers[-1] == ("TAKEOFF", DONE)
    assert serving.ask(R.RESUME) == (("RESUME", NO),)
    serving.give()
    serving.run(5 * S)
    assert serving.notices[-1] == (
        "waypoints are not taken: what is loaded is not known since this node was started again; it hovers until LAND"
    )
    assert (serving.flying.phase, serving.commands, serving.reached) == (P.HOLDING, ["TAKEOFF", "HOLD"], [])
    serving.ask(R.LAND)
    serving.until_answer(R.LAND, A.COMPLETED)
    assert serving.ask(R.DISARM) == (("DISARM", YES), ("DISARM", DONE))


def test_a_configured_mission_that_flies_goes_on_after_a_restart():
    serving = configured()
    serving.give()
    serving.until(lambda: serving.flying.status.waypoint == 2)
    serving.ask(R.HOLD)
    serving.until_answer(R.HOLD, A.DONE)
    serving.restart()
    serving.run(S)
    serving.ask(R.RESUME)
    serving.until_answer(R.UNDEF, A.COMPLETED)
    assert serving.commands == ["TAKEOFF", "HOLD", "RESUME", "HOLD", "RESUME"]  # the first for its list


def test_a_landing_that_a_process_before_this_one_was_asked_for_is_no_end_of_the_mission():
    serving = in_stage(Stage.HOVER)
    serving.ask(R.LAND)
    serving.until(lambda: serving.flying.phase is P.LANDING)
    serving.restart()
    serving.answers.clear()
    serving.until(lambda: serving.stage == "LANDED")
    assert serving.answers == [("LAND", DONE)]


def test_a_planner_that_dies_in_flight_is_said_and_the_vehicle_is_still_landed():
    serving = in_stage(Stage.MISSION)
    serving.silent = ("planner",)
    serving.run(5 * S)
    assert serving.notices[-1] == "our planner is silent in flight; LAND is taken, by the autopilot node"
    serving.refusing["LAND"] = "no such service"
    serving.ask(R.LAND)
    assert len(serving.second) == 1
    serving.flying.command(MissionAction.LAND)  # as the autopilot node does it
    serving.until_answer(R.LAND, A.COMPLETED)
    assert not serving.craft.armed


@pytest.mark.parametrize("stage", [Stage.TAKEOFF, Stage.MISSION, Stage.HOLD, Stage.LAND], ids=lambda stage: stage.name)
def test_a_planner_that_is_started_again_in_flight_is_said_and_its_flight_has_an_end(stage):
    serving = in_stage(stage)
    serving.planner_forgets = True
    serving.run(S)
    assert "our planner has failed: it was started again, and knows the mission no more; LAND is taken" in (
        serving.notices
    )
    if stage is not Stage.TAKEOFF:  # there it is disarmed on the ground meanwhile, or flies on
        assert serving.ask(R.ARM, 8) == (("ARM", NO),)
    serving.ask(R.LAND)
    serving.until_answer(R.LAND, A.COMPLETED)
    assert serving.ask(R.DISARM)[-1] == ("DISARM", DONE)
    serving.planner_forgets = False
    assert serving.ask(R.ARM, 8) == (("ARM", YES), ("ARM", DONE))
