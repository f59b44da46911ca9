"""What is wrong between a configuration, the graph that runs and this computer; and the lines that would put it right.

`examine` is pure: a configuration and a `Graph` in, findings out. `wanted` is the table of the names that the nodes of
an arrangement ask, read and send: ours, those of the CNS Flight Stack, of mavros, of an estimator. `examine_host` looks
at this computer: storage, ssh to the other platforms, what roslaunch was given, time. What runs is looked at by
`ros/graph.py`.
"""

from __future__ import annotations

import difflib
import enum
import re
import shutil
import subprocess
from contextlib import suppress
from dataclasses import dataclass, field
from math import ceil
from pathlib import Path
from typing import Dict, FrozenSet, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

from .autopilot.mavros.messages import STATE, sources_of
from .autopilot.mavros.requests import MISSION_SERVICES
from .autopilot.mavros.requests import SERVICES as MAVROS_SERVICES
from .cns import tables as cns
from .config import Configuration
from .interface import SERVICES, STATUSES
from .missions import Frame
from .monitoring.initialisation import InitialisationType
from .monitoring.specs import ComponentSpec, EstimateSource, RangeSource, RestartPolicy, TopicSpec
from .paths import config_folder, expanded
from .recording.storage import needed_bytes, space_of, too_little

GOOD, WARNING, WRONG = "good", "warning", "wrong"
_S = 1_000_000_000
_OFFSET_S, _AHEAD_S = 0.5, 0.05  # of stamps on arrival: old by a clock or a driver; from the future by a clock
_RUN_S = 8.0
_CLOCK_S = 0.05  # off from the time server
_IMU = "sensor_msgs/Imu"
_OF_EVERYBODY = ("std_srvs", "mavros_msgs")  # types that do not tell a peer; mavros elsewhere is a key, no remap
_ARGUMENT = re.compile(r'<arg name="([a-z]\w*)"')
_ONE_OF_THEM = "stop or rename one of them"
_RANGE_TYPES: Mapping[RangeSource, str] = {
    RangeSource.RANGE: "sensor_msgs/Range",
    RangeSource.SCAN: "sensor_msgs/LaserScan",
    RangeSource.FLOAT: "std_msgs/Float32",
    RangeSource.POSE: "geometry_msgs/PoseStamped",
}
_ESTIMATE_TYPES: Mapping[EstimateSource, str] = {
    EstimateSource.ODOMETRY: "nav_msgs/Odometry",
    EstimateSource.POSE: "geometry_msgs/PoseStamped",
    EstimateSource.POSE_WITH_COVARIANCE: "geometry_msgs/PoseWithCovarianceStamped",
}


@dataclass(frozen=True)
class SeenTopic:
    """A topic that is published.

    Args:
        kinds: types of its messages; of a silent one the type that the master knows.
        nodes: its publishers.
        count: messages that were heard.
        rate_hz: of them; None: fewer than two.
        age_s: of their stamps on arrival, the median; None: they have none.
        md5s: of its types, as its publishers say; empty: none said it.
        kinds_of: its publishers, each with the type of its messages, as far as they said it.
        unstamped: its messages have a header, and most of them a stamp of 0.
    """

    kinds: Tuple[str, ...]
    nodes: Tuple[str, ...]
    count: int = 0
    rate_hz: Optional[float] = None
    age_s: Optional[float] = None
    md5s: Tuple[str, ...] = ()
    kinds_of: Tuple[Tuple[str, str], ...] = ()
    unstamped: bool = False


@dataclass(frozen=True)
class SeenService:
    """A service that is offered; without an md5 sum where its node did not say it."""

    name: str
    kind: str
    node: str
    md5: str = ""


