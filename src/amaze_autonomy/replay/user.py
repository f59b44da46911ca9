"""The scripted user of a replay: selects the mission, gives the go, retries, gives up, acknowledges."""

from __future__ import annotations

from typing import Optional, Tuple

from amaze_autonomy.engine.events import UserCommand
from amaze_autonomy.engine.state import EngineState, OutreachKind, State

from .topic_map import Script

__all__ = ["User"]

_THINKS_NS = 1_000_000_000


class User:
    """Answers what the engine asks a person for, each time it asks.

    Args:
        script: how often and after how long.
    """

    def __init__(self, script: Script) -> None:
        self._script = script
        self._retries = script.retries
        self._asked: Tuple[State, int] = (State.MISSION_INPUT, -1)

    def react(self, state: EngineState, *, require_go: bool) -> Optional[Tuple[int, UserCommand]]:
        """Return what the user will ask and when; None: nothing new."""
        asked = (state.state, state.entered_ns)
        if asked == self._asked:
            return None
        self._asked = asked
        if state.state is State.OUTREACH:
            return self._outreach(state)
        if state.state is State.PILOT:
            return state.t_ns + self._script.retry_after_ns, UserCommand.ACKNOWLEDGE
        if state.state is State.READY and require_go:
            return state.t_ns + _THINKS_NS, UserCommand.GO
        return None

    def again(self, state: EngineState, command: UserCommand) -> Optional[int]:
        """Return when the user asks the same again, because it was refused; None: never."""
        waits = command is UserCommand.ACKNOWLEDGE and state.state is State.PILOT
        return state.t_ns + self._script.retry_after_ns if waits else None

    def _outreach(self, state: EngineState) -> Tuple[int, UserCommand]:
        if state.outreach is OutreachKind.PREFLIGHT and self._retries > 0:
            self._retries -= 1
            return state.t_ns + self._script.retry_after_ns, UserCommand.RETRY
        return state.t_ns + self._script.retry_after_ns, UserCommand.GIVE_UP
