"""Is anything known on the ground that would end a flight as soon as it began? Then there is no takeoff."""

from __future__ import annotations

from typing import Optional

from .commands import Seen, Value, because
from .conditions import FAILSAFE_CONDITIONS
from .data_guards import recording_proven
from .failures import severity_of
from .severity import SEVERITIES, Verb, verb_of
from .state import evolve
from .turn import Turn

__all__ = ["unfit"]


def unfit(turn: Turn) -> Optional[Seen]:
    """Something is known that would end the flight as soon as it began, or forbids to begin it."""
    if turn.state.shutting_down:
        return because("reason", "the process was told to end")
    if not turn.down():
        return because("reason", "the vehicle does not say, freshly, that it is disarmed and on the ground")
    if recording_proven(turn) is None:
        return because("reason", "the recorder is silent, does not record, or not for long enough yet")
    if turn.state.heartbeat_ns is None:
        return because("reason", "the watchdog was started and has never beaten")
    if turn.state.battery_ns is None:
        return because("reason", "the battery level was never known")
    return _component(turn) or _loss(turn)


def _component(turn: Turn) -> Optional[Seen]:
    """Return the first component, required or not, that would be landed for, at once or after a wait."""
    for status in turn.state.components:
        severity = severity_of(status.name, status.code, turn.state, turn.rules)
        verb = verb_of(severity, status.code)
        if verb is Verb.LAND or (verb is Verb.WAIT and SEVERITIES[severity].then is not Verb.CONTINUE):
            return because("reason", f"{status.name} {status.reason}".strip(), Value("code", int(status.code)))
    return None


def _loss(turn: Turn) -> Optional[Seen]:
    """Return the first failsafe condition that would be landed for, as if the flight had just begun."""
    flight = Turn(evolve(turn.state, in_flight=True, flight_started_ns=turn.now), turn.event, turn.rules)
    flight.now = turn.now
    for row in FAILSAFE_CONDITIONS:
        seen = row.holds(flight) if row.action is Verb.LAND else None
        if seen is not None:
            return Seen((Value("reason", row.words), *seen.values), seen.reason or row.words)
    return None
