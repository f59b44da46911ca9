"""A campaign: a sample of mutants, shown to each net, two at a time, each in a copy of the repository.

Every look is kept as soon as it is over, so that a campaign can be ended and gone on with. What was caught stays caught
as long as engine and monitors are the same; what survived, as long as the tests are the same too.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Callable, Counter, Dict, Iterable, Iterator, List, NamedTuple, Sequence, Tuple

from mutation_code import mutated, span
from mutation_mutant import EXPLORER, MUTATED, SCENARIOS, UNIT, Mutant
from mutation_nets import FIRST_BOUNDS, IMPORTS, MOST_S, PATHS, START_S, TIMES, Look, Seen, look, observe, start
from mutation_results import RESULTS, Results, read, waivers

COPIED = (
    "README.md",
    "config",
    "docs",
    "launch",
    "msg",
    "package.xml",
    "pyproject.toml",
    "setup.py",
    "src",
    "srv",
    "test",
)
WALL_TIMES = 10  # on a machine with other work
"""After which a look that sleeps, or waits, is over; a working one ends by the processor time that it has used."""
FIRST = {EXPLORER: 1000, UNIT: 15, SCENARIOS: 6}
"""So many look first: to load fewer files of tests is faster, and most mutants are caught by then."""
_POLL_S = 0.02


Tell = Callable[["Task", str], None]


class Task(NamedTuple):
    """A mutant and the net that it is shown to."""

    mutant: Mutant
    net: str


class Running(NamedTuple):
    """A look that is not over, and what has not looked yet."""

    task: Task
    tree: Path
    since: float
    rest: Tuple[str, ...]
    limit_s: int = 0


def fingerprint(root: Path, folders: Iterable[str]) -> str:
    """Return a digest of code, rules, journals and accepted figures in some folders."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in [root / folder, *sorted((root / folder).rglob("*"))]:
            if path.suffix in {".py", ".yaml", ".json", ".jsonl"} and path.is_file():
                digest.update(f"{path.relative_to(root)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


class Campaign:
    """What is known of each mutant, and how more is found out.

    Args:
        root: of the repository, which is copied at once: it may change while the campaign goes on.
        work: folder for what was found out so far. The copies lie elsewhere: ROS looks for launch files in all that is
            below a package.
        jobs: looks at a time.
    """

    def __init__(self, root: Path, work: Path, jobs: int) -> None:
        work.mkdir(parents=True, exist_ok=True)
        self._copies = Path(tempfile.mkdtemp(prefix="mutants-"))
        self.root, self.work = self._copies / "original", work
        self._copy(root, self.root)
        files = (path for folder in MUTATED for path in (self.root / folder).rglob("*.py"))
        names = sorted(str(path.relative_to(self.root)) for path in files)
        self.code = {name: fingerprint(self.root, [name]) for name in names}
        self.tests = {net: fingerprint(self.root, paths) for net, paths in PATHS.items()}
        self._seen = {net: fingerprint(self.root, (*MUTATED, *paths)) for net, paths in PATHS.items()}
        self.trees = [self._copies / f"copy{number}" for number in range(jobs)]
        self.observed: Dict[str, Dict[str, Seen]] = {}
        self.catchers: Counter[Tuple[str, str]] = Counter()
        kept = self.root / "test" / "mutation" / RESULTS.name
        self._told = read(kept) if kept.is_file() else Results(0, 0, {}, ())
        self._before = {(one.mutant.key, net): by for one in self._told.verdicts for net, by in one.caught_by.items()}
        self.known = dict(self._read())

    def _read(self) -> Iterator[Tuple[Tuple[str, str], str]]:
        """Return what counts still: of a file as it is now, caught, or survived what looks at it today."""
        path, now = self.work / "looks.jsonl", frozenset(self.code.values())
        for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
            one = json.loads(line)
            if one["code"] in now and (one["caught_by"] or one["tests"] == self.tests[one["net"]]):
                yield (one["key"], one["net"]), one["caught_by"]
        yield from self._kept()

    def _kept(self) -> Iterator[Tuple[Tuple[str, str], str]]:
        """Return what counts still of the campaign that the repository keeps: begun elsewhere, it goes on here."""
        told = self._told
        for one in told.verdicts:
            name = one.mutant.place.path
            if name in self.code and told.code.get(name) == self.code[name]:
                for net, caught in one.caught_by.items():
                    if caught or told.tests.get(net) == self.tests[net]:
                        yield (one.mutant.key, net), caught

    def _keep(self, task: Task, caught_by: str) -> None:
        self.known[task.mutant.key, task.net] = caught_by
        self.catchers[task.mutant.place.path, caught_by] += bool(caught_by)
        of = {"code": self.code[task.mutant.place.path], "tests": self.tests[task.net]}
        one = {"key": task.mutant.key, "net": task.net, "caught_by": caught_by, **of}
        with (self.work / "looks.jsonl").open("a", encoding="utf-8") as out:
            out.write(json.dumps(one) + "\n")

    def run(self, mutants: Sequence[Mutant], nets: Sequence[str], tell: Tell) -> None:
        """Show every mutant to every net that does not know it: first what nobody has caught, last what is waived."""
        tasks = [Task(mutant, net) for mutant in mutants for net in nets if (mutant.key, net) not in self.known]
        if not tasks:
            return
        caught, waived = {key for (key, _), by in self.known.items() if by}, waivers()
        last = {one.key for one in mutants if (one.place.path, one.before, one.after) in waived}
        tasks.sort(key=lambda task: 2 if task.mutant.key in last else task.mutant.key in caught)
        self._prepare({task.net for task in tasks})
        free = list(self.trees)
        running: Dict[int, Running] = {}
        tasks.reverse()
        with _ended_with_us(running):
            while tasks or running:
                while tasks and free:
                    self._begin(tasks.pop(), free, running, tell)
                self._end_one(free, running, tell)

    def close(self) -> None:
        """Remove the copies."""
        shutil.rmtree(self._copies, ignore_errors=True)

    def _prepare(self, nets: Iterable[str]) -> None:
        """Make the copies, and observe in the first one what runs what: nothing may fail there."""
        self._copy(self.root, self.trees[0])
        for net in sorted(nets):
            kept = self.work / f"observed-{net}-{self._seen[net]}.json"
            if not kept.exists():
                process = start(self.trees[0], lambda net=net: observe(net), self.work / "answer.json")  # type: ignore[misc]
                with _ended_with_us([process]):
                    _, status = os.waitpid(process, 0)
                answer = self.work / "answer.json"
                if status or not isinstance(json.loads(answer.read_text(encoding="utf-8")), dict):
                    raise SystemExit(f"{net}: not green without a mutant, see {answer.with_suffix('.log')}")
                answer.rename(kept)
            found = json.loads(kept.read_text(encoding="utf-8"))
            self.observed[net] = {name: Seen(*seen) for name, seen in found.items()}
        for tree in self.trees[1:]:
            self._copy(self.trees[0], tree)

    @staticmethod
    def _copy(origin: Path, tree: Path) -> None:
        shutil.rmtree(tree, ignore_errors=True)
        tree.mkdir(parents=True)
        for name in COPIED:
            if (origin / name).is_dir():
                shutil.copytree(origin / name, tree / name, symlinks=True)
            elif (origin / name).exists():
                shutil.copy2(origin / name, tree / name)

    def names(self, task: Task) -> Tuple[str, ...]:
        """Return the worlds, tests or scenarios that run a mutant's statement, the most promising first.

        Where none of them does, all: what runs at the import alone, as that which makes a table, is run by each. Tests
        and scenarios may run it in a process of its own, too; of a file of which no world runs anything, none will.
        """
        path, line = task.mutant.place.path, task.mutant.place.line
        if not self._runs(task.net, path):
            return ()
        begin, end = span((self.root / path).read_text(encoding="utf-8"), line)

        def runs(each: Seen) -> bool:
            return not begin or any(begin <= number <= end for number in each.lines.get(path, ()))

        seen = dict(self.observed[task.net])
        imported = seen.pop(IMPORTS, None)
        names = [name for name, each in seen.items() if runs(each)]
        never = imported is not None and not runs(imported) and not any(path in each.lines for each in seen.values())
        if task.net == EXPLORER and never:
            return ()
        first = self._caught_before(task)
        rank = {name: (name != first, -self.catchers[path, name], seen[name].seconds) for name in names or seen}
        return tuple(sorted(rank, key=lambda name: rank[name]))

    def _caught_before(self, task: Task) -> str:
        """Return which world, test or scenario has caught it in the campaign that is kept, of whatever code."""
        by = self._before.get((task.mutant.key, task.net), "")
        return by.rpartition("(")[2].rstrip(")") if task.net == EXPLORER else by

    def _runs(self, net: str, path: str) -> bool:
        """Tell whether a net runs anything in the folder of a file: a table there may be what it goes by."""
        folder = path.rpartition("/")[0]
        observed = (each.lines for name, each in self.observed[net].items() if name != IMPORTS)
        return any(each.rpartition("/")[0] == folder for lines in observed for each in lines)

    def files(self, nets: Iterable[str]) -> Dict[str, List[str]]:
        """Return of each net the files of which it runs a function."""
        found: Dict[str, List[str]] = {}
        for net in nets:
            kept = self.work / f"observed-{net}-{self._seen[net]}.json"
            seen = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
            found[net] = sorted({path for name, (_, lines) in seen.items() if name != IMPORTS for path in lines})
        return found

    def _begin(self, task: Task, free: List[Path], running: Dict[int, Running], tell: Tell) -> None:
        """Put a mutant into a copy, and have the first look at it."""
        names = self.names(task)
        if not names:
            self._keep(task, "")
            tell(task, "")
            return
        tree, place = free.pop(), task.mutant.place
        path = tree / place.path
        path.write_text(mutated((self.root / place.path).read_text(encoding="utf-8"), place), encoding="utf-8")
        for cached in path.parent.glob(f"__pycache__/{path.stem}.*"):
            cached.unlink()
        self._look(Running(task, tree, 0.0, names), running)

    def _look(self, over: Running, running: Dict[int, Running]) -> None:
        """Have the next ones look: first what has caught it before, or a few that promise most, then all the others."""
        task, tree, since, rest, _ = over
        count, alone = len(rest) if since else FIRST[task.net], not since and rest[0] == self._caught_before(task)
        if alone:
            count = 1
        usual_s = sum(self.observed[task.net][name].seconds for name in rest[:count])
        limit_s = min(MOST_S, START_S + round(TIMES * usual_s))
        answer = tree / "answer.json"
        if answer.exists():
            answer.unlink()
        survived = self._before.get((task.mutant.key, task.net)) == ""  # it will most likely again, at any bound
        one = Look(task.net, rest[:count], () if survived else FIRST_BOUNDS)
        process = start(tree, lambda: look(one), answer, limit_s)
        again = alone and task.net == EXPLORER  # what is reached is asked of all worlds together
        running[process] = Running(task, tree, time.monotonic(), rest if again else rest[count:], limit_s)

    def _end_one(self, free: List[Path], running: Dict[int, Running], tell: Tell) -> None:
        """Wait until a look is over, or takes too long."""
        while running:
            for process, look_ in list(running.items()):
                late = time.monotonic() - look_.since > WALL_TIMES * look_.limit_s
                if late:
                    os.killpg(process, signal.SIGKILL)
                ended, status = os.waitpid(process, 0 if late else os.WNOHANG)
                if not ended:
                    continue
                del running[process]
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process, signal.SIGKILL)  # what it may have started
                caught_by = _caught_by(status, look_.tree / "answer.json")
                if not caught_by and look_.rest:
                    self._look(look_, running)
                    continue
                place = look_.task.mutant.place
                shutil.copy2(self.root / place.path, look_.tree / place.path)
                self._keep(look_.task, caught_by)
                tell(look_.task, caught_by)
                free.append(look_.tree)
                return
            time.sleep(_POLL_S)


@contextlib.contextmanager
def _ended_with_us(processes: Iterable[int]) -> Iterator[None]:
    """End what is still at work when this process is told to end."""
    before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        yield
    except BaseException:
        for process in processes:
            os.killpg(process, signal.SIGKILL)
        raise
    finally:
        signal.signal(signal.SIGTERM, before)


def _caught_by(status: int, answer: Path) -> str:
    if not status:
        found: str = json.loads(answer.read_text(encoding="utf-8"))
        return found
    if os.WIFSIGNALED(status):
        number = signal.Signals(os.WTERMSIG(status))
        return "time-out" if number in {signal.SIGXCPU, signal.SIGKILL} else f"signal {number.name}"
    return f"exit status {os.WEXITSTATUS(status)}"
