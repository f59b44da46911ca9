"""What is done on the way into a state: which requests go out, which fields start afresh. `ENTER` is the table."""

from __future__ import annotations

from typing import Any, Callable, Mapping, Tuple

from .checks import CHECKS, CheckName
from .commands import (
    AutopilotDisarm,
    AutopilotLand,
    LoadMission,
    MissionAction,
    MissionCommand,
    RunCheck,
    StartRecording,
    StopRecording,
)
from .data_guards import records
from .events import Landed, RecordingPhase
from .failures import flown_without
from .flight_guards import mission_flown
from .state import CheckRecord, DataResult, OutreachKind, Result, State, Step, evolve
from .timers import check_limit_ns, passed
from .turn import Turn

__all__ = ["ENTER", "Effect"]

Effect = Callable[[Turn], None]


# --- before takeoff ---------------------------------------------------------------------------------------------------


def queue_missions(turn: Turn) -> None:
    """Put the selected missions into the queue."""
    turn.set(queue=turn.selected)


def begin_session(turn: Turn) -> None:
    """Start a new session with the mission at the head of the queue: nothing of the last one remains."""
    state = turn.state
    number = state.sessions + 1
    turn.set(
        sessions=number,
        session_id=f"{state.label}-{number:03d}",
        mission=state.queue[0],
        queue=state.queue[1:],
        file_index=0,
        repetition=0,
        result=Result.NONE,
        rounds=0,
        outreach=OutreachKind.NONE,
        planner=None,
        planner_ns=None,
        recorder=None,
        recorder_ns=None,
        recording_asked=False,
        recording_id=0,
        recording_outcome=None,
        recording_since_ns=None,
        recording_progressed=False,
        recording_over=False,
        data_location="",
        data_result=DataResult.NONE,
        was_armed=False,
        was_airborne=False,
        flown=False,
        commanded=() if state.was_airborne else state.commanded,  # a takeoff called off may still arm
    )


def forget_mission(turn: Turn) -> None:
    """Be ready for the next selection."""
    turn.set(mission=None, session_id="", checks=(), result=Result.NONE, data_result=DataResult.NONE)
    turn.set(outreach=OutreachKind.NONE, failures=())


def preflight(turn: Turn) -> None:
    """Ask for all checks, and start the time in which the watchdog may fix what fails."""
    state, limits = turn.state, turn.limits
    startup = limits.watchdog_startup_time_ns if state.watchdog_started_ns is None else 0
    turn.set(
        rounds=state.rounds + 1,
        fix_deadline_ns=turn.now + startup + limits.preflight_fix_limit_ns,
        outreach=OutreachKind.NONE,
    )
    run_checks(turn)


def run_checks(turn: Turn) -> None:
    """Ask for all checks, in their order. Rows of the last answers stay in the table until the new ones come."""
    before = {record.check: record for record in turn.state.checks}
    records = []
    for check in CheckName:
        request = _request(turn, check)
        turn.send(request)
        old = before.get(check, CheckRecord(check=check))
        records.append(
            evolve(old, command_id=request.id, asked_ns=turn.now, replied_ns=None, outcome=None, ok=False, message="")
        )
    turn.set(checks=tuple(records))


def _request(turn: Turn, check: CheckName) -> RunCheck:
    mission, started = turn.state.mission, turn.state.watchdog_started_ns is not None
    known: Mapping[str, Any] = {
        "required": mission.required if mission is not None else (),
        "startup_time_ns": 0 if started else turn.limits.watchdog_startup_time_ns,
        "required_fraction": mission.battery_needed_fraction if mission is not None else None,
    }
    return RunCheck(
        id=turn.take_id(),
        limit_ns=check_limit_ns(turn.state, turn.rules, check),
        check=check,
        mission_id=mission.id if mission is not None else "",
        **{name: value for name, value in known.items() if name in CHECKS[check].asks},
    )


def forgive(turn: Turn) -> None:
    """The user retries: rounds are counted afresh."""
    turn.set(rounds=0)


def ready(turn: Turn) -> None:
    """Say so."""
    turn.notify("ready_wait_go" if turn.rules.require_go else "ready")


