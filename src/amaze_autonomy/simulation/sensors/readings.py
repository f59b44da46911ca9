"""What the simulated sensors read: range, IMU and state estimate, from the vehicle's present position and attitude."""

from __future__ import annotations

import abc
from math import cos, nan, sin
from typing import TYPE_CHECKING, Generic, NamedTuple, Optional, Tuple, TypeVar

from ...monitoring.state_estimation import Estimate
from ..vehicle.vehicle import Pose
from .streams import Batch, Content

if TYPE_CHECKING:
    import random

    from amaze_autonomy.monitoring.preflight_specs import LandingSpec, StateEstimationSpec

__all__ = ["Estimate", "EstimateReader", "ImuReader", "Inertial", "RangeReader", "Reader", "Vector"]

Vector = Tuple[float, float, float]

_RANGE_NOISE_M = 0.005
_ACCELERATION_NOISE_M_S2 = 0.03
_FLIGHT_NOISE_M_S2 = 0.4
_TURN_NOISE_RAD_S = 0.002
_POSITION_NOISE_M = 0.003
_POSITION_VARIANCE: Vector = (0.0025, 0.0025, 0.0025)
_ORIENTATION_VARIANCE: Vector = (0.0004, 0.0004, 0.0004)

_Matrix = Tuple[Vector, Vector, Vector]
_NANS: Vector = (nan, nan, nan)

T = TypeVar("T")


class Inertial(NamedTuple):
    """One sample of an IMU in its own frame: specific force in m/s^2, turn rate in rad/s."""

    force: Vector
    turn_rate: Vector


class Reader(abc.ABC, Generic[T]):
    """A sensor that reads the vehicle, unless something is wrong with its content."""

    def __init__(self, noise: random.Random) -> None:
        self._noise = noise
        self._last: Optional[T] = None

    def read(self, pose: Pose, batch: Batch) -> T:
        """Return what the last sample of a batch says."""
        if batch.content == Content.NAN:
            return self._nothing()
        if batch.content != Content.STUCK or self._last is None:
            self._last = self._measure(pose)
        return self._last

    @abc.abstractmethod
    def _measure(self, pose: Pose) -> T: ...

    @abc.abstractmethod
    def _nothing(self) -> T: ...

    def _spread(self, size: float) -> float:
        return size * self._noise.uniform(-1.0, 1.0)


class RangeReader(Reader[float]):
    """The laser range finder: looks down from where it is mounted; in the units of its message."""

    def __init__(self, spec: LandingSpec, noise: random.Random) -> None:
        super().__init__(noise)
        self._spec = spec

    def read(self, pose: Pose, batch: Batch) -> float:
        """Return what the last sample of a batch says."""
        if batch.content == Content.READS:
            return round(batch.value / self._spec.scale, 6)
        return super().read(pose, batch)

    def _measure(self, pose: Pose) -> float:
        height, tilt = (pose.position_m[2], pose.tilt_rad) if pose.airborne else (pose.raised_m, 0.0)
        reading = (height + self._spec.mounting_height_m) / cos(tilt) + self._spread(_RANGE_NOISE_M)
        return round(min(max(0.0, reading), self._spec.max_range_m) / self._spec.scale, 6)

    def _nothing(self) -> float:
        return nan


class ImuReader(Reader[Inertial]):
    """The IMU of the state estimation, in its own frame."""

    def __init__(self, spec: StateEstimationSpec, noise: random.Random) -> None:
        super().__init__(noise)
        self._gravity, self._mounting = spec.gravity_m_s2, _rotation(*spec.imu_mounting_rpy_rad)

    def _measure(self, pose: Pose) -> Inertial:
        shake = _FLIGHT_NOISE_M_S2 if pose.airborne else _ACCELERATION_NOISE_M_S2
        # The nose is down by the tilt: up, in the vehicle frame (REP-103), points back and up.
        up = (-sin(pose.tilt_rad), 0.0, cos(pose.tilt_rad))
        force = tuple(round(part * self._gravity + self._spread(shake), 6) for part in up)
        turn = tuple(round(self._spread(_TURN_NOISE_RAD_S), 6) for _ in up)
        return Inertial(_turned_back(self._mounting, force), _turned_back(self._mounting, turn))

    def _nothing(self) -> Inertial:
        return Inertial(_NANS, _NANS)


class EstimateReader(Reader[Estimate]):
    """A good state estimator."""

    def _measure(self, pose: Pose) -> Estimate:
        half_yaw, half_tilt = pose.yaw_rad / 2, pose.tilt_rad / 2
        orientation = (
            -sin(half_yaw) * sin(half_tilt),
            cos(half_yaw) * sin(half_tilt),
            sin(half_yaw) * cos(half_tilt),
            cos(half_yaw) * cos(half_tilt),
        )
        x, y, z = (round(part + self._spread(_POSITION_NOISE_M), 6) for part in pose.position_m)
        return _estimate((x, y, z), orientation, pose.velocity_m_s)

    def _nothing(self) -> Estimate:
        return _estimate(_NANS, (nan, nan, nan, nan), _NANS)


def _estimate(position: Vector, orientation: Tuple[float, float, float, float], velocity: Vector) -> Estimate:
    return Estimate(
        position=position,
        orientation=orientation,
        velocity=velocity,
        position_variance=_POSITION_VARIANCE,
        orientation_variance=_ORIENTATION_VARIANCE,
    )


def _rotation(roll: float, pitch: float, yaw: float) -> _Matrix:
    """Return the matrix from a frame turned by roll, pitch, yaw (about fixed axes, as in URDF) to its parent."""
    sr, cr, sp, cp, sy, cy = sin(roll), cos(roll), sin(pitch), cos(pitch), sin(yaw), cos(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def _turned_back(matrix: _Matrix, vector: Tuple[float, ...]) -> Vector:
    """Return a vector of the parent frame in the turned frame: the transposed matrix times it."""
    x, y, z = (sum(matrix[row][column] * vector[row] for row in range(3)) for column in range(3))
    return (x, y, z)
