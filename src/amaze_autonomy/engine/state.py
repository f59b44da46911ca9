"""The state of the engine: one frozen value that holds all it knows. `decide` makes the next one from it.

Raw facts (the last status of each peer) are kept as they came, with the time of their arrival; what they mean is
computed from them at each event. So nothing in here can contradict the facts for longer than one event.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any, Optional, Tuple, TypeVar

from .commands import Level, MissionAction, Notify
from .events import (
    AutopilotStatus,
    Check,
    CheckName,
    ComponentStatus,
    LandedStatus,
    Mission,
    MissionStatus,
    Outcome,
    RecordingStatus,
    WatchdogAction,
)
from .rules import Action

T = TypeVar("T")


def evolve(value: T, **changes: Any) -> T:
    """Return a copy of a frozen dataclass with some fields changed, several times faster than `dataclasses.replace`."""
    copy: T = object.__new__(type(value))
    object.__setattr__(copy, "__dict__", {**value.__dict__, **changes})
    return copy


def put(value: T, path: str, new: Any) -> T:
    """Return a copy of a frozen dataclass with one field changed that may lie in a part of it: "landing.alarmed"."""
    name, _, rest = path.partition(".")
    return evolve(value, **{name: put(getattr(value, name), rest, new) if rest else new})


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
        action: what is done about it now.
        fallback: what is done when a wait has ended, while `action` is WAIT.
        since_ns: when it was first seen.
        deadline_ns: end of its wait, while `action` is WAIT.
        reason: in words.
    """

    name: str
    kind: FailureKind
    code: int
    action: Action
    fallback: Optional[Action] = None
    since_ns: int = 0
    deadline_ns: Optional[int] = None
    reason: str = ""


@dataclass(frozen=True)
class Session:
    """What is flown, from the beginning of a mission to its end; `begin_session` makes a new one.

    Args:
        id: in every request and status about it; empty: there is none.
        mission: that is flown.
        file_index, repetition: where it is in it.
        flown: it has left the ground, or may have unheard, in any of its flights.
        result: how it ended; `data_result`: what became of its data.
        outreach: why external action is required.
    """

    id: str = ""
    mission: Optional[Mission] = None
    file_index: int = 0
    repetition: int = 0
    flown: bool = False
    result: Result = Result.NONE
    data_result: DataResult = DataResult.NONE
    outreach: OutreachKind = OutreachKind.NONE

    @property
    def takeoff(self) -> int:
        """Which of the mission's takeoffs it is about; the first is 0."""
        return 0 if self.mission is None else self.repetition * self.mission.files + self.file_index


@dataclass(frozen=True)
class Asked:
    """The last request of a kind: its id, when it was sent, how it was answered. Answers to others are dropped."""

    id: int = 0
    sent_ns: int = 0
    outcome: Optional[Outcome] = None
    message: str = ""


@dataclass(frozen=True)
class Preflight:
    """What was asked before a takeoff.

    Args:
        checks: all of them, or none.
        fix_deadline_ns: end of the time in which what failed may be fixed.
        rounds: how often the checks were run since a person was asked.
        load: the request that loads the mission.
        away: the engine was away meanwhile, and not for a moment, or was told to end.
    """

    checks: Tuple[CheckRecord, ...] = ()
    fix_deadline_ns: Optional[int] = None
    rounds: int = 0
    load: Asked = Asked()
    away: bool = False


