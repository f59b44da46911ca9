"""Damage costs the messages that it touches, and is never called nothing: each test makes its own damaged bags."""

from __future__ import annotations

import random
import re
import struct
import tracemalloc
from collections import Counter

import numpy as np
import pytest
from bag_tools import COMPRESSIONS, bag, bomb, contents, digest, ending, flipped, rows, unclosed

from amaze_autonomy.bags.arrays import check_index, index_records
from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import UNREADABLE, connection_of, connection_record, pack_field, record_at
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge import writer
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import count, verify
from amaze_autonomy.bags.recover.recover import recover
from amaze_autonomy.bags.recover.scan import scan
from amaze_autonomy.bags.write import Output

DAMAGES = ("bit", "zeros", "noise", "cut", "inserted")
PAGE = 4096
NEAR = 4  # a message that ends so near to damage is not known to be whole


def recording(path, compression="none", count=500, chunk_bytes=20_000):
    """Write a bag of chunks with about 140 messages each."""
    return bag(path, rows("/a", count, 1), rows("/b", count // 10, 7), compression=compression, chunk_bytes=chunk_bytes)


def checked(folder, compression):
    """Write a bag as rosbag does, with checksums in its lz4, which the rosbags library leaves out."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "CHUNK_BYTES", 20_000)
        return merge(
            [recording(folder / "plain.bag")], folder / "whole.bag", MergeOptions(compression=compression)
        ).path


def places(path):
    """Return (begin, end) in the file of each message of an uncompressed bag, in the order of `contents`."""
    raw, found = path.read_bytes(), []
    with Index(path) as index:
        messages = index.messages()
        for chunk, offset, t_ns in zip(messages.chunk.tolist(), messages.offset.tolist(), messages.t_ns.tolist()):
            begin = index.head(chunk).data + offset
            record = record_at(raw, begin, len(raw))
            found.append((begin, record.end, (t_ns, raw[record.data : record.end])))
    return sorted(found)


def length_byte(messages, chance):
    """Return where, in the length of a message or of its header, a byte stands that is nearly as small when changed."""
    begin, end, (_, data) = chance.choice(messages)
    return chance.choice((begin, end - len(data) - 4)) + chance.randrange(2)


def damaged(raw, kind, at, chance, size=PAGE):
    """Return a file with damage, and where it begins and ends in the good one."""
    if kind in ("bit", "length"):
        changed = bytes([raw[at] ^ 1 << chance.randrange(8)])
        return raw[:at] + changed + raw[at + 1 :], (at, at + 1)
    if kind == "cut":
        return raw[:at] + raw[at + size :], (at, at + size)
    if kind == "inserted":
        return raw[:at] + bytes(chance.randrange(256) for _ in range(size)) + raw[at:], (at, at + 1)
    page = bytes(size) if kind == "zeros" else bytes(chance.randrange(256) for _ in range(size))
    return raw[:at] + page + raw[at + size :], (at, at + size)


def recovered(tmp_path, source, **options):
    before = digest(source)
    done = recover(source, tmp_path / "recovered.bag", replace=True, **options)
    assert digest(source) == before
    assert verify(done.path, [], readers="none").problems in ((), ("its messages are not in order of time",))
    there = contents(done.path)
    assert len(there) == done.scan.messages
    return done, there


@pytest.mark.slow_rows
@pytest.mark.parametrize("kind", [*DAMAGES, "length"])
def test_damage_of_a_plain_bag_costs_the_messages_that_it_touches_and_is_counted(tmp_path, kind):
    source = recording(tmp_path / "whole.bag")
    raw, messages, chance = source.read_bytes(), places(source), random.Random(kind)
    with Index(source) as index:
        first, last = index.chunks[0].position, index.position - PAGE - 1
    broken = tmp_path / "broken.bag"
    for _ in range(25):
        at = length_byte(messages, chance) if kind == "length" else chance.randrange(first, last)
        content, (begin, end) = damaged(raw, kind, at, chance)
        broken.write_bytes(content)
        with ending():
            done, there = recovered(tmp_path, broken)
        untouched = Counter(each for at, until, each in messages if until <= begin - NEAR or end <= at)
        kept = Counter((t_ns, data) for t_ns, _, data in there)
        assert not untouched - kept, (kind, begin)
        assert sum((kept - untouched).values()) <= len(messages) - sum(untouched.values()), (kind, begin)
        assert done.scan.lost in (None, len(messages) - len(there)), (kind, begin, done.scan.damages)
        if len(there) < len(messages):
            assert done.scan.damages, (kind, begin)


@pytest.mark.slow_rows
@pytest.mark.parametrize("compression", ["lz4", "bz2"])
@pytest.mark.parametrize("kind", DAMAGES)
def test_damage_of_a_compressed_bag_costs_the_chunks_that_it_touches_and_is_counted(tmp_path, compression, kind):
    source = checked(tmp_path, compression)
    raw, whole, chance = source.read_bytes(), contents(source), random.Random(kind)
    with Index(source) as index:
        chunks = [(each.position, each.end, each.messages) for each in index.chunks]
        last = index.position - PAGE - 1
    broken = tmp_path / "broken.bag"
    for _ in range(12):
        content, (begin, end) = damaged(raw, kind, chance.randrange(chunks[0][0], last), chance)
        broken.write_bytes(content)
        done, there = recovered(tmp_path, broken)
        touched = sum(count for at, until, count in chunks if at < end and begin < until)
        assert len(whole) - touched <= len(there), (kind, begin, done.scan.damages)
        assert not Counter(there) - Counter(whole), (kind, begin)
        assert done.scan.lost in (None, len(whole) - len(there)), (kind, begin, done.scan.damages)


@pytest.mark.parametrize("kind", ["bit", "zeros", "cut", "length"])
def test_without_the_index_of_the_bag_nothing_else_is_lost_and_no_number_is_made_up(tmp_path, kind):
    source = recording(tmp_path / "whole.bag", count=400)
    messages, chance = places(source), random.Random(kind)
    with Index(source) as index:
        first, end_of_chunks = index.chunks[0].position, index.position
    raw = source.read_bytes()[:end_of_chunks]
    broken = tmp_path / "broken.bag.active"
    for _ in range(15):
        at = length_byte(messages, chance) if kind == "length" else chance.randrange(first, end_of_chunks - PAGE)
        content, (begin, end) = damaged(raw, kind, at, chance)
        broken.write_bytes(content)
        with ending():
            done, there = recovered(tmp_path, broken)
        untouched = Counter(each for at, until, each in messages if until <= begin - NEAR or end <= at)
        assert not untouched - Counter((t_ns, data) for t_ns, _, data in there), (kind, begin)
        assert done.scan.lost in (None, len(messages) - len(there)), (kind, begin, done.scan.damages)


@pytest.mark.slow_rows
@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("kind", [*DAMAGES, "several"])
def test_damage_as_large_as_a_chunk_of_an_open_bag_makes_no_number_up(tmp_path, compression, kind):
    """What stands behind the damage may be the index of another chunk than the one that is kept before it."""
    source = bag(tmp_path / "whole.bag", rows("/a", 60), rows("/b", 40, 13), compression=compression, chunk_bytes=1200)
    raw, chance, broken = source.read_bytes(), random.Random(kind), tmp_path / "broken.bag.active"
    with Index(source) as index:
        first, end_of_chunks = index.chunks[0].position, index.position
    for _ in range(100):
        content = raw[:end_of_chunks]
        for each in ("noise", "zeros", "bit") if kind == "several" else (kind,):
            size = chance.choice((1, 60, 500, 1500))
            content = damaged(content, each, chance.randrange(first, len(content) - size), chance, size)[0]
        broken.write_bytes(content)
        with ending():
            found = scan(broken)
        assert found.lost in (None, 100 - found.messages), found.damages


def index_record(path):
    """Return where the length of the first index record stands."""
    with Index(path) as index:
        head = index.head(0)
    return record_at(path.read_bytes(), head.data + head.stored, path.stat().st_size).data - 4


@pytest.mark.parametrize("wrong", [0, 12, 7, 5000, 1 << 30])
@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("check_data", [True, False])
def test_an_index_record_with_a_wrong_length_costs_nothing(tmp_path, compression, wrong, check_data):
    source = recording(tmp_path / "whole.bag", compression, count=300)
    whole, raw = contents(source), bytearray(source.read_bytes())
    at = index_record(source)
    raw[at : at + 4] = struct.pack("<L", wrong)
    source.write_bytes(raw)
    done, there = recovered(tmp_path, source, check_data=check_data)
    assert (there, done.scan.lost) == (whole, 0)
    assert any("an index record says" in each.what for each in done.scan.damages)


def copied(source, path, between):
    """Write a bag's chunks again, with something between the first and the second."""
    with Index(source) as index, Output(path) as out:
        for number, chunk in enumerate(index.chunks):
            if number == 1:
                between(out, chunk)
            times = (chunk.start_ns, chunk.end_ns)
            out.copy_chunk(index.file, chunk.position, chunk.end, times=times, counts=chunk.counts)
        out.close(index.connections)
    return path


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("check_data", [True, False])
def test_an_empty_chunk_in_a_good_bag_costs_nothing(tmp_path, compression, check_data):
    source = recording(tmp_path / "1.bag", compression, count=300)

    def empty(out, chunk):
        out.chunk("none", 0, [], b"", times=(chunk.start_ns, chunk.start_ns), counts=())

    path = copied(source, tmp_path / "2.bag", empty)
    done, there = recovered(tmp_path, path, check_data=check_data)
    assert there == contents(source)
    assert (done.scan.damages, done.scan.lost, done.scan.closed) == ([], 0, True)


def test_a_chunk_that_the_index_names_and_nobody_finds_is_lost_and_counted(tmp_path):
    source = recording(tmp_path / "1.bag", count=300)
    raw = source.read_bytes()
    with Index(source) as index:
        last = index.chunks[-1]
    said = b"chunk_pos=" + struct.pack("<Q", last.position)
    assert raw.count(said) == 1
    source.write_bytes(raw.replace(said, b"chunk_pos=" + struct.pack("<Q", last.position + 1)))
    done, there = recovered(tmp_path, source)
    assert len(there) == 330
    assert done.scan.damages


def usable(path):
    """Return how many messages a bag has by its index alone; None where that cannot be used."""
    try:
        with Index(path) as index:
            return len(check_index(index).t_ns)
    except BagError:
        return None


def readable(path):
    """Return how many messages a bag has by its index and its data; None where they contradict each other."""
    try:
        return count(path).messages
    except BagError:
        return None


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("check_data", [True, False])
def test_a_bit_of_the_index_is_good_to_all_or_to_nobody_and_what_is_recovered_can_be_used(tmp_path, check_data):
    source = bag(tmp_path / "whole.bag", rows("/a", 20), rows("/b", 10, 23), rows("/c", 6, 31), chunk_bytes=700)
    raw, broken, chance = source.read_bytes(), tmp_path / "broken.bag", random.Random(9)
    with Index(source) as index:
        bits = [(at, bit) for at in range(index.position, index.size) for bit in range(8)]
    drawn = chance.sample(bits, 250)
    assert len(drawn) == 250
    for at, bit in drawn:
        flipped(broken, raw, at, bit)
        found = scan(broken, check_data=check_data)
        good = found.closed and not found.damages
        if good:  # where all data was looked at, what chunks say of connections was, too
            assert (readable if check_data else usable)(broken) == 36, (at, bit)
        else:
            assert readable(broken) is None, (at, bit, found.damages)
        done = recover(broken, tmp_path / "recovered.bag", check_data=check_data, replace=True)
        assert usable(done.path) == done.scan.messages
        assert done.scan.messages == 36 or done.scan.lost != 0, (at, bit)
        assert scan(done.path, check_data=check_data).damages == [], (at, bit)


@pytest.mark.parametrize(
    "bit, said", [(3, ""), (21, "a connection has the number 2097152"), (30, "a connection has the number 1073741824")]
)
def test_a_connection_with_another_number_in_the_index_is_no_good_bag(tmp_path, bit, said):
    """The larger two have a number that no bag may have: what is recovered must not keep it."""
    source = bag(tmp_path / "1.bag", rows("/a", 20), rows("/b", 10))
    raw, whole = source.read_bytes(), contents(source)
    with Index(source) as index:
        at = raw.index(b"conn=", index.position) + 5 + bit // 8
    flipped(source, raw, at, bit % 8)
    done, there = recovered(tmp_path, source)
    assert (there, done.scan.lost) == (whole, 0)
    assert len(done.scan.damages) == 1
    assert said in done.scan.damages[0].what
    with Index(done.path) as index:
        assert max(index.connections) <= 8


@pytest.mark.parametrize("check_data", [True, False])
def test_two_connections_of_one_number_in_the_index_are_not_mixed_up(tmp_path, check_data):
    source = bag(tmp_path / "1.bag", rows("/a", 20), rows("/b", 10), rows("/c", 5))
    raw, whole = source.read_bytes(), contents(source)
    with Index(source) as index:
        places = [each.end() for each in re.finditer(b"conn=", raw) if each.start() > index.position]
    assert len(places) == 3
    for at in places:
        for bit in (0, 1):
            flipped(source, raw, at, bit)
            done, there = recovered(tmp_path, source, check_data=check_data)
            assert (there, done.scan.lost) == (whole, 0), (at, bit)
            assert len(done.scan.damages) == 1


def test_a_connection_with_another_number_in_a_chunk_of_an_open_bag_costs_its_messages_alone(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 20), rows("/b", 10), chunk_bytes=100_000)
    with Index(source) as index:
        raw, first = source.read_bytes()[: index.position], index.head(0).data
    flipped(tmp_path / "2.bag.active", raw, raw.index(b"conn=", first) + 8, 6)
    done, there = recovered(tmp_path, tmp_path / "2.bag.active")
    assert {topic for _, topic, _ in there} == {"/b"}
    assert (len(there), done.scan.lost) == (10, 20)
    assert any(each.what == f"a connection has the number {1 << 30}" for each in done.scan.damages)


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("check_data", [True, False])
def test_several_index_records_of_one_connection_are_made_one(tmp_path, compression, check_data):
    source = bag(tmp_path / "1.bag", rows("/a", 20), rows("/b", 10), compression=compression)
    with Index(source) as index, Output(tmp_path / "2.bag") as out:
        for number, chunk in enumerate(index.chunks):
            head, columns = index.head(number), list(zip(*index.entries(number)))
            half = [row for row in columns if row[1] == 0][:1]
            parts = [half, [row for row in columns if row not in half]] if number == 1 else [columns]
            records = b"".join(index_records(*map(np.array, zip(*part))) for part in parts)
            times = (chunk.start_ns, chunk.end_ns)
            end = head.data + head.stored
            out.copy_chunk(index.file, chunk.position, end, times=times, counts=chunk.counts, index=records)
        out.close(index.connections)
    path = tmp_path / "2.bag"
    with pytest.raises(BagError, match="the index behind it is not what the bag's index says"):
        merge([path], tmp_path / "3.bag")
    done, there = recovered(tmp_path, path, check_data=check_data)
    assert (there, done.scan.lost) == (contents(source), 0)
    assert [each.what for each in done.scan.damages] == ["a chunk has several index records of one connection"]
    assert contents(merge([done.path], tmp_path / "3.bag").path) == contents(source)


def test_what_was_not_looked_at_is_said_not_to_be_checked(tmp_path, capsys):
    source = recording(tmp_path / "1.bag", count=300)
    assert main(["recover", str(source), "-o", str(tmp_path / "2.bag")]) == 0
    assert capsys.readouterr().out.endswith("lost: 0 messages\n")
    assert main(["recover", "--trust-data", str(source), "-o", str(tmp_path / "3.bag")]) == 0
    assert capsys.readouterr().out.endswith("lost: 0 messages; the data of whole chunks was not checked\n")
    assert (tmp_path / "2.bag").read_bytes() == (tmp_path / "3.bag").read_bytes()


def test_a_page_of_zeros_is_found_unless_the_data_is_to_be_trusted(tmp_path):
    source = recording(tmp_path / "1.bag", count=300)
    raw = bytearray(source.read_bytes())
    with Index(source) as index:
        begin = index.head(0).data + 3000
    raw[begin : begin + PAGE] = bytes(PAGE)
    source.write_bytes(raw)
    done, there = recovered(tmp_path, source)
    assert done.scan.lost == 330 - len(there) > 0
    assert verify(done.path, [], readers="read").problems in ((), ("its messages are not in order of time",))
    assert scan(source, check_data=False).checked is False


@pytest.mark.parametrize("says", [60_000_000, 1000])
def test_a_small_bag_that_unpacks_to_much_is_refused_and_takes_little_memory(tmp_path, capsys, says):
    path = bomb(tmp_path / "bomb.bag", 60_000_000, says)
    assert path.stat().st_size < 6000
    wrong = "takes 60 MB of memory, 5 may be taken" if says > 1000 else "it has more than 1000"
    tracemalloc.start()
    for arguments in (
        ["merge", "--compression", "none", "-o", str(tmp_path / "out.bag")],
        ["verify", "--readers", "none"],
    ):
        assert main([*arguments, "--memory", "5", str(path)]) == 1
        assert wrong in capsys.readouterr().err
    assert main(["doctor", "--memory", "5", str(path)]) == 3
    assert wrong in capsys.readouterr().out
    assert main(["recover", "--memory", "5", str(path)]) == 3
    assert "lost: 1 messages" in capsys.readouterr().out
    assert main(["info", "--memory", "5", str(path)]) == 0
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20_000_000


def test_memory_permits_what_is_meant_to_be_large(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 2000, 1), compression="lz4", chunk_bytes=500_000)
    with pytest.raises(BagError, match=r"takes 1 MB of memory, 0 may be taken \(--memory 1 permits it\)"):
        merge([source], tmp_path / "2.bag", MergeOptions(memory=100_000, compression="none"))
    assert len(contents(merge([source], tmp_path / "2.bag", MergeOptions(memory=1_000_000)).path)) == 2000


