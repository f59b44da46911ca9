"""What was not recorded, from the files alone, whoever watched or nobody; and the words for it.

Publishers number their messages (std_msgs/Header, seq): rospy and roscpp count the messages of each publisher and write
the count over whatever the header said. So a number that is missing between two that were recorded is a message that
was published and not recorded: dropped on its way, or by the recorder. Only topics whose messages begin with a header
have them; a publisher that skips numbers itself, as one that hands on every third message, or does not count, is left
out: one is not its most frequent step, as it is however many are dropped by chance. So is one that latches, whose
numbers count what others get. So what is found is a lower bound.

Each recorder of a group writes the next file. Between two recorders of a group there is a gap, whoever ended the first
and however; it lasts from the last message of the one to the first of the other, by their record times. A group whose
last file was not closed may have missed all that came after it; what it missed before its first recorder and after its
last one is what lies between them and the flight. A file that begins before the last message of the one before it, and
a gap that ends before it began, prove that its computer's clock was set back, as by a restart without a battery for it:
nobody knows how long that gap was, nor by its record times what was in the flight.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Dict, FrozenSet, Iterable, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.bags.arrays import words
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import Connection
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.read import Loader, Pool
from amaze_autonomy.units import SECOND

from .status import STOPPED, Configured, lacking, lacking_words
from .storage import told_gaps

# --- numbers in headers -----------------------------------------------------------------------------------------------


Stream = Tuple[str, str]  # topic and publisher
_GROUP = 8  # chunks that are loaded together
_WRAP = 1 << 32
_BACK = 1 << 31  # a step that is larger goes back: the publisher was started anew
_HEADER = re.compile(r"^(std_msgs/|roslib/)?Header\s+\w+$")


class Numbers(NamedTuple):
    """The numbers of one publisher in one bag.

    Args:
        first: number.
        last: number.
        missing: how many are not there between them.
        counts: whether they count: no other step is more frequent than one.
    """

    first: int
    last: int
    missing: int = 0
    counts: bool = True


def numbers_of(numbers: Any) -> Optional[Numbers]:
    """Return what an array of numbers in the order of the recording tells; None when there is none."""
    if not len(numbers):
        return None
    steps = np.diff(numbers.astype(np.int64)) % _WRAP
    kinds, times = np.unique(steps, return_counts=True)
    ones = times[kinds == 1].sum()
    counts = bool(ones and ones == times.max())
    missing = int((steps[(steps > 1) & (steps < _BACK)] - 1).sum()) if counts else 0
    return Numbers(int(numbers[0]), int(numbers[-1]), missing, counts)


def between(before: Numbers, after: Numbers) -> int:
    """Return how many numbers are missing between two bags."""
    step = (after.first - before.last) % _WRAP
    return step - 1 if before.counts and after.counts and 1 < step < _BACK else 0


def header_numbers(path: Path) -> Dict[Stream, Numbers]:
    """Return the numbers in a bag, by topic and publisher; damaged chunks tell nothing.

    Raises:
        BagError: It cannot be read.
    """
    parts: Dict[int, List[Any]] = {}
    with Index(path) as index:
        wanted = {each.number for each in index.connections.values() if _has_header(each) and not _latched(each)}
        for connection, numbers in _read(index, wanted):
            parts.setdefault(connection, []).append(numbers)
        streams = {number: (index.connections[number].topic, index.connections[number].caller) for number in parts}
    found: Dict[Stream, List[Any]] = {}
    for number, arrays in sorted(parts.items()):
        found.setdefault(streams[number], []).extend(arrays)
    known = {stream: numbers_of(np.concatenate(arrays)) for stream, arrays in sorted(found.items())}
    return {stream: numbers for stream, numbers in known.items() if numbers is not None}


def _read(index: Index, wanted: Iterable[int]) -> Iterator[Tuple[int, Any]]:
    """Yield numbers by connection, in the order of the file. Of large messages only the beginning is read."""
    unseen: Any = np.ones(max(index.connections, default=0) + 1, bool)
    loader, connections = Loader(index, 0, unseen), sorted(wanted)
    with Pool() as pool:
        for group in _groups(index, frozenset(connections)):
            try:
                plain = index.head(group[0]).compression == "none"
                block = (loader.plain if plain else loader.compressed)(group, pool)
            except BagError:
                continue
            table, values = block.table, words(block.buffer)
            for connection in connections:
                places = table.payload[(table.connection == connection) & (table.payload + 4 <= table.end)]
                if len(places):
                    yield connection, values[places].astype(np.int64)
            pool.put(block.buffer)


def _groups(index: Index, wanted: Iterable[int]) -> List[List[int]]:
    """Return the chunks with messages of some connections, a few of one kind together; none whose head is damaged."""
    groups: List[List[int]] = []
    kind = None
    for number, chunk in enumerate(index.chunks):
        if not any(connection in wanted for connection, _ in chunk.counts):
            continue
        try:
            compression = index.head(number).compression
        except BagError:
            continue
        if not groups or compression != kind or len(groups[-1]) >= _GROUP:
            groups.append([])
        groups[-1].append(number)
        kind = compression
    return groups


def _latched(connection: Connection) -> bool:
    """Return whether a publisher latches: rospy counts what it sends again to each new listener and no other."""
    return b"latching=1" in connection.header


def _has_header(connection: Connection) -> bool:
    """Return whether messages begin with a header, by their definition."""
    begin = connection.header.find(b"message_definition=")
    text = connection.header[begin + len(b"message_definition=") :].decode("utf-8", "replace") if begin >= 0 else ""
    for line in text.split("\n"):
        words_of = line.split("#", 1)[0].strip()
        if words_of and "=" not in words_of:
            return _HEADER.match(words_of) is not None
    return False


# --- gaps -------------------------------------------------------------------------------------------------------------


_NAME = re.compile(r"(.+)-(\d\d+)(?:_(\d+))?\.bag(\.active)?")
_LEAST_NS = 100_000_000
_UNSEEN = "its file was not closed, and nobody saw it end"
_GONE = "a file in between is not there"


class Written(NamedTuple):
    """One file of a recorder.

    Args:
        group: that it recorded.
        number: of the recorder in the session.
        split: number of the file of that recorder.
        closed: whether the recorder closed it.
        first_ns: time of the first message; None: there is none.
        last_ns: time of the last one.
        numbers: in the headers of its messages.
        empty: it has not one byte: a power cut came before the disk had any.
    """

    group: str
    number: int
    split: int = 0
    closed: bool = True
    first_ns: Optional[int] = None
    last_ns: Optional[int] = None
    numbers: Mapping[Stream, Numbers] = {}
    empty: bool = False


class Account(NamedTuple):
    """What was not recorded.

    Args:
        gaps: times in which a group was not recorded, with the numbers that are missing over each.
        missing: numbers that are missing elsewhere, by topic.
        open_ends: time of the last message of each group whose last file was not closed, or has not one byte.
        set_back: groups of which a file begins before the last message of the one before it, or a gap ends before it
            began.
    """

    gaps: List[Dict[str, Any]]
    missing: Dict[str, int]
    open_ends: Dict[str, int]
    set_back: List[str]


def written(name: str) -> Optional[Written]:
    """Return what the name of a recorder's file tells; None when it is no such name."""
    match = _NAME.fullmatch(name)
    if match is None:
        return None
    return Written(match[1], int(match[2]), int(match[3] or 0), closed=match[4] is None)


