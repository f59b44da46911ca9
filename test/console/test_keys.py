"""The table of keys, written out a second time by hand."""

from __future__ import annotations

import pytest

from amaze_autonomy.console.keys import BINDINGS, QUIT_KEY, binding_of_key, binding_of_word, goes_out, offered
from amaze_autonomy.console.model import Snapshot
from amaze_autonomy.engine.events import SAFE, UserCommand

# key, command, what is yes to its question, stops the vehicle or brings it down
TABLE = [
    ("g", "go", "y", False),
    ("h", "hold", "", True),
    ("c", "resume", "y", False),
    ("l", "land", "y enter", True),
    ("a", "abort", "y enter", True),
    ("r", "retry", "y", False),
    ("u", "give_up", "y enter", False),
    ("k", "acknowledge", "", False),
]


def test_the_table_is_what_the_documentation_says():
    yes = [" ".join(["y", *["enter"] * each.enter_is_yes]) if each.question else "" for each in BINDINGS]
    rows = [(each.key, each.command.value, said, each.command in SAFE) for each, said in zip(BINDINGS, yes)]
    assert rows == TABLE
    assert [each.value for each in SAFE] == ["hold", "land", "abort"]


def test_every_command_of_the_engine_has_one_key_and_none_closes_the_console():
    assert sorted(each.command.value for each in BINDINGS) == sorted(command.value for command in UserCommand)
    assert len({each.key for each in BINDINGS} | {QUIT_KEY}) == len(BINDINGS) + 1


@pytest.mark.parametrize("key, command, _yes, _safe", TABLE)
def test_a_key_works_in_both_cases(key, command, _yes, _safe):
    assert binding_of_key(key).command.value == binding_of_key(key.upper()).command.value == command


def test_commands_are_known_by_name():
    words = ("land", "LAND", "give up", "give_up", "  give   up ", "landing")
    assert [getattr(binding_of_word(each), "key", None) for each in words] == ["l", "l", "u", "u", "u", None]


def test_only_what_the_engine_would_do_is_offered():
    snapshot = Snapshot(state="HOLD", user_commands=("abort", "land", "self_destruct"))
    assert [each.key for each in offered(snapshot)] == ["l", "a"]


@pytest.mark.parametrize(
    "snapshot, heard", [(None, True), (None, False), (Snapshot("READY", user_commands=("go",)), False)]
)
def test_of_an_engine_that_is_not_heard_only_what_is_safe_is_offered(snapshot, heard):
    assert [each.key for each in offered(snapshot, heard=heard)] == ["h", "l", "a"]


def test_land_goes_out_in_every_state_and_all_else_where_it_is_offered():
    snapshot = Snapshot(state="READY", user_commands=("go",))
    for heard, sent in ((True, ["go", "land"]), (False, ["hold", "land", "abort"])):
        assert [each.value for each in UserCommand if goes_out(each, snapshot, heard=heard)] == sent
