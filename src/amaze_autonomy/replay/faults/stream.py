"""The messages of a recording with faults in them: each fault is a function from the stream to the stream.

The functions are pure: the same recording, faults and seed give the same stream. What a fault does to a message's
content is an edit that is carried out when the message is read, so that nothing is decoded that nobody looks at.
"""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, nan
from numbers import Integral, Number, Real
from random import Random
from typing import Any, Callable, Collection, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from amaze_autonomy.engine.events import Event
from amaze_autonomy.simulation import Fault, Subject
from amaze_autonomy.simulation.faults import flapping_ns

from ..errors import EditError, FieldError, ReplayError
from ..recordings.fields import Track, getter, kind_of
from ..recordings.journals import FlightLog
from ..recordings.sources import Recordings, Sample
from .kinds import TOPIC, Acting


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
        self.damage, self.problems, self.missing = inner.damage, inner.problems, inner.missing
        self.shift_ns, self.from_ns = inner.shift_ns, from_ns
        self._start_ns = inner.start_ns + from_ns
        self._end_ns = inner.end_ns if to_ns is None else min(inner.end_ns, inner.start_ns + to_ns)
        elsewhere = {words for words, times in inner.doubts.items() if not self._holds(*times)}
        self.problems = tuple(each for each in inner.problems if each not in elsewhere)
        part = (sample for sample in inner.samples if self._start_ns <= sample.t_ns <= self._end_ns)
        self._items = [Item(sample.t_ns, sample, ()) for sample in part]
        self._samples = [item.sample for item in self._items]
        self.touched: List[int] = []
        self.faulted = False
        self._by_rank: Optional[List[List[int]]] = None

    def _holds(self, from_ns: int, to_ns: int) -> bool:
        """Return whether some of a time is in the part."""
        return from_ns <= self._end_ns and to_ns >= self._start_ns

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
        self.faulted = True
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

    def note(self, topic: str, t_ns: int, reason: str, message: object = None) -> None:
        """Note that a message could not be read: of the recording, not what a fault has made of it."""
        edited = (item for item in self._items if item.edits and item.t_ns == t_ns)
        if not any(self.topics[item.sample.rank] == topic for item in edited):
            super().note(topic, t_ns, reason, message)

    def message(self, sample: Sample) -> Optional[Any]:
        """Return the decoded message as the faults left it; None when it is damaged, which is noted."""
        if not self.faulted:
            return self._inner.message(sample)
        item = self._items[sample.offset]
        message = self._inner.message(item.sample)
        for edit in item.edits if message is not None else ():
            message = edit(message)
        return message

    def paths_read(self, rank: int) -> Tuple[str, ...]:
        """Return of which fields of a topic the numbers are read."""
        return self._inner.paths_read(rank)

    def read(self, wanted: Mapping[int, Tuple[str, ...]], texts: Collection[int] = ()) -> None:
        """Read numbers of all messages of some topics, and texts of some."""
        self._inner.read(wanted, texts)

    def log(self, topic: str) -> Optional[FlightLog]:
        """Return what was asked in the flight: of all of it, past all faults."""
        return self._inner.log(topic)

    def keep(self, topics: Sequence[str]) -> None:
        """Make whole messages of some topics fast, where tapes are wanted."""
        self._inner.keep(topics)

    def values(self, sample: Sample) -> Optional[Tuple[Any, ...]]:
        """Return the numbers of a message; None when `message` must be asked: it is damaged, or a fault edits it."""
        if not self.faulted:
            return self._inner.values(sample)
        item = self._items[sample.offset]
        return None if item.edits else self._inner.values(item.sample)

    def read_statuses(self, wanted: Mapping[int, str]) -> Tuple[int, ...]:
        """Read recorded statuses as events."""
        whole = self._inner.read_statuses(wanted)
        return () if self.faulted else whole

    def tell_statuses(self, wanted: Mapping[int, str]) -> None:
        """Make events of recorded statuses."""
        self._inner.tell_statuses(wanted)

    def status(self, sample: Sample) -> Optional[Event]:
        """Return a recorded status as an event; None when `message` must be asked: a fault moves or edits it."""
        if not self.faulted:
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


# --- edits ------------------------------------------------------------------------------------------------------------
# Faults of what messages say: each is a change of one message, made when it is read.
#
# A message is copied as far as the path of the field goes, never changed: others may hold it.


