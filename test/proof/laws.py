"""The safety laws. Each is one predicate on one moment: an event, what the engine commands, and where it is then.

A law returns None where it does not apply, True where it is kept, and a sentence where it is broken. It may look at the
event, the commands, the place that the engine shows, and the witness (`proof_witness.py`); hardly ever at the engine's
inside. `source` is the rule of DESIGN.md that it is written from: "4.3" is rule 3 of section 4, "5 HOLD" the row HOLD
of section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional, Tuple, Union

from proof_witness import CHECKS, OURS, Witness

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import (
    Answer,
    AnswerKind,
    AutopilotDisarm,
    AutopilotLand,
    Decision,
    LoadMission,
    MissionAction,
    MissionCommand,
    Notify,
    Request,
    RunCheck,
    StartRecording,
    StopRecording,
)
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.engine.state import EngineState, Result, State, Step
from amaze_autonomy.engine.timers import next_deadline

__all__ = ["LAWS", "Law", "Moment"]

Verdict = Union[None, bool, str]
A = MissionAction
_GROUND = (
    State.MISSION_INPUT,
    State.PREFLIGHT,
    State.OUTREACH,
    State.READY,
    State.START_RECORDING,
    State.LOAD_MISSION,
    State.DATA_CLEANUP,
    State.MISSION_ENDED,
)
_FLIGHT = (State.TAKEOFF, State.MISSION, State.HOLD, State.LAND)
_ENDLESS = (State.MISSION_INPUT, State.OUTREACH, State.PILOT, State.MISSION_ENDED)
_LANDING_MODES = ("AUTO.LAND", "AUTO.PRECLAND")


class Moment:
    """One event and its answer: the witness as it `was`, as it `saw` the event, and as it has `seen` the commands."""

    __slots__ = ("after", "before", "commands", "event", "motions", "requests", "rules", "saw", "seen", "was")

    def __init__(
        self,
        before: EngineState,
        event: ev.Event,
        commands: Tuple[Any, ...],
        after: EngineState,
        witnesses: Tuple[Witness, Witness, Witness],
        rules: Rules,
    ) -> None:
        self.before, self.event, self.commands, self.after, self.rules = before, event, commands, after, rules
        self.was, self.saw, self.seen = witnesses
        self.requests = [c for c in commands if isinstance(c, Request)] if commands else []
        self.motions = [c.action for c in self.requests if isinstance(c, MissionCommand)]

    @property
    def moved(self) -> bool:
        """True when the engine is in another state than before."""
        return self.before.state is not self.after.state

    def sent(self, kind: type) -> bool:
        """Return True when a request of a kind went out."""
        return any(isinstance(request, kind) for request in self.requests)


@dataclass(frozen=True)
class Law:
    """One law; `always`: it also has to be looked at when the engine said nothing."""

    name: str
    source: str
    words: str
    check: Callable[[Moment], Verdict]
    always: bool = False


LAWS: Dict[str, Law] = {}


def law(source: str, words: str, *, always: bool = False) -> Callable[[Callable[[Moment], Verdict]], Any]:
    """Register a law."""

    def register(check: Callable[[Moment], Verdict]) -> Callable[[Moment], Verdict]:
        LAWS[check.__name__] = Law(check.__name__, source, words, check, always)
        return check

    return register


# --- takeoff ----------------------------------------------------------------------------------------------------------


@law("4.7, 5 LOAD_MISSION", "A takeoff needs every check: asked since the mission was loaded, passed, and fresh.")
def takeoff_needs_fresh_checks(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    if len(m.saw.checks) != CHECKS or m.saw.load is None:
        return f"only {len(m.saw.checks)} checks were asked"
    for name, asked in m.saw.checks:
        if not asked.ok or asked.answered_ns is None:
            return f"the {name} check has not passed"
        if m.saw.now - asked.answered_ns > m.rules.limits.check_max_age_ns:
            return f"the {name} check is too old"
        if asked.id < m.saw.load.id:
            return f"the {name} check was not asked again"
    return True


@law("5 START_RECORDING", "A takeoff needs a recording of this session that is proven to grow on every platform.")
def takeoff_needs_a_proven_recording(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    limits, since = m.rules.limits, m.saw.growing_ns
    if m.saw.recording != "asked" or since is None:
        return "no recording is proven"
    if m.saw.now - m.saw.recorder_ns > limits.recorder_status_limit_ns:
        return "the recorder is silent"
    return True if m.saw.now - since >= limits.recording_lead_ns else "the recording is younger than its lead"


@law("5 LOAD_MISSION", "A takeoff needs the planner's word that it has loaded this file of this mission.")
def takeoff_needs_the_planners_word(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    load, planner = m.saw.load, m.saw.planner
    if load is None or load.outcome is not ev.Outcome.ACCEPTED or planner is None:
        return "the planner has not accepted the mission"
    said = (planner.mission_id, (planner.repetition, planner.file_index), planner.phase)
    expected = (load.mission, load.leg, ev.MissionPhase.LOADED)
    return True if said == expected else f"the planner says {said}, not {expected}"


@law("4.6, 4.7", "No takeoff while anything known would end the flight, and only from the ground, disarmed.")
def takeoff_only_when_fit(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    limits = m.rules.limits
    if not m.saw.is_down(limits):
        return "the vehicle does not say, freshly, that it is disarmed on the ground"
    if m.saw.shutting_down:
        return "the process was told to end"
    bad = [name for name, code in m.saw.codes if code >= 8]
    if bad:
        return f"{bad[0]} has failed"
    if m.saw.beat_ns is None or m.saw.now - m.saw.beat_ns > limits.watchdog_heartbeat_limit_ns:
        return "the watchdog is silent"
    if m.saw.battery_ns is None or m.saw.now - m.saw.battery_ns > limits.battery_age_limit_ns:
        return "the battery level is not known"
    return True


@law("4.7, 5 PREFLIGHT", "Ready is said when every check has passed, by all its rows, and none is too old.")
def ready_needs_every_check(m: Moment) -> Verdict:
    if not any(isinstance(c, Decision) and c.after == "READY" for c in m.commands) or m.before.state is State.READY:
        return None
    for name, asked in m.saw.checks:
        if not asked.ok or asked.answered_ns is None:
            return f"the {name} check has not passed"
        if m.saw.now - asked.answered_ns > m.rules.limits.check_max_age_ns:
            return f"the {name} check is too old"
    return True if len(m.saw.checks) == CHECKS else "not every check was asked"


@law("5 READY, LOAD_MISSION", "Ready is taken back when a required component is not at code 1, or tolerated at 2.")
def ready_is_taken_back(m: Moment) -> Verdict:
    if m.before.state not in (State.READY, State.START_RECORDING, State.LOAD_MISSION):
        return None
    mission = m.before.mission
    required = mission.required if mission is not None else ()
    tolerated = mission.tolerated if mission is not None else ()
    for name, code in m.saw.codes:
        if code == 1 or (code == 2 and name in tolerated) or (required and name not in required):
            continue
        kept = m.after.state in (State.READY, State.START_RECORDING, State.LOAD_MISSION, State.TAKEOFF)
        return f"{name} is at {code}, still {m.after.state.value}" if kept else True
    return None


@law("5", "A takeoff is commanded once for each loaded file; nothing repeats it.")
def one_takeoff_for_each_load(m: Moment) -> Verdict:
    if A.TAKEOFF not in m.motions:
        return None
    if m.motions.count(A.TAKEOFF) != 1 or m.saw.load is None:
        return "more than one takeoff at once"
    return "this file was taken off with before" if m.saw.load.used else True


# --- failures in flight -----------------------------------------------------------------------------------------------


def _handed_over(m: Moment) -> bool:
    """Return True where nobody expects a landing any more: the pilot has it, or it is down."""
    return m.after.state is State.PILOT or m.seen.flight != "armed"


def _is_landed_for(m: Moment, why: str) -> Verdict:
    if _handed_over(m):
        return None
    if m.after.state is not State.LAND:
        return f"{why}, and it does not land but is in {m.after.state.value}"
    return True if m.seen.landing else f"{why}, and LAND was not commanded"


@law("4 table, 4.2", "An airborne vehicle with an unresolved ABORT is being landed, in every phase.", always=True)
def abort_is_landed(m: Moment) -> Verdict:
    bad = [name for name, code in m.saw.codes if code == 16]
    return _is_landed_for(m, f"{bad[0]} is at 16") if bad and m.saw.flight == "armed" else None


@law("4 decision table", "A component of the row `highest` is landed for at 4, 8 and 16.", always=True)
def highest_is_landed_for(m: Moment) -> Verdict:
    if m.saw.flight != "armed":
        return None
    rows = {rule.name: rule.severity.value for rule in m.rules.components}
    bad = [name for name, code in m.saw.codes if code >= 4 and rows.get(name) == "highest"]
    return _is_landed_for(m, f"{bad[0]} has failed") if bad else None


@law(
    "4 losses", "Heartbeat, planner, autopilot or battery lost, or a limit of the flight passed: it lands.", always=True
)
def losses_are_landed_for(m: Moment) -> Verdict:
    if m.saw.flight != "armed":
        return None
    lost = _lost(m)
    return _is_landed_for(m, lost) if lost else None


def _lost(m: Moment) -> str:
    """Return what is lost, by the witness's own clocks; empty: nothing."""
    saw, limits, now = m.saw, m.rules.limits, m.saw.now
    status = saw.vehicle
    started = saw.flight_ns
    if now - max(saw.beat_ns or 0, 0) > limits.watchdog_heartbeat_limit_ns and saw.watching:
        return "the watchdog's heartbeat is lost"
    if now - saw.planner_ns > limits.planner_status_limit_ns and saw.planner_ns:
        return "the planner is silent"
    if saw.planner is not None and saw.planner.phase is ev.MissionPhase.FAILED:
        return "the planner failed"
    silent = status is not None or now - saw.vehicle_ns > limits.autopilot_status_limit_ns
    if silent and saw.fresh(limits) is None:
        return "the autopilot is silent"
    if now - (started if saw.battery_ns is None else saw.battery_ns) > limits.battery_age_limit_ns:
        return "the battery level is unknown"
    level = status.battery_fraction if status is not None else None
    if level is not None and not level > limits.battery_critical_fraction:
        return "the battery is critical"
    if now - started >= limits.max_flight_time_ns:
        return "the flight time is over"
    return _out_of_bounds(m)


