"""Numbers as an operator reads them. Unknown is "-"; time left is rounded down, never promised."""

from __future__ import annotations

from math import ceil, floor, pi
from typing import NamedTuple, Optional, Tuple

from ..engine.events import Check
from ..journal.report import limit_words
from .model import Snapshot, Telemetry

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


def limits(check: Check) -> str:
    """Return between what the value of a check must be, e.g. "3.5 ... 6.5 Hz"."""
    return limit_words(check, lambda each: quantity(each, check.unit)) or _UNKNOWN


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


# --- waypoints --------------------------------------------------------------------------------------------------------


def waypoints_reached(said: Snapshot) -> int:
    """Return how many waypoints of the file were reached, as far as it is sure."""
    return said.waypoint if _tells_reached(said) else max(0, said.waypoint - 1)


def waypoint_words(said: Snapshot) -> str:
    """Return the waypoint that it flies to and how many were reached, e.g. "3 of 8, 2 reached" or "8 of 8 reached"."""
    words = f"{said.waypoint} of {said.waypoints}"
    if _tells_reached(said):
        return f"{words} reached"
    return words if said.waypoint == 0 or said.state == "PILOT" else f"{words}, {waypoints_reached(said)} reached"


def _tells_reached(said: Snapshot) -> bool:
    """Return True where the waypoint that is told was reached: the planner tells that one from the landing on.

    Before that it tells the one that it flies to. Of a flight of the pilot it is not known which of both it is.
    """
    if said.state in ("TAKEOFF", "PILOT"):
        return False
    at_end = said.state == "MISSION" and said.waypoint == said.waypoints
    landed = said.telemetry.landed
    return said.step in ("descending", "touchdown") or landed == "LANDING" or (at_end and landed == "ON_GROUND")


# --- telemetry --------------------------------------------------------------------------------------------------------


class Reading(NamedTuple):
    """One instrument: its name, its value and its limit in words, and whether the value is to be looked at."""

    name: str
    value: str
    limit: str = ""
    warn: bool = False


OLD_S = 1.5
"""A status of the autopilot that is older is not of now: it comes five times a second."""
_NEAR = 0.9  # of a limit
_NO_FIX = ("no GPS", "no fix", "2D")


def readings(said: Telemetry, passed_s: float = 0.0) -> Tuple[Reading, ...]:
    """Return what a pilot reads in flight, in the order of an instrument panel; `passed_s` since it was said."""
    low = said.battery_fraction is None or said.battery_fraction <= (said.battery_limit or 0.0) + 0.1
    volts, lands = _tenths(said.battery_voltage, "V"), _limit("lands at", fraction(said.battery_limit))
    flown, longest = said.flight_time, said.flight_time_limit
    old = said.age is None or said.age + passed_s > OLD_S
    link_s = max(said.age or 0.0, said.link_age or 0.0) + passed_s if said.link_age is not None else None
    return (
        Reading(
            "battery",
            fraction(said.battery_fraction),
            ", ".join(each for each in (volts, lands) if each not in ("", _UNKNOWN)),
            low,
        ),
        _against("altitude", said.altitude, "above", said.altitude_limit),
        Reading("speed", _tenths(said.speed, "m/s")),
        Reading("climb", _tenths(said.climb, "m/s")),
        _against("home", said.distance, "beyond", said.distance_limit),
        Reading(
            "flight time",
            _UNKNOWN if flown is None else clock(flown),
            _limit("lands at", _UNKNOWN if longest is None else clock(longest)),
            flown is not None and longest is not None and flown > _NEAR * longest,
        ),
        Reading("mode", said.mode or _UNKNOWN),
        _motors(said),
        _gps(said),
        Reading("link", age(link_s), "", old or link_s is None or link_s > OLD_S),
    )


def _motors(said: Telemetry) -> Reading:
    if said.age is None or not said.armed_known:  # who stands beside them must not read what nobody knows
        return Reading("motors", _UNKNOWN, "", said.age is not None)
    return Reading("motors", "armed" if said.armed else "disarmed")


def _gps(said: Telemetry) -> Reading:
    bad = said.gps not in ("", "nominal") or said.gps_fix in _NO_FIX
    if not said.gps_fix:
        return Reading("GPS", said.gps or _UNKNOWN, "", bad)
    seen = "" if said.satellites is None else f", {said.satellites:.0f} satellites"
    return Reading("GPS", f"{said.gps_fix}{seen}", said.gps, bad)


def _against(name: str, value: Optional[float], where: str, limit: Optional[float]) -> Reading:
    near = value is not None and limit is not None and value > _NEAR * limit
    return Reading(name, _tenths(value, "m"), _limit(f"lands {where}", quantity(limit, "m")), near)


def _limit(words: str, value: str) -> str:
    return "" if value == _UNKNOWN else f"{words} {value}"


def _tenths(value: Optional[float], unit: str) -> str:
    return _UNKNOWN if value is None else f"{round(value, 1) + 0.0:.1f} {unit}"  # no -0.0
