"""Accepts runs as goldens: with a reason, one after the other, with the difference shown, and never in CI."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, List, Mapping, Optional, Sequence, Tuple

from ...replay.errors import GoldenError
from ..result import Result, Verdict
from ..run import case_of, run_task
from ..scenario import Case
from ..task import Task
from . import check_reason, compare_with_golden, golden_path, orphans, read_golden, write_golden

__all__ = ["Accepted", "accept", "lonely_goldens"]

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
    environment: Optional[Mapping[str, str]] = None,
) -> Accepted:
    """Run tasks, show how each differs from its golden, and make the run the golden.

    Args:
        tasks: of all scenarios to accept.
        reason: why the decisions are right now; it is written into the golden.
        say: takes each line.
        prune: delete goldens that belong to no scenario; for a full run only.
        full: the tasks are all of their folders.
        environment: of the process; None: its own.

    Raises:
        GoldenError: it may not be done here, or not in this way.
    """
    _check(tasks, reason, prune=prune, full=full, environment=environment)
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
        done.append((_accept(case, task, result, reason, say), result.id, ""))
    pruned = _prune(cases, say) if prune and not any(kind == "refused" for kind, _, _ in done) else ()
    names = {kind: tuple(name for each, name, _ in done if each == kind) for kind in ("new", "changed", "unchanged")}
    refused = tuple((name, why) for kind, name, why in done if kind == "refused")
    return Accepted(names["new"], names["changed"], names["unchanged"], pruned, refused)


def lonely_goldens(tasks: Sequence[Task]) -> Tuple[Result, ...]:
    """Return a failed result for each golden that belongs to none of the tasks; for a full run."""
    cases = [case_of(task) for task in tasks if not task.error]
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
    )


def _check(
    tasks: Sequence[Task], reason: str, *, prune: bool, full: bool, environment: Optional[Mapping[str, str]]
) -> None:
    check_reason(reason, "goldens", environment)
    if prune and not full:
        raise GoldenError("--prune deletes goldens of no scenario: give it whole folders, without --tag and --variant")
    for task in tasks:
        if task.options.configuration or task.options.overrides:
            raise GoldenError("a golden is of the scenario's own configuration: leave out --config and --set")
        if task.error:
            raise GoldenError(task.error)


def _refusal(result: Result) -> str:
    """Return why a run cannot be a golden; empty: it can."""
    by_golden_alone = result.verdict is Verdict.VACUOUS and not result.findings and not result.problems
    return "" if result.verdict is Verdict.PASS or by_golden_alone else f"{result.verdict.value}: {result.headline}"


def _accept(case: Case, task: Task, result: Result, reason: str, say: Say) -> str:
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
