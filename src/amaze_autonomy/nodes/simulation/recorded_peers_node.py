"""The recorded peers node: plays a recording into the live nodes without losing a message, and stands in for its peers.

`rosbag play --clock --pause --keep-alive` plays; this node lets it begin once every listener is connected to every
topic of the recording that it reads. Services of peers that are only a recording now are answered with yes: those of
autopilot, planner and recorder. Their statuses are played as recorded; those that carry a session come by
recorded/..., and go on with the session of the running engine, as the offline replay does it.

    ~player       name of the node that plays; default: player
    ~listeners    nodes that must be connected before it begins
    ~missions     ids to select, with commas between
    ~select_at_s  when, from the start of the recording
    ~limit_s      wall time in which everything must be connected; default: 20

The recording and the file with what was received are words: `arguments.py`.

It ends when the recording does: exit status 0, or 1 and a line that says what did not come about.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Sequence, Tuple

import rosgraph
import rospy
from std_srvs.srv import SetBool

from amaze_autonomy import msg, srv
from amaze_autonomy.bags import BagError, Recording
from amaze_autonomy.interface import SERVICES
from amaze_autonomy.ros.interface import SERVICE_CLASSES
from amaze_autonomy.ros.liveness import call
from amaze_autonomy.ros.rospy_flaws import check_master_uri, mend_rospy

from ...ros import node_main
from ...ros.arguments import answer_words, given
from ...ros.errors import BrokenCallError, CallError, NodeError, StartError

_LOOK_S = 0.1
_STEADY_LOOKS = 10
_CLOCK = "/clock"
_AFTER_NS = 300_000_000  # what is on its way at the end of the recording arrives
_CALL_S = 1.0
_PREFIX = "recorded/"
_STATUSES: Mapping[str, Any] = {
    "mission_planner/status": msg.MissionStatus,
    "data_recorder/status": msg.RecordingStatus,
}
_RECORDED_PEERS = ("autopilot", "mission_planner", "data_recorder")
ANSWERS: Mapping[str, Tuple[Any, Mapping[str, Any]]] = {
    name: (SERVICE_CLASSES[name], {row.ok: True}) for name, row in SERVICES.items() if row.peer in _RECORDED_PEERS
}
"""By the name of the service: its class, and the fields of the answer that say yes."""


class RecordedPeers:
    """Autopilot, planner and recorder of a recording, and the one who starts it."""

    def __init__(self) -> None:
        self._player = rospy.resolve_name(rospy.get_param("~player", "player"))
        self._listeners = tuple(rospy.resolve_name(name) for name in listeners())
        with Recording(Path(given("bag"))) as recording:
            self._span_ns = int(recording.start_ns or 0), int(recording.end_ns or 0)
        self._session = ""
        self._sessions: Dict[str, str] = {}
        self._lock = threading.Lock()
        self._publishers = {
            name: rospy.Publisher(name, kind, queue_size=100, tcp_nodelay=True) for name, kind in _STATUSES.items()
        }
        for name, kind in _STATUSES.items():
            rospy.Subscriber(_PREFIX + name, kind, self._pass_on, name, tcp_nodelay=True)
        self._services = [
            rospy.Service(name, kind, self._answerer(kind, fields)) for name, (kind, fields) in ANSWERS.items()
        ]

    # --- the peers ----------------------------------------------------------------------------------------------------

    def _answerer(self, kind: Any, fields: Mapping[str, Any]) -> Any:
        response = kind._response_class

        def answer(request: Any) -> Any:
            with self._lock:
                self._session = getattr(request, "session_id", "") or self._session
            return response(**fields)

        return answer

    def _pass_on(self, message: Any, name: str) -> None:
        """Publish a recorded status with the session of the running engine in the place of the recorded one."""
        with self._lock:
            if message.session_id and self._session:
                message.session_id = self._sessions.setdefault(message.session_id, self._session)
        self._publishers[name].publish(message)

    # --- the recording ------------------------------------------------------------------------------------------------

    def play(self) -> None:
        """Begin once all are connected, select the missions, return when the recording is over.

        Raises:
            StartError: somebody is not connected in time, or the missions are refused.
        """
        self._wait_connected()
        begin_ns, end_ns = self._span_ns
        rospy.wait_for_service(f"{self._player}/pause_playback", _CALL_S)
        rospy.ServiceProxy(f"{self._player}/pause_playback", SetBool)(False)
        missions = [word.strip() for word in str(rospy.get_param("~missions", "")).split(",") if word.strip()]
        if missions:
            self._wait_until(begin_ns + round(node_main.seconds("select_at_s", 0.0) * 1e9))
            answer = rospy.ServiceProxy("autonomy/select_mission", srv.SelectMission)(missions)
            if not answer.accepted:
                raise StartError(f"the missions are refused: {answer.message}")
        self._wait_until(end_ns + _AFTER_NS)
        self._write()

    def _wait_connected(self) -> None:
        """Wait until every node reads what it wants of the recording, and has asked for nothing new for a while."""
        deadline_s = time.monotonic() + node_main.seconds("limit_s", 20.0)
        wanted: Dict[str, List[str]] = {}
        steady, missing = 0, ["the player"]
        while (missing or steady < _STEADY_LOOKS) and not rospy.is_shutdown():
            if time.monotonic() > deadline_s:
                raise StartError(f"not connected in time, the recording is not played: {', '.join(missing)}")
            time.sleep(_LOOK_S)
            try:
                before, wanted = wanted, self._wanted()
                steady = steady + 1 if wanted == before else 0
                missing = self._missing(wanted)
            except (CallError, rosgraph.MasterException) as error:
                missing = [str(error)]
        self._check_use(wanted)

    def _wanted(self) -> Dict[str, List[str]]:
        """Return which topics of the player each node has subscribed to."""
        published, subscribed, _ = rosgraph.Master(rospy.get_name()).getSystemState()
        topics = [topic for topic, nodes in published if self._player in nodes]
        return {name: [topic for topic in topics if name in dict(subscribed).get(topic, ())] for name in self._all()}

    def _missing(self, wanted: Mapping[str, Sequence[str]]) -> List[str]:
        """Return what is not yet there: the clock, nodes, connections."""
        if not self._now_ns():
            return ["the player's clock"]
        select = rospy.resolve_name("autonomy/select_mission")
        offered = {name for name, _ in rosgraph.Master(rospy.get_name()).getSystemState()[2]}
        missing = [name for name in self._all() if not wanted[name]] + [
            each for each in [select] if each not in offered
        ]
        return missing + unconnected(wanted, self._receptions())

    def _check_use(self, wanted: Mapping[str, Sequence[str]]) -> None:
        """Say who reads nothing of the recording; refuse to play it to nobody."""
        idle = [name for name in self._listeners if not [topic for topic in wanted.get(name, ()) if topic != _CLOCK]]
        if len(idle) == len(self._listeners):
            raise StartError(
                "no node reads a topic of the recording: is it of this vehicle, and the configuration, too?"
            )
        if idle:
            rospy.logwarn("no topic of the recording is read by %s", ", ".join(idle))

    def _all(self) -> Tuple[str, ...]:
        return (*self._listeners, rospy.get_name())

    def _receptions(self) -> Tuple[Reception, ...]:
        """Ask every listener what it has received."""
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        found: List[Reception] = []
        for name in self._all():
            try:
                uri = call(master, "lookupNode", (me, name), _CALL_S)
                found += receptions(name, call(uri, "getBusStats", (me,), _CALL_S))
            except CallError as error:
                raise BrokenCallError(f"{name}: {error}") from error
        return tuple(found)

    def _wait_until(self, t_ns: int) -> None:
        while self._now_ns() < t_ns and not rospy.is_shutdown():
            time.sleep(0.005)

    def _write(self) -> None:
        path = given("result")
        if path:
            rows = [each._asdict() for each in self._receptions()]
            Path(path).write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")

    def _now_ns(self) -> int:
        return int(rospy.rostime.get_rostime().to_nsec())


def listeners() -> Tuple[str, ...]:
    """Return the names of the nodes that must be connected before it begins.

    Raises:
        StartError: ~listeners names none.
    """
    given_names = str(rospy.get_param("~listeners", None) or "").split(",")
    names = tuple(name.strip() for name in given_names if name.strip())
    if not names:
        right = "_listeners:=autonomy,watchdog; play_recording.launch starts it with its own"
        raise StartError(f"~listeners names no node that must be connected before it begins, e.g. {right}")
    return names


def main() -> int:
    """Run the node; return its exit status."""
    answered = answer_words("recorded_peers", __doc__)
    if answered is not None:
        return answered
    try:
        check_master_uri()
    except StartError as error:
        print(f"recorded_peers: {error}", file=sys.stderr, flush=True)
        return 2
    node_main.write_for_user_and_group()
    mend_rospy()
    rospy.init_node("recorded_peers")
    try:
        node_main.warn_of_parameters("recorded_peers")
        RecordedPeers().play()
    except (NodeError, BagError, rospy.ROSException, rospy.ServiceException) as error:
        if not rospy.is_shutdown():
            print(f"recorded_peers: {error}", file=sys.stderr, flush=True)
        return 1
    return 0


# --- played -----------------------------------------------------------------------------------------------------------
# How many messages a node has received of each topic: out of rospy's answer to getBusStats. Pure.
#  http://wiki.ros.org/ROS/Slave_API


_SUBSCRIBERS = 1
_MESSAGES = 2  # rospy: connection, bytes, messages, -1, whether it stands


class Reception(NamedTuple):
    """What a node has received of a topic.

    Args:
        topic: its name.
        listener: the node.
        messages: that it has read from its connections.
        connections: to publishers.
    """

    topic: str
    listener: str
    messages: int
    connections: int


def receptions(listener: str, stats: Sequence[Any]) -> Tuple[Reception, ...]:
    """Return what a node has received, by topic.

    Args:
        listener: name of the node.
        stats: its answer to getBusStats.
    """
    rows = stats[_SUBSCRIBERS] if len(stats) > _SUBSCRIBERS else ()
    return tuple(
        sorted(
            Reception(str(topic), listener, sum(int(row[_MESSAGES]) for row in connections), len(connections))
            for topic, connections in rows
        )
    )


def unconnected(wanted: Mapping[str, Sequence[str]], there: Sequence[Reception]) -> List[str]:
    """Return which listeners lack a connection to which topics, in words; `wanted`: topics by listener."""
    known = {(each.listener, each.topic) for each in there if each.connections}
    return [f"{node} to {topic}" for node, topics in wanted.items() for topic in topics if (node, topic) not in known]
