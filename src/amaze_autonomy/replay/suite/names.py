"""Are there the components and losses that expectations and anchors name? What nobody watches never fails."""

from __future__ import annotations

from typing import Callable, Iterable, Iterator, Set, Tuple

from amaze_autonomy.engine.failures import USER_HOLD
from amaze_autonomy.engine.rules import LOSSES

from ..errors import ReplayError
from ..expect.pattern import Pattern, about
from ..expect.trace import Trace
from ..scenario import Case
from ..scenario.places import meant, place_of

__all__ = ["check_names"]

_LOSSES = (*(loss.name for loss in LOSSES), USER_HOLD)


def check_names(case: Case, trace: Trace, configured: Callable[[], Iterable[str]]) -> None:
    """Refuse a name that neither the configuration nor the run has.

    Args:
        case: that was run.
        trace: of the run.
        configured: gives the names of the configuration's components; asked only when the run does not have a name.

    Raises:
        ReplayError: there is no such component or loss; with the line, and what was meant.
    """
    seen: Set[str] = {*trace.codes, *(name for name in map(about, trace.decisions) if name)}
    for where, pattern in _patterns(case):
        name = pattern.component or pattern.failure
        if not name or name in seen or (pattern.failure and name in _LOSSES):
            continue
        known = [*configured(), *sorted(seen)]
        if name not in known:
            kind = "component" if pattern.component else "component and no loss"
            right = meant(name, [*known, *(_LOSSES if pattern.failure else ())])
            raise ReplayError(f"{where}: there is no {kind} {name}; {right}")


def _patterns(case: Case) -> Iterator[Tuple[str, Pattern]]:
    for expectation in case.expectations:
        for _, pattern in expectation.patterns:
            yield expectation.where, pattern
    for anchor in case.anchors:
        if anchor.what is not None:
            yield f"{place_of(case.path, ('anchors', anchor.name))}", anchor.what
