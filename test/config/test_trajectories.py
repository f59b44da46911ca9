"""Waypoint files that missions name."""

from __future__ import annotations

import math

import pytest

from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.config.trajectories import plan_of_waypoints
from amaze_autonomy.missions import Frame, Waypoint, WaypointError

HEADER = "# frame: east_north\nx,y,z,yaw_rad,holdtime\n"
COLUMNS = "must be the columns x,y,z,yaw_deg,holdtime, separated by commas (or yaw_rad, in radians)"


def test_a_file_that_is_not_there_is_named_where_the_mission_names_it(mistake, small_file):
    text = small_file("missions.yaml").replace("[up.csv]", "[up.csv, down.csv]")
    assert mistake("missions.yaml", text) == (
        "missions.yaml:4: missions.1.files.1: down.csv is missing, empty or cannot be read; "
        "must be a waypoint file in FOLDER"
    )


@pytest.mark.parametrize("name", ["../up.csv", "/etc/passwd.csv", "a/../../up.csv"])
def test_a_file_outside_the_folder_is_not_read(mistake, small_file, name):
    text = small_file("missions.yaml").replace("up.csv", name)
    assert mistake("missions.yaml", text) == (
        f"missions.yaml:4: missions.1.files.0: {name} leaves the folder; "
        "must lie inside the folder of the configuration"
    )


def test_a_link_out_of_the_folder_is_not_followed(small, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside") / "up.csv"
    outside.write_text(HEADER + "0,0,2,0,1\n")
    (small / "up.csv").unlink()
    (small / "up.csv").symlink_to(outside)
    with pytest.raises(ConfigError, match=r"missions\.1\.files\.0: up\.csv leaves the folder; "):
        load_configuration(small)


def test_a_file_that_is_spelled_otherwise_is_guessed(mistake, small, small_file):
    (small / "trajectories").mkdir()
    (small / "trajectories" / "square.csv").write_text(HEADER)
    text = small_file("missions.yaml").replace("up.csv", "trajectories/sqare.csv")
    assert mistake("missions.yaml", text) == (
        "missions.yaml:4: missions.1.files.0: trajectories/sqare.csv is missing, empty or cannot be read; "
        "must be a waypoint file in FOLDER; did you mean trajectories/square.csv?"
    )


@pytest.mark.parametrize("name", ["sensors.yaml", "up.waypoints", "up.PLAN", ".csv/up"])
def test_a_file_that_is_neither_csv_nor_plan_is_refused_for_that(mistake, small, small_file, name):
    (small / name).parent.mkdir(exist_ok=True)
    (small / name).touch()
    assert mistake("missions.yaml", small_file("missions.yaml").replace("up.csv", name)) == (
        f"missions.yaml:4: missions.1.files.0: is the text {name!r}; "
        'must be a .csv or .plan file inside the folder of the configuration, e.g. "trajectories/square.csv"'
    )


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "missions.yaml:4: missions.1.files.0: up.csv is missing, empty or cannot be read; "
         "must be a waypoint file in FOLDER"),
        ("\n", f"up.csv: is empty; {COLUMNS}"),
        (HEADER, "up.csv:2: has no waypoints; must have at least one line below the header"),
        (HEADER + "0,0,two,0,1\n", "up.csv:3: z: is 'two'; must be a finite number"),
        (HEADER + "0,0,0.3,0,1\n",
         "up.csv:3: z: is 0.3; must be at least 0.5 and below the height limit 30, in metres"),
        (HEADER + "0,0,0.8,0,1\n",
         "up.csv:3: z: is 0.8; the first waypoint must be at the takeoff height (1 m) or above"),
        (HEADER + "0,0,30,0,1\n",
         "up.csv:3: z: is 30; must be at least 0.5 and below the height limit 30, in metres"),
        (HEADER + "0,0,2,0,1\n\n# far\n60,80,2,0,1\n",
         "up.csv:6: x,y: is 100 m from the takeoff position; must be below the distance limit 100, in metres"),
        (HEADER + "0,0,2,0,1\n0,51,2,0,1\n",
         "up.csv:4: x,y,z: is 51 m from the waypoint before; must be at most 50 m away (bounds)"),
        (HEADER + "11,0,1,0,1\n",
         "up.csv:3: x,y,z: is 11 m from the takeoff; must be at most 10 m away (bounds)"),
        (HEADER + "0,0,2,0,-1\n", "up.csv:3: holdtime: is -1; must be 0 to 120, in seconds"),
        (HEADER + "0,0,2,0,2000\n", "up.csv:3: holdtime: is 2000; must be 0 to 120, in seconds"),
    ],
)  # fmt: skip
def test_a_waypoint_file_that_cannot_be_flown_is_named_with_line_and_column(mistake, text, message):
    assert mistake("up.csv", text) == message


