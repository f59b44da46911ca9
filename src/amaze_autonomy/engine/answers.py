"""What the engine answers to a user, for every command in every state: done, refused with the reason, or already so.

`ANSWERS` is the table: the first case of a cell whose condition holds is the answer. What is not in a cell is refused
with the command's own reason (`OTHERWISE`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, Mapping, Tuple

from .commands import AnswerKind
from .events import UserCommand
from .failures import waiting
from .flight_guards import nobody_knows
from .state import FailureKind, State, Step
from .turn import Turn

__all__ = ["ANSWERS", "CONDITIONS", "IN_DOUBT", "OTHERWISE", "SELECT", "Case", "answer_to", "available"]


@dataclass(frozen=True)
class Case:
    """One case of a cell: the answer, the sentence, and the condition's name in `CONDITIONS`."""

    answer: AnswerKind
    text: str
    when: str = "always"


def _component_waited(turn: Turn) -> bool:
    return any(failure.kind is FailureKind.COMPONENT for failure in waiting(turn.state))


CONDITIONS: Mapping[str, Callable[[Turn], bool]] = {
    "always": lambda _: True,
    "airborne": lambda turn: (
        turn.state.in_flight and turn.state.step in (Step.CLIMBING, Step.FLYING) and not turn.on_ground()
    ),
    "in flight": lambda turn: turn.state.in_flight,
    "between files": lambda turn: turn.state.step is Step.TOUCHDOWN,
    "being cancelled": lambda turn: turn.state.step is Step.CANCELLING,
    "a component is waited for": _component_waited,
    "the user holds": lambda turn: turn.state.user_hold_ns is not None,
    "resuming": lambda turn: turn.state.step is Step.RESUMING,
    "landing": lambda turn: turn.lands(),
    "the pilot was alarmed and the vehicle is silent": lambda turn: nobody_knows(turn) is not None,
    "last heard on the ground and disarmed": lambda turn: turn.last_heard_down(),
}

_DONE, _NO, _SO = AnswerKind.DONE, AnswerKind.REFUSED, AnswerKind.ALREADY
_BEFORE = (State.PREFLIGHT, State.READY, State.START_RECORDING, State.LOAD_MISSION)
_END = (Case(_DONE, "Given up: no takeoff."),)
_NO_HOLD = (Case(_NO, "It is landing: a hold never interrupts that.", "landing"),)
_LANDING = (Case(_SO, "It is landing."),)
_PILOT = (Case(_NO, "The pilot or the autopilot has control; nothing is commanded."),)
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
        State.DATA_CLEANUP: (Case(_NO, "The data is being collected; it ends by itself within its limit."),),
        State.MISSION_ENDED: (Case(_SO, "The mission has ended."),),
    },
    UserCommand.HOLD: {
        State.TAKEOFF: (
            *_NO_HOLD,
            Case(_DONE, "Holding.", "airborne"),
            Case(_NO, "Not airborne yet: abort cancels the takeoff."),
        ),
        State.MISSION: (*_NO_HOLD, Case(_DONE, "Holding.", "airborne")),
        State.HOLD: (Case(_SO, "It holds as you asked.", "the user holds"), Case(_DONE, "It holds until you resume.")),
        State.LAND: (Case(_NO, "A hold never interrupts a landing."),),
        State.PILOT: _PILOT,
    },
    UserCommand.RESUME: {
        State.TAKEOFF: (Case(_SO, "Nothing is held."),),
        State.MISSION: (Case(_SO, "Nothing is held."),),
        State.HOLD: (
            Case(_NO, "A component is waited for.", "a component is waited for"),
            Case(_DONE, "Resuming.", "the user holds"),
            Case(_SO, "It resumes by itself."),
        ),
        State.LAND: (Case(_NO, "A landing is not interrupted."),),
        State.PILOT: _PILOT,
    },
    UserCommand.LAND: {
        State.TAKEOFF: (Case(_DONE, "Landing.", "in flight"), Case(_SO, "It has landed.")),
        State.MISSION: (
            Case(_DONE, "On the ground: no further takeoff.", "between files"),
            Case(_DONE, "Landing.", "in flight"),
            Case(_SO, "It has landed."),
        ),
        State.HOLD: (Case(_DONE, "Landing.", "in flight"), Case(_SO, "It has landed.")),
        State.LAND: _LANDING,
        State.PILOT: _PILOT,
    },
    UserCommand.ABORT: {
        **dict.fromkeys(_BEFORE, _END),
        State.TAKEOFF: (
            Case(_SO, "The takeoff is being cancelled.", "being cancelled"),
            Case(_DONE, "Aborting.", "in flight"),
            Case(_SO, "It has landed."),
        ),
        State.MISSION: (
            Case(_DONE, "On the ground: no further takeoff.", "between files"),
            Case(_DONE, "Landing.", "in flight"),
            Case(_SO, "It has landed."),
        ),
        State.HOLD: (Case(_DONE, "Landing.", "in flight"), Case(_SO, "It has landed.")),
        State.LAND: _LANDING,
        State.PILOT: _PILOT,
        State.OUTREACH: (Case(_NO, "Nothing flies: retry or give up."),),
    },
    UserCommand.ACKNOWLEDGE: {
        State.LAND: (
            Case(
                _DONE,
                "Acknowledged; whether it has landed and is disarmed is not known.",
                "the pilot was alarmed and the vehicle is silent",
            ),
            Case(_NO, "It is landing."),
        ),
        State.PILOT: (
            Case(_DONE, "Acknowledged.", "last heard on the ground and disarmed"),
            Case(_NO, "Not on the ground and disarmed yet, or not known to be."),
        ),
    },
}

SELECT: Mapping[State, Case] = {
    **{state: Case(_NO, "A mission is under way.") for state in State},
    State.MISSION_INPUT: Case(_DONE, "Selected: the checks are running."),
    State.MISSION_ENDED: Case(_DONE, "Selected: the checks are running."),
}


IN_DOUBT = Case(_NO, "Somebody else seems to have control of the vehicle: ask again in a moment.")
"""The answer to everything for the moment in which that is not clear."""


def answer_to(turn: Turn, command: UserCommand) -> Case:
    """Return the answer to a command in the engine's present state."""
    for case in ANSWERS[command].get(turn.state.state, ()):
        if CONDITIONS[case.when](turn):
            return case
    return Case(_NO, OTHERWISE[command])


def available(turn: Turn) -> Tuple[UserCommand, ...]:
    """Return the commands that would be done now."""
    return tuple(command for command in UserCommand if answer_to(turn, command).answer is _DONE)
