"""Merging: every message once, byte for byte, in order of time, whatever the inputs look like."""

from __future__ import annotations

import itertools
import os
import sys
from pathlib import Path

import pytest
from bag_tools import COMPRESSIONS, MS, bag, contents, digest, flipped, left_over, multiset, rows, text
from hypothesis import given
from hypothesis import strategies as st
from replay_bags import START_NS, write_bag, write_empty_bag
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import UNDECODABLE, Connection, fields_of, pack_field
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.manifest import Tally, merge_manifest
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import read_with, verify
from amaze_autonomy.bags.recover.recover import recover
from amaze_autonomy.bags.recover.scan import scan
from amaze_autonomy.bags.write import Output


def merged(tmp_path, inputs, **options):
    """Merge, check all that holds for every merge, return the result."""
    before = [digest(path) for path in inputs]
    result = merge(inputs, tmp_path / "merged.bag", MergeOptions(**options))
    assert [digest(path) for path in inputs] == before
    assert left_over(tmp_path) == []
    times = [t_ns for t_ns, _, _ in contents(result.path)]
    assert times == sorted(times)
    assert len(times) == result.messages
    assert result.size == result.path.stat().st_size
    return result


@pytest.mark.parametrize("kinds", itertools.product(COMPRESSIONS, COMPRESSIONS), ids="-".join)
@pytest.mark.parametrize("output", ["auto", *COMPRESSIONS])
def test_messages_of_both_come_in_order_of_time(tmp_path, kinds, output):
    one = bag(tmp_path / "1.bag", rows("/a", 90), rows("/b", 40, 23), compression=kinds[0])
    two = bag(tmp_path / "2.bag", rows("/c", 60, 14, 3), rows("/a", 50, 17, 4000, tag="2"), compression=kinds[1])
    result = merged(tmp_path, [one, two], compression=output)
    assert multiset(result.path) == multiset(one, two)
    assert verify(result.path, [one, two], readers="none").problems == ()
    if output != "auto":
        with Index(result.path) as index:
            assert {index.head(each).compression for each in range(len(index.chunks))} == {output}


def test_more_than_two_split_disjoint_and_nested_recordings(tmp_path):
    inputs = [
        bag(tmp_path / "1_0.bag", rows("/a", 100)),
        bag(tmp_path / "1_1.bag", rows("/a", 100, first_ms=1000), compression="lz4"),
        bag(tmp_path / "2.bag", rows("/b", 10, 300), compression="bz2"),
        bag(tmp_path / "3.bag", rows("/c", 5, 1, first_ms=500)),
        bag(tmp_path / "4.bag", rows("/d", 1, first_ms=-9000)),
    ]
    result = merged(tmp_path, inputs)
    assert multiset(result.path) == multiset(*inputs)
    with Index(result.path) as index:
        assert [each.topic for each in index.connections.values()] == ["/a", "/b", "/c", "/d"]


def test_one_input_is_put_in_order(tmp_path):
    disorder = [(START_NS + t * MS, "/a", text(str(t))) for t in (5, 900, 1, 700, 4, 2, 800, 3)]
    source = write_bag(tmp_path / "1.bag", disorder, chunk_bytes=60)
    assert multiset(merged(tmp_path, [source]).path) == multiset(source)


def test_the_same_bag_twice_has_everything_twice(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 50))
    result = merged(tmp_path, [source, source])
    assert result.messages == 100
    assert set(multiset(result.path).values()) == {2}
    assert result.warnings == ("/a: 50 messages are in several inputs, kept (--duplicates drop drops them)",)


def test_messages_of_one_time_come_in_the_order_of_inputs_and_then_of_their_file(tmp_path):
    one = write_bag(tmp_path / "1.bag", [(START_NS, "/a", text(f"1 {each}")) for each in range(9)])
    two = write_bag(tmp_path / "2.bag", [(START_NS, "/a", text(f"2 {each}")) for each in range(9)])
    for inputs, order in (([one, two], "12"), ([two, one], "21")):
        result = merge(inputs, tmp_path / "merged.bag", MergeOptions(replace=True))
        found = [raw[4:].decode() for _, _, raw in contents(result.path)]
        assert found == [f"{source} {each}" for source in order for each in range(9)]


