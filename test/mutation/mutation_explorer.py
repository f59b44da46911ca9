"""The proof as a net for mutants: fast worlds first, up to ever higher bounds, until one shows it."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Callable, Optional, Sequence

from proof_explorer import explore
from proof_figures import Figures, differences, otherwise, read, shipped_limits
from proof_liveness import loops
from proof_run import BOUND, Proof
from proof_worlds import WORLDS


def broken(names: Sequence[str], bounds: Sequence[int]) -> str:
    """Return the limit, law, place or figure in which the engine is not what was accepted; empty: it is in all."""
    accepted = read()
    shipped = () if accepted is None else differences(accepted, replace(accepted, limits=shipped_limits()), "limits")
    return shipped[0] if shipped else _explored(accepted, names, bounds)


def _explored(accepted: Optional[Figures], names: Sequence[str], bounds: Sequence[int]) -> str:
    for bound in (*bounds, BOUND):
        proof = Proof()
        for name in names:
            found = explore(WORLDS[name], bound, compare=bound == BOUND)
            proof.stats[name] = found.stats
            law: Optional[str] = None
            if found.broken is not None:
                law = found.broken.law
            elif loops(found):
                law = "no_loop_without_progress"
            if law is not None:
                return f"{law} ({name})"
            if accepted is not None and bound == BOUND:
                other = otherwise(accepted, name, found.stats)
                if other:
                    return f"{other.partition(',')[0]} ({name})"
    if set(names) == set(WORLDS) and proof.missing:
        return f"not reached: {', '.join(proof.missing)}"[:200]
    return ""


def each_world(context: Callable[[str], AbstractContextManager[None]], bound: int) -> None:
    """Explore each world within a context of its own."""
    for name in WORLDS:
        with context(name):
            found = explore(WORLDS[name], bound, compare=False)
        if found.broken is not None:
            raise ValueError(f"{name}: {found.broken.law} is broken without a mutant")
