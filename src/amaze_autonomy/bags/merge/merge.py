"""Several bags into one, in order of time, without decoding a message.

Message records are copied as slices of bytes; only connection numbers, and times when clocks are corrected, are written
into them before. Inputs are read a few megabytes at a time, always from the one that is behind, so that memory does not
depend on their size but on how far their chunks overlap. Compressed chunks that overlap no other are copied as they
are. Messages of the same time come in the order of the inputs, then in that of their chunks' first times.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, suppress
from functools import cached_property
from itertools import accumulate, groupby, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np

from amaze_autonomy.units import SECOND

from ..arrays import UNSET_NS, Table, by_connection, check_times, relabel, set_back
from ..errors import BagError
from ..format import MEMORY, UNDECODABLE, UNREADABLE, Connection, Identity
from ..index import ChunkHead, ChunkInfo, Index
from ..read import GROUP_BYTES, Block, Loader, Pool
from ..write import Output, refuse_input
from .manifest import Tally
from .writer import Writing

if TYPE_CHECKING:  # loading them all would be a good part of a short run
    from .filter import Selection
    from .lz4_chunk_copy import ChunkCopies

# --- which connections are one ----------------------------------------------------------------------------------------


class Unified(NamedTuple):
    """Connections of the merged bag.

    Args:
        connections: by number.
        targets: for each input, an array from its numbers to ours.
        comparable: numbers that inputs of several origins have on the same topic; the same value for those whose
            messages may be the same ones.
        warnings: topics with more than one definition, or with one that others cannot read, or nobody.
    """

    connections: Dict[int, Connection]
    targets: List[Any]
    comparable: Dict[int, int]
    warnings: Tuple[str, ...]


def unify(inputs: Sequence[Index], origins: Sequence[int], *, publishers_apart: bool) -> Unified:
    """Give the same number to connections that are the same; keep the numbers of the first input.

    What is kept of them is the first description that defines the type, one that others can read before one that they
    cannot: md5s that are the same cover all of it but comments and spaces, but some writers leave the text away, and
    without it nobody can read a message. One that is damaged is taken of any other topic of the same type and md5.
    """
    numbers: Dict[Identity, int] = {}
    connections: Dict[int, Connection] = {}
    targets = []
    free = 0
    sources: Dict[int, Set[int]] = {}
    for origin, index in zip(origins, inputs):
        target: Any = np.zeros(max(index.connections, default=0) + 1, np.int64)
        for number, connection in sorted(index.connections.items()):
            identity = connection.identity(publishers_apart=publishers_apart)
            if identity not in numbers:
                numbers[identity] = number if number not in connections else free
                free = max(free, numbers[identity] + 1)
                connections[numbers[identity]] = connection._replace(number=numbers[identity])
            elif _worth(connection) > _worth(connections[numbers[identity]]):
                connections[numbers[identity]] = connection._replace(number=numbers[identity])
            target[number] = numbers[identity]
            sources.setdefault(numbers[identity], set()).add(origin)
        targets.append(target)
    _define(connections)
    return Unified(connections, targets, _comparable(connections, sources), _warnings(connections))


def _worth(connection: Connection) -> Tuple[bool, bool]:
    return bool(connection.definition) and not connection.is_damaged, connection.is_readable


def _define(connections: Dict[int, Connection]) -> None:
    """Give connections with a damaged definition that of another one of the same type and md5."""
    good = {(each.kind, each.md5): each for each in connections.values() if each.definition and not each.is_damaged}
    for number, each in connections.items():
        other = good.get((each.kind, each.md5))
        if each.is_damaged and other is not None:
            connections[number] = each.defined_by(other)


def _comparable(connections: Dict[int, Connection], sources: Dict[int, Set[int]]) -> Dict[int, int]:
    """Group connections of one topic and definition, by publisher where every input knows it."""
    topics: Dict[Tuple[str, str, str], List[int]] = {}
    for number, each in connections.items():
        topics.setdefault((each.topic, each.kind, each.md5), []).append(number)
    groups: List[List[int]] = []
    for members in topics.values():
        callers: Dict[str, List[int]] = {}
        for number in members:
            callers.setdefault(connections[number].caller, []).append(number)
        groups.extend([members] if "" in callers else callers.values())
    several = [group for group in groups if len(set().union(*(sources[number] for number in group))) > 1]
    return {number: min(group) for group in several for number in group}


def _warnings(connections: Dict[int, Connection]) -> Tuple[str, ...]:
    definitions: Dict[str, Set[Tuple[str, str]]] = {}
    for each in connections.values():
        definitions.setdefault(each.topic, set()).add((each.kind, each.md5))
    several = [
        f"{topic} has {len(found)} definitions, which stay apart: "
        + ", ".join(f"{kind} ({md5})" for kind, md5 in sorted(found))
        for topic, found in sorted(definitions.items())
        if len(found) > 1
    ]
    undecodable = {each.topic for each in connections.values() if each.is_damaged}
    unreadable = {each.topic for each in connections.values() if not each.is_readable} - undecodable
    several += [f"{topic}: {UNDECODABLE}" for topic in sorted(undecodable)]
    return (*several, *(f"{topic}: {UNREADABLE}; it is written as text" for topic in sorted(unreadable)))


# --- one input --------------------------------------------------------------------------------------------------------


_SAMPLE = 3
_BESIDE = 200  # bytes that the output has for a chunk beside its data
_CHECKED_TOGETHER = 4  # chunks that are decompressed at a time only to be checked: as many as there are workers do


class Group(NamedTuple):
    """Chunks to be loaded together, or one to be copied as it is."""

    source: Source
    chunks: List[int]
    verbatim: bool

    @property
    def size(self) -> int:
        """Return its bytes in the input."""
        chunks = self.source.index.chunks
        return sum(chunks[number].end - chunks[number].position for number in self.chunks)

    @property
    def first_ns(self) -> int:
        """Return the time of its first message."""
        return self.source.start_ns(self.chunks[0])

    def load(self, pool: Pool) -> List[Block]:
        """Read, check and relabel the messages; none of a chunk that is copied as it is."""
        if not self.verbatim:
            return self.source.load(self.chunks, pool)
        self.source.check_copied(self.chunks, pool)
        return []


class Source:
    """Reads a bag's chunks in order of their first messages.

    Args:
        index: of the bag.
        number: of the input.
        target: the connection's number in the output, by its number here.
        shift_ns: added to record times.
        verbatim: chunks that are copied as they are.
        unseen: for each connection here, whether the bytes of its messages need not be seen.
        chunk_copies: loads chunks that are to stay compressed; None when none is.
        selection: of its messages; None: all.
        checks_copied: whether what is copied compressed is decompressed all the same, to be checked.

    Raises:
        BagError: The index counts no message in a chunk that has some.
    """

    def __init__(
        self,
        index: Index,
        number: int,
        target: Any,
        shift_ns: int,
        verbatim: Set[int],
        unseen: Any,
        chunk_copies: Optional[ChunkCopies] = None,
        selection: Optional[Selection] = None,
        *,
        checks_copied: bool = False,
    ) -> None:
        self.index, self.number, self.checks_copied = index, number, checks_copied
        self._loader, self._chunk_copies = Loader(index, number, unseen), chunk_copies
        self._target, self._shift_ns, self._verbatim = target, shift_ns, verbatim
        chunks, self._selection = index.chunks, selection
        self._order = [
            each
            for each in sorted(range(len(chunks)), key=lambda each: (chunks[each].start_ns, each))
            if chunks[each].counts and (selection is None or selection.touches(chunks[each]))
        ]
        self._next = 0
        index.check_empty()

    @property
    def next_ns(self) -> int:
        """Return the time before which nothing more will come; only when there is more."""
        return self.start_ns(self._order[self._next])

    def start_ns(self, chunk: int) -> int:
        """Return the time of a chunk's first message in the output."""
        return self.index.chunks[chunk].start_ns + self._shift_ns

    @property
    def more(self) -> bool:
        """Return whether something will come."""
        return self._next < len(self._order)

    def needed(self) -> int:
        """Return how many bytes an output takes that is compressed only where it stays so."""
        return sum(self._space(self.index.head(each), each) + _BESIDE for each in self._order)

    def _space(self, head: ChunkHead, number: int) -> int:
        return head.stored if number in self._verbatim or (self._keeps and self._is_maybe(number)) else head.size

    @cached_property
    def _keeps(self) -> bool:
        """Return whether large messages stay compressed here, by the first of them."""
        some = list(islice(filter(self._is_maybe, self._order), _SAMPLE))
        return self._chunk_copies is not None and all(map(self._chunk_copies.has, some))

    def _is_maybe(self, number: int) -> bool:
        return self._chunk_copies is not None and self._chunk_copies.maybe(number)

    def size_of(self, number: int) -> int:
        """Return about how many bytes a chunk brings into memory."""
        if self._is_maybe(number):
            return self.index.head(number).stored
        return self._loader.size_of(number)

    def take(self) -> Group:
        """Return the next chunks, about as many as are worth a read."""
        if self._order[self._next] in self._verbatim:
            self._next += 1
            return Group(self, [self._order[self._next - 1]], verbatim=True)
        taken, size = [], 0
        while self.more and size < GROUP_BYTES and self._order[self._next] not in self._verbatim:
            number = self._order[self._next]
            taken.append(number)
            size += self.size_of(number)
            self._next += 1
        return Group(self, taken, verbatim=False)

    def load(self, numbers: List[int], pool: Pool) -> List[Block]:
        """Return the messages of chunks.

        Raises:
            BagError: A chunk is damaged, or has messages of other times than the bag's index says.
        """
        blocks: List[Block] = []
        for kind, run in groupby(numbers, key=self._kind):
            blocks += self._loaded(kind, list(run), pool)
        return blocks if self._selection is None else [_selected(block, self._selection) for block in blocks]

    def check_copied(self, numbers: List[int], pool: Pool) -> None:
        """Decompress chunks that are copied compressed, and check them, where that is wanted.

        Raises:
            BagError: One is damaged.
        """
        for first in range(0, len(numbers) if self.checks_copied else 0, _CHECKED_TOGETHER):
            pool.put(self._loader.compressed(numbers[first : first + _CHECKED_TOGETHER], pool).buffer)

    def _kind(self, number: int) -> str:
        if self.index.head(number).compression == "none":
            return "plain"
        return "chunk_copy" if self._chunk_copies and self._chunk_copies.has(number) else "compressed"

    def _loaded(self, kind: str, numbers: List[int], pool: Pool) -> List[Block]:
        if self._chunk_copies and kind == "chunk_copy":
            block = self._chunk_copies.load(numbers, pool)
            if block is not None:
                self.check_copied(numbers, pool)
                check_times(self.index, numbers, block.table.t_ns - self._shift_ns)
                return [block]
        load = self._loader.plain if kind == "plain" else self._loader.compressed
        block = load(numbers, pool)
        check_times(self.index, numbers, block.table.t_ns)
        return [self._relabelled(block)]

    def _relabelled(self, block: Block) -> Block:
        connection = self._target[block.table.connection]
        return block._replace(table=relabel(block.buffer, block.table, connection, self._shift_ns))


