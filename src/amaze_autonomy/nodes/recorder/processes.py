"""The recorders' processes on one platform: started, told to end, seen; found again by the next process of the node.

Each has its own process group, so that a Ctrl-C in a terminal does not reach it, and writes its warnings to a file, so
that it does not die with the node: a node that was killed is started again, and goes on with the recorders that run.
"""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryDirectory
from typing import Any, Callable, Dict, FrozenSet, Iterable, List, Mapping, Optional, Sequence, Set, Tuple

import roslib.packages

from amaze_autonomy.config.schemas.recording import Storage, TopicGroup, Transfer
from amaze_autonomy.files import sync_folder
from amaze_autonomy.recording.errors import RecordingError
from amaze_autonomy.recording.programs import (
    LogState,
    bag_name,
    child_command,
    files_of,
    last_number,
    log_name,
    misplaced,
    mounted,
    problem_of,
    progress_of,
    read_line,
    transfer_command,
)
from amaze_autonomy.recording.status import UNWANTED, GroupStatus, ProcessStatus
from amaze_autonomy.recording.storage import PARTS, aside, is_as_listed, joined, read_parts, write_json
from amaze_autonomy.ros.clock import MonotonicClock, Periodic
from amaze_autonomy.ros.liveness import LocalProcess


def recorder_program() -> List[str]:
    """Return the recorder in C++; the script that wraps it would die without it."""
    found = roslib.packages.find_node("rosbag", "record")
    return [str(found[0])] if found else ["rosbag", "record"]


class Subscriptions:
    """What the master says: who subscribes to what, and which topics are published. None: it said nothing lately."""

    def __init__(self, subscribed: Optional[Mapping[str, Sequence[str]]] = None, published: Sequence[str] = ()) -> None:
        self._subscribed, self._published = subscribed, frozenset(published)

    def missing(self, node: str, topics: Sequence[str]) -> Optional[Tuple[str, ...]]:
        """Return the topics that a node is not subscribed to; None when nobody knows."""
        if self._subscribed is None:
            return None
        return tuple(topic for topic in topics if node not in self._subscribed.get(topic, ()))

    def silent(self, topics: Sequence[str]) -> bool:
        """Return whether it is known that nobody publishes any of some topics."""
        return self._subscribed is not None and not any(topic in self._published for topic in topics)


