"""A folder of the CNS Flight Stack's configuration as one of ours: missions, trajectories, watchdog files.

Every line of it ends in one of three lists: translated, without a counterpart here, or assumed, since it does not say
it. The folder that is written is checked by the caller (`check-config`); nothing that is there is overwritten.
"""

from __future__ import annotations

import glob
import math
import re
import shlex
from pathlib import Path
from typing import Any, Dict, List, Mapping, Set, Tuple

import yaml

from amaze_autonomy.config.consistency import returns_after_s, waits
from amaze_autonomy.config.reference import COMPARED, compared_parameters
from amaze_autonomy.config.schemas.sensors import LONGEST_AGE_S
from amaze_autonomy.engine.rules import Limits, Severity
from amaze_autonomy.files import is_unused, whole_folder
from amaze_autonomy.missions.csv_table import YAW_COLUMNS, Frame, Said, YawUnit, lines_of, said_in, yaw_unit_of
from amaze_autonomy.missions.errors import WaypointError
from amaze_autonomy.monitoring.specs import RestartSpec

from ..paths import config_folder
from .folder import (
    ENTITY,
    HOVER,
    KINDS,
    MISSIONS,
    ONE_FLIGHT,
    ImportFolderError,
    Report,
    Row,
    parts_of,
    read_folder,
    report_left,
)
from .tables import ACTIONS, AUTOPILOT_ENTITIES, UNLISTED, component_of, worst

__all__ = ["ImportFolderError", "Report", "import_folder"]

_HOVER_S = 60.0
_MISSION_KEYS = ("description", "filepaths", "instances", "entities_actions", ONE_FLIGHT, HOVER)
_WAIT_S, _AGE_PERIODS, _LEAST_AGE_S, _LEAST_WINDOW = 15.0, 5.0, 0.3, 4
_ATTEMPT_S, _FIX_S = RestartSpec().attempt_limit_ns / 1e9, Limits().preflight_fix_limit_ns / 1e9
_FRAMES = {Frame.START_HEADING: "ahead and left of each takeoff", Frame.EAST_NORTH: "east and north"}
_UNITS = {YawUnit.DEG: "degrees", YawUnit.RAD: "radians"}
_CHECKED = (("landing_detection", "topic"), ("state_estimation", "topic"), ("state_estimation", "imu_topic"))
_INITIALISATION = (
    "sensors.yaml: no estimator is initialised, as its engine does by default before its checks: name the service "
    "(/ESTIMATOR/init_service) as initialisation.service, with initialisation.type: set_bool"
)
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
failsafe:
  # seconds: its watchdog beats once a check, 0.5 to 2 Hz
  watchdog_heartbeat_limit_s: 6.0
  # seconds: cns_peers may be started again in flight; that its sequencer is gone it says at once
  planner_status_limit_s: 5.0