def _out_of_bounds(m: Moment) -> str:
    status, limits = m.saw.fresh(m.rules.limits), m.rules.limits
    if status is None:
        return ""
    if status.height_m is not None and status.height_m > limits.max_height_m:
        return "it is too high"
    x, y = status.position_x_m, status.position_y_m
    far = x is not None and y is not None and (x * x + y * y) ** 0.5 > limits.max_distance_m
    return "it is too far" if far else ""


@law("4 losses", "When planner or autopilot is lost, the landing goes out by both routes.", always=True)
def both_routes_when_planner_or_autopilot_is_lost(m: Moment) -> Verdict:
    if m.saw.flight != "armed" or _handed_over(m):
        return None
    lost = _lost(m)
    if not lost.startswith(("the planner", "the autopilot")):
        return None
    return True if m.seen.second else f"{lost}, and the second route was not used"


@law("4 losses", "When the autopilot is lost in flight, the pilot is alarmed at once.", always=True)
def autopilot_lost_alarms(m: Moment) -> Verdict:
    if m.saw.flight != "armed" or _handed_over(m) or _lost(m) != "the autopilot is silent":
        return None
    return True if m.seen.alarmed else "the autopilot is silent, and the pilot was not alarmed"


def _waits(m: Moment) -> Optional[str]:
    """Return a component whose verb is `wait` now and whose budget is not spent."""
    rows = {rule.name: rule for rule in m.rules.components}
    for name, code in m.saw.codes:
        rule = rows.get(name)
        severity = rule.severity.value if rule is not None else ("moderate" if code == 4 else "high")
        budget = rule.wait_limit_ns if rule is not None else m.rules.limits.unlisted_wait_limit_ns
        spent = dict(m.saw.waited).get(name, 0)
        waits = code in (4, 8) and severity in ("moderate", "high")
        if waits and spent < budget and name not in m.saw.given_up:
            return name
    return None


