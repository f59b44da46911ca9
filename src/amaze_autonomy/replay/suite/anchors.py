"""When the named instants of a scenario happened in a run."""

from __future__ import annotations

from typing import Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

from ..expect.pattern import instants
from ..expect.trace import Trace
from ..scenario.model import Anchor

__all__ = ["anchor_times"]


def anchor_times(anchors: Iterable[Anchor], trace: Trace) -> Dict[str, Optional[int]]:
    """Return the time of each anchor; None: it did not happen."""
    return {anchor.name: _time(anchor, trace) for anchor in anchors}


def _time(anchor: Anchor, trace: Trace) -> Optional[int]:
    times = _times(anchor, trace)
    if len(times) < anchor.occurrence:
        return None
    return times[anchor.occurrence - 1] + anchor.delay_ns


def _times(anchor: Anchor, trace: Trace) -> Sequence[int]:
    if anchor.at_ns is not None:
        return (trace.start_ns + anchor.at_ns,)
    if anchor.fault:
        began = trace.faults[anchor.fault - 1] if anchor.fault <= len(trace.faults) else None
        return () if began is None else (began,)
    if anchor.what is not None:
        return instants(anchor.what, trace)
    return _crossings(anchor, trace.readings.get(anchor.value, ()))


def _crossings(anchor: Anchor, values: Tuple[Tuple[int, float], ...]) -> List[int]:
    """Return when a value went over the level; where it began beyond it, it has not crossed it."""
    beyond: Iterator[Tuple[int, bool]] = (
        (t_ns, value > anchor.above if anchor.above is not None else value < (anchor.below or 0.0))
        for t_ns, value in values
    )
    found: List[int] = []
    before = True
    for t_ns, now in beyond:
        if now and not before:
            found.append(t_ns)
        before = now
    return found
