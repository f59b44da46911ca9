"""MCAP, ROS 2 bags and ULogs are told of, mapped and replayed as bags are; what is wrong with them is said."""

from __future__ import annotations

import json
import math
import random
import re
import shutil
import sqlite3
import struct
from pathlib import Path

import numpy as np
import other_recordings
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from other_recordings import gps_rows, px4_rows, ulog_rows, write_mcap, write_ros2, write_ulog
from pyulog.core import ULog
from replay_bags import START_NS, S, flight_rows, write_bag
from replay_runs import CONFIG, moves, texts
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Reader

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.bags import BagError
from amaze_autonomy.bags.cli import main as amaze_bag
from amaze_autonomy.bags.errors import MessageError
from amaze_autonomy.bags.other_formats import other_recording
from amaze_autonomy.config.loader import load_configuration
from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.replay.maps.proposal import propose
from amaze_autonomy.replay.maps.topic_map import load_map
from amaze_autonomy.replay.plan import make_plan
from amaze_autonomy.replay.recordings.export import export
from amaze_autonomy.replay.recordings.sources import Recordings, recordings_of, topics_of
from amaze_autonomy.replay.session import Session
from amaze_autonomy.replay.timeline import LineKind
from amaze_autonomy.tester.command import main as amaze_replay

FLIGHT_MAP = str(Path(__file__).parents[1] / "flight.yaml")
TEXTS = [(7.6, 6, "Armed by external command"), (26.0, 4, "Landing")]


def replayed(path, topic_map, overrides=()):
    found = load_map(str(topic_map))
    plan = make_plan(load_configuration(CONFIG, overrides), found, "1", topics_of([path]))
    with Recordings([path], plan.topics) as recordings:
        return Session(plan, recordings).run()


def told(path, capsys):
    """Return what `amaze-bag info --json` says: the whole, and by topic type and number of messages."""
    assert amaze_bag(["info", "--json", str(path)]) == 0
    (result,) = json.loads(capsys.readouterr().out)
    return result, {row["topic"]: (row["type"], row["messages"]) for row in result["topics"]}


@pytest.fixture(scope="module")
def packings(tmp_path_factory):
    """The same messages as a ROS 1 bag and in every other format that is read."""
    folder, rows = tmp_path_factory.mktemp("packings"), flight_rows()
    files = {
        "bag": write_bag(folder / "flight.bag", rows),
        "ros2": write_ros2(folder / "ros2", rows),
        "zstd": write_mcap(folder / "zstd.mcap", rows),
        "lz4": write_mcap(folder / "lz4.mcap", rows, "lz4"),
        "plain": write_mcap(folder / "plain.mcap", rows, "none"),
        "ros1": write_mcap(folder / "ros1.mcap", rows, ros1=True),
    }
    return {**files, "db3": next(files["ros2"].glob("*.db3"))}


@pytest.mark.slow_rows
@pytest.mark.parametrize("name", ["ros2", "db3", "zstd", "lz4", "plain", "ros1"])
def test_the_journal_is_that_of_the_bag_with_the_same_messages(packings, name):
    assert replayed(packings[name], FLIGHT_MAP).journal == replayed(packings["bag"], FLIGHT_MAP).journal


def test_definitions_with_the_line_ends_of_windows_are_read_in_a_bag_and_in_mcap(packings, tmp_path):
    bag, mcap = tmp_path / "windows.bag", tmp_path / "windows.mcap"
    with Ros1Reader(packings["bag"]) as reader, Ros1Writer(bag) as writer:
        links = {}
        for each in reader.connections:
            definition = getattr(each.msgdef, "data", each.msgdef).replace("\n", "\r\n")
            links[each.id] = writer.add_connection(each.topic, each.msgtype, msgdef=definition, md5sum=each.digest)
        for each, t_ns, raw in reader.messages():
            writer.write(links[each.id], t_ns, raw)
    export([bag], mcap)
    assert b"\r\n" in mcap.read_bytes()
    expected = replayed(packings["bag"], FLIGHT_MAP).journal
    for path in (bag, mcap):
        assert amaze_replay(["run", str(path), "--map", FLIGHT_MAP]) == 0
        assert replayed(path, FLIGHT_MAP).journal == expected


