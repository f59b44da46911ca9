"""The node in front of our nodes that the engine of the CNS Flight Stack takes for its own: serve:=cns.

It offers the names and types of those that are served (`cns/tables.py`) and is pure apart from this shell
(`cns/served.py`, `cns/served_planner.py`). Their messages are imported at the start, from the user's workspace.
Words: `arguments.py`. Parameters, besides those of `node_main.py` and `names.py`:

~served         which of our nodes, with commas between; empty: all five
~entities       what its missions call our components, where that is another name: component=entity; ...
~hover          seconds that it hovers after its last waypoint before it lands by itself
"""

from __future__ import annotations

import itertools
import threading
import time
from functools import partial
from typing import Any, Callable, Dict, List, Mapping, Tuple

import rosgraph
import rospy
from genpy.message import fill_message_args

from amaze_autonomy import msg, srv
from amaze_autonomy.cns.peers import Publish
from amaze_autonomy.cns.served import (
    Entity,
    Notice,
    Response,
    Served,
    ServedCheck,
    ServedLanding,
    ServedRecorder,
    ServedWatchdog,
)
from amaze_autonomy.cns.served_planner import LoadWaypoints, PlannerSettings, ServedPlanner
from amaze_autonomy.cns.tables import PEERS
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import CheckReply, InvalidEventError, Outcome, Reply
from amaze_autonomy.interface import SERVICES as OURS
from amaze_autonomy.interface import STATUSES, InvalidMessageError, Status
from amaze_autonomy.missions import Frame
from amaze_autonomy.ros.clock import Clock, Periodic, Workers

from ...ros.errors import StartError
from ...ros.interface import SERVICE_CLASSES, message_class, read_status, ros_time
from ...ros.node_main import run_node, seconds
from ...ros.service_client import ServiceClient
from ..autonomy.requests import Requests
from .names import Names

_S = 1_000_000_000
_QUEUE = 50
_STEP_S = 0.05
_KEEP_NS = _S
_SAY_AGAIN_NS = 10 * _S
_LONGEST_HOVER_S = 600.0
_LONGEST_ANSWER_S = 36_000.0  # each answer has a limit of its own; a stop lasts until its recording is complete
_LOAD = "mission_planner/load_waypoints"
_TOLD: Mapping[str, Tuple[str, ...]] = {
    "watchdog": ("watchdog/action", "watchdog/info"),
    "landing_detection": ("landing_detection/landed",),
    "state_estimation": (),
    "mission_planner": ("mission_planner/status", "autopilot/status"),
    "data_recorder": ("data_recorder/status",),
}
"""Statuses that each is told."""
_FRAMES = {
    Frame.EAST_NORTH: srv.LoadWaypointsRequest.EAST_NORTH,
    Frame.START_HEADING: srv.LoadWaypointsRequest.START_HEADING,
}


