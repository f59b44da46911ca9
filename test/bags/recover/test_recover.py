"""Recovering: what was whole on the disk is kept, the rest is named, the original is never touched."""

from __future__ import annotations

import random
import re

import pytest
from bag_tools import COMPRESSIONS, bag, chunk_ends, contents, digest, left_over, message_ends, multiset, rows, unclosed
from replay_bags import write_empty_bag

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.merge import merge
from amaze_autonomy.bags.merge.verify import verify
from amaze_autonomy.bags.recover.recover import recover, recovered_name
from amaze_autonomy.bags.recover.scan import Damage, scan


def recording(path, compression="none"):
    return bag(path, rows("/a", 60), rows("/b", 25, 23), compression=compression, chunk_bytes=1700)


def recovered(tmp_path, source, **options):
    """Recover, check all that holds for every recovery, return the result."""
    before = digest(source)
    done = recover(source, tmp_path / "recovered.bag", replace=True, **options)
    assert digest(source) == before
    assert left_over(tmp_path) == []
    assert len(contents(done.path)) == done.scan.messages
    assert verify(done.path, [], readers="none").problems in ((), ("its messages are not in order of time",))
    return done


def places(path):
    """Return the bytes at which a file is cut: all near a border of something, and some of the rest."""
    with Index(path) as index:
        borders = {13, 4109, index.position, index.size}
        for number, chunk in enumerate(index.chunks):
            head = index.head(number)
            borders |= {chunk.position, head.data, head.data + head.stored, chunk.end}
        near = {border + step for border in borders for step in (*range(-60, 60, 9), -2, -1, 0, 1, 2, 3)}
        return sorted(cut for cut in near | set(range(4109, index.size, 397)) if 4117 < cut < index.size)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_cut_at_any_byte_every_whole_chunk_and_message_is_kept(tmp_path, compression):
    source = recording(tmp_path / "whole.bag", compression)
    raw, whole = source.read_bytes(), chunk_ends(source)
    ends = message_ends(source) if compression == "none" else []
    cut_file = tmp_path / "cut.bag"
    cuts = places(source)
    assert len(cuts) > 100
    for cut in cuts:
        cut_file.write_bytes(raw[:cut])
        found = scan(cut_file, check_data=False)
        in_chunks = sum(messages for end, messages in whole if end <= cut)
        if compression == "none":
            assert found.messages == sum(end <= cut for end in ends), cut
        else:
            assert in_chunks <= found.messages, cut
            assert found.messages <= sum(messages for _, messages in whole), cut
        assert not found.closed
        assert found.damages, cut


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_what_is_kept_of_a_cut_file_is_its_beginning_byte_for_byte(tmp_path, compression):
    source = recording(tmp_path / "whole.bag", compression)
    everything, raw = contents(source), source.read_bytes()
    cut_file, kept = tmp_path / "cut.bag", set()
    for cut in random.Random(5).sample(places(source), 25):
        cut_file.write_bytes(raw[:cut])
        done = recovered(tmp_path, cut_file)
        assert contents(done.path) == everything[: done.scan.messages]
        kept.add(done.scan.messages)
    assert len(kept) > 5


def test_a_recorder_that_was_killed_loses_the_message_it_was_writing(tmp_path):
    source = recording(tmp_path / "whole.bag")
    for cut, lost in ((None, 0), (1, 1), (60, 1), (400, 4)):
        active = unclosed(source, tmp_path / "x.bag.active", cut)
        done = recovered(tmp_path, active)
        ends = message_ends(source)
        there = sum(end <= active.stat().st_size for end in ends)
        assert len(contents(done.path)) == there
        assert there >= len(ends) - lost - 2
        assert done.complete is (cut is None)
    assert contents(recovered(tmp_path, unclosed(source, tmp_path / "x.bag.active")).path) == contents(source)


def test_a_chunk_that_has_just_begun_and_one_without_anything(tmp_path):
    source = recording(tmp_path / "whole.bag")
    raw = unclosed(source, tmp_path / "x.bag.active").read_bytes()
    with Index(source) as index:
        head = index.head(len(index.chunks) - 1)
    (tmp_path / "x.bag.active").write_bytes(raw[: head.data])
    done = recovered(tmp_path, tmp_path / "x.bag.active")
    assert done.scan.messages == sum(count for _, count in chunk_ends(source)[:-1])
    assert done.complete


