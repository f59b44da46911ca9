"""Fields of the engine's types <-> fields of messages, by their names and annotations: all rules, nothing by hand.

A field is called in the message as in the type, without its unit (`height_m`: `height`); its annotation says the rest:

| Annotation | In the message | What cannot be known |
|---|---|---|
| `str` | the same, cut at `MOST_TEXT` characters | |
| `bool`, `int`, `float` | the same | |
| an enum | its number; that of a text is its place in the enum | is refused, with the field's name |
| `Optional[float]`, `Figure` | a number, written in steps (`_STEPS`) | NaN and infinity are None; None is NaN |
| the same in degrees (`_deg`) | radians, read as whole degrees | the same |
| `int` in nanoseconds (`_ns`) | seconds | |
| `Optional[int]` in nanoseconds | seconds from now | NaN, infinity and decades are None; None is NaN |
| `Tuple[X, ...]` | a list, cut at `MOST_ITEMS` entries: the worst are kept where one can be worse, else the first | |

A *shape* adds what annotations do not say: other names, and flags by which a message says that a field is known.
A message of before lacks the fields that came later: they are what the type says of them without being told.
"""

from __future__ import annotations

from dataclasses import MISSING, fields
from enum import Enum
from functools import lru_cache
from math import degrees, isfinite, nan, radians
from typing import Any, Callable, Dict, Generic, List, Mapping, Optional, Sequence, Tuple, Type, TypeVar

from ..engine.events import Verdict
from ..journal.codec import field_types, optional_item, tuple_items

T = TypeVar("T")
Read = Callable[[Any, int], Any]
"""Makes a value of the message's; the time is the one from which its moments count."""
Classes = Callable[[str], Callable[..., Any]]
"""Returns a class of messages by its name."""
Write = Callable[[Any, int, Classes], Any]
Badness = Callable[[Any], int]
"""Returns how bad an entry of a list in a message is, the worse the more."""

MOST_TEXT = 1000
"""Characters of a text of a peer that are kept: each stands in the journal, and in what people are shown."""

MOST_ITEMS = 100
"""Entries of a list of a peer that are kept, the worst where one is worse than another: each stands in the journal."""

_UNITS = ("_m_s", "_ns", "_m", "_s", "_v", "_deg")
_STEPS: Mapping[str, int] = {"_m": 3, "_m_s": 3, "_s": 3, "_v": 3, "_fraction": 4, "_rate": 0}
"""Decimals by the end of a field's name: what no sensor of a vehicle knows is noise, in every recording and journal."""
_RAD_DECIMALS = 4
_FAR_S = 1e9  # further away than this is nonsense, not a time
_FIRST: Mapping[Type[Enum], int] = {Verdict: 1}
"""Where the numbers of an enum of texts begin, if not with 0."""


class InvalidMessageError(ValueError):
    """A field of a message holds what cannot be.

    Args:
        field: name of the field.
        value: what it holds.
        expected: what it takes, in words.
    """

    def __init__(self, field: str, value: object, expected: str) -> None:
        super().__init__(f"{field} is {value!r}, must be {expected}")
        self.field, self.value, self.expected = field, value, expected


def text(value: Any) -> str:
    """Return a text of a peer, cut where it is too long."""
    words = str(value)
    return words if len(words) <= MOST_TEXT else f"{words[: MOST_TEXT - 3]}..."


def message_name(field: str) -> str:
    """Return the name of a field in messages: without its unit."""
    unit = next((each for each in _UNITS if field.endswith(each)), "")
    return field[: len(field) - len(unit)]


