"""Two vehicles with one system id: ours stays ours, the other is named and never believed."""

from __future__ import annotations

import random
import time

import pytest
from autopilot_tools import Recorder, UdpVehicle, beat, free_port, wait_until
from client_bench import ClientBench
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from amaze_autonomy.autopilot import Connection, Identity
from amaze_autonomy.autopilot.link.connection import link_problem
from amaze_autonomy.autopilot.link.peers import Sources, _Between
from amaze_autonomy.config import AutopilotSettings
from amaze_autonomy.engine.events import Landed, Verdict
from amaze_autonomy.monitoring.specs import BatterySpec

S, MS = 1_000_000_000, 1_000_000
HERE, THERE = ("10.0.0.1", 14550), ("10.0.0.2", 14550)


def say(sources, t_s, place=HERE, sequence=None, boot_s=None, state=None, armed=None):
    """Let a source say something; its number follows its last one."""
    state = state if state is not None else say.numbers
    number = state.get(place, -1) + 1 if sequence is None else sequence
    state[place] = number % 256
    boot_ms = None if boot_s is None else round((t_s - boot_s) * 1000)
    return sources.take(round(t_s * S), place, number % 256, boot_ms, armed=armed)


@pytest.fixture(autouse=True)
def _fresh_numbers():
    say.numbers = {}


def test_the_first_address_is_ours_and_a_second_one_a_stranger_with_its_name():
    sources = Sources()
    for tick in range(50):
        assert say(sources, tick / 10) is True
        assert say(sources, tick / 10, THERE) is False
    assert sources.strangers(5 * S) == ("10.0.0.2:14550",)
    assert sources.strangers(20 * S) == ()


def test_in_flight_our_silence_is_silence_though_the_other_speaks_on():
    sources = Sources()
    say(sources, 0.0)
    sources.armed = True
    assert [say(sources, tick / 10, THERE) for tick in range(600)] == [False] * 600
    assert say(sources, 60.5) is True


def test_one_forged_datagram_is_named_and_not_believed():
    sources = Sources()
    for tick in range(20):
        say(sources, tick / 10)
    assert say(sources, 2.0, THERE) is False
    assert sources.strangers(2 * S) == ("10.0.0.2:14550",)
    assert say(sources, 2.1) is True


def test_on_the_ground_a_vehicle_at_another_address_follows_one_that_is_silent():
    """A restarted autopilot or router speaks from another port."""
    sources = Sources()
    say(sources, 0.0, boot_s=-100.0)
    heard = [say(sources, 0.1 + tick / 10, THERE, boot_s=0.0) for tick in range(40)]
    assert (heard.index(True), all(heard[heard.index(True) :])) == (25, True)
    assert sources.strangers(8 * S) == ()


def test_in_flight_a_vehicle_that_has_moved_to_another_address_is_known_by_its_boot_time():
    sources = Sources()
    say(sources, 0.0, boot_s=-100.0)
    sources.armed = True
    assert not any(say(sources, 0.1 + tick / 10, THERE, boot_s=-30.0) for tick in range(60))
    moved = ("10.0.0.3", 1)
    heard = [say(sources, 7.0 + tick / 10, moved, boot_s=-100.02) for tick in range(5)]
    assert heard == [False, False, True, True, True]


@pytest.mark.parametrize(
    "boot_s, armed, believed",
    [(50.0, False, True), (50.0, True, False), (50.0, None, False), (-30.0, False, False), (None, False, False)],
    ids=["restarted", "armed", "without heartbeats", "a stranger that was on before", "nothing of its start"],
)
def test_a_vehicle_that_lost_its_power_while_armed_is_ours_at_another_address_too(boot_s, armed, believed):
    sources = Sources()
    say(sources, 0.0, boot_s=-100.0, armed=True)
    sources.armed = True
    heard = []
    for tick in range(100):
        said = {"armed": armed} if tick % 10 == 0 else {"boot_s": boot_s}
        heard.append(say(sources, 60.0 + tick / 10, THERE, **said))
    assert (any(heard), all(heard[10:])) == (believed, believed)
    assert say(sources, 70.5, boot_s=-100.0) is not believed


