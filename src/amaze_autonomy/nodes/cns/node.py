"""The node that stands between our engine and nodes of the CNS Flight Stack: peers:=cns.

It offers the services and statuses of the peers that those nodes are (`cns/tables.py` has their names and types), and
is pure apart from this shell. Their messages are imported at the start, from the user's workspace. Where their recorder
writes is a word: `arguments.py`. Parameters, besides those of `node_main.py` and `names.py`:

~peers    which of them, with commas between; empty: all five
~bounds   of the sequencer's waypoints: least x, y, z and most x, y, z in metres; empty: not checked

A node that is started again in flight goes on with what the last one has kept in ROS_HOME.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import shlex
import subprocess
import threading
from dataclasses import replace
from functools import partial
from math import atan2
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import rosgraph
import rospy

from amaze_autonomy import msg
from amaze_autonomy.cns.peers import (
    Call,
    Folder,
    LandingDetection,
    Peer,
    Publish,
    Recorder,
    StateEstimation,
    Watchdog,
)
from amaze_autonomy.cns.sequencer import ANYWHERE, Bounds, Sequencer
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import CheckReply, Event, MissionStatus, Reply
from amaze_autonomy.interface import SERVICES as OURS
from amaze_autonomy.interface import STATUSES, Service, status_of
from amaze_autonomy.monitoring.readings import estimate_reader
from amaze_autonomy.ros.clock import Clock, Periodic, Workers

from ...autopilot.link.state_files import read_kept
from ...files import temporary_name
from ...paths import expanded
from ...ros.arguments import given
from ...ros.errors import CallError, StartError
from ...ros.interface import SERVICE_CLASSES, message_class, response_of, ros_time, status_message
from ...ros.node_main import run_node
from ...ros.service_client import ServiceClient
from ..autonomy.run_folder import boot_id, default_parent
from ..checks.landing_detection_node import ESTIMATE_MESSAGES
from ..checks.state_estimation_node import Estimator
from .names import Names

_S = 1_000_000_000
_QUEUE = 50
_STEP_S = 0.05
_LOOK_NS = _S // 2
_SSH_S = 4.0
_LONGEST_ANSWER_S = 120.0
_CORNERS = 6
_FORGOTTEN_NS, _STAMP_NS = 20 * _S, _S


class CnsPeersNode:
    """The peers under one lock, and the ROS names around them.

    Args:
        configuration: as loaded.
        clock: the node's.

    Raises:
        StartError: a parameter is wrong, or a message of theirs is missing or another one.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._clock, self._configuration = clock, configuration
        self._names = Names("peers")
        names = self._names.peers
        self._folders = _folders(configuration)
        self._peers: Dict[str, Peer] = {name: self._peer(name) for name in names}
        self._memory = Memory(default_parent() / f"{rospy.get_name().strip('/').replace('/', '.')}.json")
        self._memory.restore(clock.now_ns(), self._peers)
        self._changed = threading.Condition()
        self._replies: Dict[int, Event] = {}
        self._number = 0
        self._ended = False
        self._planner_said = ""
        self._workers = Workers("cns")
        self._estimator = Estimator(configuration, clock)
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        self._clients = {
            key: ServiceClient(self._names.resolved(name), self._names.classes[key], master, me)
            for key, name in self._names.services.items()
        }
        self._listeners: Dict[str, Any] = {}
        self._senders = {
            key: rospy.Publisher(
                self._names.resolved(name), self._names.classes[key], queue_size=_QUEUE, tcp_nodelay=True
            )
            for key, name in self._names.topics.items()
            if not name.heard
        }
        self._statuses = {
            status.topic: rospy.Publisher(status.topic, message_class(status), queue_size=_QUEUE, tcp_nodelay=True)
            for status in STATUSES
            if status.topic.split("/")[0] in names
        }
        self._looking = lookers(self._folders if "data_recorder" in names else {}, self._look, clock)

    def _peer(self, name: str) -> Peer:
        configuration = self._configuration
        rules, streams = configuration.rules, configuration.streams
        if name == "watchdog":
            return Watchdog(rules, configuration.missions, streams.watchdog_action_rate_hz)
        if name == "landing_detection":
            return LandingDetection(rules, streams.landing_detection_rate_hz)
        if name == "state_estimation":
            return StateEstimation(rules)
        if name == "mission_planner":
            _check_reference(rospy.get_param("~waypoint_reference", 1))
            bounds = _bounds(rospy.get_param("~bounds", ""))
            if bounds is ANYWHERE:
                rospy.logwarn("~bounds is empty: waypoints that the sequencer skips are noticed in flight alone")
            return Sequencer(configuration.plans, rules.limits, streams.planner_status_rate_hz, bounds)
        recording = configuration.recording
        growth_ns, stop_ns = recording.growth_limit_ns, rules.limits.data_cleanup_limit_ns
        return Recorder(self._folders, growth_ns, stop_ns, streams.recorder_status_rate_hz)

    # --- theirs; on rospy's threads -------------------------------------------------------------------------------

    def _hear(self, key: str, message: Any) -> None:
        with self._changed:
            self._peers[self._names.topics[key].peer].hear(self._clock.now_ns(), key, message)
            self._changed.notify_all()

    def _call(self, peer: str, call: Call) -> None:
        """Ask one of their services, on a thread of its own: it may block for as long as it likes, up to its limit."""
        client = self._clients[call.key]
        response, problem = None, ""
        try:
            data = client.serialize(client.service._request_class(**call.fields))
            response = client.call(data, _deadline_s(call.limit_ns))
        except CallError as error:
            problem = f"{client.name} {error}"
        with self._changed:
            self._peers[peer].returned(self._clock.now_ns(), call.key, response, problem)
            self._changed.notify_all()

    def _send(self, peer: str) -> None:
        """Send what a peer has in its outbox; under the lock, so that requests keep their order."""
        outbox, self._peers[peer].outbox = self._peers[peer].outbox, []
        if outbox:
            self._memory.keep(self._clock.now_ns(), self._peers)  # what was asked is known after whatever happens next
        for each in outbox:
            if isinstance(each, Publish):
                self._senders[each.key].publish(self._message(each))
            else:
                self._workers.submit(partial(self._call, peer, each))

    def _message(self, publish: Publish) -> Any:
        kind, fields = self._names.classes[publish.key], dict(publish.fields)
        if "waypoints" in fields:
            package = self._names.topics[publish.key].type.split("/")[0]
            point = importlib.import_module(f"{package}.msg").MissionWaypoint
            fields["waypoints"] = [point(**each) for each in fields["waypoints"]]
        message = kind(**fields)
        message.header.stamp = ros_time(self._clock.ros_ns())
        return message

    def _turn(self, message: Any) -> None:
        """Take the vehicle's heading from the estimate."""
        x, y, z, w = estimate_reader(self._configuration.state_estimation.source)(message).orientation
        heading = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        planner = self._peers["mission_planner"]
        if isinstance(planner, Sequencer) and heading == heading:  # noqa: PLR0124 - not NaN
            with self._changed:
                planner.turn(self._clock.now_ns(), heading)

    def _see_vehicle(self, message: Any) -> None:
        """Take whether the vehicle is armed: what is under way then is not ended by a load."""
        planner = self._peers["mission_planner"]
        if isinstance(planner, Sequencer):
            with self._changed:
                planner.see_vehicle(self._clock.now_ns(), armed=message.armed if message.armed_known else None)

    def _look(self, platform: str, folder: Optional[Folder]) -> None:
        recorder = self._peers["data_recorder"]
        if isinstance(recorder, Recorder):
            with self._changed:
                recorder.look(self._clock.now_ns(), platform, folder)

    # --- ours -----------------------------------------------------------------------------------------------------

    def _answer(self, service: Service, request: Any) -> Any:
        with self._changed:
            self._number += 1
            number, now_ns = self._number, self._clock.now_ns()
            rules = self._configuration.rules
            limit_ns = rules.reply_limit_ns(service.check.value if service.check is not None else "")
            reply = self._peers[service.peer].carry_out(now_ns, service, service.command(request, number, limit_ns))
            self._send(service.peer)
            if reply is None:
                self._changed.wait_for(lambda: number in self._replies or self._ended, _LONGEST_ANSWER_S)
                reply = self._replies.pop(number, None)
            if not isinstance(reply, (Reply, CheckReply)):
                raise rospy.ServiceException(f"{service.name}: no answer")
            if service.peer == "state_estimation" and isinstance(reply, CheckReply):
                rows = reply.checks
                reply = replace(reply, checks=self._estimator.rows(lambda: rows))
            return response_of(service, reply, self._clock.now_ns())

    def _step(self) -> None:
        now_ns = self._clock.now_ns()
        for name, peer in self._peers.items():
            self._notice(name, peer)
            for event in peer.step(now_ns):
                if isinstance(event, (Reply, CheckReply)):
                    self._replies[event.command_id] = event
                    self._changed.notify_all()
                else:
                    self._tell(event)
                    message = status_message(event, self._clock.ros_ns())
                    self._statuses[status_of(event).topic].publish(message)
            self._send(name)
        self._memory.keep(now_ns, self._peers)

    def _tell(self, event: Event) -> None:
        """Tell a person what the planner says, once: that waypoints were skipped ends no flight."""
        if not isinstance(event, MissionStatus) or event.message == self._planner_said:
            return
        self._planner_said = event.message
        if event.message:
            rospy.logwarn("mission planner: %s", event.message)

    def _notice(self, name: str, peer: Peer) -> None:
        """Notice whether anybody is there to say what comes next."""
        key = {"mission_planner": "response", "landing_detection": "is_landed"}.get(name)
        if key is not None and isinstance(peer, (Sequencer, LandingDetection)):
            peer.alive = self._listeners[key].get_num_connections() > 0

    def run(self) -> None:
        """Listen, answer and tell until `end`."""
        for key, name in self._names.topics.items():
            if name.heard:
                take = partial(self._hear, key)
                topic, kind = self._names.resolved(name), self._names.classes[key]
                self._listeners[key] = rospy.Subscriber(topic, kind, take, queue_size=_QUEUE, tcp_nodelay=True)
        if "mission_planner" in self._peers:
            self._listen_to_the_vehicle()
        for service in OURS.values():
            if service.peer in self._peers:
                rospy.Service(service.name, SERVICE_CLASSES[service.name], partial(self._answer, service))
        if "state_estimation" in self._peers:
            self._estimator.listen()
        for each in self._looking:
            each.start()
        rospy.loginfo("nodes of the CNS Flight Stack are the engine's %s", ", ".join(self._peers))
        with self._changed:
            while not self._ended:
                self._step()
                self._changed.wait(_STEP_S)
        for each in self._looking:
            each.stop()

    def _listen_to_the_vehicle(self) -> None:
        """Hear its heading, and whether it is armed, for the mission planner."""
        states = self._configuration.state_estimation
        if states.topic:
            rospy.Subscriber(states.topic, ESTIMATE_MESSAGES[states.source], self._turn, queue_size=1, tcp_nodelay=True)
        kind = msg.AutopilotStatus
        rospy.Subscriber("autopilot/status", kind, self._see_vehicle, queue_size=1, tcp_nodelay=True)

    def end(self) -> None:
        """End; from any thread."""
        self._ended = True


