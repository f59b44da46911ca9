"""A part that came whole and is fetched again, when what it came from is not what it was any more; a real rsync."""

import json
import os
import shutil
import time

import pytest
from bag_tools import bag, digest, multiset, rows
from part_tools import FACTS, part, plan

pytest.importorskip("roslib")

from amaze_autonomy.bags.index import Index
from amaze_autonomy.config.schemas.recording import Transfer
from amaze_autonomy.nodes.recorder.processes import RecorderJobs
from amaze_autonomy.recording.errors import RecordingError
from amaze_autonomy.recording.job import collect
from amaze_autonomy.recording.parts import check_arrived, close_parts
from amaze_autonomy.recording.storage import PARTS, read_parts

pytestmark = pytest.mark.live

NAME = "realsense-01.bag"
SHARED = Transfer("shared")


@pytest.fixture
def there(tmp_path):
    """Return the folder of a part on the disk of another platform."""
    if shutil.which("rsync") is None:
        pytest.skip("NOT TESTED: there is no rsync")
    return part(tmp_path / "disk" / "s1_m" / "second", (NAME, [rows("/c", 300, 11)]), platform="second")


@pytest.fixture
def session(tmp_path):
    """Return the folder of a session on the collector, with its own part."""
    part(tmp_path / "here" / "s1_m" / "main", ("states-01.bag", [rows("/a", 300)]))
    return tmp_path / "here" / "s1_m"


def fetch(there, session):
    assert RecorderJobs().fetch(SHARED, str(there), session / "second", lambda _: None) == ""


def listed_anew(there):
    close_parts(there, {**FACTS, "platform": "second", "anew": True})


def flip(path, *, same_time=False):
    """Change one byte of one message; no index shows it."""
    raw, before = path.read_bytes(), path.stat()
    path.write_bytes(raw.replace(b" 12 xxx", b" 12 xyx", 1))
    assert path.read_bytes() != raw
    later_ns = 0 if same_time else 10**10
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns + later_ns))


def flip_unseen(path):
    flip(path, same_time=True)


def cut(path):
    with Index(path) as index:
        end = index.chunks[len(index.chunks) // 2].end
    path.write_bytes(path.read_bytes()[:end])


def remove(path):
    path.unlink()


DAMAGES = (flip, flip_unseen, cut, remove)


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("damage", DAMAGES)
def test_what_came_whole_is_kept_and_used_whatever_became_of_it_where_it_came_from(there, session, damage):
    fetch(there, session)
    good = digest(session / "second" / NAME)
    damage(there / NAME)  # the collection had failed, as for want of space; now it is asked for again
    for _ in range(2):
        listed_anew(there)
        fetch(there, session)
        assert digest(session / "second" / NAME) == good
        assert check_arrived(session / "second")["files"][0]["sha256"] == good
    summary = collect(plan(session))
    assert (summary.messages, summary.lost) == (600, ())
    assert not list((session / "second").glob(".*")), "nothing is put aside"


@pytest.mark.slow_rows(1)
@pytest.mark.parametrize("damage", DAMAGES)
def test_so_it_is_when_more_was_recorded_before_it_was_listed_anew(there, session, damage):
    fetch(there, session)
    collect(plan(session))
    before = multiset(session / "s1_m.bag")
    bag(there / "realsense-02.bag", rows("/c", 20, first_ms=9000))
    close_parts(there, {**FACTS, "platform": "second"})
    damage(there / NAME)
    listed_anew(there)
    fetch(there, session)
    summary = collect(plan(session))
    assert summary.messages == 620
    assert not before - multiset(session / "s1_m.bag")
    assert not [each for each in summary.lost if NAME in each]


def test_the_numbers_that_it_lacked_stay_missing(there, session):
    fetch(there, session)
    content = read_parts(session / "second")
    content["missing"] = {"/imu": 5, "/gps": 1}
    (session / "second" / PARTS).write_text(json.dumps(content))
    bag(there / "realsense-02.bag", rows("/c", 20, first_ms=9000))
    flip(there / NAME)
    listed_anew(there)
    fetch(there, session)
    assert read_parts(session / "second")["missing"] == {"/imu": 5, "/gps": 1}


def test_where_the_list_here_is_gone_the_checksum_tells_what_came_whole(there, session):
    fetch(there, session)
    good = digest(session / "second" / NAME)
    flip(there / NAME)
    listed_anew(there)
    (session / "second" / PARTS).unlink()
    fetch(there, session)
    assert digest(session / "second" / NAME) == good
    summary = collect(plan(session))
    assert (summary.messages, summary.lost) == (600, (f"second/{NAME}: an unknown number of messages",))


def test_what_never_came_whole_is_fetched_as_it_is_now(there, session):
    flip(there / NAME)
    listed_anew(there)
    fetch(there, session)
    assert digest(session / "second" / NAME) == digest(there / NAME)
    words = f"second/{NAME}: an unknown number of messages, it has changed since it was listed"
    assert collect(plan(session)).lost == (words,)
    assert collect(plan(session, duplicates="drop")).lost == (words,), "it is made again of what is here"


def test_what_went_bad_on_both_sides_is_put_aside_and_replaces_no_verified_recording(there, session):
    fetch(there, session)
    collect(plan(session))
    before, here = digest(session / "s1_m.bag"), session / "second" / NAME
    here.write_bytes(here.read_bytes().replace(b" 30 xx", b" 30 yx", 1))
    bad = digest(here)
    flip(there / NAME)
    listed_anew(there)
    fetch(there, session)
    assert (digest(here), digest(here.with_name(f".{NAME}.bad"))) == (digest(there / NAME), bad)
    bag(session / "main" / "states-02.bag", rows("/a", 20, first_ms=9000))
    close_parts(session / "main", FACTS)
    with pytest.raises(RecordingError, match=f"{NAME} is not what was recorded any more; both are kept"):
        collect(plan(session))
    assert digest(session / "s1_m.bag") == before


def test_another_bag_of_the_same_name_is_fetched_and_the_one_before_is_kept_aside(there, session):
    """The session was recorded again where its verified parts had been removed."""
    fetch(there, session)
    good = digest(session / "second" / NAME)
    (there / NAME).unlink()
    bag(there / NAME, rows("/c", 20, first_ms=9000))
    os.utime(there / NAME, ns=(time.time_ns(), time.time_ns() + 10**10))
    close_parts(there, {**FACTS, "platform": "second"})
    fetch(there, session)
    assert digest(session / "second" / NAME) == digest(there / NAME)
    assert digest(session / "second" / f".{NAME}.bad") == good


def test_a_bag_that_is_closed_at_last_is_there_once(there, session):
    (there / PARTS).unlink()
    (there / NAME).rename(there / f"{NAME}.active")
    active = there / f"{NAME}.active"
    entry = {"file": active.name, "bytes": active.stat().st_size, "sha256": digest(active), "open": True, "lost": None}
    (there / PARTS).write_text(json.dumps({"parts": 1, **FACTS, "files": [entry], "logs": []}))
    fetch(there, session)
    listed_anew(there)
    fetch(there, session)
    assert [each["file"] for each in read_parts(session / "second")["files"]] == [NAME]
    assert collect(plan(session)).messages == 600
