"""The messages of all bags in one total order that is ours.

The order is (time, rank of the topic in the map, bag, publisher, position in the file). Bags rank by their beginning
and then by name, not by their place on the command line. Nothing in it depends on the library, on the numbers of the
connections, on the compression or on the order of a hash table.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, Collection, Dict, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np

from amaze_autonomy.bags import BagError, Entry, Recording
from amaze_autonomy.bags.arrays import SetBack
from amaze_autonomy.bags.errors import MessageError, NotABagError
from amaze_autonomy.bags.format import MEMORY, is_log
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.other_formats import is_other, other_recording
from amaze_autonomy.bags.recording import Numbers
from amaze_autonomy.engine.events import Event
from amaze_autonomy.monitoring.condition import FOREVER_NS

from ..errors import NoMessagesError, ReplayError, TimeJumpError, UnknownTopicError
from .fields import Track
from .journals import FlightLog, read_log
from .statuses import sent_by, status_rows, taped_statuses

_S = 1_000_000_000
_NO_MESSAGE = "there is no message in it"
_HANDFUL = 5  # of messages at equal times in two recordings may be chance, or where one was cut off the other
_APART_NS = _S  # of the times of one message in two recordings: what `amaze-bag merge` takes for the same
JUMP_NS = 3600 * _S  # no recording has nothing for so long: a clock was set
_Rows = Sequence[Optional[Tuple[Any, ...]]]
_Columns = Sequence[Any]


class Sample(NamedTuple):
    """One message in the total order.

    `rank` is that of its topic, `bag` that of its bag, `row` its number among those of its topic there; the rest is
    `Entry`'s.
    """

    t_ns: int
    rank: int
    bag: int
    publisher: int
    chunk: int
    offset: int
    connection: int
    row: int = 0


@dataclass
class Damage:
    """What of one topic could not be read.

    Args:
        topic: whose messages.
        reason: of the first one.
        first_ns: time of the first one.
        last_ns: time of the last one.
        messages: what tells one from another.
    """

    topic: str
    reason: str
    first_ns: int
    last_ns: int
    messages: Set[object] = field(default_factory=set)

    @property
    def count(self) -> int:
        """How many messages."""
        return len(self.messages)


@dataclass(frozen=True)
class TopicFigures:
    """What the index says of one topic.

    Args:
        topic: its name.
        messages: how many.
        rate_hz: from its first to its last message; None for fewer than two.
        longest_gap_s: between two messages, before the first or after the last; None for no message.
        longest_gap_at_ns: when that gap began.
    """

    topic: str
    messages: int
    rate_hz: Optional[float] = None
    longest_gap_s: Optional[float] = None
    longest_gap_at_ns: Optional[int] = None


class Recordings:
    """Several bags of one flight, read as one.

    Args:
        paths: of the bags.
        topics: that are wanted; the place of a topic is its rank.
        muted: topics that are read as if they were not there.
        memory: bytes that the data of a chunk may take, decompressed.
        replayed: the script plays what led to it, so that there must be room for it in its time.

    Attributes:
        shift_ns: what is added to all its times, those in the messages' headers as well; 0 unless it is `replayed` and
            its times are near 0.

    Raises:
        BagError: A bag cannot be read.
        UnknownTopicError: A muted topic is in none of them.
        NoMessagesError: There is no message of any wanted topic.
        ReplayError: A recording is named twice, or two hold the same messages.
        TimeJumpError: There is nothing for an hour between two messages.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        topics: Sequence[str],
        muted: Sequence[str] = (),
        memory: int = MEMORY,
        *,
        replayed: bool = False,
    ) -> None:
        self.bags: List[Any] = []  # bags, and telemetry logs with the face of bags
        self.topics, self.muted = tuple(topics), tuple(muted)
        self.damage: Dict[str, Damage] = {}
        self._numbers: Dict[Tuple[int, int], Optional[Numbers]] = {}
        self._rows: Dict[Tuple[int, int], _Rows] = {}
        self._read: Dict[int, Tuple[str, ...]] = {}
        self._statuses: Dict[Tuple[int, int], Sequence[Optional[Event]]] = {}
        self._logs: Dict[str, Optional[FlightLog]] = {}
        try:
            self._open(paths, memory, replayed=replayed)
        except BaseException:
            self.close()
            raise

    def _open(self, paths: Sequence[Path], memory: int, *, replayed: bool) -> None:
        for path in paths:
            self.bags.extend(recordings_of(path, memory))
        _check_once(paths)
        if replayed and any(bag.start_ns is not None and bag.start_ns < _NEAR_ZERO_NS for bag in self.bags):
            self.shift_ns = SHIFT_NS
            self.bags = [Shifted(bag) for bag in self.bags]
        self.bags.sort(key=lambda bag: (bag.start_ns or 0, bag.path.name))
        known = tuple(sorted({topic.name for bag in self.bags for topic in bag.topics}))
        for topic in self.muted:
            if topic not in known:
                raise UnknownTopicError(topic, known)
        self.problems = problems_of(self.bags)
        self.doubts = {words: times for bag in self.bags for words, times in (*_set_backs(bag), *_cuts(bag))}
        self.missing = tuple(topic for topic in self.topics if topic not in known or topic in self.muted)
        self._parts: Tuple[_Columns, ...] = tuple(self._of_topic(rank) for rank in range(len(self.topics)))
        if not self.count:
            raise self._nothing()
        self._check_shared()
        self._check_times()

    faulted = False  # it is what was recorded
    shift_ns = 0
    from_ns = 0  # it is whole at its beginning
    _samples: Optional[List[Sample]] = None
    _figures: Optional[Tuple[TopicFigures, ...]] = None

    def __enter__(self) -> Recordings:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all bags."""
        for bag in self.bags:
            bag.close()

    @property
    def start_ns(self) -> int:
        """Time of the first message of any topic, wanted or not."""
        first: int = min(bag.start_ns for bag in self.bags if bag.start_ns is not None)
        return first

    @property
    def end_ns(self) -> int:
        """Time of the last message of any topic, wanted or not."""
        last: int = max(bag.end_ns for bag in self.bags if bag.end_ns is not None)
        return last

    @property
    def count(self) -> int:
        """Number of messages of all wanted topics."""
        return sum(len(self.times(rank)) for rank in range(len(self.topics)))

    @property
    def samples(self) -> List[Sample]:
        """All messages in their order."""
        if self._samples is None:
            self._samples = self.ordered(range(len(self.topics)))
        return self._samples

    def times(self, rank: int) -> Any:
        """Return the times of a topic's messages, an array."""
        return self._parts[rank][0]

    def ordered(self, ranks: Iterable[int]) -> List[Sample]:
        """Return the messages of some topics in their order."""
        parts = [self._parts[rank] for rank in sorted(ranks)]
        if not parts:
            return []
        columns = [np.concatenate(column) for column in zip(*parts)]
        order = np.argsort(columns[0], kind="stable")
        return list(map(partial(tuple.__new__, Sample), zip(*(column[order].tolist() for column in columns))))

    def topic(self, sample: Sample) -> str:
        """Return the topic of a sample."""
        return self.topics[sample.rank]

    def message(self, sample: Sample) -> Optional[Any]:
        """Return the decoded message; None when it is damaged, which is noted."""
        entry = Entry(sample.t_ns, sample.publisher, sample.chunk, sample.offset, sample.connection)
        try:
            message = self.bags[sample.bag].message(entry)
        except MessageError as error:
            self.note(self.topic(sample), sample.t_ns, str(error), (sample.bag, sample.row))
            return None
        bag = self.bags[sample.bag]
        return sent_by(message, bag.caller(sample.connection)) if isinstance(bag, Recording) else message

    def read(self, wanted: Mapping[int, Tuple[str, ...]], texts: Collection[int] = ()) -> None:
        """Read numbers of all messages of some topics, by rank the paths, of those in `texts` texts as well."""
        new = {rank: paths for rank, paths in wanted.items() if self._read.get(rank) != paths}
        self._read.update(new)
        for number, bag in enumerate(self.bags):
            if isinstance(bag, Recording):
                paths_of = {self.topics[rank]: paths for rank, paths in new.items()}
                found = bag.numbers(paths_of, [self.topics[rank] for rank in texts])
                for rank in new:
                    self._numbers[number, rank] = found.get(self.topics[rank])
                    self._rows.pop((number, rank), None)

    def paths_read(self, rank: int) -> Tuple[str, ...]:
        """Return of which fields of a topic the numbers are read."""
        return self._read.get(rank, ())

    def read_statuses(self, wanted: Mapping[int, str]) -> Tuple[int, ...]:
        """Read recorded statuses as events, by rank the name of each; return the ranks of which `status` has all."""
        whole: List[int] = []
        for rank, name in wanted.items():
            bags = [number for number, bag in enumerate(self.bags) if len(bag.entries(self.topics[rank]))]
            for number in bags:
                bag = self.bags[number]
                found = taped_statuses(bag, self.topics[rank], name) if isinstance(bag, Recording) else None
                if found is not None:
                    self._statuses[number, rank] = found
            if all((number, rank) in self._statuses for number in bags):
                whole.append(rank)
        return tuple(whole)

    def tell_statuses(self, wanted: Mapping[int, str]) -> None:
        """Make events of recorded statuses of which the columns `statuses.FLAT` were `read`."""
        for (number, rank), numbers in self._numbers.items():
            if rank in wanted and numbers is not None:
                bag, table = self.bags[number], self.bags[number].table(self.topics[rank])
                callers = [bag.caller(connection) for connection in table.connection.tolist()]
                self._statuses[number, rank] = status_rows(wanted[rank], table.t_ns.tolist(), numbers.rows(), callers)

    def status(self, sample: Sample) -> Optional[Event]:
        """Return a recorded status as an event; None when `message` must be asked."""
        found = self._statuses.get((sample.bag, sample.rank))
        return None if found is None else found[sample.row]

    def keep(self, topics: Sequence[str]) -> None:
        """Make whole messages of some topics fast, where tapes are wanted."""
        for bag in self.bags:
            if isinstance(bag, Recording):
                bag.keep(topics)

    def values(self, sample: Sample) -> Optional[Tuple[Any, ...]]:
        """Return the numbers of a message; None when `message` must be asked."""
        rows = self._rows.get((sample.bag, sample.rank))
        if rows is None:
            numbers = self._numbers.get((sample.bag, sample.rank))
            rows = self._rows[sample.bag, sample.rank] = [] if numbers is None else numbers.rows()
        return rows[sample.row] if rows else None

    def track(self, rank: int, paths: Sequence[str]) -> Optional[Track]:
        """Return a topic's messages as arrays, with the numbers that were `read`; None when some must be asked."""
        _, _, bags, *_, rows = self._parts[rank]
        return self._track(rank, paths, self.times(rank), bags, rows)

    def _track(self, rank: int, paths: Sequence[str], times: Any, bags: Any, rows: Any) -> Optional[Track]:
        if not paths:
            return Track(times)
        if len(self.bags) == 1 and np.array_equal(rows, np.arange(len(rows))):
            numbers = self._numbers.get((0, rank))
            columns = None if numbers is None else numbers.columns()
            if numbers is not None and columns is not None and numbers.messages == len(rows):  # all, in their order
                return Track(times, tuple(columns))
        parts: List[Tuple[Any, List[Any]]] = []
        for number in np.unique(bags).tolist():
            numbers = self._numbers.get((number, rank))
            columns = None if numbers is None else numbers.columns()
            if columns is None:
                return None
            where = np.flatnonzero(bags == number)
            parts.append((where, [column[rows[where]] for column in columns]))
        found = Numbers(len(times), tuple(parts)).columns()
        return None if found is None else Track(times, tuple(found))

    def log(self, topic: str) -> Optional[FlightLog]:
        """Return what was asked in the flight by the journal on a topic; None: there is none. It is read once."""
        if topic not in self._logs:
            there = bool(topic) and topic not in self.missing
            self._logs[topic] = read_log(tuple(self.bags), topic) if there else None
        return self._logs[topic]

    def figures(self) -> Tuple[TopicFigures, ...]:
        """Return what the index says of each wanted topic."""
        if self._figures is None:
            begin_ns, end_ns = self.start_ns, self.end_ns
            ranks = enumerate(self.topics)
            self._figures = tuple(_figures(topic, self.times(rank), begin_ns, end_ns) for rank, topic in ranks)
        return self._figures

    def _of_topic(self, rank: int) -> _Columns:
        """Return the samples of a topic in all bags, as columns, in their order."""
        muted = self.topics[rank] in self.muted
        parts = [self._part(number, rank) for number in range(len(self.bags)) if not muted]
        columns = [np.concatenate(column) for column in zip(*parts)] or [np.zeros(0, np.int64) for _ in Sample._fields]
        if len(parts) > 1:
            order = np.lexsort(tuple(reversed(columns)))
            columns = [column[order] for column in columns]
        return columns

    def _part(self, number: int, rank: int) -> Sequence[Any]:
        """Return the samples of a topic in a bag, as columns."""
        bag, topic = self.bags[number], self.topics[rank]
        t_ns, *rest = (
            bag.table(topic) if isinstance(bag, Recording) else np.array(bag.entries(topic), np.int64).reshape(-1, 5).T
        )
        count = len(t_ns)
        return t_ns, np.full(count, rank), np.full(count, number), *rest, np.arange(count)

    def _check_shared(self) -> None:
        """Refuse recordings that hold the same messages, by time or content: each of them would come twice."""
        shared: Dict[Tuple[Path, Path], List[str]] = {}
        for topic, (t_ns, _, bags, *_) in zip(self.topics, self._parts):
            twice = np.flatnonzero((np.diff(t_ns) == 0) & (np.diff(bags) > 0))
            for one, other in zip(bags[twice].tolist(), bags[twice + 1].tolist()):
                shared.setdefault((self.bags[one].path, self.bags[other].path), []).append(topic)
        for (path, other_path), topics in shared.items():
            if path != other_path and len(topics) > _HANDFUL:
                raise _shared_error(path, other_path, f"{len(topics)} messages, of {topics[0]}")
        for topic, columns in zip(self.topics, self._parts):
            for one, other in _overlapping(columns[0], columns[2]):
                path, other_path = (self.bags[columns[2][places[0]]].path for places in (one, other))
                if path != other_path and self._hold_the_same(columns, one, other):
                    raise _shared_error(path, other_path, f"messages, of {topic}")

    def _hold_the_same(self, columns: _Columns, one: Any, other: Any) -> bool:
        """Return whether most of a handful of a topic's messages in one of two recordings are in the other as well.

        That is where both have it at one time: two computers recorded it, each message at a time of its own. Content
        that repeats proves nothing: the recorder may have begun anew, with its clock set back.

        Args:
            columns: of the topic.
            one: places of the messages of a recording.
            other: those of another one.
        """
        t_ns, recorded = columns[0], (one, other)
        first_ns, last_ns = max(t_ns[each[0]] for each in recorded), min(t_ns[each[-1]] for each in recorded)
        both = [each[(t_ns[each] >= first_ns) & (t_ns[each] <= last_ns)] for each in recorded]
        (fewer, own), (_, others) = sorted(zip(both, recorded), key=lambda pair: len(pair[0]))
        if len(fewer) <= _HANDFUL:
            return False
        asked = fewer[np.linspace(0, len(fewer) - 1, _HANDFUL).astype(np.int64)].tolist()
        found = (place for place in asked if self._is_among(columns, place, others))
        return sum(self._is_one_of_its_kind(columns, place, own) for place in found) > _HANDFUL // 2

    def _is_among(self, columns: _Columns, place: int, others: Any) -> bool:
        """Return whether a message is among those of another recording that came at about its time, the next first."""
        apart_ns = np.abs(columns[0][others] - columns[0][place])
        order = np.argsort(apart_ns, kind="stable")[: int((apart_ns <= _APART_NS).sum())]
        caller, raw = self._as_recorded(columns, place)
        told = (self._as_recorded(columns, each) for each in others[order].tolist()) if raw is not None else ()
        return any(data == raw and (by == caller or "" in (by, caller)) for by, data in told)

    def _is_one_of_its_kind(self, columns: _Columns, place: int, own: Any) -> bool:
        """Return whether no other of its own recording at about its time, or of the next handfuls, is like it."""
        t_ns, own_ns = columns[0][place], columns[0][own]
        first, end = (int(np.searchsorted(own_ns, at_ns)) for at_ns in (t_ns - _APART_NS, t_ns + _APART_NS))
        _, raw = self._as_recorded(columns, place)
        around = (each for each in own[max(0, first - _HANDFUL) : end + _HANDFUL].tolist() if each != place)
        return all(self._as_recorded(columns, each)[1] != raw for each in around)

    def _as_recorded(self, columns: _Columns, place: int) -> Tuple[str, Optional[bytes]]:
        """Return who sent a message, where that is known, and its bytes; None where it has none, or is damaged."""
        t_ns, _, number, publisher, chunk, offset, connection, _ = (int(column[place]) for column in columns)
        bag = self.bags[number]
        try:
            raw = bag.raw(Entry(t_ns, publisher, chunk, offset, connection)) if hasattr(bag, "raw") else None
        except MessageError:
            raw = None
        return bag.caller(connection) if hasattr(bag, "caller") else "", raw if isinstance(raw, bytes) else None

    def _check_times(self) -> None:
        """Refuse a recording in which a clock was set: virtual time would go through all the years between."""
        if self.end_ns - self.start_ns <= JUMP_NS:
            return
        parts = [self.times(rank) for rank in range(len(self.topics))]
        times = np.concatenate(([self.start_ns], np.sort(np.concatenate(parts)), [self.end_ns]))
        jumps = np.flatnonzero(np.diff(times) > JUMP_NS)
        if len(jumps):
            raise TimeJumpError(self._names(), *(times[jumps[0] : jumps[0] + 2] - self.shift_ns).tolist())

    def _names(self) -> str:
        return ", ".join(bag.path.name for bag in self.bags)

    def _nothing(self) -> NoMessagesError:
        names = self._names()
        if all(bag.start_ns is None for bag in self.bags):
            return NoMessagesError(f"{names}: {_NO_MESSAGE}")
        there = ", ".join(topic.name for bag in self.bags for topic in bag.topics)
        if not self.topics:
            return NoMessagesError(f"{names}: the map names none of its topics; there are {there}")
        return NoMessagesError(
            f"{names}: no message of {', '.join(self.topics)}; there are {there}: is it another map?"
        )

    def note(self, topic: str, t_ns: int, reason: str, message: object = None) -> None:
        """Note that one message could not be read, and why; it is one however often it is asked for.

        Args:
            topic: of it.
            t_ns: time of it.
            reason: in words.
            message: what tells it from others of its topic; None: its time does.
        """
        damage = self.damage.setdefault(topic, Damage(topic, reason, t_ns, t_ns))
        damage.last_ns = max(damage.last_ns, t_ns)
        damage.messages.add(t_ns if message is None else message)

    def tell(self, problem: str) -> None:
        """Note, once, what else is missing."""
        if problem not in self.problems:
            self.problems = (*self.problems, problem)


