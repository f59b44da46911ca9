"""Columns say what the rosbags library says, bit for bit; what it would refuse has no row."""

from __future__ import annotations

import math
import os
import random
import struct

import numpy as np
import pytest
from bag_tools import DATA, MS, text
from replay_bags import START_NS, STORE, S, break_chunk, flight_rows, make, rewrite, write_bag
from replay_demo import demo_bag, simulated
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.columns import grouped
from amaze_autonomy.bags.definitions import TEXT, Leaf, Piece, layout_of
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.bags.recording import Indexed, Library
from amaze_autonomy.replay.recordings.fields import getter

LONG_TEXTS = ("amaze_autonomy/JournalEntry", "rosgraph_msgs/Log")  # left to the library


def bits(value):
    """Return a number so that equal is the same bits: NaN, -0.0, True and 1 are all told apart."""
    value = value.item() if hasattr(value, "item") else value
    return (type(value), struct.pack("<d", value)) if isinstance(value, float) else (type(value), value)


def paths_of(recording, topic):
    found = {}
    for link in recording._bag.links:
        layout = layout_of(link.definition, link.kind) if link.topic == topic else None
        if layout is not None:
            found.update({path: leaf for path, leaf in layout.leaves.items() if leaf.dtype != TEXT})
    return sorted(found)


def compared(path):
    """Compare every number of every message of a bag; return how many, and types of topics without columns."""
    values, without = 0, []
    with Recording(path) as recording:
        for topic in recording.topics:
            paths = paths_of(recording, topic.name)[:120]
            entries = recording.entries(topic.name)
            columns = recording.columns({topic.name: paths}).get(topic.name) if paths else None
            if columns is None:
                without.append(topic.kind)
                continue
            getters = [getter(each) for each in paths]
            assert len(columns) == len(entries)
            for entry, row in zip(entries, columns):
                try:
                    message = recording.message(entry)
                except MessageError:
                    assert row is None
                    continue
                if row is None and topic.kind in LONG_TEXTS:
                    continue
                assert row is not None, (topic.name, entry)
                assert [bits(get(message)) for get in getters] == [bits(each) for each in row], (topic.name, entry)
                values += len(row)
    return values, sorted(set(without))


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_they_are_the_librarys_values_in_a_flight(tmp_path, compression):
    path = write_bag(tmp_path / "x.bag", flight_rows(4.0), compression)
    assert compared(path) == (4 * (50 * 40 + 20 * 8 + 10 * 15 + 2 * 14 + 10 + 10), [])


def test_they_are_the_librarys_values_in_a_recording_of_this_package(tmp_path):
    values, without = compared(demo_bag(tmp_path / "x.bag", simulated()))
    assert values > 10_000
    irregular = ["RecordingStatus", "WatchdogAction", "WatchdogInfo"]
    assert without == [f"amaze_autonomy/{each}" for each in irregular]


@pytest.mark.parametrize("path", sorted(DATA.glob("*.bag")) or [None], ids=lambda path: getattr(path, "stem", "none"))
def test_they_are_the_librarys_values_in_real_recordings(path, tmp_path):
    if path is None:
        pytest.skip(f"no recordings in {DATA}: set AMAZE_DATA to their folder")
    part = shortened(path, tmp_path / "part.bag")
    values, _ = compared(part)
    assert (values == 0) == (path.stem == "no_messages")


def shortened(path, output, most=150):
    """Write the first messages of each topic of a recording: comparing one by one is slow."""
    with Recording(path) as source, Writer(output) as writer:
        for topic in source.topics:
            connections = {}
            for entry in source.entries(topic.name)[:most]:
                link = source._links[entry.connection]
                if link.number not in connections:
                    kind = link.kind.replace("/", "/msg/")
                    connections[link.number] = writer.add_connection(
                        link.topic, kind, msgdef=link.definition, md5sum="0" * 32, callerid=link.caller, latching=0
                    )
                raw = source._chunks.message(entry.chunk, entry.offset)
                writer.write(connections[link.number], entry.t_ns, raw)
    return output


STRANGE = """
uint8 LIMIT=3  # a constant
string NAME=a # b
Header header
bool flag
int8 small
uint64 large
float32[3] three
string first
Inner[] many
string second
time at
duration took
Inner last
float64[] tail
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
================================================================================
MSG: odd/Inner
int16 a
float64 b
"""


