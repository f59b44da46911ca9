"""Loads a folder of configuration files: all of them, once, strictly. One mistake is one `ConfigError`."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, Sequence, Tuple, Union

from amaze_autonomy.missions import Bounds, Controller, FlightModel, PlannerSpec
from amaze_autonomy.monitoring.specs import BatterySpec

from .consistency import (
    check_autonomy_with_sensors,
    check_components,
    check_heights,
    check_initialisation,
    check_order,
    check_planner,
    check_platform_limit,
    check_recorder_limits,
    check_recording,
    check_replies,
    check_required,
    check_restarted_nodes,
    check_returns,
    check_takeoff,
)
from .document import Entry, Scalar, Table, entry_of, parse, read, replace
from .errors import ConfigError, Place
from .kinds import Places
from .model import (
    Configuration,
    components_of,
    initialisation_of,
    landing_of,
    recording_of,
    rules_of,
    state_estimation_of,
)
from .schema import Group, make
from .schemas.autonomy import AUTONOMY, Streams
from .schemas.autopilot import AUTOPILOT, autopilot_of
from .schemas.missions import MISSIONS
from .schemas.recording import RECORDING
from .schemas.sensors import SENSORS
from .trajectories import Files, plans_of, read_files

FILES: Mapping[str, Group] = {
    "autonomy": AUTONOMY,
    "sensors": SENSORS,
    "missions": MISSIONS,
    "recording": RECORDING,
    "autopilot": AUTOPILOT,
}
_Read = Tuple[Dict[str, Any], Dict[str, Places]]


def load_configuration(folder: Union[str, Path], overrides: Overrides = ()) -> Configuration:
    """Load and check every file of a folder.

    Args:
        folder: with autonomy.yaml, sensors.yaml, missions.yaml, recording.yaml, autopilot.yaml and the waypoint files.
        overrides: "file.key.key=value" texts, or a mapping from "file.key.key" to plain values; they replace what the
            files say and are checked in the same way. "vehicle=NAME" stands for those of vehicles/NAME.yaml.

    Raises:
        ConfigError: the first mistake.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ConfigError(Place(str(folder)), "", "is not a folder", f"must hold {', '.join(_names())}")
    trees = {name: read(folder / f"{name}.yaml") for name in FILES}
    values, places = _read_all(apply_overrides(trees, overrides, folder))
    _check(values, places)
    files = read_files(folder, values["missions"], places["missions"])
    return _configuration(folder, values, places, files)


