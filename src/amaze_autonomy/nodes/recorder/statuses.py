"""Statuses of the recorder -> messages. None becomes NaN."""

from __future__ import annotations

import time
from typing import Any, Dict, List, Optional, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from amaze_autonomy import msg
from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.recording.status import WRITING, PlatformStatus, Status

from ...ros.interface import number, ros_time
from .processes import DiskSync

__all__ = ["RecorderDiagnostics", "RecorderTeller", "recording_status", "ros_time"]


def recording_status(status: Status, ros_ns: int) -> Any:
    """Write a RecordingStatus."""
    message = msg.RecordingStatus(
        session_id=status.session_id,
        phase=status.phase.value,
        progress=number(status.progress),
        platforms=[_platform(each) for each in status.platforms],
        location=status.location,
        message=status.message,
        lost=status.lost,
        remaining=number(status.remaining_s),
        dropped=status.dropped,
    )
    message.header.stamp = ros_time(ros_ns)
    return message


def _platform(part: PlatformStatus) -> Any:
    return msg.PlatformRecording(
        platform=part.platform,
        growing=part.growing,
        bytes=part.written_bytes,
        byte_rate=round(part.byte_rate, 0),
        free_fraction=round(number(part.free_fraction), 4),
        location=part.location,
        message=part.message,
        dropped=part.dropped,
        cpu_fraction=round(number(part.cpu_fraction), 2),
        clock_age=number(part.clock_age_s),
    )


# --- recorder teller --------------------------------------------------------------------------------------------------
# Publishes the statuses of the recorder: at 2 Hz, and at once on a change.


class RecorderTeller:
    """Publishers of one node.

    Args:
        platform: whose node this is.
        collector: whether it also tells of all platforms.
    """

    def __init__(self, platform: str, *, collector: bool) -> None:
        names = {platform: f"{platform}/data_recorder/status"}
        if collector:
            names[""] = "data_recorder/status"
        self._platform = platform
        self._publishers: Dict[str, Any] = {
            who: rospy.Publisher(topic, msg.RecordingStatus, queue_size=10, tcp_nodelay=True)
            for who, topic in names.items()
        }
        self._said: Dict[str, Tuple[Any, ...]] = {}
        self._diagnostics = RecorderDiagnostics(platform)

    def tell(self, stamp_ns: int, own: Status, whole: Optional[Status], disk: DiskSync, *, force: bool) -> None:
        """Publish what is news, or everything; `whole` is the status of all platforms, on the collector."""
        self._tell_one(self._platform, stamp_ns, own, force=force)
        if whole is not None:
            self._tell_one("", stamp_ns, whole, force=force)
        self._diagnostics.publish(stamp_ns, whole if whole is not None else own, disk)

    def _tell_one(self, who: str, stamp_ns: int, status: Status, *, force: bool) -> None:
        news = self._is_news(who, status)
        if force or news:
            self._publishers[who].publish(recording_status(status, stamp_ns))

    def _is_news(self, who: str, status: Status) -> bool:
        parts = tuple((each.platform, each.growing, each.message) for each in status.platforms)
        before, key = self._said.get(who), (status.session_id, status.phase, status.message, parts)
        if before == key:
            return False
        if before is not None and before[1] is not status.phase:
            rospy.loginfo("%s: %s %s", who or "all", status.phase.name, status.message)
        self._said[who] = key
        return True


# --- recorder diagnostics ---------------------------------------------------------------------------------------------
# The recorder on /diagnostics: one status for each platform and one for all, once a second.


_PERIOD_S = 1.0


class RecorderDiagnostics:
    """Publishes them.

    Args:
        platform: whose node this is.
    """

    def __init__(self, platform: str) -> None:
        self._platform, self._due_s = platform, 0.0
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    def publish(self, ros_ns: int, status: Status, disk: DiskSync) -> None:
        """Publish, at most once a second."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + _PERIOD_S
        message = DiagnosticArray(status=self.rows(status, disk))
        message.header.stamp = ros_time(ros_ns)
        self._publisher.publish(message)

    def rows(self, status: Status, disk: DiskSync) -> List[Any]:
        """Return the statuses."""
        failed = status.phase is RecordingPhase.FAILED
        whole = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if failed else DiagnosticStatus.OK,
            name=f"data recorder ({self._platform})",
            message=f"{status.phase.name} {status.message}".strip(),
            values=[KeyValue("session", status.session_id), KeyValue("location", status.location)],
        )
        whole.values.append(KeyValue("disk", disk.problem or disk.cost))
        if disk.problem:
            whole.level, whole.message = DiagnosticStatus.ERROR, disk.problem
        return [whole, *(_row(part, writing=status.phase in WRITING) for part in status.platforms)]


def _row(part: PlatformStatus, *, writing: bool) -> Any:
    level = DiagnosticStatus.WARN if part.message or (writing and not part.growing) else DiagnosticStatus.OK
    free = "" if part.free_fraction is None else f"{part.free_fraction:.3f}"
    busy = "" if part.cpu_fraction is None else f"{part.cpu_fraction:.2f}"
    return DiagnosticStatus(
        level=level,
        name=f"recording on {part.platform}",
        message=part.message or ("records" if part.growing else "does not record"),
        values=[
            KeyValue("bytes", str(part.written_bytes)),
            KeyValue("bytes per second", f"{part.byte_rate:.0f}"),
            KeyValue("free fraction", free),
            KeyValue("CPU load", busy),
            KeyValue("messages dropped, at least", str(part.dropped)),
        ],
    )
