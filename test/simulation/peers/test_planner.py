"""The simulated mission planner, seen through its services and its status."""

from math import pi

import pytest
from simulation_tools import Driver, S, changes, small_settings

from amaze_autonomy.engine.commands import MissionAction
from amaze_autonomy.engine.events import MissionPhase, MissionStatus, Outcome
from amaze_autonomy.missions import Frame, Trajectory, Waypoint

PHASE = MissionPhase


@pytest.fixture
def driver():
    return Driver()


def phases(driver):
    return changes(driver.events, MissionStatus, "phase")


def test_is_idle_at_first(driver):
    driver.go_on(1.0)
    status = driver.planner
    assert (status.phase, status.session_id, status.mission_id, status.waypoints) == (PHASE.IDLE, "", "", 0)


def test_tells_five_times_a_second_and_at_once_on_a_change(driver):
    driver.go_on(10.0)
    stamps = [event.t_ns for event in driver.events if isinstance(event, MissionStatus)]
    assert len(stamps) == pytest.approx(50, abs=1)
    driver.load()
    driver.go_on(0.1)
    assert driver.planner.phase is PHASE.LOADED


def test_loads_a_waypoint_file_of_a_mission(driver):
    assert driver.load(file_index=1).outcome is Outcome.ACCEPTED
    driver.go_on(1.0)
    status = driver.planner
    assert (status.phase, status.session_id, status.mission_id) == (PHASE.LOADED, "a", "1")
    assert (status.waypoint, status.waypoints, status.file_index) == (0, 1, 1)


def test_refuses_a_mission_or_a_file_that_it_does_not_have(driver):
    for fields, reason in (({"mission_id": "9"}, "no mission '9'"), ({"file_index": 2}, "no 3")):
        reply = driver.load(**fields)
        assert reply.outcome is Outcome.REFUSED
        assert reason in reply.message
    driver.go_on(1.0)
    assert driver.planner.phase is PHASE.IDLE


def test_flies_a_file_from_the_start_s_heading_as_the_vehicle_stands():
    ahead = Trajectory("ahead.csv", (Waypoint(3.0, 0.0, 2.0, 0.0, 0.0),), frame=Frame.START_HEADING)
    driver = Driver(settings=small_settings(trajectories={"1": (ahead,)}))
    driver.vehicle.yaw_rad = pi / 2
    driver.load()
    (waypoint,) = driver.vehicle.waypoints
    assert (waypoint.x_m, waypoint.y_m, waypoint.yaw_rad) == pytest.approx((0.0, 3.0, pi / 2))


def test_flies_the_file_lands_by_itself_and_says_so(driver):
    driver.load()
    assert driver.command(MissionAction.TAKEOFF).outcome is Outcome.ACCEPTED
    driver.until(lambda: not driver.vehicle.armed and driver.vehicle.reached)
    driver.go_on(1.0)
    assert phases(driver) == [PHASE.IDLE, PHASE.LOADED, PHASE.TAKING_OFF, PHASE.FLYING, PHASE.LANDING, PHASE.LANDED]
    assert (driver.planner.waypoint, driver.planner.waypoints) == (3, 3)
    assert (driver.planner.distance_left_m, driver.planner.time_left_s) == (0.0, 0.0)


def test_says_which_waypoint_it_flies_to_and_how_much_is_left(driver):
    driver.take_off()
    driver.until(lambda: driver.vehicle.reached == 1)
    driver.go_on(3.0)
    status = driver.planner
    assert status.waypoint == 2
    assert 3.0 < status.distance_left_m < 6.0
    assert 3.0 < status.time_left_s < 15.0


def test_holds_and_resumes(driver):
    driver.take_off()
    assert driver.command(MissionAction.HOLD).outcome is Outcome.ACCEPTED
    driver.go_on(1.0)
    assert driver.planner.phase is PHASE.HOLDING
    assert driver.command(MissionAction.RESUME).outcome is Outcome.ACCEPTED
    driver.go_on(1.0)
    assert driver.planner.phase is PHASE.FLYING


