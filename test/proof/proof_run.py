"""The proof as a whole: every world explored, what was reached, every defect caught."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Callable, Dict, List, Optional, Set, Tuple

from proof_defects import DEFECTS, Caught, caught_by
from proof_explorer import Broken, Exploration, Stats, explore
from proof_liveness import loops
from proof_worlds import WORLDS

from amaze_autonomy.engine.rules import LOSSES
from amaze_autonomy.engine.state import State
from amaze_autonomy.engine.transitions import STEPS, TRANSITIONS
from amaze_autonomy.laws import LAWS

__all__ = ["BOUND", "LARGE", "Coverage", "Proof", "expected_coverage", "prove", "self_test"]

BOUND, LARGE = 6_000, 400_000
"""Transitions after which a world begins no further layer: in CI, and on demand."""

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
_NEVER_LANDED_FOR = ("position_unknown", "recorder_dead", "landing_detection")


@dataclass(frozen=True)
class Coverage:
    """What must be reached: rows of the transition table, failures with their verbs, places."""

    rules: Set[str]
    failures: Set[Tuple[str, str]]
    places: Set[Tuple[str, str]]


def expected_coverage() -> Coverage:
    """Return every transition row, every row of the decision table with each of its verbs, every place."""
    failures = {(name, verb) for name, verbs in _VERBS.items() for verb in verbs}
    failures |= {(loss.name, "continue" if loss.name in _NEVER_LANDED_FOR else "land") for loss in LOSSES}
    failures |= {("user_hold", "wait"), ("lrf", "pilot")}
    places = {(state.value, step.value) for state in STEPS for step in STEPS[state]}
    places |= {(state.value, "") for state in State if state not in STEPS} - {("READY", "")}
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
        words += [f"{name} -> {verb}" for name, verb in sorted(expected.failures - reached.failures)]
        return words + [f"{state} {step}".strip() for state, step in sorted(expected.places - reached.places)]

    @property
    def applied(self) -> Dict[str, int]:
        """Return how often each law had something to say."""
        counts = dict.fromkeys(LAWS, 0)
        for stats in self.stats.values():
            for name, count in stats.applied.items():
                counts[name] += count
        return counts


def prove(bound: int, tell: Callable[[str, Exploration], None] = lambda *_: None) -> Proof:
    """Explore every world up to a bound."""
    proof = Proof()
    for name, world in WORLDS.items():
        found = explore(world, bound)
        proof.stats[name] = found.stats
        stuck = loops(found) if found.broken is None else []
        if found.broken is not None:
            proof.broken[name] = found.broken
        elif stuck:
            proof.broken[name] = Broken("no_loop_without_progress", "time goes round", found.path(stuck[0]))
        tell(name, found)
    return proof


def self_test(tell: Callable[[str, Optional[Caught]], None] = lambda *_: None) -> Dict[str, Optional[Caught]]:
    """Put in every defect, one after the other; return what caught each."""
    found = {}
    for defect in DEFECTS:
        found[defect.words] = caught_by(defect)
        tell(defect.words, found[defect.words])
    return found
