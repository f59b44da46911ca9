"""Several bags into one, in order of time, without decoding a message.

Message records are copied as slices of bytes; only connection numbers, and times when clocks are corrected, are written
into them before. Inputs are read a few megabytes at a time, always from the one that is behind, so that memory does not
depend on their size but on how far their chunks overlap. Compressed chunks that overlap no other are copied as they
are. Messages of the same time come in the order of the inputs, then in that of their files.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np

from .errors import BagError
from .index import Index
from .loading import Block, Pool
from .output import Output
from .source import Group, Source
from .tally import Tally
from .unify import Unified, unify
from .writing import Writing

__all__ = ["MergeOptions", "Merged", "merge"]

_LATEST_NS = (1 << 32) * 1_000_000_000
Progress = Callable[[int, int], None]


class MergeOptions(NamedTuple):
    """How to merge.

    Args:
        compression: none, lz4, bz2, or auto: what can be copied as it is stays so, the rest is not compressed.
        offsets_ns: added to the record times of each input; empty for none.
        duplicates: count, drop, or ignore: what is done about messages that several inputs have.
        window_ns: how far apart the record times of one message may be, offsets applied.
        publishers_apart: whether publishers of one topic keep their own connections, as in a recording.
        replace: whether an existing output may be replaced.
    """

    compression: str = "auto"
    offsets_ns: Tuple[int, ...] = ()
    duplicates: str = "count"
    window_ns: int = 1_000_000_000
    publishers_apart: bool = True
    replace: bool = False


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
        indexes = [stack.enter_context(Index(path)) for path in inputs]
        offsets = options.offsets_ns or (0,) * len(indexes)
        _check(indexes, offsets, output)
        unified = unify(indexes, publishers_apart=options.publishers_apart)
        sources = _sources(indexes, offsets, unified, options)
        needed = sum(map(Source.needed, sources)) if options.compression in ("none", "auto") else 0
        out = stack.enter_context(Output(output, replace=options.replace, needed=needed))
        compression = "none" if options.compression == "auto" else options.compression
        writing = Writing(out, indexes, unified, compression, options.duplicates, options.window_ns)
        stack.callback(writing.stop)
        _run(sources, writing, stack.enter_context(Pool()), progress)
        size = out.close(unified.connections)
    warnings = (*unified.warnings, *_duplicate_warnings(writing.duplicates, options.duplicates))
    return Merged(output, size, writing.messages, writing.copied, writing.duplicates, warnings)


def _check(indexes: Sequence[Index], offsets: Sequence[int], output: Path) -> None:
    for index, offset in zip(indexes, offsets):
        if output.exists() and output.samefile(index.path):
            raise BagError(str(output), "is one of the inputs", "choose another name")
        times = [time + offset for chunk in index.chunks for time in (chunk.start_ns, chunk.end_ns) if chunk.counts]
        if times and not 0 <= min(times) <= max(times) < _LATEST_NS:
            raise BagError(str(index.path), f"shifted by {offset / 1e9} s it leaves the time of bags", "shift it less")


def _sources(indexes: Sequence[Index], offsets: Sequence[int], unified: Unified, options: MergeOptions) -> List[Source]:
    isolated = _isolated(indexes, offsets)
    watched = [] if options.duplicates == "ignore" else list(unified.comparable)
    sources = []
    for number, (index, offset) in enumerate(zip(indexes, offsets)):
        target = unified.targets[number]
        verbatim = {
            each
            for each in isolated[number]
            if offset == 0
            and all(target[connection] == connection for connection, _ in index.chunks[each].counts)
            and index.head(each).compression in _kept(options.compression)
            and _in_order(index, each)
        }
        unwatched: Any = np.isin(target, watched, invert=True)
        unseen = unwatched & (options.compression in ("auto", "none"))
        carriers = None
        if options.compression in ("auto", "lz4") and _has_lz4(index):
            from .carriers import Carriers  # noqa: PLC0415  (needs ctypes, which is slow to load and seldom wanted)

            carriers = Carriers(index, number, target, offset, unwatched)
        sources.append(Source(index, number, target, offset, verbatim, unseen, carriers))
    return sources


def _kept(compression: str) -> Tuple[str, ...]:
    """Return the compressions of chunks that are worth copying as they are."""
    return {"auto": ("lz4", "bz2"), "lz4": ("lz4",), "bz2": ("bz2",)}.get(compression, ())


def _has_lz4(index: Index) -> bool:
    return any(index.head(number).compression == "lz4" for number in range(len(index.chunks)))


def _in_order(index: Index, number: int) -> bool:
    """Return whether the messages of a chunk lie in it in order of time."""
    t_ns, _, offset = index.entries(number)
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
    return None if group is None or group.verbatim else reader.submit(group.load, pool)


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
