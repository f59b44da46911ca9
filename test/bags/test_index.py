"""What index records say is told without numpy, and is the same as with it."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from amaze_autonomy.bags.index import Entries
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
