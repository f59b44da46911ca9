"""Recovering in place: the same bag as a recovery that copies, and the original again whatever happens on the way."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys

import pytest
from bag_tools import COMPRESSIONS, bag, contents, digest, every_kill, left_over, rows, unclosed

from amaze_autonomy.bags.cli import main
from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge import writer
from amaze_autonomy.bags.merge.merge import MergeOptions, merge
from amaze_autonomy.bags.recover.recover import read_undo, recover, recover_in_place, restore, undo_path, write_undo
from amaze_autonomy.bags.recover.scan import scan


def recording(folder, compression="none"):
    """Write a bag laid out as recorders do, of several chunks."""
    plain = bag(folder / "plain.bag", rows("/a", 1000, 1), rows("/b", 25, 23))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "CHUNK_BYTES", 40_000)
        whole = merge([plain], folder / "whole.bag", MergeOptions(compression=compression)).path
    plain.unlink()
    return whole


@pytest.fixture(scope="module", params=COMPRESSIONS)
def whole(request, tmp_path_factory):
    return recording(tmp_path_factory.mktemp("whole"), request.param)


@pytest.fixture
def active(tmp_path, whole):
    """What a killed recorder left; its last message is cut."""
    return unclosed(whole, tmp_path / "flight.bag.active", 40)


def short(path, tag, count):
    """Write what a recorder left that was killed before its first chunk was whole."""
    closed = bag(path.with_name("closed"), rows("/a", count, tag=tag), chunk_bytes=1 << 20)
    unclosed(closed, path, 20)
    closed.unlink()
    return path


@pytest.fixture(params=[*COMPRESSIONS, "one chunk"])
def killed(request, tmp_path, tmp_path_factory):
    """What a killed recorder left of several chunks, or of one: nothing of that stays where it is."""
    if request.param == "one chunk":
        return short(tmp_path / "flight.bag.active", "", 500)
    return unclosed(recording(tmp_path_factory.mktemp("whole"), request.param), tmp_path / "flight.bag.active", 40)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_it_is_the_bag_that_a_copy_would_be(tmp_path, active):
    copied = recover(active, tmp_path / "copied.bag")
    done = recover_in_place(active)
    assert done.path == tmp_path / "flight.bag"
    assert digest(done.path) == digest(copied.path)
    assert (done.scan.messages, done.size) == (copied.scan.messages, copied.size)
    assert names(tmp_path) == ["copied.bag", "flight.bag", "flight.bag.undo"]


def test_the_undo_file_is_small_and_makes_the_original_again(tmp_path, active):
    before = digest(active)
    done = recover_in_place(active)
    assert undo_path(done.path).stat().st_size < 40_000 + 5000
    for named in (done.path, active, undo_path(done.path)):
        assert restore(named) == active
        assert names(tmp_path) == ["flight.bag.active"]
        assert digest(active) == before
        recover_in_place(active)


def test_a_cut_bag_keeps_its_name(tmp_path, whole):
    cut = tmp_path / "flight.bag"
    with Index(whole) as index:
        size = index.position + (index.size - index.position) // 2
    cut.write_bytes(whole.read_bytes()[:size])
    before = digest(cut)
    done = recover_in_place(cut)
    assert (done.path, done.scan.lost) == (cut, 0)
    assert contents(cut) == contents(whole)
    with pytest.raises(BagError, match=r"flight\.bag\.undo: exists, of an earlier recovery; use it with --undo"):
        recover_in_place(cut)
    assert digest(restore(cut)) == before


def test_a_good_bag_is_left_alone(tmp_path, whole):
    good = tmp_path / "flight.bag"
    shutil.copy(whole, good)
    done = recover_in_place(good)
    assert (done.path, done.complete) == (good, True)
    assert names(tmp_path) == ["flight.bag"]
    assert digest(good) == digest(whole)


def test_a_good_bag_with_the_name_of_an_open_one_gets_its_own(tmp_path, whole):
    """Its recorder was killed between the two."""
    active, final = tmp_path / "flight.bag.active", tmp_path / "flight.bag"
    shutil.copy(whole, active)
    done = recover_in_place(active)
    assert (done.path, done.complete, done.size) == (final, True, whole.stat().st_size)
    assert names(tmp_path) == ["flight.bag"]
    assert digest(final) == digest(whole)


@pytest.mark.slow_rows(1)
def test_killed_at_any_moment_the_original_can_be_made_again(tmp_path, killed):
    before, final = digest(killed), tmp_path / "flight.bag"
    for call in every_kill(lambda: recover_in_place(killed)):
        if undo_path(final).exists():
            assert restore(final) == killed, call
        assert digest(killed) == before, call
        assert not final.exists()


@pytest.mark.slow_rows(1)
def test_killed_at_any_moment_the_next_try_finishes(tmp_path, killed):
    copied = digest(recover(killed, tmp_path / "copied.bag").path)
    original, final = killed.read_bytes(), tmp_path / "flight.bag"
    for call in every_kill(lambda: recover_in_place(killed)):
        if not final.exists():
            recover_in_place(killed)
        assert digest(final) == copied, call
        assert left_over(tmp_path) == []
        assert restore(final).read_bytes() == original, call


def test_an_undo_that_is_killed_can_be_done_again(tmp_path, killed):
    original, final = killed.read_bytes(), tmp_path / "flight.bag"
    recover_in_place(killed)
    for call in every_kill(lambda: restore(final)):
        if undo_path(final).exists():
            restore(final)
        assert killed.read_bytes() == original, call
        recover_in_place(killed)


def test_a_half_changed_bag_is_not_recovered_by_copying(tmp_path, active):
    original = active.read_bytes()
    done = recover_in_place(active)
    done.path.rename(active)  # as if it had been killed just before this
    with pytest.raises(
        BagError, match="is half changed by a recovery in place; finish that with --in-place, or --undo"
    ):
        recover(active, tmp_path / "copy.bag")
    assert restore(active).read_bytes() == original


@pytest.mark.parametrize("call", range(1, 6))
def test_a_disk_without_space_leaves_the_original(tmp_path, active, monkeypatch, call):
    before, count = digest(active), []

    def full(function):
        def replacement(*arguments):
            count.append(1)
            if len(count) == call:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return function(*arguments)

        return replacement

    for name in ("pwrite", "fsync"):
        monkeypatch.setattr(os, name, full(getattr(os, name)))
    with pytest.raises(BagError, match="cannot be written"):
        recover_in_place(active)
    assert digest(active) == before
    assert names(tmp_path) == ["flight.bag.active"]


def test_a_bag_that_is_still_written_is_refused(active):
    before = digest(active)
    with active.open("ab"), pytest.raises(BagError, match="is still open for writing; stop the recorder first"):
        recover_in_place(active)
    assert digest(active) == before


def test_a_taken_name_is_refused(tmp_path, active):
    (tmp_path / "flight.bag").write_bytes(b"mine")
    with pytest.raises(BagError, match=r"flight\.bag: exists; move it away"):
        recover_in_place(active)
    assert (tmp_path / "flight.bag").read_bytes() == b"mine"


def test_damage_in_the_middle_of_a_large_bag_needs_a_copy(active, monkeypatch):
    monkeypatch.setattr("amaze_autonomy.bags.recover.recover._MOST", 10_000)
    raw = bytearray(active.read_bytes())
    raw[4117:4140] = bytes(23)
    active.write_bytes(raw)
    with pytest.raises(
        BagError, match="more than its end is damaged, from byte 4117 on; recover it without --in-place"
    ):
        recover_in_place(active)
    assert active.read_bytes() == raw


def test_an_undo_file_of_another_bag_or_a_damaged_one_changes_nothing(tmp_path, active, whole):
    done = recover_in_place(active)
    after, undo = digest(done.path), undo_path(done.path)
    good = undo.read_bytes()
    for bad in (b"", good[:-1], good[:50], good[:200] + bytes([good[200] ^ 1]) + good[201:], b"#" * 5000):
        undo.write_bytes(bad)
        with pytest.raises(BagError, match=r"flight\.bag\.undo: is (no undo file|damaged)"):
            restore(done.path)
    for name in ("", "..", "../flight.bag", "/etc/passwd"):
        undo.write_bytes(good.replace(b'"flight.bag.active"', (b'"%s"' % name.encode()).ljust(19)))
        with pytest.raises(BagError, match=r"flight\.bag\.undo: is (no undo file|damaged|for)"):
            restore(done.path)
    undo.write_bytes(good)
    shutil.copy(done.path, tmp_path / "kept.bag")
    raw = bytearray(whole.read_bytes())
    raw[len(raw) // 3 :: 101] = bytes(len(raw[len(raw) // 3 :: 101]))
    done.path.write_bytes(raw)
    with pytest.raises(BagError, match="belongs to another bag"):
        restore(done.path)
    assert done.path.read_bytes() == raw
    done.path.unlink()
    with pytest.raises(BagError, match=r"is for flight\.bag\.active, of which there is nothing here"):
        restore(undo)
    assert digest(tmp_path / "kept.bag") == after


@pytest.mark.parametrize("before", [1, 5, 900])
@pytest.mark.parametrize("kept_open", [True, False])
def test_the_undo_file_of_a_bag_that_was_moved_away_harms_no_new_one_of_its_name(tmp_path, before, kept_open):
    """Where no chunk stays as it is, nothing before the new end tells one bag from another."""
    active, final = tmp_path / "flight.bag.active", tmp_path / "flight.bag"
    recover_in_place(short(active, "monday", before))
    final.rename(tmp_path / "monday.bag")
    short(active, "tuesday", 100)
    if not kept_open:
        recover(active, final)
        active.unlink()
    tuesday = active if kept_open else final
    data = tuesday.read_bytes()
    with pytest.raises(BagError, match=r"flight\.bag\.undo: belongs to another bag"):
        restore(tuesday)
    with pytest.raises(BagError, match=r"flight\.bag\.undo: exists, of an earlier recovery"):
        recover_in_place(tuesday)
    copied = recover(tuesday, tmp_path / "tuesday.bag").path
    assert len(contents(copied)) == 99
    assert tuesday.read_bytes() == data


def test_an_undo_file_of_before_that_does_not_know_the_new_end_needs_a_chunk_that_stayed_to_prove_the_bag(
    tmp_path, active
):
    for bag_left, proven in ((active, True), (short(tmp_path / "short.bag.active", "", 5), False)):
        before, done = digest(bag_left), recover_in_place(bag_left)
        write_undo(done.path, read_undo(undo_path(done.path))._replace(new=None))
        if proven:
            assert digest(restore(done.path)) == before
        else:
            with pytest.raises(BagError, match=r"\.undo: is of an earlier version and does not prove its bag; keep"):
                restore(done.path)


def test_an_undo_file_of_a_bag_that_was_changed_since_says_so(active):
    """As by somebody who appended to it, or reindexed it."""
    done = recover_in_place(active)
    with done.path.open("ab") as file:
        file.write(b"\xff" * 100_000)
    raw = done.path.read_bytes()
    with pytest.raises(BagError, match=r"\.undo: belongs to another bag, or the bag was changed since; put"):
        restore(done.path)
    assert done.path.read_bytes() == raw


def test_the_command_line_does_and_undoes_it(tmp_path, active, capsys):
    before = digest(active)
    lost = scan(active, check_data=False).lost
    assert main(["recover", "--in-place", str(active)]) == (0 if lost == 0 else 3)
    assert "flight.bag: " in capsys.readouterr().out
    assert main(["recover", "--undo", str(tmp_path / "flight.bag")]) == 0
    assert "flight.bag.active: as it was" in capsys.readouterr().out
    assert digest(active) == before
    with pytest.raises(SystemExit):
        main(["recover", "--in-place", "--undo", str(active)])
    assert main(["recover", "--undo", str(active)]) == 1
    assert "is no undo file" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [["recover", "--in-place", "--trust-data"], ["recover", "--force", "--trust-data"], ["doctor", "--quick"]],
)
def test_the_command_does_not_load_numpy_which_takes_longer_than_it_does(active, arguments):
    script = "import sys; from amaze_autonomy.bags.cli import main; status = main(sys.argv[1:])\n"
    script += "print(status, sorted({'numpy', 'hashlib', 'rosbags', 'rich', 'traceback'} & {*sys.modules}))"
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments, str(active)], capture_output=True, text=True, check=True, timeout=120
    )
    assert done.stdout.splitlines()[-1] == "3 []"
