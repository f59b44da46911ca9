"""The messages of one topic as arrays, for those who take many at once."""

from __future__ import annotations

from typing import Any, List, Optional, Tuple

__all__ = ["Track"]


class Track:
    """Times and numbers of all messages of a topic, in their order.

    Args:
        times: of the messages in nanoseconds, an array that never falls.
        columns: one array for each number that is read.
    """

    def __init__(self, times: Any, columns: Tuple[Any, ...] = ()) -> None:
        self.times, self.columns = times, columns
        self._listed: Optional[List[int]] = None

    def __len__(self) -> int:
        """Return how many messages there are."""
        return len(self.times)

    @property
    def listed(self) -> List[int]:
        """The times as Python's numbers."""
        if self._listed is None:
            self._listed = self.times.tolist()
        return self._listed

    def part(self, begin: int, end: int) -> Track:
        """Return the same messages with some of the columns."""
        part = Track(self.times, self.columns[begin:end])
        part._listed = self.listed
        return part

    def rows(self, begin: int, end: int) -> List[Tuple[Any, ...]]:
        """Return the numbers of some messages, as Python's."""
        return list(zip(*(column[begin:end].tolist() for column in self.columns)))
