"""A file that is damaged is a loss that is told, and no reason to do without all others; nothing of it is removed."""

import json
import os
import shutil

import pytest
from bag_tools import MS, bag, contents, digest, every_kill, rows, unclosed
from part_tools import FACTS, killed, part, plan, small_storage, two_platforms
from replay_bags import START_NS, make
from rosbags.highlevel import AnyReader
from test_header_numbers import inertial, numbered

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.format import UNDECODABLE, UNREADABLE
from amaze_autonomy.bags.index import Index
from amaze_autonomy.recording import job, parts
from amaze_autonomy.recording.job import Plan, Source, collect
from amaze_autonomy.recording.losses import Loss, Wanted, header_numbers, losses
from amaze_autonomy.recording.parts import close_parts, whole_bags
from amaze_autonomy.recording.storage import PARTS

S = 1_000_000_000


def damage_data(path, number=1):
    """Destroy the head of the first message of a chunk: no index shows it, and what follows it can be found."""
    with Index(path) as index:
        data = index.head(number).data
    write_at(path, data + 4, b"\xff\xff\xff\xff")


def damage_head(path, number=1):
    """Destroy the header of a chunk: all of it can be found by the index records behind it."""
    with Index(path) as index:
        write_at(path, index.chunks[number].position + 4, b"\xff" * 8)


def write_at(path, place, data):
    raw = bytearray(path.read_bytes())
    raw[place : place + len(data)] = data
    path.write_bytes(raw)


def manifest(session):
    return json.loads((session / "s1_m.manifest.json").read_text())


def files_of(content):
    return [(entry["file"], entry.get("open", False), entry["lost"]) for entry in content["files"]]


def listed_first(folder):
    """List a part as if it had been damaged before that."""
    (folder / PARTS).unlink()
    return close_parts(folder, {**FACTS, "platform": folder.name})


@pytest.fixture
def session(tmp_path):
    return two_platforms(tmp_path)  # 300 messages of each of /a and /b on main, of /c on second


@pytest.mark.slow_rows
@pytest.mark.parametrize("damage", [damage_data, damage_head])
@pytest.mark.parametrize("name", ["main/states-01.bag", "second/realsense-01.bag"])
def test_a_listed_bag_with_damaged_data_lacks_what_is_damaged_and_the_rest_is_merged(session, damage, name):
    path = session / name
    damage(path)
    platform, original = path.parent.name, digest(path)
    listed_first(path.parent)
    summary = collect(plan(session))
    recovered = path.with_name(f"{path.stem}.recovered.bag")
    lost = (600 if platform == "main" else 300) - len(contents(recovered))
    assert (0 < lost < 40) if damage is damage_data else lost == 0
    words = (f"{platform}/{path.name}: {lost} messages",) if lost else ()
    assert (summary.lost, summary.lost_in_flight, summary.messages) == (words, words, 900 - lost)
    assert manifest(session)["platforms"][platform]["lost"] == [each.split("/")[1] for each in words]
    assert digest(path) == original


@pytest.mark.parametrize("listed", [False, True])
def test_so_does_one_whose_damaged_chunk_is_compressed_and_overlaps_no_other(tmp_path, listed):
    """A merge copies such a chunk as it is, and nobody would look into it before that."""
    session = tmp_path / "s1_m"
    for place, (platform, file) in enumerate((("main", "states-01.bag"), ("second", "realsense-01.bag"))):
        (session / platform).mkdir(parents=True)
        bag(session / platform / file, rows(f"/{platform}", 300, first_ms=20_000 * place), compression="bz2")
        close_parts(session / platform, {**FACTS, "platform": platform})
    path = session / "main" / "states-01.bag"
    with Index(path) as index:
        middle, messages = index.head(1).data + index.head(1).stored // 2, index.chunks[1].messages
    write_at(path, middle, bytes([path.read_bytes()[middle] ^ 16]))
    if not listed:
        listed_first(path.parent)
    summary = collect(plan(session))
    (words,) = summary.lost
    assert words.startswith("main/states-01.bag: ")
    assert 600 - messages <= summary.messages < 600
    assert manifest(session)["verified"]["ok"] is True


