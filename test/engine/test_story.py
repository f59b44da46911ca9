"""The harness itself: a nominal story, and every beginning is where it says."""

from __future__ import annotations

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import CHECKS
from engine_story import Story


def test_a_nominal_mission_from_selection_to_its_end():
    story = Story().start().after(0.5).select().until("MISSION_ENDED")
    checks = [f"check:{name}" for name in CHECKS]
    assert story.requests == [*checks, "StartRecording", "LoadMission", *checks, "TAKEOFF", "StopRecording"]
    assert story.told == [
        "preflight",
        "ready",
        "start_recording",
        "load_mission",
        "takeoff",
        "mission",
        "data_cleanup",
        "mission_ended",
    ]
    assert story.state.session.result.value == "COMPLETE"
    assert story.state.recording.location == "/data/test-001"


@pytest.mark.parametrize("place", BEGINNINGS)
def test_every_beginning_is_where_it_says(place):
    story = at(place)
    state, _, step = place.partition(" ")
    step = {
        "recorded": "",
        "data": "",
        "landed": "",
        "holding takeoff": "holding",
        "queued": "",
        "data queued": "",
    }.get(step, step)
    assert story.place == (state, step)


def test_a_fork_is_independent():
    story = at("MISSION flying")
    twin = story.fork()
    twin.fail("mission_camera", 16)
    twin.expect("LAND")
    story.after(1.0).expect("MISSION", "flying")
