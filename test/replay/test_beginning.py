"""A recording that begins in the air is judged from there: recorded facts win, what is scripted is marked, no jump."""

from __future__ import annotations

import json
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from replay_bags import START_NS, S, battery, distance, flight_rows, imu, make, write_bag
from replay_demo import odometry
from replay_runs import moves, recording, replay, texts

from amaze_autonomy.engine.state import State
from amaze_autonomy.journal.journal import read
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.tester.command import main

MAP = """\
about: a quadrotor that is recorded from the air on
components:
  imu: {topic: /imu, rate_hz: 50.0, age_limit_s: 0.3}
readings:
  imu: {topic: /imu}
  height: {topic: /odometry, height: pose.pose.position.z}
  armed: {topic: /armed}
  battery: {topic: /battery, fraction: percentage}
"""
MORE = {
    "range": "  range: {topic: /range}\n",
    "landed": "  landed: {topic: /landed, landed: data, on_ground: [1]}\n",
}
AIR_TO_GROUND = [("TAKEOFF", "MISSION", "at_takeoff_height"), ("MISSION", "DATA_CLEANUP", "mission_complete")]


def in_the_air(path, height_m, armed=lambda _: True, length_s=20.0, fraction=0.6, silent_s=(99.0, 99.0)):
    """Write a recording that begins at 18 m, armed; return its path.

    Args:
        path: of the bag.
        height_m: by the time in seconds.
        armed: by the time.
        length_s: of it.
        fraction: of the battery.
        silent_s: when the IMU is.
    """
    rows = []
    for step in range(int(length_s * 50)):
        t_s = step / 50
        at = START_NS + step * S // 50
        if not silent_s[0] <= t_s < silent_s[1]:
            rows.append((at, "/imu", imu(at)))
        if step % 5 == 0:
            pose = odometry(at)
            pose.pose.pose.position.z = float(height_m(t_s))
            rows += [(at, "/odometry", pose), (at, "/armed", make("std_msgs/msg/Bool", data=bool(armed(t_s))))]
            rows.append((at, "/range", distance(at, min(39.0, 0.1 + height_m(t_s)))))
            rows.append((at, "/landed", make("std_msgs/msg/UInt8", data=1 if height_m(t_s) <= 0.05 else 2)))
            rows.append((at, "/battery", battery(at, fraction)))
    return write_bag(path, rows)


@pytest.fixture
def air_map(tmp_path):
    path = tmp_path / "air.yaml"
    path.write_text(MAP)
    return str(path)


def descent(t_s):
    """18 m, from 8 s on down at 2 m/s."""
    return min(18.0, max(0.0, 18.0 - 2.0 * (t_s - 8.0)))


def test_it_is_judged_from_the_first_message_on(tmp_path, air_map):
    bag = in_the_air(tmp_path / "x.bag", lambda _: 18.0, silent_s=(10.0, 11.0))
    outcome, _ = replay(bag, air_map)
    found = [(d.before, d.after, d.rule, round((d.t_ns - START_NS) / S, 1)) for d in outcome.decisions]
    before = [each for each in found if each[3] < 0]
    assert [each[:3] for each in before if each[0] != each[1]][-1] == ("TAKEOFF", "MISSION", "at_takeoff_height")
    assert next(each for each in found if each[3] >= 0 and each[0] != each[1]) == ("MISSION", "LAND", "land", 10.3)
    assert "disarm" not in " ".join(texts(outcome)).lower()
    words = "+0.000 bag the recording begins in the air at 18.0 m (armed at 18.0 m): it is judged from here, what led"
    assert any(text.startswith(words) for text in texts(outcome, LineKind.NOTE))


