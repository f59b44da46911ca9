"""How a run ended, as a number for scripts."""

from __future__ import annotations

from typing import Mapping, Sequence

from amaze_autonomy.engine.state import EngineState, Result, State

__all__ = ["EXIT_STATUS", "START_ERROR", "exit_status", "outcome"]

START_ERROR = 2

#: What the process exits with, by the name of the worst that happened; docs/integrator.md shows this table.
EXIT_STATUS: Mapping[str, int] = {
    "COMPLETE": 0,  # every mission was flown and its data is complete; or nothing was started
    "LANDED_EARLY": 3,
    "PILOT": 4,
    "NOT_FLOWN": 5,
    "DATA_INCOMPLETE": 6,
    "INTERRUPTED": 7,  # the node was ended while a mission was under way, on the ground
    "INTERRUPTED_IN_FLIGHT": 8,  # ... and in flight: LAND was sent
}

_NOTHING_UNDER_WAY = (State.MISSION_INPUT, State.MISSION_ENDED)


def outcome(results: Sequence[Result], state: EngineState) -> str:
    """Return the worst of how the missions ended and where the engine was when the node ended."""
    names = [result.value for result in results if result is not Result.NONE] or ["COMPLETE"]
    if state.in_flight:
        names.append("INTERRUPTED_IN_FLIGHT")
    elif state.state not in _NOTHING_UNDER_WAY:
        names.append("INTERRUPTED")
    return max(names, key=EXIT_STATUS.__getitem__)


def exit_status(results: Sequence[Result], state: EngineState) -> int:
    """Return the exit status of the node."""
    return EXIT_STATUS[outcome(results, state)]
