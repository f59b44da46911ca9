"""Whole messages are the rosbags library's, bit for bit; what it would refuse is refused as well."""

from __future__ import annotations

import dataclasses
import math
import struct

import numpy as np
import pytest
from bag_tools import DATA
from hypothesis import given, settings
from hypothesis import strategies as st
from replay_bags import break_chunk, flight_rows, rewrite, write_bag
from replay_demo import demo_bag, simulated
from rosbags.rosbag1 import Reader
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from test_columns import shortened, strange_bag

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.columns import WHOLE
from amaze_autonomy.bags.definitions import reader_of
from amaze_autonomy.bags.errors import MessageError

NUMBERS = ["bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"]
NUMBERS += ["float32", "float64"]
REFUSED = (ValueError, struct.error)


def plain(value):
    """Return a value so that equal is the same bits and types; messages by their fields, without constants."""
    if isinstance(value, np.ndarray):
        return (str(value.dtype), value.tobytes())
    if isinstance(value, list):
        return [plain(each) for each in value]
    if isinstance(value, float):
        return struct.pack("<d", value)
    if hasattr(value, "__msgtype__"):
        names = [each.name for each in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else vars(value)
        fields = {name: plain(getattr(value, name)) for name in names if name != "__msgtype__" and not name.isupper()}
        return (value.__msgtype__, fields)
    return (type(value), value)


def library(definition, kind):
    store = get_typestore(Stores.EMPTY)
    name = kind.replace("/", "/msg/")
    store.register(get_types_from_msg(definition, name))
    return store, name


def said(read, raw):
    try:
        return plain(read(raw))
    except (ValueError, struct.error, SerdeError, AssertionError):  # the last one is of 0.9
        return None


def compared(path):
    """Compare every message of a bag with the library's; return how many of how many types."""
    kinds, messages, readers = set(), 0, {}
    with Reader(path) as bag:
        for each in bag.connections:
            definition = getattr(each.msgdef, "data", each.msgdef)
            kind = each.msgtype.replace("/msg/", "/")
            readers[each.id] = (*library(definition, kind), reader_of(definition, kind))
        for connection, _, raw in bag.messages():
            store, name, read = readers[connection.id]
            assert plain(read(bytes(raw))) == plain(store.deserialize_ros1(bytes(raw), name)), (name, raw)
            messages += 1
            kinds.add(name)
    return messages, len(kinds)


def test_every_message_of_a_flight_is_the_librarys(tmp_path):
    assert compared(write_bag(tmp_path / "x.bag", flight_rows(2.0), "none")) == (204, 6)


def test_every_message_of_a_recording_of_this_package_is_the_librarys(tmp_path):
    messages, kinds = compared(demo_bag(tmp_path / "x.bag", simulated()))
    assert messages > 1000
    assert kinds > 5


def test_texts_arrays_and_messages_within_are_the_librarys(tmp_path):
    assert compared(strange_bag(tmp_path / "x.bag")) == (200, 1)


@pytest.mark.slow_rows
@pytest.mark.parametrize("path", sorted(DATA.glob("*.bag")) or [None], ids=lambda path: getattr(path, "stem", "none"))
def test_every_message_of_a_real_recording_is_the_librarys(path, tmp_path):
    if path is None:
        pytest.skip(f"no recordings in {DATA}: set AMAZE_DATA to their folder")
    messages, _ = compared(shortened(path, tmp_path / "part.bag", 60))
    assert (messages == 0) == (path.stem == "no_messages")


@st.composite
def definitions(draw):
    """Draw a type with texts, times, arrays and messages within, two deep."""
    elements = [*NUMBERS, "string", "time", "duration"]

    def fields(more):
        kinds = draw(st.lists(st.sampled_from(elements + more), min_size=1, max_size=5))
        arrays = [draw(st.sampled_from(["", "", "[]", "[1]", "[3]"])) for _ in kinds]
        return "\n".join(f"{kind}{array} f{number}" for number, (kind, array) in enumerate(zip(kinds, arrays)))

    line = "=" * 80
    inner, middle, outer = fields([]), fields(["Inner", "odd/Inner"]), fields(["Middle", "Inner", "odd/Middle"])
    return f"{outer}\n{line}\nMSG: odd/Middle\n{middle}\n{line}\nMSG: odd/Inner\n{inner}"


@settings(max_examples=80, deadline=None)
@given(definitions(), st.data())
def test_any_bytes_of_any_type_are_taken_as_the_library_takes_them(definition, data):
    store, name = library(definition, "odd/Outer")
    read = reader_of(definition, "odd/Outer")
    for _ in range(6):
        raw = data.draw(payloads())
        theirs = said(lambda raw: store.deserialize_ros1(raw, name), raw)
        assert said(read, raw) in (None, theirs), (definition, raw)
        raw = filled(read, raw)
        if raw is not None:
            theirs = plain(store.deserialize_ros1(raw, name))
            assert plain(read(raw)) == theirs, (definition, raw)


def payloads():
    counts = st.sampled_from([0, 1, 2, 3]).map(lambda count: struct.pack("<I", count))
    floats = st.sampled_from([math.nan, -0.0, math.inf, 1e-310]).map(lambda value: struct.pack("<d", value))
    return st.lists(st.one_of(counts, counts, floats, st.binary(max_size=5)), max_size=30).map(b"".join)


def filled(read, raw):
    """Return these bytes, and zeros behind them, as long as the message that begins with them; None without any."""
    raw = raw.ljust(4096, b"\0")
    try:
        read(raw)
    except REFUSED as error:
        words = str(error).split()
        return raw[: int(words[-1])] if words[0] == "it" else None
    return raw


@pytest.mark.parametrize("number", range(0, 60, 7))
def test_what_is_cut_is_refused(tmp_path, number):
    path = strange_bag(tmp_path / "x.bag", 1)
    with Recording(path) as recording:
        (entry,) = recording.entries("/odd")
        raw = recording._chunks.message(entry.chunk, entry.offset)
        read = reader_of(recording._links[entry.connection].definition, "odd/Strange")
    with pytest.raises(REFUSED):
        read(raw[: len(raw) - 1 - number])
    with pytest.raises(ValueError, match=rf"it has {len(raw) + 1} bytes and should have {len(raw)}"):
        read(raw + b"\0")


@pytest.mark.parametrize(
    "definition",
    [
        "Nothing[] many\n" + "=" * 80 + "\nMSG: x/Nothing\n",
        "Inner[] many\n" + "=" * 80 + "\nMSG: x/Inner\nuint8[0] none",
        "T[] itself",
        "Other[] many\n" + "=" * 80 + "\nMSG: x/Other\nT[] again",
        "Unknown one",
        "uint8 if",
        "uint8 one\nuint8 one",
        "time[5000] many",
        "no field",
        "",
    ],
    ids=["nothing", "no bytes", "itself", "each other", "unknown", "keyword", "twice", "many", "no type", "empty"],
)
def test_a_type_that_is_not_understood_is_left_to_the_library(definition):
    assert reader_of(definition, "x/T") is None


def test_a_type_that_doubles_in_every_line_is_left_to_the_library():
    parts = [f"{'=' * 80}\nMSG: x/T{each}\nT{each + 1} a\nT{each + 1} b" for each in range(40)]
    assert reader_of("\n".join(["T0 first", *parts, f"{'=' * 80}\nMSG: x/T40\nuint8 a"]), "x/T") is None


def test_many_types_each_with_two_arrays_of_the_next_are_no_trouble():
    parts = [f"{'=' * 80}\nMSG: x/T{each}\nT{each + 1}[] a\nT{each + 1}[] b" for each in range(40)]
    read = reader_of("\n".join(["T0 first", *parts, f"{'=' * 80}\nMSG: x/T40\nuint8 a"]), "x/T")
    assert vars(read(bytes(8)).first) == {"a": [], "b": []}


@pytest.mark.parametrize("compression", ["none", "lz4", "bz2"])
def test_a_bag_gives_messages_as_a_whole_in_the_order_of_its_entries(tmp_path, compression):
    path = rewrite(strange_bag(tmp_path / "plain.bag"), tmp_path / "x.bag", compression)
    with Recording(path) as recording:
        rows = recording.numbers({"/odd": WHOLE}, ["/odd"])["/odd"].rows()
        assert recording._decoders == {}, "the library was asked"
        entries = recording.entries("/odd")
        assert [plain(row[0]) for row in rows] == [plain(recording.message(entry)) for entry in entries]


def test_messages_of_a_damaged_chunk_are_none_and_message_says_why(tmp_path):
    path = rewrite(strange_bag(tmp_path / "plain.bag"), tmp_path / "x.bag", "bz2")
    break_chunk(path, 0, 40, 20)
    with Recording(path) as recording:
        rows = recording.numbers({"/odd": WHOLE}, ["/odd"])["/odd"].rows()
        entries = recording.entries("/odd")
        assert rows == [None] * len(entries)
        with pytest.raises(MessageError, match="is damaged"):
            recording.message(entries[0])
