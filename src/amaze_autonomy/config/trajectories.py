"""Reads the waypoint files that missions name, and plans the missions."""

from __future__ import annotations

import difflib
import hashlib
import math
import re
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.missions import (
    SAME_M,
    SUFFIXES,
    Bounds,
    Controller,
    Fence,
    FlightModel,
    Frame,
    Home,
    MissionPlan,
    Polygon,
    Round,
    Route,
    Said,
    Trajectory,
    Waypoint,
    WaypointError,
    YawUnit,
    battery_needed_fraction,
    check_files,
    estimate_rounds,
    joined,
    localize,
    localize_fence,
    parse_file,
    polygon_problem,
    total,
)
from amaze_autonomy.monitoring.specs import ComponentSpec

from .consistency import check_known, returns_too_late, waits
from .errors import ConfigError, Place
from .kinds import Address, Places, dotted
from .model import Configuration, mission_of
from .schema import make, place_of, refuse_at
from .schemas.missions import MISSION_ID

_BYTES = 1_000_000


def read_files(folder: Path, missions: Mapping[str, Any], places: Places) -> Files:
    """Read every waypoint file once: its waypoints, and the SHA-256 of its bytes.

    Raises:
        ConfigError: a file is missing, outside the folder, or not a waypoint file.
    """
    files: Files = {}
    for mission_id, mission in missions["missions"].items():
        for position, name in enumerate(mission["files"]):
            key = (name, _said_of(mission))
            if key not in files:
                here = ("missions", mission_id, "files", str(position))
                files[key] = _read(folder, name, key[1], here, places)
    return files


def _said_of(mission: Mapping[str, Any]) -> Said:
    """Return what a mission says of its files."""
    frame, unit = mission["frame"], mission["yaw_unit"]
    return Said(None if frame is None else Frame(frame), None if unit is None else YawUnit(unit))


def _files_of(mission: Mapping[str, Any], files: Files) -> List[File]:
    return [files[name, _said_of(mission)][0] for name in mission["files"]]


