"""A difference from a golden, as lines: the first different decision on top, with what it looked at in both runs."""

from __future__ import annotations

from typing import Dict, List, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.state import State

from ...replay.timeline import value_text
from .align import Change, ChangeKind, without_numbers

__all__ = ["LETTERS", "counted", "first_difference", "is_same", "told", "waveform"]


_QUIET = (ChangeKind.SAME, ChangeKind.ALIKE)


def is_same(changes: Sequence[Change]) -> bool:
    """Return True when nothing is different that a golden says."""
    return all(change.kind in _QUIET for change in changes)


def first_difference(changes: Sequence[Change]) -> Optional[Change]:
    """Return the first decision that is not the same; mere numbers come last; None: there is none."""
    loud = next((change for change in changes if change.kind not in _QUIET), None)
    return loud or next((change for change in changes if change.kind is not ChangeKind.SAME), None)


def counted(changes: Sequence[Change]) -> str:
    """Return how many decisions became what, e.g. "12 same, 1 added"."""
    counts: Dict[ChangeKind, int] = dict.fromkeys(ChangeKind, 0)
    for change in changes:
        counts[change.kind] += 1
    return ", ".join(f"{count} {kind.value}" for kind, count in counts.items() if count) or "no decisions"


def told(changes: Sequence[Change], start_ns: int, command: str = "", name: str = "golden") -> Tuple[str, ...]:
    """Return a difference for a person; empty when there is none.

    Args:
        changes: of `align`.
        start_ns: zero of the times.
        command: that shows it again; empty: none.
        name: of the run that is compared with.
    """
    first = first_difference(changes)
    if first is None:
        return ()
    before = [change.before for change in changes if change.before is not None]
    after = [change.after for change in changes if change.after is not None]
    lines = [_headline(first, start_ns), *_side(name, first.before, start_ns), *_side("new", first.after, start_ns)]
    lines += [f"decisions: {counted(changes)}", *waveform(before, after, start_ns, name)]
    rest = [change for change in changes if change.kind not in _QUIET and change is not first]
    lines += [f"also {_headline(change, start_ns)}" for change in rest[:5]]
    if len(rest) > 5:  # noqa: PLR2004
        lines.append(f"and {len(rest) - 5} more")
    return (*lines, *([f"reproduce: {command}"] if command else []))


def _headline(change: Change, start_ns: int) -> str:
    decision = change.decision
    at_s = (decision.t_ns - start_ns) / 1e9
    return f"decision at {at_s:+.3f} s {_what(change)}: {_short(decision)}"


def _what(change: Change) -> str:
    if change.kind in (ChangeKind.MOVED, ChangeKind.CHANGED, ChangeKind.REORDERED) and change.later_s:
        way = "later" if change.later_s > 0 else "earlier"
        return f"{change.kind.value}, {abs(change.later_s):.3f} s {way}"
    return change.kind.value


def _short(decision: Decision) -> str:
    step = f"/{decision.step}" if decision.step else ""
    move = decision.before if decision.before == decision.after else f"{decision.before} -> {decision.after}"
    commands = ", ".join(without_numbers(decision.commands))
    return f"{move}{step} by {decision.rule}" + (f" => {commands}" if commands else "")


def _side(name: str, decision: Optional[Decision], start_ns: int) -> List[str]:
    if decision is None:
        return [f"  {name:<8} nothing"]
    lines = [f"  {name:<8} {(decision.t_ns - start_ns) / 1e9:+.3f} s  {_short(decision)}"]
    return lines + [f"           {value_text(value, start_ns)}" for value in decision.values]


# --- waveform ---------------------------------------------------------------------------------------------------------
# The states of two runs under each other, as text: where they part can be seen.


LETTERS = {
    State.MISSION_INPUT: "i",
    State.PREFLIGHT: "p",
    State.OUTREACH: "o",
    State.READY: "r",
    State.START_RECORDING: "s",
    State.LOAD_MISSION: "l",
    State.TAKEOFF: "T",
    State.MISSION: "M",
    State.HOLD: "H",
    State.LAND: "L",
    State.PILOT: "X",
    State.DATA_CLEANUP: "d",
    State.MISSION_ENDED: "e",
}
_WIDTH = 72


def waveform(
    before: Sequence[Decision], after: Sequence[Decision], start_ns: int, name: str = "golden"
) -> Tuple[str, ...]:
    """Return the lines: time from begin to end, the states before and now, what differs, the legend."""
    ends = [decisions[-1].t_ns for decisions in (before, after) if decisions]
    if not ends:
        return ()
    # What the script plays before a recording has times before 0; the picture begins with it.
    begin_ns = min(start_ns, *(decisions[0].t_ns for decisions in (before, after) if decisions))
    end_ns = max(*ends, begin_ns + 1)
    one, other = _drawn(before, begin_ns, end_ns), _drawn(after, begin_ns, end_ns)
    marks = "".join("^" if left != right else " " for left, right in zip(one, other)).rstrip()
    legend = ", ".join(f"{letter} {state.value}" for state, letter in LETTERS.items() if letter in one + other)
    begin, length = f"{(begin_ns - start_ns) / 1e9:g} s", f"{(end_ns - start_ns) / 1e9:.3f} s"
    lines = [f"states   {begin}{length:>{_WIDTH - len(begin)}}", f"{name:<8} {one}", f"new      {other}"]
    return (*lines, *([f"         {marks}"] if marks else []), f"         {legend}")


def _drawn(decisions: Sequence[Decision], start_ns: int, end_ns: int) -> str:
    """Return one letter for each slice of time; a state that is shorter than a slice is shown all the same."""
    cells: List[str] = [LETTERS[State.MISSION_INPUT]] * _WIDTH
    shown = [False] * _WIDTH
    for decision in decisions:
        if decision.before == decision.after:
            continue
        cell = min(_WIDTH - 1, (decision.t_ns - start_ns) * _WIDTH // (end_ns - start_ns))
        while cell < _WIDTH - 1 and shown[cell]:
            cell += 1
        shown[cell] = True
        cells[cell:] = [LETTERS[State(decision.after)]] * (_WIDTH - cell)
    return "".join(cells)
