"""The simulated vehicle: arming, takeoff, waypoints, landing, disarming, and who may command it."""

from math import radians

import pytest

from amaze_autonomy.engine.events import VehicleLanded
from amaze_autonomy.missions import FlightModel, Trajectory, Waypoint, estimate_flight
from amaze_autonomy.simulation.vehicle.vehicle import Vehicle, VehicleSettings

S = 1_000_000_000
ROUTE = (Waypoint(0.0, 0.0, 2.0, 0.0, 1.0), Waypoint(4.0, 0.0, 2.0, 0.0, 0.0))


@pytest.fixture
def vehicle():
    vehicle = Vehicle(VehicleSettings())
    assert vehicle.upload(ROUTE) == ""
    return vehicle


def fly_until(vehicle, condition, limit_s=120.0, step_ns=S // 10):
    end = vehicle.t_ns + round(limit_s * S)
    while not condition(vehicle):
        assert vehicle.t_ns < end, "never happened"
        vehicle.advance(vehicle.t_ns + step_ns)


def in_mission(vehicle):
    vehicle.take_off()
    fly_until(vehicle, lambda v: v.mode == "AUTO.MISSION")
    return vehicle


def facts(vehicle):
    return (vehicle.armed, vehicle.mode, vehicle.landed.name, vehicle.airborne)


def test_stands_disarmed_on_the_ground_and_loiters_at_first(vehicle):
    vehicle.advance(5 * S)
    assert facts(vehicle) == (False, "AUTO.LOITER", "ON_GROUND", False)
    assert vehicle.happened == []


def test_takes_off_flies_its_waypoints_and_waits_for_the_order_to_land(vehicle):
    assert vehicle.take_off() == ""
    fly_until(vehicle, lambda v: v.finished)
    assert facts(vehicle) == (True, "AUTO.MISSION", "IN_AIR", True)
    assert vehicle.position_m == (4.0, 0.0, 2.0)
    assert vehicle.happened == ["armed", "climb", "takeoff", "airborne", "mission", "waypoint", "waypoint"]


def test_lands_where_it_is_detects_the_ground_and_disarms_by_itself(vehicle):
    in_mission(vehicle).happened.clear()
    assert vehicle.land() == ""
    fly_until(vehicle, lambda v: not v.airborne)
    touched_ns = vehicle.t_ns
    assert facts(vehicle) == (True, "AUTO.LAND", "LANDING", False)
    fly_until(vehicle, lambda v: v.landed is VehicleLanded.ON_GROUND)
    assert facts(vehicle) == (True, "AUTO.LAND", "ON_GROUND", False)
    fly_until(vehicle, lambda v: not v.armed)
    assert facts(vehicle) == (False, "AUTO.LAND", "ON_GROUND", False)
    assert vehicle.t_ns - touched_ns == pytest.approx(3 * S, abs=S // 10)
    assert vehicle.happened == ["land", "landed", "disarmed"]


def test_flies_as_long_as_the_estimate_of_the_mission_says(vehicle):
    vehicle.take_off()
    fly_until(vehicle, lambda v: v.airborne)
    lifted_ns = vehicle.t_ns
    fly_until(vehicle, lambda v: v.finished)
    vehicle.land()
    fly_until(vehicle, lambda v: not v.airborne)
    model = FlightModel(ground_time_s=0.0)
    estimate = estimate_flight(Trajectory("test", ROUTE), (0.0, 0.0), VehicleSettings().takeoff_height_m, model)
    assert (vehicle.t_ns - lifted_ns) / S == pytest.approx(estimate.duration_s, abs=0.5)


def test_holds_its_position_and_goes_on_from_there(vehicle):
    in_mission(vehicle)
    fly_until(vehicle, lambda v: v.position_m[0] > 1.0)
    assert vehicle.hold() == ""
    here = vehicle.position_m
    vehicle.advance(vehicle.t_ns + 20 * S)
    assert (vehicle.position_m, vehicle.velocity_m_s, vehicle.mode) == (here, (0.0, 0.0, 0.0), "AUTO.LOITER")
    assert vehicle.resume() == ""
    fly_until(vehicle, lambda v: v.finished)
    assert vehicle.position_m == (4.0, 0.0, 2.0)


def test_a_hold_at_a_waypoint_is_stayed_to_its_end(vehicle):
    in_mission(vehicle)
    fly_until(vehicle, lambda v: v.reached == 1)
    reached_ns = vehicle.t_ns
    fly_until(vehicle, lambda v: v.position_m[0] > 0.0, step_ns=S // 100)
    assert (vehicle.t_ns - reached_ns) / S == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("step_ns", [S // 100, S // 10, S, 7 * S])
def test_a_step_of_any_length_ends_where_many_small_ones_would(step_ns):
    vehicle = Vehicle(VehicleSettings())
    vehicle.upload(ROUTE)
    vehicle.take_off()
    while vehicle.t_ns < 7 * S:
        vehicle.advance(vehicle.t_ns + step_ns)
    vehicle.advance(14 * S if step_ns == 7 * S else max(14 * S, vehicle.t_ns))
    expected = Vehicle(VehicleSettings())
    expected.upload(ROUTE)
    expected.take_off()
    expected.advance(vehicle.t_ns)
    assert vehicle.position_m == pytest.approx(expected.position_m, abs=1e-6)
    assert vehicle.happened == expected.happened


def test_two_flights_follow_each_other(vehicle):
    in_mission(vehicle)
    fly_until(vehicle, lambda v: v.finished)
    vehicle.land()
    fly_until(vehicle, lambda v: not v.armed)
    assert vehicle.upload((Waypoint(4.0, 4.0, 2.0, 0.0, 0.0),)) == ""
    assert vehicle.take_off() == ""
    fly_until(vehicle, lambda v: v.finished)
    assert vehicle.position_m == (4.0, 4.0, 2.0)


REFUSALS = (
    ("take_off", lambda v: v.upload(()), "no waypoints"),
    ("take_off", lambda v: v.take_off(), "already armed"),
    ("take_off", in_mission, "already armed"),
    ("take_off", lambda v: v.pilot_takes_over("POSCTL", S), "the pilot has control"),
    ("take_off", lambda v: v.flags.not_ready.update(rc="rc"), "arming denied: rc"),
    ("resume", lambda _: None, "not armed"),
    ("land", lambda _: None, "not armed"),
    ("disarm", in_mission, "denied: not on the ground"),
    ("hold", lambda v: in_mission(v).pilot_takes_over("POSCTL", S), "the pilot has control"),
    ("land", lambda v: in_mission(v).pilot_takes_over("POSCTL", S), "the pilot has control"),
    ("resume", lambda v: in_mission(v).enter_failsafe("AUTO.RTL"), "the autopilot is in a failsafe mode"),
)


@pytest.mark.parametrize("command, before, reason", REFUSALS, ids=[f"{r[0]}: {r[2]}" for r in REFUSALS])
def test_refuses_with_a_reason_and_changes_nothing(vehicle, command, before, reason):
    before(vehicle)
    known = (facts(vehicle), vehicle.position_m)
    assert getattr(vehicle, command)() == reason
    assert (facts(vehicle), vehicle.position_m) == known


def test_no_new_waypoints_in_flight(vehicle):
    in_mission(vehicle)
    assert vehicle.upload(ROUTE[:1]) == "armed: no new waypoints"
    assert vehicle.waypoints == ROUTE


def test_landing_before_it_armed_cancels_the_takeoff(vehicle):
    vehicle.take_off()
    assert vehicle.land() == ""
    vehicle.advance(20 * S)
    assert facts(vehicle) == (False, "AUTO.LOITER", "ON_GROUND", False)


def test_disarms_on_the_ground_by_command(vehicle):
    vehicle.take_off()
    vehicle.advance(S)
    assert vehicle.armed
    assert vehicle.disarm() == ""
    vehicle.advance(20 * S)
    assert facts(vehicle) == (False, "AUTO.TAKEOFF", "ON_GROUND", False)


def test_armed_and_told_nothing_it_disarms_after_a_while(vehicle):
    vehicle.pilot_arms()
    vehicle.advance(9 * S)
    assert vehicle.armed
    vehicle.advance(11 * S)
    assert not vehicle.armed


def test_the_pilot_stays_lands_and_disarms_and_gives_it_back(vehicle):
    in_mission(vehicle).pilot_takes_over("POSCTL", 5 * S)
    here, begun_ns = vehicle.position_m, vehicle.t_ns
    vehicle.advance(begun_ns + 5 * S)
    assert (vehicle.position_m, vehicle.mode, vehicle.pilot) == (here, "POSCTL", True)
    fly_until(vehicle, lambda v: not v.armed)
    assert facts(vehicle) == (False, "POSCTL", "ON_GROUND", False)
    assert vehicle.pilot
    vehicle.pilot_gives_back()
    assert (vehicle.pilot, vehicle.mode) == (False, "AUTO.LOITER")
    assert vehicle.take_off() == ""


def test_a_failsafe_returns_home_lands_and_ends_with_the_disarming(vehicle):
    in_mission(vehicle)
    fly_until(vehicle, lambda v: v.position_m[0] > 2.0)
    vehicle.enter_failsafe("AUTO.RTL")
    assert (vehicle.failsafe, vehicle.mode) == (True, "AUTO.RTL")
    fly_until(vehicle, lambda v: not v.armed)
    assert vehicle.position_m == (0.0, 0.0, 0.0)
    assert not vehicle.failsafe


def test_a_failsafe_that_ends_in_the_air_leaves_it_loitering(vehicle):
    in_mission(vehicle).enter_failsafe("AUTO.RTL")
    vehicle.leave_failsafe()
    assert (vehicle.failsafe, vehicle.mode) == (False, "AUTO.LOITER")
    assert vehicle.resume() == ""


def test_a_failsafe_on_the_ground_is_none(vehicle):
    vehicle.enter_failsafe("AUTO.RTL")
    assert not vehicle.failsafe


def test_broken_arming_accepts_and_does_not_arm(vehicle):
    vehicle.flags.does_not_arm = True
    assert vehicle.take_off() == ""
    vehicle.advance(20 * S)
    assert facts(vehicle) == (False, "AUTO.LOITER", "ON_GROUND", False)


def test_without_thrust_it_stays_on_the_ground_armed(vehicle):
    vehicle.flags.does_not_lift_off = True
    vehicle.take_off()
    vehicle.advance(60 * S)
    assert facts(vehicle) == (True, "AUTO.TAKEOFF", "ON_GROUND", False)


def test_weak_motors_do_not_reach_the_takeoff_height(vehicle):
    vehicle.flags.stops_climbing_at_m = 0.6
    vehicle.take_off()
    vehicle.advance(60 * S)
    assert facts(vehicle) == (True, "AUTO.TAKEOFF", "TAKING_OFF", True)
    assert vehicle.height_m == pytest.approx(0.6)


def test_a_mode_that_is_ignored_is_acknowledged_and_not_entered(vehicle):
    in_mission(vehicle).flags.ignores = ("AUTO.LAND",)
    assert vehicle.land() == ""
    vehicle.advance(vehicle.t_ns + S)
    assert vehicle.mode == "AUTO.MISSION"


def test_motors_that_do_not_stop_keep_it_armed_until_they_do(vehicle):
    in_mission(vehicle).flags.does_not_disarm = True
    vehicle.land()
    vehicle.advance(vehicle.t_ns + 60 * S)
    assert facts(vehicle) == (True, "AUTO.LAND", "ON_GROUND", False)
    assert vehicle.disarm() == "denied"
    vehicle.flags.does_not_disarm = False
    vehicle.advance(vehicle.t_ns + S)
    assert not vehicle.armed


def test_a_slope_tilts_it_on_the_ground_and_not_in_the_air(vehicle):
    vehicle.flags.tilt_rad = radians(20.0)
    assert vehicle.pose.tilt_rad == radians(20.0)
    in_mission(vehicle)
    assert vehicle.pose.tilt_rad < radians(5.0)