def account(files: Iterable[Written], gaps: Sequence[Mapping[str, Any]]) -> Account:
    """Return what was not recorded.

    Args:
        files: of the part.
        gaps: that the machine saw; one of a negative length ends before it began.
    """
    told, back = told_gaps(gaps)
    found = Account(told, {}, {}, back)
    by_group: Dict[str, List[Written]] = {}
    for each in sorted(files, key=lambda each: (each.group, each.number, each.split)):
        by_group.setdefault(each.group, []).append(each)
    for group, mine in by_group.items():
        _account_group(found, group, [each for each in mine if each.last_ns is not None])
        if mine and (not mine[-1].closed or mine[-1].empty):
            _account_end(found, group, mine)
    return found


def _account_group(found: Account, group: str, files: List[Written]) -> None:
    for each in files:
        for (topic, _), numbers in each.numbers.items():
            _add(found.missing, topic, numbers.missing)
    for before, after in zip(files, files[1:]):
        between_ns = (after.first_ns or 0) - (before.last_ns or 0)
        set_back = between_ns < -_LEAST_NS and (before.number, before.split) != (after.number, after.split)
        if set_back and group not in found.set_back:
            found.set_back.append(group)
        missing = _missing_between(before, after)
        follows = before.number == after.number and after.split - before.split <= 1
        gap = None if follows else _gap(found, group, before, after)
        if gap is None:
            for topic, count in missing.items():
                _add(found.missing, topic, count)
            continue
        gap.update(from_ns=before.last_ns, to_ns=after.first_ns)
        gap["seconds"] = None if set_back or gap["seconds"] is None else max(0, between_ns) / SECOND
        if sum(missing.values()):
            gap["missing"] = sum(missing.values())