def strange_bag(path, count=200):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(STRANGE, "odd/msg/Strange"))
    types = store.types
    chance = random.Random(5)
    numbers = [math.nan, math.inf, -0.0, 1e-310, 0.1]

    def inner():
        return types["odd/msg/Inner"](a=chance.randint(-9, 9), b=chance.choice(numbers))

    def words():
        return "".join(chance.choices("abc", k=chance.randint(0, 9)))

    with Writer(path) as writer:
        connection = writer.add_connection("/odd", "odd/msg/Strange", typestore=store)
        for each in range(count):
            message = types["odd/msg/Strange"](
                header=types["std_msgs/msg/Header"](seq=each, stamp=make_time(each), frame_id=words()),
                flag=bool(each % 2),
                small=chance.randint(-128, 127),
                large=2**64 - 1 - each,
                three=np.array([chance.choice(numbers) for _ in "xyz"], np.float32),
                first=words(),
                many=[inner() for _ in range(chance.randint(0, 3))],
                second="ä" if each % 50 == 0 else words(),
                at=make_time(each),
                took=make("builtin_interfaces/msg/Duration", sec=-each, nanosec=3),
                last=inner(),
                tail=np.array([0.5] * chance.randint(0, 4)),
            )
            writer.write(connection, START_NS + each, store.serialize_ros1(message, "odd/msg/Strange"))
    return path


def make_time(sec):
    return make("builtin_interfaces/msg/Time", sec=sec, nanosec=7)


def test_texts_and_arrays_of_any_length_lie_between(tmp_path):
    path = strange_bag(tmp_path / "x.bag")
    paths = ["three[1]", "last.b", "at.nanosec", "took.sec", "large", "flag", "header.stamp.sec", "small"]
    with Recording(path) as recording:
        rows = recording.columns({"/odd": paths})["/odd"]
        assert [place for place, row in enumerate(rows) if row is None] == [0, 50, 100, 150]  # not ASCII
        for entry, row in zip(recording.entries("/odd"), rows):
            message = recording.message(entry)
            if row is not None:
                assert [bits(getter(each)(message)) for each in paths] == [bits(each) for each in row]


def test_a_message_of_a_wrong_size_has_no_row(tmp_path):
    store = STORE
    raw = bytes(store.serialize_ros1(make("std_msgs/msg/Float64", data=1.5), "std_msgs/msg/Float64"))
    with Writer(tmp_path / "x.bag") as writer:
        connection = writer.add_connection("/a", "std_msgs/msg/Float64", typestore=store)
        for each, data in enumerate([raw, raw[:-1], raw + b"\0", b"", raw]):
            writer.write(connection, START_NS + each, data)
    with Recording(tmp_path / "x.bag") as recording:
        assert recording.columns({"/a": ["data"]}) == {"/a": [(1.5,), None, None, None, (1.5,)]}


def test_a_length_that_points_behind_the_message_has_no_row(tmp_path):
    path = strange_bag(tmp_path / "x.bag", 3)
    with Recording(path) as recording:
        entry = recording.entries("/odd")[1]
        raw = recording._chunks.message(entry.chunk, entry.offset)
    damaged = raw[:12] + b"\xff\xff\xff\xff" + raw[16:]
    assert path.read_bytes().count(raw) == 1
    path.write_bytes(path.read_bytes().replace(raw, damaged))
    with Recording(path) as recording:
        rows = recording.columns({"/odd": ["small"]})["/odd"]
        assert rows[1] is None
        assert rows[2] is not None


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_only_messages_of_a_damaged_chunk_have_no_row(tmp_path, compression):
    path = write_bag(tmp_path / "x.bag", flight_rows(36.0), compression)
    broken = break_chunk(path, 1, 200, 60)
    with Recording(path) as recording:
        entries = recording.entries("/imu")
        rows = recording.columns({"/imu": ["linear_acceleration.z"]})["/imu"]
        assert {entry.chunk for entry, row in zip(entries, rows) if row is None} == {broken}
        assert all(row == (9.81,) for row in rows if row is not None)


