"""The conditions of the transition table. Each returns what it looked at when it holds, else None. None has effects."""

from __future__ import annotations

from typing import Callable, Optional, Tuple

from . import failures
from .absorb import proves_recording
from .checks import CheckName
from .commands import Value
from .events import (
    Landed,
    MissionPhase,
    Outcome,
    RecordingPhase,
    UserCommand,
    VehicleLanded,
)
from .modes import LANDING_MODES
from .rules import LOSSES
from .severity import Code
from .state import OutreachKind, Result, State
from .timers import passed, time_of
from .turn import Turn

__all__ = ["Guard", "Values"]

Values = Tuple[Value, ...]
Guard = Callable[[Turn], Optional[Values]]
_NS = 1e9
_REFUSED = (Outcome.REFUSED, Outcome.UNAVAILABLE)
_BOTH_ROUTES = frozenset(loss.name for loss in LOSSES if loss.both_routes)
_ALARM = frozenset(loss.name for loss in LOSSES if loss.alarm)


def _if(condition: object, *values: Value) -> Optional[Values]:
    return values if condition else None


def always(_: Turn) -> Optional[Values]:
    """Hold at once."""
    return ()


def user(command: UserCommand) -> Guard:
    """Hold when the user asks for it and the table of answers allows it."""
    return lambda turn: _if(turn.user is command, Value("user", command.value))


def user_gives_up(turn: Turn) -> Optional[Values]:
    """The user gives up or aborts before takeoff."""
    asked = turn.user in (UserCommand.GIVE_UP, UserCommand.ABORT)
    return _if(asked, Value("user", turn.user.value if turn.user else ""))


def user_ends(turn: Turn) -> Optional[Values]:
    """The user lands, aborts or gives up between two files."""
    asked = turn.user in (UserCommand.GIVE_UP, UserCommand.ABORT, UserCommand.LAND)
    return _if(asked, Value("user", turn.user.value if turn.user else ""))


def timer(name: str) -> Guard:
    """Hold when a timer has ended."""

    def guard(turn: Turn) -> Optional[Values]:
        if not passed(name, turn.state, turn.rules, turn.now):
            return None
        late = turn.now - (time_of(name, turn.state, turn.rules) or turn.now)
        return (Value(name, "passed"), Value("later by", round(late / _NS, 6), 0.0, "s"))

    return guard


def both(*guards: Guard) -> Guard:
    """Hold when all of them hold."""

    def guard(turn: Turn) -> Optional[Values]:
        seen: Values = ()
        for part in guards:
            values = part(turn)
            if values is None:
                return None
            seen += values
        return seen

    return guard


def negated(inner: Guard) -> Guard:
    """Hold when the other one does not."""
    return lambda turn: () if inner(turn) is None else None


# --- selection and start ----------------------------------------------------------------------------------------------


def mission_selected(turn: Turn) -> Optional[Values]:
    """The user has selected a valid mission."""
    return _if(turn.selected, Value("missions", ", ".join(mission.id for mission in turn.selected)))


def next_in_queue(turn: Turn) -> Optional[Values]:
    """A further mission was selected, and the last one is complete."""
    return _if(
        turn.state.queue and turn.state.result is Result.COMPLETE, Value("missions to come", len(turn.state.queue))
    )


def mission_waits(turn: Turn) -> Optional[Values]:
    """A mission stands at the head of the queue."""
    return _if(turn.state.queue, Value("mission", turn.state.queue[0].id if turn.state.queue else ""))


def started_armed(turn: Turn) -> Optional[Values]:
    """The engine was started, with no flight of its own to resume, while the vehicle is armed."""
    fresh_start = turn.state.sessions == 0 and turn.state.armed_at_start is True and turn.armed()
    return _if(fresh_start and not turn.state.in_flight, Value("armed at start", True))


# --- pre-flight -------------------------------------------------------------------------------------------------------


def all_checks_passed(turn: Turn) -> Optional[Values]:
    """Every check has answered and passed, and no answer is too old."""
    records = turn.state.checks
    if len(records) < len(CheckName) or not all(record.ok for record in records):
        return None
    ages = [turn.now - record.replied_ns for record in records if record.replied_ns is not None]
    oldest, limit = max(ages), turn.limits.check_max_age_ns
    return _if(len(ages) == len(CheckName) and oldest <= limit, Value("oldest check", oldest / _NS, limit / _NS, "s"))


def _failed(turn: Turn) -> Values:
    return tuple(
        Value(f"check {r.check.value}", r.message or "failed") for r in turn.state.checks if r.outcome and not r.ok
    )


