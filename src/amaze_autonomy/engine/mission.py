"""What the engine needs to know of a mission."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

from .severity import Severity

__all__ = ["Mission"]


@dataclass(frozen=True)
class Mission:
    """A mission as the engine sees it: the waypoints themselves are the planner's business.

    Args:
        id: as the user selects it, e.g. "1".
        description: one line for the user.
        files: number of waypoint files, at least 1.
        repetitions: how often the files are flown, at least 1.
        battery_needed_fraction: fraction 0..1 of the battery that it needs, reserve included; None: unknown.
        estimated_duration_s: of all files and repetitions together; None: unknown.
        severities: (component, severity) for components that this mission judges otherwise.
        required: components that must be at code 1 before takeoff; empty: all listed.
        tolerated: components that may be at code 2 before takeoff.
        max_height_m: limit above the takeoff position; None: the configuration's.
        max_distance_m: limit of the horizontal distance from the takeoff position; None: the configuration's.
        max_flight_time_ns: limit from the TAKEOFF command on; None: the configuration's.
    """

    id: str
    description: str = ""
    files: int = 1
    repetitions: int = 1
    battery_needed_fraction: Optional[float] = None
    estimated_duration_s: Optional[float] = None
    severities: Tuple[Tuple[str, Severity], ...] = ()
    required: Tuple[str, ...] = ()
    tolerated: Tuple[str, ...] = ()
    max_height_m: Optional[float] = None
    max_distance_m: Optional[float] = None
    max_flight_time_ns: Optional[int] = None

    def __post_init__(self) -> None:
        if not self.id:
            raise ValueError("a mission needs an id")
        if self.files < 1 or self.repetitions < 1:
            raise ValueError(f"mission {self.id}: files and repetitions must be at least 1")
        needed = self.battery_needed_fraction
        if needed is not None and not 0.0 <= needed <= 1.0:
            raise ValueError(f"mission {self.id}: battery_needed_fraction is {needed}, must be within 0..1")
