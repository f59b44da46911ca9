"""What a guard is, and the guards that go with any state: the user, timers, combinations.

A guard is a condition of the transition table: it returns what it looked at when it holds, else None. None has effects.
Most events ask for nothing. A guard that holds only on a request is marked `on_request`, one that is combined with it
is so too; the table leaves their rows out on all other events.
"""

from __future__ import annotations

from typing import Callable, Optional, Set

from .commands import Seen, Value, Values
from .events import UserCommand
from .state import OutreachKind, Result
from .timers import passed, time_of
from .turn import Turn

__all__ = [
    "Guard",
    "both",
    "holds_if",
    "mission_selected",
    "mission_waits",
    "needs_request",
    "negated",
    "next_in_queue",
    "on_request",
    "outreach_for",
    "shutdown",
    "timer",
    "user",
    "user_ends",
    "user_gives_up",
]

Guard = Callable[[Turn], Optional[Seen]]
_NS = 1e9
_ON_REQUEST: Set[Guard] = set()


def holds_if(condition: object, *values: Value, reason: str = "") -> Optional[Seen]:
    """Return what was looked at when the condition is true, else None."""
    return Seen(values, reason) if condition else None


def on_request(guard: Guard) -> Guard:
    """Mark a guard that holds only while `Turn.asked`."""
    _ON_REQUEST.add(guard)
    return guard


def needs_request(guard: Guard) -> bool:
    """Return True when a guard holds only while `Turn.asked`."""
    return guard in _ON_REQUEST


def user(command: UserCommand) -> Guard:
    """Hold when the user asks for it and the table of answers allows it."""
    return on_request(lambda turn: holds_if(turn.user is command, Value("user", command.value)))


@on_request
def user_gives_up(turn: Turn) -> Optional[Seen]:
    """The user gives up or aborts before takeoff."""
    asked = turn.user in (UserCommand.GIVE_UP, UserCommand.ABORT)
    return holds_if(asked, Value("user", turn.user.value if turn.user else ""))


@on_request
def user_ends(turn: Turn) -> Optional[Seen]:
    """The user lands, aborts or gives up between two files."""
    asked = turn.user in (UserCommand.GIVE_UP, UserCommand.ABORT, UserCommand.LAND)
    return holds_if(asked, Value("user", turn.user.value if turn.user else ""))


def timer(name: str) -> Guard:
    """Hold when a timer has ended."""

    def guard(turn: Turn) -> Optional[Seen]:
        if not passed(name, turn.state, turn.rules, turn.now):
            return None
        late = turn.now - (time_of(name, turn.state, turn.rules) or turn.now)
        return Seen((Value(name, "passed"), Value("later by", round(late / _NS, 6), 0.0, "s")))

    return guard


def both(*guards: Guard) -> Guard:
    """Hold when all of them hold."""

    def guard(turn: Turn) -> Optional[Seen]:
        values: Values = ()
        reasons = []
        for part in guards:
            seen = part(turn)
            if seen is None:
                return None
            values += seen.values
            reasons.append(seen.reason)
        return Seen(values, "; ".join(filter(None, reasons)))

    return on_request(guard) if any(needs_request(part) for part in guards) else guard


def negated(inner: Guard) -> Guard:
    """Hold when the other one does not."""
    return lambda turn: Seen() if inner(turn) is None else None


@on_request
def mission_selected(turn: Turn) -> Optional[Seen]:
    """The user has selected a valid mission."""
    return holds_if(turn.selected, Value("missions", ", ".join(mission.id for mission in turn.selected)))


def next_in_queue(turn: Turn) -> Optional[Seen]:
    """A further mission was selected, and the last one is complete."""
    return holds_if(
        turn.state.queue and turn.state.result is Result.COMPLETE and not turn.state.shutting_down,
        Value("missions to come", len(turn.state.queue)),
    )


def mission_waits(turn: Turn) -> Optional[Seen]:
    """A mission stands at the head of the queue."""
    return holds_if(turn.state.queue, Value("mission", turn.state.queue[0].id if turn.state.queue else ""))


@on_request
def shutdown(turn: Turn) -> Optional[Seen]:
    """The process was told to end."""
    return holds_if(turn.signal, Value("signal", turn.signal))


def outreach_for(kind: OutreachKind) -> Guard:
    """Hold when external action is required for this."""
    return lambda turn: holds_if(turn.state.outreach is kind)
