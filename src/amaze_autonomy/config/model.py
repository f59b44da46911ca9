"""The configuration as the package uses it: frozen values, made of the files' checked values by `loader` alone."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, FrozenSet, Mapping, Optional, Tuple

from amaze_autonomy.engine.rules import Limits, Rules
from amaze_autonomy.missions import Bounds, Controller, FlightModel, MissionPlan, PlannerSpec
from amaze_autonomy.monitoring.initialisation import InitialisationSpec, InitialisationType
from amaze_autonomy.monitoring.specs import (
    AutopilotSensor,
    BatterySpec,
    ComponentSpec,
    EstimateSource,
    LandingSpec,
    PollingSpec,
    RangeSource,
    RestartPolicy,
    RestartSpec,
    StateEstimationSpec,
    TopicSpec,
)

from ..engine.events import Mission
from ..engine.rules import ComponentRule, Severity
from .kinds import Places
from .schema import field_value, key_name, make
from .schemas.autonomy import Streams
from .schemas.autopilot import AutopilotSettings
from .schemas.recording import Platform, Recording, Storage, TopicGroup, Transfer

# --- the values -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Configuration:
    """Everything that a folder of configuration files says.

    Args:
        folder: where it was read from; not part of the hash.
        rules: for the engine.
        streams: how often each peer sends its status.
        components: for the watchdog, in the order of the file.
        landing: for the landing detection.
        state_estimation: for the check of the states.
        initialisation: of an estimator that must be told to begin.
        battery: for the check before takeoff.
        flight: how the vehicle flies, for estimates and for the simulated vehicle.
        bounds: of waypoint files.
        planner: how the mission planner flies through the autopilot.
        plans: every mission with its waypoints and estimates, in the order of the file.
        recording: what is recorded.
        autopilot: the links to the vehicle, and what is made of what it says.
        effective: all of it as plain values, defaults and overrides included; waypoint files by their content's hash.
        hash: SHA-256 of `effective` as canonical JSON, in hexadecimal.
    """

    folder: Path
    rules: Rules
    streams: Streams
    components: Tuple[ComponentSpec, ...]
    landing: LandingSpec
    state_estimation: StateEstimationSpec
    initialisation: InitialisationSpec
    battery: BatterySpec
    flight: FlightModel
    bounds: Bounds
    planner: PlannerSpec
    plans: Tuple[MissionPlan, ...]
    recording: Recording
    autopilot: AutopilotSettings
    effective: Mapping[str, Any]
    hash: str

    @property
    def missions(self) -> Tuple[Mission, ...]:
        """Return every mission as the engine sees it."""
        return tuple(plan.mission for plan in self.plans)

    @property
    def without_land_switch(self) -> FrozenSet[str]:
        """The ids of the missions that are flown without the transmitter's switch that means land."""
        return frozenset(plan.mission.id for plan in self.plans if not plan.land_switch)

    def plan(self, mission_id: str) -> MissionPlan:
        """Return a mission with its waypoints.

        Raises:
            KeyError: there is no such mission.
        """
        for plan in self.plans:
            if plan.mission.id == mission_id:
                return plan
        raise KeyError(mission_id)


# --- how they are made ------------------------------------------------------------------------------------------------


_Values = Mapping[str, Any]


def limits_of(autonomy: _Values) -> Limits:
    """Return the engine's limits."""
    groups = {entry.name: entry.metadata["row"].group for entry in fields(Limits)}
    return Limits(**{name: field_value(name, autonomy[group][key_name(name)]) for name, group in groups.items()})


def rules_of(autonomy: _Values, sensors: _Values) -> Rules:
    """Return the engine's rules.

    A component that has no wait of its own gets that of unlisted ones, for missions that judge it otherwise.
    """
    limits = limits_of(autonomy)
    rows = tuple(_rule(name, values, limits) for name, values in sensors["components"].items())
    own = (_by_check(autonomy, "reply_limits_ns"), _by_check(autonomy, "max_ages_ns"))
    return Rules(rows, limits, autonomy["require_go"], *own)


def _by_check(autonomy: _Values, name: str) -> Tuple[Tuple[str, int], ...]:
    own = autonomy["checks"][key_name(name)]
    return tuple((check, field_value(name, own[check])) for check in sorted(own))


