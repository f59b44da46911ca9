"""A mission with its waypoints: what the planner flies, how long it takes, and what it costs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

from amaze_autonomy.engine.mission import Mission

from .fence import Fence, check_fence
from .flight_model import Bounds, FlightEstimate, FlightModel, check_trajectory, estimate_flight
from .geodesy import Home
from .planner_spec import Controller
from .waypoints import Trajectory

__all__ = ["MissionPlan", "Round", "battery_needed_fraction", "check_files", "estimate_rounds", "total"]

_HOME = (0.0, 0.0)


@dataclass(frozen=True)
class Round:
    """All waypoint files of a mission flown once; the flights in the order of the files."""

    flights: Tuple[FlightEstimate, ...]


@dataclass(frozen=True)
class MissionPlan:
    """A mission and what belongs to it.

    Args:
        mission: as the engine sees it.
        trajectories: one per waypoint file.
        first: estimate of the first repetition, which takes off at the origin.
        again: estimate of any further one, which takes off where the last file landed.
        home: where the first takeoff must be; None: wherever the vehicle stands.
        controller: who steers along the waypoints.
    """

    mission: Mission
    trajectories: Tuple[Trajectory, ...]
    first: Round
    again: Round
    home: Optional[Home] = None
    controller: Controller = Controller.MISSION

    def flight(self, file_index: int, repetition: int) -> FlightEstimate:
        """Return the estimate of one flight, both counted from 0."""
        return (self.again if repetition else self.first).flights[file_index]

    @property
    def total(self) -> FlightEstimate:
        """Return length and duration of the whole mission."""
        return total(self.first, self.again, self.mission.repetitions)


def _ends(trajectories: Tuple[Trajectory, ...]) -> Tuple[Tuple[float, float], ...]:
    return tuple((each.waypoints[-1].x_m, each.waypoints[-1].y_m) for each in trajectories)


def check_files(
    trajectories: Tuple[Trajectory, ...],
    repetitions: int,
    takeoff_height_m: float,
    bounds: Bounds,
    limits: Tuple[float, float],
    fences: Sequence[Fence] = (),
) -> None:
    """Check all files of a mission, each from where it takes off; every leg must be good for every fence.

    Raises:
        WaypointError: a file cannot be flown.
    """
    ends = _ends(trajectories)
    flights = list(zip(trajectories, (_HOME, *ends)))
    if repetitions > 1:
        flights.append((trajectories[0], ends[-1]))
    for trajectory, start in flights:
        check_trajectory(trajectory, start, takeoff_height_m, bounds, limits)
        check_fence(trajectory, start, fences)


def estimate_rounds(
    trajectories: Tuple[Trajectory, ...], takeoff_height_m: float, model: FlightModel
) -> Tuple[Round, Round]:
    """Estimate the first repetition, and any further one."""
    ends = _ends(trajectories)
    first, again = (
        Round(
            tuple(
                estimate_flight(trajectory, start, takeoff_height_m, model)
                for trajectory, start in zip(trajectories, (home, *ends))
            )
        )
        for home in (_HOME, ends[-1])
    )
    return first, again


def total(first: Round, again: Round, repetitions: int) -> FlightEstimate:
    """Return length and duration of all repetitions together."""
    flights = (*first.flights, *again.flights * (repetitions - 1))
    return FlightEstimate(
        math.fsum(flight.length_m for flight in flights), math.fsum(flight.duration_s for flight in flights)
    )


def battery_needed_fraction(duration_s: float, reserve_fraction: float, model: FlightModel) -> float:
    """Estimate the battery that a mission needs, reserve included; above 1 when no battery is enough."""
    return duration_s / model.endurance_s + reserve_fraction
