"""`./run proof [large] [WORLD...]`: prove, print what was explored and what the bounds cut off, write docs/safety.md.

Without arguments: the bounded proof and its self-test, as in CI, and the page with their numbers. `large`: every world
to a bound that is some 60 times higher; names of worlds: only those. A broken law is printed with the
shortest way to it, and written as a scenario file with its journal into test/proof/found/.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import List, Optional

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "engine")]

from proof_defects import Caught  # noqa: E402
from proof_explorer import Broken, Exploration, explore  # noqa: E402
from proof_journal import write  # noqa: E402
from proof_liveness import loops  # noqa: E402
from proof_pages import page  # noqa: E402
from proof_run import BOUND, LARGE, Proof, expected_coverage, prove, self_test  # noqa: E402
from proof_worlds import WORLDS  # noqa: E402

PAGE = HERE.parents[1] / "docs" / "safety.md"
FOUND = HERE / "found"


def main(arguments: List[str]) -> int:
    """Run it; return 1 when a law is broken, something was not reached, or a defect was missed."""
    large, names = "large" in arguments, [word for word in arguments if word != "large"]
    unknown = [name for name in names if name not in WORLDS]
    if unknown:
        print(f"no world {unknown[0]!r}; there is: {', '.join(WORLDS)}", file=sys.stderr)
        return 2
    began = time.perf_counter()
    print(f"{'world':24} {'states':>9} {'transitions':>11} {'events':>10} depth   cut off", flush=True)
    if names:
        return max([_only(name, LARGE if large else BOUND) for name in names])
    proof = prove(LARGE if large else BOUND, _tell)
    status = _conclude(proof)
    if not large:
        print("\ndefects, and the law that caught each:")
        caught = self_test(_tell_defect)
        status = status or int(None in caught.values())
        if status == 0:
            PAGE.write_text(page(proof, caught), encoding="utf-8")
    print(f"\n{time.perf_counter() - began:.0f} s")
    return status


def _only(name: str, bound: int) -> int:
    found = explore(WORLDS[name], bound)
    _tell(name, found)
    stuck = loops(found) if found.broken is None else []
    broken = found.broken or (
        Broken("no_loop_without_progress", "time goes round", found.path(stuck[0])) if stuck else None
    )
    if broken is not None:
        _tell_broken(name, broken)
    return int(broken is not None)


def _tell(name: str, found: Exploration) -> None:
    stats = found.stats
    cut = f"{stats.cut} states not gone on from" if stats.cut else "nothing: complete"
    counts = f"{stats.states:9} {stats.transitions:11} {stats.events:10}"
    print(f"{name:24} {counts} {stats.depth:5}   {cut} ({stats.seconds:.1f} s)", flush=True)


def _tell_defect(words: str, caught: Optional[Caught]) -> None:
    by = f"{caught.law} ({caught.world}, {caught.moves} moves)" if caught is not None else "NOT CAUGHT"
    print(f"  {words:62} {by}", flush=True)


def _tell_broken(name: str, broken: Broken) -> None:
    print(f"\nBROKEN in the world {name}: {broken.law}: {broken.why}")
    print("the shortest way there: " + " ".join(":".join(move) for move in broken.path))
    print(f"written to {write(broken, WORLDS[name].rules, FOUND)}")


def _conclude(proof: Proof) -> int:
    for name, broken in proof.broken.items():
        _tell_broken(name, broken)
    expected, totals = expected_coverage(), proof.stats.values()
    states, transitions = sum(s.states for s in totals), sum(s.transitions for s in totals)
    print(f"{'together':24} {states:9} {transitions:11} {sum(s.events for s in totals):10}")
    compared = sum(s.compared for s in totals)
    print(f"pairs of states that count as one, compared in all their next moves: {compared}, none different")
    print(f"rows and places that must be reached: {sum(map(len, vars(expected).values()))}, missing: {proof.missing}")
    silent = [name for name, count in proof.applied.items() if count == 0]
    print(f"laws: {len(proof.applied)}, checked {sum(proof.applied.values())} times where they apply, never: {silent}")
    return int(bool(proof.broken or proof.missing or silent))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
