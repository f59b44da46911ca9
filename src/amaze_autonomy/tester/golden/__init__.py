"""Goldens: the accepted decisions of each case, and how a run differs from them."""

from __future__ import annotations

from .align import Change, ChangeKind, align
from .difference import counted, first_difference, is_same, told
from .store import (
    Golden,
    check_reason,
    compare_with_golden,
    decisions_of,
    golden_path,
    orphans,
    read_golden,
    write_golden,
)

__all__ = [
    "Change",
    "ChangeKind",
    "Golden",
    "align",
    "check_reason",
    "compare_with_golden",
    "counted",
    "decisions_of",
    "first_difference",
    "golden_path",
    "is_same",
    "orphans",
    "read_golden",
    "told",
    "write_golden",
]
