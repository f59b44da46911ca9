"""A mission with its waypoints: what the planner flies, how long it takes and costs, by a simple model."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

from amaze_autonomy.engine.events import Mission

from .csv_table import Frame
from .fence import Fence, check_fence
from .waypoints import Home, Trajectory, Waypoint

# --- the flight model -------------------------------------------------------------------------------------------------
# Each waypoint is a stop: the vehicle accelerates, cruises, brakes, holds. A leg takes as long as the slowest of its
# horizontal way, its vertical way and its turn. Only the four operations and square roots: the same figures everywhere.


_TURN = 2 * math.pi


@dataclass(frozen=True)
class FlightModel:
    """How the vehicle flies.

    Args:
        cruise_speed_m_s: horizontal.
        climb_speed_m_s: vertical, up.
        descent_speed_m_s: vertical, down, between waypoints.
        landing_speed_m_s: vertical, down, of a landing.
        acceleration_m_s2: of start and stop at each waypoint.
        turn_rate_rad_s: of the yaw.
        ground_time_s: with turning propellers on the ground, each takeoff and its landing together.
        endurance_s: flight time of a full battery.
    """

    cruise_speed_m_s: float = 1.0
    climb_speed_m_s: float = 1.0
    descent_speed_m_s: float = 0.7
    landing_speed_m_s: float = 0.5
    acceleration_m_s2: float = 1.0
    turn_rate_rad_s: float = 0.8
    ground_time_s: float = 5.0
    endurance_s: float = 1000.0


@dataclass(frozen=True)
class Bounds:
    """What a waypoint file may hold.

    Args:
        min_height_m: lowest waypoint.
        max_leg_m: longest way between two waypoints.
        max_first_leg_m: longest way from the takeoff to the first waypoint.
        max_hold_s: longest hold.
        max_waypoints: of one file.
    """

    min_height_m: float = 0.5
    max_leg_m: float = 50.0
    max_first_leg_m: float = 10.0
    max_hold_s: float = 120.0
    max_waypoints: int = 500


@dataclass(frozen=True)
class FlightEstimate:
    """One flight of a waypoint file, from takeoff to touchdown.

    Args:
        length_m: from the takeoff position over all waypoints to the touchdown.
        duration_s: with the time on the ground.
    """

    length_m: float
    duration_s: float


def distance_m(one: Waypoint, other: Waypoint) -> float:
    """Return the straight way between two waypoints."""
    x, y, z = other.x_m - one.x_m, other.y_m - one.y_m, other.z_m - one.z_m
    return math.sqrt(x * x + y * y + z * z)


def _travel_s(way_m: float, speed_m_s: float, acceleration_m_s2: float) -> float:
    """Return the time of a way from stop to stop: a trapezoid of speed, or a triangle when the way is short."""
    if way_m * acceleration_m_s2 >= speed_m_s * speed_m_s:
        return way_m / speed_m_s + speed_m_s / acceleration_m_s2
    return 2.0 * math.sqrt(way_m / acceleration_m_s2)


def leg_s(one: Waypoint, other: Waypoint, model: FlightModel) -> float:
    """Return the time from one waypoint to another, without holding there."""
    x, y, z = other.x_m - one.x_m, other.y_m - one.y_m, other.z_m - one.z_m
    turn = abs(other.yaw_rad - one.yaw_rad) % _TURN
    vertical = model.climb_speed_m_s if z > 0 else model.descent_speed_m_s
    return max(
        _travel_s(math.sqrt(x * x + y * y), model.cruise_speed_m_s, model.acceleration_m_s2),
        _travel_s(abs(z), vertical, model.acceleration_m_s2),
        min(turn, _TURN - turn) / model.turn_rate_rad_s,
    )


def climb_s(height_m: float, model: FlightModel) -> float:
    """Return the time of the climb of a takeoff."""
    return _travel_s(height_m, model.climb_speed_m_s, model.acceleration_m_s2)


def _start(trajectory: Trajectory, start: Tuple[float, float], takeoff_height_m: float) -> Waypoint:
    """Return the end of the takeoff: above the start, with the yaw of the first waypoint."""
    return Waypoint(start[0], start[1], takeoff_height_m, trajectory.waypoints[0].yaw_rad, 0.0)


def estimate_flight(
    trajectory: Trajectory, start: Tuple[float, float], takeoff_height_m: float, model: FlightModel
) -> FlightEstimate:
    """Estimate the flight of a file that takes off at `start` (x, y in metres) and lands below its last waypoint."""
    points = (_start(trajectory, start, takeoff_height_m), *trajectory.waypoints)
    legs = tuple(zip(points, points[1:]))
    last = points[-1]
    climb = climb_s(takeoff_height_m, model)
    landing = last.z_m / model.landing_speed_m_s
    flown = math.fsum(leg_s(one, other, model) + other.hold_s for one, other in legs)
    length = math.fsum(distance_m(one, other) for one, other in legs)
    return FlightEstimate(takeoff_height_m + length + last.z_m, model.ground_time_s + climb + flown + landing)


def check_trajectory(
    trajectory: Trajectory,
    start: Tuple[float, float],
    takeoff_height_m: float,
    bounds: Bounds,
    limits: Tuple[float, float],
) -> None:
    """Check that a file can be flown; `limits` are height and distance (m) at which a flight is ended.

    Raises:
        WaypointError: the first waypoint that cannot be.
    """
    if len(trajectory.waypoints) > bounds.max_waypoints:
        first_beyond, right = (
            trajectory.waypoints[bounds.max_waypoints],
            f"must have at most {bounds.max_waypoints} (bounds)",
        )
        raise trajectory.error(first_beyond, "", f"has {len(trajectory.waypoints)} waypoints", right)
    for waypoint in trajectory.waypoints:
        _check_waypoint(trajectory, waypoint, start, bounds, limits)
    first = trajectory.waypoints[0]
    if first.z_m < takeoff_height_m:
        right = f"the first waypoint must be at the takeoff height ({takeoff_height_m:g} m) or above"
        raise trajectory.error(first, "height", f"is {first.z_m:g}", right)
    _check_leg(trajectory, _start(trajectory, start, takeoff_height_m), first, bounds.max_first_leg_m, "the takeoff")
    for one, other in zip(trajectory.waypoints, trajectory.waypoints[1:]):
        _check_leg(trajectory, one, other, bounds.max_leg_m, "the waypoint before")


def _check_waypoint(
    trajectory: Trajectory, waypoint: Waypoint, start: Tuple[float, float], bounds: Bounds, limits: Tuple[float, float]
) -> None:
    """Check a waypoint by itself, also how far it is from the first takeoff and from its own."""
    height, distance = limits
    way = math.sqrt(waypoint.x_m * waypoint.x_m + waypoint.y_m * waypoint.y_m)
    if not bounds.min_height_m <= waypoint.z_m < height:
        right = f"must be at least {bounds.min_height_m:g} and below the height limit {height:g}, in metres"
        raise trajectory.error(waypoint, "height", f"is {waypoint.z_m:g}", right)
    if not way < distance:
        right = f"must be below the distance limit {distance:g}, in metres"
        raise trajectory.error(waypoint, "place", f"is {way:.6g} m from the takeoff position", right)
    way = math.hypot(waypoint.x_m - start[0], waypoint.y_m - start[1])
    if not way < distance:
        right = f"must be below the distance limit {distance:g}, in metres"
        raise trajectory.error(waypoint, "place", f"is {way:.6g} m from where its file takes off", right)
    if not 0.0 <= waypoint.hold_s <= bounds.max_hold_s:
        right = f"must be 0 to {bounds.max_hold_s:g}, in seconds"
        raise trajectory.error(waypoint, "hold", f"is {waypoint.hold_s:g}", right)


def _check_leg(trajectory: Trajectory, one: Waypoint, other: Waypoint, longest_m: float, what: str) -> None:
    way = distance_m(one, other)
    if not way <= longest_m:
        wrong = f"is {way:.6g} m from {what}"
        right = f"must be at most {longest_m:g} m away (bounds)"
        raise trajectory.error(other, "whole", wrong, right)


# --- the plan ---------------------------------------------------------------------------------------------------------


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
        home_tolerance_m: how far the first takeoff may be from a mission's home, a later one from where the file before
            ends.
        transfer_limit_ns: time in which a waypoint file must be sent, read back and compared.
        message_retry_ns: time without an answer after which a message of the mission protocol is sent again.
        command_retry_ns: time without an effect after which a command is sent again.
        command_limit_ns: time in which a command must show its effect.
        vehicle_age_limit_ns: how old the vehicle's last message may be to be believed.
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
        hover_at_end_s: that the hold at the last waypoint of the last file is longer than the file says.
    """

    mission: Mission
    trajectories: Tuple[Trajectory, ...]
    first: Round
    again: Round
    home: Optional[Home] = None
    controller: Controller = Controller.MISSION
    fences: Tuple[Fence, ...] = ()
    land_switch: bool = True
    hover_at_end_s: float = 0.0

    def as_drawn(self, file_index: int) -> Trajectory:
        """Return what a file says, without the hover at the mission's end."""
        drawn, last = self.trajectories[file_index], file_index == len(self.trajectories) - 1
        return drawn.hovering(-self.hover_at_end_s) if last and self.hover_at_end_s else drawn

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
