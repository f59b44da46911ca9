"""Does a topic come, and as often as intended? Sliding-window rate and time since the last message.

Rules of this file (figures in docs/monitoring.md):

* Silence is judged by the time since the last message alone, never by an average: longer than `silence_limit_ns` is a
  failure, at once. Everything about the rate is judged when a message arrives, so the verdict depends on the messages
  and on silence, not on how often somebody asks.
* The number of messages is noted at most once per bucket of time: a *mark*, (time of the last message in the bucket,
  messages so far). The rate is the slope between the newest mark and the newest one that is a window older. Messages
  may therefore be added in batches; batches that end at or before the border of a bucket, and are not longer than the
  time between two evaluations, give exactly the verdicts of single messages.
* A new rate verdict must stand for half a window before it is given, and the way back to "as intended" is narrower than
  the way out. After a failure by silence the window begins anew: it is back after `good_samples` messages *and*
  `settle_ns`, at the rate that it then has. A topic that starts, with the hitches of that, is not judged to be off
  before a whole window was seen.
* Time that jumps backwards begins the window anew and keeps the verdict.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Sequence, Tuple

from .condition import FOREVER_NS, Condition, Level, Source, seconds
from .specs import TopicSpec

_S = 1_000_000_000
_BUCKETS = 8  # per window
_SETTLE_PERIODS = 3
_NEVER_NS = -1  # smaller than any time: the next message takes the slow path
_RETURN = 0.75  # of the tolerance: within it, a rate that was off is as intended again
_REVIVE = 1.2  # times the failed rate: above it, a rate that had failed is only off


class RateMonitor(Source):
    """The verdict on one topic.

    Args:
        spec: what is intended.
        good_samples: messages after a failure until it counts as back.
    """

    def __init__(self, spec: TopicSpec, good_samples: int = 5) -> None:
        super().__init__()
        self.spec, self._good_samples = spec, good_samples
        self._silence_ns, self._window_ns = spec.silence_limit_ns, spec.rate_window_ns
        self._settle_ns = min(self._window_ns, max(_S // 2, _SETTLE_PERIODS * spec.period_ns))
        coarse = self._window_ns // _BUCKETS
        self.bucket_ns = min(coarse if coarse >= 2 * spec.period_ns else max(1, spec.period_ns // 2), self._silence_ns)
        self._late_ns = 2 * spec.period_ns
        self._level, self._reason = Level.STARTING, "its rate is not known yet"
        self._last_ns: int = _NEVER_NS
        self._total = 0
        self._mark_at_ns = _NEVER_NS
        self._marks: Deque[Tuple[int, int]] = deque()
        self._first: Tuple[int, int] = (0, 0)
        self._settled = False
        self._is_fast = False
        self._candidate: Optional[Tuple[Level, bool]] = None  # and whether off means too fast
        self._candidate_since_ns = 0
        self._rate_hz: Optional[float] = None

    @property
    def total(self) -> int:
        """Messages so far."""
        return self._total

    @property
    def silence_ns(self) -> int:
        """Longest time between two messages that is not silence."""
        return self._silence_ns

    @property
    def steady(self) -> bool:
        """True while it comes as intended, and nothing speaks against that yet."""
        good = self._settled and self._level is Level.GOOD
        return good and self._candidate is None and self._mark_at_ns != _NEVER_NS

    def skip(self, last_t_ns: int, count: int, marks: Sequence[Tuple[int, int]], rate_hz: Optional[float]) -> None:
        """Add messages of a steady topic that leave its verdict as it is, for who knows what comes.

        Args:
            last_t_ns: time of the last one.
            count: how many.
            marks: the window's marks as of the last one that begins a bucket; empty: none does.
            rate_hz: over them.
        """
        self._last_ns = last_t_ns
        self._total += count
        if marks:
            self._mark_at_ns = (last_t_ns // self.bucket_ns + 1) * self.bucket_ns
            self._marks, self._rate_hz = deque(marks), rate_hz

    def add(self, last_t_ns: int, count: int = 1) -> bool:
        """Add messages, the last of which came at a time. Return True when that has changed the verdict."""
        if self._last_ns <= last_t_ns < self._mark_at_ns and count > 0:
            self._last_ns = last_t_ns
            self._total += count
            return False
        return self._cross(last_t_ns, count)

    def evaluate(self, t_ns: int) -> Condition:
        """Return the verdict at a time."""
        if self._last_ns == _NEVER_NS:
            return self._absent(t_ns, f"no message on {self.spec.topic}")
        if self._last_ns - t_ns > self._silence_ns:
            self._begin(t_ns)  # time jumped backwards: count silence from now
        age_ns = max(0, t_ns - self._last_ns)
        if age_ns > self._silence_ns:
            return self._silent(t_ns, age_ns)
        return self._condition(age_ns, self._last_ns + self._silence_ns + 1)

    def _cross(self, last_t_ns: int, count: int) -> bool:
        """Add messages that are the first of a bucket, out of order, or the first after silence."""
        if count <= 0:
            return False
        before, never = self._reason, self._last_ns == _NEVER_NS
        step_ns = last_t_ns - self._last_ns
        if self._mark_at_ns == _NEVER_NS or step_ns < -self._late_ns:
            self._fail_late(last_t_ns)
            self._begin(last_t_ns)
        elif step_ns < 0:
            last_t_ns = self._last_ns  # a little late: it counts, and moves nothing
        elif step_ns > count * self._silence_ns:
            self._fail_silent(last_t_ns)  # silence that nobody asked about
            self._begin(last_t_ns)
        else:
            self._mark()
            self._mark_at_ns = (last_t_ns // self.bucket_ns + 1) * self.bucket_ns
        self._last_ns = last_t_ns
        self._total += count
        return never or self._reason is not before

    def _begin(self, t_ns: int) -> None:
        """Begin the window anew; the verdict stands until the rate is known."""
        self._last_ns = t_ns
        self._mark_at_ns = (t_ns // self.bucket_ns + 1) * self.bucket_ns
        self._marks.clear()
        self._settled, self._candidate, self._rate_hz = False, None, None

    def _mark(self) -> None:
        """Note the last message of a bucket, and judge the rate up to it."""
        marks, at, total = self._marks, self._last_ns, self._total
        if not marks:
            self._first = (at, total)
        marks.append((at, total))
        while len(marks) > 1 and marks[1][0] <= at - self._window_ns:
            marks.popleft()
        base_ns, base_total = marks[0]
        if at > base_ns:
            self._rate_hz = (total - base_total) * _S / (at - base_ns)
            self._judge(at, total, self._rate_hz)

    def _judge(self, at: int, total: int, rate_hz: float) -> None:
        """Give the verdict on a rate once it is known, and afterwards once it has stood for half a window."""
        if not self._settled:
            self._settle(at - self._first[0], total - self._first[1] + 1, rate_hz)
            return
        level = self._classify(rate_hz, self._level)
        verdict = level, level is Level.OFF and rate_hz > self.spec.rate_hz
        if verdict == (self._level, self._is_fast):
            self._candidate = None
        elif verdict != self._candidate:
            self._candidate, self._candidate_since_ns = verdict, at
        elif at - self._candidate_since_ns >= self._window_ns // 2:
            self._candidate = None
            self._give(level, rate_hz)

    def _settle(self, seen_ns: int, seen: int, rate_hz: float) -> None:
        """Give the first verdict on a rate; while starting, none but "as intended" before a whole window was seen."""
        level = self._classify(rate_hz, Level.GOOD)
        hasty = level is not Level.GOOD and self._level is Level.STARTING and seen_ns < self._window_ns
        if seen_ns >= self._settle_ns and seen >= self._good_samples and not hasty:
            self._settled = True
            self._give(level, rate_hz)

    def _classify(self, rate_hz: float, now: Level) -> Level:
        """Return the level of a rate; the way back to a better one than now is narrower."""
        spec = self.spec
        fraction = rate_hz / spec.rate_hz
        failed = spec.rate_failed_fraction
        if fraction < (min(failed * _REVIVE, 1 - spec.tolerance_fraction) if now is Level.FAILED else failed):
            return Level.FAILED
        tolerance = spec.tolerance_fraction * (1.0 if now is Level.GOOD else _RETURN)
        return Level.GOOD if abs(fraction - 1.0) <= tolerance else Level.OFF

    def _give(self, level: Level, rate_hz: float) -> None:
        spec = self.spec
        self._level, self._is_fast = level, level is Level.OFF and rate_hz > spec.rate_hz
        if level is Level.GOOD:
            self._reason = ""
        elif level is Level.FAILED:
            least = spec.rate_failed_fraction * spec.rate_hz
            self._reason = f"{rate_hz:.3g} Hz on {spec.topic}, below {least:.3g} Hz it has failed"
        else:
            how = "fast" if self._is_fast else "slow"
            self._reason = f"{rate_hz:.3g} Hz on {spec.topic}, too {how}, expected {spec.rate_hz:.3g} Hz"

    def _fail_late(self, t_ns: int) -> None:
        """Give the verdict on a topic that comes for the first time when it had failed already."""
        if self._last_ns == _NEVER_NS and not self._in_time(t_ns):
            self._level, self._is_fast, self._reason = (
                Level.FAILED,
                False,
                f"no message on {self.spec.topic} since the start",
            )

    def _fail_silent(self, t_ns: int) -> None:
        """Give the verdict on silence; while starting, there is still time."""
        if self._level is Level.STARTING and self._in_time(t_ns):
            return
        self._level, self._is_fast = Level.FAILED, False
        self._reason = f"no message on {self.spec.topic} for longer than {seconds(self._silence_ns)}"

    def _silent(self, t_ns: int, age_ns: int) -> Condition:
        """Return the verdict on a topic that has stopped."""
        self._mark_at_ns = _NEVER_NS
        self._fail_silent(t_ns)
        ends_ns = self._grace_end_ns if self._level is Level.STARTING else None
        changes_at_ns = FOREVER_NS if ends_ns is None else ends_ns
        limit_s = self._silence_ns / _S
        return Condition(self._level, self._reason, age_ns / _S, limit_s, "s", age_ns, changes_at_ns)

    def _condition(self, age_ns: int, changes_at_ns: int) -> Condition:
        """Return the verdict on a topic that comes."""
        rate_hz, spec = self._rate_hz, self.spec
        fast = rate_hz is not None and rate_hz > spec.rate_hz
        spread = spec.tolerance_fraction if fast else -spec.tolerance_fraction
        limit, other = spec.rate_hz * (1 + spread), spec.rate_hz * (1 - spread)
        if self._level is Level.FAILED and not fast:
            failed = spec.rate_hz * spec.rate_failed_fraction
            return Condition(self._level, self._reason, rate_hz, failed, "Hz", age_ns, changes_at_ns)
        return Condition(self._level, self._reason, rate_hz, limit, "Hz", age_ns, changes_at_ns, other)


def return_time_ns(spec: TopicSpec, good_samples: int) -> int:
    """Return the time from the first message until a topic that had failed is back, if it comes as intended.

    Args:
        spec: of the topic.
        good_samples: messages after a failure until it counts as back.
    """
    monitor, at_ns = RateMonitor(spec, good_samples), 0
    monitor.start(at_ns, 0)  # what comes for the first time had failed already
    monitor.add(at_ns)
    while monitor.evaluate(at_ns).level is Level.FAILED:
        at_ns += spec.period_ns
        monitor.add(at_ns)
    return at_ns
