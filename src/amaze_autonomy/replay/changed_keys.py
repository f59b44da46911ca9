"""Which changed keys of the configuration a replay looked at, and why it did not look at the others.

A key that nothing looked at proves nothing: a replay with it and one without it are the same, whatever it says. So each
changed key is followed to what it changes of the plan, and from there to data of the recording:

* a key that changes nothing of the plan is not read by a replay, or the topic map says it instead;
* of a monitor (watchdog, landing detection, check of the states, battery), its topics must be in the recording, and it
  must have judged by them;
* of the engine, a decision must have asked for it, and what it limits must be told by the recording, not by the script.

Without a recording a decision must have asked for it, or the simulated flight must be another one without it. A folder
is followed by the keys in which it differs from another one.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import (
    Any,
    Callable,
    Collection,
    Dict,
    FrozenSet,
    Iterable,
    List,
    Mapping,
    Optional,
    Sequence,
    Set,
    Tuple,
    Union,
)

from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.failsafe import FAILSAFE_CONDITIONS, Bound, FailsafeCondition, Silent
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.monitoring.specs import RangeSource

from .plan import Plan
from .recordings.sources import Recordings

Part = Tuple[str, ...]
"""A piece of a plan: ("limit", "takeoff_height_m"), ("component", "gps"), ("row", "gps", "severity")."""

_CHECKS = ("checks",)
_VEHICLE = ("armed", "landed")
_MOTION = ("armed", "landed", "height", "mode")

LIMIT_FACTS: Mapping[str, Tuple[str, ...]] = {
    "check_reply_limit_ns": _CHECKS,
    "watchdog_startup_time_ns": ("watchdog",),
    "preflight_fix_limit_ns": ("watchdog",),
    "preflight_fix_poll_ns": ("watchdog",),
    "preflight_rounds_limit": _CHECKS,
    "check_max_age_ns": _CHECKS,
    "ready_limit_ns": _CHECKS,
    "recording_lead_ns": ("recorder",),
    "recording_start_limit_ns": ("recorder",),
    "load_limit_ns": ("planner",),
    "arm_limit_ns": _VEHICLE,
    "lift_off_limit_ns": _VEHICLE,
    "takeoff_limit_ns": ("landed", "height"),
    "takeoff_height_m": ("height",),
    "cancel_limit_ns": _VEHICLE,
    "command_reply_limit_ns": ("log",),
    "hold_confirm_limit_ns": ("planner", "mode"),
    "hold_repeat_after_ns": ("planner", "mode"),
    "hold_speed_m_s": ("speed",),
    "hold_speed_age_limit_ns": ("speed",),
    "resume_confirm_limit_ns": ("planner", "mode"),
    "user_hold_limit_ns": ("log",),
    "unlisted_wait_limit_ns": ("watchdog",),
    "land_repeat_period_ns": _MOTION,
    "land_second_route_after_ns": _MOTION,
    "land_alarm_after_ns": _MOTION,
    "land_limit_ns": _VEHICLE,
    "descent_speed_m_s": ("height",),
    "descent_time_ns": ("height",),
    "landing_height_m": ("height",),
    "ground_disarm_after_ns": _VEHICLE,
    "ground_disarm_period_ns": _VEHICLE,
    "flight_end_confirm_ns": _VEHICLE,
    "confirm_limit_ns": ("landing_detection",),
    "pilot_confirm_ns": ("armed", "mode"),
    "pilot_silence_limit_ns": ("link",),
    "vehicle_unknown_limit_ns": _VEHICLE,
    "data_cleanup_limit_ns": ("recorder",),
    "watchdog_heartbeat_limit_ns": ("watchdog",),
    "planner_status_limit_ns": ("planner",),
    "planner_idle_limit_ns": ("planner",),
    "landing_stall_limit_ns": ("planner",),
    "autopilot_status_limit_ns": ("link",),
    "autopilot_link_limit_ns": ("link",),
    "position_age_limit_ns": ("height", "position"),
    "recorder_status_limit_ns": ("recorder",),
    "landing_detection_limit_ns": ("landing_detection",),
    "status_max_age_ns": ("stamps",),
    "clock_tolerance_ns": ("stamps",),
    "clock_stall_limit_ns": (),
    "battery_age_limit_ns": ("battery",),
    "battery_critical_fraction": ("battery",),
    "battery_reserve_fraction": ("battery",),
    "max_flight_time_ns": _VEHICLE,
    "max_height_m": ("height",),
    "max_distance_m": ("position",),
}
"""For each limit of the engine the facts that it limits: one of them must be recorded. The limit of a field that only
the status itself tells needs no row here: `facts_of` takes the status."""

MISSION_FACTS: Mapping[str, Tuple[str, ...]] = {
    "files": ("planner",),
    "repetitions": ("planner",),
    "battery_needed_fraction": ("battery",),
    "severities": ("watchdog",),
    "required": ("watchdog",),
    "tolerated": ("watchdog",),
    "set_points": ("mode",),
    **{each.name: LIMIT_FACTS[each.name] for each in fields(Mission) if each.name in LIMIT_FACTS},
}
"""Likewise for what the engine knows of a mission; what is not here decides nothing."""


RULE_FACTS: Mapping[str, Tuple[str, ...]] = {"require_go": ("log",)}
"""Likewise for what is no limit; what is not here is of the checks."""


SAID_FACTS: Mapping[str, Tuple[str, ...]] = {"planner_failed": ("planner",)}
"""Likewise for a loss that a status says itself, without a limit."""

PEER_FACTS: Mapping[str, Tuple[str, ...]] = {
    "autopilot": (
        *("autopilot", "armed", "landed", "height", "position", "speed", "mode", "battery", "link"),
        "stamps",
    ),
    "mission_planner": ("planner", "stamps"),
    "data_recorder": ("recorder", "stamps"),
    "landing_detection": ("landing_detection", "stamps"),
    "watchdog": ("watchdog",),
}
"""For each peer the facts that its status tells."""


def blind_losses(facts: FrozenSet[str]) -> Dict[str, str]:
    """Return the losses that nothing in a replay can show, and why: what they look at is scripted.

    Args:
        facts: that the recording tells (`recorded_facts`), or that a fault of a scripted peer changes.
    """
    needed = {
        row.name: (*SAID_FACTS.get(row.name, ()), *(fact for limit in _limits(row) for fact in facts_of(limit)))
        for row in FAILSAFE_CONDITIONS
    }
    reasons = {name: _told(tuple(dict.fromkeys(those)), facts) for name, those in needed.items()}
    return {name: reason for name, reason in reasons.items() if reason}


def _limits(row: FailsafeCondition) -> Tuple[str, ...]:
    return tuple(when.limit for when in row.when if isinstance(when, (Silent, Bound)))


def facts_of(limit: str) -> Tuple[str, ...]:
    """Return the facts that a limit of the engine limits."""
    conditions = [when for row in FAILSAFE_CONDITIONS for when in row.when if isinstance(when, Bound)]
    told = {when.field.partition(".")[0] for when in conditions if when.limit == limit}
    return LIMIT_FACTS.get(limit, tuple(sorted(told)))


@dataclass(frozen=True)
class Unread:
    """A changed key that nothing looked at.

    Args:
        key: as it was given, e.g. "sensors.components.gps.severity".
        reason: why not.
    """

    key: str
    reason: str

    def __str__(self) -> str:
        return f"{self.key} was not looked at: {self.reason}"


@dataclass(frozen=True)
class Change:
    """A key, and what of the plan it changes.

    Args:
        key: as it was given.
        parts: of the plan; empty: none.
    """

    key: str
    parts: Tuple[Part, ...]


def changes_of(
    overrides: Sequence[str], load: Callable[[Sequence[str]], Configuration], plan_of: Callable[[Configuration], Plan]
) -> Tuple[Change, ...]:
    """Return what each override changes; one that says what is configured anyway changes nothing and is left out.

    Args:
        overrides: "file.key=value", on top of each other.
        load: a configuration with some of them.
        plan_of: a configuration.
    """
    if not overrides:
        return ()
    plan = plan_of(load(overrides))
    return tuple(
        Change(key, tuple(_differences(plan, plan_of(without)))) for key, without in _without_each(overrides, load)
    )


def keys_of(folder: Union[str, Path], given: Sequence[str], before: Union[str, Path]) -> Optional[Tuple[str, ...]]:
    """Return the overrides that make of one folder's configuration that of another one, with some on top of it.

    Args:
        folder: of the other one.
        given: "file.key=value", on top of it.
        before: the one folder.

    Returns:
        None: no keys can say it, as it has other components, missions or waypoint files.

    Raises:
        ConfigError: the other one has a mistake.
    """
    other = load_configuration(folder, given)
    try:
        keys = (*given, *_value_differences("", load_configuration(before, given).effective, other.effective))
        return keys if load_configuration(before, keys).hash == other.hash else None
    except ConfigError:  # what it lacks, or has besides
        return None


def _value_differences(address: str, one: Any, other: Any) -> Iterable[str]:
    """Return overrides that make other values of some."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for name in sorted({*one, *other}):
            yield from _value_differences(f"{address}.{name}" if address else name, one.get(name), other.get(name))
    elif one != other:
        yield f"{address}={written(other)}"


