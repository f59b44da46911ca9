"""Stand-ins for nodes of the CNS Flight Stack over ROS: those of test/cns, by the names and types that our nodes know.

Their messages are made of their fields, in packages that only those find whose PYTHONPATH begins with `MODULES`.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any, Dict, List, Sequence, Tuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "cns"))

import rospy
from cns_definitions import install
from genpy.message import fill_message_args
from stand_ins import StandIn

from amaze_autonomy.cns.tables import SERVICES, TOPICS
from amaze_autonomy.nodes.cns.names import cns_classes

S = 1_000_000_000
_packages = tempfile.TemporaryDirectory(prefix="amaze_cns_messages_")
MODULES = install(Path(_packages.name))
sys.path.insert(0, _packages.name)


def plain(message: Any) -> Any:
    """Return the fields of a message as plain values."""
    if hasattr(message, "__slots__") and not hasattr(message, "secs"):
        return {name: plain(getattr(message, name)) for name in message.__slots__}
    return [plain(each) for each in message] if isinstance(message, list) else message


class StandIns:
    """Some of its nodes, which go on by themselves from `start` to `end`.

    Args:
        nodes: they.
        namespace: that their names are in.
    """

    def __init__(self, nodes: Sequence[StandIn], namespace: str = "") -> None:
        self.nodes = {node.peer: node for node in nodes}
        self.changed = threading.Condition()
        self.begin_s = time.monotonic()
        self.ends: Dict[str, List[Dict[str, Any]]] = {}
        self.ended = False
        self.silent: Tuple[str, ...] = ()
        topics = {key: name for key, name in TOPICS.items() if name.peer in self.nodes}
        services = {key: name for key, name in SERVICES.items() if name.peer in self.nodes}
        self._classes = cns_classes({**topics, **services}, services)
        self._senders: Dict[str, Any] = {}
        for key, name in topics.items():
            if name.heard:
                self._senders[key] = rospy.Publisher(namespace + name.name, self._classes[key], queue_size=50)
            else:
                take = partial(self._take, key)
                rospy.Subscriber(namespace + name.name, self._classes[key], take, queue_size=50)
        for key, name in services.items():
            rospy.Service(namespace + name.name, self._classes[key], partial(self._call, key))

    def start(self) -> None:
        threading.Thread(target=self._run, daemon=True).start()

    def end(self) -> None:
        self.ended = True

    def now_ns(self) -> int:
        return round((time.monotonic() - self.begin_s) * S)

    def filled(self, key: str, fields: Dict[str, Any]) -> Dict[str, Any]:  # noqa: ARG002
        """Return what a service answers, where a test has no other answer."""
        return fields

    def _take(self, key: str, message: Any) -> None:
        with self.changed:
            self.nodes[TOPICS[key].peer].take(self.now_ns(), key, plain(message))

    def _call(self, key: str, request: Any) -> Any:
        with self.changed:
            self.nodes[SERVICES[key].peer].call(self.now_ns(), key, plain(request))
            ends = self.ends.setdefault(key, [])
            self.changed.wait_for(lambda: ends, 60.0)
            fields = self.filled(key, ends.pop())
        response = self._classes[key]._response_class()
        for name in ("successful", "success", "message"):
            if name in fields:
                setattr(response, name, fields[name])
        return response

    def _run(self) -> None:
        while not self.ended:
            with self.changed:
                self.step(self.now_ns())
                self.changed.notify_all()
            time.sleep(0.02)

    def step(self, t_ns: int) -> None:
        """Go on to a time; under the lock."""
        for node in self.nodes.values():
            if node.peer in self.silent:
                continue
            node.step(t_ns)
            for key, fields in node.said:
                message = self._senders[key].data_class()
                fill_message_args(message, [fields])
                if hasattr(message, "header"):
                    message.header.stamp = rospy.Time.now()
                self._senders[key].publish(message)
            for key, fields in node.returned:
                self.ends.setdefault(key, []).append(fields)
            node.said, node.returned = [], []
