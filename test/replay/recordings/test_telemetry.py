"""Telemetry logs, and MAVLink in bags, through the engine: what it would have done, beside what PX4 did by itself."""

from __future__ import annotations

import os
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from replay_bags import START_NS, S, distance, write_bag
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.link.framing import frame_at, read_tlog
from amaze_autonomy.bags import BagError
from amaze_autonomy.config import load_configuration
from amaze_autonomy.paths import config_folder
from amaze_autonomy.replay.errors import TimeJumpError
from amaze_autonomy.replay.faults.stream import FaultedRecordings
from amaze_autonomy.replay.maps.proposal import propose
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.export import export
from amaze_autonomy.replay.recordings.sources import Recordings, recordings_of, topics_of
from amaze_autonomy.replay.recordings.telemetry import Telemetry
from amaze_autonomy.replay.session import Session
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.tester.command import main

ROOT = Path(__file__).parents[3]
DATA = Path(os.environ.get("AMAZE_DATA", Path(__file__).parents[4] / "shared" / "data"))
MAVLINK = """std_msgs/Header header
uint8 framing_status
uint8 magic
uint8 len
uint8 incompat_flags
uint8 compat_flags
uint8 seq
uint8 sysid
uint8 compid
uint32 msgid
uint16 checksum
uint64[] payload64
uint8[] signature
"""


def recording(name):
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"{path} is not there: set AMAZE_DATA to the folder of the recordings")
    return path


def replayed(path, map_name, *overrides):
    """Return the decisions in flight of a recording: time in s, state after, rule, and the outcome."""
    configuration = load_configuration(config_folder(), overrides)
    plan = make_plan(configuration, load_map(map_name), configuration.missions[0].id, topics_of([path]))
    with Recordings([path], plan.topics) as recordings:
        outcome = Session(plan, recordings).run()
        assert not recordings.damage
    rows = [
        (round((each.t_ns - outcome.start_ns) / 1e9, 1), each.after, each.rule)
        for each in outcome.decisions
        if each.before != each.after
    ]
    return rows, outcome


BEFORE = ["MISSION_INPUT", "PREFLIGHT", "READY", "START_RECORDING", "LOAD_MISSION", "TAKEOFF"]


def test_a_normal_mission_is_flown_to_its_end():
    """PX4: takeoff 1.75, landing 43.7, ON_GROUND 66.4, disarmed 66.5 (heard 66.8)."""
    rows, outcome = replayed(recording("px4_normal_mission.tlog"), "px4_telemetry")
    assert [row for row in rows if row[0] > 1.2] == [
        (7.6, "MISSION", "at_takeoff_height"),
        (67.4, "DATA_CLEANUP", "mission_complete"),
        (68.5, "MISSION_ENDED", "data_complete"),
    ]
    assert (outcome.state.session.result.value, outcome.counterfactual_ns) == ("COMPLETE", None)


def test_a_log_whose_clock_was_set_back_is_said(tmp_path):
    """Its records are put in order of time, so that a silence of three seconds would be filled by what came later."""
    data, said = recording("px4_normal_mission.tlog").read_bytes(), []
    begin_us, place = int.from_bytes(data[:8], "big"), 0
    while place + 8 < len(data):
        end = place + 8 + frame_at(data, place + 8).length
        stamp_us = int.from_bytes(data[place : place + 8], "big")
        said.append((stamp_us - 3_000_000 * (stamp_us >= begin_us + 20_000_000)).to_bytes(8, "big"))
        said.append(data[place + 8 : end])
        place = end
    (tmp_path / "x.tlog").write_bytes(b"".join(said))
    with Recordings([tmp_path / "x.tlog"], ("/autopilot/status",)) as recordings:
        (problem,) = recordings.problems
    assert re.match(r"x\.tlog: its clock was set back by 2\.99\d s or more at \+\d+\.\d+ s: ", problem)


