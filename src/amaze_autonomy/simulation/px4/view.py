"""What the simulated vehicle has to tell at one moment, as it measures it: with noise, and NED as on the wire.

The vehicle's own positions are ENU.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import Optional, Tuple

from .craft import Craft
from .geography import Place
from .health import Health, Sensors, Wrong, drift_m

__all__ = ["View"]

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
        transmitter: of the pilot.
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
    transmitter: bool
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
