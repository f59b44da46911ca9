"""Statuses of the recorder -> messages. None becomes NaN."""

from __future__ import annotations

from typing import Any

from amaze_autonomy import msg
from amaze_autonomy.recording.status import PlatformStatus, Status

from .interface import number, ros_time

__all__ = ["recording_status", "ros_time"]


def recording_status(status: Status, ros_ns: int) -> Any:
    """Write a RecordingStatus."""
    message = msg.RecordingStatus(
        session_id=status.session_id,
        phase=status.phase.value,
        progress=number(status.progress),
        platforms=[_platform(each) for each in status.platforms],
        location=status.location,
        message=status.message,
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
        byte_rate=part.byte_rate,
        free_fraction=number(part.free_fraction),
        location=part.location,
        message=part.message,
        dropped=part.dropped,
    )
