"""What a guard is; guards of any state, before a takeoff and after a flight. Those of a flight: `flight_guards.py`.

A guard is a condition of the transition table: it returns what it looked at when it holds, else None. None has effects.
Most events ask for nothing. A guard that holds only on a request is marked `on_request`, one that is combined with it
is so too; the table leaves their rows out on all other events.
"""

from __future__ import annotations

from typing import Callable, Optional, Set, Tuple

from .commands import Seen, Value, Values, because
from .context import Context
from .events import CHECKS, Check, MissionPhase, Outcome, RecordingPhase, UserCommand, Verdict, checks_of
from .failsafe import FAILSAFE_CONDITIONS, clocks_words, proves_recording, severity_of
from .rules import SEVERITIES, Action, action_of
from .state import CheckRecord, ClockApart, EngineState, OutreachKind, Result, State, evolve
from .timers import passed, time_of
from .update import lacking

Guard = Callable[[Context], Optional[Seen]]
_NS = 1e9
_ON_REQUEST: Set[Guard] = set()


def holds_if(condition: object, *values: Value, reason: str = "") -> Optional[Seen]:
    """Return what was looked at when the condition is true, else None."""
    return Seen(values, reason) if condition else None


def on_request(guard: Guard) -> Guard:
    """Mark a guard that holds only while `Context.asked`."""
    _ON_REQUEST.add(guard)
    return guard


def needs_request(guard: Guard) -> bool:
    """Return True when a guard holds only while `Context.asked`."""
    return guard in _ON_REQUEST


def user(command: UserCommand) -> Guard:
    """Hold when the user asks for it and the table of answers allows it."""

    def guard(context: Context) -> Optional[Seen]:
        return _asks(context, command)

    return on_request(guard)


def _asks(context: Context, *commands: UserCommand) -> Optional[Seen]:
    """Return what the user asks for, and what does so in his place, when it is one of these."""
    if context.user is None or context.user not in commands:
        return None
    by = context.asked_by
    return Seen((Value("user", context.user.value), *((Value("by", by),) if by else ())), by)


@on_request
def user_ends(context: Context) -> Optional[Seen]:
    """The user lands, aborts or gives up on the ground: nothing takes off."""
    return _asks(context, UserCommand.GIVE_UP, UserCommand.ABORT, UserCommand.LAND)


@on_request
def user_calls_off(context: Context) -> Optional[Seen]:
    """The user lands or aborts behind a flight, or gives up while its data is collected."""
    session = context.state.session
    if context.state.state is State.OUTREACH:
        return _asks(context, *((UserCommand.ABORT, UserCommand.LAND) if session.outreach is OutreachKind.DATA else ()))
    return user_ends(context)


def timer(name: str) -> Guard:
    """Hold when a timer has ended."""

    def guard(context: Context) -> Optional[Seen]:
        if not passed(name, context.state, context.rules, context.now):
            return None
        late = context.now - (time_of(name, context.state, context.rules) or context.now)
        return Seen((Value(name, "passed"), Value("later by", round(late / _NS, 6), 0.0, "s")))

    return guard


def both(*guards: Guard) -> Guard:
    """Hold when all of them hold."""

    def guard(context: Context) -> Optional[Seen]:
        values: Values = ()
        reasons = []
        for part in guards:
            seen = part(context)
            if seen is None:
                return None
            values += seen.values
            reasons.append(seen.reason)
        return Seen(values, "; ".join(filter(None, reasons)))

    return on_request(guard) if any(needs_request(part) for part in guards) else guard


def negated(inner: Guard) -> Guard:
    """Hold when the other one does not."""
    return lambda context: Seen() if inner(context) is None else None


@on_request
def mission_selected(context: Context) -> Optional[Seen]:
    """The user has selected a valid mission."""
    return holds_if(context.selected, Value("missions", ", ".join(mission.id for mission in context.selected)))


def next_in_queue(context: Context) -> Optional[Seen]:
    """A further mission was selected, and the last one is complete."""
    return holds_if(
        context.state.queue and context.state.session.result is Result.COMPLETE and not context.state.shutting_down,
        Value("missions to come", len(context.state.queue)),
    )


def mission_waits(context: Context) -> Optional[Seen]:
    """A mission stands at the head of the queue."""
    return holds_if(context.state.queue, Value("mission", context.state.queue[0].id if context.state.queue else ""))


