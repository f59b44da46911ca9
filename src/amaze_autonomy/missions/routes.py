"""Waypoint files whose places are on the earth, and how they become local ones.

    latitude,longitude,relative_altitude,yaw_deg,holdtime  degrees, metres above where this file takes off,
    47.3977418,8.5455939,5.0,0.0,1.0                       yaw from east and seconds as in `waypoints.py`

A route is what such a file or a plan (`plan_file.py`) says. It can be checked and flown once its home is known: the
place of the mission's first takeoff.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

from .csv_table import YAW_COLUMNS, Layout, Line, Row, Said, YawUnit, lines_of, read_table, said_in, yaw_of, yaw_unit_of
from .errors import WaypointError
from .fence import Circle, Fence, Point, Polygon, polygon_problem
from .waypoints import Home, Names, Place, Trajectory, Waypoint

GLOBAL_COLUMNS = ("latitude", "longitude", "relative_altitude", "yaw", "holdtime")
_NAMES = Names("latitude,longitude", "relative_altitude", "latitude,longitude,relative_altitude", "holdtime")
_LAYOUT = Layout(
    GLOBAL_COLUMNS,
    ("holdtime",),
    "must be the columns latitude,longitude,relative_altitude,yaw_deg,holdtime, separated by commas (degrees, metres "
    "above the takeoff; or yaw_rad, in radians)",
)
_REACH = {"latitude": 90.0, "longitude": 180.0}
_STILL_M = 0.1


@dataclass(frozen=True)
class RoutePoint:
    """A place to fly to.

    Args:
        place: on the earth; None: where the file takes off.
        height_m: above the takeoff.
        yaw_rad: counter-clockwise from east; None: along the way there.
        hold_s: how long to stay.
        line: of the file.
        takeoff: it is the end of a climb from the ground, and no place to go to for a file that begins in the air.
    """

    place: Optional[Place]
    height_m: float
    yaw_rad: Optional[float]
    hold_s: float
    line: int
    takeoff: bool = False


@dataclass(frozen=True)
class Area:
    """A part of a fence on the earth: a polygon, or a circle around its only corner.

    Args:
        corners: three or more, or the centre.
        radius_m: of a circle, else None.
        stay_in: else it must not be entered.
        line: of the file.
    """

    corners: Tuple[Place, ...]
    radius_m: Optional[float]
    stay_in: bool
    line: int


@dataclass(frozen=True)
class Route:
    """What a file in latitude and longitude says.

    Args:
        file: its name.
        points: at least one.
        names: of its columns.
        home: that it was planned from, where it says one.
        fence: its areas.
        home_line: where it says its home.
    """

    file: str
    points: Tuple[RoutePoint, ...]
    names: Names = _NAMES
    home: Optional[Home] = None
    fence: Tuple[Area, ...] = ()
    home_line: int = 0


def is_global(lines: Sequence[Line]) -> bool:
    """Return whether the header of a table speaks of latitude and longitude."""
    header = [column.strip() for column in lines[0][1].lstrip("\ufeff").split(",")] if lines else []
    return any(column in GLOBAL_COLUMNS[:3] for column in header)


def parse_route(text: str, file: str, mission: Said = Said()) -> Route:  # noqa: B008 - it cannot change
    """Read a whole waypoint file in latitude and longitude; `mission` says the unit of its yaw, if nothing in it does.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    lines = lines_of(text)
    columns, rows = read_table(file, lines, _LAYOUT)
    said, header = said_in(file, text), lines[0][0]
    if said.frame is not None:
        right = "must be left out: latitude and longitude are a frame"
        raise WaypointError(file, header, "frame", f"is {said.frame.value}", right)
    column = next(column for column in columns if column in YAW_COLUMNS)
    unit = yaw_unit_of(file, header, column, said, mission)
    return Route(file, tuple(_point(file, row, unit) for row in rows))


def _point(file: str, row: Row, unit: YawUnit) -> RoutePoint:
    for column, reach in _REACH.items():
        if abs(row.values[column]) > reach:
            right = f"must be within {reach:g} degrees"
            raise WaypointError(file, row.line, column, f"is {row.values[column]:g}", right)
    place = Place(row.values["latitude"], row.values["longitude"])
    hold_s = row.values.get("holdtime", 0.0)
    return RoutePoint(place, row.values["relative_altitude"], yaw_of(file, row, unit), hold_s, row.line)


def localize(route: Route, home: Home, last: Optional[Waypoint] = None, *, in_flight: bool = False) -> Trajectory:
    """Return the waypoints of a route in metres around home.

    Args:
        route: what the file says.
        home: origin of the metres.
        last: waypoint of the file before, where this one begins; None: it begins at home.
        in_flight: it begins there in the air, and its takeoff is left out.

    Raises:
        WaypointError: nothing is left of it.
    """
    start: Point = (0.0, 0.0) if last is None else (last.x_m, last.y_m)
    points = tuple(point for point in route.points if not (in_flight and point.takeoff))
    if not points:
        wrong = "has nothing but a takeoff, and begins in the air (touchdown_between_files: false)"
        raise WaypointError(route.file, route.points[0].line, "", wrong, "must have a waypoint")
    local = [start if point.place is None else home.to_local(point.place) for point in points]
    yaws = _yaws(points, (start, *local), None if last is None else last.yaw_rad)
    waypoints = tuple(
        Waypoint(*here, point.height_m, yaw, point.hold_s, point.line) for point, here, yaw in zip(points, local, yaws)
    )
    places = tuple(home.to_global(*start) if point.place is None else point.place for point in points)
    return Trajectory(route.file, waypoints, "yaw", route.names, places)


def _yaws(points: Sequence[RoutePoint], way: Sequence[Point], yaw: Optional[float]) -> Sequence[float]:
    """Return the yaw at each point: its own, else along the way there, else the last one.

    A takeoff without one, and what comes before any, has that of the point after it: nothing turns for it.

    Args:
        points: in their order.
        way: where it begins, and the points.
        yaw: at the beginning; None: unknown.
    """
    found: List[Optional[float]] = []
    for point, before, here in zip(points, way, way[1:]):
        if point.yaw_rad is not None:
            yaw = point.yaw_rad
        elif not point.takeoff and math.dist(before, here) >= _STILL_M:
            yaw = math.atan2(here[1] - before[1], here[0] - before[0])
        found.append(None if point.takeoff and point.yaw_rad is None else yaw)
    yaws: List[float] = []
    after = yaw or 0.0
    for each in reversed(found):
        after = after if each is None else each
        yaws.append(after)
    return yaws[::-1]


def localize_fence(route: Route, home: Home) -> Fence:
    """Return the fence of a route in metres around home.

    Raises:
        WaypointError: a polygon is none.
    """
    polygons = [
        _polygon(route.file, area, tuple(home.to_local(corner) for corner in area.corners))
        for area in route.fence
        if area.radius_m is None
    ]
    circles = [
        Circle(home.to_local(area.corners[0]), area.radius_m, area.stay_in)
        for area in route.fence
        if area.radius_m is not None
    ]
    return Fence(tuple(polygons), tuple(circles))


def _polygon(file: str, area: Area, corners: Tuple[Point, ...]) -> Polygon:
    problem = polygon_problem(corners)
    if problem:
        wrong, right = problem.split("; ")
        raise WaypointError(file, area.line, "polygon", wrong, right)
    return Polygon(corners, area.stay_in)