def test_so_does_a_bag_in_place_that_is_damaged_after_it_was_listed(session):
    damage_data(session / "main" / "states-01.bag")
    (words,) = collect(plan(session)).lost
    assert words.startswith("main/states-01.bag: ")
    assert words.endswith(" messages")


def test_it_is_recovered_once_and_what_is_made_then_is_not_made_again(session, monkeypatch):
    damage_data(session / "main" / "states-01.bag")
    listed_first(session / "main")
    summary = collect(plan(session))
    with monkeypatch.context() as patched:
        patched.setattr(parts, "recover", refused)
        patched.setattr(job, "merge", refused)
        assert collect(plan(session)) == summary
    content = close_parts(session / "main", {**FACTS, "anew": True})
    (lost,) = (entry["lost"] for entry in content["files"])
    assert files_of(content) == [("states-01.recovered.bag", False, lost)]
    assert f"main/states-01.recovered.bag: {lost} messages" in collect(plan(session)).lost


def refused(path, *_, **__):
    raise BagError(str(path), "is not what is asked for here", "do not")


def test_a_bag_that_still_cannot_be_used_when_it_is_recovered_is_a_problem(session, monkeypatch):
    damage_data(session / "main" / "states-01.bag")
    listed_first(session / "main")
    asked = []

    def merge(inputs, *_):
        asked.append(inputs[0].name)
        raise BagError(str(inputs[0]), "cannot be used", "ask somebody")

    monkeypatch.setattr(job, "merge", merge)
    with pytest.raises(BagError, match=r"states-01\.recovered\.bag: cannot be used"):
        collect(plan(session))
    assert asked == ["states-01.bag", "states-01.recovered.bag"]


def test_a_bag_without_damage_is_not_recovered_whatever_a_merge_says_of_it(session, monkeypatch):
    def merge(inputs, *_):
        raise BagError(str(inputs[0]), "leaves the time of bags", "shift it less")

    monkeypatch.setattr(job, "merge", merge)
    with pytest.raises(BagError, match=r"states-01\.bag: leaves the time of bags"):
        collect(plan(session))
    assert sorted(path.name for path in (session / "main").iterdir()) == [PARTS, "states-01.bag"]


def test_an_open_bag_that_is_damaged_in_the_middle_tells_that_and_its_end(tmp_path):
    """It is closed in place without a look at its data; what its end lacks lies in the gap that follows it."""
    session = two_platforms(tmp_path)
    before = bag(tmp_path / "before.bag", rows("/a", 300, first_ms=4000))
    damage_data(before)
    unclosed(before, session / "main" / "states-02.bag.active", 30)
    bag(session / "main" / "states-03.bag", rows("/a", 30, first_ms=9000))
    (_, entry, _) = close_parts(session / "main", FACTS)["files"]
    assert (entry["file"], entry["lost"]) == ("states-02.bag", None)
    summary = collect(plan(session))
    whole = len(contents(session / "main" / "states-02.recovered.bag"))
    assert 270 < whole < 299
    told = [each for each in summary.lost if "states-02" in each]
    assert told == [f"main/states-02.bag: {299 - whole} messages"]
    assert summary.messages == 900 + whole + 30


# --- an open file that lacks something before its end -----------------------------------------------------------------


def several_chunks(index):
    """Return where pages of several chunks were never written."""
    return index.chunks[5].position, index.chunks[9].position


def in_the_last_chunk(index):
    data = index.head(len(index.chunks) - 1).data
    assert index.chunks[-1].messages > 10
    return data + 500, data + 800


def head_of_the_last_chunk(index):
    """Return where the header of the chunk that was being written is, with its first messages."""
    return index.chunks[-1].position, index.head(len(index.chunks) - 1).data + 300


INSIDE = (several_chunks, in_the_last_chunk, head_of_the_last_chunk)


