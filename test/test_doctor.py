"""What the doctor says of a configuration, a graph and this computer; each finding with the line that puts it right."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import pytest

from amaze_autonomy import doctor, paths
from amaze_autonomy.cli import main
from amaze_autonomy.cns import tables as cns
from amaze_autonomy.config import load_configuration
from amaze_autonomy.doctor import Arrangement, Finding, Graph, SeenService, SeenTopic, examine, examine_host, wanted
from amaze_autonomy.interface import SERVICES, STATUSES
from amaze_autonomy.monitoring.specs import RestartSpec

START_NS, S = 1_600_000_000_000_000_000, 1_000_000_000
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
            topics[spec.topic] = SeenTopic((kind,), (component.node or "/driver",), 100, spec.rate_hz, 0.01)
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


def without(graph, topic):
    return replace(graph, topics={name: each for name, each in graph.topics.items() if name != topic})


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
        Finding(level, "lrf", f"/lrf/range of /lrf {said}", f"sensors.yaml, components.lrf.topics./lrf/range: {line}")
    ]


@pytest.mark.parametrize(
    "rate_hz, said", [(1000.4, "1000"), (1234.5, "1230"), (99999.0, "100000"), (0.00312, "0.00312")]
)
def test_a_rate_is_proposed_as_the_configuration_takes_it(shipped, healthy, rate_hz, said):
    (found,) = bad(shipped, changed(healthy, "/lrf/range", rate_hz=rate_hz))
    assert found.said.startswith(f"/lrf/range of /lrf comes at {said} Hz, expected are 20")
    assert found.line == f"sensors.yaml, components.lrf.topics./lrf/range: rate_hz: {said}"


def test_a_topic_that_is_silent_is_named_with_its_publisher(shipped, healthy):
    graph = changed(healthy, "/lsm9ds1/imu", rate_hz=None, count=0)
    assert bad(shipped, graph) == [Finding("wrong", "lsm9ds1_imu", "/lsm9ds1/imu of /lsm9ds1 is silent (0 messages)")]


def slowed(shipped, rate_hz, age_limit_s, tolerance_fraction=0.2):
    """Return a configuration whose range finder is slow."""

    def row(spec):
        values = {"rate_hz": rate_hz, "age_limit_ns": int(age_limit_s * 1e9), "tolerance_fraction": tolerance_fraction}
        return replace(spec, **values, rate_failed_fraction=0.05) if spec.topic == "/lrf/range" else spec

    rows = tuple(replace(each, topics=tuple(map(row, each.topics))) for each in shipped.components)
    return replace(shipped, components=rows)


@pytest.mark.parametrize(
    "rate_hz, tolerance_fraction, listened_s, count, longer_s",
    [
        (0.1, 0.2, 10.0, 1, 30),
        (0.1, 0.2, 10.0, 0, 30),
        (0.1, 0.2, 24.0, 1, 30),
        (0.2, 0.2, 10.0, 1, 20),  # two are expected; one that is a little slow, as it may be, comes once
        (0.4, 0.2, 2.0, 1, 10),
        (0.001, 0.9, 10.0, 0, 20000),
    ],
)
def test_a_topic_too_slow_for_the_time_listened_is_not_called_silent(
    shipped, healthy, rate_hz, tolerance_fraction, listened_s, count, longer_s
):
    slow = slowed(shipped, rate_hz, 5.0 / rate_hz, tolerance_fraction)
    graph = replace(changed(healthy, "/lrf/range", rate_hz=None, count=count), listened_s=listened_s)
    said = f"/lrf/range of /lrf is too slow to judge in {listened_s:g} s ({count} messages)"
    (found,) = [each for each in bad(slow, graph) if each.about == "lrf"]
    assert found == Finding("warning", "lrf", said, f"listen for longer: --for {longer_s}")


@pytest.mark.parametrize(
    "rate_hz, tolerance_fraction, age_limit_s, listened_s, count",
    [
        (0.1, 0.2, 50.0, 25.0, 1),
        (0.3, 0.2, 10.0, 10.0, 0),
        (0.1, 0.2, 30.0, 60.0, 0),
        (0.5, 0.9, 9.9, 10.0, 0),  # of two messages nothing is known yet; silent for as long it has failed
    ],
)
def test_a_slow_topic_that_was_listened_to_for_long_enough_is_silent(
    shipped, healthy, rate_hz, tolerance_fraction, age_limit_s, listened_s, count
):
    slow = slowed(shipped, rate_hz, age_limit_s, tolerance_fraction)
    graph = replace(changed(healthy, "/lrf/range", rate_hz=None, count=count), listened_s=listened_s)
    (found,) = [each for each in bad(slow, graph) if each.about == "lrf"]
    assert found == Finding("wrong", "lrf", f"/lrf/range of /lrf is silent ({count} messages)")


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


@pytest.mark.parametrize("judged", [True, False])
def test_stamps_of_0_are_named(shipped, healthy, judged):
    def row(spec):
        return replace(spec, stamp_tolerance_ns=S // 2) if judged and spec.topic == "/px4/gps" else spec

    rows = tuple(replace(each, topics=tuple(map(row, each.topics))) for each in shipped.components)
    said = "stamps of /px4/gps are 0: /driver does not say when" + ": it would count as off the clock" * judged
    line = "in its driver: header.stamp"
    line += "; or sensors.yaml, components.gps.topics./px4/gps: no stamp_tolerance_s" * judged
    graph = changed(healthy, "/px4/gps", age_s=None, unstamped=True)
    assert bad(replace(shipped, components=rows), graph) == [Finding("warning", "gps", said, line)]


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


TWO = ("/lrf", "/lrf_again")


@pytest.mark.parametrize("rate_hz", [20.0, 40.0, 12.0])
def test_two_publishers_of_one_topic_are_named_and_no_rate_is_proposed(shipped, healthy, rate_hz):
    graph = changed(healthy, "/lrf/range", nodes=TWO, rate_hz=rate_hz)
    assert bad(shipped, graph) == [
        Finding("warning", "lrf", "/lrf/range has two publishers: /lrf, /lrf_again", "stop or rename one of them")
    ]


def test_two_publishers_that_are_too_slow_together_are_wrong_and_no_rate_is_proposed(shipped, healthy):
    graph = changed(healthy, "/lrf/range", nodes=(*TWO, "/third"), rate_hz=2.0)
    assert bad(shipped, graph) == [
        Finding(
            "warning", "lrf", "/lrf/range has 3 publishers: /lrf, /lrf_again, /third", "stop or rename one of them"
        ),
        Finding(
            "wrong",
            "lrf",
            "/lrf/range of /lrf, /lrf_again, /third comes at 2 Hz, expected are 20: it would count as failed",
        ),
    ]


def test_two_publishers_that_are_silent_are_silent(shipped, healthy):
    graph = changed(healthy, "/lsm9ds1/imu", nodes=("/lsm9ds1", "/other"), rate_hz=None, count=0)
    assert [(each.level, each.said) for each in bad(shipped, graph)] == [
        ("warning", "/lsm9ds1/imu has two publishers: /lsm9ds1, /other"),
        ("wrong", "/lsm9ds1/imu of /lsm9ds1, /other is silent (0 messages)"),
    ]


@pytest.mark.parametrize("said_by_nodes", [True, False])
def test_two_types_of_one_topic_are_named_with_their_nodes(shipped, healthy, said_by_nodes):
    kinds = ("sensor_msgs/LaserScan", "sensor_msgs/Range")
    known = tuple(zip(TWO, kinds)) if said_by_nodes else ()
    graph = changed(healthy, "/lrf/range", nodes=TWO, kinds=kinds, kinds_of=known, rate_hz=40.0)
    scan, range_ = (f"{kind} of {node}" if said_by_nodes else kind for node, kind in zip(TWO, kinds))
    types = f"{scan}, {range_}"
    assert bad(shipped, graph) == [
        Finding("wrong", "lrf", f"/lrf/range has two types: {types}", "stop or rename one of them"),
        Finding(
            "wrong",
            "landing_detection",
            f"/lrf/range is {types}; read is sensor_msgs/Range",
            "stop or rename one of them",
        ),
    ]


def test_two_estimates_on_one_topic_are_named(shipped, healthy):
    graph = changed(healthy, "/odometry", nodes=("/estimator", "/other"))
    said = "/odometry has two publishers: /estimator, /other"
    assert bad(shipped, graph) == [Finding("warning", "state_estimation", said, "stop or rename one of them")]


LAUNCH = ("/usr/bin/python3", "/opt/ros/noetic/bin/roslaunch", "amaze_autonomy", "autonomy.launch")


@pytest.mark.parametrize(
    "words, said, line",
    [
        ((*LAUNCH, "mission_planner:=false", "config:=/x", "__name:=x", "--wait"), None, ""),
        ((*LAUNCH, "mission_planer:=false"), "mission_planer:=false", "mission_planner:=false"),
        ((*LAUNCH[:2], "/x/amaze_autonomy/launch/autonomy.launch", "cofnig:=/x"), "cofnig:=/x", "config:=/x"),
        ((*LAUNCH, "zzz:=1"), "zzz:=1", ""),
        ((*LAUNCH[:2], "others", "autonomy.launch", "zzz:=1"), None, ""),  # another package's
        ((*LAUNCH[:2], "mine", "mine.launch", "zzz:=1"), None, ""),
        (("python3", "amaze_autonomy", "autonomy.launch", "zzz:=1"), None, ""),
    ],
)
def test_an_argument_that_autonomy_launch_does_not_have_is_named(shipped, monkeypatch, words, said, line):
    monkeypatch.setattr(doctor, "_commands", lambda: [words])
    found = [each for each in examine_host(shipped, "main") if each.about == "roslaunch"]
    words = f"autonomy.launch has no argument {said}: nothing was done by it"
    assert found == ([] if said is None else [Finding("warning", "roslaunch", words, line)])


def test_commands_are_those_that_run_on_this_computer():
    assert any("pytest" in word for words in doctor._commands() for word in words)


def heard_of_two(graph, kinds):
    """Return what was heard of two publishers of one topic: twenty and ten messages a second."""
    heard, connected = graph.Heard(), []
    for (node, rate_hz), kind in zip((("/fast", 20), ("/slow", 10)), kinds):
        header = {"callerid": node, "type": kind, "md5sum": kind[-5:]}
        connected.append(header)
        for number in range(rate_hz * 5):
            heard.take_at(
                START_NS + number * S // rate_hz, "/range", SimpleNamespace(_connection_header=header, _buff=b"")
            )
    heard.connected("/range", connected)
    return heard


@pytest.fixture
def looking(monkeypatch):
    graph = pytest.importorskip("amaze_autonomy.ros.graph", reason="needs ROS")
    monkeypatch.setattr(graph.rospy, "get_time", lambda: 0.0)
    return graph


def test_what_is_heard_knows_who_publishes_which_type(looking):
    heard = heard_of_two(looking, ("sensor_msgs/LaserScan", "sensor_msgs/Range"))
    seen = looking._topic(heard, "/range", "?", ("/fast", "/slow"))
    assert seen.kinds_of == (("/fast", "sensor_msgs/LaserScan"), ("/slow", "sensor_msgs/Range"))
    assert seen.kinds == ("sensor_msgs/LaserScan", "sensor_msgs/Range")
    assert seen.count == 150


@pytest.mark.parametrize("stamps_s, unstamped", [((0, 0, 0), True), ((0, 7, 0), True), ((0, 7, 7), False)])
def test_stamps_of_0_are_counted_and_have_no_age(looking, stamps_s, unstamped):
    heard = looking.Heard()
    header = {"callerid": "/driver", "type": "sensor_msgs/Imu", "message_definition": "Header header\n"}
    for number, stamp_s in enumerate(stamps_s):
        message = SimpleNamespace(_connection_header=header, _buff=struct.pack("<IIII", number, stamp_s, 0, 0))
        heard.take_at(START_NS + number * S, "/imu", message)
    seen = looking._topic(heard, "/imu", "?", ("/driver",))
    assert seen.unstamped is unstamped
    assert seen.age_s == (-7.0 if any(stamps_s) else None)


def of_camera(graph, *publishers, nodes, **fields):
    """Return the graph with other publishers of the mission camera's topic, and other nodes."""
    graph = changed(graph, "/mission_camera/image_raw", nodes=publishers, **fields)
    return replace(graph, nodes=graph.nodes - {"/mission_camera"} | {*nodes, *publishers})


