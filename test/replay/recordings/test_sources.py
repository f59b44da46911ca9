"""One order of all messages of all bags, that is ours."""

from __future__ import annotations

import pytest
from other_recordings import write_mcap
from replay_bags import START_NS, S, break_chunk, number, write_bag

from amaze_autonomy.replay.errors import NoMessagesError, ReplayError, TimeJumpError, UnknownTopicError
from amaze_autonomy.replay.faults.stream import FaultedRecordings
from amaze_autonomy.replay.recordings.sources import Recordings, TopicFigures, recordings_of, spans_of


def seen(*arguments):
    with Recordings(*arguments) as recordings:
        return [(recordings.topic(sample), int(recordings.message(sample).data)) for sample in recordings.samples]


def test_equal_times_are_ordered_by_the_topics_place_in_the_map_not_by_connections(tmp_path):
    rows = [(START_NS, "/a", number(1)), (START_NS, "/b", number(2)), (START_NS, "/c", number(3))]
    one = write_bag(tmp_path / "one.bag", rows)
    other = write_bag(tmp_path / "other.bag", rows[::-1], order=("/c", "/b", "/a"))
    for path in (one, other):
        assert seen([path], ("/b", "/c", "/a")) == [("/b", 2), ("/c", 3), ("/a", 1)]


def test_equal_times_in_two_bags_do_not_depend_on_the_order_of_the_arguments(tmp_path):
    late = write_bag(tmp_path / "a.bag", [(START_NS + S, "/a", number(1))])
    early = write_bag(tmp_path / "b.bag", [(START_NS, "/a", number(2)), (START_NS + S, "/a", number(3))])
    expected = [("/a", 2), ("/a", 3), ("/a", 1)]
    assert seen([late, early], ("/a",)) == expected
    assert seen([early, late], ("/a",)) == expected


def test_figures_say_rate_and_the_longest_gap(tmp_path):
    times = (0, 1, 2, 5, 6)
    bag = write_bag(tmp_path / "x.bag", [(START_NS + t * S, "/a", number(t)) for t in times])
    with Recordings([bag], ("/a", "/b")) as recordings:
        assert recordings.figures() == (TopicFigures("/a", 5, 4 / 6, 3.0, START_NS + 2 * S), TopicFigures("/b", 0))


def test_a_topic_is_silent_before_its_first_message_and_after_its_last(tmp_path):
    rows = [(START_NS + t * S, "/a", number(t)) for t in (0, 1, 2)]
    rows += [(START_NS + t * S, "/b", number(t)) for t in (4, 5, 7)]
    bag = write_bag(tmp_path / "x.bag", [*rows, (START_NS + 3 * S, "/c", number(0))])
    with Recordings([bag], ("/a", "/b", "/c")) as recordings:
        assert recordings.figures() == (
            TopicFigures("/a", 3, 1.0, 5.0, START_NS + 2 * S),
            TopicFigures("/b", 3, 2 / 3, 4.0, START_NS),
            TopicFigures("/c", 1, None, 4.0, START_NS + 3 * S),
        )


def test_start_and_end_are_those_of_the_recording_not_of_the_map(tmp_path):
    bag = write_bag(tmp_path / "x.bag", [(START_NS, "/other", number(0)), (START_NS + S, "/a", number(1))])
    with Recordings([bag], ("/a",)) as recordings:
        assert (recordings.start_ns, recordings.end_ns, len(recordings.samples)) == (START_NS, START_NS + S, 1)


def test_a_muted_topic_is_read_as_if_it_were_not_there(tmp_path):
    bag = write_bag(tmp_path / "x.bag", [(START_NS, "/a", number(1)), (START_NS, "/b", number(2))])
    arguments = ([bag], ("/a", "/b", "/c"), ("/a",))
    assert seen(*arguments) == [("/b", 2)]
    with Recordings(*arguments) as recordings:
        assert recordings.missing == ("/a", "/c")


def test_a_topic_that_is_muted_and_not_there_is_refused(tmp_path):
    bag = write_bag(tmp_path / "x.bag", [(START_NS, "/a", number(1))])
    with pytest.raises(UnknownTopicError, match=r"^/nope: no bag has this topic; there are /a$"):
        Recordings([bag], ("/a",), ("/nope",))


def test_a_recording_of_other_topics_is_refused_with_what_it_has(tmp_path):
    bag = write_bag(tmp_path / "x.bag", [(START_NS, "/a", number(1))])
    with pytest.raises(NoMessagesError, match=r"^x\.bag: no message of /b; there are /a: is it another map\?$"):
        Recordings([bag], ("/b",))


