"""What a replay still has to do, in the order (time, rank, order of entry)."""

from __future__ import annotations

import heapq
from typing import Callable, List, Optional, Tuple

__all__ = ["Agenda", "Rank", "Task"]

Task = Callable[[int], None]


class Rank:
    """Ranks among equal times, after the topics of the recording, which rank by their place in the map."""

    WATCHDOG = 10_001
    LANDING = 10_002
    AUTOPILOT = 10_003
    PLANNER = 10_004
    RECORDER = 10_005
    STATE = 10_006
    LOG = 10_010
    REPLY = 20_000
    USER = 20_001
    TICK = 30_000


class Agenda:
    """Tasks by time."""

    def __init__(self) -> None:
        self._tasks: List[Tuple[int, int, int, Task]] = []
        self._entered = 0

    def at(self, t_ns: int, rank: int, task: Task) -> None:
        """Enter a task; it is called with its time."""
        heapq.heappush(self._tasks, (t_ns, rank, self._entered, task))
        self._entered += 1

    def every(self, first_ns: int, period_ns: int, rank: int, task: Task) -> None:
        """Enter a task that comes again."""

        def again(t_ns: int) -> None:
            task(t_ns)
            self.at(t_ns + period_ns, rank, again)

        self.at(first_ns, rank, again)

    @property
    def next(self) -> Optional[Tuple[int, int]]:
        """Time and rank of the next task; None when there is none."""
        return self._tasks[0][:2] if self._tasks else None

    def run(self) -> None:
        """Run the next task."""
        t_ns, _, _, task = heapq.heappop(self._tasks)
        task(t_ns)
