"""Limits of the checks besides the watchdog's: landing detection, state estimation, battery. See `specs.py`."""

from __future__ import annotations

import enum
from array import array
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, pi, radians
from typing import NamedTuple, Tuple

from .errors import SpecError

# --- checked ----------------------------------------------------------------------------------------------------------
# Base of the specifications: values are checked when they are made, and an error names the field.


class Checked:
    """Checks that the specifications share; each raises a `SpecError` that names the field."""

    def _need(self, name: str, good: bool, expected: str) -> None:  # noqa: FBT001
        if not good:
            raise SpecError(getattr(self, "name", "") or type(self).__name__, name, getattr(self, name), expected)

    def _whole(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, type(value) is int and value > 0, "a whole number of nanoseconds above 0")

    def _count(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, type(value) is int and value > 0, "a whole number above 0")

    def _above_zero(self, *names: str) -> None:
        for name in names:
            self._need(name, is_number(getattr(self, name)) and getattr(self, name) > 0, "a number above 0")

    def _not_negative(self, *names: str) -> None:
        for name in names:
            self._need(name, is_number(getattr(self, name)) and getattr(self, name) >= 0, "a number, 0 or above")

    def _angle(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, is_number(value) and 0 < value <= pi / 2, "an angle above 0, at most pi/2 rad")


