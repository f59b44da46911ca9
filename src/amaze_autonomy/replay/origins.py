"""Where what is known at a time comes from: the recording, or the script that plays what has not begun yet."""

from __future__ import annotations

from typing import Dict, Tuple

from .plan import Plan
from .sources import Recordings
from .timeline import Source

__all__ = ["Origins"]


class Origins:
    """When each topic begins to speak for itself.

    Args:
        plan: of the replay.
        recordings: open.

    Attributes:
        script_until_ns: until then silent topics may be played.
    """

    def __init__(self, plan: Plan, recordings: Recordings) -> None:
        self.script_until_ns = recordings.start_ns + plan.topic_map.script.sensors_until_ns
        self._statuses = plan.topic_map.statuses
        self._watched = plan.component_topics or recordings.topics
        self._first_ns = _first_times(recordings)

    def begins_ns(self, topic: str) -> int:
        """Return until when a topic may be played."""
        return min(self.script_until_ns, self._first_ns.get(topic, self.script_until_ns))

    def source(self, t_ns: int) -> Source:
        """Return where what is known of the components comes from at a time."""
        return self.of(self._watched, t_ns)

    def of(self, topics: Tuple[str, ...], t_ns: int) -> Source:
        """Return where what some topics say comes from at a time."""
        if t_ns >= self.script_until_ns:
            return Source.BAG
        begun = [topic for topic in topics if t_ns >= self._first_ns.get(topic, self.script_until_ns)]
        if len(begun) == len(topics):
            return Source.BAG
        return Source.BAG | Source.SCRIPT if begun else Source.SCRIPT

    def has(self, name: str, t_ns: int) -> bool:
        """Return True when the recording tells a status, so that the script is silent; before it begins it may play."""
        topic = self._statuses.get(name)
        return topic is not None and t_ns >= self.begins_ns(topic)


def _first_times(recordings: Recordings) -> Dict[str, int]:
    first: Dict[str, int] = {}
    for rank, topic in enumerate(recordings.topics):
        times = recordings.times(rank)
        if len(times):
            first[topic] = int(times[0])
    return first