def _deadline_s(limit_ns: int) -> float:
    import time  # noqa: PLC0415 - the clock of sockets, which no other line here reads

    return time.monotonic() + limit_ns / _S


# --- memory -----------------------------------------------------------------------------------------------------------


class Memory:
    """What the peers must know of a flight, in a file for a process that is started again.

    It is for the end of a process, not of the computer: it is not put on the disk, and of no worth after a boot, nor
    when it is old: then nobody says that it is the same flight.

    Args:
        path: of the file.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._boot = path, boot_id()
        self._last, self._stamp_ns = "", 0

    def keep(self, t_ns: int, peers: Mapping[str, Peer]) -> None:
        """Write what is to be kept when it has changed, and once a second that it still holds."""
        kept = {name: each for name, each in ((name, peer.kept()) for name, peer in peers.items()) if each}
        text = json.dumps(kept, sort_keys=True)
        if text == self._last and (not kept or t_ns - self._stamp_ns < _STAMP_NS):
            return
        part = temporary_name(self._path)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(json.dumps({"boot": self._boot, "t_ns": t_ns, "peers": kept}), encoding="utf-8")
            part.replace(self._path)
        except OSError as error:
            rospy.logwarn_throttle(60.0, f"{error}; started again in flight, this node will not know the mission")
            return
        self._last, self._stamp_ns = text, t_ns

    def restore(self, t_ns: int, peers: Mapping[str, Peer]) -> None:
        """Have the peers go on with what was kept, where it is of this flight."""
        found = read_kept(self._path)
        kept, then_ns = found.get("peers"), found.get("t_ns")
        if found.get("boot") != self._boot or not isinstance(kept, dict) or not isinstance(then_ns, int):
            return
        if not 0 <= t_ns - then_ns <= _FORGOTTEN_NS:
            return
        for name, each in kept.items():
            try:
                peers[name].restore(t_ns, each)
            except (KeyError, TypeError, ValueError) as error:
                rospy.logwarn("%s: what was kept of %s is not understood: %r", self._path, name, error)
            else:
                rospy.logwarn("started again: %s goes on with what it knew %.1f s ago", name, (t_ns - then_ns) / _S)


# --- parameters -------------------------------------------------------------------------------------------------------


def _bounds(value: Any) -> Bounds:
    words = str(value).replace(" ", "").strip("[]").split(",")
    if words == [""]:
        return ANYWHERE
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != _CORNERS or not all(low < high for low, high in zip(numbers, numbers[3:])):
        raise StartError(f"~bounds is {value!r}, must be least x,y,z and most x,y,z in metres, e.g. -5,-5,0,5,5,3")
    return Bounds((numbers[0], numbers[1], numbers[2]), (numbers[3], numbers[4], numbers[5]))


def _check_reference(value: Any) -> None:
    """Refuse what earlier versions took: only the number in the message changed by it, the waypoints did not."""
    if value not in (1, "1"):
        right = "leave it out: waypoints count from where it started, which is 1 in its message"
        raise StartError(f"~waypoint_reference is {value!r}; {right}")


def _folders(configuration: Configuration) -> Dict[str, str]:
    recording = configuration.recording
    places = given("recordings") or f"{recording.collector}={recording.folder}"
    found: Dict[str, str] = {}
    for part in filter(None, (each.strip() for each in places.split(";"))):
        platform, equals, place = part.partition("=")
        if not equals or not platform or not place:
            raise StartError(f"--recordings has {part!r}, must be platform=[host:]folder")
        found[platform] = place
    return found


# --- folders ----------------------------------------------------------------------------------------------------------


def lookers(
    folders: Mapping[str, str], take: Callable[[str, Optional[Folder]], None], clock: Clock
) -> Tuple[Periodic, ...]:
    """Return what looks at each platform's folder, on a thread of its own: a host that hangs holds up no other one.

    Args:
        folders: [host:]folder by platform.
        take: what is told a platform, and what lies in its folder; None: it cannot be seen.
        clock: the node's.
    """
    return tuple(
        Periodic(f"recordings of {platform}", partial(_tell, take, platform, place), _LOOK_NS, clock)
        for platform, place in folders.items()
    )


def _tell(take: Callable[[str, Optional[Folder]], None], platform: str, place: str) -> None:
    take(platform, _folder(place))


def _folder(place: str) -> Optional[Folder]:
    """Return what lies in a folder, of this computer or, as host:folder, of another; None: it cannot be seen."""
    host, colon, path = place.partition(":")
    if colon and "/" not in host:
        return _there(host, path)
    here = expanded(place)
    if not here.is_dir():
        return None
    sizes: List[Tuple[str, int]] = []
    for folder, _, files in os.walk(here):
        for file in files:
            try:
                sizes.append((file, (Path(folder) / file).stat().st_size))
            except OSError:
                continue  # renamed meanwhile: it is counted the next time
    return _counted(sizes)


_HOME = re.compile(r"~[A-Za-z0-9._-]*")


def _there(host: str, path: str) -> Optional[Folder]:
    home, slash, rest = path.partition("/")  # the other computer knows where somebody's home is
    where = f"{home}{slash}{shlex.quote(rest)}" if _HOME.fullmatch(home) else shlex.quote(path)
    command = ["ssh", "-o", "BatchMode=yes", "-o", "ConnectTimeout=3", "--", host]
    command.append(f"find {where} -type f -printf '%s %f\\n'")
    try:
        done = subprocess.run(  # not its stderr: a connection that it keeps open for the next look has that
            command, stdin=DEVNULL, stdout=PIPE, stderr=DEVNULL, text=True, timeout=_SSH_S, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    rows = (line.split(" ", 1) for line in done.stdout.splitlines())
    return _counted([(name, int(size)) for size, name in rows])


def _counted(sizes: Sequence[Tuple[str, int]]) -> Folder:
    return Folder(sum(size for _, size in sizes), sum(name.endswith(".active") for name, _ in sizes))


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("cns_peers", CnsPeersNode)
