"""Connects the subscriptions that rospy has missed.

rospy connects to the publishers of the latest list that it has of a topic. When a publisher comes up in the very moment
in which a subscription is registered, the master's word of it can be overtaken by the answer to the registration, in
which it does not stand yet; and a connection that fails is not tried again. Then nothing connects the two any more. So
a subscription without a connection is registered once more, which changes nothing at the master and returns all
publishers, and those that answer are told to rospy as the master would (publisherUpdate,
http://wiki.ros.org/ROS/Slave_API).
"""

from __future__ import annotations

import logging
import threading
from typing import Any, List

import rosgraph
import rospy
from rospy.topics import get_topic_manager

from .errors import CallError
from .liveness import call

__all__ = ["Reconnector", "subscriptions"]

_PERIOD_S = 1.0
_log = logging.getLogger(__name__)


def subscriptions() -> List[Any]:
    """Return rospy's own table of what this process subscribes to."""
    manager = get_topic_manager()
    with manager.lock:
        return list(manager.subs.values())


class Reconnector:
    """Looks after all subscriptions of this process, once a second, on a thread of its own.

    Args:
        limit_s: time for each question to the master and to other nodes.
    """

    def __init__(self, limit_s: float = 0.5) -> None:
        self._master_uri, self._limit_s = rosgraph.get_master_uri(), limit_s
        self._stopped = threading.Event()
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
        for subscription in subscriptions():
            if subscription.get_num_connections() == 0 and not self._stopped.is_set():
                self._connect(subscription.resolved_name, subscription.data_class._type)

    def _connect(self, topic: str, kind: str) -> None:
        me, mine = rospy.get_name(), rospy.get_node_uri()
        try:
            uris = call(self._master_uri, "registerSubscriber", (me, topic, kind, mine), self._limit_s)
            alive = [uri for uri in uris if self._answers(uri)]
            if alive:
                call(mine, "publisherUpdate", (me, topic, alive), self._limit_s)
        except CallError as error:
            _log.debug("%s is not connected: %s", topic, error)

    def _answers(self, uri: str) -> bool:
        """Tell whether a node answers; rospy would wait for one that does not for ever, on a thread of its own."""
        try:
            call(uri, "getPid", (rospy.get_name(),), self._limit_s)
        except CallError:
            return False
        return True