@law(
    "4 table",
    "What is worth waiting for is waited for: airborne on its way, the mission holds, or does more.",
    always=True,
)
def a_wait_holds(m: Moment) -> Verdict:
    if m.saw.flight != "armed" or not m.saw.airborne or _waits(m) is None or m.saw.on_ground(m.rules.limits):
        return None
    if m.after.state not in (State.TAKEOFF, State.MISSION) or m.after.step is Step.CANCELLING:
        return True
    if _waits(m) in m.after.flown_without:
        return None
    return f"{_waits(m)} has failed, and it neither holds nor lands"


@law(
    "4 waits",
    "A component is not waited for longer than its budget, all its failures of the flight together.",
    always=True,
)
def a_wait_ends(m: Moment) -> Verdict:
    if m.after.state is not State.HOLD or m.seen.flight != "armed":
        return None
    budgets = {rule.name: rule.wait_limit_ns for rule in m.rules.components}
    for name, waited in m.saw.waited:
        budget = budgets.get(name, m.rules.limits.unlisted_wait_limit_ns)
        failing = dict(m.saw.codes).get(name, 1) in (4, 8)
        held = any(f.name == name and f.verb.name == "WAIT" for f in m.after.failures)
        if failing and held and waited >= budget:
            return f"{name} was waited for {waited / 1e9:g} s of {budget / 1e9:g} s, and is still"
    return True