def start_recording(turn: Turn) -> None:
    """Ask the recorder to start, unless it proves that it records this session already."""
    if turn.state.recording_asked and records(turn):
        turn.set(recording_outcome=None)
        return
    identity = turn.take_id()
    mission = turn.state.mission
    turn.send(
        StartRecording(
            id=identity,
            limit_ns=turn.limits.command_reply_limit_ns,
            session_id=turn.state.session_id,
            mission_id=mission.id if mission is not None else "",
        )
    )
    turn.set(
        recording_asked=True,
        recording_id=identity,
        recording_outcome=None,
        recording_message="",
        recording_since_ns=None,
        recording_progressed=False,
    )


def load_mission(turn: Turn) -> None:
    """Send the mission to the planner, and ask for all checks again."""
    mission, state = turn.state.mission, turn.state
    identity = turn.take_id()
    turn.send(
        LoadMission(
            id=identity,
            limit_ns=turn.limits.load_limit_ns,
            session_id=state.session_id,
            mission_id=mission.id if mission is not None else "",
            file_index=state.file_index,
            repetition=state.repetition,
        )
    )
    turn.set(load_id=identity, load_outcome=None, load_message="")
    run_checks(turn)


def next_leg(turn: Turn) -> None:
    """Go on to the next waypoint file, or the next repetition, on the ground."""
    state, files = turn.state, turn.state.mission.files if turn.state.mission is not None else 1
    last_file = state.file_index + 1 >= files
    turn.set(
        file_index=0 if last_file else state.file_index + 1,
        repetition=state.repetition + 1 if last_file else state.repetition,
        in_flight=False,
    )
    load_mission(turn)


# --- motion -----------------------------------------------------------------------------------------------------------


def _motion(turn: Turn, action: MissionAction) -> None:
    identity = turn.take_id()
    turn.send(
        MissionCommand(
            id=identity, limit_ns=turn.limits.command_reply_limit_ns, session_id=turn.state.session_id, action=action
        )
    )
    commanded = turn.state.commanded
    turn.set(
        motion_id=identity,
        motion_ns=turn.now,
        motion_outcome=None,
        motion_message="",
        mode_shown=False,
        commanded=commanded if commanded[-1:] == (action,) else (*commanded, action),
    )


def take_off(turn: Turn) -> None:
    """Command the takeoff: from here on it is a flight."""
    turn.set(
        in_flight=True,
        flight_started_ns=turn.now,
        was_armed=False,
        was_airborne=False,
        grounded_ns=None,
        spent=(),
        flown_without=flown_without(turn),
        user_hold_ns=None,
        commanded=(),
        confirmed=None,
        mode_before=turn.state.autopilot.mode if turn.state.autopilot is not None else "",
        takeover_noted=False,
        land_ns=None,
        land_cause="",
        both_routes=False,
        alarmed=False,
        overdue_alarmed=False,
        disarm_sent_ns=None,
    )
    _motion(turn, MissionAction.TAKEOFF)


def cancel_takeoff(turn: Turn) -> None:
    """Command ABORT: before lift-off it cancels and disarms."""
    _motion(turn, MissionAction.ABORT)


def hold(turn: Turn) -> None:
    """Command a hold."""
    turn.set(hold_repeated=False)
    _motion(turn, MissionAction.HOLD)


def hold_again(turn: Turn) -> None:
    """Command the hold once more: nothing shows it."""
    turn.set(hold_repeated=True)
    _motion(turn, MissionAction.HOLD)


def resume(turn: Turn) -> None:
    """Command to go on."""
    _motion(turn, MissionAction.RESUME)


def ask_hold(turn: Turn) -> None:
    """The user asks for a hold."""
    turn.set(user_hold_ns=turn.now)


def end_hold(turn: Turn) -> None:
    """The user asks to go on."""
    turn.set(user_hold_ns=None)


def land(turn: Turn) -> None:
    """Command the landing; by the second route too when both are due."""
    state = turn.state
    if state.land_ns is None:
        turn.set(land_ns=turn.now, second_route_ns=None, user_hold_ns=None, land_cause=state.cause)
        if mission_flown(turn) is not None:
            turn.set(result=Result.COMPLETE)  # its last waypoint was flown: who ends the landing does not matter
    late = passed("land_second_route_after", turn.state, turn.rules, turn.now)
    overdue = passed("land_limit", turn.state, turn.rules, turn.now)
    if not any(isinstance(c, MissionCommand) and c.action is MissionAction.LAND for c in turn.commands):
        _motion(turn, MissionAction.LAND)
    if turn.state.both_routes or late or overdue:
        _second_route(turn)
    turn.set(land_sent_ns=turn.now)


