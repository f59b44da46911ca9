"""A new bag: written under a temporary name, put on the disk, then renamed; whole or not there."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path
from typing import Any, Dict, Iterable, List, Optional, Tuple

from .ahead import Ahead, Stretch
from .connections import Connection
from .errors import BagError
from .layout import FIRST_RECORD, bag_header, chunk_header, chunk_info, connection_record

__all__ = ["Output", "Stretch", "index_of", "sync_folder", "temporary_name"]

_PIECE = 128 << 10  # larger writes make the page cache slower, not faster
_SEGMENTS = 1000  # the system takes 1024 in one call
_RANGE = 1 << 30
_UNABLE = (errno.EXDEV, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EPERM)  # said by systems that cannot copy


def temporary_name(path: Path) -> Path:
    """Return the name under which a bag is written before it is whole."""
    return path.with_name(f".{path.name}.part")


class Output:
    """A bag being written, chunk by chunk. Left by an exception, nothing remains of it.

    Args:
        path: of the bag.
        replace: whether an existing one may be replaced.
        needed: bytes that it is going to have, about; refused at once when the disk has less.

    Raises:
        BagError: It exists, is being written by somebody else, or cannot be written.
    """

    def __init__(self, path: Path, *, replace: bool = False, needed: int = 0) -> None:
        self.path, self._replace = path, replace
        if path.exists() and not replace:
            raise _exists(path)
        self._part = temporary_name(path)
        self.position = FIRST_RECORD
        self._infos: List[bytes] = []
        self._batch: List[Any] = []
        self._waiting = 0
        self._ahead = Ahead(path)
        try:
            self._file = os.open(self._part, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise BagError(str(path), f"cannot be written ({error.strerror})", "choose another folder") from error
        self._claim(needed)

    def _claim(self, needed: int) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._file)
            raise _busy(self.path) from error
        if not _same(self._file, self._part):  # another process has just finished it
            os.close(self._file)
            raise _busy(self.path)
        os.ftruncate(self._file, 0)
        os.lseek(self._file, FIRST_RECORD, os.SEEK_SET)
        room = os.fstatvfs(self._file)
        free = room.f_bavail * room.f_frsize
        if free < needed:
            self._drop()
            wrong = f"there is no space for it: about {needed:,} bytes are needed, {free:,} are free"
            raise BagError(str(self.path), wrong, "make space and try again, nothing was changed")

    def __enter__(self) -> Output:  # noqa: PYI034  (Self is not in 3.8)
        return self

    def __exit__(self, _kind: object, error: Optional[BaseException], _trace: object) -> None:
        self._ahead.stop()
        if self._file < 0:
            return
        self._drop()
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            wrong = f"there is no space for it ({error.strerror} after {self.position:,} bytes)"
            raise BagError(str(self.path), wrong, "make space and try again, nothing was changed") from error

    def _drop(self) -> None:
        self._part.unlink()
        os.close(self._file)
        self._file = -1

    def chunk(
        self,
        compression: str,
        size: int,
        parts: List[Any],
        index: Any,
        *,
        times: Tuple[int, int],
        counts: Iterable[Tuple[int, int]],
    ) -> None:
        """Write a chunk: its data in parts, as stored; its index; what the bag's index says of it.

        Of data that is not compressed, parts may be stretches of files.
        """
        stored = size if compression == "none" else sum(len(part) for part in parts)
        self._infos.append(chunk_info(self.position, *times, counts))
        self.position += self._write((chunk_header(compression, size, stored), *parts, index))

    def expect(self, stretches: Iterable[Stretch]) -> None:
        """Say which stretches the parts of the next chunks will be, in this order; they are read meanwhile."""
        self._ahead.expect(stretches)

    def copy_chunk(
        self, file: int, start: int, end: int, *, times: Tuple[int, int], counts: Any, index: bytes = b""
    ) -> None:
        """Copy a chunk from another bag; `index` follows it where the bytes copied have none."""
        self._infos.append(chunk_info(self.position, *times, list(counts)))
        self.position += self._write((Stretch(file, start, end - start), index))

    def copy_beginning(self, file: int, end: int) -> None:
        """Copy the first bytes of another bag; the chunks in them keep their places.

        In one go from the first byte on, a file system that can share blocks between files does so: no time, no space.
        """
        os.lseek(self._file, 0, os.SEEK_SET)
        self.position = 0
        while self.position < end:
            done = self._share(file, self.position, min(end - self.position, _RANGE))
            self.position += done or self._copy(Stretch(file, self.position, end - self.position))

    def note_chunk(self, position: int, *, times: Tuple[int, int], counts: Any) -> None:
        """Take a chunk that is already there into the index."""
        self._infos.append(chunk_info(position, *times, list(counts)))

    def _share(self, file: int, start: int, count: int) -> int:
        """Let the system share or copy bytes of a file; return how many it did, 0 when it cannot."""
        try:
            return os.copy_file_range(file, self._file, count, start)  # type: ignore[attr-defined,unused-ignore]
        except OSError as error:
            if error.errno not in _UNABLE:
                raise
            return 0

    def _copy(self, stretch: Stretch) -> int:
        """Copy bytes of a file behind what waits, in few calls: of many an interpreter's lock would be fought for."""
        for piece in self._ahead.bytes_of(stretch):
            batch, size = self._batch, self._waiting
            self._batch, self._waiting = [], 0
            self._put([*batch, piece], size + len(piece))
        return stretch.size

    def _write(self, parts: Iterable[Any]) -> int:
        """Take bytes, of which the last ones may wait for more before they go to the system; return how many."""
        total = 0
        for part in parts:
            if isinstance(part, Stretch):
                total += self._copy(part)
            else:
                size = len(part)
                self._batch.append(part)
                self._waiting += size
                total += size
                if self._waiting >= _PIECE or len(self._batch) == _SEGMENTS:
                    self.flush()
        return total

    def flush(self) -> None:
        """Give to the system what waits; until then nobody may change it."""
        batch, size = self._batch, self._waiting
        self._batch, self._waiting = [], 0
        if size <= 2 * _PIECE:
            self._put(batch, size)
            return
        for part in batch:
            view = memoryview(part)
            for begin in range(0, len(view), _PIECE):
                self._put([view[begin : begin + _PIECE]], min(_PIECE, len(view) - begin))

    def _put(self, batch: List[Any], size: int) -> int:
        done = os.writev(self._file, batch) if size else 0
        while done < size:  # the disk is nearly full, or a signal came
            done += os.write(self._file, b"".join(batch)[done:])
        return size

    def close(self, connections: Dict[int, Connection]) -> int:
        """Write the index, wait until all is on the disk, give the bag its name; return its size."""
        begin = self.position
        self.position += self._write([index_of(connections, self._infos)])
        self.flush()
        header = bag_header(begin, len(connections), len(self._infos))
        if os.pwrite(self._file, header, 0) != len(header):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(self._file)
        if self.path.exists() and not self._replace:
            raise _exists(self.path)
        self._part.replace(self.path)
        os.close(self._file)
        self._file = -1
        sync_folder(self.path.parent)
        return self.position


def index_of(connections: Dict[int, Connection], infos: List[bytes]) -> bytes:
    """Return the index of a bag; `infos` are its chunks' records."""
    records = [
        connection_record(number, each.topic.encode("utf-8", "surrogateescape"), each.header)
        for number, each in sorted(connections.items())
    ]
    return b"".join([*records, *infos])


def sync_folder(folder: Path) -> None:
    """Wait until names in a folder are on the disk."""
    file = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def _same(file: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _busy(path: Path) -> BagError:
    return BagError(str(path), "is being written by another process", "wait for it")


def _exists(path: Path) -> BagError:
    return BagError(str(path), "exists", "choose another name, or say that it may be replaced")
