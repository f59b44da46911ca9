"""What a recorder node must know again after it was killed: one file, the old one or the new one, never half."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any, Dict, Optional, Tuple

import rospy

from amaze_autonomy.recording import RecordingError
from amaze_autonomy.recording.storage import read_json, write_json

from .output import boot_id

__all__ = ["RecorderMemory"]

_SAY_AGAIN_S = 10.0


class RecorderMemory:
    """The file.

    Args:
        path: of it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._kept: Dict[str, Any] = {}

    def keep(self, content: Dict[str, Any]) -> None:
        """Write it when it is not what was written last; a storage that does not take it is said, and tried again."""
        if content == self._kept:
            return
        try:
            write_json(self.path, {"boot_id": boot_id(), **content})
        except RecordingError as error:
            rospy.logerr_throttle(_SAY_AGAIN_S, str(error))
        else:
            self._kept = content

    def read(self) -> Tuple[Optional[Dict[str, Any]], bool]:
        """Return what is there (None: nothing), and whether the system was not started anew since."""
        content = read_json(self.path)
        return content, content is not None and content.get("boot_id") == boot_id()

    def put_aside(self) -> None:
        """Give the file another name."""
        with suppress(OSError):
            self.path.replace(self.path.with_name(f"{self.path.name}.bad"))
