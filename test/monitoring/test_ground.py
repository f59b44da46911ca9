"""From readings to the distance between feet and ground."""

from __future__ import annotations

from math import cos, inf, nan, radians
from struct import pack, unpack
from typing import Callable, List, Optional

import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S

from amaze_autonomy.monitoring.landing import GroundDistance, nearest_return, seen_m
from amaze_autonomy.monitoring.specs import LandingSpec, RangeSource

SPEC = LandingSpec(mounting_height_m=0.1, max_range_m=40.0)
MILLIMETRES = LandingSpec(scale=0.001)


@pytest.mark.parametrize(
    "reading", [nan, inf, -inf, -1.0, -0.001, 0.0, 0.019, 40.0, 41.0, 8190.0, 8191.0, 65535.0, 1e308]
)
def test_every_way_of_saying_nothing_seen_is_nothing_seen(reading: float):
    assert seen_m(reading, SPEC) is None


@pytest.mark.parametrize("reading", [8191.0, 65535.0, 0.0, -1.0])
def test_a_sentinel_is_known_in_the_units_of_the_message(reading: float):
    assert seen_m(reading, MILLIMETRES) is None
    assert seen_m(8189.0, MILLIMETRES) == pytest.approx(8.189)


@pytest.mark.parametrize(
    "low,high,reading,seen",
    [
        (0.2, 10.0, 0.19, None),
        (0.2, 10.0, 0.2, 0.2),
        (0.2, 10.0, 9.99, 9.99),
        (0.2, 10.0, 10.0, None),
        (None, None, 39.0, 39.0),
        (nan, nan, 39.0, 39.0),
        (0.0, 0.0, 39.0, 39.0),
        (5.0, 1.0, 6.0, 6.0),
        (0.2, 1e9, 40.0, None),
    ],
)
def test_the_limits_of_the_message_count_where_they_make_sense(
    low: Optional[float], high: Optional[float], reading: float, seen: Optional[float]
):
    assert seen_m(reading, SPEC, low, high) == seen


@pytest.mark.parametrize("reading, seen", [(1500.0, 1.5), (19.0, None), (30000.0, None)])
def test_the_limits_of_the_message_are_in_its_units(reading: float, seen: Optional[float]):
    assert seen_m(reading, MILLIMETRES, 20.0, 30000.0) == seen
    nearest = nearest_return([reading], MILLIMETRES, 20.0, 30000.0)
    assert (nearest == reading) is (seen is not None)


def as_float32(value: float) -> float:
    """Return a number as a message with a field of 32 bits brings it."""
    told: float = unpack("<f", pack("<f", value))[0]
    return told


@pytest.mark.parametrize("tell", [as_float32, float])
@pytest.mark.parametrize("sentinel", [0.03, 0.05, 8.19, 65.535])
def test_a_sentinel_is_known_in_the_numbers_of_the_message(sentinel: float, tell: Callable[[float], float]):
    spec = LandingSpec(sentinels=(sentinel,), max_range_m=100.0)
    assert seen_m(tell(sentinel), spec) is None
    assert seen_m(tell(sentinel), spec, tell(0.02), tell(99.0)) is None
    assert seen_m(tell(1.001 * sentinel), spec) == tell(1.001 * sentinel)


@pytest.mark.parametrize("tell", [as_float32, float])
@pytest.mark.parametrize("scale", [1.0, 0.001, 0.01, 0.3048])
@pytest.mark.parametrize("limit_m", [0.1, 0.7, 1.2, 3.7, 8.19, 8.2, 12.2, 25.9])
def test_a_limit_is_met_in_the_numbers_of_the_message(limit_m: float, scale: float, tell: Callable[[float], float]):
    reading = tell(limit_m / scale)
    below = LandingSpec(scale=scale, max_range_m=limit_m, sentinels=())
    above = LandingSpec(scale=scale, min_range_m=limit_m, sentinels=())
    assert seen_m(reading, below) is None
    assert seen_m(0.999 * reading, below) == pytest.approx(0.999 * limit_m)
    assert seen_m(reading, above) == pytest.approx(limit_m)
    assert seen_m(0.999 * reading, above) is None


def test_a_number_beyond_those_of_a_message_is_a_sentinel_all_the_same():
    assert seen_m(0.5, LandingSpec(sentinels=(1e300, -1e300))) == 0.5


