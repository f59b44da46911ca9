"""Is a merged bag what it should be: every message of its inputs once, in order of time, readable by everybody.

Everybody: the rosbags library, Debian's and Noetic's rosbag in Python, and librosbag in C++. Each that is installed is
asked in a process of its own, so that none can do harm and none is imported here.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.files import sha256_of

from ..errors import BagError
from ..format import MEMORY
from ..index import Index
from ..read import Block, Pool
from .manifest import Tallies, Tally, TopicKey, checksums, payload_checksums, tallies_of
from .merge import Source

if TYPE_CHECKING:  # a circle
    from .filter import Selection

# --- all messages counted ---------------------------------------------------------------------------------------------


Progress = Callable[[int, int], None]


class Counted(NamedTuple):
    """What a bag has.

    Args:
        path: of the bag.
        size: in bytes.
        messages: all of them.
        start_ns: time of the first; None when there is none.
        end_ns: time of the last; None when there is none.
        ordered: whether they lie in the file in order of time.
        topics: tallies by topic, type and md5; times are shifted as asked.
        crc_sums: the sum of the CRC-32 of all messages, by topic.
    """

    path: Path
    size: int
    messages: int
    start_ns: Optional[int]
    end_ns: Optional[int]
    ordered: bool
    topics: Dict[TopicKey, Tally]
    crc_sums: Dict[str, int]


class _Counter:
    def __init__(self, index: Index) -> None:
        self._connections = index.connections
        self.tallies = Tallies()
        self.crc_sums: Dict[str, int] = {}
        self.first: Optional[int] = None
        self.last: Optional[int] = None
        self.ordered = True

    def add(self, block: Block) -> None:
        table = block.table
        if not len(table.t_ns):
            return
        crc = payload_checksums(block.buffer, table.payload.tolist(), table.end.tolist())
        sums = checksums(crc, table.end - table.payload, table.t_ns)
        order = np.argsort(table.connection, kind="stable")
        numbers = table.connection[order]
        firsts = np.flatnonzero(np.diff(numbers, prepend=-1))
        counts = np.diff(np.append(firsts, len(numbers)))
        columns = (numbers[firsts], counts, np.add.reduceat(sums[order], firsts), np.add.reduceat(crc[order], firsts))
        for each in zip(*(column.tolist() for column in columns)):
            self._add(*each)
        self._follow(table.t_ns)

    def _add(self, number: int, messages: int, checksum: int, crc_sum: int) -> None:
        each = self._connections[number]
        self.tallies.add((each.topic, each.kind, each.md5), Tally(messages, checksum))
        self.crc_sums[each.topic] = self.crc_sums.get(each.topic, 0) + crc_sum

    def _follow(self, t_ns: Any) -> None:
        if bool((np.diff(t_ns) < 0).any()) or (self.last is not None and int(t_ns[0]) < self.last):
            self.ordered = False
        first, last = int(t_ns.min()), int(t_ns.max())
        self.first = first if self.first is None else min(self.first, first)
        self.last = last if self.last is None else max(self.last, last)


def count(
    path: Path,
    shift_ns: int = 0,
    progress: Optional[Progress] = None,
    selection: Optional[Selection] = None,
    *,
    memory: int = MEMORY,
) -> Counted:
    """Read all of a bag, or a selection of its messages; check every chunk against its index.

    Raises:
        BagError: It is damaged.
    """
    with Index(path, memory) as index, Pool() as pool:
        counter = _Counter(index)
        target = np.arange(max(index.connections, default=0) + 1)
        source = Source(index, 0, target, shift_ns, set(), np.zeros(len(target), bool), selection=selection)
        total, done = sum(chunk.end - chunk.position for chunk in index.chunks), 0
        counter.ordered = _chunks_in_order(index)
        while source.more:
            group = source.take()
            for block in group.load(pool):
                counter.add(block)
                pool.put(block.buffer)
            done += group.size
            if progress:
                progress(done, total)
        messages = sum(tally.messages for tally in counter.tallies.by_topic.values())
        return Counted(
            path,
            index.size,
            messages,
            counter.first,
            counter.last,
            counter.ordered,
            counter.tallies.by_topic,
            counter.crc_sums,
        )


def _chunks_in_order(index: Index) -> bool:
    filled = [chunk.start_ns for chunk in index.chunks if chunk.counts]
    return filled == sorted(filled)


# --- what other readers say -------------------------------------------------------------------------------------------


_LIMIT_S = 3600

_NOT_HERE = 69
"""EX_UNAVAILABLE of sysexits.h: the module cannot be imported, or is a folder of that name and nothing more."""
_IMPORT = """
import sys
try:
    import {module} as found
except Exception:
    found = None
if getattr(found, "__file__", None) is None:
    sys.exit({status})
"""
_ROSBAGS = """
import json, sys, zlib
from pathlib import Path
from rosbags.rosbag1 import Reader
with Reader(Path(sys.argv[1])) as reader:
    counts, sums = {}, {}
    for each in reader.connections:
        counts[each.topic] = counts.get(each.topic, 0) + each.msgcount
    if sys.argv[2] == "read":
        counts = dict.fromkeys(counts, 0)
        for connection, _, raw in reader.messages():
            counts[connection.topic] += 1
            sums[connection.topic] = sums.get(connection.topic, 0) + zlib.crc32(raw)
