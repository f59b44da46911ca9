"""The rows of the pre-flight table and the names of the checks that make them."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from math import isfinite
from typing import Mapping, Optional, Tuple

__all__ = ["CHECKS", "Check", "CheckName", "CheckTraits", "Verdict", "finite"]


class CheckName(enum.Enum):
    """The pre-flight checks, in the order in which they are asked and shown."""

    WATCHDOG = "watchdog"
    BATTERY = "battery"
    AUTOPILOT = "autopilot"
    ON_GROUND = "on_ground"
    STATE_ESTIMATION = "state_estimation"


@dataclass(frozen=True)
class CheckTraits:
    """What is special about a check.

    Args:
        asks: fields of its request (`commands.RunCheck`) besides the check itself.
        watches: its first accepted answer starts the watching, and may take until all is up; what failed may be fixed
            meanwhile, and every component is listed.
    """

    asks: Tuple[str, ...] = ()
    watches: bool = False


CHECKS: Mapping[CheckName, CheckTraits] = {
    CheckName.WATCHDOG: CheckTraits(("mission_id", "required", "startup_time_ns"), watches=True),
    CheckName.BATTERY: CheckTraits(("required_fraction",)),
    CheckName.AUTOPILOT: CheckTraits(),
    CheckName.ON_GROUND: CheckTraits(),
    CheckName.STATE_ESTIMATION: CheckTraits(),
}


class Verdict(enum.Enum):
    """What came of one row of a check. Only PASS and WARN let a vehicle take off."""

    PASS = "pass"  # noqa: S105 - a verdict
    WARN = "warn"
    FAIL = "fail"
    UNKNOWN = "unknown"


def finite(value: Optional[float]) -> Optional[float]:
    """Return the value, or None for NaN, infinity and None: unknown is said in one way."""
    return value if value is not None and isfinite(value) else None


@dataclass(frozen=True)
class Check:
    """One row of the pre-flight table.

    Args:
        name: what was checked, e.g. "battery fraction".
        verdict: what came of it.
        value: what was measured, in `unit`; None when unknown.
        limit: what it was compared with, in `unit`; None when there is none.
        unit: e.g. "fraction", "m", "rad"; empty when it has none.
        age_s: age of the value in seconds; None when unknown.
        advice: what a person can do about it.
        heals: it comes by itself after a start (a first message, the home position): asked again until a limit.
    """

    name: str
    verdict: Verdict
    value: Optional[float] = None
    limit: Optional[float] = None
    unit: str = ""
    age_s: Optional[float] = None
    advice: str = ""
    heals: bool = False

    def __post_init__(self) -> None:
        for field in ("value", "limit", "age_s"):
            object.__setattr__(self, field, finite(getattr(self, field)))

    @property
    def passed(self) -> bool:
        """True when the row lets a vehicle take off."""
        return self.verdict in (Verdict.PASS, Verdict.WARN)
