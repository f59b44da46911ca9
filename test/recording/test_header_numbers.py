"""The numbers in headers, and which are missing."""

import numpy as np
import pytest
from bag_tools import COMPRESSIONS, MS, bag, rows
from replay_bags import START_NS, header, imu, make

from amaze_autonomy.recording import losses
from amaze_autonomy.recording.losses import Numbers, between, header_numbers, numbers_of


def image(t_ns, seq):
    data = np.arange(200_000, dtype=np.uint8)
    fields = {"height": 1, "width": len(data), "encoding": "mono8", "is_bigendian": 0, "step": len(data)}
    return make("sensor_msgs/msg/Image", header=header(t_ns, seq), data=data, **fields)


def numbered(topic, numbers, message, caller=None):
    found = []
    for place, seq in enumerate(numbers):
        t_ns = START_NS + place * 10 * MS
        row = (t_ns, topic, message(t_ns, seq))
        found.append(row if caller is None else (*row, caller))
    return found


def inertial(t_ns, seq):
    message = imu(t_ns)
    message.header.seq = seq
    return message


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_missing_numbers_are_counted_for_each_publisher_whatever_the_compression(tmp_path, compression):
    counted = [each for each in range(5, 105) if each not in (7, 50, 51)]
    streams = [
        numbered("/imu", counted, inertial, "/one"),
        numbered("/imu", range(1, 31), inertial, "/two"),
        [(*row, "/three") for row in rows("/text", 40)],
        numbered("/image", [1, 2, 3, 5, 6], image, "/one"),
    ]
    path = bag(tmp_path / "a.bag", *streams, compression=compression)
    assert header_numbers(path) == {
        ("/image", "/one"): Numbers(1, 6, 1),
        ("/imu", "/one"): Numbers(5, 104, 3),
        ("/imu", "/two"): Numbers(1, 30),
    }


def test_a_publisher_that_does_not_count_tells_nothing():
    assert numbers_of(np.zeros(9)) == Numbers(0, 0, counts=False)
    assert numbers_of(np.arange(0, 100, 10)) == Numbers(0, 90, counts=False)
    assert numbers_of(np.arange(0, 100, 3) + np.arange(34) % 2) == Numbers(0, 100, counts=False), (
        "every third, unevenly"
    )
    assert numbers_of(np.zeros(0)) is None


@pytest.mark.parametrize("kept", [0.9, 0.5, 0.4, 0.2])
@pytest.mark.parametrize("seed", [1, 2])
def test_however_many_are_dropped_by_chance_they_are_counted(kept, seed):
    numbers = np.nonzero(np.random.default_rng(seed).random(10_000) < kept)[0]
    found = numbers_of(numbers)
    assert found.counts
    assert found.missing == numbers[-1] - numbers[0] + 1 - len(numbers)


def test_what_is_dropped_in_bursts_is_counted():
    numbers = np.concatenate([np.arange(n, n + 3) for n in range(0, 1000, 20)])
    assert numbers_of(numbers).missing == 49 * 17


def test_a_publisher_that_was_started_anew_or_counts_over_the_end_lost_nothing():
    again = np.concatenate([np.arange(50, 90), np.arange(1, 40)])
    assert numbers_of(again) == Numbers(50, 39)
    over = np.arange(2**32 - 5, 2**32 + 5) % 2**32
    assert numbers_of(over) == Numbers(2**32 - 5, 4)


def test_between_two_bags_as_well():
    assert between(Numbers(1, 10), Numbers(15, 20)) == 4
    assert between(Numbers(1, 10), Numbers(11, 20)) == between(Numbers(1, 10), Numbers(1, 20)) == 0
    assert between(Numbers(1, 10), Numbers(15, 20, counts=False)) == 0


def test_a_publisher_that_latches_counts_what_it_sends_to_others_too(tmp_path, monkeypatch):
    path = bag(tmp_path / "a.bag", numbered("/imu", [1, 2, 4, 5], inertial, "/one"))
    assert header_numbers(path)["/imu", "/one"].missing == 1
    monkeypatch.setattr(
        losses, "_latched", lambda each: losses_latched(each._replace(header=each.header + b"latching=1"))
    )
    assert header_numbers(path) == {}


losses_latched = losses._latched
