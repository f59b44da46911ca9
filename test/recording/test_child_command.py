"""The command line of a recorder, and its files."""

from pathlib import Path

import pytest

from amaze_autonomy.config.schemas.recording import Storage, TopicGroup
from amaze_autonomy.recording.programs import child_command, files_of, last_number

OUTPUT = Path("/rec/s/main/states-01.bag")


def command(group, storage=None):
    return child_command(["record"], "record_main_states", group, group.topics, storage or Storage(), OUTPUT)


def test_settings_come_from_the_storage_where_the_group_has_none():
    assert command(TopicGroup("states", ("/tf", "/a"))) == [
        "record", "--buffsize=256", "--chunksize=768", "--min-space=200M", "--tcpnodelay",
        "--output-name=/rec/s/main/states-01.bag", "/tf", "/a", "__name:=record_main_states",
    ]  # fmt: skip


def test_a_group_has_its_own_settings():
    group = TopicGroup("states", ("/a.b",), ("/cam.*",), "/cam/secret", "lz4", 64, 0)
    assert command(group, Storage(split_mb=500)) == [
        "record", "--buffsize=0", "--chunksize=64", "--min-space=200M", "--tcpnodelay",
        "--output-name=/rec/s/main/states-01.bag", "--lz4", "--split", "--size=500", "--repeat-latched",
        "--exclude=/cam/secret", "--regex", "/a\\.b", "/cam.*", "__name:=record_main_states",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "storage, own, expected",
    [
        (Storage(), {}, 768),
        (Storage(compression="lz4"), {}, 64),
        (Storage(), {"compression": "lz4"}, 64),
        (Storage(compression="lz4"), {"compression": "none"}, 768),
        (Storage(compression="lz4", chunk_kb=256), {}, 256),
        (Storage(chunk_kb=256), {"compression": "lz4", "chunk_kb": 32}, 32),
    ],
)
def test_a_compressed_chunk_is_small_unless_it_is_asked_for_otherwise(storage, own, expected):
    """What is in an open one is not on the disk, and an image in one of its own stays compressed in a merge."""
    assert f"--chunksize={expected}" in command(TopicGroup("states", ("/a",), **own), storage)


def test_the_files_of_a_group_are_those_that_its_recorders_wrote():
    names = ["states-01.bag", "states-02_0.bag", "states-02_1.bag.active"]
    names += ["states-01.recovered.bag", "states.log", "xstates-01.bag", "cameras-01.bag"]
    assert files_of("states", names) == ["states-01.bag", "states-02_0.bag", "states-02_1.bag.active"]


def test_the_last_number_is_that_of_any_file_of_the_group_whoever_made_it():
    names = ["states-01.bag", "states-02_0.bag", "states-02_1.bag.active", "states.log", "cameras-09.bag"]
    assert last_number("states", names) == 2
    assert last_number("states", ["states-04.recovered.bag", "states-03.bag.undo", ".states-05.bag.bad"]) == 5
    assert last_number("states", ["states-100.bag", "states-99.bag"]) == 100
    assert last_number("states", ["xstates-07.bag", "states-x-08.bag", "states.log"]) == 0