ANOTHER = "sensors.yaml, components.mission_camera: node: "


@pytest.mark.parametrize(
    "publishers, others, line",
    [
        (("/usb_cam",), (), ANOTHER + "/usb_cam"),
        (("/usb_cam",), ("/mission_manager",), ANOTHER + "/usb_cam"),  # a name that is alike is somebody else's
        (("/usb_cam", "/others"), ("/mission_camera2",), ""),  # which of them it is nobody knows
        ((), ("/mission_manager",), ""),
    ],
)
def test_a_node_that_is_not_there_is_the_only_one_that_publishes_its_topics(shipped, healthy, publishers, others, line):
    graph = of_camera(healthy, *publishers, nodes=others)
    if not publishers:
        graph = without(graph, "/mission_camera/image_raw")
    (found,) = [each for each in bad(shipped, graph) if "no node" in each.said]
    assert found == Finding("wrong", "mission_camera", "there is no node /mission_camera", line)


@pytest.mark.parametrize(
    "publishers, who, line",
    [
        (("/usb_cam",), "/usb_cam does", ANOTHER + "/usb_cam"),
        (("/a", "/b"), "/a, /b do", ""),
    ],
)
def test_a_node_that_would_be_restarted_and_publishes_nothing_of_its_component_is_wrong(
    shipped, healthy, publishers, who, line
):
    graph = of_camera(healthy, *publishers, nodes=("/mission_camera",))
    found = [each for each in bad(shipped, graph) if "has" not in each.said]
    said = f"/mission_camera would be restarted, and publishes none of its topics: {who}"
    assert found == [Finding("wrong", "mission_camera", said, line)]


