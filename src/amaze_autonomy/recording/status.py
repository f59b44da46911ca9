"""What the machines of the recorder see, ask and say: plain values, the border to the node that carries them out.

A status has the values of msg/RecordingStatus.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Mapping, NamedTuple, Optional, Tuple, Union

from amaze_autonomy.engine.events import RecordingPhase

# --- what a recorder says ---------------------------------------------------------------------------------------------


WRITING = (RecordingPhase.STARTING, RecordingPhase.RECORDING)
STOPPED = "it was stopped and started again"  # the cause of a gap


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
        cpu_fraction: how busy its processor is, all cores together; None: unknown.
        clock_age_s: how old its last status was by its own stamp when it came; None: unknown, or of this computer.
    """

    platform: str
    growing: bool = False
    written_bytes: int = 0
    byte_rate: float = 0.0
    free_fraction: Optional[float] = None
    location: str = ""
    message: str = ""
    dropped: int = 0
    cpu_fraction: Optional[float] = None
    clock_age_s: Optional[float] = None


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
        lost: what of the flight was not recorded, at COMPLETE; empty: all of it was.
    """

    session_id: str = ""
    phase: RecordingPhase = RecordingPhase.IDLE
    progress: Optional[float] = None
    remaining_s: Optional[float] = None
    platforms: Tuple[PlatformStatus, ...] = ()
    location: str = ""
    message: str = ""
    lost: str = ""

    @property
    def dropped(self) -> int:
        """Return how many messages of all platforms were dropped, at least."""
        return sum(each.dropped for each in self.platforms)


# --- what its shell sees ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Space:
    """The storage: bytes that are free, and as a fraction of all."""

    free_bytes: int
    free_fraction: float


@dataclass(frozen=True)
class GroupStatus:
    """One group as it is now.

    Args:
        running: a process of it is there.
        ending: how its last process ended, in words; empty while it runs.
        size: bytes of all its files.
        idle_ns: since something was written to one of them; None: unknown.
        missing: topics that it is not subscribed to; None: the master does not say.
        silent: nobody publishes any of its topics.
        dropped: warnings in its log that messages were dropped.
        full: its log says that it stopped because the storage is full.
        removed: the file that it writes is not there any more: somebody removed it.
        halted: its process is there, and somebody stopped it.
        number: the highest one of its files in the session's folder, whoever wrote it; 0: there is none.
    """

    running: bool
    ending: str = ""
    size: int = 0
    idle_ns: Optional[int] = None
    missing: Optional[Tuple[str, ...]] = None
    silent: bool = False
    dropped: int = 0
    full: bool = False
    removed: bool = False
    halted: bool = False
    number: int = 0


@dataclass(frozen=True)
class ProcessStatus:
    """Everything as it is now.

    Args:
        groups: by name.
        space: None when the storage cannot be looked at.
        stamp_ns: what a message that is recorded now is stamped with; None: unknown.
        cpu_fraction: how busy this computer is; None: unknown.
    """

    groups: Mapping[str, GroupStatus] = field(default_factory=dict)
    space: Optional[Space] = None
    stamp_ns: Optional[int] = None
    cpu_fraction: Optional[float] = None


# --- what is asked of its shell ---------------------------------------------------------------------------------------


class Answer(NamedTuple):
    """The answer to a request: it was understood, or why not. That it is done is told by the status."""

    accepted: bool
    message: str = ""


@dataclass(frozen=True)
class StartChild:
    """Start a recorder for a group into the file with this number."""

    group: str
    number: int


@dataclass(frozen=True)
class Signal:
    """Send a signal to the recorder of a group: INT, TERM or KILL."""

    group: str
    name: str


@dataclass(frozen=True)
class Recover:
    """Make whole what was not closed, and list the parts of the session."""


@dataclass(frozen=True)
class Ask:
    """Ask a platform's recorder to `start`, `stop` or `remove` its part; of another session than the collector's."""

    platform: str
    verb: str
    session_id: str = ""


@dataclass(frozen=True)
class MeasureClock:
    """Measure the offset of a platform's clock.

    Args:
        platform: its name.
        when: `start` or `stop` of the recording; `start-2` and so on where it went on after its end.
    """

    platform: str
    when: str


@dataclass(frozen=True)
class Transfer:
    """Fetch a platform's part from where it says that it lies; what comes of it is told with this number."""

    platform: str
    location: str
    number: int


@dataclass(frozen=True)
class StopTransfer:
    """End the fetch of a platform's part, which nobody waits for any more."""

    platform: str


@dataclass(frozen=True)
class Collect:
    """Merge and verify all parts, in a process of its own."""


@dataclass(frozen=True)
class CopyJournal:
    """Copy the engine's journal and configuration into the session."""


Command = Union[StartChild, Signal, Recover, Ask, MeasureClock, Transfer, StopTransfer, Collect, CopyJournal]
