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
    return [topic for group in recording["groups"].values() for topic in group["topics"]]


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
        "recording.yaml: one computer records the 5 topics that are watched",
        "autonomy.yaml: limits that its nodes need (a heartbeat of 0.5 Hz, a supervisor that answers after 10 s)",
        "autopilot.yaml: the vehicle is reached through mavros",
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
    assert [line.split(" (")[0] for line in report.assumed if line.startswith("sensors.yaml")] == [
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


def test_what_was_written_and_cannot_be_flown_is_named_with_status_1(folder, tmp_path, capsys):
    write_folder(folder, ahead="x,y,z,yaw,holdtime\n0,0,2,0,0\n400,0,2,0,2\n")
    assert main(["import-cns", str(folder), "--output", str(tmp_path / "config")]) == 1
    assert capsys.readouterr().err == (
        f"import-cns: written, and to be corrected: {tmp_path}/config/trajectories/ahead.csv:5: x,y: is 400 m from the "
        "takeoff position; must be below the distance limit 100, in metres\n"
    )


@pytest.mark.parametrize(
    "changed, message",
    [
        (
            {"missions": "a: 1\n"},
            "FOLDER: no file with missions was found; must hold the missions and the watchdog's files",
        ),
        ({"missions": "missions: {mission_1: {}}\n"}, "mission_1: has no filepaths; must name its trajectories"),
        (
            {"missions": FILES["missions.yaml"].replace("ahead.csv", "far.csv")},
            "mission_2: far.csv is not below FOLDER; copy its trajectories there",
        ),
        (
            {"missions": FILES["missions.yaml"].replace("lrf, hold", "lrf, wait")},
            "mission_2: entities_actions has ['lrf', 'wait']; must be [entity, continue | hold | land | failure]",
        ),
        ({"topics": "/a: {entity_id: a, rate: 0, margin: 0.1}\n"}, "/a: rate is 0; must be above 0, in Hz"),
        ({"topics": "/a: {entity_id: a, rate: 1}\n"}, "/a: margin is None; must be a number, not negative"),
        (
            {"drivers": "d: {entity_id: LRF, check_script: /c}\n"},
            "d: the entities LRF and lrf would both be lrf; rename one",
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
        ({"nodes": "{"}, "FOLDER/watchdog/nodes.yaml: is not YAML: "),
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
