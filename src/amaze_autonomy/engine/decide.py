"""`decide`, the one function of the engine; before it the table of what a user is answered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Dict, List, Mapping, Optional, Tuple

from . import failsafe
from .commands import (
    Answer,
    AnswerKind,
    AutopilotDisarm,
    AutopilotLand,
    Command,
    Decision,
    LoadMission,
    MissionAction,
    MissionCommand,
    Request,
    RunCheck,
    Seen,
    Value,
)
from .context import Context
from .effects import ENTER, begin_session, drop_queue
from .events import Event, MissionRejected, MissionSelected, RecordingPhase, UserCommand, UserRequest
from .failsafe import Change, and_words, waiting
from .flight_guards import ALARM_STANDS, nobody_knows
from .rules import Rules
from .state import EngineState, Failure, FailureKind, OutreachKind, Result, State, Step, put
from .transitions import ROWS_AT, Place, Transition
from .update import update

# --- answers ----------------------------------------------------------------------------------------------------------
# What the engine answers to a user, for every command in every state: done, refused with the reason, or already so.
#
# `ANSWERS` is the table: the first case of a cell whose condition holds is the answer. What is not in a cell is
# refused with the command's own reason (`OTHERWISE`).


@dataclass(frozen=True)
class Case:
    """One case of a cell: the answer, the sentence, and the condition's name in `CONDITIONS`."""

    answer: AnswerKind
    text: str
    when: str = "always"


def _component_waited(context: Context) -> bool:
    return any(failure.kind is FailureKind.COMPONENT for failure in waiting(context.state))


CONDITIONS: Mapping[str, Callable[[Context], bool]] = {
    "always": lambda _: True,
    "airborne": lambda context: (
        context.state.flight.active and context.state.step in (Step.CLIMBING, Step.FLYING) and not context.on_ground()
    ),
    "in flight": lambda context: context.state.flight.active,
    "between files": lambda context: context.state.step is Step.TOUCHDOWN,
    "being cancelled": lambda context: context.state.step is Step.CANCELLING,
    "a component is waited for": _component_waited,
    "the user holds": lambda context: context.state.flight.user_hold_ns is not None,
    "landing": lambda context: context.lands(),
    "the pilot was alarmed and nothing is known of the vehicle": lambda context: nobody_knows(context) is not None,
    "the pilot was alarmed and it has been disarmed for long": lambda context: (
        nobody_knows(context) is not None and context.disarmed_for_long()
    ),
    "the vehicle has been silent or unknown for long": lambda context: context.unknown_for_long(),
    "it has been disarmed for long": lambda context: context.disarmed_for_long(),
    "another mission waits": lambda context: bool(context.state.queue),
    "another mission waits behind its data": lambda context: (
        bool(context.state.queue) and context.state.session.outreach is OutreachKind.DATA
    ),
    "last heard on the ground and disarmed": lambda context: context.last_heard_down(),
}

_DONE, _NO, _SO = AnswerKind.DONE, AnswerKind.REFUSED, AnswerKind.ALREADY
_FLIGHT = (State.TAKEOFF, State.MISSION, State.HOLD)
_BEFORE = (State.PREFLIGHT, State.READY, State.START_RECORDING, State.LOAD_MISSION)
_END = (Case(_DONE, "Given up: no takeoff."),)
_NO_HOLD = (Case(_NO, "It is landing: a hold never interrupts that.", "landing"),)
_LANDING = (Case(_SO, "It is landing."),)
_PILOT = (Case(_NO, "The pilot or the autopilot has control; nothing is commanded."),)
_NOT_SEEN_DOWN = "Acknowledged; it is disarmed, and does not say that it has landed."
_UNKNOWN_END = "Acknowledged; whether it has landed and is disarmed is not known."
_SEEMS_OVER = Case(_SO, "It seems to have landed; it is landed if it has not.")
_CALLED_OFF = Case(_DONE, "No further takeoff; the data is being collected.", "another mission waits")
_CALLED_OFF_NEXT = Case(
    _DONE, "No further takeoff; retry the data, or give it up.", "another mission waits behind its data"
)
_UNDER_WAY = (Case(_SO, "The mission is under way."),)

OTHERWISE: Mapping[UserCommand, str] = {
    UserCommand.GO: "There is nothing to start: select a mission and wait for Ready.",
    UserCommand.RETRY: "There is nothing to retry.",
    UserCommand.GIVE_UP: "There is nothing to give up.",
    UserCommand.HOLD: "The vehicle is not in flight.",
    UserCommand.RESUME: "There is no hold to resume from.",
    UserCommand.LAND: "The vehicle is not in flight.",
    UserCommand.ABORT: "There is nothing to abort.",
    UserCommand.ACKNOWLEDGE: "There is nothing to acknowledge.",
}