def test_of_a_scan_the_nearest_valid_return_counts():
    assert nearest_return([nan, inf, 0.0, 3.0, 2.0, -1.0], SPEC, 0.1, 10.0) == 2.0
    empty = nearest_return([nan, inf], SPEC)
    assert empty != empty  # noqa: PLR0124


def measured(readings: List[Optional[float]], spec: LandingSpec = SPEC) -> GroundDistance:
    ground = GroundDistance(spec)
    for index, reading in enumerate(readings):
        ground.add(index * S // 50, reading)
    return ground


@pytest.mark.parametrize(
    "readings,distance_m",
    [
        ([1.1, 1.1, 1.1], 1.0),
        ([1.1, 9.0, 1.1, 1.1, 0.2], 1.0),
        ([1.0, 1.2, 1.1, 1.3], 1.05),
        ([5.0] * 20 + [1.1] * 20, 1.0),
        ([None, 1.1, 1.1, 1.1], 1.0),
    ],
)
def test_the_distance_is_the_median_without_the_mounting_height(readings: List[Optional[float]], distance_m: float):
    assert measured(readings).distance_m() == pytest.approx(distance_m)


@pytest.mark.parametrize(
    "readings,why",
    [
        ([], "0 good ranges, 3 are needed"),
        ([1.0, 1.0], "2 good ranges, 3 are needed"),
        ([None] * 10, "0 good ranges, 3 are needed"),
        ([1.0, None, None, None, 1.0, None, None, None, 1.0], "6 of 9 ranges saw nothing"),
    ],
)
def test_too_little_seen_is_no_distance(readings: List[Optional[float]], why: str):
    ground = measured(readings)
    assert ground.distance_m() is None
    assert ground.why_unknown == why


def test_a_tilted_beam_is_longer_than_the_height():
    ground = GroundDistance(SPEC)
    for index in range(5):
        ground.add_tilt(index, radians(-30.0))
        ground.add(index, 2.0)
    assert ground.distance_m() == pytest.approx(2.0 * cos(radians(30.0)) - 0.1)


@pytest.mark.parametrize("tilt_rad,tilt_ns", [(radians(50.0), 10 * S), (0.0, 9 * S)])
def test_a_tilt_that_is_too_large_or_too_old_is_no_distance(tilt_rad: float, tilt_ns: int):
    ground = GroundDistance(SPEC)
    ground.add_tilt(tilt_ns, tilt_rad)
    for index in range(5):
        ground.add(10 * S + index, 2.0)
    assert ground.distance_m() is None


@given(st.lists(st.tuples(st.integers(0, S), st.floats(0.2, 30.0)), min_size=1, max_size=60), st.integers(1, 20))
def test_readings_that_are_added_together_leave_what_they_leave_one_by_one(steps: List[tuple], at_once: int):
    singly, together, now = GroundDistance(SPEC), GroundDistance(SPEC), 0
    readings = []
    for step_ns, reading in steps:
        now += step_ns
        readings.append((now, reading))
        singly.add(now, reading)
    for begin in range(0, len(readings), at_once):
        times, distances = zip(*readings[begin : begin + at_once])
        together.extend(times, [each - SPEC.mounting_height_m for each in distances])
    assert list(together._window) == list(singly._window)
    assert (together.seen_ns, together.distance_m()) == (singly.seen_ns, singly.distance_m())


def test_time_that_jumps_backwards_begins_anew():
    ground = measured([1.1] * 100)
    ground.add(S, 5.0)
    assert ground.distance_m() is None


@given(st.lists(st.tuples(st.integers(-(2**62), 2**62), st.floats(), st.floats(), st.floats(), st.floats())))
def test_no_number_breaks_it(calls: List[tuple]):
    ground = GroundDistance(SPEC)
    for t_ns, reading, low, high, tilt in calls:
        ground.add_tilt(t_ns, tilt)
        ground.add(t_ns, seen_m(reading, SPEC, low, high))
        distance_m = ground.distance_m()
        assert distance_m is None or -0.1 <= distance_m < 40.0


@pytest.mark.parametrize(
    "reading, seen", [(0.0, 0.0), (0.01, 0.01), (-0.3, -0.3), (-0.4, -0.4), (-0.41, None), (-30.0, None), (5.0, 5.0)]
)
def test_a_height_may_be_a_little_below_the_ground_and_not_far(reading: float, seen: Optional[float]):
    spec = LandingSpec(source=RangeSource.POSE, mounting_height_m=0.0, ground_distance_m=0.4, airborne_distance_m=0.7)
    assert seen_m(reading, spec) == seen
