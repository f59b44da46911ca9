"""`amaze-autonomy simulate` as its user sees it."""

import json
import shutil

import pytest

from amaze_autonomy import paths
from amaze_autonomy.journal import journal
from amaze_autonomy.simulation.cli import COMPLETE, LIMIT, NOT_COMPLETE, USAGE, WAITING, main

NAMES = ", ".join(sorted(path.stem for path in (paths.config_folder() / "faults").iterdir()))
THERE_ARE = f"(a component's name alone is none); there is {NAMES}"


def simulated(capsys, *arguments):
    """Return exit status, output and errors."""
    status = main(list(arguments))
    said = capsys.readouterr()
    return status, said.out, said.err


def test_tells_the_story_of_a_mission_and_its_result(capsys):
    status, out, err = simulated(capsys)
    assert (status, err) == (COMPLETE, "")
    lines = out.splitlines()
    assert lines[0] == "scenario: nothing goes wrong"
    assert lines[-1] == "mission 1: COMPLETE"
    assert any("READY -> START_RECORDING" in line for line in lines)
    times = [float(line.split()[0]) for line in lines[2:-2]]
    assert times == sorted(times)


@pytest.mark.parametrize(
    "arguments, status, last",
    [
        (("--mission", "1,3"), COMPLETE, "mission 3: COMPLETE"),
        (("--faults", "mission_camera"), NOT_COMPLETE, "mission 1: LANDED_EARLY"),
        (("--faults", "data_lost"), NOT_COMPLETE, "mission 1: COMPLETE, data INCOMPLETE"),
        (("--faults", "battery_low"), WAITING, "MISSION_INPUT: waits for a person"),
        (("--set", "autonomy.require_go=true"), WAITING, "OUTREACH: waits for a person"),
        (("--limit", "30"), LIMIT, "MISSION: not finished within the limit of simulated time"),
    ],
    ids=["complete", "landed early", "data incomplete", "waiting", "nobody gives the go", "limit"],
)
def test_the_exit_status_says_how_it_ended(capsys, arguments, status, last):
    told, out, _ = simulated(capsys, *arguments)
    assert (told, out.splitlines()[-1]) == (status, last)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (("--mission", "9"), "simulate: there is no mission '9'; there is 1, 2, 3, 4, 5\n"),
        (("--faults", "lfr"), f"simulate: there is no scenario 'lfr' {THERE_ARE}; did you mean lrf?\n"),
        (("--faults", "zzz"), f"simulate: there is no scenario 'zzz' {THERE_ARE}\n"),
        (
            ("--faults", "no/such.yaml"),
            "simulate: no/such.yaml: cannot be read (No such file or directory); must be a readable file\n",
        ),
        (
            ("--journal", "/no/such/folder/out.jsonl"),
            "simulate: /no/such/folder/out.jsonl: No such file or directory\n",
        ),
    ],
)
def test_a_mistake_is_one_line_and_an_exit_status(capsys, arguments, words):
    status, out, err = simulated(capsys, *arguments)
    assert (status, out, err) == (USAGE, "", words)


def test_where_there_are_no_scenarios_it_is_said_where_that_is(capsys, tmp_path):
    shutil.copytree(paths.config_folder() / "mavros", tmp_path / "mine")
    status, _, err = simulated(capsys, "--config", str(tmp_path / "mine"), "--faults", "lrf")
    assert (status, err) == (
        USAGE,
        f"simulate: there is no scenario 'lrf': {tmp_path}/mine/faults has none at all; name a file\n",
    )


def test_a_mistake_in_a_scenario_is_told_with_its_line(capsys, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("description: mine\nfaults:\n  - component: lidar\n    fault: silent\n")
    status, _, err = simulated(capsys, "--faults", str(file))
    assert status == USAGE
    assert err.startswith(f"simulate: {file}:3: there is no component 'lidar'; there is gps, imu")


def test_a_mistake_in_the_configuration_is_told(capsys):
    status, _, err = simulated(capsys, "--set", "autonomy.requre_go=true")
    assert status == USAGE
    assert "did you mean require_go?" in err


def test_writes_a_journal_that_can_be_read(capsys, tmp_path):
    file = tmp_path / "out.jsonl"
    simulated(capsys, "--faults", "lrf", "--seed", "3", "--journal", str(file))
    lines = journal.read(file.read_text()).lines
    assert {line.kind for line in lines} == {"header", "event", "decision"}
    header = lines[0].payload
    assert (header["seed"], header["writer"]) == (3, "simulate")


def test_a_journal_replaces_one_of_a_simulation_and_nothing_else(capsys, tmp_path):
    flown, scenario = tmp_path / "journal.jsonl", tmp_path / "mine.yaml"
    flown.write_text('{"kind":"header","version":3,"writer":"engine"}\n')
    scenario.write_text("description: nothing\n")
    files = {path: path.read_bytes() for path in (flown, scenario)}
    for path, wrong in (
        (flown, "is no journal of a simulation, and would be replaced; name another file with --journal"),
        (scenario, "is one of the inputs, which are never changed; name another file with --journal"),
        (tmp_path, "is a folder; name a file with --journal"),
    ):
        said = simulated(capsys, "--faults", str(scenario), "--journal", str(path))
        assert said == (USAGE, "", f"simulate: {path}: {wrong}\n")
    assert {path: path.read_bytes() for path in files} == files
    own = tmp_path / "out.jsonl"
    own.write_text("")
    for _ in range(2):
        assert simulated(capsys, "--journal", str(own))[0] == COMPLETE
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["journal.jsonl", "mine.yaml", "out.jsonl"]


def test_prints_json_for_programs(capsys):
    status, out, _ = simulated(capsys, "--faults", "lrf", "--json")
    told = json.loads(out)
    assert told["exit_status"] == status == NOT_COMPLETE
    assert told["results"] == [{"mission": "1", "result": "LANDED_EARLY", "data_result": "COMPLETE"}]
    assert [each["action"] for each in told["commands"] if each["command"] == "MissionCommand"][:3] == [
        "TAKEOFF",
        "HOLD",
        "LAND",
    ]
    assert told["world"][0]["text"] == "fault begins: lrf killed"


def test_what_repeats_is_told_once(capsys):
    _, out, _ = simulated(capsys, "--faults", "autopilot_silent")
    assert "... land_repeat, " in out
    assert out.count("by land_repeat") < 6


def test_lists_scenarios_kinds_and_events(capsys):
    status, out, _ = simulated(capsys, "--list")
    assert status == COMPLETE
    for words in ("lrf_returns  ", "flapping  ", "component  silent", "airborne "):
        assert words in out
