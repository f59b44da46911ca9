"""Does a node answer, does the look at a driver succeed, does the autopilot call its sensor healthy?

A refusal fails at once; silence fails when the last good answer is too old. The autopilot's word changes the verdict
only when it is said some times in a row.
"""

from __future__ import annotations

from typing import Optional

from .condition import FOREVER_NS, Condition, Level, Source, seconds

__all__ = ["AnswerMonitor"]

_S = 1_000_000_000


class AnswerMonitor(Source):
    """The verdict on something that says yes, no, or nothing.

    Args:
        what: for the reasons, e.g. "node /camera".
        age_limit_ns: longest time without a yes or no.
        reports: yes or no so many times in a row changes the verdict; the first of all counts at once.
    """

    def __init__(self, what: str, age_limit_ns: int, reports: int = 1) -> None:
        super().__init__()
        self.what, self._age_limit_ns, self._reports = what, age_limit_ns, reports
        self._last_ns: Optional[int] = None
        self._good: Optional[bool] = None
        self._in_a_row = 0
        self._stale = False
        self._message = ""

    def add(self, t_ns: int, good: Optional[bool], message: str = "") -> bool:  # noqa: FBT001
        """Add an answer; None when it did not come or says nothing. Return True when that may change the verdict."""
        if good is None:
            return False
        was_stale, self._stale, self._last_ns = self._stale, False, t_ns
        self._in_a_row = self._in_a_row + 1 if good is not self._good else 0
        if self._good is not None and not was_stale and self._in_a_row < self._reports:
            return False
        self._good, self._message, self._in_a_row = good, message, 0
        return True

    def evaluate(self, t_ns: int) -> Condition:
        """Return the verdict at a time."""
        if self._last_ns is None:
            return self._absent(t_ns, f"{self.what}: no answer")
        self._last_ns = min(self._last_ns, t_ns)
        age_ns = t_ns - self._last_ns
        if age_ns > self._age_limit_ns:
            self._stale = True
            reason = f"{self.what}: no answer for longer than {seconds(self._age_limit_ns)}"
            return Condition(Level.FAILED, reason, age_ns / _S, self._age_limit_ns / _S, "s", age_ns, FOREVER_NS)
        changes_at_ns = self._last_ns + self._age_limit_ns + 1
        if self._good:
            return Condition(Level.GOOD, age_ns=age_ns, changes_at_ns=changes_at_ns)
        return Condition(
            Level.FAILED, f"{self.what}: {self._message or 'failed'}", age_ns=age_ns, changes_at_ns=changes_at_ns
        )
