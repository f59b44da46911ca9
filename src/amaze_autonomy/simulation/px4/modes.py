"""PX4's flight modes as MAVLink carries them: custom_mode and base_mode of HEARTBEAT, parameters of DO_SET_MODE."""

from __future__ import annotations

from typing import Mapping, NamedTuple, Optional, Tuple

from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.simulation.vehicle.flight import Mode

__all__ = ["DESCEND", "OFFBOARD", "Wire", "base_mode", "custom_mode", "mode_of", "shown"]

OFFBOARD = "OFFBOARD"
DESCEND = "DESCEND"  # AUTO.LAND of a vehicle that does not know where it is

_CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_ARMED = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
_STABILIZE = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_MANUAL = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | _STABILIZE
_AUTO = mavlink.MAV_MODE_FLAG_AUTO_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED | _STABILIZE


class Wire(NamedTuple):
    """A mode on the wire.

    Args:
        main: PX4's main mode.
        sub: its sub-mode; 0: it has none.
        flags: of HEARTBEAT.base_mode, without "armed".
    """

    main: int
    sub: int
    flags: int


_MODES: Mapping[str, Wire] = {
    "MANUAL": Wire(1, 0, _MANUAL),
    "ALTCTL": Wire(2, 0, _MANUAL),
    Mode.POSITION: Wire(3, 0, _MANUAL),
    Mode.TAKEOFF: Wire(4, 2, _AUTO),
    Mode.LOITER: Wire(4, 3, _AUTO),
    Mode.MISSION: Wire(4, 4, _AUTO),
    Mode.RTL: Wire(4, 5, _AUTO),
    Mode.LAND: Wire(4, 6, _AUTO),
    OFFBOARD: Wire(6, 0, _AUTO),
    "STABILIZED": Wire(7, 0, _MANUAL),
}
_BY_NUMBERS: Mapping[Tuple[int, int], str] = {(wire.main, wire.sub): name for name, wire in _MODES.items()}


def shown(mode: str) -> str:
    """Return the mode that others are shown: PX4 has no number for a blind descent."""
    return Mode.LAND if mode == DESCEND else mode


def custom_mode(mode: str) -> int:
    """Return HEARTBEAT.custom_mode: the sub-mode in the highest byte, the main mode below it."""
    wire = _MODES[shown(mode)]
    return wire.sub << 24 | wire.main << 16


def base_mode(mode: str, *, armed: bool) -> int:
    """Return HEARTBEAT.base_mode."""
    return int(_CUSTOM | _MODES[shown(mode)].flags | (_ARMED if armed else 0))


def mode_of(main: int, sub: int) -> Optional[str]:
    """Return the mode of these numbers; None when there is no such mode."""
    return _BY_NUMBERS.get((main, sub))
