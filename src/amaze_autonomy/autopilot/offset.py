"""How far the vehicle's clocks are from this computer's: since its start (TIMESYNC), and of the day (SYSTEM_TIME).

We ask with our time, it answers with its own; of the last answers the one that came quickest is right within half of
the time it took. https://mavlink.io/en/services/timesync.html
"""

from __future__ import annotations

from collections import deque
from typing import Any, Deque, NamedTuple, Optional

from .dialect import Message, mavlink

__all__ = ["ClockOffset", "Sync"]

_ASK_NS = 1_000_000_000
_LONGEST_NS = 500_000_000
_KEPT = 16
_YEAR_2020_US = 1_577_836_800_000_000


class Sync(NamedTuple):
    """The vehicle's clock minus ours, and how long the answer took; ns."""

    offset_ns: int
    round_trip_ns: int


class ClockOffset:
    """Asks and listens."""

    def __init__(self) -> None:
        self._asked: Optional[int] = None
        self._due_ns = 0
        self._answers: Deque[Sync] = deque(maxlen=_KEPT)
        self.utc_offset_ns: Optional[int] = None

    def wake(self, t_ns: int) -> Optional[Message]:
        """Return a question when one is due."""
        if t_ns < self._due_ns:
            return None
        self._due_ns, self._asked = t_ns + _ASK_NS, t_ns
        return mavlink.MAVLink_timesync_message(0, t_ns)

    def add(self, t_ns: int, message: Any) -> None:
        """Take a TIMESYNC; the vehicle's own questions (tc1 of 0) and answers to others are not ours."""
        if message.tc1 <= 0 or message.ts1 != self._asked:
            return
        self._asked = None
        took_ns = t_ns - message.ts1
        if 0 <= took_ns <= _LONGEST_NS:
            self._answers.append(Sync(message.tc1 - message.ts1 - took_ns // 2, took_ns))

    def add_system_time(self, unix_ns: int, message: Any) -> None:
        """Take a SYSTEM_TIME; one before 2020 says that the vehicle has no time of day."""
        known = message.time_unix_usec >= _YEAR_2020_US and unix_ns > 0
        self.utc_offset_ns = message.time_unix_usec * 1000 - unix_ns if known else None

    @property
    def best(self) -> Optional[Sync]:
        """The quickest of the last answers, None when there was none."""
        return min(self._answers, key=lambda answer: answer.round_trip_ns) if self._answers else None
