"""The messages that the simulated PX4 streams, made from a look at the vehicle: one function for each in the table."""

from __future__ import annotations

import math
import random
import zlib
from dataclasses import dataclass
from typing import Any, Callable, Dict, Mapping, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.autopilot.link.dialect import mission_current_message
from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.simulation.vehicle.flight import Mode

from .craft import Craft
from .health import BATTERY_LEVELS, Health, Sensors, Wrong, drift_m
from .settings import Place
from .wire import OFFBOARD, base_mode, current_mode, custom_mode, sequence

# --- view -------------------------------------------------------------------------------------------------------------
# What the simulated vehicle has to tell at one moment, as it measures it: with noise, and NED as on the wire.
#
# The vehicle's own positions are ENU.


_NOISE_M, _NOISE_M_S, _NOISE_RAD = 0.02, 0.02, 0.002


@dataclass(frozen=True)
class View:
    """What is to be told, at one moment.

    Args:
        t_ns: since the vehicle was switched on.
        unix_ns: time of the day.
        craft: the vehicle.
        health: of its sensors.
        sensors: words of SYS_STATUS.
        fraction: of the battery; None: unknown.
        voltage_v: of the battery; None: unknown.
        cells: of the battery.
        level: of the battery, from 0 (ok).
        ready: the pre-arm verdict.
        transmitter: of the pilot: on, or lost, and its receiver makes channels up; None: it has none.
        land_channel: of it, that its land switch moves; 0: none.
        home_shift: how far home is off what was home before the arming: north, east, up in m.
        has_home: a home position is known.
        range_finder: it has one.
        events: that were told so far.
        wrong: what it is wrong about.
        noise: of measurements.
    """

    t_ns: int
    unix_ns: int
    craft: Craft
    health: Health
    sensors: Sensors
    fraction: Optional[float]
    voltage_v: Optional[float]
    cells: int
    level: int
    ready: bool
    transmitter: Optional[bool]
    land_channel: int
    home_shift: Tuple[float, float, float]
    has_home: bool
    range_finder: bool
    events: int
    wrong: Wrong
    noise: random.Random

    @property
    def t_ms(self) -> int:
        """Milliseconds since the vehicle was switched on, as in MAVLink."""
        return self.t_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def t_us(self) -> int:
        """Microseconds since the vehicle was switched on."""
        return self.t_ns // 1000

    @property
    def position(self) -> Tuple[float, float, float]:
        """The estimate, NED."""
        east, north, up = (true + off for true, off in zip(self.craft.position_m, self.wrong.off_m))
        off_north, off_east = drift_m(self.health.blind_ns)
        return north + off_north + self.spread(), east + off_east + self.spread(), -up + self.spread()

    @property
    def velocity(self) -> Tuple[float, float, float]:
        """The estimate, NED."""
        east, north, up = self.craft.velocity_m_s
        return north + self.spread(_NOISE_M_S), east + self.spread(_NOISE_M_S), -up + self.spread(_NOISE_M_S)

    @property
    def attitude(self) -> Tuple[float, float, float]:
        """Roll, pitch and yaw in rad; the nose is down by the tilt."""
        yaw = math.remainder(math.pi / 2 - self.craft.yaw_rad, 2 * math.pi)
        return self.spread(_NOISE_RAD), -self.craft.tilt_rad + self.spread(_NOISE_RAD), yaw

    @property
    def heading_deg(self) -> float:
        """Degrees clockwise from north, 0..360."""
        return math.degrees(self.attitude[2]) % 360.0

    @property
    def home(self) -> Place:
        """Home as it is told: before the arming a little off, as on a vehicle that has been on for a while."""
        if self.craft.armed or not any(self.home_shift):
            return self.craft.home
        home, (north, east, up) = self.craft.home, self.home_shift
        east_m, north_m = self.craft.geography.local(home.latitude_deg, home.longitude_deg)
        moved = self.craft.geography.place(east_m + east, north_m + north, 0.0)
        return Place(moved.latitude_deg, moved.longitude_deg, home.altitude_m + up)

    def spread(self, size: float = _NOISE_M) -> float:
        """Return a small error of measurement."""
        return size * self.noise.uniform(-1.0, 1.0)

    def place(self) -> Place:
        """Return where the estimate is on the earth."""
        north, east, down = self.position
        return self.craft.geography.place(east, north, -down)


# --- motion -----------------------------------------------------------------------------------------------------------
# Messages of the simulated vehicle about where it is, how it moves and what it measures of that: one function each.


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


def _gps_global_origin(view: View) -> Any:
    origin = view.craft.geography.origin
    return mavlink.MAVLink_gps_global_origin_message(origin.lat, origin.lon, origin.alt_mm, view.t_us)


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
    "GPS_GLOBAL_ORIGIN": _gps_global_origin,
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


# --- telemetry --------------------------------------------------------------------------------------------------------


_UNKNOWN_16 = 0xFFFF
_CHANNELS, _MOST_CHANNELS = 8, 18  # of a transmitter, of RC_CHANNELS
_CHARGE = dict(
    zip(
        BATTERY_LEVELS,
        (
            mavlink.MAV_BATTERY_CHARGE_STATE_OK,
            mavlink.MAV_BATTERY_CHARGE_STATE_LOW,
            mavlink.MAV_BATTERY_CHARGE_STATE_CRITICAL,
            mavlink.MAV_BATTERY_CHARGE_STATE_EMERGENCY,
        ),
    )
)
_LANDED = {
    VehicleLanded.UNKNOWN: mavlink.MAV_LANDED_STATE_UNDEFINED,
    VehicleLanded.ON_GROUND: mavlink.MAV_LANDED_STATE_ON_GROUND,
    VehicleLanded.TAKING_OFF: mavlink.MAV_LANDED_STATE_TAKEOFF,
    VehicleLanded.IN_AIR: mavlink.MAV_LANDED_STATE_IN_AIR,
    VehicleLanded.LANDING: mavlink.MAV_LANDED_STATE_LANDING,
}

