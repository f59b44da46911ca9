"""When are two states the same? When no future can tell them apart: times become ages, ids and counters are dropped.

A time counts as its age in units of the clock, and only up to the longest limit that is ever compared with it, and only
where something still asks for it. What is left out (texts, counters, the number of a request) is read by no guard; the
explorer checks this by expanding a sample of states that count as known and comparing what follows.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any, Callable, Dict, Optional, Tuple

from proof_peers import NEVER, UNIT, Peers

from amaze_autonomy.engine.events import Outcome, Verdict
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import CheckRecord, EngineState, State, Step
from amaze_autonomy.laws import Witness

Key = Tuple[Any, ...]

_FLIGHT = (State.TAKEOFF, State.MISSION, State.HOLD)
_STEPPED = (State.LOAD_MISSION, State.TAKEOFF, State.MISSION, State.HOLD, State.LAND)
_ENTERED = (State.READY, State.START_RECORDING, State.DATA_CLEANUP)
_CHECKED = (State.PREFLIGHT, State.LOAD_MISSION)


def _caps(rules: Rules) -> Dict[str, int]:
    """Return for each time of the state how old it can become before its age no longer matters, in units."""

    def units(*values: int) -> int:
        return max([value // UNIT for value in values if value < NEVER], default=0) + 1

    at = rules.limits
    return {
        "waited": units(at.unlisted_wait_limit_ns, *(rule.wait_limit_ns for rule in rules.components)),
        "entered_ns": units(at.ready_limit_ns, at.recording_start_limit_ns, at.data_cleanup_limit_ns),
        "step_ns": units(
            at.load_limit_ns,
            at.arm_limit_ns,
            at.lift_off_limit_ns,
            at.takeoff_limit_ns,
            at.cancel_limit_ns,
            at.hold_confirm_limit_ns,
            at.resume_confirm_limit_ns,
            at.land_alarm_after_ns,
        ),
        "flight.started_ns": units(
            at.max_flight_time_ns, at.battery_age_limit_ns, at.position_age_limit_ns, at.planner_status_limit_ns
        ),
        "flight.grounded_ns": units(at.ground_disarm_after_ns, at.confirm_limit_ns),
        "flight.user_hold_ns": units(at.user_hold_limit_ns),
        "landing.since_ns": units(at.land_limit_ns, at.land_second_route_after_ns, at.arm_limit_ns),
        "landing.sent_ns": units(at.land_repeat_period_ns),
        "landing.disarm_sent_ns": units(at.ground_disarm_period_ns),
        "recording.since_ns": units(at.recording_lead_ns),
        "peers.heartbeat_ns": units(at.watchdog_heartbeat_limit_ns),
        "peers.watchdog_started_ns": units(at.watchdog_heartbeat_limit_ns),
        "peers.planner_ns": units(at.planner_status_limit_ns),
        "peers.planner_idle_ns": units(at.planner_idle_limit_ns),
        "peers.landing_stalled_ns": units(at.landing_stall_limit_ns),
        "peers.vehicle_unknown_ns": units(at.vehicle_unknown_limit_ns),
        "silent": units(at.pilot_silence_limit_ns),
        "peers.recorder_ns": units(at.recorder_status_limit_ns),
        "stopping": units(at.command_reply_limit_ns + at.recorder_status_limit_ns),
        "peers.autopilot_ns": units(at.autopilot_status_limit_ns, at.autopilot_link_limit_ns),
        "peers.battery_ns": units(at.battery_age_limit_ns),
        "peers.position_ns": units(at.position_age_limit_ns),
        "vehicle.descending_ns": units(at.descent_time_ns),
        "peers.landing_ns": units(at.landing_detection_limit_ns),
        "flight.motion.sent_ns": units(at.arm_limit_ns),
        "confirm": units(at.flight_end_confirm_ns, at.confirm_limit_ns),
        "pilot": units(at.pilot_confirm_ns),
        "vehicle.moving_ns": units(at.descent_time_ns),
        "vehicle.contradicted_ns": units(at.ground_disarm_after_ns),
        "vehicle.adrift_ns": units(at.descent_time_ns),
        "flown": int(at.max_flight_time_ns < NEVER),
        "started_ns": at.watchdog_startup_time_ns // UNIT,
        "check": units(at.check_max_age_ns, at.check_reply_limit_ns + at.watchdog_startup_time_ns),
    }


def make_key(rules: Rules) -> Callable[[EngineState, Peers, Witness, Tuple[int, ...]], Key]:
    """Return the function that gives the key of a state."""
    caps = _caps(rules)

    def key(state: EngineState, peers: Peers, witness: Witness, old: Tuple[int, ...]) -> Key:
        return (_engine(state, caps), peers, _witness(witness, state, caps), tuple(map(bool, old)))

    return key


def _age(state: EngineState, caps: Dict[str, int], field: str) -> Optional[int]:
    since = attrgetter(field)(state)
    if since is None:
        return None
    age, cap = (state.t_ns - since) // UNIT, caps[field]
    return min(cap, age)


def _engine(state: EngineState, caps: Dict[str, int]) -> Key:
    place, now = state.state, state.t_ns
    base = (
        place,
        state.step,
        state.flight.active,
        _age(state, caps, "entered_ns") if place in _ENTERED else 0,
        _age(state, caps, "step_ns") if place in _STEPPED or state.step is Step.COMMANDING else 0,
        state.sessions > 0,
        _age(state, caps, "started_ns") if place not in _FLIGHT else state.started_ns is None,
        state.session.mission.id if state.session.mission is not None else "",
        state.session.id != "",
        len(state.queue),
        state.session.result,
        state.session.outreach,
        state.preflight.rounds,
        state.preflight.away,
        state.shutting_down,
        state.armed_at_start,
        _start(state),
        state.land_deferred,
        tuple([growths for _, _, growths in state.peers.loop_counters]),
        state.recording.asked,
        state.recording.stopped,
        state.recording.flown_on,
        state.peers.watchdog_started_ns is None or _age(state, caps, "peers.watchdog_started_ns"),
        _age(state, caps, "peers.heartbeat_ns"),
        _age(state, caps, "peers.autopilot_ns"),
        _age(state, caps, "peers.battery_ns"),
        tuple([(c.name, c.code, c.restart) for c in state.peers.components]),
        tuple(
            [
                (
                    f.name,
                    f.action,
                    f.fallback,
                    None if f.deadline_ns is None else max(-1, (f.deadline_ns - now) // UNIT),
                )
                for f in state.failures
            ]
        ),
        _vehicle(state),
        state.peers.landing.landed if state.peers.landing is not None else None,
        state.session.file_index,
        state.session.repetition,
        _agreed(state, "vehicle.takeover", caps["pilot"]),
        state.flight.takeover_noted,
        bool(state.signal),
        state.peers.clock_stalled_s,
        state.flight.was_airborne,
    )
    return (
        base
        + (_checks(state, caps) if place in _CHECKED or state.step is Step.TOUCHDOWN else ())
        + (_recording(state, caps) if state.recording.asked else ())
        + (_flight(state, caps) if place in _FLIGHT or state.flight.active else _after_flight(state, caps))
    )


def _start(state: EngineState) -> Key:
    """Return what is known so far of whether the vehicle was armed at the start."""
    if state.armed_at_start is False or state.started_ns is None:
        return ()
    return _agreed(state, "vehicle.motors", 0), _agreed(state, "vehicle.disarmed", 0)


def _after_flight(state: EngineState, caps: Dict[str, int]) -> Key:
    """Return what is left of a flight: how long an ARM of a takeoff that was called off may still take effect."""
    late = (
        bool(state.flight.commanded)
        and not state.flight.was_airborne
        and _age(state, caps, "flight.motion.sent_ns") < caps["flight.motion.sent_ns"]
    )
    shown = (
        (frozenset(state.flight.commanded), state.flight.confirmed, _age(state, caps, "flight.motion.sent_ns"))
        if late
        else ()
    )
    motors, aloft = state.vehicle.motors, state.vehicle.aloft
    armed_before = motors is not None and aloft is not None and motors.since_ns < aloft.since_ns
    flown = (armed_before, state.flight.mode_before, state.flight.confirmed) if state.flight.was_airborne else ()
    armed = _agreed(state, "vehicle.motors", 0) if late else ()
    goes_on = state.flight.was_airborne and not state.flight.another  # until it has stood for long
    over = _agreed(state, "vehicle.down", caps["confirm"]) if goes_on else ()
    return (
        state.flight.was_airborne,
        state.flight.another and state.flight.was_airborne,
        over,
        state.session.flown,
        flown,
        shown,
        armed,
    )


def _agreed(state: EngineState, field: str, cap: int) -> Key:
    """Return how many statuses agree, and over how long a time, as far as anything asks."""
    agreed = attrgetter(field)(state)
    if agreed is None:
        return ()
    lasts = (agreed.until_ns - agreed.since_ns) // UNIT
    return (agreed.statuses, min(cap, lasts), min(cap, (state.t_ns - agreed.since_ns) // UNIT))


def _vehicle(state: EngineState) -> Key:
    status = state.peers.autopilot
    if status is None:
        return ()
    return (
        status.armed,
        status.landed,
        status.mode,
        status.pilot_in_control,
        status.failsafe,
        status.link_age_s,
        status.height_m,
        status.position_x_m,
        status.vertical_speed_m_s,
        status.horizontal_speed_m_s,
        status.battery_fraction,
        status.tilt_deg,
    )


def _checks(state: EngineState, caps: Dict[str, int]) -> Key:
    now, cap = state.t_ns, caps["check"]
    records = tuple(
        [
            (
                r.outcome is None,
                min(cap, (now - (r.asked_ns if r.replied_ns is None else r.replied_ns)) // UNIT),
                r.ok,
                r.outcome is not None and (r.fixable or r.being_fixed or _comes(r, state, caps)),
            )
            for r in state.preflight.checks
        ]
    )
    planner = state.peers.planner
    loaded = planner is not None and (planner.phase, planner.mission_id, planner.file_index, planner.repetition)
    fix = None if state.preflight.fix_deadline_ns is None else max(-1, (state.preflight.fix_deadline_ns - now) // UNIT)
    down = () if state.state is State.PREFLIGHT else _agreed(state, "vehicle.down", caps["confirm"])
    return (records, fix, state.preflight.load.outcome, loaded, _age(state, caps, "peers.planner_ns"), down)


def _comes(record: CheckRecord, state: EngineState, caps: Dict[str, int]) -> bool:
    """Return True when what a check lacked comes by itself: it says so, or this is a start."""
    early = 0 <= ((record.replied_ns or 0) - (state.started_ns or 0)) // UNIT < caps["started_ns"]
    bad = [row for row in record.rows if not row.passed]
    if record.outcome is Outcome.UNAVAILABLE or not bad:
        return early and record.outcome is Outcome.UNAVAILABLE
    return all(row.heals or (early and row.verdict is Verdict.UNKNOWN and row.age_s is None) for row in bad)


def _recording(state: EngineState, caps: Dict[str, int]) -> Key:
    recorder = state.peers.recorder
    return (
        state.recording.request.outcome,
        state.recording.progressed,
        _age(state, caps, "recording.since_ns"),
        _age(state, caps, "peers.recorder_ns"),
        recorder is not None and (recorder.phase, tuple([p.growing for p in recorder.platforms])),
        state.state is State.DATA_CLEANUP
        and state.peers.recorder_ns is not None
        and min(caps["stopping"], max(-1, (state.peers.recorder_ns - state.entered_ns) // UNIT)),
    )


def _flight(state: EngineState, caps: Dict[str, int]) -> Key:
    planner = state.peers.planner
    return (
        state.flight.was_armed,
        state.flight.was_airborne,
        state.session.flown,
        _agreed(state, "vehicle.down", caps["confirm"]),
        _agreed(state, "vehicle.aloft", 0),
        _agreed(state, "vehicle.motors", 0),
        state.flight.mode_before if state.flight.confirmed is None else "",
        state.flight.mode_shown,
        state.flight.mode_flown,
        state.flight.flown_by,
        state.flight.hold_repeated,
        _age(state, caps, "vehicle.moving_ns"),
        _age(state, caps, "vehicle.contradicted_ns"),
        _age(state, caps, "vehicle.adrift_ns"),
        state.flight.interrupted if state.state is State.HOLD else None,
        state.flight.spent,
        state.flight.flown_without,
        state.flight.motion.outcome,
        state.flight.motion.sent_ns < state.t_ns,
        state.flight.commanded[-1:],
        frozenset(state.flight.commanded),
        state.flight.confirmed,
        state.landing.both_routes,
        state.landing.alarmed,
        state.landing.overdue_alarmed,
        state.landing.armed_alarmed,
        state.landing.lost_alarmed,
        state.flight.another,
        state.landing.second_route_ns is None,
        planner is not None
        and (
            planner.phase,
            planner.waypoint >= planner.waypoints,
            planner.waypoint > 0,
            planner.t_ns > state.flight.motion.sent_ns,
            planner.file_index,
        ),
        _age(state, caps, "peers.planner_ns"),
        _age(state, caps, "peers.planner_idle_ns"),
        _age(state, caps, "peers.landing_stalled_ns"),
        _age(state, caps, "peers.vehicle_unknown_ns"),
        _silence(state, caps["silent"]) if state.state is State.PILOT else 0,
        _since(state.peers.armed_unknown_ns, state, caps["silent"]) if state.state is State.PILOT else 0,
        _age(state, caps, "flight.started_ns") if caps["flown"] or _unheard(state) else 0,
        _age(state, caps, "flight.grounded_ns") if state.state is not State.PILOT else 0,
        _agreed(state, "vehicle.spinning", caps["confirm"]) if state.state is not State.PILOT else (),
        _age(state, caps, "flight.user_hold_ns"),
        _age(state, caps, "landing.since_ns"),
        _age(state, caps, "landing.sent_ns") if state.state is State.LAND else 0,
        _age(state, caps, "landing.disarm_sent_ns"),
        _age(state, caps, "peers.position_ns"),
        _age(state, caps, "vehicle.descending_ns"),
        _age(state, caps, "peers.landing_ns"),
    )


def _silence(state: EngineState, cap: int) -> Optional[int]:
    heard_ns = state.peers.autopilot_ns
    return None if heard_ns is None else min(cap, (state.t_ns - heard_ns) // UNIT)


def _unheard(state: EngineState) -> bool:
    """Return True when the silence of somebody is counted from the takeoff, because nothing was heard of him."""
    heard = (
        state.peers.battery_ns,
        state.peers.position_ns,
        state.peers.planner_ns,
        state.peers.landing_ns,
        state.peers.recorder_ns,
    )
    return None in heard or state.peers.autopilot_ns is None


def _since(since: Optional[int], state: EngineState, cap: int) -> int:
    """Return the age of something that counts in a flight, or right before one; -1: never, or elsewhere."""
    counts = state.state in (*_FLIGHT, State.LOAD_MISSION, State.PILOT) or state.flight.active
    return -1 if since is None or not counts else min(cap, (state.t_ns - since) // UNIT)


def _witness(witness: Witness, state: EngineState, caps: Dict[str, int]) -> Key:
    """Return what the witness knows beyond what the engine's own state says already."""
    now = witness.now
    return (
        witness.vehicle is state.peers.autopilot,
        witness.planner is state.peers.planner or state.peers.planner is None,
        witness.recorder is state.peers.recorder or state.peers.recorder is None,
        witness.beat_ns == state.peers.heartbeat_ns,
        witness.watching,
        witness.unasked,
        witness.flew,
        witness.codes,
        witness.flight,
        witness.airborne,
        min(2, witness.aloft),
        witness.taken > 0 and (min(2, witness.taken), min(caps["pilot"], (now - witness.taken_ns) // UNIT)),
        min(2, witness.armed_late),
        witness.rested,
        -1 if state.state is State.PILOT else _since(witness.ground_ns, state, caps["confirm"]),
        _since(witness.down_ns, state, caps["confirm"]),
        witness.landing,
        witness.landing and min(caps["landing.since_ns"], (now - witness.land_ns) // UNIT),
        -1 if witness.unseen_ns is None else min(caps["step_ns"], (now - witness.unseen_ns) // UNIT),
        witness.landing and min(caps["landing.sent_ns"], (now - witness.sent_ns) // UNIT),
        witness.second,
        witness.second and min(caps["landing.sent_ns"], (now - witness.second_ns) // UNIT),
        witness.alarmed,
        witness.alarms,
        witness.motion,
        witness.flown,
        witness.flown_by,
        witness.answered,
        witness.disarmed_ns is None,
        witness.recording,
        witness.flown_on,
        tuple([(name, min(caps["waited"], waited // UNIT)) for name, waited in witness.waited]),
        witness.load is not None and (witness.load.used, witness.load.outcome, witness.load.leg),
    )
