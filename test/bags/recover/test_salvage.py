"""What is kept of the data of a chunk, whatever happened to it: the search ends, and costs what the damage touches."""

from __future__ import annotations

import pytest
from bag_tools import ending
from hypothesis import given, settings
from hypothesis import strategies as st

from amaze_autonomy.bags.format import connection_record, message_fields, record_at
from amaze_autonomy.bags.recover.salvage import salvaged

NEAR = 4  # a message that ends so near to damage is not known to be whole
SIZES = st.lists(st.integers(0, 90), min_size=4, max_size=12)  # bytes of payload
EDITS = st.lists(
    st.tuples(
        st.sampled_from(("length", "bit", "zeros", "noise", "cut", "twice")),
        st.integers(0, 1 << 16),
        st.integers(1, 200),
    ),
    min_size=1,
    max_size=3,
)


def number(value):
    return value.to_bytes(4, "little")


def chunk(sizes):
    """Return the data of a chunk with messages of these sizes, and what its index says of them."""
    data = connection_record(0, b"/a", b"") + connection_record(1, b"/b", b"")
    rows = []
    for each, size in enumerate(sizes):
        t_ns, connection = 1_600_000_000_000_000_000 + each, each % 3 // 2
        fields = message_fields(connection, t_ns)
        rows.append((t_ns, connection, len(data)))
        data += number(len(fields)) + fields + number(size) + bytes(1 + (each + at) % 250 for at in range(size))
    return data, rows


def lengths(data, rows):
    """Return where the lengths of messages stand: that of the header, and that of the payload."""
    return [place for row in rows for place in (row[2], record_at(data, row[2], len(data)).data - 4)]


def flipped(data, bit):
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def untouched(data, rows, at):
    """Return the messages that the byte at a place is not of, nor so near behind them that it counts as theirs."""
    spans = [(row, record_at(data, row[2], len(data)).end) for row in rows]
    return [row for row, end in spans if end <= at - NEAR or row[2] > at]


def edited(data, rows, edits):
    places = lengths(data, rows)
    for kind, where, size in edits:
        at = where % (len(data) + 1)
        behind = data[at + size :]
        if kind == "length" and places[where % len(places)] < len(data):
            data = flipped(data, 8 * places[where % len(places)] + size % 10)
        elif kind == "bit" and at < len(data):
            data = flipped(data, 8 * at + size % 8)
        elif kind == "twice":
            data = data[: at + size] + data[at:]
        elif kind in ("zeros", "noise", "cut"):
            noise = bytes((size * each * each + where + each) % 256 for each in range(size))
            data = data[:at] + {"zeros": bytes(size), "noise": noise, "cut": b""}[kind] + behind
    return data


@pytest.mark.parametrize("sizes", [(0,) * 6, (40,) * 8, (10, 90, 0, 3, 30, 60)])
def test_every_wrong_bit_of_a_length_costs_its_message_alone(sizes):
    data, rows = chunk(sizes)
    places = list(lengths(data, rows))
    assert places
    for place in places:
        for bit in range(8 * place, 8 * place + 32):
            with ending():
                kept = salvaged(flipped(data, bit), rows)
            assert set(kept.rows) >= set(untouched(data, rows, bit // 8)), bit - 8 * place
            assert set(kept.rows) <= set(rows)
            assert kept.gaps


@given(sizes=SIZES, where=st.integers(0, 1 << 16), indexed=st.booleans())
def test_a_wrong_bit_anywhere_costs_the_message_that_it_is_of(sizes, where, indexed):
    data, rows = chunk(sizes)
    bit = where % (8 * len(data))
    with ending():
        kept = salvaged(flipped(data, bit), rows if indexed else None)
    if indexed:
        assert set(kept.rows) >= set(untouched(data, rows, bit // 8))
    assert len(set(kept.rows) - set(rows)) <= 1


@settings(max_examples=400)
@given(sizes=SIZES, edits=EDITS, index_edits=st.sampled_from(("right", "none", "shifted", "some")))
def test_whatever_happened_the_search_ends_and_what_is_kept_stands_one_behind_another(sizes, edits, index_edits):
    data, rows = chunk(sizes)
    said = {
        "right": rows,
        "none": None,
        "shifted": [(t_ns, connection, offset + 3) for t_ns, connection, offset in rows],
        "some": rows[::2],
    }[index_edits]
    changed = edited(data, rows, edits)
    with ending():
        kept = salvaged(changed, said)
    ends = [0, *(record_at(changed, row[2], len(changed)).end for row in kept.rows)]
    assert all(end <= row[2] for end, row in zip(ends, kept.rows))
    assert max(ends) <= len(changed)
