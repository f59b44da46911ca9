"""What a replay requires before takeoff: as the engine would, of what the recording has."""

from __future__ import annotations

from dataclasses import replace
from typing import Dict, Sequence, Tuple

import pytest

from amaze_autonomy.config import Configuration, load_configuration
from amaze_autonomy.monitoring.specs import TopicSpec
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.maps.topic_map import ComponentMap, TopicMap, load_map
from amaze_autonomy.replay.plan import Plan, make_plan

WITHOUT_REALSENSE = "sensors.components.realsense_imu.required=false"
LISTED = "missions.missions.1.required=[realsense_imu, lrf]"


def configured(*overrides: str) -> Configuration:
    return load_configuration(config_folder(), overrides)


def topics_of(configuration: Configuration) -> Tuple[str, ...]:
    return tuple(topic.topic for spec in configuration.components for topic in spec.topics)


def mapped(required: Dict[str, bool]) -> TopicMap:
    """Return a map of nothing but components, each on a topic of its own name."""
    components = (ComponentMap(name, TopicSpec(f"/{name}", 10.0), flag) for name, flag in required.items())
    return replace(load_map("amaze_demo"), components=tuple(components), as_configured=False)


def planned(configuration: Configuration, without: Sequence[str] = ()) -> Plan:
    """Return the plan of a recording of all that is configured, but some topics."""
    recorded = tuple(topic for topic in topics_of(configuration) if topic not in without)
    return make_plan(configuration, load_map("amaze_demo"), "1", recorded)


@pytest.mark.parametrize("overrides", [(WITHOUT_REALSENSE,), (LISTED,), (WITHOUT_REALSENSE, LISTED)])
def test_what_the_mission_requires_the_replay_of_a_whole_recording_requires(overrides: Tuple[str, ...]):
    configuration = configured(*overrides)
    plan = planned(configuration)
    assert set(plan.mission.required) == set(configuration.missions[0].required)
    assert plan.elsewhere == {}


def test_a_mission_that_requires_all_requires_all_that_was_recorded():
    plan = planned(configured(), ["/lrf/range"])
    assert plan.mission.required == tuple(spec.name for spec in plan.components)
    assert list(plan.elsewhere) == ["lrf"]


@pytest.mark.parametrize(
    "overrides, named", [((), True), ((WITHOUT_REALSENSE,), False), ((WITHOUT_REALSENSE, LISTED), True)]
)
def test_what_was_not_recorded_is_elsewhere_when_the_mission_requires_it(overrides: Tuple[str, ...], named: bool):  # noqa: FBT001
    plan = planned(configured(*overrides), ["/realsense/imu"])
    assert ("realsense_imu" in plan.elsewhere) is named
    assert "realsense_imu" not in plan.mission.required


@pytest.mark.parametrize(
    "overrides, required",
    [
        ((), ("realsense_imu", "nobodys_camera")),
        ((WITHOUT_REALSENSE,), ("nobodys_camera",)),
        ((LISTED,), ("realsense_imu", "nobodys_camera")),
    ],
)
def test_of_what_a_map_names_the_map_and_the_mission_require_and_of_what_is_not_configured_the_map(
    overrides: Tuple[str, ...], required: Tuple[str, ...]
):
    flags = {"realsense_imu": True, "lrf": False, "nobodys_camera": True, "second": False}
    plan = make_plan(configured(*overrides), mapped(flags), "1", tuple(f"/{name}" for name in flags))
    assert plan.mission.required == required
    assert plan.unseen == {}, "a map that names its components lacks none"


def test_contents_and_stamps_are_watched_by_no_replay_and_the_topics_are_named():
    asked = ("finite=true", "unchanged_limit_s=5.0", "stamp_tolerance_s=0.1")
    more = configured(*(f"sensors.components.lrf.topics./lrf/range.{each}" for each in asked))
    plain = planned(configured())
    plan = planned(more)
    assert (plan.components, plan.contents) == (plain.components, ("/lrf/range",))
    assert plain.contents == ()


def test_a_component_of_which_some_topics_were_recorded_says_which_were_not():
    more = "sensors.components.lrf.topics./lrf/status.rate_hz=2.0"
    long = "sensors.components.lrf.topics./lrf/status.age_limit_s=5.0"
    configuration = configured(more, long)
    assert planned(configuration, ["/lrf/status"]).unseen == {"lrf": ("/lrf/status",)}
    assert planned(configuration, ["/lrf/status", "/lrf/range"]).unseen == {"lrf": ()}
    assert planned(configuration).unseen == {}
