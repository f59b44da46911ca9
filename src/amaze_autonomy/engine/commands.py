"""Everything the engine can ask for: frozen, keyword-only. The shell carries it out and reports back by `id`.

Every request to a peer carries `limit_ns`: the shell answers within it, with `Outcome.TIMED_OUT` if need be. The engine
does not rely on that: its own deadlines are in its state.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any, NamedTuple, Optional, Tuple

from .checks import CheckName

__all__ = [
    "Answer",
    "AnswerKind",
    "AutopilotDisarm",
    "AutopilotLand",
    "Command",
    "Decision",
    "Level",
    "LoadMission",
    "MissionAction",
    "MissionCommand",
    "Notify",
    "Request",
    "RunCheck",
    "Seen",
    "StartRecording",
    "StopRecording",
    "Value",
    "Values",
    "because",
]


class MissionAction(enum.Enum):
    """What the mission planner can be told; the values are those of srv/MissionCommand.srv."""

    TAKEOFF = 1
    HOLD = 2
    RESUME = 3
    LAND = 4
    ABORT = 5


class Level(enum.IntEnum):
    """How loud a message to the user is."""

    INFO = 1
    WARNING = 2
    ERROR = 3
    ALARM = 4  # to the pilot: take over


class AnswerKind(enum.Enum):
    """Answer to a user's request; the values are those of srv/UserCommand.srv."""

    DONE = 1
    REFUSED = 2
    ALREADY = 3


class Command:
    """Base of all commands."""

    def __new__(cls, *args: Any, **_: Any) -> Command:  # noqa: PYI034 - typing.Self is newer than 3.8
        """Refuse positional arguments (Python 3.8 has no keyword-only dataclasses)."""
        if args:
            raise TypeError(f"{cls.__name__} takes keyword arguments only")
        return super().__new__(cls)


@dataclass(frozen=True)
class Request(Command):
    """A command to a peer that answers with a `Reply` (or `CheckReply`) of the same id, within `limit_ns`."""

    id: int
    limit_ns: int


@dataclass(frozen=True)
class RunCheck(Request):
    """Ask a peer for one of the pre-flight checks.

    Args:
        check: which one.
        mission_id: for the watchdog.
        required: components that the mission needs, for the watchdog; empty: all.
        startup_time_ns: how long the watchdog's first answer may take.
        required_fraction: of the battery, for the battery check; None: unknown.
    """

    check: CheckName
    mission_id: str = ""
    required: Tuple[str, ...] = ()
    startup_time_ns: int = 0
    required_fraction: Optional[float] = None


@dataclass(frozen=True)
class LoadMission(Request):
    """Ask the planner to build and send one waypoint file of a mission."""

    session_id: str
    mission_id: str
    file_index: int
    repetition: int


@dataclass(frozen=True)
class MissionCommand(Request):
    """Tell the planner to take off, hold, resume, land or abort."""

    session_id: str
    action: MissionAction


@dataclass(frozen=True)
class StartRecording(Request):
    """Ask the recorder to start."""

    session_id: str
    mission_id: str


@dataclass(frozen=True)
class StopRecording(Request):
    """Ask the recorder to stop and to go on to the merged recording; after FAILED: to go on where it stopped."""

    session_id: str


@dataclass(frozen=True)
class AutopilotLand(Request):
    """Second route of a landing: the autopilot itself."""


@dataclass(frozen=True)
class AutopilotDisarm(Request):
    """Disarm, on the ground only."""


@dataclass(frozen=True)
class Notify(Command):
    """Tell the user.

    Args:
        level: how loud.
        key: entry of the table of messages (`engine/messages.py`).
        text: the sentence, filled in.
        advice: what the user can do.
    """

    level: Level
    key: str
    text: str
    advice: str = ""


@dataclass(frozen=True)
class Answer(Command):
    """The answer to a user's request."""

    request_id: int
    answer: AnswerKind
    message: str = ""


@dataclass(frozen=True)
class Value:
    """Something a decision looked at: a value, the limit it was compared with, and the unit of both."""

    name: str
    value: object
    limit: object = None
    unit: str = ""


Values = Tuple[Value, ...]


class Seen(NamedTuple):
    """What a condition looked at when it holds, and, where there is one, the reason in words that a person is told."""

    values: Values = ()
    reason: str = ""


def because(name: str, reason: str, *values: Value) -> Seen:
    """Return a reason under the name that it has in the journal, and what else was looked at."""
    return Seen((Value(name, reason), *values), reason)


@dataclass(frozen=True)
class Decision(Command):
    """Write this down: one decision, with what led to it. It comes after the commands that it names.

    Args:
        t_ns: time of the event.
        sequence: number of the decision, from 0.
        event: class name of the event that triggered it.
        before: state before, e.g. "MISSION".
        after: state after.
        step: step within the state after, e.g. "FLYING".
        rule: name of the rule that fired (a row of `engine/transitions.py`).
        values: what the rule looked at, with limits.
        commands: the commands, as short texts, e.g. "MissionCommand(LAND)#12".
    """

    t_ns: int
    sequence: int
    event: str
    before: str
    after: str
    step: str
    rule: str
    values: Tuple[Value, ...] = ()
    commands: Tuple[str, ...] = ()
