"""What the operator's page is sent, and what becomes of its commands: pure, in virtual time."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import pytest

from amaze_autonomy.config import load_configuration
from amaze_autonomy.console.link import AnswerCame, CollectingCame, MessagesCame, MissionsCame, StateCame
from amaze_autonomy.console.model import (
    Collecting,
    CommandAnswer,
    MissionRow,
    Note,
    PendingFailure,
    Platform,
    Request,
    RequestKind,
    Snapshot,
    Telemetry,
    Verdict,
)
from amaze_autonomy.engine.events import Check, UserCommand
from amaze_autonomy.engine.events import Verdict as CheckVerdict
from amaze_autonomy.missions import Circle, Fence, Frame, Polygon
from amaze_autonomy.nodes.web.board import SAMPLES, TRACK, Board, Have, Orders, plan_of, state_of
from amaze_autonomy.paths import config_folder

FLYING = Snapshot(state="MISSION", in_flight=True, telemetry=Telemetry(age=0.1, position_x=1.0, position_y=2.0))
NOTES = tuple(Note("10:00:00", 0, f"message {number}", "", number) for number in range(1, 6))
TOKEN = "a token of the vehicle"


def board_with(*happenings):
    board = Board("b-1")
    for second, happening in enumerate(happenings):
        board.take(happening, float(second))
    return board


# --- board ---


def test_a_viewer_gets_all_there_is_and_then_only_what_is_new():
    board = board_with(StateCame(FLYING), MessagesCame("r-1", NOTES[:2]))
    news, have = board.since(Have(), 2.5)
    assert (news["board"], news["age_s"], news["run"]) == ("b-1", 2.5, "r-1")
    assert (sorted(news["parts"]), [each[0] for each in news["notes"]]) == (["plans", "safe", "state"], [1, 2])
    assert news["samples"] == [[1, 0.0, 1.0, 2.0, None, None, None, None]]
    board.take(MessagesCame("r-1", NOTES), 3.0)
    news, have = board.since(have, 3.0)
    assert (news["parts"], [each[3] for each in news["notes"]], news["samples"]) == (
        {},
        ["message 3", "message 4", "message 5"],
        [],
    )
    assert board.since(have, 3.5)[0]["notes"] == []


def test_a_viewer_that_was_away_gets_the_messages_after_its_last_one_also_from_another_server():
    board = board_with(StateCame(FLYING), MessagesCame("r-1", NOTES))
    for have in (Have("b-1", {}, "r-1", 3, 1), Have("b-0", {"state": 1}, "r-1", 3, 99)):
        news, _ = board.since(have, 3.0)
        assert [each[0] for each in news["notes"]] == [4, 5]
        assert "state" in news["parts"]
    assert board.since(Have("b-0", {}, "r-1", 3, 99), 3.0)[0]["samples"]


def test_after_a_restart_of_the_engine_the_numbers_begin_anew():
    board = board_with(MessagesCame("r-1", NOTES))
    _, have = board.since(Have(), 0.0)
    board.take(MessagesCame("r-2", NOTES[:1]), 1.0)
    news, have = board.since(have, 1.0)
    assert (news["run"], [each[0] for each in news["notes"]], have.note) == ("r-2", [1], 1)


def test_what_is_the_same_is_not_sent_again():
    board = board_with(StateCame(FLYING))
    _, have = board.since(Have(), 0.0)
    board.take(StateCame(FLYING), 0.1)
    assert board.since(have, 0.1)[0]["parts"] == {}
    board.take(StateCame(replace(FLYING, waypoint=2)), 0.2)
    assert list(board.since(have, 0.2)[0]["parts"]) == ["state"]


@pytest.mark.night
def test_eight_hours_do_not_grow():
    board = Board("b-1")
    for half_second in range(8 * 3600 * 2):
        telemetry = replace(FLYING.telemetry, position_x=float(half_second))
        board.take(StateCame(replace(FLYING, telemetry=telemetry)), half_second / 2)
    news, have = board.since(Have(), 8 * 3600.0)
    assert (SAMPLES < len(news["samples"]) < SAMPLES + TRACK, have.sample) == (True, 8 * 3600 * 2)
    assert sorted(news["parts"]) == ["plans", "safe", "state"]


def moved(board, first, seconds, session):
    """Fly east, a metre in each second, with two states in it; return what a viewer gets who comes then."""
    for half_second in range(first * 2, (first + seconds) * 2):
        telemetry = replace(FLYING.telemetry, position_x=half_second / 2)
        board.take(StateCame(replace(FLYING, telemetry=telemetry, session_id=session)), half_second / 2)
    return board.since(Have(), float(first + seconds))[0]


def test_who_comes_late_sees_the_track_of_the_whole_flight_and_the_last_minutes_densely():
    samples = moved(Board("b-1"), 0, 3600, "s-1")["samples"]
    numbers = [each[0] for each in samples]
    assert numbers == sorted(set(numbers))
    places = [each[2] for each in samples]
    assert (places[0] < 5.0, places[-1]) == (True, 3599.5)
    steps = [after - before for before, after in zip(places, places[1:])]
    assert (max(steps), set(steps[1 - SAMPLES :])) == (2.0, {0.5})


def test_the_track_begins_anew_with_each_mission_and_stands_until_then():
    board = Board("b-1")
    assert moved(board, 0, 60, "s-1")["flight"] == 1
    assert moved(board, 60, 1, "")["flight"] == 1
    news = moved(board, 61, 60, "s-2")
    assert (news["flight"], news["samples"][0][:3]) == (123, [123, 61.0, 61.0])


def test_the_waypoint_is_said_while_it_flies():
    assert "waypoint 2 of 5, 1 reached" in state_of(replace(FLYING, waypoint=2, waypoints=5))["where"]
    assert not any("waypoint" in each for each in state_of(replace(FLYING, waypoints=0))["where"])
    landed = replace(FLYING, state="MISSION_ENDED", in_flight=False, waypoint=5, waypoints=5)
    assert not any("waypoint" in each for each in state_of(landed)["where"])


def test_the_missions_are_asked_for_when_they_can_be_selected_and_again_after_a_flight():
    board, listed = Board("b-1"), MissionsCame(1, (MissionRow("1", "Square", 1, 1, 41.6, 0.3),))
    wanted = []
    states = [*["MISSION_INPUT"] * 4, "PREFLIGHT", *["MISSION_ENDED"] * 4]
    for at_s, state in zip(count(0.0, 2.5), states):
        board.take(StateCame(Snapshot(state=state)), at_s)
        wanted.append(board.wants_missions(at_s))
        board.take(listed, at_s)
    assert wanted == [True, *[False] * 4, True, *[False] * 3]
    shown = board.since(Have(), 0.0)[0]["parts"]["missions"]
    question = "Fly mission 1: Square (42 s, battery needed 30 %)?"
    assert shown == [
        {"id": "1", "words": "Square", "duration": "42 s", "battery": "30 %", "error": "", "question": question}
    ]


def test_a_state_in_the_words_in_which_it_is_shown():
    link = "no link to the autopilot"
    state = state_of(
        replace(
            FLYING,
            failures=(
                PendingFailure("lrf", 8, "wait", "land", 8.1, "restart limit", "", "silent"),
                PendingFailure("imu", 16, "land", "", None, "", link, "silent"),
                PendingFailure("gps", 2, "continue", "", None, "", link, "silent"),
            ),
            checks=(Check("tilt", CheckVerdict.FAIL, 0.5, 0.25, "rad", 0.5, "level it"),),
            answers=(CommandAnswer("land", Verdict.DONE, "Landing."),),
            user_commands=("land",),
        )
    )
    assert state["faults"] == [
        {
            "cause": link,
            "tone": "bad",
            "action": "LAND",
            "left_s": None,
            "limit": "",
            "faults": [["imu", 16, "silent"], ["gps", 2, "silent"]],
        },
        {
            "cause": "",
            "tone": "warn",
            "action": "waits, then LAND",
            "left_s": 8.1,
            "limit": "restart limit",
            "faults": [["lrf", 8, "silent"]],
        },
    ]
    [check] = state["checks"]
    assert (check["value"], check["limit"], check["verdict"], check["tone"]) == ("28.6 deg", "14.3 deg", "FAIL", "bad")
    commands = {each["name"]: each for each in state["commands"]}
    assert set(commands) == {each.value for each in UserCommand}
    assert (commands["land"]["possible"], commands["land"]["question"]) == (True, "LAND at the present position?")
    assert not commands["go"]["possible"]


def test_what_stops_the_vehicle_is_there_to_be_pressed_before_the_engine_was_heard():
    news, _ = Board("b-1").since(Have(), 0.0)
    assert news["parts"]["safe"] == [
        {"name": "hold", "words": "hold", "question": ""},
        {"name": "land", "words": "LAND", "question": "LAND at the present position?"},
        {"name": "abort", "words": "ABORT", "question": "ABORT: in the air land, on the ground disarm?"},
    ]


def test_the_state_of_an_engine_that_is_silent_is_not_known():
    board = board_with(StateCame(FLYING))
    assert [board.state_at(now_s) for now_s in (0.0, 3.0, 3.1)] == ["MISSION", "MISSION", None]
    assert Board("b-1").state_at(0.0) is None


def test_the_recording_on_each_platform():
    platform = Platform("second", False, 18_000_000, 0.0, 0.08, "", "the disk is nearly full", 3, 0.875)
    board = board_with(StateCame(FLYING), CollectingCame(Collecting("", "RECORDING", None, 0.0, (platform,))))
    [shown] = board.since(Have(), 1.0)[0]["parts"]["recording"]["platforms"]
    assert shown == {
        "name": "second",
        "growing": False,
        "size": "18.0 MB",
        "rate": "0.00 MB/s",
        "free": "8 %",
        "cpu": "88 %",
        "dropped": 3,
        "trouble": "the disk is nearly full",
    }


RECORDS = Collecting("s-1", "RECORDING", 90.0, 0.0, (Platform("main", True, 18_000_000, 5e6, 0.5),))


@pytest.mark.parametrize(
    "session, silent_s, records, rate, trouble",
    [
        ("s-1", 1.0, True, "5.00 MB/s", ""),
        ("s-1", 10.0, False, "-", "not heard for 10 s"),
        ("s-2", 1.0, False, "-", "of session s-1"),
    ],
)
def test_what_a_recorder_said_of_another_time_or_session_is_no_word_on_what_it_does_now(
    session, silent_s, records, rate, trouble
):
    flying = replace(FLYING, session_id=session, recording_phase="RECORDING")
    board = Board("b-1")
    board.take(StateCame(flying), 0.0)
    board.take(CollectingCame(RECORDS), 0.0)
    board.take(StateCame(flying), silent_s)
    part = board.since(Have(), silent_s)[0]["parts"]["recording"]
    [shown] = part["platforms"]
    assert (shown["growing"], shown["rate"], shown["trouble"]) == (records, rate, trouble)
    assert part["left_s"] == (89 if records else None)


def test_while_the_autopilot_is_silent_nothing_is_drawn_but_one_gap():
    board = Board("b-1")
    for second, age in enumerate([0.1, 1.5, 2.5, 3.5, None, 0.1]):
        board.take(StateCame(replace(FLYING, telemetry=replace(FLYING.telemetry, age=age))), float(second))
    east = [each[2] for each in board.since(Have(), 5.0)[0]["samples"]]
    assert east == [1.0, 1.0, None, 1.0]


@pytest.mark.parametrize("run, silent_s, anew", [("r-1", 1.0, False), ("r-2", 1.0, True), ("r-1", 9.0, True)])
def test_the_missions_of_an_engine_that_may_be_another_one_are_listed_anew(run, silent_s, anew):
    board, ready = Board("b-1"), StateCame(Snapshot(state="MISSION_INPUT"))
    board.take(MessagesCame("r-1", ()), 0.0)
    board.take(ready, 0.0)
    assert board.wants_missions(0.0)
    board.take(MissionsCame(1, (MissionRow("1"),)), 0.5)
    board.take(ready, silent_s)
    board.take(MessagesCame(run, ()), silent_s)
    assert [each["id"] for each in board.since(Have(), silent_s)[0]["parts"]["missions"]] == ([] if anew else ["1"])
    assert board.wants_missions(silent_s) == anew


def test_a_mission_is_drawn_with_its_fences():
    plan = load_configuration(config_folder()).plan("1")
    fence = Fence((Polygon(((0.0, 0.0), (9.0, 0.0), (0.0, 9.0))),), (Circle((3.0, 3.0), 1.5, stay_in=False),))
    drawn = plan_of(replace(plan, fences=(fence,)))
    assert drawn["files"] == [[[point.x_m, point.y_m] for point in plan.trajectories[0].waypoints]]
    assert drawn["fences"] == [{"in": True, "corners": [[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]]}]
    assert drawn["circles"] == [{"in": False, "centre": [3.0, 3.0], "radius": 1.5}]


def test_a_file_whose_heading_is_not_known_before_the_takeoff_is_not_drawn():
    plan = load_configuration(config_folder()).plan("1")
    ahead = tuple(replace(each, frame=Frame.START_HEADING) for each in plan.trajectories)
    assert plan_of(replace(plan, trajectories=ahead))["files"] == [[]]


# --- orders ---


def order(**changes):
    given = {"id": "o-1", "token": TOKEN, "board": "b-1", "seen": "READY", "beat": 100.0, "command": "go"}
    return {**given, **changes}


@pytest.fixture
def orders():
    return Orders("b-1", TOKEN)


def test_an_order_that_comes_again_is_sent_once_and_answered_each_time(orders):
    answer, request = orders.take(order(), "READY", 100.1)
    assert (answer, request.command) == (None, UserCommand.GO)
    assert orders.take(order(), "READY", 102.1) == (None, None)
    done = {"id": "o-1", "request": "go", "verdict": "DONE", "message": "Starting."}
    assert orders.answered(AnswerCame(request.id, Verdict.DONE, "Starting.")) == done
    assert orders.take(order(), "TAKEOFF", 120.0) == (done, None)
    assert orders.answered(AnswerCame(request.id, Verdict.REFUSED, "again")) is None


def test_a_mission_is_selected_by_its_id(orders):
    _, request = orders.take(order(command=None, missions=["1"], seen="MISSION_INPUT"), "MISSION_INPUT", 100.0)
    assert (request.kind, request.missions) == (RequestKind.SELECT, ("1",))


@pytest.mark.parametrize(
    "changes, state, verdict, words",
    [
        ({"token": "wrong"}, "READY", "REFUSED", "The token is not the one"),
        ({"token": None}, "READY", "REFUSED", "The token is not the one"),
        ({"board": "b-0"}, "READY", "NO ANSWER", "was started anew"),
        ({"board": "b-0", "token": "wrong", "command": "land"}, "READY", "REFUSED", "The token is not the one"),
        ({}, "PREFLIGHT", "REFUSED", "Not sent: the engine is in PREFLIGHT by now."),
        ({"beat": 94.9}, "READY", "NO ANSWER", "too long under way"),
        ({"beat": 101.0}, "READY", "NO ANSWER", "too long under way"),
        ({"beat": "now"}, "READY", "NO ANSWER", "too long under way"),
        ({"command": "fly home"}, "READY", "REFUSED", "not a command"),
        ({"command": None, "missions": [1]}, "READY", "REFUSED", "not a command"),
        ({"command": None, "missions": []}, "READY", "REFUSED", "not a command"),
    ],
)
def test_what_is_not_carried_out(orders, changes, state, verdict, words):
    answer, request = orders.take(order(**changes), state, 100.0)
    assert (answer["verdict"], request) == (verdict, None)
    assert words in answer["message"]


def test_what_stops_the_vehicle_or_brings_it_down_is_never_too_late(orders):
    for number, command in enumerate(("hold", "land", "abort")):
        late = order(id=f"o-{number}", command=command, beat=0.0, seen="MISSION", board="b-0")
        assert orders.take(late, "HOLD", 100.0)[1].command is UserCommand(command)


@pytest.mark.parametrize("changes", [{}, {"seen": ""}, {"command": None, "missions": ["1"]}])
def test_without_contact_with_the_engine_nothing_that_is_not_safe_is_sent_or_answered_for_it(orders, changes):
    answer, request = orders.take(order(**changes), None, 100.0)
    assert (answer["verdict"], request) == ("NO ANSWER", None)
    assert answer["message"] == "Not sent: no contact with the engine."
    for number, command in enumerate(("hold", "land", "abort")):
        _, request = orders.take(order(id=f"s-{number}", command=command), None, 100.0)
        assert request.command is UserCommand(command)


def test_what_has_no_id_is_not_answered(orders):
    for order_id in (None, 7, "", "x" * 65):
        assert orders.take(order(id=order_id), "READY", 100.0) == (None, None)


def test_an_engine_that_does_not_answer_is_named(orders):
    orders.take(order(), "READY", 100.0)
    assert orders.overdue(109.0) == []
    [late] = orders.overdue(110.1)
    assert (late["verdict"], late["message"]) == ("NO ANSWER", "The engine has not answered within 10 s.")
    assert orders.overdue(111.0) == []


def test_a_flood_of_orders_is_refused_and_old_ones_are_forgotten(orders):
    sent = [orders.take(order(id=f"o-{n}"), "READY", 100.0)[1] for n in range(100)]
    assert sum(request is not None for request in sent) == 16
    assert orders.take(order(id="l-1", command="land"), "READY", 100.0)[1].command is UserCommand.LAND
    for request in sent[:16]:
        orders.answered(AnswerCame(request.id, Verdict.DONE, ""))
    for number in range(2000):
        _, request = orders.take(order(id=f"p-{number}"), "READY", 100.0)
        orders.answered(AnswerCame(request.id, Verdict.DONE, ""))
    assert len(orders._orders) == 500


def test_a_request_has_the_number_that_its_answer_carries(orders):
    first = orders.take(order(), "READY", 100.0)[1]
    second = orders.take(order(id="o-2"), "READY", 100.0)[1]
    assert isinstance(first, Request)
    assert first.id != second.id
    assert orders.answered(AnswerCame(second.id, Verdict.ALREADY, "x"))["id"] == "o-2"
