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
    autonomy/state                             AutonomyState: the end of a mission completes the copy of the journal

The rate is `recorder_status_rate_hz` of autonomy.yaml.

Words: `arguments.py`. Parameters: `node_main.py`, and

    ~platform   its name; empty: the collector
    ~optional   without such a platform in recording.yaml it waits and does nothing (default: false)

A node that was killed goes on where it was: recorders that run are kept, jobs are started again. docs/recording.md.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Type, Union

import rospy

from amaze_autonomy.config import Configuration
from amaze_autonomy.recording import Command, RecordingError
from amaze_autonomy.recording.storage import STATE, read_json, write_json
from amaze_autonomy.ros.clock import Clock

from ...ros.node_main import flag, run_node
from ..autonomy.run_folder import boot_id
from .collector import RecorderCollector
from .platform import RecorderPlatform
from .settings import RecorderShare, platform_name, recordings_folder
from .statuses import RecorderTeller

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
        self._teller = RecorderTeller(name, collector=self._collector is not None)
        self._commands: Dict[Type[Any], Callable[[Any], None]] = dict(self._platform.commands)
        if self._collector is not None:
            self._commands.update(self._collector.commands)
        self._status_s = 1.0 / configuration.streams.recorder_status_rate_hz
        self._ended = False

    def run(self) -> None:
        """Work until `end`."""
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
        """End; from any thread and from signal handlers."""
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
        """End; from any thread and from signal handlers."""
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
