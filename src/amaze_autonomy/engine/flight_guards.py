"""The conditions of a flight: takeoff, pilot, what is wrong, hold, touchdown, landing."""

from __future__ import annotations

from typing import Optional

from . import failures
from .commands import Value
from .events import Landed, MissionPhase, Outcome, VehicleLanded
from .guards import Guard, Values, holds_if
from .modes import LANDING_MODES
from .rules import LOSSES
from .state import State
from .timers import passed
from .turn import Turn

__all__ = [
    "airborne",
    "armed",
    "armed_by_others",
    "at_takeoff_height",
    "cancelled",
    "cancelled_on_ground",
    "down",
    "file_done",
    "ground_armed",
    "in_flight",
    "interrupted",
    "landing_shown",
    "last_leg",
    "motion_refused",
    "must_alarm",
    "must_land",
    "must_land_both",
    "must_wait",
    "not_alarmed",
    "not_overdue_alarmed",
    "nothing_waited_for",
    "on_the_ground",
    "one_route_only",
    "planner_in",
    "started_armed",
    "taken_over",
    "touched_down",
    "vehicle_known",
]

_REFUSED = (Outcome.REFUSED, Outcome.UNAVAILABLE)
_BOTH_ROUTES = frozenset(loss.name for loss in LOSSES if loss.both_routes)
_ALARM = frozenset(loss.name for loss in LOSSES if loss.alarm)


def started_armed(turn: Turn) -> Optional[Values]:
    """The engine was started, with no flight of its own to resume, while the vehicle is armed."""
    fresh_start = turn.state.sessions == 0 and turn.state.armed_at_start is True and turn.armed()
    return holds_if(fresh_start and not turn.state.in_flight, Value("armed at start", True))


def motion_refused(turn: Turn) -> Optional[Values]:
    """The planner refused the last command, or is not there."""
    refused = turn.state.motion_outcome in _REFUSED
    return holds_if(refused, Value("planner", turn.state.motion_message or "refused"))


