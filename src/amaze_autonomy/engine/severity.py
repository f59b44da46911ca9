"""Severities, codes, verbs, and the two tables that connect them (DESIGN.md section 4).

A component has a *severity*: how bad is it when it fails? The watchdog turns its health into a *code*: its condition
now. The *verb* says what is done about it. `SEVERITIES` is the whole of the rule; `verb_of` reads it.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Mapping, Optional

__all__ = [
    "SEVERITIES",
    "Code",
    "ComponentRule",
    "Restart",
    "Severity",
    "SeverityRow",
    "Verb",
    "row_of_code",
    "verb_of",
]


class Code(enum.IntEnum):
    """Condition of a component on the wire; the watchdog publishes the highest."""

    NOMINAL = 1
    NON_CRITICAL = 2
    INCONVENIENT = 4
    HOLD = 8
    ABORT = 16


class Severity(enum.Enum):
    """How bad the failure of a component is."""

    LOW = "low"
    MODERATE = "moderate"
    HIGH = "high"
    HIGHEST = "highest"


class Verb(enum.IntEnum):
    """What is done about a failure. Ordered: the worst wins."""

    CONTINUE = 1
    WAIT = 2
    LAND = 3
    PILOT = 4


class Restart(enum.Enum):
    """What the watchdog does about a component that failed."""

    NONE = "none"
    TRYING = "trying"
    GIVEN_UP = "given_up"


@dataclass(frozen=True)
class SeverityRow:
    """One row of the severity table.

    Args:
        code: the watchdog's code when the component fails.
        code_given_up: its code once restarting has failed.
        verb: what is done at first.
        then: what is done when a wait has ended without success; None when `verb` does not wait.
    """

    code: Code
    code_given_up: Code
    verb: Verb
    then: Optional[Verb]


SEVERITIES: Mapping[Severity, SeverityRow] = {
    Severity.LOW: SeverityRow(Code.NON_CRITICAL, Code.NON_CRITICAL, Verb.CONTINUE, None),
    Severity.MODERATE: SeverityRow(Code.INCONVENIENT, Code.INCONVENIENT, Verb.WAIT, Verb.CONTINUE),
    Severity.HIGH: SeverityRow(Code.HOLD, Code.ABORT, Verb.WAIT, Verb.LAND),
    Severity.HIGHEST: SeverityRow(Code.ABORT, Code.ABORT, Verb.LAND, None),
}


@dataclass(frozen=True)
class ComponentRule:
    """One row of the decision table: a component and what its failure means.

    Args:
        name: as in sensors.yaml and on the wire, e.g. "mission_camera".
        group: "px4" or "other"; components of the PX4 are never restarted.
        restart: the watchdog may restart it.
        severity: its severity, unless the mission names another.
        wait_limit_ns: how long a flight may wait for it, all its failures together.
    """

    name: str
    group: str
    restart: bool
    severity: Severity
    wait_limit_ns: int

    def __post_init__(self) -> None:
        if self.group == "px4" and self.restart:
            raise ValueError(
                f"{self.name}: a component of the PX4 is never restarted, the vehicle would be uncontrollable"
            )
        if self.wait_limit_ns < 0:
            raise ValueError(f"{self.name}: wait_limit_ns is {self.wait_limit_ns}, must not be negative")


def row_of_code(code: Code) -> Severity:
    """Return the severity that a component gets when nobody listed it: the row of its code."""
    return _ROW_OF_CODE[code]


_ROW_OF_CODE: Mapping[Code, Severity] = {
    Code.NOMINAL: Severity.LOW,
    Code.NON_CRITICAL: Severity.LOW,
    Code.INCONVENIENT: Severity.MODERATE,
    Code.HOLD: Severity.HIGH,
    Code.ABORT: Severity.HIGHEST,
}


def verb_of(severity: Severity, code: Code) -> Optional[Verb]:
    """Return what is done at first about a component of a severity at a code; None when nothing is wrong.

    1 clears; 2 is always `continue`; 4 and 8 take the row's verb; 16 is always `land`.
    """
    if code == Code.NOMINAL:
        return None
    if code == Code.NON_CRITICAL:
        return Verb.CONTINUE
    if code == Code.ABORT:
        return Verb.LAND
    return SEVERITIES[severity].verb
