"""What if: the same scenarios by two configurations, and one scenario with its fault at every moment."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase, digits
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence, Tuple

from amaze_autonomy.config.document import read
from amaze_autonomy.engine.commands import Decision

from ..replay.changed_keys import written
from ..replay.errors import DamagedInputError, ReplayError
from .difference import align, first_difference, told
from .golden import decisions_of
from .play import Played, play
from .run import run_tasks
from .scenario import Case
from .scenario.model import CONFIGURATION
from .task import EXIT_STATUS, Options, Result, Task, Verdict

# --- another configuration --------------------------------------------------------------------------------------------


_MOTIONS = ("TAKEOFF", "HOLD", "RESUME", "LAND", "ABORT", "AutopilotLand")


@dataclass(frozen=True)
class Fork:
    """One scenario by two configurations.

    Args:
        one: by its own configuration.
        other: by the other one.
        difference: lines, the first different decision on top; empty: the same decisions.
        ends: how it ends by each, when that differs; None: it ends alike.
    """

    one: Result
    other: Result
    difference: Tuple[str, ...]
    ends: Optional[Tuple[str, str]]

    @property
    def unread(self) -> Tuple[Tuple[str, str], ...]:
        """Keys of the other configuration that nothing looked at in this flight, each with its reason."""
        own = {key for key, _ in self.one.unread}
        return tuple((key, reason) for key, reason in self.other.unread if key not in own)


def other_options(options: Options, against: str) -> Options:
    """Return the options of the other configuration.

    Args:
        options: of the first one.
        against: a folder, a YAML file with `folder` and `set`, or "file.key=value" on top of the first.

    Raises:
        ConfigError: the first mistake in the file.
    """
    path = Path(against)
    if path.is_file():
        said = CONFIGURATION.read(read(path), (), {})
        folder = options.configuration if said["folder"] is None else str(path.parent / said["folder"])
        given = tuple(f"{key}={written(value)}" for key, value in (said["set"] or {}).items())
        given = (*options.overrides, *given)
        return replace(options, configuration=folder, overrides=given, before=options.configuration, compared=True)
    if "=" in against and not path.is_dir():
        return replace(options, overrides=(*options.overrides, against))
    return replace(options, configuration=against, before=options.configuration, compared=True)


def what_if(tasks: Sequence[Task], against: str, jobs: int = 1) -> Tuple[Fork, ...]:
    """Run tasks by their own configuration and by another one.

    Args:
        tasks: goldens are not looked at.
        against: folder of the other configuration, or an override.
        jobs: processes.
    """
    ours = [replace(task, options=replace(task.options, goldens=False)) for task in tasks]
    theirs = [replace(task, options=other_options(task.options, against)) for task in ours]
    results = run_tasks([*ours, *theirs], jobs)
    return tuple(_fork(one, other) for one, other in zip(results[: len(ours)], results[len(ours) :]))


def _fork(one: Result, other: Result) -> Fork:
    before, after = decisions_of(one.lines), decisions_of(other.lines)
    changes = align(before, after)
    if first_difference(changes) is None or _broken(one, other) is not None:
        return Fork(one, other, (), None)
    ends = (ending(before), ending(after))
    return Fork(one, other, told(changes, one.start_ns, other.command, "before"), None if ends[0] == ends[1] else ends)


def _broken(*results: Result) -> Optional[Result]:
    """Return the first run that says nothing: it could not be run, or what was put in is missing or damaged."""
    silent = (Verdict.ERROR, Verdict.INCONCLUSIVE)
    return next((each for each in results if each.verdict in silent and not each.lines), None)


def what_if_status(forks: Sequence[Fork]) -> int:
    """Return the exit status: 1 different, or it cannot be run; 4 keys were not looked at; 3 a bag is not whole."""
    broken = [each.verdict for each in (_broken(fork.one, fork.other) for fork in forks) if each is not None]
    if any(fork.difference for fork in forks) or Verdict.ERROR in broken:
        return 1
    if any(fork.unread for fork in forks):
        return EXIT_STATUS[Verdict.VACUOUS]
    verdicts = [each.verdict for fork in forks for each in (fork.one, fork.other)]
    return EXIT_STATUS[Verdict.INCONCLUSIVE] if Verdict.INCONCLUSIVE in verdicts else 0


def motions(decisions: Sequence[Decision]) -> Tuple[str, ...]:
    """Return what was commanded of the vehicle, in order; what is repeated in a row is said once."""
    said: List[str] = []
    for decision in decisions:
        for command in decision.commands:
            name, _, rest = command.partition("#")[0].partition("(")
            word = rest[:-1] if name == "MissionCommand" else name
            if word in _MOTIONS and (not said or said[-1] != word):
                said.append(word)
    return tuple(said)


def ending(decisions: Sequence[Decision]) -> str:
    """Return how a flight ends: the motions, and the last state."""
    last = decisions[-1].after if decisions else "MISSION_INPUT"
    return " ".join((*motions(decisions), last))


def what_if_lines(forks: Sequence[Fork]) -> List[str]:
    """Return what would be different, for a person: flights that end differently first."""
    lines: List[str] = []
    for fork in sorted(forks, key=lambda fork: fork.ends is None):
        broken = _broken(fork.one, fork.other)
        if broken is not None:
            lines.append(f"CANNOT       {fork.one.id}: {broken.headline}")
        elif fork.ends is not None:
            lines.append(f"ENDS OTHERWISE  {fork.one.id}: {fork.ends[0]}  ->  {fork.ends[1]}")
            lines += [f"    {line}" for line in fork.difference]
        elif fork.difference:
            lines.append(f"DECIDES OTHERWISE  {fork.one.id}: {fork.difference[0]}")
        elif fork.one.verdict is Verdict.INCONCLUSIVE:
            lines.append(f"DAMAGED      {fork.one.id}: {fork.one.headline}")
    lines += [f"NOT LOOKED AT  {fork.one.id}: {key}: {reason}" for fork in forks for key, reason in fork.unread]
    ends = sum(fork.ends is not None for fork in forks)
    others = sum(bool(fork.difference) for fork in forks) - ends
    cannot = sum(_broken(fork.one, fork.other) is not None for fork in forks)
    blind = sum(bool(fork.unread) for fork in forks)
    said = f", {cannot} cannot be run" if cannot else ""
    said += f", {blind} did not look at every key" if blind else ""
    return [*lines, f"{len(forks)} flights: {ends} end otherwise, {others} decide otherwise and end alike{said}"]


# --- another moment of a fault ----------------------------------------------------------------------------------------


_S = 1_000_000_000
NOTHING = "the fault did nothing: it never began, or it touched nothing"
_LETTERS = ascii_uppercase + ascii_lowercase + digits


@dataclass(frozen=True)
class Boundary:
    """Between two times of the fault the outcome changes.

    Args:
        after_s: the last time with the outcome before.
        before_s: the first time with the outcome after it.
        outcomes: before and after.
    """

    after_s: float
    before_s: float
    outcomes: Tuple[str, str]


@dataclass(frozen=True)
class Flight:
    """One run, as it is drawn.

    Args:
        t_s: time of the fault that was asked for.
        began_s: when it began in the flight; None: it did not.
        outcome: the motions that were commanded; NOTHING where the fault did not begin or touched nothing.
        states: (begin and end in seconds, state), in order.
    """

    t_s: float
    began_s: Optional[float]
    outcome: str
    states: Tuple[Tuple[float, float, str], ...]


@dataclass(frozen=True)
class Sweep:
    """What came of a sweep.

    Args:
        fault: in words.
        clock: what the times count from, in words.
        points: (time in seconds, outcome), in order.
        boundaries: between them.
        flights: of the grid and of the search for boundaries, by time.
    """

    fault: str
    clock: str
    points: Tuple[Tuple[float, str], ...]
    boundaries: Tuple[Boundary, ...]
    flights: Tuple[Flight, ...]

    @property
    def runs(self) -> int:
        """How many there were."""
        return len(self.flights)

    @property
    def idle(self) -> int:
        """In how many of them the fault did nothing."""
        return sum(flight.outcome == NOTHING for flight in self.flights)


def sweep(
    case: Case,
    number: int,
    times_s: Sequence[float],
    resolution_s: float = 0.05,
    told: Optional[Callable[[float, str], None]] = None,
) -> Sweep:
    """Run a case with a fault at each time of a grid, and find where the outcome changes by bisection.

    Args:
        case: of a scenario.
        number: of its fault, from 1.
        times_s: of the grid: from the start, or after what the fault waits for.
        resolution_s: of the boundaries.
        told: called with each run.

    Raises:
        ReplayError: there is no such fault, the grid is not one, or the recording is damaged.
    """
    if not 1 <= number <= len(case.faults):
        raise ReplayError(f"{case.path}: there is no fault {number}; it has {len(case.faults)}")
    if len(times_s) < 2 or resolution_s <= 0:  # noqa: PLR2004
        raise ReplayError("a sweep needs two times at least, and a resolution above 0")
    runner = _Runner(case, number, told)
    points = [(t_s, runner.outcome(t_s)) for t_s in times_s]
    boundaries: List[Boundary] = []
    for (t_s, one), (next_s, other) in zip(points, points[1:]):
        boundaries += runner.between(t_s, one, next_s, other, resolution_s)
    trigger = case.faults[number - 1].trigger
    clock = "from the start" if trigger.at_ns is not None else f"after {trigger.event or trigger.state}"
    return Sweep(str(case.faults[number - 1]), clock, tuple(points), tuple(boundaries), runner.flights)


class _Runner:
    """Runs a case with a fault at a time, each time once."""

    def __init__(self, case: Case, number: int, told: Optional[Callable[[float, str], None]]) -> None:
        self._case, self._number, self._told = case, number - 1, told
        self._known: Dict[float, Flight] = {}

    @property
    def flights(self) -> Tuple[Flight, ...]:
        return tuple(flight for _, flight in sorted(self._known.items()))

    def outcome(self, t_s: float) -> str:
        if t_s not in self._known:
            played = play(self._at(t_s), Options())
            if played.broken:
                raise DamagedInputError(f"{self._case.path}: {played.broken[0]}")
            self._known[t_s] = self._flight(t_s, played)
            if self._told is not None:
                self._told(t_s, self._known[t_s].outcome)
        return self._known[t_s].outcome

    def _flight(self, t_s: float, played: Played) -> Flight:
        trace = played.trace
        began_ns = trace.faults[self._number] if self._number < len(trace.faults) else None
        spans = [(trace.seconds(span.begin_ns), trace.seconds(span.end_ns), span.value) for span in trace.states]
        states = tuple((round(begin, 3), round(end, 3), value.split("/")[0]) for begin, end, value in spans)
        began_s = None if began_ns is None else round(trace.seconds(began_ns), 3)
        moved = " ".join(motions(trace.decisions)) or "no motion"
        return Flight(t_s, began_s, NOTHING if self._number in played.idle else moved, states)

    def between(self, t_s: float, one: str, next_s: float, other: str, resolution_s: float) -> List[Boundary]:
        """Return the boundaries between two times; a third outcome in the middle makes two of one."""
        if one == other or NOTHING in (one, other):  # where the fault does nothing the flight is as without it
            return []
        if next_s - t_s <= resolution_s:
            return [Boundary(t_s, next_s, (one, other))]
        middle_s = round((t_s + next_s) / 2, 6)
        middle = self.outcome(middle_s)
        if middle == NOTHING:
            return [Boundary(t_s, next_s, (one, other))]
        left = self.between(t_s, one, middle_s, middle, resolution_s)
        return left + self.between(middle_s, middle, next_s, other, resolution_s)

    def _at(self, t_s: float) -> Case:
        faults = list(self._case.faults)
        trigger, t_ns = faults[self._number].trigger, round(t_s * _S)
        moved = replace(trigger, at_ns=t_ns) if trigger.at_ns is not None else replace(trigger, delay_ns=t_ns)
        faults[self._number] = replace(faults[self._number], trigger=moved)
        return replace(self._case, faults=tuple(faults))


def letters_of(outcomes: Iterable[str]) -> Dict[str, str]:
    """Return a letter for each outcome, in order, and none twice."""
    kinds = [outcome for outcome in dict.fromkeys(outcomes) if outcome != NOTHING]
    beyond = ord("\u0100") - len(_LETTERS)
    found = {outcome: _LETTERS[n] if n < len(_LETTERS) else chr(beyond + n) for n, outcome in enumerate(kinds)}
    return {**found, NOTHING: "-"}


def sweep_status(result: Sweep) -> int:
    """Return the exit status: 4 when the fault did nothing at any time."""
    return EXIT_STATUS[Verdict.VACUOUS] if result.idle == result.runs else 0


def sweep_lines(result: Sweep) -> List[str]:
    """Return the map for a person: a letter for each time, what it means, and the boundaries."""
    outcomes = list(dict.fromkeys(outcome for _, outcome in result.points))
    letters = letters_of(outcomes)
    first, last = result.points[0][0], result.points[-1][0]
    row = "".join(letters[outcome] for _, outcome in result.points)
    lines = [f"{result.fault}, {result.clock}", f"{first:g} s [{row}] {last:g} s"]
    lines += [f"  {letter}  {outcome}" for outcome, letter in letters.items() if outcome in outcomes]
    lines += [
        f"between {each.after_s:.3f} s and {each.before_s:.3f} s: {each.outcomes[0]}  ->  {each.outcomes[1]}"
        for each in result.boundaries
    ]
    idle = f", {result.idle} in which the fault did nothing" if result.idle else ""
    count = len([outcome for outcome in outcomes if outcome != NOTHING])
    return [*lines, f"{result.runs} runs{idle}, {count} outcomes, {len(result.boundaries)} boundaries"]


def sweep_plain(result: Sweep) -> Dict[str, Any]:
    """Return it as JSON values."""
    began_s = {flight.t_s: flight.began_s for flight in result.flights}
    return {
        "fault": result.fault,
        "clock": result.clock,
        "points": [{"t_s": t_s, "began_s": began_s[t_s], "outcome": outcome} for t_s, outcome in result.points],
        "boundaries": [
            {"after_s": each.after_s, "before_s": each.before_s, "outcomes": list(each.outcomes)}
            for each in result.boundaries
        ],
        "runs": result.runs,
        "fault_did_nothing": result.idle,
    }