def _second_route(turn: Turn) -> None:
    if any(isinstance(command, AutopilotLand) for command in turn.commands):
        return
    turn.send(AutopilotLand(id=turn.take_id(), limit_ns=turn.limits.command_reply_limit_ns))
    if turn.state.second_route_ns is None:
        turn.set(second_route_ns=turn.now)


def land_both(turn: Turn) -> None:
    """Command the landing by both routes from now on."""
    turn.set(both_routes=True)
    land(turn)


def adopt_flight(turn: Turn) -> None:
    """A flight that is not ours is landed: it counts as a flight from here on."""
    turn.set(
        in_flight=True,
        flight_started_ns=turn.now,
        was_armed=True,
        flown=True,
        both_routes=True,
        commanded=(),
        confirmed=None,
        mode_before=turn.state.autopilot.mode if turn.state.autopilot is not None else "",
        takeover_noted=False,
        land_ns=None,
        alarmed=False,
        overdue_alarmed=False,
    )


def adopt_late_arming(turn: Turn) -> None:
    """A takeoff that was called off arms all the same: it is landed as a flight; flown it is once it lifts off."""
    flown = turn.state.flown
    adopt_flight(turn)
    turn.set(flown=flown)


def alarm(turn: Turn) -> None:
    """Remember that the pilot was alarmed."""
    turn.set(alarmed=True)


def disarm(turn: Turn) -> None:
    """Disarm on the ground."""
    turn.send(AutopilotDisarm(id=turn.take_id(), limit_ns=turn.limits.command_reply_limit_ns))
    turn.set(disarm_sent_ns=turn.now)


def pilot(turn: Turn) -> None:
    """Stop commanding."""
    turn.set(commanded=(), confirmed=None, user_hold_ns=None, takeover_noted=False)


# --- data -------------------------------------------------------------------------------------------------------------


def clean_up(turn: Turn) -> None:
    """Stop the recording; say so when the landing detection does not confirm the landing."""
    state = turn.state
    flown = state.was_airborne
    turn.set(in_flight=False, land_ns=None, user_hold_ns=None, outreach=OutreachKind.NONE)
    detection = turn.detection()
    if flown and detection is not Landed.ON_GROUND:
        reason = f"it says {detection.name}" + (
            f", {state.landing.reason}" if state.landing and state.landing.reason else ""
        )
        turn.notify("landing_unconfirmed", reason=reason)
    if not state.recording_asked:
        return
    identity = turn.take_id()
    turn.send(StopRecording(id=identity, limit_ns=turn.limits.command_reply_limit_ns, session_id=state.session_id))
    failed = state.recorder is not None and state.recorder.phase is RecordingPhase.FAILED
    turn.set(recording_id=identity, recording_outcome=None, recording_message="", recording_progressed=not failed)


def end_mission(turn: Turn) -> None:
    """Say whether it was flown at all; drop the missions that were still to come, unless this one is complete."""
    if turn.state.result in (Result.NOT_FLOWN, Result.LANDED_EARLY):
        turn.set(result=Result.LANDED_EARLY if turn.state.flown else Result.NOT_FLOWN)
    state = turn.state
    turn.set(recording_over=True, in_flight=False)
    if state.result is not Result.COMPLETE:
        drop_queue(turn)


def drop_queue(turn: Turn) -> None:
    """Drop the missions that were still to come, and say so."""
    state = turn.state
    if state.queue:
        turn.notify("queue_dropped", missions=", ".join(mission.id for mission in state.queue))
        turn.set(queue=())


Place = Tuple[State, Step]

ENTER: Mapping[Place, Effect] = {
    (State.MISSION_INPUT, Step.NONE): forget_mission,
    (State.PREFLIGHT, Step.NONE): preflight,
    (State.READY, Step.NONE): ready,
    (State.START_RECORDING, Step.NONE): start_recording,
    (State.LOAD_MISSION, Step.NONE): load_mission,
    (State.TAKEOFF, Step.ARMING): take_off,
    (State.TAKEOFF, Step.CANCELLING): cancel_takeoff,
    (State.MISSION, Step.TOUCHDOWN): next_leg,
    (State.HOLD, Step.CONFIRMING): hold,
    (State.HOLD, Step.RESUMING): resume,
    (State.LAND, Step.COMMANDING): land,
    (State.PILOT, Step.NONE): pilot,
    (State.DATA_CLEANUP, Step.NONE): clean_up,
    (State.MISSION_ENDED, Step.NONE): end_mission,
}