def _selected(block: Block, selection: Selection) -> Block:
    """Return a block with the messages that are wanted; its connections have kept their numbers."""
    table = block.table
    mask = selection.mask(table.t_ns, table.connection)
    columns = (table.t_ns, table.connection, table.start, table.payload, table.end)
    t_ns, connection, start, payload, end = (column[mask] for column in columns)
    rows = Table(t_ns, connection, start, payload, end, table.fields)
    return block._replace(table=rows, origin=block.origin[mask], whole=block.whole[mask])


# --- the merge --------------------------------------------------------------------------------------------------------


_LATEST_NS = (1 << 32) * SECOND
Progress = Callable[[int, int], None]


class MergeOptions(NamedTuple):
    """How to merge.

    Args:
        compression: none, lz4, bz2, or auto: what can be copied as it is stays so, the rest is not compressed.
        offsets_ns: added to the record times of each input; empty for none.
        duplicates: count, drop, or ignore: what is done about messages that inputs of several origins have.
        origins: where each input was recorded; empty: each elsewhere. What lies in several inputs of one origin, as in
            successive files of one recorder, was published as often.
        window_ns: how far apart the record times of one message may be, offsets applied.
        publishers_apart: whether publishers of one topic keep their own connections, as in a recording.
        replace: whether an existing output may be replaced.
        memory: bytes that the data of a chunk may take when it is decompressed.
        selection: of the messages of a single input; None: all.
        check_copied: whether compressed chunks that are copied are decompressed as well, so that a damaged one is
            refused; else damage in them is copied, and found by `verify`.
    """

    compression: str = "auto"
    offsets_ns: Tuple[int, ...] = ()
    duplicates: str = "count"
    origins: Tuple[int, ...] = ()
    window_ns: int = SECOND
    publishers_apart: bool = True
    replace: bool = False
    memory: int = MEMORY
    selection: Optional[Selection] = None
    check_copied: bool = False

    def origins_of(self, count: int) -> Tuple[int, ...]:
        """Return where each of so many inputs was recorded."""
        return self.origins or tuple(range(count))


