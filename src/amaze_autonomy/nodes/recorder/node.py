"""The recorder node: records on one platform; on the collector it also makes one verified recording of all parts.

On every platform, PLATFORM being its name in recording.yaml:

    PLATFORM/data_recorder/start    StartRecording, PLATFORM/data_recorder/stop    StopRecording: answered at once
    PLATFORM/data_recorder/remove   RemovePart: removes files of its part by their sha256, where that is configured
    PLATFORM/data_recorder/clock    ExchangeClock
    PLATFORM/data_recorder/status   RecordingStatus of this platform, at its rate and at once on a change
    /diagnostics                    diagnostic_msgs/DiagnosticArray, 1 Hz

On the collector, for the engine:

    data_recorder/start, data_recorder/stop    StartRecording, StopRecording: answered at once
    data_recorder/status                       RecordingStatus of all platforms, at its rate and at once on a change
    data_recorder/wanted                       String, latched: the groups of each platform, for the others to compare
    autonomy/state                             AutonomyState: the end of a mission completes the copy of the journal

The rate is `recorder_status_rate_hz` of autonomy.yaml.

Words: `arguments.py`. Parameters: `node_main.py`, and

    ~platform   its name; empty: the collector
    ~optional   without such a platform in recording.yaml it waits and does nothing (default: false)

A node that was killed goes on where it was: recorders that run are kept, jobs are started again. docs/recording.md.
"""

from __future__ import annotations

import fcntl
import os
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Type, Union

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from amaze_autonomy import msg
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.recording import Command, RecordingError
from amaze_autonomy.recording.status import WRITING, PlatformStatus, Status
from amaze_autonomy.recording.storage import LOCK, STATE, read_json, write_json
from amaze_autonomy.ros.clock import Clock

from ...ros.errors import StartError
from ...ros.interface import number, ros_time
from ...ros.node_main import flag, run_node
from ..autonomy.run_folder import boot_id
from .collector import RecorderCollector
from .platform import RecorderPlatform
from .processes import DiskSync
from .settings import RecorderShare, platform_name, recordings_folder

_TURN_S = 0.2


