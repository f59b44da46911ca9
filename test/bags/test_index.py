"""What index records say is told without numpy, and is the same as with it; an index that is cut short is refused."""

from __future__ import annotations

import random
import struct
import tracemalloc

import pytest
from bag_tools import COMPRESSIONS, bag, multiset, reindexed, rows
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.bags.arrays import index_records, joined_parts
from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Entries, Index
from amaze_autonomy.bags.recover.recover import recover
from amaze_autonomy.bags.recover.salvage import Kept

times = st.tuples(st.integers(0, 3) | st.integers(0, 2**32 - 1), st.integers(0, 5) | st.integers(0, 999_999_999))
messages = st.lists(st.tuples(times, st.integers(0, 2**32 - 1)), max_size=20)
records = st.lists(st.tuples(st.integers(0, 4), messages), min_size=1, max_size=5)


def entries(found):
    parts = [(number, b"".join(struct.pack("<3L", *time, at) for time, at in rows)) for number, rows in found]
    return Entries(tuple(parts), 0, trusted=True, foreign=False)


@given(records)
def test_times_counts_and_rows_are_those_of_arrays(found):
    told = entries(found)
    t_ns, connection, offset = (column.tolist() for column in joined_parts(list(told.parts)))
    assert [*told.rows()] == [*zip(t_ns, connection, offset)]
    assert told.messages == len(t_ns)
    assert dict(told.counts()) == {number: connection.count(number) for number in sorted(set(connection))}
    if t_ns:
        assert told.times() == (min(t_ns), max(t_ns))


@given(records)
def test_index_records_are_those_of_arrays(found):
    rows = [*entries(found).rows()]
    columns = joined_parts(list(entries(found).parts))
    assert Kept(rows, {}, 0).index_bytes() == index_records(*columns)


@pytest.mark.parametrize("seconds", [(5, 5, 5), (5, 6, 5), (7, 5, 6, 5, 7), (1, 2, 3)])
def test_times_need_not_be_in_order(seconds):
    rows = [((second, 900 - 10 * place), place) for place, second in enumerate(seconds)]
    expected = sorted(second * 1_000_000_000 + fraction for (second, fraction), _ in rows)
    assert entries([(0, rows)]).times() == (expected[0], expected[-1])


@pytest.mark.parametrize("field", [b"chunk_count=", b"conn_count="])
def test_an_index_has_as_many_records_as_the_header_counts(tmp_path, field):
    source, changed = bag(tmp_path / "1.bag", rows("/a", 100), rows("/b", 60), rows("/c", 9)), tmp_path / "2.bag"
    raw = source.read_bytes()
    place = raw.index(field) + len(field)
    with Index(source) as index:
        assert len(index.chunks) == 9
    for bit in range(32):
        flipped = bytearray(raw)
        flipped[place + bit // 8] ^= 1 << bit % 8
        changed.write_bytes(flipped)
        with pytest.raises(BagError, match="the index is damaged"):
            Index(changed)


def test_what_is_no_record_may_stand_behind_an_index(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 100))
    for junk in (b"\n", bytes(5000), b"\x07\0\0\0", b"trailing junk of a copy"):
        longer = tmp_path / "2.bag"
        longer.write_bytes(source.read_bytes() + junk)
        with Index(longer) as index:
            assert len(index.messages().t_ns) == 100


def test_an_index_that_counts_a_connection_of_a_chunk_twice_is_refused(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 3), rows("/b", 3), chunk_bytes=10_000)
    raw = source.read_bytes()
    said = struct.pack("<4L", 0, 3, 1, 3)
    assert raw.count(said) == 1
    source.write_bytes(raw.replace(said, struct.pack("<4L", 0, 3, 0, 3)))
    with pytest.raises(BagError, match="it counts the messages of a connection twice"):
        Index(source)


@pytest.mark.parametrize("compression", COMPRESSIONS)
@pytest.mark.parametrize("place", [0, 1, 4, -1])
def test_a_chunk_that_the_index_does_not_name_is_refused_wherever_it_is(tmp_path, compression, place):
    source = bag(tmp_path / "1.bag", rows("/a", 100), rows("/b", 60, first_ms=5000), compression=compression)
    with Index(source) as index:
        chunks = [chunk.position for chunk in index.chunks]
    path = reindexed(
        source, tmp_path / "2.bag", lambda links, each: (links, [one for one in each if one != each[place]])
    )
    before = f"the chunk at byte {chunks[place - 1]} is damaged: the one behind it is not named by the bag's index"
    assert opened(path) == (
        before if place else f"the index is damaged (it does not name the chunk at byte {chunks[0]})"
    )
    for command in (["merge"], ["filter", "--topics", "/a"], ["filter", "--topics", "/b"]):
        assert main([*command, "-o", str(tmp_path / "out.bag"), str(path)]) == 1
    assert main(["doctor", str(path)]) == 3
    assert multiset(recover(path, tmp_path / "out.bag").path) == multiset(source)


