"""The folder of one run: journal, report, result; and the journal that an unfinished run left behind.

A run that did not end is gone on with by the engine that it was of, and by no other: of the same name, told the same
folders. So a simulated run is none that a real flight goes on with, wherever it lies, and an engine finds its own run
where that went on when its folder was removed.
"""

from __future__ import annotations

import errno
import fcntl
import gc
import json
import os
import stat
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache, partial
from itertools import count
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

import rospkg

from amaze_autonomy.engine.events import Event, MissionSelected
from amaze_autonomy.whole_file import sync_folder, write_whole

from ...journal import journal as codec
from ...paths import expanded
from ...ros.errors import StartError

RESULT_NAME = "result.json"
_REGISTER = "journals"
_LONGEST_HEADER = 1 << 20
BOOT_CLOCK = "monotonic"  # of journals whose times go on within a boot, whatever is done to the wall clock
ROS_CLOCK = "ROS time"  # of those whose times are what /clock says
_LOOKED_AT = 500  # journals, before the search for the own one is given up
_TAIL = 1 << 16  # bytes of a journal, in which a line says a time as a rule
REPORT_NAME = "report.txt"


Fits = Callable[[Path, Mapping[str, Any]], bool]


@dataclass(frozen=True)
class Unfinished:
    """A journal whose run did not end, and that no other process writes: the process was killed, or ended in flight.

    Args:
        path: of the journal.
        header: its first line.
        events: all events in it, in order.
        journal: the file, locked, to write on in.
    """

    path: Path
    header: Dict[str, Any]
    events: List[Event]
    journal: JournalFile

    @property
    def last_ns(self) -> int:
        """Return the time of its last event; 0 when it has none."""
        return self.events[-1].t_ns if self.events else 0

    @property
    def selected(self) -> bool:
        """Tell whether missions were selected in it."""
        return any(isinstance(event, MissionSelected) for event in self.events)


@lru_cache(maxsize=None)
def boot_id() -> str:
    """Return what tells one start of the system from the next; the monotonic clock is worth nothing beyond it."""
    return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()


def default_parent() -> Path:
    """Return the folder that the runs' folders are made in when none is named."""
    return Path(rospkg.get_ros_home()) / "amaze_autonomy"


@dataclass(frozen=True)
class Place:
    """Where an engine is told to keep its runs, and its name: who it is.

    Args:
        output: folder of the run; empty: a new one in `runs`.
        runs: folder of the runs; empty: `default_parent`.
        node: name of the engine.
    """

    output: str = ""
    runs: str = ""
    node: str = ""

    @property
    def named(self) -> Optional[Path]:
        """The folder that is named for the run."""
        return expanded(self.output).absolute() if self.output else None

    @property
    def parent(self) -> Path:
        """The folder of the runs."""
        return expanded(self.runs).absolute() if self.runs else default_parent().absolute()

    def facts(self) -> Dict[str, str]:
        """Return what the header of a journal says of it."""
        return {"node": self.node, "output": str(self.named or ""), "runs": str(self.parent)}

    def has(self, path: Path, header: Mapping[str, Any]) -> bool:
        """Tell whether a journal is of this engine, by its header; one that lies in the named folder is of its run."""
        lies_there = path.parent == self.named
        return all(header.get(key) == value or (key == "output" and lies_there) for key, value in self.facts().items())

    def elsewhere(self) -> Iterator[Path]:
        """Make places to go on in when the folder of a run is removed: the named one again, then one among the runs."""
        if self.named is not None:
            with suppress(OSError):  # who goes on there finds out that it is not there
                self.named.mkdir(parents=True, exist_ok=True)
            yield self.named
        yield _fresh(self.parent, f"removed-{time.strftime('%Y%m%dT%H%M%S')}")


def make_folder(place: Place, label: str) -> Path:
    """Return an empty folder for a new run; what an earlier run left in a named one is kept under its own name.

    Args:
        place: where the engine keeps its runs.
        label: its name there.

    Raises:
        StartError: It cannot be made.
    """
    try:
        if place.named is None:
            return _fresh(place.parent, label)
        place.named.mkdir(parents=True, exist_ok=True)
        _keep_earlier(place.named)
    except OSError as error:
        raise StartError(f"cannot make the output folder: {error}; name another one with --output") from error
    return place.named