def _gap(found: Account, group: str, before: Written, after: Written) -> Optional[Dict[str, Any]]:
    """Return the gap between two recorders, noted or not; None when one inside of the first file goes on over it."""
    mine = [gap for gap in found.gaps if gap["group"] == group]
    seen = [gap for gap in mine if before.number < gap["file"] <= after.number and not gap.get("inside")]
    for again in seen[1:]:  # recorders in between wrote nothing: it is one gap
        found.gaps.remove(again)
    if seen:
        return seen[0]
    inside = [gap for gap in mine if gap["file"] == before.number and gap.get("inside")]
    if any(gap.get("to_ns", after.first_ns) >= after.first_ns for gap in inside):
        return None
    ending = _GONE if before.number == after.number else STOPPED if before.closed else _UNSEEN
    found.gaps.append({"group": group, "file": after.number, "seconds": 0.0, "ending": ending})
    return found.gaps[-1]


def _account_end(found: Account, group: str, files: List[Written]) -> None:
    """Note the end of a group whose last file is open or empty, unless the machine saw the gap that follows."""
    last = max((each.last_ns for each in files if each.last_ns is not None), default=None)
    seen = any(gap["group"] == group and gap["file"] > files[-1].number for gap in found.gaps)
    if last is not None and not seen:
        found.open_ends[group] = last


def _missing_between(before: Written, after: Written) -> Dict[str, int]:
    missing: Dict[str, int] = {}
    for stream, numbers in before.numbers.items():
        if stream in after.numbers:
            _add(missing, stream[0], between(numbers, after.numbers[stream]))
    return missing


def _add(counts: Dict[str, int], topic: str, count: int) -> None:
    if count:
        counts[topic] = counts.get(topic, 0) + count


def _proves(file: Written, first: int) -> bool:
    """Return whether a file shows that a recorder wrote from its beginning on; one of 0 bytes shows nothing."""
    return file.number <= first and file.split == 0 and not file.empty


