"""Base of the specifications: values are checked when they are made, and an error names the field."""

from __future__ import annotations

from math import isfinite, pi

from .errors import SpecError

__all__ = ["Checked", "is_command", "is_number"]


class Checked:
    """Checks that the specifications share; each raises a `SpecError` that names the field."""

    def _need(self, name: str, good: bool, expected: str) -> None:  # noqa: FBT001
        if not good:
            raise SpecError(getattr(self, "name", "") or type(self).__name__, name, getattr(self, name), expected)

    def _whole(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, type(value) is int and value > 0, "a whole number of nanoseconds above 0")

    def _count(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, type(value) is int and value > 0, "a whole number above 0")

    def _above_zero(self, *names: str) -> None:
        for name in names:
            self._need(name, is_number(getattr(self, name)) and getattr(self, name) > 0, "a number above 0")

    def _not_negative(self, *names: str) -> None:
        for name in names:
            self._need(name, is_number(getattr(self, name)) and getattr(self, name) >= 0, "a number, 0 or above")

    def _angle(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            self._need(name, is_number(value) and 0 < value <= pi / 2, "an angle above 0, at most pi/2 rad")


def is_number(value: object) -> bool:
    """Return True for a finite int or float; a bool is not a number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)


def is_command(value: object) -> bool:
    """Return True for a tuple of texts with a program in front."""
    return (
        isinstance(value, tuple) and len(value) > 0 and all(isinstance(part, str) for part in value) and bool(value[0])
    )
