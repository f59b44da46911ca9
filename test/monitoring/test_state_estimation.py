"""The check of the states as a vehicle on the pad: level, tilted, shaken, with each mistake that is made."""

from __future__ import annotations

from dataclasses import replace
from math import cos, inf, nan, pi, radians, sin
from types import SimpleNamespace
from typing import Dict, List, Optional, Tuple

import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitoring_feed import S, rounded

from amaze_autonomy.engine.events import Check, Verdict
from amaze_autonomy.monitoring.readings import estimate_reader
from amaze_autonomy.monitoring.specs import EstimateSource, StateEstimationSpec
from amaze_autonomy.monitoring.state_estimation import Estimate, StateEstimationMonitor, StateVerdict

G = 9.80665
VARIANCE = (0.01, 0.01, 0.01)
LEVEL = Estimate((1.0, 2.0, 0.0), (0.0, 0.0, 0.0, 1.0), VARIANCE, (1e-4, 1e-4, 1e-4), (0.0, 0.0, 0.0))
NOW = 4 * S


def on_the_pad(
    estimate: Estimate = LEVEL,
    *,
    up: Tuple[float, float, float] = (0.0, 0.0, G),
    turn_rate: Optional[Tuple[float, float, float]] = (0.0, 0.0, 0.0),
    spec: Optional[StateEstimationSpec] = None,
    estimate_hz: int = 30,
) -> StateEstimationMonitor:
    """Return a monitor of a vehicle that has stood for 4 s, IMU 100 Hz."""
    monitor = StateEstimationMonitor(spec)
    for index in range(401):
        monitor.add_imu(index * S // 100, up, turn_rate)
    for index in range(4 * estimate_hz + 1):
        monitor.add_estimate(index * S // estimate_hz, estimate)
    return monitor


def failed(verdict: StateVerdict) -> Dict[str, Check]:
    return {row.name: row for row in verdict.checks if not row.passed}


def rolled(angle_deg: float) -> Tuple[Tuple[float, float, float], Estimate]:
    """Return the specific force and the estimate of a vehicle whose right side is down."""
    angle = radians(angle_deg)
    quaternion = (sin(angle / 2), 0.0, 0.0, cos(angle / 2))
    return (0.0, G * sin(angle), G * cos(angle)), LEVEL._replace(orientation=quaternion)


def test_a_level_vehicle_that_stands_still_passes_every_row():
    verdict = on_the_pad().check(NOW)
    assert (verdict.valid, verdict.gravity, verdict.tilt_rad) == (True, pytest.approx((0.0, 0.0, -G)), 0.0)
    assert [(row.name, row.verdict) for row in verdict.checks] == [
        (name, Verdict.PASS)
        for name in (
            "estimate age",
            "estimate rate",
            "estimate finite",
            "quaternion norm",
            "distance from origin",
            "position deviation",
            "orientation deviation",
            "estimated speed",
            "estimated tilt",
            "estimate drift",
            "IMU age",
            "gravity magnitude",
            "tilt",
            "shaking",
            "turning",
            "tilt agreement",
        )
    ]


def test_a_row_that_passes_says_what_it_saw_and_its_limit():
    seen = {row.name: (row.value, row.limit, row.unit, row.age_s) for row in on_the_pad().check(NOW).checks}
    tilt, agreement = pytest.approx(radians(10.0)), pytest.approx(radians(5.0))
    assert seen == {
        "estimate age": (0.0, 0.5, "s", 0.0),
        "estimate rate": (30.0, 24.0, "Hz", None),
        "estimate finite": (0.0, 0.0, "numbers", None),
        "quaternion norm": (0.0, 0.01, "", None),
        "distance from origin": (pytest.approx(5.0**0.5), 1000.0, "m", None),
        "position deviation": (0.1, 0.5, "m", None),
        "orientation deviation": (0.01, tilt, "rad", None),
        "estimated speed": (0.0, 0.3, "m/s", None),
        "estimated tilt": (0.0, tilt, "rad", None),
        "estimate drift": (0.0, 0.1, "m", None),
        "IMU age": (0.0, 0.5, "s", 0.0),
        "gravity magnitude": (pytest.approx(G), pytest.approx(G - 0.5), "m/s^2", None),
        "tilt": (0.0, tilt, "rad", None),
        "shaking": (pytest.approx(0.0, abs=1e-6), 0.5, "m/s^2", None),
        "turning": (0.0, 0.1, "rad/s", None),
        "tilt agreement": (0.0, agreement, "rad", None),
    }


@pytest.mark.parametrize("angle_deg,side", [(-14.0, "left"), (14.0, "right")])
def test_a_tilted_vehicle_is_told_the_side_and_the_limit(angle_deg: float, side: str):
    up, estimate = rolled(angle_deg)
    verdict = on_the_pad(estimate, up=up).check(NOW)
    limit = round(radians(10.0), 6)
    advice = f"vehicle is tilted 14 deg to the {side}, limit 10 deg"
    assert {name: rounded(row) for name, row in failed(verdict).items()} == {
        "tilt": Check("tilt", Verdict.FAIL, 0.244346, limit, "rad", None, advice),
        "estimated tilt": Check(
            "estimated tilt",
            Verdict.FAIL,
            0.244346,
            limit,
            "rad",
            None,
            f"the estimator says that the {advice}",
        ),
    }
    assert verdict.tilt_rad == pytest.approx(radians(14.0))


def test_what_reads_samples_in_bulk_gets_at_the_window_and_the_rate_that_the_verdict_is_of():
    monitor = on_the_pad()
    measured = monitor.imu.statistics(NOW, monitor.spec.window_ns)
    assert (measured.acceleration, monitor.rate.total) == (pytest.approx((0.0, 0.0, G)), 121)


def test_an_imu_on_its_side_is_wrong_until_its_mounting_is_given():
    wrong = on_the_pad(up=(0.0, G, 0.0)).check(NOW)
    advice = "vehicle is tilted 90 deg to the right, limit 10 deg; if it stands level, imu_mounting_rpy_deg is wrong"
    assert failed(wrong)["tilt"].advice == advice
    mounted = replace(StateEstimationSpec(), imu_mounting_rpy_rad=(pi / 2, 0.0, 0.0))
    right = on_the_pad(up=(0.0, G, 0.0), spec=mounted).check(NOW)
    assert (right.valid, right.gravity) == (True, pytest.approx((0.0, 0.0, -G)))


def test_an_imu_in_units_of_g_is_named():
    row = failed(on_the_pad(up=(0.0, 0.0, 1.0)).check(NOW))["gravity magnitude"]
    advice = "gravity is 1 m/s^2: it looks like g: the driver must publish m/s^2"
    assert rounded(row) == Check(
        "gravity magnitude", Verdict.FAIL, 1.0, 9.30665, "m/s^2", None, advice, other_limit=10.30665
    )


def test_estimator_and_imu_that_disagree_are_told_apart():
    _, estimate = rolled(8.0)
    row = failed(on_the_pad(estimate).check(NOW))["tilt agreement"]
    advice = "the IMU says 0 deg, the estimator 8 deg to the right: restart the estimator, check the mounting rotation"
    assert row.advice == advice
    assert row.value == pytest.approx(radians(8.0))


@pytest.mark.parametrize(
    "changes,row,words",
    [
        ({"position": (nan, 0.0, 0.0)}, "estimate finite", "1 of 10 numbers are NaN or infinite"),
        ({"velocity": (inf, 0.0, nan)}, "estimate finite", "2 of 10 numbers are NaN or infinite"),
        ({"orientation": (0.0, 0.0, 0.0, 0.0)}, "quaternion norm", "the orientation is all zero"),
        ({"orientation": (0.0, 0.0, 0.0, 2.0)}, "quaternion norm", "the orientation is no unit quaternion"),
        ({"position": (0.0, 2000.0, 0.0)}, "distance from origin", "the position is far from the origin"),
        ({"position_variance": (1.0, 0.0, 0.0)}, "position deviation", "the estimator is not sure"),
        ({"orientation_variance": (0.0, nan, 0.0)}, "orientation deviation", "the covariance is not finite"),
        ({"position_variance": (-0.3, 400.0, 400.0)}, "position deviation", "the covariance is negative"),
        ({"position_variance": (400.0, 400.0, -1e-9)}, "position deviation", "the covariance is negative"),
        ({"position_variance": (0.01, -1.0, 0.01)}, "position deviation", "the covariance is negative"),
        ({"position_variance": (-0.3, 0.01, 0.01)}, "position deviation", "the covariance is negative"),
        ({"position_variance": (-1.0, 400.0, 400.0)}, "position deviation", "the estimator is not sure"),
        ({"orientation_variance": (-1e-9, 0.0, 0.0)}, "orientation deviation", "the covariance is negative"),
        ({"velocity": (0.0, 0.4, 0.0)}, "estimated speed", "the estimate moves though the vehicle stands"),
    ],
)
def test_each_fault_of_an_estimate_fails_its_row(changes: Dict[str, tuple], row: str, words: str):
    rows = failed(on_the_pad(LEVEL._replace(**changes)).check(NOW))
    assert rows[row].verdict is Verdict.FAIL
    assert rows[row].advice.startswith(words)


def test_of_numbers_that_are_none_not_one_is_allowed():
    row = failed(on_the_pad(LEVEL._replace(velocity=(inf, 0.0, nan))).check(NOW))["estimate finite"]
    assert (row.value, row.limit, row.unit) == (2.0, 0.0, "numbers")


@pytest.mark.parametrize("variance", [None, (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (-1.0, 0.01, 0.01), (-1.0,) * 3])
@pytest.mark.parametrize("required", [False, True])
def test_an_estimate_without_covariance_is_a_warning_unless_it_is_required(variance: Optional[tuple], required: bool):  # noqa: FBT001
    estimate = LEVEL._replace(position_variance=variance)
    verdict = on_the_pad(estimate, spec=StateEstimationSpec(require_covariance=required)).check(NOW)
    row = next(row for row in verdict.checks if row.name == "position deviation")
    expected = Verdict.UNKNOWN if required else Verdict.WARN
    assert row == Check("position deviation", expected, None, 0.5, "m", None, "the estimate has no covariance")
    assert verdict.valid is not required


def test_nothing_heard_is_unknown():
    verdict = StateEstimationMonitor().check(NOW)
    assert (verdict.valid, verdict.gravity, verdict.tilt_rad) == (False, None, None)
    assert {row.verdict for row in verdict.checks} == {Verdict.UNKNOWN}
    assert verdict.checks[0].advice == "nothing came on /odometry: is its node running?"


def test_a_stale_estimate_and_imu_fail():
    rows = failed(on_the_pad().check(NOW + S))
    assert {"estimate age", "estimate rate", "IMU age"} <= set(rows)
    assert rows["estimate age"].advice == "the last message on /odometry is 1 s old: did its node stop?"
    assert rows["IMU age"].value == 1.0


def test_a_stamp_from_the_future_or_long_ago_fails_though_the_message_is_fresh():
    monitor = on_the_pad()
    monitor.add_estimate(NOW + 1, LEVEL, stamp_ns=NOW + 10 * S)
    row = failed(monitor.check(NOW + 1))["estimate age"]
    assert row.advice == "the last message on /odometry is 10 s in the future: compare the clocks of the computers"
    monitor.add_estimate(NOW + 2, LEVEL, stamp_ns=0)
    assert "estimate age" in failed(monitor.check(NOW + 2))


@pytest.mark.parametrize("estimate_hz,verdict", [(30, Verdict.PASS), (15, Verdict.WARN), (6, Verdict.FAIL)])
def test_the_rate_of_the_estimate_has_its_row(estimate_hz: int, verdict: Verdict):
    rows = on_the_pad(estimate_hz=estimate_hz).check(NOW).checks
    assert next(row for row in rows if row.name == "estimate rate").verdict is verdict


def test_a_vehicle_that_is_shaken_turned_or_drifting_is_not_still():
    monitor = on_the_pad()
    for index in range(1, 201):
        sway = 2.0 if index % 2 else -2.0
        monitor.add_imu(NOW + index * S // 100, (sway, 0.0, G), (0.0, 0.0, 0.2))
    for index in range(1, 61):
        monitor.add_estimate(NOW + index * S // 30, LEVEL._replace(position=(0.01 * index, 2.0, 0.0)))
    rows = failed(monitor.check(NOW + 2 * S))
    assert set(rows) == {"shaking", "turning", "estimate drift"}
    assert rows["shaking"].advice == "do not move the vehicle for 2 s"


def test_a_vehicle_that_was_not_watched_for_long_enough_is_not_known_to_be_still():
    monitor = StateEstimationMonitor()
    for index in range(101):
        monitor.add_imu(index * S // 100, (0.0, 0.0, G), (0.0, 0.0, 0.0))
        if index % 3 == 0:
            monitor.add_estimate(index * S // 100, LEVEL)
    unknown = {row.name for row in monitor.check(S).checks if row.verdict is Verdict.UNKNOWN}
    assert unknown == {"estimate drift", "shaking", "turning"}


def test_an_imu_without_a_gyroscope_is_named_when_it_was_observed_for_long_enough():
    row = failed(on_the_pad(turn_rate=None).check(NOW))["turning"]
    advice = "/px4/imu measures no turn rate: name an IMU with a gyroscope"
    assert row == Check("turning", Verdict.UNKNOWN, None, 0.1, "rad/s", None, advice)
    monitor = StateEstimationMonitor()
    for index in range(101):
        monitor.add_imu(index * S // 100, (0.0, 0.0, G), None)
    assert failed(monitor.check(S))["turning"].heals, "not observed for long enough"
    few = StateEstimationMonitor(StateEstimationSpec(min_samples=10))
    for index in range(9):
        few.add_imu(index * S // 3, (0.0, 0.0, G), None)
    assert failed(few.check(8 * S // 3))["turning"].heals, "too few samples to tell"


@pytest.mark.parametrize("gap_ns, verdict", [(10 * S, Verdict.UNKNOWN), (S // 2, Verdict.PASS)])
def test_an_estimate_that_comes_back_after_a_gap_is_observed_from_there(gap_ns: int, verdict: Verdict):
    monitor, begin_ns = on_the_pad(), NOW + gap_ns
    for index in range(37):
        monitor.add_estimate(begin_ns + index * S // 30, LEVEL)
    row = next(row for row in monitor.check(begin_ns + 36 * S // 30).checks if row.name == "estimate drift")
    assert (row.verdict, row.heals) == (verdict, verdict is Verdict.UNKNOWN)


def test_an_estimator_that_begins_anew_is_judged_by_what_comes_from_then_on():
    elsewhere = LEVEL._replace(position=(9.0, 2.0, 0.0))
    jumped, anew = on_the_pad(), on_the_pad()
    anew.forget_estimates()
    assert "estimate age" in failed(anew.check(NOW)), "what it said before is no estimate"
    for index in range(1, 91):
        t_ns = NOW + index * S // 30
        for monitor in (jumped, anew):
            monitor.add_estimate(t_ns, elsewhere)
            monitor.add_imu(t_ns, (0.0, 0.0, G), (0.0, 0.0, 0.0))
        if t_ns == NOW + S:
            drifts = [failed(monitor.check(t_ns))["estimate drift"] for monitor in (jumped, anew)]
            assert [(row.verdict, row.heals) for row in drifts] == [(Verdict.FAIL, False), (Verdict.UNKNOWN, True)]
    assert anew.check(NOW + 3 * S).valid


def test_too_few_samples_are_no_gravity():
    monitor = on_the_pad()
    for index in range(5):
        monitor.add_imu(10 * S + index, (0.0, 0.0, G))
    verdict = monitor.check(10 * S + 5)
    assert verdict.gravity is None
    row = failed(verdict)["gravity magnitude"]
    assert (row.verdict, row.advice) == (Verdict.UNKNOWN, "5 good samples on /px4/imu in 1 s, 10 are needed")


def test_an_accelerometer_of_zeros_measures_no_gravity():
    verdict = on_the_pad(up=(0.0, 0.0, 0.0)).check(NOW)
    assert (verdict.valid, verdict.gravity, verdict.tilt_rad) == (False, None, None)


def test_without_an_estimator_the_imu_is_judged_alone_and_the_other_way_round():
    alone = on_the_pad(spec=StateEstimationSpec(topic="")).check(NOW)
    assert (alone.valid, len(alone.checks)) == (True, 5)
    blind = on_the_pad(spec=StateEstimationSpec(imu_topic="")).check(NOW)
    assert (blind.valid, len(blind.checks), blind.gravity) == (True, 10, pytest.approx((0.0, 0.0, -G)))


def test_without_an_imu_gravity_is_where_the_estimate_says():
    up, estimate = rolled(10.0)
    verdict = on_the_pad(estimate, spec=StateEstimationSpec(imu_topic="")).check(NOW)
    assert verdict.gravity == pytest.approx(tuple(-each for each in up))


@pytest.mark.parametrize("known", [True, False])
def test_variances_of_a_message_are_of_position_and_orientation_and_all_zeros_are_none(known: bool):  # noqa: FBT001
    covariance = [0.0] * 36
    covariance[::7] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0] if known else [0.0] * 6
    axes = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    pose = SimpleNamespace(position=axes, orientation=axes)
    message = SimpleNamespace(pose=SimpleNamespace(pose=pose, covariance=covariance))
    estimate = estimate_reader(EstimateSource.POSE_WITH_COVARIANCE)(message)
    assert (estimate.position_variance, estimate.orientation_variance) == (
        ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)) if known else (None, None)
    )


def test_in_motion_what_a_flying_vehicle_cannot_show_is_left_out_and_the_rest_is_that_of_the_check():
    monitor = on_the_pad()
    rows = {row.name: row for row in monitor.check(NOW).checks}
    moving = {row.name: row for row in monitor.in_motion(NOW)}
    assert moving == {name: rows[name] for name in moving}
    estimated = ["estimate age", "estimate rate", "estimated tilt"]
    measured = ["IMU age", "gravity magnitude", "tilt", "tilt agreement"]
    assert list(moving) == [*estimated, *measured]
    nothing = StateEstimationMonitor().in_motion(NOW)
    assert [row.name for row in nothing] == [estimated[0], *measured], "nothing that needs an estimate"


def spinning(rate_rad_s: float, spec: Optional[StateEstimationSpec] = None) -> StateEstimationMonitor:
    """Return a monitor of a vehicle that stands, while the heading of its estimate turns."""
    monitor = on_the_pad(spec=spec)
    for index in range(1, 91):
        half, sign = rate_rad_s * index / 60, -1.0 if index % 2 else 1.0  # both signs are the same orientation
        orientation = (0.0, 0.0, sign * sin(half), sign * cos(half))
        monitor.add_estimate(NOW + index * S // 30, LEVEL._replace(orientation=orientation))
        monitor.add_imu(NOW + index * S // 30, (0.0, 0.0, G), (0.0, 0.0, 0.0))
    return monitor


@pytest.mark.parametrize("rate_rad_s", [1.0, -1.0, pi, 2 * pi, 0.12])
def test_an_estimate_whose_heading_turns_though_the_gyroscope_says_that_it_stands_drifts(rate_rad_s: float):
    rows = failed(spinning(rate_rad_s).check(NOW + 3 * S))
    assert set(rows) == {"estimate drift"}
    row = rows["estimate drift"]
    assert (row.verdict, row.limit, row.unit) == (Verdict.FAIL, pytest.approx(0.2), "rad")
    what = "the estimated orientation turns though the vehicle stands still"
    assert row.advice == f"{what}: let the estimator converge, or restart it"
    assert row.value == pytest.approx(min(2.0 * abs(rate_rad_s), pi), abs=0.06 * abs(rate_rad_s))


def test_an_estimate_that_turns_no_faster_than_the_gyroscope_may_stands_still():
    assert spinning(0.09).check(NOW + 3 * S).valid
    assert spinning(1.0, StateEstimationSpec(still_turn_rate_rad_s=1.1)).check(NOW + 3 * S).valid


def test_an_orientation_that_was_none_in_the_track_is_no_small_turn():
    monitor = on_the_pad()
    monitor.add_estimate(NOW + S // 10, LEVEL._replace(orientation=(0.0, nan, 0.0, 1.0)))
    monitor.add_estimate(NOW + S // 5, LEVEL)
    assert failed(monitor.check(NOW + S // 5))["estimate drift"].unit == "rad"


def test_an_estimate_without_an_orientation_is_not_said_to_turn():
    rows = failed(on_the_pad(LEVEL._replace(orientation=(0.0, 0.0, 0.0, 0.0))).check(NOW))
    assert set(rows) == {"quaternion norm", "estimated tilt", "tilt agreement"}


def test_a_nan_that_was_in_the_track_is_no_small_drift():
    monitor = on_the_pad()
    monitor.add_estimate(NOW + S // 10, LEVEL._replace(position=(1.0, nan, 0.0)))
    monitor.add_estimate(NOW + S // 5, LEVEL)
    assert "estimate drift" in failed(monitor.check(NOW + S // 5))


floats3 = st.tuples(st.floats(), st.floats(), st.floats())


@given(
    st.lists(
        st.tuples(st.integers(0, 2**60), floats3, st.tuples(floats3, st.floats()), floats3, st.none() | floats3),
        max_size=30,
    )
)
def test_no_number_breaks_it_and_what_is_not_finite_is_never_valid(calls: List[tuple]):
    monitor = StateEstimationMonitor()
    for t_ns, vector, (axis, w), variance, velocity in calls:
        monitor.add_imu(t_ns, vector, variance)
        monitor.add_estimate(t_ns, Estimate(vector, (*axis, w), variance, variance, velocity))
        verdict = monitor.check(t_ns)
        numbers = (*vector, *axis, w, *variance, *(velocity or ()))
        if any(number in (inf, -inf) or number != number for number in numbers):  # noqa: PLR0124
            assert not verdict.valid