class _Log:
    """Reads a group's log as it grows."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.state = LogState()
        self._place, self._rest = 0, b""

    def read(self) -> LogState:
        with suppress(OSError), self.path.open("rb") as file:
            if file.seek(0, os.SEEK_END) < self._place:  # it was removed, and is another one
                self._place, self._rest = 0, b""
            file.seek(self._place)
            data = file.read()
            self._place += len(data)
            *lines, self._rest = (self._rest + data).split(b"\n")
            for line in lines:
                self.state = read_line(self.state, line.decode("utf-8", "replace"))
        return self.state

    def forget_end(self) -> None:
        """Keep what was counted; how the last recorder ended says nothing about the next one."""
        self.read()
        self.state = LogState(dropped=self.state.dropped)


_ACTIVE = ".active"
"""At the end of the name of a file that is written; it goes when the file is closed."""


class RecorderChildren:
    """The processes of one session on this platform. Used by the node's one working thread.

    Args:
        groups: by name.
        topics: of each group, resolved.
        nodes: name of each group's recorder node, resolved.
        storage: settings.
        program: of the recorder.
    """

    def __init__(
        self,
        groups: Mapping[str, TopicGroup],
        topics: Mapping[str, Sequence[str]],
        nodes: Mapping[str, str],
        storage: Storage,
        program: Sequence[str],
    ) -> None:
        self._groups, self._topics, self._nodes = dict(groups), dict(topics), dict(nodes)
        self._storage, self._program = storage, list(program)
        self._folder: Optional[Path] = None
        self._processes: Dict[str, LocalProcess] = {}
        self._own: Dict[str, subprocess.Popen[bytes]] = {}
        self._endings: Dict[str, str] = {}
        self._logs: Dict[str, _Log] = {}
        self._active: Dict[str, FrozenSet[str]] = {}  # files that are written
        self._gone: Dict[str, FrozenSet[str]] = {}  # those of them that were not there at the last look

    def enter(self, folder: Path) -> None:
        """Work in a session's folder from now on."""
        if folder != self._folder:
            if self._folder is not None:
                self._endings = {}
            self._folder = folder
            self._logs = {name: _Log(folder / log_name(name)) for name in self._names}

    def start(self, name: str, number: int) -> str:
        """Start a recorder; return why that is not possible, or an empty text. It never writes over a file."""
        folder = self._folder
        if folder is None:
            return "no session"
        last = last_number(name, list(_files(folder)))
        if last >= number:
            return f"{folder / bag_name(name, number)}: files up to number {last} are there, and are not written over"
        group = self._groups[name]
        short = self._nodes[name].rsplit("/", 1)[-1]
        command = child_command(
            self._program, short, group, self._topics[name], self._storage, folder / bag_name(name, number)
        )
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with (folder / log_name(name)).open("ab") as log:
                process = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
                )
        except OSError as error:
            self._endings[name] = f"it cannot be started: {error}"
            return self._endings[name]
        self._own[name] = process
        self._active[name] = self._gone[name] = frozenset()
        self._logs[name].forget_end()
        self._take(name, process.pid)
        return ""

    def _take(self, name: str, pid: int) -> None:
        found = LocalProcess.of(pid)
        if found is not None:
            self._processes[name] = found

    def signal(self, name: str, word: str) -> None:
        """Send INT, TERM or KILL to the process group of a recorder."""
        process = self._processes.get(name)
        if process is not None and process.alive:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, getattr(signal, f"SIG{word}"))

    @property
    def running(self) -> Tuple[str, ...]:
        """Return the groups whose recorder is there."""
        return tuple(name for name in self._names if self._is_running(name))

    @property
    def _names(self) -> Tuple[str, ...]:
        """Return the groups, and those of which a recorder was found and that are not in the configuration any more."""
        return tuple(dict.fromkeys([*self._groups, *self._processes]))

    def _is_running(self, name: str) -> bool:
        own = self._own.get(name)
        if own is not None:
            if own.poll() is None:  # asked once: it may end between two questions, and then nobody would know how
                return True
            self._endings[name] = _ending(own.returncode)
            del self._own[name]
        process = self._processes.get(name)
        return process is not None and process.alive

    def look(self, subscriptions: Subscriptions, stamp_ns: Optional[int] = None) -> ProcessStatus:
        """Return all groups as they are now; `stamp_ns` is what a message that is recorded now is stamped with."""
        folder = self._folder
        if folder is None:
            return ProcessStatus()
        files = _files(folder)
        groups = {name: self._see(name, files, subscriptions) for name in self._names}
        return ProcessStatus(groups, stamp_ns=stamp_ns)

    def _see(self, name: str, files: Mapping[str, os.stat_result], subscriptions: Subscriptions) -> GroupStatus:
        names = files_of(name, list(files))
        mine, running = [files[each] for each in names], self._is_running(name)
        process = self._processes.get(name)
        log, topics = self._logs[name].read(), self._topics.get(name, ())
        ending = "" if running else "; ".join(each for each in (self._endings.get(name, ""), log.error) if each)
        return GroupStatus(
            running=running,
            ending=ending,
            size=sum(each.st_size for each in mine),
            idle_ns=max(0, time.time_ns() - max(each.st_mtime_ns for each in mine)) if mine else None,
            missing=subscriptions.missing(self._nodes.get(name, ""), topics) if running else tuple(topics),
            silent=subscriptions.silent(topics),
            dropped=log.dropped,
            full=running and log.full,
            removed=self._active_is_gone(name, names) and running,
            halted=running and process is not None and process.halted,
            number=last_number(name, list(files)),
        )

    def _active_is_gone(self, name: str, names: Sequence[str]) -> bool:
        """Return whether a file that is written is gone, at two looks in a row, and not because it was closed."""
        here = frozenset(names)
        gone = frozenset(
            each for each in self._active.get(name, ()) if each not in here and each[: -len(_ACTIVE)] not in here
        )
        again = bool(gone & self._gone.get(name, frozenset()))
        self._active[name], self._gone[name] = gone | {each for each in names if each.endswith(_ACTIVE)}, gone
        return again

    def memory(self) -> Dict[str, List[int]]:
        """Return number and time of start of each process."""
        return {name: [process.pid, process.start] for name, process in self._processes.items() if process.alive}

    def remember(self, memory: Mapping[str, Sequence[int]]) -> None:
        """Find the processes again that another process of the node started."""
        for name, (pid, start) in memory.items():
            self._processes[name] = LocalProcess(int(pid), int(start))
            self._endings[name] = "it ended while this node was away" if name in self._groups else UNWANTED

    def wait(self, names: Iterable[str], limit_s: float) -> None:
        """Wait until recorders have ended."""
        for name in names:
            if name in self._own:
                with suppress(subprocess.TimeoutExpired):
                    self._own[name].wait(limit_s)
            elif name in self._processes:
                self._processes[name].wait(limit_s)


