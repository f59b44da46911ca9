"""How far it is still, and how long it takes: along the waypoints that are left, and their holds."""

from __future__ import annotations

from typing import NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.missions import FlightModel, Waypoint, distance_m, leg_s

__all__ = ["Here", "remaining"]


class Here(NamedTuple):
    """Where the vehicle is, relative to the origin of the waypoints."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


def remaining(
    here: Optional[Here], waypoints: Sequence[Waypoint], model: FlightModel
) -> Tuple[Optional[float], Optional[float]]:
    """Return metres and seconds that are left; None where nobody knows where the vehicle is."""
    if here is None and waypoints:
        return None, None
    metres = seconds = 0.0
    last = None if here is None else Waypoint(*here, 0.0)
    for waypoint in waypoints:
        if last is not None:
            metres += distance_m(last, waypoint)
            seconds += leg_s(last, waypoint, model) + waypoint.hold_s
        last = waypoint
    return round(metres, 3), round(seconds, 3)