class Merged(NamedTuple):
    """What was merged.

    Args:
        path: of the output.
        size: its bytes.
        messages: in it.
        chunks_copied: as they were.
        duplicates: by topic, type, and md5: found, and dropped if that was asked.
        warnings: one line each.
    """

    path: Path
    size: int
    messages: int
    chunks_copied: int
    duplicates: Dict[Tuple[str, str, str], Tally]
    warnings: Tuple[str, ...]


def merge(
    inputs: Sequence[Path],
    output: Path,
    options: Optional[MergeOptions] = None,
    progress: Optional[Progress] = None,
) -> Merged:
    """Merge bags; the output appears when it is whole and on the disk.

    Args:
        inputs: paths; never changed.
        output: path of the new bag.
        options: how.
        progress: called with bytes done and all bytes.

    Raises:
        BagError: An input cannot be used, or the output not be written.
    """
    options = options or MergeOptions()
    with ExitStack() as stack:
        indexes = [stack.enter_context(Index(path, options.memory)) for path in inputs]
        back = [words for words in map(_set_back, indexes) if words]
        offsets, origins = options.offsets_ns or (0,) * len(indexes), options.origins_of(len(indexes))
        _check(indexes, offsets, output)
        if options.selection is None:
            unified = unify(indexes, origins, publishers_apart=options.publishers_apart)
        else:
            unified = _used(indexes[0], options.selection)
        sources = _sources(indexes, offsets, unified, options)
        needed = sum(map(Source.needed, sources)) if options.compression in ("none", "auto") else 0
        out = stack.enter_context(Output(output, replace=options.replace, needed=needed))
        compression = "none" if options.compression == "auto" else options.compression
        writing = Writing(
            out,
            indexes,
            unified.connections,
            unified.comparable,
            compression,
            options.duplicates,
            options.window_ns,
            origins,
        )
        stack.callback(writing.stop)
        _run(sources, writing, stack.enter_context(Pool()), progress)
        size = out.close(unified.connections)
    warnings = (*unified.warnings, *back, *_duplicate_warnings(writing.duplicates, options.duplicates))
    return Merged(output, size, writing.messages, writing.copied, writing.duplicates, warnings)


