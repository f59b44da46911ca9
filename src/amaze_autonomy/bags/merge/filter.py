"""A part of a bag as a bag: some topics, some types, some time; with the guarantees of a merge of this one bag.

What is left out is not read where whole chunks of it can be passed over. Messages are copied as slices of bytes, in
order of time; chunks that are wanted as a whole stay compressed where a merge would leave them so.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Dict, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ..arrays import check_index
from ..errors import BagError
from ..format import MEMORY
from ..index import ChunkInfo, Index
from .merge import Merged, MergeOptions, Progress, merge
from .verify import Verified, verify

_ALWAYS_NS = 1 << 62


class Part(NamedTuple):
    """What is wanted of a bag. Patterns are those of a shell: `/camera/*`; none wants all.

    Args:
        topics: patterns of topics that are wanted.
        without: patterns of topics that are not.
        types: patterns of their types, e.g. `sensor_msgs/*`.
        begin_ns: from this time on.
        end_ns: before this time.
        relative: both times are counted from the first message.
        latched: of latched topics also the last message before the beginning, with its own time.
    """

    topics: Tuple[str, ...] = ()
    without: Tuple[str, ...] = ()
    types: Tuple[str, ...] = ()
    begin_ns: int = 0
    end_ns: Optional[int] = None
    relative: bool = True
    latched: bool = False


class Selection(NamedTuple):
    """Messages of one bag.

    Args:
        wanted: for each connection, whether its messages are wanted.
        begin_ns: from this time on.
        end_ns: before this time.
        kept: for each connection, a time before the beginning whose message is wanted as well; -1: none is.
        used: connections of which a message is left.
    """

    wanted: Any
    begin_ns: int
    end_ns: int
    kept: Any
    used: Tuple[int, ...]

    def mask(self, t_ns: Any, connection: Any) -> Any:
        """Return for each message whether it is wanted."""
        inside = (t_ns >= self.begin_ns) & (t_ns < self.end_ns)
        return self.wanted[connection] & (inside | (t_ns == self.kept[connection]))

    def touches(self, chunk: ChunkInfo) -> bool:
        """Return whether a chunk may hold a message that is wanted."""
        numbers = [number for number, _ in chunk.counts if self.wanted[number]]
        inside = chunk.start_ns < self.end_ns and chunk.end_ns >= self.begin_ns
        early = any(chunk.start_ns <= self.kept[number] <= chunk.end_ns for number in numbers)
        return bool(numbers) and (inside or early)

    def holds(self, chunk: ChunkInfo) -> bool:
        """Return whether all messages of a chunk are wanted."""
        inside = self.begin_ns <= chunk.start_ns and chunk.end_ns < self.end_ns
        return inside and all(self.wanted[number] for number, _ in chunk.counts)


def selection_of(index: Index, part: Part) -> Selection:
    """Return the messages of a bag that are wanted.

    Raises:
        BagError: No message of it is, or its chunks have messages of other times than its index says.
    """
    topics = sorted({each.topic for each in index.connections.values()})
    for pattern in (*part.topics, *part.without):
        if not any(fnmatchcase(topic, pattern) for topic in topics):
            raise BagError(str(index.path), f"has no topic {pattern}", f"it has {', '.join(topics)}")
    found = check_index(index)
    first_ns = int(found.t_ns.min()) if part.relative and len(found.t_ns) else 0
    begin_ns = first_ns + part.begin_ns
    end_ns = _ALWAYS_NS if part.end_ns is None else first_ns + part.end_ns
    wanted: Any = np.zeros(max(index.connections, default=0) + 1, bool)
    for number, each in index.connections.items():
        named = not part.topics or _matches(each.topic, part.topics)
        typed = not part.types or _matches(each.kind, part.types)
        wanted[number] = named and typed and not _matches(each.topic, part.without)
    kept: Any = np.full(len(wanted), -1, np.int64)
    if part.latched:
        for number, each in index.connections.items():
            if each.latching and wanted[number]:
                before = found.t_ns[(found.connection == number) & (found.t_ns < begin_ns)]
                kept[number] = before.max(initial=-1)
    selection = Selection(wanted, begin_ns, end_ns, kept, ())
    used = np.unique(found.connection[selection.mask(found.t_ns, found.connection)])
    if not len(used):
        raise BagError(str(index.path), "has no message that is wanted", "want other topics, types or times")
    return selection._replace(used=tuple(used.tolist()))


def _matches(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def filter_bag(
    source: Path,
    output: Path,
    part: Part,
    options: Optional[MergeOptions] = None,
    progress: Optional[Progress] = None,
) -> Merged:
    """Write a part of a bag as a bag, which appears when it is whole and on the disk.

    Args:
        source: path of the bag; never changed.
        output: path of the new one.
        part: what is wanted.
        options: how; offsets and duplicates are none.
        progress: called with bytes done and all bytes.

    Raises:
        BagError: The bag cannot be used, no message is wanted, or the output not be written.
    """
    options = (options or MergeOptions())._replace(duplicates="ignore", offsets_ns=())
    with Index(source, options.memory) as index:
        selection = selection_of(index, part)
    return merge([source], output, options._replace(selection=selection), progress)


def verify_part(
    source: Path,
    output: Path,
    part: Part,
    *,
    readers: str = "open",
    memory: int = MEMORY,
    progress: Optional[Progress] = None,
) -> Verified:
    """Compare a part with the bag that it was taken from, message by message.

    Raises:
        BagError: One of them is damaged.
    """
    with Index(source, memory) as index:
        selection = selection_of(index, part)
    how: Dict[str, Any] = {"readers": readers, "memory": memory, "progress": progress}
    return verify(output, [source], selection=selection, **how)
