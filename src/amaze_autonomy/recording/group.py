"""One group of topics on one platform: its recorder's processes, one after the other, and what they prove."""

from __future__ import annotations

from typing import Any, Dict, List, Mapping, Optional, Tuple

from .sight import GroupSight

__all__ = ["Gap", "Group"]

_S = 1_000_000_000
_AGAIN_NS = 1 * _S  # between two starts of a recorder that dies at once
_START_NS = 5 * _S  # a process that was asked for is there by then
_HEAD_BYTES = 4200  # of an empty bag

Gap = Dict[str, Any]


class Group:
    """One group.

    Args:
        name: of the group.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.number = 0
        self.running = False
        self.dropped = 0
        self.gaps: List[Gap] = []
        self._asked_ns: Optional[int] = None
        self._born_size: Optional[int] = None
        self._silent = False
        self._missing: Optional[Tuple[str, ...]] = None
        self._full = False
        self._ended_ns: Optional[int] = None
        self._ending = ""
        self.writes = False

    def begin(self) -> None:
        """Forget the last recorder: a recording begins, or goes on."""
        self._asked_ns = self._ended_ns = None
        self.writes = False

    def take_number(self, t_ns: int) -> int:
        """Return the number of the next file; a recorder for it is started now."""
        self.number += 1
        self._asked_ns, self._born_size, self.writes = t_ns, None, False
        return self.number

    def wants_child(self, t_ns: int, *, room: bool) -> bool:
        """Return whether a recorder is to be started: none is there, none is on its way, and there is room for it."""
        if self.running:
            return False
        if self._asked_ns is None:
            return True
        return room and t_ns - self._asked_ns >= (_AGAIN_NS if self._ended_ns is not None else _START_NS)

    def see(self, t_ns: int, sight: GroupSight) -> None:
        """Take what is seen of it."""
        if self.running and not sight.running:
            self._died(t_ns, sight)
        if sight.running and self._born_size is None:
            self._came(t_ns, sight)
        self.running, self._full = sight.running, sight.full
        self.dropped = max(self.dropped, sight.dropped)
        self._missing, self._silent = sight.missing, sight.silent
        if self._born_size is not None and sight.size - self._born_size > _HEAD_BYTES:
            self.writes = True

    def _came(self, t_ns: int, sight: GroupSight) -> None:
        if self._asked_ns is None:  # it was there before this process
            self._asked_ns = t_ns
        self._born_size = sight.size
        if self._ended_ns is not None:
            self.gaps.append(
                {
                    "group": self.name,
                    "file": self.number,
                    "seconds": (t_ns - self._ended_ns) / _S,
                    "ending": self._ending,
                }
            )
        self._ended_ns = None

    def _died(self, t_ns: int, sight: GroupSight) -> None:
        self._ended_ns, self._ending = t_ns, sight.ending or "it ended"
        self._born_size, self.writes = None, False

    @property
    def proven(self) -> bool:
        """Return whether it records, or would if anybody published what it is subscribed to."""
        return self.running and self._missing == () and (self.writes or self._silent)

    def troubles(self, *, writing: bool) -> List[str]:
        """Return what is wrong with it, one line each."""
        found = []
        if writing and not self.running and self._ended_ns is not None:
            found.append(f"{self.name}: its recorder ended ({self._ending})")
        elif writing and not self.running:
            found.append(f"{self.name}: its recorder has not started yet")
        elif writing and self._full:
            found.append(f"{self.name}: its recorder stopped to write: the storage is full")
        elif writing and self._missing:
            found.append(f"{self.name}: not subscribed to {', '.join(self._missing)}")
        elif writing and self._missing is None:
            found.append(f"{self.name}: the master does not say what is subscribed")
        elif writing and self._silent:
            found.append(f"{self.name}: nobody publishes its topics")
        elif writing and not self.writes:
            found.append(f"{self.name}: nothing is written yet")
        if self.gaps:
            lost_s = sum(each["seconds"] for each in self.gaps)
            found.append(
                f"{self.name}: its recorder was started again {len(self.gaps)} times, {lost_s:.1f} s are missing"
            )
        if self.dropped:
            found.append(f"{self.name}: messages were dropped, {self.dropped} warnings")
        return found

    def memory(self) -> Dict[str, Any]:
        """Return what must outlive the process."""
        return {"number": self.number, "dropped": self.dropped, "gaps": self.gaps}

    @classmethod
    def of_memory(cls, name: str, memory: Mapping[str, Any], *, writing: bool) -> Group:
        """Return a group as another process left it."""
        group = cls(name)
        group.number, group.dropped = int(memory["number"]), int(memory["dropped"])
        group.gaps = [dict(each) for each in memory["gaps"]]
        group.running = writing  # if it is not any more, that is seen
        return group
