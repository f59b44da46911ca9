"""The verbs of `amaze-replay` that ask questions of scenarios and of runs: what-if, sweep, shrink, agree."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any, List

from amaze_autonomy.whole_file import write_whole

from ..errors import ReplayError
from ..journal_source import read_journals
from ..pages.sweep_page import write_sweep_page
from ..scenario import Case, load_cases
from ..terminal import show_lines
from .agree import agree, agreement_lines
from .choice import add_choice, add_configuration, check_options, chosen, finite, options_of
from .run import case_of
from .shrink import MOST_LINES, shrink
from .sweep import sweep, sweep_lines, sweep_plain
from .task import Task
from .whatif import other_options, what_if, what_if_lines, what_if_status

__all__ = ["add_tools"]


_MOST_RUNS = 10_000


def add_tools(commands: Any) -> None:
    """Add the verbs to the command line."""
    _add_what_if(commands)
    _add_sweep(commands)
    _add_shrink(commands)
    _add_agree(commands)


def _add_what_if(commands: Any) -> None:
    parser = commands.add_parser("what-if", help="the same scenarios by two configurations: what would be different")
    add_choice(parser)
    add_configuration(parser)
    words = "the other configuration: a folder, a YAML file with folder and set, or FILE.KEY=VALUE on top of the first"
    parser.add_argument("--against", required=True, metavar="DIR|FILE|KEY=VALUE", help=words)
    parser.add_argument("-j", "--jobs", type=int, default=1, metavar="N", help="processes; 0: one for each core")
    parser.set_defaults(command=_what_if)


def _what_if(options: argparse.Namespace) -> int:
    run = options_of(options, goldens=False)
    tasks = chosen(options, run)
    for each in (run, other_options(run, options.against)):
        check_options(each, tasks)
    forks = what_if(tasks, options.against, options.jobs or os.cpu_count() or 1)
    show_lines(what_if_lines(forks))
    return what_if_status(forks)


def _add_sweep(commands: Any) -> None:
    parser = commands.add_parser("sweep", help="begin a fault at each time of a grid: what is commanded, by its time")
    _add_file(parser)
    parser.add_argument("--fault", type=int, default=1, metavar="N", help="number of the fault, from 1 (default: 1)")
    parser.add_argument("--from", type=finite, default=0.0, dest="first_s", metavar="S", help="first time (default: 0)")
    parser.add_argument("--to", type=finite, required=True, dest="last_s", metavar="S", help="last time")
    parser.add_argument("--step", type=finite, default=1.0, metavar="S", help="of the grid (default: 1)")
    words = "how closely boundaries are found (default: 0.05)"
    parser.add_argument("--resolution", type=finite, default=0.05, metavar="S", help=words)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the map")
    parser.add_argument(
        "--html", type=Path, metavar="FILE", help="write the map as a picture: one page, no more needed"
    )
    parser.set_defaults(command=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    count = int((options.last_s - options.first_s) / options.step + 1e-9) if options.step > 0 else 0
    if count > _MOST_RUNS:
        raise ReplayError(f"a sweep of {count + 1} runs: must be at most {_MOST_RUNS}; take a larger --step")
    times = [round(options.first_s + number * options.step, 6) for number in range(max(0, count) + 1)]
    case = _case(options)
    result = sweep(case, options.fault, times, options.resolution, _progress)
    show_lines(sweep_lines(result))
    if options.json is not None:
        write_whole(options.json, json.dumps(sweep_plain(result), indent=1) + "\n")
    if options.html is not None:
        write_sweep_page(options.html, case.id, result)
    return 0


def _progress(t_s: float, outcome: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"{t_s:.3f} s: {outcome}\n")


def _add_shrink(commands: Any) -> None:
    parser = commands.add_parser("shrink", help="reduce a failing scenario to the few events of its first difference")
    _add_file(parser)
    parser.add_argument("--rule", default="", help="take the first decision by this rule instead; needs no golden")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the scenario; default: print it")
    parser.set_defaults(command=_shrink)


def _shrink(options: argparse.Namespace) -> int:
    result = shrink(_case(options), options.rule)
    lines: List[str] = result.text.splitlines()
    if options.out is not None:
        write_whole(options.out, result.text)
    else:
        show_lines(lines)
    long = "" if len(lines) < MOST_LINES else f", more than {MOST_LINES}"
    sys.stderr.write(f"{result.before} events became {len(result.events)}; {len(lines)} lines{long}\n")
    return 0


def _add_agree(commands: Any) -> None:
    parser = commands.add_parser("agree", help="two journals, live and replayed: the same decisions at the same times?")
    parser.add_argument("one", type=Path, metavar="FILE", help="journal of a run, or a bag with it")
    parser.add_argument("other", type=Path, metavar="FILE", help="journal of the other one, on the same clock")
    words = "how far apart the times of a decision may be (default: 0.3)"
    parser.add_argument("--tolerance", type=finite, default=0.3, metavar="S", help=words)
    parser.set_defaults(command=_agree)


def _agree(options: argparse.Namespace) -> int:
    one, other = (read_journals(path)[-1] for path in (options.one, options.other))
    result = agree(one, other, options.tolerance)
    show_lines(agreement_lines(result))
    return 0 if result.agreed else 1


def _add_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="scenario")
    parser.add_argument("--variant", help="combination of its matrix; default: the first")


def _case(options: argparse.Namespace) -> Case:
    return load_cases(options.file)[0] if options.variant is None else case_of(Task(str(options.file), options.variant))
