"""Publishes the statuses of the recorder: at 2 Hz, and at once on a change."""

from __future__ import annotations

from typing import Any, Dict, Optional, Tuple

import rospy

from amaze_autonomy import msg
from amaze_autonomy.recording import Status

from .recorder_diagnostics import RecorderDiagnostics
from .recorder_messages import recording_status

__all__ = ["RecorderTeller"]


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

    def tell(self, stamp_ns: int, own: Status, whole: Optional[Status], *, force: bool) -> None:
        """Publish what is news, or everything; `whole` is the status of all platforms, on the collector."""
        self._tell_one(self._platform, stamp_ns, own, force=force)
        if whole is not None:
            self._tell_one("", stamp_ns, whole, force=force)
        self._diagnostics.publish(stamp_ns, whole if whole is not None else own)

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
