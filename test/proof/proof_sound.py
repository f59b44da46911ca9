"""What is true of the engine's state between any two events: the invariant of the induction, one page.

`sound` returns the sentences that do not hold. It is written from the specification and from what each field says that
it is; it shares no table with the engine but the types, and asks it one thing only: the same moment again changes
nothing. The explorer checks it on every state that it reaches; the induction (`proof_induction.py`) begins at any state
for which it holds, however it could have come about, and shows that every event leads to such a state again.
"""

from __future__ import annotations

from dataclasses import is_dataclass
from operator import attrgetter
from typing import Any, Callable, Iterator, List, Mapping, Optional, Tuple

from proof_peers import LIMITS

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine.commands import MissionAction as A
from amaze_autonomy.engine.events import CheckName, Outcome, RecordingPhase, Tick
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, OutreachKind, Result, State, Step
from amaze_autonomy.engine.timers import next_deadline
from amaze_autonomy.laws.moment import ENDLESS, FLIGHT, GROUND

Holds = Callable[[EngineState], bool]
SENTENCES: List[Tuple[str, Holds]] = []


def _is(words: str) -> Callable[[Holds], Holds]:
    def register(holds: Holds) -> Holds:
        SENTENCES.append((words, holds))
        return holds

    return register


def sound(state: EngineState, rules: Rules) -> Tuple[str, ...]:
    """Return what is not true of a state; empty: it is sound."""
    wrong = [words for words, holds in SENTENCES if not holds(state)]
    return tuple(wrong or _rests(state, rules))


def _rests(state: EngineState, rules: Rules) -> Iterator[str]:
    after, commands = engine.decide(state, Tick(t_ns=state.t_ns), rules)
    if commands or after != state:
        yield "The engine has come to rest: the same moment again changes nothing."
    if state.state not in ENDLESS and state.state is not State.LAND and next_deadline(state, rules) is None:
        yield "Where no person is waited for, some deadline is to come."


_STEPS: Mapping[State, Tuple[Step, ...]] = {
    State.TAKEOFF: (Step.ARMING, Step.LIFTING_OFF, Step.CLIMBING, Step.CANCELLING),
    State.MISSION: (Step.FLYING, Step.TOUCHDOWN),
    State.HOLD: (Step.CONFIRMING, Step.HOLDING, Step.RESUMING),
    State.LAND: (Step.COMMANDING, Step.DESCENDING),
}
_LAST_COMMANDS: Mapping[Step, Tuple[A, ...]] = {
    Step.ARMING: (A.TAKEOFF,),
    Step.LIFTING_OFF: (A.TAKEOFF,),
    Step.CLIMBING: (A.TAKEOFF, A.RESUME),
    Step.CANCELLING: (A.ABORT,),
    Step.FLYING: (A.TAKEOFF, A.RESUME),
    Step.CONFIRMING: (A.HOLD,),
    Step.HOLDING: (A.HOLD,),
    Step.RESUMING: (A.RESUME,),
    Step.COMMANDING: (A.LAND,),
    Step.DESCENDING: (A.LAND,),
}
_SESSION = (State.PREFLIGHT, State.READY, State.START_RECORDING, State.LOAD_MISSION, State.OUTREACH)
_ASKED = (State.PREFLIGHT, State.READY, State.START_RECORDING, State.LOAD_MISSION)
_RECORDED = (State.LOAD_MISSION, State.TAKEOFF, State.MISSION, State.HOLD)
_PARTS = tuple(
    name for name, value in vars(EngineState()).items() if name not in ("said", "shown") and is_dataclass(value)
)
_ASKED_OF_PEERS = ("flight.motion", "preflight.load", "recording.request")
FIELDS_OF_A_STATE: Tuple[str, ...] = tuple(
    path
    for holder in ("", *_PARTS, *_ASKED_OF_PEERS)
    for name in vars(attrgetter(holder)(EngineState()) if holder else EngineState())
    for path in (f"{holder}.{name}".lstrip("."),)
    if path not in (*_PARTS, *_ASKED_OF_PEERS)
)
"""Every field of the state, by its path through the parts."""
TIMES = tuple(path for path in FIELDS_OF_A_STATE if path.endswith("_ns"))


