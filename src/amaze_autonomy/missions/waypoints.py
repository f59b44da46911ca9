"""Waypoint files: comma-separated, a header, then one waypoint per line.

    x,y,z,yaw,holdtime          metres east and north of the takeoff position, metres above it,
    2.0,0.0,1.5,0.0,1.0         yaw in radians counter-clockwise from east, seconds to hold there

The header chooses the unit of the yaw: `yaw` or `yaw_rad` is in radians, `yaw_deg` in degrees. The columns may stand in
any order; `holdtime` may be left out and is then 0. Empty lines and lines that begin with # are not looked at.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Dict, List, Tuple

from .errors import WaypointError

__all__ = ["COLUMNS", "Trajectory", "Waypoint", "parse_trajectory"]

COLUMNS = ("x", "y", "z", "yaw", "holdtime")
_YAWS = ("yaw", "yaw_rad", "yaw_deg")
_OPTIONAL = ("holdtime",)
_HEADER = "must be the columns x,y,z,yaw,holdtime, separated by commas (yaw in radians, or yaw_deg in degrees)"
_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_TURN = {"yaw": 2 * math.pi, "yaw_rad": 2 * math.pi, "yaw_deg": 360.0}


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
    """

    file: str
    waypoints: Tuple[Waypoint, ...]
    yaw_column: str = "yaw"


def parse_trajectory(text: str, file: str) -> Trajectory:
    """Read a whole waypoint file.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    lines = [
        (number, line.strip())
        for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1)
        if line.strip() and not line.strip().startswith("#")
    ]
    if not lines:
        raise WaypointError(file, 0, "", "is empty", _HEADER)
    columns = _columns(file, *lines[0])
    if len(lines) == 1:
        raise WaypointError(file, lines[0][0], "", "has no waypoints", "must have at least one line below the header")
    waypoints = tuple(_waypoint(file, number, line, columns) for number, line in lines[1:])
    return Trajectory(file, waypoints, next(column for column in columns if column in _YAWS))


def _columns(file: str, number: int, line: str) -> List[str]:
    columns = [column.strip() for column in line.lstrip("\ufeff").split(",")]
    for column in columns:
        if column not in (*COLUMNS, *_YAWS):
            raise WaypointError(file, number, "", f"the header has the column {column[:40]!r}", _HEADER)
    kinds = ["yaw" if column in _YAWS else column for column in columns]
    for kind in COLUMNS:
        if kinds.count(kind) > 1:
            raise WaypointError(file, number, "", f"the header has the column {kind} twice", _HEADER)
        if kind not in kinds and kind not in _OPTIONAL:
            raise WaypointError(file, number, "", f"the header lacks the column {kind}", _HEADER)
    return columns


def _waypoint(file: str, number: int, line: str, columns: List[str]) -> Waypoint:
    cells = [cell.strip() for cell in line.split(",")]
    if len(cells) != len(columns):
        right = f"must have {len(columns)}: {','.join(columns)}"
        raise WaypointError(file, number, "", f"has {len(cells)} columns", right)
    values: Dict[str, float] = {}
    for column, cell in zip(columns, cells):
        values[column] = _number(file, number, column, cell)
    return Waypoint(
        values["x"], values["y"], values["z"], _yaw(file, number, values), values.get("holdtime", 0.0), number
    )


def _number(file: str, number: int, column: str, cell: str) -> float:
    if _NUMBER.fullmatch(cell) is None or not math.isfinite(float(cell)):
        wrong = f"is {cell[:40]!r}" if cell else "has no value"
        raise WaypointError(file, number, column, wrong, "must be a finite number")
    return float(cell) + 0.0


def _yaw(file: str, number: int, values: Dict[str, float]) -> float:
    column = next(column for column in _YAWS if column in values)
    value = values[column]
    if abs(value) > _TURN[column] + 1e-9:
        right = "must be within a turn, 360 degrees"
        if column != "yaw_deg":
            right = f"must be within a turn, {_TURN[column]:.4f} rad; are these degrees? Then call the column yaw_deg"
        raise WaypointError(file, number, column, f"is {value:g}", right)
    return math.radians(value) if column == "yaw_deg" else value
