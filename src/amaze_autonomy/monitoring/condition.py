"""How well one source of a component does: its level, why, and until when that stands."""

from __future__ import annotations

import abc
import enum
from typing import NamedTuple, Optional

FOREVER_NS = 2**63 - 1
_S = 1_000_000_000


class Level(enum.IntEnum):
    """How well a source does. Ordered: the worst counts."""

    GOOD = 0
    STARTING = 1  # too early to tell
    OFF = 2  # works, but not as intended
    FAILED = 3


class Condition(NamedTuple):
    """The verdict on one source.

    Args:
        level: how well it does.
        reason: why it is not good; the same text for as long as the verdict stands.
        value: what was measured, in `unit`; None when unknown.
        limit: what it was compared with, in `unit`.
        unit: e.g. "Hz", "s"; empty when it has none.
        age_ns: age of what was looked at; None when there never was anything.
        changes_at_ns: when the verdict can change if nothing else arrives; FOREVER_NS: never.
        other_limit: the other end, where the value must lie between two limits; `limit` is the one that is nearer.
    """

    level: Level
    reason: str = ""
    value: Optional[float] = None
    limit: Optional[float] = None
    unit: str = ""
    age_ns: Optional[int] = None
    changes_at_ns: int = FOREVER_NS
    other_limit: Optional[float] = None


class Source(abc.ABC):
    """Base of everything that is watched: it knows since when, and how long it may take to come up."""

    def __init__(self) -> None:
        self._grace_end_ns: Optional[int] = None

    def start(self, t_ns: int, grace_ns: int) -> None:
        """Begin to watch; until `grace_ns` later, what has not come yet is starting, not failed."""
        self._grace_end_ns = t_ns + grace_ns

    @abc.abstractmethod
    def evaluate(self, t_ns: int) -> Condition:
        """Return the verdict at a time."""

    def _absent(self, t_ns: int, missing: str) -> Condition:
        """Return the verdict on a source that has never been heard of."""
        if self._in_time(t_ns):
            changes_at_ns = FOREVER_NS if self._grace_end_ns is None else self._grace_end_ns
            return Condition(Level.STARTING, f"{missing} yet", changes_at_ns=changes_at_ns)
        return Condition(Level.FAILED, f"{missing} since the start")

    def _in_time(self, t_ns: int) -> bool:
        """Return True while something may still come up: the watching has not begun, or not for long."""
        return self._grace_end_ns is None or t_ns < self._grace_end_ns


def seconds(time_ns: int) -> str:
    """Return a time for a person, e.g. "0.5 s"."""
    return f"{time_ns / _S:.3g} s"
