"""What was typed for a mission, and what is wrong with it."""

from __future__ import annotations

import pytest
from console_scenes import MISSIONS

from amaze_autonomy.console.dialog import chosen, mission_question
from amaze_autonomy.console.model import MissionRow


@pytest.mark.parametrize(
    "typed, ids",
    [("1", ("1",)), (" 1 ", ("1",)), ("1 2", ("1", "2")), ("1,2, 1", ("1", "2", "1"))],
)
def test_one_or_several_missions(typed, ids):
    assert chosen(typed, MISSIONS) == (ids, "")


def test_an_id_with_blanks_is_found_whole():
    assert chosen("north wall", (MissionRow("north wall"), MissionRow("north"))) == (("north wall",), "")


@pytest.mark.parametrize(
    "typed, error",
    [
        ("3", 'There is no mission "3". There are: 1, 2, wall.'),
        ("1 walk", 'There is no mission "walk". Did you mean wall? There are: 1, 2, wall.'),
        ("wall", "Mission wall cannot be flown: wall.csv line 7: z is -1.5 m, must be at least 0.5 m"),
        (" , ", "No mission was named."),
        ("-1", 'There is no mission "-1". Did you mean 1? There are: 1, 2, wall.'),
        ("\x1b[31m1x", 'There is no mission "1x". Did you mean 1? There are: 1, 2, wall.'),
    ],
)
def test_an_error_says_what_would_be_right(typed, error):
    assert chosen(typed, MISSIONS) == ((), error)


def test_an_engine_without_missions():
    assert chosen("1", ()) == ((), 'There is no mission "1". The engine knows no mission.')


def test_the_question_names_what_will_be_flown():
    assert mission_question(("1",), MISSIONS) == (
        "Fly mission 1: Short square, less than a minute (42 s, battery needed 30 %)?"
    )
    assert mission_question(("1", "2", "1"), MISSIONS) == (
        "Fly missions 1, 2, 1, one after the other (8 min 16 s in the air)?"
    )
    assert mission_question(("1", "wall"), MISSIONS) == "Fly missions 1, wall, one after the other (- in the air)?"
