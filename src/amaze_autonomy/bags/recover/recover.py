"""A bag of all that is good in a damaged one, or in one that was not closed: a new one, or the old one closed in place.

A new bag is the rule; the original is never written to. In place is for the recorder: of a recording that was
interrupted everything but its end is as it should be, and a second copy of it would take space and time that a vehicle
between two flights does not have (docs/bags.md has the figures). So only the header, and what stands behind the last
whole chunk, is written anew. Before, the old bytes of both go into a file beside it (`x.bag.undo`), which is put on the
disk first. Whatever happens at whatever moment: with that file `restore` makes the original again, byte for byte, and
a recovery that was interrupted begins with that.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import signal
import struct
import zlib
from pathlib import Path
from typing import Any, Callable, List, NamedTuple, Optional, Protocol, Tuple

from amaze_autonomy.files import sync_folder, write_whole

from ..errors import BagError, RecordError
from ..format import FIRST_RECORD, MEMORY, bag_header, chunk_header, chunk_info, decompressed, read_at, record_at
from ..index import Index, chunk_head, refuse_pipe
from ..write import Output, index_of, refuse_input
from .salvage import rewritten, salvaged
from .scan import Found, Scan, scan

# --- into a new bag ---------------------------------------------------------------------------------------------------


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
    check_data: bool = True,
    memory: int = MEMORY,
    replace: bool = False,
    progress: Optional[Progress] = None,
) -> Recovered:
    """Write what is good into a new bag: every whole chunk, and every whole message of the others that can be found.

    Args:
        path: of the bag; only read.
        output: path of the new bag.
        check_data: whether to look at the data of whole chunks; without, it is copied as it is.
        memory: bytes that the data of a chunk may take.
        replace: whether an existing output may be replaced.
        progress: called with bytes passed and all bytes.

    Raises:
        BagError: It is no bag, or the output cannot be written.
    """
    refuse_input(path, output, "is the bag to be recovered, which is never changed")
    if is_interrupted(path):
        raise BagError(str(path), "is half changed by a recovery in place", "finish that with --in-place, or --undo it")
    found = scan(path, check_data=check_data, memory=memory, progress=progress)
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        with Output(output, replace=replace, needed=_needed(found)) as out:
            write_kept(out, file, found, memory)
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


def write_kept(out: Sink, file: int, found: Scan, memory: int = MEMORY) -> None:
    """Write all that is good in a file."""
    kept = beginning(found)
    if kept:
        out.copy_beginning(file, kept[-1].end)
    for chunk in kept:
        out.note_chunk(chunk.position, times=(chunk.start_ns, chunk.end_ns), counts=chunk.counts)
    for chunk in found.chunks[len(kept) :]:
        times = (chunk.start_ns, chunk.end_ns)
        if chunk.drop:
            _write_rest(out, file, chunk, memory)
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


def _write_rest(out: Sink, file: int, chunk: Found, memory: int) -> None:
    """Write a chunk without the messages that are to be dropped."""
    data = chunk.data
    if data is None:
        raw = read_at(file, chunk.data_end - chunk.position, chunk.position)
        head = chunk_head(record_at(raw[:_HEAD], 0, min(len(raw), _HEAD)))
        data = bytes(decompressed(head.compression, raw[head.data :], head.size, memory))
    kept = salvaged(data).without(chunk.drop)
    if kept.rows:
        data, kept = rewritten(data, kept)
        out.chunk("none", len(data), [data], kept.index_bytes(), times=kept.times(), counts=kept.counts())


# --- in place ---------------------------------------------------------------------------------------------------------


_MOST = 64 << 20  # bytes behind the last whole chunk: one chunk that was being written has less
_COPY = "recover it without --in-place"


def recover_in_place(
    path: Path, *, check_data: bool = True, memory: int = MEMORY, progress: Optional[Progress] = None
) -> Recovered:
    """Close a bag where it lies; x.bag.active is called x.bag then. What cannot be kept is in the undo file.

    Args:
        path: of the bag; nobody may be writing it any more.
        check_data: whether to look at the data of whole chunks; without, hardly anything is read.
        memory: bytes that the data of a chunk may take.
        progress: called with bytes passed and all bytes.

    Raises:
        BagError: It is no bag, is still being written, is damaged elsewhere than at its end, or cannot be written.
    """
    final = path if path.name.endswith(".bag") else recovered_name(path)
    _prepare(path, final)
    found = scan(path, check_data=check_data, memory=memory, progress=progress)
    kept = beginning(found)
    if found.closed and not found.damages and len(kept) == len(found.chunks):
        _rename(path, final)  # of a recorder that was killed between the two
        return Recovered(final, found.size, found)
    place = kept[-1].end if kept else FIRST_RECORD
    if found.size < FIRST_RECORD or found.size - place > _MOST:
        raise BagError(str(path), f"more than its end is damaged, from byte {place} on", _COPY)
    size = _change(path, final, found, place)
    return Recovered(final, size, found)


def _prepare(path: Path, final: Path) -> None:
    """Undo what an interrupted recovery left; refuse what cannot be done."""
    if is_interrupted(path):
        restore(path)
    elif undo_path(final).exists():
        raise BagError(str(undo_path(final)), "exists, of an earlier recovery", "use it with --undo, or move it away")
    if path != final and final.exists():
        raise BagError(str(final), "exists", "move it away; it is what the recovered bag is called")
    _check_unused(path)


def _check_unused(path: Path) -> None:
    """Refuse a file that a process has open for writing: the system gives no lease for reading on such a one."""
    refuse_pipe(path)
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise BagError(str(path), f"cannot be read ({error.strerror})", "name a bag that you may change") from error
    try:
        fcntl.fcntl(file, fcntl.F_SETSIG, signal.SIGURG)  # who is told of a writer that comes now must not die of it
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_RDLCK)
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    except OSError as error:  # of a file that is not ours, or on a network, it cannot be told
        if isinstance(error, BlockingIOError):
            raise BagError(str(path), "is still open for writing", "stop the recorder first") from error
    finally:
        os.close(file)


def _change(path: Path, final: Path, found: Scan, place: int) -> int:
    """Write the new end and the header; put the original back if that is not possible."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError as error:
        raise BagError(str(path), f"cannot be written ({error.strerror})", _COPY) from error
    try:
        end, header = _new_end(file, found, place)
        undo = Undo.of(file, path.name, place)
        write_undo(final, undo._replace(lost=found.lost, lost_inside=found.lost_inside, new=end))
        _put(file, place, end)
        os.ftruncate(file, place + len(end))
        os.fsync(file)
        _put(file, 0, header)
        os.fsync(file)
    except OSError as error:
        if undo_path(final).exists():
            restore(path)
        raise BagError(str(path), f"cannot be written ({error.strerror})", "make space, nothing was changed") from error
    finally:
        os.close(file)
    _rename(path, final)
    return place + len(end)


