"""ArduCopter's flight modes: numbers in HEARTBEAT.custom_mode; inside they have the names of the PX4 modes alike."""

from __future__ import annotations

from typing import Mapping, Optional

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.simulation.flight import Mode
from amaze_autonomy.simulation.px4.modes import DESCEND, OFFBOARD

__all__ = ["ARMABLE", "BLIND", "GUIDED", "STABILIZE", "base_mode", "custom_mode", "mode_of"]

STABILIZE, GUIDED = "STABILIZED", OFFBOARD
_NUMBERS: Mapping[str, int] = {
    STABILIZE: 0,
    "ALTCTL": 2,
    Mode.MISSION: 3,  # AUTO
    GUIDED: 4,
    Mode.POSITION: 5,  # LOITER: flown by the sticks
    Mode.RTL: 6,
    Mode.LAND: 9,
    Mode.LOITER: 17,  # BRAKE
}
_SHOWN: Mapping[str, str] = {Mode.TAKEOFF: GUIDED, DESCEND: Mode.LAND, "MANUAL": STABILIZE}
_NAMES: Mapping[int, str] = {number: name for name, number in _NUMBERS.items()}

#: modes in which it can be armed; AUTO only where AUTO_OPTIONS says so
ARMABLE = (STABILIZE, "ALTCTL", GUIDED, Mode.POSITION)
#: modes that need no position
BLIND = (STABILIZE, "ALTCTL", Mode.LAND)


def custom_mode(mode: str) -> int:
    """Return HEARTBEAT.custom_mode."""
    return _NUMBERS[_SHOWN.get(mode, mode)]


def base_mode(*, armed: bool) -> int:
    """Return HEARTBEAT.base_mode."""
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    return int(flags | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0))


def mode_of(number: int) -> Optional[str]:
    """Return the mode of a number; None when there is no such mode."""
    return _NAMES.get(number)
