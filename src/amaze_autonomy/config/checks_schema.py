"""Schema of the checks in sensors.yaml besides the watchdog's: landing detection, state estimation, battery."""

from __future__ import annotations

from typing import Tuple

from amaze_autonomy.monitoring.specs import BatterySpec, EstimateSource, LandingSpec, RangeSource, StateEstimationSpec

from .binding import Row, group_of
from .components_schema import TOPIC, TOPIC_NAME
from .kinds import Choice, Flag, ListOf, Number, Text, Whole

__all__ = ["BATTERY", "LANDING_DETECTION", "STATE_ESTIMATION"]

_SMALL = Number(above=0.0, below=1.0)
_ANGLE = Number(above=0.0, maximum=90.0)
_COUNT = Whole(1, 10000)
_MAYBE_TOPIC = Text("the name of a topic, or empty", f"({TOPIC_NAME})?")


def _time(most: float = 600.0) -> Number:
    return Number(above=0.0, maximum=most)


# fmt: off
_LANDING_ROWS: Tuple[Row, ...] = (
    ("topic", TOPIC, "range to the ground", "laser range finder"),
    ("source", Choice(tuple(source.value for source in RangeSource)), "kind of message: sensor_msgs/Range, sensor_msgs/LaserScan, std_msgs/Float32, geometry_msgs/PoseStamped", ""),
    ("scale", Number(above=0.0, maximum=1000.0), "metres per unit of the message", "0.001 for millimetres"),
    ("mounting_height_m", Number(minimum=-10.0, maximum=10.0), "from the feet up to the sensor", "what it measures on the ground"),
    ("min_range_m", Number(minimum=0.0, maximum=100.0), "readings below are nothing seen, when the message does not say it", "blind zone of the sensor"),
    ("max_range_m", Number(above=0.0, maximum=1000.0), "readings from here on are nothing seen, when the message does not say it", "reach of the sensor"),
    ("sentinels", ListOf(Number(), "numbers"), "readings, in units of the message, that mean nothing seen", "what drivers send instead of infinity"),
    ("tilt_correction", Flag(), "the beam is fixed to the vehicle: multiply by the cosine of the tilt", ""),
    ("max_tilt_rad", _ANGLE, "beyond this tilt a range says nothing about the ground", "the beam looks elsewhere"),
    ("window_ns", _time(10), "time over which the median is taken", "single wrong readings"),
    ("min_samples", _COUNT, "good readings in the window that make a distance", "a median of fewer is chance"),
    ("age_limit_ns", _time(60), "longest time without a reading before the judgement is unknown", "unknown is not good"),
    ("ground_distance_m", Number(above=0.0, maximum=10.0), "feet nearer to the ground than this are on it", "noise and grass"),
    ("airborne_distance_m", Number(above=0.0, maximum=10.0), "feet farther from the ground than this are in the air", "between the two the last judgement stands"),
    ("settle_ns", _time(30), "how long the distance must agree before the judgement changes", "a bounce is not a takeoff"),
    ("landed_dwell_ns", _time(60), "how long on the ground, still, until it has landed", "a touch is not a landing"),
    ("max_vertical_speed_m_s", Number(above=0.0, maximum=10.0), "faster than this it has not landed", "noise of the estimate at rest"),
)
_STATE_ROWS: Tuple[Row, ...] = (
    ("topic", _MAYBE_TOPIC, "the estimate; empty: judged from the IMU alone", "what the controller flies by"),
    ("source", Choice(tuple(source.value for source in EstimateSource)), "kind of message: nav_msgs/Odometry, geometry_msgs/PoseStamped, geometry_msgs/PoseWithCovarianceStamped", ""),
    ("imu_topic", _MAYBE_TOPIC, "accelerometer whose gravity must agree; empty: none is looked at", "an estimator can be wrong and sure of itself"),
    ("imu_mounting_rpy_rad", ListOf(Number(minimum=-360.0, maximum=360.0), "roll, pitch, yaw", 3), "orientation of the IMU in the vehicle frame (x forward, y left, z up)", "as in the vehicle's URDF"),
    ("rate_hz", Number(minimum=0.1, maximum=10000.0), "estimates per second that are intended", "as set in the estimator"),
    ("tolerance_fraction", _SMALL, "deviation of the rate that is still as intended", ""),
    ("age_limit_ns", _time(60), "how old the last estimate and IMU sample may be", "unknown is not good"),
    ("window_ns", _time(60), "time over which gravity is averaged", "vibration and noise"),
    ("min_samples", _COUNT, "IMU samples in the window", ""),
    ("tilt_limit_rad", _ANGLE, "largest angle between the vehicle's z axis and the vertical", "a slope that it can take off from"),
    ("tilt_difference_limit_rad", _ANGLE, "largest angle between the vertical of the estimate and that of the IMU", "a wrong mounting or a diverged filter"),
    ("gravity_m_s2", Number(minimum=9.7, maximum=9.9), "what an accelerometer measures at rest", "9.780 at the equator, 9.832 at the poles"),
    ("gravity_tolerance_m_s2", Number(above=0.0, maximum=5.0), "its deviation that is still at rest", "bias of cheap accelerometers"),
    ("position_limit_m", Number(above=0.0, maximum=100000.0), "largest distance from the origin that a valid state has", "a diverged filter runs away"),
    ("position_deviation_limit_m", Number(above=0.0, maximum=1000.0), "largest standard deviation of the position", "from the covariance"),
    ("orientation_deviation_limit_rad", _ANGLE, "largest standard deviation of the orientation", "from the covariance"),
    ("require_covariance", Flag(), "an estimate without covariance is unknown; otherwise it is only warned of", "many estimators send none"),
    ("quaternion_tolerance", _SMALL, "how far the norm of the quaternion may be from 1", "not normalised: not an orientation"),
    ("still_ns", _time(60), "how long the vehicle must have been still", "somebody may carry it"),
    ("still_acceleration_m_s2", Number(above=0.0, maximum=10.0), "largest standard deviation of the acceleration at rest", "noise, propellers standing"),
    ("still_turn_rate_rad_s", Number(above=0.0, maximum=10.0), "largest mean turn rate at rest", "bias of the gyroscope"),
    ("still_drift_m", Number(above=0.0, maximum=10.0), "furthest that the estimated position may move meanwhile", "a drifting estimate flies away"),
    ("speed_limit_m_s", Number(above=0.0, maximum=10.0), "largest estimated speed on the ground", ""),
)
_BATTERY_ROWS: Tuple[Row, ...] = (
    ("age_limit_ns", _time(60), "how old the last level may be", "unknown is not good"),
    ("minimum_fraction", Number(minimum=0.0, maximum=1.0), "below this no mission starts, whatever it needs", "short missions are tempting"),
    ("cells", Whole(0, 24), "cells in series; 0: voltages are not looked at", "a wrong battery shows in its voltage"),
    ("cell_voltage_min_v", Number(above=0.0, maximum=10.0), "lowest voltage per cell at rest, whatever the level says", "levels are estimates, voltages are measured"),
    ("cell_voltage_max_v", Number(above=0.0, maximum=10.0), "highest voltage per cell that is believed", "a full cell has 4.2 V"),
)
# fmt: on

LANDING_DETECTION = group_of(LandingSpec, "landing detection", _LANDING_ROWS)
STATE_ESTIMATION = group_of(StateEstimationSpec, "check of the state estimation", _STATE_ROWS)
BATTERY = group_of(BatterySpec, "check of the battery before takeoff", _BATTERY_ROWS)