def written(value: Any) -> str:
    """Return a plain value as YAML."""
    if isinstance(value, list):
        return f"[{', '.join(written(each) for each in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return "null" if value is None else repr(value)


def _without_each(
    overrides: Sequence[str], load: Callable[[Sequence[str]], Configuration]
) -> Iterable[Tuple[str, Configuration]]:
    """Return each key that says something else than is configured, with the configuration without it."""
    whole = load(overrides)
    for number, text in enumerate(overrides):
        try:
            without = load([*overrides[:number], *overrides[number + 1 :]])
        except ConfigError:  # keys that can only be changed together
            without = load(())
        if without.hash != whole.hash:
            yield text.partition("=")[0].strip(), without


class DecidedKeys:
    """Follows changed keys through what is decided without a recording: events, a journal, a simulated flight.

    Args:
        overrides: "file.key=value", on top of each other; empty: nothing is followed.
        load: a configuration with some of them.
    """

    def __init__(self, overrides: Sequence[str], load: Callable[[Sequence[str]], Configuration]) -> None:
        self._asked: Set[Part] = set()
        self._keys: List[Tuple[str, Configuration, Tuple[Part, ...]]] = []
        if overrides:
            rules = load(overrides).rules
            self._keys = [
                (key, without, tuple(_rule_differences(rules, without.rules)))
                for key, without in _without_each(overrides, load)
            ]

    def followed(self, rules: Rules) -> Rules:
        """Return rules that note which of the changed values are asked for; what was asked before stays noted."""
        before = frozenset(self._asked)
        rules = _followed(rules, {part for _, _, parts in self._keys for part in parts}, self._asked)
        self._asked |= before
        return rules

    def unread(
        self, reason: Callable[[Configuration, Sequence[Part]], str], *, codes_recorded: bool = False
    ) -> Tuple[Unread, ...]:
        """Return the keys that nothing looked at.

        Args:
            reason: why not, by the configuration without the key, and the parts of the engine's rules that the key
                changes; empty: something besides the engine looked at it.
            codes_recorded: the watchdog's codes are not made anew, so that nothing shows what a severity does.
        """
        silent = (
            (key, reason(without, parts))
            for key, without, parts in self._keys
            if not self._is_asked(parts, codes_recorded=codes_recorded)
        )
        return tuple(Unread(key, words) for key, words in silent if words)

    def _is_asked(self, parts: Sequence[Part], *, codes_recorded: bool) -> bool:
        """Return whether a decision asked for one of some rules; severities are told to the watchdog before takeoff."""
        severities, others = _parted(parts)
        return bool(severities and not codes_recorded) or any(part in self._asked for part in others)


