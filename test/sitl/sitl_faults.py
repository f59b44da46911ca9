"""The fault scenarios that ship (config/faults), as flights with a real autopilot.

Faults of sensors, nodes and services are the world's, as always. Those of the vehicle are done to the real one where
that can be: by the second ground station, by the relay, by a parameter of its simulator. What cannot be is named.
What is expected is what virtual time gives: the same way through the states, as in `./run live`.
"""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Tuple

import yaml
from sitl_autopilots import KINDS, ROOT
from sitl_scenario import EVENTS, SKIPPED, Action, Scenario, ScenarioError, load, trigger

FOLDER = ROOT / "config" / "faults"
_PREFIX = "faults/"
_FULL_V, _EMPTY_V = 12.6, 9.9  # three cells
_OF_FLIGHT = ("autopilot/", "mission_planner/")
_OF_MONITORS = ("watchdog/", "landing_detection/", "state_estimation/")
_OF_RECORDER = ("recording_does_not_grow", "recording_fails", "data_incomplete")
_STAYS = ("tilted", "raised", *_OF_RECORDER)


def _battery_drops(fault: Mapping[str, Any]) -> List[Tuple[str, Mapping[str, Any]]]:
    level = fault["to_fraction"]
    volts = _EMPTY_V + (_FULL_V - _EMPTY_V) * level
    given = {"px4": {"SIM_BAT_MIN_PCT": 100.0 * level, "SIM_BAT_DRAIN": 1}, "ardupilot": {"SIM_BATT_VOLTAGE": volts}}
    return [("parameter", given)]


def _gps_lost(_: Mapping[str, Any]) -> List[Tuple[str, Mapping[str, Any]]]:
    return [("parameter", {"px4": {"SIM_GPS_USED": 0}, "ardupilot": {"SIM_GPS_DISABLE": 1}})]


def _pilot_takes_over(_: Mapping[str, Any]) -> List[Tuple[str, Mapping[str, Any]]]:
    return [("mode", {"mode": "POSCTL"}), ("mode", {"mode": "AUTO.LAND"})]


def _link_lost(fault: Mapping[str, Any]) -> List[Tuple[str, Mapping[str, Any]]]:
    return [("cut", {"for_s": float(fault.get("for_s", 1e6)), "links": ("node",)})]


_DONE: Mapping[str, Callable[[Mapping[str, Any]], List[Tuple[str, Mapping[str, Any]]]]] = {
    "battery_drops": _battery_drops,
    "gps_lost": _gps_lost,
    "pilot_takes_over": _pilot_takes_over,
    "autopilot_link_lost": _link_lost,
}


def find(name: str) -> Scenario:
    """Return a scenario of `scenarios`, or of config/faults when its name begins with `faults/`.

    Raises:
        ScenarioError: it cannot be flown.
    """
    if name.startswith(_PREFIX):
        return shipped(name[len(_PREFIX) :])
    return load(Path(__file__).resolve().with_name("scenarios") / f"{name}.yaml")


def shipped(name: str) -> Scenario:
    """Return a scenario that ships as a flight with a real autopilot.

    Raises:
        ScenarioError: it cannot be done to a real one; the text says what.
    """
    path = FOLDER / f"{name}.yaml"
    given = yaml.safe_load(path.read_text(encoding="utf-8"))
    stays: List[Mapping[str, Any]] = []
    actions: List[Action] = []
    launch: Dict[str, str] = {}
    for fault in given.get("faults", ()):
        if fault.get("service", "").startswith(_OF_FLIGHT):
            raise ScenarioError(f"faults/{name}: it breaks {fault['service']}, which the real node has")
        if fault.get("service", "").startswith(_OF_MONITORS):
            launch["monitors"] = "simulated"
        if fault.get("service", "").startswith("data_recorder/") or fault["fault"] in _OF_RECORDER:
            launch["recorder"] = "simulated"
        if any(key in fault for key in ("component", "process", "service")) or fault["fault"] in _STAYS:
            stays.append(fault)
        elif fault["fault"] in _DONE:
            actions += _actions(name, fault)
        else:
            raise ScenarioError(f"faults/{name}: nobody can make a real autopilot do this: {fault['fault']}")
    world = {"description": given["description"], "faults": stays, "requests": given.get("requests", [])}
    way, result = _in_virtual_time(name)
    answers = any(each.get("after", {}).get("state") == "OUTREACH" for each in world["requests"])
    expect = {"result": [result], "states": [way], "begins": True}
    return Scenario(
        name=f"{_PREFIX}{name}",
        description=given["description"],
        mission="1",
        not_for={},
        overrides=(),
        parameters={"px4": {"SIM_BAT_MIN_PCT": 90}},
        when=tuple(actions),
        world={key: value for key, value in world.items() if value},
        expect=dict.fromkeys(KINDS, expect),
        unattended=not answers,
        station=False,
        engine="launched",
        limit_s=180.0,
        launch=launch,
    )


def _actions(name: str, fault: Mapping[str, Any]) -> List[Action]:
    after = fault.get("after")
    if after is None or ("event" in after and after["event"] not in EVENTS):
        raise ScenarioError(f"faults/{name}: {fault['fault']} begins when nobody outside can see it")
    begins = trigger({key: value for key, value in after.items() if key != "number"})
    done = _DONE[fault["fault"]](fault)
    actions = [Action(do, arguments, begins) for do, arguments in done[:1]]
    for do, arguments in done[1:]:
        later = trigger({"mode": done[0][1]["mode"], "delay_s": float(fault.get("land_after_s", 5.0))})
        actions.append(Action(do, arguments, later))
    return actions


def _in_virtual_time(name: str) -> Tuple[List[str], str]:
    """Return the way through the states, and the result, that virtual time gives."""
    with tempfile.TemporaryDirectory() as folder:
        journal = Path(folder) / "journal.jsonl"
        tool = str(Path(sys.executable).with_name("amaze-autonomy"))
        command = [tool, "simulate", "--faults", name, "--journal", str(journal)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
        rows = (json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines())
        states = [row["after"] for row in rows if row["kind"] == "decision"]
    way = [state for state, _ in itertools.groupby(states) if state not in SKIPPED]
    last = done.stdout.strip().splitlines()[-1]
    result = last.rpartition(": ")[2].split()[0].rstrip(",") if last.startswith("mission ") else ""
    return way, result