def test_a_vehicle_that_is_switched_on_during_a_short_silence_of_ours_in_flight_is_a_stranger():
    sources = Sources()
    say(sources, 0.0, boot_s=-100.0, armed=True)
    sources.armed = True
    assert not any(say(sources, 2.0 + tick / 10, THERE, boot_s=1.0, armed=False) for tick in range(80))
    assert say(sources, 10.1, boot_s=-100.0) is True


# --- one address: a router ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("lost", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(4))
def test_a_vehicle_alone_is_heard_whatever_is_lost(lost, seed):
    chance, sources, number, taken, sent = random.Random(seed), Sources(), 0, 0, 0
    for tick in range(5000):
        number += 1
        if chance.random() < lost or 2000 < tick < 2200:  # and 400 ms without a word
            continue
        sent += 1
        taken += say(sources, tick / 500, sequence=number, boot_s=-10.0 if tick % 50 == 0 else None)
    assert sent - taken <= 3
    assert sources.strangers(10 * S) == ()


def test_a_backlog_of_which_the_rest_was_lost_is_no_second_vehicle():
    """A socket that nobody read for a while holds the first of what came; the rest was dropped, again and again."""
    sources, number = Sources(), 0
    for burst in range(6):
        for _ in range(200):
            say(sources, burst * 0.3, sequence=number)
            number += 1
        number += 97 + burst
        for tick in range(20):
            say(sources, burst * 0.3 + 0.01 + tick / 500, sequence=number)
            number += 1
            assert sources.strangers(round((burst * 0.3 + 0.01 + tick / 500) * S)) == ()
        number += 83
    assert sources.strangers(3 * S) == ()


def test_datagrams_that_overtake_one_another_are_no_strangers():
    sources, numbers = Sources(), [0, 1, 2, 5, 3, 4, 6, 8, 7, 9, 9, 10]
    assert all(say(sources, tick / 500, sequence=number) for tick, number in enumerate(numbers))
    assert sources.strangers(S) == ()


@pytest.mark.parametrize("seed", range(4))
def test_a_moment_in_which_much_overtakes_does_not_leave_the_link_deaf(seed):
    """Half of 0.2 s comes 150 ms late, on a link where a tenth always comes a little late: for seconds, no longer."""
    noise, sources = random.Random(seed), Sources()
    sources.armed = True
    sent = []
    for number in range(380 * 70):
        at_ms = number / 0.38
        scrambled = 5000 <= at_ms < 5200 and noise.random() < 0.5
        late_ms = 150.0 if scrambled else 40.0 * noise.random() if noise.random() < 0.1 else 0.0
        boot = number % 19 == 0  # as often as ATTITUDE and positions say it
        sent.append((at_ms + late_ms, number, round(at_ms) + 100_000 if boot else None))
    heard = [sources.take(round(t_ms * MS), HERE, number % 256, boot) for t_ms, number, boot in sorted(sent)]
    last = heard[380 * 15 :]
    assert sum(last) / len(last) > 0.95
    assert sources.strangers(70 * S) == ()


def test_an_autopilot_that_was_restarted_behind_the_same_address_is_heard_again_at_once():
    sources = Sources()
    for tick in range(100):
        say(sources, tick / 100, sequence=tick, boot_s=-500.0)
    heard = [say(sources, 1.2 + tick / 100, sequence=tick, boot_s=1.1) for tick in range(50)]
    assert heard == [False, False] + [True] * 48
    assert sources.strangers(2 * S) == ()