def test_info_says_of_a_ros2_bag_what_the_rosbags_library_says(packings, capsys):
    result, topics = told(packings["ros2"], capsys)
    with Reader(packings["ros2"]) as reader:
        kinds = {each.topic: each.msgtype.replace("/msg/", "/") for each in reader.connections}
        assert topics == {each.topic: (kinds[each.topic], each.msgcount) for each in reader.connections}
        assert (result["messages"], result["start_ns"]) == (reader.message_count, reader.start_time)
        assert result["end_ns"] == reader.end_time - 1
    assert result["version"] == "ROS 2 (SQLite), folder"


def test_info_says_of_an_mcap_file_what_its_own_library_says(packings, capsys):
    result, topics = told(packings["zstd"], capsys)
    with packings["zstd"].open("rb") as file:
        summary = make_reader(file).get_summary()
    counts = summary.statistics.channel_message_counts
    assert {topic: count for topic, (_, count) in topics.items()} == {
        each.topic: counts[number] for number, each in summary.channels.items()
    }
    assert result["start_ns"] == summary.statistics.message_start_time
    assert result["end_ns"] == summary.statistics.message_end_time
    assert result["chunks"] == {"zstd": summary.statistics.chunk_count}
    assert result["version"] == "MCAP of ros2"


@pytest.fixture(scope="module")
def ulog(tmp_path_factory):
    return write_ulog(tmp_path_factory.mktemp("ulog") / "flight.ulg", ulog_rows(), TEXTS)


def test_info_says_of_a_ulog_what_pyulog_says_with_the_time_of_day_of_its_gps(ulog, capsys):
    result, topics = told(ulog, capsys)
    log = ULog(str(ulog))
    expected = {f"/{each.name}": len(each.data["timestamp"]) for each in log.data_list}
    assert {topic: count for topic, (_, count) in topics.items()} == {**expected, "/logged_messages": 2}
    assert topics["/vehicle_status"] == ("px4_msgs/VehicleStatus", 72)
    assert result["start_ns"] == START_NS
    assert result["end_ns"] == START_NS + (log.last_timestamp - 20_000_000) * 1000


def test_the_fields_of_a_ulog_are_those_that_pyulog_reads(ulog):
    data = ULog(str(ulog)).get_dataset("sensor_combined").data
    with other_recording(ulog) as recording:
        entries = recording.entries("/sensor_combined")
        message = recording.message(entries[7])
        assert message.accelerometer_m_s2 == [data[f"accelerometer_m_s2[{axis}]"][7] for axis in range(3)]
        assert message.timestamp == data["timestamp"][7]
        text = recording.message(recording.entries("/logged_messages")[1])
        assert (text.severity, text.text) == (4, "Landing")


def test_a_ulog_is_judged_by_the_map_that_is_proposed_of_it(ulog, tmp_path):
    proposal = propose([ulog])
    (tmp_path / "ulog.yaml").write_text(proposal.text)
    assert "armed: disarmed +0.0 s, armed +8.0 s, disarmed +31.5 s" in proposal.found
    assert "flight mode: AUTO.LOITER +0.0 s, AUTO.MISSION +8.0 s, AUTO.LAND +26.0 s" in proposal.found
    outcome = replayed(ulog, tmp_path / "ulog.yaml")
    assert [(before, after) for before, after, _ in moves(outcome)] == [
        ("MISSION_INPUT", "PREFLIGHT"),
        ("PREFLIGHT", "READY"),
        ("READY", "START_RECORDING"),
        ("START_RECORDING", "LOAD_MISSION"),
        ("LOAD_MISSION", "TAKEOFF"),
        ("TAKEOFF", "MISSION"),
        ("MISSION", "PILOT"),  # nobody here has commanded the landing of 26 s
    ]
    said = [line for line in texts(outcome, LineKind.NOTE) if "says" in line]
    assert said == [
        "+7.600 bag the autopilot says: Armed by external command",
        "+26.000 bag the autopilot says: Landing",
    ]
    took_over = [line for line in texts(outcome, LineKind.DECISION) if "MISSION -> PILOT" in line]
    assert took_over[0].startswith("+26.300 bag MISSION -> PILOT by pilot_took_over (reason flight mode AUTO.LAND")


