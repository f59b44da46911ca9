"""Makes the helpers of this folder importable; the laws of the engine, and its stepper, watch every story."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parent))

import engine_laws
import engine_stepper
import engine_story
import pytest

from amaze_autonomy.engine import stepper

engine_story.ALWAYS.append(engine_laws.watch)
engine_story.ALWAYS.append(engine_stepper.follow)


@pytest.fixture
def asked(monkeypatch):
    """Return the events that the stepper has asked the table about."""
    events, decide = [], stepper.decide

    def counted(state, event, rules):
        events.append(event)
        return decide(state, event, rules)

    monkeypatch.setattr(stepper, "decide", counted)
    return events
