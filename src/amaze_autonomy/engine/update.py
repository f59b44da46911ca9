"""What each event changes in what the engine knows. No decisions here: they follow from the facts afterwards.

Late and foreign messages end here: a reply to a request that is no longer current, a status of another session, one
that is too old or claims to come from the future, a heartbeat whose loop counter stands still.
"""

from __future__ import annotations

from typing import Callable, Dict, Iterable, Optional, Tuple, Type, Union

from .context import (
    FLYING_MODES,
    HOLDING_MODES,
    LANDING_MODES,
    MISSION_MODE,
    SET_POINT_MODE,
    Context,
    fast,
    is_further,
    ours,
    says_nothing,
)
from .events import (
    CHECKS,
    AutopilotStatus,
    CheckReply,
    ClockStatus,
    ComponentStatus,
    EngineStarted,
    Event,
    LandedStatus,
    Mission,
    MissionPhase,
    MissionStatus,
    Outcome,
    RecordingPhase,
    RecordingStatus,
    Reply,
    Shutdown,
    Tick,
    VehicleLanded,
    WatchdogAction,
    WatchdogInfo,
)
from .failsafe import proves_recording
from .rules import Code
from .state import Agreement, Asked, CheckRecord, ClockApart, State, Step, Vehicle, evolve
from .timers import check_limit_ns

_NS = 1_000_000_000
_WATCHDOGS = 4  # whose loop counters are remembered
_GROWTHS = 2
"""So often in a row a loop counter grows before it is believed again that has fallen: a restart costs one beat more."""
_AFTER_FLIGHT = (State.DATA_CLEANUP, State.OUTREACH, State.MISSION_ENDED)
_ENDED = (
    RecordingPhase.STOPPING,
    RecordingPhase.RECOVERING,
    RecordingPhase.TRANSFERRING,
    RecordingPhase.MERGING,
    RecordingPhase.VERIFYING,
    RecordingPhase.COMPLETE,
)
_IDLE = (MissionPhase.IDLE, MissionPhase.LOADED, MissionPhase.LANDED)


def update(context: Context) -> None:
    """Put what the event says into the state."""
    if isinstance(context.event, (EngineStarted, Tick)):
        _leave_to_a_person(context, context.event)
    context.set(t_ns=context.now)
    _expire_checks(context)
    take = _UPDATES.get(type(context.event))
    if take is not None:
        take(context, context.event)


def _expire_checks(context: Context) -> None:
    """Close the checks that were not answered in time; a late answer is taken if it comes before anything else."""
    state, event = context.state, context.event
    answered = event.command_id if isinstance(event, CheckReply) else None
    late = [
        record
        for record in state.preflight.checks
        if record.outcome is None
        and record.command_id != answered
        and context.now >= record.asked_ns + check_limit_ns(state, context.rules, record.check)
    ]
    if late:
        context.put(
            "preflight", checks=tuple(_timed_out(r, context.now) if r in late else r for r in state.preflight.checks)
        )


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


def _credible(context: Context, peer: str, age_ns: int) -> bool:
    """Return whether a status is of the present; remember whose stamps are not: their clock is another one."""
    credible = context.limits.is_present(age_ns)
    apart = context.state.peers.clocks_apart
    if not credible or apart:
        since_ns = next((each.since_ns for each in apart if each.peer == peer), context.now)
        others = tuple(each for each in apart if each.peer != peer)
        context.put("peers", clocks_apart=others if credible else (*others, ClockApart(peer, age_ns, since_ns)))
    return credible


def _follow(old: Optional[Agreement], now_ns: int, *, says: bool) -> Optional[Agreement]:
    """Count a status that says something, or none of it."""
    if not says:
        return None
    return Agreement(now_ns, now_ns) if old is None else Agreement(old.since_ns, now_ns, 2)


def _leave_to_a_person(context: Context, event: Union[EngineStarted, Tick]) -> None:
    """Leave to a person what else is flown, where the engine was told to end, or was away for long."""
    state, away_ns, told_to_end = context.state, event.away_ns, False
    if isinstance(event, EngineStarted) and event.resumed:
        away_ns, told_to_end = max(away_ns, context.now - state.t_ns), state.shutting_down
    if told_to_end or away_ns > context.limits.ready_limit_ns:
        context.put("preflight", away=True)
        context.drop_queue()