def _rule(name: str, values: _Values, limits: Limits) -> ComponentRule:
    wait = values["wait_limit_s"]
    return ComponentRule(
        name=name,
        group=values["group"],
        restart=values["restart"]["policy"] != "never",
        severity=Severity(values["severity"]),
        wait_limit_ns=limits.unlisted_wait_limit_ns if wait is None else field_value("wait_limit_ns", wait),
    )


def components_of(sensors: _Values, places: Places) -> Tuple[ComponentSpec, ...]:
    """Return what the watchdog watches."""
    polling = make(PollingSpec, sensors["polling"], ("polling",), places)
    return tuple(_component(name, values, polling, places) for name, values in sensors["components"].items())


def _component(name: str, values: _Values, polling: PollingSpec, places: Places) -> ComponentSpec:
    here, restart = ("components", name), values["restart"]
    topics = tuple(
        make(TopicSpec, topic, (*here, "topics", address), places, topic=address)
        for address, topic in values["topics"].items()
    )
    policy = RestartPolicy(restart["policy"])
    sensor: Optional[str] = values["autopilot"]
    return make(
        ComponentSpec,
        {**values, "wait_limit_s": values["wait_limit_s"] or 0.0},
        here,
        places,
        name=name,
        severity=Severity(values["severity"]),
        topics=topics,
        autopilot=AutopilotSensor(sensor) if sensor else None,
        restart=make(RestartSpec, restart, (*here, "restart"), places, policy=policy),
        polling=polling,
    )


def landing_of(sensors: _Values, places: Places) -> LandingSpec:
    """Return the specification of the landing detection."""
    values = sensors["landing_detection"]
    return make(LandingSpec, values, ("landing_detection",), places, source=RangeSource(values["source"]))


def state_estimation_of(sensors: _Values, places: Places) -> StateEstimationSpec:
    """Return the specification of the check of the states."""
    values = sensors["state_estimation"]
    return make(StateEstimationSpec, values, ("state_estimation",), places, source=EstimateSource(values["source"]))


def initialisation_of(sensors: _Values, places: Places) -> InitialisationSpec:
    """Return how an estimator is told to begin."""
    values = sensors["initialisation"]
    types = {key: InitialisationType(values[key]) for key in ("type", "in_flight_type")}
    return make(InitialisationSpec, values, ("initialisation",), places, **types)


def mission_of(
    mission_id: str,
    values: _Values,
    components: Tuple[ComponentSpec, ...],
    flights: int,
    needed_fraction: float,
    duration_s: float,
    still_needed: Tuple[float, ...],
) -> Mission:
    """Return a mission as the engine sees it; `flights` of a repetition."""
    limits = {field.name: None for field in fields(Mission) if field.name.startswith("max_")}
    for name in limits:
        value = values["limits"][key_name(name)]
        limits[name] = None if value is None else field_value(name, value)
    return Mission(
        id=mission_id,
        description=values["description"],
        files=flights,
        repetitions=values["repetitions"],
        battery_needed_fraction=needed_fraction,
        still_needed=still_needed,
        estimated_duration_s=duration_s,
        severities=tuple((name, Severity(value)) for name, value in values["severities"].items()),
        required=tuple(values["required"]) or _required(components),
        tolerated=tuple(values["tolerated"]),
        set_points=values["controller"] == Controller.OFFBOARD.value,
        **limits,
    )


def _required(components: Tuple[ComponentSpec, ...]) -> Tuple[str, ...]:
    """Return what a mission needs that lists nothing; empty, which stands for all, when every component is required."""
    required = tuple(component.name for component in components if component.required)
    return required if len(required) < len(components) else ()


def recording_of(recording: _Values, places: Places) -> Recording:
    """Return what is recorded."""
    return make(
        Recording,
        recording,
        (),
        places,
        platforms=tuple(
            Platform(
                name,
                tuple(values["groups"]),
                make(Transfer, values["transfer"], ("platforms", name, "transfer"), places),
                has_transfer=("platforms", name, "transfer", "by") in places,
            )
            for name, values in recording["platforms"].items()
        ),
        groups=tuple(
            make(TopicGroup, values, ("groups", name), places, name=name)
            for name, values in recording["groups"].items()
        ),
        storage=make(Storage, recording["storage"], ("storage",), places),
    )
