"""Keys that nobody knows, keys that are missing, names that are none."""

from __future__ import annotations

import pytest

from amaze_autonomy.config import FILES
from amaze_autonomy.config.kinds import ListOf, Number, Whole, split_unit
from amaze_autonomy.config.schema import Group, Named

TOPIC = "components.camera.topics./camera/image"
KNOWN = "rate_hz, tolerance_fraction, rate_failed_fraction, age_limit_s, window_s, finite, unchanged_limit_s, "


@pytest.mark.parametrize(
    "key, rest",
    [
        ("age_limit_ms: 500", "age_limit_ms: is an unknown key; did you mean age_limit_s (500 ms are 0.5 s)?"),
        ("age_limit_min: 2", "age_limit_min: is an unknown key; did you mean age_limit_s (2 min are 120 s)?"),
        ("age_limit_m: 2", "age_limit_m: is an unknown key; did you mean age_limit_s (in seconds)?"),
        ("age_limit: 2", "age_limit: is an unknown key; did you mean age_limit_s (in seconds)?"),
        ("age_limit_ms: soon", "age_limit_ms: is an unknown key; did you mean age_limit_s (in seconds)?"),
        (
            "tolerance_percent: 20",
            "tolerance_percent: is an unknown key; did you mean tolerance_fraction (20 percent are 0.2 fraction)?",
        ),
        ("agelimit_s: 2", "agelimit_s: is an unknown key; did you mean age_limit_s?"),
        ("colour: red", f"colour: is an unknown key; known here: {KNOWN}stamp_tolerance_s, recorded"),
    ],
)
def test_an_unknown_key_is_answered_with_the_one_that_was_meant(mistake, small_file, key, rest):
    text = small_file("sensors.yaml").replace("{rate_hz: 10.0}", f"{{rate_hz: 10.0, {key}}}")
    assert mistake("sensors.yaml", text) == f"sensors.yaml:12: {TOPIC}.{rest}"


def test_a_missing_key_is_named_where_its_group_begins(mistake, small_file):
    text = small_file("sensors.yaml").replace("{rate_hz: 10.0}", "{age_limit_s: 1.0}")
    assert mistake("sensors.yaml", text) == (
        f"sensors.yaml:12: {TOPIC}.rate_hz: is missing; "
        "must be given: a number at least 0.001 and at most 100000, in Hz"
    )


def test_a_group_that_must_be_there_is_missing(mistake):
    assert mistake("missions.yaml", "flight: {}\n") == (
        "missions.yaml:1: missions: is missing; must be given: a group with a key for each of the missions, at least 1"
    )


def test_an_empty_group_of_names_is_refused(mistake):
    assert mistake("missions.yaml", "missions: {}\n") == (
        "missions.yaml:1: missions: is empty; must be a group with a key for each of the missions, at least 1"
    )


def test_a_name_that_is_none_is_refused(mistake, small_file):
    text = small_file("sensors.yaml").replace("  gps:", "  G P S:")
    assert mistake("sensors.yaml", text) == (
        "sensors.yaml:2: components.G P S: is not a good name; must match [a-z][a-z0-9_]{0,63}"
    )


def test_a_mission_may_have_a_number_for_a_name_with_and_without_quotes(small):
    from amaze_autonomy.config import load_configuration  # noqa: PLC0415

    (small / "missions.yaml").write_text("missions:\n  007:\n    description: x\n    files: [up.csv]\n")
    assert [mission.id for mission in load_configuration(small).missions] == ["007"]


def _keys(group, path=""):
    for key in group.keys:
        kind, here = key.kind, f"{path}{key.name}"
        yield here, key
        if isinstance(kind, Named):
            kind, here = kind.kind, f"{here}.<name>"
        if isinstance(kind, Group):
            yield from _keys(kind, f"{here}.")


ALL_KEYS = [(f"{file}.{path}", key) for file, group in FILES.items() for path, key in _keys(group)]
WITHOUT_UNIT = {"scale", "sentinels", "quaternion_tolerance"}


@pytest.mark.parametrize("path, key", ALL_KEYS, ids=[path for path, _ in ALL_KEYS])
def test_every_key_says_its_meaning_and_every_quantity_its_unit(path, key):
    assert key.meaning
    kind = key.kind.kind if isinstance(key.kind, ListOf) else key.kind
    if isinstance(kind, Number) and key.name not in WITHOUT_UNIT:
        assert split_unit(key.name)[1], f"{path} has no unit"
    if isinstance(kind, Whole):
        assert split_unit(key.name)[1] in ("", "kb", "mb")
