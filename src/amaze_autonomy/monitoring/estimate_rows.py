"""The rows of the pre-flight table that judge the estimator's last estimate, one function each."""

from __future__ import annotations

from math import degrees, isfinite, sqrt
from typing import NamedTuple, Optional, Tuple

from amaze_autonomy.engine.checks import Check, Verdict

from .gravity import Vector, describe_tilt, norm, tilt_of, up_of_quaternion
from .specs import StateEstimationSpec

__all__ = [
    "Estimate",
    "age_row",
    "deviation_rows",
    "estimate_tilt_row",
    "finite_row",
    "position_row",
    "quaternion_row",
    "speed_row",
]

_S = 1_000_000_000


class Estimate(NamedTuple):
    """One estimate.

    Args:
        position: m.
        orientation: quaternion x, y, z, w of the vehicle in the world.
        position_variance: diagonal of the covariance, m^2; None when the message has none.
        orientation_variance: diagonal of the covariance, rad^2; None when the message has none.
        velocity: m/s; None when the message has none.
    """

    position: Vector
    orientation: Tuple[float, float, float, float]
    position_variance: Optional[Vector] = None
    orientation_variance: Optional[Vector] = None
    velocity: Optional[Vector] = None


def age_row(name: str, age_ns: Optional[int], limit_ns: int, topic: str) -> Check:
    """Judge how old the last word of a topic is; from the future is not fresh either."""
    limit_s = limit_ns / _S
    if age_ns is None:
        return Check(name, Verdict.UNKNOWN, None, limit_s, "s", None, f"nothing came on {topic}: is its node running?")
    age_s = age_ns / _S
    if abs(age_ns) <= limit_ns:
        return Check(name, Verdict.PASS, age_s, limit_s, "s", age_s)
    how = "old: did its node stop?" if age_ns > 0 else "in the future: compare the clocks of the computers"
    advice = f"the last word on {topic} is {abs(age_s):.3g} s {how}"
    return Check(name, Verdict.FAIL, age_s, limit_s, "s", age_s, advice)


def finite_row(estimate: Estimate) -> Check:
    """Judge whether every number is finite; the value is how many are not."""
    numbers = (*estimate.position, *estimate.orientation, *(estimate.velocity or ()))
    bad = sum(1 for number in numbers if not isfinite(number))
    if not bad:
        return Check("estimate finite", Verdict.PASS, 0.0, 0.0, "numbers")
    advice = f"{bad} of {len(numbers)} numbers are NaN or infinite: restart the estimator"
    return Check("estimate finite", Verdict.FAIL, float(bad), 0.0, "numbers", None, advice)


def quaternion_row(estimate: Estimate, spec: StateEstimationSpec) -> Check:
    """Judge whether the orientation is a unit quaternion; value and limit are the deviation of its norm from 1."""
    x, y, z, w = estimate.orientation
    off = abs(sqrt(x * x + y * y + z * z + w * w) - 1.0)
    if off <= spec.quaternion_tolerance:
        return Check("quaternion norm", Verdict.PASS, off, spec.quaternion_tolerance)
    if (x, y, z, w) == (0.0, 0.0, 0.0, 0.0):
        advice = "the orientation is all zero: the estimator does not know it, or does not fill it in"
    else:
        advice = "the orientation is no unit quaternion: the estimator has diverged, restart it"
    return Check("quaternion norm", Verdict.FAIL, off, spec.quaternion_tolerance, "", None, advice)


def position_row(estimate: Estimate, spec: StateEstimationSpec) -> Check:
    """Judge whether the position is anywhere that makes sense."""
    distance_m, limit_m = norm(estimate.position), spec.position_limit_m
    if distance_m <= limit_m:
        return Check("distance from origin", Verdict.PASS, distance_m, limit_m, "m")
    advice = "the position is far from the origin: the estimator has diverged, or its origin is elsewhere"
    return Check("distance from origin", Verdict.FAIL, distance_m, limit_m, "m", None, advice)


def speed_row(estimate: Estimate, spec: StateEstimationSpec) -> Check:
    """Judge the estimated speed of a vehicle that stands on the ground."""
    name, limit = "estimated speed", spec.speed_limit_m_s
    if estimate.velocity is None:
        return Check(name, Verdict.PASS, None, limit, "m/s")
    speed = norm(estimate.velocity)
    if speed <= limit:
        return Check(name, Verdict.PASS, speed, limit, "m/s")
    return Check(
        name, Verdict.FAIL, speed, limit, "m/s", None, "the estimate moves though the vehicle stands: restart it"
    )


def estimate_tilt_row(estimate: Estimate, spec: StateEstimationSpec) -> Check:
    """Judge the tilt that the estimate says."""
    name, limit = "estimated tilt", spec.tilt_limit_rad
    up = up_of_quaternion(*estimate.orientation)
    if up is None:
        return Check(name, Verdict.UNKNOWN, None, limit, "rad", None, "the orientation is unknown")
    tilt_rad = tilt_of(up)
    if tilt_rad <= limit:
        return Check(name, Verdict.PASS, tilt_rad, limit, "rad")
    advice = f"the estimator says that the vehicle is tilted {describe_tilt(up)}, limit {degrees(limit):.0f} deg"
    return Check(name, Verdict.FAIL, tilt_rad, limit, "rad", None, advice)


def deviation_rows(estimate: Estimate, spec: StateEstimationSpec) -> Tuple[Check, ...]:
    """Judge how sure the estimator is of position and orientation."""
    return (
        _deviation("position deviation", estimate.position_variance, spec.position_deviation_limit_m, "m", spec),
        _deviation(
            "orientation deviation", estimate.orientation_variance, spec.orientation_deviation_limit_rad, "rad", spec
        ),
    )


def _deviation(name: str, variance: Optional[Vector], limit: float, unit: str, spec: StateEstimationSpec) -> Check:
    """Judge the largest standard deviation; all zero, and anything negative, is how messages say "unknown"."""
    if variance is not None and not all(isfinite(value) for value in variance):
        advice = "the covariance is not finite: the estimator has diverged, restart it"
        return Check(name, Verdict.FAIL, None, limit, unit, None, advice)
    if variance is None or min(variance) < 0 or max(variance) == 0:
        verdict = Verdict.UNKNOWN if spec.require_covariance else Verdict.WARN
        return Check(name, verdict, None, limit, unit, None, "the estimate has no covariance")
    deviation = sqrt(max(variance))
    if deviation <= limit:
        return Check(name, Verdict.PASS, deviation, limit, unit)
    advice = "the estimator is not sure: let it converge, move the vehicle as it needs, then retry"
    return Check(name, Verdict.FAIL, deviation, limit, unit, None, advice)