Edit = Callable[[Any], Any]
_Read = Callable[[], Optional[Any]]
_Make = Callable[[Acting, Sequence[int], Random, _Read], List[Edit]]
_STEP = re.compile(r"[A-Za-z]\w*|\[\d+\]")
_S = 1_000_000_000
_PLAIN = (Number, np.generic, str, bytes)  # numpy's yes and no are no numbers of Python's
_SILLY = 8191  # what range sensors of several makes say for "nothing seen"
_CLOCKS = ("header", "stamp", "time_boot_ms", "time_usec", "time_unix_usec")  # of ROS, and of MAVLink: it has no header


def changed(message: Any, path: str, change: Callable[[Any], Any]) -> Any:
    """Return a copy of a message with the value at a path changed; the message itself when it stays what it was.

    Raises:
        FieldError: the message has no such field.
    """
    old = getter(path)(message)  # says which field is not there
    new = change(old)
    if _same(old, new):
        return message
    steps: List[Union[str, int]] = [int(s[1:-1]) if s[0] == "[" else s for s in _STEP.findall(path)]
    return _changed(message, steps, lambda _: new, path)


def _same(one: Any, other: Any) -> bool:
    """Return whether two values say the same; what is no number in both does."""
    if isinstance(one, _PLAIN) and isinstance(other, _PLAIN):
        return bool(one == other) or all(isinstance(each, Real) and isnan(each) for each in (one, other))
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(_same, one, other))
    return _same(_said(one), _said(other)) if hasattr(one, "__dict__") else bool(one == other)


def _said(message: Any) -> List[Tuple[str, Any]]:
    """Return the fields of a message; what begins with _ is how it was sent, e.g. a number of the frame."""
    return sorted((pair for pair in vars(message).items() if pair[0][0] != "_"), key=lambda pair: pair[0])


def _changed(value: Any, steps: Sequence[Union[str, int]], change: Callable[[Any], Any], path: str) -> Any:
    if not steps:
        return change(value)
    other, head = copy.copy(value), steps[0]
    inner = value[head] if isinstance(head, int) else getattr(value, head)
    new = _changed(inner, steps[1:], change, path)
    try:
        if isinstance(head, int):
            other[head] = new
        else:
            object.__setattr__(other, head, new)
    except (TypeError, ValueError, OverflowError):
        raise FieldError(path, kind_of(value), (f"a value that cannot be {new}",)) from None
    return other


def _number_edit(of: Callable[[Acting, Random], Callable[[float, int], float]]) -> _Make:
    """Return a maker of edits from a function of (value, nanoseconds since the fault began)."""

    def make(acting: Acting, times: Sequence[int], chance: Random, _: _Read) -> List[Edit]:
        path, change = acting.fault.word("field"), of(acting, chance)
        drawn = [chance.gauss(0.0, 1.0) for _ in times] if acting.fault.kind.name == "noisy" else []

        def edit(number: int, t_ns: int) -> Edit:
            by = drawn[number] * acting.fault.number("sigma") if drawn else 0.0

            def new(value: Any) -> Any:
                number = _number(value, path, acting.fault.kind.name)
                wanted = number + by if drawn else change(number, t_ns - acting.begin_ns)
                return _fitting(value, wanted, path, acting.fault.kind.name)

            return lambda message: changed(message, path, new)

        return [edit(number, t_ns) for number, t_ns in enumerate(times)]

    return make


def _number(value: Any, path: str, fault: str) -> Any:
    """Return a number of a message.

    Raises:
        EditError: it is none.
    """
    if isinstance(value, Real) and not isinstance(value, (bool, np.bool_)):
        return value
    raise EditError(path, fault, f"is no number but {kind_of(value)}; name a number, or use garbage")


def _fitting(old: Any, new: float, path: str, fault: str) -> float:
    """Return a new value as the field can hold it: a whole number stays one.

    Raises:
        EditError: it cannot hold it.
    """
    if not isinstance(old, Integral):
        return new
    if not isfinite(new):
        raise EditError(path, fault, f"is a whole number, which cannot be {new}; use undefined, or garbage")
    return round(new)


def _constant(value: float) -> _Make:
    return _number_edit(lambda _, __: lambda ___, ____: value)


def _biased(acting: Acting, _: Random) -> Callable[[float, int], float]:
    by = acting.fault.number("by")
    return lambda value, _: value + by


def _drifting(acting: Acting, _: Random) -> Callable[[float, int], float]:
    by_per_s = acting.fault.number("by_per_s")
    return lambda value, since_ns: value + by_per_s * since_ns / _S


def _scaled(acting: Acting, _: Random) -> Callable[[float, int], float]:
    factor = acting.fault.number("factor")
    return lambda value, _: value * factor


