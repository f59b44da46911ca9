"""Goldens: the accepted decisions of each case, and how a run differs from them."""

from __future__ import annotations

from .align import Change, ChangeKind, align
from .gate import compare_with_golden, decisions_of
from .reason import check_reason
from .store import Golden, golden_path, orphans, read_golden, write_golden
from .told import counted, first_difference, told

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
    "orphans",
    "read_golden",
    "told",
    "write_golden",
]
