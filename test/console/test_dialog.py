"""What keys, lines, answers and time do to the desk."""

from __future__ import annotations

from dataclasses import replace

import pytest
from console_scenes import MISSIONS, NOW_S, SCENES

from amaze_autonomy.console.dialog import answered, listed, noted, press, received, tick, typed
from amaze_autonomy.console.model import Answer, CommandAnswer, Desk, Question, Request, RequestKind, Snapshot, Verdict
from amaze_autonomy.engine.events import Check, UserCommand
from amaze_autonomy.engine.events import Verdict as CheckVerdict

HOLD, MISSION, INPUT = SCENES["hold"], SCENES["mission"], replace(SCENES["mission-input"], listed_s=NOW_S)
LAND = Request(RequestKind.COMMAND, 1, UserCommand.LAND, sent_s=NOW_S)


def press_all(desk, *keys):
    requests = ()
    for key in keys:
        desk, sent = press(desk, key, NOW_S)
        requests += sent
    return desk, requests


# --- commands by key ---


def test_hold_is_sent_at_once():
    desk, requests = press(MISSION, "h", NOW_S)
    assert requests == (Request(RequestKind.COMMAND, 1, UserCommand.HOLD, sent_s=NOW_S),)
    assert desk == replace(MISSION, next_id=2, requests=requests)


@pytest.mark.parametrize("yes", ["y", "Y", "enter"])
def test_land_takes_one_key_more(yes):
    desk, requests = press(HOLD, "l", NOW_S)
    assert (desk.question.text, requests) == ("LAND at the present position?", ())
    desk, requests = press(desk, yes, NOW_S)
    assert (desk, requests) == (replace(HOLD, next_id=2, requests=(LAND,)), (LAND,))


@pytest.mark.parametrize("key", ["g", "c", "r"])
def test_what_moves_the_vehicle_takes_y_and_enter_is_no(key):
    asked = press(at_rest("hold", user_commands=EVERYTHING), key, NOW_S)[0]
    assert press(asked, "enter", NOW_S)[1] == ()
    assert [request.id for request in press(asked, "y", NOW_S)[1]] == [1]


def test_holding_the_land_key_down_does_not_land():
    _, requests = press_all(HOLD, *["l"] * 51)
    assert requests == ()


@pytest.mark.parametrize("no", ["n", "l", "escape", "backspace", "h", " ", "q"])
def test_any_other_key_does_not_land(no):
    desk, requests = press_all(HOLD, "l", no)
    assert (desk, requests) == (replace(HOLD, error="Not sent: land."), ())


def test_a_key_whose_command_is_not_offered_sends_nothing():
    desk, requests = press(HOLD, "g", NOW_S)
    assert (desk, requests) == (replace(HOLD, error="go is not possible now in HOLD."), ())


def test_a_key_that_means_nothing_changes_nothing():
    assert press(HOLD, "x", NOW_S) == (HOLD, ())
    assert press(HOLD, "backspace", NOW_S) == (HOLD, ())


def test_every_key_sends_its_own_command():
    commands = tuple(command.value for command in UserCommand)
    desk = replace(HOLD, snapshot=replace(HOLD.snapshot, user_commands=commands))
    sent = {}
    for key in "ghclaruk":
        after, requests = press(desk, key, NOW_S)
        if after.question is not None:
            _, requests = press(after, "y", NOW_S)
        sent[key] = [request.command.value for request in requests]
    assert sent == {
        "g": ["go"],
        "h": ["hold"],
        "c": ["resume"],
        "l": ["land"],
        "a": ["abort"],
        "r": ["retry"],
        "u": ["give_up"],
        "k": ["acknowledge"],
    }


def test_a_question_is_dropped_when_the_engine_would_not_do_it_any_more():
    desk, _ = press(HOLD, "a", NOW_S)
    landing = SCENES["land"].snapshot
    desk = received(desk, landing, NOW_S)
    assert (desk.question, desk.error) == (None, "Not sent: abort is not possible any more.")
    assert press(desk, "enter", NOW_S)[1] == ()


