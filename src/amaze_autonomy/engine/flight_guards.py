"""The conditions of a flight: takeoff, pilot, what is wrong, hold, touchdown, landing."""

from __future__ import annotations

from typing import Callable, Mapping, Optional

from . import failsafe
from .commands import Seen, Value, because
from .context import FLYING_MODES, HOLDING_MODES, LANDING_MODES, Context, fast, says_nothing
from .events import MissionPhase, Outcome, VehicleLanded
from .failsafe import FAILSAFE_CONDITIONS
from .guards import Guard, holds_if
from .state import Failure, OutreachKind, State, Step
from .timers import passed

_REFUSED = (Outcome.REFUSED, Outcome.UNAVAILABLE)
_BOTH_ROUTES = frozenset(row.name for row in FAILSAFE_CONDITIONS if row.both_routes)
_ALARM = frozenset(row.name for row in FAILSAFE_CONDITIONS if row.alarm)


def started_armed(context: Context) -> Optional[Seen]:
    """The engine was started, with no flight of its own to resume, while the vehicle was armed, and it still is.

    So it is after a landing was given up, where the vehicle says where it is: what is not known was why it was.
    """
    state = context.state
    still = state.armed_at_start is True and context.armed() and not state.flight.active
    ended = state.state in (State.DATA_CLEANUP, State.MISSION_ENDED) or state.session.outreach is OutreachKind.DATA
    return holds_if(still and not (ended and not context.tells_place()), Value("armed at start", True))


def motion_refused(context: Context) -> Optional[Seen]:
    """The planner refused the last command, or is not there."""
    refused = context.state.flight.motion.outcome in _REFUSED
    return because("planner", context.state.flight.motion.message or "refused") if refused else None


def down(context: Context) -> Optional[Seen]:
    """The vehicle says, freshly, disarmed and ON_GROUND."""
    return holds_if(context.down(), Value("armed", False), Value("landed", "ON_GROUND"))


def stays_down(context: Context) -> Optional[Seen]:
    """Several statuses agree on disarmed and ON_GROUND."""
    return holds_if(context.stays_down(), Value("armed", False), Value("landed", "ON_GROUND"))


def on_the_ground(context: Context) -> Optional[Seen]:
    """The vehicle says, freshly, ON_GROUND."""
    return holds_if(context.on_ground(), Value("landed", "ON_GROUND"))


def stands(context: Context) -> Optional[Seen]:
    """The vehicle has said ON_GROUND for longer than one wrong status lasts."""
    return holds_if(context.stands(), Value("landed", "ON_GROUND"))


def armed(context: Context) -> Optional[Seen]:
    """The vehicle says, freshly, that it is armed."""
    return holds_if(context.armed(), Value("armed", True))


def airborne(context: Context) -> Optional[Seen]:
    """The vehicle says, freshly, that it has left the ground."""
    return holds_if(
        context.airborne(),
        Value("landed", context.state.peers.autopilot.landed.name if context.state.peers.autopilot else ""),
    )


def at_takeoff_height(context: Context) -> Optional[Seen]:
    """The vehicle is at takeoff height, and several statuses have said that it flies."""
    status, limit = context.vehicle(), context.limits.takeoff_height_m
    reached = status is not None and status.height_m is not None and status.height_m >= limit
    height = Value("height", status.height_m if status else None, limit, "m")
    return holds_if(reached and context.state.flight.was_airborne, height)


def taken_over(context: Context) -> Optional[Seen]:
    """Several statuses agree: the pilot or a failsafe has control, or the mode is none of ours (rule 4)."""
    return _taken(context) if context.taken() else None


def takeover_begins(context: Context) -> Optional[Seen]:
    """Two statuses say that somebody else has control, not confirmed yet; nothing is commanded since the first.

    After a single one nobody is told: the planner's word that it lands may be a moment behind the landing mode.
    """
    agreed = context.state.vehicle.takeover
    again = agreed is not None and agreed.statuses > 1
    return _taken(context) if again and context.suspected() and not context.state.flight.takeover_noted else None


def takeover_denied(context: Context) -> Optional[Seen]:
    """Somebody else seemed to have control, and the vehicle answers to us."""
    denied = context.state.vehicle.takeover is None and context.vehicle() is not None and not context.unheard()
    return holds_if(context.state.flight.takeover_noted and denied)


