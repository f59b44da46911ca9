"""Is what a topic says usable? Finite, changing, and stamped with the present.

What is not finite counts as not having come, so that one NaN is no failure and only NaN is silence. A picture or a
distance that never changes is a sensor that hangs. A stamp is off after some in a row, and right again likewise.
"""

from __future__ import annotations

from typing import Optional

from .condition import FOREVER_NS, Condition, Level, Source, seconds
from .specs import TopicSpec

__all__ = ["ContentMonitor"]

_S = 1_000_000_000
_STAMPS = 5  # in a row that change the verdict on the clock


class ContentMonitor(Source):
    """The verdict on the content of one topic, as far as its specification asks for it.

    Args:
        spec: what is intended.
        good_samples: usable messages in a row after a failure until it counts as back.
    """

    def __init__(self, spec: TopicSpec, good_samples: int = 5) -> None:
        super().__init__()
        self.spec, self._good_samples = spec, good_samples
        self._finite_ns: Optional[int] = None
        self._change_ns: Optional[int] = None
        self._digest: Optional[int] = None
        self._recovering = False
        self._good = 0
        self._stamps_off = False
        self._stamps_in_a_row = 0
        self._stamp_error_ns = 0

    @property
    def wanted(self) -> bool:
        """True when the specification asks for the content; otherwise nobody need look at it."""
        return self.spec.finite or self.spec.unchanged_limit_ns is not None

    def add(self, t_ns: int, *, finite: bool, digest: int) -> bool:
        """Add one message: are its numbers finite, and a digest of it. Return True when that may change the verdict."""
        unknown = self._finite_ns is None
        if self._overdue(t_ns):
            self._recovering, self._good = True, 0
        if self._digest != digest or self._change_ns is None or t_ns < self._change_ns:
            self._change_ns = t_ns
        self._digest = digest
        if finite:
            self._finite_ns = t_ns
        self._good = self._good + 1 if finite and self._fresh(t_ns) else 0
        recovered = self._recovering and self._good >= self._good_samples
        self._recovering = self._recovering and not recovered
        return unknown or recovered

    def add_stamp(self, t_ns: int, stamp_ns: int) -> bool:
        """Add the header stamp of a message that came at a time. True when that changes the verdict."""
        limit_ns = self.spec.stamp_tolerance_ns
        if limit_ns is None:
            return False
        self._stamp_error_ns = t_ns - stamp_ns
        off = abs(self._stamp_error_ns) > limit_ns
        self._stamps_in_a_row = self._stamps_in_a_row + 1 if off is not self._stamps_off else 0
        if self._stamps_in_a_row < _STAMPS:
            return False
        self._stamps_off, self._stamps_in_a_row = off, 0
        return True

    def evaluate(self, t_ns: int) -> Condition:
        """Return the verdict at a time: on the content first, then on the clock."""
        content = self._content(t_ns) if self.wanted else Condition(Level.GOOD)
        if content.level is not Level.GOOD or not self._stamps_off:
            return content
        limit_ns = self.spec.stamp_tolerance_ns or 0
        reason = f"stamps on {self.spec.topic} are more than {seconds(limit_ns)} off the clock"
        value_s = self._stamp_error_ns / _S
        return content._replace(level=Level.OFF, reason=reason, value=value_s, limit=limit_ns / _S, unit="s")

    def _overdue(self, t_ns: int) -> bool:
        """Return True when the content had failed before the message that comes now."""
        if self.spec.finite and self._finite_ns is not None and t_ns - self._finite_ns > self.spec.silence_limit_ns:
            return True
        return not self._fresh(t_ns)

    def _fresh(self, t_ns: int) -> bool:
        limit_ns = self.spec.unchanged_limit_ns
        return limit_ns is None or self._change_ns is None or t_ns - self._change_ns <= limit_ns

    def _content(self, t_ns: int) -> Condition:
        if self._finite_ns is None and self._change_ns is None:
            return self._absent(t_ns, f"no content of {self.spec.topic}")
        conditions = [self._finite(t_ns), self._changing(t_ns)]
        worst = max(conditions, key=lambda condition: condition.level)
        if worst.level is Level.FAILED:
            self._recovering, self._good = True, 0
        elif self._recovering and worst.level is Level.GOOD:
            worst = Condition(
                Level.FAILED, f"the content of {self.spec.topic} is usable again, not yet for long enough"
            )
        return worst._replace(changes_at_ns=min(condition.changes_at_ns for condition in conditions))

    def _finite(self, t_ns: int) -> Condition:
        if not self.spec.finite:
            return Condition(Level.GOOD)
        if self._finite_ns is None:
            return self._absent(t_ns, f"no finite value on {self.spec.topic}")
        self._finite_ns = min(self._finite_ns, t_ns)
        limit_ns = self.spec.silence_limit_ns
        return _aged(t_ns - self._finite_ns, limit_ns, t_ns, f"nothing but NaN or infinity on {self.spec.topic}")

    def _changing(self, t_ns: int) -> Condition:
        limit_ns = self.spec.unchanged_limit_ns
        if limit_ns is None or self._change_ns is None:
            return Condition(Level.GOOD)
        self._change_ns = min(self._change_ns, t_ns)
        return _aged(t_ns - self._change_ns, limit_ns, t_ns, f"the content of {self.spec.topic} has not changed")


def _aged(age_ns: int, limit_ns: int, t_ns: int, what: str) -> Condition:
    """Return the verdict on something that must not grow older than a limit."""
    if age_ns > limit_ns:
        reason = f"{what} for longer than {seconds(limit_ns)}"
        return Condition(Level.FAILED, reason, age_ns / _S, limit_ns / _S, "s", age_ns, FOREVER_NS)
    return Condition(Level.GOOD, "", age_ns / _S, limit_ns / _S, "s", age_ns, t_ns - age_ns + limit_ns + 1)
