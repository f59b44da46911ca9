"""Result files are whole or not there."""

from __future__ import annotations

import pytest

from amaze_autonomy.replay import files
from amaze_autonomy.replay.files import write_whole


def test_a_file_is_written_and_replaced(tmp_path):
    path = tmp_path / "x.json"
    write_whole(path, "one\n")
    write_whole(path, "two\n")
    assert path.read_bytes() == b"two\n"
    assert [each.name for each in tmp_path.iterdir()] == ["x.json"]


def test_a_disk_that_is_full_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "x.json"
    write_whole(path, "old\n")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OSError, match="No space left on device"):
        write_whole(path, "new\n")
    assert path.read_text() == "old\n"


def test_what_cannot_be_written_is_named_as_it_was_asked_for(tmp_path):
    with pytest.raises(FileNotFoundError) as told:
        write_whole(tmp_path / "no" / "report.html", "text")
    assert told.value.filename == str(tmp_path / "no" / "report.html")
