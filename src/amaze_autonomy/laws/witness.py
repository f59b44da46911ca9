"""The witness: what an outsider knows who sees every event and every command, and nothing of the engine's inside.

The laws judge by it. It is written from DESIGN.md alone and shares no code with the engine but the types of events and
commands: a stale reply that the engine believes, the witness does not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, NamedTuple, Optional, Tuple

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    Answer,
    AnswerKind,
    AutopilotDisarm,
    AutopilotLand,
    LoadMission,
    MissionAction,
    MissionCommand,
    Notify,
    Request,
    RunCheck,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.engine.state import EngineState, State, Step, evolve

_SECOND = 1_000_000_000
_FLIES = (ev.VehicleLanded.TAKING_OFF, ev.VehicleLanded.IN_AIR, ev.VehicleLanded.LANDING)
_FLIGHT = (State.TAKEOFF, State.MISSION, State.HOLD, State.LAND, State.PILOT)
_FLEW = (ev.MissionPhase.FLYING, ev.MissionPhase.HOLDING, ev.MissionPhase.LANDING, ev.MissionPhase.LANDED)
_ENDED = tuple(phase for phase in ev.RecordingPhase if phase.name not in ("IDLE", "STARTING", "RECORDING", "FAILED"))
_BEHIND = ("stopped", "named", "complete")  # what the recording is once it was told to end


class Asked(NamedTuple):
    """The last request of one check, and its answer."""

    id: int
    asked_ns: int
    answered_ns: Optional[int] = None
    ok: bool = False


class Load(NamedTuple):
    """The last LoadMission and its answer; `used`: a TAKEOFF was commanded on it."""

    id: int
    session: str
    mission: str
    leg: Tuple[int, int]
    outcome: Optional[ev.Outcome] = None
    used: bool = False


@dataclass(frozen=True)
class Witness:
    """What was seen. Times are those of the events; None: never."""

    now: int = 0
    vehicle: Optional[ev.AutopilotStatus] = None
    vehicle_ns: int = 0
    battery_ns: Optional[int] = None
    descending_ns: Optional[int] = None
    moving_ns: Optional[int] = None
    contradicted_ns: Optional[int] = None
    down_ns: Optional[int] = None
    foreign: bool = False
    ground_ns: Optional[int] = None
    taken: int = 0
    taken_ns: int = 0
    armed_late: int = 0
    rested: int = 0
    unarmed_ns: Optional[int] = None
    spinning_ns: Optional[int] = None
    mode_ns: int = 0
    detection: ev.Landed = ev.Landed.UNKNOWN
    detection_ns: int = 0
    beat_ns: Optional[int] = None
    counters: Tuple[Tuple[str, int, int], ...] = ()
    watching: bool = False
    planner: Optional[ev.MissionStatus] = None
    planner_ns: int = 0
    idle_ns: Optional[int] = None
    stalled_ns: Optional[int] = None
    unknown_ns: Optional[int] = None
    armed_unknown_ns: Optional[int] = None
    recorder: Optional[ev.RecordingStatus] = None
    recorder_ns: int = 0
    growing_ns: Optional[int] = None
    codes: Tuple[Tuple[str, int], ...] = ()
    given_up: Tuple[str, ...] = ()
    checks: Tuple[Tuple[str, Asked], ...] = ()
    load: Optional[Load] = None
    session: str = ""
    flight: str = "none"
    flight_ns: int = 0
    airborne: bool = False
    aloft: int = 0
    landing: bool = False
    land_ns: int = 0
    unseen_ns: Optional[int] = None
    sent_ns: int = 0
    second: bool = False
    second_ns: int = 0
    alarmed: bool = False
    alarms: Tuple[str, ...] = ()
    last_id: int = 0
    motion: Optional[MissionAction] = None
    motion_id: int = 0
    motion_ns: int = 0
    flown: str = ""
    flown_by: str = ""
    answered: bool = False
    mode_before: str = ""
    disarmed_ns: Optional[int] = None
    recording: str = "none"
    flown_on: bool = False
    flew: bool = False
    user_hold: bool = False
    waited: Tuple[Tuple[str, int], ...] = ()
    started_ns: int = 0
    shutting_down: bool = False
    unasked: bool = False
    stalled_s: float = 0.0

    # --- what it says of the vehicle ----------------------------------------------------------------------------------

    def fresh(self, limits: Limits) -> Optional[ev.AutopilotStatus]:
        """Return the vehicle's status when both stream and link are fresh, else None."""
        status = self.vehicle
        if status is None or status.link_age_s is None:
            return None
        age = self.now - self.vehicle_ns
        link = age + int(status.link_age_s * _SECOND)
        return status if age <= limits.autopilot_status_limit_ns and link <= limits.autopilot_link_limit_ns else None

    def is_down(self, limits: Limits) -> bool:
        """Return True when it says, freshly, disarmed and on the ground."""
        status = self.fresh(limits)
        return status is not None and status.armed is False and status.landed is ev.VehicleLanded.ON_GROUND

    def on_ground(self, limits: Limits) -> bool:
        """Return True when it says, freshly, that it stands on the ground."""
        status = self.fresh(limits)
        return status is not None and status.landed is ev.VehicleLanded.ON_GROUND

    def flies(self, limits: Limits) -> bool:
        """Return True when it says, freshly, that it has left the ground."""
        status = self.fresh(limits)
        return status is not None and status.landed in _FLIES

    def contradicts_ground(self, limits: Limits) -> bool:
        """Return True when landing detection or height contradicts that it stands on the ground."""
        status, detected = self.fresh(limits), self.detected(limits)
        high = status is not None and status.height_m is not None and status.height_m >= limits.takeoff_height_m
        return detected is ev.Landed.AIRBORNE or (high and detected is not ev.Landed.ON_GROUND)

    def contradicted(self, limits: Limits) -> bool:
        """Return True when something contradicts that it stands on the ground, or did a moment ago."""
        lately = self.contradicted_ns is not None and self.now - self.contradicted_ns < limits.ground_disarm_after_ns
        return lately or self.contradicts_ground(limits)

    def detected(self, limits: Limits) -> ev.Landed:
        """Return what the landing detection says, freshly."""
        return (
            self.detection if self.now - self.detection_ns <= limits.landing_detection_limit_ns else ev.Landed.UNKNOWN
        )

    def lands(self, limits: Limits) -> bool:
        """Return True when it is landing, whoever lands it."""
        status = self.fresh(limits)
        if self.planner is None or self.planner.phase in (ev.MissionPhase.LANDING, ev.MissionPhase.LANDED):
            return True  # right after a restart it was not heard yet
        if status is None:
            return False
        low = status.height_m is not None and abs(status.height_m) <= limits.landing_height_m
        sinks = self.descending_ns is not None and self.now - self.descending_ns >= limits.descent_time_ns
        return status.mode in _LANDING_MODES or status.landed is ev.VehicleLanded.LANDING or (low and sinks)

    def silent_ns(self) -> int:
        """Return for how long neither the autopilot's status nor the vehicle behind it was heard."""
        link_s = self.vehicle.link_age_s if self.vehicle is not None else None
        if self.vehicle is not None and link_s is None and self.unknown_ns is not None:
            return self.now - min(self.vehicle_ns, self.unknown_ns)  # the node has never heard it
        return self.now - self.vehicle_ns + int((link_s or 0.0) * _SECOND)

    def is_silent(self, limits: Limits) -> bool:
        """Return True when it is silent for long, or does not say for long whether it is armed."""
        unknown_ns = 0 if self.armed_unknown_ns is None else self.now - self.armed_unknown_ns
        return max(self.silent_ns(), unknown_ns) >= limits.pilot_silence_limit_ns

    def is_disarmed(self, limits: Limits) -> bool:
        """Return True when it has said for long that it is disarmed, wherever it says that it stands."""
        fresh = self.fresh(limits)
        says = self.unarmed_ns is not None and fresh is not None and fresh.armed is False
        return says and self.now - (self.unarmed_ns or 0) >= limits.pilot_silence_limit_ns

    def is_unknown(self, limits: Limits) -> bool:
        """Return True when it was unknown for too long whether it is armed and on the ground, or neither can be."""
        return self.unknown_ns is not None and self.now - self.unknown_ns > limits.vehicle_unknown_limit_ns

    def is_taken(self, limits: Limits) -> bool:
        """Return True when several statuses, the last one among them, agree that somebody else has control."""
        denied = self.vehicle is not None and self.vehicle.armed is False
        return self.taken > 1 and not denied and self.now - self.taken_ns >= limits.pilot_confirm_ns


