"""What the machines of the recorder see, ask and say: plain values, the border to the node that carries them out.

A status has the values of msg/RecordingStatus.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from amaze_autonomy.engine.events import RecordingPhase

# --- what a recorder says ---------------------------------------------------------------------------------------------


WRITING = (RecordingPhase.STARTING, RecordingPhase.RECORDING)
STOPPED = "it was stopped and started again"  # causes of gaps
UNWANTED = "it is not in the configuration any more"


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


# --- what recorders are told ------------------------------------------------------------------------------------------
# Each computer has a copy of the configuration, and records by its own. The list of a part says what its recorders were
# told (`configured`, of each group); the collector compares that with what its own copy says of that platform.


Configured = Mapping[str, Any]  # topics, match and exclude of a group, as JSON holds them
_ALL = ".*"


def configured(topics: Sequence[str], match: Sequence[str] = (), exclude: str = "") -> Configured:
    """Return what the recorder of a group is told; its topics are resolved. It excludes from what it matches alone."""
    return {"topics": list(topics), "match": list(match), "exclude": exclude if match else ""}


def common(one: Configured, other: Configured) -> Configured:
    """Return what both record: so much was recorded all the time where the second one came after the first."""
    topics, match = ([each for each in one[key] if each in other[key]] for key in ("topics", "match"))
    excluded = sorted({one["exclude"], other["exclude"]} - {""})
    return configured(topics, match, "|".join(excluded))


def lacking(content: Mapping[str, Any], wanted: Mapping[str, Configured]) -> Tuple[List[str], List[str]]:
    """Return the topics and the expressions that were wanted of a part and that its recorders were not told.

    What two expressions have in common nobody can tell: they are compared as they are written. A list that does not say
    what its recorders were told, as an own recorder's that names files alone, tells nothing.

    Args:
        content: the list of the part.
        wanted: the groups of its platform in the collector's configuration.
    """
    there = _groups(content)
    if there is None:
        return [], []
    topics = [topic for each in wanted.values() for topic in each["topics"]]
    expressions = [
        f"{pattern} (without {each['exclude']})" if each["exclude"] else str(pattern)
        for each in wanted.values()
        for pattern in each["match"]
        if not any(_matches_as_much(group, pattern, each["exclude"]) for group in there)
    ]
    return [topic for topic in topics if not any(_records(group, topic) for group in there)], expressions


def lacking_words(topics: Sequence[str], expressions: Sequence[str] = ()) -> List[str]:
    """Return what is said of what recorders were not told, one line each."""
    *others, last = topics or ("",)
    named = f"{', '.join(others)} and {last} are" if others else f"{last} is"
    matched = [f"topics that match {each} are not in its configuration" for each in expressions]
    return [*([f"{named} not in its configuration"] if topics else []), *matched]


def _groups(content: Mapping[str, Any]) -> Optional[List[Configured]]:
    """Return the groups that the list of a part has; None: it has none, or what cannot be one."""
    with suppress(KeyError, TypeError, AttributeError):
        return [
            configured([*map(str, each["topics"])], [*map(str, each["match"])], str(each["exclude"]))
            for each in content["configured"].values()
        ]
    return None


def _records(group: Configured, topic: str) -> bool:
    """Return whether a group records a topic; rosbag looks at what is excluded first."""
    if _matches(group["exclude"], topic):
        return False
    return topic in group["topics"] or any(_matches(pattern, topic) for pattern in group["match"])


def _matches(pattern: str, topic: str) -> bool:
    with suppress(re.error):
        return re.fullmatch(pattern, topic) is not None
    return False


def _matches_as_much(group: Configured, pattern: str, exclude: str) -> bool:
    return group["exclude"] in ("", exclude) and bool({pattern, _ALL} & set(group["match"]))
