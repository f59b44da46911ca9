"""Everything that can happen to the engine: frozen, keyword-only, checked when made. An invalid event cannot exist.

Before the events what they carry: checks, with the table of what is special about each, and missions.

Rules of this file:

* `t_ns` is the time at which the engine learns of it, integer nanoseconds on the clock that decides.
* Unknown is None. NaN and infinity become None here, so that no comparison further in ever meets them.
* `age_ns` of a status is how old the message said it was on arrival; negative: it claims to come from the future.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from math import isfinite, sqrt
from typing import Any, Dict, Mapping, Optional, Tuple, Type, TypeVar, Union

from .rules import Code, Restart, Rules, Severity

# --- checks -----------------------------------------------------------------------------------------------------------
# The rows of the pre-flight table and the names of the checks that make them.


class CheckName(enum.Enum):
    """The pre-flight checks, in the order in which they are asked and shown."""

    WATCHDOG = "watchdog"
    BATTERY = "battery"
    AUTOPILOT = "autopilot"
    ON_GROUND = "on_ground"
    STATE_ESTIMATION = "state_estimation"


@dataclass(frozen=True)
class CheckTraits:
    """What is special about a check.

    Args:
        asks: fields of its request (`commands.RunCheck`) besides the check itself.
        watches: its first accepted answer starts the watching, and may take until all is up; what failed may be fixed
            meanwhile, and every component is listed.
    """

    asks: Tuple[str, ...] = ()
    watches: bool = False


CHECKS: Mapping[CheckName, CheckTraits] = {
    **dict.fromkeys(CheckName, CheckTraits()),
    CheckName.WATCHDOG: CheckTraits(("mission_id", "required", "startup_time_ns"), watches=True),
    CheckName.BATTERY: CheckTraits(("required_fraction",)),
}


def checks_of(rules: Rules) -> Tuple[CheckName, ...]:
    """Return the checks that must pass before a takeoff, in their order."""
    return tuple(check for check in CheckName if not rules.checks or check.value in rules.checks)


class Verdict(enum.Enum):
    """What came of one row of a check. Only PASS and WARN let a vehicle take off."""

    PASS = "pass"  # noqa: S105 - a verdict
    WARN = "warn"
    FAIL = "fail"
    UNKNOWN = "unknown"


def finite(value: Optional[float]) -> Optional[float]:
    """Return the value, or None for NaN, infinity and None: unknown is said in one way."""
    return value if value is not None and isfinite(value) else None


@dataclass(frozen=True)
class Check:
    """One row of the pre-flight table.

    Args:
        name: what was checked, e.g. "battery fraction".
        verdict: what came of it.
        value: what was measured, in `unit`; None when unknown.
        limit: what it was compared with, in `unit`; None when there is none.
        unit: e.g. "fraction", "m", "rad"; empty when it has none.
        age_s: age of the value in seconds; None when unknown.
        advice: what a person can do about it.
        heals: it comes by itself after a start (a first message, the home position): asked again until a limit.
        other_limit: the other end, where the value must lie between two limits; `limit` is the one that is nearer.
    """

    name: str
    verdict: Verdict
    value: Optional[float] = None
    limit: Optional[float] = None
    unit: str = ""
    age_s: Optional[float] = None
    advice: str = ""
    heals: bool = False
    other_limit: Optional[float] = None

    def __post_init__(self) -> None:
        for field in ("value", "limit", "age_s", "other_limit"):
            object.__setattr__(self, field, finite(getattr(self, field)))

    @property
    def passed(self) -> bool:
        """True when the row lets a vehicle take off."""
        return self.verdict in (Verdict.PASS, Verdict.WARN)


# --- mission ----------------------------------------------------------------------------------------------------------
# What the engine needs to know of a mission.


@dataclass(frozen=True)
class Mission:
    """A mission as the engine sees it: the waypoints themselves are the planner's business.

    Args:
        id: as the user selects it, e.g. "1".
        description: one line for the user.
        files: number of waypoint files, at least 1.
        repetitions: how often the files are flown, at least 1.
        battery_needed_fraction: fraction 0..1 of the battery that it needs, reserve included; None: unknown.
        still_needed: what part of that, without the reserve, is needed from each takeoff on; empty: all of it.
        estimated_duration_s: of all files and repetitions together; None: unknown.
        severities: (component, severity) for components that this mission judges otherwise.
        required: components that must be at code 1 before takeoff; empty: all listed.
        tolerated: components that may be at code 2 before takeoff.
        max_height_m: limit above the takeoff position; None: the configuration's.
        max_distance_m: limit of the horizontal distance from the takeoff position; None: the configuration's.
        max_flight_time_ns: limit from the TAKEOFF command on; None: the configuration's.
        set_points: it is flown by set-points: once it is, no mission and no hold mode of the autopilot is ours.
    """

    id: str
    description: str = ""
    files: int = 1
    repetitions: int = 1
    battery_needed_fraction: Optional[float] = None
    still_needed: Tuple[float, ...] = ()
    estimated_duration_s: Optional[float] = None
    severities: Tuple[Tuple[str, Severity], ...] = ()
    required: Tuple[str, ...] = ()
    tolerated: Tuple[str, ...] = ()
    max_height_m: Optional[float] = None
    max_distance_m: Optional[float] = None
    max_flight_time_ns: Optional[int] = None
    set_points: bool = False

    def __post_init__(self) -> None:
        if not self.id:
            raise ValueError("a mission needs an id")
        if self.files < 1 or self.repetitions < 1:
            raise ValueError(f"mission {self.id}: files and repetitions must be at least 1")
        needed = self.battery_needed_fraction
        if needed is not None and not 0.0 <= needed <= 1.0:
            raise ValueError(f"mission {self.id}: battery_needed_fraction is {needed}, must be within 0..1")

    def battery_needed(self, takeoff: int, reserve_fraction: float) -> Optional[float]:
        """Return the fraction 0..1 of the battery that is needed from a takeoff on, the first is 0; None: unknown."""
        needed = self.battery_needed_fraction
        if needed is None or takeoff == 0 or takeoff >= len(self.still_needed):
            return needed
        return round(reserve_fraction + max(0.0, needed - reserve_fraction) * self.still_needed[takeoff], 6)


# --- events -----------------------------------------------------------------------------------------------------------


E = TypeVar("E", bound="Union[Event, PlatformRecording]")

_CLOCKS_DIFFER_BY_S = 0.2
_LONGEST_AGE_S = 1e9
_UPSIDE_DOWN_DEG = 180.0
_MOST_SATELLITES = 254.0  # a MAVLink receiver says 255 when it does not know


class InvalidEventError(ValueError):
    """An event was made of values that cannot be.

    Args:
        event: name of the event's class.
        field: name of the field.
        value: what it was given.
        expected: what it takes, in words.
    """

    def __init__(self, event: str, field: str, value: object, expected: str) -> None:
        super().__init__(f"{event}.{field} is {value!r}, must be {expected}")
        self.event, self.field, self.value, self.expected = event, field, value, expected


class UserCommand(enum.Enum):
    """What a user can ask of the engine, besides selecting a mission."""

    GO = "go"
    RETRY = "retry"
    GIVE_UP = "give_up"
    HOLD = "hold"
    RESUME = "resume"
    LAND = "land"
    ABORT = "abort"
    ACKNOWLEDGE = "acknowledge"


SAFE: Tuple[UserCommand, ...] = (UserCommand.HOLD, UserCommand.LAND, UserCommand.ABORT)
"""They stop the vehicle or bring it down: never too late. All else is for the moment that the operator saw."""


class Outcome(enum.Enum):
    """How a request to a peer ended."""

    ACCEPTED = "accepted"
    REFUSED = "refused"
    UNAVAILABLE = "unavailable"  # there is no such service
    TIMED_OUT = "timed_out"  # it did not answer within the limit
    BROKEN = "broken"  # it died in mid-call, or answered nonsense


class MissionPhase(enum.Enum):
    """Phase of the mission planner."""

    IDLE = 0
    LOADED = 1
    TAKING_OFF = 2
    FLYING = 3
    HOLDING = 4
    LANDING = 5
    LANDED = 6
    FAILED = 7


class RecordingPhase(enum.Enum):
    """Phase of the data recorder (the collector)."""

    IDLE = 0
    STARTING = 1
    RECORDING = 2
    STOPPING = 3
    RECOVERING = 4
    TRANSFERRING = 5
    MERGING = 6
    VERIFYING = 7
    COMPLETE = 8
    FAILED = 9


class VehicleLanded(enum.Enum):
    """Landed state as the autopilot says it."""

    UNKNOWN = 0
    ON_GROUND = 1
    TAKING_OFF = 2
    IN_AIR = 3
    LANDING = 4


class Landed(enum.Enum):
    """Landed state as the landing detection says it."""

    UNKNOWN = 0
    ON_GROUND = 1
    AIRBORNE = 2


_FIGURES: Dict[type, Tuple[str, ...]] = {}
"""The fields of each event that are a number or unknown."""


@dataclass(frozen=True)
class Event:
    """Base of all events.

    Args:
        t_ns: when the engine learns of it, on the clock that decides.
    """

    t_ns: int

    def __init_subclass__(cls) -> None:
        """Note what is a number or unknown: its annotation says so."""
        own = cls.__dict__.get("__annotations__", {})
        _FIGURES[cls] = tuple(name for name, hint in own.items() if hint == "Optional[float]")

    def __new__(cls, *args: Any, **_: Any) -> Event:  # noqa: PYI034 - typing.Self is newer than 3.8
        """Refuse positional arguments (Python 3.8 has no keyword-only dataclasses)."""
        if args:
            raise TypeError(f"{cls.__name__} takes keyword arguments only")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        if not isinstance(self.t_ns, int) or self.t_ns < 0:
            self._check("t_ns", good=False, expected="a whole number of nanoseconds, not negative")
        known = self.__dict__
        for field in _FIGURES.get(type(self), ()):
            value = known[field]
            if value is not None and not isfinite(value):
                known[field] = None

    def _check(self, field: str, *, good: bool, expected: str) -> None:
        if not good:
            raise InvalidEventError(type(self).__name__, field, getattr(self, field), expected)

    def _age_or_none(self, *fields: str) -> None:
        """Keep an age in seconds; one from the future (beyond what clocks differ by), or of decades, is unknown."""
        known = self.__dict__
        for field in fields:
            value = known[field]
            if value is not None:
                known[field] = max(0.0, value) if -_CLOCKS_DIFFER_BY_S <= value <= _LONGEST_AGE_S else None

    def _within_or_none(self, field: str, most: float) -> None:
        """Keep a number in 0..most; anything else is unknown (batteries say -1 or -0.53 when they do not know)."""
        value = self.__dict__[field]
        if value is not None and not 0.0 <= value <= most:
            self.__dict__[field] = None


def made(kind: Type[E], **fields: Any) -> E:
    """Make an event, or a part of one, of all its fields: checked as by its constructor, which takes twice as long.

    Raises:
        InvalidEventError: A field is what it cannot be.
        TypeError: A field is missing, or there is no such.
    """
    if fields.keys() != kind.__dataclass_fields__.keys():
        kind(**fields)  # says which does not exist, or may not be left out
        raise TypeError(f"{kind.__name__} is made of all its fields: {', '.join(kind.__dataclass_fields__)}")
    event: E = object.__new__(kind)
    event.__dict__.update(fields)
    event.__post_init__()
    return event


@dataclass(frozen=True)
class Tick(Event):
    """Time has passed: the shell wakes the engine at its next deadline, and first of all after it did not run.

    Args:
        away_ns: for how long it did not, the time in which the computer slept included.
    """

    away_ns: int = 0


@dataclass(frozen=True)
class EngineStarted(Event):
    """The process of the engine starts: the first event of all, and the first after a restart.

    Args:
        label: prefix of session ids, made from the wall time by the shell, e.g. "20261121T101500".
        resumed: a journal was open; its events were decided again before this one.
        away_ns: since when that was written last, on a clock that neither a new simulation nor a sleep stops.
    """

    label: str = "session"
    resumed: bool = False
    away_ns: int = 0


@dataclass(frozen=True)
class MissionSelected(Event):
    """The user has selected and confirmed one mission, or several to be flown one after the other."""

    missions: Tuple[Mission, ...]
    request_id: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("missions", good=len(self.missions) > 0, expected="at least one mission")


@dataclass(frozen=True)
class MissionRejected(Event):
    """The user asked for a mission that does not exist or is not valid; `error` says why and what would be right."""

    mission_id: str
    error: str
    request_id: int = 0


@dataclass(frozen=True)
class UserRequest(Event):
    """A command of the user. The engine answers every one with an `Answer` of the same `request_id`.

    Args:
        command: what is asked.
        request_id: of the answer.
        by: what asks in the place of a person at a console, e.g. "the transmitter's land switch"; empty: nothing does.
    """

    command: UserCommand
    request_id: int = 0
    by: str = ""


@dataclass(frozen=True)
class ComponentStatus:
    """Condition of one component as the watchdog says it.

    Args:
        name: the component.
        code: its condition.
        restart: what the watchdog does about it.
        until_ns: when the watchdog gives up restarting it, on the clock that decides; None when it does not try.
        reason: why it is not nominal.
    """

    name: str
    code: Code
    restart: Restart = Restart.NONE
    until_ns: Optional[int] = None
    reason: str = ""


@dataclass(frozen=True)
class WatchdogAction(Event):
    """The watchdog's action stream and heartbeat; `components` are all at code 4 or above.

    `publisher` is the node that sent it: the loop counters of two watchdogs are told apart by it.
    """

    sequence: int
    loop_counter: int
    code: Code
    latest_component: str = ""
    components: Tuple[ComponentStatus, ...] = ()
    publisher: str = ""
    age_ns: int = 0


@dataclass(frozen=True)
class WatchdogInfo(Event):
    """The watchdog's info stream: every component it watches, and which of them changed."""

    sequence: int
    changed: Tuple[str, ...]
    components: Tuple[ComponentStatus, ...]
    age_ns: int = 0


