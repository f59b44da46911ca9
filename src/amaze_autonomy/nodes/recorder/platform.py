"""The recorder of this platform: its requests, its recorders' processes, and the job that makes its part whole."""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Type

import rosgraph
import rospy
from std_msgs.msg import String

from amaze_autonomy import srv
from amaze_autonomy.recording import Answer, Command, PlatformRecorder, Status
from amaze_autonomy.recording import status as asked
from amaze_autonomy.recording.status import WRITING
from amaze_autonomy.recording.storage import needed_bytes, remove_part, session_name, space_of, too_little
from amaze_autonomy.ros.clock import MonotonicClock, Periodic

from ...ros.interface import ros_time
from .processes import DiskSync, RecorderChildren, Subscriptions, recorder_program
from .settings import RecorderShare, platform_setup

_END_LIMIT_S = 10.0
_MOST_WANTED = 256 * 1024  # characters; what is longer is none


class RecorderPlatform:
    """This platform's machine, and what carries its commands out.

    Args:
        share: of the node.
        name: of the platform.
    """

    def __init__(self, share: RecorderShare, name: str) -> None:
        self._share, self.name = share, name
        recording = share.configuration.recording
        groups = {group.name: group for group in recording.groups_of(name)}
        setup = platform_setup(share.configuration, name)
        topics = {each.name: each.topics for each in setup.groups}
        nodes = {each: rospy.resolve_name(f"record_{name}_{each}") for each in groups}
        self._groups = tuple(groups.values())
        self._children = RecorderChildren(groups, topics, nodes, recording.storage, recorder_program())
        self.machine = PlatformRecorder(setup)
        self._master, self.disk, self._cpu = MasterView(), DiskSync(), CpuLoad()
        self.commands: Mapping[Type[Any], Callable[[Any], None]] = {
            asked.StartChild: self._start_child,
            asked.Signal: lambda it: self._children.signal(it.group, it.name),
            asked.Recover: self._recover,
        }

    # --- requests; on rospy's threads -----------------------------------------------------------------------------

    def open(self) -> None:
        """Offer the services."""
        own, serve = f"{self.name}/data_recorder", self._share.serve
        serve(f"{own}/start", srv.StartRecording, lambda it: self.start(it.session_id, it.mission_id))
        serve(f"{own}/stop", srv.StopRecording, lambda it: self.stop(it.session_id))
        serve(f"{own}/remove", srv.RemovePart, lambda it: self.remove(it.session_id, dict(zip(it.files, it.sha256))))
        self._share.services.append(rospy.Service(f"{own}/clock", srv.ExchangeClock, self._exchange))
        rospy.Subscriber("data_recorder/wanted", String, self._compare, queue_size=1)

    def _compare(self, message: Any) -> None:
        """Compare this copy of the configuration with the collector's: what it lacks is said before a flight."""
        try:
            wanted = json.loads(message.data[:_MOST_WANTED])[self.name]
            with self._share.lock:
                lacks = self.machine.compare(wanted)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            rospy.logwarn("data_recorder/wanted says nothing of %s that could be compared (%r)", self.name, error)
            return
        if lacks:
            advice = "copy the collector's configuration to this computer, and start its data_recorder again"
            rospy.logwarn("%s: %s; %s", self.name, "; ".join(lacks), advice)

    def _exchange(self, _request: Any) -> Any:
        received_ns = self._share.stamp_ns()
        return srv.ExchangeClockResponse(
            received=ros_time(received_ns),
            answered=ros_time(self._share.stamp_ns()),
        )

    def start(self, session_id: str, mission_id: str) -> Answer:
        """Begin to record."""
        share, storage = self._share, self._share.configuration.recording.storage
        space = space_of(share.folder)
        needed = needed_bytes(storage, self._groups, self._duration_s(mission_id))
        with share.lock:
            again = self.machine.session_id == session_id and self.machine.phase in WRITING
            problem = "" if again or space is None else too_little(storage, needed, space, str(share.folder))
            return self.machine.start(share.now_ns(), session_id, mission_id, problem)

    def _duration_s(self, mission_id: str) -> float:
        try:
            return self._share.configuration.plan(mission_id).mission.estimated_duration_s or 0.0
        except KeyError:
            return 0.0

    def stop(self, session_id: str) -> Answer:
        """End the recording."""
        with self._share.lock:
            return self.machine.stop(self._share.now_ns(), session_id)

    def remove(self, session_id: str, verified: Mapping[str, str]) -> Answer:
        """Remove the files of the part whose checksums are in the verified recording; the collector knows them."""
        share = self._share
        with share.lock:
            answer = self.machine.may_remove(session_id, keep=share.configuration.recording.keep_parts)
            location = Path(self.machine.location)
        if answer.accepted:
            share.workers.submit(lambda: remove_part(location, share.folder, verified))
        return answer

    # --- the work; on the working thread --------------------------------------------------------------------------

    def begin(self) -> None:
        """Begin to look."""
        self._master.start()
        self.disk.start()

    @property
    def folder(self) -> Path:
        """Return the folder of its part."""
        return self._share.folder / session_name(self.machine.session_id, self.machine.mission_id) / self.name

    def step(self) -> List[Command]:
        """See and decide; return what is to be done. The files are looked at without holding the lock."""
        with self._share.lock:
            self._enter()
            session_id = self.machine.session_id
        seen = self._children.look(Subscriptions(*self._master.seen()), self._share.stamp_ns())
        processes = replace(seen, space=space_of(self._share.folder), cpu_fraction=self._cpu.look())
        with self._share.lock:
            if self.machine.session_id != session_id:  # begun meanwhile: what was seen are the files of another one
                return []
            commands = list(self.machine.step(self._share.now_ns(), processes))
            self._enter()
        return commands

    def _enter(self) -> None:
        if self.machine.session_id:
            self._children.enter(self.folder)
            self.disk.enter(self.folder)
            self.machine.location = str(self.folder)

    def status(self) -> Status:
        """Return its status; whoever asks holds the lock."""
        return self.machine.status(self._share.now_ns())

    def _start_child(self, command: asked.StartChild) -> None:
        problem = self._children.start(command.group, command.number)
        if problem:
            rospy.logerr("the recorder of %s: %s", command.group, problem)

    def _recover(self, _command: asked.Recover) -> None:
        machine, share, session, folder = self.machine, self._share, self.machine.session_id, self.folder
        rospy.loginfo("%s: %s", self.name, self.disk.cost)

        def progress(line: Mapping[str, Any]) -> None:
            with share.lock:
                machine.recovery_progress(float(line["progress"]))

        def ended(result: Mapping[str, Any]) -> None:
            for name in result.get("foreign", ()):
                rospy.logwarn("%s/%s is not a recorder's: it is not merged", folder, name)
            with share.lock:
                if machine.session_id == session:
                    killed = bool(result.get("killed"))
                    machine.recovery_ended(share.now_ns(), str(result["problem"]), killed=killed)
            share.wake.set()

        share.jobs.run({"do": "close", "folder": str(folder), "facts": machine.facts()}, progress, ended)

    # --- memory and end -------------------------------------------------------------------------------------------

    def memory(self) -> Dict[str, Any]:
        """Return what the next process needs; whoever asks holds the lock."""
        return {"platform": self.machine.memory(), "processes": self._children.memory()}

    def remember(self, content: Mapping[str, Any], *, same_boot: bool) -> None:
        """Go on where another process of this node ended; what is no memory raises, and changes nothing."""
        machine = PlatformRecorder(self.machine.setup)
        machine.remember(self._share.now_ns(), content["platform"], same_boot=same_boot)
        self._children.remember(content["processes"] if same_boot else {})
        self.machine = machine

    def interrupt(self) -> None:
        """Close what is recorded: who ends this node ends the recording; who kills it does not."""
        if self.machine.phase in WRITING:
            self.machine.stop(self._share.now_ns(), self.machine.session_id)

    def wait(self) -> None:
        """Wait until its recorders have ended."""
        self._children.wait(self._children.running, _END_LIMIT_S)