@law("4 waits", "A component that is high and given up, or whose budget is spent, is landed for.", always=True)
def high_lands_in_the_end(m: Moment) -> Verdict:
    if m.saw.flight != "armed" or not m.saw.airborne:
        return None
    rows = {rule.name: rule for rule in m.rules.components if rule.severity.value == "high"}
    for name, code in m.saw.codes:
        over = name in m.saw.given_up or dict(m.saw.waited).get(name, 0) >= getattr(rows.get(name), "wait_limit_ns", 0)
        if name in rows and code in (4, 8) and over:
            return _is_landed_for(m, f"{name} is not coming back")
    return None


@law("4 table", "It lands by itself only for something that is landed for: never for what is flown on without.")
def a_landing_has_a_cause(m: Moment) -> Verdict:
    rules = [c.rule for c in m.commands if isinstance(c, Decision)]
    if "land" not in rules and "land_by_both_routes" not in rules:
        return None
    rows = {rule.name: rule.severity.value for rule in m.rules.components}
    for name, code in m.saw.codes:
        if code == 16 or (code >= 4 and rows.get(name) in ("high", "highest")) or (code == 8 and name not in rows):
            return True
    return True if m.was.user_hold or _lost(m) else f"landing, and only {dict(m.saw.codes)} is wrong"


@law("4 table", "It holds by itself only for a component at 4 or 8.")
def a_hold_has_a_cause(m: Moment) -> Verdict:
    if not any(isinstance(c, Decision) and c.rule == "hold" for c in m.commands):
        return None
    held = [name for name, code in m.saw.codes if code in (4, 8)]
    return True if held else f"holding, and {dict(m.saw.codes)} is no reason"


# --- landing ----------------------------------------------------------------------------------------------------------


@law("4.1", "Landing is sticky: after LAND nothing else moves the vehicle before it is down.", always=True)
def land_is_sticky(m: Moment) -> Verdict:
    if not m.was.landing or m.was.flight != "armed":
        return None
    other = [action for action in m.motions if action is not A.LAND]
    if other:
        return f"{other[0].name} while landing"
    down = m.seen.flight != "armed" or m.seen.is_down(m.rules.limits)
    stays = m.after.state in (State.LAND, State.PILOT) or down
    return True if stays else f"from landing to {m.after.state.value} while it is not down"


@law("4.3", "Land first, tidy later: LAND is the first command out, the second route comes next.")
def land_is_the_first_command_out(m: Moment) -> Verdict:
    if A.LAND not in m.motions and not m.sent(AutopilotLand):
        return None
    first = m.commands[0]
    if A.LAND in m.motions and not (isinstance(first, MissionCommand) and first.action is A.LAND):
        return f"{type(first).__name__} goes out before LAND"
    if m.sent(AutopilotLand) and not any(isinstance(c, AutopilotLand) for c in m.commands[: len(m.motions) + 1]):
        return "the second route does not go out next"
    return True


def _shows(saw: Witness, rules: Rules) -> bool:
    """Return True when the vehicle shows that it lands, or is down."""
    status = saw.fresh(rules.limits)
    if status is None:
        return False
    sinks = saw.descending_ns is not None and saw.now - saw.descending_ns >= rules.limits.descent_time_ns
    landed = status.landed in (ev.VehicleLanded.ON_GROUND, ev.VehicleLanded.LANDING)
    return status.mode in _LANDING_MODES or landed or sinks


@law("4.3", "LAND is repeated until the vehicle shows it: at each period while it does not.", always=True)
def land_is_repeated(m: Moment) -> Verdict:
    if m.after.state is not State.LAND or not m.seen.landing or _shows(m.saw, m.rules):
        return None
    late = m.seen.now - m.seen.sent_ns
    return True if late < m.rules.limits.land_repeat_period_ns else f"the last LAND is {late / 1e9:g} s old"


