"""What is done again when a verification failed, and what is never written over for it."""

import json

import pytest
from bag_tools import digest, multiset, rows
from part_tools import FACTS, part, plan, two_platforms

from amaze_autonomy.bags.errors import BagError
from amaze_autonomy.bags.index import Index
from amaze_autonomy.recording import job
from amaze_autonomy.recording.errors import RecordingError
from amaze_autonomy.recording.job import collect
from amaze_autonomy.recording.parts import close_parts

MERGES_AGAIN = "rosbag cannot read it; the parts are kept, retry merges again"


@pytest.fixture
def session(tmp_path):
    return two_platforms(tmp_path)


@pytest.fixture
def merges(monkeypatch):
    """Return the list of what was merged."""
    found, merge = [], job.merge

    def merging(inputs, output, *arguments):
        found.append(output.name)
        return merge(inputs, output, *arguments)

    monkeypatch.setattr(job, "merge", merging)
    return found


def verdict(session):
    return json.loads((session / "s1_m.manifest.json").read_text())["verified"]


def flip(path):
    """Change one byte of one message; no index shows it."""
    raw = path.read_bytes()
    path.write_bytes(raw.replace(b" 12 xxx", b" 12 xyx", 1))
    assert path.read_bytes() != raw


def destroy(path):
    """Destroy the head of a record, so that what is behind it cannot be read."""
    with Index(path) as index:
        data = index.head(len(index.chunks) - 1).data
    raw = bytearray(path.read_bytes())
    raw[data + 4 : data + 8] = b"\xff\xff\xff\xff"
    path.write_bytes(raw)


def verification(monkeypatch, *problems):
    """Have the next verifications find these problems, one after another."""
    left, verify = [*problems], job.verify

    def verifying(*arguments, **options):
        found = verify(*arguments, **options)
        return found._replace(problems=(left.pop(0),)) if left else found

    monkeypatch.setattr(job, "verify", verifying)


def test_after_a_failed_verification_a_retry_merges_again(session, merges, monkeypatch):
    verification(monkeypatch, "rosbag cannot read it")
    with pytest.raises(RecordingError, match=MERGES_AGAIN):
        collect(plan(session))
    assert verdict(session)["ok"] is False
    assert collect(plan(session)).messages == 900
    assert (merges, verdict(session)["ok"]) == (["s1_m.bag"] * 2, True)
    collect(plan(session))
    assert len(merges) == 2, "and what is verified is not made again"


@pytest.mark.parametrize("damage", [flip, destroy])
def test_a_recording_that_was_damaged_since_is_merged_again_at_once(session, merges, damage):
    collect(plan(session))
    output = session / "s1_m.bag"
    before = digest(output)
    damage(output)
    assert collect(plan(session)).messages == 900
    assert (digest(output), merges, verdict(session)["ok"]) == (before, ["s1_m.bag"] * 2, True)


def test_what_fails_again_is_merged_once_for_each_retry(session, merges, monkeypatch):
    collect(plan(session))
    verification(monkeypatch, *["rosbag cannot read it"] * 3)
    for count in (2, 3):
        with pytest.raises(RecordingError, match=MERGES_AGAIN):
            collect(plan(session))
        assert len(merges) == count
    assert collect(plan(session)).messages == 900


def test_a_verification_that_could_not_be_finished_is_no_success(session, monkeypatch):
    collect(plan(session))

    def unreadable(*_arguments, **_options):
        raise BagError("s1_m.bag", "is damaged", "")

    monkeypatch.setattr(job, "verify", unreadable)
    with pytest.raises(BagError, match="is damaged"):
        collect(plan(session))
    assert (verdict(session)["ok"], len(verdict(session)["problems"])) == (False, 1)


def test_it_is_made_again_when_duplicates_are_to_be_dropped_or_kept_now(tmp_path, merges):
    session = tmp_path / "s1_m"
    for name in ("main", "second"):
        part(session / name, (f"{name}-01.bag", [rows("/a", 50)]))
    for duplicates, messages in (("count", 100), ("drop", 50), ("drop", 50), ("ignore", 100)):
        assert collect(plan(session, duplicates=duplicates)).messages == messages
    assert len(merges) == 3


@pytest.mark.parametrize("damage", [flip, destroy])
def test_a_recording_is_never_written_over_when_its_parts_are_not_what_was_recorded_any_more(session, merges, damage):
    """The disk of the collector's own part, which no network brought, went bad: the recording is the only copy."""
    collect(plan(session))
    output, own = session / "s1_m.bag", session / "main" / "states-01.bag"
    before, whole = digest(output), own.read_bytes()
    damage(own)
    words = r"s1_m\.bag: is not made again, .*states-01\.bag is not what was recorded any more; both are kept"
    for duplicates in ("count", "count", "drop"):
        with pytest.raises(RecordingError, match=words):
            collect(plan(session, duplicates=duplicates))
        assert (digest(output), len(merges)) == (before, 1)
    own.write_bytes(whole)
    assert collect(plan(session)).messages == 900
    assert multiset(output) == multiset(own, session / "second" / "realsense-01.bag")


def test_nor_when_one_that_became_zeros_was_recovered_and_listed_anew(session, merges):
    collect(plan(session))
    output, own = session / "s1_m.bag", session / "main" / "states-01.bag"
    before, size = digest(output), own.stat().st_size
    own.write_bytes(own.read_bytes()[: size // 2] + bytes(size - size // 2))
    close_parts(session / "main", {**FACTS, "anew": True})
    with pytest.raises(RecordingError, match=r"states-01\.bag is not what was recorded any more; both are kept"):
        collect(plan(session))
    assert (digest(output), len(merges)) == (before, 1)


def test_a_recording_that_failed_its_verification_is_kept_when_its_parts_are_gone(session, monkeypatch):
    verification(monkeypatch, "rosbag cannot read it")
    with pytest.raises(RecordingError):
        collect(plan(session))
    before = digest(session / "s1_m.bag")
    for name in ("main", "second"):
        for path in (session / name).glob("*.bag"):
            path.unlink()
        part(session / name, ("states-02.bag", [rows("/a", 20, first_ms=9000)]), platform=name)
    assert collect(plan(session)).location == str(session / "s1_m-2.bag")
    assert digest(session / "s1_m.bag") == before
