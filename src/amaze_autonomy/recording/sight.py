"""What the shell sees of the recorders' processes, their files and the storage."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Mapping, Optional, Tuple

__all__ = ["GroupSight", "Sight", "Space"]


@dataclass(frozen=True)
class Space:
    """The storage: bytes that are free, and as a fraction of all."""

    free_bytes: int
    free_fraction: float


@dataclass(frozen=True)
class GroupSight:
    """One group as it is now.

    Args:
        running: a process of it is there.
        ending: how its last process ended, in words; empty while it runs.
        size: bytes of all its files.
        idle_ns: since something was written to one of them; None: unknown.
        missing: topics that it is not subscribed to; None: the master does not say.
        silent: nobody publishes any of its topics.
        dropped: warnings in its log that messages were dropped.
        full: its log says that it stopped because the storage is full.
    """

    running: bool
    ending: str = ""
    size: int = 0
    idle_ns: Optional[int] = None
    missing: Optional[Tuple[str, ...]] = None
    silent: bool = False
    dropped: int = 0
    full: bool = False


@dataclass(frozen=True)
class Sight:
    """Everything as it is now; `space` is None when the storage cannot be looked at."""

    groups: Mapping[str, GroupSight] = field(default_factory=dict)
    space: Optional[Space] = None
