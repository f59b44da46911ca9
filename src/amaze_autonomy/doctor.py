"""What is wrong between a configuration, the graph that runs and this computer; and the lines that would put it right.

`examine` is pure: a configuration and a `Graph` in, findings out. `examine_host` looks at this computer: storage, ssh
to the other platforms, time. What runs is looked at by `ros/graph.py`.
"""

from __future__ import annotations

import difflib
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, FrozenSet, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

from .config import Configuration
from .interface import SERVICES, STATUSES
from .monitoring.specs import EstimateSource, RangeSource, TopicSpec
from .recording.storage import needed_bytes, space_of, too_little

__all__ = ["GOOD", "WARNING", "WRONG", "Finding", "Graph", "SeenService", "SeenTopic", "examine", "examine_host"]

GOOD, WARNING, WRONG = "good", "warning", "wrong"
_S = 1_000_000_000
_OFFSET_S, _AHEAD_S = 0.5, 0.05  # of stamps on arrival: old by a clock or a driver; from the future by a clock
_RUN_S = 8.0
_CLOCK_S = 0.05  # off from the time server
_IMU = "sensor_msgs/Imu"
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
    """

    kinds: Tuple[str, ...]
    nodes: Tuple[str, ...]
    count: int = 0
    rate_hz: Optional[float] = None
    age_s: Optional[float] = None


@dataclass(frozen=True)
class SeenService:
    """A service that is offered."""

    name: str
    kind: str
    node: str


@dataclass(frozen=True)
class Graph:
    """What runs.

    Args:
        topics: that somebody publishes, by their names.
        services: of ours that are offered, by their names in the code.
        nodes: names of all that answer.
        gone: names of those on the master's list that do not.
        namespace: in which our names are resolved, with a slash at its end.
        master_host: where the master is.
        named: others can reach this computer: ROS_IP or ROS_HOSTNAME is set, or the master is here.
    """

    topics: Mapping[str, SeenTopic]
    services: Mapping[str, SeenService]
    nodes: FrozenSet[str] = frozenset()
    gone: FrozenSet[str] = frozenset()
    namespace: str = "/"
    master_host: str = "localhost"
    named: bool = True

    def resolved(self, name: str) -> str:
        """Return the name that a name of the configuration has in the graph."""
        return name if name.startswith("/") else self.namespace + name


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


def examine(configuration: Configuration, graph: Graph) -> Tuple[Finding, ...]:
    """Compare a configuration with what runs."""
    return (
        *_network(graph),
        *_components(configuration, graph),
        *_checks(configuration, graph),
        *_recorded(configuration, graph),
        *_services(graph),
        *_statuses(graph),
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
        if component.node and graph.resolved(component.node) not in graph.nodes:
            close = difflib.get_close_matches(component.node, sorted(graph.nodes), n=1)
            line = f"sensors.yaml, components.{component.name}: node: {close[0]}" if close else ""
            yield Finding(WRONG, component.name, f"there is no node {component.node}", line)


def _watched(name: str, spec: TopicSpec, graph: Graph, known: Iterable[str]) -> Iterator[Finding]:
    key = f"sensors.yaml, components.{name}.topics"
    seen = graph.topics.get(graph.resolved(spec.topic))
    if seen is None:
        close = _alike(spec.topic, graph, known)
        line = f"{key}: {close} in the place of {spec.topic}" if close else ""
        yield Finding(WRONG, name, f"nobody publishes {spec.topic}", line)
        return
    who = ", ".join(seen.nodes)
    if seen.rate_hz is None:
        yield Finding(WRONG, name, f"{spec.topic} of {who} is silent ({seen.count} messages)")
        return
    stamps = list(_stamps(name, spec.topic, seen))
    yield from stamps
    off = abs(seen.rate_hz - spec.rate_hz) / spec.rate_hz
    said = f"{spec.topic} of {who} comes at {seen.rate_hz:.3g} Hz, expected are {spec.rate_hz:g}"
    line = f"{key}.{spec.topic}: rate_hz: {seen.rate_hz:.3g}"
    if seen.rate_hz < spec.rate_failed_fraction * spec.rate_hz:
        yield Finding(WRONG, name, f"{said}: it would count as failed", line)
    elif off > spec.tolerance_fraction:
        yield Finding(WARNING, name, f"{said}: it would count as off its rate", line)
    elif not stamps:
        yield Finding(GOOD, name, f"{spec.topic} of {who} comes at {seen.rate_hz:.3g} Hz")


def _stamps(name: str, topic: str, seen: SeenTopic) -> Iterator[Finding]:
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


def _checks(configuration: Configuration, graph: Graph) -> Iterator[Finding]:
    landing, states = configuration.landing, configuration.state_estimation
    wanted = (
        ("landing_detection", "topic", landing.topic, _RANGE_TYPES[landing.source]),
        ("state_estimation", "topic", states.topic, _ESTIMATE_TYPES[states.source]),
        ("state_estimation", "imu_topic", states.imu_topic, _IMU),
    )
    for check, key, topic, kind in wanted:
        if not topic:
            continue
        seen, line = graph.topics.get(graph.resolved(topic)), f"sensors.yaml, {check}.{key}: "
        if seen is None:
            those = sorted(name for name, each in graph.topics.items() if kind in each.kinds)
            close = difflib.get_close_matches(topic, those, n=1, cutoff=0.0)
            yield Finding(WRONG, check, f"nobody publishes {topic}", f"{line}{close[0]}" if close else "")
        elif seen.kinds != (kind,):
            said = f"{topic} is {', '.join(seen.kinds)}, read is {kind}"
            yield Finding(WRONG, check, said, _of_source(check, key, seen))
        elif seen.count == 0:
            yield Finding(WRONG, check, f"{topic} of {', '.join(seen.nodes)} is silent")
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


def _recorded(configuration: Configuration, graph: Graph) -> Iterator[Finding]:
    ours = {graph.resolved(status.topic) for status in STATUSES}
    for group in configuration.recording.groups:
        nobody = [t for t in group.topics if t.startswith("/") and t not in graph.topics and t not in ours]
        if nobody:
            said = f"nobody publishes {', '.join(nobody)}: recorded when somebody does"
            yield Finding(WARNING, f"recording {group.name}", said)


# --- our names --------------------------------------------------------------------------------------------------------


def _services(graph: Graph) -> Iterator[Finding]:
    missing: Dict[str, List[str]] = {}
    for name, service in SERVICES.items():
        seen = graph.services.get(name)
        package = "std_srvs" if service.type == "Trigger" else "amaze_autonomy"
        if seen is None:
            missing.setdefault(service.peer, []).append(name)
        elif seen.kind != f"{package}/{service.type}":
            said = f"{seen.name} of {seen.node} is {seen.kind}, asked is {package}/{service.type}"
            yield Finding(WRONG, service.peer, said, "rename or remap one of them")
        else:
            yield Finding(GOOD, service.peer, f"{seen.name} is offered by {seen.node}")
    for peer, names in missing.items():
        yield Finding(WARNING, peer, f"nobody offers {', '.join(map(graph.resolved, names))}: start the {peer}")


def _statuses(graph: Graph) -> Iterator[Finding]:
    for status in STATUSES:
        topic, kind = graph.resolved(status.topic), f"amaze_autonomy/{status.shape.message}"
        seen = graph.topics.get(topic)
        if seen is not None and seen.kinds != (kind,):
            said = f"{topic} of {', '.join(seen.nodes)} is {', '.join(seen.kinds)}, read is {kind}"
            yield Finding(WRONG, status.topic, said, "rename or remap one of them, or start one stack in a namespace")


# --- this computer ----------------------------------------------------------------------------------------------------


def examine_host(configuration: Configuration) -> Tuple[Finding, ...]:
    """Look at this computer as the collector: its storage, its way to the other platforms, its time."""
    return (*_storage(configuration), *_ssh(configuration), _time())


def _storage(configuration: Configuration) -> Iterator[Finding]:
    recording = configuration.recording
    folder = Path(recording.folder).expanduser()
    space = space_of(folder)
    if space is None:
        yield Finding(WRONG, "storage", f"{folder} cannot be looked at", "recording.yaml: folder: one that can")
        return
    longest_s = max((mission.estimated_duration_s or 0.0 for mission in configuration.missions), default=0.0)
    needed = needed_bytes(recording.storage, recording.groups_of(recording.collector), longest_s)
    problem = too_little(recording.storage, needed, space, str(folder))
    said = problem or f"{space.free_bytes / 1e9:.1f} GB are free in {folder}"
    yield Finding(WRONG if problem else GOOD, "storage", said)


def _ssh(configuration: Configuration) -> Iterator[Finding]:
    for platform in configuration.recording.platforms:
        transfer = platform.transfer
        if platform.name == configuration.recording.collector or transfer.by != "rsync":
            continue
        command = ["ssh", "-oBatchMode=yes", "-oConnectTimeout=5", "-p", str(transfer.ssh_port)]
        command += ["-i", str(Path(transfer.ssh_key).expanduser())] if transfer.ssh_key else []
        status, said = _run((*command, "--", transfer.host, "true"))
        if status == 0:
            yield Finding(GOOD, platform.name, f"ssh opens {transfer.host}")
        else:
            line = f"ssh-copy-id -p {transfer.ssh_port} {transfer.host}; or recording.yaml, platforms.{platform.name}"
            yield Finding(WRONG, platform.name, f"ssh does not open {transfer.host}: {said}", line)


def _time() -> Finding:
    """Say whether something keeps the time of this computer: stamps of two computers are compared."""
    if shutil.which("chronyc"):
        status, said = _run(("chronyc", "-c", "tracking"))
        fields = said.split(",")
        if status == 0 and len(fields) > 4 and fields[2] != "0":  # noqa: PLR2004 - stratum, then the offset
            offset_s = float(fields[4])
            level = GOOD if abs(offset_s) <= _CLOCK_S else WARNING
            return Finding(level, "time", f"chrony keeps it, {offset_s * 1e3:+.1f} ms off")
    if shutil.which("timedatectl"):
        status, said = _run(("timedatectl", "show", "--property=NTPSynchronized", "--value"))
        if status == 0 and said == "yes":
            return Finding(GOOD, "time", "it is synchronised")
    said = "nobody is known to keep the time of this computer: stamps of two computers cannot be compared"
    return Finding(WARNING, "time", said, "apt-get install chrony, on each computer")


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