def test_a_nodelet_is_restarted_by_its_own_node_though_its_manager_publishes(shipped, healthy):
    graph = of_camera(healthy, "/manager", nodes=("/mission_camera",))
    assert bad(shipped, replace(graph, offered=frozenset({"/manager/unload_nodelet"}))) == []


def test_a_node_that_is_not_restarted_may_publish_nothing(shipped, healthy):
    rows = tuple(replace(each, restart=RestartSpec()) for each in shipped.components)
    assert bad(replace(shipped, components=rows), of_camera(healthy, "/usb_cam", nodes=("/mission_camera",))) == []


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


PLANNER = ("mission_planner/load", "mission_planner/command")
TO_MINE = {f"/{name}": f"/my_planner/{name.split('/')[1]}" for name in PLANNER}


def with_a_planner_of_its_own(graph):
    """Return the graph with a planner that offers our services under names of its own."""
    services = {name: each for name, each in graph.services.items() if name not in PLANNER}
    others = (
        *(SeenService(TO_MINE[f"/{name}"], graph.services[name].kind, "/my_planner") for name in PLANNER),
        SeenService("/my_planner/reset", "std_srvs/Trigger", "/my_planner"),
    )
    return replace(graph, services=services, others=others)


def test_services_of_our_types_under_other_names_are_named_and_no_second_planner_is_started(shipped, healthy):
    assert bad(shipped, with_a_planner_of_its_own(healthy)) == [
        Finding(
            "warning",
            "mission_planner",
            "nobody offers /mission_planner/load, /mission_planner/command; of that type are /my_planner/load of "
            "/my_planner, /my_planner/command of /my_planner",
            "if remapped, tell doctor, too: mission_planner/load:=/my_planner/load "
            "mission_planner/command:=/my_planner/command",
        )
    ]


