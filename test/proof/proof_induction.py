"""Induction, past every bound: from any sound state, any event leads to a sound state and breaks no law.

A state is drawn, not reached: a sound one of some place is taken, any of its fields get any other values (times of any
age around every limit, flags of another flight, statuses that contradict each other), the engine comes to rest on it,
and it counts when `sound` holds. The witness of such a state is what its facts say (`witness_of`): it needs no history.
Then comes one event of any kind. A step is drawn from one `random.Random`; Hypothesis hands in its own, and shrinks.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from multiprocessing import Pool
from operator import attrgetter
from random import Random
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from proof_moves import BOOT, perform
from proof_peers import BATTERIES, MISSIONS, RULES, SCENES, UNIT, limited
from proof_sound import TIMES, sound
from proof_worlds import SEEDS, script

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import MissionAction as A
from amaze_autonomy.engine.events import Check, CheckName, Verdict
from amaze_autonomy.engine.rules import Code, Restart, Rules
from amaze_autonomy.engine.state import (
    Agreement,
    ClockApart,
    EngineState,
    OutreachKind,
    Result,
    State,
    Step,
    evolve,
    put,
)
from amaze_autonomy.laws import Moment, Witness, check
from amaze_autonomy.laws.witness import OURS, Asked, Load, hear, see

_PAST = 1000 * UNIT
"""Every drawn state is moved so far from time zero that ages of any length are possible."""
_ASKED_GO = limited(require_go=True)
_QUICK = limited(max_flight_time_ns=5 * UNIT)


def _ways() -> Dict[str, Tuple[str, Rules]]:
    """Return a way to each place; what is drawn begins there."""
    go, fly, land, clean = "checked", "flying", "landing", "cleaning"
    hold = f"{fly} + component:lrf:8:trying vehicle:loitering planner:HOLDING beat"
    return {
        "input": ("boot +", RULES),
        "preflight": ("selected +", RULES),
        "outreach": ("selected + check:battery:fail checks:ok", RULES),
        "ready": ("checked +", _ASKED_GO),
        "recording": (f"{go} +", RULES),
        "load": ("loading +", RULES),
        "loaded": ("loaded +", RULES),
        "arming": ("arming +", RULES),
        "lifting off": ("arming + vehicle:armed", RULES),
        "cancelling": ("arming + user:abort", RULES),
        "climbing": ("climbing +", _QUICK),
        "flying": (f"{fly} +", _QUICK),
        "touchdown": ("touchdown +", RULES),
        "confirming": (f"{fly} + component:lrf:8:trying", RULES),
        "holding": (hold, RULES),
        "user holds": (f"{fly} + user:hold vehicle:loitering planner:HOLDING beat", _QUICK),
        "resuming": (
            f"{fly} + component:lrf:8:trying vehicle:loitering planner:HOLDING beat component:lrf:1:none",
            RULES,
        ),
        "commanding": (f"{land} +", _QUICK),
        "descending": (f"{land} + vehicle:landing", RULES),
        "pilot": (f"{fly} + vehicle:pilot wait wait wait", RULES),
        "cleanup": (f"{clean} +", RULES),
        "outreach for data": (f"{clean} + recorder:FAILED wait wait", RULES),
        "ended": (f"{clean} + wait recorder:COMPLETE", RULES),
    }


class Template(NamedTuple):
    """A sound state of a place, and the rules that it is decided by."""

    place: str
    state: EngineState
    rules: Rules


def _template(place: str, way: str, rules: Rules) -> Template:
    seed, _, more = way.partition(" +")
    node = BOOT
    for move in (*SEEDS[seed], *script(more)):
        node = perform(node, move, rules)
    return Template(place, _later(node.state), rules)


def _later(state: EngineState) -> EngineState:
    """Return the same state at a later time."""
    checks = tuple(
        evolve(r, asked_ns=r.asked_ns + _PAST, replied_ns=None if r.replied_ns is None else r.replied_ns + _PAST)
        for r in state.preflight.checks
    )
    failures = tuple(
        evolve(f, since_ns=f.since_ns + _PAST, deadline_ns=None if f.deadline_ns is None else f.deadline_ns + _PAST)
        for f in state.failures
    )
    later = put(evolve(state, failures=failures), "preflight.checks", checks)
    for name in TIMES:
        time = attrgetter(name)(state)
        later = later if time is None else put(later, name, time + _PAST)
    for name in ("action", "planner", "recorder", "autopilot", "landing"):
        status = getattr(state.peers, name)
        later = later if status is None else put(later, f"peers.{name}", evolve(status, t_ns=status.t_ns + _PAST))
    return later


_TEMPLATES: List[Template] = []


def templates() -> Sequence[Template]:
    """Return a sound state of each place, made once."""
    if not _TEMPLATES:
        _TEMPLATES.extend(_template(place, *way) for place, way in _ways().items())
    return _TEMPLATES


# --- what is drawn ----------------------------------------------------------------------------------------------------

_AGES = tuple(
    sorted(
        {0, 1, UNIT - 1, UNIT + 1, *(k * UNIT for k in range(1, 7)), *(k * UNIT + 1 for k in range(2, 5)), 90 * UNIT}
    )
)
_NAMES = ("gps", "barometer", "lrf", "imu", "stranger")
_CODES = tuple(Code)
Draw = Callable[[Random, EngineState], Any]


def _often(rng: Random) -> bool:
    return rng.randrange(4) > 0


def _seldom(rng: Random) -> bool:
    return rng.randrange(3) == 0


def _rarely(rng: Random) -> bool:
    return rng.randrange(10) == 0


def _time(rng: Random, s: EngineState) -> int:
    return max(0, s.t_ns - rng.choice(_AGES))


def _maybe(draw: Draw) -> Draw:
    return lambda rng, s: None if _seldom(rng) else draw(rng, s)


def _one(*values: Any) -> Draw:
    return lambda rng, _: rng.choice(values)


def _components(rng: Random, _: EngineState) -> Tuple[ev.ComponentStatus, ...]:
    names = sorted(rng.sample(_NAMES, rng.choice((0, 0, 1, 1, 2, 3))))
    return tuple(ev.ComponentStatus(name, rng.choice(_CODES), rng.choice(tuple(Restart))) for name in names)


def _checks(rng: Random, s: EngineState) -> Any:
    """Change when, and what, the checks have answered."""
    records = []
    for record in s.preflight.checks:
        asked = _time(rng, s)
        answered = _often(rng)
        replied = rng.randint(asked, s.t_ns) if answered else None
        outcome = rng.choice((ev.Outcome.ACCEPTED, ev.Outcome.ACCEPTED, *ev.Outcome)) if answered else None
        ok = outcome is ev.Outcome.ACCEPTED and _often(rng)
        fixable = outcome is ev.Outcome.ACCEPTED and not ok and _seldom(rng)
        records.append(
            evolve(
                record, asked_ns=asked, replied_ns=replied, outcome=outcome, ok=ok, fixable=fixable, being_fixed=False
            )
        )
    return tuple(records)


def _agreement(rng: Random, s: EngineState) -> Agreement:
    since = _time(rng, s)
    return Agreement(since, rng.randint(since, s.t_ns), rng.choice((1, 2)))


def _failures(rng: Random, s: EngineState) -> Any:
    """Change how long what is waited for may still last."""
    return tuple(
        f if f.deadline_ns is None else evolve(f, deadline_ns=s.t_ns + rng.choice((1, UNIT, 2 * UNIT)))
        for f in s.failures
    )


def _spent(rng: Random, _: EngineState) -> Tuple[Tuple[str, int], ...]:
    names = sorted(rng.sample(_NAMES, rng.choice((0, 1, 2))))
    return tuple((name, rng.choice((0, 1, UNIT, 2 * UNIT, 3 * UNIT))) for name in names)


def _vehicle(rng: Random, s: EngineState) -> ev.AutopilotStatus:
    said = {"position_x_m": 0.0, "position_y_m": 0.0, "height_m": 0.0, "vertical_speed_m_s": 0.0, "battery_age_s": 0.0}
    said.update(SCENES[rng.choice(tuple(SCENES))])
    said.update(BATTERIES[rng.choice(("good", "good", *BATTERIES))])
    for name, values in _ANY_OF_VEHICLE.items():
        if _rarely(rng):
            said[name] = rng.choice(values)
    return ev.AutopilotStatus(t_ns=s.t_ns, **said)


_ANY_OF_VEHICLE: Mapping[str, Tuple[Any, ...]] = {
    "armed": (True, False, None),
    "landed": tuple(ev.VehicleLanded),
    "mode": ("", "AUTO.LOITER", "AUTO.LAND", "AUTO.MISSION", "OFFBOARD", "POSCTL", "AUTO.RTL", "AUTO.PRECLAND"),
    "pilot_in_control": (True, False),
    "failsafe": (True, False),
    "link_age_s": (0.0, 0.5, 1.0, 1.1, None),
    "height_m": (None, -1.0, 0.9, 1.0, 30.0, 30.1),
    "position_x_m": (None, 0.0, 60.0, 100.0, 100.1),
    "position_y_m": (None, 0.0, -80.0, -80.1),
    "horizontal_speed_m_s": (None, 0.0, 0.5, 3.0),
    "vertical_speed_m_s": (None, 0.0, -0.2, -1.0, 1.0),
    "battery_age_s": (0.0, 1.0, 2.0, 2.1, None),
    "tilt_deg": (None, 0.0, 45.0, 45.1, 70.0, 70.1, 180.0),
}


def _planner(rng: Random, s: EngineState) -> ev.MissionStatus:
    ours = s.session.mission is not None and _often(rng)
    return ev.MissionStatus(
        t_ns=_time(rng, s),
        session_id=s.session.id or "proof-001",
        mission_id=s.session.mission.id if ours else rng.choice(tuple(MISSIONS)),
        phase=ev.MissionPhase.LOADED if s.state is State.LOAD_MISSION and ours else rng.choice(tuple(ev.MissionPhase)),
        waypoint=rng.choice((0, 1, 3)),
        waypoints=3,
        repetition=s.session.repetition if ours else rng.choice((0, 1)),
        file_index=s.session.file_index if ours else rng.choice((0, 1)),
    )


def _recorder(rng: Random, s: EngineState) -> ev.RecordingStatus:
    phase = rng.choice((ev.RecordingPhase.RECORDING, *ev.RecordingPhase))
    platforms = tuple(ev.PlatformRecording(name, growing=_often(rng)) for name in "ab"[: rng.choice((0, 2, 2, 2))])
    return ev.RecordingStatus(t_ns=s.t_ns, session_id=s.session.id or "proof-001", phase=phase, platforms=platforms)


def _action(rng: Random, s: EngineState) -> ev.WatchdogAction:
    listed = tuple(status for status in _components(rng, s) if status.code >= Code.INCONVENIENT)
    code = max((status.code for status in listed), default=rng.choice((Code.NOMINAL, Code.NOMINAL, Code.HOLD)))
    latest = listed[0].name if listed else rng.choice(("", "lrf"))
    return ev.WatchdogAction(
        t_ns=s.t_ns,
        sequence=0,
        loop_counter=rng.randint(0, 4),
        publisher=rng.choice(("", "", "other")),
        code=code,
        latest_component=latest,
        components=listed,
    )


_bool = _one(True, False)
_when = _maybe(_time)
FIELDS: Mapping[str, Draw] = {
    "entered_ns": _time,
    "step_ns": _time,
    "started_ns": _when,
    "session.mission": lambda rng, s: s.session.mission and MISSIONS[rng.choice(tuple(MISSIONS))],
    "queue": lambda rng, s: s.queue if s.state is State.MISSION_INPUT else rng.choice(((), (MISSIONS["one"],))),
    "session.file_index": _one(0, 1),
    "session.repetition": _one(0, 1),
    "session.result": _one(*Result),
    "preflight.checks": _checks,
    "preflight.fix_deadline_ns": lambda rng, s: s.t_ns + rng.choice((-UNIT, 0, 1, UNIT)),
    "preflight.rounds": _one(0, 1, 2, 3),
    "preflight.away": _one(False, False, True),
    "session.outreach": _one(*OutreachKind),
    "peers.watchdog_started_ns": _when,
    "preflight.load.outcome": _one(None, *ev.Outcome),
    "flight.active": _bool,
    "flight.started_ns": _when,
    "flight.was_armed": _bool,
    "flight.was_airborne": _bool,
    "session.flown": _bool,
    "vehicle.down": _maybe(_agreement),
    "vehicle.aloft": _maybe(_agreement),
    "vehicle.motors": _maybe(_agreement),
    "vehicle.disarmed": _maybe(_agreement),
    "vehicle.spinning": _maybe(_agreement),
    "flight.grounded_ns": _when,
    "flight.interrupted": _one(State.TAKEOFF, State.MISSION),
    "flight.user_hold_ns": _when,
    "failures": _failures,
    "flight.spent": _spent,
    "flight.flown_without": lambda rng, _: tuple(sorted(rng.sample(_NAMES, rng.choice((0, 1))))),
    "flight.motion.sent_ns": _time,
    "flight.motion.outcome": _one(None, *ev.Outcome),
    "flight.commanded": lambda rng, s: (*rng.sample(tuple(A), rng.choice((0, 1, 2))), *s.flight.commanded[-1:]),
    "flight.confirmed": _one(None, *A),
    "flight.mode_before": _one("", "AUTO.LOITER", "AUTO.MISSION", "POSCTL"),
    "flight.mode_shown": _one("", "AUTO.LOITER", "AUTO.MISSION"),
    "flight.mode_flown": _one("", "AUTO.TAKEOFF", "AUTO.LOITER", "OFFBOARD", "AUTO.MISSION"),
    "flight.flown_by": _one("", "OFFBOARD", "AUTO.MISSION"),
    "flight.hold_repeated": _bool,
    "flight.another": _bool,
    "vehicle.moving_ns": _when,
    "vehicle.contradicted_ns": _when,
    "vehicle.adrift_ns": _when,
    "vehicle.takeover": _maybe(_agreement),
    "flight.takeover_noted": _bool,
    "landing.since_ns": _when,
    "landing.sent_ns": _time,
    "landing.second_route_ns": _when,
    "landing.both_routes": _bool,
    "landing.alarmed": _bool,
    "landing.overdue_alarmed": _bool,
    "landing.armed_alarmed": _bool,
    "landing.lost_alarmed": _bool,
    "landing.disarm_sent_ns": _when,
    "shutting_down": _bool,
    "armed_at_start": _one(None, True, False),
    "land_deferred": _one(None, None, "", "the transmitter's land switch"),
    "recording.request.outcome": _one(None, *ev.Outcome),
    "recording.since_ns": _when,
    "recording.progressed": _bool,
    "recording.over": _bool,
    "recording.stopped": _bool,
    "recording.flown_on": _bool,
    "peers.action": _maybe(_action),
    "peers.heartbeat_ns": _when,
    "peers.loop_counters": _one((), (("", 3, 2),), (("", 0, 0), ("other", 2, 1)), (("", 2, 1),)),
    "peers.clocks_apart": lambda rng, s: rng.choice(((), (ClockApart("planner", 9 * UNIT, _time(rng, s)),))),
    "peers.clock_stalled_s": _one(0.0, 0.5, 1.5),
    "peers.components": _components,
    "peers.planner": _maybe(_planner),
    "peers.planner_ns": _when,
    "peers.planner_idle_ns": _when,
    "peers.landing_stalled_ns": _when,
    "peers.recorder": _maybe(_recorder),
    "peers.recorder_ns": _when,
    "peers.autopilot": _maybe(_vehicle),
    "peers.autopilot_ns": _when,
    "peers.vehicle_unknown_ns": _when,
    "peers.armed_unknown_ns": _when,
    "peers.battery_ns": _when,
    "peers.position_ns": _when,
    "vehicle.descending_ns": _when,
    "peers.landing": _maybe(lambda rng, s: ev.LandedStatus(t_ns=s.t_ns, landed=rng.choice(tuple(ev.Landed)))),
    "peers.landing_ns": _when,
}
"""Every field that is drawn, and from what."""

LEFT_ALONE: Mapping[str, str] = {
    "t_ns": "all other times are drawn around it",
    "state": "of the template: there is one for each place",
    "step": "of the template",
    "next_id": "a counter",
    "decisions": "a counter",
    "label": "a text",
    "sessions": "a counter; none yet, and some, by the templates",
    "session.id": "a text",
    "session.data_result": "nothing asks for it",
    "cause": "a text",
    "preflight.load.id": "a number that was given out",
    "landing.cause": "a text",
    "landing.alarms": "texts that are shown",
    "preflight.load.message": "a text",
    "preflight.load.sent_ns": "nothing asks for it",
    "flight.motion.id": "a number that was given out",
    "flight.motion.message": "a text",
    "recording.asked": "there is a recording, or none, by the templates",
    "recording.request.id": "a number that was given out",
    "recording.request.message": "a text",
    "recording.request.sent_ns": "nothing asks for it",
    "recording.location": "a text",
    "said": "a text",
    "shown": "a text",
    "signal": "a text",
    "vehicle.takeover_reason": "a text",
}
"""What is not drawn, and why."""


class Drawn(NamedTuple):
    """A sound state that nobody has reached: the place that it was drawn from, and the fields that were changed."""

    place: str
    changed: Tuple[str, ...]
    state: EngineState
    rules: Rules


def drawn_state(rng: Random, place: str = "") -> Optional[Drawn]:
    """Draw a state, of one place or of any; None when what was drawn is not sound, even at rest."""
    template = rng.choice([each for each in templates() if place in ("", each.place)])
    state = template.state
    names = tuple(sorted(rng.sample(_FIELD_NAMES, rng.choice((1, 2, 3, 4, 6, 10)))))
    for name in names:
        state = put(state, name, FIELDS[name](rng, state))
    state, _ = engine.decide(state, ev.Tick(t_ns=state.t_ns), template.rules)
    return None if sound(state, template.rules) else Drawn(template.place, names, state, template.rules)


_FIELD_NAMES = tuple(FIELDS)


def drawn_event(rng: Random, state: EngineState) -> ev.Event:
    """Draw an event that comes now or a little later."""
    event = rng.choice(_EVENTS)(rng, state)
    later = rng.choice((0, 0, 1, UNIT, UNIT + 1, 2 * UNIT, rng.choice(_AGES)))
    changes: Dict[str, Any] = {"t_ns": state.t_ns + later}
    if hasattr(event, "age_ns") and _rarely(rng):
        changes["age_ns"] = rng.choice((1, UNIT, UNIT + 1, 9 * UNIT, -(UNIT // 5), -(UNIT // 5) - 1))
    return evolve(event, **changes)


def _reply(rng: Random, s: EngineState) -> ev.Event:
    identity = rng.choice(
        (s.flight.motion.id, s.preflight.load.id, s.recording.request.id, max(0, s.flight.motion.id - 1), s.next_id)
    )
    return ev.Reply(t_ns=s.t_ns, command_id=identity, outcome=rng.choice(tuple(ev.Outcome)))


def _check_reply(rng: Random, s: EngineState) -> ev.Event:
    record = rng.choice(s.preflight.checks) if s.preflight.checks else None
    row = Check("row", rng.choice((Verdict.PASS, Verdict.PASS, *Verdict)))
    return ev.CheckReply(
        t_ns=s.t_ns,
        command_id=record.command_id if record is not None else 1,
        check=record.check if record is not None else CheckName.BATTERY,
        outcome=rng.choice((ev.Outcome.ACCEPTED, ev.Outcome.ACCEPTED, *ev.Outcome)),
        ok=_often(rng),
        checks=rng.choice(((), (row,))),
        fixable=_seldom(rng),
    )


_EVENTS: Tuple[Callable[[Random, EngineState], ev.Event], ...] = (
    *(lambda _, s: ev.Tick(t_ns=s.t_ns),) * 3,
    *(_vehicle,) * 4,
    *(_action,) * 3,
    *(_planner,) * 2,
    lambda rng, s: ev.WatchdogInfo(t_ns=s.t_ns, sequence=0, changed=(), components=_components(rng, s)),
    _recorder,
    lambda rng, s: ev.LandedStatus(t_ns=s.t_ns, landed=rng.choice(tuple(ev.Landed))),
    *(_reply,) * 2,
    *(_check_reply,) * 2,
    *(lambda rng, s: ev.UserRequest(t_ns=s.t_ns, command=rng.choice(tuple(ev.UserCommand)), request_id=7),) * 2,
    lambda rng, s: ev.MissionSelected(
        t_ns=s.t_ns, missions=tuple(MISSIONS[name] for name in rng.sample(tuple(MISSIONS), rng.choice((1, 2))))
    ),
    lambda _, s: ev.MissionRejected(t_ns=s.t_ns, mission_id="none", error="there is no such mission", request_id=7),
    lambda rng, s: ev.ClockStatus(t_ns=s.t_ns, stalled_s=rng.choice((0.0, 0.5, 1.5))),
    lambda _, s: ev.Shutdown(t_ns=s.t_ns, signal="SIGTERM"),
    lambda _, s: ev.EngineStarted(t_ns=s.t_ns, label="proof", resumed=True),
)


# --- the witness of a state -------------------------------------------------------------------------------------------


_ALARMS = {
    "alarmed": "land_alarm",
    "overdue_alarmed": "land_limit",
    "armed_alarmed": "stays_armed",
    "lost_alarmed": "autopilot_lost",
}


def witness_of(s: EngineState, rules: Rules) -> Witness:
    """Return the witness who has seen what a state says of its past, and nothing else."""
    flight = "none" if not s.flight.active else "armed" if s.flight.was_armed else "commanded"
    landing = s.landing.since_ns is not None and s.state in (State.LAND, State.PILOT)
    watching = s.peers.watchdog_started_ns is not None
    beat = s.peers.heartbeat_ns
    motion = s.flight.commanded[-1] if s.flight.commanded else None
    mode = s.peers.autopilot.mode if s.peers.autopilot is not None else ""
    asked = {each for action in s.flight.commanded for each in OURS[action]}
    foreign = s.vehicle.takeover is not None and mode not in asked  # another mode had answered it
    return Witness(
        now=s.t_ns,
        vehicle=s.peers.autopilot,
        vehicle_ns=s.peers.autopilot_ns or 0,
        battery_ns=s.peers.battery_ns,
        descending_ns=s.vehicle.descending_ns,
        detection=s.peers.landing.landed if s.peers.landing is not None else ev.Landed.UNKNOWN,
        detection_ns=s.peers.landing_ns or 0,
        beat_ns=max(s.peers.watchdog_started_ns or 0, beat or 0) if watching else beat,
        counters=s.peers.loop_counters,
        unarmed_ns=None if s.vehicle.disarmed is None else s.vehicle.disarmed.since_ns,
        spinning_ns=None if s.vehicle.spinning is None else s.vehicle.spinning.since_ns,
        taken=0 if s.vehicle.takeover is None else s.vehicle.takeover.statuses,
        taken_ns=0 if s.vehicle.takeover is None else s.vehicle.takeover.since_ns,
        ground_ns=s.flight.grounded_ns,
        rested=2 if s.armed_at_start is False else 0 if s.vehicle.disarmed is None else s.vehicle.disarmed.statuses,
        down_ns=s.vehicle.down.since_ns if s.vehicle.down is not None else None,
        watching=watching,
        planner=s.peers.planner,
        planner_ns=s.peers.planner_ns or 0,
        idle_ns=s.peers.planner_idle_ns,
        stalled_ns=s.peers.landing_stalled_ns,
        moving_ns=s.vehicle.moving_ns,
        contradicted_ns=s.vehicle.contradicted_ns,
        unknown_ns=s.peers.vehicle_unknown_ns,
        armed_unknown_ns=s.peers.armed_unknown_ns,
        recorder=s.peers.recorder,
        recorder_ns=s.peers.recorder_ns or 0,
        growing_ns=s.recording.since_ns,
        codes=tuple((status.name, int(status.code)) for status in s.peers.components),
        given_up=tuple(status.name for status in s.peers.components if status.restart is Restart.GIVEN_UP),
        checks=tuple((r.check.value, Asked(r.command_id, r.asked_ns, r.replied_ns, r.ok)) for r in s.preflight.checks),
        load=_load_of(s),
        session=s.session.id,
        flight=flight,
        flight_ns=s.flight.started_ns or 0,
        airborne=s.flight.was_airborne and s.flight.active,
        mode_before=s.flight.mode_before,
        aloft=s.vehicle.aloft.statuses if s.vehicle.aloft is not None else 0,
        landing=landing,
        land_ns=s.landing.since_ns or 0,
        unseen_ns=s.step_ns if s.step is Step.COMMANDING else None,
        sent_ns=s.landing.sent_ns,
        second=landing and s.landing.second_route_ns is not None,
        second_ns=s.landing.sent_ns,
        alarmed=any(getattr(s.landing, name) for name in _ALARMS),
        alarms=tuple(key for name, key in _ALARMS.items() if getattr(s.landing, name)),
        last_id=s.next_id - 1,
        motion=motion,
        motion_id=s.flight.motion.id,
        motion_ns=s.flight.motion.sent_ns,
        flown=s.flight.mode_flown if s.flight.mode_flown in ("OFFBOARD", "AUTO.MISSION") else "",
        flown_by=s.flight.flown_by,
        answered=(s.flight.confirmed is motion and motion is not None) or foreign,
        disarmed_ns=s.landing.disarm_sent_ns,
        recording=_recording_of(s),
        flown_on=s.recording.flown_on,
        flew=s.session.flown,
        user_hold=s.flight.user_hold_ns is not None,
        waited=_waited_of(s, rules),
        shutting_down=s.shutting_down,
        unasked=s.preflight.away,
        stalled_s=s.peers.clock_stalled_s,
    )


def _load_of(s: EngineState) -> Optional[Load]:
    if not s.preflight.load.id or s.session.mission is None:
        return None
    used = s.state not in (State.LOAD_MISSION,) and not (s.state is State.MISSION and not s.flight.was_armed)
    return Load(
        s.preflight.load.id,
        s.session.id,
        s.session.mission.id,
        (s.session.repetition, s.session.file_index),
        s.preflight.load.outcome,
        used,
    )


def _recording_of(s: EngineState) -> str:
    if not s.recording.asked:
        return "none"
    about_data = s.state is State.OUTREACH and s.session.outreach is OutreachKind.DATA
    if s.state in (State.DATA_CLEANUP, State.MISSION_ENDED) or about_data:
        complete = s.peers.recorder is not None and s.peers.recorder.phase is ev.RecordingPhase.COMPLETE
        return "complete" if complete else "stopped"
    return "asked"


def _waited_of(s: EngineState, rules: Rules) -> Tuple[Tuple[str, int], ...]:
    waited = dict(s.flight.spent)
    budgets = {rule.name: rule.wait_limit_ns for rule in rules.components}
    for f in s.failures:
        if f.deadline_ns is not None and f.name in {status.name for status in s.peers.components}:
            waited[f.name] = max(0, budgets.get(f.name, rules.limits.unlisted_wait_limit_ns) - (f.deadline_ns - s.t_ns))
    return tuple(sorted(waited.items()))


# --- steps ------------------------------------------------------------------------------------------------------------


class BrokenStep(NamedTuple):
    """A step that breaks a law or leads to an unsound state."""

    what: str
    why: str
    drawn: Drawn
    event: ev.Event
    after: EngineState


def drawn_step(rng: Random, drawn: Drawn, applied: Dict[str, int]) -> Optional[BrokenStep]:
    """Take one step from a drawn state; return what it breaks."""
    state, rules = drawn.state, drawn.rules
    event = drawn_event(rng, state)
    after, commands = engine.decide(state, event, rules)
    witness = witness_of(state, rules)
    saw = see(witness, event, state, rules.limits)
    moment = Moment(state, event, commands, after, (witness, saw, hear(saw, event, commands, after)), rules)
    for law, why in check(moment):
        if why:
            return BrokenStep(law.name, why, drawn, event, after)
        applied[law.name] = applied.get(law.name, 0) + 1
    wrong = sound(after, rules)
    return BrokenStep("every_state_is_sound", wrong[0], drawn, event, after) if wrong else None


@dataclass
class Induction:
    """What came of an induction: steps taken, states drawn and not sound, states by place, laws, and what broke."""

    steps: int = 0
    rejected: int = 0
    places: Dict[str, int] = field(default_factory=dict)
    applied: Dict[str, int] = field(default_factory=dict)
    broken: List[BrokenStep] = field(default_factory=list)

    def add(self, other: Induction) -> None:
        """Add what came of another one."""
        self.steps, self.rejected = self.steps + other.steps, self.rejected + other.rejected
        self.broken += other.broken
        for ours, theirs in ((self.places, other.places), (self.applied, other.applied)):
            for name, count in theirs.items():
                ours[name] = ours.get(name, 0) + count


_EVENTS_OF_A_STATE = 4


def induction(steps: int, seed: int, *, most: int = 1, place: str = "") -> Induction:
    """Take steps from drawn states, some from each, until there are enough or `most` of them break something."""
    rng, found = Random(seed), Induction()
    while found.steps < steps and len(found.broken) < most:
        drawn = drawn_state(rng, place)
        if drawn is None:
            found.rejected += 1
            continue
        name = f"{drawn.state.state.value} {drawn.state.step.value}".strip()
        found.places[name] = found.places.get(name, 0) + 1
        for _ in range(_EVENTS_OF_A_STATE):
            found.steps += 1
            broken = drawn_step(rng, drawn, found.applied)
            if broken is not None:
                found.broken.append(broken)
    return found


PORTION = 25_000
"""Steps that one process takes at a time; each portion has a seed of its own, whoever takes it."""


def _portion(work: Tuple[int, int]) -> Induction:
    return induction(*work)


def inductions(steps: int, seed: int, jobs: int, tell: Callable[[Induction], None] = lambda _: None) -> Induction:
    """Take many steps in several processes; the same seed takes the same steps, however many processes there are."""
    sizes = [PORTION] * (steps // PORTION) + ([steps % PORTION] if steps % PORTION else [])
    found = Induction()
    with Pool(jobs) as pool:
        for each in pool.imap(_portion, [(size, seed * 1_000_000 + number) for number, size in enumerate(sizes)]):
            found.add(each)
            tell(found)
            if found.broken:
                break
    return found


def told(broken: BrokenStep) -> str:
    """Return a broken step as lines: what is drawn of the state, the event, where it led."""
    drawn = broken.drawn
    values = [f"  {name} = {attrgetter(name)(drawn.state)!r}" for name in ("t_ns", *drawn.changed)]
    lines = (
        f"{broken.what}: {broken.why}",
        f"a state drawn from {drawn.place}: {drawn.state.state.value} {drawn.state.step.value}, with",
        *values,
        f"event {broken.event!r}",
        f"leads to {broken.after.state.value} {broken.after.step.value}",
    )
    return "\n".join(lines)
