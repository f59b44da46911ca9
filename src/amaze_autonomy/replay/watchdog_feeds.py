"""From messages to the watchdog: that they came, and what the recorded autopilot says of its sensors."""

from __future__ import annotations

from typing import Any, Optional

from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.specs import AutopilotSensor
from amaze_autonomy.monitoring.watchdog import Watchdog

from .feed import Feed
from .pace import Pace
from .statuses import health_of
from .tracks import Track

__all__ = ["ComponentFeed", "HealthFeed"]

_S = 1_000_000_000


class ComponentFeed(Feed):
    """A message of a component: it came, that is all."""

    def __init__(self, watchdog: Watchdog, name: str, topic: str, period_ns: int) -> None:
        super().__init__(topic, period_ns, decodes=False)
        self._watchdog, self._name = watchdog, name
        self.count = watchdog.counter(name, topic)
        self._pace: Optional[Pace] = None

    def ride(self, track: Track, rank: int) -> None:
        """Count all messages of a track."""
        super().ride(track, rank)
        self._pace = Pace(self._watchdog.rate(self._name, self.topic), track, self.count)

    def take_many(self, begin: int, end: int) -> None:
        """Count some."""
        if self._pace is not None:
            self._pace.take(begin, end)

    @property
    def steady(self) -> bool:
        """True while the topic comes as intended."""
        return self._pace is not None and self._pace.steady

    def changes_ns(self) -> int:
        """Return when the verdict can change by a message, or by none, of the track."""
        return FOREVER_NS if self._pace is None else self._pace.changes_ns(self.taken)

    def take(self, t_ns: int, message: Any) -> None:  # noqa: ARG002
        """Count it."""
        self._watchdog.add_samples(self._name, t_ns, 1, self.topic)

    def play(self, t_ns: int) -> None:
        """Count it."""
        self._watchdog.add_samples(self._name, t_ns, 1, self.topic)


class HealthFeed(Feed):
    """What the recorded autopilot says of its sensors."""

    def __init__(self, watchdog: Watchdog, topic: str) -> None:
        super().__init__(topic, _S // 5)
        self._watchdog = watchdog

    def take(self, t_ns: int, message: Any) -> None:
        """Take a status."""
        self._watchdog.add_autopilot(t_ns, {AutopilotSensor(name): good for name, good in health_of(message).items()})

    def play(self, t_ns: int) -> None:
        """Take one of a vehicle whose sensors all work."""
        self._watchdog.add_autopilot(t_ns, dict.fromkeys(AutopilotSensor, True))