"""
_AUTOPILOT = "# Its stack flies through mavros. Everything else: docs/configuration.md\nbackend: mavros\n\n"


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
    if not is_unused(output):
        raise ImportFolderError(f"{output}: is there already; name an empty or a new folder with --output")
    report, folder = Report(), folder.resolve()
    sources = read_folder(folder, report)
    components = _Components(report)
    for kind in KINDS:
        for row in sources[kind].values():
            components.add(kind, row)
    rows = tuple(sources[MISSIONS].values())
    ids, actions = _ids(rows), {row.name: _actions(row, report) for row in rows}
    severities = components.judged(actions)
    files = _Files(folder, report)
    missions = {ids[row.name]: _mission(row, ids[row.name], files, report) for row in rows}
    for row in rows:
        own = {name: each.value for name, each in actions[row.name].items() if severities.get(name, each) is not each}
        missions[ids[row.name]].update({"severities": own} if own else {})
    checked = _checked(components.rows, report)
    texts = {
        "missions": yaml.safe_dump({"missions": missions}, sort_keys=False),
        "sensors": yaml.safe_dump({"components": components.rows, **checked}, sort_keys=False),
        "recording": yaml.safe_dump(_recording(components.rows, checked, report), sort_keys=False),
        "autonomy": _AUTONOMY + _unlisted_wait(components.rows, missions, report),
        "autopilot": _AUTOPILOT + compared_parameters(),
    }
    report.assumed += [
        "autonomy.yaml: limits that its nodes need (a heartbeat of 0.5 Hz, a supervisor that answers after 10 s)",
        "autopilot.yaml: the vehicle is reached through mavros",
        COMPARED,
    ]
    with whole_folder(output) as part:
        for name, text in texts.items():
            (part / f"{name}.yaml").write_text(text, encoding="utf-8")
        files.write(part)
    return report


# --- files ------------------------------------------------------------------------------------------------------------


class _Files:
    """Trajectories as they are copied, with what their frame is in front."""

    def __init__(self, folder: Path, report: Report) -> None:
        self._folder, self._report = folder, report
        self._texts: Dict[str, str] = {}

    def take(self, row: Row, path: str) -> str:
        """Return the name that a trajectory has here."""
        name = "trajectories/" + "/".join(parts_of(path))
        if name in self._texts:
            return name
        source = self._find(row, path)
        try:
            self._texts[name], words = _headed(str(source), source.read_text(encoding="utf-8-sig"))
        except UnicodeDecodeError:
            raise ImportFolderError(f"{source}: is not UTF-8; must be a trajectory as CSV") from None
        except WaypointError as error:
            raise ImportFolderError(str(error)) from None
        self._report.translated.append(f"{self._named(source)}: {name}, {words}")
        return name

    def _named(self, source: Path) -> str:
        """Return its path below the folder, or its whole path when it is elsewhere."""
        inside = self._folder in source.parents
        return (source.relative_to(self._folder) if inside else source).as_posix()

    def _find(self, row: Row, path: str) -> Path:
        """Return the one file that a path means: where it says, else at any depth below the folder."""
        parts = parts_of(path)
        direct = self._folder.joinpath(*parts)
        given = Path(path) if Path(path).is_absolute() else direct
        if given.is_file():
            return given
        found = [each for each in sorted(self._folder.rglob(glob.escape(parts[-1]))) if each.is_file()]
        found = [each for each in found if list(each.parts[-len(parts) :]) == parts]
        if not found:
            row.refuse(f"filepaths has {path!r}, which is not there", f"copy it to {direct}")
        if len({each.read_bytes() for each in found}) > 1:
            names = " and ".join(map(self._named, found))
            row.refuse(f"filepaths has {path!r}, which is {names}", "must say which")
        return found[0]

    def write(self, output: Path) -> None:
        """Write them into a folder."""
        for name, text in self._texts.items():
            (output / name).parent.mkdir(parents=True, exist_ok=True)
            (output / name).write_text(text, encoding="utf-8")


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


def _ids(rows: Tuple[Row, ...]) -> Dict[str, str]:
    """Return the id that each mission has here, by its name there."""
    names: Dict[str, str] = {}
    for row in rows:
        number = re.fullmatch(r"mission_(\d+)", row.name)
        mission_id = str(int(number[1])) if number else re.sub(r"[^A-Za-z0-9_-]", "-", row.name)[:32]
        other = names.setdefault(mission_id, row.name)
        if other != row.name:
            row.refuse(f"would be mission {mission_id}, as {other} is", "rename one")
    return {name: mission_id for mission_id, name in names.items()}


def _actions(row: Row, report: Report) -> Dict[str, Severity]:
    """Return the severity that a mission gives to each component."""
    found: Dict[str, Severity] = {}
    words = f"[entity, {' | '.join(ACTIONS)}]"
    for pair in row.items("entities_actions", f"must be a list of {words}"):
        if not isinstance(pair, list) or len(pair) != 2 or isinstance(pair[0], (dict, list)):  # noqa: PLR2004
            row.refuse(f"entities_actions has {pair}", f"must be {words}")
        entity, action = map(str, pair)
        component = component_of(entity)
        if action not in ACTIONS:
            row.refuse(f"entities_actions has {pair}", f"must be {words}")
        if component in found:
            row.refuse(f"entities_actions has {entity}, which is {component} a second time", "must have it once")
        found[component] = ACTIONS[action]
        report.translated.append(f"{row.name}: {entity}, {action}: severity {ACTIONS[action].value}")
    return found


def _mission(row: Row, mission_id: str, files: _Files, report: Report) -> Dict[str, Any]:
    name, instances, paths = row.name, row.count("instances"), row.trajectories()
    given: Dict[str, Any] = {
        "description": row.text("description") or name,
        "files": [files.take(row, path) for path in paths],
        "repetitions": instances,
    }
    times = "once" if instances == 1 else f"{instances} times"
    report.translated.append(f"{name}: mission {mission_id}, {len(paths)} files, flown {times}")
    if row.flag(ONE_FLIGHT):
        given["touchdown_between_files"] = False
        report.translated.append(f"{name}: its files are one flight")
    if row.flag(HOVER):
        given["hover_at_end_s"] = _HOVER_S
        report.assumed.append(f"{name}: hovers at its end for {_HOVER_S:g} s, unless it is landed before, and lands")
    report_left(name, row.values, _MISSION_KEYS, report)
    if not mission_id.isdigit() or not 1 <= int(mission_id) <= 255:  # noqa: PLR2004 - a byte
        report.assumed.append(f"{name}: mission {mission_id} cannot be asked of its sequencer, whose ids are 1 to 255")
    return given


# --- components -------------------------------------------------------------------------------------------------------


class _Components:
    """Components as sensors.yaml has them, one for each entity."""

    def __init__(self, report: Report) -> None:
        self.rows: Dict[str, Dict[str, Any]] = {}
        self._report = report
        self._entities: Dict[str, str] = {}
        self._there: Set[Tuple[str, ...]] = set()

    def add(self, kind: str, row: Row) -> None:
        """Add a topic, a node or a driver."""
        entity = row.text(ENTITY) or row.name
        component = component_of(entity)
        other = self._entities.setdefault(component, entity)
        if other != entity:
            row.refuse(f"the entities {entity} and {other} would both be {component}", "rename one")
        if self._is_there(kind, component, row.name):
            return
        here = self.rows.setdefault(component, {"group": "other", "severity": ""})
        {"topics": self._topic, "nodes": self._node, "drivers": self._driver}[kind](component, here, row)
        report_left(row.name, row.values, (ENTITY, *KINDS[kind]), self._report)

    def _is_there(self, kind: str, component: str, name: str) -> bool:
        """Report that an entity has it already; of drivers one alone is run."""
        key = (kind, component) if kind == "drivers" else (kind, component, _absolute(name))
        if key not in self._there:
            self._there.add(key)
            return False
        again = f"a second driver of {component}; the first counts"
        if kind != "drivers":
            again = f"{_absolute(name)} of {component} a second time; the first of the {kind} counts"
        self._report.no_counterpart.append(f"{name}: {again}")
        return True

    def _topic(self, component: str, here: Dict[str, Any], row: Row) -> None:
        name, rate, margin = row.name, row.number("rate"), row.number("margin")
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
        if row.values.get("window_size") is not None:
            samples = max(row.number("window_size"), _LEAST_WINDOW)
            topic["window_s"] = round(samples / rate, 3)
            words += f", window {topic['window_s']:g} s"
        self._report.translated.append(words)
        self._report.assumed.append(f"{name}: has failed after {topic['age_limit_s']:g} s of silence")
        if name.lstrip("/").startswith("mavros"):
            here["group"] = "px4"
        if row.text("node_name"):
            self._name_node(component, here, row.text("node_name"))

    def _name_node(self, component: str, here: Dict[str, Any], node: str) -> None:
        if here.setdefault("node", _absolute(node)) != _absolute(node):
            self._report.no_counterpart.append(f"{node}: a second node of {component}; {here['node']} is watched")

    def _node(self, component: str, here: Dict[str, Any], row: Row) -> None:
        name = row.name
        self._name_node(component, here, name)
        attempts = int(row.number("max_restart_attempts", 0.0))
        if attempts < 1 or here["node"] != _absolute(name):
            self._report.translated.append(f"{name}: node of {component}, never restarted")
            return
        self._report.translated.append(f"{name}: node of {component}")
        limit_s = min(max(row.number("restart_timeout", 5.0), 0.1), 60.0)
        here["restart"] = {
            "policy": "node",
            "attempts": min(attempts, 100),
            "attempt_limit_s": limit_s,
            "total_limit_s": round(min(attempts * (limit_s + 1.0), 600.0), 3),
        }

    def _driver(self, component: str, here: Dict[str, Any], row: Row) -> None:
        check, restart = self._command(row, "check_script"), self._command(row, "restart_script")
        if check:
            here["driver"] = check
            self._report.translated.append(f"{row.name}: driver of {component}, checked by {shlex.join(check)}")
        if restart and "restart" in here:
            self._report.no_counterpart.append(f"{row.name}: restart_script; {component} is restarted by its node")
        elif restart:
            here["restart"] = {"policy": "driver", "command": restart}

    def _command(self, row: Row, key: str) -> List[str]:
        words = row.command(key)
        if len(words) > 1:
            taken = f"the program is {words[0]}, its arguments are {shlex.join(words[1:])}"
            self._report.assumed.append(f"{row.name}: {key}: {taken}")
        return words

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
        needed_s = returns_after_s(row.get("topics", {}))
        self._give_time(name, row, needed_s)
        restart = row.get("restart", {})
        if "command" in restart:
            self._report.translated.append(f"{name}: restarted by {shlex.join(restart['command'])}")
        elif restart:
            self._report.translated.append(f"{name}: restarted by its node, up to {restart['attempts']} times")
            self._report.assumed.append(f"{name}: roslaunch starts {row['node']} again when it ends (respawn)")
        if severity is Severity.HIGH:
            row["wait_limit_s"] = max(_wait_s(needed_s), row.get("restart", {}).get("attempt_limit_s", 0.0))
            self._report.assumed.append(f"{name}: a flight waits {row['wait_limit_s']:g} s for it, then lands")

    def _give_time(self, name: str, row: Dict[str, Any], needed_s: float) -> None:
        """Give each attempt of a restart the time that its topics need to be back, and that of a start."""
        restart = row.get("restart", {})
        start_s = restart.get("attempt_limit_s", _ATTEMPT_S)
        if not restart or needed_s < start_s:
            return
        limit_s = float(math.ceil(needed_s + start_s))
        if limit_s > _FIX_S:
            del row["restart"]
            why = f"its topics need {needed_s:g} s to be back, longer than a takeoff waits"
            self._report.no_counterpart.append(f"{name}: a restart; {why}")
            return
        total_s = min(restart.get("attempts", RestartSpec().attempts) * (limit_s + 1.0), _FIX_S)
        restart.update(attempt_limit_s=limit_s, total_limit_s=total_s)
        self._report.assumed.append(
            f"{name}: a restart has {limit_s:g} s, since its topics need {needed_s:g} s to be back"
        )


def _wait_s(needed_s: float) -> float:
    """Return how long a flight waits for a component that needs a time to be back."""
    return _WAIT_S if needed_s < _WAIT_S else float(math.ceil(min(needed_s + _WAIT_S, LONGEST_AGE_S)))


def _unlisted_wait(
    components: Mapping[str, Mapping[str, Any]], missions: Mapping[str, Mapping[str, Any]], report: Report
) -> str:
    """Return the wait for what one mission holds for and another lands for, where it must be longer than by default."""
    waited = {
        name for each in missions.values() for name, severity in each.get("severities", {}).items() if waits(severity)
    }
    needed_s = max((returns_after_s(components[name].get("topics", {})) for name in waited), default=0.0)
    wait_s = _wait_s(needed_s)
    if wait_s == _WAIT_S:
        return ""
    what = "what a mission holds for and another lands for"
    report.assumed.append(
        f"autonomy.yaml: a flight waits {wait_s:g} s for {what}, which needs {needed_s:g} s to be back"
    )
    return f"commands:\n  # seconds: {what}, and which is slow to be back\n  unlisted_wait_limit_s: {wait_s:g}\n"


def _absolute(name: str) -> str:
    return "/" + name.lstrip("/")


def _rates(components: Mapping[str, Mapping[str, Any]]) -> Dict[str, float]:
    """Return the topics that are watched, with their rates in Hz."""
    return {topic: row["rate_hz"] for each in components.values() for topic, row in each.get("topics", {}).items()}


def _checked(components: Mapping[str, Mapping[str, Any]], report: Report) -> Dict[str, Dict[str, Any]]:
    """Return what landing detection and state estimation look at, where it is not what ships."""
    rates = _rates(components)
    found: Dict[str, Dict[str, Any]] = {}
    over_mavros = any(topic.startswith("/mavros/") for topic in rates)
    shipped, mavros = _sample("sensors.yaml"), _sample("mavros/sensors.yaml")
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
    report.assumed.append(_INITIALISATION)
    return found


def _sample(name: str) -> Any:
    """Return what a file of the configuration that ships says."""
    return yaml.safe_load((config_folder() / name).read_text(encoding="utf-8"))


def _looked_at(row: Mapping[str, Any], key: str) -> Dict[str, Any]:
    """Return a topic of a check, with what else is said of it: everything but its other topics."""
    if key != "topic":
        return {key: row[key]}
    return {name: value for name, value in row.items() if not name.endswith("_topic")}


def _recording(
    components: Mapping[str, Mapping[str, Any]], checked: Mapping[str, Mapping[str, Any]], report: Report
) -> Dict[str, Any]:
    """Return what is recorded: what is watched, and what the sample for mavros records besides sensors."""
    looked_at = {row[key] for row in checked.values() for key in ("topic", "imu_topic") if key in row}
    sample, theirs = _sample("mavros/recording.yaml")["groups"], _rates(_sample("mavros/sensors.yaml")["components"])
    groups = {"sensors": sorted({*_rates(components), *looked_at})}
    for name in ("states", "vehicle"):
        taken = (topic for topic in sample[name]["topics"] if topic not in theirs)
        groups[name] = [topic for topic in taken if topic not in groups["sensors"]]
    words = f"the {len(groups['sensors'])} topics that are watched, what our nodes say, and what mavros does"
    report.assumed.append(f"recording.yaml: one computer records {words}")
    return {
        "folder": "~/recordings",
        "collector": "main",
        "platforms": {"main": {"groups": list(groups)}},
        "groups": {name: {"topics": topics} for name, topics in groups.items()},
    }
