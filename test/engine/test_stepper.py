"""The stepper decides what `decide` decides.

`engine_stepper.follow` asserts it in every story of this folder. Here are stories that look for the difference:
statuses that repeat themselves but for a single field, with time in between that ends just before, at or just after a
limit.
"""

from __future__ import annotations

from dataclasses import fields

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_news import settled
from engine_peers import SHIPPED, S
from engine_story import Story
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_laws import EVENTS, SEARCH

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine import stepper as module
from amaze_autonomy.engine.horizon import horizon_ns
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.engine.state import evolve
from amaze_autonomy.engine.stepper import Stepper
from amaze_autonomy.engine.timers import next_deadline

KINDS = {
    ev.WatchdogAction: "action",
    ev.MissionStatus: "planner",
    ev.RecordingStatus: "recorder",
    ev.AutopilotStatus: "autopilot",
    ev.LandedStatus: "landing",
}
LIMITS = sorted({getattr(Limits(), each.name) for each in fields(Limits) if each.name.endswith("_ns")})
LATE = st.builds(lambda limit, more: limit + more, st.sampled_from(LIMITS), st.sampled_from([-1, 0, 1]))
pauses = st.sampled_from([*[S // 50] * 9, 0, 1, None]).flatmap(lambda pause: LATE if pause is None else st.just(pause))
CHANGED = {kind: st.one_of([st.fixed_dictionaries({n: v}) for n, v in EVENTS[kind].items()]) for kind in KINDS}
changes = st.tuples(st.sampled_from(list(KINDS)), st.sampled_from([True, False, False])).flatmap(
    lambda drawn: st.tuples(st.just(drawn[0]), CHANGED[drawn[0]] if drawn[1] else st.just({}))
)
steps = st.lists(st.tuples(pauses, changes), min_size=8, max_size=25)


def test_what_repeats_itself_but_for_a_field_is_decided_alike(asked):
    """The stepper is settled when a story begins, and stays so often enough that its shortcut is what is tested."""
    fed = []

    @settings(max_examples=3000 if SEARCH else 60, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.sampled_from(list(BEGINNINGS)), steps)
    def law(place, told):
        story = settled(place)
        story.watch.append(lambda *decided: fed.append(decided))
        for pause_ns, (kind, change) in told:
            story.now += pause_ns
            last = getattr(story.state, KINDS[kind])
            said = {} if last is None else {name: value for name, value in vars(last).items() if name != "t_ns"}
            if kind is ev.WatchdogAction and said:
                said["loop_counter"] += 1
            if last is not None or len(change) == len(EVENTS[kind]):
                story.feed(kind, **{**said, **change})

    for place in BEGINNINGS:
        settled(place)
    asked.clear()
    law()
    assert len(fed) > 500
    assert len(asked) < len(fed) * 2 // 3


@pytest.mark.parametrize("place", list(BEGINNINGS))
def test_each_field_of_a_status_may_be_news_everywhere(place):
    """A status is said three times, so that the stepper takes it for granted, then with one field that is another."""
    for kind, name in KINDS.items():
        last = getattr(at(place).state, name)
        for field in vars(last) if last is not None else ():
            for value in _others(field, getattr(last, field)):
                story = at(place)
                for _ in range(3):
                    story.now += S // 10
                    story.feed(kind, **{**vars(last), "t_ns": story.now})
                story.feed(kind, **{**vars(last), field: value, "t_ns": story.now + 1})


def _others(field, value):
    """Return other values of a field."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, (ev.VehicleLanded, ev.Landed, ev.MissionPhase, ev.RecordingPhase, ev.Code)):
        return [each for each in type(value) if each is not value]
    if field in ("t_ns", "components", "platforms"):
        return [()] if field == "platforms" else []
    if isinstance(value, str):
        return ["", "other", "AUTO.LAND", "AUTO.LOITER", "POSCTL"]
    return [0, 1, 5, 10**9 + 1, -(10**9)] if isinstance(value, int) else [None, 0.0, 0.15, 0.5, 3.1, 30.1, -0.3, 1e3]


def test_a_mission_is_flown_mostly_without_the_table(monkeypatch):
    asked = []
    decide = module.decide
    monkeypatch.setattr(module, "decide", lambda *arguments: asked.append(1) or decide(*arguments))
    story, events = Story(), []
    story.watch.append(lambda *told: events.append(told))
    story.start().after(0.5).select().until("MISSION")
    asked.clear()
    events.clear()
    story.after(4.0)
    assert len(events) > 100
    assert len(asked) < len(events) / 5


def test_nothing_is_assumed_of_a_state_that_it_did_not_make():
    story = at("MISSION flying").report().report()
    stepper, state = Stepper(SHIPPED), story.state
    for _ in range(2):
        event = evolve(state.autopilot, t_ns=state.t_ns)
        state, _ = stepper.decide(state, event)
    over = evolve(state, in_flight=False)
    assert stepper.decide(over, event) == module.decide(over, event, SHIPPED)
    assert stepper.wakes_ns(state) == 0


@pytest.mark.parametrize("place", list(BEGINNINGS))
def test_the_engine_need_not_be_woken_before_the_horizon(place):
    state, rules = at(place).state, at(place).rules
    deadline_ns = next_deadline(state, rules)
    assert state.t_ns < horizon_ns(state, rules) <= (deadline_ns or horizon_ns(state, rules))


def test_the_last_waypoint_is_news_to_a_vehicle_that_has_landed():
    story = at("MISSION flying")
    planner, vehicle = vars(story.state.planner), vars(story.state.autopilot)
    landed = {"armed": False, "landed": ev.VehicleLanded.ON_GROUND, "height_m": 0.0, "vertical_speed_m_s": 0.0}
    for last in (1, 1, 1, 0):
        story.now += S // 10
        story.feed(ev.LandedStatus, landed=ev.Landed.ON_GROUND)
        story.feed(ev.AutopilotStatus, **{**vehicle, **landed, "t_ns": story.now})
        waypoint = {"waypoint": 3 - last, "waypoints": 3, "phase": ev.MissionPhase.LANDED}
        story.feed(ev.MissionStatus, **{**planner, **waypoint, "t_ns": story.now})
        assert story.is_in("MISSION") is (last > 0)


def test_a_recorder_that_stays_failed_is_news_when_it_has_been_long_enough():
    story = at("DATA_CLEANUP")
    failed = {"session_id": story.state.session_id, "phase": ev.RecordingPhase.FAILED, "message": "disk"}
    story.state = evolve(story.state, recording_progressed=False)
    for _ in range(80):
        story.now += S // 10
        story.feed(ev.RecordingStatus, **failed)
    story.expect("OUTREACH")
