"""The verbs of `amaze-replay` about scenarios: test and accept; the others are added here."""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, List, Mapping, Sequence

from amaze_autonomy.whole_file import write_whole

from ..pages.page import write_page
from ..terminal import show_lines
from .accept import accept, lonely_goldens
from .choice import (
    add_choice,
    add_configuration,
    add_waivers,
    check_options,
    chosen,
    is_full,
    options_of,
    waivers_of,
)
from .cli_coverage import add_coverage_commands
from .cli_tools import add_tools
from .coverage import coverage_of
from .result import Result, exit_status
from .runner import run_tasks
from .task import Options
from .told import NOT_COMPARED, as_json, as_junit, as_markdown, result_lines, summary_line

__all__ = ["add_commands"]

_Parsers = Any
_STARTED = '{"version": 1, "verdict": "ERROR", "headline": "the run has not ended"}\n'


def add_commands(commands: _Parsers) -> None:
    """Add the verbs to the command line."""
    _add_test(commands)
    _add_accept(commands)
    add_coverage_commands(commands)
    add_tools(commands)


def _add_test(commands: _Parsers) -> None:
    test = commands.add_parser("test", help="run scenarios and compare them with their goldens")
    add_choice(test)
    add_configuration(test)
    test.add_argument("-j", "--jobs", type=int, default=1, metavar="N", help="processes; 0: one for each core")
    test.add_argument("-v", "--verbose", action="store_true", help="print every expectation with its margin")
    test.add_argument("--no-goldens", action="store_true", help="judge the expectations alone")
    test.add_argument("--json", type=Path, metavar="FILE", help="write the results; ERROR until the run has ended")
    test.add_argument("--junit", type=Path, metavar="FILE", help="write the results as JUnit XML")
    test.add_argument("--markdown", type=Path, metavar="FILE", help="write a summary")
    test.add_argument("--html", type=Path, metavar="FILE", help="write the report: one page, nothing else is needed")
    add_waivers(test)
    test.set_defaults(command=_test)


def _test(options: argparse.Namespace) -> int:
    began = time.perf_counter()
    if options.json is not None:
        write_whole(options.json, _STARTED)
    waivers = waivers_of(options) if options.html is not None else {}
    goldens = not (options.no_goldens or options.config or options.set)
    tasks = chosen(options, options_of(options, goldens=goldens, story=options.html is not None))
    check_options(options_of(options), tasks)
    results = run_tasks(tasks, options.jobs or os.cpu_count() or 1, lambda each: _say(each, verbose=options.verbose))
    if goldens and is_full(options):
        lonely = lonely_goldens(tasks)
        for each in lonely:
            _say(each, verbose=False)
        results += lonely
    wall_s = time.perf_counter() - began
    show_lines([summary_line(results, wall_s) + ("" if goldens or options.no_goldens else NOT_COMPARED)])
    _write(options, results, waivers, wall_s)
    return exit_status(result.verdict for result in results)


def _say(result: Result, *, verbose: bool) -> None:
    show_lines(result_lines(result, verbose=verbose))
    sys.stdout.flush()


def _write(options: argparse.Namespace, results: Sequence[Result], waivers: Mapping[str, str], wall_s: float) -> None:
    if options.html is not None:
        write_page(options.html, results, coverage_of(results, waivers), wall_s)
    if options.junit is not None:
        write_whole(options.junit, as_junit(results))
    if options.markdown is not None:
        write_whole(options.markdown, as_markdown(results, wall_s))
    if options.json is not None:
        write_whole(options.json, as_json(results))


def _add_accept(commands: _Parsers) -> None:
    parser = commands.add_parser("accept", help="make runs the goldens, with a reason; shows each difference")
    add_choice(parser)
    parser.add_argument("--reason", default="", help="why the decisions are right now, in a sentence")
    parser.add_argument("--prune", action="store_true", help="delete goldens that belong to no scenario")
    parser.set_defaults(command=_accept, config=None, set=[])


def _accept(options: argparse.Namespace) -> int:
    tasks = [replace(task, options=Options()) for task in chosen(options, Options())]
    lines: List[str] = []
    done = accept(tasks, options.reason, lambda line: show_lines([line]), prune=options.prune, full=is_full(options))
    lines.append(
        f"{len(done.new)} new, {len(done.changed)} replaced, {len(done.unchanged)} unchanged, "
        f"{len(done.pruned)} deleted, {len(done.refused)} refused"
    )
    show_lines(lines)
    return 1 if done.refused else 0
