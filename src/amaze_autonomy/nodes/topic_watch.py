"""One topic that the watchdog watches: its messages are counted; looked at only as far as the configuration asks."""

from __future__ import annotations

from typing import Callable, List, Mapping, Optional, Tuple

import rospy

from amaze_autonomy.monitoring.specs import TopicSpec
from amaze_autonomy.monitoring.watchdog import Watchdog

from .clock import Clock
from .message_content import MessageContent
from .topic_reader import ALL, STAMP_BYTES, Look, Tally

__all__ = ["TopicWatch"]


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
        self._takers: List[Callable[[memoryview], None]] = []

    def use(self, component: str, spec: TopicSpec) -> None:
        """Count it for a component, and look at it as its specification asks."""
        self._uses.append((component, spec))
        if spec.stamp_tolerance_ns is not None:
            self._stamps.append((component, spec))
            self.tally.wanted = self.tally.wanted or STAMP_BYTES
        if spec.finite or spec.unchanged_limit_ns is not None:
            self._contents.append((component, spec))
            self.tally.wanted = ALL

    def take_whole(self, take: Callable[[memoryview], None]) -> None:
        """Hand every message to somebody who reads it."""
        self._takers.append(take)
        self.tally.wanted = ALL

    def flush(self, now_ns: int) -> None:
        """Hand over what has come."""
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
        return lambda data: self._look(content, data)

    def _look(self, content: MessageContent, data: memoryview) -> None:
        for take in self._takers:
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
        now_ns = self._clock.now_ns()
        finite = not any(spec.finite for _, spec in self._contents) or content.finite(data)
        changing = any(spec.unchanged_limit_ns is not None for _, spec in self._contents)
        digest = content.digest(data) if changing else 0
        for component, spec in self._contents:
            self._watchdog.add_content(
                component, now_ns, finite=finite or not spec.finite, digest=digest, topic=spec.topic
            )
