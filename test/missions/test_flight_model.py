"""How long a flight takes, worked out by hand, and which waypoints cannot be flown."""

from __future__ import annotations

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.missions import (
    Bounds,
    FlightEstimate,
    FlightModel,
    Trajectory,
    Waypoint,
    WaypointError,
    check_trajectory,
    distance_m,
    estimate_flight,
    leg_s,
)

MODEL = FlightModel(
    cruise_speed_m_s=2.0,
    climb_speed_m_s=1.0,
    descent_speed_m_s=0.5,
    landing_speed_m_s=0.25,
    acceleration_m_s2=1.0,
    turn_rate_rad_s=0.5,
    ground_time_s=6.0,
    endurance_s=600.0,
)
ORIGIN = Waypoint(0.0, 0.0, 2.0, 0.0, 0.0)


def _at(x: float = 0.0, y: float = 0.0, z: float = 2.0, yaw: float = 0.0, hold: float = 0.0, line: int = 0) -> Waypoint:
    return Waypoint(x, y, z, yaw, hold, line)


@pytest.mark.parametrize(
    "other, seconds",
    [
        (_at(x=10.0), 7.0),  # 10 m / 2 m/s, and 2 s for speeding up and braking
        (_at(x=6.0, y=8.0), 7.0),
        (_at(x=1.0), 2.0),  # too short to reach 2 m/s: 1 s up, 1 s down
        (_at(z=5.0), 4.0),  # 3 m / 1 m/s, and 1 s
        (_at(z=1.0), 2.5),  # 1 m / 0.5 m/s, and 0.5 s
        (_at(yaw=pi), 2 * pi),
        (_at(yaw=1.5 * pi), pi),  # the shorter way round
        (_at(yaw=-0.25), 0.5),
        (_at(x=10.0, z=5.0, yaw=0.5), 7.0),  # the slowest of the three
        (_at(), 0.0),
    ],
)
def test_a_leg_takes_as_long_as_the_slowest_of_way_height_and_turn(other, seconds):
    assert leg_s(ORIGIN, other, MODEL) == pytest.approx(seconds)


def test_a_flight_is_takeoff_legs_holds_and_landing():
    trajectory = Trajectory("a.csv", (_at(z=2.0, hold=3.0), _at(x=10.0, hold=1.0)))
    estimate = estimate_flight(trajectory, (0.0, 0.0), 1.0, MODEL)
    # on the ground 6, up to 1 m 2, up to 2 m 2, hold 3, leg 7, hold 1, 2 m down at 0.25 m/s 8
    assert estimate == FlightEstimate(length_m=1.0 + 1.0 + 10.0 + 2.0, duration_s=29.0)


def test_a_flight_begins_where_the_one_before_landed():
    trajectory = Trajectory("a.csv", (_at(x=10.0),))
    assert estimate_flight(trajectory, (10.0, 0.0), 2.0, MODEL).length_m == 4.0


@given(
    st.tuples(*[st.floats(-50.0, 50.0)] * 3, st.floats(-6.0, 6.0)),
    st.tuples(*[st.floats(-50.0, 50.0)] * 3, st.floats(-6.0, 6.0)),
)
def test_no_leg_is_faster_than_its_speed_and_none_takes_no_time(one, other):
    first, second = (Waypoint(*each, hold_s=0.0) for each in (one, other))
    seconds = leg_s(first, second, MODEL)
    assert seconds >= distance_m(first, second) / (MODEL.cruise_speed_m_s + MODEL.climb_speed_m_s) - 1e-9
    assert distance_m(first, second) == distance_m(second, first)


def _check(*waypoints: Waypoint, start: tuple = (0.0, 0.0)) -> None:
    bounds = Bounds(min_height_m=0.5, max_leg_m=20.0, max_first_leg_m=5.0, max_hold_s=60.0, max_waypoints=3)
    check_trajectory(Trajectory("a.csv", waypoints), start, 1.0, bounds, (10.0, 30.0))


def test_a_trajectory_at_its_bounds_is_good():  # hollow: it raises beyond them, as the next test says
    _check(_at(z=1.0, hold=60.0), _at(x=20.0, z=1.0), _at(x=20.0, z=0.5))


@pytest.mark.parametrize(
    "waypoints, message",
    [
        ((_at(z=0.4, line=2),), "a.csv:2: z: is 0.4; must be at least 0.5 and below the height limit 10, in metres"),
        ((_at(z=10.0, line=2),), "a.csv:2: z: is 10; must be at least 0.5 and below the height limit 10, in metres"),
        (
            (_at(z=0.9, line=2),),
            "a.csv:2: z: is 0.9; the first waypoint must be at the takeoff height (1 m) or above",
        ),
        (
            (_at(x=18.0, y=24.0, line=2),),
            "a.csv:2: x,y: is 30 m from the takeoff position; must be below the distance limit 30, in metres",
        ),
        ((_at(hold=61.0, line=2),), "a.csv:2: holdtime: is 61; must be 0 to 60, in seconds"),
        ((_at(hold=-1.0, line=2),), "a.csv:2: holdtime: is -1; must be 0 to 60, in seconds"),
        ((_at(x=5.1, z=1.0, line=2),), "a.csv:2: x,y,z: is 5.1 m from the takeoff; must be at most 5 m away (bounds)"),
        (
            (_at(line=2), _at(y=21.0, line=3)),
            "a.csv:3: x,y,z: is 21 m from the waypoint before; must be at most 20 m away (bounds)",
        ),
        (
            (_at(line=2), _at(line=3), _at(line=4), _at(line=5)),
            "a.csv:5: has 4 waypoints; must have at most 3 (bounds)",
        ),
        (
            (_at(z=float("nan"), line=2),),
            "a.csv:2: z: is nan; must be at least 0.5 and below the height limit 10, in metres",
        ),
    ],
)
def test_a_waypoint_that_cannot_be_flown_is_named(waypoints, message):
    with pytest.raises(WaypointError) as caught:
        _check(*waypoints)
    assert str(caught.value) == message


def test_the_first_leg_is_measured_from_where_it_takes_off():
    _check(_at(x=14.0, z=1.0), start=(10.0, 0.0))
    with pytest.raises(WaypointError, match=r"is 10 m from the takeoff; must be at most 5 m away"):
        _check(_at(z=1.0), start=(10.0, 0.0))
