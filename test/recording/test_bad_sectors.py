"""A disk that does not give some bytes of one file any more: that file is a loss that is told, and hinders no other."""

import errno
import os
from pathlib import Path

import pytest
from bag_tools import multiset, rows
from part_tools import FACTS, part, plan, two_platforms

from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.recording.errors import TransferError
from amaze_autonomy.recording.job import collect, run
from amaze_autonomy.recording.parts import check_arrived, close_parts
from amaze_autonomy.recording.storage import joined, read_parts

PLACES = (2, 4109, 9000, -900)  # in the header, in the first chunk, in a later one, in the index


@pytest.fixture
def bad_sector(monkeypatch):
    """Let the bytes of a file around a place be unreadable from now on."""
    bad = {}

    def refuse(file, place, size):
        begin, why = bad.get(os.fstat(file).st_ino, (None, 0))
        if begin is not None and place < begin + 512 and place + size > begin:
            raise OSError(why, os.strerror(why))

    pread, preadv, opened = os.pread, os.preadv, Path.open

    def pread_(file, size, place):
        refuse(file, place, size)
        return pread(file, size, place)

    def preadv_(file, buffers, place):
        refuse(file, place, sum(len(each) for each in buffers))
        return preadv(file, buffers, place)

    def open_(path, *arguments, **options):
        file = opened(path, *arguments, **options)
        try:
            refuse(file.fileno(), 0, os.fstat(file.fileno()).st_size)
        except OSError:
            file.close()
            raise
        return file

    monkeypatch.setattr(os, "pread", pread_)
    monkeypatch.setattr(os, "preadv", preadv_)
    monkeypatch.setattr(Path, "open", open_)

    def spoil(path, place, why=errno.EIO):
        size = path.stat().st_size
        bad[path.stat().st_ino] = place % size // 512 * 512, why

    return spoil


@pytest.fixture
def session(tmp_path):
    """Return a session of two platforms; main has two files."""
    session = two_platforms(tmp_path)
    part(session / "main", ("states-02.bag", [rows("/a", 20, first_ms=9000)]))
    return session


def listed_anew(folder):
    return close_parts(folder, {**FACTS, "anew": True})


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("first", [True, False])
def test_a_file_with_a_bad_sector_is_a_loss_and_all_others_are_merged(session, bad_sector, place, first):
    lost = session / "main" / "states-01.bag"
    bad_sector(lost, place)
    content = close_parts(session / "main", FACTS) if first else listed_anew(session / "main")
    assert [each.get("unreadable", False) for each in content["files"]] == [True, False]
    assert content["files"][0]["problem"].startswith(f"{lost}: cannot be read (Input/output error); copy it with")
    assert listed_anew(session / "main") == content
    summary = collect(plan(session))
    assert summary.messages == 320
    assert summary.lost_in_flight == ("main/states-01.bag: nothing of it can be read",)
    rest = session / "main" / "states-02.bag", session / "second" / "realsense-01.bag"
    assert multiset(session / "s1_m.bag") == multiset(*rest)
    assert lost.exists()


def test_of_one_that_may_not_be_read_nobody_is_told_to_copy_a_disk(session, bad_sector):
    """Whose recorder ran as another user; as root every file may be read."""
    path = session / "main" / "states-01.bag"
    bad_sector(path, 0, errno.EACCES)
    entry = close_parts(session / "main", FACTS)["files"][0]
    assert (entry["unreadable"], entry["problem"]) == (
        True, f"{path}: cannot be read (Permission denied); mend that and retry",
    )  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
def test_it_replaces_no_verified_recording_that_has_it(session, bad_sector, place):
    before = collect(plan(session))
    bad_sector(session / "main" / "states-01.bag", place)
    listed_anew(session / "main")
    summary = collect(plan(session))
    assert (before.messages, summary.messages, summary.beside) == (920, 320, ("s1_m.bag",))


@pytest.mark.parametrize("place", PLACES)
def test_what_goes_bad_after_it_was_listed_is_named_and_a_retry_goes_on_without_it(session, bad_sector, place):
    lost = session / "main" / "states-01.bag"
    bad_sector(lost, place)
    with pytest.raises(BagError, match=f"^{lost}: .*"):
        collect(plan(session))
    listed_anew(session / "main")
    assert collect(plan(session)).messages == 320


def test_a_copy_without_the_bad_sector_in_its_place_is_taken_again(session, bad_sector, tmp_path):
    path = session / "main" / "states-01.bag"
    whole = path.read_bytes()
    bad_sector(path, 9000)
    listed_anew(session / "main")
    collect(plan(session))
    copied = tmp_path / "copied.bag"
    copied.write_bytes(whole)
    path.rename(tmp_path / "bad.bag")  # it keeps its inode, by which it is known here
    copied.rename(path)
    listed_anew(session / "main")
    summary = collect(plan(session))
    assert summary.messages == 920


def test_one_that_is_unreadable_where_it_was_recorded_is_not_waited_for(session, bad_sector):
    there = session / "second"
    came = read_parts(there)
    bad_sector(there / "realsense-01.bag", 9000)
    sent = listed_anew(there)
    assert check_arrived(there) == sent
    content, kept = joined(there, sent)
    assert (content["files"][0].get("unreadable"), kept) == (True, frozenset())
    assert sent["files"][0]["changed"] == came["files"][0]["sha256"]


def test_a_copy_that_came_whole_is_used_when_its_original_has_a_bad_sector(session, tmp_path, bad_sector):
    there = part(tmp_path / "disk", ("realsense-01.bag", [rows("/c", 300, 11)]), platform="second")
    here = session / "second"
    (here / "parts.json").write_bytes((there / "parts.json").read_bytes())
    (here / "realsense-01.bag").write_bytes((there / "realsense-01.bag").read_bytes())
    bad_sector(there / "realsense-01.bag", 9000)
    _, kept = joined(here, listed_anew(there))
    assert kept == {"realsense-01.bag"}


def test_a_copy_with_a_bad_sector_here_is_put_aside_and_fetched_again(session, bad_sector):
    bad_sector(session / "second" / "realsense-01.bag", 9000)
    with pytest.raises(TransferError, match="is not what was sent, and was put aside; retry"):
        check_arrived(session / "second")
    with pytest.raises(TransferError, match="did not arrive"):
        check_arrived(session / "second")


def test_a_job_says_which_file_it_is(session, bad_sector):
    lost = session / "main" / "states-01.bag"
    request = {
        "do": "collect", "output": str(session / "s1_m.bag"), "duplicates": "count", "facts": {},
        "sources": [{"platform": "main", "folder": str(session / "main")}],
    }  # fmt: skip
    bad_sector(lost, 9000)
    result = run(request, lambda _line: None)
    assert result["problem"].startswith(f"{lost}: cannot be read")


@pytest.mark.parametrize("place", PLACES)
def test_merge_and_info_name_the_file_and_leave_nothing_behind(session, bad_sector, place, tmp_path, capsys):
    path = session / "main" / "states-01.bag"
    bad_sector(path, place)
    other = session / "second" / "realsense-01.bag"
    assert main(["merge", str(path), str(other), "-o", str(tmp_path / "out.bag")]) != 0
    said = capsys.readouterr().err
    assert str(path) in said
    assert "cannot be read" in said
    assert not list(tmp_path.glob("*out*"))
