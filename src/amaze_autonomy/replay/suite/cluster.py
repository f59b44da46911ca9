"""Tasks on several machines, by a Dask scheduler; the results are in the order of the tasks, as they always are."""

from __future__ import annotations

import uuid
from dataclasses import replace
from typing import Any, Callable, Dict, Optional, Sequence, Tuple

from amaze_autonomy.config.errors import ConfigError

from ..errors import ReplayError
from .fetch import data_folder, fetch_bags
from .result import Result
from .run import run_task
from .task import Task

__all__ = ["run_on_cluster", "run_remotely"]

_CONNECT_S = 10


def run_remotely(task: Task, url: str) -> Result:
    """Run one task where its bags may have to be fetched; it never raises. Called by a worker."""
    with data_folder(url):
        try:
            if url:
                fetch_bags(task, url)
        except (ReplayError, ConfigError, OSError) as error:
            task = replace(task, error=str(error))
        return run_task(task)


def run_on_cluster(
    address: str, tasks: Sequence[Task], url: str = "", told: Optional[Callable[[Result], None]] = None
) -> Tuple[Tuple[Result, ...], int]:
    """Run all tasks, the longest first; return the results, and how many workers there were.

    Args:
        address: of the scheduler, e.g. "tcp://10.0.0.5:8786".
        tasks: in the order of the results. Their files are read by the workers: they need the same paths.
        url: of the bags; empty: their paths are those of the scenarios.
        told: called with each result in the order of the tasks, as soon as all before it are there.

    Raises:
        ReplayError: there is no scheduler, or no worker, or distributed is not installed.
    """
    tell = told or (lambda _: None)
    client, completed = _connected(address)
    with client:
        workers: int = sum(client.ncores().values())
        if not workers:
            raise ReplayError(f"{address}: the scheduler has no workers; start some with `dask worker {address}`")
        run = uuid.uuid4().hex
        order = sorted(range(len(tasks)), key=lambda number: (-tasks[number].weight, number))
        futures = {
            client.submit(run_remotely, tasks[number], url, key=f"amaze-{run}-{number}", pure=False, priority=-place): (
                number
            )
            for place, number in enumerate(order)
        }
        results: Dict[int, Result] = {}
        shown = 0
        for future in completed(futures):
            results[futures[future]] = _result(future, tasks[futures[future]])
            while shown in results:
                tell(results[shown])
                shown += 1
    return tuple(results[number] for number in range(len(tasks))), workers


def _result(future: Any, task: Task) -> Result:
    error = future.exception()
    if error is None:
        result: Result = future.result()
        return result
    words = " ".join(str(error).split()) or type(error).__name__
    return run_task(replace(task, error=f"its worker could not run it: {words}"))


def _connected(address: str) -> Tuple[Any, Any]:
    try:
        from distributed import Client, as_completed  # noqa: PLC0415  (an extra)
    except ImportError:
        raise ReplayError("--dask needs distributed: pip install 'amaze_autonomy[cluster]'") from None
    try:
        return Client(address, timeout=_CONNECT_S), as_completed
    except (OSError, ValueError) as error:
        words = " ".join(str(error).split()) or type(error).__name__
        raise ReplayError(f"{address}: no scheduler answers ({words}); start one with `dask scheduler`") from error
