"""The nets: what looks at a mutated copy of the repository, each look in a process of its own.

The explorer is the proof's: every world up to a bound, its laws, and that everything was reached. Unit tests and
scenarios are pytest's. `observe` notes which lines of the engine and the monitors each world, test and scenario runs,
so that a mutant is shown only to those that run its function: the others cannot tell it from the original.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Sequence, Tuple

import coverage
import pytest
from mutation_mutant import EXPLORER, MUTATED, SCENARIOS, UNIT

_PROOF = Path(__file__).resolve().parents[1] / "proof"
_SAID = ("proof_journal.py", "proof_pages.py", "proof_stories.py")
PATHS = {
    EXPLORER: (
        "test/proof/accepted.json",
        *(f"test/proof/{path.name}" for path in sorted(_PROOF.glob("proof_*.py")) if path.name not in _SAID),
    ),
    UNIT: ("test/engine", "test/journal", "test/monitoring", "test/test_documents.py"),
    SCENARIOS: ("test/scenarios",),
}
"""Of each net its files, from the root of the repository; of the proof what explores, and not what tells of it."""
FIRST_BOUNDS = (300, 1_500)
"""Transitions in each world before the bound of the proof: most mutants are caught by then."""
_PYTEST = ("-x", "-q", "-W", "ignore::pytest.PytestAssertRewriteWarning")
TIMES, START_S, MOST_S, MEMORY_LIMIT = 10, 30, 900, 3 << 30
"""A mutant is noticed that needs ten times the processor time of the original, and a start, or a quarter of an hour:
all worlds of the explorer need two minutes and a half, and twice that beside other work."""

IMPORTS = ""
"""Among what was observed: what ran beside all worlds, tests and scenarios."""


class Look(NamedTuple):
    """One process: a net, which of its worlds or tests, in order (none: all); with which bounds a world begins."""

    net: str
    names: Tuple[str, ...]
    bounds: Tuple[int, ...] = FIRST_BOUNDS


class Seen(NamedTuple):
    """What a world, test or scenario runs: seconds that it takes, lines of each file."""

    seconds: float
    lines: Dict[str, List[int]]


def start(tree: Path, job: Callable[[], object], answer: Path, limit_s: int = 0) -> int:
    """Start a job in a process of its own, in a copy of the repository; return its process id. It writes its answer.

    Args:
        tree: the copy.
        job: what returns the answer.
        answer: the file for it.
        limit_s: of processor time; 0: none, for the original.
    """
    process = os.fork()
    if process:
        return process
    status = 1
    try:
        os.setpgid(0, 0)
        with answer.with_suffix(".log").open("w", encoding="utf-8") as log:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
        _settle(tree, limit_s)
        answer.write_text(json.dumps(job()), encoding="utf-8")
        status = 0
    except BaseException as error:  # noqa: BLE001 - the answer of a process that is about to end
        answer.write_text(json.dumps(f"{type(error).__name__}: {error}"[:300]), encoding="utf-8")
        status = 0
    finally:
        os._exit(status)


def _settle(tree: Path, limit_s: int) -> None:
    """Let this process see the copy, and nothing but the copy."""
    if limit_s:
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT, MEMORY_LIMIT))
    os.chdir(tree)
    os.environ.update(HYPOTHESIS_PROFILE="mutants", PYTHONPATH=str(tree / "src"))
    sys.path[:0] = [str(tree / "src")]
    sys.dont_write_bytecode = bool(limit_s)  # without a limit it is the original, whose byte code the others take
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def look(which: Look) -> str:
    """Return what notices that something is wrong; empty: nothing does."""
    if which.net == EXPLORER:
        return _explored(which)
    watch = _Watch(which.names)
    status = pytest.main([*_PYTEST, "--tb=no", *watch.paths(PATHS[which.net])], [watch])
    if status in {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}:
        return ""
    return watch.failed or f"pytest: {pytest.ExitCode(status).name}"


class _Watch:
    """A plugin: which tests, in which order, and which failed first."""

    def __init__(self, names: Sequence[str]) -> None:
        self.order = {name: number for number, name in enumerate(names)}
        self.failed = ""

    def paths(self, folders: Sequence[str]) -> Sequence[str]:
        """Return the files to collect, or the folders."""
        return sorted({name.partition("::")[0] for name in self.order}) or folders

    def pytest_collection_modifyitems(self, config: Any, items: List[Any]) -> None:
        if self.order:
            kept = [item for item in items if item.nodeid in self.order]
            config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in self.order])
            items[:] = sorted(kept, key=lambda item: self.order[item.nodeid])

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = report.nodeid

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and not self.failed:
            self.failed = f"{report.nodeid} (not even collected)"


def _proof() -> Any:
    """Import the explorer of the copy; the worlds are the proof's."""
    sys.path[:0] = [str(Path("test/proof").resolve()), str(Path("test/engine").resolve())]
    import mutation_explorer  # noqa: PLC0415 - it imports the engine, of the copy

    return mutation_explorer


def _explored(which: Look) -> str:
    found: str = _proof().broken(which.names, which.bounds)
    return found


def observe(net: str) -> Dict[str, Seen]:
    """Return what each world, test or scenario runs. All must be content with what is not mutated."""
    cover = coverage.Coverage(data_file=None, source=[*MUTATED])
    seconds: Dict[str, float] = {}

    @contextmanager
    def context(name: str) -> Iterator[None]:
        cover.switch_context(name)
        began = time.process_time()
        yield
        seconds[name] = time.process_time() - began
        cover.switch_context("")

    cover.start()
    if net == EXPLORER:
        _proof().each_world(context, FIRST_BOUNDS[-1])
    else:
        noted = _Noted(context)
        status = pytest.main([*_PYTEST, "--tb=short", *PATHS[net]], [noted])
        if status != pytest.ExitCode.OK:
            raise SystemError(f"{net}: not green without a mutant: {noted.failed}")
    cover.stop()
    return _seen(cover, seconds)


class _Noted(_Watch):
    """A plugin: each test is a context of the measurement."""

    def __init__(self, context: Callable[[str], Any]) -> None:
        super().__init__(())
        self.context = context

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Any:
        with self.context(item.nodeid):
            return (yield)


def _seen(cover: Any, seconds: Dict[str, float]) -> Dict[str, Seen]:
    data, here = cover.get_data(), f"{Path.cwd()}/"
    lines: Dict[str, Dict[str, List[int]]] = {name: {} for name in (*seconds, IMPORTS)}
    for path in sorted(data.measured_files()):
        for line, contexts in data.contexts_by_lineno(path).items():
            for name in contexts:
                if name in lines:
                    lines[name].setdefault(path.replace(here, "", 1), []).append(line)
    return {name: Seen(seconds.get(name, 0.0), lines[name]) for name in lines}