def is_number(value: object) -> bool:
    """Return True for a finite int or float; a bool is not a number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)


def is_command(value: object) -> bool:
    """Return True for a tuple of texts with a program in front."""
    return (
        isinstance(value, tuple) and len(value) > 0 and all(isinstance(part, str) for part in value) and bool(value[0])
    )


# --- preflight specs --------------------------------------------------------------------------------------------------


_S = 1_000_000_000
_AXES = 3


class RangeSource(enum.Enum):
    """What kind of message the distance to the ground comes from."""

    RANGE = "range"  # sensor_msgs/Range
    SCAN = "scan"  # sensor_msgs/LaserScan, nearest valid return
    FLOAT = "float"  # std_msgs/Float32
    POSE = "pose"  # geometry_msgs/PoseStamped, height z


class EstimateSource(enum.Enum):
    """What kind of message the state estimate comes from."""

    ODOMETRY = "odometry"
    POSE = "pose"
    POSE_WITH_COVARIANCE = "pose_with_covariance"


class RangeLimits(NamedTuple):
    """What of a reading is "nothing seen", in units of the message.

    A reading is mostly a float32, which holds 8.2 as 8.1999998: each limit is the lower one of the number itself and of
    its float32, and a sentinel counts as both, so that a reading of either width meets them.

    Args:
        least: readings below.
        most: readings from here on.
        sentinels: readings that are one of these.
    """

    least: float
    most: float
    sentinels: Tuple[float, ...]


def _float32(value: float) -> float:
    return array("f", [value])[0]


@dataclass(frozen=True)
class LandingSpec(Checked):
    """How the distance to the ground is measured, and when it means that the vehicle is on it or has landed.

    Args:
        topic: where the range comes from.
        source: kind of message.
        scale: metres per unit of the message, e.g. 0.001 for millimetres.
        mounting_height_m: from the feet up to the sensor: what it measures when the vehicle stands on the ground.
        min_range_m: readings below are "nothing seen", when the message does not say it itself; not for a pose.
        max_range_m: readings at or above are "nothing seen", when the message does not say it itself.
        sentinels: readings, in units of the message, that mean "nothing seen".
        tilt_correction: the beam is fixed to the vehicle; its reading is multiplied by the cosine of the tilt.
        max_tilt_rad: beyond this tilt a range says nothing about the ground.
        window_ns: over which the median is taken.
        min_samples: good readings in the window that make a distance.
        age_limit_ns: longest time without a reading, and without a tilt where one has been given.
        ground_distance_m: feet nearer to the ground than this are on it.
        airborne_distance_m: feet farther from the ground than this are in the air; between the two the last judgement
            stands.
        settle_ns: how long the distance must agree before the judgement changes between ground and air.
        landed_dwell_ns: how long on the ground, without vertical speed, until it has landed.
        max_vertical_speed_m_s: faster than this it has not landed.
    """

    topic: str = "/lrf/range"
    source: RangeSource = RangeSource.RANGE
    scale: float = 1.0
    mounting_height_m: float = 0.1
    min_range_m: float = 0.02
    max_range_m: float = 40.0
    sentinels: Tuple[float, ...] = (8190.0, 8191.0, 65535.0)
    tilt_correction: bool = True
    max_tilt_rad: float = radians(45.0)
    window_ns: int = 3 * _S // 10
    min_samples: int = 3
    age_limit_ns: int = _S // 2
    ground_distance_m: float = 0.1
    airborne_distance_m: float = 0.3
    settle_ns: int = _S // 2
    landed_dwell_ns: int = 2 * _S
    max_vertical_speed_m_s: float = 0.2

    def __post_init__(self) -> None:
        self._need("topic", bool(self.topic), "the name of a topic")
        self._need("source", isinstance(self.source, RangeSource), "one of range, scan, float, pose")
        self._need("scale", is_number(self.scale) and self.scale > 0, "a number above 0")
        self._need("mounting_height_m", is_number(self.mounting_height_m), "a number")
        self._not_negative("min_range_m")
        self._need(
            "max_range_m", is_number(self.max_range_m) and self.max_range_m > self.min_range_m, "above min_range_m"
        )
        self._angle("max_tilt_rad")
        self._whole("window_ns", "age_limit_ns", "settle_ns", "landed_dwell_ns")
        self._count("min_samples")
        self._above_zero("ground_distance_m", "airborne_distance_m", "max_vertical_speed_m_s")
        apart = self.airborne_distance_m > self.ground_distance_m
        self._need("airborne_distance_m", apart, "above ground_distance_m")

    @property
    def least_m(self) -> float:
        """Lowest reading that is one: a height has no blind zone, and may be a little below the ground."""
        return -self.ground_distance_m if self.source is RangeSource.POSE else self.min_range_m

    @cached_property
    def limits(self) -> RangeLimits:
        """What of a reading is nothing seen, in units of the message."""
        least, most = (min(told, _float32(told)) for told in (self.least_m / self.scale, self.max_range_m / self.scale))
        return RangeLimits(least, most, (*self.sentinels, *map(_float32, self.sentinels)))


@dataclass(frozen=True)
class StateEstimationSpec(Checked):
    """Check of the estimator's output before takeoff: are the states valid, does gravity point down?

    Args:
        topic: of the estimate; empty: judged from the IMU alone.
        source: kind of message that the estimate is.
        imu_topic: of an accelerometer whose gravity must agree; empty: none is looked at.
        imu_mounting_rpy_rad: roll, pitch, yaw of the IMU in the vehicle frame (REP-103, as in URDF).
        rate_hz: estimates per second that are intended.
        tolerance_fraction: deviation of the rate that is still as intended.
        age_limit_ns: how old the last estimate, and the last IMU sample, may be.
        window_ns: over which gravity is averaged.
        min_samples: of the IMU in the window.
        tilt_limit_rad: largest angle between the vehicle's z axis and the vertical, by the IMU and by the estimate.
        tilt_difference_limit_rad: largest angle between the vertical of the estimate and that of the IMU.
        gravity_m_s2: what an accelerometer measures at rest.
        gravity_tolerance_m_s2: its deviation that is still at rest.
        position_limit_m: largest distance from the origin that a valid state has.
        position_deviation_limit_m: largest standard deviation of the position, from the covariance.
        orientation_deviation_limit_rad: largest standard deviation of the orientation.
        require_covariance: an estimate without covariance is unknown; otherwise it is only warned of.
        quaternion_tolerance: how far the norm of the quaternion may be from 1.
        still_ns: how long the vehicle must have been still.
        still_acceleration_m_s2: largest standard deviation of the acceleration of a vehicle that stands still.
        still_turn_rate_rad_s: largest mean turn rate of one that stands still, by the gyroscope and by the estimate.
        still_drift_m: furthest that the estimated position may move meanwhile.
        speed_limit_m_s: largest estimated speed of a vehicle that stands on the ground.
    """

    topic: str = "/odometry"
    source: EstimateSource = EstimateSource.ODOMETRY
    imu_topic: str = "/px4/imu"
    imu_mounting_rpy_rad: Tuple[float, float, float] = (0.0, 0.0, 0.0)
    rate_hz: float = 30.0
    tolerance_fraction: float = 0.2
    age_limit_ns: int = _S // 2
    window_ns: int = 1 * _S
    min_samples: int = 10
    tilt_limit_rad: float = radians(10.0)
    tilt_difference_limit_rad: float = radians(5.0)
    gravity_m_s2: float = 9.80665
    gravity_tolerance_m_s2: float = 0.5
    position_limit_m: float = 1000.0
    position_deviation_limit_m: float = 0.5
    orientation_deviation_limit_rad: float = radians(10.0)
    require_covariance: bool = False
    quaternion_tolerance: float = 0.01
    still_ns: int = 2 * _S
    still_acceleration_m_s2: float = 0.5
    still_turn_rate_rad_s: float = 0.1
    still_drift_m: float = 0.1
    speed_limit_m_s: float = 0.3

    def __post_init__(self) -> None:
        self._need("topic", bool(self.topic or self.imu_topic), "the name of a topic when imu_topic is empty")
        self._need("source", isinstance(self.source, EstimateSource), "one of odometry, pose, pose_with_covariance")
        rpy = self.imu_mounting_rpy_rad
        good = isinstance(rpy, tuple) and len(rpy) == _AXES and all(is_number(angle) for angle in rpy)
        self._need("imu_mounting_rpy_rad", good, "three numbers: roll, pitch, yaw")
        self._above_zero("rate_hz", "tolerance_fraction", "position_limit_m", "speed_limit_m_s", "quaternion_tolerance")
        self._need("tolerance_fraction", self.tolerance_fraction < 1, "below 1")
        self._whole("age_limit_ns", "window_ns", "still_ns")
        self._count("min_samples")
        self._angle("tilt_limit_rad", "tilt_difference_limit_rad", "orientation_deviation_limit_rad")
        self._above_zero("gravity_m_s2", "gravity_tolerance_m_s2", "position_deviation_limit_m")
        self._need("gravity_tolerance_m_s2", self.gravity_tolerance_m_s2 < self.gravity_m_s2, "below gravity_m_s2")
        self._above_zero("still_acceleration_m_s2", "still_turn_rate_rad_s", "still_drift_m")


@dataclass(frozen=True)
class BatterySpec(Checked):
    """Check of the battery before takeoff. What happens to it in flight is in the engine's limits.

    Args:
        age_limit_ns: how old the last level may be.
        minimum_fraction: below this no mission starts, whatever it needs.
        cells: in series, of each pack; 0: voltages are not looked at.
        cell_voltage_min_v: lowest resting voltage per cell, whatever the level says.
        cell_voltage_max_v: highest voltage per cell that is believed.
    """

    age_limit_ns: int = 5 * _S
    minimum_fraction: float = 0.3
    cells: int = 6
    cell_voltage_min_v: float = 3.5
    cell_voltage_max_v: float = 4.35

    def __post_init__(self) -> None:
        self._whole("age_limit_ns")
        self._not_negative("minimum_fraction")
        self._need("minimum_fraction", self.minimum_fraction <= 1, "a fraction 0..1")
        self._need("cells", type(self.cells) is int and self.cells >= 0, "a whole number, 0 or above")
        self._above_zero("cell_voltage_min_v", "cell_voltage_max_v")
        above = self.cell_voltage_max_v > self.cell_voltage_min_v
        self._need("cell_voltage_max_v", above, "above cell_voltage_min_v")