class Shape(Generic[T]):
    """How one of the engine's types looks as a message.

    Args:
        kind: the type.
        message: name of its class of messages.
        without: fields that the message does not have.
        named: fields whose name in the message is another one.
        known_by: fields that are known only when a flag of the message says so.
        parts: shapes of what stands in its lists.
        needed: fields that must not be empty, with the words for what they must be.
        badness: how bad an entry of a list of them is; of too long a list the worst are kept. None: the first are.
    """

    def __init__(
        self,
        kind: Type[T],
        message: str,
        *,
        without: Tuple[str, ...] = (),
        named: Optional[Mapping[str, str]] = None,
        known_by: Optional[Mapping[str, str]] = None,
        parts: Tuple[Shape[Any], ...] = (),
        needed: Optional[Mapping[str, str]] = None,
        badness: Optional[Badness] = None,
    ) -> None:
        self.kind, self.message, self.badness = kind, message, badness
        self._flags, self._needed = dict(known_by or {}), dict(needed or {})
        shapes = {each.kind: each for each in parts}
        hints = {name: hint for name, hint in field_types(kind).items() if name not in without}
        self.names: Dict[str, str] = {name: (named or {}).get(name) or message_name(name) for name in hints}
        self.lists = tuple(at for name, at in self.names.items() if tuple_items(hints[name]) is not None)
        self._plan: List[Tuple[str, str, Read, Write]] = [
            (name, self.names[name], *_ways(hint, name, self.names[name], shapes)) for name, hint in hints.items()
        ]
        self._untold: Dict[str, Any] = {
            each.name: each.default
            for each in fields(kind)  # type: ignore[arg-type]
            if each.name in self.names and each.default is not MISSING
        }

    @property
    def flat(self) -> Tuple[str, ...]:
        """The fields of the message, with the flags that say what is known; empty where a list is among them."""
        return () if self.lists else (*self.names.values(), *dict.fromkeys(self._flags.values()))

    def left_out(self, message: Any) -> Dict[str, int]:
        """Return how many entries of each list of a message are not read, where it is too long."""
        return {at: count - MOST_ITEMS for at in self.lists for count in [_length(message, at)] if count > MOST_ITEMS}

    def _is_of_before(self, message: Any) -> bool:
        """Return whether a recorded message has this type's name, and all that it must tell."""
        named = str(getattr(message, "__msgtype__", "")).endswith(f"/{self.message}")
        return named and all(hasattr(message, at) for name, at in self.names.items() if name not in self._untold)

    def read(self, message: Any, from_ns: int, *only: str) -> Dict[str, Any]:
        """Return the fields of a message by their names in the type, or some of them alone.

        Raises:
            InvalidMessageError: A field holds what cannot be.
        """
        plan = self._some(only) if only else self._plan
        try:
            found = {name: read(getattr(message, at), from_ns) for name, at, read, _ in plan}
        except AttributeError:
            if not self._is_of_before(message):
                raise
            told = [(name, at, read) for name, at, read, _ in plan if hasattr(message, at)]
            found = {**self._untold, **{name: read(getattr(message, at), from_ns) for name, at, read in told}}
        for name, flag in self._flags.items():
            if not getattr(message, flag):
                found[name] = None
        for name, words in self._needed.items():
            if not found[name]:
                raise InvalidMessageError(self.names[name], found[name], words)
        return found

    def make(self, message: Any, from_ns: int) -> T:
        """Return what a message holds as the type, where all fields are in it."""
        return self.kind(**self.read(message, from_ns))

    def write(self, value: Any, now_ns: int, classes: Classes, *only: str) -> Dict[str, Any]:
        """Return the fields of a message by their names in it; of a type, or of some of its fields alone."""
        plan = self._some(only) if only else self._plan
        found = {at: write(getattr(value, name), now_ns, classes) for name, at, _, write in plan}
        for flag in () if only else self._flags.values():
            found[flag] = all(getattr(value, name) is not None for name, each in self._flags.items() if each == flag)
        return found

    def _some(self, only: Tuple[str, ...]) -> List[Tuple[str, str, Read, Write]]:
        return [entry for entry in self._plan if entry[0] in only]

    def written(self, value: T, now_ns: int, classes: Classes, **more: Any) -> Any:
        """Return a message."""
        return classes(self.message)(**self.write(value, now_ns, classes), **more)