def test_the_limits_of_the_mission_count_for_its_files(mistake, small, small_file):
    (small / "missions.yaml").write_text(small_file("missions.yaml") + "    limits: {max_height_m: 2.0}\n")
    assert mistake("up.csv", HEADER + "0,0,2,0,1\n") == (
        "up.csv:3: z: is 2; must be at least 0.5 and below the height limit 2, in metres"
    )


def test_a_repetition_starts_where_the_last_file_landed(mistake, small, small_file):
    (small / "missions.yaml").write_text(small_file("missions.yaml") + "    repetitions: 2\n")
    assert mistake("up.csv", HEADER + "0,0,2,0,1\n15,0,2,0,1\n") == (
        "up.csv:3: x,y,z: is 15.0333 m from the takeoff; must be at most 10 m away (bounds)"
    )


def test_too_many_waypoints_are_refused(mistake):
    assert (
        mistake("up.csv", HEADER + "0,0,2,0,1\n" * 501)
        == "up.csv:503: has 501 waypoints; must have at most 500 (bounds)"
    )


def test_a_waypoint_file_that_is_not_utf8_is_named_with_its_line(small):
    (small / "up.csv").write_bytes(HEADER.encode() + b"0,0,2,0,1\n\xff\n")
    with pytest.raises(ConfigError) as caught:
        load_configuration(small)
    assert str(caught.value) == f"{small}/up.csv:4: is not UTF-8; must be saved as UTF-8 text"


def test_a_spreadsheets_byte_order_mark_and_line_ends_are_taken(small):
    (small / "up.csv").write_bytes(b"\xef\xbb\xbf# frame: east_north\r\nx,y,z,yaw_deg,holdtime\r\n0,0,2,90,1\r\n")
    (waypoint,) = load_configuration(small).plans[0].trajectories[0].waypoints
    assert (waypoint.z_m, round(waypoint.yaw_rad, 6), waypoint.line) == (2.0, 1.570796, 3)


ASKED = (
    "write the line `# frame: east_north` above the columns where x and y are metres east and north of the takeoff, or "
    "`# frame: start_heading` where they are metres ahead and left of the heading at the takeoff (the files of the CNS "
    "Flight Stack are); or give its mission the key frame"
)
OF_CNS = "x,y,z,yaw,holdtime\n0,0,2,0,1\n3,0,2,5,1\n"


def test_a_file_of_the_cns_flight_stack_is_asked_about_and_never_flown_as_ours(mistake):
    assert mistake("up.csv", OF_CNS) == f"up.csv:1: the header does not say in which frame x and y are; {ASKED}"


def test_a_mission_may_say_what_its_files_do_not(small, small_file):
    keys = "    frame: start_heading\n    yaw_unit: deg\n"
    (small / "missions.yaml").write_text(small_file("missions.yaml") + keys)
    (small / "up.csv").write_text(OF_CNS)
    (trajectory,) = load_configuration(small).plans[0].trajectories
    assert (trajectory.frame, trajectory.waypoints[1]) == (
        Frame.START_HEADING,
        Waypoint(3.0, 0.0, 2.0, math.radians(5.0), 1.0, 3),
    )


def test_two_missions_may_each_say_it_of_the_same_file(small, small_file):
    one = small_file("missions.yaml") + "    frame: start_heading\n    yaw_unit: deg\n"
    other = '  "2":\n    description: Otherwise\n    files: [up.csv]\n    frame: east_north\n    yaw_unit: rad\n'
    (small / "missions.yaml").write_text(one + other)
    (small / "up.csv").write_text(OF_CNS)
    frames = [(plan.frame, plan.trajectories[0].waypoints[1].yaw_rad) for plan in load_configuration(small).plans]
    assert frames == [(Frame.START_HEADING, math.radians(5.0)), (Frame.EAST_NORTH, 5.0)]


@pytest.mark.parametrize(
    "key", ["fence_m: [[-5, -5], [5, -5], [5, 5]]", "home: {latitude_deg: 47.0, longitude_deg: 8.0}"]
)
def test_what_needs_a_direction_is_refused_beside_files_that_have_none(mistake, small_file, small, key):
    (small / "up.csv").write_text("# frame: start_heading\nx,y,z,yaw_deg,holdtime\n0,0,2,0,1\n")
    name = key.split(":")[0]
    assert mistake("missions.yaml", small_file("missions.yaml") + f"    {key}\n") == (
        f"missions.yaml:5: missions.1.{name}: is given; must be left out with the frame start_heading: where its "
        "waypoints lie is known at the takeoff alone"
    )


def test_the_files_of_a_mission_are_in_one_frame(mistake, small_file, small):
    (small / "ahead.csv").write_text("# frame: start_heading\nx,y,z,yaw_deg,holdtime\n0,0,2,0,1\n")
    text = small_file("missions.yaml").replace("[up.csv]", "[ahead.csv, up.csv]")
    assert mistake("missions.yaml", text) == (
        "missions.yaml:4: missions.1.files.1: up.csv is not in metres from the heading at its takeoff; must be in the "
        "frame of the mission's other files: ahead.csv is start_heading"
    )