@law("4.3", "After 3 s without an answer the landing goes out by the second route too.", always=True)
def second_route_in_time(m: Moment) -> Verdict:
    if m.after.state is not State.LAND or not m.seen.landing or _shows(m.saw, m.rules):
        return None
    if m.seen.now - m.seen.land_ns < m.rules.limits.land_second_route_after_ns:
        return None
    return True if m.seen.second else "only one route was used"


@law("4.3", "After that the pilot is alarmed.", always=True)
def alarm_in_time(m: Moment) -> Verdict:
    if m.after.state is not State.LAND or not m.seen.landing or _shows(m.saw, m.rules):
        return None
    if m.seen.now - m.seen.land_ns < m.rules.limits.land_alarm_after_ns:
        return None
    return True if m.seen.alarmed else "the pilot was not alarmed"


@law("5 LAND", "It disarms only what stands on the ground, says so freshly, and is armed.")
def disarm_on_the_ground_only(m: Moment) -> Verdict:
    if not m.sent(AutopilotDisarm):
        return None
    status = m.saw.fresh(m.rules.limits)
    if status is None or status.landed is not ev.VehicleLanded.ON_GROUND or status.armed is not True:
        return "disarm although the vehicle does not say, freshly, armed and ON_GROUND"
    return "disarm although the landing detection says AIRBORNE" if _detects_flight(m) else True


def _detects_flight(m: Moment) -> bool:
    return m.saw.detected(m.rules.limits) is ev.Landed.AIRBORNE


@law("4.8", "A flight ends by what the vehicle says, freshly: disarmed and on the ground; never by a reply.")
def a_flight_ends_on_the_ground(m: Moment) -> Verdict:
    if m.before.state not in (*_FLIGHT, State.PILOT) or m.after.state not in _GROUND:
        return None
    if m.saw.flight == "none":
        return True
    return True if m.saw.is_down(m.rules.limits) else f"{m.after.state.value} while it is not known to be down"


@law("5 MISSION", "A mission is complete only when the planner says so, it was the last file, and it has landed.")
def complete_is_complete(m: Moment) -> Verdict:
    if m.after.result is not Result.COMPLETE or m.before.result is Result.COMPLETE:
        return None
    planner, mission, load = m.saw.planner, m.before.mission, m.saw.load
    if planner is None or planner.phase is not ev.MissionPhase.LANDED or planner.waypoint < planner.waypoints:
        return "the planner does not say that the last waypoint is done"
    last = mission is not None and load is not None and load.leg == (mission.repetitions - 1, mission.files - 1)
    return True if last else "it was not the last file"


@law("5 TAKEOFF", "The mission begins at takeoff height, known freshly.")
def the_mission_begins_at_height(m: Moment) -> Verdict:
    if m.before.step is not Step.CLIMBING or m.after.step is not Step.FLYING:
        return None
    status, limit = m.saw.fresh(m.rules.limits), m.rules.limits.takeoff_height_m
    high = status is not None and status.height_m is not None and status.height_m >= limit
    return True if high else "the mission begins below takeoff height, or at an unknown one"


@law("4.8", "It holds, or goes on, when the planner shows it; an accepted request is no sign of it.")
def holding_is_what_the_planner_shows(m: Moment) -> Verdict:
    if m.after.step is Step.HOLDING and m.before.step is not Step.HOLDING:
        expected: Tuple[str, ...] = ("HOLDING",)
    elif m.before.step is Step.RESUMING and m.after.step in (Step.FLYING, Step.CLIMBING):
        expected = ("FLYING", "TAKING_OFF", "LANDING", "LANDED")
    else:
        return None
    phase = m.saw.planner.phase.name if m.saw.planner is not None else "nothing"
    new = m.saw.planner is not None and m.saw.planner_ns > m.saw.motion_ns
    return True if new and phase in expected else f"the planner says {phase}"


# --- who has control --------------------------------------------------------------------------------------------------


@law("4.4", "When the pilot or a failsafe takes over, the engine stops at once and shows PILOT.", always=True)
def the_pilot_has_control(m: Moment) -> Verdict:
    status = m.saw.fresh(m.rules.limits)
    if not isinstance(m.event, ev.AutopilotStatus) or status is not m.event or status.armed is False:
        return None
    if m.saw.flight == "none" or m.before.state not in _FLIGHT or not m.before.in_flight:
        return None
    if not (status.pilot_in_control or status.failsafe or m.saw.foreign):
        return None
    return True if m.after.state is State.PILOT else f"taken over, and the engine is in {m.after.state.value}"


