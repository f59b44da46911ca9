"""What comes of a configuration that is good."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

import amaze_autonomy
from amaze_autonomy.config import hash_of, load_configuration
from amaze_autonomy.config.schemas.recording import Platform, Recording, TopicGroup
from amaze_autonomy.engine.events import Mission
from amaze_autonomy.engine.rules import ComponentRule, Limits, Rules, Severity
from amaze_autonomy.missions import Bounds, FlightEstimate, FlightModel, Round, Trajectory, Waypoint
from amaze_autonomy.monitoring.specs import (
    AutopilotSensor,
    BatterySpec,
    ComponentSpec,
    LandingSpec,
    RestartPolicy,
    RestartSpec,
    StateEstimationSpec,
    TopicSpec,
)
from amaze_autonomy.paths import config_folder

S = 1_000_000_000


def test_the_small_configuration_is_all_defaults_but_what_it_says(small):
    loaded = load_configuration(small)
    assert loaded.rules == Rules(
        (
            ComponentRule("gps", "px4", restart=False, severity=Severity.LOW, wait_limit_ns=15 * S),
            ComponentRule("camera", "other", restart=True, severity=Severity.MODERATE, wait_limit_ns=20 * S),
        ),
        Limits(),
        require_go=False,
    )
    assert loaded.components == (
        ComponentSpec("gps", "px4", Severity.LOW, autopilot=AutopilotSensor.GPS),
        ComponentSpec(
            "camera",
            "other",
            Severity.MODERATE,
            topics=(TopicSpec("/camera/image", 10.0),),
            node="/camera",
            restart=RestartSpec(RestartPolicy.NODE),
            wait_limit_ns=20 * S,
        ),
    )
    assert (loaded.landing, loaded.battery) == (LandingSpec(), BatterySpec())
    assert loaded.state_estimation == StateEstimationSpec()
    assert (loaded.flight, loaded.bounds) == (FlightModel(), Bounds())
    assert loaded.recording == Recording(
        "~/recordings", "main", (Platform("main", ("all",)),), (TopicGroup("all", ("/camera/image",)),)
    )
    assert loaded.recording.topics("main") == ("/camera/image",)


def test_a_mission_comes_with_its_waypoints_and_estimates(small):
    plan = load_configuration(small).plan("1")
    flight = FlightEstimate(length_m=4.0, duration_s=14.0)  # 5 on the ground, 2 up, 2 to the waypoint, 1 there, 4 down
    assert plan.trajectories == (Trajectory("up.csv", (Waypoint(0.0, 0.0, 2.0, 0.0, 1.0, line=3),), "yaw_rad"),)
    assert (plan.first, plan.again, plan.total) == (Round((flight,)), Round((flight,)), flight)
    assert plan.mission == Mission(
        id="1", description="Up and down", battery_needed_fraction=0.214, estimated_duration_s=14.0
    )


def test_a_mission_says_all_it_may(small):
    (small / "missions.yaml").write_text("""\
missions:
  all:
    description: Everything
    files: [up.csv, up.csv]
    repetitions: 2
    battery_needed_fraction: 0.5
    severities: {gps: high, camera: low}
    required: [gps]
    tolerated: [camera]
    limits: {max_height_m: 5.0, max_distance_m: 6.0, max_flight_time_s: 70.0}
""")
    assert load_configuration(small).missions == (
        Mission(
            id="all",
            description="Everything",
            files=2,
            repetitions=2,
            battery_needed_fraction=0.5,
            still_needed=(1.0, 0.75, 0.5, 0.25),
            estimated_duration_s=56.0,
            severities=(("gps", Severity.HIGH), ("camera", Severity.LOW)),
            required=("gps",),
            tolerated=("camera",),
            max_height_m=5.0,
            max_distance_m=6.0,
            max_flight_time_ns=70 * S,
        ),
    )


def test_a_mission_that_lists_none_needs_the_components_that_are_required():
    whole = load_configuration(config_folder())
    names = tuple(component.name for component in whole.components)
    assert whole.missions[0].required == (), "all are: the engine reads it so"
    without = load_configuration(config_folder(), ["sensors.components.realsense_imu.required=false"])
    assert {mission.required for mission in without.missions} == {tuple(n for n in names if n != "realsense_imu")}
    assert "realsense_imu" in names


def test_what_a_mission_lists_counts_whatever_the_components_say(small):
    overrides = ["sensors.components.gps.required=false", "missions.missions.1.required=[gps]"]
    assert load_configuration(small, overrides).missions[0].required == ("gps",)


def test_a_mission_that_is_not_there_is_a_key_error(small):
    with pytest.raises(KeyError, match="9"):
        load_configuration(small).plan("9")


def test_the_effective_configuration_has_every_default_and_the_hash_of_each_waypoint_file(small):
    effective = load_configuration(small).effective
    assert sorted(effective) == ["autonomy", "autopilot", "missions", "recording", "sensors", "trajectories"]
    assert effective["autonomy"]["landing"]["land_limit_s"] == 120.0
    digest = hashlib.sha256(b"# frame: east_north\nx,y,z,yaw_rad,holdtime\n0,0,2,0,1\n").hexdigest()
    assert effective["trajectories"] == {"up.csv": digest}
    assert json.loads(json.dumps(effective, allow_nan=False)) == effective


@pytest.mark.parametrize(
    "file, old, new",
    [
        ("autonomy.yaml", "false", "true"),
        ("sensors.yaml", "rate_hz: 10.0", "rate_hz: 10.5"),
        ("missions.yaml", "Up and down", "Down and up"),
        ("recording.yaml", "~/recordings", "~/other"),
        ("up.csv", "0,0,2,0,1", "0,0,2,0,2"),
    ],
)
def test_every_change_of_a_value_changes_the_hash(small, file, old, new):
    before = load_configuration(small).hash
    text = (small / file).read_text()
    (small / file).write_text(text.replace(old, new))
    assert load_configuration(small).hash != before


def test_how_a_value_is_written_does_not_change_the_hash(small, tmp_path_factory):
    before = load_configuration(small).hash
    text = (small / "sensors.yaml").read_text()
    (small / "sensors.yaml").write_text("# a comment\n" + text.replace("10.0", "10").replace("20.0", "2.0e+1"))
    (small / "autonomy.yaml").write_text("{'require_go': no, flight: {max_height_m: 30}}\n")
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    for path in small.iterdir():
        (elsewhere / path.name).write_bytes(path.read_bytes())
    assert load_configuration(elsewhere).hash == before


def test_the_hash_is_of_canonical_json():
    canonical = b'{"a":{"\\u00e9":"x"},"b":[1,2.5,null,true]}'
    assert hash_of({"b": [1, 2.5, None, True], "a": {"\u00e9": "x"}}) == hashlib.sha256(canonical).hexdigest()


@pytest.mark.parametrize("seed", ["0", "1", "77"])
def test_the_hash_does_not_depend_on_the_process(small, seed):
    code = "import sys; from amaze_autonomy.config import load_configuration as l; print(l(sys.argv[1]).hash)"
    source = str(Path(amaze_autonomy.__file__).parents[1])
    ran = subprocess.run(
        [sys.executable, "-c", code, str(small)],
        env={"PYTHONHASHSEED": seed, "PYTHONPATH": source},
        stdout=subprocess.PIPE,
        check=True,
        timeout=120,
    )
    assert ran.stdout.decode().strip() == load_configuration(small).hash