def _overlapping(t_ns: Any, bags: Any) -> Iterator[Tuple[Any, Any]]:
    """Return where the messages of a topic stand of each two bags that both have it at one time."""
    order = np.argsort(bags, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(bags[order])) + 1) if len(order) else []
    spans = [(places, *t_ns[places[[0, -1]]].tolist()) for places in parts]
    for (one, first_ns, last_ns), (other, other_first_ns, other_last_ns) in combinations(spans, 2):
        if first_ns <= other_last_ns and other_first_ns <= last_ns:
            yield one, other


def _shared_error(path: Path, other_path: Path, what: str) -> ReplayError:
    right = "name one of them, or, where they are the same, join them with `amaze-bag merge --duplicates drop`"
    same = f"{path.name} and {other_path.name} hold the same {what} first, or a clock was set back"
    return ReplayError(f"{same}: each would count twice; {right}")


def _check_once(paths: Sequence[Path]) -> None:
    """Refuse a recording that is named twice: each of its messages would come twice."""
    for number, path in enumerate(paths):
        for other in paths[:number]:
            if path.samefile(other):
                raise ReplayError(f"{path}: is the same recording as {other}; name it once")


def problems_of(bags: Iterable[Any]) -> Tuple[str, ...]:
    """Return what is wrong with opened recordings, one line each.

    That is: a file was not closed, or was cut, or its recorder's clock was set back.
    """
    return tuple(words for bag in bags for words in (*_missing(bag), *(words for words, _ in _set_backs(bag))))


