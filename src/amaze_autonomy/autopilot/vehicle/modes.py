"""Flight modes: numbers of the autopilots, names as PX4 and mavros write them, and what each means for who has control.

ArduPilot's modes get the name of the PX4 mode that does the same, so that one engine reads both: GUIDED is OFFBOARD,
AUTO is AUTO.MISSION, BRAKE is AUTO.LOITER, and its LOITER, which is flown by the sticks, is POSCTL. ArduSub numbers its
modes otherwise: 9 is SURFACE there, not LAND.
"""

from __future__ import annotations

from typing import FrozenSet, Mapping, Optional, Tuple

from ..link.dialect import mavlink

__all__ = [
    "ARDUPILOT_NAMES",
    "LAND",
    "LANDING_MODES",
    "MANUAL_MODES",
    "NEVER_OURS",
    "is_foreign",
    "is_piloted",
    "mode_name",
    "mode_number",
    "px4_number",
]

LAND = "AUTO.LAND"
LANDING_MODES: FrozenSet[str] = frozenset({LAND, "AUTO.PRECLAND"})

_MAIN: Mapping[int, str] = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
}
_AUTO_MAIN = 4
_AUTO: Mapping[int, str] = {
    1: "AUTO.READY",
    2: "AUTO.TAKEOFF",
    3: "AUTO.LOITER",
    4: "AUTO.MISSION",
    5: "AUTO.RTL",
    6: "AUTO.LAND",
    7: "AUTO.RTGS",
    8: "AUTO.FOLLOW_TARGET",
    9: "AUTO.PRECLAND",
    10: "AUTO.VTOL_TAKEOFF",
}
_ARDUPILOT: Mapping[int, str] = {
    0: "STABILIZED",
    1: "ACRO",
    2: "ALTCTL",  # ALT_HOLD
    3: "AUTO.MISSION",
    4: "OFFBOARD",  # GUIDED
    5: "POSCTL",  # LOITER
    6: "AUTO.RTL",
    7: "ORBIT",  # CIRCLE
    9: "AUTO.LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "ALTCTL",  # AUTOTUNE
    16: "POSCTL",  # POSHOLD
    17: "AUTO.LOITER",  # BRAKE
    18: "THROW",
    20: "OFFBOARD",  # GUIDED_NOGPS
    21: "AUTO.RTL",  # SMART_RTL
    22: "POSCTL",  # FLOWHOLD
    23: "AUTO.FOLLOW_TARGET",
    24: "POSCTL",  # ZIGZAG
    27: "AUTO.RTL",  # AUTO_RTL
}
_UNKNOWN = "MODE."
_ARDUSUB: Mapping[int, str] = {
    0: "STABILIZED",
    1: "ACRO",
    2: "ALTCTL",  # ALT_HOLD
    3: "AUTO.MISSION",
    4: "OFFBOARD",  # GUIDED
    7: "ORBIT",  # CIRCLE
    9: f"{_UNKNOWN}SURFACE",
    16: "POSCTL",  # POSHOLD
    19: "MANUAL",
    20: f"{_UNKNOWN}MOTOR_DETECT",
    21: "ALTCTL",  # SURFTRAK
}
ARDUPILOT_NAMES: Mapping[str, str] = {
    "STABILIZE": "STABILIZED",
    "ALT_HOLD": "ALTCTL",
    "AUTO": "AUTO.MISSION",
    "GUIDED": "OFFBOARD",
    "LOITER": "POSCTL",
    "RTL": "AUTO.RTL",
    "CIRCLE": "ORBIT",
    "LAND": "AUTO.LAND",
    "AUTOTUNE": "ALTCTL",
    "POSHOLD": "POSCTL",
    "BRAKE": "AUTO.LOITER",
    "GUIDED_NOGPS": "OFFBOARD",
    "SMART_RTL": "AUTO.RTL",
    "SURFACE": f"{_UNKNOWN}SURFACE",
}
"""Names that mavros has for ArduPilot's modes."""

_ARDUPILOT_NUMBERS: Mapping[str, int] = {"AUTO.LAND": 9, "AUTO.MISSION": 3, "OFFBOARD": 4, "AUTO.LOITER": 17}

MANUAL_MODES: FrozenSet[str] = frozenset(
    {"MANUAL", "ALTCTL", "POSCTL", "ACRO", "STABILIZED", "RATTITUDE", "ORBIT", "DRIFT", "SPORT", "FLIP", "THROW"}
)
NEVER_OURS: FrozenSet[str] = frozenset(
    ["AUTO.RTL", "AUTO.RTGS", "AUTO.FOLLOW_TARGET", "AUTO.VTOL_TAKEOFF", "AUTO.READY", "TERMINATION"]
)


def is_piloted(mode: str) -> bool:
    """Return whether a mode is one that pilots choose; one that nobody knows (`MODE.n`) was not chosen by us either."""
    return mode in MANUAL_MODES or mode.startswith(_UNKNOWN)


def is_foreign(mode: str) -> bool:
    """Return whether a mode is one that we never command."""
    return is_piloted(mode) or mode in NEVER_OURS


def mode_name(autopilot: int, custom_mode: int, vehicle: int = mavlink.MAV_TYPE_QUADROTOR) -> str:
    """Return the name of a heartbeat's mode; one that nobody knows is named by its number, never left empty."""
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        names = _ARDUSUB if vehicle == mavlink.MAV_TYPE_SUBMARINE else _ARDUPILOT
        return names.get(custom_mode, f"{_UNKNOWN}{custom_mode}")
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    name = _AUTO.get(sub) if main == _AUTO_MAIN else _MAIN.get(main)
    if name == "POSCTL" and sub == 1:
        return "ORBIT"
    return name or f"{_UNKNOWN}{main}.{sub}"


def px4_number(name: str) -> Optional[Tuple[int, int]]:
    """Return main and sub mode, parameters 2 and 3 of MAV_CMD_DO_SET_MODE; None: no such mode."""
    for sub, known in _AUTO.items():
        if known == name:
            return _AUTO_MAIN, sub
    return next(((main, 0) for main, known in _MAIN.items() if known == name), None)


def mode_number(autopilot: int, name: str) -> Optional[Tuple[int, int]]:
    """Return parameters 2 and 3 of MAV_CMD_DO_SET_MODE for a mode; None: this autopilot has no such."""
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        number = _ARDUPILOT_NUMBERS.get(name)
        return None if number is None else (number, 0)
    return px4_number(name)
