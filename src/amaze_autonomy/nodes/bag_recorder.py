"""Really records what the simulated recorder says it records: one `rosbag record` for the topics of all platforms."""

from __future__ import annotations

import ctypes
import os
import signal
import struct
import subprocess
import time
from pathlib import Path
from typing import List, Optional, Sequence

from amaze_autonomy.engine.events import PlatformRecording, RecordingPhase, RecordingStatus
from amaze_autonomy.engine.state import evolve

__all__ = ["BagRecorder", "is_whole"]

_GROWTH_LIMIT_S = 3.0
_WRITING = (RecordingPhase.STARTING, RecordingPhase.RECORDING)
_PR_SET_PDEATHSIG = 1


def is_whole(bag: Path) -> bool:
    """Tell whether a bag was closed: its header names the place of its index (http://wiki.ros.org/Bags/Format/2.0)."""
    with bag.open("rb") as file:
        head = file.read(4096)
    place = head.find(b"index_pos=")
    return place >= 0 and struct.unpack_from("<Q", head, place + len(b"index_pos="))[0] > 0


def _end_with_parent() -> None:
    """Have the kernel send SIGINT to the child when the thread that started it is gone."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)


class BagRecorder:
    """One recording after the other. Used by one thread, which must live as long as the recording.

    Args:
        folder: a folder per session is made in it.
        topics: resolved names.
        options: for `rosbag record`.
    """

    def __init__(self, folder: Path, topics: Sequence[str], options: Sequence[str] = ()) -> None:
        self._folder, self._topics, self._options = folder, list(topics), list(options)
        self._child: Optional[subprocess.Popen[bytes]] = None
        self._bag = Path()
        self._session = ""
        self._bytes, self._grew_s, self._started_s = 0, 0.0, 0.0

    def start(self, session: str) -> str:
        """Start to record a session; return why that is not possible, or an empty text."""
        if self._child is not None and self._child.poll() is None:
            return "" if session == self._session else f"still recording {self._session}"
        self._session = session
        self._bag = self._folder / session / f"{session}.bag"
        try:
            self._bag.parent.mkdir(parents=True, exist_ok=True)
            command: List[str] = ["rosbag", "record", "--quiet", *self._options, "-O", str(self._bag), *self._topics]
            self._child = subprocess.Popen(
                command,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
                preexec_fn=_end_with_parent,  # noqa: PLW1509
            )
        except OSError as error:
            return f"rosbag record cannot be started: {error}"
        self._bytes, self._started_s = 0, time.monotonic()
        self._grew_s = 0.0
        return ""

    def stop(self) -> None:
        """Ask rosbag to close the bag; it does so while others go on."""
        if self._child is not None and self._child.poll() is None:
            os.killpg(self._child.pid, signal.SIGINT)

    def wait(self, limit_s: float) -> None:
        """Wait until the bag is closed."""
        if self._child is None:
            return
        try:
            self._child.wait(limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(self._child.pid, signal.SIGKILL)

    def _active(self) -> Path:
        return self._bag.with_name(self._bag.name + ".active")

    def _measure(self) -> None:
        """See how much is on the disk."""
        for path in (self._active(), self._bag):
            if path.is_file():
                size = path.stat().st_size
                if size > self._bytes:
                    self._bytes, self._grew_s = size, time.monotonic()

    def truth(self, status: RecordingStatus) -> RecordingStatus:
        """Return a status of the simulated recorder with what is really on the disk."""
        if not self._session or status.session_id != self._session:
            return status
        self._measure()
        if status.phase in _WRITING and self._child is not None and self._child.poll() is not None:
            return self._with(status, RecordingPhase.FAILED, f"rosbag record has ended by itself: {self._child.poll()}")
        if status.phase is RecordingPhase.COMPLETE:
            if self._child is not None and self._child.poll() is None:
                return self._with(status, RecordingPhase.VERIFYING, "")
            if not self._bag.is_file() or not is_whole(self._bag):
                return self._with(status, RecordingPhase.FAILED, f"{self._bag} was not closed")
        return self._with(status, status.phase, status.message)

    def _with(self, status: RecordingStatus, phase: RecordingPhase, message: str) -> RecordingStatus:
        growing = status.phase in _WRITING and time.monotonic() - self._grew_s < _GROWTH_LIMIT_S
        rate = self._bytes / max(0.1, time.monotonic() - self._started_s)
        platforms = tuple(
            PlatformRecording(
                platform=each.platform,
                growing=growing and each.growing,
                written_bytes=self._bytes,
                byte_rate=rate if growing else 0.0,
                free_fraction=each.free_fraction,
                location=str(self._bag),
                message=each.message,
            )
            for each in status.platforms
        )
        location = status.location
        if phase in (RecordingPhase.COMPLETE, RecordingPhase.FAILED):
            location = str(self._bag)
        changed: RecordingStatus = evolve(status, phase=phase, platforms=platforms, message=message, location=location)
        return changed