def _ways(hint: Any, name: str, at: str, shapes: Mapping[Any, Shape[Any]]) -> Tuple[Read, Write]:
    inner, items = optional_item(hint), tuple_items(hint)
    if items is not None:
        return _list(items[0], at, shapes)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return _enum(hint, at)
    if name.endswith("_ns"):
        return (_duration_ns, lambda value, *_: value * 1e-9) if inner is None else (_moment_ns, _moment_s)
    if inner is float and name.endswith("_deg"):
        return _degrees, _radians
    if inner is float:
        return _known, _rounded(next((decimals for unit, decimals in _STEPS.items() if name.endswith(unit)), None))
    kind = hint if inner is None else inner
    if kind is str:
        return lambda value, _: text(value), lambda value, *_: value or ""
    return lambda value, _: kind(value), lambda value, *_: kind(value or kind())


def _duration_ns(seconds: float, _: int) -> int:
    return round(seconds * 1e9)


def _moment_ns(seconds: float, from_ns: int) -> Optional[int]:
    return from_ns + round(seconds * 1e9) if isfinite(seconds) and abs(seconds) <= _FAR_S else None


def _moment_s(moment_ns: Optional[int], now_ns: int, _: Classes) -> float:
    return nan if moment_ns is None else (moment_ns - now_ns) * 1e-9


def _known(value: float, _: int) -> Optional[float]:
    return float(value) if isfinite(value) else None


def _degrees(value: float, _: int) -> Optional[float]:
    return round(degrees(value), 0) if isfinite(value) else None


def _radians(value: Optional[float], *_: Any) -> float:
    return nan if value is None else round(radians(value), _RAD_DECIMALS)


def _rounded(decimals: Optional[int]) -> Write:
    if decimals is None:
        return lambda value, *_: nan if value is None else value
    return lambda value, *_: nan if value is None else round(value, decimals)


@lru_cache(maxsize=None)
def _numbers(kind: Type[Enum]) -> Dict[int, Enum]:
    if all(isinstance(member.value, int) for member in kind):
        return {int(member.value): member for member in kind}
    return dict(enumerate(kind, _FIRST.get(kind, 0)))


def _enum(kind: Type[Enum], at: str) -> Tuple[Read, Write]:
    members = _numbers(kind)
    numbers = {member: number for number, member in members.items()}

    def read(value: Any, _: int) -> Enum:
        found = members.get(value)
        if found is None:
            raise InvalidMessageError(at, value, f"one of {', '.join(map(str, members))}")
        return found

    return read, lambda member, *_: numbers[member]


def _length(message: Any, at: str) -> int:
    return len(getattr(message, at, ()))  # a message of before lacks it


def _kept(values: Sequence[Any], badness: Optional[Badness]) -> Sequence[Any]:
    """Return the entries of a list that are read, in their order."""
    if len(values) <= MOST_ITEMS:
        return values
    places: Sequence[int] = range(len(values))
    if badness is not None:
        bad = list(map(badness, values))
        places = sorted(places, key=lambda place: -bad[place])  # of equal ones the first come first
    return [values[place] for place in sorted(places[:MOST_ITEMS])]


def _list(item: Any, at: str, shapes: Mapping[Any, Shape[Any]]) -> Tuple[Read, Write]:
    shape = shapes.get(item)
    if shape is None:
        make = text if item is str else item
        return lambda value, _: tuple(map(make, _kept(value, None))), lambda value, *_: list(value)
    inner = shape

    def read(values: List[Any], from_ns: int) -> Tuple[Any, ...]:
        try:
            return tuple([inner.make(each, from_ns) for each in _kept(values, inner.badness)])
        except InvalidMessageError as error:
            raise InvalidMessageError(f"{at}.{error.field}", error.value, error.expected) from None

    def write(values: Tuple[Any, ...], now_ns: int, classes: Classes) -> List[Any]:
        return [inner.written(each, now_ns, classes) for each in values]

    return read, write