def test_publishers_of_one_topic_keep_their_places(tmp_path):
    callers = ["/zebra", "/ant"]
    rows = [
        (START_NS + each // 2 * S, "/a", make("std_msgs/msg/Float64", data=float(each)), callers[each % 2])
        for each in range(60)
    ]
    path = rewrite(write_bag(tmp_path / "x.bag", rows, chunk_bytes=300), tmp_path / "y.bag", "lz4")
    with Recording(path) as recording:
        expected = [(recording.message(entry).data,) for entry in recording.entries("/a")]
        assert recording.columns({"/a": ["data"]})["/a"] == expected
        assert expected[:2] == [(1.0,), (0.0,)]


def test_what_has_no_such_column_is_left_out(tmp_path):
    path = write_bag(tmp_path / "x.bag", flight_rows(1.0))
    with Recording(path) as recording:
        assert recording.columns({"/imu": ["no.such"], "/none": ["data"], "/armed": ["data"]}) == {
            "/armed": [(False,)] * 10
        }
        assert recording.columns({}) == {}


def test_the_library_reads_what_our_index_refuses(tmp_path, monkeypatch):
    path = write_bag(tmp_path / "x.bag", flight_rows(3.0), "lz4")
    with Recording(path) as recording:
        assert isinstance(recording._bag, Indexed)
        expected = recording.topics, recording.entries("/imu"), recording.message(recording.entries("/range")[3]).range
    monkeypatch.setattr("amaze_autonomy.bags.recording.opened", Library)
    with Recording(path) as recording:
        assert isinstance(recording._bag, Library)
        entries = [each._replace(connection=0) for each in recording.entries("/imu")]
        assert (recording.topics, entries) == (expected[0], [each._replace(connection=0) for each in expected[1]])
        assert recording.message(recording.entries("/range")[3]).range == expected[2]
        assert recording.columns({"/armed": ["data"]}) == {}


def test_layouts_are_those_of_the_definitions():
    layout = layout_of("uint8 a\nstring b\nfloat64[2] c\nuint16[] d", "x/T")
    assert layout.pieces == (Piece(1, 1, text=True), Piece(16, 2, text=False), Piece(0, 0, text=False))
    assert layout.leaves == {
        "a": Leaf(0, 0, "<u1"),
        "b": Leaf(0, 1, TEXT),
        "c[0]": Leaf(1, 0, "<f8"),
        "c[1]": Leaf(1, 8, "<f8"),
    }


@pytest.mark.parametrize(
    "definition",
    [
        "string[] a",
        "Inner[] a\n===\nMSG: x/Inner\nstring b",
        "Missing a",
        "T a",
        "a b c",
        "uint8[99999] a",
        "Empty[] a",
    ],
)
def test_irregular_types_have_no_layout(definition):
    assert layout_of(definition, "x/T") is None


def test_texts_are_those_of_the_library_where_they_are_asked_for(tmp_path):
    words = ["", "a", "AUTO.LAND", "x" * 256, "x" * 257, "zero\0", "\0", "in\0side", "körper", "\x7f"]
    rows = [(START_NS + each * S, "/a", make("std_msgs/msg/String", data=word)) for each, word in enumerate(words)]
    with Recording(write_bag(tmp_path / "x.bag", rows, "lz4")) as recording:
        found = recording.numbers({"/a": ["data"]}, ["/a"])["/a"].rows()
        assert recording.columns({"/a": ["data"]}) == {}, "unasked a text is no number"
    left = [word for word, row in zip(words, found) if row is None]
    assert left == ["x" * 257, "zero\0", "\0", "körper"], "they are left to the library"
    assert [row for row in found if row is not None] == [(word,) for word in words if word not in left]


def test_small_messages_of_plain_chunks_are_read_without_the_chunk(tmp_path, monkeypatch):
    rows = [
        (START_NS + each, "/a", make("std_msgs/msg/String", data="x" * size)) for each, size in enumerate((9, 9000))
    ]
    with Recording(write_bag(tmp_path / "x.bag", rows)) as recording:
        loaded = []
        inner = recording._chunks._load
        monkeypatch.setattr(recording._chunks, "_load", lambda position: loaded.append(position) or inner(position))
        small, large = recording.entries("/a")
        assert recording.message(small).data == "x" * 9
        assert loaded == []
        assert recording.message(large).data == "x" * 9000
        assert loaded == [large.chunk]


# Chunks that are not compressed: what lies between large messages that nobody wants is all that is read of them.


IMAGE = 200_000


def camera_bag(path, count=60, chunk_bytes=500_000):
    """Write images, numbers between them, and a topic that begins when a chunk with an image is open already."""
    writer = Writer(path)
    writer.chunk_threshold = chunk_bytes
    with writer:
        number = writer.add_connection("/number", "std_msgs/msg/Float64", typestore=STORE)
        image = writer.add_connection("/image", "std_msgs/msg/String", typestore=STORE)
        for each in range(count):
            t_ns = START_NS + each * 10 * MS
            for place in range(3):
                writer.write(number, t_ns + place, struct.pack("<d", each + place / 8))
            writer.write(image, t_ns + 5, raw("x" * IMAGE))
            if each == count // 2:
                late = writer.add_connection("/late", "std_msgs/msg/String", typestore=STORE)
                writer.write(late, t_ns + 6, raw("described behind an image"))
    return path


def raw(words):
    return STORE.serialize_ros1(text(words), "std_msgs/msg/String")


def read_of(path, monkeypatch, wanted, texts=()):
    """Return columns of a bag, and the sizes of the reads of its file that it takes."""
    sizes, inner = [], os.preadv
    with Recording(path) as recording:
        monkeypatch.setattr(os, "preadv", lambda *given: sizes.append(inner(*given)) or sizes[-1])
        found = recording.numbers(wanted, texts)
        monkeypatch.undo()
        return {topic: numbers.rows() for topic, numbers in found.items()}, sizes


def damaged(path, topic, place, at, value):
    """Write bytes into the record of a message, counted from its beginning."""
    with Recording(path) as recording:
        entry = recording.entries(topic)[place]
    with Reader(path) as reader:
        begin = reader.chunks[entry.chunk].datapos + entry.offset + at
    data = bytearray(path.read_bytes())
    data[begin : begin + len(value)] = value
    path.write_bytes(data)
    return entry.chunk


def test_images_between_are_passed_over(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag")
    rows, sizes = read_of(path, monkeypatch, {"/number": ["data"]})
    assert rows == {"/number": [(each + place / 8,) for each in range(60) for place in range(3)]}
    assert sum(sizes) < 0.2 * path.stat().st_size


def test_an_image_that_is_wanted_is_read(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag", 6)
    rows, sizes = read_of(path, monkeypatch, {"/image": [""]})
    assert [row[0].data for row in rows["/image"]] == ["x" * IMAGE] * 6
    assert sum(sizes) > 6 * IMAGE


def test_a_connection_behind_an_image_is_found(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag")
    rows, sizes = read_of(path, monkeypatch, {"/late": ["data"], "/number": ["data"]}, ["/late"])
    assert [size for size in sizes if size > IMAGE], "its chunk is read as a whole"
    assert rows["/late"] == [("described behind an image",)]
    assert len(rows["/number"]) == 180


def test_only_the_chunk_with_a_damaged_image_has_no_rows(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag")
    broken = {
        damaged(path, "/image", 7, 0, b"\xff\xff\x00\x00"),  # of no length that a header has
        damaged(path, "/number", 100, 0, b"\x00\x00\x00\x00"),
    }
    rows, _ = read_of(path, monkeypatch, {"/number": ["data"]})
    with Recording(path) as recording:
        chunks = [entry.chunk for entry in recording.entries("/number")]
    assert {chunk for chunk, row in zip(chunks, rows["/number"]) if row is None} == broken
    assert {chunk for chunk, row in zip(chunks, rows["/number"]) if row is not None} == {*chunks} - broken


def test_a_file_that_became_shorter_has_rows_of_what_is_left(tmp_path):
    path = camera_bag(tmp_path / "x.bag")
    with Recording(path) as recording:
        entries = recording.entries("/number")
        cut = entries[90].chunk
        os.truncate(path, cut)
        rows = recording.columns({"/number": ["data"]})["/number"]
    assert [row is not None for row in rows] == [entry.chunk < cut for entry in entries]


def test_a_plain_chunk_of_two_sizes_is_none(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag", 6)
    with Reader(path) as reader:
        first = sorted(reader.chunks)[0]
    data = bytearray(path.read_bytes())
    at = data.index(b"size=", first) + 5
    data[at : at + 4] = (int.from_bytes(data[at : at + 4], "little") - 1).to_bytes(4, "little")
    path.write_bytes(data)
    rows, _ = read_of(path, monkeypatch, {"/number": ["data"]})
    assert None in rows["/number"]
    assert any(row is not None for row in rows["/number"])


def test_chunks_are_read_some_megabytes_together():
    sizes = np.full(10, 1_500_000).tolist()
    assert list(grouped(list(enumerate(sizes)))) == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9]]
    assert list(grouped([(3, 9 << 20), (4, 1), (7, 1)])) == [[3], [4, 7]]
    assert list(grouped([])) == []
