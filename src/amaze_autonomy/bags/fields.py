"""Where the fields of a message lie: layouts out of the definitions that a bag carries.

A layout is a row of pieces: bytes of a fixed number, and behind each but the last a text or an array whose length
stands before it. Messages with an array of texts, or of messages that hold one, are irregular: they have no layout.
"""

from __future__ import annotations

import re
from typing import Dict, List, NamedTuple, Optional, Tuple

__all__ = [
    "NUMBERS",
    "TEXT",
    "Field",
    "IrregularError",
    "Layout",
    "Leaf",
    "Piece",
    "layout_of",
    "resolved",
    "sections_of",
]

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