def _engine_started(context: Context, event: EngineStarted) -> None:
    state = context.state
    if not state.flight.active:
        context.signal = ""  # it was meant for the process before; where that flew, it is landed
        context.set(signal="")
    armed = state.armed_at_start if state.sessions or state.state is not State.MISSION_INPUT else None
    context.set(label=event.label, started_ns=context.now, armed_at_start=armed, shutting_down=False)
    if not event.resumed:
        return
    last_ns = state.peers.autopilot_ns
    _may_have_flown(context, armed=last_ns is None or context.now - last_ns > context.limits.autopilot_status_limit_ns)
    context.set(vehicle=Vehicle(), peers=state.peers.after_restart(context.now))
    context.put("flight", mode_shown="")
    if state.state in (State.TAKEOFF, State.HOLD):  # its limits are those of silence, too
        context.set(step_ns=context.now)
    if state.state is State.LAND:  # it was commanded, and is again once it was heard who has control
        context.put("landing", sent_ns=context.now)
    context.put("recording", since_ns=None)
    _forget_ground(context)
    if context.state.flight.grounded_ns is not None:  # whose planner may have said meanwhile that it landed
        context.put("flight", grounded_ns=context.now)
        context.put("landing", disarm_sent_ns=None)
    if state.flight.active or state.state is not State.MISSION_INPUT:
        context.notify("resumed", state=state.state.value)


def _shutdown(context: Context, event: Shutdown) -> None:
    context.set(shutting_down=True, signal=event.signal)


def _clock_status(context: Context, event: ClockStatus) -> None:
    stands, stood = (
        each * _NS > context.limits.clock_stall_limit_ns
        for each in (event.stalled_s, context.state.peers.clock_stalled_s)
    )
    context.put("peers", clock_stalled_s=event.stalled_s)
    if stands != stood and not context.state.flight.active:
        context.notify("clock_stands" if stands else "clock_runs", stalled_s=event.stalled_s)


def _watchdog_action(context: Context, event: WatchdogAction) -> None:
    if not _credible(context, "watchdog", event.age_ns):
        return
    _heartbeat(context, event)
    listed = _worst_by_name(_listed(event))
    kept = [s for s in context.state.peers.components if s.name not in listed and s.code < Code.INCONVENIENT]
    context.put("peers", action=event, components=tuple(sorted([*kept, *listed.values()], key=_by_name)))


def _heartbeat(context: Context, event: WatchdogAction) -> None:
    """Take a loop counter that has grown for a heartbeat: each publisher's own, so that two do not keep one alive.

    Two of them behind one name rise and fall: one that has fallen grows twice in a row before it is believed again.
    """
    known = context.state.peers.loop_counters
    others = tuple(each for each in known if each[0] != event.publisher)
    begins = 1 if others else _GROWTHS
    before, growths = next((each[1:] for each in known if each[0] == event.publisher), (None, begins))
    if before == event.loop_counter:
        return
    if before is not None:
        growths = min(growths + 1, _GROWTHS) if event.loop_counter > before else 0
    entry = (event.publisher, event.loop_counter, growths)
    context.put("peers", loop_counters=(*others[1 - _WATCHDOGS :], entry))
    if growths >= _GROWTHS:
        context.put("peers", heartbeat_ns=context.now)


def _listed(event: WatchdogAction) -> Tuple[ComponentStatus, ...]:
    """Return the components at 4 or above; a legacy watchdog may say only a code and the latest component."""
    if event.code < Code.INCONVENIENT or any(status.code >= event.code for status in event.components):
        return event.components
    name = event.latest_component or "unnamed component"
    others = tuple(status for status in event.components if status.name != name)
    return (*others, ComponentStatus(name=name, code=event.code, reason="the watchdog says so"))


def _watchdog_info(context: Context, event: WatchdogInfo) -> None:
    """Take what is below 4 from the info stream; what is at 4 or above is the action stream's to say."""
    if not _credible(context, "watchdog", event.age_ns):
        return
    acted = {s.name: s for s in context.state.peers.components if s.code >= Code.INCONVENIENT}
    informed = _worst_by_name(
        s for s in event.components if s.code < Code.INCONVENIENT and s.name not in acted
    ).values()
    context.put("peers", components=tuple(sorted([*acted.values(), *informed], key=_by_name)))


