"""The laws of the ground: what a takeoff needs, what becomes of a recording, what a restart may do."""

from __future__ import annotations

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    Decision,
    MissionAction,
    StopRecording,
)
from amaze_autonomy.engine.state import DataResult, State

from .moment import FLIGHT, Moment, Verdict, lands, law
from .witness import CHECKS

A = MissionAction


def _max_age_ns(m: Moment, check: str) -> int:
    own = [age_ns for name, age_ns in m.rules.max_ages_ns if name == check]
    return own[0] if own else m.rules.limits.check_max_age_ns


# --- takeoff ----------------------------------------------------------------------------------------------------------


@law("4.7, 5 LOAD_MISSION", "A takeoff needs every check: asked since the mission was loaded, passed, and fresh.")
def takeoff_needs_fresh_checks(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    if len(m.saw.checks) != CHECKS or m.saw.load is None:
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
        return "the vehicle does not say, freshly, that it is disarmed on the ground"
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
    of_landing = ("since_ns", "second_route_ns", "alarmed", "overdue_alarmed", "both_routes")
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
    return True if len(m.saw.checks) == CHECKS else "not every check was asked"


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
        kept_quiet = lost and m.after.session.data_result is DataResult.COMPLETE
        return f"the data is COMPLETE, and the recorder says that it lacks {lost}" if kept_quiet else True
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