def test_a_file_that_grew_before_a_power_loss_without_being_written(tmp_path):
    source = recording(tmp_path / "whole.bag")
    active = unclosed(source, tmp_path / "x.bag.active", 100)
    there = recovered(tmp_path, active).scan.messages
    active.write_bytes(active.read_bytes() + bytes(100_000))
    assert there - 1 <= recovered(tmp_path, active).scan.messages <= there


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_good_bag_is_recovered_to_an_equal_one(tmp_path, compression):
    source = recording(tmp_path / "whole.bag", compression)
    for check_data in (False, True):
        done = recovered(tmp_path, source, check_data=check_data)
        assert (done.complete, done.scan.damages, done.scan.closed) == (True, [], True)
        assert contents(done.path) == contents(source)


def test_chunks_where_the_recorder_puts_them_keep_their_places(tmp_path):
    source = merge([recording(tmp_path / "whole.bag")], tmp_path / "as_recorded.bag").path
    active = unclosed(source, tmp_path / "x.bag.active", 40)
    done = recovered(tmp_path, active)
    assert contents(done.path) == contents(source)[: done.scan.messages]
    long = bag(tmp_path / "long.bag", rows("/a", 30_000, 1))
    source = merge([long], tmp_path / "long_recorded.bag").path
    with Index(source) as index:
        assert len(index.chunks) > 2
    done = recovered(tmp_path, unclosed(source, tmp_path / "x.bag.active", 40))
    assert contents(done.path) == contents(source)[: done.scan.messages]
    with Index(source) as before, Index(done.path) as after:
        assert [each.position for each in after.chunks] == [each.position for each in before.chunks]


def test_an_empty_recording_is_recovered_to_an_empty_bag(tmp_path):
    done = recovered(tmp_path, write_empty_bag(tmp_path / "x.bag"))
    assert (done.complete, done.scan.messages, contents(done.path)) == (True, 0, [])


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_damaged_chunk_loses_its_messages_and_says_how_many(tmp_path, compression):
    source = recording(tmp_path / "whole.bag", compression)
    with Index(source) as index:
        head, chunk = index.head(1), index.chunks[1]
    raw = bytearray(source.read_bytes())
    raw[head.data + 40 : head.data + 80] = b"\xa5" * 40
    source.write_bytes(raw)
    done = recovered(tmp_path, source, check_data=True)
    (damage,) = done.scan.damages
    assert (damage.offset, damage.size) == (chunk.position, head.data + head.stored - chunk.position)
    assert 0 < damage.lost <= chunk.messages
    assert damage.lost == done.scan.lost == 85 - len(contents(done.path))
    if compression == "none":
        assert damage.lost <= 2


def test_a_damaged_chunk_without_its_index_is_named_from_its_first_byte_to_its_last(tmp_path):
    source = recording(tmp_path / "whole.bag")
    with Index(source) as index:
        head, chunk = index.head(1), index.chunks[1]
    raw = bytearray(source.read_bytes())[: head.data + head.stored]
    middle = head.data + head.stored // 2
    raw[middle : middle + 40] = b"\xa5" * 40
    source.write_bytes(raw)
    found = scan(source, check_data=True)
    size = head.data + head.stored - chunk.position
    damaged, cut = found.damages
    assert damaged == Damage(chunk.position, size, "a chunk is damaged, and the index behind it", None)
    assert cut.what == "the file is cut: its header counts 5 chunks, and 2 were found"
    assert found.lost is None


def test_the_quick_look_does_not_read_the_data(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 3000), chunk_bytes=100_000)
    found = scan(source, check_data=False)
    assert found.messages == 3000
    assert found.bytes_read < source.stat().st_size / 1.5


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_destroyed_header_of_a_chunk_loses_nothing(tmp_path, compression):
    source = recording(tmp_path / "whole.bag", compression)
    everything, behind = contents(source), chunk_ends(source)[2][0]
    with Index(source) as index:
        chunk = index.chunks[2]
    raw = bytearray(source.read_bytes())
    raw[chunk.position : chunk.position + 20] = bytes(20)
    source.write_bytes(raw)
    done = recovered(tmp_path, source)
    assert contents(done.path) == everything
    assert done.scan.damages == [Damage(chunk.position, behind - chunk.position, "a header of 0 bytes is none", 0)]


def test_a_destroyed_index_loses_nothing(tmp_path):
    source = recording(tmp_path / "whole.bag")
    with Index(source) as index:
        position = index.position
    raw = source.read_bytes()
    source.write_bytes(raw[:position] + b"\xee" * (len(raw) - position))
    done = recovered(tmp_path, source)
    assert (done.scan.messages, done.complete) == (85, True)
    assert [str(each) for each in done.scan.damages] == [f"byte {position} to {len(raw)}: the index is damaged or cut"]


