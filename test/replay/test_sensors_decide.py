"""Where a bag has the sensors they decide; what the nodes of the flight said is compared, and a key is looked at."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import pytest
from replay_bags import START_NS, S, flight_rows, write_bag
from replay_demo import demo_bag, simulated
from replay_runs import moves, replay, texts

from amaze_autonomy.engine.events import AutopilotStatus, CheckName, Landed, LandedStatus, Mission, VehicleLanded
from amaze_autonomy.engine.rules import Limits
from amaze_autonomy.journal.journal import read
from amaze_autonomy.replay.changed_keys import MISSION_FACTS, facts_of
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.simulation.scenario_file import parse_scenario
from amaze_autonomy.tester.command import main

pytestmark = pytest.mark.long

GPS = "sensors.components.gps"
RECORDED = Path(__file__).parents[1] / "scenarios" / "recorded" / "demo_flight.bag"
FASTER = f"{GPS}.topics./px4/gps.rate_hz=25.0"


@pytest.fixture(scope="module")
def flown():
    return simulated()


@pytest.fixture(scope="module")
def bag(flown, tmp_path_factory):
    return demo_bag(tmp_path_factory.mktemp("sensors") / "demo.bag", flown)


def test_a_rule_that_the_recorded_sensors_break_is_decided_although_the_recorded_watchdog_was_content(bag):
    outcome, _ = replay(bag, "amaze_demo", overrides=[f"{GPS}.severity=highest", FASTER])
    monitor = texts(outcome, LineKind.MONITOR)
    assert "~ " not in next(line for line in monitor if "gps code 1 -> 16 5 Hz on /px4/gps, below 7.5 Hz" in line)
    assert moves(outcome) != moves(replay(bag, "amaze_demo")[0])
    assert "in flight gps was code 1, by the recorded sensors it is code 16" in " ".join(monitor)
    assert [(each.about, each.recorded, each.judged) for each in outcome.disagreements] == [
        ("gps", "code 1", "code 16")
    ]
    assert outcome.unread == ()


def test_the_map_can_let_the_recorded_statuses_decide_and_then_the_keys_are_named(bag, tmp_path, capsys):
    shipped = Path("src/amaze_autonomy/replay/maps/amaze_demo.yaml")
    path = tmp_path / "told.yaml"
    path.write_text((Path(__file__).parents[2] / shipped).read_text() + "recorded_statuses: decide\n")
    words = ["run", str(bag), "--map", str(path), "--set", f"{GPS}.severity=highest", "--set", FASTER]
    assert main(words) == 4
    out = capsys.readouterr().out.splitlines()
    assert [line for line in out if line.startswith("VACUOUS")] == [
        f"VACUOUS: {GPS}.severity was not looked at: the map takes what the recorded watchdog said",
        f"VACUOUS: {FASTER.partition('=')[0]} was not looked at: the map takes what the recorded watchdog said",
    ]
    assert main([*words, "--json"]) == 4
    assert [each["key"] for each in json.loads(capsys.readouterr().out)["not_looked_at"]] == [
        f"{GPS}.severity",
        FASTER.partition("=")[0],
    ]


def test_what_the_recorded_nodes_said_is_what_the_sensors_say(bag, capsys):
    assert main(["run", str(bag), "--map", "amaze_demo"]) == 0
    assert (
        "The recorded watchdog and landing detection said what the recorded sensors say.\n" in capsys.readouterr().out
    )


def test_a_recorded_watchdog_that_falls_silent_in_flight_is_silent_in_the_replay(tmp_path, flown):
    whole, _ = replay(demo_bag(tmp_path / "whole.bag", flown), "amaze_demo")
    airborne = next(d.t_ns for d in whole.decisions if d.after == "MISSION")
    silent_s = (airborne - START_NS) / S + 2.0
    outcome, _ = replay(demo_bag(tmp_path / "x.bag", flown, action_until_s=silent_s), "amaze_demo")
    found = next(d for d in outcome.decisions if d.after == "LAND")
    assert found.before == "MISSION"
    assert "watchdog_heartbeat" in str(found.values)
    assert 0.3 < (found.t_ns - START_NS) / S - silent_s < 0.7


def without(tmp_path, *lines):
    """Return the shipped map without the lines that hold some words."""
    shipped = (Path(__file__).parents[2] / "src/amaze_autonomy/replay/maps/amaze_demo.yaml").read_text()
    path = tmp_path / "less.yaml"
    path.write_text("".join(each for each in shipped.splitlines(True) if not any(words in each for words in lines)))
    return str(path)


def test_a_landing_detection_that_nobody_recorded_says_what_the_recorded_autopilot_says(bag, tmp_path):
    outcome, _ = replay(bag, without(tmp_path, "  range:", "landing_detection:", "mission_planner:", "journal:"))
    said, known = [], None
    for each in (line.payload for line in read("\n".join(outcome.journal) + "\n").lines):
        if isinstance(each, AutopilotStatus):
            known = each
        elif isinstance(each, LandedStatus) and each.t_ns > START_NS + 3 * S:
            said.append((known.landed is VehicleLanded.ON_GROUND, each.landed is Landed.ON_GROUND, each.reason))
    assert {one for one, _, _ in said} == {True, False}
    assert [each for each in said if each[0] is not each[1]] == []
    assert {reason for _, _, reason in said} == {"the recorded vehicle says so"}


def test_a_recorded_autopilot_that_flies_contradicts_an_engine_that_commanded_no_takeoff(bag, tmp_path):
    outcome, _ = replay(bag, without(tmp_path, "journal:", "script:"), overrides=[f"{GPS}.severity=highest", FASTER])
    assert ("PREFLIGHT", "OUTREACH", "checks_failed") in moves(outcome)
    told = [text for text in texts(outcome) if "contradiction:" in text]
    assert [text.partition("contradiction: ")[2] for text in told] == [
        "the recorded vehicle flies, and nothing here has commanded a takeoff"
    ]


@pytest.mark.parametrize("select_s,passes", [(3.0, True), (12.0, False)])
def test_a_check_that_it_stands_on_the_ground_is_answered_by_the_recorded_vehicle(tmp_path, select_s, passes):
    """It has no range, its motors are scripted, and it flies from 8 s on."""
    lines = (Path(__file__).parent / "flight.yaml").read_text().splitlines(True)
    kept = [each for each in lines if not any(words in each for words in ("range:", "lrf:", "armed:", "landing:"))]
    path = tmp_path / "landed.yaml"
    path.write_text("".join(kept).replace("select_at_s: 3.0", f"select_at_s: {select_s}"))
    outcome, _ = replay(write_bag(tmp_path / "x.bag", flight_rows()), str(path))
    source, (row,) = outcome.checks[CheckName.ON_GROUND]
    said = "ON_GROUND" if passes else "IN_AIR"
    assert (source.words, row.passed, row.name) == ("bag", passes, "landed state")
    assert row.advice == f"the recorded vehicle says {said}"
    rules = [rule for before, _, rule in moves(outcome) if before == "PREFLIGHT"]
    assert rules[0] == ("checks_passed" if passes else "checks_failed")


CAMERA = """
description: the camera, of which the recording has no topic, fails in flight
faults:
  - {component: mission_camera, fault: silent, after: {event: airborne, delay_s: 4.0}}
