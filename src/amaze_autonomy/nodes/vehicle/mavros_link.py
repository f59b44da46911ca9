"""The way to the vehicle through a running mavros, with the face of a `Connection`: topics in, services out.

Subscribes to the topics of which the wanted messages are made, calls `set_mode`, `cmd/command`, `param/get` and
`mission/*`, publishes `setpoint_raw/local`. Behind it is PX4 or ArduPilot, by the names of its modes; what no topic has
of it is taken from `mavlink/from` beside mavros' namespace (`messages.py`). Services are called by threads of their
own, one for each lane, each call within a limit; what was asked twice meanwhile is asked once, and a command that has
waited is dropped unless it lands. For a mode and an arming a connection stays open: a landing needs no ROS master.

What a topic says, the vehicle has said. What a service answers, mavros has: that a mode was sent, what it remembers of
parameters and missions. It is handed on as MAVLink, and is no sign that the vehicle is there.
"""

from __future__ import annotations

import functools
import importlib
import queue
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Any, Callable, Deque, Dict, FrozenSet, Iterable, Optional, Tuple

import rosgraph
import rospy

from amaze_autonomy.autopilot import Client, LinkState

from ...autopilot.link.connection import ClientHost
from ...autopilot.link.dialect import Message, mavlink
from ...autopilot.mavros.messages import (
    RECEIVED,
    RECEIVED_OF,
    STATE,
    TAKEN_FROM_RECEIVED,
    VEHICLE,
    WAYPOINTS,
    Converter,
    Source,
    sources_of,
)
from ...autopilot.mavros.requests import (
    CALL_LIMITS_S,
    COMMAND_SERVICES,
    MISSION_SERVICES,
    SERVICES,
    SETPOINTS,
    Lane,
    MavrosMission,
    Publication,
    Request,
    is_late,
    publication_of,
    request_of,
)
from ...ros.errors import CallError, StartError
from ...ros.service_client import ServiceClient

_QUEUE, _RECEIVED = 20, 200
_WAKE_S = 0.05
_WAITING = 16
_LOOK_S = 0.5  # between two looks at a connection that stays open
_HOW = "install mavros for this ROS, or use backend: mavlink through mavros' GCS port (docs/autopilot.md)"
_TYPES = ("mavros_msgs/Waypoint", SETPOINTS.kind)


