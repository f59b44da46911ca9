"""What is wrong, and what is done about it. Tables first: `FAILSAFE_CONDITIONS`, one row for all that can be lost.

A row holds when one of its conditions does, and a condition has one of four forms:

* `Silent`: a stream was not heard for longer than a limit. The engine wakes up by itself when that is so.
* `Above`, `Below`: a field of a status is above its limit, or not above it. Unknown is neither, and a row of its own.
* `Says`: a status says so itself.

A limit is a row of `rules.Limits`; where a mission has a field of the same name, the mission's own counts. Comparisons
are written so that unknown does not pass. What a component's failure means stands in `rules.SEVERITIES`.
"""

from __future__ import annotations

import abc
import dataclasses
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from .commands import Seen, Value, because
from .context import Context
from .events import ComponentStatus, Mission, MissionPhase, RecordingPhase, RecordingStatus
from .rules import SEVERITIES, Action, Code, Restart, Rules, Severity, action_of, row_of_code
from .state import EngineState, Failure, FailureKind, State, Step, evolve

_NS = 1e9
_SILENT = "silent for"


_OF_A_MISSION = frozenset(Mission.__dataclass_fields__)


def _limit_of(name: str) -> Callable[[EngineState, Rules], Any]:
    """Return what reads a limit: the mission's own, where it has one of that name, else the configuration's."""
    configured = attrgetter(name)
    if name not in _OF_A_MISSION:
        return lambda _state, rules: configured(rules.limits)

    def limit(state: EngineState, rules: Rules) -> Any:
        mission = state.session.mission
        own = configured(mission) if mission is not None else None
        return configured(rules.limits) if own is None else own

    return limit


def _field(name: str) -> Callable[[Any], Any]:
    """Return what reads a field; None where it has no name. Names are looked up once: this runs at every event."""
    return attrgetter(name) if name else lambda _: None


@dataclass(frozen=True)
class Silent:
    """A stream was not heard for longer than a limit.

    Args:
        stream: time of `state.Peers` at which it was heard; empty: never, what counts is the time since the takeoff.
        limit: how long it may be silent.
        words: what its age is called.
        since: time of `state.Peers` from which silence counts at the earliest. Empty: in flight only, and from the takeoff
            where the stream was never heard. None: from when it was heard.
        ends_flight: it is shown as the end of the flight, which comes at the limit, not beyond it.
    """

    stream: str
    limit: str
    words: str
    since: Optional[str] = ""
    ends_flight: bool = False
    _read: Tuple[Callable[..., Any], ...] = dataclasses.field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_read", (_field(self.stream), _field(self.since or ""), _limit_of(self.limit)))

    @property
    def timer(self) -> str:
        """The name of the wait for it: that of its limit."""
        return self.limit[: -len("_ns")].replace("max_", "")

    def end_ns(self, state: EngineState, rules: Rules) -> Optional[int]:
        """Return when it has been silent for too long; None while nobody waits for it."""
        read_heard, read_since, limit = self._read
        begin: Optional[int] = read_heard(state.peers)
        if self.since == "":
            flight = state.flight
            if not flight.active or flight.started_ns is None:
                return None
            begin = flight.started_ns if begin is None else begin
        elif self.since is not None:
            since: Optional[int] = read_since(state.peers)
            begin = None if since is None else max(since, begin or 0)
        if begin is None:
            return None
        end: int = begin + limit(state, rules)
        return end if self.ends_flight else end + 1

    def holds(self, context: Context) -> Optional[Seen]:
        """Return its age and the limit when it has been silent for too long."""
        end = self.end_ns(context.state, context.rules)
        if end is None or context.now < end:
            return None
        read_heard, _, limit = self._read
        heard = read_heard(context.state.peers)
        age = context.now - (heard if heard is not None else context.state.flight.started_ns or 0)
        return Seen((Value(self.words, round(age / _NS, 3), limit(context.state, context.rules) / _NS, "s"),))


