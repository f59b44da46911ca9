"""What each event changes in what the engine knows. No decisions here: they follow from the facts afterwards.

Late and foreign messages end here: a reply to a request that is no longer current, a status of another session, one
that is too old or claims to come from the future, a heartbeat whose loop counter stands still.
"""

from __future__ import annotations

from typing import Callable, Dict, Iterable, Optional, Tuple, Type

from .checks import CheckName
from .commands import Value
from .events import (
    AutopilotStatus,
    CheckReply,
    ComponentStatus,
    EngineStarted,
    Event,
    LandedStatus,
    MissionStatus,
    Outcome,
    RecordingPhase,
    RecordingStatus,
    Reply,
    Shutdown,
    WatchdogAction,
    WatchdogInfo,
)
from .mission import Mission
from .modes import MODES, ours
from .severity import Code
from .state import CheckRecord, State, Step, evolve
from .timers import check_limit_ns
from .turn import Turn

__all__ = ["absorb"]

_NS = 1_000_000_000


def absorb(turn: Turn) -> None:
    """Put what the event says into the state."""
    turn.set(t_ns=turn.now)
    _expire_checks(turn)
    absorber = _ABSORB.get(type(turn.event))
    if absorber is not None:
        absorber(turn, turn.event)


def _expire_checks(turn: Turn) -> None:
    """Close the checks that were not answered in time."""
    state = turn.state
    late = [
        record
        for record in state.checks
        if record.outcome is None and turn.now >= record.asked_ns + check_limit_ns(state, turn.rules, record.check)
    ]
    if late and not isinstance(turn.event, CheckReply):
        turn.set(checks=tuple(_timed_out(r, turn.now) if r in late else r for r in state.checks))


def _timed_out(record: CheckRecord, now_ns: int) -> CheckRecord:
    message = f"the {record.check.value} check got no answer in time"
    return evolve(
        record,
        replied_ns=now_ns,
        outcome=Outcome.TIMED_OUT,
        ok=False,
        fixable=False,
        being_fixed=False,
        until_ns=None,
        message=message,
    )


def _credible(turn: Turn, age_ns: int) -> bool:
    return -turn.limits.clock_tolerance_ns <= age_ns <= turn.limits.status_max_age_ns


def _engine_started(turn: Turn, event: EngineStarted) -> None:
    state = turn.state
    turn.set(label=event.label, started_ns=turn.now, armed_at_start=None, shutting_down=False)
    if not event.resumed:
        return
    seen = {
        name: turn.now
        for name in (
            "heartbeat_ns",
            "planner_ns",
            "recorder_ns",
            "autopilot_ns",
            "landing_ns",
            "battery_ns",
            "position_ns",
        )
        if getattr(state, name) is not None
    }
    turn.set(**seen)
    # The limits of silence run from now on; what was said before is not known any more.
    turn.set(autopilot=None, planner=None, recorder=None, landing=None, recording_since_ns=None, descending_ns=None)
    if state.in_flight or state.state is not State.MISSION_INPUT:
        turn.notify("resumed", state=state.state.value)


def _shutdown(turn: Turn, _: Shutdown) -> None:
    turn.set(shutting_down=True)


def _watchdog_action(turn: Turn, event: WatchdogAction) -> None:
    if not _credible(turn, event.age_ns):
        return
    previous = turn.state.action
    turn.set(action=event)
    if previous is None or previous.loop_counter != event.loop_counter:
        turn.set(heartbeat_ns=turn.now)
    listed = _worst_by_name(_listed(event))
    kept = [s for s in turn.state.components if s.name not in listed and s.code < Code.INCONVENIENT]
    turn.set(components=tuple(sorted([*kept, *listed.values()], key=_by_name)))


def _listed(event: WatchdogAction) -> Tuple[ComponentStatus, ...]:
    """Return the components at 4 or above; a legacy watchdog may say only a code and the latest component."""
    if event.code < Code.INCONVENIENT or any(status.code >= event.code for status in event.components):
        return event.components
    name = event.latest_component or "unnamed component"
    others = tuple(status for status in event.components if status.name != name)
    return (*others, ComponentStatus(name=name, code=event.code, reason="the watchdog says so"))