def _set_back(index: Index) -> str:
    """Return that the clock of an input was set back, which its chunks show; an empty text when it was not."""
    filled = [chunk for chunk in index.chunks if chunk.counts]
    latest = accumulate((chunk.end_ns for chunk in filled), max)
    if all(before_ns - chunk.start_ns <= UNSET_NS for before_ns, chunk in zip(latest, filled[1:])):
        return ""
    step = None
    with suppress(BagError):  # a damaged index is refused where its chunk is wanted
        messages = index.messages()
        columns = (messages.t_ns, messages.chunk, messages.offset)
        rows = by_connection(messages.connection).values()
        step = set_back(tuple(column[each] for column in columns) for each in rows)
    if step is None:
        return ""
    return f"{index.path}: {step.words(min(chunk.start_ns for chunk in filled))}; it is put in order of time"


def _used(index: Index, selection: Selection) -> Unified:
    """Return the connections of a single input of which a message is left, by the numbers that they have there."""
    connections = {number: index.connections[number] for number in selection.used}
    return Unified(connections, [np.arange(len(selection.wanted))], {}, _warnings(connections))


def _check(indexes: Sequence[Index], offsets: Sequence[int], output: Path) -> None:
    for index, offset in zip(indexes, offsets):
        refuse_input(index.path, output, "is one of the inputs")
        times = [time + offset for chunk in index.chunks for time in (chunk.start_ns, chunk.end_ns) if chunk.counts]
        if times and not 0 <= min(times) <= max(times) < _LATEST_NS:
            raise BagError(
                str(index.path), f"shifted by {offset / SECOND} s it leaves the time of bags", "shift it less"
            )


def _sources(indexes: Sequence[Index], offsets: Sequence[int], unified: Unified, options: MergeOptions) -> List[Source]:
    isolated = _isolated(indexes, offsets)
    times = _input_times(indexes, offsets, options)
    compared = [] if options.duplicates == "ignore" else list(unified.comparable)
    sources = []
    for number, (index, offset) in enumerate(zip(indexes, offsets)):
        target = unified.targets[number]
        watched: Any = np.isin(target, compared)
        verbatim = {
            each
            for each in isolated[number]
            if offset == 0
            and not (_is_beside(index.chunks[each], times, number) and _has(index.chunks[each], watched))
            and all(target[connection] == connection for connection, _ in index.chunks[each].counts)
            and index.head(each).compression in _kept(options.compression)
            and _in_order(index, each)
            and (options.selection is None or options.selection.holds(index.chunks[each]))
        }
        unseen = ~watched & (options.compression in ("auto", "none"))
        chunk_copies = None
        if options.compression in ("auto", "lz4") and _has_lz4(index):
            from .lz4_chunk_copy import ChunkCopies  # noqa: PLC0415  (a circle, and seldom wanted)

            chunk_copies = ChunkCopies(index, number, target, offset, ~watched)
        parts = (index, number, target, offset, verbatim, unseen, chunk_copies, options.selection)
        sources.append(Source(*parts, checks_copied=options.check_copied))
    return sources


