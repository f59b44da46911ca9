"""The one thread that decides. It reads what comes itself; requests go out first, everything else after them."""

from __future__ import annotations

import logging
import threading
import time
from typing import Callable, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Answer, AutopilotLand, Command, MissionAction, MissionCommand, Request
from amaze_autonomy.engine.events import Event, Tick, UserCommand, UserRequest
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, evolve

from .clock import Clock
from .inbox import Inbox

__all__ = ["Decide", "EngineThread", "NextDeadline", "Record"]

Decide = Callable[[EngineState, Event, Rules], Tuple[EngineState, Tuple[Command, ...]]]
NextDeadline = Callable[[EngineState, Rules], Optional[int]]
Record = Callable[[Event, EngineState, Tuple[Command, ...]], None]

_log = logging.getLogger(__name__)
_LONGEST_SLEEP_S = 3600.0
_AFTER_DEFECT_S = 0.01


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
    ) -> None:
        self._decide, self._next_deadline, self._rules, self._clock = decide, next_deadline, rules, clock
        self._send, self._answer, self._record = send, answer, record
        self._inbox = inbox
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self._stopping = threading.Event()
        self._failed = False
        self.state = state if state is not None else EngineState()

    def start(self) -> None:
        """Begin to decide."""
        self._thread.start()

    def stop(self, limit_s: float = 2.0) -> None:
        """Decide about what has come, then end."""
        self._stopping.set()
        self._inbox.wake()
        self._thread.join(limit_s)

    def _run(self) -> None:
        """Decide about all that has come before believing that a deadline has passed without it."""
        stopping = False
        while not stopping:
            stopping = self._stopping.is_set()
            for event in self._read(0.0 if stopping else self._sleep_s()):
                self._step(event)
            if not stopping:
                self._tick()

    def _read(self, limit_s: float) -> Sequence[Event]:
        """Wait for what comes; survive a defect of the reading, which ends as silence."""
        try:
            return self._inbox.wait(limit_s)
        except Exception:
            _log.exception("the engine could not read what has come")
            time.sleep(_AFTER_DEFECT_S)
            return ()

    def _sleep_s(self) -> float:
        deadline_ns = self._next_deadline(self.state, self._rules)
        return _LONGEST_SLEEP_S if deadline_ns is None else self._clock.wall_wait_s(deadline_ns)

    def _tick(self) -> None:
        """Say that time has passed, when a deadline has really come; a wait may be cut short."""
        deadline_ns = self._next_deadline(self.state, self._rules)
        if deadline_ns is not None:
            now_ns = self._clock.now_ns()
            if now_ns >= deadline_ns:
                self._step(Tick(t_ns=now_ns))

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
            self._inbox.put(UserRequest(t_ns=self.state.t_ns, command=UserCommand.LAND))
            return
        limit_ns = self._rules.limits.command_reply_limit_ns
        self._send(MissionCommand(id=0, limit_ns=limit_ns, session_id=self.state.session_id, action=MissionAction.LAND))
        self._send(AutopilotLand(id=0, limit_ns=limit_ns))
