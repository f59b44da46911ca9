"""The configuration that ships with the package. The expected table is written by hand, from the specification."""

from __future__ import annotations

import dataclasses

import pytest
import yaml

from amaze_autonomy import paths
from amaze_autonomy.config import FILES, Streams, load_configuration
from amaze_autonomy.config.consistency import contradictions, unrecorded_topics
from amaze_autonomy.config.kinds import unit_words
from amaze_autonomy.config.reference import compared_parameters
from amaze_autonomy.config.schema import Group
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.engine.state import Result
from amaze_autonomy.interface import STATUSES
from amaze_autonomy.monitoring.specs import BatterySpec, LandingSpec, PollingSpec, StateEstimationSpec
from amaze_autonomy.simulation.run import run

FOLDER = paths.config_folder()

# component, group, restart, severity, wait limit in s (None: nobody waits)
DECISIONS = [
    ("gps", "px4", False, "low", None),
    ("imu", "px4", False, "highest", None),
    ("magnetometer", "px4", False, "moderate", 10),
    ("barometer", "px4", False, "moderate", 10),
    ("mission_camera", "other", True, "highest", None),
    ("realsense_camera", "other", True, "moderate", 20),
    ("realsense_imu", "other", False, "low", None),
    ("lsm9ds1_imu", "other", True, "moderate", 15),
    ("lrf", "other", True, "high", 15),
]
RATES = {
    "/px4/gps": 5,
    "/px4/imu": 100,
    "/px4/magnetometer": 20,
    "/px4/barometer": 20,
    "/mission_camera/image_raw": 10,
    "/realsense/image_raw": 10,
    "/realsense/imu": 100,
    "/lsm9ds1/imu": 50,
    "/lrf/range": 20,
}


@pytest.fixture(scope="module")
def shipped():
    return load_configuration(FOLDER)


