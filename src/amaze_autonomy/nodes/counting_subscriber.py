"""A subscriber that counts: rospy registers it, finds the publishers and shakes hands; `topic_reader` reads.

rospy has no public way to another transport. This file knows rospy's insides: its table of subscriptions
(`rospy.topics`), as `reconnector` does, and the loop of a connection that is replaced (`TCPROSTransport.receive_loop`).
"""

from __future__ import annotations

from typing import Any, Callable, Mapping, Optional, Type

import rospy
from rospy.impl.registration import Registration
from rospy.topics import _SubscriberImpl, get_topic_manager

from .errors import StartError
from .topic_reader import Look, Tally, TopicReader, TopicStream

__all__ = ["LookFor", "subscribe"]

#: Makes the look at the messages of one publisher from the header of its connection; None: they are only counted.
LookFor = Callable[[Mapping[str, str]], Optional[Look]]


class _CountedTopic(_SubscriberImpl):
    """rospy's side of one topic: connections that are made here are read elsewhere."""

    def __init__(self, name: str, kind: Type[Any], reader: TopicReader, tally: Tally, look_for: LookFor) -> None:
        super().__init__(name, kind)
        self._reader, self._tally, self._look_for = reader, tally, look_for
        self.set_tcp_nodelay(True)

    def add_connection(self, connection: Any) -> Any:
        """Have a connection hand itself over once its handshake is done; on rospy's threads."""
        connection.receive_loop = lambda _callback: self._take_over(connection)
        return super().add_connection(connection)

    def get_stats(self) -> Any:
        """Return what getBusStats says of it; messages are counted by topic, here on the first connection."""
        counts = [self._tally.total] + [0] * len(self.connections)
        rows = [(c.id, c.stat_bytes, count, -1, not c.done) for c, count in zip(self.connections, counts)]
        return self.resolved_name, rows

    def _take_over(self, connection: Any) -> None:
        sock, buffer = connection.socket, connection.read_buff
        if sock is None or connection.done:
            return
        # a duplicate: rospy may close its own at any time, which ends this one by shutdown
        stream = TopicStream(sock.dup(), self._tally, self._look_for(connection.header), connection.close)
        self._reader.add(stream, buffer.getvalue()[: buffer.tell()])


def subscribe(
    topic: str,
    reader: TopicReader,
    tally: Tally,
    look_for: LookFor = lambda _header: None,
    kind: Type[Any] = rospy.AnyMsg,
) -> None:
    """Count the messages of a topic from now on.

    Args:
        topic: resolved name.
        reader: that reads its connections.
        tally: that counts.
        look_for: makes the look at the messages of each publisher.
        kind: of its messages; publishers of another kind are not connected.

    Raises:
        StartError: This process already subscribes to it otherwise.
    """
    manager = get_topic_manager()
    with manager.lock:
        if manager.get_subscriber_impl(topic) is not None:
            raise StartError(f"{topic} is read by this node for itself and cannot be watched")
        counted = _CountedTopic(topic, kind, reader, tally, look_for)
        counted.ref_count += 1
        manager._add(counted, manager.subs, Registration.SUB)
