"""Runs one task: plays the case, judges its expectations, compares it with its golden, and gives the verdict."""

from __future__ import annotations

import hashlib
import multiprocessing
import sys
import time
import traceback
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Callable, Dict, Iterable, Iterator, List, Optional, Sequence, Set, Tuple, TypeVar

from amaze_autonomy.bags.errors import BagError, MessageError
from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.replay.compare import broken_words, laws_of_lines
from amaze_autonomy.simulation.errors import SimulationError

from ..journal.journal import JournalError, encode_decision
from ..journal.trace import Trace
from ..replay.errors import DamagedInputError, NoMessagesError, ReplayError, TimeJumpError
from .expect import Finding, Grade, judge
from .expect.model import LOSSES, Pattern, about, instants
from .golden import compare_with_golden
from .play import Played, configuration_of, play
from .scenario import Case, load_cases
from .scenario.files import meant, place_of
from .scenario.model import Anchor
from .task import Figures, Result, Task, Verdict

_KNOWN = (ConfigError, ReplayError, SimulationError, JournalError, OSError)
_INPUT = (BagError, MessageError, DamagedInputError, NoMessagesError, TimeJumpError)


def run_task(task: Task) -> Result:
    """Run one test. It never raises: what cannot be run is an ERROR, with the reason as its headline."""
    began, cpu = time.perf_counter(), time.process_time()
    result = _guarded(task)
    figures = replace(
        result.figures,
        wall_s=time.perf_counter() - began,
        cpu_s=time.process_time() - cpu,
        peak_mb=peak_mb(),
    )
    return replace(result, figures=figures)


def _guarded(task: Task) -> Result:
    if task.error:
        return _failed(task, None, Verdict.ERROR, task.error)
    case: Optional[Case] = None
    try:
        case = case_of(task)
        return run_case(case, task)
    except _INPUT as error:
        return _failed(task, case, Verdict.INCONCLUSIVE, str(error))
    except _KNOWN as error:
        return _failed(task, case, Verdict.ERROR, str(error))
    except Exception as error:  # noqa: BLE001  (one broken test must not end the others)
        last = traceback.format_exc().strip().splitlines()
        words = f"an error in amaze-replay: {type(error).__name__}: {error}"
        return replace(_failed(task, case, Verdict.ERROR, words), problems=tuple(last))


def case_of(task: Task) -> Case:
    """Return the case of a task.

    Raises:
        ConfigError: the file has a mistake.
        ReplayError: the file has no such variant.
    """
    cases = load_cases(Path(task.path))
    for case in cases:
        if case.variant == task.variant:
            return replace(case, memory=task.options.memory)
    known = ", ".join(case.variant or "the only one" for case in cases)
    raise ReplayError(f"{task.path}: there is no variant {task.variant!r}; there is {known}")


def run_case(case: Case, task: Task) -> Result:
    """Run a case and judge it.

    Raises:
        ConfigError, ReplayError, SimulationError, JournalError, BagError: it cannot be run.
    """
    played = play(case, task.options)
    trace = played.trace
    lawful = laws_of_lines(played.lines)
    if lawful.different:
        raise ReplayError(
            f"the laws were checked on other decisions than the test judges: {lawful.different} are different when "
            "the run's journal is decided again"
        )
    unlawful = tuple(broken_words(each, trace.start_ns) for each in lawful.judged.broken)
    check_names(case, trace, lambda: [row.name for row in configuration_of(case, task.options).rules.components])
    anchors = anchor_times(case.anchors, trace)
    findings = tuple(judge(each, trace, anchors) for each in case.expectations)
    lines = tuple(encode_decision(decision) for decision in trace.decisions)
    difference = compare_with_golden(case, lines, command_of(task), trace.start_ns) if task.options.goldens else ()
    verdict, headline = _verdict(findings, played, unlawful, difference, golden=task.options.goldens)
    return Result(
        id=case.id,
        path=task.path,
        variant=case.variant,
        description=case.description,
        verdict=verdict,
        headline=headline,
        findings=findings,
        problems=(*unlawful, *played.broken, *played.vacuous),
        difference=difference,
        lines=lines,
        digest=digest_of(lines),
        unread=tuple((each.key, each.reason) for each in played.unread),
        story=played.lines if task.options.story else (),
        marks=played.marks,
        start_ns=trace.start_ns,
        command=command_of(task),
        tags=case.tags,
        requirements=case.requirements,
        figures=Figures(flown_s=(trace.end_ns - max(trace.start_ns, trace.begin_ns)) / 1e9),
    )


