"""Aligns two runs decision by decision, and says what became of each: one comparer for the gate and for reports.

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

__all__ = ["TOLERANCES", "Change", "ChangeKind", "align", "asks", "key_of", "without_numbers"]

_CHECK = RunCheck.__name__

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
    named = without_numbers(decision.commands)
    return tuple(dict.fromkeys(f"{_CHECK}s" if name.startswith(f"{_CHECK}(") else name for name in named))


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
