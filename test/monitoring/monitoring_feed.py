"""Feeds monitors with made-up streams; no test itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Iterator, List, Optional, Tuple

from amaze_autonomy.engine.events import Check
from amaze_autonomy.monitoring.condition import Level
from amaze_autonomy.monitoring.rate import RateMonitor

S = 1_000_000_000


def regular(rate_hz: float, start_s: float, end_s: float) -> List[int]:
    """Return the times of a regular stream, ns."""
    count = int((end_s - start_s) * rate_hz)
    return [int((start_s + index / rate_hz) * S) for index in range(count)]


def follow(monitor: RateMonitor, times: List[int], end_ns: int) -> List[Tuple[int, Level, str]]:
    """Add each message by itself, wake at every time the monitor names, and return every change of its verdict."""
    begin_ns = _begin(monitor)
    changes: List[Tuple[int, Level, str]] = [(begin_ns, *monitor.evaluate(begin_ns)[:2])]
    for t_ns, is_message in wakes(monitor, times, end_ns):
        if is_message:
            monitor.add(t_ns)
        condition = monitor.evaluate(t_ns)
        if changes[-1][1:] != (condition.level, condition.reason):
            changes.append((t_ns, condition.level, condition.reason))
    return changes


def wakes(monitor: RateMonitor, times: List[int], end_ns: int) -> Iterator[Tuple[int, bool]]:
    """Yield every time at which something arrives or the monitor wants to be asked, in order, up to the end."""
    pending = iter(times)
    arrival: Optional[int] = next(pending, None)
    now = _begin(monitor)
    while True:
        due = monitor.evaluate(now).changes_at_ns
        if arrival is not None and arrival <= min(due, end_ns):
            now = arrival
            yield now, True
            arrival = next(pending, None)
        elif due <= end_ns:
            now = due
            yield now, False
        else:
            return


def _begin(monitor: RateMonitor) -> int:
    """Return where an earlier stream has left off."""
    return max(0, monitor._last_ns)


def rounded(row: Check) -> Check:
    """Return a row with six decimals, to be compared whole."""
    numbers = {name: getattr(row, name) for name in ("value", "limit", "age_s", "other_limit")}
    return replace(row, **{name: None if value is None else round(value, 6) for name, value in numbers.items()})
