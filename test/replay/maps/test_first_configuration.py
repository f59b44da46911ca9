"""A first configuration of a recording that nobody described is good, and says what was assumed."""

from __future__ import annotations

import errno
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from replay_bags import START_NS, S, distance, header, height_m, imu, magnetic, make, write_bag
from test_proposal import extended, types

from amaze_autonomy import cli, files, paths
from amaze_autonomy.config import AutopilotSettings, load_configuration
from amaze_autonomy.config.consistency import contradictions, unrecorded_topics
from amaze_autonomy.replay.maps.topic_map import load_map

COMPARED = ("parameters", "ardupilot_parameters", "offboard_parameters")


def proposed(capsys, tmp_path, *bags):
    """Return the exit status, what was printed, and the folder."""
    folder = tmp_path / "config"
    status = cli.main(["propose-config", *map(str, bags), "--output", str(folder)])
    out, err = capsys.readouterr()
    return status, out + err, folder


def test_a_flight_becomes_a_configuration_without_contradictions(capsys, tmp_path, flight_bag):
    status, said, folder = proposed(capsys, tmp_path, flight_bag)
    assert status == 0, said
    effective = load_configuration(folder).effective
    assert [*contradictions(effective), *unrecorded_topics(effective["sensors"], effective["recording"])] == []
    sensors = effective["sensors"]
    rows = {name: (row["group"], row["severity"], *row["topics"]) for name, row in sensors["components"].items()}
    assert rows == {
        "imu": ("other", "highest", "/imu"),
        "magnetometer": ("other", "moderate", "/mag"),
        "lrf": ("other", "high", "/range"),
    }
    assert sensors["components"]["imu"]["topics"]["/imu"]["rate_hz"] == 50.0
    assert (sensors["landing_detection"]["topic"], sensors["landing_detection"]["source"]) == ("/range", "range")
    assert sensors["state_estimation"]["imu_topic"] == "/imu"
    assert (folder / "propose.txt").read_text().strip() in said
    assert "lrf: /range" in said


