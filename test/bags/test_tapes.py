"""Tapes give what the bag gives, are found by its content alone, and are never believed when they are damaged."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
from replay_bags import flight_rows, write_bag
from replay_runs import ROOT, replay

from amaze_autonomy.bags import Recording
from amaze_autonomy.bags import recording as recording_module
from amaze_autonomy.bags.tapes import Tapes

WANTED = {"/imu": ["linear_acceleration.z", "angular_velocity.x"], "/range": ["range"]}


@pytest.fixture
def tapes(tmp_path, monkeypatch):
    folder = tmp_path / "tapes"
    monkeypatch.setenv("AMAZE_TAPES", str(folder))
    return folder


@pytest.fixture
def reads(monkeypatch):
    """Count how often data of bags is read: columns, and chunks for single messages."""
    counted = []
    inner = recording_module.read_columns
    monkeypatch.setattr(recording_module, "read_columns", lambda *each: counted.append("columns") or inner(*each))
    return counted


def taken(path):
    with Recording(path) as recording:
        recording.keep(["/battery", "/armed"])
        chunks = recording._chunks._load
        recording._chunks._load = (
            lambda position: pytest.fail("a chunk was read") if recording._kept else chunks(position)
        )
        found = recording.columns(WANTED)
        messages = [recording.message(entry) for entry in recording.entries("/battery")]
    return found, [each.percentage for each in messages]


def files(folder):
    return sorted(path for path in folder.rglob("*.npz"))


def test_the_second_time_nothing_of_the_bag_is_read(tmp_path, tapes, reads):
    path = write_bag(tmp_path / "x.bag", flight_rows(9.0), "bz2")
    first = taken(path)
    assert reads == ["columns"]
    assert taken(path) == first
    assert reads == ["columns"]
    assert len(files(tapes)) == 2


def test_without_a_folder_there_are_none(tmp_path, reads, monkeypatch):
    monkeypatch.delenv("AMAZE_TAPES", raising=False)
    path = write_bag(tmp_path / "x.bag", flight_rows(3.0))
    with Recording(path) as recording:
        recording.keep(["/battery"])
        assert recording._kept == {}
        assert recording.columns(WANTED) == recording.columns(WANTED)
    assert reads == ["columns", "columns"]


def test_they_are_found_by_content_not_by_name(tmp_path, tapes, reads):
    path = write_bag(tmp_path / "x.bag", flight_rows(3.0))
    first = taken(path)
    shutil.copy(path, tmp_path / "y.bag")
    assert taken(tmp_path / "y.bag") == first
    assert reads == ["columns"]
    write_bag(tmp_path / "z.bag", flight_rows(3.0, tilt_deg=9.0))
    (tmp_path / "z.bag").replace(path)
    assert taken(path) != first
    assert reads == ["columns", "columns"]
    assert len(files(tapes)) == 4


def test_a_bag_that_is_written_again_in_place_is_another_one(tmp_path, tapes):
    path = write_bag(tmp_path / "x.bag", flight_rows(3.0))
    first = taken(path)
    other = write_bag(tmp_path / "y.bag", flight_rows(3.0, tilt_deg=9.0)).read_bytes()
    assert len(other) == path.stat().st_size
    path.write_bytes(other)
    assert taken(path) != first
    assert len(files(tapes)) == 4


@pytest.mark.parametrize("damage", ["cut", "flip", "empty", "other"])
def test_damaged_ones_are_taken_again(tmp_path, tapes, reads, damage):
    path = write_bag(tmp_path / "x.bag", flight_rows(3.0))
    first = taken(path)
    for tape in files(tapes):
        data = bytearray(tape.read_bytes())
        data[len(data) // 2] ^= 0x10
        changed = {"cut": data[: len(data) // 2], "flip": data, "empty": b"", "other": b"no tape at all" * 9}
        tape.write_bytes(changed[damage])
    assert taken(path) == first
    assert reads == ["columns", "columns"]
    assert taken(path) == first
    assert reads == ["columns", "columns"]


WHAT = {0: ["linear_acceleration.z"]}


def taped(tmp_path, folder, count):
    """Keep columns of so many messages; return the tapes, the file, and the columns."""
    own = Tapes(folder, write_bag(tmp_path / "x.bag", flight_rows(3.0)))
    columns = {0: (np.arange(count), [np.linspace(0.0, 1.0, count)])}
    own.keep_columns(WHAT, columns)
    (tape,) = files(folder)
    return own, tape, columns


def test_one_wrong_byte_anywhere_gives_nothing_else(tmp_path, tapes):
    own, tape, columns = taped(tmp_path, tapes, 150)
    assert plain(own.columns(WHAT)) == plain(columns)
    whole = tape.read_bytes()
    heads = [whole.index(b"PK\x01\x02"), *(each.start() for each in re.finditer(rb"PK\x03\x04", whole))]
    places = {*range(0, len(whole), 7), *(head + n for head in heads for n in range(200) if head + n < len(whole))}
    for place in sorted(places):
        tape.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1 :])
        found = own.columns(WHAT)  # what is no content, e.g. a date of zip, may be another one
        assert found is None or plain(found) == plain(columns), place


def test_a_shorter_shape_in_the_head_of_an_array_gives_nothing(tmp_path, tapes):
    """The array is larger than what zip reads at least, so that its end is read only by who asks for it."""
    own, tape, columns = taped(tmp_path, tapes, 3000)
    assert plain(own.columns(WHAT)) == plain(columns)
    whole = tape.read_bytes()
    assert whole.count(b"'shape': (3000,)") == 2
    tape.write_bytes(whole.replace(b"'shape': (3000,)", b"'shape': (  50,)"))
    assert own.columns(WHAT) is None


def plain(columns):
    return {number: (rows.tolist(), [each.tolist() for each in values]) for number, (rows, values) in columns.items()}


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("AMAZE_TAPES", str(tmp_path / "file"))
    path = write_bag(tmp_path / "x.bag", flight_rows(3.0))
    with Recording(path) as recording:
        recording.keep(["/battery"])
        assert len(recording.columns(WANTED)["/imu"]) == 150


def test_a_replay_by_tapes_is_the_same(tmp_path, tapes, reads, monkeypatch):
    path = write_bag(tmp_path / "x.bag", flight_rows(), "lz4")
    topic_map = str(ROOT / "test" / "replay" / "flight.yaml")
    with_tape = [replay(path, topic_map)[0] for _ in range(2)]
    assert reads == ["columns"]
    assert len(files(tapes)) == 1
    monkeypatch.delenv("AMAZE_TAPES")
    assert with_tape == [replay(path, topic_map)[0]] * 2