def test_the_decision_table_is_that_of_the_specification(shipped):
    found = [
        (spec.name, spec.group, rule.restart, spec.severity.value, spec.wait_limit_ns // 1_000_000_000 or None)
        for spec, rule in zip(shipped.components, shipped.rules.components)
    ]
    assert found == DECISIONS


def test_the_engine_and_the_watchdog_are_told_the_same(shipped):
    assert len(shipped.components) == len(shipped.rules.components) == len(DECISIONS)
    for spec, rule in zip(shipped.components, shipped.rules.components):
        assert (spec.name, spec.group, spec.severity) == (rule.name, rule.group, rule.severity)
        assert rule.wait_limit_ns == (spec.wait_limit_ns or shipped.rules.limits.unlisted_wait_limit_ns)


def test_every_sensor_is_watched_at_its_rate(shipped):
    assert {topic.topic: topic.rate_hz for spec in shipped.components for topic in spec.topics} == RATES


def test_the_sensors_of_the_px4_are_judged_by_the_autopilot_too(shipped):
    judged = [(spec.name, spec.autopilot.value) for spec in shipped.components if spec.autopilot is not None]
    assert judged == [(name, name) for name, group, *_ in DECISIONS if group == "px4"]


def test_what_ships_is_what_the_code_has_as_its_defaults(shipped):
    assert shipped.rules.limits == Limits()
    assert shipped.rules.require_go is False
    assert shipped.streams == Streams()
    assert shipped.landing == LandingSpec()
    assert shipped.state_estimation == StateEstimationSpec()
    assert shipped.battery == dataclasses.replace(BatterySpec(), cells=4)
    assert {spec.polling for spec in shipped.components} == {PollingSpec()}


def test_autonomy_yaml_has_every_limit_of_the_engine():
    rows = [field.name for field in dataclasses.fields(Limits)]
    text = yaml.safe_load((FOLDER / "autonomy.yaml").read_text())
    assert [text["checks"].pop(own) for own in ("reply_limits_s", "max_ages_s")] == [{}, {}]
    written = [key for group in text.values() if isinstance(group, dict) for key in group]
    expected = [name[:-3] + "_s" if name.endswith("_ns") else name for name in rows]
    assert written == expected + [field.name for field in dataclasses.fields(Streams)]


def test_the_missions_are_those_of_the_demo(shipped):
    assert [(plan.mission.id, plan.mission.files, plan.mission.repetitions) for plan in shipped.plans] == [
        ("1", 1, 1),
        ("2", 3, 1),
        ("3", 1, 3),
        ("4", 1, 1),
        ("5", 1, 1),
    ]
    durations = [round(plan.total.duration_s) for plan in shipped.plans]
    assert 40 <= durations[0] <= 60
    assert 270 <= durations[3] <= 330
    assert [plan.mission.tolerated for plan in shipped.plans if plan.mission.tolerated] == [("gps", "mission_camera")]


def test_all_that_is_watched_is_recorded_and_so_are_the_decisions(shipped):
    recorded = [topic for platform in shipped.recording.platforms for topic in shipped.recording.topics(platform.name)]
    components = shipped.effective["sensors"]["components"].values()
    meant = {name: values["recorded"] for component in components for name, values in component["topics"].items()}
    assert [topic for topic in RATES if meant[topic] and topic not in recorded] == []
    assert [topic for topic in ("~journal", "/odometry", "watchdog/action") if topic not in recorded] == []


def test_in_a_namespace_our_own_statuses_are_recorded_not_another_stack_s(shipped):
    recorded = {topic for group in shipped.recording.groups for topic in group.topics}
    assert [row.topic for row in STATUSES if row.topic not in recorded or f"/{row.topic}" in recorded] == []


def test_every_trajectory_that_ships_is_flown_by_a_mission(shipped):
    files = sorted(path.relative_to(FOLDER).as_posix() for path in (FOLDER / "trajectories").iterdir())
    assert sorted(shipped.effective["trajectories"]) == files


def _commented(path):
    """Return the comment above each key of a file, by key, as one line."""
    comments, block = [], []
    for line in path.read_text(encoding="utf-8").split("\n"):
        if line.strip().startswith("# "):
            block.append(line.strip()[2:])
        elif ":" in line:
            comments.append((line.split(":")[0].strip().lstrip("#"), " ".join(block)))  # one left out included
            block = []
        else:
            block = []
    return comments


GROUPS = [
    *(("autonomy", key.name) for key in FILES["autonomy"].keys if isinstance(key.kind, Group)),
    *(("sensors", name) for name in ("polling", "landing_detection", "state_estimation", "battery")),
    *(("missions", name) for name in ("flight", "bounds")),
    ("recording", "storage"),
]


@pytest.mark.parametrize("file, name", GROUPS)
def test_the_comments_in_the_files_say_what_the_schema_says(file, name):
    group = next(key.kind for key in FILES[file].keys if key.name == name)
    comments = _commented(FOLDER / f"{file}.yaml")
    assert group.keys
    for key in group.keys:
        said = [comment for commented, comment in comments if commented == key.name]
        words = (unit_words(key.name).replace("in ", "", 1).replace("as ", "", 1), key.meaning, key.reason)
        assert any(all(part in comment for part in words) for comment in said), f"{key.name}: {said}"


@pytest.mark.parametrize("path", sorted((FOLDER / "vehicles").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_vehicle_that_ships_can_be_flown(path):
    told = yaml.safe_load(path.read_text())
    assert load_configuration(FOLDER, [f"vehicle={path.stem}"]).battery.cells == told["sensors.battery.cells"]


def test_the_sample_for_a_stack_over_mavros_compares_what_the_other_does():
    text = (FOLDER / "mavros" / "autopilot.yaml").read_text(encoding="utf-8")
    assert text.endswith(f"\n\n{compared_parameters()}")
    shipped, mavros = (yaml.safe_load((each / "autopilot.yaml").read_text()) for each in (FOLDER, FOLDER / "mavros"))
    lists = {name: values for name, values in shipped.items() if name.endswith("parameters")}
    assert {name: mavros[name] for name in lists} == lists
    assert (len(lists), lists["offboard_parameters"]["COM_OBL_RC_ACT"]) == (3, 4)
    assert yaml.safe_load(compared_parameters()) == lists


def test_the_sample_for_a_stack_over_mavros_is_whole_and_flies():
    configuration = load_configuration(FOLDER / "mavros")
    effective = configuration.effective
    assert [*contradictions(effective), *unrecorded_topics(effective["sensors"], effective["recording"])] == []
    assert configuration.autopilot.backend == "mavros"
    topics = {topic.topic for component in configuration.components for topic in component.topics}
    assert {topic.split("/")[1] for topic in topics} == {"mavros"}
    result = run(configuration, configuration.missions)
    assert [each[:2] for each in result.results] == [("1", Result.COMPLETE)]
