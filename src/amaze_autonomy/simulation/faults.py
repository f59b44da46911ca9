"""Which faults act now: triggers in, beginnings and endings out."""

from __future__ import annotations

import heapq
from typing import Dict, List, NamedTuple, Optional, Tuple, Union

from .scenario import Fault, Request, Scenario, Trigger

_S = 1_000_000_000

_Item = Union[Fault, Request]


class Change(NamedTuple):
    """A fault that begins or ends, or a user's request that is due.

    Args:
        t_ns: when.
        what: the fault or request.
        begins: false when a fault ends.
        place: of it in the scenario, from 0: all faults, then all requests. Two may be the same in words.
    """

    t_ns: int
    what: _Item
    begins: bool
    place: int


class Faults:
    """Keeps the schedule of a scenario and the faults that act now, in the order of the file."""

    def __init__(self, scenario: Scenario, start_ns: int = 0) -> None:
        self._active: Dict[int, Tuple[Fault, int]] = {}
        self._due: List[Tuple[int, int, Change]] = []
        self._waiting: List[Tuple[int, _Item]] = []
        self._seen: Dict[int, int] = {}
        self._pushed = 0
        self._now_ns = start_ns
        items: Tuple[_Item, ...] = (*scenario.faults, *scenario.requests)
        for serial, item in enumerate(items):
            if item.trigger.at_ns is not None:
                self._push(Change(start_ns + item.trigger.at_ns, item, begins=True, place=serial))
            else:
                self._waiting.append((serial, item))

    @property
    def next_ns(self) -> Optional[int]:
        """Time of the next change that is known of, the turns of what flaps included; None when there is none."""
        times = [self._due[0][0]] if self._due else []
        times += [self._toggles(fault, since) for fault, since in self._active.values() if _flaps(fault)]
        return min(times) if times else None

    @property
    def requests_to_come(self) -> bool:
        """True while a request of the user, or a fault, is on the schedule: it will come whatever happens."""
        return any(change.begins for _, _, change in self._due)

    def observe(self, t_ns: int, *, event: str = "", state: str = "", number: int = 0) -> None:
        """Take notice of an event or a state: what waits for it is put on the schedule."""
        still: List[Tuple[int, _Item]] = []
        for serial, item in self._waiting:
            if not _matches(item.trigger, event, state, number):
                still.append((serial, item))
                continue
            self._seen[serial] = self._seen.get(serial, 0) + 1
            if self._seen[serial] < item.trigger.occurrence:
                still.append((serial, item))
                continue
            self._push(Change(t_ns + item.trigger.delay_ns, item, begins=True, place=serial))
        self._waiting = still

    def advance(self, t_ns: int) -> Tuple[Change, ...]:
        """Return what begins and ends up to a time, in order."""
        self._now_ns = t_ns
        changes: List[Change] = []
        while self._due and self._due[0][0] <= t_ns:
            _, _, change = heapq.heappop(self._due)
            if isinstance(change.what, Fault) and not self._apply(change, change.what):
                continue
            changes.append(change)
        return tuple(changes)

    def end(self, t_ns: int, fault: Fault) -> None:
        """End a fault now, e.g. because what failed was restarted."""
        for serial, (acting, _) in self._active.items():
            if acting is fault:
                self._push(Change(t_ns, fault, begins=False, place=serial))
                return

    def active(self, subject: str, kind: str, target: str = "") -> Optional[Fault]:
        """Return the first fault of a kind that acts now on a target."""
        for fault, _ in self._active.values():
            if fault.kind.name == kind and fault.kind.subject == subject and fault.target == target:
                return fault
        return None

    def on(self, subject: str, target: str) -> Tuple[Tuple[Fault, int], ...]:
        """Return all faults that act now on a target, each with the time at which it began."""
        if not self._active:
            return ()
        return tuple(
            (fault, since)
            for fault, since in self._active.values()
            if fault.kind.subject == subject and fault.target == target
        )

    def _apply(self, change: Change, fault: Fault) -> bool:
        """Make a fault act, or end it; false when it had ended before."""
        if change.begins:
            self._active[change.place] = (fault, change.t_ns)
            self._active = dict(sorted(self._active.items()))
            if fault.for_ns is not None:
                self._push(change._replace(t_ns=change.t_ns + fault.for_ns, begins=False))
            return True
        return self._active.pop(change.place, None) is not None

    def _toggles(self, fault: Fault, since_ns: int) -> int:
        """Return when something that flaps falls silent, or sends again, next."""
        off_ns, on_ns = flapping_ns(fault)
        place = (self._now_ns - since_ns) % (off_ns + on_ns)
        return self._now_ns + (off_ns if place < off_ns else off_ns + on_ns) - place

    def _push(self, change: Change) -> None:
        self._pushed += 1
        heapq.heappush(self._due, (change.t_ns, self._pushed, change))


def _flaps(fault: Fault) -> bool:
    return fault.kind.name == "flapping"


def flapping_ns(fault: Fault) -> Tuple[int, int]:
    """Return how long something that flaps is silent, and how long it sends."""
    return round(fault.number("off_s") * _S), round(fault.number("on_s") * _S)


def _matches(trigger: Trigger, event: str, state: str, number: int) -> bool:
    if trigger.state:
        return trigger.state == state
    return trigger.event == event != "" and trigger.number in (0, number)