@dataclass(frozen=True)
class CheckReply(Event):
    """The answer to a `RunCheck`. `fixable` ... `components` are the watchdog's alone."""

    command_id: int
    check: CheckName
    outcome: Outcome
    ok: bool = False
    checks: Tuple[Check, ...] = ()
    fixable: bool = False
    being_fixed: bool = False
    until_ns: Optional[int] = None
    components: Tuple[ComponentStatus, ...] = ()
    message: str = ""


@dataclass(frozen=True)
class Reply(Event):
    """The answer to any other command that has an id."""

    command_id: int
    outcome: Outcome
    message: str = ""


@dataclass(frozen=True)
class MissionStatus(Event):
    """The mission planner's status."""

    session_id: str
    mission_id: str
    phase: MissionPhase
    waypoint: int = 0
    waypoints: int = 0
    file_index: int = 0
    repetition: int = 0
    distance_left_m: Optional[float] = None
    time_left_s: Optional[float] = None
    message: str = ""
    age_ns: int = 0


@dataclass(frozen=True)
class PlatformRecording:
    """The recording on one companion computer.

    `written_bytes` so far, `free_fraction` of its storage; `cpu_fraction` of all its cores is busy; its last status was
    `clock_age_s` old by its own stamp when it came.
    """

    platform: str
    growing: bool
    written_bytes: int = 0
    byte_rate: Optional[float] = None
    free_fraction: Optional[float] = None
    location: str = ""
    message: str = ""
    cpu_fraction: Optional[float] = None
    clock_age_s: Optional[float] = None

    def __post_init__(self) -> None:
        for field in ("byte_rate", "free_fraction", "cpu_fraction", "clock_age_s"):
            value = self.__dict__[field]
            if value is not None and not isfinite(value):
                self.__dict__[field] = None