@dataclass(frozen=True)
class Graph:
    """What runs.

    Args:
        topics: that somebody publishes, by their names.
        services: of the wanted ones that are offered, by their names in the code.
        nodes: names of all that answer.
        gone: names of those on the master's list that do not.
        namespace: in which our names are resolved, with a slash at its end.
        master_host: where the master is.
        named: others can reach this computer: ROS_IP or ROS_HOSTNAME is set, or the master is here.
        listeners: nodes that listen to a topic, by its name.
        offered: names of all services.
        md5s: of types as they are on this computer, of those that were seen and are here.
        listened_s: for so long was listened to each topic.
        remapped: names that are others than in the code, as they are in the graph without a remap and with it.
        others: services that are offered and are none of the wanted; looked at where a wanted one is not offered.
    """

    topics: Mapping[str, SeenTopic]
    services: Mapping[str, SeenService]
    nodes: FrozenSet[str] = frozenset()
    gone: FrozenSet[str] = frozenset()
    namespace: str = "/"
    master_host: str = "localhost"
    named: bool = True
    listeners: Mapping[str, Tuple[str, ...]] = field(default_factory=dict)
    offered: FrozenSet[str] = frozenset()
    md5s: Mapping[str, str] = field(default_factory=dict)
    listened_s: float = 10.0
    remapped: Mapping[str, str] = field(default_factory=dict)
    others: Tuple[SeenService, ...] = ()

    def resolved(self, name: str) -> str:
        """Return the name that a name of the configuration or of the code has in the graph."""
        absolute = absolute_name(name, self.namespace)
        return self.remapped.get(absolute, absolute)