"""


def test_of_a_component_without_a_topic_in_the_bag_the_recorded_watchdog_is_believed(tmp_path):
    lines = simulated(parse_scenario(CAMERA))
    outcome, _ = replay(demo_bag(tmp_path / "x.bag", lines), "amaze_demo")
    assert [(before, after) for before, after, _ in moves(outcome)][5:8] == [
        ("TAKEOFF", "MISSION"),
        ("MISSION", "LAND"),
        ("LAND", "DATA_CLEANUP"),
    ]
    assert any("mission_camera code 1 -> 16" in line for line in texts(outcome, LineKind.MONITOR))


UNREAD = {
    "sensors.components.lrf.restart.attempts=2": "lrf never failed",
    "sensors.components.lrf.wait_limit_s=14.0": "no decision asked for it: lrf never failed",
    "sensors.components.mission_camera.severity=low": "the recording has no topic of mission_camera",
    "sensors.landing_detection.max_vertical_speed_m_s=0.3": "the landing detection of a replay has the range alone, "
    "no vertical speed",
    "sensors.components.lrf.topics./lrf/range.finite=true": "a replay by the map amaze_demo does not read it",
    "sensors.components.lrf.topics./lrf/range.unchanged_limit_s=5.0": "a replay by the map amaze_demo does not read it",
    "sensors.components.lrf.topics./lrf/range.stamp_tolerance_s=0.000001": "a replay by the map amaze_demo does not "
    "read it",
    "sensors.battery.cells=6": "a replay by the map amaze_demo does not read it",
    "recording.growth_limit_s=3.5": "a replay by the map amaze_demo does not read it",
    "autonomy.streams.watchdog_action_rate_hz=6.0": "it is how often the script speaks, no data of the recording",
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("key", UNREAD)
def test_a_key_that_nothing_looked_at_is_named_with_the_reason(bag, key, capsys):
    assert main(["run", str(bag), "--map", "amaze_demo", "--set", key]) == 4
    assert f"VACUOUS: {key.partition('=')[0]} was not looked at: {UNREAD[key]}\n" in capsys.readouterr().out


CONTENTS = (
    "sensors.components.lrf.topics./lrf/range.finite=true",
    "sensors.components.imu.topics./px4/imu.stamp_tolerance_s=0.000001",
)


def test_contents_are_not_judged_and_that_is_said(bag, capsys):
    plain, _ = replay(bag, "amaze_demo")
    asked, _ = replay(bag, "amaze_demo", overrides=CONTENTS)
    assert moves(asked) == moves(plain)
    changed = [argument for key in CONTENTS for argument in ("--set", key)]
    assert main(["run", str(bag), "--map", "amaze_demo", *changed]) == 4
    said = "Judged by the rate alone: /px4/imu, /lrf/range; no content or stamp is read here."
    assert f"\n{said}\n" in capsys.readouterr().out


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "key",
    [
        "autonomy.takeoff.takeoff_height_m=0.9",
        "autonomy.recording.recording_lead_s=2.9",
        "autonomy.flight.max_tilt_deg=60.0",
        "sensors.components.imu.severity=low",
        "sensors.components.lrf.topics./lrf/range.age_limit_s=0.29",
        "sensors.landing_detection.ground_distance_m=0.11",
        "sensors.state_estimation.tilt_limit_deg=9.5",
        "sensors.components.gps.severity=low",  # as it is configured: nothing is changed
    ],
)
def test_a_key_that_was_looked_at_is_not_named_whether_or_not_it_decides_otherwise(bag, key):
    outcome, _ = replay(bag, "amaze_demo", overrides=[key])
    assert outcome.unread == ()


def test_what_the_script_tells_is_no_data_of_the_bag(flight_bag, flight_map):
    outcome, _ = replay(flight_bag, flight_map, overrides=["autonomy.flight.max_distance_m=50.0"])
    assert [str(each) for each in outcome.unread] == [
        "autonomy.flight.max_distance_m was not looked at: position: scripted, not recorded"
    ]


def test_a_recording_of_before_the_tilt_does_not_know_it():
    outcome, _ = replay(RECORDED, "amaze_demo", overrides=["autonomy.flight.max_tilt_deg=50.0"])
    assert [str(each) for each in outcome.unread] == [
        "autonomy.flight.max_tilt_deg was not looked at: no decision asked for it"
    ]


def test_every_limit_of_the_engine_says_what_it_limits():
    silent = [each.name for each in fields(Limits) if not facts_of(each.name)]
    assert silent == ["clock_stall_limit_ns"]  # no recording tells what the clock of a live node did
    assert set(MISSION_FACTS) < {each.name for each in fields(Mission)}


def test_noted_rules_are_the_same_rules(bag):
    plain, _ = replay(bag, "amaze_demo")
    noted, _ = replay(bag, "amaze_demo", overrides=["autonomy.takeoff.takeoff_height_m=0.9"])
    again, _ = replay(bag, "amaze_demo", overrides=["autonomy.takeoff.takeoff_height_m=1.0"])
    assert again.journal == plain.journal
    assert noted.journal[1:] != plain.journal[1:]
    assert replace(Limits(), takeoff_height_m=0.9) != Limits()