def left_open(folder, place=None, cut=None, compression="none"):
    """Leave a bag of 3 s of topics without numbers that was being written, with zeros somewhere; return its end."""
    folder.mkdir(parents=True, exist_ok=True)
    whole = bag(folder.parent / "whole.bag", rows("/a", 300), compression=compression)
    path = unclosed(whole, folder / "states-01.bag.active", cut)
    if place is not None:
        with Index(whole) as index:
            begin, end = place(index)
        write_at(path, begin, bytes(end - begin))
    return START_NS + 2990 * MS


def told(content, end_ns, *flight):
    return [each for each in losses(content, Wanted(end_ns, [flight])) if "states-01" in each.words]


UNKNOWN = Loss("states-01.bag: an unknown number of messages")


@pytest.mark.parametrize("place", INSIDE)
@pytest.mark.parametrize("stopped_ms", [50, 5000])
def test_what_an_open_file_lacks_in_the_middle_is_told_and_counts_whenever_it_was_stopped(tmp_path, place, stopped_ms):
    folder = tmp_path / "main"
    end_ns = left_open(folder, place)
    for _ in range(2):
        content = close_parts(folder, FACTS)
        (entry,) = content["files"]
        assert (entry["file"], entry["lost"], entry["lost_inside"]) == ("states-01.bag", None, None)
        assert told(content, end_ns + stopped_ms * MS, START_NS, end_ns) == [UNKNOWN]


@pytest.mark.parametrize("place", INSIDE)
def test_so_it_is_when_a_gap_outside_of_the_flight_follows(tmp_path, place):
    end_ns = left_open(tmp_path / "main", place)
    bag(tmp_path / "main" / "states-02.bag", rows("/a", 30, first_ms=9000))
    content = close_parts(tmp_path / "main", FACTS)
    assert told(content, START_NS + 10 * S, START_NS, end_ns - 500 * MS) == [UNKNOWN]


@pytest.mark.slow_rows
@pytest.mark.parametrize("place", INSIDE)
def test_so_it_is_when_it_has_to_be_recovered_beside_it_or_on_the_collector(tmp_path, monkeypatch, place):
    folder = tmp_path / "main"
    end_ns = left_open(folder, place)
    monkeypatch.setattr(parts, "recover_in_place", refused)
    with monkeypatch.context() as patched:
        patched.setattr(parts, "recover", refused)
        close_parts(folder, FACTS)
    facts = {"stopped_ns": end_ns + 50 * MS, "flights": [[START_NS, end_ns]]}
    session_plan = Plan(tmp_path / "s1_m.bag", (Source("main", folder),), facts=facts)
    words = ("main/states-01.bag.active: an unknown number of messages",)
    assert [collect(session_plan).lost_in_flight for _ in range(2)] == [words, words]
    for _ in range(2):
        content = close_parts(folder, FACTS)
        assert told(content, end_ns + 50 * MS, START_NS, end_ns) == [
            Loss("states-01.recovered.bag: an unknown number of messages")
        ]


@pytest.mark.parametrize("compression", ["none", "lz4"])
def test_what_only_the_end_of_an_open_file_lacks_is_told_once(tmp_path, compression):
    end_ns = left_open(tmp_path / "main", cut=30, compression=compression)
    content = close_parts(tmp_path / "main", FACTS)
    (entry,) = content["files"]
    assert (entry["lost"], "lost_inside" in entry) == (None, False)
    lost_s = (end_ns + S - content["open_ends"]["states"]) / S
    words = f"states: up to {lost_s:.1f} s at the end (its last file was not closed)"
    assert [each.words for each in losses(content, Wanted(end_ns + S))] == [words]
    assert told(content, end_ns - S, START_NS, end_ns) == [], "it came after the stop"


def test_a_message_that_was_cut_just_before_the_stop_is_no_nothing(tmp_path):
    end_ns = left_open(tmp_path / "main", cut=30)
    content = close_parts(tmp_path / "main", FACTS)
    assert told(content, end_ns + 50 * MS, START_NS, end_ns + 50 * MS) == [UNKNOWN]
    assert told(content, end_ns + 50 * MS, START_NS, end_ns - S) == [UNKNOWN._replace(counts=False)]