def test_a_lost_gps_is_flown_on_without_until_px4_itself_lands():
    """PX4: fix lost 21.8, failsafe announced 26.9, AUTO.LAND 27.7. The engine: GPS counts as low, so it flies on.

    It needs two reports of it, which come five times a second.
    """
    rows, outcome = replayed(recording("px4_gps_loss_param.tlog"), "px4_telemetry")
    assert [row for row in rows if row[0] > 1.2] == [
        (6.8, "MISSION", "at_takeoff_height"),
        (28.0, "PILOT", "pilot_took_over"),
        (48.0, "DATA_CLEANUP", "acknowledged"),
        (49.5, "MISSION_ENDED", "data_complete"),
    ]
    seen = [each for each in outcome.decisions if each.rule == "failure_continue"]
    assert [round((each.t_ns - outcome.start_ns) / 1e9, 1) for each in seen][:1] == [22.2]


def test_where_gps_counts_as_high_the_engine_lands_before_px4_does():
    path = recording("px4_gps_loss_param.tlog")
    rows, _ = replayed(path, "px4_telemetry", "sensors.components.gps.severity=highest")
    assert [row for row in rows if 6.8 < row[0] < 30][:1] == [(22.2, "LAND", "land")]


def test_a_drained_battery_is_landed_five_seconds_before_px4_acts():
    """PX4: LOW 58.1, CRITICAL and AUTO.LOITER 63.0 to 63.4, AUTO.LAND 68.5."""
    path = recording("px4_battery_drain.tlog")
    rows, outcome = replayed(path, "px4_telemetry", "autonomy.flight.max_distance_m=1000")
    assert [row for row in rows if row[0] > 4.5][:3] == [
        (10.3, "MISSION", "at_takeoff_height"),
        (57.9, "LAND", "land"),
        (63.7, "PILOT", "pilot_took_over"),
    ]
    assert round((outcome.counterfactual_ns - outcome.start_ns) / 1e9, 1) == 57.9


def test_a_lost_stream_of_set_points_is_px4_s_failsafe():
    """PX4: stream stops 28.8, failsafe 29.8, POSCTL heard 30.0."""
    rows, _ = replayed(recording("px4_offboard.tlog"), "px4_telemetry")
    assert [row for row in rows if row[0] > 1.2] == [
        (6.8, "MISSION", "at_takeoff_height"),
        (30.3, "PILOT", "pilot_took_over"),
    ]


@pytest.mark.slow_rows
@pytest.mark.parametrize(
    "name, shown",
    [
        ("px4_normal_mission", {"in MISSION from": "MISSION", "ended at": "DATA_CLEANUP"}),
        ("px4_gps_loss_param", {"PILOT at": "PILOT"}),
        ("px4_battery_drain", {"land for that at": "LAND"}),
        ("px4_offboard", {"PILOT at": "PILOT"}),
    ],
)
def test_the_times_that_the_page_tells_of_a_log_are_those_of_its_replay(name, shown):
    rows, _ = replayed(recording(f"{name}.tlog"), "px4_telemetry")
    page = (ROOT / "docs" / "replay.md").read_text()
    (line,) = [line for line in page.splitlines() if line.startswith(f"| `{name}` | ")]
    for words, state in shown.items():
        times = [f"{t_s:.1f}" for t_s, each, _ in rows if each == state]
        assert re.findall(rf"{words} ([\d.]+) s", line) == times[:1], words


def test_a_braking_px4_peaks_at_49_deg_and_only_what_lasts_is_warned_of_or_landed_for():
    path = recording("px4_offboard.tlog")
    _, outcome = replayed(path, "px4_telemetry")
    assert "failure_continue" not in [each.rule for each in outcome.decisions]
    rows, outcome = replayed(
        path, "px4_telemetry", "autonomy.flight.tilt_warning_deg=30", "autonomy.flight.max_tilt_deg=42"
    )
    assert [row for row in rows if row[0] > 6.8][:1] == [(16.2, "LAND", "land")]
    assert outcome.unread == ()


