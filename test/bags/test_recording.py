"""A bag as a recording: what is in it, in which order, and what is said when it is damaged."""

from __future__ import annotations

import re

import numpy as np
import pytest
from replay_bags import START_NS, S, break_chunk, flight_rows, make, number, rewrite, write_bag, write_empty_bag
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amaze_autonomy.bags import BagError, Recording, Topic
from amaze_autonomy.bags.errors import MessageError


def values(recording, topic):
    return [int(recording.message(entry).data) for entry in recording.entries(topic)]


def test_the_index_says_topics_types_counts_and_times(tmp_path):
    rows = [(START_NS + S, "/a", number(1)), (START_NS + 3 * S, "/a", number(2)), (START_NS + 2 * S, "/b", number(3))]
    with Recording(write_bag(tmp_path / "x.bag", rows)) as recording:
        assert recording.topics == (
            Topic("/a", "std_msgs/UInt8", 2, START_NS + S, START_NS + 3 * S),
            Topic("/b", "std_msgs/UInt8", 1, START_NS + 2 * S, START_NS + 2 * S),
        )
        assert (recording.start_ns, recording.end_ns) == (START_NS + S, START_NS + 3 * S)


def test_messages_come_in_order_of_time_whatever_their_place_in_the_file(tmp_path):
    rows = [(START_NS + t * S, "/a", number(t)) for t in (5, 1, 4, 2, 3)]
    with Recording(write_bag(tmp_path / "x.bag", rows)) as recording:
        assert values(recording, "/a") == [1, 2, 3, 4, 5]


def test_equal_times_of_one_publisher_keep_their_place_in_the_file(tmp_path):
    rows = [(START_NS, "/a", number(value)) for value in (9, 3, 7, 1)]
    with Recording(write_bag(tmp_path / "x.bag", rows)) as recording:
        assert values(recording, "/a") == [9, 3, 7, 1]


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_equal_times_of_two_publishers_are_ordered_by_their_names(tmp_path, compression):
    rows = [(START_NS, "/a", number(1), "/zebra"), (START_NS, "/a", number(2), "/ant")]
    source = write_bag(tmp_path / "x.bag", rows)
    again = rewrite(source, tmp_path / "y.bag", compression)
    for path in (source, again):
        with Recording(path) as recording:
            assert values(recording, "/a") == [2, 1]


def test_a_type_is_read_by_the_definition_in_the_bag_even_when_a_field_is_called_header(tmp_path):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("uint8 size\nuint8 header\nuint8[3] data", "radio/msg/Packet"))
    packet = store.types["radio/msg/Packet"](size=3, header=80, data=np.array([1, 2, 3], "uint8"))
    with Writer(tmp_path / "x.bag") as writer:
        connection = writer.add_connection("/packets", "radio/msg/Packet", typestore=store)
        writer.write(connection, START_NS, store.serialize_ros1(packet, "radio/msg/Packet"))
    with Recording(tmp_path / "x.bag") as recording:
        message = recording.message(recording.entries("/packets")[0])
        assert (message.size, message.header, list(message.data)) == (3, 80, [1, 2, 3])


def test_a_bag_without_messages_has_no_times(tmp_path):
    with Recording(write_empty_bag(tmp_path / "x.bag")) as recording:
        assert (recording.topics, recording.start_ns, recording.end_ns) == ((), None, None)


@pytest.mark.parametrize(
    "content,wrong",
    [
        (b"", "is empty; name a ROS 1 bag of version 2.0"),
        (b"\x7fELF and so on\n", "is no bag; name a ROS 1 bag of version 2.0"),
        (b"#ROSBAG V1.2\n", "its version is not 2.0 (#ROSBAG V1.2); older ones are converted with `rosbag fix`"),
        (b"#ROSBAG V2.0\r\n" + bytes(50), "its line endings were converted (git does that unless .gitattributes says"),
        (b"#ROSBAG V2.0\n", "the file ends within a record"),
        (b"\xff\xfe\xfd\n", ""),
    ],
)
def test_what_is_no_bag_is_one_clear_error(tmp_path, content, wrong):
    path = tmp_path / "x.bag"
    path.write_bytes(content)
    with pytest.raises(BagError) as caught:
        Recording(path)
    assert wrong in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_one_clear_error(tmp_path):
    with pytest.raises(BagError, match=r"x\.bag: is no file; name a bag$"):
        Recording(tmp_path / "x.bag")
    with pytest.raises(BagError, match="is no file"):
        Recording(tmp_path)


