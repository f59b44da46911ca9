"""Random stories: everything that can happen, in any order, with hostile values; the laws hold after every event.

Stories begin anywhere, peers answer nominally until they are told to lie, and now and then an event comes from nowhere.
`HYPOTHESIS_PROFILE=search` looks longer and elsewhere.
"""

from __future__ import annotations

import os
from collections import Counter
from typing import Any, Dict

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import COMPONENTS, MISSION, S
from engine_story import Story
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test

from amaze_autonomy.engine import decide as engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import Decision
from amaze_autonomy.engine.events import Check, CheckName, Mission, Verdict
from amaze_autonomy.engine.rules import Code, Restart, Severity
from amaze_autonomy.engine.state import State
from amaze_autonomy.journal import journal
from amaze_autonomy.journal.report import report

pytestmark = pytest.mark.long

STREAMS = ("watchdog", "autopilot", "planner", "recorder", "landing")
SEARCH = os.environ.get("HYPOTHESIS_PROFILE") == "search"
STORIES, STEPS, LISTS = (4000, 40, 8000) if SEARCH else (200, 30, 300)

# --- hostile values ---------------------------------------------------------------------------------------------------

names = st.sampled_from([*(rule.name for rule in COMPONENTS), "unheard of", ""])
codes = st.sampled_from(list(Code))
sessions = st.sampled_from(["", "test-001", "test-002", "other"])
numbers = st.none() | st.floats() | st.sampled_from([0.0, -1.0, 0.15, 30.1, 1e300, -1e300])
ages = st.sampled_from([0, 0, 0, S // 10, S, S + 1, -S // 5, -S // 5 - 1, 10**18, -(10**18)])
texts = st.sampled_from(["", "why", "{brace}", "ä\n\x00"])
missions = st.builds(
    Mission,
    id=st.sampled_from(["1", "2"]),
    files=st.integers(1, 2),
    repetitions=st.integers(1, 2),
    battery_needed_fraction=st.none() | st.floats(0, 1),
    severities=st.lists(st.tuples(names, st.sampled_from(list(Severity))), max_size=2).map(tuple),
    required=st.lists(names, max_size=2).map(tuple),
    tolerated=st.lists(names, max_size=2).map(tuple),
    max_flight_time_ns=st.none() | st.integers(1, 10 * S),
)
statuses = st.builds(
    ev.ComponentStatus,
    name=names,
    code=codes,
    restart=st.sampled_from(list(Restart)),
    until_ns=st.none() | st.integers(0, 10**12),
    reason=texts,
)
rows = st.builds(Check, name=texts, verdict=st.sampled_from(list(Verdict)), value=numbers, limit=numbers)
platforms = st.builds(ev.PlatformRecording, platform=texts, growing=st.booleans(), byte_rate=numbers)
identities = st.integers(-1, 40)
EVENTS: Dict[Any, Dict[str, Any]] = {
    ev.Tick: {},
    ev.EngineStarted: {"label": st.just("test"), "resumed": st.booleans()},
    ev.MissionSelected: {"missions": st.lists(missions, min_size=1, max_size=3).map(tuple), "request_id": identities},
    ev.MissionRejected: {"mission_id": texts, "error": texts, "request_id": identities},
    ev.UserRequest: {"command": st.sampled_from(list(ev.UserCommand)), "request_id": identities, "by": texts},
    ev.WatchdogAction: {
        "sequence": st.integers(0, 9),
        "loop_counter": st.integers(0, 3),
        "code": codes,
        "latest_component": names,
        "components": st.lists(statuses, max_size=3).map(tuple),
        "age_ns": ages,
    },
    ev.WatchdogInfo: {
        "sequence": st.integers(0, 9),
        "changed": st.just(()),
        "components": st.lists(statuses, max_size=3).map(tuple),
        "age_ns": ages,
    },
    ev.CheckReply: {
        "command_id": identities,
        "check": st.sampled_from(list(CheckName)),
        "outcome": st.sampled_from(list(ev.Outcome)),
        "ok": st.booleans(),
        "checks": st.lists(rows, max_size=2).map(tuple),
        "fixable": st.booleans(),
        "being_fixed": st.booleans(),
        "until_ns": st.none() | st.integers(0, 10**12),
        "components": st.lists(statuses, max_size=1).map(tuple),
        "message": texts,
    },
    ev.Reply: {"command_id": identities, "outcome": st.sampled_from(list(ev.Outcome)), "message": texts},
    ev.MissionStatus: {
        "session_id": sessions,
        "mission_id": st.sampled_from(["1", "2", ""]),
        "phase": st.sampled_from(list(ev.MissionPhase)),
        "waypoint": st.integers(0, 3),
        "waypoints": st.integers(0, 3),
        "file_index": st.integers(0, 2),
        "repetition": st.integers(0, 2),
        "distance_left_m": numbers,
        "message": texts,
        "age_ns": ages,
    },
    ev.RecordingStatus: {
        "session_id": sessions,
        "phase": st.sampled_from(list(ev.RecordingPhase)),
        "progress": numbers,
        "platforms": st.lists(platforms, max_size=2).map(tuple),
        "location": texts,
        "message": texts,
        "age_ns": ages,
    },
    ev.AutopilotStatus: {
        "armed": st.none() | st.booleans(),
        "landed": st.sampled_from(list(ev.VehicleLanded)),
        "mode": st.sampled_from(["", "AUTO.LAND", "AUTO.LOITER", "AUTO.MISSION", "AUTO.TAKEOFF", "OFFBOARD", "POSCTL"]),
        "pilot_in_control": st.sampled_from([False, False, False, True]),
        "failsafe": st.sampled_from([False, False, False, True]),
        "link_age_s": st.just(0.0) | numbers,
        "height_m": numbers,
        "position_x_m": numbers,
        "position_y_m": numbers,
        "vertical_speed_m_s": numbers,
        "horizontal_speed_m_s": numbers,
        "battery_fraction": st.just(0.9) | numbers,
        "battery_age_s": st.just(0.1) | numbers,
        "battery_critical": st.sampled_from([False, False, False, True]),
        "age_ns": ages,
    },
    ev.LandedStatus: {
        "landed": st.sampled_from(list(ev.Landed)),
        "distance_m": numbers,
        "reason": texts,
        "age_ns": ages,
    },
    ev.ClockStatus: {"stalled_s": st.sampled_from([0.0, 0.5, 3.0])},
    ev.Shutdown: {"signal": st.sampled_from(["SIGINT", "SIGTERM"])},
}
times = st.sampled_from([0, 0, 0, 1, S // 10, S // 2, S, 5 * S, 30 * S, -1, -S, -(10**18)])


def event_fields(kind: Any) -> Any:
    return st.tuples(st.just(kind), times, st.fixed_dictionaries(EVENTS[kind]))


any_event = st.one_of([event_fields(kind) for kind in EVENTS])


def test_every_class_of_events_is_among_them():
    known = {value for value in vars(ev).values() if isinstance(value, type) and issubclass(value, ev.Event)}
    assert known - {ev.Event} == set(EVENTS)


# --- random stories ---------------------------------------------------------------------------------------------------

SEEN: Counter = Counter()


def count(story: Story, _: Any, __: ev.Event, commands: Any) -> None:
    SEEN[f"{story.state.state.value} {story.state.step.value}".strip()] += 1
    for command in commands:
        if isinstance(command, Decision):
            SEEN[command.rule] += 1


def pure(story: Story, before: Any, event: ev.Event, commands: Any) -> None:
    """Assert that the same inputs give the same outputs; asked of one event in seven, for speed."""
    if story.state.decisions % 7 == 0:
        snapshot = dict(vars(before))
        assert engine.decide(before, event, story.rules) == (story.state, commands)
        assert vars(before) == snapshot
        report(story.state, story.rules)


# Flights twice: they are what the laws are about, and they end by themselves.
beginnings = st.sampled_from([*BEGINNINGS, *(p for p in BEGINNINGS if p.split()[0] in ("TAKEOFF", "MISSION", "HOLD"))])


class Flight(RuleBasedStateMachine):
    """A story that goes on at random."""

    first = "MISSION_INPUT"

    @initialize()
    def the_first_story_begins(self):
        self.begin(self.first)

    def begin(self, place):
        self.story = at(place)
        self.story.watch = [count, pure]

    @rule(place=beginnings)
    def another_story_begins(self, place):
        self.begin(place)

    @rule(seconds=st.sampled_from([0.05, 0.3, 0.7, 1.2, 4.0]))
    def time_passes(self, seconds):
        self.story.after(seconds)

    @rule()
    def everything_is_well(self):
        story = self.story
        story.silent, story.disobeyed, story.answers, story.check_says = [], [], {}, {}
        story.vehicle.says, story.planner.says, story.recorder.says = {}, {}, {}
        story.vehicle.obeys, story.landing_says, story.watchdog.stuck = True, None, False
        for component in COMPONENTS:
            story.fail(component.name, 1, tell=False)
        story.tell().after(2.0)

    @rule(name=names.filter(bool), code=codes, restart=st.sampled_from(["none", "trying", "given_up"]))
    def component_changes(self, name, code, restart):
        self.story.fail(name, int(code), restart)

    @rule(command=st.sampled_from([command.value for command in ev.UserCommand]))
    def user_asks(self, command):
        self.story.user(command)

    @rule(chosen=st.just((MISSION,)) | st.lists(missions, min_size=1, max_size=2).map(tuple))
    def user_selects(self, chosen):
        self.story.missions = chosen
        self.story.select(*chosen)

    @rule(stream=st.sampled_from(STREAMS))
    def a_stream_falls_silent(self, stream):
        self.story.silent.append(stream)

    @rule(
        key=st.sampled_from(
            ["armed", "landed", "mode", "height_m", "battery_fraction", "link_age_s", "pilot_in_control"]
        ),
        data=st.data(),
    )
    def the_vehicle_says_something_else(self, key, data):
        self.story.say(**{key: data.draw(EVENTS[ev.AutopilotStatus][key])})

    @rule(
        name=st.sampled_from(
            ["TAKEOFF", "HOLD", "RESUME", "LAND", "ABORT", "LoadMission", "StartRecording", "StopRecording"]
        )
    )
    def a_command_is_disobeyed(self, name):
        self.story.disobeyed.append(name)

    @rule(
        name=st.sampled_from(["TAKEOFF", "HOLD", "RESUME", "LAND", "LoadMission", "StartRecording", "StopRecording"]),
        outcome=st.none() | st.sampled_from(list(ev.Outcome)),
    )
    def a_command_is_answered_otherwise(self, name, outcome):
        self.story.answers[name] = outcome

    @rule(
        check=st.sampled_from(list(CheckName)),
        said=st.fixed_dictionaries({"ok": st.booleans(), "fixable": st.booleans()}),
    )
    def a_check_says_something_else(self, check, said):
        self.story.check_says[check.value] = said

    @rule(phase=st.sampled_from(list(ev.MissionPhase)))
    def the_planner_says_something_else(self, phase):
        self.story.planner.says["phase"] = phase

    @rule(phase=st.sampled_from(list(ev.RecordingPhase)))
    def the_recorder_does_something_else(self, phase):
        self.story.recorder.phase = phase
        self.story.report()

    @rule(said=st.sampled_from(list(ev.Landed)))
    def the_landing_detection_says_something_else(self, said):
        self.story.landing_says = said

    @rule(happened=any_event)
    def something_comes_from_nowhere(self, happened):
        kind, after_ns, fields = happened
        self.story.feed(kind, t_ns=max(0, self.story.now + after_ns), **fields)
        self.story.now = max(self.story.now, self.story.state.t_ns)
        self.story.beat = max(self.story.beat, self.story.now)

    @precondition(lambda self: self.story.place in (("TAKEOFF", "climbing"), ("MISSION", "flying")))
    @rule(failure=st.sampled_from([("lrf", 8), ("realsense_camera", 4), ("magnetometer", 4), ("unheard of", 8)]))
    def something_is_waited_for(self, failure):
        self.story.disobeyed, self.story.silent = [], []
        self.story.fail(*failure).after(0.4)

    @precondition(lambda self: self.story.state.state is State.HOLD)
    @rule(seconds=st.sampled_from([0.0, 1.0, 4.0, 9.0]))
    def what_is_waited_for_comes_back(self, seconds):
        self.story.disobeyed, self.story.silent = [], []
        self.story.after(seconds)
        for component in COMPONENTS:
            self.story.fail(component.name, 1, tell=False)
        self.story.tell().user("resume")
        self.story.after(0.7)

    @precondition(lambda self: self.story.state.state in (State.MISSION_INPUT, State.MISSION_ENDED, State.OUTREACH))
    @rule()
    def the_user_wants_to_fly(self):
        self.everything_is_well()
        self.story.user("retry")
        self.story.missions = (MISSION,)
        self.story.select().after(4.0)

    @precondition(lambda self: self.story.state.flight.active and self.story.state.flight.was_armed)
    @rule(mode=st.sampled_from(["POSCTL", "AUTO.RTL", "AUTO.LAND"]))
    def the_pilot_takes_over(self, mode):
        self.story.say(armed=True, mode=mode, pilot_in_control=True, link_age_s=0.0)

    @precondition(lambda self: self.story.state.flight.active)
    @rule()
    def the_process_ends(self):
        self.story.feed(ev.Shutdown)

    @rule()
    def the_process_starts_again(self):
        self.story.feed(ev.EngineStarted, label="again", resumed=True)


FLOORS = {
    **{state.value: 30 for state in State if state not in (State.TAKEOFF, State.MISSION, State.HOLD, State.LAND)},
    "TAKEOFF arming": 5,
    "TAKEOFF lifting_off": 5,
    "TAKEOFF climbing": 20,
    "TAKEOFF cancelling": 5,
    "MISSION flying": 50,
    "MISSION touchdown": 5,
    "HOLD confirming": 5,
    "HOLD holding": 20,
    "HOLD resuming": 5,
    "LAND commanding": 50,
    "LAND descending": 50,
    "takeoff": 8,
    "land": 4,
    "land_by_both_routes": 4,
    "pilot_took_over": 8,
    "hold": 2,
    "resume": 2,
    "landed": 8,
    "data_complete": 8,
    "data_incomplete": 2,
    "shutdown_in_flight": 8,
}


def test_the_laws_hold_in_random_stories():
    SEEN.clear()
    for number, place in enumerate(BEGINNINGS):  # from each one: what is drawn depends on which modules are loaded
        run_state_machine_as_test(
            type(f"Flight{number}", (Flight,), {"first": place}),
            settings=settings(
                max_examples=max(2, STORIES // len(BEGINNINGS)),
                stateful_step_count=STEPS,
                deadline=None,
                suppress_health_check=list(HealthCheck),
            ),
        )
    rare = {name: (SEEN[name], floor) for name, floor in FLOORS.items() if SEEN[name] < floor}
    assert not rare, "seen too rarely for the laws to mean anything"


@settings(max_examples=LISTS, deadline=None, suppress_health_check=list(HealthCheck))
@given(place=st.sampled_from(list(BEGINNINGS)), happened=st.lists(any_event, min_size=1, max_size=12))
def test_the_laws_hold_whatever_comes_from_nowhere(place, happened):
    story = at(place)
    story.ticking = False
    for kind, after_ns, fields in happened:
        before = story.state
        event = kind(t_ns=max(0, story.now + after_ns), **fields)
        story._decide(event)
        assert engine.decide(before, event, story.rules) == (story.state, tuple(c for _, c in story.sent[story.mark :]))
        journal.encode_event(event)
        for command in story.since:
            if isinstance(command, Decision):
                journal.encode_decision(command)
        report(story.state, story.rules)
        story.now = story.state.t_ns
        story.look()
