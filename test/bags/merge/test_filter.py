"""A part of a bag has exactly the messages that are wanted, by the account of other readers, or there is no part."""

from __future__ import annotations

import json
from fnmatch import fnmatchcase

import pytest
from bag_tools import COMPRESSIONS, MS, bag, contents, digest, killed_at, left_over, rows
from hypothesis import given, settings
from hypothesis import strategies as st
from replay_bags import START_NS, STORE
from rosbags.rosbag1 import Writer

from amaze_autonomy.bags import BagError
from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.format import pack_time
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.filter import Part, filter_bag, verify_part
from amaze_autonomy.bags.merge.merge import MergeOptions, Source, merge
from amaze_autonomy.bags.merge.verify import read_with

TOPICS = ("/camera/left", "/camera/right", "/imu", "/odometry")


@pytest.fixture(scope="module", params=COMPRESSIONS)
def source(request, tmp_path_factory):
    streams = [rows(topic, 200, period_ms=10, first_ms=place) for place, topic in enumerate(TOPICS)]
    return packed(tmp_path_factory.mktemp("source"), request.param, *streams)


def packed(folder, compression, *streams):
    """Write a bag whose chunks also rosbag can decompress, which it cannot with those of the rosbags library."""
    path = bag(folder / "plain.bag", *streams)
    return merge([path], folder / "source.bag", MergeOptions(compression=compression)).path


def wanted_of(path, part):
    """Return the messages that a part has, by the rosbags library and three comparisons."""
    whole = contents(path)
    first = whole[0][0] if part.relative else 0
    end = 1 << 62 if part.end_ns is None else first + part.end_ns
    return [
        (t_ns, topic, raw)
        for t_ns, topic, raw in whole
        if first + part.begin_ns <= t_ns < end
        and (not part.topics or any(fnmatchcase(topic, each) for each in part.topics))
        and not any(fnmatchcase(topic, each) for each in part.without)
        and (not part.types or any(fnmatchcase("std_msgs/String", each) for each in part.types))
    ]


PARTS = [
    Part(topics=("/camera/*",)),
    Part(without=("/camera/*", "/odometry")),
    Part(types=("std_msgs/*",)),
    Part(begin_ns=500 * MS),
    Part(begin_ns=500 * MS, end_ns=501 * MS),
    Part(topics=("/imu",), end_ns=1000 * MS),
    Part(begin_ns=START_NS + 700 * MS, end_ns=START_NS + 900 * MS, relative=False),
]


@pytest.mark.slow_rows
@pytest.mark.parametrize("part", PARTS)
def test_a_part_has_what_is_wanted_in_order_of_time(source, tmp_path, part):
    done = filter_bag(source, tmp_path / "part.bag", part)
    expected = wanted_of(source, part)
    assert contents(done.path) == expected
    assert done.messages == len(expected)
    readers = "read" if part is PARTS[3] else "none"  # others are asked once for each compression
    assert verify_part(source, done.path, part, readers=readers).problems == ()


@settings(max_examples=20)
@given(begin=st.integers(0, 1999), length=st.integers(1, 2000), topics=st.sets(st.sampled_from(TOPICS), min_size=1))
def test_any_part_has_what_is_wanted(tmp_path_factory, begin, length, topics):
    folder = tmp_path_factory.mktemp("any")
    path = bag(folder / "x.bag", *(rows(topic, 50, period_ms=40) for topic in TOPICS), compression="lz4")
    part = Part(topics=tuple(sorted(topics)), begin_ns=begin * MS, end_ns=(begin + length) * MS)
    expected = wanted_of(path, part)
    if expected:
        assert contents(filter_bag(path, folder / "y.bag", part).path) == expected
    else:
        with pytest.raises(BagError, match="has no message that is wanted"):
            filter_bag(path, folder / "y.bag", part)


def test_chunks_that_are_wanted_whole_stay_compressed_and_what_has_no_message_is_not_described(tmp_path):
    streams = [rows(topic, 8000, first_ms=place) for place, topic in enumerate(("/a", "/c", "/d", "/e"))]
    path = packed(tmp_path, "lz4", *streams, rows("/b", 1, first_ms=1))
    done = filter_bag(path, tmp_path / "y.bag", Part(begin_ns=5005 * MS, end_ns=75_000 * MS))
    assert done.chunks_copied > 0
    with Index(done.path) as index:
        assert [each.topic for each in index.connections.values()] == ["/a", "/c", "/d", "/e"]
        assert {index.head(number).compression for number in range(len(index.chunks))} == {"none", "lz4"}
    assert all(not each.error for each in read_with(done.path, every_message=True))


