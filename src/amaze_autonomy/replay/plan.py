"""What a replay is made of: the configuration's rules, the map's recording, and the mission, brought together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Dict, FrozenSet, List, Mapping, Optional, Tuple

from amaze_autonomy.config.model import Configuration
from amaze_autonomy.config.schemas.autonomy import Streams
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.monitoring.errors import SpecError
from amaze_autonomy.monitoring.specs import (
    AutopilotSensor,
    BatterySpec,
    ComponentSpec,
    EstimateSource,
    LandingSpec,
    RestartPolicy,
    RestartSpec,
    StateEstimationSpec,
    TopicSpec,
)

from ..engine.events import Mission
from ..engine.rules import ComponentRule, Severity
from .errors import ReplayError
from .maps.topic_map import ComponentMap, TopicMap


@dataclass(frozen=True)
class Plan:
    """Everything that a replay needs besides the recording.

    Args:
        topic_map: of the recording.
        rules: of the engine, with a row for each component of the map.
        mission: with the required components that the recording has; all of them when it has no required one.
        components: that are watched.
        landing: None when the recording has no range.
        state_estimation: None when it has neither IMU nor estimate.
        battery: None when it has no battery.
        takeoff_height_m: of the rules.
        configuration: the effective one, for the journal's header.
        configuration_hash: of it.
        judged: nodes whose judgement is made anew from the recording's sensors, though it holds what they said:
            "watchdog", "landing_detection"; what they said is compared.
        streams: how often each scripted peer sends its status.
        elsewhere: components that the mission requires and that cannot be watched, as the recording lacks a topic of
            theirs: a recorded watchdog's word counts for them. Each with the topics that are missing; none: all are.
        contents: topics whose content or stamps the configuration has judged: a replay judges their rate alone.
    """

    topic_map: TopicMap
    rules: Rules
    mission: Mission
    components: Tuple[ComponentSpec, ...]
    landing: Optional[LandingSpec]
    state_estimation: Optional[StateEstimationSpec]
    battery: Optional[BatterySpec]
    configuration: Mapping[str, Any]
    configuration_hash: str
    judged: FrozenSet[str] = frozenset()
    streams: Streams = field(default_factory=Streams)
    elsewhere: Mapping[str, Tuple[str, ...]] = field(default_factory=dict)
    contents: Tuple[str, ...] = ()

    @property
    def unseen(self) -> Mapping[str, Tuple[str, ...]]:
        """Those of `elsewhere` that a map of what is configured lacks: nobody sees them fail, which is said."""
        return self.elsewhere if self.topic_map.as_configured else {}

    @property
    def component_topics(self) -> Tuple[str, ...]:
        """Topics of all components, each once."""
        return tuple(dict.fromkeys(topic.topic for spec in self.components for topic in spec.topics))

    @property
    def topics(self) -> Tuple[str, ...]:
        """Every topic that is read, each once; its place is its rank among equal times."""
        return tuple(dict.fromkeys((*self.component_topics, *self.topic_map.topics)))


def make_plan(configuration: Configuration, topic_map: TopicMap, mission_id: str, recorded: Tuple[str, ...]) -> Plan:
    """Bring configuration, map and mission together.

    Args:
        configuration: the rules to decide by.
        topic_map: of the recording.
        mission_id: of the configuration.
        recorded: topics that are in the recording.

    Raises:
        ReplayError: The mission does not exist, or the map asks for a specification that cannot be.
    """
    topic_map = topic_map.of(recorded)
    known = {spec.name: spec for spec in configuration.components}
    health = topic_map.statuses.get("autopilot") in recorded
    left: List[ComponentSpec] = []
    try:
        components = tuple(_component(each, known, configuration.rules) for each in topic_map.components)
        if topic_map.as_configured:
            taken = [spec.name for spec in components]
            left += (spec for spec in known.values() if spec.name not in taken and _has(spec, recorded))
            components += tuple(_as_recorded(spec, health=health) for spec in left)
        return Plan(
            topic_map=topic_map,
            rules=_rules(configuration.rules, components),
            mission=_mission(configuration, mission_id, components),
            components=components,
            landing=_landing(configuration.landing, topic_map),
            state_estimation=_state_estimation(configuration.state_estimation, topic_map),
            battery=_battery(configuration.battery, topic_map),
            configuration=configuration.effective,
            configuration_hash=configuration.hash,
            judged=_judged(topic_map, components, recorded),
            streams=configuration.streams,
            elsewhere=_elsewhere(configuration, mission_id, components, recorded),
            contents=tuple(topic.topic for spec in left for topic in spec.topics if topic != _by_its_rate(topic)),
        )
    except SpecError as error:
        raise ReplayError(f"map {topic_map.name}: {error}") from error


def _component(given: ComponentMap, known: Mapping[str, ComponentSpec], rules: Rules) -> ComponentSpec:
    """Return what is watched: the recording's topic, the configuration's severity and limits."""
    base = known.get(given.name)
    severity = base.severity if base is not None else Severity.MODERATE
    wait_ns = base.wait_limit_ns if base is not None else rules.limits.unlisted_wait_limit_ns
    return ComponentSpec(
        name=given.name,
        group=given.group or (base.group if base is not None else "other"),
        severity=Severity(given.severity) if given.severity else severity,
        topics=(given.topic,),
        wait_limit_ns=given.wait_limit_ns if given.wait_limit_ns is not None else wait_ns,
        required=given.required,
        autopilot=None if given.autopilot is None else AutopilotSensor(given.autopilot),
        restart=_scripted(base.restart) if base is not None else RestartSpec(),
    )


def _has(spec: ComponentSpec, recorded: Tuple[str, ...]) -> bool:
    return bool(spec.topics) and all(topic.topic in recorded for topic in spec.topics)


def _as_recorded(spec: ComponentSpec, *, health: bool) -> ComponentSpec:
    """Return a component by its topics, and by what a recorded autopilot says of it: no node and no driver is asked.

    Whether it is required is up to the mission alone: no map says otherwise.
    """
    return replace(
        spec,
        topics=tuple(map(_by_its_rate, spec.topics)),
        node=None,
        driver=(),
        autopilot=spec.autopilot if health else None,
        required=True,
        restart=_scripted(spec.restart),
    )


def _by_its_rate(topic: TopicSpec) -> TopicSpec:
    """Return a topic of which only that it comes is judged: its messages are counted, not read."""
    return replace(topic, finite=False, unchanged_limit_ns=None, stamp_tolerance_ns=None)


def _judged(topic_map: TopicMap, components: Tuple[ComponentSpec, ...], recorded: Tuple[str, ...]) -> FrozenSet[str]:
    """Return the nodes whose judgement is made anew: those whose sensors are in the recording."""
    watched = any(topic.topic in recorded for spec in components for topic in spec.topics)
    reading = topic_map.readings.get("range")
    found = {"watchdog": watched, "landing_detection": reading is not None and reading.topic in recorded}
    if topic_map.statuses_decide:
        told = {"watchdog": "watchdog_info", "landing_detection": "landing_detection"}
        found = {name: good and topic_map.statuses.get(told[name]) not in recorded for name, good in found.items()}
    return frozenset(name for name, good in found.items() if good)


def _elsewhere(
    configuration: Configuration, mission_id: str, components: Tuple[ComponentSpec, ...], recorded: Tuple[str, ...]
) -> Dict[str, Tuple[str, ...]]:
    mission = next(each for each in configuration.missions if each.id == mission_id)
    here = [spec.name for spec in components]
    left = {spec.name: spec for spec in configuration.components if spec.name not in here}
    needed = [name for name in left if not mission.required or name in mission.required]
    return {name: _missing(left[name], recorded) for name in needed}


def _missing(spec: ComponentSpec, recorded: Tuple[str, ...]) -> Tuple[str, ...]:
    """Return the topics of a component that are not recorded while others of it are."""
    missing = tuple(topic.topic for topic in spec.topics if topic.topic not in recorded)
    return missing if len(missing) < len(spec.topics) else ()


def recorded_words(missing: Tuple[str, ...]) -> str:
    """Return how a component that is not watched is recorded: not at all, or without some of its topics."""
    return f"in the recording without {' and '.join(missing)}" if missing else "not in the recording"


def _scripted(restart: RestartSpec) -> RestartSpec:
    """Return a restart with the same limits that the script carries out; what comes of it is in the recording."""
    if restart.policy is RestartPolicy.NEVER:
        return restart
    return replace(restart, policy=RestartPolicy.COMMAND, command=("script",))


def _rules(rules: Rules, components: Tuple[ComponentSpec, ...]) -> Rules:
    rows: Dict[str, ComponentRule] = {row.name: row for row in rules.components}
    for spec in components:
        restart = spec.restart.policy is not RestartPolicy.NEVER
        rows[spec.name] = ComponentRule(spec.name, spec.group, restart, spec.severity, spec.wait_limit_ns)
    return replace(rules, components=tuple(rows.values()))


def _mission(configuration: Configuration, mission_id: str, components: Tuple[ComponentSpec, ...]) -> Mission:
    missions = {mission.id: mission for mission in configuration.missions}
    if mission_id not in missions:
        raise ReplayError(f"there is no mission {mission_id!r}; there are {', '.join(missions)}")
    mission = missions[mission_id]
    names = [spec.name for spec in components]
    return replace(
        mission,
        severities=tuple((name, severity) for name, severity in mission.severities if name in names),
        required=_required(configuration, mission, components),
        tolerated=tuple(name for name in mission.tolerated if name in names),
    )


def _required(configuration: Configuration, mission: Mission, components: Tuple[ComponentSpec, ...]) -> Tuple[str, ...]:
    """Return what the mission requires of what is watched, unless the map says otherwise.

    Of a component that is not configured no mission says anything: there the map alone counts.
    """
    known = [spec.name for spec in configuration.components]
    needed = tuple(spec.name for spec in components if spec.required)
    own = mission.required or known
    return tuple(name for name in needed if name in own or name not in known) or needed


def _landing(spec: LandingSpec, topic_map: TopicMap) -> Optional[LandingSpec]:
    reading = topic_map.readings.get("range")
    if reading is None:
        return None
    return replace(spec, topic=reading.topic, scale=reading.scale, **topic_map.landing)


def _state_estimation(spec: StateEstimationSpec, topic_map: TopicMap) -> Optional[StateEstimationSpec]:
    imu, estimate = topic_map.readings.get("imu"), topic_map.readings.get("estimate")
    if imu is None and estimate is None:
        return None
    return replace(
        spec,
        topic=estimate.topic if estimate is not None else "",
        source=EstimateSource(estimate.source) if estimate is not None else spec.source,
        imu_topic=imu.topic if imu is not None else "",
        **topic_map.state_estimation,
    )


def _battery(spec: BatterySpec, topic_map: TopicMap) -> Optional[BatterySpec]:
    reading = topic_map.readings.get("battery")
    if reading is None:
        return None
    return spec if "voltage" in reading.fields else replace(spec, cells=0)
