"""The numbers that publishers put into headers (std_msgs/Header, seq), and which of them a bag lacks.

rospy and roscpp count the messages of each publisher and write the count over whatever the header said. So a number
that is missing between two that were recorded is a message that was published and not recorded: dropped on its way, or
by the recorder. Only topics whose messages begin with a header have them; a publisher that skips numbers itself, or
does not count, is left out: most of its steps are not one. So what is found is a lower bound.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Dict, Iterable, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from amaze_autonomy.bags.arrays import words
from amaze_autonomy.bags.connections import Connection
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.loading import Loader, Pool

__all__ = ["Numbers", "Stream", "between", "header_numbers", "numbers_of"]

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
        counts: whether they count: most steps are one.
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
    counts = bool((steps == 1).sum() * 2 > len(steps))
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
        wanted = {each.number for each in index.connections.values() if _has_header(each)}
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
    """Return the chunks with messages of some connections, a few of one kind together."""
    groups: List[List[int]] = []
    kind = None
    for number, chunk in enumerate(index.chunks):
        if not any(connection in wanted for connection, _ in chunk.counts):
            continue
        compression = index.head(number).compression
        if not groups or compression != kind or len(groups[-1]) >= _GROUP:
            groups.append([])
        groups[-1].append(number)
        kind = compression
    return groups


def _has_header(connection: Connection) -> bool:
    """Return whether messages begin with a header, by their definition."""
    begin = connection.header.find(b"message_definition=")
    text = connection.header[begin + len(b"message_definition=") :].decode("utf-8", "replace") if begin >= 0 else ""
    for line in text.split("\n"):
        words_of = line.split("#", 1)[0].strip()
        if words_of and "=" not in words_of:
            return _HEADER.match(words_of) is not None
    return False
