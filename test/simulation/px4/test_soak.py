"""A few missions over a bad radio; two hundred: ./run soak."""

from __future__ import annotations

import pytest
from bad_line import Quality
from soak import MS, Soak

pytestmark = pytest.mark.long


def test_missions_over_a_bad_radio_are_flown_each_command_once():
    soak = Soak(Quality(loss=0.05, jitter_ns=50 * MS), seed=4)
    flown = [soak.fly(number, hold=number % 4 == 2) for number in range(12)]
    assert [each.problem for each in flown] == [""] * 12
    assert soak.lost > 1000


def test_the_soak_sees_a_command_that_has_effect_twice():
    soak = Soak(Quality(), seed=1)
    soak.craft.flags.not_ready.clear()
    original = soak.craft.fall_into

    def twice(mode):
        original("POSCTL" if mode == "AUTO.MISSION" and soak.craft.airborne else mode)
        original(mode)

    soak.craft.fall_into = twice
    assert "pilot" in soak.fly(2, hold=True).problem
