"""Runs a suite against each mutant until a scenario decides otherwise: is every row of the tables really tested?"""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.paths import config_folder

from ...journal.journal import encode_decision
from ...replay.errors import ReplayError
from ..play import configuration_of, play
from ..result import Result
from ..run import case_of, digest_of
from ..scenario import Case, SourceKind
from ..task import Options, Task
from .coverage import Coverage
from .mutants import Mutant, mutant_of, mutants_of, mutated

__all__ = ["Hunt", "Survival", "hunts_of", "mutation_lines", "mutation_passed", "run_hunt", "run_hunts"]


@dataclass(frozen=True)
class Hunt:
    """One mutant, and the tests that may notice it, the likeliest first; with the digest of each as it should be."""

    mutant: str
    tasks: Tuple[Task, ...]
    digests: Tuple[str, ...]


@dataclass(frozen=True)
class Survival:
    """What became of a mutant.

    Args:
        mutant: its name.
        caught_by: id of the first scenario that decided otherwise; empty: none did.
        tried: how many scenarios were run.
    """

    mutant: str
    caught_by: str
    tried: int


def hunts_of(tasks: Sequence[Task], results: Sequence[Result], coverage: Coverage, only: str = "") -> Tuple[Hunt, ...]:
    """Return a hunt for each mutant of the shipped rules.

    Args:
        tasks: of the suite; journals are left out, they are decided by rules of their own.
        results: of the same tasks, on the rules as they are.
        coverage: of the results.
        only: kinds or names that hold this text; empty: all.
    """
    pairs = [(t, r) for t, r in zip(tasks, results) if r.lines and case_of(t).source != SourceKind.JOURNAL]
    pairs.sort(key=lambda pair: pair[1].figures.flown_s)
    fired: Dict[str, Tuple[str, ...]] = {item.name: item.scenarios for item in coverage.items}
    hunts: List[Hunt] = []
    for mutant in mutants_of(load_configuration(config_folder()).rules):
        if only in str(mutant):
            likely = fired.get(mutant.item, ())
            ordered = sorted(pairs, key=lambda pair: pair[1].id not in likely)
            if mutant.kind == "row":
                ordered = [pair for pair in ordered if pair[1].id in likely]  # elsewhere it changes nothing
            hunts.append(Hunt(str(mutant), tuple(t for t, _ in ordered), tuple(r.digest for _, r in ordered)))
    return tuple(hunts)


def run_hunt(hunt: Hunt) -> Survival:
    """Run tests until one decides otherwise.

    Raises:
        ReplayError: there is no such mutant.
    """
    for number, (task, digest) in enumerate(zip(hunt.tasks, hunt.digests), 1):
        case = case_of(replace(task, options=Options(memory=task.options.memory)))
        rules = configuration_of(case, Options()).rules
        mutant = mutant_of(hunt.mutant, rules)
        if mutant is None:
            raise ReplayError(f"there is no mutant {hunt.mutant!r}")
        if _decided(case, mutant) != digest:
            return Survival(hunt.mutant, case.id, number)
    return Survival(hunt.mutant, "", len(hunt.tasks))


def _decided(case: Case, mutant: Mutant) -> str:
    """Return the digest of what a mutant decides; empty when it cannot even be run."""
    rules = configuration_of(case, Options()).rules
    with mutated(mutant, rules) as changed:
        limited = replace(case, limit_ns=min(case.limit_ns, _LIMIT_NS))
        try:
            trace = play(limited, Options(), changed).trace
        except (ValueError, KeyError, RuntimeError):
            return ""
    return digest_of([encode_decision(decision) for decision in trace.decisions])


_LIMIT_NS = 900_000_000_000


def run_hunts(
    hunts: Sequence[Hunt], jobs: int = 1, told: Optional[Callable[[Survival], None]] = None
) -> Tuple[Survival, ...]:
    """Run all hunts, in processes; the results are in their order."""
    tell = told or (lambda _: None)
    found: List[Survival] = []
    if jobs <= 1:
        for hunt in hunts:
            found.append(run_hunt(hunt))
            tell(found[-1])
        return tuple(found)
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        for survival in pool.map(run_hunt, hunts):
            found.append(survival)
            tell(survival)
    return tuple(found)


def mutation_lines(survivals: Sequence[Survival], waivers: Mapping[str, str]) -> List[str]:
    """Return what survived, and the score."""
    alive = [each for each in survivals if not each.caught_by]
    open_ = [each for each in alive if not _waived(each, waivers)]
    lines = [f"SURVIVED  {each.mutant}: none of {each.tried} scenarios decides otherwise" for each in open_]
    lines += [
        f"STALE     {each.mutant}: a waiver says that it survives, and {each.caught_by} catches it"
        for each in survivals
        if each.caught_by and _waived(each, waivers)
    ]
    caught = len(survivals) - len(alive)
    return [
        *lines,
        f"{caught} of {len(survivals)} mutants caught, {len(alive) - len(open_)} waived, {len(open_)} survive",
    ]


def mutation_passed(survivals: Sequence[Survival], waivers: Mapping[str, str]) -> bool:
    """Return True when each mutant is caught or has a waiver, and none has both."""
    return all(bool(each.caught_by) is not _waived(each, waivers) for each in survivals)


def _waived(survival: Survival, waivers: Mapping[str, str]) -> bool:
    return f"mutant {survival.mutant}" in waivers
