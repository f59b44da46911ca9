"""Scenario files of the tester: what is put in, what goes wrong, what must come of it."""

from __future__ import annotations

from .files import SUFFIX, find_files, load_cases, parse_cases
from .model import Anchor, Bag, Case, Need, SourceKind

__all__ = ["SUFFIX", "Anchor", "Bag", "Case", "Need", "SourceKind", "find_files", "load_cases", "parse_cases"]
