"""Where is down: rotations, tilts, words for them, and the window of an IMU."""

from __future__ import annotations

from math import cos, inf, isnan, nan, pi, radians, sin
from typing import List, Optional

import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S

from amaze_autonomy.monitoring.gravity import (
    GravityWindow,
    ImuStatistics,
    LastingTilt,
    Quaternion,
    Vector,
    angle_between,
    describe_tilt,
    likely_mistake,
    norm,
    rotate,
    rotation_from_rpy,
    tilt_of,
    tilt_of_rpy,
    turn_between,
    up_of_quaternion,
)

G = 9.80665


def rolled(angle_deg: float) -> Vector:
    """Return up in a vehicle whose right side is down by an angle (REP-103: roll about x forward)."""
    return (0.0, sin(radians(angle_deg)), cos(radians(angle_deg)))


def pitched(angle_deg: float) -> Vector:
    """Return up in a vehicle whose nose is down by an angle (REP-103: pitch about y left)."""
    return (-sin(radians(angle_deg)), 0.0, cos(radians(angle_deg)))


@pytest.mark.parametrize(
    "up,words",
    [
        (rolled(14), "14 deg to the right"),
        (rolled(-14), "14 deg to the left"),
        (pitched(14), "14 deg forward"),
        (pitched(-14), "14 deg backward"),
        ((-0.2, -0.2, 1.0), "16 deg forward and to the left"),
        ((0.2, 0.2, 1.0), "16 deg backward and to the right"),
        ((0.0, 0.0, 1.0), "0 deg"),
        ((0.0, 0.0, -1.0), "180 deg, upside down"),
        (rolled(91), "91 deg to the right"),
        ((nan, 0.0, 1.0), "by an unknown angle"),
    ],
)
def test_a_tilt_is_told_by_the_side_that_is_down(up: Vector, words: str):
    assert describe_tilt(up) == words


@pytest.mark.parametrize("angle_deg", [-170.0, -90.0, -10.0, 0.0, 10.0, 45.0, 90.0, 179.0])
def test_a_quaternion_says_the_same_up_as_the_accelerometer(angle_deg: float):
    half = radians(angle_deg) / 2
    assert up_of_quaternion(sin(half), 0.0, 0.0, cos(half)) == pytest.approx(rolled(angle_deg))
    assert up_of_quaternion(0.0, sin(half), 0.0, cos(half)) == pytest.approx(pitched(angle_deg))
    assert up_of_quaternion(0.0, 0.0, sin(half), cos(half)) == pytest.approx((0.0, 0.0, 1.0))


@pytest.mark.parametrize("quaternion", [(0.0, 0.0, 0.0, 0.0), (nan, 0.0, 0.0, 1.0), (inf, 0.0, 0.0, 1.0)])
def test_what_is_no_quaternion_has_no_up(quaternion: tuple):
    assert up_of_quaternion(*quaternion) is None


@pytest.mark.parametrize(
    "rpy_deg,measured",
    [
        ((0, 0, 0), (0, 0, G)),
        ((90, 0, 0), (0, G, 0)),
        ((-90, 0, 0), (0, -G, 0)),
        ((180, 0, 0), (0, 0, -G)),
        ((0, 90, 0), (-G, 0, 0)),
    ],
)
def test_a_mounting_rotation_brings_gravity_down_again(rpy_deg: Vector, measured: Vector):
    rotation = rotation_from_rpy(tuple(radians(angle) for angle in rpy_deg))
    assert rotate(rotation, measured) == pytest.approx((0.0, 0.0, G))


@given(st.tuples(*[st.floats(-7, 7)] * 3), st.tuples(*[st.floats(-100, 100)] * 3))
def test_a_rotation_keeps_lengths(rpy: Vector, vector: Vector):
    assert norm(rotate(rotation_from_rpy(rpy), vector)) == pytest.approx(norm(vector), abs=1e-9)


@given(st.tuples(*[st.floats(-100, 100)] * 3))
def test_a_tilt_is_the_angle_to_z(up: Vector):
    if norm(up) > 1e-3:
        assert tilt_of(up) == pytest.approx(angle_between(up, (0.0, 0.0, 1.0)), abs=1e-6)


@given(st.floats(-7, 7), st.floats(-7, 7))
def test_a_tilt_by_roll_and_pitch_knows_no_sign(roll: float, pitch: float):
    tilt_rad = tilt_of_rpy(roll, pitch)
    assert cos(tilt_rad) == pytest.approx(cos(roll) * cos(pitch), abs=1e-9)
    assert tilt_rad == pytest.approx(tilt_of_rpy(-roll, pitch)) == pytest.approx(tilt_of_rpy(roll, -pitch))


