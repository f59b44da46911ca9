"""Looks at a running graph: who publishes what, how often, with which stamps; which services are offered.

Every topic is listened to for some seconds, of whatever type it is; nothing is published, nothing is asked of anybody
but the types of services. Types come with their md5 sums, as nodes say them when they are connected to. What was heard
reads like a recording, so that a configuration can be proposed of it.
"""

from __future__ import annotations

import os
import struct
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Callable, Dict, FrozenSet, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple
from urllib.parse import urlparse

import genpy
import rosgraph
import roslib.message
import rospy
import rosservice
from rosgraph.network import ROSHandshakeException

from ..bags.errors import UndecodableError
from ..doctor import Graph, SeenService, SeenTopic, absolute_name
from .errors import CallError, StartError
from .liveness import call
from .rospy_flaws import check_master_uri, mend_rospy

_S = 1_000_000_000
_KEPT_BYTES, _KEPT = 4096, 2000  # of a topic: its small messages; of a larger one the first alone
_STAMP = struct.Struct("<II")
_LIMIT_S, _ASKED_AT_ONCE = 0.5, 16  # of nodes, whether they live
_OF_EVERY_NODE = ("/get_loggers", "/set_logger_level")


_Entry = Tuple[int, Optional[bytes], str, str]  # when, the message, its type, its publisher


class GraphError(Exception):
    """There is no graph to look at."""


class HeardTopic(NamedTuple):
    """A topic as a recording has it."""

    name: str
    kind: str


