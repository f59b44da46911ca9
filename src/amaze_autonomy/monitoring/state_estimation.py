"""Are the states valid, and does gravity point down? A check on the estimator's output, with the IMU as its witness."""

from __future__ import annotations

from collections import deque
from math import isfinite
from typing import Callable, Deque, List, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.checks import Check, Verdict

from . import estimate_rows as of_estimate
from . import imu_rows as of_imu
from .condition import Condition, Level, seconds
from .estimate_rows import Estimate
from .gravity import (
    BUCKET_NS,
    GravityWindow,
    ImuStatistics,
    Vector,
    norm,
    rotate,
    rotation_from_rpy,
    tilt_of,
    up_of_quaternion,
)
from .rate import RateMonitor
from .specs import StateEstimationSpec, TopicSpec

__all__ = ["Estimate", "StateEstimationMonitor", "StateVerdict"]


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
        self._rate = RateMonitor(self._rate_spec()) if self.spec.topic else None
        self._estimate: Optional[Estimate] = None
        self._estimate_ns = 0
        self._arrived_ns = 0
        self._track: Deque[Tuple[int, Vector]] = deque()

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
        self.trace(t_ns, lambda: estimate.position)

    def trace(self, t_ns: int, position: Callable[[], Vector]) -> None:
        """Remember a position, unless there is one of about the same time; `position` is asked only when needed."""
        track = self._track
        if track and t_ns < track[-1][0]:
            track.clear()
        if not track or t_ns - track[-1][0] >= BUCKET_NS:
            track.append((t_ns, position()))
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
                rows.append(of_estimate.estimate_tilt_row(self._estimate, spec))
        if spec.imu_topic:
            rows += self._gravity_rows(t_ns, measured, up)
            if spec.topic:
                rows.append(of_imu.agreement_row(up, self._estimated_up(), spec))
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
        rows.append(of_estimate.finite_row(estimate))
        rows.append(of_estimate.quaternion_row(estimate, spec))
        rows.append(of_estimate.position_row(estimate, spec))
        rows.extend(of_estimate.deviation_rows(estimate, spec))
        rows.append(of_estimate.speed_row(estimate, spec))
        rows.append(of_estimate.estimate_tilt_row(estimate, spec))
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
            of_imu.shaking_row(still, observed_ns, spec),
            of_imu.turning_row(still, observed_ns, spec),
        ]
        if spec.topic:
            rows.append(of_imu.agreement_row(up, self._estimated_up(), spec))
        return tuple(rows)

    def _age_row(self, t_ns: int) -> Check:
        age_ns = None if self._estimate is None else t_ns - self._estimate_ns
        return of_estimate.age_row("estimate age", age_ns, self.spec.age_limit_ns, self.spec.topic)

    def _gravity_rows(self, t_ns: int, measured: Optional[ImuStatistics], up: Optional[Vector]) -> List[Check]:
        spec, last_ns = self.spec, self._imu.last_ns
        age_ns = None if last_ns is None else t_ns - last_ns
        return [
            of_estimate.age_row("IMU age", age_ns, spec.age_limit_ns, spec.imu_topic),
            of_imu.magnitude_row(measured, spec),
            of_imu.imu_tilt_row(up, spec),
        ]

    def _rate_row(self, condition: Condition) -> Check:
        verdicts = {Level.GOOD: Verdict.PASS, Level.STARTING: Verdict.UNKNOWN, Level.OFF: Verdict.WARN}
        verdict = verdicts.get(condition.level, Verdict.FAIL)
        return Check("estimate rate", verdict, condition.value, condition.limit, condition.unit, None, condition.reason)

    def _drift_row(self, t_ns: int) -> Check:
        """Judge how far the estimated position moved while the vehicle should stand still."""
        spec, name = self.spec, "estimate drift"
        recent = [position for at, position in self._track if at >= t_ns - spec.still_ns - BUCKET_NS]
        observed_ns = self._arrived_ns - self._track[0][0]
        if observed_ns < spec.still_ns or not recent:
            advice = f"not observed for {seconds(spec.still_ns)} yet, wait"
            return Check(name, Verdict.UNKNOWN, None, spec.still_drift_m, "m", None, advice, heals=True)
        axes = list(zip(*recent))
        drift_m = norm((max(axes[0]) - min(axes[0]), max(axes[1]) - min(axes[1]), max(axes[2]) - min(axes[2])))
        finite = all(all(map(isfinite, axis)) for axis in axes)
        if finite and drift_m <= spec.still_drift_m:
            return Check(name, Verdict.PASS, drift_m, spec.still_drift_m, "m")
        advice = (
            "the estimated position drifts though the vehicle stands still: let the estimator converge, or restart it"
        )
        return Check(name, Verdict.FAIL, drift_m, spec.still_drift_m, "m", None, advice)

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
