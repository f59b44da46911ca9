"""Errors of monitoring.

MonitoringError
 +-- SpecError                a specification that cannot be; also a ValueError
 +-- RestartRefusedError      a restart of something that is never restarted was asked for
 +-- UnknownComponentError    a name that is not watched; also a KeyError
"""

from __future__ import annotations

from typing import Tuple


class MonitoringError(Exception):
    """Base of all errors of monitoring."""


class SpecError(MonitoringError, ValueError):
    """A specification was made of values that cannot be.

    Args:
        spec: name of the specification's class, or of the component.
        field: name of the field.
        value: what it was given.
        expected: what it takes, in words.
    """

    def __init__(self, spec: str, field: str, value: object, expected: str) -> None:
        super().__init__(f"{spec}.{field} is {value!r}, must be {expected}")
        self.spec, self.field, self.value, self.expected = spec, field, value, expected


class RestartRefusedError(MonitoringError):
    """What the vehicle needs would have been restarted: it would be uncontrollable.

    Args:
        component: whose restart it is.
        kept: why its node is never ended, in words; empty: the component itself belongs to the PX4.
    """

    def __init__(self, component: str, kept: str = "") -> None:
        why = f"is not restarted: {kept}" if kept else "belongs to the PX4, which is never restarted"
        super().__init__(f"{component} {why}: the vehicle would be uncontrollable")
        self.component = component


class UnknownComponentError(MonitoringError, KeyError):
    """Something was said about a component, or a source of it, that is not watched."""

    def __init__(self, name: str, known: Tuple[str, ...]) -> None:
        super().__init__(name)
        self.name, self.known = name, known

    def __str__(self) -> str:
        return f"{self.name} is not watched; watched: {', '.join(self.known) or 'nothing'}"