def _missing(bag: Any) -> List[str]:
    return [words for words in (getattr(bag, name, "") for name in ("problem", "cut")) if words]


def _set_backs(bag: Any) -> List[Tuple[str, Tuple[int, int]]]:
    """Return that a recorder's clock was set back, with the times between which it is not known what came when."""
    found = getattr(bag, "set_back", None)
    return [] if found is None else [(f"{bag.path.name}: {found.words(bag.start_ns)}", (found.from_ns, found.to_ns))]


def _cuts(bag: Any) -> List[Tuple[str, Tuple[int, int]]]:
    """Return that a file was cut, with the times that are missing: all behind its own last message."""
    cut = getattr(bag, "cut", "")
    return [(cut, (bag.end_ns or 0, FOREVER_NS))] if cut else []


def _figures(topic: str, times: Any, begin_ns: int, end_ns: int) -> TopicFigures:
    if not len(times):
        return TopicFigures(topic, 0)
    gap_ns, at_ns = silence(times, begin_ns, end_ns)
    length_ns = int(times[-1]) - int(times[0])
    rate = (len(times) - 1) * _S / length_ns if length_ns else None
    return TopicFigures(topic, len(times), rate, gap_ns / _S, at_ns)


def silence(times: Any, begin_ns: int, end_ns: int) -> Tuple[int, int]:
    """Return the longest time without a message in a range, and when it began; a topic that has ended is silent."""
    inner = times[(times > begin_ns) & (times < end_ns)]
    marks = np.concatenate(([begin_ns], inner, [end_ns]))
    gaps = np.diff(marks)
    longest = int(gaps.argmax())
    return int(gaps[longest]), int(marks[longest])