def test_px4_s_topics_in_a_ros2_bag_are_judged_as_those_of_its_ulog(ulog, tmp_path):
    folder = write_ros2(tmp_path / "ros2", px4_rows(ulog_rows()))
    (tmp_path / "ros2.yaml").write_text(propose([folder]).text)
    (tmp_path / "ulog.yaml").write_text(propose([ulog]).text)
    by_ros2, by_ulog = replayed(folder, tmp_path / "ros2.yaml"), replayed(ulog, tmp_path / "ulog.yaml")
    assert [(each.t_ns, each.rule) for each in by_ros2.decisions] == [
        (each.t_ns, each.rule) for each in by_ulog.decisions
    ]
    assert len(by_ros2.decisions) > 8


def test_a_gps_that_loses_its_fix_in_a_ulog_is_seen(tmp_path):
    path = write_ulog(tmp_path / "no_fix.ulg", ulog_rows(no_fix_s=(15.0, 20.0)))
    (tmp_path / "map.yaml").write_text(propose([path]).text)
    lines = texts(replayed(path, tmp_path / "map.yaml"), LineKind.MONITOR)
    gps = [line.split("  ")[0] for line in lines if "watchdog: gps" in line]
    assert [line.split(" bag ")[1][:31] for line in gps] == [
        "watchdog: gps code 1",
        "watchdog: gps code 1 -> 2 the a",
        "watchdog: gps code 2 -> 1",
    ]
    assert 15.0 <= float(gps[1].split()[0]) <= 17.0
    assert 20.0 <= float(gps[2].split()[0]) <= 22.0


def test_a_mission_of_px4_takes_off_and_lands_by_its_set_point_as_its_extended_sys_state_says(tmp_path):
    mission = [(t_s, topic, (values[0], 3, values[2]) if topic == "vehicle_status" and t_s >= 7.6 else values)
               for t_s, topic, values in ulog_rows()]  # fmt: skip
    of_type = lambda t_s: 3 if t_s < 10.0 else 0 if t_s < 26.0 else 4  # noqa: E731 - TAKEOFF, POSITION, LAND
    triplets = [(t_s, "position_setpoint_triplet", (0, True, of_type(t_s))) for t_s in np.arange(7.6, 32.0, 0.2)]
    path = write_ulog(tmp_path / "mission.ulg", sorted([*mission, *triplets], key=lambda row: row[0]))
    with recordings_of(path)[1] as made:
        said = [(entry.t_ns, made.message(entry)) for entry in made.entries("/autopilot/status")]
    landed = [((t_ns - START_NS) / S, VehicleLanded(each.landed).name) for t_ns, each in said if each.armed]
    changes = [now for now, before in zip(landed, [(0, ""), *landed]) if now[1] != before[1]]
    assert [(pytest.approx(t_s, abs=0.6), word) for t_s, word in changes] == [
        (8.0, "ON_GROUND"), (9.0, "TAKING_OFF"), (10.0, "IN_AIR"), (26.0, "LANDING"), (30.0, "ON_GROUND"),
    ]  # fmt: skip


def test_what_is_made_of_px4s_topics_is_in_the_axes_of_ros(ulog):
    recording, made = recordings_of(ulog)
    with recording:
        imu = made.message(made.entries("/px4/imu")[0])
        assert imu.linear_acceleration.z == pytest.approx(9.81)
        aloft = next(entry for entry in made.entries("/px4/odometry") if entry.t_ns >= START_NS + 15 * S)
        odometry = made.message(aloft)
        assert odometry.pose.pose.position.z == pytest.approx(3.0)
        turn = odometry.pose.pose.orientation  # level, to the north: 90 degrees from the east
        assert (abs(turn.w), abs(turn.z)) == (pytest.approx(0.5**0.5), pytest.approx(0.5**0.5))
        assert (turn.x, turn.y) == (pytest.approx(0.0), pytest.approx(0.0))


