"""What each event changes in what the engine knows. No decisions here: they follow from the facts afterwards.

Late and foreign messages end here: a reply to a request that is no longer current, a status of another session, one
that is too old or claims to come from the future, a heartbeat whose loop counter stands still.
"""

from __future__ import annotations

from typing import Callable, Dict, Iterable, Optional, Tuple, Type

from .checks import CHECKS
from .conditions import proves_recording
from .events import (
    AutopilotStatus,
    CheckReply,
    ClockStatus,
    ComponentStatus,
    EngineStarted,
    Event,
    LandedStatus,
    MissionPhase,
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
from .modes import DIRECT_MODES, HOLDING_MODES, MODES, ours
from .severity import Code
from .state import Agreement, CheckRecord, ClockApart, State, Step, evolve
from .timers import check_limit_ns
from .turn import Turn

__all__ = ["absorb"]

_NS = 1_000_000_000
_WATCHDOGS = 4  # whose loop counters are remembered
_AFTER_FLIGHT = (State.DATA_CLEANUP, State.OUTREACH)


def absorb(turn: Turn) -> None:
    """Put what the event says into the state."""
    turn.set(t_ns=turn.now)
    _expire_checks(turn)
    absorber = _ABSORB.get(type(turn.event))
    if absorber is not None:
        absorber(turn, turn.event)


def _expire_checks(turn: Turn) -> None:
    """Close the checks that were not answered in time; a late answer is taken if it comes before anything else."""
    state, event = turn.state, turn.event
    answered = event.command_id if isinstance(event, CheckReply) else None
    late = [
        record
        for record in state.checks
        if record.outcome is None
        and record.command_id != answered
        and turn.now >= record.asked_ns + check_limit_ns(state, turn.rules, record.check)
    ]
    if late:
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


def _credible(turn: Turn, peer: str, age_ns: int) -> bool:
    """Return whether a status is of the present; remember whose stamps are not: their clock is another one."""
    credible = turn.limits.is_present(age_ns)
    apart = turn.state.clocks_apart
    if not credible or apart:
        since_ns = next((each.since_ns for each in apart if each.peer == peer), turn.now)
        others = tuple(each for each in apart if each.peer != peer)
        turn.set(clocks_apart=others if credible else (*others, ClockApart(peer, age_ns, since_ns)))
    return credible


def _follow(old: Optional[Agreement], now_ns: int, *, says: bool) -> Optional[Agreement]:
    """Count a status that says something, or none of it."""
    if not says:
        return None
    return Agreement(now_ns, now_ns) if old is None else Agreement(old.since_ns, now_ns, 2)


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
    turn.set(down=None, aloft=None, motors=None, moving_ns=None, takeover=None, clocks_apart=(), clock_stalled_s=0.0)
    if state.in_flight or state.state is not State.MISSION_INPUT:
        turn.notify("resumed", state=state.state.value)


def _shutdown(turn: Turn, event: Shutdown) -> None:
    turn.set(shutting_down=True, signal=event.signal)


def _clock_status(turn: Turn, event: ClockStatus) -> None:
    stands, stood = (
        each * _NS > turn.limits.clock_stall_limit_ns for each in (event.stalled_s, turn.state.clock_stalled_s)
    )
    turn.set(clock_stalled_s=event.stalled_s)
    if stands != stood and not turn.state.in_flight:
        turn.notify("clock_stands" if stands else "clock_runs", stalled_s=event.stalled_s)


def _watchdog_action(turn: Turn, event: WatchdogAction) -> None:
    if not _credible(turn, "watchdog", event.age_ns):
        return
    _heartbeat(turn, event)
    listed = _worst_by_name(_listed(event))
    kept = [s for s in turn.state.components if s.name not in listed and s.code < Code.INCONVENIENT]
    turn.set(action=event, components=tuple(sorted([*kept, *listed.values()], key=_by_name)))


def _heartbeat(turn: Turn, event: WatchdogAction) -> None:
    """Take a loop counter that has grown for a heartbeat: each publisher's own, so that two do not keep one alive."""
    known = dict(turn.state.loop_counters)
    before = known.pop(event.publisher, None)
    if before is None or event.loop_counter != before:
        others = tuple(known.items())[1 - _WATCHDOGS :]
        turn.set(loop_counters=(*others, (event.publisher, event.loop_counter)))
    if event.loop_counter > before if before is not None else not known:
        turn.set(heartbeat_ns=turn.now)


def _listed(event: WatchdogAction) -> Tuple[ComponentStatus, ...]:
    """Return the components at 4 or above; a legacy watchdog may say only a code and the latest component."""
    if event.code < Code.INCONVENIENT or any(status.code >= event.code for status in event.components):
        return event.components
    name = event.latest_component or "unnamed component"
    others = tuple(status for status in event.components if status.name != name)
    return (*others, ComponentStatus(name=name, code=event.code, reason="the watchdog says so"))


def _watchdog_info(turn: Turn, event: WatchdogInfo) -> None:
    """Take what is below 4 from the info stream; what is at 4 or above is the action stream's to say."""
    if not _credible(turn, "watchdog", event.age_ns):
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
    watches = CHECKS[event.check].watches
    lacks = lacking(turn.state.mission, event.components) if watches else None
    if answered.ok and lacks is not None:
        answered = evolve(
            answered, ok=False, message=f"{lacks.name} is at code {int(lacks.code)}, although it says ready"
        )
    turn.set(checks=tuple(answered if r is current[0] else r for r in records))
    if watches and event.outcome is Outcome.ACCEPTED and turn.state.watchdog_started_ns is None:
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
    if event.session_id == turn.state.session_id and event.session_id and _credible(turn, "planner", event.age_ns):
        turn.set(planner=event, planner_ns=turn.now)
        if turn.state.takeover is not None and turn.state.autopilot is not None:
            _control(turn, turn.state.autopilot, again=True)  # a landing mode is the planner's when it says so


def _recording_status(turn: Turn, event: RecordingStatus) -> None:
    if event.session_id != turn.state.session_id or not event.session_id:
        return
    if not _credible(turn, "recorder", event.age_ns):
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


def _autopilot_status(turn: Turn, event: AutopilotStatus) -> None:
    if not _credible(turn, "autopilot", event.age_ns):
        return
    state, now = turn.state, turn.now
    speed = event.vertical_speed_m_s
    descending = speed is not None and speed <= -turn.limits.descent_speed_m_s
    moving = _moves(turn, event)
    first = state.armed_at_start is None and state.started_ns is not None
    turn.set(
        autopilot=event,
        autopilot_ns=now,
        battery_ns=_battery_known_ns(event, now, state.battery_ns),
        position_ns=state.position_ns if None in (event.height_m, event.position_x_m, event.position_y_m) else now,
        descending_ns=(now if state.descending_ns is None else state.descending_ns) if descending else None,
        moving_ns=(now if state.moving_ns is None else state.moving_ns) if moving else None,
        armed_at_start=event.armed if first else state.armed_at_start,
    )
    _flight(turn)
    _command_shown(turn, event)
    _control(turn, event)


def _battery_known_ns(event: AutopilotStatus, now_ns: int, before_ns: Optional[int]) -> Optional[int]:
    """Return when the battery's level was last known."""
    if event.battery_fraction is None or event.battery_age_s is None or not event.battery_age_s >= 0:
        return before_ns
    return max(0, now_ns - int(event.battery_age_s * _NS))


def _control(turn: Turn, event: AutopilotStatus, *, again: bool = False) -> None:
    """Note who has control by a status, or by the same one again in another light."""
    reason, before = _taken_by(turn, event), turn.state.takeover
    if again and reason:
        return
    agreed = _follow(before, turn.now, says=bool(reason))
    if agreed is not before:
        turn.set(takeover=agreed, takeover_reason=reason)


def _moves(turn: Turn, event: AutopilotStatus) -> bool:
    """Return True when neither the flight mode nor the speed over ground shows a hold; unknown speed shows nothing."""
    speed = event.horizontal_speed_m_s
    return event.mode not in HOLDING_MODES and speed is not None and speed > turn.limits.hold_speed_m_s


def _command_shown(turn: Turn, event: AutopilotStatus) -> None:
    """Take a mode that answers the last command in two statuses for its confirmation: what was before is over."""
    state = turn.state
    answers = bool(state.commanded) and state.in_flight and event.armed is not False
    shown = answers and event.mode in MODES[state.commanded[-1]]
    if shown and state.mode_shown:
        turn.set(confirmed=state.commanded[-1], commanded=state.commanded[-1:])
    if shown != state.mode_shown:
        turn.set(mode_shown=shown)


def _taken_by(turn: Turn, event: AutopilotStatus) -> str:
    """Return why somebody else than us has control of the vehicle (rule 4); empty when nobody has."""
    state = turn.state
    if event.armed is False:
        return ""
    if event.pilot_in_control:
        return "the pilot has control"
    last = state.commanded[-1] if state.commanded else state.confirmed
    direct = DIRECT_MODES[last] if last is not None and state.in_flight else frozenset()
    if event.failsafe and event.mode not in direct:
        return "a failsafe of the autopilot is active"
    if not state.in_flight:
        if (
            turn.airborne()
            and state.was_airborne
            and state.state in _AFTER_FLIGHT
            and _is_ours(turn, event, lands=True)
        ):
            return ""  # it never landed: see the row still_flying
        if turn.may_arm_late() and _is_ours(turn, event, lands=False):
            return ""  # see the row armed_late
        at_start = state.sessions == 0 and state.armed_at_start is not False
        return "it was armed, and not by us" if event.armed and not at_start else ""
    if _is_ours(turn, event, lands=_planner_lands(turn)):
        return ""
    unchanged = state.confirmed is None and event.mode == state.mode_before  # nothing has answered yet
    return "" if unchanged else f"flight mode {event.mode} was not commanded"


def _is_ours(turn: Turn, event: AutopilotStatus, *, lands: bool) -> bool:
    return ours(event.mode, turn.state.commanded, turn.state.confirmed, lands=lands)


def _planner_lands(turn: Turn) -> bool:
    """Return True when the planner lands by itself; right after a restart of ours it was not heard yet."""
    planner = turn.state.planner
    return planner is None or planner.phase in (MissionPhase.LANDING, MissionPhase.LANDED)


def _flight(turn: Turn) -> None:
    """Follow the flight: armed, airborne, down; each is believed from statuses that agree. Unknown changes nothing."""
    state = turn.state
    turn.set(
        down=_follow(state.down, turn.now, says=turn.down()),
        aloft=_follow(state.aloft, turn.now, says=turn.airborne()),
        motors=_follow(state.motors, turn.now, says=turn.armed()),
    )
    if turn.down():
        if state.grounded_ns is None:
            turn.set(grounded_ns=turn.now)
        arming = (state.state, state.step) == (State.TAKEOFF, Step.ARMING)
        if state.in_flight and state.was_armed and not arming and turn.stays_down():
            turn.set(in_flight=False)
        return
    over = not state.in_flight and not turn.flies_again()  # unknown says nothing of a flight that is over
    if turn.on_ground():
        if state.grounded_ns is None:
            turn.set(grounded_ns=turn.now)
    elif state.disarm_sent_ns is not None or (state.grounded_ns is not None and not over):
        turn.set(grounded_ns=state.grounded_ns if over else None, disarm_sent_ns=None)
    if not state.in_flight and turn.vehicle() is not None and _goes_on(turn):
        turn.set(in_flight=True)  # it had said that it was down, and does not any more: then its flight is not over
    if turn.state.in_flight:
        _remember_flight(turn)


def _remember_flight(turn: Turn) -> None:
    """Remember that it was armed, and that it flew, for the rest of the flight."""
    state = turn.state
    armed, airborne = (each is not None and each.statuses > 1 for each in (state.motors, state.aloft))
    if airborne and not (state.was_airborne and state.was_armed and state.flown):
        turn.set(was_airborne=True, was_armed=True, flown=True)
    elif armed and not state.was_armed:
        turn.set(was_armed=True)


def _goes_on(turn: Turn) -> bool:
    """Return True where a flight that seemed over goes on as ours: nobody arms a vehicle in the air."""
    state = turn.state
    if state.state is State.LAND:
        return state.was_armed
    flies = state.state in (State.TAKEOFF, State.HOLD) or (state.state, state.step) == (State.MISSION, Step.FLYING)
    return flies and state.was_armed and turn.airborne() and turn.flies_again()


def _landed_status(turn: Turn, event: LandedStatus) -> None:
    if _credible(turn, "landing detection", event.age_ns):
        turn.set(landing=event, landing_ns=turn.now)


_ABSORB: Dict[Type[Event], Callable[..., None]] = {
    AutopilotStatus: _autopilot_status,
    CheckReply: _check_reply,
    ClockStatus: _clock_status,
    EngineStarted: _engine_started,
    LandedStatus: _landed_status,
    MissionStatus: _mission_status,
    RecordingStatus: _recording_status,
    Reply: _reply,
    Shutdown: _shutdown,
    WatchdogAction: _watchdog_action,
    WatchdogInfo: _watchdog_info,
}
