"""How old a message is when it comes."""

from __future__ import annotations

import pytest

from amaze_autonomy.console.link import Arrivals


def ages_s(*came):
    arrivals = Arrivals()
    return [pytest.approx(arrivals.age_s(stamp_s, now_s), abs=0.005) for now_s, stamp_s in came]


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


def on_a_link(ways_s, stamps_s=None):
    """Return the age of each of two messages a second, each so long under way."""
    sent = stamps_s or [number / 2 for number in range(len(ways_s))]
    return [told.expected for told in ages_s(*((2e5 + at + way, 1e9 + at) for at, way in zip(sent, ways_s)))]


def test_a_link_on_which_all_is_late_makes_nothing_new():
    told = on_a_link([0.05] * 40 + [8.0] * 1200)  # ten minutes of it
    assert 7.6 < min(told[40:]) <= max(told[40:]) < 7.96


def test_a_link_that_grows_slower_and_slower_is_noticed():
    told = on_a_link([0.05 + number / 40 for number in range(400)])
    assert told[-1] == pytest.approx(399 / 40, abs=0.2)


def test_two_clocks_that_go_apart_make_nothing_old():
    day = [0.05 + 0.0002 * number / 2 for number in range(2 * 86400)]  # 200 parts in a million
    assert max(on_a_link(day)) < 0.01


def test_messages_that_are_lost_on_a_link_on_which_all_is_late_make_nothing_new():
    """Of a queue that is full only each tenth message comes, and each is half a minute old."""
    fast = [number / 2 for number in range(40)]
    told = on_a_link([0.05] * 40 + [30.0] * 100, fast + [20.0 + 5.0 * number for number in range(100)])
    assert 29.0 < min(told[40:]) <= max(told[40:]) < 30.0


def test_a_clock_that_is_set_back_is_believed_at_once():
    assert ages_s((10.0, 5000.0), (10.5, 5000.5), (11.0, 100.0), (11.5, 100.5)) == [0.0, 0.0, 0.0, 0.0]


def test_a_clock_that_was_set_back_while_nothing_came_is_believed_in_the_end():
    came = [(10.0, 5000.0), *((100.0 + number / 2, 5030.0 + number / 2) for number in range(30))]
    told = ages_s(*came)
    assert [told[1].expected, told[-1]] == [pytest.approx(60.0, abs=0.05), 0.0]