def see(witness: Witness, event: ev.Event, state: EngineState, limits: Limits) -> Witness:
    """Return what is known after an event, before the engine has answered; `state` is what the engine shows."""
    now = max(witness.now, event.t_ns)
    changes: Dict[str, Any] = {"now": now, "foreign": False}
    age = getattr(event, "age_ns", 0)
    if -limits.clock_tolerance_ns <= age <= limits.status_max_age_ns:
        reader = _READ.get(type(event))
        if reader is not None:
            reader(witness, event, now, changes, state, limits)
    if now > witness.now:
        _count_waits(witness, now, changes, state)
    return evolve(witness, **changes)


def _count_waits(witness: Witness, now: int, changes: Dict[str, Any], state: EngineState) -> None:
    """Count how long each component was waited for in this flight: while the engine says HOLD and it is at 4 or 8."""
    if state.state is not State.HOLD:
        return
    waited = dict(witness.waited)
    for name, code in witness.codes:
        if code in (4, 8):
            waited[name] = waited.get(name, 0) + now - witness.now
    changes["waited"] = tuple(sorted(waited.items()))


def _autopilot(
    witness: Witness, event: Any, now: int, changes: Dict[str, Any], state: EngineState, limits: Limits
) -> None:
    previous = witness.vehicle
    changes.update(vehicle=event, vehicle_ns=now)
    if event.battery_fraction is not None and event.battery_age_s is not None:
        changes["battery_ns"] = now - int(event.battery_age_s * _SECOND)
    _speeds(witness, event, now, changes, limits)
    changed = previous is not None and previous.mode not in ("", event.mode) and event.mode != ""
    if previous is None or previous.mode != event.mode:
        changes["mode_ns"] = now
    unchanged = event.mode == witness.mode_before and not witness.answered  # since before the flight
    impossible = event.armed is False and event.landed in _FLIES
    unknown = event.armed is None or event.landed is ev.VehicleLanded.UNKNOWN or impossible
    changes["unknown_ns"] = (now if witness.unknown_ns is None else witness.unknown_ns) if unknown else None
    unknown_ns = now if witness.armed_unknown_ns is None else witness.armed_unknown_ns
    changes["armed_unknown_ns"] = unknown_ns if event.armed is None else None
    changes["idle_ns"] = _idle_since(witness, witness.planner, event, now, limits, state)
    changes["foreign"] = changed and event.mode in NEVER_OURS and not unchanged
    link_good = event.link_age_s is not None and event.link_age_s * _SECOND <= limits.autopilot_link_limit_ns
    if witness.rested < 2:  # since it was started; once two in a row said disarmed, it stays so
        changes["rested"] = witness.rested + 1 if link_good and event.armed is False else 0
    gap = previous is None or now - witness.vehicle_ns > limits.autopilot_status_limit_ns
    unarmed_ns = now if gap or witness.unarmed_ns is None else witness.unarmed_ns
    changes["unarmed_ns"] = unarmed_ns if link_good and event.armed is False else None
    spins = link_good and event.armed is True and event.landed is ev.VehicleLanded.ON_GROUND
    changes["spinning_ns"] = (now if gap or witness.spinning_ns is None else witness.spinning_ns) if spins else None
    again = previous is not None and previous.mode == event.mode and link_good and event.landed in _FLIES
    rises = state.state in (State.TAKEOFF, State.MISSION)
    if again and rises and event.armed is not False and witness.flown != "AUTO.MISSION":
        _flown(witness, event.mode, changes, state)  # what two statuses in a row have said
    _count_taken(witness, event, now, changes, state, limits)
    _on_the_ground(witness, event, now, changes, limits)
    if event.armed is not False and event.mode in OURS.get(witness.motion, ()):
        changes["answered"] = True
    if not link_good:
        return
    ground = event.landed is ev.VehicleLanded.ON_GROUND
    changes["ground_ns"] = (now if witness.ground_ns is None else witness.ground_ns) if ground else None
    down = ground and event.armed is False
    silent = previous is None or now - witness.vehicle_ns > limits.autopilot_status_limit_ns
    changes["down_ns"] = (now if witness.down_ns is None or silent else witness.down_ns) if down else None
    contradicted = changes.get("contradicted_ns") == now
    confirm_ns = limits.confirm_limit_ns if contradicted else limits.flight_end_confirm_ns
    agreed = down and witness.down_ns is not None and now - witness.down_ns >= confirm_ns
    if agreed and witness.flight == "armed":
        changes["flight"] = "none"
    if witness.flight == "commanded" and event.armed is True:
        changes["flight"] = "armed"
    _in_the_air(witness, event, changes, state)