@pytest.mark.parametrize("seed", range(40))
def test_an_autopilot_that_starts_again_in_flight_is_heard_before_the_link_counts_as_lost(seed):
    """Its first words say no boot time, and go on from any number; what comes then has numbers of both."""
    chance, sources = random.Random(seed), Sources()
    sources.armed = True
    rate, down_s, mute = chance.choice([50, 150, 450]), chance.uniform(0.2, 6.0), chance.randrange(12)
    for number in range(5 * rate):
        assert say(sources, number / rate, boot_s=-40.0 if number % 5 == 0 else None)
    say.numbers[HERE] = chance.choice([-1, say.numbers[HERE], chance.randrange(256)])
    heard = []
    for number in range(20 * rate):
        t_s = 5.0 + down_s + number / rate
        has_boot = number >= mute and chance.random() < 0.7
        heard += [t_s] if say(sources, t_s, boot_s=5.0 + down_s - 0.2 if has_boot else None) else []
    late_s = [after - before for before, after in zip([5.0 + down_s, *heard], heard)]
    assert max(late_s) < 2.0
    assert heard[-1] > 24.9 + down_s
    assert sources.strangers(round(t_s * S)) == ()


@pytest.mark.parametrize("gap_s", [12.0, 30.0, 60.0, 600.0])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("beats_alone_s, lost", [(0.0, 0.0), (4.0, 0.0), (0.0, 0.2), (4.0, 0.2)])
@pytest.mark.slow_rows
def test_a_vehicle_that_lost_its_power_while_armed_is_no_stranger_behind_its_own_address(
    gap_s, seed, beats_alone_s, lost
):
    """Its first words say no boot time, and count for those of the one before; then its start is another one."""
    chance, sources = random.Random(seed), Sources()
    sources.armed = True
    for number in range(290 * 20):
        assert say(sources, number / 290, sequence=number, boot_s=-100.0 if number % 10 == 0 else None)
    again_s, refused = 20.0 + gap_s, []
    for number in range(round(beats_alone_s)):
        say(sources, again_s + number, sequence=seed * 77 + number, armed=False)
    for number in range(290 * 40):
        t_s = again_s + beats_alone_s + number / 290
        boot_s = again_s - 5.0 if number > 5 and chance.random() < 0.1 else None
        count = seed * 77 + round(beats_alone_s) + number
        if chance.random() >= lost and not say(sources, t_s, sequence=count, boot_s=boot_s):
            refused.append(t_s - again_s - beats_alone_s)
        assert t_s < again_s + 3 or sources.strangers(round(t_s * S)) == ()
    assert max(refused, default=0.0) < 1.5


@pytest.mark.parametrize("rate", [50, 150, 450])
@pytest.mark.parametrize("ahead", [0, 20, 40, 100, 180, 240])
def test_a_stranger_that_was_started_in_a_silence_of_ours_in_flight_takes_nothing_while_ours_speaks(rate, ahead):
    """Ours, at 4 Hz, says no boot time for a while after it: only who goes on with its numbers takes its place."""
    sources = Sources()
    spoken = [(number / 4, 0, number, -100.0) for number in (*range(41), *range(108, 160))]
    spoken += [(number / 4, 0, number, None) for number in range(72, 108)]
    spoken += [
        (20.1 + number / rate, 1, 80 + ahead + number, 10.2 if number % 5 == 0 else None) for number in range(20 * rate)
    ]
    sources.armed, wrong, taken = True, 0, 0
    for t_s, who, number, boot_s in sorted(spoken, key=lambda said: said[:2]):
        heard = say(sources, t_s, sequence=number, boot_s=boot_s)
        if t_s > 28:
            wrong, taken = wrong + (heard and who == 1), taken + (heard and who == 0)
    assert (wrong, taken) == (0, 47)