def digest_of(lines: Sequence[str]) -> str:
    """Return the SHA-256 of canonical lines."""
    return hashlib.sha256("".join(f"{line}\n" for line in lines).encode("ascii")).hexdigest()


def command_of(task: Task) -> str:
    """Return the command that runs a task alone."""
    words = ["amaze-replay", "test", quote(task.path)]
    if task.variant:
        words += ["--variant", f"'{task.variant}'"]
    if task.options.configuration:
        words += ["--config", quote(task.options.configuration)]
    return " ".join([*words, *(f"--set '{text}'" for text in task.options.overrides)])


def _verdict(
    findings: Tuple[Finding, ...],
    played: Played,
    unlawful: Tuple[str, ...],
    difference: Tuple[str, ...],
    *,
    golden: bool,
) -> Tuple[Verdict, str]:
    """Return the verdict and its first reason: a broken law, then what was put in, then what came out."""
    if unlawful:
        return Verdict.FAIL, unlawful[0]
    if played.broken:
        return Verdict.INCONCLUSIVE, played.broken[0]
    for finding in findings:
        if finding.grade is Grade.FAIL:
            missed = f" ({finding.margin_text})" if finding.margin_text else ""
            return Verdict.FAIL, f"{finding.expectation}: {finding.text}{missed}"
    if played.vacuous:
        return Verdict.VACUOUS, played.vacuous[0]
    for finding in findings:
        if finding.grade is Grade.VACUOUS:
            return Verdict.VACUOUS, f"{finding.expectation}: {finding.text}"
    if not findings and not (golden and played.trace.decisions):
        missing = "no golden is compared" if played.trace.decisions else "nothing was decided"
        return Verdict.VACUOUS, f"it has no expectations, and {missing}: nothing was judged"
    if difference:
        return Verdict.FAIL, difference[0]
    return Verdict.PASS, _good(findings, len(played.trace.decisions))


def _good(findings: Tuple[Finding, ...], decisions: int) -> str:
    """Say what was found, with the smallest margin relative to its limit."""
    tight: List[Tuple[float, str]] = [
        (finding.margin / finding.limit, f"{finding.margin_text}: {finding.expectation}")
        for finding in findings
        if finding.margin is not None and finding.limit
    ]
    closest = f"; closest {min(tight)[1]}" if tight else ""
    return f"{decisions} decisions, {len(findings)} expectations hold{closest}"


def _failed(task: Task, case: Optional[Case], verdict: Verdict, text: str) -> Result:
    name = Path(task.path).name.split(".")[0]
    return Result(
        id=case.id if case is not None else f"{name}[{task.variant}]" if task.variant else name,
        path=task.path,
        variant=task.variant,
        description=case.description if case is not None else "",
        verdict=verdict,
        headline=" ".join(text.split()),
        command=command_of(task),
        tags=case.tags if case is not None else (),
        requirements=case.requirements if case is not None else (),
    )


# --- runner -----------------------------------------------------------------------------------------------------------
# Runs tasks one after the other, or in several processes: the results are the same, and in the order of the tasks.


Told = Callable[[Result], None]
Given = TypeVar("Given")
Made = TypeVar("Made")


def run_tasks(tasks: Sequence[Task], jobs: int = 1, told: Optional[Told] = None) -> Tuple[Result, ...]:
    """Run all tasks.

    Args:
        tasks: in the order of the results.
        jobs: processes; 1: this one.
        told: called with each result, in the order of the tasks, as soon as all before it are there.
    """
    if jobs <= 1 or len(tasks) <= 1:
        return tuple(_each(task, told or (lambda _: None)) for task in tasks)
    order = sorted(range(len(tasks)), key=lambda number: (-tasks[number].weight, number))

    def lost(task: Task) -> Result:
        return _failed(task, None, Verdict.ERROR, f"the process that ran it {DIED}")

    return spread(run_task, tasks, jobs, lost, told, order)


def _each(task: Task, tell: Told) -> Result:
    result = run_task(task)
    tell(result)
    return result


DIED = "died, twice: was it killed, or is the memory too small?"