def _fresh(parent: Path, label: str) -> Path:
    parent.mkdir(parents=True, exist_ok=True)
    number = 1
    while True:
        folder = parent / (label if number == 1 else f"{label}-{number}")
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder


def _keep_earlier(folder: Path) -> None:
    """Move an earlier run's files into a folder of their own beside the new ones."""
    names = [name for name in (JOURNAL_NAME, REPORT_NAME, RESULT_NAME) if (folder / name).exists()]
    if not names:
        return
    earlier = _fresh(folder, "earlier")
    for name in names:
        (folder / name).rename(earlier / name)


def own_label(now: datetime) -> str:
    """Return the label of a run that begins: the time, in seconds, of the first second that no other run has.

    Sessions and journals are named by it: two engines of a user that start in one second would have the same.
    """
    labels = ((now + timedelta(seconds=later)).strftime("%Y%m%dT%H%M%S") for later in count())
    folder, label = default_parent() / _REGISTER, next(labels)
    with suppress(OSError):  # `register` says what is wrong
        folder.mkdir(parents=True, exist_ok=True)
    while True:
        try:
            (folder / label).symlink_to(JOURNAL_NAME)  # until its journal is there
        except FileExistsError:
            label = next(labels)
        except OSError:
            return label
        else:
            return label


def register(label: str, path: Path) -> None:
    """Name a run's journal where only this user can: the recorder finds it by the label of its sessions.

    Raises:
        OSError: It cannot be named.
    """
    link = default_parent() / _REGISTER / label
    link.parent.mkdir(parents=True, exist_ok=True)
    half = link.with_name(f".{label}.{os.getpid()}")
    with suppress(FileNotFoundError):
        half.unlink()
    half.symlink_to(path.resolve())
    half.replace(link)


def registered(session_id: str) -> Optional[Path]:
    """Return the journal of a session's run; None when this user named none, or what is named is no journal of it."""
    label = session_id.rpartition("-")[0]
    if not label or "/" in label or label.startswith("."):
        return None
    try:
        path = Path(os.path.realpath(default_parent() / _REGISTER / label))
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            found = os.fstat(descriptor)
            own = stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid() and path.name == JOURNAL_NAME
            header = codec.decode(file.readline(_LONGEST_HEADER).decode()).kind == "header" if own else False
    except (OSError, ValueError):  # also no journal, and a name with NUL
        return None
    return path if header else None


class InUseError(StartError):
    """Another process still writes the journal of this engine."""


def find_unfinished(place: Place, fits: Fits = lambda *_: True) -> Optional[Unfinished]:
    """Return the journal to go on with: the last of this engine in this boot, when it has not ended.

    An engine of the same name that the master has ended for this one writes for a moment more, its landing too: it is
    waited for before anything but the header is read.

    The dates of files tell which was the last only as far as the wall clock goes on: a computer without a clock of its
    own begins each boot with an old time. So a journal of another boot is passed over, whatever its date, and of those
    of this one the last word counts, on the clock of the boot.

    Args:
        place: where the engine keeps its runs.
        fits: tells of the path and the header of one that has not ended whether it can be gone on with.

    Raises:
        InUseError: There is one, and another process goes on writing it.
        StartError: There is one, and it is damaged, or cannot be opened.
    """
    ours: List[Tuple[Path, Dict[str, Any]]] = []
    newest_first = _newest_first(place)
    for path in newest_first:
        try:
            header = _header(path, also=path == newest_first[0])
        except (OSError, UnicodeDecodeError, codec.JournalError) as error:
            if path == newest_first[0]:
                raise _cannot_be_read(path, error) from error
            continue
        if header.get("boot_id") == boot_id() and place.has(path, header):
            ours.append((path, header))
    if not ours:
        return None
    path, header = _last_of(ours)
    if _ended(path.parent / RESULT_NAME) or not fits(path, header):
        return None
    return _taken_up(path, header, place)


def _last_of(journals: Sequence[Tuple[Path, Dict[str, Any]]]) -> Tuple[Path, Dict[str, Any]]:
    """Return the journal, of some with the newest first, whose last word came last on a clock that is never set."""
    newest = journals[0]
    if newest[1].get("clock") != BOOT_CLOCK:
        return newest
    return max((each for each in journals if each[1].get("clock") == BOOT_CLOCK), key=lambda each: _last_ns(each[0]))


