"""Publishes and writes what was decided, each on a thread of its own.

Nothing in here can delay a decision, and a disk that holds up a write delays nothing that is published.
"""

from __future__ import annotations

import logging
import threading
import time
from math import nan
from queue import Empty, SimpleQueue
from typing import Any, Callable, Dict, Iterable, List, Optional, Set, Tuple

import diagnostic_updater
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import String

from amaze_autonomy import msg
from amaze_autonomy.engine.commands import AnswerKind, Command, Decision, Level, Notify, Value
from amaze_autonomy.engine.events import Event, RecordingStatus
from amaze_autonomy.engine.rules import Limits, Rules
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.interface import STATUSES, Status, status_of
from amaze_autonomy.ros.clock import Clock

from ...interface.fields import Shape
from ...journal import journal as codec
from ...journal.report import CommandAnswer, Fault, MessageLog, Report, Telemetry, computer_rows, report
from ...ros.interface import TAKEOFF_FRAME, check_row, classes, number, ros_time
from .journal_file import JournalFile
from .journal_topic import JournalLines, JournalTopic

_PERIOD_S = 0.5
_WRITTEN_WITHIN_S = 0.3
_LAST_LINES_S = 1.0  # for listeners of the journal that keep up
_NS = 1_000_000_000
_log = logging.getLogger(__name__)

_SAY = {
    Level.INFO: rospy.loginfo,
    Level.WARNING: rospy.logwarn,
    Level.ERROR: rospy.logerr,
    Level.ALARM: rospy.logfatal,
}


class Worker:
    """A thread that does jobs in their order, and something else twice a second. A job that fails is logged.

    Args:
        name: of the thread.
        periodic: done twice a second, and when it is stopped.
        last: done after that.
    """

    def __init__(self, name: str, periodic: Callable[[], None], last: Callable[[], None] = lambda: None) -> None:
        self._jobs: SimpleQueue[Optional[Callable[[], None]]] = SimpleQueue()
        self._periodic, self._last = periodic, last
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    @property
    def alive(self) -> bool:
        """False before it was started, and once its thread has ended, for whatever reason."""
        return self._thread.is_alive()

    @property
    def idle(self) -> bool:
        """Return whether no job waits."""
        return self._jobs.empty()

    def do(self, job: Callable[[], None]) -> None:
        """Do a job in its turn; from any thread."""
        self._jobs.put(job)

    def stop(self, limit_s: float) -> None:
        """Do what is left; on the thread that calls, where its own has ended."""
        self._jobs.put(None)
        if self.alive:
            self._thread.join(limit_s)
        else:
            self._run()

    def _run(self) -> None:
        due_s = time.monotonic()
        while True:
            try:
                job = self._jobs.get(timeout=max(0.0, due_s - time.monotonic()))
            except Empty:
                due_s = time.monotonic() + _PERIOD_S
                self._guarded(self._periodic)
                continue
            if job is None:
                break
            self._guarded(job)
        self._guarded(self._periodic)
        self._last()

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception:
            _log.exception("the %s failed", self._thread.name)


