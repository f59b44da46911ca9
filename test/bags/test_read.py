"""Large messages of plain chunks go from file to file; only their beginnings are read. Frames of lz4 are checked."""

from __future__ import annotations

import os
import random
import shutil
import struct

import lz4.frame
import numpy as np
import pytest
from bag_tools import MS, bag, contents, digest, left_over, multiset, rows, text
from replay_bags import START_NS
from test_merge import merged

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import connection_record
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge import merge as merge_module
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import verify
from amaze_autonomy.bags.read import BEGINNING, Loader, Pool, decompress_frame


def images(topic, count, sizes=(200_000,), period_ms=40, first_ms=0):
    chance = random.Random(f"{topic} {first_ms}")
    return [
        (
            START_NS + (first_ms + each * period_ms) * MS,
            topic,
            text(f"{each} {topic} {chance.getrandbits(4 * sizes[each % len(sizes)]):x}"),
        )
        for each in range(count)
    ]


def camera(path, name, **options):
    """Write large and small messages in turn: some of the large at the beginning of a chunk, some at its end."""
    streams = images(f"/{name}/image", 20, **options), rows(f"/{name}/imu", 160, 5, 3)
    return bag(path, *streams, chunk_bytes=500_000)


def large_ones(path, *, unseen=True):
    """Return how many messages were left where they are."""
    with Index(path) as index, Pool() as pool:
        loader = Loader(index, 0, np.full(max(index.connections) + 1, unseen))
        blocks = [loader.plain([number], pool) for number in range(len(index.chunks))]
        return sum(int((block.origin >= 0).sum()) for block in blocks)


@pytest.mark.slow_rows
@pytest.mark.parametrize("sizes", [(200_000,), (70_000, 300, 65_000, 64_000), (2_000_000, 100)], ids=str)
@pytest.mark.parametrize("output", ["auto", "none", "lz4"])
def test_they_are_merged_byte_for_byte(tmp_path, sizes, output):
    one = camera(tmp_path / "1.bag", "a", sizes=sizes)
    two = camera(tmp_path / "2.bag", "b", sizes=sizes, first_ms=7)
    result = merged(tmp_path, [one, two], compression=output)
    assert multiset(result.path) == multiset(one, two)
    assert verify(result.path, [one, two], readers="none").problems == ()


def test_only_their_beginning_is_read(tmp_path, monkeypatch):
    one = camera(tmp_path / "1.bag", "a")
    assert large_ones(one) == 18  # the connections are described behind the first two
    assert large_ones(one, unseen=False) == 0
    read, preadv = [], os.preadv
    monkeypatch.setattr(os, "preadv", lambda *call: read.append(preadv(*call)) or read[-1])
    large_ones(one)
    assert sum(read) < one.stat().st_size - 18 * (200_000 - BEGINNING)


def test_shifted_clocks_are_written_into_them_too(tmp_path):
    one, two = camera(tmp_path / "1.bag", "a"), camera(tmp_path / "2.bag", "b", first_ms=2000)
    result = merged(tmp_path, [one, two], offsets_ns=(0, -2_000_000_001))
    shifted = [(t_ns - 2_000_000_001, topic, raw) for t_ns, topic, raw in contents(two)]
    assert sorted(contents(result.path)) == sorted(contents(one) + shifted)


def test_those_that_both_recorded_are_compared(tmp_path):
    one, two = camera(tmp_path / "1.bag", "a"), camera(tmp_path / "2.bag", "a")
    result = merged(tmp_path, [one, two], duplicates="drop")
    assert {key[0]: tally.messages for key, tally in result.duplicates.items()} == {"/a/image": 20, "/a/imu": 160}
    assert multiset(result.path) == multiset(one)


def with_chunk(path, output, change):
    """Write a bag of one chunk again, with other bytes in the chunk as long as they were."""
    raw = bytearray(path.read_bytes())
    with Index(path) as index:
        assert len(index.chunks) == 1
        head = index.head(0)
        t_ns, _, offset = index.entries(0)
        offsets = dict(zip(t_ns.tolist(), offset.tolist()))
    change(memoryview(raw)[head.data : head.data + head.stored], offsets)
    output.write_bytes(raw)
    return output


def one_chunk(path):
    return bag(path, images("/a", 3), rows("/b", 3, 40, 1), chunk_bytes=10_000_000)


def test_a_connection_behind_one_is_seen(tmp_path):
    """The record hides in what was the end of a large message."""

    def change(data, offsets):
        start = offsets[START_NS]
        payload = start + 8 + struct.unpack_from("<L", data, start)[0]
        size = struct.unpack_from("<L", data, payload - 4)[0]
        hidden = connection_record(77, b"/x", b"\x08\0\0\0type=a/b\x0a\0\0\0md5sum=" + b"0" * 3)
        struct.pack_into("<L", data, payload - 4, size - len(hidden))
        data[payload + size - len(hidden) : payload + size] = hidden

    changed = with_chunk(one_chunk(tmp_path / "1.bag"), tmp_path / "2.bag", change)
    assert large_ones(tmp_path / "1.bag") == 3
    assert large_ones(changed) == 0
    assert len(contents(merge([changed], tmp_path / "m.bag").path)) == 6


@pytest.mark.parametrize("value", [0, 5, 199_999, 2**32 - 1])
@pytest.mark.parametrize("where", ["header", "data"])
def test_a_damaged_length_is_an_error(tmp_path, value, where):
    def change(data, offsets):
        start = offsets[START_NS + 40 * MS]
        header = struct.unpack_from("<L", data, start)[0]
        struct.pack_into("<L", data, start if where == "header" else start + 4 + header, value)

    changed = with_chunk(one_chunk(tmp_path / "1.bag"), tmp_path / "2.bag", change)
    with pytest.raises(BagError, match=r"2\.bag: the chunk at byte 4\d+ is damaged"):
        merge([changed], tmp_path / "m.bag")
    assert left_over(tmp_path) == []


