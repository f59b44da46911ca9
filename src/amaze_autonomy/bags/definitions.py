"""What the definition of a type, which every bag carries, says of its messages.

A layout is a row of pieces: bytes of a fixed number, and behind each but the last a text or an array whose length
stands before it. Messages with an array of texts, or of messages that hold one, are irregular: they have no layout.

Those are read as a whole: a type becomes a row of steps, numbers of a fixed number at once, texts, arrays. They leave
their values on a stack, of which then the messages within are made. Values and their types are those that the rosbags
library makes; constants of a type are left out. Whatever that library would refuse is refused here, in other words.
"""

from __future__ import annotations

import keyword
import re
import struct
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

# --- where fields lie -------------------------------------------------------------------------------------------------


NUMBERS = {
    "bool": "?",
    "int8": "<i1",
    "uint8": "<u1",
    "int16": "<i2",
    "uint16": "<u2",
    "int32": "<i4",
    "uint32": "<u4",
    "int64": "<i8",
    "uint64": "<u8",
    "float32": "<f4",
    "float64": "<f8",
}
_SIZES = {"bool": 1, "int8": 1, "uint8": 1, "byte": 1, "char": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4}
_SIZES.update({"float32": 4, "int64": 8, "uint64": 8, "float64": 8})
_TIMES = {"time": ("<i4", "<u4"), "duration": ("<i4", "<u4")}
_FIELD = re.compile(r"^([A-Za-z][\w/]*)(\[(\d*)\])?\s+([A-Za-z]\w*)$")
_LARGEST = 4096  # pieces and numbers of a layout; what has more is no message that somebody looks into

Field = Tuple[str, Optional[int], str]  # type, length of an array (-1: any; None: no array), name

TEXT = "S"


class Leaf(NamedTuple):
    """One number, or a text: in which piece, how many bytes from its beginning, numpy's type or TEXT."""

    piece: int
    offset: int
    dtype: str


class Piece(NamedTuple):
    """Bytes of a fixed number; behind them elements of this size, their number before them (0: the end)."""

    size: int
    element: int
    text: bool


class Layout(NamedTuple):
    """The layout of a type: its pieces, and its numbers and texts by path, e.g. "pose.pose.position.z"."""

    pieces: Tuple[Piece, ...]
    leaves: Dict[str, Leaf]


class IrregularError(Exception):
    """A type that has no layout."""


def layout_of(definition: str, kind: str) -> Optional[Layout]:
    """Return the layout of a type; None when it is irregular, or its definition is not understood.

    Args:
        definition: as a bag has it: the type's own fields, then those of all types in it.
        kind: the type, e.g. "sensor_msgs/Imu".
    """
    try:
        builder = _Builder(sections_of(definition, kind))
        builder.add_type(kind, "")
    except (IrregularError, RecursionError):
        return None
    return Layout((*builder.pieces, Piece(builder.size, 0, text=False)), builder.leaves)


def sections_of(definition: str, kind: str) -> Dict[str, List[Field]]:
    """Return the fields of each type in a definition, by its name; constants are left out.

    Raises:
        IrregularError: A line is not understood.
    """
    sections: Dict[str, List[Field]] = {kind: []}
    name = kind
    for line in definition.splitlines():
        words = line.split("#", 1)[0].strip()
        if words.startswith("MSG: "):
            name = words[5:].strip()
            sections[name] = []
        elif words and not words.startswith("===") and "=" not in words:  # else a constant
            match = _FIELD.match(words)
            if match is None:
                raise IrregularError
            count = None if match[2] is None else int(match[3]) if match[3] else -1
            sections[name].append((match[1], count, match[4]))
    return sections


def types_of(definition: str, kind: str) -> Any:
    """Return the types in a definition as the rosbags library has them; it reads no line that ends as on Windows."""
    from rosbags.typesys import get_types_from_msg  # noqa: PLC0415  (slow to load)

    return get_types_from_msg(definition.replace("\r\n", "\n"), kind)