def _taken(context: Context) -> Seen:
    status = context.state.peers.autopilot
    return because("reason", context.state.vehicle.takeover_reason, Value("flight mode", status.mode if status else ""))


def armed_by_others(context: Context) -> Optional[Seen]:
    """The vehicle is armed, and it was not us; several statuses agree."""
    if context.state.flight.active or not (context.taken() and context.armed()):
        return None
    return because("reason", "armed by somebody else")


def still_flies(context: Context) -> Optional[Seen]:
    """Its flight seemed over, and it says that it is in the air, armed: it never landed, for nobody arms it there."""
    state, status = context.state, context.vehicle()
    if state.flight.active or status is None or not (context.armed() and context.never_landed()):
        return None
    sure = state.vehicle.aloft is not None and state.vehicle.aloft.statuses > 1
    landed = Value("landed", status.landed.name)
    mine = state.vehicle.takeover is None
    return because("reason", "it is still in the air", landed) if sure and mine else None


def armed_late(context: Context) -> Optional[Seen]:
    """It is armed in a mode of ours, after a takeoff of ours was called off: our ARM took effect late."""
    armed, agreed = context.may_arm_late() and context.armed(), context.state.vehicle.motors
    mine = armed and context.state.vehicle.takeover is None and agreed is not None and agreed.statuses > 1
    return because("reason", "it was armed by us, after its takeoff was called off") if mine else None


def lands(context: Context) -> Optional[Seen]:
    """It is landing, whoever lands it."""
    return because("reason", "it is landing") if context.lands() else None


def hold_shown(context: Context) -> Optional[Seen]:
    """Flight mode or standing still shows that it holds."""
    status = context.vehicle()
    mode, across, climb = ("", None, None)
    if status is not None:
        mode, across, climb = status.mode, status.horizontal_speed_m_s, status.vertical_speed_m_s
    limit = context.limits.hold_speed_m_s
    shown = (Value("flight mode", mode), Value("speed over ground", across, limit, "m/s"))
    still = () if mode in HOLDING_MODES else (Value("vertical speed", climb, limit, "m/s"),)
    return holds_if(context.holds(), *shown, *still)


def moves_on(context: Context) -> Optional[Seen]:
    """It has flown on for longer than a gust lasts, in a mode that does not hold."""
    status = context.vehicle()
    on = status is not None and passed("moving", context.state, context.rules, context.now)
    return holds_if(on, *(() if status is None else fast(status, context.limits.hold_speed_m_s)))


def hold_not_repeated(context: Context) -> Optional[Seen]:
    """The hold was asked for once."""
    return holds_if(not context.state.flight.hold_repeated)


def heard_down(context: Context) -> Optional[Seen]:
    """The vehicle's last word was that it is disarmed and on the ground."""
    return holds_if(context.last_heard_down())


def nobody_knows(context: Context) -> Optional[Seen]:
    """The pilot was alarmed; it is not heard any more, nor whether it is armed and has landed, or long disarmed."""
    state, status = context.state, context.state.peers.autopilot
    lasts = passed("vehicle_unknown_limit", state, context.rules, context.now)
    unknown = lasts and status is not None and says_nothing(status)
    landing = state.landing
    alarmed = landing.alarmed or landing.lost_alarmed or landing.overdue_alarmed or landing.armed_alarmed
    silent = alarmed and (context.vehicle() is None or unknown or context.disarmed_for_long())
    return holds_if(silent, Value("last heard armed", status.armed if status is not None else None))


def mission_flown(context: Context) -> Optional[Seen]:
    """The planner lands after the last waypoint of the last file: the mission is flown."""
    planner = context.state.peers.planner
    if planner is None or not context.planner_lands() or not 0 < planner.waypoints <= planner.waypoint:
        return None
    return last_leg(context)


def takeoff_failed(context: Context) -> Optional[Seen]:
    """The planner says that the takeoff failed, and the vehicle has stayed disarmed on the ground."""
    planner, state = context.state.peers.planner, context.state
    failed = planner is not None and planner.phase is MissionPhase.FAILED and planner.t_ns > state.flight.motion.sent_ns
    ready = failed and not state.flight.was_armed and context.stays_down()
    said = planner.message if planner is not None and planner.message else "failed"
    return because("planner", said) if ready else None


def in_flight(context: Context) -> Optional[Seen]:
    """From the TAKEOFF command until the vehicle says, freshly, both disarmed and ON_GROUND."""
    return holds_if(context.state.flight.active, Value("in flight", True))