def test_a_merge_gives_the_same_bytes_each_time(tmp_path):
    inputs = [bag(tmp_path / "1.bag", rows("/a", 300)), bag(tmp_path / "2.bag", rows("/b", 300, 9))]
    results = [merge(inputs, tmp_path / f"{each}.merged.bag", MergeOptions()).path for each in range(2)]
    assert digest(results[0]) == digest(results[1])


@pytest.mark.parametrize("make_empty", ["no topics", "no messages"])
def test_bags_without_messages(tmp_path, make_empty):
    empty = tmp_path / "empty.bag"
    if make_empty == "no topics":
        write_empty_bag(empty)
    else:
        write_bag(empty, [], callers={})
    full = bag(tmp_path / "1.bag", rows("/a", 5))
    assert multiset(merged(tmp_path, [empty, full, empty]).path) == multiset(full)
    result = merge([empty, empty], tmp_path / "nothing.bag")
    assert (result.messages, contents(result.path)) == (0, [])


def connections(path):
    with Index(path) as index:
        return [(each.topic, each.kind, each.caller, each.latching) for each in index.connections.values()]


def test_a_publisher_in_several_bags_is_one_connection(tmp_path):
    one = bag(tmp_path / "1.bag", rows("/a", 9, caller="/x"), rows("/b", 9, caller="/y"))
    two = bag(tmp_path / "2.bag", rows("/b", 9, caller="/y", tag="2"), rows("/a", 9, caller="/x", tag="2"))
    kind = "std_msgs/String"
    assert connections(merged(tmp_path, [one, two]).path) == [("/a", kind, "/x", False), ("/b", kind, "/y", False)]


def test_publishers_of_one_topic_stay_apart_unless_asked(tmp_path):
    one = bag(tmp_path / "1.bag", rows("/tf", 9, caller="/x"))
    two = bag(tmp_path / "2.bag", rows("/tf", 9, caller="/y", tag="2"))
    kind = "std_msgs/String"
    assert connections(merged(tmp_path, [one, two]).path) == [("/tf", kind, "/x", False), ("/tf", kind, "/y", False)]
    unified = merged(tmp_path, [one, two], publishers_apart=False, replace=True)
    assert connections(unified.path) == [("/tf", kind, "/x", False)]
    assert multiset(unified.path) == multiset(one, two)


def test_latching_and_callers_are_kept(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    raw = store.serialize_ros1(text("map"), "std_msgs/msg/String")
    for name, latching in (("1", 1), ("2", 0)):
        with Writer(tmp_path / f"{name}.bag") as writer:
            connection = writer.add_connection(
                "/map", "std_msgs/msg/String", typestore=store, callerid="/server", latching=latching
            )
            writer.write(connection, START_NS, raw)
    result = merged(tmp_path, [tmp_path / "1.bag", tmp_path / "2.bag"])
    kind = "std_msgs/String"
    assert connections(result.path) == [("/map", kind, "/server", True), ("/map", kind, "/server", False)]


def packet_bag(path, definition):
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, "radio/msg/Packet"))
    fields = {field: 7 for field in store.types["radio/msg/Packet"].__dataclass_fields__ if field != "__msgtype__"}
    with Writer(path) as writer:
        connection = writer.add_connection("/radio", "radio/msg/Packet", typestore=store, callerid="/r", latching=0)
        packet = store.types["radio/msg/Packet"](**fields)
        writer.write(connection, START_NS, store.serialize_ros1(packet, "radio/msg/Packet"))
    return path


