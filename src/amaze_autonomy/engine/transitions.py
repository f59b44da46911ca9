"""The transition table: every way from one state to another, every repeated action within one. Nothing else moves it.

How to read it: a row fires when the engine is in one of its `sources` and its guard holds. Rows are tried from the top;
the first that holds wins, so the order is the order of urgency: the pilot, the end of the process, what is complete,
landing, holding, and then the way of a nominal mission. After a row has fired the table is tried again, until none holds.
`target` None stays in the state (and step). The sources name a state for all its steps, or (state, step).

Before the rows the facts are brought up to date (`update.py`), and what is wrong gets its action (`failsafe.py`, with the
tables `SEVERITIES` and `FAILSAFE_CONDITIONS`); what is sent on the way into a state is in `effects.ENTER`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Dict, Mapping, Optional, Tuple, Union

from . import effects as do
from . import flight_guards as flight
from . import guards as ground
from .effects import Effect
from .events import MissionPhase, UserCommand
from .guards import (
    Guard,
    both,
    mission_selected,
    mission_waits,
    needs_request,
    negated,
    next_in_queue,
    not_ready_to_take_off,
    outreach_for,
    shutdown,
    timer,
    user,
    user_calls_off,
    user_ends,
)
from .state import DataResult, OutreachKind, Result, State, Step

Place = Tuple[State, Step]
Source = Union[State, Place]


@dataclass(frozen=True)
class Transition:
    """One row.

    Args:
        rule: its name, as in the journal; unique.
        sources: where it can fire.
        guard: its condition.
        target: where it leads; None: it stays.
        message: entry of the table of messages for the user; empty: none.
        sets: fields of the state, by their path, that it sets before the effects of the new state.
        act: what it does before them.
        words: the condition in words, for the documentation.
        in_doubt: it may fire while it is not clear whether somebody else has control.

    `on_request` follows from the guard: it fires only when the event asks for something.
    """

    rule: str
    sources: Tuple[Source, ...]
    guard: Guard
    target: Optional[Place]
    message: str = ""
    sets: Mapping[str, Any] = field(default_factory=dict)
    act: Optional[Effect] = None
    words: str = ""
    in_doubt: bool = False
    on_request: bool = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "on_request", needs_request(self.guard))


STEPS: Mapping[State, Tuple[Step, ...]] = {
    State.TAKEOFF: (Step.ARMING, Step.LIFTING_OFF, Step.CLIMBING, Step.CANCELLING),
    State.MISSION: (Step.FLYING, Step.TOUCHDOWN),
    State.HOLD: (Step.CONFIRMING, Step.HOLDING, Step.RESUMING),
    State.LAND: (Step.COMMANDING, Step.DESCENDING),
}


def places_of(source: Source) -> Tuple[Place, ...]:
    """Return the (state, step) pairs that a source stands for."""
    if isinstance(source, tuple):
        return (source,)
    return tuple((source, step) for step in STEPS.get(source, (Step.NONE,)))


INPUT, PREFLIGHT, OUTREACH = (State.MISSION_INPUT, Step.NONE), (State.PREFLIGHT, Step.NONE), (State.OUTREACH, Step.NONE)
READY, RECORDING, LOAD = (State.READY, Step.NONE), (State.START_RECORDING, Step.NONE), (State.LOAD_MISSION, Step.NONE)
ARMING, LIFTING_OFF = (State.TAKEOFF, Step.ARMING), (State.TAKEOFF, Step.LIFTING_OFF)
CLIMBING, CANCELLING = (State.TAKEOFF, Step.CLIMBING), (State.TAKEOFF, Step.CANCELLING)
FLYING, TOUCHDOWN = (State.MISSION, Step.FLYING), (State.MISSION, Step.TOUCHDOWN)
CONFIRMING, HOLDING, RESUMING = (State.HOLD, Step.CONFIRMING), (State.HOLD, Step.HOLDING), (State.HOLD, Step.RESUMING)
COMMANDING, DESCENDING = (State.LAND, Step.COMMANDING), (State.LAND, Step.DESCENDING)
PILOT, CLEANUP, ENDED = (State.PILOT, Step.NONE), (State.DATA_CLEANUP, Step.NONE), (State.MISSION_ENDED, Step.NONE)

_FLIGHT: Tuple[Source, ...] = (State.TAKEOFF, FLYING, State.HOLD)
_AIR: Tuple[Source, ...] = (CLIMBING, FLYING, State.HOLD)
_BEFORE: Tuple[Source, ...] = (PREFLIGHT, READY, RECORDING, LOAD)
_EARLY = {"session.result": Result.LANDED_EARLY}
_NOT_FLOWN = {"session.result": Result.NOT_FLOWN}
_BY_PILOT = {"session.result": Result.PILOT}
_FOR_CHECKS = {"session.outreach": OutreachKind.PREFLIGHT}
_FOR_DATA = {"session.outreach": OutreachKind.DATA}
_INCOMPLETE = {"session.data_result": DataResult.INCOMPLETE}
_PLANNER_GOES_ON = flight.planner_in(
    MissionPhase.FLYING, MissionPhase.TAKING_OFF, MissionPhase.LANDING, MissionPhase.LANDED
)
T = Transition

# One row a line.
# fmt: off
TRANSITIONS: Tuple[Transition, ...] = (
    # the pilot
    T("takeover_suspected", (*_FLIGHT, State.LAND), flight.takeover_begins, None, "takeover_suspected", {"flight.takeover_noted": True}, words="two statuses say that somebody else has control: nothing is commanded until more agree or deny it", in_doubt=True),
    T("takeover_denied", (*_FLIGHT, State.LAND), flight.takeover_denied, None, "takeover_denied", {"flight.takeover_noted": False}, words="the vehicle answers to us: what failed meanwhile is answered"),
    T("pilot_took_over", (*_FLIGHT, State.LAND), flight.taken_over, PILOT, "pilot", _BY_PILOT, words="the pilot, or a failsafe of the autopilot, has control"),
    T("pilot_had_control_at_start", (INPUT, OUTREACH, CLEANUP, ENDED, *_BEFORE), both(flight.started_armed, flight.taken_over), PILOT, "pilot", _BY_PILOT, do.adopt_flight, "started while armed, pilot in control"),
    T("started_armed", (INPUT, OUTREACH, CLEANUP, ENDED, *_BEFORE), flight.started_armed, COMMANDING, "land", {}, do.adopt_flight, "started while armed, no flight to resume"),
    T("still_flying", (TOUCHDOWN, CLEANUP, OUTREACH, ENDED), flight.still_flies, COMMANDING, "land", {}, do.adopt_flight, "its flight seemed over, and it is still in the air"),
    T("armed_late", (INPUT, OUTREACH, CLEANUP, ENDED, *_BEFORE), flight.armed_late, COMMANDING, "land", {}, do.adopt_late_arming, "an ARM of ours took effect after its takeoff was called off: disarmed on the ground, landed in the air"),
    T("armed_after_flight", (CLEANUP,), flight.armed_by_others, PILOT, "pilot", words="armed while the data is collected, and not by us; the flight keeps its result"),
    T("armed_before_data_is_complete", (OUTREACH,), both(flight.armed_by_others, outreach_for(OutreachKind.DATA)), PILOT, "pilot", words="armed while the data waits for a person; the flight keeps its result"),
    T("armed_by_others", (INPUT, OUTREACH, *_BEFORE, CLIMBING, State.MISSION, State.HOLD), flight.armed_by_others, PILOT, "pilot", _BY_PILOT, words="armed, and not by us"),
    # the end of the process
    T("shutdown_in_flight", _FLIGHT, both(shutdown, flight.in_flight), COMMANDING, "shutdown", {**_EARLY, "landing.both_routes": True}, words="told to end in flight"),
    T("shutdown_while_landing", (State.LAND,), shutdown, None, "shutdown", {}, do.land_both, "told to end while landing"),
    T("shutdown_before_takeoff", _BEFORE, both(shutdown, ground.something_recorded), CLEANUP, "data_cleanup", _NOT_FLOWN, words="told to end with a recording running"),
    T("shutdown_in_outreach", (OUTREACH,), both(shutdown, ground.something_recorded, outreach_for(OutreachKind.PREFLIGHT)), CLEANUP, "data_cleanup", _NOT_FLOWN, words="told to end with a recording running"),
    T("shutdown_unrecorded", (OUTREACH, *_BEFORE), both(shutdown, ground.nothing_recorded), INPUT, "mission_input", {}, do.drop_queue, "told to end with nothing recorded"),
    T("shutdown_between_files", (TOUCHDOWN,), shutdown, CLEANUP, "data_cleanup", _EARLY, words="told to end between two files"),
    # what is complete
    T("not_disarmed", (CLIMBING, FLYING), both(flight.in_flight, flight.stays_armed), COMMANDING, "land_on_ground", _EARLY, words="it stays armed on the ground, whatever it is told"),
    T("grounded_in_mission", (FLYING,), both(flight.in_flight, flight.ground_armed, negated(flight.lands)), COMMANDING, "land_on_ground", _EARLY, words="it stands on the ground, armed, and the planner flies on"),
    T("disarm_after_mission", (FLYING,), both(flight.planner_in(MissionPhase.LANDING, MissionPhase.LANDED), flight.ground_armed), None, "disarm", {}, do.disarm, "the planner lands or has landed, and it stays armed on the ground"),
    T("mission_complete", (FLYING,), both(flight.file_done, flight.last_leg), CLEANUP, "data_cleanup", {"session.result": Result.COMPLETE}, words="last waypoint done, landed and disarmed"),
    T("touchdown", (FLYING,), flight.file_done, TOUCHDOWN, "touchdown", words="a file is done, landed and disarmed; more are to come"),
    T("landing_given_up", (State.LAND,), both(user(UserCommand.ACKNOWLEDGE), flight.nobody_knows), CLEANUP, "landing_given_up", _EARLY, do.give_up_landing, words="the pilot was alarmed, the vehicle is silent, unknown or long disarmed, and a person ends the mission"),
    T("landed", (State.LAND,), flight.touched_down, CLEANUP, "data_cleanup", words="landed and disarmed"),
    T("cancelled_by_landing", (State.LAND,), flight.cancelled_on_ground, CLEANUP, "data_cleanup", _NOT_FLOWN, words="never armed, and the landing was accepted"),
    T("landed_unexpectedly", (CLIMBING, FLYING, State.HOLD), both(flight.touched_down, timer("confirm_limit")), CLEANUP, "data_cleanup", _EARLY, words="landed and disarmed, the planner does not say that the mission is done"),
    T("landed_unheard", (LIFTING_OFF, CANCELLING), flight.flown_unheard, CLEANUP, "data_cleanup", _EARLY, words="disarmed on the ground, and the planner says that it has flown meanwhile"),
    # land
    T("takeoff_failed", (ARMING,), flight.takeoff_failed, OUTREACH, "takeoff_refused", {**_FOR_CHECKS, "flight.active": False}, words="the planner says that the takeoff failed, and it is disarmed on the ground"),
    T("land_by_both_routes", _FLIGHT, flight.must_land_both, COMMANDING, "land", {**_EARLY, "landing.both_routes": True}, words="planner or autopilot is lost"),
    T("land", _FLIGHT, flight.must_land, COMMANDING, "land", _EARLY, words="something means to land"),
    T("user_land", _FLIGHT, user(UserCommand.LAND), COMMANDING, "land_user", _EARLY, words="the user asks for it"),
    T("user_abort_in_flight", _AIR, user(UserCommand.ABORT), COMMANDING, "land_user", _EARLY, words="the user aborts, airborne"),
    T("takeoff_not_cancelled", (CANCELLING,), flight.airborne, COMMANDING, "land", _EARLY, words="airborne although the takeoff was cancelled"),
    T("cancel_unconfirmed", (CANCELLING,), both(timer("cancel_limit"), negated(flight.down)), COMMANDING, "land", _EARLY, words="not disarmed in time"),
    T("lift_off_unknown", (LIFTING_OFF,), both(timer("lift_off_limit"), negated(flight.on_the_ground)), COMMANDING, "land", _EARLY, words="armed, and whether it flies is unknown"),
    T("takeoff_height_not_reached", (CLIMBING,), both(flight.in_flight, timer("takeoff_limit")), COMMANDING, "land", _EARLY, words="below takeoff height in time, or unknown"),
    T("hold_refused", (CONFIRMING,), both(flight.in_flight, flight.motion_refused), COMMANDING, "land", _EARLY, words="the hold is refused"),
    T("hold_unconfirmed", (CONFIRMING,), both(flight.in_flight, timer("hold_confirm_limit")), COMMANDING, "land", _EARLY, words="the hold is not confirmed in time"),
    T("grounded_while_holding", (State.HOLD,), both(flight.in_flight, flight.stands), COMMANDING, "land_on_ground", _EARLY, words="it stands on the ground: nothing is held or resumed there"),
    T("resume_refused", (RESUMING,), both(flight.in_flight, flight.motion_refused), COMMANDING, "land", _EARLY, words="the resume is refused"),
    T("resume_unconfirmed", (RESUMING,), both(flight.in_flight, timer("resume_confirm_limit")), COMMANDING, "land", _EARLY, words="the resume is not confirmed in time"),
    # while landing
    T("autopilot_lost_alarm", (State.LAND,), flight.must_alarm, None, "autopilot_lost", {"landing.both_routes": True, "landing.lost_alarmed": True}, words="the vehicle is not heard, or not whether it flies: alarm to the pilot"),
    T("both_routes_needed", (State.LAND,), both(flight.must_land_both, flight.one_route_only), None, "land_both_routes", {}, do.land_both, "planner or autopilot is lost while landing"),
    T("disarm_on_ground", (State.LAND,), flight.ground_armed, None, "disarm", {}, do.disarm, "on the ground but armed for a while"),
    T("stays_armed_alarm", (State.LAND,), both(flight.in_flight, flight.stays_armed, negated(flight.contradicted), flight.not_armed_alarmed), None, "stays_armed", {"landing.armed_alarmed": True}, words="on the ground but armed for long: alarm to the pilot"),
    T("landing_not_shown", (DESCENDING,), both(flight.vehicle_heard, negated(flight.landing_shown)), COMMANDING, words="the vehicle no longer shows that it lands, or the limit has passed"),
    T("landing_shown", (COMMANDING,), flight.landing_shown, DESCENDING, "land_shown", words="landing mode, sustained descent, or on the ground"),
    T("land_limit", (State.LAND,), both(timer("land_limit"), flight.not_overdue_alarmed), None, "land_limit", {"landing.overdue_alarmed": True}, do.alarm, "not landed in time: alarm, both routes repeat"),
    T("land_alarm", (COMMANDING,), both(timer("land_alarm_after"), flight.not_alarmed), None, "land_alarm", {}, do.alarm, "neither route is answered: alarm to the pilot"),
    T("land_second_route", (COMMANDING,), both(timer("land_second_route_after"), flight.one_route_only), None, "land_second_route", {"landing.both_routes": True}, do.land, "not shown after a while: the autopilot too"),
    T("land_repeat", (COMMANDING,), timer("land_repeat_period"), None, "", {}, do.land, "not shown yet: repeated"),
    # before lift-off
    T("takeoff_refused", (ARMING,), both(flight.motion_refused, flight.stays_down), OUTREACH, "takeoff_refused", {**_FOR_CHECKS, "flight.active": False}, words="the takeoff is refused"),
    T("takeoff_refused_unclear", (ARMING,), both(flight.motion_refused, negated(flight.airborne)), CANCELLING, "takeoff_cancelled", words="the takeoff is refused, the vehicle's state is not known"),
    T("cancelled", (CANCELLING,), flight.cancelled, OUTREACH, "takeoff_refused", {**_FOR_CHECKS, "flight.active": False}, words="disarmed on the ground"),
    T("cancelled_late", (CANCELLING,), both(timer("cancel_limit"), flight.stays_down), OUTREACH, "takeoff_refused", {**_FOR_CHECKS, "flight.active": False}, words="still disarmed on the ground at the limit"),
    T("failure_before_lift_off", (ARMING, LIFTING_OFF), both(negated(flight.airborne), flight.must_wait), CANCELLING, "takeoff_cancelled", words="something would be waited for, and it has not lifted off"),
    T("user_abort_before_lift_off", (ARMING, LIFTING_OFF), user(UserCommand.ABORT), CANCELLING, "takeoff_cancelled", words="the user aborts before lift-off"),
    T("lifted_off", (ARMING, LIFTING_OFF), flight.airborne, CLIMBING, words="it has left the ground"),
    T("armed", (ARMING,), flight.armed, LIFTING_OFF, words="it is armed"),
    T("not_armed", (ARMING,), timer("arm_limit"), CANCELLING, "takeoff_cancelled", words="not armed in time"),
    T("disarmed_before_lift_off", (LIFTING_OFF,), flight.stays_down, CANCELLING, "takeoff_cancelled", words="disarmed again before lift-off"),
    T("no_lift_off", (LIFTING_OFF,), timer("lift_off_limit"), CANCELLING, "takeoff_cancelled", words="armed, but no lift-off in time"),
    # hold
    T("user_hold", (CLIMBING, FLYING), user(UserCommand.HOLD), CONFIRMING, "user_hold", {}, do.ask_hold, "the user asks for it"),
    T("user_hold_too", (State.HOLD,), user(UserCommand.HOLD), None, "user_hold", {}, do.ask_hold, "the user asks for it while it holds"),
    T("user_resume", (State.HOLD,), user(UserCommand.RESUME), None, "", {}, do.end_hold, "the user asks to go on"),
    T("hold", (CLIMBING, FLYING), both(flight.must_wait, negated(flight.on_the_ground), negated(flight.lands)), CONFIRMING, "hold", words="something is waited for, and it neither lands nor stands on the ground"),
    T("hold_again", (RESUMING,), both(flight.must_wait, negated(flight.lands), negated(flight.on_the_ground)), CONFIRMING, "hold", words="something is waited for while resuming"),
    T("hold_confirmed", (CONFIRMING,), both(flight.planner_in(MissionPhase.HOLDING), flight.hold_shown), HOLDING, words="the planner says that it holds, and flight mode or standing still shows it"),
    T("hold_repeated", (CONFIRMING,), both(flight.in_flight, timer("hold_repeat_after"), flight.hold_not_repeated, negated(flight.lands), negated(flight.on_the_ground)), None, "", {}, do.hold_again, "nothing shows the hold: asked again, once"),
    T("hold_flown_on", (HOLDING,), both(flight.in_flight, flight.moves_on, negated(flight.lands), negated(flight.on_the_ground)), CONFIRMING, "hold_not_kept", words="it flies on although the planner says that it holds"),
    T("hold_not_kept", (HOLDING,), both(flight.in_flight, flight.planner_in(MissionPhase.FLYING, MissionPhase.TAKING_OFF), negated(flight.lands), negated(flight.on_the_ground)), CONFIRMING, "hold_not_kept", words="the planner does not hold any more"),
    T("resume", (HOLDING,), both(flight.nothing_waited_for, flight.vehicle_known, negated(flight.lands), negated(flight.on_the_ground)), RESUMING, "resuming", words="nothing is waited for any more, the vehicle is heard, and it does not land"),
    T("takeoff_resumed", (RESUMING,), both(flight.interrupted(State.TAKEOFF), _PLANNER_GOES_ON), CLIMBING, "resumed_flight", words="the planner goes on; a takeoff was interrupted"),
    T("mission_resumed", (RESUMING,), both(flight.interrupted(State.MISSION), _PLANNER_GOES_ON), FLYING, "resumed_flight", words="the planner goes on; the mission was interrupted"),
    # the way of a nominal mission
    T("was_away", _BEFORE, ground.was_away, OUTREACH, "was_away", _FOR_CHECKS, words="the engine was away for so long that a person says whether the mission goes on"),
    T("mission_selected", (INPUT,), mission_selected, PREFLIGHT, "preflight", {}, do.queue_missions, "a valid mission is confirmed"),
    T("next_mission", (INPUT,), mission_waits, PREFLIGHT, "preflight", words="a mission waits in the queue"),
    T("user_give_up_before_recording", _BEFORE, both(user_ends, ground.nothing_recorded), INPUT, "mission_input", {}, do.drop_queue, "the user gives up, aborts or lands; nothing was recorded"),
    T("user_give_up", _BEFORE, user_ends, CLEANUP, "data_cleanup", _NOT_FLOWN, do.say_who, "the user gives up, aborts or lands; something was recorded"),
    T("checks_passed_too_often", (PREFLIGHT,), both(ground.all_checks_passed, ground.too_many_rounds), OUTREACH, "no_takeoff", _FOR_CHECKS, words="passed, but Ready expired or was revoked too often"),
    T("checks_passed", (PREFLIGHT,), both(ground.all_checks_passed, negated(ground.revoked)), READY, words="all checks pass, and nothing revokes Ready"),
    T("checks_not_kept", (PREFLIGHT,), both(ground.all_checks_passed, ground.revoked, timer("preflight_fix_limit")), OUTREACH, "checks_failed", _FOR_CHECKS, words="all checks pass, but what revokes Ready does not end in time"),
    T("checks_failed", (PREFLIGHT,), ground.checks_failed, OUTREACH, "checks_failed", _FOR_CHECKS, words="a check fails, and cannot be fixed, or not in time"),
    T("checks_repeated", (PREFLIGHT,), ground.fix_in_progress, None, "preflight_fixing", {}, do.run_checks, "the watchdog fixes it: asked again"),
    T("checks_too_old", (PREFLIGHT,), both(ground.answers_too_old, timer("preflight_fix_limit")), OUTREACH, "checks_failed", _FOR_CHECKS, words="the answers do not get complete in time while they are fresh"),
    T("checks_asked_again", (PREFLIGHT,), ground.answers_too_old, None, "", {}, do.run_checks, "the first answers are too old when the last one comes: all are asked again"),
    T("ready_revoked", (READY, RECORDING, LOAD), ground.revoked, PREFLIGHT, "ready_revoked", words="a component fails between Ready and takeoff"),
    T("go", (READY,), user(UserCommand.GO), RECORDING, "start_recording", words="the operator's go"),
    T("go_not_required", (READY,), ground.go_not_required, RECORDING, "start_recording", words="no go is required"),
    T("ready_too_old", (READY,), timer("ready_limit"), PREFLIGHT, "ready_old", words="no go in time"),
    T("recording_refused", (RECORDING,), ground.recording_refused, OUTREACH, "recording_refused", _FOR_CHECKS, words="the recorder refuses or fails"),
    T("recording_proven", (RECORDING,), ground.recording_proven, LOAD, "load_mission", words="files grow on every platform, and the lead time has passed"),
    T("recording_not_proven", (RECORDING,), timer("recording_start_limit"), OUTREACH, "recording_refused", _FOR_CHECKS, words="not proven in time"),
    T("planner_refused", (LOAD,), ground.planner_refused, OUTREACH, "planner_refused", _FOR_CHECKS, words="the planner refuses, or is not there"),
    T("check_failed_before_takeoff", (LOAD,), ground.check_failed, PREFLIGHT, "check_failed", words="a check fails when asked again"),
    T("takeoff", (LOAD,), both(ground.all_checks_passed, ground.planner_confirmed, negated(not_ready_to_take_off)), ARMING, "takeoff", words="the planner confirms, all checks pass and are fresh, and nothing known forbids it"),
    T("not_ready_to_take_off", (LOAD,), both(ground.planner_confirmed, timer("load_limit"), not_ready_to_take_off), OUTREACH, "takeoff_refused", _FOR_CHECKS, words="something known would end the flight at once"),
    T("checks_expired", (LOAD,), both(ground.all_answered_values, timer("check_max_age")), PREFLIGHT, "check_failed", words="the checks are too old"),
    T("planner_silent", (LOAD,), timer("load_limit"), OUTREACH, "planner_refused", _FOR_CHECKS, words="the planner does not confirm in time"),
    T("user_ends_touchdown", (TOUCHDOWN,), user_ends, CLEANUP, "data_cleanup", _EARLY, do.say_who, "the user lands, aborts or gives up on the ground"),
    T("next_takeoff_failed", (TOUCHDOWN,), ground.next_takeoff_failed, CLEANUP, "next_takeoff_failed", _EARLY, words="a check fails, the planner refuses, or a limit passes"),
    T("next_takeoff", (TOUCHDOWN,), both(ground.all_checks_passed, ground.planner_confirmed, negated(not_ready_to_take_off)), ARMING, "takeoff", words="the planner confirms, all checks pass and are fresh, and nothing known forbids it"),
    T("at_takeoff_height", (CLIMBING,), flight.at_takeoff_height, FLYING, "mission", words="airborne and at takeoff height"),
    # after the flight
    T("acknowledged", (PILOT,), both(user(UserCommand.ACKNOWLEDGE), flight.heard_down), CLEANUP, "data_cleanup", words="on the ground, disarmed, acknowledged"),
    T("acknowledged_unknown", (PILOT,), user(UserCommand.ACKNOWLEDGE), CLEANUP, "landing_given_up", {}, do.lose_sight, "the vehicle has been silent, unknown or disarmed for long, and a person ends the mission"),
    T("user_calls_off", (CLEANUP, OUTREACH), both(user_calls_off, mission_waits), None, "", {}, do.drop_queue, "the user lands or aborts, or gives up while data is collected: no other mission takes off"),
    T("nothing_to_collect", (CLEANUP,), ground.nothing_recorded, ENDED, "mission_ended", words="nothing was recorded"),
    T("data_lost", (CLEANUP,), ground.data_lost, ENDED, "mission_ended_incomplete", _INCOMPLETE, words="merged and verified, but something of the flight was not recorded"),
    T("data_complete", (CLEANUP,), ground.data_complete, ENDED, "mission_ended", {"session.data_result": DataResult.COMPLETE}, words="written, transferred, merged, verified"),
    T("data_incomplete", (CLEANUP,), ground.data_incomplete, OUTREACH, "data_incomplete", _FOR_DATA, words="the recorder refuses, fails, or is silent"),
    T("data_limit", (CLEANUP,), timer("data_cleanup_limit"), OUTREACH, "data_incomplete", _FOR_DATA, words="not complete in time"),
    T("retry_data", (OUTREACH,), both(user(UserCommand.RETRY), outreach_for(OutreachKind.DATA)), CLEANUP, "data_cleanup", words="the user retries the data"),
    T("give_up_data", (OUTREACH,), both(user(UserCommand.GIVE_UP), outreach_for(OutreachKind.DATA)), ENDED, "mission_ended_incomplete", _INCOMPLETE, do.drop_queue, "the user gives up on the data; nothing is deleted"),
    T("retry", (OUTREACH,), user(UserCommand.RETRY), PREFLIGHT, "preflight", {}, do.forgive, "the user retries; a running recording is kept"),
    T("give_up_unrecorded", (OUTREACH,), both(user(UserCommand.GIVE_UP), ground.nothing_recorded), INPUT, "mission_input", {}, do.drop_queue, "the user gives up; nothing was recorded"),
    T("give_up", (OUTREACH,), user(UserCommand.GIVE_UP), CLEANUP, "data_cleanup", _NOT_FLOWN, words="the user gives up; something was recorded"),
    T("select_next", (ENDED,), mission_selected, INPUT, "", {}, do.queue_missions, "the user selects the next mission"),
    T("next_in_queue", (ENDED,), next_in_queue, INPUT, words="a further mission was selected, and this one is complete"),
)
# fmt: on


def _index() -> Mapping[Place, Tuple[Transition, ...]]:
    found: Dict[Place, Tuple[Transition, ...]] = {}
    for state in State:
        for place in places_of(state):
            found[place] = tuple(
                row for row in TRANSITIONS if any(place in places_of(source) for source in row.sources)
            )
    return found


ROWS_AT: Mapping[Place, Tuple[Transition, ...]] = _index()
