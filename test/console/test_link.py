"""How old a message is when it comes."""

from __future__ import annotations

import pytest

from amaze_autonomy.console.link import Arrivals


def ages_s(*came):
    arrivals = Arrivals()
    return [pytest.approx(arrivals.age_s(stamp_s, now_s), abs=1e-6) for now_s, stamp_s in came]


@pytest.mark.parametrize("apart_s", [0.0, 7200.0, -1.8e9])
def test_a_delay_counts_and_clocks_that_are_apart_do_not(apart_s):
    came = ((2e9, 0.0), (2e9 + 0.5, 0.5), (2e9 + 3.0, 1.0), (2e9 + 3.1, 1.5), (2e9 + 3.1, 3.1))
    told = ages_s(*((now_s, 1.9e9 + apart_s + stamp_s) for now_s, stamp_s in came))
    assert told == [0.0, 0.0, 2.0, 1.6, 0.0]


def test_the_same_message_once_more_is_as_old_as_it_is():
    assert ages_s((10.0, 50.0), (20.0, 50.0), (400.0, 50.0)) == [0.0, 10.0, 390.0]


def test_a_message_without_a_stamp_is_new():
    assert ages_s((10.0, 0.0), (20.0, 0.0)) == [0.0, 0.0]


def test_a_first_message_that_was_old_makes_no_later_one_old():
    assert ages_s((100.0, 10.0), (100.4, 100.3), (100.9, 100.8)) == [0.0, 0.0, 0.0]


def test_a_clock_that_is_set_back_is_believed_at_once():
    assert ages_s((10.0, 5000.0), (10.5, 5000.5), (11.0, 100.0), (11.5, 100.5)) == [0.0, 0.0, 0.0, 0.0]


def test_a_clock_that_was_set_back_while_nothing_came_is_believed_in_the_end():
    came = [(10.0, 5000.0), *((100.0 + number / 2, 5030.0 + number / 2) for number in range(30))]
    told = ages_s(*came)
    assert [told[1], told[-1]] == [60.0, 0.0]