ANSWERS: Mapping[UserCommand, Mapping[State, Tuple[Case, ...]]] = {
    UserCommand.GO: {
        State.READY: (Case(_DONE, "Starting."),),
        State.START_RECORDING: _UNDER_WAY,
        State.LOAD_MISSION: _UNDER_WAY,
        State.TAKEOFF: _UNDER_WAY,
        State.MISSION: _UNDER_WAY,
    },
    UserCommand.RETRY: {
        State.OUTREACH: (Case(_DONE, "Trying again."),),
        State.PREFLIGHT: (Case(_SO, "The checks are running."),),
        State.DATA_CLEANUP: (Case(_SO, "The data is being collected."),),
    },
    UserCommand.GIVE_UP: {
        State.OUTREACH: (Case(_DONE, "Given up; nothing is deleted."),),
        **dict.fromkeys(_BEFORE, _END),
        State.TAKEOFF: (Case(_NO, "The takeoff is under way: abort or land."),),
        State.MISSION: (
            Case(_DONE, "Given up: no further takeoff.", "between files"),
            Case(_NO, "The vehicle is in flight: land."),
        ),
        State.HOLD: (Case(_NO, "The vehicle is in flight: land."),),
        State.LAND: (Case(_NO, "The vehicle is in flight; it is landing."),),
        State.PILOT: (Case(_NO, "Land, then acknowledge."),),
        State.DATA_CLEANUP: (
            _CALLED_OFF,
            Case(_NO, "The data is being collected; it ends by itself within its limit."),
        ),
        State.MISSION_ENDED: (Case(_SO, "The mission has ended."),),
    },
    UserCommand.HOLD: {
        State.TAKEOFF: (
            *_NO_HOLD,
            Case(_DONE, "Holding.", "airborne"),
            Case(_NO, "Not airborne yet: abort cancels the takeoff."),
        ),
        State.MISSION: (*_NO_HOLD, Case(_DONE, "Holding.", "airborne")),
        State.HOLD: (
            *_NO_HOLD,
            Case(_SO, "It holds as you asked.", "the user holds"),
            Case(_DONE, "It holds until you resume."),
        ),
        State.LAND: (Case(_NO, "A hold never interrupts a landing."),),
        State.PILOT: _PILOT,
    },
    UserCommand.RESUME: {
        State.TAKEOFF: (Case(_SO, "Nothing is held."),),
        State.MISSION: (Case(_SO, "Nothing is held."),),
        State.HOLD: (
            Case(_NO, "A landing is not interrupted.", "landing"),
            Case(_NO, "A component is waited for.", "a component is waited for"),
            Case(_DONE, "Resuming.", "the user holds"),
            Case(_SO, "It resumes by itself."),
        ),
        State.LAND: (Case(_NO, "A landing is not interrupted."),),
        State.PILOT: _PILOT,
    },
    UserCommand.LAND: {
        **dict.fromkeys(_BEFORE, _END),
        State.TAKEOFF: (Case(_DONE, "Landing.", "in flight"), _SEEMS_OVER),
        State.MISSION: (
            Case(_DONE, "On the ground: no further takeoff.", "between files"),
            Case(_DONE, "Landing.", "in flight"),
            _SEEMS_OVER,
        ),
        State.HOLD: (Case(_DONE, "Landing.", "in flight"), _SEEMS_OVER),
        State.LAND: _LANDING,
        State.PILOT: _PILOT,
        State.OUTREACH: (_CALLED_OFF_NEXT,),
        State.DATA_CLEANUP: (_CALLED_OFF,),
    },
    UserCommand.ABORT: {
        **dict.fromkeys(_BEFORE, _END),
        State.TAKEOFF: (
            Case(_SO, "The takeoff is being cancelled.", "being cancelled"),
            Case(_DONE, "Aborting.", "in flight"),
            _SEEMS_OVER,
        ),
        State.MISSION: (
            Case(_DONE, "On the ground: no further takeoff.", "between files"),
            Case(_DONE, "Landing.", "in flight"),
            _SEEMS_OVER,
        ),
        State.HOLD: (Case(_DONE, "Landing.", "in flight"), _SEEMS_OVER),
        State.LAND: _LANDING,
        State.PILOT: _PILOT,
        State.OUTREACH: (_CALLED_OFF_NEXT, Case(_NO, "Nothing flies: retry or give up.")),
        State.DATA_CLEANUP: (_CALLED_OFF,),
    },
    UserCommand.ACKNOWLEDGE: {
        State.LAND: (
            Case(_DONE, _NOT_SEEN_DOWN, "the pilot was alarmed and it has been disarmed for long"),
            Case(_DONE, _UNKNOWN_END, "the pilot was alarmed and nothing is known of the vehicle"),
            Case(_NO, "It is landing."),
        ),
        State.PILOT: (
            Case(_DONE, "Acknowledged.", "last heard on the ground and disarmed"),
            Case(_DONE, _UNKNOWN_END, "the vehicle has been silent or unknown for long"),
            Case(_DONE, _NOT_SEEN_DOWN, "it has been disarmed for long"),
            Case(_NO, "Not on the ground and disarmed yet, or not known to be."),
        ),
    },
}

