"""Compressed images stay compressed in a merge: other beginning, same bytes, readable by everybody."""

from __future__ import annotations

import random
import struct

import lz4.block
import lz4.frame
import numpy as np
import pytest
from bag_tools import MS, bag, contents, digest, multiset, rows, text
from hypothesis import given
from hypothesis import strategies as st
from replay_bags import START_NS, write_bag
from test_merge import merged

from amaze_autonomy.bags.arrays import index_data
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import record_at
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge import lz4_chunk_copy, writer
from amaze_autonomy.bags.merge.lz4_chunk_copy import STRIPE, block_beginning, block_end, lengthened, neutral_stripe
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import verify
from amaze_autonomy.bags.recover.recover import recover
from amaze_autonomy.bags.recover.scan import scan
from amaze_autonomy.bags.write import Output

IMAGES, IMUS = 8, 40


def image(name, number, size):
    """Return an image that lz4 makes half of, with a little of everything at its end."""
    chance = random.Random(f"{name} {number}")
    noise = chance.getrandbits(2 * size).to_bytes(size // 4, "little").hex()
    return text(noise + "abc" * (size // 6) + noise[: number % 17])


def camera(path, name, *, first_ms=0, size=200_000, imus=IMUS):
    """Write a recording as the recorder does: lz4, and each image is the last of its chunk."""
    images = [(START_NS + (first_ms + 40 * each) * MS, f"/{name}/image", image(name, each, size)) for each in range(8)]
    plain = bag(path.with_suffix(".plain.bag"), images, rows(f"/{name}/imu", imus, 8, first_ms + 3))
    merge([plain], path, MergeOptions(compression="lz4"))
    plain.unlink()
    return path


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch):
    monkeypatch.setattr(writer, "CHUNK_BYTES", 64 << 10)  # the recorder's with --chunksize=64


@pytest.fixture
def two(tmp_path):
    return [camera(tmp_path / "1.bag", "a"), camera(tmp_path / "2.bag", "b", first_ms=7)]


def compressions(path):
    with Index(path) as index:
        found = [index.head(each).compression for each in range(len(index.chunks))]
        return {kind: found.count(kind) for kind in found}


def spans(path):
    with Index(path) as index:
        return [(chunk.start_ns, chunk.end_ns) for chunk in index.chunks if chunk.counts]


@pytest.mark.slow_rows
@pytest.mark.parametrize("output", ["auto", "lz4", "none", "bz2"])
def test_every_message_is_there_and_images_stay_compressed_where_they_may(tmp_path, two, output):
    result = merged(tmp_path, two, compression=output)
    assert multiset(result.path) == multiset(*two)
    assert verify(result.path, two, readers="none").problems == ()
    if output in ("auto", "lz4"):
        assert compressions(result.path)["lz4"] >= 2 * IMAGES
        assert result.size < 1.03 * sum(path.stat().st_size for path in two)
    else:
        assert set(compressions(result.path)) == {output}


def test_all_other_readers_read_the_same_bytes(tmp_path, two):
    result = merged(tmp_path, two)
    readings = verify(result.path, two, readers="read").readings
    assert [reading.error for reading in readings] == [""] * len(readings)
    assert verify(result.path, two, readers="read").problems == ()


def test_no_two_chunks_overlap_in_time_so_readers_need_each_once(tmp_path, two):
    found = spans(merged(tmp_path, two).path)
    assert all(end <= start for (_, end), (start, _) in zip(found, found[1:]))
    assert len(found) > 2 * IMAGES


def test_the_checksum_of_every_new_frame_is_right(tmp_path, two):
    result = merged(tmp_path, two)
    raw = result.path.read_bytes()
    with Index(result.path) as index:
        heads = [index.head(each) for each in range(len(index.chunks))]
    frames = [raw[head.data : head.data + head.stored] for head in heads if head.compression == "lz4"]
    sizes = [head.size for head in heads if head.compression == "lz4"]
    assert [len(lz4.frame.decompress(frame)) for frame in frames] == sizes


def test_an_image_alone_in_its_chunk_is_copied_as_it_is(tmp_path):
    one = camera(tmp_path / "1.bag", "a", imus=0)
    two = camera(tmp_path / "2.bag", "b", imus=0, first_ms=1)
    result = merged(tmp_path, [one, two])
    assert multiset(result.path) == multiset(one, two)
    raw, kept = result.path.read_bytes(), 0
    with Index(one) as index:
        before = one.read_bytes()
        for each in range(1, len(index.chunks)):  # the first describes the connection
            head = index.head(each)
            kept += before[head.data : head.data + head.stored] in raw
    assert kept == IMAGES - 1


def test_the_first_message_may_be_such_an_image(tmp_path):
    """Its chunk is opened, because connections have to be described before it."""
    inputs = [camera(tmp_path / f"{name}.bag", name, imus=0) for name in "ab"]
    again = merged(tmp_path, inputs).path
    assert multiset(again) == multiset(*inputs)
    assert verify(again, inputs, readers="read").problems == ()
    assert compressions(again) == {"none": 1, "lz4": 2 * IMAGES - 1}
    cut = again.with_name("cut.bag")
    with Index(again) as index:
        cut.write_bytes(again.read_bytes()[: index.position])
    assert contents(recover(cut, again.with_name("recovered.bag")).path) == contents(again)


def test_a_damaged_first_image_is_an_error(tmp_path):
    inputs = [camera(tmp_path / f"{name}.bag", name, imus=0) for name in "ab"]
    begin, end = places_in_chunk(inputs[0], 0)
    raw = bytearray(inputs[0].read_bytes())
    raw[(begin + end) // 2] ^= 1
    inputs[0].write_bytes(raw)
    with pytest.raises(BagError, match=r"a\.bag: its first chunk is damaged: its lz4 data is damaged"):
        merge(inputs, tmp_path / "merged.bag")


def test_chunks_in_turn_without_overlap_come_in_order(tmp_path):
    """A chunk that is copied as it is waits for all before it, and for nothing behind it."""
    one = camera(tmp_path / "1.bag", "a", imus=0)
    two = camera(tmp_path / "2.bag", "b", imus=0, first_ms=7)
    result = merged(tmp_path, [one, two])
    assert verify(result.path, [one, two], readers="none").problems == ()


def test_chunks_in_turn_of_small_messages_come_in_order(tmp_path):
    one = bag(
        tmp_path / "1.bag", [row for each in range(9) for row in rows("/a", 30, 1, 100 * each)], compression="bz2"
    )
    two = bag(tmp_path / "2.bag", rows("/b", 9, 100, 50), chunk_bytes=10, compression="bz2")
    result = merged(tmp_path, [one, two], compression="bz2")
    assert verify(result.path, [one, two], readers="none").problems == ()


def test_merged_bags_can_be_merged_again_and_recovered(tmp_path, two):
    first = merge(two, tmp_path / "first.bag").path
    third = camera(tmp_path / "3.bag", "c", first_ms=11)
    result = merged(tmp_path, [first, third])
    assert multiset(result.path) == multiset(*two, third)
    assert compressions(result.path)["lz4"] >= 3 * IMAGES
    assert scan(result.path, check_data=True).damages == []


@pytest.mark.parametrize("output", ["none", "bz2"])
def test_merged_bags_are_decompressed_like_others(tmp_path, two, output):
    first = merge(two, tmp_path / "first.bag").path
    third = camera(tmp_path / "3.bag", "c", first_ms=11)
    result = merged(tmp_path, [third, first], compression=output, offsets_ns=(0, 1_000_000))
    shifted = [(t_ns + 1_000_000, topic, raw) for t_ns, topic, raw in contents(first)]
    assert sorted(contents(result.path)) == sorted(contents(third) + shifted)
    assert set(compressions(result.path)) == {output}


def test_times_are_shifted_without_decompressing(tmp_path, two):
    result = merged(tmp_path, two, offsets_ns=(0, -5_000_000))
    shifted = [(t_ns - 5_000_000, topic, raw) for t_ns, topic, raw in contents(two[1])]
    assert sorted(contents(result.path)) == sorted(contents(two[0]) + shifted)
    assert compressions(result.path)["lz4"] >= 2 * IMAGES - 1


def test_what_both_recorded_is_compared_so_it_is_decompressed(tmp_path):
    one, two = camera(tmp_path / "1.bag", "a"), camera(tmp_path / "2.bag", "a")
    result = merged(tmp_path, [one, two], duplicates="drop")
    assert multiset(result.path) == multiset(one)
    assert set(compressions(result.path)) == {"none"}


def test_the_same_inputs_give_the_same_bytes(tmp_path, two):
    paths = [merge(two, tmp_path / f"m{each}.bag").path for each in range(2)]
    assert digest(paths[0]) == digest(paths[1])


def test_without_the_library_they_are_decompressed(tmp_path, two, monkeypatch):
    monkeypatch.setattr(lz4_chunk_copy, "_LIBRARY", None)
    result = merged(tmp_path, two)
    assert multiset(result.path) == multiset(*two)
    assert compressions(result.path)["lz4"] == result.chunks_copied < 3


@pytest.mark.parametrize(
    "options",
    [
        {"block_linked": True, "content_checksum": True, "store_size": False},
        {"block_linked": False, "content_checksum": False, "store_size": False},
        {"block_linked": False, "content_checksum": True, "store_size": True},
        {"block_linked": False, "content_checksum": True, "block_checksum": True, "store_size": False},
    ],
    ids=["linked blocks", "no checksum", "with its size", "checksums of blocks"],
)
def test_frames_of_other_writers_are_decompressed(tmp_path, two, options):
    foreign = repacked(two[1], tmp_path / "foreign.bag", lambda content: lz4.frame.compress(content, **options))
    result = merged(tmp_path, [two[0], foreign])
    assert multiset(result.path) == multiset(*two)
    assert compressions(result.path)["lz4"] == IMAGES
    assert verify(result.path, [two[0], foreign], readers="none").problems == ()


@pytest.mark.parametrize("block", [lz4.frame.BLOCKSIZE_MAX64KB, lz4.frame.BLOCKSIZE_MAX4MB])
def test_blocks_of_any_size(tmp_path, two, block):
    foreign = repacked(
        two[1],
        tmp_path / "foreign.bag",
        lambda content: lz4.frame.compress(
            content, block_size=block, block_linked=False, content_checksum=True, store_size=False
        ),
    )
    result = merged(tmp_path, [two[0], foreign])
    assert multiset(result.path) == multiset(*two)
    assert compressions(result.path)["lz4"] == 2 * IMAGES


def repacked(path, output, compress):
    """Write a bag again with other frames: everything keeps its order, places are told anew."""

    with Index(path) as index, Output(output) as out:
        raw = path.read_bytes()
        for each, chunk in enumerate(index.chunks):
            head = index.head(each)
            frame = compress(lz4.frame.decompress(raw[head.data : head.data + head.stored]))
            t_ns, connection, offset = index.entries(each)
            numbers = sorted(set(connection.tolist()))
            masks = [np.asarray(connection == number) for number in numbers]
            records = b"".join(index_data(number, t_ns[mask], offset[mask]) for number, mask in zip(numbers, masks))
            times = (chunk.start_ns, chunk.end_ns)
            out.chunk("lz4", head.size, [frame], records, times=times, counts=chunk.counts)
        out.close(index.connections)
    return output


def places_in_chunk(path, number):
    with Index(path) as index:
        head = index.head(number)
        return head.data, head.data + head.stored


@pytest.mark.parametrize("damage", range(24))
@pytest.mark.slow_rows
def test_damage_is_never_hidden(tmp_path, two, damage):
    """It is refused, or copied with a checksum that is still wrong."""
    begin, end = places_in_chunk(two[0], 3)
    chance = random.Random(damage)
    place = [begin, begin + 4, begin + 5, begin + 7, begin + 10, begin + 12, begin + 40, end - 9, end - 5, end - 1]
    at = place[damage] if damage < len(place) else chance.randrange(begin, end)
    raw = bytearray(two[0].read_bytes())
    raw[at] ^= 1 << chance.randrange(8)
    two[0].write_bytes(raw)
    with pytest.raises(BagError, match=r"the chunk at byte \d+ is damaged"):
        verify(merge(two, tmp_path / "merged.bag").path, [], readers="none")


@pytest.mark.parametrize("place", [0.1, 0.5, 0.99])
def test_damage_in_an_image_is_refused_where_what_is_copied_is_checked(tmp_path, two, place):
    begin, end = places_in_chunk(two[0], 3)
    raw, whole = bytearray(two[0].read_bytes()), merge(two, tmp_path / "whole.bag", MergeOptions(check_copied=True))
    assert digest(whole.path) == digest(merge(two, tmp_path / "unchecked.bag").path)
    raw[begin + int(place * (end - begin))] ^= 1
    two[0].write_bytes(raw)
    with pytest.raises(BagError, match=r"1\.bag: the chunk at byte \d+ is damaged"):
        merge(two, tmp_path / "merged.bag", MergeOptions(check_copied=True))
    assert not (tmp_path / "merged.bag").exists()


@given(st.data())
def test_the_ends_of_blocks(data):
    chance = random.Random(data.draw(st.integers(0, 10**6)))
    words = [bytes(chance.choices(b"ab\x50\x60\x70\xe0\xf0", k=chance.randrange(1, 40))) for _ in range(9)]
    content = b"".join(chance.choices(words, k=chance.randrange(1, 60)))
    stored = memoryview(bytearray(lz4.block.compress(content, store_size=False)))
    for size in range(min(16, len(content) + 1)):
        assert block_end(stored, size) == content[len(content) - size :]
    for size in (1, 20, len(content), len(content) + 5):
        assert block_beginning(stored, size) == content[:size]


def test_blocks_that_are_none():
    assert block_beginning(memoryview(bytearray(b"")), 5) == b""
    assert block_end(memoryview(bytearray(b"")), 0) is None
    assert block_end(memoryview(bytearray(b"\xff" * 9)), 12) is None


def test_the_new_header_is_one_of_the_format(tmp_path, two):
    """Its fields are those of a message, and two that readers do not know."""
    result = merged(tmp_path, two)
    raw = result.path.read_bytes()
    with Index(result.path) as index:
        number = [each for each in range(len(index.chunks)) if index.head(each).compression == "lz4"][5]
        head, (t_ns, connection, offset) = index.head(number), index.entries(number)
    content = lz4.frame.decompress(raw[head.data : head.data + head.stored])
    record = record_at(content, 0, len(content))
    assert list(record.fields) == [b"conn", b"op", b"time", b"pad", b"was"]
    assert (record.number(b"conn"), record.time_ns(b"time")) == (connection.tolist()[0], t_ns.tolist()[0])
    assert (offset.tolist(), record.end) == ([0], len(content))
    assert struct.unpack("<L", content[:4])[0] == record.data - 8


def test_the_space_that_is_asked_for_is_what_is_needed(tmp_path, two, monkeypatch):
    asked = []
    opened = Output.__init__
    monkeypatch.setattr(
        Output, "__init__", lambda out, *path, needed, **options: asked.append(needed) or opened(out, *path, **options)
    )
    several = [(START_NS + each * MS, "/c", image("c", each, 70_000)) for each in range(8)]
    three = write_bag(tmp_path / "3.bag", several, "lz4", chunk_bytes=400_000)
    for inputs in (two, [three, *two]):
        size = merge(inputs, tmp_path / "merged.bag", MergeOptions(replace=True)).size
        assert asked[-1] < 1.02 * size
        assert asked[-1] > size - 250_000  # the first image is opened


def test_small_and_middling_messages_are_not_worth_it(tmp_path):
    some = [(START_NS + each * MS, "/a", text("x" * 30_000)) for each in range(20)]
    one = write_bag(tmp_path / "1.bag", some, "lz4", chunk_bytes=100_000)
    result = merged(tmp_path, [one, bag(tmp_path / "2.bag", rows("/b", 20, 1), compression="lz4")])
    assert set(compressions(result.path)) == {"none"}


# The checksum of a longer content is told from that of the shorter one; what lz4 itself says is the truth.


def checksum(content):
    """Return the last four bytes of a frame: the checksum of its content."""
    return int.from_bytes(lz4.frame.compress(content, content_checksum=True)[-4:], "little")


def stripes(most):
    return st.integers(0, most).flatmap(lambda count: st.binary(min_size=count * STRIPE, max_size=count * STRIPE))


@given(content=st.binary(min_size=STRIPE, max_size=200), before=stripes(5), behind=stripes(3))
def test_any_beginning_becomes_invisible(content, before, behind):
    beginning = before + neutral_stripe(before, behind) + behind
    end = content[len(content) // STRIPE * STRIPE :]
    assert checksum(beginning + content) == lengthened(checksum(content), len(beginning), end)


@given(content=st.binary(min_size=STRIPE, max_size=99), claimed=st.integers(0, 2**32 - 1))
def test_a_checksum_that_was_wrong_stays_wrong(content, claimed):
    beginning = neutral_stripe(b"", b"")
    end = content[len(content) // STRIPE * STRIPE :]
    same = lengthened(claimed, STRIPE, end) == checksum(beginning + content)
    assert same is (claimed == checksum(content))


@pytest.mark.parametrize("size", range(STRIPE))
def test_every_length_of_an_end(size):
    content = bytes(range(64 + size))
    beginning = bytes(16) + neutral_stripe(bytes(16), b"\xff" * 32) + b"\xff" * 32
    assert checksum(beginning + content) == lengthened(checksum(content), len(beginning), content[64:])
