"""What the stepper takes for granted, field by field and limit by limit, and what it asks the table about.

A story is told until everybody has said the same thing for a while. Then one more status comes, with one thing that is
another: in the status (`SAME`, `NEWS`), in what the engine knows (`KNOWN`), or in where it is. The tables say whether
the stepper must ask; that it comes to what `decide` comes to is asserted in every story (`engine_stepper.follow`).
"""

from __future__ import annotations

import pytest
from engine_beginnings import BEGINNINGS
from engine_news import KINDS, again, component, is_news, recording, settled
from engine_peers import MISSION, S

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.severity import Code
from amaze_autonomy.engine.state import evolve

TAKEOFF, HOLD, LAND = MissionAction.TAKEOFF, MissionAction.HOLD, MissionAction.LAND

# --- the field of a status ------------------------------------------------------------------------------------------

_TOO_FAR = {"position_x_m": 80.0, "position_y_m": -80.0}
_JUST_IN = {"position_x_m": 60.0, "position_y_m": -79.999}
_AT_30_M = {"height_m": 30.0}
SAME = {
    "action": [
        {"sequence": 0},
        {"latest_component": "lrf"},
        {"code": Code.NON_CRITICAL},
        {"age_ns": S},
        {"age_ns": -S // 5},
    ],
    "planner": [{"distance_left_m": 1.0}, {"time_left_s": 1.0}, {"age_ns": S}, {"age_ns": -S // 5}],
    "recorder": [
        {"progress": 0.5},
        {"platforms": recording(True, True, written_bytes=1, byte_rate=2.0, free_fraction=0.5, location="/")},
        {"location": ""},
        {"age_ns": S},
        {"age_ns": -S // 5},
    ],
    "autopilot": [
        {"link_age_s": 3.0},
        {"height_m": 1.0},
        _AT_30_M,
        {"position_x_m": 99.999},
        {"position_x_m": None},
        {"position_y_m": None},
        _JUST_IN,
        {"vertical_speed_m_s": -0.1999},
        {"vertical_speed_m_s": None},
        {"battery_fraction": 0.1501},
        {"battery_fraction": None},
        {"battery_fraction": None, "battery_age_s": 10.1},
        {"battery_voltage_v": 3.0},
        {"battery_age_s": 10.0},
        {"battery_age_s": None},
        {"age_ns": S},
        {"age_ns": -S // 5},
    ],
    "landing": [{"distance_m": 1.0}, {"reason": "why"}, {"age_ns": S}, {"age_ns": -S // 5}],
}
NEWS = {
    "action": [
        {"code": Code.INCONVENIENT},
        {"components": (component("lrf", 8),)},
        {"components": (component("lrf", 2),)},
    ],
    "planner": [
        {"phase": ev.MissionPhase.HOLDING},
        {"waypoint": 0},
        {"waypoints": 0},
        {"mission_id": "other"},
        {"file_index": 1},
        {"repetition": 1},
        {"message": "why"},
    ],
    "recorder": [
        {"phase": ev.RecordingPhase.STOPPING},
        {"message": "why"},
        {"location": "/data/other"},
        {"platforms": recording(True, False)},
        {"platforms": recording(False, False)},
        {"platforms": recording(True)},
        {"platforms": ()},
        {"platforms": recording(True, True, names=("module1", "other"))},
    ],
    "autopilot": [
        *({"armed": each} for each in (None, False)),
        *({"landed": each} for each in ev.VehicleLanded if each is not ev.VehicleLanded.IN_AIR),
        *({"mode": each} for each in ("", "AUTO.LAND", "AUTO.TAKEOFF", "POSCTL")),
        {"pilot_in_control": True},
        {"failsafe": True},
        {"battery_critical": True},
        {"link_age_s": None},
        {"link_age_s": 3.0 + 1e-8},
        {"height_m": 30.0001},
        {"height_m": 0.9999},
        {"height_m": None},
        {"position_x_m": 100.0001},
        {"position_y_m": -100.0001},
        {"position_x_m": 100.00000001},
        {"position_x_m": 99.99999999},  # too near for squares to tell
        _TOO_FAR,
        {"vertical_speed_m_s": -0.2},
        {"battery_fraction": 0.15},
        {"battery_age_s": 10.0 + 1e-8},
    ],
    "landing": [{"landed": ev.Landed.ON_GROUND}, {"landed": ev.Landed.UNKNOWN}],
}
NOT_HEARD = {
    "action": [{"age_ns": S + 1}, {"age_ns": -S // 5 - 1}],
    "planner": [{"age_ns": S + 1}, {"age_ns": -S // 5 - 1}, {"session_id": ""}, {"session_id": "other"}],
    "recorder": [{"age_ns": S + 1}, {"age_ns": -S // 5 - 1}, {"session_id": ""}, {"session_id": "other"}],
    "autopilot": [{"age_ns": S + 1}, {"age_ns": -S // 5 - 1}],
    "landing": [{"age_ns": S + 1}, {"age_ns": -S // 5 - 1}],
}
"""Too old, from the future, or of another flight."""


def _listed(table):
    return [pytest.param(peer, changes, id=f"{peer} {changes}") for peer in table for changes in table[peer]]


@pytest.mark.parametrize("peer, changes", _listed(SAME))
def test_what_nothing_can_come_of_is_not_news(asked, peer, changes):
    assert not is_news(asked, settled("MISSION flying"), peer, **changes)


@pytest.mark.parametrize("peer, changes", _listed(NEWS))
def test_what_something_may_come_of_is_news(asked, peer, changes):
    assert is_news(asked, settled("MISSION flying"), peer, **changes)


@pytest.mark.parametrize("peer, changes", _listed(NOT_HEARD))
@pytest.mark.parametrize("news", [False, True])
def test_what_is_not_heard_is_not_asked_about(asked, peer, changes, news):
    story = settled("MISSION flying")
    known = getattr(story.state, peer)
    assert not is_news(asked, story, peer, **{**(NEWS[peer][0] if news else {}), **changes})
    assert getattr(story.state, peer) is known


# --- what the engine knows -----------------------------------------------------------------------------------------

_OWN_LIMITS = evolve(MISSION, max_height_m=2.5, max_distance_m=10.0)
_WIDER_LIMITS = evolve(MISSION, max_height_m=40.0, max_distance_m=200.0)
KNOWN = [  # peer, in what the engine knows, in its next word, is it news?
    ("planner", {"session_id": ""}, {}, False),
    ("planner", {"session_id": ""}, {"session_id": "", "waypoint": 0}, False),
    ("recorder", {"session_id": ""}, {"session_id": "", "message": "why"}, False),
    ("recorder", {"recording_progressed": False}, {}, True),
    ("recorder", {"recording_since_ns": None}, {}, True),
    ("recorder", {"data_location": "/data"}, {}, False),
    ("recorder", {"data_location": "/data"}, {"location": "/data"}, False),
    ("recorder", {"data_location": "/data"}, {"location": "/data/other"}, True),
    ("planner", {"motion_ns": 1 << 60}, {}, True),
    ("action", {"components": (component("b", 1), component("a", 1))}, {}, True),
    ("action", {"components": (component("a", 1), component("b", 1))}, {}, False),
    ("autopilot", {"armed_at_start": None}, {}, True),
    ("autopilot", {"position_ns": None}, {}, True),
    ("autopilot", {"position_ns": None}, {"height_m": 1.5, "position_x_m": None}, False),
    ("autopilot", {"battery_ns": None}, {}, True),
    ("autopilot", {"battery_ns": None}, {"battery_age_s": None}, False),
    ("autopilot", {"grounded_ns": 1}, {}, True),
    ("autopilot", {"disarm_sent_ns": 1}, {}, True),
    ("autopilot", {"was_armed": False}, {}, True),
    ("autopilot", {"was_airborne": False}, {}, True),
    ("autopilot", {"flown": False}, {}, True),
    ("autopilot", {"descending_ns": 1}, {}, True),
    ("autopilot", {"descending_ns": 1}, {"vertical_speed_m_s": -0.2}, False),
    ("autopilot", {"confirmed": None}, {}, True),
    ("autopilot", {"confirmed": HOLD}, {}, True),
    ("autopilot", {"commanded": (HOLD, TAKEOFF)}, {}, True),
    ("autopilot", {"commanded": (HOLD,)}, {}, False),
    ("autopilot", {"commanded": ()}, {}, False),
    ("autopilot", {"commanded": (), "confirmed": None}, {}, True),
    ("autopilot", {"commanded": (LAND,), "confirmed": LAND}, {}, True),
    ("autopilot", {"mission": _OWN_LIMITS}, {"height_m": 2.5}, False),
    ("autopilot", {"mission": _OWN_LIMITS}, {"height_m": 2.6}, True),
    ("autopilot", {"mission": _OWN_LIMITS}, {"position_x_m": 9.99}, False),
    ("autopilot", {"mission": _OWN_LIMITS}, {"position_x_m": 10.01}, True),
    ("autopilot", {"mission": _WIDER_LIMITS}, {"height_m": 39.0}, False),
    ("autopilot", {"mission": _WIDER_LIMITS}, {"position_x_m": 199.0}, False),
    ("autopilot", {"mission": None}, {"height_m": 30.1}, True),
    ("autopilot", {"mission": None}, {"height_m": 29.9}, False),
]


@pytest.mark.parametrize("peer, known, changes, news", KNOWN, ids=lambda value: str(value)[:60])
def test_whether_it_is_news_depends_on_what_is_known(asked, peer, known, changes, news):
    assert is_news(asked, settled("MISSION flying", **known), peer, **changes) is news


def test_the_takeoff_height_is_news_when_it_is_left(asked):
    story = settled("MISSION flying")
    assert not is_news(asked, story, "autopilot", height_m=1.0)
    assert is_news(asked, story, "autopilot", height_m=0.9999)
    assert is_news(asked, story, "autopilot", height_m=1.0)


@pytest.mark.parametrize("before_ns, news", [(0, True), (1, False)])
def test_the_planners_first_word_after_a_command_is_news(asked, before_ns, news):
    last = settled("MISSION flying").state.planner
    assert is_news(asked, settled("MISSION flying", motion_ns=last.t_ns - before_ns), "planner") is news


@pytest.mark.parametrize("peer", KINDS)
def test_the_first_word_of_all_is_news(asked, peer):
    last = getattr(settled("MISSION flying").state, peer)
    story = settled("MISSION flying", **{peer: None})
    story.now += S // 50
    asked.clear()
    story.feed(KINDS[peer], **{**vars(last), "t_ns": story.now})
    assert asked


# --- where it is ---------------------------------------------------------------------------------------------------

ASKED_AT = {  # the end of a flight may lie in it, or for how long it has been like this
    "OUTREACH data": {"recorder"},  # that has failed
    "TAKEOFF arming": {"autopilot"},  # disarmed, although it is in flight
    "TAKEOFF lifting_off": {"autopilot"},  # armed on the ground
    "TAKEOFF cancelling": {"autopilot"},
    "PILOT": {"autopilot"},  # in a mode that is none of ours
}


@pytest.mark.parametrize("place", list(BEGINNINGS))
def test_where_the_table_is_asked_about_what_is_said_again(asked, place):
    story, found = settled(place), set()
    for peer in KINDS:
        if getattr(story.state, peer) is not None and (peer != "recorder" or story.state.session_id):
            story.feed(ev.Tick)
            asked.clear()
            again(story, peer, 1)
            found |= {peer} if asked else set()
    assert found == ASKED_AT.get(place, set())


@pytest.mark.parametrize(
    "place, known, news",
    [
        ("PILOT", {"in_flight": False}, False),  # in other hands
        ("PILOT", {"in_flight": False, "grounded_ns": 1}, True),
        ("LAND descending", {}, False),
        ("LAND descending", {"in_flight": False}, True),  # then its flight is not over
        ("DATA_CLEANUP", {}, False),
        ("DATA_CLEANUP", {"grounded_ns": None}, True),
        ("DATA_CLEANUP", {"recorder": None}, False),
    ],
)
def test_whether_the_vehicle_says_news_depends_on_where_it_is(asked, place, known, news):
    assert is_news(asked, settled(place, **known), "autopilot") is news


@pytest.mark.parametrize(
    "armed, landed",
    [(None, "ON_GROUND"), (False, "IN_AIR"), (None, "IN_AIR"), (True, "UNKNOWN"), (True, "ON_GROUND")],
)
@pytest.mark.parametrize("place", ["PILOT", "MISSION_ENDED"])
def test_a_vehicle_that_is_neither_down_nor_in_flight_is_asked_about_each_time(asked, place, armed, landed):
    story = settled(place, in_flight=False)
    again(story, "autopilot", armed=armed, landed=ev.VehicleLanded[landed])
    for _ in range(2):
        story.feed(ev.Tick)
        assert is_news(asked, story, "autopilot", armed=armed, landed=ev.VehicleLanded[landed])


def test_what_changes_on_the_ground_is_news(asked):
    story = settled("DATA_CLEANUP")
    for phase in (ev.RecordingPhase.STOPPING, ev.RecordingPhase.MERGING):
        assert is_news(asked, story, "recorder", phase=phase)
        assert not is_news(asked, story, "recorder")
    story = settled("MISSION_ENDED")
    again(story, "autopilot", armed=None)
    story.feed(ev.Tick)
    assert is_news(asked, story, "autopilot", armed=False)
    story = settled("PILOT", in_flight=False)
    again(story, "autopilot", armed=True, landed=ev.VehicleLanded.ON_GROUND)
    story.state = evolve(story.state, grounded_ns=None)
    story.feed(ev.Tick)
    assert is_news(asked, story, "autopilot")