SELECT: Mapping[State, Case] = {
    **{state: Case(_NO, "A mission is under way.") for state in State},
    State.MISSION_INPUT: Case(_DONE, "Selected: the checks are running."),
    State.MISSION_ENDED: Case(_DONE, "Selected: the checks are running."),
}


IN_DOUBT = Case(_NO, "Possible takeover of the vehicle: ask again in a moment.")
"""The answer to everything but a landing for the moment in which that is not clear."""

DEFERRED = Case(_DONE, "Landing as soon as it is clear who has control of the vehicle.")
"""The answer to what lands, in that moment: it is not forgotten, and nobody has to ask again."""
_LANDS = (UserCommand.LAND, UserCommand.ABORT)
_ASKED_BEFORE = Case(_NO, "It is landing: you asked for that before.")


def answer_to(context: Context, command: UserCommand) -> Case:
    """Return the answer to a command in the engine's present state."""
    state = context.state.state
    flies = state in (*_FLIGHT, State.LAND) and context.state.step is not Step.TOUCHDOWN
    taken = flies and command is not UserCommand.ACKNOWLEDGE and context.taken()
    place = State.PILOT if taken else state  # as this event will show
    for case in ANSWERS[command].get(place, ()):
        if CONDITIONS[case.when](context):
            return case
    return Case(_NO, OTHERWISE[command])


def available(context: Context) -> Tuple[UserCommand, ...]:
    """Return the commands that would be done now."""
    return tuple(command for command in UserCommand if answer_to(context, command).answer is _DONE)


# --- decide -----------------------------------------------------------------------------------------------------------


MAX_ROWS = 12
"""How many rows may fire on one event. The longest chain is shorter; a test watches it."""

_NS = 1e9


def decide(state: EngineState, event: Event, rules: Rules) -> Tuple[EngineState, Tuple[Command, ...]]:
    """Decide what to do about an event.

    Args:
        state: what the engine knew before.
        event: what has happened; one that is older than the state counts as happening now, time never runs back.
        rules: the configuration.

    Returns:
        What it knows now, and the commands in the order in which they are to be carried out: landing first, then other
        requests, then the answer and the messages to the user, and the decisions to be written down last.
    """
    context = Context(state, event, rules)
    context.now = max(event.t_ns, state.t_ns)
    update(context)
    _take_up(context)
    decisions: List[Decision] = []
    _answer(context)
    _update_failures(context, decisions)
    for _ in range(MAX_ROWS):
        row, seen = _first(context)
        if row is None:
            break
        _fire(context, row, seen, decisions)
        _update_failures(context, decisions)
    if context.state.land_deferred is not None and not _lands_later(context):
        context.set(land_deferred=None)
    if context.state.signal and not context.suspected() and not _seems_over(context.state):
        context.set(signal="")
    _show(context)
    if not context.commands and not decisions:
        return context.state, ()
    return context.state, (*sorted(context.commands, key=_rank), *decisions)


def _show(context: Context) -> None:
    """Show the last alarm of the landing that still stands, else the last message."""
    state = context.state
    alarms = state.landing.alarms if state.state is State.LAND else ()
    standing = [each for each in alarms if ALARM_STANDS[each.key](context) is not None]
    shown = standing[-1] if standing else state.said
    if shown is not state.shown:
        context.set(shown=shown)


def _seems_over(state: EngineState) -> bool:
    """Return True while a flight seems over that may go on yet: told to end or to land then, it is not forgotten."""
    return not state.flight.active and state.state in _FLIGHT


