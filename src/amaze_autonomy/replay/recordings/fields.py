"""Values out of messages by the paths that a topic map names, e.g. `pose.pose.position.z`, one by one or as arrays."""

from __future__ import annotations

import re
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any, Callable, List, Optional, Tuple, Union

from ..errors import FieldError

FIELD_PATH = r"[A-Za-z]\w*(\[\d+\])*(\.[A-Za-z]\w*(\[\d+\])*)*"
Getter = Callable[[Any], Any]
_STEP = re.compile(r"[A-Za-z]\w*|\[\d+\]")


def getter(path: str) -> Getter:
    """Return a function that takes a message and returns the value at the path.

    The function raises:
        FieldError: The message has no such field.
    """
    steps: List[Union[str, int]] = [int(s[1:-1]) if s[0] == "[" else s for s in _STEP.findall(path)]

    def get(message: Any) -> Any:
        value = message
        for step in steps:
            try:
                value = value[step] if isinstance(step, int) else getattr(value, step)
            except (AttributeError, IndexError, TypeError, KeyError):
                raise FieldError(path, kind_of(value), _fields(value)) from None
        return value

    return get


def number(value: Any) -> Optional[float]:
    """Return a finite float; None for anything else. A Python float: numpy's would not be written alike everywhere."""
    try:
        plain = float(value)
    except (TypeError, ValueError):
        return None
    return plain if isfinite(plain) else None


def vector(value: Any) -> Tuple[float, float, float]:
    """Return x, y, z of a vector message."""
    return float(value.x), float(value.y), float(value.z)


def quaternion(value: Any) -> Optional[Tuple[float, float, float, float]]:
    """Return x, y, z, w; None for what is no orientation: (0, 0, 0, 0) and everything whose norm is not 1."""
    return orientation((float(value.x), float(value.y), float(value.z), float(value.w)))


def orientation(parts: Tuple[float, float, float, float]) -> Optional[Tuple[float, float, float, float]]:
    """Return x, y, z, w as they are; None when they are no orientation."""
    norm = sum(part * part for part in parts)
    return parts if abs(norm - 1.0) < 0.1 else None  # noqa: PLR2004


def kind_of(value: Any) -> str:
    """Return the type of a message as ROS 1 names it."""
    kind = getattr(type(value), "__msgtype__", "") or getattr(value, "__msgtype__", "") or type(value).__name__
    return str(kind).replace("/msg/", "/")


def _fields(value: Any) -> Tuple[str, ...]:
    if not is_dataclass(value):
        return (f"{len(value)} elements",) if hasattr(value, "__len__") else ()
    names = (each.name for each in fields(value))
    return tuple(name for name in names if name[:2] != "__" and not name.isupper())  # constants are fields, too


# --- many at once -----------------------------------------------------------------------------------------------------


class Track:
    """Times and numbers of all messages of a topic, in their order.

    Args:
        times: of the messages in nanoseconds, an array that never falls.
        columns: one array for each number that is read.
    """

    def __init__(self, times: Any, columns: Tuple[Any, ...] = ()) -> None:
        self.times, self.columns = times, columns
        self._listed: Optional[List[int]] = None

    def __len__(self) -> int:
        """Return how many messages there are."""
        return len(self.times)

    @property
    def listed(self) -> List[int]:
        """The times as Python's numbers."""
        if self._listed is None:
            self._listed = self.times.tolist()
        return self._listed

    def part(self, begin: int, end: int) -> Track:
        """Return the same messages with some of the columns."""
        part = Track(self.times, self.columns[begin:end])
        part._listed = self.listed
        return part

    def rows(self, begin: int, end: int) -> List[Tuple[Any, ...]]:
        """Return the numbers of some messages, as Python's."""
        return list(zip(*(column[begin:end].tolist() for column in self.columns)))
