"""A part is made whole and listed; what arrives elsewhere is compared with the list."""

import hashlib
import json
import math
import os
import shutil
from pathlib import Path

import pytest
from bag_tools import bag, contents, digest, every_kill, rows
from part_tools import FACTS, killed, part, small_storage
from replay_bags import write_empty_bag

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import pack_time
from amaze_autonomy.bags.index import Index
from amaze_autonomy.bags.merge.merge import merge
from amaze_autonomy.bags.recover.recover import recover, restore
from amaze_autonomy.recording.errors import TransferError
from amaze_autonomy.recording.losses import losses
from amaze_autonomy.recording.parts import check_arrived, close_parts, recover_damaged, whole_bags
from amaze_autonomy.recording.storage import PARTS, remove_part

SEEN = {"file": 1, "from_ns": None, "to_ns": None}


def words(content):
    return [each.words for each in losses(content)]


def chunk_places(path):
    """Return where each chunk of a bag ends, with its index."""
    with Index(path) as index:
        return [chunk.end for chunk in index.chunks]


def listed(folder):
    return json.loads((folder / PARTS).read_text())


def test_closed_bags_are_listed_with_bytes_messages_and_checksums(tmp_path):
    path = bag(tmp_path / "states-01.bag", rows("/a", 20))
    assert close_parts(tmp_path, FACTS) == listed(tmp_path)
    assert listed(tmp_path) == {
        "parts": 1, "session_id": "s1", "platform": "main", "gaps": [], "dropped": 0, "logs": [],
        "missing": {}, "open_ends": {}, "set_back": [], "recorded": {}, "uncounted": ["/a"],
        "files": [
            {"file": "states-01.bag", "bytes": path.stat().st_size, "messages": 20, "sha256": digest(path), "lost": 0}
        ],
    }  # fmt: skip


def test_warnings_in_a_log_that_nobody_read_count_too(tmp_path):
    """The node was killed, or the computer started anew, before it looked."""
    bag(tmp_path / "states-01.bag", rows("/a", 20))
    warning = "\x1b[33m[ WARN] [1.5]: rosbag record buffer exceeded.  Dropping oldest queued message.\x1b[0m\n"
    (tmp_path / "states.log").write_bytes(b"\xff\n" + 3 * warning.encode())
    assert [close_parts(tmp_path, {**FACTS, "dropped": seen})["dropped"] for seen in (0, 2, 4)] == [3, 3, 4]
    assert words(close_parts(tmp_path, FACTS)) == [
        "at least 3 messages dropped (warnings of the recorder: 3, one in 5 s at most; "
        "topics without numbers are not counted)"
    ]


def test_what_a_killed_recorder_left_is_closed_where_it_lies_and_can_be_undone(tmp_path):
    path = killed(tmp_path, "states-01.bag.active", rows("/a", 100))
    before = digest(path)
    entry = close_parts(tmp_path, FACTS)["files"][0]
    whole = tmp_path / "states-01.bag"
    assert entry == {
        "file": "states-01.bag", "bytes": whole.stat().st_size, "messages": 100, "sha256": digest(whole), "lost": 0,
        "recovered_from": "states-01.bag.active", "undo": "states-01.bag.undo",
    }  # fmt: skip
    assert len(contents(whole)) == 100
    assert digest(restore(whole)) == before


def test_a_bag_that_was_closed_and_not_renamed_has_lost_nothing(tmp_path):
    """Its recorder was killed, or the power was cut, between the two."""
    source = bag(tmp_path / "source", rows("/a", 100))
    path = merge([source], tmp_path / "states-01.bag").path
    source.unlink()
    before = digest(path)
    path.rename(tmp_path / "states-01.bag.active")
    content = close_parts(tmp_path, FACTS)
    assert content["files"] == [
        {"file": "states-01.bag", "bytes": path.stat().st_size, "messages": 100, "sha256": before, "lost": 0}
    ]
    assert (words(content), content["open_ends"]) == ([], {})
    assert close_parts(tmp_path, FACTS) == content


@pytest.mark.parametrize("again", ["", PARTS])
def test_it_is_not_recovered_twice_and_the_loss_stays_known(tmp_path, again):
    """Even when the list was not written any more."""
    killed(tmp_path, "states-01.bag.active", rows("/a", 100), cut=30)
    first = close_parts(tmp_path, FACTS)
    stamp = (tmp_path / "states-01.bag").stat().st_mtime_ns
    if again:
        (tmp_path / again).unlink()
    assert close_parts(tmp_path, FACTS) == first
    assert (tmp_path / "states-01.bag").stat().st_mtime_ns == stamp
    assert words(first) == ["states-01.bag: an unknown number of messages"]
    assert list(first["open_ends"]) == ["states"]