@pytest.mark.parametrize("offset", [100, 128, 200])
@pytest.mark.parametrize("rates", [(500, 490), (500, 100), (100, 500)])
def test_two_vehicles_behind_one_router_are_never_mixed(offset, rates):
    """Each message is of one of two runs; what nobody can tell apart is lost, nothing of the other is taken.

    Runs nearer than datagrams may overtake one another, 32 numbers, are told apart by their boot times alone.
    """
    sources, wrong, taken, sent = Sources(), 0, 0, 0
    times = sorted(
        [(n / rates[0], 0, n) for n in range(5 * rates[0])]
        + [(n / rates[1] + 0.0007, 1, n) for n in range(5 * rates[1])]
    )
    for t_s, who, number in times:
        boot_s = (-100.0, -40.0)[who] if number % 10 == 0 else None
        ours = sources.take(
            round(t_s * S),
            HERE,
            (number + (0, offset)[who]) % 256,
            None if boot_s is None else round((t_s - boot_s) * 1000),
        )
        wrong += ours and who == 1
        taken += ours and who == 0
        sent += who == 0
    assert wrong <= 2
    assert taken > 0.6 * sent
    assert sources.strangers(5 * S) == ("10.0.0.1:14550, where ours is, too",)


def two_behind_one_router(offset, loss, seconds):
    """Return what is said, in its order, by two whose numbers are this far apart: time, number, boot time."""
    chance, said = random.Random(offset), []
    for number in range(290 * seconds):
        for who, boot_s in enumerate((-100.0, -4000.0)):
            t_s = number / 290 + who * 0.0017
            if chance.random() >= loss:
                said.append((t_s, number + who * offset, boot_s if chance.random() < 0.1 else None))
    return said


BESIDE_OURS = ("10.0.0.1:14550, where ours is, too",)


@pytest.mark.parametrize("offset, loss", [(16, 0.05), (224, 0.05), (240, 0.05), (16, 0.2), (240, 0.2)])
def test_a_second_vehicle_behind_one_router_stays_told_while_it_speaks(offset, loss):
    """Near each other and with losses, what both go on with ends the run of the second one now and then."""
    sources, told = Sources(), []
    for t_s, number, boot_s in two_behind_one_router(offset, loss, 40):
        say(sources, t_s, sequence=number, boot_s=boot_s)
        told.append(bool(sources.strangers(round(t_s * S))))
    assert all(told[told.index(True) :])
    assert told.index(True) < len(told) / 4
    assert sources.strangers(50 * S) == BESIDE_OURS
    assert sources.strangers(75 * S) == ()


@pytest.mark.parametrize("rate", [20, 50, 120, 290, 600])
@pytest.mark.parametrize("beats_hz", [1, 2])
@pytest.mark.parametrize("lost", [0.0, 0.05])
@pytest.mark.slow_rows
def test_one_that_says_heartbeats_alone_is_told_by_its_numbers_between_ours(rate, beats_hz, lost):
    """It never makes a run: ours passes over its numbers again and again."""
    chance, sources = random.Random(rate), Sources()
    said = [(number / rate, 0, number) for number in range(60 * rate)]
    said += [(0.5 + beat / beats_hz + 0.0003, 1, 37 + beat) for beat in range(60 * beats_hz)]
    for t_s, who, number in sorted(said):
        if chance.random() >= lost:
            say(sources, t_s, sequence=number, armed=who == 0 if number % rate == 0 or who else None)
            assert t_s < 20 or sources.strangers(round(t_s * S)) == BESIDE_OURS
    for number in range(60 * rate, 95 * rate):  # the other one was switched off
        say(sources, number / rate, sequence=number)
        told = sources.strangers(round(number / rate * S))
        assert number / rate < 92 or told == ()


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 1 << 30),
    rate=st.sampled_from([3, 10, 50, 150, 450, 600]),
    lost=st.sampled_from([0.0, 0.05, 0.3, 0.6, 0.9]),
    burst_s=st.sampled_from([0.0, 0.1, 0.5, 1.5]),
    jitter=st.sampled_from([0, 8, 30]),
    stall_s=st.sampled_from([0.0, 0.4, 3.0]),
)
def test_numbers_of_one_vehicle_never_lie_between_its_own(seed, rate, lost, burst_s, jitter, stall_s):
    """However much of them is lost, by ones and in bursts, comes late and by then in parts, and overtakes one another.

    Jitter: in messages.
    """
    chance, between, sent = random.Random(seed), _Between(), []
    losing_s = stalls_s = 0.0
    for number in range(40 * rate):
        t_s = number / rate
        losing_s = t_s + chance.random() * burst_s if burst_s and chance.random() < 1 / rate else losing_s
        if t_s >= losing_s and chance.random() >= lost:
            sent.append((t_s + chance.random() * jitter / rate, number))
    for place, (t_s, number) in enumerate(sorted(sent)):
        stalls_s = t_s + chance.random() * stall_s if stall_s and chance.random() < 0.3 / rate else stalls_s
        if t_s >= stalls_s or place % 700 < 200:
            between.add(round(max(t_s, stalls_s) * S), number % 256)
            assert not between.tells(round(max(t_s, stalls_s) * S))