@law("4.4", "In PILOT nothing is commanded: no motion, no landing, no disarming.")
def nothing_is_commanded_in_pilot(m: Moment) -> Verdict:
    if m.after.state is not State.PILOT:
        return None
    moved = m.motions or m.sent(AutopilotLand) or m.sent(AutopilotDisarm)
    return "a command while the pilot has control" if moved else True


@law("4.4", "PILOT has a cause: the pilot, a failsafe, a foreign mode, or somebody else's arming.")
def pilot_has_a_cause(m: Moment) -> Verdict:
    if m.after.state is not State.PILOT or not m.moved:
        return None
    status = m.saw.fresh(m.rules.limits)
    if status is None:
        return "nothing is known freshly"
    cause = status.pilot_in_control or status.failsafe or _not_ours(m)
    return True if cause or (m.was.flight == "none" and status.armed is True) else f"why? the mode is {status.mode}"


def _not_ours(m: Moment) -> bool:
    """Return True when the mode is foreign: never ours, left after it had answered a command, or just changed."""
    status, before = m.saw.vehicle, m.was.vehicle
    if status is None or status.mode in OURS.get(m.was.motion, ()):
        return False
    changed = before is None or before.mode != status.mode
    return status.mode not in _ANY_OF_OURS or m.was.answered or changed


_ANY_OF_OURS = frozenset(mode for modes in OURS.values() for mode in modes)


@law("5 PILOT", "PILOT ends only acknowledged by a person, when the last word of the vehicle was that it is down.")
def pilot_ends_acknowledged(m: Moment) -> Verdict:
    if m.before.state is not State.PILOT or not m.moved:
        return None
    asked = isinstance(m.event, ev.UserRequest) and m.event.command is ev.UserCommand.ACKNOWLEDGE
    last = m.saw.vehicle
    down = last is not None and last.armed is False and last.landed is ev.VehicleLanded.ON_GROUND
    return True if asked and down else "left without an acknowledgement, or its last word was not that it is down"


@law("4, 5", "On the ground no motion but the one TAKEOFF, and what cancels it before lift-off.")
def no_motion_on_the_ground(m: Moment) -> Verdict:
    if not m.motions:
        return None
    for action in m.motions:
        if action in (A.HOLD, A.RESUME):
            if m.saw.flight != "armed" or m.saw.on_ground(m.rules.limits):
                return f"{action.name} on the ground"
            if action is A.RESUME and m.saw.fresh(m.rules.limits) is None:
                return "RESUME while nothing is known of the vehicle"
        elif action is A.TAKEOFF and m.before.state is not State.LOAD_MISSION and m.before.step is not Step.TOUCHDOWN:
            return f"TAKEOFF from {m.before.state.value}"
        elif action is A.ABORT and (m.before.state is not State.TAKEOFF or m.saw.flies(m.rules.limits)):
            return "ABORT, and it is not before lift-off"
        elif action is A.LAND and m.before.state in _GROUND and m.before.state is not State.MISSION_INPUT:
            return f"LAND from {m.before.state.value}"
    return True


@law("4.1", "One moment commands one motion, never two that contradict each other.")
def one_motion_at_a_time(m: Moment) -> Verdict:
    if not m.motions:
        return None
    return True if len(set(m.motions)) == 1 else " and ".join(action.name for action in m.motions)


@law("4.9", "Told to end in flight: LAND on both routes at once.")
def shutdown_lands_on_both_routes(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.Shutdown) or m.before.state not in _FLIGHT or not m.before.in_flight:
        return None
    if m.after.state is State.PILOT:
        return None
    return True if A.LAND in m.motions and m.sent(AutopilotLand) else "not both routes"


# --- requests, time, words --------------------------------------------------------------------------------------------


@law("4.1", "No request is sent twice without a cause, LAND excepted.")
def no_request_twice(m: Moment) -> Verdict:
    if not m.requests:
        return None
    kinds = [(type(r), getattr(r, "action", None), getattr(r, "check", None)) for r in m.requests]
    kinds = [kind for kind in kinds if A.LAND not in kind]
    if len(set(kinds)) != len(kinds):
        return "the same request twice at once"
    for request in m.requests:
        why = _repeated(m, request)
        if why:
            return why
    return True


