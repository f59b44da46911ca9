"""The watchdog's one thread: it counts what comes, judges it, and says so. Nothing that can wait happens here.

All else (questions to nodes, looks at drivers, restarts, service calls) runs elsewhere and hands in its results as
jobs. If this loop is stuck, so is the loop counter of the heartbeat, and the engine notices.
"""

from __future__ import annotations

import logging
import struct
import time
import zlib
from math import isfinite
from queue import Empty, SimpleQueue
from typing import Any, Callable, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Type

import roslib.message
import rospy

from amaze_autonomy.engine.events import ComponentStatus, WatchdogAction, WatchdogInfo
from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.restart import RestartRequest
from amaze_autonomy.monitoring.specs import TopicSpec
from amaze_autonomy.monitoring.watchdog import TakeoffCheck, Watchdog
from amaze_autonomy.ros.clock import Clock

from ...engine.events import Mission, Verdict
from ...monitoring.watchdog import Streams
from ...ros.errors import report
from ...ros.topic_reader import ALL, STAMP_BYTES, Look, Tally, TopicReader, message_look

# --- what a message says ----------------------------------------------------------------------------------------------
# The stamp and the digest need no decoding. Serialization: http://wiki.ros.org/msg (little endian, fields in order).


_S = 1_000_000_000
_HEADER_TYPES = ("Header", "std_msgs/Header", "roslib/Header")
_STAMP = struct.Struct("<II")
_LENGTH = struct.Struct("<I")
_SEQUENCE_BYTES, _STAMP_END = 4, 12
_FLOATS = ("float32", "float64")


class MessageContent:
    """Looks into the messages of one publisher.

    Args:
        connection: header of the connection (type, message_definition).
    """

    def __init__(self, connection: Mapping[str, str]) -> None:
        self.type_name = connection.get("type", "")
        self.has_header = _has_header(connection.get("message_definition", ""))
        self._class: Any = None

    @property
    def known(self) -> bool:
        """True when messages can be decoded: their package is installed here."""
        if self._class is None:
            self._class = roslib.message.get_message_class(self.type_name)
        return self._class is not None

    def stamp_ns(self, data: memoryview) -> Optional[int]:
        """Return the stamp of the header; None when there is none.

        It is for those who ask for stamps to be judged: 0, of a driver that does not stamp, is a stamp like any other.
        """
        if not self.has_header or len(data) < _STAMP_END:
            return None
        secs, nsecs = _STAMP.unpack_from(data, _SEQUENCE_BYTES)
        return int(secs) * _S + int(nsecs)

    def digest(self, data: memoryview) -> int:
        """Return a digest of the message without its header."""
        start = 0
        if self.has_header and len(data) >= _STAMP_END + _LENGTH.size:
            (frame,) = _LENGTH.unpack_from(data, _STAMP_END)
            start = _STAMP_END + _LENGTH.size + frame
        return zlib.crc32(data[start:])

    def finite(self, data: memoryview) -> bool:
        """Return whether all floating point numbers of the message are finite; False when it cannot be decoded."""
        if not self.known:
            return False
        try:
            message = self._class().deserialize(bytes(data))
        except Exception:  # genpy raises anything from struct.error to UnicodeDecodeError
            return False
        return _finite(message, _plan(self._class))


def _has_header(definition: str) -> bool:
    """Return whether the first field is a header."""
    for line in definition.splitlines():
        words = line.split("#", 1)[0].split()
        if not words or "=" in line.split("#", 1)[0]:
            continue
        return words[0] in _HEADER_TYPES
    return False


_Step = Tuple[str, Callable[[Any], bool]]


def _plan(kind: Any) -> List[_Step]:
    """Return the fields of a message class that hold floats, and how each is judged; made once per class."""
    plan: Optional[List[_Step]] = _PLANS.get(kind)
    if plan is None:
        plan = _PLANS[kind] = []
        for name, type_name in zip(kind.__slots__, kind._slot_types):
            step = _step(type_name)
            if step is not None:
                plan.append((name, step))
    return plan


_PLANS: dict = {}  # type: ignore[type-arg]


