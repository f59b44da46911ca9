"""Faults of what messages say: each is a change of one message, made when it is read.

A message is copied as far as the path of the field goes, never changed: others may hold it.
"""

from __future__ import annotations

import copy
import re
from math import inf, isfinite, nan
from numbers import Integral, Real
from random import Random
from typing import Any, Callable, List, Mapping, Optional, Sequence, Union

import numpy as np

from ..errors import EditError, FieldError
from ..fields import getter, kind_of
from .acting import Acting

__all__ = ["VALUES", "Edit", "changed"]

Edit = Callable[[Any], Any]
_Read = Callable[[], Optional[Any]]
_Make = Callable[[Acting, Sequence[int], Random, _Read], List[Edit]]
_STEP = re.compile(r"[A-Za-z]\w*|\[\d+\]")
_S = 1_000_000_000
_SILLY = 8191  # what range sensors of several makes say for "nothing seen"
_CLOCKS = ("header", "stamp", "time_boot_ms", "time_usec", "time_unix_usec")  # of ROS, and of MAVLink: it has no header


def changed(message: Any, path: str, change: Callable[[Any], Any]) -> Any:
    """Return a copy of a message with the value at a path changed; the message itself when it stays what it was.

    Raises:
        FieldError: the message has no such field.
    """
    old = getter(path)(message)  # says which field is not there
    new = change(old)
    if isinstance(new, (int, float, str)) and new == old:
        return message
    steps: List[Union[str, int]] = [int(s[1:-1]) if s[0] == "[" else s for s in _STEP.findall(path)]
    return _changed(message, steps, lambda _: new, path)


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
        if isinstance(value, (int, float)):
            return type(value)(_SILLY)
        raise EditError(path, "garbage", f"is no value but {kind_of(value)}; name one of its fields")

    return [lambda message: changed(message, path, silly)] * len(times)


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
        return _at_the_time_of(message, first) if running else first

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