def unread_in_journal(_: Configuration, parts: Sequence[Part]) -> str:
    """Return why nothing that was decided again looked at a key."""
    severities, others = _parted(parts)
    if others:
        return "no decision asked for it"
    if severities:
        return "the codes in a journal are those that its watchdog gave by the severity of then"
    return "a journal holds what the nodes said, so the engine's rules alone decide"


def _parted(parts: Sequence[Part]) -> Tuple[List[Part], List[Part]]:
    """Return those of some parts that are severities, and the others."""
    return (
        [part for part in parts if part[2:] == ("severity",)],
        [part for part in parts if part[2:] != ("severity",)],
    )


class ChangedKeys:
    """Follows changed keys through a replay.

    Args:
        plan: of the replay, with all of them.
        changes: by `changes_of`; empty: nothing is followed, and nothing costs time.
    """

    def __init__(self, plan: Plan, changes: Sequence[Change] = ()) -> None:
        self._changes = tuple(changes)
        self._asked: Set[Part] = set()
        self._watched = False
        self._failed: FrozenSet[str] = frozenset()
        self.rules = _followed(plan.rules, {part for change in changes for part in change.parts}, self._asked)

    def unread(
        self, plan: Plan, recordings: Recordings, facts: FrozenSet[str], *, watched: bool, failed: Collection[str]
    ) -> Tuple[Unread, ...]:
        """Return the keys that nothing looked at.

        Args:
            plan: of the replay.
            recordings: open.
            facts: that the recording tells (`recorded_facts`).
            watched: the watchdog was started.
            failed: components that were not as intended at some time.
        """
        self._watched, self._failed = watched, frozenset(failed)
        heard = frozenset(topic for rank, topic in enumerate(recordings.topics) if len(recordings.times(rank)))
        found: List[Unread] = []
        for change in self._changes:
            reasons = [self._reason(part, plan, heard, facts) for part in change.parts]
            if all(reason is not None for reason in reasons):
                nothing = f"a replay by the map {plan.topic_map.name} does not read it"
                found.append(Unread(change.key, next((each for each in reasons if each), nothing)))
        return tuple(found)

    def _reason(self, part: Part, plan: Plan, heard: FrozenSet[str], facts: FrozenSet[str]) -> Optional[str]:
        """Return why nothing looked at a part of the plan; None: something did."""
        kind, name = part[0], part[1]
        if kind in ("limit", "rule"):
            return self._engine_reason(
                part, facts_of(name) if kind == "limit" else RULE_FACTS.get(name, _CHECKS), facts
            )
        if kind == "stream":
            return "it is how often the script speaks, no data of the recording"
        if kind == "mission":
            return _told(MISSION_FACTS.get(name, ()), facts) if name in MISSION_FACTS else "it decides nothing"
        if kind in ("row", "component", "restart"):
            return self._component_reason(part, plan, heard)
        return _monitor_reason(kind, name, plan, heard)

    def _engine_reason(self, part: Part, needed: Tuple[str, ...], facts: FrozenSet[str]) -> Optional[str]:
        if part not in self._asked:
            return "no decision asked for it"
        return _told(needed, facts)

    def _component_reason(self, part: Part, plan: Plan, heard: FrozenSet[str]) -> Optional[str]:
        kind, name = part[0], part[1]
        specs = [spec for spec in plan.components if spec.name == name]
        if not specs:
            return f"the recording has no topic of {name}"
        topics = [topic.topic for topic in specs[0].topics]
        if "watchdog" not in plan.judged and "watchdog_info" in plan.topic_map.statuses:
            return "the map takes what the recorded watchdog said"
        if topics and not any(topic in heard for topic in topics) and specs[0].autopilot is None:
            return f"the recording has no message of {' and '.join(topics)}"
        if kind == "restart" and name not in self._failed:
            return f"{name} never failed"
        if kind == "row" and part not in self._asked and (part[2] != "severity" or not self._watched):
            return f"no decision asked for it: {name} never failed"
        return None if self._watched else "the watchdog was never started"


