"""The recorder on /diagnostics: one status for each platform and one for all, once a second."""

from __future__ import annotations

import time
from typing import Any, List

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.recording.status import WRITING, PlatformStatus, Status

from .interface import ros_time

__all__ = ["RecorderDiagnostics"]

_PERIOD_S = 1.0


class RecorderDiagnostics:
    """Publishes them.

    Args:
        platform: whose node this is.
    """

    def __init__(self, platform: str) -> None:
        self._platform, self._due_s = platform, 0.0
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    def publish(self, ros_ns: int, status: Status) -> None:
        """Publish, at most once a second."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + _PERIOD_S
        message = DiagnosticArray(status=self.rows(status))
        message.header.stamp = ros_time(ros_ns)
        self._publisher.publish(message)

    def rows(self, status: Status) -> List[Any]:
        """Return the statuses."""
        failed = status.phase is RecordingPhase.FAILED
        whole = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if failed else DiagnosticStatus.OK,
            name=f"data recorder ({self._platform})",
            message=f"{status.phase.name} {status.message}".strip(),
            values=[KeyValue("session", status.session_id), KeyValue("location", status.location)],
        )
        return [whole, *(_row(part, writing=status.phase in WRITING) for part in status.platforms)]


def _row(part: PlatformStatus, *, writing: bool) -> Any:
    level = DiagnosticStatus.WARN if part.message or (writing and not part.growing) else DiagnosticStatus.OK
    free = "" if part.free_fraction is None else f"{part.free_fraction:.3f}"
    return DiagnosticStatus(
        level=level,
        name=f"recording on {part.platform}",
        message=part.message or ("records" if part.growing else "does not record"),
        values=[
            KeyValue("bytes", str(part.written_bytes)),
            KeyValue("bytes per second", f"{part.byte_rate:.0f}"),
            KeyValue("free fraction", free),
            KeyValue("messages dropped, at least", str(part.dropped)),
        ],
    )
