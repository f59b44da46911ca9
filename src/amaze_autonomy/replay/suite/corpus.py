"""A whole corpus of flights: its bags are looked through first, then all its tests run, and the time is told."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Dict, List, Sequence, Tuple

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.scan import scan
from amaze_autonomy.config.errors import ConfigError

from ..scenario import load_cases
from .result import Figures, Result
from .task import Task

__all__ = ["bags_of", "examined", "time_table"]


def bags_of(tasks: Sequence[Task]) -> Tuple[Path, ...]:
    """Return the bags of all tasks, each once, in the order of the tasks; what cannot be read is left to the run."""
    found: Dict[Path, None] = {}
    for path in dict.fromkeys(task.path for task in tasks if not task.error):
        try:
            cases = load_cases(Path(path))
        except (ConfigError, OSError):
            continue
        for case in cases:
            found.update(dict.fromkeys(bag.path for bag in case.bags if bag.path.suffix == ".bag"))
    return tuple(path for path in found if path.is_file())


def examined(bags: Sequence[Path], jobs: int = 1) -> Tuple[str, ...]:
    """Look for damage in bags, as `amaze-bag doctor` does; return a line for each thing that is wrong."""
    if jobs <= 1 or len(bags) <= 1:
        return tuple(line for bag in bags for line in _examined(bag))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(bags)), mp_context=context) as pool:
        return tuple(line for lines in pool.map(_examined, bags) for line in lines)


def _examined(bag: Path) -> List[str]:
    try:
        found = scan(bag, check_data=True)
    except BagError as error:
        return [str(error)]
    return [f"{bag}: {damage}" for damage in found.damages]


def time_table(results: Sequence[Result], wall_s: float, workers: int) -> List[str]:
    """Return how long each test took, as a table, and how well the processes were used."""
    wide = max([len(result.id) for result in results] + [5])
    lines = [f"{'':<{wide}}  {'flight':>9} {'wall':>9} {'x real time':>11} {'CPU':>9} {'memory':>8}"]
    rows = [(result.id, result.figures) for result in results]
    flown_s, cpu_s = sum(each.flown_s for _, each in rows), sum(each.cpu_s for _, each in rows)
    peak_mb = max([each.peak_mb for _, each in rows] + [0.0])
    for name, each in [*rows, ("all", Figures(flown_s, wall_s, cpu_s, peak_mb))]:
        lines.append(
            f"{name:<{wide}}  {each.flown_s:7.1f} s {each.wall_s:7.2f} s {_factor(each.flown_s, each.wall_s):>11} "
            f"{each.cpu_s:7.2f} s {each.peak_mb:5.0f} MB"
        )
    if workers > 1 and wall_s > 0:
        busy = sum(each.wall_s for _, each in rows) / (workers * wall_s)
        lines.append(f"{workers} processes, busy for {100 * busy:.0f} % of the time")
    return lines


def _factor(flown_s: float, wall_s: float) -> str:
    return f"{flown_s / wall_s:.0f}" if wall_s > 0 else ""
