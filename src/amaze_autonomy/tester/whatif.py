"""What if: the same scenarios by two configurations; which end differently, and from which decision on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Callable, List, Optional, Sequence, Tuple

from amaze_autonomy.config.document import read
from amaze_autonomy.engine.commands import Decision

from ..replay.changed_keys import written
from .golden import align, decisions_of, first_difference, told
from .result import EXIT_STATUS, Result, Verdict
from .run import run_tasks
from .scenario.schema import CONFIGURATION
from .task import Options, Task

__all__ = ["Fork", "motions", "other_options", "what_if", "what_if_lines", "what_if_status"]

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


def what_if(
    tasks: Sequence[Task], against: str, jobs: int = 1, said: Optional[Callable[[Result], None]] = None
) -> Tuple[Fork, ...]:
    """Run tasks by their own configuration and by another one.

    Args:
        tasks: goldens are not looked at.
        against: folder of the other configuration, or an override.
        jobs: processes.
        said: called with each result.
    """
    ours = [replace(task, options=replace(task.options, goldens=False)) for task in tasks]
    theirs = [replace(task, options=other_options(task.options, against)) for task in ours]
    results = run_tasks([*ours, *theirs], jobs, said)
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
    """Return the exit status: 1 different, or it cannot be run; 4 keys were not looked at; 3 a bag is missing."""
    broken = [each.verdict for each in (_broken(fork.one, fork.other) for fork in forks) if each is not None]
    if any(fork.difference for fork in forks) or Verdict.ERROR in broken:
        return 1
    if any(fork.unread for fork in forks):
        return EXIT_STATUS[Verdict.VACUOUS]
    return EXIT_STATUS[Verdict.INCONCLUSIVE] if broken else 0


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
