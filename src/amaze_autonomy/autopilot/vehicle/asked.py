"""What we ask of the vehicle until it comes: messages at their rate, and parameters by their names.

No acknowledgement is looked at. A message that comes at less than a third of its rate is asked for again every 3 s, and
after some attempts every 30 s: not every autopilot grants every rate. PX4 beats at 1 Hz, whatever it is asked, and
refuses to be asked; it sends a CURRENT_MODE that was asked for at 10 Hz with each change, and else twice a second.
"""

from __future__ import annotations

import struct
from math import isclose, isfinite
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Tuple

from ..link.dialect import Message, mavlink, message_id

# --- messages, at their rate ------------------------------------------------------------------------------------------


_S = 1_000_000_000
_AGAIN_NS = 3 * _S
_SLOW_AGAIN_NS = 30 * _S
_QUICK_ATTEMPTS = 5
_PERIODS = 3
_AT_ONCE = 4
_ON_CHANGE_NS = {"CURRENT_MODE": 3 * _S // 2}  # longest pause of what comes with each change, once it was asked for


class _Wanted:
    def __init__(self, name: str, rate_hz: float) -> None:
        self.number, self.interval_ns = message_id(name), round(_S / rate_hz)
        self.pause_ns = _ON_CHANGE_NS.get(name, _PERIODS * self.interval_ns)
        self.must_be_asked = name in _ON_CHANGE_NS
        self.heard_ns = self.due_ns = self.attempts = 0


class Rates:
    """The messages that are wanted.

    Args:
        rates_hz: rate by name of the message.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        self._wanted: Dict[str, _Wanted] = {name: _Wanted(name, rate) for name, rate in rates_hz.items()}

    def heard(self, t_ns: int, name: str) -> None:
        """Note that a message came."""
        wanted = self._wanted.get(name)
        if wanted is not None:
            wanted.heard_ns = t_ns

    def wake(self, t_ns: int, system: int, component: int, without: Tuple[str, ...] = ()) -> List[Message]:
        """Return the requests that are due; messages in `without` this autopilot does not have."""
        wanted = [one for name, one in self._wanted.items() if name not in without]
        due = [one for one in wanted if t_ns >= one.due_ns and not self._comes(t_ns, one)]
        for one in due[:_AT_ONCE]:
            one.attempts += 1
            one.due_ns = t_ns + (_AGAIN_NS if one.attempts < _QUICK_ATTEMPTS else _SLOW_AGAIN_NS)
        return [
            mavlink.MAVLink_command_long_message(
                system,
                component,
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
                0,
                one.number,
                one.interval_ns / 1000,
                0,
                0,
                0,
                0,
                0,
            )
            for one in due[:_AT_ONCE]
        ]

    def forget(self) -> None:
        """Ask for all of them again: the autopilot has started again."""
        for one in self._wanted.values():
            one.due_ns = one.heard_ns = one.attempts = 0

    @staticmethod
    def _comes(t_ns: int, one: _Wanted) -> bool:
        if one.must_be_asked and not one.attempts:
            return False
        return one.heard_ns > 0 and t_ns - one.heard_ns <= one.pause_ns


# --- parameters, by name ----------------------------------------------------------------------------------------------
# PX4 writes whole numbers into the bytes of the float that carries them, ArduPilot as the float of the same value.
# https://mavlink.io/en/services/parameter.html#parameter-encoding


_PERIOD_NS = _S
_SLOW_PERIOD_NS = 10 * _S
_FORMATS: Mapping[int, str] = {
    mavlink.MAV_PARAM_TYPE_UINT8: "<B3x",
    mavlink.MAV_PARAM_TYPE_INT8: "<b3x",
    mavlink.MAV_PARAM_TYPE_UINT16: "<H2x",
    mavlink.MAV_PARAM_TYPE_INT16: "<h2x",
    mavlink.MAV_PARAM_TYPE_UINT32: "<I",
    mavlink.MAV_PARAM_TYPE_INT32: "<i",
}


_EXACT = 1 << 24  # a whole number below this is itself in a float of 32 bits


def _is_whole(value: float) -> bool:
    return float(value).is_integer() and abs(value) < _EXACT


def _said(value: float) -> str:
    return f"{value:.0f}" if _is_whole(value) else f"{value:g}"


class ParameterState(NamedTuple):
    """One parameter: what it should be, what it is (None: not read yet)."""

    name: str
    expected: float
    value: Optional[float]

    @property
    def agrees(self) -> Optional[bool]:
        """Whether it is as configured, a whole number exactly: it may be made of bits; None: not read yet."""
        if self.value is None:
            return None
        if _is_whole(self.expected) and _is_whole(self.value):
            return self.value == self.expected
        return isclose(self.value, self.expected, rel_tol=1e-5, abs_tol=1e-6)

    @property
    def difference(self) -> str:
        """What it is and should be, in words; whole numbers with all of their digits."""
        is_now = "not read" if self.value is None else _said(self.value)
        return f"{self.name} is {is_now}, should be {_said(self.expected)}"


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
