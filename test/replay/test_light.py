"""Numbers in columns decide what whole messages decide: the same journal and the same timeline, byte for byte."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml
from replay_bags import START_NS, S, break_chunk, flight_rows, height_m, make, rewrite, write_bag
from replay_demo import demo_bag, simulated
from replay_runs import ROOT, moves, recording, replay

from amaze_autonomy.engine.events import CheckName
from amaze_autonomy.replay.monitors.monitors import Monitors
from amaze_autonomy.replay.recordings.sources import Recordings

pytestmark = pytest.mark.long

MAP = str(ROOT / "test" / "replay" / "flight.yaml")
BEGINNING = 11  # messages that are looked at whole to know how a recording begins
REAL = ("ardrone_indoor_flight", "crazyflie_sine", "handheld_roll_pitch_yaw", "husky_outdoor_drive", "example_lz4")


def both(monkeypatch, *arguments, **options):
    """Replay by numbers, then by whole messages; return the outcomes and how many messages were decoded by each."""
    counts, outcomes = [], []
    inner = Recordings.message
    for light in (True, False):
        with monkeypatch.context() as patch:
            decoded = []
            patch.setattr(Recordings, "message", lambda self, sample, to=decoded: to.append(1) or inner(self, sample))
            if not light:
                patch.setattr(Monitors, "light", lambda *_: None)
            outcome, recordings = replay(*arguments, **options)
            outcomes.append((outcome, recordings.figures(), recordings.damage))
            counts.append(len(decoded))
    assert outcomes[0] == outcomes[1]
    return outcomes[0][0], counts


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_a_flight_is_decided_without_decoding_a_message(tmp_path, monkeypatch, compression):
    path = write_bag(tmp_path / "x.bag", flight_rows(), compression)
    outcome, (light, whole) = both(monkeypatch, path, MAP)
    assert (light, whole) == (BEGINNING, BEGINNING + 36 * (50 + 20 + 2 + 10 + 10))
    assert [each.after for each in outcome.decisions][-1] == "MISSION_ENDED"


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("name", REAL)
def test_real_recordings_are_decided_alike(monkeypatch, name):
    _, (light, whole) = both(monkeypatch, recording(f"{name}.bag"))
    assert (light <= BEGINNING) == (name != "crazyflie_sine"), "that one has an irregular message"
    assert light <= whole


def test_a_recording_of_this_package_is_decided_alike(tmp_path, monkeypatch):
    _, (light, whole) = both(monkeypatch, demo_bag(tmp_path / "x.bag", simulated()), "amaze_demo")
    assert 0 < light < whole / 2


@pytest.mark.parametrize("tilt_deg,orientation", [(14.0, (0.0, 0.0, 0.0, 0.0)), (3.0, (0.0, 0.2, 0.0, 0.98))])
def test_what_fails_a_check_is_seen_alike(tmp_path, monkeypatch, tilt_deg, orientation):
    rows = flight_rows(
        20.0, silent={"/range": (12.0, 13.0), "/imu": (14.0, 14.5)}, tilt_deg=tilt_deg, orientation=orientation
    )
    _, (light, whole) = both(monkeypatch, write_bag(tmp_path / "x.bag", rows), MAP)
    assert light < whole


def tilted_rows(tilt_deg=50.0, rate_hz=1.7):
    """Return a flight that rolls from side to side: each range is as long as the tilt of its time makes it."""
    rows = flight_rows()
    for t_ns, topic, message in rows:
        t_s = (t_ns - START_NS) / S
        roll = math.radians(tilt_deg) * math.sin(math.tau * rate_hz * (t_s - 8.0)) * (8.0 < t_s < 30.0)
        if topic == "/imu":
            message.orientation.x, message.orientation.w = math.sin(roll / 2), math.cos(roll / 2)
        elif topic == "/range":
            message.range = (0.05 + height_m(t_s)) / math.cos(roll)
    return rows


@pytest.mark.parametrize("range_first", [False, True])
def test_a_range_is_corrected_with_the_tilt_of_its_time_whichever_the_map_names_first(
    tmp_path, monkeypatch, range_first
):
    content = yaml.safe_load(Path(MAP).read_text())
    content["components"] = dict(sorted(content["components"].items(), reverse=range_first))
    path = tmp_path / "map.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    outcome, (light, whole) = both(monkeypatch, write_bag(tmp_path / "x.bag", tilted_rows()), str(path))
    assert light == BEGINNING < whole
    assert ("TAKEOFF", "MISSION", "at_takeoff_height") in moves(outcome)


@pytest.mark.parametrize("covariance, turning", [(0.0, "pass"), (-1.0, "unknown"), (float("nan"), "unknown")])
def test_an_imu_that_says_that_it_has_no_gyroscope_does_not_pass_as_still(tmp_path, monkeypatch, covariance, turning):
    """As the live node: sensor_msgs/Imu says so by a covariance that begins with -1."""
    rows = flight_rows()
    for _, topic, message in rows:
        if topic == "/imu":
            message.angular_velocity_covariance[0] = covariance
    outcome, (light, whole) = both(monkeypatch, write_bag(tmp_path / "x.bag", rows), MAP)
    assert light == BEGINNING < whole
    _, checks = outcome.checks[CheckName.STATE_ESTIMATION]
    assert {row.name: row.verdict.value for row in checks}["turning"] == turning


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_messages_of_a_damaged_chunk_are_missed_alike(tmp_path, monkeypatch, compression):
    path = write_bag(tmp_path / "x.bag", flight_rows(), compression)
    break_chunk(path, 2, 300, 50)
    _, (light, whole) = both(monkeypatch, path, MAP)
    assert 0 < light < whole


def test_several_bags_and_publishers_are_read_alike(tmp_path, monkeypatch):
    rows = flight_rows()
    parts = [
        write_bag(tmp_path / f"{each}.bag", [row for row in rows if (row[1] == "/imu") == each], "lz4")
        for each in (False, True)
    ]
    again = [(row[0], row[1], row[2], f"/node{place % 3}") for place, row in enumerate(rows)]
    joined = rewrite(write_bag(tmp_path / "x.bag", again), tmp_path / "y.bag", "bz2")
    first, _ = both(monkeypatch, parts, MAP)
    second, _ = both(monkeypatch, joined, MAP)
    assert first.journal == second.journal


def test_a_text_that_is_not_ascii_is_left_to_the_library(tmp_path, monkeypatch):
    rows = flight_rows(3.0)
    for _, topic, message in rows:
        if topic == "/imu":
            message.header.frame_id = "körper"
    _, (light, _) = both(monkeypatch, write_bag(tmp_path / "x.bag", rows), MAP)
    assert light == BEGINNING + 150


def test_a_map_that_does_not_fit_says_the_same(tmp_path, monkeypatch):
    rows = [(START_NS + each * S // 10, "/imu", make("std_msgs/msg/Float64", data=1.0)) for each in range(30)]
    path = write_bag(tmp_path / "x.bag", rows)
    words = []
    for light in (True, False):
        if not light:
            monkeypatch.setattr(Monitors, "light", lambda *_: None)
        with pytest.raises(Exception) as caught:  # noqa: PT011  # hollow: its type and words are compared
            replay(path, MAP)
        words.append((type(caught.value), str(caught.value)))
    assert words[0] == words[1]