class Outbox:
    """What was decided, in order: published by one thread, written by another one, since a disk may hold up a write.

    Args:
        journal: on disk.
        timeline: the report for people.
        clock: for the stamps.
        publish_state: publishes ~state; called at each decision and twice a second.
        say: publishes ~messages; called with the time and the commands of each step that has any, before that.
        housekeeping: called twice a second, after `publish_state`.
        moved: called when the journal goes on at another place.
        ended: returns of an event, with the states before and after it, the state in which it ended a mission before it
            began the next in the queue; None: it did not.
    """

    def __init__(
        self,
        journal: JournalFile,
        timeline: Timeline,
        clock: Clock,
        publish_state: Callable[[EngineState], None],
        say: Callable[[int, Tuple[Command, ...]], None],
        housekeeping: Callable[[], None],
        moved: Callable[[], None] = lambda: None,
        ended: Callable[[EngineState, Event, EngineState], Optional[EngineState]] = lambda *_: None,
    ) -> None:
        self._ended = ended
        self._journal, self._timeline, self._clock = journal, timeline, clock
        self._publish_state, self._say, self._housekeeping, self._moved = publish_state, say, housekeeping, moved
        self._lines = JournalLines(lambda: journal.path, lambda: journal.written, journal.lines)
        self._topic = JournalTopic(self._lines, clock.ros_ns)
        self._encoder = codec.DeltaEncoder()
        self._said = ""
        self.state = EngineState()
        self._written = threading.Event()  # of the last step that has commands
        self._written.set()
        self._held = False
        self._publisher = Worker("outbox", self._publish)
        self._writer = Worker("journal", self._keep, self._close)

    @property
    def alive(self) -> bool:
        """False before it was started, and once one of its threads has ended, for whatever reason."""
        return self._publisher.alive and self._writer.alive

    def start(self, state: EngineState) -> None:
        """Begin to publish and to write."""
        self.state = state
        self._publisher.start()
        self._writer.start()

    def put(self, event: Event, state: EngineState, commands: Tuple[Command, ...]) -> None:
        """Take one step of the engine; from its thread."""
        before, written = self.state, threading.Event()
        self._writer.do(lambda: self._write(event, commands, written))
        if commands:
            self._written = written
            self._publisher.do(lambda: self._tell(before, event, state, commands, written))
        self.state = state

    def wait(self) -> None:
        """Wait until the last step is in the journal, unless the disk is held; from the engine's thread."""
        self._written.wait(0.0 if self._held else _WRITTEN_WITHIN_S)

    def log(self, job: Callable[[], None]) -> None:
        """Log something in its turn, which may have to wait for a disk; from any thread."""
        self._writer.do(job)

    def stop(self, limit_s: float = 5.0) -> None:
        """Publish and write what is left, then close the journal; on the thread that calls, where its own has ended."""
        until_s = time.monotonic() + limit_s
        self._publisher.stop(limit_s)
        self._writer.stop(max(0.0, until_s - time.monotonic()))

    # --- what is published

    def _wait(self, written: threading.Event) -> None:
        """Wait for the writer: what is shown is in the journal, so that a kill takes nothing that people have seen.

        A disk that does not keep up is waited for once; from then on nobody does, until it has caught up.
        """
        self._held = not written.wait(0.0 if self._held else _WRITTEN_WITHIN_S)

    def _tell(
        self,
        before: EngineState,
        event: Event,
        state: EngineState,
        commands: Tuple[Command, ...],
        written: threading.Event,
    ) -> None:
        ended = self._ended(before, event, state)
        self._wait(written)
        self._timeline.take(event.t_ns, commands)
        self._say(event.t_ns, commands)
        if ended is not None:
            self._publish_state(ended)
        self._publish_state(state)

    def _publish(self) -> None:
        state = self.state  # read before what is waited for, which belongs to it or to a later one
        self._wait(self._written)
        self._publish_state(state)
        self._housekeeping()

    # --- what is written

    def _write(self, event: Event, commands: Tuple[Command, ...], written: threading.Event) -> None:
        try:
            self._line(self._encoder.encode(event))
            for command in commands:
                if isinstance(command, Decision):
                    self._line(codec.encode_decision(command))
            if commands or self._writer.idle:  # a kill takes no more than what is under way
                self._journal.flush()
        finally:
            written.set()
        for command in commands:
            if isinstance(command, Notify):
                _SAY[command.level]("%s%s", command.text, f" {command.advice}" if command.advice else "")

    def _line(self, line: str) -> None:
        if self._journal.append(line) is None:
            self._encoder.forget()
        self._lines.add(line)

    def _keep(self) -> None:
        if self._journal.follow():
            rospy.logerr("%s", self._journal.remark)
            self._moved()
        self._journal.flush()
        self._journal.sync()
        self._say_problem()

    def _close(self) -> None:
        self._topic.close(_LAST_LINES_S)
        self._journal.finish()  # the result comes before anybody else may have it

    def _say_problem(self) -> None:
        """Warn once about each trouble with the disk, and when it is over."""
        problem = self._journal.problem
        if problem == self._said:
            return
        self._said = problem
        if problem:
            rospy.logerr("%s", self._journal.remarks[0])
        else:
            rospy.logwarn("The journal is written again%s.", ", with a gap" if self._journal.gap else ", without a gap")


# --- state publisher --------------------------------------------------------------------------------------------------
# Publishes ~state: the engine's report as a message, latched.