def _on_the_ground(witness: Witness, event: Any, now: int, changes: Dict[str, Any], limits: Limits) -> None:
    """Note when something contradicts that it stands there, and whether it may have left it unheard."""
    before = evolve(witness, now=witness.vehicle_ns)
    after = evolve(witness, now=now, vehicle=event, vehicle_ns=now)
    if after.contradicts_ground(limits):
        changes["contradicted_ns"] = now
    said = before.fresh(limits)
    gap = now - witness.vehicle_ns > limits.autopilot_status_limit_ns or after.fresh(limits) is None
    if witness.flight == "armed" and said is not None and said.armed is True and gap:
        changes["flew"] = True  # for all that anybody knows


def _in_the_air(witness: Witness, event: Any, changes: Dict[str, Any], state: EngineState) -> None:
    """Note whether it flies, and whether it does behind the end of its recording."""
    flies = event.landed in _FLIES
    changes["aloft"] = witness.aloft + 1 if flies else 0
    if flies and (witness.flight != "none" or (event.armed is True and state.state is State.LAND)):
        changes.update(flight="armed", airborne=witness.airborne or witness.aloft > 0)  # one status is not believed
    flew = flies and witness.aloft > 0
    if flew and changes.get("flight", witness.flight) == "armed":
        changes["flew"] = True
    ours = state.state is State.LAND and event.armed is True
    if ours and flew and witness.recording in _BEHIND:
        changes["flown_on"] = True
    recorder = witness.recorder
    if flew and event.armed is True and state.state in _FLIGHT and recorder is not None and recorder.phase in _ENDED:
        changes["flown_on"] = True