def test_a_link_that_was_opened_again_tells_of_nobody():
    sources = Sources()
    for t_s, number, boot_s in two_behind_one_router(100, 0.0, 6):
        say(sources, t_s, sequence=number, boot_s=boot_s)
    assert sources.strangers(6 * S) == BESIDE_OURS
    sources.forget()
    assert sources.strangers(6 * S) == ()
    say(sources, 7.0, THERE)
    assert sources.strangers(7 * S) == ()


@pytest.mark.parametrize("seed", [10, 56, 62, 105, *range(4)])
def test_one_vehicle_is_one_again_after_a_start_at_which_much_was_lost(seed):
    """Bursts that are lost and read late leave runs; two of one vehicle must not live beside one another for ever."""
    chance, sources = random.Random(seed), Sources()
    rate, disturbed_s, stall_s = chance.choice([50, 150, 450]), chance.uniform(1.0, 6.0), chance.choice([0.3, 1.5])
    read_s, losing, backlog, taken, sent = 0.0, False, [], 0, 0
    for number in range(20 * rate):
        t_s = number / rate
        if t_s < disturbed_s:
            losing ^= chance.random() < (0.3 if losing else 0.03)
            if losing or len(backlog) > 277:
                continue
        backlog.append((number, None if chance.random() < 0.8 else -30.0))
        if t_s < min(disturbed_s, read_s):
            continue
        read_s = t_s + chance.expovariate(1 / stall_s)
        for each, boot_s in backlog:
            boot_ms = None if boot_s is None else round((each / rate - boot_s) * 1000)
            heard = sources.take(round(t_s * S), HERE, each % 256, boot_ms)
            sent, taken = sent + (t_s > disturbed_s + 8), taken + (heard and t_s > disturbed_s + 8)
        backlog.clear()
        assert t_s < disturbed_s + 8 or sources.strangers(round(t_s * S)) == ()
    assert taken == sent > 0


