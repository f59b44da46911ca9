"""A simulated PX4 for the vehicle of a world, at the addresses where a configuration's nodes look for it."""

from __future__ import annotations

import dataclasses
from typing import Dict, Mapping, Optional, Tuple, Type, Union

from amaze_autonomy.config.errors import EndpointError
from amaze_autonomy.config.model import Configuration
from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.simulation.scenario import Scenario
from amaze_autonomy.simulation.vehicle.flight import Mode
from amaze_autonomy.simulation.vehicle.vehicle import VehicleSettings
from amaze_autonomy.simulation.world import World

from ...config.kinds import EndpointKind, parse_endpoint
from ..errors import UnsupportedParameterError, VehicleAddressError
from .craft import Craft
from .health import WITHOUT_TRANSMITTER, Wrong
from .px4 import Px4
from .settings import PARAMETERS, Px4Settings
from .wire import Parameters

_LOST_TRANSMITTER = "NAV_RCL_ACT"
_MEANINGS = {Mode.LOITER: "hold", Mode.RTL: "return", Mode.LAND: "land"}
_SENSORS = ("gps", "imu", "magnetometer", "barometer")
_ENDS = {EndpointKind.UDP_IN: EndpointKind.UDP_OUT, EndpointKind.UDP_OUT: EndpointKind.UDP_IN}


def fly_world(
    configuration: Configuration,
    settings: Optional[Px4Settings] = None,
    scenario: Optional[Scenario] = None,
    *,
    seed: int = 0,
    start_ns: int = 0,
    unix_ns: int = 0,
    without: Tuple[str, ...] = (),
    live: bool = False,
    kind: Tuple[Type[Craft], Type[Px4]] = (Craft, Px4),
) -> Tuple[World, Px4]:
    """Make a world whose vehicle is flown over MAVLink, and its PX4; faults, physics and battery are the world's.

    `kind` are the classes of another autopilot and its craft.

    Raises:
        UnsupportedParameterError: with a value of a parameter it would do something else than a real vehicle.
    """
    chosen = settings or Px4Settings()
    make_craft, make_autopilot = kind

    def craft(vehicle: VehicleSettings, t_ns: int) -> Craft:
        return make_craft(vehicle, t_ns, chosen.geography)

    world = World(configuration, seed, scenario, start_ns=start_ns, without=without, live=live, make_vehicle=craft)
    cells = world.power.cells
    expected = dict(configuration.autopilot.parameters)
    chosen = dataclasses.replace(
        chosen,
        parameters={"BAT1_N_CELLS": cells, **_as_given(expected), **chosen.parameters},
        land_channel=chosen.land_channel or configuration.autopilot.land_switch.channel,
    )
    watched = tuple(each.autopilot.value for each in world.settings.components if each.autopilot is not None)

    vehicle = world.vehicle
    if not isinstance(vehicle, Craft):
        raise TypeError("the world made another vehicle than it was told to")

    def sensors() -> Dict[str, Optional[bool]]:
        """Return what PX4 says; of a GPS without a fix it says nothing bad."""
        good = {name for name in _SENSORS if name not in watched or (name == "gps" and vehicle.flags.gps_lost)}
        return {name: True if name in good else healthy for name, healthy in world.sensor_health().items()}

    px4 = make_autopilot(
        vehicle,
        world.power,
        start_ns,
        chosen,
        sensors=sensors,
        wrong=lambda: _wrong(world),
        seed=seed,
        unix_ns=unix_ns,
    )
    _check_parameters(px4.parameters)
    return world, px4


def _check_parameters(parameters: Parameters) -> None:
    if _LOST_TRANSMITTER in parameters and parameters[_LOST_TRANSMITTER] not in WITHOUT_TRANSMITTER:
        meanings = {value: _MEANINGS[mode] for value, mode in WITHOUT_TRANSMITTER.items()}
        raise UnsupportedParameterError(_LOST_TRANSMITTER, parameters[_LOST_TRANSMITTER], meanings)


def _wrong(world: World) -> Wrong:
    """Return what PX4 is wrong about by the faults that act now."""
    off, landed = world.acting("estimate_off"), None
    if world.acting("ground_unknown") is not None:
        landed = VehicleLanded.UNKNOWN
    elif world.acting("seems_landed") is not None:
        landed = VehicleLanded.ON_GROUND
    if off is None:
        return Wrong(landed=landed)
    return Wrong((off.number("position_m"), 0.0, off.number("height_m")), landed)


def _as_given(values: Mapping[str, float]) -> Dict[str, Union[int, float]]:
    """Return the parameters that a configuration expects, each as the kind of number that PX4 has."""
    return {name: type(PARAMETERS.get(name, 0.0))(value) for name, value in values.items()}


def addresses_of(configuration: Configuration) -> Tuple[str, ...]:
    """Return the vehicle's ends of the links of the autopilot node and of the planner.

    Raises:
        VehicleAddressError: a link is no UDP link, so the simulated vehicle cannot be at its other end.
    """
    return tuple(_other_end(link.url) for link in (configuration.autopilot.link, configuration.autopilot.planner_link))


def _other_end(url: str) -> str:
    try:
        endpoint = parse_endpoint(url)
    except EndpointError as error:
        raise VehicleAddressError(url, str(error)) from error
    if endpoint.kind not in _ENDS:
        raise VehicleAddressError(url, "the simulated vehicle is reached by udpin: or udpout: only")
    return str(endpoint._replace(kind=_ENDS[endpoint.kind]))