def _flown(witness: Witness, mode: str, changes: Dict[str, Any], state: EngineState) -> None:
    """Note in which mode it is flown, where that is none of the other way to fly."""
    goes = witness.motion in (MissionAction.TAKEOFF, MissionAction.RESUME)
    if goes and mode in _PAST and mode not in _other_way(witness.flown_by, state).get(witness.motion, ()):
        changes.update(flown=mode, flown_by=mode if witness.flown_by != "AUTO.MISSION" else witness.flown_by)


def _speeds(witness: Witness, event: Any, now: int, changes: Dict[str, Any], limits: Limits) -> None:
    """Note since when it sinks, moves, or does neither in a landing of the planner's."""
    down, across = event.vertical_speed_m_s, event.horizontal_speed_m_s
    sinks = down is not None and down <= -limits.descent_speed_m_s
    moves = across is not None and across > limits.hold_speed_m_s and event.mode != "AUTO.LOITER"
    since = {
        "descending_ns": (now if witness.descending_ns is None else witness.descending_ns) if sinks else None,
        "moving_ns": (now if witness.moving_ns is None else witness.moving_ns) if moves else None,
    }
    seen = evolve(witness, now=now, vehicle=event, vehicle_ns=now, **since)
    changes.update(since, stalled_ns=_stalled_since(seen, witness.planner, limits))


def _idle_since(
    witness: Witness, planner: Any, vehicle: Any, now: int, limits: Limits, state: EngineState
) -> Optional[int]:
    """Return since when the planner says of a vehicle in the air that nothing is flown, or that it holds unasked."""
    heard_ns = now if vehicle is not witness.vehicle else witness.vehicle_ns
    seen = evolve(witness, now=now, vehicle=vehicle, vehicle_ns=heard_ns)
    status = seen.fresh(limits)
    flies = status is not None and status.armed is True and status.landed in _FLIES
    unasked = ("HOLDING",) if state.step is Step.FLYING else ()
    idle = planner is not None and planner.phase.name in ("IDLE", "LOADED", "LANDED", *unasked)
    return (now if witness.idle_ns is None else witness.idle_ns) if flies and idle else None


