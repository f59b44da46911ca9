"""Any waypoint file: its name and its header say of which kind it is."""

from __future__ import annotations

from typing import Union

from .csv_table import Said, lines_of
from .plan_file import parse_plan
from .routes import Route, is_global, parse_route
from .waypoints import Trajectory, parse_trajectory

__all__ = ["SUFFIXES", "parse_file"]

SUFFIXES = (".csv", ".plan")


def parse_file(text: str, file: str, mission: Said = Said()) -> Union[Trajectory, Route]:  # noqa: B008 - it cannot change
    """Read a whole waypoint file: in local metres, in latitude and longitude, or a plan of QGroundControl.

    `mission` is what its mission says of files that do not say it themselves.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    if file.endswith(".plan"):
        return parse_plan(text, file)
    parse = parse_route if is_global(lines_of(text)) else parse_trajectory
    return parse(text, file, mission)
