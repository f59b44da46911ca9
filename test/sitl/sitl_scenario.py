"""The scenarios of the flights with real autopilots: YAML, read strictly.

```yaml
description: The link of both nodes is cut for five seconds in the mission.
mission: "1"
when:                                     # what happens outside of the vehicle's own nodes
  - do: cut                               # a row of ACTIONS
    for_s: 5.0                            # its arguments
    after: {state: MISSION, delay_s: 3.0} # a state, an event of the vehicle, a mode, an order of the planner (ARM);
                                          # left out: before the launch
faults: [...]                             # of the simulated sensors and nodes, as in config/faults
requests: [...]                           # what the user asks, as in config/faults
launch: {processes: forked}               # further arguments of the launch file
expect:
  result: COMPLETE                        # or a list of those that are good
  states: [TAKEOFF, MISSION, DATA_CLEANUP, MISSION_ENDED]   # from the first takeoff on
  modes: [AUTO.MISSION, AUTO.LAND]        # that the vehicle shows while armed, in this order
  at_most: {code_16_to_mode_s: 1.0}       # what was measured, see sitl_judge.MEASURES
  log_within_s: 0.1                       # how far its telemetry log, replayed, may be from what the flight heard
  texts: [...]                            # words that the journal must hold
  ardupilot: {modes: [...]}               # what is otherwise there
```
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, Tuple

import yaml
from sitl_autopilots import KINDS

from amaze_autonomy.engine.state import Result, State

_ARGUMENTS: Mapping[str, Tuple[Tuple[str, type], ...]] = {
    "cut": (("for_s", float),),
    "lose": (("fraction", float), ("for_s", float)),
    "mode": (("mode", str),),
    "parameter": (("px4", dict), ("ardupilot", dict)),
    "upload": (("up_m", float),),
    "home": (("up_m", float),),
    "kill": (("node", str),),
    "kill_engine": (("down_s", float),),
    "restart_autopilot": (("down_s", float),),
    "user": (("command", str),),
    "arm": (),
    "disarm": (),
    "forge": (("mode", str),),
}
ACTIONS = tuple(_ARGUMENTS)
"""What can be done from outside: to the links, by the second ground station, to processes, to the autopilot's power."""
_OPTIONAL = {("lose", "for_s"), ("parameter", "px4"), ("parameter", "ardupilot")}
_TRIGGER = ("state", "step", "event", "mode", "order", "occurrence", "delay_s")
EVENTS = ("armed", "airborne", "waypoint", "landed", "disarmed", "started")
SKIPPED = ("MISSION_INPUT", "PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION")  # by the judge
_EXPECT = ("result", "states", "modes", "at_most", "at_least", "texts", "own_behaviour", "log_within_s")
_KEYS = (
    *("description", "mission", "not_for", "overrides", "parameters", "when", "faults", "requests", "expect"),
    *("unattended", "station", "signed", "limit_s", "launch"),
)


class ScenarioError(ValueError):
    """A scenario cannot be. Its text is one line, with the file."""


@dataclasses.dataclass(frozen=True)
class Trigger:
    """When something happens: a time after a state is entered, a mode is shown, or the vehicle did something."""

    what: str
    value: str
    step: str = ""
    occurrence: int = 1
    delay_s: float = 0.0


@dataclasses.dataclass(frozen=True)
class Action:
    """Something that is done from outside."""

    do: str
    arguments: Mapping[str, Any]
    after: Trigger


@dataclasses.dataclass(frozen=True)
class Scenario:
    """One flight.

    Args:
        name: of its file.
        description: one line.
        mission: ids for the launch file.
        not_for: autopilots that it is not for, each with the reason.
        overrides: of the configuration.
        parameters: of each autopilot, set before it starts.
        when: what is done from outside.
        world: faults and requests of the simulated world, as YAML.
        expect: for each autopilot.
        unattended: nobody answers at OUTREACH.
        station: the second ground station has streams and downloads the mission all the time.
        signed: the autopilot is given a key before the launch, and hears nothing that is not signed with it.
        engine: "launched" by roslaunch, or "apart", so that it can be killed and started again.
        limit_s: of the whole flight.
        launch: further arguments of the launch file.
    """

    name: str
    description: str
    mission: str
    not_for: Mapping[str, str]
    overrides: Tuple[str, ...]
    parameters: Mapping[str, Mapping[str, float]]
    when: Tuple[Action, ...]
    world: Mapping[str, Any]
    expect: Mapping[str, Mapping[str, Any]]
    unattended: bool
    station: bool
    signed: bool
    engine: str
    limit_s: float
    launch: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def autopilots(self) -> Tuple[str, ...]:
        """The autopilots that it is for."""
        return tuple(name for name in KINDS if name not in self.not_for)


