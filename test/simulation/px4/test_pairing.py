"""A world whose vehicle is flown over MAVLink: its faults reach the wire, and the wire reaches its triggers."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from amaze_autonomy.autopilot.vehicle.preflight import channel_width_us
from amaze_autonomy.config import load_configuration
from amaze_autonomy.simulation import parse_scenario
from amaze_autonomy.simulation.ardupilot import AUTOPILOTS, ArduPilot
from amaze_autonomy.simulation.errors import UnsupportedParameterError
from amaze_autonomy.simulation.px4 import Framing, VehicleAddressError
from amaze_autonomy.simulation.px4.pairing import addresses_of, fly_world

S, STEP = 1_000_000_000, 20_000_000
CONFIG = Path(__file__).parents[3] / "config"


@pytest.fixture(scope="module")
def configuration():
    return load_configuration(CONFIG)


class Flight:
    """A world and its PX4 in virtual time."""

    def __init__(self, configuration, faults=""):
        text = "description: a test\n" + (f"faults:\n  - {{{faults}}}\n" if faults else "")
        self.world, self.px4 = fly_world(configuration, None, parse_scenario(text))
        self.px4.connect("client")
        self._framing = Framing(1, 191)
        self.heard = {}
        self.t_ns = 0

    def advance(self, seconds):
        for _ in range(round(seconds * S / STEP)):
            self.t_ns += STEP
            self.world.advance(self.t_ns)
            self.heard.update((message.get_type(), message) for _, message in self.px4.advance(self.t_ns))
        return self

    def command(self, number, *params):
        message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *params, *[0.0] * (7 - len(params)))
        for decoded in Framing(1, 1).decode(self._framing.encode(message)):
            self.px4.receive(self.t_ns, "client", decoded)
        return self.advance(0.1).heard["COMMAND_ACK"].result

    def take_off(self):
        assert self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, *[float("nan")] * 3, 491.0) == 0
        return self.advance(6.0)


def test_what_is_wrong_with_the_vehicle_is_refused_over_mavlink(configuration):
    flight = Flight(configuration, "fault: not_ready, what: prearm, for_s: 5.0").advance(2.0)
    assert flight.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert flight.advance(5.0).command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0


def test_the_battery_of_the_world_is_told(configuration):
    flight = Flight(configuration, "fault: battery_drops, to_fraction: 0.1").advance(3.0)
    assert flight.heard["SYS_STATUS"].battery_remaining == 10
    assert flight.heard["BATTERY_STATUS"].charge_state == mavlink.MAV_BATTERY_CHARGE_STATE_LOW


def test_a_sensor_of_the_world_is_a_bit_of_sys_status(configuration):
    flight = Flight(configuration, "component: magnetometer, fault: unhealthy, at_s: 2.0").advance(1.5)
    bit = mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    assert flight.heard["SYS_STATUS"].onboard_control_sensors_health & bit
    assert not flight.advance(1.5).heard["SYS_STATUS"].onboard_control_sensors_health & bit


def test_a_gps_that_is_lost_ends_in_a_blind_descent(configuration):
    flight = Flight(configuration, "fault: gps_lost, after: {event: airborne, delay_s: 1.0}").take_off()
    gps = mavlink.MAV_SYS_STATUS_SENSOR_GPS
    assert flight.heard["GPS_RAW_INT"].fix_type == 0
    assert flight.heard["SYS_STATUS"].onboard_control_sensors_health & gps
    flight.advance(5.0)
    assert (flight.heard["HEARTBEAT"].custom_mode, flight.heard["HEARTBEAT"].system_status) == (6 << 24 | 4 << 16, 5)
    assert not flight.advance(3.0).heard["SYS_STATUS"].onboard_control_sensors_present & gps


@pytest.mark.parametrize(
    "fault, landed, up_mm",
    [
        ("estimate_off, height_m: 40.0, position_m: -9.0", mavlink.MAV_LANDED_STATE_ON_GROUND, 40_450),
        ("ground_unknown", mavlink.MAV_LANDED_STATE_UNDEFINED, 450),
        ("seems_landed", mavlink.MAV_LANDED_STATE_ON_GROUND, 450),
    ],
)
def test_what_the_autopilot_is_wrong_about_is_wrong_on_the_wire(configuration, fault, landed, up_mm):
    flight = Flight(configuration, f"fault: {fault}").advance(2.0)
    assert flight.heard["EXTENDED_SYS_STATE"].landed_state == landed
    assert flight.heard["GLOBAL_POSITION_INT"].relative_alt == pytest.approx(up_mm, abs=60)


@pytest.mark.parametrize("channel", [7, 12])
def test_the_land_switch_is_a_channel_of_the_transmitter(channel):
    configuration = load_configuration(CONFIG, [f"autopilot.land_switch.channel={channel}"])
    flight = Flight(configuration, "fault: land_switch, at_s: 2.0, for_s: 2.0")
    widths_us = [channel_width_us(flight.advance(1.5).heard["RC_CHANNELS"], channel) for _ in range(3)]
    assert widths_us == [1000.0, 2000.0, 1000.0]
    others = {channel_width_us(flight.heard["RC_CHANNELS"], each) for each in range(1, 19) if each != channel}
    assert others == {1500.0, 1100.0, 1000.0, None}


def test_events_of_a_flight_over_mavlink_trigger_faults(configuration):
    flight = Flight(configuration, "fault: pilot_takes_over, after: {event: airborne, delay_s: 1.0}").take_off()
    assert flight.world.vehicle.pilot
    assert flight.heard["HEARTBEAT"].custom_mode == 3 << 16


def test_the_vehicle_has_the_parameters_that_the_configuration_expects(configuration):
    expected = configuration.autopilot.parameters
    _, px4 = fly_world(configuration)
    assert expected
    assert {name: px4.parameters[name] for name in expected} == dict(expected)


@pytest.mark.parametrize("action", [0, 4, 5, 6])
def test_a_parameter_that_the_simulated_vehicle_cannot_follow_is_refused(action):
    configuration = load_configuration(CONFIG, [f"autopilot.parameters.NAV_RCL_ACT={action}"])
    with pytest.raises(UnsupportedParameterError) as refused:
        fly_world(configuration)
    words = "must be 1 (hold), 2 (return) or 3 (land) for the simulated PX4; override"
    assert str(refused.value) == f"NAV_RCL_ACT {action}: {words} autopilot.parameters.NAV_RCL_ACT to simulate"
    _, ardupilot = fly_world(configuration, kind=AUTOPILOTS["ardupilot"])  # which has no such parameter
    assert isinstance(ardupilot, ArduPilot)


def test_the_vehicle_is_at_the_other_end_of_the_nodes_links(configuration):
    assert addresses_of(configuration) == ("udpout:127.0.0.1:14540", "udpout:127.0.0.1:14541")
    serial = dataclasses.replace(configuration.autopilot.link, url="serial:/dev/ttyACM0:57600")
    settings = dataclasses.replace(configuration.autopilot, link=serial)
    with pytest.raises(VehicleAddressError, match="reached by udpin: or udpout: only"):
        addresses_of(dataclasses.replace(configuration, autopilot=settings))