def _failed(context: Context, failure: Failure) -> Seen:
    return Seen(failsafe.values_of(failure, context), failsafe.fault_words([failure], context.state))


def must_land(context: Context) -> Optional[Seen]:
    """Something means to land."""
    worst = failsafe.worst(context.state) if context.state.flight.active else ()
    return _failed(context, worst[0]) if worst else None


def must_land_both(context: Context) -> Optional[Seen]:
    """Something means to land, and by both routes at once."""
    lost = [f for f in context.state.failures if f.name in _BOTH_ROUTES] if context.state.flight.active else []
    return _failed(context, lost[0]) if lost else None


def must_alarm(context: Context) -> Optional[Seen]:
    """Something is lost that the pilot must know at once, and was not told yet."""
    return None if context.state.landing.lost_alarmed else _lost(context)


def _lost(context: Context) -> Optional[Seen]:
    """Something is lost that the pilot must know."""
    lost = [f for f in context.state.failures if f.name in _ALARM] if context.state.flight.active else []
    return _failed(context, lost[0]) if lost else None


def must_wait(context: Context) -> Optional[Seen]:
    """Something is waited for."""
    held = failsafe.waiting(context.state) if context.state.flight.active else ()
    if not held:
        return None
    values = tuple(value for failure in held for value in failsafe.values_of(failure, context))
    return Seen(values, _failed(context, held[-1]).reason)


def nothing_waited_for(context: Context) -> Optional[Seen]:
    """All that was waited for is back, dropped, or resumed; on the ground there is nothing to go on with."""
    return holds_if(context.state.flight.active and must_wait(context) is None)


def vehicle_known(context: Context) -> Optional[Seen]:
    """The vehicle is heard freshly; after a restart of the engine nothing is known of it at first."""
    return holds_if(context.vehicle() is not None)


def vehicle_heard(context: Context) -> Optional[Seen]:
    """The vehicle was heard since the engine's last start, or could have been for longer than it may be silent."""
    peers = context.state.peers
    since_ns = peers.autopilot_ns or 0
    silent = context.now - since_ns > context.limits.autopilot_status_limit_ns
    return holds_if(peers.autopilot is not None or silent)


def interrupted(state: State) -> Guard:
    """Hold when the hold interrupted this state."""
    return lambda context: holds_if(context.state.flight.interrupted is state)


def planner_in(*phases: MissionPhase) -> Guard:
    """Hold when the planner says, since the last command, one of these phases."""

    def guard(context: Context) -> Optional[Seen]:
        planner = context.state.peers.planner
        if planner is None or planner.phase not in phases or not planner.t_ns > context.state.flight.motion.sent_ns:
            return None
        return Seen((Value("planner phase", planner.phase.name),))

    return guard


def touched_down(context: Context) -> Optional[Seen]:
    """Disarmed and ON_GROUND after a flight that is over (`Context.stays_down`)."""
    state = context.state
    if state.flight.active or not state.flight.was_armed or context.flies_again():
        return None
    detection = Value("landing detection", context.detection().name)
    return Seen((Value("armed", False), Value("landed", "ON_GROUND"), detection))


def file_done(context: Context) -> Optional[Seen]:
    """Touched down, and the planner says that the file's sequence has ended."""
    planner, down = context.state.peers.planner, touched_down(context)
    if down is None or planner is None or planner.phase is not MissionPhase.LANDED:
        return None
    last = 0 < planner.waypoints <= planner.waypoint  # of none it has flown none, whatever ended it
    return holds_if(last, *down.values, Value("waypoint", planner.waypoint, planner.waypoints))


def last_leg(context: Context) -> Optional[Seen]:
    """No waypoint file and no repetition is left."""
    state = context.state
    mission = state.session.mission
    if mission is None:
        return Seen()
    last = state.session.file_index + 1 >= mission.files and state.session.repetition + 1 >= mission.repetitions
    return holds_if(
        last,
        Value("file", state.session.file_index + 1, mission.files),
        Value("repetition", state.session.repetition + 1, mission.repetitions),
    )


def cancelled_on_ground(context: Context) -> Optional[Seen]:
    """Disarmed and ON_GROUND without ever having been armed, and the landing was accepted or its limit has passed."""
    state = context.state
    if state.flight.was_armed or not context.stays_down():
        return None
    settled = state.flight.motion.outcome is Outcome.ACCEPTED or passed(
        "never_armed", state, context.rules, context.now
    )
    return holds_if(settled, Value("armed", False), Value("landed", "ON_GROUND"), Value("was armed", False))