class MavrosLink(ClientHost):
    """A link through mavros.

    Args:
        namespace: of mavros.
        client: what lives on it.
        wanted: names of the messages that the client wants; with MISSION_CURRENT missions are sent, too.
        now_ns: the clock that stamps what the client is given.
        complain: is told of each new kind of problem.

    Raises:
        StartError: mavros_msgs is not installed.
    """

    def __init__(
        self,
        namespace: str,
        client: Client,
        wanted: Iterable[str],
        now_ns: Callable[[], int],
        complain: Callable[[str], None],
    ) -> None:
        super().__init__(client, now_ns, complain)
        self._namespace, self._converter, self._mission = namespace, Converter(), MavrosMission()
        self._requests: Dict[Lane, queue.Queue[Tuple[int, Request]]] = {lane: queue.Queue(_WAITING) for lane in Lane}
        self._ended = threading.Event()
        self._heartbeat_ns: Any = None
        self._mavros_name = rospy.resolve_name(namespace)
        self._listens = self._knows_target = self._hears_our_mavros = False
        self._frames = self._unsent = 0
        self._publisher: Any = None
        names = frozenset(wanted)
        self._kinds = {source: _message(source.kind) for source in sources_of(names)}
        self._wanted = frozenset(number for number, kind in TAKEN_FROM_RECEIVED.items() if kind.msgname in names)
        self._of_received: FrozenSet[int] = frozenset()
        flies = WAYPOINTS in self._kinds
        called = {**SERVICES, **(MISSION_SERVICES if flies else {})}
        self._services = {name: self._client_of(name, kind) for name, kind in called.items()}
        self._types = {name: _message(name) for name in (_TYPES if flies else ())}

    def _client_of(self, name: str, kind: str) -> ServiceClient:
        resolved = rospy.resolve_name(f"{self._namespace}/{name}")
        return ServiceClient(resolved, _service(kind), rosgraph.get_master_uri(), rospy.get_name())

    def start(self) -> None:
        """Subscribe, and begin to look at the time. In flight no master is asked: it may hang, or be gone."""
        if self._types:
            topic = f"{self._namespace}/{SETPOINTS.topic}"
            self._publisher = rospy.Publisher(topic, self._types[SETPOINTS.kind], queue_size=1, tcp_nodelay=True)
        for source, kind in self._kinds.items():
            if source is not RECEIVED:
                topic = f"{self._namespace}/{source.topic}"
                rospy.Subscriber(topic, kind, self._take, callback_args=source, queue_size=_QUEUE, tcp_nodelay=True)
        threading.Thread(target=self._wake, name="mavros wake", daemon=True).start()
        for lane in Lane:
            threading.Thread(target=self._serve, args=(lane,), name=f"mavros {lane.value}", daemon=True).start()

    def close(self) -> None:
        """Send what waits, and end."""
        deadline = rospy.Time.now() + rospy.Duration(1.0)
        while any(not self._requests[lane].empty() for lane in COMMAND_SERVICES) and rospy.Time.now() < deadline:
            self._ended.wait(0.02)
        self._ended.set()

    @property
    def address(self) -> Tuple[int, int]:
        """System and component of the vehicle; mavros addresses it by itself."""
        return VEHICLE

    @property
    def state(self) -> LinkState:
        """How it is."""
        return LinkState(
            opened=True,
            problem="",
            vehicle=self._converter.target[0] if self._knows_target else None,
            heartbeat_ns=self._heartbeat_ns,
            others=(),
            strangers=self._strangers(),
            mixed=True,
            frames=self._frames,
            damaged_bytes=0,
            refused=0,
            unsent=self._unsent,
            doubles=0,
            errors=self._errors,
        )

    def _strangers(self) -> Optional[Tuple[str, ...]]:
        with self._changed:
            return self._converter.strangers(self._now_ns())

    # --- threads --------------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        """Take what mavros receives of the vehicle that it flies; in a thread of its own, since the master is asked."""
        topic = f"{self._namespace.rpartition('/')[0]}/{RECEIVED.topic}"
        try:
            self._converter.target = (self._target("system"), self._target("component"))
            self._knows_target = True
            rospy.Subscriber(topic, self._kinds[RECEIVED], self._take_received, queue_size=_RECEIVED, tcp_nodelay=True)
        except (OSError, TypeError, ValueError, rosgraph.MasterException, rospy.ROSException) as error:
            self._listens = False  # with the next state it is tried again
            rospy.logerr("%s: %s", topic, error)

    def _target(self, name: str) -> int:
        return int(rospy.get_param(f"{self._namespace}/target_{name}_id", 1))

    def _take_received(self, message: Any) -> None:
        with self._changed:
            if not self._is_of_our_mavros(message):
                return
            self._converter.note_sender(self._now_ns(), message)
        if message.msgid in self._of_received:
            self._take(message, RECEIVED)

    def _is_of_our_mavros(self, message: Any) -> bool:
        """Return whether what came on the topic of all mavros beside each other may be of ours.

        A mavros is named as its namespace. Until it has said something, whoever speaks may hand on what it says.
        """
        sender = (getattr(message, "_connection_header", None) or {}).get("callerid", "")
        if sender == self._mavros_name and not self._hears_our_mavros:
            self._hears_our_mavros = True
            self._converter.forget_senders()  # those of somebody else
        return sender == self._mavros_name or not self._hears_our_mavros

    def _take(self, message: Any, source: Source) -> None:
        with self._changed:
            self._frames += 1
            for made in self._made(source, message):
                self._give(made)
            self._announce()

    def _made(self, source: Source, message: Any) -> Iterable[Message]:
        if source is WAYPOINTS:
            return self._mission.listed(message)
        made = self._converter.convert(source, message)
        if source is STATE:
            self._look_behind(message)
        return () if made is None else (made,)

    def _look_behind(self, message: Any) -> None:
        """Say what is wrong with the mode; listen to what this autopilot sends, from when it is known which it is."""
        behind = self._converter.behind
        problem = behind.problem(message)
        if problem:
            self._say(problem)
        self._of_received = RECEIVED_OF.get(behind.autopilot, frozenset()) & self._wanted
        if self._of_received and not self._listens:
            self._listens = True
            threading.Thread(target=self._listen, name="mavros received", daemon=True).start()

    def _give(self, message: Message) -> None:
        """Give the client a message, and send what it says to it."""
        t_ns = self._now_ns()
        if message.get_type() == "HEARTBEAT":
            self._heartbeat_ns = t_ns
        self._tell(lambda: self._client.receive(t_ns, message))

    def _answer(self, message: Message) -> None:
        """Give the client what mavros answered in the vehicle's place."""
        t_ns = self._now_ns()
        self._tell(lambda: self._client.receive(t_ns, message, heard=False))

    def _wake(self) -> None:
        woke_s = -_WAKE_S
        while not self._ended.wait(_WAKE_S):
            before_s, woke_s = woke_s, time.monotonic()
            read = woke_s - before_s < 2 * _WAKE_S  # nobody sees whether rospy has read all: it has had the time
            with self._changed:
                self._tell(functools.partial(self._client.wake, self._now_ns(), read=read))
                for message in self._mission.wake(read=read):
                    self._answer(message)
                self._announce()

    def _transmit(self, messages: Iterable[Message]) -> None:
        """Send messages; what the mission answers at once makes the client say more."""
        waiting: Deque[Message] = deque(messages)
        while waiting:
            message = waiting.popleft()
            taken = self._mission.take(message)
            if taken is None:
                self._pass_on(message)
                continue
            for request in taken.requests:
                self._enqueue(request)
            for answer in taken.answers:
                waiting.extend(self._client.receive(self._now_ns(), answer, heard=False))

    def _pass_on(self, message: Message) -> None:
        publication, request = publication_of(message), request_of(message, self._converter.behind.autopilot)
        if publication is not None:
            self._publish(publication)
        elif request is not None:
            self._enqueue(request)

    def _publish(self, publication: Publication) -> None:
        message = self._types[publication.kind]()
        for name, value in publication.fields.items():
            *outer, inner = name.split(".")
            setattr(getattr(message, outer[0]) if outer else message, inner, value)
        message.header.stamp = rospy.Time.now()
        self._publisher.publish(message)

    def _enqueue(self, request: Request) -> None:
        waiting = self._requests[request.lane]
        if any(request == each for _, each in tuple(waiting.queue)):
            return
        try:
            waiting.put_nowait((time.monotonic_ns(), request))
        except queue.Full:
            self._unsent += 1

    def _serve(self, lane: Lane) -> None:
        while not self._ended.is_set():
            try:
                self._serve_once(lane)
            except Exception as error:  # whatever it is: a landing comes after it
                self._failed("", error)

    def _serve_once(self, lane: Lane) -> None:
        try:
            asked_ns, request = self._requests[lane].get(timeout=_LOOK_S)
        except queue.Empty:
            if lane in COMMAND_SERVICES:
                self._services[COMMAND_SERVICES[lane]].keep(_LOOK_S)
            return
        if is_late(request, time.monotonic_ns() - asked_ns):
            self._unsent += 1
            return
        answer = self._call(request)
        with self._changed:
            for message in self._answers(request, answer):
                self._answer(message)
            self._announce()

    def _failed(self, where: str, error: Exception) -> None:
        """Count a defect and complain, if there is the memory for it."""
        self._errors += 1
        with suppress(Exception):
            self._say(f"{where}{type(error).__name__}: {error}")

    def _call(self, request: Request) -> Any:
        """Return what a service answers; None: nothing."""
        service, fields = self._services[request.service], dict(request.fields)
        try:
            if "waypoints" in fields:
                fields["waypoints"] = [self._types["mavros_msgs/Waypoint"](**each) for each in fields["waypoints"]]
            return service.ask(CALL_LIMITS_S[request.lane], expires=request.flies, **fields)
        except CallError as error:
            self._unsent += 1
            self._say(f"{service.name}: {error}")
        except Exception as error:  # who waits for the answer hears that there is none
            self._failed(f"{service.name}: ", error)
        return None

    def _answers(self, request: Request, answer: Any) -> Iterable[Message]:
        if request.lane is Lane.MISSION:
            return self._mission.answered(request, answer)
        message = None if answer is None else _acknowledgement(request, answer)
        return () if message is None else (message,)