def test_a_number_that_is_known_of_the_middle_is_the_least_and_counts():
    gap = {"group": "states", "file": 2, "seconds": 1.0, "ending": "killed", "from_ns": 20 * S, "to_ns": 21 * S}
    entry = {"file": "states-01.bag", "recovered_from": "states-01.bag.active", "lost_inside": 4}
    for lost, words in ((None, "at least 4 messages"), (6, "6 messages")):
        content = {"files": [{**entry, "lost": lost}], "gaps": [gap]}
        assert told(content, 30 * S, 2 * S, 3 * S) == [Loss(f"states-01.bag: {words}")]


# --- files of which nothing can be read -------------------------------------------------------------------------------


def numbers(topic):
    """Return messages of a type that no other bag of the session has."""
    return [(START_NS + each * MS, topic, make("std_msgs/msg/Int32", data=each)) for each in range(50)]


def described(session, name, streams, old, new):
    """Leave a bag of a camera in which bytes of the definition are others."""
    path = session / "main" / name
    killed(path.parent, name, *streams) if name.endswith(".active") else bag(path, *streams)
    raw = path.read_bytes()
    path.write_bytes(raw.replace(b"message_definition=" + old, b"message_definition=" + new))
    assert path.read_bytes() != raw
    content = listed_first(path.parent)
    assert files_of(content) == [("camera-01.bag", False, 0), ("states-01.bag", False, 0)]


NAMES = pytest.mark.parametrize("name", ["camera-01.bag.active", "camera-01.bag"])


@NAMES
def test_a_comment_that_is_not_utf_8_hinders_no_merge_and_is_no_loss(session, name):
    """As an old driver publishes it, in Latin-1."""
    described(session, name, [numbers("/d")], b"int32 data", b"int32 d#\xb0C")
    summary = collect(plan(session))
    assert (summary.lost, summary.messages) == ((), 950)
    made = manifest(session)
    assert made["verified"]["ok"] is True
    assert made["warnings"] == ([] if name.endswith(".active") else [f"/d: {UNREADABLE}; it is written as text"])


@pytest.mark.slow_rows
@NAMES
@pytest.mark.parametrize("tolerated", [[], ["/d"]])
def test_a_definition_that_is_damaged_hinders_no_merge_and_is_a_loss(session, name, tolerated):
    """Every message is there, and nobody can decode it; the newer rosbags libraries refuse the whole bag."""
    described(session, name, [numbers("/d")], b"i", b"\xb0")
    words = (f"/d: {UNDECODABLE}",)
    for _ in range(2):
        summary = collect(plan(session, facts={"tolerated_topics": tolerated}))
        assert (summary.lost, summary.lost_in_flight) == (words, () if tolerated else words)
        assert summary.messages == 950
        made = manifest(session)
        assert (made["verified"]["ok"], made["warnings"], made["lost"]) == (True, [*words], [*words])


@NAMES
def test_a_damaged_definition_is_taken_of_any_topic_of_its_type(session, name):
    described(session, name, [rows("/d", 50)], b"s", b"\xb0")
    summary = collect(plan(session))
    assert (summary.lost, summary.messages, manifest(session)["warnings"]) == ((), 950, [])
    with AnyReader([session / "s1_m.bag"]) as reader:
        links = [each for each in reader.connections if each.topic == "/d"]
        said = [reader.deserialize(raw, link.msgtype).data for link, _, raw in reader.messages(links)]
    assert len(said) == 50
    assert said[7].startswith("/d 7 ")