class StatePublisher:
    """Writes AutonomyState and the last messages, and the name of the state alone for who has no messages of ours.

    Args:
        rules: that the engine decides by.
        clock: for the time that is left.
        remarks: returns what the node itself has to say; it follows the advice.
        run: names the run of the engine whose messages are numbered.
        log: its messages so far.
        least_free: fraction of a storage below which no recording starts.
    """

    def __init__(
        self,
        rules: Rules,
        clock: Clock,
        remarks: Callable[[], Tuple[str, ...]],
        run: str,
        log: MessageLog,
        least_free: float,
    ) -> None:
        self._rules, self._clock, self._remarks, self._least_free = rules, clock, remarks, least_free
        self._recorder: Optional[RecordingStatus] = None
        self._run, self._log = run, log
        self._messages = rospy.Publisher("~messages", msg.OperatorMessages, latch=True, queue_size=10)
        self._publish_messages()
        self._publisher = rospy.Publisher("~state", msg.AutonomyState, latch=True, queue_size=10)
        self._names = rospy.Publisher("~state_name", String, latch=True, queue_size=10)
        self._named = ""

    def see(self, event: Event) -> None:
        """Note what the recorder says of the computers: it does also before there is a session."""
        if isinstance(event, RecordingStatus):
            self._recorder = event

    def publish(self, state: EngineState) -> None:
        """Publish the report about a state."""
        now_ns, said = self._clock.now_ns(), self._recorder
        silent = said is None or now_ns - said.t_ns > self._rules.limits.recorder_status_limit_ns
        rows = () if said is None or silent else computer_rows(said, self._least_free, self._rules.limits)
        message = state_message(report(state, self._rules, rows), now_ns, self._clock.ros_ns())
        message.advice = " ".join(each for each in (message.advice, *self._remarks()) if each)
        self._publisher.publish(message)
        if message.state != self._named:
            self._named = message.state
            self._names.publish(String(data=message.state))

    def say(self, t_ns: int, commands: Tuple[Command, ...]) -> None:
        """Publish the messages of a step of the engine, with those before them."""
        if self._log.take(t_ns, commands):
            self._publish_messages()

    def _publish_messages(self) -> None:
        now_ns, ros_ns = self._clock.now_ns(), self._clock.ros_ns()
        message = msg.OperatorMessages(run=self._run)
        message.header.stamp = ros_time(ros_ns)
        message.messages = [
            msg.OperatorMessage(
                number=each.number,
                stamp=ros_time(max(0, ros_ns - (now_ns - each.t_ns))),
                level=_MESSAGE_LEVELS[each.level],
                text=each.text,
                advice=each.advice,
                key=each.key,
            )
            for each in self._log.after(0)
        ]
        self._messages.publish(message)


#: Levels of DiagnosticStatus.
_MESSAGE_LEVELS = {Level.INFO: 0, Level.WARNING: 1, Level.ERROR: 2, Level.ALARM: 3}


_TELEMETRY = Shape(Telemetry, "Telemetry", without=("heard_ns",), known_by={"armed": "armed_known"})
_ANSWER = Shape(CommandAnswer, "UserAnswer", named={"text": "message"}, without=("command",))


def _pending(fault: Fault, now_ns: int) -> msg.PendingFailure:
    return msg.PendingFailure(
        name=fault.name,
        code=fault.code,
        action=fault.action.name.lower(),
        fallback="" if fault.fallback is None else fault.fallback.name.lower(),
        time_left=_left_s(fault.end_ns, now_ns),
        limit=fault.limit,
        cause=fault.cause,
        reason=fault.reason,
    )


def _telemetry(telemetry: Telemetry, now_ns: int) -> msg.Telemetry:
    heard_ns = telemetry.heard_ns
    age = nan if heard_ns is None else max(0.0, (now_ns - heard_ns) * 1e-9)
    return msg.Telemetry(age=age, **_TELEMETRY.write(telemetry, now_ns, classes))


def _answer(answer: CommandAnswer, now_ns: int) -> msg.UserAnswer:
    return msg.UserAnswer(command=answer.command.value, **_ANSWER.write(answer, now_ns, classes))


def _left_s(deadline_ns: Optional[int], now_ns: int) -> float:
    return nan if deadline_ns is None else max(0.0, (deadline_ns - now_ns) * 1e-9)


