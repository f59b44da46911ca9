"""A folder of the CNS Flight Stack's configuration as one of ours: missions, trajectories, watchdog files.

Every line of it ends in one of three lists: translated, without a counterpart here, or assumed, since it does not say
it. The folder that is written is checked by the caller (`check-config`); nothing that is there is overwritten.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Optional, Tuple

import yaml

from amaze_autonomy.engine.rules import Severity
from amaze_autonomy.missions.csv_table import YAW_COLUMNS, Frame, Said, YawUnit, lines_of, said_in, yaw_unit_of
from amaze_autonomy.missions.errors import WaypointError

from ..paths import config_folder
from .tables import ACTIONS, AUTOPILOT_ENTITIES, UNLISTED, component_of, worst

__all__ = ["ImportFolderError", "Report", "import_folder"]

_KINDS: Mapping[str, Tuple[str, ...]] = {
    "topics": ("rate", "margin", "window_size"),
    "nodes": ("max_restart_attempts", "restart_timeout"),
    "drivers": ("check_script", "restart_script"),
}
_ONE_FLIGHT, _HOVER, _HOVER_S = "sequence_multiple_in_flight", "hover_after_mission_completion", 60.0
_OPTIONS = (_ONE_FLIGHT, _HOVER)  # of a mission, or beside the missions: of each
_MISSION_KEYS = ("description", "filepaths", "instances", "entities_actions", *_OPTIONS)
_KNOWN = {
    "topics": ("entity_id", "rate", "margin", "node_name", "window_size"),
    "nodes": ("entity_id", "max_restart_attempts", "restart_timeout"),
    "drivers": ("entity_id", "check_script", "restart_script"),
}
_SWITCH = re.compile(r"aux|land_channel|(?<![a-z])rc(?![a-z])", re.IGNORECASE)  # in the name of a key
_OUR_SWITCH = (
    "no switch lands; set land_switch.channel (from 1) and its threshold land_switch.above_us in autopilot.yaml"
)
_WAIT_S, _AGE_PERIODS, _LEAST_AGE_S, _LEAST_WINDOW = 15.0, 5.0, 0.3, 4
_FRAMES = {Frame.START_HEADING: "ahead and left of each takeoff", Frame.EAST_NORTH: "east and north"}
_UNITS = {YawUnit.DEG: "degrees", YawUnit.RAD: "radians"}
_CHECKED = (("landing_detection", "topic"), ("state_estimation", "topic"), ("state_estimation", "imu_topic"))
_AUTONOMY = """\
# Limits that nodes of the CNS Flight Stack need behind peers:=cns. Everything else: docs/configuration.md
checks:
  # seconds: the supervisor answers after its window, 10 s by default
  reply_limits_s:
    state_estimation: 12.0
  check_max_age_s: 30.0
takeoff:
  # seconds: the checks are asked again while the mission is loaded, the supervisor among them
  load_limit_s: 20.0
losses:
  # seconds: its watchdog beats once a check, 0.5 to 2 Hz
  watchdog_heartbeat_limit_s: 6.0
  # seconds: cns_peers may be started again in flight; that its sequencer is gone it says at once
  planner_status_limit_s: 5.0
