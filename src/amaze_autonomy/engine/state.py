"""The state of the engine: one frozen value that holds all it knows. `decide` makes the next one from it.

Raw facts (the last status of each peer) are kept as they came, with the time of their arrival; what they mean is
computed from them at each event. So nothing in here can contradict the facts for longer than one event.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any, Optional, Tuple, TypeVar

from .checks import Check, CheckName
from .commands import Level, MissionAction
from .events import (
    AutopilotStatus,
    ComponentStatus,
    LandedStatus,
    MissionStatus,
    Outcome,
    RecordingStatus,
    WatchdogAction,
)
from .mission import Mission
from .severity import Verb

__all__ = [
    "Agreement",
    "CheckRecord",
    "ClockApart",
    "EngineState",
    "Failure",
    "FailureKind",
    "OutreachKind",
    "Result",
    "State",
    "Step",
    "evolve",
]

T = TypeVar("T")


def evolve(value: T, **changes: Any) -> T:
    """Return a copy of a frozen dataclass with some fields changed, several times faster than `dataclasses.replace`."""
    copy: T = object.__new__(type(value))
    object.__setattr__(copy, "__dict__", {**value.__dict__, **changes})
    return copy


class State(enum.Enum):
    """The states of a mission (DESIGN.md section 5)."""

    MISSION_INPUT = "MISSION_INPUT"
    PREFLIGHT = "PREFLIGHT"
    OUTREACH = "OUTREACH"
    READY = "READY"
    START_RECORDING = "START_RECORDING"
    LOAD_MISSION = "LOAD_MISSION"
    TAKEOFF = "TAKEOFF"
    MISSION = "MISSION"
    HOLD = "HOLD"
    LAND = "LAND"
    PILOT = "PILOT"
    DATA_CLEANUP = "DATA_CLEANUP"
    MISSION_ENDED = "MISSION_ENDED"


class Step(enum.Enum):
    """Where within a state the engine is; NONE in states of one step."""

    NONE = ""
    ARMING = "arming"  # TAKEOFF: commanded, not yet armed
    LIFTING_OFF = "lifting_off"  # TAKEOFF: armed, not yet airborne
    CLIMBING = "climbing"  # TAKEOFF: airborne, below takeoff height
    CANCELLING = "cancelling"  # TAKEOFF: ABORT sent, waits for disarmed
    FLYING = "flying"  # MISSION
    TOUCHDOWN = "touchdown"  # MISSION: on the ground between files or repetitions
    CONFIRMING = "confirming"  # HOLD: sent, the planner does not hold yet
    HOLDING = "holding"  # HOLD
    RESUMING = "resuming"  # HOLD: RESUME sent, the planner does not fly yet
    DESCENDING = "descending"  # LAND: the vehicle shows that it lands
    COMMANDING = "commanding"  # LAND: it does not show it yet


class OutreachKind(enum.Enum):
    """Why external action is required."""

    NONE = ""
    PREFLIGHT = "preflight"
    DATA = "data"


class Result(enum.Enum):
    """How a mission ended."""

    NONE = ""
    COMPLETE = "COMPLETE"
    LANDED_EARLY = "LANDED_EARLY"
    PILOT = "PILOT"
    NOT_FLOWN = "NOT_FLOWN"


class DataResult(enum.Enum):
    """What became of the recording, whatever became of the flight."""

    NONE = ""
    COMPLETE = "COMPLETE"
    INCOMPLETE = "INCOMPLETE"


class FailureKind(enum.Enum):
    """What kind of thing is wrong."""

    COMPONENT = "component"  # a component, by the watchdog
    LOSS = "loss"  # something else that can be lost (FAILSAFE_CONDITIONS)
    USER = "user"  # the user asked for a hold


@dataclass(frozen=True)
class Agreement:
    """Statuses in a row that say the same. No single one is believed with a flight on it.

    Args:
        since_ns: arrival of the first of them.
        until_ns: arrival of the last one that was counted.
        statuses: how many, up to two; two stand for more.
    """

    since_ns: int
    until_ns: int
    statuses: int = 1

    def lasts(self, limit_ns: int) -> bool:
        """Return True when at least two of them agree over a time."""
        return self.statuses > 1 and self.until_ns - self.since_ns >= limit_ns


@dataclass(frozen=True)
class ClockApart:
    """A peer whose last status was stamped so far from the present that it is not believed.

    Args:
        peer: whose.
        age_ns: of its last status on arrival; negative: from the future.
        since_ns: arrival of the first such status in a row.
    """

    peer: str
    age_ns: int
    since_ns: int


@dataclass(frozen=True)
class CheckRecord:
    """What is known of one of the pre-flight checks.

    Args:
        check: which one.
        command_id: of the request that is current; replies to others are dropped.
        asked_ns: when it was asked.
        replied_ns: when the current request was answered; None while it is open.
        outcome: of the current request; None while it is open.
        ok: the answer, with every row passed.
        rows: the rows of the table; those of the last answer until the next one comes.
        fixable: the watchdog can restart what failed.
        being_fixed: and is doing so.
        until_ns: until then.
        message: reason in words.
    """

    check: CheckName
    command_id: int = 0
    asked_ns: int = 0
    replied_ns: Optional[int] = None
    outcome: Optional[Outcome] = None
    ok: bool = False
    rows: Tuple[Check, ...] = ()
    fixable: bool = False
    being_fixed: bool = False
    until_ns: Optional[int] = None
    message: str = ""


@dataclass(frozen=True)
class Failure:
    """One thing that is wrong now.

    Args:
        name: component, row of FAILSAFE_CONDITIONS, or "user_hold".
        kind: what kind of thing.
        code: the watchdog's code; 0 for what is not a component.
        verb: what is done about it now.
        then: second verb, while `verb` is WAIT.
        since_ns: when it was first seen.
        deadline_ns: end of its wait, while `verb` is WAIT.
        reason: in words.
    """

    name: str
    kind: FailureKind
    code: int
    verb: Verb
    then: Optional[Verb] = None
    since_ns: int = 0
    deadline_ns: Optional[int] = None
    reason: str = ""


@dataclass(frozen=True)
class EngineState:
    """All that the engine knows. Times are nanoseconds on the clock that decides; None: never, or not applicable.

    The fields in groups: where it is; the mission; before takeoff; in flight; landing; data; the last facts by peer.
    """

    t_ns: int = 0
    state: State = State.MISSION_INPUT
    step: Step = Step.NONE
    entered_ns: int = 0
    step_ns: int = 0
    started_ns: Optional[int] = None
    next_id: int = 1
    decisions: int = 0

    label: str = "session"
    sessions: int = 0
    session_id: str = ""
    mission: Optional[Mission] = None
    queue: Tuple[Mission, ...] = ()
    file_index: int = 0
    repetition: int = 0
    result: Result = Result.NONE
    cause: str = ""

    checks: Tuple[CheckRecord, ...] = ()
    fix_deadline_ns: Optional[int] = None
    rounds: int = 0
    go: bool = False
    outreach: OutreachKind = OutreachKind.NONE
    watchdog_started_ns: Optional[int] = None
    load_id: int = 0
    load_outcome: Optional[Outcome] = None
    load_message: str = ""

    in_flight: bool = False
    flight_started_ns: Optional[int] = None
    was_armed: bool = False
    was_airborne: bool = False
    flown: bool = False
    down: Optional[Agreement] = None
    aloft: Optional[Agreement] = None
    motors: Optional[Agreement] = None
    grounded_ns: Optional[int] = None
    interrupted: State = State.MISSION
    user_hold_ns: Optional[int] = None
    failures: Tuple[Failure, ...] = ()
    spent: Tuple[Tuple[str, int], ...] = ()
    flown_without: Tuple[str, ...] = ()
    motion_id: int = 0
    motion_ns: int = 0
    motion_outcome: Optional[Outcome] = None
    motion_message: str = ""
    commanded: Tuple[MissionAction, ...] = ()
    confirmed: Optional[MissionAction] = None
    mode_before: str = ""
    mode_shown: bool = False
    hold_repeated: bool = False
    moving_ns: Optional[int] = None
    takeover: Optional[Agreement] = None
    takeover_reason: str = ""
    takeover_noted: bool = False

    land_ns: Optional[int] = None
    land_sent_ns: int = 0
    land_cause: str = ""
    second_route_ns: Optional[int] = None
    both_routes: bool = False
    alarmed: bool = False
    overdue_alarmed: bool = False
    disarm_sent_ns: Optional[int] = None
    shutting_down: bool = False
    signal: str = ""
    armed_at_start: Optional[bool] = None

    recording_asked: bool = False
    recording_id: int = 0
    recording_outcome: Optional[Outcome] = None
    recording_message: str = ""
    recording_since_ns: Optional[int] = None
    recording_progressed: bool = False
    recording_over: bool = False
    data_location: str = ""
    data_result: DataResult = DataResult.NONE

    action: Optional[WatchdogAction] = None
    heartbeat_ns: Optional[int] = None
    loop_counters: Tuple[Tuple[str, int], ...] = ()
    clocks_apart: Tuple[ClockApart, ...] = ()
    clock_stalled_s: float = 0.0
    components: Tuple[ComponentStatus, ...] = ()
    planner: Optional[MissionStatus] = None
    planner_ns: Optional[int] = None
    recorder: Optional[RecordingStatus] = None
    recorder_ns: Optional[int] = None
    autopilot: Optional[AutopilotStatus] = None
    autopilot_ns: Optional[int] = None
    battery_ns: Optional[int] = None
    position_ns: Optional[int] = None
    descending_ns: Optional[int] = None
    landing: Optional[LandedStatus] = None
    landing_ns: Optional[int] = None
    message: str = ""
    message_level: Level = Level.INFO
    advice: str = ""

    @property
    def link_ns(self) -> Optional[int]:
        """When the autopilot itself was last heard over its link; None when that is unknown."""
        status, heard_ns = self.autopilot, self.autopilot_ns
        if status is None or heard_ns is None or status.link_age_s is None:
            return None
        return heard_ns - int(status.link_age_s * 1_000_000_000)