def _worst_by_name(statuses: Iterable[ComponentStatus]) -> Dict[str, ComponentStatus]:
    """Return one status for each name: of those that are listed twice the worst."""
    found: Dict[str, ComponentStatus] = {}
    for status in statuses:
        if status.name not in found or status.code > found[status.name].code:
            found[status.name] = status
    return found


def _by_name(status: ComponentStatus) -> str:
    return status.name


def _check_reply(context: Context, event: CheckReply) -> None:
    records = context.state.preflight.checks
    current = [r for r in records if r.check is event.check and r.command_id == event.command_id and r.outcome is None]
    if not current:
        return
    answered = answer_of(current[0], event, context.now)
    watches = CHECKS[event.check].watches
    if answered.ok and watches:
        lacks = _disproves(context.state.session.mission, event)
        answered = evolve(answered, ok=not lacks, message=lacks or answered.message)
    context.put("preflight", checks=tuple(answered if r is current[0] else r for r in records))
    if watches and event.outcome is Outcome.ACCEPTED and context.state.peers.watchdog_started_ns is None:
        context.put("peers", watchdog_started_ns=context.now)


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


def _disproves(mission: Optional[Mission], event: CheckReply) -> str:
    """Return what contradicts a watchdog that says ready, or is missing in what it lists; empty: nothing."""
    lacks = lacking(mission, event.components)
    if lacks is not None:
        return f"{lacks.name} is at code {int(lacks.code)}, although it says ready"
    listed = {each.name for each in event.components} | {each.name for each in event.checks}
    unlisted = [name for name in (mission.required if mission is not None else ()) if name not in listed]
    return f"{', '.join(unlisted)}: required, and not among what the watchdog lists" if unlisted else ""


def lacking(mission: Optional[Mission], components: Tuple[ComponentStatus, ...]) -> Optional[ComponentStatus]:
    """Return the first required component that is neither at code 1 nor, tolerated, at code 2."""
    required, tolerated = (mission.required, mission.tolerated) if mission is not None else ((), ())
    for status in components:
        needed = not required or status.name in required
        accepted = status.code == Code.NOMINAL or (status.code == Code.NON_CRITICAL and status.name in tolerated)
        if needed and not accepted:
            return status
    return None


def _reply(context: Context, event: Reply) -> None:
    """Take the answer to the last request of a kind; the id says which."""
    for part, name in (("flight", "motion"), ("preflight", "load"), ("recording", "request")):
        asked: Asked = getattr(getattr(context.state, part), name)
        if asked.id == event.command_id:
            context.put(part, **{name: evolve(asked, outcome=event.outcome, message=event.message)})
            return


def _mission_status(context: Context, event: MissionStatus) -> None:
    credible = _credible(context, "planner", event.age_ns)  # of another session too: its clock may be right again
    if event.session_id == context.state.session.id and event.session_id and credible:
        context.put("peers", planner=event, planner_ns=context.now)
        _planner_leads(context)
        if context.state.flight.active and context.planner_flew():
            context.put("session", flown=True)
        if context.state.vehicle.takeover is not None and context.state.peers.autopilot is not None:
            # a landing mode is the planner's when it says so
            _control(context, context.state.peers.autopilot, again=True)


def _recording_status(context: Context, event: RecordingStatus) -> None:
    credible = _credible(context, "recorder", event.age_ns)  # of another session too: its clock may be right again
    if not credible or event.session_id != context.state.session.id or not event.session_id:
        return
    recording = context.state.recording
    context.put("peers", recorder=event, recorder_ns=context.now)
    context.put(
        "recording",
        since_ns=_since(recording.since_ns, context.now, says=proves_recording(event)),
        location=event.location or recording.location,
        progressed=recording.progressed or event.phase is not RecordingPhase.FAILED,
    )