def _step(type_name: str) -> Optional[Callable[[Any], bool]]:
    base, array = type_name.split("[", 1)[0], "[" in type_name
    if base in _FLOATS:
        return _all_finite if array else isfinite
    if "/" not in base or base in _HEADER_TYPES:
        return None
    kind = roslib.message.get_message_class(base)
    inner = _plan(kind) if kind is not None else []
    if not inner:
        return None
    if array:
        return lambda messages: all(_finite(message, inner) for message in messages)
    return lambda message: _finite(message, inner)


def _all_finite(values: Any) -> bool:
    return all(map(isfinite, values))


def _finite(message: Any, plan: List[_Step]) -> bool:
    return all(judge(getattr(message, name)) for name, judge in plan)


# --- the loop ---------------------------------------------------------------------------------------------------------


_log = logging.getLogger(__name__)
_IDLE_S = 1.0
_STALL_NS = _S // 10
_REST_LIMIT_S, _REST_PAUSE_S = 0.05, 0.002

#: Something for the watchdog's thread; gets the present time.
Job = Callable[[int], None]
Tell = Callable[[Optional[WatchdogAction], Optional[WatchdogInfo], int], None]


class WatchLoop:
    """Turns over and over.

    Args:
        watchdog: that judges; nobody else may touch it.
        streams: its messages.
        reader: of all topics.
        watches: the topics.
        desk: take-off checks that wait for an answer.
        clock: the node's.
        tell: publishes what is due.
        restart: begins a restart.
        stalled: gets how long this thread did not run though it should have, and the time, before anything is judged.
    """

    def __init__(
        self,
        watchdog: Watchdog,
        streams: Streams,
        reader: TopicReader,
        watches: Tuple[TopicWatch, ...],
        desk: TakeoffDesk,
        clock: Clock,
        tell: Tell,
        restart: Callable[[RestartRequest], None],
        stalled: Callable[[int, int], None],
    ) -> None:
        self._watchdog, self._streams, self._reader, self._watches = watchdog, streams, reader, watches
        self._desk, self._clock, self._tell = desk, clock, tell
        self._restart, self._stalled = restart, stalled
        self._jobs: SimpleQueue[Job] = SimpleQueue()
        self._stopped = False

    def put(self, job: Job) -> None:
        """Have a job done at the next turn; from any thread."""
        self._jobs.put(job)
        self._reader.wake()

    def stop(self) -> None:
        """End; from any thread."""
        self._stopped = True
        self._reader.wake()

    def run(self) -> None:
        """Turn until it is stopped."""
        now_ns = self._clock.now_ns()
        while not self._stopped:
            limit_s = self._limit_s()
            due_ns = now_ns + round(limit_s * _S)  # from the last turn on: it may have been stopped within that, too
            self._reader.wait(limit_s)
            now_ns = self._clock.now_ns()
            if now_ns - due_ns > _STALL_NS:
                stall_ns = now_ns - due_ns
                now_ns = self._read_the_rest()
                self._stalled(stall_ns, now_ns)
            self._turn(now_ns)

    def _read_the_rest(self) -> int:
        """Read what publishers could not send meanwhile, a picture larger than a socket holds; return the time."""
        until_s = time.monotonic() + _REST_LIMIT_S
        while time.monotonic() < until_s and not self._stopped:
            self._reader.wait(_REST_PAUSE_S)
        return self._clock.now_ns()

    def _limit_s(self) -> float:
        """Return how long nothing has to be done unless something comes."""
        if not self._watchdog.started:
            return _IDLE_S
        return min(_IDLE_S, self._clock.wall_wait_s(min(self._streams.next_ns, self._desk.next_ns)))

    def _turn(self, now_ns: int) -> None:
        """Take in all that came before judging: what waited here while this process did not run is no silence."""
        for watch in self._watches:
            watch.flush(now_ns)
        self._do_jobs(now_ns)
        if not self._watchdog.started:
            return
        action, info = self._streams.poll(now_ns)
        if action is not None or info is not None:
            self._tell(action, info, now_ns)
        for request in self._watchdog.restart_requests():
            self._restart(request)
        self._desk.turn(now_ns)

    def _do_jobs(self, now_ns: int) -> None:
        while True:
            try:
                job = self._jobs.get_nowait()
            except Empty:
                return
            try:
                job(now_ns)
            except Exception:
                _log.exception("a job of the watchdog failed")