def _acknowledgement(request: Request, answer: Any) -> Any:
    """Return what the vehicle answered, as MAVLink has it."""
    if request.kind == "ParamGet":
        return _parameter(request, answer) if answer.success else None
    good = answer.mode_sent if request.kind == "SetMode" else answer.success
    result = getattr(answer, "result", mavlink.MAV_RESULT_ACCEPTED if good else mavlink.MAV_RESULT_FAILED)
    return mavlink.MAVLink_command_ack_message(request.command, result)


def _parameter(request: Request, answer: Any) -> Any:
    """Return a PARAM_VALUE; mavros fills in the whole number or the real one, the other is 0."""
    value = float(answer.value.real or answer.value.integer)
    name = request.fields["param_id"].encode("ascii")
    return mavlink.MAVLink_param_value_message(name, value, mavlink.MAV_PARAM_TYPE_REAL32, 0, 0)


def _message(kind: str) -> Any:
    package, name = kind.split("/")
    return _imported(f"{package}.msg", name)


def _service(name: str) -> Any:
    return _imported("mavros_msgs.srv", name)


def _imported(module: str, name: str) -> Any:
    try:
        return getattr(importlib.import_module(module), name)
    except ImportError as error:
        raise StartError(f"backend mavros: {error}; {_HOW}") from None