@pytest.mark.parametrize("name", ["states-02.bag.active", "states-02.bag"])
def test_a_file_of_zeros_is_told_and_the_rest_is_merged(session, name):
    path = session / "main" / name
    path.write_bytes(bytes(8192))
    content = close_parts(session / "main", FACTS)
    assert files_of(content) == [("states-01.bag", False, 0), (name, True, None)]
    assert content["files"][1]["problem"].startswith(f"{path}: is no bag")
    summary = collect(plan(session))
    words = f"main/{name}: nothing of it can be read"
    assert (summary.lost, summary.lost_in_flight, summary.messages) == ((words,), (words,), 900)
    assert path.read_bytes() == bytes(8192)


def test_a_bag_that_became_zeros_after_it_was_listed_is_told_as_well(session):
    path = session / "main" / "states-02.bag"
    part(session / "main", ("states-02.bag", [rows("/a", 30, first_ms=9000)]))
    path.write_bytes(bytes(path.stat().st_size))
    assert "main/states-02.bag: nothing of it can be read" in collect(plan(session)).lost


def test_a_bag_whose_index_is_damaged_is_made_whole_elsewhere_when_there_is_no_space_for_it(tmp_path):
    with small_storage(tmp_path / "full", 1) as folder:
        path = bag(folder / "states-01.bag", rows("/a", 3000))
        path.write_bytes(path.read_bytes()[:-40])
        (folder / "filling").write_bytes(bytes(1_000_000 - path.stat().st_size - 100_000))
        content = close_parts(folder, FACTS)
        assert files_of(content) == [("states-01.bag", True, None)]
        assert "there is no space for it" in content["files"][0]["problem"]
        (found,) = whole_bags(folder, content, tmp_path / "elsewhere")
        assert (found.lost, len(contents(found.path))) == (0, 3000)


def test_what_is_only_not_recovered_for_now_is_no_loss(session, monkeypatch):
    killed(session / "main", "states-02.bag.active", rows("/a", 30, first_ms=9000))
    with monkeypatch.context() as patched:
        patched.setattr(parts, "recover_in_place", refused)
        patched.setattr(parts, "recover", full)
        close_parts(session / "main", FACTS)
        with pytest.raises(BagError, match="there is no space for it"):
            collect(plan(session))
    summary = collect(plan(session))
    assert (summary.lost, summary.messages) == ((), 930)


def full(_, output, **__):
    raise BagError(str(output), "there is no space for it", "make space and try again, nothing was changed")


# --- undo files that are damaged --------------------------------------------------------------------------------------


UNDOS = (b"x", b"#AMAZE BAG UNDO 1\n" + bytes(100))


@pytest.mark.parametrize("undo", UNDOS)
def test_a_damaged_undo_file_beside_an_open_bag_is_told_and_the_bag_is_copied(session, undo):
    """A recovery was killed, and then the disk lost a block: whether the bag was half changed nobody knows."""
    path = killed(session / "main", "states-02.bag.active", rows("/a", 100, first_ms=9000))
    (session / "main" / "states-02.bag.undo").write_bytes(undo)
    before = digest(path)
    for _ in range(2):
        content = close_parts(session / "main", FACTS)
        (entry,) = [each for each in content["files"] if "states-02" in each["file"]]
        assert (entry["file"], entry["recovered_from"]) == ("states-02.recovered.bag", "states-02.bag.active")
        assert entry["messages"] == 100
    words = "main/states-02.recovered.bag: an unknown number of messages, states-02.bag.undo is damaged"
    summary = collect(plan(session))
    assert (summary.messages, [each for each in summary.lost_in_flight if "states-02" in each]) == (1000, [words])
    assert (digest(path), (session / "main" / "states-02.bag.undo").read_bytes()) == (before, undo)


def test_so_it_is_on_the_collector_when_its_platform_could_not_copy_it(session, monkeypatch):
    killed(session / "main", "states-02.bag.active", rows("/a", 100, first_ms=9000))
    (session / "main" / "states-02.bag.undo").write_bytes(b"x")
    with monkeypatch.context() as patched:
        patched.setattr(parts, "recover", full)
        close_parts(session / "main", FACTS)
        with pytest.raises(BagError, match="there is no space for it"):
            collect(plan(session))
    words = ("main/states-02.bag.active: an unknown number of messages, states-02.bag.undo is damaged",)
    assert [collect(plan(session)).lost for _ in range(2)] == [words, words]


