"""The way to the vehicle through a running mavros, with the face of a `Connection`: topics in, services out.

Subscribes to the topics of `autopilot.mavros_messages`, calls `set_mode`, `cmd/command` and `param/get`. Services are
called by a thread of their own, each within a limit of its own making by mavros; what was asked twice meanwhile is
asked once.
"""

from __future__ import annotations

import importlib
import queue
import threading
from typing import Any, Callable, Iterable, Sequence, Tuple, TypeVar

import rospy

from amaze_autonomy.autopilot import Client, LinkState
from amaze_autonomy.autopilot.dialect import Message, mavlink
from amaze_autonomy.autopilot.mavros_messages import SOURCES, VEHICLE, VELOCITY, Converter, Request, Source, request_of

from .errors import StartError

__all__ = ["MavrosLink"]

_QUEUE = 20
_WAKE_S = 0.05
_WAITING = 16
_HOW = "install mavros for this ROS, or use backend: mavlink through mavros' GCS port (docs/autopilot.md)"
T = TypeVar("T")


class MavrosLink:
    """A link through mavros.

    Args:
        namespace: of mavros.
        client: what lives on it.
        now_ns: the clock that stamps what the client is given.
        complain: is told of each new kind of problem.

    Raises:
        StartError: mavros_msgs is not installed.
    """

    def __init__(
        self, namespace: str, client: Client, now_ns: Callable[[], int], complain: Callable[[str], None]
    ) -> None:
        self._namespace, self._client, self._now_ns, self._complain = namespace, client, now_ns, complain
        self._changed = threading.Condition(threading.RLock())
        self._converter = Converter()
        self._requests: queue.Queue[Request] = queue.Queue(_WAITING)
        self._ended = threading.Event()
        self._heartbeat_ns: Any = None
        self._frames = self._unsent = self._errors = 0
        self._complaint = ""
        self._kinds = {source: _message(source.kind) for source in (*SOURCES, VELOCITY)}
        self._services = {name: _service(name) for name in ("SetMode", "CommandLong", "ParamGet")}

    def start(self) -> None:
        """Subscribe, and begin to look at the time."""
        for source, kind in self._kinds.items():
            topic = f"{self._namespace}/{source.topic}"
            rospy.Subscriber(topic, kind, self._take, callback_args=source, queue_size=_QUEUE, tcp_nodelay=True)
        for work in (self._wake, self._serve):
            threading.Thread(target=work, name=f"mavros {work.__name__}", daemon=True).start()

    def close(self) -> None:
        """Send what waits, and end."""
        deadline = rospy.Time.now() + rospy.Duration(1.0)
        while not self._requests.empty() and rospy.Time.now() < deadline:
            self._ended.wait(0.02)
        self._ended.set()

    def ask(self, question: Callable[[int], Tuple[T, Sequence[Message]]]) -> T:
        """Call a function of the client with the time, under the lock; it returns an answer and messages to send."""
        with self._changed:
            answer, messages = question(self._now_ns())
            self._send(messages)
            self._changed.notify_all()
            return answer

    def wait_for(self, condition: Callable[[], T], limit_s: float) -> T:
        """Wait until a condition on the client is true; return its last value."""
        with self._changed:
            return self._changed.wait_for(condition, limit_s)

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
            vehicle=VEHICLE[0],
            heartbeat_ns=self._heartbeat_ns,
            others=(),
            frames=self._frames,
            damaged_bytes=0,
            refused=0,
            unsent=self._unsent,
            doubles=0,
            errors=self._errors,
        )

    # --- threads --------------------------------------------------------------------------------------------------

    def _take(self, message: Any, source: Source) -> None:
        with self._changed:
            self._frames += 1
            self._guarded(lambda: self._given(self._converter.convert(source, message)))
            self._changed.notify_all()

    def _given(self, message: Any) -> Iterable[Message]:
        if message is None:
            return ()
        t_ns = self._now_ns()
        if message.get_type() == "HEARTBEAT":
            self._heartbeat_ns = t_ns
        return self._client.receive(t_ns, message)

    def _wake(self) -> None:
        while not self._ended.wait(_WAKE_S):
            with self._changed:
                self._guarded(lambda: self._client.wake(self._now_ns()))
                self._changed.notify_all()

    def _guarded(self, call: Callable[[], Iterable[Message]]) -> None:
        try:
            self._send(call())
        except Exception as error:
            self._errors += 1
            self._tell(f"{type(error).__name__}: {error}")

    def _tell(self, words: str) -> None:
        if words != self._complaint:
            self._complaint = words
            self._complain(words)

    def _send(self, messages: Iterable[Message]) -> None:
        for request in filter(None, map(request_of, messages)):
            if request in self._requests.queue:
                continue
            try:
                self._requests.put_nowait(request)
            except queue.Full:
                self._unsent += 1

    def _serve(self) -> None:
        while not self._ended.is_set():
            try:
                request = self._requests.get(timeout=0.2)
            except queue.Empty:
                continue
            self._call(request)

    def _call(self, request: Request) -> None:
        name = f"{self._namespace}/{request.service}"
        try:
            answer = rospy.ServiceProxy(name, self._services[request.kind])(**request.fields)
        except (rospy.ServiceException, rospy.ROSException) as error:
            self._unsent += 1
            self._tell(f"{name}: {error}")
            return
        message = _acknowledgement(request, answer)
        if message is not None:
            with self._changed:
                self._guarded(lambda: self._client.receive(self._now_ns(), message))
                self._changed.notify_all()


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
