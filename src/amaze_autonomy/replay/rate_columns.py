"""Messages of a topic for its rate monitor: one by one where they change something, else as many as can be at once.

A replay knows the whole recording: numpy says beforehand at which messages the rate, by the very arithmetic of
`monitoring.rate`, is not as intended, or too young to tell. A monitor that is steady takes all others at once, and is
left as it would be had it taken them one after the other.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any, Callable, List, Tuple

import numpy as np

from amaze_autonomy.monitoring.condition import FOREVER_NS
from amaze_autonomy.monitoring.rate import RateMonitor

from .topic_columns import Track

__all__ = ["Pace"]

_S = 1_000_000_000
_EXACT = 9_000_000  # so many messages times 1e9 are exact as a float


class Pace:
    """A track on its way into a rate monitor.

    Args:
        monitor: of the topic.
        track: its messages.
        add: takes the time of one message, as the monitor's `add` does.
    """

    def __init__(self, monitor: RateMonitor, track: Track, add: Callable[[int], object]) -> None:
        self._monitor, self._times, self._add = monitor, track.listed, add
        cross, at, base, rates, calm, silent = _crossings(monitor, track.times)
        self._cross: List[int] = cross.tolist()
        self._at: List[int] = at.tolist()
        self._base: List[int] = base.tolist()
        self._rates: List[float] = rates.tolist()
        self._odd: List[int] = cross[~calm].tolist()
        limit_ns = monitor.silence_ns + 1
        self._odd_ns: List[int] = np.where(silent, at + limit_ns, track.times[cross])[~calm].tolist()
        self._end_ns = self._times[-1] + limit_ns if self._times else FOREVER_NS

    def take(self, begin: int, end: int) -> None:
        """Take messages by their places, the next ones in order."""
        monitor, times, odd = self._monitor, self._times, self._odd
        place = bisect_left(odd, begin)
        while begin < end:
            while place < len(odd) and odd[place] < begin:
                place += 1
            stop = min(end, odd[place]) if place < len(odd) else end
            if begin and begin < stop and monitor.steady:
                self._skip(begin, stop)
                begin = stop
            else:
                self._add(times[begin])
                begin += 1

    @property
    def steady(self) -> bool:
        """True while the monitor is steady: then `changes_ns` foresees silence, too."""
        return self._monitor.steady

    def changes_ns(self, taken: int) -> int:
        """Return when the verdict can change, at the earliest, once so many messages have been taken."""
        if not taken or not self._monitor.steady:
            return self._times[taken] if taken < len(self._times) else FOREVER_NS
        place = bisect_left(self._odd, taken)
        return self._odd_ns[place] if place < len(self._odd) else self._end_ns

    def _skip(self, begin: int, end: int) -> None:
        before = self._monitor.total - begin
        last = bisect_right(self._cross, end - 1) - 1
        marks: List[Tuple[int, int]] = []
        if last >= 0 and self._cross[last] >= begin:
            first = self._base[last]
            marks = [(at, before + cross) for at, cross in zip(self._at[first : last + 1], self._cross[first:])]
        self._monitor.skip(self._times[end - 1], end - begin, marks, self._rates[last] if marks else None)


def _crossings(monitor: RateMonitor, times: Any) -> Tuple[Any, ...]:
    """Return all messages that are the first of a bucket, and what the monitor makes of those before.

    Returns:
        Their places; the times of the messages before them; by place among them the mark that the rate begins at; the
        rates; which leave a steady monitor as it is; which come after silence.
    """
    spec = monitor.spec
    cross: Any = np.flatnonzero(np.diff(times // monitor.bucket_ns)) + 1
    at = times[cross - 1]
    silent = times[cross] - at > monitor.silence_ns
    begun = np.maximum.accumulate(np.where(silent, cross, 0)) if len(cross) else cross
    base = np.searchsorted(at, at - spec.rate_window_ns, "right") - 1
    count, span = cross - cross[base], at - at[base]
    known = (base >= 0) & (cross[base] > begun) & (count < _EXACT) & (span > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = count * _S / span
    fraction = rates / spec.rate_hz
    good = ~(fraction < spec.rate_failed_fraction) & (np.abs(fraction - 1.0) <= spec.tolerance_fraction)
    return cross, at, base, rates, known & ~silent & good, silent
