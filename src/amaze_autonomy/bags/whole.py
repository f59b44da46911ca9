"""Whole messages out of their bytes, by the definition that a bag carries: for types that columns cannot hold.

A type becomes a row of steps: numbers of a fixed number at once, texts, arrays. They leave their values on a stack, of
which then the messages within are made. Values and their types are those that the rosbags library makes; constants of a
type are left out. Whatever that library would refuse is refused here, in other words: ask it for its own.
"""

from __future__ import annotations

import keyword
import struct
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from .fields import NUMBERS, Field, IrregularError, resolved, sections_of

__all__ = ["Read", "reader_of"]

Read = Callable[[bytes], Any]
_Stack = List[Any]
_Step = Callable[[bytes, int, _Stack], int]  # takes what begins at a place, returns where it ends

_FORMATS = {"bool": "?", "byte": "b", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H"}
_FORMATS.update({"int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d"})
_DTYPES = {**NUMBERS, "byte": "<i1", "char": "<u1"}
_TIMES = {"time": ("iI", "builtin_interfaces/Time"), "duration": ("iI", "builtin_interfaces/Duration")}
_new: Callable[[type], Any] = object.__new__
_COUNT = struct.Struct("<I")
_LARGEST = 4096  # steps of a type, and elements of an array of a fixed number that are no numbers


class _Fold(NamedTuple):
    """Values on the stack that become one message: from which place on, and its fields."""

    place: int
    kind: type
    names: Tuple[str, ...]


def reader_of(definition: str, kind: str) -> Optional[Read]:
    """Return what reads messages of a type; None when the definition is not understood.

    Args:
        definition: as a bag has it: the type's own fields, then those of all types in it.
        kind: the type, e.g. "amaze_autonomy/RecordingStatus".

    The function raises:
        ValueError, struct.error: These bytes are no such message.
    """
    try:
        take = _type(sections_of(definition, kind), kind, {})
    except (IrregularError, RecursionError, KeyError):
        return None

    def read(raw: bytes) -> Any:
        stack: _Stack = []
        end = take(raw, 0, stack)
        if end != len(raw):
            raise ValueError(f"it has {len(raw)} bytes and should have {end}")
        return stack[0]

    return read


def _type(sections: Dict[str, List[Field]], kind: str, known: Dict[str, _Step]) -> _Step:
    """Return what takes a message of a type; `known` are those of which there are arrays."""
    builder = _Builder(sections, known)
    builder.add_type(kind)
    builder.end_run()
    steps, folds = tuple(builder.steps), tuple(builder.folds)

    def take(raw: bytes, place: int, stack: _Stack) -> int:
        own: _Stack = []
        for step in steps:
            place = step(raw, place, own)
        for fold in folds:
            made = _new(fold.kind)
            made.__dict__.update(zip(fold.names, own[fold.place : fold.place + len(fold.names)]))
            own[fold.place : fold.place + len(fold.names)] = (made,)
        stack.append(own[0])
        return place

    return take


class _Builder:
    """Steps of a type, and of the messages that are in it exactly once."""

    def __init__(self, sections: Dict[str, List[Field]], known: Dict[str, _Step]) -> None:
        self._sections, self._known = sections, known
        self._run = ""
        self._place = 0
        self.steps: List[_Step] = []
        self.folds: List[_Fold] = []

    def add_type(self, kind: str) -> None:
        fields, begin = self._sections[kind], self._place
        names = tuple(name for _, _, name in fields)
        if not fields or len(set(names)) != len(names) or any(keyword.iskeyword(name) for name in names):
            raise IrregularError
        for field, count, _ in fields:
            if count is None:
                self._add(field, kind)
            else:
                self._add_array(field, count, kind)
        self._fold(begin, kind, names)

    def end_run(self) -> None:
        """Make one step of the numbers that came one after another."""
        if self._run:
            self.steps.append(_numbers(struct.Struct(f"<{self._run}")))
            self._run = ""
        if len(self.steps) > _LARGEST:
            raise IrregularError

    def _add(self, field: str, within: str) -> None:
        if field in _FORMATS:
            self._run += _FORMATS[field]
            self._place += 1
        elif field in _TIMES:
            run, kind = _TIMES[field]
            self._run += run
            self._place += 2
            self._fold(self._place - 2, kind, ("sec", "nanosec"))
        elif field == "string":
            self._add_step(_text)
        else:
            self.add_type(resolved(self._sections, field, within))

    def _add_array(self, field: str, count: int, within: str) -> None:
        if not count:  # of messages without bytes there could be any number
            raise IrregularError
        if field in _FORMATS:
            self._add_step(_number_array(np.dtype(_DTYPES[field]), count))
        elif count > _LARGEST:
            raise IrregularError
        else:
            self._add_step(_array(self._element(field, within), count))

    def _element(self, field: str, within: str) -> _Step:
        if field == "string":
            return _text
        if field in _TIMES:
            run, kind = _TIMES[field]
            return _time(struct.Struct(f"<{run}"), _class(kind))
        kind = resolved(self._sections, field, within)
        if kind not in self._known:
            self._known[kind] = _type(self._sections, kind, self._known)
        return self._known[kind]

    def _add_step(self, step: _Step) -> None:
        self.end_run()
        self.steps.append(step)
        self._place += 1

    def _fold(self, begin: int, kind: str, names: Tuple[str, ...]) -> None:
        if len(self.folds) > _LARGEST:
            raise IrregularError
        self.folds.append(_Fold(begin, _class(kind), names))
        self._place = begin + 1


def _class(kind: str) -> type:
    """Return a class for messages of a type; it says the type as the library's classes do."""
    return type(kind.rpartition("/")[2], (), {"__msgtype__": kind.replace("/", "/msg/")})


def _numbers(run: struct.Struct) -> _Step:
    unpack, size = run.unpack_from, run.size

    def take(raw: bytes, place: int, stack: _Stack) -> int:
        stack += unpack(raw, place)
        return place + size

    return take


def _time(run: struct.Struct, kind: type) -> _Step:
    def take(raw: bytes, place: int, stack: _Stack) -> int:
        made = _new(kind)
        made.__dict__.update(zip(("sec", "nanosec"), run.unpack_from(raw, place)))
        stack.append(made)
        return place + run.size

    return take


def _text(raw: bytes, place: int, stack: _Stack) -> int:
    begin = place + _COUNT.size
    end = begin + _COUNT.unpack_from(raw, place)[0]
    if end > len(raw):
        raise ValueError("a text ends behind the message")
    stack.append(raw[begin:end].decode())
    return int(end)


def _number_array(dtype: Any, count: int) -> _Step:
    """Return what takes an array of numbers; a count of -1 stands before the numbers."""

    def take(raw: bytes, place: int, stack: _Stack) -> int:
        number = count
        if number < 0:
            number = _COUNT.unpack_from(raw, place)[0]
            place += _COUNT.size
        if place + number * dtype.itemsize > len(raw):
            raise ValueError("an array ends behind the message")
        stack.append(np.frombuffer(raw, dtype, number, place))
        return int(place + number * dtype.itemsize)

    return take


def _array(element: _Step, count: int) -> _Step:
    """Return what takes an array of anything else; each element has bytes, so a count that lies ends soon."""

    def take(raw: bytes, place: int, stack: _Stack) -> int:
        number = count
        if number < 0:
            number = _COUNT.unpack_from(raw, place)[0]
            place += _COUNT.size
        found: _Stack = []
        for _ in range(number):
            place = element(raw, place, found)
        stack.append(found)
        return place

    return take
