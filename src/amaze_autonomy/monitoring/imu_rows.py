"""The rows of the pre-flight table that judge what the IMU measured over a window, one function each."""

from __future__ import annotations

from math import degrees
from typing import Optional

from amaze_autonomy.engine.checks import Check, Verdict

from .condition import seconds
from .gravity import (
    ImuStatistics,
    Vector,
    angle_between,
    describe_tilt,
    likely_mistake,
    norm,
    tilt_of,
)
from .specs import StateEstimationSpec

__all__ = ["agreement_row", "imu_tilt_row", "magnitude_row", "shaking_row", "turning_row"]

_MISMOUNTED_DEG = 60.0


def magnitude_row(measured: Optional[ImuStatistics], spec: StateEstimationSpec) -> Check:
    """Judge the magnitude of gravity; the limit is the one that is nearer."""
    name, unit = "gravity magnitude", "m/s^2"
    if measured is None or measured.samples < spec.min_samples:
        return Check(name, Verdict.UNKNOWN, None, spec.gravity_m_s2, unit, None, _too_few(measured, spec))
    value = norm(measured.acceleration)
    sign = 1.0 if value > spec.gravity_m_s2 else -1.0
    limit = spec.gravity_m_s2 + sign * spec.gravity_tolerance_m_s2
    if abs(value - spec.gravity_m_s2) <= spec.gravity_tolerance_m_s2:
        return Check(name, Verdict.PASS, value, limit, unit)
    advice = f"gravity is {value:.3g} m/s^2: {likely_mistake(value, spec.gravity_m_s2)}"
    return Check(name, Verdict.FAIL, value, limit, unit, None, advice)


def imu_tilt_row(up: Optional[Vector], spec: StateEstimationSpec) -> Check:
    """Judge the tilt of the vehicle: does gravity point down in its frame?"""
    limit = spec.tilt_limit_rad
    if up is None:
        return Check("tilt", Verdict.UNKNOWN, None, limit, "rad", None, "gravity is unknown")
    tilt_rad = tilt_of(up)
    if tilt_rad <= limit:
        return Check("tilt", Verdict.PASS, tilt_rad, limit, "rad")
    advice = f"vehicle is tilted {describe_tilt(up)}, limit {degrees(limit):.0f} deg"
    if degrees(tilt_rad) > _MISMOUNTED_DEG:
        advice += "; if it stands level, imu_mounting_rpy_deg is wrong"
    return Check("tilt", Verdict.FAIL, tilt_rad, limit, "rad", None, advice)


def agreement_row(up: Optional[Vector], estimated_up: Optional[Vector], spec: StateEstimationSpec) -> Check:
    """Judge whether estimator and IMU agree about where up is."""
    name, limit = "tilt agreement", spec.tilt_difference_limit_rad
    if up is None or estimated_up is None:
        return Check(name, Verdict.UNKNOWN, None, limit, "rad", None, "one of the two tilts is unknown")
    angle = angle_between(up, estimated_up)
    if angle <= limit:
        return Check(name, Verdict.PASS, angle, limit, "rad")
    advice = (
        f"the IMU says {describe_tilt(up)}, the estimator {describe_tilt(estimated_up)}: "
        "restart the estimator, check the mounting rotation"
    )
    return Check(name, Verdict.FAIL, angle, limit, "rad", None, advice)


def shaking_row(measured: Optional[ImuStatistics], observed_ns: int, spec: StateEstimationSpec) -> Check:
    """Judge the spread of the acceleration while the vehicle should stand still."""
    name, limit, unit = "shaking", spec.still_acceleration_m_s2, "m/s^2"
    if measured is None or measured.samples < spec.min_samples or observed_ns < spec.still_ns:
        advice = f"not observed for {seconds(spec.still_ns)} yet, wait"
        return Check(name, Verdict.UNKNOWN, None, limit, unit, None, advice, heals=True)
    if measured.deviation <= limit:
        return Check(name, Verdict.PASS, measured.deviation, limit, unit)
    return Check(
        name,
        Verdict.FAIL,
        measured.deviation,
        limit,
        unit,
        None,
        f"do not move the vehicle for {seconds(spec.still_ns)}",
    )


def turning_row(measured: Optional[ImuStatistics], observed_ns: int, spec: StateEstimationSpec) -> Check:
    """Judge the mean turn rate: a vehicle that turns, or a gyroscope with a bias."""
    name, limit, unit = "turning", spec.still_turn_rate_rad_s, "rad/s"
    if measured is None or measured.turn_rate is None or observed_ns < spec.still_ns:
        advice = f"not observed for {seconds(spec.still_ns)} yet, wait"
        return Check(name, Verdict.UNKNOWN, None, limit, unit, None, advice, heals=True)
    if measured.turn_rate <= limit:
        return Check(name, Verdict.PASS, measured.turn_rate, limit, unit)
    advice = "do not turn the vehicle; if it stands still, calibrate the gyroscope"
    return Check(name, Verdict.FAIL, measured.turn_rate, limit, unit, None, advice)


def _too_few(measured: Optional[ImuStatistics], spec: StateEstimationSpec) -> str:
    count = 0 if measured is None else measured.samples
    return f"{count} good samples on {spec.imu_topic} in {seconds(spec.window_ns)}, {spec.min_samples} are needed"
