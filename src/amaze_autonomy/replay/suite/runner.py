"""Runs tasks one after the other, or in several processes: the results are the same, and in the order of the tasks."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Callable, Dict, List, Optional, Sequence, Set, Tuple

from .result import Result
from .run import run_task
from .task import Task

__all__ = ["run_tasks"]

Told = Callable[[Result], None]


def run_tasks(tasks: Sequence[Task], jobs: int = 1, told: Optional[Told] = None) -> Tuple[Result, ...]:
    """Run all tasks.

    Args:
        tasks: in the order of the results.
        jobs: processes; 1: this one.
        told: called with each result, in the order of the tasks, as soon as all before it are there.
    """
    tell = told or (lambda _: None)
    if jobs <= 1 or len(tasks) <= 1:
        return tuple(_each(task, tell) for task in tasks)
    # spawn: a fork of a process with threads may hang, and a fresh process is the same on every system.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(tasks)), mp_context=context) as pool:
        order = sorted(range(len(tasks)), key=lambda number: (-tasks[number].weight, number))
        running: Dict[Future[Result], int] = {pool.submit(run_task, tasks[number]): number for number in order}
        return tuple(_collected(running, len(tasks), tell))


def _each(task: Task, tell: Told) -> Result:
    result = run_task(task)
    tell(result)
    return result


def _collected(running: Dict[Future[Result], int], count: int, tell: Told) -> List[Result]:
    results: Dict[int, Result] = {}
    shown = 0
    left: Set[Future[Result]] = set(running)
    while left:
        done, left = wait(left, return_when=FIRST_COMPLETED)
        for future in done:
            results[running[future]] = future.result()
        while shown in results:
            tell(results[shown])
            shown += 1
    return [results[number] for number in range(count)]
