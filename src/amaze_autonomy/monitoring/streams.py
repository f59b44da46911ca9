"""The watchdog's two streams: action (issues and heartbeat) and info (everything), at their periods and on a change."""

from __future__ import annotations

from typing import Optional, Tuple

from amaze_autonomy.engine.events import ComponentStatus, WatchdogAction, WatchdogInfo, made
from amaze_autonomy.engine.severity import Code

from .watchdog import Watchdog

__all__ = ["Streams"]

_S = 1_000_000_000
_Poll = Tuple[Optional[WatchdogAction], Optional[WatchdogInfo]]


class Streams:
    """Builds the messages of a watchdog. Level-based: each says the whole present.

    Args:
        watchdog: whose loop this is; `poll` is one turn of it.
        action_period_ns: of the action stream, which is the heartbeat.
        info_period_ns: of the info stream.
    """

    def __init__(self, watchdog: Watchdog, action_period_ns: int = _S // 5, info_period_ns: int = _S) -> None:
        self._watchdog = watchdog
        self._action_period_ns, self._info_period_ns = action_period_ns, info_period_ns
        self._action_due_ns = self._info_due_ns = 0
        self._action_sequence = self._info_sequence = 0
        self._sent: Tuple[ComponentStatus, ...] = ()
        self._judged: Tuple[ComponentStatus, ...] = ()
        self._issues: Tuple[ComponentStatus, ...] = ()  # of those that were judged last

    @property
    def next_ns(self) -> int:
        """When `poll` must be called again, unless something arrives before."""
        return min(self.due_ns, self._watchdog.next_ns)

    @property
    def due_ns(self) -> int:
        """When the next message is due, if nothing changes."""
        return min(self._action_due_ns, self._info_due_ns)

    def poll(self, t_ns: int) -> _Poll:
        """Turn the loop once: evaluate, and return the messages that are due; None for one that is not."""
        statuses = self._watchdog.evaluate(t_ns)
        if not self._watchdog.started:
            return None, None
        changed = statuses is not self._sent
        due = changed or not self._action_due_ns - self._action_period_ns <= t_ns < self._action_due_ns
        action = self._action(t_ns, statuses) if due else None
        due = changed or not self._info_due_ns - self._info_period_ns <= t_ns < self._info_due_ns
        info = self._info(t_ns, statuses) if due else None
        self._sent = statuses
        return action, info

    def _action(self, t_ns: int, statuses: Tuple[ComponentStatus, ...]) -> WatchdogAction:
        self._action_due_ns = t_ns + self._action_period_ns
        if statuses is not self._judged:
            self._judged, self._issues = statuses, tuple(each for each in statuses if each.code >= Code.INCONVENIENT)
        self._action_sequence += 1
        return made(
            WatchdogAction,
            t_ns=t_ns,
            sequence=self._action_sequence,
            loop_counter=self._watchdog.loop_counter,
            code=max(status.code for status in self._issues) if self._issues else Code.NOMINAL,
            latest_component=self._watchdog.latest_component,
            components=self._issues,
            publisher="",
            age_ns=0,
        )

    def _info(self, t_ns: int, statuses: Tuple[ComponentStatus, ...]) -> WatchdogInfo:
        self._info_due_ns = t_ns + self._info_period_ns
        changed: Tuple[str, ...] = ()
        if statuses is not self._sent:
            sent = {status.name: status for status in self._sent}
            changed = tuple(status.name for status in statuses if sent.get(status.name) != status)
        self._info_sequence += 1
        return WatchdogInfo(t_ns=t_ns, sequence=self._info_sequence, changed=changed, components=statuses)
