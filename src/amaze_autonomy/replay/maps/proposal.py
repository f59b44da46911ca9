"""Proposes a topic map for a recording that nobody described yet: by types, names, rates and first messages.

What is recorded is found, what is not is left to the script and said. The proposal is a map like any other: it is meant
to be looked at, and to give a first useful timeline without an edit. Each rule is a row of `_SENSORS` or `_READINGS`.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import isfinite, sqrt
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.interface import STATUSES

from ...bags.errors import MessageError, UndecodableError
from ...bags.format import MEMORY
from ...config.schemas.sensors import LANDING_AGE_S, LANDING_WINDOW_S, LONGEST_AGE_S, SLOWEST_ESTIMATE_HZ
from ..beginning import ARMING_LEAD_NS
from ..errors import FieldError, NoMessagesError
from ..recordings.fields import getter, number, quaternion
from ..recordings.sources import CNS_PACKAGES, problems_of, recordings_of

_S = 1_000_000_000
_G = 9.80665
_LATE_S, _ARMED_BEFORE_S = 3.0, 1.0
_CHECKED_S, _COMMANDED_S = 3.2, 3.8  # from the selection to the checks before the takeoff, at the latest to its command
_STILL_S = 1.8  # a little less than the shipped configuration looks whether the vehicle stands still
_ESTIMATE_HZ = 25.0  # slower than this is too slow for the shipped configuration
_KINDS_NAMED = 5
_NEAR_MM, _MOUNTED_M, _ALOFT_M, _RISE_M = 300.0, 0.6, 0.5, 0.3
_LOOKED_AT = 2000  # messages of a topic, to see whether it rises with the vehicle


@dataclass(frozen=True)
class _Topic:
    name: str
    kind: str
    times_ns: Any
    first: Any  # the first message; None: it cannot be read
    wrong: str = ""  # why
    damaged: bool = False  # not only in an encoding that is not read
    publishers: Tuple[Tuple[str, str], ...] = ()  # with their types, first the one that is taken; empty: not looked at

    @property
    def period_s(self) -> Optional[float]:
        """Return the time between two messages, mostly; their mean where most come at one time of a simulation."""
        gaps = np.diff(self.times_ns)
        return float(np.median(gaps) or gaps.mean()) / _S if len(gaps) else None

    @property
    def longest_gap_s(self) -> float:
        gaps = np.diff(self.times_ns)
        return float(gaps.max()) / _S if len(gaps) else 0.0


@dataclass(frozen=True)
class Proposal:
    """A proposed map.

    Args:
        text: of the YAML file.
        found: what was found of the flight, one line each.
        scripted: what the recording does not tell, so that the script plays it.
        kinds: type of every topic.
        problems: what of the recordings is missing.
    """

    text: str
    found: Tuple[str, ...]
    scripted: Tuple[str, ...]
    kinds: Tuple[Tuple[str, str], ...]
    problems: Tuple[str, ...] = ()


_LOG_DATA = "crazyflie_driver/GenericLogData"
_MAVLINK: Mapping[str, Tuple[str, ...]] = {
    "imu": ("mavlink/HIGHRES_IMU", "mavlink/RAW_IMU"),
    "gps": ("mavlink/GPS_RAW_INT",),
    "lrf": ("mavlink/DISTANCE_SENSOR",),
}
_PX4: Mapping[str, Tuple[str, ...]] = {
    "gps": ("px4_msgs/VehicleGpsPosition", "px4_msgs/SensorGps"),
    "magnetometer": ("px4_msgs/VehicleMagnetometer", "px4_msgs/SensorMag"),
    "barometer": ("px4_msgs/VehicleAirData", "px4_msgs/SensorBaro"),
}
_HEALTH = ("gps", "imu")

# name of the component, types, words in the topic's name that make it likelier, words that make it unlikelier
_SENSORS: Tuple[Tuple[str, Tuple[str, ...], Tuple[str, ...], Tuple[str, ...]], ...] = (
    (
        "imu",
        ("sensor_msgs/Imu", *_MAVLINK["imu"]),
        ("px4", "mavros/imu/data", "fcu"),
        ("raw", "realsense", "camera", "lsm9ds1"),
    ),
    (
        "gps",
        ("sensor_msgs/NavSatFix", "mavros_msgs/GPSRAW", *_PX4["gps"], *_MAVLINK["gps"]),
        ("raw/fix", "fix", "gps"),
        ("satellites",),
    ),
    ("magnetometer", ("sensor_msgs/MagneticField", *_PX4["magnetometer"]), ("imu/mag", "mag"), ()),
    ("barometer", ("sensor_msgs/FluidPressure", *_PX4["barometer"]), ("static", "baro"), ("diff",)),
    (
        "lrf",
        ("sensor_msgs/Range", "sensor_msgs/LaserScan", *_MAVLINK["lrf"], _LOG_DATA),
        ("down", "lrf", "lidar", "range", "distance"),
        ("front",),
    ),
)
_RANGE = ("sensor_msgs/Range",)
_CAMERAS = ("sensor_msgs/Image", "sensor_msgs/CompressedImage", "sensor_msgs/PointCloud2")
_STATUSES: Mapping[str, str] = {
    **{f"amaze_autonomy/{row.shape.message}": row.name for row in STATUSES},
    "amaze_autonomy/JournalEntry": "journal",
}
_ESTIMATES: Tuple[Tuple[str, str, str], ...] = (
    ("nav_msgs/Odometry", "odometry", "pose.pose.position.z"),
    ("geometry_msgs/PoseStamped", "pose", "pose.position.z"),
    ("geometry_msgs/PoseWithCovarianceStamped", "pose_with_covariance", "pose.pose.position.z"),
)
_GPS_ALTITUDE = "altitude"  # above the sea
# types of a height that is no pose, its field, words of which one is in the topic's name, the least that a flight rises
_HEIGHTS: Tuple[Tuple[Tuple[str, ...], str, Tuple[str, ...], float], ...] = (
    (("std_msgs/Float64", "std_msgs/Float32"), "data", ("rel_alt", "height", "altitude"), 0.3),
    (("mavros_msgs/Altitude",), "relative", ("",), 0.3),
    (("mavros_msgs/Altitude",), "local", ("",), 0.3),  # where the other stays NaN, e.g. without a home
    (("sensor_msgs/NavSatFix",), _GPS_ALTITUDE, ("",), 2.0),
)
_TEXTS = ("mavros_msgs/StatusText", "mavlink/STATUSTEXT", "px4_msgs/LoggedMessage")
_PX4_MODES = ("OFFBOARD", "POSCTL", "ALTCTL", "MANUAL", "STABILIZED")
_CRITICAL = 5  # MAV_STATE_CRITICAL
_NOT_ESTIMATED = ("setpoint", "target", "command", "reference", "goal")
_OWN_ESTIMATE, _LOOKS_DOWN = "local_position", "down"  # in the name of what is the vehicle's though it stands
# type, field and value that say that the vehicle is in the air
_FLYING: Tuple[Tuple[str, str, int], ...] = (
    ("mavros_msgs/ExtendedState", "landed_state", 2),
    ("amaze_autonomy/AutopilotStatus", "landed", 3),
)


def propose(paths: Sequence[Path], memory: int = MEMORY) -> Proposal:
    """Propose a map for the recordings of one flight; `memory`: bytes that a chunk may take, decompressed.

    Raises:
        BagError: A file cannot be read.
        NoMessagesError: There is no message in them.
    """
    bags = [bag for path in paths for bag in recordings_of(path, memory)]
    try:
        return propose_of(bags, paths)
    finally:
        for bag in bags:
            bag.close()


def propose_of(bags: Sequence[Any], paths: Sequence[Path]) -> Proposal:
    """Propose a map for opened recordings, or for what was heard of a running graph.

    Raises:
        NoMessagesError: There is no message in them.
    """
    topics = _topics(bags)
    if not topics:
        raise NoMessagesError(f"{', '.join(path.name for path in paths)}: there is no message in it")
    return _Maker(bags, topics, paths).proposal()


def _topics(bags: Iterable[Any]) -> Tuple[_Topic, ...]:
    found: Dict[str, _Topic] = {}
    for bag in bags:
        for topic in bag.topics:
            entries = bag.entries(topic.name)
            if not len(entries) or topic.name in found:
                continue
            times: Any = np.array([entry[0] for entry in entries], np.int64)
            publishers = bag.publishers(topic.name) if hasattr(bag, "publishers") else ()
            found[topic.name] = _Topic(topic.name, topic.kind, times, *_first(bag, entries[0]), publishers)
    return tuple(found[name] for name in sorted(found))


def _first(bag: Any, entry: Any) -> Tuple[Any, str, bool]:
    """Return a message, why it cannot be read, and whether it is damaged."""
    try:
        return bag.message(entry), "", False
    except MessageError as error:
        return None, str(error), not isinstance(error, UndecodableError)


def _read(bag: Any, entry: Any) -> Any:
    try:
        return bag.message(entry)
    except Exception:  # noqa: BLE001  (a topic whose messages cannot be read is no source of readings)
        return None


class _Maker:
    """Makes a proposal."""

    def __init__(self, bags: Sequence[Any], topics: Tuple[_Topic, ...], paths: Sequence[Path]) -> None:
        self._bags, self._topics, self._paths = bags, topics, paths
        self._start_ns = min(int(topic.times_ns[0]) for topic in topics)
        self._end_ns = max(int(topic.times_ns[-1]) for topic in topics)
        self.found: List[str] = []
        self.scripted: List[str] = []
        self.modes: List[str] = []
        self.armed_s: Optional[float] = None
        self.in_the_air = False
        self._ground_m: Optional[float] = None
        self._blind = False  # on the ground the range finder sees nothing
        self._level_s = -1e6  # when the autopilot first tells how full its battery is
        self._estimate_hz: Optional[float] = None
        self._imu_s = 0.0  # between two of its messages
        self._mapped: List[_Topic] = []
        status = [topic for topic in topics if topic.kind == "amaze_autonomy/AutopilotStatus"]
        self._autopilot: Optional[_Topic] = status[0] if status else None
        self._flown = self._in_the_air()
        self._looks_down, self._distance, self._unit_m = self._ranging()

    def proposal(self) -> Proposal:
        components, readings, statuses = self._components(), self._readings(), self._statuses()
        self.found += self._cns() + self._with_others([*components, *readings])
        self.found += self._unwatched([*components, *readings])
        if not (self._mapped or readings or statuses):
            self.found.append(self._no_vehicle())
        unread = [(f"{each.name}: cannot be read ({each.wrong})", each.damaged) for each in self._topics if each.wrong]
        problems = (*problems_of(self._bags), *(words for words, damaged in unread if damaged))
        self.found[:0] = problems
        self.found += [words for words, damaged in unread if not damaged]
        rest = self._state_estimation() + self._landing() + self._script()
        self.found = [_decoded(text) for text in self.found]
        names = _decoded(", ".join(path.name for path in self._paths)[:300])
        lines = [f"about: {json.dumps(f'{names}, proposed by amaze-replay map')}", ""]
        lines += ["# What was found:"] + [f"#   {text}" for text in self.found or ["no flight: nothing tells of it"]]
        lines += ["# What no topic tells, so that the script plays it: " + (", ".join(self.scripted) or "nothing"), ""]
        lines += ["components:" + ("" if components else " {}"), *components, ""]
        lines += ["readings:" + ("" if readings else " {}"), *readings, ""]
        lines += ["statuses:", *statuses, ""] if statuses else []
        kinds = tuple((topic.name, topic.kind) for topic in self._topics)
        return Proposal("\n".join([*lines, *rest]) + "\n", tuple(self.found), tuple(self.scripted), kinds, problems)

    def _no_vehicle(self) -> str:
        """Return that none of the topics is one that a vehicle has, and what to do."""
        kinds = sorted({topic.kind for topic in self._topics})
        more = f" and {len(kinds) - _KINDS_NAMED} more" if len(kinds) > _KINDS_NAMED else ""
        return (
            f"no vehicle: no topic tells of sensors or an autopilot ({', '.join(kinds[:_KINDS_NAMED])}{more}); name "
            "the recording of a vehicle, or write a map by hand (docs/replay.md, Writing a topic map)"
        )

    def _with_others(self, lines: Sequence[str]) -> List[str]:
        """Return what is said of topics of the map that have more than one publisher."""
        said = []
        for topic in self._topics:
            if len(topic.publishers) > 1 and any(f"{{topic: {topic.name}," in line for line in lines):
                alike = len({kind for _, kind in topic.publishers}) == 1
                names = ", ".join(node if alike else f"{node} ({kind})" for node, kind in topic.publishers)
                count = "two" if len(topic.publishers) == 2 else len(topic.publishers)  # noqa: PLR2004
                taken = f"stop or rename one, taken is the rate of {topic.publishers[0][0]}"
                said.append(f"{topic.name} has {count} publishers: {names}; {taken}")
        return said

    # --- components ---------------------------------------------------------------------------------------------------

    def _components(self) -> List[str]:
        lines: List[str] = []
        for name, *row in _SENSORS:
            topic = self._sensor(name, *row)
            if topic is None:
                continue
            self._mapped.append(topic)
            health = f", autopilot: {name}" if name in _HEALTH and self._tells_health(name) else ""
            line = _component(name, topic, health)
            self.found += [] if line else [f"{topic.name} is not watched: its messages have one time, and no rate"]
            lines += line
        names: List[str] = []
        for topic in self._topics:
            if topic.kind in _CAMERAS and "compressedDepth" not in topic.name:
                name = _component_name(topic.name, names)
                names.append(name)
                lines += _component(name, topic)
        return lines

    def _sensor(self, name: str, kinds: Sequence[str], good: Sequence[str], bad: Sequence[str]) -> Optional[_Topic]:
        """Return the topic of a sensor; the range finder is the one that looks down."""
        if name == "lrf" and (self._looks_down is not None or self._those(_RANGE)):
            return self._looks_down
        topic = self._best(kinds, good, bad)
        return None if topic is not None and topic.kind == _LOG_DATA and "range" not in topic.name else topic

    def _unwatched(self, lines: Sequence[str]) -> List[str]:
        """Return the sensors and estimates beside those of the map, in a line: none of them is looked at."""
        kinds = {kind: name for name, those, _, _ in _SENSORS for kind in those if kind != _LOG_DATA}
        kinds.update((kind, "estimate") for kind, _, _ in _ESTIMATES)
        others = [topic for topic in self._those(tuple(kinds)) if not _is_command(topic)]
        left = [topic for topic in others if not any(f"{{topic: {topic.name}," in line for line in lines)]
        named = ", ".join(f"{topic.name} (another {kinds[topic.kind]})" for topic in left)
        return [f"not watched: {named}"] if left else []

    def _tells_health(self, name: str) -> bool:
        """Return True when the autopilot's status ever tells the health of a sensor."""
        topic = self._autopilot
        return topic is not None and any(value for _, value in self._values(topic.kind, name, topic.name, most=400))

    def _best(self, kinds: Sequence[str], good: Sequence[str], bad: Sequence[str]) -> Optional[_Topic]:
        """Return the likeliest topic of some types; of equals the one with the most messages."""
        return _likeliest(self._those(kinds), good, bad)

    def _those(self, kinds: Sequence[str]) -> List[_Topic]:
        """Return the topics of some types that have more than one message."""
        return [topic for topic in self._topics if topic.kind in kinds and len(topic.times_ns) > 1]

    # --- which of several ---------------------------------------------------------------------------------------------

    def _in_the_air(self) -> Optional[Tuple[int, int]]:
        """Return when the vehicle was first and last said to be in the air; None: nobody says it."""
        for kind, path, flying in _FLYING:
            times = [t for t, value in self._values(kind, path) if value == flying]
            if times:
                return times[0], times[-1]
        return None

    def _rises(self, topic: _Topic, paths: Sequence[str]) -> Optional[bool]:
        """Return whether the first of some fields rises in the air; None: unknown. A distance of 0 counts as none.

        Without a recorded flight it does where a distance, alone, rises above where it began, or a place moves at all.
        """
        of_path = ((path, self._values(topic.kind, path, topic.name, most=_LOOKED_AT)) for path in paths)
        read = [[(t, number(value)) for t, value in values if path != "range" or value] for path, values in of_path]
        rows = [[(t, value) for t, value in each if value is not None] for each in read]
        if self._flown is None:
            tracks = [np.array([value for _, value in each]) for each in rows if each]
            begun = [np.median(each[:10]) if len(paths) == 1 else np.percentile(each, 1) for each in tracks]
            moved = (np.percentile(each, 99) > first + _RISE_M for each, first in zip(tracks, begun))
            return True if any(moved) else None
        begin, end = self._flown
        air = [value for t, value in rows[0] if begin <= t <= end]
        ground = [value for t, value in rows[0] if not begin <= t <= end]
        return bool(np.percentile(air, 90) > np.median(ground) + _RISE_M) if air and ground else None

    def _of_the_vehicle(
        self, those: Sequence[_Topic], paths: Sequence[str], good: Sequence[str], own: str, bad: Sequence[str] = ()
    ) -> Optional[_Topic]:
        """Return the likeliest of some topics that rise with the vehicle; None: nothing says which of them is its own.

        Args:
            those: of one type.
            paths: fields, first the one that rises.
            good: words in the name that make it likelier.
            own: the word in the name of one that is taken though nothing rises.
            bad: words that make it unlikelier.
        """
        rises = {topic.name: self._rises(topic, paths) for topic in those}
        stays = [topic.name for topic in those if rises[topic.name] is False]
        words = "does not rise while the vehicle is in the air: it does not show its height, and is left out"
        self.found += [f"{name} {words}" for name in stays]
        left = [topic for topic in those if topic.name not in stays]
        risen = [topic for topic in left if rises[topic.name]]
        named = [topic for topic in left if own in topic.name.lower()]
        taken = _likeliest(risen or (left if len(left) == 1 else named), good, bad)
        names = ", ".join(topic.name for topic in left)
        if taken is None and left:
            self.found.append(
                f"{names}: none of them rises, and nothing says which shows the vehicle's height: name it"
            )
        elif taken is not None and len(risen) > 1:
            names = ", ".join(topic.name for topic in risen)
            self.found.append(f"{names}: all of them rise; taken is {taken.name}: is it the right one?")
        return taken

    # --- readings -----------------------------------------------------------------------------------------------------

    def _readings(self) -> List[str]:
        lines = self._vehicle() + self._texts() + self._imu() + self._estimate() + self._range() + self._battery()
        told = " ".join(lines) + " ".join(self._statuses())
        for fact in ("armed", "landed", "height", "battery", "mode"):
            if f"  {fact}:" not in told and "autopilot:" not in told:
                derived = fact in ("landed", "height") and "  range:" in told
                self.scripted += [] if derived else [fact]
        self.scripted += [n.replace("_", " ") for n in ("mission_planner", "data_recorder") if f"{n}:" not in told]
        return lines

    def _imu(self) -> List[str]:
        topic = self._best(("sensor_msgs/Imu",), *_SENSORS[0][2:])
        if topic is None or topic.first is None:
            return []
        self._imu_s = topic.period_s or 0.0
        v = topic.first.linear_acceleration
        size = sqrt(v.x * v.x + v.y * v.y + v.z * v.z)
        scale = next((s for s in (1.0, _G, _G / 1000) if 0.7 * _G < size * s < 1.3 * _G), 1.0)  # m/s^2, g, thousandths
        more = "" if scale == 1.0 else f", scale: {scale:.8g}"
        more += ", orientation: orientation" if _oriented(topic.first, "orientation") else ""
        return [f"  imu: {{topic: {topic.name}, turn_rate: angular_velocity{more}}}"]

    def _estimate(self) -> List[str]:
        for kind, source, height in _ESTIMATES:
            those = [topic for topic in self._those((kind,)) if not _is_command(topic)]
            paths = [height, f"{height[:-1]}x", f"{height[:-1]}y"]
            good = ("local_position", "odom", "estimate", "pose")
            topic = self._of_the_vehicle(those, paths, good, _OWN_ESTIMATE)
            if topic is not None:
                oriented = _oriented(topic.first, height.replace("position.z", "orientation"))
                lines = [f"  estimate: {{topic: {topic.name}, source: {source}}}"] if oriented else []
                self._estimate_hz = 1.0 / topic.period_s if oriented and topic.period_s else None
                heights = self._numbers(topic, height)
                if heights and max(heights) > min(heights):  # a height that never changes is none
                    self._flies_from_the_beginning(heights)
                    lines.append(f"  height: {{topic: {topic.name}, height: {height}{self._offset(topic, height)}}}")
                return lines
        return self._plain_height()

    def _plain_height(self) -> List[str]:
        """Return a height that comes by itself, else that of the GPS; one that never rises is none."""
        for kinds, path, words, rise_m in _HEIGHTS:
            topic = self._best(kinds, words, _NOT_ESTIMATED)
            if topic is None or not any(word in topic.name for word in words):
                continue
            above_takeoff = path != _GPS_ALTITUDE
            values = [(t, number(value)) for t, value in self._values(topic.kind, path, topic.name)]
            heights = [(t, value) for t, value in values if value is not None]
            first = heights[0][1] if heights else 0.0
            if not heights or max(value for _, value in heights) < first + rise_m:
                continue
            if min(value for _, value in heights) < first - rise_m:  # it begins in the air
                return [f"  height: {{topic: {topic.name}, height: {path}}}"] if above_takeoff else []
            away = self._lift_off(heights, first + _RISE_M, "height" if above_takeoff else "altitude of the GPS")
            before = [value for t, value in heights if away is not None and t < away - _S]
            ground_m = max(before, default=first)  # what wanders stays at or below 0 while it stands
            offset = "" if above_takeoff and abs(first) < 0.5 else f", offset_m: {-ground_m:.3f}"  # noqa: PLR2004
            return [f"  height: {{topic: {topic.name}, height: {path}{offset}}}"]
        return []

    def _offset(self, topic: _Topic, path: str) -> str:
        """Return the offset that makes the first height 0, where it begins on the ground and is not there already."""
        first = number(getter(path)(topic.first)) if topic.first is not None else None
        if first is None or abs(first) < 0.5 or not self._begins_on_ground():  # noqa: PLR2004
            return ""
        return f", offset_m: {-first:.3f}"

    def _begins_on_ground(self) -> bool:
        armed = self._values("mavros_msgs/State", "armed")
        landed = self._values("mavros_msgs/ExtendedState", "landed_state")
        return bool((armed and not armed[0][1]) or (landed and landed[0][1] == 1))

    def _numbers(self, topic: _Topic, path: str) -> List[float]:
        values = [number(value) for _, value in self._values(topic.kind, path, topic.name, most=400)]
        return [value for value in values if value is not None]

    def _flies_from_the_beginning(self, heights: Sequence[float]) -> None:
        """Note a height that begins above the ground and ends on it."""
        if heights[0] > _ALOFT_M and abs(heights[-1]) < min(_ALOFT_M, 0.5 * heights[0]):
            self.in_the_air = True
            self.found.append(f"in the air from the start: from {heights[0]:.1f} m to {heights[-1]:.1f} m at the end")

    def _ranging(self) -> Tuple[Optional[_Topic], str, float]:
        """Return the topic that looks down, the field of the distance, and metres in its unit."""
        those = self._those(_RANGE)
        if those:
            topic = self._of_the_vehicle(those, ["range"], _SENSORS[4][2], _LOOKS_DOWN, _SENSORS[4][3])
            return topic, "range", 1.0
        topic = self._best(("mavlink/DISTANCE_SENSOR",), (), ())
        if topic is not None:
            return topic, "current_distance", 0.01
        log = next((t for t in self._topics if t.kind == _LOG_DATA and "range" in t.name and t.first is not None), None)
        near = [n for n, v in enumerate(log.first.values) if 0 < v < _NEAR_MM] if log is not None else []
        return (log, f"values[{near[-1]}]", 0.001) if near else (None, "", 1.0)

    def _range(self) -> List[str]:
        topic, path, scale = self._looks_down, self._distance, self._unit_m
        if topic is None:
            return []
        distances = [(t, number(value)) for t, value in self._values(topic.kind, path, topic.name)]
        told = [(t, value * scale) for t, value in distances if value is not None]
        metres = [
            (t, value) for t, value in told if path != "range" or value > 0.0
        ]  # 0 m: nothing seen; 0 cm may be near
        self._blind = bool(told) and (not metres or metres[0][0] > told[0][0] + _S)
        self._ground_m = metres[0][1] if metres and not self._blind and 0.0 <= metres[0][1] < _MOUNTED_M else None
        if self._blind:
            to_do = "measure mounting_height_m and min_range_m, below which it sees nothing"
            self.found.append(f"{topic.name} begins with 0, which is no distance: {to_do}")
        elif self._ground_m is None and self._autopilot is not None:
            self.found.append(f"{topic.name} begins with what is no distance to the ground: it is left out")
            return []
        if self._blind or self._ground_m is not None:
            self._lift_off(metres, (self._ground_m or 0.0) + _RISE_M)
        field = "" if path == "range" else f', distance: "{path}"'
        return [f"  range: {{topic: {topic.name}{field}{'' if scale == 1.0 else f', scale: {scale:g}'}}}"]

    def _lift_off(self, metres: Sequence[Tuple[int, float]], above_m: float, by: str = "range") -> Optional[int]:
        """Find where a range or height leaves the ground; a recording that tells no arming is selected by that."""
        triples = zip(metres, metres[1:], metres[2:])
        away = next((t for (t, one), (_, two), (_, three) in triples if min(one, two, three) > above_m), None)
        if away is not None:
            self.found.append(f"lift-off by the {by}: {self._seconds(away):+.1f} s")
            self.armed_s = self._seconds(away) - _ARMED_BEFORE_S if self.armed_s is None else self.armed_s
        return away

    def _battery(self) -> List[str]:
        if self._autopilot is not None:
            fields = "fraction: battery_fraction, voltage: battery_voltage"
            levels = self._values(self._autopilot.kind, "battery_fraction", self._autopilot.name)
            self._level_s = next((self._seconds(t) for t, value in levels if number(value) is not None), self._level_s)
            return [f"  battery: {{topic: {self._autopilot.name}, {fields}}}"]
        topic = self._best(("sensor_msgs/BatteryState",), ("battery",), ())
        if topic is None or topic.first is None:
            return []
        level = number(topic.first.percentage)
        if level is None or level < 0.0:
            self.found.append(f"{topic.name} tells no level ({topic.first.percentage}): the battery is scripted")
            return []
        scale = ", scale: 0.01" if level > 1.0 else ""
        volts = number(topic.first.voltage)
        return [
            f"  battery: {{topic: {topic.name}, fraction: percentage{scale}{', voltage: voltage' if volts else ''}}}"
        ]

    def _vehicle(self) -> List[str]:
        if self._autopilot is not None:
            return self._by_status(self._autopilot)
        lines: List[str] = []
        state = self._best(("mavros_msgs/State",), ("state",), ())
        if state is not None:
            lines.append(f"  armed: {{topic: {state.name}, armed: armed}}")
            changes = _changes(self._values(state.kind, "armed", state.name))
            self._tell("armed", [(t, "armed" if value else "disarmed") for t, value in changes])
            arming = [self._seconds(t) for (t, value) in changes if value]
            self.armed_s = arming[0] - (state.period_s or 0.0) if arming else None  # it was armed since the word before
            modes = _changes(self._values(state.kind, "mode", state.name))
            self._tell("flight mode", [(t, str(value)) for t, value in modes])
            flown = self._flown_mode(changes, self._values(state.kind, "mode", state.name))
            self.modes = [flown] if flown else []
            mission = f", mission: [{flown}]" if flown else ""
            lines.append(f"  mode: {{topic: {state.name}, mode: mode{mission}}}")
            if any(str(value) in _PX4_MODES or str(value).startswith("AUTO.") for _, value in modes):
                told = f"failsafe: system_status, on: [{_CRITICAL}, {_CRITICAL + 1}]"  # ArduPilot's means less
                lines.append(f"  failsafe: {{topic: {state.name}, {told}}}")
        extended = self._best(("mavros_msgs/ExtendedState",), (), ())
        if extended is not None:
            changes = _changes(self._values(extended.kind, "landed_state", extended.name))
            words = {0: "unknown", 1: "on the ground", 2: "in the air", 3: "taking off", 4: "landing"}
            self._tell("landed", [(t, words.get(int(value), str(value))) for t, value in changes])
            lines.append(f"  landed: {{topic: {extended.name}, landed: landed_state, on_ground: [1], unknown: [0]}}")
        return lines

    def _texts(self) -> List[str]:
        topic = self._best(_TEXTS, ("recv",), ("send",))
        if topic is None:
            single = [each for each in self._topics if each.kind in _TEXTS]  # also one text is worth a line
            topic = single[0] if single else None
        return [] if topic is None else [f"  texts: {{topic: {topic.name}, severity: severity}}"]

    def _by_status(self, topic: _Topic) -> List[str]:
        """Tell of the flight by the autopilot's own status, which needs no readings."""
        armed = _changes(self._values(topic.kind, "armed", topic.name))
        self._tell("armed", [(t, "armed" if value else "disarmed") for t, value in armed])
        self.armed_s = next((self._seconds(t) for t, value in armed if value), None)
        words = {0: "unknown", 1: "on the ground", 2: "taking off", 3: "in the air", 4: "landing"}
        landed = _changes(self._values(topic.kind, "landed", topic.name))
        self._tell("landed", [(t, words.get(int(value), str(value))) for t, value in landed])
        modes = _changes(self._values(topic.kind, "mode", topic.name))
        self._tell("flight mode", [(t, str(value)) for t, value in modes])
        return []

    def _flown_mode(self, armed: Sequence[Tuple[int, Any]], modes: Sequence[Tuple[int, Any]]) -> str:
        """Return the mode in which it was most of the time while armed."""
        counts: Dict[str, int] = {}
        for t_ns, mode in modes:
            if next((value for t, value in reversed(armed) if t <= t_ns), False):
                counts[str(mode)] = counts.get(str(mode), 0) + 1
        return max(sorted(counts), key=lambda name: counts[name], default="")

    def _cns(self) -> List[str]:
        """Return what is made of the topics of the CNS Flight Stack, where it has flown."""
        if not any(topic.kind.startswith(CNS_PACKAGES) for topic in self._topics):
            return []
        from ..recordings.recorded_cns import said_of_cns  # noqa: PLC0415  (loads MAVLink)

        return said_of_cns([bag for bag in self._bags if hasattr(bag, "links") or hasattr(bag, "channels")])

    def _statuses(self) -> List[str]:
        found = {_STATUSES[t.kind]: t.name for t in self._topics if t.kind in _STATUSES}
        return [f"  {name}: {topic}" for name, topic in found.items()]

    # --- the rest -----------------------------------------------------------------------------------------------------

    def _state_estimation(self) -> List[str]:
        """Return what of the check of the states a slow recording could not meet."""
        rate_hz = self._estimate_hz
        slow = rate_hz is not None and rate_hz < _ESTIMATE_HZ
        keys = [f"rate_hz: {max(SLOWEST_ESTIMATE_HZ, rate_hz or 0.0):.3g}"] if slow else []
        if self._imu_s > 0.1:  # noqa: PLR2004  (ten in the window of the shipped configuration)
            keys += [f"window_s: {min(60.0, 15 * self._imu_s):.2f}", f"age_limit_s: {min(60.0, 4 * self._imu_s):.2f}"]
            keys += [f"min_samples: {max(3, min(10, int(_STILL_S / self._imu_s)))}"]
        return [f"state_estimation: {{{', '.join(keys)}}}  # as recorded", ""] if keys else []

    def _landing(self) -> List[str]:
        topic = self._looks_down
        if topic is None or (self._ground_m is None and not self._blind):
            return []
        keys = []
        if self._ground_m is not None:
            keys = [f"mounting_height_m: {self._ground_m:.3f}", f"min_range_m: {min(0.02, 0.5 * self._ground_m):.3f}"]
        period_s = topic.period_s or 0.0
        if period_s > 0.1:  # noqa: PLR2004  (three in the window of the shipped configuration)
            window_s, age_limit_s = min(LANDING_WINDOW_S, 4 * period_s), min(LANDING_AGE_S, 4 * period_s)
            keys += [f"window_s: {window_s:.2f}", f"age_limit_s: {age_limit_s:.2f}"]
        if 4 * period_s > LANDING_WINDOW_S:
            slow = f"{topic.name} comes at {1.0 / period_s:.3g} Hz, too slow to land by"
            self.found.append(f"{slow}: take a faster one for landing_detection")
        return [f"landing: {{{', '.join(keys)}}}  # measured first", ""] if keys else []

    def _begun_s(self) -> float:
        """Return when the last of the mapped sensors has begun."""
        return max((self._seconds(int(topic.times_ns[0])) for topic in self._mapped), default=0.0)

    def _script(self) -> List[str]:
        begun_s = self._begun_s()
        if self.armed_s is None or self.armed_s <= 0.0:
            begins = ["script: {begins: air}"] if self.in_the_air else []
            return begins or [f"script: {{select_at_s: {begun_s + _LATE_S:.1f}}}  # when every sensor has begun"]
        select_s, late_s = round(self.armed_s - ARMING_LEAD_NS / _S, 1), max(_LATE_S, begun_s + 0.1)
        select_s = max(select_s, round(min(self._level_s - _CHECKED_S, self.armed_s - _COMMANDED_S), 1))
        late = f", sensors_until_s: {late_s:.1f}" if select_s < late_s else ""
        words = "# So that the takeoff has been commanded when it is armed, or lifts off."
        return [words, f"script: {{select_at_s: {select_s}{late}}}"]

    def _values(self, kind: str, path: str, name: str = "", most: int = 0) -> List[Tuple[int, Any]]:
        """Return a field of the messages of a type, with times; at most so many, spread over all."""
        found: List[Tuple[int, Any]] = []
        get = getter(path)
        for bag in self._bags:
            for topic in bag.topics:
                if topic.kind != kind or (name and topic.name != name):
                    continue
                entries = bag.entries(topic.name)
                step = max(1, len(entries) // most) if most else 1
                found += _fields(bag, entries[::step], get)
        return sorted(found, key=lambda each: each[0])

    def _seconds(self, t_ns: int) -> float:
        return (t_ns - self._start_ns) / _S

    def _tell(self, what: str, changes: Sequence[Tuple[int, str]]) -> None:
        words = ", ".join(f"{word} {self._seconds(t_ns):+.1f} s" for t_ns, word in changes[:12])
        more = f" and {len(changes) - 12} more" if len(changes) > 12 else ""  # noqa: PLR2004
        self.found += [f"{what}: {words}{more}"] if changes else []


def _decoded(text: str) -> str:
    """Return a line with file names as they are shown: what is no UTF-8 in them is replaced."""
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace").replace("\n", " ")


def _is_command(topic: _Topic) -> bool:
    """Return whether a pose is where the vehicle is to be, not where it is."""
    return any(word in topic.name for word in _NOT_ESTIMATED)


def _likeliest(those: Sequence[_Topic], good: Sequence[str], bad: Sequence[str]) -> Optional[_Topic]:
    """Return the topic whose name has the most good words and no bad ones; of equals the one with most messages."""

    def likeliness(topic: _Topic) -> Tuple[int, int]:
        name = topic.name.lower()
        return sum(w in name for w in good) - 2 * sum(w in name for w in bad), len(topic.times_ns)

    return max(those, key=likeliness) if those else None


def _oriented(message: Any, path: str) -> bool:
    """Return True when an orientation is one: not all zero, and of length 1."""
    try:
        return quaternion(getter(path)(message)) is not None
    except (FieldError, AttributeError, TypeError):
        return False


def _fields(bag: Any, entries: Sequence[Any], get: Callable[[Any], Any]) -> List[Tuple[int, Any]]:
    found: List[Tuple[int, Any]] = []
    for entry in entries:
        message = _read(bag, entry)
        try:
            found += [] if message is None else [(int(entry[0]), get(message))]
        except FieldError:
            return []
    return found


def _changes(values: Sequence[Tuple[int, Any]]) -> List[Tuple[int, Any]]:
    """Return where a value is another than before, the first one included."""
    return [each for number_, each in enumerate(values) if not number_ or each[1] != values[number_ - 1][1]]


def _component(name: str, topic: _Topic, more: str = "") -> List[str]:
    """Return a component's line: the rate that it mostly has, and a silence that it never has while it works."""
    period_s = topic.period_s
    if period_s is None or period_s <= 0.0 or not isfinite(period_s):
        return []
    rate_hz = float(f"{1.0 / period_s:.3g}")
    mean_hz = (len(topic.times_ns) - 1) / max(1e-9, (int(topic.times_ns[-1]) - int(topic.times_ns[0])) / _S)
    rate_hz = float(f"{mean_hz:.3g}") if 0.5 < mean_hz / rate_hz < 2.0 else rate_hz  # noqa: PLR2004  (it pauses)
    slow = topic.name.startswith("/mavlink/")  # telemetry comes as its link lets it
    age_s = min(LONGEST_AGE_S, max(1.5 if slow else 0.3, float(f"{5.0 / rate_hz:.2g}")))
    more += ", tolerance_fraction: 0.9, rate_failed_fraction: 0.05" if slow else ""
    gap = f"  # longest gap {topic.longest_gap_s:.2f} s" if topic.longest_gap_s > age_s else ""
    return [f"  {name}: {{topic: {topic.name}, rate_hz: {rate_hz:g}, age_limit_s: {age_s:g}{more}}}{gap}"]


def _component_name(topic: str, taken: Sequence[str]) -> str:
    words = [word for word in topic.strip("/").lower().split("/") if word not in ("image_raw", "image", "compressed")]
    name = "_".join(words[-2:]) or "camera"
    name = "".join(char if char.isalnum() else "_" for char in name)
    name = name if name[0].isalpha() else f"camera_{name}"
    return name if name not in taken else f"{name}_{len(taken) + 1}"