_Maker = Callable[[View], Any]


def _heartbeat(view: View) -> Any:
    craft = view.craft
    if craft.armed:
        status = mavlink.MAV_STATE_CRITICAL if craft.failsafe else mavlink.MAV_STATE_ACTIVE
    else:
        status = mavlink.MAV_STATE_STANDBY if view.ready else mavlink.MAV_STATE_UNINIT
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_AUTOPILOT_PX4,
        base_mode(craft.mode, armed=craft.armed),
        custom_mode(craft.mode),
        status,
        3,
    )


def _current_mode(view: View) -> Any:
    return current_mode(custom_mode(view.craft.mode), custom_mode(view.craft.intended))


def _sys_status(view: View) -> Any:
    known = view.fraction is not None and view.voltage_v is not None
    return mavlink.MAVLink_sys_status_message(
        view.sensors.present,
        view.sensors.enabled,
        view.sensors.health,
        200,
        round((view.voltage_v or 0.0) * 1000) if known else _UNKNOWN_16,
        round(_current_a(view) * 100) if known else -1,
        round((view.fraction or 0.0) * 100) if known else -1,
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def _battery_status(view: View) -> Any:
    known = view.fraction is not None and view.voltage_v is not None
    cell = round((view.voltage_v or 0.0) / view.cells * 1000) if known else _UNKNOWN_16
    volts = [cell] * min(10, view.cells) + [_UNKNOWN_16] * (10 - min(10, view.cells))
    return mavlink.MAVLink_battery_status_message(
        0,
        mavlink.MAV_BATTERY_FUNCTION_ALL,
        mavlink.MAV_BATTERY_TYPE_LIPO,
        32767,
        volts,
        round(_current_a(view) * 100) if known else -1,
        -1,
        -1,
        round((view.fraction or 0.0) * 100) if known else -1,
        0,
        _CHARGE[BATTERY_LEVELS[view.level]] if known else mavlink.MAV_BATTERY_CHARGE_STATE_UNDEFINED,
    )


def _current_a(view: View) -> float:
    return 18.0 if view.craft.airborne else 1.0


def _extended_sys_state(view: View) -> Any:
    landed = view.craft.landed if view.wrong.landed is None else view.wrong.landed
    return mavlink.MAVLink_extended_sys_state_message(0, _LANDED[landed])


def _mission_current(view: View) -> Any:
    total = max(0, len(view.craft.items) - view.craft.home_items) or _UNKNOWN_16
    items = view.craft.items
    tells = items and not view.craft.home_items  # a PX4, not an ArduPilot
    mission_id = zlib.crc32(repr(items).encode()) if tells else 0
    return mission_current_message(view.craft.current, total, 0, 0, mission_id, 0, 0)


def _servo_output_raw(view: View) -> Any:
    turns = [1500 if view.craft.airborne else 1100 if view.craft.armed else 900] * 4
    return mavlink.MAVLink_servo_output_raw_message(view.t_us & 0xFFFFFFFF, 0, *turns, 900, 900, 900, 900)


def _rc_channels(view: View) -> Any:
    if view.transmitter is None:
        return None
    count = max(_CHANNELS, view.land_channel)
    widths = [1500, 1500, 1500 if view.craft.airborne else 1100, 1500, *[1000] * (count - 4)]
    if view.land_channel:
        thrown = view.craft.flags.land_switch or not view.transmitter  # a receiver that was taught nothing better
        widths[view.land_channel - 1] = 2000 if thrown else 1000
    unused = [_UNKNOWN_16] * (_MOST_CHANNELS - count)
    return mavlink.MAVLink_rc_channels_message(view.t_ms, count, *widths, *unused, 90)


def _system_time(view: View) -> Any:
    return mavlink.MAVLink_system_time_message(view.unix_ns // 1000, view.t_ms)


def _timesync(view: View) -> Any:
    return mavlink.MAVLink_timesync_message(0, view.t_ns)


def _ping(view: View) -> Any:
    return mavlink.MAVLink_ping_message(view.t_us, view.t_ms // 1000, 0, 0)


def _current_event_sequence(view: View) -> Any:
    return sequence(view.events)


MESSAGES: Mapping[str, _Maker] = {
    **MOTION,
    "HEARTBEAT": _heartbeat,
    "BATTERY_STATUS": _battery_status,
    "CURRENT_EVENT_SEQUENCE": _current_event_sequence,
    "CURRENT_MODE": _current_mode,
    "EXTENDED_SYS_STATE": _extended_sys_state,
    "MISSION_CURRENT": _mission_current,
    "PING": _ping,
    "RC_CHANNELS": _rc_channels,
    "SERVO_OUTPUT_RAW": _servo_output_raw,
    "SYSTEM_TIME": _system_time,
    "SYS_STATUS": _sys_status,
    "TIMESYNC": _timesync,
}


def make(name: str, view: View) -> Any:
    """Make a message; None when there is nothing to tell."""
    maker: Optional[_Maker] = MESSAGES.get(name)
    return None if maker is None else maker(view)


def numbers() -> Dict[int, str]:
    """Return message number -> name of all that can be asked for."""
    known = {getattr(mavlink, f"MAVLINK_MSG_ID_{name}", 0): name for name in MESSAGES}
    return {**known, 0: "HEARTBEAT", 411: "CURRENT_EVENT_SEQUENCE", 436: "CURRENT_MODE"}