def all_answered(turn: Turn) -> bool:
    """Return True when no check is open."""
    return bool(turn.state.checks) and all(record.outcome is not None for record in turn.state.checks)


def all_answered_values(turn: Turn) -> Optional[Values]:
    """No check is open."""
    return _if(all_answered(turn))


def answers_too_old(turn: Turn) -> Optional[Values]:
    """All have answered and passed, but the first answers are too old by now."""
    fresh = all_checks_passed(turn) is not None
    passed_once = all_answered(turn) and all(record.ok for record in turn.state.checks)
    return _if(passed_once and not fresh, Value("checks", "too old"))


def check_failed(turn: Turn) -> Optional[Values]:
    """One of the checks has answered that it failed."""
    return _failed(turn) or None


def _watchdog_fixes(turn: Turn) -> bool:
    """Return True when all that failed is the watchdog's check, and the watchdog can fix it."""
    bad = [record for record in turn.state.checks if not record.ok]
    return bool(bad) and all(r.check is CheckName.WATCHDOG and (r.fixable or r.being_fixed) for r in bad)


def checks_failed(turn: Turn) -> Optional[Values]:
    """All checks have answered, one has failed, and it cannot be fixed, or not in time."""
    if not all_answered(turn) or not _failed(turn):
        return None
    if _watchdog_fixes(turn) and not passed("preflight_fix_limit", turn.state, turn.rules, turn.now):
        return None
    return _failed(turn)


def fix_in_progress(turn: Turn) -> Optional[Values]:
    """The watchdog fixes what failed, and it is time to ask again."""
    if not all_answered(turn) or not _failed(turn) or not _watchdog_fixes(turn):
        return None
    return _failed(turn) if passed("preflight_fix_poll", turn.state, turn.rules, turn.now) else None


def too_many_rounds(turn: Turn) -> Optional[Values]:
    """The checks were passed and taken back too often without a word of the user."""
    rounds, limit = turn.state.rounds, turn.limits.preflight_rounds_limit
    return _if(rounds > limit, Value("rounds of checks", rounds, limit))


def taken_back(turn: Turn) -> Optional[Values]:
    """A required component is not at code 1 (nor tolerated at code 2), or the watchdog is silent."""
    mission = turn.state.mission
    required, tolerated = (mission.required, mission.tolerated) if mission is not None else ((), ())
    for status in turn.state.components:
        needed = not required or status.name in required
        accepted = status.code == Code.NOMINAL or (status.code == Code.NON_CRITICAL and status.name in tolerated)
        if needed and not accepted:
            return (Value("component", status.name), Value("code", int(status.code), 1), Value("reason", status.reason))
    return _if(
        passed("watchdog_heartbeat_limit", turn.state, turn.rules, turn.now),
        Value("reason", "the watchdog's heartbeat is lost"),
        Value("limit", turn.limits.watchdog_heartbeat_limit_ns / _NS, None, "s"),
    )


def go_not_required(turn: Turn) -> Optional[Values]:
    """The configuration does not ask for the operator's go."""
    return _if(not turn.rules.require_go, Value("require_go", False))


# --- recording --------------------------------------------------------------------------------------------------------


def recording_proven(turn: Turn) -> Optional[Values]:
    """Files grow on every platform, and the lead time has passed."""
    recorder = turn.state.recorder
    if (
        recorder is None
        or not proves_recording(recorder)
        or not passed("recording_lead", turn.state, turn.rules, turn.now)
    ):
        return None
    return (Value("platforms that record", len(recorder.platforms)),)


def recording_refused(turn: Turn) -> Optional[Values]:
    """The recorder refused to start, or says that it failed."""
    state = turn.state
    if state.recording_outcome in _REFUSED:
        return (Value("recorder", state.recording_message or "refused"),)
    failed = state.recorder is not None and state.recorder.phase is RecordingPhase.FAILED and state.recording_progressed
    return _if(failed, Value("recorder", state.recorder.message if state.recorder is not None else ""))


def nothing_recorded(turn: Turn) -> Optional[Values]:
    """No recording was ever asked for in this session."""
    return _if(not turn.state.recording_asked, Value("recording", "never started"))


def something_recorded(turn: Turn) -> Optional[Values]:
    """A recording was asked for in this session."""
    return _if(turn.state.recording_asked, Value("recording", "started"))


