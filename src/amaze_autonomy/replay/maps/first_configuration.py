"""A first configuration for a stack that nobody described yet, of what a recording or a running graph shows.

The topic map that `proposal.py` proposes says which topics are sensors, at which rates; of it become `sensors.yaml`
(with the severities of the decision table that ships), `recording.yaml` (everything that was seen) and `map.yaml`.
Missions and limits are those of a careful beginning. It is meant to be looked at: `propose.txt` says what was assumed.
"""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple

import yaml

from amaze_autonomy import paths
from amaze_autonomy.config.consistency import MAVROS_TOPIC, returns_after_s, waits
from amaze_autonomy.config.reference import COMPARED, compared_parameters
from amaze_autonomy.config.schemas.autopilot import LinkSettings, PlannerLinkSettings
from amaze_autonomy.config.schemas.sensors import LONGEST_AGE_S
from amaze_autonomy.files import is_unused, whole_folder

from ..errors import ReplayError
from .proposal import Proposal

_HEAD = "# Proposed by amaze-autonomy propose-config of what was seen: look at it. Every key: docs/configuration.md\n"
_OURS = (
    "~journal",
    "~state",
    "watchdog/action",
    "watchdog/info",
    "mission_planner/status",
    "data_recorder/status",
    "autopilot/status",
    "landing_detection/landed",
    "/diagnostics",
    "/rosout",
)
_PX4 = ("gps", "imu", "magnetometer", "barometer")
_VEHICLE = ("/px4/", "/mavlink/", "/fmu/")  # besides mavros
_NO_TOPICS = "/mavlink/"  # messages of a telemetry log
_HOP = "trajectories/hop.csv"
_WAITS_S = 10.0
_UNWAITED: Mapping[str, str] = {"moderate": "low", "high": "highest"}  # what is done after a wait in vain, at once
_SEVERITY = "moderate"  # of what the decision table that ships does not know
_RANGES: Mapping[str, str] = {"sensor_msgs/Range": "range", "sensor_msgs/LaserScan": "scan"}
_POSE = "geometry_msgs/PoseStamped"
_CAMERAS = ("sensor_msgs/Image", "sensor_msgs/CompressedImage", "sensor_msgs/PointCloud2")
_TOPIC_KEYS = ("rate_hz", "age_limit_s", "tolerance_fraction", "rate_failed_fraction")


class FirstConfigurationError(ReplayError):
    """Nothing can be proposed of what was seen; says what would be needed."""


def write_configuration(proposal: Proposal, output: Path) -> Tuple[str, ...]:
    """Write a configuration and the topic map, all or nothing; return what was assumed, one line each.

    Raises:
        FirstConfigurationError: Nothing that was seen is a sensor, or the folder is not empty.
        OSError: It cannot be written.
    """
    if not is_unused(output):
        raise FirstConfigurationError(f"{output}: is there already; name an empty or a new folder with --output")
    maker = _Maker(proposal)
    texts = maker.texts()
    texts[_HOP] = (paths.config_folder() / "mavros" / _HOP).read_text(encoding="utf-8")
    texts["propose.txt"] = "\n".join(maker.assumed) + "\n"
    with whole_folder(output) as part:
        (part / _HOP).parent.mkdir()
        for name, text in texts.items():
            (part / name).write_text(text, encoding="utf-8")
    return tuple(maker.assumed)