# --- topic watch ------------------------------------------------------------------------------------------------------
# One topic that the watchdog watches: its messages are counted; looked at only as far as the configuration asks.


class TopicWatch:
    """Hands what comes on a topic to the watchdog; used by the thread that watches.

    Args:
        topic: resolved name.
        watchdog: that judges.
        clock: the node's.
    """

    def __init__(self, topic: str, watchdog: Watchdog, clock: Clock) -> None:
        self.tally = Tally(topic)
        self._watchdog, self._clock = watchdog, clock
        self._uses: List[Tuple[str, TopicSpec]] = []
        self._contents: List[Tuple[str, TopicSpec]] = []
        self._stamps: List[Tuple[str, TopicSpec]] = []
        self._takers: List[Tuple[Type[Any], Look]] = []
        self._said: List[Tuple[bool, int]] = []
        self._flushed_ns: Optional[int] = None

    def use(self, component: str, spec: TopicSpec) -> None:
        """Count it for a component, and look at it as its specification asks."""
        self._uses.append((component, spec))
        if spec.stamp_tolerance_ns is not None:
            self._stamps.append((component, spec))
            self.tally.wanted = self.tally.wanted or STAMP_BYTES
        if spec.finite or spec.unchanged_limit_ns is not None:
            self._contents.append((component, spec))
            self.tally.wanted = ALL

    def take_whole(self, kind: Type[Any], take: Callable[[Any], None]) -> None:
        """Hand every message of a kind to somebody; who publishes another one there is not read, and named."""
        self._takers.append((kind, message_look(self.tally.topic, kind, take)))
        self.tally.wanted = ALL

    def flush(self, now_ns: int) -> None:
        """Hand over what has come; what waited here while this process did not run came one after the other."""
        since_ns, self._flushed_ns = now_ns if self._flushed_ns is None else self._flushed_ns, now_ns
        said, self._said = self._said, []
        for number, (finite, digest) in enumerate(said, 1):
            t_ns = since_ns + (now_ns - since_ns) * number // len(said)
            for component, spec in self._contents:
                self._watchdog.add_content(
                    component, t_ns, finite=finite or not spec.finite, digest=digest, topic=spec.topic
                )
        count = self.tally.take()
        if count:
            for component, spec in self._uses:
                self._watchdog.add_samples(component, now_ns, count, spec.topic)

    def look_for(self, connection: Mapping[str, str]) -> Optional[Look]:
        """Return the look at the messages of one publisher; None when counting is enough. On rospy's threads."""
        if not self.tally.wanted:
            return None
        content = MessageContent(connection)
        if any(spec.finite for _, spec in self._contents) and not content.known:
            rospy.logerr("%s: %s is not installed here: its content fails", self.tally.topic, content.type_name)
        if self._stamps and not content.has_header:
            rospy.logerr("%s: %s has no header: its stamps are not looked at", self.tally.topic, content.type_name)
        takers = [look for kind, look in self._takers if connection.get("md5sum") == kind._md5sum]
        if len(takers) < len(self._takers):
            who, what = connection.get("callerid"), connection.get("type")
            rospy.logerr("%s: what %s says there is not read: %s is none of ours", self.tally.topic, who, what)
        return lambda data: self._look(content, takers, data)

    def _look(self, content: MessageContent, takers: Sequence[Look], data: memoryview) -> None:
        """Look at a message; one that cannot be looked at is silence: nothing of it ends the watchdog."""
        try:
            self._look_at(content, takers, data)
        except Exception:
            report(_log, "%s: %d bytes of %s could not be looked at", self.tally.topic, len(data), content.type_name)

    def _look_at(self, content: MessageContent, takers: Sequence[Look], data: memoryview) -> None:
        for take in takers:
            take(data)
        if self._stamps:
            stamp_ns = content.stamp_ns(data)
            if stamp_ns is not None:
                now_ns = self._clock.ros_ns()
                for component, spec in self._stamps:
                    self._watchdog.add_stamp(component, now_ns, stamp_ns, spec.topic)
        if self._contents:
            self._judge_content(content, data)

    def _judge_content(self, content: MessageContent, data: memoryview) -> None:
        """Decode only for those that ask for numbers, and make a digest only for those that ask for changes."""
        finite = not any(spec.finite for _, spec in self._contents) or content.finite(data)
        changing = any(spec.unchanged_limit_ns is not None for _, spec in self._contents)
        self._said.append((finite, content.digest(data) if changing else 0))