@pytest.mark.parametrize("at", ["/mavros", "/uav1/mavros"])
def test_what_comes_over_mavros_is_of_the_autopilot_and_flown_through_it(capsys, tmp_path, at):
    raw = [(t, f"{at}/imu/data_raw", imu(t)) for t in range(START_NS, START_NS + 5 * S, S // 50)]
    mag = [(t, f"{at}/imu/mag", magnetic(t)) for t in range(START_NS, START_NS + 5 * S, S // 50)]
    rows = sorted((*poses((f"{at}/local_position/pose", 0.0)), *raw, *mag), key=lambda row: row[0])
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert status == 0, said
    sensors = yaml.safe_load((folder / "sensors.yaml").read_text())
    assert {name: row["group"] for name, row in sensors["components"].items()} == {"imu": "px4", "magnetometer": "px4"}
    assert [row for row in sensors["components"].values() if "restart" in row] == []
    assert (sensors["landing_detection"]["topic"], sensors["landing_detection"]["source"]) == (
        f"{at}/local_position/pose",
        "pose",
    )
    assert reached(folder) == {"backend": "mavros", "mavros": at}
    assert "landing_detection: no range finder" in said
    assert f"autopilot.yaml: the vehicle is reached through mavros at {at}\n" in said
    assert [line for line in said.splitlines() if "says that mavros is at" in line] == []


def reached(folder):
    """Return what autopilot.yaml says but for the parameters that are compared."""
    vehicle = yaml.safe_load((folder / "autopilot.yaml").read_text())
    return {name: value for name, value in vehicle.items() if name not in COMPARED}


def test_of_two_vehicles_behind_mavros_one_is_taken_and_both_are_named(capsys, tmp_path):
    more = [(t, "/uav2/mavros/imu/data_raw", imu(t)) for t in range(START_NS, START_NS + 5 * S, S // 50)]
    one, other = (f"/uav{number}/mavros/local_position/pose" for number in (1, 2))
    bag = write_bag(tmp_path / "x.bag", sorted((*poses((one, 0.0), (other, 0.0)), *more), key=lambda row: row[0]))
    status, said, folder = proposed(capsys, tmp_path, bag)
    assert status == 0, said
    assert reached(folder) == {"backend": "mavros", "mavros": "/uav2/mavros"}
    words = "through mavros at /uav2/mavros; seen was /uav1/mavros, too: is it the right one?"
    assert f"autopilot.yaml: the vehicle is reached {words}\n" in said


def test_without_mavros_the_vehicle_is_reached_over_mavlink_where_the_file_says(capsys, tmp_path, flight_bag):
    status, said, folder = proposed(capsys, tmp_path, flight_bag)
    assert status == 0, said
    urls = ("udpin:127.0.0.1:14540", "udpin:127.0.0.1:14541")
    assert reached(folder) == {name: {"url": url} for name, url in zip(("link", "planner_link"), urls)}
    assert load_configuration(folder).autopilot.link == AutopilotSettings().link
    words = "over MAVLink; its address is in autopilot.yaml, link.url and planner_link.url"
    assert f"autopilot.yaml: the vehicle is reached {words}\n" in said


def poses(*topics):
    """Return rows of poses at rest, 30 a second: of each topic its height, and 0 where its orientation is none."""
    times = range(START_NS, START_NS + 5 * S, S // 30)
    return [(t, topic, _pose(t, *height_m)) for t in times for topic, *height_m in topics]


ESTIMATE, COMMAND = ("/mavros/local_position/pose", 0.0), ("/command/pose", 2.0)


@pytest.mark.parametrize("topics", [(ESTIMATE,), (COMMAND, ESTIMATE), (("/a/pose", 0.0, 0.0), ESTIMATE)])
def test_without_a_range_finder_the_height_is_that_of_the_estimate(capsys, tmp_path, topics):
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", with_imu(poses(*topics))))
    assert status == 0, said
    landing = load_configuration(folder).effective["sensors"]["landing_detection"]
    assert (landing["topic"], landing["source"]) == ("/mavros/local_position/pose", "pose")
    assert "landing_detection: no range finder; the height of /mavros/local_position/pose, 0 on the ground\n" in said


def test_beside_an_odometry_of_mavros_its_pose_is_the_height(capsys, tmp_path):
    odometry = [(t, "/mavros/local_position/odom", _odometry(t)) for t in range(START_NS, START_NS + 5 * S, S // 30)]
    bag = write_bag(tmp_path / "x.bag", with_imu([*odometry, *poses(COMMAND, ESTIMATE)]))
    status, said, folder = proposed(capsys, tmp_path, bag)
    assert status == 0, said
    sensors = load_configuration(folder).effective["sensors"]
    assert sensors["state_estimation"]["topic"] == "/mavros/local_position/odom"
    assert sensors["landing_detection"]["topic"] == "/mavros/local_position/pose"


@pytest.mark.parametrize(
    "topics, named",
    [
        ((COMMAND,), "/command/pose"),
        ((COMMAND, ("/a/target", 0.0)), "/a/target or /command/pose"),
        ((("/a/pose", 0.0, 0.0),), "/a/pose"),
        ((("/a/pose", 0.0), ("/b/pose", 0.0)), "/a/pose or /b/pose"),
    ],
)
def test_a_pose_that_nothing_says_is_the_vehicle_s_is_no_height_above_ground(capsys, tmp_path, topics, named):
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", with_imu(poses(*topics))))
    assert status == 0, said
    assert yaml.safe_load((folder / "sensors.yaml").read_text())["landing_detection"] == {}
    words = "and nothing says that it is the vehicle's, 0 on the ground: name its topic"
    assert f"landing_detection: no range finder; a height is in {named}, {words}\n" in said


def test_failsafe_parameters_are_compared_with_those_that_ship_and_that_is_assumed(capsys, tmp_path, flight_bag):
    status, said, folder = proposed(capsys, tmp_path, flight_bag)
    assert status == 0, said
    shipped = yaml.safe_load((paths.config_folder() / "autopilot.yaml").read_text())
    written = yaml.safe_load((folder / "autopilot.yaml").read_text())
    assert [written[name] for name in COMPARED] == [shipped[name] for name in COMPARED]
    assert "  # what PX4 does by itself about a low battery" in (folder / "autopilot.yaml").read_text()
    (line,) = [line for line in (folder / "propose.txt").read_text().splitlines() if "parameters" in line]
    assert line == (
        "autopilot.yaml: before a takeoff parameters of the autopilot's failsafes are compared with the values that "
        "ship: compare them with what you want of your vehicle"
    )


def images(tmp_path, *topics):
    """Return a recording with cameras of these topics."""
    step_ns, rows = S // 10, []
    for t_ns in range(START_NS, START_NS + 5 * S, step_ns):
        rows += [(t_ns, topic, _image(t_ns)) for topic in topics]
    return write_bag(tmp_path / "cameras.bag", rows)


def _image(t_ns):
    size = {"height": 1, "width": 1, "encoding": "mono8", "is_bigendian": 0, "step": 1}
    return make("sensor_msgs/msg/Image", header=header(t_ns), data=np.zeros(1, dtype=np.uint8), **size)


@pytest.mark.parametrize(
    "topic, name, row",
    [
        ("/mission_camera/image_raw", "mission_camera", "mission_camera"),
        ("/mission_camera/image_small", "mission_camera_image_small", "mission_camera"),
        ("/realsense/image_raw", "realsense", "realsense_camera"),
        ("/realsense/depth/image", "realsense_depth", "realsense_camera"),
    ],
    ids=["by its name", "by its node", "by its topic", "by its node, with others of it"],
)
def test_a_component_is_as_bad_as_the_decision_table_that_ships_has_it(capsys, tmp_path, topic, name, row):
    status, said, folder = proposed(capsys, tmp_path, images(tmp_path, topic))
    assert status == 0, said
    shipped = yaml.safe_load((paths.config_folder() / "sensors.yaml").read_text())["components"][row]
    found = yaml.safe_load((folder / "sensors.yaml").read_text())["components"][name]
    assert [found.get(key) for key in ("severity", "wait_limit_s")] == [
        shipped.get(key) for key in ("severity", "wait_limit_s")
    ]
    like = "" if name == row else f", as {row} of the decision table"
    assert f"{name}: {topic}, 10 Hz, fails after 0.5 s; severity {shipped['severity']}{like}\n" in said
    (replayed,) = load_map(str(folder / "map.yaml")).components
    assert (replayed.severity, replayed.wait_limit_ns) == (None, None)  # as configured


def heard(graph, *senders):
    """Return what was heard for five seconds of nodes that publish an IMU on one topic: each with its rate."""
    found, headers = graph.Heard(), []
    for node, rate_hz in senders:
        headers.append({"callerid": node, "type": "sensor_msgs/Imu", "md5sum": "6a62"})
        for number in range(5 * rate_hz):
            message = SimpleNamespace(_connection_header=headers[-1], _buff=b"")
            found.take_at(START_NS + number * S // rate_hz + len(headers), "/imu", message)
    found.connected("/imu", headers)
    return found


@pytest.mark.parametrize(
    "senders, said",
    [
        ((("/imu_driver", 50),), ""),
        (
            (("/other", 20), ("/imu_driver", 50)),
            "found: /imu has two publishers: /imu_driver, /other; stop or rename one, taken is the rate of /imu_driver",
        ),
    ],
)
def test_the_rate_of_a_topic_with_two_publishers_is_that_of_one_and_it_is_said(
    capsys, monkeypatch, tmp_path, senders, said
):
    graph = pytest.importorskip("amaze_autonomy.ros.graph", reason="needs ROS")
    monkeypatch.setattr(graph.rospy, "get_time", lambda: 0.0)
    monkeypatch.setattr(graph, "listen", lambda _: heard(graph, *senders))
    folder = tmp_path / "config"
    status = cli.main(["propose-config", "--live", "--output", str(folder)])
    assert status == 0, capsys.readouterr().out
    found = yaml.safe_load((folder / "sensors.yaml").read_text())["components"]["imu"]["topics"]["/imu"]
    assert found["rate_hz"] == 50.0
    assumed = (folder / "propose.txt").read_text().splitlines()
    assert [line for line in assumed if "publishers" in line] == [said] * bool(said)


def test_what_no_decision_table_knows_is_moderate(capsys, tmp_path):
    status, said, folder = proposed(capsys, tmp_path, images(tmp_path, "/fisheye/image_raw"))
    assert status == 0, said
    found = yaml.safe_load((folder / "sensors.yaml").read_text())["components"]["fisheye"]
    assert (found["severity"], found["wait_limit_s"]) == ("moderate", 10.0)
    assert "; severity moderate, as what no decision table knows\n" in said


def test_a_topic_whose_name_begins_with_a_digit_somewhere_is_as_good_as_others(capsys, tmp_path):
    raw = [(t, "/2d/0/imu", imu(t)) for t in range(START_NS, START_NS + 5 * S, S // 50)]
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", raw))
    assert status == 0, said
    assert load_configuration(folder).state_estimation.imu_topic == "/2d/0/imu"


def with_imu(rows):
    more = [(t, "/imu", imu(t)) for t in range(START_NS, START_NS + 5 * S, S // 50)]
    return sorted((*rows, *more), key=lambda row: row[0])


def slow_range(tmp_path, rate_hz, count=12):
    """Return a recording, at rest, with a range finder of this rate."""
    times = [START_NS + round(step / rate_hz * S) for step in range(count)]
    return write_bag(tmp_path / "slow.bag", with_imu([(t, "/range", distance(t, 0.1)) for t in times]))


@pytest.mark.parametrize(
    "rate_hz, window_s, age_limit_s",
    [(2.0, 1.5, 2.0), (1.0, 1.5, 4.0), (0.5, 1.5, 5.0), (0.1, 1.5, 5.0), (0.006, 1.5, 5.0)],
)
def test_a_range_finder_too_slow_to_land_by_is_told_and_the_configuration_is_good(
    capsys, tmp_path, rate_hz, window_s, age_limit_s
):
    status, said, folder = proposed(capsys, tmp_path, slow_range(tmp_path, rate_hz))
    assert status == 0, said
    landing = load_configuration(folder).effective["sensors"]["landing_detection"]
    assert (landing["window_s"], landing["age_limit_s"]) == (window_s, age_limit_s)
    told = f"found: /range comes at {rate_hz:g} Hz, too slow to land by: take a faster one for landing_detection"
    assert told in (folder / "propose.txt").read_text().splitlines()
    assert told.replace("found: ", "#   ") in (folder / "map.yaml").read_text().splitlines()
    assert load_map(str(folder / "map.yaml")).landing["window_ns"] == window_s * S


@pytest.mark.parametrize(
    "rate_hz, row, words",
    [
        (2.0, ("high", 15.0), "severity high"),
        (0.1, ("high", 60.0), "severity high, a flight waits 60 s for it"),
        (0.006, ("highest", None), "severity highest, too slow to be waited for"),
    ],
)
def test_a_sensor_is_waited_for_as_long_as_it_needs_to_be_back_or_not_at_all(capsys, tmp_path, rate_hz, row, words):
    status, said, folder = proposed(capsys, tmp_path, slow_range(tmp_path, rate_hz))
    assert status == 0, said
    found = load_configuration(folder).effective["sensors"]["components"]["lrf"]
    assert (found["severity"], found["wait_limit_s"]) == row
    (line,) = [line for line in (folder / "propose.txt").read_text().splitlines() if line.startswith("lrf: ")]
    assert line.endswith(f"; {words}")


def test_a_range_finder_that_is_fast_enough_is_not_called_slow(capsys, tmp_path):
    status, said, folder = proposed(capsys, tmp_path, slow_range(tmp_path, 4.0))
    assert status == 0, said
    assert load_configuration(folder).effective["sensors"]["landing_detection"]["window_s"] == 1.0
    assert "too slow" not in said


def test_an_estimate_slower_than_any_that_is_checked_is_a_good_configuration(capsys, tmp_path):
    rows = [(t, "/vio/pose", _pose(t)) for t in range(START_NS, START_NS + 200 * S, 20 * S)]
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", with_imu(rows)))
    assert status == 0, said
    assert load_configuration(folder).state_estimation.rate_hz == 0.1


def test_what_check_config_warns_of_is_said_at_once(capsys, tmp_path):
    raw = [(t, "/imu", imu(t)) for t in range(START_NS, START_NS + 5 * S, S // 50)]
    once = [(START_NS, "/somebody/elses", magnetic(START_NS))]
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", (*once, *raw)))
    assert status == 0, said
    warnings = [line for line in said.splitlines() if line.startswith("  warning: ")]
    assert cli.main(["check-config", str(folder)]) == 0
    assert warnings == capsys.readouterr().out.splitlines()[1:]
    assert any(
        "records /somebody/elses, which no sensor, no node of ours and no map names" in line for line in warnings
    )


def _pose(t_ns, height_m=0.0, w=1.0):
    return make("geometry_msgs/msg/PoseStamped", header=header(t_ns), pose=_place(height_m, w))


def _place(height_m=0.0, w=1.0):
    position = make("geometry_msgs/msg/Point", x=0.0, y=0.0, z=height_m)
    orientation = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=w)
    return make("geometry_msgs/msg/Pose", position=position, orientation=orientation)


def _odometry(t_ns):
    still, zeros = make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0), np.zeros(36)
    twist = make("geometry_msgs/msg/Twist", linear=still, angular=still)
    return make(
        "nav_msgs/msg/Odometry",
        header=header(t_ns),
        child_frame_id="base_link",
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=_place(), covariance=zeros),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zeros),
    )


def test_a_recording_without_a_sensor_is_no_configuration(capsys, tmp_path):
    bag = write_bag(tmp_path / "one.bag", [(START_NS, "/imu", imu(START_NS))])
    status, said, folder = proposed(capsys, tmp_path, bag)
    assert (status, folder.exists()) == (1, False)
    assert "no sensor was seen that keeps a rate" in said


def test_a_folder_with_files_is_not_written_to(capsys, tmp_path, flight_bag):
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "mine.yaml").write_text("a: 1\n")
    status, said, folder = proposed(capsys, tmp_path, flight_bag)
    assert status == 1
    assert said == f"propose-config: {folder}: is there already; name an empty or a new folder with --output\n"
    assert [path.name for path in folder.iterdir()] == ["mine.yaml"]


@pytest.mark.parametrize("is_there", [False, True])
def test_a_full_disk_leaves_nothing_and_is_told_of_the_folder(capsys, tmp_path, flight_bag, monkeypatch, is_there):
    folder = tmp_path / "deep" / "config"
    if is_there:
        folder.mkdir(parents=True)
    before = folder.stat().st_ino if is_there else None
    with monkeypatch.context() as patched:
        patched.setattr(files.os, "fsync", full)
        status, said, _ = proposed(capsys, tmp_path / "deep", flight_bag)
    assert (status, said) == (1, f"amaze-autonomy: {folder}: No space left on device\n")
    assert list(folder.parent.rglob("*")) == ([folder] if is_there else [])
    (folder / ".part" if is_there else folder.with_name(".config.part")).mkdir()  # as a killed process leaves it
    assert proposed(capsys, tmp_path / "deep", flight_bag)[0] == 0
    assert (folder / "trajectories" / "hop.csv").is_file()
    assert not list(folder.parent.rglob(".*"))
    assert before in (None, folder.stat().st_ino)


def full(_):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_recordings_or_the_running_graph_must_be_named(capsys, tmp_path):
    assert proposed(capsys, tmp_path)[:2] == (2, "propose-config: name recordings, or say --live\n")


# --- which of several -------------------------------------------------------------------------------------------------

HEXA, PAD = "/vrpn_client_node/hexa/pose", "/vrpn_client_node/charging_pad/pose"
DOWN, LEFT, UP = "/tfmini", "/obstacle/lidar_left/range", "/ultrasonic_up/range"


def flown(streams, *, told, until_s=36.0):
    """Return rows of the flight of `height_m`, 20 a second of each stream; `told`: mavros says when it flies."""
    types()
    rows = []
    for step in range(int(until_s * 20)):
        at, height = START_NS + step * S // 20, height_m(step / 20)
        rows += [(at, topic, message(at, height)) for topic, message in streams.items()]
        if told and step % 10 == 0:
            rows.append((at, "/mavros/extended_state", extended(at, 2 if height > 0.05 else 1)))
    return with_imu(rows)


BODIES = {PAD: lambda at, _: _pose(at), HEXA: lambda at, height: _pose(at, height)}
FINDERS = {
    LEFT: lambda at, _: distance(at, 0.4),
    DOWN: lambda at, height: distance(at, height + 0.12),
    UP: lambda at, height: distance(at, 4.0 - height),
}


@pytest.mark.parametrize("told", [True, False], ids=["told", "not told"])
def test_of_two_bodies_the_vehicle_is_the_one_that_rises(capsys, tmp_path, told):
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", flown(BODIES, told=told)))
    assert status == 0, said
    sensors = load_configuration(folder).effective["sensors"]
    assert [sensors[check]["topic"] for check in ("landing_detection", "state_estimation")] == [HEXA, HEXA]
    assert f"found: not watched: {PAD} (another estimate)\n" in said
    stays = f"{PAD} does not rise while the vehicle is in the air: it does not show its height, and is left out\n"
    assert (stays in said) is told


@pytest.mark.parametrize("told", [True, False], ids=["told", "not told"])
def test_of_several_range_finders_the_one_that_rises_looks_down(capsys, tmp_path, told):
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", flown(FINDERS, told=told)))
    assert status == 0, said
    sensors = load_configuration(folder).effective["sensors"]
    assert (sensors["landing_detection"]["topic"], sensors["landing_detection"]["mounting_height_m"]) == (DOWN, 0.12)
    assert list(sensors["components"]["lrf"]["topics"]) == [DOWN]
    assert f"found: not watched: {LEFT} (another lrf), {UP} (another lrf)\n" in said


def test_of_several_that_rise_one_is_taken_and_all_are_named(capsys, tmp_path):
    other = "/lidar_down/range"
    rows = flown({other: FINDERS[DOWN], DOWN: FINDERS[DOWN]}, told=True)
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert status == 0, said
    assert load_configuration(folder).effective["sensors"]["landing_detection"]["topic"] == other
    assert f"found: {other}, {DOWN}: all of them rise; taken is {other}: is it the right one?\n" in said


def test_the_only_range_finder_is_left_out_where_it_shows_no_flight(capsys, tmp_path):
    rows = flown({LEFT: FINDERS[LEFT], HEXA: BODIES[HEXA]}, told=True)
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert status == 0, said
    sensors = load_configuration(folder).effective["sensors"]
    assert (sensors["landing_detection"]["topic"], list(sensors["components"])) == (HEXA, ["imu"])
    stays = "does not rise while the vehicle is in the air: it does not show its height, and is left out"
    assert f"found: {LEFT} {stays}\n" in said


@pytest.mark.parametrize(
    "streams, taken",
    [(BODIES, ""), (FINDERS, ""), ({LEFT: FINDERS[LEFT], "/down/range": FINDERS[DOWN]}, "/down/range")],
    ids=["bodies", "range finders", "one by its name"],
)
def test_of_several_that_stand_none_is_taken_but_by_its_name(capsys, tmp_path, streams, taken):
    rows = flown(streams, told=True, until_s=6.0)
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert status == 0, said
    landing = yaml.safe_load((folder / "sensors.yaml").read_text())["landing_detection"]
    assert landing.get("topic", "") == taken
    words = "none of them rises, and nothing says which shows the vehicle's height: name it"
    assert (f"found: {', '.join(sorted(streams))}: {words}\n" in said) is (not taken)


def test_a_scanner_beside_a_range_finder_is_not_the_one_that_lands(capsys, tmp_path):
    still, numbers = {"angle_min": -1.0, "angle_max": 1.0, "angle_increment": 0.1}, np.full(21, 5.0, np.float32)
    limits = {"time_increment": 0.0, "scan_time": 0.1, "range_min": 0.1, "range_max": 30.0}

    def scan(at, _):
        rows = {"ranges": numbers, "intensities": numbers[:0]}
        return make("sensor_msgs/msg/LaserScan", header=header(at), **still, **limits, **rows)

    rows = flown({"/rplidar/scan": scan, DOWN: FINDERS[DOWN]}, told=True)
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert status == 0, said
    sensors = load_configuration(folder).effective["sensors"]
    assert sensors["landing_detection"]["topic"] == DOWN
    assert list(sensors["components"]["lrf"]["topics"]) == [DOWN]
    assert "found: not watched: /rplidar/scan (another lrf)\n" in said


# --- range finders that see nothing -----------------------------------------------------------------------------------


def test_a_range_finder_that_begins_with_0_has_measured_no_ground(capsys, tmp_path):
    blind = {"/range": lambda at, height: distance(at, height if height >= 0.3 else 0.0)}
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", flown(blind, told=True)))
    assert status == 0, said
    landing = yaml.safe_load((folder / "sensors.yaml").read_text())["landing_detection"]
    assert landing == {"topic": "/range", "source": "range"}
    words = "measure mounting_height_m and min_range_m, below which it sees nothing"
    assert f"found: /range begins with 0, which is no distance: {words}\n" in said
    assert "found: lift-off by the range: +8.2 s\n" in said


def test_a_range_finder_that_says_0_until_it_has_begun_has_measured_the_ground(capsys, tmp_path):
    rows = flown({"/range": lambda at, height: distance(at, height + 0.12)}, told=True)
    for row in [row for row in rows if row[1] == "/range"][:10]:
        row[2].range = 0.0
    status, said, folder = proposed(capsys, tmp_path, write_bag(tmp_path / "x.bag", rows))
    assert status == 0, said
    landing = yaml.safe_load((folder / "sensors.yaml").read_text())["landing_detection"]
    assert landing == {"topic": "/range", "source": "range", "mounting_height_m": 0.12, "min_range_m": 0.02}


# --- clocks and names -------------------------------------------------------------------------------------------------


def test_a_sensor_whose_messages_mostly_share_a_time_of_the_simulation_has_its_mean_rate(capsys, tmp_path):
    rows = [(START_NS + step // 5 * S // 50, "/imu", imu(START_NS)) for step in range(1250)]
    rows += [(START_NS, "/mag", magnetic(START_NS))] * 3
    bag = write_bag(tmp_path / "x.bag", sorted(rows, key=lambda row: row[0]))
    status, said, _ = proposed(capsys, tmp_path, bag)
    assert status == 0, said
    assert "imu: /imu, 251 Hz, fails after 0.3 s; severity highest\n" in said
    assert "found: /mag is not watched: its messages have one time, and no rate\n" in said


@pytest.mark.parametrize(
    "name",
    [
        *("[indoor] hover", "test: hover", "@lab", "*best", "flight #3", "'x", "{a}", "- a", "%x", "über", "a\nb"),
        "flug\udcf6",  # Latin-1, as Python has it
    ],
)
def test_a_recording_may_have_any_name(capsys, tmp_path, flight_bag, name):
    bag = flight_bag.rename(flight_bag.with_name(f"{name}.bag"))
    status, said, folder = proposed(capsys, tmp_path, bag)
    assert status == 0, said
    shown = name.replace("\n", " ").replace("\udcf6", "\N{REPLACEMENT CHARACTER}")
    about = yaml.safe_load((folder / "map.yaml").read_text(encoding="utf-8"))["about"]
    assert about == f"{shown}.bag, proposed by amaze-replay map"
    assert load_map(str(folder / "map.yaml")).about == about
