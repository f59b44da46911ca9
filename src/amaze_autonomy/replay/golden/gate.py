"""Compares a run with its golden. A golden that is not there is a difference."""

from __future__ import annotations

from typing import Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.journal import decode

from ..scenario.model import Case
from .align import align
from .store import golden_path, read_golden
from .told import told

__all__ = ["compare_with_golden", "decisions_of"]


def compare_with_golden(case: Case, lines: Sequence[str], command: str, start_ns: int) -> Tuple[str, ...]:
    """Return how a run differs from its golden, the headline first; empty: it does not.

    Raises:
        GoldenError: the golden is damaged.
    """
    path = golden_path(case)
    golden = read_golden(path)
    if golden is None:
        return (
            f"there is no golden ({path.name}); look at the run, then: amaze-replay accept {case.path} --reason ...",
        )
    if golden.lines == tuple(lines):
        return ()
    return told(align(golden.decisions, decisions_of(lines)), start_ns, command)


def decisions_of(lines: Sequence[str]) -> Tuple[Decision, ...]:
    """Read lines of decisions."""
    payloads = (decode(line, number).payload for number, line in enumerate(lines, 1))
    return tuple(payload for payload in payloads if isinstance(payload, Decision))
