"""The command line: what it prints, what it writes, and its exit status."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from replay_bags import ROOT, START_NS, break_chunk, flight_rows, number, write_bag, write_empty_bag

from amaze_autonomy.bags.recording import Indexed, Library
from amaze_autonomy.tester import command
from amaze_autonomy.tester.command import main


def test_a_replay_prints_timeline_figures_checks_and_verdict(flight_bag, flight_map, capsys):
    assert main(["run", str(flight_bag), "--map", flight_map]) == 0
    out = capsys.readouterr().out
    assert "    +8.800  bag         landing detection: AIRBORNE  in the air\n" in out
    assert "Recording: 35.980 s, 3672 messages of 6 topics\n" in out
    assert f"  {'/imu':<40}    1800 messages     50.00 Hz  longest gap 0.020 s at +0.000 s\n" in out
    assert f"  {'battery':<40} bag\n" in out
    assert out.endswith("Map flight, mission 1: ends in MISSION_ENDED (COMPLETE) after 11 decisions.\n")


def test_the_folder_holds_journal_timeline_result_and_page(tmp_path, flight_bag, flight_map, capsys):
    out = tmp_path / "made" / "here"
    assert main(["run", str(flight_bag), "--map", flight_map, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    names = sorted(path.name for path in out.iterdir())
    assert names == ["flight.html", "journal.jsonl", "result.json", "timeline.txt"]
    assert (out / "timeline.txt").read_text() == printed
    result = json.loads((out / "result.json").read_text())
    assert (result["state"], result["result"], result["mission"], result["damage"]) == (
        "MISSION_ENDED",
        "COMPLETE",
        "1",
        [],
    )
    assert main(["journal", str(out / "journal.jsonl")]) == 0


def test_json_is_the_result_file(tmp_path, flight_bag, flight_map, capsys):
    assert main(["run", str(flight_bag), "--map", flight_map, "--json", "--out", str(tmp_path / "o")]) == 0
    assert capsys.readouterr().out == (tmp_path / "o" / "result.json").read_text()


def test_the_journal_that_is_written_is_replayed_without_difference(tmp_path, flight_bag, flight_map):
    out = tmp_path / "result"
    for _ in range(2):  # what a replay wrote, another one replaces
        assert main(["run", str(flight_bag), "--map", flight_map, "--out", str(out)]) == 0
        assert main(["journal", str(out / "journal.jsonl")]) == 0


@pytest.fixture
def session(tmp_path):
    """A folder as the collector leaves it, without its bag: what the flight wrote is nowhere else."""
    folder = tmp_path / "session"
    folder.mkdir()
    (folder / "journal.jsonl").write_text('{"kind":"header","program":"engine","version":3}\n')
    (folder / "flight.html").write_text("<!DOCTYPE html>\n<title>Flight 20261121T010929-001</title>\n")
    return folder


@pytest.mark.parametrize("kept", ["journal.jsonl", "flight.html", "result.json", "timeline.txt"])
def test_what_a_flight_wrote_is_not_replaced(session, flight_bag, flight_map, capsys, kept):
    (session / "result.json").write_text("{}\n")
    (session / "timeline.txt").write_text("the pilot took over\n")
    for other in {path.name for path in session.iterdir()} - {kept}:
        (session / other).unlink()
    before = (session / kept).read_text()
    assert main(["run", str(flight_bag), "--map", flight_map, "--out", str(session)]) == 2
    said = f"{session / kept}: is not of a replay, and would be replaced; name another folder with --out"
    assert capsys.readouterr().err == f"amaze-replay: {said}\n"
    assert [path.name for path in session.iterdir()] == [kept]
    assert (session / kept).read_text() == before


def test_a_journal_that_cannot_be_read_is_not_replaced(session, flight_bag, flight_map):
    (session / "flight.html").unlink()
    for content in (b"", b"\xff\xfe", b"[]\n", b"program: amaze-replay\n"):
        (session / "journal.jsonl").write_bytes(content)
        assert main(["run", str(flight_bag), "--map", flight_map, "--out", str(session)]) == 2
        assert (session / "journal.jsonl").read_bytes() == content


def test_no_page_is_no_reason_to_refuse_a_folder_with_one(session, flight_bag, flight_map):
    (session / "journal.jsonl").unlink()
    assert main(["run", str(flight_bag), "--map", flight_map, "--out", str(session), "--no-html"]) == 0


def test_results_are_not_written_beside_a_recording(tmp_path, flight_bag, flight_map, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "linked").symlink_to(tmp_path)
    for out in (".", str(tmp_path), "linked"):
        assert main(["run", flight_bag.name, "--map", flight_map, "--out", out]) == 2
        words = f"{out}: holds the recording {flight_bag.name}, and a journal and a page may be its own"
        assert capsys.readouterr().err == f"amaze-replay: {words}; name another folder with --out\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["flight.bag", "linked"]


@pytest.mark.parametrize("name", ["flight.html", "journal.jsonl"])
def test_a_page_replaces_neither_the_page_of_a_flight_nor_another_file(session, flight_bag, flight_map, capsys, name):
    before = (session / name).read_text()
    assert main(["run", str(flight_bag), "--map", flight_map, "--html", str(session / name)]) == 2
    said = f"{session / name}: is no page of a replay, and would be replaced; name another file with --html"
    assert capsys.readouterr().err == f"amaze-replay: {said}\n"
    assert (session / name).read_text() == before


def test_a_file_is_no_folder_and_a_folder_no_file(session, flight_bag, flight_map, capsys):
    for option, place, words in (
        ("--out", session / "journal.jsonl", "is no folder; name a folder with --out"),
        ("--out", flight_bag, "is no folder; name a folder with --out"),
        ("--html", session, "is a folder; name a file with --html"),
    ):
        assert main(["run", str(flight_bag), "--map", flight_map, option, str(place)]) == 2
        assert capsys.readouterr() == ("", f"amaze-replay: {place}: {words}\n")


def test_a_page_of_a_replay_replaces_one(tmp_path, flight_bag, flight_map):
    for _ in range(2):
        assert main(["run", str(flight_bag), "--map", flight_map, "--html", str(tmp_path / "page.html")]) == 0


def test_the_page_of_a_journal_replaces_a_page_and_nothing_else(tmp_path, flight_bag, flight_map, capsys):
    out = tmp_path / "result"
    assert main(["run", str(flight_bag), "--map", flight_map, "--out", str(out)]) == 0
    journal = str(out / "journal.jsonl")
    assert main(["journal", journal, "--html", str(out / "flight.html")]) == 0
    assert "<title>Flight journal" in (out / "flight.html").read_text("utf-8")
    capsys.readouterr()
    assert main(["journal", journal, "--html", journal]) == 2
    said = "is one of the inputs, which are never changed; name another file with --html"
    assert capsys.readouterr().err == f"amaze-replay: {journal}: {said}\n"
    assert main(["journal", journal, "--html", str(out / "result.json")]) == 2
    said = "is no page, and would be replaced; name another file with --html"
    assert capsys.readouterr().err == f"amaze-replay: {out / 'result.json'}: {said}\n"


def test_another_rule_decides_otherwise(tmp_path, flight_map, capsys):
    bag = write_bag(tmp_path / "x.bag", flight_rows(silent={"/imu": (20.0, 20.6)}))
    main(["run", str(bag), "--map", flight_map])
    assert "MISSION -> LAND" in capsys.readouterr().out
    changed = ["--set", "sensors.components.imu.severity=low", "--set", "sensors.components.imu.wait_limit_s=1"]
    main(["run", str(bag), "--map", flight_map, *changed[:2]])
    assert "MISSION -> LAND" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments,message",
    [
        (
            ["run", "{bag}"],
            "which topics are what? Name a topic map with --map: a file that `amaze-replay map` proposes",
        ),
        (["run", "{bag}", "--map", "nowhere"], "nowhere: is no topic map; name a file, or one of amaze_demo, "),
        (["run", "{bag}", "--map", "{map}", "--mission", "99"], "there is no mission '99'; there are 1, "),
        (["run", "{bag}", "--map", "{map}", "--mute", "/nope"], "/nope: no bag has this topic; there are /armed, "),
        (["run", "{bag}", "--map", "husky_outdoor_drive"], "x.bag: no message of /imu/data, /fix, /husky_velocity"),
        (["run", "{bag}", "--map", "{map}", "--config", "{folder}/nope"], "{folder}/nope: is not a folder; must hold"),
        (["run", "{folder}/nope.bag", "--map", "{map}"], "{folder}/nope.bag: is no file; name a bag"),
        (["run", "{empty}", "--map", "{map}"], "empty.bag: there is no message in it"),
        (["run", "{empty}"], "empty.bag: there is no message in it"),
        (["run", "{empty}", "{bag}"], "which topics are what? Name a topic map with --map: "),
        (
            ["run", "{map}", "--map", "{map}"],
            "{map}: is no recording; name a ROS 1 bag, a ROS 2 bag, an MCAP file, a ULog or a telemetry log",
        ),
        (["run", "{bag}", "--map", "{map}", "--out", "{bag}/out"], "{bag}/out: "),
        (["journal", "{folder}/nope"], "{folder}/nope: cannot be read (No such file or directory)"),
    ],
)
def test_what_cannot_be_replayed_is_one_line_and_exit_status_2(tmp_path, flight_map, capsys, arguments, message):
    write_empty_bag(tmp_path / "empty.bag")
    bag = write_bag(tmp_path / "x.bag", flight_rows(4.0))
    words = {"bag": bag, "map": flight_map, "folder": tmp_path, "empty": tmp_path / "empty.bag"}
    assert main([argument.format(**words) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"amaze-replay: {message.format(**words)}")
    assert error.count("\n") == 1


def test_a_recording_that_is_named_twice_is_refused(tmp_path, flight_map, flight_bag, capsys):
    other = tmp_path / "other.bag"
    other.symlink_to(flight_bag)
    assert main(["run", str(flight_bag), str(other), "--map", flight_map]) == 2
    assert capsys.readouterr().err == f"amaze-replay: {other}: is the same recording as {flight_bag}; name it once\n"


def test_a_damaged_recording_is_replayed_with_exit_status_3(tmp_path, flight_map, capsys):
    bag = write_bag(tmp_path / "x.bag", flight_rows(), "bz2")
    break_chunk(bag, -1, 60, 100)
    assert main(["run", str(bag), "--map", flight_map]) == 3
    assert "DAMAGED: " in capsys.readouterr().out


def test_an_error_of_the_program_itself_is_told_from_a_difference(flight_bag, flight_map, capsys, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("by the test")

    monkeypatch.setattr(command, "make_plan", broken)
    assert main(["run", str(flight_bag), "--map", flight_map]) == 70
    assert "ZeroDivisionError: by the test" in capsys.readouterr().err


def test_a_reader_that_has_enough_is_no_error(flight_bag, flight_map):
    command = f'"{sys.executable}" -m amaze_autonomy.tester.command run "{flight_bag}" --map "{flight_map}" | head -1; '
    command += 'echo "${PIPESTATUS[0]}"'
    environment = {"PYTHONPATH": str(ROOT / "src"), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(
        ["bash", "-c", command], env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stderr, done.stdout.splitlines()[-1]) == ("", "0")


@pytest.mark.parametrize("verb", ["run", "map", "export"])
def test_the_help_names_every_kind_of_recording_that_is_read(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "a ROS 1 bag, a ROS 2 bag, an MCAP file, a ULog or a telemetry log" in said


def test_the_maps_are_listed(capsys):
    assert main(["maps"]) == 0
    assert "husky_outdoor_drive          Husky rover, outdoors" in capsys.readouterr().out


def test_the_map_is_the_one_named_as_the_bag(tmp_path, capsys):
    bag = write_bag(
        tmp_path / "example_lz4.bag", [(START_NS + t, "/turtle1/pose", number(t % 250)) for t in range(2000)]
    )
    assert main(["run", str(bag)]) == 0
    assert "Map example_lz4, mission 1" in capsys.readouterr().out


def test_no_ros_is_needed():
    code = "import sys; sys.modules['rospy'] = None; import amaze_autonomy.tester.command as c; print(c.main(['maps']))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={"PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.stderr, done.stdout.splitlines()[-1]) == ("", "0")


@pytest.mark.parametrize("reader", [Indexed, Library])
def test_a_chunk_that_takes_more_memory_than_is_said_is_damage_unless_that_is_permitted(
    tmp_path, flight_map, capsys, monkeypatch, reader
):
    monkeypatch.setattr("amaze_autonomy.bags.recording.opened", reader)
    bag = write_bag(tmp_path / "large.bag", flight_rows(150.0), "bz2", chunk_bytes=10**9)
    command_line = ["run", str(bag), "--map", flight_map, "--memory"]
    assert main([*command_line, "1"]) == 3
    assert "takes 4 MB of memory, 1 may be taken (--memory 4 permits it)" in capsys.readouterr().out
    assert main([*command_line, "4"]) == 0
    assert "may be taken" not in capsys.readouterr().out
