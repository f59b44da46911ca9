"""The verbs of `amaze-replay` about scenarios: test, accept, coverage, mutate, what-if, sweep, shrink, agree."""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Callable, List, Mapping, Sequence, Tuple

from amaze_autonomy.bags.cli import add_memory
from amaze_autonomy.files import Kind, beginning, check_output, write_whole
from amaze_autonomy.replay.errors import GoldenError

from ..journal.journal import Journal
from ..pages.document import is_document, need_plots
from ..paths import expanded
from ..replay.errors import ReplayError
from ..replay.recordings.journals import read_journals
from .coverage import (
    Coverage,
    check_only,
    coverage_lines,
    coverage_of,
    hunts_of,
    mutation_lines,
    mutation_passed,
    run_hunts,
)
from .difference import agree, agreement_lines
from .golden import check_reason, compare_with_golden, golden_path, may_be_of, orphans, read_golden, write_golden
from .report_pages import REPORT_TITLE, write_page, write_sweep_page
from .run import case_of, run_task, run_tasks
from .scenario import Case, load_cases
from .shrink import MOST_LINES, shrink
from .task import (
    JUNIT,
    NOT_COMPARED,
    RESULTS,
    SUMMARY,
    Options,
    Result,
    Task,
    Verdict,
    as_json,
    as_junit,
    as_markdown,
    exit_status,
    result_lines,
    summary_line,
)
from .terminal import (
    add_choice,
    add_configuration,
    add_waivers,
    check_options,
    chosen,
    finite,
    is_full,
    options_of,
    show_lines,
    waivers_of,
)
from .whatif import other_options, sweep, sweep_lines, sweep_plain, sweep_status, what_if, what_if_lines, what_if_status

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
    test.add_argument("--json", type=expanded, metavar="FILE", help="write the results; ERROR until the run has ended")
    test.add_argument("--junit", type=expanded, metavar="FILE", help="write the results as JUnit XML")
    test.add_argument("--markdown", type=expanded, metavar="FILE", help="write a summary")
    test.add_argument(
        "--html", type=expanded, metavar="FILE", help="write the report: one page, nothing else is needed"
    )
    add_waivers(test)
    test.set_defaults(command=_test)


_REPORT = Kind("report of scenarios", lambda path: is_document(path, REPORT_TITLE))


def _test(options: argparse.Namespace) -> int:
    began = time.perf_counter()
    if options.html is not None:
        need_plots()
    for path, option, kind in (
        (options.json, "--json", RESULTS),
        (options.junit, "--junit", JUNIT),
        (options.markdown, "--markdown", SUMMARY),
        (options.html, "--html", _REPORT),
    ):
        check_output(path, option, kind, options.paths)
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
    tasks = chosen(options, Options(memory=options.memory))
    lines: List[str] = []
    done = accept(tasks, options.reason, lambda line: show_lines([line]), prune=options.prune, full=is_full(options))
    lines.append(
        f"{len(done.new)} new, {len(done.changed)} replaced, {len(done.unchanged)} unchanged, "
        f"{len(done.pruned)} deleted, {len(done.refused)} refused"
    )
    show_lines(lines)
    return 1 if done.refused else 0


# --- cli coverage -----------------------------------------------------------------------------------------------------
# The verbs of `amaze-replay` about the quality of a suite: coverage and mutate.


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
    tasks = chosen(options, Options(goldens=False, memory=options.memory))
    results = run_tasks(tasks, _jobs(options))
    for each in results:
        if each.verdict in (Verdict.ERROR, Verdict.INCONCLUSIVE):  # its rows may lack for that reason
            sys.stderr.write(f"{each.verdict.value}: {each.id}: {each.headline}\n")
    return tasks, results, coverage_of(results, waivers), waivers


def _jobs(options: argparse.Namespace) -> int:
    return int(options.jobs) or os.cpu_count() or 1


def _coverage(options: argparse.Namespace) -> int:
    _, results, coverage, _ = _covered(options)
    show_lines(coverage_lines(coverage, verbose=options.verbose))
    unrun = [each.verdict for each in results if each.verdict in (Verdict.ERROR, Verdict.INCONCLUSIVE)]
    return exit_status(unrun) if coverage.passed else 1