@pytest.mark.parametrize("first_ms", [0, 5000])
def test_two_connections_of_one_number_in_a_bag_that_was_not_closed_are_told(tmp_path, first_ms):
    """One flipped bit made /b's number that of /a; nothing tells any more whose messages are recorded as that."""
    whole = bag(tmp_path / "whole.bag", rows("/a", 100), rows("/b", 100, first_ms=first_ms))
    path = unclosed(whole, tmp_path / "x.bag.active")
    raw = path.read_bytes()
    record = raw.index(b"topic=/b") - 60
    flipped(path, raw, record + raw[record : record + 120].index(b"conn=\x01") + 5, 0)
    (told,) = (each for each in scan(path).damages if "two connections" in each.what)
    assert told.what == (
        "two connections have the number 0, /a and /b: the first is kept, messages of it from there on may be the "
        "other's"
    )
    assert told.offset > 0
    assert [each for each in scan(whole).damages if "two connections" in each.what] == []


@pytest.mark.parametrize("check_data", [True, False])
def test_two_connections_of_one_number_in_a_closed_bag_are_told(tmp_path, check_data):
    """Each chunk describes its own, and the index has both: no reader can tell whose messages are whose."""
    whole = bag(tmp_path / "whole.bag", rows("/a", 100), rows("/b", 100, first_ms=5000))
    raw, path = whole.read_bytes(), tmp_path / "x.bag"
    assert raw.count(b"conn=\x01\0\0\0") > 100
    path.write_bytes(raw.replace(b"conn=\x01\0\0\0", b"conn=" + bytes(4)))
    found = scan(path, check_data=check_data).damages
    assert [each.what for each in found if "two connections" in each.what] == [
        "two connections have the number 0, /a and /b: the first is kept, messages of it from there on may be the "
        "other's"
    ]


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("check_data", [True, False])
def test_a_closed_bag_that_is_cut_between_two_chunks_lacks_what_its_header_counts(tmp_path, compression, check_data):
    whole = recording(tmp_path / "whole.bag", compression, chunk_bytes=5000)
    raw, path = whole.read_bytes(), tmp_path / "cut.bag"
    with Index(whole) as index:
        chunks, begin = [(each.position, each.end) for each in index.chunks], index.position
    assert len(chunks) > 3
    for cut in (chunks[1][1], chunks[1][1] - 5, chunks[-2][1], chunks[0][0]):  # - 5: in the last index record
        path.write_bytes(raw[:cut])
        found = scan(path, check_data=check_data)
        assert (found.lost, found.lost_inside) == (None, 0), (cut, found.damages)
        assert found.damages[-1].what.startswith(f"the file is cut: its header counts {len(chunks)} chunks, and ")
    for cut in (begin, begin + 30, len(raw) - 1):  # all chunks are there
        path.write_bytes(raw[:cut])
        assert scan(path, check_data=check_data).lost == 0, cut