def test_beside_a_service_of_another_name_nothing_of_the_same_peer_is_to_be_started(shipped, healthy):
    graph = with_a_planner_of_its_own(healthy)
    services = {name: each for name, each in graph.services.items() if name != "autopilot/land"}
    graph = replace(graph, services=services, others=graph.others[:1])
    assert bad(shipped, graph) == [
        Finding(
            "warning",
            "mission_planner",
            "nobody offers /mission_planner/load; of that type is /my_planner/load of /my_planner",
            "if remapped, tell doctor, too: mission_planner/load:=/my_planner/load",
        ),
        Finding("warning", "mission_planner", "nobody offers /mission_planner/command: is it remapped, too?"),
        Finding("warning", "autopilot", "nobody offers /autopilot/land: start the autopilot"),
    ]


def test_of_several_services_of_a_type_the_one_of_the_same_last_name_is_meant(shipped, healthy):
    graph = with_a_planner_of_its_own(healthy)
    load = graph.others[0]
    graph = replace(graph, others=(replace(load, name="/a/other", node="/a"), *graph.others))
    (found,) = bad(shipped, graph)
    assert "of that type are /my_planner/load of /my_planner, /my_planner/command" in found.said
    (found, _) = bad(shipped, replace(graph, others=(graph.others[0], replace(load, name="/b/other", node="/b"))))
    assert found.said == "nobody offers /mission_planner/load; of that type are /a/other of /a, /b/other of /b"
    assert found.line == "if remapped, tell doctor, too: mission_planner/load:=ONE_OF_THEM"


@pytest.mark.parametrize("peer, place", [("data_recorder", "/second"), ("mission_planner", "/uav2")])
def test_our_own_name_in_another_namespace_is_no_remap(shipped, healthy, peer, place):
    """It is the recorder of another platform, or another vehicle's node."""
    names = [name for name in healthy.services if name.startswith(f"{peer}/")]
    services = {name: each for name, each in healthy.services.items() if name not in names}
    others = tuple(SeenService(f"{place}/{name}", healthy.services[name].kind, f"{place}/{peer}") for name in names)
    said = f"nobody offers {', '.join(f'/{name}' for name in names)}: start the {peer}"
    assert bad(shipped, replace(healthy, services=services, others=others)) == [Finding("warning", peer, said)]


@pytest.mark.parametrize("row", STATUSES, ids=[row.name for row in STATUSES])
def test_two_publishers_of_a_peer_s_status_are_wrong_and_how_ours_is_left_out_is_said(shipped, healthy, row):
    peer = row.topic.split("/")[0]
    status = SeenTopic((f"amaze_autonomy/{row.shape.message}",), (f"/my_{peer}", f"/{peer}"), 3)
    assert bad(shipped, replace(healthy, topics={**healthy.topics, f"/{row.topic}": status})) == [
        Finding(
            "wrong",
            row.topic,
            f"/{row.topic} has two publishers: /my_{peer}, /{peer}",
            f"stop or rename one of them; autonomy.launch leaves ours out with {peer}:=false",
        )
    ]


def test_names_that_are_remapped_are_looked_at_where_they_are(shipped, healthy):
    topics = {**healthy.topics, "/my_planner/status": SeenTopic(("other/Status",), ("/my_planner",), 3)}
    topics["/lidar"] = topics.pop("/lrf/range")
    remapped = {**TO_MINE, "/mission_planner/status": "/my_planner/status", "/lrf/range": "/lidar"}
    assert [each.said for each in bad(shipped, replace(healthy, topics=topics, remapped=remapped))] == [
        "/my_planner/status of /my_planner is other/Status, read is amaze_autonomy/MissionStatus"
    ]
    graph = replace(healthy, namespace="/uav1/", remapped={"/uav1/watchdog/start": "/safety/start"})
    assert graph.resolved("watchdog/start") == "/safety/start"
    assert graph.resolved("/watchdog/start") == "/watchdog/start"
    assert graph.resolved("lrf/range") == "/uav1/lrf/range"


@pytest.mark.parametrize("word", ["a:=", ":=b", "a:=b c", "a:=b:=c", "_rate:=5", "__name:=me", "a:=~b", "1a:=b"])
def test_what_is_no_remap_is_wrong_use(capsys, word):
    with pytest.raises(SystemExit) as ended:
        main(["doctor", f"--remap={word}"])
    assert ended.value.code == 2
    said = f"argument --remap: {word!r} is no FROM:=TO of two names\n"
    assert capsys.readouterr().err.endswith(said)


