"""How two runs differ, decision by decision: aligned, as lines for a person, and one live with its replay.

Decisions are matched first by what they are (states, step, rule, what they are about), in order; only then are their
times and values compared. So one decision more does not make all the later ones different.

What is compared survives additions: that the pre-flight checks were asked counts, not which and how many there are (a
test of its own says that it is always all of them), nor the numbers of commands; how old the oldest answer is may
differ by as much as answers take.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.engine.commands import Decision, RunCheck, Value
from amaze_autonomy.engine.events import Event, Shutdown
from amaze_autonomy.engine.state import State
from amaze_autonomy.replay.timeline import value_text

from ..journal.journal import Journal

_CHECK = RunCheck.__name__
_CHECKS = f"{_CHECK}s"

Key = Tuple[str, str, str, str, str]

TOLERANCES: Mapping[str, float] = {"oldest check": 0.02}
"""By how much a value may differ, by its name and in its own unit: what hangs on how quickly others answered."""


class ChangeKind(enum.Enum):
    """What became of a decision; the worst first."""

    SAME = "same"
    ALIKE = "alike"  # only numbers of commands, which checks are asked, or a value within its tolerance
    MOVED = "moved in time"
    CHANGED = "changed value"
    REORDERED = "reordered"
    REMOVED = "removed"
    ADDED = "added"


@dataclass(frozen=True)
class Change:
    """One decision of either run, or one of both.

    Args:
        kind: what became of it.
        before: of the golden; None: it was not there.
        after: of the new run; None: it is not there any more.
    """

    kind: ChangeKind
    before: Optional[Decision]
    after: Optional[Decision]

    @property
    def decision(self) -> Decision:
        """The decision that it is about: the new one if there is one."""
        decision = self.after or self.before
        if decision is None:
            raise ValueError("a change is about a decision")
        return decision

    @property
    def later_s(self) -> float:
        """By how much it comes later than in the golden; 0 when it is in one run only."""
        if self.before is None or self.after is None:
            return 0.0
        return (self.after.t_ns - self.before.t_ns) / 1e9


def key_of(decision: Decision) -> Key:
    """Return what a decision is: states, step, rule, and what it is about."""
    about = next((str(value.value) for value in decision.values if value.name == "failure"), "")
    return decision.before, decision.after, decision.step, decision.rule, about


def asks(decision: Decision) -> Tuple[str, ...]:
    """Return what a decision asks for: "MissionCommand(LAND)" for "MissionCommand(LAND)#12", all checks as one."""
    named = [_CHECKS if name.startswith(f"{_CHECK}(") else name for name in without_numbers(decision.commands)]
    return tuple(name for place, name in enumerate(named) if name != _CHECKS or _CHECKS not in named[:place])


def without_numbers(commands: Sequence[str]) -> Tuple[str, ...]:
    """Return commands without their numbers: "MissionCommand(LAND)" for "MissionCommand(LAND)#12"."""
    return tuple(command.partition("#")[0] for command in commands)


def align(before: Sequence[Decision], after: Sequence[Decision]) -> Tuple[Change, ...]:
    """Return what became of every decision, in order; what was removed stands where it was."""
    ours, theirs = [key_of(each) for each in before], [key_of(each) for each in after]
    changes: List[Change] = []
    for tag, i, j, k, m in SequenceMatcher(None, ours, theirs, autojunk=False).get_opcodes():
        if tag == "equal":
            changes += [_paired(one, other) for one, other in zip(before[i:j], after[k:m])]
            continue
        changes += [Change(ChangeKind.REMOVED, each, None) for each in before[i:j]]
        changes += [Change(ChangeKind.ADDED, None, each) for each in after[k:m]]
    return tuple(_reordered(changes))


def _paired(before: Decision, after: Decision) -> Change:
    if not _alike(before, after):
        return Change(ChangeKind.CHANGED, before, after)
    if before.t_ns != after.t_ns:
        return Change(ChangeKind.MOVED, before, after)
    same = before == after
    return Change(ChangeKind.SAME if same else ChangeKind.ALIKE, before, after)


def _alike(before: Decision, after: Decision) -> bool:
    """Return True when two decisions of one kind were made of the same values and ask for the same."""
    if (before.event, asks(before), len(before.values)) != (after.event, asks(after), len(after.values)):
        return False
    return all(_near(one, other) for one, other in zip(before.values, after.values))


def _near(one: Value, other: Value) -> bool:
    """Return True when two values are the same, or so near to one another as their name allows."""
    tolerance = TOLERANCES.get(one.name)
    if tolerance is None or not isinstance(one.value, float) or not isinstance(other.value, float):
        return one == other
    return replace(other, value=one.value) == one and abs(one.value - other.value) <= tolerance


def _reordered(changes: List[Change]) -> List[Change]:
    """Join a decision that was removed here and added there: it has another place in the order."""
    gone: Dict[Key, List[int]] = {}
    for place, change in enumerate(changes):
        if change.kind is ChangeKind.REMOVED and change.before is not None:
            gone.setdefault(key_of(change.before), []).append(place)
    joined = list(changes)
    left_out: List[int] = []
    for place, change in enumerate(changes):
        if change.kind is not ChangeKind.ADDED or change.after is None:
            continue
        places = gone.get(key_of(change.after), [])
        if places:
            first = places.pop(0)
            joined[place] = Change(ChangeKind.REORDERED, changes[first].before, change.after)
            left_out.append(first)
    return [change for place, change in enumerate(joined) if place not in left_out]


# --- as lines ---------------------------------------------------------------------------------------------------------


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


# --- a live run and its replay ----------------------------------------------------------------------------------------
# Times of a live run shake by the way of each message; so do the values in which a time, an age or a rate stands. What
# is decided must not: states, step, rule, what it is about, commands, in order.


_APART = (ChangeKind.ADDED, ChangeKind.REMOVED, ChangeKind.REORDERED)


@dataclass(frozen=True)
class Agreement:
    """What came of it.

    Args:
        changes: of every decision.
        start_ns: zero of the times: the first event of the first run.
        tolerance_s: how far apart the times of a decision may be.
        not_compared: what is left out because a journal ends before it, a line for each journal.
        broken_off: a journal is cut off, or its engine died while the other one went on deciding.
    """

    changes: Tuple[Change, ...]
    start_ns: int
    tolerance_s: float
    not_compared: Tuple[str, ...] = ()
    broken_off: bool = False

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
        """Tell whether the two runs decide the same, and decide something, and neither broke off."""
        return bool(self.changes) and not self.wrong and not self.broken_off


def agree(one: Journal, other: Journal, tolerance_s: float) -> Agreement:
    """Compare the decisions of two runs, up to the end of the shorter one.

    A run ends by being told to, and a replay with its recording. One that ends otherwise broke off.

    Args:
        one: journal of a run.
        other: journal of another one, on the same clock.
        tolerance_s: how far apart the times of a decision may be.
    """
    start_ns, end_ns = _span(one)
    end_ns = min(end_ns, _span(other)[1])
    changes = align(_decisions(one, end_ns), _decisions(other, end_ns))
    lines: List[str] = []
    broken_off = False
    for name, shorter, longer in (("first", one, other), ("second", other, one)):
        own_end_ns = _span(shorter)[1]
        later = sum(_kept(each) and each.t_ns > own_end_ns + tolerance_s * 1e9 for each in _made(longer))
        cut = "is cut off" if shorter.truncated else "ends"
        if later or shorter.truncated:
            at_s = (own_end_ns - start_ns) / 1e9
            lines.append(f"the {name} {cut} at {at_s:+.3f} s: {later} decisions of the other were not compared")
        broken_off |= shorter.truncated or bool(later and not _ends_as_it_should(shorter))
    return Agreement(changes, start_ns, tolerance_s, tuple(lines), broken_off)


def _ends_as_it_should(journal: Journal) -> bool:
    """Tell whether a run was told to end, or is a replay, which ends with its recording."""
    header = journal.lines[0].payload
    replayed = isinstance(header, dict) and header.get("program") == "amaze-replay"
    return replayed or any(isinstance(line.payload, Shutdown) for line in journal.lines)


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
    return tuple(each for each in _made(journal) if each.t_ns <= end_ns and _kept(each))


def _made(journal: Journal) -> Tuple[Decision, ...]:
    return tuple(line.payload for line in journal.lines if isinstance(line.payload, Decision))


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
    said = "agree" if result.agreed else "DIFFER" if wrong else "BROKEN OFF" if many else "NO DECISION TO COMPARE"
    verdict = f"{said}: {many - wrong} of {many} decisions are the same within {result.tolerance_s:g} s"
    return [*lines, *result.not_compared, f"{verdict}; the furthest apart by {result.furthest_s:.3f} s"]


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