def test_a_destroyed_beginning_loses_nothing_but_is_said(tmp_path):
    source = recording(tmp_path / "whole.bag")
    everything = contents(source)
    raw = source.read_bytes()
    source.write_bytes(bytes(4096) + raw[4096:])
    done = recovered(tmp_path, source)
    assert contents(done.path) == everything
    assert not done.scan.closed


def test_a_stray_byte_before_the_index_loses_nothing(tmp_path):
    source = recording(tmp_path / "whole.bag")
    everything = contents(source)
    with Index(source) as index:
        position = index.position
    raw = source.read_bytes()
    moved = raw.replace(position.to_bytes(8, "little"), (position + 1).to_bytes(8, "little"), 1)
    source.write_bytes(moved[:position] + b"\n" + moved[position:])
    with Index(source) as index:
        assert len(index.messages().t_ns) == 85
    assert contents(merge([source], tmp_path / "merged.bag").path) == everything
    done = recovered(tmp_path, source)
    assert (contents(done.path), done.scan.lost) == (everything, 0)


def test_messages_that_nobody_describes_are_named_and_left_out(tmp_path):
    source = recording(tmp_path / "whole.bag", "lz4")
    with Index(source) as index:
        position = index.position
        head = index.head(0)
    raw = bytearray(source.read_bytes()[:position])
    raw[head.data : head.data + head.stored] = bytes(head.stored)
    source.write_bytes(raw)
    done = recovered(tmp_path, source)
    assert done.scan.messages == len(contents(done.path)) < 85 - chunk_ends_first(tmp_path)
    assert any("described nowhere" in each.what for each in done.scan.damages)


def chunk_ends_first(tmp_path):
    return chunk_ends(recording(tmp_path / "again.bag", "lz4"))[0][1]


def test_of_the_two_descriptions_of_a_connection_the_good_one_is_kept(tmp_path):
    source = recording(tmp_path / "whole.bag")
    everything, raw = contents(source), source.read_bytes()
    source.write_bytes(raw.replace(b"md5sum=", b"md5\xff\xfe\xfd=", 1))
    assert contents(recovered(tmp_path, source, check_data=True).path) == everything
    source.write_bytes(raw.replace(b"callerid=/", b"callerid=\xff", 1))
    assert contents(recovered(tmp_path, source, check_data=True).path) == everything


def test_random_damage_never_stops_it_and_what_it_writes_is_good(tmp_path):
    chance = random.Random(7)
    for compression in COMPRESSIONS:
        raw = recording(tmp_path / "whole.bag", compression).read_bytes()
        (tmp_path / "whole.bag").unlink()
        for _ in range(12):
            broken = bytearray(raw)
            for _ in range(chance.randint(1, 4)):
                at, size = chance.randrange(13, len(raw)), chance.choice((1, 4, 60, 900))
                broken[at : at + size] = chance.choice((bytes(1), b"\xff", bytes([chance.randrange(256)]))) * min(
                    size, len(raw) - at
                )
            source = tmp_path / "broken.bag"
            source.write_bytes(broken)
            if refusal(source):
                assert re.search("encrypted|version", refusal(source))
            else:
                assert recovered(tmp_path, source, check_data=True).size > 0


def refusal(source):
    """Return why a file is not even looked through; None when it is."""
    try:
        scan(source, check_data=True)
    except BagError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    "content,wrong",
    [
        (b"", r"is empty; name a ROS 1 bag of version 2\.0"),
        (b"no bag at all", "is no bag"),
        (b"ULog\x01\x12\x35\x01" + bytes(50), "is no bag but a ULog of PX4; amaze-bag info and amaze-replay read it"),
        (b"\x89MCAP0\r\n" + bytes(50), "is no bag but an MCAP file; amaze-bag info and amaze-replay read it"),
        (b"SQLite format 3\x00" + bytes(50), "is no bag but an SQLite file; amaze-bag info and amaze-replay"),
        (b"\xa3\x95\x80\x80" + bytes(50), "is no bag but a DataFlash log of ArduPilot"),
        (b"version https://git-lfs.github.com/spec/v1\n", "is no bag but a pointer of Git LFS, not the file itself"),
        (bytes.fromhex("0005f5e100000000fe"), "is no bag but a telemetry log of MAVLink; amaze-replay reads it"),
        (b"\x1f\x8b\x08\x00" + bytes(50), "is no bag but compressed with gzip; unpack it first"),
        (b"#ROSBAG V1.2\n" + bytes(5000), r"its version is not 2\.0 \(#ROSBAG V1\.2\); older ones are converted"),
    ],
)
def test_what_is_no_bag_is_refused(tmp_path, content, wrong):
    source = tmp_path / "x.bag"
    source.write_bytes(content)
    with pytest.raises(BagError, match=wrong):
        recover(source, tmp_path / "y.bag")
    assert not (tmp_path / "y.bag").exists()