def test_a_bag_that_is_being_recorded_says_how_many_chunks_it_has_when_it_is_closed_alone(tmp_path):
    whole = recording(tmp_path / "whole.bag")
    raw = re.sub(rb"(chunk_count|index_pos)=.{4}", lambda match: match[1] + b"=" + bytes(4), whole.read_bytes()[:4117])
    with Index(whole) as index:
        (tmp_path / "x.bag.active").write_bytes(raw + whole.read_bytes()[4117 : index.chunks[1].end])
    found = scan(tmp_path / "x.bag.active")
    assert [(each.what, each.lost) for each in found.damages] == [("the bag was not closed", 0)]


def test_a_chunk_with_fewer_bytes_than_it_says_is_not_whole_though_it_ends_with_a_message(tmp_path):
    whole = recording(tmp_path / "whole.bag")
    with Index(whole) as index:
        data, chunks = index.head(len(index.chunks) - 1).data, len(index.chunks)
    ends = [end for _, end, _ in places(whole) if end > data]
    path = tmp_path / "cut.bag"
    path.write_bytes(whole.read_bytes()[: ends[2]])
    found = scan(path)
    assert (found.lost, len(found.chunks)) == (None, chunks)
    assert [each.what for each in found.damages] == ["a chunk is not whole"]


