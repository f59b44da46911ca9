"""The recorder without ROS: what each platform does, what the collector does, and the jobs that make one bag of it.

`PlatformRecorder` and `Collector` decide: times and sights in, commands and statuses out, no clock, file or thread. The
node (`nodes/recorder/node.py`) carries their commands out; `job.py` is the process that recovers, merges and
verifies, so that the node answers at once whatever the size of the bags.
"""

from __future__ import annotations

from .collector import Collector, CollectorSetup
from .errors import RecordingError
from .platform_recorder import GroupSetup, PlatformRecorder, PlatformSetup
from .status import Answer, Command, GroupStatus, PlatformStatus, ProcessStatus, Status

__all__ = [
    "Answer",
    "Collector",
    "CollectorSetup",
    "Command",
    "GroupSetup",
    "GroupStatus",
    "PlatformRecorder",
    "PlatformSetup",
    "PlatformStatus",
    "ProcessStatus",
    "RecordingError",
    "Status",
]
