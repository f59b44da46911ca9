"""Waypoint files in latitude and longitude."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.missions import (
    Home,
    Place,
    Route,
    RoutePoint,
    Trajectory,
    Waypoint,
    WaypointError,
    localize,
    parse_file,
)

HEADER = "latitude,longitude,relative_altitude,yaw_rad,holdtime\n"
COLUMNS = (
    "must be the columns latitude,longitude,relative_altitude,yaw_deg,holdtime, separated by commas (degrees, metres "
    "above the takeoff; or yaw_rad, in radians)"
)
HOME = Home(47.0, 8.0)


def test_a_file_in_latitude_and_longitude_is_read_with_its_lines():
    route = parse_file("# home\n" + HEADER + "47.0001,8.0002,5,0.5,2\n", "a.csv")
    assert route == Route("a.csv", (RoutePoint(Place(47.0001, 8.0002), 5.0, 0.5, 2.0, 3),))


def test_the_header_says_of_which_kind_a_file_is():
    assert isinstance(parse_file("# frame: east_north\nx,y,z,yaw_deg\n0,0,1,0\n", "a.csv"), Trajectory)
    assert isinstance(parse_file("yaw_deg,longitude,latitude,relative_altitude\n0,8,47,1\n", "a.csv"), Route)


def test_around_its_home_a_route_is_in_metres_and_keeps_its_places():
    route = parse_file(HEADER + "47.0001,8.0002,5,0.5,2\n", "a.csv")
    trajectory = localize(route, HOME)
    (waypoint,) = trajectory.waypoints
    assert (round(waypoint.x_m, 2), round(waypoint.y_m, 2), waypoint.z_m) == (15.21, 11.12, 5.0)
    assert (waypoint.yaw_rad, waypoint.hold_s, waypoint.line) == (0.5, 2.0, 2)
    assert trajectory.places == (Place(47.0001, 8.0002),)


def test_without_a_yaw_it_looks_along_its_way():
    points = [
        RoutePoint(Place(47.0001, 8.0), 5.0, None, 0.0, 1),  # north
        RoutePoint(Place(47.0001, 8.0), 9.0, None, 0.0, 2),  # up: as before
        RoutePoint(Place(47.0001, 7.9999), 9.0, None, 0.0, 3),  # west
    ]
    yaws = [waypoint.yaw_rad for waypoint in localize(Route("a.plan", tuple(points)), HOME).waypoints]
    assert yaws == pytest.approx([pi / 2, pi / 2, pi])


AWAY = Waypoint(20.0, 0.0, 3.0, 0.5, 0.0)  # where the file before landed
HERE = RoutePoint(None, 3.0, None, 0.0, 1, takeoff=True)
THERE = RoutePoint(HOME.to_global(20.0, 10.0), 5.0, None, 0.0, 2)


def test_a_takeoff_here_is_above_where_the_file_takes_off():
    trajectory = localize(Route("a.plan", (HERE, THERE)), HOME, AWAY)
    first, second = trajectory.waypoints
    assert (first.x_m, first.y_m, first.z_m, first.line) == (20.0, 0.0, 3.0, 1)
    assert (second.x_m, second.y_m) == pytest.approx((20.0, 10.0))
    assert trajectory.places == (HOME.to_global(20.0, 0.0), THERE.place)
    first, _ = localize(Route("a.plan", (HERE, THERE)), HOME).waypoints
    assert (first.x_m, first.y_m) == (0.0, 0.0)


def test_a_file_that_begins_in_the_air_takes_off_nowhere():
    for takeoff in (HERE, replace(HERE, place=Place(47.0, 8.0), yaw_rad=1.0)):
        route = Route("a.plan", (takeoff, THERE))
        trajectory = localize(route, HOME, AWAY, in_flight=True)
        assert [each.line for each in trajectory.waypoints] == [2]
        assert trajectory.places == (THERE.place,)
    with pytest.raises(WaypointError) as caught:
        localize(Route("a.plan", (HERE,)), HOME, AWAY, in_flight=True)
    assert str(caught.value) == (
        "a.plan:1: has nothing but a takeoff, and begins in the air (touchdown_between_files: false); "
        "must have a waypoint"
    )


ABOVE = replace(THERE, place=HOME.to_global(20.0, 0.0))


def yaws(*points: RoutePoint, last=None, in_flight: bool = False):
    trajectory = localize(Route("a.plan", points), HOME, last, in_flight=in_flight)
    return [waypoint.yaw_rad for waypoint in trajectory.waypoints]


def test_a_takeoff_without_a_heading_looks_where_the_waypoint_after_it_does():
    takeoff = replace(HERE, place=HOME.to_global(20.3, 0.0))  # the place that was drawn is not quite where it landed
    for first in (HERE, takeoff):
        assert yaws(first, THERE, last=AWAY) == pytest.approx([pi / 2, pi / 2], abs=0.05)
        assert yaws(first, replace(THERE, yaw_rad=1.0), last=AWAY) == [1.0, 1.0]
    assert yaws(replace(HERE, yaw_rad=2.0), THERE, last=AWAY) == pytest.approx([2.0, pi / 2])


def test_the_first_leg_of_a_later_file_begins_where_the_one_before_ended():
    for in_flight in (False, True):
        assert yaws(THERE, last=AWAY, in_flight=in_flight) == pytest.approx([pi / 2])


def test_who_goes_nowhere_turns_nowhere():
    assert yaws(HERE, ABOVE, THERE, last=AWAY) == pytest.approx([0.5, 0.5, pi / 2]), "as it has landed"
    home = replace(ABOVE, place=Place(47.0, 8.0))
    assert yaws(HERE, home, THERE) == pytest.approx([yaws(THERE)[0]] * 3), "as it will look"
    assert yaws(HERE, home) == [0.0, 0.0]


@pytest.mark.parametrize(
    "text, message",
    [
        (HEADER, "a.csv:1: has no waypoints; must have at least one line below the header"),
        (HEADER + "91,8,5,0,0\n", "a.csv:2: latitude: is 91; must be within 90 degrees"),
        (HEADER + "47,-181,5,0,0\n", "a.csv:2: longitude: is -181; must be within 180 degrees"),
        (HEADER + "47,8,nan,0,0\n", "a.csv:2: relative_altitude: is 'nan'; must be a finite number"),
        ("latitude,longitude,yaw\n47,8,0\n", f"a.csv:1: the header lacks the column relative_altitude; {COLUMNS}"),
        ("latitude,longitude,z,yaw\n47,8,5,0\n", f"a.csv:1: the header has the column 'z'; {COLUMNS}"),
    ],
)
def test_a_mistake_is_named_with_line_and_column(text, message):
    with pytest.raises(WaypointError) as caught:
        parse_file(text, "a.csv")
    assert str(caught.value) == message


@given(st.text(max_size=100))
def test_any_text_is_a_route_or_one_mistake(text):
    try:
        assert parse_file(HEADER + text, "a.csv").points
    except WaypointError as error:
        assert error.right  # noqa: PT017 (either is good)


def test_latitude_and_longitude_are_a_frame_and_the_unit_of_the_yaw_is_asked_for():
    with pytest.raises(WaypointError) as caught:
        parse_file("# frame: east_north\n" + HEADER + "47,8,5,0,1\n", "a.csv")
    assert str(caught.value) == "a.csv:2: frame: is east_north; must be left out: latitude and longitude are a frame"
    with pytest.raises(
        WaypointError, match=r"^a\.csv:1: yaw: the header does not say its unit; call the column yaw_deg "
    ):
        parse_file("latitude,longitude,relative_altitude,yaw\n47,8,5,0\n", "a.csv")