def test_a_question_is_dropped_after_ten_seconds():
    desk, _ = press(HOLD, "l", NOW_S)
    assert tick(desk, NOW_S + 9.9)[0].question is not None
    desk, _ = tick(desk, NOW_S + 10.1)
    assert (desk.question, desk.error) == (None, "Not sent: land was not confirmed in time.")


# --- land, and what else stops the vehicle, whatever was heard last ---

SILENT_S = 7.0
NO_CONTACT = "No contact: only hold, land, abort are sent."
REFUSED = tuple(CommandAnswer(each.value, Verdict.REFUSED, "Not now.") for each in UserCommand)
EVERYTHING = tuple(each.value for each in UserCommand)


def at_rest(name, silent_s=0.0, **snapshot):
    """A scene in which nothing is under way, of an engine that would refuse everything."""
    desk = replace(SCENES[name], requests=(), answer=None, question=None, error="", entry="")
    if desk.snapshot is None:
        return desk
    said = replace(desk.snapshot, **{"user_commands": (), "answers": REFUSED, **snapshot})
    return replace(desk, snapshot=said, received_s=NOW_S - silent_s)


unheard = pytest.mark.parametrize(
    "desk", [at_rest(name, SILENT_S) for name in ("ready", "load-mission", "mission", "waiting-engine")]
)


@pytest.mark.parametrize("silent_s", [0.0, SILENT_S], ids=["heard", "silent"])
@pytest.mark.parametrize("name", SCENES)
def test_land_is_sent_to_the_engine_whatever_it_said_last(name, silent_s):
    """The vehicle may have taken off since; the engine has an answer in every state."""
    desk = at_rest(name, silent_s)
    takes_mission = desk.snapshot is not None and desk.snapshot.takes_mission
    keys = ["l", "enter", "y"] if takes_mission else ["l", "y"]
    for after, requests in (press_all(desk, *keys), typed(desk, "land", NOW_S)):
        assert [request.command for request in requests] == [UserCommand.LAND]
        assert (after.requests, after.answer, after.question, after.error) == (requests, None, None, "")


QUESTIONS = {
    "resume": at_rest("hold", user_commands=EVERYTHING),
    "abort": at_rest("hold", user_commands=EVERYTHING),
    "retry": at_rest("load-mission", user_commands=EVERYTHING),
    "give up": at_rest("outreach", user_commands=EVERYTHING),
    "quit": at_rest("hold"),
    "mission 1": replace(INPUT, requests=(), answer=None),
}
ASKED = {"resume": "c", "abort": "a", "retry": "r", "give up": "u", "quit": "q"}


@pytest.mark.parametrize("name", QUESTIONS)
def test_land_is_sent_by_its_key_and_one_more_whatever_question_is_open(name):
    desk = press_all(QUESTIONS[name], *(["1", "enter"] if name == "mission 1" else [ASKED[name]]))[0]
    assert desk.question is not None
    lines = typed(typed(desk, "l", NOW_S)[0], "y", NOW_S)
    for after, requests in (press_all(desk, "l", "enter"), lines, typed(desk, "land", NOW_S)):
        assert [request.command for request in requests] == [UserCommand.LAND]
        assert (after.question, after.error) == (None, "")


@pytest.mark.parametrize("word, command", [("land", UserCommand.LAND), ("hold", UserCommand.HOLD)])
def test_a_whole_word_is_sent_whatever_question_is_open(word, command):
    for key in "lca":
        asked = press(at_rest("hold", user_commands=EVERYTHING), key, NOW_S)[0]
        assert [request.command for request in typed(asked, word, NOW_S)[1]] == [command]


def test_what_was_being_typed_when_contact_was_lost_is_no_beginning_of_a_key():
    typing = press(INPUT, "2", NOW_S)[0]
    assert tick(typing, NOW_S + 1.0)[0].entry == "2"
    lost = tick(typing, NOW_S + SILENT_S)[0]
    requests = press_all(replace(lost, received_s=NOW_S - SILENT_S), "l", "enter", "y")[1]
    assert [request.command for request in requests] == [UserCommand.LAND]
    typed_since = press(lost, "l", NOW_S + SILENT_S)[0]
    assert tick(typed_since, NOW_S + SILENT_S)[0].entry == "l"


