"""A recorded flight through the decision code: what is decided, and what each decision came from."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from replay_bags import START_NS, S, break_chunk, flight_rows, write_bag
from replay_runs import moves, replay, texts

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import CheckName
from amaze_autonomy.engine.state import State
from amaze_autonomy.journal.journal import read
from amaze_autonomy.replay.errors import FieldError, MisfitError, ReplayError
from amaze_autonomy.replay.timeline import LineKind

NOMINAL = [
    ("MISSION_INPUT", "PREFLIGHT", "mission_selected"),
    ("PREFLIGHT", "READY", "checks_passed"),
    ("READY", "START_RECORDING", "go_not_required"),
    ("START_RECORDING", "LOAD_MISSION", "recording_proven"),
    ("LOAD_MISSION", "TAKEOFF", "takeoff"),
    ("TAKEOFF", "MISSION", "at_takeoff_height"),
    ("MISSION", "DATA_CLEANUP", "mission_complete"),
    ("DATA_CLEANUP", "MISSION_ENDED", "data_complete"),
]


def test_a_good_flight_is_a_whole_mission(flight_bag, flight_map):
    outcome, recordings = replay(flight_bag, flight_map)
    assert moves(outcome) == NOMINAL
    assert (outcome.state.state, outcome.state.session.result.value) == (State.MISSION_ENDED, "COMPLETE")
    assert (outcome.counterfactual_ns, outcome.missed, recordings.damage) == (None, None, {})


@pytest.mark.parametrize("source, judged", [("range", ["UNKNOWN"]), ("pose", ["UNKNOWN", "ON_GROUND", "AIRBORNE"])])
def test_a_height_is_not_corrected_by_the_tilt_and_a_range_is(tmp_path, flight_map, source, judged):
    """As by the live node; a range says nothing beyond 45 degrees."""
    tilted = (0.0, 0.5, 0.0, 0.8660254)  # by 60 degrees
    bag = write_bag(tmp_path / "x.bag", flight_rows(25.0, orientation=tilted))
    outcome, _ = replay(bag, flight_map, overrides=[f"sensors.landing_detection.source={source}"])
    lines = [text.split(": ")[1] for text in texts(outcome, LineKind.MONITOR) if "landing detection" in text]
    assert [line.split()[0] for line in lines] == judged


def test_a_tilt_limit_of_a_height_is_not_looked_at(flight_bag, flight_map):
    overrides = ["sensors.landing_detection.source=pose", "sensors.landing_detection.max_tilt_deg=30.0"]
    outcome, _ = replay(flight_bag, flight_map, overrides=overrides)
    key = "sensors.landing_detection.max_tilt_deg"
    assert [str(each) for each in outcome.unread] == [
        f"{key} was not looked at: a height (source: pose) is not corrected by the tilt"
    ]


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "rate, limit",
    [
        ("watchdog_action_rate_hz", "watchdog_heartbeat_limit_s"),
        ("planner_status_rate_hz", "planner_status_limit_s"),
        ("autopilot_status_rate_hz", "autopilot_status_limit_s"),
        ("landing_detection_rate_hz", "landing_detection_limit_s"),
        ("recorder_status_rate_hz", "recorder_status_limit_s"),
    ],
)
def test_scripted_statuses_come_as_often_as_is_configured(flight_bag, range_map, rate, limit):
    """With a limit that the shipped rate would break."""
    overrides = [f"autonomy.streams.{rate}=20.0", f"autonomy.failsafe.{limit}=0.15"]
    outcome, _ = replay(flight_bag, range_map, overrides=overrides)
    assert moves(outcome) == NOMINAL
    assert "-> LAND" not in " ".join(texts(outcome))
    lost = [text for text in texts(outcome) if "for 0.15" in text or "longer than 0.15" in text]
    assert lost == []


def test_every_line_says_where_its_input_came_from(flight_bag, flight_map):
    outcome, _ = replay(flight_bag, flight_map)
    assert {line.source.words for line in outcome.timeline} == {"bag", "script", "bag+script"}
    mixed = [line for line in outcome.timeline if line.source.words == "bag+script"]
    told = [line.text for line in mixed if line.kind is LineKind.DECISION]
    assert all(any(f"{name} " in text for name in ("phase", "platforms that record", "waypoint")) for text in told)
    at = {line.t_ns for line in mixed if line.kind is LineKind.DECISION}
    assert all(line.t_ns in at for line in mixed)  # what the user reads of a decision is of its sources
    assert texts(outcome, LineKind.MONITOR) == [
        "+0.000 bag landing detection: UNKNOWN 1 good ranges, 3 are needed",
        "+0.400 bag landing detection: ON_GROUND on the ground",
        "+1.000 bag state check: IMU age 0 s, limit 0.5 s, passes",
        "+1.000 bag state check: gravity magnitude 9.81 m/s^2, limit 9.31 ... 10.3 m/s^2, passes",
        "+1.000 bag state check: tilt 0.0 deg, limit 10.0 deg, passes",
        "+3.020 bag watchdog: imu code 1",
        "+3.020 bag watchdog: lrf code 1",
        "+3.020 bag watchdog: magnetometer code 1",
        "+8.800 bag landing detection: AIRBORNE in the air",
        "+30.600 bag landing detection: ON_GROUND on the ground",
    ]


def test_a_decision_that_looked_at_anything_scripted_is_marked(tmp_path, flight_map, range_map):
    """The planner is scripted in both; the first map names all of the vehicle, the second its range alone."""
    bag = write_bag(tmp_path / "x.bag", flight_rows())
    for topic_map, recorded in ((flight_map, {"lifted_off", "at_takeoff_height"}), (range_map, set())):
        lines = replay(bag, topic_map)[0].timeline
        found = {line.text.partition("  by ")[2].split()[0]: line.scripted for line in lines if "  by " in line.text}
        assert found["mission_complete"]
        assert {rule for rule in ("lifted_off", "at_takeoff_height") if not found[rule]} == recorded


@pytest.mark.parametrize(
    "volts,words",
    [
        (12.3, "as 12.3 V of 3 cells"),
        (42.0, "as 42.0 V of 10 or 11 or 12 cells"),
        (7.2, "as 7.2 V of 2 cells"),
        (1.2, ""),
    ],
)
def test_a_voltage_of_another_battery_says_which_key_is_to_be_changed(tmp_path, flight_map, volts, words):
    rows = flight_rows()
    for _, topic, message in rows:
        if topic == "/battery":
            message.voltage = volts
    path = tmp_path / "volts.yaml"
    path.write_text(
        Path(flight_map).read_text().replace("fraction: percentage", "fraction: percentage, voltage: voltage")
    )
    bag = write_bag(tmp_path / "x.bag", rows)
    outcome, _ = replay(bag, str(path))
    row = next(row for row in outcome.checks[CheckName.BATTERY][1] if row.name == "battery cell voltage")
    assert not row.passed
    said = row.advice.partition("; ")[2]
    if not words:
        assert said == ""
        return
    cells = words.split(" of ")[1].split()[0]
    assert said == f"{words} it would be right (--set sensors.battery.cells={cells})"
    right, _ = replay(bag, str(path), overrides=[f"sensors.battery.cells={cells}"])
    assert moves(right)[1] == ("PREFLIGHT", "READY", "checks_passed")


def test_armed_landed_height_and_battery_are_those_of_the_bag(flight_bag, flight_map):
    outcome, _ = replay(flight_bag, flight_map)
    lines = [line.payload for line in read("\n".join(outcome.journal)).lines]
    vehicle = [event for event in lines if type(event).__name__ == "AutopilotStatus" and event.t_ns > START_NS + S]
    at = {round((event.t_ns - START_NS) / S, 1): event for event in vehicle}
    assert {round(event.battery_fraction, 6) for event in vehicle} == {0.9}
    assert (at[7.4].armed, at[7.8].armed, at[31.6].armed) == (False, True, False)
    assert (at[7.8].landed.name, at[20.0].landed.name, at[30.2].landed.name) == ("ON_GROUND", "IN_AIR", "ON_GROUND")
    assert at[20.0].height_m == pytest.approx(3.0, abs=0.01)


def test_a_sensor_that_falls_silent_in_flight_is_decided_by_the_table(tmp_path, flight_map):
    bag = write_bag(tmp_path / "x.bag", flight_rows(silent={"/imu": (20.0, 20.6)}))
    outcome, _ = replay(bag, flight_map)
    assert moves(outcome)[:7] == [*NOMINAL[:6], ("MISSION", "LAND", "land")]
    lines = texts(outcome, LineKind.MONITOR)
    assert "+20.300 bag watchdog: imu code 1 -> 16 no message on /imu for longer than 0.3 s" in lines
    decided = [text for text in texts(outcome, LineKind.DECISION) if "MISSION -> LAND" in text]
    assert [re.sub(r"#\d+", "#", text) for text in decided] == [
        "+20.300 bag MISSION -> LAND/commanding by land (failure imu; code 16; action land; reason no message on /imu "
        "for longer than 0.3 s) => MissionCommand(LAND)#"
    ]


def test_after_a_command_that_the_vehicle_did_not_get_all_is_counterfactual(tmp_path, flight_map):
    bag = write_bag(tmp_path / "x.bag", flight_rows(silent={"/imu": (20.0, 20.6)}))
    outcome, _ = replay(bag, flight_map)
    assert ((outcome.counterfactual_ns - START_NS) / S, outcome.missed) == (20.3, MissionAction.LAND)
    for line in outcome.timeline:
        assert line.counterfactual == (line.t_ns > outcome.counterfactual_ns)
    assert any(text.startswith(("~ +20.4", "~ +20.5")) for text in texts(outcome))


def test_a_landing_that_the_vehicle_does_within_the_time_is_not_counterfactual(tmp_path, flight_map):
    bag = write_bag(tmp_path / "x.bag", flight_rows(silent={"/imu": (25.0, 25.6)}))  # it lands from 26 s on
    outcome, _ = replay(bag, flight_map)
    assert ("MISSION", "LAND", "land") in moves(outcome)
    assert outcome.counterfactual_ns is None
    assert outcome.state.session.result.value == "LANDED_EARLY"


def test_a_takeoff_that_never_was_makes_the_rest_counterfactual(tmp_path, range_map):
    rows = [row for row in flight_rows() if row[1] != "/range"]
    rows += [row for row in flight_rows(7.5) if row[1] == "/range"]  # it stands for 7.5 s, then nothing tells
    outcome, _ = replay(write_bag(tmp_path / "x.bag", rows), range_map)
    assert (outcome.missed, (outcome.counterfactual_ns - START_NS) / S) == (MissionAction.TAKEOFF, 7.001)


def test_a_tilted_vehicle_does_not_take_off_and_the_user_retries_then_gives_up(tmp_path, range_map):
    outcome, _ = replay(write_bag(tmp_path / "x.bag", flight_rows(tilt_deg=20.0)), range_map)
    assert moves(outcome) == [
        ("MISSION_INPUT", "PREFLIGHT", "mission_selected"),
        ("PREFLIGHT", "OUTREACH", "checks_failed"),
        ("OUTREACH", "PREFLIGHT", "retry"),
        ("PREFLIGHT", "OUTREACH", "checks_failed"),
        ("OUTREACH", "MISSION_INPUT", "give_up_unrecorded"),
    ]
    tilt = "state check: tilt 20.0 deg, limit 10.0 deg (vehicle is tilted 20 deg backward, limit 10 deg)"
    assert any(tilt in text for text in texts(outcome, LineKind.MONITOR))


def test_a_recorded_vehicle_that_flies_though_the_checks_failed_is_the_pilots(tmp_path, flight_map):
    outcome, _ = replay(write_bag(tmp_path / "x.bag", flight_rows(tilt_deg=20.0)), flight_map)
    assert moves(outcome)[3:] == [
        ("PREFLIGHT", "OUTREACH", "checks_failed"),
        ("OUTREACH", "PILOT", "armed_by_others"),
        ("PILOT", "DATA_CLEANUP", "acknowledged"),
        ("DATA_CLEANUP", "MISSION_ENDED", "nothing_to_collect"),
    ]


def test_an_empty_battery_does_not_take_off(tmp_path, flight_map):
    outcome, _ = replay(write_bag(tmp_path / "x.bag", flight_rows(fraction=0.2)), flight_map)
    assert moves(outcome)[1] == ("PREFLIGHT", "OUTREACH", "checks_failed")
    assert "20% is left" in " ".join(texts(outcome))


@pytest.mark.parametrize("fraction", [-1.0, -0.53, float("nan"), 53.0])
def test_a_battery_that_says_nonsense_is_unknown(tmp_path, flight_map, fraction):
    outcome, _ = replay(write_bag(tmp_path / "x.bag", flight_rows(fraction=fraction)), flight_map)
    assert moves(outcome)[1] == ("PREFLIGHT", "OUTREACH", "checks_failed")
    assert "the level is unknown" in " ".join(texts(outcome))


def test_an_orientation_of_zeros_changes_nothing(tmp_path, flight_map):
    outcome, _ = replay(write_bag(tmp_path / "x.bag", flight_rows(orientation=(0.0, 0.0, 0.0, 0.0))), flight_map)
    assert moves(outcome) == NOMINAL


def test_two_bags_of_one_flight_are_one_recording(tmp_path, flight_map, flight_bag):
    rows = flight_rows()
    one = write_bag(tmp_path / "one.bag", [row for row in rows if row[1] in ("/imu", "/mag")])
    other = write_bag(tmp_path / "other.bag", [row for row in rows if row[1] not in ("/imu", "/mag")])
    whole, _ = replay(flight_bag, flight_map)
    for order in ([one, other], [other, one]):
        assert replay(order, flight_map)[0].journal == whole.journal


def test_before_the_recording_begins_the_script_plays(tmp_path, flight_map):
    text = Path(flight_map).read_text().replace("select_at_s: 3.0", "select_at_s: -2.0, sensors_until_s: 0.5")
    path = tmp_path / "early.yaml"
    path.write_text(text)
    outcome, _ = replay(write_bag(tmp_path / "x.bag", flight_rows()), str(path))
    first = outcome.decisions[0]
    assert (first.rule, (first.t_ns - START_NS) / S) == ("mission_selected", -2.0)
    assert moves(outcome)[:3] == NOMINAL[:3]
    assert texts(outcome, LineKind.DECISION)[1].startswith("~ -1.999 script PREFLIGHT -> READY by checks_passed")


def test_a_field_that_the_messages_do_not_have_is_one_clear_error(tmp_path, flight_map, flight_bag):
    path = tmp_path / "wrong.yaml"
    path.write_text(Path(flight_map).read_text().replace("{topic: /range}", "{topic: /range, distance: 'values[5]'}"))
    with pytest.raises(
        FieldError, match=r"^/range: values\[5\]: sensor_msgs/Range has no such field; it has header, rad"
    ):
        replay(flight_bag, str(path))


def test_a_mission_that_does_not_exist_is_refused_with_those_that_do(flight_bag, flight_map):
    with pytest.raises(ReplayError, match=r"^there is no mission '99'; there are 1, "):
        replay(flight_bag, flight_map, mission="99")


def test_a_damaged_chunk_gives_a_partial_replay_that_says_so(tmp_path, flight_map):
    bag = write_bag(tmp_path / "x.bag", flight_rows(), "bz2")
    break_chunk(bag, 4, 100, 100)
    outcome, recordings = replay(bag, flight_map)
    assert set(recordings.damage) == {"/imu", "/range", "/battery", "/armed", "/landed"}
    assert recordings.damage["/imu"].count > 0
    assert outcome.state.state is State.MISSION_ENDED or outcome.counterfactual_ns is not None


def test_messages_that_are_not_what_the_map_takes_them_for_are_one_clear_error(tmp_path, flight_map, flight_bag):
    path = tmp_path / "wrong.yaml"
    path.write_text(Path(flight_map).read_text().replace("imu: {topic: /imu, turn", "imu: {topic: /range, turn"))
    with pytest.raises(FieldError, match=r"^/range: orientation: sensor_msgs/Range has no such field; .* range$"):
        replay(flight_bag, str(path))
    path.write_text(Path(flight_map).read_text() + "statuses: {autopilot: /battery}\n")
    with pytest.raises(MisfitError, match=r"^/battery: sensor_msgs/BatteryState is not what the map takes it for: "):
        replay(flight_bag, str(path))
    wrong = "  estimate: {topic: /imu}\n  imu: {topic: /imu, turn"
    path.write_text(Path(flight_map).read_text().replace("  imu: {topic: /imu, turn", wrong))
    with pytest.raises(MisfitError, match=r"^/imu: sensor_msgs/Imu is not what the map takes it for: "):
        replay(flight_bag, str(path))


def test_a_recording_in_simulated_time_that_begins_at_zero_is_replayed(tmp_path, flight_map):
    rows = [(t - START_NS, topic, message) for t, topic, message in flight_rows()]
    outcome, _ = replay(write_bag(tmp_path / "x.bag", rows), flight_map)
    assert moves(outcome) == NOMINAL
