"""Connects the subscriptions that rospy has missed, and names the publishers that it cannot connect: of another type.

rospy connects to the publishers of the latest list that it has of a topic. When a publisher comes up in the very moment
in which a subscription is registered, the master's word of it can be overtaken by the answer to the registration, in
which it does not stand yet; and a connection that fails is not tried again. Then nothing connects the two any more. So
a subscription without a connection is registered once more, which changes nothing at the master and returns all
publishers, and those that answer are told to rospy as the master would (publisherUpdate,
http://wiki.ros.org/ROS/Slave_API).

A publisher of another type under the same name is never connected, and nothing is said of it but "md5 mismatch" in its
own log: its topic is silent. So each publisher of a topic without a connection, and of any other now and then, is asked
once what it publishes, as a tool that takes any type would (http://wiki.ros.org/ROS/TCPROS).
"""

from __future__ import annotations

import logging
import socket
import struct
import threading
import time
from typing import Any, Dict, List, NamedTuple, Optional, Set, Tuple

import rosgraph
import rospy
from rosgraph.network import ROSHandshakeException, decode_ros_handshake_header, encode_ros_handshake_header
from rospy.topics import get_topic_manager

from .errors import CallError
from .liveness import call

_PERIOD_S = 1.0
_LIMIT_S = 0.5  # for each question to the master and to other nodes
_ALL_EVERY = 10  # looks: then the topics that are connected are looked at as well
_LONGEST_HEADER = 1 << 20
_log = logging.getLogger(__name__)


def subscriptions() -> List[Any]:
    """Return rospy's own table of what this process subscribes to."""
    manager = get_topic_manager()
    with manager.lock:
        return list(manager.subs.values())


class Foreign(NamedTuple):
    """A publisher of another type on a topic that this process reads."""

    topic: str
    node: str
    type: str
    md5: str
    our_type: str
    our_md5: str

    def __str__(self) -> str:
        theirs, ours = f"{self.type} (md5 {self.md5})", f"{self.our_type} (md5 {self.our_md5})"
        return f"{self.topic}: {self.node} publishes {theirs}, read here is {ours}: rename or remap one of them"


class Reconnector:
    """Looks after all subscriptions of this process, once a second, on a thread of its own."""

    def __init__(self) -> None:
        self._master_uri = rosgraph.get_master_uri()
        self._stopped = threading.Event()
        self._looks = 0
        self._asked: Dict[Tuple[str, str], Optional[Foreign]] = {}
        self._unread: Dict[str, Set[int]] = {}
        self._thread = threading.Thread(target=self._run, name="reconnector", daemon=True)

    def start(self) -> None:
        """Begin, after a second."""
        self._thread.start()

    def stop(self) -> None:
        """Look no more."""
        self._stopped.set()

    def _run(self) -> None:
        while not self._stopped.wait(_PERIOD_S) and not rospy.is_shutdown():
            try:
                self.look()
            except Exception:
                _log.exception("the reconnector failed")

    def look(self) -> None:
        """Connect what is not connected although somebody publishes it."""
        self._looks += 1
        everything = self._looks % _ALL_EVERY == 0
        for subscription in subscriptions():
            self._drop_unread(subscription)
            count = subscription.get_num_connections()
            if (count == 0 or everything) and not self._stopped.is_set():
                self._connect(subscription.resolved_name, subscription.data_class, count)

    def _drop_unread(self, subscription: Any) -> None:
        """Close connections for which rospy could have no thread: they count as connected, and nobody reads them."""
        topic = subscription.resolved_name
        waiting = {id(each): each for each in tuple(subscription.connections) if each.socket is None and not each.done}
        if any(thread.name == topic for thread in threading.enumerate()):
            waiting.clear()  # which of them it connects nobody can tell
        for key in waiting.keys() & self._unread.get(topic, set()):  # a second ago, too: it does not just begin
            waiting.pop(key).close()
        self._unread[topic] = set(waiting)

    @property
    def foreign(self) -> Tuple[Foreign, ...]:
        """Publishers of other types that were there at the last look."""
        return tuple(each for each in tuple(self._asked.values()) if each is not None)

    def _connect(self, topic: str, kind: Any, count: int) -> None:
        me, mine = rospy.get_name(), rospy.get_node_uri()
        try:
            uris = call(self._master_uri, "registerSubscriber", (me, topic, kind._type, mine), _LIMIT_S)
            alive = [uri for uri in uris if self._answers(uri)]
            ours = [uri for uri in alive if self._asked.get((topic, uri)) is None]  # the others are of another type
            if alive and (count == 0 or count < len(ours)):
                call(mine, "publisherUpdate", (me, topic, alive), _LIMIT_S)
        except CallError as error:
            _log.debug("%s is not connected: %s", topic, error)
            return
        for key in [key for key in self._asked if key[0] == topic and key[1] not in alive]:
            del self._asked[key]
        for uri in alive:
            if (topic, uri) not in self._asked and kind._md5sum != rospy.AnyMsg._md5sum:
                self._ask(topic, uri, kind)

    def _ask(self, topic: str, uri: str, kind: Any) -> None:
        """Ask a publisher what it publishes; one that does not say it is asked again."""
        try:
            _, host, port = call(uri, "requestTopic", (rospy.get_name(), topic, [["TCPROS"]]), _LIMIT_S)
            header = _header(host, port, topic, _LIMIT_S)
        except (CallError, OSError, ROSHandshakeException, ValueError, struct.error) as error:
            _log.debug("%s: %s does not say what it publishes: %s", topic, uri, error)
            return
        md5 = header.get("md5sum", kind._md5sum)
        same = md5 in (kind._md5sum, rospy.AnyMsg._md5sum)
        theirs = (header.get("callerid", uri), header.get("type", "?"), md5)
        found = None if same else Foreign(topic, *theirs, kind._type, kind._md5sum)
        self._asked[topic, uri] = found
        if found is not None:
            rospy.logwarn("%s", found)

    def _answers(self, uri: str) -> bool:
        """Tell whether a node answers; rospy would wait for one that does not for ever, on a thread of its own."""
        try:
            call(uri, "getPid", (rospy.get_name(),), _LIMIT_S)
        except CallError:
            return False
        return True


def _header(host: str, port: int, topic: str, limit_s: float) -> Dict[str, str]:
    """Shake hands with a publisher as one that takes any type; return what it says of its topic, and hang up.

    Under another name: a publisher drops the connection that it has to a node when the same one comes again.
    """
    deadline_s = time.monotonic() + limit_s
    asked = {
        "callerid": f"{rospy.get_name()}_asks",
        "topic": topic,
        "type": "*",
        "md5sum": "*",
        "message_definition": "",
    }
    with socket.create_connection((host, port), timeout=limit_s) as sock:
        sock.sendall(encode_ros_handshake_header(asked))
        data = b""
        while len(data) < struct.calcsize("<I") or len(data) < 4 + struct.unpack_from("<I", data)[0]:
            sock.settimeout(max(0.001, deadline_s - time.monotonic()))
            part = sock.recv(4096)
            if not part or len(data) > _LONGEST_HEADER:
                raise ValueError("no header")
            data += part
    (length,) = struct.unpack_from("<I", data)
    header: Dict[str, str] = decode_ros_handshake_header(data[: 4 + length])
    return header