def recorded(
    files: Sequence[Written], gaps: Sequence[Mapping[str, Any]], seen: Mapping[str, Mapping[str, Optional[int]]]
) -> Dict[str, List[Optional[int]]]:
    """Return from when to when each group was recorded: by its messages, by its gaps, and by who saw its recorders.

    None: nothing of it was recorded, or nobody knows when it ended.

    Args:
        files: of the part.
        gaps: of all groups, told as such: they are neither a beginning nor an end.
        seen: of each group that was watched `file`, the number of its first recorder, and from when to when there were
            some. The first one does not count when its file is not there.
    """
    found: Dict[str, List[Optional[int]]] = {}
    for group, watched in seen.items():
        mine = [each for each in files if each.group == group]
        named = [gap for gap in gaps if gap["group"] == group and "from_ns" in gap]
        first = watched["file"] is not None and any(_proves(each, watched["file"]) for each in mine)
        begins = [*(each.first_ns for each in mine), *(gap["from_ns"] for gap in named)]
        ends = [*(each.last_ns for each in mine), *(gap.get("to_ns") for gap in named)]
        begins += [watched["from_ns"]] if first else []
        ends += [watched["to_ns"]] if mine and not max(mine, key=lambda each: (each.number, each.split)).empty else []
        lasts = any("to_ns" not in gap for gap in named)
        found[group] = [
            min((each for each in begins if each is not None), default=None),
            None if lasts else max((each for each in ends if each is not None), default=None),
        ]
    return found


# --- in words ---------------------------------------------------------------------------------------------------------
# A loss counts when it makes the data of the flight incomplete: it lies, or may lie, in the flight, and its topics are
# not tolerated. Of dropped messages nobody knows the time; they count whenever they were dropped.


EDGE_NS = 2 * SECOND  # from takeoff or landing to a status that says so, and to a request, on a busy computer
_SET_BACK = "its clock was set back during the recording: its record times do not tell what was lost in the flight"
Span = Tuple[int, Optional[int]]


class Loss(NamedTuple):
    """What was lost, in words, and whether the data of the flight is incomplete because of it."""

    words: str
    counts: bool = True


class Wanted(NamedTuple):
    """What was to be recorded of a platform, on its clock.

    Args:
        end_ns: when the recording was to end; None: unknown.
        flights: from takeoff to landing (None: not landed yet); None: nobody said when it flew, so all of it counts.
        tolerated: topics that may be lost.
        topics: of each group; a group that is not there records what nobody knows.
        sure: whether the times are right; else its clock may have been stepped, and what was lost counts in any case.
    """

    end_ns: Optional[int] = None
    flights: Optional[Sequence[Span]] = None
    tolerated: FrozenSet[str] = frozenset()
    topics: Mapping[str, Sequence[str]] = {}
    sure: bool = True

    def counts(self, group: str, from_ns: Optional[int], to_ns: Optional[int]) -> bool:
        """Return whether what a group did not record in a time makes the data incomplete; None: unknown."""
        if self.topics.get(group) and self.tolerated.issuperset(self.topics[group]):
            return False
        if self.flights is None or from_ns is None or not self.sure:
            return True
        return any(
            (end_ns is None or from_ns < end_ns) and (to_ns is None or to_ns > begin_ns)
            for begin_ns, end_ns in self.flights
        )


def losses(content: Mapping[str, Any], wanted: Wanted = Wanted()) -> List[Loss]:  # noqa: B008  (it is a value)
    """Return what a part has lost.

    Args:
        content: its list (`parts.py`).
        wanted: what was to be recorded.
    """
    set_back = bool(content.get("set_back"))
    wanted = wanted._replace(sure=wanted.sure and not set_back)
    until_ns = wanted.end_ns if wanted.sure else None
    gaps = [gap for gap in (_until(each, until_ns) for each in content.get("gaps", [])) if gap is not None]
    found = [Loss(_SET_BACK)] if set_back else []
    found += _of_files(content, gaps, wanted)
    found += _of_gaps(gaps, wanted)
    found += _of_ends(content.get("open_ends", {}), wanted)
    found += _of_edges(content.get("recorded", {}), content.get("open_ends", {}), wanted)
    return found + _of_drops(content.get("dropped", 0), content.get("missing", {}), wanted)


def _until(gap: Mapping[str, Any], end_ns: Optional[int]) -> Optional[Mapping[str, Any]]:
    """Return a gap as far as it lies before the end: what came after it was not to be recorded. None: all of it did."""
    from_ns, to_ns = gap.get("from_ns"), gap.get("to_ns")
    if end_ns is None or from_ns is None or (to_ns is not None and to_ns <= end_ns):
        return gap
    if from_ns >= end_ns:
        return None
    kept = {key: value for key, value in gap.items() if key != "missing"}  # nobody knows how many of them came before
    return {**kept, "to_ns": end_ns, "seconds": (end_ns - from_ns) / SECOND}


