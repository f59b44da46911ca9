"""The screens as they are, for every state and for what can go wrong beside: whole texts, wide and narrow."""

from __future__ import annotations

import io
import unicodedata
from dataclasses import replace
from pathlib import Path

import pytest
from console_scenes import CHECKS, MISSIONS, NOW_S, ON_THE_PAGE, SCENES
from rich.console import Console
from write_screens import screen

from amaze_autonomy.console.dialog import press, received
from amaze_autonomy.console.model import (
    Answer,
    MissionRow,
    Note,
    PendingFailure,
    Question,
    Request,
    RequestKind,
    Verdict,
)
from amaze_autonomy.console.screen.style import ASCII, UNICODE
from amaze_autonomy.console.screen.view import Screen
from amaze_autonomy.console.wire import snapshot_of
from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.engine.state import State
from amaze_autonomy.journal.report import WAITS

SCREENS = Path(__file__).parents[1] / "screens"
CHECK_NOTE = Note("10:00:00", 0, "one of the messages")


def draw(desk, width=100, height=None, style=UNICODE, color_system=None):
    out = io.StringIO()
    console = Console(file=out, width=width, color_system=color_system, force_terminal=color_system is not None)
    console.print(Screen(desk, NOW_S, style, height), end="")
    return out.getvalue().splitlines()


@pytest.mark.parametrize("name", SCENES)
def test_on_a_hundred_columns(name):
    assert screen(name, 100, UNICODE) == (SCREENS / f"{name}-100.txt").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", SCENES)
def test_on_sixty_columns_in_ascii(name):
    shown = screen(name, 60, ASCII)
    assert shown == (SCREENS / f"{name}-60.txt").read_text(encoding="utf-8")
    assert shown.isascii()


@pytest.mark.parametrize("scenes", [SCENES, ON_THE_PAGE], ids=["console", "page"])
def test_every_state_of_the_engine_has_a_scene(scenes):
    shown = {desk.snapshot.state for desk in scenes.values() if desk.snapshot is not None}
    assert shown == {state.value for state in State}


def test_scenes_wait_for_what_the_engine_says_and_need_what_it_requires():
    shown = [(desk.snapshot.state, desk.snapshot.waiting_for) for desk in SCENES.values() if desk.snapshot is not None]
    waiting = {(state, words) for state, words in shown if words and state != "HOLD"}
    assert waiting <= {(state.value, words) for state, words in WAITS.items()}
    least = next(each.limit for each in CHECKS if each.name == "battery fraction")
    assert all(each.battery_needed is None or each.battery_needed >= least for each in MISSIONS)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("width, height", [(100, 30), (80, 24), (60, 16), (40, 12), (30, 8)])
def test_band_and_keys_are_visible_in_any_size(name, width, height):
    lines = draw(SCENES[name], width, height)
    whole = draw(SCENES[name], width)
    assert len(lines) == height
    assert {len(line) for line in lines} <= {width}
    assert lines[0] == whole[0]
    assert lines[-1] == whole[-1]


@pytest.mark.parametrize("width, height", [(100, 12), (60, 16), (40, 12)])
@pytest.mark.parametrize("name", ["hold", "land", "mission"])
def test_a_question_is_on_a_terminal_of_any_size_as_it_is_drawn(name, width, height):
    answer = Answer("hold", Verdict.NO_ANSWER, "The engine did not answer in time. " * 4, NOW_S, "HOLD")
    desk = replace(SCENES[name], answer=answer, received_s=NOW_S - 60.0)
    lines = draw(press(desk, "l", NOW_S)[0], width, height)
    question = "LAND at the present position? Y or Enter = yes, any other key = no"
    assert len(lines) == height
    assert question in " ".join(" ".join(lines).split())


@pytest.mark.parametrize("width, height", [(80, height) for height in range(1, 8)] + [(25, 10), (25, 3), (12, 9)])
@pytest.mark.parametrize("name", SCENES)
def test_a_question_and_its_keys_are_the_last_to_go(name, width, height):
    question = Question("LAND at the present position?", Request(RequestKind.COMMAND, 1, UserCommand.LAND), NOW_S)
    desk = replace(SCENES[name], question=question, error="The reason, in many words. " * 9, received_s=NOW_S - 60.0)
    lines = draw(desk, width, height)
    asked = "LAND at the present position? Y or Enter = yes, any other key = no"
    assert (len(lines), {len(line) for line in lines}) == (height, {width})
    assert asked in " ".join(" ".join(lines).split())


@pytest.mark.parametrize("width, height", [(width, height) for width in (1, 2, 10, 25) for height in (1, 4, 8, 24)])
@pytest.mark.parametrize("name", SCENES)
def test_a_window_of_no_size_at_all_is_filled_exactly(name, width, height):
    lines = draw(SCENES[name], width, height)
    assert (len(lines), {len(line) for line in lines}) == (height, {width})


@pytest.mark.parametrize("name", SCENES)
def test_a_screen_of_usual_size_is_filled_exactly(name):
    assert len(draw(SCENES[name], 80, 24)) == 24


@pytest.mark.parametrize("name", [name for name, desk in SCENES.items() if desk.snapshot and desk.snapshot.advice])
def test_on_80_columns_and_24_lines_the_advice_is_on_the_screen(name):
    advice = SCENES[name].snapshot.advice
    assert advice in " ".join(" ".join(draw(SCENES[name], 80, 24)).split())


