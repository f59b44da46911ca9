"""The collector's part of the node: the engine's requests, the other platforms, transfers, and the job that merges."""

from __future__ import annotations

import glob
import json
import shutil
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Type

import rosgraph
import rospy
from std_msgs.msg import String

from amaze_autonomy import msg, srv
from amaze_autonomy.config import Configuration
from amaze_autonomy.config.schemas.recording import Transfer
from amaze_autonomy.engine.events import RecordingPhase
from amaze_autonomy.files import whole
from amaze_autonomy.interface.fields import text
from amaze_autonomy.recording import Answer, Collector, Command, PlatformStatus, RecordingError, Status
from amaze_autonomy.recording import status as asked
from amaze_autonomy.recording.collector import Exchange, Offset, best, correction_ns
from amaze_autonomy.recording.programs import misplaced
from amaze_autonomy.recording.storage import PARTS, is_as_listed, read_json, remove_part, session_name, write_json

from ...ros.errors import CallError
from ...ros.interface import ros_time
from ...ros.service_client import ServiceClient
from ..autonomy.run_folder import registered
from .flight_pages import FlightPages
from .platform import RecorderPlatform
from .settings import RecorderShare, collector_setup, resolved, transfers, wanted_parts

# --- the way to the other platforms -----------------------------------------------------------------------------------


_LIMIT_S = 2.0
_EXCHANGES = 16
_PHASES = {int(phase.value): phase for phase in RecordingPhase}
_SERVICES: Mapping[str, Any] = {
    "start": srv.StartRecording,
    "stop": srv.StopRecording,
    "remove": srv.RemovePart,
    "clock": srv.ExchangeClock,
}


def read_status(message: Any) -> Optional[Status]:
    """Read a RecordingStatus; None when it holds what cannot be."""
    phase = _PHASES.get(message.phase)
    if phase is None:
        return None
    return Status(
        session_id=message.session_id,
        phase=phase,
        progress=_fraction(message.progress),
        remaining_s=message.remaining if message.remaining >= 0.0 else None,
        platforms=tuple([_platform(each) for each in message.platforms]),
        location=text(message.location),
        message=text(message.message),
        lost=text(message.lost),
    )


def _platform(message: Any) -> PlatformStatus:
    return PlatformStatus(
        platform=message.platform,
        growing=message.growing,
        written_bytes=message.bytes,
        byte_rate=message.byte_rate,
        free_fraction=_fraction(message.free_fraction),
        location=text(message.location),
        message=text(message.message),
        dropped=message.dropped,
        cpu_fraction=_fraction(message.cpu_fraction),
    )


def _fraction(value: float) -> Optional[float]:
    return value if 0.0 <= value <= 1.0 else None


class PlatformLink:
    """One other platform.

    Args:
        name: of the platform.
        heard: called with each of its statuses, on rospy's threads.
        wall_ns: the clock that stamps.
    """

    def __init__(self, name: str, heard: Callable[[str, Status], None], wall_ns: Callable[[], int]) -> None:
        self._name, self._heard, self._wall_ns = name, heard, wall_ns
        master, me = rosgraph.get_master_uri(), rospy.get_name()
        self._clients: Dict[str, ServiceClient] = {
            verb: ServiceClient(rospy.resolve_name(f"{name}/data_recorder/{verb}"), service, master, me)
            for verb, service in _SERVICES.items()
        }
        self._subscriber = rospy.Subscriber(
            f"{name}/data_recorder/status", msg.RecordingStatus, self._take, queue_size=10, tcp_nodelay=True
        )

    def _take(self, message: Any) -> None:
        status = read_status(message)
        if status is not None:
            age_s = round((self._wall_ns() - message.header.stamp.to_nsec()) * 1e-9, 2)  # without noise
            aged = tuple([replace(each, clock_age_s=age_s) for each in status.platforms])
            self._heard(self._name, replace(status, platforms=aged))

    def ask(self, verb: str, session_id: str, **more: Any) -> Answer:
        """Ask for something, waiting for the answer; `more` are further fields of the request.

        Raises:
            CallError: There was none within the limit.
        """
        client = self._clients[verb]
        request = _SERVICES[verb]._request_class(session_id=session_id, **more)
        response = client.call(client.serialize(request), time.monotonic() + _LIMIT_S)
        return Answer(bool(response.accepted), str(response.message))

    def offset(self) -> Tuple[Optional[Offset], str]:
        """Return the offset of its clock, or why it could not be measured."""
        client = self._clients["clock"]
        exchanges: List[Exchange] = []
        problem = ""
        for _ in range(_EXCHANGES):
            sent_ns = self._wall_ns()
            request = srv.ExchangeClockRequest(sent=ros_time(sent_ns))
            try:
                response = client.call(client.serialize(request), time.monotonic() + _LIMIT_S)
            except CallError as error:
                problem = str(error)
                break
            arrived_ns = self._wall_ns()
            exchanges.append(Exchange(sent_ns, response.received.to_nsec(), response.answered.to_nsec(), arrived_ns))
        return best(exchanges), problem

    def close(self) -> None:
        """Forget it."""
        self._subscriber.unregister()
        for client in self._clients.values():
            client.close()