class _Maker:
    """Makes the files."""

    def __init__(self, proposal: Proposal) -> None:
        found = yaml.safe_load(proposal.text)
        self._map, self._text = found, proposal.text
        self._kinds = {name: kind for name, kind in proposal.kinds if not name.startswith(_NO_TOPICS)}
        others = [
            kind for kind in self._kinds.values() if not kind.startswith("amaze_autonomy/")
        ]  # what is made of them
        self._is_mavlink = len(self._kinds) < len(proposal.kinds) and not others
        self._readings: Mapping[str, Any] = found.get("readings") or {}
        self._table: Mapping[str, Any] = _decision_table()
        matches = (MAVROS_TOPIC.fullmatch(topic) for topic in sorted(self._kinds))
        several = Counter(match[1] for match in matches if match is not None).most_common()
        self._mavros, *self._other_mavros = [name for name, _ in several] or [""]
        self.assumed: List[str] = [f"found: {line}" for line in proposal.found]

    def texts(self) -> Dict[str, str]:
        """Return the files by their names."""
        rows = (self._map.get("components") or {}).items()
        components = {name: self._component(name, row) for name, row in rows if row["topic"] in self._kinds}
        if not components and self._is_mavlink:
            raise FirstConfigurationError(
                "these are messages of MAVLink, no ROS topics, and only those can be watched: name a bag of the ROS "
                "graph; to replay this recording, `amaze-replay map` proposes a topic map"
            )
        if not components:
            raise FirstConfigurationError(
                "no sensor was seen that keeps a rate: let the drivers run, and record or look for ten seconds"
            )
        sensors = {"components": components, "landing_detection": self._landing(), **self._states()}
        self.assumed += [f"autopilot.yaml: the vehicle is reached {self._way()}", COMPARED]
        self.assumed.append("missions.yaml: one short mission to begin with, up, once around, down")
        return {
            "sensors.yaml": _written(sensors),
            "recording.yaml": _written(self._recording()),
            "missions.yaml": _written(
                {
                    **({"planner": {"message_retry_s": 1.0, "transfer_limit_s": 30.0}} if self._mavros else {}),
                    "missions": {"1": {"description": "Up, once around, down", "files": [_HOP]}},
                }
            ),
            "autonomy.yaml": _written({"takeoff": {"load_limit_s": 35.0}} if self._mavros else {}),
            "autopilot.yaml": self._vehicle(),
            "map.yaml": self._text,
        }

    def _vehicle(self) -> str:
        """Return autopilot.yaml."""
        links = {"link": {"url": LinkSettings().url}, "planner_link": {"url": PlannerLinkSettings().url}}
        through_mavros = {"backend": "mavros", "mavros": self._mavros}
        return f"{_written(through_mavros if self._mavros else links)}\n{compared_parameters()}"

    def _way(self) -> str:
        """Return how the vehicle is reached, in words."""
        if not self._mavros:
            return "over MAVLink; its address is in autopilot.yaml, link.url and planner_link.url"
        others = " and ".join(self._other_mavros)
        which = f"; seen was {others}, too: is it the right one?" if others else ""
        return f"through mavros at {self._mavros}{which}"

    def _component(self, name: str, row: Mapping[str, Any]) -> Dict[str, Any]:
        topic = str(row["topic"])
        known = _table_row(name, topic, self._table)
        found = self._table.get(known, {})
        severity = str(found.get("severity", _SEVERITY))
        ours = name in _PX4 and (topic.startswith(_VEHICLE) or MAVROS_TOPIC.fullmatch(topic) is not None)
        topics = {topic: {key: row[key] for key in _TOPIC_KEYS if key in row}}
        severity, wait, waited = _waited(severity, found.get("wait_limit_s", _WAITS_S), topics)
        values = {"group": "px4" if ours else "other", "severity": severity, **wait, "topics": topics}
        rate = f"{row['rate_hz']:g} Hz, fails after {row['age_limit_s']:g} s"
        like = f", as {known} of the decision table" if known else ", as what no decision table knows"
        why = "" if known == name else like
        self.assumed.append(f"{name}: {topic}, {rate}; severity {severity}{waited}{why}")
        return values

    def _reading(self, name: str) -> Any:
        """Return a reading of the map that is a topic; None: there is none."""
        reading = self._readings.get(name)
        return reading if reading is not None and reading["topic"] in self._kinds else None

    def _landing(self) -> Dict[str, Any]:
        reading = self._reading("range")
        source = None if reading is None else _RANGES.get(self._kinds.get(str(reading["topic"]), ""))
        if reading is not None and source is not None:
            self.assumed.append(f"landing_detection: {reading['topic']}; measure mounting_height_m")
            scale = {"scale": reading["scale"]} if "scale" in reading else {}
            return {"topic": reading["topic"], "source": source, **scale, **(self._map.get("landing") or {})}
        pose = self._own_pose()
        if pose is None:
            others = " or ".join(name for name, kind in sorted(self._kinds.items()) if kind == _POSE)
            unsure = (
                f"no range finder; a height is in {others}, and nothing says that it is the vehicle's, 0 on the ground"
            )
            nothing = "nothing that was seen looks at the ground"
            self.assumed.append(f"landing_detection: {unsure if others else nothing}: name its topic")
            return {}
        self.assumed.append(f"landing_detection: no range finder; the height of {pose}, 0 on the ground")
        return {
            "topic": pose,
            "source": "pose",
            "mounting_height_m": 0.0,
            "ground_distance_m": 0.4,
            "airborne_distance_m": 0.7,
        }

    def _own_pose(self) -> Optional[str]:
        """Return the topic of a pose that is the vehicle's own; of a command 0 is wherever the vehicle is."""
        readings = (self._reading(name) for name in ("height", "estimate"))
        own = [str(reading["topic"]) for reading in readings if reading is not None]
        own += [f"{self._mavros}/local_position/pose"] if self._mavros else []
        return next((name for name in own if self._kinds.get(name) == _POSE), None)

    def _states(self) -> Dict[str, Any]:
        estimate, imu = (self._reading(name) for name in ("estimate", "imu"))
        values: Dict[str, Any] = {"topic": "", "imu_topic": str(imu["topic"]) if imu is not None else ""}
        if estimate is not None:
            values.update(topic=estimate["topic"], source=estimate["source"])
            values.update(self._map.get("state_estimation") or {})
        if estimate is None and imu is None:
            self.assumed.append("state_estimation: neither an estimate nor an IMU was seen: name one of them")
            return {}
        if imu is not None and "scale" in imu:
            self.assumed.append(
                f"state_estimation: {imu['topic']} is not in m/s^2: its driver must be, to be looked at"
            )
            values["imu_topic"] = ""
        self.assumed.append(f"state_estimation: {values['topic'] or 'no estimate, the IMU alone'}")
        return {"state_estimation": values}

    def _recording(self) -> Dict[str, Any]:
        ours = {f"/{topic.lstrip('/')}" for topic in _OURS}
        seen = sorted(name for name, kind in self._kinds.items() if name not in ours and not kind.startswith("amaze_"))
        cameras = [name for name in seen if self._kinds[name] in _CAMERAS]
        groups = {"states": list(_OURS), "seen": [name for name in seen if name not in cameras], "cameras": cameras}
        groups = {name: topics for name, topics in groups.items() if topics}
        self.assumed.append(f"recording.yaml: one computer records all {len(seen)} topics that were seen, and ours")
        return {
            "folder": "~/amaze_recordings",
            "collector": "main",
            "platforms": {"main": {"groups": list(groups)}},
            "groups": {name: {"topics": topics} for name, topics in groups.items()},
        }