def test_different_definitions_of_a_topic_stay_apart_with_a_warning(tmp_path):
    old = packet_bag(tmp_path / "old.bag", "uint8 size")
    new = packet_bag(tmp_path / "new.bag", "uint8 size\nuint8 port")
    result = merged(tmp_path, [old, new])
    with Reader(result.path) as reader:
        digests = [each.digest for each in reader.connections]
        assert [bytes(raw) for _, _, raw in reader.messages()] == [b"\x07", b"\x07\x07"]
    assert result.warnings == (
        "/radio has 2 definitions, which stay apart: "
        + ", ".join(f"radio/Packet ({digest})" for digest in sorted(digests)),
    )


def undefined(source, path):
    """Write a bag again, without the definitions of its types."""
    with Index(source) as index, Output(path) as out:
        for chunk in index.chunks:
            times = (chunk.start_ns, chunk.end_ns)
            out.copy_chunk(index.file, chunk.position, chunk.end, times=times, counts=chunk.counts)
        bare = {
            number: each._replace(header=each.header.replace(definition_field(each), pack_field(DEFINITION, b"")))
            for number, each in index.connections.items()
        }
        out.close(bare)
    return path


DEFINITION = b"message_definition"


def definition_field(connection):
    return pack_field(DEFINITION, fields_of(connection.header, 0, len(connection.header))[DEFINITION])


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("apart", [True, False])
def test_the_definition_of_a_type_is_kept_whichever_input_has_it(tmp_path, place, apart):
    inputs = [
        bag(tmp_path / f"{each}.bag", rows("/a", 20, tag=str(each), caller=f"/{0 if apart else each}"))
        for each in range(2)
    ]
    with Index(inputs[0]) as index:
        expected = index.connections[0].definition
    inputs[place] = undefined(inputs[place], tmp_path / "bare.bag")
    with Index(inputs[place]) as index:
        assert (index.connections[0].definition, expected != b"") == (b"", True)
    path = merged(tmp_path, inputs, publishers_apart=apart).path
    with Index(path) as index:
        assert [each.definition for each in index.connections.values()] == [expected]
    with Recording(path) as found:
        said = sorted(found.message(entry).data for entry in found.entries("/a"))
    assert said == sorted(raw[4:].decode() for _, _, raw in contents(path))


@pytest.mark.slow_rows
@pytest.mark.parametrize("bad", [(0,), (1,), (0, 1)])
def test_a_definition_that_is_not_utf_8_is_made_text_unless_an_input_has_a_readable_one(tmp_path, bad):
    inputs = [bag(tmp_path / f"{each}.bag", rows("/a", 20, tag=str(each), caller="/n")) for each in range(2)]
    with Index(inputs[0]) as index:
        good = index.connections[0].definition
    for each in bad:
        raw = inputs[each].read_bytes()
        inputs[each].write_bytes(raw.replace(b"message_definition=s", b"message_definition=\xb0"))
    result = merged(tmp_path, inputs)
    with Index(result.path) as index:
        definition = index.connections[0].definition
        assert index.connections[0].is_damaged == (len(bad) > 1)
    assert definition.startswith(b"_xb0" + good[1:] + b"\n# damaged") if len(bad) > 1 else definition == good
    assert result.warnings == ((f"/a: {UNDECODABLE}",) if len(bad) > 1 else ())
    assert verify(result.path, inputs, readers="read").problems == ()


@pytest.mark.parametrize("compression", ["lz4", "bz2"])
def test_compressed_chunks_that_overlap_nothing_are_copied_as_they_are(tmp_path, compression):
    inputs = [
        bag(tmp_path / f"{each}.bag", rows("/a", 90, first_ms=each * 2000), compression=compression)
        for each in range(3)
    ]
    result = merged(tmp_path, inputs, compression=compression)
    with Index(inputs[0]) as index:
        expected = 3 * len(index.chunks)
    assert result.chunks_copied == expected
    assert multiset(result.path) == multiset(*inputs)
    assert merged(tmp_path, inputs, compression="none", replace=True).chunks_copied == 0