def test_all_that_led_to_it_is_marked_as_scripted_in_text_and_json(tmp_path, air_map, capsys):
    bag = in_the_air(tmp_path / "x.bag", lambda _: 18.0)
    outcome, _ = replay(bag, air_map)
    early = [line for line in outcome.timeline if line.t_ns < START_NS]
    assert len(early) > 5
    assert all(line.scripted for line in early)
    assert main(["run", str(bag), "--map", air_map, "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert all(line["scripted"] for line in plain["timeline"] if line["t_s"] < 0)
    assert not all(line["scripted"] for line in plain["timeline"])
    assert plain["begins"] == {"airborne": True, "height_m": 18.0, "reason": "armed at 18.0 m"}
    assert main(["run", str(bag), "--map", air_map]) == 0
    assert all(line.startswith("~") for line in capsys.readouterr().out.splitlines() if line[4:].startswith("   -"))


def test_script_and_recording_are_joined_without_a_jump(tmp_path, air_map):
    bag = in_the_air(tmp_path / "x.bag", lambda _: 18.0, fraction=0.35)
    outcome, _ = replay(bag, air_map)
    said = [line.payload for line in read("\n".join(outcome.journal) + "\n").lines]
    vehicle = [each for each in said if type(each).__name__ == "AutopilotStatus"]
    climb = [each for each in vehicle if each.t_ns > START_NS - 3 * S and each.t_ns < START_NS + S]
    assert max(abs(b.height_m - a.height_m) for a, b in zip(climb, climb[1:])) < 3.5
    joint = [each for each in climb if abs(each.t_ns - START_NS) < S // 2]
    assert [round(each.height_m, 2) for each in joint] == pytest.approx([18.0] * len(joint), abs=0.3)
    levels = [each.battery_fraction for each in vehicle]
    assert levels[0] == pytest.approx(0.95, abs=0.01)
    assert max(abs(b - a) for a, b in zip(levels, levels[1:])) < 0.02
    assert levels[-1] == pytest.approx(0.35)


def test_a_landing_that_is_recorded_ends_the_flight_and_nothing_else_does(tmp_path, air_map):
    bag = in_the_air(tmp_path / "x.bag", descent, armed=lambda t_s: t_s < 19.0, length_s=24.0)
    outcome, _ = replay(bag, air_map)
    assert moves(outcome)[-3:-1] == AIR_TO_GROUND or moves(outcome)[-2:] == AIR_TO_GROUND
    ended = next(d for d in outcome.decisions if d.after == "DATA_CLEANUP")
    assert (ended.t_ns - START_NS) / S > 19.0
    assert outcome.counterfactual_ns is None


def test_sinking_half_a_metre_is_no_landing(tmp_path, air_map):
    bag = in_the_air(tmp_path / "x.bag", lambda t_s: 18.0 if t_s < 11.0 else 17.2, silent_s=(10.0, 10.8))
    outcome, _ = replay(bag, air_map)
    assert (outcome.missed.name, round((outcome.counterfactual_ns - START_NS) / S, 1)) == ("LAND", 10.3)


def test_a_descent_to_the_ground_is_a_landing_however_long_it_takes(tmp_path, air_map):
    bag = in_the_air(tmp_path / "x.bag", descent, armed=lambda t_s: t_s < 19.0, length_s=24.0, silent_s=(8.0, 8.8))
    outcome, _ = replay(bag, air_map)
    assert ("MISSION", "LAND", "land") in moves(outcome)
    assert outcome.counterfactual_ns is None


def test_recorded_motors_that_turn_keep_a_scripted_vehicle_from_having_landed(tmp_path):
    path = tmp_path / "armed.yaml"
    path.write_text("".join(line for line in MAP.splitlines(True) if "height" not in line) + "script: {begins: air}\n")
    bag = in_the_air(tmp_path / "x.bag", lambda _: 18.0, silent_s=(5.0, 6.0), length_s=40.0)
    outcome, _ = replay(bag, str(path))
    assert ("MISSION", "LAND", "land") in moves(outcome)
    assert "still armed" not in " ".join(texts(outcome))
    assert outcome.state.state is State.LAND


@pytest.mark.parametrize("reading", MORE)
def test_landed_and_range_tell_that_it_flies(tmp_path, reading):
    path = tmp_path / "more.yaml"
    path.write_text("".join(line for line in MAP.splitlines(True) if "armed" not in line) + MORE[reading])
    outcome, _ = replay(in_the_air(tmp_path / "x.bag", lambda _: 18.0), str(path))
    reason = {"range": "the range says AIRBORNE", "landed": "landed is IN_AIR"}[reading]
    assert f"in the air at 18.0 m ({reason})" in " ".join(texts(outcome, LineKind.NOTE))
    assert outcome.state.state is State.MISSION


def test_a_map_may_say_that_it_begins_on_the_ground_and_the_contradiction_is_said(tmp_path, air_map):
    Path(air_map).write_text(MAP + MORE["landed"] + "script: {begins: ground}\n")
    outcome, _ = replay(in_the_air(tmp_path / "x.bag", lambda _: 18.0), air_map)
    assert "contradiction: the recorded vehicle flies, and nothing here has commanded a takeoff" in " ".join(
        texts(outcome)
    )
    selected, landed = ("MISSION_INPUT", "PREFLIGHT", "mission_selected"), ("PREFLIGHT", "LAND", "started_armed")
    assert moves(outcome)[:2] == [selected, landed]


def test_a_scripted_estimate_is_where_the_recorded_one_is_first(tmp_path):
    rows = [row for row in flight_rows() if row[0] >= START_NS + 2 * S // 10]
    for step in range(36 * 30):
        at = START_NS + 4 * S // 10 + step * S // 30
        pose = odometry(at)
        pose.pose.pose.position.x, pose.pose.pose.position.y = 4.0, -3.0
        turn = pose.pose.pose.orientation
        turn.z, turn.w = sin(1.0), cos(1.0)
        rows.append((at, "/odometry", pose))
    text = (Path(__file__).parent / "flight.yaml").read_text()
    text = text.replace("readings:\n", "readings:\n  estimate: {topic: /odometry}\n")
    path = tmp_path / "estimate.yaml"
    path.write_text(text.replace("select_at_s: 3.0", "select_at_s: 0.6, sensors_until_s: 1.0"))
    outcome, _ = replay(write_bag(tmp_path / "x.bag", sorted(rows, key=lambda row: row[0])), str(path))
    assert ("LOAD_MISSION", "TAKEOFF", "takeoff") in moves(outcome)
    drift = [row for _, rows in outcome.checks.values() for row in rows if row.name == "estimate drift"]
    assert all(row.passed for row in drift)
    assert not np.isnan([row.value for row in drift]).any()


def test_the_real_flight_that_begins_in_the_air_is_judged_from_its_first_second():
    outcome, _ = replay(recording("ardrone_indoor_flight.bag"))
    assert "the recording begins in the air at 0.7 m (the map says so, " in " ".join(texts(outcome, LineKind.NOTE))
    first = next(d for d in outcome.decisions if d.t_ns >= outcome.start_ns and d.before != d.after)
    assert (first.before, first.after) == ("MISSION", "LAND")
