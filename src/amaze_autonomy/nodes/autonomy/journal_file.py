"""The journal on disk: appended line by line, flushed at each decision, on the disk within a second where that can.

A disk that is full or gone is not a reason to stop an engine in flight: what could not be written is kept, said, and
written as soon as it can be. The file then has no gap, unless so much was kept that it had to go.
"""

from __future__ import annotations

import errno
import fcntl
import os
import threading
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import Callable, Iterable, List, Optional, Tuple

from amaze_autonomy.files import sync_folder

from ...journal import journal as codec
from ...ros.errors import StartError

JOURNAL_NAME = "journal.jsonl"
_FSYNC_PERIOD_S = 1.0
_RETRY_PERIOD_S = 1.0
_HELD_UP_S = 3.0  # a card that tidies up takes one or two
_MOST_KEPT = 16 * 1024 * 1024  # bytes that wait for a disk
_PIECE = 1024 * 1024
_LET_GO_LIMIT_S = 8.0  # of an engine that is told to end in flight, which lands first
_MODE = 0o640


Elsewhere = Callable[[], Iterable[Path]]


class InUseError(StartError):
    """Another process still writes the journal of this engine."""


class JournalSync:
    """Has a disk keep what was written, which may take it seconds: on a thread of its own, once at a time, none waits.

    Attributes:
        problem: why the last one failed; empty: it did not.
    """

    def __init__(self) -> None:
        self.problem = ""
        self._jobs: SimpleQueue[Optional[Callable[[], None]]] = SimpleQueue()
        self._thread: Optional[threading.Thread] = None
        self._busy = False

    def begin(self, descriptor: int, folder: Optional[Path]) -> bool:
        """Begin with a file, and with the folder that it is new in; return False where it could not, e.g. is at it."""
        if self._busy:
            return False
        try:
            if self._thread is None:
                thread = threading.Thread(target=self._run, name="journal on disk", daemon=True)
                thread.start()
                self._thread = thread
            own = os.dup(descriptor)
        except (OSError, RuntimeError) as error:  # too many files, or threads
            self.problem = str(error)
            return False
        self._busy = True
        self._jobs.put(partial(_keep, own, folder))
        return True

    def end(self) -> None:
        """Begin no more; one that is under way goes on."""
        self._jobs.put(None)

    def _run(self) -> None:
        while True:
            job = self._jobs.get()
            if job is None:
                return
            try:
                job()
                self.problem = ""
            except OSError as error:
                self.problem = error.strerror or str(error)
            self._busy = False


def _keep(descriptor: int, folder: Optional[Path]) -> None:
    """Have the disk keep a file, whose descriptor is closed, and the name of it in a folder."""
    try:
        os.fdatasync(descriptor)
        if folder is not None:
            sync_folder(folder)
    finally:
        os.close(descriptor)