def test_damage_in_a_chunk_that_is_copied_is_the_inputs_and_refused_where_that_is_checked(tmp_path):
    inputs = [bag(tmp_path / f"{each}.bag", rows("/a", 90, first_ms=each * 2000), compression="bz2") for each in (0, 1)]
    with Index(inputs[1]) as index:
        middle = index.head(1).data + index.head(1).stored // 2
    raw = inputs[1].read_bytes()
    flipped(inputs[1], raw, middle, 4)
    with pytest.raises(BagError, match=r"1\.bag: the chunk at byte \d+ is damaged"):
        merged(tmp_path, inputs, check_copied=True)
    assert left_over(tmp_path) == []
    result = merge(inputs, tmp_path / "merged.bag")
    with pytest.raises(BagError, match=r"1\.bag: the chunk at byte \d+ is damaged"):
        verify(result.path, inputs, readers="none")
    inputs[1].write_bytes(raw)
    assert merged(tmp_path, inputs, check_copied=True, replace=True).chunks_copied > 2


def test_a_clock_that_was_wrong_is_corrected(tmp_path):
    one = bag(tmp_path / "1.bag", rows("/a", 100, 30))
    two = bag(tmp_path / "2.bag", rows("/b", 100, 30, first_ms=3001))
    result = merged(tmp_path, [one, two], offsets_ns=(0, -3_000_000_000))
    expected = contents(one) + [(t_ns - 3_000_000_000, topic, raw) for t_ns, topic, raw in contents(two)]
    assert sorted(contents(result.path)) == sorted(expected)
    assert [topic for _, topic, _ in contents(result.path)] == ["/a", "/b"] * 100
    assert verify(result.path, [one, two], offsets_ns=(0, -3_000_000_000), readers="none").problems == ()
    assert verify(result.path, [one, two], readers="none").problems != ()


def test_a_shift_out_of_the_time_of_bags_is_refused(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 3))
    with pytest.raises(BagError, match=r"1\.bag: shifted by -2000000000\.0 s it leaves the time of bags"):
        merge([source], tmp_path / "m.bag", MergeOptions(offsets_ns=(-2_000_000_000_000_000_000,)))


def test_what_both_computers_recorded_is_dropped_when_asked(tmp_path):
    shared, late = rows("/rosout", 80, caller="/n"), rows("/rosout", 80, first_ms=4, caller="/n")
    one = bag(tmp_path / "1.bag", shared, rows("/a", 30))
    two = bag(tmp_path / "2.bag", late[10:], rows("/b", 30))
    result = merged(tmp_path, [one, two], duplicates="drop")
    ((key, tally),) = result.duplicates.items()
    assert (key[0], tally.messages) == ("/rosout", 70)
    assert result.warnings == ("/rosout: 70 messages are in several inputs, dropped",)
    assert multiset(result.path) == multiset(one) + multiset(bag(tmp_path / "b.bag", rows("/b", 30)))
    assert verify(result.path, [one, two], duplicates=result.duplicates, readers="none").problems == ()
    assert verify(result.path, [one, two], readers="none").problems == (
        "/rosout (std_msgs/String) has 80 messages instead of 150",
    )


def test_a_publisher_that_repeats_itself_keeps_all_its_messages(tmp_path):
    same = [(START_NS + each * MS, "/armed", text("yes"), "/n") for each in range(10)]
    one = write_bag(tmp_path / "1.bag", same)
    two = write_bag(tmp_path / "2.bag", [(t_ns + 1, *rest) for t_ns, *rest in same[:7]])
    result = merged(tmp_path, [one, two], duplicates="drop")
    assert multiset(result.path) == multiset(one)


def test_duplicates_are_counted_unless_ignored_and_only_within_the_window(tmp_path):
    one = bag(tmp_path / "1.bag", rows("/a", 20, caller="/n"))
    two = bag(tmp_path / "2.bag", [(t_ns + 2000 * MS, *rest) for t_ns, *rest in rows("/a", 20, caller="/n")])
    assert merged(tmp_path, [one, two], duplicates="drop").duplicates == {}
    result = merged(tmp_path, [one, two], window_ns=2_000_000_000, replace=True)
    assert [tally.messages for tally in result.duplicates.values()] == [20]
    assert result.messages == 40
    assert merged(tmp_path, [one, two], window_ns=2_000_000_000, duplicates="ignore", replace=True).duplicates == {}