@pytest.mark.parametrize("words", [["--for", "1", "a/b:=/c"], ["a/b:=/c", "--json"], ["--remap", "a/b:=/c", "/d:=e"]])
def test_a_remap_stands_where_it_does_for_a_node(looking, monkeypatch, words):
    asked = []

    def look(_for_s, _services, remapped):
        asked.append(remapped)
        raise looking.GraphError("nobody is there")

    monkeypatch.setattr(looking, "look", look)
    assert main(["doctor", *words]) == 3
    assert asked == [{"a/b": "/c", **({"/d": "e"} if "/d:=e" in words else {})}]


class Master:
    """The list of a master."""

    def __init__(self, services):
        self._services = services

    def getSystemState(self):  # noqa: N802 - of rosgraph
        return [], [], [(name, [node]) for name, node in self._services.items()]

    def getTopicTypes(self):  # noqa: N802 - of rosgraph
        return []

    def lookupService(self, name):  # noqa: N802 - of rosgraph
        return f"rosrpc://{name}"


def test_a_look_resolves_remapped_names_and_asks_for_others_where_a_wanted_one_is_missing(looking, monkeypatch):
    kinds = {"/mine/load": "amaze_autonomy/LoadMission", "/w/start": "amaze_autonomy/StartWatchdog"}
    services = {**dict.fromkeys(kinds, "/mine"), "/mine/get_loggers": "/mine", "/mine/set_logger_level": "/mine"}
    asked = []

    def headers(name, _uri):
        asked.append(name)
        return {"type": kinds[name]}

    monkeypatch.setattr(looking, "_begin", lambda: Master(services))
    monkeypatch.setattr(looking, "_listen", lambda _master, _s: (looking.Heard(), frozenset()))
    monkeypatch.setattr(looking.rosservice, "get_service_headers", headers)
    monkeypatch.setattr(looking.rospy, "get_namespace", lambda: "/")
    graph = looking.look(1.0, ["mission_planner/load", "watchdog/start"], {"watchdog/start": "w/start"})
    assert graph.services == {"watchdog/start": SeenService("/w/start", kinds["/w/start"], "/mine")}
    assert graph.others == (SeenService("/mine/load", kinds["/mine/load"], "/mine"),)
    assert graph.remapped == {"/watchdog/start": "/w/start"}
    assert sorted(asked) == sorted(kinds)
    asked.clear()
    assert looking.look(1.0, ["watchdog/start"], {"watchdog/start": "w/start"}).others == ()
    assert asked == ["/w/start"]


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


def test_another_version_of_a_type_of_ours_is_named_by_its_md5_sum(shipped, healthy):
    kind = "amaze_autonomy/AutopilotStatus"
    services = dict(healthy.services)
    services["watchdog/start"] = replace(services["watchdog/start"], md5="0ld")
    topics = {**healthy.topics, "/autopilot/status": SeenTopic((kind,), ("/autopilot",), 3, md5s=("0ld",))}
    topics["/lrf/range"] = replace(topics["/lrf/range"], md5s=("0ld",))
    md5s = {"amaze_autonomy/StartWatchdog": "n3w", kind: "n3w", "sensor_msgs/Range": "n3w"}
    again = "build the same {} on both computers"
    assert bad(shipped, replace(healthy, services=services, topics=topics, md5s=md5s)) == [
        Finding(
            "wrong",
            "landing_detection",
            "/lrf/range is sensor_msgs/Range with the md5 sum 0ld, read is n3w: another version",
            again.format("sensor_msgs"),
        ),
        Finding(
            "wrong",
            "watchdog",
            "/watchdog/start of /watchdog is amaze_autonomy/StartWatchdog with the md5 sum 0ld, asked is n3w: "
            "another version",
            again.format("amaze_autonomy"),
        ),
        Finding(
            "wrong",
            "autopilot/status",
            f"/autopilot/status of /autopilot is {kind} with the md5 sum 0ld, read is n3w: another version",
            again.format("amaze_autonomy"),
        ),
    ]


# --- beside the CNS Flight Stack --------------------------------------------------------------------------------------


FIVE = Arrangement(peers=cns.PEERS)
SERVED = Arrangement(served=cns.PEERS)


def with_names(graph, arrangement, *without):
    """Return the graph with every name that is wanted of it, offered as it should be."""
    topics, services, listeners = dict(graph.topics), {}, {}
    for row in wanted(load_configuration(paths.config_folder()), arrangement):
        name = graph.resolved(row.name)
        if row.name in without:
            continue
        if row.way is doctor.Way.OFFERED:
            services[row.name] = SeenService(name, row.kind, "/theirs", row.md5)
        elif row.way is doctor.Way.PUBLISHED:
            topics[name] = SeenTopic((row.kind,), ("/theirs",), md5s=(row.md5,))
        else:
            listeners[name] = ("/theirs",)
    return replace(graph, topics=topics, services=services, listeners=listeners)


def test_names_of_its_nodes_are_wanted_as_its_tables_have_them():
    names = {row.name: (row.kind, row.md5) for row in wanted(load_configuration(paths.config_folder()), FIVE)}
    for each in (*cns.TOPICS.values(), *cns.SERVICES.values()):
        assert names[each.name] == (each.type, each.md5)
    assert "watchdog/start" not in names
    assert "watchdog/action" not in names
    assert {"cns_peers/watchdog/start", "cns_peers/watchdog/action", "cns_peers/watchdog/info"} <= set(names)
    assert {"mission_planner/load", "data_recorder/start", "autopilot/land"} <= set(names)


