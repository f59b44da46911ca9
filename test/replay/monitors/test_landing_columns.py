"""Readings of a range finder taken together leave the landing detection as it would be had they come one by one."""

from __future__ import annotations

from bisect import bisect_right
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from replay_bags import S

from amaze_autonomy.engine.events import Landed
from amaze_autonomy.monitoring.landing import LandingDetector, seen_m
from amaze_autonomy.monitoring.specs import LandingSpec
from amaze_autonomy.replay.maps.topic_map import Reading
from amaze_autonomy.replay.monitors.feeds import RangeFeed
from amaze_autonomy.replay.monitors.monitor_columns import _heights
from amaze_autonomy.replay.recordings.fields import Track

SPEC = LandingSpec(mounting_height_m=0.1, scale=0.01, sentinels=(8191.0,))
READING = Reading("/range", {"distance": "range"})
parts = st.lists(
    st.tuples(
        st.integers(1, 120),
        st.sampled_from([0.1, 0.1, 0.12, 0.19, 0.21, 0.3, 3.0, 3.0, 0.0, 81.91, float("nan"), float("inf"), 1e3]),  # m
        st.sampled_from([0.0, 0.01, 0.1]),  # noise, m
        st.sampled_from([5, 20, 20, 100]),  # Hz
        st.sampled_from([0, 0, 0, S // 2 - 1, S // 2 + 1, 3 * S]),  # silence before
    ),
    min_size=1,
    max_size=8,
)


def rows_of(told, random):
    now, rows = 1_600_000_000 * S, []
    for count, metres, noise, rate_hz, silence_ns in told:
        now += silence_ns
        for _ in range(count):
            now += S // rate_hz
            limits = random.choice([(0.0, 0.0), (0.0, 0.0), (5.0, 3000.0), (float("nan"), 200.0)])
            rows.append((now, (100 * (metres + random.uniform(-noise, noise)), *limits)))
    return rows


def state_of(detector):
    return {**vars(detector), "_ground": None}, {**vars(detector._ground), "why_unknown": ""}


def rider(rows):
    feed = RangeFeed(LandingDetector(SPEC), READING)
    times, columns = np.array([t_ns for t_ns, _ in rows]), zip(*(values for _, values in rows))
    feed.ride(Track(times, tuple(map(np.array, columns))), 0)
    return feed


@settings(max_examples=80, deadline=None)
@given(parts, st.integers(0, 2**32).map(Random))
def test_the_detector_is_left_as_by_one_reading_after_the_other(told, random):
    rows = rows_of(told, random)
    together, alone = rider(rows), RangeFeed(LandingDetector(SPEC), READING)
    taken = 0
    for asked_ns in sorted(random.randint(rows[0][0] - S, rows[-1][0] + S) for _ in range(25)):
        end = bisect_right([t_ns for t_ns, _ in rows], asked_ns)
        for t_ns, values in rows[taken:end]:
            alone.take_values(t_ns, values)
        taken = end
        together.until((asked_ns, 1))
        assert state_of(together._detector) == state_of(alone._detector)
        assert together._detector.evaluate(asked_ns) == alone._detector.evaluate(asked_ns)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("scale", [1.0, 0.01, 0.3048])
@pytest.mark.parametrize("own", [(float("nan"), float("nan")), (0.0, 0.0), (0.2, 7.7), (0.1, 8.2)])
def test_both_see_the_same_at_each_limit_and_sentinel(own, scale, kind):
    spec = LandingSpec(mounting_height_m=0.0, scale=scale, min_range_m=0.1, max_range_m=8.2, sentinels=(1.3, 65.535))
    edges = [0.1 / scale, 8.2 / scale, *own, *spec.sentinels, 0.0, -1.0, float("inf")]
    readings = np.array([near for edge in map(kind, edges) for near in (edge, *np.nextafter(edge, kind([-9, 99])))])
    least, most = map(kind, own)
    columns = (readings, np.full_like(readings, least), np.full_like(readings, most))
    heights, seen = _heights(Track(np.arange(len(readings)), columns), spec)
    alone = [seen_m(float(each), spec, float(least), float(most)) for each in readings]
    assert [each if good else None for each, good in zip(heights.tolist(), seen)] == alone


def test_a_long_flight_is_taken_at_once(monkeypatch):
    rows = rows_of([(100, 0.1, 0.0, 20, 0), (4000, 3.0, 0.1, 20, 0)], Random(1))
    rows = [(t_ns, (value, 1.0, 3999.0)) for t_ns, (value, _, _) in rows]
    asked = []
    inner = LandingDetector.add_range
    monkeypatch.setattr(LandingDetector, "add_range", lambda *arguments: asked.append(1) or inner(*arguments))
    feed = rider(rows)
    feed.until((rows[-1][0], 1))
    assert feed._detector.evaluate(rows[-1][0]).landed is Landed.AIRBORNE
    assert len(asked) < 150
