"""What a serialized message says: its stamp, whether its numbers are finite, a digest of it without its header.

The stamp and the digest need no decoding. Serialization: http://wiki.ros.org/msg (little endian, fields in order).
"""

from __future__ import annotations

import struct
import zlib
from math import isfinite
from typing import Any, Callable, List, Mapping, Optional, Tuple

import roslib.message

__all__ = ["MessageContent"]

_S = 1_000_000_000
_HEADER_TYPES = ("Header", "std_msgs/Header", "roslib/Header")
_STAMP = struct.Struct("<II")
_LENGTH = struct.Struct("<I")
_SEQUENCE_BYTES, _STAMP_END = 4, 12
_FLOATS = ("float32", "float64")


class MessageContent:
    """Looks into the messages of one publisher.

    Args:
        connection: header of the connection (type, message_definition).
    """

    def __init__(self, connection: Mapping[str, str]) -> None:
        self.type_name = connection.get("type", "")
        self.has_header = _has_header(connection.get("message_definition", ""))
        self._class: Any = None

    @property
    def known(self) -> bool:
        """True when messages can be decoded: their package is installed here."""
        if self._class is None:
            self._class = roslib.message.get_message_class(self.type_name)
        return self._class is not None

    def stamp_ns(self, data: memoryview) -> Optional[int]:
        """Return the stamp of the header; None when there is none, or when it is 0."""
        if not self.has_header or len(data) < _STAMP_END:
            return None
        secs, nsecs = _STAMP.unpack_from(data, _SEQUENCE_BYTES)
        return (secs * _S + nsecs) or None

    def digest(self, data: memoryview) -> int:
        """Return a digest of the message without its header."""
        start = 0
        if self.has_header and len(data) >= _STAMP_END + _LENGTH.size:
            (frame,) = _LENGTH.unpack_from(data, _STAMP_END)
            start = _STAMP_END + _LENGTH.size + frame
        return zlib.crc32(data[start:])

    def finite(self, data: memoryview) -> bool:
        """Return whether all floating point numbers of the message are finite; False when it cannot be decoded."""
        if not self.known:
            return False
        try:
            message = self._class().deserialize(bytes(data))
        except Exception:  # genpy raises anything from struct.error to UnicodeDecodeError
            return False
        return _finite(message, _plan(self._class))


def _has_header(definition: str) -> bool:
    """Return whether the first field is a header."""
    for line in definition.splitlines():
        words = line.split("#", 1)[0].split()
        if not words or "=" in line.split("#", 1)[0]:
            continue
        return words[0] in _HEADER_TYPES
    return False


_Step = Tuple[str, Callable[[Any], bool]]


def _plan(kind: Any) -> List[_Step]:
    """Return the fields of a message class that hold floats, and how each is judged; made once per class."""
    plan: Optional[List[_Step]] = _PLANS.get(kind)
    if plan is None:
        plan = _PLANS[kind] = []
        for name, type_name in zip(kind.__slots__, kind._slot_types):
            step = _step(type_name)
            if step is not None:
                plan.append((name, step))
    return plan


_PLANS: dict = {}  # type: ignore[type-arg]


def _step(type_name: str) -> Optional[Callable[[Any], bool]]:
    base, array = type_name.split("[", 1)[0], "[" in type_name
    if base in _FLOATS:
        return _all_finite if array else isfinite
    if "/" not in base or base in _HEADER_TYPES:
        return None
    kind = roslib.message.get_message_class(base)
    inner = _plan(kind) if kind is not None else []
    if not inner:
        return None
    if array:
        return lambda messages: all(_finite(message, inner) for message in messages)
    return lambda message: _finite(message, inner)


def _all_finite(values: Any) -> bool:
    return all(map(isfinite, values))


def _finite(message: Any, plan: List[_Step]) -> bool:
    return all(judge(getattr(message, name)) for name, judge in plan)
