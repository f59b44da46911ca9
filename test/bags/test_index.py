"""What index records say is told without numpy, and is the same as with it; an index that is cut short is refused."""

from __future__ import annotations

import struct

import pytest
from bag_tools import bag, rows
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Entries, Index
from amaze_autonomy.bags.read import index_records, joined_parts
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
