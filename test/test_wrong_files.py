"""Every command that reads files says in one line what is wrong with one, and where, and ends with its own status."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest
from pymavlink.dialects.v20.common import MAVLink, MAVLink_heartbeat_message

from amaze_autonomy import cli
from amaze_autonomy.bags import cli as bags_cli
from amaze_autonomy.tester import command

PROGRAMS = {
    "amaze-bag": (bags_cli.main, bags_cli._parser()),
    "amaze-replay": (command.main, command._parser(scenarios=True)),
    "amaze-autonomy": (cli.main, cli._parser()),
}
BAGS, SCENARIO = (".bag", ".mcap"), (".scenario.yaml",)
RECORDINGS, JOURNALS = (*BAGS, ".tlog", ".ulg"), (".jsonl", ".bag")
COMMANDS = {
    **{f"amaze-bag {verb}": ("{}", BAGS, 1) for verb in ("info", "doctor", "verify")},
    **{f"amaze-bag {verb}": ("{} -o new.bag", BAGS, 1) for verb in ("recover", "merge", "filter", "cut")},
    "amaze-replay run": ("{}", RECORDINGS, 2),
    "amaze-replay run --html": ("{} --map mavros --html new.html", RECORDINGS, 2),
    "amaze-replay run --map": ("{} --map {}", (".yaml",), 2),
    "amaze-replay map": ("{}", RECORDINGS, 2),
    "amaze-replay export": ("{} -o new.mcap", RECORDINGS, 2),
    "amaze-replay journal": ("{}", JOURNALS, 2),
    "amaze-replay journal --html": ("{} --html new.html", JOURNALS, 2),
    "amaze-replay laws": ("{}", JOURNALS, 2),
    "amaze-replay agree": ("{} {}", JOURNALS, 2),
    # A mistake in a scenario is the result ERROR of that test (1); where there is none at all, it is wrong use (2).
    **{f"amaze-replay {verb}": ("{}", SCENARIO, (1, 2)) for verb in ("test", "coverage")},
    "amaze-replay test --html": ("{} --html new.html", SCENARIO, (1, 2)),
    "amaze-replay corpus": ("{} -j 1", SCENARIO, (1, 2)),
    "amaze-replay accept": ("{} --reason because_it_is_right", SCENARIO, (1, 2)),
    "amaze-replay mutate": ("{} --only nothing", SCENARIO, (0, 1, 2)),
    "amaze-replay what-if": ("{} --against autonomy.require_go=true", SCENARIO, (1, 2)),
    "amaze-replay sweep": ("{} --to 2", SCENARIO, 2),
    "amaze-replay sweep --html": ("{} --to 2 --html new.html", SCENARIO, 2),
    "amaze-replay shrink": ("{}", SCENARIO, 2),
    "amaze-autonomy propose-config": ("{} --output new", RECORDINGS, 1),
    "amaze-autonomy check-config": ("{}", (".yaml",), 1),
    "amaze-autonomy missions": ("{}", (".yaml",), 1),
    "amaze-autonomy doctor": ("{}", (".yaml",), 1),
    "amaze-autonomy import-cns": ("{} --output new", (".yaml",), 1),
}
"""By program and command, with what is special: arguments, endings, exit status."""

NO_FILES = {"amaze-replay maps", "amaze-autonomy docs", "amaze-autonomy simulate", "amaze-autonomy vehicle"}
WRONG = ("nothing{}", "folder", "/etc/hosts", "empty{}", "words{}")


def test_each_command_that_reads_files_is_tested_here():
    names = set()
    for program, (_, parser) in PROGRAMS.items():
        (table,) = [each for each in parser._actions if isinstance(each, argparse._SubParsersAction)]
        names |= {f"{program} {name}" for name in table.choices}
    assert {" ".join(name.split()[:2]) for name in COMMANDS} == names - NO_FILES


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")  # nobody is there
    Path("folder").mkdir()


CASES = dict.fromkeys(
    (name, wrong.format(ending)) for name, (_, endings, _) in COMMANDS.items() for ending in endings for wrong in WRONG
)


#: Of scenarios: what is said of a file beside the table of results, which has its line.
IN_A_TABLE = {"test": 0, "what-if": 0, "corpus": 3}


@pytest.mark.parametrize("name, file", CASES)
def test_a_wrong_file_is_one_line(capsys, name, file):
    program, verb, *_ = name.split()
    arguments, _, statuses = COMMANDS[name]
    if file.startswith(("empty", "words")):
        Path(file).write_text("" if file.startswith("empty") else "these are only words\nand more\n")
    status = PROGRAMS[program][0]([verb, *arguments.replace("{}", file).split()])
    out, err = capsys.readouterr()
    assert status in (statuses if isinstance(statuses, tuple) else (statuses,)), err
    assert any(f"{file}{end}" in err + out for end in (": ", ":1: ", "/")), err + out
    assert "Traceback" not in err
    there = file.startswith(("empty", "words", "/"))
    assert len(err.splitlines()) == (IN_A_TABLE.get(verb, 1) if there else 1), err


LOG = bytes.fromhex("00053e1d9c1d8000fd0900000001010000")
OTHER_KINDS = {
    "x.tlog": (LOG, "a telemetry log of MAVLink; name a journal or a bag; `amaze-replay run` replays it"),
    "x.mcap": (b"\x89MCAP0\r\n", "an MCAP file; name a journal or a bag; `amaze-replay run` replays it"),
    "x.bag.gz": (b"\x1f\x8b\x08\x08", "compressed with gzip; unpack it first"),
    "x.bin": (
        b"\xa3\x95\x80\x80",
        "a DataFlash log of ArduPilot; of the same flight, a telemetry log (.tlog) or a bag can be read",
    ),
}


@pytest.mark.parametrize("verb", ["journal", "laws", "agree"])
@pytest.mark.parametrize("file", OTHER_KINDS)
def test_a_file_that_is_no_journal_is_told_by_its_kind(capsys, verb, file):
    content, words = OTHER_KINDS[file]
    Path(file).write_bytes(content)
    assert command.main([verb, file, *([file] if verb == "agree" else [])]) == 2
    assert capsys.readouterr() == ("", f"amaze-replay: {file}: is no journal but {words}\n")


def test_a_log_of_mavlink_alone_has_no_topics_to_watch(capsys):
    log = Path("x.tlog")
    time_us = 1_600_000_000_000_000
    heartbeat = MAVLink_heartbeat_message(2, 12, 81, 0, 3, 3)
    link = MAVLink(None, srcSystem=1, srcComponent=1)
    log.write_bytes(b"".join((time_us + n * 100_000).to_bytes(8, "big") + heartbeat.pack(link) for n in range(20)))
    assert cli.main(["propose-config", str(log), "--output", "new"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        "propose-config: these are messages of MAVLink, no ROS topics, and only those can be watched"
    )
    assert "`amaze-replay map`" in line
    assert not Path("new").exists()


@pytest.mark.parametrize("command", [("doctor",), ("propose-config", "--live")])
def test_nothing_is_said_of_a_graph_that_is_not_there(capsys, command):
    pytest.importorskip("rospy", reason="without ROS that is what is said")
    assert cli.main([*command, "--for", "0.1"]) == 3
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"{command[0]}: no ROS master answers at http://localhost:1: start it, or set ROS_MASTER_URI"


@pytest.mark.parametrize("command", [("doctor",), ("propose-config", "--live")])
@pytest.mark.parametrize(
    "uri", ["127.0.0.1:11977", "localhost:11311", "", "foo://here:1", "http://:1", "http://a:b", "http://a b:11311"]
)
def test_an_address_that_no_master_can_have_is_one_line(capsys, monkeypatch, command, uri):
    pytest.importorskip("rospy", reason="without ROS that is what is said")
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    assert cli.main([*command, "--for", "0.1"]) == 3
    assert capsys.readouterr().err == f"{command[0]}: ROS_MASTER_URI is {uri!r}; must be http://HOST:PORT\n"


def test_a_first_configuration_needs_something_to_look_at(capsys):
    assert cli.main(["propose-config"]) == 2
    assert capsys.readouterr().err == "propose-config: name recordings, or say --live\n"
