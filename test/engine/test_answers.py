"""Every user command in every state: the answer, and its effect; selecting a mission in every state."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import MISSION
from engine_story import Story
from expected_answers import COMMANDS, EXPECTED, SELECTION

from amaze_autonomy.engine import commands, decide
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import Answer, AnswerKind, Level, Notify
from amaze_autonomy.engine.context import Context
from amaze_autonomy.engine.state import State, evolve

SERVICE = Path(__file__).parents[2] / "srv" / "UserCommand.srv"
WORDS = {"D": "DONE", "R": "REFUSED", "A": "ALREADY"}


def test_answers_have_the_numbers_of_the_service():
    numbers = dict(re.findall(r"^uint8 (\w+)=(\d+)$", SERVICE.read_text(encoding="utf-8"), re.MULTILINE))
    assert {kind.name: str(kind.value) for kind in AnswerKind} == numbers


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("place", EXPECTED)
def test_every_command_in_every_state(place, command):
    story, expected = at(place), EXPECTED[place]
    before = story.state
    answer, sentence = story.user(command)
    assert answer == WORDS[expected.letters[COMMANDS.index(command)]]
    assert sentence.endswith((".", "!"))
    if answer == "DONE":
        state, _, step = expected.leads[command].partition(" ")
        story.expect(state, step)
        assert story.rules_fired, "what is done leaves a decision"
    else:
        assert evolve(story.state, t_ns=0) == evolve(before, t_ns=0), "what is not done changes nothing"
        assert [type(c).__name__ for c in story.since] == ["Answer"]


@pytest.mark.parametrize("place", SELECTION)
def test_select_in_every_state(place):
    story = at(place)
    before = story.state
    commands = story.feed(ev.MissionSelected, missions=(MISSION,), request_id=77)
    answer = next(c for c in commands if isinstance(c, Answer))
    assert (answer.request_id, answer.answer.name) == (77, SELECTION[place])
    if answer.answer.name == "DONE":
        story.expect("PREFLIGHT")
    else:
        assert evolve(story.state, t_ns=0) == evolve(before, t_ns=0)


@pytest.mark.parametrize("place", BEGINNINGS)
def test_an_invalid_mission_is_refused_with_its_error(place):
    story = at(place)
    before = story.place
    commands = story.feed(ev.MissionRejected, mission_id="9", error="there is no mission 9", request_id=3)
    answer = next(c for c in commands if isinstance(c, Answer))
    assert (answer.request_id, answer.answer.name, answer.message) == (3, "REFUSED", "there is no mission 9")
    assert story.place == before
    assert story.motions == []


def test_the_tables_know_every_place_and_command():
    assert sorted(EXPECTED) == sorted(BEGINNINGS)
    assert sorted(COMMANDS) == sorted(command.value for command in ev.UserCommand)
    assert {place.split(" ")[0] for place in EXPECTED} == {state.value for state in State}
    assert all(len(row.letters) == len(COMMANDS) for row in EXPECTED.values())


def test_a_component_that_is_waited_for_refuses_resume():
    story = at("MISSION flying")
    story.fail("lrf", 8).until("HOLD", "holding").look()
    assert story.user("resume") == ("REFUSED", "A component is waited for.")
    assert story.requests == []


def test_a_hold_of_the_engine_can_be_made_the_users_own():
    story = at("MISSION flying")
    story.fail("lrf", 8).until("HOLD", "holding").look()
    assert story.user("hold")[0] == "DONE"
    story.back("lrf").after(5.0).expect("HOLD", "holding")
    assert story.user("resume")[0] == "DONE"
    story.until("MISSION", "flying")
    assert story.motions == ["RESUME"]


def test_resume_of_a_hold_that_resumes_by_itself_is_already_so():
    story = at("MISSION flying")
    story.disobeyed.append("HOLD")
    story.fail("lrf", 8).back("lrf").expect("HOLD", "confirming")
    assert story.user("resume") == ("ALREADY", "It resumes by itself.")


def test_a_users_hold_does_not_last_for_ever():
    story = at("HOLD holding")
    asked_ns = story.state.flight.user_hold_ns
    story.after_ns(asked_ns + 120_000_000_000 - story.now - 1).expect("HOLD", "holding")
    story.after_ns(1).expect("LAND")
    assert story.motions == ["LAND"]


def test_the_users_own_hold_is_no_warning():
    story = at("MISSION flying")
    story.look().user("hold")
    story.after(1.0).expect("HOLD", "holding")
    assert story.told == ["user_hold"]


def test_asking_for_a_hold_twice_does_not_prolong_it():
    story = at("HOLD holding")
    asked_ns = story.state.flight.user_hold_ns
    story.after(60.0)
    assert story.user("hold")[0] == "ALREADY"
    story.after_ns(asked_ns + 120_000_000_000 - story.now).expect("LAND")


def test_acknowledge_is_refused_while_the_last_word_of_the_vehicle_was_that_it_flies():
    story = at("PILOT")
    story.silent.append("autopilot")
    story.after(1.5)
    assert story.user("acknowledge")[0] == "REFUSED"
    story.expect("PILOT")


def test_a_vehicle_that_was_switched_off_after_landing_can_be_acknowledged():
    story = at("PILOT landed")
    story.silent.append("autopilot")
    story.after(60.0)
    assert story.user("acknowledge")[0] == "DONE"
    story.expect("DATA_CLEANUP")


@pytest.mark.parametrize("landed", [ev.VehicleLanded.UNKNOWN, ev.VehicleLanded.IN_AIR])
def test_a_vehicle_that_has_been_disarmed_for_long_can_be_acknowledged_whatever_it_says_of_the_ground(landed):
    story = at("PILOT")
    story.vehicle.says.update(armed=True, landed=landed)
    story.after(40.0).vehicle.says.update(armed=False)
    story.after(29.0)
    assert story.user("acknowledge")[0] == "REFUSED"
    answer = story.after(2.0).user("acknowledge")
    assert answer == ("DONE", "Acknowledged; it is disarmed, and does not say that it has landed.")
    story.expect("DATA_CLEANUP")


def test_one_that_says_that_it_is_armed_cannot():
    story = at("PILOT")
    story.vehicle.says.update(armed=True, landed=ev.VehicleLanded.UNKNOWN)
    assert story.after(40.0).user("acknowledge")[0] == "REFUSED"


def test_one_that_does_not_say_whether_it_is_armed_can_be_acknowledged_after_long():
    """Its link lives, and what says that it is armed does not come any more: there was no way out of PILOT."""
    story = at("PILOT")
    story.vehicle.says.update(armed=True, landed=ev.VehicleLanded.UNKNOWN)
    story.after(60.0).vehicle.says.update(armed=None)
    assert story.after(29.0).user("acknowledge")[0] == "REFUSED"
    answer = story.after(2.0).user("acknowledge")
    assert answer == ("DONE", "Acknowledged; whether it has landed and is disarmed is not known.")
    story.expect("DATA_CLEANUP")


def test_a_silence_of_the_vehicle_is_no_time_in_which_it_was_disarmed():
    story = at("PILOT")
    story.vehicle.says.update(armed=False, landed=ev.VehicleLanded.UNKNOWN)
    story.after(15.0).silent.append("autopilot")
    story.after(10.0).silent.clear()
    assert story.after(10.0).user("acknowledge")[0] == "REFUSED"


def test_require_go_waits_for_the_go():
    story = at("READY").after(30.0).expect("READY")
    assert story.told == []
    story.user("go")
    story.until("MISSION_ENDED")
    assert story.state.session.result.value == "COMPLETE"


def test_the_answer_is_given_after_the_requests_and_before_the_messages():
    story = at("MISSION flying")
    story.user("land")
    assert [type(c).__name__ for c in story.since] == ["MissionCommand", "Answer", "Notify", "Decision"]


def test_two_requests_at_the_same_time_are_both_answered():
    story = at("MISSION flying")
    assert [story.user("hold")[0], story.user("land")[0], story.user("abort")[0]] == ["DONE", "DONE", "ALREADY"]


def test_commands_that_would_be_done_are_those_that_are():
    for place, row in EXPECTED.items():
        story: Story = at(place)
        context = Context(story.state, ev.Tick(t_ns=story.now), story.rules)
        offered = [command.value for command in decide.available(context)]
        assert offered == [c for c, letter in zip(COMMANDS, row.letters) if letter == "D"], place


def test_every_message_has_words_and_a_known_level():
    assert commands.MESSAGES
    for key, message in commands.MESSAGES.items():
        assert message.text, key
        assert message.level in Level, key


NOT_THE_FIELDS_WORDS = (
    r"\{name\}: \{reason\}",  # a name of the configuration, a colon, a name of a node, a colon, an error
    r"holding position:",
    r"\babsorb|\bturn\b|\btake[ns]? back\b|\bunfit\b|\bfitness\b|\bverb\b",
    r"\bheight\b",
    r"shows? that it lands|told directly|both routes|second route",
    r"is flown\b|missions that were still to come",
    r"give the go",
    r"\bmend(ed|s)?\b",
    r"\blead time\b|prove that files grow",
    r"wrong now|what is done",
    r"hands? over|word of|\btold\b|\bheard\b|said once",
    r"\b(footing|looks|pace|tracks|sight|outlook|carriers|ahead|casting|keeping|hosting|parting|origins|evidence)\b",
)
"""What a pilot would not say; docs/glossary.md has what is said in its place."""


def told_texts():
    yield from ((key, f"{message.text} {message.advice}") for key, message in commands.MESSAGES.items())
    yield from ((command.value, text) for command, text in decide.OTHERWISE.items())
    yield from ((c.value, case.text) for c, row in decide.ANSWERS.items() for cases in row.values() for case in cases)


@pytest.mark.parametrize("pattern", NOT_THE_FIELDS_WORDS)
def test_messages_and_answers_are_in_the_fields_words(pattern):
    found = [(key, text) for key, text in told_texts() if re.search(pattern, text, re.IGNORECASE)]
    assert not found


def said(story):
    return [command.text for command in story.since if isinstance(command, commands.Notify)]


def test_a_hold_says_what_has_failed_what_is_done_and_for_how_long():
    story = at("MISSION flying").look().fail("lrf", 8, "trying")
    assert said(story) == ["Holding for up to 5 s, then landing: lrf fault, restarting it (lrf at code 8)."]
    story.look().fail("barometer", 4)
    assert said(story) == ["Holding for up to 7 s, then flying on: barometer fault (barometer at code 4)."]
    story.look().back("barometer")
    assert said(story) == ["barometer is back."]
    story.look().fail("lrf", 16, "given_up")
    assert said(story) == ["Landing: lrf fault, restarting it did not help (lrf at code 16)."]
    story.look().fail("gps", 2)
    assert said(story) == ["While landing: gps fault (gps at code 2). The landing goes on."]


def test_what_fails_and_comes_back_together_is_one_message():
    """One cause, as a cable, is one sentence, though each component is a failure and a decision of its own."""
    story = at("MISSION flying").look().fail("imu", 16).look()
    for name, code in (("barometer", 16), ("magnetometer", 16), ("gps", 2), ("mission_camera", 2)):
        story.fail(name, code, reason=f"the autopilot's {name}: no answer for longer than 2 s", tell=False)
    assert said(story.tell()) == [
        "Also failed: barometer and magnetometer fault (no answer for longer than 2 s).",
        "While landing: gps and mission_camera fault (no answer for longer than 2 s). The landing goes on.",
    ]
    assert story.rules_fired == ["failure_land"] * 2 + ["failure_continue"] * 2
    story.look().back("barometer", "magnetometer", "gps")
    assert said(story) == ["barometer and magnetometer are back.", "gps is back."], "a status later"


def test_what_fails_together_for_different_reasons_is_told_with_each_of_them():
    story = at("MISSION flying").look().fail("gps", 2, tell=False).fail("magnetometer", 2, "trying", tell=False).tell()
    both = "gps fault (gps at code 2); magnetometer fault, restarting it (magnetometer at code 2)"
    assert said(story) == [f"Flying on: {both}."]


def test_what_is_waited_for_to_different_ends_is_told_apart():
    story = at("MISSION flying").look().fail("lrf", 8).look()
    assert said(story.fail("barometer", 4, tell=False).fail("magnetometer", 4, tell=False).tell()) == [
        "Holding for up to 7 s, then flying on: barometer fault (barometer at code 4).",
        "Holding for up to 6 s, then flying on: magnetometer fault (magnetometer at code 4).",
    ]


def test_what_is_flown_on_with_and_what_is_over_are_said_without_names_of_rules():
    story = at("MISSION flying").look()
    tilt = "tilted further than it should be (tilt 50.0 deg, limit 45.0)."
    assert said(story.say(tilt_deg=50.0)) == [f"Flying on: {tilt}"]
    assert said(story.look().say(tilt_deg=3.0)) == [f"Cleared: {tilt}"]


SWITCH = "the transmitter's land switch"


def first_message(story: Story) -> str:
    return next(c.text for c in story.since if isinstance(c, Notify))


def test_a_landing_of_the_switch_that_was_put_off_is_the_switchs_when_it_goes_out():
    story = at("MISSION flying")
    story.say(mode="POSCTL").vehicle.says.clear()
    story.look().feed(ev.UserRequest, command=ev.UserCommand.LAND, request_id=9, by=SWITCH)
    story.after(0.5).expect("LAND")
    assert first_message(story) == f"Landing as {SWITCH} says."
    decision = next(c for c in story.since if getattr(c, "rule", "") == "user_land")
    assert [(value.name, value.value) for value in decision.values] == [("user", "land"), ("by", SWITCH)]
    assert (story.state.landing.cause, story.state.land_deferred) == (SWITCH, None)


def test_who_asked_first_for_a_landing_that_is_put_off_is_named():
    story = at("MISSION flying")
    story.say(mode="POSCTL").vehicle.says.clear()
    story.user("land")
    story.feed(ev.UserRequest, command=ev.UserCommand.LAND, request_id=9, by=SWITCH)
    story.look().after(0.5).expect("LAND")
    assert first_message(story) == "Landing as you asked."


def test_a_command_at_the_moment_in_which_the_pilot_is_found_to_have_taken_over_is_refused():
    story = at("MISSION flying")
    story.ticking = False
    story.say(mode="POSCTL", pilot_in_control=True)
    story.now += 200_000_000
    story.say()
    story.now += 125_000_000
    assert story.user("land") == ("REFUSED", "The pilot or the autopilot has control; nothing is commanded.")
    story.expect("PILOT")


CANCELLED = "the user aborts before lift-off"
MEANWHILE = {
    "the pilot": ({"pilot_in_control": True, "mode": "POSCTL"}, "the pilot flies (flight mode POSCTL)"),
    "a sensor": (16, "imu at code 16"),
}


@pytest.mark.parametrize("what", MEANWHILE)
def test_what_ends_a_takeoff_that_is_being_cancelled_is_said_by_its_own_cause(what):
    happens, words = MEANWHILE[what]
    story = at("TAKEOFF cancelling").look()
    if isinstance(happens, dict):
        story.say(**happens)
    else:
        story.fail("imu", happens)
    story.after(1.0)
    assert words in first_message(story)
    assert CANCELLED not in first_message(story)


def test_a_doubt_does_not_change_why_a_takeoff_was_cancelled():
    story = at("TAKEOFF cancelling").look()
    story.say(mode="POSCTL", pilot_in_control=True).after(0.2).say().vehicle.says.clear()
    story.say(armed=False, landed=ev.VehicleLanded.ON_GROUND).until("OUTREACH", limit_s=20.0)
    told = {c.key: c.text for c in story.since if isinstance(c, Notify)}
    assert "the pilot flies" in told["takeover_suspected"]
    assert CANCELLED in told["takeoff_refused"]


def test_the_end_of_a_users_hold_names_its_limit():
    story = at("HOLD holding").look().after(121.0).expect("LAND")
    assert first_message(story) == "Landing: the hold that the user asked for has lasted its 120 s."


@pytest.mark.parametrize("command", ["land", "abort", "give_up"])
def test_no_other_mission_takes_off_for_whoever_calls_it_off_just_as_the_limit_of_the_data_ends(command):
    story = at("DATA_CLEANUP queued")
    story.ticking = False
    story.now += 2 * story.rules.limits.data_cleanup_limit_ns
    assert story.user(command)[0] == "DONE"
    assert (story.place[0], story.state.queue) == ("OUTREACH", ())
