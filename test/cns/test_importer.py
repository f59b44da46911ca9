"""A folder of the CNS Flight Stack becomes a configuration: what is translated, what is not, what is assumed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml
from cns_folder import FILES, write_folder

from amaze_autonomy.cli import main
from amaze_autonomy.cns.importer import ImportFolderError, import_folder
from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.rules import Severity
from amaze_autonomy.engine.state import Result
from amaze_autonomy.missions import Frame, Waypoint
from amaze_autonomy.monitoring.specs import RestartPolicy
from amaze_autonomy.simulation.run import run

AHEAD = "ahead and left of each takeoff; yaw in degrees"
MAVROS = "as config/mavros has it"
AHEAD_AS_IT_SAYS = "ahead and left of each takeoff, as it says"


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "cns")


@pytest.fixture
def imported(folder, tmp_path):
    import_folder(folder, tmp_path / "config")
    return load_configuration(tmp_path / "config")


@pytest.fixture
def shipped_mavros():
    return yaml.safe_load((Path(__file__).parents[2] / "config" / "mavros" / "sensors.yaml").read_text())


def recorded(tmp_path):
    recording = yaml.safe_load((tmp_path / "config" / "recording.yaml").read_text())
    return recording["groups"]["sensors"]["topics"]


def test_every_line_is_translated_has_no_counterpart_or_is_assumed(folder, tmp_path):
    report = import_folder(folder, tmp_path / "config")
    assert report.translated == [
        "missions.yaml: 2 missions",
        "watchdog/drivers.yaml: 1 drivers",
        "watchdog/nodes.yaml: 3 nodes",
        "watchdog/topics.yaml: 4 topics",
        "/mission_cam/image_raw: topic of mission_cam, 10 Hz, tolerance 0.3, window 2 s",
        "/lrf/range: topic of lrf, 20 Hz, tolerance 0.6, window 0.2 s",
        "/mavros/imu/data_raw: topic of px4_imu, 100 Hz, tolerance 0.1, window 1 s",
        "/uwb/ranges: topic of uwb_tag_1, 5 Hz, tolerance 0.01, window 2 s",
        "/mission_cam: node of mission_cam",
        "/lrf: node of lrf, never restarted",
        "/mavros: node of px4_imu",
        "lrf_driver: driver of lrf, checked by /opt/lrf_check.sh",
        "mission_1: px4_gps, continue: severity low",
        "mission_1: px4_imu, failure: severity highest",
        "mission_1: mission_cam, hold: severity high",
        "mission_1: lrf, land: severity highest",
        "mission_1: optitrack, land: severity highest",
        "mission_2: mission_cam, land: severity highest",
        "mission_2: lrf, hold: severity high",
        "mission_cam: restarted by its node, up to 3 times",
        "lrf: restarted by /opt/lrf_restart.sh",
        f"trajectories/square/square.csv: trajectories/square/square.csv, {AHEAD}",
        "mission_1: mission 1, 1 files, flown once",
        f"trajectories/ahead.csv: trajectories/ahead.csv, {AHEAD}",
        "mission_2: mission 2, 2 files, flown 2 times",
        "mission_2: its files are one flight",
    ]
    assert report.no_counterpart == [
        "sequencer.yaml: neither missions nor a file of the watchdog",
        "/uwb/ranges: severity: 2",
        "mission_1: optitrack is watched by no topic, node or driver",
        "px4_imu: a restart; sensors of the autopilot are never restarted",
    ]
    assert report.assumed == [
        "/mission_cam/image_raw: has failed after 0.5 s of silence",
        "/lrf/range: fails below 0.2 of its rate",
        "/lrf/range: has failed after 0.3 s of silence",
        "/mavros/imu/data_raw: has failed after 0.3 s of silence",
        "/uwb/ranges: margin 0 is none here, 0.01 is taken",
        "/uwb/ranges: has failed after 1 s of silence",
        "mission_cam: roslaunch starts /mission_cam again when it ends (respawn)",
        "px4_imu: the autopilot's imu as well, by its name",
        "uwb_tag_1: severity high, no mission has an action for it",
        "uwb_tag_1: a flight waits 15 s for it, then lands",
        "px4_gps: the autopilot's gps as well, by its name",
        "mission_2: hovers at its end for 60 s, unless it is landed before, and lands",
        "sensors.yaml: landing_detection.topic: /lrf/range, which an entity watches (not with peers:=cns)",
        f"sensors.yaml: state_estimation.topic: /mavros/local_position/odom, {MAVROS} (not with peers:=cns)",
        f"sensors.yaml: state_estimation.imu_topic: /mavros/imu/data_raw, {MAVROS} (not with peers:=cns)",
        "sensors.yaml: no estimator is initialised, as its engine does by default before its checks: name the service "
        "(/ESTIMATOR/init_service) as initialisation.service, with initialisation.type: set_bool",
        "recording.yaml: one computer records the 5 topics that are watched, what our nodes say, and what mavros does",
        "autonomy.yaml: limits that its nodes need (a heartbeat of 0.5 Hz, a supervisor that answers after 10 s)",
        "autopilot.yaml: the vehicle is reached through mavros",
        "autopilot.yaml: before a takeoff parameters of the autopilot's failsafes are compared with the values that "
        "ship: compare them with what you want of your vehicle",
    ]


def test_components_have_their_sources_and_the_worst_severity_that_a_mission_has_for_them(imported):
    rules = {rule.name: rule.severity for rule in imported.rules.components}
    assert rules == {
        "mission_cam": Severity.HIGHEST,
        "lrf": Severity.HIGHEST,
        "px4_imu": Severity.HIGHEST,
        "uwb_tag_1": Severity.HIGH,
        "px4_gps": Severity.LOW,
    }
    own = {mission.id: dict(mission.severities) for mission in imported.missions}
    assert own == {"1": {"mission_cam": Severity.HIGH}, "2": {"lrf": Severity.HIGH}}
    restarts = {each.name: each.restart.policy for each in imported.components}
    assert restarts == {
        "mission_cam": RestartPolicy.NODE,
        "lrf": RestartPolicy.DRIVER,
        "px4_imu": RestartPolicy.NEVER,
        "uwb_tag_1": RestartPolicy.NEVER,
        "px4_gps": RestartPolicy.NEVER,
    }


def slow(folder, **rates):
    """Make topics of a folder slower."""
    path = folder / "watchdog" / "topics.yaml"
    topics = yaml.safe_load(path.read_text())
    for name, row in topics.items():
        row["rate"] = rates.get(name.split("/")[1], row["rate"])
    path.write_text(yaml.safe_dump(topics))


def test_what_a_slow_topic_needs_to_be_back_is_what_attempts_and_waits_have(folder, tmp_path):
    slow(folder, mission_cam=0.5, lrf=0.2, uwb=0.1)
    report = import_folder(folder, tmp_path / "config")
    configuration = load_configuration(tmp_path / "config")
    specs = {each.name: each for each in configuration.components}
    limits = [specs[name].restart.attempt_limit_ns / 1e9 for name in ("mission_cam", "lrf")]
    totals = [specs[name].restart.total_limit_ns / 1e9 for name in ("mission_cam", "lrf")]
    assert (limits, totals) == ([22.0, 30.0], [60.0, 60.0])
    assert specs["uwb_tag_1"].wait_limit_ns == 65 * 10**9
    assert configuration.rules.limits.unlisted_wait_limit_ns == 40 * 10**9
    assert [line for line in report.assumed if " s to be back" in line] == [
        "lrf: a restart has 30 s, since its topics need 25 s to be back",
        "mission_cam: a restart has 22 s, since its topics need 16 s to be back",
        "autonomy.yaml: a flight waits 40 s for what a mission holds for and another lands for, which needs 25 s "
        "to be back",
    ]


def test_what_is_too_slow_to_be_restarted_before_a_takeoff_is_not(folder, tmp_path):
    slow(folder, mission_cam=0.05)
    report = import_folder(folder, tmp_path / "config")
    specs = {each.name: each for each in load_configuration(tmp_path / "config").components}
    assert specs["mission_cam"].restart.policy is RestartPolicy.NEVER
    assert (
        "mission_cam: a restart; its topics need 160 s to be back, longer than a takeoff waits" in report.no_counterpart
    )


def test_its_trajectories_are_flown_ahead_and_in_degrees(imported):
    (trajectory,) = imported.plan("1").trajectories
    assert trajectory.frame is Frame.START_HEADING
    assert trajectory.waypoints[1] == Waypoint(3.0, 0.0, 1.5, math.radians(5.0), 1.0, 5)


def test_an_imported_mission_is_flown_to_its_end(imported):
    result = run(imported, (imported.plan("2").mission,))
    assert [each[:2] for each in result.results] == [("2", Result.COMPLETE)]


def test_options_beside_the_missions_are_those_of_every_mission_that_does_not_say_otherwise(folder, tmp_path):
    beside = "sequence_multiple_in_flight: true\nhover_after_mission_completion: true\nspare: 3\n"
    own = "    description: Square\n    hover_after_mission_completion: false\n"
    write_folder(folder, missions=beside + FILES["missions.yaml"].replace("    description: Square\n", own))
    report = import_folder(folder, tmp_path / "config")
    missions = yaml.safe_load((tmp_path / "config" / "missions.yaml").read_text())["missions"]
    assert {name: row["touchdown_between_files"] for name, row in missions.items()} == {"1": False, "2": False}
    assert {name: row.get("hover_at_end_s") for name, row in missions.items()} == {"1": None, "2": 60.0}
    assert report.translated[1:3] == [
        "missions.yaml: sequence_multiple_in_flight: True: of each mission that does not say it itself",
        "missions.yaml: hover_after_mission_completion: True: of each mission that does not say it itself",
    ]
    assert report.no_counterpart[0] == "missions.yaml: spare: 3"


@pytest.mark.parametrize(
    "said, written, words",
    [
        (
            "# frame: east_north\nx,y,z,yaw,holdtime\n",
            "# yaw_unit: deg\n",
            "east and north, as it says; yaw in degrees",
        ),
        ("# frame: start_heading\nx,y,z,yaw,holdtime\n", "# yaw_unit: deg\n", f"{AHEAD_AS_IT_SAYS}; yaw in degrees"),
        (
            "# Yaw_Unit: rad\nx,y,z,yaw,holdtime\n",
            "# frame: start_heading\n",
            "ahead and left of each takeoff; yaw in radians, as it says",
        ),
        (
            "x,y,z,yaw_rad,holdtime\n",
            "# frame: start_heading\n",
            "ahead and left of each takeoff; yaw in radians, as it says",
        ),
        (
            "# frame: start_heading\n# yaw_unit: deg\nx,y,z,yaw,holdtime\n",
            "",
            f"{AHEAD_AS_IT_SAYS}; yaw in degrees, as it says",
        ),
    ],
)
def test_what_a_trajectory_says_itself_is_kept_and_told(folder, tmp_path, said, written, words):
    rows = "0,0,2,0,0\n4,0,2,0,2\n"
    missions = FILES["missions.yaml"].replace("[ahead.csv, square/square.csv]", "[ahead.csv]")
    write_folder(folder, ahead=said + rows, missions=missions)
    report = import_folder(folder, tmp_path / "config")
    assert (tmp_path / "config" / "trajectories" / "ahead.csv").read_text() == written + said + rows
    assert f"trajectories/ahead.csv: trajectories/ahead.csv, {words}" in report.translated
    assert len(load_configuration(tmp_path / "config").plans) == len(("mission_1", "mission_2"))


def test_keys_of_a_landing_switch_name_ours_and_set_nothing(folder, tmp_path):
    own = "    description: Square\n    land_channel: 7\n    source: lab\n"
    missions = "landing_aux: {channel: 6}\n" + FILES["missions.yaml"].replace("    description: Square\n", own)
    write_folder(folder, missions=missions, sequencer="force: 2\npilot:\n  use_rc: true\n")
    report = import_folder(folder, tmp_path / "config")
    ours = "no switch lands; set land_switch.channel (from 1) and its threshold land_switch.above_us in autopilot.yaml"
    assert [line for line in report.assumed if "land_switch" in line] == [
        f"missions.yaml: landing_aux: {{'channel': 6}}: {ours}",
        f"sequencer.yaml: use_rc: True: {ours}",
        f"mission_1: land_channel: 7: {ours}",
    ]
    assert [line for line in report.no_counterpart if "channel" in line or "source" in line] == [
        "mission_1: source: lab"
    ]
    assert load_configuration(tmp_path / "config").autopilot.land_switch.channel == 0


SAMPLES = Path(__file__).parents[2] / "config"
OPENCV = b"%YAML:1.0\n---\nmatrix: !!opencv-matrix\n   rows: 3\n"
NEITHER = "camera.yaml: neither missions nor a file of the watchdog"


@pytest.mark.parametrize(
    "content, line",
    [
        (OPENCV, "camera.yaml: is not read as YAML: line 1: expected alphabetic or numeric cha"),
        (b"a: !camera {x: 1}\n", "camera.yaml: is not read as YAML: line 1: could not determine a con"),
        (b"cam0: {\n", "camera.yaml: is not read as YAML: line 2: expected the node content, but fou"),
        (b"\xff\xfe\x00", "camera.yaml: is not read as YAML: "),
        (b"when: 2020-13-45\n", "camera.yaml: is not read as YAML: month must be in 1..12"),
        (b"cam0:\n  rate: 20\n  rostopic: /cam0\n", NEITHER),
        (b"imu0: {margin: 3, window_size: 4}\n", NEITHER),
        (b"[1, 2]\n", NEITHER),
        (b"", NEITHER),
    ],
)
def test_yaml_of_others_is_left_out_and_named(folder, tmp_path, content, line):
    (folder / "camera.yaml").write_bytes(content)
    report = import_folder(folder, tmp_path / "config")
    assert report.no_counterpart[0].startswith(line)
    assert len(load_configuration(tmp_path / "config").components) == 5


def test_what_stands_beside_the_rows_of_the_watchdog_has_no_counterpart(folder, tmp_path):
    write_folder(folder, topics=f"check_rate: 2\n{FILES['watchdog/topics.yaml']}")
    report = import_folder(folder, tmp_path / "config")
    assert report.translated[3] == "watchdog/topics.yaml: 4 topics"
    assert "watchdog/topics.yaml: check_rate: 2" in report.no_counterpart


def test_bounds_of_its_sequencer_are_pointed_at_and_set_nothing(folder, tmp_path):
    write_folder(folder, sequencer="threshold: 0.3\nlimits:\n  bound_min_x: -5\n  bound_max_x: 5\n  min_z: 0\n")
    report = import_folder(folder, tmp_path / "config")
    assert [line for line in report.assumed if "cns_bounds" in line] == [
        "sequencer.yaml: bound_min_x: -5, bound_max_x: 5, min_z: 0: where waypoints may be is not taken from here; "
        "with peers:=cns say cns_bounds:=X,Y,Z,X,Y,Z, the least and the most in metres"
    ]


def test_an_estimator_that_is_initialised_is_asked_for(folder, tmp_path):
    report = import_folder(folder, tmp_path / "config")
    (line,) = [line for line in report.assumed if "initialisation" in line]
    assert line == (
        "sensors.yaml: no estimator is initialised, as its engine does by default before its checks: name the service "
        "(/ESTIMATOR/init_service) as initialisation.service, with initialisation.type: set_bool"
    )
    assert load_configuration(tmp_path / "config").initialisation.service == ""


def test_the_import_compares_the_parameters_that_both_samples_do(imported):
    written, mavros = (load_configuration(each).autopilot for each in (imported.folder, SAMPLES / "mavros"))
    assert written == mavros
    assert all((written.parameters, written.ardupilot_parameters, written.offboard_parameters))


def test_the_import_records_what_both_samples_do_besides_sensors(folder, tmp_path):
    import_folder(folder, tmp_path / "config")
    ours, shipped, mavros = (
        yaml.safe_load((each / "recording.yaml").read_text())["groups"]
        for each in (tmp_path / "config", SAMPLES, SAMPLES / "mavros")
    )
    both = [topic for topic in mavros["states"]["topics"] if topic in shipped["states"]["topics"]]
    assert ours["states"]["topics"] == both
    assert {"~journal", "~state", "watchdog/action", "data_recorder/status", "/rosout"} <= set(both)
    assert ours["vehicle"]["topics"] == [
        "/mavros/state",
        "/mavros/extended_state",
        "/mavros/battery",
        "/mavros/statustext/recv",
    ]


def test_a_topic_that_is_watched_is_recorded_once(folder, tmp_path):
    more = "/mavros/state: {entity_id: fcu, rate: 1, margin: 0.5}\n/rosout: {entity_id: fcu, rate: 1, margin: 0.5}\n"
    write_folder(folder, topics=FILES["watchdog/topics.yaml"] + more)
    import_folder(folder, tmp_path / "config")
    groups = yaml.safe_load((tmp_path / "config" / "recording.yaml").read_text())["groups"]
    assert {"/mavros/state", "/rosout"} <= set(groups["sensors"]["topics"])
    load_configuration(tmp_path / "config")  # refuses what is recorded twice


# --- trajectories -----------------------------------------------------------------------------------------------------


def with_path(path):
    return FILES["missions.yaml"].replace("[ahead.csv, square/square.csv]", f"['{path}']")


def test_the_folder_may_be_the_working_directory(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    write_folder(folder, missions=with_path("cns/trajectories/ahead.csv"))
    report = import_folder(Path(), tmp_path / "config")
    assert f"trajectories/ahead.csv: trajectories/cns/trajectories/ahead.csv, {AHEAD}" in report.translated


def test_an_absolute_path_is_taken_from_where_it_is(folder, tmp_path):
    away = tmp_path / "away" / "ahead.csv"
    away.parent.mkdir()
    away.write_text(FILES["trajectories/ahead.csv"].replace("4,0", "3,0"))
    report = import_folder(write_folder(folder, missions=with_path(away)), tmp_path / "config")
    assert f"{away}: trajectories{away}, {AHEAD}" in report.translated
    plan = load_configuration(tmp_path / "config").plan("2")
    assert [trajectory.waypoints[1].x_m for trajectory in plan.trajectories] == [3.0]


def test_one_that_is_nowhere_is_told_where_to_be_copied_and_that_helps(folder, tmp_path):
    write_folder(folder, missions=with_path("/nowhere/at/all/ahead.csv"))
    with pytest.raises(ImportFolderError) as caught:
        import_folder(folder, tmp_path / "config")
    there = folder / "nowhere" / "at" / "all" / "ahead.csv"
    assert str(caught.value) == (
        f"{folder}/missions.yaml: mission_2: filepaths has '/nowhere/at/all/ahead.csv', which is not there; "
        f"copy it to {there}"
    )
    there.parent.mkdir(parents=True)
    there.write_text(FILES["trajectories/ahead.csv"])
    import_folder(folder, tmp_path / "config")


def test_two_trajectories_of_one_name_are_not_guessed_among(folder, tmp_path):
    (folder / "old").mkdir()
    copy = folder / "old" / "ahead.csv"
    copy.write_text(FILES["trajectories/ahead.csv"])
    import_folder(folder, tmp_path / "same")  # one is as good as the other
    copy.write_text(FILES["trajectories/ahead.csv"].replace("4,0", "3,0"))
    with pytest.raises(ImportFolderError) as caught:
        import_folder(folder, tmp_path / "config")
    assert str(caught.value) == (
        f"{folder}/missions.yaml: mission_2: filepaths has 'ahead.csv', which is old/ahead.csv and "
        "trajectories/ahead.csv; must say which"
    )
    import_folder(write_folder(folder, missions=with_path("old/ahead.csv")), tmp_path / "config")


# --- scripts and names ------------------------------------------------------------------------------------------------


def test_a_script_with_arguments_is_a_program_and_its_words(folder, tmp_path):
    drivers = "lrf_driver: {entity_id: lrf, check_script: /opt/c.sh, restart_script: '/opt/y.sh usb \"3 4\"'}\n"
    report = import_folder(write_folder(folder, drivers=drivers), tmp_path / "config")
    components = {each.name: each for each in load_configuration(tmp_path / "config").components}
    assert components["lrf"].driver == ("/opt/c.sh",)
    assert components["lrf"].restart.command == ("/opt/y.sh", "usb", "3 4")
    assert "lrf: restarted by /opt/y.sh usb '3 4'" in report.translated
    assert [line for line in report.assumed if "restart_script" in line or "check_script" in line] == [
        "lrf_driver: restart_script: the program is /opt/y.sh, its arguments are usb '3 4'"
    ]


def test_what_one_entity_has_twice_is_told(folder, tmp_path):
    topics = "lrf/range: {entity_id: lrf, rate: 5, margin: 0.1}\n"
    nodes = "lrf: {entity_id: lrf, max_restart_attempts: 4, restart_timeout: 2}\n"
    drivers = "other: {entity_id: lrf, check_script: /opt/other.sh, restart_script: /opt/again.sh}\n"
    write_folder(
        folder,
        topics=FILES["watchdog/topics.yaml"] + topics,
        nodes=FILES["watchdog/nodes.yaml"] + nodes,
        drivers=FILES["watchdog/drivers.yaml"] + drivers,
    )
    report = import_folder(folder, tmp_path / "config")
    assert [line for line in report.no_counterpart if "lrf" in line] == [
        "lrf/range: /lrf/range of lrf a second time; the first of the topics counts",
        "lrf: /lrf of lrf a second time; the first of the nodes counts",
        "other: a second driver of lrf; the first counts",
    ]
    components = {each.name: each for each in load_configuration(tmp_path / "config").components}
    assert [topic.rate_hz for topic in components["lrf"].topics] == [20.0]
    assert components["lrf"].restart.command == ("/opt/lrf_restart.sh",)


NO_RANGE = FILES["watchdog/topics.yaml"].replace("/lrf/range:", "/mavros/local_position/odom:").replace("20.0", "50.0")


def test_over_mavros_the_checks_look_where_our_configuration_for_mavros_does(folder, tmp_path, shipped_mavros):
    import_folder(write_folder(folder, topics=NO_RANGE), tmp_path / "config")
    sensors = yaml.safe_load((tmp_path / "config" / "sensors.yaml").read_text())
    assert sensors["landing_detection"] == shipped_mavros["landing_detection"]
    assert sensors["state_estimation"] == {**shipped_mavros["state_estimation"], "rate_hz": 50.0}  # as it is watched
    assert recorded(tmp_path) == [
        "/mavros/imu/data_raw",
        "/mavros/local_position/odom",
        "/mavros/local_position/pose",
        "/mission_cam/image_raw",
        "/uwb/ranges",
    ]
    assert main(["check-config", str(tmp_path / "config")]) == 0


def test_topics_that_ship_and_nobody_watches_are_named_one_by_one_and_not_recorded(folder, tmp_path):
    write_folder(folder, topics="/lidar/range: {entity_id: lidar, rate: 20, margin: 0.3}\n")
    report = import_folder(folder, tmp_path / "config")
    ours = "which ships and no entity watches: name yours, and record it"
    assert [line.split(" (")[0] for line in report.assumed if ours in line] == [
        f"sensors.yaml: landing_detection.topic: /lrf/range, {ours}",
        f"sensors.yaml: state_estimation.topic: /odometry, {ours}",
        f"sensors.yaml: state_estimation.imu_topic: /px4/imu, {ours}",
    ]
    assert recorded(tmp_path) == ["/lidar/range"]
    assert main(["check-config", str(tmp_path / "config")]) == 0


def test_the_command_reports_checks_and_keeps_its_report(folder, tmp_path, capsys):
    output = tmp_path / "config"
    assert main(["import-cns", str(folder), "--output", str(output)]) == 0
    said = capsys.readouterr().out
    report = (output / "import.txt").read_text()
    assert said == f"{report}\n{output}: good: 5 components, 2 missions; read what was assumed: {output}/import.txt\n"
    assert main(["check-config", str(output)]) == 0


def test_the_command_says_what_check_config_warns_of(folder, tmp_path, capsys):
    output = tmp_path / "config"
    write_folder(folder, topics="/lidar/range: {entity_id: lidar, rate: 20, margin: 0.3}\n")
    assert main(["import-cns", str(folder), "--output", str(output)]) == 0
    warnings = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  warning: ")]
    assert main(["check-config", str(output)]) == 0
    assert warnings == capsys.readouterr().out.splitlines()[1:]
    assert warnings[0].startswith("  warning: landing_detection.topic is /lrf/range, and no component has that topic")


def test_what_was_written_and_cannot_be_flown_is_named_with_status_1(folder, tmp_path, capsys):
    write_folder(folder, ahead="x,y,z,yaw,holdtime\n0,0,2,0,0\n400,0,2,0,2\n")
    assert main(["import-cns", str(folder), "--output", str(tmp_path / "config")]) == 1
    assert capsys.readouterr().err == (
        f"import-cns: written, and to be corrected: {tmp_path}/config/trajectories/ahead.csv:5: x,y: is 400 m from the "
        "takeoff position; must be below the distance limit 100, in metres\n"
    )


FIRST = "FOLDER/missions.yaml: mission_1: "
PATHS = "must be a list of trajectories, e.g. [square.csv]"


def in_mission(keys):
    return f"missions:\n  mission_1: {{{keys}}}\n"


def two_missions(*names):
    return "missions:\n" + "".join(f"  {name}: {{filepaths: [ahead.csv]}}\n" for name in names)


@pytest.mark.parametrize(
    "changed, message",
    [
        (
            {"missions": "a: 1\n"},
            "FOLDER: no file with missions was found; must hold the missions and the watchdog's files; left out: "
            "missions.yaml: neither missions nor a file of the watchdog, sequencer.yaml: neither missions nor a file",
        ),
        (
            {"missions": "missions: [1, 2]\n"},
            "FOLDER/missions.yaml: missions is [1, 2]; must be groups by their names, e.g. mission_1",
        ),
        (
            {"missions": "missions: {mission_1: [1, 2]}\n"},
            "FOLDER/missions.yaml: mission_1: is [1, 2]; must be a group of keys",
        ),
        ({"missions": in_mission("")}, f"{FIRST}filepaths is missing; {PATHS}"),
        ({"missions": in_mission("filepaths: 5")}, f"{FIRST}filepaths is 5; {PATHS}"),
        ({"missions": in_mission("filepaths: ahead.csv")}, f"{FIRST}filepaths is 'ahead.csv'; {PATHS}"),
        ({"missions": in_mission("filepaths: []")}, f"{FIRST}filepaths is []; {PATHS}"),
        ({"missions": in_mission("filepaths: ['']")}, f"{FIRST}filepaths has ''; must be the path of a trajectory"),
        ({"missions": in_mission("filepaths: [.]")}, f"{FIRST}filepaths has '.'; must be the path of a trajectory"),
        ({"missions": in_mission("filepaths: [~]")}, f"{FIRST}filepaths has None; must be the path of a trajectory"),
        ({"missions": in_mission("filepaths: [5]")}, f"{FIRST}filepaths has 5; must be the path of a trajectory"),
        (
            {"missions": in_mission("filepaths: [ahead.csv], entities_actions: 5")},
            f"{FIRST}entities_actions is 5; must be a list of [entity, continue | hold | land | failure]",
        ),
        (
            {"missions": in_mission("filepaths: [ahead.csv], entities_actions: [[[lrf], hold]]")},
            f"{FIRST}entities_actions has [['lrf'], 'hold']; must be [entity, continue | hold | land | failure]",
        ),
        (
            {"missions": in_mission("filepaths: [ahead.csv], entities_actions: [[lrf, hold], [LRF, land]]")},
            f"{FIRST}entities_actions has LRF, which is lrf a second time; must have it once",
        ),
        (
            {"missions": in_mission("filepaths: [ahead.csv], instances: true")},
            f"{FIRST}instances is True; must be a whole number, at least 1",
        ),
        (
            {"missions": in_mission("filepaths: [ahead.csv], hover_after_mission_completion: 'false'")},
            f"{FIRST}hover_after_mission_completion is 'false'; must be true or false, without quotes",
        ),
        (
            {"missions": "sequence_multiple_in_flight: 'no'\n" + in_mission("filepaths: [ahead.csv]")},
            f"{FIRST}sequence_multiple_in_flight is 'no'; must be true or false, without quotes",
        ),
        (
            {"missions": two_missions("my mission", "my-mission")},
            "FOLDER/missions.yaml: my-mission: would be mission my-mission, as my mission is; rename one",
        ),
        (
            {"missions": two_missions("mission_1", "mission_01")},
            "FOLDER/missions.yaml: mission_01: would be mission 1, as mission_1 is; rename one",
        ),
        (
            {"missions": two_missions("mission_1", "mission_1")},
            "FOLDER/missions.yaml: is not YAML: line 3: mission_1 is there twice",
        ),
        (
            {"missions": FILES["missions.yaml"].replace("ahead.csv", "far.csv")},
            "FOLDER/missions.yaml: mission_2: filepaths has 'far.csv', which is not there; copy it to FOLDER/far.csv",
        ),
        (
            {"missions": FILES["missions.yaml"].replace("lrf, hold", "lrf, wait")},
            "FOLDER/missions.yaml: mission_2: entities_actions has ['lrf', 'wait']; must be [entity, continue | hold",
        ),
        (
            {"topics": "/a: {entity_id: a, rate: 0, margin: 0.1}\n"},
            "FOLDER/watchdog/topics.yaml: /a: rate is 0; must be above 0, in Hz",
        ),
        (
            {"topics": "/a: {entity_id: a, rate: 1}\n"},
            "FOLDER/watchdog/topics.yaml: /a: margin is missing; must be a number, not negative",
        ),
        (
            {"topics": "/a: {entity_id: [a], rate: 1}\n"},
            "FOLDER/watchdog/topics.yaml: /a: entity_id is ['a']; must be a text",
        ),
        (
            {"drivers": "d: {entity_id: LRF, check_script: /c}\n"},
            "FOLDER/watchdog/drivers.yaml: d: the entities LRF and lrf would both be lrf; rename one",
        ),
        *(
            (
                {"drivers": f"d: {{entity_id: lrf, check_script: {script}}}\n"},
                f"FOLDER/watchdog/drivers.yaml: d: check_script is {said}; must be a program and its arguments, with",
            )
            for script, said in (
                ("[c]", "['c']"),
                ("5", "5"),
                ("'cd /x && ./y'", "'cd /x && ./y'"),
                ("$HOME/y", "'$HOME/y'"),
                ("~/y", "'~/y'"),
                ('"/y \'"', '"/y \'"'),
                ("' '", "' '"),
            )
        ),
        (
            {"ahead": "# frame: start_heading\n# frame: east_north\nx,y,z,yaw,holdtime\n0,0,2,0,0\n"},
            "FOLDER/trajectories/ahead.csv:2: frame: is said twice; must stand in one line; see line 1",
        ),
        (
            {"ahead": "# yaw_unit: deg\n\nx,y,z,yaw_rad,holdtime\n0,0,2,0,0\n"},
            "FOLDER/trajectories/ahead.csv:3: yaw_unit: the file says rad, and beside it deg is said; must be ",
        ),
        (
            {"ahead": "# frame: ahead\nx,y,z,yaw,holdtime\n0,0,2,0,0\n"},
            "FOLDER/trajectories/ahead.csv:1: frame: is 'ahead'; must be east_north or start_heading",
        ),
        (
            {"nodes": "/lrf: {entity_id: lrf\n"},
            "FOLDER/watchdog/nodes.yaml: is not YAML: line 2: expected ',' or '}', but got '<stream end>'",
        ),
        (
            {"missions": "missions: !mine {}\n"},
            "FOLDER/missions.yaml: is not YAML: line 1: could not determine a const",
        ),
    ],
)
def test_what_cannot_be_imported_is_named_and_nothing_is_written(folder, tmp_path, changed, message):
    write_folder(folder, **changed)
    with pytest.raises(ImportFolderError) as caught:
        import_folder(folder, tmp_path / "config")
    assert str(caught.value).replace(str(folder), "FOLDER").startswith(message)
    assert not (tmp_path / "config").exists()


def test_a_folder_that_is_in_use_is_never_written_to(folder, tmp_path):
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "missions.yaml").write_text("mine\n")
    with pytest.raises(ImportFolderError, match="is there already; name an empty or a new folder"):
        import_folder(folder, tmp_path / "config")
    assert [path.name for path in (tmp_path / "config").iterdir()] == ["missions.yaml"]