@dataclass(frozen=True)
class Flight:
    """One flight, from its TAKEOFF command on; `take_off` makes a new one.

    Args:
        active: until the vehicle says that it is down, for long enough.
        started_ns: the TAKEOFF command.
        was_armed, was_airborne: since then.
        grounded_ns: since when it says that it is on the ground.
        interrupted: what a hold has interrupted.
        user_hold_ns: since when the user holds it.
        spent: what components have spent of their budgets of waiting.
        flown_without: components that are not waited for any more.
        motion: the last command.
        commanded: all since the last that a mode has answered, one after the other.
        confirmed: the last that a mode has answered.
        mode_before: the flight mode before all of them.
        mode_shown: the mode by which one status answers the last; empty: it does not.
        mode_flown: how far two statuses have shown a takeoff, or a resume, to have come.
        flown_by: likewise, by which of AUTO.MISSION and OFFBOARD it is flown; a resume leaves it.
        hold_repeated: the hold was commanded again.
        takeover_noted: the user was told that somebody else seems to have control.
        another: after it, it was armed on the ground again, and not by us, or stood there for long: what flies then is
            somebody else's.
    """

    active: bool = False
    started_ns: Optional[int] = None
    was_armed: bool = False
    was_airborne: bool = False
    grounded_ns: Optional[int] = None
    interrupted: State = State.MISSION
    user_hold_ns: Optional[int] = None
    spent: Tuple[Tuple[str, int], ...] = ()
    flown_without: Tuple[str, ...] = ()
    motion: Asked = Asked()
    commanded: Tuple[MissionAction, ...] = ()
    confirmed: Optional[MissionAction] = None
    mode_before: str = ""
    mode_shown: str = ""
    mode_flown: str = ""
    flown_by: str = ""
    hold_repeated: bool = False
    takeover_noted: bool = False
    another: bool = False


@dataclass(frozen=True)
class Landing:
    """The landing of a flight; a takeoff knows of none.

    Args:
        since_ns: its first command; None: it has not begun, or is over.
        sent_ns: its last command.
        cause: why it lands.
        both_routes: planner and autopilot are told at once.
        second_route_ns: the first command to the autopilot itself.
        alarmed, overdue_alarmed: the pilot was alarmed, because nothing shows a landing, and because of its limit.
        lost_alarmed, armed_alarmed: likewise, because the vehicle is not heard, and because it stays armed.
        alarms: that the pilot was told, the last of each kind.
        disarm_sent_ns: the last command to disarm.
    """

    since_ns: Optional[int] = None
    sent_ns: int = 0
    cause: str = ""
    both_routes: bool = False
    second_route_ns: Optional[int] = None
    alarmed: bool = False
    overdue_alarmed: bool = False
    armed_alarmed: bool = False
    lost_alarmed: bool = False
    alarms: Tuple[Notify, ...] = ()
    disarm_sent_ns: Optional[int] = None


@dataclass(frozen=True)
class Recording:
    """The recording of a session.

    Args:
        asked: for, in this session.
        request: the last one to the recorder.
        since_ns: since when files grow on every platform.
        progressed: the recorder has said something else than FAILED since it was asked.
        over: the session has ended.
        stopped: it was asked to stop.
        flown_on: the vehicle flew on behind that, or nobody knows that it did not.
        location: of the data.
    """

    asked: bool = False
    request: Asked = Asked()
    since_ns: Optional[int] = None
    progressed: bool = False
    over: bool = False
    stopped: bool = False
    flown_on: bool = False
    location: str = ""


@dataclass(frozen=True)
class Vehicle:
    """What the autopilot's statuses say in a row; none of it is known when they begin anew.

    Args:
        down, aloft, motors, disarmed: how long they agree on disarmed and on the ground, in the air, armed, disarmed.
        spinning: likewise, on armed and on the ground.
        takeover: how long they agree that somebody else has control.
        takeover_reason: and why, in words.
        moving_ns, descending_ns: since when it flies on over ground, and sinks; `adrift_ns`: since when no mode shows a
            hold, and it moves, climbs or sinks.
        contradicted_ns: when landing detection or height last contradicted that it stands on the ground.
    """

    down: Optional[Agreement] = None
    aloft: Optional[Agreement] = None
    motors: Optional[Agreement] = None
    disarmed: Optional[Agreement] = None
    spinning: Optional[Agreement] = None
    takeover: Optional[Agreement] = None
    takeover_reason: str = ""
    moving_ns: Optional[int] = None
    adrift_ns: Optional[int] = None
    descending_ns: Optional[int] = None
    contradicted_ns: Optional[int] = None


