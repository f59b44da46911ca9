"""Journals from where they lie: a file, or the topic `~journal` of a bag."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Dict, List, Optional, Sequence, Tuple, TypeVar

from amaze_autonomy.bags import BagError, Recording
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.bags.format import MEMORY, foreign
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import EngineStarted, Event, MissionRejected, MissionSelected, Shutdown, UserRequest
from amaze_autonomy.engine.state import State, evolve

from ...engine.events import Mission
from ...journal.journal import DeltaDecoder, Journal, JournalError, Payload, decode, read
from ..errors import JournalGapError, ReplayError

T = TypeVar("T", Event, Decision)

JOURNAL_KIND = "amaze_autonomy/JournalEntry"
_BAG_MAGIC = b"#ROSBAG"
_BEGIN_BYTES = 32


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
            begin = file.read(_BEGIN_BYTES)
    except OSError as error:
        raise ReplayError(f"{path}: cannot be read ({error.strerror}); name a journal or a bag") from error
    is_bag, other = begin.startswith(_BAG_MAGIC), foreign(begin)
    if other:
        what, _, remedy = other.partition("; ")
        remedy = "name a journal or a bag; `amaze-replay run` replays it" if "amaze-replay" in remedy else remedy
        raise ReplayError(f"{path}: is no journal but {what}; {remedy}")
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
        JournalGapError: A line is there twice, with two contents, or a message is damaged; unless it is not `strict`.
    """
    runs: List[Dict[int, Tuple[int, str]]] = []
    for recording, entry in ((each, entry) for each in recordings for entry in each.entries(topic)):
        try:
            message = recording.message(entry)
        except MessageError as error:
            if not strict:  # whoever replays the topic notes it, and its lines are missing
                continue
            words = f"{recording.path}: a message of {topic} cannot be read ({error}); take the journal from disk"
            raise JournalGapError(words) from error
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
    words = "the recording began after the journal" if first == 0 else "messages were lost"
    return JournalGapError(
        f"{path}: {_lines(first, found)} missing in the journal, {words}; take the journal from disk"
    )


def _lines(first: int, found: int) -> str:
    return f"line {first + 1} is" if found - first == 1 else f"lines {first + 1} to {found} are"


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
class Lost:
    """Lines of the journal that nobody can read.

    Args:
        words: which, and why.
        from_ns: they were recorded after that, in the bag's time.
        to_ns: and before that.
        before_all: before the first line that was recorded, of a part of a recording, say.
    """

    words: str
    from_ns: int
    to_ns: int
    before_all: bool = False


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
        lost: what of the journal is missing or cannot be read.
        known_decisions: how many of the decisions were made before the first lost line; None: no line is lost.
        known_ns: time of the last event before that, in the bag's time.
    """

    label: str
    events: Tuple[Event, ...]
    decisions: Tuple[Decision, ...] = ()
    end_ns: int = 0
    offset_ns: int = 0
    configuration_hash: str = ""
    lost: Tuple[Lost, ...] = ()
    known_decisions: Optional[int] = None
    known_ns: int = 0

    @property
    def leads(self) -> bool:
        """Whether it tells what was asked: where its lines are lost, no flight is led without its selection."""
        return not self.lost or bool(self.missions)

    @property
    def missions(self) -> Tuple[Mission, ...]:
        """The missions that were selected, in order."""
        events = (event for event in self.events if isinstance(event, MissionSelected))
        return tuple(mission for event in events for mission in event.missions)


def read_log(recordings: Tuple[Recording, ...], topic: str) -> Optional[FlightLog]:
    """Return what was asked in a flight; None when the journal is not in its bags."""
    reading = _Reading()
    for run in _runs(recordings, topic, strict=False):
        reading.take(run)
    return reading.log()


@dataclass
class _Reading:
    """A log in the making; times of events are the journal's."""

    label: str = ""
    flown_by: str = ""
    asked: List[Event] = field(default_factory=list)
    made: List[Decision] = field(default_factory=list)
    ways: List[int] = field(default_factory=list)
    last_ns: int = 0
    lost: List[Lost] = field(default_factory=list)
    known: Optional[Tuple[int, int]] = None  # decisions before the first lost line, and the time of the last event

    def take(self, run: Dict[int, Tuple[int, str]]) -> None:
        """Take the lines of one journal; those that are missing or cannot be read are noted."""
        decoder, due = DeltaDecoder(), 0
        before_ns = min(t_ns for t_ns, _ in run.values())
        unread: List[Tuple[int, JournalError]] = []
        for number, (t_ns, text) in sorted(run.items()):
            if number > due:
                self._lose(Lost(f"{_lines(due, number)} missing", before_ns, t_ns, before_all=due == 0))
            due, before_ns = number + 1, t_ns
            try:
                line = decoder.full(text, number + 1)
            except JournalError as error:
                if not (self.lost or unread):  # else it is behind a lost line: a status, which is recorded itself
                    unread.append((t_ns, error))
                    self._know()
                continue
            try:
                self._hear(t_ns, decode(line, number + 1).payload)
            except JournalError as error:
                unread.append((t_ns, error))
                self._know()
        if unread:
            count = "a line" if len(unread) == 1 else f"{len(unread)} lines"
            self._lose(Lost(f"{count} cannot be read: {unread[0][1]}", unread[0][0], unread[-1][0]))

    def log(self) -> Optional[FlightLog]:
        """Return what was found; None: no event."""
        if not self.ways:
            return None
        offset_ns, lost = min(self.ways), tuple(self.lost)
        events, decisions = _moved(self.asked, offset_ns), _moved(self.made, offset_ns)
        log = FlightLog(self.label, events, decisions, self.last_ns + offset_ns, offset_ns, self.flown_by, lost)
        if self.known is None:
            return log
        return replace(log, known_decisions=self.known[0], known_ns=self.known[1] + offset_ns)

    def _hear(self, t_ns: int, payload: Payload) -> None:
        if isinstance(payload, Decision):
            self.made.append(payload)
        elif isinstance(payload, Event):
            self.ways.append(t_ns - payload.t_ns)
            self.last_ns = max(self.last_ns, payload.t_ns)
            if isinstance(payload, EngineStarted) and not self.label:
                self.label = payload.label
            elif isinstance(payload, _ASKED):
                self.asked.append(payload)
        else:
            self.flown_by = self.flown_by or str(payload.get("hash", ""))

    def _lose(self, lost: Lost) -> None:
        self.lost.append(lost)
        self._know()

    def _know(self) -> None:
        """Note that the decisions up to here are known all, and those from here on perhaps not."""
        self.known = self.known or (len(self.made), self.last_ns)


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
