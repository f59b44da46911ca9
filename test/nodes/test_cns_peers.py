"""The shells between us and CNS nodes, without a master: folders on other computers, classes, names, the heading."""

from __future__ import annotations

import math
import os
import queue
import sys
import threading
from itertools import islice
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

pytest.importorskip("rospy")

import rospy
from nav_msgs.msg import Odometry

from amaze_autonomy.cns.peers import Folder
from amaze_autonomy.cns.sequencer import Sequencer
from amaze_autonomy.cns.tables import PEERS, SERVICES, TOPICS
from amaze_autonomy.config import load_configuration
from amaze_autonomy.engine.events import MissionPhase, MissionStatus
from amaze_autonomy.interface import SERVICES as OURS
from amaze_autonomy.interface import STATUSES
from amaze_autonomy.monitoring.specs import EstimateSource
from amaze_autonomy.nodes.cns import names, server
from amaze_autonomy.nodes.cns import node as shell
from amaze_autonomy.nodes.cns.names import cns_classes
from amaze_autonomy.nodes.cns.node import CnsPeersNode, lookers
from amaze_autonomy.paths import config_folder
from amaze_autonomy.ros.clock import MonotonicClock
from amaze_autonomy.ros.errors import StartError

SSH = """\
#!/bin/sh
# what stands before the command is: options, --, host
while [ "$1" != -- ]; do shift; done
last() {{ while [ -e "{folder}/alive" ]; do sleep 0.1; done; }}
case "$2" in
    hangs) last; exit 255 ;;
    gone) exit 255 ;;
    shared) (exec > "{folder}/said"; last) & ;;  # as a connection that is kept open, it has our stderr
esac
exec sh -c "$3"
"""
ANSWER_S = 60.0


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of recordings of 8 bytes, and an ssh that goes to this computer or does what its host's name says."""
    recordings, programs = tmp_path / "recordings of today", tmp_path / "bin"
    for each in (recordings, programs):
        each.mkdir()
    (recordings / "done.bag").write_text("done.")
    (recordings / "part.bag.active").write_text("...")
    (programs / "ssh").write_text(SSH.format(folder=tmp_path))
    (programs / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    monkeypatch.setattr(shell, "_LOOK_NS", 1_000_000)
    monkeypatch.setattr(shell, "_SSH_S", ANSWER_S)
    alive = tmp_path / "alive"
    alive.touch()
    yield recordings
    alive.unlink()  # what hangs ends


@pytest.fixture
def look():
    """Look at the folders of some platforms, and go on while the test takes what was seen."""
    started = []

    def begin(**places):
        seen = queue.Queue()
        started.extend(lookers(places, lambda platform, found: seen.put((platform, found)), MonotonicClock()))
        for each in started:
            each.start()
        return iter(lambda: seen.get(timeout=ANSWER_S / 2), None)

    yield begin
    for each in started:
        each.stop()


def of(platform, seen):
    return (found for name, found in seen if name == platform)


@pytest.mark.parametrize("host", ["", "second:", "user@second:", "shared:"])
def test_a_folder_is_seen_to_grow_here_and_there(folder, look, host):
    found = of("main", look(main=f"{host}{folder}"))
    assert next(found) == Folder(8, 1)
    with (folder / "part.bag.active").open("a") as part:
        part.write("...")
    assert next(each for each in found if each != Folder(8, 1)) == Folder(11, 1)  # looks of before may still wait


@pytest.mark.parametrize("place", ["{}/none", "second:{}/none", "gone:{}"])
def test_a_folder_that_is_missing_or_out_of_reach_cannot_be_seen(folder, look, place):
    assert next(of("main", look(main=place.format(folder)))) is None


@pytest.mark.parametrize(
    "host", ["second:~", "second:~nobody", "second:~$(touch {0}/evil)", "second:~;touch {0}/evil;"]
)
def test_a_folder_of_another_computer_is_a_name_and_never_a_command(folder, look, host):
    place = f"{host.format(folder)}/x'; touch {folder}/evil; '$(touch {folder}/evil)"
    assert next(of("main", look(main=place))) is None
    assert not (folder / "evil").exists()


def test_a_host_that_hangs_holds_up_no_other_one(folder, look):
    seen = look(second=f"hangs:{folder}", main=str(folder), third=f"third:{folder}")
    first = list(islice(seen, 20))
    assert {name for name, _ in first} >= {"main"}
    assert "second" not in dict(first)
    assert list(islice(of("third", seen), 3)) == [Folder(8, 1)] * 3


# --- classes ----------------------------------------------------------------------------------------------------------

NAMES = {"heartbeat": TOPICS["heartbeat"], "log": TOPICS["log"], "watchdog_start": SERVICES["watchdog_start"]}


def write_packages(monkeypatch, **sums):
    """Have the watchdog's messages, with other md5 sums than known where they are given."""
    for part in ("msg", "srv"):
        mine = {key: name for key, name in NAMES.items() if (key in SERVICES) == (part == "srv")}
        kinds = {
            name.type.split("/")[1]: type(key, (), {"_md5sum": sums.get(key, name.md5)}) for key, name in mine.items()
        }
        monkeypatch.setitem(sys.modules, f"watchdog_msgs.{part}", SimpleNamespace(**kinds))


def test_classes_of_the_known_sums_are_taken(monkeypatch):
    write_packages(monkeypatch)
    found = cns_classes(NAMES, SERVICES)
    assert {key: kind._md5sum for key, kind in found.items()} == {key: name.md5 for key, name in NAMES.items()}


def test_a_class_of_another_sum_is_refused_with_both(monkeypatch):
    write_packages(monkeypatch, log="0" * 32, watchdog_start="f" * 32)
    with pytest.raises(StartError) as error:
        cns_classes(NAMES, SERVICES)
    assert str(error.value) == (
        f"watchdog_msgs/StatusChangesArrayStamped has the md5 sum {'0' * 32}, must be "
        f"be226fc8063e4e54e0bf24bced9535a4: another version; watchdog_msgs/Start has the md5 sum {'f' * 32}, must be "
        "0dce17580854048dd8c9764a29917bd4: another version"
    )


# --- names ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def taken(monkeypatch, tmp_path):
    """The names that a node in /uav1 publishes, hears, offers and asks, once it is made and run without a master."""
    found = set()

    def take(name, *_, **__):
        found.add(rospy.resolve_name(name))
        return MagicMock()

    for kind in ("Publisher", "Subscriber", "Service"):
        monkeypatch.setattr(rospy, kind, take)
    for module in (shell, server):
        monkeypatch.setattr(module, "ServiceClient", lambda name, *_: found.add(name) or MagicMock())
    monkeypatch.setattr(names, "cns_classes", lambda every, _: dict.fromkeys(every))
    monkeypatch.setattr(rospy.names, "_caller_id", "/uav1/node")
    monkeypatch.setenv("ROS_HOME", str(tmp_path))

    def taken_by(make, namespace):
        given = {"~cns_namespace": namespace}
        monkeypatch.setattr(sys, "argv", ["cns_peers", "--recordings", f"main={tmp_path}"])
        monkeypatch.setattr(rospy, "get_param", given.get)
        node = make(load_configuration(config_folder()), MonotonicClock())
        node.end()
        node.run()
        return found

    return taken_by


@pytest.mark.parametrize("namespace, below", [("", ""), ("/x", "/x"), ("/x/", "/x"), ("x", "/uav1/x")])
@pytest.mark.parametrize("make", [CnsPeersNode, server.CnsServerNode])
def test_their_names_are_all_below_their_namespace_and_ours_in_that_of_the_node(make, namespace, below, taken):
    theirs = {below + each.name for each in (*TOPICS.values(), *SERVICES.values())}
    found = taken(make, namespace)
    assert found >= theirs
    ours = {f"/uav1/{name}" for name in (*OURS, *(each.topic for each in STATUSES), "mission_planner/load_waypoints")}
    topic = load_configuration(config_folder()).state_estimation.topic
    assert found - theirs - {topic} <= ours
    assert len(found & ours) >= len(PEERS)


@pytest.mark.parametrize("value, good", [(1, True), ("1", True), (3, False), ("abc", False), ([1], False)])
def test_waypoints_count_from_where_it_started_and_nothing_else_may_be_asked_for(value, good, monkeypatch):
    monkeypatch.setattr(rospy, "get_param", {"~waypoint_reference": value}.get)
    node = object.__new__(CnsPeersNode)
    node._configuration = load_configuration(config_folder())
    if good:
        assert isinstance(node._peer("mission_planner"), Sequencer)
        return
    with pytest.raises(StartError) as error:
        node._peer("mission_planner")
    right = "leave it out: waypoints count from where it started, which is 1 in its message"
    assert str(error.value) == f"~waypoint_reference is {value!r}; {right}"


# --- what its log tells -----------------------------------------------------------------------------------------------


def test_what_the_planner_says_is_told_in_the_log_once(monkeypatch):
    told = []
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: told.append(text % values))
    node = CnsPeersNode.__new__(CnsPeersNode)
    node._planner_said = ""
    for message in ("", "it has skipped waypoint 2", "it has skipped waypoint 2", "", "it is gone"):
        node._tell(MissionStatus(t_ns=0, session_id="s", mission_id="1", phase=MissionPhase.FLYING, message=message))
    assert told == ["mission planner: it has skipped waypoint 2", "mission planner: it is gone"]


# --- heading ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -160.0])
def test_the_heading_is_counter_clockwise_from_east(heading_deg):
    heard = []

    class Planner(Sequencer):
        def turn(self, t_ns, heading_rad):  # noqa: ARG002
            heard.append(math.degrees(heading_rad))

    limits = load_configuration(config_folder()).rules.limits
    node = CnsPeersNode.__new__(CnsPeersNode)
    node._configuration = SimpleNamespace(state_estimation=SimpleNamespace(source=EstimateSource.ODOMETRY))
    node._peers = {"mission_planner": Planner([], limits, 1.0)}
    node._clock, node._changed = MonotonicClock(), threading.Condition()
    message = Odometry()
    half = math.radians(heading_deg) / 2.0
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = math.sin(half), math.cos(half)
    node._turn(message)
    assert heard == [pytest.approx(heading_deg)]
