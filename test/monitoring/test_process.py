"""The verdict on a node, a driver and the autopilot's word about a sensor."""

from __future__ import annotations

from typing import List, Optional

import pytest
from monitoring_feed import S

from amaze_autonomy.monitoring.component import AnswerMonitor
from amaze_autonomy.monitoring.condition import FOREVER_NS, Condition, Level


def asked(answers: List[Optional[bool]], reports: int = 1) -> AnswerMonitor:
    """Return a monitor that was given one answer a tenth of a second, from 0 s."""
    monitor = AnswerMonitor("node /n", S, reports)
    monitor.start(0, S)
    for index, answer in enumerate(answers):
        monitor.add(index * S // 10, answer, "connection refused")
    return monitor


def test_a_node_that_answers_is_good_until_its_answer_is_too_old():
    monitor = asked([True])
    assert monitor.evaluate(S) == Condition(Level.GOOD, age_ns=S, changes_at_ns=S + 1)
    reason = "node /n: no answer for longer than 1 s"
    assert monitor.evaluate(S + 1) == Condition(Level.FAILED, reason, 1.000000001, 1.0, "s", S + 1, FOREVER_NS)


def test_a_refusal_fails_at_once():
    condition = asked([True, False]).evaluate(S // 10)
    assert condition == Condition(Level.FAILED, "node /n: connection refused", age_ns=0, changes_at_ns=S // 10 + S + 1)


def test_an_answer_that_does_not_come_is_neither_good_nor_bad():
    monitor = asked([True, None, None])
    assert monitor.evaluate(S).level is Level.GOOD
    assert monitor.evaluate(S + 1).level is Level.FAILED


def test_a_node_that_was_never_heard_of_is_starting_and_then_failed():
    monitor = asked([])
    assert monitor.evaluate(0) == Condition(Level.STARTING, "node /n: no answer yet", changes_at_ns=S)
    assert monitor.evaluate(S) == Condition(Level.FAILED, "node /n: no answer since the start")


@pytest.mark.parametrize(
    "reports,answers,level",
    [
        (2, [True, False], Level.GOOD),
        (2, [True, False, False], Level.FAILED),
        (2, [True, False, True, False, True], Level.GOOD),
        (2, [False], Level.FAILED),
        (2, [False, True], Level.FAILED),
        (2, [False, True, True], Level.GOOD),
        (3, [True, False, False], Level.GOOD),
    ],
)
def test_the_autopilots_word_counts_when_it_is_said_in_a_row(reports: int, answers: List[Optional[bool]], level: Level):
    assert asked(answers, reports).evaluate(S // 2).level is level


def test_the_first_answer_after_silence_counts_at_once():
    monitor = asked([True], reports=3)
    monitor.evaluate(5 * S)
    assert monitor.add(5 * S, good=False)
    assert monitor.evaluate(5 * S).level is Level.FAILED


def test_it_says_when_an_answer_may_change_the_verdict():
    monitor = AnswerMonitor("node /n", S)
    assert [monitor.add(0, answer) for answer in (None, True, True, False, False, True)] == [
        False,
        True,
        False,
        True,
        False,
        True,
    ]


def test_time_that_jumps_backwards_counts_from_then():
    monitor = AnswerMonitor("node /n", S)
    monitor.add(100 * S, good=True)
    assert monitor.evaluate(10 * S).changes_at_ns == 11 * S + 1
    assert monitor.evaluate(11 * S + 1).level is Level.FAILED
