"""Which flight modes of the PX4 are the answer to which command of ours (rule 4 of DESIGN.md: never fight the pilot).

A mode that matches the outstanding or the last confirmed command is ours. The planner may land at the end of its
sequence by itself, so the modes of landing belong to TAKEOFF and RESUME as well. Names as PX4 and mavros write them.
"""

from __future__ import annotations

from typing import FrozenSet, Mapping, Optional, Tuple

from .commands import MissionAction

__all__ = ["LANDING_MODES", "MODES", "ours"]

LANDING_MODES: FrozenSet[str] = frozenset({"AUTO.LAND", "AUTO.PRECLAND"})

_FLYING = frozenset({"AUTO.TAKEOFF", "AUTO.MISSION", "OFFBOARD"})

MODES: Mapping[MissionAction, FrozenSet[str]] = {
    MissionAction.TAKEOFF: _FLYING | LANDING_MODES | {"AUTO.LOITER"},
    MissionAction.RESUME: _FLYING | LANDING_MODES,
    MissionAction.HOLD: frozenset({"AUTO.LOITER", "OFFBOARD"}),
    MissionAction.LAND: LANDING_MODES,
    MissionAction.ABORT: LANDING_MODES,
}


def ours(mode: str, commanded: Tuple[MissionAction, ...], confirmed: Optional[MissionAction]) -> bool:
    """Return True when a flight mode matches an outstanding or the last confirmed command; an unknown mode does.

    `commanded` holds all commands since the last confirmed one: a late effect of the last but one is ours as well.
    """
    if not mode:
        return True
    return any(mode in MODES[action] for action in commanded) or (confirmed is not None and mode in MODES[confirmed])
