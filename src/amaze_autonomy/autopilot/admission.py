"""Whether a command of a mission is taken: a table of phases, and the reasons against it. Pure.

LAND and ABORT are taken always, of a silent vehicle as well: only a pilot who is seen to fly is a reason against them.
"""

from __future__ import annotations

from typing import Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase

from .mission_vehicle import VehicleWatch
from .modes import LANDING_MODES, is_foreign

__all__ = ["Standing", "refusal"]

_P, _A = MissionPhase, MissionAction

#: phases in which a command is taken; any other refuses it. LAND and ABORT are taken always.
_GOOD_IN: Mapping[MissionAction, Tuple[MissionPhase, ...]] = {
    _A.TAKEOFF: (_P.LOADED,),
    _A.HOLD: (_P.TAKING_OFF, _P.FLYING, _P.HOLDING),
    _A.RESUME: (_P.TAKING_OFF, _P.FLYING, _P.HOLDING),
}
_WORDS: Mapping[MissionAction, str] = {_A.TAKEOFF: "fly", _A.HOLD: "hold", _A.RESUME: "resume"}


class Standing(NamedTuple):
    """How it is when a command comes.

    Args:
        watch: the vehicle.
        known: it speaks.
        phase: of the planner.
        session_id: that is loaded; None: none is.
        lost: the local position is needed for a takeoff, and is not there.
        landing: why the vehicle is landed, whatever else is asked for, in words; empty: it is not.
        other: what the autopilot node commands; empty: nothing.
    """

    watch: VehicleWatch
    known: bool
    phase: MissionPhase
    session_id: Optional[str]
    lost: bool
    landing: str = ""
    other: str = ""


def refusal(standing: Standing, session_id: str, action: MissionAction) -> str:
    """Return why a command is refused; empty when it is taken."""
    watch = standing.watch
    if standing.known and watch.armed and watch.pilot:
        return f"the pilot has control (mode {watch.mode})"
    if action not in _GOOD_IN:
        return ""
    return _landed_or_silent(standing) or _out_of_place(standing, session_id, action) or _unfit(standing, action)


def _landed_or_silent(standing: Standing) -> str:
    if not standing.known:
        return "the vehicle is silent"
    return f"{standing.landing}: it stands until the vehicle is disarmed" if standing.landing else ""


def _out_of_place(standing: Standing, session_id: str, action: MissionAction) -> str:
    if session_id != standing.session_id:
        return f"session {session_id!r} is not the one that is loaded"
    if standing.phase not in _GOOD_IN[action]:
        return f"there is nothing to {_WORDS[action]} in phase {standing.phase.name}"
    if action is not _A.TAKEOFF and not standing.watch.armed:
        return f"there is nothing to {_WORDS[action]} on the ground: ABORT cancels the takeoff"
    return ""


def _unfit(standing: Standing, action: MissionAction) -> str:
    watch, takes_off = standing.watch, action is _A.TAKEOFF
    if watch.armed and is_foreign(watch.mode):
        return f"the autopilot flies by itself (mode {watch.mode})"
    if not takes_off and (watch.mode in LANDING_MODES or watch.lands):
        return f"the vehicle lands (mode {watch.mode})"
    if takes_off and standing.other:
        return f"the autopilot node commands {standing.other}"
    return "there is no fresh local position" if takes_off and standing.lost else ""
