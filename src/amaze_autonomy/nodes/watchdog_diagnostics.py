"""The watchdog's words for people: a row per component on /diagnostics, a line of the log for each change."""

from __future__ import annotations

from typing import Any, Iterable, Sequence, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from amaze_autonomy.engine.checks import Check
from amaze_autonomy.engine.events import ComponentStatus, WatchdogInfo
from amaze_autonomy.engine.severity import Code, Restart
from amaze_autonomy.monitoring.specs import ComponentSpec

from .interface import ros_time

__all__ = ["array", "log_changes"]

_LEVELS = {
    Code.NOMINAL: DiagnosticStatus.OK,
    Code.NON_CRITICAL: DiagnosticStatus.WARN,
    Code.INCONVENIENT: DiagnosticStatus.WARN,
    Code.HOLD: DiagnosticStatus.ERROR,
    Code.ABORT: DiagnosticStatus.ERROR,
}


def array(
    ros_ns: int, rows: Iterable[Check], statuses: Iterable[ComponentStatus], specs: Sequence[ComponentSpec]
) -> Any:
    """Return the message for all components, in their order."""
    message = DiagnosticArray()
    message.header.stamp = ros_time(ros_ns)
    message.status = [_status(row, status, spec) for row, status, spec in zip(rows, statuses, specs)]
    return message


def _status(row: Check, status: ComponentStatus, spec: ComponentSpec) -> Any:
    values: Tuple[Tuple[str, Any], ...] = (
        ("code", f"{int(status.code)} {status.code.name}"),
        ("restart", status.restart.value),
        ("value", "" if row.value is None else f"{row.value:.4g} {row.unit}".strip()),
        ("limit", "" if row.limit is None else f"{row.limit:.4g} {row.unit}".strip()),
        ("age", "" if row.age_s is None else f"{row.age_s:.3f} s"),
        ("advice", row.advice),
        ("topics", ", ".join(topic.topic for topic in spec.topics)),
        ("node", spec.node or ""),
    )
    return DiagnosticStatus(
        level=_LEVELS[status.code],
        name=f"watchdog: {spec.name}",
        message=status.reason or status.code.name,
        hardware_id=spec.group,
        values=[KeyValue(key, value) for key, value in values if value],
    )


def log_changes(info: WatchdogInfo) -> None:
    """Write a line of the log for each component that changed."""
    for status in info.components:
        if status.name in info.changed:
            log = rospy.loginfo if status.code is Code.NOMINAL else rospy.logwarn
            restart = "" if status.restart is Restart.NONE else f", restart {status.restart.value}"
            log("%s: %s%s%s%s", status.name, status.code.name, restart, ": " if status.reason else "", status.reason)
