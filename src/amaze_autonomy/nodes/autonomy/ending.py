"""When the node ends, and what has to be true before it may; and what becomes of it when a thread of it ends, or hangs.

Nothing is known that ends the thread that decides, has it hang, or ends the one that writes. Should it be so all the
same, a node that publishes on would look as if all were well. So the main thread watches them: it lands what flies, in
the place of that thread, and has the process start anew. The new one finds the journal that has no end, and goes on
with the flight, as after a kill. That is not roslaunch's affair: for it the engine is required, since neither a wrong
configuration nor a mission that was flown may begin again and again; and a limit of processes that has ended a thread
would keep it from starting one.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Callable, Dict, List, NamedTuple, Tuple

from amaze_autonomy.engine.commands import AutopilotLand, Command, MissionAction, MissionCommand
from amaze_autonomy.engine.events import Event, Outcome, Reply, Shutdown
from amaze_autonomy.engine.guards import lost_of
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import DataResult, EngineState, Result, State
from amaze_autonomy.ros.node_main import say_last_words

from ...journal.report import mission_end

#: The reason to end that nobody gives.
ENGINE_ENDED = "a failure of the engine's thread"

NOTHING_UNDER_WAY = (State.MISSION_INPUT, State.MISSION_ENDED)

_ROUTES = ("mission planner", "autopilot")
_LOOK_S = 0.2  # between two looks at the threads
_LOOKS = 25  # in a row without a turn of the thread that decides: it hangs
_SLICE_S = 0.05


class Pulse:
    """Whether the node's threads go on. A process that did not run for a while has looked once meanwhile: no hanging.

    Args:
        alive: tells whether they live.
        turns: how often the one that decides has waited so far; it does some ten times a second.
    """

    def __init__(self, alive: Callable[[], bool], turns: Callable[[], int]) -> None:
        self._alive, self._turns = alive, turns
        self._seen, self._looks = -1, 0

    @property
    def hangs(self) -> bool:
        """Whether the thread that decides has not waited for so many looks."""
        return self._looks >= _LOOKS

    def look(self) -> bool:
        """Look once more; return whether they go on."""
        turns = self._turns()
        self._looks = self._looks + 1 if turns == self._seen else 0
        self._seen = turns
        return self._alive() and not self.hangs


def first_reason(reasons: SimpleQueue[str], goes_on: Callable[[], bool]) -> str:
    """Wait for a reason to end.

    Args:
        reasons: that are given.
        goes_on: tells whether the node's threads do; asked five times a second.
    """
    while True:
        with suppress(Empty):
            return reasons.get(timeout=_LOOK_S)
        if not goes_on():
            return ENGINE_ENDED


def start_anew() -> None:
    """Become a new process of the same id, name and words; nothing else is left of this one. Returns when it cannot."""
    words = Path("/proc/self/cmdline").read_bytes().split(b"\0")[:-1]
    say_last_words()
    try:
        os.execv(sys.executable, words)  # noqa: S606 - as it was started
    except OSError as error:
        print(f"autonomy: it cannot start anew: {error.strerror}", file=sys.stderr, flush=True)


class Ended(NamedTuple):
    """How a mission ended, what became of its data, of which session that is, and what the recorder said of it."""

    result: Result
    data: DataResult = DataResult.NONE
    session: str = ""
    said: str = ""


def said_of_data(state: EngineState) -> str:
    """Return what the recorder says of a recording; what it does not say of what was lost, that too."""
    recorder = state.peers.recorder
    said, lost = recorder.message if recorder is not None else "", lost_of(state)
    return said if lost in said else "; ".join(filter(None, (said, lost)))


class Ending:
    """Watches the steps of the engine for the ends of missions, those before a restart too, and for that of the last.

    Args:
        end: called once with the reason, when the node shall end.
        rules: that the engine decides by.
        exit_when_ended: the end of the last mission ends the node.
    """

    def __init__(self, end: Callable[[str], None], rules: Rules, *, exit_when_ended: bool) -> None:
        self._exit, self._end, self._rules = exit_when_ended, end, rules
        self._before = EngineState()
        self.results: List[Ended] = []

    def count(self, event: Event, state: EngineState) -> None:
        """Note what a step ended; alone for a step before a restart, which ends no node any more."""
        before, self._before = self._before, state
        ended = mission_end(before, event, state, self._rules)
        if ended is not None:
            session = ended.session
            self.results.append(Ended(session.result, session.data_result, session.id, said_of_data(ended)))
        elif state.state is State.MISSION_INPUT and before.state not in NOTHING_UNDER_WAY:
            self.results.append(Ended(Result.NOT_FLOWN))

    def see(self, event: Event, state: EngineState) -> None:
        """Take notice of a step. The process before may have been killed between the last end and its own."""
        self.count(event, state)
        if self._exit and self.results and state.state in NOTHING_UNDER_WAY and not state.queue:
            self._exit = False
            self._end("mission ended")


class Farewell:
    """Follows the landing that the engine sends when the process is told to end."""

    def __init__(self) -> None:
        self._lock = threading.Condition()
        self._waits: Dict[int, str] = {}
        self._sent: Dict[str, str] = {}
        self._seen = self._landing = self._open = False

    def see(self, event: Event, commands: Tuple[Command, ...], state: EngineState) -> None:
        """Take notice of a step of the engine: the shutdown, the requests to land, and their replies.

        While the engine suspects that a pilot takes over, a shutdown stays open: he flies, or LAND goes out.
        """
        if not self._seen and not isinstance(event, Shutdown):
            return
        with self._lock:
            self._seen, self._open = True, bool(state.signal)
            for command in commands:
                route = _route(command)
                if route:
                    self._landing = True
                    self._waits[command.id] = route  # type: ignore[attr-defined]
                    self._sent.setdefault(route, "no answer")
            if isinstance(event, Reply) and event.command_id in self._waits:
                self._note(self._waits.pop(event.command_id), event)
            self._lock.notify_all()

    def _note(self, route: str, reply: Reply) -> None:
        if self._sent[route] != Outcome.ACCEPTED.value:
            self._sent[route] = reply.outcome.value

    def wait(self, limit_s: float, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Wait until the shutdown was decided on, and where it led to a landing, until both routes have accepted it.

        Args:
            limit_s: for so long.
            meanwhile: called again and again while it waits.
        """
        deadline_s = time.monotonic() + limit_s
        while True:
            meanwhile()
            with self._lock:
                left_s = deadline_s - time.monotonic()
                if self._over() or left_s <= 0.0:
                    return
                self._lock.wait(min(left_s, _SLICE_S))

    def _over(self) -> bool:
        if not self._seen or self._open:
            return False
        return not self._landing or all(self._sent.get(route) == Outcome.ACCEPTED.value for route in _ROUTES)

    def text(self) -> str:
        """Return what was sent and what was answered, for the exit text; empty when nothing was sent."""
        return ", ".join(f"{route}: {self._sent[route]}" for route in _ROUTES if route in self._sent)


def _route(command: Command) -> str:
    if isinstance(command, MissionCommand) and command.action in (MissionAction.LAND, MissionAction.ABORT):
        return _ROUTES[0]
    return _ROUTES[1] if isinstance(command, AutopilotLand) else ""
