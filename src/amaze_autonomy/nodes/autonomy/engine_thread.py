"""All that reaches the engine: statuses, which the thread that decides reads itself, and events of other threads.

The thread that decides waits for its connections itself. So nothing stands between the wire and a decision, and before
it believes that time has passed without a message, it has read every message that had come: a process that was stopped
for a second finds the statuses of that second in its sockets, and decides about them in the order in which they came.

A message that lay in a socket while this process did not run is stamped with when it arrived, as far as its own stamp
tells: what its publisher's stamps usually are older by is taken off, and it came neither before the last look nor later
than now. Statuses are levels, so after a long time only some of each publisher are decided about, the last among them.
"""

from __future__ import annotations

import logging
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from queue import Empty, SimpleQueue
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Set, Tuple, Union

from amaze_autonomy.engine.commands import Answer, AutopilotLand, Command, MissionAction, MissionCommand, Request
from amaze_autonomy.engine.events import (
    ClockStatus,
    Event,
    InvalidEventError,
    MissionRejected,
    MissionSelected,
    Outcome,
    Tick,
    UserCommand,
    UserRequest,
    WatchdogAction,
)
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, State, evolve
from amaze_autonomy.interface import InvalidMessageError, Status
from amaze_autonomy.ros.clock import Clock, boot_ns

from ...engine.rules import Code
from ...ros.errors import report
from ...ros.interface import age_of, message_class, read_status
from ...ros.topic_reader import Look, TopicReader
from .requests import failure

_S = 1_000_000_000
_LOOK_AGAIN_S = 0.1  # it looks at least so often, or it was stopped
_LATE_NS = 50_000_000
_REST_LIMIT_S, _REST_PAUSE_S = 0.05, 0.002
_NEVER_NS = -1
_MOST = 20  # statuses of one publisher that are decided about at once
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Stall:
    """A time for which the process did not run.

    Args:
        duration_s: how long.
        read: how many statuses lay in the sockets.
        left_out: how many of them were passed over for later ones.
    """

    duration_s: float
    read: int
    left_out: int


class _Publisher:
    """One connection.

    Args:
        topic: what it publishes.
        header: of the connection.
    """

    def __init__(self, topic: Status, header: Mapping[str, str]) -> None:
        self.topic, self._header = topic, header
        self._usual_ns: Optional[int] = None  # how old its messages are when they are read in time

    def event(self, data: bytes, now_ns: int, ros_ns: int, looked_ns: Optional[int]) -> Tuple[Event, Mapping[str, int]]:
        """Return what a message says, and how many entries of too long lists are not in that.

        Args:
            data: the message.
            now_ns: on the clock that decides.
            ros_ns: the same, in ROS time.
            looked_ns: when the sockets were last empty; None when they were looked at in time.

        Raises:
            Exception: whatever genpy raises for what is no message, and `read_status` for what cannot be.
        """
        message = message_class(self.topic)().deserialize(data)
        message._connection_header = self._header
        age_ns = age_of(message.header, ros_ns)
        if looked_ns is None:
            self._usual_ns, lay_ns = age_ns, 0
        else:
            lay_ns = min(max(age_ns - (self._usual_ns or 0), 0), max(now_ns - looked_ns, 0))
        event = read_status(self.topic, message, now_ns - lay_ns, ros_ns - lay_ns)
        return event, self.topic.left_out(message)