@dataclass(frozen=True)
class Peers:
    """The last status of each peer as it came, and when; what it means is computed from it at each event.

    Of each watchdog its last loop counter is kept, and how often in a row it has grown, up to two. Since when something
    is so: `planner_idle_ns`, that the planner says of a vehicle in the air that nothing is flown; `landing_stalled_ns`,
    that it says that it lands, and the vehicle stands there; `vehicle_unknown_ns`, that it is not known whether the
    vehicle is armed, or on the ground, or that it is said to be disarmed in the air; `armed_unknown_ns`, whether armed.
    """

    action: Optional[WatchdogAction] = None
    heartbeat_ns: Optional[int] = None
    loop_counters: Tuple[Tuple[str, int, int], ...] = ()
    watchdog_started_ns: Optional[int] = None
    components: Tuple[ComponentStatus, ...] = ()
    planner: Optional[MissionStatus] = None
    planner_ns: Optional[int] = None
    planner_idle_ns: Optional[int] = None
    landing_stalled_ns: Optional[int] = None
    recorder: Optional[RecordingStatus] = None
    recorder_ns: Optional[int] = None
    autopilot: Optional[AutopilotStatus] = None
    autopilot_ns: Optional[int] = None
    vehicle_unknown_ns: Optional[int] = None
    armed_unknown_ns: Optional[int] = None
    battery_ns: Optional[int] = None
    position_ns: Optional[int] = None
    landing: Optional[LandedStatus] = None
    landing_ns: Optional[int] = None
    clock_stalled_s: float = 0.0
    clocks_apart: Tuple[ClockApart, ...] = ()

    @property
    def link_ns(self) -> Optional[int]:
        """When the autopilot itself was last heard over its link; None when that is unknown."""
        status, heard_ns = self.autopilot, self.autopilot_ns
        if status is None or heard_ns is None or status.link_age_s is None:
            return None
        return heard_ns - int(status.link_age_s * 1_000_000_000)

    def after_restart(self, now_ns: int) -> Peers:
        """Return what is known after a restart: nothing of what was said; the limits of silence run from now on."""
        heard = ("heartbeat_ns", "planner_ns", "recorder_ns", "autopilot_ns", "battery_ns", "position_ns", "landing_ns")
        silent_from_now = {name: now_ns for name in heard if getattr(self, name) is not None}
        kept = ("action", "loop_counters", "watchdog_started_ns", "components")
        return evolve(Peers(), **{name: getattr(self, name) for name in kept}, **silent_from_now)


_NOTHING = Notify(level=Level.INFO, key="", text="")


@dataclass(frozen=True)
class EngineState:
    """All that the engine knows. Times are nanoseconds on the clock that decides; None: never, or not applicable.

    Args:
        t_ns: of the last event.
        state, step: where it is; `entered_ns` and `step_ns`: since when.
        started_ns: when its process began; `armed_at_start`: what the first statuses that agree said then,
            or after a landing was given up; False as soon as it is disarmed: who arms it then, and not by us, is
            somebody else.
        next_id, decisions: of the next request, and how many there were.
        label, sessions: session ids are made of them.
        queue: the missions that were selected and have not begun.
        cause: why the last row fired.
        failures: all that is wrong now.
        shutting_down, signal: the process was told to end; the signal while nobody has answered it.
        land_deferred: who asked for a landing while it was not clear who has control, or whether it has landed; empty:
            the user; None: nobody.
        said: the last message to the user; `shown`: what he is shown, an alarm for as long as it stands.

    The rest are parts, each of which begins anew by one assignment.
    """

    t_ns: int = 0
    state: State = State.MISSION_INPUT
    step: Step = Step.NONE
    entered_ns: int = 0
    step_ns: int = 0
    started_ns: Optional[int] = None
    armed_at_start: Optional[bool] = None
    next_id: int = 1
    decisions: int = 0
    label: str = "session"
    sessions: int = 0
    queue: Tuple[Mission, ...] = ()
    cause: str = ""
    failures: Tuple[Failure, ...] = ()
    shutting_down: bool = False
    signal: str = ""
    land_deferred: Optional[str] = None
    said: Notify = _NOTHING
    shown: Notify = _NOTHING

    session: Session = Session()
    preflight: Preflight = Preflight()
    flight: Flight = Flight()
    landing: Landing = Landing()
    recording: Recording = Recording()
    vehicle: Vehicle = Vehicle()
    peers: Peers = Peers()
