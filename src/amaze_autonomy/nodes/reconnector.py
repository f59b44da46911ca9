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
from typing import Any, Sequence

import rospy

from .errors import CallError
from .xmlrpc_call import call

__all__ = ["Reconnector"]

_log = logging.getLogger(__name__)


class Reconnector:
    """Looks after subscriptions; `look` is to be called again and again, on a thread that may wait.

    Args:
        subscribers: of rospy.
        master_uri: of the ROS master.
        limit_s: time for each question.
    """

    def __init__(self, subscribers: Sequence[Any], master_uri: str, limit_s: float = 0.5) -> None:
        self._subscribers, self._master_uri, self._limit_s = subscribers, master_uri, limit_s

    def look(self) -> None:
        """Connect what is not connected although somebody publishes it."""
        for subscriber in self._subscribers:
            if subscriber.get_num_connections() == 0:
                self._connect(subscriber)

    def _connect(self, subscriber: Any) -> None:
        topic, kind = subscriber.resolved_name, subscriber.data_class._type
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