class _Builder:
    def __init__(self, sections: Dict[str, List[Field]]) -> None:
        self._sections = sections
        self.pieces: List[Piece] = []
        self.leaves: Dict[str, Leaf] = {}
        self.size = 0

    def add_type(self, kind: str, path: str) -> None:
        for field, count, name in self._sections[kind]:
            own = f"{path}.{name}" if path else name
            if count is None:
                self._add(field, kind, own)
            elif count >= 0:
                for each in range(count):
                    self._add(field, kind, f"{own}[{each}]")
            else:
                self._end(_fixed_size(self._sections, field, kind), text=False)

    def _add(self, field: str, within: str, path: str) -> None:
        if len(self.leaves) > _LARGEST or len(self.pieces) > _LARGEST:
            raise IrregularError
        if field in _SIZES:
            if field in NUMBERS:
                self.leaves[path] = Leaf(len(self.pieces), self.size, NUMBERS[field])
            self.size += _SIZES[field]
        elif field in _TIMES:
            for name, dtype in zip(("sec", "nanosec"), _TIMES[field]):
                self.leaves[f"{path}.{name}"] = Leaf(len(self.pieces), self.size, dtype)
                self.size += 4
        elif field == "string":
            self.leaves[path] = Leaf(len(self.pieces), self.size, TEXT)
            self._end(1, text=True)
        else:
            self.add_type(resolved(self._sections, field, within), path)

    def _end(self, element: int, *, text: bool) -> None:
        self.pieces.append(Piece(self.size, element, text))
        self.size = 0


def _fixed_size(sections: Dict[str, List[Field]], field: str, within: str) -> int:
    """Return the size of an element of an array; such elements have no texts and no arrays of any length."""
    if field in _SIZES:
        return _SIZES[field]
    if field in _TIMES:
        return 8
    if field == "string":
        raise IrregularError
    kind = resolved(sections, field, within)
    size = 0
    for inner, count, _ in sections[kind]:
        if count == -1:
            raise IrregularError
        size += _fixed_size(sections, inner, kind) * (1 if count is None else count)
    if not size:
        raise IrregularError
    return size


def resolved(sections: Dict[str, List[Field]], field: str, within: str) -> str:
    """Return the full name of a type: as it is, of the same package, or the header.

    Raises:
        IrregularError: There is none.
    """
    names = (field, f"{within.split('/', 1)[0]}/{field}", f"std_msgs/{field}" if field == "Header" else field)
    for name in names:
        if name in sections and name != within:
            return name
    raise IrregularError


# --- whole messages ---------------------------------------------------------------------------------------------------


Read = Callable[[bytes], Any]
_Stack = List[Any]
_Step = Callable[[bytes, int, _Stack], int]  # takes what begins at a place, returns where it ends

_FORMATS = {"bool": "?", "byte": "b", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H"}
_FORMATS.update({"int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d"})
_DTYPES = {**NUMBERS, "byte": "<i1", "char": "<u1"}
_TIME_RUNS = {"time": ("iI", "builtin_interfaces/Time"), "duration": ("iI", "builtin_interfaces/Duration")}
_new: Callable[[type], Any] = object.__new__
_COUNT = struct.Struct("<I")
_MOST = 4096  # steps of a type, and elements of an array of a fixed number that are no numbers


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
    builder = _StepBuilder(sections, known)
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


class _StepBuilder:
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
        if len(self.steps) > _MOST:
            raise IrregularError

    def _add(self, field: str, within: str) -> None:
        if field in _FORMATS:
            self._run += _FORMATS[field]
            self._place += 1
        elif field in _TIME_RUNS:
            run, kind = _TIME_RUNS[field]
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
        elif count > _MOST:
            raise IrregularError
        else:
            self._add_step(_array(self._element(field, within), count))

    def _element(self, field: str, within: str) -> _Step:
        if field == "string":
            return _text
        if field in _TIME_RUNS:
            run, kind = _TIME_RUNS[field]
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
        if len(self.folds) > _MOST:
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
