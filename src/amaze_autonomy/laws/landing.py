"""The laws of the landing: LAND goes out first, is repeated, and ends on the ground."""

from __future__ import annotations

from typing import Tuple

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    AutopilotDisarm,
    AutopilotLand,
    Level,
    MissionAction,
    MissionCommand,
    Notify,
)
from amaze_autonomy.engine.state import Result, State, Step

from .moment import FLIGHT, GROUND, Moment, Verdict, law, shows_landing

A = MissionAction

# --- landing ----------------------------------------------------------------------------------------------------------


@law("4.1", "Landing is sticky: after LAND nothing else moves the vehicle before it is down.", always=True)
def land_is_sticky(m: Moment) -> Verdict:
    if not m.was.landing or m.was.flight != "armed":
        return None
    other = [action for action in m.motions if action is not A.LAND]
    if other:
        return f"{other[0].name} while landing"
    down = m.seen.flight != "armed" or m.seen.is_down(m.rules.limits)
    stays = m.after.state in (State.LAND, State.PILOT) or down
    return True if stays else f"from landing to {m.after.state.value} while it is not down"


@law("4.3", "Land first, tidy later: LAND is the first command out, the second route comes next.")
def land_is_the_first_command_out(m: Moment) -> Verdict:
    if A.LAND not in m.motions and not m.sent(AutopilotLand):
        return None
    first = m.commands[0]
    if A.LAND in m.motions and not (isinstance(first, MissionCommand) and first.action is A.LAND):
        return f"{type(first).__name__} goes out before LAND"
    if m.sent(AutopilotLand) and not any(isinstance(c, AutopilotLand) for c in m.commands[: len(m.motions) + 1]):
        return "the second route does not go out next"
    return True


def _lands_unseen(m: Moment) -> bool:
    """Return True where a landing was commanded that nothing shows yet, and nobody else seems to have control."""
    unseen = m.after.state is State.LAND and m.seen.landing and not shows_landing(m.saw, m.rules)
    return unseen and not m.in_doubt


@law("4.3", "LAND is repeated until the vehicle shows it: at each period while it does not.", always=True)
def land_is_repeated(m: Moment) -> Verdict:
    if not _lands_unseen(m):
        return None
    late = m.seen.now - m.seen.sent_ns
    return True if late < m.rules.limits.land_repeat_period_ns else f"the last LAND is {late / 1e9:g} s old"


@law("4.3", "After 3 s without an answer the landing goes out by the second route too.", always=True)
def second_route_in_time(m: Moment) -> Verdict:
    if not _lands_unseen(m):
        return None
    if m.seen.now - m.seen.land_ns < m.rules.limits.land_second_route_after_ns:
        return None
    return True if m.seen.second else "only one route was used"


@law("4.3", "The second route, once taken, is repeated with the first while the vehicle does not land.", always=True)
def the_second_route_is_repeated(m: Moment) -> Verdict:
    if not _lands_unseen(m) or not m.seen.second:
        return None
    late = m.seen.now - m.seen.second_ns
    return True if late < m.rules.limits.land_repeat_period_ns else f"the last one is {late / 1e9:g} s old"


@law("4.3", "The pilot is alarmed once about one thing in one flight, and again in the next.")
def an_alarm_is_given_once(m: Moment) -> Verdict:
    alarms = [c.key for c in m.commands if isinstance(c, Notify) and c.level is Level.ALARM]
    if not alarms or m.saw.flight == "none":
        return None
    again = [key for key in alarms if key in m.was.alarms or alarms.count(key) > 1]
    return f"{again[0]} again" if again else True


@law("4.3", "After that the pilot is alarmed.", always=True)
def alarm_in_time(m: Moment) -> Verdict:
    if not _lands_unseen(m):
        return None
    if m.seen.now - m.seen.land_ns < m.rules.limits.land_alarm_after_ns:
        return None
    return True if m.seen.alarmed else "the pilot was not alarmed"


@law("5 LAND", "It disarms only what stands on the ground, says so freshly, and is armed.")
def disarm_on_the_ground_only(m: Moment) -> Verdict:
    if not m.sent(AutopilotDisarm):
        return None
    status = m.saw.fresh(m.rules.limits)
    if status is None or status.landed is not ev.VehicleLanded.ON_GROUND or status.armed is not True:
        return "disarm although the vehicle does not say, freshly, armed and ON_GROUND"
    return "disarm although the landing detection says AIRBORNE" if _detects_flight(m) else True


def _detects_flight(m: Moment) -> bool:
    return m.saw.detected(m.rules.limits) is ev.Landed.AIRBORNE


@law(
    "4.8",
    "A flight ends by what the vehicle says, freshly, not by a reply; or by a person once it is silent and alarmed.",
)
def a_flight_ends_on_the_ground(m: Moment) -> Verdict:
    if m.before.state not in (*FLIGHT, State.PILOT) or m.after.state not in GROUND:
        return None
    if m.saw.flight == "none" or _given_up(m):
        return True
    return True if m.saw.is_down(m.rules.limits) else f"{m.after.state.value} while it is not known to be down"


def _given_up(m: Moment) -> bool:
    """Return True when a person ends it: after the alarm, or by its last word that it is down; it is not heard."""
    asked = isinstance(m.event, ev.UserRequest) and m.event.command is ev.UserCommand.ACKNOWLEDGE
    last = m.saw.vehicle
    down = last is not None and last.armed is False and last.landed is ev.VehicleLanded.ON_GROUND
    return asked and m.saw.fresh(m.rules.limits) is None and (m.was.alarmed or down)


@law("5 MISSION", "A mission is complete only when the planner says so, it was the last file, and it has landed.")
def complete_is_complete(m: Moment) -> Verdict:
    if m.after.session.result is not Result.COMPLETE or m.before.session.result is Result.COMPLETE:
        return None
    planner, mission, load = m.saw.planner, m.before.session.mission, m.saw.load
    ends = planner is not None and planner.phase in (ev.MissionPhase.LANDING, ev.MissionPhase.LANDED)
    if planner is None or not ends or planner.waypoint < planner.waypoints:
        return "the planner does not say that the last waypoint is done"
    last = mission is not None and load is not None and load.leg == (mission.repetitions - 1, mission.files - 1)
    return True if last else "it was not the last file"


@law("5 TAKEOFF", "The mission begins at takeoff height, known freshly.")
def the_mission_begins_at_height(m: Moment) -> Verdict:
    if m.before.step is not Step.CLIMBING or m.after.step is not Step.FLYING:
        return None
    status, limit = m.saw.fresh(m.rules.limits), m.rules.limits.takeoff_height_m
    high = status is not None and status.height_m is not None and status.height_m >= limit
    return True if high else "the mission begins below takeoff height, or at an unknown one"


@law("4.8", "It holds, or goes on, when the planner shows it; an accepted request is no sign of it.")
def holding_is_what_the_planner_shows(m: Moment) -> Verdict:
    if m.after.step is Step.HOLDING and m.before.step is not Step.HOLDING:
        expected: Tuple[str, ...] = ("HOLDING",)
    elif m.before.step is Step.RESUMING and m.after.step in (Step.FLYING, Step.CLIMBING):
        expected = ("FLYING", "TAKING_OFF", "LANDING", "LANDED")
    else:
        return None
    phase = m.saw.planner.phase.name if m.saw.planner is not None else "nothing"
    new = m.saw.planner is not None and m.saw.planner_ns > m.saw.motion_ns
    return True if new and phase in expected else f"the planner says {phase}"
