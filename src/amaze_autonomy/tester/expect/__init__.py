"""Expectations: what must come of a run, in a small closed set, each with its margin."""

from __future__ import annotations

from ...journal.trace import Span, Trace, trace_of
from .judge import Window, judge
from .model import EXPECTATIONS, Expectation, ExpectationKind, Finding, Grade, Pattern

__all__ = [
    "EXPECTATIONS",
    "Expectation",
    "ExpectationKind",
    "Finding",
    "Grade",
    "Pattern",
    "Span",
    "Trace",
    "Window",
    "judge",
    "trace_of",
]