def _saturated(acting: Acting, _: Random) -> Callable[[float, int], float]:
    low, high = acting.fault.number("lowest"), acting.fault.number("highest")
    return lambda value, _: min(max(value, low), high) if isfinite(value) else value


def _noisy(_: Acting, __: Random) -> Callable[[float, int], float]:
    return lambda value, _: value


def _garbage(acting: Acting, times: Sequence[int], _: Random, __: _Read) -> List[Edit]:
    path = acting.fault.word("field")

    def silly(value: Any) -> Any:
        if isinstance(value, str):
            return "\x00"
        if isinstance(value, (bool, np.bool_)):
            return not value
        if hasattr(value, "__len__"):
            return value[:0]
        if isinstance(value, (Number, np.generic)):
            return _held(value, _SILLY)
        raise EditError(path, "garbage", f"is no value but {kind_of(value)}; name one of its fields")

    return [lambda message: changed(message, path, silly)] * len(times)


def _held(value: Any, wanted: int) -> Any:
    """Return a number as the type of a value, or the largest of it: a byte of an array holds no 8191."""
    if isinstance(value, np.integer):
        wanted = min(wanted, int(np.iinfo(value.dtype).max))
    return type(value)(wanted)


def _swapped(acting: Acting, times: Sequence[int], _: Random, __: _Read) -> List[Edit]:
    one, other = acting.fault.word("field"), acting.fault.word("with")

    def swap(message: Any) -> Any:
        left, right = getter(one)(message), getter(other)(message)
        return changed(changed(message, one, lambda _: right), other, lambda _: left)

    return [swap] * len(times)


def _stamped(acting: Acting, times: Sequence[int], _: Random, __: _Read) -> List[Edit]:
    to, by_ns = acting.fault.word("to"), round(acting.fault.number("by_s") * _S)

    def edit(t_ns: int) -> Edit:
        def stamp(old: Any) -> Any:
            old_ns = int(old.sec) * _S + int(old.nanosec)
            back_ns = 2 * acting.begin_ns - t_ns
            new_ns = {"zero": 0, "offset": old_ns + by_ns, "backwards": back_ns}[to]
            seconds, rest = divmod(max(0, new_ns), _S)
            new = copy.copy(old)
            object.__setattr__(new, "sec", seconds)
            object.__setattr__(new, "nanosec", rest)
            return new

        return lambda message: changed(message, "header.stamp", stamp)

    return [edit(t_ns) for t_ns in times]


def _stuck(acting: Acting, times: Sequence[int], _: Random, read: _Read) -> List[Edit]:
    running = acting.fault.word("stamp") == "running"
    held: List[Any] = []

    def stick(message: Any) -> Any:
        if not held:
            held.append(read())
        first = held[0] if held[0] is not None else message
        stuck = _at_the_time_of(message, first) if running else first
        return message if _same(message, stuck) else stuck

    return [stick] * len(times)


def _at_the_time_of(message: Any, first: Any) -> Any:
    """Return the first message with the header and times of the other one, as far as it has any."""
    for name in _CLOCKS:
        if hasattr(message, name) and hasattr(first, name):
            first = changed(first, name, lambda _, name=name: getattr(message, name))  # type: ignore[misc]
    return first


def _undefined(acting: Acting, _: Random) -> Callable[[float, int], float]:
    number = int(acting.fault.number("value"))
    return lambda _, __: number


VALUES: Mapping[str, _Make] = {
    "stuck": _stuck,
    "nan": _constant(nan),
    "infinite": _constant(inf),
    "garbage": _garbage,
    "undefined": _number_edit(_undefined),
    "biased": _number_edit(_biased),
    "drifting": _number_edit(_drifting),
    "noisy": _number_edit(_noisy),
    "scaled": _number_edit(_scaled),
    "saturated": _number_edit(_saturated),
    "swapped": _swapped,
    "stamped": _stamped,
}
"""By the name of the fault: what it does to each of the messages that come at the times given."""


# --- timing -----------------------------------------------------------------------------------------------------------
# Faults of when messages come: they are lost, late, doubled, in another order; or the recorder's clock is set.


Period = Tuple[int, int]


@dataclass(frozen=True)
class Item:
    """One message of the stream: when it comes now, which one it is, and what is done to its content."""

    t_ns: int
    sample: Sample
    edits: Tuple[Callable[[Any], Any], ...]


Changed = Tuple[List[Item], int]
"""The messages that are left, and how many were touched."""
_Timing = Callable[[Sequence[Item], Fault, Period, Random], Changed]
_Whole = Callable[[Sequence[Item], Fault, int, Optional[int]], Changed]


def _silent(items: Sequence[Item], _: Fault, __: Period, ___: Random) -> Changed:
    return [], len(items)


