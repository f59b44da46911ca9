"""A fault of a scenario that is on a recording: with its time, and the topics that it is about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

from amaze_autonomy.simulation import Fault

__all__ = ["Acting"]


@dataclass(frozen=True)
class Acting:
    """A fault with its time.

    Args:
        fault: of the scenario.
        begin_ns: when it begins.
        end_ns: when it ends; None: at the end of the recording.
        topics: that it is about.
    """

    fault: Fault
    begin_ns: int
    end_ns: Optional[int]
    topics: Tuple[str, ...] = ()

    def holds(self, t_ns: int) -> bool:
        """Tell whether it acts at a time."""
        return self.begin_ns <= t_ns and (self.end_ns is None or t_ns < self.end_ns)