@dataclass(frozen=True)
class Bound(abc.ABC):
    """A field of a status against a limit.

    Args:
        field: of `state.Peers`, or of one of its statuses: "autopilot.height_m".
        limit: what it is compared with; in nanoseconds where the field is in seconds.
        words: what it is called.
        fresh: it counts only while the vehicle is heard; else its last word does.
    """

    field: str
    limit: str
    words: str
    fresh: bool = True
    _read: Tuple[Any, ...] = dataclasses.field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        status, _, name = self.field.rpartition(".")
        of_vehicle = self.fresh and status == "autopilot"
        holder = attrgetter(status) if status else lambda peers: peers
        scale = _NS if self.limit.endswith("_ns") else 1.0
        object.__setattr__(self, "_read", (of_vehicle, holder, attrgetter(name), _limit_of(self.limit), scale))

    def holds(self, context: Context) -> Optional[Seen]:
        """Return value and limit when the one is beyond the other."""
        of_vehicle, read_holder, read, read_limit, scale = self._read
        holder = context.vehicle() if of_vehicle else read_holder(context.state.peers)
        value = None if holder is None else read(holder)
        if value is None:
            return None
        limit = read_limit(context.state, context.rules)
        limit = limit / scale if scale != 1.0 else limit
        if not self.beyond(value, limit):
            return None
        unit = next(unit for end, unit in _UNITS if self.field.endswith(end))
        return Seen((Value(self.words, value, limit, unit),))

    @abc.abstractmethod
    def beyond(self, value: float, limit: float) -> bool:
        """Return True when a value is not as it should be."""


_UNITS = (("_m_s", "m/s"), ("_m", "m"), ("_s", "s"), ("_deg", "deg"), ("_fraction", "fraction"), ("", ""))


class Above(Bound):
    """A field of a status is above its limit."""

    def beyond(self, value: float, limit: float) -> bool:
        """Return True above the limit."""
        return not value <= limit


class Below(Bound):
    """A field of a status is at its limit or below it."""

    def beyond(self, value: float, limit: float) -> bool:
        """Return True at the limit and below."""
        return not value > limit


@dataclass(frozen=True)
class Says:
    """A status says so itself: `holds` returns what it looked at, else None."""

    holds: Callable[[Context], Optional[Seen]]


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
        only: field of the state that must be true, e.g. "recording.asked".
        on_ground: the engine wakes up for it before a takeoff too.
    """

    name: str
    when: Tuple[Union[Silent, Above, Below, Says], ...]
    action: Action
    words: str
    both_routes: bool = False
    alarm: bool = False
    peer: str = ""
    only: str = ""
    on_ground: bool = False
    holds: Callable[[Context], Optional[Seen]] = dataclasses.field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        alone = len(self.when) == 1 and not self.only  # most rows are, and this is asked at every event
        object.__setattr__(self, "holds", self.when[0].holds if alone else self._any_holds)

    def _any_holds(self, context: Context) -> Optional[Seen]:
        """Return what was looked at when it holds, else None."""
        if self.only and not attrgetter(self.only)(context.state):
            return None
        for condition in self.when:
            seen = condition.holds(context)
            if seen is not None:
                return seen
        return None


# --- what a status says -----------------------------------------------------------------------------------------------


def proves_recording(event: RecordingStatus) -> bool:
    """Return True when a recorder's status proves that files grow on every platform."""
    recording = event.phase is RecordingPhase.RECORDING
    return recording and bool(event.platforms) and all(platform.growing for platform in event.platforms)


def _planner_failed(context: Context) -> Optional[Seen]:
    planner = context.state.peers.planner
    if planner is None or planner.phase is not MissionPhase.FAILED:
        return None
    return Seen((Value("planner phase", "FAILED"), Value("planner says", planner.message)))


def _link_unknown(context: Context) -> Optional[Seen]:
    status = context.state.peers.autopilot
    return Seen((Value("link", "never heard"),)) if status is not None and status.link_age_s is None else None


def _battery_flag(context: Context) -> Optional[Seen]:
    """Take the autopilot's word: ArduPilot's level ignores the voltage."""
    critical = context.state.peers.autopilot is not None and context.state.peers.autopilot.battery_critical
    return because("reason", "the autopilot says that the battery is critical") if critical else None


