"""The configuration as the package uses it: frozen values, made by `loader.load_configuration` alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, FrozenSet, Mapping, Tuple

from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.missions import Bounds, FlightModel, MissionPlan, PlannerSpec
from amaze_autonomy.monitoring.initialisation import InitialisationSpec
from amaze_autonomy.monitoring.specs import BatterySpec, ComponentSpec, LandingSpec, StateEstimationSpec

from ..engine.events import Mission
from .schemas.autonomy import Streams
from .schemas.autopilot import AutopilotSettings
from .schemas.recording import Recording

__all__ = ["Configuration"]


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
