"""Missions: waypoint files, whether they can be flown, how long that takes and what it costs. Pure."""

from __future__ import annotations

from .errors import WaypointError
from .flight_model import Bounds, FlightEstimate, FlightModel, check_trajectory, distance_m, estimate_flight, leg_s
from .plan import MissionPlan, Round, battery_needed_fraction, check_files, estimate_rounds, total
from .waypoints import COLUMNS, Trajectory, Waypoint, parse_trajectory

__all__ = [
    "COLUMNS",
    "Bounds",
    "FlightEstimate",
    "FlightModel",
    "MissionPlan",
    "Round",
    "Trajectory",
    "Waypoint",
    "WaypointError",
    "battery_needed_fraction",
    "check_files",
    "check_trajectory",
    "distance_m",
    "estimate_flight",
    "estimate_rounds",
    "leg_s",
    "parse_trajectory",
    "total",
]
