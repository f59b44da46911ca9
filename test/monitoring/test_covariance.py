"""The covariance as mavros tells it: behind a PX4 that leaves a part of it NaN, its rotation makes all of it NaN."""

from __future__ import annotations

from math import inf, nan, radians
from types import SimpleNamespace
from typing import List

import pytest
from monitoring_feed import S

from amaze_autonomy.engine.events import Check, Verdict
from amaze_autonomy.monitoring.readings import estimate_reader
from amaze_autonomy.monitoring.specs import EstimateSource, StateEstimationSpec
from amaze_autonomy.monitoring.state_estimation import StateEstimationMonitor, StateVerdict

ROWS = (("position deviation", 0.5, "m"), ("orientation deviation", radians(10.0), "rad"))


def judged(diagonal: List[float], *, required: bool = False) -> StateVerdict:
    """Return the verdict on a vehicle that has stood for 4 s, whose Odometry has such a diagonal."""
    zero = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
    covariance = [nan] * 36
    covariance[::7] = diagonal
    pose = SimpleNamespace(pose=SimpleNamespace(position=zero, orientation=zero), covariance=covariance)
    odometry = SimpleNamespace(pose=pose, twist=SimpleNamespace(twist=SimpleNamespace(linear=zero)))
    monitor = StateEstimationMonitor(StateEstimationSpec(require_covariance=required))
    read = estimate_reader(EstimateSource.ODOMETRY)
    for index in range(401):
        monitor.add_imu(index * S // 100, (0.0, 0.0, 9.80665), (0.0, 0.0, 0.0))
    for index in range(121):
        monitor.add_estimate(index * S // 30, read(odometry))
    return monitor.check(4 * S)


@pytest.mark.parametrize("required, verdict", [(False, Verdict.WARN), (True, Verdict.UNKNOWN)])
def test_a_diagonal_that_is_nan_throughout_is_no_covariance(required: bool, verdict: Verdict):  # noqa: FBT001
    said = judged([nan] * 6, required=required)
    expected = [
        Check(name, verdict, None, limit, unit, None, "the estimate has no covariance") for name, limit, unit in ROWS
    ]
    assert [row for row in said.checks if row.verdict is not Verdict.PASS] == expected
    assert said.valid is not required


@pytest.mark.parametrize(
    "diagonal, rows",
    [
        ([0.01] * 5 + [nan], ROWS[1:]),
        ([nan] * 3 + [0.01] * 3, ROWS[:1]),
        ([nan] * 5 + [0.0], ROWS),
        ([inf] * 6, ROWS),
        ([nan] * 5 + [inf], ROWS),
    ],
)
def test_one_that_is_nan_in_part_or_infinite_is_of_an_estimator_that_has_diverged(diagonal: List[float], rows: tuple):
    advice = "the covariance is not finite: the estimator has diverged, restart it"
    expected = [Check(name, Verdict.FAIL, None, limit, unit, None, advice) for name, limit, unit in rows]
    assert [row for row in judged(diagonal).checks if row.verdict is not Verdict.PASS] == expected
