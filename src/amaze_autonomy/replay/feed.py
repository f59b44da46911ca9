"""What every feed does: it takes the messages of a topic, one by one or many at once, and can play it as nominal."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import Any, Tuple

from .tracks import Track

__all__ = ["Feed", "LastCounts"]


class Feed:
    """One use of a topic.

    Args:
        topic: that it takes.
        period_ns: of its messages, for playing it.
        decodes: it looks into the messages.
        paths: of the numbers in them that it looks at; empty: it needs whole messages.
    """

    def __init__(self, topic: str, period_ns: int, *, decodes: bool = True, paths: Tuple[str, ...] = ()) -> None:
        self.topic, self.period_ns, self.decodes, self.paths = topic, period_ns, decodes, paths

    def take(self, t_ns: int, message: Any) -> None:
        """Take a message; `message` is None when the feed does not decode."""
        raise NotImplementedError

    def take_values(self, t_ns: int, values: Tuple[Any, ...]) -> None:
        """Take the numbers at `paths` of a message; does what `take` does with all of it."""
        raise NotImplementedError

    def play(self, t_ns: int) -> None:
        """Take what a good message would have said at a time."""

    # --- many at once -------------------------------------------------------------------------------------------------

    def ride(self, track: Track, rank: int) -> None:
        """Take all messages from a track from now on, when somebody asks; `rank` is that of the topic."""
        self.track, self.rank, self.taken = track, rank, 0

    def until(self, now: Tuple[int, int]) -> None:
        """Take all messages of the track before a time and rank, as if they had come one after the other."""
        listed, begin = self.track.listed, self.taken
        if begin < len(listed) and listed[begin] <= now[0]:
            end = (bisect_right if self.rank < now[1] else bisect_left)(listed, now[0], begin)
            self.taken = max(begin, end)
            self.take_many(begin, self.taken)

    def take_many(self, begin: int, end: int) -> None:
        """Take messages of the track by their places; does what `take_values` does with each of them."""
        for t_ns, values in zip(self.track.listed[begin:end], self.track.rows(begin, end)):
            self.take_values(t_ns, values)


class LastCounts(Feed):
    """A use of a topic for which the last message is all that counts."""

    def take_many(self, begin: int, end: int) -> None:
        """Take the last one."""
        super().take_many(max(begin, end - 1), end)