# --- times near 0 -----------------------------------------------------------------------------------------------------
# Of a simulated or a booting clock. The script plays before a recording, and no event has a time below 0: so all times
# of such a recording are moved by one constant, and it is decided as it would be with the times of any other day.


SHIFT_NS = 86_400 * _S
_NEAR_ZERO_NS = 3600 * _S  # no lead of a script is as long


class Shifted:
    """A recording with all its times later by SHIFT_NS; its messages are read one by one."""

    def __init__(self, bag: Any) -> None:
        self._bag = bag

    def __getattr__(self, name: str) -> Any:
        return getattr(self._bag, name)

    @property
    def start_ns(self) -> Optional[int]:
        """Time of its first message; None: it has none."""
        return None if self._bag.start_ns is None else self._bag.start_ns + SHIFT_NS

    @property
    def end_ns(self) -> Optional[int]:
        """Time of its last message; None: it has none."""
        return None if self._bag.end_ns is None else self._bag.end_ns + SHIFT_NS

    @property
    def set_back(self) -> Optional[SetBack]:
        """Whether its recorder's clock was set back."""
        found: Optional[SetBack] = getattr(self._bag, "set_back", None)
        return None if found is None else SetBack(found.by_ns, found.from_ns + SHIFT_NS, found.to_ns + SHIFT_NS)

    def entries(self, topic: str) -> List[Entry]:
        """Return the messages of a topic, not read yet."""
        return [entry._replace(t_ns=entry.t_ns + SHIFT_NS) for entry in self._bag.entries(topic)]

    def message(self, entry: Entry) -> Any:
        """Return a message with the time of its header moved; a time of 0 says nothing, and stays.

        Raises:
            MessageError: It is damaged.
        """
        message = copy(self._bag.message(entry._replace(t_ns=entry.t_ns - SHIFT_NS)))
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        if stamp is not None and (stamp.sec or stamp.nanosec):
            header, moved = copy(message.header), copy(stamp)
            for whole, name, part in (
                (moved, "sec", stamp.sec + SHIFT_NS // _S),
                (header, "stamp", moved),
                (message, "header", header),
            ):
                object.__setattr__(whole, name, part)  # what is made of telemetry is frozen
        return sent_by(message, self._bag.caller(entry.connection)) if isinstance(self._bag, Recording) else message


# --- opening ----------------------------------------------------------------------------------------------------------
# Files as recordings. What is no ROS 1 bag, or has MAVLink in it, needs code that is loaded only for that.


MAVLINK_KIND = "mavros_msgs/Mavlink"
RECORDINGS = "a ROS 1 bag, a ROS 2 bag, an MCAP file, a ULog or a telemetry log"
"""What can be replayed."""
CNS_PACKAGES = ("watchdog_msgs/", "mission_sequencer/")
_LOG = ".tlog"


def recordings_of(path: Path, memory: int = MEMORY) -> List[Any]:
    """Return a file as recordings: what it is, by content, and what is made of the MAVLink or PX4 topics in it.

    Raises:
        BagError: It cannot be read.
    """
    if _is_log(path):
        from .telemetry import Telemetry  # noqa: PLC0415

        return [Telemetry.of_log(path)]
    if is_other(path):
        return _of_other(path, memory)
    try:
        bag = Recording(path, memory)
    except BagError as error:
        cause = error.__cause__
        if not isinstance(cause, NotABagError) or cause.other:
            raise
        right = f"name {RECORDINGS}"  # more than bags are read here
        raise BagError(str(path), "is empty" if cause.empty else "is no recording", right) from error
    topics = [topic.name for topic in bag.topics if topic.kind == MAVLINK_KIND]
    made: List[Any] = _of_cns(bag)
    if topics:
        from .telemetry import Telemetry  # noqa: PLC0415

        made.append(Telemetry.of_bag(bag, topics))
    return [bag, *made]


def _of_cns(bag: Any) -> List[Any]:
    """Return what is made of what nodes of the CNS Flight Stack said in a recording."""
    if not any(topic.kind.startswith(CNS_PACKAGES) for topic in bag.topics):
        return []
    from .recorded_cns import CnsStatuses  # noqa: PLC0415

    made = CnsStatuses(bag)
    return [made] if made.topics else []


def spans_of(recording: Any) -> List[Tuple[int, int]]:
    """Return from when to when a recording has messages: once, or before and after each time that a clock was set."""
    begin_ns, end_ns = recording.start_ns, recording.end_ns
    if end_ns - begin_ns <= JUMP_NS:
        return [(begin_ns, end_ns)]
    times = np.sort(np.concatenate([_times_of(recording, topic.name) for topic in recording.topics]))
    jumps = np.flatnonzero(np.diff(times) > JUMP_NS)
    return list(zip([begin_ns, *times[jumps + 1].tolist()], [*times[jumps].tolist(), end_ns]))


def _times_of(recording: Any, topic: str) -> Any:
    if isinstance(recording, Recording):
        return recording.table(topic).t_ns
    return np.array([entry.t_ns for entry in recording.entries(topic)], np.int64)


def _of_other(path: Path, memory: int) -> List[Any]:
    from .uorb import VEHICLE_KIND, Uorb  # noqa: PLC0415

    recording = other_recording(path, memory)
    kinds = {topic.kind for topic in recording.topics}
    return [recording, *([Uorb(recording)] if VEHICLE_KIND in kinds else []), *_of_cns(recording)]


def _is_log(path: Path) -> bool:
    """Return whether a file is a telemetry log, by name or by content."""
    if path.suffix == _LOG or not path.is_file():
        return path.suffix == _LOG
    with path.open("rb") as file:
        return is_log(file.read(16))


def topics_of(paths: Iterable[Path], memory: int = MEMORY) -> Tuple[str, ...]:
    """Return every topic of some files, each once; `memory`: bytes that a chunk may take, decompressed.

    Raises:
        BagError: One cannot be read.
    """
    return tuple(dict.fromkeys(name for path in paths for name in _topics(path, memory)))


def check_messages(paths: Sequence[Path], memory: int = MEMORY) -> None:
    """Refuse recordings without a message; `memory`: bytes that a chunk may take, decompressed.

    Raises:
        BagError: One cannot be read.
        NoMessagesError: There is no message in any of them.
    """
    for path in paths:
        bags = recordings_of(path, memory)
        told = any(bag.start_ns is not None for bag in bags)
        for bag in bags:
            bag.close()
        if told:
            return
    raise NoMessagesError(f"{', '.join(path.name for path in paths)}: {_NO_MESSAGE}")


def _topics(path: Path, memory: int) -> Iterable[str]:
    if _is_log(path):
        from .telemetry import topics_of_log  # noqa: PLC0415

        return topics_of_log(path)
    named = _named(path, memory)
    if named is not None:
        return named
    names: List[str] = []
    for recording in recordings_of(path, memory):
        names += [topic.name for topic in recording.topics]
        recording.close()
    return names


def _named(path: Path, memory: int) -> Optional[List[str]]:
    """Return the topics that a bag names, without a look at its messages; None when they must be looked at."""
    try:
        with Index(path, memory) as index:
            connections = list(index.connections.values())
    except BagError:
        return None
    if any(connection.kind.startswith((MAVLINK_KIND, *CNS_PACKAGES)) for connection in connections):
        return None
    return sorted({connection.topic for connection in connections})