def hash_of(effective: Mapping[str, Any]) -> str:
    """Return the SHA-256 of plain values as canonical JSON: the same on every machine and Python."""
    text = json.dumps(effective, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _names() -> Sequence[str]:
    return [f"{name}.yaml" for name in FILES]


def _read_all(trees: Mapping[str, Entry]) -> _Read:
    values: Dict[str, Any] = {}
    places: Dict[str, Places] = {}
    for name, tree in trees.items():
        places[name] = {}
        values[name] = FILES[name].read(tree, (), places[name])
    return values, places


def _check(values: Mapping[str, Any], places: Mapping[str, Places]) -> None:
    check_order(values["autonomy"], places["autonomy"])
    check_components(values["sensors"]["components"], places["sensors"])
    check_restarted_nodes(values["sensors"]["components"], values["autopilot"], places["sensors"])
    check_autonomy_with_sensors(values["autonomy"], values["sensors"], places["sensors"])
    check_heights(values["autonomy"], values["missions"], places["missions"])
    check_takeoff(values["autonomy"], values["missions"], places["missions"])
    check_planner(values["autonomy"], values["missions"], places["missions"])
    check_required(values["sensors"], values["missions"], places["missions"])
    check_initialisation(values["autonomy"], values["sensors"], places["sensors"])
    check_replies(values["autonomy"], values["autopilot"], places["autopilot"])
    check_recording(values["recording"], places["recording"])
    check_recorder_limits(values["autonomy"], values["recording"], places)
    check_platform_limit(values["autonomy"], values["recording"], places["recording"])


def _configuration(
    folder: Path, values: Mapping[str, Any], places: Mapping[str, Places], files: Files
) -> Configuration:
    autonomy, sensors, missions = values["autonomy"], values["sensors"], values["missions"]
    rules = rules_of(autonomy, sensors)
    components = components_of(sensors, places["sensors"])
    check_returns(components, places["sensors"])
    plans = plans_of(folder, missions, files, rules.limits, components, places["missions"])
    autopilot = autopilot_of(values["autopilot"], places["autopilot"])
    by_setpoints = any(plan.controller is Controller.OFFBOARD for plan in plans)
    effective = {**values, "trajectories": {name: digest for (name, _), (_, digest) in files.items()}}
    return Configuration(
        folder=folder,
        rules=rules,
        streams=make(Streams, autonomy["streams"], ("streams",), places["autonomy"]),
        components=components,
        landing=landing_of(sensors, places["sensors"]),
        state_estimation=state_estimation_of(sensors, places["sensors"]),
        initialisation=initialisation_of(sensors, places["sensors"]),
        battery=make(BatterySpec, sensors["battery"], ("battery",), places["sensors"]),
        flight=make(FlightModel, missions["flight"], ("flight",), places["missions"]),
        bounds=make(Bounds, missions["bounds"], ("bounds",), places["missions"]),
        planner=make(PlannerSpec, missions["planner"], ("planner",), places["missions"]),
        plans=plans,
        recording=recording_of(values["recording"], places["recording"]),
        autopilot=autopilot.with_offboard() if by_setpoints else autopilot,
        effective=effective,
        hash=hash_of(effective),
    )


# --- overrides --------------------------------------------------------------------------------------------------------
# Overrides: single values given on top of the files, e.g. by a launch file or a scenario. Checked like the files.
#
# autonomy.require_go=true sensors.components.gps.severity=highest missions.missions.1.repetitions=3 vehicle=px4_sitl


Overrides = Union[Iterable[str], Mapping[str, Any]]


_Pair = Tuple[Place, Tuple[str, ...], Entry]
_VEHICLE = ("vehicle",)


def apply_overrides(trees: Mapping[str, Entry], overrides: Overrides, folder: Path) -> Dict[str, Entry]:
    """Return the trees of the files with the overrides in them; a later one wins over an earlier one.

    A vehicle's, from `folder`/vehicles, come first, wherever it is named.

    Raises:
        ConfigError: an override is not `file.key=value`, or addresses what cannot be.
    """
    changed, pairs = dict(trees), _pairs(overrides)
    vehicles = [pair for pair in pairs if pair[1] == _VEHICLE]
    for place, address, value in (
        *(own for vehicle in vehicles for own in _of_vehicle(folder, vehicle)),
        *(pair for pair in pairs if pair[1] != _VEHICLE),
    ):
        name, path = address[0], address[1:]
        if name not in changed or not path or not all(path):
            right = f"must be file.key.key=value with the file one of {', '.join(trees)}"
            raise ConfigError(place, "", "addresses no key", right)
        new = replace(changed[name], path, value)
        if new is None:
            raise ConfigError(place, "", "leads through a single value", "must address a key of a group")
        changed[name] = new
    return changed


def _of_vehicle(folder: Path, vehicle: _Pair) -> List[_Pair]:
    """Return the overrides of a vehicle: those of a file of its name, one in each line."""
    place, _, value = vehicle
    known = sorted(path.stem for path in (folder / "vehicles").glob("*.yaml"))
    if not isinstance(value, Scalar) or value.text not in known:
        right = f"must be one of those in {folder / 'vehicles'}: {', '.join(known) or 'there is none'}"
        raise ConfigError(place, "", "names no vehicle", right)
    tree = read(folder / "vehicles" / f"{value.text}.yaml")
    if not isinstance(tree, Table):
        raise ConfigError(tree.place, "", "holds no overrides", "must hold lines of file.key.key: value")
    return [(at, tuple(key.split(".")), entry) for key, (at, entry) in tree.entries.items()]


def _pairs(overrides: Overrides) -> List[_Pair]:
    if isinstance(overrides, Mapping):
        pairs = []
        for key, value in overrides.items():
            place = Place(f"override {key}")
            pairs.append((place, tuple(str(key).split(".")), entry_of(value, place)))
        return pairs
    return [_parsed(text) for text in ([overrides] if isinstance(overrides, str) else overrides)]


def _parsed(text: str) -> _Pair:
    place = Place(f"override {text}")
    key, equals, value = text.partition("=")
    if not equals:
        raise ConfigError(place, "", "has no value", "must be file.key.key=value")
    return place, tuple(key.strip().split(".")), parse(value, place.source, lines=False)