def down(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, disarmed and ON_GROUND."""
    return holds_if(turn.down(), Value("armed", False), Value("landed", "ON_GROUND"))


def on_the_ground(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, ON_GROUND."""
    return holds_if(turn.on_ground(), Value("landed", "ON_GROUND"))


def armed(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, that it is armed."""
    return holds_if(turn.armed(), Value("armed", True))


def airborne(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, that it has left the ground."""
    return holds_if(turn.airborne(), Value("landed", turn.state.autopilot.landed.name if turn.state.autopilot else ""))


def at_takeoff_height(turn: Turn) -> Optional[Values]:
    """The vehicle is at takeoff height."""
    status, limit = turn.vehicle(), turn.limits.takeoff_height_m
    reached = status is not None and status.height_m is not None and status.height_m >= limit
    return holds_if(reached, Value("height", status.height_m if status else None, limit, "m"))


def taken_over(turn: Turn) -> Optional[Values]:
    """The pilot has control, the autopilot acts by itself, or the mode is none of ours (rule 4)."""
    status = turn.vehicle()
    if status is None or status.armed is False:
        return None
    if status.pilot_in_control:
        return (Value("reason", "the pilot has control"), Value("flight mode", status.mode))
    if status.failsafe:
        return (Value("reason", "a failsafe of the autopilot is active"), Value("flight mode", status.mode))
    return turn.foreign_mode or None


def armed_by_others(turn: Turn) -> Optional[Values]:
    """The vehicle is armed, and it was not us."""
    return holds_if(not turn.state.in_flight and turn.armed(), Value("reason", "it was armed, and not by us"))


def in_flight(turn: Turn) -> Optional[Values]:
    """From the TAKEOFF command until the vehicle says, freshly, both disarmed and ON_GROUND."""
    return holds_if(turn.state.in_flight, Value("in flight", True))


def must_land(turn: Turn) -> Optional[Values]:
    """Something means to land."""
    worst = failures.worst(turn.state) if turn.state.in_flight else ()
    return failures.values_of(worst[0], turn.now) if worst else None


def must_land_both(turn: Turn) -> Optional[Values]:
    """Something means to land, and by both routes at once."""
    lost = [f for f in turn.state.failures if f.name in _BOTH_ROUTES] if turn.state.in_flight else []
    return failures.values_of(lost[0], turn.now) if lost else None


def must_alarm(turn: Turn) -> Optional[Values]:
    """Something is lost that the pilot must know at once."""
    lost = [f for f in turn.state.failures if f.name in _ALARM] if turn.state.in_flight else []
    return failures.values_of(lost[0], turn.now) if lost and not turn.state.alarmed else None


def must_wait(turn: Turn) -> Optional[Values]:
    """Something is waited for."""
    held = failures.waiting(turn.state) if turn.state.in_flight else ()
    return tuple(value for failure in held for value in failures.values_of(failure, turn.now)) or None


def nothing_waited_for(turn: Turn) -> Optional[Values]:
    """All that was waited for is back, dropped, or resumed; on the ground there is nothing to go on with."""
    return holds_if(turn.state.in_flight and must_wait(turn) is None)


def vehicle_known(turn: Turn) -> Optional[Values]:
    """The vehicle is heard freshly; after a restart of the engine nothing is known of it at first."""
    return holds_if(turn.vehicle() is not None)


def interrupted(state: State) -> Guard:
    """Hold when the hold interrupted this state."""
    return lambda turn: holds_if(turn.state.interrupted is state)


def planner_in(*phases: MissionPhase) -> Guard:
    """Hold when the planner says, since the last command, one of these phases."""

    def guard(turn: Turn) -> Optional[Values]:
        planner = turn.state.planner
        said = planner is not None and planner.phase in phases and planner.t_ns > turn.state.motion_ns
        return holds_if(said, Value("planner phase", planner.phase.name if planner else ""))

    return guard


def touched_down(turn: Turn) -> Optional[Values]:
    """Disarmed and ON_GROUND after a flight, and the landing detection does not contradict, or not for longer."""
    state = turn.state
    if not state.was_armed or turn.flies_again() or (state.in_flight and not turn.down()):
        return None
    detection = turn.detection()
    if detection is Landed.AIRBORNE and not passed("confirm_limit", state, turn.rules, turn.now):
        return None
    return (Value("armed", False), Value("landed", "ON_GROUND"), Value("landing detection", detection.name))


def file_done(turn: Turn) -> Optional[Values]:
    """Touched down, and the planner says that the file's sequence has ended."""
    planner, values = turn.state.planner, touched_down(turn)
    if values is None or planner is None or planner.phase is not MissionPhase.LANDED:
        return None
    last = planner.waypoint >= planner.waypoints
    return (*values, Value("waypoint", planner.waypoint, planner.waypoints)) if last else None


def last_leg(turn: Turn) -> Optional[Values]:
    """No waypoint file and no repetition is left."""
    state = turn.state
    mission = state.mission
    if mission is None:
        return ()
    last = state.file_index + 1 >= mission.files and state.repetition + 1 >= mission.repetitions
    return holds_if(
        last,
        Value("file", state.file_index + 1, mission.files),
        Value("repetition", state.repetition + 1, mission.repetitions),
    )


def cancelled_on_ground(turn: Turn) -> Optional[Values]:
    """Disarmed and ON_GROUND without ever having been armed, and the landing was accepted or its limit has passed."""
    state = turn.state
    if state.was_armed or not turn.down():
        return None
    settled = state.motion_outcome is Outcome.ACCEPTED or passed("never_armed", state, turn.rules, turn.now)
    return holds_if(settled, Value("armed", False), Value("landed", "ON_GROUND"), Value("was armed", False))


def landing_shown(turn: Turn) -> Optional[Values]:
    """The vehicle shows that it lands: on the ground, or, up to the limit, landing mode or sustained descent.

    Before lift-off ON_GROUND shows nothing while it is armed: the takeoff may still be on its way.
    """
    status = turn.vehicle()
    before_lift_off = status is not None and status.armed is not False and not turn.state.was_airborne
    overdue = passed("land_limit", turn.state, turn.rules, turn.now)
    if status is None or (overdue and status.landed is not VehicleLanded.ON_GROUND):
        return None
    if status.mode in LANDING_MODES:
        return (Value("flight mode", status.mode),)
    if status.landed is VehicleLanded.LANDING or (status.landed is VehicleLanded.ON_GROUND and not before_lift_off):
        return (Value("landed", status.landed.name),)
    sustained = passed("descent_time", turn.state, turn.rules, turn.now)
    return holds_if(
        sustained, Value("vertical speed", status.vertical_speed_m_s, -turn.limits.descent_speed_m_s, "m/s")
    )


def ground_armed(turn: Turn) -> Optional[Values]:
    """On the ground for a while, still armed, and nothing says that it flies."""
    flies = turn.detection() is Landed.AIRBORNE
    if not turn.on_ground() or not turn.armed() or flies:
        return None
    return holds_if(
        passed("ground_disarm_after", turn.state, turn.rules, turn.now),
        Value("landed", "ON_GROUND"),
        Value("armed", True),
    )


def cancelled(turn: Turn) -> Optional[Values]:
    """Disarmed and ON_GROUND, and it was armed before or the planner has accepted the ABORT."""
    settled = turn.state.was_armed or turn.state.motion_outcome is Outcome.ACCEPTED
    return holds_if(settled and turn.down(), Value("armed", False), Value("landed", "ON_GROUND"))


def not_alarmed(turn: Turn) -> Optional[Values]:
    """The pilot was not alarmed yet."""
    return holds_if(not turn.state.alarmed)


def not_overdue_alarmed(turn: Turn) -> Optional[Values]:
    """The pilot was not yet alarmed about the limit of the landing."""
    return holds_if(not turn.state.overdue_alarmed)


def one_route_only(turn: Turn) -> Optional[Values]:
    """The landing was commanded by the planner's route alone."""
    return holds_if(turn.state.second_route_ns is None)
