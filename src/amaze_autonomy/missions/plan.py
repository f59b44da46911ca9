"""A mission with its waypoints: what the planner flies, how long it takes, and what it costs."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

from amaze_autonomy.engine.events import Mission

from .csv_table import Frame
from .fence import Fence, check_fence
from .flight_model import Bounds, FlightEstimate, FlightModel, check_trajectory, estimate_flight
from .geodesy import Home
from .waypoints import Trajectory

__all__ = [
    "Controller",
    "MissionPlan",
    "PlannerSpec",
    "Round",
    "battery_needed_fraction",
    "check_files",
    "estimate_rounds",
    "total",
]

# --- planner spec -----------------------------------------------------------------------------------------------------
# How the mission planner flies missions through the autopilot: what it asks for, and how long it waits.


_S = 1_000_000_000


class Controller(enum.Enum):
    """Who steers along the waypoints."""

    MISSION = "mission"  # the autopilot, by a mission that was sent to it: needs a position on the earth
    OFFBOARD = "offboard"  # the planner, by set-points in the local frame: needs a local position only


@dataclass(frozen=True)
class PlannerSpec:
    """Limits of the planner.

    Args:
        acceptance_radius_m: nearer than this a waypoint is reached.
        heading_tolerance_rad: likewise for the yaw, with set-points.
        home_tolerance_m: how far the first takeoff may be from a mission's home.
        transfer_limit_ns: time in which a waypoint file must be sent, read back and compared.
        message_retry_ns: time without an answer after which a message of the mission protocol is sent again.
        command_retry_ns: time without an effect after which a command is sent again.
        command_limit_ns: time in which a command must show its effect.
        vehicle_age_limit_ns: how old the vehicle's last word may be to be believed.
        setpoint_rate_hz: of the stream of set-points.
        setpoint_lead_ns: how long they are sent before the autopilot is told to follow them.
        pose_age_limit_ns: how old the local position may be to be flown by.
    """

    acceptance_radius_m: float = 0.5
    heading_tolerance_rad: float = 0.2617993877991494
    home_tolerance_m: float = 5.0
    transfer_limit_ns: int = 8 * _S
    message_retry_ns: int = _S // 2
    command_retry_ns: int = _S // 2
    command_limit_ns: int = 4 * _S
    vehicle_age_limit_ns: int = 3 * _S
    setpoint_rate_hz: float = 20.0
    setpoint_lead_ns: int = _S
    pose_age_limit_ns: int = _S // 2


# --- plan -------------------------------------------------------------------------------------------------------------


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
        fences: that its legs were checked against.
        land_switch: the switch of the transmitter that means land counts.
    """

    mission: Mission
    trajectories: Tuple[Trajectory, ...]
    first: Round
    again: Round
    home: Optional[Home] = None
    controller: Controller = Controller.MISSION
    fences: Tuple[Fence, ...] = ()
    land_switch: bool = True

    def flight(self, file_index: int, repetition: int) -> FlightEstimate:
        """Return the estimate of one flight, both counted from 0."""
        return (self.again if repetition else self.first).flights[file_index]

    @property
    def frame(self) -> Frame:
        """Return the frame of all its waypoints."""
        return self.trajectories[0].frame

    @property
    def total(self) -> FlightEstimate:
        """Return length and duration of the whole mission."""
        return total(self.first, self.again, self.mission.repetitions)


def _ends(trajectories: Tuple[Trajectory, ...]) -> Tuple[Tuple[float, float], ...]:
    """Return where each file lands in the frame of the next: at its origin, where that counts from its own takeoff."""
    if trajectories[0].frame is Frame.START_HEADING:
        return (_HOME,) * len(trajectories)
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
    if trajectories[0].frame is Frame.START_HEADING:
        _check_reach(trajectories, repetitions, limits[1])


def _check_reach(trajectories: Tuple[Trajectory, ...], repetitions: int, limit_m: float) -> None:
    """Check that files that count from their own takeoffs stay near the first one, whichever way each of them heads."""
    moved = [math.hypot(each.waypoints[-1].x_m, each.waypoints[-1].y_m) for each in trajectories]
    away = math.fsum(moved) * (repetitions - 1)
    for trajectory, further in zip(trajectories, moved):
        for waypoint in trajectory.waypoints:
            way = away + math.hypot(waypoint.x_m, waypoint.y_m)
            if not way < limit_m:
                wrong = f"can be {way:.6g} m from the first takeoff, after the flights before it"
                right = f"must be below the distance limit {limit_m:g}, in metres"
                raise trajectory.error(waypoint, "place", wrong, right)
        away += further


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