def _autopilot_status(context: Context, event: AutopilotStatus) -> None:
    if not _credible(context, "autopilot", event.age_ns):
        return
    _after_silence(context)
    peers, vehicle, now = context.state.peers, context.state.vehicle, context.now
    contradicts = event.armed is False and event.landed is not VehicleLanded.ON_GROUND  # it flies, or it is disarmed
    speed = event.vertical_speed_m_s
    descending = speed is not None and speed <= -context.limits.descent_speed_m_s
    known = None not in (event.height_m, event.position_x_m, event.position_y_m, event.tilt_deg)
    context.put(
        "peers",
        autopilot=event,
        autopilot_ns=now,
        vehicle_unknown_ns=_since(peers.vehicle_unknown_ns, now, says=says_nothing(event) or contradicts),
        armed_unknown_ns=_since(peers.armed_unknown_ns, now, says=event.armed is None),
        battery_ns=_battery_known_ns(event, now, peers.battery_ns),
        position_ns=now if known else peers.position_ns,
    )
    context.put(
        "vehicle",
        descending_ns=_since(vehicle.descending_ns, now, says=descending),
        moving_ns=_since(vehicle.moving_ns, now, says=_moves(context, event)),
        adrift_ns=_since(vehicle.adrift_ns, now, says=_adrift(context, event)),
    )
    if context.vehicle() is None:
        _may_have_flown(context, armed=vehicle.motors is not None or context.state.flight.was_armed)
    _contradicts(context)
    _flight(context)
    _armed_at_start(context)
    _planner_leads(context)
    _command_shown(context, event)
    _control(context, event)


def _after_silence(context: Context) -> None:
    """Forget what its statuses agreed on where it was silent meanwhile: two lies far apart disarm and land nobody.

    Nor did it stand on the ground before it flew, as far as anybody knows: a flight that was given up goes on.
    """
    state = context.state
    silent = state.peers.autopilot_ns is None or context.now - state.peers.autopilot_ns > (
        context.limits.autopilot_status_limit_ns
    )
    if silent:
        _may_have_flown(context, armed=state.vehicle.motors is not None or state.flight.was_armed)
        _forget_ground(context)
        context.put("vehicle", down=None, aloft=None, motors=None, disarmed=None, spinning=None)


def _may_have_flown(context: Context, *, armed: bool) -> None:
    """Nobody can say that it was not flown, where it was not heard for so long in a flight, and may have been armed."""
    if context.state.flight.active and armed:
        context.put("session", flown=True)


def _contradicts(context: Context) -> None:
    if context.seems_to_fly():
        context.put("vehicle", contradicted_ns=context.now)


def _forget_ground(context: Context) -> None:
    if context.state.flight.active and context.state.flight.grounded_ns is not None:
        context.put("flight", grounded_ns=None)
        context.put("landing", disarm_sent_ns=None)


def _armed_at_start(context: Context) -> None:
    """Note whether it was armed when the engine began, and since: what two statuses in a row say that agree."""
    state = context.state
    if state.armed_at_start is False or state.started_ns is None:
        return
    for agreed, says in ((state.vehicle.motors, True), (state.vehicle.disarmed, False)):
        if agreed is not None and agreed.statuses > 1 and state.armed_at_start is not says:
            context.set(armed_at_start=says)


def _planner_leads(context: Context) -> None:
    """Note since when nobody leads a vehicle in the air.

    The planner says that nothing is flown, that it holds unasked, or that it lands, and it stands there.
    """
    state, peers = context.state, context.state.peers
    phases = (*_IDLE, MissionPhase.HOLDING) if (state.state, state.step) == (State.MISSION, Step.FLYING) else _IDLE
    phase = peers.planner.phase if peers.planner is not None and context.armed() and context.airborne() else None
    stalls = phase is MissionPhase.LANDING and _stands_still(context)
    since = {
        "planner_idle_ns": _since(peers.planner_idle_ns, context.now, says=phase in phases),
        "landing_stalled_ns": _since(peers.landing_stalled_ns, context.now, says=stalls),
    }
    if any(getattr(peers, name) != since_ns for name, since_ns in since.items()):
        context.put("peers", **since)


def _stands_still(context: Context) -> bool:
    """Return True when it neither sinks nor moves for longer than a gust lasts; in a landing mode it must sink."""
    status, vehicle = context.vehicle(), context.state.vehicle
    if status is None:
        return False
    lands = status.mode in LANDING_MODES
    if not lands and None in (status.vertical_speed_m_s, status.horizontal_speed_m_s):
        return False
    since = (vehicle.descending_ns, None if lands else vehicle.moving_ns)
    return all(each is None or context.now - each < context.limits.descent_time_ns for each in since)


def _since(since_ns: Optional[int], now_ns: int, *, says: bool) -> Optional[int]:
    """Return since when something is so."""
    return (now_ns if since_ns is None else since_ns) if says else None


def _battery_known_ns(event: AutopilotStatus, now_ns: int, before_ns: Optional[int]) -> Optional[int]:
    """Return when the battery's level was last known."""
    if event.battery_fraction is None or event.battery_age_s is None or not event.battery_age_s >= 0:
        return before_ns
    return max(0, now_ns - int(event.battery_age_s * _NS))


