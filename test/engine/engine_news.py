"""All have said the same for a while: then one more status, with one thing that is another. Is the table asked?"""

from __future__ import annotations

from copy import copy

from engine_beginnings import at
from engine_peers import S

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.severity import Code
from amaze_autonomy.engine.state import evolve

__all__ = ["KINDS", "again", "component", "is_news", "recording", "settled"]

KINDS = {
    "action": ev.WatchdogAction,
    "planner": ev.MissionStatus,
    "recorder": ev.RecordingStatus,
    "autopilot": ev.AutopilotStatus,
    "landing": ev.LandedStatus,
}
MODULES = ("module1", "module2")


def recording(*growing, names=MODULES, **more):
    return tuple(ev.PlatformRecording(platform=n, growing=g, **more) for n, g in zip(names, growing))


def component(name, code):
    return ev.ComponentStatus(name=name, code=Code(code))


_SETTLED = {}


def settled(place, **known):
    """Return a story in which all have said the same for three seconds; `known` is put into what the engine knows."""
    if place not in _SETTLED:
        story = _SETTLED[place] = at(place)
        story.stepper = copy(story.stepper[0]), story.stepper[1]  # other stories go on with the one that it has
        for _ in range(15):
            story.now += S // 5
            story.report()
    story = _SETTLED[place].fork()
    story.stepper = copy(story.stepper[0]), story.stepper[1]
    if known:
        story.state = evolve(story.state, **known)
        story.now += S // 50
        story.feed(ev.Tick)
    return story


def again(story, peer, pause_ns=S // 50, **changes):
    """Let a peer say once more what it said, but for some changes; the watchdog works on."""
    story.now += pause_ns
    said = {name: value for name, value in vars(getattr(story.state, peer)).items() if name != "t_ns"}
    if peer == "action":
        said["loop_counter"] += 1
    story.feed(KINDS[peer], **{**said, **changes})


def is_news(asked, story, peer, **changes):
    """Return whether the table is asked about a status that is as the last one, but for some changes."""
    asked.clear()
    again(story, "planner" if peer == "landing" else "landing")
    assert not asked, "until now, nothing is news"
    again(story, peer, **changes)
    return bool(asked)