@pytest.mark.parametrize("arrangement", [FIVE, SERVED, replace(FIVE, namespace="/cns"), replace(SERVED, namespace="x")])
def test_a_stack_that_is_arranged_as_it_should_be_has_nothing_wrong(shipped, healthy, arrangement):
    graph = with_names(healthy, arrangement)
    found = [each for each in examine(shipped, graph, arrangement) if each.level != "good"]
    assert [each for each in found if not each.about.startswith("recording ")] == []
    good = {each.said for each in examine(shipped, graph, arrangement)}
    prefix = {"": "", "/cns": "/cns", "x": "/x"}[arrangement.namespace]
    assert f"{prefix}/watchdog/service/start is offered by /theirs" in good
    assert f"{prefix}/watchdog/status is published by /theirs" in good
    if arrangement.peers:
        assert f"{prefix}/autonomy/request is heard by /theirs" in good


def test_its_topic_of_the_name_of_ours_is_nothing_wrong_where_the_launch_file_remaps(shipped, healthy):
    graph = with_names(healthy, FIVE)
    theirs = SeenTopic(("watchdog_msgs/ActionStamped",), ("/operator",), 3)
    graph = replace(graph, topics={**graph.topics, "/watchdog/action": theirs})
    assert [each for each in examine(shipped, graph, FIVE) if each.level != "good"] == []


def test_its_nodes_that_are_not_there_are_named_one_by_one(shipped, healthy):
    without = ("/estimator_supervisor/service/supervision", "/watchdog/service/start", "/watchdog/log")
    without += ("/autonomy/request", "/mission_sequencer/waypoint_list", "mission_planner/load")
    graph = with_names(healthy, FIVE, *without)
    start = "of the CNS Flight Stack"
    assert [each for each in examine(shipped, graph, FIVE) if each.level != "good"] == [
        Finding("warning", "mission_planner", "nobody offers /mission_planner/load: start cns_peers"),
        Finding("warning", "watchdog", f"nobody publishes /watchdog/log: start the watchdog {start}"),
        Finding(
            "warning",
            "mission_planner",
            "nobody listens to /autonomy/request, /mission_sequencer/waypoint_list: start the mission_planner " + start,
        ),
        Finding("warning", "watchdog", f"nobody offers /watchdog/service/start: start the watchdog {start}"),
        Finding(
            "warning",
            "state_estimation",
            f"nobody offers /estimator_supervisor/service/supervision: start the state_estimation {start}",
        ),
    ]


def test_its_types_of_another_version_are_named_with_both_md5_sums(shipped, healthy):
    graph = with_names(healthy, FIVE)
    services, topics = dict(graph.services), dict(graph.topics)
    start = cns.SERVICES["watchdog_start"]
    services[start.name] = replace(services[start.name], md5="0ld")
    topics["/autonomy/response"] = replace(topics["/autonomy/response"], md5s=("0ld",))
    graph = replace(graph, services=services, topics=topics)
    assert [(each.about, each.said, each.line) for each in examine(shipped, graph, FIVE) if each.level == "wrong"] == [
        (
            "mission_planner",
            "/autonomy/response of /theirs is mission_sequencer/MissionResponse with the md5 sum 0ld, read is "
            f"{cns.TOPICS['response'].md5}: another version",
            "build the same mission_sequencer on both computers",
        ),
        (
            "watchdog",
            f"/watchdog/service/start of /theirs is watchdog_msgs/Start with the md5 sum 0ld, asked is {start.md5}: "
            "another version",
            "build the same watchdog_msgs on both computers",
        ),
    ]


def test_some_of_its_nodes_leave_the_others_ours(shipped):
    rows = wanted(shipped, Arrangement(peers=("mission_planner",)))
    names = {row.name for row in rows}
    assert {"watchdog/start", "watchdog/action", "/autonomy/request", "/autonomy/response"} <= names
    assert not {"/watchdog/service/start", "/data_recorder/record"} & names


def test_what_nodes_of_theirs_do_not_read_is_not_looked_at(shipped, healthy):
    topics = {name: each for name, each in healthy.topics.items() if name not in ("/lrf/range", "/px4/imu")}
    graph = with_names(replace(healthy, topics=topics), FIVE)
    about = {each.about for each in examine(shipped, graph, FIVE) if each.level != "good"}
    assert about == {"lrf", "imu"}  # the topics are watched all the same
    assert not any(each.about.startswith("recording") for each in examine(shipped, graph, FIVE))


def test_the_heading_is_looked_at_where_its_sequencer_flies_missions_that_are_turned_by_it(shipped, healthy):
    topics = {name: each for name, each in healthy.topics.items() if name != "/odometry"}
    plans = [replace(plan, trajectories=()) for plan in shipped.plans]
    graph = with_names(replace(healthy, topics=topics), FIVE)
    assert [each.said for each in examine(shipped, graph, FIVE) if each.level == "wrong"] == [
        "nobody publishes /odometry"
    ]
    ahead = replace(shipped, plans=tuple(plans))
    assert [each for each in examine(ahead, graph, FIVE) if each.level == "wrong"] == []


