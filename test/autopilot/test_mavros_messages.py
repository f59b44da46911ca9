from __future__ import annotations

from math import cos, nan, pi, sin
from types import SimpleNamespace as Said

import pytest

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.autopilot.mavros.messages import Converter, mode_problem, sources_of
from amaze_autonomy.autopilot.mavros.requests import Lane, Publication, Request, publication_of, request_of
from amaze_autonomy.autopilot.planner.sequencer import PLANNER_MESSAGES
from amaze_autonomy.autopilot.vehicle.battery import Battery
from amaze_autonomy.autopilot.vehicle.client import command_long, set_mode
from amaze_autonomy.autopilot.vehicle.control import Heartbeat
from amaze_autonomy.autopilot.vehicle.vehicle import WANTED

SOURCES = sources_of({*WANTED, *PLANNER_MESSAGES})
BY_TOPIC = {source.topic: source for source in SOURCES if source.makes != "ATTITUDE"}
ATTITUDE = next(source for source in SOURCES if source.makes == "ATTITUDE")


def convert(topic, **fields):
    return Converter().convert(BY_TOPIC[topic], Said(**fields))


def test_a_state_is_a_heartbeat_with_the_same_mode():
    message = convert("state", connected=True, armed=True, mode="AUTO.LAND", system_status=5)
    assert Heartbeat.of(7, message) == Heartbeat(7, armed=True, mode="AUTO.LAND", status=5, autopilot=12)


def test_a_mavros_without_a_vehicle_says_nothing():
    assert convert("state", connected=False, armed=False, mode="", system_status=0) is None


@pytest.mark.parametrize("mode", ["", "NO.SUCH"])
def test_a_mode_that_nobody_knows_is_none_of_ours(mode):
    message = convert("state", connected=True, armed=True, mode=mode, system_status=4)
    assert Heartbeat.of(0, message).mode == "MODE.0.0"


@pytest.mark.parametrize("connected, mode", [(True, "AUTO.LAND"), (True, "POSCTL"), (True, ""), (False, "GUIDED")])
def test_px4_s_modes_are_no_problem(connected, mode):
    assert mode_problem(Said(connected=connected, mode=mode)) == ""


@pytest.mark.parametrize("mode", ["GUIDED", "CMODE(25)"])
def test_a_mode_of_another_autopilot_behind_mavros_is_said(mode):
    words = f"mavros says mode {mode!r}, which is none of PX4's: whoever chose it has control (PX4 only this way)"
    assert mode_problem(Said(connected=True, mode=mode)) == words


def test_a_battery_keeps_what_is_unknown():
    full = convert("battery", location="", voltage=15.8, cell_voltage=[], current=-2.5, percentage=0.84)
    assert (full.voltages[:2], full.current_battery, full.battery_remaining) == ([15800, 65535], 250, 84)
    empty = convert("battery", location="id0", voltage=nan, cell_voltage=[], current=nan, percentage=nan)
    assert (empty.voltages[:2], empty.current_battery, empty.battery_remaining) == ([65535, 65535], -1, -1)


def test_position_and_velocity_come_together_north_east_down():
    converter = Converter()
    pose = Said(pose=Said(position=Said(x=1.0, y=2.0, z=3.0)))
    assert str(converter.convert(BY_TOPIC["local_position/pose"], pose).vz) == "nan"
    speed = Said(twist=Said(linear=Said(x=0.1, y=0.2, z=0.5)))
    assert converter.convert(BY_TOPIC["local_position/velocity_local"], speed) is None
    message = converter.convert(BY_TOPIC["local_position/pose"], pose)
    assert (message.x, message.y, message.z) == (2.0, 1.0, -3.0)
    assert (message.vx, message.vy, message.vz) == (0.2, 0.1, -0.5)
    for _ in range(4):
        assert converter.convert(BY_TOPIC["local_position/pose"], pose).vz == -0.5
    message = converter.convert(BY_TOPIC["local_position/pose"], pose)
    assert (message.z, str(message.vx), str(message.vz)) == (-3.0, "nan", "nan"), "its topic has ended"


@pytest.mark.parametrize("z, w, from_north", [(0.0, 1.0, pi / 2), (0.5**0.5, 0.5**0.5, 0.0), (1.0, 0.0, -pi / 2)])
def test_a_pose_tells_the_heading_from_north(z, w, from_north):
    pose = Said(pose=Said(orientation=Said(x=0.0, y=0.0, z=z, w=w)))
    assert Converter().convert(ATTITUDE, pose).yaw == pytest.approx(from_north)


