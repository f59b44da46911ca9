"""A bag that was not closed is closed where it lies: no second copy, no time for one, and it can be undone.

Of a recording that was interrupted everything but its end is as it should be. So only the header, and what stands
behind the last whole chunk, is written anew. Before, the old bytes of both go into a file beside it (`x.bag.undo`),
which is put on the disk first. Whatever happens at whatever moment: with that file `restore` makes the original again,
byte for byte, and a recovery that was interrupted begins with that.
"""

from __future__ import annotations

import fcntl
import os
import signal
from pathlib import Path
from typing import Any, Callable, List, Optional, Tuple

from .errors import BagError
from .layout import FIRST_RECORD, bag_header, chunk_header, chunk_info
from .output import index_of, sync_folder
from .recover import Recovered, beginning, recovered_name, write_kept
from .scan import Scan, scan
from .undo import Undo, is_interrupted, restore, undo_path, write_undo

__all__ = ["recover_in_place"]

_MOST = 64 << 20  # bytes behind the last whole chunk: one chunk that was being written has less
_COPY = "recover it without --in-place"
Progress = Callable[[int, int], None]


def recover_in_place(path: Path, *, check_data: bool = False, progress: Optional[Progress] = None) -> Recovered:
    """Close a bag where it lies; x.bag.active is called x.bag then. What cannot be kept is in the undo file.

    Args:
        path: of the bag; nobody may be writing it any more.
        check_data: whether to check the data of whole chunks, too; reads all of the file.
        progress: called with bytes passed and all bytes.

    Raises:
        BagError: It is no bag, is still being written, is damaged elsewhere than at its end, or cannot be written.
    """
    final = path if path.name.endswith(".bag") else recovered_name(path)
    _prepare(path, final)
    found = scan(path, check_data=check_data, progress=progress)
    kept = beginning(found)
    if found.closed and not found.damages and len(kept) == len(found.chunks):
        return Recovered(path, found.size, found)
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
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise BagError(str(path), f"cannot be read ({error.strerror})", "name a bag that you may change") from error
    try:
        fcntl.fcntl(file, fcntl.F_SETSIG, signal.SIGURG)  # who is told of a writer that comes now must not die of it
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_RDLCK)
        fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_UNLCK)
    except BlockingIOError as error:
        raise BagError(str(path), "is still open for writing", "stop the recorder first") from error
    except OSError:
        pass  # of a file that is not ours, or on a network, it cannot be told
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
        write_undo(final, Undo.of(file, path.name, place)._replace(lost=found.lost))
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
    if path != final:
        path.rename(final)
        sync_folder(final.parent)
    return place + len(end)


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