def _repeated(m: Moment, request: Any) -> str:
    same_place = (m.before.state, m.before.step) == (m.after.state, m.after.step)
    if isinstance(request, RunCheck):
        asked = dict(m.saw.checks).get(request.check.value)
        open_still = asked is not None and asked.answered_ns is None and m.before.state is m.after.state
        waited = asked is not None and m.saw.now - asked.asked_ns >= m.rules.limits.check_reply_limit_ns
        return "a check is asked again while its answer is waited for" if open_still and not waited else ""
    if isinstance(request, (LoadMission, StartRecording)) and same_place:
        return f"{type(request).__name__} again without a step in between"
    if isinstance(request, StartRecording) and m.was.recording == "asked" and _records(m):
        return "StartRecording although it records"
    if isinstance(request, MissionCommand) and request.action is m.was.motion and request.action is not A.LAND:
        planner = m.saw.planner
        undone = planner is not None and planner.phase in (ev.MissionPhase.FLYING, ev.MissionPhase.TAKING_OFF)
        new_flight = request.action in (A.TAKEOFF, A.ABORT) and not same_place
        return "" if new_flight or (request.action is A.HOLD and undone) else f"{request.action.name} again"
    if isinstance(request, MissionCommand) and request.action is A.LAND and m.was.landing and m.was.flight == "armed":
        soon = m.saw.now - m.was.sent_ns < m.rules.limits.land_repeat_period_ns
        cause = m.sent(AutopilotLand) or isinstance(m.event, (ev.Shutdown, ev.AutopilotStatus)) or m.after.both_routes
        return "LAND again before its period" if soon and not cause else ""
    if isinstance(request, AutopilotDisarm) and m.was.disarmed_ns is not None and m.saw.airborne:
        soon = m.saw.now - m.was.disarmed_ns < m.rules.limits.ground_disarm_period_ns
        return "disarm again before its period" if soon and m.was.on_ground(m.rules.limits) else ""
    return ""


def _records(m: Moment) -> bool:
    fresh = m.saw.now - m.saw.recorder_ns <= m.rules.limits.recorder_status_limit_ns
    return m.saw.growing_ns is not None and fresh


@law("3, 6", "A late, foreign, stale or future message changes nothing.", always=True)
def late_and_foreign_change_nothing(m: Moment) -> Verdict:
    if not _is_noise(m):
        return None
    same = m.commands == () and m.before == m.after
    return True if same else f"a {type(m.event).__name__} that does not count was listened to"


def _is_noise(m: Moment) -> bool:
    event, was, limits = m.event, m.was, m.rules.limits
    if event.t_ns != m.before.t_ns:
        return False
    if not -limits.clock_tolerance_ns <= getattr(event, "age_ns", 0) <= limits.status_max_age_ns:
        return True
    if isinstance(event, (ev.MissionStatus, ev.RecordingStatus)):
        return event.session_id != was.session or not was.session
    if isinstance(event, ev.CheckReply):
        asked = dict(was.checks).get(event.check.value)
        return asked is None or asked.id != event.command_id or asked.answered_ns is not None
    if isinstance(event, ev.Reply):
        current = (was.motion_id, was.load.id if was.load else 0, m.before.recording_id)
        return event.command_id not in current
    return False


@law("3", "One moment is decided once: the same moment again changes nothing.", always=True)
def a_moment_is_decided_once(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.Tick) or m.event.t_ns > m.before.t_ns:
        return None
    return True if m.commands == () and m.before == m.after else "the engine had not come to rest"


@law("4.5, 5", "Every state but MISSION_INPUT, OUTREACH, PILOT and MISSION_ENDED has a deadline.", always=True)
def every_wait_has_an_end(m: Moment) -> Verdict:
    if m.after.state in _ENDLESS:
        return None
    end = next_deadline(m.after, m.rules)
    if end is not None:
        return True if end > m.after.t_ns else f"the deadline {end} has passed"
    if m.after.state is State.LAND and _shows(m.saw, m.rules):
        return None
    return f"{m.after.state.value} {m.after.step.value} waits for ever"


@law("3", "Time never runs back.", always=True)
def time_never_runs_back(m: Moment) -> Verdict:
    return True if m.after.t_ns == max(m.before.t_ns, m.event.t_ns) else "it does"