def _stalled_since(witness: Witness, planner: Any, limits: Limits) -> Optional[int]:
    """Return since when the planner says that it lands, and the vehicle that it neither sinks nor moves."""
    status, now = witness.fresh(limits), witness.now
    flies = status is not None and status.armed is True and status.landed in _FLIES
    if status is None or not flies or planner is None or planner.phase.name != "LANDING":
        return None
    sinks, moves = (
        each is not None and now - each >= limits.descent_time_ns for each in (witness.descending_ns, witness.moving_ns)
    )
    told = status.vertical_speed_m_s is not None and status.horizontal_speed_m_s is not None
    still = not sinks and (status.mode in _LANDING_MODES or (told and not moves))
    return (now if witness.stalled_ns is None else witness.stalled_ns) if still else None


def _count_taken(
    witness: Witness, event: Any, now: int, changes: Dict[str, Any], state: EngineState, limits: Limits
) -> None:
    """Count the statuses in a row by which somebody else has control."""
    says = event.pilot_in_control or changes["foreign"] or (witness.taken > 0 and event.mode in NEVER_OURS)
    unshown = not witness.answered and witness.motion in _AFTER_A_HOLD  # the hold of before still shows
    may_hold = unshown or witness.motion is MissionAction.HOLD
    soon = witness.motion is not None and now - witness.motion_ns <= limits.arm_limit_ns
    late = witness.flight == "none" and not witness.airborne and soon and event.armed is True
    changes["armed_late"] = witness.armed_late + 1 if late else 0
    answers = (*OURS[MissionAction.TAKEOFF], *OURS.get(witness.motion, ()))
    late = late and event.mode in answers  # our takeoff was called off, and it arms all the same
    may_hold = may_hold or (late and event.landed not in _FLIES)
    says = says or (event.failsafe and event.mode in (*NEVER_OURS, *(() if may_hold else ("AUTO.LOITER",))))
    says = says or (witness.flight == "none" and event.armed is True and witness.rested > 1 and not late)
    planner = witness.planner
    lands = planner is None or planner.phase in (ev.MissionPhase.LANDING, ev.MissionPhase.LANDED)
    flies = witness.motion in (MissionAction.TAKEOFF, MissionAction.RESUME, MissionAction.HOLD)
    says = says or (flies and event.mode in _LANDING_MODES and not lands)
    goes = witness.motion in (MissionAction.TAKEOFF, MissionAction.RESUME)
    says = says or (goes and event.mode in _PAST.get(changes.get("flown", witness.flown), ()))
    other = _other_way(changes.get("flown_by", witness.flown_by), state)
    flown, before_it = changes.get("flown", witness.flown), event.mode == witness.mode_before and not witness.answered
    shows = flown == "OFFBOARD" if other is _BY_SET_POINTS and witness.motion is MissionAction.HOLD else not before_it
    says = says or (shows and witness.flight != "none" and event.mode in other.get(witness.motion, ()))
    before = witness.vehicle
    once = event.armed is False and before is not None and before.armed is not False
    if once and witness.taken > 1 and witness.flight != "none":
        return  # one status in flight does not deny what two have said
    if not says or event.armed is False:
        changes["taken"] = 0
    else:
        changes.update(taken=witness.taken + 1, taken_ns=witness.taken_ns if witness.taken else now)


def _other_way(by: str, state: EngineState) -> Dict[Optional[MissionAction], Tuple[str, ...]]:
    """Return of each command the modes that would answer it, were the flight not flown the other way."""
    declared = state.session.mission is not None and state.session.mission.set_points
    return _BY_MISSION if by == "AUTO.MISSION" else _BY_SET_POINTS if by == "OFFBOARD" and declared else {}