def _take_up(context: Context) -> None:
    """Take up a landing that the user asked for while it was not clear who has control, or whether it has landed.

    In a pilot's hands there is none, and none after the flight.
    """
    state = context.state
    if state.land_deferred is None or _is_unclear(context):
        return
    context.set(land_deferred=None)
    if _lands_later(context):
        context.user, context.asked_by = UserCommand.LAND, state.land_deferred


def _is_unclear(context: Context) -> bool:
    return context.suspected() or (_seems_over(context.state) and context.state.step is not Step.TOUCHDOWN)


def _lands_later(context: Context) -> bool:
    """Return True where a landing that was put off may still go out: in flight, while nobody else has control."""
    in_flight = context.state.state in (*_FLIGHT, State.LAND) and not context.taken()
    return in_flight or _is_unclear(context)


def _rank(command: Command) -> int:
    if isinstance(command, MissionCommand):
        return 0 if command.action is MissionAction.LAND else 3
    if isinstance(command, AutopilotLand):
        return 1
    if isinstance(command, AutopilotDisarm):
        return 2
    if isinstance(command, Request):
        return 4
    return 5 if isinstance(command, Answer) else 6


def _answer(context: Context) -> None:
    """Answer the user; a request that is not done is not carried out either."""
    event = context.event
    if isinstance(event, MissionRejected):
        context.notify("mission_invalid", mission_id=event.mission_id, error=event.error)
        context.commands.append(Answer(request_id=event.request_id, answer=AnswerKind.REFUSED, message=event.error))
        return
    if not isinstance(event, (UserRequest, MissionSelected)):
        return
    case = answer_to(context, event.command) if isinstance(event, UserRequest) else SELECT[context.state.state]
    if context.suspected():
        defers = case.answer is AnswerKind.DONE and context.user in _LANDS and context.state.flight.active
        _put_off(context, is_put_off=defers)
        case = DEFERRED if defers else IN_DOUBT
        context.consume()
    elif isinstance(event, UserRequest) and context.user is not event.command:
        case = _ASKED_BEFORE
    elif case.answer is not AnswerKind.DONE:
        _put_off(context, is_put_off=case is _SEEMS_OVER)
        context.consume()
    context.commands.append(Answer(request_id=event.request_id, answer=case.answer, message=case.text))
    lands = isinstance(event, UserRequest) and event.command in _LANDS and case.answer is not AnswerKind.REFUSED
    if lands and context.state.flight.was_airborne and context.state.state in (*_FLIGHT, State.LAND):
        drop_queue(context)  # who has it landed has no other mission taken off for him


def _put_off(context: Context, *, is_put_off: bool) -> None:
    """Remember who asks for a landing that may go out later: the first of them."""
    if is_put_off and context.state.land_deferred is None:
        context.set(land_deferred=context.asked_by)


_CLEARED = {("failure_back", FailureKind.LOSS): "condition_cleared"}
_SAID_HERE = {"failure_wait": State.HOLD, "failure_land": State.LAND, "failure_pilot": State.PILOT}
"""A failure that leads to another state is said by the transition; in that state it is said by itself."""


def _update_failures(context: Context, decisions: List[Decision]) -> None:
    """Bring what is wrong up to date, write down what changed in flight, and say once what is said of several."""
    changes = [(change, _told_as(context, change)) for change in failsafe.update(context)]
    told: Dict[Tuple[str, str], List[Failure]] = {}
    for change, message in changes:
        told.setdefault(message, []).append(change.failure)
    place = (context.state.state, context.state.step)
    for change, (key, limit) in changes:
        first, alike = len(context.commands), told.pop((key, limit), [])
        if alike:
            names, reason = and_words([each.name for each in alike]), failsafe.fault_words(alike, context.state)
            are = "is" if len(alike) == 1 else "are"
            context.notify(key, name=names, are=are, reason=f"{reason}.", limit=limit)
        _write_down(context, decisions, change.rule, place, failsafe.values_of(change.failure, context), first)


def _told_as(context: Context, change: Change) -> Tuple[str, str]:
    """Return the key of the message about a change, empty where it is said elsewhere, and how long it is waited for."""
    failure, state = change.failure, context.state
    waits = change.rule == "failure_wait"
    own = waits and failure.kind is FailureKind.USER  # said by the transition
    lands = state.state is State.LAND or bool(failsafe.worst(state))
    landing = (change.rule == "failure_continue" and lands) or (waits and context.lands())
    if landing:
        return "failure_while_landing", failsafe.wait_words(failure, context)
    if own or _SAID_HERE.get(change.rule, state.state) is not state.state:
        return "", ""
    return _CLEARED.get((change.rule, failure.kind), change.rule), failsafe.wait_words(failure, context)