def _input_times(indexes: Sequence[Index], offsets: Sequence[int], options: MergeOptions) -> List[Tuple[int, int, int]]:
    """Return origin of each input, and the times between which others may have its messages."""
    found = []
    for index, offset, origin in zip(indexes, offsets, options.origins_of(len(indexes))):
        filled = [chunk for chunk in index.chunks if chunk.counts]
        first = min((chunk.start_ns for chunk in filled), default=_LATEST_NS) + offset - options.window_ns
        last = max((chunk.end_ns for chunk in filled), default=-_LATEST_NS) + offset + options.window_ns
        found.append((origin, first, last))
    return found


def _is_beside(chunk: ChunkInfo, times: Sequence[Tuple[int, int, int]], number: int) -> bool:
    """Return whether inputs of other origins than that of this number may have messages of a chunk, by its times."""
    own = times[number][0]
    return any(origin != own and first <= chunk.end_ns and chunk.start_ns <= last for origin, first, last in times)


def _has(chunk: ChunkInfo, watched: Any) -> bool:
    """Return whether a chunk has messages of some connections."""
    return any(watched[connection] for connection, _ in chunk.counts)


def _kept(compression: str) -> Tuple[str, ...]:
    """Return the compressions of chunks that are worth copying as they are."""
    return {"auto": ("lz4", "bz2"), "lz4": ("lz4",), "bz2": ("bz2",)}.get(compression, ())


def _has_lz4(index: Index) -> bool:
    return any(index.head(number).compression == "lz4" for number in range(len(index.chunks)))


def _in_order(index: Index, number: int) -> bool:
    """Return whether the messages of a chunk lie in it in order of time.

    Raises:
        BagError: They are not of the time that the bag's index says.
    """
    t_ns, _, offset = index.entries(number)
    check_times(index, [number], t_ns)
    return bool((np.diff(t_ns[np.argsort(offset)]) >= 0).all())


def _isolated(indexes: Sequence[Index], offsets: Sequence[int]) -> List[Set[int]]:
    """Return for each input the chunks that overlap no other chunk in time."""
    spans = sorted(
        (chunk.start_ns + offset, chunk.end_ns + offset, number, each)
        for number, (index, offset) in enumerate(zip(indexes, offsets))
        for each, chunk in enumerate(index.chunks)
        if chunk.counts
    )
    found: List[Set[int]] = [set() for _ in indexes]
    latest = -1
    for place, (start, end, number, each) in enumerate(spans):
        following = spans[place + 1][0] if place + 1 < len(spans) else end + 1
        if latest < start and end < following:
            found[number].add(each)
        latest = max(latest, end)
    return found


def _run(sources: List[Source], writing: Writing, pool: Pool, progress: Optional[Progress]) -> None:
    """Read and write until nothing is left; the next chunks are read while the last ones are written."""
    total = sum(chunk.end - chunk.position for source in sources for chunk in source.index.chunks)
    done = 0
    with ThreadPoolExecutor(1) as reader:
        group = _next(sources)
        loading = _start(reader, group, pool)
        while group:
            blocks = loading.result() if loading else []
            current, group = group, _next(sources)
            loading = _start(reader, group, pool)
            if current.verbatim:
                writing.copy(current.source.index, current.chunks[0])
            else:
                writing.add(blocks, _limit(group, sources), pool)
            done += current.size
            if progress:
                progress(done, total)
        writing.finish(pool)


def _next(sources: List[Source]) -> Optional[Group]:
    waiting = [source for source in sources if source.more]
    return min(waiting, key=lambda source: (source.next_ns, source.number)).take() if waiting else None


def _start(reader: ThreadPoolExecutor, group: Optional[Group], pool: Pool) -> Optional[Future[List[Block]]]:
    if group is None or (group.verbatim and not group.source.checks_copied):
        return None
    return reader.submit(group.load, pool)


def _limit(group: Optional[Group], sources: List[Source]) -> Optional[int]:
    """Return the time before which nothing more will come; None when nothing more comes at all."""
    if group is None:
        return None
    return min([group.first_ns, *(source.next_ns for source in sources if source.more)])


def _duplicate_warnings(found: Dict[Tuple[str, str, str], Tally], what: str) -> List[str]:
    said = "dropped" if what == "drop" else "kept (--duplicates drop drops them)"
    return [
        f"{topic}: {tally.messages:,} messages are in several inputs, {said}"
        for (topic, _, _), tally in sorted(found.items())
    ]
