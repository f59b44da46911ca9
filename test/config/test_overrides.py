"""Single values on top of the files."""

from __future__ import annotations

import pytest

from amaze_autonomy.config import ConfigError, load_configuration
from amaze_autonomy.engine.rules import Severity


def test_an_override_replaces_what_the_file_says(small):
    changed = load_configuration(small, ["autonomy.require_go=true", "sensors.components.gps.severity=highest"])
    assert changed.rules.require_go is True
    assert changed.components[0].severity is Severity.HIGHEST


def test_an_override_says_what_the_file_leaves_to_its_default(small):
    changed = load_configuration(small, ["sensors.components.camera.topics./camera/image.tolerance_fraction=0.3"])
    assert changed.components[1].topics[0].tolerance_fraction == 0.3
    assert changed.components[1].topics[0].rate_hz == 10.0


def test_overrides_can_be_plain_values(small):
    changed = load_configuration(small, {"autonomy.flight.max_height_m": 12, "missions.missions.1.required": ["gps"]})
    assert changed.rules.limits.max_height_m == 12.0
    assert changed.missions[0].required == ("gps",)


def test_the_last_override_wins(small):
    texts = ["autonomy.flight.max_height_m=12.0", "autonomy.flight.max_height_m=13.0"]
    assert load_configuration(small, texts).rules.limits.max_height_m == 13.0


def test_an_override_and_the_same_value_in_the_file_are_one_configuration(small):
    by_override = load_configuration(small, ["autonomy.require_go=true"])
    (small / "autonomy.yaml").write_text("require_go: true\n")
    assert load_configuration(small).hash == by_override.hash


@pytest.fixture
def with_vehicle(small):
    (small / "vehicles").mkdir()
    lines = "autonomy.flight.max_height_m: 14.0\nautonomy.require_go: true\n"
    (small / "vehicles" / "small_quad.yaml").write_text(lines)
    return small


@pytest.mark.parametrize("first", [True, False])
def test_a_vehicle_stands_for_its_overrides_and_those_given_beside_it_win(with_vehicle, first):
    given = ["vehicle=small_quad", "autonomy.flight.max_height_m=13.0"]
    rules = load_configuration(with_vehicle, given if first else given[::-1]).rules
    assert (rules.limits.max_height_m, rules.require_go) == (13.0, True)
    assert load_configuration(with_vehicle, {"vehicle": "small_quad"}).rules.limits.max_height_m == 14.0


@pytest.mark.parametrize("name", ["big_quad", "../small_quad", "", "null", "[small_quad]"])
def test_a_vehicle_that_is_not_there_is_a_mistake(with_vehicle, name):
    with pytest.raises(ConfigError) as caught:
        load_configuration(with_vehicle, {"vehicle": name} if name != "[small_quad]" else {"vehicle": ["small_quad"]})
    known = f"must be one of those in {with_vehicle / 'vehicles'}: small_quad"
    assert str(caught.value) == f"override vehicle: names no vehicle; {known}"


def test_a_mistake_in_a_vehicles_file_is_told_with_its_line(with_vehicle):
    path = with_vehicle / "vehicles" / "small_quad.yaml"
    path.write_text("# a comment\nautonomy.flight.max_height_ft: 10\n")
    with pytest.raises(ConfigError) as caught:
        load_configuration(with_vehicle, ["vehicle=small_quad"])
    words = "flight.max_height_ft: is an unknown key; did you mean max_height_m (10 ft are 3.048 m)?"
    assert str(caught.value) == f"{path}:2: {words}"
    path.write_text("- 1\n")
    with pytest.raises(ConfigError, match="holds no overrides; must hold lines of file"):
        load_configuration(with_vehicle, ["vehicle=small_quad"])


FILES = "autonomy, sensors, missions, recording, autopilot"
NO_KEY = f"addresses no key; must be file.key.key=value with the file one of {FILES}"


@pytest.mark.parametrize(
    "override, message",
    [
        ("autonomy.require_go", "has no value; must be file.key.key=value"),
        ("autonomy=1", NO_KEY),
        ("autonomy.=1", NO_KEY),
        ("engine.require_go=1", NO_KEY),
        ("autonomy.require_go.now=1", "leads through a single value; must address a key of a group"),
        ("autonomy.require_go=", "is empty; must be one YAML document"),
        ("autonomy.require_go=1", "require_go: is 1; must be true or false"),
        ("autonomy.flight.max_height_ft=10",
         "flight.max_height_ft: is an unknown key; did you mean max_height_m (10 ft are 3.048 m)?"),
        ("recording.storage.min_free_mb=2000",
         "storage.min_free_mb: is an unknown key; did you mean min_free_gb (2000 mb are 2 gb)?"),
        ("recording.storage.min_free_mb=much",
         "storage.min_free_mb: is an unknown key; did you mean min_free_gb (in gigabytes)?"),
        ("recording.storage.min_free_percent=5",
         "storage.min_free_percent: is an unknown key; did you mean min_free_fraction (5 percent are 0.05 fraction)?"),
        ("recording.storage.min_free=2",
         "storage.min_free: is an unknown key; did you mean min_free_fraction (as a fraction of 1)?"),
        ("missions.flight.cruise_speed_cm_s=100",
         "flight.cruise_speed_cm_s: is an unknown key; did you mean cruise_speed_m_s (100 cm_s are 1 m_s)?"),
        ("missions.flight.cruise_speed_mm_s=100",
         "flight.cruise_speed_mm_s: is an unknown key; did you mean cruise_speed_m_s (100 mm_s are 0.1 m_s)?"),
        ("autonomy.losses.planner_status_limit_s=2.0", "losses: is an unknown key; it is called failsafe now"),
        ("autonomy.flight.max_height_cm=900",
         "flight.max_height_cm: is an unknown key; did you mean max_height_m (900 cm are 9 m)?"),
        ("sensors.components.gps.restart.policy=node",
         "components.gps.restart.policy: is node; must be never in group px4: the vehicle would be uncontrollable"),
        ("autonomy.flight.max_height_m=0.5",
         "flight.max_height_m: is 0.5; must be above takeoff.takeoff_height_m (1): "
         "else every takeoff ends in a landing"),
    ],
)  # fmt: skip
def test_an_override_is_checked_like_the_files(small, override, message):
    with pytest.raises(ConfigError) as caught:
        load_configuration(small, [override])
    assert str(caught.value) == f"override {override}: {message}"


def test_an_override_of_what_is_missing_does_not_hide_that_it_is(small):
    with pytest.raises(ConfigError) as caught:
        load_configuration(small, {"sensors.components.lrf.severity": "low"})
    assert str(caught.value) == (
        "override sensors.components.lrf.severity: components.lrf.group: is missing; must be given: one of px4, other"
    )