def _mutate(options: argparse.Namespace) -> int:
    check_only(options.only)
    tasks, results, coverage, waivers = _covered(options)
    hunts = hunts_of(tasks, results, coverage, options.only)

    def tell(survival: Any) -> None:
        if sys.stderr.isatty():
            sys.stderr.write(f"{survival.mutant}: {survival.caught_by or 'SURVIVED'}\n")

    survivals = run_hunts(hunts, _jobs(options), tell)
    show_lines(mutation_lines(survivals, waivers))
    return 0 if mutation_passed(survivals, waivers) else 1


# --- cli tools --------------------------------------------------------------------------------------------------------
# The verbs of `amaze-replay` that ask questions of scenarios and of runs: what-if, sweep, shrink, agree.


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
    parser.add_argument("--json", type=expanded, metavar="FILE", help="write the map")
    parser.add_argument(
        "--html", type=expanded, metavar="FILE", help="write the map as a picture: one page, no more needed"
    )
    parser.set_defaults(command=_sweep)


_SWEPT = Kind("map of a sweep", beginning(r'\{\s*"fault": '))


def _sweep(options: argparse.Namespace) -> int:
    if options.html is not None:
        need_plots()
    count = int((options.last_s - options.first_s) / options.step + 1e-9) if options.step > 0 else 0
    if count > _MOST_RUNS:
        raise ReplayError(f"a sweep of {count + 1} runs: must be at most {_MOST_RUNS}; take a larger --step")
    times = [round(options.first_s + number * options.step, 6) for number in range(max(0, count) + 1)]
    check_output(options.json, "--json", _SWEPT, [options.file])
    case = _case(options)
    page = Kind(f"page of a sweep of {case.id}", lambda path: is_document(path, case.id))
    check_output(options.html, "--html", page, [options.file])
    result = sweep(case, options.fault, times, options.resolution, _progress)
    show_lines(sweep_lines(result))
    if options.json is not None:
        write_whole(options.json, json.dumps(sweep_plain(result), indent=1) + "\n")
    if options.html is not None:
        write_sweep_page(options.html, case.id, result)
    return sweep_status(result)


def _progress(t_s: float, outcome: str) -> None:
    if sys.stderr.isatty():
        sys.stderr.write(f"{t_s:.3f} s: {outcome}\n")


def _add_shrink(commands: Any) -> None:
    parser = commands.add_parser("shrink", help="reduce a failing scenario to the few events of its first difference")
    _add_file(parser)
    parser.add_argument("--rule", default="", help="take the first decision by this rule instead; needs no golden")
    parser.add_argument("--out", type=expanded, metavar="FILE", help="write the scenario; default: print it")
    parser.set_defaults(command=_shrink)


_SHRUNK = Kind("shrunk scenario", beginning(r'version: 1\ndescription: "Shrunk from '))


def _shrink(options: argparse.Namespace) -> int:
    check_output(options.out, "--out", _SHRUNK, [options.file])
    result = shrink(_case(options), options.rule, Path() if options.out is None else options.out.parent)
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
    parser.add_argument("one", type=expanded, metavar="FILE", help="journal of a run, or a bag with it")
    parser.add_argument("other", type=expanded, metavar="FILE", help="journal of the other one, on the same clock")
    words = "how far apart the times of a decision may be (default: 0.3)"
    parser.add_argument("--tolerance", type=finite, default=0.3, metavar="S", help=words)
    add_memory(parser)
    parser.set_defaults(command=_agree)


def _agree(options: argparse.Namespace) -> int:
    one, other = (_only_journal(path, options.memory) for path in (options.one, options.other))
    result = agree(one, other, options.tolerance)
    show_lines(agreement_lines(result))
    return 0 if result.agreed else 1


def _only_journal(path: Path, memory: int) -> Journal:
    """Return the journal of a run.

    Raises:
        ReplayError: the bag holds several, and it is not known which one is meant.
    """
    journals = read_journals(path, memory=memory)
    if len(journals) > 1:
        words = f"{path}: holds {len(journals)} journals, of an engine that was started anew"
        raise ReplayError(f"{words}; name the file of one of them instead")
    return journals[0]


def _add_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=expanded, metavar="FILE", help="scenario")
    parser.add_argument("--variant", help="combination of its matrix; default: the first")
    add_memory(parser)


def _case(options: argparse.Namespace) -> Case:
    variant = load_cases(options.file)[0].variant if options.variant is None else options.variant
    return case_of(Task(str(options.file), variant, Options(memory=options.memory)))


# --- accepting --------------------------------------------------------------------------------------------------------
# Accepts runs as goldens: with a reason, one after the other, with the difference shown, and never in CI.