def _ending(status: int) -> str:
    if status < 0:
        with suppress(ValueError):
            return f"killed by {signal.Signals(-status).name}"
    return f"it ended with status {status}"


def _files(folder: Path) -> Dict[str, os.stat_result]:
    found: Dict[str, os.stat_result] = {}
    with suppress(OSError), os.scandir(folder) as entries:  # not there yet
        for entry in entries:
            with suppress(OSError):
                found[entry.name] = entry.stat()
    return found


# --- disk sync --------------------------------------------------------------------------------------------------------
# Bags that are open are put on the disk once a second, on a thread of its own: a slow disk makes nobody else wait. The
# kernel writes back after 30 s, and gives a file its length only then; until then a power cut leaves 0 bytes.


_SYNC_PERIOD_NS = 1_000_000_000


class DiskSync:
    """Has the disk keep what recorders have written, and the names of their files."""

    def __init__(self) -> None:
        self._folder: Optional[Path] = None
        self._kept: Dict[str, Tuple[int, int]] = {}
        self._periodic = Periodic("sync", self.sync, _SYNC_PERIOD_NS, MonotonicClock())
        self.count, self.total_s, self.most_s = 0, 0.0, 0.0
        self.problem = ""

    def start(self) -> None:
        """Begin."""
        self._periodic.start()

    def enter(self, folder: Path) -> None:
        """Look after another session's folder from now on."""
        if folder != self._folder:
            self._folder, self.count, self.total_s, self.most_s = folder, 0, 0.0, 0.0

    def sync(self) -> None:
        """Put everything on the disk that has changed since the last time."""
        folder = self._folder
        files = _files(folder) if folder is not None else {}
        now = {name: (each.st_size, each.st_mtime_ns) for name, each in files.items() if ".bag" in name}
        if folder is None or now == self._kept:
            return
        began_s = time.monotonic()
        try:
            for name in sorted(now):
                if self._kept.get(name) != now[name]:
                    _sync_file(folder / name)
            if now.keys() != self._kept.keys():
                for each in (folder, folder.parent, folder.parent.parent):
                    sync_folder(each)
        except OSError as error:
            self.problem = f"{folder}: cannot be put on the disk ({error.strerror})"
            return
        took_s = time.monotonic() - began_s
        self._kept, self.problem = now, ""
        self.count, self.total_s, self.most_s = self.count + 1, self.total_s + took_s, max(self.most_s, took_s)

    @property
    def cost(self) -> str:
        """Return what it has cost, in words."""
        mean_ms = self.total_s / self.count * 1000 if self.count else 0.0
        return f"put on the disk {self.count} times, {mean_ms:.1f} ms each, {self.most_s * 1000:.1f} ms at most"


def _sync_file(path: Path) -> None:
    """Wait until a file is on the disk, whoever writes it; one with another name by now is seen next time."""
    with suppress(FileNotFoundError):
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fdatasync(file)
        finally:
            os.close(file)