@pytest.mark.parametrize("bit", range(32))
def test_a_chunk_whose_end_is_wrong_in_the_index_is_not_passed_over(tmp_path, bit):
    path = bag(tmp_path / "x.bag", rows("/a", 150))
    raw, part = bytearray(path.read_bytes()), Part(begin_ns=620 * MS, end_ns=1120 * MS)
    expected = wanted_of(path, part)
    assert len(expected) == 50
    with Index(path) as index:
        chunk = next(each for each in index.chunks if each.start_ns > START_NS + 620 * MS)
        place = raw.index(b"end_time=" + pack_time(chunk.end_ns), index.position) + 9
    raw[place + bit // 8] ^= 1 << bit % 8
    path.write_bytes(raw)
    try:
        assert contents(filter_bag(path, tmp_path / "y.bag", part).path) == expected
    except BagError as error:
        assert "outside of the time that the bag's index says" in str(error)  # noqa: PT017  (it may as well be none)


def test_what_is_not_wanted_is_not_read(tmp_path, monkeypatch):
    path = bag(tmp_path / "x.bag", rows("/a", 3000))
    loaded, load = [], Source.load
    monkeypatch.setattr(Source, "load", lambda self, chunks, pool: loaded.extend(chunks) or load(self, chunks, pool))
    filter_bag(path, tmp_path / "y.bag", Part(begin_ns=10_000 * MS, end_ns=10_100 * MS))
    with Index(path) as index:
        assert len(index.chunks) > 100
    assert 0 < len(loaded) < 5


def test_the_last_message_of_a_latched_topic_comes_along_where_that_is_asked(tmp_path):
    path = tmp_path / "x.bag"
    with Writer(path) as writer:
        connections = {
            topic: writer.add_connection(topic, "std_msgs/msg/String", typestore=STORE, callerid="/x", latching=latch)
            for topic, latch in (("/map", 1), ("/talk", 0))
        }
        for t_ns, topic, message in sorted([*rows("/map", 3, 100), *rows("/talk", 100)], key=lambda row: row[0]):
            writer.write(connections[topic], t_ns, STORE.serialize_ros1(message, "std_msgs/msg/String"))
    part = Part(begin_ns=500 * MS, end_ns=600 * MS)
    assert {topic for _, topic, _ in contents(filter_bag(path, tmp_path / "y.bag", part).path)} == {"/talk"}
    latched = part._replace(latched=True)
    found = contents(filter_bag(path, tmp_path / "z.bag", latched).path)
    assert [(t_ns - START_NS, topic) for t_ns, topic, _ in found][:2] == [(200 * MS, "/map"), (500 * MS, "/talk")]
    assert len(found) == 11
    assert verify_part(path, tmp_path / "z.bag", latched).problems == ()


def test_a_kill_at_any_moment_leaves_a_whole_part_or_none_and_the_original_as_it_was(tmp_path):
    path = bag(tmp_path / "x.bag", rows("/a", 200), rows("/b", 200))
    before, out, part = digest(path), tmp_path / "part.bag", Part(topics=("/a",))
    call = 0
    while killed_at(lambda: filter_bag(path, out, part, MergeOptions(replace=True)), call + 1):
        call += 1
        assert digest(path) == before
        assert not out.exists() or contents(out) == wanted_of(path, part)
        out.unlink(missing_ok=True)
    assert call >= 3
    filter_bag(path, out, part, MergeOptions(replace=True))
    assert left_over(tmp_path) == []
    assert contents(out) == wanted_of(path, part)


def test_a_changed_byte_is_found(tmp_path):
    path = bag(tmp_path / "x.bag", rows("/a", 50), rows("/b", 50))
    out = filter_bag(path, tmp_path / "y.bag", Part(topics=("/a",))).path
    raw = bytearray(out.read_bytes())
    raw[raw.index(b"/a 7 xxx") + 5] ^= 1
    out.write_bytes(raw)
    problems = verify_part(path, out, Part(topics=("/a",)), readers="none").problems
    assert problems == ("/a (std_msgs/String) has messages with other bytes or times than its inputs",)


# --- the command ------------------------------------------------------------------------------------------------------


def test_the_commands_write_and_verify_and_say_what_is_wrong(tmp_path, capsys):
    path, out = bag(tmp_path / "x.bag", rows("/a", 100), rows("/b", 100)), tmp_path / "y.bag"
    assert main(["filter", str(path), "-o", str(out), "--topics", "/a", "--verify", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["messages"], result["problems"]) == (100, [])
    assert main(["cut", str(path), "-o", str(out), "--from", "0.1", "--to", "0.2", "--verify", "--force"]) == 0
    assert len(contents(out)) == 20
    day = ["--from", "2020-09-13T12:26:40.500Z", "--to", "2020-09-13T12:26:40.600+00:00"]
    assert main(["cut", str(path), "-o", str(out), *day, "--force"]) == 0
    assert contents(out)[0][0] == START_NS + 500 * MS
    capsys.readouterr()
    for arguments, wrong in (
        (["--topics", "/c"], f"{path}: has no topic /c; it has /a, /b"),
        (["--types", "sensor_msgs/*"], f"{path}: has no message that is wanted; want other topics, types or times"),
        (["--from", "9"], f"{path}: has no message that is wanted; want other topics, types or times"),
        (["--from", "0.2", "--to", "0.1"], "--from and --to: 0.2 s is not before 0.1 s; exchange them"),
        (["--from", "0.2", "--to", "2026-01-01"], "are not of one kind; give both in seconds, or both as dates"),
        (["--topics", "/a"], f"{out}: exists"),
    ):
        assert main(["filter", str(path), "-o", str(out), *arguments]) == 1
        assert wrong in capsys.readouterr().err
