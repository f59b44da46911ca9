from __future__ import annotations

import pytest
from link_fuzz import SocketFuzz, fuzz
from planner_fuzz import PlannerFuzz


@pytest.mark.parametrize("seed", [1, 2])
def test_damaged_and_hostile_mavlink_makes_no_crash_no_false_state_and_no_growth(seed):
    run, (half, end) = fuzz(seed, 1500)
    assert run.heard > 250
    assert end - half < 300_000


def test_into_the_planner_s_link_no_file_is_ever_loaded_and_nothing_takes_off():
    run, (half, end) = fuzz(1, 4000, PlannerFuzz)
    assert run.heard > 1000
    assert run.loads > 3
    assert run.read > 3  # items came back
    assert end - half < 300_000


def test_the_same_through_a_socket_and_the_thread_that_owns_it():
    run, (half, end) = fuzz(3, 800, SocketFuzz)
    assert run.heard > 250
    assert end - half < 300_000
