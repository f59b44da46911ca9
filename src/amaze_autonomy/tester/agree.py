"""Do two runs agree decision by decision? One is live, one is the replay: the same decisions, at nearly the same times.

Times of a live run shake by the way of each message; so do the values in which a time, an age or a rate stands. What is
decided must not: states, step, rule, what it is about, commands, in order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import Event, Shutdown

from ..journal.journal import Journal
from .golden.align import Change, ChangeKind, align, without_numbers

__all__ = ["Agreement", "agree", "agreement_lines"]

_APART = (ChangeKind.ADDED, ChangeKind.REMOVED, ChangeKind.REORDERED)


@dataclass(frozen=True)
class Agreement:
    """What came of it.

    Args:
        changes: of every decision.
        start_ns: zero of the times: the first event of the first run.
        tolerance_s: how far apart the times of a decision may be.
    """

    changes: Tuple[Change, ...]
    start_ns: int
    tolerance_s: float

    @property
    def furthest_s(self) -> float:
        """The largest difference in time; 0 when no decision is in both."""
        return max((abs(change.later_s) for change in self.changes), default=0.0)

    @property
    def wrong(self) -> Tuple[Change, ...]:
        """What is not the same, or too far apart; a comparison of nothing is wrong, too."""
        return tuple(change for change in self.changes if _differs(change) or abs(change.later_s) > self.tolerance_s)

    @property
    def agreed(self) -> bool:
        """Tell whether the two runs decide the same, and decide something."""
        return bool(self.changes) and not self.wrong


def agree(one: Journal, other: Journal, tolerance_s: float) -> Agreement:
    """Compare the decisions of two runs, up to the end of the shorter one.

    Args:
        one: journal of a run.
        other: journal of another one, on the same clock.
        tolerance_s: how far apart the times of a decision may be.
    """
    start_ns, end_ns = _span(one)
    end_ns = min(end_ns, _span(other)[1])
    changes = align(_decisions(one, end_ns), _decisions(other, end_ns))
    return Agreement(changes, start_ns, tolerance_s)


def _span(journal: Journal) -> Tuple[int, int]:
    """Return the times of the first and the last event before the process was told to end."""
    times: List[int] = []
    for line in journal.lines:
        if isinstance(line.payload, Shutdown):
            break
        if isinstance(line.payload, Event):
            times.append(line.payload.t_ns)
    return (times[0], times[-1]) if times else (0, 0)


def _decisions(journal: Journal, end_ns: int) -> Tuple[Decision, ...]:
    found = (line.payload for line in journal.lines)
    return tuple(each for each in found if isinstance(each, Decision) and each.t_ns <= end_ns and _kept(each))


def _kept(decision: Decision) -> bool:
    return decision.event != "Shutdown"


def _differs(change: Change) -> bool:
    if change.kind in _APART or change.before is None or change.after is None:
        return True
    return without_numbers(change.before.commands) != without_numbers(change.after.commands)


def agreement_lines(result: Agreement) -> List[str]:
    """Return every decision with its two times, and the verdict."""
    lines = [_line(change, result) for change in result.changes]
    many, wrong = len(result.changes), len(result.wrong)
    said = "agree" if result.agreed else "DIFFER" if many else "NO DECISION TO COMPARE"
    verdict = f"{said}: {many - wrong} of {many} decisions are the same within {result.tolerance_s:g} s"
    return [*lines, f"{verdict}; the furthest apart by {result.furthest_s:.3f} s"]


def _line(change: Change, result: Agreement) -> str:
    decision = change.before or change.decision
    step = f"/{decision.step}" if decision.step else ""
    commands: Sequence[str] = without_numbers(decision.commands)
    what = f"{decision.before} -> {decision.after}{step} by {decision.rule}" + "".join(f" => {c}" for c in commands)
    at_s = (decision.t_ns - result.start_ns) / 1e9
    if change.before is None or change.after is None or change.kind in _APART:
        return f"  {at_s:+9.3f} s  {change.kind.value:<10} {what}"
    far = "  TOO FAR" if abs(change.later_s) > result.tolerance_s else ""
    other = "  OTHER COMMANDS" if _differs(change) else ""
    return f"  {at_s:+9.3f} s  {change.later_s:+.3f} s  {what}{far}{other}"