def test_killed_at_any_moment_the_next_try_makes_the_same_of_it(tmp_path):
    killed(tmp_path / "kept", "states-01.bag.active", rows("/a", 100), cut=30)
    folder = tmp_path / "main"
    shutil.copytree(tmp_path / "kept", folder)
    expected = close_parts(folder, FACTS)
    for call in every_kill(lambda: close_parts(folder, FACTS)):
        assert close_parts(folder, FACTS) == expected, call
        whole = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
        assert whole == {"states-01.bag", "states-01.bag.undo", PARTS}, call
        shutil.rmtree(folder)
        shutil.copytree(tmp_path / "kept", folder)


def test_what_cannot_be_closed_where_it_lies_is_recovered_beside_it_and_never_changed(tmp_path, monkeypatch):
    monkeypatch.setattr("amaze_autonomy.bags.recover.recover._MOST", 10)
    path = killed(tmp_path, "states-01.bag.active", rows("/a", 100))
    before = digest(path)
    entry = close_parts(tmp_path, FACTS)["files"][0]
    assert (entry["file"], entry["recovered_from"]) == ("states-01.recovered.bag", "states-01.bag.active")
    assert entry["messages"] == len(contents(tmp_path / "states-01.recovered.bag")) == 100
    assert digest(path) == before
    stamp = (tmp_path / "states-01.recovered.bag").stat().st_mtime_ns
    assert close_parts(tmp_path, FACTS)["files"] == [entry]
    assert (tmp_path / "states-01.recovered.bag").stat().st_mtime_ns == stamp


def test_what_was_recovered_by_hand_is_not_recovered_once_more(tmp_path):
    """`amaze-bag recover` keeps the original; with both, every message would be in the recording twice."""
    path = killed(tmp_path, "states-01.bag.active", rows("/a", 100), cut=30)
    whole = recover(path, tmp_path / "states-01.bag").path
    before = digest(path), digest(whole)
    content = close_parts(tmp_path, FACTS)
    assert content["files"] == [
        {"file": "states-01.bag", "bytes": whole.stat().st_size, "messages": 99, "sha256": before[1], "lost": None,
         "recovered_from": "states-01.bag.active"}
    ]  # fmt: skip
    assert list(content["open_ends"]) == ["states"], "its recorder did not close it"
    assert (digest(path), digest(whole)) == before
    assert close_parts(tmp_path, FACTS) == content
    assert [each.path for each in whole_bags(tmp_path, content, tmp_path / "target")] == [whole]
    path.unlink()
    for facts in (FACTS, {**FACTS, "anew": True}):
        assert close_parts(tmp_path, facts) == content, "of what it was recovered is known when that is removed"


@pytest.mark.parametrize("wrong", ["fewer", "damaged"])
def test_a_worse_bag_that_was_recovered_by_hand_is_passed_over(tmp_path, wrong):
    path = killed(tmp_path, "states-01.bag.active", rows("/a", 100))
    whole = tmp_path / "states-01.bag"
    if wrong == "fewer":
        bag(whole, rows("/a", 60))
    else:
        whole.write_bytes(recover(path, tmp_path / "source").path.read_bytes()[:-50])
    before = digest(path), digest(whole)
    (entry,) = close_parts(tmp_path, FACTS)["files"]
    names = ("states-01.recovered.bag", "states-01.bag.active")
    assert ((entry["file"], entry["recovered_from"]), entry["messages"], entry["lost"]) == (names, 100, 0)
    assert (digest(path), digest(whole)) == before


def test_two_recordings_of_one_name_are_both_listed(tmp_path):
    killed(tmp_path, "states-01.bag.active", rows("/a", 100))
    bag(tmp_path / "states-01.bag", rows("/a", 200, first_ms=9000))
    content = close_parts(tmp_path, FACTS)
    assert [each["messages"] for each in content["files"]] == [200, 100]
    assert content["set_back"] == [], "neither came before the other"