def test_two_publishers_that_say_the_same_are_no_duplicates(tmp_path):
    one = bag(tmp_path / "1.bag", rows("/a", 20, caller="/left"))
    two = bag(tmp_path / "2.bag", rows("/a", 20, caller="/right"))
    assert merged(tmp_path, [one, two], duplicates="drop").messages == 40


def test_dropping_agrees_with_three_inputs(tmp_path):
    inputs = [bag(tmp_path / f"{each}.bag", rows("/a", 40, caller="/n")) for each in range(3)]
    result = merged(tmp_path, inputs, duplicates="drop")
    assert multiset(result.path) == multiset(inputs[0])
    assert sum(tally.messages for tally in result.duplicates.values()) == 80


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_duplicates_are_found_in_compressed_chunks_that_overlap_no_other(tmp_path, compression):
    shared, late = rows("/image", 20, caller="/n"), rows("/image", 20, first_ms=5, caller="/n")
    inputs = [
        bag(tmp_path / f"{place}.bag", each, compression=compression, chunk_bytes=1)
        for place, each in enumerate((shared, late))
    ]
    counted = merged(tmp_path, inputs)
    assert [tally.messages for tally in counted.duplicates.values()] == [20]
    dropped = merged(tmp_path, inputs, duplicates="drop", replace=True)
    assert multiset(dropped.path) == multiset(inputs[0])
    assert [tally.messages for tally in dropped.duplicates.values()] == [20]
    ignored = merged(tmp_path, inputs, duplicates="ignore", replace=True)
    assert (ignored.messages, ignored.chunks_copied) == (40, 0 if compression == "none" else 40)


def repeated(first, last, *, after_ms=0):
    """Return messages of a publisher that says the same each time, with this and that number."""
    return [(START_NS + (each * 100 + after_ms) * MS, "/armed", text("yes"), "/n") for each in range(first, last)]


def test_files_of_one_recorder_are_no_duplicates_of_each_other(tmp_path):
    """What is said at the end of one file is said again at the beginning of the next: both were published."""
    files = [write_bag(tmp_path / "1_0.bag", repeated(0, 20)), write_bag(tmp_path / "1_1.bag", repeated(20, 40))]
    for duplicates in ("drop", "count"):
        result = merged(tmp_path, files, duplicates=duplicates, origins=(0, 0), replace=True)
        assert (multiset(result.path), result.duplicates, result.warnings) == (multiset(*files), {}, ())


def test_what_another_computer_recorded_too_is_dropped_whatever_files_it_lies_in(tmp_path):
    """The second one began in the first file of the first one, and its own next file is in the other's second one."""
    first = [write_bag(tmp_path / "1_0.bag", repeated(0, 20)), write_bag(tmp_path / "1_1.bag", repeated(20, 40))]
    second = [repeated(12, 25, after_ms=2), repeated(25, 33, after_ms=2)]
    files = [*first, *(write_bag(tmp_path / f"2_{place}.bag", rows) for place, rows in enumerate(second))]
    result = merged(tmp_path, files, duplicates="drop", origins=(0, 0, 1, 1))
    assert multiset(result.path) == multiset(*first)
    assert [tally.messages for tally in result.duplicates.values()] == [21]
    assert verify(result.path, files, duplicates=result.duplicates, readers="none").problems == ()


def test_the_manifest_says_where_each_input_was_recorded(tmp_path):
    inputs = [bag(tmp_path / f"{each}.bag", rows("/a", 3)) for each in range(3)]
    for options, origins in ((MergeOptions(), [0, 1, 2]), (MergeOptions(origins=(0, 1, 1)), [0, 1, 1])):
        result = merge(inputs, tmp_path / "merged.bag", options._replace(replace=True))
        assert [each["origin"] for each in merge_manifest(result, inputs, options)["inputs"]] == origins