@unheard
def test_without_contact_hold_and_abort_are_sent_too(desk):
    assert press(desk, "h", NOW_S)[1] == (Request(RequestKind.COMMAND, 1, UserCommand.HOLD, sent_s=NOW_S),)
    aborting = (Request(RequestKind.COMMAND, 1, UserCommand.ABORT, sent_s=NOW_S),)
    assert press_all(desk, "a", "y")[1] == typed(desk, "abort", NOW_S)[1] == aborting


@unheard
@pytest.mark.parametrize(
    "key, words", [("g", "go"), ("c", "resume"), ("r", "retry"), ("u", "give up"), ("k", "acknowledge")]
)
def test_without_contact_nothing_else_is_sent_and_nothing_is_answered_in_the_engines_place(desk, key, words):
    not_sent = (replace(desk, error=f"Not sent: {words}. {NO_CONTACT}"), ())
    assert press(desk, key, NOW_S) == typed(desk, words, NOW_S) == not_sent


def test_what_was_possible_when_the_engine_was_heard_is_not_sent_without_contact_either():
    desk = at_rest("ready", SILENT_S, user_commands=EVERYTHING)
    assert press(desk, "g", NOW_S) == (replace(desk, error=f"Not sent: go. {NO_CONTACT}"), ())


def test_a_question_that_is_answered_when_contact_is_lost_sends_a_landing_and_no_takeoff():
    desk, later_s = at_rest("ready", user_commands=EVERYTHING), NOW_S + 4.0
    going, landing = (press(desk, key, NOW_S)[0] for key in "gl")
    assert press(going, "y", later_s) == (replace(desk, error=f"Not sent: go. {NO_CONTACT}"), ())
    assert [request.command for request in press(landing, "y", later_s)[1]] == [UserCommand.LAND]


@pytest.mark.parametrize("silent_s", [0.0, SILENT_S], ids=["heard", "silent"])
def test_the_question_of_a_landing_stays_when_a_state_comes_that_would_not_do_it(silent_s):
    """A state that was long under way must not take the key away that has been pressed already."""
    asked = press(at_rest("mission", silent_s), "l", NOW_S)[0]
    heard = received(asked, at_rest("load-mission").snapshot, NOW_S)
    assert (heard.question, heard.error) == (asked.question, "")
    assert [request.command for request in press(heard, "enter", NOW_S)[1]] == [UserCommand.LAND]


def test_without_contact_no_mission_is_selected():
    desk = replace(INPUT, received_s=NOW_S - SILENT_S)
    assert press_all(desk, "1", "enter") == typed(desk, "1", NOW_S)
    assert typed(desk, "1", NOW_S) == (replace(desk, error=f"Not sent: mission 1. {NO_CONTACT}"), ())
    asked = typed(INPUT, "1", NOW_S)[0]
    assert typed(asked, "y", NOW_S + 4.0)[1] == ()


def test_without_contact_a_mission_whose_id_is_a_command_is_that_command():
    desk = replace(INPUT, missions=(replace(MISSIONS[0], id="land"),), received_s=NOW_S - SILENT_S)
    assert typed(desk, "land", NOW_S)[1] == (LAND,)


def test_without_contact_an_unknown_word_gives_what_is_sent():
    desk = at_rest("ready", SILENT_S)
    error = '"hover" is not a command. Possible now: hold (h), land (l), abort (a), quit.'
    assert typed(desk, "hover", NOW_S) == (replace(desk, error=error), ())


# --- closing ---


def test_quit_on_the_ground_closes_at_once():
    assert press(SCENES["ready"], "q", NOW_S)[1] == (Request(RequestKind.QUIT),)


