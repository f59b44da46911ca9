"""Growth and rate of files."""

import pytest

from amaze_autonomy.recording.platform_recorder import Growth

S = 1_000_000_000


def test_the_rate_is_taken_over_the_window_and_growth_has_a_limit():
    growth = Growth()
    assert (growth.rate, growth.grows(0, 3 * S)) == (0.0, False)
    for second in range(10):
        growth.add(second * S, 1000 * second)
    assert growth.rate == pytest.approx(1000.0)
    for second in range(10, 20):
        growth.add(second * S, 9000)
    assert (growth.rate, growth.size, growth.grows(12 * S, 3 * S), growth.grows(13 * S, 3 * S)) == (
        0.0, 9000, True, False,
    )  # fmt: skip