@on_request
def shutdown(context: Context) -> Optional[Seen]:
    """The process was told to end."""
    return holds_if(context.signal, Value("signal", context.signal))


def outreach_for(kind: OutreachKind) -> Guard:
    """Hold when external action is required for this."""
    return lambda context: holds_if(context.state.session.outreach is kind)


# --- data guards ------------------------------------------------------------------------------------------------------
# The conditions of the recording: proven, refused, complete, incomplete.


_REFUSED = (Outcome.REFUSED, Outcome.UNAVAILABLE)


def records(context: Context) -> bool:
    """Return True when the recorder says, freshly, that files grow on every platform."""
    recorder, heard_ns = context.state.peers.recorder, context.state.peers.recorder_ns
    if recorder is None or heard_ns is None or context.now - heard_ns > context.limits.recorder_status_limit_ns:
        return False
    return proves_recording(recorder)


def recording_proven(context: Context) -> Optional[Seen]:
    """Files grow on every platform, and the lead time has passed."""
    recorder = context.state.peers.recorder
    if (
        recorder is None
        or not records(context)
        or not passed("recording_lead", context.state, context.rules, context.now)
    ):
        return None
    return Seen((Value("platforms that record", len(recorder.platforms)),))


def recording_refused(context: Context) -> Optional[Seen]:
    """The recorder refused to start, or says that it failed."""
    state = context.state
    if state.recording.request.outcome in _REFUSED:
        return because("recorder", state.recording.request.message or "refused")
    failed = (
        state.peers.recorder is not None
        and state.peers.recorder.phase is RecordingPhase.FAILED
        and state.recording.progressed
    )
    return (
        because("recorder", state.peers.recorder.message if state.peers.recorder is not None else "")
        if failed
        else None
    )


def nothing_recorded(context: Context) -> Optional[Seen]:
    """No recording was ever asked for in this session."""
    return holds_if(not context.state.recording.asked, Value("recording", "never started"))


def something_recorded(context: Context) -> Optional[Seen]:
    """A recording was asked for in this session."""
    return holds_if(context.state.recording.asked, Value("recording", "started"))


def data_complete(context: Context) -> Optional[Seen]:
    """The recorder says, since it was asked to stop, that everything is written, transferred, merged and verified."""
    recorder, heard_ns = context.state.peers.recorder, context.state.peers.recorder_ns
    complete = (
        recorder is not None
        and recorder.phase is RecordingPhase.COMPLETE
        and heard_ns is not None
        and heard_ns > context.state.entered_ns
    )
    return holds_if(complete, Value("recording", "COMPLETE"), Value("location", context.state.recording.location))


def data_lost(context: Context) -> Optional[Seen]:
    """What was recorded is merged and verified, but the recorder, or the vehicle, tells what is not in it."""
    complete, lost = data_complete(context), lost_of(context.state)
    return Seen((*complete.values, Value("lost", lost))) if complete is not None and lost else None


def lost_of(state: EngineState) -> str:
    """Return what of the flight was not recorded, as far as recorder and engine know; empty: nothing."""
    said = state.peers.recorder.lost if state.peers.recorder is not None else ""
    behind = "what the vehicle flew on behind the end of the recording" if state.recording.flown_on else ""
    return "; ".join(filter(None, (said, behind)))


_NOT_STOPPED = (RecordingPhase.IDLE, RecordingPhase.STARTING, RecordingPhase.RECORDING)


def data_incomplete(context: Context) -> Optional[Seen]:
    """The recorder refused to stop, does not, failed since it was asked, or is silent."""
    state, limits = context.state, context.limits
    if state.recording.request.outcome in _REFUSED:
        return because("recorder", state.recording.request.message or "refused to stop")
    if passed("recorder_silent", state, context.rules, context.now):
        return because("recorder", f"silent for {limits.recorder_status_limit_ns / _NS:g} s")
    recorder, heard_ns = state.peers.recorder, state.peers.recorder_ns
    if recorder is None or heard_ns is None:
        return None
    since_ns = heard_ns - state.entered_ns
    if recorder.phase in _NOT_STOPPED and since_ns >= limits.command_reply_limit_ns + limits.recorder_status_limit_ns:
        return because("recorder", f"asked to stop, it still says {recorder.phase.name}")
    again = state.recording.progressed or since_ns >= limits.recorder_status_limit_ns
    failed = recorder.phase is RecordingPhase.FAILED and again
    return because("recorder", recorder.message or "FAILED") if failed else None