def test_a_landing_ends_early_and_does_not_claim_the_last_waypoint(driver):
    driver.take_off()
    driver.command(MissionAction.LAND)
    driver.until(lambda: not driver.vehicle.armed)
    driver.go_on(1.0)
    assert driver.planner.phase is PHASE.LANDED
    assert driver.planner.waypoint < driver.planner.waypoints


def test_abort_lands_in_the_air_and_disarms_on_the_ground(driver):
    driver.load()
    driver.command(MissionAction.TAKEOFF)
    driver.go_on(1.0)
    assert (driver.vehicle.armed, driver.vehicle.airborne) == (True, False)
    driver.command(MissionAction.ABORT)
    assert not driver.vehicle.armed
    driver.take_off()
    driver.command(MissionAction.ABORT)
    assert driver.vehicle.mode == "AUTO.LAND"


def test_a_landing_before_it_armed_cancels_the_takeoff(driver):
    driver.load()
    driver.command(MissionAction.TAKEOFF)
    assert driver.command(MissionAction.LAND).outcome is Outcome.ACCEPTED
    driver.go_on(10.0)
    assert not driver.vehicle.armed
    assert driver.planner.phase is PHASE.LANDED


def test_a_second_file_is_loaded_and_flown_after_the_first(driver):
    driver.take_off()
    driver.until(lambda: driver.planner.phase is PHASE.LANDED)
    assert driver.load(file_index=1).outcome is Outcome.ACCEPTED
    assert driver.command(MissionAction.TAKEOFF).outcome is Outcome.ACCEPTED
    driver.go_on(0.3)
    assert driver.planner.phase is PHASE.TAKING_OFF
    driver.until(lambda: driver.planner.phase is PHASE.LANDED)
    assert driver.planner.file_index == 1


REFUSED = (
    (MissionAction.TAKEOFF, "b", "session 'b' is not the one that is loaded"),
    (MissionAction.HOLD, "b", "session 'b' is not the one that is loaded"),
    (MissionAction.HOLD, "a", "nothing to hold in phase LOADED"),
    (MissionAction.RESUME, "a", "nothing to resume in phase LOADED"),
    (MissionAction.LAND, "a", "not armed"),
)


@pytest.mark.parametrize("action, session, reason", REFUSED, ids=[f"{r[0].name} {r[1]}" for r in REFUSED])
def test_refuses_with_a_reason(driver, action, session, reason):
    driver.load()
    reply = driver.command(action, session_id=session)
    assert reply.outcome is Outcome.REFUSED
    assert reason in reply.message


def test_lands_whatever_the_session_is(driver):
    driver.take_off()
    assert driver.command(MissionAction.LAND, session_id="of another day").outcome is Outcome.ACCEPTED
    assert driver.vehicle.mode == "AUTO.LAND"


def test_the_pilot_is_not_fought():
    driver = Driver("fault: pilot_takes_over, after: {event: mission, delay_s: 2}")
    driver.take_off()
    driver.go_on(3.0)
    assert driver.vehicle.pilot
    assert driver.planner.message == "the pilot has control"
    assert driver.command(MissionAction.HOLD).outcome is Outcome.REFUSED
    assert driver.vehicle.mode == "POSCTL"


def test_one_that_was_killed_comes_back_and_knows_nothing():
    driver = Driver("process: mission_planner, fault: killed, after: {event: mission}, for_s: 3")
    driver.take_off()
    gone_ns = driver.world.now_ns
    driver.go_on(2.9)
    told = [event.t_ns for event in driver.events if isinstance(event, MissionStatus)]
    assert max(told) <= gone_ns
    driver.go_on(1.0)
    assert (driver.planner.phase, driver.planner.session_id) == (PHASE.IDLE, "")
    assert driver.planner.t_ns > gone_ns + 2 * S
