"""What may be removed in the end: what a part lists, and nothing else."""

import hashlib
import json

import pytest

from amaze_autonomy.recording.storage import remove_part

X = hashlib.sha256(b"x").hexdigest()
LISTED = [{"file": "a-01.bag"}, {"file": "a-02.recovered.bag", "recovered_from": "a-02.bag.active"}]
LISTED += [{"file": "a-03.bag", "recovered_from": "a-03.bag.active", "undo": "a-03.bag.undo"}]
VERIFIED = {entry["file"]: X for entry in LISTED}


def part(folder, entries):
    folder.mkdir(parents=True)
    for name in ("a-01.bag", "a-02.bag.active", "a-02.recovered.bag", "a-03.bag", "a-03.bag.undo", "notes.txt"):
        (folder / name).write_text("x")
    (folder / "parts.json").write_text(
        json.dumps({"parts": 1, "files": [{"bytes": 1, "sha256": X, **each} for each in entries]})
    )
    return folder


def left(folder):
    return sorted(path.name for path in folder.iterdir())


def test_only_what_a_part_lists_is_removed_and_only_within_the_recordings(tmp_path):
    inside, outside = part(tmp_path / "s1" / "main", LISTED), part(tmp_path / "x" / "y" / "z", LISTED)
    for folder in (inside, outside):
        remove_part(folder, tmp_path, VERIFIED)
    assert left(inside) == ["a-02.bag.active", "notes.txt", "parts.json"], "a damaged one may hold more than was found"
    assert len(left(outside)) == 7


def test_a_name_in_a_list_that_leads_elsewhere_removes_nothing(tmp_path):
    other = tmp_path / "other.bag"
    other.write_text("x")
    names = ["../../other.bag", str(other)]
    folder = part(tmp_path / "s1" / "main", [{"file": name} for name in names])
    remove_part(folder, tmp_path, dict.fromkeys(names, X))
    assert other.is_file()


@pytest.mark.parametrize("content", ["", "{}", '{"files": null}', '{"files": [{}]}'])
def test_a_folder_without_a_list_is_left_alone(tmp_path, content):
    folder = part(tmp_path / "s1" / "main", LISTED)
    (folder / "parts.json").write_text(content)
    remove_part(folder, tmp_path, VERIFIED)
    assert len(left(folder)) == 7


@pytest.mark.parametrize("verified", [{}, dict.fromkeys(VERIFIED, ""), dict.fromkeys(VERIFIED, "0" * 64)])
def test_who_does_not_know_the_checksums_of_the_verified_recording_removes_nothing(tmp_path, verified):
    folder = part(tmp_path / "s1" / "main", LISTED)
    remove_part(folder, tmp_path, verified)
    assert len(left(folder)) == 7


def test_a_file_that_is_not_in_the_verified_recording_as_it_is_here_stays(tmp_path):
    folder = part(tmp_path / "s1" / "main", LISTED)
    (folder / "a-01.bag").write_text("changed since")
    remove_part(folder, tmp_path, {name: X for name in VERIFIED if name != "a-02.recovered.bag"})
    assert left(folder) == ["a-01.bag", "a-02.bag.active", "a-02.recovered.bag", "notes.txt", "parts.json"]
