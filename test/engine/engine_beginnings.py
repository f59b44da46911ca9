"""Where a story can begin: one for each state and step of the engine. `at("MISSION flying")` tells it up to there."""

from __future__ import annotations

from dataclasses import replace
from typing import Callable, Dict

from engine_peers import COMPONENTS, MISSION, SHIPPED
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.rules import Rules


def _mission_input() -> Story:
    return Story().start().after(0.5)


def _preflight() -> Story:
    story = _mission_input()
    story.answers["check:battery"] = None
    return story.select().after(0.3)


def _outreach() -> Story:
    story = _mission_input()
    story.check_says["battery"] = {"ok": False, "message": "battery 0.30, needed 0.60"}
    return story.select().until("OUTREACH")


def _outreach_recorded() -> Story:
    story = _mission_input()
    story.answers["LoadMission"] = ev.Outcome.REFUSED
    return story.select().until("OUTREACH")


def _outreach_data() -> Story:
    return _its_data_fails(_data_cleanup())


def _its_data_fails(story: Story) -> Story:
    story.recorder.fails = True
    story.agenda = [entry for entry in story.agenda if entry[2] != "_effect"]
    story.recorder.phase = ev.RecordingPhase.FAILED
    return story.until("OUTREACH")


def _ready() -> Story:
    return Story(Rules(components=COMPONENTS, require_go=True)).start().after(0.5).select().until("READY").after(0.3)


def _start_recording() -> Story:
    return _mission_input().select().until("START_RECORDING").after(1.0)


def _load_mission() -> Story:
    story = _mission_input()
    story.answers["check:battery"] = ev.Outcome.ACCEPTED
    story.select().until("START_RECORDING")
    story.disobeyed.append("LoadMission")
    return story.until("LOAD_MISSION").after(0.3)


def _arming() -> Story:
    story = _mission_input().select()
    story.disobeyed.append("TAKEOFF")
    return story.until("TAKEOFF", "arming").after(0.3)


def _lifting_off() -> Story:
    story = _mission_input().select()
    story.disobeyed.append("lift_off")
    return story.until("TAKEOFF", "lifting_off").after(0.3)


def _cancelling() -> Story:
    story = _lifting_off()
    story.disobeyed.append("ABORT")
    story.user("abort")
    return story.expect("TAKEOFF", "cancelling").after(0.1)


def _climbing() -> Story:
    return _mission_input().select().until("TAKEOFF", "climbing").after(0.3)


def _flying() -> Story:
    return _mission_input().select().until("MISSION", "flying").after(1.0)


def _touchdown() -> Story:
    story = Story(SHIPPED, Mission(id="2", files=2, repetitions=2, battery_needed_fraction=0.4)).start().after(0.5)
    story.select().until("MISSION", "flying")
    story.disobeyed.append("LoadMission")
    return story.until("MISSION", "touchdown").after(0.3)


def _confirming() -> Story:
    story = _flying()
    story.disobeyed.append("HOLD")
    story.user("hold")
    return story.expect("HOLD", "confirming").after(0.3)


def _holding() -> Story:
    story = _flying()
    story.user("hold")
    return story.until("HOLD", "holding").after(0.3)


def _holding_takeoff() -> Story:
    story = _climbing()
    story.user("hold")
    return story.until("HOLD", "holding").after(0.3)


def _resuming() -> Story:
    story = _holding()
    story.disobeyed.append("RESUME")
    story.user("resume")
    return story.expect("HOLD", "resuming").after(0.3)


def _commanding() -> Story:
    story = _flying()
    story.vehicle.obeys = False
    story.user("land")
    return story.after(0.3).expect("LAND", "commanding")


def _descending() -> Story:
    story = _flying()
    story.user("land")
    return story.until("LAND", "descending").after(0.1)


def _pilot() -> Story:
    story = _flying()
    story.say(pilot_in_control=True, mode="POSCTL")
    return story.until("PILOT", limit_s=0.5).after(0.3)


def _pilot_landed() -> Story:
    story = _pilot()
    story.vehicle.land()
    story.after(4.0)
    story.vehicle.says.clear()
    return story.after(0.4).expect("PILOT")


def _data_cleanup() -> Story:
    story = _flying()
    story.user("land")
    return story.until("DATA_CLEANUP")


def _data_cleanup_queued() -> Story:
    story = _mission_input().select(MISSION, replace(MISSION, id="2"))
    return story.until("DATA_CLEANUP", limit_s=90.0)


def _outreach_data_queued() -> Story:
    return _its_data_fails(_data_cleanup_queued())


def _mission_ended() -> Story:
    return _data_cleanup().until("MISSION_ENDED").after(0.3)


BEGINNINGS: Dict[str, Callable[[], Story]] = {
    "MISSION_INPUT": _mission_input,
    "PREFLIGHT": _preflight,
    "OUTREACH": _outreach,
    "OUTREACH recorded": _outreach_recorded,
    "OUTREACH data": _outreach_data,
    "OUTREACH data queued": _outreach_data_queued,
    "READY": _ready,
    "START_RECORDING": _start_recording,
    "LOAD_MISSION": _load_mission,
    "TAKEOFF arming": _arming,
    "TAKEOFF lifting_off": _lifting_off,
    "TAKEOFF cancelling": _cancelling,
    "TAKEOFF climbing": _climbing,
    "MISSION flying": _flying,
    "MISSION touchdown": _touchdown,
    "HOLD confirming": _confirming,
    "HOLD holding": _holding,
    "HOLD holding takeoff": _holding_takeoff,
    "HOLD resuming": _resuming,
    "LAND commanding": _commanding,
    "LAND descending": _descending,
    "PILOT": _pilot,
    "PILOT landed": _pilot_landed,
    "DATA_CLEANUP": _data_cleanup,
    "DATA_CLEANUP queued": _data_cleanup_queued,
    "MISSION_ENDED": _mission_ended,
}
_TOLD: Dict[str, Story] = {}


def at(place: str) -> Story:
    """Return a story that has come to a place ("MISSION flying"); it looks from there on."""
    if place not in _TOLD:
        _TOLD[place] = BEGINNINGS[place]()
    return _TOLD[place].fork().look()
