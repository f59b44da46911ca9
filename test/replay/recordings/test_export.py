"""What is exported is read by other programs as it was recorded: the messages, their numbers, the track."""

from __future__ import annotations

import csv
import errno
import json
import os
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from mcap.reader import make_reader
from other_recordings import ulog_rows, write_mcap, write_ros2, write_ulog
from pyulog.core import ULog
from replay_bags import break_chunk, flight_rows, make, write_bag
from replay_runs import recording
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Reader
from test_other_recordings import FLIGHT_MAP, replayed

from amaze_autonomy import files
from amaze_autonomy.replay.recordings.export import export
from amaze_autonomy.tester.command import main


def written(path):
    """Return what the library of MCAP reads: (time, topic, type, encoding, bytes), and the profile."""
    with path.open("rb") as file:
        reader = make_reader(file)
        rows = [
            (message.log_time, channel.topic, schema.name, channel.message_encoding, message.data)
            for schema, channel, message in reader.iter_messages(log_time_order=True)
        ]
        return rows, reader.get_header().profile


def test_mcap_of_a_bag_has_its_messages_byte_for_byte_and_replays_to_the_same_journal(tmp_path):
    bag = write_bag(tmp_path / "flight.bag", flight_rows(), "lz4")
    done = export([bag], tmp_path / "flight.mcap")
    rows, profile = written(tmp_path / "flight.mcap")
    with Reader(bag) as reader:
        expected = sorted(
            (t_ns, each.topic, each.msgtype.replace("/msg/", "/"), "ros1", bytes(raw))
            for each, t_ns, raw in reader.messages()
        )
    assert (sorted(rows), profile) == (expected, "ros1")
    assert (done.messages, done.unread, done.left_out) == (3672, {}, ())
    assert replayed(tmp_path / "flight.mcap", FLIGHT_MAP).journal == replayed(bag, FLIGHT_MAP).journal


def test_mcap_of_a_ros2_bag_is_what_ros2_would_have_written(tmp_path):
    rows = flight_rows(5.0)
    export([write_ros2(tmp_path / "two", rows)], tmp_path / "out.mcap")
    expected = written(write_mcap(tmp_path / "own.mcap", rows))
    found = written(tmp_path / "out.mcap")
    assert (sorted(found[0]), found[1]) == (sorted(expected[0]), "ros2")


def test_mcap_of_a_ulog_has_its_fields_as_json(tmp_path):
    path = write_ulog(tmp_path / "x.ulg", ulog_rows(5.0))
    export([path], tmp_path / "x.mcap", ["/sensor_combined", "/autopilot/status"])
    rows, profile = written(tmp_path / "x.mcap")
    data = ULog(str(path)).get_dataset("sensor_combined").data
    found = [json.loads(each[4]) for each in rows if each[1] == "/sensor_combined"]
    assert [each["timestamp"] for each in found] == data["timestamp"].tolist()
    assert found[0]["accelerometer_m_s2"] == [data[f"accelerometer_m_s2[{axis}]"][0] for axis in range(3)]
    assert {(each[1], each[2], each[3]) for each in rows} == {
        ("/sensor_combined", "px4_msgs/SensorCombined", "json"),
        ("/autopilot/status", "amaze_autonomy/AutopilotStatus", "json"),
    }
    assert profile == ""