# --- ready to take off ------------------------------------------------------------------------------------------------
# Is anything known on the ground that would end a flight as soon as it began? Then there is no takeoff.


def not_ready_to_take_off(context: Context) -> Optional[Seen]:
    """Something is known that would end the flight as soon as it began, or forbids to begin it."""
    if context.state.shutting_down:
        return because("reason", "the process was told to end")
    if not context.down():
        return because("reason", "no recent status that the vehicle is disarmed and on the ground")
    if recording_proven(context) is None:
        return because("reason", "the recorder is silent, does not record, or not for long enough yet")
    if context.state.peers.heartbeat_ns is None:
        return because("reason", "no heartbeat from the watchdog since it was started")
    if context.state.peers.battery_ns is None:
        return because("reason", "no battery level since the start")
    return _component(context) or _loss(context)


def _component(context: Context) -> Optional[Seen]:
    """Return the first component, required or not, that would be landed for, at once or after a wait."""
    for status in context.state.peers.components:
        severity = severity_of(status.name, status.code, context.state, context.rules)
        action = action_of(severity, status.code)
        if action is Action.LAND or (action is Action.WAIT and SEVERITIES[severity].fallback is not Action.CONTINUE):
            return because("reason", f"{status.name} {status.reason}".strip(), Value("code", int(status.code)))
    return None


def _loss(context: Context) -> Optional[Seen]:
    """Return the first failsafe condition that would be landed for, as if the flight had just begun."""
    begun = evolve(context.state, flight=evolve(context.state.flight, active=True, started_ns=context.now))
    flight = Context(begun, context.event, context.rules)
    flight.now = context.now
    for row in FAILSAFE_CONDITIONS:
        seen = row.holds(flight) if row.action is Action.LAND else None
        if seen is not None:
            return Seen((Value("reason", row.words), *seen.values), seen.reason or row.words)
    return None


# --- preflight guards -------------------------------------------------------------------------------------------------
# The conditions before a takeoff: checks, the watchdog's fixes, Ready revoked, the planner's confirmation.


def all_checks_passed(context: Context) -> Optional[Seen]:
    """Every check has answered and passed, no answer is too old, and nobody's clock is another one."""
    return None if _clocks_apart(context) else _fresh_answers(context)


def _fresh_answers(context: Context) -> Optional[Seen]:
    """Every check has answered and passed, and no answer is too old."""
    records = context.state.preflight.checks
    asked = len(checks_of(context.rules))
    if len(records) < asked or not all(record.ok for record in records):
        return None
    ages = [
        (context.now - record.replied_ns, context.rules.max_age_ns(record.check.value))
        for record in records
        if record.replied_ns is not None
    ]
    oldest, limit = max(ages, key=lambda age: age[0] - age[1])
    return holds_if(len(ages) == asked and oldest <= limit, Value("oldest check", oldest / _NS, limit / _NS, "s"))


def _failed(context: Context) -> Optional[Seen]:
    failed = [(r.check.value, r.message or "failed") for r in context.state.preflight.checks if r.outcome and not r.ok]
    clocks = [("clocks", clocks_words(context, apart.peer)) for apart in _clocks_apart(context)]
    found = (*failed, *clocks)
    values = tuple(Value(f"check {name}", why) for name, why in found)
    return holds_if(found, *values, reason="; ".join(f"{name}: {why}" for name, why in found))


def _clocks_apart(context: Context) -> Tuple[ClockApart, ...]:
    """Return the peers whose stamps have been too far from the present for longer than a status lasts."""
    limit_ns = context.limits.status_max_age_ns
    return tuple(apart for apart in context.state.peers.clocks_apart if context.now - apart.since_ns >= limit_ns)


def all_answered(context: Context) -> bool:
    """Return True when no check is open."""
    return bool(context.state.preflight.checks) and all(
        record.outcome is not None for record in context.state.preflight.checks
    )


def all_answered_values(context: Context) -> Optional[Seen]:
    """No check is open."""
    return holds_if(all_answered(context))


def answers_too_old(context: Context) -> Optional[Seen]:
    """All have answered and passed, but the first answers are too old by now."""
    fresh = _fresh_answers(context) is not None
    passed_once = all_answered(context) and all(record.ok for record in context.state.preflight.checks)
    return holds_if(passed_once and not fresh, Value("checks", "too old"))


def check_failed(context: Context) -> Optional[Seen]:
    """One of the checks has answered that it failed."""
    return _failed(context)


