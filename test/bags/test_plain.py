"""Chunks that are not compressed: what lies between large messages that nobody wants is all that is read of them."""

from __future__ import annotations

import os
import struct

import numpy as np
from bag_tools import MS, text
from replay_bags import START_NS, STORE
from rosbags.rosbag1 import Reader, Writer

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags.plain import grouped

IMAGE = 200_000


def camera_bag(path, count=60, chunk_bytes=500_000):
    """Write images, numbers between them, and a topic that begins when a chunk with an image is open already."""
    writer = Writer(path)
    writer.chunk_threshold = chunk_bytes
    with writer:
        number = writer.add_connection("/number", "std_msgs/msg/Float64", typestore=STORE)
        image = writer.add_connection("/image", "std_msgs/msg/String", typestore=STORE)
        for each in range(count):
            t_ns = START_NS + each * 10 * MS
            for place in range(3):
                writer.write(number, t_ns + place, struct.pack("<d", each + place / 8))
            writer.write(image, t_ns + 5, raw("x" * IMAGE))
            if each == count // 2:
                late = writer.add_connection("/late", "std_msgs/msg/String", typestore=STORE)
                writer.write(late, t_ns + 6, raw("described behind an image"))
    return path


def raw(words):
    return STORE.serialize_ros1(text(words), "std_msgs/msg/String")


def read_of(path, monkeypatch, wanted, texts=()):
    """Return columns of a bag, and the sizes of the reads of its file that it takes."""
    sizes, inner = [], os.preadv
    with Recording(path) as recording:
        monkeypatch.setattr(os, "preadv", lambda *given: sizes.append(inner(*given)) or sizes[-1])
        found = recording.numbers(wanted, texts)
        monkeypatch.undo()
        return {topic: numbers.rows() for topic, numbers in found.items()}, sizes


def damaged(path, topic, place, at, value):
    """Write bytes into the record of a message, counted from its beginning."""
    with Recording(path) as recording:
        entry = recording.entries(topic)[place]
    with Reader(path) as reader:
        begin = reader.chunks[entry.chunk].datapos + entry.offset + at
    data = bytearray(path.read_bytes())
    data[begin : begin + len(value)] = value
    path.write_bytes(data)
    return entry.chunk


def test_images_between_are_passed_over(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag")
    rows, sizes = read_of(path, monkeypatch, {"/number": ["data"]})
    assert rows == {"/number": [(each + place / 8,) for each in range(60) for place in range(3)]}
    assert sum(sizes) < 0.2 * path.stat().st_size


def test_an_image_that_is_wanted_is_read(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag", 6)
    rows, sizes = read_of(path, monkeypatch, {"/image": [""]})
    assert [row[0].data for row in rows["/image"]] == ["x" * IMAGE] * 6
    assert sum(sizes) > 6 * IMAGE


def test_a_connection_behind_an_image_is_found(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag")
    rows, sizes = read_of(path, monkeypatch, {"/late": ["data"], "/number": ["data"]}, ["/late"])
    assert [size for size in sizes if size > IMAGE], "its chunk is read as a whole"
    assert rows["/late"] == [("described behind an image",)]
    assert len(rows["/number"]) == 180


def test_only_the_chunk_with_a_damaged_image_has_no_rows(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag")
    broken = {
        damaged(path, "/image", 7, 0, b"\xff\xff\x00\x00"),  # of no length that a header has
        damaged(path, "/number", 100, 0, b"\x00\x00\x00\x00"),
    }
    rows, _ = read_of(path, monkeypatch, {"/number": ["data"]})
    with Recording(path) as recording:
        chunks = [entry.chunk for entry in recording.entries("/number")]
    assert {chunk for chunk, row in zip(chunks, rows["/number"]) if row is None} == broken
    assert {chunk for chunk, row in zip(chunks, rows["/number"]) if row is not None} == {*chunks} - broken


def test_a_file_that_became_shorter_has_rows_of_what_is_left(tmp_path):
    path = camera_bag(tmp_path / "x.bag")
    with Recording(path) as recording:
        entries = recording.entries("/number")
        cut = entries[90].chunk
        os.truncate(path, cut)
        rows = recording.columns({"/number": ["data"]})["/number"]
    assert [row is not None for row in rows] == [entry.chunk < cut for entry in entries]


def test_a_plain_chunk_of_two_sizes_is_none(tmp_path, monkeypatch):
    path = camera_bag(tmp_path / "x.bag", 6)
    with Reader(path) as reader:
        first = sorted(reader.chunks)[0]
    data = bytearray(path.read_bytes())
    at = data.index(b"size=", first) + 5
    data[at : at + 4] = (int.from_bytes(data[at : at + 4], "little") - 1).to_bytes(4, "little")
    path.write_bytes(data)
    rows, _ = read_of(path, monkeypatch, {"/number": ["data"]})
    assert None in rows["/number"]
    assert any(row is not None for row in rows["/number"])


def test_chunks_are_read_some_megabytes_together():
    sizes = np.full(10, 1_500_000).tolist()
    assert list(grouped(list(enumerate(sizes)))) == [[0, 1, 2], [3, 4, 5], [6, 7, 8], [9]]
    assert list(grouped([(3, 9 << 20), (4, 1), (7, 1)])) == [[3], [4, 7]]
    assert list(grouped([])) == []