def test_an_input_that_is_cut_meanwhile_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(merge_module, "GROUP_BYTES", 100_000)
    one, two = camera(tmp_path / "1.bag", "a"), camera(tmp_path / "2.bag", "b")
    copy = tmp_path / "copy.bag"
    shutil.copy(one, copy)
    with pytest.raises(BagError, match=r"became shorter while it was read; try again"):
        merge([copy, two], tmp_path / "m.bag", progress=lambda *_: os.truncate(copy, 400_000))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["1.bag", "2.bag", "copy.bag"]


def test_the_same_inputs_give_the_same_bytes_however_they_are_loaded(tmp_path, monkeypatch):
    inputs = [camera(tmp_path / "1.bag", "a"), camera(tmp_path / "2.bag", "b")]
    merge(inputs, tmp_path / "m.bag")
    monkeypatch.setattr(Loader, "is_coarse", lambda *_: False)
    merge(inputs, tmp_path / "n.bag", MergeOptions())
    assert digest(tmp_path / "m.bag") == digest(tmp_path / "n.bag")


@pytest.mark.parametrize("kind", ["lz4", "bz2"])
def test_compressed_chunks_are_read_the_usual_way_where_the_library_is_not_found(tmp_path, monkeypatch, kind):
    streams = [rows(f"/{each}", 200, first_ms=each) for each in range(2)]
    inputs = [bag(tmp_path / f"{each}.bag", streams[each], compression=kind) for each in range(2)]
    merge(inputs, tmp_path / "m.bag")
    monkeypatch.setattr("amaze_autonomy.bags.read.decompress_frame", lambda *_: False)
    merge(inputs, tmp_path / "n.bag")
    assert digest(tmp_path / "m.bag") == digest(tmp_path / "n.bag")


def test_a_connection_number_that_nobody_gave_is_damage(tmp_path):
    path = one_chunk(tmp_path / "1.bag")
    with Index(path) as index:
        begin = index.position
    raw = path.read_bytes()
    path.write_bytes(raw[:begin] + raw[begin:].replace(b"conn=\0\0\0\0", b"conn=\xff\xff\xff\xff"))
    with pytest.raises(BagError, match=r"1\.bag: the index is damaged \(a connection has the number 4294967295\)"):
        Index(path)


PLAIN = bytes(random.Random(1).choices(b"abc", k=100_000))


@pytest.mark.parametrize("checksum", [False, True])
def test_a_frame_comes_to_its_place(checksum):
    target = bytearray(b"-" * (len(PLAIN) + 2))
    frame = lz4.frame.compress(PLAIN, content_checksum=checksum, store_size=False)
    assert decompress_frame(frame, len(PLAIN), target, 1)
    assert target == b"-" + PLAIN + b"-"


def test_a_frame_that_is_not_whole_good_or_of_this_size_is_refused():
    frame = bytearray(lz4.frame.compress(PLAIN, content_checksum=True, store_size=False))
    target = bytearray(len(PLAIN) + 10)
    assert not decompress_frame(bytes(frame), len(PLAIN) + 1, target, 0)
    assert not decompress_frame(bytes(frame), len(PLAIN) - 1, target, 0)
    assert not decompress_frame(bytes(frame), len(PLAIN), target, 11)
    for cut in (0, 3, 7, len(frame) // 2, len(frame) - 1):
        assert not decompress_frame(bytes(frame[:cut]), len(PLAIN), target, 0)
    for place in (0, 5, len(frame) // 2, len(frame) - 1):
        damaged = bytearray(frame)
        damaged[place] ^= 0x40
        assert not decompress_frame(bytes(damaged), len(PLAIN), target, 0)
    assert decompress_frame(bytes(frame), len(PLAIN), target, 0)


@pytest.mark.parametrize("size", [997, 70_000, 1 << 22])
def test_they_are_copied_in_pieces_of_any_size(tmp_path, monkeypatch, size):
    inputs = [camera(tmp_path / "1.bag", "a"), camera(tmp_path / "2.bag", "b", first_ms=7)]
    merge(inputs, tmp_path / "m.bag")
    monkeypatch.setattr("amaze_autonomy.bags.write._PIECE", size)
    merge(inputs, tmp_path / "n.bag")
    assert digest(tmp_path / "m.bag") == digest(tmp_path / "n.bag")


def test_those_of_several_chunks_are_left_out_together(tmp_path):
    """But for the first chunk: behind its large messages connections are described, so it is read as a whole."""
    path = camera(tmp_path / "1.bag", "a")
    with Index(path) as index, Pool() as pool:
        block = Loader(index, 0, np.full(max(index.connections) + 1, True)).plain([*range(len(index.chunks))], pool)
    raw = path.read_bytes()
    left = np.flatnonzero(block.origin >= 0)
    begun = zip(block.table.start[left].tolist(), block.origin[left].tolist(), block.table.end[left].tolist())
    assert len(left) == large_ones(path) == 18
    for start, origin, end in begun:
        assert block.buffer[start : start + BEGINNING] == raw[origin : origin + BEGINNING]
        assert not any(block.buffer[start + BEGINNING : end])
    seen = np.flatnonzero(block.origin < 0).tolist()
    assert all(block.buffer[block.table.start[each] : block.table.end[each]] in raw for each in seen)
