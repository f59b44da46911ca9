"""What a replay still has to do, in the order (time, rank, order of entry)."""

from __future__ import annotations

import heapq
from typing import Callable, List, Optional, Tuple

Task = Callable[[int], None]


class Rank:
    """Ranks among equal times, after the topics of the recording, which rank by their place in the map.

    A process that starts comes before them: it hears what is said at that time.
    """

    START = -1
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


class Turns:
    """The turns of a loop at a fixed period, of which those are left out at which nothing can come of it.

    Args:
        first_ns: time of the first turn.
        period_ns: from turn to turn.
    """

    def __init__(self, first_ns: int, period_ns: int) -> None:
        self.first_ns, self.period_ns = first_ns, period_ns
        self._made = -1

    def after(self, t_ns: int) -> int:
        """Return the time of the first turn after a time."""
        return max(self.first_ns, self.first_ns + ((t_ns - self.first_ns) // self.period_ns + 1) * self.period_ns)

    def left_out(self, t_ns: int) -> int:
        """Return how many turns were left out since the last one that was made; the one at this time is made."""
        turn = (t_ns - self.first_ns) // self.period_ns
        left_out, self._made = turn - self._made - 1, turn
        return left_out


class Agenda:
    """Tasks by time.

    Attributes:
        next: time and rank of the next task; None when there is none.
    """

    def __init__(self) -> None:
        self._tasks: List[Tuple[int, int, int, Task]] = []
        self._entered = 0
        self.next: Optional[Tuple[int, int]] = None

    def at(self, t_ns: int, rank: int, task: Task) -> None:
        """Enter a task; it is called with its time."""
        heapq.heappush(self._tasks, (t_ns, rank, self._entered, task))
        self._entered += 1
        self.next = self._tasks[0][:2]

    def run(self) -> None:
        """Run the next task."""
        t_ns, _, _, task = heapq.heappop(self._tasks)
        self.next = self._tasks[0][:2] if self._tasks else None
        task(t_ns)
