"""A new bag of all that is good in a damaged one, or in one that was not closed. The original is never written to."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any, Callable, List, NamedTuple, Optional, Protocol, Tuple

from .compression import decompressed
from .errors import BagError
from .index import chunk_head
from .layout import FIRST_RECORD, record_at
from .output import Output
from .salvage import kept_by_walk, rewritten
from .scan import Found, Scan, scan
from .undo import is_interrupted

__all__ = ["Recovered", "Sink", "beginning", "recover", "recovered_name", "write_kept"]

_HEAD = 4096
Progress = Callable[[int, int], None]


class Recovered(NamedTuple):
    """What was recovered: the new bag, its size, and what was found in the old one."""

    path: Path
    size: int
    scan: Scan

    @property
    def complete(self) -> bool:
        """Return whether no message was lost."""
        return self.scan.lost == 0


def recovered_name(path: Path) -> Path:
    """Return the usual name of what is recovered: x.bag from x.bag.active, x.recovered.bag from x.bag."""
    plain = re.sub(r"\.active$", "", path.name)
    if plain == path.name:
        plain = re.sub(r"(\.bag)?$", ".recovered.bag", plain, count=1)
    return path.with_name(plain)


def recover(
    path: Path,
    output: Path,
    *,
    check_data: bool = False,
    replace: bool = False,
    progress: Optional[Progress] = None,
) -> Recovered:
    """Write what is good into a new bag: every whole chunk, and every whole message of the others that can be found.

    Args:
        path: of the bag; only read.
        output: path of the new bag.
        check_data: whether to check the data of whole chunks, too; reads all of the file.
        replace: whether an existing output may be replaced.
        progress: called with bytes passed and all bytes.

    Raises:
        BagError: It is no bag, or the output cannot be written.
    """
    if output.exists() and output.samefile(path):
        raise BagError(str(output), "is the bag to be recovered, which is never changed", "choose another name")
    if is_interrupted(path):
        raise BagError(str(path), "is half changed by a recovery in place", "finish that with --in-place, or --undo it")
    found = scan(path, check_data=check_data, progress=progress)
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with Output(output, replace=replace, needed=_needed(found)) as out:
            write_kept(out, file, found)
            size = out.close(found.connections)
    finally:
        os.close(file)
    return Recovered(output, size, found)


def _needed(found: Scan) -> int:
    return sum(len(each.data) if each.data is not None else each.data_end - each.position for each in found.chunks)


class Sink(Protocol):
    """What takes chunks: a new bag, or the end of an old one."""

    def copy_beginning(self, file: int, end: int) -> None:
        """Take the first bytes of a bag, as they are."""

    def note_chunk(self, position: int, *, times: Tuple[int, int], counts: Any) -> None:
        """Take a chunk in them into the index."""

    def chunk(
        self, compression: str, size: int, parts: List[Any], index: Any, *, times: Tuple[int, int], counts: Any
    ) -> None:
        """Take a new chunk."""

    def copy_chunk(
        self, file: int, start: int, end: int, *, times: Tuple[int, int], counts: Any, index: bytes = b""
    ) -> None:
        """Take a chunk of the bag."""


def write_kept(out: Sink, file: int, found: Scan) -> None:
    """Write all that is good in a file."""
    kept = beginning(found)
    if kept:
        out.copy_beginning(file, kept[-1].end)
    for chunk in kept:
        out.note_chunk(chunk.position, times=(chunk.start_ns, chunk.end_ns), counts=chunk.counts)
    for chunk in found.chunks[len(kept) :]:
        times = (chunk.start_ns, chunk.end_ns)
        if chunk.drop:
            _write_rest(out, file, chunk)
        elif chunk.data is not None:
            records = chunk.index_bytes or b""
            out.chunk("none", len(chunk.data), [chunk.data], records, times=times, counts=chunk.counts)
        else:
            end = chunk.end if chunk.index_bytes is None else chunk.data_end
            records = chunk.index_bytes or b""
            out.copy_chunk(file, chunk.position, end, times=times, counts=chunk.counts, index=records)


def beginning(found: Scan) -> List[Found]:
    """Return the chunks that can stay where they are: good ones from the first place on, without anything between."""
    chunks: List[Found] = []
    place = FIRST_RECORD
    for chunk in found.chunks:
        if chunk.position != place or chunk.drop or chunk.index_bytes is not None or chunk.data is not None:
            break
        chunks.append(chunk)
        place = chunk.end
    return chunks


def _write_rest(out: Sink, file: int, chunk: Found) -> None:
    """Write a chunk without the messages that are to be dropped."""
    data = chunk.data
    if data is None:
        raw = os.pread(file, chunk.data_end - chunk.position, chunk.position)
        head = chunk_head(record_at(raw[:_HEAD], 0, min(len(raw), _HEAD)))
        data = bytes(decompressed(head.compression, raw[head.data :], head.size))
    kept = kept_by_walk(data).without(chunk.drop)
    if kept.rows:
        data, kept = rewritten(data, kept)
        out.chunk("none", len(data), [data], kept.index_bytes(), times=kept.times(), counts=kept.counts())
