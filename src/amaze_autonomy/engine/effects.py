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
from .context import TAKES_OFF, Context
from .events import CHECKS, CheckName, Landed, MissionPhase, RecordingPhase, checks_of
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

Effect = Callable[[Context], None]


# --- before takeoff ---------------------------------------------------------------------------------------------------


def queue_missions(context: Context) -> None:
    """Put the selected missions into the queue."""
    context.set(queue=context.selected)


def begin_session(context: Context) -> None:
    """Start a new session with the mission at the head of the queue: nothing of the last one remains."""
    state, flight, number = context.state, context.state.flight, context.state.sessions + 1
    context.set(
        sessions=number,
        queue=state.queue[1:],
        session=Session(id=f"{state.label}-{number:03d}", mission=state.queue[0]),
        preflight=Preflight(),
        recording=Recording(),
    )
    context.put("peers", planner=None, planner_ns=None, planner_idle_ns=None, landing_stalled_ns=None)
    context.put("peers", recorder=None, recorder_ns=None)
    calls_off = () if flight.was_airborne else flight.commanded  # a takeoff called off may still arm
    context.put("flight", was_armed=False, was_airborne=False, commanded=calls_off)


def forget_mission(context: Context) -> None:
    """Be ready for the next selection."""
    context.set(session=Session(), preflight=Preflight(), recording=Recording(), failures=())


def preflight(context: Context) -> None:
    """Ask for all checks, and start the time in which the watchdog may fix what fails."""
    state, limits = context.state, context.limits
    startup = limits.watchdog_startup_time_ns if state.peers.watchdog_started_ns is None else 0
    context.put(
        "preflight",
        rounds=state.preflight.rounds + 1,
        fix_deadline_ns=context.now + startup + limits.preflight_fix_limit_ns,
    )
    context.put("session", outreach=OutreachKind.NONE)
    run_checks(context)


def run_checks(context: Context) -> None:
    """Ask for all checks, in their order. Rows of the last answers stay in the table until the new ones come."""
    before = {record.check: record for record in context.state.preflight.checks}
    records = []
    for check in checks_of(context.rules):
        request = _request(context, check)
        context.send(request)
        old = before.get(check, CheckRecord(check=check))
        records.append(
            evolve(
                old, command_id=request.id, asked_ns=context.now, replied_ns=None, outcome=None, ok=False, message=""
            )
        )
    context.put("preflight", checks=tuple(records))


def _request(context: Context, check: CheckName) -> RunCheck:
    session, started = context.state.session, context.state.peers.watchdog_started_ns is not None
    mission, reserve = session.mission, context.limits.battery_reserve_fraction
    known: Mapping[str, Any] = {
        "required": mission.required if mission is not None else (),
        "startup_time_ns": 0 if started else context.limits.watchdog_startup_time_ns,
        "required_fraction": mission.battery_needed(session.takeoff, reserve) if mission is not None else None,
    }
    return RunCheck(
        id=context.take_id(),
        limit_ns=check_limit_ns(context.state, context.rules, check),
        check=check,
        mission_id=mission.id if mission is not None else "",
        **{name: value for name, value in known.items() if name in CHECKS[check].asks},
    )


def forgive(context: Context) -> None:
    """The user retries: rounds are counted afresh, and it is not asked again whether the mission goes on."""
    context.put("preflight", rounds=0, away=False)


def ready(context: Context) -> None:
    """Say so."""
    context.notify("ready_wait_go" if context.rules.require_go else "ready")


def start_recording(context: Context) -> None:
    """Ask the recorder to start, unless it proves that it records this session already."""
    recording, mission = context.state.recording, context.state.session.mission
    if recording.asked and records(context):
        context.put("recording", request=evolve(recording.request, outcome=None))
        return
    request = StartRecording(
        id=context.take_id(),
        limit_ns=context.limits.command_reply_limit_ns,
        session_id=context.state.session.id,
        mission_id=mission.id if mission is not None else "",
    )
    context.set(recording=Recording(asked=True, request=context.send(request), location=recording.location))