_LANDING_MODES = ("AUTO.LAND", "AUTO.PRECLAND")
_AFTER_A_HOLD = (MissionAction.RESUME, MissionAction.LAND, MissionAction.ABORT)
MOVING = ("AUTO.TAKEOFF", "AUTO.MISSION", "OFFBOARD")
OURS: Dict[Optional[MissionAction], Tuple[str, ...]] = {
    MissionAction.TAKEOFF: (*MOVING, "AUTO.LOITER"),
    MissionAction.RESUME: MOVING,
    MissionAction.HOLD: ("AUTO.LOITER", "OFFBOARD"),
    MissionAction.LAND: _LANDING_MODES,
    MissionAction.ABORT: _LANDING_MODES,
}
"""The flight modes of the PX4 that answer a command, written by hand."""
_PAST: Dict[str, Tuple[str, ...]] = {
    "OFFBOARD": ("AUTO.TAKEOFF", "AUTO.LOITER"),
    "AUTO.MISSION": ("AUTO.TAKEOFF", "AUTO.LOITER", "OFFBOARD"),
}
"""What answers a takeoff or a resume no more once this was flown: then it is somebody else's, written by hand."""
_BY_SET_POINTS: Dict[Optional[MissionAction], Tuple[str, ...]] = {
    MissionAction.TAKEOFF: ("AUTO.MISSION",),
    MissionAction.RESUME: ("AUTO.MISSION",),
    MissionAction.HOLD: ("AUTO.LOITER",),
}
_BY_MISSION: Dict[Optional[MissionAction], Tuple[str, ...]] = dict.fromkeys(
    (MissionAction.TAKEOFF, MissionAction.RESUME, MissionAction.HOLD), ("OFFBOARD",)
)
"""What is somebody else's, for the flight goes the other way, written by hand."""
NEVER_OURS = ("POSCTL", "ALTCTL", "MANUAL", "STABILIZED", "ACRO", "AUTO.RTL")


def _action(witness: Witness, event: Any, now: int, changes: Dict[str, Any], *_: Any) -> None:
    known = {name: (counter, rises) for name, counter, rises in witness.counters}
    before, rises = known.get(event.publisher, (None, 1 if known else 2))
    if before is not None and event.loop_counter != before:  # one that has fallen rises twice before it is believed
        rises = rises + 1 if event.loop_counter > before else 0
        if rises > 1:
            changes["beat_ns"] = now
    elif before is None and not known:
        changes["beat_ns"] = now
    known[event.publisher] = (event.loop_counter, min(rises, 2))
    changes["counters"] = tuple((name, *each) for name, each in known.items())
    listed: Dict[str, int] = {}
    for status in event.components:
        listed[status.name] = max(listed.get(status.name, 0), int(status.code))
    if event.code >= 4 and all(code < event.code for code in listed.values()):
        listed[event.latest_component or "unnamed component"] = int(event.code)
    kept = {name: code for name, code in witness.codes if code < 4 and name not in listed}
    changes["codes"] = tuple(sorted({**kept, **listed}.items()))
    changes["given_up"] = tuple(s.name for s in event.components if s.restart.value == "given_up")


def _info(witness: Witness, event: Any, _now: int, changes: Dict[str, Any], *_: Any) -> None:
    acted = {name: code for name, code in witness.codes if code >= 4}
    told: Dict[str, int] = {}
    for status in event.components:
        if status.code < 4 and status.name not in acted:
            told[status.name] = max(told.get(status.name, 0), int(status.code))
    changes["codes"] = tuple(sorted({**told, **acted}.items()))


def _planner(
    witness: Witness, event: Any, now: int, changes: Dict[str, Any], state: EngineState, limits: Limits
) -> None:
    if event.session_id and event.session_id == witness.session:
        changes.update(planner=event, planner_ns=now)
        if witness.flight != "none" and event.t_ns > witness.flight_ns and event.waypoint > 0 and event.phase in _FLEW:
            changes["flew"] = True
        changes["idle_ns"] = _idle_since(witness, event, witness.vehicle, now, limits, state)
        changes["stalled_ns"] = _stalled_since(evolve(witness, now=now), event, limits)
        status = witness.vehicle
        lands = event.phase in (ev.MissionPhase.LANDING, ev.MissionPhase.LANDED)
        if lands and status is not None and status.mode in _LANDING_MODES and not status.pilot_in_control:
            changes["taken"] = 0  # it is the planner that lands


def _recorder(witness: Witness, event: Any, now: int, changes: Dict[str, Any], *_: Any) -> None:
    if not event.session_id or event.session_id != witness.session:
        return
    grows = event.phase is ev.RecordingPhase.RECORDING and bool(event.platforms)
    grows = grows and all(platform.growing for platform in event.platforms)
    changes.update(recorder=event, recorder_ns=now)
    changes["growing_ns"] = (now if witness.growing_ns is None else witness.growing_ns) if grows else None
    if event.phase is ev.RecordingPhase.COMPLETE and witness.recording in ("stopped", "named"):
        changes["recording"] = "complete"


