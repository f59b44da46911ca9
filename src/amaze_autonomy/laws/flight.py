"""The laws of the flight: what is wrong is landed for or waited for, and who has control is left alone."""

from __future__ import annotations

from typing import Mapping, NamedTuple, Optional

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    AutopilotDisarm,
    AutopilotLand,
    Decision,
    MissionAction,
)
from amaze_autonomy.engine.state import State, Step

from .moment import ENDLESS, FLIGHT, GROUND, Moment, Verdict, lands, law
from .witness import OURS

A = MissionAction
_NS = 1e9


class Bound(NamedTuple):
    """What of the vehicle's fresh status is landed for at once above its limit, in every phase of the flight.

    Args:
        field: of the status.
        limit: of the mission, or of `rules.Limits`, in the unit of the field.
        words: what is wrong then.
    """

    field: str
    limit: str
    words: str


BOUNDS: Mapping[str, Bound] = {
    "height": Bound("height_m", "max_height_m", "it is too high"),
    "tilt": Bound("tilt_deg", "max_tilt_deg", "it is tilted too far"),
}
"""By the name of what is lost, by hand from the specification; test/engine/test_losses.py flies each row."""

# --- failures in flight -----------------------------------------------------------------------------------------------


def _handed_over(m: Moment) -> bool:
    """Return True where nobody expects a landing any more: the pilot has it, or it is down."""
    return m.after.state is State.PILOT or m.seen.flight != "armed" or m.in_doubt


def _is_landed_for(m: Moment, why: str) -> Verdict:
    if _handed_over(m):
        return None
    if m.after.state is not State.LAND:
        return f"{why}, and it does not land but is in {m.after.state.value}"
    return True if m.seen.landing else f"{why}, and LAND was not commanded"


@law("4 table, 4.2", "An airborne vehicle with an unresolved ABORT is being landed, in every phase.", always=True)
def abort_is_landed(m: Moment) -> Verdict:
    bad = [name for name, code in m.saw.codes if code == 16]
    return _is_landed_for(m, f"{bad[0]} is at 16") if bad and m.saw.flight == "armed" else None


@law("4 decision table", "A component of the row `highest` is landed for at 4, 8 and 16.", always=True)
def highest_is_landed_for(m: Moment) -> Verdict:
    if m.saw.flight != "armed":
        return None
    bad = [name for name, code in m.saw.codes if code >= 4 and m.severity(name, code) == "highest"]
    return _is_landed_for(m, f"{bad[0]} has failed") if bad else None


@law(
    "4 losses", "Heartbeat, planner, autopilot or battery lost, or a limit of the flight passed: it lands.", always=True
)
def losses_are_landed_for(m: Moment) -> Verdict:
    if m.saw.flight != "armed":
        return None
    lost = _lost(m)
    return _is_landed_for(m, lost) if lost else None


def _lost(m: Moment) -> str:
    """Return what is lost, by the witness's own clocks; empty: nothing."""
    if m.saw.stalled_s * _NS > m.rules.limits.clock_stall_limit_ns:
        return "the clock stands"
    return _lost_peer(m) or _battery_or_time(m) or _out_of_bounds(m)


def _lost_peer(m: Moment) -> str:
    saw, limits, now = m.saw, m.rules.limits, m.saw.now
    if now - max(saw.beat_ns or 0, 0) > limits.watchdog_heartbeat_limit_ns and saw.watching:
        return "the watchdog's heartbeat is lost"
    if now - saw.planner_ns > limits.planner_status_limit_ns and saw.planner_ns:
        return "the planner is silent"
    if saw.planner is not None and saw.planner.phase is ev.MissionPhase.FAILED:
        return "the planner failed"
    if saw.idle_ns is not None and now - saw.idle_ns > limits.planner_idle_limit_ns:
        return "the planner says that nothing is flown"
    if saw.stalled_ns is not None and now - saw.stalled_ns > limits.landing_stall_limit_ns:
        return "the planner says that it lands, and the vehicle stands in the air"
    silent = saw.vehicle is not None or now - saw.vehicle_ns > limits.autopilot_status_limit_ns
    if silent and saw.fresh(limits) is None:
        return "the autopilot is silent"
    unknown = saw.airborne and saw.is_unknown(limits)
    return "the autopilot does not say whether it is armed and on the ground" if unknown else ""


