"""What a recorder says of itself; the values of msg/RecordingStatus."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

from amaze_autonomy.engine.events import RecordingPhase

__all__ = ["WRITING", "PlatformStatus", "Status"]

WRITING = (RecordingPhase.STARTING, RecordingPhase.RECORDING)


@dataclass(frozen=True)
class PlatformStatus:
    """The recording on one platform.

    Args:
        platform: its name.
        growing: its files grow, and all that it shall record is subscribed.
        written_bytes: all files of the session.
        byte_rate: over the last seconds, per second.
        free_fraction: of its storage; None: unknown.
        location: folder of its part, as the platform names it.
        message: what is wrong; may be empty.
        dropped: at least so many messages were dropped: its recorders warned so often.
    """

    platform: str
    growing: bool = False
    written_bytes: int = 0
    byte_rate: float = 0.0
    free_fraction: Optional[float] = None
    location: str = ""
    message: str = ""
    dropped: int = 0


@dataclass(frozen=True)
class Status:
    """The status of a platform's recorder, or of the collector.

    Args:
        session_id: empty when IDLE.
        phase: IDLE ... FAILED.
        progress: of the phase, 0..1; None: unknown.
        remaining_s: of the phase; None: unknown.
        platforms: one, or all.
        location: of the complete recording at COMPLETE, of the parts at FAILED.
        message: what is missing, or what was collected.
    """

    session_id: str = ""
    phase: RecordingPhase = RecordingPhase.IDLE
    progress: Optional[float] = None
    remaining_s: Optional[float] = None
    platforms: Tuple[PlatformStatus, ...] = ()
    location: str = ""
    message: str = ""

    @property
    def dropped(self) -> int:
        """Return how many messages of all platforms were dropped, at least."""
        return sum(each.dropped for each in self.platforms)
