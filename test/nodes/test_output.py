"""The folder of a run: what earlier runs left is kept, and an unfinished one is found."""

from __future__ import annotations

import json
import os

import pytest

pytest.importorskip("rospy")

from launched import launched

from amaze_autonomy.engine.events import EngineStarted, Tick
from amaze_autonomy.engine.rules import Rules
from amaze_autonomy.journal import journal as codec
from amaze_autonomy.nodes.autonomy import run_folder
from amaze_autonomy.ros.errors import StartError

EVENTS = [EngineStarted(t_ns=5), Tick(t_ns=9)]


def write_journal(folder, boot_id=None, more=""):
    header = codec.make_header(Rules(), {}, "hash", boot_id=boot_id or run_folder.boot_id())
    text = "".join(line + "\n" for line in [codec.encode_header(header), *map(codec.encode_event, EVENTS)])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "journal.jsonl").write_text(text + more)


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    return tmp_path / "amaze_autonomy"


def test_a_run_without_a_folder_gets_a_new_one_of_its_label(home):
    assert run_folder.make_folder("", "20261121T101500") == home / "20261121T101500"
    assert run_folder.make_folder("", "20261121T101500") == home / "20261121T101500-2"


def test_a_named_folder_is_made(tmp_path):
    assert run_folder.make_folder(str(tmp_path / "a" / "b"), "label") == tmp_path / "a" / "b"


def test_what_an_earlier_run_left_in_a_named_folder_is_kept(tmp_path):
    for number in ("first", "second"):
        (tmp_path / "journal.jsonl").write_text(number)
        (tmp_path / "result.json").write_text(number)
        run_folder.make_folder(str(tmp_path), "label")
    assert (tmp_path / "earlier" / "journal.jsonl").read_text() == "first"
    assert (tmp_path / "earlier-2" / "result.json").read_text() == "second"
    assert not (tmp_path / "journal.jsonl").exists()


def test_a_folder_that_cannot_be_made_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StartError, match="name another one with --output"):
        run_folder.make_folder(str(tmp_path / "file" / "folder"), "label")


def test_a_journal_without_an_end_is_found_with_its_events(tmp_path):
    write_journal(tmp_path, more='{"half')
    found = run_folder.find_unfinished(str(tmp_path))
    assert (found.path, found.events, found.last_ns) == (tmp_path / "journal.jsonl", EVENTS, 9)
    assert found.header["hash"] == "hash"


def test_a_run_that_ended_is_not_unfinished(tmp_path):
    write_journal(tmp_path)
    run_folder.write_result(tmp_path, {"in_flight": False})
    assert run_folder.find_unfinished(str(tmp_path)) is None


def test_a_run_that_was_ended_in_flight_is(tmp_path):
    write_journal(tmp_path)
    run_folder.write_result(tmp_path, {"in_flight": True})
    assert run_folder.find_unfinished(str(tmp_path)) is not None


def test_a_journal_of_another_boot_is_no_use(tmp_path):
    write_journal(tmp_path, boot_id="another")
    assert run_folder.find_unfinished(str(tmp_path)) is None


def test_without_a_named_folder_the_newest_run_counts(home):
    for number, name in enumerate(("b", "a")):
        write_journal(home / name)
        os.utime(home / name / "journal.jsonl", (number, number))
    assert run_folder.find_unfinished("").path == home / "a" / "journal.jsonl"
    run_folder.write_result(home / "a", {"in_flight": False})
    assert run_folder.find_unfinished("") is None, "an older run is not the one that was interrupted"


def test_a_simulated_run_that_did_not_end_is_none_that_a_flight_goes_on_with(home):
    runs = str(home / "simulated")
    folder = run_folder.make_folder("", "a", runs)
    assert folder == home / "simulated" / "a"
    write_journal(folder)
    assert run_folder.find_unfinished("", runs).path == folder / "journal.jsonl"
    assert run_folder.find_unfinished("") is None


@pytest.mark.parametrize(
    "given, runs, recordings",
    [
        ((), "", ""),
        (("output:=/data/run",), "", ""),
        (("simulation:=true",), "simulated", "simulated/recordings/main"),
        (("simulation:=true", "output:=/data/run"), "simulated", "/data/run/recordings/main"),
        (("simulation:=true", "recordings:=/data/all"), "simulated", "/data/all/main"),
    ],
)
def test_what_is_simulated_never_lies_among_the_flights(given, runs, recordings, tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    _, words = launched("autonomy.launch", *given)
    home = tmp_path / "amaze_autonomy"
    assert words["autonomy"]["runs"] == (str(home / runs) if runs else "")
    assert words["data_recorder_main"]["folder"] == (str(home / recordings) if recordings else "")


@pytest.mark.usefixtures("home")
def test_where_nothing_is_nothing_is_found(tmp_path):
    assert run_folder.find_unfinished("") is None
    assert run_folder.find_unfinished(str(tmp_path / "nowhere")) is None


def test_a_damaged_journal_is_said(tmp_path):
    write_journal(tmp_path, more="nonsense\n")
    with pytest.raises(StartError, match="cannot be read: line 4: not JSON"):
        run_folder.find_unfinished(str(tmp_path))


def test_the_result_is_whole_or_not_there(tmp_path):
    run_folder.write_result(tmp_path, {"b": 1, "a": "x"})
    assert json.loads((tmp_path / "result.json").read_text()) == {"a": "x", "b": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]