def _of_files(content: Mapping[str, Any], gaps: Sequence[Mapping[str, Any]], wanted: Wanted) -> List[Loss]:
    """Return what files lack; of one that was left open, what its end lacks lies in the gap that follows it.

    What it lacks before that may lie anywhere in it, so it counts whenever the gap is.
    """
    after = {(str(gap["group"]), int(gap["file"]) - 1): gap for gap in gaps if not gap.get("inside")}
    found: List[Loss] = []
    last = _last_numbers(content)
    for entry in content["files"]:
        lost, inside = entry.get("lost", 0), entry.get("lost_inside", 0)
        file = written(str(entry.get("recovered_from", "")))
        left_open = file is not None and not file.closed
        group, number = (file.group, file.number) if file is not None else ("", 0)
        gap = after.get((group, number)) if left_open else None
        at_end = left_open and number == last.get(group)  # what one before it lacks is no end of the group
        last_ns = content.get("open_ends", {}).get(group) if at_end else None
        changed = ", it has changed since it was listed" if entry.get("changed") else ""
        changed += f", {entry['undo_damaged']} is damaged" if entry.get("undo_damaged") else ""
        if lost == 0:
            continue
        times: Tuple[Optional[int], Optional[int]] = (None, None)
        if inside == 0 and not changed:
            if lost is None and (gap is not None or _is_end_told(last_ns, wanted)):
                continue
            if gap is not None:
                times = gap.get("from_ns"), gap.get("to_ns")
            elif lost is None and last_ns is not None:
                times = last_ns, wanted.end_ns
        counts = wanted.counts(group, *times)
        how_many = "an unknown number of messages" if lost is None else f"{lost:,} messages"
        how_many = f"at least {inside:,} messages" if lost is None and inside else how_many
        what = "nothing of it can be read" if entry.get("unreadable") else how_many
        found.append(Loss(f"{entry['file']}: {what}{changed}", counts))
    gone = content.get("gone", ())
    return found + [Loss(f"{name}: all of it, it was listed and is not there any more") for name in gone]


def _last_numbers(content: Mapping[str, Any]) -> Dict[str, int]:
    """Return the number of the last file of each group."""
    last: Dict[str, int] = {}
    for entry in content["files"]:
        file = written(str(entry.get("recovered_from") or entry["file"]))
        if file is not None:
            last[file.group] = max(file.number, last.get(file.group, 0))
    return last


def _is_end_told(last_ns: Optional[int], wanted: Wanted) -> bool:
    """Return whether what the end of an open file lacks is told as such, or came after the stop."""
    if last_ns is None or wanted.end_ns is None:
        return False
    return not wanted.sure or not 0 < wanted.end_ns - last_ns < _LEAST_NS


def _of_gaps(gaps: Sequence[Mapping[str, Any]], wanted: Wanted) -> List[Loss]:
    """Return the times in which a group was not recorded, one line for each group and cause."""
    found: Dict[Tuple[str, str, bool, bool], List[Mapping[str, Any]]] = {}
    for gap in gaps:
        counts = wanted.counts(gap["group"], gap.get("from_ns"), gap.get("to_ns"))
        found.setdefault((gap["group"], gap["ending"], gap["seconds"] is None, counts), []).append(gap)
    return [Loss(_of_cause(group, ending, mine), counts) for (group, ending, _, counts), mine in found.items()]


