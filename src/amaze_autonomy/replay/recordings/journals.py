"""Journals from where they lie: a file, or the topic `~journal` of a bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple, TypeVar

from amaze_autonomy.bags import BagError, Recording
from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import EngineStarted, Event, MissionRejected, MissionSelected, Shutdown, UserRequest
from amaze_autonomy.engine.state import State, evolve

from ...journal.journal import DeltaDecoder, Journal, JournalError, decode, read
from ..errors import JournalGapError, ReplayError

T = TypeVar("T", Event, Decision)

JOURNAL_KIND = "amaze_autonomy/JournalEntry"
_BAG_MAGIC = b"#ROSBAG"


def read_journals(path: Path, topic: str = "", memory: int = MEMORY) -> Tuple[Journal, ...]:
    """Return the journals of a file or a bag; a bag has several when the engine was started anew without resuming.

    Args:
        path: of a journal or a bag.
        topic: of the journal in a bag; empty: the only one there is.
        memory: bytes that a chunk of a bag may take, decompressed.

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
    try:
        return _journals_of_bag(path, topic, memory) if is_bag else (read(path.read_bytes().decode("ascii")),)
    except UnicodeDecodeError as error:
        words, right = "no journal: it is not ASCII text", "name a journal or a bag"
        raise JournalError(words, remedy=right, file=str(path)) from error
    except JournalError as error:
        raise JournalError(error.what, error.line_number, error.remedy, str(path)) from error


def _journals_of_bag(path: Path, topic: str, memory: int) -> Tuple[Journal, ...]:
    with Recording(path, memory) as recording:
        runs = _runs((recording,), topic or _journal_topic(recording))
    if not runs:
        raise JournalGapError(f"{path}: the journal's topic has no messages; take the journal from disk")
    return tuple(read("".join(f"{line}\n" for line in _whole(path, run))) for run in runs)


def _runs(recordings: Sequence[Recording], topic: str, *, strict: bool = True) -> List[Dict[int, Tuple[int, str]]]:
    """Return for each journal its lines by their numbers, each with the time at which it was recorded first.

    Raises:
        JournalGapError: A line is there twice, with two contents; unless it is not `strict`.
        MessageError: A message is damaged.
    """
    runs: List[Dict[int, Tuple[int, str]]] = []
    for recording, entry in ((each, entry) for each in recordings for entry in each.entries(topic)):
        message = recording.message(entry)
        number, line = int(message.sequence), str(message.line)
        if not runs or (number == 0 and runs[-1].get(0, (0, line))[1] != line):
            runs.append({})  # a new journal; the same line again is a message that was recorded twice
        t_ns, known = runs[-1].get(number, (entry.t_ns, line))
        if strict and known != line:
            raise JournalGapError(
                f"{recording.path}: line {number + 1} of the journal is there twice, with two contents"
            )
        runs[-1][number] = min(t_ns, entry.t_ns), known
    return runs


def _whole(path: Path, run: Dict[int, Tuple[int, str]]) -> List[str]:
    """Return the lines of a journal in their order; none may be missing."""
    for number, sequence in enumerate(sorted(run)):
        if number != sequence:
            raise _gap(path, number, sequence)
    return [run[sequence][1] for sequence in sorted(run)]


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
        offset_ns: what was added to the journal's times.
        configuration_hash: of what was flown by; empty: its header is not in the bags.
    """

    label: str
    events: Tuple[Event, ...]
    decisions: Tuple[Decision, ...] = ()
    end_ns: int = 0
    offset_ns: int = 0
    configuration_hash: str = ""


def read_log(recordings: Tuple[Recording, ...], topic: str) -> Optional[FlightLog]:
    """Return what was asked in a flight; None when the journal is not in its bags.

    Raises:
        JournalError: A line is damaged.
        MessageError: A message is damaged.
    """
    label = flown_by = ""
    asked: List[Event] = []
    made: List[Decision] = []
    ways: List[int] = []
    last_ns = 0
    for run in _runs(recordings, topic, strict=False):
        decoder = DeltaDecoder()
        for number, (t_ns, text) in sorted(run.items()):
            try:
                line = decoder.full(text)
            except JournalError:  # behind lines that were not recorded: a status, which is recorded itself
                continue
            event = decode(line, number + 1).payload
            if isinstance(event, Decision):
                made.append(event)
            if not isinstance(event, Event):
                flown_by = flown_by or (str(event.get("hash", "")) if isinstance(event, dict) else "")
                continue
            ways.append(t_ns - event.t_ns)
            last_ns = max(last_ns, event.t_ns)
            if isinstance(event, EngineStarted) and not label:
                label = event.label
            elif isinstance(event, _ASKED):
                asked.append(event)
    if not ways:
        return None
    offset_ns = min(ways)
    events, decisions = _moved(asked, offset_ns), _moved(made, offset_ns)
    return FlightLog(label, events, decisions, last_ns + offset_ns, offset_ns, flown_by)


def selection_of(log: FlightLog, begin_ns: int) -> Optional[int]:
    """Return when the mission was selected that takes off first from a time on; None: the log does not tell.

    That is before the time where nothing has taken off since the selection.
    """
    selected = [event.t_ns for event in log.events if isinstance(event, MissionSelected)]
    before = [t_ns for t_ns in selected if t_ns < begin_ns]
    if before:
        since = (each for each in log.decisions if before[-1] <= each.t_ns < begin_ns)
        if not any(each.after == State.TAKEOFF.value for each in since):
            return before[-1]
    return next((t_ns for t_ns in selected if t_ns >= begin_ns), None)


def _moved(found: Sequence[T], offset_ns: int) -> Tuple[T, ...]:
    return tuple(evolve(each, t_ns=max(0, each.t_ns + offset_ns)) for each in found)