def _does_not_record(context: Context) -> Optional[Seen]:
    recorder = context.state.peers.recorder
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
    F("watchdog_heartbeat", (Silent("heartbeat_ns", "watchdog_heartbeat_limit_ns", _SILENT, since="watchdog_started_ns"),), Action.LAND, "no heartbeat from the watchdog", peer="watchdog", on_ground=True),
    F("planner_status", (Silent("planner_ns", "planner_status_limit_ns", _SILENT),), Action.LAND, "no status from the mission planner", both_routes=True, peer="planner"),
    F("planner_idle", (Silent("planner_idle_ns", "planner_idle_limit_ns", "for", since=None),), Action.LAND, "the mission planner says that nothing is flown, and the vehicle flies", both_routes=True),
    F("landing_stalled", (Silent("landing_stalled_ns", "landing_stall_limit_ns", "for", since=None),), Action.LAND, "the mission planner says that it lands, and the vehicle stands in the air", both_routes=True),
    F("planner_failed", (Says(_planner_failed),), Action.LAND, "the mission planner failed", both_routes=True),
    F("autopilot_status", (Silent("autopilot_ns", "autopilot_status_limit_ns", _SILENT), Says(_link_unknown), Silent("link_ns", "autopilot_link_limit_ns", "link silent for", since=None)), Action.LAND, "no status from the autopilot", both_routes=True, alarm=True, peer="autopilot"),
    F("vehicle_unknown", (Silent("vehicle_unknown_ns", "vehicle_unknown_limit_ns", "for", since=None),), Action.LAND, "whether the vehicle is armed and on the ground is unknown, or it says that it is disarmed in the air", both_routes=True, alarm=True, only="flight.was_airborne"),
    F("clock", (Above("clock_stalled_s", "clock_stall_limit_ns", "standing for"),), Action.LAND, "/clock stands still", both_routes=True),
    F("battery_unknown", (Silent("battery_ns", "battery_age_limit_ns", "unknown for"),), Action.LAND, "the battery level is unknown"),
    F("battery_critical", (Below("autopilot.battery_fraction", "battery_critical_fraction", "battery fraction", fresh=False), Says(_battery_flag)), Action.LAND, "the battery is critical"),
    F("flight_time", (Silent("", "max_flight_time_ns", "flight time", ends_flight=True),), Action.LAND, "the maximum flight time is over"),
    F("height", (Above("autopilot.height_m", "max_height_m", "altitude"),), Action.LAND, "above the maximum altitude"),
    F("distance", (Above("autopilot.distance_m", "max_distance_m", "distance"),), Action.LAND, "too far from the takeoff place"),
    F("tilt", (Above("autopilot.tilt_deg", "max_tilt_deg", "tilt"),), Action.LAND, "tilted too far"),
    F("tilt_warning", (Above("autopilot.tilt_deg", "tilt_warning_deg", "tilt"),), Action.CONTINUE, "tilted further than it should be"),
    F("position_unknown", (Silent("position_ns", "position_age_limit_ns", "unknown for"),), Action.CONTINUE, "altitude, position or tilt is unknown: their limits cannot be checked"),
    F("recorder_dead", (Silent("recorder_ns", "recorder_status_limit_ns", _SILENT), Says(_does_not_record)), Action.CONTINUE, "the recorder is silent or does not record", peer="recorder", only="recording.asked"),
    F("landing_detection", (Silent("landing_ns", "landing_detection_limit_ns", _SILENT),), Action.CONTINUE, "the landing detection is silent", peer="landing detection"),
)
# fmt: on


# --- failures ---------------------------------------------------------------------------------------------------------
# What is wrong now, and what is done about each: the verbs, the waits and their budgets.
#
# A wait ends when its component is back, when its budget for this flight is spent, or when the watchdog has given up
# restarting it. Then the second action holds: `land`, or `continue` without it for the rest of the flight.


USER_HOLD = "user_hold"
_EARLIER_NS = 100_000_000  # two limits that are nearer to one another end together for a person


