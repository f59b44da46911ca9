"""Numbers as an operator reads them. Unknown is "-"; time left is rounded down, never promised."""

from __future__ import annotations

from math import ceil, floor, pi
from typing import Optional

__all__ = ["age", "clock", "duration", "fraction", "level", "quantity", "seconds"]

_UNKNOWN = "-"
_THREE_DIGITS = 100.0


def level(number: int) -> str:
    """Return the name of a message's level; one that nobody knows counts as the nearest."""
    return ("INFO", "WARNING", "ERROR", "ALARM")[min(3, max(0, number))]


def fraction(value: Optional[float]) -> str:
    """Return a fraction in percent, e.g. "72 %"."""
    return _UNKNOWN if value is None else f"{value * 100:.0f} %"


def quantity(value: Optional[float], unit: str) -> str:
    """Return a value with its unit: fractions in percent, radians in degrees, others with three digits or more."""
    if value is None:
        return _UNKNOWN
    if unit == "fraction":
        return fraction(value)
    if unit == "rad":
        return f"{value * 180.0 / pi:.1f} deg"
    digits = f"{value:.0f}" if abs(value) >= _THREE_DIGITS else f"{value:.3g}"
    return f"{digits} {unit}".strip()


def age(value_s: Optional[float]) -> str:
    """Return an age, e.g. "0.04 s" or "2.5 s"."""
    if value_s is None:
        return _UNKNOWN
    return f"{value_s:.2f} s" if abs(value_s) < 1.0 else f"{value_s:.1f} s"


def seconds(left_s: float) -> str:
    """Return a time left in words, e.g. "9 s" or "2 min 05 s"."""
    minutes, rest = divmod(max(0, floor(left_s)), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def clock(left_s: float) -> str:
    """Return a time left as a clock, e.g. "0:09" or "12:05"."""
    minutes, rest = divmod(max(0, floor(left_s)), 60)
    return f"{minutes}:{rest:02d}"


def duration(value_s: Optional[float]) -> str:
    """Return an estimated duration, rounded up, e.g. "45 s" or "5 min 10 s"."""
    if value_s is None:
        return _UNKNOWN
    minutes, rest = divmod(max(0, ceil(value_s)), 60)
    if minutes == 0:
        return f"{rest} s"
    return f"{minutes} min {rest:02d} s" if rest else f"{minutes} min"