def test_a_pilot_s_own_flights_are_nobody_s_mission():
    path = recording("copter_low_battery.tlog")
    rows, outcome = replayed(path, "copter_low_battery", "sensors.battery.cells=3")
    assert [row for row in rows if row[0] > 461.3] == [
        (462.0, "LOAD_MISSION", "recording_proven"),
        (462.0, "TAKEOFF", "takeoff"),
        (462.3, "PILOT", "pilot_took_over"),
        (737.3, "DATA_CLEANUP", "acknowledged"),
        (738.5, "MISSION_ENDED", "data_complete"),
    ]
    assert outcome.state.session.result.value == "PILOT"


def test_a_log_is_replayed_the_same_every_time():
    path = recording("px4_offboard.tlog")
    first, second = (replayed(path, "px4_telemetry")[1] for _ in range(2))
    assert (first.journal, first.timeline) == (second.journal, second.timeline)


def test_what_is_no_log_is_refused_in_one_line(tmp_path):
    path = tmp_path / "none.tlog"
    path.write_bytes(b"nothing of the kind" * 100)
    with pytest.raises(BagError) as caught:
        recordings_of(path)
    assert str(caught.value) == f"{path}: has no MAVLink frame with a time; must be a telemetry log"
    with pytest.raises(BagError, match="No such file"):
        recordings_of(tmp_path / "absent.tlog")


def test_a_log_that_is_cut_off_or_damaged_is_read_as_far_as_it_goes(tmp_path):
    whole = recording("px4_offboard.tlog").read_bytes()
    path = tmp_path / "cut.tlog"
    path.write_bytes(whole[:200_000] + b"\xff" * 100 + whole[200_003:300_001])
    cut = Telemetry.of_log(path)
    assert cut.count.good > 4000
    assert 100 <= cut.count.stray_bytes < 1000
    assert cut.problem.startswith("cut.tlog: ")
    assert cut.problem.endswith(" bytes between its records are none, what was there is missing")


@pytest.mark.slow_rows
@pytest.mark.parametrize("more,bytes_lost", [(5, 5), (12, 12), (0, 0)])
def test_what_is_lost_of_a_log_that_was_cut_within_a_record_is_said(tmp_path, capsys, more, bytes_lost):
    whole, path = recording("px4_normal_mission.tlog").read_bytes(), tmp_path / "cut.tlog"
    end = 0
    while end < len(whole) // 3:
        end += 8 + frame_at(whole, end + 8).length
    path.write_bytes(whole[: end + more])
    status = main(["run", str(path), "--map", "px4_telemetry"])
    lost = f"its last {bytes_lost} bytes, from byte {end} on, are no whole record: it was cut there"
    damaged = [line for line in capsys.readouterr().out.splitlines() if line.startswith("DAMAGED")]
    assert (status, damaged) == ((3, [f"DAMAGED: cut.tlog: {lost}"]) if more else (0, []))
    if more:
        assert main(["run", str(path), "--map", "px4_telemetry", "--to", "20"]) == 0  # it does not come to the cut


def test_a_log_that_was_cut_within_the_part_is_said_however_long_another_recording_goes_on(tmp_path):
    path = beats(tmp_path / "cut.tlog", *range(10))
    size = len(path.read_bytes())
    path.write_bytes(path.read_bytes()[:-3])
    record = size // 10
    lost = f"cut.tlog: its last {record - 3} bytes, from byte {size - record} on, are no whole record: it was cut there"
    other = write_bag(tmp_path / "other.bag", [(START_NS + n * S, "/a", distance(START_NS, n)) for n in range(30)])
    parts = ((0, None), (0, 20 * S), (0, 9 * S), (15 * S, 20 * S), (0, 7 * S))
    with Recordings([path, other], ("/autopilot/status", "/a")) as recordings:
        said = [FaultedRecordings(recordings, *part).problems for part in parts]
    assert said == [(lost,), (lost,), (lost,), (lost,), ()]  # its last whole record is at 8 s