Say = Callable[[str], None]


@dataclass(frozen=True)
class Accepted:
    """What was done: ids of new, changed and unchanged goldens, pruned files, and (id, why) of what was refused."""

    new: Tuple[str, ...] = ()
    changed: Tuple[str, ...] = ()
    unchanged: Tuple[str, ...] = ()
    pruned: Tuple[Path, ...] = ()
    refused: Tuple[Tuple[str, str], ...] = ()


def accept(
    tasks: Sequence[Task],
    reason: str,
    say: Say,
    *,
    prune: bool = False,
    full: bool = False,
) -> Accepted:
    """Run tasks, show how each differs from its golden, and make the run the golden.

    Args:
        tasks: of all scenarios to accept.
        reason: why the decisions are right now; it is written into the golden.
        say: takes each line.
        prune: delete goldens that belong to no scenario; for a full run only.
        full: the tasks are all of their folders.

    Raises:
        GoldenError: it may not be done here, or not in this way.
    """
    _check(tasks, reason, prune=prune, full=full)
    done: List[Tuple[str, str, str]] = []
    cases: List[Case] = []
    for task in tasks:
        result = run_task(replace(task, options=replace(task.options, goldens=False)))
        refusal = _refusal(result)
        if refusal:
            say(f"{result.id}: not accepted: {refusal}")
            done.append(("refused", result.id, refusal))
            continue
        case = case_of(task)
        cases.append(case)
        done.append((_accepted(case, task, result, reason, say), result.id, ""))
    pruned = _prune(cases, say) if prune and not any(kind == "refused" for kind, _, _ in done) else ()
    names = {kind: tuple(name for each, name, _ in done if each == kind) for kind in ("new", "changed", "unchanged")}
    refused = tuple((name, why) for kind, name, why in done if kind == "refused")
    return Accepted(names["new"], names["changed"], names["unchanged"], pruned, refused)


def lonely_goldens(tasks: Sequence[Task]) -> Tuple[Result, ...]:
    """Return a failed result for each golden that belongs to none of the tasks; for a full run.

    What may be of a file with a mistake is none of them: nobody should delete it for a slip of the keyboard.
    """
    cases = [case_of(task) for task in tasks if not task.error]
    unreadable = [Path(task.path) for task in tasks if task.error]
    return tuple(
        Result(
            id=path.name,
            path=str(path),
            variant="",
            description="",
            verdict=Verdict.FAIL,
            headline="a golden without a scenario; delete it, or: amaze-replay accept FOLDER --prune --reason ...",
            command=f"amaze-replay test {path.parent.parent}",
        )
        for path in orphans(cases)
        if not any(may_be_of(path, each) for each in unreadable)
    )


def _check(tasks: Sequence[Task], reason: str, *, prune: bool, full: bool) -> None:
    check_reason(reason, "goldens")
    if prune and not full:
        raise GoldenError("--prune deletes goldens of no scenario: give it whole folders, without --tag and --variant")
    for task in tasks:
        if task.options.configuration or task.options.overrides:
            raise GoldenError("a golden is of the scenario's own configuration: leave out --config and --set")
        if task.error:
            raise GoldenError(task.error)


def _refusal(result: Result) -> str:
    """Return why a run cannot be a golden; empty: it can."""
    judged = result.findings or result.problems or not result.lines
    by_golden_alone = result.verdict is Verdict.VACUOUS and not judged
    return "" if result.verdict is Verdict.PASS or by_golden_alone else f"{result.verdict.value}: {result.headline}"


def _accepted(case: Case, task: Task, result: Result, reason: str, say: Say) -> str:
    try:
        old = read_golden(golden_path(case))
    except GoldenError as error:  # whose remedy is this very verb
        say(f"{result.id}: the old golden is damaged, no difference can be shown: {error}")
        write_golden(case, result.lines, reason)
        return "changed"
    if old is not None and not compare_with_golden(case, result.lines, "", 0):
        return "unchanged"
    if old is not None:
        for line in run_task(task).difference:
            say(f"{result.id}: {line}")
    write_golden(case, result.lines, reason)
    say(f"{result.id}: {'new golden' if old is None else 'golden replaced'}, {len(result.lines)} decisions")
    return "new" if old is None else "changed"


def _prune(cases: Sequence[Case], say: Say) -> Tuple[Path, ...]:
    gone = orphans(cases)
    for path in gone:
        path.unlink()
        say(f"{path}: deleted, no scenario has it")
    return gone
