"""Messages taken together leave a rate monitor as it would be had it taken them one after the other."""

from __future__ import annotations

from bisect import bisect_right
from random import Random

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from replay_bags import S

from amaze_autonomy.monitoring.condition import FOREVER_NS, Level
from amaze_autonomy.monitoring.rate import RateMonitor
from amaze_autonomy.monitoring.specs import TopicSpec
from amaze_autonomy.replay.monitors.monitor_columns import RateColumns
from amaze_autonomy.replay.recordings.fields import Track

RATES = (0.5, 5.0, 30.0, 200.0)
parts = st.lists(
    st.tuples(
        st.sampled_from([1.0, 1.0, 1.0, 1.0, 0.81, 0.79, 0.5, 0.2, 1.25, 3.0]),  # of the rate
        st.integers(1, 300),  # messages
        st.sampled_from([0, 0, 0, 1, S // 3, S // 2 + 1, S, 7 * S]),  # silence before them
        st.sampled_from([0.0, 0.2, 0.9]),  # jitter, of a period
    ),
    min_size=1,
    max_size=6,
)


def times_of(rate_hz, told, random):
    now, times = 1_600_000_000 * S, []
    for fraction, count, silence_ns, jitter in told:
        now += silence_ns
        period = S / (rate_hz * fraction)
        for _ in range(count):
            now += max(0, int(period * (1 + random.uniform(-jitter, jitter))))
            times.append(now)
    return times


def made(rate_hz, begin_ns):
    monitor = RateMonitor(TopicSpec("/t", rate_hz))
    monitor.start(begin_ns, 5 * S)
    return monitor


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(RATES), parts, st.integers(0, 2**32).map(Random))
def test_a_monitor_is_left_as_by_one_message_after_the_other(rate_hz, told, random):
    times = times_of(rate_hz, told, random)
    alone, together = made(rate_hz, times[0]), made(rate_hz, times[0])
    columns = RateColumns(together, Track(np.array(times)), together.add)
    taken = 0
    for asked_ns in sorted(random.randint(times[0] - S, times[-1] + 9 * S) for _ in range(20)):
        end = bisect_right(times, asked_ns)
        for t_ns in times[taken:end]:
            alone.add(t_ns)
        columns.take(taken, end)
        taken = end
        assert vars(alone) == vars(together)
        assert alone.evaluate(asked_ns) == together.evaluate(asked_ns)
        assert vars(alone) == vars(together)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(RATES), parts, st.integers(0, 2**32).map(Random))
def test_a_verdict_that_is_good_stands_until_it_is_said_to_change(rate_hz, told, random):
    times = times_of(rate_hz, told, random)
    monitor = made(rate_hz, times[0])
    columns = RateColumns(monitor, Track(np.array(times)), monitor.add)
    stands_ns = 0
    for taken, t_ns in enumerate(times, 1):
        if t_ns < stands_ns:
            assert monitor.evaluate(t_ns).level is Level.GOOD
        columns.take(taken - 1, taken)
        if t_ns < stands_ns:
            assert monitor.evaluate(t_ns).level is Level.GOOD
        if columns.steady:
            stands_ns = columns.changes_ns(taken)
            assert stands_ns > t_ns
    assert columns.changes_ns(len(times)) in (FOREVER_NS, times[-1] + monitor.silence_ns + 1)


def test_a_topic_that_comes_as_intended_is_taken_at_once():
    times = [1000 * S + n * S // 200 for n in range(20_000)]
    monitor, added = made(200.0, times[0]), []
    columns = RateColumns(monitor, Track(np.array(times)), lambda t_ns: added.append(t_ns) or monitor.add(t_ns))
    columns.take(0, 20_000)
    assert monitor.total == 20_000
    assert len(added) < 300, "only until its rate is known"
    assert columns.changes_ns(20_000) == times[-1] + monitor.silence_ns + 1


def test_without_messages_nothing_changes():
    monitor = made(5.0, 0)
    columns = RateColumns(monitor, Track(np.zeros(0, np.int64)), monitor.add)
    columns.take(0, 0)
    assert columns.changes_ns(0) == FOREVER_NS
