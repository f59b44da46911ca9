"""Laws of the rate monitor over streams that nobody thought of."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from itertools import groupby
from typing import List, Tuple

from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S, follow, regular

from amaze_autonomy.monitoring.condition import FOREVER_NS, Condition, Level
from amaze_autonomy.monitoring.rate import RateMonitor
from amaze_autonomy.monitoring.specs import TopicSpec

rates = st.sampled_from([0.2, 1.0, 7.0, 30.0, 100.0, 200.0])
gaps = st.lists(st.integers(0, 4 * S), min_size=1, max_size=60)


def times_of(steps: List[int]) -> List[int]:
    times, now = [], S
    for step in steps:
        now += step
        times.append(now)
    return times


def stream(rate_hz: float, factors: List[float]) -> List[int]:
    """Return a stream that comes at a changing fraction of its rate, about three seconds or periods at each."""
    now, times = S, []
    for factor in factors:
        step = int(S / (rate_hz * factor))
        for _ in range(max(3, int(3 * rate_hz * factor))):
            now += step
            times.append(now)
    return times


def history(rate_hz: float, batches: List[Tuple[int, int]], asked: List[int]) -> List[Condition]:
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    monitor.start(0, 5 * S)
    answers, pending = [], list(reversed(batches))
    for t_ns in asked:
        while pending and pending[-1][0] <= t_ns:
            monitor.add(*pending.pop())
        answers.append(monitor.evaluate(t_ns))
    return answers


@given(rates, st.lists(st.sampled_from([0.1, 0.3, 0.5, 0.79, 1.0, 1.0, 1.3, 3.0]), min_size=1, max_size=6))
def test_the_verdict_does_not_depend_on_how_messages_are_batched(rate_hz: float, factors: List[float]):
    times = stream(rate_hz, factors)
    alone = RateMonitor(TopicSpec("/t", rate_hz))
    alone.start(0, 5 * S)
    changes = follow(alone, times, times[-1] + 30 * S)
    step = S // 20
    asked = sorted({*range(0, times[-1] + 30 * S, step), *(at for at, _, _ in changes)})
    fences = sorted({*asked, *range(0, times[-1] + alone.bucket_ns, alone.bucket_ns)})
    batches, index = [], 0
    for _, group in groupby(times, key=lambda t_ns: _interval(t_ns, fences)):
        batch = list(group)
        batches.append((batch[-1], len(batch)))
        index += len(batch)
    assert index == len(times)
    assert history(rate_hz, batches, asked) == history(rate_hz, [(t_ns, 1) for t_ns in times], asked)


def _last_change(changes: List[Tuple[int, Level, str]], at: int) -> Tuple[Level, str]:
    return [(level, reason) for since, level, reason in changes if since <= at][-1]


def _interval(t_ns: int, fences: List[int]) -> Tuple[int, bool]:
    """Return which of the intervals between fences a time lies in; what is asked at a fence comes after it."""
    return bisect_left(fences, t_ns), bisect_right(fences, t_ns) != bisect_left(fences, t_ns)


@given(rates, st.lists(st.sampled_from([0.1, 0.5, 1.0, 1.3]), min_size=1, max_size=4), st.randoms())
def test_the_verdict_does_not_depend_on_how_often_one_asks(rate_hz: float, factors: List[float], random):
    times = stream(rate_hz, factors)
    end_ns = times[-1] + 30 * S
    seldom = RateMonitor(TopicSpec("/t", rate_hz))
    seldom.start(0, 5 * S)
    changes = follow(seldom, times, end_ns)
    asked = sorted({*(random.randrange(end_ns) for _ in range(300)), *(at for at, _, _ in changes), *times})
    often = history(rate_hz, [(t_ns, 1) for t_ns in times], asked)
    assert [condition[:2] for condition in often] == [_last_change(changes, at) for at in asked]


@given(rates, gaps)
def test_a_topic_that_stops_is_always_seen_within_its_limit(rate_hz: float, steps: List[int]):
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    monitor.start(0, S)
    times = times_of(steps)
    follow(monitor, times, times[-1])
    due_ns = times[-1] + monitor.spec.silence_limit_ns + 1
    assert monitor.evaluate(due_ns).level is Level.FAILED


@given(rates, gaps)
def test_the_verdict_stands_until_the_time_it_names(rate_hz: float, steps: List[int]):
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    monitor.start(0, S)
    for t_ns in times_of(steps):
        monitor.add(t_ns)
        now = monitor.evaluate(t_ns)
        later = monitor.evaluate(min(now.changes_at_ns - 1, t_ns + 1000 * S))
        assert (later.level, later.reason) == (now.level, now.reason)


@given(
    st.sampled_from([0.2, 10.0, 200.0]),
    st.lists(st.tuples(st.integers(0, 2**62), st.integers(-5, 1000), st.integers(0, 2**62))),
)
def test_no_time_and_no_count_breaks_it(rate_hz: float, calls: List[Tuple[int, int, int]]):
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    for last_ns, count, asked_ns in calls:
        monitor.add(last_ns, count)
        condition = monitor.evaluate(asked_ns)
        assert condition.changes_at_ns == FOREVER_NS or condition.changes_at_ns > asked_ns


@given(st.integers(0, 100 * S), rates)
def test_a_topic_that_stops_with_any_jump_of_time_is_seen_within_twice_its_limit(jump_to_ns: int, rate_hz: float):
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    monitor.start(0, S)
    for t_ns in regular(rate_hz, 20.0, 120.0):
        monitor.add(t_ns)
    now = jump_to_ns
    while monitor.evaluate(now).level is not Level.FAILED:
        now = monitor.evaluate(now).changes_at_ns
    assert now - jump_to_ns <= max(
        2 * monitor.spec.silence_limit_ns + 2, 120 * S - jump_to_ns + monitor.spec.silence_limit_ns
    )