@pytest.mark.parametrize("name", ["landing.bag", "x.bag", "states-01.copy.bag", "states-01.orig.bag", "all.bag.active"])
def test_a_bag_whose_name_is_no_recorders_is_named_and_not_listed(tmp_path, name):
    """Somebody cut or copied one there: with it, messages would be in the recording twice."""
    path = bag(tmp_path / "states-01.bag", rows("/a", 20))
    before = close_parts(tmp_path, FACTS)
    shutil.copy(path, tmp_path / name)
    assert close_parts(tmp_path, {**FACTS, "anew": True}) == listed(tmp_path) == {**before, "foreign": [name]}
    assert digest(tmp_path / name) == digest(path)


@pytest.mark.parametrize("name", ["copy of states-01.bag", "cut-01.bag", "states-01-02.bag", "2026-10-12-10-00-00.bag"])
@pytest.mark.parametrize("key", ["topics", "configured", "seen"])
def test_a_bag_whose_name_is_like_a_recorders_and_of_no_group_of_the_recording_is_not_listed(tmp_path, name, key):
    path = bag(tmp_path / "states-01.bag", rows("/a", 20))
    known = {"topics": ["/a"], "configured": {"topics": ["/a"], "match": [], "exclude": ""}, "seen": SEEN}
    facts = {**FACTS, key: {"states": known[key]}}
    before = close_parts(tmp_path, facts)
    shutil.copy(path, tmp_path / name)
    assert close_parts(tmp_path, {**facts, "anew": True}) == {**before, "foreign": [name]}


def test_what_a_group_recorded_that_nobody_remembers_is_known_by_its_log(tmp_path):
    """What the node remembers was lost, and the group is not in the configuration any more."""
    killed(tmp_path, "cameras-01.bag.active", rows("/c", 20))
    (tmp_path / "cameras.log").write_text("")
    bag(tmp_path / "states-01.bag", rows("/a", 20))
    content = close_parts(tmp_path, {**FACTS, "seen": {"states": SEEN}})
    assert [each["file"] for each in content["files"]] == ["cameras-01.bag", "states-01.bag"]
    assert "foreign" not in content


def test_an_undo_file_that_is_damaged_is_no_reason_to_do_without_the_bag(tmp_path):
    killed(tmp_path, "states-01.bag.active", rows("/a", 100), cut=30)
    close_parts(tmp_path, FACTS)
    (tmp_path / "states-01.bag.undo").write_bytes(b"x")
    entry = close_parts(tmp_path, FACTS)["files"][0]
    assert (entry["file"], entry["messages"], entry["lost"]) == ("states-01.bag", 99, None)
    assert entry["recovered_from"] == "states-01.bag.active"
    assert "undo" not in entry


@pytest.mark.parametrize("count", [3, 100])  # of one chunk nothing stays before the end
def test_an_undo_file_of_a_bag_that_was_moved_away_says_nothing_of_another_one_and_is_not_removed(tmp_path, count):
    folder = tmp_path / "s1" / "main"
    original = digest(killed(folder, "states-01.bag.active", rows("/a", count), cut=30))
    close_parts(folder, FACTS)
    path, moved = folder / "states-01.bag", tmp_path / "moved.bag"
    path.rename(moved)
    bag(path, rows("/a", 50, first_ms=90_000))
    content = close_parts(folder, FACTS)
    assert content["files"] == [
        {"file": path.name, "bytes": path.stat().st_size, "messages": 50, "sha256": digest(path), "lost": 0}
    ]
    assert (words(content), content["open_ends"]) == ([], {})
    for undo in ({}, {"undo": "states-01.bag.undo"}):  # an earlier version named it
        entry = {**content["files"][0], **undo}
        (folder / PARTS).write_text(json.dumps({**content, "files": [entry]}))
        kept = path.read_bytes()
        remove_part(folder, tmp_path, {path.name: entry["sha256"]})
        assert sorted(each.name for each in folder.iterdir()) == [PARTS, "states-01.bag.undo"]
        path.write_bytes(kept)
    moved.replace(path)
    assert digest(restore(path)) == original


@pytest.mark.parametrize("count", [3, 100])
def test_what_a_bag_lost_that_was_changed_after_it_was_closed_in_place_stays_lost(tmp_path, count):
    """Its undo file cannot be used any more, and is still of it."""
    killed(tmp_path, "states-01.bag.active", rows("/a", count), cut=30)
    (first,) = close_parts(tmp_path, FACTS)["files"]
    path = tmp_path / "states-01.bag"
    begin, _, end = path.read_bytes().rpartition(b"string data")
    path.write_bytes(begin + b"int32  data" + end)
    (tmp_path / PARTS).unlink()
    (entry,) = close_parts(tmp_path, FACTS)["files"]
    assert entry == {**{key: first[key] for key in first if key != "undo"}, "sha256": digest(path)}
    assert (entry["lost"], entry["recovered_from"]) == (None, "states-01.bag.active")