@pytest.mark.parametrize(
    "name, keys",
    [
        ("ready", "H hold L LAND A ABORT Q close console only"),
        ("land", "H hold L LAND A ABORT Q close console only"),
        ("waiting-engine", "H hold L LAND A ABORT Q close console only"),
        (
            "mission-ended",
            "no contact: key, then Enter: 2_ H Enter hold L Enter LAND A Enter ABORT Ctrl-C close console only",
        ),
    ],
)
def test_without_contact_the_keys_at_the_bottom_are_those_that_stop_the_vehicle_or_bring_it_down(name, keys):
    lines = draw(replace(SCENES[name], received_s=NOW_S - 7.0), 100, style=ASCII)
    rule = max(number for number, line in enumerate(lines) if line == "-" * 100)
    assert " ".join(" ".join(lines[rule + 1 :]).split()).endswith(keys)


def test_the_address_of_the_page_is_on_the_screen():
    lines = draw(replace(SCENES["hold"], page="http://127.0.0.1:8080/#a-token-of-22-letters-"), 80, 24)
    assert lines[-2].split() == ["the", "same", "as", "a", "page:", "http://127.0.0.1:8080/#a-token-of-22-letters-"]
    assert not any("as a page" in line for line in draw(SCENES["hold"], 80, 24))


@pytest.mark.parametrize("name", ["outreach", "hold", "mission", "mission-ended"])
def test_what_does_not_fit_is_there_when_one_scrolls(name):
    notes = tuple(replace(CHECK_NOTE, text=f"no. {number} of the messages", number=number) for number in range(1, 31))
    desk = replace(SCENES[name], notes=notes)
    seen = set()
    for _ in range(20):
        lines = draw(desk, 80, 24)
        assert len(lines) == 24
        seen |= {" ".join(line.split()) for line in lines}
        desk, _ = press(desk, "page down", NOW_S)
    whole = {" ".join(line.split()) for line in draw(replace(desk, scroll=1), 80)}
    assert whole <= seen
    assert any("no. 1 of" in line for line in seen)
    desk, _ = press(replace(desk, scroll=3), "page up", NOW_S)
    assert desk.scroll == 0


def test_scrolling_answers_no_question_and_ends_with_the_state():
    asked = replace(SCENES["hold-land-asked"], notes=(CHECK_NOTE,) * 30)
    scrolled, requests = press(asked, "down", NOW_S)
    assert (scrolled.question, scrolled.scroll, requests) == (asked.question, 1, ())
    assert received(scrolled, SCENES["land"].snapshot, NOW_S).scroll == 0


def test_what_failed_stays_when_there_is_no_room_for_what_passed():
    desk = SCENES["outreach"]
    many = tuple(replace(CHECKS[0], name=f"sensor {number}") for number in range(40))
    desk = replace(desk, snapshot=replace(desk.snapshot, checks=(*many, *CHECKS)))
    text = "\n".join(draw(desk, 100, 24))
    assert all(
        name in text for name in ("battery fraction", "state estimation", "realsense_camera", "more that passed")
    )


def test_an_unknown_state_and_unknown_words_are_shown_as_they_are():
    desk = replace(
        SCENES["hold"],
        snapshot=replace(
            SCENES["hold"].snapshot,
            state="BARREL_ROLL",
            result="",
            failures=(PendingFailure("x", 99, "pirouette", "", None, ""),),
            message_level=77,
            user_commands=("pirouette",),
        ),
    )
    text = "\n".join(draw(desk, style=ASCII))
    assert "BARREL ROLL" in text
    assert "pirouette" in text
    assert "ALARM" in text


class Evil:
    """A message whose every text tries to steer the terminal, or to be read as markup."""

    text = "\x1b[2J\x1b]0;owned\x07[blink]\x9b31m[/nonsense]"
    in_flight = True
    time_left = float("nan")
    files = repetitions = waypoint = waypoints = file_index = repetition = 2
    message_level = 2
    user_commands = ("land", "\x1b[2J")
    state = "\x1b[2JHOLD"

    def __init__(self, *, rows=True):
        if rows:
            self.checks = self.failures = [Evil(rows=False)] * 3

    def __getattr__(self, name):
        if name in ("checks", "failures"):
            raise AttributeError(name)
        return self.text


@pytest.mark.parametrize("state", [each.value for each in State])
def test_nothing_from_the_wire_steers_the_terminal(state):
    message = Evil()
    message.state = state
    desk = replace(
        SCENES["hold"],
        snapshot=snapshot_of(message),
        missions=tuple(MissionRow(id="[red]1", description="[/]", error=error) for error in ("", "[bold")),
        error="[red]typed[/red]",
        answer=Answer("land", Verdict.REFUSED, "[blink]no[/]"),
        question=Question("[red]sure[/]?", Request(RequestKind.QUIT)),
    )
    lines = draw(desk)
    assert [letter for line in lines for letter in line if unicodedata.category(letter) == "Cc"] == []
    text = " ".join(" ".join(lines).split())
    for verbatim in ("[blink]", "[/nonsense]", "[red]typed[/red]", "[blink]no[/]", "[red]sure[/]?"):
        assert verbatim in text
    # In colour, too, the only sequences are rich's own for colour.
    coloured = "\n".join(draw(desk, color_system="truecolor"))
    assert "\x1b[2J" not in coloured
    assert "\x1b]" not in coloured
    assert "\x9b" not in coloured
    assert "\x07" not in coloured


def test_colour_carries_the_severity():
    coloured = {name: draw(SCENES[name], color_system="truecolor")[0] for name in ("mission", "hold", "land", "pilot")}
    backgrounds = {name: line.split("48;2;")[1].split("m")[0] for name, line in coloured.items()}
    assert backgrounds == {"mission": "95;215;95", "hold": "255;215;0", "land": "192;0;0", "pilot": "135;0;175"}