# --- takeoff desk -----------------------------------------------------------------------------------------------------
# Answers take-off checks: the first waits for the components to come up, later ones are answered at once.


class TakeoffAnswer(NamedTuple):
    """The answer to srv/StartWatchdog.srv.

    Args:
        t_ns: when it was made.
        check: the rows, and whether it may take off.
        components: the condition of every component.
        message: for a person.
    """

    t_ns: int
    check: TakeoffCheck
    components: Tuple[ComponentStatus, ...]
    message: str


class TakeoffRequest(NamedTuple):
    """A take-off check that somebody waits for.

    Args:
        mission_id: what is to be flown; empty: nothing in particular.
        required: names of components; empty: those of the configuration.
        startup_ns: how long the first one may wait for components to come up.
        answer: where the answer goes.
    """

    mission_id: str
    required: Tuple[str, ...]
    startup_ns: int
    answer: SimpleQueue[TakeoffAnswer]


class TakeoffDesk:
    """Take-off checks; used by the thread that watches.

    Args:
        watchdog: that is asked.
        missions: by id.
    """

    def __init__(self, watchdog: Watchdog, missions: Mapping[str, Mission]) -> None:
        self._watchdog, self._missions = watchdog, missions
        self._waiting: List[TakeoffRequest] = []
        self._until_ns = 0

    @property
    def next_ns(self) -> int:
        """When an answer is due at the latest."""
        return self._until_ns if self._waiting else FOREVER_NS

    def ask(self, now_ns: int, request: TakeoffRequest) -> None:
        """Begin to watch for a mission, or make a new check; in flight it is answered, and nothing is changed."""
        first = not self._watchdog.started
        mission = self._missions.get(request.mission_id)
        self._watchdog.start(
            now_ns,
            mission.severities if mission is not None else (),
            request.required,
            mission.tolerated if mission is not None else (),
            request.startup_ns,
        )
        if first:
            self._until_ns = now_ns + request.startup_ns
        if first or self._waiting:
            self._waiting.append(request)
        else:
            self._reply(now_ns, request, self._watchdog.checks(now_ns), kept=self._watchdog.in_flight)

    def turn(self, now_ns: int) -> None:
        """Answer those that wait, once everything has come up or has had the time to."""
        if not self._waiting:
            return
        check = self._watchdog.checks(now_ns)
        coming_up = any(row.verdict is Verdict.UNKNOWN for row in check.checks)
        if check.ready or not coming_up or now_ns >= self._until_ns:
            waiting, self._waiting = self._waiting, []
            for request in waiting:
                self._reply(now_ns, request, check)

    def _reply(self, now_ns: int, request: TakeoffRequest, check: TakeoffCheck, *, kept: bool = False) -> None:
        components = self._watchdog.evaluate(now_ns)
        request.answer.put(TakeoffAnswer(now_ns, check, components, self._message(request, check, kept=kept)))

    def _message(self, request: TakeoffRequest, check: TakeoffCheck, *, kept: bool) -> str:
        failed = [row.name for row in check.checks if not row.passed]
        unknown: Optional[str] = None
        if request.mission_id and request.mission_id not in self._missions:
            unknown = f"mission {request.mission_id!r} is not in missions.yaml: severities are those of sensors.yaml"
        parts = ["ready" if check.ready else f"not nominal: {', '.join(failed)}", "" if kept else unknown]
        if kept:
            parts.append("in flight: what is judged stays as it is")
        return "; ".join(part for part in parts if part)
