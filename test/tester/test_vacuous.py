"""What rests on a key or a fault that nothing looked at is VACUOUS, never PASS; what-if says which keys those are."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from replay_bags import flight_rows, write_bag
from replay_demo import demo_bag, simulated

from amaze_autonomy.paths import config_folder
from amaze_autonomy.tester import Options, run_task, tasks_of
from amaze_autonomy.tester.command import main
from amaze_autonomy.tester.play import _meets, play
from amaze_autonomy.tester.scenario.files import load_cases

MAP = Path(__file__).parents[1] / "replay" / "flight.yaml"
SCENARIO = """\
version: 1
description: a flight of the tests
bags: [{path: flight.bag}]
map: flight.yaml
expectations:
  - {expect: sequence, of: [{state: TAKEOFF}, {state: MISSION}]}
"""
SEVERITY = "configuration: {set: {sensors.components.%s}}\n"


@pytest.fixture(autouse=True)
def flight(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "flight.bag", flight_rows())
    Path("flight.yaml").write_text(MAP.read_text())
    Path("x.scenario.yaml").write_text(SCENARIO)


def result(more):
    Path("x.scenario.yaml").write_text(SCENARIO + more)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    found = run_task(task)
    return found.verdict.value, found.headline


VACUOUS = {
    SEVERITY
    % "gps.severity: highest": "sensors.components.gps.severity was not looked at: the recording has no topic of gps",
    "configuration: {set: {autonomy.flight.max_distance_m: 50.0}}\n": "autonomy.flight.max_distance_m was not looked "
    "at: position: scripted, not recorded",
    "configuration: {set: {sensors.landing_detection.mounting_height_m: 0.3}}\n": "sensors.landing_detection."
    "mounting_height_m was not looked at: a replay by the map flight does not read it",
    "faults: [{topic: /imu, fault: scaled, field: header.seq, factor: 2.0}]\n": "/imu scaled",
    "faults: [{topic: /mag, fault: biased, field: magnetic_field.x, by: 2.0}]\n": "/mag biased",
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("more", VACUOUS)
def test_a_test_that_rests_on_what_nothing_looked_at_is_vacuous(more):
    verdict, headline = result(more)
    assert verdict == "VACUOUS"
    assert headline.startswith(VACUOUS[more])


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "more",
    [
        SEVERITY % "imu.severity: low",
        "configuration: {set: {sensors.landing_detection.airborne_distance_m: 0.3}}\n",  # as it is configured
        "faults: [{topic: /imu, fault: biased, field: linear_acceleration.x, by: 0.01}]\n",
        "faults: [{topic: /mag, fault: delayed, delay_s: 0.01}]\n",
    ],
)
def test_what_was_looked_at_passes_although_it_decides_nothing_otherwise(more):
    assert result(more)[0] == "PASS"


NEVER = {
    "requests: [{request: land, after: {state: PILOT}}]\n": "land was never asked",
    "requests: [{request: hold, after: {state: MISSION}}, {request: hold, at_s: 5000}]\n": "hold was never asked",
    "faults: [{process: autonomy, fault: interrupted, after: {state: PILOT}}]\n": "autonomy interrupted never began",
    "faults: [{process: autonomy, fault: interrupted, at_s: 5000}]\n": "autonomy interrupted touched nothing",
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("more", NEVER)
def test_what_never_comes_in_a_recording_is_vacuous(more):
    assert result(more) == ("VACUOUS", NEVER[more])


LOSS = "expectations: [{expect: never, of: {failure: %s}, to: 20.0}]\n"
PLANNER = "faults: [{process: mission_planner, fault: silent, at_s: 22.0}]\n"
FULL = "faults: [{fault: storage_full, at_s: 22.0}]\n"
SHOWN = {
    (LOSS % "battery_critical", ""): ("PASS", ""),
    (LOSS % "height", ""): ("PASS", ""),
    (LOSS % "flight_time", ""): ("PASS", ""),
    (LOSS % "user_hold", ""): ("PASS", ""),
    (LOSS % "distance", ""): ("VACUOUS", "position: scripted, not recorded"),
    (LOSS % "tilt", ""): ("VACUOUS", "autopilot: scripted, not recorded"),
    (LOSS % "planner_failed", ""): ("VACUOUS", "planner: scripted, not recorded"),
    (LOSS % "autopilot_status", ""): ("VACUOUS", "the autopilot's link: scripted, not recorded"),
    (LOSS % "clock", ""): ("VACUOUS", "nothing in a replay tells it"),
    (LOSS % "planner_status", PLANNER): ("PASS", ""),
    (LOSS % "recorder_dead", PLANNER): ("VACUOUS", "recorder: scripted, not recorded"),
    (LOSS % "recorder_dead", FULL): ("PASS", ""),
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("expectation,fault", SHOWN)
def test_that_a_loss_never_comes_is_vacuous_where_nothing_could_show_it(expectation, fault):
    Path("x.scenario.yaml").write_text(SCENARIO.partition("expectations:")[0] + fault + expectation)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    (finding,) = run_task(task).findings
    verdict, reason = SHOWN[expectation, fault]
    loss = finding.expectation.split(",")[0].split()[-1]
    words = f"nothing shows {loss} in this run: {reason}" if reason else "not between +0.000 s and +20.000 s"
    assert (finding.grade.value, finding.text) == (verdict, words)


def test_a_battery_that_is_not_recorded_is_never_critical(tmp_path):
    (tmp_path / "flight.bag").unlink()
    write_bag(tmp_path / "flight.bag", [row for row in flight_rows() if row[1] != "/battery"])
    words = "nothing shows battery_critical in this run: battery: scripted, not recorded"
    expectation = LOSS % "battery_critical"
    Path("x.scenario.yaml").write_text(SCENARIO.partition("expectations:")[0] + expectation)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    assert run_task(task).findings[0].text == words


PILOTS = {
    ("state: PILOT", ""): "VACUOUS",
    ("rule: pilot_took_over", ""): "VACUOUS",
    ("rule: armed_by_others", ""): "VACUOUS",
    ("state: [PILOT, OUTREACH]", ""): "PASS",
    ("rule: failure_land", ""): "PASS",
    ("state: PILOT", "faults: [{process: autopilot, fault: silent, at_s: 22.0}]\n"): "PASS",
    ("state: PILOT", "faults: [{process: autonomy, fault: restarted, at_s: 12.0, for_s: 1.0}]\n"): "PASS",
    ("state: PILOT", PLANNER): "VACUOUS",
}


@pytest.mark.parametrize("pattern,fault", PILOTS)
def test_that_no_pilot_takes_over_is_vacuous_where_nothing_could_show_one(pattern, fault):
    lines = MAP.read_text().splitlines(keepends=True)
    Path("flight.yaml").write_text("".join(line for line in lines if "armed:" not in line))
    scenario = SCENARIO.partition("expectations:")[0]
    never = f"expectations: [{{expect: never, of: {{{pattern}}}, to: 20.0}}]\n"
    Path("x.scenario.yaml").write_text(scenario + fault + never)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    (finding,) = run_task(task).findings
    verdict = PILOTS[pattern, fault]
    words = {
        "VACUOUS": "nothing shows a pilot in this run: armed, flight mode and failsafe: scripted, not recorded",
        "PASS": "not between +0.000 s and +20.000 s",
    }
    assert (finding.grade.value, finding.text) == (verdict, words[verdict])


def test_that_no_pilot_takes_over_is_judged_where_armed_is_recorded():
    assert result("  - {expect: never, of: {state: PILOT}}\n")[0] == "PASS"


def test_a_golden_of_nothing_judges_nothing_and_is_not_accepted(capsys):
    Path("x.scenario.yaml").write_text(SCENARIO.partition("expectations:")[0] + "to_s: 2.0\n")
    words = "it has no expectations, and nothing was decided: nothing was judged"
    assert main(["accept", "x.scenario.yaml", "--reason=nothing is decided, and that is right"]) == 1
    assert capsys.readouterr().out.startswith(f"x: not accepted: VACUOUS: {words}\n")
    assert not Path("goldens").exists()
    Path("goldens").mkdir()
    head = '{"case":"x","kind":"golden","reason":"the first run, and it is right","version":1}\n'
    Path("goldens/x.golden.jsonl").write_text(head)  # of before that was refused
    assert main(["test", "x.scenario.yaml"]) == 4
    assert capsys.readouterr().out.startswith(f"VACUOUS      x: {words}\n")


@pytest.mark.parametrize("fault", ["silent", "scaled, field: sequence, factor: 2.0"])
def test_a_fault_of_the_journal_changes_nothing_and_is_vacuous(fault):
    """What was asked is read from the bag, past all faults."""
    demo_bag(Path("demo.bag"), simulated())
    scenario = SCENARIO.replace("flight.bag", "demo.bag").replace("map: flight.yaml", "map: amaze_demo")
    Path("x.scenario.yaml").write_text(f"{scenario}faults: [{{topic: /autonomy/journal, fault: {fault}}}]\n")
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    found = run_task(task)
    assert found.verdict.value == "VACUOUS"
    assert "messages, and nothing looked at what it changed" in found.headline


def test_a_key_of_the_command_line_counts_as_one_of_the_scenario(capsys):
    key = "sensors.components.gps.severity"
    assert main(["test", "x.scenario.yaml", "--set", f"{key}=low", "--no-goldens"]) == 0  # as it is configured
    words = ["test", "x.scenario.yaml", "--no-goldens", "--set", f"{key}=highest"]
    assert main(words) == 4
    assert f"VACUOUS      x: {key} was not looked at: the recording has no topic of gps" in capsys.readouterr().out


def test_what_if_names_the_keys_that_a_map_bypasses(capsys):
    assert main(["what-if", "x.scenario.yaml", "--against", "sensors.components.gps.severity=highest"]) == 4
    assert capsys.readouterr().out.splitlines() == [
        "NOT LOOKED AT  x: sensors.components.gps.severity: the recording has no topic of gps",
        "1 flights: 0 end otherwise, 0 decide otherwise and end alike, 1 did not look at every key",
    ]
    assert main(["what-if", "x.scenario.yaml", "--against", "sensors.components.imu.severity=low"]) == 0
    assert "NOT LOOKED AT" not in capsys.readouterr().out


def other_folder(change):
    """Copy the shipped configuration into `other`, its sensors changed."""
    shutil.copytree(config_folder(), "other")
    sensors = Path("other/sensors.yaml")
    sensors.write_text(change(sensors.read_text()))


def test_what_if_follows_each_key_in_which_a_folder_differs(capsys):
    other_folder(lambda text: text.replace("severity: low", "severity: highest", 1).replace("cells: 4", "cells: 6"))
    assert main(["what-if", "x.scenario.yaml", "--against", "other"]) == 4
    assert capsys.readouterr().out.splitlines() == [
        "NOT LOOKED AT  x: sensors.battery.cells: a replay by the map flight does not read it",
        "NOT LOOKED AT  x: sensors.components.gps.severity: the recording has no topic of gps",
        "1 flights: 0 end otherwise, 0 decide otherwise and end alike, 1 did not look at every key",
    ]
    Path("x.scenario.yaml").write_text(SCENARIO + SEVERITY % "gps.severity: highest")
    Path("other/sensors.yaml").write_text((config_folder() / "sensors.yaml").read_text())
    assert main(["what-if", "x.scenario.yaml", "--against", "other"]) == 0  # the same configuration by another name


def test_what_if_says_of_a_folder_with_other_components_that_its_keys_are_not_followed(capsys):
    added = "  nobodys_camera: {group: other, severity: low, topics: {/nobodys: {rate_hz: 9.0, age_limit_s: 1.0}}}\n"
    other_folder(lambda text: text.replace("\ncomponents:\n", f"\ncomponents:\n{added}", 1))
    assert main(["what-if", "x.scenario.yaml", "--against", "other"]) == 4
    assert capsys.readouterr().out.splitlines()[0] == (
        "NOT LOOKED AT  x: other: it has other components, missions or waypoint files, so its keys are not followed"
    )


def test_a_changed_copy_of_the_configuration_is_followed_as_its_keys_are(capsys):
    other_folder(lambda text: text.replace("severity: low", "severity: highest", 1))
    words = "sensors.components.gps.severity was not looked at: the recording has no topic of gps"
    assert main(["test", "x.scenario.yaml", "--no-goldens", "--config", "other"]) == 4
    assert f"VACUOUS      x: {words}" in capsys.readouterr().out
    assert main(["run", "flight.bag", "--map", "flight.yaml", "--config", "other"]) == 4
    assert f"VACUOUS: {words}" in capsys.readouterr().out
    Path("other/sensors.yaml").write_text((config_folder() / "sensors.yaml").read_text())
    assert main(["test", "x.scenario.yaml", "--no-goldens", "--config", "other"]) == 0
    assert main(["run", "flight.bag", "--map", "flight.yaml", "--config", "other"]) == 0


def test_a_configuration_of_its_own_is_no_changed_copy(capsys):
    added = "  nobodys_camera: {group: other, severity: low, topics: {/nobodys: {rate_hz: 9.0, age_limit_s: 1.0}}}\n"
    other_folder(lambda text: text.replace("\ncomponents:\n", f"\ncomponents:\n{added}", 1))
    assert main(["run", "flight.bag", "--map", "flight.yaml", "--config", "other"]) == 0
    assert "VACUOUS" not in capsys.readouterr().out


SIMULATED = """\
version: 1
description: a simulated flight of the tests
missions: ['1']
faults: [{component: lrf, fault: silent, after: {event: airborne, delay_s: 3.0}}]
expectations: [{expect: exists, of: {state: HOLD}}]
configuration: {set: {%s}}
"""


def played_simulation(more):
    Path("x.scenario.yaml").write_text("version: 1\ndescription: x\nmissions: ['1']\n" + more)
    (case,) = load_cases(Path("x.scenario.yaml"))
    return play(case, Options(goldens=False))


def test_of_two_simulated_requests_that_are_the_same_in_words_the_one_that_never_comes_is_named():
    asked, never = "{request: retry, at_s: 6}", "{request: retry, after: {state: OUTREACH, occurrence: 50}}"
    assert played_simulation(f"requests: [{asked}, {never}]\n").vacuous == ("retry was never asked",)


def test_two_simulated_faults_that_are_the_same_in_words_keep_their_times():
    fault = "component: realsense_imu, fault: silent"
    played = played_simulation(f"faults: [{{{fault}, at_s: 40, for_s: 2}}, {{{fault}, at_s: 20, for_s: 30}}]\n")
    assert [t_ns / 1e9 for t_ns in played.trace.faults] == [40.0, 20.0]
    assert [mark[1:3] for mark in played.marks] == [(20.0, 50.0), (40.0, 42.0)]


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "key,verdict",
    [
        ("sensors.battery.cell_voltage_max_v: 4.4", "PASS"),  # shown as the other limit of the cells
        ("missions.bounds.max_hold_s: 100.0", "VACUOUS"),  # waypoint files are only checked by it
        ("autonomy.takeoff.lift_off_limit_s: 9.0", "PASS"),  # as it is watched in each takeoff
        ("sensors.components.lrf.wait_limit_s: 9.0", "PASS"),
        ("sensors.landing_detection.mounting_height_m: 0.2", "PASS"),  # the simulated range is measured from there
    ],
)
def test_a_key_that_nothing_in_a_simulated_flight_looked_at_is_vacuous(key, verdict):
    Path("x.scenario.yaml").write_text(SIMULATED % key)
    (task,) = tasks_of([Path("x.scenario.yaml")], Options(goldens=False))
    found = run_task(task)
    assert (found.verdict.value, found.problems) == (
        verdict,
        (f"{key.split(':')[0]} was not looked at: the simulated flight is the same without it",) * (verdict != "PASS"),
    )


@pytest.mark.parametrize(
    "key,value,words",
    [
        ("autonomy.commands.user_hold_limit_s", "20.0", "no decision asked for it"),
        ("sensors.landing_detection.ground_distance_m", "0.12", "a journal holds what the nodes said"),
    ],
)
def test_a_journal_is_decided_by_the_rules_alone_and_by_those_that_were_asked_for(capsys, key, value, words):
    assert main(["run", "flight.bag", "--map", "flight.yaml", "--out", "out"]) == 0
    Path("x.scenario.yaml").write_text(
        "version: 1\ndescription: x\njournal: out/journal.jsonl\n"
        "expectations: [{expect: exists, of: {state: MISSION}}]\n"
    )
    assert main(["test", "x.scenario.yaml", "--no-goldens", "--set", f"{key}={value}"]) == 4
    assert f"{key} was not looked at: {words}" in capsys.readouterr().out
    assert main(["test", "x.scenario.yaml", "--no-goldens", "--set", "autonomy.takeoff.takeoff_height_m=0.9"]) == 0


@pytest.mark.parametrize(
    "field,paths,meets",
    [
        ("a.b", ("a",), True),
        ("a", ("a.b",), True),
        ("a", ("a[0]",), True),
        ("a", ("ab",), False),
        ("", ("x",), True),
        ("a", ("",), True),
        ("a", (), False),
        ("a", None, False),
    ],
)
def test_a_field_meets_what_is_looked_at(field, paths, meets):
    assert _meets(field, paths) is meets
