"""Goldens say that the checks are asked, not which: it is always all of them, and this test alone knows it."""

from __future__ import annotations

from pathlib import Path

import pytest

from amaze_autonomy.engine.commands import RunCheck
from amaze_autonomy.engine.events import CheckName
from amaze_autonomy.tester import run_task, tasks_of
from amaze_autonomy.tester.difference import without_numbers
from amaze_autonomy.tester.golden import decisions_of

SUITE = Path(__file__).parents[1] / "scenarios"
CHECKS = [f"{RunCheck.__name__}({check.name})" for check in CheckName]


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "name, rounds", [("nominal", 2), ("checks_slow", 3), ("two_missions", 4), ("go_never_given", 6)]
)
def test_whoever_asks_asks_for_every_check_in_their_order(name, rounds):
    (task,) = tasks_of([SUITE / f"{name}.scenario.yaml"])
    commands = [without_numbers(decision.commands) for decision in decisions_of(run_task(task).lines)]
    asked = [[name for name in each if name.startswith(RunCheck.__name__)] for each in commands]
    assert [each for each in asked if each] == [CHECKS] * rounds