def garbled(path, raw, field, place=0):
    """Write a bag with a byte that is not UTF-8 in one description of a connection."""
    flipped(path, raw, [each.end() for each in re.finditer(field, raw)][place], 7)


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "field", [b"message_definition=", b"message_", b"md5sum=", b"type=", b"callerid=", b"latching="]
)
@pytest.mark.parametrize("check_data", [True, False])
def test_a_description_that_is_not_utf_8_is_told_and_written_so_that_others_can_read_it(tmp_path, field, check_data):
    whole = bag(tmp_path / "whole.bag", rows("/a", 40, caller="/node"))
    path = unclosed(whole, tmp_path / "x.bag.active")
    garbled(path, path.read_bytes(), field)
    done, there = recovered(tmp_path, path, check_data=check_data)
    assert (there, done.scan.lost) == (contents(whole), 0)
    assert f"/a: {UNREADABLE}; `recover` and `merge` write it as text" in [each.what for each in done.scan.damages]
    assert verify(done.path, [], readers="read").problems == ()
    assert scan(done.path, check_data=check_data).damages == []


@pytest.mark.parametrize(
    "topic, recorded, plausible",
    [
        (b"/imu_xsens", b"/xsens", True),  # remapped, or relayed: the publisher knows it by another name
        (b"/imu", b"/xsens", True),
        (b"/im\xe9", b"/imu", False),
    ],
)
def test_a_topic_is_implausible_where_it_is_no_text_and_not_by_its_name(topic, recorded, plausible):
    fields = ((b"topic", recorded), (b"type", b"a/B"), (b"md5sum", b"0" * 32), (b"message_definition", b"int8 x"))
    raw = connection_record(1, topic, b"".join(pack_field(*each) for each in fields))
    record = record_at(raw, 0, len(raw))
    assert connection_of(record, raw[record.data : record.end]).plausible == plausible


@pytest.mark.parametrize("place", [0, 1])
def test_where_one_of_the_chunk_and_the_index_is_readable_it_is_kept(tmp_path, place):
    whole = bag(tmp_path / "whole.bag", rows("/a", 40), chunk_bytes=100_000)
    raw = re.sub(rb"index_pos=.{8}", b"index_pos=" + bytes(8), whole.read_bytes(), count=1, flags=re.DOTALL)
    garbled(tmp_path / "x.bag", raw, b"message_definition=", place)
    done, there = recovered(tmp_path, tmp_path / "x.bag")
    assert (there, done.scan.lost) == (contents(whole), 0)
    with Index(whole) as before, Index(done.path) as index:
        assert index.connections[0].definition == before.connections[0].definition
    assert not any(UNREADABLE in each.what for each in done.scan.damages)
