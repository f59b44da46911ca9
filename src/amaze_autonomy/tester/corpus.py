"""A whole corpus of flights: its bags are looked through first, then all its tests run, and the time is told."""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import sys
import threading
import time
import uuid
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Tuple

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import MEMORY
from amaze_autonomy.bags.other_formats import content_files
from amaze_autonomy.bags.recover.scan import scan
from amaze_autonomy.config.errors import ConfigError
from amaze_autonomy.files import check_output, sha256_of, write_whole

from ..paths import expanded
from ..replay.errors import ReplayError
from .run import DIED, run_task, run_tasks, spread
from .scenario import Case, load_cases
from .task import NOT_COMPARED, RESULTS, Figures, Result, Task, Verdict, as_json, exit_status, result_lines
from .terminal import (
    add_choice,
    add_configuration,
    add_tapes,
    check_options,
    chosen,
    options_of,
    progress_bar,
    show_lines,
    use_tapes,
)


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


def examined(bags: Sequence[Path], jobs: int = 1, memory: int = MEMORY) -> Tuple[str, ...]:
    """Look for damage in bags, as `amaze-bag doctor` does; return a line for each thing that is wrong."""
    if jobs <= 1 or len(bags) <= 1:
        return tuple(line for bag in bags for line in _examined(bag, memory))
    looked = partial(_examined, memory=memory)
    found = spread(looked, bags, jobs, lambda bag: [f"{bag}: the process that looked through it {DIED}"])
    return tuple(line for lines in found for line in lines)


def _examined(bag: Path, memory: int) -> List[str]:
    try:
        found = scan(bag, check_data=True, memory=memory)
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


# --- cli corpus -------------------------------------------------------------------------------------------------------
# `amaze-replay corpus`: all flights that a team has, on all processors or machines that it has.


_STARTED = '{"version": 1, "verdict": "ERROR", "headline": "the run has not ended"}\n'


def add_corpus(commands: Any) -> None:
    """Add the verb to the command line."""
    corpus = commands.add_parser("corpus", help="look through all bags of scenarios, run all, tell the time")
    add_choice(corpus)
    add_configuration(corpus)
    corpus.add_argument("-j", "--jobs", type=int, default=0, metavar="N", help="processes; 0 (default): one each core")
    corpus.add_argument("--dask", default="", metavar="tcp://HOST:PORT", help="run on the workers of this scheduler")
    words = "where ${AMAZE_DATA} of the scenarios is: any URL that fsspec reads; bags are fetched and kept"
    corpus.add_argument("--data", default="", metavar="URL", help=words)
    add_tapes(corpus)
    corpus.add_argument("--no-doctor", action="store_true", help="do not look through the bags first")
    corpus.add_argument("--no-goldens", action="store_true", help="judge the expectations alone")
    corpus.add_argument("-v", "--verbose", action="store_true", help="print every expectation with its margin")
    corpus.add_argument(
        "--json", type=expanded, metavar="FILE", help="write the results; ERROR until the run has ended"
    )
    corpus.set_defaults(command=_corpus)


def _corpus(options: argparse.Namespace) -> int:
    use_tapes(options)
    check_output(options.json, "--json", RESULTS, options.paths)
    if options.json is not None:
        write_whole(options.json, _STARTED)
    goldens = not (options.no_goldens or options.config or options.set)
    jobs = options.jobs or os.cpu_count() or 1
    with data_folder(options.data):
        tasks = chosen(options, options_of(options, goldens=goldens))
        check_options(options_of(options), tasks)
        if options.data and not options.dask:
            tasks = _fetched(tasks, options.data)
        if not (options.no_doctor or options.dask):  # the bags need not be on this machine
            show_lines([f"damaged: {line}" for line in examined(bags_of(tasks), jobs, options.memory)])
        began = time.perf_counter()
        results, workers = _run(tasks, options, jobs)
    wall_s = time.perf_counter() - began
    show_lines([_summary(results) + ("" if goldens or options.no_goldens else NOT_COMPARED)])
    sys.stderr.write("".join(f"{line}\n" for line in time_table(results, wall_s, workers)))
    if options.json is not None:
        write_whole(options.json, as_json(results, wall_s=wall_s, workers=workers))
    return exit_status(result.verdict for result in results)


def _run(tasks: Sequence[Task], options: argparse.Namespace, jobs: int) -> Tuple[Tuple[Result, ...], int]:
    shown: List[Result] = []
    with progress_bar("running") as progress:

        def tell(result: Result) -> None:
            shown.append(result)
            show_lines(result_lines(result, verbose=options.verbose))
            sys.stdout.flush()
            progress(len(shown), len(tasks))

        if options.dask:
            return run_on_cluster(options.dask, tasks, options.data, tell)
        return run_tasks(tasks, jobs, tell), min(jobs, max(1, len(tasks)))


