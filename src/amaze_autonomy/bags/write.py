"""A new bag: written under a temporary name, put on the disk, then renamed; whole or not there.

What is copied from other files is read on a second processor while what comes before it is written: that brought a
merge of images from 1.3 times cp to 1.15.
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Deque, Dict, Iterable, Iterator, List, NamedTuple, Optional, Tuple

from amaze_autonomy.files import sync_folder, temporary_name

from .errors import BagError
from .format import FIRST_RECORD, Connection, bag_header, chunk_header, chunk_info, connection_record, read_into

if TYPE_CHECKING:  # loading them all would be a good part of a short run
    from concurrent.futures import Future, ThreadPoolExecutor

# --- what comes next is read while what comes before it is written ----------------------------------------------------


_PIECE = 1 << 20  # an image at once; a copy by the system costs ext4 a third more, where nothing can be shared
_BUFFERS = 3  # one is written, one is read, one is ready


class Stretch(NamedTuple):
    """Bytes of an open file, from `start` on."""

    file: int
    start: int
    size: int


class Ahead:
    """Stretches of files, read in the order in which they are wanted.

    Args:
        path: of what is written; errors name it.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reader: Optional[ThreadPoolExecutor] = None
        self._free: List[bytearray] = []
        self._made = 0
        self._planned: Deque[Stretch] = deque()
        self._jobs: Deque[Tuple[Stretch, bytearray, Future[None]]] = deque()

    def stop(self) -> None:
        """End the thread; nothing is read any more."""
        if self._reader is not None:
            self._reader.shutdown()

    def expect(self, stretches: Iterable[Stretch]) -> None:
        """Say what will be wanted next, behind all that was said before."""
        self._planned.extend(piece for stretch in stretches for piece in _pieces(stretch))
        self._begin()

    def bytes_of(self, stretch: Stretch) -> Iterator[memoryview]:
        """Return the next stretch in pieces; each is good until the following one is asked for.

        Raises:
            BagError: The file has become shorter.
            ValueError: Another stretch was said to be next.
        """
        if not self._jobs:
            self.expect([stretch])
        for wanted in _pieces(stretch):
            piece, buffer, job = self._jobs.popleft()
            if piece != wanted:
                raise ValueError(f"{piece} was said to be next, not {wanted}")
            job.result()
            yield memoryview(buffer)[: piece.size]
            self._free.append(buffer)
            self._begin()

    def _begin(self) -> None:
        """Begin to read, as far as there are buffers."""
        while self._planned and (self._free or self._made < _BUFFERS):
            if not self._free:
                self._free.append(bytearray(_PIECE))
                self._made += 1
            piece, buffer = self._planned.popleft(), self._free.pop()
            self._jobs.append((piece, buffer, self._thread().submit(self._read, piece, buffer)))

    def _thread(self) -> ThreadPoolExecutor:
        if self._reader is None:
            from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415  (slow to load)

            self._reader = ThreadPoolExecutor(1)
        return self._reader

    def _read(self, piece: Stretch, buffer: bytearray) -> None:
        view, done = memoryview(buffer)[: piece.size], 0
        while done < piece.size:
            read = read_into(piece.file, [view[done:]], piece.start + done)
            if not read:
                raise BagError(str(self._path), "an input became shorter while it was read", "try again")
            done += read


def _pieces(stretch: Stretch) -> Iterator[Stretch]:
    for place in range(0, stretch.size, _PIECE):
        yield Stretch(stretch.file, stretch.start + place, min(_PIECE, stretch.size - place))


# --- a new bag --------------------------------------------------------------------------------------------------------


_BATCH_BYTES = 128 << 10  # larger writes make the page cache slower, not faster
_SEGMENTS = 1000  # the system takes 1024 in one call
_RANGE = 1 << 30
_UNABLE = (errno.EXDEV, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP, errno.EPERM)  # said by systems that cannot copy


def refuse_input(path: Path, output: Path, wrong: str) -> None:
    """Refuse an output that would take the place of an input, or whose temporary name is the input's.

    Raises:
        BagError: It would.
    """
    for name in (output, temporary_name(output)):
        if name.exists() and name.samefile(path):
            raise BagError(str(name), wrong, "choose another name for the output")


class Output:
    """A bag being written, chunk by chunk. Left by an exception, nothing remains of it.

    Args:
        path: of the bag.
        replace: whether an existing one may be replaced; its manifest goes with it.
        needed: bytes that it is going to have, about; refused at once when the disk has less.

    Raises:
        BagError: It exists, is no file, is being written by somebody else, or cannot be written.
    """

    def __init__(self, path: Path, *, replace: bool = False, needed: int = 0) -> None:
        self.path, self._replace = path, replace
        if path.is_dir():
            raise BagError(str(path), "is a folder", "name a file, in it or elsewhere")
        if path.exists() and not path.is_file():
            raise BagError(str(path), "is a device or a pipe", "name a file")
        if path.exists() and not replace:
            raise _exists(path)
        self._part = temporary_name(path)
        self.position = FIRST_RECORD
        self._infos: List[bytes] = []
        self._batch: List[Any] = []
        self._waiting = 0
        self._ahead = Ahead(path)
        _remove_left(self._part)
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
            if error.errno not in (*_UNABLE, errno.EIO):  # whose reads fail, theirs or ours, the copy will tell
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
                if self._waiting >= _BATCH_BYTES or len(self._batch) == _SEGMENTS:
                    self.flush()
        return total

    def flush(self) -> None:
        """Give to the system what waits; until then nobody may change it."""
        batch, size = self._batch, self._waiting
        self._batch, self._waiting = [], 0
        if size <= 2 * _BATCH_BYTES:
            self._put(batch, size)
            return
        for part in batch:
            view = memoryview(part)
            for begin in range(0, len(view), _BATCH_BYTES):
                self._put([view[begin : begin + _BATCH_BYTES]], min(_BATCH_BYTES, len(view) - begin))

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
        if self.path.exists():
            self._give_up_manifest()
        self._part.replace(self.path)
        os.close(self._file)
        self._file = -1
        sync_folder(self.path.parent)
        return self.position

    def _give_up_manifest(self) -> None:
        """Remove what was said of the bag that is replaced: before that, so that it is never said of this one."""
        if not self._replace:
            raise _exists(self.path)
        from .merge.manifest import bag_of, manifest_path  # noqa: PLC0415  (a circle, and seldom wanted)

        manifest = manifest_path(self.path)
        if bag_of(manifest, self.path).name == self.path.name:
            manifest.unlink(missing_ok=True)


def index_of(connections: Dict[int, Connection], infos: List[bytes]) -> bytes:
    """Return the index of a bag; `infos` are its chunks' records."""
    records = [
        connection_record(number, each.topic.encode("utf-8", "surrogateescape"), each.header)
        for number, each in sorted(connections.items())
    ]
    return b"".join([*records, *infos])


def _remove_left(part: Path) -> None:
    """Remove what a killed process left, unless another one writes it: who may read it was decided by its umask."""
    with suppress(OSError):
        file = os.open(part, os.O_RDWR | os.O_CLOEXEC)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _same(file, part):
                part.unlink()
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
    return BagError(str(path), "exists", "choose another name, or say that it may be replaced (--force)")