def data_complete(turn: Turn) -> Optional[Values]:
    """The recorder has written, transferred, merged and verified everything."""
    recorder = turn.state.recorder
    complete = recorder is not None and recorder.phase is RecordingPhase.COMPLETE
    return _if(complete, Value("recording", "COMPLETE"), Value("location", turn.state.data_location))


def data_incomplete(turn: Turn) -> Optional[Values]:
    """The recorder refused to stop, failed since it was asked, or is silent."""
    state = turn.state
    if state.recording_outcome in _REFUSED:
        return (Value("recorder", state.recording_message or "refused to stop"),)
    if passed("recorder_silent", state, turn.rules, turn.now):
        return (Value("recorder", f"silent for {turn.limits.recorder_status_limit_ns / _NS:g} s"),)
    if state.recorder is None or state.recorder.phase is not RecordingPhase.FAILED:
        return None
    since = (
        state.recorder_ns is not None and state.recorder_ns - state.entered_ns >= turn.limits.recorder_status_limit_ns
    )
    return _if(state.recording_progressed or since, Value("recorder", state.recorder.message or "FAILED"))


# --- planner and takeoff ----------------------------------------------------------------------------------------------


def planner_confirmed(turn: Turn) -> Optional[Values]:
    """The planner has accepted this file of this mission, and says so in its status."""
    state, planner = turn.state, turn.state.planner
    if planner is None or state.mission is None or state.load_outcome is not Outcome.ACCEPTED:
        return None
    same = (planner.mission_id, planner.file_index, planner.repetition) == (
        state.mission.id,
        state.file_index,
        state.repetition,
    )
    return _if(same and planner.phase is MissionPhase.LOADED, Value("planner phase", "LOADED"))


def planner_refused(turn: Turn) -> Optional[Values]:
    """The planner did not accept the mission."""
    return _if(turn.state.load_outcome in _REFUSED, Value("planner", turn.state.load_message or "refused"))


def motion_refused(turn: Turn) -> Optional[Values]:
    """The planner refused the last command, or is not there."""
    refused = turn.state.motion_outcome in _REFUSED
    return _if(refused, Value("planner", turn.state.motion_message or "refused"))


