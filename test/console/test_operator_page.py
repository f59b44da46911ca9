"""The operator's page says of keys, results and pictures what is so."""

from __future__ import annotations

import re
from pathlib import Path

from amaze_autonomy.console.keys import BINDINGS
from amaze_autonomy.console.model import Verdict
from amaze_autonomy.engine.state import Result, State

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "operator.md").read_text(encoding="utf-8")


def first_cells(heading):
    """Return the first cells of the table under a heading row."""
    rows = PAGE.split(f"| {heading} |", 1)[1].split("\n\n", 1)[0].splitlines()[2:]
    return [row.split("|")[1].strip() for row in rows]


def test_the_table_of_keys():
    rows = re.findall(r"^\| `([A-Z])` \| ([a-z ]+) \| (yes|no) \|", PAGE, re.MULTILINE)
    assert rows == [
        (each.key.upper(), each.command.value.replace("_", " "), "yes" if each.question else "no") for each in BINDINGS
    ]


def test_every_result_and_every_answer_is_explained():
    assert first_cells("Result") == [each.value for each in Result if each.value]
    assert sorted(first_cells("Answer")) == sorted(each.value for each in Verdict)


def test_every_state_is_mentioned():
    told = PAGE.upper().replace("SELECTING A MISSION", "MISSION_INPUT").replace("MISSION ENDED", "MISSION_ENDED")
    assert [state.value for state in State if state.value not in told] == []


def test_every_picture_is_there_and_none_is_left_over():
    shown = re.findall(r"\(images/(console-[a-z-]+\.svg)\)", PAGE)
    assert sorted(shown) == sorted(path.name for path in (DOCS / "images").glob("console-*.svg"))