class Inbox:
    """What the engine's thread waits for; everything but `put` belongs to that thread.

    Args:
        clock: that decides.
        reject: gets the topic's name and the error of a message that is none; must not wait.
        stalled: gets each time for which the process did not run; must not wait.
        wall_ns: the clock by which it notices that it did not run, or that its computer slept.
        shortened: gets topic, list and how many of its entries were left out, where it is too long; must not wait.
    """

    def __init__(
        self,
        clock: Clock,
        reject: Callable[[str, Exception], None] = lambda _topic, _error: None,
        stalled: Callable[[Stall], None] = lambda _stall: None,
        wall_ns: Callable[[], int] = boot_ns,
        shortened: Callable[[str, str, int], None] = lambda *_: None,
    ) -> None:
        self._shortened = shortened
        self.reader = TopicReader(slice_s=0.0)
        self._clock, self._reject, self._stalled, self._wall_ns = clock, reject, stalled, wall_ns
        self._events: SimpleQueue[Event] = SimpleQueue()
        self._came: List[Tuple[_Publisher, bytes]] = []
        self._looked_wall_ns, self._looked_ns = _NEVER_NS, clock.now_ns()
        self._clock_stands = False

    def put(self, event: Event) -> None:
        """Take an event; from any thread."""
        self._events.put(event)
        self.reader.wake()

    def wake(self) -> None:
        """Have `wait` return; from any thread."""
        self.reader.wake()

    def look_for(self, topic: Status) -> Callable[[Mapping[str, str]], Look]:
        """Return what makes the look at the messages of each publisher of a topic."""

        def look_at(header: Mapping[str, str]) -> Look:
            publisher, came = _Publisher(topic, header), self._came
            return lambda data: came.append((publisher, bytes(data)))

        return look_at

    def wait(self, limit_s: float) -> Sequence[Event]:
        """Wait for what comes, at most for a time; return all of it in the order in which it came."""
        self.reader.wait(min(limit_s, _LOOK_AGAIN_S))
        now_ns, ros_ns = self._clock.now_ns(), self._clock.ros_ns()
        wall_ns = self._wall_ns()  # the last: it shows each stop before it
        away_ns = wall_ns - self._looked_wall_ns if self._looked_wall_ns != _NEVER_NS else 0
        late = away_ns > _LOOK_AGAIN_S * _S + _LATE_NS
        if late:
            self._read_the_rest()
            now_ns, ros_ns = self._clock.now_ns(), self._clock.ros_ns()
        events = self._put_events()
        statuses, left_out = self._statuses(now_ns, ros_ns, self._looked_ns if late else None)
        events += statuses
        stalled_s = self._clock.stalled_s()
        if (stalled_s > 0.0) != self._clock_stands:
            self._clock_stands = stalled_s > 0.0
            events.append(ClockStatus(t_ns=now_ns, stalled_s=stalled_s))
        if late:
            events.sort(key=attrgetter("t_ns"))
            if away_ns >= _S:  # before anything goes on
                events.insert(0, Tick(t_ns=self._looked_ns, away_ns=away_ns))
            self._stalled(Stall(away_ns / _S, len(statuses) + left_out, left_out))
            wall_ns = self._wall_ns()
        self._looked_wall_ns, self._looked_ns = wall_ns, now_ns
        return events

    def _read_the_rest(self) -> None:
        """Read until nothing more comes: what its publishers could not send meanwhile follows what they could."""
        until_s, count = time.monotonic() + _REST_LIMIT_S, -1
        self._clock.catch_up()
        while count != len(self._came) and time.monotonic() < until_s:
            count = len(self._came)
            self.reader.wait(_REST_PAUSE_S)

    def _put_events(self) -> List[Event]:
        events: List[Event] = []
        while True:
            try:
                events.append(self._events.get_nowait())
            except Empty:
                return events

    def _statuses(self, now_ns: int, ros_ns: int, looked_ns: Optional[int]) -> Tuple[List[Event], int]:
        """Return the statuses that have come, and how many were left out."""
        came, self._came[:] = self._came[:], []
        if not came:
            return [], 0
        events: List[Tuple[_Publisher, Event]] = []
        for publisher, data in came:
            try:
                event, left_out = publisher.event(data, now_ns, ros_ns, looked_ns)
                events.append((publisher, event))
                for name, count in left_out.items():
                    self._shortened(publisher.topic.topic, name, count)
            except (InvalidMessageError, InvalidEventError) as error:
                self._reject(publisher.topic.topic, error)
            except MemoryError:
                report(_log, "there is no memory to read a message of %s", publisher.topic.topic)
            except Exception as error:  # genpy raises whatever struct, codecs and its own code raise
                text = InvalidMessageError(
                    "message", f"{len(data)} bytes", f"a {message_class(publisher.topic)._type} ({error})"
                )
                self._reject(publisher.topic.topic, text)
        kept = _thinned(events) if len(events) > _MOST else [event for _, event in events]
        return kept, len(events) - len(kept)