def _battery_or_time(m: Moment) -> str:
    saw, limits, now = m.saw, m.rules.limits, m.saw.now
    status, started = saw.vehicle, saw.flight_ns
    if now - (started if saw.battery_ns is None else saw.battery_ns) > limits.battery_age_limit_ns:
        return "the battery level is unknown"
    if status is not None and status.battery_critical:
        return "the battery is critical, says the autopilot"
    level = status.battery_fraction if status is not None else None
    if level is not None and not level > limits.battery_critical_fraction:
        return "the battery is critical"
    if now - started >= m.limit("max_flight_time_ns"):
        return "the flight time is over"
    return ""


def _out_of_bounds(m: Moment) -> str:
    limits = m.rules.limits
    status = m.saw.fresh(limits)
    if status is None:
        return ""
    for bound in BOUNDS.values():
        value, limit = getattr(status, bound.field), m.limit(bound.limit)
        if value is not None and value > limit:
            return bound.words
    x, y = status.position_x_m, status.position_y_m
    far = x is not None and y is not None and round((x * x + y * y) ** 0.5, 3) > m.limit("max_distance_m")
    return "it is too far" if far else ""


def _stays_armed(m: Moment) -> bool:
    """Return True when it has said for long, in flight, that it is on the ground and armed."""
    saw, limits = m.saw, m.rules.limits
    long = saw.spinning_ns is not None and saw.now - saw.spinning_ns >= limits.confirm_limit_ns
    status = saw.fresh(limits)
    return long and status is not None and status.armed is True and saw.on_ground(limits)


@law(
    "5 MISSION",
    "On the ground, armed, it is landed for: soon where the planner flies on, else at last.",
    always=True,
)
def grounded_is_landed_for(m: Moment) -> Verdict:
    saw, limits = m.saw, m.rules.limits
    status = saw.fresh(limits)
    if m.before.step not in (Step.FLYING, Step.CLIMBING) or saw.ground_ns is None or _handed_over(m):
        return None
    if _stays_armed(m):
        return _is_landed_for(m, "it stays armed on the ground")
    if status is None or status.armed is not True or m.before.step is not Step.FLYING or saw.lands(limits):
        return None
    if saw.contradicted(limits) or saw.moving_ns is not None or not saw.on_ground(limits):
        return None
    told_ns = m.was.disarmed_ns
    due_ns = saw.ground_ns + limits.ground_disarm_after_ns
    due_ns = due_ns if told_ns is None else max(due_ns, told_ns + limits.ground_disarm_period_ns)
    return _is_landed_for(m, "it stands on the ground, armed") if saw.now >= due_ns else None


@law("4.3", "The pilot is alarmed when it stays armed on the ground.", always=True)
def stays_armed_alarms(m: Moment) -> Verdict:
    if _handed_over(m) or m.after.state is not State.LAND or not _stays_armed(m):
        return None
    if m.saw.contradicted(m.rules.limits):  # it may hover: the pilot is alarmed that it does not land
        return None
    return True if "stays_armed" in m.seen.alarms else "it stays armed, and the pilot was not alarmed"


@law("4 losses", "When planner or autopilot is lost, the landing goes out by both routes.", always=True)
def both_routes_when_planner_or_autopilot_is_lost(m: Moment) -> Verdict:
    if m.saw.flight != "armed" or _handed_over(m):
        return None
    lost = _lost(m)
    if not lost.startswith(("the planner", "the autopilot ", "the clock")):
        return None
    return True if m.seen.second else f"{lost}, and the second route was not used"


@law("4 losses", "When the autopilot is lost in flight, the pilot is alarmed at once.", always=True)
def autopilot_lost_alarms(m: Moment) -> Verdict:
    lost = _lost(m)
    if m.saw.flight != "armed" or _handed_over(m) or not lost.startswith("the autopilot "):
        return None
    return True if "autopilot_lost" in m.seen.alarms else f"{lost}, and the pilot was not alarmed"


