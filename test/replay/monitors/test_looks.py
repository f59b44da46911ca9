"""Where no look at the state check is made every row passes; samples taken together are those taken one by one."""

from __future__ import annotations

from bisect import bisect_right
from math import cos, nan, radians, sin
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from replay_bags import S

from amaze_autonomy.engine.events import Verdict
from amaze_autonomy.monitoring.specs import EstimateSource, StateEstimationSpec
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor
from amaze_autonomy.replay.maps.topic_map import Reading
from amaze_autonomy.replay.monitors.feeds import EstimateFeed, ImuFeed
from amaze_autonomy.replay.monitors.monitor_columns import unsure_looks
from amaze_autonomy.replay.recordings.fields import Track

SPEC = StateEstimationSpec(
    topic="/odometry", imu_topic="/imu", source=EstimateSource.ODOMETRY, imu_mounting_rpy_rad=(0.1, -0.2, 3.0)
)
IMU = Reading("/imu", {"acceleration": "linear_acceleration", "turn_rate": "angular_velocity"})
ESTIMATE = Reading("/odometry", {})
START_NS = 1_600_000_000 * S
FOLLOWED = ("IMU age", "gravity magnitude", "tilt", "estimate age", "estimate tilt", "estimated tilt", "tilt agreement")
parts = st.lists(
    st.tuples(
        st.integers(1, 400),  # samples of the IMU
        st.sampled_from([0.0, 0.0, 3.0, 6.0, 9.99, 10.01, 40.0, 179.0]),  # tilt, degrees
        st.sampled_from([1.0, 1.0, 1.05, 0.2, 0.0, float("nan"), 1e7]),  # times gravity
        st.sampled_from([0, 0, 0, S // 3, S // 2 + 1, 2 * S]),  # silence before
        st.sampled_from([0.0, 1e-7, 0.3]),  # noise
    ),
    min_size=1,
    max_size=6,
)


def tracks_of(told, random):
    """Return times and numbers of an IMU of 100 Hz, and of an estimate of 33 Hz that at times believes otherwise."""
    now, imu, estimates = START_NS, [], []
    for count, tilt_deg, factor, silence_ns, noise in told:
        now += silence_ns
        believed = radians(tilt_deg if random.random() < 0.7 else random.uniform(0.0, 12.0))
        spread_m = random.choice([0.0, 1.0])  # where the position stands, its turn decides of the drift
        for _ in range(count):
            now += S // 100
            tilt = radians(tilt_deg)
            force = [9.81 * factor * each + random.uniform(-noise, noise) for each in (sin(tilt), 0.0, cos(tilt))]
            turns = [random.uniform(-noise, noise) for _ in range(3)]
            covariance = random.choice([0.0, 0.0, 1e-4, -1.0])
            imu.append((now, (*force, *turns, covariance)))
            if len(imu) % 3 == 0:
                stamp_ns = random.choice([0, now, now - S // 10, now - S])
                pose = (1.0, 2.0, spread_m * random.random(), 0.0, -sin(believed / 2), 0.0, cos(believed / 2))
                rest = [random.choice([0.0, 1e-4, nan])] * 6 + [0.0, 0.1, 0.0]
                estimates.append((now + 7, (*divmod(stamp_ns, S), *pose, *rest)))
    return imu, estimates


def track_of(rows):
    return Track(np.array([t_ns for t_ns, _ in rows]), tuple(map(np.array, zip(*(values for _, values in rows)))))


def riders(imu, estimates):
    monitor = StateEstimationMonitor(SPEC)
    feeds = ImuFeed(monitor, IMU), EstimateFeed(monitor, ESTIMATE)
    for feed, rows in zip(feeds, (imu, estimates)):
        feed.ride(track_of(rows), 0)
    return monitor, feeds


@settings(max_examples=40, deadline=None)
@given(parts, st.integers(0, 2**32).map(Random))
def test_samples_together_are_judged_as_one_after_the_other(told, random):
    imu, estimates = tracks_of([(300, 0.0, 1.0, 0, 0.0), *told], random)
    together, feeds = riders(imu, estimates)
    alone = StateEstimationMonitor(SPEC)
    singly = ImuFeed(alone, IMU), EstimateFeed(alone, ESTIMATE)
    taken = [0, 0]
    for asked_ns in sorted(random.randint(START_NS, imu[-1][0] + 2 * S) for _ in range(8)):
        for place, (feed, rows) in enumerate(zip(singly, (imu, estimates))):
            end = bisect_right([t_ns for t_ns, _ in rows], asked_ns)
            for t_ns, values in rows[taken[place] : end]:
                feed.take_values(t_ns, values)
            taken[place] = end
        for feed in feeds:
            feed.until((asked_ns, 1))
        if taken[1]:
            assert repr(together.check(asked_ns)) == repr(alone.check(asked_ns))
            assert repr(together.in_motion(asked_ns)) == repr(alone.in_motion(asked_ns))


@pytest.mark.parametrize("last, verdict", [(nan, Verdict.WARN), (1e-4, Verdict.FAIL)])
def test_a_covariance_of_nothing_but_nan_is_none_here_too(last, verdict):
    monitor = StateEstimationMonitor(SPEC)
    pose = (1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    EstimateFeed(monitor, ESTIMATE).take_values(START_NS, (0, 0, *pose, *[nan] * 5, last, 0.0, 0.0, 0.0))
    rows = {row.name: row.verdict for row in monitor.check(START_NS).checks}
    assert (rows["position deviation"], rows["orientation deviation"]) == (verdict, verdict)


@settings(max_examples=40, deadline=None)
@given(parts, st.integers(0, 2**32).map(Random))
def test_where_no_look_is_needed_every_row_passes(told, random):
    imu, estimates = tracks_of([(300, 0.0, 1.0, 0, 0.0), *told], random)
    looks = np.arange(START_NS + S, imu[-1][0] + S, S // 10)
    unsure = set(unsure_looks(looks, SPEC, track_of(imu), 1.0, track_of(estimates)).tolist())
    monitor, feeds = riders(imu, estimates)
    for place, look_ns in enumerate(looks.tolist()):
        for feed in feeds:
            feed.until((look_ns, 1))
        if place not in unsure:
            rows = [row for row in monitor.in_motion(look_ns) if row.name in FOLLOWED]
            assert [row.name for row in rows if not row.passed] == []
            assert len(rows) == 6


def test_a_level_flight_needs_hardly_a_look():
    imu, estimates = tracks_of([(3000, 0.0, 1.0, 0, 0.3)], Random(1))
    estimates = [(t_ns, (0, 0, *values[2:5], 0.0, 0.0, 0.0, 1.0, *values[9:])) for t_ns, values in estimates]
    imu = [(t_ns, (0.0, 0.0, 9.81, 0.0, 0.0, 0.0)) for t_ns, _ in imu]
    level = StateEstimationSpec(topic="/odometry", imu_topic="/imu")
    looks = np.arange(START_NS + S, imu[-1][0], S // 10)
    assert len(looks) > 250
    assert len(unsure_looks(looks, level, track_of(imu), 1.0, track_of(estimates))) <= level.window_ns // (S // 10)
