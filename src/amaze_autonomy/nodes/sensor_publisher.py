"""Publishes the samples of the simulated sensors as real messages; the world only has plain values."""

from __future__ import annotations

from typing import Any, Dict, Iterable, Mapping

import roslib.message
import rospy

from amaze_autonomy.simulation.messages import Sample

from .clock import Clock
from .interface import ros_time

__all__ = ["SensorPublisher", "fill", "message_of"]

_QUEUE = 50


def fill(message: Any, fields: Mapping[str, Any]) -> Any:
    """Set fields of a message from plain values; a nested message is a mapping."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def message_of(sample: Sample, shift_ns: int) -> Any:
    """Return the message of a sample; `shift_ns` is ROS time less the clock of its stamp."""
    message = fill(roslib.message.get_message_class(sample.type_name)(), sample.fields)
    if hasattr(message, "header"):
        message.header.stamp = ros_time(max(0, sample.stamp_ns + shift_ns))
        message.header.frame_id = sample.frame_id
    return message


class SensorPublisher:
    """One publisher per topic, made when its first sample comes.

    Args:
        clock: that the samples' stamps are on; the messages are stamped in ROS time.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._publishers: Dict[str, Any] = {}

    def publish(self, samples: Iterable[Sample]) -> None:
        """Publish samples; of those that nobody listens to only the stamp is looked at."""
        shift_ns = self._clock.ros_ns() - self._clock.now_ns()
        for sample in samples:
            publisher = self._publisher(sample)
            if publisher.get_num_connections():
                publisher.publish(message_of(sample, shift_ns))

    def _publisher(self, sample: Sample) -> Any:
        publisher = self._publishers.get(sample.topic)
        if publisher is None:
            message = roslib.message.get_message_class(sample.type_name)
            publisher = self._publishers[sample.topic] = rospy.Publisher(sample.topic, message, queue_size=_QUEUE)
        return publisher