def state_message(report: Report, now_ns: int, ros_ns: int) -> msg.AutonomyState:
    """Write what a person is shown of the engine; `now_ns` is on the deciding clock."""
    message = msg.AutonomyState(
        state=report.state,
        step=report.step,
        session_id=report.session_id,
        mission_id=report.mission_id,
        mission_description=report.mission_description,
        file_index=report.file_index,
        files=report.files,
        repetition=report.repetition,
        repetitions=report.repetitions,
        in_flight=report.in_flight,
        checks=[check_row(row) for row in report.checks],
        failures=[_pending(fault, now_ns) for fault in report.faults],
        waiting_for=report.waiting_for,
        time_left=_left_s(report.deadline_ns, now_ns),
        limit=report.deadline.replace("_", " "),
        message=report.message,
        message_level=_MESSAGE_LEVELS[Level(report.message_level)],
        advice=report.advice,
        user_commands=[each.command.value for each in report.answers if each.answer is AnswerKind.DONE],
        waypoint=report.waypoint,
        waypoints=report.waypoints,
        recording_phase=report.recording_phase,
        recording_progress=number(report.recording_progress),
        data_location=report.data_location,
        result=report.result,
        data_result=report.data_result,
        answers=[_answer(each, now_ns) for each in report.answers],
        queue=list(report.queue),
        telemetry=_telemetry(report.telemetry, now_ns),
    )
    message.header.frame_id, message.header.stamp = TAKEOFF_FRAME, ros_time(ros_ns)
    return message


# --- diagnostics ------------------------------------------------------------------------------------------------------
# What the node says on /diagnostics, through diagnostic_updater.


_DIAGNOSTICS_PERIOD_S = 1.0
_OK, _WARN, _ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_CLOCKS_ADVICE = "set the clocks of all computers by chrony"
_LEVELS = {Level.INFO: _OK, Level.WARNING: _WARN, Level.ERROR: _ERROR, Level.ALARM: _ERROR}


