"""Topic maps: what they say, and what is said about their mistakes."""

from __future__ import annotations

from math import radians

import numpy as np
import pytest

from amaze_autonomy.config import ConfigError
from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.replay.maps.topic_map import STATUSES, Script, load_map, map_names
from amaze_autonomy.replay.monitors.feeds import FactFeed

MINIMAL = "about: a test\n"


def written(tmp_path, text):
    path = tmp_path / "x.yaml"
    path.write_text(text)
    return str(path)


def test_maps_for_the_real_recordings_ship_with_the_package():
    assert map_names() == (
        "amaze_demo",
        "ardrone_indoor_flight",
        "copter_low_battery",
        "crazyflie_sine",
        "example_lz4",
        "handheld_roll_pitch_yaw",
        "husky_outdoor_drive",
        "mavros",
        "px4_telemetry",
    )


@pytest.mark.parametrize("name", map_names())
def test_every_shipped_map_is_a_good_one(name):
    topic_map = load_map(name)
    assert topic_map.name == name
    assert topic_map.about
    assert topic_map.components or topic_map.as_configured
    assert set(topic_map.statuses) <= set(STATUSES)


def test_an_empty_map_has_defaults(tmp_path):
    topic_map = load_map(written(tmp_path, MINIMAL))
    assert (topic_map.name, topic_map.about, topic_map.components) == ("x", "a test", ())
    assert (topic_map.readings, topic_map.statuses, topic_map.topics) == ({}, {}, ())
    assert (topic_map.landing, topic_map.state_estimation) == ({}, {})
    assert topic_map.script == Script()


def test_units_of_the_keys_become_those_of_the_package(tmp_path):
    text = MINIMAL + (
        "components:\n  imu: {topic: /imu, rate_hz: 50, age_limit_s: 0.25, wait_limit_s: 3}\n"
        "landing: {settle_s: 0.4, max_tilt_deg: 30.0}\n"
        "state_estimation: {tilt_limit_deg: 12.0, imu_mounting_rpy_deg: [90.0, 0.0, 0.0], speed_limit_m_s: 2.0}\n"
        "script: {select_at_s: -2.5, retry_after_s: 0.5}\n"
    )
    topic_map = load_map(written(tmp_path, text))
    imu = topic_map.components[0]
    assert (imu.topic.topic, imu.topic.rate_hz, imu.topic.age_limit_ns, imu.wait_limit_ns) == (
        "/imu",
        50.0,
        250_000_000,
        3_000_000_000,
    )
    assert topic_map.landing == {"settle_ns": 400_000_000, "max_tilt_rad": radians(30.0)}
    assert topic_map.state_estimation == {
        "tilt_limit_rad": radians(12.0),
        "imu_mounting_rpy_rad": (radians(90.0), 0.0, 0.0),
        "speed_limit_m_s": 2.0,
    }
    assert (topic_map.script.select_at_ns, topic_map.script.retry_after_ns) == (-2_500_000_000, 500_000_000)


def test_a_topic_that_is_used_twice_has_one_rank_that_of_its_first_use(tmp_path):
    text = MINIMAL + (
        "components:\n  b: {topic: /b, rate_hz: 1}\n  a: {topic: /a, rate_hz: 1}\n"
        "readings:\n  imu: {topic: /a}\n  height: {topic: /c, height: z}\n"
        "statuses: {autopilot: /d}\n"
    )
    assert load_map(written(tmp_path, text)).topics == ("/b", "/a", "/c", "/d")


@pytest.mark.parametrize(
    "text,message",
    [
        ("components: {}\n", "x.yaml:1: about: is missing; must be given: one line about the recording"),
        (
            MINIMAL + "components:\n  imu: {topik: /imu, rate_hz: 1}\n",
            "x.yaml:3: components.imu.topik: is an unknown key; did you mean topic?",
        ),
        (
            MINIMAL + "components:\n  imu: {topic: /imu, rate_hz: 1, age_limit_ms: 500}\n",
            "x.yaml:3: components.imu.age_limit_ms: is an unknown key; did you mean age_limit_s (500 ms are 0.5 s)?",
        ),
        (
            MINIMAL + "components:\n  imu: {topic: /imu, rate_hz: 1}\n  imu: {topic: /b, rate_hz: 1}\n",
            "x.yaml:4: components.imu: is given twice (first in line 3); must be given once",
        ),
        (
            MINIMAL + "readings:\n  range: {topic: /range, distance: 'values[x]'}\n",
            "x.yaml:3: readings.range.distance: is the text 'values[x]'; "
            "must be the path of a field, e.g. pose.position.z or values[5]",
        ),
        (
            MINIMAL + "readings:\n  landed: {topic: /landed}\n",
            "x.yaml:3: readings.landed.on_ground: is missing; "
            "must be given: a list of values that mean on the ground, at least 1",
        ),
        (
            MINIMAL + "components:\n  imu: {topic: /imu, rate_hz: 10, window_s: 0.1}\n",
            "x.yaml:3: components.imu.window_s: is 0.1; must be at least four periods (0.4 s)",
        ),
    ],
)
def test_a_mistake_is_one_line_with_its_place_and_what_would_be_right(tmp_path, text, message):
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_map(path)
    assert str(caught.value) == str(tmp_path / message)


@pytest.mark.parametrize("words", ["[true]", "['True']", "[1]", "[yes]", "['true']"])
@pytest.mark.parametrize("value", [True, np.bool_(1), 1, np.uint8(1), "true"])
def test_what_is_true_means_on_the_ground_in_each_way_of_writing_it(tmp_path, words, value):
    path = written(tmp_path, MINIMAL + f"readings:\n  landed: {{topic: /landed, on_ground: {words}, unknown: [7]}}\n")
    facts = {}
    feed = FactFeed("landed", load_map(path).readings["landed"], facts)
    landed = []
    for said in (value, type(value)(0) if value != "true" else "false"):
        feed.take_values(1, (said,))
        landed.append(facts["landed"].value)
    assert landed == [VehicleLanded.ON_GROUND, VehicleLanded.IN_AIR]


def test_a_map_that_is_not_there_is_refused_with_those_that_are():
    with pytest.raises(ConfigError, match=r"^nowhere: is no topic map; name a file, or one of amaze_demo, ardrone_"):
        load_map("nowhere")