def test_formats_are_recognised_by_content(packings, ulog, tmp_path, capsys):
    for number, (source, version) in enumerate(((packings["lz4"], "MCAP of ros2"), (ulog, "ULog"))):
        shutil.copy(source, tmp_path / f"{number}.bag")
        assert told(tmp_path / f"{number}.bag", capsys)[0]["version"] == version


def test_a_telemetry_log_is_recognised_without_its_name(tmp_path):
    stamp = (START_NS // 1000).to_bytes(8, "big")
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3).pack(
        mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    )
    (tmp_path / "log.bin").write_bytes((stamp + bytes(beat)) * 2)
    assert type(recordings_of(tmp_path / "log.bin")[0]).__name__ == "Telemetry"


# --- what is wrong ----------------------------------------------------------------------------------------------------


def wrong_with(path):
    with pytest.raises(BagError) as caught:
        other_recording(path)
    return str(caught.value).replace(str(path), "X")


def contents(path):
    """Return all messages of a recording, as in the file, with the topics."""
    with other_recording(path) as recording:
        entries = [entry for topic in recording.topics for entry in recording.entries(topic.name)]
        entries.sort(key=lambda entry: (entry.chunk, entry.offset))
        said = [(entry.t_ns, recording.channels[entry.connection].topic, recording.raw(entry)) for entry in entries]
        return said, recording.problem


PACKINGS = {"zstd": {}, "lz4": {"compression": "lz4"}, "none": {"compression": "none"}, "no_chunks": {"chunks": False}}


@pytest.mark.slow_rows(1)
@pytest.mark.long
@pytest.mark.parametrize("packing", PACKINGS)
def test_an_mcap_file_that_was_cut_is_read_to_its_last_whole_message_and_that_is_said(tmp_path, packing, capsys):
    whole = write_mcap(tmp_path / "whole.mcap", flight_rows(12.0), **PACKINGS[packing])
    messages, problem = contents(whole)
    assert (len(messages), problem) == (12 * 102, "")
    data, cut, places = whole.read_bytes(), tmp_path / "cut.mcap", random.Random(11)
    starts = [each.chunk_start_offset for each in make_reader(whole.open("rb")).get_summary().chunk_indexes]
    for size in sorted(places.randrange(60, len(data) - 1) for _ in range(20)):
        cut.write_bytes(data[:size])
        read, problem = contents(cut)
        assert read == messages[: len(read)]
        if packing == "none":  # every byte of it counts
            assert len(messages) - len(read) <= 1 + (len(data) - size) / 60
        chunks = sum(start < size for start in starts) - 1
        assert len(read) >= min(len(messages), 150 * chunks), size
        assert problem.startswith("cut.mcap: was not closed"), size
        assert f": {len(read)} messages are read, what came after them is missing; `amaze-replay export" in problem
        for command, statuses in (
            (["run", "--map", FLIGHT_MAP], (2, 3)),
            (["map"], (2, 3)),
            (["export", "-o", str(tmp_path / "new.mcap")], (2, 3)),
        ):
            status = amaze_replay([*command[:1], str(cut), *command[1:]])
            out, err = capsys.readouterr()
            assert status in statuses
            assert "Traceback" not in err
            assert ("was not closed" in out) if status == 3 else err.count("\n") == 1
        if status == 3:
            again, problem = contents(tmp_path / "new.mcap")
            assert (sorted(again), problem) == (sorted(read), "")
        assert amaze_bag(["info", str(cut)]) == 0
        assert "was not closed" in capsys.readouterr().out


