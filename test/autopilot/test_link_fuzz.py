from __future__ import annotations

import pytest
from link_fuzz import fuzz


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_and_hostile_mavlink_makes_no_crash_no_false_state_and_no_growth(seed):
    run, (half, end) = fuzz(seed, 1500)
    assert run.heard > 250
    assert end - half < 300_000
