"""The journal on disk: whole, in order, and without a gap even when the disk was full for a while."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
from unittest.mock import Mock

import pytest

pytest.importorskip("rospy")

from amaze_autonomy.engine.events import WatchdogAction
from amaze_autonomy.engine.rules import Code
from amaze_autonomy.journal.journal import DeltaEncoder, read
from amaze_autonomy.nodes.autonomy import journal_file
from amaze_autonomy.nodes.autonomy.journal_file import create, go_on, open_locked
from amaze_autonomy.nodes.autonomy.run_folder import Place
from amaze_autonomy.ros.errors import StartError

HEADER = '{"kind":"header"}'


@pytest.fixture
def journal(tmp_path):
    made = create(tmp_path, HEADER, Place().elsewhere)
    yield made
    made.close()


def lines(folder):
    return (folder / "journal.jsonl").read_text().split("\n")


@pytest.mark.usefixtures("umask_of_nodes")
@pytest.mark.parametrize("umask", [0o000, 0o022, 0o027], ids=oct)
def test_it_is_for_user_and_group_also_where_it_goes_on_elsewhere(tmp_path, umask):
    """Whoever has it made, and whatever an earlier process left where it is made."""
    os.umask(umask)
    half = tmp_path / ".journal.jsonl.new"
    half.write_text("left")
    half.chmod(0o666 & ~umask)
    journal = create(tmp_path, HEADER, lambda: [tmp_path / "elsewhere"])
    (tmp_path / "elsewhere").mkdir()
    journal.path.rename(tmp_path / "moved")
    assert journal.follow()
    journal.close()
    found = [tmp_path / "moved", journal.path]
    assert [oct(path.stat().st_mode & 0o777) for path in found] == ["0o640", "0o640"]


@pytest.mark.usefixtures("journal")
def test_it_appears_with_its_header(tmp_path):
    assert lines(tmp_path) == [HEADER, ""]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["journal.jsonl"]


def test_lines_are_numbered_from_the_header_on(tmp_path, journal):
    assert [journal.append(text) for text in ("a", "b")] == [1, 2]
    journal.flush()
    assert lines(tmp_path) == [HEADER, "a", "b", ""]


def test_it_goes_on_after_the_last_whole_line(tmp_path, journal):
    journal.append("a")
    journal.close()
    with (tmp_path / "journal.jsonl").open("a") as file:
        file.write('{"half')
    again = go_on(journal.path, open_locked(journal.path), Place().elsewhere)
    assert again.append("b") == 2
    again.close()
    assert lines(tmp_path) == [HEADER, "a", "b", ""]
    journal._descriptor = os.dup(1)


@pytest.mark.usefixtures("journal")
def test_two_nodes_do_not_write_one_journal(tmp_path):
    program = "import sys; from pathlib import Path; from amaze_autonomy.nodes.autonomy import journal_file as j\n"
    program += "j._lock.__defaults__ = (0.1,)\n"
    program += "from amaze_autonomy.ros.errors import StartError\n"
    program += "try: j.open_locked(Path(sys.argv[1]))\nexcept StartError as error: print(error)\n"
    command = [sys.executable, "-c", program, str(tmp_path / "journal.jsonl")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert "is written by another node" in done.stdout


def test_a_folder_that_cannot_be_written_is_one_clear_error(tmp_path):
    with pytest.raises(StartError, match="name another folder with --output"):
        create(tmp_path / "missing", HEADER, Place().elsewhere)


class FullDisk:
    """Takes so many bytes more, then none: as write() does it, a part of the last ones may still be written."""

    def __init__(self, monkeypatch, free):
        self.free = free
        self._write = os.write
        monkeypatch.setattr(journal_file.os, "write", self.write)

    def write(self, descriptor, data):
        if self.free <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = self._write(descriptor, data[: self.free])
        self.free -= taken
        return taken


def test_a_full_disk_costs_no_line(tmp_path, journal, monkeypatch):
    disk = FullDisk(monkeypatch, 10)
    journal.append("a" * 8)
    journal.flush()
    journal.append("b" * 8)
    journal.flush()
    assert "No space left" in journal.problem
    assert lines(tmp_path) == [HEADER, "a" * 8, ""], "half a line was left in the file"
    journal.append("c")
    journal.flush()
    disk.free = 1000
    journal.flush(force=True)
    assert (journal.problem, journal.gap) == ("", False)
    assert lines(tmp_path) == [HEADER, "a" * 8, "b" * 8, "c", ""]


class AlmostFullDisk(FullDisk):
    """Takes so many bytes more in pieces of a few, then says that it is full."""

    def write(self, descriptor, data):
        return super().write(descriptor, data[:3])


def test_a_disk_that_takes_a_line_in_many_pieces_has_it_whole(tmp_path, journal, monkeypatch):
    AlmostFullDisk(monkeypatch, 1000)
    journal.append("a" * 20)
    journal.flush()
    journal.append("b")
    journal.flush()
    assert (journal.problem, lines(tmp_path)) == ("", [HEADER, "a" * 20, "b", ""])


def test_a_disk_that_is_full_within_a_line_leaves_no_half_one_before_the_next(tmp_path, journal, monkeypatch):
    disk = AlmostFullDisk(monkeypatch, 7)
    journal.append("a" * 20)
    journal.flush()
    assert "No space left" in journal.problem
    assert lines(tmp_path) == [HEADER, ""]
    disk.free = 1000
    journal.append("b")
    journal.flush(force=True)
    assert (journal.problem, lines(tmp_path)) == ("", [HEADER, "a" * 20, "b", ""])


def test_a_disk_that_takes_nothing_and_says_nothing_is_full(tmp_path, journal, monkeypatch):
    monkeypatch.setattr(journal_file.os, "write", lambda *_: 0)
    journal.append("a")
    journal.flush()
    assert "No space left" in journal.problem
    assert lines(tmp_path) == [HEADER, ""]


def test_a_half_line_that_cannot_be_taken_back_is_before_the_next_is_written(tmp_path, journal, monkeypatch):
    disk = FullDisk(monkeypatch, 7)
    journal.append("a" * 20)
    with monkeypatch.context() as patched:
        patched.setattr(journal_file.os, "ftruncate", Mock(side_effect=OSError(errno.EIO, "Input/output error")))
        journal.flush()
        assert "Input/output error" in journal.problem
        disk.free = 1000
        journal.flush(force=True)
        assert "Input/output error" in journal.problem, "behind half a line nothing is written"
    assert lines(tmp_path) == [HEADER, "a" * 7]
    journal._kept, journal._kept_bytes = [b"b\n"], 2  # as where so much was kept that it had to go
    journal.flush(force=True)
    assert (journal.problem, lines(tmp_path)) == ("", [HEADER, "b", ""])


def test_half_a_line_is_not_taken_along_to_another_place(tmp_path, monkeypatch):
    for name in ("run", "other"):
        (tmp_path / name).mkdir()
    journal = create(tmp_path / "run", HEADER, lambda: [tmp_path / "other"])
    disk = FullDisk(monkeypatch, 7)
    journal.append("a" * 20)
    with monkeypatch.context() as patched:
        patched.setattr(journal_file.os, "ftruncate", Mock(side_effect=OSError(errno.EIO, "Input/output error")))
        journal.flush()
        disk.free = 1000
        shutil.rmtree(tmp_path / "run")
        assert journal.follow()
        journal.flush(force=True)
    journal.close()
    assert lines(tmp_path / "other") == [HEADER, "a" * 20, ""]


def test_a_header_that_does_not_fit_on_the_disk_is_one_clear_error(tmp_path, monkeypatch):
    FullDisk(monkeypatch, 5)
    with pytest.raises(StartError, match="No space left on device; name another folder with --output"):
        create(tmp_path, HEADER, Place().elsewhere)
    assert not (tmp_path / "journal.jsonl").exists()


def test_it_does_not_try_a_full_disk_at_every_line(tmp_path, journal, monkeypatch):
    disk = FullDisk(monkeypatch, 0)
    journal.append("a")
    journal.flush()
    disk.free = 1000
    journal.append("b")
    journal.flush()
    assert lines(tmp_path) == [HEADER, ""]
    journal._retry_s = 0.0
    journal.flush()
    assert lines(tmp_path) == [HEADER, "a", "b", ""]


def test_what_is_kept_for_a_disk_has_a_limit_and_what_is_behind_the_gap_can_be_read(tmp_path, monkeypatch):
    journal, encoder = create(tmp_path, '{"kind":"header","version":1}', Place().elsewhere), DeltaEncoder()
    disk = FullDisk(monkeypatch, 0)
    monkeypatch.setattr(journal_file, "_MOST_KEPT", 1000)
    heartbeats = [WatchdogAction(t_ns=n, sequence=n, loop_counter=n, code=Code.NOMINAL) for n in range(100, 150)]
    given_up = 0
    for number, event in enumerate(heartbeats):
        if journal.append(encoder.encode(event)) is None:
            encoder.forget()
            given_up = number
        journal.flush()
        assert journal._kept_bytes <= 1000
    assert journal.gap
    disk.free = 10_000
    journal.close()
    found = read((tmp_path / "journal.jsonl").read_text())
    assert [line.payload for line in found.lines[1:]] == heartbeats[given_up + 1 :]
    assert 0 < given_up < 49


def removed(folder):
    shutil.rmtree(folder)


def moved(folder):
    folder.rename(folder.with_name("moved"))


def replaced(folder):
    (folder / "journal.jsonl").unlink()
    (folder / "journal.jsonl").write_text("another file")


@pytest.mark.parametrize("happens", [removed, moved, replaced])
def test_a_journal_that_is_removed_goes_on_elsewhere_and_is_whole(tmp_path, happens):
    (tmp_path / "run").mkdir()
    for place in ("full", "other"):
        (tmp_path / place).mkdir()
    (tmp_path / "full" / "journal.jsonl").write_text("of another run")
    journal = create(tmp_path / "run", HEADER, lambda: [tmp_path / "full", tmp_path / "other"])
    journal.append("a" * 3_000_000)
    journal.flush()
    assert (journal.follow(), journal.remark) == (False, ""), "it is there"
    happens(tmp_path / "run")
    journal.append("b")
    assert journal.follow()
    journal.flush()
    assert (journal.path, journal.problem) == (tmp_path / "other" / "journal.jsonl", "")
    assert lines(tmp_path / "other") == [HEADER, "a" * 3_000_000, "b", ""]
    assert (tmp_path / "full" / "journal.jsonl").read_text() == "of another run"
    assert not journal.follow(), "once"
    assert journal.remark == (
        f"The journal was removed: {tmp_path}/run/journal.jsonl. It goes on at {tmp_path}/other/journal.jsonl, whole."
    )
    with pytest.raises(StartError, match="written by another node"):
        journal_file._lock(os.open(journal.path, os.O_RDWR), journal.path, 0.1)
    journal.close()


def test_a_journal_that_has_no_other_place_says_so_and_writes_on(tmp_path):
    (tmp_path / "run").mkdir()

    def nowhere():
        yield tmp_path / "run" / "not there"
        raise StartError("cannot make the output folder")

    journal = create(tmp_path / "run", HEADER, nowhere)
    shutil.rmtree(tmp_path / "run")
    assert not journal.follow()
    assert journal.problem == (
        f"{tmp_path}/run/journal.jsonl was removed, and there is no other place (cannot make the output folder)"
    )
    journal.append("a")
    journal.close()