@law(
    "4 losses, 5 READY",
    "The heartbeat, once it is watched, is relied on from Ready to the landing: lost, it is left.",
    always=True,
)
def the_heartbeat_is_relied_on(m: Moment) -> Verdict:
    relies = m.after.state in (State.READY, State.START_RECORDING, State.LOAD_MISSION) or m.after.step is Step.TOUCHDOWN
    flies = m.after.state in (State.TAKEOFF, State.MISSION, State.HOLD) and m.seen.flight != "none"
    if not m.saw.watching or m.in_doubt or m.after.state in (*ENDLESS, State.PREFLIGHT, State.DATA_CLEANUP):
        return None
    silent = m.saw.now - max(m.saw.beat_ns or 0, 0) > m.rules.limits.watchdog_heartbeat_limit_ns
    return f"it is lost, and still {m.after.state.value}" if silent and (relies or flies) else True


def _waits(m: Moment) -> Optional[str]:
    """Return a component whose action is `wait` now and whose budget is not spent."""
    for name, code in m.saw.codes:
        spent = dict(m.saw.waited).get(name, 0)
        waits = code in (4, 8) and m.severity(name, code) in ("moderate", "high")
        if waits and spent < m.budget_ns(name) and name not in m.saw.given_up:
            return name
    return None


@law(
    "4 table",
    "What is worth waiting for is waited for: airborne on its way, the mission holds, or does more.",
    always=True,
)
def a_wait_holds(m: Moment) -> Verdict:
    if m.saw.flight != "armed" or not m.saw.airborne or _waits(m) is None or m.saw.on_ground(m.rules.limits):
        return None
    if m.after.state not in (State.TAKEOFF, State.MISSION) or m.after.step is Step.CANCELLING:
        return True
    if m.in_doubt or m.saw.lands(m.rules.limits):
        return None
    if _waits(m) in m.after.flight.flown_without:
        return None
    return f"{_waits(m)} has failed, and it neither holds nor lands"


@law(
    "4 waits",
    "A component is not waited for longer than its budget in one flight, or than until a restarted engine hears of it.",
    always=True,
)
def a_wait_ends(m: Moment) -> Verdict:
    if m.after.state is not State.HOLD or m.seen.flight != "armed":
        return None
    for name, waited in m.saw.waited:
        failing = dict(m.saw.codes).get(name, 1) in (4, 8)
        held = any(f.name == name and f.action.name == "WAIT" for f in m.after.failures)
        if failing and held and m.is_spent(name):
            return f"{name} was waited for {waited / 1e9:g} s of {m.budget_ns(name) / 1e9:g} s, and is still"
    return True


@law("4 waits", "A component that is high and given up, or whose budget is spent, is landed for.", always=True)
def high_lands_in_the_end(m: Moment) -> Verdict:
    if m.saw.flight != "armed" or not m.saw.airborne:
        return None
    for name, code in m.saw.codes:
        over = name in m.saw.given_up or m.is_spent(name)
        if code in (4, 8) and m.severity(name, code) == "high" and over:
            return _is_landed_for(m, f"{name} is not coming back")
    return None


@law("4 table", "It lands by itself only for something that is landed for: never for what is flown on without.")
def a_landing_has_a_cause(m: Moment) -> Verdict:
    rules = [c.rule for c in m.commands if isinstance(c, Decision)]
    if "land" not in rules and "land_by_both_routes" not in rules:
        return None
    if any(lands(m, name, code) for name, code in m.saw.codes):
        return True
    return True if m.was.user_hold or _lost(m) else f"landing, and only {dict(m.saw.codes)} is wrong"


@law("4 table", "It holds by itself only for a component at 4 or 8.")
def a_hold_has_a_cause(m: Moment) -> Verdict:
    if not any(isinstance(c, Decision) and c.rule == "hold" for c in m.commands):
        return None
    held = [name for name, code in m.saw.codes if code in (4, 8)]
    return True if held else f"holding, and {dict(m.saw.codes)} is no reason"


# --- who has control --------------------------------------------------------------------------------------------------