def _last_ns(path: Path) -> int:
    """Return the time of the last line that says one, ns; -1: none does. Delta lines do not, for a minute of them."""
    with suppress(OSError), path.open("rb") as file:
        size, tail = file.seek(0, os.SEEK_END), _TAIL
        while True:
            file.seek(max(0, size - tail))
            for line in reversed(file.read().split(b"\n")):
                if b'"t_ns"' in line:
                    with suppress(ValueError, KeyError, TypeError):
                        return int(json.loads(line)["t_ns"])
            if tail >= size:
                break
            tail *= 2
    return -1


def _taken_up(path: Path, header: Dict[str, Any], place: Place) -> Optional[Unfinished]:
    descriptor = open_locked(path)
    try:
        if _ended(path.parent / RESULT_NAME):  # meanwhile
            os.close(descriptor)
            return None
        data = path.read_bytes()
        read = _read(data)
        journal = go_on(path, descriptor, place.elsewhere)
    except (OSError, UnicodeDecodeError, codec.JournalError) as error:
        os.close(descriptor)
        raise _cannot_be_read(path, error) from error
    events = [line.payload for line in read.lines if isinstance(line.payload, Event)]
    return Unfinished(path, header, events, journal)


def _read(data: bytes) -> codec.Journal:
    looked_for = gc.isenabled()
    gc.disable()  # very many values without cycles: looking for those takes as long as all the rest
    try:
        return codec.read(data[: codec.whole_lines(data)].decode())
    finally:
        if looked_for:
            gc.enable()


def _cannot_be_read(path: Path, error: Exception) -> StartError:
    return StartError(f"{path} is of a run that did not end, and cannot be read: {error}")


def _newest_first(place: Place) -> List[Path]:
    """Return the journals where a run of this engine may be: in the named folder, and where it may have gone on."""
    there = [place.named / JOURNAL_NAME] if place.named is not None else []
    there += place.parent.glob(f"{'removed-*' if place.output else '*'}/{JOURNAL_NAME}")
    written: List[Tuple[float, Path]] = []
    for path in there:
        with suppress(OSError):  # it is not there, or no more
            if path.is_file():
                written.append((path.stat().st_mtime, path))
    return [path for _, path in sorted(written, reverse=True)[:_LOOKED_AT]]


def _header(path: Path, *, also: bool) -> Dict[str, Any]:
    """Return what the first line of a journal says; nothing where it is no header, or does not name this boot.

    To look for that takes a tenth of the time of reading it, and there may be hundreds; who starts again flies.

    Args:
        path: of the journal.
        also: read it whatever it names, and tell whether it can be read.

    Raises:
        OSError, UnicodeDecodeError, JournalError: It cannot be read.
    """
    with path.open("rb") as file:
        line = file.readline(_LONGEST_HEADER)
    if not also and boot_id().encode() not in line:
        return {}
    first = codec.decode(line.decode())
    return first.payload if first.kind == "header" and isinstance(first.payload, dict) else {}


def _ended(result: Path) -> bool:
    try:
        return not json.loads(result.read_text(encoding="utf-8"))["in_flight"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


def write_result(folder: Path, result: Dict[str, Any]) -> None:
    """Write result.json whole or not at all.

    Raises:
        OSError: It cannot be written.
    """
    write_whole(folder / RESULT_NAME, json.dumps(result, indent=2, sort_keys=True) + "\n")


# --- journal file -----------------------------------------------------------------------------------------------------
# The journal on disk: appended line by line, flushed at each decision, on the disk within a second where that can.
#  A disk that is full or gone is not a reason to stop an engine in flight: what could not be written is kept, said,
# and written as soon as it can be. The file then has no gap, unless so much was kept that it had to go.


JOURNAL_NAME = "journal.jsonl"
_FSYNC_PERIOD_S = 1.0
_RETRY_PERIOD_S = 1.0
_HELD_UP_S = 3.0  # a card that tidies up takes one or two
_MOST_KEPT = 16 * 1024 * 1024  # bytes that wait for a disk
_PIECE = 1024 * 1024
_LET_GO_LIMIT_S = 8.0  # of an engine that is told to end in flight, which lands first
_MODE = 0o640


Elsewhere = Callable[[], Iterable[Path]]


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
