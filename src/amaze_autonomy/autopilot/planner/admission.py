"""Whether a command of a mission is taken: a table of phases, and the reasons against it. Pure.

LAND and ABORT are taken always, of a silent vehicle as well: only a pilot who is seen to fly is a reason against them.
"""

from __future__ import annotations

from typing import Mapping, NamedTuple, Optional, Tuple

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase

from ..vehicle.modes import LANDING_MODES, is_foreign
from .loading import BEGINS_ANEW, NO_POSE
from .mission_vehicle import VehicleWatch

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
        tells_mode: it has told its flight mode lately.
        unknown: what nobody knows of it that must be known, in words; empty: nothing.
        phase: of the planner.
        session_id: that is loaded; None: none is.
        lost: the local position is needed for a takeoff, and is not there.
        landing: why the vehicle is landed, whatever else is asked for, in words; empty: it is not.
        other: what the autopilot node commands; empty: nothing.
        restarts: its mission would begin anew after a hold.
        steered: who has chosen the mode that it flies in, as messages agree, in words; empty: this planner.
        moved: who has moved it in its hold, in words; empty: nobody.
        begun_anew: why its local frame is not the one of the origin any more, in words; empty: it is, or not needed.
        misplaced: why the file is not taken off with as and where the vehicle stands, in words; empty: it is.
    """

    watch: VehicleWatch
    tells_mode: bool
    unknown: str
    phase: MissionPhase
    session_id: Optional[str]
    lost: bool
    landing: str = ""
    other: str = ""
    restarts: bool = False
    steered: str = ""
    moved: str = ""
    begun_anew: str = ""
    misplaced: str = ""


def refusal(standing: Standing, session_id: str, action: MissionAction) -> str:
    """Return why a command is refused; empty when it is taken."""
    watch = standing.watch
    if standing.tells_mode and watch.armed and watch.pilot:
        return f"the pilot has control (mode {watch.mode})"
    if standing.tells_mode and watch.armed and watch.may_be_pilot:
        return f"a pilot may have control (mode {watch.mode}): whether a transmitter is heard is not known yet"
    if action not in _GOOD_IN:
        return ""
    return _landed_or_silent(standing) or _out_of_place(standing, session_id, action) or _unfit(standing, action)


def _landed_or_silent(standing: Standing) -> str:
    if standing.unknown:
        return standing.unknown
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
    control = watch.control
    if not takes_off and (control.acts_unasked or (action is _A.RESUME and control.may_wait)):
        return f"the autopilot acts by its failsafe (mode {watch.mode})"
    if not takes_off and standing.steered and not control.unexplained:
        return standing.steered
    if not takes_off and (watch.mode in LANDING_MODES or watch.lands):
        return f"the vehicle lands (mode {watch.mode})"
    if action is _A.RESUME and standing.moved:
        return standing.moved
    if takes_off and standing.other:
        return f"the autopilot node commands {standing.other}"
    if takes_off and standing.restarts:
        return BEGINS_ANEW
    if takes_off and standing.begun_anew:
        return f"load it again: {standing.begun_anew}"
    return (NO_POSE if standing.lost else standing.misplaced) if takes_off else ""