def test_a_bag_of_which_nothing_can_be_read_beside_a_damaged_undo_file_is_told(session):
    (session / "main" / "states-02.bag.active").write_bytes(bytes(8192))
    (session / "main" / "states-02.bag.undo").write_bytes(b"x")
    close_parts(session / "main", FACTS)
    assert collect(plan(session)).lost == ("main/states-02.bag.active: nothing of it can be read",)


def test_damaged_data_of_a_bag_that_was_closed_in_place_is_recovered_whatever_its_undo_file_is(session):
    killed(session / "main", "states-02.bag.active", rows("/a", 100, first_ms=9000))
    close_parts(session / "main", FACTS)
    damage_data(session / "main" / "states-02.bag")
    (session / "main" / "states-02.bag.undo").write_bytes(b"x")
    summary = collect(plan(session))
    words = "main/states-02.bag: an unknown number of messages, states-02.bag.undo is damaged"
    assert words in summary.lost_in_flight
    assert 950 < summary.messages < 1000


# --- what was lost is known although a merge was killed ---------------------------------------------------------------


def test_a_recovery_whose_merge_was_killed_loses_nothing_that_is_not_lost(tmp_path):
    path = killed(tmp_path / "main", "states-01.bag.active", rows("/a", 100), cut=30)
    content = {"files": [{"file": path.name, "bytes": 1, "open": True, "lost": None}]}
    for number, lost in ((1, None), (2, 0)):
        here = tmp_path / f"here-{number}"
        (first,) = whole_bags(tmp_path / "main", content, here)
        stamp = first.path.stat().st_mtime_ns
        (again,) = whole_bags(tmp_path / "main", content, here)
        assert (first.lost, again) == (lost, first)
        assert again.path.stat().st_mtime_ns == stamp, "it is not recovered twice"
        killed(tmp_path / "main", path.name, rows("/a", 100))


def test_killed_at_any_moment_the_next_recovery_tells_the_same(tmp_path):
    folder, here = tmp_path / "main", tmp_path / "here"
    path = killed(folder, "states-01.bag.active", rows("/a", 100))
    content = {"files": [{"file": path.name, "bytes": 1, "open": True, "lost": None}]}
    for call in every_kill(lambda: whole_bags(folder, content, here)):
        (found,) = whole_bags(folder, content, here)
        assert (found.lost, len(contents(found.path))) == (0, 100), call
        shutil.rmtree(here)


@pytest.mark.parametrize("note", [None, "{}", '{"file": "states-01.bag.active", "bytes": 1, "lost": 0}'])
def test_where_it_is_not_written_down_what_was_lost_it_is_recovered_again(tmp_path, note):
    path = killed(tmp_path / "main", "states-01.bag.active", rows("/a", 100), cut=30)
    content = {"files": [{"file": path.name, "bytes": 1, "open": True, "lost": None}]}
    (first,) = whole_bags(tmp_path / "main", content, tmp_path / "here")
    written = tmp_path / "here" / "states-01.recovered.json"
    written.unlink() if note is None else written.write_text(note)
    first.path.write_bytes(b"an old one")
    assert whole_bags(tmp_path / "main", content, tmp_path / "here") == [first]
    assert len(contents(first.path)) == 99


# --- what was recovered is all that there is of a file that is gone, or was cut ---------------------------------------


def without_index(folder):
    """Leave a bag the end of whose index a power cut took, behind a good one."""
    folder.mkdir(parents=True)
    bag(folder / "states-01.bag", rows("/a", 300))
    path = bag(folder / "states-02.bag", rows("/a", 300, first_ms=3000))
    path.write_bytes(path.read_bytes()[:-30] + bytes(30))
    return path


