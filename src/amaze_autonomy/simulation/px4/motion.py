"""Messages of the simulated vehicle about where it is, how it moves and what it measures of that: one function each."""

from __future__ import annotations

import math
from typing import Any, Callable, Mapping, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.simulation.flight import Mode

from .modes import OFFBOARD
from .view import View

__all__ = ["MOTION"]

_GRAVITY = 9.80665
_ACCURACY_M, _LOST_ACCURACY_M = 0.3, 60.0
_RANGE_MIN_M, _RANGE_MAX_M, _RANGE_MOUNT_M = 0.1, 40.0, 0.1
_NAN = math.nan


def _gps_raw_int(view: View) -> Any:
    east, north, up = view.craft.position_m
    place = view.craft.geography.place(east + view.spread(0.2), north + view.spread(0.2), up + view.spread(0.3))
    fix = view.health.has_fix
    speed = math.sqrt(sum(part * part for part in view.craft.velocity_m_s[:2]))
    error = 70 if fix else 10_000
    return mavlink.MAVLink_gps_raw_int_message(
        view.t_us,
        mavlink.GPS_FIX_TYPE_3D_FIX if fix else mavlink.GPS_FIX_TYPE_NO_GPS,
        place.lat,
        place.lon,
        place.alt_mm,
        error,
        110 if fix else 10_000,
        round(speed * 100),
        round(view.heading_deg * 100) % 36_000,
        10 if fix else 0,
        place.alt_mm,
        900 if fix else 100_000,
        1780 if fix else 100_000,
        400,
    )


def _global_position_int(view: View) -> Any:
    place = view.place()
    north, east, down = view.velocity
    return mavlink.MAVLink_global_position_int_message(
        view.t_ms,
        place.lat,
        place.lon,
        place.alt_mm,
        place.alt_mm - view.home.alt_mm,
        round(north * 100),
        round(east * 100),
        round(down * 100),
        round(view.heading_deg * 100) % 36_000,
    )


def _local_position_ned(view: View) -> Any:
    return mavlink.MAVLink_local_position_ned_message(view.t_ms, *view.position, *view.velocity)


def _odometry(view: View) -> Any:
    nothing = [_NAN] * 20
    return mavlink.MAVLink_odometry_message(
        view.t_us,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.MAV_FRAME_LOCAL_NED,
        *view.position,
        _quaternion(view),
        *view.velocity,
        0.0, 0.0, 0.0,
        [0.04, *nothing],
        [0.01, *nothing],
        0,
        mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    )  # fmt: skip


def _quaternion(view: View) -> Tuple[float, float, float, float]:
    roll, pitch, yaw = (angle / 2 for angle in view.attitude)
    sr, cr, sp, cp, sy, cy = (f(a) for a in (roll, pitch, yaw) for f in (math.sin, math.cos))
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def _attitude(view: View) -> Any:
    return mavlink.MAVLink_attitude_message(view.t_ms, *view.attitude, 0.0, 0.0, 0.0)


def _attitude_quaternion(view: View) -> Any:
    return mavlink.MAVLink_attitude_quaternion_message(view.t_ms, *_quaternion(view), 0.0, 0.0, 0.0)


def _attitude_target(view: View) -> Any:
    thrust = 0.5 if view.craft.airborne else 0.0
    return mavlink.MAVLink_attitude_target_message(view.t_ms, 0, _quaternion(view), 0.0, 0.0, 0.0, thrust)


def _altitude(view: View) -> Any:
    up = -view.position[2]
    amsl = view.craft.geography.origin.altitude_m + up
    return mavlink.MAVLink_altitude_message(view.t_us, amsl, amsl, up, amsl - view.home.altitude_m, 0.0, max(0.0, up))


def _vfr_hud(view: View) -> Any:
    north, east, down = view.velocity
    speed = math.sqrt(north * north + east * east)
    throttle = 50 if view.craft.airborne else 0
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, round(view.heading_deg), throttle, view.place().altitude_m, -down
    )


