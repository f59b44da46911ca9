"""What a person is shown of the engine's state: the fields of msg/AutonomyState.msg in Python's terms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

from ..engine.commands import Level
from ..engine.context import Turn
from ..engine.decide import available
from ..engine.events import Check, Tick, Verdict
from ..engine.failsafe import waiting
from ..engine.rules import Rules
from ..engine.state import CheckRecord, EngineState, Failure, State, Step, evolve
from ..engine.timers import state_deadline

__all__ = ["Report", "report"]

_NS = 1e9


@dataclass(frozen=True)
class Report:
    """One look at the engine. Times are nanoseconds on the clock that decides; None is unknown or not applicable.

    Args:
        state: name of the state.
        phase: step within it; may be empty.
        session_id, mission_id, mission_description, file_index, files, repetition, repetitions: what is flown.
        in_flight: from the TAKEOFF command until disarmed and ON_GROUND, freshly.
        checks: the pre-flight table; each row's name starts with its check, e.g. "battery: level".
        failures: everything that is wrong now.
        waiting_for: one sentence; empty when it waits for nothing.
        deadline: name of the timer that ends the state; empty when it has none.
        deadline_ns: its end.
        message, message_level, advice: the last message to the user.
        user_commands: names of the commands that would be done now.
        waypoint, waypoints: progress as the planner says.
        recording_phase, recording_progress, data_location: the data.
        result: how the mission ended; empty before.
        data_result: what became of its data: COMPLETE or INCOMPLETE; empty before, and where nothing was recorded.
    """

    state: str
    phase: str
    session_id: str
    mission_id: str
    mission_description: str
    file_index: int
    files: int
    repetition: int
    repetitions: int
    in_flight: bool
    checks: Tuple[Check, ...]
    failures: Tuple[Failure, ...]
    waiting_for: str
    deadline: str
    deadline_ns: Optional[int]
    message: str
    message_level: Level
    advice: str
    user_commands: Tuple[str, ...]
    waypoint: int
    waypoints: int
    recording_phase: str
    recording_progress: Optional[float]
    data_location: str
    result: str
    data_result: str


def report(state: EngineState, rules: Rules) -> Report:
    """Return what a person is shown of a state.

    Args:
        state: of the engine.
        rules: the configuration it decides by.
    """
    mission, planner, recorder = state.session.mission, state.peers.planner, state.peers.recorder
    deadline = state_deadline(state, rules)
    return Report(
        state=state.state.value,
        phase=state.step.value,
        session_id=state.session.id,
        mission_id=mission.id if mission is not None else "",
        mission_description=mission.description if mission is not None else "",
        file_index=state.session.file_index,
        files=mission.files if mission is not None else 0,
        repetition=state.session.repetition,
        repetitions=mission.repetitions if mission is not None else 0,
        in_flight=state.flight.active,
        checks=(*(row for record in state.preflight.checks for row in _rows(record)), *_clock_rows(state, rules)),
        failures=state.failures,
        waiting_for=_waiting_for(state),
        deadline=deadline[0] if deadline is not None else "",
        deadline_ns=deadline[1] if deadline is not None else None,
        message=state.shown.text,
        message_level=state.shown.level,
        advice=state.shown.advice,
        user_commands=tuple(c.value for c in available(Turn(state, Tick(t_ns=state.t_ns), rules))),
        waypoint=planner.waypoint if planner is not None else 0,
        waypoints=planner.waypoints if planner is not None else 0,
        recording_phase=recorder.phase.name if recorder is not None else "",
        recording_progress=recorder.progress if recorder is not None else None,
        data_location=state.recording.location,
        result=state.session.result.value,
        data_result=state.session.data_result.value,
    )


def _rows(record: CheckRecord) -> Tuple[Check, ...]:
    """Return the rows of one check; one row of its own while, or because, there is no answer."""
    name = record.check.value.replace("_", " ")
    if record.rows and record.outcome is not None and (record.ok or any(not row.passed for row in record.rows)):
        return tuple(_named(name, row) for row in record.rows)
    if record.outcome is None and record.rows:
        return tuple(_named(name, row) for row in record.rows)
    verdict = Verdict.PASS if record.ok else Verdict.UNKNOWN if record.outcome is None else Verdict.FAIL
    own = Check(name=name, verdict=verdict, advice="asked, no answer yet" if record.outcome is None else record.message)
    return (*(_named(name, row) for row in record.rows), own)


def _clock_rows(state: EngineState, rules: Rules) -> Tuple[Check, ...]:
    """Return a row for each peer that was heard: how far its stamps are from the time at which they arrive."""
    if not state.preflight.checks:
        return ()
    heard = {
        "watchdog": state.peers.action,
        "autopilot": state.peers.autopilot,
        "planner": state.peers.planner,
        "landing detection": state.peers.landing,
        "recorder": state.peers.recorder,
    }
    ages = {peer: status.age_ns for peer, status in heard.items() if status is not None}
    apart = {each.peer: each.age_ns for each in state.peers.clocks_apart}
    limit_s = rules.limits.status_max_age_ns / _NS
    return tuple(
        Check(
            name=f"clocks: {peer}",
            verdict=Verdict.FAIL if peer in apart else Verdict.PASS,
            value=round(age_ns / _NS, 3),
            limit=limit_s,
            unit="s",
            advice="set the clocks of both computers by chrony" if peer in apart else "",
        )
        for peer, age_ns in {**ages, **apart}.items()
    )


def _named(check: str, row: Check) -> Check:
    return row if row.name.startswith(check) else evolve(row, name=f"{check}: {row.name}")


_WAITS = {
    State.MISSION_INPUT: "a mission to be selected",
    State.PREFLIGHT: "the answers to the pre-flight checks",
    State.OUTREACH: "you: retry or give up",
    State.START_RECORDING: "the recorder to prove that files grow, and the lead time",
    State.LOAD_MISSION: "the mission planner's confirmation and the checks asked again",
    State.LAND: "landed and disarmed",
    State.PILOT: "on the ground, disarmed, and your acknowledgement",
    State.DATA_CLEANUP: "the data to be complete",
    State.MISSION_ENDED: "the next mission to be selected",
}
_STEP_WAITS = {
    Step.ARMING: "the vehicle to arm",
    Step.LIFTING_OFF: "lift-off",
    Step.CLIMBING: "takeoff height",
    Step.CANCELLING: "the vehicle to be disarmed",
    Step.FLYING: "the last waypoint, landed and disarmed",
    Step.TOUCHDOWN: "the planner's confirmation and the checks asked again",
    Step.CONFIRMING: "the planner to hold",
    Step.RESUMING: "the planner to go on",
}


def _waiting_for(state: EngineState) -> str:
    held = ", ".join(failure.name for failure in waiting(state))
    if state.state is State.HOLD and state.step is Step.HOLDING:
        return held
    if state.state is State.READY:
        return "the operator's go"
    return _STEP_WAITS.get(state.step) or _WAITS.get(state.state, "")
