"""Every two things that can happen one after the other, from every state: the laws hold (they watch every story)."""

from __future__ import annotations

from typing import Any, Callable, Dict

import pytest
from engine_beginnings import BEGINNINGS, at
from engine_peers import MISSION, S
from engine_story import Story

from amaze_autonomy.engine import events as ev

pytestmark = pytest.mark.long

GROUND, AIR = ev.VehicleLanded.ON_GROUND, ev.VehicleLanded.IN_AIR


def says(**claims: Any) -> Callable[[Story], object]:
    return lambda story: story.say(**claims)


def planner(phase: ev.MissionPhase) -> Callable[[Story], object]:
    def happens(story: Story) -> None:
        story.now += 1
        story.planner.session = story.state.session.id
        story.planner.mission = MISSION.id
        story.planner.phase = phase
        story.report()

    return happens


def recorder(phase: ev.RecordingPhase) -> Callable[[Story], object]:
    def happens(story: Story) -> None:
        story.recorder.session, story.recorder.phase = story.state.session.id, phase
        story.report()

    return happens


def reply(outcome: ev.Outcome) -> Callable[[Story], object]:
    """Let the answer to the newest request come."""
    return lambda story: story.feed(ev.Reply, command_id=story.state.next_id - 1, outcome=outcome)


def checks(*, ok: bool) -> Callable[[Story], object]:
    def happens(story: Story) -> None:
        for record in story.state.preflight.checks:
            story.feed(
                ev.CheckReply, command_id=record.command_id, check=record.check, outcome=ev.Outcome.ACCEPTED, ok=ok
            )

    return happens


def passes(seconds: float) -> Callable[[Story], object]:
    """Let time pass in one tick, with every peer silent."""

    def happens(story: Story) -> None:
        story.now += round(seconds * S)
        story.feed(ev.Tick)

    return happens


ALPHABET: Dict[str, Callable[[Story], object]] = {
    **{f"user {c.value}": (lambda story, c=c: story.user(c.value)) for c in ev.UserCommand},
    "select": lambda story: story.select(MISSION),
    "shutdown": lambda story: story.feed(ev.Shutdown),
    "restart": lambda story: story.feed(ev.EngineStarted, resumed=True),
    "gps 2": lambda story: story.fail("gps", 2),
    "camera 4": lambda story: story.fail("realsense_camera", 4),
    "lrf 8": lambda story: story.fail("lrf", 8),
    "lrf given up": lambda story: story.fail("lrf", 16, "given_up"),
    "lrf back": lambda story: story.back("lrf"),
    "disarmed on ground": says(armed=False, landed=GROUND),
    "armed on ground": says(armed=True, landed=GROUND),
    "armed in the air": says(armed=True, landed=AIR, height_m=5.0),
    "pilot": says(armed=True, landed=AIR, pilot_in_control=True),
    "unknown": says(armed=None, landed=ev.VehicleLanded.UNKNOWN, link_age_s=None),
    "battery critical": says(battery_fraction=0.05),
    "foreign mode": says(mode="POSCTL"),
    "landing mode": says(mode="AUTO.LAND"),
    **{f"planner {p.name}": planner(p) for p in ev.MissionPhase},
    **{f"recorder {p}": recorder(ev.RecordingPhase[p]) for p in ("RECORDING", "COMPLETE", "FAILED")},
    "accepted": reply(ev.Outcome.ACCEPTED),
    "refused": reply(ev.Outcome.REFUSED),
    "checks pass": checks(ok=True),
    "checks fail": checks(ok=False),
    "0.5 s": passes(0.5),
    "5 s": passes(5.0),
    "an hour": passes(3600.0),
}


@pytest.mark.parametrize("place", BEGINNINGS)
def test_every_two_things_one_after_the_other(place):
    begin = at(place)
    begin.ticking = False
    for first, happens in ALPHABET.items():
        story = begin.fork()
        happens(story)
        for second, follows in ALPHABET.items():
            twin = story.fork().look()
            try:
                follows(twin)
            except AssertionError as error:
                raise AssertionError(f"{place}: {first}, then {second}") from error