def _highres_imu(view: View) -> Any:
    tilt = view.craft.tilt_rad
    return mavlink.MAVLink_highres_imu_message(
        view.t_us,
        _GRAVITY * -math.sin(tilt) + view.spread(0.1),
        view.spread(0.1),
        -_GRAVITY * math.cos(tilt) + view.spread(0.1),
        view.spread(0.01), view.spread(0.01), view.spread(0.01),
        0.21, 0.0, 0.42,
        955.8 - 0.11 * view.craft.height_m, 0.0, view.place().altitude_m, 15.0,
        63,
    )  # fmt: skip


def _scaled_pressure(view: View) -> Any:
    return mavlink.MAVLink_scaled_pressure_message(view.t_ms, 955.8 - 0.11 * view.craft.height_m, 0.0, 1182)


def _distance_sensor(view: View) -> Any:
    if not view.range_finder:
        return None
    craft = view.craft
    seen = (craft.height_m if craft.airborne else craft.flags.raised_m) + _RANGE_MOUNT_M + view.spread(0.01)
    inside = _RANGE_MIN_M <= seen <= _RANGE_MAX_M
    return mavlink.MAVLink_distance_sensor_message(
        view.t_ms,
        round(_RANGE_MIN_M * 100),
        round(_RANGE_MAX_M * 100),
        max(0, round(min(seen, _RANGE_MAX_M) * 100)),
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        0,
        mavlink.MAV_SENSOR_ROTATION_PITCH_270,
        0,
        signal_quality=100 if inside else 1,
    )


def _estimator_status(view: View) -> Any:
    error = _LOST_ACCURACY_M if view.health.position_lost else _ACCURACY_M
    flags = view.health.estimator_flags
    return mavlink.MAVLink_estimator_status_message(
        view.t_us, flags, 0.1, 0.1, 0.05, 0.1, 0.01, _NAN, error, _ACCURACY_M
    )


def _home_position(view: View) -> Any:
    if not view.has_home:
        return None
    home = view.home
    east, north = view.craft.geography.local(home.latitude_deg, home.longitude_deg)
    down = view.craft.geography.origin.altitude_m - home.altitude_m
    return mavlink.MAVLink_home_position_message(
        home.lat, home.lon, home.alt_mm, north, east, down, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, view.t_us
    )


def _position_target_local_ned(view: View) -> Any:
    goal = view.craft.set_point if view.craft.mode == OFFBOARD else None
    place = goal.position_m if goal is not None else None
    north, east, down = (place[1], place[0], -place[2]) if place is not None else (_NAN, _NAN, _NAN)
    return mavlink.MAVLink_position_target_local_ned_message(
        view.t_ms, mavlink.MAV_FRAME_LOCAL_NED, 0, north, east, down, _NAN, _NAN, _NAN, 0.0, 0.0, 0.0, _NAN, 0.0
    )


def _position_target_global_int(view: View) -> Any:
    craft = view.craft
    if craft.mode != Mode.MISSION or not craft.current < len(craft.items):
        return None
    item = craft.items[craft.current]
    return mavlink.MAVLink_position_target_global_int_message(
        view.t_ms, mavlink.MAV_FRAME_GLOBAL_INT, 0, item.x, item.y, item.z, _NAN, _NAN, _NAN, 0.0, 0.0, 0.0, _NAN, 0.0
    )


def _vibration(view: View) -> Any:
    return mavlink.MAVLink_vibration_message(view.t_us, 0.0, 0.01, 0.1, 0, 0, 0)


MOTION: Mapping[str, Callable[[View], Any]] = {
    "ALTITUDE": _altitude,
    "ATTITUDE": _attitude,
    "ATTITUDE_QUATERNION": _attitude_quaternion,
    "ATTITUDE_TARGET": _attitude_target,
    "DISTANCE_SENSOR": _distance_sensor,
    "ESTIMATOR_STATUS": _estimator_status,
    "GLOBAL_POSITION_INT": _global_position_int,
    "GPS_RAW_INT": _gps_raw_int,
    "HIGHRES_IMU": _highres_imu,
    "HOME_POSITION": _home_position,
    "LOCAL_POSITION_NED": _local_position_ned,
    "ODOMETRY": _odometry,
    "POSITION_TARGET_GLOBAL_INT": _position_target_global_int,
    "POSITION_TARGET_LOCAL_NED": _position_target_local_ned,
    "SCALED_PRESSURE": _scaled_pressure,
    "VFR_HUD": _vfr_hud,
    "VIBRATION": _vibration,
}
