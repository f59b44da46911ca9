"""Eleven kinds of strangers' recordings, mapped by `amaze-replay map` without an edit: a first useful timeline each."""

from __future__ import annotations

import re

import numpy as np
import pytest
from other_recordings import px4_rows, ulog_rows, write_mcap, write_ros2, write_ulog
from replay_bags import START_NS, S, battery, flight_rows, header, height_m, imu, make, write_bag
from replay_runs import recording
from test_proposal import mavros_rows

from amaze_autonomy.tester.command import main


def rows_of(*streams, length_s=36.0):
    """Return messages in order; a stream is topic, rate in Hz and what makes a message of its times in ns and s."""
    rows = [
        (START_NS + round(step / rate_hz * S), topic, message(START_NS + round(step / rate_hz * S), step / rate_hz))
        for topic, rate_hz, message in streams
        for step in range(int(length_s * rate_hz))
    ]
    return sorted(rows, key=lambda row: row[0])


def fix(at, t_s):
    """Return a fix at 488 m above the sea, on the ground; receivers wander by some centimetres."""
    status = make("sensor_msgs/msg/NavSatStatus", status=0, service=1)
    return make(
        "sensor_msgs/msg/NavSatFix", header=header(at), status=status, latitude=47.397742, longitude=8.545594,
        altitude=488.0 + height_m(t_s) + 0.1 * (round(5 * t_s) % 3 - 1), position_covariance=np.zeros(9),
        position_covariance_type=0,
    )  # fmt: skip


def number(kind, value):
    return make(f"std_msgs/msg/{kind}", data=value)


def wheels(at, x):
    """Return what the wheels of a rover say: it drives, and never climbs."""
    zeros, still = np.zeros(36), make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
    ahead = make("geometry_msgs/msg/Vector3", x=0.4, y=0.0, z=0.0)
    pose = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=0.0, z=0.0),
        orientation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    twist = make("geometry_msgs/msg/Twist", linear=ahead, angular=still)
    return make(
        "nav_msgs/msg/Odometry",
        header=header(at),
        child_frame_id="",
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=zeros),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zeros),
    )


def dji_rows():
    """Return what a DJI onboard SDK publishes: standard types by names of its own, its battery in percent."""
    return rows_of(
        ("/dji_sdk/imu", 100.0, lambda at, _: imu(at)),
        ("/dji_sdk/gps_position", 5.0, fix),
        ("/dji_sdk/height_above_takeoff", 10.0, lambda _, t_s: number("Float32", height_m(t_s))),
        ("/dji_sdk/battery_state", 1.0, lambda at, _: battery(at, 87.0)),
        ("/dji_sdk/flight_status", 10.0, lambda _, t_s: number("UInt8", 0 if t_s < 7.6 else 1 if t_s < 8.0 else 2)),
    )


def ardupilot_rows():
    """Return what mavros says of an ArduCopter that tells no landed state, its battery without a level."""
    rows = [row for row in mavros_rows(state_hz=5.0, mode="STABILIZE") if row[1] != "/mavros/extended_state"]
    for at, topic, message in rows:
        if topic == "/mavros/state" and (at - START_NS) / S >= 7.6:
            message.mode = "GUIDED"
    return rows


def plain_rows():
    return rows_of(("/imu", 100.0, lambda at, _: imu(at)), ("/gps/fix", 5.0, fix))


def rover_rows():
    return rows_of(
        ("/imu/data", 50.0, lambda at, _: imu(at)),
        ("/odometry/wheels", 20.0, lambda at, t_s: wheels(at, 0.4 * t_s)),
        ("/navsat/fix", 5.0, lambda at, _: fix(at, 0.0)),
    )


def sensor_rows():
    return [row for row in flight_rows() if row[1] in ("/imu", "/range", "/battery")]


def bag(rows):
    return lambda folder: write_bag(folder / "x.bag", rows())


# kind: how it is written, lift-off by its timeline, and lines that it must have besides
UP = 8.2  # when `height_m` is above 0.3 m
KINDS = {
    "mavros of a PX4": (bag(lambda: mavros_rows(state_hz=5.0)), UP, ("flying  by at_takeoff_height", "COMPLETE")),
    "mavros of an ArduPilot": (bag(ardupilot_rows), UP, ("flying  by at_takeoff_height", "COMPLETE")),
    "PX4 by uXRCE in a ROS 2 bag": (
        lambda folder: write_ros2(folder / "x", px4_rows(ulog_rows())),
        UP,
        ("pilot_took_over (reason flight mode AUTO.LAND", "landing detection: ON_GROUND"),
    ),
    "ULog of a PX4": (
        lambda folder: write_ulog(folder / "x.ulg", ulog_rows(), [(7.6, 6, "Armed")]),
        UP,
        ("the autopilot says: Armed", "pilot_took_over (reason flight mode AUTO.LAND"),
    ),
    "MCAP of ROS 2 with plain sensors": (
        lambda folder: write_mcap(folder / "x.mcap", sensor_rows()),
        UP,
        ("landing detection: ON_GROUND", "COMPLETE"),
    ),
    "DJI": (bag(dji_rows), UP, ("flying  by at_takeoff_height", "COMPLETE")),
    "Imu and NavSatFix alone": (bag(plain_rows), UP, ("flying  by at_takeoff_height", "COMPLETE")),
    "rover": (bag(rover_rows), None, ("the estimate moves though the vehicle stands",)),
    "Crazyflie": (lambda _: recording("crazyflie_sine.bag"), 8.17, ("landing detection: ON_GROUND",)),
    "AR.Drone": (
        lambda _: recording("ardrone_indoor_flight.bag"),
        0.0,
        ("the recording begins in the air at 0.7 m", "impact: acceleration up to 31.0 m/s^2"),
    ),
    "telemetry log of a PX4": (
        lambda _: recording("px4_gps_loss_param.tlog"),
        5.77,
        ("flying  by at_takeoff_height", "the autopilot says: Failsafe activated", "impact: acceleration up to 118.6"),
    ),
}


@pytest.mark.slow_rows
@pytest.mark.parametrize("kind", KINDS)
def test_a_recording_of_a_stranger_gives_a_useful_timeline_without_an_edit(kind, tmp_path, capsys):
    write, lift_off_s, wanted = KINDS[kind]
    path, topic_map, out = write(tmp_path), tmp_path / "map.yaml", tmp_path / "out"
    assert main(["map", str(path), "--out", str(topic_map)]) == 0
    assert main(["run", str(path), "--map", str(topic_map), "--out", str(out), "--no-html"]) == 0
    timeline = (out / "timeline.txt").read_text()
    assert [text for text in wanted if text not in timeline] == []
    assert "contradiction" not in timeline
    assert lifted_off(capsys.readouterr().out + topic_map.read_text(), timeline, lift_off_s)


def lifted_off(found, timeline, lift_off_s):
    """Return True when the map or the timeline tells the lift-off within half a second; None: there must be none."""
    told = re.findall(r"lift-off by [^:]*: ([+-][\d.]+) s", found)
    told += re.findall(
        r"([+-][\d.]+)  \S+ +(?:TAKEOFF/climbing|landing detection: AIRBORNE|the recording begins in the air)", timeline
    )
    if lift_off_s is None:
        return not told
    return any(abs(float(t) - lift_off_s) <= 0.5 for t in told)
