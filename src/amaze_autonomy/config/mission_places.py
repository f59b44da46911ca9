"""Where a mission is on the earth: its home, its waypoints around it, its fences."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Tuple, Union

from amaze_autonomy.missions import (
    Controller,
    Fence,
    Home,
    Polygon,
    Route,
    Trajectory,
    localize,
    localize_fence,
    polygon_problem,
)

from .binding import refuse_at
from .kinds import Address, Places

__all__ = ["File", "Files", "fences_of", "home_of", "trajectories_of"]

File = Union[Trajectory, Route]
Files = Dict[str, Tuple[File, str]]


def home_of(values: Mapping[str, Any], files: Files) -> Optional[Home]:
    """Return the home of a mission: its own, else that of its first plan that has one."""
    if values["home"] is not None:
        return Home(values["home"]["latitude_deg"], values["home"]["longitude_deg"])
    homes = (file.home for file, _ in (files[name] for name in values["files"]) if isinstance(file, Route))
    return next((home for home in homes if home is not None), None)


def trajectories_of(
    values: Mapping[str, Any], files: Files, home: Optional[Home], here: Address, places: Places
) -> Tuple[Trajectory, ...]:
    """Return the waypoints of each file of a mission in local metres.

    Raises:
        ConfigError: a file in latitude and longitude has no home, or is to be flown without a position on the earth.
    """
    found: List[Trajectory] = []
    for position, name in enumerate(values["files"]):
        file, at = files[name][0], (*here, "files", str(position))
        if isinstance(file, Trajectory):
            found.append(file)
            continue
        if values["controller"] == Controller.OFFBOARD.value:
            right = "must be in metres where the controller is offboard, which knows no place on the earth"
            refuse_at(at, places, f"{name} is in latitude and longitude", right)
        if home is None:
            right = "must have a home in its mission: the latitude_deg and longitude_deg of the first takeoff"
            refuse_at(at, places, f"{name} is in latitude and longitude", right)
        found.append(localize(file, home))
    return tuple(found)


def fences_of(
    values: Mapping[str, Any], files: Files, home: Optional[Home], here: Address, places: Places
) -> Tuple[Fence, ...]:
    """Return what a mission must stay inside of: its own polygon, and what its plans say.

    Raises:
        ConfigError: the corners are no polygon.
        WaypointError: those of a plan are none.
    """
    at = (*here, "fence_m")
    for number, corner in enumerate(values["fence_m"]):
        if len(corner) != 2:  # noqa: PLR2004
            wrong, right = f"has {len(corner)} numbers", "must be two numbers, metres east and north"
            refuse_at((*at, str(number)), places, wrong, right)
    corners = tuple((corner[0], corner[1]) for corner in values["fence_m"])
    problem = polygon_problem(corners) if corners else ""
    if problem:
        wrong, right = problem.split("; ")
        refuse_at(at, places, wrong, right)
    own = (Fence((Polygon(corners),)),) if corners else ()
    routes = [file for file, _ in (files[name] for name in values["files"]) if isinstance(file, Route)]
    return (*own, *(localize_fence(route, home) for route in routes if home is not None and route.fence))
