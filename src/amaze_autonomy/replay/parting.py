"""Where a replay parts from the flight it replays: the first decision that is not that of the flight.

Compared are states, steps and rules in their order, not times and values. From there on the recorded vehicle did what
the flight's engine said, not what this one says.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from typing import Optional, Tuple

from amaze_autonomy.engine.commands import Decision

__all__ = ["Parting", "part"]


@dataclass(frozen=True)
class Parting:
    """The first decision that is not that of the flight.

    Args:
        number: of it, from 0.
        flown: the flight's; None: it made none any more.
        decided: the replay's; None: it made none any more.
        t_ns: the earlier time of the two.
    """

    number: int
    flown: Optional[Decision]
    decided: Optional[Decision]
    t_ns: int


def part(flown: Tuple[Decision, ...], decided: Tuple[Decision, ...], until_ns: int) -> Optional[Parting]:
    """Return where two flights part; None: they do not.

    Args:
        flown: decisions of the flight, in the bag's time.
        decided: those of the replay.
        until_ns: from then on a decision may be missing on either side: the recording's topics do not end at one
            moment, and what the flight decided after its journal ends is not known.
    """
    for number, (one, other) in enumerate(zip_longest(flown, decided)):
        t_ns: int = min(each.t_ns for each in (one, other) if each is not None)
        if one is None or other is None:
            return None if t_ns >= until_ns else Parting(number, one, other, t_ns)
        if _step(one) != _step(other):
            return Parting(number, one, other, t_ns)
    return None


def _step(decision: Decision) -> Tuple[str, str, str, str]:
    return decision.before, decision.after, decision.step, decision.rule
