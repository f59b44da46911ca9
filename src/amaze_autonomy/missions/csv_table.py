"""Rows of finite numbers below a header, separated by commas: every mistake with its line and column."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Dict, List, Mapping, NamedTuple, Sequence, Tuple

from .errors import WaypointError

__all__ = ["YAW_COLUMNS", "Layout", "Line", "Row", "lines_of", "read_table", "yaw_of"]

_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
YAW_COLUMNS: Mapping[str, float] = {
    "yaw": 2 * math.pi,
    "yaw_rad": 2 * math.pi,
    "yaw_deg": 360.0,
}
"""Columns for the yaw, and one turn in the unit of each."""

Line = Tuple[int, str]


@dataclass(frozen=True)
class Layout:
    """What a table holds.

    Args:
        columns: their kinds; `yaw` stands for any of YAW_COLUMNS.
        optional: those that may be left out.
        header: what the first line must be, in words.
    """

    columns: Tuple[str, ...]
    optional: Tuple[str, ...]
    header: str


class Row(NamedTuple):
    """One line below the header; the values by the names of their columns."""

    line: int
    values: Dict[str, float]


def lines_of(text: str) -> List[Line]:
    """Return the lines that count, with their numbers from 1."""
    return [
        (number, line.strip())
        for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1)
        if line.strip() and not line.strip().startswith("#")
    ]


def read_table(file: str, lines: Sequence[Line], layout: Layout) -> Tuple[List[str], List[Row]]:
    """Return the columns and the rows of a table.

    Raises:
        WaypointError: the first mistake in it, with line and column.
    """
    if not lines:
        raise WaypointError(file, 0, "", "is empty", layout.header)
    columns = _columns(file, *lines[0], layout)
    if len(lines) == 1:
        raise WaypointError(file, lines[0][0], "", "has no waypoints", "must have at least one line below the header")
    return columns, [_row(file, number, line, columns) for number, line in lines[1:]]


def _columns(file: str, number: int, line: str, layout: Layout) -> List[str]:
    columns = [column.strip() for column in line.lstrip("\ufeff").split(",")]
    for column in columns:
        if column not in (*layout.columns, *YAW_COLUMNS):
            raise WaypointError(file, number, "", f"the header has the column {column[:40]!r}", layout.header)
    kinds = ["yaw" if column in YAW_COLUMNS else column for column in columns]
    for kind in layout.columns:
        if kinds.count(kind) > 1:
            raise WaypointError(file, number, "", f"the header has the column {kind} twice", layout.header)
        if kind not in kinds and kind not in layout.optional:
            raise WaypointError(file, number, "", f"the header lacks the column {kind}", layout.header)
    return columns


def _row(file: str, number: int, line: str, columns: List[str]) -> Row:
    cells = [cell.strip() for cell in line.split(",")]
    if len(cells) != len(columns):
        right = f"must have {len(columns)}: {','.join(columns)}"
        raise WaypointError(file, number, "", f"has {len(cells)} columns", right)
    return Row(number, {column: _number(file, number, column, cell) for column, cell in zip(columns, cells)})


def _number(file: str, number: int, column: str, cell: str) -> float:
    if _NUMBER.fullmatch(cell) is None or not math.isfinite(float(cell)):
        wrong = f"is {cell[:40]!r}" if cell else "has no value"
        raise WaypointError(file, number, column, wrong, "must be a finite number")
    return float(cell) + 0.0


def yaw_of(file: str, row: Row) -> float:
    """Return the yaw of a row, in radians counter-clockwise from east.

    Raises:
        WaypointError: it is more than a turn.
    """
    column = next(column for column in YAW_COLUMNS if column in row.values)
    value, turn = row.values[column], YAW_COLUMNS[column]
    if abs(value) > turn + 1e-9:
        right = "must be within a turn, 360 degrees"
        if column != "yaw_deg":
            right = f"must be within a turn, {turn:.4f} rad; are these degrees? Then call the column yaw_deg"
        raise WaypointError(file, row.line, column, f"is {value:g}", right)
    return math.radians(value) if column == "yaw_deg" else value
