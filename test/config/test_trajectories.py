"""Waypoint files that missions name."""

from __future__ import annotations

import pytest

from amaze_autonomy.config import ConfigError, load_configuration

HEADER = "x,y,z,yaw,holdtime\n"
COLUMNS = "must be the columns x,y,z,yaw,holdtime, separated by commas (yaw in radians, or yaw_deg in degrees)"


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


def test_a_file_that_is_no_csv_is_refused(mistake, small_file):
    assert mistake("missions.yaml", small_file("missions.yaml").replace("up.csv", "sensors.yaml")) == (
        "missions.yaml:4: missions.1.files.0: is the text 'sensors.yaml'; "
        'must be a file inside the folder of the configuration, e.g. "trajectories/square.csv"'
    )


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "missions.yaml:4: missions.1.files.0: up.csv is missing, empty or cannot be read; "
         "must be a waypoint file in FOLDER"),
        ("\n", f"up.csv: is empty; {COLUMNS}"),
        (HEADER, "up.csv:1: has no waypoints; must have at least one line below the header"),
        (HEADER + "0,0,two,0,1\n", "up.csv:2: z: is 'two'; must be a finite number"),
        (HEADER + "0,0,0.3,0,1\n",
         "up.csv:2: z: is 0.3; must be at least 0.5 and below the height limit 30, in metres"),
        (HEADER + "0,0,0.8,0,1\n",
         "up.csv:2: z: is 0.8; the first waypoint must be at the takeoff height (1 m) or above"),
        (HEADER + "0,0,30,0,1\n",
         "up.csv:2: z: is 30; must be at least 0.5 and below the height limit 30, in metres"),
        (HEADER + "0,0,2,0,1\n\n# far\n60,80,2,0,1\n",
         "up.csv:5: x,y: is 100 m from the takeoff position; must be below the distance limit 100, in metres"),
        (HEADER + "0,0,2,0,1\n0,51,2,0,1\n",
         "up.csv:3: x,y,z: is 51 m from the waypoint before; must be at most 50 m away (bounds)"),
        (HEADER + "11,0,1,0,1\n",
         "up.csv:2: x,y,z: is 11 m from the takeoff; must be at most 10 m away (bounds)"),
        (HEADER + "0,0,2,0,-1\n", "up.csv:2: holdtime: is -1; must be 0 to 120, in seconds"),
        (HEADER + "0,0,2,0,2000\n", "up.csv:2: holdtime: is 2000; must be 0 to 120, in seconds"),
    ],
)  # fmt: skip
def test_a_waypoint_file_that_cannot_be_flown_is_named_with_line_and_column(mistake, text, message):
    assert mistake("up.csv", text) == message


def test_the_limits_of_the_mission_count_for_its_files(mistake, small, small_file):
    (small / "missions.yaml").write_text(small_file("missions.yaml") + "    limits: {max_height_m: 2.0}\n")
    assert mistake("up.csv", HEADER + "0,0,2,0,1\n") == (
        "up.csv:2: z: is 2; must be at least 0.5 and below the height limit 2, in metres"
    )


def test_a_repetition_starts_where_the_last_file_landed(mistake, small, small_file):
    (small / "missions.yaml").write_text(small_file("missions.yaml") + "    repetitions: 2\n")
    assert mistake("up.csv", HEADER + "0,0,2,0,1\n15,0,2,0,1\n") == (
        "up.csv:2: x,y,z: is 15.0333 m from the takeoff; must be at most 10 m away (bounds)"
    )


def test_too_many_waypoints_are_refused(mistake):
    assert (
        mistake("up.csv", HEADER + "0,0,2,0,1\n" * 501)
        == "up.csv:502: has 501 waypoints; must have at most 500 (bounds)"
    )


def test_a_waypoint_file_that_is_not_utf8_is_named_with_its_line(small):
    (small / "up.csv").write_bytes(HEADER.encode() + b"0,0,2,0,1\n\xff\n")
    with pytest.raises(ConfigError) as caught:
        load_configuration(small)
    assert str(caught.value) == f"{small}/up.csv:3: is not UTF-8; must be saved as UTF-8 text"


def test_a_spreadsheets_byte_order_mark_and_line_ends_are_taken(small):
    (small / "up.csv").write_bytes(b"\xef\xbb\xbfx,y,z,yaw_deg,holdtime\r\n0,0,2,90,1\r\n")
    (waypoint,) = load_configuration(small).plans[0].trajectories[0].waypoints
    assert (waypoint.z_m, round(waypoint.yaw_rad, 6), waypoint.line) == (2.0, 1.570796, 2)