def recorded_facts(plan: Plan, recordings: Recordings, *, log: bool) -> FrozenSet[str]:
    """Return what the recording tells: facts of the vehicle, nodes that speak, the user's log."""
    heard = {topic for rank, topic in enumerate(recordings.topics) if len(recordings.times(rank))}
    found = {name for name, reading in plan.topic_map.readings.items() if reading.topic in heard}
    told = {name for name, topic in plan.topic_map.statuses.items() if topic in heard}
    facts = found & {"armed", "landed", "height", "battery", "mode", "failsafe"}
    if "range" in found:
        facts |= {"height", "landed", "landing_detection"}
    if "height" in found:
        facts.add("landed")
    facts |= {fact for name in told for fact in PEER_FACTS.get(name, ())}
    watched = any(topic.topic in heard for spec in plan.components for topic in spec.topics)
    if watched or "watchdog_info" in told or "watchdog_action" in told:
        facts.add("watchdog")
    if watched or found & {"range", "imu", "estimate", "battery"} or told:
        facts.add("checks")
    return frozenset(facts | ({"log"} if log else set()))


_WORDS = {"log": "what the user asked and how peers answered", "link": "the autopilot's link", "stamps": "stamps"}


def _told(needed: Tuple[str, ...], facts: FrozenSet[str]) -> Optional[str]:
    if not needed:
        return "nothing in a replay tells it"
    if facts & set(needed):
        return None
    words = " and ".join(_WORDS.get(each, each.replace("_", " ")) for each in needed)
    return f"{words}: scripted, not recorded"


_READINGS = {"landing": ("range",), "state_estimation": ("imu", "estimate"), "battery": ("battery",)}
_OF_IMU = ("imu_mounting_rpy_rad", "window_ns", "min_samples", "gravity_m_s2", "gravity_tolerance_m_s2")
_OF_ESTIMATE = (
    *("rate_hz", "tolerance_fraction", "position_limit_m", "position_deviation_limit_m"),
    *("orientation_deviation_limit_rad", "require_covariance", "quaternion_tolerance", "still_drift_m"),
    "speed_limit_m_s",
)


