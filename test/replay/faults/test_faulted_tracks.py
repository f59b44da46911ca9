"""What is taken as arrays is what is read one by one, whatever faults have made of the order, in one bag and in two."""

from __future__ import annotations

import pytest
from replay_bags import START_NS, S, number, write_bag

from amaze_autonomy.config.document import parse
from amaze_autonomy.replay.faults import RECORDED_FAULT
from amaze_autonomy.replay.faults.kinds import Acting
from amaze_autonomy.replay.faults.stream import FaultedRecordings
from amaze_autonomy.replay.recordings.sources import Recordings

FAULTS = (
    "silent",
    "slow, rate_fraction: 0.5",
    "dropped, fraction: 0.5",
    "delayed, delay_s: 0.25",
    "delayed, delay_s: 0.1, jitter_s: 0.5, order: free",
    "bursting",
    "duplicated",
    "reordered, within_s: 0.5",
)
TOPICS = ("/a", "/b")


@pytest.fixture(params=[1, 2])
def bags(request, tmp_path):
    """One bag of both topics, or two of ten seconds each."""
    rows = [(START_NS + n * S // 10, topic, number(n)) for n in range(200) for topic in TOPICS]
    size = len(rows) // request.param
    parts = [rows[at : at + size] for at in range(0, len(rows), size)]
    return [write_bag(tmp_path / f"{n}.bag", part) for n, part in enumerate(parts)]


def both_ways(stream):
    stream.read({0: ("data",), 1: ("data",)})
    for rank in (0, 1):
        track = stream.track(rank, ("data",))
        samples = [sample for sample in stream.samples if sample.rank == rank]
        one_by_one = [(sample.t_ns, float(stream.message(sample).data)) for sample in samples]
        yield [(t, float(value)) for t, value in zip(track.times.tolist(), track.columns[0].tolist())], one_by_one


@pytest.mark.parametrize("text", FAULTS)
def test_the_messages_that_a_fault_leaves_are_the_same_as_arrays(bags, text):
    given = RECORDED_FAULT.read(parse(f"{{topic: /a, fault: {text}}}", "x.yaml"), ("faults", "0"), {})
    with Recordings(bags, TOPICS) as recordings:
        stream = FaultedRecordings(recordings)
        stream.apply([Acting(given, START_NS + 5 * S, START_NS + 15 * S, ("/a",))], 1)
        assert stream.touched[0] > 0
        for arrays, one_by_one in both_ways(stream):
            assert arrays == one_by_one


def test_a_part_of_a_recording_is_the_same_as_arrays(bags):
    with Recordings(bags, TOPICS) as recordings:
        for source, count in ((FaultedRecordings(recordings, 3 * S, 12 * S), 91), (recordings, 200)):
            ways = [*both_ways(source)]
            assert ways
            for arrays, one_by_one in ways:
                assert arrays == one_by_one
                assert len(arrays) == count