def _of_cause(group: str, ending: str, gaps: Sequence[Mapping[str, Any]]) -> str:
    times = "" if len(gaps) == 1 else f"{len(gaps)} times, together "
    known = [gap["seconds"] for gap in gaps if gap["seconds"] is not None]
    how_long = f"{sum(known):.1f} s" if known else "an unknown time (its clock was set back)"
    missing = sum(gap.get("missing", 0) for gap in gaps)
    counted = f", at least {missing:,} messages," if missing else ","
    return f"{group}: {times}{how_long}{counted} in which nothing was recorded ({ending})"


def _of_ends(open_ends: Mapping[str, int], wanted: Wanted) -> List[Loss]:
    """Return the ends of groups whose last file was not closed."""
    end_ns = wanted.end_ns
    if end_ns is None:
        return []
    found: List[Loss] = []
    for group, last_ns in open_ends.items():
        if wanted.sure and end_ns - last_ns < _LEAST_NS:
            continue
        how_long = f"up to {(end_ns - last_ns) / SECOND:.1f} s" if wanted.sure else "an unknown time"
        words = f"{group}: {how_long} at the end (its last file was not closed)"
        found.append(Loss(words, wanted.counts(group, last_ns, end_ns)))
    return found


def _of_edges(spans: Mapping[str, Sequence[Optional[int]]], open_ends: Mapping[str, int], wanted: Wanted) -> List[Loss]:
    """Return what lies between the flight and a recording that began after its takeoff or ended before it did."""
    if wanted.flights is not None and not wanted.flights:
        return []
    takeoff_ns, landing_ns = (wanted.flights[0][0], wanted.flights[-1][1]) if wanted.flights else (0, None)
    until_ns = min((each for each in (landing_ns, wanted.end_ns) if each is not None), default=0)
    found: List[Tuple[str, str, Optional[int], Optional[int]]] = []
    for group, (begin_ns, end_ns) in spans.items():
        told = group in open_ends and wanted.end_ns is not None
        if begin_ns is None:
            found.append((group, "nothing of it was recorded", None, None))
        elif takeoff_ns and begin_ns - takeoff_ns > EDGE_NS:
            late = f"the first {(begin_ns - takeoff_ns) / SECOND:.1f} s of the flight"
            found.append((group, f"{late}: its recording was begun after the takeoff", takeoff_ns, begin_ns))
        if end_ns is not None and until_ns - end_ns > EDGE_NS and not told:
            words = f"the last {(until_ns - end_ns) / SECOND:.1f} s: its recording was ended before"
            found.append((group, words, end_ns, until_ns))
    return [Loss(f"{group}: {words}", wanted.counts(group, *times)) for group, words, *times in found]


def _of_drops(warnings: int, missing: Mapping[str, int], wanted: Wanted) -> List[Loss]:
    counted = sum(missing.values())
    if not warnings and not counted:
        return []
    why = []
    if counted:
        topics = ", ".join(f"{count:,} of {topic}" for topic, count in sorted(missing.items()))
        why.append(f"by the numbers in headers: {topics}")
    if warnings:
        why.append(f"warnings of the recorder: {warnings}, one in 5 s at most; topics without numbers are not counted")
    most = max(warnings, counted)
    words = f"at least {most:,} message{'' if most == 1 else 's'} dropped ({'; '.join(why)})"
    return [Loss(words, bool(warnings) or not wanted.tolerated.issuperset(missing))]


# --- another configuration --------------------------------------------------------------------------------------------


def not_configured(
    content: Mapping[str, Any], wanted: Mapping[str, Configured], tolerated: FrozenSet[str]
) -> List[Loss]:
    """Return what was wanted of a part and is not in the configuration that it was recorded by.

    Args:
        content: its list.
        wanted: the groups of its platform in the collector's configuration.
        tolerated: topics that may be lost.
    """
    topics, expressions = lacking(content, wanted)
    counted = [topic for topic in topics if topic not in tolerated]
    others = [topic for topic in topics if topic in tolerated]
    return [
        *(Loss(words) for words in lacking_words(counted)),
        *(Loss(words, counts=False) for words in lacking_words(others)),
        *(Loss(words) for words in lacking_words((), expressions)),
    ]
