"""Waypoint files: comma-separated, a header, then one waypoint per line.

    x,y,z,yaw,holdtime          metres east and north of the takeoff position, metres above it,
    2.0,0.0,1.5,0.0,1.0         yaw in radians counter-clockwise from east, seconds to hold there

The header chooses the unit of the yaw: `yaw` or `yaw_rad` is in radians, `yaw_deg` in degrees. The columns may stand in
any order; `holdtime` may be left out and is then 0. Empty lines and lines that begin with # are not looked at. Files in
latitude and longitude: `routes.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Tuple

from .csv_table import YAW_COLUMNS, Layout, lines_of, read_table, yaw_of
from .geodesy import Place

__all__ = ["COLUMNS", "Names", "Trajectory", "Waypoint", "parse_trajectory"]

COLUMNS = ("x", "y", "z", "yaw", "holdtime")
_LAYOUT = Layout(
    COLUMNS,
    ("holdtime",),
    "must be the columns x,y,z,yaw,holdtime, separated by commas (yaw in radians, or yaw_deg in degrees)",
)


class Names(NamedTuple):
    """What a file calls the parts of a waypoint, for errors."""

    place: str = "x,y"
    height: str = "z"
    whole: str = "x,y,z"
    hold: str = "holdtime"


LOCAL_NAMES = Names()


@dataclass(frozen=True)
class Waypoint:
    """A place to fly to, relative to the position of the mission's first takeoff (REP-103: x east, y north, z up).

    Args:
        x_m: east.
        y_m: north.
        z_m: up.
        yaw_rad: counter-clockwise from east.
        hold_s: how long to stay.
        line: of the file it was read from, for errors.
    """

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    hold_s: float
    line: int = 0


@dataclass(frozen=True)
class Trajectory:
    """The waypoints of one file.

    Args:
        file: its name, relative to the configuration's folder.
        waypoints: at least one.
        yaw_column: name of its yaw column, for errors.
        names: of its other columns.
        places: of the waypoints on the earth, as the file says them; empty when the file is in local metres.
    """

    file: str
    waypoints: Tuple[Waypoint, ...]
    yaw_column: str = "yaw"
    names: Names = LOCAL_NAMES
    places: Tuple[Place, ...] = ()


def parse_trajectory(text: str, file: str) -> Trajectory:
    """Read a whole waypoint file in local metres.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    columns, rows = read_table(file, lines_of(text), _LAYOUT)
    waypoints = tuple(
        Waypoint(
            row.values["x"],
            row.values["y"],
            row.values["z"],
            yaw_of(file, row),
            row.values.get("holdtime", 0.0),
            row.line,
        )
        for row in rows
    )
    return Trajectory(file, waypoints, next(column for column in columns if column in YAW_COLUMNS))
