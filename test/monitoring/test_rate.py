"""The verdict on a topic's rate and silence, in the words of the flight line."""

from __future__ import annotations

import random
from typing import List

import pytest
from monitoring_feed import S, follow, regular

from amaze_autonomy.monitoring.condition import FOREVER_NS, Condition, Level
from amaze_autonomy.monitoring.rate import RateMonitor, return_time_ns
from amaze_autonomy.monitoring.specs import TopicSpec

UNKNOWN_RATE = "its rate is not known yet"


def running(rate_hz: float, until_s: float = 20.0, **limits: int) -> RateMonitor:
    """Return a monitor of a topic that has come as intended, from 0 s."""
    monitor = RateMonitor(TopicSpec("/t", rate_hz, **limits))
    monitor.start(0, 10 * S)
    for t_ns in regular(rate_hz, 0.0, until_s):
        monitor.add(t_ns)
    return monitor


def levels(changes: List[tuple]) -> List[Level]:
    return [level for _, level, _ in changes]


@pytest.mark.parametrize("rate_hz", [0.2, 1.0, 10.0, 30.0, 200.0, 1000.0])
def test_a_topic_as_intended_is_good_once_its_rate_is_known(rate_hz: float):
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    monitor.start(0, 30 * S)
    changes = follow(monitor, regular(rate_hz, 0.5, 200.0), 200 * S)
    assert levels(changes) == [Level.STARTING, Level.STARTING, Level.GOOD]


@pytest.mark.parametrize("rate_hz,known_after_s", [(200.0, 0.8), (30.0, 0.8), (10.0, 0.9), (1.0, 6.0), (0.2, 30.0)])
def test_the_rate_is_known_soon(rate_hz: float, known_after_s: float):
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    monitor.start(0, 10 * S)
    good = [at for at, level, _ in follow(monitor, regular(rate_hz, 0.0, 100.0), 100 * S) if level is Level.GOOD]
    assert good[0] <= known_after_s * S


def test_it_is_steady_from_when_it_is_good_until_something_speaks_against_it():
    monitor = RateMonitor(TopicSpec("/t", 10.0))
    monitor.start(0, 10 * S)
    assert monitor.steady is False
    monitor = running(10.0)
    assert monitor.steady is True
    for t_ns in regular(2.0, 20.0, 40.0):
        monitor.add(t_ns)
    assert monitor.steady is False


