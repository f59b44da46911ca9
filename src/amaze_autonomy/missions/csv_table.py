"""Rows of finite numbers below a header, separated by commas: every mistake with its line and column.

What the columns alone do not say stands in lines above them, or in the mission that names the file; what neither says
is asked for, never guessed:

    # frame: start_heading
    # yaw_unit: deg
"""

from __future__ import annotations

import enum
import math
import re
from dataclasses import dataclass
from typing import Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Type, TypeVar

from .errors import WaypointError

E = TypeVar("E", bound=enum.Enum)


class Frame(enum.Enum):
    """What the metres of a file are measured along."""

    EAST_NORTH = "east_north"  # x east, y north of the mission's first takeoff, yaw from east
    START_HEADING = "start_heading"  # x ahead, y left of where the vehicle takes off with this file, yaw from ahead


class YawUnit(enum.Enum):
    """The unit of a yaw."""

    RAD = "rad"
    DEG = "deg"


class Said(NamedTuple):
    """What is said of a file, in it or in its mission; None: nothing."""

    frame: Optional[Frame] = None
    yaw_unit: Optional[YawUnit] = None


_NUMBER = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_SAID = re.compile(r"#+\s*(frame|yaw_unit)\s*:\s*(.*)", re.IGNORECASE)
YAW_COLUMNS: Mapping[str, Optional[YawUnit]] = {"yaw": None, "yaw_rad": YawUnit.RAD, "yaw_deg": YawUnit.DEG}
"""Columns for the yaw, and the unit that each says; None: it says none."""
_TURNS: Mapping[YawUnit, float] = {YawUnit.RAD: 2 * math.pi, YawUnit.DEG: 360.0}

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


# --- frame and unit ---------------------------------------------------------------------------------------------------


def said_in(file: str, text: str) -> Said:
    """Return what the comments of a file say of it.

    Raises:
        WaypointError: one of them says what cannot be, or says it twice.
    """
    found: Dict[str, Tuple[int, str]] = {}
    for number, line in enumerate(text.lstrip("\ufeff").replace("\r\n", "\n").split("\n"), start=1):
        match = _SAID.fullmatch(line.strip())
        if match is None:
            continue
        key = match[1].lower()
        if key in found:
            raise WaypointError(file, number, key, "is said twice", f"must stand in one line; see line {found[key][0]}")
        found[key] = (number, match[2].strip())
    return Said(_member(file, "frame", Frame, found), _member(file, "yaw_unit", YawUnit, found))


def _member(file: str, key: str, kind: Type[E], found: Mapping[str, Tuple[int, str]]) -> Optional[E]:
    if key not in found:
        return None
    number, value = found[key]
    words = [each.value for each in kind]
    if value not in words:
        raise WaypointError(file, number, key, f"is {value[:40]!r}", f"must be {' or '.join(words)}")
    return kind(value)


def frame_of(file: str, header: int, said: Said, mission: Said) -> Frame:
    """Return the frame of a file in metres; `header` is the line of its columns.

    Raises:
        WaypointError: neither the file nor its mission says it, or they do not agree.
    """
    frame = _agreed(file, header, "frame", said.frame, mission.frame)
    if frame is None:
        right = (
            "write the line `# frame: east_north` above the columns where x and y are metres east and north of the "
            "takeoff, or `# frame: start_heading` where they are metres ahead and left of the heading at the takeoff "
            "(the files of the CNS Flight Stack are); or give its mission the key frame"
        )
        raise WaypointError(file, header, "", "the header does not say in which frame x and y are", right)
    return frame


def yaw_unit_of(file: str, header: int, column: str, said: Said, mission: Said) -> YawUnit:
    """Return the unit of the yaw in a column; `header` is the line of the columns.

    Raises:
        WaypointError: neither column, file nor mission says it, or they do not agree.
    """
    unit = _agreed(file, header, "yaw_unit", said.yaw_unit, mission.yaw_unit)
    unit = _agreed(file, header, "yaw_unit", YAW_COLUMNS[column], unit)
    if unit is None:
        right = (
            "call the column yaw_deg or yaw_rad, or write the line `# yaw_unit: deg` or `# yaw_unit: rad` above the "
            "columns, or give its mission the key yaw_unit"
        )
        raise WaypointError(file, header, column, "the header does not say its unit", right)
    return unit


def _agreed(file: str, header: int, key: str, one: Optional[E], other: Optional[E]) -> Optional[E]:
    if one is not None and other is not None and one is not other:
        wrong = f"the file says {one.value}, and beside it {other.value} is said"
        raise WaypointError(file, header, key, wrong, "must be said once, or be the same in file, column and mission")
    return other if one is None else one


def yaw_of(file: str, row: Row, unit: YawUnit) -> float:
    """Return the yaw of a row, in radians counter-clockwise from the x axis.

    Raises:
        WaypointError: it is more than a turn.
    """
    column = next(column for column in YAW_COLUMNS if column in row.values)
    value, turn = row.values[column], _TURNS[unit]
    if abs(value) > turn + 1e-9:
        right = "must be within a turn, 360 degrees"
        if unit is YawUnit.RAD:
            right = f"must be within a turn, {turn:.4f} rad; are these degrees? Then say so: yaw_deg"
        raise WaypointError(file, row.line, column, f"is {value:g}", right)
    return math.radians(value) if unit is YawUnit.DEG else value