# --- recorder topics --------------------------------------------------------------------------------------------------
# What the master says about who publishes and subscribes to the topics that are recorded.


_PERIOD_NS = 500_000_000
_FRESH_S = 5.0


class MasterView:
    """Asks the master, again and again, on a thread of its own: a master that hangs makes nobody wait."""

    def __init__(self) -> None:
        self._master = rosgraph.Master(rospy.get_name())
        self._seen: Tuple[Mapping[str, Sequence[str]], List[str]] = ({}, [])
        self._at_s: Optional[float] = None
        self._periodic = Periodic("master", self._ask, _PERIOD_NS, MonotonicClock())

    def start(self) -> None:
        """Begin to ask."""
        self._periodic.start()

    def _ask(self) -> None:
        publishers, subscribers, _ = self._master.getSystemState()
        found: Dict[str, Sequence[str]] = dict(subscribers)
        self._seen = found, [topic for topic, nodes in publishers if nodes]
        self._at_s = time.monotonic()

    def seen(self) -> Tuple[Optional[Mapping[str, Sequence[str]]], List[str]]:
        """Return subscribers by topic and topics that are published; None when that is not known any more."""
        if self._at_s is None or time.monotonic() - self._at_s > _FRESH_S:
            return None, []
        return self._seen


# --- CPU load ---------------------------------------------------------------------------------------------------------


_USER_TO_STEAL, _IDLE, _IO_WAIT = 8, 3, 4  # of the times in /proc/stat; a guest's stand in the user's, too


def processor_ticks() -> Tuple[int, int]:
    """Return the time since the boot, of all cores together, in which they worked and in all."""
    words = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()
    ticks = [int(each) for each in words[1 : 1 + _USER_TO_STEAL]]
    return sum(ticks) - ticks[_IDLE] - ticks[_IO_WAIT], sum(ticks)


class CpuLoad:
    """How busy this computer is: the part of the time of all cores in which they worked, over a second each.

    Args:
        ticks: returns the time in which they worked and in all, growing.
        second: of all cores together, in that unit.
    """

    def __init__(self, ticks: Callable[[], Tuple[int, int]] = processor_ticks, second: int = 0) -> None:
        self._ticks, self._second = ticks, second or os.sysconf("SC_CLK_TCK") * (os.cpu_count() or 1)
        self._before: Optional[Tuple[int, int]] = None
        self._fraction: Optional[float] = None

    def look(self) -> Optional[float]:
        """Return it, as often as one likes; None: unknown in the first second, or where nobody says."""
        try:
            worked, passed = self._ticks()
        except (OSError, ValueError, IndexError):
            return None
        before = self._before or (worked, passed)
        if passed - before[1] >= self._second:
            self._fraction = min(1.0, (worked - before[0]) / (passed - before[1]))
            before = worked, passed
        self._before = before
        return self._fraction
