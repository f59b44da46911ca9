"""Numbers as an operator reads them."""

from __future__ import annotations

import pytest

from amaze_autonomy.console import words
from amaze_autonomy.console.model import Snapshot, Telemetry
from amaze_autonomy.engine.events import Check, Verdict


@pytest.mark.parametrize(
    "value, unit, shown",
    [
        (0.416, "fraction", "42 %"),
        (0.1745, "rad", "10.0 deg"),
        (20.123, "Hz", "20.1 Hz"),
        (1013.25, "hPa", "1013 hPa"),
        (0.06826, "s", "0.0683 s"),
        (-1.5, "m", "-1.5 m"),
        (3.0, "", "3"),
        (None, "m", "-"),
    ],
)
def test_quantity_with_its_unit(value, unit, shown):
    assert words.quantity(value, unit) == shown


@pytest.mark.parametrize(
    "said, shown, warns",
    [
        (Telemetry(gps="nominal", gps_fix="3D", satellites=14.0), ("3D, 14 satellites", "nominal"), False),
        (Telemetry(gps="3.1 Hz, expected 5 Hz", gps_fix="3D"), ("3D", "3.1 Hz, expected 5 Hz"), True),
        (Telemetry(gps_fix="2D", satellites=3.0), ("2D, 3 satellites", ""), True),
        (Telemetry(gps="nominal"), ("nominal", ""), False),
        (Telemetry(), ("-", ""), False),
    ],
)
def test_the_gps_is_one_reading_with_its_fix_and_what_the_watchdog_says(said, shown, warns):
    assert words.Reading("GPS", *shown, warns) in words.readings(said)


def test_of_an_autopilot_that_nobody_has_heard_nothing_is_said():
    said = {each.name: each[1:3] for each in words.readings(Telemetry())}
    assert set(said.values()) == {("-", "")}
    heard = {
        each.name: each[1:3] for each in words.readings(Telemetry(age=0.1, battery_voltage=15.6, battery_limit=0.15))
    }
    assert (heard["motors"], heard["battery"]) == (("-", ""), ("-", "15.6 V, lands at 15 %"))


@pytest.mark.parametrize(
    "passed_s, shown, warns",
    [(0.0, "0.20 s", False), (1.0, "1.2 s", False), (1.4, "1.6 s", True), (7.2, "7.4 s", True)],
)
def test_the_age_of_the_link_goes_on_counting(passed_s, shown, warns):
    said = Telemetry(age=0.1, link_age=0.2)
    assert words.Reading("link", shown, "", warns) in words.readings(said, passed_s)


@pytest.mark.parametrize(
    "said, shown, warns",
    [
        (Telemetry(), "-", False),
        (Telemetry(age=0.1), "-", True),
        (Telemetry(age=0.1, armed_known=True), "disarmed", False),
        (Telemetry(age=0.1, armed=True, armed_known=True), "armed", False),
    ],
)
def test_motors_of_which_nobody_knows_are_not_called_disarmed(said, shown, warns):
    assert words.Reading("motors", shown, "", warns) in words.readings(said)


@pytest.mark.parametrize(
    "limit, other, unit, shown",
    [
        (6.5, 3.5, "Hz", "3.5 ... 6.5 Hz"),
        (0.3, 0.9, "fraction", "30 ... 90 %"),
        (0.1745, None, "rad", "10.0 deg"),
        (None, None, "Hz", "-"),
    ],
)
def test_a_limit_says_which_bound(limit, other, unit, shown):
    assert words.limits(Check("a", Verdict.PASS, None, limit, unit, other_limit=other)) == shown


@pytest.mark.parametrize(
    "left_s, in_words, as_clock",
    [(12.9, "12 s", "0:12"), (59.99, "59 s", "0:59"), (60.0, "1 min 00 s", "1:00"), (725.4, "12 min 05 s", "12:05")],
)
def test_time_left_is_rounded_down(left_s, in_words, as_clock):
    assert (words.seconds(left_s), words.clock(left_s)) == (in_words, as_clock)


def test_time_left_is_never_below_zero():
    assert (words.seconds(-3.0), words.clock(-3.0)) == ("0 s", "0:00")


@pytest.mark.parametrize(
    "value_s, shown", [(None, "-"), (44.2, "45 s"), (60.0, "1 min"), (117.4, "1 min 58 s"), (3600.0, "60 min")]
)
def test_duration_is_rounded_up(value_s, shown):
    assert words.duration(value_s) == shown


@pytest.mark.parametrize(
    "value_s, shown",
    [
        (None, "-"),
        (0.042, "0.04 s"),
        (0.99, "0.99 s"),
        (1.0, "1.0 s"),
        (1.26, "1.3 s"),
        (2.54, "2.5 s"),
        (-0.2, "-0.20 s"),
        (-1.26, "-1.3 s"),
    ],
)
def test_an_age_has_two_decimals_below_a_second_and_one_from_there_on(value_s, shown):
    assert words.age(value_s) == shown


def test_levels_of_messages():
    assert [words.level(number) for number in (-1, 0, 1, 2, 3, 99)] == [
        "INFO",
        "INFO",
        "WARNING",
        "ERROR",
        "ALARM",
        "ALARM",
    ]


# --- waypoints --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "state, step, landed, waypoint, reached, shown",
    [
        ("TAKEOFF", "arming", "ON_GROUND", 0, 0, "0 of 5"),
        ("TAKEOFF", "lifting_off", "ON_GROUND", 1, 0, "1 of 5, 0 reached"),
        ("MISSION", "flying", "IN_AIR", 3, 2, "3 of 5, 2 reached"),
        ("MISSION", "flying", "IN_AIR", 5, 4, "5 of 5, 4 reached"),
        ("MISSION", "flying", "LANDING", 5, 5, "5 of 5 reached"),
        ("MISSION", "touchdown", "ON_GROUND", 5, 5, "5 of 5 reached"),
        ("HOLD", "holding", "IN_AIR", 3, 2, "3 of 5, 2 reached"),
        ("LAND", "commanding", "IN_AIR", 3, 2, "3 of 5, 2 reached"),
        ("LAND", "descending", "IN_AIR", 2, 2, "2 of 5 reached"),
        ("LAND", "descending", "LANDING", 0, 0, "0 of 5 reached"),
        ("MISSION", "flying", "ON_GROUND", 5, 5, "5 of 5 reached"),
        ("MISSION", "flying", "ON_GROUND", 3, 2, "3 of 5, 2 reached"),
        ("PILOT", "", "IN_AIR", 3, 2, "3 of 5"),
        ("PILOT", "", "ON_GROUND", 3, 2, "3 of 5"),
    ],
)
def test_the_waypoint_that_is_flown_to_is_not_reached(state, step, landed, waypoint, reached, shown):
    telemetry = Telemetry(landed=landed)
    said = Snapshot(state=state, step=step, waypoint=waypoint, waypoints=5, telemetry=telemetry)
    assert (words.waypoints_reached(said), words.waypoint_words(said)) == (reached, shown)
