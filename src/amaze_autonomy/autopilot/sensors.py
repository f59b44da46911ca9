"""Health of the autopilot's sensors for the watchdog: from the bits of SYS_STATUS, and for GPS from GPS_RAW_INT.

What was seen: PX4 takes the bit of a lost GPS away from `present` and `enabled` 7.8 s after the loss, ArduPilot leaves
it healthy; GPS_RAW_INT says it at once (fix), or by silence, or by values that stand still.
"""

from __future__ import annotations

from math import inf
from typing import Any, Mapping, NamedTuple, Optional, Tuple

from .dialect import mavlink

__all__ = ["SENSORS", "Gps", "GpsLimits", "SystemStatus", "gps_health"]

_S = 1_000_000_000

GYRO = mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
ACCEL = mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
GPS = mavlink.MAV_SYS_STATUS_SENSOR_GPS
RC = mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK

SENSORS: Mapping[str, Tuple[int, ...]] = {
    "gps": (GPS,),
    "imu": (GYRO, ACCEL),
    "magnetometer": (mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG,),
    "barometer": (mavlink.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE,),
}


class SystemStatus:
    """The bits of SYS_STATUS, and which were ever present.

    Args:
        age_limit_ns: older than this they say nothing.
    """

    def __init__(self, age_limit_ns: int) -> None:
        self._age_limit_ns = age_limit_ns
        self._t_ns: Optional[int] = None
        self._present = self._enabled = self._health = self._ever = 0

    def add(self, t_ns: int, message: Any) -> None:
        """Take a SYS_STATUS."""
        self._t_ns = t_ns
        self._present = message.onboard_control_sensors_present
        self._enabled = message.onboard_control_sensors_enabled
        self._health = message.onboard_control_sensors_health
        self._ever |= self._present

    def fresh(self, t_ns: int) -> bool:
        """Return whether the bits say anything."""
        return self._t_ns is not None and t_ns - self._t_ns <= self._age_limit_ns

    def healthy(self, t_ns: int, bits: Tuple[int, ...]) -> Optional[bool]:
        """Return whether all of these work; a bit that has left `present` has failed, one that never was is unknown."""
        if not self.fresh(t_ns):
            return None
        if not all(self._ever & bit for bit in bits):
            return None
        good = self._present & self._enabled & self._health
        return all(good & bit for bit in bits)

    def rc(self, t_ns: int) -> Optional[bool]:
        """Return whether a transmitter is heard: without one PX4 has RC enabled and unhealthy, and never present."""
        if not self.fresh(t_ns) or not (self._present | self._enabled) & RC:
            return None
        return bool(self._present & self._enabled & self._health & RC)

    def prearm(self, t_ns: int) -> Optional[bool]:
        """Return the verdict of the pre-arm checks; PX4 has their bit in `health` only."""
        return bool(self._health & PREARM) if self.fresh(t_ns) else None

    @property
    def tells_prearm(self) -> bool:
        """Whether the autopilot says that it has pre-arm checks (ArduPilot does, PX4 does not)."""
        return bool(self._present & PREARM)


class GpsLimits(NamedTuple):
    """Limits of the GPS: least fix type (3: three-dimensional), longest silence, longest time with the same values."""

    min_fix_type: int = 3
    age_limit_ns: int = 2 * _S
    frozen_limit_ns: int = 3 * _S


class Gps:
    """The GPS receiver as GPS_RAW_INT shows it.

    Args:
        limits: see there.
    """

    def __init__(self, limits: GpsLimits) -> None:
        self._limits = limits
        self._t_ns: Optional[int] = None
        self._changed_ns = self._stepped_ns = 0
        self._time_usec: Optional[int] = None
        self._values: Tuple[int, ...] = ()
        self.fix_type = 0

    def add(self, t_ns: int, message: Any, *, at_rest: bool = False) -> None:
        """Take a GPS_RAW_INT; a receiver at rest may say the same again and again, with new stamps."""
        values = tuple(getattr(message, name) for name in ("lat", "lon", "alt", "eph", "epv", "vel", "cog"))
        if self._t_ns is None or at_rest or values != self._values:
            self._changed_ns = t_ns
        if self._t_ns is None or message.time_usec != self._time_usec:
            self._stepped_ns = t_ns
        self._t_ns, self._values, self._time_usec = t_ns, values, message.time_usec
        self.fix_type = int(message.fix_type)

    def problem(self, t_ns: int) -> Optional[str]:
        """Return what is wrong; empty: nothing; None: it was never heard."""
        if self._t_ns is None:
            return None
        age_ns = t_ns - self._t_ns
        if not age_ns <= self._limits.age_limit_ns:
            return f"silent for {age_ns / _S:.1f} s"
        if self.fix_type < self._limits.min_fix_type:
            return f"fix type {self.fix_type}, needed {self._limits.min_fix_type}"
        still_ns = self._t_ns - min(self._changed_ns, self._stepped_ns)
        if still_ns > self._limits.frozen_limit_ns:
            return f"frozen: the same values for {still_ns / _S:.1f} s"
        return ""

    def age_s(self, t_ns: int) -> float:
        """Return the time since the last GPS_RAW_INT, infinite when there was none."""
        return inf if self._t_ns is None else (t_ns - self._t_ns) / _S


def gps_health(*, system: Optional[bool], problem: Optional[str]) -> Optional[bool]:
    """Return the health of the GPS from its bit and from GPS_RAW_INT: bad when either says so."""
    if problem or system is False:
        return False
    return True if problem == "" else system
