"""The verbs of `amaze-replay` about the quality of a suite: coverage and mutate."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Any, Mapping, Tuple

from ..terminal import show_lines
from .choice import add_choice, add_waivers, chosen, waivers_of
from .coverage import Coverage, coverage_lines, coverage_of
from .mutation import hunts_of, mutation_lines, mutation_passed, run_hunts
from .result import Result
from .runner import run_tasks
from .task import Options, Task

__all__ = ["add_coverage_commands"]

_JOBS = "processes; 0: one for each core"


def add_coverage_commands(commands: Any) -> None:
    """Add the verbs to the command line."""
    coverage = commands.add_parser("coverage", help="which rows of the engine's tables fire in a suite; a gate")
    _add(coverage)
    coverage.add_argument("-v", "--verbose", action="store_true", help="print every row, where it fired, with values")
    coverage.set_defaults(command=_coverage)
    mutate = commands.add_parser("mutate", help="change each row of the tables: does a scenario notice?")
    _add(mutate)
    mutate.add_argument(
        "--only", default="", metavar="TEXT", help="mutants whose name holds this, e.g. 'shifted limit'"
    )
    mutate.set_defaults(command=_mutate)


def _add(parser: argparse.ArgumentParser) -> None:
    add_choice(parser)
    add_waivers(parser)
    parser.add_argument("-j", "--jobs", type=int, default=1, metavar="N", help=_JOBS)


def _covered(options: argparse.Namespace) -> Tuple[Tuple[Task, ...], Tuple[Result, ...], Coverage, Mapping[str, str]]:
    waivers = waivers_of(options)
    tasks = chosen(options, Options(goldens=False))
    results = run_tasks(tasks, _jobs(options))
    return tasks, results, coverage_of(results, waivers), waivers


def _jobs(options: argparse.Namespace) -> int:
    return int(options.jobs) or os.cpu_count() or 1


def _coverage(options: argparse.Namespace) -> int:
    _, _, coverage, _ = _covered(options)
    show_lines(coverage_lines(coverage, verbose=options.verbose))
    return 0 if coverage.passed else 1


def _mutate(options: argparse.Namespace) -> int:
    tasks, results, coverage, waivers = _covered(options)
    hunts = hunts_of(tasks, results, coverage, options.only)

    def tell(survival: Any) -> None:
        if sys.stderr.isatty():
            sys.stderr.write(f"{survival.mutant}: {survival.caught_by or 'SURVIVED'}\n")

    survivals = run_hunts(hunts, _jobs(options), tell)
    show_lines(mutation_lines(survivals, waivers))
    return 0 if mutation_passed(survivals, waivers) else 1