class Heard:
    """What was heard of the topics; reads like one recording."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: Dict[str, List[_Entry]] = {}
        self._counts: Dict[str, Dict[str, int]] = {}  # of messages by publisher
        self._kinds_of: Dict[str, Dict[str, str]] = {}  # by publisher
        self.ages_s: Dict[str, List[float]] = {}
        self.unstamped: Dict[str, int] = {}  # messages whose stamp is 0
        self.types: Dict[str, List[Tuple[str, str]]] = {}

    def connected(self, topic: str, headers: Iterable[Optional[Mapping[str, str]]]) -> None:
        """Take what the publishers of a topic said of its type when they connected: that of a silent one, too."""
        known = [each for each in headers if each]
        self.types[topic] = sorted({(each.get("type", "?"), each.get("md5sum", "")) for each in known})
        with self._lock:
            kinds = self._kinds_of.setdefault(topic, {})
            kinds.update({each.get("callerid", ""): each.get("type", "?") for each in known})

    def take(self, topic: str, message: Any) -> None:
        """Take a message of any type."""
        self.take_at(time.time_ns(), topic, message)

    def take_at(self, now_ns: int, topic: str, message: Any) -> None:
        """Take a message of any type that came at a time."""
        ros_s = rospy.get_time()
        kind, raw = message._connection_header["type"], message._buff
        node = message._connection_header.get("callerid", "")
        with self._lock:
            entries, counts = self._entries.setdefault(topic, []), self._counts.setdefault(topic, {})
            self._kinds_of.setdefault(topic, {})[node] = kind
            keep = node not in counts or (len(raw) <= _KEPT_BYTES and len(entries) < _KEPT)
            entries.append((now_ns, raw if keep else None, kind, node))
            counts[node] = counts.get(node, 0) + 1
            if _stamped(message._connection_header.get("message_definition", "")):
                seconds, nanoseconds = _STAMP.unpack_from(raw, 4)
                if seconds or nanoseconds:
                    self.ages_s.setdefault(topic, []).append(ros_s - seconds - nanoseconds / _S)
                else:
                    self.unstamped[topic] = self.unstamped.get(topic, 0) + 1

    @property
    def topics(self) -> Tuple[HeardTopic, ...]:
        """Return the topics that were heard, with the type of the publisher that was heard most."""
        return tuple(HeardTopic(name, self._kinds_of[name][self._loudest(name)]) for name in sorted(self._entries))

    def _loudest(self, topic: str) -> str:
        counts = self._counts.get(topic, {})
        return min(counts, key=lambda node: (-counts[node], node), default="")

    def publishers(self, topic: str) -> Tuple[Tuple[str, str], ...]:
        """Return who publishes a topic, with the type of each; first the one that was heard most."""
        counts = self._counts.get(topic, {})
        return tuple(sorted(self._kinds_of.get(topic, {}).items(), key=lambda each: (-counts.get(each[0], 0), each[0])))

    def entries(self, topic: str) -> Sequence[_Entry]:
        """Return the messages that were heard of the publisher that was heard most: two are no recording of one."""
        loudest = self._loudest(topic)
        return [entry for entry in self.entries_of_all(topic) if entry[3] == loudest]

    def entries_of_all(self, topic: str) -> Sequence[_Entry]:
        """Return the messages that were heard, of whomever."""
        return self._entries.get(topic, [])

    def message(self, entry: _Entry) -> Any:
        """Return a message.

        Raises:
            UndecodableError: It was not kept, or its package is not here, or another version of it.
        """
        _, raw, kind, _ = entry
        if raw is None:
            raise UndecodableError(f"{kind} was not kept")
        found = roslib.message.get_message_class(kind)
        if found is None:
            raise UndecodableError(f"{kind} is of a package that is not here")
        message = found()
        try:
            message.deserialize(raw)
        except genpy.DeserializationError as error:
            raise UndecodableError(f"{kind} is of another version here") from error
        return message

    def close(self) -> None:
        """There is nothing to be closed."""


def _stamped(definition: str) -> bool:
    """Return whether messages of a definition begin with a header."""
    lines = (line.split("#")[0].strip() for line in definition.splitlines())
    first = next((line for line in lines if line), "")
    return first.split()[:1] in (["Header"], ["std_msgs/Header"])


def _begin() -> Any:
    """Become a node of the graph; return its master."""
    try:
        check_master_uri()
    except StartError as error:
        raise GraphError(str(error)) from error
    if not rosgraph.is_master_online():
        raise GraphError(f"no ROS master answers at {rosgraph.get_master_uri()}: start it, or set ROS_MASTER_URI")
    if not rospy.core.is_initialized():
        mend_rospy()
        # Without the words of the command line: rospy would listen to a topic under the name of its remap.
        rospy.init_node("amaze_looks", argv=[], anonymous=True, disable_signals=True, disable_rosout=True)
    return rosgraph.Master(rospy.get_name())


def listen(for_s: float) -> Heard:
    """Listen to every topic for some seconds.

    Raises:
        GraphError: There is no master.
    """
    return _listen(_begin(), for_s)[0]


def _listen(master: Any, for_s: float) -> Tuple[Heard, FrozenSet[str]]:
    """Listen for some seconds; return what was heard, and the nodes that are gone: nobody waits for them."""
    published, _, offered = master.getSystemState()
    heard, gone = Heard(), _gone({node for rows in (published, offered) for _, each in rows for node in each})
    subscribers = {
        topic: rospy.Subscriber(topic, rospy.AnyMsg, partial(heard.take, topic), tcp_nodelay=True)
        for topic, nodes in published
        if not gone.union((rospy.get_name(),)).issuperset(nodes)
    }
    time.sleep(for_s)
    for topic, each in subscribers.items():
        heard.connected(topic, [connection.header for connection in tuple(each.impl.connections)])
        each.unregister()
    return heard, gone


def _gone(nodes: Iterable[str]) -> FrozenSet[str]:
    """Return which nodes do not answer, or not within the limit."""
    me, uri = rospy.get_name(), rosgraph.get_master_uri()

    def answers(node: str) -> bool:
        try:
            call(call(uri, "lookupNode", (me, node), _LIMIT_S), "getPid", (me,), _LIMIT_S)
        except CallError:
            return False
        return True

    ordered = sorted(nodes)
    with ThreadPoolExecutor(_ASKED_AT_ONCE) as pool:
        return frozenset(node for node, alive in zip(ordered, pool.map(answers, ordered)) if not alive)


def look(for_s: float, services: Sequence[str], remapped: Optional[Mapping[str, str]] = None) -> Graph:
    """Look at the graph for some seconds.

    Args:
        for_s: to listen for.
        services: of which the types are wanted, as they are named in the code.
        remapped: names in the code or the configuration, each with the one that it has instead.

    Raises:
        GraphError: There is no master.
    """
    master = _begin()
    heard, gone = _listen(master, for_s)
    published, subscribed, offered = (_others(rows, gone) for rows in master.getSystemState())
    declared = dict(master.getTopicTypes())
    topics = {topic: _topic(heard, topic, declared.get(topic, "?"), nodes) for topic, nodes in published.items()}
    namespace = rospy.get_namespace()
    names = {absolute_name(old, namespace): absolute_name(new, namespace) for old, new in (remapped or {}).items()}
    absolute = {name: absolute_name(name, namespace) for name in services}
    resolved = {name: names.get(each, each) for name, each in absolute.items()}
    asked = {name: found for name, found in resolved.items() if found in offered}
    found = {name: _service(each, offered[each][0], _uri(master, each)) for name, each in asked.items()}
    others = {name: nodes[0] for name, nodes in offered.items() if name not in asked.values()}
    host = urlparse(rosgraph.get_master_uri()).hostname or ""
    local = host in ("localhost", "127.0.0.1", "::1")
    return Graph(
        topics=topics,
        services=found,
        nodes=frozenset(node for rows in (published, subscribed, offered) for each in rows.values() for node in each),
        gone=gone,
        namespace=namespace,
        master_host=host,
        named=local or bool(os.environ.get("ROS_IP") or os.environ.get("ROS_HOSTNAME")),
        listeners=subscribed,
        offered=frozenset(offered),
        md5s={
            **_md5s(roslib.message.get_message_class, (kind for each in topics.values() for kind in each.kinds)),
            **_md5s(roslib.message.get_service_class, (each.kind for each in found.values())),
        },
        listened_s=for_s,
        remapped=names,
        others=_services(master, others) if len(asked) < len(resolved) else (),
    )


def _others(rows: Iterable[Tuple[str, List[str]]], gone: FrozenSet[str]) -> Dict[str, Tuple[str, ...]]:
    """Return names with their nodes, but those that are gone, and this one."""
    others = {name: tuple(node for node in nodes if node not in (*gone, rospy.get_name())) for name, nodes in rows}
    return {name: nodes for name, nodes in others.items() if nodes}


def _services(master: Any, nodes: Mapping[str, str]) -> Tuple[SeenService, ...]:
    """Return services with their types, but those that every node has; many are asked at once: some may hang."""
    names = sorted(name for name in nodes if not name.endswith(_OF_EVERY_NODE))
    uris = [_uri(master, name) for name in names]
    with ThreadPoolExecutor(_ASKED_AT_ONCE) as pool:
        return tuple(pool.map(_service, names, (nodes[name] for name in names), uris))


def _uri(master: Any, name: str) -> str:
    """Return the address of a service; empty where it has ended since."""
    try:
        return str(master.lookupService(name))
    except (OSError, rosgraph.MasterException):
        return ""


def _service(name: str, node: str, uri: str) -> SeenService:
    """Return a service with its type, as its node says it; unknown where it has ended since, or hangs."""
    try:
        header = rosservice.get_service_headers(name, uri)
    except (OSError, rosservice.ROSServiceException, ROSHandshakeException):
        header = {}
    return SeenService(name, header.get("type", "?"), node, header.get("md5sum", ""))


def _md5s(class_of: Callable[[str], Any], kinds: Iterable[str]) -> Dict[str, str]:
    """Return the md5 sums of types as they are on this computer."""
    classes = {kind: class_of(kind) for kind in sorted(set(kinds)) if kind.count("/") == 1}
    return {kind: str(found._md5sum) for kind, found in classes.items() if found is not None}


def _topic(heard: Heard, topic: str, declared: str, nodes: Tuple[str, ...]) -> SeenTopic:
    entries, ages = heard.entries_of_all(topic), sorted(heard.ages_s.get(topic, ()))
    times = [entry[0] for entry in entries]
    span_s = (times[-1] - times[0]) / _S if times else 0.0
    types = heard.types.get(topic, [])
    kinds = {kind for _, _, kind, _ in entries}.union(kind for kind, _ in types) - {"?", "*"} or {declared}
    return SeenTopic(
        kinds=tuple(sorted(kinds)),
        nodes=nodes,
        count=len(times),
        rate_hz=(len(times) - 1) / span_s if span_s > 0.0 else None,
        age_s=ages[len(ages) // 2] if ages else None,
        md5s=tuple(md5 for _, md5 in types),
        unstamped=heard.unstamped.get(topic, 0) > len(ages),
        kinds_of=tuple(sorted(each for each in heard.publishers(topic) if each[0] in nodes)),
    )