"""
_AUTOPILOT = "# Its stack flies through mavros. Everything else: docs/configuration.md\nbackend: mavros\n"


class ImportFolderError(ValueError):
    """A folder cannot be imported: what is wrong, and what would be right."""


@dataclass
class Report:
    """What became of a folder.

    Args:
        translated: what it says, and what that is here.
        no_counterpart: what it says and nothing here does.
        assumed: what is here and it does not say.
    """

    translated: List[str] = field(default_factory=list)
    no_counterpart: List[str] = field(default_factory=list)
    assumed: List[str] = field(default_factory=list)

    def text(self) -> str:
        """Return it for a person."""
        parts = (("Translated", self.translated), ("No counterpart", self.no_counterpart), ("Assumed", self.assumed))
        return "\n".join(
            "\n".join((f"{title}:", *(f"  {line}" for line in lines or ["nothing"]))) for title, lines in parts
        )


def import_folder(folder: Path, output: Path) -> Report:
    """Write what a folder says as a configuration of ours.

    Args:
        folder: with the files of the CNS Flight Stack, at any depth.
        output: is made; must be empty when it is there.

    Raises:
        ImportFolderError: there is nothing to import, a file is not what it seems to be, or `output` is in use.
    """
    if not folder.is_dir():
        raise ImportFolderError(f"{folder}: is not a folder; must hold the missions and watchdog files")
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise ImportFolderError(f"{output}: is there already; name an empty or a new folder with --output")
    report = Report()
    sources = _sources(folder, report)
    for kind in ("missions", "topics"):
        if not sources[kind]:
            right = "must hold the missions and the watchdog's files"
            raise ImportFolderError(f"{folder}: no file with {kind} was found; {right}")
    components = _Components(report)
    for kind in ("topics", "nodes", "drivers"):
        for name, row in sources[kind].items():
            components.add(kind, str(name), row)
    actions = {str(name): _actions(str(name), row, report) for name, row in sources["missions"].items()}
    severities = components.judged(actions)
    files = _Files(folder, output, report)
    rows = sources["missions"].items()
    missions = dict(_mission(str(name), row, files, actions, severities, report) for name, row in rows)
    checked = _checked(components.rows, report)
    texts = {
        "missions": yaml.safe_dump({"missions": missions}, sort_keys=False),
        "sensors": yaml.safe_dump({"components": components.rows, **checked}, sort_keys=False),
        "recording": yaml.safe_dump(_recording(components.rows, checked, report), sort_keys=False),
        "autonomy": _AUTONOMY,
        "autopilot": _AUTOPILOT,
    }
    report.assumed += [
        "autonomy.yaml: limits that its nodes need (a heartbeat of 0.5 Hz, a supervisor that answers after 10 s)",
        "autopilot.yaml: the vehicle is reached through mavros",
    ]
    output.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (output / f"{name}.yaml").write_text(text, encoding="utf-8")
    files.write()
    return report


# --- files ------------------------------------------------------------------------------------------------------------


def _sources(folder: Path, report: Report) -> Dict[str, Dict[str, Any]]:
    """Return what the YAML files hold, by kind."""
    found: Dict[str, Dict[str, Any]] = {kind: {} for kind in ("missions", *_KINDS)}
    for path in sorted((*folder.rglob("*.yaml"), *folder.rglob("*.yml"))):
        name = path.relative_to(folder).as_posix()
        try:
            content = yaml.safe_load(path.read_text(encoding="utf-8"))
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ImportFolderError(f"{path}: is not YAML: {' '.join(str(error).split())}") from None
        for kind, rows in _parts(content):
            twice = next((key for key in rows if key in found[kind]), None)
            if twice is not None:
                raise ImportFolderError(f"{path}: {twice} is in another file as well; must be in one of the {kind}")
            found[kind].update(rows)
            report.translated.append(f"{name}: {len(rows)} {kind}")
        if not _parts(content):
            report.no_counterpart.append(f"{name}: neither missions nor a file of the watchdog")
            report.assumed += _switches(name, content)
        elif isinstance(content, dict) and "missions" in content:
            words = "of each mission that does not say it itself"
            report.translated += [f"{name}: {key}: {content[key]}: {words}" for key in content if key in _OPTIONS]
            _left(name, content, ("missions", *_OPTIONS), report)
    return found


def _left(where: str, row: Mapping[str, Any], known: Tuple[str, ...], report: Report) -> None:
    """Report the keys that are not known."""
    for key in (key for key in row if key not in known):
        report.assumed += _switches(where, {key: row[key]})
        if not _SWITCH.search(str(key)):
            report.no_counterpart.append(f"{where}: {key}: {row[key]}")


def _switches(where: str, content: Any) -> Iterator[str]:
    """Yield a line for each key, at any depth, that means a switch of the transmitter."""
    for key, value in content.items() if isinstance(content, dict) else ():
        if _SWITCH.search(str(key)):
            yield f"{where}: {key}: {value}: {_OUR_SWITCH}"
        else:
            yield from _switches(where, value)


def _parts(content: Any) -> List[Tuple[str, Dict[str, Any]]]:
    if not isinstance(content, dict):
        return []
    missions = content.get("missions")
    if isinstance(missions, dict):
        options = {key: content[key] for key in _OPTIONS if key in content}
        rows = {name: {**options, **row} if isinstance(row, dict) else row for name, row in missions.items()}
        return [("missions", rows)]
    found = [row for row in content.values() if isinstance(row, dict)]
    kind = next((kind for kind, keys in _KINDS.items() if any(key in row for row in found for key in keys)), None)
    return [(kind, content)] if kind is not None and len(found) == len(content) else []


class _Files:
    """Trajectories as they are copied, with what their frame is in front."""

    def __init__(self, folder: Path, output: Path, report: Report) -> None:
        self._folder, self._output, self._report = folder, output, report
        self._texts: Dict[str, str] = {}

    def take(self, mission: str, path: str) -> str:
        """Return the name that a trajectory has here."""
        parts = [part for part in Path(path).parts if part not in ("/", "..", ".")]
        name = "trajectories/" + "/".join(parts)
        if name in self._texts:
            return name
        source = self._find(parts)
        if source is None:
            raise ImportFolderError(f"{mission}: {path} is not below {self._folder}; copy its trajectories there")
        try:
            self._texts[name], words = _headed(str(source), source.read_text(encoding="utf-8-sig"))
        except UnicodeDecodeError:
            raise ImportFolderError(f"{source}: is not UTF-8; must be a trajectory as CSV") from None
        except WaypointError as error:
            raise ImportFolderError(str(error)) from None
        self._report.translated.append(f"{source.relative_to(self._folder).as_posix()}: {name}, {words}")
        return name

    def _find(self, parts: List[str]) -> Optional[Path]:
        found = [path for path in sorted(self._folder.rglob(parts[-1])) if list(path.parts[-len(parts) :]) == parts]
        return next((path for path in found if path.is_file()), None) if parts else None

    def write(self) -> None:
        """Write them."""
        for name, text in self._texts.items():
            (self._output / name).parent.mkdir(parents=True, exist_ok=True)
            (self._output / name).write_text(text, encoding="utf-8")


def _headed(file: str, text: str) -> Tuple[str, str]:
    """Return a trajectory with what it does not say of itself in front, and that in words."""
    said, (number, header) = said_in(file, text), (lines_of(text) or [(0, "")])[0]
    column = next((each for each in map(str.strip, header.split(",")) if each in YAW_COLUMNS), "yaw")
    told = said.yaw_unit is not None or YAW_COLUMNS[column] is not None
    unit = yaw_unit_of(file, number, column, said, Said(yaw_unit=None if told else YawUnit.DEG))
    frame = said.frame or Frame.START_HEADING
    front = ("" if said.frame else f"# frame: {frame.value}\n") + ("" if told else f"# yaw_unit: {unit.value}\n")
    kept = ", as it says"
    return front + text, f"{_FRAMES[frame]}{kept * bool(said.frame)}; yaw in {_UNITS[unit]}{kept * told}"


# --- missions ---------------------------------------------------------------------------------------------------------


def _actions(name: str, row: Any, report: Report) -> Dict[str, Severity]:
    """Return the severity that a mission gives to each component."""
    found: Dict[str, Severity] = {}
    for pair in (row or {}).get("entities_actions") or []:
        if not isinstance(pair, list) or len(pair) != 2 or str(pair[1]) not in ACTIONS:  # noqa: PLR2004
            raise ImportFolderError(f"{name}: entities_actions has {pair}; must be [entity, {' | '.join(ACTIONS)}]")
        found[component_of(str(pair[0]))] = ACTIONS[str(pair[1])]
        report.translated.append(f"{name}: {pair[0]}, {pair[1]}: severity {ACTIONS[str(pair[1])].value}")
    return found


def _mission(
    name: str,
    row: Any,
    files: _Files,
    actions: Mapping[str, Mapping[str, Severity]],
    severities: Mapping[str, Severity],
    report: Report,
) -> Tuple[str, Dict[str, Any]]:
    if not isinstance(row, dict) or not row.get("filepaths"):
        raise ImportFolderError(f"{name}: has no filepaths; must name its trajectories")
    number = re.fullmatch(r"mission_(\d+)", name)
    mission_id = number[1] if number else re.sub(r"[^A-Za-z0-9_-]", "-", name)[:32]
    instances = row.get("instances", 1)
    if not isinstance(instances, int) or instances < 1:
        raise ImportFolderError(f"{name}: instances is {instances!r}; must be a whole number, at least 1")
    given: Dict[str, Any] = {
        "description": str(row.get("description") or name),
        "files": [files.take(name, str(path)) for path in row["filepaths"]],
        "repetitions": instances,
    }
    own = {entity: each.value for entity, each in actions[name].items() if severities.get(entity, each) is not each}
    if own:
        given["severities"] = own
    times = "once" if instances == 1 else f"{instances} times"
    report.translated.append(f"{name}: mission {mission_id}, {len(given['files'])} files, flown {times}")
    if row.get(_ONE_FLIGHT):
        given["touchdown_between_files"] = False
        report.translated.append(f"{name}: its files are one flight")
    if row.get(_HOVER):
        given["hover_at_end_s"] = _HOVER_S
        report.assumed.append(f"{name}: hovers at its end for {_HOVER_S:g} s, unless it is landed before, and lands")
    _left(name, row, _MISSION_KEYS, report)
    if not number or not 1 <= int(mission_id) <= 255:  # noqa: PLR2004 - a byte
        report.assumed.append(f"{name}: mission {mission_id} cannot be asked of its sequencer, whose ids are 1 to 255")
    return mission_id, given


# --- components -------------------------------------------------------------------------------------------------------


class _Components:
    """Components as sensors.yaml has them, one for each entity."""

    def __init__(self, report: Report) -> None:
        self.rows: Dict[str, Dict[str, Any]] = {}
        self._report = report
        self._entities: Dict[str, str] = {}

    def add(self, kind: str, name: str, row: Mapping[str, Any]) -> None:
        """Add a topic, a node or a driver."""
        entity = str(row.get("entity_id") or name)
        component = component_of(entity)
        if self._entities.setdefault(component, entity) != entity:
            other = self._entities[component]
            raise ImportFolderError(f"{name}: the entities {entity} and {other} would both be {component}; rename one")
        here = self.rows.setdefault(component, {"group": "other", "severity": ""})
        {"topics": self._topic, "nodes": self._node, "drivers": self._driver}[kind](component, here, name, row)
        _left(name, row, _KNOWN[kind], self._report)

    def _topic(self, component: str, here: Dict[str, Any], name: str, row: Mapping[str, Any]) -> None:
        rate, margin = _number(name, "rate", row), _number(name, "margin", row)
        topic = here.setdefault("topics", {})[_absolute(name)] = {
            "rate_hz": rate,
            "tolerance_fraction": min(max(margin, 0.01), 0.9),
            "age_limit_s": round(max(_AGE_PERIODS / rate, _LEAST_AGE_S), 3),
        }
        words = f"{name}: topic of {component}, {rate:g} Hz, tolerance {topic['tolerance_fraction']:g}"
        if topic["tolerance_fraction"] != margin:
            taken = topic["tolerance_fraction"]
            self._report.assumed.append(f"{name}: margin {margin:g} is none here, {taken:g} is taken")
        most = 1.0 - topic["tolerance_fraction"]
        if most <= 0.5:  # noqa: PLR2004 - what rate_failed_fraction is otherwise
            topic["rate_failed_fraction"] = round(most / 2, 3)
            self._report.assumed.append(f"{name}: fails below {topic['rate_failed_fraction']:g} of its rate")
        if row.get("window_size") is not None:
            samples = max(_number(name, "window_size", row), _LEAST_WINDOW)
            topic["window_s"] = round(samples / rate, 3)
            words += f", window {topic['window_s']:g} s"
        self._report.translated.append(words)
        self._report.assumed.append(f"{name}: has failed after {topic['age_limit_s']:g} s of silence")
        if name.lstrip("/").startswith("mavros"):
            here["group"] = "px4"
        if row.get("node_name"):
            self._name_node(component, here, str(row["node_name"]))

    def _name_node(self, component: str, here: Dict[str, Any], node: str) -> None:
        if here.setdefault("node", _absolute(node)) != _absolute(node):
            self._report.no_counterpart.append(f"{node}: a second node of {component}; {here['node']} is watched")

    def _node(self, component: str, here: Dict[str, Any], name: str, row: Mapping[str, Any]) -> None:
        self._name_node(component, here, name)
        attempts = int(_number(name, "max_restart_attempts", row, 0.0))
        if attempts < 1 or here["node"] != _absolute(name):
            self._report.translated.append(f"{name}: node of {component}, never restarted")
            return
        self._report.translated.append(f"{name}: node of {component}")
        limit_s = min(max(_number(name, "restart_timeout", row, 5.0), 0.1), 60.0)
        here["restart"] = {
            "policy": "node",
            "attempts": min(attempts, 100),
            "attempt_limit_s": limit_s,
            "total_limit_s": round(min(attempts * (limit_s + 1.0), 600.0), 3),
        }

    def _driver(self, component: str, here: Dict[str, Any], name: str, row: Mapping[str, Any]) -> None:
        if row.get("check_script"):
            here["driver"] = [str(row["check_script"])]
            self._report.translated.append(f"{name}: driver of {component}, checked by {row['check_script']}")
        if not row.get("restart_script"):
            return
        if "restart" in here:
            self._report.no_counterpart.append(f"{name}: restart_script; {component} is restarted by its node")
            return
        here["restart"] = {"policy": "driver", "command": [str(row["restart_script"])]}

    def judged(self, actions: Mapping[str, Mapping[str, Severity]]) -> Dict[str, Severity]:
        """Give every component the worst severity that a mission has for it; return them."""
        for name in sorted({each for mission in actions.values() for each in mission}):
            if name in self.rows:
                continue
            if name in AUTOPILOT_ENTITIES:
                self.rows[name] = {"group": "px4", "severity": ""}
            else:
                missions = ", ".join(mission for mission, given in actions.items() if name in given)
                self._report.no_counterpart.append(f"{missions}: {name} is watched by no topic, node or driver")
        found: Dict[str, Severity] = {}
        for name, row in self.rows.items():
            given = tuple(mission[name] for mission in actions.values() if name in mission)
            found[name] = worst(given) if given else UNLISTED
            self._judge(name, row, found[name], listed=bool(given))
        return found

    def _judge(self, name: str, row: Dict[str, Any], severity: Severity, *, listed: bool) -> None:
        row["severity"] = severity.value
        if not listed:
            self._report.assumed.append(f"{name}: severity {severity.value}, no mission has an action for it")
        if name in AUTOPILOT_ENTITIES:
            row.update(group="px4", autopilot=AUTOPILOT_ENTITIES[name])
            self._report.assumed.append(f"{name}: the autopilot's {row['autopilot']} as well, by its name")
        if row["group"] == "px4" and row.pop("restart", None) is not None:
            self._report.no_counterpart.append(f"{name}: a restart; sensors of the autopilot are never restarted")
        restart = row.get("restart", {})
        if "command" in restart:
            self._report.translated.append(f"{name}: restarted by {restart['command'][0]}")
        elif restart:
            self._report.translated.append(f"{name}: restarted by its node, up to {restart['attempts']} times")
            self._report.assumed.append(f"{name}: roslaunch starts {row['node']} again when it ends (respawn)")
        if severity is Severity.HIGH:
            row["wait_limit_s"] = max(_WAIT_S, row.get("restart", {}).get("attempt_limit_s", 0.0))
            self._report.assumed.append(f"{name}: a flight waits {row['wait_limit_s']:g} s for it, then lands")


def _absolute(name: str) -> str:
    return "/" + name.lstrip("/")


def _number(name: str, key: str, row: Mapping[str, Any], otherwise: Optional[float] = None) -> float:
    value = row.get(key, otherwise)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < float("inf"):
        raise ImportFolderError(f"{name}: {key} is {value!r}; must be a number, not negative")
    if key == "rate" and value <= 0.0:
        raise ImportFolderError(f"{name}: rate is {value!r}; must be above 0, in Hz")
    return float(value)


def _rates(components: Mapping[str, Mapping[str, Any]]) -> Dict[str, float]:
    """Return the topics that are watched, with their rates in Hz."""
    return {topic: row["rate_hz"] for each in components.values() for topic, row in each.get("topics", {}).items()}


def _checked(components: Mapping[str, Mapping[str, Any]], report: Report) -> Dict[str, Dict[str, Any]]:
    """Return what landing detection and state estimation look at, where it is not what ships."""
    rates = _rates(components)
    found: Dict[str, Dict[str, Any]] = {}
    over_mavros = any(topic.startswith("/mavros/") for topic in rates)
    shipped, mavros = (
        yaml.safe_load(path.read_text(encoding="utf-8"))
        for path in (config_folder() / "sensors.yaml", config_folder() / "mavros" / "sensors.yaml")
    )
    for check, key in _CHECKED:
        topic, why = shipped[check][key], "which an entity watches"
        if topic not in rates and over_mavros:
            found.setdefault(check, {}).update(_looked_at(mavros[check], key))
            topic, why = mavros[check][key], "as config/mavros has it"
        elif topic not in rates:
            why = "which ships and no entity watches: name yours, and record it"
        if check == "state_estimation" and key == "topic" and topic in rates:
            found.setdefault(check, {})["rate_hz"] = rates[topic]
        report.assumed.append(f"sensors.yaml: {check}.{key}: {topic}, {why} (not with peers:=cns)")
    return found


def _looked_at(row: Mapping[str, Any], key: str) -> Dict[str, Any]:
    """Return a topic of a check, with what else is said of it: everything but its other topics."""
    if key != "topic":
        return {key: row[key]}
    return {name: value for name, value in row.items() if not name.endswith("_topic")}


def _recording(
    components: Mapping[str, Mapping[str, Any]], checked: Mapping[str, Mapping[str, Any]], report: Report
) -> Dict[str, Any]:
    looked_at = {row[key] for row in checked.values() for key in ("topic", "imu_topic") if key in row}
    topics = sorted({*_rates(components), *looked_at})
    report.assumed.append(f"recording.yaml: one computer records the {len(topics)} topics that are watched")
    return {
        "folder": "~/recordings",
        "collector": "main",
        "platforms": {"main": {"groups": ["all"]}},
        "groups": {"all": {"topics": topics}},
    }