def test_a_bag_whose_index_is_damaged_is_recovered(tmp_path):
    path = bag(tmp_path / "states-01.bag", rows("/a", 100))
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) - 40])
    entry = close_parts(tmp_path, FACTS)["files"][0]
    assert (entry["file"], entry["messages"]) == ("states-01.recovered.bag", 100)


@pytest.mark.parametrize("field", [b"conn=", b"chunk_count="])
def test_one_bit_of_an_index_hinders_no_list(tmp_path, field):
    path = bag(tmp_path / "states-01.bag", rows("/a", 100))
    with Index(path) as index:
        begin = index.position if field == b"conn=" else 0
    raw = bytearray(path.read_bytes())
    raw[raw.index(field, begin) + len(field) + (3 if begin else 0)] ^= 0x40 if begin else 4
    path.write_bytes(raw)
    content = close_parts(tmp_path, FACTS)
    (entry,) = content["files"]
    assert (entry["file"], entry["messages"], entry["lost"]) == ("states-01.recovered.bag", 100, 0)
    assert (content["uncounted"], words(content)) == (["/a"], [])
    assert close_parts(tmp_path, FACTS) == content


def test_a_chunk_with_another_time_in_the_index_is_recovered_for_a_merge(tmp_path):
    folder = part(tmp_path / "main", ("states-01.bag", [rows("/a", 100)]))
    path = folder / "states-01.bag"
    with Index(path) as index:
        chunk, begin = index.chunks[1], index.position
    raw = path.read_bytes()
    at = raw.index(b"start_time=" + pack_time(chunk.start_ns), begin) + 11
    path.write_bytes(raw[:at] + pack_time(chunk.start_ns + (1024 << 30)) + raw[at + 8 :])
    with pytest.raises(BagError, match="outside of the time"):
        merge([path], tmp_path / "flight.bag")
    assert recover_damaged(folder, path, tmp_path / "target") is True
    found = whole_bags(folder, listed(folder), tmp_path / "target")
    assert [each.lost for each in found] == [0]
    assert merge([each.path for each in found], tmp_path / "flight.bag").messages == 100


def test_a_bag_without_messages_and_an_empty_file_are_no_damage(tmp_path):
    write_empty_bag(tmp_path / "states-01.bag")
    (tmp_path / "cameras-01.bag.active").touch()
    content = close_parts(tmp_path, FACTS)
    assert [(entry["file"], entry["messages"], entry["lost"]) for entry in content["files"]] == [
        ("states-01.bag", 0, 0)
    ]
    assert losses(content) == []


def test_without_space_for_a_recovered_bag_the_open_one_is_listed_and_made_whole_elsewhere(tmp_path):
    with small_storage(tmp_path / "full", 1) as folder:
        path = killed(folder, "states-01.bag.active", rows("/a", 3000))
        (folder / "filling").write_bytes(bytes(1_000_000 - path.stat().st_size - 100_000))
        content = close_parts(folder, FACTS)
        (entry,) = content["files"]
        assert (entry["file"], entry["open"], entry["lost"]) == ("states-01.bag.active", True, None)
        assert "there is no space for it" in entry["problem"]
        (found,) = whole_bags(folder, content, tmp_path / "elsewhere")
        assert len(contents(found.path)) == 3000


def test_the_list_is_written_when_all_that_it_names_is_on_the_disk(tmp_path, monkeypatch):
    """rosbag closes a file without that: after a power cut a list would name what nobody has."""
    bag(tmp_path / "states-01.bag", rows("/a", 20))
    killed(tmp_path, "states-02.bag.active", rows("/a", 20, first_ms=9000))
    kept, fsync = [], os.fsync

    def noted(file):
        kept.append(Path(os.readlink(f"/proc/self/fd/{file}")).name)
        fsync(file)

    monkeypatch.setattr(os, "fsync", noted)
    close_parts(tmp_path, FACTS)
    assert kept[-5:] == ["states-01.bag", "states-02.bag", tmp_path.name, ".parts.json.part", tmp_path.name]


