"""What can be lost in flight and what is done about it: one row each, `FAILSAFE_CONDITIONS`. All else follows.

A row holds when one of its conditions does, and a condition has one of four forms:

* `Silent`: a stream was not heard for longer than a limit. The engine wakes up by itself when that is so.
* `Above`, `Below`: a field of a status is above its limit, or not above it. Unknown is neither, and a row of its own.
* `Says`: a status says so itself.

A limit is a row of `rules.Limits`; where a mission has a field of the same name, the mission's own counts. Comparisons
are written so that unknown does not pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Optional, Tuple, Union

from .commands import Seen, Value, because
from .events import MissionPhase, RecordingPhase, RecordingStatus
from .rules import Rules
from .severity import Verb
from .state import EngineState
from .turn import Turn

__all__ = [
    "FAILSAFE_CONDITIONS",
    "Above",
    "Below",
    "FailsafeCondition",
    "Says",
    "Silent",
    "limit_of",
    "proves_recording",
]

_NS = 1e9
_LINK = "age of the autopilot's link"


def limit_of(name: str, state: EngineState, rules: Rules) -> float:
    """Return a limit by its name: the mission's own, else the configuration's."""
    own = getattr(state.mission, name, None)
    found: float = getattr(rules.limits, name) if own is None else own
    return found


@dataclass(frozen=True)
class Silent:
    """A stream was not heard for longer than a limit.

    Args:
        stream: time of the state at which it was heard; empty: never, what counts is the time since the takeoff.
        limit: how long it may be silent.
        words: what its age is called.
        since: time of the state from which silence counts at the earliest. Empty: in flight only, and from the takeoff
            where the stream was never heard. None: from when it was heard.
        ends_flight: it is shown as the end of the flight, which comes at the limit, not beyond it.
    """

    stream: str
    limit: str
    words: str
    since: Optional[str] = ""
    ends_flight: bool = False

    @property
    def timer(self) -> str:
        """The name of the wait for it: that of its limit."""
        return self.limit[: -len("_ns")].replace("max_", "")

    def end_ns(self, state: EngineState, rules: Rules) -> Optional[int]:
        """Return when it has been silent for too long; None while nobody waits for it."""
        heard = _time(state, self.stream)
        begin = heard
        if self.since == "":
            flying = state.in_flight and state.flight_started_ns is not None
            begin = None if not flying else heard if heard is not None else state.flight_started_ns
        elif self.since is not None:
            begin = _time(state, self.since)
            begin = None if begin is None else max(begin, heard or 0)
        if begin is None:
            return None
        return begin + int(limit_of(self.limit, state, rules)) + (0 if self.ends_flight else 1)

    def holds(self, turn: Turn) -> Optional[Seen]:
        """Return its age and the limit when it has been silent for too long."""
        end = self.end_ns(turn.state, turn.rules)
        if end is None or turn.now < end:
            return None
        heard = _time(turn.state, self.stream)
        age = turn.now - (heard if heard is not None else turn.state.flight_started_ns or 0)
        limit = limit_of(self.limit, turn.state, turn.rules) / _NS
        return Seen((Value(self.words, round(age / _NS, 3), limit, "s"),))


def _time(state: EngineState, name: str) -> Optional[int]:
    return getattr(state, name) if name else None


@dataclass(frozen=True)
class _Bound:
    """A field of a status against a limit.

    Args:
        field: of the state, or of one of its statuses: "autopilot.height_m".
        limit: what it is compared with; in nanoseconds where the field is in seconds.
        words: what it is called.
        fresh: it counts only while the vehicle is heard; else its last word does.
    """

    field: str
    limit: str
    words: str
    fresh: bool = True

    def holds(self, turn: Turn) -> Optional[Seen]:
        """Return value and limit when the one is beyond the other."""
        status, _, field = self.field.rpartition(".")
        holder = getattr(turn.state, status) if status else turn.state
        if holder is None or (self.fresh and status == "autopilot" and turn.vehicle() is None):
            return None
        value, limit = getattr(holder, field), limit_of(self.limit, turn.state, turn.rules)
        limit = limit / _NS if self.limit.endswith("_ns") else limit
        if value is None or not self.beyond(value, limit):
            return None
        unit = next(unit for end, unit in _UNITS if field.endswith(end))
        return Seen((Value(self.words, value, limit, unit),))

    def beyond(self, value: float, limit: float) -> bool:
        """Return True when a value is not as it should be."""
        raise NotImplementedError


_UNITS = (("_m_s", "m/s"), ("_m", "m"), ("_s", "s"), ("_fraction", "fraction"), ("", ""))


class Above(_Bound):
    """A field of a status is above its limit."""

    def beyond(self, value: float, limit: float) -> bool:
        """Return True above the limit."""
        return not value <= limit


class Below(_Bound):
    """A field of a status is at its limit or below it."""

    def beyond(self, value: float, limit: float) -> bool:
        """Return True at the limit and below."""
        return not value > limit


@dataclass(frozen=True)
class Says:
    """A status says so itself: `holds` returns what it looked at, else None."""

    holds: Callable[[Turn], Optional[Seen]]


@dataclass(frozen=True)
class FailsafeCondition:
    """One row of the table.

    Args:
        name: as in journals and tests.
        when: any of these.
        action: what is done about it.
        words: for the user and the documentation.
        both_routes: the landing is sent to the planner and to the autopilot at once.
        alarm: the pilot is alarmed at once.
        peer: whose silence it is; where its clock is the reason, that is said.
        only: field of the state that must be true.
        on_ground: the engine wakes up for it before a takeoff too.
    """

    name: str
    when: Tuple[Union[Silent, Above, Below, Says], ...]
    action: Verb
    words: str
    both_routes: bool = False
    alarm: bool = False
    peer: str = ""
    only: str = ""
    on_ground: bool = False

    def holds(self, turn: Turn) -> Optional[Seen]:
        """Return what was looked at when it holds, else None."""
        if self.only and not getattr(turn.state, self.only):
            return None
        for condition in self.when:
            seen = condition.holds(turn)
            if seen is not None:
                return seen
        return None


# --- what a status says -----------------------------------------------------------------------------------------------


def proves_recording(event: RecordingStatus) -> bool:
    """Return True when a recorder's status proves that files grow on every platform."""
    recording = event.phase is RecordingPhase.RECORDING
    return recording and bool(event.platforms) and all(platform.growing for platform in event.platforms)


