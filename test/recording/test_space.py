"""Space for a mission, before and in flight."""

import pytest

from amaze_autonomy.config.schemas.recording import Storage, TopicGroup
from amaze_autonomy.recording.status import Space
from amaze_autonomy.recording.storage import needed_bytes, time_left_s, too_little

GB = 1_000_000_000
CAMERAS = TopicGroup("cameras", ("/c",), expected_mb_s=25.0)


def test_a_long_mission_needs_more_than_the_least():
    assert needed_bytes(Storage(), [CAMERAS], 0.0) == 2 * GB
    assert needed_bytes(Storage(), [CAMERAS], 600.0) == 200_000_000 + 22_500_000_000


def test_too_little_is_said_with_both_figures():
    storage = Storage()
    assert too_little(storage, 2 * GB, Space(3 * GB, 0.5), "/rec") == ""
    assert too_little(storage, 2 * GB, Space(GB, 0.5), "/rec") == (
        "1.00 GB are free in /rec, 2.00 GB are needed for this mission: make space"
    )
    assert too_little(storage, 2 * GB, Space(3 * GB, 0.01), "/rec") == (
        "1.0% of the storage of /rec is free, at least 5.0% must be: make space"
    )


def test_the_time_that_is_left_is_that_until_the_reserve():
    assert time_left_s(Space(2 * GB, 0.1), 1e8, GB) == pytest.approx(10.0)
    assert time_left_s(None, 1e8, GB) is None
    assert time_left_s(Space(2 * GB, 0.1), 0.0, GB) is None
