"""What is done on the way into a state: which requests go out, which fields start afresh. `ENTER` is the table."""

from __future__ import annotations

from typing import Any, Callable, Mapping, Tuple

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
from .context import Turn
from .events import CHECKS, CheckName, Landed, RecordingPhase
from .failsafe import flown_without
from .flight_guards import mission_flown
from .guards import records
from .state import (
    CheckRecord,
    Flight,
    Landing,
    OutreachKind,
    Preflight,
    Recording,
    Result,
    Session,
    State,
    Step,
    evolve,
)
from .timers import check_limit_ns, passed

__all__ = ["ENTER", "Effect"]

Effect = Callable[[Turn], None]


# --- before takeoff ---------------------------------------------------------------------------------------------------


def queue_missions(turn: Turn) -> None:
    """Put the selected missions into the queue."""
    turn.set(queue=turn.selected)


def begin_session(turn: Turn) -> None:
    """Start a new session with the mission at the head of the queue: nothing of the last one remains."""
    state, flight, number = turn.state, turn.state.flight, turn.state.sessions + 1
    turn.set(
        sessions=number,
        queue=state.queue[1:],
        session=Session(id=f"{state.label}-{number:03d}", mission=state.queue[0]),
        preflight=Preflight(),
        recording=Recording(),
    )
    turn.put("peers", planner=None, planner_ns=None, recorder=None, recorder_ns=None)
    calls_off = () if flight.was_airborne else flight.commanded  # a takeoff called off may still arm
    turn.put("flight", was_armed=False, was_airborne=False, commanded=calls_off)


def forget_mission(turn: Turn) -> None:
    """Be ready for the next selection."""
    turn.set(session=Session(), preflight=Preflight(), failures=())


def preflight(turn: Turn) -> None:
    """Ask for all checks, and start the time in which the watchdog may fix what fails."""
    state, limits = turn.state, turn.limits
    startup = limits.watchdog_startup_time_ns if state.peers.watchdog_started_ns is None else 0
    turn.put(
        "preflight",
        rounds=state.preflight.rounds + 1,
        fix_deadline_ns=turn.now + startup + limits.preflight_fix_limit_ns,
    )
    turn.put("session", outreach=OutreachKind.NONE)
    run_checks(turn)


def run_checks(turn: Turn) -> None:
    """Ask for all checks, in their order. Rows of the last answers stay in the table until the new ones come."""
    before = {record.check: record for record in turn.state.preflight.checks}
    records = []
    for check in CheckName:
        request = _request(turn, check)
        turn.send(request)
        old = before.get(check, CheckRecord(check=check))
        records.append(
            evolve(old, command_id=request.id, asked_ns=turn.now, replied_ns=None, outcome=None, ok=False, message="")
        )
    turn.put("preflight", checks=tuple(records))


def _request(turn: Turn, check: CheckName) -> RunCheck:
    mission, started = turn.state.session.mission, turn.state.peers.watchdog_started_ns is not None
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
    turn.put("preflight", rounds=0)


def ready(turn: Turn) -> None:
    """Say so."""
    turn.notify("ready_wait_go" if turn.rules.require_go else "ready")


def start_recording(turn: Turn) -> None:
    """Ask the recorder to start, unless it proves that it records this session already."""
    recording, mission = turn.state.recording, turn.state.session.mission
    if recording.asked and records(turn):
        turn.put("recording", request=evolve(recording.request, outcome=None))
        return
    request = StartRecording(
        id=turn.take_id(),
        limit_ns=turn.limits.command_reply_limit_ns,
        session_id=turn.state.session.id,
        mission_id=mission.id if mission is not None else "",
    )
    turn.set(recording=Recording(asked=True, request=turn.send(request), location=recording.location))


def load_mission(turn: Turn) -> None:
    """Send the mission to the planner, and ask for all checks again."""
    session = turn.state.session
    request = LoadMission(
        id=turn.take_id(),
        limit_ns=turn.limits.load_limit_ns,
        session_id=session.id,
        mission_id=session.mission.id if session.mission is not None else "",
        file_index=session.file_index,
        repetition=session.repetition,
    )
    turn.put("preflight", load=turn.send(request))
    run_checks(turn)


def next_leg(turn: Turn) -> None:
    """Go on to the next waypoint file, or the next repetition, on the ground."""
    session = turn.state.session
    last_file = session.mission is None or session.file_index + 1 >= session.mission.files
    turn.put(
        "session",
        file_index=0 if last_file else session.file_index + 1,
        repetition=session.repetition + 1 if last_file else session.repetition,
    )
    turn.put("flight", active=False)
    load_mission(turn)


# --- motion -----------------------------------------------------------------------------------------------------------


def _motion(turn: Turn, action: MissionAction) -> None:
    limit_ns, session_id = turn.limits.command_reply_limit_ns, turn.state.session.id
    asked = turn.send(MissionCommand(id=turn.take_id(), limit_ns=limit_ns, session_id=session_id, action=action))
    commanded = turn.state.flight.commanded
    commanded = commanded if commanded[-1:] == (action,) else (*commanded, action)
    turn.put("flight", motion=asked, mode_shown=False, commanded=commanded)


def _mode(turn: Turn) -> str:
    return turn.state.peers.autopilot.mode if turn.state.peers.autopilot is not None else ""


