"""What the doctor says of a configuration, a graph and this computer; each finding with the line that puts it right."""

from __future__ import annotations

from dataclasses import replace

import pytest

from amaze_autonomy import doctor, paths
from amaze_autonomy.config import load_configuration
from amaze_autonomy.doctor import Finding, Graph, SeenService, SeenTopic, examine, examine_host
from amaze_autonomy.interface import SERVICES

KINDS = {"/lrf/range": "sensor_msgs/Range", "/odometry": "nav_msgs/Odometry", "/px4/imu": "sensor_msgs/Imu"}


@pytest.fixture(scope="module")
def shipped():
    return load_configuration(paths.config_folder())


@pytest.fixture
def healthy(shipped):
    """Return a graph in which everything is as the configuration says."""
    topics = {"/odometry": SeenTopic(("nav_msgs/Odometry",), ("/estimator",), 500, 50.0, 0.01)}
    nodes = set()
    for component in shipped.components:
        nodes |= {component.node} - {None}
        for spec in component.topics:
            kind = KINDS.get(spec.topic, "sensor_msgs/Image")
            topics[spec.topic] = SeenTopic((kind,), ("/driver",), 100, spec.rate_hz, 0.01)
    services = {
        name: SeenService(
            f"/{name}", f"{'std_srvs' if row.type == 'Trigger' else 'amaze_autonomy'}/{row.type}", f"/{row.peer}"
        )
        for name, row in SERVICES.items()
    }
    return Graph(topics, services, frozenset(nodes))


def bad(configuration, graph):
    found = [each for each in examine(configuration, graph) if each.level != "good"]
    return [each for each in found if not each.about.startswith("recording ")]


def changed(graph, topic, **fields):
    return replace(graph, topics={**graph.topics, topic: replace(graph.topics[topic], **fields)})


def test_nothing_is_wrong_with_a_graph_that_is_as_configured(shipped, healthy):
    assert bad(shipped, healthy) == []
    good = {each.about for each in examine(shipped, healthy)}
    assert {component.name for component in shipped.components} <= good


@pytest.mark.parametrize(
    "fields, level, said, line",
    [
        (
            {"rate_hz": 12.0},
            "warning",
            "comes at 12 Hz, expected are 20: it would count as off its rate",
            "rate_hz: 12",
        ),
        ({"rate_hz": 2.0}, "wrong", "comes at 2 Hz, expected are 20: it would count as failed", "rate_hz: 2"),
    ],
)
def test_a_rate_that_is_another_is_proposed(shipped, healthy, fields, level, said, line):
    assert bad(shipped, changed(healthy, "/lrf/range", **fields)) == [
        Finding(
            level, "lrf", f"/lrf/range of /driver {said}", f"sensors.yaml, components.lrf.topics./lrf/range: {line}"
        )
    ]


def test_a_topic_that_is_silent_is_named_with_its_publisher(shipped, healthy):
    graph = changed(healthy, "/lsm9ds1/imu", rate_hz=None, count=0)
    assert bad(shipped, graph) == [Finding("wrong", "lsm9ds1_imu", "/lsm9ds1/imu of /driver is silent (0 messages)")]


def test_a_topic_under_another_name_is_proposed(shipped, healthy):
    topics = dict(healthy.topics)
    topics["/lidar/range"] = topics.pop("/lrf/range")
    assert bad(shipped, replace(healthy, topics=topics)) == [
        Finding(
            "wrong",
            "lrf",
            "nobody publishes /lrf/range",
            "sensors.yaml, components.lrf.topics: /lidar/range in the place of /lrf/range",
        ),
        Finding(
            "wrong",
            "landing_detection",
            "nobody publishes /lrf/range",
            "sensors.yaml, landing_detection.topic: /lidar/range",
        ),
    ]


@pytest.mark.parametrize(
    "age_s, said",
    [
        (3.25, "3.25 s old on arrival: the clock of the computer of /driver is behind, or it stamps late"),
        (-1.5, "1.5 s in the future: the clock of the computer of /driver is ahead"),
    ],
)
def test_stamps_of_another_time_are_a_clock(shipped, healthy, age_s, said):
    assert bad(shipped, changed(healthy, "/px4/gps", age_s=age_s)) == [
        Finding("warning", "gps", f"stamps of /px4/gps are {said}", "on that computer: chronyc makestep")
    ]


def test_another_type_is_named_with_the_source_that_reads_it(shipped, healthy):
    graph = changed(healthy, "/lrf/range", kinds=("sensor_msgs/LaserScan",))
    assert bad(shipped, graph) == [
        Finding(
            "wrong",
            "landing_detection",
            "/lrf/range is sensor_msgs/LaserScan, read is sensor_msgs/Range",
            "sensors.yaml, landing_detection: source: scan",
        )
    ]