def test_a_list_that_is_as_it_was_is_not_written_again(tmp_path):
    """Who fetches the part meanwhile reads one list, not two."""
    folder = part(tmp_path / "main", ("states-01.bag", [rows("/a", 20)]))
    before = (folder / PARTS).stat()
    content = listed(folder)
    assert close_parts(folder, {**FACTS, "anew": True}) == content
    assert (folder / PARTS).stat() == before


def test_a_bag_that_changed_since_it_was_listed_is_a_loss_however_often_it_is_listed(tmp_path):
    """Its index is good: of what is in the data nobody knows whether it is what was recorded."""
    folder = part(tmp_path / "main", ("states-01.bag", [rows("/a", 50)]))
    raw = bytearray((folder / "states-01.bag").read_bytes())
    raw[raw.index(b"/a 30 xx") + 6] ^= 1
    (folder / "states-01.bag").write_bytes(raw)
    for anew in (True, True, False):
        content = close_parts(folder, {**FACTS, "anew": anew})
        assert words(content) == ["states-01.bag: an unknown number of messages, it has changed since it was listed"]
    assert check_arrived(folder) == content


def test_a_bag_with_a_name_that_was_listed_before_is_another_one_when_the_session_is_recorded_again(tmp_path):
    """Parts that are verified may be removed; the list stays."""
    folder = part(tmp_path / "main", ("states-01.bag", [rows("/a", 50)]))
    (folder / "states-01.bag").unlink()
    assert words(listed(part(folder, ("states-01.bag", [rows("/a", 20, first_ms=9000)])))) == []


@pytest.mark.parametrize("before", [3, None])
def test_what_a_bag_had_lost_before_it_became_shorter_stays_lost(tmp_path, before):
    folder = part(tmp_path / "main", ("states-01.bag", [rows("/a", 50)]))
    content, path = listed(folder), folder / "states-01.bag"
    content["files"][0]["lost"] = before
    (folder / PARTS).write_text(json.dumps(content))
    path.write_bytes(path.read_bytes()[: chunk_places(path)[1]])
    (entry,) = close_parts(folder, {**FACTS, "anew": True})["files"]
    assert entry["lost"] == (None if before is None else before + 50 - entry["messages"])


@pytest.mark.parametrize("keep", ["half", "all but the index"])
def test_a_bag_that_is_shorter_than_it_was_listed_has_lost_what_it_had_more(tmp_path, keep):
    folder = part(tmp_path / "main", ("states-01.bag", [rows("/a", 50)]))
    path = folder / "states-01.bag"
    place = chunk_places(path)[-1 if keep == "all but the index" else 1]
    path.write_bytes(path.read_bytes()[:place])
    for anew in (True, True, False):
        content = close_parts(folder, {**FACTS, "anew": anew})
        (entry,) = content["files"]
        assert (entry["file"], entry["recovered_from"]) == ("states-01.recovered.bag", "states-01.bag")
        lost = 50 - len(contents(folder / "states-01.recovered.bag"))
        assert (lost > 0) == (keep == "half")
        assert words(content) == ([f"states-01.recovered.bag: {lost} messages"] if lost else [])


def test_a_bag_that_was_listed_and_is_gone_is_a_loss_when_the_part_is_listed_anew(tmp_path):
    """It stays known when the session is recorded again."""
    gone = "states-02.bag: all of it, it was listed and is not there any more"
    bags = [(f"states-0{number}.bag", [rows("/a", 20, first_ms=number * 200)]) for number in (1, 2)]
    folder = part(tmp_path / "main", *bags)
    (folder / "states-02.bag").unlink()
    for _ in range(2):
        content = close_parts(folder, {**FACTS, "anew": True})
        assert words(content) == [gone]
    bag(folder / "states-03.bag", rows("/a", 20, first_ms=400))
    for _ in range(2):
        assert words(close_parts(folder, FACTS))[0] == gone
    bag(folder / "states-02.bag", rows("/a", 20, first_ms=400))
    content = close_parts(folder, FACTS)
    assert ("gone" in content, gone in words(content)) == (False, False), "it is back"


def test_a_bag_that_is_gone_when_the_session_is_recorded_again_may_have_been_removed(tmp_path):
    """Parts that are verified may be."""
    bags = [(f"states-0{number}.bag", [rows("/a", 20, first_ms=number * 200)]) for number in (1, 2)]
    folder = part(tmp_path / "main", *bags)
    (folder / "states-02.bag").unlink()
    assert words(close_parts(folder, FACTS)) == []