@pytest.mark.parametrize("speed", [0.1, 0.5, 3.0])
@pytest.mark.parametrize("boot_hz", [2, 50])
def test_a_simulation_whose_time_runs_slower_or_faster_is_one_vehicle(speed, boot_hz):
    sources = Sources()
    for tick in range(3000):
        t_s = tick / 100
        boot_ms = round((20.0 + t_s * speed) * 1000) if tick % (100 // boot_hz) == 0 else None
        assert sources.take(round(t_s * S), HERE, tick % 256, boot_ms)
    assert sources.strangers(30 * S) == ()


@pytest.mark.parametrize("seed", range(12))
def test_who_was_stopped_in_flight_for_seconds_knows_its_vehicle_again(seed):
    """The first of what came meanwhile lay in the socket, seconds old; the rest was lost; then the present comes."""
    chance, sources, heard = random.Random(seed), Sources(), []
    rate, stopped_s = chance.choice([50, 150, 450]), chance.uniform(1.0, 12.0)
    kept = chance.randrange(60, 300)
    sources.armed, waiting = True, []
    for number in range(20 * rate):
        t_s = number / rate
        boot_ms = round((t_s + 30.0) * 1000) if chance.random() < 0.3 else None
        if 3.0 < t_s < 3.0 + stopped_s:
            if len(waiting) < kept:
                waiting.append((number, boot_ms))
            continue
        for said, said_boot_ms in (*waiting, (number, boot_ms)):
            taken = sources.take(round(t_s * S), HERE, said % 256, said_boot_ms)
            heard += [t_s] if taken else []
        waiting.clear()
    silent_s = max(after - before for before, after in zip(heard, heard[1:]))
    assert heard[-1] > 19.9
    assert silent_s < stopped_s + 0.6
    assert sources.strangers(20 * S) == ()


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("stream", [True, False])
@pytest.mark.slow_rows
def test_a_starved_reader_hears_one_vehicle_however_late(seed, stream):
    """It stands for seconds and reads a few: of a stream late, but all; of datagrams what the socket had room for."""
    chance, sources = random.Random(seed), Sources()
    rate, ends_s, reads_s = chance.choice([50, 150, 450]), chance.uniform(5.0, 20.0), 3.0
    waiting, lost_s, next_one, refused = [], -9.0, 0, []
    for number in range(30 * rate):
        t_s = number / rate
        if stream or len(waiting) < 280:
            waiting.append((t_s, number, round((t_s + 30.0) * 1000) if chance.random() < 0.3 else None))
        slice_of = 0 if 3.0 < t_s < ends_s else 280
        if reads_s < t_s < ends_s:
            slice_of, reads_s = chance.randrange(10, 60), t_s + chance.choice([0.01, 0.5, 2.0, 4.0])
        for came_s, said, boot_ms in waiting[:slice_of]:
            seen_s = t_s if stream else came_s
            lost_s, next_one = lost_s if said == next_one else seen_s, said + 1
            refused += [] if sources.take(round(seen_s * S), HERE, said % 256, boot_ms) else [seen_s - lost_s]
        del waiting[:slice_of]
        assert sources.strangers(round(t_s * S)) == ()
    assert not refused if stream else max(refused, default=0.0) < 0.3


@pytest.mark.parametrize("seed", [32, 61, *range(4)])
def test_of_a_stranger_behind_our_address_nothing_is_believed_once_our_boot_time_is_known(seed):
    chance, sources, spoken = random.Random(seed), Sources(), []
    for who, rates in enumerate([(50, 150, 450), (1, 5, 50, 450)]):
        rate, number, boot_s = chance.choice(rates), chance.randrange(256), -20.0 - 10 * who
        t_s = chance.random() + who * chance.choice([1, 5])
        while t_s < 60:
            t_s, number = t_s + 1 / rate, number + 1
            has_boot = chance.random() < 0.2 and (who == 0 or rate > 1)
            if chance.random() > 0.01:
                spoken.append((t_s, who, number, boot_s if has_boot else None))
    sources.armed, wrong, taken = True, 0, 0
    for t_s, who, number, boot_s in sorted(spoken, key=lambda said: said[:2]):
        heard = say(sources, t_s, sequence=number, boot_s=boot_s)
        wrong, taken = wrong + (heard and who == 1), taken + (heard and who == 0)
    assert wrong <= 20 < taken  # what came before a message of ours said when it was started


def heard_of_two(seed, cut_s, cut_at_s=20.0, ours_ends_s=40.0):
    """Return how often each of two behind one router is heard after a cut of both, in flight, telling its start."""
    chance, said, sources, heard = random.Random(seed), [], Sources(), [0, 0]
    for who, boot_s, begins_s, ends_s in ((0, -600.0, 0.0, ours_ends_s), (1, 8.0, 10.0, 40.0)):
        first, phase_s = chance.randrange(256), chance.random() / 290
        for number in range(int((ends_s - begins_s) * 290)):
            t_s = begins_s + phase_s + number / 290
            if not cut_at_s <= t_s < cut_at_s + cut_s:
                said.append((t_s, who, first + number, boot_s if number % 29 in (2, 3) else None))
    sources.armed = True
    for t_s, who, number, boot_s in sorted(said, key=lambda message: message[:2]):
        believed = say(sources, t_s, sequence=number, boot_s=boot_s)
        heard[who] += believed and boot_s is not None and t_s > cut_at_s
    return heard


@pytest.mark.parametrize("cut_s", [0.3, 0.6, 0.8])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.slow_rows
def test_a_loss_that_ends_the_runs_of_both_in_flight_does_not_make_the_stranger_ours(seed, cut_s):
    ours, strangers = heard_of_two(seed, cut_s)
    assert strangers == 0
    assert ours > 100


@pytest.mark.parametrize("seed", range(4))
def test_a_loss_of_the_stranger_after_ours_fell_silent_in_flight_does_not_make_it_ours(seed):
    assert heard_of_two(seed, 0.4, cut_at_s=25.0, ours_ends_s=20.0) == [0, 0]


# --- the connection -----------------------------------------------------------------------------------------------


class Both:
    """Our vehicle and a stranger, both with system id 1, at a connection."""

    def __init__(self):
        self.port = free_port()
        self.client = Recorder()
        self.link = Connection(f"udpin:127.0.0.1:{self.port}", Identity(1, 191, 1), self.client)
        self.ours, self.other = UdpVehicle(self.port), UdpVehicle(self.port)

    def __enter__(self):
        self.link.start()
        wait_until(lambda: self.link.state.opened)
        return self

    def __exit__(self, *_):
        self.link.close()
        self.ours.close()
        self.other.close()


def test_what_is_sent_goes_to_ours_and_the_stranger_is_told_with_its_address():
    with Both() as both:
        both.ours.say(beat(4, armed=True))
        wait_until(lambda: both.client.heard)
        both.other.say(beat(9), beat(9), beat(9))
        wait_until(lambda: both.link.state.strangers)
        assert both.link.state.strangers == (f"127.0.0.1:{both.other.port}",)
        assert link_problem(both.link.state, time.monotonic_ns()) == (
            f"another vehicle says system id 1, from 127.0.0.1:{both.other.port}; it is ignored: "
            "give it another MAV_SYS_ID or port"
        )
        assert {message.custom_mode for message in both.client.heard} == {4}
        both.other.listen()
        both.other.heard.clear()
        both.link.send(mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 6, 0, 0, 0, 0))
        wait_until(lambda: "COMMAND_LONG" in [message.get_type() for message in both.ours.listen()])
        assert "COMMAND_LONG" not in [message.get_type() for message in both.other.listen()]


