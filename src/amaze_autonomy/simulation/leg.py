"""One straight move of the simulated vehicle: from here to there in a known time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

from amaze_autonomy.missions import FlightModel, Waypoint, leg_s

__all__ = ["Leg", "Vector", "climb", "descent", "flight"]

_S = 1_000_000_000

Vector = Tuple[float, float, float]


@dataclass(frozen=True)
class Leg:
    """A straight move at constant speed.

    Args:
        start: ENU position in m.
        end: ENU position in m.
        start_ns: when it begins.
        lasts_ns: how long it takes; at least 1.
    """

    start: Vector
    end: Vector
    start_ns: int
    lasts_ns: int

    @property
    def end_ns(self) -> int:
        """Time of the arrival."""
        return self.start_ns + self.lasts_ns

    @property
    def velocity(self) -> Vector:
        """Velocity in m/s."""
        x, y, z = ((end - start) / self.lasts_ns * _S for start, end in zip(self.start, self.end))
        return (x, y, z)

    def position(self, t_ns: int) -> Vector:
        """Return where it is at a time."""
        if t_ns >= self.end_ns:
            return self.end
        part = max(0, t_ns - self.start_ns) / self.lasts_ns
        x, y, z = (start + (end - start) * part for start, end in zip(self.start, self.end))
        return (x, y, z)


def flight(here: Vector, yaw_rad: float, target: Waypoint, model: FlightModel, t_ns: int) -> Leg:
    """Fly to a waypoint, in the time that the flight model gives for it."""
    start = Waypoint(here[0], here[1], here[2], yaw_rad, 0.0)
    return _leg(here, (target.x_m, target.y_m, target.z_m), leg_s(start, target, model), t_ns)


def climb(here: Vector, height_m: float, model: FlightModel, t_ns: int) -> Leg:
    """Climb straight up to a height, in the time that the flight model gives for it."""
    above = Waypoint(here[0], here[1], height_m, 0.0, 0.0)
    return flight(here, 0.0, above, model, t_ns)


def descent(here: Vector, speed_m_s: float, t_ns: int) -> Leg:
    """Go straight down to the ground."""
    return _leg(here, (here[0], here[1], 0.0), here[2] / speed_m_s, t_ns)


def _leg(start: Vector, end: Vector, seconds: float, t_ns: int) -> Leg:
    return Leg(start, end, t_ns, max(1, round(seconds * _S)))
