"""Sensors as streams: how many samples come when, and what faults do to them."""

import pytest
from simulation_tools import S, scenario

from amaze_autonomy.simulation.faults import Faults
from amaze_autonomy.simulation.streams import Content, SampleKind, Stream, StreamSettings

CAMERA = StreamSettings("camera", "/camera", SampleKind.IMAGE, 20.0)
NONE = Faults(scenario())


def acting(line):
    faults = Faults(scenario(line))
    faults.advance(0)
    return faults


def counted(stream, faults, until_s, step_s=0.1, from_s=0.0):
    """Return the number of samples of each step."""
    steps = round((until_s - from_s) / step_s)
    batches = [stream.take(round((from_s + (number + 1) * step_s) * S), faults) for number in range(steps)]
    return [0 if batch is None else batch.samples for batch in batches]


def test_a_healthy_stream_sends_at_its_rate():
    assert sum(counted(Stream(CAMERA, 0, seed=1), NONE, 100.0)) == pytest.approx(2000, abs=1)


@pytest.mark.parametrize("step_s", [0.01, 0.1, 1.0, 10.0])
def test_the_samples_are_the_same_however_long_the_steps_are(step_s):
    stream = Stream(CAMERA, 0, seed=1)
    batches = [stream.take(round((number + 1) * step_s * S), NONE) for number in range(round(10 / step_s))]
    stamps = [stamp for batch in batches if batch is not None for stamp in stream.stamps(batch)]
    whole = Stream(CAMERA, 0, seed=1)
    assert stamps == whole.stamps(whole.take(10 * S, NONE))


def test_stamps_rise_lie_in_the_past_and_jitter_by_a_tenth_of_the_period():
    stream = Stream(CAMERA, 5 * S, seed=3)
    batch = stream.take(15 * S, NONE)
    stamps = stream.stamps(batch)
    gaps = [later - earlier for earlier, later in zip(stamps, stamps[1:])]
    assert stamps[0] >= 5 * S
    assert stamps[-1] <= 15 * S
    assert batch.last_ns == stamps[-1]
    assert min(gaps) >= 0.9 * 0.05 * S
    assert max(gaps) <= 1.1 * 0.05 * S
    assert len(set(gaps)) > 100


def test_another_seed_gives_other_stamps_and_the_same_seed_the_same():
    one, same, other = (Stream(CAMERA, 0, seed) for seed in (1, 1, 2))
    batches = [stream.take(S, NONE) for stream in (one, same, other)]
    assert batches[0] == batches[1]
    assert batches[0].last_ns != batches[2].last_ns


@pytest.mark.parametrize("kind", ["silent", "killed"])
def test_a_silent_or_killed_one_sends_nothing_and_goes_on_at_its_rate_afterwards(kind):
    stream = Stream(CAMERA, 0, seed=1)
    assert sum(counted(stream, acting(f"component: camera, fault: {kind}"), 10.0)) == 0
    assert sum(counted(stream, NONE, 20.0, from_s=10.0)) == pytest.approx(200, abs=1)


def test_a_slow_one_sends_a_part_of_its_samples():
    faults = acting("component: camera, fault: slow, rate_fraction: 0.4")
    assert sum(counted(Stream(CAMERA, 0, seed=1), faults, 100.0)) == pytest.approx(800, abs=1)


def test_a_slow_one_with_nothing_left_is_silent():
    faults = acting("component: camera, fault: slow, rate_fraction: 0.0")
    assert sum(counted(Stream(CAMERA, 0, seed=1), faults, 10.0)) == 0


def test_a_flapping_one_is_silent_and_sends_again_over_and_over():
    faults = acting("component: camera, fault: flapping, off_s: 1, on_s: 2")
    first = counted(Stream(CAMERA, 0, seed=1), faults, 6.0, step_s=0.5)
    assert first == [0, 0, 10, 10, 10, 10, 0, 0, 10, 10, 10, 10]


def test_the_turns_of_a_flapping_one_are_on_the_schedule():
    faults = acting("component: camera, fault: flapping, off_s: 1, on_s: 2")
    turns = []
    while len(turns) < 4:
        turns.append(faults.next_ns / S)
        faults.advance(faults.next_ns)
    assert turns == [1.0, 3.0, 4.0, 6.0]


@pytest.mark.parametrize(
    "line, content, value",
    [
        ("fault: nan", Content.NAN, 0.0),
        ("fault: stuck", Content.STUCK, 0.0),
        ("fault: reads, value_m: 0.7", Content.READS, 0.7),
    ],
)
def test_what_is_wrong_with_the_content_is_said_with_each_batch(line, content, value):
    batch = Stream(CAMERA, 0, seed=1).take(S, acting("component: camera, " + line))
    assert (batch.content, batch.value, batch.samples) == (content, value, pytest.approx(20, abs=1))


def test_the_fault_of_another_component_does_nothing():
    faults = acting("component: lrf, fault: silent")
    assert Stream(CAMERA, 0, seed=1).take(S, faults) == Stream(CAMERA, 0, seed=1).take(S, NONE)
