"""One test as a value that can be sent to another process."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Iterable, List, Optional, Tuple

from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.config.errors import ConfigError

from .scenario import find_files, load_cases

__all__ = ["Options", "Task", "tasks_of"]


@dataclass(frozen=True)
class Options:
    """What is asked of a run, for all its tests.

    Args:
        configuration: folder to decide by instead of each scenario's own; empty: its own.
        overrides: "file.key=value" on top of each scenario's own.
        before: folder whose differences from `configuration` are followed; empty: each scenario's own; None: none.
        compared: two configurations are compared, so it is said when the differences cannot be followed.
        goldens: compare with the goldens; False: judge expectations alone.
        story: return the whole journal of each run.
        memory: bytes that a chunk of a bag may take, decompressed.
    """

    configuration: str = ""
    overrides: Tuple[str, ...] = ()
    before: Optional[str] = None
    compared: bool = False
    goldens: bool = True
    story: bool = False
    memory: int = MEMORY


@dataclass(frozen=True)
class Task:
    """One test.

    Args:
        path: of the scenario file.
        variant: of its matrix; empty: it has none.
        options: of the run.
        weight: how long it may take, for the order in which tasks are begun; any unit.
        error: the file cannot be read: why; the result is an ERROR.
    """

    path: str
    variant: str = ""
    options: Options = field(default_factory=Options)
    weight: float = 0.0
    error: str = ""


def tasks_of(paths: Iterable[Path], options: Options = Options(), tags: Tuple[str, ...] = ()) -> Tuple[Task, ...]:  # noqa: B008
    """Return a task for each case of each scenario file; a file with a mistake is one task that will be an ERROR.

    Args:
        paths: of files and folders.
        options: of the run.
        tags: only scenarios that have one of them; empty: all.

    Raises:
        ReplayError: there is no scenario at one of the paths.
    """
    tasks: List[Task] = []
    for path in find_files(paths):
        try:
            cases = load_cases(path)
        except ConfigError as error:
            tasks.append(Task(str(path), options=options, error=str(error)))
            continue
        for case in cases:
            if not tags or any(tag in tags for tag in case.tags):
                weight = sum(bag.path.stat().st_size for bag in case.bags if bag.path.is_file()) / 1e6
                tasks.append(Task(str(path), case.variant, options, weight))
    return tuple(tasks)