def landing_shown(context: Context) -> Optional[Seen]:
    """The vehicle shows that it lands: on the ground, or, up to the limit, landing mode or sustained descent.

    What landing detection or height contradicts shows nothing, nor does ON_GROUND before lift-off while it is armed:
    the takeoff may still be on its way. A leg of a mission may descend as well, and a vehicle that stands in the air
    does not land, whatever its mode is called.
    """
    status = context.vehicle()
    before_lift_off = status is not None and status.armed is not False and not context.state.flight.was_airborne
    grounded = status is not None and status.landed is VehicleLanded.ON_GROUND and not context.contradicted()
    if status is None or (not grounded and passed("land_limit", context.state, context.rules, context.now)):
        return None
    stalled = passed("landing_stall_limit", context.state, context.rules, context.now)
    if status.mode in LANDING_MODES and not stalled:
        return Seen((Value("flight mode", status.mode),))
    if (grounded and not before_lift_off) or (status.landed is VehicleLanded.LANDING and not stalled):
        return Seen((Value("landed", status.landed.name),))
    flies_on = status.mode in FLYING_MODES and not context.planner_lands()
    sustained = not flies_on and passed("descent_time", context.state, context.rules, context.now)
    return holds_if(
        sustained, Value("vertical speed", status.vertical_speed_m_s, -context.limits.descent_speed_m_s, "m/s")
    )


def contradicted(context: Context) -> Optional[Seen]:
    """Landing detection or height contradicts that it stands on the ground, or did a moment ago."""
    return holds_if(context.contradicted())


def flown_unheard(context: Context) -> Optional[Seen]:
    """The planner has said, since the takeoff command, that it flew on to its waypoints, and it is down."""
    planner = context.state.peers.planner
    if planner is None or not context.planner_flew() or not context.stays_down():
        return None
    return Seen((Value("planner phase", planner.phase.name), Value("waypoint", planner.waypoint, planner.waypoints)))


def ground_armed(context: Context) -> Optional[Seen]:
    """On the ground for a while, still armed, and nothing says that it flies or moves: it may be disarmed."""
    flies = context.contradicted() or context.state.vehicle.moving_ns is not None
    return None if flies else _armed_down(context, "ground_disarm_after")


def stays_armed(context: Context) -> Optional[Seen]:
    """It has said for long that it is on the ground, and armed."""
    return _armed_down(context, "stays_armed")


def _armed_down(context: Context, timer: str) -> Optional[Seen]:
    ended = context.on_ground() and context.armed() and passed(timer, context.state, context.rules, context.now)
    return holds_if(ended, Value("landed", "ON_GROUND"), Value("armed", True))


def not_armed_alarmed(context: Context) -> Optional[Seen]:
    """The pilot was not alarmed yet that it stays armed."""
    return holds_if(not context.state.landing.armed_alarmed)


def cancelled(context: Context) -> Optional[Seen]:
    """Disarmed and ON_GROUND, and it was armed before or the planner has accepted the ABORT."""
    settled = context.state.flight.was_armed or context.state.flight.motion.outcome is Outcome.ACCEPTED
    return holds_if(settled and context.stays_down(), Value("armed", False), Value("landed", "ON_GROUND"))


def not_alarmed(context: Context) -> Optional[Seen]:
    """The pilot was not alarmed yet that nothing shows a landing."""
    return holds_if(not context.state.landing.alarmed)


def not_overdue_alarmed(context: Context) -> Optional[Seen]:
    """The pilot was not yet alarmed about the limit of the landing."""
    return holds_if(not context.state.landing.overdue_alarmed)


def one_route_only(context: Context) -> Optional[Seen]:
    """The landing was commanded by the planner's route alone."""
    return holds_if(context.state.landing.second_route_ns is None)


# --- alarms -----------------------------------------------------------------------------------------------------------


ALARM_STANDS: Mapping[str, Callable[[Context], Optional[Seen]]] = {
    "autopilot_lost": _lost,
    "land_alarm": lambda context: holds_if(context.state.step is Step.COMMANDING),
    "land_limit": lambda _: Seen(),
    "stays_armed": lambda context: holds_if(context.on_ground() and context.armed() and not context.contradicted()),
}
"""Until when each alarm of a landing is shown, whatever else is said; none outlives the landing."""