@law("5", "Every user command is answered once, and one that is not done does nothing.")
def every_user_is_answered(m: Moment) -> Verdict:
    if not isinstance(m.event, (ev.UserRequest, ev.MissionSelected)):
        return None
    answers = [c for c in m.commands if isinstance(c, Answer)]
    if len(answers) != 1 or answers[0].request_id != m.event.request_id or not answers[0].message:
        return f"{len(answers)} answers"
    others = m.requests or m.before.state is not m.after.state
    done = answers[0].answer is AnswerKind.DONE
    return True if done or not others or m.event.t_ns > m.before.t_ns else "not done, yet it does something"


@law("5", "A user who lands or aborts in flight is obeyed at once.")
def the_user_lands(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.UserRequest) or m.saw.flight != "armed" or not m.saw.airborne:
        return None
    if m.event.command not in (ev.UserCommand.LAND, ev.UserCommand.ABORT) or m.before.state is State.PILOT:
        return None
    return True if m.after.state in (State.LAND, State.PILOT) or not m.before.in_flight else "not landing"


@law("5", "Every change of place, and every request, stands in exactly one decision of the journal.")
def everything_is_written_down(m: Moment) -> Verdict:
    decisions = [c for c in m.commands if isinstance(c, Decision)]
    written = [text for decision in decisions for text in decision.commands]
    numbers = sorted(int(text.rpartition("#")[2]) for text in written)
    if numbers != sorted(request.id for request in m.requests):
        return f"sent {[r.id for r in m.requests]}, written down {numbers}"
    place = m.before.state.value
    for decision in decisions:
        if decision.before != place:
            return f"from {place} to {decision.before} unwritten"
        place = decision.after
    return True if place == m.after.state.value else f"{m.after.state.value} is not written down"


@law("3, 4", "Nothing but the watchdog restarts anything: the engine has no such command, and asks for no other.")
def the_engine_restarts_nothing(m: Moment) -> Verdict:
    for command in m.commands:
        if type(command) not in _COMMANDS:
            return f"{type(command).__name__} is no command of the engine"
    return True


_COMMANDS = frozenset(
    {
        Answer,
        AutopilotDisarm,
        AutopilotLand,
        Decision,
        LoadMission,
        MissionCommand,
        Notify,
        RunCheck,
        StartRecording,
        StopRecording,
    }
)

# --- data and restarts ------------------------------------------------------------------------------------------------


@law("5 DATA_CLEANUP", "Every started recording ends in a verified merge, or in OUTREACH that names it.")
def recordings_end(m: Moment) -> Verdict:
    if not m.moved or m.after.state not in (State.MISSION_ENDED, State.MISSION_INPUT) or m.was.recording == "none":
        return None
    if m.before.state is State.MISSION_ENDED:
        return None
    if m.saw.recording == "complete":
        return True
    if m.saw.recording in ("named", "stopped") and m.after.result is Result.DATA_INCOMPLETE:
        return True
    return f"the recording is {m.saw.recording}, and it is {m.after.state.value}"


@law("5 DATA_CLEANUP", "A recording is stopped when the flight is over, and only then.")
def recordings_are_stopped(m: Moment) -> Verdict:
    stopped = m.sent(StopRecording)
    entered = m.after.state is State.DATA_CLEANUP and m.moved and m.was.recording != "none"
    if not stopped and not entered:
        return None
    if stopped and not any(isinstance(c, Decision) and c.after == "DATA_CLEANUP" for c in m.commands):
        return f"stopped in {m.after.state.value}"
    return True if stopped else "not stopped"


@law("5 resume, 7", "A restart resumes: it takes off, loads, arms, checks and records nothing anew.", always=True)
def a_restart_starts_nothing(m: Moment) -> Verdict:
    if not isinstance(m.event, ev.EngineStarted) or not m.event.resumed:
        return None
    anew = [a for a in m.motions if a not in (A.LAND, A.ABORT, A.HOLD)]
    timed_out = {State.PREFLIGHT, State.OUTREACH, State.DATA_CLEANUP, State.MISSION_ENDED}
    if anew or (m.requests and m.after.state not in (*timed_out, *_FLIGHT)):
        return f"{anew or m.requests} at a restart"
    if m.before.state in _FLIGHT and m.was.flight == "armed" and m.after.state not in (*_FLIGHT, State.PILOT):
        return None if m.saw.is_down(m.rules.limits) else f"{m.before.state.value} became {m.after.state.value}"
    return True
