from __future__ import annotations

from math import nan
from types import SimpleNamespace as Said

import pytest

from amaze_autonomy.autopilot.commands import command_long, set_mode
from amaze_autonomy.autopilot.control import Heartbeat
from amaze_autonomy.autopilot.dialect import mavlink
from amaze_autonomy.autopilot.mavros_messages import SOURCES, VELOCITY, Converter, Request, request_of

BY_TOPIC = {source.topic: source for source in SOURCES}


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


def test_a_battery_keeps_what_is_unknown():
    full = convert("battery", voltage=15.8, cell_voltage=[], current=-2.5, percentage=0.84)
    assert (full.voltages[:2], full.current_battery, full.battery_remaining) == ([15800, 65535], 250, 84)
    empty = convert("battery", voltage=nan, cell_voltage=[], current=nan, percentage=nan)
    assert (empty.voltages[:2], empty.current_battery, empty.battery_remaining) == ([65535, 65535], -1, -1)


def test_position_and_velocity_come_together_north_east_down():
    converter = Converter()
    pose = Said(pose=Said(position=Said(x=1.0, y=2.0, z=3.0)))
    assert str(converter.convert(BY_TOPIC["local_position/pose"], pose).vz) == "nan"
    assert converter.convert(VELOCITY, Said(twist=Said(linear=Said(z=0.5)))) is None
    message = converter.convert(BY_TOPIC["local_position/pose"], pose)
    assert (message.x, message.y, message.z, message.vz) == (2.0, 1.0, -3.0, -0.5)


def test_requests_of_the_client_are_services():
    assert request_of(set_mode(1, 1, 4, 6)) == Request(
        "set_mode", "SetMode", {"base_mode": 0, "custom_mode": "AUTO.LAND"}, 176
    )
    disarm = request_of(command_long(1, 1, 400, 0.0))
    assert (disarm.service, disarm.fields["command"], disarm.fields["param1"]) == ("cmd/command", 400, 0.0)
    asked = mavlink.MAVLink_param_request_read_message(1, 1, b"COM_LOW_BAT_ACT", -1)
    assert request_of(asked) == Request("param/get", "ParamGet", {"param_id": "COM_LOW_BAT_ACT"})
    assert request_of(mavlink.MAVLink_timesync_message(0, 1)) is None
