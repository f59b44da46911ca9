"""From messages to the check of the states: samples of an accelerometer, and estimates."""

from __future__ import annotations

from functools import partial
from typing import Any, Mapping, Optional, Tuple

import numpy as np

from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.gravity import BUCKET_NS, PLAUSIBLE_M2_S4, rotation_from_rpy
from amaze_autonomy.monitoring.readings import estimate_reader
from amaze_autonomy.monitoring.specs import EstimateSource
from amaze_autonomy.monitoring.state_estimation import Estimate, StateEstimationMonitor

from .feed import Feed
from .fields import getter, vector
from .pace import Pace
from .topic_map import Reading
from .tracks import Track

__all__ = ["EstimateFeed", "ImuFeed"]

Vector = Tuple[float, float, float]

_S = 1_000_000_000
_SURE: Vector = (1e-4, 1e-4, 1e-4)
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_POSE = (*(f"position.{axis}" for axis in "xyz"), *(f"orientation.{axis}" for axis in "xyzw"))
_WITH_COVARIANCE = (
    *_STAMP,
    *(f"pose.pose.{each}" for each in _POSE),
    *(f"pose.covariance[{7 * axis}]" for axis in range(6)),
)
_ESTIMATE: Mapping[EstimateSource, Tuple[str, ...]] = {
    EstimateSource.POSE: (*_STAMP, *(f"pose.{each}" for each in _POSE)),
    EstimateSource.POSE_WITH_COVARIANCE: _WITH_COVARIANCE,
    EstimateSource.ODOMETRY: (*_WITH_COVARIANCE, *(f"twist.twist.linear.{axis}" for axis in "xyz")),
}


class ImuFeed(Feed):
    """An accelerometer in the vehicle, for the check of gravity."""

    def __init__(self, monitor: StateEstimationMonitor, reading: Reading) -> None:
        rpy, g = monitor.spec.imu_mounting_rpy_rad, monitor.spec.gravity_m_s2
        vectors = [reading.fields[name] for name in ("acceleration", "turn_rate") if name in reading.fields]
        super().__init__(reading.topic, _S // 50, paths=tuple(f"{path}.{axis}" for path in vectors for axis in "xyz"))
        self._window, self._add, self.scale = monitor.imu, monitor.add_imu, reading.scale
        self._acceleration = getter(reading.fields["acceleration"])
        self._turn_rate = getter(reading.fields["turn_rate"]) if "turn_rate" in reading.fields else None
        column = rotation_from_rpy(rpy)[2]  # up in the sensor's frame: the transposed matrix times (0, 0, 1)
        self._level: Vector = (column[0] * g, column[1] * g, column[2] * g)

    def take(self, t_ns: int, message: Any) -> None:
        """Take a sample."""
        x, y, z = vector(self._acceleration(message))
        scale = self.scale
        turn_rate = vector(self._turn_rate(message)) if self._turn_rate is not None else None
        self._add(t_ns, (x * scale, y * scale, z * scale), turn_rate)

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take the three numbers of the acceleration, and of the turn rate where it has one."""
        if type(values[0]) is not float or type(values[-1]) is not float:  # an odd message with whole numbers
            values = tuple(map(float, values))
        scale = self.scale
        self._add(t_ns, (values[0] * scale, values[1] * scale, values[2] * scale), values[3:] or None)

    def take_many(self, begin: int, end: int) -> None:
        """Take samples of the track; of those that are too old to be kept, when they came."""
        times = self.track.times
        oldest_ns = (int(times[end - 1]) - self._window.span_ns) // BUCKET_NS * BUCKET_NS
        first = min(end, max(begin, int(np.searchsorted(times, oldest_ns))))
        if first > begin:
            x, y, z = (column[begin:first].astype(float) * self.scale for column in self.track.columns[:3])
            with np.errstate(over="ignore", invalid="ignore"):
                good = x * x + y * y + z * z < PLAUSIBLE_M2_S4
            self._window.skip(times[begin:first][good].tolist())
        super().take_many(first, end)

    def play(self, t_ns: int) -> None:
        """Take what a vehicle measures that stands level and still."""
        self._add(t_ns, self._level, (0.0, 0.0, 0.0))


class EstimateFeed(Feed):
    """An estimate of the state, for its check."""

    def __init__(self, monitor: StateEstimationMonitor, reading: Reading) -> None:
        super().__init__(reading.topic, round(_S / monitor.spec.rate_hz), paths=_ESTIMATE[monitor.spec.source])
        self._monitor = monitor
        self._read = estimate_reader(monitor.spec.source)
        self._pace: Optional[Pace] = None

    def ride(self, track: Track, rank: int) -> None:
        """Take all estimates of a track."""
        super().ride(track, rank)
        if self._monitor.rate is not None:
            self._pace = Pace(self._monitor.rate, track, self._monitor.rate.add)

    def take_many(self, begin: int, end: int) -> None:
        """Take estimates of the track: the last one, and where the others were."""
        if self._pace is not None:
            self._pace.take(begin, end)
        for place, t_ns in enumerate(self.track.listed[begin : end - 1], begin):
            self._monitor.trace(t_ns, partial(self._position, place))
        self._monitor.keep_estimate(self.track.listed[end - 1], *self._estimate(self.track.rows(end - 1, end)[0]))

    def changes_ns(self) -> int:
        """Return when the rate's verdict can change by an estimate, or by none, of the track."""
        return FOREVER_NS if self._pace is None else self._pace.changes_ns(self.taken)

    def take(self, t_ns: int, message: Any) -> None:
        """Take an estimate; a header stamp of 0 says nothing about its age."""
        stamp = message.header.stamp
        stamp_ns = int(stamp.sec) * _S + int(stamp.nanosec)
        self._monitor.add_estimate(t_ns, self._read(message), stamp_ns or None)

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take an estimate as numbers."""
        self._monitor.add_estimate(t_ns, *self._estimate(values))

    def _position(self, place: int) -> Vector:
        x, y, z = self.track.columns[2:5]
        return float(x[place]), float(y[place]), float(z[place])

    @staticmethod
    def _estimate(values: Tuple[Any, ...]) -> Tuple[Estimate, Optional[int]]:
        """Return an estimate and its stamp."""
        seconds, fraction, *rest = values
        x, y, z, qx, qy, qz, qw, *more = map(float, rest)
        estimate = Estimate((x, y, z), (qx, qy, qz, qw))
        if any(more[:6]):  # all zero: the message has none
            estimate = estimate._replace(
                position_variance=(more[0], more[1], more[2]), orientation_variance=(more[3], more[4], more[5])
            )
        if len(more) > 6:  # noqa: PLR2004  (a velocity)
            estimate = estimate._replace(velocity=(more[6], more[7], more[8]))
        return estimate, (seconds * _S + fraction) or None

    def play(self, t_ns: int) -> None:
        """Take what a good estimator says of a vehicle that stands level and still."""
        good = Estimate((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), _SURE, _SURE, (0.0, 0.0, 0.0))
        self._monitor.add_estimate(t_ns, good)