class DataRecorderNode:
    """Both machines, and what carries their commands out. One thread works; requests only change the machines.

    Args:
        configuration: as loaded.
        clock: the node's, for stamps.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        name = platform_name(configuration)
        self._share = RecorderShare(configuration, recordings_folder(configuration), clock.ros_ns)
        self._platform = RecorderPlatform(self._share, name)
        self._collector: Optional[RecorderCollector] = None
        if name == configuration.recording.collector:
            self._collector = RecorderCollector(self._share, self._platform)
        self._memory = RecorderMemory(self._share.folder / STATE.format(platform=name))
        self._lock = RecorderLock(self._share.folder / LOCK.format(platform=name), lambda: self._ended)
        self._teller = RecorderTeller(name, collector=self._collector is not None)
        self._commands: Dict[Type[Any], Callable[[Any], None]] = dict(self._platform.commands)
        if self._collector is not None:
            self._commands.update(self._collector.commands)
        self._status_s = 1.0 / configuration.streams.recorder_status_rate_hz
        self._ended = False

    def run(self) -> None:
        """Work until `end`.

        Raises:
            StartError: Another recorder of this platform works in this folder.
        """
        if not self._lock.take():
            return
        self._remember()
        self._platform.begin()
        self._do(self._platform.step())  # what ended while no node was there is seen before anybody asks for anything
        self._platform.open()
        if self._collector is not None:
            self._collector.open()
        threading.Thread(target=self._tell_always, name="status", daemon=True).start()
        while not self._ended:
            self._share.wake.wait(_TURN_S)
            self._share.wake.clear()
            self._turn()
        self._close()

    def _turn(self) -> None:
        """See, decide, do, keep, tell."""
        self._decide()
        self._keep()
        self._tell(force=False)

    def _decide(self) -> None:
        commands: List[Command] = self._platform.step()
        if self._collector is not None:
            commands += self._collector.step()
        self._do(commands)

    def _do(self, commands: List[Command]) -> None:
        for command in commands:
            self._commands[type(command)](command)

    # --- status ---------------------------------------------------------------------------------------------------

    def _tell_always(self) -> None:
        """Tell the status also while the working thread waits for a slow storage."""
        while not self._ended:
            time.sleep(self._status_s)
            try:
                self._tell(force=True)
            except rospy.ROSException:
                return

    def _tell(self, *, force: bool) -> None:
        with self._share.lock:
            own = self._platform.status()
            whole = self._collector.status() if self._collector is not None else None
        self._teller.tell(self._share.stamp_ns(), own, whole, self._platform.disk, force=force)

    # --- memory ---------------------------------------------------------------------------------------------------

    def _keep(self) -> None:
        """Write down what the next process needs, when it has changed."""
        with self._share.lock:
            content: Dict[str, Any] = {
                **self._platform.memory(),
                "collector": self._collector.memory() if self._collector is not None else None,
            }
        if self._platform.machine.session_id:
            self._memory.keep(content)

    def _remember(self) -> None:
        """Go on where another process of this node ended."""
        content, same_boot = self._memory.read()
        if content is None:
            return
        try:
            self._take_up(content, same_boot=same_boot)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            rospy.logerr("%s holds what cannot be (%r): it is put aside", self._memory.path, error)
            self._memory.put_aside()
            if self._collector is not None:
                self._collector.forget()
            return
        machine = self._platform.machine
        rospy.loginfo("goes on with session %s (%s)", machine.session_id, machine.phase.name)

    def _take_up(self, content: Mapping[str, Any], *, same_boot: bool) -> None:
        if self._collector is not None and content["collector"]:
            self._collector.remember(content["collector"])
        self._platform.remember(content, same_boot=same_boot)

    # --- end ------------------------------------------------------------------------------------------------------

    def end(self) -> None:
        """End; from any thread."""
        self._ended = True
        self._share.wake.set()

    def _close(self) -> None:
        """Close what is recorded: who ends this node ends the recording; who kills it does not."""
        with self._share.lock:
            self._platform.interrupt()
            if self._collector is not None:
                self._collector.interrupt()
        self._turn()
        self._platform.wait()
        if self._collector is not None:
            self._collector.close()
        self._share.jobs.stop()


class AbsentPlatform:
    """Waits in the place of a recorder: the simulation starts one for a platform that a configuration may not have."""

    def __init__(self) -> None:
        self._ended = threading.Event()

    def run(self) -> None:
        """Wait until `end`: a node that ended would be started again for ever."""
        self._ended.wait()

    def end(self) -> None:
        """End; from any thread."""
        self._ended.set()


def make_recorder(configuration: Configuration, clock: Clock) -> Union[DataRecorderNode, AbsentPlatform]:
    """Return the recorder of ~platform; what waits, where ~optional is set and recording.yaml has no such platform.

    Raises:
        StartError: There is no such platform, or its folder cannot be made.
    """
    name = str(rospy.get_param("~platform", ""))
    known = [each.name for each in configuration.recording.platforms]
    if flag("optional", default=False) and name and name not in known:
        rospy.loginfo("recording.yaml has no platform %s: nothing is recorded here", name)
        return AbsentPlatform()
    return DataRecorderNode(configuration, clock)


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("data_recorder", make_recorder)


# --- recorder memory --------------------------------------------------------------------------------------------------
# What a recorder node must know again after it was killed: one file, the old one or the new one, never half.


_SAY_AGAIN_S = 10.0


class RecorderMemory:
    """The file.

    Args:
        path: of it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._kept: Dict[str, Any] = {}

    def keep(self, content: Dict[str, Any]) -> None:
        """Write it when it is not what was written last; a storage that does not take it is said, and tried again."""
        if content == self._kept:
            return
        try:
            write_json(self.path, {"boot_id": boot_id(), **content})
        except RecordingError as error:
            rospy.logerr_throttle(_SAY_AGAIN_S, str(error))
        else:
            self._kept = content

    def read(self) -> Tuple[Optional[Dict[str, Any]], bool]:
        """Return what is there (None: nothing), and whether the system was not started anew since."""
        content = read_json(self.path)
        return content, content is not None and content.get("boot_id") == boot_id()

    def put_aside(self) -> None:
        """Give the file another name."""
        with suppress(OSError):
            self.path.replace(self.path.with_name(f"{self.path.name}.bad"))


# --- recorder lock ----------------------------------------------------------------------------------------------------
# Two recorders of a platform in one folder would write one memory, start recorders into one file, and end each other's.


_LET_GO_LIMIT_S = 12.0  # of one that is told to end, and closes its files first


class RecorderLock:
    """What a recorder holds for as long as its process lives; who kills that ends it, and no process inherits it.

    Args:
        path: of the file.
        over: tells whether to wait no longer.
    """

    def __init__(self, path: Path, over: Callable[[], bool]) -> None:
        self._path, self._over = path, over

    def take(self) -> bool:
        """Take it, waiting for one that is just ending; return False when it is over before.

        A storage that cannot lock, or takes no file, hinders nobody from recording.

        Raises:
            StartError: Another one holds it.
        """
        deadline_s = time.monotonic() + _LET_GO_LIMIT_S
        try:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
            while not self._taken(descriptor):
                if self._over() or time.monotonic() > deadline_s:
                    holder = os.pread(descriptor, 1000, 0).decode(errors="replace") or "another process"
                    os.close(descriptor)
                    if self._over():
                        return False
                    advice = "end it first, or name another folder with --folder"
                    raise StartError(f"{self._path.parent}: {holder} records the same platform there; {advice}")
                time.sleep(0.05)
            with suppress(OSError):  # a full storage; it is held all the same
                os.truncate(descriptor, 0)
                os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode(), 0)
        except OSError as error:
            rospy.logwarn("%s: %s; no second recorder is kept from this folder", self._path, error.strerror)
        return True

    @staticmethod
    def _taken(descriptor: int) -> bool:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


