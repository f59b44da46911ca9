"""Do files grow, and how fast: sizes in, a rate and the time of the last growth out."""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Tuple

__all__ = ["Growth"]

_S = 1_000_000_000


class Growth:
    """Follows one size in bytes.

    Args:
        window_ns: over which the rate is taken.
    """

    def __init__(self, window_ns: int = 3 * _S) -> None:
        self._window_ns = window_ns
        self._seen: Deque[Tuple[int, int]] = deque()
        self.size = 0
        self.grew_ns: Optional[int] = None

    def add(self, t_ns: int, size: int) -> None:
        """Take a size."""
        if size > self.size:
            self.grew_ns = t_ns
        self.size = size
        self._seen.append((t_ns, size))
        while len(self._seen) > 1 and t_ns - self._seen[0][0] > self._window_ns:
            self._seen.popleft()

    def grows(self, t_ns: int, limit_ns: int) -> bool:
        """Return whether it grew within the limit."""
        return self.grew_ns is not None and t_ns - self.grew_ns <= limit_ns

    @property
    def rate(self) -> float:
        """Return bytes per second over the window; 0 when nothing is known yet."""
        (first_ns, first), (last_ns, last) = (self._seen[0], self._seen[-1]) if self._seen else ((0, 0), (0, 0))
        return max(0, last - first) * _S / (last_ns - first_ns) if last_ns > first_ns else 0.0
