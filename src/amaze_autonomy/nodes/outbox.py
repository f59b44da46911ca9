"""Writes and publishes what was decided, on a thread of its own: nothing in here can delay a decision."""

from __future__ import annotations

import logging
import threading
import time
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, Callable, Optional, Tuple

import rospy

from amaze_autonomy import msg
from amaze_autonomy.engine import journal as codec
from amaze_autonomy.engine.commands import Command, Decision, Level, Notify
from amaze_autonomy.engine.events import Event
from amaze_autonomy.engine.state import EngineState

from .clock import Clock
from .interface import ros_time
from .journal_file import JournalFile
from .timeline import Timeline

__all__ = ["Outbox"]

_MOST_WAITING = 200000  # lines for a listener that does not keep up: more than an hour

_STATE_PERIOD_S = 0.5
_log = logging.getLogger(__name__)

_SAY = {
    Level.INFO: rospy.loginfo,
    Level.WARNING: rospy.logwarn,
    Level.ERROR: rospy.logerr,
    Level.ALARM: rospy.logfatal,
}


def _kind(line: str) -> str:
    """Return the kind of a line of the journal; a canonical line has it between its keys."""
    return next((kind for kind in ("decision", "header") if f'"kind":"{kind}"' in line), "event")


class _Newcomers(rospy.SubscribeListener):
    """Tells of each new listener."""

    def __init__(self, welcome: Callable[[Callable[[msg.JournalEntry], None]], None]) -> None:
        super().__init__()
        self._welcome = welcome

    def peer_subscribe(self, _topic: str, _publish: Any, peer_publish: Callable[[msg.JournalEntry], None]) -> None:
        self._welcome(peer_publish)


class Outbox:
    """One queue of what was decided, in order.

    Args:
        journal: on disk.
        timeline: the report for people.
        clock: for the stamps.
        publish_state: publishes ~state; called at each decision and twice a second.
        housekeeping: called twice a second, after `publish_state`.
    """

    def __init__(
        self,
        journal: JournalFile,
        timeline: Timeline,
        clock: Clock,
        publish_state: Callable[[EngineState], None],
        housekeeping: Callable[[], None],
    ) -> None:
        self._journal, self._timeline, self._clock = journal, timeline, clock
        self._publish_state, self._housekeeping = publish_state, housekeeping
        self._queue: SimpleQueue[Optional[Callable[[], None]]] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="outbox", daemon=True)
        self._lock = threading.Lock()  # of the journal and its publisher
        self._entries = rospy.Publisher(
            "~journal", msg.JournalEntry, _Newcomers(self._catch_up), queue_size=_MOST_WAITING
        )
        self._said = ""
        self.state = EngineState()

    def put(self, event: Event, state: EngineState, commands: Tuple[Command, ...]) -> None:
        """Take one step of the engine; from its thread."""
        self._queue.put(lambda: self._take(event, state, commands))

    def do(self, job: Callable[[], None]) -> None:
        """Do something that may wait, in its turn; from any thread."""
        self._queue.put(job)

    def start(self, state: EngineState) -> None:
        """Begin to write."""
        self.state = state
        self._thread.start()

    def stop(self, limit_s: float = 5.0) -> None:
        """Write what is left, then close the journal."""
        self._queue.put(None)
        self._thread.join(limit_s)

    def _run(self) -> None:
        due_s = time.monotonic()
        while True:
            try:
                job = self._queue.get(timeout=max(0.0, due_s - time.monotonic()))
            except Empty:
                due_s = time.monotonic() + _STATE_PERIOD_S
                self._guarded(self._periodic)
                continue
            if job is None:
                break
            self._guarded(job)
        self._guarded(self._periodic)
        with self._lock:
            self._journal.close()

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception:
            _log.exception("the outbox failed")

    def _periodic(self) -> None:
        with self._lock:
            self._journal.flush()
            self._journal.sync()
        self._say_problem()
        self._publish_state(self.state)
        self._housekeeping()

    def _take(self, event: Event, state: EngineState, commands: Tuple[Command, ...]) -> None:
        self.state = state
        with self._lock:
            self._line("event", codec.encode_event(event))
            for command in commands:
                if isinstance(command, Decision):
                    self._timeline.decision(command)
                    self._line("decision", codec.encode_decision(command))
                elif isinstance(command, Notify):
                    self._timeline.message(event.t_ns, command)
            if commands:
                self._journal.flush()
        if commands:
            self._publish_state(state)
        for command in commands:
            if isinstance(command, Notify):
                _SAY[command.level]("%s%s", command.text, f" {command.advice}" if command.advice else "")

    def _line(self, kind: str, line: str) -> None:
        number = self._journal.append(line)
        if self._entries.get_num_connections():
            with suppress(rospy.ROSException):  # the topic closes before the journal does
                self._entries.publish(self._entry(number, kind, line))

    def _entry(self, number: int, kind: str, line: str) -> msg.JournalEntry:
        entry = msg.JournalEntry(sequence=number, kind=kind, line=line)
        entry.header.stamp = ros_time(self._clock.ros_ns())
        return entry

    def _catch_up(self, publish: Callable[[msg.JournalEntry], None]) -> None:
        """Send a new listener the journal from its first line: a recording that starts later has all of it."""
        with self._lock:
            self._journal.flush()
            text = self._journal.path.read_text(encoding="ascii")
            for number, line in enumerate(text.splitlines()):
                publish(self._entry(number, _kind(line), line))

    def _say_problem(self) -> None:
        """Warn once about each trouble with the disk, and when it is over."""
        problem = self._journal.problem
        if problem == self._said:
            return
        self._said = problem
        if problem:
            rospy.logerr("The journal cannot be written: %s. The engine goes on; make room on the disk.", problem)
        else:
            rospy.logwarn("The journal is written again%s.", ", with a gap" if self._journal.gap else ", without a gap")