def _from(since: Optional[int], until: Optional[int]) -> bool:
    return since is None or (until is not None and since <= until)


# --- where and when ---------------------------------------------------------------------------------------------------


@_is("No mode has shown a resume that is under way: what it leads to is noted once it flies on.")
def _(s: EngineState) -> bool:
    return (s.state, s.step) != (State.HOLD, Step.RESUMING) or s.flight.mode_flown == ""


@_is("A step is one of its state's.")
def _(s: EngineState) -> bool:
    return s.step in _STEPS.get(s.state, (Step.NONE,))


@_is("Nothing happened later than now, but for the end of the watchdog's time to fix.")
def _(s: EngineState) -> bool:
    return all(_from(attrgetter(name)(s), s.t_ns) for name in TIMES if name != "preflight.fix_deadline_ns")


@_is("A state is entered before its step.")
def _(s: EngineState) -> bool:
    return 0 <= s.entered_ns <= s.step_ns


@_is("Ids were given out: what is waited for has one that is not new.")
def _(s: EngineState) -> bool:
    identities = (
        s.flight.motion.id,
        s.preflight.load.id,
        s.recording.request.id,
        *(record.command_id for record in s.preflight.checks),
    )
    return 0 <= min(identities) <= max(identities) < s.next_id


@_is("It was not armed at the start, or is not any more, as soon as two statuses in a row say disarmed.")
def _(s: EngineState) -> bool:
    agreed = s.vehicle.disarmed is not None and s.vehicle.disarmed.statuses > 1
    return not agreed or s.started_ns is None or s.armed_at_start is False


@_is("Whether it was armed at the start is known of an engine that was started.")
def _(s: EngineState) -> bool:
    return s.armed_at_start is None or s.started_ns is not None


@_is("Whether it was armed at the start is known as soon as two statuses in a row say armed.")
def _(s: EngineState) -> bool:
    agreed = s.vehicle.motors is not None and s.vehicle.motors.statuses > 1
    return not agreed or s.started_ns is None or s.armed_at_start is not None


# --- the mission ------------------------------------------------------------------------------------------------------


@_is("Where a mission is selected and nothing is over, there is a session and a mission.")
def _(s: EngineState) -> bool:
    needs = s.state in _SESSION or s.state in (State.TAKEOFF, State.MISSION, State.HOLD)
    return not needs or (s.session.mission is not None and s.session.id != "" and s.sessions > 0)


@_is("In MISSION_INPUT nothing is left of a mission, and none waits.")
def _(s: EngineState) -> bool:
    left = (s.session.id, s.session.mission, s.queue, s.session.result, s.preflight.checks)
    return s.state is not State.MISSION_INPUT or left == ("", None, (), Result.NONE, ())


@_is("Behind the pilot no mission waits.")
def _(s: EngineState) -> bool:
    return s.state is not State.PILOT or s.queue == ()


@_is("The file and the repetition are the mission's.")
def _(s: EngineState) -> bool:
    in_mission = s.session.mission is None or (
        s.session.file_index < s.session.mission.files and s.session.repetition < s.session.mission.repetitions
    )
    return s.session.file_index >= 0 and s.session.repetition >= 0 and (in_mission or s.session.id == "")


@_is("What is over has a result; what is before, or on its way, has none.")
def _(s: EngineState) -> bool:
    if s.state in (*_ASKED, State.TAKEOFF, State.MISSION, State.HOLD):
        return s.session.result is Result.NONE
    over = (State.DATA_CLEANUP, State.MISSION_ENDED, State.LAND, State.PILOT)
    return s.state not in over or s.session.result is not Result.NONE