def _monitor_reason(kind: str, name: str, plan: Plan, heard: FrozenSet[str]) -> Optional[str]:
    wanted = _READINGS[kind]
    if kind == "state_estimation":
        wanted = ("imu",) if name in _OF_IMU else ("estimate",) if name in _OF_ESTIMATE else wanted
    if kind == "landing" and "landing_detection" not in plan.judged and "landing_detection" in plan.topic_map.statuses:
        return "the map takes what the recorded landing detection said"
    if kind == "landing" and name == "max_vertical_speed_m_s":
        return "the landing detection of a replay has the range alone, no vertical speed"
    readings = plan.topic_map.readings
    of_tilt = name in ("tilt_correction", "max_tilt_rad")
    if of_tilt and plan.landing is not None and plan.landing.source is RangeSource.POSE:
        return "a height (source: pose) is not corrected by the tilt"
    if of_tilt and "orientation" not in _fields_of(plan, "imu"):
        return "the map names no orientation"
    if "cell" in name and "voltage" not in _fields_of(plan, "battery"):
        return "the map names no voltage"
    if any(each in readings and readings[each].topic in heard for each in wanted):
        return None
    return f"the recording has no {' or '.join(wanted)} by the map {plan.topic_map.name}"


def _fields_of(plan: Plan, reading: str) -> Mapping[str, str]:
    found = plan.topic_map.readings.get(reading)
    return {} if found is None else found.fields


# --- differences of plans ---------------------------------------------------------------------------------------------


def _differences(plan: Plan, other: Plan) -> Iterable[Part]:
    """Return the parts in which two plans differ, in a fixed order."""
    yield from _rule_differences(plan.rules, other.rules)
    yield from _component_differences(plan, other)
    for kind in _READINGS:
        one, two = getattr(plan, kind), getattr(other, kind)
        yield from ((kind, field) for field in _different(one, two))
    yield from (("mission", field) for field in _different(plan.mission, other.mission))
    yield from (("stream", field) for field in _different(plan.streams, other.streams))


def _rule_differences(rules: Rules, other: Rules) -> Iterable[Part]:
    for field in _different(rules.limits, other.limits):
        yield ("limit", field)
    yield from (("rule", field) for field in _different(rules, other) if field not in ("limits", "components"))
    rows, others = ({row.name: row for row in each.components} for each in (rules, other))
    for name in rows:
        if name not in others:
            yield ("row", name, "severity")
        else:
            yield from (("row", name, field) for field in _different(rows[name], others[name]))


def _component_differences(plan: Plan, other: Plan) -> Iterable[Part]:
    others = {spec.name: spec for spec in other.components}
    for spec in plan.components:
        before = others.get(spec.name)
        if before is None:
            yield ("component", spec.name)
            continue
        for field in _different(spec, before):
            if field == "restart":
                yield ("restart", spec.name)
            elif field not in ("severity", "wait_limit_ns", "group"):  # these are the row's
                yield ("component", spec.name)


def _different(one: Any, other: Any) -> List[str]:
    if one is None or other is None:
        return []
    return [each.name for each in fields(one) if getattr(one, each.name) != getattr(other, each.name)]


# --- noting -----------------------------------------------------------------------------------------------------------


def _followed(rules: Rules, parts: Collection[Part], asked: Set[Part]) -> Rules:
    """Return rules that note which of the changed values are asked for."""
    limits = [part[1] for part in parts if part[0] == "limit"]
    changed: Dict[str, Any] = {}
    if limits:
        changed["limits"] = _noted(rules.limits, {name: ("limit", name) for name in limits}, asked)
    rows = {part[1] for part in parts if part[0] == "row"}
    if rows:
        changed["components"] = tuple(
            _noted(row, {p[2]: p for p in parts if p[:2] == ("row", row.name)}, asked) if row.name in rows else row
            for row in rules.components
        )
    followed = replace(rules, **changed) if changed else rules
    own = {part[1]: part for part in parts if part[0] == "rule"}
    followed = _noted(followed, own, asked) if own else followed
    asked.clear()
    return followed


def _noted(value: Any, parts: Mapping[str, Part], asked: Set[Part]) -> Any:
    """Return a frozen value that notes when some of its fields are asked for."""
    body = {name: _noting(name, part, asked) for name, part in parts.items()}
    kind = type(type(value).__name__, (type(value),), body)
    noted: Any = object.__new__(kind)
    noted.__dict__.update(vars(value))
    return noted


def _noting(name: str, part: Part, asked: Set[Part]) -> property:
    def get(self: Any) -> Any:
        asked.add(part)
        return self.__dict__[name]

    def put(self: Any, value: Any) -> None:
        self.__dict__[name] = value

    return property(get, put)
