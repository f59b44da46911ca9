"""Waypoint files as text: what is read, and the one mistake that is named."""

from __future__ import annotations

from math import pi, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.missions import Frame, Said, Trajectory, Waypoint, WaypointError, YawUnit, parse_trajectory

COLUMNS = "must be the columns x,y,z,yaw_deg,holdtime, separated by commas (or yaw_rad, in radians)"
EAST_NORTH = Said(Frame.EAST_NORTH, None)


def test_a_file_is_read_with_the_lines_of_its_waypoints():
    text = "# A line.\n# frame: east_north\nx,y,z,yaw_rad,holdtime\n\n0,0,1.5,0,1\n 1.0 , -2.5,2e0,-3.14,0.5\n"
    assert parse_trajectory(text, "line.csv") == Trajectory(
        "line.csv",
        (Waypoint(0.0, 0.0, 1.5, 0.0, 1.0, line=5), Waypoint(1.0, -2.5, 2.0, -3.14, 0.5, line=6)),
        "yaw_rad",
    )


@pytest.mark.parametrize(
    "header, cell, yaw_rad",
    [("yaw_rad", "1.5", 1.5), ("yaw_deg", "90", pi / 2), ("yaw_deg", "-360", -2 * pi)],
)
def test_the_header_chooses_the_unit_of_the_yaw(header, cell, yaw_rad):
    (waypoint,) = parse_trajectory(f"x,y,z,{header}\n0,0,1,{cell}\n", "a.csv", EAST_NORTH).waypoints
    assert waypoint == Waypoint(0.0, 0.0, 1.0, yaw_rad, 0.0, line=2)


def test_the_columns_may_stand_in_any_order():
    (waypoint,) = parse_trajectory("holdtime,yaw_deg,z,y,x\n5,45,3,2,1\n", "a.csv", EAST_NORTH).waypoints
    assert waypoint == Waypoint(1.0, 2.0, 3.0, radians(45.0), 5.0, line=2)


@pytest.mark.parametrize(
    "text, message",
    [
        ("", f"a.csv: is empty; {COLUMNS}"),
        ("# only this\n", f"a.csv: is empty; {COLUMNS}"),
        ("x,y,z,yaw\n", "a.csv:1: has no waypoints; must have at least one line below the header"),
        ("x;y;z;yaw\n", f"a.csv:1: the header has the column 'x;y;z;yaw'; {COLUMNS}"),
        ("1,2,3,4\n", f"a.csv:1: the header has the column '1'; {COLUMNS}"),
        ("x,y,z\n0,0,1\n", f"a.csv:1: the header lacks the column yaw; {COLUMNS}"),
        ("x,y,z,z,yaw\n", f"a.csv:1: the header has the column z twice; {COLUMNS}"),
        ("x,y,z,yaw,yaw_deg\n", f"a.csv:1: the header has the column yaw twice; {COLUMNS}"),
        ("x,y,z,yaw\n0,0,1\n", "a.csv:2: has 3 columns; must have 4: x,y,z,yaw"),
        ("x,y,z,yaw\n0,0,1,0,5\n", "a.csv:2: has 5 columns; must have 4: x,y,z,yaw"),
        ("x,y,z,yaw\n0,,1,0\n", "a.csv:2: y: has no value; must be a finite number"),
        ("x,y,z,yaw\n0,0,1 m,0\n", "a.csv:2: z: is '1 m'; must be a finite number"),
        ("x,y,z,yaw\n0,0,1,0\nnan,0,1,0\n", "a.csv:3: x: is 'nan'; must be a finite number"),
        ("x,y,z,yaw\n0,inf,1,0\n", "a.csv:2: y: is 'inf'; must be a finite number"),
        ("x,y,z,yaw\n0,1e999,1,0\n", "a.csv:2: y: is '1e999'; must be a finite number"),
        ("x,y,z,yaw\n0,1_0,1,0\n", "a.csv:2: y: is '1_0'; must be a finite number"),
        (
            "x,y,z,yaw_rad\n0,0,1,90\n",
            "a.csv:2: yaw_rad: is 90; must be within a turn, 6.2832 rad; are these degrees? Then say so: yaw_deg",
        ),
        ("x,y,z,yaw_deg\n0,0,1,361\n", "a.csv:2: yaw_deg: is 361; must be within a turn, 360 degrees"),
    ],
)
def test_a_mistake_is_named_with_line_and_column(text, message):
    with pytest.raises(WaypointError) as caught:
        parse_trajectory(text, "a.csv", EAST_NORTH)
    assert str(caught.value) == message


def test_a_mistake_has_its_parts_as_fields():
    with pytest.raises(WaypointError) as caught:
        parse_trajectory("x,y,z,yaw\n0,0,high,0\n", "a.csv")
    error = caught.value
    expected = ("a.csv", 2, "z", "is 'high'", "must be a finite number")
    assert (error.file, error.line, error.column, error.wrong, error.right) == expected