def test_our_silence_is_noticed_while_the_stranger_speaks():
    with Both() as both:
        both.ours.say(beat(4, armed=True))
        wait_until(lambda: both.client.heard)
        heard, heartbeat_ns = len(both.client.heard), both.link.state.heartbeat_ns
        end = time.monotonic() + 3.0
        while time.monotonic() < end:
            both.other.say(beat(9))
            time.sleep(0.1)
        assert len(both.client.heard) == heard
        assert both.link.state.heartbeat_ns == heartbeat_ns


# --- the pre-flight table -----------------------------------------------------------------------------------------


def test_a_stranger_refuses_the_takeoff_with_its_address():
    bench = ClientBench()
    strangers = []
    bench.client = type(bench.client)(
        AutopilotSettings(), BatterySpec(cells=4), lambda: (1, 1), strangers=lambda: tuple(strangers)
    )
    bench.advance(5.0)

    def row():
        return next(row for row in bench.ask(bench.client.check, Landed.ON_GROUND) if row.name == "one vehicle")

    assert row().verdict is Verdict.PASS
    strangers.append("10.0.0.2:14550")
    assert (row().verdict, row().heals, row().advice) == (
        Verdict.FAIL,
        True,  # ours, after a burst of lost messages, looks like two for a moment
        "another one with its system id speaks from 10.0.0.2:14550: switch it off, "
        "or give it another MAV_SYS_ID or port",
    )
