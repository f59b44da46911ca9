"""The offset of a clock by exchanges: exact when both ways take the same time, bounded by half the round trip."""

import random

import pytest

from amaze_autonomy.recording.collector import Exchange, Offset, best, clock_step_ns, correction_ns

MS = 1_000_000
S = 1_000_000_000


def exchange(offset_ns, out_ns, back_ns, at_ns=100 * S, held_ns=MS):
    received = at_ns + out_ns + offset_ns
    return Exchange(at_ns, received, received + held_ns, at_ns + out_ns + held_ns + back_ns)


def test_equal_ways_give_the_exact_offset():
    assert exchange(3 * S, 2 * MS, 2 * MS).offset_ns == 3 * S
    assert best([exchange(-3 * S, MS, MS)]) == Offset(-3 * S, MS, 100 * S + 3 * MS)


def test_the_shortest_round_trip_counts():
    found = best([exchange(S, 50 * MS, MS), exchange(S, MS, MS), exchange(S, MS, 80 * MS)])
    assert found == Offset(S, MS, 100 * S + 3 * MS)


@pytest.mark.parametrize("seed", range(20))
def test_the_offset_is_wrong_by_no_more_than_it_says(seed):
    chance = random.Random(seed)
    offset = chance.randint(-3 * S, 3 * S)
    found = best([exchange(offset, chance.randint(0, 300 * MS), chance.randint(0, 300 * MS)) for _ in range(16)])
    assert abs(found.offset_ns - offset) <= found.error_ns


def test_impossible_exchanges_are_left_out():
    assert best([]) is None
    assert best([Exchange(10, 0, 100, 20), Exchange(0, 10, 5, 30)]) is None


def test_record_times_are_corrected_by_the_mean_of_all_offsets():
    start, stop = Offset(3 * S, 10, 0), Offset(3 * S + 2 * MS, 10, 0)
    assert correction_ns([start, stop]) == -(3 * S + MS)
    assert correction_ns([start, start, start, stop]) == -(3 * S + MS // 2)
    assert correction_ns([start]) == -3 * S
    assert correction_ns([]) == 0


@pytest.mark.parametrize("minutes", [0, 10, 60])
def test_clocks_that_drift_apart_as_crystals_do_or_are_slewed_by_ntp_were_not_stepped(minutes):
    later_ns = minutes * 60 * S
    start, stop = Offset(-S, 3 * MS, S), Offset(-S + later_ns * 500 // 1_000_000 + 100 * MS, 2 * MS, S + later_ns)
    assert clock_step_ns([start, stop]) == clock_step_ns([]) == clock_step_ns([stop]) == 0
    assert correction_ns([start, stop]) == -(start.offset_ns + stop.offset_ns) // 2


def test_what_a_busy_network_makes_uncertain_is_no_step():
    start, stop = Offset(0, 400 * MS, 0), Offset(600 * MS, 150 * MS, 60 * S)
    assert clock_step_ns([start, stop]) == 0
    assert clock_step_ns([Offset(0, 40 * MS, 0), stop]) == 600 * MS


@pytest.mark.parametrize("step_ns", [60 * S, -60 * S, 20_000 * 86_400 * S])
def test_offsets_that_contradict_each_other_correct_nothing(step_ns):
    start, stop = Offset(3 * S, 10, 100 * S), Offset(3 * S + step_ns, 10, 700 * S)
    assert clock_step_ns([start, stop]) == clock_step_ns([stop, start]) == abs(step_ns)
    assert correction_ns([start, stop]) == 0


def test_a_step_between_two_recordings_of_a_session_is_not_taken_for_the_drift_of_its_whole_time():
    hour_ns = 3600 * S
    first = [Offset(0, 10, 0), Offset(0, 10, hour_ns)]
    second = [Offset(S, 10, hour_ns + 60 * S), Offset(S + 500 * MS, 10, 2 * hour_ns)]
    assert clock_step_ns(first) == clock_step_ns(second) == 0
    assert clock_step_ns([*first, *second]) == S
    assert correction_ns([*first, *second]) == 0
