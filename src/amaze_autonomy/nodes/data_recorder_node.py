"""The recorder node: records on one platform; on the collector it also makes one verified recording of all parts.

On every platform, PLATFORM being its name in recording.yaml:

    PLATFORM/data_recorder/start    StartRecording, PLATFORM/data_recorder/stop    StopRecording: answered at once
    PLATFORM/data_recorder/remove   StopRecording: removes its part, where the configuration permits it
    PLATFORM/data_recorder/clock    ExchangeClock
    PLATFORM/data_recorder/status   RecordingStatus of this platform, 2 Hz and at once on a change
    /diagnostics                    diagnostic_msgs/DiagnosticArray, 1 Hz

On the collector, for the engine:

    data_recorder/start, data_recorder/stop    StartRecording, StopRecording: answered at once
    data_recorder/status                       RecordingStatus of all platforms, 2 Hz and at once on a change
    autonomy/state                             AutonomyState: the end of a mission completes the copy of the journal

Parameters: `node_main.py`, and

    ~platform   its name; empty: the collector
    ~folder     folder of the recordings; empty: the one of recording.yaml
    ~transfer   rsync, shared or here: fetch the others' parts in this way; empty: as recording.yaml says
    ~journal    the engine's journal; empty: the one that the autonomy node names

A node that was killed goes on where it was: recorders that run are kept, jobs are started again. docs/recording.md.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Type

import rospy

from amaze_autonomy import msg, srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.recording import (
    Answer,
    Collector,
    Command,
    PlatformRecorder,
    Status,
)
from amaze_autonomy.recording import commands as asked
from amaze_autonomy.recording.folders import STATE, session_name, space_of
from amaze_autonomy.recording.sight import Sight
from amaze_autonomy.recording.space import needed_bytes, too_little
from amaze_autonomy.recording.status import WRITING

from . import recorder_messages
from .clock import Clock, MonotonicClock
from .errors import CallError
from .node_main import run_node
from .recorder_children import RecorderChildren, Subscriptions, recorder_program
from .recorder_collection import Collection
from .recorder_diagnostics import RecorderDiagnostics
from .recorder_jobs import RecorderJobs
from .recorder_links import PlatformLink
from .recorder_memory import RecorderMemory
from .recorder_settings import collector_setup, platform_name, platform_setup, recordings_folder, transfers
from .recorder_topics import MasterView, resolved
from .workers import Workers

__all__ = ["DataRecorderNode", "main"]

_TURN_S = 0.1
_STATUS_S = 0.5
_END_LIMIT_S = 10.0


class DataRecorderNode:
    """Both machines, and what carries their commands out. One thread works; requests only change the machines.

    Args:
        configuration: as loaded.
        clock: the node's, for stamps.
    """

    def __init__(self, configuration: Configuration, clock: Clock) -> None:
        self._configuration, self._stamp_ns = configuration, clock.ros_ns
        self._now_ns = MonotonicClock().now_ns  # processes and disks know no simulated time
        recording = configuration.recording
        self.name = platform_name(configuration)
        self.folder = recordings_folder(configuration)
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._ended = False
        groups = {group.name: group for group in recording.groups_of(self.name)}
        topics = {name: resolved(group.topics) for name, group in groups.items()}
        nodes = {name: rospy.resolve_name(f"record_{self.name}_{name}") for name in groups}
        self._groups = tuple(groups.values())
        self._children = RecorderChildren(groups, topics, nodes, recording.storage, recorder_program())
        self._platform = PlatformRecorder(platform_setup(configuration, self.name, topics))
        self._jobs, self._workers = RecorderJobs(), Workers("recorder")
        self._master = MasterView()
        self._collector: Optional[Collector] = None
        self._links: Dict[str, PlatformLink] = {}
        if self.name == recording.collector:
            self._collector = Collector(collector_setup(configuration))
        self._collection = Collection(configuration, self.folder, transfers(configuration))
        self._memory = RecorderMemory(self.folder / STATE.format(platform=self.name))
        self._said: List[Tuple[Any, ...]] = [(), ()]
        self._due_s = 0.0
        self._services: List[Any] = []
        self._diagnostics = RecorderDiagnostics(self.name)
        self._commands: Mapping[Type[Any], Callable[[Any], None]] = {
            asked.StartChild: self._start_child,
            asked.Signal: lambda it: self._children.signal(it.group, it.name),
            asked.Recover: self._recover,
            asked.Ask: self._ask,
            asked.MeasureClock: self._measure_clock,
            asked.Transfer: self._transfer,
            asked.Collect: self._collect,
            asked.CopyJournal: lambda _: self._copy_journal(),
        }

    # --- requests; on rospy's threads -----------------------------------------------------------------------------

    def _open(self) -> None:
        own = f"{self.name}/data_recorder"
        self._publisher = rospy.Publisher(f"{own}/status", msg.RecordingStatus, queue_size=10, tcp_nodelay=True)
        self._serve(f"{own}/start", srv.StartRecording, lambda it: self.start_here(it.session_id, it.mission_id))
        self._serve(f"{own}/stop", srv.StopRecording, lambda it: self.stop_here(it.session_id))
        self._serve(f"{own}/remove", srv.StopRecording, lambda it: self.remove_here(it.session_id))
        self._services.append(rospy.Service(f"{own}/clock", srv.ExchangeClock, self._exchange))
        if self._collector is None:
            return
        self._collector_publisher = rospy.Publisher(
            "data_recorder/status", msg.RecordingStatus, queue_size=10, tcp_nodelay=True
        )
        others = [each for each in self._collector.setup.platforms if each != self.name]
        self._links = {name: PlatformLink(name, self._heard, self._stamp_ns) for name in others}
        self._serve("data_recorder/start", srv.StartRecording, lambda it: self._start_all(it.session_id, it.mission_id))
        self._serve("data_recorder/stop", srv.StopRecording, lambda it: self._stop_all(it.session_id))
        rospy.Subscriber("autonomy/state", msg.AutonomyState, self._see_engine, queue_size=10)

    def _serve(self, name: str, service: Type[Any], answer: Callable[[Any], Answer]) -> None:
        def handle(request: Any) -> Any:
            given = answer(request)
            self._wake.set()
            return service._response_class(accepted=given.accepted, message=given.message)

        self._services.append(rospy.Service(name, service, handle))

    def _exchange(self, _request: Any) -> Any:
        received_ns = self._stamp_ns()
        return srv.ExchangeClockResponse(
            received=recorder_messages.ros_time(received_ns), answered=recorder_messages.ros_time(self._stamp_ns())
        )

    def start_here(self, session_id: str, mission_id: str) -> Answer:
        """Begin to record on this platform."""
        space = space_of(self.folder)
        needed = needed_bytes(self._configuration.recording.storage, self._groups, self._duration_s(mission_id))
        storage = self._configuration.recording.storage
        with self._lock:
            again = self._platform.session_id == session_id and self._platform.phase in WRITING
            problem = "" if again or space is None else too_little(storage, needed, space, str(self.folder))
            return self._platform.start(self._now_ns(), session_id, mission_id, problem)

    def _duration_s(self, mission_id: str) -> float:
        try:
            return self._configuration.plan(mission_id).mission.estimated_duration_s or 0.0
        except KeyError:
            return 0.0

    def stop_here(self, session_id: str) -> Answer:
        """End the recording on this platform."""
        with self._lock:
            return self._platform.stop(self._now_ns(), session_id)

    def remove_here(self, session_id: str) -> Answer:
        """Remove this platform's part; only the collector asks for it, when the complete recording is verified."""
        with self._lock:
            platform = self._platform
            if self._configuration.recording.keep_parts:
                return Answer(accepted=False, message="the configuration says keep_parts: true")
            if platform.session_id != session_id or platform.phase is not RecordingPhase.COMPLETE:
                return Answer(accepted=False, message=f"session {session_id!r} is not complete here")
            location = platform.location
        self._workers.submit(lambda: self._collection.remove(Path(location)))
        return Answer(accepted=True)

    def _start_all(self, session_id: str, mission_id: str) -> Answer:
        with self._lock:
            return self._collector.start(self._now_ns(), session_id, mission_id)

    def _stop_all(self, session_id: str) -> Answer:
        with self._lock:
            return self._collector.stop(self._now_ns(), session_id)

    def _heard(self, platform: str, status: Status) -> None:
        with self._lock:
            if self._collector is not None:
                self._collector.heard(self._now_ns(), platform, status)

    def _see_engine(self, message: Any) -> None:
        """Copy the journal again when the mission has ended: its last decisions came after the recording."""
        collector = self._collector
        if collector is not None and message.state == "MISSION_ENDED" and message.session_id == collector.session_id:
            self._workers.submit(lambda: self._collection.copy_journal(self._session_folder(), again=True))

    # --- what the machines ask for; on the working thread ---------------------------------------------------------

    def _session_folder(self) -> Path:
        machine = self._collector if self._collector is not None else self._platform
        return self.folder / session_name(machine.session_id, machine.mission_id)

    def _part_folder(self) -> Path:
        platform = self._platform
        return self.folder / session_name(platform.session_id, platform.mission_id) / self.name

    def _start_child(self, command: asked.StartChild) -> None:
        problem = self._children.start(command.group, command.number)
        if problem:
            rospy.logerr("the recorder of %s: %s", command.group, problem)

    def _recover(self, _command: asked.Recover) -> None:
        platform = self._platform
        facts = {
            "session_id": platform.session_id,
            "platform": self.name,
            "gaps": [gap for group in platform.groups.values() for gap in group.gaps],
            "dropped": platform.dropped,
        }
        session = platform.session_id

        def progress(line: Mapping[str, Any]) -> None:
            with self._lock:
                platform.recovery_progress(float(line["progress"]))

        def ended(result: Mapping[str, Any]) -> None:
            with self._lock:
                if platform.session_id == session:
                    killed = bool(result.get("killed"))
                    platform.recovery_ended(self._now_ns(), str(result["problem"]), killed=killed)
            self._wake.set()

        self._jobs.run({"do": "close", "folder": str(self._part_folder()), "facts": facts}, progress, ended)

    def _ask(self, command: asked.Ask) -> None:
        collector = self._collector
        if collector is None:
            return
        session, mission = collector.session_id, collector.mission_id
        if command.platform == self.name:
            own = {
                "start": lambda: self.start_here(session, mission),
                "stop": lambda: self.stop_here(session),
                "remove": lambda: self.remove_here(session),
            }
            collector.answered(self.name, command.verb, session, own[command.verb]())
            return
        self._workers.submit(lambda: self._ask_other(collector, command, session, mission))

    def _ask_other(self, collector: Collector, command: asked.Ask, session: str, mission: str) -> None:
        try:
            answer = self._links[command.platform].ask(command.verb, session, mission)
        except CallError as error:
            with self._lock:
                collector.unanswered(command.platform, str(error))
        else:
            with self._lock:
                collector.answered(command.platform, command.verb, session, answer)
            if command.verb == "remove" and answer.accepted:
                self._collection.remove(self.folder / session_name(session, mission) / command.platform)
        self._wake.set()

    def _measure_clock(self, command: asked.MeasureClock) -> None:
        collector = self._collector

        def measure() -> None:
            offset, problem = self._links[command.platform].offset()
            if offset is None:
                rospy.logwarn("the clock of %s could not be measured: %s", command.platform, problem)
            with self._lock:
                if collector is not None:
                    collector.clock_measured(command.platform, command.when, offset)

        self._workers.submit(measure)

    def _transfer(self, command: asked.Transfer) -> None:
        collector, folder = self._collector, self._session_folder() / command.platform
        if collector is None:
            return

        def progress(fraction: float) -> None:
            with self._lock:
                collector.transfer_progress(command.platform, fraction)

        def fetch() -> None:
            transfer = self._collection.transfers[command.platform]
            problem = self._jobs.fetch(transfer, command.location, folder, progress)
            if problem:
                rospy.logwarn("the part of %s: %s", command.platform, problem)
            with self._lock:
                collector.transfer_ended(self._now_ns(), command.platform, problem)
            self._wake.set()

        self._workers.submit(fetch)

    def _collect(self, _command: asked.Collect) -> None:
        collector = self._collector
        if collector is None:
            return
        request = self._collection.request(self._session_folder(), collector)

        def progress(line: Mapping[str, Any]) -> None:
            with self._lock:
                collector.job_progress(self._now_ns(), RecordingPhase[line["phase"]], float(line["progress"]))

        def ended(result: Mapping[str, Any]) -> None:
            with self._lock:
                killed = bool(result.get("killed"))
                collector.job_ended(self._now_ns(), str(result["problem"]), result, killed=killed)
            self._wake.set()

        self._jobs.run(request, progress, ended)

    def _copy_journal(self) -> None:
        folder = self._session_folder()
        self._workers.submit(lambda: self._collection.copy_journal(folder))

    # --- the work -------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Work until `end`."""
        self._remember()
        self._master.start()
        self._open()
        threading.Thread(target=self._tell_always, name="status", daemon=True).start()
        while not self._ended:
            self._wake.wait(_TURN_S)
            self._wake.clear()
            self._turn()
        self._close()

    def _turn(self) -> None:
        """See, decide, do, tell."""
        with self._lock:
            if self._platform.session_id:
                self._children.enter(self._part_folder())
        sight = self._children.look(Subscriptions(*self._master.seen()))
        self._decide(sight)
        self._keep()
        self._tell(force=False)

    def _decide(self, sight: Sight) -> None:
        with self._lock:
            now_ns = self._now_ns()
            commands: List[Command] = list(self._platform.step(now_ns, sight))
            if self._platform.session_id:
                self._children.enter(self._part_folder())
                self._platform.location = str(self._part_folder())
            if self._collector is not None:
                self._collector.heard(now_ns, self.name, self._platform.status(now_ns))
                commands += self._collector.step(now_ns)
        for command in commands:
            self._commands[type(command)](command)

    def _tell_always(self) -> None:
        """Tell the status also while the working thread waits for a slow storage."""
        while not self._ended:
            time.sleep(_STATUS_S)
            try:
                self._tell(force=True)
            except rospy.ROSException:
                return

    def _tell(self, *, force: bool) -> None:
        with self._lock:
            now_ns, stamp_ns = self._now_ns(), self._stamp_ns()
            own = self._platform.status(now_ns)
            whole = self._collector.status(now_ns) if self._collector is not None else None
        if force or self._news(0, own):
            self._publisher.publish(recorder_messages.recording_status(own, stamp_ns))
        if whole is not None and (force or self._news(1, whole)):
            self._collector_publisher.publish(recorder_messages.recording_status(whole, stamp_ns))
        self._diagnostics.publish(stamp_ns, whole if whole is not None else own)

    def _news(self, which: int, status: Status) -> bool:
        parts = tuple((each.platform, each.growing, each.message) for each in status.platforms)
        key = (status.session_id, status.phase, status.message, parts)
        if self._said[which] == key:
            return False
        if self._said[which] and self._said[which][1] is not status.phase:
            rospy.loginfo("%s: %s %s", "all" if which else self.name, status.phase.name, status.message)
        self._said[which] = key
        return True

    # --- memory ---------------------------------------------------------------------------------------------------

    def _keep(self) -> None:
        """Write down what the next process needs, when it has changed."""
        with self._lock:
            content = {
                "platform": self._platform.memory(),
                "processes": self._children.memory(),
                "collector": self._collector.memory() if self._collector is not None else None,
            }
        if self._platform.session_id:
            self._memory.keep(content)

    def _remember(self) -> None:
        """Go on where another process of this node ended."""
        content, same_boot = self._memory.read()
        if content is None:
            return
        try:
            platform, now_ns = PlatformRecorder(self._platform.setup), self._now_ns()
            platform.remember(now_ns, content["platform"], same_boot=same_boot)
            if self._collector is not None and content["collector"]:
                collector = Collector(self._collector.setup)
                collector.remember(now_ns, content["collector"])
                self._collector = collector
            self._children.remember(content["processes"] if same_boot else {})
            self._platform = platform
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            rospy.logerr("%s holds what cannot be (%r): it is put aside", self._memory.path, error)
            self._memory.put_aside()
            return
        rospy.loginfo("goes on with session %s (%s)", self._platform.session_id, self._platform.phase.name)

    # --- end ------------------------------------------------------------------------------------------------------

    def end(self) -> None:
        """End; from any thread and from signal handlers."""
        self._ended = True
        self._wake.set()

    def _close(self) -> None:
        """Close what is recorded: who ends this node ends the recording; who kills it does not."""
        with self._lock:
            collector, platform = self._collector, self._platform
            if platform.phase in WRITING:
                platform.stop(self._now_ns(), platform.session_id)
            if collector is not None:
                collector.interrupted(self._now_ns())
        self._turn()
        self._children.wait(self._children.running, _END_LIMIT_S)
        if collector is not None and collector.session_id:
            self._collection.copy_journal(self._session_folder(), again=True)
        self._jobs.stop()
        for link in self._links.values():
            link.close()


def main() -> int:
    """Run the node; return its exit status."""
    return run_node("data_recorder", DataRecorderNode)