@_is("A person is asked about checks, before there is a result, or about the data of a recording, after it.")
def _(s: EngineState) -> bool:
    if s.state is not State.OUTREACH:
        return True
    about_data = s.session.outreach is OutreachKind.DATA and s.recording.asked and s.session.result is not Result.NONE
    return about_data or (s.session.outreach is OutreachKind.PREFLIGHT and s.session.result is Result.NONE)


# --- before takeoff ---------------------------------------------------------------------------------------------------


@_is("All five checks are asked, or none; an answered one was answered after it was asked; only an answer is ok.")
def _(s: EngineState) -> bool:
    whole = [record.check for record in s.preflight.checks] in ([], list(CheckName))
    answered = all(
        (record.outcome is None) == (record.replied_ns is None)
        and record.asked_ns <= (s.t_ns if record.replied_ns is None else record.replied_ns) <= s.t_ns
        and (record.outcome is Outcome.ACCEPTED or not record.ok)
        for record in s.preflight.checks
    )
    return whole and answered


@_is("Where checks are asked, they are there; after them, every one has passed.")
def _(s: EngineState) -> bool:
    if s.state in (State.READY, State.START_RECORDING):
        return len(s.preflight.checks) == len(CheckName) and all(record.ok for record in s.preflight.checks)
    return (s.state not in _ASKED and s.step is not Step.TOUCHDOWN) or len(s.preflight.checks) == len(CheckName)


@_is("The watchdog's time to fix ends.")
def _(s: EngineState) -> bool:
    return s.state is not State.PREFLIGHT or s.preflight.fix_deadline_ns is not None


@_is("Whose start was accepted watches: Ready, and what follows, rely on it.")
def _(s: EngineState) -> bool:
    after = (State.READY, State.START_RECORDING, State.LOAD_MISSION, State.TAKEOFF, State.MISSION, State.HOLD)
    return s.state not in after or s.peers.watchdog_started_ns is not None


@_is("A takeoff is recorded: who loads or flies has asked for a recording, and it is not over.")
def _(s: EngineState) -> bool:
    return s.state not in _RECORDED or (s.recording.asked and not s.recording.over)


@_is("A recording is proven only while the recorder's last status says so.")
def _(s: EngineState) -> bool:
    r = s.peers.recorder
    grows = r is not None and r.phase is RecordingPhase.RECORDING and bool(r.platforms)
    return s.recording.since_ns is None or (grows and all(p.growing for p in r.platforms))


# --- the flight -------------------------------------------------------------------------------------------------------


@_is("On the ground there is no flight, no landing, and no hold.")
def _(s: EngineState) -> bool:
    return s.state not in GROUND or (
        not s.flight.active and s.landing.since_ns is None and s.flight.user_hold_ns is None
    )


@_is("Between two files there is no flight.")
def _(s: EngineState) -> bool:
    return s.step is not Step.TOUCHDOWN or (not s.flight.active and s.flight.user_hold_ns is None)


@_is("A flight has begun; where one is flown it goes on, or the vehicle was armed and has come down.")
def _(s: EngineState) -> bool:
    begun = s.flight.started_ns is not None
    came_down = s.flight.was_armed and s.flight.grounded_ns is not None
    flown = s.state in FLIGHT and s.step is not Step.TOUCHDOWN
    return begun if s.flight.active else not flown or (begun and came_down)


@_is("Before it is armed, it is in flight all the same: from the command on.")
def _(s: EngineState) -> bool:
    return s.step not in (Step.ARMING, Step.LIFTING_OFF, Step.CANCELLING) or s.flight.active


@_is("What has flown was armed.")
def _(s: EngineState) -> bool:
    return s.flight.was_armed or not s.flight.was_airborne


@_is("Statuses that agree came one after the other, up to the last one that was heard.")
def _(s: EngineState) -> bool:
    agreed = [
        each
        for each in (
            s.vehicle.down,
            s.vehicle.aloft,
            s.vehicle.motors,
            s.vehicle.disarmed,
            s.vehicle.spinning,
            s.vehicle.takeover,
        )
        if each is not None
    ]
    return all(each.since_ns <= each.until_ns <= s.t_ns and each.statuses in (1, 2) for each in agreed)


