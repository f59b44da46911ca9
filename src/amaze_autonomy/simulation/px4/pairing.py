"""A simulated PX4 for the vehicle of a world."""

from __future__ import annotations

import dataclasses
from typing import Dict, Optional, Tuple

from amaze_autonomy.config.model import Configuration
from amaze_autonomy.simulation.scenario import Scenario
from amaze_autonomy.simulation.vehicle import VehicleSettings
from amaze_autonomy.simulation.world import World

from .craft import Craft
from .px4 import Px4
from .settings import Px4Settings

__all__ = ["fly_world"]


def fly_world(
    configuration: Configuration,
    settings: Optional[Px4Settings] = None,
    scenario: Optional[Scenario] = None,
    *,
    seed: int = 0,
    start_ns: int = 0,
    unix_ns: int = 0,
    without: Tuple[str, ...] = ("autopilot", "mission_planner"),
    live: bool = False,
) -> Tuple[World, Px4]:
    """Make a world whose vehicle is flown over MAVLink, and its PX4; faults, physics and battery are the world's."""
    chosen = settings or Px4Settings()

    def craft(vehicle: VehicleSettings, t_ns: int) -> Craft:
        return Craft(vehicle, t_ns, chosen.geography)

    world = World(configuration, seed, scenario, start_ns=start_ns, without=without, live=live, make_vehicle=craft)
    cells = world.power.cells
    chosen = dataclasses.replace(chosen, parameters={"BAT1_N_CELLS": cells, **chosen.parameters})
    watched = tuple(each.autopilot.value for each in world.settings.components if each.autopilot is not None)

    def sensors() -> Dict[str, Optional[bool]]:
        health = world.sensor_health()
        return {name: health[name] if name in watched else True for name in health}

    vehicle = world.vehicle
    if not isinstance(vehicle, Craft):
        raise TypeError("the world made another vehicle than it was told to")
    px4 = Px4(vehicle, world.power, start_ns, chosen, sensors=sensors, seed=seed, unix_ns=unix_ns)
    return world, px4
