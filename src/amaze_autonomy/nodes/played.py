"""How many messages a node has received of each topic: out of rospy's answer to getBusStats. Pure.

http://wiki.ros.org/ROS/Slave_API
"""

from __future__ import annotations

from typing import Any, List, Mapping, NamedTuple, Sequence, Tuple

__all__ = ["Reception", "receptions", "unconnected"]

_SUBSCRIBERS = 1
_MESSAGES = 2  # rospy: connection, bytes, messages, -1, whether it stands


class Reception(NamedTuple):
    """What a node has received of a topic.

    Args:
        topic: its name.
        listener: the node.
        messages: that it has read from its connections.
        connections: to publishers.
    """

    topic: str
    listener: str
    messages: int
    connections: int


def receptions(listener: str, stats: Sequence[Any]) -> Tuple[Reception, ...]:
    """Return what a node has received, by topic.

    Args:
        listener: name of the node.
        stats: its answer to getBusStats.
    """
    rows = stats[_SUBSCRIBERS] if len(stats) > _SUBSCRIBERS else ()
    return tuple(
        sorted(
            Reception(str(topic), listener, sum(int(row[_MESSAGES]) for row in connections), len(connections))
            for topic, connections in rows
        )
    )


def unconnected(wanted: Mapping[str, Sequence[str]], there: Sequence[Reception]) -> List[str]:
    """Return which listeners lack a connection to which topics, in words; `wanted`: topics by listener."""
    known = {(each.listener, each.topic) for each in there if each.connections}
    return [f"{node} to {topic}" for node, topics in wanted.items() for topic in topics if (node, topic) not in known]
