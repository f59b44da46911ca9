"""Who answers where nobody is there to: what `unattended:=true` does in a user's place, state in, command out.

It does no more than a user could: only what the engine would do if it were asked now, and a pilot's landing is
acknowledged only once the flight is over for the engine as well, for nobody looks at the vehicle.
"""

from __future__ import annotations

from typing import Mapping, Optional

from amaze_autonomy.engine.answers import available
from amaze_autonomy.engine.events import Tick, UserCommand
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, State
from amaze_autonomy.engine.turn import Turn

__all__ = ["Unattended"]

_AGAIN_NS = 1_000_000_000  # a request that came too late for its state is made again

_ANSWERS: Mapping[State, UserCommand] = {
    State.OUTREACH: UserCommand.GIVE_UP,
    State.PILOT: UserCommand.ACKNOWLEDGE,
}


class Unattended:
    """Says what to ask of the engine, at every step of it.

    Args:
        rules: that the engine decides by.
    """

    def __init__(self, rules: Rules) -> None:
        self._rules = rules
        self._again_ns = 0

    def answer(self, state: EngineState) -> Optional[UserCommand]:
        """Return what is to be asked of the engine now; None: nothing."""
        command = _ANSWERS.get(state.state)
        if command is None or state.in_flight:
            self._again_ns = 0
            return None
        if state.t_ns < self._again_ns or command not in available(Turn(state, Tick(t_ns=state.t_ns), self._rules)):
            return None
        self._again_ns = state.t_ns + _AGAIN_NS
        return command