def test_under_its_engine_only_what_serves_it_is_wanted(shipped):
    names = {row.name: row for row in wanted(shipped, Arrangement(served=("watchdog", "data_recorder")))}
    assert {"watchdog/start", "data_recorder/start", "autopilot/land", "cns_server/watchdog/action"} <= set(names)
    assert not {"mission_planner/load", "/autonomy/request", "watchdog/action"} & set(names)
    assert names["/watchdog/service/start"].start == "cns_server"
    whole = {row.name: row for row in wanted(shipped, SERVED)}
    assert whole["/autonomy/request"].start == "the engine of the CNS Flight Stack"


def test_the_launch_file_remaps_what_is_wanted_under_another_name(shipped):
    launch = ET.parse(Path(__file__).parents[1] / "launch" / "autonomy.launch")
    remapped = {(each.get("from"), each.get("to")) for each in launch.iter("remap")}
    ours = {row.name for row in wanted(shipped, Arrangement())}
    for arrangement in (FIVE, SERVED):
        names = {row.name for row in wanted(shipped, arrangement)}
        for name in ours - names:
            ((other,),) = [tuple(to for at, to in remapped if at == name and to in names)]
            assert other.endswith(name)
    assert {status.topic for status in STATUSES} <= ours


# --- the vehicle and its estimator ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mavros():
    overrides = ("autopilot.land_switch.channel=7", "sensors.initialisation.service=/estimator/init_service")
    types = ("sensors.initialisation.type=set_bool", "sensors.initialisation.in_flight_service=/estimator/second")
    return load_configuration(paths.config_folder() / "mavros", (*overrides, *types))


def test_what_is_asked_of_mavros_and_of_an_estimator_is_wanted(mavros):
    rows = {row.name: (row.kind, row.level) for row in wanted(mavros, Arrangement())}
    assert {name: row for name, row in rows.items() if name.startswith(("/mavros/", "/estimator/"))} == {
        "/mavros/set_mode": ("mavros_msgs/SetMode", "wrong"),
        "/mavros/cmd/command": ("mavros_msgs/CommandLong", "wrong"),
        "/mavros/param/get": ("mavros_msgs/ParamGet", "wrong"),
        "/mavros/mission/push": ("mavros_msgs/WaypointPush", "wrong"),
        "/mavros/mission/pull": ("mavros_msgs/WaypointPull", "wrong"),
        "/mavros/mission/set_current": ("mavros_msgs/WaypointSetCurrent", "wrong"),
        "/mavros/state": ("mavros_msgs/State", "wrong"),
        "/mavros/rc/in": ("mavros_msgs/RCIn", "wrong"),
        "/estimator/init_service": ("std_srvs/SetBool", "wrong"),
        "/estimator/second": ("std_srvs/Trigger", "wrong"),
    }
    theirs = {row.name for row in wanted(mavros, Arrangement(peers=("mission_planner",)))}
    assert not any(name.startswith("/mavros/mission/") for name in theirs)  # that planner has a way of its own
    none = load_configuration(paths.config_folder() / "mavros")
    assert "/mavros/rc/in" not in {row.name for row in wanted(none, Arrangement())}


def test_mavros_elsewhere_is_proposed_and_a_silent_transmitter_is_named(mavros):
    rc_in = SeenTopic(("mavros_msgs/RCIn",), ("/mavros",), 0)
    offered = frozenset(f"/uav1/mavros/{name}" for name in ("set_mode", "cmd/command", "param/get"))
    graph = Graph({"/mavros/rc/in": rc_in}, {}, offered=offered)
    found = [each for each in examine(mavros, graph) if each.about in ("mavros", "initialisation", "land_switch")]
    assert found == [
        Finding("wrong", "land_switch", "/mavros/rc/in of /mavros is silent"),
        Finding(
            "wrong",
            "mavros",
            "nobody offers /mavros/set_mode, /mavros/cmd/command, /mavros/param/get, /mavros/mission/push, "
            "/mavros/mission/pull, /mavros/mission/set_current: start mavros",
            "autopilot.yaml: mavros: /uav1/mavros",
        ),
        Finding(
            "wrong",
            "mavros",
            "nobody publishes /mavros/state: start mavros",
            "autopilot.yaml: mavros: /uav1/mavros",
        ),
        Finding(
            "wrong",
            "initialisation",
            "nobody offers /estimator/init_service, /estimator/second: start the estimator",
            "sensors.yaml: initialisation",
        ),
    ]


@pytest.mark.parametrize(
    "words, said",
    [
        (("--peers", "cns", "--serve", "cns"), "one engine alone is started"),
        (("--cns-peers", "watchdog,pilot"), "pilot is none of watchdog, landing_detection, state_estimation, "),
        (("--cns-served", "autopilot"), "autopilot is none of watchdog, "),
    ],
)
def test_an_arrangement_that_cannot_be_is_wrong_use(capsys, words, said):
    assert main(["doctor", *words]) == 2
    assert said in capsys.readouterr().err


# --- this computer ----------------------------------------------------------------------------------------------------