@pytest.mark.parametrize(
    "rate_hz,count,marked",
    [(10.0, 1, True), (10.0, 100, True), (200.0, 1, False), (200.0, 3, False), (200.0, 60, True)],
)
def test_what_is_skipped_leaves_it_as_if_it_had_come(rate_hz: float, count: int, marked: bool):  # noqa: FBT001
    came, skipped = running(rate_hz, 20.05), running(rate_hz, 20.05)
    before, times = list(came._marks), [20 * S + S // 20 + round(number * S / rate_hz) for number in range(count)]
    for t_ns in times:
        came.add(t_ns)
    marks = () if list(came._marks) == before else tuple(came._marks)
    skipped.skip(times[-1], len(times), marks, came._rate_hz)
    assert vars(skipped) == vars(came)
    assert bool(marks) is marked


def test_a_hitch_while_it_starts_is_not_a_rate_that_is_off():
    monitor = RateMonitor(TopicSpec("/t", 5.0))
    monitor.start(0, 10 * S)
    hitch = [0.9, 0.95, 1.0, 1.05, *(1.25 + 0.2 * index for index in range(60))]  # what had waited comes at once
    changes = follow(monitor, [round(t_s * S) for t_s in hitch], 12 * S)
    assert levels(changes) == [Level.STARTING, Level.STARTING, Level.GOOD]


def test_a_topic_that_starts_at_a_wrong_rate_is_off_after_a_whole_window():
    spec = TopicSpec("/t", 5.0)
    monitor = RateMonitor(spec)
    monitor.start(0, 10 * S)
    changes = follow(monitor, regular(7.6, 0.5, 20.0), 20 * S)
    assert levels(changes) == [Level.STARTING, Level.STARTING, Level.OFF]
    assert spec.rate_window_ns <= changes[-1][0] - S // 2 <= spec.rate_window_ns + S


@pytest.mark.parametrize(
    "rate_hz,limit_s", [(200.0, 0.05), (200.0, 0.5), (30.0, 0.2), (1.0, 3.0), (0.2, 15.0), (0.2, 20.0)]
)
def test_a_topic_that_stops_is_seen_one_nanosecond_after_its_limit(rate_hz: float, limit_s: float):
    monitor = running(rate_hz, 100.0, age_limit_ns=int(limit_s * S))
    last_ns = regular(rate_hz, 0.0, 100.0)[-1]
    limit_ns = monitor.spec.silence_limit_ns
    assert abs(limit_ns - limit_s * S) <= 3
    before = monitor.evaluate(last_ns + limit_ns)
    assert (before.level, before.changes_at_ns) == (Level.GOOD, last_ns + limit_ns + 1)
    reason = f"no message on /t for longer than {limit_s:g} s"
    assert monitor.evaluate(last_ns + limit_ns + 1) == Condition(
        Level.FAILED, reason, (limit_ns + 1) / S, limit_ns / S, "s", limit_ns + 1, FOREVER_NS
    )


def test_a_topic_that_never_came_is_starting_and_then_failed():
    monitor = RateMonitor(TopicSpec("/t", 10.0))
    monitor.start(S, 10 * S)
    assert monitor.evaluate(S) == Condition(Level.STARTING, "no message on /t yet", changes_at_ns=11 * S)
    assert monitor.evaluate(11 * S) == Condition(Level.FAILED, "no message on /t since the start")


def test_a_topic_that_comes_too_late_stays_failed_until_its_rate_is_known():
    monitor = RateMonitor(TopicSpec("/t", 30.0))
    monitor.start(0, 5 * S)
    changes = follow(monitor, regular(30.0, 8.0, 10.0), 10 * S)
    assert levels(changes) == [Level.STARTING, Level.FAILED, Level.GOOD]


def test_before_the_watching_has_begun_nothing_has_failed():
    monitor = RateMonitor(TopicSpec("/t", 30.0))
    assert monitor.evaluate(100 * S) == Condition(Level.STARTING, "no message on /t yet")
    monitor.add(100 * S)
    assert monitor.evaluate(100 * S)[:2] == (Level.STARTING, UNKNOWN_RATE)


@pytest.mark.parametrize(
    "fraction,level,reason",
    [
        (0.85, Level.GOOD, ""),
        (1.15, Level.GOOD, ""),
        (0.5, Level.OFF, "too slow, expected 100 Hz"),
        (0.35, Level.OFF, "too slow, expected 100 Hz"),
        (0.1, Level.FAILED, "below 30 Hz it has failed"),
        (1.5, Level.OFF, "too fast, expected 100 Hz"),
        (10.0, Level.OFF, "too fast, expected 100 Hz"),
    ],
)
def test_a_rate_that_is_off_is_code_2_and_far_too_slow_is_a_failure(fraction: float, level: Level, reason: str):
    monitor = running(100.0)
    for t_ns in regular(100.0 * fraction, 20.0, 25.0):
        monitor.add(t_ns)
    condition = monitor.evaluate(25 * S)
    assert condition.level is level
    assert condition.reason.endswith(reason)
    assert condition.value == pytest.approx(100.0 * fraction, rel=0.02)
    assert condition.unit == "Hz"


@pytest.mark.parametrize(
    "fraction,limit,other",
    [(0.85, 80.0, 120.0), (0.5, 80.0, 120.0), (1.15, 120.0, 80.0), (1.5, 120.0, 80.0), (0.1, 30.0, None)],
)
def test_a_rate_lies_between_two_limits_of_which_the_nearer_stands_first(fraction: float, limit: float, other: float):
    monitor = running(100.0)
    for t_ns in regular(100.0 * fraction, 20.0, 25.0):
        monitor.add(t_ns)
    condition = monitor.evaluate(25 * S)
    assert (condition.limit, condition.other_limit) == (limit, other)


def test_half_rate_is_seen_after_one_window():
    """Half of it until the slope is out of tolerance, half of it in which that has to stand."""
    monitor = running(100.0)
    changes = follow(monitor, regular(50.0, 20.0, 25.0), 25 * S)
    assert levels(changes) == [Level.GOOD, Level.OFF]
    assert changes[1] == (21 * S, Level.OFF, "55.9 Hz on /t, too slow, expected 100 Hz")


@pytest.mark.parametrize("rate_hz", [30.0, 200.0])
def test_a_topic_that_goes_from_too_slow_to_too_fast_says_so(rate_hz: float):
    monitor = running(rate_hz, 10.0)
    times = regular(rate_hz / 2, 10.0, 20.0) + regular(2 * rate_hz, 20.0, 30.0)
    reasons = [reason for _, _, reason in follow(monitor, times, times[-1])]
    assert ["slow" in reasons[-2], "fast" in reasons[-1]] == [True, True]


def test_a_lost_tenth_of_a_second_changes_nothing():
    monitor = running(200.0)
    changes = follow(monitor, regular(200.0, 20.1, 25.0) + regular(200.0, 25.1, 30.0), 30 * S)
    assert levels(changes) == [Level.GOOD]


def test_a_dip_that_is_caught_up_within_half_a_window_changes_nothing():
    monitor = running(200.0)
    times = regular(100.0, 20.0, 20.6) + regular(400.0, 20.6, 20.75) + regular(200.0, 20.75, 25.0)
    assert levels(follow(monitor, times, 25 * S)) == [Level.GOOD]


@pytest.mark.parametrize("rate_hz", [5.0, 30.0, 200.0])
def test_jitter_of_half_a_period_never_flaps(rate_hz: float):
    generator = random.Random(7)
    times = [t_ns + int(generator.uniform(-0.5, 0.5) * S / rate_hz) for t_ns in regular(rate_hz, 20.0, 320.0)]
    changes = follow(running(rate_hz), sorted(times), 320 * S)
    assert levels(changes) == [Level.GOOD]


@pytest.mark.parametrize("burst", [2, 5, 20])
def test_bursts_never_flap(burst: int):
    times = [t_ns // (burst * S // 200) * (burst * S // 200) for t_ns in regular(200.0, 20.0, 120.0)]
    changes = follow(running(200.0), times, 120 * S)
    assert levels(changes) == [Level.GOOD]


@pytest.mark.parametrize("edge", [0.8, 1.2])
def test_a_rate_on_the_edge_of_its_tolerance_does_not_flap(edge: float):
    generator = random.Random(11)
    times, t_s = [], 20.0
    while t_s < 140.0:
        t_s += generator.uniform(0.9, 1.1) / (100.0 * edge)
        times.append(int(t_s * S))
    assert len(follow(running(100.0), times, 140 * S)) <= 2


def test_it_is_back_after_good_samples_at_the_intended_rate_and_not_before():
    monitor = running(30.0)
    changes = follow(monitor, regular(30.0, 30.0, 35.0), 35 * S)
    assert levels(changes) == [Level.GOOD, Level.FAILED, Level.GOOD]
    assert 0.5 * S <= changes[2][0] - 30 * S <= 0.75 * S


@pytest.mark.parametrize(
    "rate_hz, good_samples, expected_s",
    [
        (200.0, 5, 0.63),
        (30.0, 5, 0.77),
        (10.0, 5, 0.6),
        (1.0, 5, 5.0),
        (0.2, 5, 25.0),
        (0.2, 1, 20.0),
        (20.0, 1000, 50.1),
    ],
)
def test_how_long_a_topic_needs_to_be_back_is_known_before(rate_hz: float, good_samples: int, expected_s: float):
    assert return_time_ns(TopicSpec("/t", rate_hz), good_samples) / S == pytest.approx(expected_s, abs=0.05)


def test_one_message_a_second_does_not_bring_a_fast_topic_back():
    monitor = running(30.0)
    changes = follow(monitor, regular(1.0, 25.0, 60.0), 60 * S)
    assert levels(changes) == [Level.GOOD, Level.FAILED]


def test_a_topic_that_comes_back_too_slow_stays_failed_with_the_new_reason():
    monitor = running(100.0)
    changes = follow(monitor, regular(5.0, 25.0, 60.0), 60 * S)
    assert levels(changes) == [Level.GOOD, Level.FAILED, Level.FAILED]
    assert changes[-1][2] == "5 Hz on /t, below 30 Hz it has failed"


def test_silence_that_nobody_asked_about_is_noticed_with_the_next_message():
    monitor = running(30.0, 20.0)
    assert monitor.add(22 * S)
    assert monitor.evaluate(22 * S).level is Level.FAILED


def test_time_that_jumps_backwards_keeps_the_verdict_and_the_topic_stays_good():
    monitor = running(30.0)
    changes = follow(monitor, regular(30.0, 5.0, 15.0), 15 * S)
    assert levels(changes) == [Level.GOOD]


def test_a_topic_that_stops_with_a_jump_backwards_is_still_seen():
    monitor = running(30.0)
    assert monitor.evaluate(5 * S).level is Level.GOOD
    due_ns = monitor.evaluate(5 * S).changes_at_ns
    assert due_ns == 5 * S + monitor.spec.silence_limit_ns + 1
    assert monitor.evaluate(due_ns).level is Level.FAILED


def test_up_to_two_periods_late_moves_nothing_and_more_is_time_that_jumped():
    monitor = running(30.0)
    last_ns = monitor.evaluate(20 * S).changes_at_ns - monitor.spec.silence_limit_ns - 1
    late_ns = last_ns - 2 * monitor.spec.period_ns
    for came_ns, counts_ns in ((late_ns, last_ns), (late_ns - 1, late_ns - 1)):
        monitor.add(came_ns)
        assert monitor.evaluate(came_ns).changes_at_ns == counts_ns + monitor.spec.silence_limit_ns + 1


def test_messages_are_counted_in_parts_of_the_window_or_of_half_a_period():
    fast, slow = TopicSpec("/t", 200.0), TopicSpec("/t", 10.0)
    assert RateMonitor(fast).bucket_ns == fast.rate_window_ns // 8 >= 2 * fast.period_ns
    assert slow.rate_window_ns // 8 < 2 * slow.period_ns
    assert RateMonitor(slow).bucket_ns == slow.period_ns // 2


def test_late_and_empty_batches_are_harmless():
    monitor = running(30.0)
    before = monitor.evaluate(20 * S)
    assert not monitor.add(20 * S - S // 30 - 1000)
    assert not monitor.add(20 * S, 0)
    assert not monitor.add(20 * S, -3)
    assert monitor.evaluate(20 * S) == before
    assert monitor.total == 601
