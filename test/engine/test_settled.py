"""When `decide` leaves early: what is news, what is not, and that nobody compares behind its back.

That it comes to the same is asserted at every event of every story (`engine_settled.follow`). Here are stories that
look for the difference: statuses that repeat themselves but for one field, with time in between that ends just before,
at or just after a limit.
"""

from __future__ import annotations

import ast
from dataclasses import fields
from pathlib import Path

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import MISSION, S
from engine_settled import KINDS, again, asked, component, is_news, recording, settled
from engine_story import Story
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_laws import EVENTS, SEARCH

from amaze_autonomy import engine
from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.engine.severity import Code
from amaze_autonomy.engine.state import STAMPS, Settled, evolve
from amaze_autonomy.engine.timers import next_deadline

LIMITS = Limits()

# --- the field of a status ------------------------------------------------------------------------------------------

_TOO_FAR = {"position_x_m": 80.0, "position_y_m": -80.0}
_JUST_IN = {"position_x_m": 60.0, "position_y_m": -79.999}
SAME = {
    "action": [{"sequence": 0}, {"age_ns": S}],
    "planner": [{"distance_left_m": 1.0}, {"time_left_s": 1.0}, {"age_ns": -S // 5}],
    "recorder": [{"progress": 0.5}, {"platforms": recording(True, True, written_bytes=1, byte_rate=2.0)}],
    "autopilot": [
        {"link_age_s": 0.01},
        {"height_m": 1.0001},
        {"height_m": 29.9},
        {"position_x_m": 99.99},
        _JUST_IN,
        {"vertical_speed_m_s": -0.1999},
        {"vertical_speed_m_s": None},
        {"battery_fraction": 0.1501},
        {"battery_voltage_v": 3.0},
        {"battery_age_s": 0.01},
        {"age_ns": S},
    ],
    "landing": [{"distance_m": 1.0}, {"age_ns": S}],
}
NEWS = {
    "action": [{"code": Code.INCONVENIENT}, {"components": (component("lrf", 8),)}],
    "planner": [
        *({"phase": each} for each in ev.MissionPhase if each is not ev.MissionPhase.FLYING),
        *({"waypoint": 0}, {"waypoints": 0}, {"mission_id": "other"}, {"file_index": 1}, {"message": "why"}),
    ],
    "recorder": [
        {"phase": ev.RecordingPhase.STOPPING},
        {"location": "/data/other"},
        *({"platforms": each} for each in (recording(True, False), recording(True), ())),
    ],
    "autopilot": [
        *({"armed": each} for each in (None, False)),
        *({"landed": each} for each in ev.VehicleLanded if each is not ev.VehicleLanded.IN_AIR),
        *({"mode": each} for each in ("", "AUTO.LAND", "POSCTL")),
        *({"pilot_in_control": True}, {"failsafe": True}),
        *({"link_age_s": None}, {"link_age_s": 3.1}),
        *({"height_m": each} for each in (30.0001, None)),
        *({"position_x_m": 100.0001}, {"position_y_m": -100.0001}, {"position_x_m": None}, _TOO_FAR),
        *({"battery_fraction": each} for each in (0.15, None)),
        *({"vertical_speed_m_s": -0.2}, {"battery_critical": True}),
    ],
    "landing": [{"landed": ev.Landed.ON_GROUND}, {"reason": "why"}],
}
NOT_HEARD = {peer: [{"age_ns": S + 1}, {"age_ns": -S // 5 - 1}] for peer in KINDS}
"""Too old, or from the future."""


def _listed(table):
    return [pytest.param(peer, changes, id=f"{peer} {changes}") for peer in table for changes in table[peer]]


@pytest.mark.parametrize("peer, changes", _listed(SAME))
def test_what_nothing_can_come_of_is_not_news(peer, changes):
    assert not is_news(settled("MISSION flying"), peer, **changes)


@pytest.mark.parametrize("peer, changes", _listed(NEWS))
def test_what_something_may_come_of_is_news(peer, changes):
    assert is_news(settled("MISSION flying"), peer, **changes)


@pytest.mark.parametrize("peer, changes", _listed(NOT_HEARD))
def test_what_is_not_heard_is_not_news(peer, changes):
    story = settled("MISSION flying")
    known = getattr(story.state, peer)
    assert not is_news(story, peer, **{**NEWS[peer][0], **changes})
    assert getattr(story.state, peer) is known


def test_the_limits_of_the_mission_count():
    story = settled("MISSION flying", mission=evolve(MISSION, max_height_m=2.5, max_distance_m=10.0))
    assert not is_news(story, "autopilot", height_m=2.4, position_x_m=9.9)
    assert is_news(story, "autopilot", height_m=2.6)


def test_what_is_unknown_is_news_when_it_is_known():
    story = settled("MISSION flying")
    for height_m in (None, 2.0):
        assert is_news(story, "autopilot", height_m=height_m)
        again(story, "autopilot")
        assert not is_news(story, "autopilot")


# --- time -----------------------------------------------------------------------------------------------------------

SILENT_FOR = {
    "action": LIMITS.watchdog_heartbeat_limit_ns,
    "planner": LIMITS.planner_status_limit_ns,
    "autopilot": LIMITS.autopilot_status_limit_ns,
    "landing": LIMITS.landing_detection_limit_ns,
}


@pytest.mark.parametrize("silent", SILENT_FOR)
def test_silence_and_the_first_word_after_it_are_news(silent):
    story = settled("MISSION flying")
    end_ns, looked = story.now + SILENT_FOR[silent] + 1, []
    while story.now < end_ns:
        before = story.state
        again(story, "landing" if silent == "planner" else "planner", min(S // 10, end_ns - story.now))
        looked.append(asked(before, story.state))
    assert looked[-1]
    assert is_news(story, silent, 0)


@pytest.mark.parametrize("place", ["READY", "LOAD_MISSION", "MISSION touchdown", "DATA_CLEANUP"])
@pytest.mark.parametrize("late_ns", [0, 1])
def test_a_stream_is_news_when_something_has_ended_since_it_was_heard(place, late_ns):
    """What ended may have been its own silence."""
    story = settled(place)
    end_ns = story.state.autopilot_ns + LIMITS.autopilot_status_limit_ns + late_ns
    while story.now < end_ns:
        for peer in ("action", "landing"):
            again(story, peer, min(S // 30, end_ns - story.now))
    story.state = evolve(story.state, settled=Settled())
    story.feed(ev.Tick)
    assert story.state.settled.until_ns > story.now
    assert is_news(story, "autopilot", 0) is bool(late_ns)


@pytest.mark.parametrize("kind", [ev.Tick, *KINDS.values()])
def test_an_old_event_counts_as_happening_now(kind):
    story = settled("MISSION flying")
    story.now -= S
    story.feed(kind, **({} if kind is ev.Tick else _said(story, kind)))
    assert story.state.t_ns == story.now + S


def _said(story, kind):
    name = next(name for name, each in KINDS.items() if each is kind)
    return {name: value for name, value in vars(getattr(story.state, name)).items() if name != "t_ns"}


@pytest.mark.parametrize("place", list(BEGINNINGS))
def test_no_deadline_comes_before_what_is_settled_ends(place):
    story = settled(place)
    deadline_ns = next_deadline(story.state, story.rules)
    assert deadline_ns is None or story.state.settled.until_ns <= deadline_ns


# --- what is looked for ---------------------------------------------------------------------------------------------

LATE = st.builds(
    lambda limit, more: limit + more,
    st.sampled_from(sorted({getattr(LIMITS, each.name) for each in fields(Limits) if each.name.endswith("_ns")})),
    st.sampled_from([-1, 0, 1]),
)
pauses = st.sampled_from([*[S // 50] * 9, 0, 1, None]).flatmap(lambda pause: LATE if pause is None else st.just(pause))
CHANGED = {kind: st.one_of([st.fixed_dictionaries({n: v}) for n, v in EVENTS[kind].items()]) for kind in KINDS.values()}
changes = st.tuples(st.sampled_from(list(KINDS)), st.sampled_from([True, False, False])).flatmap(
    lambda drawn: st.tuples(st.just(drawn[0]), CHANGED[KINDS[drawn[0]]] if drawn[1] else st.just({}))
)
steps = st.lists(st.tuples(pauses, changes), min_size=8, max_size=25)


def test_what_repeats_itself_but_for_a_field_is_decided_alike():
    """The state is settled when a story begins, and stays so often enough that leaving early is what is tested."""
    early = []

    @settings(max_examples=3000 if SEARCH else 60, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.sampled_from(list(BEGINNINGS)), steps)
    def law(place, told):
        story = settled(place)
        story.watch.append(lambda story, before, *_: early.append(not asked(before, story.state)))
        for pause_ns, (peer, change) in told:
            if getattr(story.state, peer) is not None:
                again(story, peer, pause_ns, **change)

    law()
    assert len(early) > 300
    assert sum(early) > len(early) // 4


@pytest.mark.parametrize("place", list(BEGINNINGS))
def test_each_field_of_a_status_may_be_news_everywhere(place):
    """A status is said three times, so that nothing is new in it, then with one field that is another."""
    for peer, kind in KINDS.items():
        last = getattr(at(place).state, peer)
        for name in vars(last) if last is not None else ():
            for value in _others(name, getattr(last, name)):
                story = at(place)
                for _ in range(3):
                    story.now += S // 10
                    story.feed(kind, **{**vars(last), "t_ns": story.now})
                story.feed(kind, **{**vars(last), name: value, "t_ns": story.now + 1})


def _others(name, value):
    """Return other values of a field."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, (ev.VehicleLanded, ev.Landed, ev.MissionPhase, ev.RecordingPhase, ev.Code)):
        return [each for each in type(value) if each is not value]
    if name in ("t_ns", "components", "platforms"):
        return [()] if name == "platforms" else []
    if isinstance(value, str):
        return ["", "other", "AUTO.LAND", "AUTO.LOITER", "POSCTL"]
    return [0, 1, 5, 10**9 + 1, -(10**9)] if isinstance(value, int) else [None, 0.0, 0.15, 0.5, 3.1, 30.1, -0.3, 1e3]


def test_a_mission_is_flown_mostly_without_the_table():
    story, early = Story(), []
    story.watch.append(lambda story, before, *_: early.append(not asked(before, story.state)))
    story.start().after(0.5).select().until("MISSION")
    early.clear()
    story.after(4.0)
    assert len(early) > 100
    assert sum(early) > len(early) * 4 // 5


# --- nobody compares in other ways ----------------------------------------------------------------------------------

CONDITIONS = ("data_guards", "failures", "fitness", "flight_guards", "guards", "losses", "preflight_guards")
FIGURES = {
    *(each.name for kind in KINDS.values() for each in fields(kind) if each.type == "Figure"),
    *(name for name, value in vars(ev.AutopilotStatus).items() if isinstance(value, property)),
}
NEUTRAL = {
    each.name
    for kind in (*KINDS.values(), ev.PlatformRecording)
    for each in fields(kind)
    if each.metadata.get("neutral")
} - FIGURES


def trees():
    folder = Path(engine.__file__).parent
    return {name: ast.parse((folder / f"{name}.py").read_text(encoding="utf-8")) for name in CONDITIONS}


def names_in(node):
    inner = list(ast.walk(node))
    return {each.attr for each in inner if isinstance(each, ast.Attribute)} | {
        each.id for each in inner if isinstance(each, ast.Name)
    }


def compared(tree):
    """Yield the names in everything that is compared by size."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and any(isinstance(op, (ast.Lt, ast.LtE, ast.Gt, ast.GtE)) for op in node.ops):
            yield from sorted(names_in(node))


@pytest.mark.parametrize("name", CONDITIONS)
def test_times_and_figures_are_compared_by_the_turn_alone(name):
    bad = [each for each in compared(trees()[name]) if each.endswith("_ns") or each == "now" or each in FIGURES]
    assert bad == []


def test_the_search_for_comparisons_finds_them():
    assert list(compared(ast.parse("turn.now - state.planner_ns > 3"))) == ["now", "planner_ns", "state", "turn"]


@pytest.mark.parametrize("name", CONDITIONS)
def test_no_condition_looks_at_what_is_neutral(name):
    looked = {each.attr for each in ast.walk(trees()[name]) if isinstance(each, ast.Attribute)} & NEUTRAL
    assert looked <= ({"link_age_s"} if name == "losses" else set()), "it tells the age of a link that is lost"


def test_the_stamps_are_the_streams_that_are_heard():
    assert set(STAMPS) == {
        *("heartbeat_ns", "planner_ns", "recorder_ns", "autopilot_ns", "linked_ns"),
        *("battery_ns", "position_ns", "landing_ns"),
    }
