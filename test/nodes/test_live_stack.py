"""Laws and modes are checked on every live flight: one that left no journal is no flight that kept the laws."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.journal.journal import encode_header, make_header

sys.path.append(str(Path(__file__).parents[1] / "ros"))

from stack import Stack


@pytest.fixture
def stack(tmp_path):
    """Return the stack of a test whose engine has ended in good order and left nothing."""
    stack = Stack.__new__(Stack)
    stack.name, stack.output, stack.engine = "a_test", tmp_path, SimpleNamespace(returncode=0)
    return stack


def header():
    return encode_header(make_header(Rules(), {}, "0", boot_id="0")) + "\n"


@pytest.mark.parametrize("status", [0, 8, -9, None])
def test_a_flight_without_a_journal_keeps_no_laws(stack, status):
    stack.engine.returncode = status
    with pytest.raises(AssertionError, match="a_test: its flight left no journal"):
        stack.check_laws()


@pytest.mark.parametrize("engine", [None, SimpleNamespace(returncode=2)], ids=["never started", "refused to start"])
def test_where_no_engine_began_a_mission_there_is_no_law_to_keep_and_that_is_said(stack, engine, capsys):
    stack.engine = engine
    stack.check_laws()
    assert capsys.readouterr().out == "a_test: no mission was begun: no law to check\n"


@pytest.mark.parametrize("place", [".", "earlier", "earlier-2"])
def test_a_journal_is_judged_wherever_the_run_left_it(stack, place):
    folder = stack.output / place
    folder.mkdir(exist_ok=True)
    (folder / "journal.jsonl").write_text(header(), encoding="ascii")
    stack.check_laws()
    (folder / "journal.jsonl").write_text(header() + "damaged\n", encoding="ascii")
    with pytest.raises(ValueError, match="damaged"):
        stack.check_laws()


@pytest.mark.parametrize("name, mode", [(".", 0o755), ("journal.jsonl", 0o644), ("journal.jsonl", 0o600)])
def test_what_others_may_read_or_the_group_may_not_is_named(stack, name, mode):
    stack.output = stack.output / "out"
    stack.output.mkdir()
    (stack.output / "journal.jsonl").write_text(header(), encoding="ascii")
    for each, right in ((".", 0o750), ("journal.jsonl", 0o640)):
        (stack.output / each).chmod(right)
    assert stack.check_modes() == [stack.output / "journal.jsonl"]
    (stack.output / name).chmod(mode)
    with pytest.raises(AssertionError, match=f"'{re.escape(name)}': '0{mode:o}'"):
        stack.check_modes()
