"""One group of topics on one platform: its recorder's processes, one after the other, and what they prove.

Where a recorder ended or stopped to write while it should record, there is a gap: from the last growth of its files to
the next, or to the end of the recording.
"""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Tuple

from .sight import GroupSight

__all__ = ["Gap", "Group"]

_S = 1_000_000_000
_AGAIN_NS = 1 * _S  # between two starts of a recorder that dies at once
_START_NS = 5 * _S  # a process that was asked for is there by then
_HEAD_BYTES = 4200  # of an empty bag
_FLUSH_BYTES = 1 << 20  # what may still reach the disk after a recorder stopped to write

_FULL = "the storage was full"

Gap = Dict[str, Any]


class Group:
    """One group.

    Args:
        name: of the group.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.number = 0
        self.running = self.writes = False
        self.dropped = 0
        self.gaps: List[Gap] = []
        self._sight = GroupSight(running=False)
        self._asked_ns: Optional[int] = None
        self._ended_ns: Optional[int] = None
        self._born_size: Optional[int] = None
        self._grew_ns: Optional[int] = None
        self._gap_ns: Optional[int] = None
        self._full_size = 0
        self._told = self._taken_over = False

    def begin(self) -> None:
        """Forget the last recorder: a recording begins, or goes on."""
        self._asked_ns = self._ended_ns = self._gap_ns = self._grew_ns = None
        self.writes = False

    def end(self, t_ns: int) -> None:
        """Take notice that the recording ends: so does a gap."""
        self._close_gap(t_ns)

    def take_number(self, t_ns: int) -> int:
        """Return the number of the next file; a recorder for it is started now."""
        self.number += 1
        self._asked_ns, self._born_size, self.writes = t_ns, None, False
        return self.number

    def stop_for_space(self, t_ns: int) -> bool:
        """Return whether its recorder is to be ended because the storage is full: asked once."""
        told, self._told = self._told, self.running
        if told or not self.running:
            return False
        if self._gap_ns is None:
            self._open_gap(t_ns, _FULL, self.number + 1)
        return True

    def wants_child(self, t_ns: int) -> bool:
        """Return whether a recorder is to be started: none is there, and none is on its way."""
        if self.running:
            return False
        if self._asked_ns is None:
            return True
        return t_ns - self._asked_ns >= (_AGAIN_NS if self._ended_ns is not None else _START_NS)

    def see(self, t_ns: int, sight: GroupSight, *, writing: bool) -> None:
        """Take what is seen of it; `writing`: it shall record."""
        before, self._sight = self._sight, sight
        if sight.size > before.size:
            self._grew_ns = t_ns if not self._taken_over or sight.idle_ns is None else t_ns - sight.idle_ns
            self._taken_over = False
        if self.running and not sight.running:
            self._died(t_ns, writing=writing)
        elif writing and sight.full and not before.full and self._gap_ns is None:
            self._full_size = sight.size
            self._open_gap(t_ns, _FULL, self.number)
            self.gaps[-1]["inside"] = True
        if sight.running and self._born_size is None:
            self._came(t_ns, sight.size)
        self.running = sight.running
        self.dropped = max(self.dropped, sight.dropped)
        self._see_writing(t_ns, sight)

    def _see_writing(self, t_ns: int, sight: GroupSight) -> None:
        if self._born_size is not None and sight.size - self._born_size > _HEAD_BYTES:
            if not self.writes or (self._full_size and sight.size - self._full_size > _FLUSH_BYTES):
                self._close_gap(t_ns)
            self.writes = True

    def _came(self, t_ns: int, size: int) -> None:
        if self._asked_ns is None:  # it was there before this process
            self._asked_ns = t_ns
        self._born_size, self._ended_ns = size, None

    def _died(self, t_ns: int, *, writing: bool) -> None:
        self._ended_ns, self._born_size, self.writes = t_ns, None, False
        if writing and self._gap_ns is None:
            self._open_gap(t_ns, self._sight.ending or "it ended", self.number + 1)
        self._told = False

    def _open_gap(self, t_ns: int, ending: str, number: int) -> None:
        self._gap_ns = t_ns if self._grew_ns is None else self._grew_ns
        self.gaps.append({"group": self.name, "file": number, "seconds": 0.0, "ending": ending})

    def _close_gap(self, t_ns: int) -> None:
        if self._gap_ns is not None:
            self.gaps[-1]["seconds"] = (t_ns - self._gap_ns) / _S
        self._gap_ns, self._full_size = None, 0

    @property
    def proven(self) -> bool:
        """Return whether it records, or would if anybody published what it is subscribed to."""
        return self.running and self._sight.missing == () and (self.writes or self._sight.silent)

    def troubles(self, *, writing: bool) -> List[str]:
        """Return what is wrong with it, one line each."""
        found = [self._trouble()] if writing and self._trouble() else []
        closed = self.gaps[:-1] if self._gap_ns is not None else self.gaps
        if closed:
            times = "once" if len(closed) == 1 else f"{len(closed)} times"
            lost_s = sum(each["seconds"] for each in closed)
            found.append(f"{self.name}: its recording was interrupted {times}, {lost_s:.1f} s are missing")
        if self.dropped:
            found.append(f"{self.name}: messages were dropped, at least {self.dropped}")
        return found

    def _trouble(self) -> str:
        """Return why it does not record now; an empty text when it does."""
        sight = self._sight
        rows: Tuple[Tuple[bool, str], ...] = (
            (not self.running and self._ended_ns is not None, f"its recorder ended ({sight.ending or 'it ended'})"),
            (not self.running, "its recorder has not started yet"),
            (bool(self._full_size), "its recorder stopped to write: the storage is full"),
            (bool(sight.missing), f"not subscribed to {', '.join(sight.missing or ())}"),
            (sight.missing is None, "the master does not say what is subscribed"),
            (sight.silent, "nobody publishes its topics"),
            (not self.writes, "nothing is written yet"),
        )
        return next((f"{self.name}: {words}" for wrong, words in rows if wrong), "")

    def memory(self) -> Dict[str, Any]:
        """Return what must outlive the process."""
        return {"number": self.number, "dropped": self.dropped, "gaps": [dict(each) for each in self.gaps]}

    @classmethod
    def of_memory(cls, name: str, memory: Mapping[str, Any], *, writing: bool) -> Group:
        """Return a group as another process left it."""
        group = cls(name)
        group.number, group.dropped = int(memory["number"]), int(memory["dropped"])
        group.gaps = [dict(each) for each in memory["gaps"]]
        group.running = writing  # if it is not any more, that is seen
        group._taken_over = True  # nobody saw when its files grew last; they know
        return group
