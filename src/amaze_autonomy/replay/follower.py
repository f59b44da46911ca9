"""Follows the rows of the check of the states through a recording: when each begins and ceases to pass.

The check is made before takeoff; a replay looks at it all the time. Shaking and turning are asked of a vehicle that
stands still and say nothing of one that is carried or flies, so they are left to the check itself.
"""

from __future__ import annotations

from math import degrees
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

from amaze_autonomy.engine.checks import Check, Verdict

__all__ = ["Follower", "Note", "row_text"]

_FOLLOWED = ("IMU age", "gravity magnitude", "tilt", "estimate age", "estimate rate", "estimate tilt", "tilt agreement")
_ON_GROUND_ONLY = ("gravity magnitude",)
_STANDS = 3  # looks in a row, so that a row at its limit does not fill the timeline


class Note(NamedTuple):
    """One line: text, and level as in `timeline.Line`."""

    text: str
    level: int


class _Row:
    """One row over time."""

    def __init__(self) -> None:
        self.passed: Optional[bool] = None
        self.looks = 0
        self.worst: Optional[Check] = None


class Follower:
    """Remembers each row."""

    def __init__(self) -> None:
        self._rows: Dict[str, _Row] = {}
        self._seen: Tuple[str, ...] = ()

    @property
    def settled(self) -> bool:
        """True when every row passes, and nothing speaks against any of them: one that passes again changes nothing."""
        rows = self._rows
        return all(name in rows and rows[name].passed is True and not rows[name].looks for name in self._seen)

    def take(self, rows: Sequence[Check], *, in_flight: bool) -> List[Note]:
        """Take the rows as they are now; return what has changed and stood for some looks."""
        notes: List[Note] = []
        self._seen = tuple(row.name for row in rows if row.name in _FOLLOWED)
        for row in rows:
            if row.name in _FOLLOWED and not (in_flight and row.name in _ON_GROUND_ONLY):
                note = self._follow(self._rows.setdefault(row.name, _Row()), row)
                if note is not None:
                    notes.append(note)
        return notes

    def _follow(self, known: _Row, row: Check) -> Optional[Note]:
        if not row.passed and row.value is not None and (known.worst is None or _off(row) > _off(known.worst)):
            known.worst = row
        if row.passed is known.passed:
            known.looks = 0
            return None
        known.looks += 1
        if known.looks < _STANDS and known.passed is not None:
            return None
        known.passed, known.looks = row.passed, 0
        worst, known.worst = known.worst, None if row.passed else row
        if not row.passed:
            return Note(f"state check: {row_text(row)}", 1 if row.verdict is Verdict.UNKNOWN else 2)
        furthest = f", furthest off {_value(worst, worst.value)}" if worst is not None else ""
        return Note(f"state check: {row_text(row)}, passes{furthest}", 0)


def _off(row: Check) -> float:
    return abs((row.value or 0.0) - (row.limit or 0.0))


def row_text(row: Check) -> str:
    """Return a row of a check as one line; angles in degrees."""
    limit = "" if row.limit is None else f", limit {_value(row, row.limit)}"
    advice = f" ({row.advice})" if row.advice and not row.passed else ""
    return f"{row.name} {_value(row, row.value)}{limit}{advice}"


def _value(row: Check, value: Optional[float]) -> str:
    if value is None:
        return "unknown"
    if row.unit == "rad":
        return f"{degrees(value):.1f} deg"
    return f"{value:.3g} {row.unit}".rstrip()
