"""`./run proof [large] [WORLD...]`: prove, print what was explored, what the bounds cut off, and what changed.

Without arguments: the bounded proof and its self-test, as in CI; what changed since its figures were accepted is named,
figure by figure. `accept --reason WHY` accepts them: test/proof/accepted.json and docs/safety.md are written anew.
`induction [--steps N] [--seed S]`: more steps from drawn states. `large`: every world to a bound that is some 60 times
higher; names of worlds: only those. A broken law is printed with the shortest way to it, and written as a scenario file
with its journal into test/proof/found/.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import List, Optional

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "engine"), str(HERE.parent / "mutation")]

from proof_defects import Caught  # noqa: E402
from proof_explorer import Broken, Stats  # noqa: E402
from proof_figures import Figures, differences, figures_of, fingerprint, keep, kept, read  # noqa: E402
from proof_figures import write as write_figures  # noqa: E402
from proof_induction import Induction, inductions, told  # noqa: E402
from proof_journal import write  # noqa: E402
from proof_pages import page  # noqa: E402
from proof_run import BOUND, LARGE, SEED, STEPS, Proof, expected_coverage, explored, prove, self_test  # noqa: E402
from proof_worlds import WORLDS  # noqa: E402

from amaze_autonomy.replay.errors import GoldenError  # noqa: E402
from amaze_autonomy.tester.golden import check_reason  # noqa: E402

PAGE = HERE.parents[1] / "docs" / "safety.md"
FOUND = HERE / "found"


def main(arguments: List[str]) -> int:
    """Run it; return 1 when a law is broken, something was not reached, a defect was missed, or figures changed."""
    if arguments[:1] == ["accept"]:
        return _accept(arguments[1:])
    if arguments[:1] == ["induction"]:
        return _on_demand(arguments[1:])
    large, names = "large" in arguments, [word for word in arguments if word != "large"]
    unknown = [name for name in names if name not in WORLDS]
    if unknown:
        print(f"no world {unknown[0]!r}; there is: {', '.join(WORLDS)}", file=sys.stderr)
        return 2
    began = time.perf_counter()
    if names:
        _head()
        return max([_only(name, LARGE if large else BOUND) for name in names])
    if large:
        _head()
        status = _conclude(prove(LARGE, _tell, os.cpu_count() or 1))
    else:
        figures = _prove(os.cpu_count() or 1)
        status = 1 if figures is None else _compare(figures)
    print(f"\n{time.perf_counter() - began:.0f} s")
    return status


def _head() -> None:
    print(f"{'world':24} {'states':>9} {'transitions':>11} {'events':>10} depth   cut off", flush=True)


def _prove(jobs: int) -> Optional[Figures]:
    """Return the figures of the bounded proof and its self-test; None: something is broken, missed or not reached."""
    sources = fingerprint()  # before: a file may be changed meanwhile
    _head()
    proof = prove(BOUND, _tell, jobs)
    status = _conclude(proof)
    print("\ndefects, and the law that caught each:", flush=True)
    caught = self_test(_tell_defect, jobs)
    steps = _induct(STEPS, SEED, jobs)
    if status or steps.broken or None in caught.values():
        return None
    figures = replace(figures_of(proof, caught, steps), sources=sources)
    keep(figures)
    return figures


def _induct(steps: int, seed: int, jobs: int) -> Induction:
    found = inductions(steps, seed, jobs, _tell_steps)
    for broken in found.broken:
        print(f"\nBROKEN in the induction: {told(broken)}")
    states = f"{sum(found.places.values())} sound states of {len(found.places)} places"
    print(
        f"induction: {found.steps} steps from {states}; {len(found.applied)} laws applied, {len(found.broken)} broken"
    )
    return found


def _tell_steps(found: Induction) -> None:
    if sys.stderr.isatty():
        print(f"{found.steps} steps\r", end="", file=sys.stderr, flush=True)


def _on_demand(arguments: List[str]) -> int:
    parser = argparse.ArgumentParser(prog="./run proof induction", description="Any event from any sound state.")
    parser.add_argument("--steps", type=int, default=10_000_000, help="how many; default: 10 million")
    parser.add_argument("--seed", type=int, default=SEED, help="of what is drawn")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes; default: one for each core")
    given = parser.parse_args(arguments)
    return int(bool(_induct(given.steps, given.seed, given.jobs).broken))


def _compare(figures: Figures) -> int:
    """Say what changed; the page follows what was accepted."""
    accepted = read()
    changed = differences(accepted, figures)
    if accepted is not None and not changed:
        write_figures(replace(accepted, sources=figures.sources), accepted.reason)
        PAGE.write_text(page(accepted), encoding="utf-8")
        print("\nthe figures are those that were accepted")
        return 0
    print("\n".join(["\nwhat changed since the figures were accepted:", *(f"  {line}" for line in changed)]))
    print("read that; if every line is what you meant: ./run proof accept --reason WHY")
    return 1


def _accept(arguments: List[str]) -> int:
    parser = argparse.ArgumentParser(prog="./run proof accept", description="Accept the figures of the bounded proof.")
    parser.add_argument("--reason", default="", help="why they are right, in a sentence")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes; default: one for each core")
    given = parser.parse_args(arguments)
    reason: str = given.reason
    try:
        check_reason(reason, "figures")
    except GoldenError as error:
        print(f"proof: {error}", file=sys.stderr)
        return 2
    figures = kept() or _prove(given.jobs)  # of the last run, if nothing has changed since
    if figures is None:
        print("not accepted: a proof that fails has no figures", file=sys.stderr)
        return 1
    print("\n".join(differences(read(), figures) or ("nothing has changed",)))
    PAGE.write_text(page(write_figures(figures, reason)), encoding="utf-8")
    return 0


def _only(name: str, bound: int) -> int:
    _, stats, broken = explored((name, bound))
    _tell(name, stats)
    if broken is not None:
        _tell_broken(name, broken)
    return int(broken is not None)


def _tell(name: str, stats: Stats) -> None:
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