def test_verbs_that_need_a_bag_say_what_writes_a_whole_mcap_file(tmp_path, capsys):
    path = write_mcap(tmp_path / "open.mcap", flight_rows(2.0), finish=False)
    for verb in (["recover"], ["filter", "-o", "x.bag"], ["cut", "-o", "x.bag"], ["doctor"], ["verify"]):
        assert amaze_bag([verb[0], str(path), *verb[1:]]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.endswith(
            "is no bag but an MCAP file; amaze-bag info and amaze-replay read it, amaze-replay export writes a whole "
            "one; name a ROS 1 bag of version 2.0"
        )


def test_a_damaged_chunk_of_a_file_that_was_not_closed_is_named(tmp_path):
    path = write_mcap(tmp_path / "open.mcap", flight_rows(12.0), "none", finish=False)
    data = bytearray(path.read_bytes())
    data[60_000] ^= 0x10
    path.write_bytes(data)
    assert "; chunk at byte 53964 cannot be read" in contents(path)[1]
    assert "it is not what its checksum says" in contents(path)[1]


def test_a_folder_says_what_it_lacks(packings, tmp_path):
    folder = shutil.copytree(packings["ros2"], tmp_path / "ros2")
    file = next(folder.glob("*.db3"))
    file.unlink()
    assert wrong_with(folder) == f"X: lacks its {file.name}; name the files that are there, one by one"
    (folder / "metadata.yaml").unlink()
    assert wrong_with(folder) == "X: is a folder without a recording; name a bag, or the folder of a ROS 2 bag"


def test_a_folder_whose_recorder_was_killed_has_no_metadata_and_is_read(packings, tmp_path, capsys):
    folder = shutil.copytree(packings["ros2"], tmp_path / "killed")
    (folder / "metadata.yaml").unlink()
    assert told(folder, capsys)[1] == told(packings["ros2"], capsys)[1]


def error_of(recording, entry):
    try:
        recording.message(entry)
    except MessageError as error:
        return str(error)
    return ""


def test_a_flipped_bit_costs_the_messages_of_its_chunk(packings, tmp_path):
    data = bytearray(packings["plain"].read_bytes())
    data[len(data) // 3] ^= 0x10
    (tmp_path / "flipped.mcap").write_bytes(data)
    with other_recording(tmp_path / "flipped.mcap") as recording:
        entries = [entry for topic in recording.topics for entry in recording.entries(topic.name)]
        errors = [each for each in (error_of(recording, entry) for entry in entries) if each]
    assert len(set(errors)) == 1
    assert errors[0].endswith("is damaged: it is not what its checksum says")
    assert len(errors) < 400  # of 3,672 in 16 chunks


def test_a_chunk_that_would_take_gigabytes_is_not_unpacked(packings):
    with other_recording(packings["zstd"], memory=40_000) as recording:
        error = error_of(recording, recording.entries("/imu")[0])
    assert error == "chunk at byte 35 is damaged: it takes 1 MB of memory, 0 may be taken (--memory 1 permits it)"


def test_a_message_that_would_take_gigabytes_is_not_unpacked(packings, tmp_path):
    folder = shutil.copytree(packings["ros2"], tmp_path / "ros2")
    about = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(re.sub("compression_mode: .*", "compression_mode: message", about))
    with sqlite3.connect(next(folder.glob("*.db3"))) as base:
        base.execute("UPDATE messages SET data = ?", (zstandard.compress(bytes(9_000_000)),))
    with other_recording(folder, memory=1_000_000) as recording:
        error = error_of(recording, recording.entries("/imu")[0])
    assert error == "a message is damaged: it has more than 1000000 bytes"


def test_messages_of_an_encoding_that_is_not_read_say_so(tmp_path):
    path = tmp_path / "json.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/state", "json", writer.register_schema("State", "jsonschema", b"{}"))
        writer.add_message(channel, 5, b"{}", 5)
        writer.finish()
    with other_recording(path) as recording, pytest.raises(MessageError, match="messages in json are not read"):
        recording.message(recording.entries("/state")[0])


def test_px4s_messages_that_cannot_be_read_are_told_and_the_rest_is_judged(tmp_path):
    path = write_mcap(tmp_path / "px4.mcap", px4_rows(ulog_rows()), "none")
    recording, made = recordings_of(path)
    with recording:
        whole = [len(made.entries(topic)) for topic in ("/autopilot/status", "/px4/range")]
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)
    recording, made = recordings_of(path)
    recording.close()
    assert len(made.entries("/autopilot/status")) > 0.9 * whole[0]
    assert 0.8 * whole[1] < len(made.entries("/px4/range")) < whole[1]
    told = dict(each.split(": ", 1) for each in made.problem.split("; "))
    assert {"/fmu/out/vehicle_status", "/fmu/out/vehicle_local_position", "/fmu/out/distance_sensor"} <= told.keys()
    assert re.fullmatch(
        r"\d+ messages from \+\d+\.\d+ s to \+\d+\.\d+ s cannot be read "
        r"\(chunk at byte \d+ is damaged: it is not what its checksum says\)",
        told["/fmu/out/vehicle_status"],
    )
    (tmp_path / "map.yaml").write_text(propose([path]).text)
    assert len(replayed(path, tmp_path / "map.yaml").decisions) > 3


