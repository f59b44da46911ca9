"""The rows of a pre-flight check on /diagnostics, one status for all of them, once a second."""

from __future__ import annotations

from typing import Any, Sequence

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from amaze_autonomy.ros.clock import Clock

from ...engine.events import Check, Verdict
from ...journal.report import limit_words
from ...ros.interface import ros_time

_PERIOD_NS = 1_000_000_000
_LEVELS = {
    Verdict.PASS: DiagnosticStatus.OK,
    Verdict.WARN: DiagnosticStatus.WARN,
    Verdict.FAIL: DiagnosticStatus.ERROR,
    Verdict.UNKNOWN: DiagnosticStatus.STALE,
}


class CheckDiagnostics:
    """Publishes the rows of one check.

    Args:
        name: of the status.
        clock: the node's.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self._name, self._clock = name, clock
        self._due_ns = 0
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    def publish(self, now_ns: int, rows: Sequence[Check]) -> None:
        """Publish the rows, at most once a second."""
        if now_ns < self._due_ns:
            return
        self._due_ns = now_ns + _PERIOD_NS
        message = DiagnosticArray(status=[self._status(rows)])
        message.header.stamp = ros_time(self._clock.ros_ns())
        self._publisher.publish(message)

    def _status(self, rows: Sequence[Check]) -> Any:
        worst = max(rows, key=lambda row: _LEVELS[row.verdict], default=None)
        return DiagnosticStatus(
            level=DiagnosticStatus.OK if worst is None else _LEVELS[worst.verdict],
            name=self._name,
            message="; ".join(row.advice for row in rows if row.advice) or "all checks pass",
            values=[KeyValue(row.name, _words(row)) for row in rows],
        )


def _words(row: Check) -> str:
    value = "" if row.value is None else f" {row.value:.4g} {row.unit}".rstrip()
    limits = limit_words(row, lambda each: f"{each:.4g} {row.unit}".rstrip())
    return f"{row.verdict.name}{value}{f', limit {limits}' if limits else ''}"