NUMBERS = st.floats(allow_nan=False, allow_infinity=False, width=32)


@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, st.floats(-6.0, 6.0), NUMBERS), min_size=1, max_size=20))
def test_what_is_written_is_what_is_read(rows):
    text = "x,y,z,yaw_rad,holdtime\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows)
    waypoints = parse_trajectory(text, "a.csv", EAST_NORTH).waypoints
    assert [(w.x_m, w.y_m, w.z_m, w.yaw_rad, w.hold_s) for w in waypoints] == rows
    assert [w.line for w in waypoints] == list(range(2, 2 + len(rows)))


@given(st.text(max_size=100))
def test_any_text_is_a_trajectory_or_one_mistake(text):
    for begin in ("", "x,y,z,yaw,holdtime\n", "# frame: east_north\nx,y,z,yaw_deg,holdtime\n"):
        try:
            assert parse_trajectory(begin + text, "a.csv").waypoints
        except WaypointError as error:
            assert error.right  # noqa: PT017 (either is good)


# --- frame and unit ---------------------------------------------------------------------------------------------------

AHEAD = "# frame: start_heading\n# yaw_unit: deg\nx,y,z,yaw,holdtime\n3,1,2,90,1\n"


def test_a_file_says_its_frame_and_its_unit_above_its_columns():
    waypoint = Waypoint(3.0, 1.0, 2.0, pi / 2, 1.0, line=4)
    assert parse_trajectory(AHEAD, "a.csv") == Trajectory("a.csv", (waypoint,), "yaw", frame=Frame.START_HEADING)
    said = Said(Frame.START_HEADING, YawUnit.DEG)
    without = parse_trajectory("x,y,z,yaw,holdtime\n\n\n3,1,2,90,1\n", "a.csv", said)
    assert without == parse_trajectory(AHEAD, "a.csv")


FRAME = (
    "write the line `# frame: east_north` above the columns where x and y are metres east and north of the takeoff, or "
    "`# frame: start_heading` where they are metres ahead and left of the heading at the takeoff (the files of the CNS "
    "Flight Stack are); or give its mission the key frame"
)
UNIT = (
    "call the column yaw_deg or yaw_rad, or write the line `# yaw_unit: deg` or `# yaw_unit: rad` above the columns, "
    "or give its mission the key yaw_unit"
)
NO_FRAME = f"the header does not say in which frame x and y are; {FRAME}"
RADIANS = Said(Frame.EAST_NORTH, YawUnit.RAD)
ONCE = "must be said once, or be the same in file, column and mission"
ROW = "0,0,1,5\n"


@pytest.mark.parametrize(
    "text, mission, message",
    [
        ("x,y,z,yaw\n", Said(), f":1: {NO_FRAME}"),
        ("x,y,z,yaw_deg\n", Said(), f":1: {NO_FRAME}"),
        ("# frame east_north\nx,y,z,yaw_deg\n", Said(), f":2: {NO_FRAME}"),
        ("x,y,z,yaw\n", EAST_NORTH, f":1: yaw: the header does not say its unit; {UNIT}"),
        (
            "# frame: start_heeding\nx,y,z,yaw\n",
            Said(),
            ":1: frame: is 'start_heeding'; must be east_north or start_heading",
        ),
        ("# yaw_unit: grad\nx,y,z,yaw\n", Said(), ":1: yaw_unit: is 'grad'; must be rad or deg"),
        (
            "# frame: east_north\n# Frame: east_north\nx,y,z,yaw\n",
            Said(),
            ":2: frame: is said twice; must stand in one line; see line 1",
        ),
        (
            "# frame: start_heading\nx,y,z,yaw\n",
            EAST_NORTH,
            f":2: frame: the file says start_heading, and beside it east_north is said; {ONCE}",
        ),
        (
            "# yaw_unit: rad\nx,y,z,yaw_deg\n",
            EAST_NORTH,
            f":2: yaw_unit: the file says deg, and beside it rad is said; {ONCE}",
        ),
        ("x,y,z,yaw_deg\n", RADIANS, f":1: yaw_unit: the file says deg, and beside it rad is said; {ONCE}"),
    ],
)
def test_what_the_header_leaves_open_is_asked_and_never_guessed(text, mission, message):
    with pytest.raises(WaypointError) as caught:
        parse_trajectory(text + ROW, "a.csv", mission)
    assert str(caught.value) == f"a.csv{message}"


def test_ahead_is_where_the_vehicle_heads_and_left_is_left_of_it():
    north = parse_trajectory(AHEAD, "a.csv").from_start(pi / 2, 10.0, 20.0)
    (waypoint,) = north.waypoints
    assert (waypoint.x_m, waypoint.y_m) == pytest.approx((9.0, 23.0))  # 3 m ahead is north, 1 m left is west
    assert abs(waypoint.yaw_rad) == pytest.approx(pi)  # a quarter left of north
    assert (north.frame, north.from_start(1.0)) == (Frame.EAST_NORTH, north)