def test_a_message_that_cannot_be_read_is_noted_once_per_topic(tmp_path):
    bag = write_bag(tmp_path / "x.bag", [(START_NS + t, "/a", number(t)) for t in range(3)], "bz2")
    break_chunk(bag, 0, 30, 10)
    with Recordings([bag], ("/a",)) as recordings:
        assert [recordings.message(sample) for sample in recordings.samples] == [None, None, None]
        damage = recordings.damage["/a"]
    assert (damage.topic, damage.count, damage.first_ns, damage.last_ns) == ("/a", 3, START_NS, START_NS + 2)
    assert damage.reason.startswith("chunk at byte ")


def test_a_recording_has_a_span_before_and_after_each_time_that_a_clock_was_set(tmp_path):
    rows = [(5 * S, "/b", number(1)), (START_NS, "/a", number(2)), (START_NS + S, "/a", number(3))]
    with recordings_of(write_bag(tmp_path / "x.bag", rows))[0] as bag:
        assert spans_of(bag) == [(5 * S, 5 * S), (START_NS, START_NS + S)]
    with recordings_of(write_bag(tmp_path / "y.bag", rows[1:]))[0] as bag:
        assert spans_of(bag) == [(START_NS, START_NS + S)]
    with recordings_of(write_mcap(tmp_path / "z.mcap", rows))[0] as other:
        assert spans_of(other) == [(5 * S, 5 * S), (START_NS, START_NS + S)]


@pytest.mark.parametrize("topics", [("/a",), ("/a", "/b")])
def test_a_recording_in_which_a_clock_was_set_is_refused_with_the_times(tmp_path, topics):
    rows = [(5 * S, "/b", number(1)), (START_NS, "/a", number(2)), (START_NS + S, "/a", number(3))]
    with pytest.raises(TimeJumpError) as caught:
        Recordings([write_bag(tmp_path / "x.bag", rows)], topics)
    assert str(caught.value) == (
        "x.bag: no message for 444,444.4 h between 5.000 s and 1600000000.000 s: a clock was set, or the index is "
        "damaged; cut it there with `amaze-bag cut`"
    )


def stepped(back_s=4.0, silent=(16, 20)):
    """Return rows of two topics for 40 s in the order of the file; at 20 s the recorder's clock is set back."""
    rows = []
    for t_s in range(40):
        at = START_NS + t_s * S - (round(back_s * S) if t_s >= silent[1] else 0)
        rows += [] if silent[0] <= t_s < silent[1] else [(at, "/imu", number(t_s))]
        rows.append((at + 1, "/b", number(t_s)))
    return rows


SET_BACK = (
    "its clock was set back by 3.000 s or more at +19.000 s: what was recorded before and after lies at the same "
    "times, from +16.000 s on, where no silence can be seen"
)


def problems(path, *part):
    with Recordings([path], ("/imu", "/b")) as recordings:
        return FaultedRecordings(recordings, *part).problems if part else recordings.problems


@pytest.mark.parametrize("write", [write_bag, write_mcap])
@pytest.mark.parametrize("size", [100_000, 300])
def test_a_clock_that_was_set_back_hides_a_silence_and_is_said(tmp_path, write, size):
    more = {"chunk_bytes": size} if write is write_bag else {}
    path = write(tmp_path / "x.bag", stepped(), **more)
    with Recordings([path], ("/imu",)) as recordings:
        assert recordings.figures()[0].longest_gap_s == 1.0
        assert recordings.problems == (f"x.bag: {SET_BACK}",)


def test_it_is_said_of_a_part_only_where_it_lies(tmp_path):
    path = write_bag(tmp_path / "x.bag", stepped())
    parts = ((0, 15 * S), (10 * S, 30 * S), (20 * S, None), (0, 17 * S))
    assert [bool(problems(path, *part)) for part in parts] == [False, True, False, True]


def test_it_is_said_of_a_clock_near_0_at_its_place(tmp_path):
    path = write_bag(tmp_path / "x.bag", [(t_ns - START_NS + S, *rest) for t_ns, *rest in stepped()])
    with Recordings([path], ("/imu", "/b"), replayed=True) as recordings:
        assert recordings.problems == (f"x.bag: {SET_BACK}",)
        assert FaultedRecordings(recordings, 0, 15 * S).problems == ()


def test_what_is_a_little_late_or_written_topic_by_topic_is_no_step(tmp_path):
    assert problems(write_bag(tmp_path / "x.bag", stepped(back_s=1.09))) == ()  # of messages a second apart
    by_topic = sorted(stepped(back_s=0.0), key=lambda row: row[1])
    assert problems(write_bag(tmp_path / "y.bag", by_topic)) == ()


