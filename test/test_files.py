"""Files are whole or not there."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from amaze_autonomy import files
from amaze_autonomy.files import is_unused, whole, whole_folder, write_whole


def test_a_file_is_written_and_replaced(tmp_path):
    path = tmp_path / "x.json"
    write_whole(path, "one\n")
    write_whole(path, "two\n")
    assert path.read_bytes() == b"two\n"
    assert [each.name for each in tmp_path.iterdir()] == ["x.json"]


def test_a_stream_takes_what_is_written_and_stays_one(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(pipe, "text\n")
        assert os.read(reader, 100) == b"text\n"
    finally:
        os.close(reader)
    assert pipe.is_fifo()
    write_whole(Path(os.devnull), "text\n")
    assert Path(os.devnull).is_char_device()


def test_a_disk_that_is_full_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "x.json"
    write_whole(path, "old\n")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OSError, match="No space left on device"):
        write_whole(path, "new\n")
    assert path.read_text() == "old\n"
    assert [each.name for each in tmp_path.iterdir()] == ["x.json"]


def test_pieces_of_bytes_are_put_on_the_disk_with_their_name(tmp_path, monkeypatch):
    synced, fsync = [], files.os.fsync
    monkeypatch.setattr(
        files.os, "fsync", lambda file: synced.append(os.readlink(f"/proc/self/fd/{file}")) or fsync(file)
    )
    write_whole(tmp_path / "x", [b"one", b"", b"two"])
    assert (tmp_path / "x").read_bytes() == b"onetwo"
    assert synced == [str(tmp_path / ".x.part"), str(tmp_path)]


def test_a_file_system_that_cannot_put_names_on_the_disk_is_no_error(tmp_path, monkeypatch):
    fsync = files.os.fsync

    def picky(file):
        if Path(f"/proc/self/fd/{file}").is_dir():
            raise OSError(errno.EINVAL, "Invalid argument")
        fsync(file)

    monkeypatch.setattr(files.os, "fsync", picky)
    write_whole(tmp_path / "x", "text")
    assert (tmp_path / "x").read_text() == "text"


def test_what_cannot_be_written_is_named_as_it_was_asked_for(tmp_path):
    with pytest.raises(FileNotFoundError) as told:
        write_whole(tmp_path / "no" / "report.html", "text")
    assert told.value.filename == str(tmp_path / "no" / "report.html")
    with pytest.raises(FileNotFoundError) as told, whole(tmp_path / "no" / "x.mcap"):
        pass
    assert told.value.filename == str(tmp_path / "no" / "x.mcap")
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError) as told, whole_folder(tmp_path / "file" / "config"):
        pass
    assert told.value.filename == str(tmp_path / "file" / "config")


@pytest.mark.parametrize("make", [whole, whole_folder])
def test_an_error_of_what_is_read_meanwhile_keeps_its_name(tmp_path, make):
    with pytest.raises(FileNotFoundError) as told, make(tmp_path / "x"):
        (tmp_path / "flight.bag").read_bytes()
    assert told.value.filename == str(tmp_path / "flight.bag")
    with pytest.raises(OSError, match="Input/output error") as broken, make(tmp_path / "x"):
        raise OSError(errno.EIO, "Input/output error")
    assert broken.value.filename is None
    assert list(tmp_path.iterdir()) == []


def test_a_folder_is_made_where_nothing_is_or_in_an_empty_one(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for path in (Path(), tmp_path / "no" / "new"):
        assert is_unused(path)
        with whole_folder(path) as part:
            (part / "deep").mkdir()
            (part / "deep" / "x").write_text("text")
        assert [str(each.relative_to(path)) for each in sorted(path.rglob("*"))] == ["deep", "deep/x"]
        assert not is_unused(path)
    assert [each.name for each in (tmp_path / "no").iterdir()] == ["new"]
    assert (tmp_path / "here" / "deep" / "x").read_text() == "text"


@pytest.mark.usefixtures("umask_of_nodes")
@pytest.mark.parametrize("others", [0o666, 0o644], ids=oct)
@pytest.mark.parametrize("name", ["x", ".x.part"], ids=["replaced", "left by a killed process"])
def test_its_mode_is_that_of_a_new_file(tmp_path, name, others):
    (tmp_path / name).write_text("old")
    (tmp_path / name).chmod(others)
    write_whole(tmp_path / "x", "new")
    assert (oct((tmp_path / "x").stat().st_mode & 0o777), (tmp_path / "x").read_text()) == ("0o640", "new")