def test_quit_in_flight_asks_and_sends_nothing_to_the_engine():
    desk, requests = press(HOLD, "q", NOW_S)
    assert (desk.question.text, requests) == ("Close this console? The flight goes on without it.", ())
    assert press(desk, "y", NOW_S)[1] == (Request(RequestKind.QUIT),)


def test_the_end_of_input_closes_even_within_a_question():
    assert press(press(HOLD, "l", NOW_S)[0], "quit", NOW_S)[1] == (Request(RequestKind.QUIT),)


# --- choosing a mission ---


def test_a_mission_is_typed_confirmed_and_selected():
    desk, requests = press_all(INPUT, "1", "enter")
    assert (desk.entry, desk.question.enter_is_yes, requests) == ("", False, ())
    assert desk.question.text == "Fly mission 1: Short square, less than a minute (42 s, battery needed 30 %)?"
    desk, requests = press(desk, "y", NOW_S)
    assert requests == (Request(RequestKind.SELECT, 1, missions=("1",), sent_s=NOW_S),)
    assert desk == replace(INPUT, next_id=2, requests=requests)


def test_enter_twice_does_not_start_a_mission():
    desk, requests = press_all(INPUT, "1", "enter", "enter")
    assert (desk.error, requests) == ("Not sent: mission 1.", ())


def test_an_invalid_mission_gives_the_error_and_asks_again():
    desk, requests = press_all(INPUT, "7", "enter")
    assert (desk, requests) == (replace(INPUT, error='There is no mission "7". There are: 1, 2, wall.'), ())
    desk, _ = press_all(desk, "1", "enter")
    assert (desk.question.request.missions, desk.error) == (("1",), "")


def test_a_mission_that_cannot_be_flown_gives_the_reason():
    desk, requests = press_all(INPUT, *"wall", "enter")
    assert requests == ()
    assert desk.error == ("Mission wall cannot be flown: wall.csv line 7: z is -1.5 m, must be at least 0.5 m")


def test_typing_can_be_mended():
    desk, _ = press_all(INPUT, "1", "2", "backspace", "x", "backspace")
    assert desk.entry == "1"
    assert press_all(desk, "escape")[0].entry == press_all(desk, "clear")[0].entry == ""
    assert len(press_all(INPUT, *["1"] * 500)[0].entry) == 60


def test_an_empty_line_says_nothing():
    assert press(INPUT, "enter", NOW_S) == (INPUT, ())


def test_typing_before_the_list_has_come():
    desk, requests = press_all(replace(INPUT, missions=None), "1", "enter")
    assert (desk.error, requests) == ("The list of missions has not come yet; try again in a moment.", ())


# --- a mission id that somebody else's selection cuts ---

CUT = {
    "ready": Snapshot("READY", user_commands=("go", "land", "abort", "give_up")),
    "outreach": Snapshot("OUTREACH", user_commands=("retry", "land", "abort", "give_up")),
    "flying": Snapshot("MISSION", in_flight=True, user_commands=EVERYTHING),
}
cut = pytest.mark.parametrize("snapshot", CUT.values(), ids=CUT)


def type_cut(word, at, snapshot, pause_s=0.1):
    """Type a word and Enter; a state comes before its letter `at`. Return the desk, the commands and the time."""
    desk, now_s, requests = replace(INPUT, snapshot=Snapshot("MISSION_INPUT")), NOW_S, ()
    for number, key in enumerate([*word, "enter"]):
        desk = received(desk, INPUT.snapshot if number < at else snapshot, now_s)
        desk, sent = press(desk, key, now_s)
        requests += sent
        now_s += pause_s
    return desk, [request.words for request in requests], now_s


@cut
@pytest.mark.parametrize(
    "word", ["mapping", "crossing", "hover", "tower", "corridor", "hall", "spiral", "square", "along a road", "unicorn"]
)
def test_the_rest_of_a_mission_id_is_no_command_when_somebody_else_selects(word, snapshot):
    for pause_s in (0.1, 1.9):
        assert [type_cut(word, at, snapshot, pause_s)[1] for at in range(1, len(word) + 1)] == [[]] * len(word)


