"""Everything the engine can ask for and say: frozen, keyword-only. The shell carries it out and reports back by `id`.

Every request to a peer carries `limit_ns`: the shell answers within it, with `Outcome.TIMED_OUT` if need be. The engine
does not rely on that: its own deadlines are in its state. `MESSAGES` at the end has every sentence that a user is told.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any, Mapping, NamedTuple, Optional, Tuple

from .events import CheckName


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
        key: entry of `MESSAGES`.
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


# --- messages ---------------------------------------------------------------------------------------------------------
# Every message to the user: one row each. The operator's page in docs/ is generated from it.


@dataclass(frozen=True)
class Message:
    """One message: how loud, the sentence (fields in braces), and what the user can do."""

    level: Level
    text: str
    advice: str = ""


_I, _W, _E, _A = Level.INFO, Level.WARNING, Level.ERROR, Level.ALARM
_HOLDING = "Holding{limit}: {reason}"  # e.g. "Holding for up to 12 s, then landing: lrf fault, restarting it (3.1 Hz)."

MESSAGES: Mapping[str, Message] = {
    "mission_input": Message(_I, "Select a mission.", "Choose a mission from the list."),
    "mission_invalid": Message(
        _E, "Mission {mission_id} cannot be flown: {error}", "Choose another mission, or fix this one."
    ),
    "resumed": Message(_W, "The engine was restarted and continues in {state}."),
    "preflight": Message(_I, "Pre-flight checks of mission {mission_id} are running."),
    "preflight_fixing": Message(_W, "Not ready yet: {reason}", "Wait; the checks are repeated."),
    "ready": Message(_I, "Ready."),
    "ready_wait_go": Message(_I, "Ready. Waiting for the operator's go.", "Press G to take off, U to cancel."),
    "ready_old": Message(_W, "Ready has expired after {limit_s:.0f} s: repeating the checks."),
    "ready_revoked": Message(_W, "No longer ready: {reason}", "The checks are repeated."),
    "check_failed": Message(_W, "A check failed before takeoff: {reason}", "The checks are repeated."),
    "checks_failed": Message(
        _E, "Pre-flight checks failed: {reason}", "Follow the advice in the table, then retry, or give up."
    ),
    "no_takeoff": Message(
        _E, "No takeoff: all checks passed, but Ready expired or was revoked too often.", "Retry, or give up."
    ),
    "was_away": Message(
        _E, "No takeoff: the engine was away, and goes on with nothing by itself.", "Retry, or give up."
    ),
    "start_recording": Message(_I, "Recording is starting."),
    "recording_refused": Message(
        _E, "The recorder does not record: {reason}", "Check storage and recorder, then retry, or give up."
    ),
    "load_mission": Message(_I, "Mission {mission_id} is sent to the mission planner."),
    "planner_refused": Message(
        _E,
        "The mission planner did not accept the mission: {reason}",
        "Check planner and mission, then retry, or give up.",
    ),
    "takeoff": Message(_I, "Takeoff."),
    "takeoff_refused": Message(
        _E, "Takeoff was refused or did not happen: {reason}", "Check autopilot and planner, then retry, or give up."
    ),
    "takeoff_cancelled": Message(
        _W, "Takeoff is being cancelled: {reason}", "Keep clear until the vehicle is disarmed."
    ),
    "mission": Message(_I, "Takeoff altitude reached, starting the mission."),
    "touchdown": Message(_I, "Touched down: the next waypoint file is prepared."),
    "next_takeoff_failed": Message(
        _W, "No further takeoff: {reason}", "The data is collected; select the mission again to go on."
    ),
    "hold": Message(_W, _HOLDING, "Wait, or land."),
    "hold_not_kept": Message(_W, "The vehicle is not holding: {reason} Sending HOLD again.", "Wait, or land."),
    "user_hold": Message(_I, "Holding position as you asked.", "Resume, or land."),
    "resuming": Message(_I, "Resuming the mission."),
    "resumed_flight": Message(_I, "The mission goes on."),
    "land": Message(_E, "Landing: {reason}", "Watch the vehicle; be ready to take over."),
    "land_on_ground": Message(_E, "Landing: {reason}", "Keep clear."),
    "land_user": Message(_W, "Landing as {asked}.", "Watch the vehicle."),
    "land_shown": Message(_I, "Landing confirmed by the autopilot."),
    "takeover_suspected": Message(_W, "Possible takeover: {reason} No commands are sent."),
    "takeover_denied": Message(_W, "The engine has control again."),
    "landing_given_up": Message(
        _A,
        "Acknowledged: whether the vehicle has landed is not known. The recording is stopped and kept.",
        "Keep clear until the vehicle is found and switched off.",
    ),
    "clock_stands": Message(
        _E, "/clock has stood still for {stalled_s:.1f} s: no limit can be kept.", "Start what publishes /clock."
    ),
    "clock_runs": Message(_I, "/clock runs again."),
    "land_second_route": Message(_E, "No sign of landing: sending LAND to the autopilot."),
    "land_both_routes": Message(_E, "Sending LAND to the autopilot, too: {reason}"),
    "land_alarm": Message(_A, "PILOT: THE VEHICLE DOES NOT LAND. TAKE OVER.", "Take over by remote control."),
    "stays_armed": Message(_A, "PILOT: ON THE GROUND AND STILL ARMED. STOP THE MOTORS.", "Keep clear."),
    "land_limit": Message(_A, "PILOT: NOT LANDED AFTER {limit_s:.0f} s. TAKE OVER.", "Take over by remote control."),
    "autopilot_lost": Message(_A, "PILOT: TAKE OVER IF YOU CAN: {reason}", "Take over by remote control."),
    "disarm": Message(_W, "On the ground but still armed: disarming.", "Keep clear."),
    "pilot": Message(
        _W,
        "The pilot or the autopilot has control: {reason}",
        "Fly and land; acknowledge when on the ground and disarmed.",
    ),
    "landing_unconfirmed": Message(_W, "The landing detection does not confirm that it has landed: {reason}"),
    "data_cleanup": Message(_I, "On the ground: recording is stopped, data is collected."),
    "data_incomplete": Message(_E, "The data is not complete: {reason}", "Retry, or give up; nothing is deleted."),
    "mission_ended": Message(_I, "Mission ended: {result}. {location}", "{what_next}"),
    "mission_ended_incomplete": Message(
        _E,
        "Mission ended: {result}; its data is INCOMPLETE. {location}",
        "Nothing was deleted. {what_next}",
    ),
    "called_off": Message(_W, "No further takeoff: {by} says land."),
    "queue_dropped": Message(_W, "Remaining missions cancelled: {missions}", "Select them again."),
    "shutdown": Message(
        _E,
        "This process is being ended ({signal}) in flight: landing by planner and autopilot.",
        "Watch the vehicle; take over if it does not land.",
    ),
    "failure_continue": Message(_W, "Flying on: {reason}"),
    "failure_wait": Message(_W, _HOLDING),
    "failure_while_landing": Message(_W, "While landing: {reason} The landing goes on."),
    "failure_land": Message(_E, "Also failed: {reason}"),
    "failure_pilot": Message(_W, "While the pilot has control: {reason} No commands are sent."),
    "failure_back": Message(_I, "{name} {are} back."),
    "condition_cleared": Message(_I, "Cleared: {reason}"),
    "flown_without": Message(_W, "{name} did not come back in time: flying on."),
}
