"""Journals from where they lie: a file, or the topic `~journal` of a bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Tuple

from amaze_autonomy.bags import BagError, Recording
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import EngineStarted, Event, MissionRejected, MissionSelected, Shutdown, UserRequest
from amaze_autonomy.engine.state import evolve

from ..journal.journal import Journal, JournalError, decode, read
from .errors import JournalGapError, ReplayError

__all__ = ["JOURNAL_KIND", "FlightLog", "lines_of_bag", "read_journals", "read_log"]


JOURNAL_KIND = "amaze_autonomy/JournalEntry"
_BAG_MAGIC = b"#ROSBAG"


def read_journals(path: Path, topic: str = "") -> Tuple[Journal, ...]:
    """Return the journals of a file or a bag; a bag has several when the engine was started anew without resuming.

    Args:
        path: of a journal or a bag.
        topic: of the journal in a bag; empty: the only one there is.

    Raises:
        BagError: The bag cannot be read.
        JournalError: A line is damaged.
        ReplayError: There is no journal, or lines of it are missing.
    """
    try:
        with path.open("rb") as file:
            is_bag = file.read(len(_BAG_MAGIC)) == _BAG_MAGIC
    except OSError as error:
        raise ReplayError(f"{path}: cannot be read ({error.strerror}); name a journal or a bag") from error
    if is_bag:
        return _journals_of_bag(path, topic)
    try:
        return (read(path.read_bytes().decode("ascii")),)
    except UnicodeDecodeError as error:
        raise JournalError("no journal: it is not ASCII text", remedy="name a journal or a bag") from error


def _journals_of_bag(path: Path, topic: str) -> Tuple[Journal, ...]:
    with Recording(path) as recording:
        entries = lines_of_bag(recording, topic or _journal_topic(recording))
    runs: List[Dict[int, str]] = []
    for _, sequence, line in entries:
        if not runs or (sequence == 0 and runs[-1].get(0, line) != line):
            runs.append({})  # a new journal; the same line again is a message that was recorded twice
        if runs[-1].setdefault(sequence, line) != line:
            raise JournalGapError(f"{path}: line {sequence + 1} of the journal is there twice, with two contents")
    if not runs:
        raise JournalGapError(f"{path}: the journal's topic has no messages; take the journal from disk")
    return tuple(read("".join(f"{line}\n" for line in _whole(path, run))) for run in runs)


def _whole(path: Path, run: Dict[int, str]) -> List[str]:
    """Return the lines of a journal in their order; none may be missing."""
    for number, sequence in enumerate(sorted(run)):
        if number != sequence:
            raise _gap(path, number, sequence)
    return [run[sequence] for sequence in sorted(run)]


def lines_of_bag(recording: Recording, topic: str) -> List[Tuple[int, int, str]]:
    """Return time of recording, sequence and text of each line, in the order in which they were recorded.

    Raises:
        MessageError: A message is damaged.
    """
    read = ((entry.t_ns, recording.message(entry)) for entry in recording.entries(topic))
    return [(t_ns, int(message.sequence), str(message.line)) for t_ns, message in read]


def _gap(path: Path, first: int, found: int) -> JournalGapError:
    lines = f"line {first + 1} is" if found - first == 1 else f"lines {first + 1} to {found} are"
    words = "the recording began after the journal" if first == 0 else "messages were lost"
    return JournalGapError(f"{path}: {lines} missing in the journal, {words}; take the journal from disk")


def _journal_topic(recording: Recording) -> str:
    topics = [topic.name for topic in recording.topics if topic.kind == JOURNAL_KIND]
    if len(topics) == 1:
        return topics[0]
    if topics:
        raise ReplayError(f"{recording.path}: several journals ({', '.join(topics)}); name one with --topic")
    raise BagError(
        str(recording.path), f"has no topic of type {JOURNAL_KIND}", "name a bag with a journal, or a journal"
    )


# --- log --------------------------------------------------------------------------------------------------------------
# What people asked of the engine in the recorded flight, out of the journal in its bag: what no sensor can tell.
#
# The journal's times are those of the clock that decided; the bag's are those of its recorder. A line reaches the
# recorder a little after its event, and the lines from before the recording much later, so that the shortest of all
# ways is the difference of the two clocks.


_ASKED = (MissionSelected, MissionRejected, UserRequest, Shutdown)


@dataclass(frozen=True)
class FlightLog:
    """What was asked.

    Args:
        label: of the recorded engine's sessions.
        events: in the bag's time, in order.
        decisions: that were made in flight, in the bag's time, in order.
        end_ns: time of the last event, whatever it is, in the bag's time.
    """

    label: str
    events: Tuple[Event, ...]
    decisions: Tuple[Decision, ...] = ()
    end_ns: int = 0


def read_log(recordings: Tuple[Recording, ...], topic: str) -> Optional[FlightLog]:
    """Return what was asked in a flight; None when the journal is not in its bags.

    Raises:
        JournalError: A line is damaged.
        MessageError: A message is damaged.
    """
    label = ""
    found: Dict[int, Event] = {}
    decided: Dict[int, Decision] = {}
    ways: List[int] = []
    last_ns = 0
    for recording in recordings:
        for t_ns, sequence, line in lines_of_bag(recording, topic):
            event = decode(line, sequence + 1).payload
            if isinstance(event, Decision):
                decided[sequence] = event
            if not isinstance(event, Event):
                continue
            ways.append(t_ns - event.t_ns)
            last_ns = max(last_ns, event.t_ns)
            if isinstance(event, EngineStarted) and not label:
                label = event.label
            elif isinstance(event, _ASKED):
                found[sequence] = event
    if not ways:
        return None
    offset_ns = min(ways)
    asked = tuple(evolve(found[key], t_ns=max(0, found[key].t_ns + offset_ns)) for key in sorted(found))
    made = tuple(evolve(decided[key], t_ns=max(0, decided[key].t_ns + offset_ns)) for key in sorted(decided))
    return FlightLog(label, asked, made, last_ns + offset_ns)
