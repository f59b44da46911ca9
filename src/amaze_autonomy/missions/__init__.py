"""Missions: waypoint files, whether they can be flown, how long that takes and what it costs. Pure."""

from __future__ import annotations

from .csv_table import Frame, Said, YawUnit
from .errors import WaypointError
from .fence import MOST_CORNERS, Circle, Fence, Polygon, check_fence, outlines, polygon_problem
from .plan import (
    Bounds,
    Controller,
    FlightEstimate,
    FlightModel,
    MissionPlan,
    PlannerSpec,
    Round,
    battery_needed_fraction,
    check_files,
    check_trajectory,
    climb_s,
    distance_m,
    estimate_flight,
    estimate_rounds,
    leg_s,
    total,
)
from .plan_file import SAME_M, SUFFIXES, parse_file
from .routes import GLOBAL_COLUMNS, Area, Route, RoutePoint, localize, localize_fence
from .waypoints import COLUMNS, Home, Place, Trajectory, Waypoint, joined, parse_trajectory

__all__ = [
    "COLUMNS",
    "GLOBAL_COLUMNS",
    "MOST_CORNERS",
    "SAME_M",
    "SUFFIXES",
    "Area",
    "Bounds",
    "Circle",
    "Controller",
    "Fence",
    "FlightEstimate",
    "FlightModel",
    "Frame",
    "Home",
    "MissionPlan",
    "Place",
    "PlannerSpec",
    "Polygon",
    "Round",
    "Route",
    "RoutePoint",
    "Said",
    "Trajectory",
    "Waypoint",
    "WaypointError",
    "YawUnit",
    "battery_needed_fraction",
    "check_fence",
    "check_files",
    "check_trajectory",
    "climb_s",
    "distance_m",
    "estimate_flight",
    "estimate_rounds",
    "joined",
    "leg_s",
    "localize",
    "localize_fence",
    "outlines",
    "parse_file",
    "parse_trajectory",
    "polygon_problem",
    "total",
]