def test_a_message_of_px4_with_values_that_cannot_be_is_told_and_the_rest_is_judged(tmp_path):
    rows = [(t_s, topic, (math.inf, *values[1:]) if topic == "sensor_gps" and 3.1 < t_s < 3.3 else values)
            for t_s, topic, values in ulog_rows(12.0) + gps_rows(12.0)]  # fmt: skip
    path = write_ulog(tmp_path / "odd.ulg", sorted(rows, key=lambda row: row[:2]))
    made = recordings_of(path)[1]
    assert made.problem.startswith("/sensor_gps: 1 messages from +3.200 s to +3.200 s cannot be read (")
    assert len(made.entries("/autopilot/status")) > 50


def test_a_type_of_px4_that_is_another_one_is_told_and_the_rest_is_judged(tmp_path, monkeypatch):
    monkeypatch.setitem(other_recordings._FORMATS, "battery_status", "uint64_t timestamp;float voltage_filtered_v")
    rows = [(t_s, topic, values[:1] if topic == "battery_status" else values) for t_s, topic, values in ulog_rows(12.0)]
    path = write_ulog(tmp_path / "another.ulg", rows)
    made = recordings_of(path)[1]
    assert made.problem.startswith("/battery_status: 12 messages from +0.000 s to +11.000 s cannot be read (")
    assert "voltage_v" in made.problem
    assert len(made.entries("/autopilot/status")) > 50


def test_an_sqlite_file_of_something_else_is_refused(tmp_path):
    path = tmp_path / "songs.db3"
    with sqlite3.connect(path) as base:
        base.execute("CREATE TABLE songs (name TEXT)")
    assert wrong_with(path).startswith("X: is no readable SQLite file of a ROS 2 bag (no such table: topics)")


def test_a_ulog_that_ends_in_its_header_is_damaged(ulog, tmp_path):
    (tmp_path / "cut.ulg").write_bytes(ulog.read_bytes()[:40])
    assert wrong_with(tmp_path / "cut.ulg") == "X: is a damaged ULog: nothing in it can be read; name another"


def records_of(data):
    """Return where the records of a ULog begin, and their kinds."""
    at, found = 16, []
    while at < len(data):
        found.append((at, chr(data[at + 2])))
        at += 3 + int.from_bytes(data[at : at + 2], "little")
    return found