def test_files_that_count_from_their_own_takeoffs_stay_within_the_distance_limit_whichever_way_they_head(
    mistake, small_file, small
):
    (small / "missions.yaml").write_text(small_file("missions.yaml") + "    repetitions: 12\n")
    text = "# frame: start_heading\nx,y,z,yaw_deg,holdtime\n0,0,2,0,1\n9,0,2,0,1\n"
    assert mistake("up.csv", text) == (
        "up.csv:4: x,y: can be 108 m from the first takeoff, after the flights before it; "
        "must be below the distance limit 100, in metres"
    )


def test_files_without_a_touchdown_are_one_flight_and_mistakes_keep_their_places(mistake, small_file, small):
    (small / "on.csv").write_text("# frame: east_north\nx,y,z,yaw_rad,holdtime\n\n4,0,0.8,0,2\n")
    text = small_file("missions.yaml").replace("[up.csv]", "[up.csv, on.csv]")
    (small / "missions.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"on\.csv:4: z: is 0\.8; the first waypoint must be at the takeoff height"):
        load_configuration(small)
    (small / "missions.yaml").write_text(text + "    touchdown_between_files: false\n")
    plan = load_configuration(small).plan("1")
    (flight,) = plan.trajectories
    assert (plan.mission.files, flight.file) == (1, "up.csv + on.csv")
    assert [(each.x_m, each.z_m, each.hold_s) for each in flight.waypoints] == [(0.0, 2.0, 1.0), (4.0, 0.8, 2.0)]
    assert mistake("on.csv", HEADER + "4,0,2,0,2\n4,60,2,0,2\n") == (
        "on.csv:4: x,y,z: is 60 m from the waypoint before; must be at most 50 m away (bounds)"
    )
    assert mistake("on.csv", HEADER + "# far\n0,55,2,0,2\n").startswith("on.csv:4: x,y,z: is 55 m from the waypoint")


def test_a_hover_at_the_end_counts_for_time_and_battery(small_file, small, mistake):
    short = load_configuration(small).plan("1")
    (small / "missions.yaml").write_text(small_file("missions.yaml") + "    hover_at_end_s: 200\n")
    long = load_configuration(small).plan("1")
    assert long.trajectories[0].waypoints[-1].hold_s == short.trajectories[0].waypoints[-1].hold_s + 200.0
    assert long.as_drawn(0) == short.as_drawn(0) == short.trajectories[0]
    assert long.mission.estimated_duration_s == pytest.approx(short.mission.estimated_duration_s + 200.0)
    assert long.mission.battery_needed_fraction > short.mission.battery_needed_fraction
    text = small_file("missions.yaml") + "    hover_at_end_s: 3000\n"
    assert "its longest flight takes 30" in mistake("missions.yaml", text)


UP = Waypoint(0.0, 0.0, 2.0, 0.0, 1.0, 1)


@pytest.mark.parametrize(
    "mission_id, frame, waypoints, message",
    [
        ("1", Frame.EAST_NORTH, [UP], ": mission_id: is that of a configured mission; must be another one"),
        ("../etc", Frame.EAST_NORTH, [UP], ": mission_id: is none; must be 1 to 32 letters, digits, _ and -"),
        ("far", None, [UP], ": frame: is none; must be east_north or start_heading"),
        ("far", Frame.EAST_NORTH, [], ": has no waypoints; must have at least one"),
        ("far", Frame.EAST_NORTH, [UP, Waypoint(math.nan, 0.0, 2.0, 0.0, 0.0, 2)],
         ":2: x,y,z,yaw,hold: is (nan, 0.0, 2.0, 0.0, 0.0); must be finite numbers"),
        ("far", Frame.EAST_NORTH, [UP, Waypoint(0.0, 0.0, 2.0, -90.0, 0.0, 2)],
         ":2: yaw: is -90; must be within a turn, 6.2832 rad; are these degrees?"),
        ("far", Frame.START_HEADING, [UP, Waypoint(0.0, 60.0, 2.0, 0.0, 0.0, 2)],
         ":2: x,y,z: is 60 m from the waypoint before; must be at most 50 m away (bounds)"),
    ],
)  # fmt: skip
def test_waypoints_that_no_file_has_are_checked_as_files_are(small, mission_id, frame, waypoints, message):
    with pytest.raises(WaypointError) as caught:
        plan_of_waypoints(load_configuration(small), mission_id, frame, waypoints)
    assert str(caught.value) == f"waypoints of {mission_id!r}{message}"
    turned = Waypoint(1.0, 0.0, 2.0, -2 * math.pi, 1.0, 2)
    assert plan_of_waypoints(load_configuration(small), "far", Frame.EAST_NORTH, [UP, turned]).mission.id == "far"
    plan = plan_of_waypoints(load_configuration(small), "far", Frame.START_HEADING, [UP])
    assert (plan.mission.id, plan.frame, plan.trajectories[0].waypoints) == ("far", Frame.START_HEADING, (UP,))
    assert plan.total.duration_s > 0.0
