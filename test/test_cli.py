"""The command amaze-autonomy as its user runs it."""

from __future__ import annotations

import json
import shutil
import sys

import pytest

from amaze_autonomy import paths
from amaze_autonomy.cli import main
from amaze_autonomy.config import load_configuration
from amaze_autonomy.documents import documents

SHIPPED = load_configuration(paths.config_folder())
HASH = SHIPPED.hash


@pytest.fixture
def folder(tmp_path):
    return shutil.copytree(paths.config_folder(), tmp_path / "config")


def test_a_good_configuration_is_said_to_be_good(capsys):
    assert main(["check-config"]) == 0
    out, err = capsys.readouterr()
    counted = f"{len(SHIPPED.components)} components, {len(SHIPPED.missions)} missions"
    assert out == f"{paths.config_folder()}: good: {counted}, hash {HASH[:12]}\n"
    assert err == ""


def test_a_topic_that_is_watched_and_not_recorded_is_said_with_the_line_to_add(capsys, folder):
    sensors = folder / "sensors.yaml"
    with_another = """
  nobodys_camera:
    group: other
    severity: low
    topics:
      /nobodys/image: {rate_hz: 10.0}

  # The mission is flown"""
    sensors.write_text(sensors.read_text().replace("\n  # The mission is flown", with_another, 1))
    assert main(["check-config", str(folder)]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == [
        "  warning: /nobodys/image (component nobodys_camera) is watched, and no group of recording.yaml records it: "
        "add the line `- /nobodys/image` to the topics of a group, or `recorded: false` to the topic in sensors.yaml"
    ]
    assert main(["check-config", str(folder), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["warnings"]) == 1
    sensors.write_text(
        sensors.read_text().replace(
            "/nobodys/image: {rate_hz: 10.0}", "/nobodys/image: {rate_hz: 10.0, recorded: false}"
        )
    )
    assert main(["check-config", str(folder)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_a_battery_below_what_is_estimated_is_said(capsys, folder):
    low = ["--set", "missions.missions.4.battery_needed_fraction=0.21"]
    assert main(["check-config", str(folder), *low]) == 0
    (line,) = capsys.readouterr().out.splitlines()[1:]
    assert line.startswith("  warning: missions.yaml: mission 4 says battery_needed_fraction 0.21, and 0.48")


def test_a_recorded_topic_that_nothing_names_is_said_in_one_line(capsys, folder):
    recording = (folder / "recording.yaml").read_text()
    known = ("/rosout", "/autonomy/journal", "/uav1/mission_planner/status", "/mavros/altitude", "/autonomy/response")
    rows = "\n      ".join(f"- {topic}" for topic in known)
    (folder / "recording.yaml").write_text(recording.replace("- /rosout", rows))
    assert main(["check-config", str(folder)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1
    (folder / "recording.yaml").write_text(recording.replace("- /rosout", "- /rosout\n      - /rosin"))
    assert main(["check-config", str(folder)]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == [
        "  warning: groups.states of recording.yaml records /rosin, which no sensor, no node of ours and no map names: "
        "is each spelled as its node has it?"
    ]
    (folder / "map.yaml").write_text("about: mine\nreadings: {armed: {topic: /rosin}}\n")
    assert main(["check-config", str(folder)]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_mavros_in_a_namespace_has_its_topics_there(capsys):
    words = ("--json", "--set", "autopilot.mavros=/uav1/mavros")
    assert main(["check-config", str(paths.config_folder() / "mavros"), *words]) == 0
    (line,) = json.loads(capsys.readouterr().out)["warnings"]
    assert line.startswith("autopilot.yaml says that mavros is at /uav1/mavros, and sensors.yaml and recording.yaml ")


@pytest.mark.parametrize("arguments", [["check-config", "{}"], ["simulate", "--config", "{}", "--limit", "1"]])
def test_a_tilde_that_no_shell_has_replaced_is_the_home_and_no_folder_of_that_name(
    capsys, folder, tmp_path, monkeypatch, arguments
):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    written = [each.format(f"~/{folder.name}") for each in arguments]
    assert main(written) != 2, capsys.readouterr()
    assert not (tmp_path / "~").exists()


def test_a_mistake_is_one_line_and_status_1(capsys, folder):
    (folder / "autonomy.yaml").write_text("checks:\n  ready_limit_min: 1\n")
    assert main(["check-config", str(folder)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err == (
        f"{folder}/autonomy.yaml:2: checks.ready_limit_min: is an unknown key; "
        "did you mean ready_limit_s (1 min are 60 s)?\n"
    )


def test_a_rate_of_what_is_no_message_is_a_mistake_too(capsys, folder):
    (folder / "autopilot.yaml").write_text("rates_hz: {WINDY: 2.0}\n")
    assert main(["check-config", str(folder)]) == 1
    mistake = "rates_hz.WINDY: is no message; must be one of https:"
    assert capsys.readouterr().err.startswith(f"{folder}/autopilot.yaml:1: {mistake}")
    (folder / "autopilot.yaml").write_text("rates_hz: {WIND: 2.0}\n")
    assert main(["check-config", str(folder)]) == 0
    capsys.readouterr()
    assert main(["check-config", str(folder), "--set", "autopilot.rates_hz.WINDY=2"]) == 1
    assert capsys.readouterr().err.startswith(f"override autopilot.rates_hz.WINDY=2: {mistake}")


def test_a_key_file_that_a_node_could_not_use_is_a_warning(capsys, folder, tmp_path):
    key = tmp_path / "mavlink.key"
    words = [f"autopilot.{link}.key_file={key}" for link in ("link", "planner_link")]
    arguments = ["check-config", str(folder), *(word for each in words for word in ("--set", each))]
    assert main(arguments) == 0
    known = capsys.readouterr().out.splitlines()
    assert known[1:3] == [
        f"  warning: {link}.key_file of autopilot.yaml: {key}: No such file or directory; must be a file with the key"
        for link in ("link", "planner_link")
    ]
    key.write_text("ab" * 32)
    key.chmod(0o600)
    assert main(arguments) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(known) - 2


def test_a_key_file_of_a_user_that_is_not_there_is_a_warning(capsys, folder):
    words = [f"autopilot.{link}.key_file=~no_such_user/key" for link in ("link", "planner_link")]
    assert main(["check-config", str(folder), *(word for each in words for word in ("--set", each))]) == 0
    assert "  warning: link.key_file of autopilot.yaml: ~no_such_user/key: " in capsys.readouterr().out


def test_a_mistake_as_json_has_its_parts(capsys, folder):
    (folder / "autonomy.yaml").write_text("require_go: 1\n")
    assert main(["check-config", str(folder), "--json"]) == 1
    out, err = capsys.readouterr()
    assert json.loads(out) == {
        "valid": False,
        "file": f"{folder}/autonomy.yaml",
        "line": 1,
        "key": "require_go",
        "wrong": "is 1",
        "right": "must be true or false",
    }
    assert err == ""


def test_the_effective_configuration_is_printed_as_json(capsys):
    assert main(["check-config", "--json", "--set", "autonomy.require_go=true"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = load_configuration(paths.config_folder(), ["autonomy.require_go=true"])
    assert found == {
        "valid": True,
        "warnings": [],
        "folder": str(paths.config_folder()),
        "hash": expected.hash,
        "effective": expected.effective,
    }


def test_the_missions_are_listed(capsys):
    assert main(["missions"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["id", "duration", "length", "battery", "description"]
    assert [line.split()[0] for line in lines[1:]] == ["1", "2", "3", "4", "5"]
    assert lines[1].endswith("Short square, less than a minute")


def test_the_missions_are_listed_as_json(capsys):
    assert main(["missions", "--json"]) == 0
    missions = json.loads(capsys.readouterr().out)["missions"]
    assert missions[1] == {
        "id": "2",
        "description": "Out to two places, a touchdown at each, and back",
        "files": ["trajectories/out.csv", "trajectories/across.csv", "trajectories/back.csv"],
        "repetitions": 1,
        "length_m": 25.657,
        "estimated_duration_s": 63.657,
        "battery_needed_fraction": 0.3,  # what the check before the takeoff asks for at least
    }


def test_missions_of_a_mistaken_configuration_are_not_listed(capsys, tmp_path):
    assert main(["missions", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith(f"{tmp_path}/autonomy.yaml: cannot be read (")


def test_documentation_that_differs_is_found_then_written(capsys, tmp_path):
    markers = ["severities", *(name for name in documents() if name != "severities")]
    page = tmp_path / "all.md"
    page.write_text("".join(f"<!-- generated:{name} -->\n<!-- end -->\n" for name in markers))
    assert main(["docs", "--check", "--folder", str(tmp_path)]) == 1
    assert capsys.readouterr().err == (
        f"{page}:2: differs from the code; run `amaze-autonomy docs`\n  is        <!-- end -->\n  should be \n"
    )
    assert main(["docs", "--folder", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"{page}: written\n"
    assert main(["docs", "--check", "--folder", str(tmp_path)]) == 0


def test_what_no_page_shows_is_named(capsys, tmp_path):
    assert main(["docs", "--check", "--folder", str(tmp_path)]) == 1
    assert capsys.readouterr().err.startswith(f"{tmp_path}: no page shows decision-table, severities, ")


def test_a_folder_of_pages_that_is_not_there_is_wrong_use(capsys, tmp_path):
    assert main(["docs", "--folder", str(tmp_path / "none")]) == 2
    assert (
        capsys.readouterr().err == f"{tmp_path}/none: is not a folder; name the docs of a source tree with --folder\n"
    )


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["check-config", "a", "b"]])
def test_wrong_use_is_status_2(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert "usage: amaze-autonomy" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["propose-config", "--live"], ["doctor"]])
def test_without_ros_a_command_that_looks_at_the_graph_says_so(capsys, monkeypatch, tmp_path, arguments):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "amaze_autonomy.ros.graph", raising=False)
    for name in ("genpy", "rosgraph", "rospy"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main(arguments) == 3
    out, err = capsys.readouterr()
    assert (out, list(tmp_path.iterdir())) == ("", [])
    assert err.startswith(f"{arguments[0]}: there is no ROS here (import of ")
    assert err.endswith("): source its setup.bash\n")


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["check-config", "--help"], ["missions", "--help"], ["docs", "--help"], ["propose-config", "--help"]],
)
def test_help_has_examples_and_the_exit_status(capsys, arguments):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 0
    out = capsys.readouterr().out
    assert "examples:\n" in out
    assert "exit status:\n" in out


def test_simulate_is_given_its_arguments(monkeypatch):
    given = []
    monkeypatch.setattr("amaze_autonomy.simulation.cli.main", lambda argv: given.append(argv) or 3)
    assert main(["simulate", "--mission", "1", "--help"]) == 3
    assert given == [["--mission", "1", "--help"]]
