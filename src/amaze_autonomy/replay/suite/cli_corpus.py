"""`amaze-replay corpus`: all flights that a team has, on all processors or machines that it has."""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, List, Sequence, Tuple

from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.whole_file import write_whole

from ..errors import ReplayError
from ..tape_option import add_tapes, use_tapes
from ..terminal import progress_bar, show_lines
from .choice import add_choice, add_configuration, check_options, chosen, options_of
from .cluster import run_on_cluster
from .corpus import bags_of, examined, time_table
from .fetch import data_folder, fetch_bags
from .result import Result, Verdict, exit_status
from .runner import run_tasks
from .task import Task
from .told import NOT_COMPARED, as_json, result_lines

__all__ = ["add_corpus"]

_STARTED = '{"version": 1, "verdict": "ERROR", "headline": "the run has not ended"}\n'


def add_corpus(commands: Any) -> None:
    """Add the verb to the command line."""
    corpus = commands.add_parser("corpus", help="look through all bags of scenarios, run all, tell the time")
    add_choice(corpus)
    add_configuration(corpus)
    corpus.add_argument("-j", "--jobs", type=int, default=0, metavar="N", help="processes; 0 (default): one each core")
    corpus.add_argument("--dask", default="", metavar="tcp://HOST:PORT", help="run on the workers of this scheduler")
    words = "where ${AMAZE_DATA} of the scenarios is: any URL that fsspec reads; bags are fetched and kept"
    corpus.add_argument("--data", default="", metavar="URL", help=words)
    add_tapes(corpus)
    corpus.add_argument("--no-doctor", action="store_true", help="do not look through the bags first")
    corpus.add_argument("--no-goldens", action="store_true", help="judge the expectations alone")
    corpus.add_argument("-v", "--verbose", action="store_true", help="print every expectation with its margin")
    corpus.add_argument("--json", type=Path, metavar="FILE", help="write the results; ERROR until the run has ended")
    corpus.set_defaults(command=_corpus)


def _corpus(options: argparse.Namespace) -> int:
    use_tapes(options)
    if options.json is not None:
        write_whole(options.json, _STARTED)
    goldens = not (options.no_goldens or options.config or options.set)
    jobs = options.jobs or os.cpu_count() or 1
    with data_folder(options.data):
        tasks = chosen(options, options_of(options, goldens=goldens))
        check_options(options_of(options), tasks)
        if options.data and not options.dask:
            tasks = _fetched(tasks, options.data)
        if not (options.no_doctor or options.dask):  # the bags need not be on this machine
            show_lines([f"damaged: {line}" for line in examined(bags_of(tasks), jobs)])
        began = time.perf_counter()
        results, workers = _run(tasks, options, jobs)
    wall_s = time.perf_counter() - began
    show_lines([_summary(results) + ("" if goldens or options.no_goldens else NOT_COMPARED)])
    sys.stderr.write("".join(f"{line}\n" for line in time_table(results, wall_s, workers)))
    if options.json is not None:
        write_whole(options.json, as_json(results, wall_s=wall_s, workers=workers))
    return exit_status(result.verdict for result in results)


def _run(tasks: Sequence[Task], options: argparse.Namespace, jobs: int) -> Tuple[Tuple[Result, ...], int]:
    shown: List[Result] = []
    with progress_bar("running") as progress:

        def tell(result: Result) -> None:
            shown.append(result)
            show_lines(result_lines(result, verbose=options.verbose))
            sys.stdout.flush()
            progress(len(shown), len(tasks))

        if options.dask:
            return run_on_cluster(options.dask, tasks, options.data, tell)
        return run_tasks(tasks, jobs, tell), min(jobs, max(1, len(tasks)))


def _fetched(tasks: Sequence[Task], url: str) -> Tuple[Task, ...]:
    """Return the tasks, with their bags here; the weight is known only now."""
    found = []
    for task in tasks:
        try:
            fetch_bags(task, url)
            size = sum(bag.stat().st_size for bag in bags_of([task])) / 1e6
            found.append(replace(task, weight=max(task.weight, size)))
        except (ReplayError, ConfigError, OSError) as error:
            found.append(replace(task, error=str(error)))
    return tuple(found)


def _summary(results: Sequence[Result]) -> str:
    """Return how many tests have which verdict; without times, so that it is the same with any number of processes."""
    counts = {verdict: sum(result.verdict is verdict for result in results) for verdict in Verdict}
    said = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count) or "no tests"
    return f"{said}; {sum(result.figures.flown_s for result in results):.0f} s of flight"