class CnsServerNode:
    """Our nodes as its engine sees them, under one lock, and the ROS names around them.

    Args:
        configuration: as loaded.
        clock: the node's.

    Raises:
        StartError: a parameter is wrong, or a message of theirs is missing or another one.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._clock = clock
        self._names = Names("served")
        names = self._names.peers
        self._served = _make(names, configuration)
        self._changed = threading.Condition()
        self._number, self._ended = 0, False
        self._responses: Dict[int, Mapping[str, Any]] = {}
        self._owners: Dict[int, str] = {}
        self._said: Dict[str, int] = {}
        self._workers = Workers("cns")
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        ours = {name: row for name, row in OURS.items() if row.peer in names or name == "autopilot/land"}
        clients = {name: ServiceClient(rospy.resolve_name(name), SERVICE_CLASSES[name], master, me) for name in ours}
        self._load_client = ServiceClient(rospy.resolve_name(_LOAD), srv.LoadWaypoints, master, me)
        self._requests = Requests(clients, self._take_reply, clock.now_ns)
        self._keeping = Periodic("connections", self._requests.keep_connected, _KEEP_NS, clock)
        self._senders = {
            key: rospy.Publisher(
                self._names.resolved(name),
                self._names.classes[key],
                subscriber_listener=_Late(self._greet) if key == "log" else None,
                queue_size=_QUEUE,
                tcp_nodelay=True,
            )
            for key, name in self._names.topics.items()
            if name.heard
        }

    # --- theirs; on rospy's threads -------------------------------------------------------------------------------

    def _hear(self, key: str, message: Any) -> None:
        name = self._names.topics[key].peer
        with self._changed:
            self._served[name].heard(self._clock.now_ns(), key, message)
            self._send(name)

    def _call(self, key: str, request: Any) -> Any:
        """Answer one of their calls, which may take as long as theirs do."""
        name = self._names.services[key].peer
        with self._changed:
            self._number += 1
            number = self._number
            self._served[name].asked(self._clock.now_ns(), number, request)
            self._send(name)
            self._changed.wait_for(lambda: number in self._responses or self._ended, _LONGEST_ANSWER_S)
            fields = self._responses.pop(number, None)
        if fields is None:
            raise rospy.ServiceException(f"{self._names.services[key].name}: no answer")
        return self._filled(self._names.classes[key]._response_class, fields)

    def _greet(self, publish: Callable[[Any], None]) -> None:
        """Tell a late listener of the log what was missed, on another thread: this one holds a lock of rospy."""
        self._workers.submit(partial(self._tell_whole, publish))

    def _tell_whole(self, publish: Callable[[Any], None]) -> None:
        with self._changed:
            watchdog = self._served["watchdog"]
            whole = watchdog.whole if isinstance(watchdog, ServedWatchdog) else None
            if whole is not None:
                publish(self._filled(self._names.classes["log"], whole.fields))

    # --- ours; on rospy's threads and on workers --------------------------------------------------------------------

    def _tell(self, status: Status, names: Tuple[str, ...], message: Any) -> None:
        with self._changed:
            now_ns = self._clock.now_ns()
            try:
                event = read_status(status, message, now_ns, self._clock.ros_ns())
            except (InvalidMessageError, InvalidEventError) as error:
                self._say(f"{status.topic}: {error}")
                return
            for name in names:
                self._served[name].told(now_ns, event)
                self._send(name)

    def _take_reply(self, reply: Any) -> None:
        if not isinstance(reply, (Reply, CheckReply)):
            return
        with self._changed:
            name = self._owners.pop(reply.command_id)
            self._served[name].replied(self._clock.now_ns(), reply)
            self._send(name)

    def _load(self, command: LoadWaypoints) -> None:
        """Have our planner load waypoints."""
        points = [
            msg.Waypoint(x=each.x_m, y=each.y_m, z=each.z_m, yaw=each.yaw_rad, hold=each.hold_s)
            for each in command.waypoints
        ]
        asked = srv.LoadWaypointsRequest(command.session_id, command.mission_id, _FRAMES[command.frame], points)
        try:
            data = self._load_client.serialize(asked)
            answer = self._load_client.call(data, time.monotonic() + command.limit_ns / _S)
            outcome, problem = (Outcome.ACCEPTED if answer.accepted else Outcome.REFUSED), answer.message
        except Exception as error:  # a request without a reply would be a wait without an end
            outcome, problem = Outcome.BROKEN, f"{_LOAD}: {error}"
        reply = Reply(t_ns=self._clock.now_ns(), command_id=command.id, outcome=outcome, message=problem)
        self._take_reply(reply)

    # --- what is sent; under the lock, so that it keeps its order -----------------------------------------------------

    def _send(self, name: str) -> None:
        outbox, self._served[name].outbox = self._served[name].outbox, []
        for each in outbox:
            if isinstance(each, Publish):
                self._senders[each.key].publish(self._filled(self._names.classes[each.key], each.fields))
            elif isinstance(each, Response):
                self._responses[each.number] = each.fields
                self._changed.notify_all()
            elif isinstance(each, Notice):
                self._say(each.text)
            else:
                self._owners[each.id] = name
                if isinstance(each, LoadWaypoints):
                    self._workers.submit(partial(self._load, each))
                else:
                    self._requests.send(each)

    def _say(self, text: str) -> None:
        """Tell people; the same again after a while."""
        now_ns = self._clock.now_ns()
        self._said = {said: t_ns for said, t_ns in self._said.items() if now_ns - t_ns < _SAY_AGAIN_NS}
        if text not in self._said:
            self._said[text] = now_ns
            rospy.logwarn("%s", text)

    def _filled(self, kind: Any, fields: Mapping[str, Any]) -> Any:
        message = kind()
        fill_message_args(message, [dict(fields)])
        if hasattr(message, "header"):
            message.header.stamp = ros_time(self._clock.ros_ns())
        return message

    # --- life -------------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Listen, answer and tell until `end`."""
        for status in STATUSES:
            names = tuple(name for name in self._served if status.topic in _TOLD[name])
            if names:
                tell = partial(self._tell, status, names)
                rospy.Subscriber(status.topic, message_class(status), tell, queue_size=_QUEUE, tcp_nodelay=True)
        for key, name in self._names.topics.items():
            if not name.heard:
                hear, topic = partial(self._hear, key), self._names.resolved(name)
                rospy.Subscriber(topic, self._names.classes[key], hear, queue_size=_QUEUE, tcp_nodelay=True)
        for key, name in self._names.services.items():
            rospy.Service(self._names.resolved(name), self._names.classes[key], partial(self._call, key))
        self._keeping.start()
        rospy.loginfo("the engine of the CNS Flight Stack is served by our %s", ", ".join(self._served))
        with self._changed:
            while not self._ended:
                for peer, served in self._served.items():
                    served.step(self._clock.now_ns())
                    self._send(peer)
                self._changed.wait(_STEP_S)
        self._keeping.stop()
        self._requests.close()

    def end(self) -> None:
        """End; from any thread."""
        self._ended = True