class PeerClocks:
    """The row "clocks": how old the last status of each peer was on arrival, by its own stamp.

    Args:
        limits: what is believed: not older than one of them, not further in the future than another.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._ages_ns: Dict[str, Optional[int]] = dict.fromkeys(map(_peer, STATUSES))

    def see(self, event: Event) -> None:
        """Note the stamp of a status; other events have none."""
        age_ns = getattr(event, "age_ns", None)
        if age_ns is not None:
            self._ages_ns[_peer(status_of(event))] = age_ns

    def write(self, status: Any) -> Any:
        """Fill a DiagnosticStatus: a line for each peer, the peers that are not believed in its summary."""
        apart = [
            peer for peer, age_ns in self._ages_ns.items() if age_ns is not None and not self._limits.is_present(age_ns)
        ]
        if apart:
            text = f"stamps of {', '.join(sorted(apart))} are not of the present: {_CLOCKS_ADVICE}"
            status.summary(_ERROR, text)
        else:
            status.summary(_OK, "all stamps are of the present")
        for peer, age_ns in self._ages_ns.items():
            status.add(peer, self._words(age_ns))
        return status

    def _words(self, age_ns: Optional[int]) -> str:
        if age_ns is None:
            return "not heard"
        ahead = age_ns < 0
        limit_ns = self._limits.clock_tolerance_ns if ahead else self._limits.status_max_age_ns
        return f"{abs(age_ns) / _NS:.3f} s {'ahead' if ahead else 'old'} on arrival, limit {limit_ns / _NS:g} s"


def _peer(status: Status) -> str:
    return status.topic.split("/")[0]


class Diagnostics:
    """Four rows: the engine, its inputs, the clocks of its peers, the journal.

    Args:
        state: returns the engine's present state.
        journal: on disk.
        rejected: how many messages of each topic were invalid.
        left_out: how many entries of each list that was too long.
        open_calls: returns how many service calls wait for an answer.
        clocks: of the peers.
        foreign: returns a line for each publisher of another type on a topic of ours.
    """

    def __init__(
        self,
        state: Callable[[], EngineState],
        journal: JournalFile,
        rejected: Dict[str, int],
        left_out: Dict[str, int],
        open_calls: Callable[[], int],
        clocks: PeerClocks,
        foreign: Callable[[], Tuple[str, ...]],
    ) -> None:
        self._foreign, self._left_out = foreign, left_out
        self._state, self._journal, self._rejected, self._open_calls = state, journal, rejected, open_calls
        self._due_s = 0.0
        self._updater = diagnostic_updater.Updater()
        self._updater.setHardwareID("none")
        self._updater.add("engine", self._engine)
        self._updater.add("inputs", self._inputs)
        self._updater.add("clocks", clocks.write)
        self._updater.add("journal", self._disk)

    def publish(self) -> None:
        """Publish all rows, at most once a second."""
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._due_s = now_s + _DIAGNOSTICS_PERIOD_S
            self._updater.force_update()

    def _engine(self, status: Any) -> Any:
        state = self._state()
        status.summary(_LEVELS.get(Level(state.shown.level), _OK), f"{state.state.value}: {state.shown.text}")
        status.add("mission", state.session.mission.id if state.session.mission else "")
        status.add("session", state.session.id)
        status.add("in flight", str(state.flight.active))
        status.add("decisions", str(state.decisions))
        status.add("failures", ", ".join(failure.name for failure in state.failures))
        return status

    def _inputs(self, status: Any) -> Any:
        invalid = sum(self._rejected.values())
        if invalid:
            status.summary(_WARN, f"{invalid} invalid messages")
        else:
            status.summary(_OK, "all messages were valid")
        for number_of, line in enumerate(self._foreign(), start=1):
            status.mergeSummary(_WARN, "another type is published on a topic of ours")
            status.add(f"another type {number_of}", line)
        for topic, count in sorted(self._rejected.items()):
            status.add(f"invalid on {topic}", str(count))
        for row, count in sorted(self._left_out.items()):
            status.mergeSummary(_WARN, "entries of too long lists were left out")
            status.add(f"left out on {row}", str(count))
        status.add("calls that wait", str(self._open_calls()))
        return status

    def _disk(self, status: Any) -> Any:
        journal = self._journal
        level = _ERROR if journal.problem else _WARN if journal.remark else _OK
        status.summary(level, journal.problem or journal.remark or str(journal.path))
        status.add("lines", str(journal.lines))
        status.add("gap", str(journal.gap))
        return status


# --- timeline ---------------------------------------------------------------------------------------------------------
# The report of a run: one line per decision and message, readable by a person.


class Timeline:
    """Collects lines; times are seconds since the first."""

    def __init__(self) -> None:
        self._start_ns: Optional[int] = None
        self._noted: Set[str] = set()
        self.lines: List[str] = []

    def take(self, t_ns: int, commands: Iterable[Command]) -> None:
        """Add what one event has brought: decisions, and messages to the user."""
        for command in commands:
            if isinstance(command, Decision):
                self._decision(command)
            elif isinstance(command, Notify):
                self._message(t_ns, command)

    def _decision(self, decision: Decision) -> None:
        where = decision.after + (f"/{decision.step}" if decision.step else "")
        moved = where if decision.before == decision.after else f"{decision.before} -> {where}"
        values = "; ".join(_value(value) for value in decision.values)
        parts = [moved, f"rule {decision.rule} on {decision.event}"]
        if values:
            parts.append(values)
        if decision.commands:
            parts.append("=> " + ", ".join(decision.commands))
        self._add(decision.t_ns, " | ".join(parts))

    def _message(self, t_ns: int, notify: Notify) -> None:
        advice = f" {notify.advice}" if notify.advice else ""
        self._add(t_ns, f"{notify.level.name}: {notify.text}{advice}")

    def note_once(self, t_ns: int, texts: Tuple[str, ...]) -> None:
        """Add remarks of the node itself, each when it is first said."""
        for text in texts:
            if text not in self._noted:
                self._noted.add(text)
                self._add(t_ns, f"NODE: {text}")

    def _add(self, t_ns: int, text: str) -> None:
        if self._start_ns is None:
            self._start_ns = t_ns
        self.lines.append(f"{(t_ns - self._start_ns) / _NS:10.3f} s  {text}")

    def text(self) -> str:
        """Return the whole report."""
        return "".join(line + "\n" for line in self.lines)


def _value(value: Value) -> str:
    unit = f" {value.unit}" if value.unit else ""
    limit = "" if value.limit is None else f" (limit {value.limit}{unit})"
    return f"{value.name} {value.value}{unit}{limit}"