@_is("What is down is not in the air; what has taken the vehicle over is noted no longer than it is said.")
def _(s: EngineState) -> bool:
    flies = s.state in FLIGHT and s.step is not Step.TOUCHDOWN
    denied = s.vehicle.takeover is None and not _unheard(s)
    noted = s.flight.takeover_noted and denied and flies
    return (s.vehicle.down is None or (s.vehicle.aloft is None and s.vehicle.motors is None)) and not noted


def _unheard(s: EngineState) -> bool:
    """Tell whether the engine was started again in flight, and has not heard the vehicle yet."""
    return s.flight.active and s.peers.autopilot is None


@_is("What is armed is not disarmed, and what is down is.")
def _(s: EngineState) -> bool:
    at = s.vehicle
    spins = at.spinning is None or at.motors is not None
    return spins and (at.motors is None or at.disarmed is None) and (at.down is None or at.disarmed is not None)


@_is("A landing is put off only while it is not clear who has control of a flight, or whether it is over.")
def _(s: EngineState) -> bool:
    clear = s.vehicle.takeover is None and not _unheard(s) and s.flight.active
    return s.land_deferred is None or not clear


@_is("The last command is the one that the step is about.")
def _(s: EngineState) -> bool:
    expected = _LAST_COMMANDS.get(s.step)
    if expected is None:
        nothing = s.flight.commanded == () and s.flight.confirmed is None and not s.flight.mode_before
        return s.state is not State.PILOT or nothing
    return bool(s.flight.commanded) and s.flight.commanded[-1] in expected and s.flight.motion.id > 0


@_is("On its way, nothing was commanded that ends a flight.")
def _(s: EngineState) -> bool:
    on_its_way = s.step in (Step.ARMING, Step.LIFTING_OFF, Step.CLIMBING, Step.FLYING) or s.state is State.HOLD
    return not on_its_way or not {A.LAND, A.ABORT} & {*s.flight.commanded, s.flight.confirmed}


@_is("A hold has interrupted the takeoff or the mission; only in a hold does the user hold.")
def _(s: EngineState) -> bool:
    if s.state is State.HOLD:
        return s.flight.interrupted in (State.TAKEOFF, State.MISSION)
    return s.flight.user_hold_ns is None


@_is("Budgets are what is left of a wait: none is spent twice, none outlasts limit and word of the watchdog.")
def _(s: EngineState) -> bool:
    spent = dict(s.flight.spent)
    beat_ns, limit_ns = s.peers.heartbeat_ns or 0, LIMITS.watchdog_heartbeat_limit_ns
    unheard = s.started_ns is not None and beat_ns <= s.started_ns and s.t_ns - s.started_ns < limit_ns
    return (
        len(spent) == len(s.flight.spent)
        and all(value >= 0 for value in spent.values())
        and all(f.deadline_ns is None or f.deadline_ns > s.t_ns or unheard for f in s.failures)
        and len({f.name for f in s.failures}) == len(s.failures)
    )


@_is("A flight on its way has no mark of a landing, of the last one neither: nobody alarmed, no second route due.")
def _(s: EngineState) -> bool:
    on_its_way = s.step in (*_STEPS[State.TAKEOFF], Step.FLYING) or s.state is State.HOLD
    at = s.landing
    marks = (
        at.alarmed,
        at.overdue_alarmed,
        at.armed_alarmed,
        at.lost_alarmed,
        at.both_routes,
        at.second_route_ns is not None,
    )
    return not on_its_way or not any(marks)


# --- the landing ------------------------------------------------------------------------------------------------------


@_is("A landing has begun exactly in LAND, or where the pilot has taken it over.")
def _(s: EngineState) -> bool:
    return (
        (s.landing.since_ns is not None)
        if s.state is State.LAND
        else (s.landing.since_ns is None or s.state is State.PILOT)
    )


