"""The messages of a recording with faults in them: each fault is a function from the stream to the stream.

The functions are pure: the same recording, faults and seed give the same stream. What a fault does to a message's
content is an edit that is carried out when the message is read, so that nothing is decoded that nobody looks at.
"""

from __future__ import annotations

from dataclasses import replace
from random import Random
from typing import Any, Callable, Collection, Iterable, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from amaze_autonomy.engine.events import Event
from amaze_autonomy.simulation import Subject

from ..errors import EditError, FieldError, ReplayError
from ..sources import Recordings, Sample
from ..tracks import Track
from .acting import Acting
from .edits import VALUES, Edit
from .kinds import TOPIC
from .timing import TIMING, WHOLE, Item

__all__ = ["FaultedRecordings"]


class FaultedRecordings(Recordings):
    """A part of a recording, with faults.

    Args:
        inner: the recording; whoever opened it closes it.
        from_ns: where the part begins, from the start.
        to_ns: where it ends; None: at the end.
    """

    def __init__(self, inner: Recordings, from_ns: int = 0, to_ns: Optional[int] = None) -> None:
        self._inner = inner
        self.bags, self.topics, self.muted = inner.bags, inner.topics, inner.muted
        self.damage, self.missing = inner.damage, inner.missing
        self._start_ns = inner.start_ns + from_ns
        self._end_ns = inner.end_ns if to_ns is None else min(inner.end_ns, inner.start_ns + to_ns)
        part = (sample for sample in inner.samples if self._start_ns <= sample.t_ns <= self._end_ns)
        self._items = [Item(sample.t_ns, sample, ()) for sample in part]
        self._samples = [item.sample for item in self._items]
        self.touched: List[int] = []
        self._faulted = False
        self._by_rank: Optional[List[List[int]]] = None

    @property
    def start_ns(self) -> int:
        """Where the part begins."""
        return self._start_ns

    @property
    def end_ns(self) -> int:
        """Where it ends."""
        return self._end_ns

    def apply(self, acting: Sequence[Acting], seed: int) -> None:
        """Put faults into the stream, one after the other; `touched` counts the messages of each."""
        self._faulted = True
        self.touched = [0] * len(acting)
        for number, each in enumerate(acting):
            self._apply(number, each, Random(f"{seed}/{number}"))  # noqa: S311  (repeatable, not secret)
        self._items.sort(key=_place)
        self._samples = [item.sample._replace(t_ns=item.t_ns, offset=n) for n, item in enumerate(self._items)]
        self._by_rank, self._figures = None, None
        if self._samples:
            self._end_ns = max(self._end_ns, self._samples[-1].t_ns)

    def times(self, rank: int) -> Any:
        """Return the times of a topic's messages, an array."""
        return np.array([self._items[place].t_ns for place in self._places(rank)], np.int64)

    def ordered(self, ranks: Iterable[int]) -> List[Sample]:
        """Return the messages of some topics in their order."""
        wanted = sorted(place for rank in ranks for place in self._places(rank))
        samples = self.samples
        return [samples[place] for place in wanted]

    def track(self, rank: int, paths: Sequence[str]) -> Optional[Track]:
        """Return a topic's messages as arrays; None when some must be asked: a fault edits them."""
        items = [self._items[place] for place in self._places(rank)]
        if paths and any(item.edits for item in items):
            return None
        bags: Any = np.array([item.sample.bag for item in items], np.int64)
        rows: Any = np.array([item.sample.row for item in items], np.int64)
        return self._inner._track(rank, paths, self.times(rank), bags, rows)  # noqa: SLF001  (a Recordings itself)

    def _places(self, rank: int) -> List[int]:
        """Return the places of a topic's messages among all."""
        if self._by_rank is None:
            self._by_rank = [[] for _ in self.topics]
            for place, item in enumerate(self._items):
                self._by_rank[item.sample.rank].append(place)
        return self._by_rank[rank]

    def note(self, topic: str, t_ns: int, reason: str) -> None:
        """Note that a message could not be read: of the recording, not what a fault has made of it."""
        edited = (item for item in self._items if item.edits and item.t_ns == t_ns)
        if not any(self.topics[item.sample.rank] == topic for item in edited):
            super().note(topic, t_ns, reason)

    def message(self, sample: Sample) -> Optional[Any]:
        """Return the decoded message as the faults left it; None when it is damaged, which is noted."""
        if not self._faulted:
            return self._inner.message(sample)
        item = self._items[sample.offset]
        message = self._inner.message(item.sample)
        for edit in item.edits if message is not None else ():
            message = edit(message)
        return message

    def read(self, wanted: Mapping[int, Tuple[str, ...]], texts: Collection[int] = ()) -> None:
        """Read numbers of all messages of some topics, and texts of some."""
        self._inner.read(wanted, texts)

    def keep(self, topics: Sequence[str]) -> None:
        """Make whole messages of some topics fast, where tapes are wanted."""
        self._inner.keep(topics)

    def values(self, sample: Sample) -> Optional[Tuple[Any, ...]]:
        """Return the numbers of a message; None when `message` must be asked: it is damaged, or a fault edits it."""
        if not self._faulted:
            return self._inner.values(sample)
        item = self._items[sample.offset]
        return None if item.edits else self._inner.values(item.sample)

    def read_statuses(self, wanted: Mapping[int, str]) -> Tuple[int, ...]:
        """Read recorded statuses as events."""
        whole = self._inner.read_statuses(wanted)
        return () if self._faulted else whole

    def tell_statuses(self, wanted: Mapping[int, str]) -> None:
        """Make events of recorded statuses."""
        self._inner.tell_statuses(wanted)

    def status(self, sample: Sample) -> Optional[Event]:
        """Return a recorded status as an event; None when `message` must be asked: a fault moves or edits it."""
        if not self._faulted:
            return self._inner.status(sample)
        item = self._items[sample.offset]
        moved = item.edits or item.t_ns != item.sample.t_ns
        return None if moved else self._inner.status(item.sample)

    def _apply(self, number: int, acting: Acting, chance: Random) -> None:
        name = acting.fault.kind.name
        if acting.fault.kind.subject not in (Subject.COMPONENT, TOPIC):
            whole = WHOLE.get(name) if acting.fault.kind.subject == Subject.WORLD else None
            if whole is not None:
                self._items, self.touched[number] = whole(self._items, acting.fault, acting.begin_ns, acting.end_ns)
                self._end_ns = max((item.t_ns for item in self._items), default=self._end_ns)
            return
        hit = [
            item for item in self._items if self.topics[item.sample.rank] in acting.topics and acting.holds(item.t_ns)
        ]
        if name in TIMING:
            end_ns = self._end_ns if acting.end_ns is None else acting.end_ns
            kept, self.touched[number] = TIMING[name](hit, acting.fault, (acting.begin_ns, end_ns), chance)
            gone = {id(item) for item in hit}
            self._items = [item for item in self._items if id(item) not in gone] + kept
            self._items.sort(key=_place)
            return
        self._edit(number, acting, hit, chance)

    def _edit(self, number: int, acting: Acting, hit: List[Item], chance: Random) -> None:
        """Let the messages' content be changed when they are read: only then are they counted."""
        edits = VALUES[acting.fault.kind.name](acting, [item.t_ns for item in hit], chance, self._reader(hit))
        counted = [self._counted(number, edit, acting.fault.where) for edit in edits]
        changed = {id(item): replace(item, edits=(*item.edits, edit)) for item, edit in zip(hit, counted)}
        self._items = [changed.get(id(item), item) for item in self._items]

    def _counted(self, number: int, edit: Edit, where: str) -> Edit:
        def counting(message: Any) -> Any:
            try:
                edited = edit(message)
            except (EditError, FieldError) as error:
                raise ReplayError(f"{where}: {error}") from error
            self.touched[number] += edited is not message
            return edited

        return counting

    def _reader(self, hit: List[Item]) -> Callable[[], Optional[Any]]:
        """Return what reads the first message that is hit, as earlier faults left it."""

        def read() -> Optional[Any]:
            if not hit:
                return None
            message = self._inner.message(hit[0].sample)
            for edit in hit[0].edits if message is not None else ():
                message = edit(message)
            return message

        return read


def _place(item: Item) -> Tuple[int, int]:
    return item.t_ns, item.sample.rank