def _comes(context: Context, record: CheckRecord) -> bool:
    """Return True when a check that failed can pass soon: it is being fixed, or what it waits for comes by itself."""
    if CHECKS[record.check].watches and (record.fixable or record.being_fixed):
        return True
    since_ns = (record.replied_ns or 0) - (context.state.started_ns or 0)
    starting = 0 <= since_ns < context.limits.watchdog_startup_time_ns  # as this engine does: drivers, and its peers
    if record.outcome is Outcome.UNAVAILABLE:
        return starting
    bad = [row for row in record.rows if not row.passed]
    return bool(bad) and all(row.heals or (starting and _never_heard(row)) for row in bad)


def _never_heard(row: Check) -> bool:
    return row.verdict is Verdict.UNKNOWN and row.age_s is None


def _being_fixed(context: Context) -> bool:
    """Return True when all that failed can pass soon; clocks are set by their daemons."""
    bad = [record for record in context.state.preflight.checks if not record.ok]
    return (bool(bad) or bool(_clocks_apart(context))) and all(_comes(context, record) for record in bad)


def checks_failed(context: Context) -> Optional[Seen]:
    """All checks have answered, one has failed, and it neither is fixed nor comes by itself, or not in time."""
    if not all_answered(context) or not _failed(context):
        return None
    if _being_fixed(context) and not passed("preflight_fix_limit", context.state, context.rules, context.now):
        return None
    return _failed(context)


def fix_in_progress(context: Context) -> Optional[Seen]:
    """What failed is being fixed or comes by itself, and it is time to ask again."""
    if not all_answered(context) or not _failed(context) or not _being_fixed(context):
        return None
    return _failed(context) if passed("preflight_fix_poll", context.state, context.rules, context.now) else None


def too_many_rounds(context: Context) -> Optional[Seen]:
    """The checks were passed and revoked too often without a word of the user."""
    rounds, limit = context.state.preflight.rounds, context.limits.preflight_rounds_limit
    return holds_if(rounds > limit, Value("rounds of checks", rounds, limit))


def was_away(context: Context) -> Optional[Seen]:
    """The engine was away for longer than Ready stands, or was told to end: no person has this mission in mind now."""
    limit = Value("limit", context.limits.ready_limit_ns / _NS, None, "s")
    return because("reason", "the engine was away", limit) if context.state.preflight.away else None


def revoked(context: Context) -> Optional[Seen]:
    """A required component is not at code 1 (nor tolerated at code 2), or the watchdog is silent."""
    status = lacking(context.state.session.mission, context.state.peers.components)
    if status is not None:
        values = (Value("component", status.name), Value("code", int(status.code), 1), Value("reason", status.reason))
        return Seen(values, status.reason)
    if not passed("watchdog_heartbeat_limit", context.state, context.rules, context.now):
        return None
    limit = Value("limit", context.limits.watchdog_heartbeat_limit_ns / _NS, None, "s")
    return because("reason", "no heartbeat from the watchdog", limit)


def go_not_required(context: Context) -> Optional[Seen]:
    """The configuration does not ask for the operator's go."""
    return holds_if(not context.rules.require_go, Value("require_go", False))


def planner_confirmed(context: Context) -> Optional[Seen]:
    """The planner has accepted this file of this mission, and says so in its status."""
    state, planner = context.state, context.state.peers.planner
    if planner is None or state.session.mission is None or state.preflight.load.outcome is not Outcome.ACCEPTED:
        return None
    same = (planner.mission_id, planner.file_index, planner.repetition) == (
        state.session.mission.id,
        state.session.file_index,
        state.session.repetition,
    )
    return holds_if(same and planner.phase is MissionPhase.LOADED, Value("planner phase", "LOADED"))


def planner_refused(context: Context) -> Optional[Seen]:
    """The planner did not accept the mission."""
    refused = context.state.preflight.load.outcome in _REFUSED
    return because("planner", context.state.preflight.load.message or "refused") if refused else None


def next_takeoff_failed(context: Context) -> Optional[Seen]:
    """On the ground between two files: whatever forbids a takeoff forbids the next one."""
    for guard in (
        was_away,
        check_failed,
        revoked,
        planner_refused,
        both(planner_confirmed, timer("load_limit"), not_ready_to_take_off),
        timer("load_limit"),
        both(all_answered_values, timer("check_max_age")),
    ):
        seen = guard(context)
        if seen is not None:
            return seen
    return None