def test_what_is_typed_is_dropped_when_another_console_selects_and_that_is_said():
    desk = received(press_all(INPUT, "1", "2")[0], SCENES["preflight"].snapshot, NOW_S)
    said = 'Dropped: "12", and what follows up to Enter. No mission is taken any more.'
    assert (desk.entry, desk.question, desk.error) == ("", None, said)


@cut
@pytest.mark.parametrize("ends", ["enter", "escape"])
def test_after_the_end_of_that_line_each_key_is_a_command_again(ends, snapshot):
    desk = received(press_all(INPUT, "1", "2")[0], snapshot, NOW_S)
    desk, sent = press_all(desk, "u", "g", ends, "u", "y")
    assert [request.words for request in sent] == ["give up"]


def test_after_two_seconds_without_a_key_each_key_is_a_command_again():
    desk = received(press_all(INPUT, "1", "2")[0], CUT["ready"], NOW_S)
    desk, sent = press(desk, "g", NOW_S + 1.9)
    assert (desk.question, sent) == (None, ())
    heard = received(desk, CUT["ready"], NOW_S + 4.0)
    assert press(heard, "g", NOW_S + 4.0)[0].question.request.command is UserCommand.GO


def test_who_had_typed_nothing_loses_no_key():
    desk = received(INPUT, CUT["flying"], NOW_S)
    assert [request.words for request in press(desk, "h", NOW_S)[1]] == ["hold"]


@cut
def test_land_is_asked_within_that_line_and_y_lands(snapshot):
    desk = received(press_all(INPUT, "s", "p")[0], snapshot, NOW_S)
    desk, sent = press_all(desk, "i", "l")
    assert (desk.question.request.command, sent) == (UserCommand.LAND, ())
    assert [request.words for request in press(desk, "y", NOW_S)[1]] == ["land"]


@cut
def test_the_enter_of_that_line_does_not_land_but_the_next_one_does(snapshot):
    desk = received(press_all(INPUT, "s", "p")[0], snapshot, NOW_S)
    desk, sent = press_all(desk, "l", "enter")
    assert (desk.question.request.command, sent) == (UserCommand.LAND, ())
    assert [request.words for request in press(desk, "enter", NOW_S)[1]] == ["land"]


@pytest.mark.parametrize("no", ["escape", "l", "x"])
def test_any_other_key_is_no_to_that_question(no):
    desk = received(press_all(INPUT, "s", "p")[0], CUT["flying"], NOW_S)
    desk, sent = press_all(desk, "l", no, "enter", "enter")
    assert (desk.question, sent) == (None, ())


def test_a_confirmation_is_dropped_when_another_console_selects():
    desk, _ = press_all(INPUT, "1", "enter")
    desk = received(desk, SCENES["preflight"].snapshot, NOW_S)
    assert (desk.question, desk.error) == (None, "Not sent: mission 1 is not possible any more.")
    assert press(desk, "y", NOW_S)[1] == ()


# --- the list, and missions by parameter ---


def test_the_list_is_asked_for_when_a_mission_can_be_selected():
    desk = replace(INPUT, listed_s=None, missions=None)
    after, requests = tick(desk, NOW_S)
    assert requests == (Request(RequestKind.LIST, 1, sent_s=NOW_S),)
    assert tick(after, NOW_S + 1.0)[1] == ()
    heard = replace(after, received_s=NOW_S + 5.5)
    assert tick(heard, NOW_S + 6.0)[1] == (Request(RequestKind.LIST, 2, sent_s=NOW_S + 6.0),)
    assert listed(after, 1, MISSIONS) == replace(after, missions=MISSIONS, requests=())


def test_the_list_is_not_asked_for_in_flight_and_anew_afterwards():
    flying, requests = tick(replace(HOLD, listed_s=5.0), NOW_S)
    assert (flying.listed_s, requests) == (None, ())
    ended = received(flying, SCENES["mission-ended"].snapshot, NOW_S)
    assert [request.kind for request in tick(ended, NOW_S)[1]] == [RequestKind.LIST]