def _control(context: Context, event: AutopilotStatus, *, again: bool = False) -> None:
    """Note who has control by a status, or by the same one again in another light; an old one denies nothing."""
    reason, before = _taken_by(context, event), context.state.vehicle.takeover
    disarmed = context.state.vehicle.disarmed
    once = context.state.flight.active and disarmed is not None and disarmed.statuses == 1
    old = not reason and context.vehicle() is None
    if old or (again and reason) or (once and before is not None and before.statuses > 1):
        return  # a single disarmed status in flight does not deny what two have said
    agreed = _follow(before, context.now, says=bool(reason))
    if agreed is not before:
        context.put("vehicle", takeover=agreed, takeover_reason=reason)


def _moves(context: Context, event: AutopilotStatus) -> bool:
    """Return True when neither the flight mode nor the speed over ground shows a hold; unknown speed shows nothing."""
    speed = event.horizontal_speed_m_s
    return event.mode not in HOLDING_MODES and speed is not None and speed > context.limits.hold_speed_m_s


def _adrift(context: Context, event: AutopilotStatus) -> bool:
    """Return True when the flight mode shows no hold, and it moves, or climbs or sinks, too fast for one."""
    return event.mode not in HOLDING_MODES and bool(fast(event, context.limits.hold_speed_m_s))


def _command_shown(context: Context, event: AutopilotStatus) -> None:
    """Take a mode that answers the last command in two statuses for its confirmation: what was before is over."""
    state = context.state
    answers = bool(state.flight.commanded) and state.flight.active and event.armed is not False
    shown = event.mode if answers and event.mode in context.modes[state.flight.commanded[-1]] else ""
    if shown and state.flight.mode_shown:
        context.put("flight", confirmed=state.flight.commanded[-1], commanded=state.flight.commanded[-1:])
    rises = state.state in (State.TAKEOFF, State.MISSION)
    flies = rises and context.airborne()  # on the ground it may be the mode of before
    if flies and shown == state.flight.mode_shown and is_further(shown, state.flight.mode_flown):
        context.put("flight", mode_flown=shown)
        if is_further(shown, state.flight.flown_by) and shown in (SET_POINT_MODE, MISSION_MODE):
            context.put("flight", flown_by=shown)
    if shown != state.flight.mode_shown:
        context.put("flight", mode_shown=shown)


def _taken_by(context: Context, event: AutopilotStatus) -> str:
    """Return why somebody else than us has control of the vehicle (rule 4); empty when nobody has."""
    state = context.state
    if event.armed is False:
        return ""
    if event.pilot_in_control:
        return f"the pilot flies (flight mode {event.mode})"
    if event.failsafe and not _is_asked_for(context, event):
        return "a failsafe of the autopilot is active"
    if not state.flight.active:
        after = state.state in _AFTER_FLIGHT or state.step is Step.TOUCHDOWN
        mine = _is_ours(context, event, lands=True) or _unchanged(context, event)
        if after and context.never_landed() and mine:
            return ""  # it never landed: see the row still_flying
        if context.may_arm_late() and _is_ours(context, event, lands=False):
            return ""  # see the row armed_late
        return "armed by somebody else" if event.armed and state.armed_at_start is False else ""
    mine = _is_ours(context, event, lands=_planner_lands(context)) or _unchanged(context, event)
    return "" if mine else f"flight mode {event.mode} was not commanded"


def _is_asked_for(context: Context, event: AutopilotStatus) -> bool:
    """Return True in a mode that no failsafe has chosen, whatever its flag says.

    It is one that one of our commands leads to by itself (until it shows, the one before is ours too); the planner's
    own landing; one that no failsafe chooses; or that in which an ARM of ours takes effect late, on the ground.
    """
    flight, planner, mode = context.state.flight, context.state.peers.planner, event.mode
    if not flight.active:
        late = context.may_arm_late() and not context.airborne() and _is_ours(context, event, lands=False)
        return late or mode in FLYING_MODES
    lands = planner is not None and planner.phase is MissionPhase.LANDING and mode in LANDING_MODES
    asked = flight.commanded or ((flight.confirmed,) if flight.confirmed is not None else ())
    return lands or any(mode in context.direct_modes[action] for action in asked)


