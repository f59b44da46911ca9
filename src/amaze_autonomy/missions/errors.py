"""What can be wrong with a waypoint file.

WaypointError    one mistake in one file: line, column, what is wrong, what would be right; also a ValueError
"""

from __future__ import annotations


class WaypointError(ValueError):
    """One mistake in a waypoint file.

    Args:
        file: its name.
        line: from 1; 0 when the file as a whole is meant.
        column: name of the column; empty when the line as a whole is meant.
        wrong: what is wrong.
        right: what would be right.
    """

    def __init__(self, file: str, line: int, column: str, wrong: str, right: str) -> None:
        place = f"{file}:{line}" if line else file
        super().__init__(": ".join(part for part in (place, column, f"{wrong}; {right}") if part))
        self.file, self.line, self.column, self.wrong, self.right = file, line, column, wrong, right
