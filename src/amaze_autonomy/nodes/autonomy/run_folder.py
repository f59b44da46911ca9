"""The folder of one run: journal, report, result; and the journal that an unfinished run left behind.

A run that did not end is gone on with by the engine that it was of, and by no other: of the same name, told the same
folders. So a simulated run is none that a real flight goes on with, wherever it lies, and an engine finds its own run
where that went on when its folder was removed.
"""

from __future__ import annotations

import gc
import json
import os
import stat
import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import rospkg

from amaze_autonomy.engine.events import Event, MissionSelected
from amaze_autonomy.files import write_whole

from ...journal import journal as codec
from ...paths import expanded
from ...ros.errors import StartError
from .journal_file import JOURNAL_NAME, JournalFile, go_on, open_locked

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
        away_ns: since when it was written last, by the wall clock; one that was set meanwhile tells too much.
    """

    path: Path
    header: Dict[str, Any]
    events: List[Event]
    journal: JournalFile
    away_ns: int = 0

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
    """Move an earlier run's files into a folder of their own beside the new ones; its journal is named there."""
    names = [name for name in (JOURNAL_NAME, REPORT_NAME, RESULT_NAME) if (folder / name).exists()]
    if not names:
        return
    label = _label_of(folder / JOURNAL_NAME)
    named = registered(f"{label}-") == (folder / JOURNAL_NAME).resolve()  # it is no copy of one elsewhere
    earlier = _fresh(folder, "earlier")
    for name in names:
        (folder / name).rename(earlier / name)
    if named:
        with suppress(OSError):  # then it is not found any more, and no other one in its place
            register(label, earlier / JOURNAL_NAME)


def _label_of(journal: Path) -> str:
    """Return the label of a journal's run by its header; empty: it says none."""
    with suppress(OSError, ValueError):
        return str(_header(journal, also=True).get("label", "")) if journal.is_file() else ""
    return ""


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


def register(label: str, path: Path, also: str = "") -> None:
    """Name a run's journal where only this user can: the recorder finds it by the label of its sessions.

    Args:
        label: of the run, as the header of its journal says it.
        path: of the journal.
        also: label of who goes on with the run, if it is another one. It leads to the first, wherever the journal goes.

    Raises:
        OSError: It cannot be named.
    """
    folder = default_parent() / _REGISTER
    folder.mkdir(parents=True, exist_ok=True)
    for name, there in ((label, str(path.resolve())), (also, label)):
        if name and name != there:
            half = folder / f".{name}.{os.getpid()}"
            with suppress(FileNotFoundError):
                half.unlink()
            half.symlink_to(there)
            half.replace(folder / name)


def registered(session_id: str) -> Optional[Path]:
    """Return the journal of a session's run; None when this user named none, or what is named is no journal of it.

    Where a journal lay another run's may lie now: the header tells whose it is.
    """
    label = session_id.rpartition("-")[0]
    if not label or "/" in label or label.startswith("."):
        return None
    try:
        link = default_parent() / _REGISTER / label
        path, first = Path(os.path.realpath(link)), os.readlink(link)
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            found = os.fstat(descriptor)
            own = stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid() and path.name == JOURNAL_NAME
            line = codec.decode(file.readline(_LONGEST_HEADER).decode()) if own else None
    except (OSError, ValueError):  # also no journal, and a name with NUL
        return None
    header = line.payload if line is not None and line.kind == "header" else None
    return path if isinstance(header, dict) and header.get("label") in (label, first) else None


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
        away_ns = abs(time.time_ns() - os.fstat(descriptor).st_mtime_ns)
        data = path.read_bytes()
        read = _read(data)
        journal = go_on(path, descriptor, place.elsewhere)
    except (OSError, UnicodeDecodeError, codec.JournalError) as error:
        os.close(descriptor)
        raise _cannot_be_read(path, error) from error
    events = [line.payload for line in read.lines if isinstance(line.payload, Event)]
    return Unfinished(path, header, events, journal, away_ns)


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
