"""What a message says, for the monitors: a range, an estimate, an orientation.

A message is any object with the fields of its ROS type, as rospy and rosbags make them; nothing of ROS is imported.
"""

from __future__ import annotations

from typing import Any, Callable, Mapping, NamedTuple, Optional

from .gravity import Quaternion, Vector
from .landing import nearest_return
from .specs import EstimateSource, LandingSpec, RangeSource
from .state_estimation import Estimate


class RangeReading(NamedTuple):
    """A reading and the limits that its message says, all in its units.

    Args:
        value: NaN when nothing was seen.
        least: None when the message does not say it.
        most: likewise.
    """

    value: float
    least: Optional[float] = None
    most: Optional[float] = None


def vector(value: Any) -> Vector:
    """Return x, y, z of a vector message."""
    return float(value.x), float(value.y), float(value.z)


def range_reader(spec: LandingSpec) -> Callable[[Any], RangeReading]:
    """Return what reads the messages of the kind that a landing detection listens to."""
    return _RANGES[spec.source](spec)


def estimate_reader(source: EstimateSource) -> Callable[[Any], Estimate]:
    """Return what reads estimates of a kind."""
    return _ESTIMATES[source]


def _range(_: LandingSpec) -> Callable[[Any], RangeReading]:
    return lambda message: RangeReading(float(message.range), float(message.min_range), float(message.max_range))


def _scan(spec: LandingSpec) -> Callable[[Any], RangeReading]:
    def read(message: Any) -> RangeReading:
        least, most = float(message.range_min), float(message.range_max)
        return RangeReading(nearest_return(message.ranges, spec, least, most), least, most)

    return read


_RANGES: Mapping[RangeSource, Callable[[LandingSpec], Callable[[Any], RangeReading]]] = {
    RangeSource.RANGE: _range,
    RangeSource.SCAN: _scan,
    RangeSource.FLOAT: lambda _: lambda message: RangeReading(float(message.data)),
    RangeSource.POSE: lambda _: lambda message: RangeReading(float(message.pose.position.z)),
}


def _odometry(message: Any) -> Estimate:
    return _with_covariance(message)._replace(velocity=vector(message.twist.twist.linear))


def _with_covariance(message: Any) -> Estimate:
    diagonal = [float(message.pose.covariance[7 * axis]) for axis in range(6)]
    known = any(diagonal)  # all zero: the message has none
    return Estimate(
        vector(message.pose.pose.position),
        _quaternion(message.pose.pose.orientation),
        (diagonal[0], diagonal[1], diagonal[2]) if known else None,
        (diagonal[3], diagonal[4], diagonal[5]) if known else None,
    )


def _pose(message: Any) -> Estimate:
    return Estimate(vector(message.pose.position), _quaternion(message.pose.orientation))


def _quaternion(value: Any) -> Quaternion:
    """Return it as it is: whether it is an orientation is what the check looks at."""
    return float(value.x), float(value.y), float(value.z), float(value.w)


_ESTIMATES: Mapping[EstimateSource, Callable[[Any], Estimate]] = {
    EstimateSource.ODOMETRY: _odometry,
    EstimateSource.POSE: _pose,
    EstimateSource.POSE_WITH_COVARIANCE: _with_covariance,
}