@pytest.fixture
def host(monkeypatch, shipped, tmp_path):
    """Examine a computer whose programs say what the test says."""

    def on(platform="main", key="", **says):
        programs = {"ssh": (0, ""), "chronyc": (0, "A,b,3,1,0.001"), "timedatectl": (0, "no"), **says}
        monkeypatch.setattr(doctor.shutil, "which", lambda name: name if programs[name] else None)
        monkeypatch.setattr(doctor, "_run", lambda command: on.asked.append(command) or programs[command[0]])
        platforms = tuple(replace(p, transfer=replace(p.transfer, ssh_key=key)) for p in shipped.recording.platforms)
        recording = replace(shipped.recording, folder=str(tmp_path), platforms=platforms)
        return {each.about: each for each in examine_host(replace(shipped, recording=recording), platform)}

    on.asked = []
    return on


def test_a_computer_that_is_ready(host):
    found = host()
    assert {about: each.level for about, each in found.items()} == {"storage": "good", "second": "good", "time": "good"}
    assert found["time"].said == "chrony keeps it, +1.0 ms off"


@pytest.mark.parametrize("folder", ["~nobody_of_this_name/recordings", "~/recordings"])
def test_a_folder_in_a_home_that_is_not_known_is_wrong(monkeypatch, shipped, folder):
    monkeypatch.setattr(Path, "expanduser", without_a_home)
    recording = replace(shipped.recording, folder=folder, platforms=shipped.recording.platforms[:1])
    found = {each.about: each for each in examine_host(replace(shipped, recording=recording), "main")}
    assert found["storage"] == Finding(
        "wrong", "storage", f"{folder} cannot be looked at", "recording.yaml: folder: one that can"
    )


def without_a_home(path):
    raise RuntimeError(f"Could not determine home directory of {path}")


def test_a_key_in_a_home_that_is_not_known_is_left_to_ssh(host):
    host(key="~nobody_of_this_name/far")
    (command,) = [each for each in host.asked if each[0] == "ssh"]
    assert command[command.index("-i") + 1] == "~nobody_of_this_name/far"


def test_a_key_that_does_not_open_is_named(host):
    assert host(ssh=(255, "Permission denied (publickey)."))["second"] == Finding(
        "wrong",
        "second",
        "ssh does not open second: Permission denied (publickey).",
        "ssh-copy-id -p 22 second; or recording.yaml, platforms.second",
    )


def test_it_is_tried_with_the_key_that_the_recorder_uses_and_with_no_other(host):
    host(key="/keys/far")
    (command,) = [each for each in host.asked if each[0] == "ssh"]
    assert command == (
        *("ssh", "-oBatchMode=yes", "-oConnectTimeout=5", "-p", "22", "-oIdentitiesOnly=yes", "-i", "/keys/far"),
        *("--", "second", "true"),
    )


def test_the_far_computer_opens_no_other_and_needs_space_for_its_own_groups(host, monkeypatch, shipped):
    asked = []
    monkeypatch.setattr(doctor, "needed_bytes", lambda _storage, groups, _s: asked.append(groups) or 0)
    assert {about: each.level for about, each in host("second").items()} == {"storage": "good", "time": "good"}
    assert [each[0] for each in host.asked] == ["chronyc"]
    assert asked == [shipped.recording.groups_of("second")]
    assert asked != [shipped.recording.groups_of("main")]


def test_a_platform_that_there_is_not_is_wrong_use(capsys):
    assert main(["doctor", "--platform", "secnd"]) == 2
    assert capsys.readouterr().err == "doctor: --platform: is 'secnd', recording.yaml has main, second\n"


@pytest.mark.parametrize("command", [["doctor"], ["propose-config", "--live"]])
@pytest.mark.parametrize("text", ["-1", "0", "nan", "inf", "1e300", "ten"])
def test_a_time_to_listen_for_that_cannot_be_is_wrong_use(capsys, command, text):
    with pytest.raises(SystemExit) as ended:
        main([*command, f"--for={text}"])
    assert ended.value.code == 2
    said = f"argument --for: {text!r} is no number of seconds above 0 and at most 86400\n"
    assert capsys.readouterr().err.endswith(said)


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


NOT_COMPARED = "stamps of two computers cannot be compared"
NEVER_SYNCHRONISED = (
    "00000000,,0,0.000000000,0.000000000,0.000000000,0.000000000,0.000,0.000,0.000,1.0,1.0,0.0,Not synchronised"
)


@pytest.mark.parametrize(
    "says, said, line",
    [
        (
            {"chronyc": (0, NEVER_SYNCHRONISED)},
            "chrony runs, and is not synchronised",
            "chrony.conf of the near computer: allow, local stratum 10; of the far one: server NEAR iburst",
        ),
        (
            {"chronyc": (1, "506 Cannot talk to daemon")},
            "chrony is here, and does not answer (506 Cannot talk to daemon)",
            "systemctl enable --now chrony",
        ),
        (
            {"chronyc": None},
            "nobody is known to keep the time of this computer",
            "apt-get install chrony, on each computer",
        ),
    ],
)
def test_what_is_advised_of_time_is_not_done_already(host, says, said, line):
    assert host(**says)["time"] == Finding("warning", "time", f"{said}: {NOT_COMPARED}", line)


def test_a_time_that_chrony_does_not_know_may_be_kept_by_another(host):
    assert host(chronyc=(0, NEVER_SYNCHRONISED), timedatectl=(0, "yes"))["time"].level == "good"


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
