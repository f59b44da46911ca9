"""Missions of several files and repetitions."""

from __future__ import annotations

import pytest

from amaze_autonomy.engine.events import Mission
from amaze_autonomy.missions import (
    Bounds,
    FlightEstimate,
    FlightModel,
    MissionPlan,
    Round,
    Trajectory,
    Waypoint,
    WaypointError,
    battery_needed_fraction,
    check_files,
    estimate_rounds,
    total,
)

HOME, AWAY = Waypoint(0.0, 0.0, 2.0, 0.0, 1.0, 2), Waypoint(8.0, 0.0, 2.0, 0.0, 1.0, 3)
OUT, BACK = Trajectory("out.csv", (HOME, AWAY)), Trajectory("back.csv", (AWAY, HOME))
ONE_WAY = Trajectory("out.csv", (HOME, AWAY))


def test_each_flight_begins_where_the_one_before_landed():
    first, again = estimate_rounds((OUT, BACK), 2.0, FlightModel())
    assert [flight.length_m for flight in first.flights] == [12.0, 12.0]
    assert first == again


def test_a_repetition_flies_back_to_the_first_waypoint():
    first, again = estimate_rounds((ONE_WAY,), 2.0, FlightModel())
    assert [flight.length_m for flight in (*first.flights, *again.flights)] == [12.0, 20.0]
    assert total(first, again, 3).length_m == 12.0 + 2 * 20.0
    assert total(first, again, 3).duration_s == pytest.approx(
        first.flights[0].duration_s + 2 * again.flights[0].duration_s
    )


def test_a_plan_knows_each_flight():
    first, again = (Round((FlightEstimate(length, 1.0),)) for length in (1.0, 2.0))
    plan = MissionPlan(Mission(id="1", repetitions=3), (OUT,), first, again)
    assert [plan.flight(0, repetition).length_m for repetition in range(3)] == [1.0, 2.0, 2.0]
    assert plan.total == FlightEstimate(5.0, 3.0)


def test_every_file_is_checked_from_where_it_takes_off():
    bounds = Bounds(max_first_leg_m=5.0)
    check_files((OUT, BACK), 2, 2.0, bounds, (30.0, 100.0))
    check_files((ONE_WAY,), 1, 2.0, bounds, (30.0, 100.0))
    with pytest.raises(WaypointError, match=r"^out\.csv:2: x,y,z: is 8 m from the takeoff; "):
        check_files((ONE_WAY,), 2, 2.0, bounds, (30.0, 100.0))
    with pytest.raises(WaypointError, match=r"^back\.csv:2: x,y,z: is 8 m from the takeoff; "):
        check_files((Trajectory("back.csv", (Waypoint(8.0, 0.0, 2.0, 0.0, 1.0, 2),)),), 1, 2.0, bounds, (30.0, 100.0))


def test_every_file_stays_near_its_own_takeoff_too():
    def flight(name: str, *easts_m: float) -> Trajectory:
        return Trajectory(name, tuple(Waypoint(x, 0.0, 2.0, 0.0, 1.0, line) for line, x in enumerate(easts_m, 2)))

    bounds, limits = Bounds(max_first_leg_m=50.0), (30.0, 25.0)
    east, west = flight("a.csv", 0.0, 20.0), flight("b.csv", 20.0, -20.0)
    check_files((east, flight("b.csv", 20.0, -4.0)), 1, 2.0, bounds, limits)
    wrong = "x,y: is 40 m from where its file takes off; must be below the distance limit 25, in metres"
    with pytest.raises(WaypointError) as caught:
        check_files((east, west), 1, 2.0, bounds, limits)
    assert str(caught.value) == f"b.csv:3: {wrong}"
    with pytest.raises(WaypointError) as caught:
        check_files((flight("a.csv", -20.0, 0.0, 20.0),), 2, 2.0, bounds, limits)
    assert str(caught.value) == f"a.csv:2: {wrong}", "a repetition takes off where the last file lands"


def test_the_battery_is_the_flown_part_of_the_endurance_and_the_reserve():
    assert battery_needed_fraction(250.0, 0.2, FlightModel(endurance_s=1000.0)) == pytest.approx(0.45)
    assert battery_needed_fraction(2500.0, 0.2, FlightModel(endurance_s=1000.0)) > 1.0