json.dump({"messages": counts, "crc_sums": sums}, sys.stdout)
"""
_ROSBAG = """
import json, sys, zlib
import rosbag
with rosbag.Bag(sys.argv[1]) as bag:
    topics = bag.get_type_and_topic_info().topics
    counts, sums = {name: each.message_count for name, each in topics.items()}, {}
    if sys.argv[2] == "read":
        counts = dict.fromkeys(counts, 0)
        for topic, message, _ in bag.read_messages(raw=True):
            counts[topic] += 1
            sums[topic] = sums.get(topic, 0) + zlib.crc32(message[1])
json.dump({"messages": counts, "crc_sums": sums}, sys.stdout)
"""
_READERS = (("rosbags", "rosbags.rosbag1", _ROSBAGS), ("rosbag", "rosbag", _ROSBAG))


class Reading(NamedTuple):
    """What a reader says.

    Args:
        reader: its name.
        messages: by topic; those without messages are left out.
        crc_sums: the sum of the CRC-32 of all messages by topic; empty when they were not read.
        error: why it could not read; "" when it could.
    """

    reader: str
    messages: Dict[str, int]
    crc_sums: Dict[str, int]
    error: str = ""


def read_with(path: Path, *, every_message: bool) -> List[Reading]:
    """Ask all readers that are installed.

    Args:
        path: of the bag.
        every_message: whether each message is to be read, or the index alone.
    """
    how = "read" if every_message else "open"
    asked = (_asked(reader, module, script, [str(path.resolve()), how]) for reader, module, script in _READERS)
    readings = [each for each in asked if each is not None]
    if every_message and _librosbag():
        readings.append(_copied_by_librosbag(path))
    return readings


def disagreements(counted: Counted, readings: List[Reading]) -> List[str]:
    """Return where other readers see something else, one line each."""
    messages: Dict[str, int] = {}
    for (topic, _, _), tally in counted.topics.items():
        messages[topic] = messages.get(topic, 0) + tally.messages
    found = []
    for each in readings:
        if each.error:
            found.append(f"{each.reader} cannot read it: {each.error}")
        elif each.messages != messages:
            found.append(f"{each.reader} counts other messages: {_difference(each.messages, messages)}")
        elif each.crc_sums and each.crc_sums != counted.crc_sums:
            found.append(f"{each.reader} reads other bytes: {_difference(each.crc_sums, counted.crc_sums)}")
    return found


def _difference(one: Dict[str, int], other: Dict[str, int]) -> str:
    topics = [topic for topic in sorted({*one, *other}) if one.get(topic, 0) != other.get(topic, 0)]
    return ", ".join(f"{topic} {one.get(topic, 0)} instead of {other.get(topic, 0)}" for topic in topics)


def _asked(reader: str, module: str, script: str, arguments: Sequence[str]) -> Optional[Reading]:
    """Return what a reader says, in this interpreter, else in the system's; None: neither can import its module.

    A shell of ROS tells every interpreter where rosbag is; what that imports, one that stands alone does not have. They
    work at the root of the file system: an interpreter imports from its working folder before all others.
    """
    script = _IMPORT.format(module=module, status=_NOT_HERE) + script
    for python in filter(shutil.which, (sys.executable, "/usr/bin/python3")):
        command = [python, "-c", script, *arguments]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False, cwd="/")
        except subprocess.TimeoutExpired:
            return Reading(reader, {}, {}, f"no answer within {_LIMIT_S} s")
        if done.returncode == _NOT_HERE:
            continue
        if done.returncode:
            return Reading(reader, {}, {}, _last_line(done.stderr))
        said: Dict[str, Any] = json.loads(done.stdout)
        counts = {topic: number for topic, number in said["messages"].items() if number}
        return Reading(reader, counts, said["crc_sums"])
    return None


def _last_line(text: str) -> str:
    return (text.strip().splitlines() or ["it said nothing"])[-1]


def _librosbag() -> Optional[Path]:
    """Return the only tool of rosbag that is C++ and needs no roscore: it reads all messages and writes them again."""
    rosbag = shutil.which("rosbag")
    if not rosbag:
        return None
    tool = Path(rosbag).resolve().parents[1] / "lib" / "rosbag" / "encrypt"
    return tool if tool.is_file() else None


def _copied_by_librosbag(path: Path) -> Reading:
    beside = path.parent if os.access(path.parent, os.W_OK) else None  # on a read-only medium it cannot be
    with tempfile.TemporaryDirectory(dir=beside, prefix=".librosbag-") as folder:
        copy = Path(folder) / "copy.bag"
        command = [str(_librosbag()), "-q", "-p", "rosbag/NoEncryptor", str(path), "-o", str(copy)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S, check=False)
        if done.returncode or not copy.is_file():
            return Reading("librosbag", {}, {}, _last_line(done.stderr))
        try:
            counted = count(copy)
        except BagError as error:
            return Reading("librosbag", {}, {}, str(error))
    messages: Dict[str, int] = {}
    for (topic, _, _), tally in counted.topics.items():
        messages[topic] = messages.get(topic, 0) + tally.messages
    return Reading("librosbag", messages, counted.crc_sums)


# --- the verdict ------------------------------------------------------------------------------------------------------


class Verified(NamedTuple):
    """What was found.

    Args:
        output: what the merged bag has.
        inputs: what its inputs have.
        duplicates: messages that were declared as dropped.
        readings: what other readers say.
        problems: one line each; none when all is well.
    """

    output: Counted
    inputs: Tuple[Counted, ...]
    duplicates: Dict[TopicKey, Tally]
    readings: Tuple[Reading, ...]
    problems: Tuple[str, ...]


def verify(
    output: Path,
    inputs: Sequence[Path],
    *,
    offsets_ns: Sequence[int] = (),
    duplicates: Optional[Dict[TopicKey, Tally]] = None,
    before: Optional[Mapping[str, Any]] = None,
    readers: str = "open",
    memory: int = MEMORY,
    progress: Optional[Progress] = None,
    selection: Optional[Selection] = None,
) -> Verified:
    """Compare a merged bag with its inputs, message by message.

    Args:
        output: the merged bag.
        inputs: what it was merged from; none to verify the bag alone.
        offsets_ns: that were added to the record times of each input.
        duplicates: messages that were dropped because another input has them.
        before: what the manifest says of the bag since it was verified, to be compared with that instead of inputs.
        readers: none, open (they read the index) or read (they read every message).
        memory: bytes that the data of a chunk may take when it is decompressed.
        progress: called with bytes done and all bytes.
        selection: of the messages of each input that the output has; None: all.

    Raises:
        BagError: A bag is damaged: where an input is, that one is named, whose damage the output may have.
    """
    shifts = [0, *(offsets_ns or [0] * len(inputs))]
    paths = [output, *inputs]
    report = _together(paths, progress)
    selections = [None, *([selection] * len(inputs))]
    with ThreadPoolExecutor(2) as pool:
        jobs = [pool.submit(count, *each, memory=memory) for each in zip(paths, shifts, report, selections)]
        counted = _results(jobs)
    readings = read_with(output, every_message=readers == "read") if readers != "none" else []
    problems = disagreements(counted[0], readings)
    if not counted[0].ordered:
        problems.insert(0, "its messages are not in order of time")
    if inputs:
        problems = [*_differences(counted[0], _expected(counted[1:], duplicates or {})), *problems]
    elif before is not None:
        problems = [*_changes(counted[0], before), *problems]
    return Verified(counted[0], tuple(counted[1:]), duplicates or {}, tuple(readings), tuple(problems))


def _results(jobs: Sequence[Future[Counted]]) -> List[Counted]:
    """Return the counts of output and inputs; what is wrong with an input counts first."""
    try:
        inputs = [job.result() for job in jobs[1:]]
        return [jobs[0].result(), *inputs]
    finally:
        for job in jobs:
            job.cancel()  # once one is damaged, nobody waits for the others


def _together(paths: Sequence[Path], progress: Optional[Progress]) -> List[Optional[Progress]]:
    """Return a progress function for each bag that reports the sum of all."""
    if progress is None:
        return [None] * len(paths)
    done, total = dict.fromkeys(range(len(paths)), 0), sum(path.stat().st_size for path in paths if path.is_file())
    show = progress

    def reporter(place: int) -> Progress:
        def report(bytes_done: int, _: int) -> None:
            done[place] = bytes_done
            show(sum(done.values()), total)

        return report

    return [reporter(place) for place in range(len(paths))]


def _changes(output: Counted, before: Mapping[str, Any]) -> List[str]:
    """Return where a bag is not what it was when it was verified."""
    found = _differences(output, tallies_of(before["topics"]))
    if not found and sha256_of(output.path) != before["sha256"]:
        found.append("it is not the file that was verified: its sha256 is another one")
    return found


def _expected(inputs: Sequence[Counted], duplicates: Dict[TopicKey, Tally]) -> Dict[TopicKey, Tally]:
    expected = Tallies()
    for counted in inputs:
        for key, tally in counted.topics.items():
            expected.add(key, tally)
    for key, tally in duplicates.items():
        expected.by_topic[key] = expected.by_topic.get(key, Tally()).minus(tally)
    return expected.by_topic


def _differences(output: Counted, expected: Dict[TopicKey, Tally]) -> List[str]:
    problems = []
    for key in sorted({*expected, *output.topics}):
        wanted, found = expected.get(key, Tally()), output.topics.get(key, Tally())
        if wanted.messages != found.messages:
            problems.append(f"{key[0]} ({key[1]}) has {found.messages:,} messages instead of {wanted.messages:,}")
        elif wanted != found:
            problems.append(f"{key[0]} ({key[1]}) has messages with other bytes or times than its inputs")
    return problems