@pytest.mark.parametrize(
    "about, roll, pitch",
    [("x", pi / 3, 0.0), ("y", 0.0, -pi / 3)],  # nose up is against y, which is to the left
)
def test_a_pose_tells_roll_and_pitch_as_mavlink_does(about, roll, pitch):
    axis = {"x": 0.0, "y": 0.0, "z": 0.0, about: sin(pi / 6)}
    message = Converter().convert(ATTITUDE, Said(pose=Said(orientation=Said(w=cos(pi / 6), **axis))))
    assert (message.roll, message.pitch) == (pytest.approx(roll), pytest.approx(pitch))


@pytest.mark.parametrize("w", [0.0, nan])
def test_a_pose_without_an_orientation_tells_no_roll_and_no_pitch(w):
    message = Converter().convert(ATTITUDE, Said(pose=Said(orientation=Said(x=0.0, y=0.0, z=0.0, w=w))))
    assert (str(message.roll), str(message.pitch)) == ("nan", "nan")


def test_a_place_and_its_height_come_together():
    converter = Converter()
    assert converter.convert(BY_TOPIC["global_position/rel_alt"], Said(data=2.5)) is None
    message = converter.convert(BY_TOPIC["global_position/global"], Said(latitude=47.1, longitude=-8.2))
    assert (message.lat, message.lon, message.relative_alt) == (471000000, -82000000, 2500)
    assert converter.convert(BY_TOPIC["global_position/global"], Said(latitude=nan, longitude=8.0)) is None
    for _ in range(4):
        assert converter.convert(BY_TOPIC["global_position/global"], Said(latitude=47.1, longitude=-8.2)) is not None
    assert converter.convert(BY_TOPIC["global_position/global"], Said(latitude=47.1, longitude=-8.2)) is None


def test_a_place_whose_height_never_came_is_none():
    assert convert("global_position/global", latitude=47.1, longitude=-8.2) is None


def test_only_topics_of_wanted_messages_are_listened_to():
    assert [source.topic for source in sources_of(["HEARTBEAT", "MISSION_CURRENT"])] == ["state", "mission/waypoints"]
    assert "mission/waypoints" not in {source.topic for source in sources_of(WANTED)}


def test_requests_of_the_client_are_services():
    assert request_of(set_mode(1, 1, 4, 6)) == Request(
        "set_mode", "SetMode", {"base_mode": 0, "custom_mode": "AUTO.LAND"}, 176, Lane.URGENT
    )
    disarm = request_of(command_long(1, 1, 400, 0.0))
    assert (disarm.service, disarm.fields["command"], disarm.fields["param1"]) == ("cmd/command", 400, 0.0)
    assert (disarm.lane, request_of(command_long(1, 1, 511, 0.0)).lane) == (Lane.URGENT, Lane.REST)
    asked = mavlink.MAVLink_param_request_read_message(1, 1, b"COM_LOW_BAT_ACT", -1)
    assert request_of(asked) == Request("param/get", "ParamGet", {"param_id": "COM_LOW_BAT_ACT"})
    assert request_of(mavlink.MAVLink_timesync_message(0, 1)) is None


def test_a_set_point_is_published_east_north_up():
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 3576, 2.0, 1.0, -3.0, 0, 0, 0, 0, 0, 0, pi / 2, 0
    )
    assert publication_of(message) == Publication(
        "setpoint_raw/local",
        "mavros_msgs/PositionTarget",
        {
            "coordinate_frame": 1,
            "type_mask": 3576,
            "yaw": 0.0,
            "position.x": 1.0,
            "position.y": 2.0,
            "position.z": 3.0,
            "velocity.x": 0,
            "velocity.y": 0,
            "velocity.z": 0,
        },
    )
    assert publication_of(set_mode(1, 1, 4, 6)) is None


def test_two_batteries_on_one_topic_are_told_apart_and_the_worst_counts():
    """mavros publishes each BATTERY_STATUS on one topic; its `location` names the battery."""
    battery = Battery({}, cells=4)
    for number, (where, level) in enumerate([("id0", 0.9), ("id1", 0.3)] * 3):
        said = convert("battery", location=where, voltage=15.0, cell_voltage=[], current=-1.0, percentage=level)
        assert said.id == number % 2
        battery.add_pack(number, said)
        if number:
            assert battery.reading(number).fraction == 0.3
    unnamed = convert("battery", location="", voltage=15.0, cell_voltage=[], current=-1.0, percentage=0.9)
    assert unnamed.id == 0