def _watchdog_info(turn: Turn, event: WatchdogInfo) -> None:
    """Take what is below 4 from the info stream; what is at 4 or above is the action stream's to say."""
    if not _credible(turn, event.age_ns):
        return
    acted = {s.name: s for s in turn.state.components if s.code >= Code.INCONVENIENT}
    informed = _worst_by_name(
        s for s in event.components if s.code < Code.INCONVENIENT and s.name not in acted
    ).values()
    turn.set(components=tuple(sorted([*acted.values(), *informed], key=_by_name)))


def _worst_by_name(statuses: Iterable[ComponentStatus]) -> Dict[str, ComponentStatus]:
    """Return one status for each name: of those that are listed twice the worst."""
    found: Dict[str, ComponentStatus] = {}
    for status in statuses:
        if status.name not in found or status.code > found[status.name].code:
            found[status.name] = status
    return found


def _by_name(status: ComponentStatus) -> str:
    return status.name


def _check_reply(turn: Turn, event: CheckReply) -> None:
    records = turn.state.checks
    current = [r for r in records if r.check is event.check and r.command_id == event.command_id and r.outcome is None]
    if not current:
        return
    answered = answer_of(current[0], event, turn.now)
    lacks = lacking(turn.state.mission, event.components) if event.check is CheckName.WATCHDOG else None
    if answered.ok and lacks is not None:
        answered = evolve(
            answered, ok=False, message=f"{lacks.name} is at code {int(lacks.code)}, although it says ready"
        )
    turn.set(checks=tuple(answered if r is current[0] else r for r in records))
    if (
        event.check is CheckName.WATCHDOG
        and event.outcome is Outcome.ACCEPTED
        and turn.state.watchdog_started_ns is None
    ):
        turn.set(watchdog_started_ns=turn.now)


def answer_of(record: CheckRecord, event: CheckReply, now_ns: int) -> CheckRecord:
    """Return the record of a check with its answer. "ok" is believed only when every row of it passed."""
    answered = event.outcome is Outcome.ACCEPTED
    failed = [row for row in event.checks if not row.passed]
    message = event.message or "; ".join(f"{row.name}: {row.advice or row.verdict.value}" for row in failed)
    if not answered:
        message = event.message or f"the {event.check.value} check got no answer ({event.outcome.value})"
    return evolve(
        record,
        replied_ns=now_ns,
        outcome=event.outcome,
        ok=answered and event.ok and not failed,
        rows=event.checks if answered else record.rows,
        fixable=answered and event.fixable,
        being_fixed=answered and event.being_fixed,
        until_ns=event.until_ns,
        message=message,
    )


def lacking(mission: Optional[Mission], components: Tuple[ComponentStatus, ...]) -> Optional[ComponentStatus]:
    """Return the first required component that is neither at code 1 nor, tolerated, at code 2."""
    required, tolerated = (mission.required, mission.tolerated) if mission is not None else ((), ())
    for status in components:
        needed = not required or status.name in required
        accepted = status.code == Code.NOMINAL or (status.code == Code.NON_CRITICAL and status.name in tolerated)
        if needed and not accepted:
            return status
    return None


def _reply(turn: Turn, event: Reply) -> None:
    state = turn.state
    if event.command_id == state.motion_id:
        turn.set(motion_outcome=event.outcome, motion_message=event.message)
    elif event.command_id == state.load_id:
        turn.set(load_outcome=event.outcome, load_message=event.message)
    elif event.command_id == state.recording_id:
        turn.set(recording_outcome=event.outcome, recording_message=event.message)


def _mission_status(turn: Turn, event: MissionStatus) -> None:
    if event.session_id == turn.state.session_id and event.session_id and _credible(turn, event.age_ns):
        turn.set(planner=event, planner_ns=turn.now)


def _recording_status(turn: Turn, event: RecordingStatus) -> None:
    if event.session_id != turn.state.session_id or not event.session_id or not _credible(turn, event.age_ns):
        return
    growing = proves_recording(event)
    since = turn.state.recording_since_ns
    turn.set(
        recorder=event,
        recorder_ns=turn.now,
        recording_since_ns=(turn.now if since is None else since) if growing else None,
        data_location=event.location or turn.state.data_location,
        recording_progressed=turn.state.recording_progressed or event.phase is not RecordingPhase.FAILED,
    )