@given(
    streams=st.lists(
        st.lists(st.tuples(st.integers(0, 400), st.sampled_from("abc")), max_size=40), min_size=1, max_size=4
    ),
    compressions=st.lists(st.sampled_from(COMPRESSIONS), min_size=4, max_size=4),
    output=st.sampled_from(["auto", *COMPRESSIONS]),
)
def test_any_recordings(tmp_path_factory, streams, compressions, output):
    folder = tmp_path_factory.mktemp("any")
    inputs = []
    for place, (stream, compression) in enumerate(zip(streams, compressions)):
        found = [(START_NS + t, f"/{topic}", text(f"{place} {n}" * 9)) for n, (t, topic) in enumerate(stream)]
        inputs.append(write_bag(folder / f"{place}.bag", found, compression, chunk_bytes=300))
    result = merged(folder, inputs, compression=output)
    assert multiset(result.path) == multiset(*inputs)
    assert verify(result.path, inputs, readers="none").problems == ()


def test_an_existing_output_and_an_input_as_output_are_refused(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 3))
    other = bag(tmp_path / "2.bag", rows("/b", 3))
    before = digest(other)
    with pytest.raises(BagError, match=r"2\.bag: exists; choose another name, or say that it may be replaced"):
        merge([source], other)
    with pytest.raises(BagError, match=r"1\.bag: is one of the inputs; choose another name"):
        merge([source], source, MergeOptions(replace=True))
    os.link(source, tmp_path / "link.bag")
    with pytest.raises(BagError, match=r"link\.bag: is one of the inputs"):
        merge([source], tmp_path / "link.bag", MergeOptions(replace=True))
    left = source.rename(tmp_path / ".new.bag.part")
    with pytest.raises(BagError, match=r"\.new\.bag\.part: is one of the inputs"):
        merge([left], tmp_path / "new.bag")
    assert digest(left.rename(source)) == digest(tmp_path / "link.bag")
    assert digest(other) == before
    assert left_over(tmp_path) == []


def test_a_damaged_input_is_refused_with_the_place_and_the_remedy(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 200))
    with Index(source) as index:
        position, data = index.chunks[1].position, index.head(1).data
    raw = bytearray(source.read_bytes())
    raw[data + 4 : data + 8] = b"\xff\xff\xff\xff"
    source.write_bytes(raw)
    with pytest.raises(BagError) as caught:
        merge([source], tmp_path / "m.bag")
    assert str(caught.value).startswith(f"{source}: the chunk at byte {position} is damaged: ")
    assert str(caught.value).endswith("; keep what is good with `amaze-bag recover --check-data`")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1.bag"]


def with_times(source, path, change):
    """Write a bag whose index says other times of its second chunk."""
    with Index(source) as index, Output(path) as out:
        for number, chunk in enumerate(index.chunks):
            times = (chunk.start_ns, chunk.end_ns) if number != 1 else change(chunk.start_ns, chunk.end_ns)
            out.copy_chunk(index.file, chunk.position, chunk.end, times=times, counts=chunk.counts)
        out.close(index.connections)
    return path


OTHER_TIMES = {
    "begins later": (lambda start_ns, end_ns: (start_ns + 1, end_ns), False),
    "begins much later": (lambda start_ns, end_ns: (start_ns + (1024 << 30), end_ns), False),
    "ends before": (lambda start_ns, end_ns: (start_ns, end_ns - 1), False),
    "begins before": (lambda start_ns, end_ns: (start_ns - 1024 * 1000 * MS, end_ns), True),
    "ends later": (lambda start_ns, end_ns: (start_ns, end_ns + 1024 * 1000 * MS), True),
}


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("name", OTHER_TIMES)
def test_times_of_chunks_are_not_believed_alone(tmp_path, compression, name):
    """A chunk would be passed over, or come too late; a longer time than that of its messages does no harm."""
    change, harmless = OTHER_TIMES[name]
    plain = bag(tmp_path / "1.bag", rows("/a", 200), compression=compression)
    source = with_times(plain, tmp_path / "2.bag", change)
    with Index(source) as index:
        position = index.chunks[1].position
    if harmless:
        assert multiset(merged(tmp_path, [source]).path) == multiset(plain)
        assert not scan(source).damages
        return
    wrong = f"the chunk at byte {position} is damaged: it has a message outside of the time that the bag's index says"
    with pytest.raises(BagError, match=wrong):
        merge([source], tmp_path / "m.bag")
    assert not (tmp_path / "m.bag").exists()
    found = recover(source, tmp_path / "3.bag").scan
    assert ([damage.what for damage in found.damages], found.lost) == ([wrong], 0)
    assert multiset(merged(tmp_path, [tmp_path / "3.bag"]).path) == multiset(plain)