def test_a_recording_that_was_not_closed_is_one_clear_error(tmp_path):
    path = write_bag(tmp_path / "x.bag", flight_rows(4.0))
    data = path.read_bytes()
    path.write_bytes(re.sub(rb"index_pos=.{8}", b"index_pos=" + bytes(8), data, count=1, flags=re.DOTALL))
    with pytest.raises(BagError) as caught:
        Recording(path)
    words = "was not closed, so it has no index; make a whole one with"
    assert str(caught.value) == f"{path}: {words} `amaze-bag recover {path}`"
    two_words = path.rename(tmp_path / "x y.bag")
    with pytest.raises(BagError) as caught:
        Recording(two_words)
    assert str(caught.value).endswith(f" `amaze-bag recover '{two_words}'`")


@pytest.mark.parametrize("kept", [0.2, 0.5, 0.9, 0.99])
def test_a_file_that_was_cut_off_is_one_clear_error(tmp_path, kept):
    path = write_bag(tmp_path / "x.bag", flight_rows(4.0))
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    with pytest.raises(BagError) as caught:
        Recording(path)
    assert str(caught.value).startswith(f"{path}: the index is damaged (")
    assert str(caught.value).endswith(f"); make a whole one with `amaze-bag recover {path}`")
    assert "('" not in str(caught.value)


def test_a_damaged_index_never_gives_anything_but_a_bag_error(tmp_path):
    path = write_bag(tmp_path / "x.bag", flight_rows(2.0))
    data = bytearray(path.read_bytes())
    index = data.rfind(b"op=\x06")
    assert index > 0
    outcomes = []
    for offset in range(index - 120, index + 40, 3):
        broken = bytearray(data)
        broken[offset] ^= 0xA5
        path.write_bytes(broken)
        outcomes.append(outcome_of_reading(path))
    assert "refused" in outcomes
    assert set(outcomes) <= {"refused", "read", "read in part"}


def outcome_of_reading(path):
    """Read all of a bag; any error but ours is the test's."""
    try:
        with Recording(path) as recording:
            entries = [entry for topic in recording.topics for entry in recording.entries(topic.name)]
            good = [is_good(recording, entry) for entry in entries]
    except BagError:
        return "refused"
    return "read" if all(good) else "read in part"


def is_good(recording, entry):
    try:
        recording.message(entry)
    except MessageError:
        return False
    return True


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_a_damaged_chunk_loses_its_own_messages_only(tmp_path, compression):
    path = write_bag(tmp_path / "x.bag", flight_rows(36.0), compression)
    broken = break_chunk(path, 0, 200, 60)
    with Recording(path) as recording:
        entries = recording.entries("/imu")
        assert {entry.chunk for entry in entries if not is_good(recording, entry)} == {broken}
        assert len({entry.chunk for entry in entries}) > 1
        with pytest.raises(MessageError, match=rf"^chunk at byte {broken} is damaged: "):
            recording.message(next(entry for entry in entries if entry.chunk == broken))


def test_a_text_that_is_not_utf_8_is_an_error_of_this_message_alone(tmp_path):
    rows = [
        (START_NS + i, "/a", make("std_msgs/msg/String", data=text))
        for i, text in enumerate(["good", "damaged", "good"])
    ]
    path = write_bag(tmp_path / "x.bag", rows)
    path.write_bytes(path.read_bytes().replace(b"damaged", b"dam\xff\xfeed"))
    with Recording(path) as recording:
        first, second, third = recording.entries("/a")
        assert (recording.message(first).data, recording.message(third).data) == ("good", "good")
        with pytest.raises(MessageError, match=r"std_msgs/String cannot be decoded: .*'utf-8' codec can't decode"):
            recording.message(second)
