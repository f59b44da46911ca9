"""The states of two runs under each other, as text: where they part can be seen."""

from __future__ import annotations

from typing import List, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.state import State

__all__ = ["LETTERS", "waveform"]

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
    end_ns = max(*ends, start_ns + 1)
    one, other = _drawn(before, start_ns, end_ns), _drawn(after, start_ns, end_ns)
    marks = "".join("^" if left != right else " " for left, right in zip(one, other)).rstrip()
    legend = ", ".join(f"{letter} {state.value}" for state, letter in LETTERS.items() if letter in one + other)
    length = f"{(end_ns - start_ns) / 1e9:.3f} s"
    lines = [f"states   0 s{length:>{_WIDTH - 3}}", f"{name:<8} {one}", f"new      {other}"]
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