def test_a_mission_by_parameter_is_selected_without_a_question():
    desk, requests = tick(replace(INPUT, wanted=("1", "2")), NOW_S)
    assert requests == (Request(RequestKind.SELECT, 1, missions=("1", "2"), sent_s=NOW_S),)
    assert (desk.wanted, tick(desk, NOW_S)[1]) == ((), ())


def test_a_mission_by_parameter_that_does_not_exist_gives_the_error_and_asks():
    desk, requests = tick(replace(INPUT, wanted=("9",)), NOW_S)
    assert (desk.error, desk.wanted, requests) == ('There is no mission "9". There are: 1, 2, wall.', (), ())


def test_a_mission_by_parameter_is_dropped_when_the_engine_is_busy():
    desk, requests = tick(replace(HOLD, wanted=("1",)), NOW_S)
    assert (desk.wanted, desk.error, requests) == ((), "Mission 1 was not selected: the engine is in HOLD.", ())


@pytest.mark.parametrize("heard_again", [True, False], ids=["after a silence", "within it"])
def test_another_engine_is_asked_for_its_missions_before_one_of_the_list_is_flown(heard_again):
    asked = replace(press_all(INPUT, "1", "enter")[0], run="r-1")
    again_s = NOW_S + 60.0 * heard_again
    desk = noted(received(replace(asked, question=asked.question), INPUT.snapshot, again_s), "r-2", ())
    assert (desk.missions, desk.question, desk.run) == (None, None, "r-2")
    assert desk.error == "Not sent: mission 1. The engine lists its missions anew: choose again."
    assert press(desk, "y", again_s)[1] == ()
    assert [request.kind for request in tick(desk, again_s)[1]] == [RequestKind.LIST]
    assert typed(desk, "1", again_s)[0].question is None


def test_messages_of_the_same_engine_change_no_list():
    for run in ("", "r-1"):
        assert noted(replace(INPUT, run=run), "r-1", ()) == replace(INPUT, run="r-1")


def test_no_mission_by_parameter_is_selected_without_contact():
    wanted = replace(INPUT, wanted=("1",), received_s=NOW_S - SILENT_S)
    desk, requests = tick(wanted, NOW_S)
    assert (desk.wanted, requests) == (("1",), ())


# --- answers and messages ---


def test_an_answer_is_shown_for_fifteen_seconds():
    desk = replace(HOLD, requests=(LAND,))
    desk = answered(desk, 1, Verdict.REFUSED, "the reason", NOW_S)
    assert desk == replace(HOLD, answer=Answer("land", Verdict.REFUSED, "the reason", NOW_S, "HOLD"))
    assert tick(desk, NOW_S + 14.0)[0].answer is not None
    assert tick(desk, NOW_S + 16.0)[0].answer is None


def test_an_answer_to_nothing_is_dropped():
    assert answered(HOLD, 99, Verdict.DONE, "", NOW_S) == HOLD


def test_a_list_that_does_not_come_is_no_news_for_the_operator():
    desk = replace(INPUT, requests=(Request(RequestKind.LIST, 4),))
    assert answered(desk, 4, Verdict.NO_ANSWER, "no such service", NOW_S) == INPUT


def test_an_error_is_shown_for_fifteen_seconds_but_stays_while_a_mission_is_asked_for():
    for scene, stays in ((HOLD, ""), (INPUT, "wrong")):
        desk = tick(replace(scene, error="wrong"), NOW_S)[0]
        assert tick(desk, NOW_S + 14.0)[0].error == "wrong"
        assert tick(desk, NOW_S + 16.0)[0].error == stays


def test_a_request_without_an_answer_is_forgotten_after_a_minute():
    desk = replace(HOLD, requests=(LAND,))
    assert tick(desk, NOW_S + 59.0)[0].requests == (LAND,)
    assert tick(desk, NOW_S + 61.0)[0].requests == ()