def spread(
    work: Callable[[Given], Made],
    given: Sequence[Given],
    jobs: int,
    lost: Callable[[Given], Made],
    told: Optional[Callable[[Made], None]] = None,
    order: Optional[Sequence[int]] = None,
) -> Tuple[Made, ...]:
    """Do work in several processes; return what came of each, in the order of what was given.

    A process that dies takes all others of its pool with it. What has no result then is done again, each in a process
    of its own, one after the other: so the one that dies again is known, and what died for want of memory may pass.

    Args:
        work: done with each; both can be sent to another process.
        given: what it is done with.
        jobs: processes.
        lost: what came of one whose process died again.
        told: called with each result in order, as soon as all before it are there.
        order: in which they are begun, by number; None: their own.
    """
    made: Dict[int, Made] = {}
    shown = 0

    def keep(number: int, result: Made) -> None:
        nonlocal shown
        made[number] = result
        while shown in made:
            if told is not None:
                told(made[shown])
            shown += 1

    _in_a_pool(work, given, min(jobs, len(given)), range(len(given)) if order is None else order, keep)
    if len(made) < len(given) and jobs > 1:  # with room for each, before each has a process of its own
        _in_a_pool(work, given, jobs // 2, [number for number in range(len(given)) if number not in made], keep)
    for number, each in enumerate(given):
        if number not in made:
            _in_a_pool(work, given, 1, [number], keep)
        if number not in made:
            keep(number, lost(each))
    return tuple(made[number] for number in range(len(given)))


def _in_a_pool(
    work: Callable[[Given], Made],
    given: Sequence[Given],
    jobs: int,
    numbers: Sequence[int],
    keep: Callable[[int, Made], None],
) -> None:
    """Do work in a pool of processes until one of them dies."""
    # spawn: a fork of a process with threads may hang, and a fresh process is the same on every system.
    with ProcessPoolExecutor(max(1, jobs), mp_context=multiprocessing.get_context("spawn")) as pool:
        running: Dict[Future[Made], int] = {}
        with suppress(BrokenProcessPool):
            for number in numbers:
                running[pool.submit(work, given[number])] = number
        for future in as_completed(running):
            with suppress(BrokenProcessPool):
                keep(running[future], future.result())


# --- figures ----------------------------------------------------------------------------------------------------------
# What the operating system says of this process.


try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]


def peak_mb() -> float:
    """Return the most memory that this process has had, in MB; 0 where nobody says."""
    if resource is None:
        return 0.0
    peak = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


# --- names ------------------------------------------------------------------------------------------------------------
# Are there the components and losses that expectations and anchors name? One that is configured and that nobody watched
# in the run is no mistake of the file: its expectation is VACUOUS.


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
        if not name or name in seen or (pattern.failure and name in LOSSES):
            continue
        known = [*configured(), *sorted(seen)]
        if name not in known:
            kind = "component" if pattern.component else "component and no loss"
            right = meant(name, [*known, *(LOSSES if pattern.failure else ())])
            raise ReplayError(f"{where}: there is no {kind} {name}; {right}")


def _patterns(case: Case) -> Iterator[Tuple[str, Pattern]]:
    for expectation in case.expectations:
        for _, pattern in expectation.patterns:
            yield expectation.where, pattern
    for anchor in case.anchors:
        if anchor.what is not None:
            yield f"{place_of(case.path, ('anchors', anchor.name))}", anchor.what


# --- anchors ----------------------------------------------------------------------------------------------------------
# When the named instants of a scenario happened in a run.


def anchor_times(anchors: Iterable[Anchor], trace: Trace) -> Dict[str, Optional[int]]:
    """Return the time of each anchor; None: it did not happen."""
    return {anchor.name: _time(anchor, trace) for anchor in anchors}


def _time(anchor: Anchor, trace: Trace) -> Optional[int]:
    times = _times(anchor, trace)
    if len(times) < anchor.occurrence:
        return None
    return times[anchor.occurrence - 1] + anchor.delay_ns


def _times(anchor: Anchor, trace: Trace) -> Sequence[int]:
    if anchor.at_ns is not None:
        t_ns = trace.start_ns + anchor.at_ns
        return (t_ns,) if t_ns >= trace.begin_ns else ()
    if anchor.fault:
        began = trace.faults[anchor.fault - 1] if anchor.fault <= len(trace.faults) else None
        return () if began is None else (began,)
    if anchor.what is not None:
        return instants(anchor.what, trace)
    return _crossings(anchor, trace.readings.get(anchor.value, ()))


def _crossings(anchor: Anchor, values: Tuple[Tuple[int, float], ...]) -> List[int]:
    """Return when a value went over the level; where it began beyond it, it has not crossed it."""
    beyond: Iterator[Tuple[int, bool]] = (
        (t_ns, value > anchor.above if anchor.above is not None else value < (anchor.below or 0.0))
        for t_ns, value in values
    )
    found: List[int] = []
    before = True
    for t_ns, now in beyond:
        if now and not before:
            found.append(t_ns)
        before = now
    return found