def _fetched(tasks: Sequence[Task], url: str) -> Tuple[Task, ...]:
    """Return the tasks, with their bags here; the weight is known only now."""
    found = []
    for task in tasks:
        try:
            fetch_bags(task, url)
            size = sum(bag.stat().st_size for bag in bags_of([task])) / 1e6
            found.append(replace(task, weight=max(task.weight, size)))
        except (ReplayError, ConfigError, OSError) as error:
            found.append(replace(task, error=str(error)))
    return tuple(found)


def _summary(results: Sequence[Result]) -> str:
    """Return how many tests have which verdict; without times, so that it is the same with any number of processes."""
    counts = {verdict: sum(result.verdict is verdict for result in results) for verdict in Verdict}
    said = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count) or "no tests"
    return f"{said}; {sum(result.figures.flown_s for result in results):.0f} s of flight"


# --- cluster ----------------------------------------------------------------------------------------------------------
# Tasks on several machines, by a Dask scheduler; the results are in the order of the tasks, as they always are.


_CONNECT_S = 10
_alone = threading.Lock()  # the folder of the bags is a variable of the process, and a worker may have several threads


def run_remotely(task: Task, url: str) -> Result:
    """Run one task where its bags may have to be fetched, one at a time in a process; it never raises.

    Called by a worker.
    """
    with _alone, data_folder(url):
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


# --- fetch ------------------------------------------------------------------------------------------------------------
# Bags of scenarios that lie elsewhere: fetched once, from any URL that fsspec reads, and kept.
#
# Scenarios name such bags by `${AMAZE_DATA}/...`; what stands behind that name is looked up below the URL. A bag
# whose SHA-256 the scenario says is fetched again when what was kept is another one.


VARIABLE = "AMAZE_DATA"
_BLOCK = 1 << 20


def kept_in(url: str) -> Path:
    """Return the folder in which bags of a URL are kept."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "amaze-replay" / hashlib.sha256(url.encode()).hexdigest()[:16]


@contextmanager
def data_folder(url: str) -> Iterator[None]:
    """Let scenarios find bags of a URL where they are kept; empty: leave all as it is."""
    if not url:
        yield
        return
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(kept_in(url))
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def fetch_bags(task: Task, url: str) -> None:
    """Fetch the bags of a task that are not here yet; call it within `data_folder`.

    Raises:
        ReplayError: one cannot be fetched.
        ConfigError: the scenario has a mistake.
    """
    cases = [] if task.error else load_cases(Path(task.path))
    for case in cases:
        if case.variant == task.variant:
            _fetch_bags(case, url)


def _fetch_bags(case: Case, url: str) -> None:
    folder = kept_in(url)
    for bag in case.bags:
        if folder not in bag.path.parents:
            continue
        if _is_kept(bag.path, bag.sha256):
            continue
        inside = bag.path.relative_to(folder)
        place = bag.path.parent.resolve()  # of a bag that is a link the link itself is replaced
        if ".." in inside.parts or folder.resolve() not in (place, *place.parents):
            words = "leads out of the folder of bags that are fetched"
            raise ReplayError(f"{bag.path}: {words}; name a bag below ${{{VARIABLE}}}, without ..")
        _fetch(f"{url.rstrip('/')}/{inside.as_posix()}", bag.path, bag.sha256)


def _is_kept(path: Path, sha256: str) -> bool:
    return path.exists() and (not sha256 or sha256_of(*content_files(path)) == sha256)


def _fetch(url: str, path: Path, sha256: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{uuid.uuid4().hex}.part")
    try:
        with _opened(url) as source, part.open("wb") as target:
            shutil.copyfileobj(source, target, _BLOCK)
            target.flush()
            os.fsync(target.fileno())
        _check_content(url, part, sha256)
        part.replace(path)
    except Exception as error:
        part.unlink(missing_ok=True)
        if isinstance(error, ReplayError):
            raise
        words = " ".join(str(error).split()) or type(error).__name__
        raise ReplayError(f"{url}: cannot be fetched ({words}); is the address right?") from error


def _check_content(url: str, path: Path, sha256: str) -> None:
    if sha256 and sha256_of(path) != sha256:
        raise ReplayError(f"{url}: is another file than the scenario was written for (sha256 differs)")


def _opened(url: str) -> Any:
    try:
        import fsspec  # noqa: PLC0415  (an extra)
    except ImportError:
        raise ReplayError(f"{url}: URLs need fsspec: pip install 'amaze_autonomy[cluster]'") from None
    return fsspec.open(url, "rb")
