"""The laws of the ground and of the way back to it.

What a takeoff needs, what becomes of a recording, what a restart may do; LAND goes out first, is repeated, and ends on
the ground.
"""

from __future__ import annotations

from typing import Tuple

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    AutopilotDisarm,
    Decision,
    Level,
    MissionAction,
    Notify,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.state import DataResult, Result, State, Step

from .moment import FLIGHT, GROUND, Moment, Verdict, lands, law, shows_landing

A = MissionAction


def _max_age_ns(m: Moment, check: str) -> int:
    own = [age_ns for name, age_ns in m.rules.max_ages_ns if name == check]
    return own[0] if own else m.rules.limits.check_max_age_ns


# --- takeoff ----------------------------------------------------------------------------------------------------------


@law("4.7, 5 LOAD_MISSION", "A takeoff needs every check: asked since the mission was loaded, passed, and fresh.")
def takeoff_needs_fresh_checks(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    if len(m.saw.checks) != m.checks or m.saw.load is None:
        return f"only {len(m.saw.checks)} checks were asked"
    for name, asked in m.saw.checks:
        if not asked.ok or asked.answered_ns is None:
            return f"the {name} check has not passed"
        if m.saw.now - asked.answered_ns > _max_age_ns(m, name):
            return f"the {name} check is too old"
        if asked.id < m.saw.load.id:
            return f"the {name} check was not asked again"
    return True


@law("5 START_RECORDING", "A takeoff needs a recording of this session that is proven to grow on every platform.")
def takeoff_needs_a_proven_recording(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    limits, since = m.rules.limits, m.saw.growing_ns
    if m.saw.recording != "asked" or since is None:
        return "no recording is proven"
    if m.saw.now - m.saw.recorder_ns > limits.recorder_status_limit_ns:
        return "the recorder is silent"
    return True if m.saw.now - since >= limits.recording_lead_ns else "the recording is younger than its lead"


@law("5 LOAD_MISSION", "A takeoff needs the planner's word that it has loaded this file of this mission.")
def takeoff_needs_the_planners_word(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    load, planner = m.saw.load, m.saw.planner
    if load is None or load.outcome is not ev.Outcome.ACCEPTED or planner is None:
        return "the planner has not accepted the mission"
    said = (planner.mission_id, (planner.repetition, planner.file_index), planner.phase)
    expected = (load.mission, load.leg, ev.MissionPhase.LOADED)
    return True if said == expected else f"the planner says {said}, not {expected}"


@law("4.6, 4.7", "No takeoff while anything known would end the flight, and only from the ground, disarmed.")
def takeoff_only_when_fit(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    limits = m.rules.limits
    if not m.saw.is_down(limits):
        return "no recent status that the vehicle is disarmed on the ground"
    if m.saw.shutting_down:
        return "the process was told to end"
    bad = [name for name, code in m.saw.codes if lands(m, name, code)]
    if bad:
        return f"{bad[0]} has failed"
    if m.saw.beat_ns is None or m.saw.now - m.saw.beat_ns > limits.watchdog_heartbeat_limit_ns:
        return "the watchdog is silent"
    if m.saw.battery_ns is None or m.saw.now - m.saw.battery_ns > limits.battery_age_limit_ns:
        return "the battery level is not known"
    return True


@law("4, 5", "A takeoff begins afresh: nothing is left of the last flight, neither marks nor budgets.")
def a_takeoff_begins_afresh(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    of_flight = ("was_armed", "was_airborne", "spent", "takeover_noted", "user_hold_ns")
    of_landing = (
        "since_ns",
        "second_route_ns",
        "alarmed",
        "overdue_alarmed",
        "armed_alarmed",
        "lost_alarmed",
        "both_routes",
    )
    left = [name for name in of_flight if getattr(m.after.flight, name)]
    left += [name for name in of_landing if getattr(m.after.landing, name)]
    return f"{left[0]} is left" if left else True


@law("4.7, 5 PREFLIGHT", "Ready is said when every check has passed, by all its rows, and none is too old.")
def ready_needs_every_check(m: Moment) -> Verdict:
    if not any(isinstance(c, Decision) and c.after == "READY" for c in m.commands) or m.before.state is State.READY:
        return None
    for name, asked in m.saw.checks:
        if not asked.ok or asked.answered_ns is None:
            return f"the {name} check has not passed"
        if m.saw.now - asked.answered_ns > _max_age_ns(m, name):
            return f"the {name} check is too old"
    return True if len(m.saw.checks) == m.checks else "not every check was asked"


@law("5 READY, LOAD_MISSION", "Ready is revoked when a required component is not at code 1, or tolerated at 2.")
def ready_is_revoked(m: Moment) -> Verdict:
    if m.before.state not in (State.READY, State.START_RECORDING, State.LOAD_MISSION):
        return None
    if m.in_doubt:
        return None
    mission = m.before.session.mission
    required = mission.required if mission is not None else ()
    tolerated = mission.tolerated if mission is not None else ()
    for name, code in m.saw.codes:
        if code == 1 or (code == 2 and name in tolerated) or (required and name not in required):
            continue
        kept = m.after.state in (State.READY, State.START_RECORDING, State.LOAD_MISSION, State.TAKEOFF)
        return f"{name} is at {code}, still {m.after.state.value}" if kept else True
    return None


@law("5", "A takeoff is commanded once for each loaded file; nothing repeats it.")
def one_takeoff_for_each_load(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    if m.motions.count(A.TAKEOFF) != 1 or m.saw.load is None:
        return "more than one takeoff at once"
    return "this file was taken off with before" if m.saw.load.used else True


@law("5 resume", "An engine that was away for long, told to end, or has landed, takes off when a person asks for it.")
def a_person_asks(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions and not m.sent(StartRecording):
        return None
    return "nobody has asked for it since the engine was away, was told to end, or landed" if m.was.unasked else True


# --- data and restarts ------------------------------------------------------------------------------------------------


@law(
    "5 DATA_CLEANUP", "Every started recording ends in a verified merge that lacks nothing, or what it lacks is named."
)
def recordings_end(m: Moment) -> Verdict:
    if not m.moved or m.after.state not in (State.MISSION_ENDED, State.MISSION_INPUT) or m.was.recording == "none":
        return None
    if m.before.state is State.MISSION_ENDED:
        return None
    said = m.saw.recorder.phase if m.saw.recorder is not None else None
    if m.saw.recording == "complete" or said is ev.RecordingPhase.COMPLETE:
        lost = m.saw.recorder.lost if m.saw.recorder is not None else ""
        lost = lost or ("what was flown on" if m.was.flown_on else "")
        kept_quiet = lost and m.after.session.data_result is DataResult.COMPLETE
        return f"the data is COMPLETE, and it lacks {lost}" if kept_quiet else True
    if m.saw.recording in ("named", "stopped") and m.after.session.data_result is DataResult.INCOMPLETE:
        return True
    return f"the recording is {m.saw.recording}, and it is {m.after.state.value}"


@law("5 DATA_CLEANUP", "A recording is stopped when the flight is over, and only then.")
def recordings_are_stopped(m: Moment) -> Verdict:
    stopped = m.sent(StopRecording)
    entered = m.after.state is State.DATA_CLEANUP and m.moved and m.was.recording != "none"
    if not stopped and not entered:
        return None
    if stopped and not any(isinstance(c, Decision) and c.after == "DATA_CLEANUP" for c in m.commands):
        return f"stopped in {m.after.state.value}"
    return True if stopped else "not stopped"


@law("5 resume, 7", "A restart resumes: it takes off, loads, arms, checks and records nothing anew.", always=True)
def a_restart_starts_nothing(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.EngineStarted) or not m.event.resumed:
        return None
    anew = [a for a in m.motions if a not in (A.LAND, A.ABORT, A.HOLD)]
    timed_out = {State.PREFLIGHT, State.OUTREACH, State.DATA_CLEANUP, State.MISSION_ENDED}
    held_up = (
        m.before.vehicle.takeover is not None
    )  # a doubt of before held up what goes on now: a recording, no motion
    if anew or (m.requests and not held_up and m.after.state not in (*timed_out, *FLIGHT)):
        return f"{anew or m.requests} at a restart"
    if m.before.state in FLIGHT and m.was.flight == "armed" and m.after.state not in (*FLIGHT, State.PILOT):
        return None if m.saw.is_down(m.rules.limits) else f"{m.before.state.value} became {m.after.state.value}"
    return True


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


def _lands_unseen(m: Moment) -> bool:
    """Return True where a landing was commanded that nothing shows yet, and nobody else seems to have control.

    Right after a restart the vehicle was not heard yet, for as long as it may be silent.
    """
    unseen = m.after.state is State.LAND and m.seen.landing and not shows_landing(m.saw, m.rules)
    waits = m.saw.vehicle is None and m.saw.now - m.saw.vehicle_ns <= m.rules.limits.autopilot_status_limit_ns
    return unseen and not m.in_doubt and not waits


@law("4.3", "LAND is repeated until the vehicle shows it: each period, anew from a restart on.", always=True)
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


@law("4.3", "The pilot is alarmed when nothing has shown a landing for 6 s.", always=True)
def alarm_in_time(m: Moment) -> Verdict:
    if not _lands_unseen(m):
        return None
    since_ns = m.seen.land_ns if m.seen.unseen_ns is None else m.seen.unseen_ns
    if m.seen.now - since_ns < m.rules.limits.land_alarm_after_ns:
        return None
    return True if {"land_alarm", "land_limit"}.intersection(m.seen.alarms) else "the pilot was not alarmed"


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
    "A flight ends by statuses that agree for a while, not by a reply; or by a person once it is silent and alarmed.",
)
def a_flight_ends_on_the_ground(m: Moment) -> Verdict:
    if m.before.state not in (*FLIGHT, State.PILOT) or m.after.state not in GROUND:
        return None
    if m.saw.flight == "none" or _given_up(m):
        return True
    if not m.saw.is_down(m.rules.limits):
        return f"{m.after.state.value} while it is not known to be down"
    since_ns = m.saw.down_ns if m.saw.down_ns is not None else m.saw.now
    agreed = m.before.state is State.PILOT or m.saw.now - since_ns >= m.rules.limits.flight_end_confirm_ns
    return True if agreed else "one status alone is believed"


def _given_up(m: Moment) -> bool:
    """Return True when a person ends it: alarmed, by its last word that it is down, or silent or disarmed for long."""
    asked = isinstance(m.event, ev.UserRequest) and m.event.command is ev.UserCommand.ACKNOWLEDGE
    last = m.saw.vehicle
    down = last is not None and last.armed is False and last.landed is ev.VehicleLanded.ON_GROUND
    limits = m.rules.limits
    long = m.saw.is_silent(limits) or m.saw.is_disarmed(limits)
    if m.before.state is State.PILOT and long:
        return asked
    nothing_known = m.saw.fresh(limits) is None or m.saw.is_unknown(limits) or long
    return asked and nothing_known and (m.was.alarmed or down)


@law(
    "5 MISSION",
    "A mission is complete only when the planner says so, it was the last file, and it had not ended otherwise.",
)
def complete_is_complete(m: Moment) -> Verdict:
    if m.after.session.result is not Result.COMPLETE or m.before.session.result is Result.COMPLETE:
        return None
    planner, mission, load = m.saw.planner, m.before.session.mission, m.saw.load
    ends = planner is not None and planner.phase in (ev.MissionPhase.LANDING, ev.MissionPhase.LANDED)
    if planner is None or not ends or not 0 < planner.waypoints <= planner.waypoint:
        return "the planner does not say that the last waypoint is done"
    if m.before.session.result is not Result.NONE:
        return "it had ended otherwise before"
    last = mission is not None and load is not None and load.leg == (mission.repetitions - 1, mission.files - 1)
    flown = load is not None and load.used
    return True if last and flown else "it was not the last file, or nobody has taken off with that"


@law("5 MISSION_ENDED", "A mission is not flown only when neither the vehicle nor the planner has said that it flew.")
def not_flown_is_not_flown(m: Moment) -> Verdict:
    if not m.moved or m.after.state is not State.MISSION_ENDED or m.after.session.result is not Result.NOT_FLOWN:
        return None
    return "it was flown, and is said to be not flown" if m.was.flew else True


@law("5 TAKEOFF", "The mission begins at takeoff height, known freshly.")
def the_mission_begins_at_height(m: Moment) -> Verdict:
    if m.before.step is not Step.CLIMBING or m.after.step is not Step.FLYING:
        return None
    status, limit = m.saw.fresh(m.rules.limits), m.rules.limits.takeoff_height_m
    high = status is not None and status.height_m is not None and status.height_m >= limit
    return True if high else "the mission begins below takeoff height, or at an unknown one"


@law("4.8", "It holds when planner and vehicle show it, and goes on when the planner does; a reply is no sign of it.")
def holding_is_what_the_planner_shows(m: Moment) -> Verdict:
    if m.after.step is Step.HOLDING and m.before.step is not Step.HOLDING:
        expected: Tuple[str, ...] = ("HOLDING",)
    elif m.before.step is Step.RESUMING and m.after.step in (Step.FLYING, Step.CLIMBING):
        expected = ("FLYING", "TAKING_OFF", "LANDING", "LANDED")
    else:
        return None
    status, limits = m.saw.fresh(m.rules.limits), m.rules.limits
    across, climb = (None, None) if status is None else (status.horizontal_speed_m_s, status.vertical_speed_m_s)
    stands = across is not None and climb is not None and max(across, climb, -climb) <= limits.hold_speed_m_s
    still = status is not None and (status.mode == "AUTO.LOITER" or stands)
    if m.after.step is Step.HOLDING and not still:
        return "the vehicle shows no hold"
    phase = m.saw.planner.phase.name if m.saw.planner is not None else "nothing"
    new = m.saw.planner is not None and m.saw.planner_ns > m.saw.motion_ns
    return True if new and phase in expected else f"the planner says {phase}"