@law("4.4", "When the pilot or a failsafe takes over, the engine stops at once and soon shows PILOT.", always=True)
def the_pilot_has_control(m: Moment) -> Verdict:
    limits, status = m.rules.limits, m.saw.fresh(m.rules.limits)
    if not isinstance(m.event, ev.AutopilotStatus) or status is not m.event or status.armed is False:
        return None
    if m.saw.flight == "none" or m.before.state not in FLIGHT or not m.before.flight.active:
        return None
    if not (status.pilot_in_control or m.saw.foreign or m.saw.is_taken(limits)):
        return None
    if m.saw.is_taken(limits):
        return True if m.after.state is State.PILOT else f"taken over, and the engine is in {m.after.state.value}"
    return "a command while somebody else seems to have control" if m.motions or m.sent(AutopilotLand) else True


@law("4.4", "While it is not clear whether somebody else has control, nothing is commanded.")
def nothing_is_commanded_in_doubt(m: Moment) -> Verdict:
    if not m.in_doubt or m.after.state not in FLIGHT:
        return None
    moved = m.motions or m.sent(AutopilotLand) or m.sent(AutopilotDisarm)
    return "a command while somebody else may have control" if moved else True


@law("4.1", "A hold never interrupts a landing, whoever lands: by planner, flight mode or descent near the ground.")
def a_hold_never_interrupts_a_landing(m: Moment) -> Verdict:
    if A.HOLD not in m.motions:
        return None
    return "HOLD while it is landing" if m.saw.lands(m.rules.limits) else True


@law(
    "4.8, 5 HOLD",
    "Nothing is held on the ground: who stands there for longer than one wrong status lasts, lands.",
    always=True,
)
def a_hold_ends_on_the_ground(m: Moment) -> Verdict:
    since, limits = m.saw.ground_ns, m.rules.limits
    if m.after.state is not State.HOLD or not m.after.flight.active or m.in_doubt or since is None:
        return None
    stands = m.saw.vehicle is m.event and m.saw.on_ground(limits)  # a status whose stamp is wrong agrees with none
    agreed = stands and m.saw.now - since >= limits.flight_end_confirm_ns
    return "it stands on the ground, and is still held" if agreed else True


@law("4.4", "In PILOT nothing is commanded: no motion, no landing, no disarming.")
def nothing_is_commanded_in_pilot(m: Moment) -> Verdict:
    if m.after.state is not State.PILOT:
        return None
    moved = m.motions or m.sent(AutopilotLand) or m.sent(AutopilotDisarm)
    return "a command while the pilot has control" if moved else True


@law("5 PILOT, MISSION_ENDED", "Behind the pilot no further mission waits to take off: a person selects it anew.")
def no_mission_waits_behind_the_pilot(m: Moment) -> Verdict:
    if m.after.state is not State.PILOT:
        return None
    return "a mission waits" if m.after.queue else True


@law("4.4", "PILOT has a cause: the pilot, a failsafe, a foreign mode, or somebody else's arming.")
def pilot_has_a_cause(m: Moment) -> Verdict:
    if m.after.state is not State.PILOT or not m.moved:
        return None
    status = m.saw.fresh(m.rules.limits)
    if status is None:
        return "nothing is known freshly"
    if m.before.vehicle.takeover is None and m.was.flight != "none":
        return "one status alone is believed"
    cause = status.pilot_in_control or status.failsafe or _not_ours(m) or m.saw.taken
    return True if cause or (m.was.flight == "none" and status.armed is True) else f"why? the mode is {status.mode}"


def _not_ours(m: Moment) -> bool:
    """Return True when the mode is foreign: never ours, left after it had answered a command, or just changed."""
    status, limits = m.saw.vehicle, m.rules.limits
    if status is None or status.mode in OURS.get(m.was.motion, ()):
        return False
    changed = m.saw.now - m.saw.mode_ns <= limits.pilot_confirm_ns + limits.autopilot_status_limit_ns
    return status.mode not in _ANY_OF_OURS or m.was.answered or changed


_ANY_OF_OURS = frozenset(mode for modes in OURS.values() for mode in modes)


@law(
    "4.3",
    "A landing that was asked for in doubt, of control or of the flight's end, goes out when it is over.",
    always=True,
)
def a_landing_asked_for_is_not_forgotten(m: Moment) -> Verdict:
    if m.before.land_deferred is None or m.in_doubt or m.before.state not in FLIGHT or not m.after.flight.active:
        return None
    return _is_landed_for(m, "the user asked for it")


