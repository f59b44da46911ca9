"""Every story is also a test of leaving early: each event is decided a second time, by a state that is not settled."""

from __future__ import annotations

from typing import Any, Tuple

from engine_beginnings import at
from engine_peers import S
from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.decide import decide
from amaze_autonomy.engine.severity import Code
from amaze_autonomy.engine.state import EngineState, Settled, evolve

__all__ = ["KINDS", "again", "asked", "component", "follow", "is_news", "recording", "settled"]

KINDS = {
    "action": ev.WatchdogAction,
    "planner": ev.MissionStatus,
    "recorder": ev.RecordingStatus,
    "autopilot": ev.AutopilotStatus,
    "landing": ev.LandedStatus,
}
MODULES = ("module1", "module2")


def follow(story: Story, before: EngineState, event: ev.Event, commands: Tuple[Any, ...]) -> None:
    """Decide the event with the table asked in any case; assert that it comes to the same."""
    assert decide(evolve(before, settled=Settled()), event, story.rules) == (story.state, commands)


def asked(before: EngineState, after: EngineState) -> bool:
    """Return whether the table was asked about the event between two states."""
    return before.settled.until_ns == 0 or after.settled is not before.settled


def recording(*growing, names=MODULES, **more):
    return tuple(ev.PlatformRecording(platform=n, growing=g, **more) for n, g in zip(names, growing))


def component(name, code):
    return ev.ComponentStatus(name=name, code=Code(code))


_SETTLED = {}


def settled(place, **known):
    """Return a story in which all have said the same for three seconds; `known` is put into what the engine knows."""
    if place not in _SETTLED:
        story = _SETTLED[place] = at(place)
        for _ in range(15):
            story.now += S // 5
            story.report()
    story = _SETTLED[place].fork()
    story.state = evolve(story.state, settled=Settled(), **known)
    story.feed(ev.Tick)
    return story


def again(story, peer, pause_ns=S // 50, **changes):
    """Let a peer say once more what it said, but for some changes; the watchdog works on."""
    story.now += pause_ns
    said = {name: value for name, value in vars(getattr(story.state, peer)).items() if name != "t_ns"}
    if peer == "action":
        said["loop_counter"] += 1
    story.feed(KINDS[peer], **{**said, **changes})


def is_news(story, peer, pause_ns=S // 50, **changes):
    """Return whether the table is asked about a status that is as the last one, but for some changes."""
    before = story.state
    again(story, peer, pause_ns, **changes)
    return asked(before, story.state)
