"""One wrong bit in what a bag says of its messages: it is refused, or nothing is lost; nobody calls the rest all."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest
from bag_tools import COMPRESSIONS, MS, bag, contents, flipped, rows, text
from replay_bags import START_NS

from amaze_autonomy.bags.arrays import check_index, index_records
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import CHUNK_INFO, index_header, record_at
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import count
from amaze_autonomy.bags.recover.recover import recover
from amaze_autonomy.bags.recover.scan import scan
from amaze_autonomy.bags.write import Output

WRONG = "in a chunk, it describes a connection otherwise than the bag's index"


def recording(path, compression="none"):
    """Write a bag of chunks with one message, as those of images are, and of chunks with several of two connections."""
    images = [(START_NS + each * 20 * MS, "/a", text(f"{each} " + "y" * 300)) for each in range(6)]
    return bag(path, images, rows("/b", 8, 1, 300), rows("/c", 8, 1, 300), compression=compression, chunk_bytes=250)


def counts(path):
    """Return where the index has the counts of a chunk's messages."""
    raw, found = path.read_bytes(), []
    with Index(path) as index:
        place = index.position
    while place < len(raw):
        record = record_at(raw, place, len(raw))
        if record.op == CHUNK_INFO:
            found += range(record.data + 4, record.end, 8)
        place = record.end
    return found


def merged(path, output, compression="auto"):
    """Return what a merge makes of a bag; None where it refuses it."""
    try:
        return contents(merge([path], output, MergeOptions(compression=compression, replace=True)).path)
    except BagError:
        return None


def refused(action, path):
    try:
        action(path)
    except BagError:
        return True
    return False


def indexed(path):
    with Index(path) as index:
        check_index(index)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_a_wrong_count_of_a_chunk_is_refused_by_all(tmp_path, compression):
    source = recording(tmp_path / "1.bag", compression)
    raw, broken = source.read_bytes(), tmp_path / "2.bag"
    with Index(source) as index:
        assert sum(each.messages == 1 for each in index.chunks) >= 6
    for place in counts(source):
        for bit in range(8):
            flipped(broken, raw, place, bit)
            assert merged(broken, tmp_path / "3.bag") is None, (place, bit)
            assert refused(count, broken), (place, bit)
            assert refused(indexed, broken), (place, bit)


@pytest.mark.parametrize("empty_records", [0, 1, 3])
def test_index_records_that_a_chunk_without_messages_has_are_empty(tmp_path, empty_records):
    """Some writers have a record for each connection, whether it has messages in the chunk or not."""
    path, t_ns = tmp_path / "1.bag", START_NS
    with Index(recording(tmp_path / "0.bag")) as index:
        connections = index.connections
    for entries in (0, 1):
        records = index_header(0, 0) * empty_records + index_records(*np.array([[t_ns], [1], [0]])[:, :entries])
        with Output(path, replace=True) as out:
            out.chunk("none", 0, [], records, times=(t_ns, t_ns), counts=())
            out.close(connections)
        assert [refused(each, path) for each in (indexed, count, merging(tmp_path))] == [bool(entries)] * 3


def merging(folder):
    return lambda path: merge([path], folder / "merged.bag", MergeOptions(replace=True))


def names(path):
    """Return how many messages there are by topic, type and md5."""
    return {key: tally.messages for key, tally in count(path).topics.items()}


def described(path, where):
    """Return where topics, types and md5s of connections stand, in the index or in chunks that are not compressed."""
    raw = path.read_bytes()
    with Index(path) as index:
        begin, end = (index.position, len(raw)) if where == "index" else (index.chunks[0].position, index.position)
    found = re.finditer(rb"topic=/.|type=std_msgs/String|md5sum=[0-9a-f]{32}", raw[begin:end])
    return [begin + at for each in found for at in range(each.start() + each.group().index(b"=") + 1, each.end())]


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "where, compression", [("index", "none"), ("index", "lz4"), ("index", "bz2"), ("chunk", "none")]
)
def test_a_wrong_bit_of_a_description_sends_no_message_to_another_name(tmp_path, where, compression):
    source = recording(tmp_path / "1.bag", compression)
    raw, whole, chance = source.read_bytes(), names(source), random.Random(where)
    broken, good = tmp_path / "2.bag", tmp_path / "3.bag"
    places = described(source, where)
    assert len(places) > 100
    refusals = 0
    for at in chance.sample(places, 60):
        flipped(broken, raw, at, chance.randrange(8))
        found = scan(broken)
        refusals += refused(names, broken)
        assert bool(found.damages) is refused(names, broken), at
        assert found.damages or names(broken) == whole, at
        assert (merged(broken, good, "none") is None) is bool(found.damages), at  # else chunks are copied unseen
        recover(broken, good, replace=True)
        assert (scan(good).damages, scan(good).messages) == ([], 22)
        right = sum(count for name, count in names(good).items() if name in whole)
        assert right == 22, (at, names(good))
    assert refusals > 30


@pytest.mark.parametrize("where", ["index", "chunk"])
def test_a_description_that_two_of_three_witnesses_contradict_is_not_kept(tmp_path, where):
    source = recording(tmp_path / "1.bag")
    raw, whole = source.read_bytes(), names(source)
    for said in (b"topic=/a", b"type=std_msgs/String", b"md5sum=99"):
        with Index(source) as index:
            at = raw.index(said, index.position if where == "index" else index.chunks[0].position) + len(said) - 1
        flipped(tmp_path / "2.bag", raw, at, 1)
        found = scan(tmp_path / "2.bag")
        assert [each.what for each in found.damages] == [WRONG]
        assert (found.lost, found.messages) == (0, 22)
        recover(tmp_path / "2.bag", tmp_path / "3.bag", replace=True)
        assert names(tmp_path / "3.bag") == whole
        assert contents(tmp_path / "3.bag") == contents(source)


def test_a_chunk_that_was_copied_with_the_descriptions_of_its_own_bag_is_good(tmp_path):
    first = bag(tmp_path / "1.bag", rows("/a", 20), rows("/b", 20), compression="lz4")
    second = bag(
        tmp_path / "2.bag", rows("/a", 40, 1, 5000), rows("/c", 10, 1, 9000), compression="lz4", chunk_bytes=500
    )
    done = merge([first, second], tmp_path / "3.bag")
    assert done.chunks_copied > 5
    with Index(done.path) as index:
        assert [each.topic for _, each in sorted(index.connections.items())] == ["/a", "/b", "/c"]
    assert sum(names(done.path).values()) == done.messages == 90
    assert scan(done.path).damages == []