def _landed(
    witness: Witness, event: Any, now: int, changes: Dict[str, Any], _state: EngineState, limits: Limits
) -> None:
    changes.update(detection=event.landed, detection_ns=now)
    if evolve(witness, now=now, detection=event.landed, detection_ns=now).contradicts_ground(limits):
        changes["contradicted_ns"] = now


def _check_reply(witness: Witness, event: Any, now: int, changes: Dict[str, Any], *_: Any) -> None:
    checks = dict(witness.checks)
    asked = checks.get(event.check.value)
    if asked is None or asked.id != event.command_id or asked.answered_ns is not None:
        return
    answered = event.outcome is ev.Outcome.ACCEPTED
    rows = all(row.verdict.value in ("pass", "warn") for row in event.checks)
    checks[event.check.value] = asked._replace(answered_ns=now, ok=answered and event.ok and rows)
    changes["checks"] = tuple(checks.items())
    if event.check.value == "watchdog" and answered and not witness.watching:
        changes.update(watching=True, beat_ns=now if witness.beat_ns is None else max(now, witness.beat_ns))


def _reply(witness: Witness, event: Any, _now: int, changes: Dict[str, Any], *_: Any) -> None:
    if witness.load is not None and event.command_id == witness.load.id:
        changes["load"] = witness.load._replace(outcome=event.outcome)


def _started(
    witness: Witness, event: Any, now: int, changes: Dict[str, Any], state: EngineState, limits: Limits
) -> None:
    """A new process has heard nobody yet: silence is counted from its start, and what was said before is not known."""
    away_ns = max(event.away_ns, now - witness.now)
    if event.resumed and (witness.shutting_down or away_ns > limits.ready_limit_ns):
        changes["unasked"] = True
    changes.update(started_ns=now, shutting_down=False, rested=2 if witness.rested > 1 and state.sessions else 0)
    if event.resumed:
        changes.update(planner_ns=now, recorder_ns=now, vehicle_ns=now, detection_ns=now)
        changes.update(vehicle=None, planner=None, recorder=None, detection=ev.Landed.UNKNOWN)
        changes.update(idle_ns=None, unknown_ns=None, armed_unknown_ns=None)
        changes.update(sent_ns=now, second_ns=now)  # what was commanded is, again, once it was heard who has control
        changes.update(
            growing_ns=None,
            descending_ns=None,
            contradicted_ns=None,
            down_ns=None,
            ground_ns=None,
            taken=0,
            armed_late=0,
            stalled_s=0.0,
        )
        for field in ("beat_ns", "battery_ns"):
            if getattr(witness, field) is not None:
                changes[field] = now


def _shutdown(_witness: Witness, _event: Any, _now: int, changes: Dict[str, Any], *_: Any) -> None:
    changes["shutting_down"] = True


def _tick(
    _witness: Witness, event: Any, _now: int, changes: Dict[str, Any], _state: EngineState, limits: Limits
) -> None:
    if event.away_ns > limits.ready_limit_ns:
        changes["unasked"] = True


def _clock(_witness: Witness, event: Any, _now: int, changes: Dict[str, Any], *_: Any) -> None:
    changes["stalled_s"] = event.stalled_s


_READ: Dict[type, Any] = {
    ev.AutopilotStatus: _autopilot,
    ev.CheckReply: _check_reply,
    ev.ClockStatus: _clock,
    ev.EngineStarted: _started,
    ev.LandedStatus: _landed,
    ev.MissionStatus: _planner,
    ev.RecordingStatus: _recorder,
    ev.Reply: _reply,
    ev.Shutdown: _shutdown,
    ev.Tick: _tick,
    ev.WatchdogAction: _action,
    ev.WatchdogInfo: _info,
}


def hear(witness: Witness, event: ev.Event, commands: Tuple[Any, ...], after: EngineState) -> Witness:
    """Return what is known once the engine's commands are heard, behind an event, and its new place is seen."""
    changes: Dict[str, Any] = {}
    if _goes_on(event) and any(isinstance(each, Answer) and each.answer is AnswerKind.DONE for each in commands):
        changes["unasked"] = False
    identities = [command.id for command in commands if isinstance(command, Request)]
    if identities:
        changes["last_id"] = max(witness.last_id, *identities)
    for command in commands:
        reader = _HEARD.get(type(command))
        if reader is not None:
            reader(witness, command, changes)
    _shown(witness, after, changes)
    return evolve(witness, **changes) if changes else witness