class Change(NamedTuple):
    """A failure that appeared, changed its action, was dropped, or is over: `rule` names which, `values` say why."""

    rule: str
    failure: Failure


def severity_of(name: str, code: Code, state: EngineState, rules: Rules) -> Severity:
    """Return a component's severity: the mission's own, else the decision table's, else the row of its code."""
    if state.session.mission is not None:
        for component, severity in state.session.mission.severities:
            if component == name:
                return severity
    for rule in rules.components:
        if rule.name == name:
            return rule.severity
    return row_of_code(code)


def listens_until_ns(state: EngineState, rules: Rules) -> int:
    """Return until when a watchdog is listened to that a start has not heard yet: no wait ends before its news."""
    started_ns, heard_ns = state.started_ns, state.peers.heartbeat_ns
    if started_ns is None or (heard_ns is not None and heard_ns > started_ns):
        return 0
    return started_ns + rules.limits.watchdog_heartbeat_limit_ns


def wait_limit_ns(name: str, rules: Rules) -> int:
    """Return the budget of waiting for a component, in nanoseconds per flight."""
    for rule in rules.components:
        if rule.name == name:
            return rule.wait_limit_ns
    return rules.limits.unlisted_wait_limit_ns


def update(context: Context) -> Tuple[Change, ...]:
    """Bring `state.failures`, the budgets and what is flown without up to date; return what changed in flight."""
    state = context.state
    old, without = state.failures, state.flight.flown_without
    bad = [status for status in state.peers.components if status.code > Code.NOMINAL]
    lost = _lost(context, old) if state.flight.active else []
    if not (bad or lost or old or state.flight.user_hold_ns is not None):
        return ()
    ledger = _Ledger(context, old)
    new = [ledger.component(status) for status in bad] + lost
    if state.flight.active:
        new += _user_hold(context)
    ledger.close(new)
    if not new and not old:
        return ()
    context.set(failures=tuple(new))
    context.put("flight", spent=tuple(sorted(ledger.spent.items())), flown_without=tuple(sorted(ledger.without)))
    return _changes(old, context.state, without) if context.state.flight.active else ()


def flown_without(context: Context) -> Tuple[str, ...]:
    """Return what a takeoff now flies without: it failed, is not required, and would not be landed for."""
    names = []
    for status in context.state.peers.components:
        severity = severity_of(status.name, status.code, context.state, context.rules)
        waits = action_of(severity, status.code) is Action.WAIT
        if waits and SEVERITIES[severity].fallback is Action.CONTINUE:
            names.append(status.name)
    return tuple(sorted(names))


def _can_wait(state: EngineState) -> bool:
    """Return True where a wait can be kept: in flight, and neither landing nor in the pilot's hands."""
    if not state.flight.active:
        return False
    return state.state in (State.TAKEOFF, State.HOLD) or (state.state is State.MISSION and state.step is Step.FLYING)


_FLOOR: Mapping[State, Action] = {State.LAND: Action.LAND, State.PILOT: Action.PILOT}
"""Where nothing is waited for any more: a failure that would be waited for is answered by what is done already."""


