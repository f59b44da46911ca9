"""Replays for tests: the command line as a function, and the pieces behind it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from amaze_autonomy.bags import Recording
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.changed_keys import changes_of
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.sources import Recordings
from amaze_autonomy.replay.session import Session
from amaze_autonomy.replay.timeline import written

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("AMAZE_DATA", ROOT.parent / "shared" / "data"))
CONFIG = config_folder()


def recording(name):
    """Return the path of a real recording; skip when it is not there."""
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"the recording {name} is not in {DATA}: set AMAZE_DATA to the folder of recordings")
    return path


def replay(bag, topic_map=None, mission="1", overrides=(), muted=(), config=CONFIG):
    """Replay a bag; return its Outcome and Recordings."""
    bags = [bag] if isinstance(bag, Path) else list(bag)
    topics = []
    for path in bags:
        with Recording(path) as each:
            topics += [topic.name for topic in each.topics]
    found = load_map(topic_map or bags[0].stem)

    def plan_of(configuration):
        return make_plan(configuration, found, mission, tuple(topics))

    plan = plan_of(load_configuration(config, overrides))
    changes = changes_of(overrides, lambda some: load_configuration(config, some), plan_of)
    with Recordings(bags, plan.topics, muted, replayed=True) as recordings:
        return Session(plan, recordings, changes=changes).run(), recordings


def texts(outcome, kind=None):
    """Return the timeline as lines "time source text", without leading spaces, of one kind or of all."""
    lines = [line for line in outcome.timeline if kind is None or line.kind is kind]
    return [" ".join(" ".join(written(line, outcome.start_ns)).split()) for line in lines]


def moves(outcome):
    """Return the moves between states, each with its rule."""
    return [(d.before, d.after, d.rule) for d in outcome.decisions if d.before != d.after]