def _rename(path: Path, final: Path) -> None:
    if path != final:
        path.rename(final)
        sync_folder(final.parent)


def _put(file: int, place: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        done = os.pwrite(file, view, place)
        view, place = view[done:], place + done


def _new_end(file: int, found: Scan, place: int) -> Tuple[bytes, bytes]:
    end = _End(place)
    write_kept(end, file, found)
    index = index_of(found.connections, end.infos)
    header = bag_header(end.position, len(found.connections), len(end.infos))
    return b"".join([*end.parts, index]), header


class _End:
    """What follows the chunks that stay, put together in memory; used like an Output.

    Args:
        position: where it begins in the file.
    """

    def __init__(self, position: int) -> None:
        self.position = position
        self.parts: List[bytes] = []
        self.infos: List[bytes] = []

    def copy_beginning(self, file: int, end: int) -> None:
        """Leave it where it is."""

    def note_chunk(self, position: int, *, times: Tuple[int, int], counts: Any) -> None:
        """Take a chunk that stays into the index."""
        self.infos.append(chunk_info(position, *times, list(counts)))

    def chunk(
        self, compression: str, size: int, parts: List[Any], index: Any, *, times: Tuple[int, int], counts: Any
    ) -> None:
        """Take a new chunk."""
        data = b"".join(parts)
        self._take([chunk_header(compression, size, len(data)), data, index], times, counts)

    def copy_chunk(
        self, file: int, start: int, end: int, *, times: Tuple[int, int], counts: Any, index: bytes = b""
    ) -> None:
        """Take a chunk of the old end."""
        self._take([os.pread(file, end - start, start), index], times, counts)

    def _take(self, parts: List[bytes], times: Tuple[int, int], counts: Any) -> None:
        self.note_chunk(self.position, times=times, counts=counts)
        self.parts += parts
        self.position += sum(len(part) for part in parts)


# --- the undo file ----------------------------------------------------------------------------------------------------


_MAGIC = b"#AMAZE BAG UNDO 1\n"
_SUFFIX = ".undo"
_BEFORE = 4096  # bytes before the end that show that it is the same file
_LENGTH = struct.Struct("<L")


class Undo(NamedTuple):
    """What a file was like.

    Args:
        name: of it.
        size: of it.
        place: from where on its end was changed.
        before: CRC-32 of the last bytes before that, which were not.
        head: its first bytes.
        end: all from that place on.
        lost: messages that the recovery could not keep; None when nobody knows how many.
        lost_inside: those of them that were not lost at the end; likewise.
        new: what the end became, and so a proof of the bag; None in a file that an earlier version wrote.
    """

    name: str
    size: int
    place: int
    before: int
    head: bytes
    end: bytes
    lost: Optional[int] = None
    lost_inside: Optional[int] = 0
    new: Optional[bytes] = None

    @classmethod
    def of(cls, file: int, name: str, place: int) -> Undo:
        """Return what an open file is like."""
        size = os.fstat(file).st_size
        head, end = os.pread(file, FIRST_RECORD, 0), os.pread(file, size - place, place)
        if len(head) + len(end) != FIRST_RECORD + size - place:
            raise OSError(5, "it could not be read as a whole")
        return cls(name, size, place, _before(file, place), head, end)


def _before(file: int, place: int) -> int:
    begin = max(FIRST_RECORD, place - _BEFORE)
    return zlib.crc32(os.pread(file, place - begin, begin))


def _is_of(undo: Undo, file: int) -> bool:
    """Return whether an open file is the one that was, or was to be, changed.

    However far that, or undoing it, came, each bit of its end is the old one or the new one. Bags of other recordings
    have none of their times.
    """
    size = os.fstat(file).st_size - undo.place
    if size < 0 or _before(file, undo.place) != undo.before:
        return False
    if undo.new is None:
        return undo.place > FIRST_RECORD  # else there was nothing before that could show it
    if size > max(len(undo.end), len(undo.new)):
        return False
    return _is_either(os.pread(file, size, undo.place), undo.end, undo.new)


def _is_either(now: bytes, old: bytes, new: bytes) -> bool:
    """Return whether each bit is the old one or the new one."""
    now_bits, old_bits, new_bits = (int.from_bytes(each, "little") for each in (now, old, new))
    return (now_bits ^ old_bits) & (now_bits ^ new_bits) == 0


def _may_be_of(undo: Undo, file: int) -> bool:
    """Return whether an open file may be the one that was changed, and was changed by others since.

    Who reindexes or appends leaves the data as it is: what lies before the end, or its first chunk where nothing does.
    """
    if undo.place > FIRST_RECORD:
        return _before(file, undo.place) == undo.before
    if undo.new is None:
        return True
    try:
        size = min(_BEFORE, record_at(undo.new, 0, len(undo.new)).end)
    except RecordError:
        return True
    return _is_either(os.pread(file, size, undo.place), undo.end[:size], undo.new[:size])


def _difference(one: bytes, other: bytes) -> bytes:
    """Return what makes each of the two of the other one; most of it is zeros where an end only gets an index."""
    difference = int.from_bytes(one, "little") ^ int.from_bytes(other, "little")
    return difference.to_bytes(max(len(one), len(other)), "little")


def undo_path(bag: Path) -> Path:
    """Return where the undo file of a bag lies; `x.bag.active` has that of `x.bag`."""
    name = bag.name
    for suffix in (".active", _SUFFIX):
        name = name[: -len(suffix)] if name.endswith(suffix) else name
    return bag.with_name(name + _SUFFIX)


def is_interrupted(bag: Path) -> bool:
    """Return whether a recovery of this bag in place was begun and not finished.

    Raises:
        BagError: Its undo file is damaged.
    """
    path = undo_path(bag)
    if not path.exists():
        return False
    undo = read_undo(path)
    if undo.name != bag.name:
        return False
    try:
        with bag.open("rb") as file:
            if not _is_of(undo, file.fileno()):
                return False
        Index(bag).close()
    except (OSError, BagError):
        return True
    return bag.name.endswith(".active")


def undo_is_of(bag: Path) -> Optional[bool]:
    """Return whether the undo file beside a bag is of it: no of a bag of that name that was moved away.

    None: it may be, and cannot be used, as of a bag that was changed since.

    Raises:
        BagError: The undo file is damaged, or one of the two cannot be read.
    """
    undo = read_undo(undo_path(bag))
    try:
        with bag.open("rb") as file:
            if _is_of(undo, file.fileno()):
                return True
            return None if _may_be_of(undo, file.fileno()) else False
    except OSError as error:
        raise BagError(str(bag), f"cannot be read ({error.strerror})", "name a bag that you may read") from error


def write_undo(bag: Path, undo: Undo) -> None:
    """Put an undo file on the disk: whole, or not there."""
    path = undo_path(bag)
    facts = {"file": undo.name, "size": undo.size, "place": undo.place, "before": undo.before, "lost": undo.lost}
    facts["lost_inside"] = undo.lost_inside
    data = [undo.head, undo.end]
    if undo.new is not None:
        facts["new"] = len(undo.new)
        data.append(zlib.compress(_difference(undo.end, undo.new), 1))
    body = b"".join(data)
    text = json.dumps({**facts, "crc": zlib.crc32(body)}).encode()
    write_whole(path, [_MAGIC, _LENGTH.pack(len(text)), text, body])


def read_undo(path: Path) -> Undo:
    """Read an undo file.

    Raises:
        BagError: It is none, or damaged.
    """
    try:
        raw = path.read_bytes()
        start = len(_MAGIC) + _LENGTH.size
        length = _LENGTH.unpack_from(raw, len(_MAGIC))[0]
        facts = json.loads(raw[start : start + length])
        begin = start + length + FIRST_RECORD
        behind = begin + int(facts["size"]) - int(facts["place"])
        undo = Undo(
            str(facts["file"]),
            int(facts["size"]),
            int(facts["place"]),
            int(facts["before"]),
            raw[start + length : begin],
            raw[begin:behind],
            facts.get("lost"),
            facts.get("lost_inside", 0),  # one that an earlier version wrote says nothing of it
        )
        good = raw.startswith(_MAGIC) and zlib.crc32(raw[start + length :]) == facts["crc"]
        good = good and len(undo.end) == undo.size - undo.place and Path(undo.name).name == undo.name != ""
        if good and "new" in facts:
            new = _difference(undo.end, zlib.decompress(raw[behind:]))[: facts["new"]]
            undo = undo._replace(new=new)
    except OSError as error:
        wrong = f"is no undo file, it cannot be read ({error.strerror})"
        raise BagError(str(path), wrong, "name the bag that was recovered in place") from error
    except (ValueError, KeyError, TypeError, struct.error, zlib.error) as error:
        raise BagError(str(path), f"is no undo file ({error})", "name the bag that was recovered in place") from error
    if not good:
        raise BagError(str(path), "is damaged", "the bag was recovered as far as it could be; keep it")
    return undo


def restore(bag: Path) -> Path:
    """Make the original of a bag that was recovered in place, or was about to be; return its path.

    Args:
        bag: the recovered bag, the original's name, or the undo file.

    Raises:
        BagError: There is no undo file, or it belongs to another bag, or the bag cannot be written.
    """
    path = undo_path(bag)
    undo = read_undo(path)
    original = path.with_name(undo.name)
    current = _current(path, original)
    try:
        file = os.open(current, os.O_RDWR | os.O_CLOEXEC)
        try:
            _write_back(file, undo, path)
        finally:
            os.close(file)
        if current != original:
            current.rename(original)
        sync_folder(path.parent)
        path.unlink()
        sync_folder(path.parent)
    except OSError as error:
        wrong = f"cannot be written ({error.strerror})"
        raise BagError(str(current), wrong, f"try again, all that is needed is in {path.name}") from error
    return original


def _current(path: Path, original: Path) -> Path:
    recovered = path.with_name(path.name[: -len(_SUFFIX)])
    there: List[Path] = [each for each in dict.fromkeys((original, recovered)) if each.exists()]
    if len(there) != 1:
        wrong = f"is for {original.name}, of which there is {'more than one' if there else 'nothing'} here"
        raise BagError(str(path), wrong, f"put {original.name} or {recovered.name} beside it")
    return there[0]


def _write_back(file: int, undo: Undo, path: Path) -> None:
    if not _is_of(undo, file):
        if undo.new is None and undo.place <= FIRST_RECORD:
            wrong = "is of an earlier version and does not prove its bag"
            raise BagError(str(path), wrong, "keep both, the bag was recovered as far as it could be")
        wrong = "belongs to another bag, or the bag was changed since"
        raise BagError(str(path), wrong, "put the bag beside it that was recovered in place, as it was then")
    for place, data in ((undo.place, undo.end), (0, undo.head)):
        view = memoryview(data)
        while view:
            done = os.pwrite(file, view, place)
            view, place = view[done:], place + done  # noqa: PLW2901  (a short write)
    os.ftruncate(file, undo.size)
    os.fsync(file)