def _slow(items: Sequence[Item], fault: Fault, _: Period, __: Random) -> Changed:
    """Keep a part of each topic's messages, evenly."""
    part, counts = fault.number("rate_fraction"), [0] * (1 + max((item.sample.rank for item in items), default=0))
    kept: List[Item] = []
    for item in items:
        number = counts[item.sample.rank]
        counts[item.sample.rank] += 1
        if int((number + 1) * part) > int(number * part):
            kept.append(item)
    return kept, len(items) - len(kept)


def _flapping(items: Sequence[Item], fault: Fault, period: Period, _: Random) -> Changed:
    off_ns, on_ns = flapping_ns(fault)
    kept = [item for item in items if (item.t_ns - period[0]) % (off_ns + on_ns) >= off_ns]
    return kept, len(items) - len(kept)


def _dropped(items: Sequence[Item], fault: Fault, _: Period, chance: Random) -> Changed:
    lost = fault.number("fraction")
    kept = [item for item in items if chance.random() >= lost]
    return kept, len(items) - len(kept)


def _delayed(items: Sequence[Item], fault: Fault, _: Period, chance: Random) -> Changed:
    delay_ns, jitter_ns = round(fault.number("delay_s") * _S), round(fault.number("jitter_s") * _S)
    keeps_order = fault.word("order") == "kept"
    late: List[Item] = []
    last_ns: List[int] = [0] * (1 + max((item.sample.rank for item in items), default=0))
    for item in items:
        t_ns = item.t_ns + delay_ns + (round(chance.random() * jitter_ns) if jitter_ns else 0)
        if keeps_order:
            t_ns = last_ns[item.sample.rank] = max(t_ns, last_ns[item.sample.rank])
        late.append(replace(item, t_ns=t_ns))
    return late, sum(one.t_ns != other.t_ns for one, other in zip(items, late))


def _bursting(items: Sequence[Item], _: Fault, period: Period, __: Random) -> Changed:
    return [replace(item, t_ns=period[1]) for item in items], len(items)


def _duplicated(items: Sequence[Item], fault: Fault, _: Period, __: Random) -> Changed:
    copies = 1 + round(fault.number("copies"))
    return [item for item in items for _ in range(copies)], len(items)


def _reordered(items: Sequence[Item], fault: Fault, _: Period, chance: Random) -> Changed:
    """Let messages of one topic change places: the times stay, their contents move."""
    within = fault.number("within_s") * _S
    out: List[Item] = []
    for rank in sorted({item.sample.rank for item in items}):
        own = [item for item in items if item.sample.rank == rank]
        moved = sorted(own, key=lambda item: item.t_ns + chance.uniform(0.0, within))
        out += [replace(item, t_ns=place.t_ns) for item, place in zip(moved, own)]
    return out, sum(one.t_ns != other.t_ns for one, other in zip(_by_place(out), _by_place(items)))


def _by_place(items: Sequence[Item]) -> List[Item]:
    return sorted(items, key=lambda item: item.sample)


def _clock_jumps(items: Sequence[Item], fault: Fault, begin_ns: int, end_ns: Optional[int]) -> Changed:
    by_ns = round(fault.number("by_s") * _S)
    moved = [
        replace(item, t_ns=max(0, item.t_ns + by_ns))
        if begin_ns <= item.t_ns and (end_ns is None or item.t_ns < end_ns)
        else item
        for item in items
    ]
    return moved, sum(one is not other for one, other in zip(items, moved))


def _clock_warps(items: Sequence[Item], fault: Fault, begin_ns: int, end_ns: Optional[int]) -> Changed:
    factor = fault.number("factor")

    def warped(t_ns: int) -> int:
        if t_ns < begin_ns:
            return t_ns
        inside = t_ns if end_ns is None else min(t_ns, end_ns)
        return begin_ns + round((inside - begin_ns) * factor) + (t_ns - inside)

    moved = [replace(item, t_ns=warped(item.t_ns)) for item in items]
    return moved, sum(one.t_ns != other.t_ns for one, other in zip(items, moved))


TIMING: Mapping[str, _Timing] = {
    "silent": _silent,
    "slow": _slow,
    "flapping": _flapping,
    "dropped": _dropped,
    "delayed": _delayed,
    "bursting": _bursting,
    "duplicated": _duplicated,
    "reordered": _reordered,
}
"""By the name of the fault: messages that are hit to messages that come."""

WHOLE: Mapping[str, _Whole] = {"clock_jumps": _clock_jumps, "clock_warps": _clock_warps}
"""Faults of the whole recording."""
