"""The area that a flight must not leave, and those that it must not enter: polygons and circles, in local metres.

With several areas to stay in, each leg lies in one of them as a whole; to touch a border is to cross it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, List, Sequence, Tuple, Union

from .waypoints import Trajectory

Point = Tuple[float, float]
_LEAST_CORNERS = 3
MOST_CORNERS = 500
"""Of a fence: each is compared with every other, and with every leg; more would hold up every node that starts."""
_LEAST_AREA_M2 = 1.0


@dataclass(frozen=True)
class Polygon:
    """An area; the last corner is joined to the first.

    Args:
        corners: metres east and north.
        stay_in: else it must not be entered.
    """

    corners: Tuple[Point, ...]
    stay_in: bool = True

    def contains(self, start: Point, end: Point) -> bool:
        """Return whether a straight leg lies inside as a whole."""
        return self._inside(start) and not self._touches(start, end)

    def meets(self, start: Point, end: Point) -> bool:
        """Return whether any part of a leg lies inside or on the border."""
        return self._inside(start) or self._touches(start, end)

    def _inside(self, point: Point) -> bool:
        x, y = point
        inside = False
        for (x1, y1), (x2, y2) in self._edges():
            if (y1 > y) != (y2 > y) and x < x1 + (y - y1) * (x2 - x1) / (y2 - y1):
                inside = not inside
        return inside

    def _touches(self, start: Point, end: Point) -> bool:
        return any(_meet(start, end, one, other) for one, other in self._edges())

    def _edges(self) -> Sequence[Tuple[Point, Point]]:
        return tuple(zip(self.corners, (*self.corners[1:], self.corners[0])))


@dataclass(frozen=True)
class Circle:
    """A round area; `stay_in` as for a polygon."""

    centre: Point
    radius_m: float
    stay_in: bool = True

    def contains(self, start: Point, end: Point) -> bool:
        """Return whether a straight leg lies inside as a whole."""
        return max(math.dist(self.centre, start), math.dist(self.centre, end)) < self.radius_m

    def meets(self, start: Point, end: Point) -> bool:
        """Return whether any part of a leg lies inside or on the border."""
        return _distance(self.centre, start, end) <= self.radius_m


@dataclass(frozen=True)
class Fence:
    """Areas to stay in and areas to stay out of; without any, everywhere is good."""

    polygons: Tuple[Polygon, ...] = ()
    circles: Tuple[Circle, ...] = ()

    def problem(self, start: Point, end: Point) -> str:
        """Return what is wrong with a straight leg; empty when it may be flown."""
        areas: Tuple[Union[Polygon, Circle], ...] = (*self.polygons, *self.circles)
        allowed = [area for area in areas if area.stay_in]
        if allowed and not any(area.contains(start, end) for area in allowed):
            return "leaves the fence on the way there"
        if any(area.meets(start, end) for area in areas if not area.stay_in):
            return "enters an excluded area on the way there"
        return ""


def outlines(fences: Sequence[Fence]) -> Dict[str, List[Dict[str, Any]]]:
    """Return what is drawn of fences, as plain values: polygons under "fences", circles; `in` is where to stay."""
    return {
        "fences": [
            {"in": area.stay_in, "corners": [list(corner) for corner in area.corners]}
            for fence in fences
            for area in fence.polygons
        ],
        "circles": [
            {"in": area.stay_in, "centre": list(area.centre), "radius": area.radius_m}
            for fence in fences
            for area in fence.circles
        ],
    }


def _cross(one: Point, other: Point, third: Point) -> float:
    return (other[0] - one[0]) * (third[1] - one[1]) - (other[1] - one[1]) * (third[0] - one[0])


def _between(one: Point, other: Point, point: Point) -> bool:
    """Return whether a point that is on the line through two others lies between them."""
    return all(min(a, b) <= c <= max(a, b) for a, b, c in zip(one, other, point))


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Return whether two segments have a point in common."""
    if max(a[0], b[0]) < min(c[0], d[0]) or max(c[0], d[0]) < min(a[0], b[0]):
        return False  # most are far from each other
    sides = _cross(a, b, c), _cross(a, b, d), _cross(c, d, a), _cross(c, d, b)
    if (sides[0] > 0) != (sides[1] > 0) and (sides[2] > 0) != (sides[3] > 0) and 0.0 not in sides:
        return True
    ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(side == 0.0 and _between(*points) for side, points in zip(sides, ends))


def _distance(point: Point, start: Point, end: Point) -> float:
    """Return the distance of a point to a segment."""
    x, y = end[0] - start[0], end[1] - start[1]
    square = x * x + y * y
    along = ((point[0] - start[0]) * x + (point[1] - start[1]) * y) / square if square > 0.0 else 0.0
    along = min(1.0, max(0.0, along))
    return math.dist(point, (start[0] + along * x, start[1] + along * y))


def polygon_problem(corners: Sequence[Point]) -> str:
    """Return why corners are no polygon; empty when they are one."""
    if len(corners) < _LEAST_CORNERS:
        return f"has {len(corners)} corners; must have at least {_LEAST_CORNERS}"
    if len(corners) > MOST_CORNERS:
        return f"has {len(corners)} corners; must have at most {MOST_CORNERS}: simplify it"
    edges = tuple(zip(corners, (*corners[1:], corners[0])))
    for number, (a, b) in enumerate(edges):
        for later, (c, d) in enumerate(edges[number + 2 :], start=number + 2):
            if later - number < len(edges) - 1 and _meet(a, b, c, d):
                return f"crosses itself between corners {number + 1} and {later + 1}; must go around one area"
    area = abs(math.fsum(x1 * y2 - x2 * y1 for (x1, y1), (x2, y2) in edges)) / 2.0
    if not area >= _LEAST_AREA_M2:
        return f"encloses {area:.3g} m^2; must enclose at least {_LEAST_AREA_M2:g} m^2"
    return ""


def check_fence(trajectory: Trajectory, start: Point, fences: Sequence[Fence]) -> None:
    """Check every leg of a file that takes off at `start` (metres).

    Raises:
        WaypointError: the first waypoint that lies outside, or whose way leads outside.
    """
    points = (start, *((each.x_m, each.y_m) for each in trajectory.waypoints))
    for waypoint, one, other in zip(trajectory.waypoints, points, points[1:]):
        for fence in fences:
            problem = fence.problem(one, other)
            if problem:
                right = "must stay inside the fence, and out of excluded areas, also between two waypoints"
                raise trajectory.error(waypoint, "place", problem, right)
