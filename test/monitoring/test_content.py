"""The verdict on what a topic says: finite, changing, stamped with the present."""

from __future__ import annotations

from typing import Optional

from monitoring_feed import S

from amaze_autonomy.monitoring.component import ContentMonitor
from amaze_autonomy.monitoring.condition import FOREVER_NS, Condition, Level
from amaze_autonomy.monitoring.specs import TopicSpec


def content(
    *, finite: bool = False, unchanged_limit_ns: Optional[int] = None, stamp_tolerance_ns: Optional[int] = None
) -> ContentMonitor:
    spec = TopicSpec(
        "/t", 10.0, finite=finite, unchanged_limit_ns=unchanged_limit_ns, stamp_tolerance_ns=stamp_tolerance_ns
    )
    monitor = ContentMonitor(spec)
    monitor.start(0, S)
    return monitor


def test_content_that_was_never_told_is_starting_and_then_failed():
    monitor = content(finite=True)
    assert monitor.evaluate(0) == Condition(Level.STARTING, "no content of /t yet", changes_at_ns=S)
    assert monitor.evaluate(S) == Condition(Level.FAILED, "no content of /t since the start")


def test_content_that_nobody_asks_for_is_good():
    monitor = content()
    assert not monitor.wanted
    assert monitor.evaluate(100 * S) == Condition(Level.GOOD)


def test_a_single_nan_is_no_failure_and_only_nan_is_seen_like_silence():
    monitor = content(finite=True)
    monitor.add(0, finite=True, digest=1)
    for index in range(1, 5):
        monitor.add(index * S // 10, finite=False, digest=index)
    assert monitor.evaluate(S // 2) == Condition(Level.GOOD, "", 0.5, 0.5, "s", S // 2, S // 2 + 1)
    reason = "nothing but NaN or infinity on /t for longer than 0.5 s"
    assert monitor.evaluate(S // 2 + 1) == Condition(
        Level.FAILED, reason, 0.500000001, 0.5, "s", S // 2 + 1, FOREVER_NS
    )


def test_nan_from_the_first_message_on_is_a_failure_after_the_start():
    monitor = content(finite=True)
    monitor.add(0, finite=False, digest=1)
    assert monitor.evaluate(S // 2).level is Level.STARTING
    assert monitor.evaluate(S) == Condition(Level.FAILED, "no finite value on /t since the start")


def test_content_that_stays_the_same_is_a_failure():
    monitor = content(unchanged_limit_ns=S)
    for index in range(30):
        monitor.add(index * S // 10, finite=True, digest=min(index, 10))
    condition = monitor.evaluate(3 * S)
    reason = "the content of /t has not changed for longer than 1 s"
    assert condition == Condition(Level.FAILED, reason, 2.0, 1.0, "s", 2 * S, FOREVER_NS)


def test_it_is_back_after_five_usable_messages_in_a_row():
    monitor = content(unchanged_limit_ns=S)
    monitor.add(0, finite=True, digest=1)
    assert monitor.evaluate(2 * S).level is Level.FAILED
    changed = [monitor.add(2 * S + index, finite=True, digest=2 + index) for index in range(5)]
    assert changed == [False, False, False, False, True]
    assert monitor.evaluate(2 * S + 5).level is Level.GOOD


def test_so_it_is_when_time_has_jumped_back_meanwhile():
    monitor = content(unchanged_limit_ns=S)
    monitor.add(0, finite=True, digest=1)
    assert monitor.evaluate(2 * S).level is Level.FAILED
    changed = [monitor.add(S // 2 + index, finite=True, digest=2 + index) for index in range(5)]
    assert changed == [False, False, False, False, True]


def test_until_then_the_reason_says_that_it_is_coming_back():
    monitor = content(unchanged_limit_ns=S)
    monitor.add(0, finite=True, digest=1)
    monitor.evaluate(2 * S)
    monitor.add(2 * S, finite=True, digest=2)
    condition = monitor.evaluate(2 * S)
    assert condition[:2] == (Level.FAILED, "the content of /t is usable again, not yet for long enough")


def test_a_failure_that_nobody_asked_about_is_noticed_with_the_next_message():
    monitor = content(finite=True)
    monitor.add(0, finite=True, digest=1)
    monitor.add(2 * S, finite=True, digest=2)
    assert monitor.evaluate(2 * S).level is Level.FAILED


def test_stamps_are_off_after_five_in_a_row_and_right_again_after_five():
    monitor = content(stamp_tolerance_ns=S)
    off = [monitor.add_stamp(index + 20 * S, 0) for index in range(5)]
    assert off == [False, False, False, False, True]
    reason = "stamps on /t are more than 1 s off the clock"
    expected = Condition(Level.OFF, reason, (20 * S + 4) / S, 1.0, "s", other_limit=-1.0)
    assert monitor.evaluate(21 * S) == expected
    right = [monitor.add_stamp(index + 20 * S, 20 * S) for index in range(5)]
    assert right == [False, False, False, False, True]
    assert monitor.evaluate(21 * S) == Condition(Level.GOOD)


def test_one_wrong_stamp_among_right_ones_changes_nothing():
    monitor = content(stamp_tolerance_ns=S)
    assert not any(monitor.add_stamp(20 * S, 0 if index % 3 else 20 * S) for index in range(100))


def test_failures_outrank_stamps():
    monitor = content(finite=True, stamp_tolerance_ns=S)
    for _ in range(5):
        monitor.add_stamp(20 * S, 0)
    assert monitor.evaluate(20 * S).reason == "no content of /t since the start"


def test_time_that_jumps_backwards_counts_from_then():
    monitor = content(finite=True, unchanged_limit_ns=S)
    monitor.add(100 * S, finite=True, digest=1)
    assert monitor.evaluate(10 * S).level is Level.GOOD
    assert monitor.evaluate(10 * S).changes_at_ns == 10 * S + S // 2 + 1
    assert monitor.evaluate(11 * S).level is Level.FAILED
