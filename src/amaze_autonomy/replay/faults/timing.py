"""Faults of when messages come: they are lost, late, doubled, in another order; or the recorder's clock is set."""

from __future__ import annotations

from dataclasses import dataclass, replace
from random import Random
from typing import Any, Callable, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.simulation import Fault
from amaze_autonomy.simulation.faults import flapping_ns

from ..sources import Sample

__all__ = ["TIMING", "WHOLE", "Item"]

_S = 1_000_000_000
Period = Tuple[int, int]


@dataclass(frozen=True)
class Item:
    """One message of the stream: when it comes now, which one it is, and what is done to its content."""

    t_ns: int
    sample: Sample
    edits: Tuple[Callable[[Any], Any], ...]


Changed = Tuple[List[Item], int]
"""The messages that are left, and how many were touched."""
_Timing = Callable[[Sequence[Item], Fault, Period, Random], Changed]
_Whole = Callable[[Sequence[Item], Fault, int, Optional[int]], Changed]


def _silent(items: Sequence[Item], _: Fault, __: Period, ___: Random) -> Changed:
    return [], len(items)


def _slow(items: Sequence[Item], fault: Fault, _: Period, __: Random) -> Changed:
    """Keep a part of each topic's messages, evenly."""
    part, counts = fault.number("rate_fraction"), [0] * (1 + max((item.sample.rank for item in items), default=0))
    kept: List[Item] = []
    for item in items:
        number = counts[item.sample.rank]
        counts[item.sample.rank] += 1
        if int((number + 1) * part) > int(number * part):
            kept.append(item)
    return kept, len(items) - len(kept)


def _flapping(items: Sequence[Item], fault: Fault, period: Period, _: Random) -> Changed:
    off_ns, on_ns = flapping_ns(fault)
    kept = [item for item in items if (item.t_ns - period[0]) % (off_ns + on_ns) >= off_ns]
    return kept, len(items) - len(kept)


def _dropped(items: Sequence[Item], fault: Fault, _: Period, chance: Random) -> Changed:
    lost = fault.number("fraction")
    kept = [item for item in items if chance.random() >= lost]
    return kept, len(items) - len(kept)


def _delayed(items: Sequence[Item], fault: Fault, _: Period, chance: Random) -> Changed:
    delay_ns, jitter_ns = round(fault.number("delay_s") * _S), round(fault.number("jitter_s") * _S)
    keeps_order = fault.word("order") == "kept"
    late: List[Item] = []
    last_ns: List[int] = [0] * (1 + max((item.sample.rank for item in items), default=0))
    for item in items:
        t_ns = item.t_ns + delay_ns + (round(chance.random() * jitter_ns) if jitter_ns else 0)
        if keeps_order:
            t_ns = last_ns[item.sample.rank] = max(t_ns, last_ns[item.sample.rank])
        late.append(replace(item, t_ns=t_ns))
    return late, sum(one.t_ns != other.t_ns for one, other in zip(items, late))


def _bursting(items: Sequence[Item], _: Fault, period: Period, __: Random) -> Changed:
    return [replace(item, t_ns=period[1]) for item in items], len(items)


def _duplicated(items: Sequence[Item], fault: Fault, _: Period, __: Random) -> Changed:
    copies = 1 + round(fault.number("copies"))
    return [item for item in items for _ in range(copies)], len(items)


def _reordered(items: Sequence[Item], fault: Fault, _: Period, chance: Random) -> Changed:
    """Let messages of one topic change places: the times stay, their contents move."""
    within = fault.number("within_s") * _S
    out: List[Item] = []
    for rank in sorted({item.sample.rank for item in items}):
        own = [item for item in items if item.sample.rank == rank]
        moved = sorted(own, key=lambda item: item.t_ns + chance.uniform(0.0, within))
        out += [replace(item, t_ns=place.t_ns) for item, place in zip(moved, own)]
    return out, sum(one.t_ns != other.t_ns for one, other in zip(_by_place(out), _by_place(items)))


def _by_place(items: Sequence[Item]) -> List[Item]:
    return sorted(items, key=lambda item: item.sample)


def _clock_jumps(items: Sequence[Item], fault: Fault, begin_ns: int, end_ns: Optional[int]) -> Changed:
    by_ns = round(fault.number("by_s") * _S)
    moved = [
        replace(item, t_ns=max(0, item.t_ns + by_ns))
        if begin_ns <= item.t_ns and (end_ns is None or item.t_ns < end_ns)
        else item
        for item in items
    ]
    return moved, sum(one is not other for one, other in zip(items, moved))


def _clock_warps(items: Sequence[Item], fault: Fault, begin_ns: int, end_ns: Optional[int]) -> Changed:
    factor = fault.number("factor")

    def warped(t_ns: int) -> int:
        if t_ns < begin_ns:
            return t_ns
        inside = t_ns if end_ns is None else min(t_ns, end_ns)
        return begin_ns + round((inside - begin_ns) * factor) + (t_ns - inside)

    moved = [replace(item, t_ns=warped(item.t_ns)) for item in items]
    return moved, sum(one.t_ns != other.t_ns for one, other in zip(items, moved))


TIMING: Mapping[str, _Timing] = {
    "silent": _silent,
    "slow": _slow,
    "flapping": _flapping,
    "dropped": _dropped,
    "delayed": _delayed,
    "bursting": _bursting,
    "duplicated": _duplicated,
    "reordered": _reordered,
}
"""By the name of the fault: messages that are hit to messages that come."""

WHOLE: Mapping[str, _Whole] = {"clock_jumps": _clock_jumps, "clock_warps": _clock_warps}
"""Faults of the whole recording."""
