"""Landing detection and state estimation of the world: their verdicts follow from range, IMU and estimate."""

from dataclasses import replace

import pytest
from simulation_tools import Driver, changes, small_settings

from amaze_autonomy.engine.events import CheckName, Landed, LandedStatus, Verdict


def failed(reply):
    return [row.name for row in reply.checks if row.verdict in (Verdict.FAIL, Verdict.UNKNOWN)]


@pytest.mark.parametrize("check", [CheckName.ON_GROUND, CheckName.STATE_ESTIMATION])
def test_on_level_ground_both_checks_pass(check):
    driver = Driver()
    driver.go_on(4.0)
    reply = driver.check(check)
    assert reply.ok
    assert failed(reply) == []


@pytest.mark.parametrize("check", [CheckName.ON_GROUND, CheckName.STATE_ESTIMATION])
def test_right_after_the_start_nothing_is_known_and_nothing_passes(check):
    driver = Driver()
    driver.go_on(0.05)
    assert not driver.check(check).ok


def test_the_landing_detection_follows_the_flight():
    driver = Driver()
    driver.go_on(2.0)
    driver.take_off()
    driver.until(lambda: driver.vehicle.reached == 3 and not driver.vehicle.armed)
    driver.go_on(5.0)
    assert changes(driver.events, LandedStatus, "landed") == [
        Landed.UNKNOWN,
        Landed.ON_GROUND,
        Landed.AIRBORNE,
        Landed.ON_GROUND,
    ]


def test_the_distance_in_flight_is_the_height():
    driver = Driver()
    driver.take_off()
    driver.until(lambda: driver.vehicle.reached == 1)
    driver.go_on(0.8)
    assert driver.last(LandedStatus).distance_m == pytest.approx(2.0, abs=0.02)


GROUND = (
    ("fault: raised, height_m: 0.5", ["distance to ground"]),
    ("component: lrf, fault: nan", ["range age", "distance to ground"]),
    ("component: lrf, fault: silent", ["range age", "distance to ground"]),
    ("component: lrf, fault: reads, value_m: 0.9", ["distance to ground"]),
    ("component: lrf, fault: reads, value_m: -1", ["range age", "distance to ground"]),
)


@pytest.mark.parametrize("fault, rows", GROUND, ids=[case[0] for case in GROUND])
def test_what_the_range_finder_sees_fails_the_check_of_the_ground_until_it_is_put_right(fault, rows):
    driver = Driver(fault + ", for_s: 20")
    driver.go_on(4.0)
    reply = driver.check(CheckName.ON_GROUND)
    assert failed(reply) == rows
    driver.go_on(10.0)
    assert driver.check(CheckName.ON_GROUND).ok


def test_a_range_finder_that_is_stuck_sees_the_ground_all_the_way_up():
    driver = Driver("component: lrf, fault: stuck, at_s: 3")
    driver.go_on(4.0)
    driver.take_off()
    driver.go_on(5.0)
    assert driver.vehicle.height_m > 1.0
    assert driver.last(LandedStatus).distance_m == pytest.approx(0.0, abs=0.02)
    assert driver.last(LandedStatus).landed is Landed.UNKNOWN


STATES = (
    ("fault: tilted, tilt_deg: 20", "tilt", True),
    ("fault: tilted, tilt_deg: 5", "tilt", False),
)


@pytest.mark.parametrize("fault, row, fails", STATES, ids=[case[0] for case in STATES])
def test_a_slope_fails_the_check_of_the_state_when_it_is_too_steep(fault, row, fails):
    driver = Driver(fault)
    driver.go_on(5.0)
    reply = driver.check(CheckName.STATE_ESTIMATION)
    (tilt,) = [each for each in reply.checks if each.name == row]
    assert (tilt.verdict is Verdict.FAIL, reply.ok) == (fails, not fails)


def test_an_imu_that_is_silent_or_says_nan_fails_the_check(configuration):
    for kind in ("silent", "nan"):
        driver = Driver(f"component: imu, fault: {kind}, at_s: 5", settings=configuration)
        driver.go_on(20.0)
        reply = driver.check(CheckName.STATE_ESTIMATION)
        assert not reply.ok
        assert failed(reply)


def test_the_check_of_the_state_passes_at_any_time_of_a_vehicle_at_rest():
    driver = Driver()
    driver.go_on(3.0)
    for _ in range(40):
        driver.go_on(0.37)
        assert driver.ask_state().ok


def test_a_vehicle_in_flight_is_not_still():
    driver = Driver()
    driver.take_off()
    driver.go_on(3.0)
    assert not driver.ask_state().ok


def test_a_range_in_millimetres_is_read_like_one_in_metres():
    settings = small_settings()
    settings = replace(settings, landing=replace(settings.landing, scale=0.001))
    driver = Driver(settings=settings)
    driver.go_on(4.0)
    assert driver.check(CheckName.ON_GROUND).ok
