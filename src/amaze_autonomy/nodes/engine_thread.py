"""The one thread that decides. Events come in on one queue; requests go out first, everything else after them."""

from __future__ import annotations

import logging
import threading
from queue import Empty, SimpleQueue
from typing import Callable, Optional, Tuple

from amaze_autonomy.engine.commands import Answer, AutopilotLand, Command, MissionAction, MissionCommand, Request
from amaze_autonomy.engine.events import Event, Tick, UserCommand, UserRequest
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, evolve

from .clock import Clock

__all__ = ["Decide", "EngineThread", "NextDeadline", "Record"]

Decide = Callable[[EngineState, Event, Rules], Tuple[EngineState, Tuple[Command, ...]]]
NextDeadline = Callable[[EngineState, Rules], Optional[int]]
Record = Callable[[Event, EngineState, Tuple[Command, ...]], None]

_log = logging.getLogger(__name__)
_LONGEST_SLEEP_S = 3600.0


class EngineThread:
    """Take events, decide, carry out.

    Args:
        decide: the engine.
        next_deadline: when to wake it with a `Tick`.
        rules: what it decides by.
        clock: the clock that decides.
        send: sends a request to a peer; must not wait.
        answer: hands an answer to the user who waits for it; must not wait.
        record: takes (event, state after it, commands) to write and publish; must not wait.
        state: to start from.
    """

    def __init__(
        self,
        decide: Decide,
        next_deadline: NextDeadline,
        rules: Rules,
        clock: Clock,
        send: Callable[[Request], None],
        answer: Callable[[Answer], None],
        record: Record,
        state: Optional[EngineState] = None,
    ) -> None:
        self._decide, self._next_deadline, self._rules, self._clock = decide, next_deadline, rules, clock
        self._send, self._answer, self._record = send, answer, record
        self._queue: SimpleQueue[Optional[Event]] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self._failed = False
        self.state = state if state is not None else EngineState()

    def put(self, event: Event) -> None:
        """Take an event; from any thread."""
        self._queue.put(event)

    def start(self) -> None:
        """Begin to decide."""
        self._thread.start()

    def stop(self, limit_s: float = 2.0) -> None:
        """Decide what is in the queue, then end."""
        self._queue.put(None)
        self._thread.join(limit_s)

    def _run(self) -> None:
        while True:
            try:
                event = self._queue.get(timeout=self._sleep_s())
            except Empty:
                event = self._tick()
                if event is None:
                    continue
            else:
                if event is None:
                    return
            self._step(event)

    def _sleep_s(self) -> float:
        deadline_ns = self._next_deadline(self.state, self._rules)
        return _LONGEST_SLEEP_S if deadline_ns is None else min(_LONGEST_SLEEP_S, self._clock.wall_wait_s(deadline_ns))

    def _tick(self) -> Optional[Tick]:
        """Return a Tick when the deadline has really come; a sleep may be cut short."""
        deadline_ns = self._next_deadline(self.state, self._rules)
        now_ns = self._clock.now_ns()
        return Tick(t_ns=now_ns) if deadline_ns is not None and now_ns >= deadline_ns else None

    def _step(self, event: Event) -> None:
        if event.t_ns < self.state.t_ns:  # two threads stamped and queued in different orders
            event = evolve(event, t_ns=self.state.t_ns)
        try:
            state, commands = self._decide(self.state, event, self._rules)
        except Exception:
            self._decision_failed(event)
            return
        self.state = state
        for command in commands:
            if isinstance(command, Request):
                self._send(command)
        for command in commands:
            if isinstance(command, Answer):
                self._answer(command)
        self._record(event, state, commands)

    def _decision_failed(self, event: Event) -> None:
        """Survive a defect of the engine: what it cannot decide about, it lands for."""
        _log.exception("the engine could not decide about %s", event)
        if not self.state.in_flight:
            return
        if not self._failed:
            self._failed = True
            self.put(UserRequest(t_ns=self.state.t_ns, command=UserCommand.LAND))
            return
        limit_ns = self._rules.limits.command_reply_limit_ns
        self._send(MissionCommand(id=0, limit_ns=limit_ns, session_id=self.state.session_id, action=MissionAction.LAND))
        self._send(AutopilotLand(id=0, limit_ns=limit_ns))
