"""PX4's parameters over MAVLink: integers travel as the bytes of a float."""

from __future__ import annotations

import struct
from typing import Any, Dict, List, Mapping, Optional, Union

from pymavlink.dialects.v20 import common as mavlink

__all__ = ["Parameters"]

_Number = Union[int, float]


class Parameters:
    """Named numbers, read and changed by messages.

    Args:
        values: to begin with.
    """

    def __init__(self, values: Mapping[str, _Number]) -> None:
        self._values: Dict[str, _Number] = {name: values[name] for name in sorted(values)}

    def __getitem__(self, name: str) -> _Number:
        return self._values[name]

    def __setitem__(self, name: str, value: _Number) -> None:
        self._values[name] = value

    def take(self, message: Any) -> List[Any]:
        """Answer a message about parameters; one that is no such message gets no answer."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            return [self.told(name) for name in self._values]
        if kind == "PARAM_REQUEST_READ":
            return self._read(_name(message.param_id), message.param_index)
        if kind == "PARAM_SET":
            return self._set(_name(message.param_id), message)
        return []

    def told(self, name: str) -> Any:
        """Make the PARAM_VALUE of a parameter."""
        names = list(self._values)
        return self._value(name, len(names), names.index(name))

    def _read(self, name: str, index: int) -> List[Any]:
        names = list(self._values)
        if index >= 0:
            name = names[index] if index < len(names) else ""
        return [self.told(name)] if name in self._values else []

    def _set(self, name: str, message: Any) -> List[Any]:
        """Take a value and tell it twice: as the answer, and because it changed."""
        value = _number(message.param_value, message.param_type)
        old = self._values.get(name)
        if old is None or value is None or isinstance(old, int) != isinstance(value, int):
            return [self.told(name)] if old is not None else []
        self._values[name] = value
        return [self.told(name), self.told(name)]

    def _value(self, name: str, count: int, index: int) -> Any:
        value = self._values[name]
        kind, number = mavlink.MAV_PARAM_TYPE_REAL32, float(value)
        if isinstance(value, int):
            kind, number = mavlink.MAV_PARAM_TYPE_INT32, struct.unpack("<f", struct.pack("<i", value))[0]
        return mavlink.MAVLink_param_value_message(name.encode("ascii"), number, kind, count, index)


def _name(text: Any) -> str:
    return text.decode("ascii", "replace").rstrip("\0") if isinstance(text, bytes) else str(text).rstrip("\0")


def _number(value: float, kind: int) -> Optional[_Number]:
    if kind == mavlink.MAV_PARAM_TYPE_REAL32:
        return float(value)
    if kind == mavlink.MAV_PARAM_TYPE_INT32:
        return int(struct.unpack("<i", struct.pack("<f", value))[0])
    return None