@_is("LAND was sent since the landing began; so was the second route, if it was; both means both.")
def _(s: EngineState) -> bool:
    if s.state is not State.LAND or s.landing.since_ns is None:
        return True
    second = s.landing.second_route_ns is None or s.landing.since_ns <= s.landing.second_route_ns <= s.landing.sent_ns
    return (
        s.landing.since_ns <= s.landing.sent_ns
        and second
        and (s.landing.second_route_ns is not None or not s.landing.both_routes)
    )


@_is("The second route, once it was taken, is due for good: commanded by both, or late.")
def _(s: EngineState) -> bool:
    if s.state is not State.LAND or s.landing.second_route_ns is None or s.landing.since_ns is None:
        return True
    return s.landing.both_routes or s.landing.second_route_ns - s.landing.since_ns >= LIMITS.land_second_route_after_ns


@_is("Disarming was sent since it stands on the ground.")
def _(s: EngineState) -> bool:
    grounded = s.flight.grounded_ns is not None and _from(s.flight.grounded_ns, s.landing.disarm_sent_ns)
    return s.landing.disarm_sent_ns is None or s.state not in FLIGHT or grounded


# --- what was heard ---------------------------------------------------------------------------------------------------


@_is("A status was heard at some time, and planner and recorder speak of this session.")
def _(s: EngineState) -> bool:
    heard: Tuple[Tuple[Any, Optional[int]], ...] = (
        (s.peers.autopilot, s.peers.autopilot_ns),
        (s.peers.planner, s.peers.planner_ns),
        (s.peers.recorder, s.peers.recorder_ns),
        (s.peers.landing, s.peers.landing_ns),
    )
    ours = all(
        each is None or each.session_id == s.session.id or not s.session.id
        for each in (s.peers.planner, s.peers.recorder)
    )
    return ours and all(status is None or seen is not None for status, seen in heard)


@_is("Who flies has heard the vehicle; who flies a mission has heard planner, recorder, battery and heartbeat as well.")
def _(s: EngineState) -> bool:
    mission = s.step in (*_STEPS[State.TAKEOFF], *_STEPS[State.MISSION]) or s.state is State.HOLD
    peers = (s.peers.planner_ns, s.peers.recorder_ns, s.peers.battery_ns, s.peers.heartbeat_ns) if mission else ()
    return None not in (s.peers.autopilot_ns, *peers) or not (s.flight.active or s.state in FLIGHT)


@_is("It sinks, and it moves, only as its last status says.")
def _(s: EngineState) -> bool:
    status = s.peers.autopilot
    sinks = status is not None and status.vertical_speed_m_s is not None and status.vertical_speed_m_s < 0
    across = status is not None and status.mode != "AUTO.LOITER" and bool(status.horizontal_speed_m_s)
    drifts = across or (status is not None and status.mode != "AUTO.LOITER" and bool(status.vertical_speed_m_s))
    moves = (s.vehicle.moving_ns is None or across) and (s.vehicle.adrift_ns is None or drifts)
    return (s.vehicle.descending_ns is None or sinks) and moves


@_is("The planner is idle, and the vehicle unknown, only as their last statuses say.")
def _(s: EngineState) -> bool:
    planner, vehicle = s.peers.planner, s.peers.autopilot
    idle = planner is not None and planner.phase.name in ("IDLE", "LOADED", "LANDED", "HOLDING")
    unknown = vehicle is not None and (vehicle.armed is None or vehicle.landed.name == "UNKNOWN")
    unknown = unknown or (vehicle is not None and vehicle.armed is False and vehicle.landed.name != "ON_GROUND")
    unarmed = vehicle is not None and vehicle.armed is None
    known = s.peers.vehicle_unknown_ns is None or unknown
    lands = planner is not None and planner.phase.name == "LANDING" and vehicle is not None and vehicle.armed is True
    known = known and (s.peers.landing_stalled_ns is None or lands)
    return (s.peers.planner_idle_ns is None or idle) and known and (s.peers.armed_unknown_ns is None or unarmed)


@_is("A component is known once.")
def _(s: EngineState) -> bool:
    names = [status.name for status in s.peers.components]
    return names == sorted(set(names))