def test_a_message_that_the_index_does_not_know_is_not_lost_silently(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 4), rows("/b", 1))
    raw = source.read_bytes()
    with Index(source) as index:
        number = next(each.number for each in index.connections.values() if each.topic == "/b")
        head = index.head(0)
        behind = raw[head.data + head.stored : index.position]
    hidden = behind.replace(b"conn=" + number.to_bytes(4, "little"), b"conn=" + b"\x63\0\0\0")
    assert hidden != behind
    source.write_bytes(raw.replace(behind, hidden))
    with pytest.raises(BagError, match="the index behind it is not what the bag's index says"):
        merge([source], tmp_path / "m.bag")


def test_progress_goes_from_nothing_to_all(tmp_path):
    inputs = [bag(tmp_path / f"{each}.bag", rows(f"/{each}", 3000), compression="lz4") for each in range(2)]
    calls = []
    merge(inputs, tmp_path / "m.bag", progress=lambda done, total: calls.append((done, total)))
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)
    assert calls[-1][0] == calls[-1][1] > 0


def test_tallies_and_connections_have_values():
    assert Tally(3, 5).plus(Tally(1, 2**64 - 1)).minus(Tally(2, 4)) == Tally(2, 0)
    one = Connection(1, "/a", "k", "m", "/x", latching=False, header=b"")
    assert one.identity() != one._replace(caller="/y").identity()
    assert one.identity(publishers_apart=False) == one._replace(caller="/y").identity(publishers_apart=False)


@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_reader_that_is_found_and_cannot_be_imported_is_not_asked(tmp_path, monkeypatch, elsewhere):
    """A ROS shell tells every Python where rosbag is; what it imports, one that stands alone does not have."""
    if elsewhere and not Path("/usr/bin/python3").exists():
        pytest.skip("NOT TESTED: there is no other Python here")
    (tmp_path / "rosbag").mkdir()
    broken = "'ALONE' in os.environ" if elsewhere else "True"
    (tmp_path / "rosbag" / "__init__.py").write_text(
        f"import os\nif {broken}:\n    raise ImportError('no Cryptodome')\n"
    )
    alone = tmp_path / "python"
    alone.write_text(f'#!/bin/sh\nALONE=1 exec {sys.executable} "$@"\n')
    alone.chmod(0o755)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr("sys.executable", str(alone))
    path = bag(tmp_path / "a.bag", rows("/a", 5))
    readings = {each.reader: each.error for each in read_with(path, every_message=False)}
    assert readings["rosbags"] == ""
    assert ("rosbag" in readings, "Cryptodome" in readings.get("rosbag", "")) == (elsewhere, False)


def test_a_bag_whose_clock_was_set_back_is_put_in_order_of_time_and_that_is_said(tmp_path):
    back = rows("/a", 50) + rows("/a", 100, first_ms=-200, tag="later ")
    first = write_bag(tmp_path / "a.bag", back, "none", chunk_bytes=500)
    result = merge([first, bag(tmp_path / "b.bag", rows("/b", 100))], tmp_path / "m.bag")
    (said,) = result.warnings
    assert said.startswith(f"{first}: its clock was set back by 0.690 s or more at +0.690 s: what was recorded before ")
    assert said.endswith("; it is put in order of time")
    assert multiset(result.path) == multiset(first, tmp_path / "b.bag")
    assert merge([result.path], tmp_path / "again.bag").warnings == ()
