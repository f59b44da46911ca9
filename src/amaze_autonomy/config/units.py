"""The unit is the last part of a key: `age_limit_s`. Which units there are, and what one is in another."""

from __future__ import annotations

from typing import Mapping, Optional, Tuple

__all__ = ["UNITS", "converted", "split_unit", "unit_words"]

# suffix: (what is measured, size in the unit of that, how it is said)
UNITS: Mapping[str, Tuple[str, float, str]] = {
    "s": ("time", 1.0, "seconds"),
    "ms": ("time", 1e-3, "milliseconds"),
    "us": ("time", 1e-6, "microseconds"),
    "ns": ("time", 1e-9, "nanoseconds"),
    "min": ("time", 60.0, "minutes"),
    "h": ("time", 3600.0, "hours"),
    "hz": ("rate", 1.0, "Hz"),
    "khz": ("rate", 1e3, "kHz"),
    "m": ("length", 1.0, "metres"),
    "cm": ("length", 1e-2, "centimetres"),
    "mm": ("length", 1e-3, "millimetres"),
    "km": ("length", 1e3, "kilometres"),
    "m_s": ("speed", 1.0, "m/s"),
    "km_h": ("speed", 1 / 3.6, "km/h"),
    "m_s2": ("acceleration", 1.0, "m/s^2"),
    "g": ("acceleration", 9.80665, "g"),
    "deg": ("angle", 1.0, "degrees"),
    "rad": ("angle", 57.29577951308232, "radians"),
    "deg_s": ("angular speed", 1.0, "degrees per second"),
    "rad_s": ("angular speed", 57.29577951308232, "radians per second"),
    "fraction": ("part", 1.0, "a fraction of 1"),
    "percent": ("part", 1e-2, "percent"),
    "v": ("voltage", 1.0, "volts"),
    "mv": ("voltage", 1e-3, "millivolts"),
    "bytes": ("size", 1.0, "bytes"),
    "kb": ("size", 1e3, "kilobytes"),
    "mb": ("size", 1e6, "megabytes"),
    "gb": ("size", 1e9, "gigabytes"),
}


def split_unit(name: str) -> Tuple[str, str]:
    """Split a key into what it means and its unit; the unit is empty when it has none."""
    for suffix in sorted(UNITS, key=len, reverse=True):
        if name.lower().endswith("_" + suffix) and len(name) > len(suffix) + 1:
            return name[: -len(suffix) - 1], suffix
    return name, ""


def unit_words(name: str) -> str:
    """Return the unit of a key as it is said, e.g. "seconds"; empty when it has none."""
    unit = split_unit(name)[1]
    return UNITS[unit][2] if unit else ""


def converted(value: float, given: str, wanted: str) -> Optional[str]:
    """Say what a value in one unit is in another, e.g. "500 ms are 0.5 s"; None when they measure different things."""
    if given not in UNITS or wanted not in UNITS or UNITS[given][0] != UNITS[wanted][0]:
        return None
    return f"{value:g} {given} are {value * UNITS[given][1] / UNITS[wanted][1]:g} {wanted}"
