"""Every story is also a test of the stepper: it decides each event as `decide` does, and comes to the same state."""

from __future__ import annotations

from typing import Any, Tuple

from engine_story import Story

from amaze_autonomy.engine import events as ev
from amaze_autonomy.engine.state import EngineState
from amaze_autonomy.engine.stepper import Stepper

__all__ = ["follow"]


def follow(story: Story, before: EngineState, event: ev.Event, commands: Tuple[Any, ...]) -> None:
    """Decide the event by a stepper that has followed the story so far; assert that it comes to the same."""
    stepper, state = story.__dict__.get("stepper", (None, None))
    if stepper is None or stepper.rules is not story.rules:
        stepper = Stepper(story.rules)
    state = state if state == before else before
    after, decided = stepper.decide(state, event)
    assert (after, decided) == (story.state, commands)
    story.stepper = stepper, after