def _unchanged(context: Context, event: AutopilotStatus) -> bool:
    """Return True while it is in the mode of before our commands, and nothing has answered them yet."""
    flight = context.state.flight
    return flight.confirmed is None and event.mode == flight.mode_before


def _is_ours(context: Context, event: AutopilotStatus, *, lands: bool) -> bool:
    flight = context.state.flight
    return ours(event.mode, flight.commanded, flight.confirmed, flight.mode_flown, lands=lands, modes=context.modes)


def _planner_lands(context: Context) -> bool:
    """Return True when the planner lands by itself; right after a restart of ours it was not heard yet."""
    return context.state.peers.planner is None or context.planner_lands()


def _flight(context: Context) -> None:
    """Follow the flight: armed, airborne, down; each is believed from statuses that agree. Unknown changes nothing."""
    state = context.state
    context.put(
        "vehicle",
        down=_follow(state.vehicle.down, context.now, says=context.down()),
        aloft=_follow(state.vehicle.aloft, context.now, says=context.airborne()),
        motors=_follow(state.vehicle.motors, context.now, says=context.armed()),
        disarmed=_follow(state.vehicle.disarmed, context.now, says=context.disarmed()),
        spinning=_follow(state.vehicle.spinning, context.now, says=context.armed() and context.on_ground()),
    )
    if context.down():
        if state.flight.grounded_ns is None:
            context.put("flight", grounded_ns=context.now)
        arming = (state.state, state.step) == (State.TAKEOFF, Step.ARMING)
        if state.flight.active and state.flight.was_armed and not arming and context.stays_down():
            context.put("flight", active=False)
        _another(context)
        return
    goes_on = not state.flight.active and context.vehicle() is not None and _goes_on(context)
    flies = context.flies_again() and context.airborne()  # unknown says nothing of a flight that is over
    over = not (state.flight.active or goes_on or flies)
    if context.on_ground():
        if state.flight.grounded_ns is None:
            context.put("flight", grounded_ns=context.now)
    elif state.landing.disarm_sent_ns is not None or (state.flight.grounded_ns is not None and not over):
        context.put("flight", grounded_ns=state.flight.grounded_ns if over else None)
        context.put("landing", disarm_sent_ns=None)
    if goes_on:  # it had said that it was down, and does not any more: then its flight is not over
        context.put("flight", active=True)
    _another(context)
    if context.state.flight.active:
        _remember_flight(context)


def _another(context: Context) -> None:
    """Remember that our flight is over for good: armed on the ground after it, or it has stood there for long.

    What flies then is somebody else's, even where nobody heard how it was armed.
    """
    flight, motors, down = context.state.flight, context.state.vehicle.motors, context.state.vehicle.down
    armed = motors is not None and motors.statuses > 1 and context.armed() and context.on_ground()
    stood = down is not None and down.lasts(context.limits.confirm_limit_ns) and not context.seems_to_fly()
    if (armed or stood) and not flight.active and not flight.another:
        context.put("flight", another=True)


def _remember_flight(context: Context) -> None:
    """Remember that it was armed, and that it flew, for the rest of the flight."""
    state = context.state
    armed, airborne = (each is not None and each.statuses > 1 for each in (state.vehicle.motors, state.vehicle.aloft))
    if airborne and not (state.flight.was_airborne and state.flight.was_armed and state.session.flown):
        context.put("flight", was_airborne=True, was_armed=True)
        context.put("session", flown=True)
    elif armed and not state.flight.was_armed:
        context.put("flight", was_armed=True)
    recorder = state.peers.recorder
    if airborne and (state.recording.stopped or (recorder is not None and recorder.phase in _ENDED)):
        context.put("recording", flown_on=True)


def _goes_on(context: Context) -> bool:
    """Return True where a flight that seemed over goes on as ours: nobody arms a vehicle in the air."""
    state = context.state
    if state.state is State.LAND:
        return state.flight.was_armed
    flies = state.state in (State.TAKEOFF, State.HOLD) or (state.state, state.step) == (State.MISSION, Step.FLYING)
    return flies and state.flight.was_armed and context.airborne() and context.flies_again()


def _landed_status(context: Context, event: LandedStatus) -> None:
    if _credible(context, "landing detection", event.age_ns):
        context.put("peers", landing=event, landing_ns=context.now)
        _contradicts(context)


_UPDATES: Dict[Type[Event], Callable[..., None]] = {
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