def test_what_is_closed_in_place_at_last_is_not_gone(tmp_path, monkeypatch):
    killed(tmp_path, "states-01.bag.active", rows("/a", 100))
    with monkeypatch.context() as patched:
        patched.setattr("amaze_autonomy.recording.parts.recover_in_place", refused)
        patched.setattr("amaze_autonomy.recording.parts.recover", refused)
        assert close_parts(tmp_path, FACTS)["files"][0]["file"] == "states-01.bag.active"
    assert words(close_parts(tmp_path, {**FACTS, "anew": True})) == []
    assert listed(tmp_path)["files"][0]["file"] == "states-01.bag"


def refused(path, *_, **__):
    raise BagError(str(path), "cannot be changed", "make space")


@pytest.mark.parametrize("name", ["/{}/main/a-01.bag", "../main/a-01.bag", "", "x/../../main/a-01.bag"])
def test_a_list_that_names_a_file_of_somebody_else_is_refused_and_touches_nothing(tmp_path, name):
    main = part(tmp_path / "main", ("a-01.bag", [rows("/a", 50)]))
    before = digest(main / "a-01.bag")
    (tmp_path / "second").mkdir()
    named = name.format(tmp_path)
    forged = {"parts": 1, "files": [{"file": named, "bytes": 1, "sha256": 64 * "0"}]}
    (tmp_path / "second" / PARTS).write_text(json.dumps(forged))
    with pytest.raises(TransferError, match="names a file that is none of this part"):
        check_arrived(tmp_path / "second")
    assert digest(main / "a-01.bag") == before


def test_what_did_not_arrive_or_is_different_is_named_and_put_aside(tmp_path):
    folder = part(tmp_path / "second", ("a-01.bag", [rows("/a", 50)]))
    assert check_arrived(folder)["session_id"] == "s1"
    raw = bytearray((folder / "a-01.bag").read_bytes())
    raw[5000] ^= 1
    (folder / "a-01.bag").write_bytes(raw)
    with pytest.raises(TransferError, match=r"a-01\.bag: is not what was sent, and was put aside; retry"):
        check_arrived(folder)
    with pytest.raises(TransferError, match=r"a-01\.bag: did not arrive"):
        check_arrived(folder)
    (folder / PARTS).unlink()
    with pytest.raises(TransferError, match="is missing, or no list of a part; nobody knows whether it is whole"):
        check_arrived(folder)


def test_what_is_put_aside_is_never_put_over_what_was_put_aside_before(tmp_path):
    folder = part(tmp_path / "second", ("a-01.bag", [rows("/a", 50)]))
    for content in (b"first", b"second", b"third"):
        (folder / "a-01.bag").write_bytes(content)
        with pytest.raises(TransferError, match="was put aside"):
            check_arrived(folder)
    assert {path.name: path.read_bytes() for path in folder.glob(".*")} == {
        ".a-01.bag.bad": b"first", ".a-01.bag.bad2": b"second", ".a-01.bag.bad3": b"third",
    }  # fmt: skip


def test_a_part_in_place_was_never_sent_and_is_left_as_it_is(tmp_path):
    """It is the only one there is."""
    folder = part(tmp_path / "main", ("a-01.bag", [rows("/a", 50)]))
    size = (folder / "a-01.bag").stat().st_size
    (folder / "a-01.bag").write_bytes(b"short")
    anew = "nothing was changed; retry, and its platform lists anew what is there"
    with pytest.raises(TransferError) as differs:
        check_arrived(folder, checksums=False)
    assert str(differs.value) == f"{folder}/a-01.bag: has 5 bytes and not {size}, as its list says; {anew}"
    assert (folder / "a-01.bag").read_bytes() == b"short"
    (folder / "a-01.bag").unlink()
    with pytest.raises(TransferError) as gone:
        check_arrived(folder, checksums=False)
    assert str(gone.value) == f"{folder}/a-01.bag: is not there, and its list names it; {anew}"
    (folder / PARTS).write_text("{}")
    with pytest.raises(TransferError) as none:
        check_arrived(folder, checksums=False)
    assert (
        str(none.value)
        == f"{folder}/parts.json: is missing, or no list of a part; nobody knows whether it is whole; {anew}"
    )


