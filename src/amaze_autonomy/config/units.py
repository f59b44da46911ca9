"""The unit is the last part of a key: `age_limit_s`. Which units there are, and what one is in another."""

from __future__ import annotations

from typing import Mapping, Optional, Tuple

__all__ = ["UNITS", "converted", "split_unit", "unit_words"]

# suffix: (what is measured, size in the unit of that, how a number of it is said)
UNITS: Mapping[str, Tuple[str, float, str]] = {
    "s": ("time", 1.0, "in seconds"),
    "ms": ("time", 1e-3, "in milliseconds"),
    "us": ("time", 1e-6, "in microseconds"),
    "ns": ("time", 1e-9, "in nanoseconds"),
    "min": ("time", 60.0, "in minutes"),
    "h": ("time", 3600.0, "in hours"),
    "hz": ("rate", 1.0, "in Hz"),
    "khz": ("rate", 1e3, "in kHz"),
    "m": ("length", 1.0, "in metres"),
    "cm": ("length", 1e-2, "in centimetres"),
    "mm": ("length", 1e-3, "in millimetres"),
    "km": ("length", 1e3, "in kilometres"),
    "m_s": ("speed", 1.0, "in m/s"),
    "km_h": ("speed", 1 / 3.6, "in km/h"),
    "m_s2": ("acceleration", 1.0, "in m/s^2"),
    "g": ("acceleration", 9.80665, "in g"),
    "deg": ("angle", 1.0, "in degrees"),
    "rad": ("angle", 57.29577951308232, "in radians"),
    "deg_s": ("angular speed", 1.0, "in degrees per second"),
    "rad_s": ("angular speed", 57.29577951308232, "in radians per second"),
    "fraction": ("part", 1.0, "as a fraction of 1"),
    "percent": ("part", 1e-2, "in percent"),
    "v": ("voltage", 1.0, "in volts"),
    "mv": ("voltage", 1e-3, "in millivolts"),
    "bytes": ("size", 1.0, "in bytes"),
    "kb": ("size", 1e3, "in kilobytes"),
    "mb": ("size", 1e6, "in megabytes"),
    "gb": ("size", 1e9, "in gigabytes"),
    "mb_s": ("rate of data", 1e6, "in megabytes per second"),
}


def split_unit(name: str) -> Tuple[str, str]:
    """Split a key into what it means and its unit; the unit is empty when it has none."""
    for suffix in sorted(UNITS, key=len, reverse=True):
        if name.lower().endswith("_" + suffix) and len(name) > len(suffix) + 1:
            return name[: -len(suffix) - 1], suffix
    return name, ""


def unit_words(name: str) -> str:
    """Return the unit of a key as it is said of a number, e.g. "in seconds"; empty when it has none."""
    unit = split_unit(name)[1]
    return UNITS[unit][2] if unit else ""


def converted(value: float, given: str, wanted: str) -> Optional[str]:
    """Say what a value in one unit is in another, e.g. "500 ms are 0.5 s"; None when they measure different things."""
    if given not in UNITS or wanted not in UNITS or UNITS[given][0] != UNITS[wanted][0]:
        return None
    return f"{value:g} {given} are {value * UNITS[given][1] / UNITS[wanted][1]:g} {wanted}"
