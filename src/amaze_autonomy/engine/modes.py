"""Which flight modes of the PX4 are the answer to which command of ours (rule 4 of DESIGN.md: never fight the pilot).

A mode that matches the outstanding or the last confirmed command is ours. The planner lands by itself at the end of its
sequence: the modes of landing are its own while it says so, and somebody else's landing while it does not. Names as PX4
and mavros write them.
"""

from __future__ import annotations

from typing import FrozenSet, Mapping, Optional, Tuple

from .commands import MissionAction

__all__ = ["DIRECT_MODES", "HOLDING_MODES", "LANDING_MODES", "MODES", "ours"]

LANDING_MODES: FrozenSet[str] = frozenset({"AUTO.LAND", "AUTO.PRECLAND"})
HOLDING_MODES: FrozenSet[str] = frozenset({"AUTO.LOITER"})

_FLYING = frozenset({"AUTO.TAKEOFF", "AUTO.MISSION", "OFFBOARD"})

DIRECT_MODES: Mapping[MissionAction, FrozenSet[str]] = {
    MissionAction.TAKEOFF: _FLYING,
    MissionAction.RESUME: _FLYING,
    MissionAction.HOLD: HOLDING_MODES | {"OFFBOARD"},
    MissionAction.LAND: LANDING_MODES,
    MissionAction.ABORT: LANDING_MODES,
}
"""What a command itself asks for: such a mode is ours even while the autopilot's failsafe flag is set."""

MODES: Mapping[MissionAction, FrozenSet[str]] = {
    **DIRECT_MODES,
    MissionAction.TAKEOFF: _FLYING | HOLDING_MODES,  # PX4 loiters after its takeoff
}


def ours(
    mode: str, commanded: Tuple[MissionAction, ...], confirmed: Optional[MissionAction], *, lands: bool = False
) -> bool:
    """Return True when a flight mode matches an outstanding or the last confirmed command; an unknown mode does.

    Args:
        mode: the flight mode; empty: unknown.
        commanded: all commands since the last confirmed one: a late effect of the last but one is ours as well.
        confirmed: the last command that a mode answered.
        lands: the planner says that it lands.
    """
    if not mode or (lands and mode in LANDING_MODES):
        return True
    return any(mode in MODES[action] for action in commanded) or (confirmed is not None and mode in MODES[confirmed])