def _first(context: Context) -> Tuple[Optional[Transition], Seen]:
    doubt, quiet = context.suspected(), not context.asked()
    for row in ROWS_AT[context.state.state, context.state.step]:
        if (doubt and not row.in_doubt) or (quiet and row.on_request):
            continue
        seen = row.guard(context)
        if seen is not None:
            return row, seen
    return None, Seen()


def _fire(context: Context, row: Transition, seen: Seen, decisions: List[Decision]) -> None:
    """Carry out one row: its own fields and action, the step into the new state, the effects of entering it."""
    before, first = (context.state.state, context.state.step), len(context.commands)
    cause, kept = seen.reason or row.words, context.state.cause
    cancelled = before[1] is Step.CANCELLING and (row.target is None or row.target[0] is State.OUTREACH)
    context.set(cause=cause)
    for path, value in row.sets.items():
        context.state = put(context.state, path, value)
    if row.act is not None:
        row.act(context)
    if row.target is not None:
        _enter(context, before, row.target)
    if cancelled:  # why it was, and not what happened until it was
        context.set(cause=kept)
    if row.message:
        words = _words(context)
        context.notify(row.message, **{**words, "reason": f"{cause}."} if row.target is None else words)
    if row.target is not None or row.act is not None:
        context.consume()
    _write_down(context, decisions, row.rule, before, seen.values, first)


def _enter(context: Context, before: Place, target: Place) -> None:
    state, step = target
    if state is State.PREFLIGHT and before[0] is State.MISSION_INPUT:
        begin_session(context)
    if state is State.HOLD and before[0] is not State.HOLD:
        context.put("flight", interrupted=before[0])
    entered = context.now if state is not before[0] else context.state.entered_ns
    context.set(state=state, step=step, entered_ns=entered, step_ns=context.now)
    effect = ENTER.get(target)
    if effect is not None:
        effect(context)


def _words(context: Context) -> Dict[str, object]:
    """Return what the texts of messages may name."""
    state, waits = context.state, waiting(context.state)
    return {
        "reason": f"{state.cause}." if state.cause else "",
        "asked": f"{context.asked_by} says" if context.asked_by else "you asked",
        "mission_id": state.session.mission.id if state.session.mission is not None else "",
        "state": state.state.value,
        "result": state.session.result.value + (f" (landed for: {state.landing.cause})" if _landed_for(state) else ""),
        "location": _location(state),
        "what_next": f"Mission {state.queue[0].id} follows." if state.queue else "Select the next mission.",
        "limit_s": (context.limits.ready_limit_ns if state.state is State.PREFLIGHT else context.limits.land_limit_ns)
        / _NS,
        "limit": failsafe.wait_words(waits[-1], context) if waits else "",
        "signal": context.signal,
    }


def _landed_for(state: EngineState) -> bool:
    return state.session.result is Result.COMPLETE and bool(state.landing.cause)


def _location(state: EngineState) -> str:
    """Return where the data is, and, when it is complete, what the recorder says of it: how big, what was lost."""
    if not state.recording.location:
        return ""
    recorder = state.peers.recorder
    complete = recorder is not None and recorder.phase is RecordingPhase.COMPLETE
    said = f" ({recorder.message})" if recorder is not None and complete and recorder.message else ""
    return f"The data is at {state.recording.location}{said}."


def _write_down(
    context: Context, decisions: List[Decision], rule: str, before: Place, values: Tuple[Value, ...], first: int
) -> None:
    commands = tuple(_short(c) for c in sorted(context.commands[first:], key=_rank) if isinstance(c, Request))
    number = context.state.decisions
    context.set(decisions=number + 1)
    decisions.append(
        Decision(
            t_ns=context.now,
            sequence=number,
            event=type(context.event).__name__,
            before=before[0].value,
            after=context.state.state.value,
            step=context.state.step.value,
            rule=rule,
            values=values,
            commands=commands,
        )
    )


def _short(command: Request) -> str:
    if isinstance(command, MissionCommand):
        detail = command.action.name
    elif isinstance(command, RunCheck):
        detail = command.check.name
    elif isinstance(command, LoadMission):
        detail = f"{command.mission_id}, file {command.file_index}, repetition {command.repetition}"
    else:
        detail = ""
    return f"{type(command).__name__}({detail})#{command.id}"
