"""What the simulated sensors read: range, IMU and state estimate, from the vehicle's present position and attitude."""

from __future__ import annotations

import random
from math import cos, nan, sin
from typing import NamedTuple, Tuple

from amaze_autonomy.monitoring.preflight_specs import LandingSpec, StateEstimationSpec

from .streams import Batch, Content
from .vehicle import Vehicle

__all__ = ["Estimate", "Inertial", "RangeReader", "read_estimate", "read_imu"]

_RANGE_NOISE_M = 0.005
_ACCELERATION_NOISE_M_S2 = 0.03
_FLIGHT_NOISE_M_S2 = 0.4
_TURN_NOISE_RAD_S = 0.002
_POSITION_NOISE_M = 0.003

Vector = Tuple[float, float, float]
Matrix = Tuple[Vector, Vector, Vector]


class Inertial(NamedTuple):
    """One sample of an IMU in its own frame: specific force in m/s^2, turn rate in rad/s."""

    force: Vector
    turn_rate: Vector


class Estimate(NamedTuple):
    """One estimate of the state: ENU position in m, velocity in m/s, orientation (x, y, z, w), variances."""

    position: Vector
    velocity: Vector
    orientation: Tuple[float, float, float, float]
    position_variance: float
    orientation_variance: float


class RangeReader:
    """The laser range finder: looks down, from where it is mounted."""

    def __init__(self, spec: LandingSpec, noise: random.Random) -> None:
        self._spec, self._noise, self._last = spec, noise, 0.0

    def read(self, vehicle: Vehicle, batch: Batch) -> float:
        """Return a reading in the units of its message."""
        if batch.content == Content.NAN:
            return nan
        if batch.content == Content.READS:
            return batch.value / self._spec.scale
        if batch.content != Content.STUCK:
            self._last = self._measure(vehicle)
        return self._last

    def _measure(self, vehicle: Vehicle) -> float:
        height = vehicle.height_m / cos(vehicle.tilt_rad) if vehicle.airborne else vehicle.flags.raised_m
        reading = height + self._spec.mounting_height_m + self._noise.uniform(-1.0, 1.0) * _RANGE_NOISE_M
        return round(min(max(0.0, reading), self._spec.max_range_m) / self._spec.scale, 6)


def read_imu(vehicle: Vehicle, spec: StateEstimationSpec, noise: random.Random, content: str) -> Inertial:
    """Return one sample of the IMU; a stuck one repeats itself without noise."""
    if content == Content.NAN:
        return Inertial((nan, nan, nan), (nan, nan, nan))
    shake = _FLIGHT_NOISE_M_S2 if vehicle.airborne else _ACCELERATION_NOISE_M_S2
    force = tuple(
        round(part * spec.gravity_m_s2 + shake * noise.uniform(-1.0, 1.0), 6) for part in _up_in_vehicle(vehicle)
    )
    turn = tuple(round(_TURN_NOISE_RAD_S * noise.uniform(-1.0, 1.0), 6) for _ in range(3))
    mounting = _rotation(*spec.imu_mounting_rpy_rad)
    return Inertial(_turned_back(mounting, force), _turned_back(mounting, turn))


def read_estimate(vehicle: Vehicle, noise: random.Random) -> Estimate:
    """Return what a good state estimator says of the vehicle."""
    half_yaw, half_tilt = vehicle.yaw_rad / 2, vehicle.tilt_rad / 2
    orientation = (
        -sin(half_yaw) * sin(half_tilt),
        cos(half_yaw) * sin(half_tilt),
        sin(half_yaw) * cos(half_tilt),
        cos(half_yaw) * cos(half_tilt),
    )
    x, y, z = (round(part + _POSITION_NOISE_M * noise.uniform(-1.0, 1.0), 6) for part in vehicle.position_m)
    return Estimate((x, y, z), vehicle.velocity_m_s, orientation, 0.0025, 0.0004)


def _up_in_vehicle(vehicle: Vehicle) -> Vector:
    """Return the direction up in the vehicle frame (REP-103) of a vehicle whose nose is down by its tilt."""
    return (-sin(vehicle.tilt_rad), 0.0, cos(vehicle.tilt_rad))


def _rotation(roll: float, pitch: float, yaw: float) -> Matrix:
    """Return the matrix from a frame turned by roll, pitch, yaw (about fixed axes, as in URDF) to its parent."""
    sr, cr, sp, cp, sy, cy = sin(roll), cos(roll), sin(pitch), cos(pitch), sin(yaw), cos(yaw)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def _turned_back(matrix: Matrix, vector: Tuple[float, ...]) -> Vector:
    """Return a vector of the parent frame in the turned frame: the transposed matrix times it."""
    x, y, z = (sum(matrix[row][column] * vector[row] for row in range(3)) for column in range(3))
    return (x, y, z)
