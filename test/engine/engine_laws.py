"""What must hold after every single event, whatever happened before: the laws of the engine.

`watch` is an observer for stories; it knows nothing but the state before and after, the event and the commands.
"""

from __future__ import annotations

from typing import Any, List, Tuple

from engine_story import MOTIONS, Story, name_of

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine import timers
from amaze_autonomy.engine.commands import Answer, Decision, Notify, Request, StopRecording
from amaze_autonomy.engine.events import Landed, MissionPhase, Outcome, RecordingPhase, VehicleLanded, checks_of
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.engine.state import DataResult, EngineState, State

FOR_A_PERSON = (State.MISSION_INPUT, State.OUTREACH, State.PILOT, State.MISSION_ENDED)
ON_THE_GROUND = (
    State.MISSION_INPUT,
    State.PREFLIGHT,
    State.OUTREACH,
    State.READY,
    State.START_RECORDING,
    State.LOAD_MISSION,
    State.DATA_CLEANUP,
    State.MISSION_ENDED,
)
ANSWERED = (ev.UserRequest, ev.MissionSelected, ev.MissionRejected)
OF_FAILURES = ("failure_continue", "failure_wait", "failure_land", "failure_pilot", "failure_back", "flown_without")


def watch(story: Story, before: EngineState, event: ev.Event, commands: Tuple[Any, ...]) -> None:
    """Assert every law."""
    after = story.state
    requests = [c for c in commands if isinstance(c, Request)]
    motions = [name_of(c) for c in requests if name_of(c) in MOTIONS]
    _order(commands, motions)
    _numbers(before, after, commands, requests)
    _answers(event, commands)
    _deadline(after, story)
    _landing_is_sticky(before, after, event)
    _pilot(after, motions)
    _abort_lands(before, after, event, commands, story)
    _ground(before, after, motions, story)
    _recording(before, after, commands)
    _states(before, after)
    if "TAKEOFF" in motions:
        _takeoff(before, after, motions, story)


def _order(commands: Tuple[Any, ...], motions: List[str]) -> None:
    kinds = [type(c).__name__ for c in commands]
    if "LAND" in motions:
        assert name_of(commands[0]) == "LAND", "the land command is the first command out"
    if "AutopilotLand" in kinds:
        assert kinds.index("AutopilotLand") <= motions.count("LAND"), "the second route comes right behind"
    told = [isinstance(c, (Answer, Notify)) for c in commands if not isinstance(c, Decision)]
    assert told == sorted(told), "requests before messages"
    written = [isinstance(c, Decision) for c in commands]
    assert written == sorted(written), "decisions come last"


def _numbers(before: EngineState, after: EngineState, commands: Tuple[Any, ...], requests: List[Any]) -> None:
    assert after.t_ns >= before.t_ns, "time does not run back"
    decisions = [c for c in commands if isinstance(c, Decision)]
    assert [d.sequence for d in decisions] == list(range(before.decisions, before.decisions + len(decisions)))
    identities = sorted(c.id for c in requests)
    assert identities == list(range(before.next_id, before.next_id + len(requests))), "each id is new, none is lost"
    named = [text for d in decisions for text in d.commands]
    assert len(named) == len(requests), "every request is in a decision"
    rows = [d for d in decisions if d.rule not in OF_FAILURES]
    assert len(rows) < engine.MAX_ROWS, [d.rule for d in rows]
    if before.state is not after.state or before.step is not after.step:
        assert rows, "nothing moves but by a row"


def _answers(event: ev.Event, commands: Tuple[Any, ...]) -> None:
    answers = [c.request_id for c in commands if isinstance(c, Answer)]
    assert answers == ([event.request_id] if isinstance(event, ANSWERED) else [])


def _deadline(after: EngineState, story: Story) -> None:
    deadline = timers.next_deadline(after, story.rules)
    if after.state in FOR_A_PERSON:
        assert deadline is None, "who waits for a person is not woken"
    else:
        assert deadline is not None, (after.state, after.step, "has no deadline")
        assert deadline > after.t_ns


def _landing_is_sticky(before: EngineState, after: EngineState, event: ev.Event) -> None:
    if before.state is State.LAND:
        assert after.state not in (State.MISSION, State.HOLD, State.TAKEOFF), "once LAND, LAND"
    if before.state is State.LAND and after.state not in (State.LAND, State.PILOT):
        assert not after.flight.active
        status = after.peers.autopilot
        given_up = isinstance(event, ev.UserRequest) and event.command is ev.UserCommand.ACKNOWLEDGE
        assert given_up or status is None or not _flies(status), "landed means disarmed and ON_GROUND"
        if given_up:
            alarmed = before.landing.alarmed or before.landing.lost_alarmed
            assert alarmed, "a landing is given up after the alarm alone"


def _flies(status: ev.AutopilotStatus) -> bool:
    return status.armed is True and status.landed is not VehicleLanded.ON_GROUND


def _pilot(after: EngineState, motions: List[str]) -> None:
    if after.state is State.PILOT:
        assert motions == [], "no command of motion in PILOT"


def _abort_lands(
    before: EngineState, after: EngineState, event: ev.Event, commands: Tuple[Any, ...], story: Story
) -> None:
    if not isinstance(event, ev.WatchdogAction) or not _credible(event.age_ns, story):
        return
    codes = [event.code, *(status.code for status in event.components)]
    elsewhere = before.state not in (State.LAND, State.PILOT) and after.state is not State.PILOT
    if Code.ABORT in codes and before.flight.active and elsewhere and not _in_doubt(after, story):
        assert commands, "code 16 in flight lands"
        assert name_of(commands[0]) == "LAND"