def proves_recording(event: RecordingStatus) -> bool:
    """Return True when a recorder's status proves that files grow on every platform."""
    recording = event.phase is RecordingPhase.RECORDING
    return recording and bool(event.platforms) and all(platform.growing for platform in event.platforms)


def _autopilot_status(turn: Turn, event: AutopilotStatus) -> None:
    if not _credible(turn, event.age_ns):
        return
    _flight_mode(turn, event)
    state = turn.state
    turn.set(autopilot=event, autopilot_ns=turn.now)
    if event.battery_fraction is not None and event.battery_age_s is not None and event.battery_age_s >= 0:
        turn.set(battery_ns=max(0, turn.now - int(event.battery_age_s * _NS)))
    if None not in (event.height_m, event.position_x_m, event.position_y_m):
        turn.set(position_ns=turn.now)
    speed = event.vertical_speed_m_s
    descending = speed is not None and speed <= -turn.limits.descent_speed_m_s
    turn.set(descending_ns=(turn.now if state.descending_ns is None else state.descending_ns) if descending else None)
    if state.armed_at_start is None and state.started_ns is not None and event.armed is not None:
        turn.set(armed_at_start=event.armed)
    _flight(turn)


def _flight_mode(turn: Turn, event: AutopilotStatus) -> None:
    """Tell a mode that answers our commands from a foreign one (rule 4)."""
    state = turn.state
    if not state.in_flight or event.armed is False or not event.mode:
        return
    if state.commanded and event.mode in MODES[state.commanded[-1]]:
        turn.set(confirmed=state.commanded[-1], commanded=state.commanded[-1:])
    elif not ours(event.mode, state.commanded, state.confirmed):
        before = state.autopilot.mode if state.autopilot is not None else ""
        if state.confirmed is not None or event.mode != before:
            turn.foreign_mode = (
                Value("reason", f"flight mode {event.mode} was not commanded"),
                Value("mode before", before),
            )


def _flight(turn: Turn) -> None:
    """Follow the flight: armed, airborne, down. Unknown changes nothing."""
    state = turn.state
    if turn.down():
        if state.grounded_ns is None:
            turn.set(grounded_ns=turn.now)
        arming = (state.state, state.step) == (State.TAKEOFF, Step.ARMING)
        if state.in_flight and state.was_armed and not arming:
            turn.set(in_flight=False)
        return
    over = not state.in_flight and not turn.flies_again()  # unknown says nothing of a flight that is over
    if turn.on_ground():
        turn.set(grounded_ns=turn.now if state.grounded_ns is None else state.grounded_ns)
    else:
        turn.set(grounded_ns=state.grounded_ns if over else None, disarm_sent_ns=None)
    if state.in_flight and turn.armed():
        turn.set(was_armed=True)
    if turn.vehicle() is not None and _goes_on(turn):
        turn.set(in_flight=True)  # it had said that it was down, and does not any more: then its flight is not over
    if turn.state.in_flight and turn.airborne():
        turn.set(was_airborne=True, was_armed=True, flown=True)


def _goes_on(turn: Turn) -> bool:
    """Return True where a flight that seemed over goes on as ours; elsewhere, who is armed is in other hands."""
    state = turn.state
    if state.state is State.LAND:
        return state.was_armed
    flies = state.state in (State.TAKEOFF, State.HOLD) or (state.state, state.step) == (State.MISSION, Step.FLYING)
    return flies and turn.airborne() and turn.flies_again() and not turn.armed()


def _landed_status(turn: Turn, event: LandedStatus) -> None:
    if _credible(turn, event.age_ns):
        turn.set(landing=event, landing_ns=turn.now)


_ABSORB: Dict[Type[Event], Callable[..., None]] = {
    AutopilotStatus: _autopilot_status,
    CheckReply: _check_reply,
    EngineStarted: _engine_started,
    LandedStatus: _landed_status,
    MissionStatus: _mission_status,
    RecordingStatus: _recording_status,
    Reply: _reply,
    Shutdown: _shutdown,
    WatchdogAction: _watchdog_action,
    WatchdogInfo: _watchdog_info,
}