# --- recorder jobs ----------------------------------------------------------------------------------------------------
# The processes that work on a recorder's files: jobs on bags, and rsync. None of them outlives the node for long.


_log = logging.getLogger(__name__)
_LAST_WORDS = 400
Progress = Callable[[Mapping[str, Any]], None]
Ended = Callable[[Mapping[str, Any]], None]


class _Fetch:
    """One fetch of a part: how, from where to where, its process, and whether it was given up."""

    def __init__(self, transfer: Transfer, location: str, target: Path, progress: Callable[[float], None]) -> None:
        self.transfer, self.location, self.target, self.progress = transfer, location, target, progress
        self.process: Optional[subprocess.Popen[Any]] = None
        self.over = False


class RecorderJobs:
    """Starts them, each with a thread of its own that waits for it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._processes: Set[subprocess.Popen[Any]] = set()
        self._fetches: Dict[Path, _Fetch] = {}  # the last one into each folder
        self._over = False

    def stop(self) -> None:
        """End all of them."""
        with self._lock:
            self._over = True
            processes = list(self._processes)
        for process in processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

    # --- jobs on bags ---------------------------------------------------------------------------------------------

    def run(self, request: Mapping[str, Any], progress: Progress, ended: Ended) -> None:
        """Run a job of `amaze_autonomy.recording.job`.

        Args:
            request: what it shall do.
            progress: called with each line of its progress.
            ended: called with its result: its problem, or an empty text; `killed` when it was.
        """
        threading.Thread(target=self._run, args=(request, progress, ended), name="job", daemon=True).start()

    def _run(self, request: Mapping[str, Any], progress: Progress, ended: Ended) -> None:
        result: Dict[str, Any] = {}
        command = [sys.executable, "-m", "amaze_autonomy.recording.job"]
        try:
            process = self._start(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        except OSError as error:
            ended({"problem": f"the job cannot be started: {error}"})
            return
        last = _Tail(process.stderr)
        with suppress(OSError):
            process.stdin.write((json.dumps(request) + "\n").encode())
            process.stdin.flush()
        for line in process.stdout:
            with suppress(ValueError):
                said = json.loads(line)
                result = said.get("result", result)
                if "progress" in said:
                    progress(said)
        status = self._wait(process)
        if not result:
            words = "; ".join(last.text().splitlines()[-2:])
            why = f"killed by {signal.Signals(-status).name}" if status < 0 else words or f"status {status}"
            result = {"problem": f"the process that works on the bags has ended ({why})", "killed": status < 0}
        ended(result)

    # --- transfer -------------------------------------------------------------------------------------------------

    def fetch(self, transfer: Transfer, location: str, target: Path, progress: Callable[[float], None]) -> str:
        """Fetch a part, waiting for it; return why it did not come, or an empty text.

        A fetch into the same folder that still runs is ended first.

        Args:
            transfer: how.
            location: of the part, as the platform names it.
            target: folder on this computer.
            progress: called with 0..1.
        """
        if not location:
            return "the platform did not say where its part lies"
        problem = misplaced(location, target)
        if problem:
            return problem
        if transfer.by == "here":
            return "" if (Path(location) / PARTS).is_file() else f"{location} is not on this computer"
        fetch = _Fetch(transfer, location, target, progress)
        self.stop_fetch(target)
        with self._lock:
            self._fetches[target] = fetch
        try:
            return self._fetched(fetch)
        except OSError as error:
            return f"{target}: {error.strerror}"
        except RecordingError as error:
            return str(error)
        finally:
            self.stop_fetch(target, fetch)

    def stop_fetch(self, target: Path, only: Optional[_Fetch] = None) -> None:
        """End what is fetched into a folder, or `only` this; where it hangs, it does nothing more when it goes on."""
        with self._lock:
            fetch = self._fetches.get(target)
            if fetch is None or (only is not None and fetch is not only):
                return
            del self._fetches[target]
            fetch.over = True
            if fetch.process is not None:
                with suppress(ProcessLookupError):
                    os.killpg(fetch.process.pid, signal.SIGKILL)

    def _fetched(self, fetch: _Fetch) -> str:
        """Fetch the list of a part, then what it names."""
        source = mounted(fetch.transfer, fetch.location)
        if fetch.transfer.by == "shared" and not Path(source).is_dir():
            return f"{source} is not there: is the other platform's storage mounted?"
        fetch.target.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix="amaze-list-") as folder:  # the list here says what came whole before
            problem = self._rsync(fetch, [PARTS], Path(folder))
            sent = None if problem else read_parts(Path(folder))
        if problem:
            return problem
        if sent is None:
            return f"{fetch.location}/{PARTS} is no list of a part; retry, and its platform lists anew what is there"
        # what is whole here stays as it is: where it came from it may have gone bad since
        content, kept = joined(fetch.target, sent)
        files = [each for each in content["files"] if each["file"] not in kept and not each.get("unreadable")]
        rest = {str(each["file"]): each for each in files}
        bags = [name for name, entry in rest.items() if not is_as_listed(fetch.target / name, entry)]
        if fetch.over:
            raise OSError(0, "it was given up")
        for name in sorted(kept):
            _log.warning("%s/%s is not there as it was listed; it came whole before, and is used", fetch.location, name)
        for path in (fetch.target / name for name in bags):
            if path.parent == fetch.target and path.is_file():  # nobody knows what it has more than what comes now
                path.replace(aside(path))
        write_json(fetch.target / PARTS, content)
        return self._rsync(fetch, [*bags, *content.get("logs", [])], fetch.target)

    def _rsync(self, fetch: _Fetch, names: Sequence[str], target: Path) -> str:
        with NamedTemporaryFile("w", encoding="utf-8", prefix="amaze-wanted-") as listing:  # each fetch has its own
            listing.write("".join(f"{name}\n" for name in names))
            listing.flush()
            command = transfer_command(fetch.transfer, fetch.location, target, Path(listing.name))
            process = self._start(command, fetch, stderr=subprocess.PIPE)
            last = _Tail(process.stderr)
            while True:
                data = os.read(process.stdout.fileno(), 4096)
                if not data:
                    break
                done = progress_of(data.decode("utf-8", "replace"))
                if done is not None and names != [PARTS]:
                    fetch.progress(done)
            status = self._wait(process, fetch)
        return "" if status == 0 else f"rsync: {problem_of(last.text(), status)}"

    # --- processes ------------------------------------------------------------------------------------------------

    def _start(self, command: Sequence[str], fetch: Optional[_Fetch] = None, **options: Any) -> Any:
        options.setdefault("stdin", subprocess.DEVNULL)
        with self._lock:
            if self._over:
                raise OSError(0, "the node ends")
            if fetch is not None and fetch.over:
                raise OSError(0, "it was given up")
            process = subprocess.Popen(list(command), stdout=subprocess.PIPE, start_new_session=True, **options)
            self._processes.add(process)
            if fetch is not None:
                fetch.process = process
        return process

    def _wait(self, process: Any, fetch: Optional[_Fetch] = None) -> int:
        status = int(process.wait())
        with self._lock:
            self._processes.discard(process)
            if fetch is not None:
                fetch.process = None
        for stream in (process.stdin, process.stdout):
            if stream is not None:
                with suppress(OSError):
                    stream.close()
        return status


class _Tail:
    """Reads a stream to its end on a thread of its own, and keeps its last words."""

    def __init__(self, stream: Any) -> None:
        self._data = b""
        self._thread = threading.Thread(target=self._read, args=(stream,), name="stderr", daemon=True)
        self._thread.start()

    def _read(self, stream: Any) -> None:
        with stream:
            while True:
                data = stream.read1(4096)
                if not data:
                    return
                self._data = (self._data + data)[-_LAST_WORDS:]

    def text(self) -> str:
        self._thread.join(1.0)
        lines = [line.strip() for line in self._data.decode("utf-8", "replace").splitlines() if line.strip()]
        return "\n".join(lines)
