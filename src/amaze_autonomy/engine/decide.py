"""`decide`: the one function of the engine."""

from __future__ import annotations

from typing import Dict, List, Optional, Tuple

from . import failures
from .absorb import absorb
from .answers import IN_DOUBT, SELECT, answer_to
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
from .effects import ENTER, begin_session
from .events import Event, MissionRejected, MissionSelected, RecordingPhase, UserRequest
from .rules import Rules
from .state import EngineState, Result, State, Step
from .transitions import ROWS_AT, Place, Transition
from .turn import Turn

__all__ = ["MAX_ROWS", "decide"]

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
    turn = Turn(state, event, rules)
    turn.now = max(event.t_ns, state.t_ns)
    absorb(turn)
    decisions: List[Decision] = []
    _answer(turn)
    _update_failures(turn, decisions)
    for _ in range(MAX_ROWS):
        row, seen = _first(turn)
        if row is None:
            break
        _fire(turn, row, seen, decisions)
        _update_failures(turn, decisions)
    if turn.state.signal and not turn.suspected():
        turn.set(signal="")
    if not turn.commands and not decisions:
        return turn.state, ()
    return turn.state, (*sorted(turn.commands, key=_rank), *decisions)


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


def _answer(turn: Turn) -> None:
    """Answer the user; a request that is not done is not carried out either."""
    event = turn.event
    if isinstance(event, MissionRejected):
        turn.notify("mission_invalid", mission_id=event.mission_id, error=event.error)
        turn.commands.append(Answer(request_id=event.request_id, answer=AnswerKind.REFUSED, message=event.error))
        return
    if not isinstance(event, (UserRequest, MissionSelected)):
        return
    case = answer_to(turn, event.command) if isinstance(event, UserRequest) else SELECT[turn.state.state]
    case = IN_DOUBT if turn.suspected() else case
    if case.answer is not AnswerKind.DONE:
        turn.consume()
    turn.commands.append(Answer(request_id=event.request_id, answer=case.answer, message=case.text))


_SAID_HERE = {"failure_wait": State.HOLD, "failure_land": State.LAND, "failure_pilot": State.PILOT}
"""A failure that leads to another state is said by the transition; in that state it is said by itself."""


def _update_failures(turn: Turn, decisions: List[Decision]) -> None:
    """Bring what is wrong up to date, and write down what changed in flight."""
    for change in failures.update(turn):
        failure, first = change.failure, len(turn.commands)
        landing = change.rule == "failure_wait" and turn.lands()
        if landing or _SAID_HERE.get(change.rule, turn.state.state) is turn.state.state:
            key = "failure_while_landing" if landing else change.rule
            turn.notify(key, name=failure.name, reason=f"{failure.reason}." if failure.reason else "")
        place = (turn.state.state, turn.state.step)
        _write_down(turn, decisions, change.rule, place, failures.values_of(failure, turn.now), first)


def _first(turn: Turn) -> Tuple[Optional[Transition], Seen]:
    doubt, quiet = turn.suspected(), not turn.asked()
    for row in ROWS_AT[turn.state.state, turn.state.step]:
        if (doubt and not row.in_doubt) or (quiet and row.on_request):
            continue
        seen = row.guard(turn)
        if seen is not None:
            return row, seen
    return None, Seen()


def _fire(turn: Turn, row: Transition, seen: Seen, decisions: List[Decision]) -> None:
    """Carry out one row: its own fields and action, the step into the new state, the effects of entering it."""
    before, first = (turn.state.state, turn.state.step), len(turn.commands)
    if turn.state.step is not Step.CANCELLING:  # a cancelled takeoff keeps its cause
        turn.set(cause=seen.reason or row.words)
    turn.set(**row.sets)
    if row.act is not None:
        row.act(turn)
    if row.target is not None:
        _enter(turn, before, row.target)
    if row.message:
        turn.notify(row.message, **_words(turn))
    if row.target is not None or row.act is not None:
        turn.consume()
    _write_down(turn, decisions, row.rule, before, seen.values, first)


def _enter(turn: Turn, before: Place, target: Place) -> None:
    state, step = target
    if state is State.PREFLIGHT and before[0] is State.MISSION_INPUT:
        begin_session(turn)
    if state is State.HOLD and before[0] is not State.HOLD:
        turn.set(interrupted=before[0])
    entered = turn.now if state is not before[0] else turn.state.entered_ns
    turn.set(state=state, step=step, entered_ns=entered, step_ns=turn.now)
    effect = ENTER.get(target)
    if effect is not None:
        effect(turn)


def _words(turn: Turn) -> Dict[str, object]:
    """Return what the texts of messages may name."""
    state = turn.state
    return {
        "reason": f"{state.cause}." if state.cause else "",
        "mission_id": state.mission.id if state.mission is not None else "",
        "state": state.state.value,
        "result": state.result.value + (f" (landed for: {state.land_cause})" if _landed_for(state) else ""),
        "location": _location(state),
        "limit_s": (turn.limits.ready_limit_ns if state.state is State.PREFLIGHT else turn.limits.land_limit_ns) / _NS,
        "signal": turn.signal,
    }


def _landed_for(state: EngineState) -> bool:
    return state.result is Result.COMPLETE and bool(state.land_cause)


def _location(state: EngineState) -> str:
    """Return where the data is, and, when it is complete, what the recorder says of it: how big, what was lost."""
    if not state.data_location:
        return ""
    recorder = state.recorder
    complete = recorder is not None and recorder.phase is RecordingPhase.COMPLETE
    said = f" ({recorder.message})" if recorder is not None and complete and recorder.message else ""
    return f"The data is at {state.data_location}{said}."


def _write_down(
    turn: Turn, decisions: List[Decision], rule: str, before: Place, values: Tuple[Value, ...], first: int
) -> None:
    commands = tuple(_short(c) for c in sorted(turn.commands[first:], key=_rank) if isinstance(c, Request))
    number = turn.state.decisions
    turn.set(decisions=number + 1)
    decisions.append(
        Decision(
            t_ns=turn.now,
            sequence=number,
            event=type(turn.event).__name__,
            before=before[0].value,
            after=turn.state.state.value,
            step=turn.state.step.value,
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
