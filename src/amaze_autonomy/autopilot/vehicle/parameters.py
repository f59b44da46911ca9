"""Parameters of the autopilot: asked for by name, asked again, and taken unasked as well.

PX4 writes whole numbers into the bytes of the float that carries them, ArduPilot as the float of the same value.
https://mavlink.io/en/services/parameter.html#parameter-encoding
"""

from __future__ import annotations

import struct
from math import isclose, isfinite
from typing import Any, Dict, List, Mapping, NamedTuple, Optional

from ..link.dialect import Message, mavlink

__all__ = ["ParameterState", "Parameters", "value_of"]

_S = 1_000_000_000
_PERIOD_NS = _S
_SLOW_PERIOD_NS = 10 * _S
_QUICK_ATTEMPTS = 5
_AT_ONCE = 4
_FORMATS: Mapping[int, str] = {
    mavlink.MAV_PARAM_TYPE_UINT8: "<B3x",
    mavlink.MAV_PARAM_TYPE_INT8: "<b3x",
    mavlink.MAV_PARAM_TYPE_UINT16: "<H2x",
    mavlink.MAV_PARAM_TYPE_INT16: "<h2x",
    mavlink.MAV_PARAM_TYPE_UINT32: "<I",
    mavlink.MAV_PARAM_TYPE_INT32: "<i",
}


class ParameterState(NamedTuple):
    """One parameter: what it should be, what it is (None: not read yet)."""

    name: str
    expected: float
    value: Optional[float]

    @property
    def agrees(self) -> Optional[bool]:
        """Whether it is as configured; None: not read yet."""
        if self.value is None:
            return None
        return isclose(self.value, self.expected, rel_tol=1e-5, abs_tol=1e-6)


class _Asked:
    def __init__(self, expected: float) -> None:
        self.expected = expected
        self.value: Optional[float] = None
        self.attempts = self.due_ns = 0


class Parameters:
    """The parameters that are compared.

    Args:
        expected: value by name, as configured.
    """

    def __init__(self, expected: Mapping[str, float]) -> None:
        self._expected: Mapping[str, float] = {}
        self._asked: Dict[str, _Asked] = {}
        self.expect(expected)

    def expect(self, expected: Mapping[str, float]) -> None:
        """Compare these; nothing when they are the same as before."""
        if expected != self._expected:
            self._expected = expected
            self._asked = {name: _Asked(value) for name, value in expected.items()}

    def wake(self, t_ns: int, system: int, component: int) -> List[Message]:
        """Return the requests that are due: a few at once, each again until answered, less often after a while."""
        due = [(name, one) for name, one in self._asked.items() if one.value is None and t_ns >= one.due_ns]
        for _, one in due[:_AT_ONCE]:
            one.attempts += 1
            one.due_ns = t_ns + (_PERIOD_NS if one.attempts < _QUICK_ATTEMPTS else _SLOW_PERIOD_NS)
        return [
            mavlink.MAVLink_param_request_read_message(system, component, name.encode("ascii"), -1)
            for name, _ in due[:_AT_ONCE]
        ]

    def add(self, message: Any, *, bytewise: bool) -> None:
        """Take a PARAM_VALUE, asked for or not."""
        one = self._asked.get(message.param_id)
        if one is not None:
            one.value = value_of(message, bytewise=bytewise)

    def forget(self) -> None:
        """Ask for all of them again: the autopilot has started again, or another one is there."""
        for one in self._asked.values():
            one.value, one.attempts, one.due_ns = None, 0, 0

    @property
    def states(self) -> List[ParameterState]:
        """All of them, in the order of the configuration."""
        return [ParameterState(name, one.expected, one.value) for name, one in self._asked.items()]


def value_of(message: Any, *, bytewise: bool) -> Optional[float]:
    """Return the value of a PARAM_VALUE; None when it is no number."""
    form = _FORMATS.get(message.param_type)
    if bytewise and form is not None:
        return float(struct.unpack(form, struct.pack("<f", message.param_value))[0])
    return float(message.param_value) if isfinite(message.param_value) else None