@pytest.mark.parametrize("roll, pitch", [(nan, 0.0), (0.0, nan), (inf, 0.0), (0.0, -inf)])
def test_a_tilt_by_no_angles_is_none(roll: float, pitch: float):
    assert isnan(tilt_of_rpy(roll, pitch))


def lasting(*tilts_rad: float, period_ns: int = S // 10, start_ns: int = 0) -> List[Optional[float]]:
    """Return what lasts after each of the samples."""
    tilt, said = LastingTilt(2 * S), []
    for number, tilt_rad in enumerate(tilts_rad):
        tilt.add(start_ns + number * period_ns, tilt_rad)
        said.append(tilt.tilt_rad(start_ns + number * period_ns))
    return said


@pytest.mark.parametrize("start_ns", [0, 2**29 - S // 10, 2**40 - S // 4])
def test_a_tilt_counts_when_it_has_lasted_for_three_tenths_of_a_second_whatever_the_time(start_ns: int):
    level, over = [0.1] * 4, [1.4, 1.3, 1.4, 1.4]
    assert lasting(*level, *over, start_ns=start_ns) == [None] * 3 + [0.1] * 4 + [1.3]
    assert lasting(*over, *level, start_ns=start_ns)[3:] == [1.3] + [0.1] * 4


def test_three_tenths_of_a_second_are_no_less():
    assert lasting(*[0.2] * 4, period_ns=149 * S // 1000) == [None] * 3 + [0.2]


def test_a_pause_as_long_as_the_age_limit_is_none():
    assert lasting(*[0.2] * 3, period_ns=2 * S) == [None, None, 0.2]
    assert lasting(*[0.2] * 3, period_ns=2 * S + 1) == [None] * 3


@pytest.mark.parametrize("period_ns", [S // 100, S // 30, S // 10, S // 4, S])
def test_one_wrong_sample_or_two_are_never_a_tilt_however_slowly_they_come(period_ns: int):
    level = [0.1] * 40
    assert max(lasting(*level, 3.1, 3.1, *level, period_ns=period_ns)[39:]) == 0.1


def test_a_sample_that_is_none_changes_nothing_and_silence_is_unknown():
    tilt = LastingTilt(2 * S)
    for number in range(5):
        tilt.add(number * S // 10, 0.2)
        tilt.add(number * S // 10, nan)
    last_ns = 4 * S // 10
    assert (tilt.tilt_rad(last_ns + 2 * S), tilt.tilt_rad(last_ns + 2 * S + 1)) == (0.2, None)


def test_what_was_before_a_silence_or_a_jump_backwards_does_not_count():
    for again_ns in (4 * S, S // 2):
        tilt = LastingTilt(2 * S)
        for number in range(5):
            tilt.add(S + number * S // 10, 0.2)
        tilt.add(again_ns, 1.5)
        assert tilt.tilt_rad(again_ns) is None
        for number in range(1, 4):
            tilt.add(again_ns + number * S // 10, 1.5)
        assert tilt.tilt_rad(again_ns + 3 * S // 10) == 1.5


@pytest.mark.parametrize("other", [(0.0, 0.0, 0.0), (nan, 0.0, 0.0), (inf, 0.0, 0.0), (1e200, 1e200, 0.0)])
def test_what_has_no_direction_agrees_with_nothing(other: Vector):
    assert angle_between((0.0, 0.0, 1.0), other) == pi


@given(st.floats(0, pi), st.integers(0, 2), st.sampled_from([-1.02, -1.0, 1.0, 0.98]))
def test_a_turn_is_the_angle_about_any_axis_whatever_the_sign_and_the_length_of_a_quaternion(
    angle: float, axis: int, length: float
):
    level, turned = (0.0, 0.0, 0.0, 1.0), [0.0, 0.0, 0.0, length * cos(angle / 2)]
    turned[axis] = length * sin(angle / 2)
    x, y, z, w = turned
    assert turn_between(level, (x, y, z, w)) == pytest.approx(angle, abs=1e-7)
    assert turn_between((x, y, z, w), level) == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize(
    "none", [(0.0, 0.0, 0.0, 0.0), (nan, 0.0, 0.0, 1.0), (0.0, inf, 0.0, 1.0), (0.0, 0.0, 1e200, 1e200)]
)
def test_an_orientation_that_is_none_is_turned_as_far_as_can_be(none: Quaternion):
    assert turn_between((0.0, 0.0, 0.0, 1.0), none) == pi


@pytest.mark.parametrize(
    "magnitude,words",
    [
        (1.0, "it looks like g: the driver must publish m/s^2"),
        (0.97, "it looks like g: the driver must publish m/s^2"),
        (1000.0, "it looks like milli-g or cm/s^2: the driver must publish m/s^2"),
        (980.665, "it looks like milli-g or cm/s^2: the driver must publish m/s^2"),
        (1190.0, "it looks like milli-g: the driver must publish m/s^2"),
        (9806.65, "it looks like mm/s^2: the driver must publish m/s^2"),
        (0.1, "it measures next to nothing: is gravity already subtracted, or is the sensor dead?"),
        (8.0, "calibrate the accelerometer, and keep the vehicle still"),
        (inf, "calibrate the accelerometer, and keep the vehicle still"),
    ],
)
def test_the_likely_mistake_is_named(magnitude: float, words: str):
    assert likely_mistake(magnitude, G) == words


@pytest.mark.parametrize("unit, gravity", [("g", 1.0), ("milli-g", 1e3), ("mm/s^2", 1000 * G)])
def test_a_unit_is_recognised_when_the_magnitude_is_off_by_less_than_a_fifth(unit: str, gravity: float):
    said = [f"like {unit}" in likely_mistake(part * gravity, G) for part in (0.7995, 0.8005, 1.1995, 1.2005)]
    assert said == [False, True, True, False]


def test_a_magnitude_that_is_too_little_for_milli_g_or_too_large_for_cm_s2_is_the_other_one():
    said = [likely_mistake(part * 100 * G, G) for part in (0.7995, 0.8005, 1.1995, 1.2005)]
    assert [words.partition(":")[0] for words in said[1:]] == [
        "it looks like cm/s^2",
        "it looks like milli-g or cm/s^2",
        "it looks like milli-g",
    ]
    assert "cm/s^2" not in said[0]


def test_the_window_holds_means_and_spread():
    window = GravityWindow(2 * S)
    for index in range(400):
        window.add(index * S // 200, (0.5 if index % 2 else -0.5, 0.0, G), (0.0, 0.3, 0.4))
    assert window.statistics(400 * S // 200 - 1, S) == ImuStatistics(
        pytest.approx(210, abs=10), pytest.approx((0.0, 0.0, G)), pytest.approx(0.5), pytest.approx(0.5)
    )


def test_what_is_older_than_the_window_does_not_count():
    window = GravityWindow(S)
    window.add(0, (100.0, 0.0, 0.0))
    window.add(2 * S, (0.0, 0.0, G))
    assert window.statistics(2 * S, S) == ImuStatistics(1, (0.0, 0.0, G), pytest.approx(0.0), None)
    assert window.statistics(10 * S, S) is None


def test_what_is_older_than_the_window_is_not_kept():
    window, begin_ns = GravityWindow(S), 3600 * S
    for number in range(1000):
        window.add(begin_ns + number * S // 100, (0.0, 0.0, G))
    kept = window.statistics(begin_ns + 10 * S, 10 * S)
    assert kept is not None
    assert 100 <= kept.samples <= 110


@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e200])
def test_what_is_not_finite_or_beyond_any_sensor_is_not_added(bad: float):
    window = GravityWindow(S)
    window.add(0, (0.0, bad, G))
    assert window.statistics(0, S) is None
    assert window.last_ns is None


def test_a_gap_or_a_jump_backwards_begins_the_observation_anew():
    window = GravityWindow(5 * S)
    window.add(0, (0.0, 0.0, G))
    window.add(S, (0.0, 0.0, G))
    assert window.first_ns == S
    window.add(S // 2, (0.0, 0.0, G))
    assert (window.first_ns, window.statistics(S, 5 * S).samples) == (S // 2, 1)


def test_samples_that_are_skipped_count_by_when_they_came_a_gap_among_them_too():
    window = GravityWindow(S)
    window.skip([0, S // 10, S // 5])
    assert (window.first_ns, window.last_ns) == (0, S // 5)
    window.skip([2 * S, 2 * S + S // 10])
    assert (window.first_ns, window.last_ns) == (2 * S, 2 * S + S // 10)


@given(st.lists(st.tuples(st.integers(-(2**60), 2**60), st.tuples(*[st.floats()] * 3), st.tuples(*[st.floats()] * 3))))
def test_no_number_breaks_it(calls: List[tuple]):
    window = GravityWindow(S)
    for t_ns, acceleration, turn_rate in calls:
        window.add(t_ns, acceleration, turn_rate)
        window.statistics(t_ns, S)
        describe_tilt(acceleration)
        up_of_quaternion(*acceleration, turn_rate[0])
        assert 0 <= angle_between(acceleration, turn_rate) <= pi
        likely_mistake(norm(acceleration), G)
