"""Are the states valid, and does gravity point down? A check on the estimator's output, with the IMU as its witness."""

from __future__ import annotations

from collections import deque
from math import degrees, isfinite, isnan, sqrt
from typing import Callable, Deque, List, NamedTuple, Optional, Tuple

from ..engine.events import Check, Verdict
from .condition import Condition, Level, seconds
from .gravity import (
    BUCKET_NS,
    GravityWindow,
    ImuStatistics,
    Quaternion,
    Vector,
    angle_between,
    describe_tilt,
    likely_mistake,
    norm,
    rotate,
    rotation_from_rpy,
    tilt_of,
    turn_between,
    up_of_quaternion,
)
from .rate import RateMonitor
from .specs import StateEstimationSpec, TopicSpec

# --- estimate rows ----------------------------------------------------------------------------------------------------
# The rows of the pre-flight table that judge the estimator's last estimate, one function each.


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
    orientation: Quaternion
    position_variance: Optional[Vector] = None
    orientation_variance: Optional[Vector] = None
    velocity: Optional[Vector] = None


def age_row(name: str, age_ns: Optional[int], limit_ns: int, topic: str) -> Check:
    """Judge how old the last message of a topic is; from the future is not fresh either."""
    limit_s = limit_ns / _S
    if age_ns is None:
        return Check(name, Verdict.UNKNOWN, None, limit_s, "s", None, f"nothing came on {topic}: is its node running?")
    age_s = age_ns / _S
    if abs(age_ns) <= limit_ns:
        return Check(name, Verdict.PASS, age_s, limit_s, "s", age_s)
    how = "old: did its node stop?" if age_ns > 0 else "in the future: compare the clocks of the computers"
    advice = f"the last message on {topic} is {abs(age_s):.3g} s {how}"
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
    """Judge how sure the estimator is of position and orientation; a diagonal that is NaN throughout is none.

    So mavros says "unknown": of a covariance that is NaN in a part, as of a PX4 of before 2026, its rotation makes NaN.
    """
    position, orientation = estimate.position_variance, estimate.orientation_variance
    if all(map(isnan, (*(position or ()), *(orientation or ())))):
        position = orientation = None
    return (
        _deviation("position deviation", position, spec.position_deviation_limit_m, "m", spec),
        _deviation("orientation deviation", orientation, spec.orientation_deviation_limit_rad, "rad", spec),
    )


def _deviation(name: str, variance: Optional[Vector], limit: float, unit: str, spec: StateEstimationSpec) -> Check:
    """Judge the largest standard deviation; what messages say in the place of "unknown" excuses none that is too large.

    That is all zeros, or -1 in the first place (sensor_msgs). Nothing else that is negative is a variance.
    """
    known = variance or (0.0, 0.0, 0.0)
    unknown = not any(known) or known[0] == -1
    finite = all(map(isfinite, known))
    if not finite or (min(known) < 0 and not unknown):
        how = "negative" if finite else "not finite"
        advice = f"the covariance is {how}: the estimator has diverged, restart it"
        return Check(name, Verdict.FAIL, None, limit, unit, None, advice)
    deviation = sqrt(max(0.0, *known))
    if deviation > limit:
        advice = "the estimator is not sure: let it converge, move the vehicle as it needs, then retry"
        return Check(name, Verdict.FAIL, deviation, limit, unit, None, advice)
    if unknown:
        verdict = Verdict.UNKNOWN if spec.require_covariance else Verdict.WARN
        return Check(name, verdict, None, limit, unit, None, "the estimate has no covariance")
    return Check(name, Verdict.PASS, deviation, limit, unit)


# --- imu rows ---------------------------------------------------------------------------------------------------------
# The rows of the pre-flight table that judge what the IMU measured over a window, one function each.


_MISMOUNTED_DEG = 60.0