def slowed(log, path, period_s):
    """Write a log of which each message comes once in a period, texts excepted."""
    data, at, last, kept = log.read_bytes(), 0, {}, b""
    while at < len(data):
        found = frame_at(data, at + 8)
        begin, at = at, at + 8 + found.length
        if found.frame is None:
            continue
        t_s, said = int.from_bytes(data[begin : begin + 8], "big") / 1e6, found.frame
        key = said.system, said.component, said.number
        if said.number == mavlink.MAVLINK_MSG_ID_STATUSTEXT or t_s - last.get(key, 0.0) >= period_s:
            last[key] = t_s
            kept += data[begin:at]
    path.write_bytes(kept)
    return path


def test_words_of_slow_telemetry_that_come_one_after_the_other_are_no_contradiction(tmp_path, capsys):
    path = slowed(recording("px4_normal_mission.tlog"), tmp_path / "slow.tlog", 2.5)
    (tmp_path / "map.yaml").write_text(propose([path]).text)
    assert main(["run", str(path), "--map", str(tmp_path / "map.yaml")]) == 0
    out = capsys.readouterr().out
    assert "contradiction: the recorded vehicle flies, and nothing here has commanded a takeoff" in out
    assert "the recorded vehicle is in the air and disarmed" not in out


def changes(log, name):
    """Return what a field of a log's status says, one after the other."""
    said = [getattr(log.message(entry), name) for entry in log.entries("/autopilot/status")]
    return [one for one, before in zip(said, [None, *said]) if one != before]


@pytest.mark.slow_rows
@pytest.mark.parametrize("period_s", [1.0, 2.5, 5.0])
def test_slow_telemetry_is_no_silence(tmp_path, period_s):
    """What is told counts until it is due again."""
    whole = recording("px4_normal_mission.tlog")
    slow = Telemetry.of_log(slowed(whole, tmp_path / "slow.tlog", period_s))
    for name in ("landed", "armed", "mode"):
        assert changes(slow, name) == changes(Telemetry.of_log(whole), name), name
    assert changes(slow, "gps")[-1] == 1
    assert changes(slow, "gps").count(2) <= 1  # a fix counts when it has lasted


@pytest.mark.parametrize("period_s", [0.4, 2.5])
def test_the_map_that_is_proposed_of_slow_telemetry_does_not_flap(tmp_path, period_s):
    slow = slowed(recording("px4_normal_mission.tlog"), tmp_path / "slow.tlog", period_s)
    (tmp_path / "slow.yaml").write_text(propose([slow]).text)
    _, outcome = replayed(slow, str(tmp_path / "slow.yaml"))
    said = [line.text for line in outcome.timeline if line.kind is LineKind.MONITOR]
    advice = " ".join(row.advice for _, rows in outcome.checks.values() for row in rows)
    assert "not observed for" not in advice
    assert sum("state check: IMU age" in text for text in said) == 1
    assert sum("state check: gravity magnitude" in text for text in said) <= 1
    assert any(text.startswith("watchdog: gps code") for text in said)
    assert not any("code 1 -> " in text for text in said)


def test_slow_telemetry_that_ends_is_silence(tmp_path):
    path = slowed(recording("px4_normal_mission.tlog"), tmp_path / "slow.tlog", 2.5)
    data, at = path.read_bytes(), 0
    begin_us = int.from_bytes(data[:8], "big")
    kept = b""
    while at < len(data):  # 30 s of all, then texts alone
        length = 8 + frame_at(data, at + 8).length
        late = int.from_bytes(data[at : at + 8], "big") > begin_us + 30_000_000
        number = frame_at(data, at + 8).frame.number
        kept += b"" if late and number != mavlink.MAVLINK_MSG_ID_STATUSTEXT else data[at : at + length]
        at += length
    path.write_bytes(kept)
    assert (changes(Telemetry.of_log(path), "landed")[-1], changes(Telemetry.of_log(path), "mode")[-1]) == (0, "")