def _waited(severity: str, wait_s: float, topics: Mapping[str, Any]) -> Tuple[str, Dict[str, float], str]:
    """Return the severity of topics, their wait, and words: none is shorter than what they need to be back."""
    if not waits(severity):
        return severity, {}, ""
    needed_s = returns_after_s(topics)
    if needed_s < wait_s:
        return severity, {"wait_limit_s": wait_s}, ""
    wait_s = float(math.ceil(needed_s + _WAITS_S))
    if wait_s > LONGEST_AGE_S:
        return _UNWAITED[severity], {}, ", too slow to be waited for"
    return severity, {"wait_limit_s": wait_s}, f", a flight waits {wait_s:g} s for it"


def _decision_table() -> Mapping[str, Any]:
    """Return the rows of the decision table that ships, by their names."""
    found = yaml.safe_load((paths.config_folder() / "sensors.yaml").read_text(encoding="utf-8"))
    return dict(found["components"])


def _table_row(name: str, topic: str, table: Mapping[str, Any]) -> str:
    """Return the name of the row that a component is: that of its name, topic or node; empty: there is none."""
    if name in table:
        return name
    of_topic = (known for known, row in table.items() if topic in row.get("topics", ()))
    of_node = (known for known, row in table.items() if "node" in row and topic.startswith(f"{row['node']}/"))
    return next(of_topic, next(of_node, ""))


def _written(values: Mapping[str, Any]) -> str:
    return _HEAD + (yaml.safe_dump(dict(values), sort_keys=False) if values else "{}\n")