class JournalFile:
    """An open journal. Written by one thread; what is known of it may be asked by any.

    Args:
        path: of the file.
        descriptor: open for reading and writing, at its end, locked.
        lines: how many lines it holds.
        elsewhere: makes folders to go on in when this one is removed, one after the other.

    Attributes:
        remark: that it was removed and where it goes on; empty: it was not.
        gap: lines are missing in it.
    """

    def __init__(self, path: Path, descriptor: int, lines: int, elsewhere: Elsewhere) -> None:
        self.path, self.lines = path, lines
        self.remark = self._problem = ""
        self._elsewhere = elsewhere
        self._disk = JournalSync()
        self._new_in: Optional[Path] = None
        self.gap = False
        self._descriptor = descriptor
        self._good = os.lseek(descriptor, 0, os.SEEK_END)
        self._kept: List[bytes] = []
        self._kept_bytes = 0
        self._synced_s = self._retry_s = 0.0
        self._asked_s: Optional[float] = None
        self._dirty = self._torn = False

    @property
    def problem(self) -> str:
        """Return why it cannot be written; empty: it can."""
        asked_s, kept = self._asked_s, self._disk.problem
        if asked_s is not None and time.monotonic() - asked_s > _HELD_UP_S:
            kept = f"the disk has not answered for more than {_HELD_UP_S:g} s"
        return self._problem or (f"{self.path}: {kept}" if kept else "")

    @property
    def remarks(self) -> Tuple[str, ...]:
        """Return what people are to know of it."""
        trouble = (
            f"The journal cannot be written: {self.problem}. The engine goes on; check the disk, and make room on it."
        )
        return tuple(each for each in (trouble if self.problem else "", self.remark) if each)

    @property
    def written(self) -> int:
        """Return how many lines are in the file, or never will be."""
        return self.lines - len(self._kept)

    def append(self, line: str) -> Optional[int]:
        """Take a line; return its number from 0. It is on its way at the next `flush`.

        None: no disk has taken anything for so long that this line and all that waited are given up. What comes behind
        the gap must not rest on them.
        """
        data = line.encode() + b"\n"
        self._kept.append(data)
        self._kept_bytes += len(data)
        self.lines += 1
        if self._kept_bytes <= _MOST_KEPT:
            return self.lines - 1
        self.gap = True
        self._kept, self._kept_bytes = [], 0
        return None

    def flush(self, *, force: bool = False) -> None:
        """Write what was taken; a failure is kept in `problem` and tried again later."""
        if not self._kept or (self._problem and not force and time.monotonic() < self._retry_s):
            return
        data = b"".join(self._kept)
        self._asked_s = time.monotonic()
        try:
            if self._torn:
                self._take_back()
            _write_all(self._descriptor, data)
        except OSError as error:
            self._failed(error)
            return
        finally:
            self._asked_s = None
        self._good += len(data)
        self._kept, self._kept_bytes = [], 0
        self._dirty, self._problem = True, ""

    def _failed(self, error: OSError) -> None:
        self._problem = f"{self.path}: {error.strerror or error}"
        self._retry_s = time.monotonic() + _RETRY_PERIOD_S
        self._torn = True
        try:
            self._take_back()
        except OSError as again:
            self._problem = f"{self.path}: {again.strerror or again}"

    def _take_back(self) -> None:
        """Take back half-written lines, so that the file ends with a whole one."""
        os.ftruncate(self._descriptor, self._good)
        os.lseek(self._descriptor, self._good, os.SEEK_SET)
        self._torn = False

    def follow(self) -> bool:
        """Go on elsewhere when the file was removed or moved; return whether it was. What was written goes along."""
        if not self._gone():
            return False
        before, why = self.path, ""
        try:
            for folder in self._elsewhere():
                why = self._tried(folder)
                if not why:
                    there = "is there again" if self.path == before else f"goes on at {self.path}"
                    self.remark = f"The journal was removed: {before}. It {there}, whole."
                    return True
        except (OSError, StartError) as error:
            why = str(error)
        self._problem = f"{before} was removed, and there is no other place ({why})"
        return False

    def _gone(self) -> bool:
        self._asked_s = time.monotonic()
        try:
            there = self.path.stat()
            return (there.st_dev, there.st_ino) != _identity(self._descriptor)
        except OSError:
            return True
        finally:
            self._asked_s = None

    def _tried(self, folder: Path) -> str:
        """Go on in a folder; return why that is not possible, empty when it was."""
        try:
            self._go_on_in(folder / JOURNAL_NAME)
        except (OSError, StartError) as error:
            with suppress(OSError):
                folder.rmdir()  # it was made for nothing
            return str(error)
        self.path = folder / JOURNAL_NAME
        return ""

    def _go_on_in(self, path: Path) -> None:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, _MODE)
        try:
            place = 0
            while place < self._good:
                piece = os.pread(self._descriptor, min(_PIECE, self._good - place), place)
                if not piece:
                    break
                _write_all(descriptor, piece)
                place += len(piece)
            _lock(descriptor, path)
        except (OSError, StartError):
            os.close(descriptor)
            path.unlink()
            raise
        os.close(self._descriptor)
        self._descriptor, self._good, self._torn = descriptor, place, False
        self._dirty, self._synced_s, self._new_in = True, 0.0, path.parent

    def sync(self) -> None:
        """Have the disk keep what was written, at most once a second; nobody waits until it has."""
        now_s = time.monotonic()
        if not self._dirty or now_s < self._synced_s + _FSYNC_PERIOD_S:
            return
        if self._disk.begin(self._descriptor, self._new_in):
            self._synced_s, self._dirty, self._new_in = now_s, False, None

    def finish(self) -> None:
        """Write the rest, and wait until the disk has it. It stays locked until `close`, or the end of the process."""
        self.flush(force=True)
        self._disk.end()
        with suppress(OSError):
            os.fdatasync(self._descriptor)

    def close(self) -> None:
        """Finish it, and let go of it."""
        self.finish()
        os.close(self._descriptor)


def _write_all(descriptor: int, data: bytes) -> None:
    """Write all of it: a disk that is almost full takes a part, and says only the next time that it is full.

    Raises:
        OSError: It cannot be written; a part may have been.
    """
    rest = memoryview(data)
    while rest:
        taken = os.write(descriptor, rest)
        if not taken:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        rest = rest[taken:]


def _identity(descriptor: int) -> Tuple[int, int]:
    found = os.fstat(descriptor)
    return found.st_dev, found.st_ino


def create(folder: Path, header: str, elsewhere: Elsewhere) -> JournalFile:
    """Make a journal with its header in a folder that has none. It appears whole or not at all.

    Raises:
        StartError: It cannot be written.
    """
    path, half = folder / JOURNAL_NAME, folder / f".{JOURNAL_NAME}.new"
    try:
        with suppress(FileNotFoundError):
            half.unlink()  # of a process that was killed, with a mode of its own
        descriptor = os.open(half, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, _MODE)
        _write_all(descriptor, header.encode() + b"\n")
        os.fsync(descriptor)
        _lock(descriptor, path)
        half.replace(path)
        sync_folder(folder)
    except OSError as error:
        raise StartError(f"cannot write {path}: {error.strerror}; name another folder with --output") from error
    return JournalFile(path, descriptor, 1, elsewhere)


def open_locked(path: Path) -> int:
    """Open a journal to write on in it, and lock it; return its descriptor.

    Raises:
        InUseError: Another process writes it.
        StartError: It cannot be opened.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except OSError as error:
        raise StartError(f"cannot go on with {path}: {error.strerror}") from error
    try:
        _lock(descriptor, path)
    except (OSError, StartError):
        os.close(descriptor)
        raise
    return descriptor


def go_on(path: Path, descriptor: int, elsewhere: Elsewhere) -> JournalFile:
    """Write on after the last whole line of a journal that is open and locked.

    Raises:
        OSError: It cannot be read, or not be cut there.
    """
    data = path.read_bytes()
    os.ftruncate(descriptor, codec.whole_lines(data))
    return JournalFile(path, descriptor, data.count(b"\n"), elsewhere)


def _lock(descriptor: int, path: Path, limit_s: float = _LET_GO_LIMIT_S) -> None:
    """Lock the journal against a second node; one that is just ending gets the time to let go."""
    deadline_s = time.monotonic() + limit_s
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() > deadline_s:
                raise InUseError(f"{path} is written by another node that still runs: end it first") from error
            time.sleep(0.05)
        else:
            return