def beats(path, *times_s):
    """Write a log of heartbeats."""
    sender = mavlink.MAVLink(None, 1, 1)
    said = mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3)
    path.write_bytes(b"".join(struct.pack(">Q", START_NS // 1000 + 10**6 * t) + said.pack(sender) for t in times_s))
    return path


def test_a_log_in_which_a_clock_was_set_is_refused_at_once_and_can_be_exported(tmp_path):
    """Not five times a second is anything told of the month between."""
    month_s = 30 * 24 * 3600
    path = beats(tmp_path / "x.tlog", *range(10), *range(month_s, month_s + 10))
    log = Telemetry.of_log(path)
    times = [(entry.t_ns - START_NS) / S for entry in log.entries("/autopilot/status")]
    assert len(times) < 120
    assert [t_s for t_s in times if 9 < t_s < month_s] == []
    with pytest.raises(TimeJumpError, match=r"x\.tlog: no message for 720\.0 h between .*: a clock was set"):
        Recordings([path], ["/autopilot/status"])
    assert export([path], tmp_path / "x.mcap").messages == 20 + len(times)


def test_an_hour_without_a_message_is_a_vehicle_that_is_silent(tmp_path):
    path = beats(tmp_path / "x.tlog", *range(10), 3600)
    with Recordings([path], ["/autopilot/status"]) as recordings:
        assert recordings.count > 5 * 3590


def test_components_of_the_vehicle_are_heard_for_what_the_autopilot_does_not_send(tmp_path):
    """A range finder is component 194; its heartbeat is not the vehicle's, and another system's range neither."""
    senders = {number: mavlink.MAVLink(None, *number) for number in ((1, 1), (1, 194), (7, 194))}
    frames = []
    for step in range(50):
        t_us = START_NS // 1000 + step * 100_000
        for number, sender in senders.items():
            kind = mavlink.MAV_TYPE_QUADROTOR if number == (1, 1) else mavlink.MAV_TYPE_ONBOARD_CONTROLLER
            said = [mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3)]
            if number != (1, 1):
                said.append(mavlink.MAVLink_distance_sensor_message(step, 10, 4000, number[0], 0, 0, 25, 0))
            frames += [(t_us, message.pack(sender)) for message in said]
    path = tmp_path / "range.tlog"
    path.write_bytes(b"".join(struct.pack(">Q", t_us) + frame for t_us, frame in frames))
    log = Telemetry.of_log(path)
    counts = {topic.name: topic.messages for topic in log.topics}
    assert (counts["/mavlink/HEARTBEAT"], counts["/mavlink/DISTANCE_SENSOR"]) == (50, 50)
    assert {log.message(entry).current_distance for entry in log.entries("/mavlink/DISTANCE_SENSOR")} == {1}


@pytest.mark.parametrize(
    "ways, topics",
    [
        ((25, 0), {"/mavlink/DISTANCE_SENSOR": {25}, "/mavlink/DISTANCE_SENSOR_0": {0}}),
        ((0,), {"/mavlink/DISTANCE_SENSOR": {0}}),
        ((25, 25), {"/mavlink/DISTANCE_SENSOR": {25}}),
    ],
)
def test_the_range_is_that_of_the_range_finder_that_looks_down(tmp_path, ways, topics):
    sender, frames = mavlink.MAVLink(None, 1, 1), []
    for step in range(10):
        said = [mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3)]
        said += [mavlink.MAVLink_distance_sensor_message(step, 10, 4000, 100 + way, 0, 0, way, 0) for way in ways]
        frames += [(START_NS // 1000 + step * 100_000, message.pack(sender)) for message in said]
    path = tmp_path / "range.tlog"
    path.write_bytes(b"".join(struct.pack(">Q", t_us) + frame for t_us, frame in frames))
    log = Telemetry.of_log(path)
    names = [topic.name for topic in log.topics if "DISTANCE_SENSOR" in topic.name]
    assert {name: {log.message(entry).orientation for entry in log.entries(name)} for name in names} == topics


def test_mavlink_in_a_bag_says_the_same_as_the_log(tmp_path):
    log = recording("px4_offboard.tlog")
    bag = tmp_path / "mavlink.bag"
    _write_bag(bag, log)
    inside = recordings_of(bag)
    assert [type(each).__name__ for each in inside] == ["Recording", "Telemetry"]
    ours, theirs = Telemetry.of_log(log), inside[1]
    shift = theirs.start_ns - ours.start_ns
    for topic in ("/autopilot/status", "/mavlink/GPS_RAW_INT", "/mavlink/imu"):
        for one, other in list(zip(ours.entries(topic), theirs.entries(topic)))[::20]:
            assert other.t_ns - one.t_ns == shift
            a, b = ours.message(one), theirs.message(other)
            assert _without_header(a) == _without_header(b)


def test_mavlink_in_a_bag_of_a_simulated_clock_is_decided_as_that_of_any_day(tmp_path, capsys):
    told = []
    for name, begin_ns in (("any_day", START_NS), ("simulated", 12 * S)):
        bag = tmp_path / name / "mavros.bag"
        bag.parent.mkdir()
        _write_bag(bag, recording("px4_normal_mission.tlog"), begin_ns=begin_ns)
        status = main(["run", str(bag), "--map", "px4_telemetry"])
        told.append((status, capsys.readouterr().out))
    any_day, simulated = told
    assert simulated == any_day
    assert any_day[0] == 0


def test_a_message_of_mavros_that_cannot_be_read_costs_itself(tmp_path):
    bag = tmp_path / "mavros.bag"
    _write_bag(bag, recording("px4_offboard.tlog"), limit=600)
    whole = recordings_of(bag)[1]
    content = bytearray(bag.read_bytes())
    frame = whole._frames[300][1]
    words = _words(frame.payload).tobytes()
    place = content.find(struct.pack("<I", len(words) // 8) + words)
    content[place : place + 4] = b"\xff\xff\xff\x7f"
    bag.write_bytes(content)
    broken = recordings_of(bag)[1]
    assert len(broken._frames) == len(whole._frames) - 1
    assert whole.problem == ""
    assert broken.problem.startswith("/mavlink/from: 1 messages from +")
    assert " cannot be read (mavros_msgs/Mavlink cannot be decoded: " in broken.problem
    assert Recordings([bag], broken.topics[0].name.split()).problems == (broken.problem,)


def _without_header(message):
    return repr({**vars(message), "header": None, "_header": None, "_msgbuf": None, "_payload": None})


def _write_bag(path, log, limit=6000, begin_ns=START_NS):
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(MAVLINK, "mavros_msgs/msg/Mavlink"))
    kinds = store.types
    frames, _ = read_tlog(log)
    with Writer(path) as writer:
        connection = writer.add_connection("/mavlink/from", "mavros_msgs/msg/Mavlink", typestore=store)
        first_ns = None
        for number, (t_ns, frame) in zip(range(limit), frames):
            first_ns = t_ns if first_ns is None else first_ns
            stamp = kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
            header = kinds["std_msgs/msg/Header"](seq=number, stamp=stamp, frame_id="")
            message = kinds["mavros_msgs/msg/Mavlink"](
                header, 1, 0xFD, len(frame.payload), 0, 0, frame.sequence, frame.system, frame.component,
                frame.number, 0, _words(frame.payload), _bytes(b""),
            )  # fmt: skip
            writer.write(
                connection,
                begin_ns + t_ns - first_ns,
                store.serialize_ros1(message, "mavros_msgs/msg/Mavlink"),
            )


def _words(payload):
    padded = payload + bytes(-len(payload) % 8)
    return np.array(struct.unpack(f"<{len(padded) // 8}Q", padded), dtype=np.uint64)


def _bytes(data):
    return np.frombuffer(data, dtype=np.uint8)