class _Late(rospy.SubscribeListener):
    """Notices who begins to listen."""

    def __init__(self, greet: Callable[[Callable[[Any], None]], None]) -> None:
        super().__init__()
        self._greet = greet

    def peer_subscribe(self, _topic: str, _publish: Any, publish_one: Any) -> None:
        """Greet one that has come."""
        self._greet(publish_one)


# --- parameters -------------------------------------------------------------------------------------------------------


def _make(names: Tuple[str, ...], configuration: Configuration) -> Dict[str, Served]:
    """Return what is served, by our nodes' names."""
    rules, ids = configuration.rules, itertools.count(1)
    begin = time.strftime("%Y%m%dT%H%M%SZ-cns", time.gmtime())
    check = {row.peer: row.check for row in OURS.values() if row.check is not None and row.peer in PEERS}
    reply_ns = {peer: rules.reply_limit_ns(each.value) for peer, each in check.items()}
    settings = PlannerSettings(
        configuration.plans,
        rules.limits,
        begin,
        configuration.planner.acceptance_radius_m,
        round(seconds("hover", 60.0, _LONGEST_HOVER_S) * _S),
        round(configuration.bounds.max_hold_s * _S),
    )
    makers: Mapping[str, Callable[[], Served]] = {
        "watchdog": lambda: ServedWatchdog(ids, check["watchdog"], _entities(configuration), reply_ns["watchdog"]),
        "landing_detection": lambda: ServedLanding(ids, check["landing_detection"], reply_ns["landing_detection"]),
        "state_estimation": lambda: ServedCheck(ids, check["state_estimation"], reply_ns["state_estimation"]),
        "mission_planner": lambda: ServedPlanner(ids, settings),
        "data_recorder": lambda: ServedRecorder(ids, rules, begin),
    }
    return {name: makers[name]() for name in names}


def _entities(configuration: Configuration) -> Dict[str, Entity]:
    """Return what its engine calls our components."""
    known: List[str] = [spec.name for spec in configuration.components]
    given: Dict[str, str] = {}
    for part in filter(None, (each.strip() for each in str(rospy.get_param("~entities", "")).split(";"))):
        component, equals, entity = (each.strip() for each in part.partition("="))
        if not equals or not entity or component not in known:
            raise StartError(f"~entities has {part!r}, must be component=entity with one of {', '.join(known)}")
        given[component] = entity
    return {spec.name: Entity.of(spec, given.get(spec.name, "")) for spec in configuration.components}


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("cns_server", CnsServerNode)