def load_mission(context: Context) -> None:
    """Send the mission to the planner, and ask for all checks again."""
    session = context.state.session
    request = LoadMission(
        id=context.take_id(),
        limit_ns=context.limits.load_limit_ns,
        session_id=session.id,
        mission_id=session.mission.id if session.mission is not None else "",
        file_index=session.file_index,
        repetition=session.repetition,
    )
    context.put("preflight", load=context.send(request))
    run_checks(context)


def next_leg(context: Context) -> None:
    """Go on to the next waypoint file, or the next repetition, on the ground."""
    session = context.state.session
    last_file = session.mission is None or session.file_index + 1 >= session.mission.files
    context.put(
        "session",
        file_index=0 if last_file else session.file_index + 1,
        repetition=session.repetition + 1 if last_file else session.repetition,
    )
    context.put("flight", active=False)
    load_mission(context)


# --- motion -----------------------------------------------------------------------------------------------------------


def _motion(context: Context, action: MissionAction) -> None:
    limit_ns, session_id = context.limits.command_reply_limit_ns, context.state.session.id
    asked = context.send(MissionCommand(id=context.take_id(), limit_ns=limit_ns, session_id=session_id, action=action))
    commanded = context.state.flight.commanded
    commanded = commanded if commanded[-1:] == (action,) else (*commanded, action)
    context.put("flight", motion=asked, mode_shown="", commanded=commanded)
    if action in TAKES_OFF:
        context.put("flight", mode_flown="")


def _mode(context: Context) -> str:
    return context.state.peers.autopilot.mode if context.state.peers.autopilot is not None else ""


def take_off(context: Context) -> None:
    """Command the takeoff: from here on it is a flight."""
    without = flown_without(context)
    flight = Flight(active=True, started_ns=context.now, flown_without=without, mode_before=_mode(context))
    context.set(flight=flight, landing=Landing())
    _motion(context, MissionAction.TAKEOFF)


def cancel_takeoff(context: Context) -> None:
    """Command ABORT: before lift-off it cancels and disarms."""
    _motion(context, MissionAction.ABORT)


def hold(context: Context) -> None:
    """Command a hold."""
    context.put("flight", hold_repeated=False)
    _motion(context, MissionAction.HOLD)
    planner = context.state.peers.planner
    if planner is not None and planner.phase is MissionPhase.HOLDING:
        context.put("peers", planner_idle_ns=None)  # it is asked for now


def hold_again(context: Context) -> None:
    """Command the hold once more: nothing shows it."""
    context.put("flight", hold_repeated=True)
    _motion(context, MissionAction.HOLD)


def resume(context: Context) -> None:
    """Command to go on."""
    _motion(context, MissionAction.RESUME)


def ask_hold(context: Context) -> None:
    """The user asks for a hold."""
    context.put("flight", user_hold_ns=context.now)


def end_hold(context: Context) -> None:
    """The user asks to go on."""
    context.put("flight", user_hold_ns=None)


def land(context: Context) -> None:
    """Command the landing; by the second route too when both are due."""
    state = context.state
    if state.landing.since_ns is None:
        context.put("landing", since_ns=context.now, cause=state.cause)
        context.put("flight", user_hold_ns=None)
        drop_queue(context)  # whoever had the next mission in mind did not know of this
        if state.flight.commanded and mission_flown(context) is not None:  # not of one that is taken up after its end
            context.put("session", result=Result.COMPLETE)  # its last waypoint was flown, whoever ends the landing
    late = passed("land_second_route_after", context.state, context.rules, context.now)
    overdue = passed("land_limit", context.state, context.rules, context.now)
    if not any(isinstance(c, MissionCommand) and c.action is MissionAction.LAND for c in context.commands):
        _motion(context, MissionAction.LAND)
    if context.state.landing.both_routes or late or overdue:
        _second_route(context)
    context.put("landing", sent_ns=context.now)


def _second_route(context: Context) -> None:
    if any(isinstance(command, AutopilotLand) for command in context.commands):
        return
    context.send(AutopilotLand(id=context.take_id(), limit_ns=context.limits.command_reply_limit_ns))
    if context.state.landing.second_route_ns is None:
        context.put("landing", second_route_ns=context.now)


