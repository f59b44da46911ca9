"""Faults on recorded data: each does what it says, counts what it touched, and is the same every time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf, isinf, isnan, nan
from random import Random
from types import SimpleNamespace

import numpy as np
import pytest

from amaze_autonomy.config import ConfigError
from amaze_autonomy.config.document import parse
from amaze_autonomy.replay.errors import ReplayError
from amaze_autonomy.replay.faults import RECORDED_FAULT, RECORDED_KINDS, TOPIC
from amaze_autonomy.replay.faults.kinds import Acting
from amaze_autonomy.replay.faults.stream import VALUES as EDITS
from amaze_autonomy.replay.faults.stream import FaultedRecordings
from amaze_autonomy.replay.recordings.sources import Sample
from amaze_autonomy.simulation import Subject

S = 1_000_000_000
MS = 1_000_000
TOPICS = ("/imu", "/lrf")


@dataclass
class Stamp:
    sec: int
    nanosec: int


@dataclass
class Message:
    """A message as the library decodes one."""

    z: float
    x: float = 1.0
    values: list = field(default_factory=lambda: [1, 2, 3])
    header: SimpleNamespace = None


class Recorded:
    """Ten messages of /imu in a second, and ten of /lrf 50 ms after each; z counts them."""

    bags, topics, muted, missing, problems, doubts, shift_ns = (), TOPICS, (), (), (), {}, 0

    def __init__(self):
        self.damage = {}
        self.samples = sorted(
            Sample(n * 100 * MS + rank * 50 * MS, rank, 0, 0, 0, n, rank) for n in range(10) for rank in (0, 1)
        )
        self.start_ns, self.end_ns = 0, self.samples[-1].t_ns

    def message(self, sample):
        stamp = Stamp(*divmod(sample.t_ns, S))
        return Message(float(sample.offset), header=SimpleNamespace(stamp=stamp))


def fault(text):
    return RECORDED_FAULT.read(parse(f"{{{text}}}", "x.yaml"), ("faults", "0"), {})


def played(text, begin_ms=200, end_ms=600, seed=1, recorded=None):
    """Return (milliseconds, topic, z) of every message, and how many the fault touched."""
    stream, touched = faulted(text, begin_ms, end_ms, seed, recorded)
    return [(sample.t_ns // MS, stream.topic(sample), stream.message(sample).z) for sample in stream.samples], touched(
        stream
    )


def faulted(text, begin_ms=200, end_ms=600, seed=1, recorded=None):
    stream = FaultedRecordings(recorded or Recorded())
    given = fault(text)
    topics = (given.target,) if given.kind.subject == TOPIC else ()
    stream.apply([Acting(given, begin_ms * MS, None if end_ms is None else end_ms * MS, topics)], seed)
    return stream, lambda each: each.touched[0]


def imu(found):
    return [(t_ms, z) for t_ms, topic, z in found[0] if topic == "/imu"]


NOMINAL = [(n * 100, float(n)) for n in range(10)]


def without(*numbers):
    return [pair for pair in NOMINAL if int(pair[1]) not in numbers]


TIMES = {
    "silent": (without(2, 3, 4, 5), 4),
    "slow, rate_fraction: 0.5": (without(2, 4), 2),
    "flapping, off_s: 0.1, on_s: 0.1": (without(2, 4), 2),
    "dropped, fraction: 1.0": (without(2, 3, 4, 5), 4),
    "delayed, delay_s: 0.05": ([(t + 50 if 200 <= t < 600 else t, z) for t, z in NOMINAL], 4),
    "bursting": ([*NOMINAL[:2], (600, 2.0), (600, 3.0), (600, 4.0), (600, 5.0), *NOMINAL[6:]], 4),
    "duplicated": (sorted([*NOMINAL, *NOMINAL[2:6]]), 4),
}


@pytest.mark.parametrize("text", TIMES)
def test_when_messages_come(text):
    found = played(f"topic: /imu, fault: {text}")
    assert (sorted(imu(found)), found[1]) == (sorted(TIMES[text][0]), TIMES[text][1])
    assert [t for t, _ in imu(found)] == sorted(t for t, _ in imu(found))
    assert len([1 for _, topic, _ in found[0] if topic == "/lrf"]) == 10


def test_messages_change_places_and_none_is_lost():
    found = imu(played("topic: /imu, fault: reordered, within_s: 0.5"))
    assert [t for t, _ in found] == [t for t, _ in NOMINAL]
    assert sorted(z for _, z in found) == [z for _, z in NOMINAL]
    assert [z for _, z in found] != [z for _, z in NOMINAL]


def test_a_delay_keeps_the_order_unless_it_is_free():
    kept = imu(played("topic: /imu, fault: delayed, delay_s: 0.01, jitter_s: 0.6", seed=3))
    free = imu(played("topic: /imu, fault: delayed, delay_s: 0.01, jitter_s: 0.6, order: free", seed=3))
    inside = [z for _, z in kept if 2 <= z < 6]
    assert inside == [2.0, 3.0, 4.0, 5.0]
    assert [z for _, z in free if 2 <= z < 6] != inside


VALUES = {
    "stuck": [2.0, 2.0, 2.0, 2.0],
    "biased, field: z, by: -10": [-8.0, -7.0, -6.0, -5.0],
    "drifting, field: z, by_per_s: 10": [2.0, 4.0, 6.0, 8.0],
    "scaled, field: z, factor: 0.5": [1.0, 1.5, 2.0, 2.5],
    "saturated, field: z, lowest: 3, highest: 4": [3.0, 3.0, 4.0, 4.0],
    "swapped, field: z, with: x": [1.0, 1.0, 1.0, 1.0],
    "infinite, field: z": [inf] * 4,
    "garbage, field: z": [8191.0] * 4,
    "undefined, field: z": [255] * 4,
    "undefined, field: z, value: 7": [7] * 4,
}


@pytest.mark.parametrize("text", VALUES)
def test_what_messages_say(text):
    found = played(f"topic: /imu, fault: {text}")
    assert [z for _, z in imu(found)] == [0.0, 1.0, *VALUES[text], 6.0, 7.0, 8.0, 9.0]
    changed = sum(new != old for new, old in zip(VALUES[text], (2.0, 3.0, 4.0, 5.0)))
    assert found[1] == changed


def test_a_list_becomes_empty_and_a_number_in_it_none_that_is_known():
    empty, _ = faulted("topic: /imu, fault: garbage, field: values")
    assert [empty.message(sample).values for sample in empty.samples[4:6]] == [[], [1, 2, 3]]


def test_what_is_true_or_false_becomes_the_other_one():
    (edit,) = EDITS["garbage"](Acting(fault("topic: /imu, fault: garbage, field: z"), 0, None), (0,), Random(1), list)
    assert [edit(Message(value)).z for value in (True, False)] == [False, True]


@pytest.mark.parametrize("kind, silly", [("float32", 8191), ("int16", 8191), ("uint8", 255), ("int8", 127)])
def test_a_number_of_an_array_is_a_number(kind, silly):
    def edited(text):
        acting = Acting(fault(f"topic: /imu, fault: {text}, field: 'values[0]'"), 0, None)
        (edit,) = EDITS[text.split(",")[0]](acting, (0,), Random(1), list)
        return edit(message)

    message = Message(0.0, values=np.array([3, 4], kind))
    assert edited("saturated, lowest: 0, highest: 9") is message
    assert edited("biased, by: 0") is message
    assert edited("biased, by: 1").values.tolist() == [4, 4]
    assert edited("garbage").values.tolist() == [silly, 4]


def test_only_what_changed_is_counted():
    found = played("topic: /imu, fault: saturated, field: z, lowest: 3, highest: 9")
    assert [z for _, z in imu(found)][2:6] == [3.0, 3.0, 4.0, 5.0]
    assert found[1] == 1
    assert played("topic: /imu, fault: biased, field: z, by: 0")[1] == 0
    assert played("topic: /imu, fault: swapped, field: x, with: x")[1] == 0


class Unknown(Recorded):
    """A sensor that says nothing but NaN: it is never another one."""

    def message(self, sample):
        return replace(super().message(sample), z=nan, x=nan, values=np.array([nan, 1.0]))


@pytest.mark.parametrize(
    "text",
    [
        "nan, field: z",
        "biased, field: z, by: 1",
        "scaled, field: 'values[0]', factor: 2",
        "saturated, field: z, lowest: 0, highest: 1",
        "noisy, field: z, sigma: 1",
        "swapped, field: z, with: x",
        "stuck",
    ],
)
def test_what_was_no_number_and_stays_none_did_not_change(text):
    assert played(f"topic: /imu, fault: {text}", recorded=Unknown())[1] == 0
    assert played("topic: /imu, fault: undefined, field: z", recorded=Unknown())[1] == 4
    assert played("topic: /imu, fault: stuck, stamp: frozen", recorded=Unknown())[1] == 3  # its first is itself


def test_a_list_that_is_empty_does_not_become_so_and_a_time_that_is_right_stays():
    message = Message(0.0, values=[], header=SimpleNamespace(stamp=Stamp(1, 0)))
    for text in ("garbage, field: values", "stamped, to: offset, by_s: 0"):
        acting = Acting(fault(f"topic: /imu, fault: {text}"), 0, None)
        (edit,) = EDITS[text.split(",")[0]](acting, (0,), Random(1), list)
        assert edit(message) is message


def test_a_message_without_header_freezes_with_its_own_clock_running():
    times = (200 * MS, 300 * MS)
    beats = [SimpleNamespace(z=float(n), time_boot_ms=t_ns // MS) for n, t_ns in enumerate(times)]
    for text, clock in (("running", [200, 300]), ("frozen", [200, 200])):
        acting = Acting(fault(f"topic: /imu, fault: stuck, stamp: {text}"), times[0], None, ("/imu",))
        edits = EDITS["stuck"](acting, times, Random(1), lambda: beats[0])
        found = [edit(beat) for edit, beat in zip(edits, beats)]
        assert [(each.z, each.time_boot_ms) for each in found] == [(0.0, each) for each in clock]


def test_what_a_fault_makes_unreadable_is_no_damage_of_the_recording():
    stream, _ = faulted("topic: /imu, fault: undefined, field: z")
    stream.note("/imu", 300 * MS, "z is 255")
    assert stream.damage == {}
    for topic, t_ms in (("/imu", 100), ("/lrf", 250)):
        stream.note(topic, t_ms * MS, "a chunk is damaged")
    assert {topic: each.count for topic, each in stream.damage.items()} == {"/imu": 1, "/lrf": 1}


def test_nan_is_nan_and_infinity_is_not():
    found = played("topic: /imu, fault: nan, field: z")
    assert [isnan(z) for _, z in imu(found)] == [False, False, True, True, True, True, False, False, False, False]
    assert not any(isinf(z) for _, z in imu(found))


def test_noise_is_the_same_for_a_seed_and_another_for_another():
    text = "topic: /imu, fault: noisy, field: z, sigma: 1.0"
    assert played(text, seed=1) == played(text, seed=1)
    assert played(text, seed=1) != played(text, seed=2)


def header(text):
    stream, _ = faulted(f"topic: /imu, fault: {text}")
    stamps = [stream.message(each).header.stamp for each in stream.samples if stream.topic(each) == "/imu"]
    return [stamp.sec * 1000 + stamp.nanosec // MS for stamp in stamps][2:6]


@pytest.mark.parametrize(
    "text, stamps",
    [
        ("stamped, to: zero", [0, 0, 0, 0]),
        ("stamped, to: offset, by_s: 2", [2200, 2300, 2400, 2500]),
        ("stamped, to: backwards", [200, 100, 0, 0]),
        ("stuck, stamp: frozen", [200, 200, 200, 200]),
        ("stuck, stamp: running", [200, 300, 400, 500]),
    ],
)
def test_stamps(text, stamps):
    assert header(text) == stamps


def test_an_item_of_a_list_is_a_field_and_the_recording_stays_as_it_is():
    stream, _ = faulted("topic: /imu, fault: scaled, field: 'values[1]', factor: 10")
    assert stream.message(stream.samples[4]).values == [1, 20, 3]
    assert Recorded().message(Recorded().samples[4]).values == [1, 2, 3]


def test_a_field_that_is_not_there_is_named():
    stream, _ = faulted("topic: /imu, fault: nan, field: q")
    with pytest.raises(ReplayError, match=r"^x.yaml:1: q: Message has no such field; it has z, x, values, header$"):
        stream.message(stream.samples[4])


@pytest.mark.parametrize(
    "text, words",
    [
        ("nan, field: 'values[0]'", r"fault nan: values\[0\] is a whole number, which cannot be nan; use undefined"),
        ("biased, field: values, by: 1", "fault biased: values is no number but list; name a number, or use garbage"),
        ("garbage, field: header", "fault garbage: header is no value but SimpleNamespace; name one of its fields"),
    ],
)
def test_a_value_that_the_field_cannot_have_is_said(text, words):
    stream, _ = faulted(f"topic: /imu, fault: {text}")
    with pytest.raises(ReplayError, match=rf"^x.yaml:1: {words}"):
        stream.message(stream.samples[4])


def test_a_whole_number_stays_one():
    stream, _ = faulted("topic: /imu, fault: scaled, field: 'values[2]', factor: 0.5")
    value = stream.message(stream.samples[4]).values[2]
    assert (value, type(value)) == (2, int)


def test_the_clock_of_the_recorder():
    jumped = played("fault: clock_jumps, by_s: 2.0", end_ms=None)
    assert [t for t, _ in imu(jumped)] == [0, 100, *range(2200, 3000, 100)]
    assert jumped[1] == 16
    warped = played("fault: clock_warps, factor: 2.0")
    assert [t for t, _ in imu(warped)] == [0, 100, 200, 400, 600, 800, 1000, 1100, 1200, 1300]


def test_a_fault_of_what_nobody_reads_touched_nothing():
    stream, touched = faulted("topic: /imu, fault: biased, field: z, by: 1")
    assert touched(stream) == 0


def test_a_part_of_a_recording_begins_and_ends_where_it_is_said():
    part = FaultedRecordings(Recorded(), 200 * MS, 450 * MS)
    assert (part.start_ns, part.end_ns) == (200 * MS, 450 * MS)
    assert [sample.t_ns // MS for sample in part.samples] == [200, 250, 300, 350, 400, 450]


def test_what_recording_and_world_share_has_one_word():
    from amaze_autonomy.simulation import KINDS  # noqa: PLC0415

    shared = {key for key in KINDS if key in RECORDED_KINDS}
    assert {name for subject, name in shared if subject == Subject.COMPONENT} == {"silent", "slow", "flapping"}
    assert {name for subject, name in shared if subject == Subject.SERVICE} == {
        *("refuses", "hangs", "vanishes", "breaks", "lies", "slow")
    }


def test_a_kind_that_is_another_subjects_says_so():
    with pytest.raises(ConfigError, match="must be given with topic"):
        fault("component: imu, fault: biased, field: z, by: 1")
