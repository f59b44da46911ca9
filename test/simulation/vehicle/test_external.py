"""A vehicle that is flown elsewhere: sensors follow what it says of itself."""

from __future__ import annotations

import dataclasses
import math

import pytest

from amaze_autonomy.autopilot.link.dialect import mavlink
from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.simulation import NoEffectError, parse_scenario
from amaze_autonomy.simulation.vehicle.external import ExternalVehicle, Observer, as_external
from amaze_autonomy.simulation.vehicle.vehicle import VehicleSettings

S = 1_000_000_000
LATITUDE, LONGITUDE = 473977420, 85455940
MISSION, LOITER = 4 << 16 | 4 << 24, 4 << 16 | 3 << 24
ON_GROUND, IN_AIR = mavlink.MAV_LANDED_STATE_ON_GROUND, mavlink.MAV_LANDED_STATE_IN_AIR


class Flown:
    """A vehicle and what it hears of the one that it follows."""

    def __init__(self):
        self.seen = Observer()
        self.vehicle = ExternalVehicle(VehicleSettings(), 0, self.seen)
        self.t_ns = 0

    def hear(self, *messages):
        self.t_ns += S
        for message in messages:
            message._header.srcSystem, message._header.srcComponent = 1, 1
            self.seen.receive(self.t_ns, message)
        self.vehicle.happened.clear()
        self.vehicle.advance(self.t_ns)


def heartbeat(*, armed, mode=MISSION):
    flags = 1 | (mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
    return mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, flags, mode, 4, 3)


def landed(state):
    return mavlink.MAVLink_extended_sys_state_message(0, state)


def truth(up_mm, *, north_e7=0, climb_cm_s=0, attitude=(1.0, 0.0, 0.0, 0.0)):
    place = (LATITUDE + north_e7, LONGITUDE, 489_400 + up_mm)
    return mavlink.MAVLink_hil_state_quaternion_message(0, attitude, 0, 0, 0, *place, 0, 0, -climb_cm_s, 0, 0, 0, 0, 0)


def estimate(north, east, down):
    return mavlink.MAVLink_local_position_ned_message(0, north, east, down, 0, 0, 0)


@pytest.fixture
def flown():
    made = Flown()
    made.hear(heartbeat(armed=False), landed(ON_GROUND), truth(0))
    return made


def test_what_nobody_has_heard_of_stands_where_it_is():
    vehicle = ExternalVehicle(VehicleSettings(), 0, Observer())

    vehicle.advance(S)

    assert (vehicle.t_ns, vehicle.position_m, vehicle.armed, vehicle.happened) == (S, (0.0, 0.0, 0.0), False, [])


def test_it_is_where_the_simulator_says_from_where_it_stood_first(flown):
    flown.hear(heartbeat(armed=True), landed(IN_AIR), truth(2500, north_e7=898, climb_cm_s=50))

    assert flown.vehicle.position_m == pytest.approx((0.0, 10.0, 2.5), abs=0.02)
    assert flown.vehicle.velocity_m_s == pytest.approx((0.0, 0.0, 0.5))
    assert flown.vehicle.airborne


def test_the_estimate_is_taken_only_where_there_is_no_truth(flown):
    flown.hear(heartbeat(armed=True), landed(IN_AIR), truth(2500), estimate(0.0, 0.0, -9.0))
    assert flown.vehicle.height_m == pytest.approx(2.5)

    alone = Flown()
    alone.hear(heartbeat(armed=False), landed(ON_GROUND), estimate(1.0, 2.0, 0.3))
    alone.hear(heartbeat(armed=True), landed(IN_AIR), estimate(1.0, 5.0, -1.7))
    assert alone.vehicle.position_m == pytest.approx((3.0, 0.0, 2.0))


def test_an_estimate_that_wanders_on_the_ground_lifts_nothing(flown):
    flown.hear(heartbeat(armed=False), landed(ON_GROUND), truth(400))

    assert (flown.vehicle.airborne, flown.vehicle.position_m[2], flown.vehicle.happened) == (False, 0.0, [])


def test_what_it_does_is_what_scenarios_wait_for(flown):
    happened = []
    for messages in (
        (heartbeat(armed=True),),
        (landed(IN_AIR), truth(1200)),
        (mavlink.MAVLink_mission_item_reached_message(1),),
        (heartbeat(armed=True, mode=LOITER),),
        (landed(ON_GROUND), truth(0)),
        (heartbeat(armed=False, mode=LOITER),),
    ):
        flown.hear(*messages)
        happened.append(tuple(flown.vehicle.happened))

    assert happened == [("armed", "takeoff"), ("airborne",), ("waypoint",), ("hold",), ("landed",), ("disarmed",)]
    assert (flown.vehicle.reached, flown.vehicle.landed) == (1, VehicleLanded.ON_GROUND)


ITEMS = {
    mavlink.MAV_AUTOPILOT_PX4: ((0, 1, 2, 2), 3),  # takeoff, two waypoints, the landing
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: ((1, 2, 3, 3, 4, 5), 6),  # takeoff, a turn and a waypoint, twice, the landing
}


@pytest.mark.parametrize("make", ITEMS)
def test_of_the_items_of_a_mission_only_its_waypoints_count(flown, make):
    beat = heartbeat(armed=True)
    beat.autopilot = make
    in_air, landing = ITEMS[make]
    numbers = []
    for _ in range(2):
        flown.hear(beat, landed(IN_AIR), truth(2000))
        for item in in_air:
            flown.hear(mavlink.MAVLink_mission_item_reached_message(item))
            numbers += [flown.vehicle.reached] * flown.vehicle.happened.count("waypoint")
        flown.hear(landed(ON_GROUND), mavlink.MAVLink_mission_item_reached_message(landing))
        assert "waypoint" not in flown.vehicle.happened
    assert numbers == [1, 2, 1, 2]


def test_its_range_finder_looks_along_its_lean(flown):
    lean = (math.cos(0.1), math.sin(0.1), 0.0, 0.0)

    flown.hear(heartbeat(armed=True), landed(IN_AIR), truth(2000, attitude=lean))

    assert flown.vehicle.tilt_rad == pytest.approx(0.2, abs=1e-6)
    assert flown.vehicle.yaw_rad == pytest.approx(math.pi / 2)


def test_what_cannot_be_made_unhealthy_from_outside_is_silent():
    given = parse_scenario("description: one\nfaults:\n  - {component: imu, fault: unhealthy, at_s: 3.0}\n")

    (fault,) = as_external(given).faults

    assert (fault.kind.name, fault.target, fault.trigger) == ("silent", "imu", given.faults[0].trigger)
    assert dataclasses.replace(fault, kind=given.faults[0].kind) == given.faults[0]


def test_a_fault_of_the_vehicle_itself_is_refused_with_its_line():
    given = parse_scenario("description: one\nfaults:\n  - {fault: gps_lost, at_s: 3.0}\n")

    with pytest.raises(NoEffectError) as caught:
        as_external(given)

    assert str(caught.value).endswith("gps_lost would do nothing: the vehicle is flown elsewhere: do it there")
    assert caught.value.where


def test_a_slope_under_it_and_data_that_is_lost_are_the_worlds_own():
    given = parse_scenario(
        "description: one\nfaults:\n  - {fault: tilted, tilt_deg: 20.0}\n  - {fault: data_incomplete}\n"
    )

    assert as_external(given) == given