def test_tables_have_a_row_for_each_message_with_the_paths_of_topic_maps(tmp_path):
    bag = write_bag(tmp_path / "flight.bag", flight_rows(2.0))
    done = export([bag], tmp_path / "tables", ["/imu", "/range"])
    assert [path.name for path in done.files] == ["imu.csv", "range.csv"]
    with (tmp_path / "tables" / "imu.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert (len(rows), rows[1]["t_s"]) == (100, "1600000000.020000000")
    assert float(rows[1]["linear_acceleration.z"]) == 9.81
    assert float(rows[1]["orientation_covariance[8]"]) == 0.0


def test_the_track_of_a_real_drive_is_that_of_its_fixes(tmp_path):
    bag = recording("husky_outdoor_drive.bag")
    export([bag], tmp_path / "drive.kml")
    with AnyReader([bag]) as reader:
        fixes = [
            reader.deserialize(raw, each.msgtype)
            for each, _, raw in reader.messages()
            if each.msgtype == "sensor_msgs/msg/NavSatFix"
        ]
    names = {"gx": "http://www.google.com/kml/ext/2.2", "k": "http://www.opengis.net/kml/2.2"}
    track = ET.parse(tmp_path / "drive.kml").getroot().find(".//gx:Track", names)
    places = [tuple(map(float, each.text.split())) for each in track.findall("gx:coord", names)]
    assert len(track.findall("k:when", names)) == len(places) == len(fixes) > 900
    expected = [(each.longitude, each.latitude, each.altitude) for each in fixes]
    assert np.allclose(places, expected, atol=1e-3, rtol=0.0)
    assert np.allclose(np.array(places)[:, :2], np.array(expected)[:, :2], atol=1e-7, rtol=0.0)


def test_the_track_of_a_telemetry_log_is_in_degrees_and_metres(tmp_path):
    export([recording("px4_normal_mission.tlog")], tmp_path / "x.kml", ["/mavlink/GLOBAL_POSITION_INT"])
    text = (tmp_path / "x.kml").read_text()
    longitude, latitude, above = map(float, text.split("<gx:coord>")[1].split("<")[0].split())
    assert (round(longitude, 2), round(latitude, 2), round(above, -2)) == (8.55, 47.4, 500.0)


def test_a_fix_that_is_none_is_no_place(tmp_path):
    path = write_ulog(tmp_path / "x.ulg", ulog_rows(10.0, no_fix_s=(4.0, 6.0)))
    assert export([path], tmp_path / "x.kml").messages == 40


# --- what is wrong ----------------------------------------------------------------------------------------------------


def test_what_cannot_be_read_is_missing_and_is_said(tmp_path, capsys):
    bag = write_bag(tmp_path / "x.bag", flight_rows(10.0), "bz2", chunk_bytes=10_000)
    break_chunk(bag, 3, 40, 40)
    assert main(["export", str(bag), "-o", str(tmp_path / "x.mcap")]) == 3
    out = capsys.readouterr().out
    assert "messages cannot be read, they are missing" in out
    assert 0 < len(written(tmp_path / "x.mcap")[0]) < 1020
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.bag", "x.mcap"]


def test_what_cannot_be_exported_is_one_line(tmp_path, capsys):
    bag = write_bag(tmp_path / "x.bag", flight_rows(1.0))
    assert main(["export", str(bag), "-o", str(tmp_path / "x.kml")]) == 2
    assert "no topic tells where the vehicle is: none is of such a type" in capsys.readouterr().err
    assert main(["export", str(bag), "-o", str(tmp_path / "x"), "--topics", "/gps"]) == 2
    assert "there is no message of such a topic; there are /armed, /battery, /imu" in capsys.readouterr().err


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_a_recording_is_never_its_own_output(tmp_path, capsys, force):
    file = write_mcap(tmp_path / "e.mcap", flight_rows(2.0))
    folder = write_ros2(tmp_path / "two", flight_rows(2.0))
    (inside,) = folder.glob("*.db3")
    (tmp_path / "link.mcap").symlink_to(file)
    os.link(inside, tmp_path / "inside.mcap")
    before = [path.read_bytes() for path in (file, inside)]
    for name, source in (("e.mcap", file), ("link.mcap", file), ("two", folder), ("inside.mcap", folder)):
        output = tmp_path / name
        assert main(["export", str(source), "-o", str(output), "--topics", "/imu", *force]) == 2
        assert f"{output}: is one of the recordings, which are never changed" in capsys.readouterr().err
    assert [path.read_bytes() for path in (file, inside)] == before
    assert sorted(each.name for each in folder.iterdir()) == [*sorted({inside.name, "metadata.yaml"})]


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_tables_need_a_folder_and_the_others_a_file(tmp_path, capsys, force):
    source = write_bag(tmp_path / "x.bag", flight_rows(1.0))
    (tmp_path / "x.mcap").mkdir()
    (tmp_path / "tables").write_text("mine")
    for name, wrong in (("x.mcap", "is a folder"), ("tables", "is no folder")):
        assert main(["export", str(source), "-o", str(tmp_path / name), *force]) == 2
        words = f"{wrong}; name a folder for tables, or a file x.mcap or x.kml"
        assert capsys.readouterr().err == f"amaze-replay: {tmp_path / name}: {words}\n"


def test_what_cannot_be_written_is_told_by_the_name_that_was_given(tmp_path, capsys, monkeypatch):
    source = write_bag(tmp_path / "x.bag", flight_rows(1.0))
    missing, output = tmp_path / "no" / "x.mcap", tmp_path / "x.mcap"
    assert main(["export", str(source), "-o", str(missing)]) == 2
    assert capsys.readouterr().err == f"amaze-replay: {missing}: No such file or directory\n"

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    assert main(["export", str(source), "-o", str(output)]) == 2
    assert capsys.readouterr().err == f"amaze-replay: {output}: No space left on device\n"
    assert [path.name for path in tmp_path.iterdir()] == ["x.bag"]


@pytest.mark.parametrize("name", ["x.mcap", "x.kml", "tables"])
def test_what_exists_is_replaced_only_where_that_is_asked(tmp_path, capsys, name):
    source, output = write_ulog(tmp_path / "x.ulg", ulog_rows(5.0)), tmp_path / name
    command = ["export", str(source), "-o", str(output), "--topics", "/vehicle_gps_position"]
    assert main(command) == 0
    file = output / "vehicle_gps_position.csv" if name == "tables" else output
    good = file.read_bytes()
    file.write_bytes(b"mine")
    capsys.readouterr()
    assert main(command) == 2
    assert f"{file}: exists; choose another name, or say that it may be replaced" in capsys.readouterr().err
    assert file.read_bytes() == b"mine"
    assert main([*command, "--force"]) == 0
    assert len(file.read_bytes()) == len(good)


def test_tables_come_into_a_folder_beside_those_of_other_topics(tmp_path):
    source = write_bag(tmp_path / "x.bag", flight_rows(1.0))
    for topic in ("/imu", "/armed"):
        export([source], tmp_path / "tables", [topic])
    assert sorted(path.name for path in (tmp_path / "tables").iterdir()) == ["armed.csv", "imu.csv"]


def test_each_topic_of_each_recording_has_a_table_of_its_own_whatever_it_is_called(tmp_path):
    names, start_ns = (("/cam", "/cam/2", "/cam__3", "cam"), ("/cam",)), 1_600_000_000_000_000_000
    bags = [
        write_bag(
            tmp_path / f"{number}.bag",
            [(start_ns, name, make("std_msgs/msg/String", data=f"{name} of {number}")) for name in names[number]],
        )
        for number in (0, 1)
    ]
    done = export(bags, tmp_path / "tables")
    tables = [path.read_text().splitlines()[1].partition(",")[2] for path in done.files]
    assert sorted(tables) == ["/cam of 0", "/cam of 1", "/cam/2 of 0", "/cam__3 of 0", "cam of 0"]
    assert sorted(done.files) == sorted((tmp_path / "tables").iterdir())


def test_a_long_array_is_left_out_of_tables_and_that_is_said(tmp_path, capsys):
    image = make("std_msgs/msg/Float32MultiArray", layout=_layout(), data=np.zeros(100, np.float32))
    bag = write_bag(tmp_path / "x.bag", [(1_600_000_000_000_000_000, "/long", image)])
    assert main(["export", str(bag), "-o", str(tmp_path / "tables")]) == 0
    assert "/long: data has more than 64 elements" in capsys.readouterr().out


def _layout():
    return make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