def magnitude_row(measured: Optional[ImuStatistics], spec: StateEstimationSpec) -> Check:
    """Judge the magnitude of gravity; the limit is the one that is nearer."""
    name, unit = "gravity magnitude", "m/s^2"
    low, high = (spec.gravity_m_s2 + sign * spec.gravity_tolerance_m_s2 for sign in (-1.0, 1.0))
    if measured is None or measured.samples < spec.min_samples:
        return Check(name, Verdict.UNKNOWN, None, low, unit, None, _too_few(measured, spec), other_limit=high)
    value = norm(measured.acceleration)
    limit, other = (high, low) if value > spec.gravity_m_s2 else (low, high)
    if abs(value - spec.gravity_m_s2) <= spec.gravity_tolerance_m_s2:
        return Check(name, Verdict.PASS, value, limit, unit, other_limit=other)
    advice = f"gravity is {value:.3g} m/s^2: {likely_mistake(value, spec.gravity_m_s2)}"
    return Check(name, Verdict.FAIL, value, limit, unit, None, advice, other_limit=other)


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
    few = measured is not None and measured.turn_rate is None and measured.samples < spec.min_samples
    if measured is None or few or observed_ns < spec.still_ns:
        advice = f"not observed for {seconds(spec.still_ns)} yet, wait"
        return Check(name, Verdict.UNKNOWN, None, limit, unit, None, advice, heals=True)
    if measured.turn_rate is None:
        advice = f"{spec.imu_topic} measures no turn rate: name an IMU with a gyroscope"
        return Check(name, Verdict.UNKNOWN, None, limit, unit, None, advice)
    if measured.turn_rate <= limit:
        return Check(name, Verdict.PASS, measured.turn_rate, limit, unit)
    advice = "do not turn the vehicle; if it stands still, calibrate the gyroscope"
    return Check(name, Verdict.FAIL, measured.turn_rate, limit, unit, None, advice)


def _too_few(measured: Optional[ImuStatistics], spec: StateEstimationSpec) -> str:
    count = 0 if measured is None else measured.samples
    return f"{count} good samples on {spec.imu_topic} in {seconds(spec.window_ns)}, {spec.min_samples} are needed"


# --- state estimation -------------------------------------------------------------------------------------------------


class StateVerdict(NamedTuple):
    """The answer of srv/CheckState.srv.

    Args:
        valid: every row passed.
        gravity: in the vehicle frame, m/s^2; at rest on level ground (0, 0, -9.81); None: unknown.
        tilt_rad: angle between the vehicle's z axis and the vertical; None: unknown.
        checks: the rows.
    """

    valid: bool
    gravity: Optional[Vector]
    tilt_rad: Optional[float]
    checks: Tuple[Check, ...]