def test_a_chunk_that_the_index_names_twice_is_refused(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 100))
    with Index(source) as index:
        position = index.chunks[1].position
    path = reindexed(source, tmp_path / "2.bag", lambda links, each: (links, [*each, each[1]]))
    assert opened(path) == f"the index is damaged (it names the chunk at byte {position} twice)"
    assert multiset(recover(path, tmp_path / "out.bag").path) == multiset(source)


@pytest.mark.parametrize("renamed", [b"/c", b"/a"])  # of another topic, then only of another publisher
def test_an_index_in_which_two_connections_have_one_number_is_refused(tmp_path, renamed):
    def another(links, chunks):
        return [*links, links[0].replace(b"/a", renamed).replace(b"/recorder", b"/recordex")], chunks

    source = bag(tmp_path / "1.bag", rows("/a", 3), rows("/b", 3))
    wrong = f"the index is damaged (two connections have the number 0, /a and {renamed.decode()})"
    assert opened(reindexed(source, tmp_path / "2.bag", another)) == wrong


def test_an_index_may_say_twice_the_same_of_a_connection(tmp_path):
    source = bag(tmp_path / "1.bag", rows("/a", 3), rows("/b", 3))
    path = reindexed(source, tmp_path / "2.bag", lambda links, chunks: ([*links, links[0]], chunks))
    assert opened(path) == opened(source)


def opened(path):
    """Return what an index says, or why it is refused."""
    try:
        with Index(path) as index:
            return index.connections, index.chunks, index.messages().t_ns.tolist()
    except BagError as error:
        return error.wrong


def test_a_large_index_is_the_same_read_by_its_records(tmp_path, monkeypatch):
    """Every bit of where it is and of what it counts, bits drawn in it, and what stands behind it."""
    source, path = bag(tmp_path / "1.bag", rows("/a", 50), rows("/b", 30)), tmp_path / "2.bag"
    raw, chance = source.read_bytes(), random.Random(3)
    fields = [(b"index_pos=", 8), (b"conn_count=", 4), (b"chunk_count=", 4)]
    starts = [raw.index(name) + len(name) for name, _ in fields]
    bits = [8 * start + bit for start, (_, size) in zip(starts, fields) for bit in range(8 * size)]
    with Index(source) as index:
        bits += [chance.randrange(8 * index.position, 8 * index.size) for _ in range(200)]
    changed = [raw[:at] + bytes([raw[at] ^ 1 << bit]) + raw[at + 1 :] for at, bit in (divmod(each, 8) for each in bits)]
    changed += [raw, raw + b"\n", raw + bytes(5000), raw[:-1], raw[:-1000]]
    refused = 0
    for content in changed:
        path.write_bytes(content)
        with monkeypatch.context() as patch:
            said = opened(path)
            patch.setattr("amaze_autonomy.bags.index._LARGE_INDEX", 0)
            patch.setattr("amaze_autonomy.bags.index._PIECE", 500)
            by_records = opened(path)
        refused += isinstance(said, str)
        assert isinstance(by_records, str) is isinstance(said, str)
        assert isinstance(said, str) or by_records == said
    assert refused > 100


def test_a_wrong_place_of_the_index_brings_no_recording_into_memory(tmp_path):
    path = bag(tmp_path / "1.bag", rows("/a", 100))
    raw = bytearray(path.read_bytes())
    at = raw.index(b"index_pos=") + 10
    with Index(path) as index:
        places = [index.chunks[0].position, index.head(0).data]  # of a chunk, and of a connection in it
    assert len(places) == 2
    for place in places:
        raw[at : at + 8] = struct.pack("<Q", place)
        with path.open("wb") as file:
            file.write(raw)
            file.truncate(200 << 20)
        tracemalloc.start()
        with pytest.raises(BagError, match="the index is damaged"):
            Index(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 20 << 20
