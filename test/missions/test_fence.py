"""Fences: what may be flown, and the waypoint that is named when it may not."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.missions import (
    MOST_CORNERS,
    Circle,
    Fence,
    Polygon,
    Trajectory,
    Waypoint,
    WaypointError,
    check_fence,
    polygon_problem,
)

FIELD = Polygon(((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)))
#  an L: the corner at the upper right is missing
L_SHAPE = Polygon(((0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 10.0), (0.0, 10.0)))


def ring(corners):
    """Return a round polygon."""
    turns = [2 * math.pi * number / corners for number in range(corners)]
    return tuple((100.0 * math.cos(turn), 100.0 * math.sin(turn)) for turn in turns)


LEAVES, ENTERS = "leaves the fence on the way there", "enters an excluded area on the way there"


@pytest.mark.parametrize(
    "fence, start, end, problem",
    [
        (Fence(), (0.0, 0.0), (1e6, 0.0), ""),
        (Fence((FIELD,)), (1.0, 1.0), (9.0, 9.0), ""),
        (Fence((FIELD,)), (1.0, 1.0), (11.0, 9.0), LEAVES),
        (Fence((FIELD,)), (-1.0, 5.0), (5.0, 5.0), LEAVES),
        (Fence((FIELD,)), (1.0, 1.0), (10.0, 5.0), LEAVES),  # to touch is to cross
        (Fence((L_SHAPE,)), (9.0, 2.0), (2.0, 9.0), LEAVES),  # both ends inside, the way is not
        (Fence((L_SHAPE,)), (9.0, 2.0), (2.0, 2.0), ""),
        (Fence((FIELD,)), (3.0, 3.0), (3.0, 3.0), ""),
        (Fence((FIELD,), (Circle((5.0, 5.0), 1.0, stay_in=False),)), (1.0, 1.0), (9.0, 9.0), ENTERS),
        (Fence((FIELD,), (Circle((5.0, 5.0), 1.0, stay_in=False),)), (1.0, 1.0), (9.0, 1.0), ""),
        (Fence((), (Circle((0.0, 0.0), 5.0),)), (0.0, 0.0), (4.9, 0.0), ""),
        (Fence((), (Circle((0.0, 0.0), 5.0),)), (0.0, 0.0), (5.0, 0.0), LEAVES),
        (Fence((Polygon(FIELD.corners, stay_in=False),)), (-5.0, 5.0), (15.0, 5.0), ENTERS),
        (Fence((Polygon(FIELD.corners, stay_in=False),)), (4.0, 5.0), (5.0, 5.0), ENTERS),
        (Fence((Polygon(FIELD.corners, stay_in=False),)), (-5.0, -1.0), (15.0, -1.0), ""),
        (Fence((FIELD,), (Circle((50.0, 50.0), 5.0),)), (50.0, 50.0), (51.0, 50.0), ""),  # one of two areas
    ],
)
def test_a_leg_is_judged_as_a_whole(fence, start, end, problem):
    assert fence.problem(start, end) == problem


COORDINATES = st.integers(-20_000, 20_000).map(lambda number: number / 1000 + 0.0005)  # beside the border, not on it
POINTS = st.tuples(COORDINATES, COORDINATES)


@given(POINTS, POINTS)
def test_in_a_square_a_leg_is_good_exactly_when_its_ends_are(start, end):
    inside = all(0.0 < value < 10.0 for value in (*start, *end))
    assert (Fence((FIELD,)).problem(start, end) == "") == inside


@pytest.mark.parametrize(
    "corners, problem",
    [
        (FIELD.corners, ""),
        (L_SHAPE.corners, ""),
        (FIELD.corners[:2], "has 2 corners; must have at least 3"),
        (((0.0, 0.0), (9.0, 9.0), (9.0, 0.0), (0.0, 9.0)),
         "crosses itself between corners 1 and 3; must go around one area"),
        (ring(MOST_CORNERS), ""),
        (ring(MOST_CORNERS + 1), "has 501 corners; must have at most 500: simplify it"),
        (ring(100_000), "has 100000 corners; must have at most 500: simplify it"),
        (((0.0, 0.0), (0.5, 0.0), (0.5, 0.5)), "encloses 0.125 m^2; must enclose at least 1 m^2"),
        (((0.0, 0.0), (5.0, 0.0), (9.0, 0.0)), "encloses 0 m^2; must enclose at least 1 m^2"),
    ],
)  # fmt: skip
def test_corners_that_go_around_nothing_are_no_polygon(corners, problem):
    assert polygon_problem(corners) == problem


def test_the_waypoint_whose_way_leads_outside_is_named():
    inside, outside = Waypoint(5.0, 5.0, 2.0, 0.0, 0.0, 2), Waypoint(5.0, 15.0, 2.0, 0.0, 0.0, 3)
    with pytest.raises(WaypointError) as caught:
        check_fence(Trajectory("a.csv", (inside, outside)), (1.0, 1.0), (Fence((FIELD,)),))
    right = "must stay inside the fence, and out of excluded areas, also between two waypoints"
    assert str(caught.value) == f"a.csv:3: x,y: {LEAVES}; {right}"


def test_the_takeoff_must_be_inside_as_well():
    with pytest.raises(WaypointError, match=r"^a\.csv:2: x,y: leaves the fence"):
        check_fence(Trajectory("a.csv", (Waypoint(5.0, 5.0, 2.0, 0.0, 0.0, 2),)), (-1.0, 1.0), (Fence((FIELD,)),))