def test_a_message_of_a_ulog_that_cannot_be_read_is_told_with_its_place_and_topic(ulog, tmp_path):
    data, path = bytearray(ulog.read_bytes()), tmp_path / "damaged.ulg"
    places = [at for at, kind in records_of(data) if kind == "D"]
    whole = {topic.name: topic.messages for topic in recordings_of(ulog)[0].topics}
    stray, unknown = places[1000], places[2000]
    data[stray + 3 : stray + 5] = b"\xff\x7f"  # of a topic that nobody named
    longer = data[unknown : unknown + 3 + int.from_bytes(data[unknown : unknown + 2], "little")] + b"!!!"
    longer[0] += 3
    data[unknown:unknown] = longer  # more bytes than its topic has
    path.write_bytes(data)
    recording, _ = recordings_of(path)
    lost = {topic.name: whole[topic.name] - topic.messages for topic in recording.topics}
    assert sum(lost.values()) == 1
    assert recording.problem.startswith("damaged.ulg: is damaged in places, what could not be read there is missing: ")
    assert f"1 messages of topic 32767, which is none, at byte {stray}" in recording.problem
    assert re.search(rf"1 messages of /\w+ of a wrong size, at byte {unknown}\b", recording.problem)


@pytest.mark.parametrize("kind", [0x00, 0x07, 0xC4])
def test_a_record_of_a_ulog_that_is_none_is_told_with_its_place(ulog, tmp_path, kind):
    data, path = bytearray(ulog.read_bytes()), tmp_path / "damaged.ulg"
    place = next(at for at, kind in records_of(data)[1000:] if kind == "D")
    data[place + 2] = kind
    path.write_bytes(data)
    recording, _ = recordings_of(path)
    assert recording.problem.endswith(f"what could not be read there is missing: no record at byte {place}")


def test_a_topic_of_a_ulog_whose_messages_have_no_time_is_told_and_the_rest_is_read(ulog, tmp_path, capsys):
    data = ulog.read_bytes().replace(b"battery_status:uint64_t timestamp", b"battery_status:uint64_t timestalp")
    (tmp_path / "damaged.ulg").write_bytes(data)
    recording, made = recordings_of(tmp_path / "damaged.ulg")
    assert len(made.entries("/autopilot/status")) > 100
    assert recording.problem == "damaged.ulg: /battery_status has no times, and is not read"
    assert "/battery_status" not in told(tmp_path / "damaged.ulg", capsys)[1]


@pytest.mark.parametrize("more", [0, 2, 9])
def test_what_is_lost_of_a_ulog_that_was_cut_within_a_message_is_said(ulog, tmp_path, capsys, more):
    data, cut, end = ulog.read_bytes(), tmp_path / "cut.ulg", 16
    while end < len(data) * 2 // 3:
        end += 3 + int.from_bytes(data[end : end + 2], "little")
    cut.write_bytes(data[: end + more])
    (tmp_path / "ulog.yaml").write_text(propose([ulog]).text)
    status = amaze_replay(["run", str(cut), "--map", str(tmp_path / "ulog.yaml")])
    words = f"cut.ulg: its last {more} bytes, from byte {end} on, are no whole record: it was cut there"
    assert (status, f"DAMAGED: {words}" in capsys.readouterr().out) == ((3, True) if more else (0, False))
    assert amaze_bag(["info", str(cut)]) == 0
    assert (f"\n  {words}\n" in capsys.readouterr().out) == bool(more)


def test_a_ulog_that_px4_went_on_with_after_a_crash_was_not_cut(ulog, tmp_path):
    data, path = bytearray(ulog.read_bytes()), tmp_path / "appended.ulg"
    data += struct.pack("<H", 40) + b"D" + bytes(2)  # the beginning of a message, where PX4 died
    data[16 + 3 + 16 : 16 + 3 + 24] = len(data).to_bytes(8, "little")
    data[16 + 3 + 8] |= 1
    path.write_bytes(data + struct.pack("<H", 9 + 5) + b"L" + struct.pack("<BQ", ord("6"), 60_000_000) + b"again")
    with other_recording(path) as recording:
        assert (recording.problem, recording.cut) == ("", "")


def test_verbs_that_change_bags_say_what_reads_it(ulog, tmp_path, capsys):
    assert amaze_bag(["merge", str(ulog), "-o", str(tmp_path / "out.bag")]) == 1
    assert "is no bag but a ULog of PX4; amaze-bag info and amaze-replay read it" in capsys.readouterr().err