def absolute_name(name: str, namespace: str) -> str:
    """Return a name as it is in a graph without a remap; the namespace has a slash at its end."""
    return name if name.startswith("/") else namespace + name


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Args:
        level: good, warning or wrong.
        about: what it is about, e.g. "imu".
        said: what is so.
        line: the line to change, with its file; empty: none.
    """

    level: str
    about: str
    said: str
    line: str = ""


def examine(
    configuration: Configuration, graph: Graph, arrangement: Optional[Arrangement] = None
) -> Tuple[Finding, ...]:
    """Compare a configuration with what runs; without an arrangement all nodes are to be ours."""
    arrangement = arrangement or Arrangement()
    return (
        *_network(graph),
        *_components(configuration, graph),
        *_checks(configuration, graph, arrangement),
        *(_recorded(configuration, graph, arrangement) if "data_recorder" in arrangement.ours else ()),
        *_names(wanted(configuration, arrangement), graph),
    )


def _network(graph: Graph) -> Iterator[Finding]:
    if not graph.named:
        said = f"the master is on {graph.master_host}, and neither ROS_IP nor ROS_HOSTNAME says where this computer is"
        yield Finding(WRONG, "network", said, "in the shell of each node: export ROS_IP=ADDRESS")
    for name in sorted(graph.gone):
        said = f"{name} is on the master's list and does not answer: it died, or its computer is not reached"
        yield Finding(WARNING, "network", said, "to forget the dead: rosnode cleanup")


# --- what is watched --------------------------------------------------------------------------------------------------


def _components(configuration: Configuration, graph: Graph) -> Iterator[Finding]:
    known = {topic.topic for component in configuration.components for topic in component.topics}
    for component in configuration.components:
        for spec in component.topics:
            yield from _watched(component.name, spec, graph, known)
        yield from _node(component, graph)


def _node(component: ComponentSpec, graph: Graph) -> Iterator[Finding]:
    """Say that the node of a component is not there, or is one that a restart would end for nothing."""
    name, restarted = component.node or "", component.restart.policy is RestartPolicy.NODE
    seen = [graph.topics.get(graph.resolved(spec.topic)) for spec in component.topics]
    publishers = sorted({node for each in seen if each is not None for node in each.nodes})
    line = f"sensors.yaml, components.{component.name}: node: {publishers[0]}" if len(publishers) == 1 else ""
    if name and graph.resolved(name) not in graph.nodes:
        yield Finding(WRONG, component.name, f"there is no node {name}", line)
    elif restarted and publishers and not _may_publish(graph.resolved(name), publishers, graph):
        who = f"{', '.join(publishers)} {'does' if len(publishers) == 1 else 'do'}"
        said = f"{name} would be restarted, and publishes none of its topics: {who}"
        yield Finding(WRONG, component.name, said, line)


def _may_publish(node: str, publishers: Sequence[str], graph: Graph) -> bool:
    """Return whether a node is one of the publishers, or may be a nodelet of one: its manager publishes for it."""
    return node in publishers or any(f"{each}/unload_nodelet" in graph.offered for each in publishers)


def _watched(name: str, spec: TopicSpec, graph: Graph, known: Iterable[str]) -> Iterator[Finding]:
    key = f"sensors.yaml, components.{name}.topics"
    seen = graph.topics.get(graph.resolved(spec.topic))
    if seen is None:
        close = _alike(spec.topic, graph, known)
        line = f"{key}: {close} in the place of {spec.topic}" if close else ""
        yield Finding(WRONG, name, f"nobody publishes {spec.topic}", line)
        return
    who, several = ", ".join(seen.nodes), len(seen.nodes) > 1
    if len(seen.kinds) > 1:
        yield Finding(WRONG, name, f"{spec.topic} has {_counted(seen.kinds)} types: {_types(seen)}", _ONE_OF_THEM)
        return
    if several:
        yield _publishers(name, spec.topic, seen)
    if seen.rate_hz is None:
        yield _too_few(name, spec, seen, graph.listened_s)
        return
    stamps = list(_stamps(name, spec, seen))
    yield from stamps
    off = abs(seen.rate_hz - spec.rate_hz) / spec.rate_hz
    rate_hz = f"{float(f'{seen.rate_hz:.3g}'):g}"  # 1000, not 1e+03, which is no number in YAML
    said = f"{spec.topic} of {who} comes at {rate_hz} Hz, expected are {spec.rate_hz:g}"
    line = f"{key}.{spec.topic}: rate_hz: {rate_hz}" if not several else ""
    if seen.rate_hz < spec.rate_failed_fraction * spec.rate_hz:
        yield Finding(WRONG, name, f"{said}: it would count as failed", line)
    elif several:
        return  # whose rate it is nobody knows
    elif off > spec.tolerance_fraction:
        yield Finding(WARNING, name, f"{said}: it would count as off its rate", line)
    elif not stamps:
        yield Finding(GOOD, name, f"{spec.topic} of {who} comes at {rate_hz} Hz")


def _publishers(name: str, topic: str, seen: SeenTopic) -> Finding:
    """Say that a topic has more than one publisher: whoever reads it cannot tell them apart."""
    said = f"{topic} has {_counted(seen.nodes)} publishers: {', '.join(seen.nodes)}"
    return Finding(WARNING, name, said, _ONE_OF_THEM)


def _types(seen: SeenTopic) -> str:
    """Return the types of a topic, each with the nodes that publish it."""
    nodes = {kind: ", ".join(node for node, each in seen.kinds_of if each == kind) for kind in seen.kinds}
    return ", ".join(f"{kind} of {who}" if who else kind for kind, who in nodes.items())


def _counted(those: Sequence[str]) -> str:
    return "two" if len(those) == 2 else str(len(those))  # noqa: PLR2004


def _too_few(name: str, spec: TopicSpec, seen: SeenTopic, listened_s: float) -> Finding:
    """Say of a topic without two messages that it is silent, or that two could not be expected yet."""
    whose, heard = f"{spec.topic} of {', '.join(seen.nodes)}", f"({seen.count} messages)"
    needed_s = 2.0 / (spec.rate_hz * (1.0 - spec.tolerance_fraction))
    failed = seen.count == 0 and listened_s * _S > spec.silence_limit_ns
    if failed or listened_s >= needed_s:
        return Finding(WRONG, name, f"{whose} is silent {heard}")
    line = f"listen for longer: --for {10 * ceil(round(needed_s / 10, 3))}"
    return Finding(WARNING, name, f"{whose} is too slow to judge in {listened_s:g} s {heard}", line)


def _stamps(name: str, spec: TopicSpec, seen: SeenTopic) -> Iterator[Finding]:
    topic, judged = spec.topic, spec.stamp_tolerance_ns is not None
    if seen.unstamped:
        said = f"stamps of {topic} are 0: {', '.join(seen.nodes)} does not say when"
        line = "in its driver: header.stamp"
        line += f"; or sensors.yaml, components.{name}.topics.{topic}: no stamp_tolerance_s" * judged
        yield Finding(WARNING, name, said + ": it would count as off the clock" * judged, line)
        return
    if seen.age_s is None or -_AHEAD_S <= seen.age_s <= _OFFSET_S:
        return
    clock = f"the clock of the computer of {', '.join(seen.nodes)} is"
    if seen.age_s < 0.0:
        said = f"stamps of {topic} are {-seen.age_s:.3g} s in the future: {clock} ahead"
    else:
        said = f"stamps of {topic} are {seen.age_s:.3g} s old on arrival: {clock} behind, or it stamps late"
    yield Finding(WARNING, name, said, "on that computer: chronyc makestep")


def _alike(topic: str, graph: Graph, known: Iterable[str]) -> str:
    others = sorted(set(graph.topics) - set(known))
    close = difflib.get_close_matches(topic, others, n=1)
    return close[0] if close else ""


def _checks(configuration: Configuration, graph: Graph, arrangement: Arrangement) -> Iterator[Finding]:
    landing, states, ours = configuration.landing, configuration.state_estimation, arrangement.ours
    frames = {trajectory.frame for plan in configuration.plans for trajectory in plan.trajectories}
    turns = "mission_planner" in arrangement.peers and Frame.EAST_NORTH in frames  # by the heading of the estimate
    watched = {spec.topic for component in configuration.components for spec in component.topics}
    lands, judges = "landing_detection" in ours, "state_estimation" in ours
    rows = (
        ("landing_detection", "topic", landing.topic, _RANGE_TYPES[landing.source], lands),
        ("state_estimation", "topic", states.topic, _ESTIMATE_TYPES[states.source], judges or turns),
        ("state_estimation", "imu_topic", states.imu_topic, _IMU, judges),
    )
    for check, key, topic, kind, read in rows:
        if not topic or not read:
            continue
        seen, line = graph.topics.get(graph.resolved(topic)), f"sensors.yaml, {check}.{key}: "
        version = _other_version(seen.md5s, graph.md5s.get(kind, "")) if seen is not None else ""
        if seen is None:
            those = sorted(name for name, each in graph.topics.items() if kind in each.kinds)
            close = difflib.get_close_matches(topic, those, n=1, cutoff=0.0)
            yield Finding(WRONG, check, f"nobody publishes {topic}", f"{line}{close[0]}" if close else "")
        elif len(seen.kinds) > 1:
            yield Finding(WRONG, check, f"{topic} is {_types(seen)}; read is {kind}", _ONE_OF_THEM)
        elif seen.kinds != (kind,):
            said = f"{topic} is {', '.join(seen.kinds)}, read is {kind}"
            yield Finding(WRONG, check, said, _of_source(check, key, seen))
        elif version:
            yield Finding(WRONG, check, f"{topic} is {kind} {version}", _same(kind))
        elif seen.count == 0:
            yield Finding(WRONG, check, f"{topic} of {', '.join(seen.nodes)} is silent")
        elif len(seen.nodes) > 1 and topic not in watched:
            yield _publishers(check, topic, seen)
        else:
            yield Finding(GOOD, check, f"{topic} is {kind}")


def _of_source(check: str, key: str, seen: SeenTopic) -> str:
    """Return the line with the source that reads what a topic is; empty: there is none."""
    sources: Dict[str, str] = {}
    if key == "topic":
        rows = _RANGE_TYPES.items() if check == "landing_detection" else _ESTIMATE_TYPES.items()
        sources = {kind: source.value for source, kind in rows}
    found = [sources[kind] for kind in seen.kinds if kind in sources]
    return f"sensors.yaml, {check}: source: {found[0]}" if len(found) == 1 and len(seen.kinds) == 1 else ""


def _recorded(configuration: Configuration, graph: Graph, arrangement: Arrangement) -> Iterator[Finding]:
    ours = {graph.resolved(row.name) for row in wanted(configuration, arrangement)}
    for group in configuration.recording.groups:
        nobody = [t for t in group.topics if t.startswith("/") and t not in graph.topics and t not in ours]
        if nobody:
            said = f"nobody publishes {', '.join(nobody)}: recorded when somebody does"
            yield Finding(WARNING, f"recording {group.name}", said)


# --- names ------------------------------------------------------------------------------------------------------------
# What is asked, read and sent by the nodes of an arrangement; `launch/autonomy.launch` has the same renames.


class Way(enum.Enum):
    """What somebody does with a name: in words, of nobody and of a node; and what is done with it here."""

    OFFERED = ("nobody offers", "is offered by", "asked")
    PUBLISHED = ("nobody publishes", "is published by", "read")
    HEARD = ("nobody listens to", "is heard by", "sent")


@dataclass(frozen=True)
class Wanted:
    """One name.

    Args:
        about: what it belongs to.
        name: as it stands in the code or the configuration.
        kind: package and type.
        way: what is wanted of it.
        start: what offers, publishes or hears it, for people.
        level: of a name that nobody has; empty: nothing is said of it.
        md5: of the type; empty: as it is on this computer.
        talks: something must be heard on it.
        alone: the argument of autonomy.launch that leaves ours out, where one node alone may publish it; else empty.
        line: the line to change when nobody has it.
    """

    about: str
    name: str
    kind: str
    way: Way
    start: str
    level: str = WARNING
    md5: str = ""
    talks: bool = False
    alone: str = ""
    line: str = ""


_THEIRS, _ENGINE = "of the CNS Flight Stack", "the engine of the CNS Flight Stack"
_RENAMED_PEERS: Mapping[str, str] = {
    name: f"cns_peers/{name}" for name in ("watchdog/start", "watchdog/action", "watchdog/info")
}
_RENAMED_SERVER: Mapping[str, str] = {"watchdog/action": "cns_server/watchdog/action"}
_INITIALISES: Mapping[InitialisationType, str] = {
    InitialisationType.TRIGGER: "std_srvs/Trigger",
    InitialisationType.SET_BOOL: "std_srvs/SetBool",
    InitialisationType.EMPTY: "std_srvs/Empty",
}


class ArrangementError(ValueError):
    """Nodes cannot be arranged so."""


@dataclass(frozen=True)
class Arrangement:
    """Which nodes stand where, as the arguments of autonomy.launch say.

    Args:
        peers: of our engine that are nodes of the CNS Flight Stack (`cns_peers`).
        served: nodes of ours that serve its engine (`cns_served`); ours is not started.
        namespace: that its names are in (`cns_namespace`).

    Raises:
        ArrangementError: when made: a name is none of the five, or both engines would be started.
    """

    peers: Tuple[str, ...] = ()
    served: Tuple[str, ...] = ()
    namespace: str = ""

    def __post_init__(self) -> None:
        strange = next((name for name in (*self.peers, *self.served) if name not in cns.PEERS), None)
        if strange is not None:
            raise ArrangementError(f"{strange} is none of {', '.join(cns.PEERS)}")
        if self.peers and self.served:
            raise ArrangementError("one engine alone is started: peers are for ours, served is for the one of CNS")

    @property
    def ours(self) -> FrozenSet[str]:
        """Those of the five that are nodes of ours."""
        return frozenset(self.served or cns.PEERS).difference(self.peers)

    def named(self, name: str) -> str:
        """Return the name that a name of ours has here."""
        if self.served:
            return _RENAMED_SERVER.get(name, name)
        return _RENAMED_PEERS.get(name, name) if "watchdog" in self.peers else name

    def has(self, peer: str) -> bool:
        """Return whether the names of ours of a peer are wanted."""
        return not self.served or peer in self.served or peer not in cns.PEERS

    def start(self, peer: str) -> str:
        """Return what offers the names of ours of a peer."""
        return "cns_peers" if peer in self.peers else f"the {peer}"


def wanted(configuration: Configuration, arrangement: Arrangement) -> Tuple[Wanted, ...]:
    """Return the names that are asked, read and sent."""
    return (
        *_of_ours(arrangement),
        *_of_cns(arrangement),
        *(_of_mavros(configuration, arrangement) if configuration.autopilot.backend == "mavros" else ()),
        *_of_estimator(configuration),
    )


def _of_ours(arrangement: Arrangement) -> Iterator[Wanted]:
    for name, service in SERVICES.items():
        peer, package = service.peer, "std_srvs" if service.type == "Trigger" else "amaze_autonomy"
        if arrangement.has(peer):
            kind = f"{package}/{service.type}"
            yield Wanted(peer, arrangement.named(name), kind, Way.OFFERED, arrangement.start(peer))
    for status in STATUSES:
        peer, kind = status.topic.split("/")[0], f"amaze_autonomy/{status.shape.message}"
        if arrangement.has(peer):
            start, name = arrangement.start(peer), arrangement.named(status.topic)
            yield Wanted(name, name, kind, Way.PUBLISHED, start, level="", alone=peer)


def _of_cns(arrangement: Arrangement) -> Iterator[Wanted]:
    for each in (*cns.TOPICS.values(), *cns.SERVICES.values()):
        if each.peer not in (*arrangement.peers, *arrangement.served):
            continue
        sent = each in cns.TOPICS.values() and not each.heard
        way = Way.OFFERED if each in cns.SERVICES.values() else Way.PUBLISHED
        if arrangement.served:
            start = _ENGINE if sent else "cns_server"
        else:
            start, way = f"the {each.peer} {_THEIRS}", Way.HEARD if sent else way
        yield Wanted(each.peer, arrangement.namespace.rstrip("/") + each.name, each.type, way, start, md5=each.md5)


def _of_mavros(configuration: Configuration, arrangement: Arrangement) -> Iterator[Wanted]:
    """Yield what the autopilot node and our planner need of mavros."""
    settings, flies = configuration.autopilot, "mission_planner" in arrangement.ours
    for name, kind in (*MAVROS_SERVICES.items(), *(MISSION_SERVICES.items() if flies else ())):
        named = f"{settings.mavros}/{name}"
        yield Wanted("mavros", named, f"mavros_msgs/{kind}", Way.OFFERED, "mavros", level=WRONG)
    topics = [("mavros", STATE), *(("land_switch", each) for each in sources_of(("RC_CHANNELS",)))]
    for about, source in topics if settings.land_switch.channel else topics[:1]:
        named = f"{settings.mavros}/{source.topic}"
        yield Wanted(about, named, source.kind, Way.PUBLISHED, "mavros", level=WRONG, talks=True)


def _of_estimator(configuration: Configuration) -> Iterator[Wanted]:
    spec, line = configuration.initialisation, "sensors.yaml: initialisation"
    for name, kind in ((spec.service, spec.type), (spec.in_flight_service, spec.in_flight_type)):
        if name:
            start = "the estimator"
            yield Wanted("initialisation", name, _INITIALISES[kind], Way.OFFERED, start, level=WRONG, line=line)


def _names(rows: Iterable[Wanted], graph: Graph) -> Iterator[Finding]:
    """Compare names with what runs; those that nobody has come last, together."""
    missing: Dict[Tuple[str, ...], List[str]] = {}
    renamed: Dict[Tuple[str, str], List[Tuple[Wanted, Tuple[SeenService, ...]]]] = {}
    for row in rows:
        name, _, _, nodes = _seen(row, graph)
        others = () if nodes else _others(row, graph)
        if nodes:
            yield from _had(row, graph)
        elif others:
            renamed.setdefault((row.level, row.about), []).append((row, others))
        elif row.level:
            line = row.line or _elsewhere(row, graph)
            missing.setdefault((row.level, row.about, row.way.value[0], row.start, line), []).append(name)
    for (level, about), found in renamed.items():
        yield _renamed(level, about, found, graph)
    peers = {about for _, about in renamed}  # of each another one may run: a second sender is not to be started
    for (level, about, nobody, start, line), names in missing.items():
        to_do = "is it remapped, too?" if about in peers else f"start {start}"
        yield Finding(level, about, f"{nobody} {', '.join(names)}: {to_do}", line)


def _had(row: Wanted, graph: Graph) -> Iterator[Finding]:
    """Judge a name that somebody has."""
    name, kinds, md5s, nodes = _seen(row, graph)
    _, by, done = row.way.value
    whose = f"{name} of {', '.join(nodes)}"
    version = _other_version(md5s, row.md5 or graph.md5s.get(row.kind, ""), done)
    if kinds != (row.kind,):
        line = "rename or remap one of them" + ", or start one stack in a namespace" * (row.way is not Way.OFFERED)
        yield Finding(WRONG, row.about, f"{whose} is {', '.join(kinds)}, {done} is {row.kind}", line)
    elif version:
        yield Finding(WRONG, row.about, f"{whose} is {row.kind} {version}", _same(row.kind))
    elif row.alone and len(nodes) > 1:
        line = f"{_ONE_OF_THEM}; autonomy.launch leaves ours out with {row.alone}:=false"
        yield Finding(WRONG, row.about, f"{name} has {_counted(nodes)} publishers: {', '.join(nodes)}", line)
    elif row.talks and graph.topics[name].count == 0:
        yield Finding(WRONG, row.about, f"{whose} is silent")
    elif row.level:
        yield Finding(GOOD, row.about, f"{name} {by} {', '.join(nodes)}")


def _renamed(level: str, about: str, found: Sequence[Tuple[Wanted, Tuple[SeenService, ...]]], graph: Graph) -> Finding:
    """Say of services that nobody offers which others are of their types: those of a peer that was remapped."""
    nobody = ", ".join(graph.resolved(row.name) for row, _ in found)
    those = [f"{each.name} of {each.node}" for _, others in found for each in others]
    said = f"{nobody}; of that type {'is' if len(those) == 1 else 'are'} {', '.join(those)}"
    words = [f"{row.name}:={others[0].name if len(others) == 1 else 'ONE_OF_THEM'}" for row, others in found]
    line = f"if remapped, tell doctor, too: {' '.join(words)}"
    return Finding(level, about, f"{Way.OFFERED.value[0]} {said}", line)


def _others(row: Wanted, graph: Graph) -> Tuple[SeenService, ...]:
    """Return the services of the type of one that nobody offers, those of its last name before all others.

    Its own name in another namespace is no remap: it is of another platform, or of another vehicle.
    """
    if row.way is not Way.OFFERED or row.kind.split("/")[0] in _OF_EVERYBODY:
        return ()
    of_type = [each for each in graph.others if each.kind == row.kind and not each.name.endswith(f"/{row.name}")]
    those = tuple(sorted(of_type, key=lambda each: each.name))
    last = row.name.split("/")[-1]
    return tuple(each for each in those if each.name.split("/")[-1] == last) or those


def _seen(row: Wanted, graph: Graph) -> Tuple[str, Tuple[str, ...], Tuple[str, ...], Tuple[str, ...]]:
    """Return what a name is in the graph: its name, types, their md5 sums, nodes; no nodes: nobody has it."""
    name, service = graph.resolved(row.name), graph.services.get(row.name)
    topic = graph.topics.get(name)
    if row.way is Way.HEARD:  # of who listens no type is known
        return name, (row.kind,), (), graph.listeners.get(name, ())
    if row.way is Way.OFFERED and service is not None:
        return service.name, (service.kind,), (service.md5,), (service.node,)
    if row.way is Way.PUBLISHED and topic is not None:
        return name, topic.kinds, topic.md5s, topic.nodes
    return name, (), (), ()


def _elsewhere(row: Wanted, graph: Graph) -> str:
    """Return the line that names the namespace in which mavros is instead; empty: none."""
    end = next(iter(MAVROS_SERVICES))
    others = sorted(name[: -len(end) - 1] for name in graph.offered if name.endswith(f"/{end}"))
    return f"autopilot.yaml: mavros: {others[0]}" if row.start == "mavros" and others else ""


def _other_version(md5s: Iterable[str], ours: str, done: str = Way.PUBLISHED.value[2]) -> str:
    """Return how a type of the right name is another one; empty: it is that."""
    others = [md5 for md5 in md5s if md5 not in ("", "*", ours)]
    return f"with the md5 sum {others[0]}, {done} is {ours}: another version" if ours and others else ""


def _same(kind: str) -> str:
    return f"build the same {kind.split('/')[0]} on both computers"


# --- this computer ----------------------------------------------------------------------------------------------------


def examine_host(configuration: Configuration, platform: str) -> Tuple[Finding, ...]:
    """Look at this computer as a platform of recording.yaml: its storage, the way to the others, roslaunch, its time.

    Args:
        configuration: as loaded.
        platform: name of this computer, which recording.yaml has.
    """
    collects = platform == configuration.recording.collector
    ssh = _ssh(configuration) if collects else ()
    return (*_storage(configuration, platform), *ssh, *_launched(), _time())


def _storage(configuration: Configuration, platform: str) -> Iterator[Finding]:
    recording = configuration.recording
    folder = expanded(recording.folder)
    space = space_of(folder) if folder.is_absolute() else None
    if space is None:
        yield Finding(WRONG, "storage", f"{folder} cannot be looked at", "recording.yaml: folder: one that can")
        return
    longest_s = max((mission.estimated_duration_s or 0.0 for mission in configuration.missions), default=0.0)
    needed = needed_bytes(recording.storage, recording.groups_of(platform), longest_s)
    problem = too_little(recording.storage, needed, space, str(folder))
    said = problem or f"{space.free_bytes / 1e9:.1f} GB are free in {folder}"
    yield Finding(WRONG if problem else GOOD, "storage", said)


def _ssh(configuration: Configuration) -> Iterator[Finding]:
    for platform in configuration.recording.platforms:
        transfer = platform.transfer
        if platform.name == configuration.recording.collector or transfer.by != "rsync":
            continue
        command = ["ssh", "-oBatchMode=yes", "-oConnectTimeout=5", "-p", str(transfer.ssh_port)]
        if transfer.ssh_key:  # with that key alone, as the recorder does
            command += ["-oIdentitiesOnly=yes", "-i", str(expanded(transfer.ssh_key))]
        status, said = _run((*command, "--", transfer.host, "true"))
        if status == 0:
            yield Finding(GOOD, platform.name, f"ssh opens {transfer.host}")
        else:
            line = f"ssh-copy-id -p {transfer.ssh_port} {transfer.host}; or recording.yaml, platforms.{platform.name}"
            yield Finding(WRONG, platform.name, f"ssh does not open {transfer.host}: {said}", line)


def _launched() -> Iterator[Finding]:
    """Say which arguments of a running roslaunch autonomy.launch does not have: roslaunch says nothing of them."""
    arguments = (argument for words in _commands() if _is_launch(words) for argument in words if ":=" in argument)
    given = [argument.split(":=", 1) for argument in arguments if not argument.startswith("_")]
    file = config_folder().parent / "launch" / "autonomy.launch"
    known = _ARGUMENT.findall(file.read_text(encoding="utf-8")) if given and file.is_file() else []
    for name, value in given if known else ():
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            said = f"autonomy.launch has no argument {name}:={value}: nothing was done by it"
            yield Finding(WARNING, "roslaunch", said, f"{close[0]}:={value}" if close else "")


def _is_launch(words: Sequence[str]) -> bool:
    """Return whether a command is a roslaunch of autonomy.launch, by its package or its path."""
    ours = ("amaze_autonomy", "autonomy.launch") in zip(words, words[1:])
    by_path = any(word.endswith("amaze_autonomy/launch/autonomy.launch") for word in words)
    return (ours or by_path) and any(word.rpartition("/")[2] == "roslaunch" for word in words)


def _commands() -> Iterator[Tuple[str, ...]]:
    """Yield the commands that run on this computer, as their words."""
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended since
            yield tuple(file.read_bytes().decode("utf-8", "replace").split("\0"))


def _time() -> Finding:
    """Say whether something keeps the time of this computer: stamps of two computers are compared."""
    problem, line = "nobody is known to keep the time of this computer", "apt-get install chrony, on each computer"
    if shutil.which("chronyc"):
        status, said = _run(("chronyc", "-c", "tracking"))
        fields = said.split(",")
        if status == 0 and len(fields) > 4 and fields[2] != "0":  # noqa: PLR2004 - stratum, then the offset
            offset_s = float(fields[4])
            level = GOOD if abs(offset_s) <= _CLOCK_S else WARNING
            return Finding(level, "time", f"chrony keeps it, {offset_s * 1e3:+.1f} ms off")
        if status == 0:
            problem = "chrony runs, and is not synchronised"
            line = "chrony.conf of the near computer: allow, local stratum 10; of the far one: server NEAR iburst"
        else:
            problem, line = f"chrony is here, and does not answer ({said})", "systemctl enable --now chrony"
    if shutil.which("timedatectl"):
        status, said = _run(("timedatectl", "show", "--property=NTPSynchronized", "--value"))
        if status == 0 and said == "yes":
            return Finding(GOOD, "time", "it is synchronised")
    return Finding(WARNING, "time", f"{problem}: stamps of two computers cannot be compared", line)


def _run(command: Sequence[str]) -> Tuple[int, str]:
    """Run a command; return its exit status and the last line that it said."""
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_RUN_S, check=False
        )
    except subprocess.TimeoutExpired:
        return -1, f"no answer within {_RUN_S:g} s"
    except OSError as error:
        return -1, error.strerror or str(error)
    lines = (done.stdout + done.stderr).strip().splitlines()
    return done.returncode, lines[-1] if lines else f"exit status {done.returncode}"
