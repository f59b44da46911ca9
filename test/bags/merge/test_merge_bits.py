"""One wrong bit in what a bag says of its messages: it is refused, or nothing is lost; nobody calls the rest all."""

from __future__ import annotations

import numpy as np
import pytest
from bag_tools import COMPRESSIONS, MS, bag, contents, flipped, rows, text
from replay_bags import START_NS

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import CHUNK_INFO, index_header, record_at
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.merge.verify import count
from amaze_autonomy.bags.read import check_index, index_records
from amaze_autonomy.bags.write import Output


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