def _planner_failed(turn: Turn) -> Optional[Seen]:
    planner = turn.state.planner
    if planner is None or planner.phase is not MissionPhase.FAILED:
        return None
    return Seen((Value("planner phase", "FAILED"), Value("planner says", planner.message)))


def _link_unknown(turn: Turn) -> Optional[Seen]:
    status, limit_s = turn.state.autopilot, turn.limits.autopilot_link_limit_ns / _NS
    return Seen((Value(_LINK, None, limit_s, "s"),)) if status is not None and status.link_age_s is None else None


def _battery_flag(turn: Turn) -> Optional[Seen]:
    """Take the autopilot's word: ArduPilot's level ignores the voltage."""
    critical = turn.state.autopilot is not None and turn.state.autopilot.battery_critical
    return because("reason", "the autopilot says that the battery is critical") if critical else None


def _does_not_record(turn: Turn) -> Optional[Seen]:
    recorder = turn.state.recorder
    if recorder is None or proves_recording(recorder):
        return None
    still = ", ".join(p.platform for p in recorder.platforms if not p.growing)
    phase = Value("recorder phase", recorder.phase.name, "RECORDING")
    return Seen((phase, Value("files do not grow on", still)))


# --- the table --------------------------------------------------------------------------------------------------------

F = FailsafeCondition

# One row a line.
# fmt: off
FAILSAFE_CONDITIONS: Tuple[FailsafeCondition, ...] = (
    F("watchdog_heartbeat", (Silent("heartbeat_ns", "watchdog_heartbeat_limit_ns", "age of the watchdog's heartbeat", since="watchdog_started_ns"),), Verb.LAND, "the watchdog's heartbeat is lost", peer="watchdog", on_ground=True),
    F("planner_status", (Silent("planner_ns", "planner_status_limit_ns", "age of the planner's status"),), Verb.LAND, "the mission planner's status is lost", both_routes=True, peer="planner"),
    F("planner_failed", (Says(_planner_failed),), Verb.LAND, "the mission planner says that it failed", both_routes=True),
    F("autopilot_status", (Silent("autopilot_ns", "autopilot_status_limit_ns", "age of the autopilot's status"), Says(_link_unknown), Silent("link_ns", "autopilot_link_limit_ns", _LINK, since=None)), Verb.LAND, "the autopilot's status is lost", both_routes=True, alarm=True, peer="autopilot"),
    F("clock", (Above("clock_stalled_s", "clock_stall_limit_ns", "the clock stands for"),), Verb.LAND, "the clock that decides stands still (/clock)", both_routes=True),
    F("battery_unknown", (Silent("battery_ns", "battery_age_limit_ns", "age of the battery level"),), Verb.LAND, "the battery level is unknown for too long"),
    F("battery_critical", (Below("autopilot.battery_fraction", "battery_critical_fraction", "battery fraction", fresh=False), Says(_battery_flag)), Verb.LAND, "the battery is critical"),
    F("flight_time", (Silent("", "max_flight_time_ns", "flight time", ends_flight=True),), Verb.LAND, "the maximum flight time is reached"),
    F("height", (Above("autopilot.height_m", "max_height_m", "height"),), Verb.LAND, "the height limit is exceeded"),
    F("distance", (Above("autopilot.distance_m", "max_distance_m", "distance"),), Verb.LAND, "the distance limit is exceeded"),
    F("position_unknown", (Silent("position_ns", "position_age_limit_ns", "age of the position"),), Verb.CONTINUE, "height or position is unknown: their limits cannot be checked"),
    F("recorder_dead", (Silent("recorder_ns", "recorder_status_limit_ns", "age of the recorder's status"), Says(_does_not_record)), Verb.CONTINUE, "the recorder is silent or does not record", peer="recorder", only="recording_asked"),
    F("landing_detection", (Silent("landing_ns", "landing_detection_limit_ns", "age of the landing detection"),), Verb.CONTINUE, "the landing detection is silent", peer="landing detection"),
)
# fmt: on