class StateEstimationMonitor:
    """What IMU and estimator said last. Adding is cheap; the judgement is made when it is asked for."""

    def __init__(self, spec: Optional[StateEstimationSpec] = None) -> None:
        self.spec = spec or StateEstimationSpec()
        self._rotation = rotation_from_rpy(self.spec.imu_mounting_rpy_rad)
        self._imu = GravityWindow(max(self.spec.window_ns, self.spec.still_ns) + BUCKET_NS)
        self._rate: Optional[RateMonitor] = None
        self._estimate: Optional[Estimate] = None
        self._estimate_ns = 0
        self._arrived_ns = 0
        self._track: Deque[Tuple[int, Vector, Quaternion]] = deque()
        self.forget_estimates()

    def add_imu(self, t_ns: int, acceleration: Vector, turn_rate: Optional[Vector] = None) -> None:
        """Add a sample of the IMU in its own frame: specific force in m/s^2, turn rate in rad/s."""
        self._imu.add(t_ns, acceleration, turn_rate)

    def add_estimate(self, t_ns: int, estimate: Estimate, stamp_ns: Optional[int] = None) -> None:
        """Add an estimate that arrived at a time; its stamp, where given, tells its age."""
        if self._rate is not None:
            self._rate.add(t_ns)
        self.keep_estimate(t_ns, estimate, stamp_ns)

    def keep_estimate(self, t_ns: int, estimate: Estimate, stamp_ns: Optional[int] = None) -> None:
        """Add an estimate, but do not count it."""
        self._estimate, self._arrived_ns = estimate, t_ns
        self._estimate_ns = t_ns if stamp_ns is None else stamp_ns
        self.trace(t_ns, lambda: (estimate.position, estimate.orientation))

    def forget_estimates(self) -> None:
        """Judge by what comes from here on alone: the estimator has begun anew."""
        self._rate = RateMonitor(self._rate_spec()) if self.spec.topic else None
        self._estimate = None
        self._track.clear()

    def trace(self, t_ns: int, pose: Callable[[], Tuple[Vector, Quaternion]]) -> None:
        """Remember a pose, unless there is one of about the same time; `pose` is asked only when needed.

        What came before a gap does not tell what was in it: the track begins anew.
        """
        track, longest_ns = self._track, self.spec.age_limit_ns + BUCKET_NS  # so much later than the last one kept
        if track and not 0 <= t_ns - track[-1][0] <= longest_ns:
            track.clear()
        if not track or t_ns - track[-1][0] >= BUCKET_NS:
            track.append((t_ns, *pose()))
            while len(track) > 1 and track[1][0] <= t_ns - self.spec.still_ns:
                track.popleft()  # the first one kept is at least as old as the time to be observed

    @property
    def imu(self) -> GravityWindow:
        """What the IMU said last."""
        return self._imu

    @property
    def rate(self) -> Optional[RateMonitor]:
        """The rate of the estimates; None when there are none."""
        return self._rate

    def in_motion(self, t_ns: int) -> Tuple[Check, ...]:
        """Return the rows that say something of a vehicle that flies or is carried, as `check` has them."""
        spec = self.spec
        measured = self._imu.statistics(t_ns, spec.window_ns) if spec.imu_topic else None
        up = self._up(measured)
        rows: List[Check] = []
        if self._rate is not None:
            rows.append(self._age_row(t_ns))
            if self._estimate is not None:
                rows.append(self._rate_row(self._rate.evaluate(t_ns)))
                rows.append(estimate_tilt_row(self._estimate, spec))
        if spec.imu_topic:
            rows += self._gravity_rows(t_ns, measured, up)
            if spec.topic:
                rows.append(agreement_row(up, self._estimated_up(), spec))
        return tuple(rows)

    def check(self, t_ns: int) -> StateVerdict:
        """Return the verdict at a time."""
        measured = self._imu.statistics(t_ns, self.spec.window_ns) if self.spec.imu_topic else None
        up = self._up(measured)
        rows = self._estimate_rows(t_ns) + self._imu_rows(t_ns, measured, up)
        if up is None and self._estimate is not None and not self.spec.imu_topic:
            up = self._scaled_up()
        gravity = None if up is None else (-up[0], -up[1], -up[2])
        return StateVerdict(all(row.passed for row in rows), gravity, None if up is None else tilt_of(up), rows)

    def _up(self, measured: Optional[ImuStatistics]) -> Optional[Vector]:
        """Return the specific force in the vehicle frame; None: too few samples, or none to speak of."""
        if measured is None or measured.samples < self.spec.min_samples or not norm(measured.acceleration) > 0:
            return None
        return rotate(self._rotation, measured.acceleration)

    def _scaled_up(self) -> Optional[Vector]:
        """Return up as the estimate says it, as long as gravity."""
        up = self._estimated_up()
        g = self.spec.gravity_m_s2
        return None if up is None else (up[0] * g, up[1] * g, up[2] * g)

    def _estimated_up(self) -> Optional[Vector]:
        return None if self._estimate is None else up_of_quaternion(*self._estimate.orientation)

    def _estimate_rows(self, t_ns: int) -> Tuple[Check, ...]:
        spec, estimate = self.spec, self._estimate
        if self._rate is None:
            return ()
        rows: List[Check] = [self._age_row(t_ns)]
        if estimate is None:
            return tuple(rows)
        rows.append(self._rate_row(self._rate.evaluate(t_ns)))
        rows.append(finite_row(estimate))
        rows.append(quaternion_row(estimate, spec))
        rows.append(position_row(estimate, spec))
        rows.extend(deviation_rows(estimate, spec))
        rows.append(speed_row(estimate, spec))
        rows.append(estimate_tilt_row(estimate, spec))
        rows.append(self._drift_row(t_ns))
        return tuple(rows)

    def _imu_rows(self, t_ns: int, measured: Optional[ImuStatistics], up: Optional[Vector]) -> Tuple[Check, ...]:
        spec, first_ns = self.spec, self._imu.first_ns
        if not spec.imu_topic:
            return ()
        observed_ns = 0 if first_ns is None else t_ns - first_ns
        still = self._imu.statistics(t_ns, spec.still_ns)
        rows = [
            *self._gravity_rows(t_ns, measured, up),
            shaking_row(still, observed_ns, spec),
            turning_row(still, observed_ns, spec),
        ]
        if spec.topic:
            rows.append(agreement_row(up, self._estimated_up(), spec))
        return tuple(rows)

    def _age_row(self, t_ns: int) -> Check:
        age_ns = None if self._estimate is None else t_ns - self._estimate_ns
        return age_row("estimate age", age_ns, self.spec.age_limit_ns, self.spec.topic)

    def _gravity_rows(self, t_ns: int, measured: Optional[ImuStatistics], up: Optional[Vector]) -> List[Check]:
        spec, last_ns = self.spec, self._imu.last_ns
        age_ns = None if last_ns is None else t_ns - last_ns
        return [
            age_row("IMU age", age_ns, spec.age_limit_ns, spec.imu_topic),
            magnitude_row(measured, spec),
            imu_tilt_row(up, spec),
        ]

    def _rate_row(self, condition: Condition) -> Check:
        verdicts = {Level.GOOD: Verdict.PASS, Level.STARTING: Verdict.UNKNOWN, Level.OFF: Verdict.WARN}
        verdict = verdicts.get(condition.level, Verdict.FAIL)
        value, limit, other = condition.value, condition.limit, condition.other_limit
        return Check("estimate rate", verdict, value, limit, condition.unit, None, condition.reason, other_limit=other)

    def _drift_row(self, t_ns: int) -> Check:
        """Judge how far the estimate moved, and turned, while the vehicle should stand still."""
        spec, name = self.spec, "estimate drift"
        since_ns = t_ns - spec.still_ns - BUCKET_NS
        recent = [(position, orientation) for at, position, orientation in self._track if at >= since_ns]
        observed_ns = self._arrived_ns - self._track[0][0]
        if observed_ns < spec.still_ns or not recent:
            advice = f"not observed for {seconds(spec.still_ns)} yet, wait"
            return Check(name, Verdict.UNKNOWN, None, spec.still_drift_m, "m", None, advice, heals=True)
        axes = list(zip(*(position for position, _ in recent)))
        drift_m = norm((max(axes[0]) - min(axes[0]), max(axes[1]) - min(axes[1]), max(axes[2]) - min(axes[2])))
        finite = all(all(map(isfinite, axis)) for axis in axes)
        advice = "the estimated {} though the vehicle stands still: let the estimator converge, or restart it"
        if not finite or drift_m > spec.still_drift_m:
            return Check(name, Verdict.FAIL, drift_m, spec.still_drift_m, "m", None, advice.format("position drifts"))
        turned_rad = max(turn_between(recent[0][1], orientation) for _, orientation in recent)
        limit_rad = spec.still_turn_rate_rad_s * spec.still_ns / _S  # as much as the gyroscope may say
        if turned_rad > limit_rad and self._estimated_up() is not None:  # without an orientation other rows fail
            return Check(name, Verdict.FAIL, turned_rad, limit_rad, "rad", None, advice.format("orientation turns"))
        return Check(name, Verdict.PASS, drift_m, spec.still_drift_m, "m")

    def _rate_spec(self) -> TopicSpec:
        spec = self.spec
        failed = min(0.3, 0.5 * (1 - spec.tolerance_fraction))
        return TopicSpec(
            spec.topic,
            spec.rate_hz,
            tolerance_fraction=spec.tolerance_fraction,
            rate_failed_fraction=failed,
            age_limit_ns=spec.age_limit_ns,
        )