@law(
    "4.3, 4.5, 5",
    "A vehicle that stays silent or disarmed may be given up: in somebody else's hands, or once the pilot was alarmed.",
)
def a_silent_vehicle_may_be_given_up(m: Moment) -> Verdict:
    landing = m.before.state is State.LAND and m.was.alarmed and not m.in_doubt
    if not (landing or m.before.state is State.PILOT) or not _asks_to_end(m):
        return None
    if not (m.saw.is_silent(m.rules.limits) or m.saw.is_disarmed(m.rules.limits)):
        return None
    return True if m.moved else f"silent or disarmed for long, and nothing leads out of {m.before.state.value}"


def _asks_to_end(m: Moment) -> bool:
    return isinstance(m.event, ev.UserRequest) and m.event.command is ev.UserCommand.ACKNOWLEDGE


@law("5 PILOT", "PILOT ends acknowledged by a person alone: it last said that it is down, or it is silent for long.")
def pilot_ends_acknowledged(m: Moment) -> Verdict:
    if m.before.state is not State.PILOT or not m.moved:
        return None
    last = m.saw.vehicle
    down = last is not None and last.armed is False and last.landed is ev.VehicleLanded.ON_GROUND
    ended = _asks_to_end(m) and (down or m.saw.is_silent(m.rules.limits) or m.saw.is_disarmed(m.rules.limits))
    return True if ended else "left without an acknowledgement, or its last word was not that it is down"


@law("4, 5", "On the ground no motion but the one TAKEOFF, and what cancels it before lift-off.")
def no_motion_on_the_ground(m: Moment) -> Verdict:
    if not m.motions:
        return None
    for action in m.motions:
        if action in (A.HOLD, A.RESUME):
            if m.saw.flight == "none" or m.saw.on_ground(m.rules.limits):
                return f"{action.name} on the ground"
            if action is A.RESUME and m.saw.fresh(m.rules.limits) is None:
                return "RESUME while nothing is known of the vehicle"
        elif action is A.TAKEOFF and m.before.state is not State.LOAD_MISSION and m.before.step is not Step.TOUCHDOWN:
            return f"TAKEOFF from {m.before.state.value}"
        elif action is A.ABORT and (m.before.state is not State.TAKEOFF or m.saw.flies(m.rules.limits)):
            return "ABORT, and it is not before lift-off"
        elif action is A.LAND and m.before.state in GROUND and not _still_flies(m):
            return f"LAND from {m.before.state.value}"
    return True


def _still_flies(m: Moment) -> bool:
    """Return True where a landing begins on the ground: started while it flies, or its flight seemed over."""
    seemed = (State.DATA_CLEANUP, State.OUTREACH, State.MISSION_ENDED)
    over = m.before.state in seemed and m.saw.flies(m.rules.limits)
    return over or m.saw.rested < 2 or _armed_late(m)


def _armed_late(m: Moment) -> bool:
    """Return True where an ARM of ours took effect after its takeoff was called off, and several statuses say so."""
    return m.saw.armed_late > 1 and m.saw.taken == 0 and m.saw.fresh(m.rules.limits) is not None


@law("4.4", "An ARM of ours that takes effect after its takeoff was called off stays ours: it is landed.", always=True)
def a_late_arming_is_landed(m: Moment) -> Verdict:
    if m.before.state not in GROUND or not _armed_late(m) or m.after.state is State.PILOT or m.in_doubt:
        return None
    landed = m.after.state is State.LAND and m.seen.landing
    return True if landed else f"it was armed by us, late, and is not landed but in {m.after.state.value}"


@law("4.1", "One moment commands one motion, never two that contradict each other.")
def one_motion_at_a_time(m: Moment) -> Verdict:
    if not m.motions:
        return None
    return True if len(set(m.motions)) == 1 else " and ".join(action.name for action in m.motions)


@law("4.9", "Told to end in flight: LAND on both routes at once.")
def shutdown_lands_on_both_routes(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.Shutdown) or m.before.state not in FLIGHT or not m.before.flight.active:
        return None
    if m.after.state is State.PILOT or m.in_doubt:
        return None
    return True if A.LAND in m.motions and m.sent(AutopilotLand) else "not both routes"
