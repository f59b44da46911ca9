"""What a telemetry log tells, as the messages that a bag would hold: fields as in ROS, made of MAVLink."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import Any, Optional

from ..autopilot.vehicle.vehicle import VehicleState

__all__ = ["Status", "imu", "status"]

_S = 1_000_000_000
_HEALTH = {None: 0, True: 1, False: 2}
_MILLI_G = 9.80665e-3
_SENSORS = ("gps", "imu", "magnetometer", "barometer")


@dataclass(frozen=True)
class _Stamp:
    sec: int
    nanosec: int


@dataclass(frozen=True)
class _Header:
    stamp: _Stamp


@dataclass(frozen=True)
class _Vector:
    x: float
    y: float
    z: float


@dataclass(frozen=True)
class _Imu:
    header: _Header
    linear_acceleration: _Vector
    angular_velocity: _Vector


@dataclass(frozen=True)
class Status:
    """Fields as in msg/AutopilotStatus."""

    header: _Header
    link_age: float
    armed_known: bool
    armed: bool
    landed: int
    mode: str
    pilot_in_control: bool
    failsafe: bool
    height_valid: bool
    height: float
    position_valid: bool
    position_x: float
    position_y: float
    vertical_speed: float
    horizontal_speed: float
    battery_fraction: float
    battery_voltage: float
    battery_age: float
    battery_critical: bool
    gps: int
    imu: int
    magnetometer: int
    barometer: int


def _header(t_ns: int) -> _Header:
    return _Header(_Stamp(t_ns // _S, t_ns % _S))


def imu(t_ns: int, message: Any) -> _Imu:
    """Return an IMU sample: forward, right, down becomes forward, left, up."""
    scale, turn = (1.0, 1.0) if message.get_type() == "HIGHRES_IMU" else (_MILLI_G, 1e-3)
    acceleration = _Vector(message.xacc * scale, -message.yacc * scale, -message.zacc * scale)
    rates = _Vector(message.xgyro * turn, -message.ygyro * turn, -message.zgyro * turn)
    return _Imu(_header(t_ns), acceleration, rates)


def _number(value: Optional[float]) -> float:
    return nan if value is None else float(value)


def status(t_ns: int, vehicle: VehicleState) -> Status:
    """Return what the autopilot node would say of a vehicle at a time."""
    said, health = vehicle.status(t_ns), vehicle.health(t_ns)
    return Status(
        header=_header(t_ns),
        link_age=_number(said.link_age_s),
        armed_known=said.armed is not None,
        armed=bool(said.armed),
        landed=said.landed.value,
        mode=said.mode,
        pilot_in_control=said.pilot_in_control,
        failsafe=said.failsafe,
        height_valid=said.height_m is not None,
        height=_number(said.height_m),
        position_valid=said.position_x_m is not None,
        position_x=_number(said.position_x_m),
        position_y=_number(said.position_y_m),
        vertical_speed=_number(said.vertical_speed_m_s),
        horizontal_speed=_number(said.horizontal_speed_m_s),
        battery_fraction=_number(said.battery_fraction),
        battery_voltage=_number(said.battery_voltage_v),
        battery_age=_number(said.battery_age_s),
        battery_critical=said.battery_critical,
        **{name: _HEALTH[health[name]] for name in _SENSORS},
    )