# --- the collector ----------------------------------------------------------------------------------------------------


class RecorderCollector:
    """The collector's machine, and what carries its commands out.

    Args:
        share: of the node.
        own: the recorder of this platform.
    """

    def __init__(self, share: RecorderShare, own: RecorderPlatform) -> None:
        self._share, self._own = share, own
        self.machine = Collector(collector_setup(share.configuration))
        self._collection = Collection(share.configuration, transfers(share.configuration))
        self._links: Dict[str, PlatformLink] = {}
        self._ended = ""  # the session whose end was heard last
        self._pages = FlightPages(
            lambda words, there: (rospy.loginfo if there else rospy.logwarn)("flight page: %s", words)
        )
        self.commands: Mapping[Type[Any], Callable[[Any], None]] = {
            asked.Ask: self._ask,
            asked.MeasureClock: self._measure_clock,
            asked.Transfer: self._transfer,
            asked.StopTransfer: lambda it: share.jobs.stop_fetch(self._folder() / it.platform),
            asked.Collect: self._collect,
            asked.CopyJournal: self._copy_journal,
        }

    # --- requests; on rospy's threads -----------------------------------------------------------------------------

    def open(self) -> None:
        """Offer the services, listen to the others and to the engine."""
        others = [each for each in self.machine.setup.platforms if each != self._own.name]
        self._links = {name: PlatformLink(name, self._heard, self._share.stamp_ns) for name in others}
        serve = self._share.serve
        serve("data_recorder/start", srv.StartRecording, lambda it: self._start(it.session_id, it.mission_id))
        serve("data_recorder/stop", srv.StopRecording, lambda it: self._stop(it.session_id))
        rospy.Subscriber("autonomy/state", msg.AutonomyState, self._see_engine, queue_size=10)
        tolerated = self._share.configuration.recording.tolerated_topics
        self._wanted = rospy.Publisher("data_recorder/wanted", String, queue_size=1, latch=True)
        self._wanted.publish(json.dumps(wanted_parts(self._share.configuration, tolerated=tolerated)))

    def _start(self, session_id: str, mission_id: str) -> Answer:
        with self._share.lock:
            answer = self.machine.start(self._share.now_ns(), session_id, mission_id)
            if answer.accepted:
                self._pages.stop()
        return answer

    def _stop(self, session_id: str) -> Answer:
        with self._share.lock:
            return self.machine.stop(self._share.now_ns(), session_id, self._share.stamp_ns())

    def _heard(self, platform: str, status: Status) -> None:
        with self._share.lock:
            self.machine.heard(self._share.now_ns(), platform, status)

    def _see_engine(self, message: Any) -> None:
        """Note when it flies; at the end copy the journal, with its last decisions, and make the page.

        The next mission of a queue begins with the same event: its recording may have been asked for before the end of
        this one is heard.
        """
        session_id = message.session_id
        with self._share.lock:
            stamp_ns, came_ns = message.header.stamp.to_nsec(), self._share.stamp_ns()
            self.machine.heard_engine(stamp_ns, came_ns, session_id, in_flight=message.in_flight)
        if message.state == "MISSION_ENDED" and session_id not in ("", self._ended):
            self._ended = session_id
            folder = self._share.folder / session_name(session_id, message.mission_id)
            if folder.is_dir():
                self._share.workers.submit(lambda: self._finish(folder, session_id))

    def _finish(self, folder: Path, session_id: str) -> None:
        self._collection.copy_journal(folder, session_id, again=True)
        self._pages.add(folder)  # first: what begins together outlives the node together, which may end now
        with self._share.lock:
            if session_id == self.machine.session_id:
                self._pages.go_on()

    # --- the work; on the working thread --------------------------------------------------------------------------

    def step(self) -> List[Command]:
        """Hear the own platform, and decide; return what is to be done."""
        with self._share.lock:
            now_ns = self._share.now_ns()
            self.machine.heard(now_ns, self._own.name, self._own.status())
            return list(self.machine.step(now_ns))

    def status(self) -> Status:
        """Return the status of all; whoever asks holds the lock."""
        return self.machine.status(self._share.now_ns())

    def _folder(self) -> Path:
        return self._share.folder / session_name(self.machine.session_id, self.machine.mission_id)

    def _ask(self, command: asked.Ask) -> None:
        machine = self.machine
        session, mission = command.session_id or machine.session_id, machine.mission_id
        own = command.platform == self._own.name
        ask = self._ask_own if own else self._ask_other
        if own and command.verb != "remove":
            ask(machine, command, session, mission)
        else:  # these wait: for the other one, and before a removal until the whole recording is read
            self._share.workers.submit(lambda: ask(machine, command, session, mission))

    def _ask_own(self, machine: Collector, command: asked.Ask, session: str, mission: str) -> None:
        verbs: Dict[str, Callable[[], Answer]] = {
            "start": lambda: self._own.start(session, mission),
            "stop": lambda: self._own.stop(session),
            "remove": lambda: self._own.remove(session, self._verified(self._own.name)),
        }
        answer = verbs[command.verb]()
        with self._share.lock:
            machine.answered(self._own.name, command.verb, session, answer)

    def _ask_other(self, machine: Collector, command: asked.Ask, session: str, mission: str) -> None:
        share, more = self._share, {}  # type: RecorderShare, Dict[str, Any]
        if command.verb == "start":
            more = {"mission_id": mission}
        elif command.verb == "remove":
            verified = self._verified(command.platform)
            more = {"files": list(verified), "sha256": list(verified.values())}
        try:
            answer = self._links[command.platform].ask(command.verb, session, **more)
        except CallError as error:
            with share.lock:
                machine.unanswered(command.platform, str(error))
        else:
            with share.lock:
                machine.answered(command.platform, command.verb, session, answer)
            if command.verb == "remove" and answer.accepted:
                remove_part(share.folder / session_name(session, mission) / command.platform, share.folder, verified)
        share.wake.set()

    def _verified(self, platform: str) -> Dict[str, str]:
        """Return the files of a platform that are in the verified recording, with their checksums."""
        folder = self._folder()
        return self._collection.verified(folder, self._collection.source(folder, self.machine, platform))

    def _measure_clock(self, command: asked.MeasureClock) -> None:
        machine = self.machine

        def measure() -> None:
            offset, problem = self._links[command.platform].offset()
            if offset is None:
                rospy.logwarn("the clock of %s could not be measured: %s", command.platform, problem)
            with self._share.lock:
                machine.clock_measured(command.platform, command.when, offset)

        self._share.workers.submit(measure)

    def _transfer(self, command: asked.Transfer) -> None:
        machine, share, folder = self.machine, self._share, self._folder() / command.platform

        def progress(fraction: float) -> None:
            with share.lock:
                machine.transfer_progress(share.now_ns(), command.platform, command.number, fraction)

        def fetch() -> None:
            transfer = self._collection.transfers[command.platform]
            try:
                problem = share.jobs.fetch(transfer, command.location, folder, progress)
            except Exception as error:  # whatever it is: it has ended, and somebody waits for that
                problem = f"it could not be fetched ({type(error).__name__}: {error})"
            if problem:
                rospy.logwarn("the part of %s: %s", command.platform, problem)
            with share.lock:
                machine.transfer_ended(share.now_ns(), command.platform, command.number, problem)
            share.wake.set()

        share.workers.submit(fetch)

    def _collect(self, _command: asked.Collect) -> None:
        machine, share = self.machine, self._share

        def progress(line: Mapping[str, Any]) -> None:
            with share.lock:
                machine.job_progress(share.now_ns(), RecordingPhase[line["phase"]], float(line["progress"]))

        def ended(result: Mapping[str, Any]) -> None:
            with share.lock:
                killed = bool(result.get("killed"))
                machine.job_ended(share.now_ns(), str(result["problem"]), result, killed=killed)
            share.wake.set()

        share.jobs.run(self._collection.request(self._folder(), machine), progress, ended)

    def _copy_journal(self, _command: asked.CopyJournal) -> None:
        folder = self._folder()
        session_id = self.machine.session_id
        self._share.workers.submit(lambda: self._collection.copy_journal(folder, session_id))

    # --- memory and end -------------------------------------------------------------------------------------------

    def memory(self) -> Dict[str, Any]:
        """Return what the next process needs; whoever asks holds the lock."""
        return self.machine.memory()

    def remember(self, content: Mapping[str, Any]) -> None:
        """Go on where another process of this node ended; what is no memory raises, and changes nothing."""
        machine = Collector(self.machine.setup)
        machine.remember(self._share.now_ns(), content)
        self.machine = machine
        if machine.taken_out and machine.phase is not RecordingPhase.COMPLETE:
            names = " and ".join(machine.taken_out)
            words = "recording.yaml has no %s any more, which is of session %s: put it back, and start this node again"
            rospy.logwarn(f"{words}, else its part is a loss", names, machine.session_id)

    def forget(self) -> None:
        """Begin anew."""
        self.machine = Collector(self.machine.setup)

    def interrupt(self) -> None:
        """Take notice that the node ends."""
        self.machine.interrupted(self._share.now_ns(), self._share.stamp_ns())

    def close(self) -> None:
        """Copy what the engine wrote until now; forget the others."""
        if self.machine.session_id:
            self._collection.copy_journal(self._folder(), self.machine.session_id, again=True)
        for link in self._links.values():
            link.close()