def _read(folder: Path, name: str, said: Said, here: Address, places: Places) -> Tuple[File, str]:
    place, path = place_of(here, places), folder / name
    inside = folder.resolve()
    try:
        outside = inside not in path.resolve().parents
        content = path.read_bytes() if not outside and path.is_file() else b""
    except (OSError, RuntimeError, ValueError):
        outside, content = False, b""
    if outside:
        right = "must lie inside the folder of the configuration"
        raise ConfigError(place, dotted(here), f"{name} leaves the folder", right)
    if not content or len(content) > _BYTES:
        wrong = f"{name} is larger than {_BYTES} bytes" if content else f"{name} is missing, empty or cannot be read"
        raise ConfigError(place, dotted(here), wrong, f"must be a waypoint file in {folder}{_hint(folder, name)}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise ConfigError(Place(str(path), line), "", "is not UTF-8", "must be saved as UTF-8 text") from None
    try:
        return parse_file(text, name, said), hashlib.sha256(content).hexdigest()
    except WaypointError as error:
        raise _config_error(error, folder) from None


def _hint(folder: Path, name: str) -> str:
    """Return the question for a file that is there and has nearly the same name; empty when there is none."""
    there = sorted(path.relative_to(folder).as_posix() for path in folder.glob("**/*") if path.suffix in SUFFIXES)
    close = [each for each in difflib.get_close_matches(name, there, n=1) if each != name]
    return f"; did you mean {close[0]}?" if close else ""


def _config_error(error: WaypointError, folder: Path) -> ConfigError:
    return ConfigError(Place(str(folder / error.file), error.line), error.column, error.wrong, error.right)


def plans_of(
    folder: Path,
    missions: Mapping[str, Any],
    files: Files,
    limits: Limits,
    components: Tuple[ComponentSpec, ...],
    places: Places,
) -> Tuple[MissionPlan, ...]:
    """Plan every mission, in the order of the file.

    Raises:
        ConfigError: a mission cannot be flown, or names a component that is not there.
    """
    model = make(FlightModel, missions["flight"], ("flight",), places)
    bounds = make(Bounds, missions["bounds"], ("bounds",), places)
    names = tuple(component.name for component in components)
    plans: List[MissionPlan] = []
    for mission_id, values in missions["missions"].items():
        here = ("missions", mission_id)
        _check_names(values, names, here, places)
        _check_waits(values, components, limits, here, places)
        home = home_of(values, files)
        own = values["limits"]
        reach = (own["max_height_m"] or limits.max_height_m, own["max_distance_m"] or limits.max_distance_m)
        try:
            trajectories = trajectories_of(values, files, home, here, places)
            _check_planned_home(values, files, reach[1])
            if not values["touchdown_between_files"] and len(trajectories) > 1:
                trajectories = (joined(trajectories),)
            fences = fences_of(values, files, home, here, places)
            check_files(trajectories, values["repetitions"], limits.takeoff_height_m, bounds, reach, fences)
        except WaypointError as error:
            raise _config_error(error, folder) from None
        hover_s = values["hover_at_end_s"]
        if hover_s:
            trajectories = (*trajectories[:-1], trajectories[-1].hovering(hover_s))
        plan = _plan(mission_id, values, components, trajectories, home, model, limits, places)
        plans.append(replace(plan, fences=fences, land_switch=values["land_switch"], hover_at_end_s=hover_s))
    return tuple(plans)


def plan_of_waypoints(
    configuration: Configuration, mission_id: str, frame: Optional[Frame], waypoints: Sequence[Waypoint]
) -> MissionPlan:
    """Plan a mission of waypoints that no file has, checked as files are and flown once.

    Args:
        configuration: with bounds and limits.
        mission_id: none of those that are configured.
        frame: of the waypoints; None: they were given in one that there is not.
        waypoints: each with its number, from 1, as its line.

    Raises:
        WaypointError: it cannot be flown.
    """
    file, limits = f"waypoints of {mission_id!r}", configuration.rules.limits
    if any(plan.mission.id == mission_id for plan in configuration.plans):
        raise WaypointError(file, 0, "mission_id", "is that of a configured mission", "must be another one")
    if not re.fullmatch(MISSION_ID, mission_id):
        raise WaypointError(file, 0, "mission_id", "is none", "must be 1 to 32 letters, digits, _ and -")
    if frame is None:
        raise WaypointError(file, 0, "frame", "is none", f"must be {' or '.join(each.value for each in Frame)}")
    if not waypoints:
        raise WaypointError(file, 0, "", "has no waypoints", "must have at least one")
    for each in waypoints:
        numbers = (each.x_m, each.y_m, each.z_m, each.yaw_rad, each.hold_s)
        if not all(map(math.isfinite, numbers)):
            raise WaypointError(file, each.line, "x,y,z,yaw,hold", f"is {numbers}", "must be finite numbers")
        if abs(each.yaw_rad) > 2 * math.pi + 1e-9:
            right = f"must be within a turn, {2 * math.pi:.4f} rad; are these degrees?"
            raise WaypointError(file, each.line, "yaw", f"is {each.yaw_rad:g}", right)
    flights, height_m = (Trajectory(file, tuple(waypoints), frame=frame),), limits.takeoff_height_m
    check_files(flights, 1, height_m, configuration.bounds, (limits.max_height_m, limits.max_distance_m))
    return MissionPlan(Mission(mission_id), flights, *estimate_rounds(flights, height_m, configuration.flight))


def _check_names(values: Mapping[str, Any], components: Tuple[str, ...], here: Address, places: Places) -> None:
    for key in ("severities", "required", "tolerated"):
        check_known(values[key], components, "component of sensors.yaml", (*here, key), places)
    for position, name in enumerate(values["tolerated"]):
        if name in values["required"]:
            at = (*here, "tolerated", str(position))
            right = "must be in one of them: a required component must be at code 1, a tolerated one may be at code 2"
            raise ConfigError(place_of(at, places), dotted(at), f"{name} is required as well", right)


def _check_waits(
    values: Mapping[str, Any], components: Tuple[ComponentSpec, ...], limits: Limits, here: Address, places: Places
) -> None:
    """Check the wait for components that have none of their own, and that this mission waits for."""
    for spec in components:
        severity = values["severities"].get(spec.name)
        if severity is None or not waits(severity) or spec.wait_limit_ns:
            continue
        needed = returns_too_late(spec, limits.unlisted_wait_limit_ns)
        if needed:
            unlisted = f"commands.unlisted_wait_limit_s of autonomy.yaml ({limits.unlisted_wait_limit_ns / 1e9:g})"
            right = f"must be one that is not waited for, or {unlisted} must be {needed}"
            refuse_at((*here, "severities", spec.name), places, f"is {severity}", right)


def _plan(
    mission_id: str,
    values: Mapping[str, Any],
    components: Tuple[ComponentSpec, ...],
    trajectories: Tuple[Trajectory, ...],
    home: Optional[Home],
    model: FlightModel,
    limits: Limits,
    places: Places,
) -> MissionPlan:
    here = ("missions", mission_id)
    first, again = estimate_rounds(trajectories, limits.takeoff_height_m, model)
    whole = total(first, again, values["repetitions"])
    _check_flight_time(
        values, max(flight.duration_s for flight in (*first.flights, *again.flights)), limits, here, places
    )
    needed = _battery(values, whole.duration_s, model, limits.battery_reserve_fraction, here, places)
    figures = len(trajectories), round(needed, 6), round(whole.duration_s, 6), _still_needed(first, again, values)
    mission = mission_of(mission_id, values, components, *figures)
    return MissionPlan(mission, trajectories, first, again, home, Controller(values["controller"]))


def _still_needed(first: Round, again: Round, values: Mapping[str, Any]) -> Tuple[float, ...]:
    """Return what part of a mission is still to be flown from each takeoff on; of a single flight nothing."""
    durations_s = [flight.duration_s for flight in (*first.flights, *again.flights * (values["repetitions"] - 1))]
    left_s = list(accumulate(reversed(durations_s)))[::-1]
    return tuple(round(each / left_s[0], 6) for each in left_s) if len(left_s) > 1 and left_s[0] else ()


def _battery(
    values: Mapping[str, Any], duration_s: float, model: FlightModel, reserve: float, here: Address, places: Places
) -> float:
    """Return the part of the battery that a mission needs: what it says, else what is estimated."""
    at, needed = (*here, "battery_needed_fraction"), values["battery_needed_fraction"]
    if needed is None:
        estimated = battery_needed_fraction(duration_s, reserve, model)
        if estimated > 1.0:
            wrong = f"needs {estimated:.2f} of the battery ({duration_s:.0f} s of {model.endurance_s:g} s, and reserve)"
            raise ConfigError(place_of(here, places), dotted(here), wrong, "must need at most 1: fly less, or in parts")
        return estimated
    if needed <= reserve:
        right = f"must be above the reserve, which it includes ({reserve:g})"
        refuse_at(at, places, f"is {needed:g}", right)
    if duration_s >= model.endurance_s:
        right = f"must be flown in less than flight.endurance_s ({model.endurance_s:g}): fly less, or in parts"
        refuse_at(at, places, f"is {needed:g}, and it flies for {duration_s:.0f} s in all", right)
    return float(needed)


def low_batteries(configuration: Configuration) -> List[str]:
    """Return a line for each mission that says it needs less of the battery than is estimated.

    It is no mistake: who has measured knows more than the estimate.
    """
    reserve, model = configuration.rules.limits.battery_reserve_fraction, configuration.flight
    lines = []
    for plan in configuration.plans:
        given, flown_s = plan.mission.battery_needed_fraction, plan.total.duration_s
        estimated = battery_needed_fraction(flown_s, reserve, model)
        if given is not None and given < round(estimated, 6):
            lines.append(
                f"missions.yaml: mission {plan.mission.id} says battery_needed_fraction {given:g}, and {estimated:.2f} "
                f"is what {flown_s:.0f} s of flight.endurance_s ({model.endurance_s:g}) and the reserve are: have you "
                "measured it?"
            )
    return lines


def _check_flight_time(
    values: Mapping[str, Any], longest_s: float, limits: Limits, here: Address, places: Places
) -> None:
    own = values["limits"]["max_flight_time_s"]
    allowed = limits.max_flight_time_ns / 1e9 if own is None else own
    if longest_s < allowed:
        return
    at = here if own is None else (*here, "limits", "max_flight_time_s")
    wrong = f"its longest flight takes {longest_s:.0f} s"
    raise ConfigError(place_of(at, places), dotted(at), wrong, f"must be below max_flight_time_s ({allowed:g})")


# --- mission places ---------------------------------------------------------------------------------------------------
# Where a mission is on the earth: its home, its waypoints around it, its fences.


File = Union[Trajectory, Route]
Files = Dict[Tuple[str, Said], Tuple[File, str]]  # by name, and by what the mission says of it


def home_of(values: Mapping[str, Any], files: Files) -> Optional[Home]:
    """Return the home of a mission: its own, else that of its first plan that has one."""
    if values["home"] is not None:
        return Home(values["home"]["latitude_deg"], values["home"]["longitude_deg"])
    homes = (file.home for file in _files_of(values, files) if isinstance(file, Route))
    return next((home for home in homes if home is not None), None)


def trajectories_of(
    values: Mapping[str, Any], files: Files, home: Optional[Home], here: Address, places: Places
) -> Tuple[Trajectory, ...]:
    """Return the waypoints of each file of a mission in local metres.

    Raises:
        ConfigError: a file in latitude and longitude has no home, or a place on the earth is given where none is known.
        WaypointError: a plan takes off where it cannot.
    """
    found: List[Trajectory] = []
    offboard = values["controller"] == Controller.OFFBOARD.value
    for position, (name, file) in enumerate(zip(values["files"], _files_of(values, files))):
        at = (*here, "files", str(position))
        if isinstance(file, Trajectory):
            found.append(file)
            continue
        if offboard:
            right = "must be in metres where the controller is offboard, which knows no place on the earth"
            refuse_at(at, places, f"{name} is in latitude and longitude", right)
        if home is None:
            right = "must have a home in its mission: the latitude_deg and longitude_deg of the first takeoff"
            refuse_at(at, places, f"{name} is in latitude and longitude", right)
        last, in_flight = (found[-1].waypoints[-1], not values["touchdown_between_files"]) if found else (None, False)
        found.append(localize(file, home, last, in_flight=in_flight))
    if offboard and values["home"]:
        right = "must be left out where the controller is offboard, which knows no place on the earth"
        refuse_at((*here, "home"), places, "is given", right)
    _check_frames(values, found, here, places)
    _check_takeoff(values, files, found)
    return tuple(found)


def _check_takeoff(values: Mapping[str, Any], files: Files, found: List[Trajectory]) -> None:
    """Check that "here", where a first plan takes off, is one place: repetitions take off where the last file lands.

    Raises:
        WaypointError: it means several.
    """
    first, last = _files_of(values, files)[0], found[-1].waypoints[-1]
    if values["repetitions"] == 1 or not isinstance(first, Route) or first.points[0].place is not None:
        return
    away_m = math.hypot(last.x_m, last.y_m)
    if away_m > SAME_M:
        wrong = f"is here, which is {away_m:.1f} m away in further repetitions"
        right = "must be the place of the takeoff, or the mission must end where it begins"
        raise found[0].error(found[0].waypoints[0], "place", wrong, right)


def _check_planned_home(values: Mapping[str, Any], files: Files, distance_limit_m: float) -> None:
    """Check that a home of a plan is near what is flown from it, or each item would be called too far away.

    Raises:
        WaypointError: nothing of its plan is within the distance limit.
    """
    plans = (file for file in _files_of(values, files) if isinstance(file, Route) and file.home is not None)
    plan = next(plans, None)
    if values["home"] is not None or plan is None or plan.home is None:
        return
    ways_m = [math.hypot(*plan.home.to_local(point.place)) for point in plan.points if point.place is not None]
    if ways_m and min(ways_m) >= distance_limit_m:
        home = f"{plan.home.latitude_deg:g}, {plan.home.longitude_deg:g}"
        wrong = f"is {home}, {min(ways_m):.6g} m from its nearest item"
        right = "must be the place of the first takeoff, or its mission must have the key home"
        raise WaypointError(plan.file, plan.home_line, "plannedHomePosition", wrong, right)


def _check_frames(values: Mapping[str, Any], found: List[Trajectory], here: Address, places: Places) -> None:
    """Check that a mission from the start's heading asks for nothing that needs a direction or a place on the earth."""
    ahead = [each.frame is Frame.START_HEADING for each in found]
    if not any(ahead):
        return
    if not all(ahead):
        position = ahead.index(False)
        at = (*here, "files", str(position))
        right = (
            f"must be in the frame of the mission's other files: {values['files'][ahead.index(True)]} is start_heading"
        )
        refuse_at(at, places, f"{values['files'][position]} is not in metres from the heading at its takeoff", right)
    for key in ("fence_m", "home"):
        if values[key]:
            right = (
                "must be left out with the frame start_heading: where its waypoints lie is known at the takeoff alone"
            )
            refuse_at((*here, key), places, "is given", right)


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
    routes = [file for file in _files_of(values, files) if isinstance(file, Route)]
    return (*own, *(localize_fence(route, home) for route in routes if home is not None and route.fence))
