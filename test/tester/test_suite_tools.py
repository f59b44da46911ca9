"""What-if, sweep, shrink, the report, and the plugin of pytest."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from replay_bags import break_chunk, flight_rows, write_bag

from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine.events import CheckName
from amaze_autonomy.laws.flight import BOUNDS
from amaze_autonomy.paths import config_folder
from amaze_autonomy.simulation.run import run
from amaze_autonomy.simulation.scenario import Scenario
from amaze_autonomy.tester import Options, Result, Task, Verdict, run_task, tasks_of
from amaze_autonomy.tester.command import main
from amaze_autonomy.tester.coverage import Coverage, coverage_of
from amaze_autonomy.tester.report_pages import page_content, write_page
from amaze_autonomy.tester.shrink import MOST_LINES
from amaze_autonomy.tester.whatif import NOTHING, letters_of

MAP = Path(__file__).parents[1] / "replay" / "flight.yaml"
REASON = "--reason=the first run, and it is right"


def test_another_rule_ends_the_flight_otherwise(folder, capsys):
    assert main(["what-if", str(folder), "--against", "sensors.components.lrf.severity=moderate"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == ("ENDS OTHERWISE  lrf: TAKEOFF HOLD LAND MISSION_ENDED  ->  TAKEOFF HOLD RESUME MISSION_ENDED")
    assert lines[1].startswith("    decision at +16.500 s changed value: MISSION/flying by failure_wait")
    assert lines[-1] == "1 flights: 1 end otherwise, 0 decide otherwise and end alike"


def test_the_other_configuration_may_be_a_file(folder, capsys):
    shutil.copytree(config_folder(), "other")
    Path("other.yaml").write_text("folder: other\nset: {sensors.components.lrf.severity: moderate}\n")
    assert main(["what-if", str(folder), "--against", "other.yaml"]) == 1
    assert capsys.readouterr().out.startswith(
        "ENDS OTHERWISE  lrf: TAKEOFF HOLD LAND MISSION_ENDED  ->  TAKEOFF HOLD RE"
    )
    Path("other.yaml").write_text("sets: {sensors.components.lrf.severity: moderate}\n")
    assert main(["what-if", str(folder), "--against", "other.yaml"]) == 2
    assert "other.yaml:1: sets: is an unknown key; did you mean set?" in capsys.readouterr().err


def test_a_rule_that_does_not_matter_changes_nothing(folder, capsys):
    assert main(["what-if", str(folder), "--against", "autonomy.recording.data_cleanup_limit_s=1700"]) == 0
    assert capsys.readouterr().out == "1 flights: 0 end otherwise, 0 decide otherwise and end alike\n"


def test_a_damaged_recording_that_is_decided_alike_is_no_success(folder, capsys):
    bag = write_bag(folder / "x.bag", flight_rows(), "bz2")
    break_chunk(bag, -1, 60, 100)
    (folder / "lrf.scenario.yaml").write_text(f"version: 1\ndescription: x\nbags: [{{path: x.bag}}]\nmap: {MAP}\n")
    assert main(["what-if", str(folder), "--against", "autonomy.flight.max_height_m=45.0"]) == 3
    assert capsys.readouterr().out.startswith("DAMAGED      lrf: ")


def test_no_mutant_of_a_name_is_wrong_use(folder, capsys):
    assert main(["mutate", str(folder), "--only", "nonsense"]) == 2
    assert capsys.readouterr().err == "amaze-replay: no mutant is called so: its name would hold 'nonsense'\n"


def test_coverage_is_not_passed_while_a_scenario_cannot_be_run(folder, capsys, monkeypatch):
    monkeypatch.setattr(Coverage, "passed", True)
    assert main(["coverage", str(folder)]) == 0
    (folder / "bad.scenario.yaml").write_text("version: 1\nwhat: 3\n")
    assert main(["coverage", str(folder)]) == 1
    assert capsys.readouterr().err.startswith("ERROR: bad: ")


def test_nor_while_a_recording_is_missing(folder, capsys, monkeypatch):
    monkeypatch.setattr(Coverage, "passed", True)
    gone = "version: 1\ndescription: x\nbags: [{path: no.bag}]\nmap: crazyflie_sine\n"
    (folder / "gone.scenario.yaml").write_text(gone)
    assert main(["coverage", str(folder)]) == 3
    assert capsys.readouterr().err.startswith("INCONCLUSIVE: gone: ")
    monkeypatch.setattr(Coverage, "passed", False)
    assert main(["coverage", str(folder)]) == 1


def test_a_configuration_that_cannot_be_is_said_and_is_no_success(folder, capsys):
    assert main(["what-if", str(folder), "--against", "sensors.components.gps.severity=high"]) == 1
    assert capsys.readouterr().out.startswith("CANNOT       lrf: ")


LOADS = re.compile(r"https?://|src=|@import|url\(|<link")


def parts_of(page):
    """Return the content of a page, and all of it but that and the plot library, which has its own addresses in it."""
    text = page.read_text()
    own = text[: text.index("<script>")] + text[text.rindex("<script>") :]
    return json.loads(text.split("const CONTENT = ")[1].split(";\n")[0]), own


def test_a_sweep_finds_the_boundary(folder, capsys):
    words = ["sweep", str(folder / "lrf.scenario.yaml"), "--to", "40", "--step", "20", "--resolution", "2"]
    assert main([*words, "--json", "map.json"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[:4] == [
        "lrf killed, after airborne",
        "0 s [AAB] 40 s",
        "  A  TAKEOFF HOLD LAND",
        "  B  TAKEOFF",
    ]
    found = json.loads(Path("map.json").read_text())
    (boundary,) = found["boundaries"]
    assert boundary["outcomes"] == ["TAKEOFF HOLD LAND", "TAKEOFF"]
    assert 20 <= boundary["after_s"] < boundary["before_s"] <= 40
    assert boundary["before_s"] - boundary["after_s"] <= 2


def test_a_sweep_is_drawn_with_its_boundary_in_one_page_that_loads_nothing(folder):
    words = ["sweep", str(folder / "lrf.scenario.yaml"), "--to", "40", "--step", "20", "--resolution", "2"]
    assert main([*words, "--json", "map.json", "--html", "map.html"]) == 0
    (boundary,) = json.loads(Path("map.json").read_text())["boundaries"]
    content, own = parts_of(Path("map.html"))
    assert content["letters"] == {"TAKEOFF HOLD LAND": "A", "TAKEOFF": "B"}
    assert [11.5, 11.6, "HOLD", 0.0] in [bar[2:] for bar in content["bars"]]
    assert content["boundaries"] == [[boundary["after_s"], boundary["before_s"], "TAKEOFF HOLD LAND", "TAKEOFF"]]
    middle = (boundary["after_s"] + boundary["before_s"]) / 2
    assert content["regions"] == [[0.0, middle, "TAKEOFF HOLD LAND"], [middle, 40.0, "TAKEOFF"]]
    assert not LOADS.findall(own)


def test_a_sweep_says_where_its_fault_did_nothing_and_draws_no_boundary_there(folder, capsys):
    write_bag(folder / "x.bag", flight_rows())
    path = folder / "lrf.scenario.yaml"
    fault = "{topic: /imu, fault: silent, at_s: 1.0}"
    path.write_text(f"version: 1\ndescription: x\nbags: [{{path: x.bag}}]\nmap: {MAP}\nfaults: [{fault}]\n")
    words = ["sweep", str(path), "--from", "20", "--to", "60", "--step", "20", "--resolution", "5"]
    assert main([*words, "--json", "map.json", "--html", "map.html"]) == 0
    lines = capsys.readouterr().out.splitlines()
    acted = lines[2].split("A  ")[1]
    assert lines[1:4] == ["20 s [A--] 60 s", f"  A  {acted}", f"  -  {NOTHING}"]
    assert lines[4:] == ["3 runs, 2 in which the fault did nothing, 1 outcomes, 0 boundaries"]
    found = json.loads(Path("map.json").read_text())
    assert found["points"][0]["began_s"] == 20.0
    assert (found["boundaries"], found["fault_did_nothing"]) == ([], 2)
    content, _ = parts_of(Path("map.html"))
    assert content["regions"] == [[20.0, 30.0, acted], [30.0, 60.0, NOTHING]]
    assert content["letters"] == {acted: "A", NOTHING: "-"}


def test_a_sweep_of_a_fault_that_never_begins_is_no_success(folder, capsys):
    path = folder / "lrf.scenario.yaml"
    path.write_text(path.read_text().replace("event: airborne", "event: pilot"))
    assert main(["sweep", str(path), "--to", "2"]) == 4
    assert capsys.readouterr().out.endswith("3 runs, 3 in which the fault did nothing, 0 outcomes, 0 boundaries\n")


def test_no_letter_stands_for_two_outcomes():
    found = letters_of([*map(str, range(100)), NOTHING])
    assert len(set(found.values())) == 101
    assert "".join(found.values())[:27] == "ABCDEFGHIJKLMNOPQRSTUVWXYZa"


def test_a_sweep_of_a_fault_that_there_is_not_is_wrong_use(folder, capsys):
    assert main(["sweep", str(folder / "lrf.scenario.yaml"), "--fault", "2", "--to", "4"]) == 2
    assert "there is no fault 2; it has 1" in capsys.readouterr().err


def test_a_failing_scenario_shrinks_to_its_first_different_decision(folder, capsys):
    path = folder / "lrf.scenario.yaml"
    assert main(["accept", str(folder), REASON]) == 0
    path.write_text(path.read_text().replace("restart: fails", "restart: succeeds"))
    assert main(["shrink", str(path), "--out", "small.scenario.yaml"]) == 0
    text = Path("small.scenario.yaml").read_text()
    assert len(text.splitlines()) < MOST_LINES
    assert "Shrunk from lrf: " in text
    assert f"\nchecks: [{', '.join(check.value for check in CheckName)}]\nevents:\n" in text
    capsys.readouterr()
    assert main(["test", "small.scenario.yaml", "--no-goldens"]) == 1
    assert capsys.readouterr().out.startswith("FAIL         small: never rule failure_back")


def test_what_is_shrunk_names_its_configuration_from_where_it_is_written(folder):
    shutil.copytree(config_folder(), "mine")
    path = folder / "lrf.scenario.yaml"
    own = os.path.relpath("mine", folder)
    path.write_text(path.read_text() + f"configuration: {{folder: {own}}}\n")
    Path("deep/er").mkdir(parents=True)
    assert main(["shrink", str(path), "--rule", "hold", "--out", "deep/er/small.scenario.yaml"]) == 0
    assert '\n  folder: "../../mine"\n' in Path("deep/er/small.scenario.yaml").read_text()
    assert main(["test", "deep/er/small.scenario.yaml", "--no-goldens"]) == 1


@pytest.mark.usefixtures("folder")
def test_a_journal_by_other_rules_is_not_shrunk_and_that_is_the_reason(capsys):
    configuration = load_configuration(config_folder(), ["autonomy.takeoff.takeoff_height_m=0.8"])
    missions = configuration.missions[:1]
    Path("j.jsonl").write_text("".join(f"{line}\n" for line in run(configuration, missions, Scenario()).lines))
    Path("j.scenario.yaml").write_text("version: 1\ndescription: x\njournal: j.jsonl\nexpectations: []\n")
    assert main(["shrink", "j.scenario.yaml", "--rule", "at_takeoff_height"]) == 2
    words = "j.jsonl was decided by other rules than the configuration's, and what is shrunk to is decided by these"
    assert words in capsys.readouterr().err


def test_a_text_with_an_apostrophe_is_shrunk_to_a_scenario_that_can_be_read(folder, capsys):
    (task,) = tasks_of([folder], Options(goldens=False, story=True))
    story = "".join(f"{line}\n" for line in run_task(task).story)
    assert "connection refused" in story
    Path("j.jsonl").write_text(story.replace("connection refused", "'can't connect'"))
    Path("j.scenario.yaml").write_text("version: 1\ndescription: x\njournal: j.jsonl\nexpectations: []\n")
    assert main(["shrink", "j.scenario.yaml", "--rule", "failure_wait", "--out", "small.scenario.yaml"]) == 0
    assert "''can''t connect''" in Path("small.scenario.yaml").read_text()
    capsys.readouterr()
    assert main(["test", "small.scenario.yaml", "--no-goldens"]) == 1
    assert capsys.readouterr().out.startswith("FAIL         small: never rule failure_wait: rule failure_wait at ")


def test_nothing_to_shrink_is_said(folder, capsys):
    assert main(["shrink", str(folder / "lrf.scenario.yaml")]) == 2
    assert "there is no golden to differ from; name a decision with --rule" in capsys.readouterr().err
    assert main(["shrink", str(folder / "lrf.scenario.yaml"), "--rule", "touchdown"]) == 2
    assert "no decision by touchdown is made" in capsys.readouterr().err


def test_the_page_holds_everything_and_loads_nothing(folder):
    (task,) = tasks_of([folder], Options(story=True))
    result = run_task(task)
    write_page(Path("r.html"), [result], coverage_of([result]), 1.0)
    content, own = parts_of(Path("r.html"))
    (test,) = content["tests"]
    assert (test["verdict"], test["end_s"], test["states"][0]) == ("FAIL", 38.8, [0.0, 5.0, "MISSION_INPUT"])
    assert test["marks"] == [["fault", 16.3, None, "lrf killed"]]
    assert [bar[2] for bar in test["codes"]["lrf"]] == ["1", "8", "16"]
    hold = next(each for each in test["moments"] if each["rule"] == "hold")
    assert hold["commands"] == ["MissionCommand(HOLD)"]
    assert "waits at most (restart limit) 12 s" in hold["values"]
    assert "gps" in test["quiet"]
    assert "lrf" not in test["quiet"]
    assert not LOADS.findall(own)


def test_the_report_shows_waivers_that_lie_beside_the_scenarios(folder):
    (folder / "waivers.yaml").write_text("waivers:\n  - {item: rule touchdown, reason: one landing is enough here}\n")
    for words in ([], ["--waivers", str(folder / "waivers.yaml")]):
        assert main(["test", str(folder), "--html", "r.html", *words]) == 1
        content = json.loads(Path("r.html").read_text().split("const CONTENT = ")[1].split(";\n")[0])
        waived = [[name, why] for name, _, _, why in content["coverage"] if why]
        bounds = {name for name, why in waived if why.startswith("a bound of the laws")}
        assert bounds == {f"loss {name}" for name in BOUNDS}
        assert [row for row in waived if row[0] not in bounds] == [["rule touchdown", "one landing is enough here"]]


def test_a_text_cannot_end_the_script(folder):
    result = run_task(Task(str(folder / "lrf.scenario.yaml"), error="</script><b>"))
    write_page(Path("r.html"), [result], None, 0.0)
    assert Path("r.html").read_text().count("</script>") == 2  # the plot library, and the page's own


@pytest.fixture
def run_pytest(folder):
    def run(*words):
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(folder), *words]
        if "amaze_autonomy.tester.pytest_plugin" not in _entry_points():
            command[3:3] = ["-p", "amaze_autonomy.tester.pytest_plugin"]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)

    return run


def _entry_points():
    try:
        from importlib.metadata import entry_points  # noqa: PLC0415

        found = entry_points()
        group = found.select(group="pytest11") if hasattr(found, "select") else found.get("pytest11", ())
        return [each.name for each in group]
    except ImportError:
        return []


def test_pytest_collects_scenarios_with_their_tags_and_margins(folder, run_pytest):
    assert main(["accept", str(folder), REASON]) == 0
    (folder / "gone.scenario.yaml").write_text(
        "version: 1\ndescription: x\nbags: [{path: no.bag}]\nmap: crazyflie_sine\n"
    )
    done = run_pytest("--junitxml=r.xml", "-rs", "-o", "amaze_skip_missing_recordings=true")
    assert "1 passed, 1 skipped" in done.stdout, done.stdout
    assert "INCONCLUSIVE: " in done.stdout
    case = next(each for each in ET.parse("r.xml").getroot().iter("testcase") if each.get("name") == "lrf")
    names = [each.get("name") for each in case.iter("property")]
    assert names == ["requirement", "margin", "verdict", "digest"]
    assert "1 passed, 1 deselected" in run_pytest("-k", "hold").stdout


def test_pytest_is_not_green_where_a_recording_is_missing(folder, run_pytest):
    (folder / "lrf.scenario.yaml").write_text(
        "version: 1\ndescription: x\nbags: [{path: no.bag}]\nmap: crazyflie_sine\n"
    )
    done = run_pytest()
    assert done.returncode == 1
    assert "1 failed" in done.stdout, done.stdout
    assert re.search(r"^INCONCLUSIVE lrf: \S+no\.bag: is not there", done.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    "bag, more, words",
    [
        (f"{{path: x.bag, sha256: {64 * '0'}}}", "", r"x\.bag: is another file than the scenario was written for"),
        ("{path: text.bag}", "", r"text\.bag: is no recording"),
        ("{path: x.bag}", "needs: [{topic: /other}]", "/other: is needed, and the map does not read it"),
    ],
    ids=["another file", "no recording", "lacks what is needed"],
)
def test_pytest_skips_no_recording_that_is_there(folder, run_pytest, bag, more, words):
    write_bag(folder / "x.bag", flight_rows())
    (folder / "text.bag").write_text("no recording")
    (folder / "lrf.scenario.yaml").write_text(f"version: 1\ndescription: x\nbags: [{bag}]\nmap: {MAP}\n{more}\n")
    done = run_pytest("-o", "amaze_skip_missing_recordings=true")
    assert done.returncode == 1
    assert "1 failed" in done.stdout, done.stdout
    assert re.search(rf"^INCONCLUSIVE lrf: .*{words}", done.stdout, re.MULTILINE), done.stdout


def test_pytest_shows_the_difference_and_a_mistake_with_its_line(folder, run_pytest):
    assert main(["accept", str(folder), REASON]) == 0
    path = folder / "lrf.scenario.yaml"
    path.write_text(path.read_text().replace("delay_s: 5.0", "delay_s: 5.5"))
    done = run_pytest()
    assert "0.500 s later: MISSION/flying by failure_wait" in done.stdout
    assert "Traceback" not in done.stdout
    path.write_text("version: 1\ndescriptions: x\n")
    assert "lrf.scenario.yaml:2: descriptions: is an unknown key; did you mean description?" in run_pytest().stdout


def test_the_page_says_verdicts_by_signs_and_has_colours_for_the_dark(folder):
    """What a test can see of it without a browser: every verdict has a sign, every colour of the text a dark one."""
    (task,) = tasks_of([folder], Options(story=True))
    write_page(Path("r.html"), [run_task(task)], None, 1.0)
    page = Path("r.html").read_text()
    signs = re.search(r"const SIGNS = \{(.*)\};", page).group(1)
    assert re.findall(r"(\w+): ", signs) == ["PASS", "FAIL", "ERROR", "VACUOUS", "INCONCLUSIVE"]
    assert {verdict.value for verdict in Verdict} == set(re.findall(r"(\w+): ", signs))
    light, dark = re.findall(r":root \{(.*?)\}", page, re.DOTALL)
    names = [set(re.findall(r"(--\w+):", text)) for text in (light, dark)]
    styles = page[: page.index("</style>")]
    themed = {f"--{name}" for name in re.findall(r'themed\("(\w+)"\)', page)}
    assert names[0] == names[1]
    assert (set(re.findall(r"var\((--\w+)\)", styles)) - {"--swatch"}) | themed <= names[0]


def test_the_page_opens_with_what_failed():
    results = [Result(verdict.value, "x", "", "", verdict, "") for verdict in reversed(Verdict)]
    shown = [test["id"] for test in page_content(results, None, 0.0)["tests"]]
    assert shown == ["FAIL", "ERROR", "VACUOUS", "INCONCLUSIVE", "PASS"]