def _goes_on(event: ev.Event) -> bool:
    """Return True where a person has in mind what is flown next: selects it, or says that it goes on."""
    goes_on = (ev.UserCommand.RETRY, ev.UserCommand.GO)
    return isinstance(event, ev.MissionSelected) or (isinstance(event, ev.UserRequest) and event.command in goes_on)


def _shown(witness: Witness, after: EngineState, changes: Dict[str, Any]) -> None:
    """Read what the engine shows of its place."""
    if after.state not in _FLIGHT and witness.flight != "none":
        changes["flight"] = "none"
    if after.state not in _FLIGHT and (witness.landing or witness.alarms):
        changes.update(landing=False, alarms=())
    unseen = after.state is State.LAND and after.step is Step.COMMANDING
    if unseen is not (witness.unseen_ns is not None):
        changes["unseen_ns"] = witness.now if unseen else None
    if after.session.id != witness.session:
        changes["session"] = after.session.id
        changes.update(planner=None, idle_ns=None, recorder=None, growing_ns=None, load=None)
        if after.session.id:
            changes.update(recording="none", flown_on=False, flew=False)
    if after.state is State.HOLD and after.flight.user_hold_ns is not None:
        if not witness.user_hold:
            changes["user_hold"] = True
    elif witness.user_hold:
        changes["user_hold"] = False


def _motion(witness: Witness, command: Any, changes: Dict[str, Any]) -> None:
    action = command.action
    changes.update(motion=action, motion_id=command.id, motion_ns=witness.now)
    if action in (MissionAction.TAKEOFF, MissionAction.RESUME):
        changes["flown"] = ""
    if action is MissionAction.HOLD and witness.planner is not None and witness.planner.phase.name == "HOLDING":
        changes["idle_ns"] = None  # it is asked for now
    if action is not witness.motion or action is MissionAction.TAKEOFF:
        changes["answered"] = False
    if action is MissionAction.TAKEOFF:
        changes.update(flown_by="")
        changes.update(flight="commanded", flight_ns=witness.now, airborne=False, landing=False, second=False)
        changes.update(alarmed=False, alarms=(), waited=(), disarmed_ns=None)
        changes["mode_before"] = witness.vehicle.mode if witness.vehicle is not None else ""
        if witness.load is not None:
            changes["load"] = witness.load._replace(used=True)
    elif action is MissionAction.LAND:
        if not witness.landing:
            changes.update(landing=True, land_ns=witness.now, second=False)
            if witness.flight == "none":  # ours again: who seemed to have it before does not count
                changes.update(flight="armed", taken=0)
        changes.update(sent_ns=witness.now, unasked=True)


def _check(witness: Witness, command: Any, changes: Dict[str, Any]) -> None:
    checks = dict(changes.get("checks", witness.checks))
    checks[command.check.value] = Asked(command.id, witness.now)
    changes["checks"] = tuple(checks.items())


def _loading(_witness: Witness, command: Any, changes: Dict[str, Any]) -> None:
    leg = (command.repetition, command.file_index)
    changes["load"] = Load(command.id, command.session_id, command.mission_id, leg)


def _heard_land(witness: Witness, _command: Any, changes: Dict[str, Any]) -> None:
    changes.update(second=True, second_ns=witness.now)


def _stopped(witness: Witness, changes: Dict[str, Any]) -> None:
    changes["recording"] = "complete" if witness.recording == "complete" else "stopped"


def _told(witness: Witness, command: Any, changes: Dict[str, Any]) -> None:
    if command.level.name == "ALARM":
        changes["alarmed"] = True
        changes["alarms"] = (*changes.get("alarms", witness.alarms), command.key)
    known_down = witness.vehicle is not None and witness.vehicle.armed is False
    if command.key == "landing_given_up" and not known_down:
        changes["flown_on"] = True
    if command.key == "data_incomplete" and witness.recording not in ("none", "complete"):
        changes["recording"] = "named"


_HEARD: Dict[type, Any] = {
    AutopilotDisarm: lambda witness, _, changes: changes.update(disarmed_ns=witness.now),
    AutopilotLand: _heard_land,
    LoadMission: _loading,
    MissionCommand: _motion,
    Notify: _told,
    RunCheck: _check,
    StartRecording: lambda _, __, changes: changes.update(recording="asked"),
    StopRecording: lambda witness, _, changes: _stopped(witness, changes),
}