@dataclass(frozen=True)
class RecordingStatus(Event):
    """The data recorder's status; `progress` of the phase is 0..1, `lost` names what of the flight is not recorded."""

    session_id: str
    phase: RecordingPhase
    progress: Optional[float] = None
    platforms: Tuple[PlatformRecording, ...] = ()
    location: str = ""
    message: str = ""
    lost: str = ""
    age_ns: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._within_or_none("progress", 1.0)


@dataclass(frozen=True)
class AutopilotStatus(Event):
    """What the vehicle says of itself; None is unknown. Position east and north of the takeoff position.

    `tilt_deg` is the angle between its z axis and the vertical that has lasted (`monitoring.gravity.LastingTilt`);
    `gps_fix` is the kind of fix in words, e.g. "3D", and `satellites` a number: for people, nothing is decided by them.
    """

    armed: Optional[bool]
    landed: VehicleLanded
    mode: str = ""
    pilot_in_control: bool = False
    failsafe: bool = False
    link_age_s: Optional[float] = 0.0
    height_m: Optional[float] = None
    position_x_m: Optional[float] = None
    position_y_m: Optional[float] = None
    vertical_speed_m_s: Optional[float] = None
    horizontal_speed_m_s: Optional[float] = None
    battery_fraction: Optional[float] = None
    battery_voltage_v: Optional[float] = None
    battery_age_s: Optional[float] = None
    battery_critical: bool = False
    tilt_deg: Optional[float] = None
    gps_fix: str = ""
    satellites: Optional[float] = None
    age_ns: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._age_or_none("link_age_s", "battery_age_s")
        self._within_or_none("satellites", _MOST_SATELLITES)
        self._within_or_none("battery_fraction", 1.0)
        self._within_or_none("tilt_deg", _UPSIDE_DOWN_DEG)

    @property
    def distance_m(self) -> Optional[float]:
        """Horizontal distance from the takeoff position, to the millimetre; None when it is unknown."""
        x_m, y_m = self.position_x_m, self.position_y_m
        if x_m is None or y_m is None:
            return None
        return round(sqrt(x_m * x_m + y_m * y_m), 3)  # hypot rounds differently on Python 3.8 and 3.11


@dataclass(frozen=True)
class LandedStatus(Event):
    """The landing detection's judgement; `distance_m` to the ground below the vehicle's feet."""

    landed: Landed
    distance_m: Optional[float] = None
    reason: str = ""
    age_ns: int = 0


@dataclass(frozen=True)
class ClockStatus(Event):
    """How long the clock that decides has stood still (`use_sim_time`), in seconds of wall time; 0 when it runs."""

    stalled_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("stalled_s", good=isfinite(self.stalled_s) and self.stalled_s >= 0.0, expected="a time in seconds")


@dataclass(frozen=True)
class Shutdown(Event):
    """The process was told to end; `signal` is its name, e.g. "SIGINT"."""

    signal: str = "SIGINT"