def land_both(context: Context) -> None:
    """Command the landing by both routes from now on."""
    context.put("landing", both_routes=True)
    land(context)


def adopt_flight(context: Context) -> None:
    """A flight that is not ours, or seemed over, is landed: it counts as a flight, and keeps the result it had."""
    adopt_late_arming(context)
    context.put("session", flown=True)


def adopt_late_arming(context: Context) -> None:
    """A takeoff that was called off arms all the same: it is landed as a flight; flown it is once it lifts off."""
    context.put(
        "flight",
        active=True,
        started_ns=context.now,
        was_armed=True,
        commanded=(),
        confirmed=None,
        mode_before=_mode(context),
        takeover_noted=False,
        another=False,
    )
    context.set(landing=Landing(both_routes=True))
    if context.state.session.result is Result.NONE:
        context.put("session", result=Result.LANDED_EARLY)


def alarm(context: Context) -> None:
    """Remember that the pilot was alarmed."""
    context.put("landing", alarmed=True)


def disarm(context: Context) -> None:
    """Disarm on the ground."""
    context.send(AutopilotDisarm(id=context.take_id(), limit_ns=context.limits.command_reply_limit_ns))
    context.put("landing", disarm_sent_ns=context.now)


def give_up_landing(context: Context) -> None:
    """Take what is heard of the vehicle from now on as after a start: in the air, it is landed."""
    lose_sight(context)
    context.set(armed_at_start=None)
    context.put("vehicle", down=None, aloft=None, motors=None, disarmed=None, spinning=None)


def lose_sight(context: Context) -> None:
    """The recording ends before anybody knows that the flight did, unless it has been disarmed for long."""
    flown_on = context.state.recording.flown_on or not context.disarmed_for_long()
    context.put("recording", flown_on=flown_on)


def say_who(context: Context) -> None:
    """Say what asks for it in the place of a person."""
    if context.asked_by:
        context.notify("called_off", by=context.asked_by)


def pilot(context: Context) -> None:
    """Stop commanding: no mode is ours any more, nor that of before; no other mission takes off behind the pilot."""
    context.put("flight", commanded=(), confirmed=None, mode_before="", mode_flown="")
    context.put("flight", user_hold_ns=None, takeover_noted=False, another=True)
    context.set(armed_at_start=False)  # nor is it ours when it was not heard for a while
    drop_queue(context)


# --- data -------------------------------------------------------------------------------------------------------------


def clean_up(context: Context) -> None:
    """Stop the recording; say so when the landing detection does not confirm the landing."""
    state = context.state
    flown = state.flight.was_airborne
    context.put("flight", active=False, user_hold_ns=None)
    context.put("landing", since_ns=None)
    context.put("session", outreach=OutreachKind.NONE)
    detection = context.detection()
    if flown and detection is not Landed.ON_GROUND:
        reason = f"it says {detection.name}" + (
            f", {state.peers.landing.reason}" if state.peers.landing and state.peers.landing.reason else ""
        )
        context.notify("landing_unconfirmed", reason=reason)
    if not state.recording.asked:
        return
    limit_ns = context.limits.command_reply_limit_ns
    request = context.send(StopRecording(id=context.take_id(), limit_ns=limit_ns, session_id=state.session.id))
    failed = state.peers.recorder is not None and state.peers.recorder.phase is RecordingPhase.FAILED
    context.put("recording", request=request, progressed=not failed, stopped=True)


def end_mission(context: Context) -> None:
    """Say whether it was flown at all; drop the missions that were still to come, unless this one is complete."""
    if context.state.session.result in (Result.NOT_FLOWN, Result.LANDED_EARLY):
        context.put("session", result=Result.LANDED_EARLY if context.state.session.flown else Result.NOT_FLOWN)
    state = context.state
    context.put("recording", over=True)
    context.put("flight", active=False)
    if state.session.result is not Result.COMPLETE:
        drop_queue(context)


drop_queue: Effect = Context.drop_queue


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