def down(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, disarmed and ON_GROUND."""
    return _if(turn.down(), Value("armed", False), Value("landed", "ON_GROUND"))


def on_the_ground(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, ON_GROUND."""
    return _if(turn.on_ground(), Value("landed", "ON_GROUND"))


def armed(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, that it is armed."""
    return _if(turn.armed(), Value("armed", True))


def airborne(turn: Turn) -> Optional[Values]:
    """The vehicle says, freshly, that it has left the ground."""
    return _if(turn.airborne(), Value("landed", turn.state.autopilot.landed.name if turn.state.autopilot else ""))


def at_takeoff_height(turn: Turn) -> Optional[Values]:
    """The vehicle is at takeoff height."""
    status, limit = turn.vehicle(), turn.limits.takeoff_height_m
    reached = status is not None and status.height_m is not None and status.height_m >= limit
    return _if(reached, Value("height", status.height_m if status else None, limit, "m"))


# --- in flight --------------------------------------------------------------------------------------------------------


def taken_over(turn: Turn) -> Optional[Values]:
    """The pilot has control, the autopilot acts by itself, or the mode is none of ours (rule 4)."""
    status = turn.vehicle()
    if status is None or status.armed is False:
        return None
    if status.pilot_in_control:
        return (Value("pilot in control", True), Value("flight mode", status.mode))
    if status.failsafe:
        return (Value("autopilot failsafe", True), Value("flight mode", status.mode))
    return turn.foreign_mode or None


def armed_by_others(turn: Turn) -> Optional[Values]:
    """The vehicle is armed, and it was not us."""
    return _if(not turn.state.in_flight and turn.armed(), Value("armed by", "somebody else"))


def in_flight(turn: Turn) -> Optional[Values]:
    """From the TAKEOFF command until the vehicle says, freshly, both disarmed and ON_GROUND."""
    return _if(turn.state.in_flight, Value("in flight", True))


def must_land(turn: Turn) -> Optional[Values]:
    """Something means to land."""
    worst = failures.worst(turn.state) if turn.state.in_flight else ()
    return failures.values_of(worst[0]) if worst else None


def must_land_both(turn: Turn) -> Optional[Values]:
    """Something means to land, and by both routes at once."""
    lost = [f for f in turn.state.failures if f.name in _BOTH_ROUTES] if turn.state.in_flight else []
    return failures.values_of(lost[0]) if lost else None


def must_alarm(turn: Turn) -> Optional[Values]:
    """Something is lost that the pilot must know at once."""
    lost = [f for f in turn.state.failures if f.name in _ALARM] if turn.state.in_flight else []
    return failures.values_of(lost[0]) if lost and not turn.state.alarmed else None


def must_wait(turn: Turn) -> Optional[Values]:
    """Something is waited for."""
    held = failures.waiting(turn.state) if turn.state.in_flight else ()
    return tuple(value for failure in held for value in failures.values_of(failure)) or None


def nothing_waited_for(turn: Turn) -> Optional[Values]:
    """All that was waited for is back, dropped, or resumed."""
    return () if must_wait(turn) is None else None


def interrupted(state: State) -> Guard:
    """Hold when the hold interrupted this state."""
    return lambda turn: _if(turn.state.interrupted is state)


def planner_in(*phases: MissionPhase) -> Guard:
    """Hold when the planner says, since the last command, one of these phases."""

    def guard(turn: Turn) -> Optional[Values]:
        planner = turn.state.planner
        said = planner is not None and planner.phase in phases and planner.t_ns >= turn.state.motion_ns
        return _if(said, Value("planner phase", planner.phase.name if planner else ""))

    return guard


def shutdown(turn: Turn) -> Optional[Values]:
    """The process was told to end."""
    return _if(turn.signal, Value("signal", turn.signal))


# --- touchdown and landing --------------------------------------------------------------------------------------------


def touched_down(turn: Turn) -> Optional[Values]:
    """Disarmed and ON_GROUND after a flight, and the landing detection does not contradict, or not for longer."""
    state = turn.state
    if not state.was_armed or (state.in_flight and not turn.down()):
        return None
    detection = state.landing.landed if state.landing is not None else Landed.UNKNOWN
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
    return _if(
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
    return _if(settled, Value("armed", False), Value("landed", "ON_GROUND"), Value("was armed", False))


def landing_shown(turn: Turn) -> Optional[Values]:
    """The vehicle shows that it lands: on the ground, or, up to the limit, landing mode or sustained descent."""
    status = turn.vehicle()
    overdue = passed("land_limit", turn.state, turn.rules, turn.now)
    if status is None or (overdue and status.landed is not VehicleLanded.ON_GROUND):
        return None
    if status.mode in LANDING_MODES:
        return (Value("flight mode", status.mode),)
    if status.landed in (VehicleLanded.LANDING, VehicleLanded.ON_GROUND):
        return (Value("landed", status.landed.name),)
    sustained = passed("descent_time", turn.state, turn.rules, turn.now)
    return _if(sustained, Value("vertical speed", status.vertical_speed_m_s, -turn.limits.descent_speed_m_s, "m/s"))


def ground_armed(turn: Turn) -> Optional[Values]:
    """On the ground for a while, still armed, and nothing says that it flies."""
    detection = turn.state.landing
    flies = detection is not None and detection.landed is Landed.AIRBORNE
    if not turn.on_ground() or not turn.armed() or flies:
        return None
    return _if(
        passed("ground_disarm_after", turn.state, turn.rules, turn.now),
        Value("landed", "ON_GROUND"),
        Value("armed", True),
    )


def cancelled(turn: Turn) -> Optional[Values]:
    """Disarmed and ON_GROUND, and it was armed before or the planner has accepted the ABORT."""
    settled = turn.state.was_armed or turn.state.motion_outcome is Outcome.ACCEPTED
    return _if(settled and turn.down(), Value("armed", False), Value("landed", "ON_GROUND"))


def not_alarmed(turn: Turn) -> Optional[Values]:
    """The pilot was not alarmed yet."""
    return _if(not turn.state.alarmed)


def not_overdue_alarmed(turn: Turn) -> Optional[Values]:
    """The pilot was not yet alarmed about the limit of the landing."""
    return _if(not turn.state.overdue_alarmed)


def one_route_only(turn: Turn) -> Optional[Values]:
    """The landing was commanded by the planner's route alone."""
    return _if(turn.state.second_route_ns is None)


def next_takeoff_failed(turn: Turn) -> Optional[Values]:
    """On the ground between two files: whatever forbids a takeoff forbids the next one."""
    for guard in (
        check_failed,
        taken_back,
        planner_refused,
        timer("load_limit"),
        both(all_answered_values, timer("check_max_age")),
    ):
        values = guard(turn)
        if values is not None:
            return values
    return None


def outreach_for(kind: OutreachKind) -> Guard:
    """Hold when external action is required for this."""
    return lambda turn: _if(turn.state.outreach is kind)