@pytest.mark.parametrize("content", ["{}", '{"files": null}', '{"files": [{}]}', '{"files": ["a-01.bag"]}', "x"])
def test_what_arrived_and_is_no_list_is_said(tmp_path, content):
    (tmp_path / PARTS).write_text(content)
    with pytest.raises(
        TransferError, match="is missing, or no list of a part; nobody knows whether it is whole; retry"
    ):
        check_arrived(tmp_path)


def test_a_list_of_an_earlier_version_whose_gap_ends_before_it_began_tells_of_a_clock_that_was_set_back(tmp_path):
    gaps = [{**GAP, "seconds": seconds} for seconds in (1.0, -3598.6)] + [{**GAP, "group": "b", "seconds": -0.5}]
    (tmp_path / PARTS).write_text(json.dumps({"files": [], "gaps": gaps, "set_back": ["b"]}))
    unknown = [gaps[0], *({**gap, "seconds": None} for gap in gaps[1:])]
    assert check_arrived(tmp_path) == {"files": [], "gaps": unknown, "set_back": ["b", "a"]}


ENTRY = {"file": "a-01.bag", "bytes": 0, "sha256": hashlib.sha256().hexdigest(), "lost": None}
GAP = {"group": "a", "file": 2, "seconds": 1.0, "ending": "it ended"}
LISTS = {
    "all": {
        "files": [ENTRY, {"file": "a-02.bag", "unreadable": True}], "logs": ["a.log"], "dropped": 3,
        "gaps": [GAP, {**GAP, "seconds": None, "from_ns": 1, "to_ns": None, "missing": 3}], "missing": {"/c": 1},
        "recorded": {"a": [1, None]}, "open_ends": {"a": 1}, "topics": {"a": ["/c"]}, "gone": ["a-03.bag"],
    },
    **{
        str(wrong): {"files": [ENTRY], **wrong}
        for wrong in (
            {"files": [ENTRY, ENTRY]}, {"files": [{**ENTRY, "lost": -5}]}, {"files": [{**ENTRY, "lost": "5"}]},
            {"files": [{**ENTRY, "bytes": "0"}]}, {"files": [{**ENTRY, "sha256": None}]},
            {"files": [{"file": "a-01.bag"}]},
            {"files": [{**ENTRY, "sha256": "1f"}]}, {"gaps": 3}, {"gaps": [{**GAP, "ending": None}]},
            {"gaps": [{"group": "a", "file": 2, "ending": "it ended"}]}, {"gaps": [{**GAP, "seconds": math.nan}]},
            {"gaps": [{**GAP, "seconds": -math.inf}]},
            {"dropped": "3"}, {"missing": {"/c": -1}}, {"recorded": {"a": [1]}},
            {"open_ends": []}, {"topics": {"a": "/c"}}, {"gone": "a-03.bag"}, {"set_back": [1]},
        )
    },
}  # fmt: skip


NULLS = {
    "files": dict.fromkeys(("recovered_from", "undo", "undo_damaged", "changed", "listed_as", "problem", "messages")),
    "gaps": {"missing": None},
    **{key: {"b": None} for key in ("recorded", "open_ends", "missing", "topics")},
}


@pytest.mark.parametrize("key", NULLS)
def test_what_is_null_in_a_list_is_not_known_as_what_is_not_there(tmp_path, key):
    """So an own recorder writes it whose language writes all fields."""
    (tmp_path / "a-01.bag").write_bytes(b"")
    content = {**LISTS["all"], "seen": {"a": {**SEEN, "file": None}}}
    known = content[key]
    nulls = {**known, **NULLS[key]} if isinstance(known, dict) else [{**NULLS[key], **each} for each in known]
    (tmp_path / PARTS).write_text(json.dumps({**content, key: nulls, "dropped": None}))
    assert check_arrived(tmp_path) == {key: value for key, value in content.items() if key != "dropped"}


@pytest.mark.parametrize("name", LISTS)
def test_a_list_that_says_what_cannot_be_is_none_and_puts_no_file_aside(tmp_path, name):
    """An own recorder wrote it: each retry would fetch the same files again."""
    (tmp_path / "a-01.bag").write_bytes(b"")
    (tmp_path / PARTS).write_text(json.dumps(LISTS[name]))
    if name == "all":
        assert check_arrived(tmp_path) == LISTS["all"]
    else:
        with pytest.raises(TransferError, match=r"parts\.json: is missing, or no list of a part"):
            check_arrived(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a-01.bag", PARTS]
