"""The table of keys, written out a second time by hand."""

from __future__ import annotations

import pytest

from amaze_autonomy.console.keys import BINDINGS, QUIT_KEY, binding_of_key, binding_of_word, offered
from amaze_autonomy.console.model import Snapshot
from amaze_autonomy.engine.events import UserCommand

# key, command, asks once more
TABLE = [
    ("g", "go", True),
    ("h", "hold", False),
    ("c", "resume", True),
    ("l", "land", True),
    ("a", "abort", True),
    ("r", "retry", True),
    ("u", "give_up", True),
    ("k", "acknowledge", False),
]


def test_the_table_is_what_the_documentation_says():
    assert [(each.key, each.command.value, bool(each.question)) for each in BINDINGS] == TABLE


def test_every_command_of_the_engine_has_one_key_and_none_closes_the_console():
    assert sorted(each.command.value for each in BINDINGS) == sorted(command.value for command in UserCommand)
    assert len({each.key for each in BINDINGS} | {QUIT_KEY}) == len(BINDINGS) + 1


@pytest.mark.parametrize("key, command, _asks", TABLE)
def test_a_key_works_in_both_cases(key, command, _asks):
    assert binding_of_key(key).command.value == binding_of_key(key.upper()).command.value == command


def test_commands_are_known_by_name():
    words = ("land", "LAND", "give up", "give_up", "  give   up ", "landing")
    assert [getattr(binding_of_word(each), "key", None) for each in words] == ["l", "l", "u", "u", "u", None]


def test_only_what_the_engine_would_do_is_offered():
    snapshot = Snapshot(state="HOLD", user_commands=("abort", "land", "self_destruct"))
    assert [each.key for each in offered(snapshot)] == ["l", "a"]
    assert offered(None) == ()