@pytest.mark.parametrize("begin", [b"ULog\x01\x12\x35\x01", b"\x89MCAP0\r\n", b"SQLite format 3\x00", b"\xa3\x95"])
def test_reading_says_what_a_file_is_that_is_no_bag(tmp_path, begin):
    source = tmp_path / "x.bag"
    source.write_bytes(begin + bytes(200))
    with pytest.raises(BagError, match=r"is no bag but an? "):
        Recording(source)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    with pytest.raises(BagError, match="is the folder of a ROS 2 bag; rosbags-convert makes a ROS 1 bag of it"):
        Recording(tmp_path)


def test_an_encrypted_bag_is_refused(tmp_path):
    source = recording(tmp_path / "x.bag")
    raw = source.read_bytes()
    size = int.from_bytes(raw[13:17], "little")
    field = b"encryptor=rosbag/AesCbcEncryptor"
    new = (size + 4 + len(field)).to_bytes(4, "little") + len(field).to_bytes(4, "little") + field + raw[17:]
    source.write_bytes(raw[:13] + new)
    for use in (Index, lambda path: scan(path, check_data=False)):
        with pytest.raises(BagError, match="is encrypted; decrypt it"):
            use(source)


def test_the_original_is_refused_as_output(tmp_path):
    source = recording(tmp_path / "x.bag")
    with pytest.raises(BagError, match="is the bag to be recovered, which is never changed"):
        recover(source, source, replace=True)


@pytest.mark.parametrize("bit", range(0, 8, 2))
def test_a_wrong_count_in_an_index_record_is_told_and_made_anew(tmp_path, bit):
    """Its length is right, so nothing is lost; but no other reader opens such a bag."""
    source = recording(tmp_path / "x.bag")
    with Index(source) as index:
        head = index.head(1)
    raw = bytearray(source.read_bytes())
    raw[raw.index(b"count=", head.data + head.stored) + 6] ^= 1 << bit
    source.write_bytes(raw)
    done = recovered(tmp_path, source)
    assert [(each.what.partition(" counts ")[0], each.lost) for each in done.scan.damages] == [("an index record", 0)]
    assert (done.scan.messages, verify(done.path, [], readers="all").problems) == (85, ())


@pytest.mark.parametrize("bit", [0, 6])
def test_a_wrong_count_in_the_bags_own_index_is_no_loss_where_the_chunk_and_its_index_agree(tmp_path, bit):
    source = recording(tmp_path / "x.bag")
    raw = bytearray(source.read_bytes())
    raw[-4] ^= 1 << bit
    source.write_bytes(raw)
    done = recovered(tmp_path, source)
    assert (done.scan.messages, done.scan.lost) == (85, 0)
    assert "the bag's index counts other messages in a chunk than it has" in [each.what for each in done.scan.damages]


def test_what_a_power_cut_left_under_the_temporary_name_of_the_output_is_refused(tmp_path):
    left = recording(tmp_path / "flight.bag").rename(tmp_path / ".flight.bag.part")
    before = digest(left)
    with pytest.raises(BagError, match=r"\.flight\.bag\.part: is the bag to be recovered.*another name for the output"):
        recover(left, tmp_path / "flight.bag")
    assert digest(left) == before


def test_names_of_what_is_recovered(tmp_path):
    names = ["x.bag.active", "x.bag", "x"]
    assert [recovered_name(tmp_path / name).name for name in names] == ["x.bag", "x.recovered.bag", "x.recovered.bag"]


def test_what_python_wrote_and_what_we_write_are_read_together(tmp_path):
    """The rosbags library reads all index records by the layout of the first."""
    source = bag(tmp_path / "1.bag", rows("/a", 200))
    raw = source.read_bytes()
    with Index(source) as index:
        positions = [chunk.end for chunk in index.chunks]
    ours = b"\x09\0\0\0conn=\0\0\0\0\x0a\0\0\0count="
    assert ours[:9] in raw
    foreign = _with_foreign_index(raw, positions[-1])
    source.write_bytes(foreign[: positions[-2] + 500])
    done = recovered(tmp_path, source)
    assert multiset(done.path)


def _with_foreign_index(raw, end):
    """Return the bag with the fields of index records in the order of rosbag in Python."""
    begin, at = bytearray(raw[:end]), 0
    while True:
        at = raw.find(b"\x2f\0\0\0\x09\0\0\0conn=", at, end)
        if at < 0:
            return bytes(begin)
        fields = raw[at + 4 : at + 51]
        connection, count, rest = fields[:13], fields[13:27], fields[27:]
        begin[at + 4 : at + 51] = rest + connection + count
        at += 51