class _Ledger:
    """The budgets of one update."""

    def __init__(self, context: Context, old: Tuple[Failure, ...]) -> None:
        self.context = context
        self.old: Dict[str, Failure] = {failure.name: failure for failure in old}
        self.spent: Dict[str, int] = dict(context.state.flight.spent)
        self.without: List[str] = list(context.state.flight.flown_without)
        self.can_wait = _can_wait(context.state)

    def component(self, status: ComponentStatus) -> Failure:
        """Return the failure that a component's status means."""
        context, name = self.context, status.name
        severity = severity_of(name, status.code, context.state, context.rules)
        action = action_of(severity, status.code) or Action.CONTINUE
        before = self.old.get(name)
        failure = Failure(
            name=name,
            kind=FailureKind.COMPONENT,
            code=int(status.code),
            action=action,
            since_ns=before.since_ns if before is not None else context.now,
            reason=status.reason,
        )
        if action is Action.WAIT:
            return self._wait(failure, severity, status.restart)
        in_hands = action is Action.LAND and self.context.state.state is State.PILOT
        return evolve(failure, action=Action.PILOT) if in_hands else failure

    def _wait(self, failure: Failure, severity: Severity, restart: Restart) -> Failure:
        fallback = SEVERITIES[severity].fallback or Action.LAND
        if failure.name in self.without:
            return evolve(failure, action=fallback)
        if not self.can_wait:
            return evolve(failure, action=_FLOOR.get(self.context.state.state, Action.WAIT), fallback=None)
        deadline = self._deadline(failure.name)
        ends_ns = max(deadline, listens_until_ns(self.context.state, self.context.rules))
        if restart is not Restart.GIVEN_UP and self.context.now < ends_ns:
            return evolve(failure, fallback=fallback, deadline_ns=deadline)
        if fallback is Action.CONTINUE:
            self.without.append(failure.name)
        return evolve(failure, action=fallback)

    def _deadline(self, name: str) -> int:
        before = self.old.get(name)
        if before is not None and before.deadline_ns is not None:
            return before.deadline_ns
        return self.context.now + max(0, wait_limit_ns(name, self.context.rules) - self.spent.get(name, 0))

    def close(self, new: List[Failure]) -> None:
        """Write down what each wait that is over has spent of its budget."""
        still = {failure.name for failure in new if failure.deadline_ns is not None}
        for name, failure in self.old.items():
            if failure.deadline_ns is None or name in still or failure.kind is not FailureKind.COMPONENT:
                continue
            limit = wait_limit_ns(name, self.context.rules)
            self.spent[name] = min(limit, max(0, limit - (failure.deadline_ns - self.context.now)))


def _lost(context: Context, old: Tuple[Failure, ...]) -> List[Failure]:
    found, known = [], {failure.name: failure for failure in old}
    for row in FAILSAFE_CONDITIONS:
        seen = row.holds(context)
        if seen is None:
            continue
        before = known.get(row.name)
        reason = clocks_words(context, row.peer) or f"{row.words} ({_words(seen.values)})"
        since = before.since_ns if before is not None else context.now
        action = Action.PILOT if row.action is Action.LAND and context.state.state is State.PILOT else row.action
        found.append(Failure(row.name, FailureKind.LOSS, 0, action, since_ns=since, reason=reason))
    return found


def clocks_words(context: Context, peer: str) -> str:
    """Return that a peer's clock is another one, where that is why its statuses are not believed; else nothing."""
    for apart in context.state.peers.clocks_apart:
        if apart.peer == peer:
            far, side = abs(apart.age_ns) / _NS, "in the future" if apart.age_ns < 0 else "old"
            limits = context.limits
            limit = (limits.clock_tolerance_ns if apart.age_ns < 0 else limits.status_max_age_ns) / _NS
            return (
                f"stamps of the {peer} are {far:.3f} s {side} (limit {limit:g} s): old statuses, or clocks that differ"
            )
    return ""


def _words(values: Tuple[Value, ...]) -> str:
    return ", ".join(
        f"{v.name} {_said(v.value, v.unit)}"
        + (f", limit {_said(v.limit, v.unit, of_limit=True)}" if v.limit is not None else "")
        for v in values
    )


def _said(value: Any, unit: str, *, of_limit: bool = False) -> str:
    """Return a value as a person says it: a fraction in percent, anything else with its unit, which a limit shares."""
    if unit == "fraction" and isinstance(value, float):
        return f"{value * 100:.3g} %"
    return f"{value} {unit}" if unit and not of_limit else f"{value}"


def _user_hold(context: Context) -> List[Failure]:
    since = context.state.flight.user_hold_ns
    if since is None:
        return []
    deadline = since + context.limits.user_hold_limit_ns
    hold = Failure(
        USER_HOLD, FailureKind.USER, 0, Action.WAIT, Action.LAND, since, deadline, "the user asked for a hold"
    )
    if context.now < deadline:
        return [hold]
    over = f"the hold that the user asked for has lasted its {context.limits.user_hold_limit_ns / _NS:g} s"
    return [evolve(hold, action=Action.LAND, fallback=None, deadline_ns=None, reason=over)]


