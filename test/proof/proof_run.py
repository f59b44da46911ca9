"""The proof as a whole: every world explored, what was reached, every defect caught."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import Pool
from typing import Any, Callable, Dict, Iterator, List, Optional, Set, Tuple

from proof_defects import DEFECTS, Caught, caught_by
from proof_explorer import Broken, Stats, explore
from proof_liveness import loops
from proof_worlds import WORLDS

from amaze_autonomy.engine.failsafe import FAILSAFE_CONDITIONS
from amaze_autonomy.engine.state import State
from amaze_autonomy.engine.transitions import STEPS as PLACES
from amaze_autonomy.engine.transitions import TRANSITIONS
from amaze_autonomy.laws import LAWS

BOUND, LARGE = 6_000, 400_000
"""Transitions after which a world begins no further layer: in CI, and on demand."""

STEPS, SEED = 200_000, 1
"""Of the induction in CI; on demand any number, with any seed."""

_OF_FAILURES = (
    "failure_continue",
    "failure_wait",
    "failure_land",
    "failure_pilot",
    "failure_back",
    "flown_without",
)
_VERBS = {
    "gps": ("continue", "land"),
    "barometer": ("wait", "continue", "land"),
    "lrf": ("wait", "land"),
    "imu": ("land",),
    "stranger": ("wait", "land"),
}
_NEVER_LANDED_FOR = ("tilt_warning", "position_unknown", "recorder_dead", "landing_detection")


@dataclass(frozen=True)
class Coverage:
    """What must be reached: rows of the transition table, failures with their verbs, places."""

    rules: Set[str]
    failures: Set[Tuple[str, str]]
    places: Set[Tuple[str, str]]


def expected_coverage() -> Coverage:
    """Return every transition row, every row of the decision table with each of its verbs, every place."""
    failures = {(name, action) for name, verbs in _VERBS.items() for action in verbs}
    failures |= {(row.name, "continue" if row.name in _NEVER_LANDED_FOR else "land") for row in FAILSAFE_CONDITIONS}
    failures |= {("user_hold", "wait"), ("lrf", "pilot")}
    places = {(state.value, step.value) for state in PLACES for step in PLACES[state]}
    places |= {(state.value, "") for state in State if state not in PLACES} - {("READY", "")}
    return Coverage({*(row.rule for row in TRANSITIONS), *_OF_FAILURES}, failures, places)


@dataclass
class Proof:
    """What came of it."""

    stats: Dict[str, Stats] = field(default_factory=dict)
    broken: Dict[str, Broken] = field(default_factory=dict)

    @property
    def reached(self) -> Coverage:
        """Return what all worlds together have reached."""
        found = Coverage(set(), set(), set())
        for stats in self.stats.values():
            found.rules.update(stats.rules)
            found.failures.update(stats.failures)
            found.places.update(stats.places)
        return found

    @property
    def missing(self) -> List[str]:
        """Return what should have been reached and was not."""
        expected, reached = expected_coverage(), self.reached
        words = sorted(expected.rules - reached.rules)
        words += [f"{name} -> {action}" for name, action in sorted(expected.failures - reached.failures)]
        return words + [f"{state} {step}".strip() for state, step in sorted(expected.places - reached.places)]

    @property
    def applied(self) -> Dict[str, int]:
        """Return how often each law had something to say."""
        counts = dict.fromkeys(LAWS, 0)
        for stats in self.stats.values():
            for name, count in stats.applied.items():
                counts[name] += count
        return counts


def explored(work: Tuple[str, int]) -> Tuple[str, Stats, Optional[Broken]]:
    """Explore one world up to a bound; return its name, what was counted, and what is broken."""
    name, bound = work
    found = explore(WORLDS[name], bound)
    stuck = loops(found) if found.broken is None else []
    broken = found.broken
    if stuck:
        broken = Broken("no_loop_without_progress", "time goes round", found.path(stuck[0]))
    return name, found.stats, broken


def prove(bound: int, tell: Callable[[str, Stats], None] = lambda *_: None, jobs: int = 1) -> Proof:
    """Explore every world up to a bound; the processes take whole worlds, so their number changes nothing."""
    proof, works = Proof(), [(name, bound) for name in WORLDS]
    with in_processes(jobs) as each:
        for name, stats, broken in each(explored, works):
            proof.stats[name] = stats
            if broken is not None:
                proof.broken[name] = broken
            tell(name, stats)
    return proof


def _tested(number: int) -> Optional[Caught]:
    return caught_by(DEFECTS[number])


def self_test(
    tell: Callable[[str, Optional[Caught]], None] = lambda *_: None, jobs: int = 1
) -> Dict[str, Optional[Caught]]:
    """Put in every defect, one after the other; return what caught each."""
    found = {}
    with in_processes(jobs) as each:
        for defect, caught in zip(DEFECTS, each(_tested, range(len(DEFECTS)))):
            found[defect.words] = caught
            tell(defect.words, caught)
    return found


@contextmanager
def in_processes(jobs: int) -> Iterator[Callable[..., Iterator[Any]]]:
    """Give a `map` that works in so many processes, in order; one: in this one."""
    if jobs == 1:
        yield map
        return
    with Pool(jobs) as pool:
        yield pool.imap