# --- recorder collection ----------------------------------------------------------------------------------------------
# What the collector's node does to files: the journal and the configuration into the session.


_JOURNAL = "journal.jsonl"


class Collection:
    """Files of the collector.

    Args:
        configuration: as loaded.
        transfers: how each platform's part is fetched.
    """

    def __init__(self, configuration: Configuration, transfers: Mapping[str, Transfer]) -> None:
        self._configuration, self.transfers = configuration, transfers
        self._copying = threading.Lock()

    def request(self, folder: Path, collector: Collector) -> Dict[str, Any]:
        """Return what the job shall do that makes one recording of all parts."""
        sources = [self.source(folder, collector, name) for name, view in collector.views.items() if view.began]
        taken_out = collector.taken_out
        came = [name for name, view in taken_out.items() if view.fetched and (folder / name / PARTS).is_file()]
        sources += [self.source(folder, collector, name) for name in came]
        return {
            "do": "collect",
            "output": str(folder / f"{folder.name}.bag"),
            "sources": sources,
            "duplicates": self._configuration.recording.duplicates,
            "facts": {
                "session_id": collector.session_id,
                "mission_id": collector.mission_id,
                "stopped_ns": collector.stopped_ns,
                "flights": collector.flights,
                "set_back_ns": collector.set_back_ns,
                "tolerated_topics": resolved(self._configuration.recording.tolerated_topics),
                "absent": [name for name, view in collector.views.items() if not view.began],
                "taken_out": {name: view.part.location for name, view in taken_out.items() if name not in came},
                "configuration_hash": self._configuration.hash,
            },
        }

    def verified(self, folder: Path, source: Mapping[str, Any]) -> Dict[str, str]:
        """Return names and checksums of a source's files, as the manifests of verified recordings have them.

        Each of these recordings is read: where it is not there as it was verified, a part may be the last copy.
        """
        there, found = Path(source["folder"]).resolve(), {}  # type: Path, Dict[str, str]
        for path in sorted(folder.glob(f"{glob.escape(folder.name)}*.manifest.json")):
            manifest = read_json(path) or {}
            if not (manifest.get("verified") or {}).get("ok"):
                continue
            output = folder / str(manifest["output"]["file"])
            if not is_as_listed(output, manifest["output"]):
                rospy.logwarn("%s is not there as it was verified: the parts that it was made of stay", output)
                continue
            inputs = {(folder / each["file"]).resolve(): str(each["sha256"]) for each in manifest["inputs"]}
            found.update({each.name: sha256 for each, sha256 in inputs.items() if each.parent == there})
        return found

    def source(self, folder: Path, collector: Collector, name: str) -> Dict[str, Any]:
        """Return what the job is told of a platform's part."""
        view, own = collector.of_session[name], name == collector.setup.own
        here = name in self.transfers and self.transfers[name].by == "here"
        in_place = own or (here and not misplaced(view.part.location, folder / name))
        correction = correction_ns(list(view.offsets.values()))
        return {
            "platform": name,
            "folder": view.part.location if in_place else str(folder / name),
            "fetched": not in_place,
            "far": not own,
            "correction_ns": correction if self._configuration.recording.apply_clock_offset else 0,
            "begun": collector.begun,
            "clock": {when: offset.as_json() for when, offset in sorted(view.offsets.items())},
            "wanted": collector.wanted.get(name, {}),
        }

    def copy_journal(self, folder: Path, session_id: str, *, again: bool = False) -> None:
        """Copy the engine's journal, as far as it is written, and its configuration into a session.

        Which file that is no parameter says: others may set those, and would have any file copied.
        """
        try:
            with self._copying:
                journal = registered(session_id)
                if journal is not None:
                    _copy(journal, folder / _JOURNAL)
                if not again:
                    self._copy_configuration(folder / "configuration")
        except (OSError, RecordingError) as error:
            rospy.logwarn("the journal could not be copied into the session: %s", error)

    def _copy_configuration(self, target: Path) -> None:
        source = self._configuration.folder
        for path in [*sorted(source.glob("*.yaml")), *sorted((source / "trajectories").rglob("*"))]:
            if path.is_file():
                place = target / path.relative_to(source)
                place.parent.mkdir(parents=True, exist_ok=True)
                _copy(path, place)
        write_json(target / "effective.json", self._configuration.effective)


def _copy(source: Path, target: Path) -> None:
    """Copy a file so that the target is the old one or the new one."""
    with source.open("rb") as original, whole(target) as copy:
        shutil.copyfileobj(original, copy)
