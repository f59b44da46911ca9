"""A mutant, where it is and what it changes, and who is asked whether it is noticed."""

from __future__ import annotations

import hashlib
from typing import NamedTuple

EXPLORER, UNIT, SCENARIOS = "explorer", "unit", "scenarios"
NETS = (EXPLORER, UNIT, SCENARIOS)
MUTATED = ("src/amaze_autonomy/engine", "src/amaze_autonomy/journal", "src/amaze_autonomy/monitoring")
"""The folders, from the root of the repository."""
SAME_BY_NATURE = (
    "core/ReplaceComparisonOperator_Is_Eq",
    "core/ReplaceComparisonOperator_IsNot_NotEq",
    "core/ReplaceComparisonOperator_Eq_Is",
    "core/ReplaceComparisonOperator_NotEq_IsNot",
)
"""Operators left out: of enumerations, None, booleans and small numbers, what is equal is the same object."""


class Place(NamedTuple):
    """What one operator can change.

    Args:
        path: of the file, from the root of the repository.
        line: from 1.
        column: from 0.
        operator: cosmic-ray's name.
        occurrence: which of the operator's places in the file.
    """

    path: str
    line: int
    column: int
    operator: str
    occurrence: int


class Mutant(NamedTuple):
    """One change: the lines of a place without indentation, and what they become."""

    place: Place
    before: str
    after: str

    @property
    def key(self) -> str:
        """Return a name that outlives changes elsewhere in the file, and which a waiver gives."""
        told = f"{self.place.path}\n{self.before}\n{self.after}"
        return hashlib.sha256(told.encode()).hexdigest()[:10]