def test_a_node_that_is_not_there_is_named(shipped, healthy):
    nodes = healthy.nodes - {"/realsense"} | {"/realsense2"}
    assert bad(shipped, replace(healthy, nodes=nodes)) == [
        Finding(
            "wrong",
            "realsense_camera",
            "there is no node /realsense",
            "sensors.yaml, components.realsense_camera: node: /realsense2",
        )
    ]


def test_services_that_nobody_offers_and_those_of_others(shipped, healthy):
    services = {name: each for name, each in healthy.services.items() if not name.startswith("mission_planner/")}
    services["watchdog/start"] = SeenService("/watchdog/start", "watchdog_msgs/Start", "/watchdog")
    graph = replace(healthy, services=services, namespace="/ours/")
    assert bad(shipped, graph) == [
        Finding(
            "wrong",
            "watchdog",
            "/watchdog/start of /watchdog is watchdog_msgs/Start, asked is amaze_autonomy/StartWatchdog",
            "rename or remap one of them",
        ),
        Finding(
            "warning",
            "mission_planner",
            "nobody offers /ours/mission_planner/load, /ours/mission_planner/command: start the mission_planner",
        ),
    ]


def test_a_status_of_another_type_is_named(shipped, healthy):
    topics = {**healthy.topics, "/watchdog/action": SeenTopic(("watchdog_msgs/ActionStamped",), ("/autonomy",), 3)}
    assert bad(shipped, replace(healthy, topics=topics)) == [
        Finding(
            "wrong",
            "watchdog/action",
            "/watchdog/action of /autonomy is watchdog_msgs/ActionStamped, read is amaze_autonomy/WatchdogAction",
            "rename or remap one of them, or start one stack in a namespace",
        )
    ]


def test_a_computer_that_others_cannot_find_is_told(shipped, healthy):
    assert bad(shipped, replace(healthy, named=False, master_host="uav")) == [
        Finding(
            "wrong",
            "network",
            "the master is on uav, and neither ROS_IP nor ROS_HOSTNAME says where this computer is",
            "in the shell of each node: export ROS_IP=ADDRESS",
        )
    ]


# --- this computer ----------------------------------------------------------------------------------------------------


@pytest.fixture
def host(monkeypatch, shipped, tmp_path):
    """Examine a computer whose programs say what the test says."""

    def on(**says):
        programs = {"ssh": (0, ""), "chronyc": (0, "A,b,3,1,0.001"), "timedatectl": (0, "no"), **says}
        monkeypatch.setattr(doctor.shutil, "which", lambda name: name if programs[name] else None)
        monkeypatch.setattr(doctor, "_run", lambda command: programs[command[0]])
        configuration = replace(shipped, recording=replace(shipped.recording, folder=str(tmp_path)))
        return {each.about: each for each in examine_host(configuration)}

    return on


def test_a_computer_that_is_ready(host):
    found = host()
    assert {about: each.level for about, each in found.items()} == {"storage": "good", "second": "good", "time": "good"}
    assert found["time"].said == "chrony keeps it, +1.0 ms off"


def test_a_key_that_does_not_open_is_named(host):
    assert host(ssh=(255, "Permission denied (publickey)."))["second"] == Finding(
        "wrong",
        "second",
        "ssh does not open second: Permission denied (publickey).",
        "ssh-copy-id -p 22 second; or recording.yaml, platforms.second",
    )


@pytest.mark.parametrize(
    "says, level",
    [
        ({"chronyc": (0, "A,b,3,1,-0.4")}, "warning"),
        ({"chronyc": (0, "A,b,0,1,0.0"), "timedatectl": None}, "warning"),
        ({"chronyc": None, "timedatectl": (0, "yes")}, "good"),
        ({"chronyc": None, "timedatectl": None}, "warning"),
    ],
)
def test_time_that_nobody_keeps_is_told(host, says, level):
    assert host(**says)["time"].level == level


def test_a_full_disk_is_told(host, monkeypatch):
    monkeypatch.setattr(doctor, "space_of", lambda _: _Space())
    found = host()["storage"]
    assert found.level == "wrong"
    assert "make space" in found.said


class _Space:
    free_bytes, free_fraction = 1_000_000, 0.001


def test_a_node_that_is_on_the_masters_list_and_does_not_answer_is_named(shipped, healthy):
    (finding,) = bad(shipped, replace(healthy, gone=frozenset({"/driver_of_yesterday"})))

    assert (finding.level, finding.about) == ("warning", "network")
    assert finding.said.startswith("/driver_of_yesterday is on the master's list and does not answer")
    assert finding.line == "to forget the dead: rosnode cleanup"