def _changes(old: Tuple[Failure, ...], state: EngineState, without: Tuple[str, ...]) -> Tuple[Change, ...]:
    before = {failure.name: failure for failure in old}
    changes = []
    for failure in state.failures:
        known = before.pop(failure.name, None)
        if known is not None and (known.action is failure.action or state.state in _FLOOR):
            continue
        dropped = failure.name in state.flight.flown_without and failure.name not in without
        changes.append(Change("flown_without" if dropped else f"failure_{failure.action.name.lower()}", failure))
    changes += [
        Change("failure_back", failure) for failure in old if failure.name in before and failure.name != USER_HOLD
    ]
    return tuple(changes)


def wait_end(failure: Failure, state: EngineState) -> Optional[Tuple[int, str]]:
    """Return when a wait ends at the latest, and by which limit: its budget, or the restarts, whichever is earlier."""
    if failure.deadline_ns is None:
        return None
    for status in state.peers.components:
        trying = status.name == failure.name and status.restart is Restart.TRYING
        if trying and status.until_ns is not None and status.until_ns <= failure.deadline_ns - _EARLIER_NS:
            return status.until_ns, "restart limit"
    return failure.deadline_ns, "wait limit"


_RESTARTS = {Restart.NONE: "", Restart.TRYING: ", restarting it", Restart.GIVEN_UP: ", restarting it did not help"}
_FALLBACKS = {Action.LAND: ", then landing", Action.CONTINUE: ", then flying on"}


def fault_words(failures: Sequence[Failure], state: EngineState) -> str:
    """Return what is wrong as a person is told: the cause, and behind it in brackets what was measured.

    Args:
        failures: one or more; components that fail alike are named together.
        state: with what is restarted.
    """
    said: Dict[str, List[str]] = {}
    for each in failures:
        restart = next((_RESTARTS[part.restart] for part in state.peers.components if part.name == each.name), "")
        _, named, behind = each.reason.partition(f"{each.name}: ")
        measured = f" ({behind if named and len(failures) > 1 else each.reason})" if each.reason else ""
        component = each.kind is FailureKind.COMPONENT
        words = f" fault{restart}{measured}" if component else each.reason
        said.setdefault(words, []).extend([each.name] if component else [])
    return "; ".join(and_words(names) + words for words, names in said.items())


def and_words(names: Sequence[str]) -> str:
    """Return names as one says them: "gps", "gps and imu", "gps, imu and lrf"."""
    return " and ".join([*filter(None, [", ".join(names[:-1])]), *names[-1:]])


def wait_words(failure: Failure, context: Context) -> str:
    """Return for how long it is waited for and what is done then; empty where it is not waited for."""
    end = wait_end(failure, context.state)
    if end is None:
        return ""
    fallback = _FALLBACKS.get(failure.fallback, "") if failure.fallback is not None else ""
    return f" for up to {max(0, end[0] - context.now) / _NS:.0f} s{fallback}"


def values_of(failure: Failure, context: Context) -> Tuple[Value, ...]:
    """Return what a decision about a failure looked at."""
    values = [Value("failure", failure.name), Value("code", failure.code), Value("action", failure.action.name.lower())]
    end = wait_end(failure, context.state)
    if end is not None:
        words = "waits at most" if end[1] == "wait limit" else "waits at most (restart limit)"
        values.append(Value(words, round((end[0] - context.now) / _NS, 3), None, "s"))
    if failure.reason:
        values.append(Value("reason", failure.reason))
    return tuple(values)


def waiting(state: EngineState) -> Tuple[Failure, ...]:
    """Return the failures that are waited for."""
    return tuple(failure for failure in state.failures if failure.action is Action.WAIT)


def worst(state: EngineState) -> Tuple[Failure, ...]:
    """Return the failures that mean to land."""
    return tuple(failure for failure in state.failures if failure.action is Action.LAND)