def load(path: Path) -> Scenario:
    """Read a scenario.

    Raises:
        ScenarioError: something in it cannot be.
    """
    try:
        given = yaml.safe_load(path.read_text(encoding="utf-8"))
        return _scenario(path.name[: -len(".yaml")], given)
    except (KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        raise ScenarioError(f"{path}: {error}") from error


def _scenario(name: str, given: Mapping[str, Any]) -> Scenario:
    _known(given, _KEYS, "key")
    actions = tuple(_action(each) for each in given.get("when", ()))
    kills = any(each.do == "kill_engine" for each in actions)
    not_for = given.get("not_for", {})
    _known(not_for, tuple(KINDS), "autopilot")
    world = {"description": given["description"], **{key: given[key] for key in ("faults", "requests") if key in given}}
    return Scenario(
        name=name,
        description=given["description"],
        mission=str(given.get("mission", "1")),
        not_for=not_for,
        overrides=tuple(given.get("overrides", ())),
        parameters=given.get("parameters", {}),
        when=actions,
        world=world if len(world) > 1 else {},
        expect={each: _expected(given["expect"], each) for each in KINDS if each not in not_for},
        unattended=bool(given.get("unattended", True)),
        station=bool(given.get("station", False)),
        signed=bool(given.get("signed", False)),
        engine="apart" if kills else "launched",
        limit_s=float(given.get("limit_s", 150.0)),
        launch={str(key): str(value) for key, value in given.get("launch", {}).items()},
    )


def _action(given: Mapping[str, Any]) -> Action:
    do = given["do"]
    _known((do,), ACTIONS, "action")
    wanted = dict(_ARGUMENTS[do])
    _known(given, ("do", "after", *wanted), f"argument of {do}")
    arguments: Dict[str, Any] = {}
    for key, kind in wanted.items():
        if key in given:
            arguments[key] = kind(given[key])
        elif (do, key) not in _OPTIONAL:
            raise ValueError(f"{do} has no {key}")
    return Action(do, arguments, trigger(given.get("after", {"event": "started"})))


def trigger(given: Mapping[str, Any]) -> Trigger:
    """Read a trigger.

    Raises:
        ValueError: it cannot be.
    """
    _known(given, _TRIGGER, "key of after")
    kinds = [key for key in ("state", "event", "mode", "order") if key in given]
    if len(kinds) != 1:
        raise ValueError("after has one of state, event, mode, order")
    if kinds == ["event"]:
        _known((given["event"],), EVENTS, "event")
    return Trigger(
        kinds[0],
        given[kinds[0]],
        given.get("step", ""),
        int(given.get("occurrence", 1)),
        float(given.get("delay_s", 0.0)),
    )


def _expected(given: Mapping[str, Any], autopilot: str) -> Mapping[str, Any]:
    _known(given, (*_EXPECT, *KINDS), "expectation")
    merged = {key: value for key, value in given.items() if key in _EXPECT}
    own = given.get(autopilot, {})
    _known(own, _EXPECT, "expectation")
    merged.update(own)
    for key in ("result", "states"):
        if key not in merged:
            raise ValueError(f"expect has no {key}")
    results = merged["result"] if isinstance(merged["result"], list) else [merged["result"]]
    _known(results, tuple(each.value for each in Result), "result")
    ways = merged["states"] if isinstance(merged["states"][0], list) else [merged["states"]]
    for way in ways:
        _known(way, tuple(each.value for each in State if each.value not in SKIPPED), "state")
    merged.update(result=results, states=ways)
    return merged


def _known(given: Iterable[str], known: Tuple[str, ...], what: str) -> None:
    unknown: List[str] = [each for each in given if each not in known]
    if unknown:
        raise ValueError(f"{what} {unknown[0]!r} is not known, there are {', '.join(known)}")