def test_a_hanging_request_does_not_keep_land_back():
    hold = Request(RequestKind.COMMAND, 1, UserCommand.HOLD, sent_s=NOW_S)
    desk, requests = press_all(replace(MISSION, requests=(hold,), next_id=2), "l", "enter")
    assert [request.command for request in requests] == [UserCommand.LAND]
    assert [request.command for request in desk.requests] == [UserCommand.HOLD, UserCommand.LAND]


def test_an_answer_vanishes_with_the_state_that_it_was_for_once_it_could_be_read():
    desk = answered(replace(HOLD, requests=(replace(LAND, id=1),)), 1, Verdict.DONE, "Landing.", NOW_S)
    landing = received(desk, SCENES["land"].snapshot, NOW_S + 0.2)
    assert tick(landing, NOW_S + 1.9)[0].answer == Answer("land", Verdict.DONE, "Landing.", NOW_S, "HOLD")
    assert tick(landing, NOW_S + 2.1)[0].answer is None
    assert tick(desk, NOW_S + 14.0)[0].answer is not None


def test_an_abort_while_it_lands_is_answered_already_and_not_sent():
    already = CommandAnswer("abort", Verdict.ALREADY, "It is landing.")
    landing = replace(SCENES["land"], snapshot=replace(SCENES["land"].snapshot, answers=(already,)))
    desk, requests = press(landing, "a", NOW_S)
    assert requests == ()
    assert (desk.answer, desk.question, desk.error) == (
        Answer("abort", Verdict.ALREADY, "It is landing.", NOW_S, "LAND"),
        None,
        "",
    )


# --- lines ---


def test_a_whole_word_is_its_own_confirmation_and_a_letter_is_not():
    assert typed(HOLD, " land ", NOW_S)[1] == (LAND,)
    desk, requests = typed(HOLD, "l", NOW_S)
    assert (desk.question.request.command, requests) == (UserCommand.LAND, ())
    assert typed(desk, "yes", NOW_S)[1] == (LAND,)
    assert typed(desk, "", NOW_S) == (replace(HOLD, error="Not sent: land."), ())


def test_an_unknown_word_gives_what_is_possible():
    desk, requests = typed(HOLD, "hover", NOW_S)
    assert (desk.error, requests) == (
        '"hover" is not a command. Possible now: hold (h), land (l), abort (a), quit.',
        (),
    )


def test_a_mission_whose_id_is_a_command_is_a_mission():
    desk = replace(INPUT, missions=(replace(MISSIONS[0], id="land"), replace(MISSIONS[0], id="q")))
    assert typed(desk, "land", NOW_S)[0].question.request.missions == ("land",)
    assert typed(desk, "q", NOW_S)[0].question.request.missions == ("q",)


def test_quit_as_a_line():
    assert typed(INPUT, "quit", NOW_S)[1] == typed(HOLD, "exit", NOW_S)[1] == (Request(RequestKind.QUIT),)


def test_a_question_that_was_answered_is_gone():
    question = Question("Sure?", replace(LAND, id=0), NOW_S)
    assert typed(replace(HOLD, question=question), "y", NOW_S)[0].question is None


# --- ages of the pre-flight table -------------------------------------------------------------------------------------


def test_the_age_of_a_row_goes_on_counting_until_it_is_judged_anew():
    rows = (Check("battery", CheckVerdict.PASS, 0.8, age_s=0.5), Check("home", CheckVerdict.PASS))
    said = Snapshot(state="PREFLIGHT", checks=rows)
    desk = received(Desk(), said, NOW_S, 1.0)
    assert [row.age_s for row in desk.checks(NOW_S + 2.0)] == [3.5, None]
    desk = received(desk, replace(said, message="the same rows"), NOW_S + 10.0)
    assert [row.age_s for row in desk.checks(NOW_S + 10.0)] == [11.5, None]
    assert desk.checks(NOW_S + 10.0)[0].value == 0.8
    anew = (replace(rows[0], age_s=0.25), rows[1])
    desk = received(desk, replace(said, checks=anew), NOW_S + 20.0)
    assert [row.age_s for row in desk.checks(NOW_S + 20.0)] == [0.25, None]