# --- statuses ---------------------------------------------------------------------------------------------------------
# As messages, at 2 Hz and at once on a change; None becomes NaN.


def recording_status(status: Status, ros_ns: int) -> Any:
    """Write a RecordingStatus."""
    message = msg.RecordingStatus(
        session_id=status.session_id,
        phase=status.phase.value,
        progress=number(status.progress),
        platforms=[_platform(each) for each in status.platforms],
        location=status.location,
        message=status.message,
        lost=status.lost,
        remaining=number(status.remaining_s),
        dropped=status.dropped,
    )
    message.header.stamp = ros_time(ros_ns)
    return message


def _platform(part: PlatformStatus) -> Any:
    return msg.PlatformRecording(
        platform=part.platform,
        growing=part.growing,
        bytes=part.written_bytes,
        byte_rate=round(part.byte_rate, 0),
        free_fraction=round(number(part.free_fraction), 4),
        location=part.location,
        message=part.message,
        dropped=part.dropped,
        cpu_fraction=round(number(part.cpu_fraction), 2),
        clock_age=number(part.clock_age_s),
    )


class RecorderTeller:
    """Publishers of one node.

    Args:
        platform: whose node this is.
        collector: whether it also tells of all platforms.
    """

    def __init__(self, platform: str, *, collector: bool) -> None:
        names = {platform: f"{platform}/data_recorder/status"}
        if collector:
            names[""] = "data_recorder/status"
        self._platform = platform
        self._publishers: Dict[str, Any] = {
            who: rospy.Publisher(topic, msg.RecordingStatus, queue_size=10, tcp_nodelay=True)
            for who, topic in names.items()
        }
        self._said: Dict[str, Tuple[Any, ...]] = {}
        self._diagnostics = RecorderDiagnostics(platform)

    def tell(self, stamp_ns: int, own: Status, whole: Optional[Status], disk: DiskSync, *, force: bool) -> None:
        """Publish what is news, or everything; `whole` is the status of all platforms, on the collector."""
        self._tell_one(self._platform, stamp_ns, own, force=force)
        if whole is not None:
            self._tell_one("", stamp_ns, whole, force=force)
        self._diagnostics.publish(stamp_ns, whole if whole is not None else own, disk)

    def _tell_one(self, who: str, stamp_ns: int, status: Status, *, force: bool) -> None:
        news = self._is_news(who, status)
        if force or news:
            self._publishers[who].publish(recording_status(status, stamp_ns))

    def _is_news(self, who: str, status: Status) -> bool:
        parts = tuple((each.platform, each.growing, each.message) for each in status.platforms)
        before, key = self._said.get(who), (status.session_id, status.phase, status.message, parts)
        if before == key:
            return False
        if before is not None and before[1] is not status.phase:
            rospy.loginfo("%s: %s %s", who or "all", status.phase.name, status.message)
        self._said[who] = key
        return True


# --- recorder diagnostics ---------------------------------------------------------------------------------------------
# The recorder on /diagnostics: one status for each platform and one for all, once a second.


_PERIOD_S = 1.0


class RecorderDiagnostics:
    """Publishes them.

    Args:
        platform: whose node this is.
    """

    def __init__(self, platform: str) -> None:
        self._platform, self._due_s = platform, 0.0
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    def publish(self, ros_ns: int, status: Status, disk: DiskSync) -> None:
        """Publish, at most once a second."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + _PERIOD_S
        message = DiagnosticArray(status=self.rows(status, disk))
        message.header.stamp = ros_time(ros_ns)
        self._publisher.publish(message)

    def rows(self, status: Status, disk: DiskSync) -> List[Any]:
        """Return the statuses."""
        failed = status.phase is RecordingPhase.FAILED
        whole = DiagnosticStatus(
            level=DiagnosticStatus.ERROR if failed else DiagnosticStatus.OK,
            name=f"data recorder ({self._platform})",
            message=f"{status.phase.name} {status.message}".strip(),
            values=[KeyValue("session", status.session_id), KeyValue("location", status.location)],
        )
        whole.values.append(KeyValue("disk", disk.problem or disk.cost))
        if disk.problem:
            whole.level, whole.message = DiagnosticStatus.ERROR, disk.problem
        return [whole, *(_row(part, writing=status.phase in WRITING) for part in status.platforms)]


def _row(part: PlatformStatus, *, writing: bool) -> Any:
    level = DiagnosticStatus.WARN if part.message or (writing and not part.growing) else DiagnosticStatus.OK
    free = "" if part.free_fraction is None else f"{part.free_fraction:.3f}"
    busy = "" if part.cpu_fraction is None else f"{part.cpu_fraction:.2f}"
    return DiagnosticStatus(
        level=level,
        name=f"recording on {part.platform}",
        message=part.message or ("records" if part.growing else "does not record"),
        values=[
            KeyValue("bytes", str(part.written_bytes)),
            KeyValue("bytes per second", f"{part.byte_rate:.0f}"),
            KeyValue("free fraction", free),
            KeyValue("CPU load", busy),
            KeyValue("messages dropped, at least", str(part.dropped)),
        ],
    )