def cut(path):
    os.truncate(path, path.stat().st_size // 3)


GOES_BAD = {"gone": os.unlink, "empty": lambda path: os.truncate(path, 0), "cut": cut}


@pytest.mark.parametrize("anew", [True, False])
@pytest.mark.parametrize("goes_bad", GOES_BAD)
def test_a_recovered_bag_stays_listed_and_merged_whatever_becomes_of_its_original(tmp_path, goes_bad, anew):
    folder = tmp_path / "s1_m" / "main"
    path = without_index(folder)
    first = close_parts(folder, FACTS)
    assert files_of(first)[1:] == [("states-02.recovered.bag", False, 0)]
    plan_of_one = Plan(tmp_path / "s1_m" / "s1_m.bag", (Source("main", folder),))
    made = collect(plan_of_one)
    GOES_BAD[goes_bad](path)
    for _ in range(2):
        assert close_parts(folder, {**FACTS, "anew": anew}) == first
        assert collect(plan_of_one) == made
    assert made.messages == 600
    assert not list(folder.glob(".*")), "nothing was made anew"


def test_so_does_one_that_could_not_be_closed_where_it_lies_and_could_be_now(tmp_path, monkeypatch):
    path = killed(tmp_path, "states-01.bag.active", rows("/a", 100))
    with monkeypatch.context() as patched:
        patched.setattr("amaze_autonomy.bags.recover.recover._MOST", 10)
        first = close_parts(tmp_path, FACTS)
    cut(path)
    size = path.stat().st_size
    assert close_parts(tmp_path, FACTS) == first
    assert (files_of(first), path.stat().st_size) == ([("states-01.recovered.bag", False, 0)], size)


def test_a_file_in_which_more_is_found_now_is_recovered_again_and_nothing_of_before_is_removed(tmp_path):
    """It was copied back from another disk, whole."""
    folder = tmp_path / "main"
    path = without_index(folder)
    raw = path.read_bytes()
    cut(path)
    few = close_parts(folder, FACTS)["files"][1]
    path.write_bytes(raw)
    (again,) = close_parts(folder, FACTS)["files"][1:]
    assert (again["file"], few["messages"] < again["messages"]) == (few["file"], True)
    assert again["messages"] == 300
    assert digest(folder / ".states-02.recovered.bag.bad") == few["sha256"]


def test_a_recovered_bag_that_is_damaged_when_its_original_is_gone_is_recovered_itself(tmp_path):
    folder = tmp_path / "main"
    path = without_index(folder)
    close_parts(folder, FACTS)
    path.unlink()
    recovered = folder / "states-02.recovered.bag"
    recovered.write_bytes(recovered.read_bytes()[:-30] + bytes(30))
    for _ in range(2):
        (_, entry) = close_parts(folder, {**FACTS, "anew": True})["files"]
        assert (entry["file"], entry["messages"]) == ("states-02.recovered.recovered.bag", 300)
        assert entry["recovered_from"] == "states-02.recovered.bag"


@pytest.mark.parametrize("note", ["{}", '{"file": "states-03.bag", "lost": 0}', '{"file": "../other/states-02.bag"}'])
def test_of_a_recovered_bag_without_a_note_of_its_own_nobody_knows_what_it_is(tmp_path, note):
    folder = tmp_path / "main"
    path = without_index(folder)
    close_parts(folder, FACTS)
    path.unlink()
    (folder / "states-02.recovered.json").write_text(note)
    assert files_of(close_parts(folder, FACTS)) == [("states-01.bag", False, 0)]


# --- a damaged chunk tells nothing of its numbers ---------------------------------------------------------------------


def test_numbers_are_known_without_a_chunk_whose_header_is_damaged(tmp_path):
    path = bag(tmp_path / "states-01.bag", numbered("/imu", range(1, 101), inertial, "/one"))
    damage_head(path)
    (numbers,) = header_numbers(path).values()
    assert (numbers.first, numbers.last) == (1, 100)
    (entry,) = close_parts(tmp_path, FACTS)["files"]
    assert (entry["file"], entry["messages"]) == ("states-01.bag", 100)