def _thinned(events: Sequence[Tuple[_Publisher, Event]]) -> List[Event]:
    """Return at most so many statuses of each publisher: evenly spread, the last one, and all that say code 16."""
    left: Dict[_Publisher, int] = {}
    for publisher, _ in events:
        left[publisher] = left.get(publisher, 0) + 1
    step = {publisher: -(-count // _MOST) for publisher, count in left.items()}
    kept: List[Event] = []
    for publisher, event in events:
        left[publisher] -= 1
        if left[publisher] % step[publisher] == 0 or _urgent(event):
            kept.append(event)
    return kept


def _urgent(event: Event) -> bool:
    return isinstance(event, WatchdogAction) and event.code is Code.ABORT


# --- engine thread ----------------------------------------------------------------------------------------------------
# The one thread that decides. It reads what comes itself; requests go out first, everything else after them; a takeoff,
# a hold and a resume alone are written down before they go out. Nothing that fails ends the thread: each part of a
# decision is tried, whatever becomes of the others. Should it end all the same, its node sees that (`ending.py`).


Decide = Callable[[EngineState, Event, Rules], Tuple[EngineState, Tuple[Command, ...]]]
NextDeadline = Callable[[EngineState, Rules], Optional[int]]
Record = Callable[[Event, EngineState, Tuple[Command, ...]], None]
UserEvent = Union[UserRequest, MissionSelected, MissionRejected]
"""What a user asks, who may wait for the answer."""
TakeUp = Callable[[UserEvent], bool]

_LONGEST_SLEEP_S = 3600.0
_AFTER_DEFECT_S = 0.01
_MOST_SAID = 100  # failures that are remembered as said
_KEPT = frozenset({MissionAction.TAKEOFF, MissionAction.HOLD, MissionAction.RESUME})


def _are_kept(commands: Sequence[Command]) -> bool:
    """Return whether they change the flight mode, and none of them lands: a landing waits for nothing."""
    actions = {command.action for command in commands if isinstance(command, MissionCommand)}
    return bool(actions & _KEPT) and MissionAction.LAND not in actions


class EngineThread:
    """Take events, decide, carry out.

    Args:
        decide: the engine.
        next_deadline: when to wake it with a `Tick`.
        rules: what it decides by.
        clock: the clock that decides.
        inbox: where events come from.
        send: sends a request to a peer; must not wait.
        answer: hands an answer to the user who waits for it; must not wait.
        record: takes (event, state after it, commands) to write and publish; must not wait.
        state: to start from.
        keep: waits, not for long, until what was recorded is written; called before what changes the
            flight mode goes out, a landing never.
        take_up: tells whether what a user asks is still to be decided about, just before it is; must not wait. What is
            not is not recorded either: a replay decides about the same.

    `turns` counts how often it has waited for what comes.
    """

    def __init__(
        self,
        decide: Decide,
        next_deadline: NextDeadline,
        rules: Rules,
        clock: Clock,
        inbox: Inbox,
        send: Callable[[Request], None],
        answer: Callable[[Answer], None],
        record: Record,
        state: Optional[EngineState] = None,
        keep: Callable[[], None] = lambda: None,
        take_up: TakeUp = lambda _: True,
    ) -> None:
        self._keep, self._take_up = keep, take_up
        self._decide, self._next_deadline, self._rules, self._clock = decide, next_deadline, rules, clock
        self._send, self._answer, self._record = send, answer, record
        self._inbox = inbox
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self._stopping, self._replaced = threading.Event(), False
        self.turns = 0
        self._failed = False
        self._said: Set[Tuple[object, ...]] = set()
        self._land_again_ns = 0
        self.state = state if state is not None else EngineState()

    @property
    def alive(self) -> bool:
        """False before it was started, and once it has ended, for whatever reason."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Begin to decide."""
        self._thread.start()

    def stop(self, limit_s: float = 2.0) -> None:
        """Decide about what has come, then end."""
        self._stopping.set()
        self._inbox.wake()
        if self.alive and not self._replaced:
            self._thread.join(limit_s)
        self.stand_in()

    def replace(self) -> None:
        """Have who stands in decide from now on, for its own thread hangs; should that go on, it ends."""
        self._replaced = True
        self._stopping.set()

    def stand_in(self) -> None:
        """Decide about what has come on the thread that calls, where its own has ended, or was replaced."""
        if self._replaced or not self.alive:
            self._turn(0.0)

    def _run(self) -> None:
        """Decide about all that has come before believing that a deadline has passed without it."""
        while not self._stopping.is_set():
            self._turn(self._sleep_s())
            self._tick()
        if not self._replaced:
            self._turn(0.0)

    def _turn(self, limit_s: float) -> None:
        self.turns += 1
        for event in self._read(limit_s):
            if self._is_wanted(event):
                self._step(event)

    def _read(self, limit_s: float) -> Sequence[Event]:
        """Wait for what comes; survive a defect of the reading, which ends as silence."""
        try:
            return self._inbox.wait(limit_s)
        except Exception:
            report(_log, "the engine could not read what has come")
            time.sleep(_AFTER_DEFECT_S)
            return ()

    def _is_wanted(self, event: Event) -> bool:
        """Tell whether an event is to be decided about; where that cannot be told, it is."""
        try:
            return not isinstance(event, (UserRequest, MissionSelected, MissionRejected)) or self._take_up(event)
        except Exception as error:
            self._say_once("take up", event, error)
            return True

    def _sleep_s(self) -> float:
        """Return the time until something is due; 0: it is."""
        try:
            deadline_ns = self._next_deadline(self.state, self._rules)
            return _LONGEST_SLEEP_S if deadline_ns is None else self._clock.wall_wait_s(deadline_ns)
        except Exception as error:
            self._decision_failed("what is due next", error)
            return _LONGEST_SLEEP_S

    def _tick(self) -> None:
        """Say that time has passed, when a deadline has really come; a wait may be cut short.

        What came until then is decided about before: the process may have been stopped since it read.
        """
        if self._sleep_s() > 0.0:
            return
        now_ns = self._clock.now_ns()
        self._turn(0.0)
        if self._sleep_s() <= 0.0:
            self._step(Tick(t_ns=now_ns))

    def _step(self, event: Event) -> None:
        try:
            if event.t_ns < self.state.t_ns:  # two threads stamped and queued in different orders
                event = evolve(event, t_ns=self.state.t_ns)
            state, commands = self._decide(self.state, event, self._rules)
        except Exception as error:
            self._decision_failed(event, error)
            return
        if self._replaced and threading.current_thread() is self._thread:
            return
        self.state = state
        kept = _are_kept(commands)
        if kept:  # killed behind it, and started again, it must know that the mode that answers it is its own
            self._try("record", self._record, event, state, commands)
            self._try("keep", self._keep)
        for command in commands:
            if isinstance(command, Request):
                self._ask(command)
        for command in commands:
            if isinstance(command, Answer):
                self._try("answer", self._answer, command)
        if not kept:
            self._try("record", self._record, event, state, commands)

    def _ask(self, request: Request) -> None:
        """Send a request; one that cannot be sent comes back as one that failed."""
        error = self._try("send", self._send, request)
        if error is not None:
            self._try("take back", self._take_back, request, error)

    def _take_back(self, request: Request, error: Exception) -> None:
        message = f"{type(error).__name__}: {error}"
        self._inbox.put(failure(request, Outcome.BROKEN, message, self._clock.now_ns()))

    def _try(self, what: str, act: Callable[..., None], *values: Any) -> Optional[Exception]:
        """Do one part of a decision; when it fails, say so, and let the others be tried."""
        try:
            act(*values)
        except Exception as error:
            self._say_once(what, values[0] if values else "", error)
            return error
        return None

    def _say_once(self, what: str, about: object, error: Exception) -> None:
        """Log what failed, with its reason; the same for the same reason is logged once."""
        with suppress(MemoryError):  # then more often
            key = (what, type(about), type(error), str(error))
            if key in self._said:
                return
            if len(self._said) >= _MOST_SAID:
                self._said.clear()
            self._said.add(key)
        report(_log, f"the engine could not {what} %s", about)

    def _decision_failed(self, about: object, error: Exception) -> None:
        """Survive a defect of the engine: what it cannot decide about, it lands for, unless somebody has control."""
        self._say_once("decide about", about, error)
        state = self.state
        if not state.flight.active or state.state is State.PILOT or state.vehicle.takeover is not None:
            return
        if not self._failed:
            self._failed = True
            if self._try("take", self._inbox.put, UserRequest(t_ns=state.t_ns, command=UserCommand.LAND)) is None:
                return
        self._land_undecided()

    def _land_undecided(self) -> None:
        """Ask for the landing by both routes, as often as the engine would."""
        limits, now_ns = self._rules.limits, time.monotonic_ns()
        if now_ns < self._land_again_ns:
            return
        self._land_again_ns = now_ns + limits.land_repeat_period_ns
        limit_ns, session_id = limits.command_reply_limit_ns, self.state.session.id
        planner = MissionCommand(id=0, limit_ns=limit_ns, session_id=session_id, action=MissionAction.LAND)
        for request in (planner, AutopilotLand(id=0, limit_ns=limit_ns)):
            self._try("send", self._send, request)