TWICE = (
    r"^%s and %s hold the same %smessages, of /a first, or a clock was set back: each would count twice; name one of "
    r"them, or, where they are the same, join them with `amaze-bag merge --duplicates drop`$"
)


def counted(path, first, last, topic="/a"):
    return write_bag(path, [(START_NS + n * S // 7, topic, number(n % 250)) for n in range(first, last)])


def test_messages_that_two_recordings_hold_are_refused(tmp_path):
    whole, copy = counted(tmp_path / "a.bag", 0, 100), tmp_path / "b.bag"
    copy.write_bytes(whole.read_bytes())
    part = counted(tmp_path / "part.bag", 50, 120)
    for other, many in ((copy, 100), (part, 50)):
        with pytest.raises(ReplayError, match=TWICE % ("a.bag", other.name, f"{many} ")):
            Recordings([whole, other], ("/a",))
    mcap = write_mcap(tmp_path / "a.mcap", [(START_NS + n * S // 7, "/a", number(n)) for n in range(100)])
    with pytest.raises(ReplayError, match=TWICE % ("a.bag", "a.mcap", "100 ")):
        Recordings([whole, mcap], ("/a",))


def recorded(path, later_ns=0, caller="/sensor", every=1, say=lambda n: number(n), rate_hz=100):
    """Write what one computer recorded of a topic, each message so much later."""
    rows = [(START_NS + n * round(S / rate_hz) + later_ns, "/a", say(n), caller) for n in range(0, 200, every)]
    return write_bag(path, rows)


@pytest.mark.parametrize("later_ns", [2_300_000, 903_000_000])
def test_messages_of_one_node_that_two_computers_recorded_are_refused(tmp_path, later_ns):
    whole, late = recorded(tmp_path / "a.bag"), recorded(tmp_path / "b.bag", later_ns)
    part = recorded(tmp_path / "part.bag", later_ns, every=3)
    for other in (late, part):
        with pytest.raises(ReplayError, match=TWICE % ("a.bag", other.name, "")):
            Recordings([whole, other], ("/a",))


def test_messages_of_another_node_or_content_are_not_the_same(tmp_path):
    whole, always = recorded(tmp_path / "a.bag"), recorded(tmp_path / "always.bag", say=lambda _: number(7))
    others = (
        (whole, recorded(tmp_path / "other_content.bag", 2_300_000, say=lambda n: number(255 - n))),
        (whole, recorded(tmp_path / "much_later.bag", 20 * S)),
        (always, recorded(tmp_path / "other_node.bag", 2_300_000, "/other", say=lambda _: number(7))),
    )
    for one, other in others:
        assert len(seen([one, other], ("/a",))) == 400


@pytest.mark.parametrize("rate_hz", [100, 10, 0.25])
@pytest.mark.parametrize("say", [lambda _: number(7), lambda n: number(n % 2)], ids=["constant", "repeats"])
def test_content_that_repeats_proves_nothing(tmp_path, say, rate_hz):
    """A recorder began anew with its clock set back: the times of its files overlap, their messages are others."""
    before = recorded(tmp_path / "a.bag", say=say, rate_hz=rate_hz)
    after = recorded(tmp_path / "b.bag", round(100 / rate_hz) * S + 2_000_000, say=say, rate_hz=rate_hz)
    assert len(seen([before, after], ("/a",))) == 400


def test_only_recordings_whose_times_overlap_are_compared(tmp_path, monkeypatch):
    compared = []
    inner = Recordings._hold_the_same
    monkeypatch.setattr(Recordings, "_hold_the_same", lambda *each: compared.append(each) or inner(*each))
    parts = [counted(tmp_path / f"{first}.bag", first, first + 50) for first in range(0, 500, 50)]
    other = counted(tmp_path / "other.bag", 0, 500, "/b")
    assert len(seen([*parts, other], ("/a", "/b"))) == 1000
    assert compared == []
    across = recorded(tmp_path / "across.bag", 8 * S)  # to 10 s: beside the second of the parts alone
    assert len(seen([*parts, across], ("/a",))) == 700
    assert len(compared) == 1


def test_recordings_that_follow_on_one_another_or_share_a_moment_or_another_topic_are_read(tmp_path):
    whole = counted(tmp_path / "a.bag", 0, 100)
    for name, first, topic in (("next.bag", 100, "/a"), ("near.bag", 95, "/a"), ("other.bag", 0, "/b")):
        assert seen([whole, counted(tmp_path / name, first, first + 100, topic)], ("/a", "/b"))
    two = counted(tmp_path / "two.bag", 0, 100)  # of no topic that is read
    assert seen([counted(tmp_path / "x.bag", 0, 100, "/b"), two, counted(tmp_path / "y.bag", 0, 100)], ("/b",))
