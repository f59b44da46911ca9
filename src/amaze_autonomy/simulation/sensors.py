"""What the simulated sensors read of the vehicle, and what they publish: plain values, free of ROS."""

from __future__ import annotations

import abc
from math import cos, nan, sin
from typing import TYPE_CHECKING, Any, Callable, Dict, Generic, List, Mapping, NamedTuple, Optional, Tuple, TypeVar

from amaze_autonomy.monitoring.state_estimation import Estimate

from .peers.peer import Site
from .streams import Batch, Content, SampleKind
from .vehicle.vehicle import Pose

__all__ = ["Estimate", "EstimateReader", "ImuReader", "Inertial", "RangeReader", "Reader", "Sample", "Sender", "Vector"]

if TYPE_CHECKING:
    import random

    from amaze_autonomy.monitoring.preflight_specs import LandingSpec, StateEstimationSpec


# --- what they read ---------------------------------------------------------------------------------------------------


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


# --- what they publish ------------------------------------------------------------------------------------------------
# `Sample.fields` mirrors the message: a nested message is a dict, an array a tuple, an image's data bytes. The header
# is `stamp_ns` and `frame_id`; types without one (std_msgs/Float32) ignore them.


_WIDTH, _HEIGHT = 64, 48
_RAMP = bytes(range(256)) * ((_WIDTH * _HEIGHT) // 256 + 2)
_HOME_LATITUDE, _HOME_LONGITUDE, _HOME_ALTITUDE_M = 46.6167, 14.2650, 446.0
_DEGREES_PER_M = 1.0 / 111_320.0
_FIELD_T: Vector = (2.1e-5, 1.0e-6, -4.3e-5)
_PRESSURE_PA, _PRESSURE_PA_PER_M = 96_000.0, -11.4

Fields = Dict[str, Any]


class Sample(NamedTuple):
    """One message of a sensor.

    Args:
        topic: where it is published.
        type_name: ROS type, e.g. "sensor_msgs/Imu".
        stamp_ns: time of its header.
        frame_id: of its header.
        fields: the rest of the message.
    """

    topic: str
    type_name: str
    stamp_ns: int
    frame_id: str
    fields: Fields


class Sender:
    """Makes the messages of all streams of one world."""

    def __init__(self, site: Site) -> None:
        self._site = site
        settings = site.settings
        self._range = RangeReader(settings.landing, site.noise("sent range"))
        self._imu = ImuReader(settings.state_estimation, site.noise("sent imu"))
        self._estimate = EstimateReader(site.noise("sent estimate"))
        self._number: Dict[str, int] = {}
        self._makers: Mapping[str, Callable[[str, Pose, Batch], Fields]] = {
            SampleKind.IMAGE: self._image,
            SampleKind.IMU: self._inertial,
            SampleKind.RANGE: self._distance,
            SampleKind.SCAN: self._scan,
            SampleKind.FLOAT: self._float,
            SampleKind.POSE: self._pose,
            SampleKind.POSE_WITH_COVARIANCE: self._pose_with_covariance,
            SampleKind.ODOMETRY: self._odometry,
            SampleKind.FIX: self._fix,
            SampleKind.FIELD: self._field,
            SampleKind.PRESSURE: self._pressure,
        }

    def samples(self, topic: str, batch: Batch) -> List[Sample]:
        """Return every message of a batch."""
        stream = self._site.streams[topic]
        make = self._makers[stream.settings.kind]
        pose = self._site.vehicle.pose
        frame = stream.settings.component or "map"
        return [
            Sample(topic, stream.settings.kind, stamp, frame, make(topic, pose, batch))
            for stamp in stream.stamps(batch)
        ]

    def _image(self, topic: str, _: Pose, batch: Batch) -> Fields:
        if batch.content != Content.STUCK:
            self._number[topic] = self._number.get(topic, 0) + 1
        shift = self._number.get(topic, 0) % 256
        return {
            "height": _HEIGHT,
            "width": _WIDTH,
            "encoding": "mono8",
            "is_bigendian": 0,
            "step": _WIDTH,
            "data": _RAMP[shift : shift + _WIDTH * _HEIGHT],
        }

    def _inertial(self, _: str, pose: Pose, batch: Batch) -> Fields:
        reading: Inertial = self._imu.read(pose, batch)
        return {
            "orientation_covariance": (-1.0, *(0.0,) * 8),
            "angular_velocity": _xyz(reading.turn_rate),
            "angular_velocity_covariance": _diagonal((4e-6,) * 3),
            "linear_acceleration": _xyz(reading.force),
            "linear_acceleration_covariance": _diagonal((9e-4,) * 3),
        }

    def _distance(self, _: str, pose: Pose, batch: Batch) -> Fields:
        spec = self._site.settings.landing
        return {
            "radiation_type": 1,
            "field_of_view": 0.03,
            "min_range": spec.min_range_m / spec.scale,
            "max_range": spec.max_range_m / spec.scale,
            "range": self._range.read(pose, batch),
        }

    def _scan(self, _: str, pose: Pose, batch: Batch) -> Fields:
        spec = self._site.settings.landing
        return {
            "range_min": spec.min_range_m / spec.scale,
            "range_max": spec.max_range_m / spec.scale,
            "ranges": (self._range.read(pose, batch),),
        }

    def _float(self, topic: str, pose: Pose, batch: Batch) -> Fields:
        if topic == self._site.settings.landing.topic:
            return {"data": self._range.read(pose, batch)}
        if batch.content != Content.STUCK:
            self._number[topic] = self._number.get(topic, 0) + 1
        return {"data": nan if batch.content == Content.NAN else float(self._number.get(topic, 0) % 100)}

    def _pose(self, topic: str, pose: Pose, batch: Batch) -> Fields:
        estimate = self._estimate.read(pose, batch)
        if topic != self._site.settings.landing.topic:
            return {"pose": _pose_of(estimate)}
        height = self._range.read(pose, batch)
        return {"pose": _pose_of(estimate._replace(position=(estimate.position[0], estimate.position[1], height)))}

    def _pose_with_covariance(self, _: str, pose: Pose, batch: Batch) -> Fields:
        estimate = self._estimate.read(pose, batch)
        return {"pose": {"pose": _pose_of(estimate), "covariance": _covariance(estimate)}}

    def _odometry(self, _: str, pose: Pose, batch: Batch) -> Fields:
        estimate = self._estimate.read(pose, batch)
        return {
            "child_frame_id": "base_link",
            "pose": {"pose": _pose_of(estimate), "covariance": _covariance(estimate)},
            "twist": {"twist": {"linear": _xyz(estimate.velocity or (0.0, 0.0, 0.0))}},
        }

    def _fix(self, _: str, pose: Pose, batch: Batch) -> Fields:
        x, y, z = (nan, nan, nan) if batch.content == Content.NAN else pose.position_m
        return {
            "status": {"status": 0, "service": 1},
            "latitude": _HOME_LATITUDE + y * _DEGREES_PER_M,
            "longitude": _HOME_LONGITUDE + x * _DEGREES_PER_M * 1.456,
            "altitude": _HOME_ALTITUDE_M + z,
        }

    def _field(self, _: str, __: Pose, batch: Batch) -> Fields:
        return {"magnetic_field": _xyz((nan, nan, nan) if batch.content == Content.NAN else _FIELD_T)}

    def _pressure(self, _: str, pose: Pose, batch: Batch) -> Fields:
        height = nan if batch.content == Content.NAN else pose.position_m[2]
        return {"fluid_pressure": _PRESSURE_PA + _PRESSURE_PA_PER_M * height}


def _xyz(vector: Vector) -> Fields:
    return dict(zip("xyz", vector))


def _pose_of(estimate: Estimate) -> Fields:
    return {"position": _xyz(estimate.position), "orientation": dict(zip("xyzw", estimate.orientation))}


def _diagonal(values: Tuple[float, ...]) -> Tuple[float, ...]:
    """Return the square matrix with these values on its diagonal, row by row."""
    size = len(values)
    return tuple(values[row] if row == column else 0.0 for row in range(size) for column in range(size))


def _covariance(estimate: Estimate) -> Tuple[float, ...]:
    return _diagonal((estimate.position_variance or (0.0,) * 3) + (estimate.orientation_variance or (0.0,) * 3))