def _in_doubt(after: EngineState, story: Story) -> bool:
    """Whether somebody else has control is open, for at most `pilot_confirm_ns`, or until the next status says so.

    After a restart in flight it is open until the first status, or until the autopilot is lost.
    """
    status, heard_ns = after.peers.autopilot, after.peers.autopilot_ns
    if after.flight.active and status is None and heard_ns is not None:
        return after.t_ns - heard_ns <= story.rules.limits.autopilot_status_limit_ns
    if after.vehicle.takeover is None or status is None:
        return False
    fresh = after.t_ns - after.peers.autopilot_ns <= story.rules.limits.autopilot_status_limit_ns
    waited_ns = after.t_ns - after.vehicle.takeover.since_ns
    agreed = after.vehicle.takeover.statuses > 1 and status.armed is not False
    return fresh and (waited_ns < story.rules.limits.pilot_confirm_ns or not agreed)


def _credible(age_ns: int, story: Story) -> bool:
    return -story.rules.limits.clock_tolerance_ns <= age_ns <= story.rules.limits.status_max_age_ns


def _ground(before: EngineState, after: EngineState, motions: List[str], story: Story) -> None:
    if {"HOLD", "RESUME"} & set(motions):
        assert before.flight.active, "nothing holds or resumes on the ground"
        assert after.flight.active
    if "AutopilotDisarm" in motions:
        status = after.peers.autopilot
        assert status is not None
        assert (status.armed, status.landed) == (True, VehicleLanded.ON_GROUND)
        assert after.t_ns - after.peers.autopilot_ns <= story.rules.limits.autopilot_status_limit_ns
        silent_ns = after.t_ns - (after.peers.landing_ns or 0)
        fresh = after.peers.landing is not None and silent_ns <= story.rules.limits.landing_detection_limit_ns
        assert not (fresh and after.peers.landing.landed is Landed.AIRBORNE)
    if {"LAND", "AutopilotLand", "ABORT"} & set(motions):
        assert before.flight.active or after.flight.active or before.state in (State.LAND, State.TAKEOFF)


def _recording(before: EngineState, after: EngineState, commands: Tuple[Any, ...]) -> None:
    stopped = any(isinstance(c, StopRecording) for c in commands)
    if after.state is State.DATA_CLEANUP and before.state is not State.DATA_CLEANUP and after.recording.asked:
        assert stopped, "a recording that was started is stopped"
    left = before.state is State.DATA_CLEANUP and after.state is not State.DATA_CLEANUP
    if left and before.recording.asked:
        complete = after.peers.recorder is not None and after.peers.recorder.phase is RecordingPhase.COMPLETE
        new_session = after.session.id != before.session.id
        asked = after.state in (State.OUTREACH, State.PILOT, State.LAND)  # LAND: it never had landed
        assert complete or new_session or asked, "merged, or a person is asked"
    if before.recording.asked and before.state not in (State.MISSION_ENDED, State.MISSION_INPUT, State.PILOT):
        same = after.session.id == before.session.id
        by_data = before.state in (State.DATA_CLEANUP, State.OUTREACH)
        assert same or by_data, "a session with a recording ends with its data"
    if before.state is State.OUTREACH and after.state is State.MISSION_ENDED and before.recording.asked:
        assert stopped or after.session.data_result is DataResult.INCOMPLETE, "retried and complete, or given up"


def _states(before: EngineState, after: EngineState) -> None:
    if after.state in ON_THE_GROUND:
        assert not after.flight.active, after.state
    if after.state is State.MISSION_INPUT and before.state is not State.MISSION_INPUT:
        assert after.session.id == ""


def _takeoff(before: EngineState, after: EngineState, motions: List[str], story: Story) -> None:
    limits, now = story.rules.limits, after.t_ns
    assert motions == ["TAKEOFF"], "nothing else is commanded with it"
    assert before.state in (State.LOAD_MISSION, State.MISSION)
    assert [r.check for r in after.preflight.checks] == list(checks_of(story.rules))
    for record in after.preflight.checks:
        assert record.ok, record
        assert record.outcome is Outcome.ACCEPTED
        assert all(row.passed for row in record.rows)
        age_ns = dict(story.rules.max_ages_ns).get(record.check.value, limits.check_max_age_ns)
        assert now - record.replied_ns <= age_ns, "a stale check"
    _fresh_peers(after, story)
    mission = after.session.mission
    assert (after.peers.planner.mission_id, after.peers.planner.phase) == (mission.id, MissionPhase.LOADED)
    assert (after.peers.planner.file_index, after.peers.planner.repetition) == (
        after.session.file_index,
        after.session.repetition,
    )
    for status in after.peers.components:
        tolerated = status.code == Code.NON_CRITICAL and status.name in mission.tolerated
        needed = not mission.required or status.name in mission.required
        assert status.code == Code.NOMINAL or tolerated or not needed, status
    assert not after.shutting_down


def _fresh_peers(after: EngineState, story: Story) -> None:
    limits, now = story.rules.limits, after.t_ns
    status = after.peers.autopilot
    assert (status.armed, status.landed) == (False, VehicleLanded.ON_GROUND)
    assert now - after.peers.autopilot_ns <= limits.autopilot_status_limit_ns
    assert not status.battery_critical
    assert status.battery_fraction is None or status.battery_fraction > limits.battery_critical_fraction
    assert now - after.peers.battery_ns <= limits.battery_age_limit_ns
    assert now - after.peers.planner_ns <= limits.planner_status_limit_ns
    heard_ns = max(after.peers.heartbeat_ns or 0, after.peers.watchdog_started_ns)
    assert now - heard_ns <= limits.watchdog_heartbeat_limit_ns
    assert now - after.peers.recorder_ns <= limits.recorder_status_limit_ns
    assert after.peers.recorder.phase is RecordingPhase.RECORDING
    assert all(platform.growing for platform in after.peers.recorder.platforms)
