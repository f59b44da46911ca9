"""Runs one task: plays the case, judges its expectations, compares it with its golden, and gives the verdict."""

from __future__ import annotations

import hashlib
import time
import traceback
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import List, Optional, Sequence, Tuple

from amaze_autonomy.bags.errors import BagError, MessageError
from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.engine.journal import JournalError, encode_decision
from amaze_autonomy.simulation.errors import SimulationError

from ..errors import DamagedInputError, NoMessagesError, ReplayError, TimeJumpError
from ..expect import Finding, Grade, judge
from ..golden import compare_with_golden
from ..lawful import broken_words, laws_of_lines
from ..scenario import Case, load_cases
from .anchors import anchor_times
from .figures import peak_mb
from .names import check_names
from .play import play
from .played import Played, configuration_of
from .result import Figures, Result, Verdict
from .task import Task

__all__ = ["case_of", "digest_of", "run_case", "run_task"]

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
            return case
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
    unlawful = tuple(broken_words(each, lawful.start_ns) for each in lawful.judged.broken)
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
        story=played.lines if task.options.story else (),
        marks=played.marks,
        start_ns=trace.start_ns,
        command=command_of(task),
        tags=case.tags,
        requirements=case.requirements,
        figures=Figures(flown_s=trace.seconds(trace.end_ns)),
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
    if difference:
        return Verdict.FAIL, difference[0]
    if not findings and not golden:
        return Verdict.VACUOUS, "it has no expectations, and no golden is compared: nothing was judged"
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
