"""What our own reading says of a recording, in the form of truth.yaml: by the shipped map, through the whole replay."""

from __future__ import annotations

import functools
import re
from operator import itemgetter
from types import SimpleNamespace

import numpy as np
from replay_runs import CONFIG, recording

from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine.events import AutopilotStatus, VehicleLanded
from amaze_autonomy.journal.journal import read
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.monitors.upsets import columns_of, mavlink_tilt, tilt_deg
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.sources import Recordings, topics_of
from amaze_autonomy.replay.session import Session

STATUS, GPS_OK, OFF_GROUND_M = "/autopilot/status", 1, 0.3
LANDED = {each: each.name.lower().replace("_", " ") for each in VehicleLanded}
LANDED.update({VehicleLanded.ON_GROUND: "on the ground", VehicleLanded.IN_AIR: "in the air"})


@functools.lru_cache(maxsize=None)
def replayed(name):
    """Return a recording's replay by its shipped map, and what it was told of the vehicle."""
    path = recording(name)
    topic_map = load_map("px4_telemetry" if name.startswith("px4_") else path.stem)
    plan = make_plan(load_configuration(CONFIG), topic_map, "1", tuple(topics_of([path])))
    with Recordings([path], plan.topics) as recordings:
        outcome = Session(plan, recordings).run()
        tilt = _tilt(recordings, topic_map)
        figures, log = recordings.figures(), recordings.bags[-1]
        topics = {topic.name.replace("/mavlink/", ""): topic.messages for topic in log.topics}
        health = [((entry.t_ns - log.start_ns) / 1e9, log.message(entry).gps) for entry in log.entries(STATUS)]
    lines = read("\n".join(outcome.journal) + "\n").lines
    statuses = [line.payload for line in lines if isinstance(line.payload, AutopilotStatus)]
    return SimpleNamespace(
        outcome=outcome, tilt=tilt, figures=figures, topics=topics, gps=health, frames=getattr(log, "count", None),
        statuses=[((each.t_ns - outcome.start_ns) / 1e9, each) for each in statuses if each.t_ns >= outcome.start_ns],
        lines=[((each.t_ns - outcome.start_ns) / 1e9, each) for each in outcome.timeline],
    )  # fmt: skip


def _tilt(recordings, topic_map):
    imu = topic_map.readings.get("imu")
    found = mavlink_tilt(recordings)
    if found is not None or imu is None:
        return found
    paths = [f"orientation.{axis}" for axis in "xyzw"]
    t_s, parts = columns_of(recordings, imu.topic, paths, recordings.start_ns)
    return t_s, tilt_deg(*parts)


second = itemgetter(1)


def changes(rows, unknown=()):
    """Return the rows whose value is another than before; the first one without its time: ours begin a second later."""
    found = []
    for t, value in rows:
        if value not in unknown and (not found or found[-1][1] != value):
            found.append([t if found else 0.0, value])
    return found


def counts(replay):
    """Return the messages of each topic, without those that are made of others."""
    return {name: number for name, number in replay.topics.items() if name not in ("imu", STATUS)}


def strangers(replay):
    """Return the number of frames whose ids the link does not know."""
    return 0 if replay.frames is None else replay.frames.unknown


def frames(replay):
    """Return the number of frames with a wrong checksum; None for a bag."""
    return None if replay.frames is None else replay.frames.damaged


def silences(replay):
    """Return by topic since when the watchdog missed it."""
    found = {}
    for t, line in replay.lines:
        text = re.match(
            r"watchdog: \w+ code .*no message on (?:/mavlink/)?(\S+) for longer than ([\d.]+) s$", line.text
        )
        if text:
            found.setdefault(text[1], []).append(t - float(text[2]))
    return found


def flights(replay):
    """Return for each arming its times, lift-off and touchdown, and the largest height.

    By the height that the autopilot says; touchdown by the landing detection, where there is a range finder.
    """
    found = []
    landings = [t for t, line in replay.lines if line.text.startswith("landing detection: ON_GROUND")]
    for arming in replay.outcome.flights:
        begin_s, end_s = ((t_ns - replay.outcome.start_ns) / 1e9 for t_ns in arming)
        rows = [(t, each.height_m) for t, each in replay.statuses if begin_s <= t < end_s and each.height_m is not None]
        up = [t for t, height_m in rows if height_m > OFF_GROUND_M]
        down = [t for t in landings if up and up[0] < t < end_s] + up[-1:]
        found.append([begin_s, end_s, *((up[0], down[0], max(rows, key=second)[1]) if up else (None, None, None))])
    return found


def airborne(replay):
    """Return from when to when a bag's vehicle was in the air."""
    landed = changes((t, each.landed) for t, each in replay.statuses)
    begin_s = next(t for t, state in landed if state is VehicleLanded.IN_AIR)
    return [[begin_s, next(t for t, state in landed if t > begin_s and state is VehicleLanded.ON_GROUND)]]


def extremes(replay, name, factor=1.0):
    """Return the last, the lowest and the highest value of a field of the autopilot's status."""
    values = [factor * getattr(each, name) for _, each in replay.statuses if getattr(each, name) is not None]
    return [values[-1], min(values), max(values)]


def lines(replay, pattern):
    """Return the numbers in some lines of the timeline, behind the time of each."""
    found = [(t, re.match(pattern, line.text)) for t, line in replay.lines]
    return [[t, *map(float, text.groups())] for t, text in found if text]


def warnings(replay):
    """Return by text how often the autopilot said it, its level, and when first and last."""
    told, found = "the autopilot says: ", {}
    for t, line in replay.lines:
        if line.text.startswith(told) and line.level:
            times, _, first_s, _ = found.get(line.text[len(told) :], (0, 0, t, t))
            last_s = t if line.times == 1 else (line.until_ns - replay.outcome.start_ns) / 1e9
            found[line.text[len(told) :]] = [times + line.times, line.level, first_s, last_s]
    return found


def gps(replay):
    """Return from when on the GPS was good, or not."""
    return changes((t, value == GPS_OK) for t, value in replay.gps if value)


def largest_tilt(replay):
    """Return when the tilt was largest, and how large."""
    t_s, tilt = replay.tilt
    return [float(t_s[np.nanargmax(tilt)]), float(np.nanmax(tilt))]