def take_off(turn: Turn) -> None:
    """Command the takeoff: from here on it is a flight."""
    without = flown_without(turn)
    flight = Flight(active=True, started_ns=turn.now, flown_without=without, mode_before=_mode(turn))
    turn.set(flight=flight, landing=Landing())
    _motion(turn, MissionAction.TAKEOFF)


def cancel_takeoff(turn: Turn) -> None:
    """Command ABORT: before lift-off it cancels and disarms."""
    _motion(turn, MissionAction.ABORT)


def hold(turn: Turn) -> None:
    """Command a hold."""
    turn.put("flight", hold_repeated=False)
    _motion(turn, MissionAction.HOLD)


def hold_again(turn: Turn) -> None:
    """Command the hold once more: nothing shows it."""
    turn.put("flight", hold_repeated=True)
    _motion(turn, MissionAction.HOLD)


def resume(turn: Turn) -> None:
    """Command to go on."""
    _motion(turn, MissionAction.RESUME)


def ask_hold(turn: Turn) -> None:
    """The user asks for a hold."""
    turn.put("flight", user_hold_ns=turn.now)


def end_hold(turn: Turn) -> None:
    """The user asks to go on."""
    turn.put("flight", user_hold_ns=None)


def land(turn: Turn) -> None:
    """Command the landing; by the second route too when both are due."""
    state = turn.state
    if state.landing.since_ns is None:
        turn.put("landing", since_ns=turn.now, cause=state.cause)
        turn.put("flight", user_hold_ns=None)
        if mission_flown(turn) is not None:
            turn.put("session", result=Result.COMPLETE)  # its last waypoint was flown, whoever ends the landing
    late = passed("land_second_route_after", turn.state, turn.rules, turn.now)
    overdue = passed("land_limit", turn.state, turn.rules, turn.now)
    if not any(isinstance(c, MissionCommand) and c.action is MissionAction.LAND for c in turn.commands):
        _motion(turn, MissionAction.LAND)
    if turn.state.landing.both_routes or late or overdue:
        _second_route(turn)
    turn.put("landing", sent_ns=turn.now)


def _second_route(turn: Turn) -> None:
    if any(isinstance(command, AutopilotLand) for command in turn.commands):
        return
    turn.send(AutopilotLand(id=turn.take_id(), limit_ns=turn.limits.command_reply_limit_ns))
    if turn.state.landing.second_route_ns is None:
        turn.put("landing", second_route_ns=turn.now)


def land_both(turn: Turn) -> None:
    """Command the landing by both routes from now on."""
    turn.put("landing", both_routes=True)
    land(turn)


def adopt_flight(turn: Turn) -> None:
    """A flight that is not ours, or seemed over, is landed: it counts as a flight from here on."""
    adopt_late_arming(turn)
    turn.put("session", flown=True)


def adopt_late_arming(turn: Turn) -> None:
    """A takeoff that was called off arms all the same: it is landed as a flight; flown it is once it lifts off."""
    turn.put(
        "flight",
        active=True,
        started_ns=turn.now,
        was_armed=True,
        commanded=(),
        confirmed=None,
        mode_before=_mode(turn),
        takeover_noted=False,
    )
    turn.set(landing=Landing(both_routes=True))


def alarm(turn: Turn) -> None:
    """Remember that the pilot was alarmed."""
    turn.put("landing", alarmed=True)


def disarm(turn: Turn) -> None:
    """Disarm on the ground."""
    turn.send(AutopilotDisarm(id=turn.take_id(), limit_ns=turn.limits.command_reply_limit_ns))
    turn.put("landing", disarm_sent_ns=turn.now)


def pilot(turn: Turn) -> None:
    """Stop commanding."""
    turn.put("flight", commanded=(), confirmed=None, user_hold_ns=None, takeover_noted=False)


# --- data -------------------------------------------------------------------------------------------------------------


def clean_up(turn: Turn) -> None:
    """Stop the recording; say so when the landing detection does not confirm the landing."""
    state = turn.state
    flown = state.flight.was_airborne
    turn.put("flight", active=False, user_hold_ns=None)
    turn.put("landing", since_ns=None)
    turn.put("session", outreach=OutreachKind.NONE)
    detection = turn.detection()
    if flown and detection is not Landed.ON_GROUND:
        reason = f"it says {detection.name}" + (
            f", {state.peers.landing.reason}" if state.peers.landing and state.peers.landing.reason else ""
        )
        turn.notify("landing_unconfirmed", reason=reason)
    if not state.recording.asked:
        return
    limit_ns = turn.limits.command_reply_limit_ns
    request = turn.send(StopRecording(id=turn.take_id(), limit_ns=limit_ns, session_id=state.session.id))
    failed = state.peers.recorder is not None and state.peers.recorder.phase is RecordingPhase.FAILED
    turn.put("recording", request=request, progressed=not failed)


def end_mission(turn: Turn) -> None:
    """Say whether it was flown at all; drop the missions that were still to come, unless this one is complete."""
    if turn.state.session.result in (Result.NOT_FLOWN, Result.LANDED_EARLY):
        turn.put("session", result=Result.LANDED_EARLY if turn.state.session.flown else Result.NOT_FLOWN)
    state = turn.state
    turn.put("recording", over=True)
    turn.put("flight", active=False)
    if state.session.result is not Result.COMPLETE:
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
